//! Commands for the chamber: a unit on a port, or its log.

use crate::facts::Place;
use anyhow::{Context, Result};
use clap::Args;
use crossterm::event::{KeyCode, KeyModifiers};
use hrg::unit::events;
use hrg::unit::keys;
use hrg::unit::monitor;
use hrg::unit::monitor::State;
use hrg::unit::port::{agreed_name, name_of, At, Burn, Burnt, NameError, Unit};
use hrg::unit::record::Recorder;
use hrg::unit::sensors;
use hrg::unit::sensors::Sensors;
use hrg::unit::symbols::Symbols;
use hrg::unit::zero::Measured;
use hrg_core::calibration::{Calibration, MAX_BYTES};
use hrg_core::inputs::{self, InputValues, IN_MESSAGE};
use hrg_core::link::{Housekeeping, Identity, Message};
use hrg_core::option_bytes;
use hrg_core::sectors::{room, SECTOR_BYTES};
use hrg_core::zero::{self, Zero};
use hrg_data::error::BadInput;
use hrg_data::image_file;
use hrg_data::recording::metadata::{same_scale, scale_factor, scale_text};
use hrg_data::recording::{names, names_of};
use hrg_simulate::Profile;
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

/// The first inputs are waited for so long.
const FEED_WITHIN: Duration = Duration::from_secs(10);

/// Set by Ctrl-C, for as many recordings as the program makes.
fn interrupted() -> Result<Arc<AtomicBool>> {
    static FLAG: OnceLock<Arc<AtomicBool>> = OnceLock::new();
    if let Some(flag) = FLAG.get() {
        return Ok(flag.clone());
    }
    let flag = FLAG.get_or_init(Arc::default).clone();
    let set = flag.clone();
    ctrlc::set_handler(move || set.store(true, Ordering::Relaxed))?;
    Ok(flag)
}

/// Facts of the unit in a recording, and sensors recorded beside it.
#[derive(Args, Clone, Debug, Default)]
pub struct RecordArguments {
    /// Name of the unit, where it has none yet (or its log does not tell).
    #[arg(long)]
    pub(crate) unit: Option<String>,
    #[command(flatten)]
    place: Place,
    /// Scale factor that makes the unit's rates, deg/h per code, where it cannot be read from the unit.
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    scale_factor: Option<String>,
    /// Thermometer of the unit: frequency (resonators), or sensor (firmware with the feature sensors)
    #[arg(long, default_value = "frequency")]
    thermometer: String,
    /// Sensors on the cases and in the chamber: lines like "case_x_c=23.5 chamber_c=25.1" from a file, a pipe or a port (PORT@BAUD)
    #[arg(long, value_name = "FILE|PORT")]
    case_sensors: Option<String>,
    /// Inputs beside the frequencies to send to the unit: lines like "drive_x_v=1.21 quad_x_v=0.08" from a file, a pipe or a port
    /// (PORT@BAUD), at least one a second
    #[arg(long, value_name = "FILE|PORT")]
    inputs: Option<String>,
}

impl RecordArguments {
    /// Inputs to be sent to the unit.
    fn feed(&self) -> Result<Option<Sensors>, BadInput> {
        self.inputs.as_deref().map(|source| Sensors::open_for(source, sensors::names_of_inputs())).transpose()
    }

    /// A recorder with all of it but the unit's own part. `live`: the unit runs now.
    pub(crate) fn recorder(&self, out: &Path, live: bool) -> Result<Recorder> {
        let unit = self.unit.as_deref().map(names::check).transpose().map_err(BadInput::from)?;
        let mut recorder = Recorder::new(out, unit.unwrap_or(""));
        recorder.head.attitude = self.place.attitude_of_three()?;
        recorder.head.scale_factor = self.scale_factor()?;
        recorder.of_sensors = match self.thermometer.as_str() {
            // (Empty: made without the command line.)
            "frequency" | "" => false,
            "sensor" => true,
            other => {
                return Err(BadInput::new(format!(
                    "thermometer \"{other}\" is not known; there are frequency and sensor"
                ))
                .into())
            }
        };
        if !live && self.inputs.is_some() {
            return Err(BadInput::new("--inputs sends to a unit on its link: it goes with --port").into());
        }
        let sensors = if live { Sensors::open } else { Sensors::of_file };
        recorder.sensors = self.case_sensors.as_deref().map(sensors).transpose()?;
        Ok(recorder)
    }

