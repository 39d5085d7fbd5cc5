//! Calibration images of one unit side by side: what changed, over the temperatures, and how the unit ages.
//!
//! # How
//! Both images are given the same readings of the thermometers: those at which the older one says T on a soak. For each, `hrg-core` gives what
//! the unit would subtract, as a day after power-on, `SOAK_S` after the beginning ([`hrg_identify::fit::correct::Model`]). So a change is
//! what the same unit would send differently. Its standard deviation is that of both images, which were made from different runs; where an
//! image states those of its coefficients alone, they are taken as independent; where it states none, it is NaN, and the change has no number of
//! standard deviations.
//!
//! The trend is a straight line in time through the mean of each quantity over the temperatures, by least squares with weights. The standard
//! deviations of an image at its temperatures are taken as fully alike, so that of the mean is their mean. Calibrate again when the
//! trend has moved a bias by the limit; at the earliest, when the trend and twice its standard deviation have.

use hrg_core::bias::{self, Coefficients};
use hrg_core::calibration::Calibration;
use hrg_core::compensator::Output;
use hrg_core::effects::{span, Span};
use hrg_core::frequency::StepFrequencies;
use hrg_core::rate_factors::{RateAxis, OTHERS};
use hrg_core::temperature::TemperatureCurve;
use hrg_core::{AXES, MODEL_STEP_S};
use hrg_data::axes::AXIS_NAMES;
use hrg_data::error::BadInput;
use hrg_data::numeric::stats::mean;
use hrg_data::plot;
use hrg_data::plot::{Panel, Series};
use hrg_identify::fit::correct::{Model, Stepped};
use hrg_identify::forces::UG_OF_MPS2;

/// Duration for which an image receives the readings of a soak, s.
const SOAK_S: u32 = 1800;

/// Time since power-on: effects of the power-on are over, s.
const AGE_S: f32 = 86_400.0;

/// Temperatures from the lowest to the highest that both images know.
const TEMPERATURES: usize = 21;

/// A year, s.
pub const YEAR_S: f64 = 365.25 * 86_400.0;

/// An image, and when it was made.
#[derive(Debug, Clone)]
pub struct Dated {
    /// Its file.
    pub name: String,
    /// Calibration in it.
    pub calibration: Calibration,
    /// Date of its making, seconds since 1970; `None`: neither the image nor the user states it.
    pub unix_s: Option<f64>,
}

/// A quantity at a temperature.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Value {
    /// Temperature by the older image, C.
    pub temperature_c: f64,
    /// The value, or the newer less the older.
    pub value: f64,
    /// Its standard deviation; NaN: not stated.
    pub std: f64,
}

/// Quantity that is compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quantity {
    /// Bias of an axis on a soak, deg/h.
    Bias(usize),
    /// Factor of the rate of an axis on a soak, less one, ppm: a constant scale factor gives another one.
    ScaleFactor(usize),
    /// Misalignment of an axis to the first or second of the others ([`OTHERS`]), urad.
    Misalignment(usize, usize),
    /// Bias of an accelerometer on a soak, ug.
    ForceBias(usize),
    /// Factor of its specific force on a soak, less one, ppm.
    ForceScale(usize),
    /// Its misalignment to the first or second of the others, urad.
    ForceMisalignment(usize, usize),
}

impl Quantity {
    /// All of them; without factors over temperature in either image the biases alone, and scale factors whose constants differ.
    #[must_use]
    pub fn of(all: &[Dated]) -> Vec<Self> {
        let rates = all.iter().any(|d| d.calibration.rates.is_some());
        let constant = |a: usize| all[0].calibration.axes[a].scale_factor_dph_per_code;
        let moved = |a: usize| {
            all.iter().any(|d| d.calibration.axes[a].scale_factor_dph_per_code.to_bits() != constant(a).to_bits())
        };
        let mut out: Vec<Self> = (0..AXES).map(Self::Bias).collect();
        out.extend((0..AXES).filter(|a| rates || moved(*a)).map(Self::ScaleFactor));
        if rates {
            out.extend((0..2 * AXES).map(|k| Self::Misalignment(k / 2, k % 2)));
        }
        if all.iter().any(|d| d.calibration.specific_force.is_some()) {
            out.extend((0..AXES).map(Self::ForceBias).chain((0..AXES).map(Self::ForceScale)));
            out.extend((0..2 * AXES).map(|k| Self::ForceMisalignment(k / 2, k % 2)));
        }
        out
    }

