//! What a data sheet states of a gyro, from recordings alone: bias over temperature, the loop between heating and cooling, turn-on
//! repeatability, bias stability, angle random walk, sensitivity to ramps. Each with a 95 % interval and the conditions under which
//! it was taken. (The quantities are those that IEEE 1431 asks of a Coriolis gyro's specification; the standard's text is not at
//! hand, so its clause numbers are not given.)

use crate::fit::MEAN_S;
use crate::numeric::allan;
use crate::numeric::lsq;
use crate::numeric::stats::{block_means, mean, std_dev};
use crate::plot::{self, Panel, Series};
use crate::recording::steps::{Run, Steps};
use crate::recording::Recording;
use crate::thermometer::curve;
use crate::{BadInput, AXIS_NAMES};
use serde::Serialize;
use statrs::distribution::{ChiSquared, ContinuousCDF, StudentsT};
use std::fmt::Write as _;

/// A quantity with its 95 % interval.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Quantity {
    /// What it is.
    pub name: &'static str,
    /// Its value; `None` where these recordings do not show it.
    pub value: Option<f64>,
    /// Lower end of the interval.
    pub low: Option<f64>,
    /// Upper end.
    pub high: Option<f64>,
    /// Unit.
    pub unit: &'static str,
    /// Under which conditions it was taken, or why it is not there.
    pub conditions: String,
}

/// Bias in a range of temperature.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Bin {
    /// Middle of the range, C.
    pub temperature_c: f64,
    /// Mean rate while heating, cooling and altogether, deg/h.
    pub heating_dph: Option<f64>,
    /// While cooling.
    pub cooling_dph: Option<f64>,
    /// Altogether.
    pub mean_dph: f64,
    /// Half of its 95 % interval.
    pub half_width_dph: f64,
    /// 100 s means in it.
    pub means: usize,
}

/// One axis.
#[derive(Debug, Clone, Serialize)]
pub struct AxisReport {
    /// Its name.
    pub axis: &'static str,
    /// The figures.
    pub quantities: Vec<Quantity>,
    /// Bias over temperature.
    pub bias_over_temperature: Vec<Bin>,
    /// Allan deviation of the stretch that the stability was taken from.
    pub allan: Vec<allan::Point>,
}

/// The report of `hrg report`.
#[derive(Debug, Clone, Serialize)]
pub struct Report {
    /// 1.
    pub version: u32,
    /// Unit.
    pub unit: String,
    /// Recordings.
    pub recordings: Vec<String>,
    /// The axes.
    pub axes: Vec<AxisReport>,
    /// What the reader should know.
    pub notes: Vec<String>,
}

/// A 100 s mean: rate, temperature, ramp.
#[derive(Debug, Clone, Copy)]
struct Mean {
    rate: f64,
    t: f64,
    ramp: f64,
    run: usize,
}

/// Width of a bin of temperature, C.
const BIN_C: f64 = 5.0;
/// Ramps slower than this are a soak, C per minute.
const SOAK: f64 = 0.1;
/// A start is judged on this stretch after the first row, s.
const START_S: [usize; 2] = [0, 600];
/// Shortest stretch that an Allan deviation is taken of, s.
const STRETCH_S: usize = 1800;

/// `t` beyond which a share of 2.5 % lies.
fn students(freedom: f64) -> f64 {
    StudentsT::new(0.0, 1.0, freedom.max(1.0)).map_or(1.96, |t| t.inverse_cdf(0.975))
}

/// Interval of a standard deviation of `n` values.
fn deviation(values: &[f64]) -> Option<(f64, f64, f64)> {
    let n = values.iter().filter(|v| v.is_finite()).count();
    if n < 3 {
        return None;
    }
    let (s, freedom) = (std_dev(values), n as f64 - 1.0);
    let chi = ChiSquared::new(freedom).ok()?;
    Some((s, s * (freedom / chi.inverse_cdf(0.975)).sqrt(), s * (freedom / chi.inverse_cdf(0.025)).sqrt()))
}