    fn scale_factor(&self) -> Result<Option<[f32; 3]>, BadInput> {
        Ok(self.scale_factor.as_deref().map(scale_factor).transpose()?)
    }

    /// The name of a unit that has one, or the one that is given; empty where nobody knows.
    pub(crate) fn name(&self, own: Option<&str>) -> Result<String, BadInput> {
        match (own, self.unit.as_deref()) {
            (Some(own), Some(printed)) if own != printed => Err(BadInput::new(format!(
                "the unit is {own}, --unit says {printed}; leave --unit out, or connect the right unit"
            ))),
            (own, printed) => Ok(own.or(printed).unwrap_or("").to_string()),
        }
    }
}

/// A unit on a port that is being recorded.
struct Recording<'a> {
    arguments: &'a RecordArguments,
    port: String,
    recorder: Recorder,
    identity: Identity,
    /// Inputs that are sent to it.
    feed: Option<Sensors>,
    /// Inputs that came too late for a column.
    late: Vec<&'static str>,
    /// A second has come.
    begun: bool,
}

impl<'a> Recording<'a> {
    fn start(unit: &mut Unit, port: &str, out: &Path, arguments: &'a RecordArguments) -> Result<Self> {
        let mut recorder = arguments.recorder(out, true)?;
        recorder.head.live = true;
        let identity = unit.identity()?;
        let feed = arguments.feed()?;
        let mut r = Self { arguments, port: port.into(), recorder, identity, feed, late: Vec::new(), begun: false };
        r.begin_feed(unit)?;
        r.look(unit)?;
        if r.recorder.head.unit.is_empty() {
            eprintln!("note: the unit has no name yet, and so the recording has none; name it with --unit NAME here or at hrg fit");
        }
        if arguments.place.latitude.is_none() {
            eprintln!("note: without --latitude and --axes the earth's rate stays in the rates, and in what is fitted to them");
        }
        Ok(r)
    }

    /// Sends the inputs that have come since last asked.
    fn send_inputs(&mut self, unit: &mut Unit) -> Result<usize> {
        let Some(feed) = &mut self.feed else { return Ok(0) };
        let come: Vec<(u8, f32)> =
            (0..).zip(feed.newest()).filter(|(_, v)| v.is_finite()).map(|(n, v)| (n, v as f32)).collect();
        for values in come.chunks(IN_MESSAGE) {
            unit.send(&Message::Inputs(InputValues::of(values.iter().copied())))?;
        }
        Ok(come.len())
    }

    /// Sends the first inputs, and waits until the unit has used them: they have columns in the recording then.
    fn begin_feed(&mut self, unit: &mut Unit) -> Result<()> {
        if self.feed.is_none() {
            return Ok(());
        }
        let until = Instant::now() + FEED_WITHIN;
        let mut sent = 0;
        while Instant::now() < until {
            sent += self.send_inputs(unit)?;
            if let Some(Message::InputsUsed(used)) = unit.next(Duration::from_millis(100))? {
                if used.values.iter().any(|v| v.is_finite()) {
                    return Ok(());
                }
            }
        }
        let why = if sent == 0 {
            "no inputs have come from there; is it writing lines such as drive_x_v=1.21?"
        } else {
            "the unit does not report them; is its firmware built with the feature inputs?"
        };
        Err(BadInput::new(format!("--inputs {}: {why}", self.arguments.inputs.as_deref().unwrap_or(""))).into())
    }

