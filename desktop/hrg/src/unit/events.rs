//! The field log in words.

use crate::unit::named;
use crate::unit::symbols::Symbols;
use hrg_core::events::{Event, Record};
use hrg_core::half::Half;
use hrg_core::maintenance::Answer;
use hrg_core::output::OutputSettings;
use hrg_core::reset::Halt;
use hrg_core::sectors::Place;
use hrg_core::self_test::Check;
use hrg_core::slots::State;
use hrg_core::status::{AxisStatus, UnitStatus};
use hrg_core::stopped::{Silent, Stopped};
use hrg_data::axes::AXIS_NAMES;

/// Time since power-on as days, hours, minutes, seconds.
fn time(s: u32) -> String {
    let (days, h, m) = (s / 86_400, s / 3600 % 24, s / 60 % 60);
    if days > 0 {
        format!("{days} d {h:02}:{m:02}:{:02}", s % 60)
    } else {
        format!("{h:02}:{m:02}:{:02}", s % 60)
    }
}

/// Names of the flags of some bits.
fn flags(bits: u16, names: &[&str]) -> String {
    named(bits, names).collect::<Vec<_>>().join(", ")
}

/// Kinds of a fault by bit of CFSR (PM0214 section 4.4.10).
const FAULTS: [(u8, &str); 16] = [
    (0, "code where none may run"),
    (1, "access that is forbidden"),
    (3, "forbidden access on the way back from an exception"),
    (4, "forbidden access on the way into an exception"),
    (5, "forbidden access in keeping FPU registers"),
    (8, "bus error at an instruction"),
    (9, "bus error"),
    (10, "bus error, somewhat earlier"),
    (11, "bus error on the way back from an exception"),
    (12, "bus error on the way into an exception"),
    (16, "undefined instruction"),
    (17, "invalid state"),
    (18, "invalid return from an exception"),
    (19, "FPU is off"),
    (24, "unaligned access"),
    (25, "division by zero"),
];

/// Words on a stop. `symbols`: of the program that has stopped.
#[must_use]
pub fn stop(s: &Stopped, symbols: Option<&Symbols>) -> String {
    let at = |address: u32| match symbols.and_then(|symbols| symbols.name(address)) {
        Some(name) => format!("{address:#010x} ({name})"),
        None => format!("{address:#010x}"),
    };
    // (A call returns to behind itself.)
    let caller = |address: u32| at((address & !1).saturating_sub(2));
    let what = match s.halt {
        Halt::None if s.silent.is_empty() => "nothing was left".to_string(),
        Halt::None => {
            let parts = flags(s.silent.bits().into(), &Silent::NAMES);
            let ran = format!("; {} ran, called from {}", at(s.pc), caller(s.lr));
            format!("the watchdog: silent were {parts}{}", if s.pc == 0 { String::new() } else { ran })
        }
        Halt::Stack => "the stack has left its room".to_string(),
        Halt::Panic => format!("panic at {}:{}", s.file(), s.line),
        Halt::Fault if s.cfsr != 0 || s.hfsr != 0 => {
            let kinds = FAULTS.iter().filter(|(bit, _)| s.cfsr >> bit & 1 != 0).map(|(_, name)| *name);
            let kinds: Vec<&str> = kinds.collect();
            let address = if s.address == 0 { String::new() } else { format!(" at the address {:#010x}", s.address) };
            format!(
                "fault, {}{address}, at {}, called from {} (CFSR {:08x}, HFSR {:08x})",
                if kinds.is_empty() { "of no known kind".into() } else { kinds.join(", ") },
                at(s.pc),
                caller(s.lr),
                s.cfsr,
                s.hfsr
            )
        }
        halt => format!("{}, found at {}", halt.name(), caller(s.pc)),
    };
    format!("{what}; stack used at the worst: {} bytes", s.stack)
}

/// All lines of the log; words of a stop are one line behind their start. `symbols`: of the program that has stopped.
#[must_use]
pub fn lines(records: &[Record], symbols: Option<&Symbols>) -> Vec<String> {
    let mut out = Vec::with_capacity(records.len());
    let mut stopped = Stopped::default();
    for (k, record) in records.iter().enumerate() {
        if !record.event.goes_into(&mut stopped) {
            out.push(line(record));
        } else if !matches!(records.get(k + 1), Some(Record { event: Event::Stopped(_), .. })) {
            out.push(format!("{:>12}  before it: {}", "", stop(&stopped, symbols)));
        }
    }
    out
}

