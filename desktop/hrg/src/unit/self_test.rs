//! The built-in test of a unit as a table, beside figures that need the host: its link there and back, and the noise of its rates against that of
//! the recording that it was calibrated with.

use super::port::Unit;
use anyhow::Result;
use hrg_core::adc::ALL_CHANNELS;
use hrg_core::self_test::{Check, Item, Verdict};
use hrg_core::AXES;
use hrg_data::axes::AXIS_NAMES;
use hrg_data::error::BadInput;
use hrg_data::numeric::stats::std_dev;
use hrg_data::recording::Recording;
use serde::Serialize;
use std::fmt::Write as _;
use std::time::{Duration, Instant};

/// Questions that are asked there and back.
const QUESTIONS: u32 = 100;
/// Most times that they are asked.
const ROUNDS: u32 = 3;
/// A question is answered within this; one that is not is lost.
const ANSWERED: Duration = Duration::from_millis(500);
/// An answer comes at once; what is more than this is a computer or a line that is busy, ms.
const SLOWEST_MS: f32 = 200.0;
/// Seconds over which the noise is measured.
pub const NOISE_S: usize = 60;
/// Noise as a share of the recording's: over so few seconds it scatters by a tenth, so these are some four standard deviations away.
const NOISE_SHARE: [f32; 2] = [0.6, 1.6];

/// One figure with its limits.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Row {
    /// Name of the check.
    pub check: &'static str,
    /// Its subject.
    pub meaning: &'static str,
    /// Channel, axis, or nothing.
    pub of: String,
    /// Figure; none: the unit has none.
    pub value: Option<f32>,
    /// Unit of the figure and its limits.
    pub unit: &'static str,
    /// Least and most that passes; none: not tested.
    pub limits: Option<[f32; 2]>,
    /// PASS, FAIL or "not tested".
    pub verdict: &'static str,
}

/// The whole test.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// Name of the unit.
    pub unit: String,
    /// PASS or FAIL.
    pub verdict: &'static str,
    /// All figures, in the order in which they were measured.
    pub rows: Vec<Row>,
}

const fn word(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Pass => "PASS",
        Verdict::Fail => "FAIL",
        Verdict::NotTested => "not tested",
    }
}

impl From<&Item> for Row {
    fn from(item: &Item) -> Self {
        let facts = item.check.facts();
        let of = match item.check {
            Check::Offset | Check::Positive | Check::Negative | Check::Noise => channel(item.index.into()),
            Check::RateNoise | Check::Temperature | Check::Edges => axis(item.index.into()),
            _ => String::new(),
        };
        let known = !(item.low.is_nan() || item.high.is_nan());
        Self {
            check: facts.name,
            meaning: facts.meaning,
            of,
            value: Some(item.value).filter(|v| v.is_finite()),
            unit: facts.unit,
            limits: known.then_some([item.low, item.high]),
            verdict: word(item.verdict()),
        }
    }
}

fn axis(index: usize) -> String {
    AXIS_NAMES.get(index).copied().unwrap_or("?").into()
}

/// A channel of the ADC, with its signal where it is a rate.
fn channel(index: usize) -> String {
    if index < AXES {
        format!("{index} ({})", axis(index))
    } else {
        index.to_string()
    }
}

/// A row of the host's own.
fn own(
    check: &'static str,
    meaning: &'static str,
    of: String,
    value: f32,
    unit: &'static str,
    limits: [f32; 2],
) -> Row {
    let [low, high] = limits;
    let verdict = word(Item { check: Check::Link, index: 0, value, low, high }.verdict());
    Row { check, meaning, of, value: Some(value).filter(|v| v.is_finite()), unit, limits: Some(limits), verdict }
}

