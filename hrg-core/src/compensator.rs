//! The three axes together: frequencies in, temperatures, their rates, biases and status out, once per model step.

use crate::bias::State;
use crate::calibration::{Axis, Calibration, MAX_EFFECTS};
use crate::effects::OnUnit;
use crate::frequency::StepFrequencies;
use crate::rate_of_change::{Difference, SlopeWindow, WINDOW};
use crate::status::axis;
use crate::temperature::TemperatureLaw;
use crate::{AXES, MODEL_STEP_S};
use heapless::Vec;

/// A lost frequency is bridged for this long, with the last temperature and bias held and flagged
/// [`axis::FREQUENCY_LOST`]; after it [`axis::TEMPERATURE_STALE`] joins. In model steps (seconds).
pub const HOLD_S: u16 = 10;

/// A frequency whose temperature lies further than this outside the calibrated range, C, is no resonator's and is taken for
/// lost: believed, it would stay in the states of lags for hours. Nearer, it is used and flagged [`axis::TEMPERATURE_RANGE`].
pub const BEYOND_C: f32 = 50.0;

/// A resonator of some grams does not change its temperature faster than this, C per model step: a frequency that says so
/// is not believed at once. (30 C per minute; a chamber does 5, and a unit behind its case less.)
pub const MAX_STEP_C: f32 = 0.5;

/// A frequency that jumped is taken for lost until it has stayed where it is for this many model steps. Then it is believed,
/// and its rate of change starts anew (flagged [`axis::SETTLING`]).
pub const BELIEVE_STEPS: u8 = 30;

/// One axis in one model step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisThermal {
    /// What a bias model may look at: of the last measured frequency where the frequency is lost now.
    pub state: State,
    /// Whether the axis has had a frequency at all; without, its temperature is NaN and the rest of its state zero.
    pub known: bool,
    /// Steps since the frequency was last measured, up to 18 hours.
    pub age: u16,
    /// Whether the window of the slope is full.
    pub settled: bool,
}

impl AxisThermal {
    const UNKNOWN: Self = Self {
        state: State {
            temperature_c: f32::NAN,
            rate_c_per_min: 0.0,
            difference_c_per_min: 0.0,
            frequency_u: 0.0,
            frequency_u_per_min: 0.0,
        },
        known: false,
        age: 0,
        settled: false,
    };

    /// Steps since the last measured frequency, the coming one included.
    #[inline]
    fn since(&self) -> u16 {
        self.age.saturating_add(1)
    }
}

/// The three axes in one model step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Thermal {
    /// Axis by axis.
    pub axes: [AxisThermal; AXES],
    /// Time since power-on at the end of the step, s.
    pub time_s: f32,
}

/// One resonator as a thermometer.
#[derive(Debug, Clone)]
struct Channel {
    law: TemperatureLaw,
    /// No resonator is further from the middle of its law's range than this, C.
    middle_c: f32,
    reach_c: f32,
    window: SlopeWindow,
    difference: Difference,
    /// Slope of temperature by normalised frequency at the last one measured, C.
    slope_c: f32,
    /// A temperature after a jump, and for how many steps it has stayed; 0: there is no doubt.
    doubted_c: f32,
    stayed: u8,
    /// Change of temperature since the last step that had one, per step, C: says sooner than the slope that it changes too
    /// fast.
    change_c: f32,
}

impl Channel {
    fn new(law: TemperatureLaw) -> Self {
        Self {
            middle_c: 0.5 * (law.min_c + law.max_c),
            reach_c: 0.5 * (law.max_c - law.min_c) + BEYOND_C,
            law,
            window: SlopeWindow::default(),
            difference: Difference::default(),
            slope_c: 0.0,
            doubted_c: 0.0,
            stayed: 0,
            change_c: 0.0,
        }
    }

