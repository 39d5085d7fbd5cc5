//! A unit on a serial port (or the virtual board's pseudo-terminal): messages in, commands out, a calibration burnt and
//! read back.

use crate::BadInput;
use anyhow::{Context, Result};
use hrg_core::calibration::{Calibration, MAX_BYTES};
use hrg_core::link::{Deframer, Identity, Message};
use hrg_core::maintenance::{chunks, Answer, Command, Reply, CHUNK};
use serialport::SerialPort;
use std::io::{Read, Write};
use std::time::{Duration, Instant};

/// Baud rate of the link.
pub const BAUD: u32 = 921_600;
/// A read that finds nothing comes back after this.
const POLL: Duration = Duration::from_millis(20);
/// An answer comes within this; the erase of a sector takes 2 s at most.
const ANSWER: Duration = Duration::from_secs(6);
/// A command whose answer was lost is sent again.
const TRIES: usize = 3;

/// The link of a unit.
pub struct Unit {
    port: Box<dyn SerialPort>,
    deframer: Deframer,
    buffer: [u8; 4096],
    filled: usize,
    at: usize,
    /// Frames that could not be read.
    pub bad_frames: u64,
}

impl std::fmt::Debug for Unit {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Unit({:?})", self.port.name())
    }
}

impl Unit {
    /// Opens a port.
    ///
    /// # Errors
    /// One sentence, where it cannot be opened.
    pub fn open(path: &str) -> Result<Self, BadInput> {
        let port = serialport::new(path, BAUD).timeout(POLL).open().map_err(|e| {
            BadInput::new(format!("cannot open the port {path}: {e}; check the cable, and who else has it open"))
        })?;
        Ok(Self { port, deframer: Deframer::default(), buffer: [0; 4096], filled: 0, at: 0, bad_frames: 0 })
    }

    /// The next message within a time; `None` if there is none.
    ///
    /// # Errors
    /// Where the port is gone.
    pub fn next(&mut self, within: Duration) -> std::io::Result<Option<Message>> {
        let until = Instant::now() + within;
        loop {
            while self.at < self.filled {
                let byte = self.buffer[self.at];
                self.at += 1;
                match self.deframer.push(byte) {
                    None => {}
                    Some(Ok(message)) => return Ok(Some(message)),
                    Some(Err(_)) => self.bad_frames += 1,
                }
            }
            if Instant::now() >= until {
                return Ok(None);
            }
            (self.at, self.filled) = (0, 0);
            match self.port.read(&mut self.buffer) {
                Ok(0) => return Err(std::io::ErrorKind::UnexpectedEof.into()),
                Ok(n) => self.filled = n,
                Err(e) if matches!(e.kind(), std::io::ErrorKind::TimedOut | std::io::ErrorKind::Interrupted) => {}
                Err(e) => return Err(e),
            }
        }
    }

    /// Sends a message.
    ///
    /// # Errors
    /// Where the port is gone.
    pub fn send(&mut self, message: &Message) -> std::io::Result<()> {
        // A zero first: whatever garbage came before ends there.
        self.port.write_all(&[0])?;
        self.port.write_all(&message.encode())?;
        self.port.flush()
    }

    fn ask<T>(&mut self, message: &Message, within: Duration, pick: impl Fn(&Message) -> Option<T>) -> Result<T> {
        for _ in 0..TRIES {
            self.send(message).context("the port is gone")?;
            let until = Instant::now() + within;
            while let Some(left) = until.checked_duration_since(Instant::now()) {
                match self.next(left).context("the port is gone")? {
                    Some(m) => {
                        if let Some(t) = pick(&m) {
                            return Ok(t);
                        }
                    }
                    None => break,
                }
            }
        }
        Err(BadInput::new("the unit does not answer; check that the port is the unit's link, and its power").into())
    }

    /// Who is there.
    ///
    /// # Errors
    /// Where nobody answers.
    pub fn identity(&mut self) -> Result<Identity> {
        self.ask(&Message::Identify, Duration::from_secs(2), |m| match m {
            Message::Identity(i) => Some(*i),
            _ => None,
        })
    }

