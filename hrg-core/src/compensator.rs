//! The three axes together: frequencies in, temperatures, their rates, biases and status out, once per model step.
//!
//! # Example
//! ```
//! use hrg_core::calibration::Calibration;
//! use hrg_core::compensator::Compensator;
//! use hrg_core::status::AxisStatus;
//!
//! let mut model = Compensator::new(Calibration::uncalibrated(), 0.0);
//! let output = model.step(&[Some(4900.0), Some(4892.0), None]);
//! // The default image corrects nothing, and says so; the third axis has no frequency.
//! assert_eq!(output.bias_dph, [0.0; 3]);
//! assert!(output.status[0].contains(AxisStatus::UNCALIBRATED));
//! assert!(output.status[2].contains(AxisStatus::FREQUENCY_LOST) && output.temperature_c[2].is_nan());
//! ```

use crate::bias;
use crate::calibration::{Axis, Calibration, DIRECTIONS, MAX_EFFECTS};
use crate::effects::{OnUnit, Sums};
use crate::frequency::StepFrequencies;
pub use crate::history::HOLD_S;
use crate::history::{self, Head, History, Kept, Past};
use crate::inputs::{self, Held, Quantities, QuantitySet, Seen};
use crate::rate_factors::Factors;
use crate::rate_of_change::WINDOW;
use crate::specific_force::SpecificForce;
use crate::status::AxisStatus;
use crate::thermal::{AxisThermal, Thermal, Thermometer};
use crate::visited::Ranges;
use crate::zero::Zero;
use crate::{AXES, MODEL_STEP_S};
use heapless::Vec;

/// Inputs beside the frequencies are computed.
const TAKES_INPUTS: bool = cfg!(feature = "inputs");

/// Result of one model step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Output {
    /// Temperatures, C (NaN before the first frequency).
    pub temperature_c: [f32; AXES],
    /// Rates of change, C per minute.
    pub ramp_c_per_min: [f32; AXES],
    /// Biases to subtract, deg/h. Always finite.
    pub bias_dph: [f32; AXES],
    /// Their standard uncertainties, deg/h, as the calibration states them ([`crate::calibration::Uncertainty`]); NaN where it does
    /// not. Of the constant, what changes from one power-on to the next is not in it unless the calibration had several.
    pub bias_std_dph: [f32; AXES],
    /// Factors of the rates once the bias is off.
    pub factors: Factors,
    /// Errors of the accelerometers.
    pub specific_force: SpecificForce,
    /// Status bits ([`AxisStatus`]).
    pub status: [AxisStatus; AXES],
    /// Time since power-on at the end of the step, over restarts, s.
    pub on_for_s: f32,
}

impl Output {
    /// `true` if both are the same to the last bit.
    #[must_use]
    pub fn same(&self, other: &Self) -> bool {
        let equal = |a: &[f32; AXES], b: &[f32; AXES]| a.iter().zip(b).all(|(x, y)| x.to_bits() == y.to_bits());
        equal(&self.bias_dph, &other.bias_dph)
            && equal(&self.bias_std_dph, &other.bias_std_dph)
            && equal(&self.temperature_c, &other.temperature_c)
            && equal(&self.ramp_c_per_min, &other.ramp_c_per_min)
            && self.factors.same(&other.factors)
            && self.specific_force.same(&other.specific_force)
            && self.status == other.status
            && self.on_for_s.to_bits() == other.on_for_s.to_bits()
    }
}

/// One model step of two compensators that were made alike and have seen the same, in separate memory. `None` where they
/// differ in any bit: memory is corrupted, and neither is to be trusted.
pub fn update_both<P: Past>(channels: [&mut Model<P>; 2], step: &StepFrequencies) -> Option<Output> {
    let [a, b] = channels.map(|channel| channel.update(step));
    a.same(&b).then_some(a)
}

/// The bias model of a unit, running, with two more pasts of each effect.
pub type Compensator = Model<History>;

/// The bias model of a unit, running.
#[derive(Debug, Clone)]
pub struct Model<P> {
    calibration: Calibration,
    thermometer: Thermometer,
    /// Of each effect of the calibration: its states.
    running: Vec<OnUnit, MAX_EFFECTS>,
    /// `UNCALIBRATED` for an axis of which the calibration holds nothing.
    holds: [AxisStatus; AXES],
    /// Axes with an effect that looks at the others.
    looks_at_neighbours: [bool; AXES],
    /// Inputs beside the frequencies as they were given last, and the last good ones.
    given: Quantities,
    held: Held,
    /// Uncertainty of the unit's past.
    past: P,
    /// Steps that were kept, and resets since power-on.
    kept: u32,
    resets: u32,
    /// For how many more steps a change beyond the calibrated range is in the slope's window.
    invalid_steps: [u8; AXES],
    bias_dph: [f32; AXES],
    bias_std_dph: [f32; AXES],
    trim_dph: [f32; AXES],
    /// Constants that were renewed in the field.
    zero: Zero,
    /// Scale factors and misalignments of the last step that had a temperature, with their status.
    scale: [f32; AXES],
    coupling: [[f32; 2]; AXES],
    factor_status: [AxisStatus; AXES],
    /// Errors of the accelerometers at the last step that had a temperature: bias, scale, misalignments.
    force: [(f32, f32, [f32; 2]); AXES],
    force_outside: [bool; AXES],
}

