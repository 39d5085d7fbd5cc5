//! Effects that the baseline model ([`crate::bias`]) lacks, each one file with its equation, state and source.
//!
//! An effect turns the state of the unit into one or more *regressors* for each axis; the bias it stands for
//! is the sum of regressor times gain. Inner parameters (a lag time, a width) are common to the three axes,
//! gains belong to an axis. To add one: write its file, add it to the list at the end of this one, give it a
//! number that was never used, and test it.
//!
//! Numbers are stable: they are what the calibration block stores.

use crate::bias::Scaling;
use crate::AXES;

/// Most inner parameters of an effect.
pub const MAX_PARAMETERS: usize = 2;
/// Most regressors of an effect, per axis.
pub const MAX_OUTPUTS: usize = 8;

/// What an effect may look at: one axis, one model step. A quantity that is not recorded is NaN.
#[derive(Debug, Clone, Copy)]
pub struct Inputs<'a> {
    /// Centre and scale of the model.
    pub scaling: &'a Scaling,
    /// The axis in question, 0 to 2.
    pub axis: usize,
    /// Resonator temperatures of the three axes, C.
    pub temperature_c: [f32; AXES],
    /// Rate of change of this axis' temperature, C per minute.
    pub rate_c_per_min: f32,
    /// Normalised resonator frequency of this axis ([`crate::temperature::TemperatureLaw::normalised`]).
    pub frequency_u: f32,
    /// Time since power-on, s.
    pub time_s: f32,
    /// What only a chamber recording has.
    pub recorded: Recorded,
}

/// Quantities that a recording may hold and the unit does not measure; NaN where missing.
#[derive(Debug, Clone, Copy)]
pub struct Recorded {
    /// Shell sensors, C.
    pub shell_c: [f32; AXES],
    /// Board temperature, C.
    pub board_c: f32,
    /// Supply, V.
    pub supply_v: f32,
    /// Amplitude-control drive of this axis, V.
    pub drive_v: f32,
    /// Quadrature-nulling voltage of this axis, V.
    pub quad_v: f32,
}

impl Recorded {
    /// Nothing recorded: what the unit has.
    pub const NONE: Self =
        Self { shell_c: [f32::NAN; AXES], board_c: f32::NAN, supply_v: f32::NAN, drive_v: f32::NAN, quad_v: f32::NAN };
}

impl Inputs<'_> {
    /// Temperature of this axis, C.
    #[inline]
    #[must_use]
    pub fn own_c(&self) -> f32 {
        self.temperature_c[self.axis]
    }
}

/// Whether a unit can compensate an effect.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reach {
    /// The unit has all it needs.
    Unit,
    /// Needs a quantity that only the recording has: mend the unit's wiring, or the cause.
    NeedsInput(&'static str),
    /// No unit can predict it: something to mend in the unit or the chamber.
    Unpredictable,
}

/// What every effect states about itself, and how it runs.
pub trait Effect: Sized {
    /// Name in reports.
    const NAME: &'static str;
    /// Number in the calibration block.
    const ID: u16;
    /// Names of the inner parameters, with unit.
    const PARAMETERS: &'static [&'static str];
    /// Regressors per axis.
    const OUTPUTS: usize;
    /// Who can compensate it.
    const REACH: Reach;
    /// In its initial state. `step_s` is the time between calls of [`step`](Self::step), s.
    fn new(parameters: &[f32; MAX_PARAMETERS], step_s: f32) -> Self;
    /// Advances by one step and gives the regressors; NaN where a needed quantity is missing.
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; MAX_OUTPUTS];
}

/// One regressor, the rest zero.
#[inline]
fn one(value: f32) -> [f32; MAX_OUTPUTS] {
    two(value, 0.0)
}

/// Two regressors, the rest zero.
#[inline]
fn two(first: f32, second: f32) -> [f32; MAX_OUTPUTS] {
    [first, second, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
}

/// Share of the way that a first-order lag of `tau_s` goes in `step_s`, exact for a held input.
fn lag_share(step_s: f32, tau_s: f32) -> f32 {
    if tau_s > 0.0 {
        1.0 - libm::expf(-step_s / tau_s)
    } else {
        1.0
    }
}

/// Facts about one effect of the list.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Facts {
    /// Name in reports.
    pub name: &'static str,
    /// Number in the calibration block.
    pub id: u16,
    /// Names of the inner parameters, with unit.
    pub parameters: &'static [&'static str],
    /// Regressors per axis.
    pub outputs: usize,
    /// Who can compensate it.
    pub reach: Reach,
}

// Inlined, so that regressors that an effect has not are neither cleared nor multiplied.
#[inline(always)]
fn weighed<E: Effect>(effect: &mut E, inputs: &Inputs<'_>, gains: &[f32; MAX_OUTPUTS]) -> f32 {
    let x = effect.step(inputs);
    crate::bias::dot(gains, x.iter().take(E::OUTPUTS))
}

