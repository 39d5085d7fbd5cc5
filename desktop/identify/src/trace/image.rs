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
        let corrected = |c: &Calibration| fit::correct(c, &verify.run.steps).map(|r| verify.means(&r));
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
        let of_judge = judge.map(predictions);
        let runs: Vec<&Unseen<'_>> = std::iter::once(verify).chain(judge).collect();
        let chosen = corrected(&image);
        let judged = self.judged((&image, &plain), &of_judge.unwrap_or(of_verify), &runs, models, constants);
        let names = hrg_data::axes::AXIS_NAMES;
        let extended = verify.run.steps.present().filter(|a| models[*a] == AxisModel::Extended);
        let on_judge: Vec<(usize, Agreement)> = extended.map(|a| (a, judged[names[a]].agreement)).collect();
        let worse = verify.run.steps.present().any(|a| {
            let j = judged[names[a]];
            (models[a] == AxisModel::Extended && j.agreement.loses()) || j.worse_than_a_constant || j.contradicted
        });
        let predicted = [0, 1, 2].map(|a: usize| {
            let fitted = if models[a] == AxisModel::Extended { self.extended } else { self.beside };
            fitted.predicted_variance(verify.run, scaling, a, &unit)
        });
        for a in verify.run.steps.present().filter(|a| models[*a] != AxisModel::Constant) {
            state_left(&mut image.axes[a].uncertainty, &chosen[a], &verify.noise[a], predicted[a]);
        }
        self.state_unvisited(&mut image, scaling, models);
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
            runs.iter().map(|r| [image, plain].map(|c| fit::correct(c, &r.run.steps))).collect();
        let [left, base] = &corrected[runs.len() - 1];
        let [whole_left, whole_base] = [image, plain].map(|c| fit::correct(c, &judge.whole.steps));
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

/// Adds to the stated uncertainty what the verify run shows the model to leave beyond the noise, and how far the constant moves from day to
/// day. `predicted`: what the coefficients are uncertain by, about the mean and of the mean, which is stated already.
fn state_left(uncertainty: &mut Uncertainty, left: &Means, noise: &Noise, predicted: (f64, f64)) {
    if uncertainty.rest_dph2 > 0.0 {
        let shift_dph2 = left.mean().powi(2) - noise.shift().powi(2) - predicted.1;
        let more = misfit_dph2(left, noise, predicted.0) + day_dph2(shift_dph2, noise.floor());
        uncertainty.rest_dph2 += more as f32;
    }
}

/// Variance that a model leaves on a run beyond the noise and beyond what its coefficients are known to be uncertain by, (deg/h)^2: its mean
/// over none and values from a fifth of a floor to 36 floors. Before the run is seen there is one or none at even odds, and each power of
/// two is as probable as another.
fn misfit_dph2(left: &Means, noise: &Noise, known_dph2: f64) -> f64 {
    let floor = noise.floor();
    let ratio = noise.ratio(left.deviation(), 0.0);
    let squared = |r: f64| (left.deviation() / r).powi(2);
    let floor_std = (squared(ratio.low) - squared(ratio.high)) / (2.0 * 1.96);
    let excess = left.deviation().powi(2) - floor * floor - known_dph2;
    const VALUES: i32 = 16;
    let values = (0..VALUES).map(|k| (floor * floor * 0.04 * 2f64.powi(k), 1.0 / f64::from(VALUES)));
    let (mut sum, mut mean) = (0.0, 0.0);
    for (m, prior) in std::iter::once((0.0, 1.0)).chain(values) {
        // A misfit is known by its few slow swings in a run: to a third.
        let std = (floor_std * floor_std + (m / 3.0).powi(2)).sqrt();
        let density = prior * (-0.5 * ((excess - m) / std).powi(2)).exp() / std;
        sum += density;
        mean += density * m;
    }
    if sum > 0.0 {
        mean / sum
    } else {
        excess.max(0.0)
    }
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
    use super::day_dph2;
    use rand_chacha::rand_core::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

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