/// Half of the 95 % interval of a mean of correlated values: their scatter, with the effective number of them by the correlation
/// of neighbours.
fn half_width(values: &[f64]) -> f64 {
    let n = values.len() as f64;
    if n < 3.0 {
        return f64::INFINITY;
    }
    let effective = (n * (1.0 - neighbours(values)) / (1.0 + neighbours(values))).clamp(2.0, n);
    students(effective - 1.0) * std_dev(values) / effective.sqrt()
}

/// Correlation of neighbouring values, 0 to 0.95.
fn neighbours(values: &[f64]) -> f64 {
    let m = mean(values);
    let power: f64 = values.iter().map(|v| (v - m).powi(2)).sum();
    let both: f64 = values.windows(2).map(|w| (w[0] - m) * (w[1] - m)).sum();
    if power > 0.0 {
        (both / power).clamp(0.0, 0.95)
    } else {
        0.0
    }
}

fn quantity(name: &'static str, unit: &'static str, v: Option<(f64, f64, f64)>, conditions: String) -> Quantity {
    Quantity { name, value: v.map(|v| v.0), low: v.map(|v| v.1), high: v.map(|v| v.2), unit, conditions }
}

/// Looks at recordings of one unit.
///
/// # Errors
/// Recordings that cannot be used, hold corrected rates, or differ in their axes.
pub fn report(recordings: &[Recording]) -> Result<Report, BadInput> {
    let first = recordings.first().ok_or_else(|| BadInput::new("no recording was given"))?;
    let all: Vec<&Recording> = recordings.iter().collect();
    let _ = crate::fit::independence::same_unit(&all, crate::fit::independence::Units::Same)?;
    crate::fit::independence::require(&all.iter().map(|r| (*r, "given")).collect::<Vec<_>>())?;
    if recordings.iter().any(|r| r.absent != first.absent || r.thermometer != first.thermometer) {
        return Err(BadInput::new("the recordings have different axes or thermometers; give those of one kind"));
    }
    let mut notes = Vec::new();
    if recordings.iter().any(Recording::corrected) {
        notes.push("corrected rates are among them: the figures are those of the compensated gyro".to_string());
    }
    if !recordings.iter().all(Recording::without_earth_rate) {
        notes.push(
            "the earth's rate is in the biases, as far as the axes see it: latitude and axes are not known".to_string(),
        );
    }
    let steps = recordings.iter().map(Steps::new).collect::<Result<Vec<_>, _>>()?;
    let runs: Option<Vec<Run>> = match curve::from_steps(&steps) {
        Ok(found) => Some(steps.iter().map(|s| Run::new(s.clone(), found.curves)).collect()),
        Err(e) => {
            notes.push(format!("no temperatures: {e}"));
            None
        }
    };
    let axes = first.present().map(|a| axis(a, recordings, &steps, runs.as_deref())).collect();
    Ok(Report {
        version: 1,
        unit: first.unit().to_string(),
        recordings: recordings.iter().map(|r| r.source.clone()).collect(),
        axes,
        notes,
    })
}

/// 100 s means of an axis; without a thermometer their temperatures are NaN.
fn means(a: usize, steps: &[Steps], runs: Option<&[Run]>) -> Vec<Mean> {
    let mut out = Vec::new();
    for (number, s) in steps.iter().enumerate() {
        let state = |k: usize| runs.and_then(|r| r[number].state(k, a));
        let column = |f: &dyn Fn((f32, f32)) -> f32| -> Vec<f64> {
            let values: Vec<f64> = (0..s.len()).map(|k| state(k).map_or(f64::NAN, |x| f64::from(f(x)))).collect();
            block_means(&values, MEAN_S)
        };
        let (t, ramp) = (column(&|x| x.0), column(&|x| x.1));
        for ((rate, t), ramp) in block_means(&s.rate_dph[a], MEAN_S).into_iter().zip(t).zip(ramp) {
            if rate.is_finite() {
                out.push(Mean { rate, t, ramp, run: number });
            }
        }
    }
    out
}

fn axis(a: usize, recordings: &[Recording], steps: &[Steps], runs: Option<&[Run]>) -> AxisReport {
    let means = means(a, steps, runs);
    let bins = bins(&means);
    let (stretch, where_) = stretch(a, recordings, steps, runs);
    let curve = allan::overlapping(&stretch.0, stretch.1, &allan::decades(stretch.0.len()));
    let mut quantities =
        vec![span_of_bias(&bins), slope_of_temperature(&means), loop_width(&means), turn_on(a, steps, runs)];
    quantities.push(stability(&stretch, &where_));
    quantities.push(instability(&curve, &where_));
    quantities.push(random_walk(&curve, &where_));
    quantities.push(ramp_sensitivity(&means));
    AxisReport { axis: AXIS_NAMES[a], quantities, bias_over_temperature: bins, allan: curve }
}

