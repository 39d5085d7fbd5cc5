//! Commands for the chamber: a unit on a port, or its log.

use anyhow::{Context, Result};
use crossterm::event::{KeyCode, KeyModifiers};
use hrg_cal::log::Decoder;
use hrg_cal::monitor::State;
use hrg_cal::record::{unit_in_log, Recorder, Second};
use hrg_cal::simulate::Profile;
use hrg_cal::unit::Unit;
use hrg_cal::{file, monitor, BadInput};
use hrg_core::link::Message;
use std::io::{BufRead, Read};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Set by Ctrl-C.
fn interrupted() -> Result<Arc<AtomicBool>> {
    let flag = Arc::new(AtomicBool::new(false));
    let set = flag.clone();
    ctrlc::set_handler(move || set.store(true, Ordering::Relaxed))?;
    Ok(flag)
}

/// `hrg record --port`.
pub fn record_port(port: &str, out: &Path, seconds: Option<u64>) -> Result<()> {
    let stop = interrupted()?;
    let bar = indicatif::ProgressBar::new_spinner();
    let mut unit = Unit::open(port)?;
    let name = |unit: &mut Unit| -> Result<String> {
        let identity = unit.identity()?;
        Ok(identity.unit_name().to_string())
    };
    let mut recorder = Recorder::new(out, &name(&mut unit)?);
    let start = Instant::now();
    let enough = |rows: u64| seconds.is_some_and(|s| rows >= s);
    let mut lost: Option<Instant> = None;
    while !stop.load(Ordering::Relaxed) && !enough(recorder.rows) {
        match unit.next(Duration::from_millis(500)) {
            Ok(Some(Message::Housekeeping(h))) => {
                lost = None;
                recorder.push(&Second::from(&h))?;
                bar.set_message(format!(
                    "{}: {} rows, {} gaps, {:.1} h; T {:.2} {:.2} {:.2} C; {} bad frames",
                    recorder.path().unwrap_or(out).display(),
                    recorder.rows,
                    recorder.gaps,
                    start.elapsed().as_secs_f64() / 3600.0,
                    h.temperature_c[0],
                    h.temperature_c[1],
                    h.temperature_c[2],
                    unit.bad_frames
                ));
                bar.tick();
            }
            Ok(_) => {}
            Err(e) => {
                // The cable is out: wait for it, the file stays open.
                let since = lost.get_or_insert_with(Instant::now).elapsed();
                bar.set_message(format!("{port} is gone since {:.0} s ({e}); waiting for it", since.as_secs_f64()));
                bar.tick();
                std::thread::sleep(Duration::from_millis(250));
                if let Ok(again) = Unit::open(port) {
                    unit = again;
                }
            }
        }
    }
    bar.finish_and_clear();
    report(&recorder, out);
    Ok(())
}

fn report(recorder: &Recorder, out: &Path) {
    println!("{}: {} rows, {} gaps marked", recorder.path().unwrap_or(out).display(), recorder.rows, recorder.gaps);
}

/// `hrg record --defmt`: decoded lines, or the raw stream with the ELF that made it; `-` is standard input.
pub fn record_log(log: &Path, elf: Option<&Path>, out: &Path, unit: Option<&str>) -> Result<()> {
    let from: Box<dyn Read> = if log == Path::new("-") {
        Box::new(std::io::stdin())
    } else {
        let f = std::fs::File::open(log).map_err(|e| BadInput::new(format!("cannot read {}: {e}", log.display())))?;
        Box::new(f)
    };
    let mut reader = std::io::BufReader::new(from);
    let mut recorder = Recorder::new(out, unit.unwrap_or("unnamed"));
    let mut take = |line: &str| -> Result<()> {
        if let Some(name) = unit_in_log(line).filter(|_| unit.is_none()) {
            recorder.set_unit(name);
        }
        match Second::from_log(line) {
            Some(second) => recorder.push(&second),
            None => Ok(()),
        }
    };
    // A raw stream is not text, and only an ELF tells what it says.
    let raw = reader.fill_buf()?.iter().take(512).any(|b| *b == 0 || *b >= 0x80);
    if raw {
        let elf = elf.ok_or_else(|| {
            BadInput::new(
                "this is a raw defmt stream; give the firmware that made it with --elf, or pipe it through defmt-print",
            )
        })?;
        let bytes = hrg_cal::read_file(elf, hrg_cal::MOST_ELF, false)?;
        let mut decoder = Decoder::new(&bytes)?;
        let mut buffer = [0; 4096];
        loop {
            let n = reader.read(&mut buffer)?;
            if n == 0 {
                break;
            }
            for line in decoder.push(&buffer[..n]) {
                take(&line)?;
            }
        }
    } else {
        let mut bytes = Vec::new();
        // A line of a megabyte is none of a log.
        while reader.by_ref().take(1 << 20).read_until(b'\n', &mut bytes)? > 0 {
            take(String::from_utf8_lossy(&bytes).trim_end())?;
            bytes.clear();
        }
    }
    if recorder.rows == 0 {
        return Err(BadInput::new(format!(
            "{}: no line of a second (t=... f=... T=...) in it; the unit logs one a second at level info",
            log.display()
        ))
        .into());
    }
    report(&recorder, out);
    Ok(())
}

