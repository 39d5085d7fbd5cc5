//! One card for each effect: what the desktop must know of it beyond its equation. The compiler asks for a card of every effect.

use crate::recording::steps::Run;
use hrg_core::effects::parameters::{
    Arrhenius, Band, Bend, BothWays, Breakpoint, Channel, Cycle, EndWidths, Lag, Onset, Parameters, Pulse, Ramp,
    RampRange, Rise, Source, Swing, Tau, Taus, TemperatureRange, Thresholds, Until, Width, Widths,
};
use hrg_core::effects::{EffectId, Facts, ALL, MAX_PARAMETERS};
use hrg_core::inputs::{self, QUANTITIES};
use hrg_core::AXES;
use serde::{Serialize, Serializer};
use std::ops::RangeInclusive;

/// Class of physics of an effect.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Class {
    /// Linear thermal memory: lags, relaxations, gradients between bodies.
    Memory,
    /// Memory of the path, not of time.
    Hysteresis,
    /// A curve of temperature.
    Shape,
    /// A curve of the rate of change of temperature.
    Rate,
    /// A curve of the time since power-on.
    PowerOn,
    /// A recorded quantity.
    Input,
    /// The thermometer is at fault.
    Thermometer,
    /// Happens once, or cannot be predicted.
    Event,
    /// A user's own effect, of unknown physics.
    Own,
}

impl Class {
    /// Its name in reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Memory => "memory",
            Self::Hysteresis => "hysteresis",
            Self::Shape => "shape",
            Self::Rate => "rate",
            Self::PowerOn => "power-on",
            Self::Input => "input",
            Self::Thermometer => "thermometer",
            Self::Event => "event",
            Self::Own => "own",
        }
    }
}

impl Serialize for Class {
    fn serialize<S: Serializer>(&self, s: S) -> Result<S::Ok, S::Error> {
        s.serialize_str(self.name())
    }
}

/// Inner parameters of an effect as a row: what a search varies. [`Parameters`] gives them their names.
pub type ParameterRow = [f32; MAX_PARAMETERS];

/// Makes the values of the inner parameters to begin with.
pub type Grid = fn(&Extent) -> Vec<ParameterRow>;

/// Span of the runs (temperature, ramp, duration), from which a card makes its grid.
#[derive(Debug, Clone, Copy)]
pub struct Extent {
    /// Lowest temperature, C.
    pub low_c: f32,
    /// Highest temperature, C.
    pub high_c: f32,
    /// Fastest ramp either way, C per minute.
    pub fastest_c_per_min: f32,
    /// Duration of the longest run, s.
    pub longest_s: f32,
    /// Time constant by which the resonators follow their cases, s.
    pub lag_s: f32,
    /// Least and greatest value of each quantity beside the frequencies, as effects count it; `None` where no run has it.
    pub quantities: [Option<[f32; 2]>; QUANTITIES],
    /// Number of runs.
    pub runs: usize,
    /// Set if the runs pass a third of the temperatures at least twice the same way, heating or cooling.
    pub path_repeats: bool,
}

impl Extent {
    /// Difference of both temperatures, C.
    #[must_use]
    pub fn span_c(&self) -> f32 {
        self.high_c - self.low_c
    }

    /// The span by whose shares a parameter is moved that is not multiplied: that of the recorded quantity, or that of temperature.
    #[must_use]
    pub fn width(&self, how: Move, parameters: &ParameterRow) -> f32 {
        match how {
            Move::Level(_) => self.quantity(parameters[1] as u8).map_or(0.0, |[low, high]| high - low),
            _ => self.span_c(),
        }
    }

    /// Least and greatest value of a quantity, of all axes if it is an axis'.
    #[must_use]
    pub fn quantity(&self, number: u8) -> Option<[f32; 2]> {
        let of_axis = |a| self.quantities.get(usize::from(inputs::of_axis(number, a))).copied().flatten();
        (0..AXES).filter_map(of_axis).reduce(|[low, high], [l, h]| [low.min(l), high.max(h)])
    }
}

/// Role of an effect in the search.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// A named physical effect with few gains.
    Simple,
    /// A family: many columns that are linear in their gains, whose parameters are not searched.
    Family,
    /// A family with a parameter to choose: some values are offered.
    Searched,
    /// Found by the data themselves (a step, a period): offered where a jump or a spectral line points.
    Proposed,
    /// Excluded from the search: linearly dependent on another family.
    Idle,
}

/// Way in which an inner parameter is moved after the grid search.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Move {
    /// Multiplied: a time, a width, a scale. The number is the share of it that the first step takes.
    Factor(f32),
    /// A period of temperature: multiplied, by less than a quarter of a cycle over the span.
    Cycle,
    /// A temperature: moved by steps of this share of the span.
    Place(f32),
    /// A value of the recorded quantity whose number is the second parameter: moved by steps of this share of its range.
    Level(f32),
    /// A moment: moved by steps of a block of rows.
    Block,
    /// A period in time: moved by less than a cycle over the run.
    Period,
}

