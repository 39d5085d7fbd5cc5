//! Screen of `hrg monitor`: the state of a unit as its messages report it, drawn on a terminal.

use crate::unit::named;
use hrg_core::inputs;
use hrg_core::link::{mode, Housekeeping, Identity, InputsUsed, Message};
use hrg_core::status::{AxisStatus, UnitStatus};
use hrg_data::axes::AXIS_NAMES;
use hrg_data::error::BadInput;
use hrg_simulate::Profile;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Borders, Paragraph, Row, Sparkline, Table};
use ratatui::Frame;
use std::collections::VecDeque;

/// A soak is stable where every resonator changes by less than this, C per minute.
pub const STABLE_C_PER_MIN: f32 = 0.01;
/// Seconds that the sparklines show.
const HISTORY: usize = 120;

/// Known state of the unit.
#[derive(Debug, Default)]
pub struct State {
    /// Identity of the unit.
    pub identity: Option<Identity>,
    /// The last second.
    pub last: Option<Housekeeping>,
    /// The inputs that the last step has used.
    pub inputs: Option<InputsUsed>,
    raw: [VecDeque<f32>; 3],
    corrected: [VecDeque<f32>; 3],
    /// Since when the temperatures have been stable, ms of the unit's time.
    stable_since: Option<u32>,
    /// Rate frames seen since the last second, and in the second before.
    frames: (u32, u32),
    /// Frames that could not be read.
    pub bad_frames: u64,
    /// Fault of the port, if any.
    pub port_error: Option<String>,
    /// The chamber profile that runs, begun at the unit's power-on.
    pub profile: Option<Profile>,
    /// The unit's log tells all of this, and nothing of the link.
    pub of_log: bool,
}

impl State {
    /// Takes a message.
    pub fn take(&mut self, message: &Message) {
        match message {
            Message::Identity(i) => self.identity = Some(*i),
            Message::Rate(_) => self.frames.0 += 1,
            Message::Housekeeping(h) => self.second(h),
            Message::InputsUsed(used) => self.inputs = Some(*used),
            _ => {}
        }
    }

    fn second(&mut self, h: &Housekeeping) {
        if self.last.is_some_and(|l| h.time_ms < l.time_ms) {
            // Powered on again.
            self.stable_since = None;
        }
        self.frames = (0, self.frames.0);
        for a in 0..3 {
            for (store, value) in [(&mut self.raw[a], h.raw_dph[a]), (&mut self.corrected[a], h.corrected_dph[a])] {
                store.push_back(value);
                if store.len() > HISTORY {
                    store.pop_front();
                }
            }
        }
        let known = h.temperature_c.iter().all(|t| t.is_finite());
        let settling = h.axis_status.iter().any(|s| s.contains(AxisStatus::SETTLING));
        let stable = known && !settling && h.ramp_c_per_min.iter().all(|r| r.abs() < STABLE_C_PER_MIN);
        self.stable_since = if stable { self.stable_since.or(Some(h.time_ms)) } else { None };
        self.last = Some(*h);
    }

    /// Minutes for which every resonator has been stable; `None` while one is not.
    #[must_use]
    pub fn stable_min(&self) -> Option<f64> {
        let since = self.stable_since?;
        Some(f64::from(self.last?.time_ms.saturating_sub(since)) / 60_000.0)
    }

    /// Hours that the profile still takes.
    #[must_use]
    pub fn remaining_h(&self) -> Option<f64> {
        let total = self.profile.as_ref()?.temperatures().len() as f64;
        Some(((total - f64::from(self.last?.time_ms) / 1000.0) / 3600.0).max(0.0))
    }
}

/// Names of the bits that are set.
fn words(bits: u16, names: &[&str]) -> String {
    let set: Vec<&str> = named(bits, names).collect();
    if set.is_empty() {
        "good".into()
    } else {
        set.join(" ")
    }
}

/// A date from seconds since 1970: year-month-day (days to civil, Howard Hinnant's algorithm).
#[must_use]
pub fn date(unix_s: u32) -> String {
    let z = i64::from(unix_s / 86_400) + 719_468;
    let era = z / 146_097;
    let doe = z - era * 146_097;
    let yoe = (doe - doe / 1460 + doe / 36_524 - doe / 146_096) / 365;
    let doy = doe - (365 * yoe + yoe / 4 - yoe / 100);
    let mp = (5 * doy + 2) / 153;
    let (d, m) = (doy - (153 * mp + 2) / 5 + 1, if mp < 10 { mp + 3 } else { mp - 9 });
    format!("{}-{m:02}-{d:02}", yoe + era * 400 + i64::from(m <= 2))
}

