//! The image that is written: axis by axis the model that the train runs warrant where the judge bears it out, else the baseline, else a
//! constant.

use super::data::{Candidate, Data};
use super::floor::Noise;
use super::judge::{borne_out, holds_elsewhere, Agreement, Misfit, Prediction};
use super::means::Means;
use super::model::{drop_idle_effects, take_axis, Fitted, Specification, TEMPERATURE_TERMS};
use super::report::{by_axis, AxisModel, ByAxis, Image, Judged, OnVerify};
use super::uncertainty::{self, Known};
use super::unseen::Unseen;
use crate::fit;
use hrg_core::bias::{Coefficients, Scaling, TERMS};
use hrg_core::calibration::{Axis, Calibration, Uncertainty};
use hrg_core::visited::Visited;
use hrg_core::AXES;
use hrg_data::error::BadInput;
use hrg_data::numeric::stats::{mean, std_dev};

/// An image with what it reaches.
pub(super) struct Written {
    pub image: Calibration,
    pub kind: Image,
    /// By axis: figures on the verify run; `None` where no image is written.
    pub figures: Option<ByAxis<OnVerify>>,
    /// By axis: the image against the baseline, on the run that judges.
    pub judged: ByAxis<Judged>,
    /// `true` where an axis is extended and the judge bears it out, no axis is worse than a constant or the least-squares baseline, and on none the
    /// runs contradict each other.
    pub good: bool,
    /// `true` where the rows that judge have also chosen what stands on an axis.
    pub chosen_on_verify: bool,
}

impl Written {
    /// `true` where no axis may be worse than the baseline on another profile, see [`Judged::uncertain_elsewhere`].
    pub fn holds_elsewhere(&self) -> bool {
        !self.judged.values().any(|j| j.uncertain_elsewhere)
    }
}

/// The fits that an image may be made of.
pub(super) struct Fits<'f> {
    pub data: &'f Data<'f>,
    /// The model that the train runs warrant, of what a unit can compute.
    pub extended: &'f Fitted,
    /// Its uncertainty.
    pub known: &'f Known,
    /// The baseline beside the named events, by the same least squares.
    pub beside: &'f Fitted,
    /// Its uncertainty.
    pub beside_known: &'f Known,
    /// The baseline by plain least squares.
    pub plain: &'f Fitted,
}

