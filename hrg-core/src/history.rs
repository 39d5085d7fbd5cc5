//! Unknown part of a unit's past, and the states that a unit keeps over a restart.
//!
//! The state of a lag, a play or a warm-up follows from the unit's past. After a power-on the unit does not know that past. So it
//! runs two more copies of each effect: one of a unit that has been at the coldest calibrated temperature for long, one of a unit
//! that has been at the hottest one and was switched on long ago. The truth lies between them.
//!
//! The *stated* uncertainty for want of a past is that of a unit that stood at one temperature for long, any of these alike: their
//! distance times the deviation of a uniform distribution. Another past may stir up one time constant of a ladder and not the next; it is
//! bounded by the distance with the gains by their sizes. That bound decays with the effect's own time constants, and a play knows its
//! place as soon as the temperature has swept its width. Of a product with temperature it is that without the factor. Of a regressor on which the copies may agree by chance (a swing,
//! a square) it falls no faster than by the slowest time constant, and stays until the width is swept. Until 5 % of the bound is left (three time constants), or 0.01 deg/h, the axis is
//! flagged [`crate::status::AxisStatus::HISTORY_UNKNOWN`]; what is unknown is in the stated uncertainty until the bound is 0.01 deg/h.
//!
//! The same holds after a thermometer was lost for longer than [`HOLD_S`]: meanwhile the copies run with the coldest and the hottest
//! temperature that it may have by then, for its own axis and for each that looks at it.
//!
//! A settling after power-on begins with this power-on, at the temperature that the unit has then, or it was over long ago. A unit that
//! was off for so short a time that an older settling goes on is neither; it is flagged as long as its own would take.
//!
//! A reset that leaves the memory alone does not end a past: [`crate::compensator::Compensator::keep`] writes all states into words
//! that a reset leaves alone, and the unit goes on from them ([`crate::compensator::Compensator::resume`]).
//!
//! # Example
//! ```
//! use hrg_core::calibration::Calibration;
//! use hrg_core::compensator::Compensator;
//! use hrg_core::history::{Kept, KEPT_WORDS};
//!
//! // A unit keeps its states in memory that a reset leaves alone.
//! let mut words = [0u32; KEPT_WORDS];
//! assert!(Kept::of(|k| words[k]).is_none(), "after power-on there are none");
//! let mut model = Compensator::new(Calibration::uncalibrated(), 0.0);
//! model.step(&[Some(4900.0); 3]);
//! model.keep(|k, word| words[k] = word);
//!
//! let mut restarted = Compensator::new(Calibration::uncalibrated(), 0.0);
//! restarted.resume(&Kept::of(|k| words[k]).expect("kept"));
//! assert_eq!(restarted.resets(), 1);
//! assert!(restarted.on_for_s() > model.on_for_s());
//! ```

use crate::bias::{clamp, Scaling};
use crate::bytes;
use crate::calibration::{Calibration, EffectTerm, DIRECTIONS, MAX_EFFECTS};
use crate::effects::{self, Gains, OnUnit, Span, Sums, MAX_MEMORY, MAX_OUTPUTS};
use crate::half::Half;
use crate::inputs::{self, QuantitySet, Seen};
use crate::thermal::{AxisThermal, Thermal};
use crate::{AXES, MODEL_STEP_S};
use heapless::Vec;

/// A lost frequency is bridged for this long, with the last temperature and bias held and flagged
/// [`FREQUENCY_LOST`](crate::status::AxisStatus::FREQUENCY_LOST); after it
/// [`TEMPERATURE_STALE`](crate::status::AxisStatus::TEMPERATURE_STALE) joins. In model steps (seconds).
pub const HOLD_S: u16 = 10;

/// Share of what was unknown at the start below which the past counts as known: three time constants of a lag.
const KNOWN: f32 = 0.05;

/// Biases of the copies that are less apart than this, deg/h, count as one: a tenth of what docs/promises.md calls off.
const NEGLIGIBLE_DPH: f32 = 0.01;

/// While a thermometer is lost its temperature may change as fast as the calibration has seen, at least by this, C per minute.
const USUAL_RAMP_C_PER_MIN: f32 = 1.0;

/// The copies of each effect take a step in so many model steps: their states move slowly. At least as many as there are effects.
const TURN: u32 = 10;
const _: () = assert!(TURN as usize >= MAX_EFFECTS);

/// Time since power-on of a unit that was switched on long ago, s.
const LONG_S: f32 = 1e7;

/// Standard deviation of what lies anywhere between two ends that are 1 apart.
const UNIFORM: f32 = 0.288_675_13;

/// Unknown part of the bias in one step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Unknown {
    /// Set if an effect of the axis does not know its past.
    pub axes: [bool; AXES],
    /// Standard uncertainty of the bias for want of a past, deg/h.
    pub std_dph: [f32; AXES],
}

/// Distance of the copies of an effect on one axis.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Place {
    /// The axis has had no temperature yet.
    Coming,
    /// Gains by their sizes they are apart by so much now, and were by so much at most; as they are by so much, deg/h (NaN: after a
    /// restart, until they take a step).
    Apart(f32, f32, f32),
    /// They have come together.
    Known,
}

impl Place {
    /// `true` if the copies take a step as soon as the axis has a temperature, and not in their turn.
    fn wants_a_step(&self) -> bool {
        match self {
            Self::Coming => true,
            Self::Apart(.., own) => own.is_nan(),
            Self::Known => false,
        }
    }
}

/// Knowledge of a unit about its past: [`History`], or [`Settling`], which is smaller and gives no number.
pub trait Past: Clone + core::fmt::Debug {
    /// Of effects that have just begun: nothing is known of their past.
    fn unknown(terms: &[EffectTerm]) -> Self;
    /// One model step, after that of the effects themselves (`running`), with the inputs that they saw.
    fn step(&mut self, calibration: &Calibration, now: (&Thermal, &Seen), running: &mut [OnUnit]) -> Unknown;
    /// Effect `e` with the coldest or the hottest past, if there is such a copy.
    fn copy(&mut self, e: usize, side: Side) -> Option<&mut OnUnit>;
    /// Two numbers by which effect `e` of axis `k` is kept over a restart: NaN first: nothing is known yet; below zero: all is known.
    fn numbers(&self, e: usize, k: usize) -> [f32; 2];
    /// Takes these numbers again.
    fn take(&mut self, e: usize, k: usize, numbers: [f32; 2]);
}

/// Effects begun with two other pasts. See the module.
#[derive(Debug, Clone)]
pub struct History {
    low: Vec<OnUnit, MAX_EFFECTS>,
    high: Vec<OnUnit, MAX_EFFECTS>,
    past: [[Place; AXES]; MAX_EFFECTS],
    steps: u32,
}

