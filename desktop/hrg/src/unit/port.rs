//! A unit on a serial port (or the virtual board's pseudo-terminal): messages in, commands out, a calibration burnt and
//! read back.

use crate::unit::keys;
use crate::unit::named;
use anyhow::{Context, Result};
use ed25519_dalek::SigningKey;
use hrg_core::calibration::{stated_length, Calibration, ImageError, MAX_BYTES};
use hrg_core::events::{records, Record, SECTOR};
use hrg_core::inputs;
use hrg_core::inputs::LEAST_COUNTS_S;
use hrg_core::link::{Deframer, Housekeeping, Identity, Message};
use hrg_core::maintenance::{chunks, Answer, Command, Reply, CHUNK, LOG_PAGE};
use hrg_core::output::OutputSettings;
use hrg_core::sectors::{Place, PAGE};
use hrg_core::self_test::{Check, Item};
use hrg_core::status::{AxisStatus, UnitStatus};
use hrg_core::stopped::Stopped;
use hrg_core::zero::Zero;
use hrg_data::axes::AXIS_NAMES;
use hrg_data::error::BadInput;
use hrg_data::recording::metadata::{same_scale, scale_text};
use hrg_data::recording::names;
use serialport::SerialPort;
use std::io::{Read, Write};
use std::time::{Duration, Instant};

/// Baud rate of the link.
pub const BAUD: u32 = 921_600;
/// A read that finds nothing comes back after this.
const POLL: Duration = Duration::from_millis(20);
/// An answer comes within this. Most come at once; where the unit erases a sector to make room, that takes 2 s at most.
const ANSWER: Duration = Duration::from_secs(6);
/// Checks of parts that a firmware can do without (field log, inputs): each built-in test has a figure of all others.
const OF_PARTS: [Check; 3] = [Check::Log, Check::SupplyVoltage, Check::ChipTemperature];
/// The built-in test takes some five seconds, and longer where a part does not answer.
const TESTED: Duration = Duration::from_secs(25);
/// A command whose answer was lost is sent again.
const TRIES: usize = 3;

/// A port that is gone is looked for again after this.
const AGAIN: Duration = Duration::from_millis(250);

/// Whose name an image gets that is to be burnt.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum NameError {
    /// The unit takes the name of its first image: somebody must say that it is this one's.
    #[error("the unit on this port has no name yet and would take that of the calibration, {image}; if it is that unit, say so with --unit {image}")]
    UnitUnnamed {
        /// The image's name.
        image: String,
    },
    /// Neither has a name.
    #[error("neither the unit on this port nor the calibration has a name; give the unit its own with --unit NAME")]
    BothUnnamed,
    /// The image names nobody.
    #[error("the calibration names no unit, the unit on this port is {unit}; if the calibration is that unit's, say so with --unit {unit}")]
    ImageUnnamed {
        /// The unit's name.
        unit: String,
    },
    /// The image is another unit's.
    #[error("the calibration is of unit {image}, the unit on this port is {unit}; nothing was written")]
    Other {
        /// The image's name.
        image: String,
        /// The unit's name.
        unit: String,
    },
    /// The name that was given is neither's.
    #[error("--unit says {stated}, the {what} on hand is {named}; nothing was written")]
    Stated {
        /// Name that was given.
        stated: String,
        /// The unit or the calibration.
        what: &'static str,
        /// Its name.
        named: String,
    },
    /// The text that was given cannot be a name.
    #[error(transparent)]
    Unfit(#[from] names::NameError),
}

impl From<NameError> for BadInput {
    fn from(e: NameError) -> Self {
        Self(e.to_string())
    }
}

