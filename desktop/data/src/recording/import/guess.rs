//! A map guessed from a table: which line is the header, which column is what, in which unit. A guess is shown before it is used, and what it
//! rests on stands beside each column.

use super::decode::{decode, has_wide_characters};
use super::delimited::lines;
use super::excel;
use super::map::Layout;
use crate::axes::AXIS_NAMES;
use crate::error::BadInput;
use crate::numeric::stats::median;
use crate::recording::columns;
use crate::recording::dialect::{is_missing, number};
use crate::recording::thermometer::Thermometer;
use crate::recording::time_form::TimeForm;
use crate::recording::Recording;
use std::borrow::Cow;
use std::fmt::Write as _;
use std::path::Path;

/// Rows of data that a guess looks at.
const ROWS: usize = 2000;
/// Bytes of a file from which a map is guessed where it is too large to be read as a whole.
const BEGINNING: u64 = 4 << 20;
/// Ground of a guess where a column names no unit.
const UNNAMED: &str = "no unit is named";
/// Ground for leaving a thermometer out.
const ANOTHER_THERMOMETER: &str = "another thermometer is used";
/// Lines among which the header is sought.
const BEFORE: usize = 100;

/// Meaning of a column.
#[derive(Debug, Clone, PartialEq)]
pub enum Meaning {
    /// Times, in this form.
    Time(String),
    /// A date, whose time of day stands in another column.
    Date(String),
    /// A time of day beside a date, in this form.
    TimeOfDay(String),
    /// Rate of an axis, in this unit.
    Rate(usize, &'static str),
    /// Resonator of an axis, in this unit.
    Frequency(usize, &'static str),
    /// Thermometer of an axis (all: `None`), in this unit.
    Temperature(Option<usize>, &'static str),
    /// Another column of a recording, by its names there, in this unit.
    Other(Vec<&'static str>, &'static str),
    /// Number of the IMU that a row is of; the first that stands there.
    Imu(u8),
    /// Not known.
    Unknown,
}

impl Meaning {
    /// Unit of its values, where they are a quantity.
    #[must_use]
    pub fn unit(&self) -> Option<&'static str> {
        match self {
            Self::Rate(_, unit) | Self::Frequency(_, unit) | Self::Temperature(_, unit) | Self::Other(_, unit) => {
                Some(unit)
            }
            _ => None,
        }
    }
}

/// A column with its meaning.
#[derive(Debug, Clone)]
pub struct Column {
    /// Name in the header.
    pub name: String,
    /// The same with the unit that stands below it, where one does.
    pub with_unit: String,
    /// First value that is there.
    pub sample: String,
    /// Meaning.
    pub meaning: Meaning,
    /// Ground on which it is guessed, where it is not the name with its unit.
    pub because: Option<String>,
}

/// A guess at a table.
#[derive(Debug, Clone)]
pub struct Guess {
    /// Its columns, in order.
    pub columns: Vec<Column>,
    /// Lines before the header.
    pub skip_lines: usize,
    /// `true` if a line names the columns.
    pub header: bool,
    /// Rows between the header and the data: one of units.
    pub drop_rows: usize,
}

/// The text of a table: that of a file in its encoding, or the first sheet of a spreadsheet with tabs between the cells. The encoding where
/// it was guessed.
///
/// # Errors
/// A file that cannot be read, or is no text.
pub fn text_of(path: &Path) -> Result<(String, Option<String>), BadInput> {
    let read =
        || crate::files::read_file(path, crate::files::MOST_RECORDING, false).map_err(|e| BadInput(e.to_string()));
    if excel::is_named_so(path) {
        let rows: Vec<String> = excel::rows(read()?, None)?.iter().map(|r| r.join("\t")).collect();
        return Ok((rows.join("\n"), None));
    }
    let bytes = read()?;
    let (text, note) = decode(&bytes, None)?;
    Ok((text.into_owned(), note))
}

/// The beginning of a file of text: enough of it to guess a map.
///
/// # Errors
/// A file that cannot be read, or is no text.
pub fn beginning_of(path: &Path) -> Result<String, BadInput> {
    use std::io::Read;
    let cannot = |e: std::io::Error| BadInput(format!("cannot read {}: {e}", path.display()));
    let mut bytes = Vec::new();
    let text = crate::files::text(path, crate::files::MOST_RECORDING)?;
    text.take(BEGINNING).read_to_end(&mut bytes).map_err(cannot)?;
    // (The last line is cut off.)
    if !has_wide_characters(&bytes, None)? {
        bytes.truncate(memchr::memrchr(b'\n', &bytes).map_or(bytes.len(), |at| at + 1));
    }
    Ok(decode(&bytes, None)?.0.into_owned())
}

/// The beginning of a table as cells, from a line on.
fn beginning(text: &str, skip_lines: usize) -> Result<Vec<Vec<String>>, BadInput> {
    let layout = Layout { skip_lines, ..Layout::default() };
    let rows = lines(text, &layout)?.take(ROWS + 1);
    let rows: Result<Vec<Vec<String>>, BadInput> =
        rows.map(|r| r.map(|(_, cells)| cells.into_iter().map(Cow::into_owned).collect())).collect();
    let mut rows = rows?;
    // (Trailing separators make empty cells, in some files in the rows alone.)
    let width = rows.first().map_or(0, |r| r.iter().rposition(|c| !c.is_empty()).map_or(0, |k| k + 1));
    for row in &mut rows {
        while row.len() > width && row.last().is_some_and(String::is_empty) {
            row.pop();
        }
    }
    Ok(rows)
}

/// Guesses a map for the text of a table ([`text_of`]).
///
/// # Errors
/// A text that is no table.
pub fn guess(text: &str) -> Result<Guess, BadInput> {
    // (The separator is that of the line that would be the header.)
    let from = |skip: usize| {
        let rows = beginning(text, skip).ok()?;
        is_table(&rows).map(|head| (skip, head, rows))
    };
    let (skip_lines, head, rows) = (0..BEFORE).find_map(from).ok_or_else(|| {
        BadInput::new(
            "no table is found in it: a line that names the columns, and rows of numbers below it with as many cells",
        )
    })?;
    let width = rows[0].len();
    let header = head != Head::None;
    let names: Vec<String> = if header { rows[0].clone() } else { (1..=width).map(|k| k.to_string()).collect() };
    let data: Vec<&Vec<String>> = rows.iter().skip(head.rows()).take(ROWS).collect();
    let with_unit = |k: usize| match &rows[1][k] {
        unit if head == Head::NamesAndUnits && !unit.is_empty() => {
            format!("{} [{}]", names[k], unit.trim_matches(['[', ']', '(', ')', ' ']))
        }
        _ => names[k].clone(),
    };
    let cells = |k: usize| -> Vec<&str> {
        let all = data.iter().filter_map(|r| r.get(k).map(String::as_str));
        all.filter(|c| !is_missing(c)).collect()
    };
    let mut columns: Vec<Column> = (0..width).map(|k| column(&with_unit(k), &cells(k))).collect();
    columns.iter_mut().zip(&names).for_each(|(c, name)| c.name.clone_from(name));
    settle_single_axis(&mut columns);
    settle_rates(&mut columns, &cells);
    settle_times(&mut columns, &cells);
    settle_thermometers(&mut columns);
    settle_imus(&mut columns, &cells);
    Ok(Guess { columns, skip_lines, header, drop_rows: head.rows().saturating_sub(1) })
}

/// A column of small whole numbers by the name of an IMU, of which there are several, parts the rows.
fn settle_imus<'c>(columns: &mut [Column], cells: &dyn Fn(usize) -> Vec<&'c str>) {
    const NAMES: [&str; 8] = ["i", "imu", "imunumber", "imuid", "instance", "sensorid", "sensornumber", "gyronumber"];
    for k in 0..columns.len() {
        let whole: String = columns[k].name.to_lowercase().chars().filter(|c| c.is_alphanumeric()).collect();
        if columns[k].meaning != Meaning::Unknown || !NAMES.contains(&whole.as_str()) {
            continue;
        }
        let number = |c: &str| number(c).filter(|v| v.fract() == 0.0 && (0.0..8.0).contains(v)).map(|v| v as u8);
        let numbers: Option<Vec<u8>> = cells(k).into_iter().map(number).collect();
        if let Some(first) =
            numbers.as_deref().and_then(|n| n.iter().min().filter(|least| n.iter().any(|v| v != *least)))
        {
            columns[k].meaning = Meaning::Imu(*first);
            return;
        }
    }
}

/// The head of a table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Head {
    /// The first row is of data already.
    None,
    /// A row of names.
    Names,
    /// A row of names, and one of units below it.
    NamesAndUnits,
}

