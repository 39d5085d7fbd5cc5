//! Burns that fail, against a unit made of the core's own maintenance mode, on a pseudo-terminal.

use hrg::unit::keys;
use hrg::unit::port::{Burn, Unit};
use hrg_core::calibration::Calibration;
use hrg_core::link::{Deframer, Housekeeping, Identity, Message};
use hrg_core::maintenance::{Answer, Command, Maintenance, Reply};
use hrg_core::sectors::Store;
use hrg_core::sectors::{newest, room, Place, Sector, SECTOR_BYTES};
use hrg_core::signature::Key;
use hrg_core::status::AxisStatus;
use serialport::{SerialPort, TTYPort};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Command as Process, Output, Stdio};
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Fault to inject, and its time.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Fault {
    /// The third chunk is not written.
    Chunk,
    /// The image is intact, and refused all the same.
    End,
    /// The restart does not come.
    Restart,
    /// Maintenance mode is not built in.
    Locked,
    /// None, but the firmware wants images signed with the key of `host-tests/keys`.
    Signed,
    /// The cable is pulled at the second chunk.
    Cable,
    /// None.
    Nothing,
    /// After the burn no frequency is found.
    Blind,
}

struct Flash([Vec<u8>; 2]);

impl hrg_core::update::Store for Flash {}

impl Store for Flash {
    fn erase(&mut self, sector: Sector) -> bool {
        self.0[usize::from(sector.number())].fill(0xFF);
        true
    }
    fn write(&mut self, at: Place, bytes: &[u8]) -> bool {
        self.0[usize::from(at.sector.number())][at.offset as usize..][..bytes.len()].copy_from_slice(bytes);
        true
    }
    fn view(&self, sector: Sector) -> &[u8] {
        &self.0[usize::from(sector.number())]
    }
}

fn image(sequence: u32, constant: f32) -> Calibration {
    let mut c = Calibration::uncalibrated();
    c.set_unit_name("HRG-7");
    c.calibrated = true;
    c.sequence = sequence;
    c.axes[0].coefficients = hrg_core::bias::Coefficients::One([constant; 6]);
    c
}

const KEY: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../host-tests/keys/test.key");

fn public_key() -> Key {
    Key::new(keys::load(Path::new(KEY)).expect("a key").verifying_key().to_bytes())
}

/// A unit that runs `image(1, 1.0)` and fails in one way; gives its port.
fn unit(fault: Fault, stop: Arc<AtomicBool>) -> String {
    let (mut ours, theirs) = TTYPort::pair().expect("a pseudo-terminal");
    let name = theirs.name().expect("has a name");
    ours.set_timeout(Duration::from_millis(20)).expect("set");
    std::thread::spawn(move || {
        let _theirs = theirs;
        let mut flash = Flash([vec![0xFF; SECTOR_BYTES], vec![0xFF; SECTOR_BYTES]]);
        let old = image(1, 1.0);
        let bytes = old.to_bytes().expect("fits");
        flash.0[0][..bytes.len()].copy_from_slice(&bytes);
        let start = |flash: &Flash| {
            let (c, place) = newest(&flash.0[0], &flash.0[1], None).newest.expect("one is valid");
            let identity = Identity {
                unit: c.unit,
                calibration: c.checksum(),
                created_unix_s: 0,
                sequence: c.sequence,
                ..Identity::default()
            };
            let maintenance = Maintenance::new(c.unit, c.sequence, Some(place), fault == Fault::Locked);
            (identity, maintenance.with_key(Some(public_key()).filter(|_| fault == Fault::Signed)))
        };
        let (mut identity, mut maintenance) = start(&flash);
        let (mut deframer, mut chunks) = (Deframer::default(), 0);
        let mut buffer = [0; 512];
        let mut shown = Instant::now();
        while !stop.load(Ordering::Relaxed) {
            // (Its seconds are short.)
            if shown.elapsed() > Duration::from_millis(100) {
                shown = Instant::now();
                let blind = fault == Fault::Blind && identity.sequence > 1;
                let lost = if blind { AxisStatus::FREQUENCY_LOST } else { AxisStatus::empty() };
                let second = Housekeeping {
                    frequency_hz: if blind { [f64::NAN; 3] } else { [4900.0, 4892.0, 4703.0] },
                    axis_status: [lost, AxisStatus::SETTLING, lost],
                    ..Housekeeping::default()
                };
                let _ = ours.write_all(&Message::Housekeeping(second).encode());
            }
            let Ok(n) = ours.read(&mut buffer) else { continue };
            for byte in &buffer[..n] {
                let answer = match deframer.push_command(*byte) {
                    Some(Ok(Message::Identify)) => Message::Identity(identity),
                    Some(Ok(Message::Maintain(command))) => {
                        chunks += u32::from(matches!(command, Command::Chunk { .. }));
                        let refused = match (fault, &command) {
                            (Fault::Cable, Command::Chunk { .. }) if chunks == 2 => return,
                            (Fault::Chunk, Command::Chunk { .. }) if chunks >= 3 => Some(Answer::Flash),
                            (Fault::End, Command::End) => Some(Answer::NotNewer),
                            _ => None,
                        };
                        let reply = match refused {
                            Some(answer) => Reply::Answer(answer, 0),
                            None => maintenance.command(&command, &mut flash),
                        };
                        if command == Command::Restart && fault != Fault::Restart {
                            (identity, maintenance) = start(&flash);
                        }
                        Message::Maintained(reply)
                    }
                    _ => continue,
                };
                let _ = ours.write_all(&answer.encode());
            }
        }
    });
    name
}