impl Move {
    /// `true` if the parameter is multiplied, and not moved by a distance.
    #[must_use]
    pub fn by_factor(self) -> bool {
        matches!(self, Self::Factor(_) | Self::Cycle)
    }
}

/// First step of a time, a width or a scale, as a share of it.
const SCALE: Move = Move::Factor(0.16);

/// See the module.
pub struct Card {
    /// Class of physics.
    pub class: Class,
    /// Role in the search.
    pub kind: Kind,
    /// Refinement of its inner parameters, in their order; those behind the last keep the values of the grid.
    pub refine: &'static [Move],
    /// `false` for values of the inner parameters that contradict each other, or that runs of this extent could not show.
    pub possible: fn(&ParameterRow, &Extent) -> bool,
    /// Set if a model may hold it more than once.
    pub repeats: bool,
    /// Values of the inner parameters to begin with.
    pub grid: Grid,
    /// Inputs that a recording must have for it.
    pub needs: Needs,
    /// Draw of its parameters when the simulator puts it into a run.
    pub generator: Generator,
    /// Set if a chamber profile is judged by its separation of this effect from the others.
    pub parted_by_profile: bool,
    /// Text of the repair for an effect that a unit cannot compensate.
    pub repair: Option<Repair>,
    /// Its meaning, in words for who sees its name for the first time.
    pub meaning: &'static str,
}

/// Inputs that an effect needs from a recording, beside those whose absence the effect itself shows by NaN.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Needs {
    /// Nothing.
    Nothing,
    /// Temperatures of three axes that can differ.
    OtherAxes,
    /// A resonator as the thermometer.
    Resonator,
    /// Resonators on all three axes.
    ThreeResonators,
}

impl Needs {
    /// `true` if a run has these inputs.
    #[must_use]
    pub fn met_by(self, run: &Run) -> bool {
        let thermometer = run.steps.thermometer;
        let three = run.steps.present().count() == AXES;
        match self {
            Self::Nothing => true,
            Self::OtherAxes => three && thermometer.parts_axes(),
            Self::Resonator => !thermometer.is_sensor(),
            Self::ThreeResonators => three && !thermometer.is_sensor(),
        }
    }
}

/// Use of an effect by the simulator: its usual parameters and their range.
#[derive(Debug, Clone, Copy)]
pub struct Generator {
    /// Inner parameters unless told otherwise, in the order of the fields.
    pub usual: [f64; MAX_PARAMETERS],
    /// Range from which the first one is drawn; `None`: as usual.
    pub range: Option<[f64; 2]>,
    /// Set if `secret:SEED` may draw it.
    pub secret: bool,
    /// Set if the study of single effects has it.
    pub study: bool,
}

/// Makes the text of a repair from the inner parameters by name.
pub type Repair = fn(&dyn Fn(&str) -> f64) -> String;

fn rows<P: Parameters>(sets: impl IntoIterator<Item = P>) -> Vec<ParameterRow> {
    sets.into_iter().map(P::row).collect()
}

fn log(from: f32, to: f32, n: usize) -> impl Iterator<Item = f32> {
    (0..n).map(move |k| from * (to / from).powf(k as f32 / (n - 1) as f32))
}

fn even(from: f32, to: f32, n: usize) -> impl Iterator<Item = f32> {
    (0..n).map(move |k| from + (to - from) * k as f32 / (n - 1) as f32)
}

fn once(_: &Extent) -> Vec<ParameterRow> {
    vec![[0.0; MAX_PARAMETERS]]
}

fn nowhere(_: &Extent) -> Vec<ParameterRow> {
    vec![]
}

fn lags(x: &Extent) -> Vec<ParameterRow> {
    rows([Taus { tau_min_s: 60.0, tau_max_s: slowest(x) }])
}

/// The slowest memory that a run can show, s.
fn slowest(x: &Extent) -> f32 {
    (0.9 * x.longest_s).clamp(600.0, 21_600.0)
}

fn decays(x: &Extent) -> Vec<ParameterRow> {
    rows([Taus { tau_min_s: 120.0, tau_max_s: (0.8 * x.longest_s).max(2000.0) }])
}

fn ramps(x: &Extent) -> Vec<ParameterRow> {
    rows([RampRange { ramp_max_c_per_min: x.fastest_c_per_min }])
}

fn temperatures(x: &Extent) -> Vec<ParameterRow> {
    rows([TemperatureRange { low_c: x.low_c, high_c: x.high_c }])
}

fn behind_the_case(x: &Extent) -> Vec<ParameterRow> {
    rows([Lag { lag_s: x.lag_s }])
}

fn plays(x: &Extent) -> Vec<ParameterRow> {
    rows([Widths { width_min_c: narrowest(x), width_max_c: 0.9 * x.span_c() }])
}