fn bins(means: &[Mean]) -> Vec<Bin> {
    let mut by_bin: std::collections::BTreeMap<i64, Vec<Mean>> = std::collections::BTreeMap::new();
    for m in means.iter().filter(|m| m.t.is_finite()) {
        by_bin.entry((m.t / BIN_C).floor() as i64).or_default().push(*m);
    }
    by_bin
        .into_iter()
        .filter(|(_, m)| m.len() >= 3)
        .map(|(k, m)| {
            let all: Vec<f64> = m.iter().map(|m| m.rate).collect();
            let of = |keep: &dyn Fn(f64) -> bool| {
                let v: Vec<f64> = m.iter().filter(|m| keep(m.ramp)).map(|m| m.rate).collect();
                (!v.is_empty()).then(|| mean(&v))
            };
            Bin {
                temperature_c: (k as f64 + 0.5) * BIN_C,
                heating_dph: of(&|r| r > SOAK),
                cooling_dph: of(&|r| r < -SOAK),
                mean_dph: mean(&all),
                half_width_dph: half_width(&all),
                means: m.len(),
            }
        })
        .collect()
}

fn span_of_bias(bins: &[Bin]) -> Quantity {
    let name = "bias over temperature, peak to peak";
    let (Some(low), Some(high)) = (
        bins.iter().min_by(|x, y| x.mean_dph.total_cmp(&y.mean_dph)),
        bins.iter().max_by(|x, y| x.mean_dph.total_cmp(&y.mean_dph)),
    ) else {
        return quantity(name, "deg/h", None, "no temperatures".into());
    };
    let (v, w) = (high.mean_dph - low.mean_dph, low.half_width_dph.hypot(high.half_width_dph));
    let conditions = format!(
        "means of {BIN_C:.0} C wide ranges, {:.1} to {:.1} C; least at {:.1} C, largest at {:.1} C",
        bins[0].temperature_c - 0.5 * BIN_C,
        bins[bins.len() - 1].temperature_c + 0.5 * BIN_C,
        low.temperature_c,
        high.temperature_c
    );
    let known = w.is_finite() && bins.len() > 1;
    quantity(name, "deg/h", known.then_some((v, (v - w).max(0.0), v + w)), conditions)
}

/// A coefficient with its interval: scatter of the residual, widened by the correlation of neighbours.
fn coefficient(columns: &[Vec<f64>], y: &[f64], which: usize) -> Option<(f64, f64, f64)> {
    let f = lsq::fit(columns, y, None, &[]).ok()?;
    let rest: Vec<f64> =
        (0..y.len()).map(|k| y[k] - columns.iter().zip(&f.coefficients).map(|(c, b)| c[k] * b).sum::<f64>()).collect();
    let r = neighbours(&rest);
    let freedom = (y.len() as f64 * (1.0 - r) / (1.0 + r) - columns.len() as f64).max(1.0);
    let w = students(freedom) * f.std[which] * ((1.0 + r) / (1.0 - r)).sqrt();
    let v = f.coefficients[which];
    Some((v, v - w, v + w))
}

fn slope_of_temperature(means: &[Mean]) -> Quantity {
    let m: Vec<&Mean> = means.iter().filter(|m| m.t.is_finite()).collect();
    let middle = mean(&m.iter().map(|m| m.t).collect::<Vec<_>>());
    let columns = vec![vec![1.0; m.len()], m.iter().map(|m| m.t - middle).collect()];
    let y: Vec<f64> = m.iter().map(|m| m.rate).collect();
    let v = coefficient(&columns, &y, 1);
    let conditions = if v.is_some() {
        format!("straight line through {} means of 100 s", m.len())
    } else {
        "no temperatures".into()
    };
    quantity("bias temperature sensitivity", "deg/h per C", v, conditions)
}

