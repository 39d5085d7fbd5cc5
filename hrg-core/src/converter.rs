//! A frame of the ADS131M08 converter: ten 24-bit words, big-endian; status, eight channels, CRC (data sheet SBAS950 8.5).

use crate::rate_path::CHANNELS;

/// Bytes of a frame.
pub const FRAME: usize = 30;
/// Where the CRC stands in it.
const CRC_AT: usize = 27;
/// Status bit: the converter has been reset and has lost its settings.
const STATUS_RESET: u16 = 1 << 10;
/// CCITT, seed 0xFFFF.
const CRC: crc::Crc<u16> = crc::Crc::<u16>::new(&crc::CRC_16_IBM_3740);

/// Why a frame gives no sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Fault {
    /// Its checksum does not match.
    Crc,
    /// The converter says that it was reset: its settings must be written again.
    Reset,
}

/// The codes of the channels in use.
///
/// # Errors
/// See [`Fault`].
#[inline(never)]
pub fn decode(frame: &[u8; FRAME]) -> Result<[i32; CHANNELS], Fault> {
    if CRC.checksum(&frame[..CRC_AT]).to_be_bytes() != frame[CRC_AT..CRC_AT + 2] {
        return Err(Fault::Crc);
    }
    if u16::from_be_bytes([frame[0], frame[1]]) & STATUS_RESET != 0 {
        return Err(Fault::Reset);
    }
    // Each channel is a word of 24 bits; sign-extended.
    Ok(core::array::from_fn(|k| {
        let at = 3 * (k + 1);
        i32::from_be_bytes([frame[at], frame[at + 1], frame[at + 2], 0]) >> 8
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

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
        assert_eq!(decode(&f), Ok([1, -1, 8_388_607, -8_388_608, 42]));
        assert_eq!(decode(&frame(0x0500, [0; 8])), Err(Fault::Reset));
        for bit in 0..29 * 8 {
            let mut g = f;
            g[bit / 8] ^= 1 << (bit % 8);
            assert_eq!(decode(&g), Err(Fault::Crc), "bit {bit}");
        }
    }
}
