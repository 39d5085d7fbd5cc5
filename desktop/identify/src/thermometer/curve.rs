//! Frequency to temperature from a chamber run.

use hrg_core::calibration::Calibration;
use hrg_core::temperature::{ForwardCurve, TemperatureCurve};
use hrg_core::AXES;
use hrg_data::error::BadInput;
use hrg_data::image_file::sensor_curve;
use hrg_data::numeric::lsq;
use hrg_data::numeric::stats::{mean, quantile, std_dev};
use hrg_data::recording::steps::{Steps, BRIDGE_S};
use hrg_data::recording::thermometer::Thermometer;

/// Source of the curves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reference {
    /// Case sensors of the recording.
    Case,
    /// The chamber's sensor.
    Chamber,
    /// No sensor was recorded: the curves of dong2023's Table 1, shifted so that the mean frequency of the run
    /// is at its middle. Temperatures are then a scale of frequency, not degrees of a thermometer.
    Shape,
    /// A sensor was recorded but does not follow the resonators; as [`Reference::Shape`] where it does not.
    Implausible,
    /// A sensor was recorded, over too little temperature for a curve: as [`Reference::Shape`].
    Narrow,
    /// The thermometers are sensors: no curve is needed.
    Sensor,
    /// Curves that were known already.
    Given,
}

/// Centred cubic `T(f)` by least squares.
///
/// # Errors
/// Too few points, or no span.
pub fn fit_inverse(
    frequency_hz: &[f64],
    temperature_c: &[f64],
    weights: Option<&[f64]>,
    degree: usize,
) -> Result<TemperatureCurve, BadInput> {
    let good: Vec<usize> =
        (0..frequency_hz.len()).filter(|&k| frequency_hz[k].is_finite() && temperature_c[k].is_finite()).collect();
    let f: Vec<f64> = good.iter().map(|&k| frequency_hz[k]).collect();
    let t: Vec<f64> = good.iter().map(|&k| temperature_c[k]).collect();
    let w: Option<Vec<f64>> = weights.map(|w| good.iter().map(|&k| w[k]).collect());
    let (low, high) = f.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(*x), b.max(*x)));
    // The scale is stored in f32: what the unit divides by is what is fitted with.
    let frequency_scale_hz = (0.5 * (high - low)) as f32;
    let span = t.iter().copied().fold(f64::NEG_INFINITY, f64::max) - t.iter().copied().fold(f64::INFINITY, f64::min);
    if f.len() < degree + 2 || !(span > 5.0) || !(frequency_scale_hz > 0.0) {
        return Err(BadInput::new(format!(
            "the temperatures span {:.1} C; a frequency-temperature curve needs a run over tens of degrees",
            if span.is_finite() { span } else { 0.0 }
        )));
    }
    let frequency_centre_hz = 0.5 * (high + low);
    let u: Vec<f64> = f.iter().map(|x| (x - frequency_centre_hz) / f64::from(frequency_scale_hz)).collect();
    let fit = lsq::fit(&lsq::powers(&u, degree), &t, w.as_deref(), &["1", "u", "u^2", "u^3"])?;
    let mut c = [0.0f32; 4];
    for (to, from) in c.iter_mut().zip(&fit.coefficients) {
        *to = *from as f32;
    }
    let (valid_from_c, valid_to_c) =
        t.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(*x), b.max(*x)));
    Ok(TemperatureCurve {
        frequency_centre_hz,
        frequency_scale_hz,
        temperature_coefficients_c: c,
        valid_from_c: valid_from_c as f32,
        valid_to_c: valid_to_c as f32,
    })
}

/// Centred cubic `f(T)` by least squares (dong2023 eq 1 and 2).
///
/// # Errors
/// As [`fit_inverse`].
pub fn fit_forward(temperature_c: &[f64], frequency_hz: &[f64], degree: usize) -> Result<ForwardCurve, BadInput> {
    let (low, high) = temperature_c.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(*x), b.max(*x)));
    if !(high - low > 5.0) {
        return Err(BadInput::new("the temperatures span less than 5 C"));
    }
    let (t0_c, scale_c) = (0.5 * (low + high), 0.5 * (high - low));
    let v: Vec<f64> = temperature_c.iter().map(|t| (t - t0_c) / scale_c).collect();
    let f0 = frequency_hz.iter().sum::<f64>() / frequency_hz.len() as f64;
    let y: Vec<f64> = frequency_hz.iter().map(|f| f - f0).collect();
    let fit = lsq::fit(&lsq::powers(&v, degree), &y, None, &["1", "v", "v^2", "v^3"])?;
    let mut c = [0.0; 4];
    for (to, from) in c.iter_mut().zip(&fit.coefficients) {
        *to = *from;
    }
    c[0] += f0;
    Ok(ForwardCurve { t0_c, scale_c, c })
}