/// Widths of a loop.
fn loops(x: &Extent) -> Vec<ParameterRow> {
    rows(log((0.03 * x.span_c()).max(0.5), 0.75 * x.span_c(), 14).map(|width_c| Width { width_c }))
}

/// All pairs of two values that differ.
fn unlike(values: impl Iterator<Item = f32>) -> Vec<(f32, f32)> {
    let values: Vec<f32> = values.collect();
    let pairs = values.iter().flat_map(|one| values.iter().map(move |other| (*one, *other)));
    pairs.filter(|(one, other)| one != other).collect()
}

/// Pairs of unlike widths, of a loop in the cold and of the same one in the heat.
fn unequal_loops(x: &Extent) -> Vec<ParameterRow> {
    let pairs = unlike(log((0.03 * x.span_c()).max(0.5), 0.75 * x.span_c(), 7));
    rows(pairs.into_iter().map(|(width_cold_c, width_hot_c)| EndWidths { width_cold_c, width_hot_c }))
}

/// Time constants of a lag.
fn delays(x: &Extent) -> impl Iterator<Item = f32> {
    log(120.0, (x.longest_s / 2.5).max(600.0), 18)
}

/// Pairs of unlike time constants, of a lag that warms and of the same one that cools.
fn unequal_times(x: &Extent) -> Vec<ParameterRow> {
    let pairs = unlike(delays(x));
    rows(pairs.into_iter().map(|(warming_tau_s, cooling_tau_s)| BothWays { warming_tau_s, cooling_tau_s }))
}

/// `true` if a swing dies away within a run: three of its time constants.
fn swings_end(swing: Swing, x: &Extent) -> bool {
    swing.period_s <= core::f32::consts::TAU * swing.damping * x.longest_s / 3.0
}

/// Places within the ranges of the recorded quantities.
fn bends(x: &Extent) -> Vec<ParameterRow> {
    // (Of an axis' quantities the first stands for all; a temperature bends where the resonators do, and they tell that better.)
    let channels = [1, 2, 5].into_iter().chain(12..QUANTITIES as u8);
    let ranges = channels.filter_map(|channel| Some((f32::from(channel), x.quantity(channel)?)));
    rows(ranges.flat_map(|(channel, range)| {
        let within = within(range);
        even(*within.start(), *within.end(), 12).map(move |break_at| Bend { break_at, channel })
    }))
}

/// The places of a range but for a tenth at each end.
fn within([low, high]: [f32; 2]) -> RangeInclusive<f32> {
    let margin = 0.1 * (high - low);
    low + margin..=high - margin
}

/// A grid for forms that one heating and one cooling do not tell from what happened once.
fn where_path_repeats(x: &Extent, grid: Grid) -> Vec<ParameterRow> {
    if x.path_repeats {
        grid(x)
    } else {
        vec![]
    }
}

/// The narrowest loop, and the sharpest rise, that a run can tell from none, C.
fn narrowest(x: &Extent) -> f32 {
    (0.012 * x.span_c()).max(0.3)
}

/// Distance of the knots of `temperature-spline`, C: what is sharper than that is none of its curves.
fn knots_apart(x: &Extent) -> f32 {
    x.span_c() / (EffectId::TemperatureSpline.facts().outputs - 1) as f32
}

/// Middles and widths of what the spline does not follow.
fn places(x: &Extent) -> impl Iterator<Item = (f32, f32)> {
    let apart = knots_apart(x);
    even(x.low_c + apart, x.high_c - apart, 23).map(move |middle_c| (middle_c, apart))
}

/// `true` for a width that the spline does not follow, and that a run shows.
fn sharper_than_the_spline(width_c: f32, x: &Extent) -> bool {
    (narrowest(x)..=2.0 * knots_apart(x)).contains(&width_c)
}

/// Periods of a ripple, evenly in the number of ripples over the span.
fn ripples(x: &Extent) -> Vec<ParameterRow> {
    let most = (2.0 * x.span_c() / 3.0) as usize;
    rows((4..=most.max(4)).map(|k| Cycle { period_c: 2.0 * x.span_c() / k as f32 }))
}

/// `true` if a run of this extent shows the loop between two thresholds.
fn loop_shows(row: &ParameterRow, x: &Extent) -> bool {
    let t = Thresholds::of(row);
    t.on_c - t.off_c >= narrowest(x)
}

/// The shortest rise in time that is none of the events, which happen at once, s.
const SHORTEST_RISE_S: f32 = 600.0;

/// Pairs of thresholds at some places of the temperatures: on above off.
fn thresholds(x: &Extent, places: usize) -> Vec<ParameterRow> {
    let place = |k: usize| x.low_c + x.span_c() * k as f32 / (places + 1) as f32;
    rows((1..=places).flat_map(|on| (1..on).map(move |off| Thresholds { on_c: place(on), off_c: place(off) })))
}

