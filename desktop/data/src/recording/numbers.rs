//! Plain decimal numbers, many at once. They are fast because no step of the work waits for a number to end before the next begins, and a
//! compiler can do each step for several numbers side by side.

/// Numbers that are read at once.
pub(super) const BATCH: usize = 64;

/// Most bytes of a text whose numbers are read so: a place in it has 31 bits.
pub(super) const MOST_BYTES: usize = (1 << 31) - 1;

/// Powers of ten that an f64 holds exactly.
const EXACT: [f64; 16] = [1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15];

/// One in each byte of a word, and the high bit of each.
const ONES: u64 = 0x0101_0101_0101_0101;
const HIGH: u64 = 0x80 * ONES;

/// Bytes whose commas and line ends are found at once.
pub(super) const LOOK: usize = 4096;

/// Most ends among eight words of a usual text: these are taken without a look at how many there are.
const USUAL: usize = 8;

/// Finds where cells end.
pub(super) struct Ends {
    marks: [u8; LOOK / 8],
    places: [u16; LOOK + 64],
}

impl Ends {
    pub fn new() -> Self {
        Self { marks: [0; LOOK / 8], places: [0; LOOK + 64] }
    }

    /// Places in at most [`LOOK`] bytes of what stands before `-` in ASCII: commas and line ends, and what is in no plain number (blanks,
    /// quotes, `#`, `+`).
    pub fn of(&mut self, bytes: &[u8]) -> &[u16] {
        let (words, rest) = bytes.as_chunks();
        mark(words, &mut self.marks);
        let mut last = [b'.'; 8];
        last[..rest.len()].copy_from_slice(rest);
        self.marks[words.len()..].fill(0);
        if !rest.is_empty() {
            mark(&[last], &mut self.marks[words.len()..]);
        }
        let mut n = 0;
        for (k, marks) in self.marks.as_chunks().0.iter().enumerate() {
            let mut marks = u64::from_le_bytes(*marks);
            let count = marks.count_ones() as usize;
            // (Places written beyond the count are overwritten.)
            let mut take = |places: &mut [u16]| {
                for place in places {
                    *place = (64 * k) as u16 + marks.trailing_zeros() as u16;
                    marks &= marks.wrapping_sub(1);
                }
            };
            take(&mut self.places[n..n + USUAL]);
            if count > USUAL {
                take(&mut self.places[n + USUAL..n + count]);
            }
            n += count;
        }
        &self.places[..n]
    }
}

/// A bit for each byte, lowest first, that stands before `-`. Eight bytes make a byte of bits.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2"))]
fn mark(words: &[[u8; 8]], marks: &mut [u8]) {
    for (eight, mark) in words.iter().zip(marks) {
        let word = u64::from_le_bytes(*eight);
        // (No byte borrows from the next: each has its high bit set.)
        let low = !((word | HIGH) - 0x2D * ONES) & !word & HIGH;
        // The eight high bits side by side.
        *mark = ((low >> 7).wrapping_mul(0x0102_0408_1020_4080) >> 56) as u8;
    }
}

/// Cells of a column.
pub(super) struct Cells {
    /// The eight bytes before the end of each, and the eight before these.
    last: [u64; BATCH],
    first: [u64; BATCH],
    /// From the highest bit on: whether it begins with `-`, where it begins behind that (31 bits), where it ends (32 bits).
    place: [u64; BATCH],
    plain: [bool; BATCH],
}

impl Cells {
    pub fn new() -> Self {
        Self { last: [0; BATCH], first: [0; BATCH], place: [0; BATCH], plain: [false; BATCH] }
    }

    /// Takes the cell from one place of a text to another as number `k` (modulo [`BATCH`]).
    #[inline]
    pub fn put(&mut self, k: usize, text: &[u8], from: usize, to: usize) {
        let k = k % BATCH;
        let negative = u64::from(text[from] == b'-');
        // (A cell close to the text's beginning has a place, but no digits: it is not plain.)
        let words = to.checked_sub(16).and_then(|at| text[at..to].as_chunks().0.first_chunk()).unwrap_or(&[[0; 8]; 2]);
        self.first[k] = u64::from_le_bytes(words[0]);
        self.last[k] = u64::from_le_bytes(words[1]);
        self.place[k] = negative << 63 | (from as u64 + negative) << 32 | to as u64;
    }

