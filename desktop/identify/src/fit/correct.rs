//! Corrected rates as a unit sends them, second by second, computed on the desktop from the unit's frequencies and raw rates.
//!
//! # When a bias takes effect
//! A unit cannot take the bias of a second off the rates of that second: the second must be over before its frequencies are
//! known. The bias of model step `k` takes effect 50 ms after that step ends ([`hrg_core::rate_path`]), so the samples of row `k`
//! of a recording, which end there too, ran under the bias of step `k - 1`. Row for row:
//!
//! `corrected[k] = M[k - 1] S[k - 1] (raw[k] - bias[k - 1])` ([`hrg_core::rate_factors`]), and the first row has neither yet.
//!
//! A fit takes `bias[k]` off `raw[k]`, for it looks for the bias that belongs to a temperature. The two differ by what a bias
//! changes in a second: at 5 C per minute and 0.1 deg/h per C that is 0.008 deg/h. In a recording that no unit made, a row is the
//! mean over its second without that shift of 50 ms: then a twentieth of that difference remains.
//!
//! [`Model`] is the one place where this is written on the desktop. The virtual board's digital twin runs it, too, and the frames of the ELF
//! are compared with it bit for bit.

use hrg_core::calibration::Calibration;
use hrg_core::compensator::Output;
use hrg_core::frequency::StepFrequencies;
use hrg_core::history::{History, Past};
use hrg_core::history::{Kept, KEPT_WORDS};
use hrg_core::inputs::{self, Quantities};
use hrg_core::link::Housekeeping;
use hrg_core::rate_factors::Factors;
use hrg_core::rate_path::PendingBias;
use hrg_core::specific_force::SpecificForce;
use hrg_core::status::{AxisStatus, UnitStatus};
use hrg_core::timebase::Timebase;
use hrg_core::{AXES, MODEL_STEP_S};
use hrg_data::recording::columns;
use hrg_data::recording::columns::Written;
use hrg_data::recording::metadata::{scale_text, SCALE_FACTOR, STANDS_FOR};
use hrg_data::recording::steps::{Steps, BRIDGE_S};
use hrg_data::recording::thermometer::Thermometer;
use hrg_data::recording::Recording;
use hrg_data::recording::{names, names_of};
use std::fmt::Write as _;

/// The model of a unit that gives the uncertainty of its past as a number.
pub type Model = ModelOf<History>;

/// The model of a unit: frequencies of a step in, temperatures and biases out.
#[derive(Debug)]
pub struct ModelOf<P> {
    compensator: hrg_core::compensator::Model<P>,
    /// Bias of the step before, deg/h.
    before_dph: [f32; AXES],
    /// Factors by which the rates were multiplied then.
    factors_before: Factors,
    trim: Option<[f32; AXES]>,
}

/// Result of a model step.
#[derive(Debug, Clone, Copy)]
pub struct Stepped {
    /// Temperatures, biases, status.
    pub output: Output,
    /// The bias with the tick from which it holds.
    pub pending: PendingBias,
    /// The bias under which the samples ran whose means belong to this step, deg/h.
    pub held_dph: [f32; AXES],
    /// Factors by which these samples were multiplied.
    pub held_factors: Factors,
}

impl<P: Past> ModelOf<P> {
    /// Starts in equilibrium with the first temperature. `age_s`: time since power-on at the start of the first step (0 on the
    /// unit; a recording may begin later).
    #[must_use]
    pub fn new(calibration: Calibration, age_s: f32) -> Self {
        let compensator = hrg_core::compensator::Model::new(calibration, age_s);
        Self { compensator, before_dph: [0.0; AXES], factors_before: Factors::UNIT, trim: None }
    }

    /// Sets the bias that an alignment has found, deg/h; it is in the bias from the next step on.
    pub fn set_trim(&mut self, trim_dph: [f32; AXES]) {
        self.trim = Some(trim_dph);
    }

