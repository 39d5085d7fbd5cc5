//! Meaning of the `# key: value` lines of a recording, and checks that it can be used.
//!
//! A line that is there and cannot be used is an error, never ignored: corrected rates that are taken for raw ones, or the
//! earth's rate left in a constant, show nowhere else. Keys that this program does not know are kept and mean nothing.

use super::columns;
use super::plausible::AT_REST;
use crate::axes::AXIS_NAMES;
use crate::error::BadInput;
use hrg_core::AXES;

/// Earth rate, deg/h.
pub const EARTH_RATE_DPH: f64 = 15.041_067;

/// Keys with a meaning. Each may stand in a file once, or again with the same value.
pub const KEYS: [&str; 19] = [
    "hrg-recording",
    "unit",
    "run",
    "rate_unit",
    "rates",
    CALIBRATION,
    "power_on_s",
    "power_on_unix_s",
    "latitude_deg",
    "axes",
    "earth_rate",
    SCALE_FACTOR,
    "thermometer",
    TIME_STEP,
    TABLE_RATE,
    FORCES,
    AT_REST,
    STANDS_FOR,
    UNIT_INPUTS,
];

/// Key of the scale factor.
pub const SCALE_FACTOR: &str = "scale_factor_dph_per_code";

/// Key of the time between rows, for files whose time column is missing or false.
pub const TIME_STEP: &str = "time_step_s";

/// Key of the rate of a table that was the same in the whole recording; else it stands in columns.
pub const TABLE_RATE: &str = "table_rate_dph";
/// Checksum of the image that the unit had.
pub const CALIBRATION: &str = "calibration";
/// `raw`: that image has corrected no specific force.
pub const FORCES: &str = "forces";

/// Key of the quantity that stands in the place of the rates, where it is not that of a gyro.
pub const STANDS_FOR: &str = "rate_stands_for";

/// Key of the quantities beside the frequencies that the unit itself has.
pub const UNIT_INPUTS: &str = "unit_inputs";

/// Value of that key for a unit that has none.
pub const NO_INPUTS: &str = "none";

/// Degrees an hour in a radian a second.
pub const DPH_PER_RAD_S: f64 = 180.0 / std::f64::consts::PI * 3600.0;

/// Unit of rates.
pub const DEG_PER_H: &str = "deg/h";

/// A text about rates for a quantity of another unit: deg/h becomes that unit, and deg/sqrt(h) that unit times sqrt(h).
#[must_use]
pub fn in_unit(text: &str, unit: &str) -> String {
    if unit == DEG_PER_H {
        return text.to_string();
    }
    text.replace("deg/sqrt(h)", &format!("{unit} sqrt(h)")).replace(DEG_PER_H, unit)
}

/// Newest version of recordings that this program reads.
const VERSION: u32 = 2;

/// Why metadata cannot be used.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum MetadataError {
    /// A value that means nothing.
    #[error("metadata {key}: \"{value}\" is not {wanted}")]
    Value {
        /// Key.
        key: &'static str,
        /// Value in the file.
        value: String,
        /// Value that was expected.
        wanted: &'static str,
    },
    /// Two lines contradict each other.
    #[error("metadata {key}: line {first} and line {second} differ; remove one of them")]
    Twice {
        /// Key.
        key: &'static str,
        /// A line.
        first: usize,
        /// Another.
        second: usize,
    },
    /// A key without its colon.
    #[error("line {line}: metadata {key} is written with \"=\"; write \"# {key}: VALUE\"")]
    Equals {
        /// Line.
        line: usize,
        /// Key.
        key: &'static str,
    },
    /// One of two that need each other.
    #[error("metadata {there} is given without {missing}; only both tell how much of the earth's rate is in the rates: add {missing}, or remove {there}")]
    Alone {
        /// The one that is there.
        there: &'static str,
        /// The one that is not.
        missing: &'static str,
    },
    /// An item of `axes`.
    #[error("metadata axes: \"{item}\" {fault}; write for instance x=north y=east z=down")]
    Axes {
        /// Item in the file.
        item: String,
        /// Fault of the item.
        fault: &'static str,
    },
    /// Rates in another unit.
    #[error("rate_unit is {0}; convert the rates to deg/h and say so")]
    RateUnit(String),
    /// A newer file.
    #[error("metadata hrg-recording: the file is of version {0}, this program reads versions up to {VERSION}")]
    Version(String),
}

