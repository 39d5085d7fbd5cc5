//! Inputs: quantities beside the frequencies that a model may look at, each with a number, a name and a unit.
//!
//! The electronics of a gyro know them: the voltage that keeps the amplitude follows the damping of the resonator, the voltage that nulls
//! the quadrature follows the mismatch of its stiffness. They come in once a second, by the link's message
//! [`Inputs`](crate::link::Message::Inputs) or from channels of the ADC. An image states for each that it needs
//! ([`Input`]) the range in which it was learnt.
//!
//! # Missing inputs
//! A value counts for some seconds ([`Input::counts_s`]). While there is none, while it stands still for longer than it ever did in training,
//! and where it is further outside its range than half its width, the input is *missing*: its effects are replaced by what temperature and
//! ramp tell of them ([`Input::expected`]), and lags of it begin anew. Outside its range by less, a value is used. In all these cases the axes
//! that use it are flagged [`INPUT`](crate::status::AxisStatus::INPUT), and the uncertainty of their bias grows by what temperature and ramp
//! did not tell of its effects in training.
//!
//! # Example
//! ```
//! use hrg_core::inputs::{self, InputBank, InputValues, Quantities};
//!
//! let drive_x = inputs::number("drive_x_v").expect("in the list");
//! let mut bank = InputBank::default();
//! bank.receive(&InputValues::of([(drive_x, 2.25)]));
//! // The step that ends now takes it; in the next nothing has come.
//! assert_eq!(bank.step().get(drive_x), 2.25);
//! assert!(bank.step().get(drive_x).is_nan() && bank.any());
//! ```

use crate::bias::TERMS;
use crate::calibration::Calibration;
use crate::effects;
use crate::sensors::Window;
use crate::AXES;
use heapless::Vec;

/// Numbers that a quantity may have: 0 to 15.
pub const QUANTITIES: usize = 16;

/// Names of the quantities in files and on screens, with their units, by number.
pub const NAMES: [&str; QUANTITIES] = [
    "board_c",
    "supply_v",
    "drive_x_v",
    "drive_y_v",
    "drive_z_v",
    "quad_x_v",
    "quad_y_v",
    "quad_z_v",
    "case_x_c",
    "case_y_c",
    "case_z_c",
    "chip_c",
    "chip_v",
    "input_1",
    "input_2",
    "input_3",
];

/// The number of the quantity with a name.
#[must_use]
pub fn number(name: &str) -> Option<u8> {
    NAMES.iter().position(|n| *n == name).map(|k| k as u8)
}

/// Values of one message at most.
pub const IN_MESSAGE: usize = 8;

/// Place of a message that holds no value.
const NO_VALUE: u8 = 0xFF;

/// A value counts for at least so many seconds.
pub const LEAST_COUNTS_S: u8 = 3;

bitflags::bitflags! {
    /// A set of quantities: the bit of each is its number.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
    pub struct QuantitySet: u16 {
        /// The board's temperature.
        const BOARD = 1;
        /// The supply.
        const SUPPLY = 1 << 1;
        /// Temperatures of the cases.
        const CASES = 0b111 << 8;
        /// Temperature and supply of the unit's own processor, which no message brings ([`crate::chip`]).
        const CHIP = 0b11 << 11;
        /// Bits without a name of their own.
        const _ = !0;
    }
}

impl QuantitySet {
    /// One quantity; none for a number that there is not.
    #[must_use]
    pub const fn one(number: u8) -> Self {
        Self::from_bits_retain(if (number as usize) < QUANTITIES { 1 << number } else { 0 })
    }

    /// The numbers in it.
    pub fn numbers(self) -> impl Iterator<Item = u8> {
        (0..QUANTITIES as u8).filter(move |n| self.contains(Self::one(*n)))
    }
}

/// Values of the quantities by number; NaN where missing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quantities([f32; QUANTITIES]);

impl Quantities {
    /// All missing.
    pub const NONE: Self = Self([f32::NAN; QUANTITIES]);

    /// Values by number.
    #[must_use]
    pub const fn new(values: [f32; QUANTITIES]) -> Self {
        Self(values)
    }

    /// The values by number.
    #[must_use]
    pub const fn values(&self) -> &[f32; QUANTITIES] {
        &self.0
    }

    /// The value with a number; NaN where it is missing.
    #[inline]
    #[must_use]
    pub fn get(&self, number: u8) -> f32 {
        self.0.get(usize::from(number)).copied().unwrap_or(f32::NAN)
    }

