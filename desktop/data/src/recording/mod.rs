//! Recordings: CSV with `#` metadata lines, or [Parquet](parquet), one power-on each.
//!
//! Reading is strict about form (a missing column or text in a number ends with the line and column) and
//! lenient about content: missing values, gaps, times that repeat or go back, spikes and stuck values are found,
//! counted, reported in [`Recording::notes`], and taken out; never silently used.

pub mod anonymise;
mod cleaning;
pub mod columns;
pub mod dialect;
pub mod facts;
pub mod import;
mod lines;
pub mod merge;
pub mod metadata;
pub mod names;
pub mod own_columns;
pub mod parquet;
pub mod plausible;
mod reader;
pub mod reduced;
pub mod resonators;
mod rows;
pub mod steps;
pub mod thermometer;
pub mod time_form;
pub mod turns;
mod writer;

pub use cleaning::{Cleaned, Defect, Original};

use crate::error::BadInput;
use crate::numeric::side_by_side;
use hrg_core::inputs::{self, QuantitySet};
use hrg_core::AXES;
use metadata::Attitude;
use std::path::Path;
use thermometer::Thermometer;

/// One power-on.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Recording {
    /// Metadata in order.
    pub meta: Vec<(String, String)>,
    /// Time of each row, s; increasing after [`Recording::clean`].
    pub time_s: Vec<f64>,
    /// Source of the temperatures.
    pub thermometer: Thermometer,
    /// Axes that the recording does not have: their readings and rates are NaN throughout.
    pub absent: [bool; AXES],
    /// Readings of the axes' thermometers; NaN where missing. Of resonators frequencies, Hz; of sensors ([`Self::thermometer`])
    /// temperatures, C.
    pub frequency_hz: [Vec<f64>; AXES],
    /// Rates, deg/h; NaN where missing.
    pub rate_dph: [Vec<f64>; AXES],
    /// Optional columns that are there, by their names in [`columns`]; NaN where missing.
    pub optional: Vec<(&'static str, Vec<f64>)>,
    /// Status of the axes and the unit in each row as it was read, where a unit recorded it: else empty.
    pub status: Vec<[u16; 4]>,
    /// Notes of reading and cleaning: one sentence each.
    pub notes: Vec<String>,
    /// Counts of values taken out, by column and kind.
    pub cleaned: Vec<Cleaned>,
    /// Spikes of the rates that were taken out: axis, time (s) and rate (deg/h) of each. A fit does without them; a judgement must not.
    pub rate_spikes: Vec<(usize, f64, f64)>,
    /// Time from which on it is judged, s: rates before are left out, and readings there only bring the states of the model up to
    /// date. `None`: from its beginning.
    pub judged_from_s: Option<f64>,
    /// File that it was read from; empty if there is none.
    pub source: String,
    /// Earth rate that was taken off the rates of each axis, deg/h. A file holds it: [`Recording::to_csv`] adds it again.
    pub earth_rate_dph: Option<[f64; 3]>,
}

/// Quantities by the names of their columns, with commas between; `none` for none. A name without its axis (`drive`, `drive_?_v`) stands for
/// all three.
///
/// # Errors
/// A name that is not one of a quantity.
pub fn inputs_named(listed: &str) -> Result<QuantitySet, BadInput> {
    let names: Vec<&str> = listed.split(',').map(str::trim).filter(|n| !n.is_empty()).collect();
    match names[..] {
        [] => Err(BadInput::new("no input is named; write none for a unit that has none")),
        [metadata::NO_INPUTS] => Ok(QuantitySet::empty()),
        _ => names.into_iter().map(input_named).try_fold(QuantitySet::empty(), |all, one| Ok(all.union(one?))),
    }
}

/// Names of the columns of quantities.
#[must_use]
pub fn names_of(quantities: QuantitySet) -> Vec<&'static str> {
    quantities.numbers().map(|n| inputs::NAMES[usize::from(n)]).collect()
}

fn input_named(name: &str) -> Result<QuantitySet, BadInput> {
    let found = inputs::NAMES.iter().zip(0..).filter(|(n, _)| {
        let pattern = columns::find(n).map_or(String::new(), |(c, _)| c.pattern());
        **n == columns::today(name) || pattern == name || pattern.split("_?").next() == Some(name)
    });
    let set: QuantitySet = found.map(|(_, k)| QuantitySet::one(k)).collect();
    if set.is_empty() {
        return Err(BadInput::new(format!(
            "\"{name}\" is not an input; there are {}; drive, quad and case for all three axes; or none alone",
            inputs::NAMES.join(", ")
        )));
    }
    Ok(set)
}

