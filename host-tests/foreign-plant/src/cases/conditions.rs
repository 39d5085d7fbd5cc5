//! Cases whose difficulty lies in the runs: days, states at power-on, spans, files.

use crate::case::{run, Case, Effect};
use crate::chamber::Program::{
    Brisk, CoolingOnly, Cycles, Gentle, HeatingOnly, SawSweep, SetpointWalk, ShrinkingLoops, Soaks, Stairs, TwoSpeed,
};
use crate::defects::Defects;
use crate::physics::{hysteresis, memory, power_on, rate, shape};
use crate::plan::Followed;
use crate::truth::Class::{self, Hysteresis, Memory, PowerOn, Rate, Shape};

fn case(name: &str, description: &str) -> Case {
    Case::new("condition", name, description)
}

pub(super) fn cases() -> Vec<Case> {
    [days(), states(), spans(), files()].concat()
}

fn days() -> Vec<Case> {
    vec![
        case("days-constants", "Three clean days to train; each run has a constant of its own, 3 floors apart or so.")
            .programs(Cycles, SetpointWalk)
            .and_train(run(Stairs, 7.0))
            .and_train(run(TwoSpeed, 7.0))
            .days(3.0, 0.0),
        case("days-constants-rod", "Two days to train, constants 4 floors apart, and the far end of a rod.")
            .programs(TwoSpeed, SetpointWalk)
            .and_train(run(Stairs, 7.0))
            .days(4.0, 0.0)
            .with(Effect::bias(Memory, "rod", memory::rod)),
        case("days-slope", "Clean, but the slope over temperature has changed by 1.5 floors in the verify run.")
            .days(2.0, 1.5)
            .beyond("the slope changes from day to day"),
        case("days-slope-hinges", "Two hinges, and a slope that has changed by 1.5 floors in the verify run.")
            .days(1.0, 1.5)
            .with(Effect::bias(Shape, "hinges", shape::hinges))
            .beyond("the slope changes from day to day"),
    ]
}

fn states() -> Vec<Case> {
    vec![
        case("state-begins-in-ramp", "The logs begin 80 min after power-on, in a ramp; a body behind two poles.")
            .programs(Brisk, Cycles)
            .each_train(|r| r.plan.log_from_s = 4800.0)
            .verify_with(|r| r.plan.log_from_s = 4200.0)
            .with(Effect::bias(Memory, "two poles", memory::two_poles)),
        case("state-begins-in-ramp-clean", "The logs begin 80 min after power-on, in a ramp; nothing else.")
            .programs(Cycles, SawSweep)
            .each_train(|r| r.plan.log_from_s = 4800.0)
            .verify_with(|r| r.plan.log_from_s = 4800.0),
        case("state-other-branch", "Three plays; the verify run starts on the other branch.")
            .verify_with(|r| r.plan.branch = -1.0)
            .with(Effect::bias(Hysteresis, "three plays", hysteresis::three_plays)),
        case("state-other-branch-thresholds", "Two thresholds; the train run starts on the other branch.")
            .each_train(|r| r.plan.branch = -1.0)
            .with(Effect::bias(Hysteresis, "two thresholds", hysteresis::two_thresholds).beside(&[Shape])),
        case("state-kept-from-yesterday", "A slow body holds 25 C of the day before when the verify run begins.")
            .verify_with(|r| r.plan.kept_c = 25.0)
            .with(Effect::bias(Memory, "kept from yesterday", memory::kept_from_yesterday).or(&[Class::PowerOn])),
        case("state-cold-start", "The verify run starts in the cold, the train run at room temperature; soft relays.")
            .verify_with(|r| r.plan.span.start_c = -30.0)
            .with(Effect::bias(Hysteresis, "soft relays", hysteresis::soft_relays).beside(&[Shape])),
    ]
}

const NARROW: &str = "the train run did not visit the verify run's temperatures";

