//! Data-sheet figures of a gyro, from recordings alone: bias over temperature, the loop between heating and cooling, turn-on repeatability,
//! bias stability, angle random walk, sensitivity to ramps, thermal lag. Each has a 95 % interval and the conditions of its measurement. (The quantities
//! are those that IEEE 1431 asks of a Coriolis gyro's specification; the standard's text is not at hand, so its clause numbers are not
//! given.)

mod figures;
mod page;

pub use page::{html, text};

use figures::half_width;
use hrg_data::axes::AXIS_NAMES;
use hrg_data::error::BadInput;
use hrg_data::numeric::allan;
use hrg_data::numeric::stats::{block_means, mean, quantile};
use hrg_data::recording::steps::{Run, Steps};
use hrg_data::recording::Recording;
use hrg_identify::fit::MEAN_S;
use hrg_identify::thermometer::curve;
use serde::Serialize;

/// A quantity with its 95 % interval.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Quantity {
    /// Name of the quantity.
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
    /// Mean of the temperatures in it, C.
    pub temperature_c: f64,
    /// Lowest of them.
    pub from_c: f64,
    /// Highest of them.
    pub to_c: f64,
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
    /// Unit of the figures of rates: deg/h, or that of the quantity in the place of the rates.
    pub rate_unit: String,
    /// Recordings.
    pub recordings: Vec<String>,
    /// The axes.
    pub axes: Vec<AxisReport>,
    /// Remarks for the reader.
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