    /// Goes on from words that [`keep`](Self::keep) gave, as a unit after a reset. Before the first step.
    ///
    /// # Errors
    /// Words that are not intact.
    pub fn resume(&mut self, words: &[u32]) -> Result<(), hrg_data::error::BadInput> {
        let kept = Kept::of(|k: usize| words.get(k).copied().unwrap_or(0))
            .ok_or_else(|| hrg_data::error::BadInput::new("the states that were kept are not intact"))?;
        self.compensator.resume(&kept);
        Ok(())
    }

    /// The states after the last step, as a unit keeps them over a reset.
    #[must_use]
    pub fn keep(&mut self) -> Vec<u32> {
        let mut words = vec![0; KEPT_WORDS];
        self.compensator.keep(|k, word| words[k] = word);
        words
    }

    /// Resets since power-on.
    #[must_use]
    pub fn resets(&self) -> u32 {
        self.compensator.resets()
    }

    /// Sets the inputs beside the frequencies for the next step.
    pub fn set_inputs(&mut self, quantities: Quantities) {
        self.compensator.set_inputs(quantities);
    }

    /// One model step.
    pub fn step(&mut self, step: &StepFrequencies) -> Stepped {
        if let Some(trim) = self.trim.take() {
            self.compensator.set_trim(trim);
        }
        let output = self.compensator.update(step);
        let held_dph = std::mem::replace(&mut self.before_dph, output.bias_dph);
        let held_factors = std::mem::replace(&mut self.factors_before, output.factors);
        Stepped { output, pending: PendingBias::new(Timebase::REFERENCE, step, &output), held_dph, held_factors }
    }
}

/// One second of a unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Second {
    /// End of the second, s, on the clock of its recording.
    pub time_s: f64,
    /// Frequencies, Hz; NaN where lost.
    pub frequency_hz: [f64; AXES],
    /// Mean corrected rates, deg/h; NaN without samples.
    pub corrected_dph: [f32; AXES],
    /// Mean raw rates of the same samples, deg/h.
    pub raw_dph: [f32; AXES],
    /// Biases that this second gave, deg/h: they hold in the next.
    pub bias_dph: [f32; AXES],
    /// Temperatures, C; NaN before the first.
    pub temperature_c: [f32; AXES],
    /// Standard uncertainties of the biases, deg/h; NaN where the calibration does not state them.
    pub bias_std_dph: [f32; AXES],
    /// Status of the axes and of the unit.
    pub status: [u16; 4],
}

impl From<&Housekeeping> for Second {
    fn from(h: &Housekeeping) -> Self {
        let [x, y, z] = h.axis_status.map(|s| s.bits());
        Self {
            time_s: f64::from(h.time_ms) / 1000.0,
            frequency_hz: h.frequency_hz,
            corrected_dph: h.corrected_dph,
            raw_dph: h.raw_dph,
            bias_dph: h.bias_dph,
            bias_std_dph: h.bias_std_dph,
            temperature_c: h.temperature_c,
            status: [x, y, z, h.unit_status.bits()],
        }
    }
}

/// Status bits of an axis that come of counters, which a recording does not hold.
const COUNTED: u16 = AxisStatus::EDGE_ERRORS.bits();

/// Those of the unit.
const COUNTED_BY_UNIT: u16 = UnitStatus::ADC_FAULT
    .union(UnitStatus::BIAS_LATE)
    .union(UnitStatus::LINK_ERRORS)
    .union(UnitStatus::FRAMES_DROPPED)
    .bits();

/// The model steps of a run under a calibration, as a unit makes them from these frequencies.
fn model_steps<'a>(calibration: &Calibration, steps: &'a Steps) -> impl Iterator<Item = Stepped> + 'a {
    let age_s = steps.start_s - steps.power_on_s - f64::from(MODEL_STEP_S);
    let mut model = Model::new(calibration.clone(), age_s as f32);
    let ticks = (f64::from(Timebase::REFERENCE.ticks_per_s()) * f64::from(MODEL_STEP_S)) as u64;
    (0..steps.len()).map(move |k| {
        model.set_inputs(steps.given(k));
        model.step(&StepFrequencies {
            step: k as u32,
            end_ticks: (k as u64 + 1) * ticks,
            frequency_hz: [0, 1, 2].map(|a: usize| Some(steps.frequency_hz[a][k]).filter(|f| f.is_finite())),
            rejected: [0; AXES],
            missing: [0; AXES],
        })
    })
}