impl Fits<'_> {
    /// The image. `verify` chooses by axis; `judge` judges, where there is a third run, else the same.
    pub fn image(
        &self,
        calibration: &Calibration,
        verify: &Unseen<'_>,
        judge: Option<&Unseen<'_>>,
        notes: &mut Vec<String>,
    ) -> Written {
        let scaling = &calibration.scaling;
        let unit = |c: &Candidate| c.on_unit();
        let predictions = |of: &Unseen<'_>| {
            (
                Prediction::of_unit(&of.data, self.extended, self.known, &unit),
                Prediction::new(&of.data, self.beside, self.beside_known, &unit),
            )
        };
        let mut image = self.extended.image(calibration, &self.known.stated, notes);
        image.sequence = 2;
        let plain = self.plain.image(calibration, &uncertainty::of_plain(self.data, self.plain), notes);
        let beside = self.beside.image(calibration, &self.beside_known.stated, &mut Vec::new());
        let of_verify = predictions(verify);
        let (of_image, of_beside) = &of_verify;
        let (baseline, mut chosen_on_verify) = self.baseline(plain.clone(), &beside, of_beside, verify);
        let mut models = [AxisModel::Constant; AXES];
        let constants = [0, 1, 2].map(|a: usize| mean(&self.without_events(a)));
        let corrected = |c: &Calibration| verify.corrected(c).map(|r| verify.means(&r));
        let of_base = corrected(&baseline);
        let has_effect = [0, 1, 2].map(|a: usize| image.effects.iter().any(|t| t.gains[a].iter().any(|g| *g != 0.0)));
        let scores: Vec<(usize, Agreement)> = (0..AXES)
            .filter(|a| has_effect[*a])
            .filter_map(|a| Some((a, self.score(of_image, of_beside, verify, a)?)))
            .collect();
        let won = borne_out(&scores);
        // An axis without effects has the baseline; a baseline that leaves more than the raw rates is none.
        let without_effects = |image: &mut Calibration, a: usize| {
            take_axis(image, &baseline, a);
            let raw = verify.means(&verify.run.steps.rate_dph[a]);
            if of_base[a].deviation() < raw.deviation() {
                return AxisModel::Baseline;
            }
            make_constant(&mut image.axes[a], constants[a], &raw);
            AxisModel::Constant
        };
        for a in verify.run.steps.present() {
            let wins = won.contains(&a);
            chosen_on_verify |= has_effect[a] && !wins;
            models[a] = if wins { AxisModel::Extended } else { without_effects(&mut image, a) };
        }
        drop_idle_effects(&mut image);
        // An image holds fewer effects than a model may have: what is written is looked at once more.
        let of_written = corrected(&image);
        for a in verify.run.steps.present() {
            if models[a] == AxisModel::Extended && of_written[a].deviation() > of_base[a].deviation() {
                (models[a], chosen_on_verify) = (without_effects(&mut image, a), true);
            }
        }
        drop_idle_effects(&mut image);
        fit::state_inputs(&mut image, self.data.runs);
        let kind = match () {
            () if models.contains(&AxisModel::Extended) => Image::Extended,
            () if models.contains(&AxisModel::Baseline) => Image::Baseline,
            () => Image::None,
        };
        let left = verify.corrected(&image);
        let of_judge = judge.map(predictions);
        let runs: Vec<&Unseen<'_>> = std::iter::once(verify).chain(judge).collect();
        let judged = self.judged((&image, &plain), &of_judge.unwrap_or(of_verify), &runs, models, constants);
        let names = hrg_data::axes::AXIS_NAMES;
        let extended = verify.run.steps.present().filter(|a| models[*a] == AxisModel::Extended);
        let on_judge: Vec<(usize, Agreement)> = extended.map(|a| (a, judged[names[a]].agreement)).collect();
        let worse = verify.run.steps.present().any(|a| {
            let j = judged[names[a]];
            (models[a] == AxisModel::Extended && j.agreement.loses()) || j.worse_than_a_constant || j.contradicted
        });
        let chosen = left.each_ref().map(|left| verify.means(left));
        self.state_unvisited(&mut image, scaling, models);
        let predicted = self.state_left(&mut image, verify, models, &left);
        // (A number that no image can hold, as the uncertainty of a gyro that leaves thousands of deg/h.)
        let kind = readable(kind, &mut image, &baseline, notes);
        let figures = (kind != Image::None).then(|| on_verify(verify, &chosen, &predicted, models));
        if kind == Image::None {
            image = baseline;
        }
        Written { image, kind, figures, judged, good: !borne_out(&on_judge).is_empty() && !worse, chosen_on_verify }
    }

    /// The baseline to be written: an axis whose events are columns of its fit keeps them there, unless the verify run shows less error
    /// without. An axis without events has the one by least squares, unless the verify run shows less error with the one whose ramp terms
    /// have a prior: where temperature and ramp went together in the train runs, least squares parts them by chance. `true` if the verify run has
    /// chosen that.
    fn baseline(
        &self,
        mut plain: Calibration,
        beside: &Calibration,
        of_beside: &Prediction,
        verify: &Unseen<'_>,
    ) -> (Calibration, bool) {
        let mut chosen = false;
        for a in 0..AXES {
            let events = self.beside.terms().iter().any(|t| t.on(a));
            let fall = of_beside.fall_against(&self.plain_on(&verify.data, a), &verify.data, a);
            let better = if events { fall.is_none_or(|f| f.mse_fall >= 0.0) } else { fall.is_some_and(|f| f.wins()) };
            chosen |= events != better;
            if better {
                take_axis(&mut plain, beside, a);
            }
        }
        (plain, chosen)
    }

    /// Writes into each axis what the verify run shows to be left beyond what is stated, where the runs of the fit have been and where not. `left`: what the
    /// image leaves, by step. Gives by axis the variances that the uncertain coefficients add to the whole run: about their mean, and of the mean.
    fn state_left(
        &self,
        image: &mut Calibration,
        verify: &Unseen<'_>,
        models: [AxisModel; AXES],
        left: &[Vec<f64>; AXES],
    ) -> [(f64, f64); AXES] {
        let run = verify.run;
        [0, 1, 2].map(|a: usize| {
            let fitted = if models[a] == AxisModel::Extended { self.extended } else { self.beside };
            let moves = fitted.moves(run, &self.data.scaling, a, &|c| c.on_unit());
            if models[a] != AxisModel::Constant && run.steps.present().any(|p| p == a) {
                let (axis, noise) = (&mut image.axes[a], &verify.noise[a]);
                let inside = Inside::new(axis, verify, a, &left[a]);
                let predicted = moves.predicted_variance(|k| inside.rows[k]);
                state_left_inside(&mut axis.uncertainty, &inside, noise, predicted);
                state_left_outside(axis, verify, a, (&left[a], &inside), noise.floor());
            }
            moves.predicted_variance(|_| true)
        })
    }

    /// Writes into each axis how uncertain its bias is where the runs of the fit have not been.
    fn state_unvisited(&self, image: &mut Calibration, scaling: &Scaling, models: [AxisModel; AXES]) {
        for (a, model) in models.iter().enumerate() {
            let (fitted, known) = match model {
                AxisModel::Extended => (self.extended, self.known),
                AxisModel::Baseline => (self.beside, self.beside_known),
                AxisModel::Constant => continue,
            };
            let Some(posterior) = &known.posteriors[a] else { continue };
            // Of the effects, and of the ramp terms of the baseline: a run may not have told one from the other.
            let columns = fitted.model.columns(self.data, a).values;
            let gains = &fitted.axes[a].coefficients;
            let done: Vec<f64> = (0..self.data.axes[a].y.len())
                .map(|k| (TEMPERATURE_TERMS..gains.len()).map(|j| gains[j] * columns[j][k]).sum())
                .collect();
            let square = std_dev(&done).powi(2);
            image.axes[a].visited.unvisited_dph2 =
                uncertainty::unvisited(&image.axes[a], scaling, &posterior.covariance, square) as f32;
        }
    }

    /// The extended model against the baseline: more probable than the one by the same least squares, with less error than the one that is
    /// written in its place.
    fn score(&self, of_image: &Prediction, of_beside: &Prediction, run: &Unseen<'_>, a: usize) -> Option<Agreement> {
        let against = of_image.against(of_beside, &run.data, a)?;
        let plain = of_image.fall_against(&self.plain_on(&run.data, a), &run.data, a)?;
        Some(if plain.mse_fall < against.mse_fall {
            Agreement { log_score: against.log_score, ..plain }
        } else {
            against
        })
    }

    /// The prediction of the plain baseline on the blocks of a run.
    fn plain_on(&self, data: &Data<'_>, a: usize) -> Vec<f64> {
        let base = &data.axes[a].base;
        let n = data.axes[a].y.len();
        (0..n)
            .map(|k| base[..TERMS].iter().zip(&self.plain.axes[a].coefficients).map(|(x, c)| c * x[k]).sum())
            .collect()
    }

    /// The written image on the runs that did not learn, by axis (the last one judges), against the baseline by least squares and against a constant.
    fn judged(
        &self,
        (image, plain): (&Calibration, &Calibration),
        (of_image, of_beside): &(Prediction, Prediction),
        runs: &[&Unseen<'_>],
        models: [AxisModel; AXES],
        constants: [f64; AXES],
    ) -> ByAxis<Judged> {
        let judge = runs[runs.len() - 1];
        let corrected: Vec<[[Vec<f64>; AXES]; 2]> =
            runs.iter().map(|r| [image, plain].map(|c| r.corrected(c))).collect();
        let [left, base] = &corrected[runs.len() - 1];
        let [whole_left, whole_base] = [image, plain].map(|c| judge.whole_corrected(c));
        by_axis(|a| {
            let means = judge.means(&left[a]);
            let agreement = if models[a] == AxisModel::Extended {
                self.score(of_image, of_beside, judge, a).unwrap_or_default()
            } else {
                Agreement::default()
            };
            let raw = judge.means(&judge.run.steps.rate_dph[a]);
            let worse_than = |other: &Means, constant: f64| is_worse(&means, other, constant, judge.noise[a].shift());
            let there = judge.run.steps.present().any(|p| p == a);
            let worse = there
                && match models[a] {
                    // (The constant of the train runs against none.)
                    AxisModel::Constant => {
                        worse_than(&raw, 0.0) && means.mean().abs() > 2.0 * raw.mean().abs() + raw.deviation()
                    }
                    AxisModel::Baseline | AxisModel::Extended => {
                        let [whole_left, whole_base] = [&whole_left[a], &whole_base[a]].map(|v| judge.means(v));
                        worse_than(&raw, constants[a])
                            || worse_than(&judge.means(&base[a]), 0.0)
                            || is_worse(&whole_left, &whole_base, 0.0, judge.noise[a].shift())
                    }
                };
            Judged {
                agreement,
                rms_dph: (means.deviation().powi(2) + means.mean().powi(2)).sqrt(),
                constant_dph: means.mean(),
                worse_than_a_constant: worse,
                uncertain_elsewhere: models[a] == AxisModel::Extended && is_uncertain_elsewhere(runs, &corrected, a),
                contradicted: there
                    && models[a] == AxisModel::Constant
                    && !judge.noise[a].ratio(means.deviation(), 0.0).is_noise(),
            }
        })
    }

    /// The rates of an axis on the train rows, without what its named events did.
    fn without_events(&self, a: usize) -> Vec<f64> {
        let mut y = self.data.axes[a].y.clone();
        for (e, t) in self.beside.terms().iter().enumerate() {
            let Some(range) = self.beside.gains(e, a) else { continue };
            let columns = t.parts.iter().flat_map(|c| self.data.columns(c, a, true).unwrap_or_default());
            for (column, g) in columns.zip(&self.beside.axes[a].coefficients[range]) {
                y.iter_mut().zip(column).for_each(|(y, x)| *y -= g * x);
            }
        }
        y
    }
}