    /// Temperature of the board, C.
    #[inline]
    #[must_use]
    pub fn board_c(&self) -> f32 {
        self.get(BOARD)
    }

    /// Supply, V.
    #[inline]
    #[must_use]
    pub fn supply_v(&self) -> f32 {
        self.get(SUPPLY)
    }

    /// Amplitude-control drive of an axis, V.
    #[inline]
    #[must_use]
    pub fn drive_v(&self, axis: usize) -> f32 {
        self.get(drive(axis))
    }

    /// Quadrature-nulling voltage of an axis, V.
    #[inline]
    #[must_use]
    pub fn quad_v(&self, axis: usize) -> f32 {
        self.get(quad(axis))
    }

    /// Sensor on the case of an axis, C.
    #[inline]
    #[must_use]
    pub fn case_c(&self, axis: usize) -> f32 {
        self.get(case(axis))
    }

    /// The same as the effects count them ([`Input::counted`]); those that are no inputs stay as they are.
    #[must_use]
    pub fn counted(&self, inputs: &[Input]) -> Self {
        let mut out = *self;
        for i in inputs {
            out.0.iter_mut().skip(i.quantity.into()).take(1).for_each(|v| *v = i.counted(*v));
        }
        out
    }

    /// Those of a set; the others are missing.
    #[must_use]
    pub fn of(&self, set: QuantitySet) -> Self {
        let mut out = *self;
        for (v, number) in out.0.iter_mut().zip(0..) {
            if !set.contains(QuantitySet::one(number)) {
                *v = f32::NAN;
            }
        }
        out
    }
}

/// Number of the board's temperature.
pub const BOARD: u8 = 0;
/// Number of the supply.
pub const SUPPLY: u8 = 1;
/// Temperature of the unit's processor.
pub const CHIP_C: u8 = 11;
/// Its supply.
pub const CHIP_V: u8 = 12;

/// Number of the amplitude-control drive of an axis.
#[must_use]
pub const fn drive(axis: usize) -> u8 {
    2 + axis as u8
}

/// Number of the quadrature-nulling voltage of an axis.
#[must_use]
pub const fn quad(axis: usize) -> u8 {
    5 + axis as u8
}

/// Number of the sensor on the case of an axis.
#[must_use]
pub const fn case(axis: usize) -> u8 {
    8 + axis as u8
}

/// Number of a quantity on an axis: of one that each axis has (drive, quadrature, case) that of the axis.
#[must_use]
pub const fn of_axis(number: u8, axis: usize) -> u8 {
    match number {
        2..=4 => drive(axis),
        5..=7 => quad(axis),
        8..=10 => case(axis),
        common => common,
    }
}

/// Values as one message holds them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InputValues {
    /// Number of each; 255: none stands here.
    pub numbers: [u8; IN_MESSAGE],
    /// Values.
    pub values: [f32; IN_MESSAGE],
}

impl Default for InputValues {
    fn default() -> Self {
        Self { numbers: [NO_VALUE; IN_MESSAGE], values: [0.0; IN_MESSAGE] }
    }
}

impl InputValues {
    /// Of numbers and values; those beyond [`IN_MESSAGE`] are left out.
    #[must_use]
    pub fn of(values: impl IntoIterator<Item = (u8, f32)>) -> Self {
        let mut out = Self::default();
        for ((number, value), (n, v)) in out.numbers.iter_mut().zip(&mut out.values).zip(values) {
            (*number, *value) = (n, v);
        }
        out
    }
}

/// The newest value of each quantity that has come since the last model step.
#[derive(Debug, Clone)]
pub struct InputBank {
    values: Quantities,
    any: bool,
}

impl Default for InputBank {
    fn default() -> Self {
        Self { values: Quantities::NONE, any: false }
    }
}

impl InputBank {
    /// Takes the values of a message. Numbers that there are not, values that are not finite, and those of the unit's own processor, are left
    /// out.
    pub fn receive(&mut self, message: &InputValues) {
        for (number, value) in message.numbers.iter().zip(message.values) {
            if !QuantitySet::CHIP.contains(QuantitySet::one(*number)) {
                self.set(*number, value);
            }
        }
    }

    /// Takes one value.
    pub fn set(&mut self, number: u8, value: f32) {
        if let (Some(to), true) = (self.values.0.get_mut(usize::from(number)), value.is_finite()) {
            *to = value;
            self.any = true;
        }
    }