/// One line: time since power-on, and what happened.
#[must_use]
pub fn line(record: &Record) -> String {
    let what = match record.event {
        Event::Start { cause, halt, resets, calibration } => {
            let image = if calibration == 0 { "no image".into() } else { format!("image {calibration:08x}") };
            let halt = match halt {
                hrg_core::reset::Halt::None => String::new(),
                halt => format!(", stopped before by {}", halt.name()),
            };
            format!("start after {}{halt}, {resets} resets since power-on, {image}", cause.name())
        }
        Event::Axis { axis, flags: rose, temperature } => format!(
            "{}: {} at {:.1} C",
            AXIS_NAMES.get(usize::from(axis)).copied().unwrap_or("?"),
            flags(rose.bits(), &AxisStatus::NAMES),
            f32::from_bits(temperature)
        ),
        Event::Unit { flags: rose } => format!("unit: {}", flags(rose.bits(), &UnitStatus::NAMES)),
        Event::Burn { answer: 0, calibration } => format!("burn: image {calibration:08x} taken"),
        Event::Burn { answer, .. } => {
            let why = Answer::from_number(answer).map_or_else(|| format!("answer {answer}"), |a| a.to_string());
            format!("burn refused: {why}")
        }
        Event::CutShort { place } => match Place::from_number(place) {
            Some(place) => format!("a burn was cut short ({place}): the image before it stays in use"),
            None => "a burn was cut short: the image before it stays in use".into(),
        },
        Event::ZeroOf { calibration, made_unix_s } => {
            format!("constants renewed under image ....{calibration:04x}, {}", crate::unit::monitor::date(made_unix_s))
        }
        Event::Zero { axis, std, constant } => format!(
            "{}: constant {:+.3} deg/h +- {:.3}",
            AXIS_NAMES.get(usize::from(axis)).copied().unwrap_or("?"),
            f32::from_bits(constant),
            Half::from_bits(std).value()
        ),
        Event::Test { at_start, failed, first: [check, index] } => {
            let which = if at_start { "test at the start" } else { "built-in test" };
            match (failed, Check::from_number(check)) {
                (0, _) => format!("{which}: passed"),
                (n, Some(check)) => format!("{which}: {n} failed, {} {index} first", check.facts().name),
                (n, None) => format!("{which}: {n} failed"),
            }
        }
        Event::Program { slot, state, sum } => format!(
            "program {sum:08x} in slot {}: {}",
            if slot == 0 { 'A' } else { 'B' },
            State::from_number(state).map_or("?", State::name)
        ),
        Event::Stopped(piece) => format!("word {} of the stop: {:08x}", piece.number, piece.value),
        Event::Output { settings } => OutputSettings::from_word(settings).map_or_else(
            || format!("output set to what this program does not know ({settings:#010x})"),
            |s| format!("output set: {}", crate::unit::output::in_words(&s)),
        ),
        Event::Lost { count: 0 } => "the log is full: what came after this was not written".into(),
        Event::Lost { .. } => "the log is nearly full: from here on only starts and burns were written".into(),
    };
    format!("{:>12}  {what}", time(record.on_for_s))
}

#[cfg(test)]
mod tests {
    use super::*;
    use hrg_core::reset::ResetCause;
    use hrg_core::stopped::Piece;

    #[test]
    fn each_event_is_a_line() {
        let say = |on_for_s, event| line(&Record { on_for_s, event });
        let start = Event::Start { cause: ResetCause::Watchdog, halt: Halt::ClockLost, resets: 2, calibration: 0xAB };
        assert_eq!(
            say(90_061, start),
            "1 d 01:01:01  start after watchdog, stopped before by clock-lost, 2 resets since power-on, image 000000ab"
        );
        let axis = Event::Axis {
            axis: 1,
            flags: AxisStatus::TEMPERATURE_RANGE | AxisStatus::NEIGHBOUR,
            temperature: 61.26f32.to_bits(),
        };
        assert_eq!(say(59, axis), "    00:00:59  y: temperature-range, neighbour at 61.3 C");
        assert_eq!(say(0, Event::Unit { flags: UnitStatus::ADC_FAULT }), "    00:00:00  unit: adc-fault");
        assert!(say(0, Event::Burn { answer: 7, calibration: 0 }).contains("not a valid image"));
        assert!(say(0, Event::Lost { count: 1 }).contains("only starts and burns"));
    }

    #[test]
    fn a_stop_is_one_line_behind_its_start() {
        let fault = Stopped {
            halt: Halt::Fault,
            stack: 4000,
            pc: 0x0801_2344,
            lr: 0x0801_0001,
            cfsr: 0x8200,
            hfsr: 1 << 30,
            address: 0xDEAD_BEE0,
            ..Stopped::default()
        };
        let record = |event| Record { on_for_s: 7, event };
        let start = |halt| record(Event::Start { cause: ResetCause::Watchdog, halt, resets: 1, calibration: 0 });
        let mut all = vec![start(Halt::Fault)];
        all.extend(fault.pieces().map(|p: Piece| record(Event::Stopped(p))));
        all.push(start(Halt::None));
        let silent = Stopped { silent: Silent::MODEL, stack: 9, ..Stopped::default() };
        all.extend(silent.pieces().map(|p| record(Event::Stopped(p))));
        let printed = lines(&all, None);
        assert_eq!(printed.len(), 4, "{printed:#?}");
        assert_eq!(
            printed[1].trim(),
            "before it: fault, bus error at the address 0xdeadbee0, at 0x08012344, called from 0x0800fffe (CFSR 00008200, HFSR 40000000); stack used at the worst: 4000 bytes"
        );
        assert_eq!(printed[3].trim(), "before it: the watchdog: silent were model; stack used at the worst: 9 bytes");
        let panic = Stopped { halt: Halt::Panic, line: 77, ..Stopped::default() }.in_file("firmware/src/model.rs");
        assert!(stop(&panic, None).starts_with("panic at firmware/src/model.rs:77"));
    }
}
