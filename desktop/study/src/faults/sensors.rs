//! Resonators and ADC.

use super::memory::unsaid;
use super::{good, run, trials, Extent, Report, Scene, BOUND_DPH, LOOKS_AT_OTHERS};
use anyhow::Result;
use hrg_board::host::cycles;
use hrg_board::wires::{AdcFault, AxisFault, Received, WireFaults, Wires};
use hrg_core::compensator::HOLD_S;
use hrg_core::status::{AxisStatus, UnitStatus};
use hrg_core::AXES;
use hrg_data::axes::AXIS_NAMES;
use virtual_board::{Board, Snapshot, CPU_HZ};

/// One fault of one sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Fault {
    Axis(usize, AxisFault),
    Adc(AdcFault),
}

/// A fault with the flags that must follow (any of them), and within what time, s.
struct Case {
    name: String,
    fault: Fault,
    flags: Flags,
    within_s: f64,
}

/// Flags that a fault raises: of an axis, or of the unit.
enum Flags {
    Axis(usize, AxisStatus),
    Unit(UnitStatus),
}

impl Case {
    /// The axis that it is about.
    fn axis(&self) -> Option<usize> {
        match self.flags {
            Flags::Axis(a, _) => Some(a),
            Flags::Unit(_) => None,
        }
    }
}

impl Flags {
    fn any(&self, axes: &[AxisStatus; 3], unit: UnitStatus) -> bool {
        match self {
            Self::Axis(a, flags) => axes[*a].intersects(*flags),
            Self::Unit(flags) => unit.intersects(*flags),
        }
    }
}

/// A fault lasts so long, s. Longer than a frequency is bridged.
const LASTS_S: f64 = 14.0;
/// It begins so long after the scene, s: within a model step.
const BEGINS_S: f64 = 1.37;
/// All flags are gone so long after its end, s: what a jump back takes to be accepted (where a drift had been) and to settle.
const RECOVERS_S: f64 = 55.0;
/// A model step in which it began may still be good; the next is not; its bias holds 60 ms later.
const NEXT_STEP_S: f64 = 2.1;

fn cases() -> Vec<Case> {
    let mut cases = Vec::new();
    for a in 0..3 {
        let mut axis_case = |name: &str, fault, flags, within_s| {
            let name = format!("{} {name}", AXIS_NAMES[a]);
            cases.push(Case { name, fault: Fault::Axis(a, fault), flags: Flags::Axis(a, flags), within_s });
        };
        axis_case("edges stop", AxisFault::Stop, AxisStatus::FREQUENCY_LOST, NEXT_STEP_S);
        axis_case("edges double", AxisFault::Double(60e-6), AxisStatus::EDGE_ERRORS, NEXT_STEP_S);
        axis_case("edges jitter by 2 us", AxisFault::Jitter(2e-6), AxisStatus::EDGE_ERRORS, NEXT_STEP_S);
        let out = AxisStatus::RAMP_RANGE | AxisStatus::TEMPERATURE_RANGE;
        axis_case("drifts out of range", AxisFault::Drift(0.1), out | AxisStatus::FREQUENCY_LOST, 8.0);
        axis_case("jumps by 1 Hz", AxisFault::Jump(1.0), AxisStatus::FREQUENCY_LOST, NEXT_STEP_S);
        cases.push(Case {
            name: format!("{} saturated", AXIS_NAMES[a]),
            fault: Fault::Adc(AdcFault::Saturated(a)),
            flags: Flags::Axis(a, AxisStatus::OVER_RANGE),
            within_s: 0.01,
        });
    }
    for (name, fault) in [
        ("ADC silent", AdcFault::Silent),
        ("ADC at half its rate", AdcFault::HalfRate),
        ("ADC stuck", AdcFault::Stuck),
        ("ADC checksum errors", AdcFault::Checksum),
    ] {
        let fault = Fault::Adc(fault);
        cases.push(Case { name: name.into(), fault, flags: Flags::Unit(UnitStatus::ADC_FAULT), within_s: NEXT_STEP_S });
    }
    cases
}