    /// Asks the unit for its name and scale factor.
    fn look(&mut self, unit: &mut Unit) -> Result<()> {
        self.recorder.head.unit = self.arguments.name(name_of(&self.identity))?;
        let printed = self.arguments.scale_factor()?;
        let in_use = unit.in_use(&self.identity)?;
        self.recorder.with_force = self.identity.increments > 0;
        self.recorder.head.raw_forces = in_use.leaves_forces_raw();
        let own = in_use.scale_factor();
        if let (Some(own), Some(printed)) = (own, printed) {
            if !same_scale(&own, &printed) {
                return Err(BadInput::new(format!(
                    "the unit makes its rates with the scale factor {} deg/h per code (x y z), --scale-factor says {}; leave it out, and give the right one to hrg fit, which converts the rates",
                    scale_text(&own),
                    scale_text(&printed)
                ))
                .into());
            }
        }
        self.recorder.head.scale_factor = own.or(printed);
        if self.recorder.head.scale_factor.is_none() {
            eprintln!("note: the unit does not let its scale factor be read; give it with --scale-factor X,Y,Z");
        }
        Ok(())
    }

    /// A second of the unit. It may have been given another image, and started anew.
    fn second(&mut self, unit: &mut Unit, h: &Housekeeping) -> Result<()> {
        if h.calibration != self.identity.calibration {
            let identity = unit.identity()?;
            self.same_unit(&identity)?;
            self.identity = identity;
            self.look(unit)?;
        }
        // (What came while the unit was asked for its name is gone: the inputs of the first second may be among it.)
        if !std::mem::replace(&mut self.begun, true) && !self.recorder.has_inputs_of(h) {
            return Ok(());
        }
        let (second, late) = self.recorder.second(h);
        for name in late {
            if !self.late.contains(&name) {
                eprintln!("note: the input {name} came after the recording began and has no column in it; begin again to record it");
                self.late.push(name);
            }
        }
        self.recorder.push(&second)
    }

    /// A unit without a name may have got one; any other change of name is another unit.
    fn same_unit(&self, now: &Identity) -> Result<(), BadInput> {
        match (name_of(&self.identity), name_of(now)) {
            (Some(before), now) if now != Some(before) => Err(BadInput::new(format!(
                "{}: the unit there is {} now, the recording is of {before}: it ends here, and its {} rows stay",
                self.port,
                now.unwrap_or("one without a name"),
                self.recorder.rows()
            ))),
            _ => Ok(()),
        }
    }

    /// The cable was out: whether it is the same unit that is there again. `None`: nobody yet.
    fn again(&mut self) -> Result<Option<Unit>> {
        let Ok(mut unit) = Unit::open(&self.port) else { return Ok(None) };
        let Ok(identity) = unit.identity() else { return Ok(None) };
        self.same_unit(&identity)?;
        Ok(Some(unit))
    }
}

/// Time without any housekeeping after which a person is told: a unit sends it each second.
const QUIET: Duration = Duration::from_secs(10);

/// `hrg record --port`.
pub fn record_port(port: &str, out: &Path, seconds: Option<u64>, arguments: &RecordArguments) -> Result<()> {
    record_until(port, out, arguments, |rows| Ok(seconds.is_some_and(|s| rows >= s))).map(drop)
}

/// Records until it is enough, as `enough` says of the rows; `false` if Ctrl-C came first.
pub fn record_until(
    port: &str,
    out: &Path,
    arguments: &RecordArguments,
    mut enough: impl FnMut(u64) -> Result<bool>,
) -> Result<bool> {
    let stop = interrupted()?;
    let bar = indicatif::ProgressBar::new_spinner();
    let mut unit = Unit::open(port)?;
    let mut recording = Recording::start(&mut unit, port, out, arguments)?;
    let start = Instant::now();
    let mut lost: Option<Instant> = None;
    let (mut received, mut told) = (start, false);
    let mut finished = enough(recording.recorder.rows())?;
    while !finished && !stop.load(Ordering::Relaxed) {
        // (A cable that is out shows in what comes.)
        let _ = recording.send_inputs(&mut unit);
        match unit.next(Duration::from_millis(if recording.feed.is_some() { 100 } else { 500 })) {
            Ok(Some(Message::Housekeeping(h))) => {
                (lost, received, told) = (None, Instant::now(), false);
                recording.second(&mut unit, &h)?;
                finished = enough(recording.recorder.rows())?;
                let recorder = &recording.recorder;
                bar.set_message(format!(
                    "{}: {} rows, {} gaps, {:.1} h; T {:.2} {:.2} {:.2} C; {} bad frames",
                    recorder.path().unwrap_or(out).display(),
                    recorder.rows(),
                    recorder.gaps(),
                    start.elapsed().as_secs_f64() / 3600.0,
                    h.temperature_c[0],
                    h.temperature_c[1],
                    h.temperature_c[2],
                    unit.bad_frames
                ));
                bar.tick();
            }
            Ok(Some(Message::InputsUsed(used))) => recording.recorder.take_inputs(used),
            Ok(Some(Message::Increments(frame))) => recording.recorder.take_increments(&frame),
            Ok(_) if told || received.elapsed() < QUIET => {}
            Ok(_) => {
                told = true;
                eprintln!(
                    "{port}: nothing to record has come for {} s: the unit sends nothing, or it sends MAVLink (docs/navigator.md); waiting for it, Ctrl-C ends",
                    QUIET.as_secs()
                );
            }
            Err(e) => {
                // The cable is out: wait for it, the file stays open.
                let since = lost.get_or_insert_with(Instant::now).elapsed();
                bar.set_message(format!("{port} is gone since {:.0} s ({e}); waiting for it", since.as_secs_f64()));
                bar.tick();
                std::thread::sleep(Duration::from_millis(250));
                if let Some(again) = recording.again()? {
                    (unit, received) = (again, Instant::now());
                }
            }
        }
    }
    bar.finish_and_clear();
    report(&recording.recorder);
    Ok(finished)
}

