//! Maps: which columns of a table are what, and in which units. TOML, described in docs/formats.md; some are built in.

use crate::axes::AXIS_NAMES;
use crate::error::BadInput;
use crate::recording::columns;
use crate::recording::metadata::DPH_PER_RAD_S;
use crate::recording::time_form::{TimeForm, FORMS};
use hrg_core::accelerometers::STANDARD_GRAVITY_MPS2;
use serde::Deserialize;
use std::collections::BTreeMap;

/// Maps that come with the program: name, text.
pub const BUILT_IN: [(&str, &str); 7] = [
    ("px4", include_str!("../../../maps/px4.toml")),
    ("ardupilot", include_str!("../../../maps/ardupilot.toml")),
    ("ardupilot-tcal", include_str!("../../../maps/ardupilot-tcal.toml")),
    ("ros", include_str!("../../../maps/ros.toml")),
    ("betaflight", include_str!("../../../maps/betaflight.toml")),
    ("adis", include_str!("../../../maps/adis.toml")),
    ("bosch", include_str!("../../../maps/bosch.toml")),
];

/// Kind of file that a map is for.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Format {
    /// Text with a separator; a Parquet file or an ArduPilot log, if it begins as one.
    #[default]
    Delimited,
    /// PX4's binary log.
    Ulog,
    /// Betaflight's log.
    Blackbox,
    /// A ROS bag as MCAP.
    Mcap,
}

/// Layout of the text of a table.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Layout {
    /// `comma`, `semicolon`, `tab`, `space` (any white space) or one character; by default what the header has most of.
    pub separator: Option<String>,
    /// Set if the first line names the columns; else they are called 1, 2, 3, ...
    pub header: bool,
    /// Lines before the header.
    pub skip_lines: usize,
    /// Lines that begin so are left out.
    pub comment: String,
    /// Rows of data that are left out at the beginning.
    pub drop_rows: usize,
    /// Rows that are kept: those with these words in these columns.
    pub keep: BTreeMap<String, String>,
    /// Encoding of the text, as `windows-1252` or `utf-16le`; by default UTF-8, UTF-16 where the file begins so, else Windows-1252.
    pub encoding: Option<String>,
    /// Texts that stand for a missing value, beside an empty cell and those that programs write.
    pub missing: Vec<String>,
    /// Excel: the sheet; by default the one with most rows.
    pub sheet: Option<String>,
    /// PX4, ROS: the topic; ArduPilot: the message. Or several, of which the first that is there counts.
    pub topic: Option<Names>,
    /// Number of the IMU, from 0: the instance of a PX4 topic, the rows with this number in [`instance_column`](Self::instance_column), or (in
    /// ArduPilot logs without that column) the message `IMU`, `IMU2` or `IMU3`.
    pub instance: u8,
    /// The column with the number of the IMU.
    pub instance_column: Option<String>,
}

impl Default for Layout {
    fn default() -> Self {
        Self {
            separator: None,
            header: true,
            skip_lines: 0,
            comment: "#".into(),
            drop_rows: 0,
            keep: BTreeMap::new(),
            encoding: None,
            missing: Vec::new(),
            sheet: None,
            topic: None,
            instance: 0,
            instance_column: None,
        }
    }
}

/// A column with its unit.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Column {
    /// Its name; or names, of which the first that is there counts.
    pub column: Names,
    /// Unit of its values; by default that of the recording.
    #[serde(default)]
    pub unit: Option<String>,
    /// Added to the values as they stand in the file, before anything else.
    #[serde(default)]
    pub offset: f64,
    /// Factor on the values, beside that of the unit: -1 for an axis that points the other way.
    #[serde(default = "one")]
    pub factor: f64,
    /// Lowest and highest value, as they stand in the file, that is one; others are missing.
    #[serde(default)]
    pub valid: Option<[f64; 2]>,
    /// A thermometer that a file may be without.
    #[serde(default)]
    pub may_be_missing: bool,
}

fn one() -> f64 {
    1.0
}

/// One name, or several that programs have used.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(untagged)]
pub enum Names {
    /// One.
    One(String),
    /// Several, the likeliest first.
    Any(Vec<String>),
}

impl Names {
    /// All of them.
    #[must_use]
    pub fn all(&self) -> Vec<&str> {
        match self {
            Self::One(n) => vec![n],
            Self::Any(n) => n.iter().map(String::as_str).collect(),
        }
    }
}

/// Source of the times.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Time {
    /// The column.
    pub column: Option<Names>,
    /// Time of day, where [`column`](Self::column) is a date alone: its text follows after a blank.
    pub second_column: Option<Names>,
    /// Form of the times ([`TimeForm`]): `s`, `ms`, `us`, `ns`, `min`, `h`, `unix`, `iso` for dates like 2024-05-01T12:00:00, or a pattern
    /// like `%d.%m.%Y %H:%M:%S,%f`.
    pub unit: Option<String>,
    /// Added to the times, s: for a clock that is off, or local time.
    pub offset_s: f64,
    /// In the place of a column: rows are so far apart, s.
    pub step_s: Option<f64>,
    /// Set if the column counts from power-on; else the first row is at time 0.
    pub since_power_on: bool,
}

