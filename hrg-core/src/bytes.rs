//! Little-endian writing and reading of fixed buffers, shared by the calibration image and the link.
//!
//! # Example
//! ```
//! use hrg_core::bytes::{crc32, Reader, Writer};
//!
//! let mut buffer = [0; 6];
//! let mut w = Writer::new(&mut buffer);
//! w.u16(7);
//! w.f32(1.5);
//! assert_eq!(w.finish(), Some(6));
//! let mut r = Reader::new(&buffer);
//! assert_eq!((r.u16(), r.f32(), r.u8()), (Some(7), Some(1.5), None));
//! assert_eq!(crc32(b"123456789"), 0xCBF4_3926);
//! ```

/// That of zip and Ethernet.
static CRC_32: crc::Crc<u32> = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);

/// CRC-32 (ISO-HDLC) of images and of the link's frames.
#[inline]
#[must_use]
pub fn crc32(bytes: &[u8]) -> u32 {
    CRC_32.checksum(bytes)
}

/// [`crc32`] of pieces, one after the other.
pub struct Digest(crc::Digest<'static, u32>);

impl Default for Digest {
    /// Of nothing yet.
    fn default() -> Self {
        Self(CRC_32.digest())
    }
}

impl Digest {
    /// Adds a piece.
    pub fn update(&mut self, piece: &[u8]) {
        self.0.update(piece);
    }
    /// The checksum.
    #[must_use]
    pub fn finish(self) -> u32 {
        self.0.finalize()
    }
}

/// [`crc32`] of words.
pub fn crc32_of(words: impl Iterator<Item = [u8; 4]>) -> u32 {
    let mut digest = Digest::default();
    words.for_each(|word| digest.update(&word));
    digest.finish()
}

/// Appends numbers to a byte slice; remembers when it did not fit.
#[derive(Debug)]
pub struct Writer<'a> {
    buffer: &'a mut [u8],
    at: usize,
    overflow: bool,
}

impl<'a> Writer<'a> {
    /// Starts at the front of `buffer`.
    #[inline]
    pub fn new(buffer: &'a mut [u8]) -> Self {
        Self { buffer, at: 0, overflow: false }
    }
    /// Appends raw bytes.
    #[inline]
    pub fn bytes(&mut self, bytes: &[u8]) {
        match self.buffer.get_mut(self.at..self.at + bytes.len()) {
            Some(room) => {
                room.copy_from_slice(bytes);
                self.at += bytes.len();
            }
            None => self.overflow = true,
        }
    }
    /// Appends one byte.
    #[inline]
    pub fn u8(&mut self, value: u8) {
        self.bytes(&[value]);
    }
    /// Appends a 16-bit number.
    #[inline]
    pub fn u16(&mut self, value: u16) {
        self.bytes(&value.to_le_bytes());
    }
    /// Appends a 32-bit number.
    #[inline]
    pub fn u32(&mut self, value: u32) {
        self.bytes(&value.to_le_bytes());
    }
    /// Appends a single.
    #[inline]
    pub fn f32(&mut self, value: f32) {
        self.bytes(&value.to_le_bytes());
    }
    /// Appends singles.
    pub fn f32s(&mut self, values: &[f32]) {
        for &v in values {
            self.f32(v);
        }
    }
    /// Appends a double.
    pub fn f64(&mut self, value: f64) {
        self.bytes(&value.to_le_bytes());
    }
    /// Bytes written, or `None` if something did not fit.
    #[must_use]
    #[inline]
    pub fn finish(self) -> Option<usize> {
        (!self.overflow).then_some(self.at)
    }
}

/// Takes numbers off the front of a byte slice; `None` at its end.
#[derive(Debug, Clone)]
pub struct Reader<'a> {
    rest: &'a [u8],
}

impl<'a> Reader<'a> {
    /// Starts at the front of `bytes`.
    #[must_use]
    pub fn new(bytes: &'a [u8]) -> Self {
        Self { rest: bytes }
    }
    /// Bytes not yet read.
    #[must_use]
    pub fn remaining(&self) -> usize {
        self.rest.len()
    }
    /// Takes `N` raw bytes.
    pub fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (head, rest) = self.rest.split_first_chunk::<N>()?;
        self.rest = rest;
        Some(*head)
    }
    /// Takes one byte.
    pub fn u8(&mut self) -> Option<u8> {
        self.array::<1>().map(|b| b[0])
    }
    /// Takes a 16-bit number.
    pub fn u16(&mut self) -> Option<u16> {
        self.array().map(u16::from_le_bytes)
    }
    /// Takes a 32-bit number.
    pub fn u32(&mut self) -> Option<u32> {
        self.array().map(u32::from_le_bytes)
    }
    /// Takes a single.
    pub fn f32(&mut self) -> Option<f32> {
        self.u32().map(f32::from_bits)
    }
    /// Takes `N` singles.
    #[inline]
    pub fn f32s<const N: usize>(&mut self) -> Option<[f32; N]> {
        let mut out = [0.0; N];
        self.fill(&mut out)?;
        Some(out)
    }
    /// Takes as many singles as there is room for.
    pub fn fill(&mut self, out: &mut [f32]) -> Option<()> {
        for v in out {
            *v = self.f32()?;
        }
        Some(())
    }
    /// Takes a double.
    pub fn f64(&mut self) -> Option<f64> {
        self.array().map(f64::from_le_bytes)
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn crc32_is_that_of_the_standard() {
        // The check value of the catalogue of CRCs.
        assert_eq!(super::crc32(b"123456789"), 0xCBF4_3926);
    }
}
