//! Input files: how much of one is read, and what is refused before it is.

use crate::error::BadInput;

/// Most bytes of a recording: 30 days at 100 Hz with every column.
pub const MOST_RECORDING: u64 = 64 << 30;
/// Most bytes of a calibration file: twenty times what the largest has.
pub const MOST_CALIBRATION: u64 = 1 << 20;
/// Most bytes of a firmware ELF: with all debug information it has some ten million.
pub const MOST_ELF: u64 = 1 << 30;

/// First bytes of a gzip file.
pub(crate) const GZIP: [u8; 2] = [0x1f, 0x8b];

/// `true` if a regular file begins with these bytes; `false` for one that cannot be read, and for a pipe: what is read of it is gone.
pub(crate) fn begins_with<const N: usize>(path: &std::path::Path, head: [u8; N]) -> bool {
    use std::io::Read;
    if !std::fs::metadata(path).is_ok_and(|m| m.is_file()) {
        return false;
    }
    let mut first = [0; N];
    let read = std::fs::File::open(path).and_then(|mut f| f.read_exact(&mut first));
    read.is_ok() && first == head
}

/// The content of a file of at most so many bytes, unpacked where gzip has packed it.
///
/// # Errors
/// A sentence with the path.
pub fn text(path: &std::path::Path, most: u64) -> Result<Box<dyn std::io::Read>, BadInput> {
    use std::io::BufRead;
    let cannot = |e: std::io::Error| BadInput::new(format!("cannot read {}: {e}; check the path", path.display()));
    let file = std::fs::File::open(path).map_err(cannot)?;
    let size = file.metadata().map_err(cannot)?.len();
    if size > most {
        return Err(BadInput::new(format!(
            "{} has {size} bytes, more than the {most} that such a file may have; check that it is the right one",
            path.display()
        )));
    }
    let mut file = std::io::BufReader::with_capacity(1 << 18, file);
    let packed = file.fill_buf().map_err(cannot)?.starts_with(&GZIP);
    Ok(if packed { Box::new(flate2::bufread::MultiGzDecoder::new(file)) } else { Box::new(file) })
}

/// Reads a whole file of at most so many bytes; one that gzip has packed is unpacked. A file that is larger is refused before it is read; one of text is refused at
/// its first zero byte, however large it is.
///
/// # Errors
/// A sentence with the path.
pub fn read_file(path: &std::path::Path, most: u64, text: bool) -> Result<Vec<u8>, BadInput> {
    use std::io::Read;
    let cannot = |e: std::io::Error| BadInput::new(format!("cannot read {}: {e}; check the path", path.display()));
    let mut content = self::text(path, most)?;
    let mut bytes = Vec::with_capacity(std::fs::metadata(path).map_err(cannot)?.len().min(most) as usize);
    loop {
        let start = bytes.len();
        let n = content.by_ref().take(1 << 20).read_to_end(&mut bytes).map_err(cannot)?;
        if n == 0 {
            return Ok(bytes);
        }
        if bytes.len() as u64 > most {
            return Err(BadInput::new(format!(
                "{} unpacks to more than the {most} bytes that such a file may have; check that it is the right one",
                path.display()
            )));
        }
        if text {
            no_zero(&bytes[start..], start).map_err(|e| BadInput::new(format!("{}: {e}", path.display())))?;
        }
    }
}

/// Zero bytes are of a binary file, or of UTF-16. `before`: how many bytes were read before these.
pub(crate) fn no_zero(bytes: &[u8], before: usize) -> Result<(), BadInput> {
    match memchr::memchr(0, bytes) {
        Some(at) => Err(BadInput(format!(
            "byte {} is zero: this is a binary file, or text in UTF-16; save it as text in UTF-8",
            before + at + 1
        ))),
        None => Ok(()),
    }
}
