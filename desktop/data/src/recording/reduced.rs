//! Recordings of hundreds of millions of values: read part by part, each part brought to means of [`MEAN_S`] before the next one is read. What fits,
//! traces and judgements use are means of a second and more; what is lost is noise faster than these means.

use super::{parquet, step_of, Recording};
use crate::error::BadInput;
use crate::files::{no_zero, GZIP};
use crate::numeric::side_by_side;
use crate::numeric::stats::median;
use std::io::{BufRead, Read};
use std::path::Path;

/// Duration of a mean, s.
pub const MEAN_S: f64 = 0.1;

/// Bytes of text from which on a recording is reduced, unless its rows are further apart than half a mean.
const MOST_WHOLE: u64 = 384 << 20;

/// The same in cells of a table, of which each makes some eight bytes of text.
const MOST_CELLS: u64 = MOST_WHOLE / 8;

/// Bytes of text of a part.
const PART: usize = 64 << 20;

/// Deviations (by the median of the distances from the median) beyond which a sample is a spike, and not in its mean.
const SPIKE: f64 = 10.0;

/// Least samples of a mean among which spikes are looked for.
const LEAST: usize = 8;

impl Recording {
    /// Reads a file of text that is too large to be in memory as it is. `None` where it is not that large, and for whatever
    /// else [`Recording::read`] is for.
    pub(super) fn read_reduced(path: &Path) -> Option<Result<Self, BadInput>> {
        let size = std::fs::metadata(path).ok().filter(std::fs::Metadata::is_file)?.len();
        // (Text of numbers is packed to a third at the most, and to a thousandth where it repeats.)
        if size < MOST_WHOLE / 1000 {
            return None;
        }
        if parquet::begins_as_parquet(path) {
            let text = parquet::Text::of_large(path, MOST_CELLS)?;
            return Some(text.and_then(|text| Self::in_parts(text, PART)));
        }
        let mut file = std::io::BufReader::with_capacity(1 << 20, std::fs::File::open(path).ok()?);
        let begin = file.fill_buf().ok()?;
        if begin.starts_with(&GZIP) {
            let mut text = flate2::bufread::MultiGzDecoder::new(file);
            let mut begin = Vec::new();
            text.by_ref().take(MOST_WHOLE).read_to_end(&mut begin).ok()?;
            if (begin.len() as u64) < MOST_WHOLE {
                return Some(no_zero(&begin, 0).and_then(|()| Self::parse(&begin)));
            }
            return Some(Self::in_parts(std::io::Cursor::new(begin).chain(text), PART));
        }
        // (A file of zeros or another binary one is refused by who reads the others.)
        (size >= MOST_WHOLE && !begin.contains(&0)).then(|| Self::in_parts(file, PART))
    }

    /// Reads parts of so many bytes, and joins what they are reduced to.
    fn in_parts(text: impl Read, part: usize) -> Result<Self, BadInput> {
        let (mut parts, mut reduced) = (Parts::new(text, part), Reduced::default());
        while let Some((_, r)) = parts.next_part()? {
            reduced.add(r);
        }
        reduced.recording()
    }

    /// `true` for a file of text, packed or not, or of Parquet that is too large to be in memory as it is.
    #[must_use]
    pub fn is_large(path: &Path) -> bool {
        let size = std::fs::metadata(path).ok().filter(std::fs::Metadata::is_file).map_or(0, |m| m.len());
        if size < MOST_WHOLE / 1000 {
            return false;
        }
        if parquet::begins_as_parquet(path) {
            return parquet::Text::of_large(path, MOST_CELLS).is_some();
        }
        let longer = |text: Box<dyn Read>| std::io::copy(&mut text.take(MOST_WHOLE), &mut std::io::sink()).ok();
        size >= MOST_WHOLE
            || crate::files::text(path, crate::files::MOST_RECORDING).ok().and_then(longer) == Some(MOST_WHOLE)
    }