impl Head {
    fn rows(self) -> usize {
        match self {
            Self::None => 0,
            Self::Names => 1,
            Self::NamesAndUnits => 2,
        }
    }
}

/// `true` if a cell names a unit.
fn names_a_unit(cell: &str) -> bool {
    let unit = parted(&format!("[{}]", cell.trim_matches(['[', ']', '(', ')', ' ']))).1.unwrap_or_default();
    ["rate", "temperature", "frequency", "time", "voltage"].iter().any(|q| unit_of(q, &unit).is_some())
}

/// The head of rows that are a table.
fn is_table(rows: &[Vec<String>]) -> Option<Head> {
    let [first, second, rest @ ..] = rows else { return None };
    // (Instruments whose units are not known here stand among the others.)
    let units = second.iter().filter(|c| names_a_unit(c)).count();
    let no_number = second.iter().all(|c| number(c).is_none());
    if units >= 2 && no_number && first.len() == second.len() && !first.iter().any(|c| names_a_unit(c)) {
        let without: Vec<Vec<String>> = std::iter::once(first).chain(rest.iter().take(3)).cloned().collect();
        if is_table(&without) == Some(Head::Names) {
            return Some(Head::NamesAndUnits);
        }
    }
    let is_value =
        |c: &&String| number(c).is_some() || TimeForm::guess(&[c]).is_some() || TimeForm::guess_date(&[c]).is_some();
    let values = |r: &Vec<String>| r.iter().filter(|c| is_value(c) || is_missing(c)).count();
    let same = first.len() >= 2 && second.len() == first.len() && rest.first().is_none_or(|r| r.len() == first.len());
    let of_data = values(second) > 0 && 2 * values(second) + 2 >= second.len();
    // (An index has no name in some tables.)
    match (same && of_data, first.iter().filter(is_value).count()) {
        (true, 0) => Some(Head::Names),
        (true, n) if n >= second.iter().filter(is_value).count() => Some(Head::None),
        _ => None,
    }
}

/// A name without its unit, in small letters and digits, and the unit.
fn parted(name: &str) -> (String, Option<String>) {
    let plain = |s: &str| s.to_lowercase().replace(['°', 'º'], "deg").replace(' ', "");
    let stem = |s: &str| plain(&s.trim().replace(' ', "_"));
    for (open, close) in [('[', ']'), ('(', ')')] {
        if let Some((before, rest)) = name.split_once(open) {
            if let Some((unit, after)) = rest.split_once(close) {
                return (stem(&format!("{before}{after}")), Some(plain(unit)));
            }
        }
    }
    let lower = stem(name);
    // (Two words first: the s of deg_s is no second.)
    let places = ["_deg_", "_rad_", "_mrad_", "_", "/"].map(|mark| lower.rfind(mark));
    for at in places.into_iter().flatten() {
        let unit = lower[at + 1..].replace('_', "/");
        // (gyro_x_f is a filtered rate, and x_h no time; T_K is a temperature.)
        let of_temperature = ["t", "temp", "temperature"].contains(&&lower[..at]);
        let letter = ["f", "k", "h"].contains(&unit.as_str()) && !(of_temperature && unit != "h");
        if !letter
            && ["rate", "temperature", "frequency", "time", "voltage"].iter().any(|q| unit_of(q, &unit).is_some())
        {
            return (lower[..at].to_string(), Some(unit));
        }
    }
    (lower, None)
}