impl Recording {
    /// The same run, second by second, with temperatures in the place of readings of its thermometers.
    #[must_use]
    pub fn with_temperatures(&self, steps: &steps::Steps, temperatures_c: [Vec<f64>; AXES]) -> Self {
        let mut meta = self.meta.clone();
        meta.retain(|(k, _)| k != "thermometer" && k != "hrg-recording");
        meta.insert(0, ("hrg-recording".into(), "2".into()));
        meta.push(("thermometer".into(), "sensor".into()));
        Self {
            meta,
            time_s: (0..steps.len()).map(|k| steps.start_s + k as f64).collect(),
            thermometer: thermometer::Thermometer::Sensors,
            frequency_hz: temperatures_c,
            rate_dph: steps.rate_dph.clone(),
            earth_rate_dph: self.earth_rate_dph,
            absent: self.absent,
            ..Self::default()
        }
    }

    /// Rates on an even grid of the recording's own step, and that step in s; NaN where no row stands.
    #[must_use]
    pub fn even_rates(&self) -> ([Vec<f64>; 3], f64) {
        let step = self.step_s();
        let (first, last) = match (self.time_s.first(), self.time_s.last()) {
            (Some(a), Some(b)) if step > 0.0 => (*a, *b),
            _ => return (Default::default(), 1.0),
        };
        // A file whose times leap over years gets no grid of them.
        let n = (((last - first) / step).round() as usize + 1).min(20 * self.time_s.len() + 1);
        let mut out = [0, 1, 2].map(|_| vec![f64::NAN; n]);
        for (k, t) in self.time_s.iter().enumerate() {
            let at = ((t - first) / step).round() as usize;
            for (axis, rates) in out.iter_mut().zip(&self.rate_dph) {
                if let Some(to) = axis.get_mut(at) {
                    *to = rates[k];
                }
            }
        }
        (out, step)
    }