/// The name under which an image may go into a unit. `unit`, `image`: their names, where they have one; `stated`: what the user says.
/// Nothing without a name is ever taken for the right one without the user's word.
///
/// # Errors
/// [`NameError`].
pub fn agreed_name(unit: Option<&str>, image: Option<&str>, stated: Option<&str>) -> Result<String, NameError> {
    let own = String::from;
    if let Some(stated) = stated {
        names::check(stated)?;
        for (what, named) in [("unit", unit), ("calibration", image)] {
            if let Some(named) = named.filter(|n| *n != stated) {
                return Err(NameError::Stated { stated: own(stated), what, named: own(named) });
            }
        }
        return Ok(own(stated));
    }
    match (unit, image) {
        (Some(unit), Some(image)) if unit == image => Ok(own(unit)),
        (Some(unit), Some(image)) => Err(NameError::Other { image: own(image), unit: own(unit) }),
        (None, Some(image)) => Err(NameError::UnitUnnamed { image: own(image) }),
        (Some(unit), None) => Err(NameError::ImageUnnamed { unit: own(unit) }),
        (None, None) => Err(NameError::BothUnnamed),
    }
}

/// The name of a unit; `None` where it has none yet.
#[must_use]
pub fn name_of(identity: &Identity) -> Option<&str> {
    Some(identity.unit_name()).filter(|n| !names::is_unnamed(n))
}

/// Calibration that a unit computes with.
#[derive(Debug, Clone, PartialEq)]
pub enum InUse {
    /// Default that it was built with: its flash holds no valid image.
    Default,
    /// The image in its flash.
    Image(Box<Calibration>),
    /// It does not let anybody read it: its firmware is built without maintenance mode.
    Locked,
}

impl InUse {
    /// The scale factor that makes its rates, deg/h per code; `None` where it cannot be read.
    #[must_use]
    pub fn scale_factor(&self) -> Option<[f32; 3]> {
        match self {
            Self::Default => Some(Calibration::uncalibrated().scale_factors_dph_per_code()),
            Self::Image(c) => Some(c.scale_factors_dph_per_code()),
            Self::Locked => None,
        }
    }

    /// `true` if it is known to correct no specific force.
    #[must_use]
    pub fn leaves_forces_raw(&self) -> bool {
        match self {
            Self::Default => true,
            Self::Image(c) => c.specific_force.is_none(),
            Self::Locked => false,
        }
    }
}

/// An image in the unit's flash: its place, and what was read there.
pub type At = (Place, Result<Calibration, ImageError>);

/// Contents of a unit as it reports them.
#[derive(Debug, Clone)]
pub struct Held {
    /// Identity, and the image that it runs.
    pub identity: Identity,
    /// Its images; `None` where it does not let anybody read them.
    pub images: Option<Images>,
}

/// The images of a unit.
#[derive(Debug, Clone, PartialEq)]
pub struct Images {
    /// The one that it runs; `None`: the default that it was built with.
    pub in_use: Option<At>,
    /// The newest one, which it runs from its next start on.
    pub newest: Option<At>,
}

impl std::fmt::Display for Held {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let i = &self.identity;
        match i.calibration {
            0 => write!(f, "asked now, the unit runs the default it was built with; ")?,
            c => write!(f, "asked now, unit {} runs image {c:08x}, number {}; ", i.unit_name(), i.sequence)?,
        }
        let Some(images) = &self.images else {
            return write!(f, "it does not let its images be read");
        };
        match &images.newest {
            Some((place, Ok(c))) if c.checksum() != i.calibration => write!(
                f,
                "from its next start on it runs image {:08x} of unit {}, number {} ({place})",
                c.checksum(),
                c.unit_name(),
                c.sequence
            ),
            Some((place, Err(e))) => write!(f, "its newest image ({place}) cannot be used: {e}"),
            None if i.calibration != 0 => write!(f, "from its next start on it runs the default"),
            _ => write!(f, "a restart changes nothing"),
        }
    }
}

/// A burn that failed.
#[derive(Debug)]
pub struct BurnError {
    /// Why.
    pub why: anyhow::Error,
    /// Set if the unit's flash may have been written to. Then [`Unit::held`] tells what is there.
    pub begun: bool,
}

impl BurnError {
    fn before(why: impl Into<anyhow::Error>) -> Self {
        Self { why: why.into(), begun: false }
    }