fn clock(ms: u32) -> String {
    let s = ms / 1000;
    format!("{}:{:02}:{:02}", s / 3600, s / 60 % 60, s % 60)
}

/// Draws the state.
pub fn draw(frame: &mut Frame<'_>, state: &State) {
    // (Inputs take up to three rows on a terminal of 80 columns.)
    let foot_rows = if state.inputs.is_some() { 9 } else { 6 };
    let [head, table, lines, foot] = Layout::vertical([
        Constraint::Length(2),
        Constraint::Length(7),
        Constraint::Min(6),
        Constraint::Length(foot_rows),
    ])
    .areas(frame.area());
    let bold = Style::default().add_modifier(Modifier::BOLD);
    let bad = Style::default().fg(Color::Red);
    let name = state.identity.map_or_else(|| "?".into(), |i| i.unit_name().to_string());
    let Some(h) = state.last else {
        let wait = state.port_error.clone().unwrap_or_else(|| "waiting for the unit".into());
        frame.render_widget(Paragraph::new(format!("unit {name}: {wait}   (q ends)")), head);
        return;
    };
    let image = if h.unit_status.contains(UnitStatus::DEFAULT_CALIBRATION) {
        Span::styled("no calibration: compiled-in default".to_string(), bad)
    } else {
        Span::raw(format!("image {:08x} no. {} of {}", h.calibration, h.sequence, date(h.created_unix_s)))
    };
    // (As correct::TURN_ON says it, in the room that there is.)
    let stated = h.bias_std_dph.iter().any(|s| s.is_finite());
    let about = if stated { "   \u{b1} may lack the turn-on constant" } else { "" };
    let mode = mode::NAMES.get(usize::from(h.mode)).copied().unwrap_or("?");
    frame.render_widget(
        Paragraph::new(vec![
            Line::from(vec![Span::styled(format!("unit {name}  "), bold), image]),
            Line::from(format!("on for {}   mode {mode}   q ends{about}", clock(h.time_ms))),
        ]),
        head,
    );
    axes_table(frame, table, &h);
    let third = Layout::vertical([Constraint::Ratio(1, 3); 3]).split(lines);
    for a in 0..3 {
        let [left, right] =
            Layout::horizontal([Constraint::Percentage(50), Constraint::Percentage(50)]).areas(third[a]);
        sparkline(frame, left, &state.raw[a], &format!("{} raw", AXIS_NAMES[a]), Color::Gray);
        sparkline(frame, right, &state.corrected[a], &format!("{} corrected", AXIS_NAMES[a]), Color::Blue);
    }
    let mut text = foot_lines(state, &h);
    text.extend(inputs_line(state));
    frame.render_widget(
        Paragraph::new(text).wrap(ratatui::widgets::Wrap { trim: true }).block(Block::default().borders(Borders::TOP)),
        foot,
    );
}

/// One row an axis.
fn axes_table(frame: &mut Frame<'_>, area: Rect, h: &Housekeeping) {
    let bad = Style::default().fg(Color::Red);
    let bold = Style::default().add_modifier(Modifier::BOLD);
    let rows = (0..3).map(|a| {
        let status = words(h.axis_status[a].bits(), &AxisStatus::NAMES);
        let style = if h.axis_status[a].is_empty() { Style::default() } else { bad };
        Row::new(vec![
            Span::raw(AXIS_NAMES[a]),
            Span::raw(format!("{:.4}", h.frequency_hz[a])),
            Span::raw(format!("{:.3}", h.temperature_c[a])),
            Span::raw(format!("{:+.3}", h.ramp_c_per_min[a])),
            Span::raw(format!("{:+.3}", h.raw_dph[a])),
            Span::raw(if h.bias_std_dph[a].is_finite() {
                format!("{:+.3} \u{b1}{:.3}", h.bias_dph[a], h.bias_std_dph[a])
            } else {
                format!("{:+.3}", h.bias_dph[a])
            }),
            Span::raw(format!("{:+.3}", h.corrected_dph[a])),
            Span::styled(status, style),
        ])
    });
    let widths = [
        Constraint::Length(2),
        Constraint::Length(10),
        Constraint::Length(8),
        Constraint::Length(8),
        Constraint::Length(9),
        Constraint::Length(13),
        Constraint::Length(9),
        Constraint::Min(12),
    ];
    let header = Row::new(["", "f [Hz]", "T [C]", "C/min", "raw deg/h", "bias", "corrected", "status"]).style(bold);
    frame.render_widget(
        Table::new(rows, widths).header(header).block(Block::default().borders(Borders::TOP | Borders::BOTTOM)),
        area,
    );
}