    /// Axes that the recording has.
    pub fn present(&self) -> impl Iterator<Item = usize> + '_ {
        (0..AXES).filter(|&a| !self.absent[a])
    }

    /// A metadata value.
    #[must_use]
    pub fn meta(&self, key: &str) -> Option<&str> {
        self.meta.iter().find(|(k, _)| k == key).map(|(_, v)| v.as_str())
    }

    /// An optional column.
    #[must_use]
    pub fn column(&self, name: &str) -> Option<&[f64]> {
        self.optional.iter().find(|(n, _)| *n == name).map(|(_, v)| v.as_slice())
    }

    /// Rate of the table that turned the unit, deg/h along the axes of its case in each row: from columns (an axis without one did not turn)
    /// or from the metadata; `None` where neither is there.
    #[must_use]
    pub fn table_rate_dph(&self) -> Option<[Vec<f64>; AXES]> {
        let n = self.time_s.len();
        let columns = [0, 1, 2].map(|a| self.column(columns::TABLE_RATE.name(a)));
        if columns.iter().any(Option::is_some) {
            return Some(columns.map(|c| c.map_or_else(|| vec![0.0; n], <[f64]>::to_vec)));
        }
        let constant = self.meta(metadata::TABLE_RATE).and_then(|v| metadata::table_rate(v).ok())?;
        Some(constant.map(|rate| vec![rate; n]))
    }

    /// Specific force along the axes by the accelerometers, and that of the position that the case was held in, m/s^2 in each row; `None` without both.
    #[must_use]
    pub fn forces_mps2(&self) -> Option<[[&[f64]; AXES]; 2]> {
        let of = |c: columns::Column| {
            let [x, y, z] = [0, 1, 2].map(|a| self.column(c.name(a)));
            Some([x?, y?, z?])
        };
        Some([of(columns::FORCE)?, of(columns::TABLE_FORCE)?])
    }

    /// `true` if a rate table turned the unit, or it was held in several positions: such a recording does not show the bias of its gyros alone.
    #[must_use]
    pub fn turned(&self) -> bool {
        self.table_rate_dph().is_some_and(|rates| rates.iter().flatten().any(|r| *r != 0.0)) || self.positioned()
    }

    /// `true` if it was held in several positions.
    #[must_use]
    pub fn positioned(&self) -> bool {
        let forces = columns::TABLE_FORCE.names.iter().filter_map(|name| self.column(name));
        forces.into_iter().any(|f| f.iter().any(|v| v.is_finite() && *v != f[0]))
    }

    /// Name of the unit; [`names::NONE`] where the file does not tell, or the unit had none.
    #[must_use]
    pub fn unit(&self) -> &str {
        self.meta("unit").filter(|n| !names::is_unnamed(n)).unwrap_or(names::NONE)
    }

    /// Quantities beside the frequencies that the unit itself has, by the metadata `unit_inputs`; without it all but the sensors on the
    /// cases, which belong to the chamber.
    ///
    /// # Errors
    /// A name that is not one of a quantity.
    pub fn unit_inputs(&self) -> Result<QuantitySet, BadInput> {
        let Some(listed) = self.meta(metadata::UNIT_INPUTS) else { return Ok(QuantitySet::CASES.complement()) };
        inputs_named(listed)
    }

    /// Sets the quantities beside the frequencies that the unit itself has: names of columns with commas between, or `none`.
    ///
    /// # Errors
    /// A name that is not one of a quantity.
    pub fn set_unit_inputs(&mut self, listed: &str) -> Result<(), BadInput> {
        inputs_named(listed)?;
        self.meta.retain(|(key, _)| key != metadata::UNIT_INPUTS);
        self.meta.push((metadata::UNIT_INPUTS.to_string(), listed.to_string()));
        Ok(())
    }

    /// Scale factor that made the rates of the ADC's codes, deg/h per code; `None` where the file does not tell.
    #[must_use]
    pub fn scale_factor(&self) -> Option<[f32; 3]> {
        self.meta(metadata::SCALE_FACTOR).and_then(|v| metadata::scale_factor(v).ok())
    }

    /// Quantity that stands in the place of the rates, as ppb of an oscillator; `None` of a gyro.
    #[must_use]
    pub fn stands_for(&self) -> Option<&str> {
        self.meta(metadata::STANDS_FOR)
    }

    /// Unit of the rates in texts and pictures: deg/h, or that of the quantity in their place.
    #[must_use]
    pub fn rate_unit(&self) -> &str {
        self.stands_for().and_then(|s| s.split([',', ' ']).next()).unwrap_or(metadata::DEG_PER_H)
    }

    /// `true` if the rates are free of the earth's rate.
    #[must_use]
    pub fn without_earth_rate(&self) -> bool {
        self.earth_rate_dph.is_some() || self.meta("earth_rate") == Some("removed")
    }

    /// Sets a metadata value.
    pub fn set_meta(&mut self, key: &str, value: &str) {
        match self.meta.iter_mut().find(|(k, _)| k == key) {
            Some((_, v)) => *v = value.into(),
            None => self.meta.push((key.into(), value.into())),
        }
    }

    /// Time of power-on on the recording's own clock, s.
    #[must_use]
    pub fn power_on_s(&self) -> f64 {
        self.meta("power_on_s").and_then(|v| v.trim().parse().ok()).unwrap_or(0.0)
    }

    /// `true` if the rates are corrected ones (a fit refuses them).
    #[must_use]
    pub fn corrected(&self) -> bool {
        self.meta("rates") == Some("corrected")
    }

    /// Reads and cleans a file.
    ///
    /// # Errors
    /// [`BadInput`] with path, line and column.
    pub fn load(path: &Path) -> anyhow::Result<Self> {
        Self::load_with(path, |_| Ok(()))
    }

    /// Reads a file, lets `edit` change what it says, and cleans it.
    ///
    /// # Errors
    /// [`BadInput`] with path, line and column.
    pub fn load_with(path: &Path, edit: impl FnOnce(&mut Self) -> Result<(), BadInput>) -> anyhow::Result<Self> {
        let mut r = Self::read(path)?;
        let read = || -> Result<(), BadInput> {
            edit(&mut r)?;
            r.clean()?;
            Ok(())
        };
        read().map_err(|e| BadInput::new(format!("{}: {e}", path.display())))?;
        r.source = path.display().to_string();
        Ok(r)
    }

    /// A copy, its columns made side by side: for recordings of hundreds of megabytes.
    #[must_use]
    pub fn copied(&self) -> Self {
        let columns = [&self.time_s].into_iter().chain(&self.frequency_hz).chain(&self.rate_dph);
        let columns = columns.chain(self.optional.iter().map(|(_, v)| v)).collect();
        let mut columns = side_by_side::each(columns, Vec::clone).into_iter();
        let mut next = || columns.next().unwrap_or_default();
        Self {
            time_s: next(),
            frequency_hz: std::array::from_fn(|_| next()),
            rate_dph: std::array::from_fn(|_| next()),
            optional: self.optional.iter().map(|(name, _)| (*name, next())).collect(),
            meta: self.meta.clone(),
            thermometer: self.thermometer,
            absent: self.absent,
            status: self.status.clone(),
            notes: self.notes.clone(),
            cleaned: self.cleaned.clone(),
            rate_spikes: self.rate_spikes.clone(),
            judged_from_s: self.judged_from_s,
            source: self.source.clone(),
            earth_rate_dph: self.earth_rate_dph,
        }
    }

    pub(super) fn columns_mut(&mut self) -> impl Iterator<Item = &mut Vec<f64>> {
        self.frequency_hz.iter_mut().chain(&mut self.rate_dph).chain(self.optional.iter_mut().map(|(_, v)| v))
    }

    /// The same with the spikes of its rates in their places again: a unit sends them.
    #[must_use]
    pub fn with_spikes(&self) -> Self {
        let mut out = self.copied();
        for (a, time_s, rate_dph) in &self.rate_spikes {
            let row = out.time_s.partition_point(|t| t < time_s);
            if out.time_s.get(row) == Some(time_s) {
                out.rate_dph[*a][row] = *rate_dph;
            }
        }
        out
    }

    /// The file that it was read from, or `otherwise` where there is none.
    #[must_use]
    pub fn source_or<'a>(&'a self, otherwise: &'a str) -> &'a str {
        if self.source.is_empty() {
            otherwise
        } else {
            &self.source
        }
    }

    /// Usual time between rows, s.
    #[must_use]
    pub fn step_s(&self) -> f64 {
        step_of(&self.time_s)
    }

    /// The stated attitude.
    fn attitude(&self) -> Result<Option<Attitude>, BadInput> {
        Ok(Attitude::of(self.meta("latitude_deg"), self.meta("axes"))?)
    }

    /// Takes the earth-rate components of the stated attitude off the rates, where latitude and axes are given.
    fn remove_earth_rate(&mut self) -> Result<(), BadInput> {
        // (An oscillator does not turn with the earth.)
        if self.without_earth_rate() || self.stands_for().is_some() {
            return Ok(());
        }
        let Some(attitude) = self.attitude()? else { return Ok(()) };
        attitude.names(self.present())?;
        let parts = attitude.earth_rate_dph();
        self.add_to_rates(parts.map(|part| -part));
        self.earth_rate_dph = Some(parts);
        Ok(())
    }

    /// Adds a constant to the rates of each axis, those that were taken out as spikes among them.
    fn add_to_rates(&mut self, parts_dph: [f64; AXES]) {
        for (column, part) in self.rate_dph.iter_mut().zip(parts_dph) {
            column.iter_mut().for_each(|v| *v += part);
        }
        self.rate_spikes.iter_mut().for_each(|(a, _, v)| *v += parts_dph[*a]);
    }

    /// Puts the earth rate back: what a unit measures has it.
    pub fn restore_earth_rate(&mut self) {
        let parts = self.earth_rate_dph.take().unwrap_or_default();
        self.add_to_rates(parts);
    }

    /// Parts a recording in two at a time: to learn from the rows before, and to judge on those after, with the states of the model (lags,
    /// hysteresis) carried on from the beginning. The user decides if two parts of one run are independent enough: nothing that lasts
    /// longer than the first part is learnt from it.
    ///
    /// # Errors
    /// If the time is outside the recording.
    pub fn split(&self, at_s: f64) -> Result<(Self, Self), BadInput> {
        let at = self.time_s.partition_point(|t| *t < at_s);
        if at < 2 || at + 2 > self.time_s.len() {
            let (first, last) = (self.time_s.first().unwrap_or(&0.0), self.time_s.last().unwrap_or(&0.0));
            return Err(BadInput(format!("a split at {at_s} s: the recording goes from {first} to {last} s")));
        }
        let mut before = self.clone();
        before.time_s.truncate(at);
        before.status.truncate(at);
        before.columns_mut().for_each(|c| c.truncate(at));
        let mut after = self.clone();
        after.judged_from_s = Some(at_s);
        after.rate_dph.iter_mut().for_each(|c| c[..at].fill(f64::NAN));
        Ok((before, after))
    }

    /// Only what is judged, as a recording of its own: states begin anew in it.
    #[must_use]
    pub fn judged_part(mut self) -> Self {
        if let Some(from) = self.judged_from_s.take() {
            let at = self.time_s.partition_point(|t| *t < from);
            self.time_s.drain(..at);
            self.status.drain(..at.min(self.status.len()));
            self.columns_mut().for_each(|c| drop(c.drain(..at)));
        }
        self
    }
}

