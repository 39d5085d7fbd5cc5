//! Fields of calibration images and of the link's frames, each written once: `layout!` makes of a list of fields both directions
//! and the table that `docs/formats.md` and a Python `struct` string are printed from.
//!
//! # Example
//! ```
//! use hrg_core::bytes::{Reader, Writer};
//! use hrg_core::rate_path::RateFrame;
//! use hrg_core::schema::{size, take, Layout, Number};
//!
//! let mut frame = RateFrame::default();
//! frame.sample = 5;
//! let mut buffer = [0; size(RateFrame::FIELDS)];
//! frame.put_fields(&mut Writer::new(&mut buffer));
//! let again: RateFrame = take(&mut Reader::new(&buffer)).expect("enough bytes");
//! assert_eq!(again.number(0, 0), Some(Number::Whole(5)));
//! ```

use crate::bytes::{Reader, Writer};
use crate::filter::Filter;
use crate::output::Framing;
use crate::reset::{Halt, ResetCause};
use crate::status::{AxisStatus, UnitStatus};
use crate::stopped::Silent;
use crate::unit_name::UnitName;

/// Format of one number in bytes, little-endian.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// Unsigned, one byte.
    U8,
    /// Unsigned, two bytes.
    U16,
    /// Unsigned, four bytes.
    U32,
    /// IEEE 754 single.
    F32,
    /// IEEE 754 double.
    F64,
    /// One byte, 0 or 1.
    Bool,
    /// One byte of text or raw data.
    Byte,
}

impl Format {
    /// Bytes that one takes.
    #[must_use]
    pub const fn size(self) -> usize {
        match self {
            Self::U8 | Self::Bool | Self::Byte => 1,
            Self::U16 => 2,
            Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// Its letter in a format of Python's `struct`.
    #[must_use]
    pub const fn letter(self) -> char {
        match self {
            Self::U8 => 'B',
            Self::U16 => 'H',
            Self::U32 => 'I',
            Self::F32 => 'f',
            Self::F64 => 'd',
            Self::Bool => '?',
            Self::Byte => 's',
        }
    }
}

/// A number of a field.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Number {
    /// A whole number.
    Whole(u32),
    /// A single.
    Single(f32),
    /// A double.
    Double(f64),
}

/// One field of a layout.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Field {
    /// The name in code, files and tables, with its unit.
    pub name: &'static str,
    /// Meaning, in words.
    pub meaning: &'static str,
    /// Format of each of its numbers.
    pub format: Format,
    /// Numbers that it has.
    pub count: usize,
    /// Numbers in a row; 0: it is one number, not a row.
    pub row: usize,
}

impl Field {
    /// Bytes that it takes.
    #[must_use]
    pub const fn size(&self) -> usize {
        self.format.size() * self.count
    }
}

/// Bytes that fields take together.
#[must_use]
pub const fn size(fields: &[Field]) -> usize {
    let (mut sum, mut k) = (0, 0);
    while k < fields.len() {
        sum += fields[k].size();
        k += 1;
    }
    sum
}

