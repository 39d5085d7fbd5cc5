//! Soaks in a run: where the chamber stands and the resonators have settled; each gives a row of a table of static points (dong2023,
//! section 2: means of 100 s at the end of five hours).

use crate::fit::MEAN_S;
use hrg_core::AXES;
use hrg_data::axes::AXIS_NAMES;
use hrg_data::error::BadInput;
use hrg_data::recording::columns;
use hrg_data::recording::steps::Steps;
use hrg_data::recording::Recording;
use std::fmt::Write as _;

/// Hz of a resonator for a degree, about: enough to tell rest from change.
const HZ_PER_C: f64 = 0.47;
/// The change of a resonator is looked at over this many steps.
const LOOK_S: usize = 600;
/// The chamber, or a case, that moves by more than this from one 100 s mean to the next has left its soak, C.
const SENSOR_STANDS_C: f64 = 0.1;
/// The means are taken so long before the end of a soak shows, so that nothing of the next ramp is in them (sensors of coarse steps are
/// smoothed over five minutes).
const BEFORE_END_S: usize = 300;
/// Soaks of which every resonator is nearer than this are one soak, C.
const APART_C: f64 = 2.0;

/// Criterion of a soak.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settled {
    /// Every resonator changes by less than this, C per minute.
    pub within_c_per_min: f64,
    /// For so long at the least, s.
    pub for_s: f64,
}

/// A soak.
#[derive(Debug, Clone, PartialEq)]
pub struct Soak {
    /// Middle of its mean on the recording's clock, s.
    pub time_s: f64,
    /// Time for which the resonators had been settled then, s.
    pub settled_s: f64,
    /// Chamber, C; NaN where not recorded.
    pub chamber_c: f64,
    /// Frequencies, Hz.
    pub frequency_hz: [f64; AXES],
    /// Cases, C.
    pub case_c: [f64; AXES],
}

/// Means over windows of [`MEAN_S`] steps that end with each step; NaN where more than half is missing.
struct Means(Vec<(f64, u32)>);

impl Means {
    fn new(values: impl Iterator<Item = f64>) -> Self {
        let mut sums = vec![(0.0, 0)];
        for v in values {
            let (sum, n) = sums[sums.len() - 1];
            sums.push(if v.is_finite() { (sum + v, n + 1) } else { (sum, n) });
        }
        Self(sums)
    }

    fn ending(&self, k: usize) -> f64 {
        if k + 1 < MEAN_S || k + 1 >= self.0.len() {
            return f64::NAN;
        }
        let ((a, m), (b, n)) = (self.0[k + 1 - MEAN_S], self.0[k + 1]);
        if 2 * (n - m) as usize >= MEAN_S {
            (b - a) / f64::from(n - m)
        } else {
            f64::NAN
        }
    }
}

/// The soaks of a run, in time.
///
/// # Errors
/// If it has no resonator, no sensor to refer it to, or no soak.
pub fn find(r: &Recording, settled: &Settled) -> Result<Vec<Soak>, BadInput> {
    let name = r.source_or("the run");
    if r.thermometer.is_sensor() {
        return Err(BadInput::new(format!(
            "{name} has temperature sensors and no resonators: there is no curve of frequency to find"
        )));
    }
    let steps = Steps::new(r)?;
    let has = |v: &[f32]| v.iter().any(|x| x.is_finite());
    if !has(&steps.chamber_c) && !(0..AXES).any(|a| has(&steps.case_c[a])) {
        return Err(BadInput::new(format!(
            "{name} has neither case nor chamber temperatures; record them with hrg record --case-sensors, or put them in with hrg import"
        )));
    }
    // About the first value: sums of hours of kilohertz stay exact.
    let base = [0, 1, 2].map(|a: usize| steps.frequency_hz[a].iter().copied().find(|f| f.is_finite()).unwrap_or(0.0));
    let frequency = [0, 1, 2].map(|a: usize| Means::new(steps.frequency_hz[a].iter().map(|f| f - base[a])));
    let sensor = |v: &[f32]| Means::new((0..steps.len()).map(|k| v.get(k).map_or(f64::NAN, |x| f64::from(*x))));
    let (chamber, cases) = (sensor(&steps.chamber_c), steps.case_c.each_ref().map(|c| sensor(c)));
    let present: Vec<usize> = steps.present().collect();
    let rests = |k: usize| {
        let most = settled.within_c_per_min * HZ_PER_C * (LOOK_S as f64 / 60.0);
        let moved = |m: &Means| k >= MEAN_S && (m.ending(k) - m.ending(k - MEAN_S)).abs() > SENSOR_STANDS_C;
        k >= LOOK_S
            && present.iter().all(|&a| (frequency[a].ending(k) - frequency[a].ending(k - LOOK_S)).abs() < most)
            && !moved(&chamber)
            && !cases.iter().any(moved)
    };
    let mut out: Vec<Soak> = Vec::new();
    let mut since: Option<usize> = None;
    for k in 0..=steps.len() {
        let rest = k < steps.len() && rests(k);
        match (rest, since) {
            (true, None) => since = Some(k),
            (false, Some(from)) => {
                since = None;
                let at = if k == steps.len() { k - 1 } else { k.saturating_sub(1 + BEFORE_END_S) };
                let settled_s = at as f64 - from as f64;
                if settled_s >= settled.for_s {
                    let soak = Soak {
                        time_s: steps.start_s + at as f64 - 0.5 * MEAN_S as f64,
                        settled_s,
                        chamber_c: chamber.ending(at),
                        frequency_hz: [0, 1, 2].map(|a: usize| {
                            if steps.absent[a] {
                                f64::NAN
                            } else {
                                base[a] + frequency[a].ending(at)
                            }
                        }),
                        case_c: [0, 1, 2].map(|a: usize| cases[a].ending(at)),
                    };
                    if out.last().is_some_and(|last| near(last, &soak, &present)) {
                        out.pop();
                    }
                    out.push(soak);
                }
            }
            _ => {}
        }
    }
    if out.is_empty() {
        return Err(BadInput::new(format!(
            "{name}: no soak: nowhere do all resonators change by less than {} C/min for {:.0} min with chamber and cases at rest; soak longer, or allow more with --settled",
            settled.within_c_per_min,
            settled.for_s / 60.0
        )));
    }
    Ok(out)
}