    /// Means over [`MEAN_S`], and how many samples of rates are in none, as spikes. Rows that are further apart than half of it stay.
    fn reduced(self) -> (Self, usize) {
        let step = step_of(&self.time_s);
        if !(step < 0.5 * MEAN_S) {
            return (self, 0);
        }
        let mut ends = Vec::new();
        for (k, w) in self.time_s.windows(2).enumerate() {
            if bin(w[0]) != bin(w[1]) {
                ends.push(k + 1);
            }
        }
        ends.push(self.time_s.len());
        let mean = |column: &Vec<f64>| -> Vec<f64> { groups(&ends).map(|g| mean_of(&column[g])).collect() };
        let robust = |column: &Vec<f64>| -> Vec<(f64, usize)> {
            let mut buffer = Vec::new();
            groups(&ends).map(|g| without_spikes(&column[g], &mut buffer)).collect()
        };
        let plain = [&self.time_s].into_iter().chain(&self.frequency_hz).chain(self.optional.iter().map(|(_, v)| v));
        let mut plain = side_by_side::each(plain.collect(), mean).into_iter();
        let rates = side_by_side::each(self.rate_dph.iter().collect(), robust);
        let mut next = || plain.next().unwrap_or_default();
        let (time_s, frequency_hz) = (next(), std::array::from_fn(|_| next()));
        let optional = self.optional.iter().map(|(name, _)| (*name, next())).collect();
        // (The status of a mean is all that its rows were flagged with.)
        let status = if self.status.is_empty() {
            Vec::new()
        } else {
            let all = |g: std::ops::Range<usize>| {
                self.status[g].iter().fold([0u16; 4], |s, row| std::array::from_fn(|k| s[k] | row[k]))
            };
            groups(&ends).map(all).collect()
        };
        let spikes = rates.iter().flatten().map(|(_, n)| n).sum();
        let mut rates = rates.into_iter().map(|v| v.into_iter().map(|(mean, _)| mean).collect());
        let rate_dph = std::array::from_fn(|_| rates.next().unwrap_or_default());
        (Self { time_s, frequency_hz, rate_dph, optional, status, ..self }, spikes)
    }

    /// Takes the rows from a place on out of it.
    fn rows_from(&mut self, from: usize) -> Self {
        let of = |v: &mut Vec<f64>| v.split_off(from.min(v.len()));
        Self {
            time_s: of(&mut self.time_s),
            frequency_hz: self.frequency_hz.each_mut().map(of),
            rate_dph: self.rate_dph.each_mut().map(of),
            optional: self.optional.iter_mut().map(|(name, v)| (*name, of(v))).collect(),
            status: self.status.split_off(from.min(self.status.len())),
            ..Self::default()
        }
    }

    /// Exchanges the rows with those of another part.
    fn exchange_rows(&mut self, other: &mut Self) {
        use std::mem::swap;
        swap(&mut self.time_s, &mut other.time_s);
        swap(&mut self.frequency_hz, &mut other.frequency_hz);
        swap(&mut self.rate_dph, &mut other.rate_dph);
        swap(&mut self.optional, &mut other.optional);
        swap(&mut self.status, &mut other.status);
    }

    /// Adds the rows of a part that follows.
    pub(super) fn append(&mut self, other: Self) {
        self.time_s.extend(other.time_s);
        self.frequency_hz.iter_mut().zip(other.frequency_hz).for_each(|(a, b)| a.extend(b));
        self.rate_dph.iter_mut().zip(other.rate_dph).for_each(|(a, b)| a.extend(b));
        self.optional.iter_mut().zip(other.optional).for_each(|((_, a), (_, b))| a.extend(b));
        self.status.extend(other.status);
    }
}

/// A recording as text, read part by part.
pub struct Parts<R> {
    text: R,
    /// Bytes of a part, about.
    part: usize,
    /// The lines up to the names of the columns.
    head: Vec<u8>,
    /// Read, and not given.
    rest: Vec<u8>,
    /// Rows and lines so far.
    rows: usize,
    lines: usize,
    ended: bool,
}

