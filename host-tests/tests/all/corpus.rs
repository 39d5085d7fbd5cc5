//! The kept inputs of the fuzz targets, and a fixed number of others made from them. Their coverage is not measured here:
//! `cargo xtask fuzz` does that, and keeps its findings.

use rand::prelude::*;
use rand_chacha::ChaCha8Rng;
use std::panic::{catch_unwind, AssertUnwindSafe};
use std::path::Path;

#[path = "../../../fuzz/src/lib.rs"]
mod targets;

/// Inputs that are made for each target.
const MADE: usize = 20_000;

/// No input is longer.
const LONGEST: usize = 8192;

fn corpus(target: &str) -> Vec<Vec<u8>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz/corpus").join(target);
    let mut files: Vec<_> = std::fs::read_dir(folder).expect("a corpus").flatten().map(|e| e.path()).collect();
    files.sort();
    files.iter().map(|p| std::fs::read(p).expect("readable")).collect()
}

/// Another input: one of the kept ones, changed in a few places.
fn made(kept: &[Vec<u8>], draw: &mut ChaCha8Rng) -> Vec<u8> {
    let mut input = kept.choose(draw).cloned().unwrap_or_default();
    for _ in 0..draw.random_range(1..=4) {
        let n = input.len();
        let from = draw.random_range(0..=n);
        let to = (from + draw.random_range(0..=16)).min(n);
        match draw.random_range(0..7) {
            0 if n > 0 => input[from % n] ^= 1 << draw.random_range(0..8),
            1 if n > 0 => {
                input[from % n] = *b"\x00\x01\x7F\x80\xFF,\n-9".choose(draw).expect("some");
            }
            2 => drop(input.drain(from..to)),
            3 => {
                let again = input[from..to].to_vec();
                input.splice(from..from, again);
            }
            4 => {
                let number = draw.random_range(-1e9..1e9) * 10f64.powi(draw.random_range(-12..12));
                input.splice(from..to, number.to_string().into_bytes());
            }
            5 => {
                let other = kept.choose(draw).expect("some");
                let at = draw.random_range(0..=other.len());
                input.splice(from.., other[at..].iter().copied());
            }
            _ => {
                let some: Vec<u8> = (0..to - from).map(|_| draw.random()).collect();
                input.splice(from..to, some);
            }
        }
    }
    input.truncate(LONGEST);
    input
}

fn hold(target: &str, run: fn(&[u8])) {
    hold_made(target, run, MADE);
}

fn hold_made(target: &str, run: fn(&[u8]), number: usize) {
    let kept = corpus(target);
    assert!(kept.len() > 5, "{target}: {} kept inputs", kept.len());
    let mut draw = ChaCha8Rng::seed_from_u64(1);
    let more = std::iter::repeat_with(|| made(&kept, &mut draw)).take(number);
    for input in kept.iter().cloned().chain(more) {
        if catch_unwind(AssertUnwindSafe(|| run(&input))).is_err() {
            let at = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{target}-input"));
            std::fs::write(&at, &input).expect("written");
            panic!("{target}: this input breaks a promise: {}", at.display());
        }
    }
}

#[test]
fn recordings_are_read_or_refused() {
    hold("recording", targets::recording::run);
}

#[test]
fn files_of_other_programs_are_read_or_refused() {
    // (Each is written to a file.)
    hold_made("import", targets::import::run, MADE / 5);
}

#[test]
fn calibrations_come_back_the_same() {
    hold("calibration", targets::calibration::run);
}

#[test]
fn no_bytes_on_the_link_erase_the_newest_image() {
    hold("link", targets::link::run);
}

#[test]
fn logs_of_any_bytes_are_read() {
    hold("log", targets::log::run);
}

#[test]
fn a_unit_lives_through_any_inputs() {
    hold("unit", targets::unit::run);
}