    /// Range of the bytes of cell `k`.
    pub fn place(&self, k: usize) -> std::ops::Range<usize> {
        let place = self.place[k];
        ((place >> 32 & MOST_BYTES as u64) - (place >> 63)) as usize..(place & 0xFFFF_FFFF) as usize
    }

    /// Reads the first cells, one for each value of `to`: numbers of at most 15 digits, with or without sign and point. Such a number is a
    /// quotient of two that an f64 holds exactly, so that one division gives the same as the standard library's parser. `true` if all of
    /// them are such numbers; [`Self::is_plain`] tells which are.
    pub fn read(&mut self, to: &mut [f64]) -> bool {
        read(&self.first, &self.last, &self.place, &mut self.plain, to)
    }

    /// `true` if the last [`Self::read`] has read cell `k`.
    pub fn is_plain(&self, k: usize) -> bool {
        self.plain[k]
    }
}

#[multiversion::multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2"))]
fn read(first: &[u64], last: &[u64], place: &[u64], plain: &mut [bool], to: &mut [f64]) -> bool {
    let mut all = true;
    for ((((first, last), place), plain), to) in first.iter().zip(last).zip(place).zip(plain).zip(to) {
        let length = (place & 0xFFFF_FFFF) - (place >> 32 & MOST_BYTES as u64);
        let (value, ok) = number(*first, *last, length);
        *to = f64::from_bits(value.to_bits() | place & 1 << 63);
        *plain = ok;
        all &= ok;
    }
    all
}

/// The number without sign in the last `length` of sixteen bytes, and whether it is plain. No branches: several of them side by side.
#[inline(always)]
fn number(first: u64, last: u64, length: u64) -> (f64, bool) {
    // The high bytes of a word, so many; all where there are more.
    let top = |n: u64| if n >= 8 { u64::MAX } else { !(u64::MAX >> ((8 * n) & 63)) };
    // Digits are 0 to 9 now, and what stands before the number is 0.
    let last = (last ^ (0x30 * ONES)) & top(length);
    let first = (first ^ (0x30 * ONES)) & top(length.saturating_sub(8));
    // The high bit of each byte that is no digit: above 9, or above 127. (No byte carries into the next: their high bits are left out.)
    let others = |x: u64| (((x & !HIGH) + 0x76 * ONES) | x) & HIGH;
    let (others_last, others_first) = (others(last), others(first));
    // The lowest bit of the first of these bytes; 0 where there is none. It must be a point, and the only one.
    let point = |others: u64| (others & others.wrapping_neg()) >> 7;
    let (in_last, in_first) = (point(others_last), point(others_first));
    let byte = |point: u64| (point << 8).wrapping_sub(point);
    let is_point = |x: u64, point: u64| x & byte(point) == (point << 5).wrapping_sub(point << 1);
    let one = others_last == in_last << 7 && others_first == in_first << 7 && (in_last == 0 || in_first == 0);
    let plain = one && is_point(last, in_last) && is_point(first, in_first);
    let digits = length.wrapping_sub(u64::from(in_last | in_first != 0));
    // Move the digits before the point into its place.
    let behind = |point: u64| !(point << 8).wrapping_sub(1);
    let close = |x: u64, point: u64| x & behind(point) | (x & point.wrapping_sub(1)) << 8;
    let low = if in_last != 0 { close(last, in_last) | first >> 56 } else { last };
    let high = if in_last != 0 { first << 8 } else { close(first, in_first) };
    let high = if in_last | in_first != 0 { high } else { first };
    let behind_last = behind(in_last).count_ones();
    let fraction = if in_last != 0 { behind_last } else { 64 + behind(in_first).count_ones() } / 8;
    let fraction = if in_last | in_first != 0 { fraction & 15 } else { 0 };
    let mantissa = eight_digits(high) * 100_000_000 + eight_digits(low);
    (mantissa as i64 as f64 / EXACT[fraction as usize], plain && digits.wrapping_sub(1) < 15 && length <= 16)
}