fn near(a: &Soak, b: &Soak, present: &[usize]) -> bool {
    present.iter().all(|&x| (a.frequency_hz[x] - b.frequency_hz[x]).abs() < APART_C * HZ_PER_C)
}

/// The table that `hrg fit points` reads; a column that no soak has is left out.
#[must_use]
pub fn table(unit: &str, soaks: &[Soak]) -> String {
    let mut columns: Vec<(String, Vec<f64>, usize)> =
        vec![(columns::CHAMBER.name(0).into(), soaks.iter().map(|s| s.chamber_c).collect(), 3)];
    for a in 0..AXES {
        columns.push((columns::FREQUENCY.name(a).into(), soaks.iter().map(|s| s.frequency_hz[a]).collect(), 5));
    }
    for a in 0..AXES {
        columns.push((columns::CASE.name(a).into(), soaks.iter().map(|s| s.case_c[a]).collect(), 3));
    }
    columns.retain(|(_, values, _)| values.iter().any(|v| v.is_finite()));
    let mut out = format!("# unit: {unit}\n# soaks of hrg fit soaks, means of {MEAN_S} s\n");
    let names: Vec<&str> = columns.iter().map(|c| c.0.as_str()).collect();
    let _ = writeln!(out, "{}", names.join(","));
    for k in 0..soaks.len() {
        let cells: Vec<String> = columns
            .iter()
            .map(|(_, v, digits)| if v[k].is_finite() { format!("{:.digits$}", v[k]) } else { String::new() })
            .collect();
        let _ = writeln!(out, "{}", cells.join(","));
    }
    out
}

/// One line a soak, for a terminal.
#[must_use]
pub fn lines(soaks: &[Soak]) -> String {
    let mut out = format!("{:>8} {:>12} {:>10}", "time h", "settled min", "chamber C");
    for a in AXIS_NAMES {
        let _ = write!(out, " {:>12} {:>9}", format!("f{a} Hz"), format!("case {a} C"));
    }
    out.push('\n');
    for s in soaks {
        let _ = write!(out, "{:>8.2} {:>12.0} {:>10.3}", s.time_s / 3600.0, s.settled_s / 60.0, s.chamber_c);
        for a in 0..AXES {
            let _ = write!(out, " {:>12.4} {:>9.3}", s.frequency_hz[a], s.case_c[a]);
        }
        out.push('\n');
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use hrg_core::calibration::Calibration;
    use hrg_simulate::{Plan, Profile};

    const USUAL: Settled = Settled { within_c_per_min: 0.01, for_s: 600.0 };

    #[test]
    fn each_soak_gives_one_row_on_the_curve() {
        let profile = Profile::parse("25,-10@1,4h,10@1,4h,40@1,4h").expect("a profile");
        let r = Plan::of(profile, 3, 4).simulate().recording;
        let soaks = find(&r, &USUAL).expect("soaks");
        assert_eq!(soaks.len(), 3, "{soaks:?}");
        let truth = Calibration::uncalibrated().axes;
        for (s, chamber) in soaks.iter().zip([-10.0, 10.0, 40.0]) {
            assert!((s.chamber_c - chamber).abs() < 2e-3 && s.settled_s > 3600.0, "{s:?}");
            for a in 0..AXES {
                // The resonator is above its case by its self-heating, 0.8 to 1.1 C.
                let above = f64::from(truth[a].curve.temperature_c(s.frequency_hz[a])) - s.case_c[a];
                assert!((0.7..1.2).contains(&above), "axis {a}: {above}");
            }
        }
        let text = table("SIM-3", &soaks);
        assert!(text.contains("chamber_c,fx_hz,fy_hz,fz_hz,case_x_c,case_y_c,case_z_c\n-10.000,"), "{text}");
    }

    #[test]
    fn a_run_without_a_soak_or_a_sensor_is_refused() {
        let mut r = Plan::of(Profile::parse("20,50@1,-20@1").expect("a profile"), 3, 4).simulate().recording;
        assert!(find(&r, &USUAL).expect_err("refused").0.contains("no soak"));
        r.optional.clear();
        assert!(find(&r, &USUAL).expect_err("refused").0.contains("--case-sensors"));
    }
}