    /// Its name.
    #[must_use]
    pub fn name(self) -> String {
        match self {
            Self::Bias(a) => format!("bias of {}", AXIS_NAMES[a]),
            Self::ScaleFactor(a) => format!("scale factor of {}", AXIS_NAMES[a]),
            Self::Misalignment(a, j) => format!("misalignment {}{}", AXIS_NAMES[a], AXIS_NAMES[OTHERS[a][j]]),
            Self::ForceBias(a) => format!("accelerometer {}: bias", AXIS_NAMES[a]),
            Self::ForceScale(a) => format!("accelerometer {}: scale factor", AXIS_NAMES[a]),
            Self::ForceMisalignment(a, j) => {
                format!("accelerometer {}: misalignment to {}", AXIS_NAMES[a], AXIS_NAMES[OTHERS[a][j]])
            }
        }
    }

    /// Its unit.
    #[must_use]
    pub const fn unit(self) -> &'static str {
        match self {
            Self::Bias(_) => "deg/h",
            Self::ScaleFactor(_) | Self::ForceScale(_) => "ppm",
            Self::Misalignment(..) | Self::ForceMisalignment(..) => "urad",
            Self::ForceBias(_) => "ug",
        }
    }
}

/// A quantity of a newer image less that of an older one, coldest first.
#[derive(Debug, Clone)]
pub struct Change {
    /// Quantity.
    pub quantity: Quantity,
    /// Over the temperatures.
    pub values: Vec<Value>,
}

impl Change {
    /// Mean over the temperatures.
    #[must_use]
    pub fn mean(&self) -> f64 {
        mean(&self.values.iter().map(|v| v.value).collect::<Vec<_>>())
    }

    /// The largest, with its temperature.
    #[must_use]
    pub fn largest(&self) -> Option<Value> {
        self.values.iter().copied().max_by(|a, b| a.value.abs().total_cmp(&b.value.abs()))
    }

    /// Root mean square of the changes over their standard deviations: about 1 where nothing but noise changed. `None`: not stated.
    #[must_use]
    pub fn sigmas(&self) -> Option<f64> {
        let squares: Vec<f64> = self.values.iter().map(|v| (v.value / v.std).powi(2)).collect();
        Some(mean(&squares).sqrt()).filter(|s| s.is_finite())
    }
}

