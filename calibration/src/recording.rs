//! Recordings: CSV with `#` metadata lines, one power-on each.
//!
//! Reading is strict about form (a missing column or text in a number ends with the line and column) and
//! lenient about content: missing values, gaps, times that repeat or go back, spikes and stuck values are found,
//! counted, reported in [`Recording::notes`], and taken out; never silently used.

use crate::metadata::{self, Attitude};
use crate::thermometer::{named, Thermometer};
use crate::{dialect, names, BadInput, AXIS_NAMES};
use hrg_core::AXES;
use std::fmt::Write as _;
use std::path::Path;

/// Optional columns that are kept, by name.
pub const OPTIONAL: [&str; 12] = [
    "case_x_c",
    "case_y_c",
    "case_z_c",
    "chamber_c",
    "board_c",
    "supply_v",
    "drive_x_v",
    "drive_y_v",
    "drive_z_v",
    "quad_x_v",
    "quad_y_v",
    "quad_z_v",
];

/// What older files call some of them.
const FORMER: [(&str, &str); 3] = [("shell_x_c", "case_x_c"), ("shell_y_c", "case_y_c"), ("shell_z_c", "case_z_c")];

/// The name that a column has today.
#[must_use]
pub fn column_name(name: &str) -> &str {
    FORMER.iter().find(|(former, _)| *former == name).map_or(name, |(_, today)| today)
}

/// Why a value was taken out of a recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Defect {
    /// The cell is empty or NaN.
    Missing,
    /// The row's time is missing, repeats, goes back or is far ahead: the whole row is left out.
    BadTime,
    /// The same value, to the last digit, for longer than this channel's resolution explains.
    Stuck,
    /// Far from its neighbours, by the scatter that the channel has at that time.
    Spike,
}

impl Defect {
    /// The name that stands in reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Missing => "missing",
            Self::BadTime => "bad-time",
            Self::Stuck => "stuck",
            Self::Spike => "spike",
        }
    }
}

/// Values of one column that were taken out for one reason.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Cleaned {
    /// Column, as the header names it.
    pub column: String,
    /// Why.
    pub defect: Defect,
    /// How many values.
    pub count: usize,
}

/// One power-on.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Recording {
    /// Metadata in order.
    pub meta: Vec<(String, String)>,
    /// Time of each row, s; increasing after [`Recording::clean`].
    pub time_s: Vec<f64>,
    /// What gives the temperatures.
    pub thermometer: Thermometer,
    /// Axes that the recording does not have: their readings and rates are NaN throughout.
    pub absent: [bool; AXES],
    /// Readings of the axes' thermometers; NaN where missing. Of resonators frequencies, Hz; of sensors ([`Self::thermometer`])
    /// temperatures, C.
    pub frequency_hz: [Vec<f64>; AXES],
    /// Rates, deg/h; NaN where missing.
    pub rate_dph: [Vec<f64>; AXES],
    /// Optional columns that are there, in the order of [`OPTIONAL`]; NaN where missing.
    pub optional: Vec<(&'static str, Vec<f64>)>,
    /// Status of the axes and the unit in each row as it was read, where a unit recorded it: else empty.
    pub status: Vec<[u8; 4]>,
    /// What was found on the way: one sentence each.
    pub notes: Vec<String>,
    /// What was taken out, by column and kind.
    pub cleaned: Vec<Cleaned>,
    /// Time from which on it is judged, s: rates before are left out, and readings there only bring the states of the model up to
    /// date. `None`: from its beginning.
    pub judged_from_s: Option<f64>,
    /// Where it was read from; empty where it was not read from a file.
    pub source: String,
    /// Earth rate that was taken off the rates of each axis, deg/h. A file holds it: [`Recording::to_csv`] adds it again.
    pub earth_rate_dph: Option<[f64; 3]>,
}

/// Columns of a unit's status.
const STATUS: [&str; 4] = ["status_x", "status_y", "status_z", "status_unit"];

/// Beginnings of columns that a unit's recording has beside those that a fit uses.
const FROM_UNIT: [&str; 5] = ["temperature_", "bias_", "status_", "raw_", "corrected_"];

impl Recording {
    /// Rates on an even grid of the recording's own step, and that step in s; NaN where no row stands.
    #[must_use]
    pub fn even_rates(&self) -> ([Vec<f64>; 3], f64) {
        let step = self.step_s();
        let (first, last) = match (self.time_s.first(), self.time_s.last()) {
            (Some(a), Some(b)) if step > 0.0 => (*a, *b),
            _ => return (Default::default(), 1.0),
        };
        // A file whose times leap over years is not worth a grid of them.
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

    /// Name of the unit; [`names::NONE`] where the file does not tell, or the unit had none.
    #[must_use]
    pub fn unit(&self) -> &str {
        self.meta("unit").filter(|n| !names::is_unnamed(n)).unwrap_or(names::NONE)
    }

    /// Scale factor that made the rates of the ADC's codes, deg/h per code; `None` where the file does not tell.
    #[must_use]
    pub fn scale_factor(&self) -> Option<[f32; 3]> {
        self.meta(metadata::SCALE_FACTOR).and_then(|v| metadata::scale_factor(v).ok())
    }

    /// Whether the rates are free of the earth's rate.
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

    /// Whether the rates are corrected ones (a fit refuses them).
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
        let bytes = crate::read_file(path, crate::MOST_RECORDING, true)?;
        let read = || -> Result<Self, BadInput> {
            let mut r = Self::parse(&bytes)?;
            edit(&mut r)?;
            r.clean()?;
            r.source = path.display().to_string();
            Ok(r)
        };
        Ok(read().map_err(|e| BadInput::new(format!("{}: {e}", path.display())))?)
    }

