//! The columns of a recording, each written once: readers, writers and the table in `docs/formats.md` are made from this list.

use super::thermometer::Thermometer;
use crate::axes::AXIS_NAMES;
use std::fmt::Write as _;

/// Purpose of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// Time of the rows.
    Time,
    /// Rates of the axes.
    Rate,
    /// Readings of a kind of thermometer.
    Reading(Thermometer),
    /// Kept where it is there.
    Optional,
    /// Flags of the unit.
    Status,
    /// Computed from the others by a unit or a program: for the reader's eyes.
    Computed,
}

/// Text format of its values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// A decimal number with as many digits as bring it back to the last bit.
    Exact,
    /// A decimal number with so many digits after the point in recordings that were read, imported or simulated; [`Self::Exact`] in
    /// those that a unit or its model made.
    Digits(usize),
    /// A whole number of 0 to 65535 whose bits have meanings.
    Bits,
}

/// A column, or three alike for the axes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Column {
    /// Its name, or those of x, y and z.
    pub names: &'static [&'static str],
    /// Unit of its values.
    pub unit: &'static str,
    /// Text format of its values.
    pub format: Format,
    /// Purpose.
    pub role: Role,
    /// Necessity in a recording, in words.
    pub needed: &'static str,
    /// Meaning of its values.
    pub meaning: &'static str,
}

/// The unit of a column whose values are in a unit that nobody has stated.
pub const AS_IT_COMES: &str = "as it comes";

/// The names of a column of each axis.
macro_rules! axes {
    ($before:literal, $after:literal) => {
        &[concat!($before, "x", $after), concat!($before, "y", $after), concat!($before, "z", $after)]
    };
}

/// The list: names, unit, format, role, whether needed, meaning.
macro_rules! columns {
    ($($column:ident: $names:expr, $unit:expr, $format:expr, $role:expr, $needed:literal, $meaning:literal;)+) => {
        $(
            #[doc = concat!("The ", $meaning, ".")]
            pub const $column: Column = Column {
                names: $names,
                unit: $unit,
                format: $format,
                role: $role,
                needed: $needed,
                meaning: $meaning,
            };
        )+

        /// All of them, in the order in which they stand in a file.
        pub const ALL: &[Column] = &[$($column),+];
    };
}