/// Axes that no fault touches: they must show none. None where the samples themselves are touched.
fn untouched(faults: &[&Case]) -> Vec<usize> {
    let mut left: Vec<usize> = (0..3).collect();
    for c in faults {
        match c.fault {
            Fault::Axis(a, _) => left.retain(|k| *k != a && *k != LOOKS_AT_OTHERS),
            Fault::Adc(AdcFault::Saturated(a)) => left.retain(|k| *k != a),
            Fault::Adc(_) => left.clear(),
        }
    }
    left
}

/// Result of one trial.
#[derive(Debug, Default)]
struct Outcome {
    /// From the fault's begin to the flag asked for, s; of each fault.
    flagged_s: Vec<f64>,
    /// From the end of all faults to the last flag, s.
    recovered_s: f64,
    /// Largest error of a frame flagged good, deg/h.
    unsaid_dph: f32,
    /// Frames in which an untouched axis differs in any bit.
    disturbed: usize,
    resets: u32,
    /// From the begin of a frequency outage to the flag for a stale temperature, s.
    stale_s: Option<f64>,
    /// Frames flagged good long after the end.
    good_again: bool,
}

fn play(board: &mut Board<Wires>, start: &Snapshot<Wires>, truth: &Received, faults: &[&Case]) -> Result<Outcome> {
    board.restore(start)?;
    let begin = board.now() as f64 / CPU_HZ as f64;
    let window = begin + BEGINS_S..begin + BEGINS_S + LASTS_S;
    let mut wires = WireFaults::default();
    for c in faults {
        match c.fault {
            Fault::Axis(a, f) => wires.axis.push((a, f, window.clone())),
            Fault::Adc(f) => wires.adc.push((f, window.clone())),
        }
    }
    board.world.set_faults(wires);
    let end = cycles(window.end + RECOVERS_S + 2.0);
    let mut o =
        Outcome { resets: run(board, end)?.n, flagged_s: vec![f64::INFINITY; faults.len()], ..Outcome::default() };
    let r = &board.world.received;
    let seconds = |at: u64| at as f64 / CPU_HZ as f64;
    let untouched = untouched(faults);
    // Truth by tick; and by time where samples are missing and frames begin elsewhere.
    let by_tick: std::collections::HashMap<u32, usize> =
        truth.rates.iter().enumerate().map(|(k, f)| (f.tick, k)).collect();
    let mut last_flag = window.end;
    for (f, &at) in r.rates.iter().zip(&r.rate_at) {
        let t = seconds(at);
        for (c, first) in faults.iter().zip(&mut o.flagged_s) {
            if t > window.start && c.flags.any(&f.axis_status, f.unit_status) {
                *first = first.min(t - window.start);
            }
            if let Fault::Axis(a, AxisFault::Stop) = c.fault {
                if o.stale_s.is_none() && f.axis_status[a].contains(AxisStatus::TEMPERATURE_STALE) {
                    o.stale_s = Some(t - window.start);
                }
            }
        }
        if !good(f) && t > last_flag {
            last_flag = t;
        }
        let same_tick = by_tick.get(&f.tick).map(|k| &truth.rates[*k]);
        if !untouched.is_empty() {
            let same = same_tick.is_some_and(|t| {
                untouched.iter().all(|&k| {
                    t.rate_dph[k].to_bits() == f.rate_dph[k].to_bits() && t.axis_status[k] == f.axis_status[k]
                })
            });
            o.disturbed += usize::from(!same);
        }
        if let Some(truth) = same_tick {
            o.unsaid_dph = o.unsaid_dph.max(unsaid(f, truth));
        }
    }
    // Without rates the housekeeping says it.
    for (h, &at) in r.housekeeping.iter().zip(&r.housekeeping_at) {
        let t = seconds(at);
        for (c, first) in faults.iter().zip(&mut o.flagged_s) {
            let of_unit = matches!(c.flags, Flags::Unit(_));
            if t > window.start && of_unit && c.flags.any(&h.axis_status, h.unit_status) {
                *first = first.min(t - window.start);
            }
        }
    }
    o.recovered_s = last_flag - window.end;
    o.good_again = r.rates.last().is_some_and(good);
    Ok(o)
}