pub(crate) fn report(recorder: &Recorder) {
    println!("{}", recorder.summary());
    if let Some(sensors) = &recorder.sensors {
        println!("sensors: {}", sensors.summary());
    }
}

/// Arguments of `hrg unit burn`.
#[derive(Args)]
pub struct BurnArguments {
    /// The calibration.
    calibration: PathBuf,
    /// Serial port of the link.
    #[arg(long)]
    port: String,
    /// The unit's name, where it or the calibration has none.
    #[arg(long)]
    unit: Option<String>,
    /// Replace the unit's scale factor by the calibration's.
    #[arg(long)]
    new_scale_factor: bool,
    /// The key that signs the image (hrg unit keygen), for a unit whose firmware wants it.
    #[arg(long)]
    key: Option<PathBuf>,
}

impl BurnArguments {
    /// A calibration for the unit that was recorded with these facts, signed where there is a key.
    pub fn of(calibration: &Path, port: &str, recorded: &RecordArguments, key: Option<&Path>) -> Self {
        let (calibration, port) = (calibration.to_path_buf(), port.to_string());
        let key = key.map(Path::to_path_buf);
        Self { calibration, port, unit: recorded.unit.clone(), new_scale_factor: false, key }
    }
}

/// A unit that fails in the middle of a burn is asked for so long what it holds.
const HELD_WITHIN: Duration = Duration::from_secs(15);

/// `hrg unit burn`.
pub fn burn(arguments: &BurnArguments) -> Result<()> {
    let BurnArguments { calibration, port, unit: printed, new_scale_factor, key } = arguments;
    let key = key.as_deref().map(keys::load).transpose()?;
    let c = image_file::load(calibration)?;
    let mut unit = Unit::open(port)?;
    let named = match printed {
        Some(printed) => Some(printed.clone()),
        None => ask_for_a_name(&unit.identity()?, &c)?,
    };
    let bar = indicatif::ProgressBar::new(100);
    bar.set_style(indicatif::ProgressStyle::with_template("burning {bar:40} {percent}%")?);
    let printed = Burn { unit: named, new_scale_factor: *new_scale_factor, key };
    // Without a terminal there is no bar: a line then marks the time from which the unit must not be switched off.
    let unsaid = std::cell::Cell::new(!std::io::stderr().is_terminal());
    let after = unit.burn(&c, &printed, |done| {
        if unsaid.replace(false) {
            eprintln!("{port}: the image is being written; leave the unit on");
        }
        bar.set_position((done * 100.0) as u64);
    });
    bar.finish_and_clear();
    let Burnt { identity: after, before } = match after {
        Ok(burnt) => burnt,
        Err(e) if e.begun => return Err(with_what_it_holds(&mut unit, port, &e.why)),
        Err(e) => return Err(e.why.context(port.clone())),
    };
    if let Some(flags) = unit.shows().with_context(|| format!("{port}: image {:08x} is burnt", after.calibration))? {
        anyhow::bail!(
            "{port}: image {:08x} is burnt and runs, but the unit shows {flags}; {}",
            after.calibration,
            way_back(before.as_ref(), port)?
        );
    }
    let needed = names_of(inputs::needed(&c));
    if !needed.is_empty() && unit.flags_inputs()? {
        println!(
            "note: the image needs {}, and not all of it comes in to the unit: it flags input (docs/inputs.md)",
            hrg_data::error::list(&needed)
        );
    }
    println!(
        "{}: burnt, read back, and running: image {:08x}, number {}, scale factor {} deg/h per code (x y z)",
        after.unit_name(),
        after.calibration,
        after.sequence,
        scale_text(&c.scale_factors_dph_per_code())
    );
    let length = c.to_bytes().map_or(MAX_BYTES, |b| b.len());
    println!(
        "burn {} of the unit. A sector holds {} images of this length. When one sector is full, the other is erased (half a second without output); a sector endures 10000 erases",
        after.sequence,
        SECTOR_BYTES / room(length)
    );
    Ok(())
}