columns! {
    TIME: &["time_s"], "s", Format::Exact, Role::Time,
        "yes, or `# time_step_s`", "time at which the row ends";
    FREQUENCY: axes!("f", "_hz"), "Hz", Format::Digits(7), Role::Reading(Thermometer::Frequency),
        "for each axis that has a rate, or one of the next two lines", "frequency of the resonator";
    SENSOR: axes!("temp_", "_c"), "C", Format::Digits(5), Role::Reading(Thermometer::Sensors),
        "in the place of frequencies", "temperature by a sensor for each axis";
    ONE_SENSOR: &["temp_c"], "C", Format::Digits(5), Role::Reading(Thermometer::OneSensor),
        "in the place of frequencies", "temperature by one sensor for all axes";
    RATE: axes!("rate_", "_dph"), "deg/h", Format::Digits(5), Role::Rate,
        "one, two or three of them", "mean rate of the row, raw or corrected as `# rates` says";
    CASE: axes!("case_", "_c"), "C", Format::Digits(4), Role::Optional,
        "to calibrate temperature", "temperature by a sensor on the gyro's case (`shell_?_c` in files of version 1)";
    CHAMBER: &["chamber_c"], "C", Format::Digits(4), Role::Optional, "no", "temperature of the chamber";
    BOARD: &["board_c"], "C", Format::Digits(4), Role::Optional, "no", "temperature of the electronics";
    SUPPLY: &["supply_v"], "V", Format::Digits(4), Role::Optional, "no", "supply voltage";
    DRIVE: axes!("drive_", "_v"), "V", Format::Digits(4), Role::Optional,
        "no", "drive voltage of the amplitude control";
    QUADRATURE: axes!("quad_", "_v"), "V", Format::Digits(4), Role::Optional,
        "no", "voltage that nulls the quadrature";
    CHIP: &["chip_c"], "C", Format::Digits(4), Role::Optional, "no", "temperature of the unit's processor";
    CHIP_SUPPLY: &["chip_v"], "V", Format::Digits(4), Role::Optional, "no", "supply of the unit's processor";
    INPUT_1: &["input_1"], AS_IT_COMES, Format::Exact, Role::Optional, "no", "first input of the user's own";
    INPUT_2: &["input_2"], AS_IT_COMES, Format::Exact, Role::Optional, "no", "second input of the user's own";
    INPUT_3: &["input_3"], AS_IT_COMES, Format::Exact, Role::Optional, "no", "third input of the user's own";
    TABLE_RATE: axes!("table_rate_", "_dph"), "deg/h", Format::Digits(5), Role::Optional,
        "for `hrg fit --rates`, or `# table_rate_dph`", "rate at which a table turned the case, along its axes, beside the earth's rate";
    FORCE: axes!("force_", "_mps2"), "m/s^2", Format::Digits(7), Role::Optional,
        "for `hrg fit --accelerometers`", "mean specific force along the axes, as the accelerometers give it (from a unit: corrected by the image of `# calibration`)";
    TABLE_FORCE: axes!("table_force_", "_mps2"), "m/s^2", Format::Digits(7), Role::Optional,
        "for `hrg fit --accelerometers`", "specific force along the axes of the case in the position that it was held in: gravity, upwards";
    RAW: axes!("raw_", "_dph"), "deg/h", Format::Exact, Role::Computed,
        "no; beside corrected rates", "mean raw rate of the row";
    BIAS: axes!("bias_", "_dph"), "deg/h", Format::Exact, Role::Computed,
        "no; a unit's own", "bias that the unit computed at the end of the row";
    BIAS_STD: axes!("bias_std_", "_dph"), "deg/h", Format::Exact, Role::Computed,
        "no; a unit's own", "standard uncertainty of that bias; it holds the constant that changes with each power-on only where more than one run told it";
    TEMPERATURE: axes!("temperature_", "_c"), "C", Format::Exact, Role::Computed,
        "no; a unit's own", "temperature that the unit computed";
    STATUS: axes!("status_", ""), "bits", Format::Bits, Role::Status,
        "no; a unit's own", "status of the axis, bits as in `hrg-core/src/status.rs`";
    UNIT_STATUS: &["status_unit"], "bits", Format::Bits, Role::Status,
        "no; a unit's own", "status of the unit, bits as in `hrg-core/src/status.rs`";
}

impl Column {
    /// Its name for an axis.
    #[must_use]
    pub fn name(&self, a: usize) -> &'static str {
        self.names[if self.is_of_axes() { a } else { 0 }]
    }

    /// `true` if each axis has a column of its own.
    #[must_use]
    pub const fn is_of_axes(&self) -> bool {
        self.names.len() > 1
    }

    /// Pattern of its names for a sentence: `case_?_c`.
    #[must_use]
    pub fn pattern(&self) -> String {
        pattern(self.names)
    }

    /// The axes in whose columns it stands, of those that are there: all of them, or the first for a column that has no axis.
    #[must_use]
    pub fn of<'a>(&self, axes: &'a [usize]) -> &'a [usize] {
        if self.is_of_axes() {
            axes
        } else {
            &axes[..axes.len().min(1)]
        }
    }
}

fn pattern(names: &[&str]) -> String {
    match names {
        [one] => (*one).to_string(),
        // The names differ in the axis alone.
        [x, y, ..] => x.bytes().zip(y.bytes()).map(|(a, b)| if a == b { a as char } else { '?' }).collect(),
        [] => String::new(),
    }
}

/// The column of a name and its axis (0 where it has none). `shell_` is `case_` in recordings of version 1.
#[must_use]
pub fn find(name: &str) -> Option<(&'static Column, usize)> {
    let of = |name: &str| ALL.iter().find_map(|c| Some((c, c.names.iter().position(|n| *n == name)?)));
    of(name).or_else(|| of(&format!("case_{}", name.strip_prefix("shell_")?)))
}

/// The name that a column has today.
#[must_use]
pub fn today(name: &str) -> &str {
    find(name).map_or(name, |(c, a)| c.name(a))
}

/// Names of the columns that are kept where they are there.
pub fn optional() -> impl Iterator<Item = &'static str> {
    ALL.iter().filter(|c| c.role == Role::Optional).flat_map(|c| c.names).copied()
}

/// The same with commas, for a sentence.
#[must_use]
pub fn optional_names() -> String {
    optional().collect::<Vec<_>>().join(", ")
}