impl Time {
    /// Form of the times.
    ///
    /// # Errors
    /// A unit that is none, with those that there are.
    pub fn form(&self) -> Result<TimeForm, BadInput> {
        let unit = self.unit.as_deref().unwrap_or("s");
        TimeForm::parse(unit)
            .ok_or_else(|| BadInput(format!("the map has the unit \"{unit}\" for a time; there are {FORMS}")))
    }
}

/// A map.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Map {
    /// Version of the format of maps: 1.
    #[serde(rename = "hrg-map")]
    pub version: u32,
    /// Kind of file.
    #[serde(default)]
    pub format: Format,
    /// Layout.
    #[serde(default)]
    pub table: Layout,
    /// Metadata of the recording.
    #[serde(default)]
    pub meta: BTreeMap<String, String>,
    /// Times.
    pub time: Time,
    /// Resonators, by axis.
    #[serde(default)]
    pub frequency: BTreeMap<String, Column>,
    /// Temperature sensors by axis, or one under `all`.
    #[serde(default)]
    pub temperature: BTreeMap<String, Column>,
    /// Rates, by axis.
    pub rate: BTreeMap<String, Column>,
    /// Other columns of a recording, by their names there.
    #[serde(default)]
    pub optional: BTreeMap<String, Column>,
}

/// Factor and offset from a unit to that of the recording.
type Conversion = (f64, f64);

/// Units that a quantity may have.
fn units(quantity: &str) -> &'static [(&'static str, Conversion)] {
    const DEGREE_PER_RAD: f64 = 180.0 / std::f64::consts::PI;
    match quantity {
        "rate" => &[
            ("deg/h", (1.0, 0.0)),
            ("deg/s", (3600.0, 0.0)),
            ("rad/s", (DPH_PER_RAD_S, 0.0)),
            ("mrad/s", (3.6 * DEGREE_PER_RAD, 0.0)),
            ("mdeg/s", (3.6, 0.0)),
            ("urad/s", (3.6e-3 * DEGREE_PER_RAD, 0.0)),
            // (An arc second a second is a degree an hour.)
            ("arcsec/s", (1.0, 0.0)),
            ("deg/min", (60.0, 0.0)),
            // Not a rate: a quantity that stands in its place, its values as they are.
            ("ppb", (1.0, 0.0)),
            ("ppm", (1000.0, 0.0)),
        ],
        "temperature" => {
            &[("C", (1.0, 0.0)), ("K", (1.0, -273.15)), ("mC", (1e-3, 0.0)), ("F", (5.0 / 9.0, -160.0 / 9.0))]
        }
        "frequency" => &[("Hz", (1.0, 0.0)), ("kHz", (1e3, 0.0)), ("MHz", (1e6, 0.0))],
        "specific force" => {
            &[("m/s^2", (1.0, 0.0)), ("g", (STANDARD_GRAVITY_MPS2, 0.0)), ("mg", (1e-3 * STANDARD_GRAVITY_MPS2, 0.0))]
        }
        _ => &[("V", (1.0, 0.0)), ("mV", (1e-3, 0.0))],
    }
}

/// The conversion of a unit.
///
/// # Errors
/// A unit that the quantity does not have, with those that it has.
pub fn conversion(quantity: &str, unit: Option<&str>) -> Result<Conversion, BadInput> {
    let known = units(quantity);
    let unit = unit.unwrap_or(known[0].0);
    known.iter().find(|(n, _)| *n == unit).map(|(_, c)| *c).ok_or_else(|| {
        let names: Vec<&str> = known.iter().map(|(n, _)| *n).collect();
        BadInput(format!("\"{unit}\" is no unit of a {quantity}; there are {}", names.join(", ")))
    })
}

impl Map {
    /// One that comes with the program, by its name; else the one in the file of that name.
    ///
    /// # Errors
    /// One sentence: what cannot be read, or is wrong where.
    pub fn named(name: &str) -> Result<Self, BadInput> {
        if let Some(map) = Self::built_in(name) {
            return Ok(map);
        }
        let text = std::fs::read_to_string(name).map_err(|e| {
            let known: Vec<&str> = BUILT_IN.iter().map(|(n, _)| *n).collect();
            BadInput(format!("cannot read the map {name}: {e}; built in are {}", known.join(", ")))
        })?;
        Self::parse(&text).map_err(|e| BadInput(format!("{name}: {e}")))
    }