impl Report {
    /// Has a unit test itself, and tests its link. `against`: a recording of the unit whose noise is compared; `told` is told what goes on.
    ///
    /// # Errors
    /// If the unit does not answer, or has no built-in test.
    pub fn of(unit: &mut Unit, against: Option<&Recording>, mut told: impl FnMut(&str)) -> Result<Self> {
        if let Some(recording) = against {
            comparable(unit, recording)?;
        }
        told("the unit tests itself; its rates are flagged meanwhile");
        let (name, items) = unit.self_test()?;
        let mut rows: Vec<Row> = items.iter().map(Row::from).collect();
        told("its link is asked there and back");
        rows.extend(link(unit)?);
        if let Some(recording) = against {
            told("the noise of its rates is measured for a minute");
            rows.extend(noise(unit, recording)?);
        }
        let failed = rows.iter().any(|r| r.verdict == word(Verdict::Fail));
        Ok(Self { unit: name, verdict: word(if failed { Verdict::Fail } else { Verdict::Pass }), rows })
    }

    /// The table: a line for each check that passes on all its channels or axes, a line for each figure that does not. `all`: a line for each.
    #[must_use]
    pub fn table(&self, all: bool) -> String {
        let mut out =
            format!("{:<14} {:<10} {:>24} {:>24} {:<10} verdict\n", "check", "of", "figure", "limits", "unit");
        let mut rest = self.rows.as_slice();
        while let Some(first) = rest.first() {
            let pass = word(Verdict::Pass);
            let alike = |r: &&Row| r.check == first.check && r.verdict == pass && r.limits == first.limits;
            let n = if all || first.verdict != pass { 1 } else { rest.iter().take_while(alike).count() };
            let (these, others) = rest.split_at(n.max(1));
            let _ = writeln!(out, "{}", line(these));
            rest = others;
        }
        let of = |verdict| self.rows.iter().filter(|r| r.verdict == word(verdict)).count();
        let _ = write!(out, "{}: unit {}, {} figures within their limits", self.verdict, self.unit, of(Verdict::Pass));
        for (n, what) in [(of(Verdict::Fail), "not"), (of(Verdict::NotTested), "not tested")] {
            if n > 0 {
                let _ = write!(out, ", {n} {what}");
            }
        }
        out
    }
}