/// Errors of the accelerometers by which the samples of each second are corrected: those of the step before; none in the first.
#[must_use]
pub fn specific_forces(calibration: &Calibration, steps: &Steps) -> Vec<SpecificForce> {
    let after = model_steps(calibration, steps).map(|s| s.output.specific_force);
    std::iter::once(SpecificForce::NONE).chain(after).take(steps.len()).collect()
}

/// The seconds of a run under a calibration, as a unit computes them from these frequencies and raw rates. Status bits that come
/// of a unit's counters alone (edge errors, link, dropped frames) are not set.
#[must_use]
pub fn correct(calibration: &Calibration, steps: &Steps) -> Vec<Second> {
    model_steps(calibration, steps)
        .enumerate()
        .map(|(k, Stepped { output, held_dph, held_factors, .. })| {
            let raw_dph = [0, 1, 2].map(|a: usize| steps.rate_dph[a][k] as f32);
            let silent = raw_dph.iter().all(|r| r.is_nan());
            let [x, y, z] = output.status.map(|s| s.bits());
            Second {
                time_s: steps.start_s + k as f64 * f64::from(MODEL_STEP_S),
                frequency_hz: [0, 1, 2].map(|a: usize| steps.frequency_hz[a][k]),
                corrected_dph: held_factors.corrected_dph(raw_dph, held_dph),
                raw_dph,
                bias_dph: output.bias_dph,
                bias_std_dph: output.bias_std_dph,
                temperature_c: output.temperature_c,
                status: [x, y, z, if silent { UnitStatus::ADC_FAULT.bits() } else { 0 }],
            }
        })
        .collect()
}

/// A recording corrected: its rows, and what a reader should know.
#[derive(Debug)]
pub struct Corrected {
    /// The seconds that have a row in the recording.
    pub seconds: Vec<Second>,
    /// Remarks for the user.
    pub notes: Vec<String>,
}

/// Corrects a recording as it was read, before any cleaning: a unit sees spikes, too. The status columns, if the recording has them, give
/// the counts that the unit's counters reported.
///
/// # Errors
/// Corrected rates, times that do not increase, no rows.
pub fn recording(calibration: &Calibration, r: &Recording) -> Result<Corrected, hrg_data::error::BadInput> {
    if r.corrected() {
        return Err(hrg_data::error::BadInput::new("the rates are corrected already; take the raw recording"));
    }
    if r.thermometer == Thermometer::None {
        return Err(hrg_data::error::BadInput::new(
            "the recording has no thermometer: there is nothing to correct it by",
        ));
    }
    let mut r = r.clone();
    let counted: Vec<(f64, [u16; 4])> = r.time_s.iter().copied().zip(std::mem::take(&mut r.status)).collect();
    r.order()?;
    let (steps, there) = Steps::as_seen(&r)?;
    let mut notes = r.notes;
    let late = steps.start_s - steps.power_on_s - f64::from(MODEL_STEP_S);
    if late > 0.5 * f64::from(MODEL_STEP_S) {
        notes.push(format!(
            "the recording begins {late:.0} s after power-on: what the unit remembered by then (slope of temperature, lags, hysteresis) is not in it, and starts anew here"
        ));
    }
    let gaps = there.iter().filter(|t| !**t).count();
    if gaps > 0 {
        notes.push(format!(
            "{gaps} seconds have no row: up to {BRIDGE_S:.0} s, frequencies there are taken from a straight line; the unit saw others, and its biases after them may differ"
        ));
    }
    notes.extend(without_inputs(calibration, &steps));
    let mut seconds = correct(calibration, &steps);
    for (time_s, status) in counted {
        let at = ((time_s - steps.start_s) / f64::from(MODEL_STEP_S)).round();
        if let Some(s) = seconds.get_mut(at as usize).filter(|_| at >= 0.0) {
            let masks = [COUNTED, COUNTED, COUNTED, COUNTED_BY_UNIT];
            s.status.iter_mut().zip(status).zip(masks).for_each(|((to, from), mask)| *to |= from & mask);
        }
    }
    let seconds = seconds.into_iter().zip(there).filter(|(_, t)| *t).map(|(s, _)| s).collect();
    Ok(Corrected { seconds, notes })
}

