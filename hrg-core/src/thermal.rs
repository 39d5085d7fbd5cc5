//! The thermal state of the three axes: frequencies in, temperatures and their rates of change out, once per model step.
//!
//! A fit and a unit share this state, so that a coefficient means the same to both. A frequency that no resonator can have is
//! rejected here: one too far from the calibrated range, or one that jumped.
//!
//! # Example
//! ```
//! use hrg_core::calibration::Calibration;
//! use hrg_core::thermal::Thermometer;
//!
//! let curves = Calibration::uncalibrated().axes.map(|a| a.curve);
//! let mut thermometer = Thermometer::new(curves, 0.0);
//! thermometer.step(&[Some(4900.0), None, None]);
//! let thermal = thermometer.now();
//! assert!(thermal.axes[0].known && !thermal.axes[1].known);
//! assert_eq!(thermal.time_s, 1.0);
//! ```

use crate::bias::State;
use crate::rate_of_change::{Difference, SlopeWindow};
use crate::temperature::TemperatureCurve;
use crate::{AXES, MODEL_STEP_S};

/// A frequency whose temperature lies further than this outside the calibrated range, C, is implausible and treated as
/// lost; accepted, it would disturb the states of lags for hours. Nearer, it is used and flagged [`crate::status::AxisStatus::TEMPERATURE_RANGE`].
pub const BEYOND_C: f32 = 50.0;

/// A resonator of some grams does not change its temperature faster than this, C per model step: a frequency that changes
/// faster is not accepted at once. (30 C per minute; a chamber does 5, and a unit behind its case less.)
pub const MAX_STEP_C: f32 = 0.5;

/// A frequency that jumped is treated as lost until it has stayed where it is for this many model steps. Then it is accepted,
/// and its rate of change starts anew (flagged settling).
pub const ACCEPT_STEPS: u8 = 30;

/// One axis in one model step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisThermal {
    /// Inputs of a bias model: of the last measured frequency where the frequency is lost now.
    pub state: State,
    /// Set if the axis has had a frequency at all; without, its temperature is NaN and the rest of its state zero.
    pub known: bool,
    /// Steps since the frequency was last measured, up to 18 hours.
    pub age: u16,
    /// Set if the window of the slope is full.
    pub settled: bool,
}

impl AxisThermal {
    const UNKNOWN: Self = Self {
        state: State {
            temperature_c: f32::NAN,
            ramp_c_per_min: 0.0,
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
    curve: TemperatureCurve,
    /// No resonator is further from the middle of its curve's range than this, C.
    middle_c: f32,
    reach_c: f32,
    window: SlopeWindow,
    difference: Difference,
    /// Slope of temperature by normalised frequency at the last one measured, C.
    slope_c: f32,
    /// A temperature after a jump, and for how many steps it has stayed; 0: there was no jump.
    jumped_c: f32,
    stayed: u8,
    /// Change of temperature since the last step that had one, per step, C: shows an excessive ramp before the slope does.
    change_c: f32,
}

impl Channel {
    fn new(curve: TemperatureCurve) -> Self {
        Self {
            middle_c: 0.5 * (curve.valid_from_c + curve.valid_to_c),
            reach_c: 0.5 * (curve.valid_to_c - curve.valid_from_c) + BEYOND_C,
            curve,
            window: SlopeWindow::default(),
            difference: Difference::default(),
            slope_c: 0.0,
            jumped_c: 0.0,
            stayed: 0,
            change_c: 0.0,
        }
    }

    /// A frequency that may be one, normalised, and its temperature with the slope there.
    #[inline]
    fn plausible(&self, frequency_hz: Option<f64>) -> Option<(f32, (f32, f32))> {
        let u = self.curve.normalised(frequency_hz?);
        let (t, slope) = self.curve.value_and_slope(u);
        // (No comparison with a NaN is true.)
        ((t - self.middle_c).abs() <= self.reach_c).then_some((u, (t, slope)))
    }

    /// `true` if a temperature can follow on the one before.
    #[inline]
    fn accept(&mut self, now: &mut AxisThermal, t: f32) -> bool {
        let change = (t - now.state.temperature_c).abs();
        // After an outage it may be further away, by as much a step.
        let near = change <= MAX_STEP_C || change <= MAX_STEP_C * f32::from(now.since());
        (near && self.stayed == 0) || !now.known || self.accept_jump(now, t)
    }

    /// `true` if a temperature that jumped, or follows one that did, is accepted by now.
    #[inline(never)]
    fn accept_jump(&mut self, now: &mut AxisThermal, t: f32) -> bool {
        let stays = self.stayed > 0 && (t - self.jumped_c).abs() <= MAX_STEP_C;
        let stayed = if stays { self.stayed + 1 } else { 1 };
        if stayed < ACCEPT_STEPS {
            // Back where it was before the jump: accepted at once.
            let back = stayed == 1 && (t - now.state.temperature_c).abs() <= MAX_STEP_C;
            (self.jumped_c, self.stayed) = (t, if back { 0 } else { stayed });
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
        let accepted = match self.plausible(frequency_hz) {
            Some((u, (t, slope))) if self.accept(now, t) => {
                self.slope_c = slope;
                Some((u, t))
            }
            _ => None,
        };
        let u_per_min = self.window.push(accepted.map(|(u, _)| u));
        now.settled = self.window.settled();
        if let Some((u, t)) = accepted {
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
            state.ramp_c_per_min = u_per_min * self.slope_c;
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
    pub fn new(curves: [TemperatureCurve; AXES], power_on_s: f32) -> Self {
        let now = Thermal { axes: [AxisThermal::UNKNOWN; AXES], time_s: power_on_s };
        Self { channels: curves.map(Channel::new), now, steps: 0, power_on_s }
    }

    /// The first step comes this long after power-on, s.
    pub fn powered_on_before(&mut self, age_s: f32) {
        self.power_on_s = age_s;
        self.now.time_s = age_s;
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

    /// The state after the last step.
    #[inline]
    #[must_use]
    pub fn now(&self) -> &Thermal {
        &self.now
    }

    /// Change of an axis' temperature in the last step, C: shows an excessive ramp before the slope does. 0 where the frequency is
    /// lost.
    #[inline]
    #[must_use]
    pub fn change_c(&self, k: usize) -> f32 {
        self.channels[k].change_c
    }
}

impl Thermal {
    /// Inputs of the bias model of one axis; `None` where the axis has no temperature yet.
    #[inline]
    #[must_use]
    pub fn state(&self, k: usize) -> Option<&State> {
        let axis = &self.axes[k];
        axis.known.then_some(&axis.state)
    }
}
