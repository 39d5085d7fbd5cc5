//! wu2023's four parameters and their breakpoint.

use super::form::{range, Data, Form};
use super::method::{Method, Model, Objective, Search};
use super::search::smallest_range;
use super::{swarm, MEAN_S};
use crate::numeric::stats::{quantile, std_dev};
use crate::recording::steps::Run;
use crate::BadInput;
use hrg_core::bias::four_parameter::{self, FourParameter};
use hrg_core::bias::Scaling;

/// Breakpoints that are tried lie this far apart, C.
const BREAKPOINT_STEP_C: f64 = 1.0;

/// wu2023's model: everything is judged on 100 s means, as there.
pub(super) fn four_parameters(
    runs: &[Run],
    scaling: &Scaling,
    a: usize,
    method: Method,
    seed: u64,
    note: &mut dyn FnMut(String),
) -> Result<FourParameter, BadInput> {
    let mut temperatures: Vec<f64> = Vec::new();
    for run in runs {
        temperatures
            .extend((0..run.steps.len()).filter_map(|k| run.bias_state(k, a)).map(|s| f64::from(s.temperature_c)));
    }
    // A tenth of the range on either side is left to each branch.
    let (low, high) = (quantile(&temperatures, 0.0), quantile(&temperatures, 1.0));
    let margin = 0.1 * (high - low);
    let count = ((high - low - 2.0 * margin) / BREAKPOINT_STEP_C).floor() as usize;
    let breakpoints: Vec<f32> = (0..=count).map(|k| (low + margin + k as f64 * BREAKPOINT_STEP_C) as f32).collect();
    let literal = method.parts().model == Model::FourParametersLiteral;
    let form = |b: f32| Form::Four { breakpoint_c: b, origin_c: if literal { 0.0 } else { b } };
    let tables: Vec<Data> = breakpoints.iter().map(|b| Data::new(runs, scaling, a, form(*b)).means(MEAN_S)).collect();
    let by_range = method.parts().objective == Objective::Range;
    let (exact, mut at, mut k) = exact_solution(&tables, by_range)?.ok_or_else(|| {
        BadInput::new("the temperatures span too little for a breakpoint; record a run over tens of degrees")
    })?;
    let what = if by_range { "range" } else { "standard deviation" };
    if method.parts().search == Search::Swarm {
        (at, k) = four_parameter_swarm(&tables, by_range, seed)?;
        let e = tables[at].residuals(&k);
        let reached = if by_range { range(&e) } else { std_dev(&e) };
        note(format!(
            "{what} of 100 s means {reached:.5} deg/h, {:.3} % above the exact solution",
            100.0 * (reached / exact - 1.0).max(0.0)
        ));
    } else {
        note(format!("{what} of 100 s means {exact:.5} deg/h, the least there is"));
    }
    let b = breakpoints[at];
    if literal {
        note(format!("the bias jumps by {:.4} deg/h at {b:.0} C", (k[4] - k[3]) * f64::from(b)));
    }
    note(format!("breakpoint {b:.0} C"));
    Ok(FourParameter {
        constant_cooling_heating_low_high: std::array::from_fn(|j| k[j] as f32),
        breakpoint_c: b,
        origin_c: if literal { 0.0 } else { b },
    })
}

/// The exact solutions, breakpoint by breakpoint: the best one's value, number and coefficients.
fn exact_solution(tables: &[Data], by_range: bool) -> Result<Option<(f64, usize, Vec<f64>)>, BadInput> {
    let mut best: Option<(f64, usize, Vec<f64>)> = None;
    for (n, d) in tables.iter().enumerate() {
        let (value, k) = if by_range {
            let (k, value) = smallest_range(d)?;
            (value, k)
        } else {
            let k = d.fit(None)?.coefficients;
            (std_dev(&d.residuals(&k)), k)
        };
        if best.as_ref().is_none_or(|b| value < b.0) {
            best = Some((value, n, k));
        }
    }
    Ok(best)
}

/// wu2023's swarm: four coefficients and the breakpoint. Its search ranges are in units of its gyro's output; here each
/// coefficient may move the bias by three ranges of the rate over the run. Its speed limit of 10 is a tenth of the range
/// of its temperature coefficients and an eightieth of that of its coefficients of change; a tenth is taken for all:
/// with an eightieth the swarm settles on a breakpoint before the coefficients have arrived.
fn four_parameter_swarm(tables: &[Data], by_range: bool, seed: u64) -> Result<(usize, Vec<f64>), BadInput> {
    let y = &tables[0].y;
    let width = 3.0 * range(y).max(1e-12);
    let scale: Vec<f64> = (1..four_parameter::TERMS)
        .map(|j| {
            let most = tables.iter().map(|d| range(&d.columns[j])).fold(0.0, f64::max);
            width / most.max(1e-12)
        })
        .collect();
    let mut limits: Vec<([f64; 2], f64)> = vec![([-1.0, 1.0], 0.1); 4];
    limits.push(([0.0, tables.len() as f64 - 1e-9], 0.1 * tables.len() as f64));
    let mut work = vec![0.0; y.len()];
    let found = swarm::minimise(&swarm::WU, &limits, seed, |z| {
        let d = &tables[z[4] as usize];
        let (mut sum, mut low, mut high) = (0.0, f64::INFINITY, f64::NEG_INFINITY);
        for (i, w) in work.iter_mut().enumerate() {
            let mut e = d.y[i];
            for j in 0..4 {
                e -= z[j] * scale[j] * d.columns[j + 1][i];
            }
            *w = e;
            sum += e;
            low = low.min(e);
            high = high.max(e);
        }
        if by_range {
            return high - low;
        }
        let mean = sum / work.len() as f64;
        work.iter().map(|e| (e - mean) * (e - mean)).sum::<f64>()
    });
    let at = found.position[4] as usize;
    let rest: Vec<f64> = found.position[..4].iter().zip(&scale).map(|(z, s)| z * s).collect();
    Ok((at, tables[at].with_constant(&rest)))
}