impl Generator {
    /// These inner parameters always; neither drawn nor in the study.
    const fn of(usual: [f64; MAX_PARAMETERS]) -> Self {
        Self { usual, range: None, secret: false, study: false }
    }

    /// The same, in the study of single effects.
    const fn studied(usual: [f64; MAX_PARAMETERS]) -> Self {
        Self { study: true, ..Self::of(usual) }
    }

    /// In the study, with a first parameter that `secret:SEED` draws from a range.
    const fn drawn(usual: f64, low: f64, high: f64) -> Self {
        Self { range: Some([low, high]), secret: true, ..Self::studied([usual, 0.0]) }
    }
}

impl Card {
    /// An effect with one start value of its inner parameters, that needs no input and is compensated by the unit.
    const fn of(class: Class, kind: Kind, meaning: &'static str) -> Self {
        let grid: Grid = if matches!(kind, Kind::Idle | Kind::Proposed) { nowhere } else { once };
        Self {
            class,
            kind,
            refine: &[],
            possible: |_, _| true,
            repeats: matches!(kind, Kind::Proposed),
            grid,
            needs: Needs::Nothing,
            generator: Generator::of([0.0; MAX_PARAMETERS]),
            parted_by_profile: false,
            repair: None,
            meaning,
        }
    }
}