/// A unit as maps name it.
fn unit_of(quantity: &str, written: &str) -> Option<&'static str> {
    let known: &[(&'static str, &[&str])] = match quantity {
        "rate" => &[
            ("deg/h", &["deg/h", "deg/hr", "deg/hour", "degh", "dph", "degperhour"]),
            ("deg/s", &["deg/s", "deg/sec", "degs", "dps", "degpersecond", "degreespersecond", "degs-1", "grad/s"]),
            ("mrad/s", &["mrad/s", "mrads", "mrad/sec"]),
            ("mdeg/s", &["mdeg/s", "mdegs", "mdps"]),
            ("urad/s", &["urad/s", "µrad/s", "μrad/s", "urads"]),
            ("arcsec/s", &["arcsec/s", "as/s"]),
            ("deg/min", &["deg/min", "degpermin", "degperminute"]),
            ("rad/s", &["rad/s", "rads", "rad/sec"]),
            ("ppb", &["ppb"]),
            ("ppm", &["ppm"]),
        ],
        "temperature" => &[
            ("C", &["c", "degc", "celsius"]),
            ("K", &["k", "kelvin"]),
            ("mC", &["mc", "mdegc"]),
            ("F", &["f", "degf", "fahrenheit"]),
        ],
        "frequency" => &[("Hz", &["hz"]), ("kHz", &["khz"]), ("MHz", &["mhz"])],
        "voltage" => &[("V", &["v", "volt", "volts"]), ("mV", &["mv"])],
        _ => &[
            ("s", &["s", "sec", "secs", "seconds", "second"]),
            ("ms", &["ms", "msec", "milliseconds"]),
            ("us", &["us", "µs", "usec", "microseconds"]),
            ("ns", &["ns", "nanoseconds"]),
            ("min", &["min", "minutes"]),
            ("h", &["h", "hours"]),
        ],
    };
    known.iter().find(|(_, all)| all.contains(&written)).map(|(unit, _)| *unit)
}

/// The axis that a stem names, and the stem without it.
fn axis_of(stem: &str) -> (Option<usize>, String) {
    let words: Vec<&str> = stem.split(|c: char| !c.is_alphanumeric()).filter(|w| !w.is_empty()).collect();
    let axis = |w: &str| AXIS_NAMES.iter().position(|n| *n == w);
    if let Some(at) = words.iter().position(|w| axis(w).is_some()) {
        let rest: Vec<&str> = words.iter().enumerate().filter(|(k, _)| *k != at).map(|(_, w)| *w).collect();
        return (axis(words[at]), rest.concat());
    }
    let whole = words.concat();
    let last = whole.chars().last().map(String::from).unwrap_or_default();
    let first = whole.chars().next().map(String::from).unwrap_or_default();
    // (A body has no axis y, and a box no x.)
    let known = |rest: &str| is_any(rest, &RATES) || is_any(rest, &["f", "freq", "t", "temp", "temperature", "case"]);
    let (before, after) = (whole.strip_suffix(&last).unwrap_or(""), whole.strip_prefix(&first).unwrap_or(""));
    match (axis(&last), axis(&first)) {
        (Some(a), _) if known(before) => (Some(a), before.to_string()),
        (_, Some(a)) if known(after) => (Some(a), after.to_string()),
        _ => (None, whole),
    }
}

fn is_any(stem: &str, words: &[&str]) -> bool {
    words.contains(&stem)
}

fn holds_any(stem: &str, words: &[&str]) -> bool {
    words.iter().any(|w| stem.contains(w))
}

const RATES: [&str; 13] = [
    "gyr",
    "gyro",
    "rate",
    "omega",
    "angularrate",
    "angularvelocity",
    "angvel",
    "drehrate",
    "kreisel",
    "gyrorate",
    "w",
    "g",
    "gyroscope",
];
const TEMPERATURES: [&str; 6] = ["temp", "pt100", "pt1000", "ntc", "thermo", "sensort"];
const NOT_MEASURED: [&str; 14] = [
    "soll", "setpoint", "target", "table", "ref", "std", "sigma", "sample", "max", "dew", "taupunkt", "junction",
    "cjc", "humid",
];
/// The same as words of their own.
const NOT_MEASURED_WORDS: [&str; 4] = ["set", "sp", "cmd", "sv"];
/// Words by which a thermometer is the gyro's, and others by which it is not.
const OF_GYRO: [&str; 7] = ["gyr", "imu", "dut", "kreisel", "pt100", "pt1000", "unit"];
const OF_OTHERS: [&str; 6] = ["acc", "mag", "baro", "cpu", "mcu", "press"];
const TIMES: [&str; 19] = [
    "time",
    "timeus",
    "times",
    "temps",
    "tiempo",
    "tempo",
    "t",
    "zeit",
    "timestamp",
    "zeitstempel",
    "seconds",
    "sec",
    "epoch",
    "elapsed",
    "date",
    "datum",
    "datetime",
    "uhrzeit",
    "utc",
];