impl Past for History {
    fn unknown(terms: &[EffectTerm]) -> Self {
        let mut low = Vec::new();
        for term in terms {
            let Some(one) = OnUnit::new(term.id, &term.parameters, term.start, TURN as f32 * MODEL_STEP_S) else {
                break;
            };
            let _ = low.push(one);
        }
        Self { high: low.clone(), low, past: [[Place::Coming; AXES]; MAX_EFFECTS], steps: 0 }
    }

    #[inline(never)]
    fn step(
        &mut self,
        calibration: &Calibration,
        (thermal, seen): (&Thermal, &Seen),
        running: &mut [OnUnit],
    ) -> Unknown {
        self.steps = self.steps.wrapping_add(1);
        let turn = (self.steps % TURN) as usize;
        let mut unknown = Unknown { axes: [false; AXES], std_dph: [0.0; AXES] };
        // The copies take longer steps, each in its turn, and one at once where an axis has its first temperature: so a step costs hardly
        // more than without them.
        for (e, (main, term)) in running.iter_mut().zip(&calibration.effects).enumerate() {
            let begins = |p: &[Place; AXES]| p.iter().zip(&thermal.axes).any(|(p, a)| p.wants_a_step() && a.known);
            if e == turn || self.past.get(e).is_some_and(begins) {
                self.advance(e, (main, term), calibration, (thermal, seen));
            }
        }
        for (past, term) in self.past.iter().zip(&calibration.effects) {
            for (k, past) in past.iter().enumerate() {
                match *past {
                    Place::Known => {}
                    Place::Coming => unknown.axes[k] |= term.gains[k].iter().any(|g| *g != 0.0),
                    Place::Apart(now, most, own) => {
                        unknown.axes[k] |= now > NEGLIGIBLE_DPH && now > KNOWN * most;
                        unknown.std_dph[k] += UNIFORM * if own.is_nan() { now } else { own };
                    }
                }
            }
        }
        unknown
    }

    fn copy(&mut self, e: usize, side: Side) -> Option<&mut OnUnit> {
        match side {
            Side::Cold => self.low.get_mut(e),
            Side::Hot => self.high.get_mut(e),
        }
    }

    fn numbers(&self, e: usize, k: usize) -> [f32; 2] {
        match self.past.get(e).and_then(|p| p.get(k)) {
            None | Some(Place::Coming) => [f32::NAN; 2],
            Some(Place::Apart(apart, most, _)) => [*apart, *most],
            Some(Place::Known) => [-1.0; 2],
        }
    }

    fn take(&mut self, e: usize, k: usize, numbers: [f32; 2]) {
        if let Some(past) = self.past.get_mut(e).and_then(|p| p.get_mut(k)) {
            *past = match numbers {
                [apart, _] if apart.is_nan() => Place::Coming,
                [apart, _] if apart < 0.0 => Place::Known,
                [apart, most] => Place::Apart(apart, most, f32::NAN),
            };
        }
    }
}

impl History {
    /// Advances the copies of effect `e` by their own step.
    fn advance(
        &mut self,
        e: usize,
        (main, term): (&mut OnUnit, &EffectTerm),
        calibration: &Calibration,
        (thermal, seen): (&Thermal, &Seen),
    ) {
        let (Some(low), Some(high), Some(past)) = (self.low.get_mut(e), self.high.get_mut(e), self.past.get_mut(e))
        else {
            return;
        };
        let mut lost = thermal.axes.each_ref().map(|a| !a.known || a.age > HOLD_S);
        let any_lost = main.looks_at_neighbours() && lost.contains(&true);
        for k in 0..AXES {
            lost[k] |= lacks(term, k, seen);
        }
        let forgotten = if remembers(term) { seen.missing } else { QuantitySet::empty() };
        let ends = inputs::with_ends(&seen.values, &calibration.inputs, forgotten);
        if *past == [Place::Known; AXES] && !any_lost && lost == [false; AXES] {
            return;
        }
        for k in 0..AXES {
            let past = &mut past[k];
            let (known, range) = (thermal.axes[k].known, &calibration.axes[k].curve);
            match past {
                Place::Coming if known => {
                    let [lowest, highest] = inputs::with_ends(&seen.values, &calibration.inputs, QuantitySet::all());
                    low.soak_at(k, range.valid_from_c, &lowest);
                    high.soak_at(k, range.valid_to_c, &highest);
                    let begins = if main.may_agree() { term.gains[k].iter().map(|g| g.abs()).sum() } else { 0.0 };
                    *past = Place::Apart(begins, begins, 0.0);
                }
                Place::Known if known && (lost[k] || any_lost) => {
                    for copy in [&mut *low, &mut *high] {
                        copy.memory(k).iter_mut().zip(main.memory(k)).for_each(|(to, from)| *to = *from);
                    }
                    *past = Place::Apart(0.0, 0.0, 0.0);
                }
                _ => {}
            }
        }
        let [cold, mut hot] = [Side::Cold, Side::Hot].map(|side| side.of(calibration, thermal));
        hot.time_s = LONG_S;
        // A product with temperature passes zero at the middle one, and says nothing there: its factor is counted from elsewhere.
        let mut scaling = calibration.scaling;
        if main.times_temperature() {
            scaling.t_ref_c = scaling.linear_below_c - scaling.t_scale_c;
        }
        // (The sizes take the place of the directions, which nobody asks for here.)
        let directions = &[sizes(&term.gains, main.is_curve()); DIRECTIONS];
        // Hot less cold.
        let (mut own_dph, mut along_dph) = ([0.0; AXES], [[0.0; AXES]; DIRECTIONS]);
        for ((copy, thermal), quantities) in [&mut *low, &mut *high].into_iter().zip([&cold, &hot]).zip(&ends) {
            own_dph.iter_mut().chain(along_dph.as_flattened_mut()).for_each(|sum| *sum = -*sum);
            let sums = &mut Sums { gains: &term.gains, bias_dph: &mut own_dph, directions, along_dph: &mut along_dph };
            copy.add_bias_dph(&scaling, thermal, quantities, sums);
        }
        let [bounds_dph, ..] = along_dph;
        let span = effects::span(term.id, &term.parameters);
        let fades = match span {
            Span::Time(tau_s) if main.may_agree() => libm::expf(-(TURN as f32) * MODEL_STEP_S / tau_s),
            _ => 1.0,
        };
        let each = past.iter_mut().zip(lost).zip(&thermal.axes).zip(bounds_dph.into_iter().zip(own_dph));
        for (k, (((past, lost), axis), (bound, own))) in each.enumerate() {
            let Place::Apart(before, most, _) = *past else { continue };
            // So much is left by time if the copies may agree by chance; of plays all of it until they stand at the same places.
            let mut met = || matches!(span, Span::Range(_)) && low.memory(k) == high.memory(k);
            let least = if main.may_agree() && !met() { fades * before } else { 0.0 };
            let (factor, counted) = if main.times_temperature() {
                let factor = |s: &Scaling| s.u_and_inside(axis.state.temperature_c).1;
                (factor(&calibration.scaling), factor(&scaling))
            } else {
                (1.0, 1.0)
            };
            let apart = (bound / counted).abs().max(least);
            // While a thermometer is lost they part anew.
            let parting = lost || any_lost;
            let most = if apart > most || parting { apart } else { most };
            *past = if apart <= NEGLIGIBLE_DPH && !parting {
                Place::Known
            } else {
                Place::Apart(apart, most, (own * (factor / counted)).abs().max(least))
            };
        }
    }
}

