//! Signatures of calibration images: Ed25519, by the crate `salty`, made for small processors (`hrg unit burn --key` signs by another
//! crate, `ed25519-dalek`).
//!
//! The signature lies right behind the image and signs the image's bytes, checksum included. So it covers the unit's name and the
//! sequence number, too: an image signed for one unit is none for another, and an older one is not newer for being signed.
//! A program without the feature `signed` has no [`Key`] and asks for no signature.
//!
//! # Example
//! ```
//! use hrg_core::calibration::Calibration;
//! use hrg_core::signature::{behind, SIGNATURE};
//!
//! // What lies behind an image in flash, whether or not it is a signature of anyone's.
//! let mut place = Calibration::uncalibrated().to_bytes().expect("fits").to_vec();
//! assert_eq!(behind(&place), None);
//! place.extend_from_slice(&[7; SIGNATURE]);
//! assert_eq!(behind(&place), Some(&[7; SIGNATURE]));
//! ```

use crate::calibration::stated_length;

/// Bytes of a signature.
pub const SIGNATURE: usize = 64;

/// The public key whose signatures a unit wants. Without the feature `signed` there is none.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg(not(feature = "signed"))]
pub enum Key {}

/// The public key whose signatures a unit wants.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg(feature = "signed")]
pub struct Key([u8; 32]);

/// The signature behind an image; `None`: the flash there is erased, or there is no more of it. `place` begins with the image.
#[must_use]
pub fn behind(place: &[u8]) -> Option<&[u8; SIGNATURE]> {
    let signature = place.get(stated_length(place)?..)?.first_chunk()?;
    Some(signature).filter(|s| **s != [0xFF; SIGNATURE])
}

#[cfg(not(feature = "signed"))]
impl Key {
    /// `true` if a signature is this key's, of the image that `place` begins with.
    #[must_use]
    pub fn signed(&self, _: &[u8], _: &[u8; SIGNATURE]) -> bool {
        match *self {}
    }

    /// `true` if a signature is this key's, of a message.
    #[must_use]
    pub fn has_signed(&self, _: &[u8], _: &[u8; SIGNATURE]) -> bool {
        match *self {}
    }
}

/// Order of the group, least byte first.
#[cfg(feature = "signed")]
const ORDER: [u8; SIGNATURE / 2] = [
    0xed, 0xd3, 0xf5, 0x5c, 0x1a, 0x63, 0x12, 0x58, 0xd6, 0x9c, 0xf7, 0xa2, 0xde, 0xf9, 0xde, 0x14, 0, 0, 0, 0, 0, 0,
    0, 0, 0, 0, 0, 0, 0, 0, 0, 0x10,
];

#[cfg(feature = "signed")]
impl Key {
    /// Makes a key of 32 bytes. The first check tells if they are a point of the curve: bytes that are none have signed nothing.
    #[must_use]
    pub const fn new(bytes: [u8; 32]) -> Self {
        Self(bytes)
    }

    /// `true` if a signature is this key's, of the image that `place` begins with. (The first word of the image may
    /// be missing in flash still: it is programmed last.)
    // Out of line: its stack is needed for a short time only.
    #[inline(never)]
    #[must_use]
    pub fn signed(&self, place: &[u8], signature: &[u8; SIGNATURE]) -> bool {
        use crate::calibration::{COMMIT, MAGIC, MAX_BYTES};
        let Some(image) = stated_length(place).and_then(|n| place.get(..n)) else { return false };
        let mut message = [0; MAX_BYTES];
        let Some((message, _)) = message.split_at_mut_checked(image.len()) else { return false };
        message.iter_mut().zip(image).for_each(|(to, from)| *to = *from);
        if let Some(first) = message.first_chunk_mut::<COMMIT>() {
            *first = MAGIC;
        }
        self.has_signed(message, signature)
    }

    /// `true` if a signature is this key's, of a message.
    #[inline(never)]
    #[must_use]
    pub fn has_signed(&self, message: &[u8], signature: &[u8; SIGNATURE]) -> bool {
        let Ok(key) = salty::PublicKey::try_from(&self.0) else { return false };
        // A signature has one form: its second half is less than the order of the group (RFC 8032, section 5.1.7), which salty leaves open.
        let (_, s) = signature.split_at(SIGNATURE / 2);
        s.iter().rev().lt(ORDER.iter().rev()) && key.verify(message, &salty::Signature::from(signature)).is_ok()
    }
}
