//! The name of a unit: what keeps one unit's calibration out of another.
//!
//! # Example
//! ```
//! use hrg_core::unit_name::UnitName;
//!
//! assert_eq!(UnitName::new("HRG-042").as_str(), "HRG-042");
//! // Blanks go, and so does what is longer than sixteen characters.
//! assert_eq!(UnitName::new("unit of the laboratory").as_str(), "unitofthelaborat");
//! ```

/// A name as calibration images and the link carry it: up to 16 ASCII characters without blanks, padded with zeros.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct UnitName([u8; 16]);

impl Default for UnitName {
    fn default() -> Self {
        Self::UNNAMED
    }
}

impl UnitName {
    /// Name of a unit that has none yet: its flash holds no valid calibration image.
    pub const UNNAMED: Self = Self(*b"default\0\0\0\0\0\0\0\0\0");

    /// Characters that no name has are left out; what is longer than 16 bytes is cut.
    #[must_use]
    pub fn new(name: &str) -> Self {
        let mut bytes = [0; 16];
        for (to, from) in bytes.iter_mut().zip(name.bytes().filter(u8::is_ascii_graphic)) {
            *to = from;
        }
        Self(bytes)
    }

    /// As it was read. It need not be text: names are compared as bytes.
    #[must_use]
    pub const fn from_bytes(bytes: [u8; 16]) -> Self {
        Self(bytes)
    }

    /// As it is written.
    #[must_use]
    pub const fn bytes(&self) -> &[u8; 16] {
        &self.0
    }

    /// As text; `?` where it is none.
    #[must_use]
    pub fn as_str(&self) -> &str {
        let end = self.0.iter().position(|&b| b == 0).unwrap_or(self.0.len());
        core::str::from_utf8(&self.0[..end]).unwrap_or("?")
    }
}

impl core::fmt::Debug for UnitName {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        core::fmt::Debug::fmt(self.as_str(), f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_comes_back_and_other_bytes_are_refused() {
        assert_eq!(UnitName::new("HRG-042").as_str(), "HRG-042");
        assert_eq!(UnitName::new("sixteen-letters!").as_str(), "sixteen-letters!");
        assert_eq!(UnitName::new("a b\tc, and much longer").as_str(), "abc,andmuchlonge");
        assert_eq!(UnitName::UNNAMED.as_str(), "default");
        assert_eq!(UnitName::from_bytes([0xFF; 16]).as_str(), "?");
        assert_ne!(UnitName::from_bytes([0xFF; 16]), UnitName::from_bytes([0xFE; 16]));
    }
}