fn remembers(term: &EffectTerm) -> bool {
    effects::span(term.id, &term.parameters) != Span::None
}

/// `true` if an effect remembers a quantity that is missing on an axis.
fn lacks(term: &EffectTerm, axis: usize, seen: &Seen) -> bool {
    !seen.missing.is_empty()
        && remembers(term)
        && effects::reads(term.id, &term.parameters, axis).intersects(seen.missing)
}

/// Time for which an effect with a memory is flagged, in time constants: a twentieth of the past is left then.
const TIME_CONSTANTS: f32 = 3.0;

/// Part of the past of an effect on one axis that has not passed yet.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Left {
    /// The axis has had no temperature yet.
    Coming,
    /// So much time, s.
    Time(f32),
    /// The temperatures that were swept so far, C.
    Swept(f32, f32),
    /// Nothing.
    Known,
}

/// A past that settles: an axis is flagged until three time constants of each of its effects have passed, or the temperature has swept
/// its width; the uncertainty of the bias for want of a past is not stated. A quarter of the memory of [`History`], and no second code.
#[derive(Debug, Clone)]
pub struct Settling {
    spans: [Span; MAX_EFFECTS],
    left: [[Left; AXES]; MAX_EFFECTS],
}

impl Past for Settling {
    fn unknown(terms: &[EffectTerm]) -> Self {
        let mut spans = [Span::None; MAX_EFFECTS];
        for (to, term) in spans.iter_mut().zip(terms) {
            *to = effects::span(term.id, &term.parameters);
        }
        Self { spans, left: [[Left::Coming; AXES]; MAX_EFFECTS] }
    }

    fn step(
        &mut self,
        calibration: &Calibration,
        (thermal, seen): (&Thermal, &Seen),
        running: &mut [OnUnit],
    ) -> Unknown {
        let mut unknown = Unknown { axes: [false; AXES], std_dph: [0.0; AXES] };
        let lost = thermal.axes.each_ref().map(|a| !a.known || a.age > HOLD_S);
        for (((left, span), main), term) in self.left.iter_mut().zip(&self.spans).zip(running).zip(&calibration.effects)
        {
            let any_lost = main.looks_at_neighbours() && lost.contains(&true);
            for (k, left) in left.iter_mut().enumerate() {
                let Some((now, lost)) = thermal.axes.get(k).zip(lost.get(k)) else { continue };
                *left = if *lost || any_lost || lacks(term, k, seen) {
                    Left::Coming
                } else {
                    left.after(*span, now.state.temperature_c)
                };
                let acts = term.gains.get(k).is_some_and(|g| g.iter().any(|g| *g != 0.0));
                if let Some(flag) = unknown.axes.get_mut(k) {
                    *flag |= acts && *left != Left::Known;
                }
            }
        }
        unknown
    }

    fn copy(&mut self, _: usize, _: Side) -> Option<&mut OnUnit> {
        None
    }

    fn numbers(&self, e: usize, k: usize) -> [f32; 2] {
        match self.left.get(e).and_then(|l| l.get(k)) {
            None | Some(Left::Coming) => [f32::NAN; 2],
            Some(Left::Time(s)) => [0.0, *s],
            // (A sweep begins anew with a restart.)
            Some(Left::Swept(..)) => [f32::NAN; 2],
            Some(Left::Known) => [-1.0; 2],
        }
    }

    fn take(&mut self, e: usize, k: usize, numbers: [f32; 2]) {
        if let Some(left) = self.left.get_mut(e).and_then(|l| l.get_mut(k)) {
            *left = match numbers {
                [known, _] if known < 0.0 => Left::Known,
                [known, s] if known == 0.0 && s.is_finite() => Left::Time(s),
                _ => Left::Coming,
            };
        }
    }
}

impl Left {
    /// After one more step at a temperature.
    fn after(self, span: Span, temperature_c: f32) -> Self {
        match (self, span) {
            (Self::Known, _) | (_, Span::None) => Self::Known,
            (Self::Coming, Span::Time(tau_s)) => Self::Time(TIME_CONSTANTS * tau_s),
            (Self::Time(s), _) if s <= MODEL_STEP_S => Self::Known,
            (Self::Time(s), _) => Self::Time(s - MODEL_STEP_S),
            (Self::Coming, _) => Self::Swept(temperature_c, temperature_c),
            (Self::Swept(low, high), Span::Range(width_c)) if high - low >= width_c => Self::Known,
            (Self::Swept(low, high), _) => Self::Swept(
                if temperature_c < low { temperature_c } else { low },
                if temperature_c > high { temperature_c } else { high },
            ),
        }
    }
}

/// Gains by their sizes. For a curve over knots with these values: at each knot, how much it has gone up and down since the first. Between two
/// places its values differ by no more than this does, which never falls: so two places are told apart where the curve itself has the same value.
#[inline(never)]
fn sizes(gains: &Gains, curve: bool) -> [[Half; MAX_OUTPUTS]; AXES] {
    let mut out = [[Half::ZERO; MAX_OUTPUTS]; AXES];
    for (out, gains) in out.iter_mut().zip(gains) {
        let (mut sum, mut before) = (0.0, gains[0]);
        for (out, gain) in out.iter_mut().zip(gains) {
            sum += (gain - before).abs();
            before = *gain;
            let size = if curve { sum } else { gain.abs() };
            // (Cut: a bound needs no more digits.)
            *out = Half::from_bits((size.to_bits() >> 16) as u16);
        }
    }
    out
}

/// A past: the coldest or the hottest that the unit, or a lost thermometer, may have had.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// The coldest.
    Cold,
    /// The hottest.
    Hot,
}

