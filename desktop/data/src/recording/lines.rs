//! A text in pieces of whole lines, from wherever it comes.

use crate::error::BadInput;
use crate::files::no_zero;
use std::io::Read;

/// Most bytes of a piece.
const MOST_BYTES: usize = (1 << 31) - 1;

/// Remaining lines of a text.
pub(super) struct Lines<R> {
    from: R,
    /// Read, and not given.
    held: Vec<u8>,
    /// Bytes of a piece, about; and of the whole, as far as is known.
    piece: usize,
    size: u64,
    /// Bytes read so far.
    read: usize,
    ended: bool,
}

impl<R: Read> Lines<R> {
    pub fn new(from: R, size: u64, piece: usize) -> Self {
        Self { from, held: Vec::new(), piece: piece.clamp(1, MOST_BYTES / 4), size, read: 0, ended: false }
    }

    /// Upper limit of the number of pieces.
    pub fn pieces(&self) -> usize {
        usize::try_from(self.size / self.piece as u64).unwrap_or(usize::MAX).saturating_add(1)
    }

    /// The next piece, in the place of what `text` holds; whether there was one. It ends with a line feed, but for the last.
    ///
    /// # Errors
    /// If reading fails, or the bytes are no text: a sentence without the file's name.
    pub fn next(&mut self, text: &mut Vec<u8>) -> Result<bool, BadInput> {
        text.clear();
        text.append(&mut self.held);
        loop {
            let start = text.len();
            if !self.ended && start < self.piece {
                let wanted = self.piece - start;
                let n = self.from.by_ref().take(wanted as u64).read_to_end(text);
                let n = n.map_err(|e| BadInput(format!("cannot be read any further: {e}")))?;
                self.ended = n < wanted;
                no_zero(&text[start..], self.read)?;
                self.read += n;
            }
            if self.ended && text.len() <= self.piece {
                return Ok(!text.is_empty());
            }
            if let Some(at) = memchr::memrchr(b'\n', &text[..self.piece.min(text.len())]) {
                self.held.extend_from_slice(&text[at + 1..]);
                text.truncate(at + 1);
                return Ok(true);
            }
            // A line that is longer than a piece.
            self.piece *= 2;
            if self.piece > MOST_BYTES {
                return Err(BadInput(format!("there is a line of more than {} bytes; check the file", text.len())));
            }
        }
    }

    /// Takes back the end of a piece.
    pub fn give_back(&mut self, text: &[u8]) {
        self.held.splice(..0, text.iter().copied());
    }
}

/// Number of lines of a text. (The last one need not end with a line feed.)
pub(super) fn count(text: &[u8]) -> usize {
    let ended = text.is_empty() || text.ends_with(b"\n");
    memchr::memchr_iter(b'\n', text).count() + usize::from(!ended)
}

/// A line that is no text.
pub(super) fn not_text(line: usize) -> BadInput {
    BadInput(format!("line {line} is not UTF-8 text; save the file as CSV in UTF-8"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_are_whole_lines_and_make_the_text_again() {
        for text in ["", "a", "a\n", "ab\ncd\n\nefghij\nk", "\n\n\n", "abcdefghijklmnop\nq\n"] {
            for piece in 1..20 {
                let mut lines = Lines::new(text.as_bytes(), text.len() as u64, piece);
                let (mut all, mut one) = (Vec::new(), Vec::new());
                while lines.next(&mut one).expect("reads") {
                    assert!(!one.is_empty());
                    all.extend_from_slice(&one);
                    assert!(one.ends_with(b"\n") || all.len() == text.len(), "{text:?} by {piece}: {one:?}");
                }
                assert_eq!(all, text.as_bytes());
            }
        }
    }

    #[test]
    fn lines_are_counted_as_the_standard_library_does() {
        for text in ["", "a", "a\n", "a\nb", "\n", "\n\n", "\na"] {
            assert_eq!(count(text.as_bytes()), text.split_inclusive('\n').count(), "{text:?}");
        }
    }

    #[test]
    fn what_is_given_back_comes_first() {
        let mut lines = Lines::new(&b"ab\ncd\nef\n"[..], 9, 4);
        let mut one = Vec::new();
        assert!(lines.next(&mut one).expect("reads"));
        lines.give_back(&one[1..]);
        let mut all = Vec::new();
        while lines.next(&mut one).expect("reads") {
            all.extend_from_slice(&one);
        }
        assert_eq!(all, b"b\ncd\nef\n");
    }

    #[test]
    fn zero_bytes_are_refused_with_their_place() {
        let mut lines = Lines::new(&b"ab\ncd\n\0"[..], 7, 4);
        let mut one = Vec::new();
        assert!(lines.next(&mut one).expect("reads"));
        let e = lines.next(&mut one).expect_err("no text");
        assert!(e.0.starts_with("byte 7 is zero"), "{e}");
    }
}