impl From<MetadataError> for BadInput {
    fn from(e: MetadataError) -> Self {
        Self(e.to_string())
    }
}

/// Value of `# rates` in a recording that holds, in the place of rates, the error of a scale factor, ppm.
pub const LACKING: &str = "scale-factor-lacks";

/// The lines of a file as they are read.
#[derive(Debug, Default)]
pub struct Lines {
    /// Keys and values in order.
    pub entries: Vec<(String, String)>,
    /// Known keys and where they stood first.
    seen: Vec<(&'static str, String, usize)>,
    /// A line that would be a header if it did not begin with #.
    pub commented_header: Option<usize>,
}

impl Lines {
    /// The value of a key, as far as it was read.
    #[must_use]
    pub fn get(&self, key: &str) -> Option<&str> {
        self.entries.iter().find(|(k, _)| k == key).map(|(_, v)| v.as_str())
    }

    /// Takes what follows the `#` of a line.
    ///
    /// # Errors
    /// A known key whose value differs from one before, or that has no colon.
    pub fn take(&mut self, line: usize, text: &str) -> Result<(), MetadataError> {
        let text = text.trim_start_matches(['#', ' ', '\t']);
        let Some(at) = text.find([':', '=']) else {
            if text.contains(columns::TIME.name(0)) {
                self.commented_header.get_or_insert(line);
            }
            return Ok(());
        };
        // Spreadsheets fill every line up to the width of the table.
        let (key, value) = (text[..at].trim(), text[at + 1..].trim_end_matches([',', ';', '\t', ' ']).trim());
        let known = known(key);
        let Some(known) = known else {
            if text.as_bytes()[at] == b':' {
                self.entries.push((key.to_string(), value.to_string()));
            }
            return Ok(());
        };
        if text.as_bytes()[at] == b'=' {
            return Err(MetadataError::Equals { line, key: known });
        }
        match self.seen.iter().find(|(k, _, _)| *k == known) {
            Some((_, before, _)) if before == value => {}
            Some((_, _, first)) => return Err(MetadataError::Twice { key: known, first: *first, second: line }),
            None => {
                self.seen.push((known, value.to_string(), line));
                self.entries.push((known.to_string(), value.to_string()));
            }
        }
        Ok(())
    }
}

/// The known key that a text stands for: capitals, blanks and hyphens do not matter.
fn known(key: &str) -> Option<&'static str> {
    let plain = |k: &str| k.to_ascii_lowercase().replace([' ', '-'], "_");
    let key = plain(key);
    KEYS.iter().copied().find(|k| plain(k) == key)
}

/// Looks at all that is known.
///
/// # Errors
/// The first that cannot be used.
pub fn check(entries: &[(String, String)]) -> Result<(), MetadataError> {
    let get = |key: &str| entries.iter().find(|(k, _)| k == key).map(|(_, v)| v.as_str());
    let one_of = |key: &'static str, allowed: &[&str], wanted: &'static str| match get(key) {
        Some(v) if !allowed.contains(&v) => Err(MetadataError::Value { key, value: v.into(), wanted }),
        _ => Ok(()),
    };
    if let Some(v) = get("hrg-recording") {
        if !v.parse().is_ok_and(|v: u32| (1..=VERSION).contains(&v)) {
            return Err(MetadataError::Version(v.into()));
        }
    }
    if let Some(unit) = get("rate_unit").filter(|u| *u != "deg/h") {
        return Err(MetadataError::RateUnit(unit.into()));
    }
    one_of("rates", &["raw", "corrected"], "raw or corrected, in small letters")?;
    one_of("earth_rate", &["removed"], "removed; leave the line out where the rates hold the earth's rate")?;
    one_of(AT_REST, &["yes"], "yes; leave the line out where the rates may tell")?;
    one_of(
        "thermometer",
        &["frequency", "sensor", "none"],
        "frequency (temperature from the resonators, f?_hz), sensor (temp_?_c, or temp_c) or none",
    )?;
    if let Some(v) = get(TIME_STEP) {
        let wanted = "a time between rows in seconds, above zero";
        if !(number(TIME_STEP, v, wanted)? > 0.0) {
            return Err(MetadataError::Value { key: TIME_STEP, value: v.into(), wanted });
        }
    }
    for key in ["power_on_s", "power_on_unix_s"] {
        if let Some(v) = get(key) {
            number(key, v, "a time in seconds")?;
        }
    }
    Attitude::of(get("latitude_deg"), get("axes"))?;
    get(TABLE_RATE).map_or(Ok(()), |v| table_rate(v).map(drop))?;
    get(SCALE_FACTOR).map_or(Ok(()), |v| scale_factor(v).map(drop))
}

