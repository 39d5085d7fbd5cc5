//! Self-alignment on the desktop: recordings of a platform at rest, the four filters of `hrg_align`, reports.

pub mod accelerometers;
pub mod closed_form;
pub mod drifts;
pub mod heading;
pub mod plant;
pub mod study;

use closed_form::ClosedForm;
use hrg_align::aligner::Aligner;
use hrg_align::ekf::Ekf;
use hrg_align::linear::Linear;
use hrg_align::particles::{Kernels, Literal, CHEN};
use hrg_align::{normal_gravity, Config, Estimate, Filter, Refusal, ARCMIN, DEGREE, DPH};
use hrg_data::error::BadInput;
use hrg_data::numeric::stats::median;
use serde::Serialize;
use std::path::Path;

/// A recording of an alignment.
#[derive(Debug, Clone, PartialEq)]
pub struct Recording {
    /// Latitude, degrees.
    pub latitude_deg: Option<f64>,
    /// Gravity, m/s^2.
    pub gravity_mps2: Option<f64>,
    /// Noise of a velocity reading, m/s.
    pub velocity_noise_mps: Option<f64>,
    /// Random walk of the gyros, deg per root hour; optional.
    pub angle_walk_deg_per_root_h: Option<f64>,
    /// White noise of the accelerometers, micro-g per root hertz; optional.
    pub accelerometer_ug_per_root_hz: Option<f64>,
    /// Drifts to expect, one sigma, deg/h; optional.
    pub drift_dph: Option<f64>,
    /// Tilts to expect at the start, one sigma, arc minutes; optional.
    pub tilt_arcmin: Option<f64>,
    /// Change of each drift to expect from one position to the other, one sigma, deg/h; optional.
    pub heading_drift_dph: Option<f64>,
    /// Error of the turn's angle to expect, one sigma, arc minutes; optional.
    pub turn_error_arcmin: Option<f64>,
    /// Angle of the turn between the positions, degrees.
    pub turn_deg: f64,
    /// Time (s), position (1 or 2), velocities (m/s).
    pub rows: Vec<(f64, u8, [f64; 2])>,
}

/// A filter of `hrg_align`, with its precision.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FilterKind {
    /// The linear filter, double precision.
    Linear,
    /// The linear filter as a unit runs it, single precision.
    LinearSingle,
    /// The particle filter in kernel form, double precision.
    Upf,
    /// The particle filter in kernel form, single precision.
    UpfSingle,
    /// The particle filter as chen2015 writes it.
    UpfLiteral,
    /// The extended Kalman filter.
    Ekf,
}

impl FilterKind {
    /// All of them.
    pub const ALL: [Self; 6] =
        [Self::Linear, Self::LinearSingle, Self::Upf, Self::UpfSingle, Self::UpfLiteral, Self::Ekf];

    /// The name in commands and reports.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Linear => "linear",
            Self::LinearSingle => "linear-f32",
            Self::Upf => "upf",
            Self::UpfSingle => "upf-f32",
            Self::UpfLiteral => "upf-literal",
            Self::Ekf => "ekf",
        }
    }

    /// Runs it over a recording.
    pub fn run(self, recording: &Recording, config: &Config, start: Start) -> FilterRun {
        fn of<F: Filter>(recording: &Recording, config: &Config, filter: F) -> FilterRun {
            let (aligner, history) = run(recording, config, filter);
            (aligner.outcome(), aligner.converged_at_s(), history)
        }
        match self {
            Self::Linear => of(recording, config, Linear::<f64>::new(*config)),
            Self::LinearSingle => of(recording, config, Linear::<f32>::new(*config)),
            Self::Upf => of(recording, config, Kernels::<f64, CHEN>::new(*config)),
            Self::UpfSingle => of(recording, config, Kernels::<f32, CHEN>::new(*config)),
            Self::UpfLiteral => of(recording, config, Literal::<f64, CHEN>::new(*config, start.seed)),
            Self::Ekf => {
                let (azimuth, std) = (start.azimuth_deg * DEGREE, start.azimuth_std_deg * DEGREE);
                of(recording, config, Ekf::<f64>::new(*config, azimuth, std))
            }
        }
    }
}

impl clap::ValueEnum for FilterKind {
    fn value_variants<'a>() -> &'a [Self] {
        &Self::ALL
    }

    fn to_possible_value(&self) -> Option<clap::builder::PossibleValue> {
        Some(self.name().into())
    }
}