    /// Reads the text of a recording, as it is. Other dialects than plain CSV are read as [`dialect`] says.
    ///
    /// # Errors
    /// A sentence with line and column.
    pub fn parse(bytes: &[u8]) -> Result<Self, BadInput> {
        let text = utf8(bytes)?;
        if !dialect::is_plain(text) {
            return Self::parse_plain(&dialect::plain(text)?);
        }
        match Self::parse_plain(text) {
            // Quoted further down: the header does not tell.
            Err(_) if text.contains('"') => Self::parse_plain(&dialect::plain(text)?),
            result => result,
        }
    }

    fn parse_plain(text: &str) -> Result<Self, BadInput> {
        let bad = |s: String| Err(BadInput(s));
        let mut out = Self::default();
        let mut header: Option<Vec<Slot>> = None;
        let mut names: Vec<&str> = Vec::new();
        let mut metadata = metadata::Lines::default();
        let mut missing = Vec::new();
        let mut first_missing = None;
        let rows_guess = text.len() / 80;
        let (mut rest, mut number) = (text, 0);
        while let Some(first) = rest.bytes().next() {
            number += 1;
            // Nearly all lines: a row of data, taken off the front of the text without a look for its end.
            if let (Some(slots), b'0'..=b'9' | b'-') = (&header, first) {
                let row = Row { line: number, slots, names: &names };
                rest = out.row(row, rest, &mut missing, &mut first_missing)?;
                continue;
            }
            let (line, after) = rest.split_once('\n').unwrap_or((rest, ""));
            rest = after;
            let line = line.trim_end_matches('\r');
            if let Some(meta) = line.trim_start().strip_prefix('#') {
                metadata.take(number, meta)?;
            } else if line.trim().is_empty() {
            } else if let Some(slots) = &header {
                let row = Row { line: number, slots, names: &names };
                out.row(row, line, &mut missing, &mut first_missing)?;
            } else {
                names = line.split(',').map(str::trim).collect();
                header = Some(out.slots(&names, number, rows_guess, &metadata)?);
                missing = vec![0usize; names.len()];
            }
        }
        if header.is_none() {
            return bad("the file is empty: there is no header line; a recording begins with time_s,fx_hz,...".into());
        }
        metadata::check(&metadata.entries)?;
        out.meta = metadata.entries;
        out.complete()?;
        if let Some((line, column, name)) = first_missing {
            let total: usize = missing.iter().sum();
            out.notes.push(format!("{total} values are missing, the first at line {line}, column {column} ({name})"));
            for (name, count) in names.iter().zip(missing).filter(|(_, count)| *count > 0) {
                out.cleaned.push(Cleaned { column: (*name).to_string(), defect: Defect::Missing, count });
            }
        }
        Ok(out)
    }

