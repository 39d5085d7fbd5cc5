//! Effects that the baseline model ([`crate::bias`]) lacks, each one file with its equation, state and source.
//!
//! An effect turns the state of the unit into one or more *regressors* for each axis; the bias it stands for
//! is the sum of regressor times gain. Inner parameters (a lag time, a width) are common to the three axes,
//! gains belong to an axis. To add one: write its file, add it to the list at the end of this one, give it a
//! number that was never used, and test it.
//!
//! Numbers are stable: they are what the calibration image stores.
//!
//! # Example
//! ```
//! use hrg_core::effects::{EffectId, MAX_OUTPUTS, Inputs, Running};
//! use hrg_core::inputs::Quantities;
//! use hrg_core::calibration::Calibration;
//! use hrg_core::thermal::Thermometer;
//! use hrg_core::MODEL_STEP_S;
//!
//! let lag = EffectId::by_name("thermal-lag").expect("in the list").facts();
//! assert_eq!(lag.parameters, ["tau_s"]);
//!
//! // Its regressor while the temperature stands still: none.
//! let calibration = Calibration::uncalibrated();
//! let mut thermometer = Thermometer::new(calibration.axes.clone().map(|a| a.curve), 0.0);
//! let mut running = Running::new(lag.id, &[600.0, 0.0], MODEL_STEP_S).expect("in the list");
//! thermometer.step(&[Some(4900.0); 3]);
//! let inputs = Inputs { scaling: &calibration.scaling, thermal: thermometer.now(), axis: 0, quantities: &Quantities::NONE };
//! assert_eq!(running.step(&inputs), [0.0; MAX_OUTPUTS]);
//! ```

use crate::bias::{Scaling, State};
use crate::half::Half;
use crate::inputs::{Quantities, QuantitySet};
use crate::thermal::Thermal;
use crate::AXES;

/// Most inner parameters of an effect.
pub const MAX_PARAMETERS: usize = 2;
/// Most regressors of an effect, per axis.
pub const MAX_OUTPUTS: usize = 14;
/// Most numbers that an effect remembers, per axis.
pub const MAX_MEMORY: usize = 10;

/// Inputs of an effect: one axis, one model step. A quantity that is missing is NaN.
#[derive(Debug, Clone, Copy)]
pub struct Inputs<'a> {
    /// Centre and scale of the model.
    pub scaling: &'a Scaling,
    /// Temperatures, their rates of change, normalised frequencies and time.
    pub thermal: &'a Thermal,
    /// The axis in question, 0 to 2.
    pub axis: usize,
    /// Inputs beside the frequencies, each less its reference.
    pub quantities: &'a Quantities,
}

impl Inputs<'_> {
    /// The state of this axis.
    #[inline]
    #[must_use]
    pub fn own(&self) -> &State {
        // (There is no other axis: this spares the unit the code of a panic.)
        let [x, y, z] = &self.thermal.axes;
        match self.axis {
            0 => &x.state,
            1 => &y.state,
            _ => &z.state,
        }
    }

    /// Temperature of this axis, C.
    #[inline]
    #[must_use]
    pub fn own_c(&self) -> f32 {
        self.own().temperature_c
    }

    /// Normalised temperature of this axis, held at the ends of the calibrated range.
    // (Once in flash: half of the effects ask for it.)
    #[inline(never)]
    #[must_use]
    pub fn own_u(&self) -> f32 {
        self.scaling.u_and_inside(self.own_c()).1
    }

    /// Temperature of another axis, C; one that has none yet counts as being as warm as this one.
    #[inline]
    #[must_use]
    pub fn other_c(&self, axis: usize) -> f32 {
        self.thermal.state(axis).map_or_else(|| self.own_c(), |s| s.temperature_c)
    }
}

/// Compensation of an effect by a unit: possible or not, and why.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reach {
    /// The unit has all it needs.
    Unit,
    /// Needs a quantity beside the frequencies ([`crate::inputs`]): a unit compensates it where that comes in.
    NeedsInput(&'static str),
    /// Shows a fault of the thermometer by a sensor of the chamber: to be repaired, and no unit compensates it.
    NeedsChamber(&'static str),
    /// No unit can predict it: something to repair in the unit or the chamber.
    Unpredictable,
}

impl Reach {
    /// `true` if a unit can compute it, given the quantities that it reads.
    #[must_use]
    pub const fn on_unit(self) -> bool {
        matches!(self, Self::Unit) || (cfg!(feature = "inputs") && matches!(self, Self::NeedsInput(_)))
    }

    /// Quantity that it needs and a unit does not measure by itself.
    #[must_use]
    pub const fn needs(self) -> Option<&'static str> {
        match self {
            Self::NeedsInput(what) | Self::NeedsChamber(what) => Some(what),
            Self::Unit | Self::Unpredictable => None,
        }
    }
}

/// Part of the past that an effect depends on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Span {
    /// None, or no more than some seconds.
    None,
    /// Its slowest time constant, s: a twentieth of the past is left after three of them.
    Time(f32),
    /// The width of its widest play, C: the past is gone as soon as the temperature has swept it.
    Range(f32),
    /// All of it.
    All,
}