    /// A frequency that may be one, normalised, and its temperature with the slope there.
    #[inline]
    fn plausible(&self, frequency_hz: Option<f64>) -> Option<(f32, (f32, f32))> {
        let u = self.law.normalised(frequency_hz?);
        let (t, slope) = self.law.value_and_slope(u);
        // (No comparison with a NaN is true.)
        ((t - self.middle_c).abs() <= self.reach_c).then_some((u, (t, slope)))
    }

    /// Whether a temperature can follow on what was before.
    #[inline]
    fn believe(&mut self, now: &mut AxisThermal, t: f32) -> bool {
        let change = (t - now.state.temperature_c).abs();
        // After an outage it may be further away, by as much a step.
        let near = change <= MAX_STEP_C || change <= MAX_STEP_C * f32::from(now.since());
        (near && self.stayed == 0) || !now.known || self.convinced(now, t)
    }

    /// Whether a temperature that jumped, or follows one that did, is to be believed by now.
    #[inline(never)]
    fn convinced(&mut self, now: &mut AxisThermal, t: f32) -> bool {
        let stays = self.stayed > 0 && (t - self.doubted_c).abs() <= MAX_STEP_C;
        let stayed = if stays { self.stayed + 1 } else { 1 };
        if stayed < BELIEVE_STEPS {
            // Back where it was before the jump: that is believed at once.
            let back = stayed == 1 && (t - now.state.temperature_c).abs() <= MAX_STEP_C;
            (self.doubted_c, self.stayed) = (t, if back { 0 } else { stayed });
            return back;
        }
        self.stayed = 0;
        now.known = false;
        self.window = SlopeWindow::default();
        self.difference = Difference::default();
        true
    }

    // Out of line, as the effects are: inlined into one large function, all would run short of registers.
    #[inline(never)]
    fn step(&mut self, now: &mut AxisThermal, frequency_hz: Option<f64>) {
        let believed = match self.plausible(frequency_hz) {
            Some((u, (t, slope))) if self.believe(now, t) => {
                self.slope_c = slope;
                Some((u, t))
            }
            _ => None,
        };
        let u_per_min = self.window.push(believed.map(|(u, _)| u));
        now.settled = self.window.settled();
        if let Some((u, t)) = believed {
            let change = if now.known { t - now.state.temperature_c } else { 0.0 };
            self.change_c = if now.age == 0 { change } else { change / f32::from(now.since()) };
            now.known = true;
            now.age = 0;
            now.state.frequency_u = u;
            now.state.temperature_c = t;
        } else {
            self.change_c = 0.0;
            now.age = now.since();
        }
        if now.known {
            let state = &mut now.state;
            state.frequency_u_per_min = u_per_min;
            state.rate_c_per_min = u_per_min * self.slope_c;
            state.difference_c_per_min = self.difference.push(state.temperature_c);
        }
    }
}

/// Frequencies to temperatures and their rates of change: the state that a fit and a unit share.
#[derive(Debug, Clone)]
pub struct Thermometer {
    channels: [Channel; AXES],
    now: Thermal,
    steps: u32,
    power_on_s: f32,
}

impl Thermometer {
    /// `power_on_s`: age of the power-on at the first step (0 on the unit; a recording may begin later).
    #[must_use]
    pub fn new(laws: [TemperatureLaw; AXES], power_on_s: f32) -> Self {
        let now = Thermal { axes: [AxisThermal::UNKNOWN; AXES], time_s: power_on_s };
        Self { channels: laws.map(Channel::new), now, steps: 0, power_on_s }
    }

    /// One model step.
    #[inline]
    pub fn step(&mut self, frequency_hz: &[Option<f64>; AXES]) -> &Thermal {
        // (A wrap is 136 years away.)
        self.steps = self.steps.wrapping_add(1);
        self.now.time_s = self.power_on_s + self.steps as f32 * MODEL_STEP_S;
        for k in 0..AXES {
            self.channels[k].step(&mut self.now.axes[k], frequency_hz[k]);
        }
        &self.now
    }
}