    fn after(why: anyhow::Error) -> Self {
        Self { why, begun: true }
    }
}

/// A burn that is done.
#[derive(Debug, Clone)]
pub struct Burnt {
    /// The unit after its restart.
    pub identity: Identity,
    /// The image that it ran before; `None`: the default, or one that cannot be read.
    pub before: Option<Calibration>,
}

/// Statements of the user for a burn.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Burn {
    /// The unit's name.
    pub unit: Option<String>,
    /// The scale factor in the unit is to be replaced by another.
    pub new_scale_factor: bool,
    /// The key that signs the image, for firmware that wants it.
    pub key: Option<SigningKey>,
}

/// Within this the next second of a unit comes, whatever it is busy with.
const SECOND: Duration = Duration::from_secs(5);
/// Within this a unit that has started measures: some seconds for the first frequencies, and as many for their slope.
const STARTED: Duration = Duration::from_secs(12);
/// Temperatures that a resonator or its sensor can have, C.
const POSSIBLE_C: std::ops::RangeInclusive<f64> = -90.0..=130.0;

/// Flags of an axis with which it sends no bias of its image.
const USELESS: AxisStatus =
    AxisStatus::UNCALIBRATED.union(AxisStatus::FREQUENCY_LOST).union(AxisStatus::TEMPERATURE_STALE);
/// Flags of a unit that no image cures, but that a burn must not hide.
const BROKEN: UnitStatus = UnitStatus::DEFAULT_CALIBRATION
    .union(UnitStatus::IMAGE_REFUSED)
    .union(UnitStatus::ADC_FAULT)
    .union(UnitStatus::TIMEBASE)
    .union(UnitStatus::PROGRAM);

/// Flags of a unit that make its rates useless, with their axes; `None` if there are none.
fn unusable(h: &Housekeeping) -> Option<String> {
    let mut shown: Vec<String> = Vec::new();
    for (status, name) in h.axis_status.iter().zip(AXIS_NAMES) {
        let flags = status.intersection(USELESS);
        shown.extend(named(flags.bits(), &AxisStatus::NAMES).map(|flag| format!("{flag} on {name}")));
    }
    shown.extend(named(h.unit_status.intersection(BROKEN).bits(), &UnitStatus::NAMES).map(String::from));
    (!shown.is_empty()).then(|| hrg_data::error::list(&shown))
}

/// The identity that a message tells.
fn identity_in(message: &Message) -> Option<Identity> {
    match message {
        Message::Identity(identity) => Some(*identity),
        _ => None,
    }
}

/// Time within which word of a stop follows an identity.
const STOPPED: Duration = Duration::from_millis(500);