/// Facts of an effect, and its computation.
pub trait Effect: Sized {
    /// Name in reports.
    const NAME: &'static str;
    /// Number in the calibration image.
    const ID: u16;
    /// Compensation of the effect: by a unit or not.
    const REACH: Reach;
    /// `true` if it reads nothing that belongs to an axis: then the unit computes it once for the three.
    const COMMON: bool = false;
    /// `true` if it remembers the path of the temperature, so that its start matters: see [`start_on`](Self::start_on).
    const REMEMBERS_PATH: bool = false;
    /// `true` if it reads the temperatures of the other axes.
    const NEIGHBOURS: bool = false;
    /// `true` if its regressors are the weights of the knots of a curve of the quantity that it remembers, or of time.
    const CURVE: bool = false;
    /// `true` if its regressors say the same of two pasts while it still remembers them: it swings, settles by temperature, is a square, or changes
    /// its sign with temperature.
    /// Its memory dies away by the time of its [`span`](Self::span), or when the temperature has swept it.
    const MAY_AGREE: bool = false;
    /// `true` if all of its regressors are products with normalised temperature.
    const TIMES_TEMPERATURE: bool = false;
    /// The inner parameters.
    type Parameters: Parameters;
    /// The regressors of an axis: an array of as many as there are.
    type Regressors: Regressors;
    /// In its initial state. `step_s` is the time between calls of [`step`](Self::step), s.
    fn new(parameters: Self::Parameters, step_s: f32) -> Self;
    /// Tells an effect that remembers the path of the temperature where it stands when it begins: 1 as after cooling from far above, -1
    /// as after heating from far below, 0 in the middle. Before the first step.
    fn start_on(&mut self, _branch: f32) {}
    /// The numbers that it remembers from step to step: what a unit keeps over a restart. Always as many, at most [`MAX_MEMORY`].
    fn memory(&mut self) -> &mut [f32] {
        &mut []
    }
    /// The part of the past that it depends on, with these inner parameters.
    fn span(_parameters: Self::Parameters) -> Span {
        Span::None
    }
    /// The quantities that it reads on an axis beside the frequencies.
    fn reads(_parameters: Self::Parameters, _axis: usize) -> QuantitySet {
        QuantitySet::empty()
    }
    /// Makes its memory that of a unit which has stood at a temperature for long and was brought to the present one at once.
    fn soak_at(&mut self, temperature_c: f32) {
        self.memory().fill(temperature_c);
    }
    /// The same of an effect that remembers quantities of an axis, each less its reference.
    fn stand_at(&mut self, _quantities: &Quantities, _axis: usize) {}
    /// Advances by one step and gives the regressors; NaN where a needed quantity is missing.
    fn step(&mut self, inputs: &Inputs<'_>) -> Self::Regressors;
}

/// Arrays of up to [`MAX_OUTPUTS`] regressors.
pub trait Regressors: Copy {
    /// Number of regressors.
    const COUNT: usize;
    /// `true` if the first is NaN: a needed quantity is missing.
    fn missing(&self) -> bool;
    /// With zeros behind them.
    fn padded(&self) -> [f32; MAX_OUTPUTS];
    /// As a slice.
    fn each(&self) -> &[f32];
}

impl<const N: usize> Regressors for [f32; N] {
    const COUNT: usize = N;
    #[inline]
    fn missing(&self) -> bool {
        self.first().is_some_and(|x| x.is_nan())
    }
    #[inline]
    fn padded(&self) -> [f32; MAX_OUTPUTS] {
        let mut out = [0.0; MAX_OUTPUTS];
        out.iter_mut().zip(self).for_each(|(o, x)| *o = *x);
        out
    }
    #[inline]
    fn each(&self) -> &[f32] {
        self
    }
}

/// Share of the way that a first-order lag of `tau_s` goes in `step_s`, exact for a held input.
fn lag_share(step_s: f32, tau_s: f32) -> f32 {
    if tau_s > 0.0 {
        // (Of a lag of days 1 - exp would have two digits.)
        -libm::expm1f(-step_s / tau_s)
    } else {
        1.0
    }
}

/// Moves a state by a share of the way to `target`. The part of a step that is too small for the digits of the state is kept in `rest` for the steps that come: at 55 C
/// a lag of 6 hours would else stand still 0.04 C before its end, for ever.
#[inline]
fn settle(state: &mut f32, rest: &mut f32, share: f32, target: f32) {
    let step = share * (target - *state - *rest) + *rest;
    let moved = *state + step;
    *rest = step - (moved - *state);
    *state = moved;
}

/// Facts about one effect of the list.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Facts {
    /// The effect.
    pub effect: EffectId,
    /// Name in reports.
    pub name: &'static str,
    /// Number in the calibration image.
    pub id: u16,
    /// Names of the inner parameters, with unit.
    pub parameters: &'static [&'static str],
    /// Regressors per axis.
    pub outputs: usize,
    /// Compensation of the effect: by a unit or not.
    pub reach: Reach,
    /// `true` if it reads nothing that belongs to an axis.
    pub common: bool,
    /// `true` if it remembers the path of the temperature.
    pub remembers_path: bool,
}