impl Thermal {
    /// What the bias model of one axis may look at; `None` where the axis has no temperature yet.
    #[inline]
    #[must_use]
    pub fn state(&self, k: usize) -> Option<&State> {
        let axis = &self.axes[k];
        axis.known.then_some(&axis.state)
    }
}

/// What one model step gives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Output {
    /// Temperatures, C (NaN before the first frequency).
    pub temperature_c: [f32; AXES],
    /// Rates of change, C per minute.
    pub rate_c_per_min: [f32; AXES],
    /// Biases to subtract, deg/h. Always finite.
    pub bias_dph: [f32; AXES],
    /// Status bits ([`crate::status::axis`]).
    pub status: [u8; AXES],
}

impl Output {
    /// Whether both are the same to the last bit.
    #[must_use]
    pub fn same(&self, other: &Self) -> bool {
        let equal = |a: &[f32; AXES], b: &[f32; AXES]| a.iter().zip(b).all(|(x, y)| x.to_bits() == y.to_bits());
        equal(&self.bias_dph, &other.bias_dph)
            && equal(&self.temperature_c, &other.temperature_c)
            && equal(&self.rate_c_per_min, &other.rate_c_per_min)
            && self.status == other.status
    }
}

/// One model step of two compensators that were made alike and have seen the same, in separate memory. `None` where they
/// differ in any bit: memory was upset, and neither is to be trusted.
pub fn update_both(lanes: [&mut Compensator; 2], step: &StepFrequencies) -> Option<Output> {
    let [a, b] = lanes.map(|lane| lane.update(step));
    a.same(&b).then_some(a)
}

/// The bias model of a unit, running.
#[derive(Debug, Clone)]
pub struct Compensator {
    calibration: Calibration,
    thermometer: Thermometer,
    /// Of each effect of the calibration: its states.
    running: Vec<OnUnit, MAX_EFFECTS>,
    /// Steps for which a change beyond the calibrated range is still in the slope's window.
    spoilt: [u8; AXES],
    bias_dph: [f32; AXES],
    trim_dph: [f32; AXES],
}

impl Compensator {
    /// Starts in equilibrium with the first temperature.
    // In line: what builds a static one should need the stack for it once.
    #[inline]
    #[must_use]
    pub fn new(calibration: Calibration, power_on_s: f32) -> Self {
        let laws = [calibration.axes[0].law, calibration.axes[1].law, calibration.axes[2].law];
        let mut running = Vec::new();
        for term in &calibration.effects {
            // `Calibration::check` has refused what no unit knows.
            let Some(one) = OnUnit::new(term.id, &term.parameters, MODEL_STEP_S) else { break };
            let _ = running.push(one);
        }
        Self {
            calibration,
            thermometer: Thermometer::new(laws, power_on_s),
            running,
            spoilt: [0; AXES],
            bias_dph: [0.0; AXES],
            trim_dph: [0.0; AXES],
        }
    }

