//! Thermal lag from a chamber step (zhao2022): how a resonator follows its surroundings.
//!
//! `T_res = T_0 + K lag(T_in - T_in0, tau)`, the first-order lag `K / (tau s + 1)`, with the recorded chamber (or case) temperature as
//! input, so that a chamber which needs minutes for its step does no harm. `tau` is searched, `K`, `T_0` and the state at the start are
//! linear. A second lag in series is given as well, if it explains clearly more.
//!
//! With it, the resonator's temperature can be predicted where no frequency is at hand.
//!
//! If the curve of frequency over temperature is not known either, the gyro's own output answers the step ([`Output::Rate`], as in
//! zhao2022): its bias follows the resonator. The result is a little off if the bias depends on dT/dt as well. A bias that bends over the step
//! looks like another time constant, so a square of the lagged temperature is tried beside it ([`Bend`]).
//!
//! The time constant's deviation is that of its likelihood with correlated residuals: the noise models of
//! [`crate::trace::noise`], each weighted by how well it fits. White residuals would promise several times too much.

use crate::trace::noise::{Basis, Filters, NOISE_MODELS};
use hrg_core::AXES;
use hrg_data::error::BadInput;
use hrg_data::numeric::lsq;
use hrg_data::numeric::stats::{dot, log_sum};
use hrg_data::recording::columns;
use hrg_data::recording::steps::Run;
use serde::Serialize;

/// Temperature that drives the lag.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Input {
    /// The chamber's sensor.
    Chamber,
    /// The sensor on the gyro's case.
    Case,
}

/// Output that answers the step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Output {
    /// The resonator's temperature, by its frequency.
    Frequency,
    /// The rate.
    Rate,
}

impl Output {
    /// The unit of the answer.
    #[must_use]
    pub const fn unit(self) -> &'static str {
        match self {
            Self::Frequency => "C",
            Self::Rate => "deg/h",
        }
    }
}

/// A first-order lag, or two in series.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Lag {
    /// Gain `K`, C (or deg/h) per C.
    pub gain: f64,
    /// Its standard deviation, for correlated residuals where there is one time constant, for white ones where there are two.
    pub gain_std: f64,
    /// Time constants, s: one or two.
    pub tau_s: Vec<f64>,
    /// Standard deviation of the time constant, s, for correlated residuals; NaN where there are two.
    pub tau_std_s: f64,
    /// Resonator temperature (or rate) where the input is zero.
    pub offset_c: f64,
    /// RMS of what the lag leaves, C (or deg/h).
    pub residual_c: f64,
}

/// The second explanation of an answer: the output bends over the step, with the square of the lagged input. Its gain is taken to change by as much as
/// itself, one standard deviation, before the data are seen.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Bend {
    /// Time constant beside it, s.
    pub tau_s: f64,
    /// Its standard deviation, s.
    pub tau_std_s: f64,
    /// Log of the odds for it against the lag alone.
    pub log_odds: f64,
    /// Change of the gain from the coldest to the warmest of the step, deg/h per C.
    pub change_of_gain: f64,
}

/// The response of one axis.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Response {
    /// Temperature that drove it.
    pub input: Input,
    /// Output that answered.
    pub output: Output,
    /// The first-order lag (zhao2022's model).
    pub first_order: Lag,
    /// Two lags in series, where they leave less than half of the residual.
    pub second_order: Option<Lag>,
    /// The lag with a bend beside it, where the rate answers.
    pub bend: Option<Bend>,
}

/// A step of the input must span this, C, for its answer to be read.
const SMALLEST_STEP_C: f64 = 3.0;
/// Time constants are sought between these, s.
const SHORTEST_S: f64 = 10.0;
const LONGEST_S: f64 = 20_000.0;
/// The rate answers a step where its gain, and the time constant, are so many standard deviations.
const LEAST_ANSWER: f64 = 3.0;
/// Means that the likelihood is made of, s.
const MEAN_S: usize = 20;

