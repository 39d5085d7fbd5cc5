//! Recordings as a program reads them: with notes on standard error.

use crate::error::BadInput;
use crate::recording::facts::Facts;
use crate::recording::Recording;

/// Reads and cleans a recording of a unit at rest (or on a rate table), and says on standard error what was found in it.
///
/// # Errors
/// As [`Recording::load`] and [`Recording::rests`].
pub fn load_recording(path: &std::path::Path) -> anyhow::Result<Recording> {
    load_recording_with(path, &Facts::default())
}

/// The same, with what a user says of the unit.
///
/// # Errors
/// As [`load_recording`], and where the recording says otherwise.
pub fn load_recording_with(path: &std::path::Path, facts: &Facts) -> anyhow::Result<Recording> {
    let r = read_with(path, facts)?;
    print_notes(path, &r);
    Ok(r)
}

/// The same without a word.
///
/// # Errors
/// As [`load_recording_with`].
pub fn read_with(path: &std::path::Path, facts: &Facts) -> anyhow::Result<Recording> {
    let r = Recording::load_with(path, |r| facts.apply(r))?;
    r.rests().map_err(|e| BadInput(format!("{}: {e}", path.display())))?;
    Ok(r)
}

/// Prints what was found in a recording to standard error.
pub fn print_notes(path: &std::path::Path, r: &Recording) {
    for note in &r.notes {
        eprintln!("{}: {note}", path.display());
    }
}