/// A resonator that has moved less than this, about 10 C, says nothing of its curve, Hz.
const NARROWEST_HZ: f64 = 5.0;

/// A reading that has moved less than this says nothing of what depends on temperature: C of a sensor, and of a resonator about
/// as much.
const LEAST_SPAN_C: f64 = 0.5;

/// Hz of a resonator for a degree, about.
const HZ_PER_C: f64 = 0.47;

/// `true` if a curve is one of fused silica between two frequencies: 60 to 150 ppm per C everywhere.
fn plausible(curve: &TemperatureCurve, low_hz: f64, high_hz: f64) -> bool {
    (0..=20).all(|k| {
        let f = low_hz + (high_hz - low_hz) * f64::from(k) / 20.0;
        let ppm_per_c = 1e6 / (f * f64::from(curve.slope_c_per_hz(f)));
        (60.0..150.0).contains(&ppm_per_c)
    })
}

/// Longest thermal lag between sensor and resonator that is looked for, s.
const LONGEST_LAG_S: f64 = 4000.0;

/// Curves identified from the sensors.
#[derive(Debug, Clone, Copy)]
pub struct Identified {
    /// The curves.
    pub curves: [TemperatureCurve; AXES],
    /// Reference of their temperatures.
    pub reference: Reference,
    /// Time constant by which each resonator follows its sensor, s (0 where there is no sensor).
    pub lag_s: [f64; AXES],
}

/// The three curves from the sensors of one or several runs.
///
/// A resonator follows its case through a first-order lag (zhao2022: 694 s), so on a ramp of 1 C per minute it
/// is 11 C behind. Fitting `T(f)` to the sensor as it stands would bend the curve. So the sensor is lagged first, by
/// the time constant that leaves the least residual. Rows are weighted evenly over temperature (bins of two
/// degrees), so that a soak does not outweigh the ramps.
///
/// # Errors
/// If the run spans too little temperature.
pub fn from_steps(runs: &[Steps]) -> Result<Identified, BadInput> {
    if runs.iter().any(|s| s.thermometer == Thermometer::None) {
        return Err(BadInput::new(
            "the recording has no thermometer: what depends on temperature cannot be found in it (hrg allan and hrg report take it)",
        ));
    }
    if runs.iter().any(|s| s.thermometer.is_sensor()) {
        return sensors(runs);
    }
    let has = |v: &[f32]| v.iter().filter(|x| x.is_finite()).count() > 100;
    let present: Vec<usize> = (0..AXES).filter(|&a| runs.iter().any(|s| !s.absent[a])).collect();
    let reference = if runs.iter().all(|s| present.iter().all(|&a| has(&s.case_c[a]))) {
        Reference::Case
    } else if runs.iter().all(|s| has(&s.chamber_c)) {
        Reference::Chamber
    } else {
        Reference::Shape
    };
    let mut curves = Calibration::uncalibrated().axes.map(|a| a.curve);
    let mut lag_s = [0.0; AXES];
    let (mut implausible, mut narrow) = (false, false);
    for a in present {
        let curve = &mut curves[a];
        let (low, high) = span(runs, a, LEAST_SPAN_C * HZ_PER_C)?;
        if high - low < NARROWEST_HZ {
            narrow = true;
            *curve = shifted(curve, low, high);
        } else if reference == Reference::Shape {
            *curve = shifted(curve, low, high);
        } else {
            let sensor = |s: &Steps| -> Vec<f32> {
                if reference == Reference::Case {
                    s.case_c[a].clone()
                } else {
                    s.chamber_c.clone()
                }
            };
            let sensors: Vec<Vec<f32>> = runs.iter().map(sensor).collect();
            let (fitted, lag) = if reference == Reference::Case {
                let error = |tau: f64| lagged_fit(runs, &sensors, a, tau).map_or(f64::INFINITY, |(_, e)| e);
                let lag = least(error, LONGEST_LAG_S);
                (lagged_fit(runs, &sensors, a, lag)?.0, lag)
            } else {
                behind_chamber(runs, &sensors, a, &shifted(curve, low, high))?
            };
            lag_s[a] = lag;
            if plausible(&fitted, low, high) {
                *curve = fitted;
            } else {
                // The sensor does not follow this resonator: better a curve of the right shape than a wrong one.
                implausible = true;
                *curve = shifted(curve, low, high);
            }
        }
        // The range is that of the frequencies seen, in the curve's own degrees.
        let ends = [curve.temperature_c(low), curve.temperature_c(high)];
        curve.valid_from_c = ends[0].min(ends[1]);
        curve.valid_to_c = ends[0].max(ends[1]);
    }
    let reference = match (implausible, narrow) {
        (true, _) => Reference::Implausible,
        (_, true) if reference != Reference::Shape => Reference::Narrow,
        _ => return Ok(Identified { curves, reference, lag_s }),
    };
    Ok(Identified { curves, reference, lag_s: [0.0; AXES] })
}