impl<P: Past> Model<P> {
    /// Starts in equilibrium with the first temperature.
    // In line: what builds a static one should need the stack for it once.
    #[inline]
    #[must_use]
    pub fn new(calibration: Calibration, power_on_s: f32) -> Self {
        let curves = [calibration.axes[0].curve, calibration.axes[1].curve, calibration.axes[2].curve];
        let mut running: Vec<OnUnit, MAX_EFFECTS> = Vec::new();
        let mut looks_at_neighbours = [false; AXES];
        for term in &calibration.effects {
            // `Calibration::check` has refused what no unit knows.
            let Some(one) = OnUnit::new(term.id, &term.parameters, term.start, MODEL_STEP_S) else { break };
            for (looks, gains) in looks_at_neighbours.iter_mut().zip(&term.gains) {
                *looks |= one.looks_at_neighbours() && gains.iter().any(|g| *g != 0.0);
            }
            let _ = running.push(one);
        }
        Self {
            given: Quantities::NONE,
            held: Held::new(&calibration),
            holds: [calibration.status_of(0), calibration.status_of(1), calibration.status_of(2)],
            past: P::unknown(&calibration.effects),
            calibration,
            thermometer: Thermometer::new(curves, power_on_s),
            looks_at_neighbours,
            running,
            kept: 0,
            resets: 0,
            invalid_steps: [0; AXES],
            bias_dph: [0.0; AXES],
            bias_std_dph: [f32::NAN; AXES],
            trim_dph: [0.0; AXES],
            zero: Zero::default(),
            scale: [1.0; AXES],
            coupling: [[0.0; 2]; AXES],
            factor_status: [AxisStatus::empty(); AXES],
            force: [(0.0, 1.0, [0.0; 2]); AXES],
            force_outside: [false; AXES],
        }
    }

    /// Writes all states as words (`put` is given each with its place, 0 to [`history::KEPT_WORDS`] - 1), for memory that a reset
    /// leaves alone.
    pub fn keep(&mut self, put: impl FnMut(usize, u32)) {
        self.kept = self.kept.wrapping_add(1);
        let head = Head { sequence: self.kept, time_s: self.thermometer.now().time_s, resets: self.resets };
        history::keep(head, &self.calibration.effects, &mut self.running, &mut self.past, put);
    }

    /// Goes on from states that were kept before a reset of some hundred milliseconds. An effect of which none were kept, as the
    /// calibration is another one, begins anew. Before the first step.
    pub fn resume<W: Fn(usize) -> u32>(&mut self, kept: &Kept<W>) {
        self.kept = kept.head.sequence;
        self.resets = kept.head.resets.wrapping_add(1);
        self.thermometer.powered_on_before(kept.head.time_s + history::RESTART_S);
        history::resume(kept, &self.calibration.effects, &mut self.running, &mut self.past);
    }

    /// Time since power-on, over restarts, s.
    #[must_use]
    pub fn on_for_s(&self) -> f32 {
        self.thermometer.now().time_s
    }

    /// Resets since power-on, as far as states were kept over them.
    #[must_use]
    pub fn resets(&self) -> u32 {
        self.resets
    }

    /// Adds a constant to the bias of each axis from the next step on, deg/h: what an alignment has found. It replaces the
    /// one before.
    pub fn set_trim(&mut self, trim_dph: [f32; AXES]) {
        if trim_dph.iter().all(|t| t.is_finite()) {
            self.trim_dph = trim_dph;
        }
    }

    /// Adds constants that were renewed in the field, from the next step on. They replace those before; impossible ones are left out.
    pub fn set_zero(&mut self, zero: Zero) {
        if zero.possible() {
            self.zero = zero;
        }
    }

    /// Sets the inputs beside the frequencies for the steps that come ([`crate::inputs`]): before each step.
    pub fn set_inputs(&mut self, quantities: Quantities) {
        self.given = quantities;
    }

    /// The calibration in use.
    #[must_use]
    pub fn calibration(&self) -> &Calibration {
        &self.calibration
    }

    /// One model step from what the counters gave: as [`step`](Self::step), with edge errors flagged.
    // A function of its own in the ELF, so that the virtual board can count what it costs.
    #[inline(never)]
    pub fn update(&mut self, step: &StepFrequencies) -> Output {
        self.advance(&step.frequency_hz, |k| step.rejected[k] + step.missing[k] > 0)
    }

