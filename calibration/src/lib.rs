//! From a recording of a thermal-chamber run to the coefficients of an HRG unit, and back to the residual.
//!
//! | step | module |
//! |---|---|
//! | recordings in and out, and what is wrong with them | [`recording`] |
//! | a recording as the unit would have seen it: model steps, temperatures, regressors | [`run`] |
//! | least squares | [`lsq`] |
//! | how a resonator follows its surroundings | [`lag`] |
//! | frequency to temperature; static points | [`laws`], [`points`] |
//! | before and after every fit | [`fit`] |
//! | coefficients, by the methods of the sources | [`methods`] |
//! | the calibration file | [`mod@file`] |
//! | what the model lacks | [`trace`] |
//! | a chamber run from a plant model | [`simulate`] |
//! | Allan deviation | [`allan`] |
//! | self-alignment | [`align`] |
//! | a unit on a port; recordings from it; its log; its screen | [`mod@unit`], [`record`], [`mod@log`], [`monitor`] |
//! | pictures | [`plot`] |
//!
//! Regressors are produced by `hrg_core`, by the code that runs on the unit.
#![forbid(unsafe_code)]

pub mod align;
pub mod allan;
pub mod file;
pub mod fit;
pub mod lag;
pub mod laws;
pub mod log;
pub mod lsq;
pub mod methods;
pub mod monitor;
pub mod plot;
pub mod points;
pub mod record;
pub mod recording;
pub mod run;
pub mod simulate;
pub mod stats;
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
    let r = recording::Recording::load(path)?;
    for note in &r.notes {
        eprintln!("{}: {note}", path.display());
    }
    Ok(r)
}

/// Writes a file so that an interruption leaves the old one: to a neighbour first, then renamed.
///
/// # Errors
/// Where the folder cannot be written.
pub fn write_file(path: &std::path::Path, content: &[u8]) -> anyhow::Result<()> {
    use anyhow::Context;
    let mut name = path.file_name().unwrap_or_default().to_os_string();
    name.push(".part");
    let part = path.with_file_name(name);
    std::fs::write(&part, content).with_context(|| format!("cannot write {}", part.display()))?;
    std::fs::rename(&part, path).with_context(|| format!("cannot write {}", path.display()))
}