    /// One that comes with the program, by its name; `None` for any other name.
    #[must_use]
    pub fn built_in(name: &str) -> Option<Self> {
        let (_, text) = BUILT_IN.iter().find(|(n, _)| *n == name)?;
        Self::parse(text).ok()
    }

    /// Reads a map.
    ///
    /// # Errors
    /// One sentence: what is wrong where.
    pub fn parse(text: &str) -> Result<Self, BadInput> {
        let map: Self = toml::from_str(text).map_err(|e| {
            let place = e.span().map_or(String::new(), |s| {
                format!(
                    "line {}: ",
                    1 + text.as_bytes()[..s.start.min(text.len())].iter().filter(|b| **b == b'\n').count()
                )
            });
            BadInput(format!("{place}{}", e.message().replace('\n', " ")))
        })?;
        map.check()?;
        Ok(map)
    }

    fn check(&self) -> Result<(), BadInput> {
        let bad = |s: String| Err(BadInput(s));
        if self.version != 1 {
            return bad(format!("the map is of version {}, this program reads version 1", self.version));
        }
        if self.rate.is_empty() {
            return bad("the map has no rate: [rate] needs x, y or z".into());
        }
        if !self.frequency.is_empty() && !self.temperature.is_empty() {
            return bad(
                "a map has [frequency] or [temperature], not both (or neither, where there is no thermometer)".into()
            );
        }
        for (section, columns) in
            [("rate", &self.rate), ("frequency", &self.frequency), ("temperature", &self.temperature)]
        {
            for (axis, c) in columns {
                let all = section == "temperature" && axis == "all";
                if !(all || AXIS_NAMES.contains(&axis.as_str())) {
                    return bad(format!("[{section}] has \"{axis}\"; its axes are x, y and z"));
                }
                let _ = conversion(section, c.unit.as_deref())?;
            }
        }
        for axis in self.rate.keys() {
            let readings = if self.frequency.is_empty() { &self.temperature } else { &self.frequency };
            if !(readings.is_empty() || readings.contains_key(axis) || readings.contains_key("all")) {
                return bad(format!("the map has a rate of axis {axis} and no thermometer for it"));
            }
        }
        for (name, c) in &self.optional {
            if !columns::optional().any(|o| o == name) {
                return bad(format!("[optional] has \"{name}\"; there are {}", columns::optional_names()));
            }
            let _ = conversion(quantity_of(name), c.unit.as_deref())?;
        }
        let all = self.rate.values().chain(self.frequency.values()).chain(self.temperature.values());
        for c in all.chain(self.optional.values()) {
            if let Some([low, high]) = c.valid.filter(|[low, high]| !(low < high)) {
                let name = c.column.all()[0];
                return bad(format!(
                    "column \"{name}\": valid = [{low}, {high}] has no value in it; give the lower limit first"
                ));
            }
        }
        match (&self.time.column, self.time.step_s) {
            (None, Some(step)) if step > 0.0 => Ok(()),
            (Some(_), None) => self.time.form().map(drop),
            _ => bad("[time] has either a column, or step_s above zero".into()),
        }
    }

    /// Topics that the rates may be of, the likeliest first.
    #[must_use]
    pub fn topics(&self) -> Vec<&str> {
        self.table.topic.as_ref().map_or_else(Vec::new, Names::all)
    }

    /// The map for a file that may lack thermometers and accelerometers: without those.
    #[must_use]
    pub fn without_missing(&self, has: impl Fn(&Names) -> bool) -> Self {
        let mut map = self.clone();
        map.temperature.retain(|_, c| !c.may_be_missing || has(&c.column));
        map.optional.retain(|_, c| !c.may_be_missing || has(&c.column));
        map
    }

    /// All columns that the map wants, by the place where they stand in it, and those that a file must have.
    #[must_use]
    pub fn wanted(&self) -> Vec<(String, &Names, bool)> {
        let mut out: Vec<(String, &Names, bool)> = Vec::new();
        out.extend(self.time.column.as_ref().map(|c| ("[time]".to_string(), c, true)));
        out.extend(self.time.second_column.as_ref().map(|c| ("[time] second_column".to_string(), c, true)));
        let sections = [
            ("frequency", &self.frequency),
            ("temperature", &self.temperature),
            ("rate", &self.rate),
            ("optional", &self.optional),
        ];
        for (section, columns) in sections {
            out.extend(columns.iter().map(|(k, c)| (format!("[{section}] {k}"), &c.column, !c.may_be_missing)));
        }
        out
    }
}

/// Physical quantity of an optional column.
#[must_use]
pub fn quantity_of(name: &str) -> &'static str {
    match columns::find(name) {
        Some((column, _)) if column.unit == "C" => "temperature",
        Some((column, _)) if column.unit == "m/s^2" => "specific force",
        _ => "voltage",
    }
}
