//! wu2023's four parameters and their breakpoint.

use crate::form::{range, Data, Form};
use crate::method::Options;
use crate::method::{Method, Model, Objective, Search};
use crate::notes::Records;
use crate::search::{smallest_range, Searched};
use crate::swarm;
use hrg_core::bias::four_parameter::{self, FourParameter};
use hrg_core::bias::Scaling;
use hrg_data::error::BadInput;
use hrg_data::numeric::stats::{quantile, std_dev};
use hrg_data::recording::steps::Run;
use hrg_identify::fit::MEAN_S;

/// Breakpoints that are tried lie this far apart, C.
const BREAKPOINT_STEP_C: f64 = 1.0;

/// wu2023's model: everything is judged on 100 s means, as there.
pub(super) fn four_parameters(
    runs: &[Run],
    scaling: &Scaling,
    a: usize,
    method: Method,
    options: &Options,
    records: &mut Records<'_>,
) -> Result<FourParameter, BadInput> {
    let mut temperatures: Vec<f64> = Vec::new();
    for run in runs {
        temperatures
            .extend((0..run.steps.len()).filter_map(|k| run.bias_state(k, a)).map(|s| f64::from(s.temperature_c)));
    }
    let breakpoints = breakpoints(quantile(&temperatures, 0.0), quantile(&temperatures, 1.0), options.breakpoint_c)?;
    let literal = method.parts().model == Model::FourParametersLiteral;
    let form = |b: f32| Form::Four { breakpoint_c: b, origin_c: if literal { 0.0 } else { b } };
    let tables: Vec<Data> = breakpoints.iter().map(|b| Data::new(runs, scaling, a, form(*b)).means(MEAN_S)).collect();
    let by_range = method.parts().objective == Objective::Range;
    let (exact, mut at, mut k) = exact_solution(&tables, by_range)?.ok_or_else(|| {
        BadInput::new("the temperatures span too little for a breakpoint; record a run over tens of degrees")
    })?;
    let what = if by_range { "range" } else { "standard deviation" };
    let found = match method.parts().search {
        Search::Swarm => Some(four_parameter_swarm(&tables, by_range, options.seed)),
        Search::LiteralSwarm(_) => {
            let (found, unit, at_walls) = literal_swarm(&tables[at], by_range, options.seed);
            let clips = match at_walls[..] {
                [] => String::new(),
                _ => format!("; it clips {}", hrg_data::error::list(&at_walls)),
            };
            records.note(format!(
                "a unit of the output is {unit:.3e} deg/h: the box is +-800 of it per C/min, +-100 per C{clips}"
            ));
            Some((at, found))
        }
        _ => None,
    };
    match found {
        Some((place, found)) => {
            (at, k) = (place, found.k.clone());
            let e = tables[at].residuals(&k);
            let reached = if by_range { range(&e) } else { std_dev(&e) };
            let above = 100.0 * (reached / exact - 1.0).max(0.0);
            let digits = if matches!(method.parts().search, Search::LiteralSwarm(_)) { 9 } else { 3 };
            records
                .note(format!("{what} of 100 s means {reached:.5} deg/h, {above:.digits$} % above the exact solution"));
            let unit = if by_range { "range [deg/h]" } else { "standard deviation [deg/h]" };
            records.searched(None, |of| found.history(of, unit, &tables[at].names));
        }
        None => records.note(format!("{what} of 100 s means {exact:.5} deg/h, the least there is")),
    }
    let b = breakpoints[at];
    if literal {
        records.note(format!("the bias jumps by {:.4} deg/h at {b:.0} C", (k[4] - k[3]) * f64::from(b)));
    }
    records.note(format!("breakpoint {b:.0} C"));
    Ok(FourParameter {
        constant_cooling_heating_low_high: std::array::from_fn(|j| k[j] as f32),
        breakpoint_c: b,
        origin_c: if literal { 0.0 } else { b },
    })
}

