//! A unit's log in the place of its link: `hrg record --defmt` and `hrg monitor --defmt`.

use crate::chamber::{ended, report, RecordArguments};
use anyhow::Result;
use hrg::unit::log::housekeeping_of_line;
use hrg::unit::monitor;
use hrg::unit::monitor::State;
use hrg::unit::record::{unit_in_log, Second};
use hrg_core::link::{Identity, Message};
use hrg_core::unit_name::UnitName;
use hrg_data::error::BadInput;
use hrg_data::log::Decoder;
use hrg_data::recording::names;
use std::io::{BufRead, Read};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{channel, RecvTimeoutError};
use std::time::Duration;

/// A line of a megabyte is none of a log.
const LONGEST_LINE: u64 = 1 << 20;

/// Gives the lines of a log: decoded ones, or those of a raw stream with the ELF that made it; `-` is standard input. Ends
/// with the log, or where `take` says `false`.
fn lines(log: &Path, elf: Option<&Path>, mut take: impl FnMut(&str) -> Result<bool>) -> Result<()> {
    let from: Box<dyn Read> = if log == Path::new("-") {
        Box::new(std::io::stdin())
    } else {
        let f = std::fs::File::open(log).map_err(|e| BadInput::new(format!("cannot read {}: {e}", log.display())))?;
        Box::new(f)
    };
    let mut reader = std::io::BufReader::new(from);
    // A raw stream is not text, and only an ELF tells what it says.
    let raw = reader.fill_buf()?.iter().take(512).any(|b| *b == 0 || *b >= 0x80);
    if !raw {
        let mut bytes = Vec::new();
        while reader.by_ref().take(LONGEST_LINE).read_until(b'\n', &mut bytes)? > 0 {
            if !take(String::from_utf8_lossy(&bytes).trim_end())? {
                return Ok(());
            }
            bytes.clear();
        }
        return Ok(());
    }
    let elf = elf.ok_or_else(|| {
        BadInput::new(
            "this is a raw defmt stream; give the firmware that made it with --elf, or pipe it through defmt-print",
        )
    })?;
    let bytes = hrg_data::files::read_file(elf, hrg_data::files::MOST_ELF, false)?;
    let mut decoder = Decoder::new(&bytes)?;
    let mut buffer = [0; 4096];
    loop {
        let n = reader.read(&mut buffer)?;
        if n == 0 {
            return Ok(());
        }
        for line in decoder.push(&buffer[..n]) {
            if !take(&line)? {
                return Ok(());
            }
        }
    }
}

fn no_second(log: &Path) -> BadInput {
    BadInput::new(format!(
        "{}: no line of a second (t=... f=... T=...) in it; the unit logs one a second at level info",
        log.display()
    ))
}

/// `hrg record --defmt`.
///
/// # Errors
/// A log that cannot be read or holds no second, and a recording that cannot be written.
pub fn record(log: &Path, elf: Option<&Path>, out: &Path, arguments: &RecordArguments) -> Result<()> {
    let mut recorder = arguments.recorder(out, log == Path::new("-"))?;
    lines(log, elf, |line| {
        if let Some(name) = unit_in_log(line) {
            let own = Some(name).filter(|n| !names::is_unnamed(n));
            recorder.head.unit = arguments.name(own).map_err(|e| BadInput::new(format!("{}: {e}", log.display())))?;
        }
        if let Some(second) = Second::from_log(line) {
            recorder.push(&second)?;
        }
        Ok(true)
    })?;
    if recorder.rows() == 0 {
        return Err(no_second(log).into());
    }
    report(&recorder);
    Ok(())
}

/// Updates the state from a line of the log; `true` if the line holds a second of housekeeping.
fn take(state: &mut State, line: &str) -> bool {
    if let Some(name) = unit_in_log(line) {
        let identity = Identity { unit: UnitName::new(name), ..Identity::default() };
        state.take(&Message::Identity(identity));
    }
    let second = housekeeping_of_line(line);
    if let Some(h) = &second {
        state.take(&Message::Housekeeping(*h));
    }
    second.is_some()
}

/// `hrg monitor --defmt`. A log that has ended stays on the screen until somebody ends it.
///
/// # Errors
/// A log that cannot be read or holds no second.
pub fn monitor(log: &Path, elf: Option<&Path>, mut state: State, snapshot: Option<u32>) -> Result<()> {
    state.of_log = true;
    if let Some(seconds) = snapshot {
        let mut seen = 0;
        lines(log, elf, |line| {
            seen += u32::from(take(&mut state, line));
            Ok(seen < seconds)
        })?;
        if seen == 0 {
            return Err(no_second(log).into());
        }
        print!("{}", monitor::screen(&state)?);
        return Ok(());
    }
    let (send, receive) = channel();
    let (path, firmware): (PathBuf, Option<PathBuf>) = (log.into(), elf.map(Into::into));
    let reader =
        std::thread::spawn(move || lines(&path, firmware.as_deref(), |l| Ok(send.send(l.to_string()).is_ok())));
    let mut terminal = monitor::terminal()?;
    let result = watch(&mut terminal, &receive, &mut state);
    ratatui::restore();
    result?;
    if reader.is_finished() {
        reader.join().map_err(|_| anyhow::anyhow!("the reader of the log has panicked"))??;
    }
    Ok(())
}

fn watch(
    terminal: &mut ratatui::DefaultTerminal,
    lines: &std::sync::mpsc::Receiver<String>,
    state: &mut State,
) -> Result<()> {
    loop {
        match lines.recv_timeout(Duration::from_millis(200)) {
            Ok(line) => {
                take(state, &line);
                for line in lines.try_iter() {
                    take(state, &line);
                }
            }
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => {
                state.port_error = Some("the log has ended".into());
                std::thread::sleep(Duration::from_millis(200));
            }
        }
        terminal.draw(|f| monitor::draw(f, state))?;
        if ended()? {
            return Ok(());
        }
    }
}
