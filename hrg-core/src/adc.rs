//! A frame of the ADS131M08: ten 24-bit words, big-endian; status, eight channels, CRC (data sheet SBAS950 8.5).

use crate::rate_path::CHANNELS;

/// Bytes of a frame.
pub const FRAME: usize = 30;
/// Words of memory that hold it, as DMA puts it there: bytes in order, so that a word is little-endian.
pub const WORDS: usize = FRAME.div_ceil(4);
/// Status bit: the ADC has been reset and has lost its settings.
const STATUS_RESET: u16 = 1 << 10;
/// Why a frame gives no sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Fault {
    /// Its checksum does not match.
    Crc,
    /// The ADC reports that it was reset: its settings must be written again.
    Reset,
}

/// CRC-16 of CCITT's polynomial, seed 0xFFFF.
const CRC: crc::Crc<u16> = crc::Crc::<u16>::new(&crc::CRC_16_IBM_3740);
/// Bytes of a word of the frame, and where its last word, the CRC, begins.
const WORD: usize = 3;
const CRC_AT: usize = FRAME - WORD;

/// The codes of the channels in use.
///
/// # Errors
/// See [`Fault`].
// A function of its own in the ELF, so that the virtual board can count what it costs.
#[inline(never)]
pub fn decode(frame: &[u32; WORDS]) -> Result<[i32; CHANNELS], Fault> {
    let mut bytes = [0; 4 * WORDS];
    for (to, word) in bytes.chunks_exact_mut(4).zip(frame) {
        to.copy_from_slice(&word.to_le_bytes());
    }
    let crc = u16::from_be_bytes([bytes[CRC_AT], bytes[CRC_AT + 1]]);
    if CRC.checksum(&bytes[..CRC_AT]) != crc {
        return Err(Fault::Crc);
    }
    if u16::from_be_bytes([bytes[0], bytes[1]]) & STATUS_RESET != 0 {
        return Err(Fault::Reset);
    }
    // The first word is the status. Codes are big-endian, sign-extended from 24 bits.
    Ok(core::array::from_fn(|channel| {
        let at = WORD * (channel + 1);
        i32::from_be_bytes([bytes[at], bytes[at + 1], bytes[at + 2], 0]) >> 8
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    fn words(bytes: &[u8; FRAME]) -> [u32; WORDS] {
        core::array::from_fn(|k| {
            let byte = |n: usize| bytes.get(4 * k + n).copied().unwrap_or(0xA5);
            u32::from_le_bytes([byte(0), byte(1), byte(2), byte(3)])
        })
    }

    fn frame(status: u16, codes: [i32; 8]) -> [u8; FRAME] {
        let mut f = [0; FRAME];
        f[..2].copy_from_slice(&status.to_be_bytes());
        for (k, c) in codes.iter().enumerate() {
            f[3 * (k + 1)..3 * (k + 2)].copy_from_slice(&c.to_be_bytes()[1..]);
        }
        let crc = CRC.checksum(&f[..CRC_AT]);
        f[CRC_AT..CRC_AT + 2].copy_from_slice(&crc.to_be_bytes());
        f
    }

    #[test]
    fn codes_keep_their_sign_and_faults_are_told_apart() {
        let f = frame(0x0500 & !STATUS_RESET, [1, -1, 8_388_607, -8_388_608, 42, 0, 0, 0]);
        assert_eq!(decode(&words(&f)), Ok([1, -1, 8_388_607, -8_388_608, 42]));
        assert_eq!(decode(&words(&frame(0x0500, [0; 8]))), Err(Fault::Reset));
        for bit in 0..29 * 8 {
            let mut g = f;
            g[bit / 8] ^= 1 << (bit % 8);
            assert_eq!(decode(&words(&g)), Err(Fault::Crc), "bit {bit}");
        }
    }

    #[test]
    fn any_codes_come_back() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        for _ in 0..2000 {
            let codes = core::array::from_fn(|_| rng.random_range(-8_388_608..=8_388_607));
            let seen = decode(&words(&frame(0x0500 & !STATUS_RESET, codes))).expect("valid");
            assert_eq!(seen, codes[..CHANNELS]);
        }
    }

    #[test]
    fn the_checksum_is_that_of_the_standard() {
        // The check value of the catalogue of CRCs.
        assert_eq!(CRC.checksum(b"123456789"), 0x29B1);
    }
}