/// `hrg burn`.
pub fn burn(calibration: &Path, port: &str) -> Result<()> {
    let c = file::load(calibration)?;
    let bar = indicatif::ProgressBar::new(100);
    bar.set_style(indicatif::ProgressStyle::with_template("burning {bar:40} {percent}%")?);
    let after = Unit::open(port)?.burn(&c, |done| bar.set_position((done * 100.0) as u64));
    bar.finish_and_clear();
    let after = after.with_context(|| format!("{port}: the unit keeps the block it had"))?;
    println!(
        "{}: burnt, read back, and running: block {:08x}, number {}",
        c.unit_name(),
        after.calibration,
        after.sequence
    );
    println!(
        "this was burn {} of the unit; a sector of flash endures 10000 erases, each burn erases one of two",
        after.sequence
    );
    Ok(())
}

/// `hrg read`.
pub fn read(port: &str, out: Option<&Path>) -> Result<()> {
    let (identity, sectors) = Unit::open(port)?.read()?;
    println!("unit {}, running block {:08x}, number {}", identity.unit_name(), identity.calibration, identity.sequence);
    let mut running = None;
    for (name, sector) in ["A", "B"].iter().zip(sectors) {
        match sector {
            Ok(c) => {
                let used = c.checksum() == identity.calibration;
                println!(
                    "sector {name}: block {:08x}, number {}, made {} (seconds since 1970){}",
                    c.checksum(),
                    c.sequence,
                    c.created_unix_s,
                    if used { ", in use" } else { "" }
                );
                if used {
                    running = Some(c);
                }
            }
            Err(e) => println!("sector {name}: {e}"),
        }
    }
    match (out, running) {
        (Some(out), Some(c)) => {
            file::save(out, &c)?;
            println!("{}: the block in use", out.display());
            Ok(())
        }
        (Some(_), None) => {
            Err(BadInput::new("the unit runs its compiled-in default; there is no block to write").into())
        }
        (None, _) => Ok(()),
    }
}

/// `hrg monitor`.
pub fn monitor(port: &str, profile: Option<Profile>, snapshot: Option<u32>, out: Option<&Path>) -> Result<()> {
    let mut unit = Unit::open(port)?;
    let mut state = State::default();
    state.identity = Some(unit.identity()?);
    state.profile = profile;
    let name = state.identity.map(|i| i.unit_name().to_string()).unwrap_or_default();
    let mut recorder = out.map(|path| Recorder::new(path, &name));
    if let Some(seconds) = snapshot {
        let mut seen = 0;
        while seen < seconds {
            let message = unit.next(Duration::from_secs(5)).with_context(|| format!("{port} is gone"))?;
            let message = message.ok_or_else(|| BadInput::new("the unit has sent nothing for 5 s; check its power"))?;
            seen += u32::from(matches!(message, Message::Housekeeping(_)));
            state.take(&message);
        }
        print!("{}", monitor::screen(&state)?);
        return Ok(());
    }
    let mut terminal = ratatui::try_init()?;
    let result = (|| -> Result<()> {
        let mut drawn = Instant::now();
        loop {
            match unit.next(Duration::from_millis(50)) {
                Ok(Some(message)) => {
                    state.port_error = None;
                    state.take(&message);
                    if let (Some(recorder), Message::Housekeeping(h)) = (&mut recorder, &message) {
                        recorder.push(&Second::from(h))?;
                    }
                }
                Ok(None) => {}
                Err(e) => {
                    state.port_error = Some(format!("{port} is gone ({e}); waiting for it"));
                    std::thread::sleep(Duration::from_millis(200));
                    if let Ok(again) = Unit::open(port) {
                        unit = again;
                    }
                }
            }
            state.bad_frames = unit.bad_frames;
            if drawn.elapsed() > Duration::from_millis(200) {
                terminal.draw(|f| monitor::draw(f, &state))?;
                drawn = Instant::now();
                while crossterm::event::poll(Duration::ZERO)? {
                    if let crossterm::event::Event::Key(key) = crossterm::event::read()? {
                        let ctrl_c = key.code == KeyCode::Char('c') && key.modifiers.contains(KeyModifiers::CONTROL);
                        if ctrl_c || matches!(key.code, KeyCode::Char('q') | KeyCode::Esc) {
                            return Ok(());
                        }
                    }
                }
            }
        }
    })();
    ratatui::restore();
    if let (Some(recorder), Some(out)) = (&recorder, out) {
        report(recorder, out);
    }
    result
}