    /// Takes a row of data off the front of `text`; gives what follows it.
    fn row<'t>(
        &mut self,
        row: Row<'_>,
        text: &'t str,
        missing: &mut [usize],
        first_missing: &mut Option<(usize, usize, String)>,
    ) -> Result<&'t str, BadInput> {
        let bytes = text.as_bytes();
        let (mut at, mut cells) = (0, 0);
        loop {
            let slot = row.slots.get(cells).copied();
            cells += 1;
            let (value, end) = match plain_number(&bytes[at..]) {
                Some((value, n)) => (value, at + n),
                None => {
                    let end =
                        bytes[at..].iter().position(|b| matches!(b, b',' | b'\n')).map_or(bytes.len(), |n| at + n);
                    let value = match slot {
                        None | Some(Slot::Ignored) => 0.0,
                        Some(_) => row.number(text[at..end].trim(), cells)?,
                    };
                    (value, end)
                }
            };
            if let Some(slot) = slot.filter(|s| !matches!(s, Slot::Ignored)) {
                if value.is_nan() {
                    missing[cells - 1] += 1;
                    first_missing.get_or_insert_with(|| (row.line, cells, row.names[cells - 1].to_string()));
                }
                self.push(slot, value);
            }
            at = (end + 1).min(bytes.len());
            if bytes.get(end) != Some(&b',') {
                break;
            }
        }
        if cells != row.slots.len() {
            // A decimal comma makes two cells of one.
            let commas = if cells > row.slots.len() {
                " (numbers with decimal commas need semicolons between the cells)"
            } else {
                ""
            };
            return Err(BadInput(format!(
                "line {} has {cells} cells, the header has {}; mend or remove the line{commas}",
                row.line,
                row.slots.len()
            )));
        }
        Ok(&text[at..])
    }

    /// Gives times to rows that have none, and columns to axes that the file does not have.
    fn complete(&mut self) -> Result<(), BadInput> {
        let first = self.present().next().unwrap_or(0);
        let rows = self.rate_dph[first].len();
        if rows == 0 {
            return Err(BadInput::new("there is a header but no row of data; record something"));
        }
        if let Some(step) = self.meta(metadata::TIME_STEP).and_then(|v| v.parse::<f64>().ok()) {
            if !self.time_s.is_empty() {
                self.notes.push(format!(
                    "column time_s is not used: the metadata say that rows are {step} s apart, in their order"
                ));
            }
            self.time_s = (0..rows).map(|k| k as f64 * step).collect();
        }
        for a in 0..AXES {
            if self.absent[a] {
                (self.frequency_hz[a], self.rate_dph[a]) = (vec![f64::NAN; rows], vec![f64::NAN; rows]);
            } else if self.thermometer == Thermometer::None {
                self.frequency_hz[a] = vec![f64::NAN; rows];
            } else if self.thermometer == Thermometer::OneSensor && a != first {
                self.frequency_hz[a] = self.frequency_hz[first].clone();
            }
        }
        if self.absent.contains(&true) {
            let there = named(self.absent.map(|a| !a));
            self.notes.push(format!(
                "the recording has no other axes than {there}: what an effect needs from another is not offered"
            ));
        }
        Ok(())
    }

    fn slots(
        &mut self,
        names: &[&str],
        line: usize,
        rows: usize,
        metadata: &metadata::Lines,
    ) -> Result<Vec<Slot>, BadInput> {
        let commented = metadata.commented_header;
        let first = self.axes_of_header(names, line, metadata)?;
        if names.iter().all(|n| n.parse::<f64>().is_ok()) {
            return Err(BadInput(format!(
                "line {line} holds numbers where the header should be, the names of the columns{}",
                commented
                    .map_or(String::new(), |at| format!(": the header in line {at} begins with #, take the # away"))
            )));
        }
        let mut slots = Vec::new();
        for (k, name) in names.iter().enumerate() {
            let name = &column_name(name);
            if names[..k].iter().any(|n| column_name(n) == *name) {
                return Err(BadInput(format!("line {line}, column {}: {name} is there twice; remove one", k + 1)));
            }
            let axis = AXIS_NAMES.iter().position(|a| name.get(1..2) == Some(a) || name.get(5..6) == Some(a));
            let status = STATUS.iter().position(|s| s == name);
            let own = |a: &usize| {
                self.thermometer != Thermometer::None && self.thermometer.column(*a) == **name && !self.absent[*a]
            };
            let slot = if *name == "time_s" {
                Slot::Time
            } else if let Some(a) = (0..AXES).find(own) {
                Slot::Reading(if self.thermometer == Thermometer::OneSensor { first } else { a })
            } else if is_reading(name) {
                self.notes.push(format!("column {name} is not used: {} the thermometer", self.says_thermometer()));
                Slot::Ignored
            } else if let Some(k) = status {
                Slot::Status { k, first: !slots.iter().any(|s| matches!(s, Slot::Status { .. })) }
            } else if let (Some(a), true) =
                (axis, name.len() == 10 && name.starts_with("rate_") && name.ends_with("_dph"))
            {
                Slot::Rate(a)
            } else if let Some(known) = OPTIONAL.iter().find(|o| *o == name) {
                self.optional.push((known, Vec::with_capacity(rows)));
                Slot::Optional(self.optional.len() - 1)
            } else {
                if !FROM_UNIT.iter().any(|own| name.starts_with(own)) {
                    self.notes.push(format!("column {name} is not known and is ignored"));
                }
                Slot::Ignored
            };
            slots.push(slot);
        }
        Ok(slots)
    }

    /// Which columns are the thermometer, in words.
    fn says_thermometer(&self) -> &'static str {
        match self.thermometer {
            Thermometer::Frequency => {
                "the resonators' frequencies are (\"# thermometer: sensor\" would choose the sensors)"
            }
            Thermometer::Sensors => "the sensors temp_?_c are",
            Thermometer::OneSensor => "the sensor temp_c is",
            Thermometer::None => "the metadata say that nothing is",
        }
    }

    /// Decides what the thermometer is and which axes there are; gives the first axis.
    fn axes_of_header(&mut self, names: &[&str], line: usize, metadata: &metadata::Lines) -> Result<usize, BadInput> {
        let has = |wanted: &str| names.contains(&wanted);
        let any = |t: Thermometer| (0..AXES).any(|a| has(&t.column(a)));
        let sensor = if any(Thermometer::Sensors) { Thermometer::Sensors } else { Thermometer::OneSensor };
        self.thermometer = match metadata.get("thermometer") {
            Some("sensor") => sensor,
            Some("none") => Thermometer::None,
            None if !any(Thermometer::Frequency) && any(sensor) => sensor,
            _ => Thermometer::Frequency,
        };
        let rate = |a: usize| format!("rate_{}_dph", AXIS_NAMES[a]);
        let there = |a: usize| has(&rate(a)) || (self.thermometer.parts_axes() && has(&self.thermometer.column(a)));
        // Names in capitals are an oversight, not an axis left out.
        let nearly = |a: usize| names.iter().any(|n| n.eq_ignore_ascii_case(&rate(a)));
        self.absent = [0, 1, 2].map(|a| !(there(a) || nearly(a)));
        if !self.absent.contains(&false) {
            self.absent = [false; AXES];
        }
        let mut wanted = if metadata.get(metadata::TIME_STEP).is_some() { vec![] } else { vec!["time_s".to_string()] };
        if self.thermometer != Thermometer::None {
            wanted.extend(self.present().map(|a| self.thermometer.column(a)));
        }
        wanted.extend(self.present().map(rate));
        for name in wanted {
            if !names.contains(&name.as_str()) {
                let advice = if name == "time_s" {
                    "rows that are evenly apart may have \"# time_step_s: SECONDS\" in its place"
                } else {
                    "a recording needs time_s, and for each axis rate_?_dph and f?_hz (or temp_?_c, or temp_c for all; \"# thermometer: none\" where there is none)"
                };
                return Err(BadInput(format!(
                    "line {line}: the column {name} is missing{}; {advice}; there are {}",
                    why_missing(&name, names),
                    names.join(", ")
                )));
            }
        }
        Ok(self.present().next().unwrap_or(0))
    }

    fn push(&mut self, slot: Slot, value: f64) {
        match slot {
            Slot::Time => self.time_s.push(value),
            Slot::Reading(a) => self.frequency_hz[a].push(value),
            Slot::Rate(a) => self.rate_dph[a].push(value),
            Slot::Optional(k) => self.optional[k].1.push(value),
            Slot::Status { k, first } => {
                if first {
                    self.status.push([0; 4]);
                }
                if let Some(row) = self.status.last_mut() {
                    row[k] = value as u8;
                }
            }
            Slot::Ignored => {}
        }
    }

    fn columns_mut(&mut self) -> impl Iterator<Item = &mut Vec<f64>> {
        self.frequency_hz.iter_mut().chain(&mut self.rate_dph).chain(self.optional.iter_mut().map(|(_, v)| v))
    }

    /// Takes out rows whose time is missing, repeats, goes back or is far ahead, and notes it.
    ///
    /// # Errors
    /// Where more than half of the rows would have to go, or fewer than two are left.
    pub fn order(&mut self) -> Result<(), BadInput> {
        let rows = self.time_s.len();
        // Rows whose time is missing, repeats or goes back.
        let mut keep = vec![true; rows];
        let mut last = f64::NEG_INFINITY;
        let (mut bad_times, mut first_bad) = (0usize, None);
        let mut ahead = 0usize;
        for k in 0..rows {
            let t = self.time_s[k];
            if t > last {
                // A single time far ahead of its neighbours would throw all later rows out.
                let jumps_ahead =
                    k + 1 < rows && self.time_s[k + 1] <= t && self.time_s[k + 1] > last && t - last > 10.0;
                if jumps_ahead {
                    ahead += 1;
                } else {
                    last = t;
                    continue;
                }
            }
            keep[k] = false;
            bad_times += 1;
            first_bad.get_or_insert(k + 1);
        }
        if let Some(first) = first_bad {
            self.cleaned.push(Cleaned { column: "time_s".into(), defect: Defect::BadTime, count: bad_times });
            self.notes.push(format!(
                "{bad_times} rows have a time that is missing, repeats, goes back or is far ahead ({ahead}), the first is row {first} of the data: left out"
            ));
        }
        if bad_times * 2 > rows || rows - bad_times < 2 {
            return Err(BadInput(format!(
                "column time_s: {bad_times} of {rows} rows have a time that does not increase, the first is row {} of the data; one recording is one power-on, in order of time",
                first_bad.unwrap_or(1)
            )));
        }
        if bad_times > 0 {
            let mut k = 0;
            let flags = keep.clone();
            self.time_s.retain(|_| {
                k += 1;
                flags[k - 1]
            });
            for column in self.columns_mut() {
                let mut k = 0;
                column.retain(|_| {
                    k += 1;
                    keep[k - 1]
                });
            }
        }
        Ok(())
    }

    /// Takes out what cannot be true, and notes it.
    ///
    /// # Errors
    /// As [`Recording::order`]; and where more than half of the values of a channel would have to go.
    pub fn clean(&mut self) -> Result<(), BadInput> {
        self.order()?;
        let step = self.step_s();
        let gaps = self.time_s.windows(2).filter(|w| w[1] - w[0] > 1.5 * step + 1e-9).count();
        if gaps > 0 {
            let longest = self.time_s.windows(2).map(|w| w[1] - w[0]).fold(0.0, f64::max);
            self.notes.push(format!("{gaps} gaps in time, the longest {longest:.1} s"));
        }
        let mut counts = Vec::new();
        let axes: Vec<usize> = self.present().collect();
        for &a in &axes {
            let readings = &mut self.frequency_hz[a];
            let (stuck, spikes) = match self.thermometer {
                Thermometer::None => (0, 0),
                Thermometer::Frequency => (remove_stuck(readings, step), remove_spikes(readings, 8.0, 5e-4)),
                // As any coarse sensor.
                _ => (0, remove_spikes(readings, 12.0, 0.01)),
            };
            if self.thermometer.parts_axes() || a == axes[0] {
                counts.push((self.thermometer.column(a), stuck, spikes));
            }
            let stuck = remove_stuck(&mut self.rate_dph[a], step);
            let spikes = remove_spikes(&mut self.rate_dph[a], 6.5, 0.0);
            counts.push((format!("rate_{}_dph", AXIS_NAMES[a]), stuck, spikes));
        }
        for (name, values) in &mut self.optional {
            // Coarse sensors stand still for long by nature: spikes only.
            let spikes = remove_spikes(values, 12.0, 0.01);
            counts.push(((*name).to_string(), 0, spikes));
        }
        for (column, stuck, spikes) in counts {
            if stuck > 0 {
                self.notes
                    .push(format!("column {column}: {stuck} values stand still exactly (a stuck value): left out"));
                self.cleaned.push(Cleaned { column: column.clone(), defect: Defect::Stuck, count: stuck });
            }
            if spikes > 0 {
                self.notes.push(format!("column {column}: {spikes} spikes: left out"));
                self.cleaned.push(Cleaned { column, defect: Defect::Spike, count: spikes });
            }
        }
        for a in axes {
            let rate = format!("rate_{}_dph", AXIS_NAMES[a]);
            let own =
                (self.thermometer != Thermometer::None).then(|| (self.thermometer.column(a), &self.frequency_hz[a]));
            for (name, column) in own.into_iter().chain([(rate, &self.rate_dph[a])]) {
                let good = column.iter().filter(|v| v.is_finite()).count();
                if good * 2 < column.len() {
                    return Err(BadInput(format!(
                        "column {name}: only {good} of {} values can be used; check that channel",
                        column.len()
                    )));
                }
            }
        }
        self.remove_earth_rate()
    }

    /// Usual time between rows, s.
    #[must_use]
    pub fn step_s(&self) -> f64 {
        let mut d: Vec<f64> = self.time_s.windows(2).map(|w| w[1] - w[0]).collect();
        crate::stats::median(&mut d).unwrap_or(1.0)
    }

    /// Takes the earth-rate components of the stated attitude off the rates, where latitude and axes are given.
    fn remove_earth_rate(&mut self) -> Result<(), BadInput> {
        if self.without_earth_rate() {
            return Ok(());
        }
        let Some(attitude) = Attitude::of(self.meta("latitude_deg"), self.meta("axes"))? else {
            return Ok(());
        };
        let parts = attitude.earth_rate_dph();
        for (column, part) in self.rate_dph.iter_mut().zip(parts) {
            column.iter_mut().for_each(|v| *v -= part);
        }
        self.earth_rate_dph = Some(parts);
        Ok(())
    }

    /// Puts the earth rate back: what a unit measures has it.
    pub fn restore_earth_rate(&mut self) {
        let parts = self.earth_rate_dph.take().unwrap_or_default();
        for (column, part) in self.rate_dph.iter_mut().zip(parts) {
            column.iter_mut().for_each(|v| *v += part);
        }
    }

    /// Parts a recording in two at a time: to learn from what is before, and to judge on what is after, with the states of the
    /// model (lags, hysteresis) carried on from the beginning. Whether two parts of one run are independent enough is for the user
    /// to say: nothing that lasts longer than the first part is learnt from it.
    ///
    /// # Errors
    /// Where the time is outside the recording.
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

    /// The recording as text, with the earth rate in it that was taken off when it was read.
    #[must_use]
    pub fn to_csv(&self) -> String {
        let mut s = String::with_capacity(self.time_s.len() * 120);
        // (The times of rows that had none are written.)
        for (k, v) in self.meta.iter().filter(|(k, _)| k != metadata::TIME_STEP) {
            let _ = writeln!(s, "# {k}: {v}");
        }
        s.push_str("time_s");
        let columns = match self.thermometer {
            Thermometer::None => 0,
            Thermometer::OneSensor => 1,
            _ => AXES,
        };
        let readings: Vec<usize> = self.present().take(columns).collect();
        for a in &readings {
            let _ = write!(s, ",{}", self.thermometer.column(*a));
        }
        for a in self.present() {
            let _ = write!(s, ",rate_{}_dph", AXIS_NAMES[a]);
        }
        for (name, _) in &self.optional {
            let _ = write!(s, ",{name}");
        }
        s.push('\n');
        let cell = |s: &mut String, v: f64, digits: usize| {
            if v.is_finite() {
                let _ = write!(s, ",{v:.digits$}");
            } else {
                s.push(',');
            }
        };
        for k in 0..self.time_s.len() {
            let _ = write!(s, "{}", self.time_s[k]);
            for a in &readings {
                cell(&mut s, self.frequency_hz[*a][k], self.thermometer.digits());
            }
            for a in self.present() {
                cell(&mut s, self.rate_dph[a][k] + self.earth_rate_dph.map_or(0.0, |e| e[a]), 5);
            }
            for (_, c) in &self.optional {
                cell(&mut s, c[k], 4);
            }
            s.push('\n');
        }
        s
    }
}