    /// One model step, for a unit with a frequency counter of its own: the mean frequency of the last second in Hz, `None` where it is lost.
    /// To be called once in each second ([`MODEL_STEP_S`]), also in seconds where all are lost: the model counts time by
    /// its steps.
    pub fn step(&mut self, frequency_hz: &[Option<f64>; AXES]) -> Output {
        self.advance(frequency_hz, |_| false)
    }

    #[inline(always)]
    fn advance(&mut self, frequency_hz: &[Option<f64>; AXES], edge_errors: impl Fn(usize) -> bool) -> Output {
        self.thermometer.step(frequency_hz);
        let thermal = self.thermometer.now();
        let scaling = &self.calibration.scaling;
        let seen = if TAKES_INPUTS { self.held.see(&self.calibration.inputs, &self.given) } else { Seen::NONE };
        let (bias_dph, along_dph) = biases(&self.calibration, &mut self.running, thermal, &seen, |k| self.held.uses(k));
        let unknown = self.past.step(&self.calibration, (thermal, &seen), &mut self.running);
        let [x, y, z] = &thermal.axes;
        let mut output = Output {
            temperature_c: [x.state.temperature_c, y.state.temperature_c, z.state.temperature_c],
            ramp_c_per_min: [x.state.ramp_c_per_min, y.state.ramp_c_per_min, z.state.ramp_c_per_min],
            bias_dph,
            bias_std_dph: [f32::NAN; AXES],
            factors: Factors::UNIT,
            specific_force: SpecificForce::NONE,
            on_for_s: thermal.time_s,
            status: self.holds,
        };
        for k in 0..AXES {
            let now = &thermal.axes[k];
            output.status[k] |=
                self.calibration.axes[k].status(now, self.thermometer.change_c(k), &mut self.invalid_steps[k]);
            let of_inputs = || self.held.more_dph2(k, &self.calibration.inputs, seen.outside);
            let input_dph2 = TAKES_INPUTS.then(of_inputs).flatten();
            if input_dph2.is_some() {
                output.status[k] |= AxisStatus::INPUT;
            }
            // Bridging an outage, the last bias is held, whatever the states do.
            if now.age == 0 {
                self.bias_dph[k] = bias_dph[k];
                let along = along_dph.map(|d| d[k]);
                let past_dph = unknown.std_dph[k];
                let axis = &self.calibration.axes[k];
                let unvisited_dph2 = axis.unvisited_dph2(scaling, &now.state);
                if unvisited_dph2.is_some() && now.known {
                    output.status[k] |= AxisStatus::EXTRAPOLATED;
                }
                let more_dph2 = past_dph * past_dph + unvisited_dph2.unwrap_or(0.0) + input_dph2.unwrap_or(0.0);
                self.bias_std_dph[k] = axis.bias_std_dph(scaling, &now.state, along, more_dph2);
                if !bias_dph[k].is_finite() {
                    self.bias_dph[k] = 0.0;
                    output.status[k] |= AxisStatus::UNCALIBRATED;
                }
            }
            let fresh = now.age == 0 && now.known;
            if let Some(rates) = self.calibration.rates.as_ref().filter(|_| fresh) {
                (self.scale[k], self.coupling[k], self.factor_status[k]) = rates[k].at(scaling, &now.state);
            }
            if let Some(all) = self.calibration.specific_force.as_ref().filter(|_| fresh) {
                let (bias, scale, coupling, status) = all[k].at(scaling, &now.state);
                self.force[k] = (bias, scale, coupling);
                self.force_outside[k] = !status.is_empty();
            }
            output.status[k] |= self.factor_status[k];
            if unknown.axes[k] {
                output.status[k] |= AxisStatus::HISTORY_UNKNOWN;
            }
            if edge_errors(k) {
                output.status[k] |= AxisStatus::EDGE_ERRORS;
            }
            output.bias_dph[k] = self.bias_dph[k] + self.trim_dph[k] + self.zero.constant_dph[k];
            let (of_model, of_zero) = (self.bias_std_dph[k], self.zero.std_dph[k]);
            output.bias_std_dph[k] =
                if of_zero > 0.0 { libm::sqrtf(of_model * of_model + of_zero * of_zero) } else { of_model };
        }
        output.factors = Factors::new(self.scale, self.coupling);
        if self.calibration.specific_force.is_some() {
            output.specific_force = SpecificForce {
                bias_mps2: self.force.map(|f| f.0),
                factors: Factors::new(self.force.map(|f| f.1), self.force.map(|f| f.2)),
                outside: self.force_outside,
            };
        }
        let untrusted = output.status.map(|s| s.intersects(AxisStatus::UNTRUSTED_TEMPERATURE));
        for (k, (status, looks)) in output.status.iter_mut().zip(self.looks_at_neighbours).enumerate() {
            if looks && untrusted.iter().enumerate().any(|(j, untrusted)| j != k && *untrusted) {
                *status |= AxisStatus::NEIGHBOUR;
            }
        }
        output
    }
}