/// Usual time between rows.
fn step_of(time_s: &[f64]) -> f64 {
    let mut d: Vec<f64> = time_s.windows(2).map(|w| w[1] - w[0]).collect();
    crate::numeric::stats::median(&mut d).unwrap_or(1.0)
}

/// Text of recordings for the tests of this room.
#[cfg(test)]
pub(crate) mod samples {
    use std::fmt::Write as _;

    /// Metadata and header.
    pub(crate) const HEAD: &str = "# unit: A\ntime_s,fx_hz,fy_hz,fz_hz,rate_x_dph,rate_y_dph,rate_z_dph\n";

    /// A recording of so many rows.
    pub(crate) fn rows(n: usize) -> String {
        let mut s = HEAD.to_string();
        for k in 0..n {
            let j = (k * 7919 % 101) as f64 * 1e-3;
            let _ = writeln!(s, "{k},{},{},{},{},{},{}", 4900.0 + j, 4890.0 + j, 4700.0 - j, 1.0 + j, 2.0 - j, 3.0 + j);
        }
        s
    }
}

#[cfg(test)]
mod tests {
    use super::samples::rows;
    use super::*;

    #[test]
    fn a_copy_is_the_same() {
        let text =
            rows(30).replace(",rate_z_dph\n", ",rate_z_dph,board_c,supply_v\n").replace("# unit", "# run: 3\n# unit");
        let text: String = text
            .lines()
            .map(|l| format!("{l}{}\n", if l.starts_with(|c: char| c.is_ascii_digit()) { ",20.5,5.1" } else { "" }))
            .collect();
        let mut r = Recording::parse(text.as_bytes()).expect("readable");
        assert_eq!((r.copied(), r.optional.len()), (r.clone(), 2));
        r.clean().expect("usable");
        assert_eq!(r.copied(), r);
    }