macro_rules! effects {
    ($($module:ident :: $name:ident),+ $(,)?) => {
        $(mod $module; pub use $module::$name;)+

        /// Every effect, in the order of the list.
        pub const ALL: &[Facts] = &[$(Facts {
            name: <$name as Effect>::NAME,
            id: <$name as Effect>::ID,
            parameters: <$name as Effect>::PARAMETERS,
            outputs: <$name as Effect>::OUTPUTS,
            reach: <$name as Effect>::REACH,
        }),+];

        /// One running effect of one axis.
        #[derive(Debug, Clone)]
        pub enum Running { $(#[doc = concat!("See [`", stringify!($name), "`].")] $name($name)),+ }

        impl Running {
            /// Starts the effect with number `id`; `None` if there is no such number.
            #[must_use]
            pub fn new(id: u16, parameters: &[f32; MAX_PARAMETERS], step_s: f32) -> Option<Self> {
                match id {
                    $(<$name as Effect>::ID => Some(Self::$name(<$name as Effect>::new(parameters, step_s))),)+
                    _ => None,
                }
            }
            /// Advances by one step and gives the regressors.
            #[inline]
            pub fn step(&mut self, inputs: &Inputs<'_>) -> [f32; MAX_OUTPUTS] {
                match self { $(Self::$name(e) => e.step(inputs)),+ }
            }
            /// Advances by one step and gives the regressors times their gains, summed up: what a unit needs of them.
            #[inline]
            pub fn bias_dph(&mut self, inputs: &Inputs<'_>, gains: &[f32; MAX_OUTPUTS]) -> f32 {
                match self { $(Self::$name(e) => weighed(e, inputs, gains)),+ }
            }
        }
    };
}

effects! {
    cubic::Cubic,
    kink::Kink,
    temperature_shape::TemperatureShape,
    thermal_lag::ThermalLag,
    second_derivative::SecondDerivative,
    hysteresis::Hysteresis,
    axis_gradient::AxisGradient,
    case_gradient::CaseGradient,
    warm_up::WarmUp,
    aging::Aging,
    step::Step,
    periodic::Periodic,
    timebase::Timebase,
    drive_amplitude::DriveAmplitude,
    quadrature::Quadrature,
    board::Board,
    frequency_direct::FrequencyDirect,
    cooling_heating::CoolingHeating,
}

/// Facts about the effect with a number.
#[must_use]
pub fn by_id(id: u16) -> Option<&'static Facts> {
    ALL.iter().find(|f| f.id == id)
}

/// Facts about the effect with a name.
#[must_use]
pub fn by_name(name: &str) -> Option<&'static Facts> {
    ALL.iter().find(|f| f.name == name)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SCALING: Scaling =
        Scaling { t_ref_c: 10.0, t_scale_c: 45.0, t_linear_c: [-45.0, 65.0], r_linear: 6.0, blend_band: 0.2 };

    fn inputs(t: f32, time_s: f32) -> Inputs<'static> {
        Inputs {
            scaling: &SCALING,
            axis: 0,
            temperature_c: [t, t + 2.0, t - 3.0],
            rate_c_per_min: 0.5,
            frequency_u: 0.1,
            time_s,
            recorded: Recorded::NONE,
        }
    }

    fn run(name: &str, parameter: f32, at: impl Fn(u16) -> f32, steps: u16) -> f32 {
        let facts = by_name(name).expect("in the list");
        let mut effect = Running::new(facts.id, &[parameter, 0.0], 1.0).expect("in the list");
        let mut last = f32::NAN;
        for k in 0..steps {
            last = effect.step(&inputs(at(k), f32::from(k)))[0];
        }
        last
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
    fn warm_up_decays() {
        assert!((run("warm-up", 600.0, |_| 20.0, 601) - (-1.0f32).exp()).abs() < 1e-3);
    }

    #[test]
    fn what_is_not_recorded_is_nan() {
        for name in ["case-gradient", "timebase", "drive-amplitude", "quadrature", "board"] {
            assert!(run(name, 0.0, |_| 20.0, 2).is_nan(), "{name}");
        }
    }

    #[test]
    fn unit_effects_are_finite_at_any_temperature() {
        for facts in ALL.iter().filter(|f| f.reach == Reach::Unit) {
            let p = match facts.name {
                "temperature-shape" => [-35.0, 55.0],
                _ => [10.0, 0.0],
            };
            let mut effect = Running::new(facts.id, &p, 1.0).expect("in the list");
            for t in [-300.0, -40.0, 0.0, 1e4] {
                assert!(effect.step(&inputs(t, 5.0)).iter().all(|x| x.is_finite()), "{} at {t}", facts.name);
            }
        }
    }
}