/// Facts of an effect that a unit needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shape {
    /// Regressors per axis.
    pub outputs: usize,
    /// `true` if a unit can compute it, given the quantities that it reads.
    pub on_unit: bool,
    /// Inner parameters that must be above zero: [`Parameters::POSITIVE`].
    pub positive: [bool; MAX_PARAMETERS],
}

/// Gains of an effect on each axis.
pub type Gains = [[f32; MAX_OUTPUTS]; AXES];

/// Gains of an effect's regressors, and the sums that they are added to.
pub struct Sums<'a, const N: usize> {
    /// Gains of the bias.
    pub gains: &'a Gains,
    /// The bias of each axis, deg/h.
    pub bias_dph: &'a mut [f32; AXES],
    /// Gains of the directions of its uncertainty.
    pub directions: &'a [[[Half; MAX_OUTPUTS]; AXES]; N],
    /// Those of each axis, deg/h.
    pub along_dph: &'a mut [[f32; AXES]; N],
}

impl<const N: usize> Sums<'_, N> {
    /// Adds to an axis the regressors of an effect, each times its gain.
    // (Once in flash, for all effects.)
    #[inline(never)]
    fn add(&mut self, axis: usize, regressors: &[f32]) {
        let (Some(gains), Some(bias_dph)) = (self.gains.get(axis), self.bias_dph.get_mut(axis)) else { return };
        *bias_dph += crate::bias::dot(gains, regressors);
        for (along, gains) in self.along_dph.iter_mut().zip(self.directions) {
            if let (Some(along), Some(gains)) = (along.get_mut(axis), gains.get(axis)) {
                *along += gains.iter().zip(regressors).map(|(g, x)| g.value() * x).sum::<f32>();
            }
        }
    }
}

/// Advances an effect on an axis and adds its bias there, on every axis if it belongs to none. An effect whose quantity has never come adds nothing.
// One function for each effect: all of them in one would run short of registers.
#[inline(never)]
fn step_of<E: Effect, const N: usize>(effects: &mut [E; AXES], inputs: &Inputs<'_>, sums: &mut Sums<'_, N>) {
    if !E::REACH.on_unit() {
        // `OnUnit::new` starts none of these; so the unit holds no code for them.
        return;
    }
    let Some(effect) = effects.get_mut(inputs.axis) else { return };
    let x = effect.step(inputs);
    if matches!(E::REACH, Reach::NeedsInput(_)) && x.missing() {
        return;
    }
    if E::COMMON {
        (0..AXES).for_each(|axis| sums.add(axis, x.each()));
    } else {
        sums.add(inputs.axis, x.each());
    }
}

mod bank;
pub mod parameters;

pub use bank::rung;
use parameters::Parameters;