const COLUMNS: [&str; 4] = ["time_s", "position", "v1_mps", "v2_mps"];

/// Why a file is no recording of an alignment.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ReadError {
    /// Nothing is in it.
    #[error("the file is empty")]
    Empty,
    /// A header alone.
    #[error("there are no rows after the header")]
    NoRows,
    /// A column that is not there.
    #[error("line {line}: the column {name} is missing; an alignment has {columns}")]
    Missing {
        /// Line, from 1.
        line: usize,
        /// Its name.
        name: &'static str,
        /// Columns that an alignment has.
        columns: String,
    },
    /// Metadata that are no number.
    #[error("line {line}: {place}: \"{text}\" is not a number")]
    NotANumber {
        /// Line, from 1.
        line: usize,
        /// Their key.
        place: String,
        /// Text in the file.
        text: String,
    },
    /// A cell that is no number.
    #[error("line {line}, {place}: \"{cell}\" is not a number")]
    Cell {
        /// Line, from 1.
        line: usize,
        /// Column, by number and name.
        place: String,
        /// Text of the cell.
        cell: String,
    },
    /// A row that is too short.
    #[error("line {line} has {cells} cells, the header more")]
    Cells {
        /// Line, from 1.
        line: usize,
        /// Number of its cells.
        cells: usize,
    },
    /// A position that there is not.
    #[error("line {line}: position {position} is neither 1 nor 2")]
    Position {
        /// Line, from 1.
        line: usize,
        /// Text of the cell.
        position: String,
    },
    /// Time that does not go on.
    #[error("line {line}: time goes back from {from} to {to} s")]
    Back {
        /// Line, from 1.
        line: usize,
        /// Time before, s.
        from: String,
        /// Time there, s.
        to: String,
    },
    /// Position 1 once more.
    #[error("line {0}: position 1 after position 2; cut the file there")]
    PositionBack(usize),
}

impl From<ReadError> for hrg_data::error::BadInput {
    fn from(e: ReadError) -> Self {
        Self(e.to_string())
    }
}

/// Indices of the columns in a header.
fn places_of(cells: &[&str], line: usize) -> Result<[usize; 4], ReadError> {
    let mut found = [0; 4];
    for (to, name) in found.iter_mut().zip(COLUMNS) {
        *to = cells.iter().position(|c| *c == name).ok_or_else(|| ReadError::Missing {
            line,
            name,
            columns: COLUMNS.join(","),
        })?;
    }
    Ok(found)
}

impl Recording {
    /// Reads a file.
    ///
    /// # Errors
    /// One sentence with the path, line and column.
    pub fn load(path: &Path) -> Result<Self, BadInput> {
        let here = |e: String| BadInput::new(format!("{}: {e}", path.display()));
        let bytes = hrg_data::files::read_file(path, hrg_data::files::MOST_RECORDING, true)?;
        let text = std::str::from_utf8(&bytes).map_err(|_| here("it is not UTF-8 text".into()))?;
        Self::parse(text).map_err(|e| here(e.to_string()))
    }

    /// Takes what stands behind a `#`.
    fn take_metadata(&mut self, line: usize, meta: &str) -> Result<(), ReadError> {
        let Some((key, value)) = meta.split_once(':') else { return Ok(()) };
        let (key, value) = (key.trim(), value.trim());
        let number = || {
            let bad = |_| ReadError::NotANumber { line, place: key.into(), text: value.into() };
            value.parse::<f64>().map_err(bad)
        };
        match key {
            "latitude_deg" => self.latitude_deg = Some(number()?),
            "gravity_mps2" => self.gravity_mps2 = Some(number()?),
            "velocity_noise_mps" => self.velocity_noise_mps = Some(number()?),
            "angle_walk_deg_per_root_h" => self.angle_walk_deg_per_root_h = Some(number()?),
            "accelerometer_ug_per_root_hz" => self.accelerometer_ug_per_root_hz = Some(number()?),
            "drift_dph" => self.drift_dph = Some(number()?),
            "tilt_arcmin" => self.tilt_arcmin = Some(number()?),
            "heading_drift_dph" => self.heading_drift_dph = Some(number()?),
            "turn_error_arcmin" => self.turn_error_arcmin = Some(number()?),
            "turn_deg" => self.turn_deg = number()?,
            _ => {}
        }
        Ok(())
    }