/// Type of a field on the wire or in an image.
pub trait Wire: Sized {
    /// Format of each number.
    const FORMAT: Format;
    /// Number of numbers.
    const COUNT: usize;
    /// Numbers in a row; 0: not a row.
    const ROW: usize;
    /// Appends it.
    fn put(&self, w: &mut Writer<'_>);
    /// Takes it off the front; `None` where there is not enough, or no such value.
    fn take(r: &mut Reader<'_>) -> Option<Self>;
    /// One of its numbers.
    fn number(&self, k: usize) -> Number;
    /// Sets one of its numbers; false where it cannot hold that number.
    fn set_number(&mut self, k: usize, n: Number) -> bool;
}

macro_rules! scalar {
    ($($type:ty, $format:ident, $method:ident, $to:expr, $from:expr;)+) => {$(
        impl Wire for $type {
            const FORMAT: Format = Format::$format;
            const COUNT: usize = 1;
            const ROW: usize = 0;
            #[inline]
            fn put(&self, w: &mut Writer<'_>) {
                w.$method(*self);
            }
            #[inline]
            fn take(r: &mut Reader<'_>) -> Option<Self> {
                r.$method()
            }
            fn number(&self, _: usize) -> Number {
                $to(*self)
            }
            fn set_number(&mut self, _: usize, n: Number) -> bool {
                let value: Option<Self> = $from(n);
                *self = value.unwrap_or(*self);
                value.is_some()
            }
        }
    )+};
}

fn whole(n: Number) -> Option<u32> {
    match n {
        Number::Whole(v) => Some(v),
        Number::Single(_) | Number::Double(_) => None,
    }
}

fn double(n: Number) -> Option<f64> {
    Some(match n {
        Number::Whole(v) => f64::from(v),
        Number::Single(v) => f64::from(v),
        Number::Double(v) => v,
    })
}

fn single(n: Number) -> Option<f32> {
    match n {
        Number::Single(v) => Some(v),
        other => double(other).map(|v| v as f32),
    }
}

scalar! {
    u8, U8, u8, |v: u8| Number::Whole(v.into()), |n| whole(n).and_then(|v| v.try_into().ok());
    u16, U16, u16, |v: u16| Number::Whole(v.into()), |n| whole(n).and_then(|v| v.try_into().ok());
    u32, U32, u32, Number::Whole, whole;
    f32, F32, f32, Number::Single, single;
    f64, F64, f64, Number::Double, double;
}

/// Types that lie as a whole number.
macro_rules! as_number {
    ($($type:ty, $format:ident, $int:ident, $to:expr, $from:expr;)+) => {$(
        impl Wire for $type {
            const FORMAT: Format = Format::$format;
            const COUNT: usize = 1;
            const ROW: usize = 0;
            #[inline]
            fn put(&self, w: &mut Writer<'_>) {
                w.$int($to(*self));
            }
            #[inline]
            fn take(r: &mut Reader<'_>) -> Option<Self> {
                r.$int().and_then($from)
            }
            fn number(&self, _: usize) -> Number {
                Number::Whole($to(*self).into())
            }
            fn set_number(&mut self, _: usize, n: Number) -> bool {
                let value: Option<Self> = whole(n).and_then(|v| $int::try_from(v).ok()).and_then($from);
                *self = value.unwrap_or(*self);
                value.is_some()
            }
        }
    )+};
}

as_number! {
    bool, Bool, u8, u8::from, |b: u8| Some(b != 0);
    AxisStatus, U16, u16, |s: AxisStatus| s.bits(), |b: u16| Some(AxisStatus::from_bits_retain(b));
    UnitStatus, U16, u16, |s: UnitStatus| s.bits(), |b: u16| Some(UnitStatus::from_bits_retain(b));
    ResetCause, U8, u8, |c: ResetCause| c as u8, ResetCause::from_number;
    Halt, U8, u8, |h: Halt| h as u8, Halt::from_number;
    Filter, U8, u8, |f: Filter| f as u8, Filter::from_number;
    Framing, U8, u8, |f: Framing| f as u8, Framing::from_number;
    Silent, U8, u8, |s: Silent| s.bits(), |b: u8| Some(Silent::from_bits_retain(b));
}

impl Wire for UnitName {
    const FORMAT: Format = Format::Byte;
    const COUNT: usize = 16;
    const ROW: usize = 16;
    #[inline]
    fn put(&self, w: &mut Writer<'_>) {
        w.bytes(self.bytes());
    }
    #[inline]
    fn take(r: &mut Reader<'_>) -> Option<Self> {
        r.array().map(Self::from_bytes)
    }
    fn number(&self, k: usize) -> Number {
        Number::Whole(self.bytes()[k].into())
    }
    fn set_number(&mut self, k: usize, n: Number) -> bool {
        let mut bytes = *self.bytes();
        let set = bytes[k].set_number(0, n);
        *self = Self::from_bytes(bytes);
        set
    }
}

impl<T: Wire + Copy + Default, const N: usize> Wire for [T; N] {
    const FORMAT: Format = T::FORMAT;
    const COUNT: usize = N * T::COUNT;
    const ROW: usize = if T::ROW == 0 { N } else { T::ROW };
    #[inline]
    fn put(&self, w: &mut Writer<'_>) {
        for v in self {
            v.put(w);
        }
    }
    #[inline]
    fn take(r: &mut Reader<'_>) -> Option<Self> {
        let mut out = [T::default(); N];
        for v in &mut out {
            *v = T::take(r)?;
        }
        Some(out)
    }
    fn number(&self, k: usize) -> Number {
        self[k / T::COUNT].number(k % T::COUNT)
    }
    fn set_number(&mut self, k: usize, n: Number) -> bool {
        self[k / T::COUNT].set_number(k % T::COUNT, n)
    }
}

/// A type whose fields `layout!` lists.
pub trait Layout {
    /// The fields in their order.
    const FIELDS: &'static [Field];
    /// Appends the fields.
    fn put_fields(&self, w: &mut Writer<'_>);
    /// Takes the fields off the front, in place; `None` where there is not enough.
    fn take_fields(&mut self, r: &mut Reader<'_>) -> Option<()>;
    /// One number of a field; `None` where there is no such field.
    fn number(&self, field: usize, k: usize) -> Option<Number>;
    /// Sets one number of a field; false where the field cannot hold it.
    fn set_number(&mut self, field: usize, k: usize, n: Number) -> bool;
}

/// Takes a whole layout off the front.
pub fn take<L: Layout + Default>(r: &mut Reader<'_>) -> Option<L> {
    let mut out = L::default();
    out.take_fields(r)?;
    Some(out)
}

/// Lists the fields of a type that lie in an image or a frame: name, type and meaning of each, in their order. Fields of the type
/// that are not listed lie elsewhere, or nowhere.
macro_rules! layout {
    ($type:ty { $($field:ident: $kind:ty, $meaning:literal;)+ }) => {
        impl $crate::schema::Layout for $type {
            const FIELDS: &'static [$crate::schema::Field] = &[$($crate::schema::Field {
                name: stringify!($field),
                meaning: $meaning,
                format: <$kind as $crate::schema::Wire>::FORMAT,
                count: <$kind as $crate::schema::Wire>::COUNT,
                row: <$kind as $crate::schema::Wire>::ROW,
            }),+];
            #[inline]
            fn put_fields(&self, w: &mut $crate::bytes::Writer<'_>) {
                $(<$kind as $crate::schema::Wire>::put(&self.$field, w);)+
            }
            #[inline]
            fn take_fields(&mut self, r: &mut $crate::bytes::Reader<'_>) -> Option<()> {
                $(self.$field = <$kind as $crate::schema::Wire>::take(r)?;)+
                Some(())
            }
            fn number(&self, field: usize, k: usize) -> Option<$crate::schema::Number> {
                let mut at = 0;
                $(if field == at { return Some($crate::schema::Wire::number(&self.$field, k)); } at += 1;)+
                let _ = at;
                None
            }
            fn set_number(&mut self, field: usize, k: usize, n: $crate::schema::Number) -> bool {
                let mut at = 0;
                $(if field == at { return $crate::schema::Wire::set_number(&mut self.$field, k, n); } at += 1;)+
                let _ = at;
                false
            }
        }
    };
}
pub(crate) use layout;