impl Parts<Box<dyn Read>> {
    /// Of a file: text, packed or not, or Parquet.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub fn open(path: &Path) -> Result<Self, BadInput> {
        let text: Box<dyn Read> = if parquet::begins_as_parquet(path) {
            Box::new(parquet::Text::open(path)?)
        } else {
            crate::files::text(path, crate::files::MOST_RECORDING)?
        };
        Ok(Self::new(text, PART))
    }
}

impl<R: Read> Parts<R> {
    /// Of a text.
    fn new(text: R, part: usize) -> Self {
        Self { text, part, head: Vec::new(), rest: Vec::new(), rows: 0, lines: 0, ended: false }
    }

    /// The next part: its text, the first with the names of the columns and what is before them, and its rows. `None` behind the last.
    ///
    /// # Errors
    /// As [`Recording::parse`].
    pub fn next_part(&mut self) -> Result<Option<(Vec<u8>, Recording)>, BadInput> {
        let cannot = |e: std::io::Error| BadInput(format!("it cannot be read: {e}"));
        while !self.ended {
            let from = self.rest.len();
            let n = self.text.by_ref().take(self.part as u64).read_to_end(&mut self.rest).map_err(cannot)?;
            self.ended = n == 0;
            let all = self.rest.len();
            let end = if self.ended { all } else { memchr::memrchr(b'\n', &self.rest).map_or(0, |at| at + 1) };
            if end == 0 && !self.ended || self.ended && self.rest.iter().all(u8::is_ascii_whitespace) {
                continue;
            }
            let after = self.rest.split_off(end);
            let piece = std::mem::replace(&mut self.rest, after);
            no_zero(&piece, from)?;
            let mut r = if self.head.is_empty() {
                self.head = header(&piece).to_vec();
                Recording::parse(&piece)?
            } else {
                Recording::parse(&[self.head.as_slice(), &piece].concat()).map_err(|e| {
                    let at = self.lines + 1;
                    BadInput(format!("in the part that begins at line {at}, lines counted from there: {e}"))
                })?
            };
            self.lines += super::lines::count(&piece);
            if let Some(step) = r.meta(super::metadata::TIME_STEP).and_then(|v| v.parse::<f64>().ok()) {
                r.time_s.iter_mut().for_each(|t| *t += self.rows as f64 * step);
            }
            self.rows += r.time_s.len();
            return Ok(Some((piece, r)));
        }
        Ok(None)
    }
}

/// Parts of a recording, reduced and joined.
#[derive(Debug, Default)]
pub struct Reduced {
    whole: Option<Recording>,
    /// Rows of a mean that goes on in the next part.
    begun: Option<Recording>,
    /// Time between two rows, s.
    step_s: f64,
    /// Rows, samples of rates that are spikes, and values that are missing.
    rows: usize,
    spikes: usize,
    missing: usize,
}

impl Reduced {
    /// Adds a part.
    pub fn add(&mut self, mut r: Recording) {
        self.rows += r.time_s.len();
        self.missing += r.cleaned.iter().map(|c| c.count).sum::<usize>();
        if self.whole.is_none() {
            self.step_s = r.step_s();
        }
        if let Some(mut begun) = self.begun.take() {
            r.exchange_rows(&mut begun);
            r.append(begun);
        }
        let end = r.time_s.last().map_or(0.0, |t| bin(*t));
        let from = r.time_s.iter().rposition(|t| bin(*t) != end).map_or(0, |k| k + 1);
        if from > 0 {
            self.begun = Some(r.rows_from(from));
        }
        self.take(r);
    }

    /// Takes means.
    fn take(&mut self, r: Recording) {
        let (r, spikes) = r.reduced();
        self.spikes += spikes;
        match &mut self.whole {
            None => self.whole = Some(r),
            Some(whole) => whole.append(r),
        }
    }