impl Response {
    /// The lag of the resonator's temperature. The rate tells its time constant alone: in equilibrium the resonator is then taken to
    /// be as warm as what drives it, as zhao2022 does.
    #[must_use]
    pub fn of_temperature(&self) -> Lag {
        let lag = self.second_order.as_ref().unwrap_or(&self.first_order).clone();
        let (tau, std) = self.time_constant();
        match self.output {
            Output::Frequency => lag,
            Output::Rate => Lag {
                gain: 1.0,
                gain_std: f64::NAN,
                tau_s: vec![tau],
                tau_std_s: std,
                offset_c: 0.0,
                residual_c: f64::NAN,
            },
        }
    }

    /// The time constant and its standard deviation over both explanations, each with its odds, s.
    #[must_use]
    pub fn time_constant(&self) -> (f64, f64) {
        let alone = (self.first_order.tau_s[0], self.first_order.tau_std_s);
        let Some(b) = &self.bend else { return alone };
        let share = 1.0 / (1.0 + (-b.log_odds).exp());
        let mean = alone.0 + share * (b.tau_s - alone.0);
        let about = |tau: f64, std: f64| std * std + (tau - mean).powi(2);
        (mean, ((1.0 - share) * about(alone.0, alone.1) + share * about(b.tau_s, b.tau_std_s)).sqrt())
    }
}

impl Lag {
    /// Resonator temperatures for an input, beginning in equilibrium (or with `start_c`, where it is known).
    #[must_use]
    pub fn predict(&self, input_c: &[f64], start_c: Option<f64>) -> Vec<f64> {
        let mut y = input_c.to_vec();
        for (n, tau) in self.tau_s.iter().enumerate() {
            // A known start is the state of the last lag.
            let known = start_c.filter(|_| n + 1 == self.tau_s.len()).map(|s| (s - self.offset_c) / self.gain);
            y = lagged(&y, *tau, known);
        }
        y.iter().map(|x| self.offset_c + self.gain * x).collect()
    }
}

/// Share of the way that a first-order lag goes in a model step.
pub(crate) fn share(tau: f64) -> f64 {
    if tau > 0.0 {
        1.0 - (-f64::from(hrg_core::MODEL_STEP_S) / tau).exp()
    } else {
        1.0
    }
}

/// First-order lag of a series of seconds; starts at `start`, else in equilibrium with the first value. A missing value
/// holds the one before.
fn lagged(input: &[f64], tau: f64, start: Option<f64>) -> Vec<f64> {
    let share = share(tau);
    let first = input.iter().copied().find(|x| x.is_finite()).unwrap_or(f64::NAN);
    let (mut held, mut y) = (first, start.unwrap_or(first));
    input
        .iter()
        .map(|x| {
            if x.is_finite() {
                held = *x;
            }
            y += share * (held - y);
            y
        })
        .collect()
}

/// The lagged input, and how the state that is not known at the start dies out.
fn regressors(input: &[f64], taus: &[f64]) -> [Vec<f64>; 2] {
    let mut y = input.to_vec();
    for tau in taus {
        y = lagged(&y, *tau, None);
    }
    let longest = taus.iter().copied().fold(0.0, f64::max);
    let fading = (0..y.len()).map(|k| (-(k as f64) * f64::from(hrg_core::MODEL_STEP_S) / longest).exp()).collect();
    [y, fading]
}

fn with_taus(input: &[f64], output: &[f64], taus: &[f64]) -> Result<(Lag, f64), BadInput> {
    let [lagged, fading] = regressors(input, taus);
    let ones = vec![1.0; lagged.len()];
    let fit = lsq::fit(&[ones, lagged, fading], output, None, &["offset", "lagged input", "state at the start"])?;
    let lag = Lag {
        gain: fit.coefficients[1],
        gain_std: fit.std[1],
        tau_s: taus.to_vec(),
        tau_std_s: f64::NAN,
        offset_c: fit.coefficients[0],
        residual_c: (fit.squares / fit.rows as f64).sqrt(),
    };
    Ok((lag, fit.squares))
}