/// A finite number.
fn number(key: &'static str, value: &str, wanted: &'static str) -> Result<f64, MetadataError> {
    let bad = || MetadataError::Value { key, value: value.into(), wanted };
    value.parse().ok().filter(|v: &f64| v.is_finite()).ok_or_else(bad)
}

/// Three scale factors, deg/h per code, separated by blanks or commas.
///
/// # Errors
/// Anything else; the magnitude of a scale factor lies between 1e-9 and 1e7.
pub fn scale_factor(text: &str) -> Result<[f32; AXES], MetadataError> {
    let bad = || MetadataError::Value {
        key: SCALE_FACTOR,
        value: text.into(),
        wanted: "three numbers of 1e-9 to 1e7, deg/h per code of x, y and z (negative: the sign of the channel)",
    };
    let possible = |v: &f32| (1e-9..=1e7).contains(&v.abs());
    let numbers: Vec<f32> = text
        .split([' ', ','])
        .filter(|s| !s.is_empty())
        .map(|s| s.parse().ok().filter(possible).ok_or_else(bad))
        .collect::<Result<_, _>>()?;
    numbers.try_into().map_err(|_| bad())
}

/// The rate of a table along x, y and z, deg/h, separated by blanks or commas.
///
/// # Errors
/// Anything but three finite numbers.
pub fn table_rate(text: &str) -> Result<[f64; AXES], MetadataError> {
    let wanted = "three numbers, deg/h along x, y and z";
    let parts = text.split([' ', ',']).filter(|s| !s.is_empty());
    let numbers: Vec<f64> = parts.map(|s| number(TABLE_RATE, s, wanted)).collect::<Result<_, _>>()?;
    numbers.try_into().map_err(|_| MetadataError::Value { key: TABLE_RATE, value: text.into(), wanted })
}

/// `true` if two scale factors are the same to a millionth: numbers typed with seven digits are.
#[must_use]
pub fn same_scale(a: &[f32; AXES], b: &[f32; AXES]) -> bool {
    a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 1e-6 * a.abs())
}

/// A scale factor as metadata and sentences carry it.
#[must_use]
pub fn scale_text(scale: &[f32; AXES]) -> String {
    let [x, y, z] = scale;
    format!("{x} {y} {z}")
}

/// Direction of an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Direction {
    /// Along the meridian, towards the north pole.
    North,
    /// Against it.
    South,
    /// Along the parallel.
    East,
    /// Against it.
    West,
    /// Against gravity.
    Up,
    /// Along gravity.
    Down,
}

impl Direction {
    const ALL: [(&'static str, Self); 6] = [
        ("north", Self::North),
        ("south", Self::South),
        ("east", Self::East),
        ("west", Self::West),
        ("up", Self::Up),
        ("down", Self::Down),
    ];

    fn name(self) -> &'static str {
        Self::ALL.iter().find(|(_, d)| *d == self).map_or("", |(n, _)| n)
    }
}

/// Attitude of a unit on the earth while it is recorded.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Attitude {
    /// Latitude, degrees, -90 to 90; north is positive.
    pub latitude_deg: f64,
    /// Direction of each axis; `None` for one that is not named.
    pub axes: [Option<Direction>; AXES],
}

impl Attitude {
    /// From both texts; `None` where neither is given.
    ///
    /// # Errors
    /// One without the other, and what cannot be read.
    pub fn of(latitude: Option<&str>, axes: Option<&str>) -> Result<Option<Self>, MetadataError> {
        match (latitude, axes) {
            (None, None) => Ok(None),
            (Some(_), None) => Err(MetadataError::Alone { there: "latitude_deg", missing: "axes" }),
            (None, Some(_)) => Err(MetadataError::Alone { there: "axes", missing: "latitude_deg" }),
            (Some(latitude), Some(axes)) => {
                let wanted = "a latitude in degrees, -90 to 90";
                let latitude_deg = number("latitude_deg", latitude, wanted)?;
                if latitude_deg.abs() > 90.0 {
                    return Err(MetadataError::Value { key: "latitude_deg", value: latitude.into(), wanted });
                }
                Ok(Some(Self { latitude_deg, axes: directions(axes)? }))
            }
        }
    }