/// The reading (Hz; C of a sensor) at which a curve gives a temperature, within its range.
fn reading_of(curve: &TemperatureCurve, temperature_c: f64) -> f64 {
    let reach = f64::from(curve.frequency_scale_hz) * 1.2;
    let (mut low, mut high) = (curve.frequency_centre_hz - reach, curve.frequency_centre_hz + reach);
    let rises = curve.temperature_c(high) > curve.temperature_c(low);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if (f64::from(curve.temperature_c(middle)) < temperature_c) == rises {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

/// Standard deviation of a bias on a soak, deg/h: as the unit states it, else by those of the coefficients as if they were independent; NaN where neither is
/// stated.
fn bias_std_dph(c: &Calibration, a: usize, output: &Output) -> f64 {
    let stated = f64::from(output.bias_std_dph[a]);
    if stated.is_finite() || !matches!(c.axes[a].coefficients, Coefficients::CoolingHeating(..)) {
        return stated;
    }
    let x = bias::regressors(&c.scaling, output.temperature_c[a], 0.0);
    // (At no ramp it is the heating set that counts.)
    let [_, heating] = &c.axes[a].bias_std_dph;
    let variance: f64 = heating.iter().zip(x).map(|(s, x)| f64::from(s * x).powi(2)).sum();
    if variance > 0.0 {
        variance.sqrt()
    } else {
        f64::NAN
    }
}

/// Steps of a soak.
fn soak_steps() -> u32 {
    (f64::from(SOAK_S) / f64::from(MODEL_STEP_S)) as u32
}

/// Output of the unit after so many steps with the given readings, and one more.
fn output_after(c: &Calibration, reading: &dyn Fn(u32) -> [f64; AXES], steps: u32) -> Output {
    let mut model = Model::new(c.clone(), AGE_S);
    let mut step = |step: u32| {
        let Stepped { output, .. } = model.step(&StepFrequencies {
            step,
            end_ticks: u64::from(step + 1),
            frequency_hz: reading(step).map(Some),
            rejected: [0; AXES],
            missing: [0; AXES],
        });
        output
    };
    (0..steps).for_each(|k| {
        step(k);
    });
    step(steps)
}

/// Part of half the calibrated range by which a ramp may begin outside it.
const BEYOND: f64 = 0.18;

/// Longest ramp of [`bias_on_ramp`], s.
const RAMP_S: f64 = 3600.0;

/// Bias that a unit states at a temperature (C) to which a ramp (C per minute) has brought it after a soak, and its standard uncertainty,
/// deg/h (NaN where the image does not state it). The ramp lasts an hour, or less where it would begin more than a fifth of half the
/// calibrated range outside it; without a ramp it is the bias of the soak. The soak lasts five times the slowest time constant of the image.
/// NaN at temperatures further outside.
#[must_use]
pub fn bias_on_ramp(c: &Calibration, temperature_c: f64, c_per_min: f64) -> [(f64, f64); AXES] {
    // (Beyond a fifth outside, the curve of the thermometer is not inverted.)
    let edge = |low: bool| {
        let all = c.axes.iter().map(|a| f64::from(if low { a.curve.valid_from_c } else { a.curve.valid_to_c }));
        all.fold(if low { f64::NEG_INFINITY } else { f64::INFINITY }, |e, v| if low { e.max(v) } else { e.min(v) })
    };
    let beyond = BEYOND * 0.5 * (edge(false) - edge(true));
    let (lowest, highest) = (edge(true) - beyond, edge(false) + beyond);
    if !((lowest..=highest).contains(&temperature_c) && c_per_min.is_finite()) {
        return [(f64::NAN, f64::NAN); AXES];
    }
    let room_c = if c_per_min > 0.0 { temperature_c - lowest } else { highest - temperature_c };
    let ramp_s = if c_per_min == 0.0 { 0.0 } else { (60.0 * room_c.max(0.0) / c_per_min.abs()).min(RAMP_S) };
    let ramp_steps = (ramp_s / f64::from(MODEL_STEP_S)).round() as u32;
    let slowest = c.effects.iter().map(|e| match span(e.id, &e.parameters) {
        Span::Time(tau_s) => 5.0 * tau_s,
        _ => 0.0,
    });
    let soak_s = slowest.fold(SOAK_S as f32, f32::max).min(AGE_S);
    let (soak, per_step) = ((soak_s / MODEL_STEP_S) as u32, c_per_min / 60.0 * f64::from(MODEL_STEP_S));
    let reading = |step: u32| {
        let before = f64::from(soak + ramp_steps - step.max(soak));
        c.axes.each_ref().map(|a| reading_of(&a.curve, temperature_c - before * per_step))
    };
    let output = output_after(c, &reading, soak + ramp_steps);
    [0, 1, 2].map(|a| (f64::from(output.bias_dph[a]), bias_std_dph(c, a, &output)))
}

/// Values of an image for the readings of a soak: each quantity, with its standard deviation.
fn on_soak(c: &Calibration, reading: [f64; AXES], quantities: &[Quantity]) -> Vec<(f64, f64)> {
    let output = output_after(c, &|_| reading, soak_steps());
    let stated = |std: f32| if std > 0.0 { f64::from(std) } else { f64::NAN };
    let scale_std = |errors: Option<&RateAxis>, a: usize| {
        stated(errors.map_or(0.0, |e| e.scale_std_at_ppm(output.temperature_c[a])))
    };
    let cross_std = |errors: Option<&RateAxis>, a: usize, j: usize| {
        stated(errors.map_or(0.0, |e| e.misalignment_std_at_urad(j, output.temperature_c[a])))
    };
    let of_rate = |a: usize| c.rates.as_ref().map(|r| &r[a]);
    let of_force = |a: usize| c.specific_force.as_ref().map(|all| &all[a]);
    let force = &output.specific_force;
    quantities
        .iter()
        .map(|q| match *q {
            Quantity::Bias(a) => (f64::from(output.bias_dph[a]), bias_std_dph(c, a, &output)),
            Quantity::ScaleFactor(a) => {
                let all = f64::from(output.factors.scale()[a]) * f64::from(c.axes[a].scale_factor_dph_per_code);
                (all, scale_std(of_rate(a), a))
            }
            Quantity::Misalignment(a, j) => {
                (1e6 * f64::from(output.factors.coupling()[a][j]), cross_std(of_rate(a), a, j))
            }
            Quantity::ForceBias(a) => {
                let std = stated(of_force(a).map_or(0.0, |f| f.bias_std_at_mps2(output.temperature_c[a])));
                (UG_OF_MPS2 * f64::from(force.bias_mps2[a]), UG_OF_MPS2 * std)
            }
            Quantity::ForceScale(a) => {
                let scale = f64::from(force.factors.scale()[a]);
                (1e6 * (scale - 1.0), scale_std(of_force(a).map(|f| &f.errors), a))
            }
            Quantity::ForceMisalignment(a, j) => {
                (1e6 * f64::from(force.factors.coupling()[a][j]), cross_std(of_force(a).map(|f| &f.errors), a, j))
            }
        })
        .collect()
}

/// The temperatures that all images know.
fn temperatures(all: &[Dated]) -> Result<Vec<f64>, BadInput> {
    let (mut low, mut high) = (f64::NEG_INFINITY, f64::INFINITY);
    for axis in all.iter().flat_map(|d| &d.calibration.axes) {
        low = low.max(f64::from(axis.curve.valid_from_c));
        high = high.min(f64::from(axis.curve.valid_to_c));
    }
    if !(low < high) {
        return Err(BadInput::new("the images have no temperature in common; compare images of overlapping ranges"));
    }
    Ok((0..TEMPERATURES).map(|k| low + k as f64 / (TEMPERATURES - 1) as f64 * (high - low)).collect())
}

/// Each quantity of each image over the temperatures, by image and quantity; scale factors in ppm of that of the first image.
///
/// # Errors
/// Fewer than two images, images of different units or without a calibration, or without a temperature in common.
pub fn values(all: &[Dated], quantities: &[Quantity]) -> Result<Vec<Vec<Vec<Value>>>, BadInput> {
    let [first, .., _] = all else {
        return Err(BadInput::new("give two images at least"));
    };
    for d in all {
        let (unit, known) = (d.calibration.unit_name(), first.calibration.unit_name());
        if unit != known {
            return Err(BadInput::new(format!(
                "{} is of unit {unit}, {} of {known}; compare images of one unit",
                d.name, first.name
            )));
        }
        if !d.calibration.calibrated {
            return Err(BadInput::new(format!(
                "{}: the image holds no calibration; give one that hrg fit made",
                d.name
            )));
        }
        let sensor = |d: &Dated| d.calibration.axes[0].curve.is_of_sensor();
        if sensor(d) != sensor(first) {
            return Err(BadInput::new(format!(
                "{} and {}: one takes the temperature from the resonator, the other from a sensor; compare images of one kind",
                first.name, d.name
            )));
        }
    }
    let mut out = vec![vec![Vec::new(); quantities.len()]; all.len()];
    for t in temperatures(all)? {
        let reading = first.calibration.axes.each_ref().map(|a| reading_of(&a.curve, t));
        let base = on_soak(&first.calibration, reading, quantities);
        for (d, out) in all.iter().zip(&mut out) {
            for ((q, own), (to, base)) in
                quantities.iter().zip(on_soak(&d.calibration, reading, quantities)).zip(out.iter_mut().zip(&base))
            {
                let value = match q {
                    Quantity::ScaleFactor(_) => 1e6 * (own.0 / base.0 - 1.0),
                    _ => own.0,
                };
                to.push(Value { temperature_c: t, value, std: own.1 });
            }
        }
    }
    Ok(out)
}

/// Changes from one image to a newer one, from the values that [`values`] gave for them.
#[must_use]
pub fn changes(quantities: &[Quantity], old: &[Vec<Value>], new: &[Vec<Value>]) -> Vec<Change> {
    let less = |(o, n): (&Value, &Value)| Value {
        temperature_c: o.temperature_c,
        value: n.value - o.value,
        std: o.std.hypot(n.std),
    };
    let of = |(q, (o, n)): (&Quantity, (&Vec<Value>, &Vec<Value>))| Change {
        quantity: *q,
        values: o.iter().zip(n).map(less).collect(),
    };
    quantities.iter().zip(old.iter().zip(new)).map(of).collect()
}

/// Course of a quantity over time.
#[derive(Debug, Clone, PartialEq)]
pub struct Trend {
    /// Quantity.
    pub quantity: Quantity,
    /// Date, mean over the temperatures (of the first image: zero), and its standard deviation, oldest first.
    pub means: Vec<Value>,
    /// Change per year, and its standard deviation (NaN: not stated).
    pub per_year: (f64, f64),
}

impl Trend {
    /// Years from the newest image until the trend has changed the quantity by a limit, and until it may have, with twice its standard
    /// deviation; infinite: never.
    #[must_use]
    pub fn years_to(&self, limit: f64) -> (f64, f64) {
        let (slope, std) = (self.per_year.0.abs(), self.per_year.1);
        (limit / slope, limit / (slope + 2.0 * std))
    }
}

/// Trends of each quantity over images with dates.
///
/// # Errors
/// Fewer than three images with dates, or all of one date.
pub fn trends(all: &[Dated], quantities: &[Quantity], values: &[Vec<Vec<Value>>]) -> Result<Vec<Trend>, BadInput> {
    let mut dated: Vec<(f64, usize)> = all.iter().enumerate().filter_map(|(k, d)| Some((d.unix_s?, k))).collect();
    dated.sort_by(|a, b| a.0.total_cmp(&b.0));
    let spans = dated.first().zip(dated.last()).is_some_and(|(first, last)| last.0 - first.0 >= 86_400.0);
    if dated.len() < 3 || !spans {
        return Err(BadInput::new(
            "a trend needs three images with dates, a day apart at the least; give the dates of those that have none by --dates",
        ));
    }
    let years: Vec<f64> = dated.iter().map(|d| (d.0 - dated[0].0) / YEAR_S).collect();
    let one = |q: usize| {
        let over = |k: usize, of: &dyn Fn(&Value) -> f64| mean(&values[k][q].iter().map(of).collect::<Vec<_>>());
        let base = over(dated[0].1, &|v| v.value);
        let means: Vec<Value> = dated
            .iter()
            .map(|(at, k)| Value {
                temperature_c: *at,
                value: over(*k, &|v| v.value) - base,
                std: over(*k, &|v| v.std),
            })
            .collect();
        let stated = means.iter().all(|m| m.std > 0.0);
        let per_year = straight_line(&years, &means, stated);
        Trend { quantity: quantities[q], means, per_year }
    };
    Ok((0..quantities.len()).map(one).collect())
}

/// Slope of a straight line through means by their stated standard deviations, and its own: what the images state, and more where the means scatter by
/// more; NaN where they state nothing.
fn straight_line(years: &[f64], means: &[Value], stated: bool) -> (f64, f64) {
    let weights: Vec<f64> = means.iter().map(|m| if stated { m.std.powi(-2) } else { 1.0 }).collect();
    let total: f64 = weights.iter().sum();
    let middle = |of: &dyn Fn(usize) -> f64| weights.iter().enumerate().map(|(k, w)| w * of(k)).sum::<f64>() / total;
    let (at, value) = (middle(&|k| years[k]), middle(&|k| means[k].value));
    let spread = total * middle(&|k| (years[k] - at).powi(2));
    let slope = total * middle(&|k| (years[k] - at) * (means[k].value - value)) / spread;
    let squares = total * middle(&|k| (means[k].value - value - slope * (years[k] - at)).powi(2));
    let scatter = (squares / (means.len() as f64 - 2.0)).max(1.0);
    (slope, if stated { (scatter / spread).sqrt() } else { f64::NAN })
}

/// Draws the changes from the oldest to each newer image, over the temperatures, as SVG: a panel for each quantity, a line for each image,
/// a band of two standard deviations about zero from the newest.
///
/// # Errors
/// If the drawing library fails.
pub fn picture(all: &[Dated], quantities: &[Quantity], values: &[Vec<Vec<Value>>]) -> anyhow::Result<String> {
    let panels: Vec<Panel> = quantities
        .iter()
        .enumerate()
        .map(|(q, quantity)| {
            let of = |k: usize| changes(&quantities[q..=q], &values[0][q..=q], &values[k][q..=q]).remove(0).values;
            let mut series: Vec<Series> = (1..all.len())
                .map(|k| Series {
                    label: all[k].name.clone(),
                    points: of(k).iter().map(|v| (v.temperature_c, v.value)).collect(),
                    colour: k,
                    dots: false,
                })
                .collect();
            let band = of(all.len() - 1);
            for (sign, label) in [(2.0, "two standard deviations"), (-2.0, "")] {
                let points = band.iter().map(|v| (v.temperature_c, sign * v.std)).collect();
                series.push(Series { label: label.into(), points, colour: 0, dots: false });
            }
            Panel {
                title: format!("{}: change since {}", quantity.name(), all[0].name),
                x: "temperature [C]".into(),
                y: format!("change [{}]", quantity.unit()),
                log: false,
                series,
            }
        })
        .collect();
    plot::svg(&panels, AXES, 520, 320)
}

#[cfg(test)]
mod tests {
    use super::*;
    use hrg_core::specific_force::{Accelerometer, AccelerometerBias};

    /// An image whose biases are a constant, with a stated standard deviation of 0.1 deg/h.
    fn image(bias_dph: f32, unix_s: f64) -> Dated {
        let mut c = Calibration::uncalibrated();
        c.calibrated = true;
        for a in &mut c.axes {
            a.coefficients = Coefficients::CoolingHeating([0.0; 6], [0.0; 6]);
            if let Coefficients::CoolingHeating(cooling, heating) = &mut a.coefficients {
                (cooling[0], heating[0]) = (bias_dph, bias_dph);
            }
            a.uncertainty.rest_dph2 = 0.01;
        }
        Dated { name: format!("at {unix_s}"), calibration: c, unix_s: Some(unix_s) }
    }

    #[test]
    fn a_change_is_seen_in_its_unit_and_in_standard_deviations() {
        let mut new = image(1.5, 1e9);
        let axis = RateAxis {
            rate_valid_from_c: -40.0,
            rate_valid_to_c: 60.0,
            rate_valid_from_c_per_min: -1.0,
            rate_valid_to_c_per_min: 1.0,
            scale_correction_ppm: [100.0, 0.0, 0.0, 0.0, 7.0, 8.0],
            scale_std_ppm: [2.0; 5],
            misalignment_urad: [[30.0, 0.0], [0.0; 2]],
            misalignment_std_urad: [[3.0; 2]; 2],
        };
        new.calibration.rates = Some([axis; AXES]);
        new.calibration.axes[2].scale_factor_dph_per_code *= 1.001;
        let all = [image(1.0, 0.0), new];
        let quantities = Quantity::of(&all);
        assert_eq!(quantities.len(), 12);
        let v = values(&all, &quantities).expect("one unit");
        let c = changes(&quantities, &v[0], &v[1]);
        let of = |q: Quantity| c.iter().find(|c| c.quantity == q).expect("asked for");
        let bias = of(Quantity::Bias(1));
        assert!((bias.mean() - 0.5).abs() < 1e-6, "{}", bias.mean());
        // 0.5 deg/h over 0.1 twice in quadrature.
        assert!((bias.sigmas().expect("stated") - 3.5355).abs() < 1e-3, "{:?}", bias.sigmas());
        assert!((of(Quantity::ScaleFactor(0)).mean() - 100.0).abs() < 0.1);
        assert!((of(Quantity::ScaleFactor(2)).mean() - 1100.1).abs() < 0.2);
        // The older image states nothing of a scale factor.
        assert_eq!(of(Quantity::ScaleFactor(0)).sigmas(), None);
        assert!((of(Quantity::Misalignment(0, 0)).mean() - 30.0).abs() < 1e-3);
        let svg = picture(&all, &quantities, &v).expect("draws");
        assert!(svg.contains("bias of x: change since at 0") && svg.contains("misalignment zy"));
    }

    #[test]
    fn accelerometers_that_differ_are_seen() {
        let old = image(1.0, 0.0);
        let mut new = image(1.0, 1e8);
        let bias =
            AccelerometerBias { bias_mps2: [9.806_65e-3, 0.0, 0.0, 0.0, 0.0, 0.0], bias_std_mps2: [9.806_65e-6; 5] };
        let (rate_valid_from_c, rate_valid_to_c) = (-40.0, 60.0);
        let errors = RateAxis {
            rate_valid_from_c,
            rate_valid_to_c,
            scale_correction_ppm: [50.0, 0.0, 0.0, 0.0, 0.0, 0.0],
            misalignment_urad: [[20.0, -30.0], [0.0; 2]],
            ..RateAxis::default()
        };
        new.calibration.specific_force = Some([Accelerometer { bias, errors }; AXES]);
        let all = [old, new];
        let quantities = Quantity::of(&all);
        let values = values(&all, &quantities).expect("comparable");
        let means: Vec<f64> = changes(&quantities, &values[0], &values[1]).iter().map(Change::mean).collect();
        let of = |q| means[quantities.iter().position(|p| *p == q).expect("compared")];
        assert!((of(Quantity::ForceBias(1)) - 1000.0).abs() < 1e-2 && (of(Quantity::ForceScale(2)) - 50.0).abs() < 0.1);
        assert!((of(Quantity::ForceMisalignment(0, 1)) + 30.0).abs() < 1e-3 && of(Quantity::Bias(0)) == 0.0);
    }

    #[test]
    fn images_that_cannot_be_compared_are_named() {
        let one = image(1.0, 0.0);
        let error = |all: &[Dated]| values(all, &[Quantity::Bias(0)]).expect_err("refused").0;
        assert!(error(std::slice::from_ref(&one)).contains("two images"));
        let mut other = one.clone();
        other.calibration.unit = hrg_core::unit_name::UnitName::new("HRG-9");
        assert!(error(&[one.clone(), other]).contains("compare images of one unit"));
        let mut none = one.clone();
        none.calibration.calibrated = false;
        assert!(error(&[one.clone(), none]).contains("holds no calibration"));
        let mut cold = one.clone();
        for a in &mut cold.calibration.axes {
            (a.curve.valid_from_c, a.curve.valid_to_c) = (-200.0, -190.0);
        }
        assert!(error(&[one.clone(), cold]).contains("no temperature in common"));
        let two = [one.clone(), one];
        let v = values(&two, &[Quantity::Bias(0)]).expect("fine");
        assert!(trends(&two, &[Quantity::Bias(0)], &v).expect_err("two").0.contains("three images with dates"));
    }

    #[test]
    fn a_trend_names_the_date_of_the_next_calibration() {
        // 0.2 deg/h a year over three years, 0.1 deg/h each.
        let all: Vec<Dated> = (0..4).map(|k| image(1.0 + 0.2 * k as f32, f64::from(k) * YEAR_S)).collect();
        let q = [Quantity::Bias(0)];
        let t = trends(&all, &q, &values(&all, &q).expect("fine")).expect("dated").remove(0);
        assert!((t.per_year.0 - 0.2).abs() < 1e-6, "{:?}", t.per_year);
        // 0.1 over the root of the sum of squared years from their mean, 5.
        assert!((t.per_year.1 - 0.1 / 5f64.sqrt()).abs() < 1e-4, "{:?}", t.per_year);
        let (expected, earliest) = t.years_to(0.3);
        assert!((expected - 1.5).abs() < 1e-4 && (earliest - 0.3 / (0.2 + 0.2 / 5f64.sqrt())).abs() < 1e-3);
        let three = trends(&all[..3], &q, &values(&all[..3], &q).expect("fine")).expect("dated").remove(0);
        assert!((three.per_year.0 - 0.2).abs() < 1e-6 && (three.per_year.1 - 0.1 / 2f64.sqrt()).abs() < 1e-4);
        // The order of the files does not matter.
        let turned: Vec<Dated> = all.iter().rev().cloned().collect();
        let again = trends(&turned, &q, &values(&turned, &q).expect("fine")).expect("dated").remove(0);
        assert!((again.per_year.0 - 0.2).abs() < 1e-6);
    }
}