/// Sum of squares that a lag of some time constants leaves: as [`with_taus`], without its extras, for the search.
fn cost(input: &[f64], output: &[f64], taus: &[f64]) -> f64 {
    let [mut x, mut e] = regressors(input, taus);
    let mut y = output.to_vec();
    let used: Vec<bool> = (0..y.len()).map(|k| x[k].is_finite() && y[k].is_finite()).collect();
    let dot = |a: &[f64], b: &[f64]| -> f64 {
        a.iter().zip(b).zip(&used).filter(|(_, u)| **u).map(|((a, b), _)| a * b).sum()
    };
    let n = used.iter().filter(|u| **u).count() as f64;
    for v in [&mut x, &mut e, &mut y] {
        let mean = v.iter().zip(&used).filter(|(_, u)| **u).map(|(v, _)| *v).sum::<f64>() / n;
        v.iter_mut().for_each(|v| *v -= mean);
    }
    // One after the other is made orthogonal to those before.
    let strip = |from: &mut Vec<f64>, what: &[f64]| {
        let share = dot(from, what) / dot(what, what).max(1e-300);
        from.iter_mut().zip(what).for_each(|(f, w)| *f -= share * w);
    };
    strip(&mut x, &e);
    strip(&mut y, &e);
    strip(&mut y, &x);
    let left = dot(&y, &y);
    if left.is_finite() {
        left
    } else {
        f64::INFINITY
    }
}

/// Logarithms of time constants, evenly spaced.
fn grid(parts: u32) -> impl Iterator<Item = f64> {
    (0..=parts).map(move |k| SHORTEST_S.ln() + (LONGEST_S / SHORTEST_S).ln() * f64::from(k) / f64::from(parts))
}

/// Golden-section search of the logarithm of a time constant.
fn search(mut cost: impl FnMut(f64) -> f64) -> f64 {
    // A coarse grid first: the cost need not have one valley only.
    let grid: Vec<f64> = grid(24).collect();
    let costs: Vec<f64> = grid.iter().map(|l| cost(l.exp())).collect();
    let at = (0..grid.len()).min_by(|a, b| costs[*a].total_cmp(&costs[*b])).unwrap_or(0);
    let (mut low, mut high) = (grid[at.saturating_sub(1)], grid[(at + 1).min(grid.len() - 1)]);
    let ratio = 0.5 * (5f64.sqrt() - 1.0);
    for _ in 0..20 {
        let (a, b) = (high - ratio * (high - low), low + ratio * (high - low));
        if cost(a.exp()) < cost(b.exp()) {
            high = b;
        } else {
            low = a;
        }
    }
    (0.5 * (low + high)).exp()
}

/// The input of a run; `None` where it was not recorded.
#[must_use]
pub fn input_of(run: &Run, a: usize, input: Input) -> Option<Vec<f64>> {
    let column = match input {
        Input::Chamber => &run.steps.chamber_c,
        Input::Case => &run.steps.case_c[a],
    };
    (column.iter().filter(|x| x.is_finite()).count() * 2 > run.steps.len())
        .then(|| column.iter().map(|x| f64::from(*x)).collect())
}

/// Temperatures of a resonator over a run, C; NaN while its frequency is lost.
#[must_use]
pub fn resonator(run: &Run, a: usize) -> Vec<f64> {
    (0..run.steps.len()).map(|k| run.state(k, a).map_or(f64::NAN, |(t, _)| f64::from(t))).collect()
}

/// Steps of rest before the step of temperature that take part: what came before it (self-heating after power-on) is
/// none of the lag.
const REST: usize = 600;

/// Begin of the steepest ten minutes of an input, less the rest before them.
fn step_at(input: &[f64]) -> usize {
    let change = |k: usize| {
        let d = (input[k + REST] - input[k]).abs();
        if d.is_finite() {
            d
        } else {
            0.0
        }
    };
    let steepest = (0..input.len().saturating_sub(REST)).max_by(|a, b| change(*a).total_cmp(&change(*b))).unwrap_or(0);
    steepest.saturating_sub(REST)
}

/// Likelihood of a time constant: for each, the coefficients of the columns are those of generalised least squares under every noise
/// model, and the likelihood is the mean over these.
struct Profile<'a> {
    input: &'a [f64],
    answer: Vec<f64>,
    used: Vec<usize>,
    filters: Filters,
    whitened: [Vec<f64>; NOISE_MODELS.len()],
    /// Standard deviation of a bend before the data are seen, deg/h per C^2: the gain may change by itself from one end of the step to the other.
    bend_std: f64,
}

