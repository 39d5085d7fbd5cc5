//! `hrg align --port` against a unit that is played here: the very session of `hrg-core` behind a pseudo-terminal.
#![cfg(unix)]

use hrg_align::linear::Linear;
use hrg_align::session::Session;
use hrg_align::{DEGREE, DPH};
use hrg_align_tools::plant::Plant;
use hrg_align_tools::Recording;
use hrg_core::accelerometers::MPS2_PER_CODE;
use hrg_core::align_mode::Command;
use hrg_core::link::{Deframer, Identity, Message};
use hrg_core::rate_path::Summary;
use serialport::{SerialPort, TTYPort};
use std::io::{Read, Write};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// A second of the unit takes so long here.
const SECOND: Duration = Duration::from_millis(4);

/// Plays a unit until `stop`; returns the trim that it was commanded, deg/h.
fn unit(mut port: TTYPort, recording: &Recording, stop: &AtomicBool) -> Option<[f32; 3]> {
    port.set_timeout(Duration::from_millis(1)).expect("a port");
    let increments = |position: u8| -> Vec<[f64; 2]> {
        let v: Vec<[f64; 2]> = recording.rows.iter().filter(|r| r.1 == position).map(|r| r.2).collect();
        v.windows(2).map(|w| [w[1][0] - w[0][0], w[1][1] - w[0][1]]).collect()
    };
    let positions = [increments(1), increments(2)];
    let mut session = Session::<Linear<f32>>::IDLE;
    let (mut deframer, mut buffer, mut trim) = (Deframer::default(), [0; 256], None);
    let (mut position, mut second) = (0, 0);
    while !stop.load(Ordering::Relaxed) {
        let n = port.read(&mut buffer).unwrap_or(0);
        for message in buffer[..n].iter().filter_map(|b| deframer.push(*b)).flatten() {
            match message {
                Message::Identify => {
                    port.write_all(&Message::Identity(Identity::default()).encode()).expect("written");
                }
                Message::Align(command) => {
                    match command {
                        Command::Begin { .. } => (position, second) = (0, 0),
                        Command::TurnEnded { .. } => (position, second) = (1, 0),
                        _ => {}
                    }
                    trim = session.command(command).or(trim);
                }
                _ => {}
            }
        }
        let v = positions[position].get(second).copied().unwrap_or([0.001 * (second % 7) as f64, 0.0]);
        let summary = Summary {
            step: 0,
            samples: 1000,
            raw_dph: [0.0; 3],
            corrected_dph: [0.0; 3],
            adc_errors: 0,
            accelerometer_codes: v.map(|v| (v / (MPS2_PER_CODE * 1e-3)).round() as i64),
            accelerometer_saturated: false,
        };
        if let Some(report) = session.second(&summary) {
            // The second in which the turn ended is none of the position.
            second += usize::from(report.stage != 2);
            port.write_all(&Message::Alignment(report).encode()).expect("written");
        }
        std::thread::sleep(SECOND);
    }
    trim
}

/// The exit status, what it printed, and the trim that the unit got.
fn align(plant: &Plant, arguments: &[&str]) -> (Option<i32>, String, Option<[f32; 3]>) {
    let (recording, _) = plant.play();
    let (ours, theirs) = TTYPort::pair().expect("a pseudo-terminal");
    let name = theirs.name().expect("a name");
    let stop = AtomicBool::new(false);
    std::thread::scope(|s| {
        let board = s.spawn(|| unit(ours, &recording, &stop));
        let o = std::process::Command::new(env!("CARGO_BIN_EXE_hrg"))
            .args(["align", "--port", &name, "--turn-takes", "5s", "--velocity-noise", "0.0004", "--stay", "80s"])
            .args(arguments)
            .stdin(std::process::Stdio::null())
            .output()
            .expect("runs");
        stop.store(true, Ordering::Relaxed);
        let trim = board.join().expect("no panic");
        let text = String::from_utf8_lossy(&o.stdout).into_owned() + &String::from_utf8_lossy(&o.stderr);
        (o.status.code(), text, trim)
    })
}

#[test]
fn a_unit_aligns_itself_and_takes_its_drifts() {
    let plant = Plant { seconds: [85, 5, 85], ..Plant::chen(1) };
    let truth = plant.play().1;
    let out = std::env::temp_dir().join(format!("hrg-align-port-{}.json", std::process::id()));
    let path = out.display().to_string();
    let (code, text, trim) = align(&plant, &["--latitude", "45", "--accept", "--out", &path]);
    assert_eq!(code, Some(0), "{text}");
    assert!(text.contains("accepted: the drifts are a bias trim"), "{text}");
    let r: serde_json::Value = serde_json::from_slice(&std::fs::read(&out).expect("written")).expect("JSON");
    let off = r["azimuth_deg"].as_f64().expect("a number") - truth.azimuth / DEGREE;
    assert!(off.abs() * 60.0 < 15.0 && r["accepted"] == true, "{off}: {text}");
    // Stated changes that come with the turn are in the standard deviation: 0.02 deg/h over 2 Oc sin(45 degrees), and half of 6'.
    let std = |r: &serde_json::Value| r["azimuth_std_arcmin"].as_f64().expect("a number");
    let stated = ["--latitude", "45", "--accept", "--out", &path, "--heading-drift", "0.02", "--turn-error", "6"];
    let (code, again, _) = align(&plant, &stated);
    assert!(code == Some(0) && text.contains("neither is stated") && !again.contains("neither is stated"), "{again}");
    let with: serde_json::Value = serde_json::from_slice(&std::fs::read(&out).expect("written")).expect("JSON");
    let turn = (0.02_f64 / (2.0 * 15.041 * 0.5)).to_degrees() * 60.0;
    let wanted = (std(&r).powi(2) + turn.powi(2) + 9.0).sqrt();
    assert!((std(&with) / wanted - 1.0).abs() < 1e-3, "{} for {wanted}", std(&with));
    // The trim is minus what the platform drifts by.
    let trim = trim.expect("accepted");
    for k in 0..2 {
        assert!((f64::from(trim[k]) + truth.drift[k] / DPH).abs() < 0.05, "{trim:?} for {:?}", truth.drift);
    }
    // Without an accepting user nothing is trimmed, and the unit leaves its align mode.
    let (code, text, trim) = align(&plant, &["--latitude", "45"]);
    assert!(code == Some(2) && text.contains("nobody is there to answer") && trim.is_none(), "{text}");
    // The unit's own refusals.
    let (code, text, trim) = align(&plant, &["--latitude", "86", "--accept"]);
    assert!(code == Some(2) && text.contains("beyond 80 degrees") && trim.is_none(), "{text}");
    let (code, text, _) = align(&plant, &["--latitude", "45", "--accept", "--turn", "5"]);
    assert!(code == Some(2) && text.contains("no azimuth"), "{text}");
    // Drifts far beyond the usual: refused, unless they are expected.
    let plant = Plant { drift: [4.0 * DPH, -3.0 * DPH, 0.0], ..plant };
    let (code, text, _) = align(&plant, &["--latitude", "45", "--accept"]);
    assert!(code == Some(2) && text.contains("no azimuth"), "{text}");
    let (code, text, trim) = align(&plant, &["--latitude", "45", "--accept", "--drift", "4"]);
    assert!(code == Some(0) && trim.is_some(), "{text}");
    let (code, text, _) = align(&plant, &["--latitude", "45", "--drift", "99"]);
    assert!(code == Some(2) && text.contains("give a number above 0, at most 15"), "{text}");
    let _ = std::fs::remove_file(out);
}