/// A resonator may be so far outside the fitted range of a curve that is given for it, C.
const BEYOND_C: f32 = 20.0;

/// Curves that are known already; their range becomes that of the frequencies seen.
///
/// # Errors
/// If a resonator's frequencies are not those of its curve.
pub fn given(runs: &[Steps], known: [TemperatureCurve; AXES]) -> Result<Identified, BadInput> {
    let mut curves = known;
    for (a, curve) in curves.iter_mut().enumerate().filter(|(a, _)| runs.iter().any(|s| !s.absent[*a])) {
        let (low, high) = span(runs, a, LEAST_SPAN_C * HZ_PER_C)?;
        let ends = [low, high].map(|f| curve.temperature_c(f));
        let (from, to) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
        if curve.is_of_sensor() || from < curve.valid_from_c - BEYOND_C || to > curve.valid_to_c + BEYOND_C {
            return Err(BadInput::new(format!(
                "axis {}: frequencies of {low:.3} to {high:.3} Hz are {from:.0} to {to:.0} C by the curve that was given, which holds from {:.0} to {:.0} C; give the curves of this unit",
                hrg_data::axes::AXIS_NAMES[a],
                curve.valid_from_c,
                curve.valid_to_c
            )));
        }
        (curve.valid_from_c, curve.valid_to_c) = (from, to);
    }
    Ok(Identified { curves, reference: Reference::Given, lag_s: [0.0; AXES] })
}

/// Lowest and highest reading of an axis.
fn span(runs: &[Steps], a: usize, least: f64) -> Result<(f64, f64), BadInput> {
    let readings: Vec<f64> = runs.iter().flat_map(|s| s.frequency_hz[a].iter().copied()).collect();
    let (low, high) = (quantile(&readings, 0.0), quantile(&readings, 1.0));
    if high - low >= least {
        return Ok((low, high));
    }
    let thermometer = runs.first().map_or_else(Thermometer::default, |s| s.thermometer);
    let all = if runs.len() > 1 { format!(" of the {} runs together", runs.len()) } else { String::new() };
    let spans = if thermometer.is_sensor() {
        format!("{:.2} C", high - low)
    } else {
        format!("{:.3} Hz, about {:.2} C", high - low, (high - low) / HZ_PER_C)
    };
    Err(BadInput::new(format!(
        "column {}{all} spans {spans}; what depends on temperature does not show in it: a calibration needs a run over tens of degrees (hrg allan and hrg report take a run at one temperature)",
        thermometer.column(a)
    )))
}

/// The curves of sensors.
fn sensors(runs: &[Steps]) -> Result<Identified, BadInput> {
    if runs.iter().any(|s| !s.thermometer.is_sensor()) {
        return Err(BadInput::new(
            "some of the recordings have resonators for thermometers and others sensors; give recordings of one kind",
        ));
    }
    let mut curves = Calibration::uncalibrated().axes.map(|a| a.curve);
    for a in 0..AXES {
        if runs.iter().any(|s| !s.absent[a]) {
            let (low, high) = span(runs, a, LEAST_SPAN_C)?;
            curves[a] = sensor_curve(low, high);
        }
    }
    Ok(Identified { curves, reference: Reference::Sensor, lag_s: [0.0; AXES] })
}