/// Rows of one check, in a line.
fn line(rows: &[Row]) -> String {
    let [first, ..] = rows else { return String::new() };
    let values = rows.iter().filter_map(|r| r.value);
    let (low, high) = values.fold((f32::INFINITY, f32::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    let figure = if low > high {
        "none".into()
    } else if low == high {
        number(low)
    } else {
        format!("{} to {}", number(low), number(high))
    };
    let limits = match first.limits {
        None => String::new(),
        Some([low, high]) if low == high => number(low),
        Some([low, high]) => format!("{} to {}", number(low), number(high)),
    };
    let of = match rows.len() {
        1 => first.of.clone(),
        ALL_CHANNELS => "all".into(),
        n => format!("{n}"),
    };
    let of = if rows.len() == AXES && first.of.len() == 1 { "x, y, z".into() } else { of };
    let verdict = first.verdict;
    format!("{:<14} {of:<10} {figure:>24} {limits:>24} {:<10} {verdict}", first.check, first.unit)
}

/// A number with four figures.
fn number(v: f32) -> String {
    match v.abs() {
        a if a >= 1000.0 || v.fract() == 0.0 => format!("{v:.0}"),
        a if a >= 10.0 => format!("{v:.2}"),
        _ => format!("{v:.4}"),
    }
}

/// Questions there and back. A computer that is busy for a moment answers late itself: where the slowest answer is late, they are asked again.
fn link(unit: &mut Unit) -> Result<Vec<Row>> {
    let before = unit.bad_frames;
    let (mut lost, mut least_s) = (0u32, f32::INFINITY);
    for _ in 0..ROUNDS {
        let mut slowest_s = 0.0f32;
        for _ in 0..QUESTIONS {
            let asked = Instant::now();
            if unit.identity_within(ANSWERED)?.is_none() {
                lost += 1;
            }
            slowest_s = slowest_s.max(asked.elapsed().as_secs_f32());
        }
        least_s = least_s.min(slowest_s);
        if lost > 0 || least_s * 1e3 <= SLOWEST_MS {
            break;
        }
    }
    let broken = (unit.bad_frames - before) as f32;
    Ok(vec![
        own(
            "questions lost",
            "there and back: a hundred, and each hundred that was asked again",
            String::new(),
            lost as f32,
            "",
            [0.0, 0.0],
        ),
        own("frames broken", "that came from the unit meanwhile", String::new(), broken, "", [0.0, 0.0]),
        own(
            "slowest answer",
            "of a hundred, this computer's own time included; the best hundred, where they were asked again",
            String::new(),
            least_s * 1e3,
            "ms",
            [0.0, SLOWEST_MS],
        ),
    ])
}

/// Refuses a recording of another unit, of corrected rates, or with rows that are no seconds.
fn comparable(unit: &mut Unit, recording: &Recording) -> Result<()> {
    let identity = unit.reconnect(Duration::ZERO)?;
    let (name, of) = (identity.unit_name().to_string(), recording.unit());
    anyhow::ensure!(
        of == name,
        BadInput::new(format!("--against is a recording of unit {of}, and the unit on this port is {name}"))
    );
    let raw = recording.meta("rates").is_none_or(|rates| rates == "raw");
    anyhow::ensure!(
        raw,
        BadInput::new("--against is a recording of corrected rates; give the raw one that was fitted")
    );
    Ok(())
}

/// Noise of seconds, of successive differences, deg/h.
fn noise_of(rates: &[f64]) -> f64 {
    let steps: Vec<f64> = rates.windows(2).map(|w| w[1] - w[0]).filter(|d| d.is_finite()).collect();
    std_dev(&steps) / 2f64.sqrt()
}

/// The noise of the rates now, as a share of a recording's.
fn noise(unit: &mut Unit, recording: &Recording) -> Result<Vec<Row>> {
    let mut seconds = [const { Vec::new() }; AXES];
    for _ in 0..NOISE_S {
        let h = unit.second(Duration::from_secs(5))?;
        seconds.iter_mut().zip(h.raw_dph).for_each(|(to, rate)| to.push(f64::from(rate)));
    }
    let rows = seconds.iter().enumerate().map(|(a, now)| {
        let before = noise_of(&recording.rate_dph[a]);
        let share = (noise_of(now) / before) as f32;
        own("rate noise", "of seconds, as a share of the recording's", axis(a), share, "1", NOISE_SHARE)
    });
    Ok(rows.collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn item(check: Check, index: u8, value: f32, limits: [f32; 2]) -> Item {
        Item { check, index, value, low: limits[0], high: limits[1] }
    }

    #[test]
    fn what_passes_is_a_line_and_what_fails_stands_alone() {
        let mut items: Vec<Item> =
            (0..8).map(|k| item(Check::Offset, k, f32::from(k) - 3.5, [-6990.5, 6990.5])).collect();
        items.extend((0..8).map(|k| item(Check::Positive, k, if k == 1 { 0.95 } else { 1.0001 }, [0.98, 1.02])));
        items.push(item(Check::Temperature, 2, f32::NAN, [-40.0, 60.0]));
        items.push(Item::not_tested(Check::Clock));
        let rows: Vec<Row> = items.iter().map(Row::from).collect();
        let report = Report { unit: "HRG-7".into(), verdict: "FAIL", rows };
        let lines: Vec<String> = report.table(false).lines().map(String::from).collect();
        let fields = |k: usize| lines[k].split_whitespace().collect::<Vec<_>>().join(" ");
        assert_eq!(fields(1), "offset all -3.5000 to 3.5000 -6990 to 6990 codes PASS");
        assert_eq!(fields(2), "gain + 0 (x) 1.0001 0.9800 to 1.0200 1 PASS");
        assert_eq!(fields(3), "gain + 1 (y) 0.9500 0.9800 to 1.0200 1 FAIL");
        assert_eq!(fields(4), "gain + 6 1.0001 0.9800 to 1.0200 1 PASS");
        assert_eq!(fields(5), "temperature z none -40 to 60 C FAIL");
        assert_eq!(fields(6), "clock none ppb not tested");
        assert_eq!(lines[7], "FAIL: unit HRG-7, 15 figures within their limits, 2 not, 1 not tested");
        assert_eq!(report.table(true).lines().count(), items.len() + 2);
    }
}