/// The link of a unit.
pub struct Unit {
    path: String,
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
            let ports: Vec<String> =
                serialport::available_ports().unwrap_or_default().into_iter().map(|p| p.port_name).collect();
            let there = match ports.join(", ") {
                none if none.is_empty() => {
                    "no serial port is there (without a unit: hrg-board serve --folder DIR, then the port is DIR/link)"
                        .into()
                }
                some => format!("the ports that are there: {some}"),
            };
            BadInput::new(format!(
                "cannot open the port {path}: {e}; check the cable, and who else has it open; {there}"
            ))
        })?;
        // (An identity that another program has asked for may still wait there.)
        let _ = port.clear(serialport::ClearBuffer::Input);
        Ok(Self {
            path: path.into(),
            port,
            deframer: Deframer::default(),
            buffer: [0; 4096],
            filled: 0,
            at: 0,
            bad_frames: 0,
        })
    }

    /// The next message within a time; `None` if there is none.
    ///
    /// # Errors
    /// If the port is gone.
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
    /// If the port is gone.
    pub fn send(&mut self, message: &Message) -> std::io::Result<()> {
        // A zero first: whatever garbage came before ends there.
        self.port.write_all(&[0])?;
        self.port.write_all(&message.encode())?;
        self.port.flush()
    }

    fn ask<T>(&mut self, message: &Message, within: Duration, pick: impl Fn(&Message) -> Option<T>) -> Result<T> {
        for _ in 0..TRIES {
            if let Some(answer) = self.ask_once(message, within, &pick)? {
                return Ok(answer);
            }
        }
        Err(BadInput::new("the unit does not answer; check that the port is the unit's link, and its power").into())
    }

    /// Sends a message and waits for its answer; `None`: none comes.
    pub(super) fn ask_once<T>(
        &mut self,
        message: &Message,
        within: Duration,
        pick: impl Fn(&Message) -> Option<T>,
    ) -> Result<Option<T>> {
        self.send(message).context("the port is gone")?;
        let until = Instant::now() + within;
        while let Some(left) = until.checked_duration_since(Instant::now()) {
            match self.next(left).context("the port is gone")? {
                None => break,
                Some(m) => {
                    let picked = pick(&m);
                    if picked.is_some() {
                        return Ok(picked);
                    }
                }
            }
        }
        Ok(None)
    }

    /// Asks for the unit's identity, once; `None`: it does not answer in time.
    ///
    /// # Errors
    /// If the port is gone.
    pub fn identity_within(&mut self, within: Duration) -> Result<Option<Identity>> {
        self.ask_once(&Message::Identify, within, identity_in)
    }

    /// Has the unit test itself; gives its name and the items.
    ///
    /// # Errors
    /// If the unit does not answer, does not open its maintenance mode, or has no built-in test.
    pub fn self_test(&mut self) -> Result<(String, Vec<Item>)> {
        let identity = self.reconnect(Duration::ZERO)?;
        self.done(Command::Open(identity.unit), "maintenance mode")?;
        let items = self.test_items();
        self.done(Command::Close, "maintenance mode")?;
        Ok((identity.unit_name().to_string(), items?))
    }

    fn test_items(&mut self) -> Result<Vec<Item>> {
        let done = self.ask_once(&Message::Maintain(Command::Test), TESTED, |m| match m {
            Message::Maintained(Reply::TestDone(items)) => Some(Ok(*items)),
            Message::Maintained(Reply::Answer(answer, _)) if *answer != Answer::Done => Some(Err(*answer)),
            _ => None,
        })?;
        let refused = |why: String| Err(BadInput::new(format!("the built-in test: {why}")).into());
        let count = match done {
            Some(Ok(count)) => count,
            Some(Err(answer)) => return refused(format!("the unit says: {answer}")),
            None => {
                return refused(format!(
                    "no result within {} s; the unit may have started anew: hrg unit events",
                    TESTED.as_secs()
                ))
            }
        };
        let mut items = Vec::with_capacity(count.into());
        for number in 0..count {
            items.push(self.ask(&Message::Maintain(Command::Tested(number)), ANSWER, |m| match m {
                Message::Maintained(Reply::Tested { number: n, item }) if *n == number => Some(*item),
                _ => None,
            })?);
        }
        // (What passes has been tested.)
        let mut wanted = Check::ALL.into_iter().filter(|check| !OF_PARTS.contains(check));
        if let Some(missing) = wanted.find(|check| items.iter().all(|i| i.check != *check)) {
            return refused(format!("it has no figure of {}; ask again", missing.facts().name));
        }
        Ok(items)
    }

    /// Asks for the unit's identity.
    ///
    /// # Errors
    /// If no unit answers.
    pub fn identity(&mut self) -> Result<Identity> {
        self.ask(&Message::Identify, Duration::from_secs(2), identity_in)
    }

    pub(super) fn maintain(&mut self, command: Command) -> Result<Reply> {
        self.ask(&Message::Maintain(command), ANSWER, |m| match m {
            // (A test that somebody else has asked for may end meanwhile.)
            Message::Maintained(Reply::TestDone(_) | Reply::Tested { .. }) => None,
            Message::Maintained(reply) => Some(*reply),
            _ => None,
        })
    }

    /// A command that must be done; gives the number that came with the answer.
    pub(super) fn done(&mut self, command: Command, what: &str) -> Result<u32> {
        match self.maintain(command)? {
            Reply::Answer(Answer::Done, value) => Ok(value),
            Reply::Answer(Answer::Input, number) => {
                let name = inputs::NAMES.get(number as usize).unwrap_or(&"of an unknown number");
                let advice = "trace with --inputs that names what the unit has, or give it the input (docs/inputs.md)";
                Err(BadInput::new(format!(
                    "{what}: the image needs the input {name}, which this unit does not have; {advice}"
                ))
                .into())
            }
            Reply::Answer(answer, _) => Err(BadInput::new(format!("{what}: the unit says: {answer}")).into()),
            Reply::Data { .. } | Reply::Tested { .. } | Reply::TestDone(_) => {
                anyhow::bail!("{what}: the unit answered with data")
            }
        }
    }

    /// Bytes of the unit's flash.
    fn flash(&mut self, from: Place, length: usize) -> Result<Vec<u8>> {
        let mut bytes = Vec::with_capacity(length + CHUNK);
        while bytes.len() < length {
            let (page, offset) = Place { offset: from.offset + bytes.len() as u32, ..from }.in_page();
            match self.maintain(Command::Read { page, offset })? {
                Reply::Data { page: p, offset: o, data } if (p, o) == (page, offset) => {
                    bytes.extend_from_slice(&data);
                }
                Reply::Data { .. } | Reply::Tested { .. } | Reply::TestDone(_) => {}
                Reply::Answer(answer, _) => {
                    return Err(BadInput::new(format!("{from} cannot be read; the unit says: {answer}")).into())
                }
            }
        }
        bytes.truncate(length);
        Ok(bytes)
    }

    /// Word of the stop before the unit's last start; `None`: there was none.
    ///
    /// # Errors
    /// If the unit does not answer.
    pub fn last_stop(&mut self) -> Result<Option<Stopped>> {
        self.reconnect(Duration::ZERO)?;
        let until = Instant::now() + STOPPED;
        while let Some(left) = until.checked_duration_since(Instant::now()) {
            if let Some(Message::Stopped(stopped)) = self.next(left).context("the port is gone")? {
                return Ok(Some(stopped));
            }
        }
        Ok(None)
    }

    /// The field log, oldest event first.
    ///
    /// # Errors
    /// If the unit does not answer, or does not open its maintenance mode.
    pub fn events(&mut self) -> Result<Vec<Record>> {
        let identity = self.reconnect(Duration::ZERO)?;
        self.done(Command::Open(identity.unit), "maintenance mode")?;
        let log = self.log();
        self.done(Command::Close, "maintenance mode")?;
        Ok(records(&log?).collect())
    }

    /// `true` if an axis is flagged for want of an input, after the seconds in which they come.
    ///
    /// # Errors
    /// If the unit sends nothing.
    pub fn flags_inputs(&mut self) -> Result<bool> {
        let mut flagged = false;
        for _ in 0..LEAST_COUNTS_S {
            flagged = self.second(SECOND)?.axis_status.iter().any(|s| s.contains(AxisStatus::INPUT));
            if !flagged {
                break;
            }
        }
        Ok(flagged)
    }

    /// Has the unit add these constants from now on, over power cuts.
    ///
    /// # Errors
    /// If the unit does not answer, or refuses them.
    pub fn set_zero(&mut self, zero: &Zero) -> Result<()> {
        self.set(Command::Zero(*zero), "the constants")
    }

    /// Has the unit send by these settings from now on, over power cuts.
    ///
    /// # Errors
    /// As [`set_zero`](Self::set_zero).
    pub fn set_output(&mut self, settings: &OutputSettings) -> Result<()> {
        self.set(Command::Output(*settings), "the settings")
    }

    /// A command of the maintenance mode that sets something, in the mode.
    fn set(&mut self, command: Command, what: &str) -> Result<()> {
        let identity = self.reconnect(Duration::ZERO)?;
        self.done(Command::Open(identity.unit), "maintenance mode")?;
        let taken = self.done(command, what);
        self.done(Command::Close, "maintenance mode")?;
        taken.map(drop)
    }

    /// The field log as far as it is written.
    fn log(&mut self) -> Result<Vec<u8>> {
        let mut bytes = Vec::with_capacity(SECTOR);
        while bytes.len() < SECTOR && !bytes.ends_with(&[0xFF; CHUNK]) {
            let page = LOG_PAGE + (bytes.len() / PAGE) as u8;
            let offset = (bytes.len() % PAGE) as u16;
            match self.maintain(Command::Read { page, offset })? {
                Reply::Data { page: p, offset: o, data } if (p, o) == (page, offset) => bytes.extend_from_slice(&data),
                Reply::Data { .. } | Reply::Tested { .. } | Reply::TestDone(_) => {}
                Reply::Answer(answer, _) => {
                    return Err(BadInput::new(format!("the field log cannot be read; the unit says: {answer}")).into())
                }
            }
        }
        Ok(bytes)
    }

    /// The image at a place; `number` is what the unit calls the place.
    fn image_at(&mut self, number: u32) -> Result<Option<At>> {
        let Some(place) = Place::from_number(number) else { return Ok(None) };
        let head = self.flash(place, CHUNK)?;
        let length = stated_length(&head).unwrap_or(0).clamp(CHUNK, MAX_BYTES);
        let bytes = self.flash(place, length)?;
        Ok(Some((place, Calibration::from_bytes(&bytes))))
    }

    /// Images that it runs and will run, in maintenance mode, which was opened with this answer.
    fn images(&mut self, opened: u32) -> Result<Images> {
        let in_use = self.image_at(opened)?;
        let newest = self.done(Command::Newest, "asking for the newest image")?;
        let newest = if newest == opened { in_use.clone() } else { self.image_at(newest)? };
        Ok(Images { in_use, newest })
    }

    /// Asks who is there, for as long as `within`; the port is opened anew where that is possible.
    ///
    /// # Errors
    /// If the port does not come back, or no unit answers on it.
    pub fn reconnect(&mut self, within: Duration) -> Result<Identity> {
        let until = Instant::now() + within;
        loop {
            let answer = self.identity();
            if answer.is_ok() || Instant::now() >= until {
                return answer;
            }
            std::thread::sleep(AGAIN);
            // (A port that is still there is ours, and is not opened twice.)
            if let Ok(again) = Self::open(&self.path) {
                *self = Self { bad_frames: self.bad_frames, ..again };
            }
        }
    }

    /// Asks the unit for its identity and the contents of its flash; first it is looked for, for as long as `within`.
    ///
    /// # Errors
    /// If it does not answer.
    pub fn held(&mut self, within: Duration) -> Result<Held> {
        let identity = self.reconnect(within)?;
        let images = match self.maintain(Command::Open(identity.unit))? {
            Reply::Answer(Answer::Done, opened) => {
                let images = self.images(opened);
                self.done(Command::Close, "maintenance mode")?;
                Some(images?)
            }
            _ => None,
        };
        Ok(Held { identity, images })
    }

    /// Calibration that a unit computes with.
    ///
    /// # Errors
    /// If it does not answer.
    pub fn in_use(&mut self, identity: &Identity) -> Result<InUse> {
        if identity.calibration == 0 {
            return Ok(InUse::Default);
        }
        let opened = match self.maintain(Command::Open(identity.unit))? {
            Reply::Answer(Answer::Done, opened) => opened,
            Reply::Answer(Answer::Locked, _) => return Ok(InUse::Locked),
            other => return Err(BadInput::new(format!("maintenance mode: the unit says: {other:?}")).into()),
        };
        let found = self.image_at(opened);
        self.done(Command::Close, "maintenance mode")?;
        let image = found?.and_then(|(_, image)| image.ok()).filter(|c| c.checksum() == identity.calibration);
        Ok(image.map_or(InUse::Locked, |c| InUse::Image(Box::new(c))))
    }

    /// Reads its identity and its images.
    ///
    /// # Errors
    /// If the unit refuses, or does not answer.
    pub fn read(&mut self) -> Result<(Identity, Images)> {
        let identity = self.identity()?;
        let opened = self.done(Command::Open(identity.unit), "maintenance mode")?;
        let images = self.images(opened);
        self.done(Command::Close, "maintenance mode")?;
        Ok((identity, images?))
    }

    /// The next second of the unit.
    ///
    /// # Errors
    /// If none comes.
    pub fn second(&mut self, within: Duration) -> Result<Housekeeping> {
        let until = Instant::now() + within;
        while let Some(left) = until.checked_duration_since(Instant::now()) {
            match self.next(left).context("the port is gone")? {
                Some(Message::Housekeeping(h)) => return Ok(h),
                Some(_) => {}
                None => break,
            }
        }
        Err(BadInput::new("the unit sends no housekeeping; check its power, and that the port is its link (one that sends MAVLink sends none: hrg unit output --framing own)").into())
    }

    /// Refuses a calibration whose curves make no temperature of what the unit reads now: one of sensors for a unit of resonators,
    /// one in kHz, or that of another unit. An axis whose frequency is lost says nothing.
    fn curves_fit(&mut self, image: &Calibration) -> Result<()> {
        let now = self.second(SECOND)?;
        for (a, name) in AXIS_NAMES.iter().enumerate() {
            let reading = now.frequency_hz[a];
            let temperature = f64::from(image.axes[a].curve.temperature_c(reading));
            if reading > 0.0 && !POSSIBLE_C.contains(&temperature) {
                let own = f64::from(now.temperature_c[a]);
                return Err(BadInput::new(format!(
                    "axis {name}: the unit reads {reading:.3} now ({own:.1} C by its own curve), which is {temperature:.0} C by the curve of this calibration ({}); it is not of this unit: nothing was written",
                    if image.axes[a].curve.is_of_sensor() { "one of a temperature sensor" } else { "one of a resonator" }
                ))
                .into());
            }
        }
        Ok(())
    }

    /// Waits until a unit that has just started shows rates that can be used; gives the flags that stay on.
    ///
    /// # Errors
    /// If the port is gone.
    pub fn shows(&mut self) -> Result<Option<String>> {
        let until = Instant::now() + STARTED;
        loop {
            let h = self.second(SECOND)?;
            let flags = unusable(&h);
            if flags.is_none() || Instant::now() >= until {
                return Ok(flags);
            }
        }
    }

    /// Burns a calibration: writes it, has the unit check it, reads it back, restarts the unit and sees that it runs it.
    /// Gives the unit as it is afterwards. `progress` is told the share done.
    ///
    /// # Errors
    /// [`BurnError`]: before the flash was touched (names, scale factors, an empty image), or in the middle of it.
    pub fn burn(
        &mut self,
        calibration: &Calibration,
        stated: &Burn,
        progress: impl Fn(f64),
    ) -> Result<Burnt, BurnError> {
        if !calibration.calibrated {
            let empty = "the file holds no calibration, but the default of an uncalibrated unit; nothing was written";
            return Err(BurnError::before(BadInput::new(empty)));
        }
        let identity = self.identity().map_err(BurnError::before)?;
        let name = agreed_name(name_of(&identity), names::of(calibration), stated.unit.as_deref())
            .map_err(|e| BurnError::before(BadInput::from(e)))?;
        let mut image = calibration.clone();
        image.set_unit_name(&name);
        if !stated.new_scale_factor {
            self.same_scale(&identity, &image).map_err(BurnError::before)?;
        }
        self.curves_fit(&image).map_err(BurnError::before)?;
        let opened = self.done(Command::Open(identity.unit), "maintenance mode").map_err(BurnError::before)?;
        // An image that was burnt since the last start is newer than the one in use.
        let Images { in_use, newest } = self.images(opened).map_err(BurnError::before)?;
        let before = in_use.and_then(|(_, image)| image.ok());
        let newest = match newest {
            Some((_, Ok(newest))) => newest.sequence,
            _ => identity.sequence,
        };
        image.sequence = newest.wrapping_add(1);
        let bytes = image.to_bytes().context("the calibration does not fit an image").map_err(BurnError::before)?;
        let bytes = match &stated.key {
            Some(key) => keys::sign(&bytes, key),
            None => bytes.to_vec(),
        };
        let identity = self.write(&bytes, image.checksum(), progress).map_err(BurnError::after)?;
        Ok(Burnt { identity, before })
    }

    /// An image of another scale factor would change every rate of the unit: its recording was made with another one.
    fn same_scale(&mut self, identity: &Identity, image: &Calibration) -> Result<()> {
        let InUse::Image(own) = self.in_use(identity)? else { return Ok(()) };
        let (own, new) = (own.scale_factors_dph_per_code(), image.scale_factors_dph_per_code());
        anyhow::ensure!(
            same_scale(&own, &new),
            BadInput::new(format!(
                "the unit's scale factor is {} deg/h per code (x y z), the calibration's {}: it was made from rates of another scale; fit it with --scale-factor or --base, or give --new-scale-factor if the unit's is to change; nothing was written",
                scale_text(&own),
                scale_text(&new)
            ))
        );
        Ok(())
    }

    /// Writes an image (and its signature), in maintenance mode.
    fn write(&mut self, bytes: &[u8], checksum: u32, progress: impl Fn(f64)) -> Result<Identity> {
        let place = self.done(Command::Begin(bytes.len() as u16), "making room")?;
        let place = Place::from_number(place).context("the unit names no place for the image")?;
        for (k, chunk) in chunks(bytes).enumerate() {
            self.done(chunk, "writing")?;
            progress((((k + 1) * CHUNK) as f64 / bytes.len() as f64).min(1.0));
        }
        let reported = self.done(Command::End, "checking")?;
        anyhow::ensure!(
            reported == checksum,
            "the unit's checksum is {reported:08x}, the image's {checksum:08x}; burn it again"
        );
        anyhow::ensure!(
            self.flash(place, bytes.len())? == bytes,
            "what was read back is not what was written; burn it again"
        );
        self.done(Command::Restart, "restarting")?;
        std::thread::sleep(Duration::from_millis(300));
        let after = self.identity()?;
        anyhow::ensure!(
            after.calibration == checksum,
            "the unit runs image {:08x} after its restart, not {checksum:08x}",
            after.calibration
        );
        Ok(after)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_without_a_name_is_taken_for_the_right_one() {
        let (a, b) = (Some("HRG-7"), Some("HRG-8"));
        for (unit, image, stated, wanted) in [
            (a, a, None, Ok("HRG-7")),
            (a, a, a, Ok("HRG-7")),
            (None, a, a, Ok("HRG-7")),
            (a, None, a, Ok("HRG-7")),
            (None, None, a, Ok("HRG-7")),
            (None, a, None, Err("--unit HRG-7")),
            (a, None, None, Err("--unit HRG-7")),
            (None, None, None, Err("--unit NAME")),
            (a, b, None, Err("the calibration is of unit HRG-8, the unit on this port is HRG-7; nothing was written")),
            (a, b, a, Err("the calibration on hand is HRG-8")),
            (a, b, b, Err("the unit on hand is HRG-7")),
            (None, a, b, Err("the calibration on hand is HRG-7")),
            (a, None, b, Err("the unit on hand is HRG-7")),
            (None, None, Some("default"), Err("without a name")),
            (None, None, Some("HRG 7"), Err("no blanks")),
        ] {
            match (agreed_name(unit, image, stated), wanted) {
                (Ok(name), Ok(wanted)) => assert_eq!(name, wanted),
                (Err(e), Err(wanted)) => assert!(e.to_string().contains(wanted), "{unit:?} {image:?} {stated:?}: {e}"),
                (other, _) => panic!("{unit:?} {image:?} {stated:?}: {other:?}"),
            }
        }
    }
}