/// The number that eight digits make, the first of them in the lowest byte: of pairs, of fours, of eight. Shifts and sums take vector units
/// a fraction of the time of products of 64 bits.
#[inline(always)]
fn eight_digits(x: u64) -> u64 {
    let pairs = ((x << 3) + (x << 1) + (x >> 8)) & 0x00FF_00FF_00FF_00FF;
    let fours = ((pairs << 6) + (pairs << 5) + (pairs << 2) + (pairs >> 16)) & 0x0000_FFFF_0000_FFFF;
    (fours & 0xFFFF) * 10_000 + (fours >> 32)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values read from cells, each with something before it.
    fn read(cells: &[String]) -> Vec<Option<f64>> {
        let mut out = Vec::new();
        for some in cells.chunks(BATCH) {
            let mut column = Cells::new();
            let mut text = b"0123456789abcdef".to_vec();
            for (k, cell) in some.iter().enumerate() {
                let from = text.len();
                text.extend_from_slice(cell.as_bytes());
                let to = text.len();
                text.push(b',');
                column.put(k, &text, from, to);
                assert_eq!(column.place(k), from..to, "{cell}");
            }
            let mut values = vec![0.0; some.len()];
            let all = column.read(&mut values);
            let found: Vec<_> = values.into_iter().enumerate().map(|(k, v)| column.is_plain(k).then_some(v)).collect();
            assert_eq!(all, found.iter().all(Option::is_some));
            out.extend(found);
        }
        out
    }

    #[test]
    fn plain_numbers_are_what_the_standard_library_reads() {
        let mut draws = crate::numeric::draws::Draws::new(1);
        let cells: Vec<String> = (0..400_000u32)
            .map(|k| {
                let x = draws.bits();
                let value = (x >> 12) as f64 / EXACT[(x % 16) as usize] * if k % 2 == 0 { -1e-4 } else { 1e-4 };
                format!("{value:.*}", (x % 13) as usize)
            })
            .collect();
        for (cell, found) in cells.iter().zip(read(&cells)) {
            let wanted: f64 = cell.parse().expect("a number");
            match found {
                Some(v) => assert_eq!(v.to_bits(), wanted.to_bits(), "{cell}"),
                None => assert!(cell.trim_start_matches('-').len() > 15, "{cell}"),
            }
        }
    }

    #[test]
    fn each_place_of_the_point_is_read() {
        let digits = "123456789012345";
        let mut cells = Vec::new();
        for n in 1..=15 {
            cells.push(digits[..n].to_string());
            cells.push(format!("-{}", &digits[..n]));
            for at in 0..=n {
                cells.push(format!("{}.{}", &digits[..at], &digits[at..n]));
                cells.push(format!("-{}.{}", &digits[..at], &digits[at..n]));
            }
        }
        cells.extend(["0", "-0", "0.0", "-0.0", "000000000000000", "00000000000.001"].map(String::from));
        for (cell, found) in cells.iter().zip(read(&cells)) {
            assert_eq!(found.map(f64::to_bits), cell.parse().ok().map(f64::to_bits), "{cell}");
        }
    }

    #[test]
    fn what_is_not_plain_is_left_to_others() {
        let odd = [
            "",
            "-",
            ".",
            "-.",
            "1e5",
            "+1",
            "0x1",
            "inf",
            "1.2.3",
            "1..2",
            " 1",
            "1 ",
            "--1",
            "1-",
            "1_0",
            "1\r",
            "1\u{b0}",
            "..",
            "1/2",
            "1:2",
            "1234567890123456",
            "-1234567890123456",
            "1.234567890123456",
            "12345678.12345678",
            "12345678901234567890",
        ];
        let cells = odd.map(String::from);
        for (cell, found) in cells.iter().zip(read(&cells)) {
            assert_eq!(found, None, "{cell:?}");
        }
    }

    #[test]
    fn ends_are_found() {
        let mut draws = crate::numeric::draws::Draws::new(2);
        let mut ends = Ends::new();
        for n in (0..200).chain([LOOK - 9, LOOK - 1, LOOK]) {
            for some in [1, 3, 40, 256] {
                let bytes: Vec<u8> =
                    (0..n).map(|_| if draws.bits().is_multiple_of(some) { draws.bits() as u8 } else { b'5' }).collect();
                let wanted: Vec<u16> = (0..n).filter(|k| bytes[*k] < b'-').map(|k| k as u16).collect();
                assert_eq!(ends.of(&bytes), wanted);
            }
            assert_eq!(ends.of(&vec![b','; n]).len(), n);
        }
    }
}