fn spans() -> Vec<Case> {
    let narrow = |name: &str, description: &str| {
        case(name, description).programs(Stairs, Cycles).each_train(|r| {
            r.plan.span.low_c = 5.0;
            r.plan.span.high_c = 30.0;
        })
    };
    vec![
        narrow("span-narrow", "Clean; trained from 10 to 35 C, verified from -37 to 60 C.").beyond(NARROW),
        narrow("span-narrow-exponential", "A hot exponential that the narrow train run hardly sees.")
            .with(Effect::bias(Shape, "hot exponential", shape::hot_exponential).floors([0.5; 3]).or(&[Class::None]))
            .beyond(NARROW),
        narrow("span-narrow-rod", "The far end of a rod; trained from 10 to 35 C, verified from -37 to 60 C.")
            .with(Effect::bias(Memory, "rod", memory::rod))
            .beyond(NARROW),
        case("span-heating-only", "The far end of a rod; the train run heats only.")
            .programs(HeatingOnly, SetpointWalk)
            .each_train(|r| r.plan.span.start_c = r.plan.span.low_c)
            .with(Effect::bias(Memory, "rod", memory::rod).or(&[Class::PowerOn]))
            .beyond("a run in one direction cannot part memory from temperature"),
        case("span-cooling-only-clean", "Clean; the train run cools only.")
            .programs(CoolingOnly, Cycles)
            .each_train(|r| r.plan.span.start_c = r.plan.span.high_c)
            .beyond("a run in one direction cannot part rate terms from temperature"),
        case("span-gentle-then-brisk", "Saturating dT/dt; trained below 0.8 C/min, verified at 2 C/min.")
            .programs(Gentle, Brisk)
            .with(Effect::bias(Rate, "saturating", rate::saturating))
            .beyond("the train run did not visit the verify run's ramps"),
        case("span-soaks", "Two hinges; trained on soaks of an hour and the ramps between.")
            .programs(Soaks, Cycles)
            .with(Effect::bias(Shape, "hinges", shape::hinges)),
        case("span-short-train", "Preisach's loops; the train run has 4 h.")
            .programs(Brisk, ShrinkingLoops)
            .each_train(|r| r.plan.hours = 4.0)
            .with(Effect::bias(Hysteresis, "Preisach, smooth", hysteresis::preisach_smooth).beside(&[Shape])),
    ]
}

fn files() -> Vec<Case> {
    vec![
        case("file-defects", "A few defects of each kind; a body behind two poles.")
            .each_train(|r| r.defects = Some(Defects::Few))
            .verify_with(|r| r.defects = Some(Defects::Few))
            .with(Effect::bias(Memory, "two poles", memory::two_poles)),
        case("file-many-defects", "Many defects, a long gap, CR LF; clean otherwise.")
            .each_train(|r| r.defects = Some(Defects::Many))
            .verify_with(|r| r.defects = Some(Defects::Many)),
        case("file-one-axis", "One axis only, y; a smooth step.")
            .layout(|l| l.axes = vec![1])
            .with(Effect::bias(Shape, "smooth step", shape::smooth_step).floors([0.0, 3.0, 0.0])),
        case("file-two-axes", "Two axes, x and z; Bouc and Wen's loop.")
            .layout(|l| l.axes = vec![0, 2])
            .with(Effect::bias(Hysteresis, "Bouc-Wen", hysteresis::bouc_wen_loop).floors([3.0, 0.0, 3.0])),
        case("file-sensors", "Sensors instead of frequencies; a spectrum of time constants.")
            .layout(|l| l.followed = Followed::Case)
            .with(Effect::bias(Memory, "log-normal spectrum", memory::log_normal)),
        case("file-one-sensor", "One sensor for all axes; interference over temperature.")
            .layout(|l| l.followed = Followed::Base)
            .with(Effect::bias(Shape, "long ripple", shape::ripple_long)),
        case("file-slow-rows", "A row each 5 s; three plays.").layout(|l| l.row_s = 5.0).with(Effect::bias(
            Hysteresis,
            "three plays",
            hysteresis::three_plays,
        )),
        case("file-fast-rows", "Two rows a second; clean.").layout(|l| l.row_s = 0.5),
        case("file-old-names", "Case columns under their old names, the earth's rate in the rates; r T^2.")
            .programs(SawSweep, SetpointWalk)
            .layout(|l| {
                l.old_names = true;
                l.earth = true;
            })
            .with(Effect::bias(Rate, "r T^2", rate::times_t_squared)),
        case("file-bare", "Required columns only; a power law from power-on.")
            .layout(|l| {
                l.cases = false;
                l.chamber = false;
                l.board = false;
                l.electrics = false;
            })
            .with(Effect::bias(PowerOn, "power law", power_on::power_law)),
        case("file-untimed", "No time column, the step in the metadata; a cusp.")
            .layout(|l| l.untimed = true)
            .with(Effect::bias(Shape, "cusp", shape::cusp)),
        case("file-shuffled", "Columns in another order, one that nobody knows, time that starts a day late; a lag.")
            .layout(|l| l.shuffled = true)
            .with(Effect::bias(Memory, "one pole", memory::one_pole)),
    ]
}
