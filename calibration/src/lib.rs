//! From a recording of a thermal-chamber run to the coefficients of an HRG unit, and back to the residual.
//!
//! | room | holds |
//! |---|---|
//! | [`recording`] | recordings in and out and what is wrong with them; other programs' files; names of units; model steps |
//! | [`thermometer`] | frequency to temperature, the lag of a resonator, static points |
//! | [`fit`] | coefficients by the methods of the sources, enough data behind them, what a unit sends |
//! | [`trace`] | what the model lacks; the cards of the effects |
//! | [`image_file`] | the calibration image as a text file |
//! | [`images`] | images of one unit side by side: what changed, trends |
//! | [`formats`] | the tables of bytes that the docs print |
//! | [`align`] | self-alignment |
//! | [`simulate`] | a chamber run from a plant model |
//! | [`mod@unit`] | a unit on a port: recordings from it, its log, its screen, sensors beside it |
//! | [`numeric`] | least squares, statistics, Allan deviation |
//! | [`compare`] | every method on the same data, the trace beside them |
//! | [`measured`] | the loop on measured data |
//! | [`wu2023`] | wu2023's loop on a simulated gyro with temperature sensors only |
//! | [`rates`] | scale factor and misalignment over temperature from runs on a rate table |
//! | [`report`] | figures of a data sheet from recordings alone |
//! | [`profiles`] | which chamber profile tells effects apart |
//! | [`plot`] | pictures |
//! | [`output`] | the one writer of output files |
//!
//! Regressors are produced by `hrg_core`, by the code that runs on the unit.
#![forbid(unsafe_code)]

pub mod align;
pub mod compare;
pub mod fit;
pub mod formats;
pub mod image_file;
pub mod images;
pub mod measured;
pub mod numeric;
pub mod output;
pub mod plot;
pub mod profiles;
pub mod rates;
pub mod recording;
pub mod report;
pub mod simulate;
pub mod thermometer;
pub mod trace;
pub mod unit;
pub mod wu2023;

pub use output::write_file;

/// Names of the axes, in order.
pub const AXIS_NAMES: [&str; 3] = ["x", "y", "z"];

/// An input that cannot be used: one sentence that says what, where and what to do. Exit status 2.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct BadInput(pub String);

impl BadInput {
    /// From a sentence.
    pub fn new(sentence: impl Into<String>) -> Self {
        Self(sentence.into())
    }
}

/// "a, b and c".
#[must_use]
pub fn list<S: AsRef<str>>(names: &[S]) -> String {
    match names {
        [] => "nothing".into(),
        [one] => one.as_ref().into(),
        [rest @ .., last] => {
            let rest: Vec<&str> = rest.iter().map(AsRef::as_ref).collect();
            format!("{} and {}", rest.join(", "), last.as_ref())
        }
    }
}

/// Errors of the rooms that are bad input, with their own sentences.
macro_rules! bad_input {
    ($($error:ty),+ $(,)?) => {$(
        impl From<$error> for BadInput {
            fn from(e: $error) -> Self {
                Self(e.to_string())
            }
        }
    )+

        /// `true` if an error is bad input, of whichever module.
        fn is_bad_input(e: &anyhow::Error) -> bool {
            e.is::<BadInput>() $(|| e.is::<$error>())+
        }
    };
}

bad_input! {
    align::ReadError,
    fit::methods::MethodError,
    image_file::FileError,
    thermometer::points::TableError,
}

/// Exit code of a program: 0 done, 2 bad input, 1 internal; the error is one line on standard error.
#[must_use]
pub fn exit(program: &str, result: anyhow::Result<()>) -> std::process::ExitCode {
    match result {
        Ok(()) => std::process::ExitCode::SUCCESS,
        Err(e) => {
            eprintln!("{program}: {e:#}");
            std::process::ExitCode::from(if is_bad_input(&e) { 2 } else { 1 })
        }
    }
}

/// Reads and cleans a recording, and says on standard error what was found in it.
///
/// # Errors
/// As [`recording::Recording::load`].
pub fn load_recording(path: &std::path::Path) -> anyhow::Result<recording::Recording> {
    load_recording_with(path, &recording::facts::Facts::default())
}

/// The same, with what a user says of the unit.
///
/// # Errors
/// As [`recording::Recording::load`], and where the recording says otherwise.
pub fn load_recording_with(
    path: &std::path::Path,
    facts: &recording::facts::Facts,
) -> anyhow::Result<recording::Recording> {
    let r = recording::Recording::load_with(path, |r| facts.apply(r))?;
    for note in &r.notes {
        eprintln!("{}: {note}", path.display());
    }
    Ok(r)
}

/// First bytes of a file that gzip has packed.
const GZIP: [u8; 2] = [0x1f, 0x8b];

/// Reads a whole file of at most so many bytes; one that gzip has packed is unpacked. A file that is larger is refused before it is read; one of text is refused at
/// its first zero byte, however large it is.
///
/// # Errors
/// A sentence with the path.
pub fn read_file(path: &std::path::Path, most: u64, text: bool) -> Result<Vec<u8>, BadInput> {
    use std::io::{BufRead, Read};
    let cannot = |e: std::io::Error| BadInput::new(format!("cannot read {}: {e}; check the path", path.display()));
    let file = std::fs::File::open(path).map_err(cannot)?;
    let size = file.metadata().map_err(cannot)?.len();
    if size > most {
        return Err(BadInput::new(format!(
            "{} has {size} bytes, more than the {most} that such a file may have; check that it is the right one",
            path.display()
        )));
    }
    let mut bytes = Vec::with_capacity(size.min(most) as usize);
    let mut file = std::io::BufReader::new(file);
    let packed = file.fill_buf().map_err(cannot)?.starts_with(&GZIP);
    let mut content: Box<dyn Read> =
        if packed { Box::new(flate2::bufread::MultiGzDecoder::new(file)) } else { Box::new(file) };
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
            recording::no_zero(&bytes[start..], start)
                .map_err(|e| BadInput::new(format!("{}: {e}", path.display())))?;
        }
    }
}

/// Most bytes of a recording: 30 days at 100 Hz with every column.
pub const MOST_RECORDING: u64 = 64 << 30;
/// Most bytes of a calibration file: twenty times what the largest has.
pub const MOST_CALIBRATION: u64 = 1 << 20;
/// Most bytes of a firmware ELF: with all debug information it has some ten million.
pub const MOST_ELF: u64 = 1 << 30;

/// Writes a text into a page, between the marks of a name.
///
/// # Errors
/// If the page has no such marks.
pub fn splice(page: &std::path::Path, name: &str, text: &str) -> anyhow::Result<()> {
    use anyhow::Context;
    let (begin, end) = (format!("<!-- {name}: begin -->"), format!("<!-- {name}: end -->"));
    let old = std::fs::read_to_string(page).with_context(|| format!("cannot read {}", page.display()))?;
    let (before, rest) = old.split_once(&begin).with_context(|| format!("{} has no {begin}", page.display()))?;
    let (_, after) = rest.split_once(&end).with_context(|| format!("{} has no {end}", page.display()))?;
    write_file(page, format!("{before}{begin}\n{text}{end}{after}").as_bytes())
}