/// A curve of Table 1 moved to the middle of the frequencies seen.
fn shifted(curve: &TemperatureCurve, low_hz: f64, high_hz: f64) -> TemperatureCurve {
    let middle = 0.5 * (low_hz + high_hz);
    TemperatureCurve {
        frequency_centre_hz: middle,
        frequency_scale_hz: (f64::from(curve.frequency_scale_hz) * middle / curve.frequency_centre_hz) as f32,
        ..*curve
    }
}

/// Finds the minimum of a function of one lag time: a coarse search, then halving the step.
fn least(f: impl Fn(f64) -> f64, longest: f64) -> f64 {
    let mut step = longest / 16.0;
    let (mut at, mut best) = (0.0, f(0.0));
    for k in 1..=16 {
        let value = f(f64::from(k) * step);
        if value < best {
            (at, best) = (f64::from(k) * step, value);
        }
    }
    while step > 2.0 {
        step *= 0.5;
        for x in [at - step, at + step] {
            if x >= 0.0 {
                let value = f(x);
                if value < best {
                    (at, best) = (x, value);
                }
            }
        }
    }
    at
}

/// Frequencies of a resonator with the temperatures of a sensor behind lags, evenly weighted over temperature.
struct Pairs {
    frequency_hz: Vec<f64>,
    temperature_c: Vec<f64>,
    weights: Vec<f64>,
}

impl Pairs {
    /// `taus_s`: the time constants of lags in series.
    fn new(runs: &[Steps], sensors: &[Vec<f32>], a: usize, taus_s: &[f64]) -> Self {
        let shares: Vec<f64> = taus_s.iter().map(|tau| crate::thermometer::lag::share(*tau)).collect();
        let (mut frequency_hz, mut temperature_c) = (Vec::new(), Vec::new());
        for (s, sensor) in runs.iter().zip(sensors) {
            let settle = (sensor.len() / 8).min(600);
            let mut states = vec![f64::NAN; shares.len()];
            let (mut begun, mut missing) = (0, 0.0);
            for (k, (x, hz)) in sensor.iter().zip(&s.frequency_hz[a]).enumerate() {
                let x = f64::from(*x);
                missing = if x.is_finite() { 0.0 } else { missing + 1.0 };
                if missing > BRIDGE_S {
                    // Behind such a gap the lags begin anew.
                    begun = k;
                    states.fill(f64::NAN);
                }
                let mut input = x;
                for (state, share) in states.iter_mut().zip(&shares).filter(|_| x.is_finite()) {
                    *state = if state.is_nan() { input } else { *state + share * (input - *state) };
                    input = *state;
                }
                // The start is not in equilibrium: self-heating, and a lag that does not know what was before.
                if k % 20 == 0 && k - begun > settle && hz.is_finite() && x.is_finite() {
                    frequency_hz.push(*hz);
                    temperature_c.push(input);
                }
            }
        }
        let bin = |f: f64| f.floor() as i64;
        let mut count = std::collections::BTreeMap::<i64, f64>::new();
        for f in &frequency_hz {
            *count.entry(bin(*f)).or_default() += 1.0;
        }
        let weights: Vec<f64> = frequency_hz.iter().map(|f| 1.0 / count[&bin(*f)]).collect();
        Self { frequency_hz, temperature_c, weights }
    }
}

/// Shares of the first of two lags in series that the second one is tried at.
const SECOND_LAGS: [f64; 7] = [0.0, 0.1, 0.2, 0.35, 0.5, 0.7, 1.0];
/// Spread of curves about one of them.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Spread {
    /// Of the slope, as a share.
    slope: f64,
    /// Of the quadratic and the cubic coefficient over the scale of that curve, C.
    curvature_c: [f64; 2],
}

/// That of a resonator about the curve of Table 1: of the slope three times what its three gyros differ by; of the coefficients over 21 Hz either way.
const ABOUT_TABLE_1: Spread = Spread { slope: 0.07, curvature_c: [0.12, 0.08] };
/// Seconds within which the error of a thermal model is one value.
const ALIKE_S: f64 = 2000.0;