/// The card of an effect: one arm each.
#[must_use]
#[allow(clippy::too_many_lines)] // A table.
pub fn card(effect: EffectId) -> Card {
    use Class::{Event, Hysteresis, Input, Memory, PowerOn, Rate, Shape, Thermometer};
    use EffectId as E;
    use Kind::{Family, Idle, Proposed, Searched, Simple};
    let of = Generator::of;
    let studied = Generator::studied;
    let drawn = Generator::drawn;
    let none = [0.0; MAX_PARAMETERS];
    match effect {
        E::Cubic => Card {
            generator: Generator { secret: true, ..studied(none) },
            parted_by_profile: true,
            ..Card::of(Shape, Simple, "a cubic term of temperature")
        },
        E::Kink => Card {
            refine: &[Move::Place(0.02)],
            grid: |x| {
                let places = even(x.low_c + 0.1 * x.span_c(), x.high_c - 0.1 * x.span_c(), 20);
                rows(places.map(|break_c| Breakpoint { break_c }))
            },
            generator: drawn(8.0, -18.0, 32.0),
            parted_by_profile: true,
            ..Card::of(Shape, Simple, "the slope over temperature changes at one temperature")
        },
        E::TemperatureShape => Card {
            grid: temperatures,
            generator: studied([-38.0, 60.0]),
            ..Card::of(Shape, Simple, "a smooth curve of temperature that a parabola does not follow")
        },
        E::TemperatureSpline => Card {
            grid: temperatures,
            generator: of([-38.0, 60.0]),
            ..Card::of(Shape, Family, "a curve of temperature with more detail than a polynomial follows")
        },
        E::TemperatureStep => Card {
            refine: &[Move::Place(0.02), Move::Factor(0.3)],
            possible: |row, x| sharper_than_the_spline(Rise::of(row).width_c, x),
            repeats: true,
            grid: |x| rows(places(x).map(|(middle_c, width_c)| Rise { middle_c, width_c })),
            generator: of([15.0, 5.0]),
            ..Card::of(Shape, Simple, "the bias goes from one level to another over a few degrees")
        },
        E::Ripple => Card {
            refine: &[Move::Cycle],
            repeats: true,
            grid: ripples,
            generator: of([14.0, 0.0]),
            ..Card::of(Shape, Simple, "the bias repeats over temperature with a period")
        },
        E::FrequencyDirect => Card {
            needs: Needs::Resonator,
            ..Card::of(Shape, Idle, "a curve of frequency, without a temperature in between")
        },
        E::ThermalLag => Card {
            refine: &[SCALE],
            grid: |x| rows(delays(x).map(|tau_s| Tau { tau_s })),
            generator: drawn(2400.0, 1200.0, 6000.0),
            parted_by_profile: true,
            ..Card::of(Memory, Simple, "part of the bias follows the temperature with a delay")
        },
        E::SecondDerivative => Card {
            generator: studied(none),
            parted_by_profile: true,
            ..Card::of(Memory, Simple, "the bias follows changes of the ramp")
        },
        E::CaseGradient => Card {
            generator: studied(none),
            repair: Some(|_| needs_input(E::CaseGradient, "case_?_c")),
            ..Card::of(Memory, Simple, "the bias follows the difference between case and resonator")
        },
        E::AxisGradient => Card {
            needs: Needs::OtherAxes,
            generator: Generator { secret: true, ..studied(none) },
            parted_by_profile: true,
            ..Card::of(Memory, Simple, "the bias follows temperature differences between the axes")
        },
        E::NeighbourLags => {
            Card { needs: Needs::OtherAxes, ..Card::of(Memory, Family, "the bias follows the other axes with a delay") }
        }
        E::LagLadder => Card {
            grid: lags,
            generator: of([60.0, 6000.0]),
            ..Card::of(Memory, Family, "parts of the bias follow the temperature with several delays")
        },
        E::LagLadderByTemperature => Card {
            grid: lags,
            generator: of([60.0, 6000.0]),
            ..Card::of(Memory, Family, "delays whose weight changes with temperature")
        },
        E::LagSquares => Card {
            grid: lags,
            generator: of([60.0, 6000.0]),
            ..Card::of(Memory, Family, "the bias follows the squares of delayed temperature differences")
        },
        E::RampSquareLags => Card {
            grid: lags,
            generator: of([60.0, 6000.0]),
            ..Card::of(Memory, Family, "ramps either way stir something that decays after them")
        },
        E::UnderdampedLag => Card {
            refine: &[SCALE, Move::Factor(0.3)],
            // (Beyond half of the critical damping it is two lags in a row.)
            possible: |row, _| Swing::of(row).damping <= 0.5,
            grid: |x| {
                let periods = log(600.0, (x.longest_s / 3.0).max(1200.0), 12);
                rows(periods.map(|period_s| Swing { period_s, damping: 0.3 }))
            },
            generator: of([3000.0, 0.3]),
            ..Card::of(Memory, Simple, "part of the bias follows the temperature with a swing")
        },
        E::AsymmetricLag => Card {
            refine: &[SCALE, SCALE],
            grid: |x| where_path_repeats(x, unequal_times),
            generator: of([600.0, 2400.0]),
            ..Card::of(Memory, Simple, "part of the bias follows heating and cooling with different delays")
        },
        E::HeatingLags => Card {
            grid: |x| rows([Taus { tau_min_s: 120.0, tau_max_s: slowest(x) }]),
            generator: of([120.0, 6000.0]),
            ..Card::of(Memory, Family, "something relaxes after heating and not after cooling")
        },
        E::ArrheniusLadder => Card {
            grid: |x| {
                rows([-0.04, -0.02, 0.02, 0.04].map(|beta_per_c| Arrhenius { beta_per_c, tau_max_s: slowest(x) }))
            },
            generator: of([0.02, 6000.0]),
            ..Card::of(Memory, Searched, "delays whose times change with temperature")
        },
        E::Hysteresis => Card {
            refine: &[SCALE],
            grid: loops,
            generator: drawn(12.0, 5.0, 25.0),
            parted_by_profile: true,
            ..Card::of(
                Hysteresis,
                Simple,
                "heating and cooling follow different curves, shifted against each other by a width in temperature",
            )
        },
        E::Butterfly => Card {
            refine: &[SCALE],
            grid: |x| where_path_repeats(x, loops),
            generator: of([20.0, 0.0]),
            ..Card::of(
                Hysteresis,
                Simple,
                "the bias follows a loop and its square, so that the curves of heating and cooling cross",
            )
        },
        E::HysteresisByTemperature => Card {
            refine: &[SCALE],
            grid: |x| where_path_repeats(x, loops),
            generator: of([12.0, 0.0]),
            ..Card::of(Hysteresis, Simple, "a loop whose height changes with temperature")
        },
        E::WideningPlay => Card {
            refine: &[SCALE, SCALE],
            grid: |x| where_path_repeats(x, unequal_loops),
            generator: of([4.0, 20.0]),
            ..Card::of(Hysteresis, Simple, "a loop whose width changes with temperature")
        },
        E::PlayLadder => Card {
            grid: plays,
            generator: of([1.0, 60.0]),
            ..Card::of(Hysteresis, Family, "heating and cooling follow different curves, by loops of many widths")
        },
        E::PlayLadderByTemperature => Card {
            grid: |x| where_path_repeats(x, plays),
            generator: of([1.0, 60.0]),
            ..Card::of(Hysteresis, Family, "loops of many widths whose size changes with temperature")
        },
        E::PlayCurve => Card {
            repeats: true,
            grid: |x| rows([0.02, 0.04, 0.08, 0.15, 0.25].map(|s| Width { width_c: s * x.span_c() })),
            generator: of([8.0, 0.0]),
            ..Card::of(Hysteresis, Searched, "hysteresis that changes along the temperature")
        },
        E::Relay => Card {
            refine: &[Move::Place(0.04), Move::Place(0.04)],
            possible: loop_shows,
            repeats: true,
            grid: |x| thresholds(x, 12),
            generator: of([30.0, -10.0]),
            ..Card::of(
                Hysteresis,
                Simple,
                "the bias switches at one temperature while heating and back at another while cooling",
            )
        },
        E::SoftRelay => Card {
            refine: &[Move::Place(0.04), Move::Place(0.04)],
            possible: loop_shows,
            repeats: true,
            grid: |x| thresholds(x, 8),
            generator: of([30.0, -10.0]),
            ..Card::of(
                Hysteresis,
                Simple,
                "the bias rises over some degrees while heating and falls over others while cooling",
            )
        },
        E::Extremes => Card::of(Hysteresis, Family, "the bias remembers the highest and the lowest temperature"),
        E::CoolingHeating => Card {
            parted_by_profile: true,
            ..Card::of(Rate, Simple, "heating and cooling have different coefficients")
        },
        E::CoolingHeatingHeld => Card::of(Rate, Idle, "heating and cooling have different coefficients, held on soaks"),
        E::InputNetwork => Card::of(Input, Idle, "an unknown function of temperature, ramp and a recorded quantity"),
        E::RateSaturation => Card {
            refine: &[SCALE],
            grid: |x| {
                let ramps = log(0.03 * x.fastest_c_per_min, x.fastest_c_per_min, 10);
                rows(ramps.map(|ramp_c_per_min| Ramp { ramp_c_per_min }))
            },
            generator: of([0.3, 0.0]),
            ..Card::of(Rate, Simple, "the bias follows the ramp and levels off")
        },
        E::RateCurve => {
            Card { grid: ramps, generator: of([1.5, 0.0]), ..Card::of(Rate, Family, "a curve of the ramp") }
        }
        E::RateCurveByTemperature => Card {
            grid: ramps,
            generator: of([1.5, 0.0]),
            ..Card::of(Rate, Family, "a curve of the ramp that changes with temperature")
        },
        E::RampByShape => Card::of(Rate, Family, "the effect of the ramp changes along the temperature"),
        E::HeatingByShape => Card::of(Rate, Family, "the effect of heating changes along the temperature"),
        E::RampBand => Card {
            refine: &[Move::Place(0.02), Move::Factor(0.3)],
            possible: |row, x| sharper_than_the_spline(Band::of(row).width_c, x),
            repeats: true,
            grid: |x| where_path_repeats(x, |x| rows(places(x).map(|(middle_c, width_c)| Band { middle_c, width_c }))),
            generator: of([15.0, 6.0]),
            ..Card::of(Rate, Searched, "within some degrees the bias follows the ramp otherwise")
        },
        E::WarmUp => Card {
            repeats: true,
            refine: &[SCALE],
            grid: |x| rows(log(30.0, x.longest_s / 3.0, 16).map(|tau_s| Tau { tau_s })),
            generator: drawn(1800.0, 700.0, 4000.0),
            parted_by_profile: true,
            ..Card::of(PowerOn, Simple, "the bias settles after power-on")
        },
        E::WarmUpByTemperature => Card {
            refine: &[SCALE],
            grid: |x| where_path_repeats(x, |x| rows(log(300.0, x.longest_s / 2.0, 12).map(|tau_s| Tau { tau_s }))),
            generator: of([1800.0, 0.0]),
            ..Card::of(PowerOn, Simple, "the bias settles after power-on, by more or less at other temperatures")
        },
        E::DampedOscillation => Card {
            refine: &[SCALE, Move::Factor(0.3)],
            // (What goes on through a run is not the power-on's, and beyond half of the critical damping it is a warm-up.)
            possible: |row, x| {
                let swing = Swing::of(row);
                swing.damping <= 0.5 && swings_end(swing, x)
            },
            grid: |x| {
                where_path_repeats(x, |x| {
                    let periods = log(600.0, (x.longest_s / 6.0).max(1200.0), 14);
                    rows(periods.map(|period_s| Swing { period_s, damping: 0.1 }).filter(|s| swings_end(*s, x)))
                })
            },
            generator: of([3000.0, 0.1]),
            ..Card::of(PowerOn, Simple, "the bias swings after power-on, less and less")
        },
        E::PowerOnLadder => Card {
            grid: decays,
            generator: of([120.0, 6000.0]),
            ..Card::of(PowerOn, Family, "the bias settles after power-on with several time constants")
        },
        E::PowerOnLadderByTemperature => Card {
            grid: decays,
            generator: of([120.0, 6000.0]),
            ..Card::of(
                PowerOn,
                Family,
                "the bias settles after power-on with several time constants, by more or less at other temperatures",
            )
        },
        E::PowerOnCurve => Card {
            // (A curve over more of a run would stand for whatever happens in it.)
            grid: |x| rows([Until { until_s: x.longest_s / 3.0 }]),
            generator: of([9000.0, 0.0]),
            ..Card::of(PowerOn, Family, "the bias sets in late, or swings, after power-on")
        },
        E::LateOnset => Card {
            refine: &[Move::Block, Move::Factor(0.3)],
            // (What is sharper may be an event; what comes later, whatever has happened in the run.)
            possible: |row, x| {
                let onset = Onset::of(row);
                onset.rise_s >= SHORTEST_RISE_S && onset.middle_s <= x.longest_s / 3.0
            },
            grid: |x| {
                let apart = (x.longest_s / 36.0).max(SHORTEST_RISE_S);
                rows((1..=12).map(|k| Onset { middle_s: apart * k as f32, rise_s: apart }))
            },
            generator: of([4000.0, 1200.0]),
            ..Card::of(PowerOn, Simple, "the bias goes from one level to another some time after power-on")
        },
        // A dependence on the temperature at power-on needs several power-ons to be seen.
        E::PowerOnLadderByStart => Card {
            grid: |x| if x.runs > 1 { decays(x) } else { vec![] },
            generator: of([120.0, 6000.0]),
            ..Card::of(PowerOn, Family, "the bias settles after power-on, by as much as the start temperature says")
        },
        E::DriveAmplitude => Card {
            generator: studied(none),
            repair: Some(|_| needs_input(E::DriveAmplitude, "drive_?_v")),
            ..Card::of(Input, Simple, "the bias follows the drive amplitude: damping changes")
        },
        E::Quadrature => Card {
            generator: studied(none),
            repair: Some(|_| needs_input(E::Quadrature, "quad_?_v")),
            ..Card::of(Input, Simple, "the bias follows the quadrature voltage")
        },
        E::Board => Card {
            grid: |_| rows([0.0, 1.0].map(|source| Source { source })),
            generator: studied(none),
            repair: Some(|_| needs_input(E::Board, "board_c or supply_v")),
            ..Card::of(Input, Simple, "the bias follows the board temperature or the supply")
        },
        E::RecordedQuantity => Card {
            repeats: true,
            // (All but the cases, which the resonators tell as well.)
            grid: |_| rows((0..8).chain(11..16).map(|k| Channel { channel: k as f32 })),
            repair: Some(|p| {
                let number = p(E::RecordedQuantity.facts().parameters[0]) as usize;
                needs_input(E::RecordedQuantity, inputs::NAMES.get(number).unwrap_or(&"the quantity"))
            }),
            ..Card::of(Input, Searched, "the bias follows a recorded quantity")
        },
        E::OwnQuantity => Card {
            repeats: true,
            grid: |_| rows([2.0, 5.0].map(|channel| Channel { channel })),
            repair: Some(|p| {
                let number = p(E::OwnQuantity.facts().parameters[0]) as usize;
                needs_input(E::OwnQuantity, columns_of(number))
            }),
            ..Card::of(Input, Searched, "the bias follows a recorded quantity of its axis")
        },
        E::InputKink => Card {
            refine: &[Move::Level(0.02)],
            // (Beyond the outer places a run has too little of either slope.)
            possible: |row, x| {
                let Bend { break_at, channel } = Bend::of(row);
                x.quantity(channel as u8).is_some_and(|range| within(range).contains(&break_at))
            },
            repeats: true,
            grid: bends,
            repair: Some(|p| {
                let number = p(E::InputKink.facts().parameters[1]) as usize;
                needs_input(E::InputKink, columns_of(number))
            }),
            ..Card::of(Input, Simple, "the bias follows a recorded quantity, with another slope beyond a value of it")
        },
        E::Timebase => Card {
            grid: behind_the_case,
            needs: Needs::ThreeResonators,
            generator: of([694.0, 0.0]),
            repair: Some(|_| needs_case_sensors(E::Timebase)),
            ..Card::of(Thermometer, Simple, "the clock that counts the frequencies changes")
        },
        E::ThermometerError => Card {
            grid: behind_the_case,
            needs: Needs::Resonator,
            generator: of([694.0, 0.0]),
            ..Card::of(Thermometer, Simple, "the thermometer errs")
        },
        E::Aging => Card {
            generator: studied(none),
            parted_by_profile: true,
            repair: Some(|_| {
                "the rates drift with time: repeat the run after some days to see whether it goes on; it is taken out of the fit and not compensated".into()
            }),
            ..Card::of(Event, Simple, "the bias drifts with time")
        },
        E::Step => Card {
            refine: &[Move::Block],
            generator: drawn(9000.0, 4000.0, 20_000.0),
            repair: Some(|p| {
                format!(
                    "something changed at {:.0} s on the recording's clock: check what happened then (a shock, a switch, a loose part); the fit excludes the step, and the unit does not correct it",
                    p(E::Step.facts().parameters[0])
                )
            }),
            ..Card::of(Event, Proposed, "the bias jumps once")
        },
        E::Shock => Card {
            refine: &[Move::Block, Move::Factor(0.3)],
            // (A recovery of which a run does not see two time constants is a step.)
            possible: |row, x| {
                let shock = Pulse::of(row);
                shock.time_s + 2.0 * shock.tau_s <= x.longest_s
            },
            generator: studied([9000.0, 1800.0]),
            repair: Some(|p| {
                let [time, tau] = [0, 1].map(|k| p(E::Shock.facts().parameters[k]));
                format!(
                    "something changed at {time:.0} s on the recording's clock and recovered with a time constant of {tau:.0} s: check what happened then (a shock, a switch, a loose part); the fit excludes it, and the unit does not correct it"
                )
            }),
            ..Card::of(Event, Proposed, "the bias jumps and recovers")
        },
        E::Periodic => Card {
            refine: &[Move::Period],
            generator: drawn(900.0, 400.0, 3000.0),
            repair: Some(|p| {
                format!(
                    "look for a source with a period of {:.0} s: the chamber's compressor or heater, a beat between neighbours; it is taken out of the fit and not compensated",
                    p(E::Periodic.facts().parameters[0])
                )
            }),
            ..Card::of(Event, Proposed, "the bias swings with a period in time")
        },
    }
}