    /// Reads the text of a file.
    ///
    /// # Errors
    /// One sentence with line and column.
    pub fn parse(text: &str) -> Result<Self, ReadError> {
        let mut out = Self {
            latitude_deg: None,
            gravity_mps2: None,
            velocity_noise_mps: None,
            angle_walk_deg_per_root_h: None,
            accelerometer_ug_per_root_hz: None,
            drift_dph: None,
            tilt_arcmin: None,
            heading_drift_dph: None,
            turn_error_arcmin: None,
            turn_deg: 90.0,
            rows: vec![],
        };
        let mut places: Option<[usize; 4]> = None;
        for (n, line) in text.trim_start_matches('\u{feff}').lines().enumerate() {
            let (n, line) = (n + 1, line.trim_end_matches('\r').trim());
            if line.is_empty() {
                continue;
            }
            if let Some(meta) = line.strip_prefix('#') {
                out.take_metadata(n, meta)?;
                continue;
            }
            let cells: Vec<&str> = line.split(',').map(str::trim).collect();
            let Some(at) = places else {
                places = Some(places_of(&cells, n)?);
                continue;
            };
            let number = |k: usize| -> Result<f64, ReadError> {
                let cell = cells.get(at[k]).ok_or(ReadError::Cells { line: n, cells: cells.len() })?;
                cell.parse::<f64>().ok().filter(|v| v.is_finite()).ok_or_else(|| {
                    let place = format!("column {} ({})", at[k] + 1, COLUMNS[k]);
                    ReadError::Cell { line: n, place, cell: (*cell).to_string() }
                })
            };
            let position = match number(1)? {
                1.0 => 1,
                2.0 => 2,
                other => return Err(ReadError::Position { line: n, position: other.to_string() }),
            };
            let row = (number(0)?, position, [number(2)?, number(3)?]);
            if let Some(last) = out.rows.last() {
                if row.0 < last.0 {
                    return Err(ReadError::Back { line: n, from: last.0.to_string(), to: row.0.to_string() });
                }
                if row.1 < last.1 {
                    return Err(ReadError::PositionBack(n));
                }
            }
            out.rows.push(row);
        }
        if places.is_none() {
            return Err(ReadError::Empty);
        }
        if out.rows.len() < 2 {
            return Err(ReadError::NoRows);
        }
        Ok(out)
    }

    /// The file's text.
    #[must_use]
    pub fn to_csv(&self) -> String {
        use std::fmt::Write as _;
        let mut s = String::from("# hrg-alignment: 1\n");
        for (key, value) in [
            ("latitude_deg", self.latitude_deg),
            ("gravity_mps2", self.gravity_mps2),
            ("velocity_noise_mps", self.velocity_noise_mps),
            ("angle_walk_deg_per_root_h", self.angle_walk_deg_per_root_h),
            ("accelerometer_ug_per_root_hz", self.accelerometer_ug_per_root_hz),
            ("drift_dph", self.drift_dph),
            ("tilt_arcmin", self.tilt_arcmin),
            ("heading_drift_dph", self.heading_drift_dph),
            ("turn_error_arcmin", self.turn_error_arcmin),
            ("turn_deg", Some(self.turn_deg)),
        ] {
            if let Some(v) = value {
                let _ = writeln!(s, "# {key}: {v}");
            }
        }
        let _ = writeln!(s, "{}", COLUMNS.join(","));
        for (t, position, v) in &self.rows {
            let _ = writeln!(s, "{t},{position},{:.7},{:.7}", v[0], v[1]);
        }
        s
    }