    /// Number of rows, and the time between two of them, s.
    #[must_use]
    pub fn rows(&self) -> (usize, f64) {
        (self.rows, self.step_s)
    }

    /// The recording of all parts.
    ///
    /// # Errors
    /// There was none.
    pub fn recording(mut self) -> Result<Recording, BadInput> {
        if let Some(begun) = self.begun.take() {
            self.take(begun);
        }
        let Self { rows, spikes, missing, .. } = self;
        let mut whole = self.whole.ok_or_else(|| BadInput::new("the file is empty: there is no header line"))?;
        whole.notes.retain(|n| !n.contains("values are missing"));
        whole.meta.retain(|(k, _)| k != super::metadata::TIME_STEP);
        whole.notes.push(format!(
            "{rows} rows are too many to be in memory: read as means of {MEAN_S} s, {} of them; figures of shorter times are not theirs",
            whole.time_s.len()
        ));
        if spikes > 0 {
            whole.notes.push(format!("{spikes} samples of rates are spikes within their mean: not in it"));
        }
        if missing > 0 {
            whole.notes.push(format!("{missing} values are missing"));
        }
        Ok(whole)
    }
}

/// The rows of a text: what comes behind the names of the columns.
#[must_use]
pub fn rows_of(text: &str) -> &str {
    &text[header(text.as_bytes()).len()..]
}

/// The lines up to the names of the columns.
fn header(text: &[u8]) -> &[u8] {
    let mut at = 0;
    for line in text.split_inclusive(|b| *b == b'\n') {
        at += line.len();
        let trimmed = line.trim_ascii();
        if !trimmed.is_empty() && !trimmed.starts_with(b"#") && !trimmed.starts_with(b"\xEF\xBB\xBF#") {
            break;
        }
    }
    &text[..at]
}

/// Number of the mean that a time belongs to.
fn bin(t: f64) -> f64 {
    (t / MEAN_S).floor()
}

fn groups(ends: &[usize]) -> impl Iterator<Item = std::ops::Range<usize>> + '_ {
    let from = std::iter::once(0).chain(ends.iter().copied());
    from.zip(ends.iter().copied()).map(|(from, to)| from..to)
}

/// Mean of the finite values; NaN where less than half of them are.
fn mean_of(values: &[f64]) -> f64 {
    let (sum, n) = values.iter().filter(|v| v.is_finite()).fold((0.0, 0usize), |(s, n), v| (s + v, n + 1));
    if 2 * n >= values.len() && n > 0 {
        sum / n as f64
    } else {
        f64::NAN
    }
}

