//! The field log in words.

use hrg_core::events::{Event, Record};
use hrg_core::half::Half;
use hrg_core::maintenance::Answer;
use hrg_core::sectors::Place;
use hrg_core::self_test::Check;
use hrg_core::status::{AxisStatus, UnitStatus};
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
    let set: Vec<&str> = names.iter().enumerate().filter(|(k, _)| bits & 1 << k != 0).map(|(_, n)| *n).collect();
    set.join(", ")
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
        Event::Unit { flags: rose } => format!("unit: {}", flags(rose.bits().into(), &UnitStatus::NAMES)),
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
        Event::Lost { count: 0 } => "the log is full: what came after this was not written".into(),
        Event::Lost { .. } => "the log is nearly full: from here on only starts and burns were written".into(),
    };
    format!("{:>12}  {what}", time(record.on_for_s))
}

#[cfg(test)]
mod tests {
    use super::*;
    use hrg_core::reset::{Halt, ResetCause};

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
}