/// A value of a cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Value {
    /// A double.
    Double(f64),
    /// A single: written with no more digits than it has.
    Single(f32),
    /// Bits.
    Bits(u16),
}

impl From<f64> for Value {
    fn from(v: f64) -> Self {
        Self::Double(v)
    }
}

impl From<f32> for Value {
    fn from(v: f32) -> Self {
        Self::Single(v)
    }
}

impl From<u16> for Value {
    fn from(v: u16) -> Self {
        Self::Bits(v)
    }
}

/// A column of a file that is written row by row, and where its value for an axis comes from.
pub type Written<T> = (Column, fn(&T, usize) -> Value);

/// The header of such a file, behind the time.
#[must_use]
pub fn header<T>(written: &[Written<T>], axes: &[usize]) -> String {
    let mut s = TIME.names[0].to_string();
    for (column, _) in written {
        for a in column.of(axes) {
            let _ = write!(s, ",{}", column.name(*a));
        }
    }
    s
}

/// The cells of a row behind its time, each with its comma before it; what is not finite is an empty cell.
pub fn cells<T>(s: &mut String, written: &[Written<T>], axes: &[usize], row: &T) {
    for (column, value) in written {
        for a in column.of(axes) {
            let _ = match value(row, *a) {
                Value::Double(v) if v.is_finite() => write!(s, ",{v}"),
                Value::Single(v) if v.is_finite() => write!(s, ",{v}"),
                Value::Bits(v) => write!(s, ",{v}"),
                Value::Double(_) | Value::Single(_) => write!(s, ","),
            };
        }
    }
}

/// The table of the columns.
#[must_use]
pub fn table() -> String {
    let mut s = format!(
        "`?` is the axis: {}.\n\n| column | unit | values | needed | meaning |\n|---|---|---|---|---|\n",
        AXIS_NAMES.join(", ")
    );
    for c in ALL {
        let values = match c.format {
            Format::Bits => "0 to 65535",
            Format::Exact | Format::Digits(_) => "number",
        };
        let _ = writeln!(s, "| `{}` | {} | {values} | {} | {} |", c.pattern(), c.unit, c.needed, c.meaning);
    }
    s
}

impl Thermometer {
    /// The column of an axis' readings.
    #[must_use]
    pub fn column(self, a: usize) -> &'static str {
        self.columns().map_or("", |c| c.name(a))
    }

    /// The columns of the readings.
    #[must_use]
    pub fn columns(self) -> Option<&'static Column> {
        ALL.iter().find(|c| c.role == Role::Reading(self))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn each_name_means_one_column() {
        let names: Vec<&str> = ALL.iter().flat_map(|c| c.names).copied().collect();
        assert_eq!(names.iter().collect::<BTreeSet<_>>().len(), names.len(), "a name that is there twice");
        for c in ALL {
            assert!(matches!(c.names.len(), 1 | 3));
            for (a, name) in c.names.iter().enumerate() {
                assert_eq!(find(name), Some((c, a)));
            }
        }
        assert_eq!(
            (find("shell_y_c"), today("shell_y_c"), CASE.pattern().as_str()),
            (Some((&CASE, 1)), "case_y_c", "case_?_c")
        );
        assert_eq!((find("bias_x"), today("mass_kg")), (None, "mass_kg"));
    }

    #[test]
    fn rows_have_a_cell_for_each_name_of_the_header() {
        let written: [Written<[f64; 3]>; 3] =
            [(RATE, |r, a| r[a].into()), (BIAS, |r, a| (r[a] as f32).into()), (UNIT_STATUS, |_, _| 9u16.into())];
        for axes in [&[0, 1, 2][..], &[2]] {
            let mut row = String::from("1");
            cells(&mut row, &written, axes, &[0.1, f64::NAN, 0.7]);
            assert_eq!(header(&written, axes).split(',').count(), row.split(',').count());
        }
        let mut row = String::from("1");
        cells(&mut row, &written, &[0, 1], &[0.1, f64::NAN, 0.7]);
        assert_eq!(header(&written, &[0, 1]), "time_s,rate_x_dph,rate_y_dph,bias_x_dph,bias_y_dph,status_unit");
        assert_eq!(row, "1,0.1,,0.1,,9");
    }
}
