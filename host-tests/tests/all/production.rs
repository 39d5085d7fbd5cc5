//! `hrg calibrate` from end to end on a served board: stopped in the middle, and gone on with.
// A test may panic.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use crate::day::{command, folder, power_for, steps, warmer_c};
use hrg_data::recording::Recording;
use hrg_identify::family::{Family, Learnt};
use hrg_simulate::{Plan, Profile};
use std::process::Stdio;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

/// Board time over that of the clock: half of what a processor manages, for the unit's answers are timed.
const SPEED: f64 = 15.0;
/// One board at a time, for the same reason.
static ALONE: Mutex<()> = Mutex::new(());

#[test]
#[ignore = "two chamber runs of 35 minutes, fifteen times as fast: cargo xtask test --rest runs it"]
fn one_command_calibrates_a_unit_and_goes_on_where_it_was_stopped() {
    let _alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
    let d = folder("production");
    let run = "calibrate --port link --profile 20,35m --verify-profile 21,35m --limit 100 --from 8 --to 18 --folder unit --unit HRG-042 \
               --latitude 28.2 --axes x=north_y=east_z=down --yes";
    power_for(&steps(100, 0.5), &d, SPEED, || {
        // A third of the train run, then Ctrl-C.
        let mut first = command(&d, run).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("starts");
        let rows = |name: &str| {
            let text = std::fs::read_to_string(d.join("unit").join(name)).unwrap_or_default();
            text.lines().filter(|l| l.starts_with(|c: char| c.is_ascii_digit())).count()
        };
        while rows("train-1.csv") < 700 {
            if first.try_wait().expect("runs").is_some() {
                panic!("it ended by itself: {:?}", first.wait_with_output().expect("ended"));
            }
            std::thread::sleep(Duration::from_millis(200));
        }
        let pid = first.id().to_string();
        assert!(std::process::Command::new("kill").args(["-INT", &pid]).status().expect("kill").success());
        let output = first.wait_with_output().expect("ends");
        let reported = String::from_utf8_lossy(&output.stderr);
        assert!(!output.status.success() && reported.contains("the same command goes on there"), "{reported}");
        // The same command goes on to the end.
        let output = command(&d, run).output().expect("runs");
        let (printed, reported) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
        assert!(output.status.success(), "{printed}{reported}");
        for line in ["1. built-in test: done before", "of it are recorded", "PASS", "burnt, read back"] {
            assert!(printed.contains(line), "{line}: {printed}");
        }
        let parts = [rows("train-1.csv"), rows("train-2.csv")];
        // 35 minutes and the second in which it is switched on; the second part did not begin anew.
        assert!(parts[0] >= 700 && parts[1] < 1500 && parts[0] + parts[1] >= 2101, "{parts:?}");
        let page = std::fs::read_to_string(d.join("unit/report.html")).expect("written");
        assert!(page.contains("PASS") && page.contains("HRG-042") && page.contains("burnt and read back"));
        // And once more: nothing is left to do.
        let output = command(&d, run).output().expect("runs");
        let printed = String::from_utf8_lossy(&output.stdout);
        assert!(output.status.success() && printed.contains("6. burn: done before"), "{printed}");
    });
}

/// A recording of what a board of [`steps`] sends: a unit of the family of the served one.
fn recorded(seed: u64, slope_dph_per_c: f64) -> Recording {
    let served = steps(85, slope_dph_per_c);
    let mut r = Plan::of(Profile::parse("20,84m").expect("fine"), 5, seed).simulate().recording;
    r.set_meta("unit", &format!("HRG-{seed}"));
    r.optional.clear();
    for a in 0..3 {
        let n = r.time_s.len();
        r.frequency_hz[a].copy_from_slice(&served.frequency_hz[a][..n]);
        r.rate_dph[a].iter_mut().enumerate().for_each(|(k, v)| *v += slope_dph_per_c * warmer_c(k));
    }
    r
}

#[test]
#[ignore = "a chamber run of 35 minutes, fifteen times as fast: cargo xtask test --rest runs it"]
fn with_a_family_the_train_run_ends_when_enough_is_known() {
    let _alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
    let d = folder("production-family");
    let slopes = [0.4, 0.45, 0.5, 0.55, 0.6, 0.48];
    let units = (11..).zip(slopes).map(|(seed, slope)| vec![recorded(seed, slope)]).collect();
    let Learnt { family, left_out, .. } = Family::learn("served", units).expect("a family");
    assert!(left_out.is_empty(), "{left_out:?}");
    std::fs::write(d.join("family.json"), family.to_json().expect("text")).expect("written");
    let run = "calibrate --port link --profile 20,35m --verify-profile 21,35m --limit 100 --from 8 --to 18 --folder unit --unit HRG-042 \
               --latitude 28.2 --axes x=north_y=east_z=down --yes --prior family.json";
    power_for(&steps(85, 0.5), &d, SPEED, || {
        let output = command(&d, run).output().expect("runs");
        let (printed, reported) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
        assert!(output.status.success(), "{printed}{reported}");
        for line in ["three of it are within the limit: the run may end", "PASS", "burnt, read back"] {
            assert!(printed.contains(line), "{line}: {printed}");
        }
        let text = |name: &str| std::fs::read_to_string(d.join("unit").join(name)).expect("written");
        let rows = text("train-1.csv").lines().filter(|l| l.starts_with(|c: char| c.is_ascii_digit())).count();
        assert!((600..2000).contains(&rows), "{rows} rows");
        let traced: serde_json::Value = serde_json::from_str(&text("trace.json")).expect("JSON");
        assert_eq!(traced["prior"]["belongs"], true, "{}", traced["prior"]);
    });
}