/// Arguments of `hrg unit zero`.
#[derive(Args)]
pub struct ZeroArguments {
    /// Serial port of the link.
    #[arg(long)]
    port: String,
    #[command(flatten)]
    place: Place,
    /// Seconds to measure.
    #[arg(long, default_value_t = 300, value_parser = clap::value_parser!(u64).range(60..=86_400))]
    seconds: u64,
    /// Standard uncertainty of the attitude, degrees.
    #[arg(long, default_value_t = 0.1)]
    attitude_std: f64,
    /// Take the renewed constants back: those of the calibration hold again.
    #[arg(long)]
    undo: bool,
}

/// `hrg unit zero`.
pub fn renew(arguments: &ZeroArguments) -> Result<()> {
    let ZeroArguments { port, place, seconds, attitude_std, undo } = arguments;
    let mut unit = Unit::open(port)?;
    let now = crate::now();
    if *undo {
        unit.set_zero(&Zero { made_unix_s: now, ..Zero::default() }).with_context(|| port.clone())?;
        println!("{port}: the constants are those of the calibration again");
        return Ok(());
    }
    if !(0.0..=45.0).contains(attitude_std) {
        return Err(BadInput::new("--attitude-std is a number of degrees from 0 to 45").into());
    }
    let attitude = place.attitude_of_three()?.ok_or_else(|| {
        BadInput::new(
            "the earth's rate along each axis must be known: give --latitude and --axes (\"x=north y=east z=down\")",
        )
    })?;
    let identity = unit.identity()?;
    let in_use = zero::newest(unit.events()?, identity.calibration).unwrap_or_default();
    let bar = indicatif::ProgressBar::new(*seconds);
    bar.set_style(indicatif::ProgressStyle::with_template("measuring {bar:40} {pos} of {len} s, {msg}")?);
    let mut measured = Measured::default();
    for second in 0..*seconds {
        measured.take(&unit.second(Duration::from_secs(5))?);
        bar.set_position(second + 1);
        bar.set_message(format!("{} flagged", measured.flagged));
    }
    bar.finish_and_clear();
    let renewed = measured.constants(attitude.earth_rate_dph(), *attitude_std, &in_use, now)?;
    unit.set_zero(&renewed.zero).with_context(|| port.clone())?;
    println!("axis   found [deg/h]   constant now [deg/h]        +-");
    for (a, name) in hrg_data::axes::AXIS_NAMES.iter().enumerate() {
        let (constant, std) = (renewed.zero.constant_dph[a], renewed.zero.std_dph[a]);
        println!("{name:<6} {:>13.4} {constant:>22.4} {std:>9.4}", renewed.found_dph[a]);
    }
    println!(
        "{}: kept beside image {:08x}, over power cuts, until another image is burnt; hrg unit zero --undo takes it back, hrg unit events lists it",
        identity.unit_name(),
        identity.calibration
    );
    Ok(())
}