    /// The site; gravity from latitude and 1 mm/s where not given.
    ///
    /// # Errors
    /// A latitude that is missing, impossible or too near to a pole.
    pub fn config(&self) -> Result<Config, Refusal> {
        let latitude = self.latitude_deg.ok_or(Refusal::Latitude)?;
        let gravity = self.gravity_mps2.unwrap_or_else(|| normal_gravity(latitude));
        let mut config = Config::new(latitude, gravity, self.velocity_noise_mps.unwrap_or(1e-3))?;
        let possible = |v: &f64| (1e-6..1e3).contains(v);
        if let Some(walk) = self.angle_walk_deg_per_root_h {
            config.angle_random_walk = Some(walk).filter(possible).ok_or(Refusal::Site)? * DEGREE / 60.0;
        }
        if let Some(noise) = self.accelerometer_ug_per_root_hz {
            config.velocity_walk = Some(noise).filter(possible).ok_or(Refusal::Site)? * 1e-6 * gravity;
        }
        // Limits at the start: drifts up to a hundred degrees an hour, and tilts that are small.
        if let Some(drift) = self.drift_dph {
            config.drift = Some(drift).filter(|d| (1e-4..=100.0).contains(d)).ok_or(Refusal::Site)? * DPH;
        }
        if let Some(tilt) = self.tilt_arcmin {
            config.tilt = Some(tilt).filter(|t| (1e-2..=120.0).contains(t)).ok_or(Refusal::Site)? * ARCMIN;
        }
        // Both may be stated as none; of a turn a few degrees are a wrong angle, and no error.
        if let Some(drift) = self.heading_drift_dph {
            config.heading_drift = Some(drift).filter(|d| (0.0..=100.0).contains(d)).ok_or(Refusal::Site)? * DPH;
        }
        if let Some(error) = self.turn_error_arcmin {
            config.turn_error = Some(error).filter(|e| (0.0..=120.0).contains(e)).ok_or(Refusal::Site)? * ARCMIN;
        }
        Ok(config)
    }
}

/// One second of an alignment.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Moment {
    /// Time since the start, s.
    pub time_s: f64,
    /// Position.
    pub position: u8,
    /// Azimuth, degrees.
    pub azimuth_deg: f64,
    /// Its standard deviation, arc minutes.
    pub azimuth_std_arcmin: f64,
    /// Tilts as they stand, arc minutes.
    pub tilt_arcmin: [f64; 2],
    /// Drifts, deg/h.
    pub drift_dph: [f64; 2],
}

/// The report of `hrg align`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// The filter.
    pub filter: String,
    /// Heading of axis 1 as it stood in position 1, at the recording's end, degrees, -180 to 180.
    pub azimuth_deg: f64,
    /// Its standard deviation, arc minutes.
    pub azimuth_std_arcmin: f64,
    /// Tilt about axis 1 as it stands, arc minutes.
    pub tilt1_arcmin: f64,
    /// Tilt about axis 2.
    pub tilt2_arcmin: f64,
    /// Drift about axis 1, deg/h.
    pub drift1_dph: f64,
    /// Drift about axis 2.
    pub drift2_dph: f64,
    /// Standard deviations of tilts (arc minutes) and drifts (deg/h).
    pub tilt_std_arcmin: [f64; 2],
    /// See [`tilt_std_arcmin`](Self::tilt_std_arcmin).
    pub drift_std_dph: [f64; 2],
    /// Time at which the azimuth was known to 15' (two sigma), s; null if it never was.
    pub converged_at_s: Option<f64>,
    /// Chi-square, one degree of freedom, of the two positions against each other (linear filter only).
    pub integrity: Option<f64>,
    /// Time at which the tilts were known to 1' (two sigma), s; null if they never were.
    pub level_at_s: Option<f64>,
    /// The azimuth without a filter, and the drift of each position by itself; null where the turn parts nothing.
    pub closed_form: Option<ClosedForm>,
    /// Second by second; the first position's azimuths are no results.
    pub history: Vec<Moment>,
}

fn moment(time_s: f64, position: u8, e: &Estimate) -> Moment {
    Moment {
        time_s,
        position,
        azimuth_deg: e.azimuth / DEGREE,
        azimuth_std_arcmin: e.azimuth_std / ARCMIN,
        tilt_arcmin: e.tilt.map(|t| t / ARCMIN),
        drift_dph: e.drift.map(|d| d / DPH),
    }
}

/// Runs a filter over a recording: the aligner at its end, and what it estimated each second.
pub fn run<F: Filter>(recording: &Recording, config: &Config, filter: F) -> (Aligner<F>, Vec<(f64, u8, Estimate)>) {
    let mut aligner = Aligner::new(filter, config);
    let mut history = Vec::new();
    let start = recording.rows.first().map_or(0.0, |r| r.0);
    let (mut at, mut position) = (start, 1u8);
    let step = config.step;
    let mut spacings: Vec<f64> =
        recording.rows.windows(2).filter(|w| w[0].1 == w[1].1).map(|w| w[1].0 - w[0].0).collect();
    let tolerance = 0.5 * median(&mut spacings).unwrap_or(step).min(step);
    aligner.set_velocity(recording.rows.first().map_or([0.0; 2], |r| r.2));
    for &(t, p, v) in &recording.rows {
        if p != position {
            // The turn took from the last reading of position 1 to the first of position 2, which is where its velocities
            // begin, at zero or not.
            aligner.turn(recording.turn_deg * DEGREE, t - at);
            aligner.set_velocity(v);
            (at, position) = (t, p);
            continue;
        }
        // Faster rows are thinned to steps, the one nearest to its step counting; over a gap of
        // some seconds time goes on without readings; a longer one is named.
        let due = ((t - at + tolerance) / step).floor();
        if due < 1.0 {
            continue;
        }
        if due > LONGEST_GAP {
            aligner.refuse(Refusal::DataMissing);
        }
        for _ in 1..(due.min(LONGEST_GAP) as u32) {
            aligner.miss();
        }
        aligner.step(v);
        at += due * step;
        if let Some(e) = aligner.belief() {
            history.push((at - start, p, e));
        }
    }
    (aligner, history)
}