/// The text of a file, without its byte-order mark.
pub(crate) fn utf8(bytes: &[u8]) -> Result<&str, BadInput> {
    std::str::from_utf8(bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes)).map_err(|e| {
        let line = 1 + bytes[..e.valid_up_to()].iter().filter(|&&b| b == b'\n').count();
        BadInput(format!("line {line} is not UTF-8 text; save the file as CSV in UTF-8"))
    })
}

/// Whether a column is one that some thermometer has.
fn is_reading(name: &str) -> bool {
    [Thermometer::Frequency, Thermometer::Sensors, Thermometer::OneSensor]
        .iter()
        .any(|t| (0..AXES).any(|a| t.column(a) == name))
}

/// What the header shows of why a column is missing.
fn why_missing(wanted: &str, names: &[&str]) -> String {
    if let Some(near) = names.iter().find(|n| n.eq_ignore_ascii_case(wanted)) {
        return format!(" (there is {near}: names are written in small letters)");
    }
    if let [one] = names {
        if one.contains('|') || one.split_whitespace().count() > 2 {
            return " (put commas, semicolons or tabs between the cells)".into();
        }
    }
    String::new()
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Slot {
    Time,
    /// Of an axis' thermometer.
    Reading(usize),
    Rate(usize),
    Optional(usize),
    /// Of an axis or the unit; the first such column of the file.
    Status {
        k: usize,
        first: bool,
    },
    Ignored,
}

/// What is known of a row before it is read.
#[derive(Clone, Copy)]
struct Row<'a> {
    line: usize,
    slots: &'a [Slot],
    names: &'a [&'a str],
}