/// Likelihoods of one time constant.
#[derive(Debug, Clone, Copy)]
struct At {
    tau_s: f64,
    /// Log likelihood of the lag alone, and with a bend beside it.
    log: [f64; 2],
    gain_std: f64,
    /// The bend, deg/h per C^2.
    bend: f64,
}

/// A time constant by its likelihood.
#[derive(Debug, Clone, Copy)]
struct Likely {
    top: At,
    mean_s: f64,
    std_s: f64,
    /// Log of the mean likelihood over the logarithm of the time constant.
    evidence: f64,
}

fn means(x: &[f64]) -> Vec<f64> {
    x.chunks_exact(MEAN_S).map(|c| c.iter().sum::<f64>() / MEAN_S as f64).collect()
}

impl<'a> Profile<'a> {
    fn new(input: &'a [f64], answer: &[f64]) -> Self {
        let all = means(answer);
        let used: Vec<usize> = (0..all.len()).filter(|k| all[*k].is_finite()).collect();
        let answer: Vec<f64> = used.iter().map(|k| all[*k]).collect();
        let filters = Filters::new(&vec![1.0; answer.len()], &[0]);
        let whitened = filters.whiten_by_all(&answer);
        Self { input, answer, used, filters, whitened, bend_std: f64::INFINITY }
    }

    /// Columns of a time constant: offset, state at the start, lagged input, and its square about the middle.
    fn columns(&self, tau: f64) -> [Vec<f64>; 4] {
        let [lagged, fading] = regressors(self.input, &[tau]);
        let (low, high) = span(&lagged);
        let square = lagged.iter().map(|x| (x - 0.5 * (low + high)).powi(2)).collect();
        let used = |c: Vec<f64>| -> Vec<f64> {
            let c = means(&c);
            self.used.iter().map(|k| c[*k]).collect()
        };
        [vec![1.0; lagged.len()], fading, lagged, square].map(used)
    }

    fn at(&self, tau_s: f64) -> At {
        let columns = self.columns(tau_s).map(|c| self.filters.whiten_by_all(&c));
        let (n, free) = (self.answer.len() as f64, self.answer.len() as f64 - 3.0);
        let under = |s: usize| {
            let mut basis = Basis::default();
            let length = columns[..3].iter().map(|c| basis.add_measured(c[s].clone())).last().unwrap_or(0.0);
            let (mut rest, mut bend) = (self.whitened[s].clone(), columns[3][s].clone());
            basis.reduce(&mut rest);
            basis.reduce(&mut bend);
            let squares = dot(&rest, &rest).max(1e-300);
            let before = NOISE_MODELS[s].log_prior() + self.filters.log_determinant(s);
            let variance = squares / free.max(1.0);
            let (known, product) = (variance / self.bend_std.powi(2), dot(&bend, &rest));
            let all = (dot(&bend, &bend) + known).max(1e-300);
            let bent =
                before - 0.5 * n * (squares - product * product / all).max(1e-300).ln() + 0.5 * (known / all).ln();
            ([before - 0.5 * n * squares.ln(), bent], variance / length.max(1e-300), product / all)
        };
        let each: Vec<_> = (0..NOISE_MODELS.len()).map(under).collect();
        let log = [0, 1].map(|k: usize| log_sum(&each.iter().map(|e| e.0[k]).collect::<Vec<_>>()));
        let share = |k: usize, s: usize| (each[s].0[k] - log[k]).exp();
        let variance = (0..each.len()).map(|s| share(0, s) * each[s].1).sum::<f64>();
        let bend = (0..each.len()).map(|s| share(1, s) * each[s].2).sum();
        At { tau_s, log, gain_std: variance.sqrt(), bend }
    }

