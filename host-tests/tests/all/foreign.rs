//! The trace on units of the second plant, which shares no code with its effects.
// A test may panic.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use foreign_plant::generate::Generated;
use hrg_core::status::AxisStatus;
use hrg_data::recording::Recording;
use hrg_identify::fit::correct::correct;
use hrg_identify::trace::{trace, Report, Trace};

fn traced(case: &str) -> (Generated, Report) {
    let (made, trace) = whole(case);
    (made, trace.report)
}

fn whole(case: &str) -> (Generated, Trace) {
    whole_of(case, 1)
}

fn whole_of(case: &str, seed: u64) -> (Generated, Trace) {
    let case = foreign_plant::cases().into_iter().find(|c| c.name == case).expect("a case of the plant");
    let made = case.generate(seed);
    let folder = std::env::temp_dir().join(format!("hrg-foreign-{}-{seed}-{}", case.name, std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder");
    let load = |r: &foreign_plant::recording::Recording, name: &str| {
        let path = folder.join(name);
        r.save(&path).expect("saved");
        Recording::load(&path).expect("loads")
    };
    let train: Vec<Recording> = made.train.iter().enumerate().map(|(k, r)| load(r, &format!("train{k}.csv"))).collect();
    let verify = load(&made.verify, "verify.csv");
    let trace = trace(&train, &verify).expect("traces");
    std::fs::remove_dir_all(&folder).expect("removed");
    (made, trace)
}

/// Floors that the written image leaves on the worst axis.
fn left(made: &Generated, report: &Report) -> f64 {
    let truth = made.truth.runs.last().expect("a verify run");
    let image = report.block.as_ref().expect("an image is written");
    truth.axes.iter().map(|(a, t)| image[a].verify_rms_dph / t.floor_dph).fold(0.0, f64::max)
}

#[test]
fn where_naming_does_not_reach_a_family_compensates() {
    // A lag whose time constant depends on the ramp is no effect of the library.
    let (made, Trace { report, .. }) = whole_of("memory-tau-by-ramp", 2);
    let before = report.baseline.values().map(|b| b.verify_rms_dph).fold(0.0, f64::max);
    let after = report.block.as_ref().expect("an image").values().map(|b| b.verify_rms_dph).fold(0.0, f64::max);
    assert!(report.burn && after < 0.5 * before, "{}", report.verdict);
    // It looks like a lag and a hysteresis: the report says that neither class is certain.
    let own_form = "a delay that is shorter while the temperature moves, which no effect of the library has";
    assert!(report.left_over.values().flatten().any(|l| l.contains(own_form)), "{:?}", report.left_over);
    println!("memory-tau-by-ramp: {before:.3} -> {after:.3} deg/h, {:.2} floors", left(&made, &report));
}

#[test]
fn a_run_that_begins_in_an_unknown_state_does_not_bend_the_lag() {
    let (made, report) = traced("state-kept-from-yesterday");
    assert!(report.notes.iter().any(|n| n.contains("are left out of fit and judgement")), "{:?}", report.notes);
    assert!(left(&made, &report) < 1.5, "{}", left(&made, &report));
}

#[test]
fn a_run_that_begins_on_another_branch_is_judged_as_a_unit_that_does_not_know_it() {
    // Three plays; the verify run starts on the other branch. A unit starts in the middle and learns its branch by sweeping it.
    let (made, report) = traced("state-other-branch");
    assert!(report.effects.iter().all(|e| e.confirmed == Some(true)) && report.burn, "{}", report.verdict);
    let before = report.baseline.values().map(|b| b.verify_rms_dph).fold(0.0, f64::max);
    let after = report.block.as_ref().expect("an image").values().map(|b| b.verify_rms_dph).fold(0.0, f64::max);
    assert!(after < 0.6 * before, "{before} {after}");
    println!("state-other-branch: {before:.3} -> {after:.3} deg/h, {:.2} floors", left(&made, &report));
}

#[test]
fn contacts_that_switch_again_are_relays_and_not_events() {
    // Two contacts with thresholds of their own, which the train run passes more than once: named, and left to the unit to compensate.
    let (made, report) = traced("hysteresis-two-thresholds");
    let relays = report.effects.iter().filter(|e| e.name == "relay").count();
    assert!(relays >= 2 && report.burn, "{}", report.verdict);
    let left = left(&made, &report);
    assert!(left < 1.5, "{left}");
    println!("hysteresis-two-thresholds: {relays} relays, {left:.2} floors");
}

#[test]
fn what_leaves_much_of_what_the_baseline_leaves_may_be_worse_on_another_profile() {
    // No effect of the library undoes a sensor that is late: the image helps on the verify run, and lacks something on each.
    let (_, report) = traced("thermometer-late-sensor");
    assert!(!report.burn && report.judge.values().any(|j| j.uncertain_elsewhere), "{}", report.verdict);
    assert!(report.verdict.contains("the better one on another profile"), "{}", report.verdict);
    assert!(report.verdict.contains("Next: record a run with a third profile"), "{}", report.verdict);
    let block = report.block.as_ref().expect("an image");
    assert!(block.iter().all(|(a, b)| b.verify_rms_dph < report.baseline[a].verify_rms_dph), "{}", report.verdict);
}

#[test]
fn a_recorded_quantity_does_not_stand_for_two_effects_of_the_resonator() {
    let (made, report) = traced("mix-logarithm-two-poles");
    let classes: Vec<&str> = report.effects.iter().map(|e| e.class.name()).collect();
    assert!(!classes.contains(&"input") && classes.contains(&"memory") && classes.contains(&"power-on"), "{classes:?}");
    println!("mix-logarithm-two-poles: {:.2} floors", left(&made, &report));
}

#[test]
fn beyond_the_temperatures_of_the_fit_the_stated_uncertainty_grows() {
    // Clean; trained from 10 to 35 C, verified from -37 to 60 C: up to fifteen eighths of the train run's range beyond it.
    let (_, trace) = whole("span-narrow");
    let seconds = correct(&trace.image, &trace.verify.steps);
    for a in trace.verify.steps.present() {
        let ranges = trace.image.axes[a].ranges();
        let (mut inside, mut far) = (0.0f32, f32::INFINITY);
        for s in seconds.iter().skip(trace.verify.steps.run_in).filter(|s| s.corrected_dph[a].is_finite()) {
            let [beyond, _] = ranges.beyond(s.temperature_c[a], 0.0);
            let flagged = s.status[a] & AxisStatus::EXTRAPOLATED.bits() != 0;
            assert!(flagged || beyond == 0.0, "{beyond} eighths beyond, and not flagged");
            if !flagged {
                inside = inside.max(s.bias_std_dph[a]);
            } else if beyond > 10.0 {
                far = far.min(s.bias_std_dph[a]);
            }
        }
        println!("span-narrow, axis {a}: {inside:.3} deg/h stated inside, {far:.3} and more ten eighths beyond");
        assert!(far > 2.0 * inside, "{far} {inside}");
    }
}