impl Row<'_> {
    /// A cell that is not a plain number: missing, with an exponent, very long, or wrong.
    fn number(&self, cell: &str, column: usize) -> Result<f64, BadInput> {
        if cell.is_empty() || cell.eq_ignore_ascii_case("nan") {
            return Ok(f64::NAN);
        }
        cell.parse().ok().filter(|v: &f64| v.is_finite()).ok_or_else(|| {
            BadInput(format!(
                "line {}, column {column} ({}): \"{}\" is not a number; mend or empty the cell",
                self.line,
                self.names.get(column - 1).unwrap_or(&""),
                shorten(cell)
            ))
        })
    }
}

/// Powers of ten that an f64 holds exactly.
const EXACT: [f64; 16] = [1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15];

/// A number of at most 15 digits, with or without sign and point, and the place of the comma or line feed that ends it. Such a
/// number is a quotient of two that an f64 holds exactly, so that one division gives what the standard library's parser gives.
#[inline]
fn plain_number(bytes: &[u8]) -> Option<(f64, usize)> {
    let negative = bytes.first() == Some(&b'-');
    let start = usize::from(negative);
    let (mut mantissa, mut point, mut at) = (0u64, None, start);
    while let Some(&b) = bytes.get(at) {
        match b {
            b'0'..=b'9' => mantissa = mantissa.wrapping_mul(10).wrapping_add(u64::from(b - b'0')),
            b'.' if point.is_none() => point = Some(at),
            b',' | b'\n' => break,
            b'\r' if matches!(bytes.get(at + 1), None | Some(b'\n')) => break,
            _ => return None,
        }
        at += 1;
    }
    let digits = at - start - usize::from(point.is_some());
    if digits == 0 || digits > 15 {
        return None;
    }
    let value = mantissa as f64 / EXACT[point.map_or(0, |p| at - p - 1)];
    let end = at + usize::from(bytes.get(at) == Some(&b'\r'));
    Some((if negative { -value } else { value }, end))
}