/// Breakpoints that are tried: a tenth of the range on either side is left to each branch. Or the one that is given.
fn breakpoints(low: f64, high: f64, given: Option<f64>) -> Result<Vec<f32>, BadInput> {
    let margin = 0.1 * (high - low);
    match given {
        Some(b) if !(b > low && b < high) => Err(BadInput::new(format!(
            "the breakpoint of {b} C lies outside the temperatures of the run, {low:.1} to {high:.1} C; give one between them"
        ))),
        Some(b) => Ok(vec![b as f32]),
        None => {
            let count = ((high - low - 2.0 * margin) / BREAKPOINT_STEP_C).floor() as usize;
            Ok((0..=count).map(|k| (low + margin + k as f64 * BREAKPOINT_STEP_C) as f32).collect())
        }
    }
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

/// Objective of a swarm: the range, or the sum of squares about the mean, of the residual after some coefficients.
fn objective<'a>(
    d: impl Fn(&[f64]) -> &'a Data + 'a,
    scale: &'a [f64],
    by_range: bool,
) -> impl FnMut(&[f64]) -> f64 + 'a {
    let mut work = Vec::new();
    move |z| {
        let d = d(z);
        work.clear();
        let (mut sum, mut low, mut high) = (0.0, f64::INFINITY, f64::NEG_INFINITY);
        for i in 0..d.y.len() {
            let mut e = d.y[i];
            for j in 0..scale.len() {
                e -= z[j] * scale[j] * d.columns[j + 1][i];
            }
            work.push(e);
            sum += e;
            low = low.min(e);
            high = high.max(e);
        }
        if by_range {
            return high - low;
        }
        let mean = sum / work.len() as f64;
        work.iter().map(|e| (e - mean) * (e - mean)).sum::<f64>()
    }
}

/// Converts the result of a swarm to coefficients, with the constant that brings the mean to zero.
fn searched<'a>(
    found: &swarm::Found,
    scale: &[f64],
    by_range: bool,
    d: impl Fn(&[f64]) -> (usize, &'a Data),
) -> (usize, Searched) {
    let coefficients = |z: &[f64]| {
        let rest: Vec<f64> = z.iter().zip(scale).map(|(z, s)| z * s).collect();
        d(z).1.with_constant(&rest)
    };
    let rows = d(&found.position).1.y.len();
    let value = |v: &f64| if by_range { *v } else { (v / (rows - 1) as f64).sqrt() };
    let searched = Searched {
        k: coefficients(&found.position),
        above: f64::NAN,
        objective: found.history.iter().map(value).collect(),
        path: found.path.iter().map(|z| coefficients(z)).collect(),
    };
    (d(&found.position).0, searched)
}

/// wu2023's swarm with the breakpoint as a fifth dimension. Its search ranges are in units of its gyro's output; here each
/// coefficient may move the bias by three ranges of the rate over the run. Its speed limit of 10 is a tenth of the range
/// of its temperature coefficients and an eightieth of that of its coefficients of change; a tenth is taken for all:
/// with an eightieth the swarm settles on a breakpoint before the coefficients have arrived.
fn four_parameter_swarm(tables: &[Data], by_range: bool, seed: u64) -> (usize, Searched) {
    let width = 3.0 * range(&tables[0].y).max(1e-12);
    let scale: Vec<f64> = (1..four_parameter::TERMS)
        .map(|j| {
            let most = tables.iter().map(|d| range(&d.columns[j])).fold(0.0, f64::max);
            width / most.max(1e-12)
        })
        .collect();
    let mut limits: Vec<([f64; 2], f64)> = vec![([-1.0, 1.0], 0.1); 4];
    limits.push(([0.0, tables.len() as f64 - 1e-9], 0.1 * tables.len() as f64));
    let found = swarm::minimise(&swarm::WU, &limits, seed, objective(|z| &tables[z[4] as usize], &scale, by_range));
    searched(&found, &scale, by_range, |z| (z[4] as usize, &tables[z[4] as usize]))
}

/// Half-widths of wu2023's box: coefficients of change (cooling, heating), and of temperature (low, high).
const WU_BOX: [f64; four_parameter::TERMS - 1] = [800.0, 800.0, 100.0, 100.0];
/// A coefficient this near to a wall of its box lies at it.
const AT_A_WALL: f64 = 0.999;

/// wu2023's swarm as printed: four dimensions, coefficients of change within 800 and of temperature within 100 of either
/// sign, speeds within 10. Its Table 2 states no unit of the output; the one taken here, which is given back in deg/h, lets each coefficient move
/// the bias by three ranges of the rate over the run, as [`four_parameter_swarm`] does. Gives the coefficients that end at a wall, too.
fn literal_swarm(d: &Data, by_range: bool, seed: u64) -> (Searched, f64, Vec<&'static str>) {
    let width = 3.0 * range(&d.y).max(1e-12);
    let of = |j: usize| width / (WU_BOX[j] * range(&d.columns[j + 1]).max(1e-12));
    let unit = (0..WU_BOX.len()).map(of).fold(0.0, f64::max);
    let scale = [unit; four_parameter::TERMS - 1];
    let limits = WU_BOX.map(|most| ([-most, most], 10.0));
    let found = swarm::minimise(&swarm::WU, &limits, seed, objective(|_| d, &scale, by_range));
    let at_walls = found.position.iter().zip(WU_BOX).enumerate().filter(|(_, (z, most))| z.abs() >= AT_A_WALL * most);
    let at_walls = at_walls.map(|(j, _)| d.names[j + 1]).collect();
    (searched(&found, &scale, by_range, |_| (0, d)).1, unit, at_walls)
}