/// Looks at recordings of one unit.
///
/// # Errors
/// Recordings that cannot be used, hold corrected rates, or differ in their axes.
pub fn report(recordings: &[Recording]) -> Result<Report, BadInput> {
    let first = recordings.first().ok_or_else(|| BadInput::new("no recording was given"))?;
    let all: Vec<&Recording> = recordings.iter().collect();
    let _ = hrg_identify::fit::independence::same_unit(&all, hrg_identify::fit::independence::Units::Same)?;
    hrg_identify::fit::independence::require(&all.iter().map(|r| (*r, "given")).collect::<Vec<_>>())?;
    if recordings.iter().any(|r| r.absent != first.absent || r.thermometer != first.thermometer) {
        return Err(BadInput::new("the recordings have different axes or thermometers; give those of one kind"));
    }
    let mut notes = Vec::new();
    if recordings.iter().any(Recording::corrected) {
        notes.push("corrected rates are among them: the figures are those of the compensated gyro".to_string());
    }
    if !recordings.iter().all(|r| r.without_earth_rate() || r.stands_for().is_some()) {
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
        rate_unit: first.rate_unit().to_string(),
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
    let (stretch, where_) = figures::stretch(a, recordings, steps, runs);
    let refused = allan::enough(&stretch.0).err();
    let curve = match &refused {
        None => allan::overlapping(&stretch.0, stretch.1, &allan::decades(stretch.0.len())),
        Some(_) => vec![],
    };
    let of_allan = refused.map_or_else(|| where_.clone(), |why| format!("{why}; {where_}"));
    let mut quantities = vec![
        figures::span_of_bias(&bins),
        figures::slope_of_temperature(&means),
        figures::loop_width(&means),
        figures::turn_on(a, steps, runs),
    ];
    quantities.push(figures::stability(&stretch, &where_));
    quantities.push(figures::instability(&curve, &of_allan));
    quantities.push(figures::random_walk(&curve, &of_allan));
    quantities.push(figures::ramp_sensitivity(&means));
    quantities.push(figures::thermal_lag(a, runs));
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
        .map(|(_, m)| {
            let all: Vec<f64> = m.iter().map(|m| m.rate).collect();
            let of = |keep: &dyn Fn(f64) -> bool| {
                let v: Vec<f64> = m.iter().filter(|m| keep(m.ramp)).map(|m| m.rate).collect();
                (!v.is_empty()).then(|| mean(&v))
            };
            let t: Vec<f64> = m.iter().map(|m| m.t).collect();
            Bin {
                temperature_c: mean(&t),
                from_c: quantile(&t, 0.0),
                to_c: quantile(&t, 1.0),
                heating_dph: of(&|r| r > SOAK),
                cooling_dph: of(&|r| r < -SOAK),
                mean_dph: mean(&all),
                half_width_dph: half_width(&all),
                means: m.len(),
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use hrg_simulate::{EffectSpec, Noise, Plan, Profile};

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
            let floor = Noise { ..hrg_simulate::Kind::parse("hrg").expect("named").noise() }.white_100s_dph;
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

    /// The plant's own lags; self-heating, which builds up in the first hour, is not part of the model (5 % of the time constant).
    #[test]
    fn the_lag_put_in_is_in_the_report() {
        let mut runs = runs(&[], 1..2);
        runs.push(Plan::of(Profile::parse("lag").expect("named"), 3, 5).simulate().recording);
        let r = report(&runs).expect("usable");
        for (axis, tau) in AXIS_NAMES.iter().zip([694.0, 655.0, 741.0]) {
            let q = of(&r, axis, "thermal lag");
            assert!(q.value.is_some_and(|v| (v / tau - 1.0).abs() < 0.1), "{q:?} for {tau}");
            assert!(q.low < q.value && q.value < q.high && q.conditions.contains("behind the case"), "{q:?}");
        }
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

    /// A recording with temperature sensors, each second: soaks with ramps of 1 C per minute between, a bias that follows the
    /// temperature, white noise, and noise of the sensors.
    fn sensed(soaks: &[(f64, usize)], noise_c: f64) -> Recording {
        let mut x = hrg_data::numeric::draws::Draws::new(11);
        let mut text = String::from("# thermometer: sensor\ntime_s,temp_c,rate_x_dph\n");
        let (mut at, mut k) = (soaks[0].0, 0);
        let mut row = |at: f64, k: &mut usize| {
            *k += 1;
            let (t, rate) = (at + noise_c * 12f64.sqrt() * x.centred(), 0.1 * at + 2.0 * x.centred());
            text.push_str(&format!("{k},{t:.4},{rate:.5}\n"));
        };
        for (to, seconds) in soaks {
            while (at - to).abs() > 1.0 / 120.0 {
                at += (to - at).signum() / 60.0;
                row(at, &mut k);
            }
            (0..*seconds).for_each(|_| row(*to, &mut k));
        }
        Recording::parse(text.as_bytes()).expect("a recording")
    }

    #[test]
    fn a_noisy_thermometer_hides_no_soak() {
        for noise_c in [0.0, 0.02, 0.05] {
            let r = report(&[sensed(&[(-40.0, 3600), (25.0, 1800), (60.0, 7200), (-20.0, 2400)], noise_c)])
                .expect("usable");
            let stability = of(&r, "x", "bias stability");
            assert!(stability.conditions.contains("soak of 2.0 h at 60.0 C"), "{noise_c}: {stability:?}");
            // White noise of a deviation of 2 / sqrt(12) a second.
            let put_in = 3.0 * 2.0 / 12f64.sqrt() / 10.0;
            assert!(stability.value.is_some_and(|v| (v / put_in - 1.0).abs() < 0.25), "{stability:?} for {put_in}");
            let span = of(&r, "x", "bias over temperature");
            assert!(span.conditions.contains("-40.0 to 60.0 C"), "{span:?}");
        }
    }

    #[test]
    fn figures_that_an_allan_deviation_refuses_are_not_stated() {
        let mut r = sensed(&[(25.0, 7200)], 0.0);
        let n = r.time_s.len();
        r.rate_dph[0][n / 10..].fill(f64::NAN);
        let r = report(&[r]).expect("usable");
        for name in ["bias instability", "angle random walk"] {
            let q = of(&r, "x", name);
            assert!(q.value.is_none() && q.low.is_none() && q.conditions.contains("nine of ten"), "{q:?}");
        }
    }

    #[test]
    fn missing_quantities_are_reported() {
        let mut r = runs(&[], 1..2).remove(0);
        r.thermometer = hrg_data::recording::thermometer::Thermometer::None;
        r.frequency_hz.iter_mut().for_each(|f| f.fill(f64::NAN));
        let r = report(&[r]).expect("usable");
        assert!(r.notes.iter().any(|n| n.contains("no temperatures")), "{:?}", r.notes);
        for name in ["bias over", "largest loop", "bias sensitivity", "turn-on"] {
            assert!(of(&r, "y", name).value.is_none(), "{name}");
        }
        assert!(of(&r, "y", "angle random walk").conditions.contains("temperature unknown"));
    }
}