/// Largest difference between heating and cooling at equal temperature, within a run.
fn loop_width(means: &[Mean]) -> Quantity {
    let name = "largest loop width at equal temperature";
    let mut best: Option<(f64, f64, f64, usize)> = None;
    let mut count = 0;
    for run in 0..=means.iter().map(|m| m.run).max().unwrap_or(0) {
        for k in -40..=40 {
            let (from, to) = (f64::from(k) * 2.0, f64::from(k) * 2.0 + 2.0);
            let of = |sign: f64| -> Vec<f64> {
                let here = |m: &&Mean| m.run == run && m.t >= from && m.t < to && sign * m.ramp > SOAK;
                means.iter().filter(here).map(|m| m.rate).collect()
            };
            let (heating, cooling) = (of(1.0), of(-1.0));
            if heating.is_empty() || cooling.is_empty() {
                continue;
            }
            count += 1;
            let v = mean(&heating) - mean(&cooling);
            if best.is_none_or(|b| v.abs() > b.0.abs()) {
                best = Some((v, 0.5 * (from + to), 1.0 / heating.len() as f64 + 1.0 / cooling.len() as f64, run));
            }
        }
    }
    let Some((v, at, share, run)) = best else {
        return quantity(
            name,
            "deg/h",
            None,
            "no temperature is passed both heating and cooling, faster than 0.1 C per minute".into(),
        );
    };
    // The scatter of one mean: what neighbours differ by, for the loop is not in it.
    let jumps: Vec<f64> =
        means.windows(2).filter(|w| w[0].run == w[1].run).map(|w| (w[1].rate - w[0].rate) / 2f64.sqrt()).collect();
    let scatter = (jumps.iter().map(|j| j * j).sum::<f64>() / jumps.len().max(1) as f64).sqrt();
    let w = students(jumps.len() as f64) * scatter * share.sqrt();
    quantity(
        name,
        "deg/h",
        Some((v.abs(), (v.abs() - w).max(0.0), v.abs() + w)),
        format!(
            "heating {} cooling, at {at:.0} C (2 C wide), recording {}; the largest of {count} places, so the interval is that of this place alone",
            if v > 0.0 { "above" } else { "below" },
            run + 1
        ),
    )
}

/// Scatter of the first ten minutes of several recordings.
fn turn_on(a: usize, steps: &[Steps], runs: Option<&[Run]>) -> Quantity {
    let name = "turn-on repeatability, 1 sigma";
    let [from, to] = START_S;
    let starts: Vec<f64> = steps.iter().map(|s| mean(&s.rate_dph[a][from.min(s.len())..to.min(s.len())])).collect();
    if starts.len() < 3 {
        return quantity(
            name,
            "deg/h",
            None,
            format!("{} recording(s); three power-ons at the least are needed", starts.len()),
        );
    }
    let temperatures: Vec<f64> = runs.map_or_else(Vec::new, |r| {
        r.iter().map(|r| r.state(to.min(r.steps.len()) / 2, a).map_or(f64::NAN, |s| f64::from(s.0))).collect()
    });
    let (low, high) = temperatures.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), t| (l.min(*t), h.max(*t)));
    let mut conditions = format!("mean of the first {} min of {} recordings", (to - from) / 60, starts.len());
    if low.is_finite() {
        let _ = write!(conditions, ", begun at {low:.1} to {high:.1} C");
        if high - low > 2.0 {
            conditions += ": that difference is in the figure";
        }
    }
    let late = steps.iter().filter(|s| (s.start_s - s.power_on_s).abs() > 60.0).count();
    if late > 0 {
        let _ = write!(conditions, "; {late} of them begin more than a minute after power-on");
    }
    quantity(name, "deg/h", deviation(&starts), conditions)
}

/// Rates with the time between them, s.
type Stretch = (Vec<f64>, f64);