/// Seconds without a row within a position that are still bridged.
const LONGEST_GAP: f64 = 3.0;

/// Start values of the filters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Start {
    /// First azimuth of the EKF, degrees.
    pub azimuth_deg: f64,
    /// Its standard deviation, degrees.
    pub azimuth_std_deg: f64,
    /// Seed of the literal particle filter.
    pub seed: u64,
}

impl Default for Start {
    fn default() -> Self {
        Self { azimuth_deg: 0.0, azimuth_std_deg: 60.0, seed: 1 }
    }
}

/// Standard deviations by which a filter's azimuth may differ from the closed form's, which has no prior and no linearization. (A filter that has found it is within one.)
const MOST_APART: f64 = 5.0;

/// Runs a filter.
///
/// # Errors
/// A [`Refusal`] in words; a filter that has diverged, or that is far from the closed form.
pub fn align(recording: &Recording, filter: FilterKind, start: Start) -> Result<Report, BadInput> {
    let refused = |r: Refusal| BadInput::new(format!("no azimuth: {r}"));
    let config = recording.config().map_err(refused)?;
    let (outcome, converged_at_s, history) = filter.run(recording, &config, start);
    let wide = Config { drift: WIDE * config.drift, ..config };
    if let Some(why) = beyond_the_prior(&outcome, &config, || filter.run(recording, &wide, start).0) {
        return Err(why);
    }
    if let (FilterKind::Ekf, Err(Refusal::BaseMoving)) = (filter, &outcome) {
        // (The exact filter, which needs no first azimuth, tells a base that moves from a filter that has left it.)
        if FilterKind::Linear.run(recording, &config, start).0.is_ok() {
            return Err(BadInput::new(format!(
                "no azimuth: the EKF has diverged from its first azimuth of {:.0} deg; give --first-azimuth nearer to it, or take --filter linear, which needs none",
                start.azimuth_deg
            )));
        }
    }
    let e = outcome.map_err(refused)?;
    let closed_form = closed_form::closed_form(recording, &config, Some(e.azimuth));
    if let Some(c) = &closed_form {
        let apart = c.apart_arcmin(e.azimuth / DEGREE).abs() / (e.azimuth_std / ARCMIN);
        if apart > MOST_APART {
            return Err(BadInput::new(format!(
                "no azimuth: the filter {} gives {:.4} deg +- {:.2}', and the closed form {:.4} deg, {apart:.0} standard deviations from it: the filter has not found it (upf-literal, as its paper prints it, is kept to show that); take --filter linear",
                filter.name(),
                e.azimuth / DEGREE,
                e.azimuth_std / ARCMIN,
                c.azimuth_deg
            )));
        }
    }
    Ok(Report {
        filter: filter.name().into(),
        azimuth_deg: e.azimuth / DEGREE,
        azimuth_std_arcmin: e.azimuth_std / ARCMIN,
        tilt1_arcmin: e.tilt[0] / ARCMIN,
        tilt2_arcmin: e.tilt[1] / ARCMIN,
        drift1_dph: e.drift[0] / DPH,
        drift2_dph: e.drift[1] / DPH,
        tilt_std_arcmin: e.tilt_std.map(|t| t / ARCMIN),
        drift_std_dph: e.drift_std.map(|d| d / DPH),
        converged_at_s,
        integrity: e.integrity,
        level_at_s: level_at_s(&history),
        closed_form,
        history: history.iter().map(|(t, p, e)| moment(*t, *p, e)).collect(),
    })
}

/// Tilts are known where twice their standard deviations are below this: a minute of arc.
const LEVEL: f64 = ARCMIN;