/// The mean without spikes, and how many there were.
fn without_spikes(values: &[f64], buffer: &mut Vec<f64>) -> (f64, usize) {
    buffer.clear();
    buffer.extend(values.iter().copied().filter(|v| v.is_finite()));
    if buffer.len() < LEAST {
        return (mean_of(values), 0);
    }
    let Some(middle) = median(buffer) else { return (f64::NAN, 0) };
    buffer.iter_mut().for_each(|v| *v = (*v - middle).abs());
    let Some(distance) = median(buffer) else { return (f64::NAN, 0) };
    let limit = SPIKE * 1.4826 * distance;
    // (Values of coarse steps may have no distance at all.)
    if limit == 0.0 {
        return (mean_of(values), 0);
    }
    let kept = |v: &f64| v.is_finite() && (*v - middle).abs() <= limit;
    let (sum, n) = values.iter().filter(|v| kept(v)).fold((0.0, 0usize), |(s, n), v| (s + v, n + 1));
    let finite = values.iter().filter(|v| v.is_finite()).count();
    (if 2 * n >= values.len() { sum / n as f64 } else { f64::NAN }, finite - n)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_of_a_table_are_those_of_its_text() {
        let mut text = String::from("# hrg-recording: 2\n# unit: G-1\ntime_s,temp_c,rate_x_dph,status\n");
        for k in 0..5000 {
            text +=
                &format!("{k},{},{},{}\n", 20 + k % 7, if k % 50 == 0 { String::new() } else { k.to_string() }, k % 3);
        }
        let folder = std::env::temp_dir().join(format!("hrg-parts-{}", std::process::id()));
        std::fs::create_dir_all(&folder).expect("a folder");
        let path = folder.join("run.parquet");
        let half = text.match_indices('\n').nth(2500).expect("lines").0 + 1;
        let written = parquet::write_parts(&path, |to| to(&text[..half]).and_then(|()| to(&text[half..])));
        written.expect("written");
        let of = |mut parts: Parts<Box<dyn Read>>| {
            let (mut all, mut count, mut again) = (Recording::default(), 0, Vec::new());
            while let Some((piece, r)) = parts.next_part().expect("reads") {
                again.extend(piece);
                if count == 0 {
                    all = r;
                } else {
                    all.append(r);
                }
                count += 1;
            }
            (all.to_csv(), all.status, count, String::from_utf8(again).expect("text"))
        };
        let (whole, status, _, again) = of(Parts::new(Box::new(std::io::Cursor::new(text.clone())), 1 << 12));
        assert!(again == text && rows_of(&text).starts_with("0,20"));
        let read = of(Parts::open(&path).expect("opens"));
        assert!(read.0 == whole && read.1 == status && read.2 == 1, "{}", read.2);
        parquet::write_text(&folder.join("run.csv.gz"), &text).expect("written");
        assert!(crate::files::begins_with(&folder.join("run.csv.gz"), crate::files::GZIP), "packed as its name says");
        assert_eq!(of(Parts::open(&folder.join("run.csv.gz")).expect("opens")).0, whole);
        let _ = std::fs::remove_dir_all(&folder);
    }

    #[test]
    fn parts_are_means_whatever_their_length() {
        let mut text = String::from("# hrg-recording: 2\n# unit: G-1\ntime_s,temp_c,rate_x_dph,chamber_c\n");
        for k in 0..20_000u32 {
            let t = f64::from(k) / 1000.0;
            let noise = f64::from(k * 7919 % 101) / 50.0 - 1.0;
            let rate = if k == 7777 { 1e6 } else { 10.0 + t + noise };
            text += &format!("{t},{},{rate},{}\n", 20.0 + t, if k % 50 == 0 { String::new() } else { "5".into() });
        }
        let of = |part: usize| Recording::in_parts(text.as_bytes(), part).expect("reads");
        let r = of(1 << 16);
        assert_eq!(r.time_s.len(), 200, "a mean is not cut where a part ends");
        assert_eq!(r.unit(), "G-1");
        for (k, t) in r.time_s.iter().enumerate() {
            assert!((r.frequency_hz[0][k] - 20.0 - t).abs() < 1e-6 && (r.rate_dph[0][k] - 10.0 - t).abs() < 0.5, "{k}");
        }
        assert!(r.notes.iter().any(|n| n.contains("20000 rows are too many")), "{:?}", r.notes);
        assert!(r.notes.iter().any(|n| n.starts_with("1 samples of rates are spikes")), "{:?}", r.notes);
        assert_eq!(of(1 << 30).time_s.len(), 200);
        // Rows without times go on where the part before ended.
        let without: String =
            text.lines().map(|l| l.split_once(',').map_or(l, |(_, rest)| rest).to_string() + "\n").collect();
        let without = without.replacen("# unit", "# time_step_s: 0.001\n# unit", 1);
        let r = Recording::in_parts(without.as_bytes(), 1 << 16).expect("reads");
        assert!((r.time_s[r.time_s.len() - 1] - 19.95).abs() < 0.1 && r.time_s.windows(2).all(|w| w[0] < w[1]));
        let e = Recording::in_parts(text.replace("15,35,", "15,hot,").as_bytes(), 1 << 16).expect_err("no number").0;
        assert!(e.contains("in the part that begins at line") && e.contains("hot"), "{e}");
    }
}