/// The longest stretch at one temperature; where there is none, the longest recording.
fn stretch(a: usize, recordings: &[Recording], steps: &[Steps], runs: Option<&[Run]>) -> (Stretch, String) {
    let mut best: Option<(usize, usize, usize)> = None;
    for (number, run) in runs.unwrap_or_default().iter().enumerate() {
        let mut from = 0;
        for k in 0..=run.steps.len() {
            let soak = k < run.steps.len() && run.state(k, a).is_some_and(|s| f64::from(s.1.abs()) < SOAK);
            if !soak {
                if k - from > best.map_or(0, |b| b.2 - b.1) {
                    best = Some((number, from, k));
                }
                from = k + 1;
            }
        }
    }
    if let (Some((number, from, to)), Some(runs)) = (best.filter(|b| b.2 - b.1 >= STRETCH_S), runs) {
        let t = runs[number].state((from + to) / 2, a).map_or(f64::NAN, |s| f64::from(s.0));
        let text = format!("soak of {:.1} h at {t:.1} C, recording {}", (to - from) as f64 / 3600.0, number + 1);
        return ((steps[number].rate_dph[a][from..to].to_vec(), 1.0), text);
    }
    let longest = (0..recordings.len()).max_by_key(|k| steps[*k].len()).unwrap_or(0);
    let (rates, step_s) = recordings[longest].even_rates();
    let hours = rates[a].len() as f64 * step_s / 3600.0;
    let text = if runs.is_some() {
        format!("recording {} of {hours:.1} h; there is no soak of half an hour, so temperature is in it", longest + 1)
    } else {
        format!("recording {} of {hours:.1} h, temperature unknown", longest + 1)
    };
    ((rates[a].clone(), step_s), text)
}

fn stability((rates, step_s): &Stretch, conditions: &str) -> Quantity {
    let per_mean = ((MEAN_S as f64 / step_s).round() as usize).max(1);
    let v = deviation(&block_means(rates, per_mean)).map(|(s, l, h)| (3.0 * s, 3.0 * l, 3.0 * h));
    quantity("bias stability, 3 sigma of 100 s means", "deg/h", v, conditions.into())
}

/// From a bar of one sigma to 95 %, by logarithms.
fn widened(p: &allan::Point, factor: f64) -> (f64, f64, f64) {
    let v = p.deviation * factor;
    (v, v * (p.low / p.deviation).powf(1.96), v * (p.high / p.deviation).powf(1.96))
}

fn instability(curve: &[allan::Point], conditions: &str) -> Quantity {
    let name = "bias instability";
    let Some(least) = curve.iter().min_by(|x, y| x.deviation.total_cmp(&y.deviation)) else {
        return quantity(name, "deg/h", None, "too few values".into());
    };
    let reached = allan::read(curve).bias_instability_reached;
    let bound = if reached { "" } else { "; the curve has not turned up: an upper bound" };
    let conditions =
        format!("least Allan deviation over {}, at {:.0} s{bound}; {conditions}", allan::FLICKER, least.tau_s);
    quantity(name, "deg/h", Some(widened(least, 1.0 / allan::FLICKER)), conditions)
}

fn random_walk(curve: &[allan::Point], conditions: &str) -> Quantity {
    let (name, unit) = ("angle random walk", "deg/sqrt(h)");
    let Some(arw) = allan::read(curve).angle_random_walk_deg_per_root_h else {
        return quantity(name, unit, None, format!("no slope of -1/2 in the Allan deviation; {conditions}"));
    };
    // The bar of the point that is nearest to it.
    let off = |p: &allan::Point| (p.deviation * (p.tau_s / 3600.0).sqrt() / arw).ln().abs();
    let v = curve.iter().min_by(|x, y| off(x).total_cmp(&off(y))).map(|p| {
        let (own, low, high) = widened(p, 1.0);
        (arw, arw * low / own, arw * high / own)
    });
    quantity(name, unit, v, conditions.into())
}

fn ramp_sensitivity(means: &[Mean]) -> Quantity {
    let (name, unit) = ("bias sensitivity to ramp", "deg/h per C/min");
    let m: Vec<&Mean> = means.iter().filter(|m| m.t.is_finite() && m.ramp.is_finite()).collect();
    let fastest = m.iter().fold((0.0f64, 0.0f64), |(l, h), m| (l.min(m.ramp), h.max(m.ramp)));
    if fastest.1 - fastest.0 < 2.0 * SOAK {
        return quantity(name, unit, None, "no ramps in the recordings".into());
    }
    let (low, high) = m.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), m| (l.min(m.t), h.max(m.t)));
    let u: Vec<f64> = m.iter().map(|m| (2.0 * m.t - low - high) / (high - low).max(1e-9)).collect();
    let mut columns = lsq::powers(&u, 3);
    columns.push(m.iter().map(|m| m.ramp).collect());
    let y: Vec<f64> = m.iter().map(|m| m.rate).collect();
    let conditions =
        format!("beside a cubic of temperature; ramps of {:.2} to {:.2} C per minute", fastest.0, fastest.1);
    quantity(name, unit, coefficient(&columns, &y, 4), conditions)
}

