//! The two flash sectors that hold calibration images: the newest valid one is used.

use crate::calibration::{Calibration, ImageError};

/// One of the two.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Sector {
    /// The first.
    A,
    /// The second.
    B,
}

impl Sector {
    /// The other one.
    #[must_use]
    pub const fn other(self) -> Self {
        match self {
            Self::A => Self::B,
            Self::B => Self::A,
        }
    }

    /// As the link counts them: 0 and 1.
    #[must_use]
    pub const fn number(self) -> u8 {
        match self {
            Self::A => 0,
            Self::B => 1,
        }
    }

    /// The sector of a number.
    #[must_use]
    pub const fn from_number(number: u8) -> Option<Self> {
        match number {
            0 => Some(Self::A),
            1 => Some(Self::B),
            _ => None,
        }
    }
}

/// The checksum that stands at the end of an image; `None` where there is no room for one.
#[must_use]
pub fn stored_checksum(bytes: &[u8]) -> Option<u32> {
    let length = u16::from_le_bytes(*bytes.get(6..8)?.first_chunk()?);
    let end = usize::from(length);
    Some(u32::from_le_bytes(*bytes.get(end.checked_sub(4)?..end)?.first_chunk()?))
}

/// What the two flash sectors hold.
#[derive(Debug, Clone, PartialEq)]
pub struct Found {
    /// The newest valid image, with the sector it came from.
    pub newest: Option<(Calibration, Sector)>,
    /// Why a sector's content was refused that is no valid image and not erased either: an image whose memory has changed, or
    /// one whose writing was cut short. The unit says so ([`crate::status::UnitStatus::IMAGE_REFUSED`]), for the one in use may be
    /// the older.
    pub refused: Option<ImageError>,
}

/// Looks at both sectors.
#[inline(never)]
#[must_use]
pub fn newest(a: &[u8], b: &[u8]) -> Found {
    // An image is large, and the unit's stack small: one at a time, and the one that is used is read once more.
    let number = |bytes| Calibration::from_bytes(bytes).map(|c| c.sequence);
    let (x, y) = (number(a), number(b));
    let refused = [x.err(), y.err()].into_iter().flatten().find(|e| *e != ImageError::NoImage);
    let sector = match (x, y) {
        // Sequence numbers compare across their wrap.
        (Ok(x), Ok(y)) if y.wrapping_sub(x) as i32 > 0 => Some(Sector::B),
        (Ok(_), _) => Some(Sector::A),
        (Err(_), Ok(_)) => Some(Sector::B),
        (Err(_), Err(_)) => None,
    };
    let read = |sector| {
        let bytes = match sector {
            Sector::A => a,
            Sector::B => b,
        };
        Some((Calibration::from_bytes(bytes).ok()?, sector))
    };
    Found { newest: sector.and_then(read), refused }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::tests::full;
    use crate::calibration::MAX_BYTES;

    #[test]
    fn every_flipped_bit_is_noticed() {
        let good = full().to_bytes().expect("fits");
        for bit in 0..good.len() * 8 {
            let mut bad = good.clone();
            bad[bit / 8] ^= 1 << (bit % 8);
            let found = newest(&bad, &[0xFF; MAX_BYTES]);
            assert!(found.newest.is_none() && found.refused.is_some(), "bit {bit}: {found:?}");
        }
    }

    #[test]
    fn newest_valid_image_wins() {
        let (mut x, mut y) = (full(), full());
        x.sequence = u32::MAX;
        y.sequence = 0;
        let (bx, mut by) = (x.to_bytes().expect("fits"), y.to_bytes().expect("fits"));
        assert_eq!(newest(&bx, &by), Found { newest: Some((y, Sector::B)), refused: None });
        by[20] ^= 4;
        let refused = Some(ImageError::Checksum);
        assert_eq!(
            newest(&bx, &by),
            Found { newest: Some((x, Sector::A)), refused },
            "the older is used, and that is said"
        );
        assert_eq!(newest(&[0xFF; 8], &by), Found { newest: None, refused });
        assert_eq!(newest(&[0xFF; 8], &[]), Found { newest: None, refused: None });
    }
}
