//! Proposals by the data themselves: times at which the rates jump, and periods at which their spectrum has a peak. They are searched for
//! in the residual of a model.

use super::data::{AxisRows, Candidate, Data};
use super::noise::Basis;
use hrg_core::effects::parameters::{Moment, Parameters, Period, Pulse, Thresholds};
use hrg_core::effects::EffectId;
use hrg_core::AXES;
use hrg_data::numeric::stats::dot;
use std::ops::Range;

/// As many jumps, and as many periods, are proposed from one view.
const EACH: usize = 6;
/// Time constants from which the recovery of a [shock](EffectId::Shock) is refined, s.
pub const RECOVERIES_S: [f32; 3] = [600.0, 2000.0, 6000.0];

/// The rates of an axis whitened by a noise model, free of the baseline and of a model.
pub struct Left<'b> {
    /// Number of the noise model.
    pub noise_model: usize,
    /// Square of a whitened step at each row, which lasts to the end of its run, free of the baseline ([`free_steps`]).
    pub steps: &'b [f64],
    /// The rates.
    pub y: Vec<f64>,
}

/// Periods at which the spectrum stands out, from one view of each axis.
pub fn periods(data: &Data<'_>, left: &[Left<'_>; AXES]) -> Vec<Candidate> {
    let block = data.block_s as f64;
    let total = f64::from(data.longest_s());
    let (f_low, f_high) = (4.0 / total, 1.0 / (2.5 * block));
    let n = ((f_high - f_low) * total * 1.5) as usize;
    if n < 3 {
        return Vec::new();
    }
    let frequency = |k: usize| f_low + (f_high - f_low) * k as f64 / n as f64;
    let mut power = vec![0.0; n];
    for (view, rows) in left.iter().zip(&data.axes).filter(|(v, _)| !v.y.is_empty()) {
        let variance = dot(&view.y, &view.y) / view.y.len().max(1) as f64;
        for from in (0..n).step_by(LINES) {
            let w = std::array::from_fn(|k| std::f64::consts::TAU * frequency(from + k) * block);
            for (p, square) in power[from..].iter_mut().zip(lines(&view.y, &rows.keep, w)) {
                *p += square / (view.y.len() as f64 * variance);
            }
        }
    }
    let mut peaks: Vec<usize> = (1..n - 1).filter(|&k| power[k] >= power[k - 1] && power[k] >= power[k + 1]).collect();
    peaks.sort_by(|x, y| power[*y].total_cmp(&power[*x]));
    peaks
        .into_iter()
        .take(EACH)
        .map(|k| Candidate::new(EffectId::Periodic, Period { period_s: (1.0 / frequency(k)) as f32 }.row()))
        .collect()
}

/// Lines of a spectrum that are summed side by side.
const LINES: usize = 8;

/// Squares of some lines of a spectrum: `w` is the phase of each from a block to the next.
fn lines(y: &[f64], blocks: &[usize], w: [f64; LINES]) -> [f64; LINES] {
    let (step_s, step_c) = (w.map(f64::sin), w.map(f64::cos));
    let (mut re, mut im) = ([0.0; LINES], [0.0; LINES]);
    let mut at = usize::MAX;
    let (mut s, mut c) = ([0.0; LINES], [1.0; LINES]);
    for (y, &b) in y.iter().zip(blocks) {
        let next = at != usize::MAX && b == at + 1;
        at = b;
        if !next {
            (s, c) = (w.map(|w| (w * b as f64).sin()), w.map(|w| (w * b as f64).cos()));
        }
        for k in 0..LINES {
            if next {
                (s[k], c[k]) = (s[k] * step_c[k] + c[k] * step_s[k], c[k] * step_c[k] - s[k] * step_s[k]);
            }
            re[k] += c[k] * y;
            im[k] += s[k] * y;
        }
    }
    std::array::from_fn(|k| re[k] * re[k] + im[k] * im[k])
}

/// A shock at the place of each step, with some times of recovery.
pub fn shocks(steps: &[Candidate]) -> Vec<Candidate> {
    let at = |step: &Candidate| {
        let (run, Moment { time_s }) = (step.run, Moment::of(&step.parameters));
        RECOVERIES_S.map(|tau_s| Candidate { run, ..Candidate::new(EffectId::Shock, Pulse { time_s, tau_s }.row()) })
    };
    steps.iter().flat_map(at).collect()
}

