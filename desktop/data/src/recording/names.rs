//! Names of units: what keeps one unit's calibration out of another.
//!
//! A unit has no name until its first calibration image gives it one. Until then its firmware calls it
//! [`UnitName::UNNAMED`]; recordings and images say `unnamed`, or nothing. No two of those are known to be of one
//! unit, so they are never matched by their names.

use crate::error::BadInput;
use hrg_core::calibration::Calibration;
use hrg_core::unit_name::UnitName;
use std::borrow::Cow;

/// Name in recordings for a unit without a name.
pub const NONE: &str = "unnamed";

/// Bytes of a name at most.
const LONGEST: usize = 16;

/// Why a text is no name.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum NameError {
    /// It stands for having none.
    #[error("\"{0}\" stands for a unit without a name; give the unit's own, HRG-042 for instance")]
    Unnamed(String),
    /// A unit could not keep it as it is.
    #[error("\"{0}\" cannot be kept as a unit's name: 1 to {LONGEST} letters, digits and signs of ASCII, no blanks")]
    Unfit(String),
}

impl From<NameError> for BadInput {
    fn from(e: NameError) -> Self {
        Self(e.to_string())
    }
}

/// `true` if the text means a unit without a name.
#[must_use]
pub fn is_unnamed(name: &str) -> bool {
    name.is_empty() || name == NONE || name == UnitName::UNNAMED.as_str()
}

/// A name as a unit keeps it.
///
/// # Errors
/// A text that would not come back as it is, or stands for having no name.
pub fn check(name: &str) -> Result<&str, NameError> {
    if is_unnamed(name) {
        return Err(NameError::Unnamed(name.into()));
    }
    let fits = name.len() <= LONGEST && name.bytes().all(|b| b.is_ascii_graphic());
    fits.then_some(name).ok_or_else(|| NameError::Unfit(name.into()))
}

/// A recording's name as a unit keeps it. One that does not fit is cut, with a check sum of the whole, so that two units whose names
/// begin alike stay two.
#[must_use]
pub fn kept(name: &str) -> Cow<'_, str> {
    if is_unnamed(name) || check(name).is_ok() {
        return Cow::Borrowed(name);
    }
    let sum = crc::Crc::<u16>::new(&crc::CRC_16_IBM_3740).checksum(name.as_bytes());
    let begin: String = name.chars().filter(char::is_ascii_graphic).take(LONGEST - 5).collect();
    Cow::Owned(format!("{begin}~{sum:04x}"))
}

/// The name of a calibration image; `None` where it has none.
#[must_use]
pub fn of(c: &Calibration) -> Option<&str> {
    Some(c.unit_name()).filter(|n| !is_unnamed(n))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_comes_back_as_it_was_given_or_is_refused() {
        for good in ["HRG-042", "a", "sixteen-letters!"] {
            let mut c = Calibration::uncalibrated();
            c.set_unit_name(check(good).expect("fits"));
            assert_eq!(of(&c), Some(good));
        }
        for bad in ["", "default", "unnamed", "HRG 042", "seventeen-letters", "HRG-Ä", "a\tb"] {
            assert!(check(bad).is_err(), "{bad}");
        }
        assert_eq!(of(&Calibration::uncalibrated()), None);
        let (a, b) = (kept("HRG-2026-batch-A-001"), kept("HRG-2026-batch-A-002"));
        assert!(a != b && check(&a).is_ok() && check(&b).is_ok() && a.starts_with("HRG-2026-ba~"), "{a} {b}");
        assert!(check(&kept("gyro 7")).is_ok() && kept("gyro 7") != kept("gyro7") && kept("HRG-7") == "HRG-7");
    }
}