/// A column by its name, its unit and its values.
fn column(name: &str, cells: &[&str]) -> Column {
    let (stem, unit) = parted(name);
    let (axis, bare) = axis_of(&stem);
    let values: Vec<f64> = cells.iter().filter_map(|c| number(c)).collect();
    let unit_in = |quantity: &str| unit.as_deref().and_then(|u| unit_of(quantity, u));
    let whole: String = stem.chars().filter(|c| c.is_alphanumeric()).collect();
    // (Some columns of times are named by their unit alone.)
    // (And one that rises in a unit of time is one, whatever its name.)
    let rises = values.len() > 2 && values.windows(2).all(|w| w[1] >= w[0]) && values[values.len() - 1] > values[0];
    let is_time = is_any(&whole, &TIMES)
        || whole.len() > 1 && unit_of("time", &whole).is_some()
        || rises && unit_in("time").is_some();
    let (mut because, mut meaning) = (None, Meaning::Unknown);
    let mut by_size = |found: (&'static str, &str)| {
        because = Some(format!("{UNNAMED}: {}", found.1));
        found.0
    };
    let as_it_is = columns::optional().find(|o| *o == name);
    let hot = holds_any(&whole, &TEMPERATURES) && unit_in("time").is_none()
        || unit_in("temperature").is_some() && unit_in("rate").is_none();
    if let Some(own) = as_it_is {
        meaning = Meaning::Other(vec![own], if own.ends_with("_v") { "V" } else { "C" });
    } else if values.is_empty() || is_time && (rises || whole.len() > 1 || unit_in("time").is_some()) && !hot {
        if is_time || TimeForm::guess(cells).is_some() || TimeForm::guess_date(cells).is_some() {
            meaning = Meaning::Time(String::new());
        }
    } else if let (Some(a), Some(rate)) = (axis, unit_in("rate")) {
        if !holds_any(&bare, &["acc", "mag", "bias", "raw"]) {
            meaning = Meaning::Rate(a, rate);
        }
    } else if let (Some(a), true) = (axis, unit.is_none() && is_any(&bare, &RATES)) {
        meaning = Meaning::Rate(a, by_size(size_of_rate(&values)));
    } else if let (Some(a), Some(hz)) = (axis, unit_in("frequency")) {
        meaning = Meaning::Frequency(a, hz);
    } else if let (Some(a), true) = (axis, holds_any(&bare, &["freq", "reson"]) || bare == "f") {
        meaning = Meaning::Frequency(a, by_size(("Hz", "taken for Hz")));
    } else if hot || is_any(&whole, &["t", "tx", "ty", "tz"]) {
        let c = unit_in("temperature").unwrap_or_else(|| by_size(size_of_temperature(&values)));
        meaning = match axis {
            _ if holds_any(&whole, &["chamber", "kammer", "oven", "ofen", "ambient", "umgebung", "air"]) => {
                Meaning::Other(columns::CHAMBER.names.to_vec(), c)
            }
            _ if holds_any(&whole, &[columns::BOARD.names[0].trim_end_matches("_c"), "pcb", "elektronik"]) => {
                Meaning::Other(columns::BOARD.names.to_vec(), c)
            }
            a if holds_any(&whole, &["case", "shell", "housing", "geh"]) => of_case(a, c),
            a => Meaning::Temperature(a, c),
        };
    }
    // A unit that is named and not known decides nothing, and what was wanted is not what was measured.
    if let (Some(u), true) = (&unit, because.is_some()) {
        (meaning, because) = (Meaning::Unknown, Some(format!("the unit {u} is not known here")));
    }
    let words: Vec<&str> = stem.split(|c: char| !c.is_alphanumeric()).collect();
    let wanted = NOT_MEASURED_WORDS.iter().find(|w| words.contains(*w));
    if let Some(word) =
        wanted.or_else(|| NOT_MEASURED.iter().find(|w| holds_any(&whole, &[w]))).filter(|_| as_it_is.is_none())
    {
        if !matches!(meaning, Meaning::Time(_)) {
            (meaning, because) = (Meaning::Unknown, Some(format!("{word} is no measured value of the gyro")));
        }
    }
    let sample = cells.first().copied().unwrap_or_default().to_string();
    Column { name: name.to_string(), with_unit: name.to_string(), sample, meaning, because }
}

/// A sensor on the case of an axis (all: `None`).
fn of_case(axis: Option<usize>, unit: &'static str) -> Meaning {
    Meaning::Other(axis.map_or(columns::CASE.names.to_vec(), |a| vec![columns::CASE.name(a)]), unit)
}

/// The likeliest unit of a rate at rest: the earth turns by 15 deg/h, and a gyro's bias is not a thousand times that.
fn size_of_rate(values: &[f64]) -> (&'static str, &'static str) {
    let mut sizes: Vec<f64> = values.iter().map(|v| v.abs()).collect();
    match median(&mut sizes).unwrap_or(0.0) {
        s if s < 2e-3 => ("rad/s", "by its size, rad/s"),
        s if s < 0.5 => ("deg/s", "by its size, deg/s"),
        _ => ("deg/h", "by its size, deg/h"),
    }
}

fn size_of_temperature(values: &[f64]) -> (&'static str, &'static str) {
    let mut all = values.to_vec();
    match median(&mut all).unwrap_or(0.0) {
        t if (180.0..430.0).contains(&t) => ("K", "by its size, K"),
        t if t.abs() > 1000.0 => ("mC", "by its size, thousandths of a degree"),
        _ => ("C", "taken for C"),
    }
}

/// A gyro of one axis names none: the only column with the unit of a rate is x.
fn settle_single_axis(columns: &mut [Column]) {
    let rate_of = |c: &Column| {
        let (stem, unit) = parted(&c.with_unit);
        let unit = unit.as_deref().and_then(|u| unit_of("rate", u)).filter(|_| c.meaning == Meaning::Unknown);
        unit.filter(|_| c.because.is_none() && holds_any(&stem, &["rate", "gyr", "omega", "kreisel", "angvel"]))
    };
    if columns.iter().any(|c| matches!(c.meaning, Meaning::Rate(..))) {
        return;
    }
    let of_unit: Vec<(usize, &'static str)> =
        columns.iter().enumerate().filter_map(|(k, c)| Some((k, rate_of(c)?))).collect();
    if let [(k, unit)] = of_unit[..] {
        columns[k].meaning = Meaning::Rate(0, unit);
        columns[k].because = None;
    }
}

/// Rates without a unit have one in common, by the size of all; what is gravity's size is no rate; of two for an axis, the first with a unit
/// counts.
fn settle_rates<'c>(columns: &mut [Column], cells: &dyn Fn(usize) -> Vec<&'c str>) {
    let unnamed: Vec<usize> = (0..columns.len())
        .filter(|k| matches!(columns[*k].meaning, Meaning::Rate(..)) && columns[*k].because.is_some())
        .collect();
    let values = |k: &usize| cells(*k).into_iter().filter_map(number).collect::<Vec<f64>>();
    let all: Vec<Vec<f64>> = unnamed.iter().map(values).collect();
    let rows = all.iter().map(Vec::len).min().unwrap_or(0);
    let mut sizes: Vec<f64> = (0..rows).map(|r| all.iter().map(|v| v[r] * v[r]).sum::<f64>().sqrt()).collect();
    let size = median(&mut sizes).unwrap_or(0.0);
    let gravity = unnamed.len() > 1 && ((9.5..10.1).contains(&size) || (0.97..1.03).contains(&size));
    let (unit, because) = size_of_rate(&all.concat());
    for k in unnamed {
        let c = &mut columns[k];
        if let (Meaning::Rate(a, _), false) = (&c.meaning, gravity) {
            c.because = Some(format!("{UNNAMED}: {because}"));
            c.meaning = Meaning::Rate(*a, unit);
        } else {
            c.meaning = Meaning::Unknown;
            c.because = Some("its size is that of gravity".into());
        }
    }
    for a in 0..AXIS_NAMES.len() {
        let is = |c: &Column| matches!(c.meaning, Meaning::Rate(of, _) if of == a);
        let with_unit = columns.iter().position(|c| is(c) && c.because.is_none());
        let chosen = with_unit.or_else(|| columns.iter().position(is));
        for (k, c) in columns.iter_mut().enumerate() {
            if is(c) && Some(k) != chosen {
                c.meaning = Meaning::Unknown;
                c.because = Some("another column is taken for this axis".into());
            }
        }
    }
}