/// Relays that go on at the temperature of a jump while heating, and off at that of a jump while cooling.
pub fn relays(data: &Data<'_>, jumps: &[Candidate], left: &[Left<'_>; AXES]) -> Vec<Candidate> {
    let Some(a) = left.iter().position(|v| !v.y.is_empty()) else { return vec![] };
    let at = |jump: &Candidate| {
        let run = &data.runs[jump.run?];
        let time_s = Moment::of(&jump.parameters).time_s;
        run.state(run.thermal.partition_point(|t| t.time_s < time_s), a)
    };
    let states: Vec<(f32, f32)> = jumps.iter().filter_map(at).collect();
    let heating = states.iter().filter(|s| s.1 > 0.0);
    let cooling = || states.iter().filter(|s| s.1 < 0.0);
    let all = heating.flat_map(|on| cooling().map(move |off| Thresholds { on_c: on.0, off_c: off.0 }));
    all.filter(|t| data.switches_again(*t, a)).map(|t| Candidate::new(EffectId::Relay, t.row())).collect()
}

/// Times at which the rates seem to jump: every block boundary is tried as a step, and the best are kept. (A step that is placed
/// some blocks off explains almost nothing.)
pub fn jumps(data: &Data<'_>, left: &[Left<'_>; AXES]) -> Vec<Candidate> {
    let mut out: Vec<Candidate> = Vec::new();
    let mut first_block = 0;
    for (number, run) in data.runs.iter().enumerate() {
        let blocks = data.blocks[number];
        let margin = (blocks / 30).max(2);
        let mut score = vec![0.0; blocks];
        for (view, rows) in left.iter().zip(&data.axes).filter(|(v, _)| !v.y.is_empty()) {
            let variance = dot(&view.y, &view.y) / view.y.len().max(1) as f64;
            let run = rows.run(number);
            let from = run.start;
            for (k, s) in steps(view, rows, run).into_iter().enumerate() {
                let block = rows.keep[from + k] - first_block;
                if block < blocks {
                    score[block] += s / variance;
                }
            }
        }
        let mut best: Vec<usize> = (margin..blocks.saturating_sub(margin))
            .filter(|&k| score[k] >= score[k - 1] && score[k] >= score[k + 1])
            .collect();
        best.sort_by(|x, y| score[*y].total_cmp(&score[*x]));
        for k in best.into_iter().take(EACH) {
            let t = run.thermal[k * data.block_s].time_s;
            out.push(Candidate { run: Some(number), ..Candidate::new(EffectId::Step, Moment { time_s: t }.row()) });
        }
        first_block += blocks;
    }
    out
}

/// Squares of the rates that a step at each row of a run explains: for all places at once by the whitening run backwards.
fn steps(view: &Left<'_>, rows: &AxisRows, run: Range<usize>) -> Vec<f64> {
    let product = rows.filters.steps(view.noise_model, &view.y, run.start, run.end);
    let explained = |(product, square): (f64, &f64)| if *square > 0.0 { product * product / square } else { 0.0 };
    product.into_iter().zip(&view.steps[run]).map(explained).collect()
}

/// Square of a step at each row that lasts to the end of its run, whitened by a noise model, free of the baseline; 0 where the baseline spans it.
pub fn free_steps(rows: &AxisRows, noise_model: usize, baseline: &Basis) -> Vec<f64> {
    let of_run = |number: usize| {
        let Range { start: from, end: to } = rows.run(number);
        let cuts: Vec<Vec<f64>> =
            baseline.columns.iter().map(|q| rows.filters.steps(noise_model, q, from, to)).collect();
        (0..to - from).map(move |k| {
            let whole = rows.filters.square_of_step(noise_model, from + k, to);
            let left = whole - cuts.iter().map(|c| c[k] * c[k]).sum::<f64>();
            if left > 1e-3 * whole {
                left
            } else {
                0.0
            }
        })
    };
    (0..rows.starts.len()).flat_map(of_run).collect()
}
