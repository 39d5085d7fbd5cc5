//! Measured series as a source of noise spectra: read from a table, freed of what temperature explains, given random phases.

use crate::fit;
use crate::means::deviation;
use crate::operators::slope_per_min;
use anyhow::{bail, ensure, Context, Result};
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rustfft::{num_complex::Complex, FftPlanner};
use std::f64::consts::PI;
use std::io::Read as _;
use std::path::Path;

/// Measured residual series, one column or more, all of one length.
#[derive(Clone, Debug)]
pub struct Series {
    /// Name for lists and truth: the file's, without folder.
    pub name: String,
    /// Residuals; their unit does not matter.
    pub columns: Vec<Vec<f64>>,
    /// Time from row to row, s. None: the series is stretched over the run, whatever its length.
    pub step_s: Option<f64>,
}

/// Selection of a series in a table.
#[derive(Clone, Debug, Default)]
pub struct Selection {
    /// Columns to use, by name or number (from 0). Empty: the last one.
    pub columns: Vec<String>,
    /// Column of temperature: a fit of dong2023's equation 7 on it is taken off.
    pub against: Option<String>,
    /// Rows to leave out at the beginning.
    pub skip: usize,
    /// Time from row to row, s.
    pub step_s: Option<f64>,
}

impl Series {
    /// Reads a table whose separator is a tab, a comma, a semicolon or spaces, with or without a header. Lines that begin with `#`, and up
    /// to one row in a hundred that cannot be read, are left out.
    ///
    /// # Errors
    /// A sentence with file, and line where one is at fault: unreadable, no such column, too many rows that are not numbers, fewer than 256
    /// rows, a constant column.
    pub fn read(path: &Path, selection: &Selection) -> Result<Self> {
        let text = read_text(path).with_context(|| format!("cannot read {}", path.display()))?;
        let name = path.file_stem().map_or_else(|| "series".into(), |stem| stem.to_string_lossy().into_owned());
        Self::parse(&text, name, selection).with_context(|| format!("{} cannot be used", path.display()))
    }

    /// As [`Series::read`], of text that is already in memory.
    ///
    /// # Errors
    /// As [`Series::read`].
    pub fn parse(text: &str, name: String, selection: &Selection) -> Result<Self> {
        let mut lines =
            text.lines().enumerate().filter(|(_, l)| !l.trim().is_empty() && !l.starts_with('#')).peekable();
        let Some(&(_, first)) = lines.peek() else { bail!("it holds no rows") };
        let cells = split(first);
        let header: Vec<String> = if cells.iter().any(|c| c.parse::<f64>().is_err()) {
            lines.next();
            cells.iter().map(|c| (*c).to_owned()).collect()
        } else {
            (0..cells.len()).map(|k| k.to_string()).collect()
        };
        let wanted = if selection.columns.is_empty() {
            vec![header.len() - 1]
        } else {
            selection.columns.iter().map(|c| find(&header, c)).collect::<Result<Vec<_>>>()?
        };
        let against = selection.against.as_ref().map(|c| find(&header, c)).transpose()?;
        let used: Vec<usize> = wanted.into_iter().chain(against).collect();
        let mut columns = vec![Vec::new(); used.len()];
        let (mut bad, mut first_bad) = (0, String::new());
        for (number, line) in lines.skip(selection.skip) {
            match numbers(line, &used) {
                Ok(row) => columns.iter_mut().zip(row).for_each(|(column, x)| column.push(x)),
                Err(e) if bad == 0 => (bad, first_bad) = (1, format!("line {}: {e}", number + 1)),
                Err(_) => bad += 1,
            }
        }
        let rows = columns[0].len();
        ensure!(bad * 100 <= rows, "{bad} of its {} rows are unusable; {first_bad}", rows + bad);
        ensure!(rows >= 256, "it holds {rows} rows; a spectrum needs 256 or more");
        if against.is_some() {
            let temperature = columns.pop().unwrap_or_default();
            columns = columns.iter().map(|x| without_temperature(x, &temperature)).collect();
        }
        let columns: Vec<Vec<f64>> = columns.iter().map(|x| without_ends(x)).collect();
        ensure!(columns.iter().all(|x| deviation(x) > 0.0), "a column is constant: it has no spectrum");
        Ok(Self { name, columns, step_s: selection.step_s })
    }