impl Side {
    fn of(self, calibration: &Calibration, thermal: &Thermal) -> Thermal {
        let axes = core::array::from_fn(|k| {
            let (now, axis) = (&thermal.axes[k], &calibration.axes[k]);
            if now.known && now.age == 0 {
                return *now;
            }
            let (from, to) = (axis.curve.valid_from_c, axis.curve.valid_to_c);
            let (slowest, fastest) = (axis.valid_from_c_per_min, axis.valid_to_c_per_min);
            let (end, ramp) = match self {
                Self::Cold => (from, clamp(slowest, f32::NEG_INFINITY, -USUAL_RAMP_C_PER_MIN)),
                Self::Hot => (to, clamp(fastest, USUAL_RAMP_C_PER_MIN, f32::INFINITY)),
            };
            let mut state = now.state;
            let moved = state.temperature_c + ramp * (f32::from(now.age) * (MODEL_STEP_S / 60.0));
            state.temperature_c = if now.known { clamp(moved, from, to) } else { end };
            // (What counts ramps, by their sizes or while it warms, has counted none, or the fastest.)
            state.ramp_c_per_min = if self == Self::Hot { ramp } else { 0.0 };
            AxisThermal { state, known: true, ..*now }
        });
        Thermal { axes, time_s: thermal.time_s }
    }
}

/// Words of an effect that are kept for each axis: the memory of the effect and of its two copies, how far they are apart, and were at
/// most.
const AXIS_WORDS: usize = 3 * MAX_MEMORY + 2;
/// Words of an effect's gains, two in each.
const GAIN_WORDS: usize = AXES * MAX_OUTPUTS / 2;
const _: () = assert!(MAX_OUTPUTS.is_multiple_of(2));
/// Words of an effect: number, parameters, gains, axes.
const EFFECT_WORDS: usize = 3 + GAIN_WORDS + AXES * AXIS_WORDS;
/// Words before the effects.
const HEAD_WORDS: usize = 5;
/// Words that are kept, the checksum included.
pub const KEPT_WORDS: usize = HEAD_WORDS + MAX_EFFECTS * EFFECT_WORDS + 1;
/// First word: what it is, and the version of its layout.
const KEPT: u32 = u32::from_le_bytes(*b"HRG\x02");

/// Numbers that are kept beside the states of the effects.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Head {
    /// Counts up with each step that is kept: the newer of two.
    pub sequence: u32,
    /// Time since power-on, s.
    pub time_s: f32,
    /// Resets since power-on.
    pub resets: u32,
}

/// States that were kept, checked. `W` gives the words.
#[derive(Debug, Clone, Copy)]
pub struct Kept<W> {
    words: W,
    /// Numbers that are kept beside the effects.
    pub head: Head,
    effects: usize,
}

impl<W: Fn(usize) -> u32> Kept<W> {
    /// `None` where the words are not what [`crate::compensator::Compensator::keep`] wrote: memory after power-on, or a reset while it was written.
    #[must_use]
    pub fn of(words: W) -> Option<Self> {
        if words(0) != KEPT || words(KEPT_WORDS - 1) != checksum(&words) {
            return None;
        }
        let head = Head { sequence: words(1), time_s: f32::from_bits(words(2)), resets: words(3) };
        let effects = (words(4) as usize).min(MAX_EFFECTS);
        Some(Self { words, head, effects })
    }

    /// Index of the first word of an effect with the same number and parameters.
    fn find(&self, term: &EffectTerm) -> Option<usize> {
        let [p, q] = term.parameters.map(f32::to_bits);
        (0..self.effects)
            .map(|e| HEAD_WORDS + e * EFFECT_WORDS)
            .find(|at| [0, 1, 2].map(|k: usize| (self.words)(at + k)) == [u32::from(term.id), p, q])
    }

    /// Gives effect `e` back what it remembered, and its two copies theirs; `None` where it was not there.
    fn resume<P: Past>(&self, term: &EffectTerm, e: usize, main: &mut OnUnit, past: &mut P) -> Option<()> {
        let gains = self.find(term)? + 3;
        let mut at = gains + GAIN_WORDS;
        let read = |at: usize, memory: &mut [f32]| {
            for (m, to) in memory.iter_mut().enumerate() {
                *to = f32::from_bits((self.words)(at + m));
            }
        };
        for k in 0..AXES {
            // A state known to NEGLIGIBLE_DPH with small gains is known to ten times that, which still is nothing,
            // with gains of up to ten times. With larger gains only the effect's own memory is gone on from.
            let larger = term.gains.get(k)?.chunks(2).enumerate().any(|(n, pair)| {
                let kept = (self.words)(gains + k * MAX_OUTPUTS / 2 + n);
                let before = [kept as u16, (kept >> 16) as u16].map(|bits| Half::from_bits(bits).value().abs());
                pair.iter().zip(before).any(|(now, before)| now.abs() > 10.0 * before + 1e-6)
            });
            read(at, main.memory(k));
            at += MAX_MEMORY;
            for side in [Side::Cold, Side::Hot] {
                if let Some(copy) = past.copy(e, side) {
                    read(at, copy.memory(k));
                }
                at += MAX_MEMORY;
            }
            let numbers = [at, at + 1].map(|at| f32::from_bits((self.words)(at)));
            past.take(e, k, if larger { [f32::NAN; 2] } else { numbers });
            at += 2;
        }
        Some(())
    }
}

fn checksum(words: &impl Fn(usize) -> u32) -> u32 {
    bytes::crc32_of((0..KEPT_WORDS - 1).map(|k| words(k).to_le_bytes()))
}

/// Writes states as words: `put` is given each word with its place, the checksum last.
pub(crate) fn keep<P: Past>(
    head: Head,
    terms: &[EffectTerm],
    running: &mut [OnUnit],
    past: &mut P,
    mut put: impl FnMut(usize, u32),
) {
    let mut digest = bytes::Digest::default();
    let mut next = 0;
    let mut add = |word: u32| {
        digest.update(&word.to_le_bytes());
        put(next, word);
        next += 1;
    };
    for word in [KEPT, head.sequence, head.time_s.to_bits(), head.resets, running.len() as u32] {
        add(word);
    }
    let mut effects = 0;
    for (e, (main, term)) in running.iter_mut().zip(terms).enumerate() {
        add(u32::from(term.id));
        term.parameters.iter().for_each(|p| add(p.to_bits()));
        for pair in term.gains.as_flattened().chunks(2) {
            let bits = |g: Option<&f32>| u32::from(Half::of(g.map_or(0.0, |g| g.abs())).bits());
            add(bits(pair.first()) | bits(pair.get(1)) << 16);
        }
        for k in 0..AXES {
            for copy in [None, Some(Side::Cold), Some(Side::Hot)] {
                let memory: &[f32] = match copy {
                    None => main.memory(k),
                    Some(side) => past.copy(e, side).map_or(&[], |copy| copy.memory(k)),
                };
                (0..MAX_MEMORY).for_each(|m| add(memory.get(m).map_or(0, |v| v.to_bits())));
            }
            past.numbers(e, k).into_iter().for_each(|n| add(n.to_bits()));
        }
        effects += 1;
    }
    for _ in effects * EFFECT_WORDS..MAX_EFFECTS * EFFECT_WORDS {
        add(0);
    }
    put(KEPT_WORDS - 1, digest.finish());
}