/// A value with few digits.
fn short(v: f64) -> String {
    if v == 0.0 {
        return "0".into();
    }
    let digits = (3 - v.abs().max(1e-9).log10().ceil() as i32).clamp(0, 6) as usize;
    format!("{v:.digits$}")
}

fn cells(q: &Quantity) -> (String, String) {
    match (q.value, q.low, q.high) {
        (Some(v), Some(l), Some(h)) => (short(v), format!("{} to {}", short(l), short(h))),
        _ => ("-".into(), "-".into()),
    }
}

/// As text.
#[must_use]
pub fn text(r: &Report) -> String {
    let mut s = format!("{}: {}\n", r.unit, r.recordings.join(", "));
    for axis in &r.axes {
        let _ =
            writeln!(s, "\naxis {:<37}{:>12}  {:<22} {:<16} conditions", axis.axis, "value", "95 % interval", "unit");
        for q in &axis.quantities {
            let (value, interval) = cells(q);
            let _ = writeln!(s, "  {:<40}{value:>12}  {interval:<22} {:<16} {}", q.name, q.unit, q.conditions);
        }
    }
    for n in &r.notes {
        let _ = writeln!(s, "- {n}");
    }
    s
}

/// As a page.
///
/// # Errors
/// Where a picture cannot be drawn.
pub fn html(r: &Report) -> anyhow::Result<String> {
    let escape = |t: &str| t.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;");
    let mut s = format!(
        "<!doctype html><html lang=en><meta charset=utf-8><title>hrg report: {0}</title><style>\
         body{{font:15px/1.45 system-ui,sans-serif;margin:24px auto;max-width:1180px;padding:0 16px;color:#222}}\
         h1{{font-size:22px}}h2{{font-size:18px;margin-top:28px}}table{{border-collapse:collapse;margin:6px 0}}\
         td,th{{border-bottom:1px solid #ddd;padding:3px 12px;text-align:right;vertical-align:top}}\
         td:first-child,th:first-child,td:last-child,th:last-child{{text-align:left}}\
         td,th{{white-space:nowrap}}td:last-child{{white-space:normal;color:#666;font-size:13px}}th{{font-weight:600;background:#f6f6f6}}svg{{max-width:100%;height:auto}}\
         </style><h1>Figures of {0}</h1><p>From {1}. Intervals hold the true value with 95 %.</p>",
        escape(&r.unit),
        escape(&r.recordings.join(", "))
    );
    for axis in &r.axes {
        let _ = write!(
            s,
            "<h2>Axis {}</h2><table><tr><th>quantity<th>value<th>95 % interval<th>unit<th>conditions</tr>",
            axis.axis
        );
        for q in &axis.quantities {
            let (value, interval) = cells(q);
            let _ = write!(
                s,
                "<tr><td>{}<td>{value}<td>{interval}<td>{}<td>{}</tr>",
                q.name,
                q.unit,
                escape(&q.conditions)
            );
        }
        s += "</table>";
        s += &pictures(axis)?;
    }
    if !r.notes.is_empty() {
        s += "<h2>Notes</h2><ul>";
        r.notes.iter().for_each(|n| s += &format!("<li>{}</li>", escape(n)));
        s += "</ul>";
    }
    Ok(s + "</html>\n")
}