    /// `n` samples of step `dt_s` with the amplitudes of column number `column` and random phases. If the series is shorter than the run,
    /// its amplitudes are interpolated to the finer frequencies that the run needs, so nothing repeats. Between rows: linear.
    #[must_use]
    pub fn surrogate(&self, rng: &mut ChaCha8Rng, column: usize, n: usize, dt_s: f64) -> Vec<f64> {
        let series = &self.columns[column];
        let rows = series.len();
        let seconds = n as f64 * dt_s;
        let step_s = self.step_s.unwrap_or(seconds / rows as f64);
        let length = ((seconds / step_s).ceil() as usize + 1).max(rows);
        let amplitudes = amplitudes(series, length);
        let mut spectrum = vec![Complex::new(0.0, 0.0); length];
        for k in 1..=(length - 1) / 2 {
            spectrum[k] = Complex::from_polar(amplitudes[k], rng.random_range(0.0..2.0 * PI));
            spectrum[length - k] = spectrum[k].conj();
        }
        FftPlanner::new().plan_fft_inverse(length).process(&mut spectrum);
        (0..n)
            .map(|i| {
                let at = i as f64 * dt_s / step_s;
                let (k, share) = (at as usize, at.fract());
                let (a, b) = (spectrum[k % length].re, spectrum[(k + 1) % length].re);
                a + share * (b - a)
            })
            .collect()
    }
}

/// Amplitudes of the series' spectrum at the frequencies of a series of `length` rows.
fn amplitudes(series: &[f64], length: usize) -> Vec<f64> {
    let rows = series.len();
    let mut spectrum: Vec<Complex<f64>> = series.iter().map(|&x| Complex::new(x, 0.0)).collect();
    FftPlanner::new().plan_fft_forward(rows).process(&mut spectrum);
    let half = rows / 2;
    (0..=length / 2)
        .map(|k| {
            let at = (k as f64 * rows as f64 / length as f64).clamp(1.0, half as f64);
            let (low, share) = (at as usize, at.fract());
            let high = (low + 1).min(half);
            (1.0 - share) * spectrum[low].norm() + share * spectrum[high].norm()
        })
        .collect()
}

fn split(line: &str) -> Vec<&str> {
    match ['\t', ',', ';'].into_iter().find(|c| line.contains(*c)) {
        Some(separator) => line.split(separator).map(str::trim).collect(),
        None => line.split_whitespace().collect(),
    }
}

/// The cells of a line that are used, in their order.
fn numbers(line: &str, used: &[usize]) -> Result<Vec<f64>> {
    let cells = split(line);
    used.iter()
        .map(|&k| {
            let text = cells.get(k).with_context(|| format!("column {k} is missing"))?;
            let number: f64 = text.parse().with_context(|| format!("`{text}` is not a number"))?;
            ensure!(number.is_finite(), "`{text}` is not a finite number");
            Ok(number)
        })
        .collect()
}

fn find(header: &[String], column: &str) -> Result<usize> {
    if let Some(k) = header.iter().position(|name| name == column) {
        return Ok(k);
    }
    match column.parse::<usize>() {
        Ok(k) if k < header.len() => Ok(k),
        _ => bail!("there is no column `{column}`; there are: {}", header.join(", ")),
    }
}

/// Residual after a fit of equation 7 on temperature (smoothed over 51 rows).
fn without_temperature(x: &[f64], t_c: &[f64]) -> Vec<f64> {
    const HALF: usize = 25;
    let smooth: Vec<f64> = (0..t_c.len())
        .map(|i| {
            let window = &t_c[i.saturating_sub(HALF)..(i + HALF + 1).min(t_c.len())];
            window.iter().sum::<f64>() / window.len() as f64
        })
        .collect();
    let ramp = slope_per_min(&smooth, 1.0, 50.0);
    let columns: Vec<Vec<f64>> = [vec![1.0; x.len()]].into_iter().chain(fit::eq7(&smooth, &ramp)).collect();
    let coefficients = fit::solve(&columns, x);
    fit::leftover(&columns, &coefficients, x)
}

/// Takes off the mean and the line that joins the two ends, so that the ends meet: a transform takes a series for periodic.
fn without_ends(x: &[f64]) -> Vec<f64> {
    let few = (x.len() / 50).max(1);
    let mean = |part: &[f64]| part.iter().sum::<f64>() / part.len() as f64;
    let (first, last) = (mean(&x[..few]), mean(&x[x.len() - few..]));
    let slope = (last - first) / (x.len() - few) as f64;
    let straight: Vec<f64> = x.iter().enumerate().map(|(i, x)| x - slope * i as f64).collect();
    let mean = mean(&straight);
    straight.iter().map(|x| x - mean).collect()
}
/// The text of a file, unpacked where its name says that gzip has packed it.
fn read_text(path: &Path) -> std::io::Result<String> {
    let file = std::fs::File::open(path)?;
    let mut text = String::new();
    if path.extension().is_some_and(|e| e == "gz") {
        flate2::read::GzDecoder::new(file).read_to_string(&mut text)?;
    } else {
        std::io::BufReader::new(file).read_to_string(&mut text)?;
    }
    Ok(text)
}
