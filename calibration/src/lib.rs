//! From a recording of a thermal-chamber run to the coefficients of an HRG unit, and back to the residual.
//!
//! | step | module |
//! |---|---|
//! | recordings in and out, and what is wrong with them | [`recording`], [`metadata`], [`dialect`] |
//! | recordings from other programs' files | [`import`] |
//! | names of units; what a user says of one beside its recordings | [`names`], [`facts`] |
//! | a recording as the unit would have seen it: model steps, temperatures, regressors | [`run`] |
//! | least squares | [`lsq`] |
//! | how a resonator follows its surroundings | [`lag`] |
//! | what gives the temperatures; frequency to temperature; static points | [`mod@thermometer`], [`laws`], [`points`] |
//! | before and after every fit | [`fit`] |
//! | enough data behind a figure; runs that are independent | [`evidence`], [`independence`] |
//! | what a unit sends, computed on the desktop | [`mod@correct`] |
//! | coefficients, by the methods of the sources | [`methods`] |
//! | the calibration file | [`mod@file`] |
//! | what the model lacks | [`trace`] |
//! | a chamber run from a plant model | [`simulate`] |
//! | the loop on measured data | [`measured`] |
//! | Allan deviation | [`allan`] |
//! | self-alignment | [`align`] |
//! | a unit on a port; recordings from it; its log; its screen | [`mod@unit`], [`record`], [`mod@log`], [`monitor`] |
//! | sensors beside a unit, live or from a chamber's log | [`sensors`], [`merge`] |
//! | figures of a data sheet from recordings alone | [`report`] |
//! | pictures | [`plot`] |
//!
//! Regressors are produced by `hrg_core`, by the code that runs on the unit.
#![forbid(unsafe_code)]

pub mod align;
pub mod allan;
pub mod cards;
pub mod correct;
pub mod dialect;
pub mod evidence;
pub mod facts;
pub mod file;
pub mod fit;
pub mod import;
pub mod independence;
pub mod lag;
pub mod laws;
pub mod log;
pub mod lsq;
pub mod measured;
pub mod merge;
pub mod metadata;
pub mod methods;
pub mod monitor;
pub mod names;
pub mod plot;
pub mod points;
pub mod record;
pub mod recording;
pub mod report;
pub mod run;
pub mod sensors;
pub mod simulate;
pub mod stats;
pub mod thermometer;
pub mod trace;
pub mod unit;

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

/// How a program ends: 0 done, 2 bad input, 1 internal; the error is one line on standard error.
#[must_use]
pub fn exit(program: &str, result: anyhow::Result<()>) -> std::process::ExitCode {
    match result {
        Ok(()) => std::process::ExitCode::SUCCESS,
        Err(e) => {
            eprintln!("{program}: {e:#}");
            std::process::ExitCode::from(if e.is::<BadInput>() { 2 } else { 1 })
        }
    }
}

/// Reads and cleans a recording, and says on standard error what was found in it.
///
/// # Errors
/// As [`recording::Recording::load`].
pub fn load_recording(path: &std::path::Path) -> anyhow::Result<recording::Recording> {
    load_recording_with(path, &facts::Facts::default())
}

/// The same, with what a user says of the unit.
///
/// # Errors
/// As [`recording::Recording::load`], and where the recording says otherwise.
pub fn load_recording_with(path: &std::path::Path, facts: &facts::Facts) -> anyhow::Result<recording::Recording> {
    let r = recording::Recording::load_with(path, |r| facts.apply(r))?;
    for note in &r.notes {
        eprintln!("{}: {note}", path.display());
    }
    Ok(r)
}

/// How a file begins that gzip has packed.
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
            if let Some(at) = bytes[start..].iter().position(|b| *b == 0) {
                return Err(BadInput::new(format!(
                    "{}: byte {} is zero: this is a binary file, or text in UTF-16; save it as text in UTF-8",
                    path.display(),
                    start + at + 1
                )));
            }
        }
    }
}

/// Most bytes of a recording: 30 days at 100 Hz with every column.
pub const MOST_RECORDING: u64 = 64 << 30;
/// Most bytes of a calibration file: twenty times what the largest has.
pub const MOST_CALIBRATION: u64 = 1 << 20;
/// Most bytes of a firmware ELF: with all debug information it has some ten million.
pub const MOST_ELF: u64 = 1 << 30;

/// Writes a file so that an interruption leaves the old one: to a neighbour first, which is on the disk before it is renamed.
///
/// # Errors
/// Where the folder cannot be written; what was there stays.
pub fn write_file(path: &std::path::Path, content: &[u8]) -> anyhow::Result<()> {
    use anyhow::Context;
    let mut name = path.file_name().unwrap_or_default().to_os_string();
    name.push(".part");
    let part = path.with_file_name(name);
    let write = || -> std::io::Result<()> {
        let mut file = std::fs::File::create(&part)?;
        std::io::Write::write_all(&mut file, content)?;
        file.sync_all()?;
        std::fs::rename(&part, path)
    };
    write()
        .inspect_err(|_| drop(std::fs::remove_file(&part)))
        .with_context(|| format!("cannot write {}", path.display()))
}

/// Writes a text into a page, between the marks of a name.
///
/// # Errors
/// Where the page has no such marks.
pub fn splice(page: &std::path::Path, name: &str, text: &str) -> anyhow::Result<()> {
    use anyhow::Context;
    let (begin, end) = (format!("<!-- {name}: begin -->"), format!("<!-- {name}: end -->"));
    let old = std::fs::read_to_string(page).with_context(|| format!("cannot read {}", page.display()))?;
    let (before, rest) = old.split_once(&begin).with_context(|| format!("{} has no {begin}", page.display()))?;
    let (_, after) = rest.split_once(&end).with_context(|| format!("{} has no {end}", page.display()))?;
    write_file(page, format!("{before}{begin}\n{text}{end}{after}").as_bytes())
}