/// Since when in the first position both tilts were known, s.
fn level_at_s(history: &[(f64, u8, Estimate)]) -> Option<f64> {
    let known = |e: &Estimate| e.tilt_std.iter().all(|s| 2.0 * s <= LEVEL);
    history.iter().find(|(_, _, e)| known(e)).map(|h| h.0)
}

/// Drifts beyond so many standard deviations of what was expected are none that were expected.
const BEYOND: f64 = 4.0;
/// Factor by which larger drifts are allowed if there is no azimuth, to see whether they explain it.
const WIDE: f64 = 50.0;

/// Detects drifts larger than the filter's prior: the filter is then wrong and does not know it, or reports a moving base. That has a
/// sentence of its own. `again`: the outcome with drifts allowed to be much larger.
fn beyond_the_prior(
    outcome: &Result<Estimate, Refusal>,
    config: &Config,
    again: impl Fn() -> Result<Estimate, Refusal>,
) -> Option<BadInput> {
    let found = match outcome {
        Ok(e) => Some(*e),
        Err(Refusal::BaseMoving | Refusal::Inconsistent) => again().ok(),
        Err(_) => None,
    }
    .filter(|e| e.drift.iter().any(|d| d.abs() > BEYOND * config.drift))?;
    let [d1, d2] = found.drift.map(|d| d / DPH);
    Some(BadInput::new(format!(
        "no azimuth: drifts of {d1:.2} and {d2:.2} deg/h are found, far beyond the {:.2} deg/h (one sigma) that were expected; if the gyros drift that much, say so with --drift or # drift_dph, else check them and the base",
        config.drift / DPH
    )))
}

/// Result of a run: the outcome, the time of convergence in s, and the estimates of each second.
pub type FilterRun = (Result<Estimate, Refusal>, Option<f64>, Vec<(f64, u8, Estimate)>);

#[cfg(test)]
mod tests {
    use super::plant::Plant;
    use super::*;
    use hrg_align::wrap;
    use hrg_data::numeric::stats::quantile;

    fn error_arcmin(plant: &Plant, filter: FilterKind) -> f64 {
        let (recording, truth) = plant.play();
        let config = recording.config().expect("a site");
        let (outcome, _, history) = filter.run(&recording, &config, Start::default());
        let _ = outcome;
        history.last().map_or(f64::INFINITY, |(_, _, e)| wrap(e.azimuth - truth.azimuth).abs() / ARCMIN)
    }

    /// Errors of azimuth over a campaign, arc minutes, of every run that gave one; and how many gave none.
    fn campaign(runs: u64, filter: FilterKind) -> (Vec<f64>, usize) {
        let errors: Vec<f64> = (1..=runs).map(|s| error_arcmin(&Plant::drawn(s), filter)).collect();
        let given: Vec<f64> = errors.iter().copied().filter(|e| e.is_finite()).collect();
        let none = errors.len() - given.len();
        (given, none)
    }

    #[test]
    fn the_linear_filter_is_within_its_figures_in_either_precision() {
        for filter in [FilterKind::Linear, FilterKind::LinearSingle] {
            let (errors, none) = campaign(400, filter);
            let (median, p95, most) = (quantile(&errors, 0.5), quantile(&errors, 0.95), quantile(&errors, 1.0));
            assert!(median <= 2.0 && p95 <= 7.0 && most <= 60.0, "{filter:?}: {median} {p95} {most}");
            // The check of the positions is wrong once in a thousand.
            assert!(none <= 3, "{filter:?}: {none} without an azimuth");
        }
    }

    #[test]
    fn the_kernels_are_within_their_figures() {
        let (errors, none) = campaign(200, FilterKind::Upf);
        let (median, p95, most) = (quantile(&errors, 0.5), quantile(&errors, 0.95), quantile(&errors, 1.0));
        assert!(median <= 2.0 && p95 <= 6.0 && most <= 60.0 && none == 0, "{median} {p95} {most} {none}");
    }