/// The curve of a resonator of which only the chamber's temperature is known, and the time constants between the two together, s.
///
/// Between chamber and resonator stand the air, the case and the resonator's mount: two lags in series. The error of that model would
/// bend and tilt a free cubic, so slope and curvature are held near those of `like`, the curve of Table 1 at these frequencies.
fn behind_chamber(
    runs: &[Steps],
    sensors: &[Vec<f32>],
    a: usize,
    like: &TemperatureCurve,
) -> Result<(TemperatureCurve, f64), BadInput> {
    let seconds: usize = runs.iter().map(Steps::len).sum();
    let independent = (seconds as f64 / ALIKE_S).max(1.0);
    let pairs = |second: f64, long: f64| Pairs::new(runs, sensors, a, &[long, long * second]);
    // Less log-likelihood of two time constants: what they leave, in Hz, and how far the slope is from Table 1's.
    let cost = |second: f64, long: f64| -> f64 {
        let Ok(straight) = near(&pairs(second, long), like, None) else { return f64::INFINITY };
        let off = straight.slope.max(1e-6).ln() / ABOUT_TABLE_1.slope;
        0.5 * independent * (straight.left_c2 / straight.slope.powi(2)).ln() + 0.5 * off * off
    };
    let of = |second: f64| {
        let long = least(|long| cost(second, long), LONGEST_LAG_S);
        (cost(second, long), second, long)
    };
    let (_, second, long) =
        SECOND_LAGS.map(of).into_iter().min_by(|x, y| x.0.total_cmp(&y.0)).unwrap_or((f64::INFINITY, 0.0, 0.0));
    let pairs = pairs(second, long);
    let straight = near(&pairs, like, None)?;
    let found = if plausible_slope(&straight.curve) {
        near(&pairs, like, Some((ABOUT_TABLE_1, straight.left_c2 / independent)))?
    } else {
        straight
    };
    Ok((found.curve, long * (1.0 + second)))
}

/// A cubic `T(f)` near another one.
struct Near {
    curve: TemperatureCurve,
    /// Its slope over that of the other.
    slope: f64,
    /// Weighted mean square that it leaves, C^2.
    left_c2: f64,
}

/// Fits a cubic with the curvature of another one and its own slope; or with slope and curvature within a spread about those of the other, where the
/// variance of a mean of all rows is given, C^2.
fn near(pairs: &Pairs, like: &TemperatureCurve, within: Option<(Spread, f64)>) -> Result<Near, BadInput> {
    // (For the centre, the scale and the range.)
    let mut curve = fit_inverse(&pairs.frequency_hz, &pairs.temperature_c, Some(&pairs.weights), 1)?;
    let ratio = f64::from(curve.frequency_scale_hz) / f64::from(like.frequency_scale_hz);
    let [_, line, square, cube] = like.temperature_coefficients_c.map(f64::from);
    let theirs = [0.0, line * ratio, square * ratio.powi(2), cube * ratio.powi(3)];
    let total: f64 = pairs.weights.iter().sum();
    let root: Vec<f64> = pairs.weights.iter().map(|w| (w / total).sqrt()).collect();
    let u: Vec<f64> = pairs.frequency_hz.iter().map(|f| f64::from(curve.normalised(*f))).collect();
    let scaled = |v: Vec<f64>| -> Vec<f64> { v.iter().zip(&root).map(|(v, r)| v * r).collect() };
    let powers: Vec<Vec<f64>> = lsq::powers(&u, 3).into_iter().map(scaled).collect();
    let rest: Vec<f64> = (0..u.len())
        .map(|k| root[k] * pairs.temperature_c[k] - powers.iter().zip(theirs).map(|(x, c)| x[k] * c).sum::<f64>())
        .collect();
    let fit = match within {
        None => lsq::fit(&powers[..2], &rest, None, &["1", "u"])?,
        Some((spread, v)) => {
            let [square_c, cube_c] = spread.curvature_c;
            let spread = [spread.slope * theirs[1], square_c * ratio.powi(2), cube_c * ratio.powi(3)];
            let prior = [None].into_iter().chain(spread.map(|s| Some(s * s / v.max(1e-12)))).collect::<Vec<_>>();
            lsq::fit_shrunk(&powers, &rest, &prior, &["1", "u", "u^2", "u^3"])?
        }
    };
    let mut c = theirs;
    c.iter_mut().zip(&fit.coefficients).for_each(|(to, own)| *to += own);
    let left = |k: usize| rest[k] - powers.iter().zip(&fit.coefficients).map(|(x, b)| x[k] * b).sum::<f64>();
    let left_c2 = (0..rest.len()).map(|k| left(k).powi(2)).sum();
    curve.temperature_coefficients_c = c.map(|v| v as f32);
    Ok(Near { curve, slope: c[1] / theirs[1], left_c2 })
}