    /// The most likely time constant of the lag alone (0) or with a bend (1), with mean and deviation of the likelihood as a density over the
    /// time constant's logarithm.
    fn likely(&self, kind: usize) -> Likely {
        let log = |t: f64| self.at(t).log[kind];
        let top = self.at(search(|t| -log(t)));
        const STEP: f64 = 0.02;
        let drop = top.log[kind] - 0.5 * (log(top.tau_s * STEP.exp()) + log(top.tau_s * (-STEP).exp()));
        let sigma = (0.5 * STEP * STEP / drop.max(1e-6)).sqrt().min(1.0);
        // Fine about the top, and coarse over all.
        let fine = (-16..=16).map(|k| top.tau_s.ln() + 0.25 * sigma * f64::from(k));
        let mut points: Vec<f64> =
            grid(48).chain(fine).filter(|l| *l >= SHORTEST_S.ln() && *l <= LONGEST_S.ln()).collect();
        points.sort_by(f64::total_cmp);
        let density: Vec<f64> = points.iter().map(|l| (log(l.exp()) - top.log[kind]).exp()).collect();
        // By trapezoids: the integral of a function of the time constant.
        let integral = |of: &dyn Fn(f64) -> f64| {
            let value = |k: usize| density[k] * of(points[k].exp());
            (1..points.len()).map(|k| 0.5 * (points[k] - points[k - 1]) * (value(k) + value(k - 1))).sum::<f64>()
        };
        let whole = integral(&|_| 1.0);
        let mean_s = integral(&|t| t) / whole;
        let std_s = (integral(&|t| (t - mean_s).powi(2)) / whole).sqrt();
        Likely { top, mean_s, std_s, evidence: top.log[kind] + (whole / (LONGEST_S / SHORTEST_S).ln()).ln() }
    }
}

/// Lowest and highest value.
fn span(x: &[f64]) -> (f64, f64) {
    x.iter().filter(|x| x.is_finite()).fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(*x), h.max(*x)))
}

/// First-order lag of an axis behind its input, with the series that it was found from.
pub struct Followed {
    /// The lag.
    pub lag: Lag,
    input: Vec<f64>,
    answer: Vec<f64>,
    likely: Likely,
    squares: f64,
}

impl Followed {
    /// The second explanation: the output bends over the step.
    fn bend(&self) -> Bend {
        let (low, high) = span(&self.input);
        let bend_std = self.lag.gain.abs() / (2.0 * (high - low));
        let likely = Profile { bend_std, ..Profile::new(&self.input, &self.answer) }.likely(1);
        Bend {
            tau_s: likely.mean_s,
            tau_std_s: likely.std_s,
            log_odds: likely.evidence - self.likely.evidence,
            change_of_gain: 2.0 * likely.top.bend * (high - low),
        }
    }
}

/// Identifies the first-order lag of one axis from a run that holds a step of the temperature that drives it: from ten minutes before the
/// steepest ten minutes of the input to the end. Let the unit warm up before the step.
///
/// # Errors
/// One sentence: no sensor, no step, no rest before it, too short a hold after it.
pub fn first_order(run: &Run, a: usize, input: Input, output: Output) -> Result<Followed, BadInput> {
    let name = if input == Input::Chamber { columns::CHAMBER } else { columns::CASE }.name(a);
    let u = input_of(run, a, input).ok_or_else(|| {
        BadInput::new(format!("column {name} is missing or mostly empty; a step response needs what drove it"))
    })?;
    let (low, high) = span(&u);
    if !(high - low > SMALLEST_STEP_C) {
        return Err(BadInput::new(format!(
            "column {name} spans {:.1} C; a step response needs a step of some degrees, 10 C for instance, and a hold of at least three time constants (an hour)",
            high - low
        )));
    }
    let from = step_at(&u);
    let answer = match output {
        Output::Frequency => resonator(run, a),
        Output::Rate => run.steps.rate_dph[a].clone(),
    };
    let (input, answer) = (u[from..].to_vec(), answer[from..].to_vec());
    let likely = Profile::new(&input, &answer).likely(0);
    let tau = likely.top.tau_s;
    let (lag, squares) = with_taus(&input, &answer, &[tau])?;
    let lag = Lag { gain_std: likely.top.gain_std, tau_std_s: likely.std_s, ..lag };
    let answers = lag.gain.abs() > LEAST_ANSWER * lag.gain_std && tau > LEAST_ANSWER * lag.tau_std_s;
    if output == Output::Rate && !answers {
        return Err(BadInput::new(format!(
            "axis {}: the rate does not answer the step ({:.4} +- {:.4} deg/h per C, {tau:.0} +- {:.0} s): its bias does not change enough there for its noise; step elsewhere, or further",
            hrg_data::axes::AXIS_NAMES[a],
            lag.gain,
            lag.gain_std,
            lag.tau_std_s
        )));
    }
    let held = input.len() as f64 * f64::from(hrg_core::MODEL_STEP_S);
    if tau > 0.5 * held || tau > 0.9 * LONGEST_S {
        return Err(BadInput::new(format!(
            "axis {}: the time constant of {tau:.0} s does not show within a run of {held:.0} s; hold the temperature after the step for at least three time constants",
            hrg_data::axes::AXIS_NAMES[a]
        )));
    }
    Ok(Followed { lag, input, answer, likely, squares })
}