fn shorten(cell: &str) -> String {
    cell.chars().take(24).collect()
}

/// Runs of exactly equal values: no measured frequency or rate repeats to the last digit for long. What counts
/// as long depends on how often this channel repeats by its resolution alone.
fn remove_stuck(values: &mut [f64], step_s: f64) -> usize {
    let pairs = values.len().saturating_sub(1).max(1);
    let repeats = values.windows(2).filter(|w| w[0] == w[1]).count();
    // With a share p of natural repeats a run of n has odds p^n; ask for one in 1e9, and for 8 rows at least.
    let share = (repeats as f64 / pairs as f64).clamp(0.01, 0.999);
    let natural = (1e-9f64.ln() / share.ln()).ceil();
    let longest = natural.max(8.0).max(10.0 / step_s.max(1e-3)).min(1e9) as usize;
    let (mut start, mut removed) = (0, 0);
    for k in 1..=values.len() {
        if k < values.len() && values[k] == values[start] {
            continue;
        }
        if k - start > longest {
            values[start + 1..k].fill(f64::NAN);
            removed += k - start - 1;
        }
        start = k;
    }
    removed
}

/// Half the neighbours of a value in [`remove_spikes`], without itself.
const HALF: usize = 5;

/// Values that share one estimate of the scatter in [`remove_spikes`]: some minutes at 1 Hz.
const SCATTER_ROWS: usize = 512;

/// Median of the finite values among a value and its ten nearest neighbours; NaN where none is finite.
fn running_median(values: &[f64], k: usize) -> f64 {
    let from = k.saturating_sub(HALF).min(values.len() - 2 * HALF - 1);
    let mut w = [0.0; 2 * HALF + 1];
    let mut m = 0;
    for v in &values[from..=from + 2 * HALF] {
        if v.is_finite() {
            w[m] = *v;
            m += 1;
        }
    }
    // Eleven values: sorting by insertion beats selection.
    for i in 1..m {
        let v = w[i];
        let mut j = i;
        while j > 0 && w[j - 1] > v {
            w[j] = w[j - 1];
            j -= 1;
        }
        w[j] = v;
    }
    if m > 0 {
        w[m / 2]
    } else {
        f64::NAN
    }
}

/// Robust scatter of the values about their running median, at even places along the column: noise may grow with
/// temperature, so one scatter for the whole column would take true samples of its loud part for spikes.
struct Scatter {
    places: Vec<f64>,
    length: f64,
}

impl Scatter {
    /// `None` where the column has no scatter at all. Deviations below `harmless` count as that.
    fn of(values: &[f64], harmless: f64) -> Option<Self> {
        let n = values.len();
        let count = (n / SCATTER_ROWS).clamp(1, 64);
        let stride = (n / (count * 250)).max(1);
        let off: Vec<f64> = (0..n)
            .step_by(stride)
            .map(|k| (values[k] - running_median(values, k)).abs())
            .filter(|d| d.is_finite())
            .collect();
        if off.is_empty() {
            return None;
        }
        // Quantised columns may have no spread at all at their median: then one step of resolution counts.
        let resolution = off.iter().copied().filter(|d| *d > 0.0).fold(f64::INFINITY, f64::min);
        let least = if resolution.is_finite() { resolution.max(harmless) } else { harmless };
        if least <= 0.0 {
            return None;
        }
        let per_place = off.len().div_ceil(count).max(1);
        let own: Vec<f64> =
            off.chunks(per_place).map(|c| 1.4826 * crate::stats::median(&mut c.to_vec()).unwrap_or(0.0)).collect();
        // A place is as loud as the louder of its neighbours: the change from one to the next is not sharp.
        let places = (0..own.len())
            .map(|k| own[k.saturating_sub(1)..(k + 2).min(own.len())].iter().fold(least, |m, v| m.max(*v)))
            .collect();
        Some(Self { places, length: n as f64 })
    }

    fn at(&self, k: usize) -> f64 {
        self.places[((k as f64 / self.length * self.places.len() as f64) as usize).min(self.places.len() - 1)]
    }
}

/// Hampel filter: values further than `limit` times the scatter from the median of 11 neighbours. Deviations
/// below `harmless` count as that (a frequency of 0.5 mHz is 1 mK).
///
/// A spike is rare. Where more than [`MOST_SPIKES`] of the values are that far off, the scatter is not what makes them so (a coarse
/// resolution hides it, or the channel moves fast): the limit is doubled until it is.
fn remove_spikes(values: &mut [f64], limit: f64, harmless: f64) -> usize {
    if values.len() < 2 * HALF + 1 {
        return 0;
    }
    let Some(scatter) = Scatter::of(values, harmless) else { return 0 };
    let most = (MOST_SPIKES * values.len() as f64) as usize;
    let mut spikes = spikes(values, limit, &scatter);
    let mut wider = limit;
    while spikes.len() > most.max(8) {
        wider *= 2.0;
        spikes = self::spikes(values, wider, &scatter);
    }
    let removed = spikes.len();
    spikes.into_iter().for_each(|k| values[k] = f64::NAN);
    removed
}