/// The curve of an axis over the units of a design, by the frequency over that at a middle temperature, with the spread between the units.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct DesignCurve {
    /// Half-width over which the polynomial is scaled, as a share of the frequency at the middle.
    pub half_width: f64,
    /// Coefficients of the powers 0 to 3 of the frequency's share over that half-width, C.
    pub coefficients_c: [f64; 4],
    /// Spread of the slope, as a share.
    pub slope_std: f64,
    /// Spread of the quadratic and the cubic coefficient, C.
    pub curvature_std_c: [f64; 2],
}

impl DesignCurve {
    /// Of the curves of some units between two temperatures, C. `None` for fewer than two curves, or curves that do not reach these temperatures.
    #[must_use]
    pub fn of(curves: &[TemperatureCurve], [low_c, high_c]: [f64; 2]) -> Option<Self> {
        let middle_c = 0.5 * (low_c + high_c);
        let at_middle: Vec<f64> = curves.iter().map(|c| c.frequency_hz(middle_c)).collect::<Option<_>>()?;
        let width = |(c, f0): (&TemperatureCurve, &f64)| {
            Some((c.frequency_hz(high_c)? - c.frequency_hz(low_c)?).abs() / (2.0 * f0))
        };
        let widths: Vec<f64> = curves.iter().zip(&at_middle).map(width).collect::<Option<_>>()?;
        let half_width = mean(&widths);
        let shares: Vec<f64> = (-20..=20).map(|k| f64::from(k) / 20.0).collect();
        let powers = lsq::powers(&shares, 3);
        let each: Vec<Vec<f64>> = curves
            .iter()
            .zip(&at_middle)
            .map(|(c, f0)| {
                let t: Vec<f64> =
                    shares.iter().map(|u| f64::from(c.temperature_c(f0 * (1.0 + u * half_width)))).collect();
                lsq::fit(&powers, &t, None, &["1", "u", "u^2", "u^3"]).ok().map(|f| f.coefficients)
            })
            .collect::<Option<_>>()?;
        let of = |k: usize| each.iter().map(|c| c[k]).collect::<Vec<f64>>();
        // (Of a new unit: the mean of so many is uncertain itself.)
        let wider = (1.0 + 1.0 / curves.len() as f64).sqrt();
        let std = |k: usize| std_dev(&of(k)) * wider;
        let slope = mean(&of(1));
        (curves.len() > 1).then(|| Self {
            half_width,
            coefficients_c: std::array::from_fn(|k| mean(&of(k))),
            slope_std: (std(1) / slope).abs().max(1e-5),
            curvature_std_c: [std(2).max(1e-3), std(3).max(1e-3)],
        })
    }

    /// As the curve of a unit with a frequency at the middle temperature, Hz.
    fn at(&self, middle_hz: f64) -> TemperatureCurve {
        let c = self.coefficients_c.map(|v| v as f32);
        TemperatureCurve {
            frequency_centre_hz: middle_hz,
            frequency_scale_hz: (middle_hz * self.half_width) as f32,
            temperature_coefficients_c: c,
            valid_from_c: c[0] - c[1].abs(),
            valid_to_c: c[0] + c[1].abs(),
        }
    }

    /// The curve of a unit of the design from its runs: that of the highest probability under the design and its case sensors, and the time constant
    /// by which the resonator follows its case, s.
    ///
    /// # Errors
    /// Too few rows.
    fn of_unit(&self, runs: &[Steps], sensors: &[Vec<f32>], a: usize) -> Result<(TemperatureCurve, f64), BadInput> {
        let seconds: usize = runs.iter().map(Steps::len).sum();
        let independent = (seconds as f64 / ALIKE_S).max(1.0);
        let with = |tau: f64| -> Result<Near, BadInput> {
            let pairs = Pairs::new(runs, sensors, a, &[tau]);
            let like = self.through(&pairs)?;
            let straight = near(&pairs, &like, None)?;
            let scale = f64::from(like.frequency_scale_hz) / (like.frequency_centre_hz * self.half_width);
            let [square, cube] = self.curvature_std_c;
            let spread = Spread { slope: self.slope_std, curvature_c: [square * scale.powi(2), cube * scale.powi(3)] };
            near(&pairs, &like, Some((spread, straight.left_c2 / independent)))
        };
        let lag = least(|tau| with(tau).map_or(f64::INFINITY, |n| n.left_c2), LONGEST_LAG_S);
        Ok((with(lag)?.curve, lag))
    }