/// The inputs beside the frequencies, where any have come.
fn inputs_line(state: &State) -> Option<Line<'static>> {
    let used = state.inputs?;
    let shown = inputs::NAMES.iter().zip(used.values).filter(|(_, v)| v.is_finite());
    let shown: Vec<String> = shown.map(|(n, v)| format!("{n} {v:.4}")).collect();
    Some(Line::from(format!("inputs: {}", if shown.is_empty() { "none come in".into() } else { shown.join("  ") })))
}

/// Soak, profile, status of the unit and link.
fn foot_lines(state: &State, h: &Housekeeping) -> Vec<Line<'static>> {
    let bad = Style::default().fg(Color::Red);
    let soak = match state.stable_min() {
        Some(min) => format!("soak: stable to {STABLE_C_PER_MIN} C/min for {min:.0} min"),
        None => format!("soak: not stable (some resonator changes by {STABLE_C_PER_MIN} C/min or more)"),
    };
    let gyros = h.temperature_c.iter().filter(|t| t.is_finite());
    let (low, high) = gyros.fold((f32::INFINITY, f32::NEG_INFINITY), |(l, h), t| (l.min(*t), h.max(*t)));
    let profile = match (state.remaining_h(), &state.profile) {
        (Some(left), Some(p)) if p.ends_by_gyros().is_some() => format!(
            "profile: ends when every gyro reads {:.0} C (now {low:.1} to {high:.1}); about {left:.2} h left",
            p.ends_by_gyros().unwrap_or(f64::NAN)
        ),
        (Some(left), _) => format!("profile: {left:.2} h left"),
        (None, Some(_)) => "profile: waiting for the unit".into(),
        (None, None) => "profile: none given (--profile)".into(),
    };
    let unit = words(h.unit_status.bits(), &UnitStatus::NAMES);
    let link = if state.of_log {
        "link: not watched; this is the unit's log".to_string()
    } else {
        format!(
            "link: {} rate frames a second, {} bad frames here, {} bad at the unit, {} dropped; {} samples, {} ADC errors",
            state.frames.1, state.bad_frames, h.link_errors, h.dropped, h.samples, h.adc_errors
        )
    };
    let unit_style = if h.unit_status.is_empty() { Style::default() } else { bad };
    let mut text = vec![
        Line::from(soak),
        Line::from(profile),
        Line::from(vec![Span::raw("unit: "), Span::styled(unit, unit_style)]),
        Line::from(link),
    ];
    if let Some(e) = &state.port_error {
        text.insert(0, Line::from(Span::styled(e.clone(), bad)));
    }
    text
}

/// The terminal, for a screen that is drawn anew.
///
/// # Errors
/// A sentence where the output is no terminal.
pub fn terminal() -> anyhow::Result<ratatui::DefaultTerminal> {
    use std::io::IsTerminal;
    if !std::io::stdout().is_terminal() {
        return Err(BadInput::new(
            "the output is no terminal, so no screen can be drawn; --snapshot SECONDS prints one screen and ends",
        )
        .into());
    }
    Ok(ratatui::try_init()?)
}

/// The screen as text, 80 by 24.
///
/// # Errors
/// If the drawing library fails.
pub fn screen(state: &State) -> anyhow::Result<String> {
    let mut terminal = ratatui::Terminal::new(ratatui::backend::TestBackend::new(80, 24))?;
    terminal.draw(|f| draw(f, state))?;
    let rows: Vec<String> = terminal
        .backend()
        .buffer()
        .content()
        .chunks(80)
        .map(|row| row.iter().map(ratatui::buffer::Cell::symbol).collect::<String>().trim_end().to_string())
        .collect();
    Ok(rows.join("\n") + "\n")
}

