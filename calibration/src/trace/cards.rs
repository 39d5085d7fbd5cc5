//! One card for each effect: what the desktop must know of it beyond its equation. The compiler asks for a card of every effect.

use crate::trace::report::Class;
use hrg_core::effects::{EffectId, Facts, ALL, MAX_PARAMETERS};

/// Inner parameters of an effect.
pub type Parameters = [f32; MAX_PARAMETERS];

/// Makes the values of the inner parameters to begin with.
pub type Grid = fn(&Extent) -> Vec<Parameters>;

/// What the runs span, from which a card takes its grid.
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
    /// How many runs there are.
    pub runs: usize,
}

impl Extent {
    fn span_c(&self) -> f32 {
        self.high_c - self.low_c
    }
}

/// What an effect is to the search.
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
    /// Not searched: another one spans it.
    Idle,
}

/// How an inner parameter is refined after the grid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Refine {
    /// Not at all.
    No,
    /// The first parameter is multiplied: a time, a width, a scale.
    Scale,
    /// The same of a period of temperature: by less than a quarter of a cycle over the span.
    Cycle,
    /// The first parameter is moved by steps of this share of the temperature span.
    Place(f32),
    /// The first parameter is moved by steps of a block of rows.
    Time,
    /// A period in time: moved by less than a cycle over the run.
    Period,
    /// Both parameters are places on the temperature axis.
    Places(f32),
}

/// See the module.
pub struct Card {
    /// What kind of physics.
    pub class: Class,
    /// What it is to the search.
    pub kind: Kind,
    /// How its parameter is refined.
    pub refine: Refine,
    /// Whether a model may hold it more than once.
    pub repeats: bool,
    /// Whether it remembers the path of the temperature, so that where it begins belongs to the run.
    pub starts: bool,
    /// Values of the inner parameters to begin with.
    pub grid: Grid,
}

fn log(from: f32, to: f32, n: usize) -> Vec<Parameters> {
    (0..n).map(|k| [from * (to / from).powf(k as f32 / (n - 1) as f32), 0.0]).collect()
}

fn even(from: f32, to: f32, n: usize) -> Vec<Parameters> {
    (0..n).map(|k| [from + (to - from) * k as f32 / (n - 1) as f32, 0.0]).collect()
}

fn once(_: &Extent) -> Vec<Parameters> {
    vec![[0.0; MAX_PARAMETERS]]
}

fn nowhere(_: &Extent) -> Vec<Parameters> {
    vec![]
}

fn lags(x: &Extent) -> Vec<Parameters> {
    vec![[60.0, slowest(x)]]
}

/// The slowest memory that a run can show, s.
fn slowest(x: &Extent) -> f32 {
    (0.9 * x.longest_s).clamp(600.0, 21_600.0)
}

fn decays(x: &Extent) -> Vec<Parameters> {
    vec![[120.0, (0.8 * x.longest_s).max(2000.0)]]
}

fn ramps(x: &Extent) -> Vec<Parameters> {
    vec![[x.fastest_c_per_min, 0.0]]
}

fn temperatures(x: &Extent) -> Vec<Parameters> {
    vec![[x.low_c, x.high_c]]
}

/// Periods of a ripple, evenly in the number of ripples over the span.
fn ripples(x: &Extent) -> Vec<Parameters> {
    let most = (2.0 * x.span_c() / 3.0) as usize;
    (4..=most.max(4)).map(|k| [2.0 * x.span_c() / k as f32, 0.0]).collect()
}

/// Pairs of thresholds: on above off.
fn thresholds(x: &Extent) -> Vec<Parameters> {
    let place = |k: usize| x.low_c + x.span_c() * k as f32 / 13.0;
    (1..=12).flat_map(|on| (1..on).map(move |off| [place(on), place(off)])).collect()
}