/// Forms of the columns of times; of several the first counts, or a date with its time of day.
fn settle_times<'c>(columns: &mut [Column], cells: &dyn Fn(usize) -> Vec<&'c str>) {
    // Values that increase from row to row come first: t beside T.
    let increases = |k: &usize| {
        let v: Vec<f64> = cells(*k).into_iter().filter_map(number).collect();
        v.len() > 1 && v.windows(2).all(|w| w[1] > w[0])
    };
    let mut candidates: Vec<usize> =
        (0..columns.len()).filter(|k| matches!(columns[*k].meaning, Meaning::Time(_))).collect();
    candidates.sort_by_key(|k| !increases(k));
    for k in &candidates {
        // (A T beside another column of times is a temperature.)
        let may_be = if columns[*k].name == "T" { Meaning::Temperature(None, "C") } else { Meaning::Unknown };
        columns[*k].meaning = may_be;
    }
    let date = candidates.iter().find_map(|k| Some((*k, TimeForm::guess_date(&few(&cells(*k)))?)));
    let of_day = |k: &usize| {
        let (form, _) = TimeForm::guess(&few(&cells(*k)))?;
        TimeForm::parse(&form).filter(TimeForm::of_a_day).map(|_| form)
    };
    if let Some((date, pattern)) = date {
        if let Some((time, form)) = candidates.iter().filter(|k| **k != date).find_map(|k| Some((*k, of_day(k)?))) {
            // (Seconds with a fraction are read by one form where they stand alone, and by another beside a date.)
            let both: Vec<String> = cells(date).iter().zip(cells(time)).map(|(d, t)| format!("{d} {t}")).collect();
            let beside = TimeForm::guess(&few(&both.iter().map(String::as_str).collect::<Vec<_>>()));
            let beside = beside.and_then(|(f, _)| Some(f.strip_prefix(pattern)?.strip_prefix(' ')?.to_string()));
            columns[date].meaning = Meaning::Date(pattern.to_string());
            columns[time].meaning = Meaning::TimeOfDay(beside.unwrap_or(form));
            return;
        }
    }
    for k in candidates {
        let texts = cells(k);
        if let Some((form, changed)) = TimeForm::guess(&few(&texts)) {
            columns[k].because = match form.as_str() {
                "%H:%M" => Some("hours and minutes; if minutes and seconds, its form is %M:%S".to_string()),
                _ => changed.then(|| "day and month could be changed about".to_string()),
            };
            columns[k].meaning = Meaning::Time(form);
            return;
        }
        let values: Vec<f64> = texts.iter().filter_map(|c| number(c)).collect();
        if values.len() == texts.len() && !values.is_empty() {
            let (_, unit) = parted(&columns[k].with_unit);
            let name = columns[k].name.to_lowercase();
            let named = unit_of("time", unit.as_deref().unwrap_or(name.strip_prefix("time").unwrap_or(&name)));
            let clock = texts.iter().all(|t| t.len() == 6 && t.bytes().all(|b| b.is_ascii_digit()));
            let days =
                (3e4..8e4).contains(&values[0]) && values[values.len() - 1] - values[0] < 0.01 * values.len() as f64;
            if let (Some(u), None) = (&unit, named) {
                columns[k].because = Some(format!("the unit {u} is not known here"));
                continue;
            }
            if named.is_none() && (clock || days) {
                let what =
                    if clock { "hours, minutes and seconds in six digits" } else { "days, as Excel counts them" };
                columns[k].because = Some(format!("looks like {what}"));
                continue;
            }
            let by_size = match values[0] {
                t if t > 1e17 => ("ns", "by its size, ns since 1970"),
                t if t > 1e14 => ("us", "by its size, us since 1970"),
                t if t > 1e11 => ("ms", "by its size, ms since 1970"),
                _ => ("s", "taken for s"),
            };
            columns[k].because = named.is_none().then(|| format!("{UNNAMED}: {}", by_size.1));
            columns[k].meaning = Meaning::Time(named.unwrap_or(by_size.0).to_string());
            return;
        }
    }
}

/// The first, some, and the last of some texts: all of them decide between forms.
fn few<'c>(cells: &[&'c str]) -> Vec<&'c str> {
    let step = (cells.len() / 50).max(1);
    cells.iter().copied().step_by(step).chain(cells.last().copied()).collect()
}