fn sparkline(frame: &mut Frame<'_>, area: Rect, values: &VecDeque<f32>, title: &str, colour: Color) {
    let room = usize::from(area.width.saturating_sub(1));
    let shown: Vec<f32> = values.iter().rev().take(room).rev().copied().collect();
    let finite = shown.iter().copied().filter(|v| v.is_finite());
    let (low, high) = finite.fold((f32::INFINITY, f32::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    let range = if low <= high { format!("{low:+.2} to {high:+.2} deg/h") } else { "no data".into() };
    let span = (high - low).max(1e-6);
    // The lowest value keeps a mark: an empty column is a missing second.
    let bars: Vec<u64> =
        shown.iter().map(|v| if v.is_finite() { 8 + ((v - low) / span * 92.0) as u64 } else { 0 }).collect();
    frame.render_widget(
        Sparkline::default()
            .data(&bars)
            .max(100)
            .style(Style::default().fg(colour))
            .block(Block::default().title(format!("{title}: {range}"))),
        area,
    );
}

#[cfg(test)]
mod tests {
    use super::*;
    use hrg_core::unit_name::UnitName;

    fn housekeeping(time_ms: u32, slope: f32) -> Housekeeping {
        Housekeeping {
            step: time_ms / 1000,
            time_ms,
            on_for_s: 0.001 * time_ms as f32,
            frequency_hz: [4898.626, 4890.667, 4702.343],
            temperature_c: [6.314, 4.875, 4.934],
            ramp_c_per_min: [slope, 0.0, 0.0],
            bias_dph: [1.0, 2.0, 3.0],
            bias_std_dph: [0.05, 0.05, f32::NAN],
            raw_dph: [4.0 + (time_ms % 7000) as f32 / 7000.0, 5.0, f32::NAN],
            corrected_dph: [3.0, 3.0, f32::NAN],
            samples: 1000,
            adc_errors: 0,
            axis_status: [AxisStatus::empty(), AxisStatus::empty(), AxisStatus::FREQUENCY_LOST],
            unit_status: UnitStatus::empty(),
            rejected: [0; 3],
            missing: [0; 3],
            resets: 0,
            dropped: 0,
            link_errors: 2,
            calibration: 0xDEAD_BEEF,
            sequence: 4,
            created_unix_s: 1_795_219_200,
            mode: 0,
            pps_tick: 0,
            pps_age_ms: u32::MAX,
            clock_ppb: 0.0,
        }
    }

    #[test]
    fn everything_is_on_a_screen_of_80_by_24() {
        let mut state = State { profile: Profile::parse("20,50@1,2h").ok(), ..State::default() };
        assert!(screen(&state).expect("drawn").contains("waiting for the unit"));
        let identity = Identity {
            unit: UnitName::new("HRG-101"),
            calibration: 0,
            created_unix_s: 0,
            sequence: 4,
            ..Identity::default()
        };
        state.take(&Message::Identity(identity));
        for k in 1..=3000 {
            state.take(&Message::Housekeeping(housekeeping(k * 1000, if k < 600 { 0.2 } else { 0.005 })));
        }
        let text = screen(&state).expect("drawn");
        for part in [
            "unit HRG-101",
            "image deadbeef no. 4 of 2026-11-21",
            "on for 0:50:00   mode navigate",
            "4898.6260",
            "+0.005",
            "frequency-lost",
            "good",
            "stable to 0.01 C/min for 40 min",
            "1.67 h left",
            "2 bad at the unit",
            "x raw: +4.00 to +4.86 deg/h",
            "z corrected: no data",
        ] {
            assert!(text.contains(part), "{part} is not on\n{text}");
        }
    }

    #[test]
    fn a_profile_that_ends_by_the_gyros_shows_where_they_are() {
        let mut state = State { profile: Profile::parse("dong2023").ok(), ..State::default() };
        state.take(&Message::Housekeeping(housekeeping(3_600_000, 0.2)));
        let text = screen(&state).expect("drawn");
        assert!(text.contains("ends when every gyro reads 50 C (now 4.9 to 6.3)"), "{text}");
    }

    #[test]
    fn a_change_or_a_restart_ends_a_soak() {
        let mut state = State::default();
        for k in 1..100 {
            state.second(&housekeeping(k * 60_000, 0.0));
        }
        assert_eq!(state.stable_min(), Some(98.0));
        state.second(&housekeeping(101 * 60_000, 0.02));
        assert_eq!(state.stable_min(), None);
        state.second(&housekeeping(102 * 60_000, 0.0));
        state.second(&housekeeping(1000, 0.0));
        assert_eq!(state.stable_min(), Some(0.0));
    }

    #[test]
    fn dates() {
        for (s, text) in [(0, "1970-01-01"), (951_782_400, "2000-02-29"), (1_795_219_200, "2026-11-21")] {
            assert_eq!(date(s), text);
        }
    }
}