fn pictures(axis: &AxisReport) -> anyhow::Result<String> {
    let line = |label: &str, points: Vec<(f64, f64)>, colour: usize| Series {
        label: label.into(),
        points,
        colour,
        dots: false,
    };
    let bins = &axis.bias_over_temperature;
    let of = |f: &dyn Fn(&Bin) -> Option<f64>| {
        bins.iter().filter_map(|b| Some((b.temperature_c, f(b)?))).collect::<Vec<_>>()
    };
    let mut panels = Vec::new();
    if bins.len() > 1 {
        panels.push(Panel {
            title: format!("{}: bias over temperature", axis.axis),
            x: "temperature [C]".into(),
            y: "rate [deg/h]".into(),
            log: false,
            series: vec![
                line("mean", of(&|b| Some(b.mean_dph)), 0),
                line("heating", of(&|b| b.heating_dph), 2),
                line("cooling", of(&|b| b.cooling_dph), 3),
            ],
        });
    }
    let curve = |f: &dyn Fn(&allan::Point) -> f64| axis.allan.iter().map(|p| (p.tau_s, f(p))).collect::<Vec<_>>();
    panels.push(Panel {
        title: format!("{}: Allan deviation, bars of one sigma", axis.axis),
        x: "averaging time [s]".into(),
        y: "deg/h".into(),
        log: true,
        series: vec![
            line("deviation", curve(&|p| p.deviation), 1),
            line(
                "",
                axis.allan.iter().flat_map(|p| [(p.tau_s, p.low), (p.tau_s, p.high), (f64::NAN, f64::NAN)]).collect(),
                1,
            ),
        ],
    });
    plot::svg(&panels, 2, 560, 340)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::{EffectSpec, Noise, Plan, Profile};

    fn runs(effect: &[&str], seeds: std::ops::Range<u64>) -> Vec<Recording> {
        let effects: Vec<EffectSpec> = effect.iter().map(|e| EffectSpec::parse(e).expect("known")).collect();
        seeds
            .map(|seed| {
                let plan =
                    Plan { effects: effects.clone(), ..Plan::of(Profile::parse("cycle").expect("named"), 3, seed) };
                plan.simulate().recording
            })
            .collect()
    }

    fn of<'r>(r: &'r Report, axis: &str, name: &str) -> &'r Quantity {
        let axis = r.axes.iter().find(|a| a.axis == axis).expect("there");
        axis.quantities.iter().find(|q| q.name.starts_with(name)).expect("there")
    }

    #[test]
    fn figures_hold_what_was_put_in() {
        let r = report(&runs(&[], 1..4)).expect("usable");
        for axis in AXIS_NAMES {
            // White noise of a known deviation of 100 s means, most of it in a soak.
            let floor = Noise { ..crate::simulate::Kind::parse("hrg").expect("named").noise() }.white_100s_dph;
            let arw = of(&r, axis, "angle random walk");
            let put_in = floor * (100.0f64 / 3600.0).sqrt();
            assert!(arw.value.is_some_and(|v| (v / put_in - 1.0).abs() < 0.3), "{axis}: {arw:?}, {put_in} put in");
            let start = of(&r, axis, "turn-on");
            assert!(start.value.is_some() && start.low < start.value && start.value < start.high, "{start:?}");
            for q in &r.axes[0].quantities {
                assert!(q.value.is_none() || (q.low <= q.value && q.value <= q.high), "{q:?}");
            }
        }
        let page = html(&r).expect("drawn");
        assert!(page.contains("<svg") && page.contains("turn-on repeatability"));
        assert!(text(&r).contains("95 % interval"));
    }

    #[test]
    fn a_loop_shows_where_there_is_one() {
        let width = |effect: &[&str]| {
            let r = report(&runs(effect, 5..6)).expect("usable");
            of(&r, "x", "largest loop").value.expect("both directions")
        };
        let (with, without) = (width(&["hysteresis:size=8"]), width(&[]));
        assert!(with > 1.3 * without, "{with} {without}");
    }

    #[test]
    fn what_is_not_there_is_said() {
        let mut r = runs(&[], 1..2).remove(0);
        r.thermometer = crate::recording::format::Thermometer::None;
        r.frequency_hz.iter_mut().for_each(|f| f.fill(f64::NAN));
        let r = report(&[r]).expect("usable");
        assert!(r.notes.iter().any(|n| n.contains("no temperatures")), "{:?}", r.notes);
        for name in ["bias over", "largest loop", "bias sensitivity", "turn-on"] {
            assert!(of(&r, "y", name).value.is_none(), "{name}");
        }
        assert!(of(&r, "y", "angle random walk").conditions.contains("temperature unknown"));
    }
}