fn needs_case_sensors(effect: EffectId) -> String {
    format!("{} needs the case sensors, which the unit does not read: give the case time to settle", effect.name())
}

/// The columns of a recording that hold a quantity, of each axis if it is an axis'.
#[must_use]
pub fn columns_of(number: usize) -> &'static str {
    match number {
        2..=4 => "drive_?_v",
        5..=7 => "quad_?_v",
        8..=10 => "case_?_c",
        _ => inputs::NAMES.get(number).unwrap_or(&"the quantity"),
    }
}

fn needs_input(effect: EffectId, columns: &str) -> String {
    format!(
        "{} needs {columns} as an input of the unit: send it once a second by the link's message Inputs (docs/inputs.md), and trace with --inputs",
        effect.name()
    )
}

/// Names the profile that separates two effects.
#[must_use]
pub fn parting(a: EffectId, b: EffectId) -> &'static str {
    let classes = [card(a).class, card(b).class];
    let both = |wanted: &[Class]| classes.iter().all(|c| wanted.contains(c));
    let either = |wanted: &[Class]| classes.iter().any(|c| wanted.contains(c));
    if both(&[Class::Input]) {
        "a run in which each recorded quantity moves while the others stand parts them"
    } else if both(&[Class::Memory, Class::Hysteresis, Class::Thermometer, Class::Input]) {
        "a run with ramps of two speeds (0.5 and 3 C per minute) and long soaks between parts them: a lag scales with speed and dies out on a soak, a hysteresis does neither"
    } else if both(&[Class::Shape]) {
        "a run that reaches further on both ends, with soaks each 10 C, parts them"
    } else if either(&[Class::PowerOn, Class::Event]) {
        "a second run with the same profile, started after the unit has been on for hours, parts what belongs to the clock from what belongs to temperature"
    } else {
        "a run that passes the same temperatures in both directions and at two speeds parts them"
    }
}