    /// The design's curve with the middle frequency that the pairs are nearest to, about the middle of their own frequencies.
    fn through(&self, pairs: &Pairs) -> Result<TemperatureCurve, BadInput> {
        let own = fit_inverse(&pairs.frequency_hz, &pairs.temperature_c, Some(&pairs.weights), 1)?;
        let mut middle_hz = own.frequency_hz(self.coefficients_c[0]).unwrap_or(own.frequency_centre_hz);
        for _ in 0..4 {
            let like = self.at(middle_hz);
            let all: f64 = pairs.weights.iter().sum();
            let rows = pairs.frequency_hz.iter().zip(&pairs.temperature_c).zip(&pairs.weights);
            let off: f64 = rows.map(|((f, t), w)| w * (t - f64::from(like.temperature_c(*f)))).sum::<f64>() / all;
            // (A temperature that reads higher is a middle at a lower frequency.)
            middle_hz -= off / f64::from(like.slope_c_per_hz(middle_hz));
        }
        let like = self.at(middle_hz);
        let (centre, scale) = (own.frequency_centre_hz, f64::from(own.frequency_scale_hz));
        let f: Vec<f64> = (-20..=20).map(|k| centre + scale * f64::from(k) / 20.0).collect();
        let t: Vec<f64> = f.iter().map(|f| f64::from(like.temperature_c(*f))).collect();
        fit_inverse(&f, &t, None, 3)
    }
}

/// The curves of a unit of a design, of which each axis' curve is known with its spread. `None` where there is a resonator without a case sensor, or an axis
/// without a known curve.
///
/// # Errors
/// If the runs span too little temperature.
pub fn of_design(runs: &[Steps], designs: &[Option<DesignCurve>; AXES]) -> Result<Option<Identified>, BadInput> {
    if runs.iter().any(|s| s.thermometer.is_sensor() || s.thermometer == Thermometer::None) {
        return Ok(None);
    }
    let mut curves = Calibration::uncalibrated().axes.map(|a| a.curve);
    let mut lag_s = [0.0; AXES];
    for a in (0..AXES).filter(|&a| runs.iter().any(|s| !s.absent[a])) {
        let Some(design) = &designs[a] else { return Ok(None) };
        if runs.iter().any(|s| s.case_c[a].iter().filter(|x| x.is_finite()).count() <= 100) {
            return Ok(None);
        }
        let (low, high) = span(runs, a, NARROWEST_HZ)?;
        let sensors: Vec<Vec<f32>> = runs.iter().map(|s| s.case_c[a].clone()).collect();
        let (mut curve, lag) = design.of_unit(runs, &sensors, a)?;
        if !plausible(&curve, low, high) {
            return Ok(None);
        }
        let ends = [curve.temperature_c(low), curve.temperature_c(high)];
        (curve.valid_from_c, curve.valid_to_c) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
        (curves[a], lag_s[a]) = (curve, lag);
    }
    Ok(Some(Identified { curves, reference: Reference::Case, lag_s }))
}

/// True where the slope at the middle of a curve is one of fused silica.
fn plausible_slope(curve: &TemperatureCurve) -> bool {
    plausible(curve, curve.frequency_centre_hz, curve.frequency_centre_hz)
}

/// The curve fitted to a lagged sensor, and its weighted residual.
fn lagged_fit(runs: &[Steps], sensors: &[Vec<f32>], a: usize, tau: f64) -> Result<(TemperatureCurve, f64), BadInput> {
    let Pairs { frequency_hz: f, temperature_c: t, weights } = Pairs::new(runs, sensors, a, &[tau]);
    let curve = fit_inverse(&f, &t, Some(&weights), 3)?;
    let error: f64 =
        f.iter().zip(&t).zip(&weights).map(|((f, t), w)| w * (f64::from(curve.temperature_c(*f)) - t).powi(2)).sum();
    Ok((curve, error))
}

#[cfg(test)]
mod tests {
    use super::*;
    use hrg_data::recording::Recording;
    use hrg_simulate::{Plan, Profile};