/// With resonators, a sensor is the case's; of several sensors for all axes the first counts.
fn settle_thermometers(columns: &mut [Column]) {
    let resonators = columns.iter().any(|c| matches!(c.meaning, Meaning::Frequency(..)));
    let each = columns.iter().any(|c| matches!(c.meaning, Meaning::Temperature(Some(_), _)));
    // (Of several for all axes the one counts whose name is the gyro's, and not that of another part.)
    let rank = |c: &Column| {
        let name = c.name.to_lowercase();
        (!holds_any(&name, &OF_GYRO), holds_any(&name, &OF_OTHERS))
    };
    let shared = |c: &&Column| matches!(c.meaning, Meaning::Temperature(None, _));
    let best = columns.iter().filter(shared).map(rank).min();
    let mut one = false;
    for c in columns {
        if let Meaning::Temperature(a, unit) = c.meaning {
            if resonators {
                c.meaning = of_case(a, unit);
                c.because = Some("beside resonators, a sensor is taken for the case's".into());
            } else if a.is_none() && (each || one || Some(rank(c)) != best) {
                c.meaning = Meaning::Unknown;
                c.because = Some(ANOTHER_THERMOMETER.into());
            } else {
                one |= a.is_none();
            }
        }
    }
}

impl Guess {
    /// Lack of what a recording needs, in a sentence; `None` if the guess is one.
    #[must_use]
    pub fn lacks(&self) -> Option<&'static str> {
        let has = |what: &dyn Fn(&Meaning) -> bool| self.columns.iter().any(|c| what(&c.meaning));
        match () {
            () if !has(&|m| matches!(m, Meaning::Rate(..))) => {
                Some("no column is known for a rate: put the names of yours into [rate]")
            }
            () if self.columns.iter().any(|c| matches!(c.meaning, Meaning::Rate(..)) && c.because.is_some()) => {
                Some("no unit is named for a rate: look at the one that was guessed by its size")
            }
            () if !has(&|m| matches!(m, Meaning::Time(_) | Meaning::Date(_))) => Some(
                "no column is known for the time: put its name into [time], or step_s, the seconds between the rows",
            ),
            () => None,
        }
    }

    /// Column and form of the times, as `COLUMN=FORM` or `DATE+TIME=FORM`.
    #[must_use]
    pub fn time(&self) -> Option<String> {
        let of = |what: &dyn Fn(&Meaning) -> Option<String>| {
            self.columns.iter().find_map(|c| Some((c.name.as_str(), what(&c.meaning)?)))
        };
        let plain = |m: &Meaning| if let Meaning::Time(form) = m { Some(form.clone()) } else { None };
        if let Some((name, form)) = of(&plain) {
            return Some(format!("{name}={form}"));
        }
        let (date, day) = of(&|m| if let Meaning::Date(form) = m { Some(form.clone()) } else { None })?;
        let (time, form) = of(&|m| if let Meaning::TimeOfDay(form) = m { Some(form.clone()) } else { None })?;
        Some(format!("{date}+{time}={day} {form}"))
    }

    /// Columns that a recording lacks and this table has, as `name=column`: a thermometer, where there is none; else sensors on the cases, or of
    /// the chamber.
    #[must_use]
    pub fn beside(&self, r: &Recording) -> Vec<String> {
        let lacks = |name: &str| r.column(name).is_none_or(|c| c.iter().all(|v| v.is_nan()));
        let mut out: Vec<String> = Vec::new();
        for c in &self.columns {
            let names: Vec<&str> = match &c.meaning {
                Meaning::Temperature(None, _) if r.thermometer == Thermometer::None => vec!["temp_c"],
                Meaning::Temperature(Some(a), _) if r.thermometer == Thermometer::None => {
                    vec![columns::SENSOR.names[*a]]
                }
                Meaning::Temperature(None, _) => {
                    let cases = columns::CASE.names.iter().enumerate();
                    let own: Vec<&str> = cases.filter(|(a, _)| !r.absent[*a]).map(|(_, n)| *n).collect();
                    if r.thermometer == Thermometer::Frequency {
                        own
                    } else {
                        vec!["chamber_c"]
                    }
                }
                Meaning::Temperature(Some(a), _) => vec![columns::CASE.names[*a]],
                Meaning::Other(names, _) => names.clone(),
                _ => vec![],
            };
            let unit =
                c.meaning.unit().filter(|u| !["C", "V"].contains(u)).map_or(String::new(), |u| format!(" in {u}"));
            out.extend(names.into_iter().filter(|n| lacks(n)).map(|n| format!("{n}={}{unit}", c.name)));
        }
        out
    }

    /// Unit of a column, by its name.
    #[must_use]
    pub fn unit_of(&self, column: &str) -> Option<&'static str> {
        self.columns.iter().find(|c| c.name == column)?.meaning.unit()
    }

    /// Thermometers that are left out because another one is used.
    #[must_use]
    pub fn other_thermometers(&self) -> Vec<&str> {
        let other = |c: &&Column| c.because.as_deref() == Some(ANOTHER_THERMOMETER);
        self.columns.iter().filter(other).map(|c| c.name.as_str()).collect()
    }

    /// The map, with what each column is taken for as comments.
    #[must_use]
    pub fn map(&self) -> String {
        let quoted = |name: &str| serde_json::to_string(name).unwrap_or_default();
        let mut s =
            String::from("# A map guessed by hrg import: correct what is wrong. The forms are in docs/formats.md.\n");
        let width = self.columns.iter().map(|c| c.name.chars().count()).max().unwrap_or(0);
        for c in &self.columns {
            let because = c.because.as_ref().map_or(String::new(), |b| format!(" ({b})"));
            let pad = width - c.name.chars().count();
            let sample: String = c.sample.chars().take(24).collect();
            let _ = writeln!(s, "#   {}{} {sample:<24} {}{because}", c.name, " ".repeat(pad), c.meaning);
        }
        s.push_str("hrg-map = 1\n");
        let imu = self.columns.iter().find_map(|c| if let Meaning::Imu(n) = c.meaning { Some((c, n)) } else { None });
        if self.skip_lines > 0 || !self.header || self.drop_rows > 0 || imu.is_some() {
            s.push_str("\n[table]\n");
            if self.skip_lines > 0 {
                let _ = writeln!(s, "skip_lines = {}", self.skip_lines);
            }
            if !self.header {
                s.push_str("header = false\n");
            }
            if self.drop_rows > 0 {
                let _ = writeln!(s, "drop_rows = {}    # units", self.drop_rows);
            }
            if let Some((c, number)) = imu {
                let _ = writeln!(s, "instance_column = {}\ninstance = {number}", quoted(&c.name));
            }
        }
        s.push_str("\n[meta]\n# unit = \"NAME\"            # name of the unit\n# latitude_deg = \"53.1\"    # with axes, the earth's rate is taken off\n# axes = \"x=north y=east z=down\"\n\n[time]\n");
        let mut date = None;
        for c in &self.columns {
            match &c.meaning {
                Meaning::Time(form) => {
                    let _ = writeln!(s, "column = {}\nunit = {}", quoted(&c.name), quoted(form));
                }
                Meaning::Date(pattern) => {
                    date = Some(pattern);
                    let _ = writeln!(s, "column = {}", quoted(&c.name));
                }
                _ => {}
            }
        }
        for c in &self.columns {
            if let (Meaning::TimeOfDay(form), Some(date)) = (&c.meaning, date) {
                let _ =
                    writeln!(s, "second_column = {}\nunit = {}", quoted(&c.name), quoted(&format!("{date} {form}")));
            }
        }
        let mut sections: [(&str, Vec<String>); 4] =
            [("frequency", vec![]), ("temperature", vec![]), ("rate", vec![]), ("optional", vec![])];
        for c in &self.columns {
            let line = |key: &str, unit: &str| format!("{key} = {{ column = {}, unit = \"{unit}\" }}", quoted(&c.name));
            match &c.meaning {
                Meaning::Frequency(a, unit) => sections[0].1.push(line(AXIS_NAMES[*a], unit)),
                Meaning::Temperature(a, unit) => sections[1].1.push(line(a.map_or("all", |a| AXIS_NAMES[a]), unit)),
                Meaning::Rate(a, unit) => sections[2].1.push(line(AXIS_NAMES[*a], unit)),
                Meaning::Other(names, unit) => sections[3].1.extend(names.iter().map(|n| line(n, unit))),
                _ => {}
            }
        }
        for (name, lines) in sections.iter().filter(|(name, lines)| !lines.is_empty() || *name == "rate") {
            let _ = writeln!(s, "\n[{name}]\n{}", lines.join("\n"));
        }
        s
    }
}