/// Identifies the lag of each axis: [`first_order`], and two lags in series where the temperature answers.
///
/// # Errors
/// As [`first_order`].
pub fn identify(run: &Run, input: Input, output: Output) -> Result<[Response; AXES], BadInput> {
    if run.steps.absent.contains(&true) {
        return Err(BadInput::new("the lags of the three axes are wanted, and the recording does not have three"));
    }
    let mut out = Vec::new();
    for a in 0..AXES {
        let found = first_order(run, a, input, output)?;
        let second_order = match output {
            Output::Frequency => second_order(&found)?,
            // Its noise hides a second lag.
            Output::Rate => None,
        };
        let bend = (output == Output::Rate).then(|| found.bend());
        out.push(Response { input, output, first_order: found.lag, second_order, bend });
    }
    out.try_into().map_err(|_| BadInput::new("three axes were expected"))
}

/// Two lags in series, the longer one found again for each shorter one; `None` where they leave more than half of the residual of one.
fn second_order(found: &Followed) -> Result<Option<Lag>, BadInput> {
    let cost = |taus: &[f64]| cost(&found.input, &found.answer, taus);
    let short = search(|s| {
        let long = search(|l| cost(&[l, s]));
        cost(&[long, s])
    });
    let long = search(|l| cost(&[l, short]));
    let (second, squares) = with_taus(&found.input, &found.answer, &[long.max(short), long.min(short)])?;
    Ok((squares < 0.25 * found.squares).then_some(second))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::prepare;
    use hrg_simulate::{Plan, Profile};

    fn run(profile: &str) -> Run {
        let r = Plan::of(Profile::parse(profile).expect("named"), 3, 4).simulate().recording;
        prepare(&[r]).expect("prepares").runs.remove(0)
    }

    #[test]
    fn the_time_constants_put_in_come_out() {
        // The curves of this run are found from a cycle, whose temperatures span enough.
        let cycle = Plan::of(Profile::parse("cycle").expect("named"), 3, 4).simulate().recording;
        let curves = prepare(&[cycle]).expect("prepares").calibration.axes.map(|a| a.curve);
        let step = Plan::of(Profile::parse("lag").expect("named"), 3, 5).simulate().recording;
        let run = Run::new(hrg_data::recording::steps::Steps::new(&step).expect("long enough"), curves);
        let case = identify(&run, Input::Case, Output::Frequency).expect("a step");
        for (r, tau) in case.iter().zip([694.0, 655.0, 741.0]) {
            // Self-heating, which builds up in the first hour, is not part of the model.
            assert!((r.first_order.tau_s[0] / tau - 1.0).abs() < 0.1, "{:?} for {tau}", r.first_order);
            assert!((r.first_order.gain - 1.0).abs() < 0.05, "{:?}", r.first_order);
        }
        // Behind the chamber stand two lags in series.
        let chamber = identify(&run, Input::Chamber, Output::Frequency).expect("a step");
        for (r, [long, short]) in chamber.iter().zip([[694.0, 420.0], [655.0, 380.0], [741.0, 450.0]]) {
            let second = r.second_order.as_ref().expect("two lags");
            let sum = second.tau_s[0] + second.tau_s[1];
            assert!((sum / (long + short) - 1.0).abs() < 0.1, "{second:?}");
        }
    }

    /// zhao2022's experiment 1: the time constant from the gyro's output, with no frequency at all.
    #[test]
    fn the_output_answers_the_step_as_the_resonator_does() {
        use hrg_data::recording::steps::Steps;
        use hrg_simulate::Kind;
        let curves = hrg_core::calibration::Calibration::uncalibrated().axes.map(|a| a.curve);
        let plan = Plan::of(Profile::parse("lag").expect("named"), 4, 6);
        let simulated = Plan { noise: Kind::Zhao.noise(), ..plan }.simulate();
        let mut steps = Steps::new(&simulated.recording).expect("long enough");
        // A bias that is linear in the resonator's temperature, as zhao2022 takes it to be over its step; and no frequency.
        let run = Run::new(steps.clone(), curves);
        for a in 0..AXES {
            let both = resonator(&run, a).into_iter().zip(&simulated.noise_dph[a]);
            steps.rate_dph[a] = both.map(|(t, noise)| -2.0 - 0.4 * t + noise).collect();
            steps.frequency_hz[a].fill(f64::NAN);
        }
        let found = identify(&Run::new(steps, curves), Input::Case, Output::Rate).expect("a step");
        for (r, tau) in found.iter().zip([694.0, 655.0, 741.0]) {
            assert!((r.first_order.tau_s[0] / tau - 1.0).abs() < 0.1, "{:?} for {tau}", r.first_order);
            assert_eq!(r.of_temperature().gain, 1.0);
        }
        // A unit whose bias is flat there.
        let simulated = Plan { noise: Kind::Zhao.noise(), ..Plan::of(Profile::parse("lag").expect("named"), 4, 6) };
        let simulated = simulated.simulate();
        let mut flat = Steps::new(&simulated.recording).expect("long enough");
        flat.rate_dph = simulated.noise_dph.clone();
        let e = identify(&Run::new(flat, curves), Input::Case, Output::Rate).expect_err("refused").0;
        assert!(e.contains("does not answer"), "{e}");
    }

    /// The same on simulated units of its kind, whose bias bends over the step by whatever it does: the time constant is within its deviation.
    #[test]
    fn experiment_1_of_zhao2022_on_units_of_its_kind() {
        use hrg_data::recording::steps::Steps;
        use hrg_simulate::Kind;
        let curves = hrg_core::calibration::Calibration::uncalibrated().axes.map(|a| a.curve);
        let (mut squares, mut bent) = (Vec::new(), 0);
        for unit in 1..=7 {
            let kind = Kind::Zhao;
            let plan = Plan { kind, noise: kind.noise(), ..Plan::of(Profile::parse("lag").expect("named"), unit, 6) };
            let steps = Steps::new(&plan.simulate().recording).expect("long enough");
            let found = identify(&Run::new(steps, curves), Input::Case, Output::Rate).expect("answers");
            for (r, truth) in found.iter().zip([694.0, 655.0, 741.0]) {
                let (tau, std) = r.time_constant();
                squares.push(((tau - truth) / std).powi(2));
                bent += usize::from(r.bend.as_ref().is_some_and(|b| b.log_odds > 1.0));
                assert!(std < 0.6 * truth, "{r:?}");
            }
        }
        // (An assumed lag alone is up to four of its deviations off.)
        let mean = squares.iter().sum::<f64>() / squares.len() as f64;
        assert!(mean < 1.0 && squares.iter().all(|s| *s < 4.0), "{squares:?}");
        assert!(bent > 0);
    }

    #[test]
    fn a_lost_frequency_is_predicted() {
        let run = run("fast");
        let r = &identify(&run, Input::Case, Output::Frequency).expect("ramps do as well")[0];
        let u = input_of(&run, 0, Input::Case).expect("recorded");
        let truth = resonator(&run, 0);
        let at = 1200;
        let predicted = r.first_order.predict(&u[at..], Some(truth[at]));
        let worst = predicted.iter().zip(&truth[at..]).map(|(p, t)| (p - t).abs()).fold(0.0, f64::max);
        assert!(worst < 1.0, "{worst} C while the temperature went through tens of degrees");
    }

    #[test]
    fn no_step_is_reported() {
        let mut flat = run("fast");
        flat.steps.chamber_c.fill(20.0);
        assert!(identify(&flat, Input::Chamber, Output::Frequency).expect_err("refused").0.contains("needs a step"));
        flat.steps.chamber_c.clear();
        assert!(identify(&flat, Input::Chamber, Output::Frequency)
            .expect_err("refused")
            .0
            .contains("chamber_c is missing"));
    }
}