/// Saves the image that the unit ran before, and names the command that burns it again.
fn way_back(before: Option<&Calibration>, port: &str) -> Result<String> {
    let Some(before) = before else {
        return Ok("it ran no image before that could be read: burn the calibration of this unit".into());
    };
    let file = PathBuf::from(format!("before-{:08x}.toml", before.checksum()));
    image_file::save(&file, before)?;
    Ok(format!("to go back, burn the image that it ran before: hrg unit burn {} --port {port}", file.display()))
}

/// Arguments of `hrg unit image`.
#[derive(Args)]
pub struct ImageArguments {
    /// Calibration.
    calibration: PathBuf,
    /// File that the image goes to, signature and all.
    #[arg(short, long)]
    out: PathBuf,
    /// The unit's name, where the calibration names none, or as a check.
    #[arg(long)]
    unit: Option<String>,
    /// Number of the image: of several in a unit's flash it runs the one with the largest.
    #[arg(long, default_value_t = 1)]
    number: u32,
    /// Private key that signs it (hrg unit keygen).
    #[arg(long)]
    key: Option<PathBuf>,
}

/// Address of a calibration sector, for a debug probe: sector A (memory.x).
const SECTOR_A: u32 = 0x0800_4000;

/// `hrg unit image`.
pub fn image(arguments: &ImageArguments) -> Result<()> {
    let ImageArguments { calibration, out, unit, number, key } = arguments;
    let key = key.as_deref().map(keys::load).transpose()?;
    let mut c = image_file::load(calibration)?;
    if !c.calibrated {
        let empty = "holds no calibration, but the default of an uncalibrated unit";
        return Err(BadInput::new(format!("{}: {empty}", calibration.display())).into());
    }
    let name = match (names::of(&c), unit.as_deref()) {
        (Some(own), Some(printed)) if own != printed => {
            return Err(
                BadInput::new(format!("{}: it is of unit {own}, not of {printed}", calibration.display())).into()
            );
        }
        (Some(name), _) | (None, Some(name)) => name.to_string(),
        (None, None) => {
            return Err(BadInput::new(format!("{}: it names no unit; give --unit NAME", calibration.display())).into());
        }
    };
    c.set_unit_name(&name);
    c.sequence = *number;
    let bytes = c.to_bytes().context("the calibration does not fit an image")?;
    let bytes = key.as_ref().map_or_else(|| bytes.to_vec(), |key| keys::sign(&bytes, key));
    hrg_data::output::write_file(out, &bytes)?;
    println!(
        "{}: image {:08x} of unit {name}, number {number}, {} bytes{}",
        out.display(),
        c.checksum(),
        bytes.len(),
        if key.is_some() { ", signed" } else { "" }
    );
    println!("to write it over the debug port into an erased calibration sector: probe-rs download --chip STM32F446RETx --binary-format bin --base-address {SECTOR_A:#010x} {}", out.display());
    Ok(())
}

/// `hrg unit keygen`.
pub fn keygen(out: &Path) -> Result<()> {
    let public = keys::generate(out)?;
    println!("{}: the private key, readable for you only; who has it can calibrate your units", out.display());
    println!("{}.pub: the public key", out.display());
    println!("build the firmware with the feature signed and HRG_PUBLIC_KEY={public}");
    Ok(())
}

/// Asks for the unit's name if a user must confirm whose calibration this is, and a person is at the terminal.
fn ask_for_a_name(identity: &Identity, c: &Calibration) -> Result<Option<String>> {
    let question = match agreed_name(name_of(identity), names::of(c), None) {
        Err(NameError::UnitUnnamed { image }) => {
            format!("The unit has no name yet and takes that of the calibration, {image}. If it is that unit, type its name: ")
        }
        Err(NameError::ImageUnnamed { unit }) => {
            format!("The calibration names no unit. If it is of the unit on this port, {unit}, type its name: ")
        }
        Err(NameError::BothUnnamed) => "Neither the unit nor the calibration has a name. Type the unit's: ".to_string(),
        _ => return Ok(None),
    };
    if !std::io::stdin().is_terminal() {
        return Ok(None);
    }
    eprint!("{question}");
    let mut line = String::new();
    std::io::stdin().read_line(&mut line)?;
    Ok(Some(line.trim().to_string()))
}