/// The card of an effect.
#[must_use]
pub fn card(effect: EffectId) -> Card {
    use EffectId as E;
    use Kind::{Family, Idle, Proposed, Searched, Simple};
    let (class, kind, refine, grid): (Class, Kind, Refine, Grid) = match effect {
        E::Cubic => (Class::Shape, Simple, Refine::No, once),
        E::Kink => (Class::Shape, Simple, Refine::Place(0.02), |x| {
            even(x.low_c + 0.1 * x.span_c(), x.high_c - 0.1 * x.span_c(), 20)
        }),
        E::TemperatureShape => (Class::Shape, Simple, Refine::No, temperatures),
        E::TemperatureSpline => (Class::Shape, Family, Refine::No, temperatures),
        E::Ripple => (Class::Shape, Simple, Refine::Cycle, ripples),
        E::FrequencyDirect => (Class::Shape, Idle, Refine::No, nowhere),
        E::ThermalLag => (Class::Memory, Simple, Refine::Scale, |x| log(120.0, (x.longest_s / 2.5).max(600.0), 18)),
        E::SecondDerivative | E::CaseGradient => (Class::Memory, Simple, Refine::No, once),
        E::AxisGradient => (Class::Memory, Simple, Refine::No, once),
        E::NeighbourLags => (Class::Memory, Family, Refine::No, once),
        E::LagLadder | E::LagLadderByTemperature => (Class::Memory, Family, Refine::No, lags),
        E::HeatingLags => (Class::Memory, Family, Refine::No, |x| vec![[120.0, slowest(x)]]),
        E::ArrheniusLadder => {
            (Class::Memory, Searched, Refine::No, |x| [-0.04, -0.02, 0.02, 0.04].map(|b| [b, slowest(x)]).to_vec())
        }
        E::Hysteresis => {
            (Class::Hysteresis, Simple, Refine::Scale, |x| log((0.03 * x.span_c()).max(0.5), 0.75 * x.span_c(), 14))
        }
        E::PlayLadder => {
            (Class::Hysteresis, Family, Refine::No, |x| vec![[(0.012 * x.span_c()).max(0.3), 0.9 * x.span_c()]])
        }
        E::PlayCurve => (Class::Hysteresis, Searched, Refine::No, |x| {
            [0.02, 0.04, 0.08, 0.15, 0.25].map(|s| [s * x.span_c(), 0.0]).to_vec()
        }),
        E::Relay => (Class::Hysteresis, Simple, Refine::Places(0.04), thresholds),
        E::Extremes => (Class::Hysteresis, Family, Refine::No, once),
        E::CoolingHeating => (Class::Rate, Simple, Refine::No, once),
        E::RateCurve | E::RateCurveByTemperature => (Class::Rate, Family, Refine::No, ramps),
        E::RampByShape | E::HeatingByShape => (Class::Rate, Family, Refine::No, once),
        E::WarmUp => (Class::PowerOn, Simple, Refine::Scale, |x| log(150.0, x.longest_s / 3.0, 12)),
        E::PowerOnLadder | E::PowerOnLadderByTemperature => (Class::PowerOn, Family, Refine::No, decays),
        // What depends on the temperature at power-on takes several power-ons to be seen.
        E::PowerOnLadderByStart => {
            (Class::PowerOn, Family, Refine::No, |x| if x.runs > 1 { decays(x) } else { vec![] })
        }
        E::DriveAmplitude | E::Quadrature => (Class::Input, Simple, Refine::No, once),
        E::Board => (Class::Input, Simple, Refine::No, |_| vec![[0.0, 0.0], [1.0, 0.0]]),
        E::RecordedQuantity => (Class::Input, Searched, Refine::No, |_| (0..8).map(|k| [k as f32, 0.0]).collect()),
        E::Timebase => (Class::Thermometer, Simple, Refine::No, |x| vec![[x.lag_s, 0.0]]),
        E::ThermometerError => (Class::Thermometer, Simple, Refine::No, |x| vec![[x.lag_s, 0.0]]),
        E::Aging => (Class::Event, Simple, Refine::No, once),
        E::Step => (Class::Event, Proposed, Refine::Time, nowhere),
        E::Periodic => (Class::Event, Proposed, Refine::Period, nowhere),
    };
    let repeats = kind == Proposed || matches!(effect, E::Relay | E::PlayCurve | E::RecordedQuantity | E::Ripple);
    let starts = matches!(effect, E::Hysteresis | E::PlayLadder | E::PlayCurve | E::Relay);
    Card { class, kind, refine, repeats, starts, grid }
}

/// Effects that are offered together, with one variance for all their gains.
#[derive(Debug, Clone, Copy)]
pub struct Bundle {
    /// The families; the first gives the name. One alone leaves what the other is needed for: a Preisach operator is a sum of curves
    /// of the outputs of plays of all widths; memory in a material changes with temperature.
    pub families: &'static [EffectId],
    /// What each run owes to its beginning: columns of that run alone.
    pub start: Option<EffectId>,
    /// Only where a run begins in a ramp, so that the lags do not begin in equilibrium.
    pub in_ramp: bool,
}

/// The bundles.
pub const BUNDLES: &[Bundle] = &[
    Bundle { families: &[EffectId::PlayCurve], start: None, in_ramp: false },
    Bundle { families: &[EffectId::PlayCurve, EffectId::TemperatureSpline], start: None, in_ramp: false },
    Bundle { families: &[EffectId::LagLadder, EffectId::LagLadderByTemperature], start: None, in_ramp: false },
    Bundle { families: &[EffectId::LagLadder], start: Some(EffectId::PowerOnLadder), in_ramp: true },
    Bundle { families: &[EffectId::RateCurve, EffectId::RateCurveByTemperature], start: None, in_ramp: false },
];

/// Parameters of what a run owes to its beginning.
#[must_use]
pub fn start_parameters(start: EffectId, x: &Extent) -> Parameters {
    debug_assert!(start == EffectId::PowerOnLadder);
    [120.0, slowest(x)]
}

/// The class of an effect by its name; `None` for a name that is not in the list.
#[must_use]
pub fn class_of(name: &str) -> Option<Class> {
    ALL.iter().find(|f| f.name == name).map(|f| card(f.effect).class)
}

/// Every effect with its card.
pub fn all() -> impl Iterator<Item = (&'static Facts, Card)> {
    ALL.iter().map(|f| (f, card(f.effect)))
}