    /// Adds a constant to the bias of each axis from the next step on, deg/h: what an alignment has found. It replaces the
    /// one before.
    pub fn set_trim(&mut self, trim_dph: [f32; AXES]) {
        if trim_dph.iter().all(|t| t.is_finite()) {
            self.trim_dph = trim_dph;
        }
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

    /// One model step: frequencies in Hz, `None` where lost.
    pub fn step(&mut self, frequency_hz: &[Option<f64>; AXES]) -> Output {
        self.advance(frequency_hz, |_| false)
    }

    #[inline(always)]
    fn advance(&mut self, frequency_hz: &[Option<f64>; AXES], edge_errors: impl Fn(usize) -> bool) -> Output {
        let _ = self.thermometer.step(frequency_hz);
        let Thermometer { now: thermal, channels, .. } = &self.thermometer;
        let scaling = &self.calibration.scaling;
        let mut bias_dph = [0.0; AXES];
        for (k, bias) in bias_dph.iter_mut().enumerate() {
            *bias = self.calibration.axes[k].coefficients.bias_dph(scaling, &thermal.axes[k].state);
        }
        for (term, running) in self.calibration.effects.iter().zip(&mut self.running) {
            running.add_bias_dph(scaling, thermal, &term.gains, &mut bias_dph);
        }
        let [x, y, z] = &thermal.axes;
        let mut output = Output {
            temperature_c: [x.state.temperature_c, y.state.temperature_c, z.state.temperature_c],
            rate_c_per_min: [x.state.rate_c_per_min, y.state.rate_c_per_min, z.state.rate_c_per_min],
            bias_dph,
            status: [if self.calibration.calibrated { 0 } else { axis::UNCALIBRATED }; AXES],
        };
        for k in 0..AXES {
            let now = &thermal.axes[k];
            output.status[k] |= self.calibration.axes[k].status(now, channels[k].change_c, &mut self.spoilt[k]);
            // Bridging an outage, the last bias is held, whatever the states do.
            if now.age == 0 {
                self.bias_dph[k] = bias_dph[k];
                if !bias_dph[k].is_finite() {
                    self.bias_dph[k] = 0.0;
                    output.status[k] |= axis::UNCALIBRATED;
                }
            }
            if edge_errors(k) {
                output.status[k] |= axis::EDGE_ERRORS;
            }
            output.bias_dph[k] = self.bias_dph[k] + self.trim_dph[k];
        }
        output
    }
}

impl Axis {
    /// What is to be said of the thermal state of an axis whose temperature has changed by so much in this step. `spoilt`: for how
    /// many steps its slope is not to be trusted.
    #[inline(always)]
    fn status(&self, now: &AxisThermal, change_c: f32, spoilt: &mut u8) -> u8 {
        let mut s = 0;
        if !now.settled {
            s |= axis::SETTLING;
        }
        if now.age > 0 {
            s |= axis::FREQUENCY_LOST;
        }
        if !now.known || now.age > HOLD_S {
            s |= axis::TEMPERATURE_STALE;
        }
        if !now.known {
            return s;
        }
        let (t, r) = (now.state.temperature_c, now.state.rate_c_per_min);
        if t < self.law.min_c || t > self.law.max_c {
            s |= axis::TEMPERATURE_RANGE;
        }
        let [slowest, fastest] = self.rate_range_c_per_min;
        let beyond = |r: f32| r < slowest || r > fastest;
        // The slope takes seconds to show a ramp; a step of twice the range shows at once, and spoils the slope for as long as
        // it is in the window. (An outage may hide the way back: then the time counts from its end.)
        if beyond(change_c * (0.5 * 60.0 / MODEL_STEP_S)) || (now.age > 0 && *spoilt > 0) {
            *spoilt = WINDOW as u8;
        } else if *spoilt > 0 {
            *spoilt -= 1;
        }
        if *spoilt > 0 || beyond(r) {
            s |= axis::RAMP_RANGE;
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
        assert_eq!(out.status, [0; 3]);
        let t = out.temperature_c[0];
        assert!((out.bias_dph[0] - (1.0 + 2.0 * (t - 10.0) / 45.0)).abs() < 1e-5);
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
            assert_eq!(x.status[0] & axis::FREQUENCY_LOST != 0, lost);
            assert_eq!(x.status[0] & axis::TEMPERATURE_STALE != 0, (50..60).contains(&k));
            assert_eq!(x.bias_dph[0], y.bias_dph[0]);
        }
    }