    /// Refuses an attitude that does not name an axis.
    ///
    /// # Errors
    /// The axes that are not named.
    pub fn names(&self, mut axes: impl Iterator<Item = usize>) -> Result<(), MetadataError> {
        let item = || self.axes_text();
        match axes.find(|a| self.axes[*a].is_none()) {
            Some(a) => Err(MetadataError::Axes { item: item(), fault: NOT_NAMED[a] }),
            None => Ok(()),
        }
    }

    /// True where another attitude says the same of the latitude and of every axis that both name.
    #[must_use]
    pub fn agrees_with(&self, other: &Self) -> bool {
        let same = |(x, y): (&Option<Direction>, &Option<Direction>)| x.is_none() || y.is_none() || x == y;
        self.latitude_deg == other.latitude_deg && self.axes.iter().zip(&other.axes).all(same)
    }

    /// Components of the earth's rate along the axes, deg/h; 0 along one that is not named.
    #[must_use]
    pub fn earth_rate_dph(&self) -> [f64; AXES] {
        let (up, north) = self.latitude_deg.to_radians().sin_cos();
        self.axes.map(|d| {
            EARTH_RATE_DPH
                * match d {
                    Some(Direction::North) => north,
                    Some(Direction::South) => -north,
                    Some(Direction::Up) => up,
                    Some(Direction::Down) => -up,
                    Some(Direction::East | Direction::West) | None => 0.0,
                }
        })
    }

    /// The axes as metadata carry them.
    #[must_use]
    pub fn axes_text(&self) -> String {
        let named = AXIS_NAMES.iter().zip(self.axes).filter_map(|(n, d)| Some(format!("{n}={}", d?.name())));
        let items: Vec<String> = named.collect();
        items.join(" ")
    }
}

/// Why an attitude does not do for a recording that has the axis.
const NOT_NAMED: [&str; AXES] = [
    "does not name x, which the recording has",
    "does not name y, which the recording has",
    "does not name z, which the recording has",
];

/// True where the directions that are named lie along different lines.
fn apart(d: [Option<Direction>; AXES]) -> bool {
    let line = |d: Direction| match d {
        Direction::North | Direction::South => 0,
        Direction::East | Direction::West => 1,
        Direction::Up | Direction::Down => 2,
    };
    let lines: Vec<usize> = d.into_iter().flatten().map(line).collect();
    (1..lines.len()).all(|k| !lines[..k].contains(&lines[k]))
}