/// Why a burn failed, and what the unit holds now: asked from the unit.
fn with_what_it_holds(unit: &mut Unit, port: &str, why: &anyhow::Error) -> anyhow::Error {
    let held = match unit.held(HELD_WITHIN) {
        Ok(held) => held.to_string(),
        Err(e) => format!("the unit does not answer ({e:#}): what it holds is not known until hrg unit read asks it"),
    };
    let sentence = format!("{port}: {why:#}; {held}");
    if why.is::<BadInput>() {
        BadInput::new(sentence).into()
    } else {
        anyhow::anyhow!(sentence)
    }
}

/// Arguments of `hrg unit read`.
#[derive(Args)]
pub struct ReadArguments {
    /// Serial port of the link.
    #[arg(long)]
    port: String,
    /// As hrg unit events.
    #[arg(long, hide = true, conflicts_with = "out")]
    events: bool,
    /// File for the image in use.
    #[arg(short, long)]
    out: Option<PathBuf>,
}

/// Arguments of `hrg unit keygen`.
#[derive(Args)]
pub struct KeygenArguments {
    /// File for the private key; the public one goes beside it, with .pub behind its name.
    #[arg(short, long)]
    pub out: PathBuf,
}

/// `hrg unit read`.
pub fn read(arguments: &ReadArguments) -> Result<()> {
    let ReadArguments { port, events, out } = arguments;
    if *events {
        return self::events(&EventsArguments { port: port.clone(), elf: None });
    }
    let out = out.as_deref();
    let (identity, images) = Unit::open(port)?.read()?;
    let name = name_of(&identity).unwrap_or("without a name");
    println!("unit {name}, running image {:08x}, number {}", identity.calibration, identity.sequence);
    let open: Vec<&str> = option_bytes::differences(identity.option_bytes).in_words().collect();
    let how =
        if open.is_empty() { "as it should fly".into() } else { format!("{}: docs/hardening.md", open.join("; ")) };
    println!("option bytes {:08x}: {how}", identity.option_bytes);
    let tell = |(place, image): &At, what: &str| match image {
        Ok(c) => println!(
            "{place}: image {:08x}, number {}, made on {}, {what}",
            c.checksum(),
            c.sequence,
            monitor::date(c.created_unix_s)
        ),
        Err(e) => println!("{place}: {e}; {what}"),
    };
    if let Some(at) = &images.in_use {
        tell(at, "in use");
    }
    if let Some(at) = images.newest.as_ref().filter(|_| images.newest != images.in_use) {
        tell(at, "runs from the next start on");
    }
    let running = match images.in_use {
        Some((_, Ok(c))) => Some(c).filter(|c| c.checksum() == identity.calibration),
        _ => None,
    };
    match (out, running) {
        (Some(out), Some(c)) => {
            image_file::save(out, &c)?;
            println!("{}: the image in use", out.display());
            Ok(())
        }
        (Some(_), None) => {
            Err(BadInput::new("the unit runs its compiled-in default; there is no image to write").into())
        }
        (None, _) => Ok(()),
    }
}

/// Arguments of `hrg unit events`.
#[derive(Args)]
pub struct EventsArguments {
    /// Serial port of the link.
    #[arg(long)]
    port: String,
    /// The firmware that the unit runs, as an ELF: names the places at which it has stopped.
    #[arg(long)]
    elf: Option<PathBuf>,
}

/// `hrg unit events`: the last stop of a unit, and its field log.
///
/// # Errors
/// If the unit does not answer.
pub fn events(arguments: &EventsArguments) -> Result<()> {
    let EventsArguments { port, elf } = arguments;
    let symbols = elf.as_deref().map(Symbols::open).transpose()?;
    let mut unit = Unit::open(port)?;
    if let Some(stopped) = unit.last_stop()? {
        println!("stopped before its last start: {}", events::stop(&stopped, symbols.as_ref()));
    }
    let all = unit.events()?;
    println!("{} events; times since power-on, over restarts", all.len());
    for line in events::lines(&all, symbols.as_ref()) {
        println!("{line}");
    }
    Ok(())
}