    #[test]
    fn a_jump_is_not_believed_at_once_and_settles_anew() {
        let mut c = Compensator::new(calibrated(), 0.0);
        for _ in 0..40 {
            let _ = c.step(&F);
        }
        let before = c.step(&F);
        let jumped = [F[0].map(|f| f + 1.0), F[1], F[2]];
        for k in 0..100u32 {
            let out = c.step(&jumped);
            assert_eq!(out.status[1..], [0, 0]);
            let flags = if k + 1 < u32::from(BELIEVE_STEPS) {
                assert_eq!(out.bias_dph, before.bias_dph, "held");
                if k >= u32::from(HOLD_S) {
                    axis::FREQUENCY_LOST | axis::TEMPERATURE_STALE
                } else {
                    axis::FREQUENCY_LOST
                }
            } else if k + 1 < u32::from(BELIEVE_STEPS) + crate::rate_of_change::WINDOW as u32 - 1 {
                axis::SETTLING
            } else {
                0
            };
            assert_eq!(
                out.status[0] & !axis::SETTLING | flags & axis::SETTLING,
                flags,
                "step {k}: {:x}",
                out.status[0]
            );
            assert!(out.rate_c_per_min[0].abs() < 1e-6, "the jump is no rate of change");
        }
        // One wild second changes nothing but its own flag.
        let (mut a, mut b) = (c.clone(), c);
        let wild = a.step(&F);
        assert_eq!(wild.status[0], axis::FREQUENCY_LOST);
        let _ = b.step(&[None, F[1], F[2]]);
        for _ in 0..30 {
            assert!(a.step(&jumped).same(&b.step(&jumped)));
        }
    }

    #[test]
    fn no_slope_is_trusted_that_was_made_of_a_jump_or_of_nothing() {
        // A frequency that runs away and comes back, and one that was away for long: as long as the slope is not that of the
        // resonator, it is flagged.
        let mut block = calibrated();
        block.axes.iter_mut().for_each(|a| a.rate_range_c_per_min = [-1.0, 1.0]);
        for lost in [0, 3, 8, 12, 40] {
            for off in [0.1, 0.3, 1.0, 2.0] {
                let mut c = Compensator::new(block.clone(), 0.0);
                for k in 0..200u32 {
                    let away = (50..55).contains(&k);
                    let f = F[0].map(|f| f + 0.006 * f64::from(k) + if away { off } else { 0.0 });
                    let out = c.step(&[f.filter(|_| !(55..55 + lost).contains(&k)), F[1], F[2]]);
                    // 0.006 Hz/s: about 0.9 C/min.
                    let error = (out.rate_c_per_min[0] - 0.9).abs();
                    assert!(
                        error < 0.2 || out.status[0] != 0,
                        "lost {lost}, off {off}, step {k}: {error} C/min unsaid"
                    );
                    assert!(k < 160 || out.status[0] == 0, "lost {lost}, off {off}, step {k}: {:x}", out.status[0]);
                }
            }
        }
    }

    #[test]
    fn lanes_that_differ_are_found() {
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
        let mut block = calibrated();
        let lag = by_id(4).expect("in the list");
        let mut gains = [[0.0; MAX_OUTPUTS]; AXES];
        gains[0][0] = 1.0;
        let term = EffectTerm { id: lag.id, parameters: [900.0, 0.0], gains, gain_std: gains };
        block.effects.push(term).expect("room");
        let (mut a, mut b) = (Compensator::new(block.clone(), 0.0), Compensator::new(block, 0.0));
        for k in 0..100u32 {
            let wild = (30..60).contains(&k);
            let x = a.step(&[if wild { Some(11_000.0) } else { F[0] }, F[1], F[2]]);
            let y = b.step(&[F[0].filter(|_| !wild), F[1], F[2]]);
            assert!(x.same(&y), "step {k}");
        }
    }

    #[test]
    fn nothing_known_is_said() {
        let out = Compensator::new(calibrated(), 0.0).step(&[None, Some(f64::NAN), Some(1e300)]);
        for k in 0..3 {
            assert!(out.bias_dph[k].is_finite());
            assert_ne!(out.status[k], 0);
        }
    }
}