/// Bias of each axis, deg/h, and what the effects add to each direction of its uncertainty. `uses`: the inputs that an axis uses.
#[inline(always)]
fn biases(
    calibration: &Calibration,
    running: &mut [OnUnit],
    thermal: &Thermal,
    seen: &Seen,
    uses: impl Fn(usize) -> QuantitySet,
) -> ([f32; AXES], [[f32; AXES]; DIRECTIONS]) {
    let scaling = &calibration.scaling;
    let mut bias_dph = [0.0; AXES];
    for (k, bias) in bias_dph.iter_mut().enumerate() {
        *bias = calibration.axes[k].coefficients.bias_dph(scaling, &thermal.axes[k].state);
    }
    let mut along_dph = [[0.0; AXES]; DIRECTIONS];
    for (term, running) in calibration.effects.iter().zip(running) {
        let sums = &mut Sums {
            gains: &term.gains,
            bias_dph: &mut bias_dph,
            directions: &term.directions,
            along_dph: &mut along_dph,
        };
        running.add_bias_dph(scaling, thermal, &seen.values, sums);
    }
    if TAKES_INPUTS && !seen.missing.is_empty() {
        for (k, bias) in bias_dph.iter_mut().enumerate() {
            let state = &thermal.axes[k].state;
            let x = bias::regressors(scaling, state.temperature_c, state.ramp_c_per_min);
            *bias += inputs::expected_dph(&calibration.inputs, seen.missing.intersection(uses(k)), k, &x);
        }
    }
    (bias_dph, along_dph)
}

impl Axis {
    /// Ranges of the fit.
    #[inline]
    #[must_use]
    pub fn ranges(&self) -> Ranges {
        Ranges {
            from_c: self.curve.valid_from_c,
            to_c: self.curve.valid_to_c,
            from_c_per_min: self.valid_from_c_per_min,
            to_c_per_min: self.valid_to_c_per_min,
        }
    }

    /// Variance that comes on top in a state which the fit has not seen, (deg/h)^2; `None` in one that it has.
    #[inline(never)]
    fn unvisited_dph2(&self, scaling: &bias::Scaling, state: &bias::State) -> Option<f32> {
        let ranges = self.ranges();
        let bend_dph = || {
            let square = match &self.coefficients {
                bias::Coefficients::One(k) => k[2],
                bias::Coefficients::CoolingHeating(cooling, heating) => 0.5 * (cooling[2] + heating[2]),
                // (An image of another model does not state its uncertainty.)
                _ => 0.0,
            };
            let eighth_u = ranges.eighth_c() / scaling.t_scale_c;
            2.0 * square * eighth_u * eighth_u
        };
        self.visited.more_dph2(&ranges, state.temperature_c, state.ramp_c_per_min, bend_dph)
    }

    /// Standard uncertainty of the bias, deg/h: `along_dph` is what the effects add to each direction, `more_dph2` a variance that comes on
    /// top. NaN where it is not stated.
    #[inline(never)]
    fn bias_std_dph(
        &self,
        scaling: &bias::Scaling,
        state: &bias::State,
        along_dph: [f32; DIRECTIONS],
        more_dph2: f32,
    ) -> f32 {
        let u = &self.uncertainty;
        if u.rest_dph2 <= 0.0 {
            return f32::NAN;
        }
        let x = bias::regressors(scaling, state.temperature_c, state.ramp_c_per_min);
        let mut variance = u.rest_dph2 + more_dph2;
        for (k, effects) in u.baseline.iter().zip(along_dph) {
            let d = bias::dot(k, &x) + effects;
            variance += d * d;
        }
        libm::sqrtf(variance)
    }