    #[test]
    fn behind_a_chamber_sensor_alone_the_curve_stays_one_of_fused_silica() {
        for profile in ["cycle", "dong", "stairs", "ramps", "fast", "zhao", "wu", "20,40@1,10m,0@2,30m"] {
            for unit in [5, 9] {
                let simulated = Plan::of(Profile::parse(profile).expect("a profile"), unit, 3).simulate();
                let mut steps = Steps::new(&simulated.recording).expect("long enough");
                let with_case = from_steps(std::slice::from_ref(&steps)).expect("a curve");
                steps.case_c.iter_mut().for_each(Vec::clear);
                let found = from_steps(&[steps]).expect("a curve");
                assert_eq!(found.reference, Reference::Chamber, "{profile}");
                for (a, (own, wanted)) in found.curves.iter().zip(&with_case.curves).enumerate() {
                    // The unit is warmer than the chamber by some degrees, everywhere alike.
                    let low_hz = wanted.frequency_centre_hz - f64::from(wanted.frequency_scale_hz);
                    let apart: Vec<f64> = (0..=20)
                        .map(|k| low_hz + 0.1 * f64::from(k) * f64::from(wanted.frequency_scale_hz))
                        .map(|f| f64::from(own.temperature_c(f) - wanted.temperature_c(f)))
                        .collect();
                    let spread = quantile(&apart, 1.0) - quantile(&apart, 0.0);
                    let span = f64::from(wanted.valid_to_c - wanted.valid_from_c);
                    assert!(spread < 0.08 * span, "{profile}, unit {unit}, axis {a}: {spread} C over {span} C");
                }
            }
        }
    }

    #[test]
    fn a_gap_does_not_change_how_the_resonators_follow_their_cases() {
        let recording = Plan::of(Profile::parse("cycle").expect("named"), 5, 3).simulate().recording;
        let of = |text: &str| {
            let mut r = Recording::parse(text.as_bytes()).expect("readable");
            r.clean().expect("usable");
            from_steps(&[Steps::new(&r).expect("long enough")]).expect("curves")
        };
        let text = recording.to_csv();
        let whole = of(&text);
        // Within a ramp: the case is somewhere else behind it.
        let lost = |line: &&str| {
            let time = line.split(',').next().and_then(|t| t.parse::<f64>().ok());
            time.is_some_and(|t| (4000.0..6500.0).contains(&t))
        };
        let rest: String = text.lines().filter(|l| !lost(l)).map(|l| format!("{l}\n")).collect();
        let torn = of(&rest);
        assert_eq!(torn.reference, Reference::Case);
        for a in 0..AXES {
            let middle_hz = whole.curves[a].frequency_centre_hz;
            let apart = whole.curves[a].temperature_c(middle_hz) - torn.curves[a].temperature_c(middle_hz);
            let lags = torn.lag_s[a] / whole.lag_s[a];
            assert!((0.9..1.1).contains(&lags) && apart.abs() < 0.1, "axis {a}: {lags}, {apart} C");
        }
    }

    #[test]
    fn a_sensor_of_something_else_is_called_so() {
        let simulated = Plan::of(Profile::parse("cycle").expect("named"), 5, 3).simulate();
        let mut steps = Steps::new(&simulated.recording).expect("long enough");
        steps.case_c.iter_mut().for_each(Vec::clear);
        steps.chamber_c.iter_mut().for_each(|t| *t = 20.0 + 0.1 * *t);
        assert_eq!(from_steps(&[steps]).expect("a curve").reference, Reference::Implausible);
    }

    #[test]
    fn the_law_of_a_sensor_gives_back_what_it_reads() {
        let curve = sensor_curve(-17.63, 74.1);
        assert!(curve.is_of_sensor() && (curve.valid_from_c, curve.valid_to_c) == (-17.63, 74.1));
        for k in 0..=1000 {
            let t = -17.63 + 0.0917 * f64::from(k);
            assert!((f64::from(curve.temperature_c(t)) - t).abs() < 1e-5, "{t}");
        }
        assert!((curve.slope_c_per_hz(20.0) - 1.0).abs() < 1e-6);
        let resonator = hrg_core::calibration::Calibration::uncalibrated().axes[0].curve;
        assert!(!resonator.is_of_sensor());
    }
}
