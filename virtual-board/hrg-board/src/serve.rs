//! The virtual board live: its link and its log on pseudo-terminals, in real or scaled time.

use crate::replay::{CALIBRATION_A, CALIBRATION_B, FIELD_LOG};
use crate::wires::{Received, Wires};
use anyhow::{Context, Result};
use hrg_core::calibration::Calibration;
use hrg_core::sectors::SECTOR_BYTES as SECTOR;
use hrg_data::log::Decoder;
use hrg_data::recording::steps::Steps;
use nix::fcntl::{fcntl, FcntlArg, OFlag};
use serialport::{SerialPort, TTYPort};
use std::io::{Read, Write};
use std::os::fd::AsRawFd as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use virtual_board::{Board, Stop, CPU_HZ};

/// Options of the server.
#[derive(Debug, Clone)]
pub struct Options {
    /// Target seconds per second here.
    pub speed: f64,
    /// Stop after so many target seconds.
    pub seconds: Option<u64>,
    /// Folder for the links `link` and `log` to the pseudo-terminals, and for the flash that stays when the board is off.
    pub folder: PathBuf,
    /// A fault of the program restarts the unit, and does not end the run.
    pub as_on_chip: bool,
}

/// Sectors that stay when the board is off, as offsets in flash: calibrations, field log.
const SECTORS: [u32; 3] = [CALIBRATION_A, CALIBRATION_B, FIELD_LOG];
/// The board runs in slices of this.
const SLICE: Duration = Duration::from_millis(20);

/// A pseudo-terminal: our end, and the other end held open so that readers may come and go.
struct Pty {
    ours: TTYPort,
    _theirs: TTYPort,
}

impl Pty {
    fn new(link: &Path) -> Result<Self> {
        let (mut ours, theirs) = TTYPort::pair().context("no pseudo-terminal is to be had")?;
        ours.set_timeout(Duration::ZERO)?;
        // A write of more than there is room for would wait for a reader, for ever where there is none.
        fcntl(ours.as_raw_fd(), FcntlArg::F_SETFL(OFlag::O_NONBLOCK)).context("a pseudo-terminal that waits")?;
        let name = theirs.name().context("the pseudo-terminal has no name")?;
        let _ = std::fs::remove_file(link);
        std::os::unix::fs::symlink(&name, link).with_context(|| format!("cannot make {}", link.display()))?;
        println!("{} -> {name}", link.display());
        Ok(Self { ours, _theirs: theirs })
    }

    /// Writes as much as there is room for: who does not read loses it, as on a wire.
    fn write(&mut self, mut bytes: &[u8]) {
        while !bytes.is_empty() {
            match self.ours.write(bytes) {
                Ok(n) if n > 0 => bytes = &bytes[n..],
                _ => return,
            }
        }
    }
}

/// Runs the board until `stop` is set, the time is over, or the recording ends.
///
/// # Errors
/// If there is no pseudo-terminal, or the firmware does something that the board does not model.
pub fn serve(
    elf: &[u8],
    calibration: Option<&Calibration>,
    steps: &Steps,
    options: &Options,
    stop: &AtomicBool,
) -> Result<()> {
    std::fs::create_dir_all(&options.folder).with_context(|| format!("cannot make {}", options.folder.display()))?;
    let mut link = Pty::new(&options.folder.join("link"))?;
    let mut log = Pty::new(&options.folder.join("log"))?;
    let flash = options.folder.join("flash.bin");
    let used = calibration.cloned().unwrap_or_else(Calibration::uncalibrated);
    let scale = used.scale_factors_dph_per_code();
    let wires = Wires::new(steps.clone(), scale, 20e-9, 1, None, Some(Decoder::new(elf)?))
        .live()
        .with_inputs(steps.unit_inputs);
    let mut board = Board::new(elf, wires)?;
    if options.as_on_chip {
        board.faults_as_on_chip();
    }
    match (calibration, std::fs::read(&flash)) {
        (Some(c), _) => {
            board.write_flash(CALIBRATION_A, &c.to_bytes().context("the calibration does not fit an image")?)?;
        }
        (None, Ok(image)) if image.len() % SECTOR == 0 => {
            for (at, sector) in SECTORS.iter().zip(image.chunks(SECTOR)) {
                board.write_flash(*at, sector)?;
            }
            println!("{}: flash as it was when the board was last on", flash.display());
        }
        _ => {}
    }
    let end = options.seconds.unwrap_or(u64::MAX).min(steps.len() as u64) * CPU_HZ;
    let per_slice = (SLICE.as_secs_f64() * options.speed * CPU_HZ as f64) as u64;
    let mut due = Instant::now();
    let mut buffer = [0; 512];
    println!("running; Ctrl-C ends it");
    while !stop.load(Ordering::Relaxed) && board.now() < end {
        loop {
            match link.ours.read(&mut buffer) {
                Ok(n) if n > 0 => board.world.hear(&buffer[..n]),
                _ => break,
            }
        }
        board.poll_link();
        let target = board.now() + per_slice;
        while board.run_until(target)? != Stop::Time {
            println!("the unit was reset (watchdog or restart)");
        }
        link.write(&board.world.printed());
        for line in board.world.received.log.drain(..) {
            log.write(format!("{line}\r\n").as_bytes());
        }
        // Frames that have gone out are not kept: a board may be on for days.
        board.world.received = Received::default();
        due += SLICE;
        match due.checked_duration_since(Instant::now()) {
            Some(wait) => std::thread::sleep(wait),
            // Slower than asked for: it goes on as fast as it can.
            None => due = Instant::now(),
        }
    }
    let mut image = vec![0; SECTORS.len() * SECTOR];
    for (at, sector) in SECTORS.iter().zip(image.chunks_mut(SECTOR)) {
        board.read_memory(virtual_board::FLASH_START + at, sector)?;
    }
    hrg_data::output::write_file(&flash, &image)?;
    for name in ["link", "log"] {
        let _ = std::fs::remove_file(options.folder.join(name));
    }
    println!(
        "stopped after {:.0} s of the unit's time; the contents of its flash are in {}",
        board.now() as f64 / CPU_HZ as f64,
        flash.display()
    );
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::Pty;
    use std::io::Read as _;
    use std::sync::mpsc;
    use std::time::Duration;

    #[test]
    fn who_does_not_read_loses_bytes_and_stops_nobody() {
        let link = std::env::temp_dir().join(format!("hrg-board-pty-{}", std::process::id()));
        let mut pty = Pty::new(&link).expect("a pseudo-terminal");
        // A reader that comes and goes; its settings of the line stay.
        drop(serialport::new(link.to_string_lossy(), 115_200).open_native().expect("opens"));
        let (done, ended) = mpsc::channel();
        std::thread::spawn(move || {
            (0..50).for_each(|_| pty.write(&[0x55; 4925]));
            let _ = done.send(pty);
        });
        let mut pty = ended.recv_timeout(Duration::from_secs(20)).expect("a write with no reader ends");
        let mut some = [0; 64];
        assert!(pty._theirs.read(&mut some).is_ok_and(|n| n > 0), "what there was room for is there to be read");
        let _ = std::fs::remove_file(link);
    }
}