/// A sentence where a recording lacks an input that an image needs.
#[must_use]
pub fn without_inputs(calibration: &Calibration, steps: &Steps) -> Option<String> {
    let lacking = inputs::needed(calibration).difference(steps.has().intersection(steps.unit_inputs));
    (!lacking.is_empty()).then(|| {
        format!(
            "the image needs {}, which the recording does not have (as an input of the unit): axes that use it are flagged, and their effects of it are left out",
            hrg_data::error::list(&names_of(lacking))
        )
    })
}

/// The columns of a recording of corrected rates. One sensor's reading stands in the column of each of its axes.
fn written(source: &Recording) -> [Written<Second>; 8] {
    let readings = if source.thermometer.is_sensor() { columns::SENSOR } else { columns::FREQUENCY };
    [
        (readings, |s, a| s.frequency_hz[a].into()),
        (columns::RATE, |s, a| s.corrected_dph[a].into()),
        (columns::RAW, |s, a| s.raw_dph[a].into()),
        (columns::BIAS, |s, a| s.bias_dph[a].into()),
        (columns::BIAS_STD, |s, a| s.bias_std_dph[a].into()),
        (columns::TEMPERATURE, |s, a| s.temperature_c[a].into()),
        (columns::STATUS, |s, a| s.status[a].into()),
        (columns::UNIT_STATUS, |s, _| s.status[AXES].into()),
    ]
}

/// Caveat of each stated uncertainty of a bias, printed wherever one is shown.
pub const TURN_ON: &str =
    "the uncertainty of a bias (bias_std) holds the constant that changes with each power-on only where more than one run told it: several train runs, the verify run of hrg trace, or a family";

/// Seconds as a recording of corrected rates, with raw rates and the rest beside them. `how`: what made them, for the metadata.
/// Numbers are written so that they come back to the last bit.
#[must_use]
pub fn to_csv(
    source: &Recording,
    how: &str,
    power_on_s: f64,
    calibration: Option<&Calibration>,
    seconds: &[Second],
) -> String {
    let unit = Some(source.unit()).filter(|n| *n != names::NONE).or_else(|| calibration.and_then(names::of));
    let used = calibration.cloned().unwrap_or_else(Calibration::uncalibrated);
    let meta = [
        ("hrg-recording", "1".to_string()),
        ("unit", unit.unwrap_or(names::NONE).to_string()),
        ("run", format!("{} {how}", source.meta("run").unwrap_or("run"))),
        ("rate_unit", "deg/h".to_string()),
        ("rates", "corrected".to_string()),
        ("calibration", calibration.map_or("default".to_string(), |c| format!("{:08x}", c.checksum()))),
        (SCALE_FACTOR, scale_text(&used.scale_factors_dph_per_code())),
        ("power_on_s", power_on_s.to_string()),
    ];
    let mut s = String::with_capacity(seconds.len() * 220);
    for (k, v) in meta {
        let _ = writeln!(s, "# {k}: {v}");
    }
    // Corrected rates hold the earth's rate as raw ones do.
    for key in ["latitude_deg", "axes", STANDS_FOR] {
        if let Some(v) = source.meta(key) {
            let _ = writeln!(s, "# {key}: {v}");
        }
    }
    if source.without_earth_rate() {
        s.push_str("# earth_rate: removed\n");
    }
    if source.thermometer.is_sensor() {
        s.push_str("# thermometer: sensor\n");
    }
    let _ = writeln!(s, "# note: {TURN_ON}");
    let present: Vec<usize> = source.present().collect();
    let written = written(source);
    s.push_str(&columns::header(&written, &present));
    s.push('\n');
    for x in seconds {
        let _ = write!(s, "{}", x.time_s);
        columns::cells(&mut s, &written, &present, x);
        s.push('\n');
    }
    s
}