    #[test]
    fn a_recording_is_parted_with_its_states() {
        let r = Recording::parse(rows(100).as_bytes()).expect("readable");
        let (before, after) = r.split(60.0).expect("within");
        assert_eq!((before.time_s.len(), after.time_s.len(), after.judged_from_s), (60, 100, Some(60.0)));
        assert_eq!(after.frequency_hz, r.frequency_hz, "what the states need is there");
        assert!(after.rate_dph[1][59].is_nan() && after.rate_dph[1][60] == r.rate_dph[1][60]);
        let alone = after.judged_part();
        assert_eq!((alone.time_s[0], alone.rate_dph[0].len()), (60.0, 40));
        assert!(r.split(-1.0).is_err() && r.split(500.0).is_err());
    }

    #[test]
    fn earth_rate_of_the_attitude_is_removed_once() {
        let text = rows(30).replace("# unit: A", "# latitude_deg: 30\n# axes: x=north y=east z=down");
        let mut r = Recording::parse(text.as_bytes()).expect("readable");
        let before = [r.rate_dph[0][3], r.rate_dph[1][3], r.rate_dph[2][3]];
        r.clean().expect("usable");
        assert!((before[0] - r.rate_dph[0][3] - 13.0259).abs() < 1e-3);
        assert!((before[1] - r.rate_dph[1][3]).abs() < 1e-9);
        assert!((before[2] - r.rate_dph[2][3] + 7.5205).abs() < 1e-3);
        let again = r.rate_dph.clone();
        r.remove_earth_rate().expect("fine");
        assert_eq!(again, r.rate_dph);
        // A file holds what was measured, and reads as it did.
        let mut twice = Recording::parse(r.to_csv().as_bytes()).expect("readable");
        assert!((before[0] - twice.rate_dph[0][3]).abs() < 1e-5 && !twice.without_earth_rate());
        twice.clean().expect("usable");
        assert!((twice.rate_dph[0][3] - r.rate_dph[0][3]).abs() < 1e-5);
        r.restore_earth_rate();
        assert!(!r.without_earth_rate());
        assert!((before[2] - r.rate_dph[2][3]).abs() < 1e-9);
    }
}