fn burn(fault: Fault, options: &[&str]) -> (bool, String) {
    let (o, folder) = burn_of(fault, &image(0, 2.0), options);
    let _ = std::fs::remove_dir_all(folder);
    (o.status.success(), String::from_utf8_lossy(&o.stderr).trim().to_string())
}

/// Burns a calibration; gives what was printed, and the folder in which it was done.
fn burn_of(fault: Fault, image: &Calibration, options: &[&str]) -> (Output, PathBuf) {
    static NUMBER: AtomicU32 = AtomicU32::new(0);
    let stop = Arc::new(AtomicBool::new(false));
    let port = unit(fault, stop.clone());
    let number = NUMBER.fetch_add(1, Ordering::Relaxed);
    let folder = std::env::temp_dir().join(format!("hrg-burn-{}-{number}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("made");
    hrg_data::image_file::save(&folder.join("c.toml"), image).expect("written");
    let o = Process::new(env!("CARGO_BIN_EXE_hrg"))
        .current_dir(&folder)
        .args(["burn", "c.toml"])
        .args(["--port", &port])
        .args(options)
        .stdin(Stdio::null())
        .output()
        .expect("hrg runs");
    stop.store(true, Ordering::Relaxed);
    (o, folder)
}

#[test]
fn a_curve_that_is_not_the_units_is_refused_before_anything_is_written() {
    let mut sensor = image(0, 2.0);
    sensor.axes[1].curve = hrg_data::image_file::sensor_curve(-40.0, 60.0);
    let mut kilohertz = image(0, 2.0);
    for a in &mut kilohertz.axes {
        a.curve.frequency_centre_hz /= 1000.0;
        a.curve.frequency_scale_hz /= 1000.0;
    }
    // (No image has a centre of 4.9 Hz: refused as a file.)
    let mut other = image(0, 2.0);
    other.axes.iter_mut().for_each(|a| a.curve.frequency_centre_hz += 80.0);
    for (c, says) in
        [(&sensor, "axis y: the unit reads 4892.000 now"), (&kilohertz, "centre frequency"), (&other, "axis x")]
    {
        let (o, folder) = burn_of(Fault::Nothing, c, &[]);
        let message = String::from_utf8_lossy(&o.stderr).into_owned();
        assert_eq!(o.status.code(), Some(2), "{message}");
        assert!(message.contains(says) && !message.contains("asked now"), "{message}");
        assert!(message.contains("nothing was written") || says == "centre frequency", "{message}");
        std::fs::remove_dir_all(folder).expect("removed");
    }
}

#[test]
fn a_burn_is_done_when_the_unit_shows_it() {
    let (o, folder) = burn_of(Fault::Nothing, &image(0, 2.0), &[]);
    assert!(o.status.success() && String::from_utf8_lossy(&o.stdout).contains("burnt, read back, and running"));
    std::fs::remove_dir_all(folder).expect("removed");
    let (o, folder) = burn_of(Fault::Blind, &image(0, 2.0), &[]);
    let message = String::from_utf8_lossy(&o.stderr).into_owned();
    assert_eq!(o.status.code(), Some(1), "{message}");
    assert!(message.contains("the unit shows frequency-lost on x and frequency-lost on z; to go back"), "{message}");
    // The named file is the image from before.
    let file = format!("before-{:08x}.toml", image(1, 1.0).checksum());
    assert!(
        message.contains(&format!("hrg unit burn {file} --port"))
            && !String::from_utf8_lossy(&o.stdout).contains("running"),
        "{message}"
    );
    assert_eq!(hrg_data::image_file::load(&folder.join(file)).expect("kept").checksum(), image(1, 1.0).checksum());
    std::fs::remove_dir_all(folder).expect("removed");
}

#[test]
fn a_burn_that_fails_says_what_the_unit_says_that_it_holds() {
    let (old, new) = (image(1, 1.0).checksum(), image(2, 2.0).checksum());
    let runs = format!("; asked now, unit HRG-7 runs image {old:08x}, number 1; ");
    let behind = room(image(1, 1.0).to_bytes().expect("fits").len());
    let next =
        format!("from its next start on it runs image {new:08x} of unit HRG-7, number 2 (sector A, byte {behind})");
    for (fault, why, holds) in [
        (Fault::Chunk, "writing: the unit says: the flash could not be written", "a restart changes nothing"),
        (Fault::End, "checking: the unit says: the image is not newer", "a restart changes nothing"),
        (Fault::Restart, "after its restart, not", next.as_str()),
    ] {
        let (done, message) = burn(fault, &[]);
        assert!(!done && message.contains(why), "{fault:?}: {message}");
        assert!(message.contains(&format!("{runs}{holds}")), "{fault:?}: {message}");
        assert!(!message.contains("keeps"), "{fault:?}: {message}");
    }
    let (done, message) = burn(Fault::Locked, &[]);
    assert!(!done && message.contains("built without maintenance mode") && !message.contains("asked now"), "{message}");
}

#[test]
fn a_unit_with_a_key_takes_what_is_burnt_with_it() {
    let (done, message) = burn(Fault::Signed, &[]);
    assert!(!done && message.contains("the image is not signed with the key of its firmware; asked now"), "{message}");
    let (done, message) = burn(Fault::Signed, &["--key", KEY]);
    assert!(done, "{message}");
    let (done, message) = burn(Fault::Signed, &["--key", concat!(env!("CARGO_MANIFEST_DIR"), "/../../rustfmt.toml")]);
    assert!(!done && message.contains("no key of hrg unit keygen") && !message.contains("asked now"), "{message}");
}

#[test]
fn nothing_is_reported_of_a_unit_that_has_gone() {
    let port = unit(Fault::Cable, Arc::new(AtomicBool::new(false)));
    let mut unit = Unit::open(&port).expect("a port");
    let e = unit.burn(&image(0, 2.0), &Burn::default(), |_| {}).expect_err("the cable is pulled");
    assert!(e.begun, "{}", e.why);
    assert!(unit.held(Duration::from_millis(100)).is_err());
}

/// A unit finds in its flash the image that `hrg unit image` writes: one with a key only if it is signed.
#[test]
fn an_image_for_the_debug_port_is_found_by_the_unit() {
    let folder = std::env::temp_dir().join(format!("hrg-image-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("made");
    hrg_data::image_file::save(&folder.join("c.toml"), &image(0, 2.0)).expect("written");
    let key = keys::load(Path::new(KEY)).expect("a key");
    let public = Key::new(key.verifying_key().to_bytes());
    let run = |options: &[&str]| {
        let mut all = vec!["image", "c.toml", "--out", "i.bin"];
        all.extend(options);
        let o = Process::new(env!("CARGO_BIN_EXE_hrg")).current_dir(&folder).args(all).output().expect("hrg runs");
        (o.status.success(), String::from_utf8_lossy(&o.stderr).into_owned())
    };
    for (options, by_key) in [(&["--number", "7"][..], false), (&["--number", "7", "--key", KEY], true)] {
        let (done, message) = run(options);
        assert!(done, "{message}");
        let bytes = std::fs::read(folder.join("i.bin")).expect("written");
        let mut sectors = [vec![0xFF; SECTOR_BYTES], vec![0xFF; SECTOR_BYTES]];
        sectors[0][..bytes.len()].copy_from_slice(&bytes);
        for (key, expected) in [(None, true), (Some(public), by_key)] {
            let found = newest(&sectors[0], &sectors[1], key).newest;
            assert_eq!(
                found.map(|(c, _)| (c.sequence, c.unit)),
                expected.then(|| (7, image(0, 2.0).unit)),
                "{options:?}"
            );
        }
    }
    let (done, message) = run(&["--unit", "HRG-8"]);
    assert!(!done && message.contains("it is of unit HRG-7, not of HRG-8"), "{message}");
    std::fs::remove_dir_all(&folder).expect("removed");
}