/// Each fault alone, and each combination of two.
///
/// # Errors
/// If the unit cannot be run at all.
pub fn attack(scene: &Scene, extent: &Extent, report: &mut Report) -> Result<()> {
    let cases = cases();
    let n = cases.len();
    let pairs: Vec<(usize, usize)> =
        (0..n).flat_map(|a| (a + 1..n).map(move |b| (a, b))).step_by(extent.pairs as usize).collect();
    // In the short form each fault of a resonator is on one axis: of all axes, some.
    let of_an_axis = cases.iter().filter(|c| c.axis() == Some(0)).count();
    let alone: Vec<usize> =
        (0..n).filter(|&k| extent.on_each_axis || cases[k].axis().is_none_or(|a| a == k % of_an_axis % AXES)).collect();
    let outcomes = trials(
        (alone.len() + pairs.len()) as u64,
        || {
            let mut board = scene.settled()?;
            let truth = scene.undisturbed(&mut board, BEGINS_S + LASTS_S + RECOVERS_S + 3.0)?;
            let start = board.snapshot()?;
            Ok((board, start, truth))
        },
        |(board, start, truth), k| {
            let k = k as usize;
            let faults: Vec<&Case> = if k < alone.len() {
                vec![&cases[alone[k]]]
            } else {
                let (a, b) = pairs[k - alone.len()];
                vec![&cases[a], &cases[b]]
            };
            play(board, start, truth, &faults)
        },
    )?;
    for (c, o) in alone.iter().map(|k| &cases[*k]).zip(&outcomes) {
        let flagged = o.flagged_s[0];
        let stale = o.stale_s.map_or_else(String::new, |s| format!(", bridged, then stale after {s:.1} s"));
        let bridged = o.stale_s.is_none_or(|s| (s - f64::from(HOLD_S)).abs() < 2.5);
        report.row(
            c.name.as_str(),
            1,
            format!(
                "flagged after {flagged:.2} s{stale}, clear {:.1} s after its end; unflagged error at most {:.3} deg/h; {} frames of untouched axes differ",
                o.recovered_s, o.unsaid_dph, o.disturbed
            ),
            flagged <= c.within_s && bridged && kept(o),
        );
    }
    let both = &outcomes[alone.len()..];
    let most = |of: fn(&Outcome) -> f64| both.iter().map(of).fold(0.0, f64::max);
    let broken: Vec<String> = pairs
        .iter()
        .zip(both)
        .filter(|((a, b), o)| !(kept(o) && both_flagged(&cases[*a], &cases[*b], o)))
        .map(|((a, b), _)| format!("{} with {}", cases[*a].name, cases[*b].name))
        .collect();
    report.row(
        "two of these at once",
        pairs.len() as u64,
        format!(
            "clear {:.1} s after the end at the latest; unflagged error at most {:.3} deg/h; {:.0} frames of untouched axes differ, {:.0} resets{}",
            most(|o| o.recovered_s),
            most(|o| f64::from(o.unsaid_dph)),
            most(|o| o.disturbed as f64),
            most(|o| f64::from(o.resets)),
            if broken.is_empty() { String::new() } else { format!("; {}", broken.join(", ")) }
        ),
        broken.is_empty(),
    );
    Ok(())
}

fn kept(o: &Outcome) -> bool {
    o.recovered_s <= RECOVERS_S && o.unsaid_dph <= BOUND_DPH && o.disturbed == 0 && o.resets == 0 && o.good_again
}

/// `true` if both were flagged in time. On one and the same resonator one hides the other: there one flag will do. Without samples
/// there are no rates to flag.
fn both_flagged(a: &Case, b: &Case, o: &Outcome) -> bool {
    let in_time = [o.flagged_s[0] <= a.within_s, o.flagged_s[1] <= b.within_s];
    let hides = |c: &Case| matches!(c.fault, Fault::Adc(AdcFault::Silent | AdcFault::Stuck | AdcFault::Checksum));
    let one_resonator = matches!((a.fault, b.fault), (Fault::Axis(x, _), Fault::Axis(y, _)) if x == y);
    match (hides(a), hides(b)) {
        (false, false) if one_resonator => in_time[0] || in_time[1],
        (false, false) => in_time[0] && in_time[1],
        (true, false) => in_time[0],
        (false, true) => in_time[1],
        (true, true) => in_time[0] || in_time[1],
    }
}