macro_rules! effects {
    ($($module:ident :: {$($name:ident),+}),+ $(,)?) => {
        $(mod $module; $(pub use $module::$name;)+)+
        effects!(@all $($($name),+),+);

        impl EffectId {
            /// The source of its file, whose head states equation, state and origin: for tools that print them.
            #[must_use]
            pub const fn source(self) -> &'static str {
                match self {
                    $($(Self::$name)|+ => include_str!(concat!(stringify!($module), ".rs")),)+
                }
            }
        }
    };
    (@all $($name:ident),+) => {

        /// Identifies an effect: one variant for each entry of the list.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub enum EffectId { $(#[doc = concat!("See [`", stringify!($name), "`].")] $name),+ }

        /// Every effect, in the order of the list.
        pub const ALL: &[Facts] = &[$(Facts {
            effect: EffectId::$name,
            name: <$name as Effect>::NAME,
            id: <$name as Effect>::ID,
            parameters: <<$name as Effect>::Parameters as Parameters>::NAMES,
            outputs: <<$name as Effect>::Regressors as Regressors>::COUNT,
            reach: <$name as Effect>::REACH,
            common: <$name as Effect>::COMMON,
            remembers_path: <$name as Effect>::REMEMBERS_PATH,
        }),+];

        /// Facts that a unit needs of the effect with a number; it holds no names.
        // (One table in flash, for all that ask.)
        #[inline(never)]
        #[must_use]
        pub fn shape(id: u16) -> Option<Shape> {
            match id {
                $(<$name as Effect>::ID => Some(Shape {
                    outputs: <<$name as Effect>::Regressors as Regressors>::COUNT,
                    on_unit: <$name as Effect>::REACH.on_unit(),
                    positive: <<$name as Effect>::Parameters as Parameters>::POSITIVE,
                }),)+
                _ => None,
            }
        }

        /// The part of the past that the effect with a number depends on: [`Effect::span`]. Nothing for a number that is not in the list.
        #[must_use]
        pub fn span(id: u16, parameters: &[f32; MAX_PARAMETERS]) -> Span {
            match id {
                $(<$name as Effect>::ID => <$name as Effect>::span(Parameters::of(parameters)),)+
                _ => Span::None,
            }
        }

        /// The quantities that the effect with a number reads on an axis: [`Effect::reads`].
        #[must_use]
        pub fn reads(id: u16, parameters: &[f32; MAX_PARAMETERS], axis: usize) -> QuantitySet {
            match id {
                $(<$name as Effect>::ID => <$name as Effect>::reads(Parameters::of(parameters), axis),)+
                _ => QuantitySet::empty(),
            }
        }

        /// One running effect of one axis.
        #[derive(Debug, Clone)]
        pub enum Running { $(#[doc = concat!("See [`", stringify!($name), "`].")] $name($name)),+ }

        impl Running {
            /// Starts the effect with number `id`; `None` if there is no such number.
            #[must_use]
            pub fn new(id: u16, parameters: &[f32; MAX_PARAMETERS], step_s: f32) -> Option<Self> {
                match id {
                    $(<$name as Effect>::ID => Some(Self::$name(<$name as Effect>::new(Parameters::of(parameters), step_s))),)+
                    _ => None,
                }
            }
            /// See [`Effect::start_on`].
            pub fn start_on(&mut self, branch: f32) {
                match self { $(Self::$name(e) => e.start_on(branch)),+ }
            }
            /// Advances by one step and gives the regressors.
            #[inline]
            pub fn step(&mut self, inputs: &Inputs<'_>) -> [f32; MAX_OUTPUTS] {
                match self { $(Self::$name(e) => e.step(inputs).padded()),+ }
            }
        }

        /// An effect as a unit runs it: of the three axes at once.
        #[derive(Debug, Clone)]
        pub enum OnUnit { $(#[doc = concat!("See [`", stringify!($name), "`].")] $name([$name; AXES])),+ }

        impl OnUnit {
            /// Starts the effect with number `id`; `None` if there is no such number, or no unit can compute it.
            #[must_use]
            pub fn new(id: u16, parameters: &[f32; MAX_PARAMETERS], start: f32, step_s: f32) -> Option<Self> {
                match id {
                    $(<$name as Effect>::ID if <$name as Effect>::REACH.on_unit() => {
                        let mut one = <$name as Effect>::new(Parameters::of(parameters), step_s);
                        one.start_on(start);
                        Some(Self::$name([one.clone(), one.clone(), one]))
                    })+
                    _ => None,
                }
            }
            /// Advances by one step and adds to each axis the regressors times its gains. What belongs to no axis is computed once. An axis that has no
            /// temperature yet stays as it is: its effects begin, or go on after a restart, with the first one.
            // (Once in flash: the effects and their other pasts call it.)
            #[inline(never)]
            pub fn add_bias_dph<const N: usize>(
                &mut self,
                scaling: &Scaling,
                thermal: &Thermal,
                quantities: &Quantities,
                sums: &mut Sums<'_, N>,
            ) {
                let common = match self { $(Self::$name(_) => <$name as Effect>::COMMON),+ };
                for axis in 0..if common { 1 } else { AXES } {
                    if !common && thermal.state(axis).is_none() {
                        continue;
                    }
                    let inputs = Inputs { scaling, thermal, axis, quantities };
                    match self { $(Self::$name(e) => step_of(e, &inputs, sums)),+ }
                }
            }
            /// Memory of an axis: [`Effect::memory`].
            #[inline(never)]
            pub fn memory(&mut self, axis: usize) -> &mut [f32] {
                match self { $(Self::$name(e) => e.get_mut(axis).map_or(&mut [], |e| e.memory())),+ }
            }
            /// See [`Effect::soak_at`] and [`Effect::stand_at`].
            #[inline(never)]
            pub fn soak_at(&mut self, axis: usize, temperature_c: f32, quantities: &Quantities) {
                match self {
                    $(Self::$name(e) => e.iter_mut().skip(axis).take(1).for_each(|e| {
                        e.soak_at(temperature_c);
                        e.stand_at(quantities, axis);
                    })),+
                }
            }
            /// `true` if it reads the other axes: [`Effect::NEIGHBOURS`].
            #[must_use]
            pub const fn looks_at_neighbours(&self) -> bool {
                match self { $(Self::$name(_) => <$name as Effect>::NEIGHBOURS),+ }
            }
            /// `true` if two pasts that it still remembers may agree by chance: [`Effect::MAY_AGREE`].
            #[must_use]
            pub const fn may_agree(&self) -> bool {
                match self { $(Self::$name(_) => <$name as Effect>::MAY_AGREE),+ }
            }
            /// `true` if its regressors are products with normalised temperature: [`Effect::TIMES_TEMPERATURE`].
            #[must_use]
            pub const fn times_temperature(&self) -> bool {
                match self { $(Self::$name(_) => <$name as Effect>::TIMES_TEMPERATURE),+ }
            }
            /// `true` if its regressors are the weights of a curve's knots: [`Effect::CURVE`].
            #[must_use]
            pub const fn is_curve(&self) -> bool {
                match self { $(Self::$name(_) => <$name as Effect>::CURVE),+ }
            }
        }
    };
}

effects! {
    cubic::{Cubic},
    kink::{Kink},
    temperature_shape::{TemperatureShape},
    thermal_lag::{ThermalLag},
    second_derivative::{SecondDerivative},
    hysteresis::{Hysteresis},
    axis_gradient::{AxisGradient},
    case_gradient::{CaseGradient},
    warm_up::{WarmUp},
    aging::{Aging},
    step::{Step},
    shock::{Shock},
    periodic::{Periodic},
    timebase::{Timebase},
    drive_amplitude::{DriveAmplitude},
    quadrature::{Quadrature},
    board::{Board},
    frequency_direct::{FrequencyDirect},
    cooling_heating::{CoolingHeating},
    lag_ladder::{LagLadder},
    lag_ladder_by_temperature::{LagLadderByTemperature},
    heating_lags::{HeatingLags},
    arrhenius_ladder::{ArrheniusLadder},
    neighbour_lags::{NeighbourLags},
    play_ladder::{PlayLadder},
    play_curve::{PlayCurve},
    relay::{Relay},
    temperature_spline::{TemperatureSpline},
    ripple::{Ripple},
    rate_curve::{RateCurve, RateCurveByTemperature},
    ramp_by_shape::{RampByShape, HeatingByShape},
    power_on_ladder::{PowerOnLadder, PowerOnLadderByTemperature, PowerOnLadderByStart},
    extremes::{Extremes},
    recorded_quantity::{RecordedQuantity, OwnQuantity},
    thermometer_error::{ThermometerError},
    rate_saturation::{RateSaturation},
    cooling_heating_held::{CoolingHeatingHeld},
    input_network::{InputNetwork},
    temperature_step::{TemperatureStep},
    play_ladder_by_temperature::{PlayLadderByTemperature},
    power_on_curve::{PowerOnCurve},
    lag_squares::{LagSquares},
    soft_relay::{SoftRelay},
    underdamped_lag::{UnderdampedLag},
    ramp_square_lags::{RampSquareLags},
    butterfly::{Butterfly},
    widening_play::{WideningPlay},
    late_onset::{LateOnset},
    asymmetric_lag::{AsymmetricLag},
    warm_up_by_temperature::{WarmUpByTemperature},
    damped_oscillation::{DampedOscillation},
    input_kink::{InputKink},
    ramp_band::{RampBand},
    hysteresis_by_temperature::{HysteresisByTemperature},
}

impl EffectId {
    /// Facts that the effect states about itself.
    #[must_use]
    pub const fn facts(self) -> &'static Facts {
        // The list and the type come from one macro: an effect's place is its number in the type.
        &ALL[self as usize]
    }

    /// The name that stands in reports and files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        self.facts().name
    }

    /// The effect with a name.
    #[must_use]
    pub fn by_name(name: &str) -> Option<Self> {
        ALL.iter().find(|f| f.name == name).map(|f| f.effect)
    }
}

/// Facts about the effect with a number.
#[must_use]
pub fn by_id(id: u16) -> Option<&'static Facts> {
    ALL.iter().find(|f| f.id == id)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::thermal::AxisThermal;

    const SCALING: Scaling = Scaling {
        t_ref_c: 10.0,
        t_scale_c: 45.0,
        linear_below_c: -45.0,
        linear_above_c: 65.0,
        linear_beyond_c_per_min: 6.0,
        blend_band_c_per_min: 0.2,
    };

    /// Gives the inputs of axis 0, with axes that are apart.
    fn with_inputs<R>(t: f32, ramp_c_per_min: f32, time_s: f32, of: impl FnOnce(&Inputs<'_>) -> R) -> R {
        let axis = |temperature_c| {
            let state = State {
                temperature_c,
                ramp_c_per_min,
                difference_c_per_min: ramp_c_per_min,
                frequency_u: 0.1,
                frequency_u_per_min: 0.01,
            };
            AxisThermal { state, known: true, age: 0, settled: true }
        };
        let thermal = Thermal { axes: [axis(t), axis(t + 2.0), axis(t - 3.0)], time_s };
        of(&Inputs { scaling: &SCALING, thermal: &thermal, axis: 0, quantities: &Quantities::NONE })
    }

    /// Steps an effect of axis 0.
    fn step(effect: &mut Running, t: f32, time_s: f32) -> [f32; MAX_OUTPUTS] {
        with_inputs(t, 0.5, time_s, |inputs| effect.step(inputs))
    }

    fn run(name: &str, parameter: f32, at: impl Fn(u16) -> f32, steps: u16) -> f32 {
        let facts = EffectId::by_name(name).expect("in the list").facts();
        let mut effect = Running::new(facts.id, &[parameter, 0.0], 1.0).expect("in the list");
        let mut last = f32::NAN;
        for k in 0..steps {
            last = step(&mut effect, at(k), f32::from(k))[0];
        }
        last
    }

    #[test]
    fn a_lag_of_days_follows_as_far_as_in_double_precision() {
        for tau_s in [900.0f32, 21_600.0, 86_400.0, 604_800.0] {
            let share = lag_share(1.0, tau_s);
            let exact = -libm::expm1(-1.0 / f64::from(tau_s));
            assert!((f64::from(share) / exact - 1.0).abs() < 2e-7, "{tau_s} s: {share} instead of {exact}");
            // A chamber that goes from 20 to 55 C, and stays there for eight time constants.
            let (mut state, mut rest, mut exactly) = (20.0f32, 0.0f32, 20.0f64);
            let mut worst = 0.0f64;
            for second in 0..(8.0 * tau_s) as u32 {
                let target = (20.0 + second as f32 * (5.0 / 60.0)).min(55.0);
                settle(&mut state, &mut rest, share, target);
                exactly += exact * (f64::from(target) - exactly);
                worst = worst.max((f64::from(state) - exactly).abs());
            }
            assert!(worst < 1.5e-5, "{tau_s} s: {worst} C");
        }
    }

    #[test]
    fn numbers_and_names_are_unique() {
        for (k, a) in ALL.iter().enumerate() {
            assert!(a.outputs <= MAX_OUTPUTS && a.parameters.len() <= MAX_PARAMETERS);
            for b in &ALL[k + 1..] {
                assert!(a.id != b.id && a.name != b.name, "{} and {}", a.name, b.name);
            }
        }
    }

    #[test]
    fn lag_follows_a_step_in_its_time() {
        let left = run("thermal-lag", 100.0, |k| if k == 0 { 0.0 } else { 10.0 }, 101);
        assert!((left + 10.0 * (-1.0f32).exp()).abs() < 0.05, "{left}");
        assert_eq!(run("thermal-lag", 100.0, |_| 25.0, 50), 0.0, "starts in equilibrium");
    }

    #[test]
    fn play_is_half_a_width_behind_on_either_branch() {
        let up = |k: u16| f32::from(k) * 0.1;
        assert!((run("hysteresis", 4.0, up, 100) + 2.0).abs() < 1e-4);
        let turn = |k: u16| {
            if k < 100 {
                f32::from(k) * 0.1
            } else {
                20.0 - f32::from(k) * 0.1
            }
        };
        assert!((run("hysteresis", 4.0, turn, 200) - 2.0).abs() < 1e-4);
    }

    #[test]
    fn kink_bends_where_it_says() {
        assert_eq!(run("kink", 20.0, |_| 19.9, 3), 0.0);
        assert!((run("kink", 20.0, |_| 65.0, 3) - 1.0).abs() < 1e-6);
    }

    #[test]
    fn a_temperature_step_has_its_middle_and_its_width() {
        let at = |t: f32| {
            let mut e = Running::new(EffectId::TemperatureStep.facts().id, &[20.0, 4.0], 1.0).expect("in the list");
            step(&mut e, t, 0.0)[0]
        };
        assert_eq!([17.9, 20.0, 22.1].map(at), [0.0, 0.5, 1.0]);
        assert!((at(21.0) - 0.84375).abs() < 1e-6);
    }

    #[test]
    fn a_soft_relay_rises_at_one_temperature_and_falls_at_another() {
        let mut e = Running::new(EffectId::SoftRelay.facts().id, &[15.0, 5.0], 1.0).expect("in the list");
        let mut at = |t: f32| step(&mut e, t, 0.0)[0];
        // In the middle of the rise while heating, and of the fall while cooling.
        let path = [-20.0, 15.0, 40.0, 5.0, -20.0].map(&mut at);
        assert_eq!(path, [0.0, 0.5, 1.0, 0.5, 0.0]);
    }

    #[test]
    fn squares_of_lags_have_the_sign_of_the_lag_in_the_second_half() {
        let mut e = Running::new(EffectId::LagSquares.facts().id, &[1e6, 1e7], 1.0).expect("in the list");
        assert_eq!(step(&mut e, 0.0, 0.0), [0.0; MAX_OUTPUTS], "starts in equilibrium");
        for (t, sign) in [(45.0, -1.0), (-45.0, 1.0)] {
            let x = step(&mut e, t, 0.0);
            assert!((x[0] - 1.0).abs() < 1e-4 && (x[7] - sign).abs() < 1e-4, "{x:?}");
        }
    }

    #[test]
    fn a_curve_of_the_time_since_power_on_holds_its_last_value() {
        let mut e = Running::new(EffectId::PowerOnCurve.facts().id, &[1300.0, 0.0], 1.0).expect("in the list");
        let mut at = |time_s: f32| step(&mut e, 20.0, time_s);
        assert_eq!((at(0.0)[0], at(150.0)[1], at(150.0)[2]), (1.0, 0.5, 0.5));
        assert_eq!([1300.0, 1e5].map(|t| at(t)[13]), [1.0, 1.0]);
    }

    #[test]
    fn an_underdamped_lag_overshoots_and_settles() {
        let (period_s, damping) = (600.0f32, 0.3f32);
        let mut e = Running::new(EffectId::UnderdampedLag.facts().id, &[period_s, damping], 1.0).expect("in the list");
        assert_eq!(step(&mut e, 0.0, 0.0)[0], 0.0, "starts in equilibrium");
        let way: [f32; 6000] = core::array::from_fn(|_| step(&mut e, 10.0, 0.0)[0]);
        // A step response passes its end by exp(-pi z / (1 - z^2)^0.5), half a damped period after the step.
        let root = (1.0 - damping * damping).sqrt();
        let passed = 10.0 * (-core::f32::consts::PI * damping / root).exp();
        let (at, most) = way.iter().enumerate().fold((0, 0.0f32), |m, (k, x)| if *x > m.1 { (k, *x) } else { m });
        assert!((most / passed - 1.0).abs() < 0.02, "{most} instead of {passed}");
        assert!((at as f32 / (0.5 * period_s / root) - 1.0).abs() < 0.01, "{at}");
        assert!(way[5999].abs() < 1e-3, "{}", way[5999]);
    }

    #[test]
    fn what_a_ramp_has_stirred_decays_after_it() {
        let mut e = Running::new(EffectId::RampSquareLags.facts().id, &[60.0, 600.0], 1.0).expect("in the list");
        // (A ramp of 0.5 C per minute, for long.)
        let last = (0..6000).map(|_| step(&mut e, 20.0, 0.0)).last().expect("steps");
        assert!(last[..8].iter().all(|x| (x - 0.25).abs() < 1e-3) && last[8..] == [0.0; 6], "{last:?}");
    }

    #[test]
    fn between_a_hot_and_a_cold_past_of_squared_ramps_lies_every_other() {
        let after = |soaked_c: f32| {
            let mut effect = RampSquareLags::new(parameters::Taus { tau_min_s: 60.0, tau_max_s: 6000.0 }, 1.0);
            effect.soak_at(soaked_c);
            with_inputs(20.0, 0.0, 1.0, |inputs| effect.step(inputs))
        };
        assert_eq!(after(-45.0), [0.0; 8]);
        let fastest = SCALING.linear_beyond_c_per_min;
        let most = fastest * fastest;
        assert!(after(65.0).iter().all(|x| (0.975 * most..most).contains(x)), "{:?}", after(65.0));
    }

    #[test]
    fn a_butterfly_is_the_same_on_both_branches_in_its_second_part() {
        let mut e = Running::new(EffectId::Butterfly.facts().id, &[10.0, 0.0], 1.0).expect("in the list");
        let path = [0.0, 30.0, 25.0, 0.0].map(|t| step(&mut e, t, 0.0));
        assert_eq!(path.map(|x| [x[0], x[1]]), [[0.0, 0.0], [-1.0, 1.0], [0.0, 0.0], [1.0, 1.0]]);
    }

    #[test]
    fn a_widening_play_has_its_widths_at_both_ends() {
        let at = |t: f32| {
            let mut e = Running::new(EffectId::WideningPlay.facts().id, &[4.0, 16.0], 1.0).expect("in the list");
            [t - 40.0, t].map(|t| step(&mut e, t, 0.0)[0])[1]
        };
        // The lower end is -45 C, the middle 10 C, the upper end 65 C.
        for (t, half) in [(-45.0, 2.0), (10.0, 4.0), (65.0, 8.0), (80.0, 8.0)] {
            assert!((at(t) + half).abs() < 1e-4, "{t}: {}", at(t));
        }
    }

    #[test]
    fn a_loop_by_temperature_is_a_hysteresis_times_a_parabola() {
        let of = |id: EffectId, t: f32| {
            let mut e = Running::new(id.facts().id, &[10.0, 0.0], 1.0).expect("in the list");
            [t - 40.0, t].map(|t| step(&mut e, t, 0.0))[1]
        };
        // Normalised temperature is held from 65 C on.
        for (t, u) in [(-35.0, -1.0), (10.0, 0.0), (55.0, 1.0), (80.0, 55.0 / 45.0)] {
            let (x, [one, ..]) = (of(EffectId::HysteresisByTemperature, t), of(EffectId::Hysteresis, t));
            assert!((one + 5.0).abs() < 1e-4 && x[0].to_bits() == one.to_bits(), "{t}: {x:?}");
            assert!((x[1] - u * one).abs() < 1e-4 && (x[2] - u * u * one).abs() < 1e-4, "{t}: {x:?}");
        }
    }

    #[test]
    fn a_late_onset_has_its_middle_and_its_duration() {
        let mut e = Running::new(EffectId::LateOnset.facts().id, &[3600.0, 1200.0], 1.0).expect("in the list");
        let path = [0.0, 2999.0, 3600.0, 4201.0, 1e5].map(|time_s| step(&mut e, 20.0, time_s)[0]);
        assert_eq!(path, [0.0, 0.0, 0.5, 1.0, 1.0]);
    }

    #[test]
    fn an_asymmetric_lag_has_a_time_for_each_direction() {
        let mut e = Running::new(EffectId::AsymmetricLag.facts().id, &[300.0, 1200.0], 1.0).expect("in the list");
        assert_eq!(step(&mut e, 0.0, 0.0)[0], 0.0, "starts in equilibrium");
        // After a time constant a step has 1/e to go, either way.
        let warmed = (0..300).map(|_| step(&mut e, 10.0, 0.0)[0]).last().expect("steps");
        assert!((warmed / -10.0 - (-1.0f32).exp()).abs() < 1e-4, "{warmed}");
        let from = 10.0 + warmed;
        let cooled = (0..1200).map(|_| step(&mut e, 0.0, 0.0)[0]).last().expect("steps");
        assert!((cooled / from - (-1.0f32).exp()).abs() < 1e-4, "{cooled}");
    }

    #[test]
    fn a_warm_up_by_temperature_is_a_parabola_that_decays() {
        let mut e = Running::new(EffectId::WarmUpByTemperature.facts().id, &[600.0, 0.0], 1.0).expect("in the list");
        for (t, time_s) in [(-20.0f32, 0.0f32), (40.0, 600.0), (80.0, 1200.0)] {
            let (_, u) = SCALING.u_and_inside(t);
            let left = (-time_s / 600.0).exp();
            let got = step(&mut e, t, time_s);
            for (got, want) in got.iter().zip([left, left * u, left * u * u]) {
                assert!((got - want).abs() < 1e-6, "{got} instead of {want} at {t} C");
            }
        }
    }

    #[test]
    fn a_damped_oscillation_turns_and_decays() {
        let mut e = Running::new(EffectId::DampedOscillation.facts().id, &[1200.0, 0.1], 1.0).expect("in the list");
        let round = (-core::f32::consts::TAU * 0.1).exp();
        for (turns, want) in [(0.0f32, [1.0, 0.0]), (0.25, [0.0, 1.0]), (1.0, [1.0, 0.0]), (1.5, [-1.0, 0.0])] {
            let got = step(&mut e, 20.0, 1200.0 * turns);
            for (got, want) in got.iter().zip(want) {
                assert!((got - want * round.powf(turns)).abs() < 1e-5, "{got} at {turns}");
            }
        }
    }

    #[test]
    fn a_ramp_band_is_the_slope_of_a_swing() {
        let mut e = Running::new(EffectId::RampBand.facts().id, &[20.0, 5.0], 1.0).expect("in the list");
        let mut at = |t: f32, ramp: f32| with_inputs(t, ramp, 0.0, |i| e.step(i))[..2].to_vec();
        assert_eq!(at(20.0, -0.5), [-0.5, 0.0], "as it is in the middle, and nothing of it is heating");
        let swing = |t: f32| (t - 20.0) / 5.0 * (-0.5 * ((t - 20.0) / 5.0).powi(2)).exp();
        for t in [12.0, 18.0, 22.0, 25.0, 31.0] {
            let slope = 5.0 * (swing(t + 0.01) - swing(t - 0.01)) / 0.02;
            assert!(at(t, 1.0).iter().all(|x| (x - slope).abs() < 1e-3), "{t}: {slope}");
        }
        assert!(at(80.0, 1.0).iter().all(|x| x.abs() < 1e-10), "far off there is none");
    }

    #[test]
    fn a_kink_of_an_input_is_of_the_own_axis() {
        let quad = EffectId::InputKink.facts().id;
        let mut values = [f32::NAN; crate::inputs::QUANTITIES];
        values[5..8].copy_from_slice(&[0.2, -0.1, 0.5]);
        let quantities = Quantities::new(values);
        let got = [0, 1, 2].map(|axis| {
            let mut e = Running::new(quad, &[0.1, 5.0], 1.0).expect("in the list");
            let x = with_inputs(20.0, 0.5, 0.0, |i| e.step(&Inputs { axis, quantities: &quantities, ..*i }));
            assert_eq!(reads(quad, &[0.1, 5.0], axis), QuantitySet::one(crate::inputs::quad(axis)));
            [x[0], x[1]]
        });
        assert_eq!(got, [[0.1, 0.2], [0.0, -0.1], [0.4, 0.5]]);
    }

    #[test]
    fn a_quantity_of_its_own_is_that_of_the_axis() {
        let [own, one] = [EffectId::OwnQuantity, EffectId::RecordedQuantity].map(|e| e.facts().id);
        let quantities = |k: f32| Quantities::new(core::array::from_fn(|number| 0.1 * number as f32 + 0.01 * k));
        for axis in 0..AXES {
            let number = crate::inputs::drive(axis);
            // (Any axis' drive stands for it.)
            let [mut own, mut one] = [(own, 3.0), (one, f32::from(number))]
                .map(|(id, p)| Running::new(id, &[p, 0.0], 1.0).expect("in the list"));
            for k in 0..3u8 {
                let quantities = quantities(k.into());
                let [own, one] = [&mut own, &mut one]
                    .map(|e| with_inputs(20.0, 0.5, 0.0, |i| e.step(&Inputs { axis, quantities: &quantities, ..*i })));
                assert_eq!(own, one);
                assert_eq!(own[0], quantities.drive_v(axis));
            }
        }
    }

    #[test]
    fn warm_up_decays() {
        assert!((run("warm-up", 600.0, |_| 20.0, 601) - (-1.0f32).exp()).abs() < 1e-3);
    }

    #[test]
    fn what_is_missing_is_nan() {
        for name in ["case-gradient", "timebase", "drive-amplitude", "quadrature", "board", "input-kink"] {
            assert!(run(name, 0.0, |_| 20.0, 2).is_nan(), "{name}");
        }
    }

    #[test]
    fn unit_effects_are_finite_at_any_temperature() {
        for facts in ALL.iter().filter(|f| f.reach == Reach::Unit) {
            let p = match facts.name {
                "temperature-shape" => [-35.0, 55.0],
                "widening-play" => [10.0, 20.0],
                _ => [10.0, 0.0],
            };
            let mut effect = Running::new(facts.id, &p, 1.0).expect("in the list");
            for t in [-300.0, -40.0, 0.0, 1e4] {
                assert!(step(&mut effect, t, 5.0).iter().all(|x| x.is_finite()), "{} at {t}", facts.name);
            }
        }
    }
}