    #[test]
    fn standard_deviations_are_true() {
        // Squared errors over their variances, five quantities: each mean over n runs is 1 within its spread.
        let runs = 400u32;
        let mut sums = [0.0; 5];
        for seed in 1..=runs {
            let plant = Plant { bias: [0.0; 2], ..Plant::drawn(u64::from(seed)) };
            let (recording, truth) = plant.play();
            let mut config = recording.config().expect("a site");
            // Without accelerometer biases a turn adds no tilt.
            config.turn_tilt = 1e-7;
            let (_, _, history) = FilterKind::Linear.run(&recording, &config, Start::default());
            let e = history.last().expect("many").2;
            let errors = [
                wrap(e.azimuth - truth.azimuth) / e.azimuth_std,
                (e.tilt[0] - truth.tilt[0]) / e.tilt_std[0],
                (e.tilt[1] - truth.tilt[1]) / e.tilt_std[1],
                (e.drift[0] - truth.drift[0]) / e.drift_std[0],
                (e.drift[1] - truth.drift[1]) / e.drift_std[1],
            ];
            sums.iter_mut().zip(errors).for_each(|(s, e)| *s += e * e);
        }
        // Five standard deviations of a mean of n chi-squares of one degree.
        let spread = 5.0 * (2.0 / f64::from(runs)).sqrt();
        for (k, s) in sums.iter().enumerate() {
            let mean = s / f64::from(runs);
            assert!((mean - 1.0).abs() < spread, "quantity {k}: {mean}");
        }
    }

    #[test]
    fn one_position_never_pretends() {
        for seed in 1..=50 {
            let drawn = Plant::drawn(seed);
            let (recording, _) = Plant { seconds: [200, 0, 0], ..drawn }.play();
            let mut config = recording.config().expect("a site");
            config.drift = 0.1 * DPH;
            let (outcome, _, history) = FilterKind::Linear.run(&recording, &config, Start::default());
            assert_eq!(outcome, Err(Refusal::OnePosition));
            for (t, _, e) in &history {
                assert!(e.azimuth_std > 30.0 * ARCMIN, "{} arc minutes at {t} s", e.azimuth_std / ARCMIN);
            }
        }
    }

    #[test]
    fn wrong_input_is_named_and_gives_no_azimuth() {
        let (good, _) = Plant::chen(1).play();
        let refusal = |edit: &dyn Fn(&mut Recording)| {
            let mut r = good.clone();
            edit(&mut r);
            let e = align(&r, FilterKind::Linear, Start::default()).expect_err("refused").0;
            assert!(e.starts_with("no azimuth: "), "{e}");
            e
        };
        assert!(align(&good, FilterKind::Linear, Start::default()).is_ok());
        assert!(refusal(&|r| r.latitude_deg = None).contains("latitude is missing"));
        assert!(refusal(&|r| r.latitude_deg = Some(90.0)).contains("beyond 80"));
        assert!(refusal(&|r| r.latitude_deg = Some(f64::NAN)).contains("latitude is missing"));
        assert!(refusal(&|r| r.gravity_mps2 = Some(1.6)).contains("gravity"));
        assert!(refusal(&|r| r.rows.retain(|x| x.1 == 1)).contains("no turn"));
        let hardly = Plant { turn: 3.0 * DEGREE, ..Plant::chen(1) }.play().0;
        let e = align(&hardly, FilterKind::Linear, Start::default()).expect_err("refused").0;
        assert!(e.contains("too near to a whole one"), "{e}");
        // A turn that was not the one stated.
        refusal(&|r| r.turn_deg = 60.0);
        assert!(refusal(&|r| r.rows.truncate(95)).contains("half a minute"));
        // A base that sways a decimetre with a period of seven seconds.
        assert!(refusal(&|r| r.rows.iter_mut().for_each(|x| x.2[0] += 0.09 * (0.9 * x.0).sin())).contains("base moves"));
        // An accelerometer that does not get beyond 5 mm/s a second.
        let clipped = refusal(&|r| {
            let mut last = 0.0;
            for x in &mut r.rows {
                last = if x.2[0] == 0.0 { 0.0 } else { last + 0.005 };
                x.2[0] = last;
            }
        });
        assert!(clipped.contains("end of scale or stuck"), "{clipped}");
        // A gap of ten seconds.
        assert!(refusal(&|r| r.rows.retain(|x| !(40.0..50.0).contains(&x.0))).contains("missing"));
        // Files that begin with a velocity, or without the row of zeros, are as good.
        for skip in [1, 3] {
            let mut late = good.clone();
            let second = late.rows.iter().position(|x| x.1 == 2).expect("two positions");
            late.rows.drain(second..second + skip);
            late.rows.drain(..skip);
            let (a, b) = (
                align(&good, FilterKind::Linear, Start::default()),
                align(&late, FilterKind::Linear, Start::default()),
            );
            let (a, b) = (a.expect("aligns"), b.expect("aligns"));
            assert!((a.azimuth_deg - b.azimuth_deg).abs() * 60.0 < 2.0, "{} {}", a.azimuth_deg, b.azimuth_deg);
        }
        let mut gaps = good.clone();
        gaps.rows.retain(|x| x.0 % 20.0 > 1.5 || x.0 < 1.0 || x.0 > 80.0);
        let (a, b) =
            (align(&good, FilterKind::Linear, Start::default()), align(&gaps, FilterKind::Linear, Start::default()));
        assert!((a.expect("aligns").azimuth_deg - b.expect("aligns").azimuth_deg).abs() * 60.0 < 2.0);
        // A drift that comes with the turn, large enough to be told from noise.
        let moved = Plant { heading_drift: [2.0 * DPH, -1.5 * DPH], ..Plant::chen(1) }.play().0;
        let e = align(&moved, FilterKind::Linear, Start::default()).expect_err("refused").0;
        assert!(e.contains("contradict each other"), "{e}");
    }