/// Share of a column that may be spikes.
const MOST_SPIKES: f64 = 0.02;

/// Places of the values further than `limit` times the scatter from the median of their neighbours.
fn spikes(values: &[f64], limit: f64, scatter: &Scatter) -> Vec<usize> {
    let n = values.len();
    let mut spikes = Vec::new();
    for k in 0..n {
        let v = values[k];
        let near = limit * scatter.at(k);
        if (HALF..n - HALF).contains(&k) {
            // More than half of the neighbours (itself among them) are near: then so is their median, and it need not be found.
            let close: usize = values[k - HALF..=k + HALF].iter().map(|w| usize::from((w - v).abs() <= near)).sum();
            if close > HALF {
                continue;
            }
        }
        // Values at the ends have neighbours on one side only: a ramp may lead away from their median.
        let ramp = if k < HALF {
            3.0 * (running_median(values, HALF) - running_median(values, (3 * HALF).min(n - 1))).abs()
        } else if k >= n - HALF {
            3.0 * (running_median(values, n - 1 - HALF) - running_median(values, (n - 1).saturating_sub(3 * HALF)))
                .abs()
        } else {
            0.0
        };
        if (v - running_median(values, k)).abs() > near + ramp {
            spikes.push(k);
        }
    }
    spikes
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEAD: &str = "# unit: A\ntime_s,fx_hz,fy_hz,fz_hz,rate_x_dph,rate_y_dph,rate_z_dph\n";

    fn rows(n: usize) -> String {
        let mut s = HEAD.to_string();
        for k in 0..n {
            let j = (k * 7919 % 101) as f64 * 1e-3;
            let _ = writeln!(s, "{k},{},{},{},{},{},{}", 4900.0 + j, 4890.0 + j, 4700.0 - j, 1.0 + j, 2.0 - j, 3.0 + j);
        }
        s
    }

    fn error(text: &str) -> String {
        match Recording::parse(text.as_bytes()) {
            Err(e) => e.0,
            Ok(mut r) => r.clean().expect_err("must be refused").0,
        }
    }

    #[test]
    fn each_defect_gets_one_sentence_with_its_place() {
        assert!(error("").contains("empty"));
        assert!(error(HEAD).contains("no row"));
        assert!(error("time_s,fx_hz\n1,2\n").contains("rate_x_dph is missing"));
        let text = rows(20).replace("5,4900", "5,hello");
        assert!(error(&text).starts_with("line 8, column 2 (fx_hz): \"hello"), "{}", error(&text));
        assert!(error(&(rows(20) + "21,1,2\n")).contains("line 23 has 3 cells"));
        let mut back = HEAD.to_string();
        for k in (0..20).rev() {
            let _ = writeln!(back, "{k},1,2,3,4,5,6");
        }
        assert!(error(&back).contains("time_s"));
        assert!(Recording::parse(b"\xff\xfe\x00").expect_err("not text").0.contains("line 1"));
        assert!(error(&rows(20).replace("# unit: A", "# rate_unit: rad/s")).contains("deg/h"));
    }

    #[test]
    fn dirt_is_counted_and_taken_out() {
        let mut lines: Vec<String> = rows(300).lines().map(String::from).collect();
        lines[50] = lines[49].clone(); // repeated time
        lines[100] = "98,4900.01,4890.01,4700,900,2,3".into(); // spike
        lines[120] = "118,,4890.01,4700,1,2,3".into(); // missing
        for (k, line) in lines.iter_mut().enumerate().take(250).skip(200) {
            *line = format!("{},4900.05,4890.05,4699.9,1.5,1.9,3.1", k - 2); // stuck
        }
        let mut r = Recording::parse(lines.join("\r\n").as_bytes()).expect("readable");
        r.clean().expect("usable");
        let notes = r.notes.join("\n");
        for word in ["1 values are missing, the first at line 121, column 2 (fx_hz)", "repeats", "spikes", "stuck"] {
            assert!(notes.contains(word), "{word} not in {notes}");
        }
        assert_eq!(r.time_s.len(), 299);
    }

    #[test]
    fn a_column_without_a_value_has_no_spikes() {
        assert_eq!(remove_spikes(&mut [f64::NAN; 50], 8.0, 5e-4), 0);
        let mut r = Recording::parse(rows(50).replace(",4900", ",nan,4900").as_bytes());
        assert!(r.is_err(), "the cells no longer fit the header");
        r = Recording::parse((HEAD.to_string() + &"1,,2,3,4,5,6\n".repeat(50)).as_bytes());
        assert!(r.expect("readable").clean().is_err());
    }

    #[test]
    fn noise_that_grows_is_not_taken_for_spikes() {
        use rand::SeedableRng;
        use rand_distr::{Distribution, StandardNormal};
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(4);
        let n = 20_000;
        // Twenty times as loud at one end as at the other.
        let mut v: Vec<f64> = (0..n)
            .map(|k| {
                let x: f64 = StandardNormal.sample(&mut rng);
                x * (1.0 + 19.0 * k as f64 / n as f64)
            })
            .collect();
        for k in (50..n).step_by(500) {
            v[k] = 400.0;
        }
        let removed = remove_spikes(&mut v, 6.5, 0.0);
        assert!((50..n).step_by(500).all(|k| v[k].is_nan()), "the spikes are found");
        assert!(removed <= 40 + n / 1000, "{removed} removed");
    }

    #[test]
    fn a_coarse_channel_that_moves_is_not_taken_for_spikes() {
        // It stands still for most of the time, so that its scatter is that of its resolution, and moves in one row of five.
        let mut level = 0;
        let mut v: Vec<f64> = (0..5000u64)
            .map(|k| {
                let x = k.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 40;
                level += if x % 5 == 0 { [-6, 6, -4, 4][(x / 5 % 4) as usize] } else { 0 };
                f64::from(level) * 0.1
            })
            .collect();
        v[1000] += 60.0;
        v[3000] -= 60.0;
        let removed = remove_spikes(&mut v, 6.5, 0.0);
        assert!(v[1000].is_nan() && v[3000].is_nan());
        assert!(removed <= 100, "{removed} removed");
    }

    #[test]
    fn sensors_and_fewer_axes_are_read_and_written() {
        let mut text = "# thermometer: sensor\n# time_step_s: 2\ntemp_c,rate_z_dph\n".to_string();
        for k in 0..40 {
            let _ = writeln!(text, "{},{}", 20.0 + 0.1 * f64::from(k), 5.0 + f64::from(k * 7 % 11));
        }
        let mut r = Recording::parse(text.as_bytes()).expect("readable");
        r.clean().expect("usable");
        assert_eq!((r.thermometer, r.absent), (Thermometer::OneSensor, [true, true, false]));
        assert_eq!((r.time_s[39], r.frequency_hz[2][10], r.rate_dph[2][1]), (78.0, 21.0, 12.0));
        assert!(r.rate_dph[0].len() == 40 && r.frequency_hz[1].iter().all(|v| v.is_nan()));
        let again = Recording::parse(r.to_csv().as_bytes()).expect("readable");
        assert_eq!((&again.time_s, again.thermometer, again.absent), (&r.time_s, r.thermometer, r.absent));
        assert_eq!(again.frequency_hz[2], r.frequency_hz[2]);
        // A sensor for each axis; frequencies beside them are the thermometer, unless the file says otherwise.
        let both = "time_s,fx_hz,temp_x_c,rate_x_dph\n0,4900,20,1\n1,4900.1,20.1,2\n";
        let r = Recording::parse(both.as_bytes()).expect("readable");
        assert!(r.thermometer == Thermometer::Frequency && r.notes.iter().any(|n| n.contains("temp_x_c is not used")));
        let r = Recording::parse(format!("# thermometer: sensor\n{both}").as_bytes()).expect("readable");
        assert_eq!((r.thermometer, r.frequency_hz[0][1]), (Thermometer::Sensors, 20.1));
        let none = "# thermometer: none\ntime_s,rate_y_dph\n0,1\n1,2\n2,4\n";
        let mut r = Recording::parse(none.as_bytes()).expect("readable");
        r.clean().expect("usable");
        assert_eq!(Recording::parse(r.to_csv().as_bytes()).expect("readable").rate_dph[1], [1.0, 2.0, 4.0]);
        for (text, says) in [
            ("time_s,rate_y_dph\n0,1\n", "fy_hz is missing"),
            ("time_s,temp_c\n1,2\n", "rate_x_dph is missing"),
            ("time_s,temp_x_c,rate_y_dph\n1,2,3\n", "temp_y_c is missing"),
            ("temp_c,rate_x_dph\n1,2\n", "time_s is missing; rows that are evenly apart"),
            ("time_s,temp_c,RATE_X_dph\n1,2,3\n", "small letters"),
        ] {
            let e = Recording::parse(text.as_bytes()).expect_err(says).0;
            assert!(e.contains(says), "{text}: {e}");
        }
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
    fn what_was_taken_out_is_counted_by_column_and_kind() {
        let mut lines: Vec<String> = rows(300).lines().map(String::from).collect();
        lines[100] = "98,4900.01,4890.01,4700,900,2,3".into();
        lines[120] = "118,,4890.01,4700,1,2,3".into();
        let mut r = Recording::parse(lines.join("\n").as_bytes()).expect("readable");
        r.clean().expect("usable");
        let of = |column: &str, defect: Defect| {
            r.cleaned.iter().find(|c| c.column == column && c.defect == defect).map_or(0, |c| c.count)
        };
        assert_eq!((of("fx_hz", Defect::Missing), of("rate_x_dph", Defect::Spike)), (1, 1), "{:?}", r.cleaned);
        assert_eq!(r.cleaned.len(), 2, "{:?}", r.cleaned);
    }

    #[test]
    fn plain_numbers_are_what_the_standard_library_reads() {
        let mut x = 1u64;
        for k in 0..200_000u32 {
            x = x.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let value = (x >> 12) as f64 / EXACT[(x % 16) as usize] * if k % 2 == 0 { -1e-4 } else { 1e-4 };
            let text = format!("{value:.*}", (x % 13) as usize);
            let wanted: f64 = text.parse().expect("a number");
            for (end, more) in [("", 0), (",1", 0), ("\n", 0), ("\r\n", 1), ("\r", 1)] {
                match plain_number(format!("{text}{end}").as_bytes()) {
                    Some((v, at)) => assert_eq!((v.to_bits(), at), (wanted.to_bits(), text.len() + more), "{text}"),
                    None => assert!(text.len() > 15, "{text}"),
                }
            }
        }
        for odd in ["", "-", ".", "1e5", "+1", "0x1", "inf", "1.2.3", " 1", "1 ", "--1", "1_0", "1\r\r\n", "1\r2"] {
            assert_eq!(plain_number(odd.as_bytes()), None, "{odd}");
        }
    }

    #[test]
    fn there_and_back() {
        let mut r = Recording::parse(rows(30).as_bytes()).expect("readable");
        r.clean().expect("usable");
        let again = Recording::parse(r.to_csv().as_bytes()).expect("readable");
        assert_eq!(again.frequency_hz, r.frequency_hz);
        assert_eq!(again.rate_dph, r.rate_dph);
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
