//! A frame of the ADS131M08 converter: ten 24-bit words, big-endian; status, eight channels, CRC (data sheet SBAS950 8.5).

use crate::rate_path::CHANNELS;

/// Bytes of a frame.
pub const FRAME: usize = 30;
/// Words of memory that hold it, as DMA puts it there: bytes in order, so that a word is little-endian.
pub const WORDS: usize = FRAME.div_ceil(4);
/// Status bit: the converter has been reset and has lost its settings.
const STATUS_RESET: u16 = 1 << 10;
/// Why a frame gives no sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Fault {
    /// Its checksum does not match.
    Crc,
    /// The converter says that it was reset: its settings must be written again.
    Reset,
}

/// Takes 16 bits more into a CRC-16 of CCITT's polynomial, `x^16 + x^12 + x^5 + 1`, without a table.
///
/// The remainder of `t x^16` is the lower half of `q (x^12 + x^5 + 1)`, with `q` the quotient; and the quotient is `t` times
/// `1 / (1 + x^-4 + x^-11 + x^-16)`, whose first terms are `1 + x^-4 + x^-8 + x^-11 + x^-12` (the next is beyond 16 bits).
#[inline(always)]
fn crc(before: u32, bits: u32) -> u32 {
    let t = before ^ bits;
    let q = t ^ t >> 4 ^ t >> 8 ^ t >> 11 ^ t >> 12;
    (q ^ q << 5 ^ q << 12) & 0xFFFF
}

/// The codes of the channels in use.
///
/// # Errors
/// See [`Fault`].
#[inline(never)]
pub fn decode(frame: &[u32; WORDS]) -> Result<[i32; CHANNELS], Fault> {
    // Big-endian: byte 0 of the frame is the highest of the first word.
    let [a, b, c, d, e, _, g, h] = frame;
    let (a, b, c, d) = (a.swap_bytes(), b.swap_bytes(), c.swap_bytes(), d.swap_bytes());
    let (e, g, h) = (e.swap_bytes(), g.swap_bytes(), h.swap_bytes());
    // CCITT, seed 0xFFFF, over the bytes before it: thirteen times 16 bits, and the byte at 26 with the CRC behind it. A CRC
    // that is taken in after what it is of leaves nothing.
    let mut sum = 0xFFFF;
    for word in frame.iter().take(6) {
        let word = word.swap_bytes();
        sum = crc(crc(sum, word >> 16), word & 0xFFFF);
    }
    let sum = crc(crc(crc(sum, g >> 16), g & 0xFFFF), h >> 16 & 0xFF00);
    if sum != 0 {
        return Err(Fault::Crc);
    }
    if (a >> 16) as u16 & STATUS_RESET != 0 {
        return Err(Fault::Reset);
    }
    // Each channel is a word of 24 bits, from byte 3 on; sign-extended.
    let signed = |word: u32| word as i32 >> 8;
    Ok([signed(a << 24 | b >> 8), signed(b << 16 | c >> 16), signed(c << 8), signed(d), signed(d << 24 | e >> 8)])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Where the CRC stands in a frame.
    const CRC_AT: usize = 27;
    const CRC: crc::Crc<u16> = crc::Crc::<u16>::new(&crc::CRC_16_IBM_3740);

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
    fn the_checksum_is_that_of_the_standard() {
        for t in 0..=u32::from(u16::MAX) {
            let bytes = (t as u16).to_be_bytes();
            assert_eq!(crc(0xFFFF, t), u32::from(CRC.checksum(&bytes)), "{t:04x}");
        }
        let mut x = 1u32;
        for _ in 0..2000 {
            let codes = core::array::from_fn(|_| {
                x = x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                x as i32 >> 8
            });
            let seen = decode(&words(&frame(0x0500 & !STATUS_RESET, codes))).expect("valid");
            assert_eq!(seen, codes[..CHANNELS]);
        }
    }
}