    /// Drifts of which the filter was not told: a sentence of their own, and with them told an azimuth.
    #[test]
    fn drifts_beyond_the_prior_are_named_and_may_be_expected() {
        for (drift, filters) in [(1.5, &[FilterKind::Linear, FilterKind::Upf][..]), (3.0, &[FilterKind::Linear][..])] {
            for filter in filters {
                let plant = Plant { drift: [drift * DPH, -drift * DPH, 0.0], ..Plant::chen(1) };
                let (recording, truth) = plant.play();
                let e = align(&recording, *filter, Start::default()).expect_err("refused").0;
                assert!(e.contains("--drift") && e.contains("0.20 deg/h"), "{filter:?} {drift}: {e}");
                let stated = Recording { drift_dph: Some(2.0 * drift), tilt_arcmin: Some(3.0), ..recording };
                let r = align(&stated, *filter, Start::default()).expect("aligns");
                let off = wrap(r.azimuth_deg * DEGREE - truth.azimuth) / ARCMIN;
                assert!(off.abs() < 15.0 && off.abs() < 4.0 * r.azimuth_std_arcmin, "{filter:?} {drift}: {off}'");
            }
        }
        let odd = Recording { drift_dph: Some(-1.0), ..Plant::chen(1).play().0 };
        assert!(align(&odd, FilterKind::Linear, Start::default()).is_err());
    }

    #[test]
    fn a_file_there_and_back_and_its_defects() {
        let (r, _) = Plant::chen(1).play();
        let again = Recording::parse(&r.to_csv()).expect("readable");
        assert_eq!(again.rows.len(), r.rows.len());
        assert_eq!(Recording::parse("").expect_err("refused"), ReadError::Empty);
        let head = "# latitude_deg: 45\ntime_s,position,v1_mps,v2_mps\n";
        for (text, says) in [
            ("time_s,v1_mps\n", "column position is missing"),
            ("0,1,0,0\n1,3,0,0\n", "neither 1 nor 2"),
            ("0,1,0,0\n1,1,x,0\n", "line 4, column 3 (v1_mps)"),
            ("0,1,0,0\n-1,1,0,0\n", "time goes back"),
            ("0,2,0,0\n1,1,0,0\n", "position 1 after position 2"),
            ("0,1,0,0\n1,1,0\n", "has 3 cells"),
        ] {
            let text = if text.starts_with("time") { text.to_string() } else { format!("{head}{text}") };
            let e = Recording::parse(&text).expect_err("refused").to_string();
            assert!(e.contains(says), "{e}");
        }
    }

    #[test]
    fn faster_rows_are_thinned_to_the_same_azimuth() {
        // Rows each half second: those between carry the same platform.
        let (r, _) = Plant::chen(2).play();
        let mut twice = r.clone();
        twice.rows = r
            .rows
            .windows(2)
            .flat_map(|w| {
                let between = [0, 1].map(|k: usize| 0.5 * (w[0].2[k] + w[1].2[k]));
                if w[0].1 == w[1].1 {
                    vec![w[0], (w[0].0 + 0.5, w[0].1, between)]
                } else {
                    vec![w[0]]
                }
            })
            .chain(r.rows.last().copied())
            .collect();
        let azimuth = |r: &Recording| align(r, FilterKind::Linear, Start::default()).expect("aligns").azimuth_deg;
        assert!((azimuth(&r) - azimuth(&twice)).abs() < 1e-9);
    }
}