    fn maintain(&mut self, command: Command) -> Result<Reply> {
        self.ask(&Message::Maintain(command), ANSWER, |m| match m {
            Message::Maintained(reply) => Some(*reply),
            _ => None,
        })
    }

    /// A command that must be done; gives the number that came with the answer.
    fn done(&mut self, command: Command, what: &str) -> Result<u32> {
        match self.maintain(command)? {
            Reply::Answer(Answer::Done, value) => Ok(value),
            Reply::Answer(answer, _) => Err(BadInput::new(format!("{what}: the unit says: {answer}")).into()),
            Reply::Data { .. } => anyhow::bail!("{what}: the unit answered with data"),
        }
    }

    /// A sector as it lies in flash, as far as a block reaches.
    fn sector(&mut self, sector: u8) -> Result<Vec<u8>> {
        let mut bytes = Vec::with_capacity(MAX_BYTES);
        while bytes.len() < MAX_BYTES {
            let offset = bytes.len() as u16;
            match self.maintain(Command::Read { sector, offset })? {
                Reply::Data { sector: s, offset: o, data } if (s, o) == (sector, offset) => {
                    bytes.extend_from_slice(&data);
                }
                Reply::Data { .. } => {}
                Reply::Answer(answer, _) => {
                    return Err(BadInput::new(format!("sector {sector} cannot be read; the unit says: {answer}")).into())
                }
            }
        }
        Ok(bytes)
    }

    /// Both sectors: the block in each, or why there is none.
    ///
    /// # Errors
    /// Where the unit refuses, or does not answer.
    pub fn read(&mut self) -> Result<(Identity, [Result<Calibration, hrg_core::calibration::BlockError>; 2])> {
        let identity = self.identity()?;
        self.done(Command::Open(identity.unit), "maintenance mode")?;
        let a = self.sector(0);
        let b = self.sector(1);
        self.done(Command::Close, "maintenance mode")?;
        Ok((identity, [Calibration::from_bytes(&a?), Calibration::from_bytes(&b?)]))
    }

    /// Burns a calibration: writes it, has the unit check it, reads it back, restarts the unit and sees that it runs it.
    /// Gives the identity of the unit afterwards. `progress` is told the share done.
    ///
    /// # Errors
    /// One sentence at each step; the block in use stays in use unless all went well.
    pub fn burn(&mut self, calibration: &Calibration, progress: impl Fn(f64)) -> Result<Identity> {
        let identity = self.identity()?;
        let default = Calibration::uncalibrated();
        if calibration.unit != identity.unit && identity.unit != default.unit {
            return Err(BadInput::new(format!(
                "the calibration is of unit {}, the unit on this port is {}; nothing was written",
                calibration.unit_name(),
                identity.unit_name()
            ))
            .into());
        }
        if !calibration.calibrated {
            return Err(BadInput::new("the file holds no calibration, but the default of an uncalibrated unit").into());
        }
        let mut block = calibration.clone();
        block.sequence = identity.sequence.wrapping_add(1);
        let bytes = block.to_bytes().context("the calibration does not fit a block")?;
        let checksum = block.checksum();
        self.done(Command::Open(identity.unit), "maintenance mode")?;
        self.done(Command::Begin(bytes.len() as u16), "erasing")?;
        for (k, chunk) in chunks(&bytes).enumerate() {
            self.done(chunk, "writing")?;
            progress((((k + 1) * CHUNK) as f64 / bytes.len() as f64).min(1.0));
        }
        let said = self.done(Command::End, "checking")?;
        anyhow::ensure!(
            said == checksum,
            "the unit's checksum is {said:08x}, the block's {checksum:08x}; burn it again"
        );
        let back = [self.sector(0)?, self.sector(1)?];
        anyhow::ensure!(
            back.iter().any(|s| s.starts_with(&bytes)),
            "what was read back is not what was written; burn it again"
        );
        self.done(Command::Restart, "restarting")?;
        std::thread::sleep(Duration::from_millis(300));
        let after = self.identity()?;
        anyhow::ensure!(
            after.calibration == checksum,
            "the unit runs block {:08x} after its restart, not {checksum:08x}",
            after.calibration
        );
        Ok(after)
    }
}