/// Gives running effects back what was kept of them; those of which nothing was kept begin anew.
pub(crate) fn resume<P: Past, W: Fn(usize) -> u32>(
    kept: &Kept<W>,
    terms: &[EffectTerm],
    running: &mut [OnUnit],
    past: &mut P,
) {
    for (e, (main, term)) in running.iter_mut().zip(terms).enumerate() {
        let _ = kept.resume(term, e, main, past);
    }
}

/// The newer of two places where states are kept in turn, so that a reset while one is written leaves the other.
pub fn newer<W: Fn(usize) -> u32>(places: [W; 2]) -> Option<Kept<W>> {
    let [a, b] = places.map(Kept::of);
    match (a, b) {
        (Some(a), Some(b)) if b.head.sequence.wrapping_sub(a.head.sequence) as i32 > 0 => Some(b),
        (Some(a), _) => Some(a),
        (None, b) => b,
    }
}

/// From the last step that was kept to the first step after a restart, beside that step itself, s: the watchdog's half second and
/// the start, to the nearest step.
pub const RESTART_S: f32 = MODEL_STEP_S;

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use crate::compensator::{Compensator, Output};
    use crate::effects::EffectId;
    use crate::status::AxisStatus;
    use std::vec::Vec;

    /// A calibration with effects of gain `gain` on the axes `on`.
    fn calibration(effects: &[(EffectId, [f32; 2], f32)], on: &[usize]) -> Calibration {
        let mut c = Calibration::uncalibrated();
        c.calibrated = true;
        for (effect, parameters, gain) in effects {
            let facts = effect.facts();
            let mut term = EffectTerm::new(facts.id, *parameters);
            on.iter().for_each(|k| term.gains[*k][..facts.outputs].fill(*gain));
            c.effects.push(term).expect("room");
        }
        for axis in &mut c.axes {
            axis.uncertainty.rest_dph2 = 1e-6;
            (axis.valid_from_c_per_min, axis.valid_to_c_per_min) = (-1.0, 1.0);
        }
        c
    }

    const F: [f64; AXES] = [4900.0, 4892.0, 4703.6];

    /// Frequencies on a cycle of ramps of 1 C per minute and soaks of an hour each, at a second.
    fn at(second: u32) -> [Option<f64>; AXES] {
        let minute = f64::from(second) / 60.0;
        let phase = minute % 240.0;
        let c = match phase {
            p if p < 60.0 => p,
            p if p < 120.0 => 60.0,
            p if p < 180.0 => 180.0 - p,
            _ => 0.0,
        };
        F.map(|f| Some(f + 0.4 * (c - 30.0)))
    }

    fn run(c: &mut Compensator, seconds: core::ops::Range<u32>) -> Vec<Output> {
        seconds.map(|k| c.step(&at(k))).collect()
    }

    fn kept(c: &mut Compensator) -> Vec<u32> {
        let mut words = std::vec![0; KEPT_WORDS];
        c.keep(|k, word| words[k] = word);
        words
    }

    /// A unit that starts anew from words.
    fn again(image: &Calibration, words: &[u32]) -> Compensator {
        let mut c = Compensator::new(image.clone(), 0.0);
        c.resume(&Kept::of(|k: usize| words[k]).expect("intact"));
        c
    }

    const ALL: [(EffectId, [f32; 2], f32); 5] = [
        (EffectId::ThermalLag, [900.0, 0.0], 0.1),
        (EffectId::Hysteresis, [4.0, 0.0], 0.1),
        (EffectId::WarmUp, [1500.0, 0.0], 2.0),
        (EffectId::NeighbourLags, [0.0; 2], 0.01),
        (EffectId::HeatingLags, [300.0, 3000.0], 0.01),
    ];

    #[test]
    fn after_power_on_the_past_is_unknown_until_three_time_constants_are_over() {
        let image = calibration(&[(EffectId::ThermalLag, [900.0, 0.0], 0.1)], &[0]);
        // The truth: a unit that has run for long; and one that is switched on in the same ramp.
        let mut truth = Compensator::new(image.clone(), 0.0);
        run(&mut truth, 0..15_000);
        let mut cold = Compensator::new(image, 0.0);
        let (truth, cold) = (run(&mut truth, 15_000..21_000), run(&mut cold, 15_000..21_000));
        let unknown = |o: &Output, k: usize| o.status[k].contains(AxisStatus::HISTORY_UNKNOWN);
        let first_known = cold.iter().position(|o| !unknown(o, 0)).expect("some time");
        assert!((2600..2800).contains(&first_known), "{first_known} s");
        assert!(cold[first_known..].iter().all(|o| !unknown(o, 0)) && cold.iter().all(|o| !unknown(o, 1)));
        let off = |k: usize| (cold[k].bias_dph[0] - truth[k].bias_dph[0]).abs();
        assert!(off(100) > 0.5, "a ramp of 1 C per minute and 900 s are 1.5 deg/h: {}", off(100));
        for k in 0..first_known {
            // The truth lies between the ends: at most sqrt(12) standard deviations from any point between them.
            assert!(off(k) < 3.5 * cold[k].bias_std_dph[0], "{k}: {} of {}", off(k), cold[k].bias_std_dph[0]);
        }
        assert!(off(first_known) < 0.1, "{}", off(first_known));
    }

    #[test]
    fn what_swings_is_unknown_until_three_time_constants_are_over() {
        let swing = [1200.0, 0.1f32];
        let swings_s = 1200.0 / (core::f32::consts::TAU * 0.1);
        let all = [
            (EffectId::DampedOscillation, swing, swings_s),
            (EffectId::UnderdampedLag, swing, swings_s),
            (EffectId::WarmUpByTemperature, [1500.0, 0.0], 1500.0),
        ];
        for (effect, parameters, tau_s) in all {
            let image = calibration(&[(effect, parameters, 2.0)], &[1]);
            let mut c = Compensator::new(image, 0.0);
            let outputs = run(&mut c, 0..20_000);
            let flagged = |o: &Output| o.status[1].contains(AxisStatus::HISTORY_UNKNOWN);
            let until = outputs.iter().rposition(flagged).expect("flagged");
            assert!(outputs[..until].iter().all(flagged), "{}: without a break", effect.name());
            // (The bound of the lag begins with the temperatures that it may have had: it is known a little earlier than its slowest part says.)
            let times = until as f32 / tau_s;
            assert!((2.9..3.2).contains(&times), "{}: {times} time constants", effect.name());
        }
    }

    #[test]
    fn a_product_with_temperature_stays_unknown_where_it_passes_zero() {
        let all = [
            (EffectId::LagLadderByTemperature, [60.0, 3000.0]),
            (EffectId::PlayLadderByTemperature, [1.0, 60.0]),
            (EffectId::PowerOnLadderByTemperature, [120.0, 3000.0]),
        ];
        for (effect, parameters) in all {
            let image = calibration(&[(effect, parameters, 0.1)], &[1]);
            let scaling = image.scaling;
            // The truth: a unit that has run for long. Another one is switched on in the same ramp, and soon passes the middle; a third one
            // at the middle.
            let mut truth = Compensator::new(image.clone(), 0.0);
            run(&mut truth, 0..15_000);
            let truth = run(&mut truth, 15_000..24_000);
            let u = |o: &Output| scaling.u_and_inside(o.temperature_c[1]).1;
            let passed = truth.windows(2).position(|w| u(&w[0]) * u(&w[1]) <= 0.0).expect("it passes the middle");
            for begin in [0, passed] {
                let mut late = Compensator::new(image.clone(), 0.0);
                let late = run(&mut late, 15_000 + begin as u32..24_000);
                let flagged = |o: &Output| o.status[1].contains(AxisStatus::HISTORY_UNKNOWN);
                let behind = passed + 300 - begin;
                assert!(
                    late[..=behind].iter().all(flagged),
                    "{} from {begin}: flagged before and behind it",
                    effect.name()
                );
                for (k, (truth, late)) in truth[begin..].iter().zip(&late).enumerate().skip(100) {
                    let off = (truth.bias_dph[1] - late.bias_dph[1]).abs();
                    let most = 3.5 * late.bias_std_dph[1] + 2.0 * NEGLIGIBLE_DPH;
                    assert!(off < most, "{} from {begin}: {k} s: {off} of {most}", effect.name());
                }
            }
        }
    }

    #[test]
    fn a_first_second_without_a_frequency_costs_no_state() {
        for facts in crate::effects::ALL.iter().filter(|f| f.reach == crate::effects::Reach::Unit) {
            let parameters = match facts.name {
                "temperature-shape" => [-35.0, 55.0],
                _ => [600.0, 1200.0],
            };
            let image = calibration(&[(facts.effect, parameters, 0.1)], &[0, 1, 2]);
            let mut late = Compensator::new(image.clone(), 0.0);
            (0..3).for_each(|_| {
                late.step(&[None; AXES]);
            });
            let mut other = Compensator::new(image, 0.0);
            let still = || at(120 * 60);
            (0..3).for_each(|_| {
                other.step(&still());
            });
            let both = (0..2000).map(|_| [late.step(&still()), other.step(&still())]).last().expect("steps");
            let [late, other] = both.map(|o| o.bias_dph);
            assert!(late.iter().zip(other).all(|(l, o)| (l - o).abs() < 1e-4), "{}: {late:?} {other:?}", facts.name);
            assert!(!both[0].status[0].contains(AxisStatus::UNCALIBRATED), "{}", facts.name);
        }
    }

    #[test]
    fn what_settles_from_the_temperature_at_power_on_is_unknown_by_no_more_than_itself() {
        // Switched on now or long ago: the whole, or nothing. The temperature at power-on is known.
        let image = calibration(&[(EffectId::PowerOnLadderByStart, [120.0, 3600.0], 0.5)], &[0]);
        let mut unit = Compensator::new(image, 0.0);
        for (second, out) in run(&mut unit, 0..8000).iter().enumerate().step_by(TURN as usize) {
            let (whole, std) = (out.bias_dph[0].abs(), out.bias_std_dph[0]);
            assert!(whole > 0.01, "{second} s: a start that is not at the reference: {whole}");
            // (The copies take a step in ten seconds, and their step is that much behind.)
            assert!((std - UNIFORM * whole).abs() < 0.1 * UNIFORM * whole + 0.003, "{second} s: {std} of {whole}");
        }
    }

    #[test]
    fn a_play_knows_its_place_when_the_temperature_has_swept_its_width() {
        let mut c = Compensator::new(calibration(&[(EffectId::Hysteresis, [4.0, 0.0], 0.1)], &[0, 1, 2]), 0.0);
        let out = run(&mut c, 0..1000);
        let swept = |o: &&Output| o.temperature_c[0] - out[0].temperature_c[0] > 4.0;
        let known = out.iter().find(|o| !o.status[0].contains(AxisStatus::HISTORY_UNKNOWN)).expect("known in the end");
        let done = out.iter().find(swept).expect("a ramp");
        assert!((known.temperature_c[0] - done.temperature_c[0]).abs() < 0.3);
        // A unit that stands still never knows.
        let mut still = Compensator::new(calibration(&[(EffectId::Hysteresis, [4.0, 0.0], 0.1)], &[0]), 0.0);
        assert!((0..20_000).all(|_| still.step(&at(0)).status[0].contains(AxisStatus::HISTORY_UNKNOWN)));
    }

    #[test]
    fn a_restart_goes_on_from_what_was_kept() {
        let image = calibration(&ALL, &[0, 1, 2]);
        for reset_at in [15_000, 15_700, 18_000, 23_000, 26_000] {
            let mut undisturbed = Compensator::new(image.clone(), 0.0);
            run(&mut undisturbed, 0..reset_at);
            let words = kept(&mut undisturbed.clone());
            let mut restarted = again(&image, &words);
            assert_eq!(restarted.resets(), 1);
            // A step is lost.
            let (a, b) =
                (run(&mut undisturbed, reset_at..reset_at + 4000), run(&mut restarted, reset_at + 1..reset_at + 4000));
            for (k, (x, y)) in a.iter().skip(1).zip(&b).enumerate() {
                for axis in 0..AXES {
                    let off = (x.bias_dph[axis] - y.bias_dph[axis]).abs();
                    // (The slope of temperature fills for 20 s, flagged.)
                    let settling = y.status[axis].contains(AxisStatus::SETTLING);
                    assert!(off < 0.02 || settling, "reset at {reset_at}, {k} s later: {off} deg/h");
                    assert!(!y.status[axis].contains(AxisStatus::HISTORY_UNKNOWN), "reset at {reset_at}, {k} s later");
                }
            }
        }
        // An unknown past stays unknown.
        let mut young = Compensator::new(image.clone(), 0.0);
        run(&mut young, 0..500);
        let words = kept(&mut young);
        let mut restarted = again(&image, &words);
        let out = run(&mut restarted, 501..20_000);
        let known = out.iter().position(|o| !o.status[0].contains(AxisStatus::HISTORY_UNKNOWN)).expect("known at last");
        let reference = run(&mut young, 500..20_000);
        let wanted =
            reference.iter().position(|o| !o.status[0].contains(AxisStatus::HISTORY_UNKNOWN)).expect("known at last");
        assert!(known.abs_diff(wanted) < 30, "{known} {wanted}");
    }

    #[test]
    fn another_calibration_knows_the_effects_that_it_shares() {
        let (lag, play) = ((EffectId::ThermalLag, [900.0, 0.0], 0.1), (EffectId::Hysteresis, [4.0, 0.0], 0.1));
        let mut unit = Compensator::new(calibration(&[lag, play], &[0, 1, 2]), 0.0);
        run(&mut unit, 0..20_000);
        let words = kept(&mut unit);
        // The lag of another gain is the same memory, in another place.
        let mut burnt = again(&calibration(&[(EffectId::Cubic, [0.0; 2], 0.1), (lag.0, lag.1, 0.3)], &[0]), &words);
        assert!(run(&mut burnt, 20_000..20_100).iter().all(|o| !o.status[0].contains(AxisStatus::HISTORY_UNKNOWN)));
        let mut other = again(&calibration(&[(lag.0, [800.0, 0.0], 0.1)], &[0]), &words);
        assert!(run(&mut other, 20_000..20_100).iter().all(|o| o.status[0].contains(AxisStatus::HISTORY_UNKNOWN)));
    }

    #[test]
    fn a_word_that_changed_or_is_missing_is_noticed_and_the_newer_place_wins() {
        let mut unit = Compensator::new(calibration(&ALL, &[0, 1, 2]), 0.0);
        run(&mut unit, 0..100);
        let old = kept(&mut unit);
        run(&mut unit, 100..101);
        let new = kept(&mut unit);
        for bit in (0..KEPT_WORDS * 32).step_by(37) {
            let mut bad = new.clone();
            bad[bit / 32] ^= 1 << (bit % 32);
            assert!(Kept::of(|k: usize| bad[k]).is_none(), "bit {bit}");
            let found = newer([&bad, &old].map(|w| |k: usize| w[k])).expect("the older");
            assert_eq!(found.head.time_s, 100.0);
        }
        // A reset while the older place is written anew.
        for written in 0..KEPT_WORDS {
            let torn: Vec<u32> = new[..written].iter().chain(&old[written..]).copied().collect();
            let found = newer([&torn, &new].map(|w| |k: usize| w[k])).expect("one of them");
            assert_eq!(found.head.time_s, 101.0);
        }
        assert!(
            newer([&[0; KEPT_WORDS], &[u32::MAX; KEPT_WORDS]].map(|w: &[u32; KEPT_WORDS]| |k: usize| w[k])).is_none()
        );
    }

    #[test]
    fn what_is_made_of_a_lost_neighbour_is_flagged_and_its_uncertainty_covers_it() {
        for effect in [EffectId::AxisGradient, EffectId::NeighbourLags] {
            let image = calibration(&[(effect, [0.0; 2], 0.1)], &[1]);
            let mut truth = Compensator::new(image, 0.0);
            run(&mut truth, 0..14_500);
            let mut lost = truth.clone();
            let mut worst: f32 = 0.0;
            for k in 14_500..36_000 {
                let x_is_lost = (15_000..15_600).contains(&k);
                let f = at(k);
                let (t, l) = (truth.step(&f), lost.step(&if x_is_lost { [None, f[1], f[2]] } else { f }));
                let off = (t.bias_dph[1] - l.bias_dph[1]).abs();
                worst = worst.max(off);
                let flagged = l.status[1].contains(AxisStatus::HISTORY_UNKNOWN);
                assert_eq!(
                    l.status[1].contains(AxisStatus::NEIGHBOUR),
                    x_is_lost || l.status[0].intersects(AxisStatus::UNTRUSTED_TEMPERATURE)
                );
                assert!(off < 0.1 || flagged, "{} at {k}: {off} deg/h", effect.name());
                assert!(
                    off < 3.5 * l.bias_std_dph[1] + 0.05,
                    "{} at {k}: {off} of {}",
                    effect.name(),
                    l.bias_std_dph[1]
                );
                assert!(k < 32_000 || !flagged, "{} at {k}", effect.name());
                assert!(!l.status[2].contains(AxisStatus::HISTORY_UNKNOWN), "z looks at nobody");
            }
            assert!(worst > 0.5, "{}: {worst}", effect.name());
        }
    }

    #[test]
    fn what_was_known_with_small_gains_is_not_with_larger_ones() {
        // A minute after power-on, in a ramp, another image is burned; the unit starts anew with it.
        for (first, second, unknown) in [(0.0f32, 10.0f32, true), (0.002, 10.0, true), (10.0, 9.0, true)] {
            let image = |gain| calibration(&[(EffectId::ThermalLag, [4796.0, 0.0], gain)], &[1]);
            let mut unit = Compensator::new(image(first), 0.0);
            let _ = run(&mut unit, 10_000..10_060);
            let words = kept(&mut unit);
            let mut unit = again(&image(second), &words);
            let last = *run(&mut unit, 10_060..10_160).last().expect("some");
            assert_eq!(last.status[1].contains(AxisStatus::HISTORY_UNKNOWN), unknown, "{first} -> {second}: {last:?}");
        }
        // After hours it is known, with gains that are about the same as with the same ones.
        let image = |gain| calibration(&[(EffectId::ThermalLag, [600.0, 0.0], gain)], &[1]);
        let mut unit = Compensator::new(image(1.0), 0.0);
        let _ = run(&mut unit, 0..10_060);
        let words = kept(&mut unit);
        for (gain, unknown) in [(1.0, false), (1.3, false), (30.0, true)] {
            let mut unit = again(&image(gain), &words);
            let last = *run(&mut unit, 10_060..10_100).last().expect("some");
            assert_eq!(last.status[1].contains(AxisStatus::HISTORY_UNKNOWN), unknown, "1 -> {gain}: {last:?}");
        }
    }

    /// Effects that remember temperatures or the time since power-on, with parameters and the size of their gains. (What remembers a recorded
    /// quantity is tested in `compensator`.)
    const REMEMBER: [(EffectId, [f32; 2], f32); 29] = [
        (EffectId::ThermalLag, [900.0, 0.0], 0.1),
        (EffectId::Hysteresis, [10.0, 0.0], 0.2),
        (EffectId::WarmUp, [1500.0, 0.0], 2.0),
        (EffectId::NeighbourLags, [0.0; 2], 0.02),
        (EffectId::HeatingLags, [300.0, 3000.0], 0.02),
        (EffectId::LagSquares, [60.0, 3000.0], 5.0),
        (EffectId::RampSquareLags, [60.0, 3000.0], 0.2),
        (EffectId::Butterfly, [12.0, 0.0], 1.0),
        (EffectId::Extremes, [0.0; 2], 0.05),
        (EffectId::PlayLadder, [1.0, 30.0], 0.05),
        (EffectId::PlayLadderByTemperature, [1.0, 30.0], 0.05),
        (EffectId::PlayCurve, [12.0, 0.0], 2.0),
        (EffectId::SoftRelay, [40.0, 25.0], 2.0),
        (EffectId::Relay, [40.0, 25.0], 2.0),
        (EffectId::WideningPlay, [5.0, 20.0], 0.2),
        (EffectId::HysteresisByTemperature, [12.0, 0.0], 0.2),
        (EffectId::AsymmetricLag, [300.0, 2000.0], 0.1),
        (EffectId::ArrheniusLadder, [0.01, 3000.0], 0.02),
        (EffectId::LagLadder, [60.0, 3000.0], 0.02),
        (EffectId::LagLadderByTemperature, [60.0, 3000.0], 0.02),
        (EffectId::PowerOnLadder, [60.0, 3000.0], 1.0),
        (EffectId::PowerOnLadderByTemperature, [60.0, 3000.0], 1.0),
        (EffectId::PowerOnLadderByStart, [60.0, 3000.0], 1.0),
        (EffectId::PowerOnCurve, [9000.0, 0.0], 1.0),
        (EffectId::LateOnset, [3000.0, 1200.0], 2.0),
        (EffectId::UnderdampedLag, [1200.0, 0.2], 0.1),
        (EffectId::DampedOscillation, [1200.0, 0.2], 1.0),
        (EffectId::WarmUpByTemperature, [1500.0, 0.0], 1.0),
        (EffectId::SecondDerivative, [0.0; 2], 1.0),
    ];

    /// Of an effect's regressors, each by its number, and of so many: all gains alike, with signs that alternate, falling through zero.
    const GAINS: [fn(usize, usize) -> f32; 3] =
        [|_, _| 1.0, |k, _| if k % 2 == 0 { 1.0 } else { -1.0 }, |k, n| 1.0 - 1.4 * k as f32 / (n.max(2) - 1) as f32];

    /// With an effect on y.
    fn image_of((effect, parameters, size): (EffectId, [f32; 2], f32), gain: fn(usize, usize) -> f32) -> Calibration {
        let mut image = calibration(&[(effect, parameters, 0.0)], &[1]);
        let outputs = effect.facts().outputs;
        for (k, to) in image.effects[0].gains[1].iter_mut().take(outputs).enumerate() {
            *to = size * gain(k, outputs);
        }
        image
    }

    /// An axis that is not flagged is off by no more than what is stated. `truth`: a unit that knows its past. The largest error of all.
    fn covered(truth: &[Output], own: &[Output], told: &str) -> f32 {
        let mut largest = 0.0f32;
        for (k, (known, own)) in truth.iter().zip(own).enumerate().skip(100) {
            let off = (known.bias_dph[1] - own.bias_dph[1]).abs();
            largest = largest.max(off);
            // (The ends of a uniform distribution are 3.46 of its standard deviations apart.)
            let stated = off < 3.5 * own.bias_std_dph[1] + 0.05;
            let flagged = own.status[1].contains(AxisStatus::HISTORY_UNKNOWN);
            assert!(flagged || stated, "{told}, {k} s later: off by {off}: {own:?}");
        }
        largest
    }

    #[test]
    fn an_axis_that_is_not_flagged_knows_its_past_whatever_its_effect_is() {
        for facts in effects::ALL.iter().filter(|f| f.reach == effects::Reach::Unit) {
            let parameters = REMEMBER.iter().find(|r| r.0 == facts.effect).map_or([100.0, 200.0], |r| r.1);
            let none = effects::span(facts.id, &parameters) == Span::None;
            assert!(none || REMEMBER.iter().any(|r| r.0 == facts.effect), "add {} to the list", facts.name);
        }
        for remembers in REMEMBER {
            let mut largest = 0.0f32;
            for (n, gain) in GAINS.into_iter().enumerate() {
                let image = image_of(remembers, gain);
                let truth = run(&mut Compensator::new(image.clone(), 0.0), 0..36_000);
                for begin in (15_000..29_000usize).step_by(2300) {
                    let late = run(&mut Compensator::new(image.clone(), 0.0), begin as u32..begin as u32 + 7_000);
                    let told = std::format!("{remembers:?}, gains {n}, on since {begin}");
                    largest = largest.max(covered(&truth[begin..], &late, &told));
                }
            }
            // (Else there was nothing to flag. A second derivative remembers a minute.)
            assert!(largest > 0.2 || remembers.0 == EffectId::SecondDerivative, "{remembers:?}: {largest}");
        }
    }

    #[test]
    fn an_axis_whose_thermometer_was_lost_is_flagged_until_it_knows_its_past_whatever_its_effect_is() {
        for remembers in REMEMBER {
            for (n, gain) in GAINS.into_iter().enumerate() {
                let image = image_of(remembers, gain);
                let truth = run(&mut Compensator::new(image.clone(), 0.0), 0..48_000);
                for begin in [30_000, 31_500, 35_700, 39_000, 41_700u32] {
                    for long in [60, 1200u32] {
                        let mut unit = Compensator::new(image.clone(), 0.0);
                        run(&mut unit, 0..begin);
                        let back = begin + long;
                        (begin..back).for_each(|s| _ = unit.step(&[at(s)[0], None, at(s)[2]]));
                        let after = run(&mut unit, back..back + 5000);
                        let told = std::format!("{remembers:?}, gains {n}, lost at {begin} for {long} s");
                        covered(&truth[back as usize..], &after, &told);
                    }
                }
            }
        }
    }

    #[test]
    fn a_product_with_temperature_is_known_by_time_at_the_middle_temperature() {
        for effect in [EffectId::LagLadderByTemperature, EffectId::PowerOnLadderByTemperature] {
            let image = calibration(&[(effect, [60.0, 1000.0], 0.1)], &[1]);
            let indicated = |hz: f64| Compensator::new(image.clone(), 0.0).step(&[Some(hz); AXES]).temperature_c[1];
            let (mut low, mut high) = (F[1] - 60.0, F[1] + 60.0);
            for _ in 0..40 {
                let hz = 0.5 * (low + high);
                *(if image.scaling.u_and_inside(indicated(hz)).1 < 0.0 { &mut low } else { &mut high }) = hz;
            }
            let mut unit = Compensator::new(image.clone(), 0.0);
            let flagged = |o: &Output| o.status[1].contains(AxisStatus::HISTORY_UNKNOWN);
            let last = (0..9000).map(|_| unit.step(&[Some(low); AXES])).collect::<Vec<_>>();
            // (As without the factor: half of three of the slowest time constants, as the faster ones are over sooner.)
            assert_eq!(last.iter().rposition(flagged).map(|s| s / 100), Some(14), "{effect:?}");
        }
    }

    #[test]
    fn a_restart_at_the_middle_temperature_states_what_was_stated_before() {
        let image = calibration(&[(EffectId::LagLadderByTemperature, [60.0, 3000.0], 0.1)], &[1]);
        let mut unit = Compensator::new(image.clone(), 0.0);
        for s in 15_000..21_000u32 {
            let before = unit.step(&at(s)).bias_std_dph[1];
            if s % 50 == 0 && s > 15_100 {
                let after = again(&image, &kept(&mut unit)).step(&at(s + 1)).bias_std_dph[1];
                assert!(after < 2.5 * before + 0.02, "{s} s: {before} before, {after} after");
            }
        }
    }
}