/// `true` where an image leaves too much of what the baseline leaves of the runs that did not learn. `corrected`: rates of each run with the image
/// and with the baseline.
fn is_uncertain_elsewhere(runs: &[&Unseen<'_>], corrected: &[[[Vec<f64>; AXES]; 2]], a: usize) -> bool {
    let misfits = runs.iter().zip(corrected).map(|(r, both)| {
        let [image, baseline] = both.each_ref().map(|rates| {
            let without_events = rates[a].iter().zip(&r.happened.sum_dph[a]).map(|(rate, event)| rate - event);
            let means = r.means(&without_events.collect::<Vec<_>>());
            // (What a model is uncertain by is no noise: it is another one on another profile.)
            let square = (means.deviation().powi(2) - r.noise[a].floor().powi(2)).max(0.0);
            Misfit { square, spread: means.spread_of_square() }
        });
        (image, baseline)
    });
    !holds_elsewhere(&misfits.collect::<Vec<_>>())
}

/// `true` if the root mean square of an image's residual, its constant included, is larger than that of other rates less a constant, by
/// more than what the constant of a run is uncertain by (`shift`, its standard deviation).
fn is_worse(left: &Means, other: &Means, constant: f64, shift: f64) -> bool {
    let square = |deviation: f64, mean: f64| deviation * deviation + mean * mean;
    let (ours, theirs) = (left.mean().abs(), other.mean() - constant);
    let least = (ours - super::judge::DEVIATIONS * shift).max(0.0);
    square(left.deviation(), least) > square(other.deviation(), theirs)
}

/// Rows of a verify run of which an image knows temperature and ramp: on the others it states what it may do there ([`Fits::state_unvisited`]).
struct Inside {
    /// By step. All of them, where they are too few to tell a variance: where its deviation is as large as itself.
    rows: Vec<bool>,
    /// Means of what the image leaves there.
    left: Means,
}

impl Inside {
    /// `left`: what the image leaves of an axis, by step.
    fn new(axis: &Axis, verify: &Unseen<'_>, a: usize, left: &[f64]) -> Self {
        let is_known = |k| super::is_visited(axis, verify.run, a, k).unwrap_or(false);
        let rows: Vec<bool> = (0..left.len()).map(is_known).collect();
        let masked: Vec<f64> = left.iter().zip(&rows).map(|(v, known)| if *known { *v } else { f64::NAN }).collect();
        let inside = verify.means(&masked);
        if inside.spread_of_square() < 1.0 {
            Self { rows, left: inside }
        } else {
            Self { rows: vec![true; left.len()], left: verify.means(left) }
        }
    }
}

/// Adds to the stated uncertainty what the verify run shows the model to leave beyond the noise, and how far the constant moves from day to
/// day. `predicted`: what the coefficients are uncertain by on the same rows, about the mean and of the mean, which is stated already.
fn state_left_inside(uncertainty: &mut Uncertainty, inside: &Inside, noise: &Noise, predicted: (f64, f64)) {
    if uncertainty.rest_dph2 > 0.0 {
        let (left, floor_dph2) = (&inside.left, noise.floor().powi(2));
        let shift_dph2 = left.mean().powi(2) - noise.shift().powi(2) - predicted.1;
        let ratio = noise.ratio(left.deviation(), 0.0);
        // (The two bounds are 2 x 1.96 deviations of the logarithm of the deviation apart, and its square has twice that.)
        let floor_std = floor_dph2 * (ratio.high / ratio.low).ln() / 1.96;
        let square = (left.deviation().powi(2), left.spread_of_square());
        let more = misfit_dph2(square, (floor_dph2, floor_std), predicted.0) + day_dph2(shift_dph2, noise.floor());
        uncertainty.rest_dph2 += more as f32;
    }
}

/// Raises what an axis is uncertain by where the runs of the fit have not been to what the verify run shows there, if it is more. `left`: what the
/// image leaves, by step.
fn state_left_outside(
    axis: &mut Axis,
    verify: &Unseen<'_>,
    a: usize,
    (left, inside): (&[f64], &Inside),
    floor_dph: f64,
) {
    let ranges = axis.ranges();
    let of_one = Visited { unvisited_dph2: 1.0, ..axis.visited };
    // For each step outside: how often the variance counts there. (Next to the ranges it hardly does: what is left there is no measure of it.)
    let weight = |k: usize| {
        let (t, r) = verify.run.state(k, a).filter(|_| !inside.rows[k])?;
        of_one.more_dph2(&ranges, t, r, || 0.0).map(|w| f64::from(w.max(1.0)))
    };
    let weights: Vec<f64> = (0..left.len()).map(|k| weight(k).unwrap_or(f64::NAN)).collect();
    let off = left.iter().zip(&weights).map(|(v, w)| if w.is_finite() { v - inside.left.mean() } else { f64::NAN });
    let off = verify.means(&off.collect::<Vec<_>>());
    if off.count() > 0 {
        let square = off.deviation().powi(2) + off.mean().powi(2);
        let more = square - floor_dph * floor_dph - f64::from(axis.uncertainty.rest_dph2);
        let seen_dph2 = more / verify.means(&weights).mean();
        axis.visited.unvisited_dph2 = axis.visited.unvisited_dph2.max(seen_dph2 as f32);
    }
}

/// Variance that an image leaves beyond the noise and beyond what its coefficients are stated to be uncertain by, (deg/h)^2: the mean of both parts of
/// what it is off by, once a run was seen, less what is stated. What the coefficients do is the square of a normal number; a misfit is none or from a
/// fifth of a floor to 36 floors: before the run is seen there is one or none at even odds, and each power of two is as probable as another.
///
/// `square`: what is left about its mean, (deg/h)^2, with its relative deviation; `floor`: that of noise alone with its deviation; `stated_dph2`:
/// what the coefficients add on average. What is left is a sum of squares, none of them below zero, so logarithms are compared.
fn misfit_dph2(square: (f64, f64), floor: (f64, f64), stated_dph2: f64) -> f64 {
    // (Half a power of two apart.)
    const VALUES: i32 = 31;
    let ((square, spread), (floor_dph2, floor_std)) = (square, floor);
    let values = (0..VALUES).map(|k| (floor_dph2 * 0.04 * 2f64.powf(0.5 * f64::from(k)), 1.0 / f64::from(VALUES)));
    let (mut sum, mut mean) = (0.0, 0.0);
    for (misfit_dph2, prior) in std::iter::once((0.0, 1.0)).chain(values) {
        for normal in (0..=16).map(|k| f64::from(k) / 4.0) {
            let off_dph2 = stated_dph2 * normal * normal + misfit_dph2;
            let expected = floor_dph2 + off_dph2;
            let std = spread.hypot(floor_std / expected);
            let distance = (square / expected).ln() / std;
            let density = prior * (-0.5 * (normal * normal + distance * distance)).exp() / std;
            sum += density;
            mean += density * off_dph2;
        }
    }
    let off_dph2 = if sum > 0.0 { mean / sum } else { square - floor_dph2 };
    (off_dph2 - stated_dph2).max(0.0)
}

/// Variance of the constant from one day to another, (deg/h)^2, from the square of one shift (noise taken off): 68.3 % of the next shifts are
/// within its root. Before a day is seen it is taken for a third of a floor, with the weight of one day. With the day that was seen the next
/// shift follows Student's t with two degrees of freedom: |t| is below `k` with the probability `k / (k^2 + 2)^0.5`.
fn day_dph2(shift_dph2: f64, floor_dph: f64) -> f64 {
    const WITHIN: f64 = 0.682_689;
    const K_SQUARED: f64 = 2.0 * WITHIN * WITHIN / (1.0 - WITHIN * WITHIN);
    0.5 * K_SQUARED * (floor_dph * floor_dph / 9.0 + shift_dph2.max(0.0))
}

/// Gives an axis a bias that does not depend on temperature: it is uncertain by all that the rates of a run do.
fn make_constant(axis: &mut Axis, rate_dph: f64, raw: &Means) {
    let mut k = [0.0; TERMS];
    k[0] = rate_dph as f32;
    axis.coefficients = Coefficients::One(k);
    axis.bias_std_dph = [[0.0; TERMS]; 2];
    let square = raw.deviation().powi(2) + (raw.mean() - rate_dph).powi(2);
    axis.uncertainty = Uncertainty { rest_dph2: square as f32, ..Uncertainty::default() };
}

/// A model that was fitted, with how uncertain it is.
pub(super) fn fitted(data: &Data<'_>, model: &Specification) -> Result<(Fitted, Known), BadInput> {
    let fitted = Fitted::new(data, model)?;
    let known = uncertainty::of(data, &fitted);
    Ok((fitted, known))
}

/// Figures of the written image on the verify run. `chosen`: the means that it leaves; `predicted`: variances of its bias, about the mean and of
/// the mean.
fn on_verify(
    verify: &Unseen<'_>,
    chosen: &[Means; AXES],
    predicted: &[(f64, f64); AXES],
    models: [AxisModel; AXES],
) -> ByAxis<OnVerify> {
    by_axis(|a| OnVerify {
        verify_rms_dph: chosen[a].deviation(),
        mean_dph: chosen[a].mean(),
        mean_std_dph: (verify.noise[a].shift().powi(2) + predicted[a].1).sqrt(),
        used_means: chosen[a].count(),
        model: models[a],
    })
}

/// The note where no unit would accept even the baseline.
pub(super) const UNREADABLE: &str = "no image was made: a number of the baseline is beyond what an image holds (10^7 deg/h, and the like): check the unit of the rates";

/// The kind of image that is written: the baseline in the place of one that no unit accepts.
fn readable(kind: Image, image: &mut Calibration, baseline: &Calibration, notes: &mut Vec<String>) -> Image {
    match kind {
        Image::None => Image::None,
        kind if can_be_read(image) => kind,
        Image::Extended if can_be_read(baseline) => {
            notes.push("the model with its effects has a number that no image holds: the baseline is written".into());
            image.clone_from(baseline);
            Image::Baseline
        }
        _ => {
            notes.push(UNREADABLE.into());
            Image::None
        }
    }
}

/// `true` if a unit accepts the image.
fn can_be_read(image: &Calibration) -> bool {
    image.to_bytes().is_some_and(|bytes| Calibration::from_bytes(&bytes).is_ok())
}

#[cfg(test)]
mod tests {
    use super::{day_dph2, misfit_dph2};
    use rand_chacha::rand_core::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    #[test]
    fn a_misfit_is_not_larger_than_what_is_left() {
        // With coefficients of any uncertainty, a floor known well or badly, in many swings or a few.
        for square in [0.3, 0.8, 1.0, 1.2, 2.0, 10.0, 100.0] {
            for stated in [0.0, 0.1, 1.0, 10.0, 100.0] {
                for (spread, floor_std) in [(0.1, 0.05), (0.1, 0.5), (0.3, 0.2), (0.6, 0.2)] {
                    let misfit = misfit_dph2((square, spread), (1.0, floor_std), stated);
                    assert!(
                        (0.0..1.0 + 1.5 * square).contains(&misfit),
                        "{misfit}: {square} {spread} {stated} {floor_std}"
                    );
                }
            }
        }
        // All of it, where nothing else explains it, and where the coefficients do: they are the same on the next run. Nothing, where the floor does.
        for stated in [0.0, 1.0, 10.0] {
            let more = |square: f64| misfit_dph2((square, 0.2), (1.0, 0.1), stated);
            assert!(
                ((more(26.0) + stated) / 25.0 - 1.0).abs() < 0.1 && more(1.0) < 0.05,
                "{} {}",
                more(26.0),
                more(1.0)
            );
        }
    }

    #[test]
    fn the_stated_shift_holds_the_next_one_as_often_as_a_standard_deviation_does() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
        let mut drawn = || -> f64 { StandardNormal.sample(&mut rng) };
        let (floor, mut within) = (0.3, [0, 0]);
        const UNITS: u32 = 40_000;
        for _ in 0..UNITS {
            // The prior of a unit: a third of a floor with the weight of one day.
            let deviation = floor / 3.0 / drawn().abs();
            let (seen, next) = (deviation * drawn(), deviation * drawn());
            let stated = day_dph2(seen * seen, floor).sqrt();
            within[0] += u32::from(next.abs() < stated);
            within[1] += u32::from(next.abs() < 1.96 * stated);
        }
        let share = within.map(|n| f64::from(n) / f64::from(UNITS));
        // Student's t with two degrees of freedom: k / (k^2 + 2)^0.5 at 1.321 and 1.96 times that.
        assert!((share[0] - 0.6827).abs() < 0.01 && (share[1] - 0.8777).abs() < 0.01, "{share:?}");
    }
}