impl std::fmt::Display for Meaning {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Time(form) => write!(f, "time, {form}"),
            Self::Date(form) => write!(f, "date, {form}"),
            Self::TimeOfDay(form) => write!(f, "time of day, {form}"),
            Self::Rate(a, unit) => write!(f, "rate {}, {unit}", AXIS_NAMES[*a]),
            Self::Frequency(a, unit) => write!(f, "frequency {}, {unit}", AXIS_NAMES[*a]),
            Self::Temperature(Some(a), unit) => write!(f, "temperature {}, {unit}", AXIS_NAMES[*a]),
            Self::Temperature(None, unit) => write!(f, "temperature of all axes, {unit}"),
            Self::Other(names, unit) => write!(f, "{}, {unit}", names.join(" ")),
            Self::Imu(n) => write!(f, "number of the IMU, {n} is taken"),
            Self::Unknown => f.write_str("left out"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::map::conversion;
    use super::*;

    fn meaning(name: &str, cells: &[&str]) -> Meaning {
        column(name, cells).meaning
    }

    #[test]
    fn columns_are_known_by_name_unit_and_size() {
        let small = ["0.004", "0.0041", "0.0039"];
        for (name, cells, wanted) in [
            ("Gyr-X(dps)", &small, Meaning::Rate(0, "deg/s")),
            ("gyro_y [°/h]", &["15.1", "15.0", "14"], Meaning::Rate(1, "deg/h")),
            ("rate_z_deg_s", &small, Meaning::Rate(2, "deg/s")),
            ("wx", &["7.2e-5", "7.3e-5", "7e-5"], Meaning::Rate(0, "rad/s")),
            ("Kreisel Z [mrad/s]", &small, Meaning::Rate(2, "mrad/s")),
            ("acc_x", &["9.8", "9.7", "9.8"], Meaning::Unknown),
            ("freq_x [kHz]", &["4.9", "4.91", "4.9"], Meaning::Frequency(0, "kHz")),
            ("fy", &["4900", "4901", "4900"], Meaning::Frequency(1, "Hz")),
            ("Temperature [degC]", &["20", "21", "20"], Meaning::Temperature(None, "C")),
            ("T_y", &["293.1", "293.2", "293"], Meaning::Temperature(Some(1), "K")),
            ("Kammer [°C]", &["20", "21", "20"], Meaning::Other(vec!["chamber_c"], "C")),
            ("supply_v", &["5.0", "5.1", "5.0"], Meaning::Other(vec!["supply_v"], "V")),
            ("Status", &["1", "0", "1"], Meaning::Unknown),
            ("Temp body [C]", &["20", "21", "20"], Meaning::Temperature(None, "C")),
            ("Pt100 [Ohm]", &["107", "108", "107"], Meaning::Unknown),
            ("T Soll [C]", &["20", "21", "20"], Meaning::Unknown),
            ("std_x [deg/h]", &["0.1", "0.1", "0.1"], Meaning::Unknown),
            ("fx [m/s2]", &["0.1", "0.1", "0.1"], Meaning::Unknown),
        ] {
            assert_eq!(meaning(name, cells), wanted, "{name}");
        }
    }

    fn guessed(text: &str) -> Guess {
        guess(text).expect("a table")
    }

    #[test]
    fn the_units_of_a_guess_are_those_of_a_map() {
        for (quantity, written) in [
            ("rate", &["dph", "dps", "mrads", "rads", "ppb", "ppm"][..]),
            ("temperature", &["c", "k", "mc", "f"]),
            ("frequency", &["hz", "khz", "mhz"]),
            ("voltage", &["v", "mv"]),
        ] {
            for unit in written.iter().map(|w| unit_of(quantity, w).expect("known")) {
                assert!(conversion(quantity, Some(unit)).is_ok(), "{unit}");
            }
        }
        for unit in ["s", "ms", "us", "ns", "min", "h"].map(|w| unit_of("time", w).expect("known")) {
            assert!(TimeForm::parse(unit).is_some(), "{unit}");
        }
    }

    #[test]
    fn headers_and_times_are_found() {
        let g =
            guessed("Rig 4\n\nDatum;Uhrzeit;wz [deg/s];Temp\n20.11.2026;07:30:00;0,1;20\n20.11.2026;07:30:01;0,2;20\n");
        assert_eq!((g.skip_lines, g.header, g.lacks()), (1, true, None));
        assert_eq!(g.time().as_deref(), Some("Datum+Uhrzeit=%d.%m.%Y %H:%M:%S"));
        let of_fractions = "date,clock,gx [deg/s],temp\n20.11.2026,23:59:50.000,1,20\n20.11.2026,23:59:50.010,2,20\n20.11.2026,23:59:50.020,1,20\n";
        assert_eq!(guessed(of_fractions).time().as_deref(), Some("date+clock=%d.%m.%Y %H:%M:%S.%f"));
        let g = guessed("t_ms,gx [deg/s],T\n1000,1,20\n1010,2,20\n1020,3,20\n");
        assert_eq!((g.skip_lines, g.time().as_deref(), g.lacks()), (0, Some("t_ms=ms"), None));
        // A time beside a temperature of the same letter; what looks like a clock or like days is no number of seconds.
        let g = guessed("T;t;wx [deg/h]\n20;0;1\n20;1;1\n20;2;1\n");
        assert_eq!((g.time().as_deref(), &g.columns[0].meaning), (Some("t=s"), &Meaning::Temperature(None, "C")));
        for times in [["072959", "073000", "073001"], ["46346.3125", "46346.3126", "46346.3127"]] {
            let [a, b, c] = times;
            assert!(guessed(&format!("Time,wx [deg/h],T\n{a},1,20\n{b},1,20\n{c},1,20\n")).lacks().is_some(), "{a}");
        }
        let g = guessed("1,2,3\n4,5,6\n7,8,9\n");
        assert!(!g.header && g.lacks().is_some_and(|l| l.contains("[rate]")));
        // Rates without a unit are not taken, gravity is no rate, and one column is taken for an axis.
        let g = guessed("time,gyro_x,gyro_z\n0,0.8,0.1\n1,0.8,0.1\n2,0.8,0.1\n");
        assert!(g.lacks().is_some_and(|l| l.contains("no unit")) && g.columns[1].because == g.columns[2].because);
        let g = guessed("time,gx,gy,gz,rate_x [deg/s],gyro_x_f\n0,0,0.1,9.8,2,1\n1,0,0.1,9.8,2,1\n2,0,0.1,9.8,2,1\n");
        let rates: Vec<&str> =
            g.columns.iter().filter(|c| matches!(c.meaning, Meaning::Rate(..))).map(|c| c.name.as_str()).collect();
        assert_eq!((rates, g.lacks()), (vec!["rate_x [deg/s]"], None));
        // Words around the axis, and units in a line of their own.
        let g = guessed("Time (s),Gyro X rate (deg/h),T\n0,1,20\n1,2,20\n2,1,20\n");
        assert_eq!((g.lacks(), &g.columns[1].meaning), (None, &Meaning::Rate(0, "deg/h")));
        let g = guessed("Time,Gyro X,Temp\ns,deg/s,K\n0,1,290\n1,2,291\n2,1,292\n");
        let of: Vec<&Meaning> = g.columns.iter().map(|c| &c.meaning).collect();
        assert_eq!(of, [&Meaning::Time("s".into()), &Meaning::Rate(0, "deg/s"), &Meaning::Temperature(None, "K")]);
        assert!(g.map().contains("drop_rows = 1") && g.map().contains("\"Gyro X\""), "{}", g.map());
        // One axis without a name; set and actual temperatures; whose thermometer it is.
        let g = guessed("Zeit;Drehrate [°/h];Temp Set (C);Temp Act (C)\n0;1;20;21\n1;2;20;22\n2;1;20;23\n");
        let of: Vec<&Meaning> = g.columns.iter().skip(1).map(|c| &c.meaning).collect();
        assert_eq!(of, [&Meaning::Rate(0, "deg/h"), &Meaning::Unknown, &Meaning::Temperature(None, "C")]);
        let g = guessed("t [s],wx [urad/s],Acc Temp (C),Gyr Temp (C)\n0,1,20,21\n1,2,20,22\n2,1,20,23\n");
        assert!(g.columns[2].meaning == Meaning::Unknown && g.columns[3].meaning == Meaning::Temperature(None, "C"));
        // Two thermometers, and resonators beside a sensor.
        let g = guessed("time,wx [deg/h],temp_a,temp_b\n0,1,20,30\n1,1,20,30\n2,1,20,30\n");
        assert_eq!(g.columns.iter().filter(|c| matches!(c.meaning, Meaning::Temperature(..))).count(), 1);
        let g = guessed("time,wx [deg/h],fx,temp\n0,1,4900,30\n1,1,4900,30\n2,1,4900,30\n");
        assert!(matches!(&g.columns[3].meaning, Meaning::Other(names, "C") if names[0] == "case_x_c"));
    }

    #[test]
    fn a_column_of_imu_numbers_parts_the_rows() {
        let text = "TimeUS,I,GyrX [rad/s],T [C]\n1000,0,0.1,20\n1000,1,0.2,30\n2000,0,0.1,20\n2000,1,0.2,30\n3000,0,0.1,20\n3000,1,0.2,30\n";
        let map = guessed(text).map();
        assert!(map.contains("instance_column = \"I\"\ninstance = 0") && map.contains("unit = \"us\""), "{map}");
        // One number, or numbers that are a measurement, part nothing.
        assert!(!guessed(&text.replace(",1,0.2", ",0,0.2")).map().contains("instance"));
    }
}