/// `x=north y=east z=down`, blanks or commas between; a unit of one axis names that one.
fn directions(text: &str) -> Result<[Option<Direction>; AXES], MetadataError> {
    let mut out = [None; AXES];
    for item in text.split([' ', ',']).filter(|s| !s.is_empty()) {
        let bad = |fault| MetadataError::Axes { item: item.into(), fault };
        let (axis, direction) = item.split_once('=').ok_or_else(|| bad("is not of the form x=north"))?;
        let a = AXIS_NAMES.iter().position(|n| *n == axis).ok_or_else(|| bad("names no axis: they are x, y and z"))?;
        let direction = Direction::ALL
            .iter()
            .find(|(n, _)| *n == direction)
            .ok_or_else(|| bad("names no direction: they are north, south, east, west, up and down"))?;
        if out[a].replace(direction.1).is_some() {
            return Err(bad("names an axis a second time"));
        }
    }
    let refused = |fault| Err(MetadataError::Axes { item: text.into(), fault });
    if out.iter().all(Option::is_none) {
        return refused("names no axis");
    }
    if !apart(out) {
        return refused("has two axes along one line: they stand at right angles");
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(lines: &[&str]) -> Result<Vec<(String, String)>, String> {
        let mut l = Lines::default();
        for (k, text) in lines.iter().enumerate() {
            l.take(k + 1, text).map_err(|e| e.to_string())?;
        }
        check(&l.entries).map_err(|e| e.to_string())?;
        Ok(l.entries)
    }

    #[test]
    fn what_cannot_be_used_is_refused_with_the_key() {
        for (lines, says) in [
            (&[" rates: Corrected"][..], "metadata rates: \"Corrected\""),
            (&[" rates="][..], "written with \"=\""),
            (&[" power_on_s: abc"][..], "metadata power_on_s: \"abc\""),
            (&[" power_on_s: inf"][..], "power_on_s"),
            (&[" axes: X=north y=east z=down", " latitude_deg: 28"][..], "\"X=north\" names no axis"),
            (&[" axes: x=north y=east z=below", " latitude_deg: 28"][..], "\"z=below\" names no direction"),
            (&[" axes: x=north y=south", " latitude_deg: 28"][..], "along one line"),
            (&[" axes: ,", " latitude_deg: 28"][..], "names no axis"),
            (&[" axes: x=north x=east z=down", " latitude_deg: 28"][..], "a second time"),
            (&[" axes: north east down", " latitude_deg: 28"][..], "of the form"),
            (&[" latitude_deg: 28.2"][..], "latitude_deg is given without axes"),
            (&[" axes: x=north y=east z=down"][..], "axes is given without latitude_deg"),
            (&[" latitude_deg: 91", " axes: x=north y=east z=down"][..], "-90 to 90"),
            (&[" latitude_deg: 28,2", " axes: x=north y=east z=down"][..], "\"28,2\""),
            (&[" unit: A", " unit: B"][..], "metadata unit: line 1 and line 2 differ"),
            (&[" scale_factor_dph_per_code: 1 2"][..], "three numbers"),
            (&[" scale_factor_dph_per_code: 1 0 1"][..], "three numbers"),
            (&[" scale_factor_dph_per_code: 1 1e-40 1"][..], "three numbers"),
            (&[" rate_unit: rad/s"][..], "convert the rates to deg/h"),
            (&[" hrg-recording: 3"][..], "version 3"),
            (&[" earth_rate: yes"][..], "earth_rate"),
            (&[" thermometer: fluid"][..], "thermometer"),
            (&[" time_step_s: 0"][..], "time_step_s"),
            (&[" time_step_s: fast"][..], "time_step_s"),
        ] {
            let e = read(lines).expect_err(says);
            assert!(e.contains(says), "{lines:?}: {e}");
        }
    }

    #[test]
    fn what_can_be_used_is_read_however_it_is_spelt() {
        let e = read(&[
            " Unit: HRG-7;;;;",
            " unit: HRG-7",
            " Power-on_s: 3",
            " note: a = b: c",
            "## rates: raw",
            " gap: no data from 1 to 2 s",
            " gap: no data from 3 to 4 s",
            " a comment",
            " Scale factor dph per code: 0.01, 0.02,-0.03",
        ])
        .expect("usable");
        let of = |k: &str| e.iter().find(|(n, _)| n == k).map(|(_, v)| v.as_str());
        assert_eq!((of("unit"), of("power_on_s"), of("rates")), (Some("HRG-7"), Some("3"), Some("raw")));
        assert_eq!(of(SCALE_FACTOR).map(scale_factor), Some(Ok([0.01, 0.02, -0.03])));
        assert_eq!(e.iter().filter(|(k, _)| k == "unit").count(), 1);
    }

    #[test]
    fn components_of_the_earth_rate() {
        let a = Attitude::of(Some("30"), Some("x=north y=up z=west")).expect("fine").expect("both");
        let [x, y, z] = a.earth_rate_dph();
        assert!((x - 13.0259).abs() < 1e-3 && (y - 7.5205).abs() < 1e-3 && z == 0.0, "{x} {y} {z}");
        assert_eq!(a.axes_text(), "x=north y=up z=west");
        let one = Attitude::of(Some("30"), Some("x=north")).expect("fine").expect("both");
        assert_eq!((one.earth_rate_dph(), one.axes_text().as_str()), ([x, 0.0, 0.0], "x=north"));
        assert!(a.agrees_with(&one) && one.agrees_with(&a) && one.names([0].into_iter()).is_ok());
        assert!(one.names(0..3).expect_err("two are missing").to_string().contains("does not name y"));
        let other = Attitude::of(Some("30"), Some("x=south")).expect("fine").expect("both");
        assert!(!a.agrees_with(&other));
    }
}