/// Arguments of `hrg monitor`.
#[derive(Args)]
pub struct MonitorArguments {
    /// Serial port of the link.
    #[arg(long, conflicts_with = "defmt", required_unless_present = "defmt")]
    port: Option<String>,
    /// The unit's log instead: lines as probe-rs or defmt-print show them, or the raw stream; - for standard input.
    #[arg(long, conflicts_with = "out")]
    pub defmt: Option<PathBuf>,
    /// The firmware that made a raw stream.
    #[arg(long)]
    pub elf: Option<PathBuf>,
    /// Chamber profile that runs since power-on, named or written out: for the remaining time.
    #[arg(long, allow_hyphen_values = true)]
    profile: Option<String>,
    /// Print the screen once, as text, after so many seconds of the unit.
    #[arg(long)]
    pub snapshot: Option<u32>,
    /// Record meanwhile, as hrg record does.
    #[arg(short, long)]
    out: Option<PathBuf>,
    #[command(flatten)]
    record: RecordArguments,
}

impl MonitorArguments {
    /// The screen before its first second.
    pub fn state(&self) -> Result<State> {
        let mut state = State::default();
        state.profile = self.profile.as_deref().map(Profile::parse).transpose()?;
        Ok(state)
    }
}

/// `hrg monitor --port`.
pub fn monitor(arguments: &MonitorArguments) -> Result<()> {
    let MonitorArguments { port, snapshot, out, record, .. } = arguments;
    let mut state = arguments.state()?;
    let port = port.as_deref().ok_or_else(|| BadInput::new("give --port or --defmt"))?;
    let mut unit = Unit::open(port)?;
    state.identity = Some(unit.identity()?);
    if let Some(seconds) = *snapshot {
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
    let mut recording = out.as_deref().map(|out| Recording::start(&mut unit, port, out, record)).transpose()?;
    let mut terminal = monitor::terminal()?;
    let result = watch(&mut terminal, &mut unit, &mut state, port, &mut recording);
    ratatui::restore();
    if let Some(recording) = &recording {
        report(&recording.recorder);
    }
    result
}

/// Until somebody ends it.
fn watch(
    terminal: &mut ratatui::DefaultTerminal,
    unit: &mut Unit,
    state: &mut State,
    port: &str,
    recording: &mut Option<Recording<'_>>,
) -> Result<()> {
    let mut drawn = Instant::now();
    loop {
        match unit.next(Duration::from_millis(50)) {
            Ok(Some(message)) => {
                state.port_error = None;
                state.take(&message);
                match (recording.as_mut(), &message) {
                    (Some(recording), Message::Housekeeping(h)) => recording.second(unit, h)?,
                    (Some(recording), Message::InputsUsed(used)) => recording.recorder.take_inputs(*used),
                    (Some(recording), Message::Increments(frame)) => recording.recorder.take_increments(frame),
                    _ => {}
                }
                if let Some(recording) = recording.as_mut() {
                    let _ = recording.send_inputs(unit);
                }
            }
            Ok(None) => {}
            Err(e) => {
                state.port_error = Some(format!("{port} is gone ({e}); waiting for it"));
                std::thread::sleep(Duration::from_millis(200));
                let again = match recording {
                    Some(recording) => recording.again()?,
                    None => Unit::open(port).ok(),
                };
                if let Some(again) = again {
                    *unit = again;
                }
            }
        }
        state.bad_frames = unit.bad_frames;
        if drawn.elapsed() > Duration::from_millis(200) {
            terminal.draw(|f| monitor::draw(f, state))?;
            drawn = Instant::now();
            if ended()? {
                return Ok(());
            }
        }
    }
}

/// `true` if a key that ends the screen was pressed.
pub(crate) fn ended() -> Result<bool> {
    while crossterm::event::poll(Duration::ZERO)? {
        if let crossterm::event::Event::Key(key) = crossterm::event::read()? {
            let ctrl_c = key.code == KeyCode::Char('c') && key.modifiers.contains(KeyModifiers::CONTROL);
            if ctrl_c || matches!(key.code, KeyCode::Char('q') | KeyCode::Esc) {
                return Ok(true);
            }
        }
    }
    Ok(false)
}