/// Effects that a chamber profile should part.
#[must_use]
pub fn parted() -> Vec<EffectId> {
    all().filter(|(_, c)| c.parted_by_profile).map(|(f, _)| f.effect).collect()
}

/// Effects that are offered together, with one variance for all their gains.
#[derive(Debug, Clone, Copy)]
pub struct Bundle {
    /// The families; the first gives the name. One alone leaves what the other is needed for: a Preisach operator is a sum of curves
    /// of the outputs of plays of all widths; memory in a material changes with temperature.
    pub families: &'static [EffectId],
    /// Only where a run begins in a ramp, so that the lags do not begin in equilibrium; then with what each run owes to that: a
    /// [`beginning`] of its own.
    pub in_ramp: bool,
}

/// The bundles.
pub const BUNDLES: &[Bundle] = &[
    Bundle { families: &[EffectId::PlayCurve], in_ramp: false },
    Bundle { families: &[EffectId::PlayCurve, EffectId::TemperatureSpline], in_ramp: false },
    Bundle { families: &[EffectId::PlayLadder, EffectId::PlayLadderByTemperature], in_ramp: false },
    Bundle { families: &[EffectId::LagLadder, EffectId::LagLadderByTemperature], in_ramp: false },
    Bundle { families: &[EffectId::LagLadder], in_ramp: true },
    Bundle { families: &[EffectId::RateCurve, EffectId::RateCurveByTemperature], in_ramp: false },
];

/// Decays that a lag adds to a run that began in a ramp; they belong to that run alone.
#[must_use]
pub fn beginning(x: &Extent) -> (EffectId, ParameterRow) {
    (EffectId::PowerOnLadder, Taus { tau_min_s: 120.0, tau_max_s: slowest(x) }.row())
}

/// The class of an effect by its name; `None` for a name that is not in the list.
#[must_use]
pub fn class_of(name: &str) -> Option<Class> {
    EffectId::by_name(name).map(|e| card(e).class)
}

/// Every effect with its card.
pub fn all() -> impl Iterator<Item = (&'static Facts, Card)> {
    ALL.iter().map(|f| (f, card(f.effect)))
}