    /// Status of an axis in a thermal state whose temperature has changed by `change_c` in this step. `invalid_steps`: for how many
    /// more steps its slope is invalid.
    #[inline(always)]
    fn status(&self, now: &AxisThermal, change_c: f32, invalid_steps: &mut u8) -> AxisStatus {
        let mut s = AxisStatus::empty();
        if !now.settled {
            s |= AxisStatus::SETTLING;
        }
        if now.age > 0 {
            s |= AxisStatus::FREQUENCY_LOST;
        }
        if !now.known || now.age > HOLD_S {
            s |= AxisStatus::TEMPERATURE_STALE;
        }
        if !now.known {
            return s;
        }
        let (t, r) = (now.state.temperature_c, now.state.ramp_c_per_min);
        if t < self.curve.valid_from_c || t > self.curve.valid_to_c {
            s |= AxisStatus::TEMPERATURE_RANGE;
        }
        let (slowest, fastest) = (self.valid_from_c_per_min, self.valid_to_c_per_min);
        let beyond = |r: f32| r < slowest || r > fastest;
        // The slope takes seconds to show a ramp; a step of twice the range shows at once, and makes the slope invalid for as
        // long as it is in the window. (An outage may hide the way back: then the time counts from its end.)
        if beyond(change_c * (0.5 * 60.0 / MODEL_STEP_S)) || (now.age > 0 && *invalid_steps > 0) {
            *invalid_steps = WINDOW as u8;
        } else if *invalid_steps > 0 {
            *invalid_steps -= 1;
        }
        if *invalid_steps > 0 || beyond(r) {
            s |= AxisStatus::RAMP_RANGE;
        }
        s
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bias::Coefficients;
    use crate::calibration::EffectTerm;
    use crate::effects::{by_id, MAX_OUTPUTS};
    use crate::half::Half;
    use crate::thermal::ACCEPT_STEPS;

    fn calibrated() -> Calibration {
        let mut c = Calibration::uncalibrated();
        c.calibrated = true;
        for a in &mut c.axes {
            a.coefficients = Coefficients::One([1.0, 2.0, 0.0, 0.5, 0.0, 0.0]);
        }
        c
    }

    const F: [Option<f64>; 3] = [Some(4900.0), Some(4892.0), Some(4703.6)];

    #[test]
    fn bias_of_a_soak() {
        let mut c = Compensator::new(calibrated(), 0.0);
        let mut out = c.step(&F);
        for _ in 0..70 {
            out = c.step(&F);
        }
        assert_eq!(out.status, [AxisStatus::empty(); 3]);
        let t = out.temperature_c[0];
        assert!((out.bias_dph[0] - (1.0 + 2.0 * (t - 10.0) / 45.0)).abs() < 1e-5);
    }

    #[test]
    fn an_axis_of_which_the_image_holds_nothing_is_uncalibrated() {
        let mut image = calibrated();
        image.axes[0].coefficients = Coefficients::One([0.0; crate::bias::TERMS]);
        image.axes[2].coefficients = Coefficients::One([0.0; crate::bias::TERMS]);
        let mut term = EffectTerm::new(by_id(3).expect("in the list").id, [-40.0, 60.0]);
        term.gains[2][0] = 0.1;
        image.effects.push(term).expect("room");
        let status = Compensator::new(image, 0.0).step(&F).status;
        assert_eq!(status.map(|s| s.contains(AxisStatus::UNCALIBRATED)), [true, false, false]);
    }

    #[test]
    fn factors_follow_the_temperature_are_held_without_one_and_are_compared() {
        let plain = Compensator::new(calibrated(), 0.0).step(&F);
        assert_eq!(plain.factors, Factors::UNIT);
        let image = Calibration { rates: crate::calibration::tests::of_rates().rates, ..calibrated() };
        let mut c = Compensator::new(image.clone(), 0.0);
        for _ in 0..30 {
            c.step(&F);
        }
        let out = c.step(&F);
        assert_eq!(out.status, [AxisStatus::empty(); 3]);
        let rates = image.rates.expect("stated");
        for a in 0..AXES {
            let state = c.thermometer.now().axes[a].state;
            let (scale, coupling, _) = rates[a].at(&image.scaling, &state);
            assert_eq!((out.factors.scale()[a], out.factors.coupling()[a]), (scale, coupling));
            assert!(scale != 1.0 && coupling[0] > 2e-4);
        }
        // (The biases are those of an image without factors.)
        assert_eq!(out.bias_dph, {
            let mut p = Compensator::new(calibrated(), 0.0);
            for _ in 0..30 {
                p.step(&F);
            }
            p.step(&F).bias_dph
        });
        assert_eq!(c.step(&[F[0], None, F[2]]).factors.scale()[1].to_bits(), out.factors.scale()[1].to_bits());
        let mut other = out;
        other.factors =
            Factors::new(out.factors.scale().map(|s| f32::from_bits(s.to_bits() ^ 1)), out.factors.coupling());
        assert!(out.same(&out) && !out.same(&other), "the two models are compared in them, too");
        // Outside their own range, which is narrower than that of the bias.
        let mut narrow = image;
        narrow.rates.as_mut().expect("stated")[2].rate_valid_to_c = -10.0;
        let flagged = Compensator::new(narrow, 0.0).step(&F).status;
        assert!(flagged[2].contains(AxisStatus::SCALE_FACTOR) && !flagged[0].contains(AxisStatus::SCALE_FACTOR));
    }

    #[test]
    fn the_uncertainty_is_that_of_the_gains() {
        assert!(Compensator::new(calibrated(), 0.0).step(&F).bias_std_dph.iter().all(|s| s.is_nan()), "not stated");
        let mut image = calibrated();
        // An effect with three gains of a known covariance: two independent directions, one of them along the baseline's slope too.
        let shape = by_id(3).expect("in the list");
        let mut term = EffectTerm::new(shape.id, [-40.0, 60.0]);
        term.directions[0][1][0] = Half::of(0.5);
        term.directions[1][1][1] = Half::of(-0.25);
        image.axes[1].uncertainty.rest_dph2 = 0.04;
        image.axes[1].uncertainty.baseline[0][1] = 2.0;
        image.effects.push(term).expect("room");
        let mut c = Compensator::new(image.clone(), 0.0);
        let out = c.step(&F);
        assert!(out.bias_std_dph[0].is_nan() && out.bias_std_dph[2].is_nan());
        // By the definition: the regressors of the effect from its own code, those of the baseline from theirs.
        let state = c.thermometer.now().axes[1].state;
        let x = bias::regressors(&image.scaling, state.temperature_c, state.ramp_c_per_min);
        let mut one = crate::effects::Running::new(shape.id, &[-40.0, 60.0], MODEL_STEP_S).expect("in the list");
        let inputs = crate::effects::Inputs {
            scaling: &image.scaling,
            thermal: c.thermometer.now(),
            axis: 1,
            quantities: &Quantities::NONE,
        };
        let e = one.step(&inputs);
        let (first, second) = (2.0 * x[1] + 0.5 * e[0], -0.25 * e[1]);
        let wanted = (0.04 + first * first + second * second).sqrt();
        assert!((out.bias_std_dph[1] - wanted).abs() < 1e-5 * wanted, "{} {wanted}", out.bias_std_dph[1]);
        // Bridging an outage, it is held with the bias.
        assert_eq!(c.step(&[F[0], None, F[2]]).bias_std_dph[1], out.bias_std_dph[1]);
    }

    #[test]
    fn a_lost_axis_is_bridged_then_stale_and_others_do_not_notice() {
        let (mut a, mut b) = (Compensator::new(calibrated(), 0.0), Compensator::new(calibrated(), 0.0));
        for k in 0..100u32 {
            let lost = (40..60).contains(&k);
            let x = a.step(&if lost { [None, F[1], F[2]] } else { F });
            let y = b.step(&F);
            assert_eq!(
                (x.bias_dph[1], x.bias_dph[2], x.status[1], x.status[2]),
                (y.bias_dph[1], y.bias_dph[2], y.status[1], y.status[2])
            );
            assert_eq!(x.status[0].contains(AxisStatus::FREQUENCY_LOST), lost);
            assert_eq!(x.status[0].contains(AxisStatus::TEMPERATURE_STALE), (50..60).contains(&k));
            assert_eq!(x.bias_dph[0], y.bias_dph[0]);
        }
    }

    #[test]
    fn a_jump_is_not_accepted_at_once_and_settles_anew() {
        let mut c = Compensator::new(calibrated(), 0.0);
        for _ in 0..40 {
            let _ = c.step(&F);
        }
        let before = c.step(&F);
        let jumped = [F[0].map(|f| f + 1.0), F[1], F[2]];
        for k in 0..100u32 {
            let out = c.step(&jumped);
            assert_eq!(out.status[1..], [AxisStatus::empty(); 2]);
            let flags = if k + 1 < u32::from(ACCEPT_STEPS) {
                assert_eq!(out.bias_dph, before.bias_dph, "held");
                if k >= u32::from(HOLD_S) {
                    AxisStatus::FREQUENCY_LOST | AxisStatus::TEMPERATURE_STALE
                } else {
                    AxisStatus::FREQUENCY_LOST
                }
            } else if k + 1 < u32::from(ACCEPT_STEPS) + crate::rate_of_change::WINDOW as u32 - 1 {
                AxisStatus::SETTLING
            } else {
                AxisStatus::empty()
            };
            assert_eq!(
                out.status[0] & !AxisStatus::SETTLING | flags & AxisStatus::SETTLING,
                flags,
                "step {k}: {:?}",
                out.status[0]
            );
            assert!(out.ramp_c_per_min[0].abs() < 1e-6, "the jump is no rate of change");
        }
        // One wild second changes nothing but its own flag.
        let (mut a, mut b) = (c.clone(), c);
        let wild = a.step(&F);
        assert_eq!(wild.status[0], AxisStatus::FREQUENCY_LOST);
        let _ = b.step(&[None, F[1], F[2]]);
        for _ in 0..30 {
            assert!(a.step(&jumped).same(&b.step(&jumped)));
        }
    }

    #[test]
    fn no_slope_is_trusted_that_was_made_of_a_jump_or_of_nothing() {
        // A frequency that runs away and comes back, and one that was away for long: as long as the slope is not that of the
        // resonator, it is flagged.
        let mut image = calibrated();
        image.axes.iter_mut().for_each(|a| (a.valid_from_c_per_min, a.valid_to_c_per_min) = (-1.0, 1.0));
        for lost in [0, 3, 8, 12, 40] {
            for off in [0.1, 0.3, 1.0, 2.0] {
                let mut c = Compensator::new(image.clone(), 0.0);
                for k in 0..200u32 {
                    let away = (50..55).contains(&k);
                    let f = F[0].map(|f| f + 0.006 * f64::from(k) + if away { off } else { 0.0 });
                    let out = c.step(&[f.filter(|_| !(55..55 + lost).contains(&k)), F[1], F[2]]);
                    // 0.006 Hz/s: about 0.9 C/min.
                    let error = (out.ramp_c_per_min[0] - 0.9).abs();
                    assert!(
                        error < 0.2 || !out.status[0].is_empty(),
                        "lost {lost}, off {off}, step {k}: {error} C/min unsaid"
                    );
                    assert!(
                        k < 160 || out.status[0].is_empty(),
                        "lost {lost}, off {off}, step {k}: {:?}",
                        out.status[0]
                    );
                }
            }
        }
    }

    #[test]
    fn redundant_channels_that_differ_are_found() {
        let (mut a, mut b) = (Compensator::new(calibrated(), 0.0), Compensator::new(calibrated(), 0.0));
        let step = StepFrequencies { step: 0, end_ticks: 0, frequency_hz: F, rejected: [0; 3], missing: [0; 3] };
        assert!(update_both([&mut a, &mut b], &step).is_some());
        b.calibration.axes[2].coefficients = Coefficients::One([1.0, 2.0, 0.0, 0.5, f32::MIN_POSITIVE, 0.0]);
        // Nothing of it shows yet; a difference in the last bit does.
        assert!(update_both([&mut a, &mut b], &step).is_some());
        b.calibration.axes[2].coefficients =
            Coefficients::One([f32::from_bits(1.0f32.to_bits() + 1), 2.0, 0.0, 0.5, 0.0, 0.0]);
        assert!(update_both([&mut a, &mut b], &step).is_none());
    }

    #[test]
    fn a_frequency_of_no_resonator_leaves_no_trace() {
        let mut image = calibrated();
        let lag = by_id(4).expect("in the list");
        let mut gains = [[0.0; MAX_OUTPUTS]; AXES];
        gains[0][0] = 1.0;
        let term = EffectTerm { gains, ..EffectTerm::new(lag.id, [900.0, 0.0]) };
        image.effects.push(term).expect("room");
        let (mut a, mut b) = (Compensator::new(image.clone(), 0.0), Compensator::new(image, 0.0));
        for k in 0..100u32 {
            let wild = (30..60).contains(&k);
            let x = a.step(&[if wild { Some(11_000.0) } else { F[0] }, F[1], F[2]]);
            let y = b.step(&[F[0].filter(|_| !wild), F[1], F[2]]);
            assert!(x.same(&y), "step {k}");
        }
    }

    /// An image with a drive voltage of the second axis, 10 deg/h per V about 2 V.
    fn of_drive() -> Calibration {
        use crate::inputs::{drive, Input};
        let mut image = calibrated();
        image.axes[1].uncertainty.rest_dph2 = 0.01;
        let id = crate::effects::EffectId::by_name("drive-amplitude").expect("in the list").facts().id;
        let mut term = EffectTerm::new(id, [0.0; 2]);
        term.gains[1][0] = 10.0;
        image.effects.push(term).expect("room");
        let input = Input {
            quantity: drive(1),
            reference: 2.0,
            valid_from: 1.5,
            valid_to: 3.0,
            most_equal: 20,
            expected: [[0.0; 6], [0.25, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0; 6]],
            without_dph: [0.0, 1.5, 0.0],
            ..Input::default()
        };
        image.inputs.push(input).expect("room");
        image
    }

    #[test]
    fn an_input_is_used_held_limited_and_flagged() {
        use crate::inputs::{drive, InputBank};
        let image = of_drive();
        assert_eq!(Calibration::from_bytes(&image.to_bytes().expect("fits")), Ok(image.clone()));
        let (mut c, mut plain) = (Compensator::new(image, 0.0), Compensator::new(calibrated(), 0.0));
        let mut bank = InputBank::default();
        // Nothing has come: the uncertainty holds all that is not told.
        let mut step = |value: Option<f32>| {
            value.into_iter().for_each(|v| bank.set(drive(1), v));
            c.set_inputs(bank.step());
            let (with, without) = (c.step(&F), plain.step(&F));
            assert_eq!([with.bias_dph[0], with.bias_dph[2]], [without.bias_dph[0], without.bias_dph[2]]);
            assert!(!with.status[0].contains(AxisStatus::INPUT) && !with.status[2].contains(AxisStatus::INPUT));
            let flagged = with.status[1].contains(AxisStatus::INPUT);
            (with.bias_dph[1] - without.bias_dph[1], with.bias_std_dph[1], flagged)
        };
        let near = |(bias, std, flag): (f32, f32, bool), wanted: (f32, f32, bool)| {
            assert!(
                (bias - wanted.0).abs() < 1e-5 && (std - wanted.1).abs() < 1e-5 && flag == wanted.2,
                "{bias} {std} {flag}"
            );
        };
        let all = (0.01f32 + 1.5 * 1.5).sqrt();
        // (What temperature and ramp tell of it.)
        let told = 0.25;
        near(step(None), (told, all, true));
        near(step(Some(2.5)), (5.0, 0.1, false));
        near(step(Some(1.75)), (-2.5, 0.1, false));
        // It counts for three seconds, then it is missing.
        near(step(None), (-2.5, 0.1, false));
        near(step(None), (-2.5, 0.1, false));
        near(step(None), (told, all, true));
        // Outside its range it is used half a width beyond, and flagged; further away it is none.
        near(step(Some(3.5)), (15.0, all, true));
        near(step(Some(9.0)), (told, all, true));
        near(step(Some(f32::NAN)), (told, all, true));
        near(step(Some(2.0)), (0.0, 0.1, false));
        // One that stands still for longer than it ever did is none, until it moves.
        for _ in 0..20 {
            near(step(Some(2.0)), (0.0, 0.1, false));
        }
        near(step(Some(2.0)), (told, all, true));
        near(step(Some(2.1)), (1.0, 0.1, false));
    }

    #[test]
    fn a_unit_without_the_input_refuses_the_image() {
        use crate::inputs::{drive, needed, QuantitySet};
        let image = of_drive();
        assert_eq!(needed(&image), QuantitySet::one(drive(1)));
        assert_eq!(image.inputs_among(QuantitySet::all()), Ok(()));
        let refused = crate::calibration::ImageError::LacksInput(drive(1));
        assert_eq!(image.inputs_among(QuantitySet::SUPPLY), Err(refused));
        // One that does not describe what it needs is refused everywhere.
        let mut undescribed = image;
        undescribed.inputs.clear();
        assert_eq!(undescribed.check(), Err(refused));
    }

    #[test]
    fn lags_of_an_input_are_kept_over_a_restart_and_their_past_is_unknown_at_first() {
        use crate::history::{Kept, KEPT_WORDS};
        use crate::inputs::{Input, InputBank, SUPPLY};
        let mut image = calibrated();
        let id = crate::effects::EffectId::by_name("recorded-quantity").expect("in the list").facts().id;
        let mut term = EffectTerm::new(id, [f32::from(SUPPLY), 0.0]);
        term.gains[0][3] = 4.0;
        image.effects.push(term).expect("room");
        let input = Input {
            quantity: SUPPLY,
            reference: 5.0,
            valid_from: 4.0,
            valid_to: 6.0,
            without_dph: [1.0; 3],
            ..Input::default()
        };
        image.inputs.push(input).expect("room");
        let mut bank = InputBank::default();
        let run = |c: &mut Compensator, bank: &mut InputBank, v: f32, steps: u32| {
            let mut out = None;
            for _ in 0..steps {
                bank.set(SUPPLY, v);
                c.set_inputs(bank.step());
                out = Some(c.step(&F));
            }
            out.expect("steps")
        };
        let mut c = Compensator::new(image.clone(), 0.0);
        let first = run(&mut c, &mut bank, 5.5, 60);
        assert!(
            first.status[0].contains(AxisStatus::HISTORY_UNKNOWN)
                && !first.status[1].contains(AxisStatus::HISTORY_UNKNOWN)
        );
        let late = run(&mut c, &mut bank, 4.5, 1000);
        assert!(!late.status[0].contains(AxisStatus::HISTORY_UNKNOWN), "three of its 300 s have passed");
        let mut words = [0; KEPT_WORDS];
        c.keep(|k, word| words[k] = word);
        let mut again = Compensator::new(image, 0.0);
        again.resume(&Kept::of(|k| words[k]).expect("kept"));
        let (on, after) = (run(&mut c, &mut bank, 4.5, 1), run(&mut again, &mut bank, 4.5, 1));
        assert_eq!(on.bias_dph[0].to_bits(), after.bias_dph[0].to_bits());
    }

    #[test]
    fn an_unknown_past_is_flagged() {
        let out = Compensator::new(calibrated(), 0.0).step(&[None, Some(f64::NAN), Some(1e300)]);
        for k in 0..3 {
            assert!(out.bias_dph[k].is_finite());
            assert!(!out.status[k].is_empty());
        }
    }
}