#[cfg(test)]
mod tests {
    use super::*;
    use hrg_core::bias::Coefficients;
    use hrg_simulate::{Plan, Profile};

    fn block() -> Calibration {
        let mut c = Calibration::uncalibrated();
        c.calibrated = true;
        c.axes.iter_mut().for_each(|a| a.coefficients = Coefficients::One([1.0, 20.0, 0.0, 0.5, 0.0, 0.0]));
        c
    }

    fn run() -> Recording {
        Plan::of(Profile::parse("20,30@2,1m").expect("fine"), 4, 5).simulate().recording
    }

    #[test]
    fn the_bias_of_a_second_holds_in_the_next() {
        let steps = Steps::new(&run()).expect("long enough");
        let seconds = correct(&block(), &steps);
        assert_eq!(seconds[0].corrected_dph, seconds[0].raw_dph, "no bias yet");
        for w in seconds.windows(2) {
            for a in 0..AXES {
                assert_eq!(w[1].corrected_dph[a].to_bits(), (w[1].raw_dph[a] - w[0].bias_dph[a]).to_bits());
            }
        }
        let moved = seconds.windows(2).filter(|w| w[0].bias_dph != w[1].bias_dph).count();
        assert!(moved > 200, "the bias changes from second to second: {moved}");
    }

    #[test]
    fn a_lost_frequency_is_lost_and_a_gap_is_not() {
        let mut r = run();
        r.frequency_hz[1][100..105].fill(f64::NAN);
        r.rate_dph.iter_mut().for_each(|rates| rates[120] = f64::NAN);
        let keep: Vec<usize> = (0..r.time_s.len()).filter(|k| !(150..160).contains(k)).collect();
        let pick = |v: &mut Vec<f64>| *v = keep.iter().map(|k| v[*k]).collect();
        pick(&mut r.time_s);
        r.frequency_hz.iter_mut().chain(&mut r.rate_dph).for_each(pick);
        r.optional.clear();
        let c = recording(&block(), &r).expect("usable");
        assert_eq!(c.seconds.len(), r.time_s.len(), "a row for a row");
        for (k, s) in c.seconds.iter().enumerate() {
            assert_eq!(s.time_s, r.time_s[k]);
            assert_eq!(s.status[1] & AxisStatus::FREQUENCY_LOST.bits() != 0, (100..105).contains(&k), "row {k}");
            assert_eq!(s.status[0] & AxisStatus::FREQUENCY_LOST.bits(), 0);
            assert_eq!(s.status[3] & UnitStatus::ADC_FAULT.bits() != 0, k == 120);
        }
        assert!(c.notes.iter().any(|n| n.starts_with("10 seconds have no row")), "{:?}", c.notes);
        // Written and read, it is a recording of corrected rates, and is not corrected twice.
        let text = to_csv(&r, "corrected on the desktop", 0.0, Some(&block()), &c.seconds);
        let again = Recording::parse(text.as_bytes()).expect("readable");
        assert!(again.corrected() && again.time_s.len() == c.seconds.len());
        for (k, s) in c.seconds.iter().enumerate().filter(|(k, _)| *k != 120) {
            assert_eq!((again.rate_dph[2][k] as f32).to_bits(), s.corrected_dph[2].to_bits(), "row {k}");
        }
        assert!(recording(&block(), &again).expect_err("refused").0.contains("corrected already"));
    }

    #[test]
    fn what_begins_late_says_so() {
        let mut r = run();
        r.time_s.iter_mut().for_each(|t| *t += 500.0);
        let notes = recording(&block(), &r).expect("usable").notes;
        assert!(notes.iter().any(|n| n.contains("begins 500 s after power-on")), "{notes:?}");
    }
}