    /// Takes the means of the ADC's channels 5 to 7 over the second of a model step.
    pub fn take(&mut self, window: &Window, channels: &[Channel; AXES]) {
        for (channel, mean) in channels.iter().zip(window.means()) {
            if let Some(code) = mean {
                self.set(channel.quantity, (channel.at_zero + channel.per_code * code) as f32);
            }
        }
    }

    /// `true` once any value has come.
    #[must_use]
    pub fn any(&self) -> bool {
        self.any
    }

    /// The values that have come for the model step that ends now.
    pub fn step(&mut self) -> Quantities {
        core::mem::replace(&mut self.values, Quantities::NONE)
    }
}

/// Outside its range an input is used so far beyond it, as a share of the width of the range.
const BEYOND: f32 = 0.5;

/// A channel of the ADC that an input comes in by.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Channel {
    /// Number of the quantity.
    pub quantity: u8,
    /// One code in the quantity's unit.
    pub per_code: f64,
    /// The quantity at code 0, in its unit.
    pub at_zero: f64,
}

impl Channel {
    /// The amplitude-control drive of each axis at half their voltage (two equal resistors), at inputs of 1.2 V full scale and 24 bits.
    pub const DRIVES: [Self; AXES] = [Self::half(drive(0)), Self::half(drive(1)), Self::half(drive(2))];

    /// A voltage of which half is at the input.
    #[must_use]
    pub const fn half(quantity: u8) -> Self {
        Self { quantity, per_code: 2.0 * 1.2 / 8_388_608.0, at_zero: 0.0 }
    }
}

/// An input that an image needs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Input {
    /// Number of the quantity.
    pub quantity: u8,
    /// Seconds for which a value counts.
    pub counts_s: u8,
    /// A value that has not changed for more messages than this stands still.
    pub most_equal: u16,
    /// Value from which the effects count it, in its unit.
    pub reference: f32,
    /// Change that the effects count as one, in its unit: 1 but for quantities whose unit is far too large or too small for them.
    pub scale: f32,
    /// Lowest value that is not flagged, in its unit.
    pub valid_from: f32,
    /// Highest value that is not flagged, in its unit.
    pub valid_to: f32,
    /// Its effects on each axis as temperature and ramp tell them: coefficients of [`crate::bias::regressors`], deg/h.
    pub expected: [[f32; TERMS]; AXES],
    /// Standard deviation of what these do not tell of its effects, in training, deg/h: the uncertainty where it is missing.
    pub without_dph: [f32; AXES],
}

impl Default for Input {
    fn default() -> Self {
        Self {
            quantity: 0,
            counts_s: LEAST_COUNTS_S,
            most_equal: u16::MAX,
            reference: 0.0,
            scale: 1.0,
            valid_from: 0.0,
            valid_to: 0.0,
            expected: [[0.0; TERMS]; AXES],
            without_dph: [0.0; AXES],
        }
    }
}

/// Inputs of an image at most.
pub const MAX_INPUTS: usize = 8;

/// Inputs of an image.
pub type InputTable = Vec<Input, MAX_INPUTS>;

/// Values with the lowest and the highest ones in the place of those of a set, as the effects count them.
#[must_use]
pub fn with_ends(values: &Quantities, inputs: &[Input], of: QuantitySet) -> [Quantities; 2] {
    let mut ends = [*values; 2];
    for i in inputs.iter().filter(|i| of.contains(QuantitySet::one(i.quantity))) {
        for (end, value) in ends.iter_mut().zip([i.valid_from, i.valid_to]) {
            end.0.iter_mut().skip(i.quantity.into()).take(1).for_each(|v| *v = i.counted(value));
        }
    }
    ends
}

/// The inputs as the effects see them in one step.
#[derive(Debug, Clone, Copy)]
pub struct Seen {
    /// Values as the effects count them; NaN for one that is missing.
    pub values: Quantities,
    /// Those that are missing.
    pub missing: QuantitySet,
    /// Those that are missing or out of range.
    pub outside: QuantitySet,
}

impl Input {
    /// A value as the effects count it: from the reference, in its scale.
    #[inline]
    #[must_use]
    pub fn counted(&self, value: f32) -> f32 {
        (value - self.reference) / self.scale
    }

    /// `true` for a value that is used: in the range, or beyond it by no more than half its width.
    #[inline]
    #[must_use]
    pub fn uses(&self, value: f32) -> bool {
        let beyond = BEYOND * (self.valid_to - self.valid_from);
        (self.valid_from - beyond..=self.valid_to + beyond).contains(&value)
    }
}

impl Seen {
    /// No input at all.
    pub const NONE: Self =
        Self { values: Quantities::NONE, missing: QuantitySet::empty(), outside: QuantitySet::empty() };
}

/// The newest value of an input.
#[derive(Debug, Clone, Copy)]
struct Newest {
    /// As it came.
    raw: f32,
    /// Messages in a row that brought it.
    equal: u16,
    /// Seconds for which it counts.
    left_s: u8,
}

/// The newest value of each input of an image, and the axes that use it.
#[derive(Debug, Clone)]
pub struct Held {
    newest: [Newest; QUANTITIES],
    uses: [QuantitySet; AXES],
}

impl Held {
    /// Of an image; nothing has come yet.
    #[must_use]
    pub fn new(calibration: &Calibration) -> Self {
        let none = Newest { raw: f32::NAN, equal: 0, left_s: 0 };
        Self { newest: [none; QUANTITIES], uses: core::array::from_fn(|a| uses(calibration, a)) }
    }

    /// One step: the values that have come for it, as the effects see them.
    pub fn see(&mut self, inputs: &[Input], given: &Quantities) -> Seen {
        let none = QuantitySet::empty();
        let mut seen = Seen { values: Quantities::NONE, missing: none, outside: none };
        for input in inputs {
            let at = usize::from(input.quantity);
            let (Some(newest), Some(to)) = (self.newest.get_mut(at), seen.values.0.get_mut(at)) else { continue };
            let value = given.get(input.quantity);
            if value.is_finite() {
                newest.equal = if value.to_bits() == newest.raw.to_bits() { newest.equal.saturating_add(1) } else { 0 };
                newest.raw = value;
                newest.left_s = input.counts_s;
            }
            let (low, high) = (input.valid_from, input.valid_to);
            let one = QuantitySet::one(input.quantity);
            // (The processor's own ADC says itself when it has no value; its codes are coarse, and may stand for long.)
            let stands = newest.equal > input.most_equal && !QuantitySet::CHIP.contains(one);
            if newest.left_s == 0 || !input.uses(newest.raw) || stands {
                seen.missing |= one;
                seen.outside |= one;
            } else {
                *to = input.counted(newest.raw);
                if !(low..=high).contains(&newest.raw) {
                    seen.outside |= one;
                }
            }
            newest.left_s = newest.left_s.saturating_sub(1);
        }
        seen
    }

    /// The quantities that an axis uses.
    #[must_use]
    pub fn uses(&self, axis: usize) -> QuantitySet {
        self.uses.get(axis).copied().unwrap_or_default()
    }

    /// Variance that comes on top on an axis where inputs are not as they should be, (deg/h)^2; `None` where it uses none of them.
    #[must_use]
    pub fn more_dph2(&self, axis: usize, inputs: &[Input], outside: QuantitySet) -> Option<f32> {
        let bad = self.uses.get(axis)?.intersection(outside);
        if bad.is_empty() {
            return None;
        }
        let of = |i: &Input| i.without_dph.get(axis).copied().unwrap_or(0.0);
        Some(inputs.iter().filter(|i| bad.contains(QuantitySet::one(i.quantity))).map(|i| of(i) * of(i)).sum())
    }
}

/// The effects of missing inputs on an axis as temperature and ramp tell them, deg/h. `x`: [`crate::bias::regressors`].
#[must_use]
pub fn expected_dph(inputs: &[Input], missing: QuantitySet, axis: usize, x: &[f32; TERMS]) -> f32 {
    let of = |i: &Input| {
        let expected = i.expected.get(axis).map_or(&[][..], |e| &e[..]);
        crate::bias::dot(expected, x)
    };
    inputs.iter().filter(|i| missing.contains(QuantitySet::one(i.quantity))).map(of).sum()
}

/// The quantities that the effects of an image read on an axis.
#[must_use]
pub fn uses(calibration: &Calibration, axis: usize) -> QuantitySet {
    let acts = |e: &&crate::calibration::EffectTerm| e.gains.get(axis).is_some_and(|g| g.iter().any(|g| *g != 0.0));
    let of = |e: &crate::calibration::EffectTerm| effects::reads(e.id, &e.parameters, axis);
    calibration.effects.iter().filter(acts).map(of).collect()
}

/// The quantities that an image needs: those that its effects read on any axis.
#[must_use]
pub fn needed(calibration: &Calibration) -> QuantitySet {
    (0..AXES).map(|a| uses(calibration, a)).collect()
}
