//! Recordings from other programs' files: any table as text or Parquet, PX4's and ArduPilot's logs, by a [map](map::Map) that says which column is what.
//!
//! A map that does not fit ends with one sentence: the column that is missing, and those that are there.

mod blackbox;
mod columnar;
mod dataflash;
pub mod decode;
mod delimited;
mod excel;
pub mod guess;
pub mod map;
mod mcap;
mod ulog;

use crate::axes::AXIS_NAMES;
use crate::error::BadInput;
use crate::files::begins_with;
use crate::recording::thermometer::Thermometer;
use crate::recording::{columns, parquet, Recording};
use map::{conversion, quantity_of, Column, Format, Map, Names};
use std::path::Path;

/// Columns of a file by name, as numbers; NaN where a cell is empty.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Table {
    /// Names and values of the columns that a map asked for.
    columns: Vec<(String, Vec<f64>)>,
    /// Times that are no numbers, s.
    time_s: Option<Vec<f64>>,
    /// Notes of the import.
    notes: Vec<String>,
}

impl Table {
    /// Of the columns that are there, those that a map wants.
    ///
    /// # Errors
    /// As [`choose`].
    fn of(columns: Vec<(String, Vec<f64>)>, map: &Map) -> Result<Self, BadInput> {
        let names: Vec<String> = columns.iter().map(|(n, _)| n.clone()).collect();
        let wanted = choose(map, &names)?;
        let columns = columns.into_iter().filter(|(n, _)| wanted.iter().any(|(_, w)| w == n)).collect();
        Ok(Self { columns, ..Self::default() })
    }

    fn column(&self, names: &Names) -> Option<&[f64]> {
        names.all().iter().find_map(|n| self.columns.iter().find(|(c, _)| c == n)).map(|(_, v)| v.as_slice())
    }

    fn rows(&self) -> usize {
        self.columns.iter().map(|(_, v)| v.len()).chain(self.time_s.as_ref().map(Vec::len)).max().unwrap_or(0)
    }
}

/// Of the names that are there, those that a map wants, each with its place.
///
/// # Errors
/// The first that is missing, with all that there are.
fn choose(map: &Map, there: &[String]) -> Result<Vec<(usize, String)>, BadInput> {
    let mut out: Vec<(usize, String)> = Vec::new();
    for (place, names, must) in map.wanted() {
        let found = names.all().iter().find_map(|n| there.iter().position(|t| t == n));
        let Some(at) = found else {
            if !must {
                continue;
            }
            return Err(BadInput(format!(
                "the map's column for {place}, {}, is not in the file; there are {}",
                names.all().iter().map(|n| format!("\"{n}\"")).collect::<Vec<_>>().join(" or "),
                there.iter().map(|n| format!("\"{n}\"")).collect::<Vec<_>>().join(", ")
            )));
        };
        if !out.iter().any(|(k, _)| *k == at) {
            out.push((at, there[at].clone()));
        }
    }
    Ok(out)
}

/// A cell as the number of an IMU.
fn imu_number(cell: Option<f64>) -> Option<u8> {
    cell.filter(|n| (0.0..=255.0).contains(n)).map(|n| n as u8)
}

/// A note where a file holds several IMUs.
///
/// # Errors
/// The one that is wanted is not among them.
fn others(imus: &std::collections::BTreeSet<u8>, taken: u8) -> Result<Option<String>, BadInput> {
    let others: Vec<String> = imus.iter().filter(|n| **n != taken).map(u8::to_string).collect();
    if others.is_empty() {
        return Ok(None);
    }
    let list = crate::error::list(&others);
    if !imus.contains(&taken) {
        return Err(BadInput(format!("the file has no IMU {taken}; it has {list}")));
    }
    Ok(Some(format!("IMU {taken} is taken; the file also has {list}: --imu {} takes that one", others[0])))
}

/// Longest step between two readings that is bridged, s: as a fit bridges it.
const BRIDGED_S: f64 = crate::recording::steps::BRIDGE_S;

/// Values of another series at these times, s: straight lines between its rows. NaN in gaps that are longer than [`BRIDGED_S`], and more than ten
/// usual steps before its first row and after its last one.
fn at_times(times_s: &[f64], own_times_s: &[f64], values: &[f64]) -> Vec<f64> {
    let both = own_times_s.iter().copied().zip(values.iter().copied());
    let rows: Vec<(f64, f64)> = both.filter(|(t, v)| t.is_finite() && v.is_finite()).collect();
    let mut steps: Vec<f64> = rows.windows(2).map(|w| w[1].0 - w[0].0).collect();
    let held_s = 10.0 * crate::numeric::stats::median(&mut steps).unwrap_or(f64::INFINITY);
    let at = |t: f64| {
        let after = rows.partition_point(|r| r.0 <= t);
        match (after.checked_sub(1).map(|k| rows[k]), rows.get(after)) {
            (Some((t0, v0)), Some(&(t1, v1))) if t1 - t0 <= BRIDGED_S => v0 + (v1 - v0) * (t - t0) / (t1 - t0),
            (Some((t0, v)), None) if t - t0 <= held_s => v,
            (None, Some(&(t1, v))) if t1 - t <= held_s => v,
            _ => f64::NAN,
        }
    };
    times_s.iter().map(|t| at(*t)).collect()
}

/// Name of the built-in map of a file that begins as a log of a known program.
#[must_use]
pub fn built_in(path: &Path) -> Option<&'static str> {
    match () {
        () if dataflash::begins(path) => Some("ardupilot"),
        () if begins_with(path, blackbox::HEAD) => Some("betaflight"),
        () if begins_with(path, ulog::HEAD) => Some("px4"),
        () if begins_with(path, mcap::HEAD) => Some("ros"),
        () => None,
    }
}

/// `true` for a log of a known program and for a spreadsheet: what is read as a whole.
#[must_use]
pub fn is_whole(path: &Path) -> bool {
    built_in(path).is_some() || excel::is_named_so(path)
}

/// Reads a file by a map.
///
/// # Errors
/// One sentence: what does not fit, where.
pub fn read(path: &Path, map: &Map) -> anyhow::Result<Recording> {
    let mut parts = Parts::open(path, map)?;
    let mut whole: Option<Recording> = None;
    while let Some(part) = parts.next_part()? {
        match &mut whole {
            None => whole = Some(part),
            Some(whole) => whole.append(part),
        }
    }
    let notes = parts.notes()?;
    let whole = whole.ok_or_else(|| BadInput(format!("{}: there is no row of data", path.display())))?;
    Ok(Recording { notes, ..whole })
}

/// A recording that is made of a file by a map, part by part: a table of text is never in memory as a whole.
pub struct Parts<'m> {
    file: String,
    from: Source<'m>,
    map: &'m Map,
    /// Rows so far.
    rows: usize,
    /// First time on the file's clock, s.
    first_s: Option<f64>,
    /// Values outside their valid range, by the names of their columns.
    outside: Vec<(String, [f64; 2], usize)>,
    notes: Vec<String>,
}

/// Source of the rows.
enum Source<'m> {
    Text(Box<delimited::Text<'m>>),
    Columns(Box<columnar::Batches<'m>>),
    Whole(Option<Table>),
}

impl<'m> Parts<'m> {
    /// Opens a file.
    ///
    /// # Errors
    /// One sentence: a file that cannot be read, or a map that does not fit.
    pub fn open(path: &Path, map: &'m Map) -> anyhow::Result<Self> {
        let here = |e: BadInput| BadInput(format!("{}: {e}", path.display()));
        let all = || crate::files::read_file(path, crate::files::MOST_RECORDING, false);
        let whole = |table: Result<Table, BadInput>| table.map(|t| Source::Whole(Some(t)));
        let from = match map.format {
            Format::Delimited if parquet::begins_as_parquet(path) => {
                columnar::Batches::open(path, map).map(|b| Source::Columns(Box::new(b)))
            }
            Format::Delimited if dataflash::begins(path) => whole(dataflash::read(&all()?, map)),
            Format::Delimited if excel::is_named_so(path) => whole(excel::read(all()?, map)),
            // (Zero bytes are found where the encoding is known.)
            Format::Delimited => {
                let text = crate::files::text(path, crate::files::MOST_RECORDING)?;
                delimited::Text::new(text, map, delimited::PIECE).map(|t| Source::Text(Box::new(t)))
            }
            Format::Ulog => whole(ulog::read(path, map)),
            Format::Blackbox => whole(blackbox::read(&all()?, map)),
            Format::Mcap => whole(mcap::read(&all()?, map)),
        };
        Ok(Self::of(from.map_err(here)?, map, path.display().to_string()))
    }

    fn of(from: Source<'m>, map: &'m Map, file: String) -> Self {
        Self { file, from, map, rows: 0, first_s: None, outside: Vec::new(), notes: Vec::new() }
    }

    /// The next rows; their times go on from those before. `None` behind the last.
    ///
    /// # Errors
    /// One sentence: what does not fit, where.
    pub fn next_part(&mut self) -> Result<Option<Recording>, BadInput> {
        loop {
            let table = match &mut self.from {
                Source::Text(text) => text.next_piece(),
                Source::Columns(batches) => batches.next_batch(),
                Source::Whole(table) => Ok(table.take()),
            };
            let Some(mut table) = table.map_err(|e| self.here(&e))? else { return Ok(None) };
            self.notes.append(&mut table.notes);
            if table.rows() > 0 {
                return self.recording(&table).map(Some).map_err(|e| self.here(&e));
            }
        }
    }

    /// Notes of the import, behind the last part.
    ///
    /// # Errors
    /// There are less than two rows.
    pub fn notes(&mut self) -> Result<Vec<String>, BadInput> {
        let notes = match &mut self.from {
            Source::Text(text) => text.notes(),
            Source::Columns(batches) => batches.notes(),
            Source::Whole(_) => Ok(Vec::new()),
        };
        self.notes.extend(notes.map_err(|e| self.here(&e))?);
        if self.rows < 2 {
            let rows = self.rows;
            return Err(self.here(&BadInput(format!("the map leaves {rows} rows of data; check drop_rows and keep"))));
        }
        let outside = self.outside.iter().filter(|(.., count)| *count > 0).map(|(name, [low, high], count)| {
            format!("column {name}: {count} values outside {low} to {high} are missing")
        });
        self.notes.extend(outside);
        Ok(std::mem::take(&mut self.notes))
    }

    fn here(&self, e: &BadInput) -> BadInput {
        BadInput(format!("{}: {e}", self.file))
    }
}

/// The values of a column in the unit of the recording.
fn converted(table: &Table, column: &Column, quantity: &str) -> Result<Vec<f64>, BadInput> {
    let (factor, offset) = conversion(quantity, column.unit.as_deref())?;
    let values = table.column(&column.column).ok_or_else(|| BadInput::new("a column got lost"))?;
    let valid = |v: &f64| column.valid.is_none_or(|[low, high]| (low..=high).contains(v));
    let value = |v: &f64| if valid(v) { ((v + column.offset) * factor + offset) * column.factor } else { f64::NAN };
    Ok(values.iter().map(value).collect())
}

/// Number of values of a column outside its valid range; `None` where it has no range.
fn outside(table: &Table, column: &Column) -> Option<(String, [f64; 2], usize)> {
    let [low, high] = column.valid?;
    let count = table.column(&column.column)?.iter().filter(|v| v.is_finite() && !(low..=high).contains(*v)).count();
    Some((column.column.all()[0].to_string(), [low, high], count))
}

impl Parts<'_> {
    /// Times in s from the first row (or from power-on), and the seconds since 1970 at time 0 where the file tells.
    fn times(&mut self, table: &Table, map: &Map) -> Result<(Vec<f64>, Option<f64>), BadInput> {
        let Some(names) = &map.time.column else {
            let step = map.time.step_s.unwrap_or(1.0);
            return Ok(((self.rows..self.rows + table.rows()).map(|k| k as f64 * step).collect(), None));
        };
        let form = map.time.form()?;
        let clock: Vec<f64> = match &table.time_s {
            Some(times) => times.clone(),
            None => {
                let raw = table.column(names).ok_or_else(|| BadInput::new("the times got lost"))?;
                raw.iter().map(|t| form.of_number(*t)).collect()
            }
        };
        self.first_s = self.first_s.or_else(|| clock.iter().copied().find(|t| t.is_finite()));
        let first = self.first_s.unwrap_or(0.0);
        if map.time.since_power_on {
            return Ok((clock.iter().map(|t| t + map.time.offset_s).collect(), None));
        }
        let since_1970 = form.counts_from_1970(first).then_some(first + map.time.offset_s);
        // (Seconds since 1970 are known to a quarter of a microsecond as a number.)
        let digits = if since_1970.is_some() { 1e6 } else { 1e9 };
        Ok((clock.iter().map(|t| (digits * (t - first)).round() / digits).collect(), since_1970))
    }

    fn recording(&mut self, table: &Table) -> Result<Recording, BadInput> {
        let map = &self.map.without_missing(|names| table.column(names).is_some());
        let (time_s, since_1970) = self.times(table, map)?;
        self.rows += table.rows();
        let columns = map
            .rate
            .values()
            .chain(map.temperature.values())
            .chain(map.frequency.values())
            .chain(map.optional.values());
        for found in columns.filter_map(|c| outside(table, c)) {
            match self.outside.iter_mut().find(|o| o.0 == found.0 && o.1 == found.1) {
                Some(before) => before.2 += found.2,
                None => self.outside.push(found),
            }
        }
        recording(time_s, since_1970, table, map)
    }
}

fn recording(time_s: Vec<f64>, since_1970: Option<f64>, table: &Table, map: &Map) -> Result<Recording, BadInput> {
    let mut r = Recording { time_s, ..Recording::default() };
    r.set_meta("hrg-recording", "2");
    r.set_meta("rate_unit", "deg/h");
    let shared = map.temperature.get("all");
    r.thermometer = match (map.frequency.is_empty(), shared) {
        (true, None) if map.temperature.is_empty() => Thermometer::None,
        (false, _) => Thermometer::Frequency,
        (true, None) => Thermometer::Sensors,
        (true, Some(_)) => Thermometer::OneSensor,
    };
    let kind = match r.thermometer {
        Thermometer::Frequency => "frequency",
        Thermometer::None => "none",
        _ => "sensor",
    };
    r.set_meta("thermometer", kind);
    if map.time.since_power_on {
        r.set_meta("power_on_s", "0");
    }
    if let Some(t) = since_1970 {
        r.set_meta("power_on_unix_s", &format!("{t:.3}"));
    }
    map.meta.iter().for_each(|(k, v)| r.set_meta(k, v));
    for (a, axis) in AXIS_NAMES.iter().enumerate() {
        let Some(rate) = map.rate.get(*axis) else {
            r.absent[a] = true;
            (r.rate_dph[a], r.frequency_hz[a]) = (vec![f64::NAN; table.rows()], vec![f64::NAN; table.rows()]);
            continue;
        };
        r.rate_dph[a] = converted(table, rate, "rate")?;
        if let Some(unit @ ("ppb" | "ppm")) = rate.unit.as_deref() {
            r.set_meta(
                crate::recording::metadata::STANDS_FOR,
                if unit == "ppm" { "ppb, converted from ppm" } else { "ppb" },
            );
        }
        if r.thermometer == Thermometer::None {
            r.frequency_hz[a] = vec![f64::NAN; table.rows()];
            continue;
        }
        let (quantity, readings) = if map.frequency.is_empty() {
            ("temperature", shared.or_else(|| map.temperature.get(*axis)))
        } else {
            ("frequency", map.frequency.get(*axis))
        };
        let readings = readings.ok_or_else(|| BadInput(format!("the map has no thermometer for axis {axis}")))?;
        r.frequency_hz[a] = converted(table, readings, quantity)?;
    }
    for name in columns::optional() {
        if let Some(c) = map.optional.get(name) {
            r.optional.push((name, converted(table, c, quantity_of(name))?));
        }
    }
    crate::recording::metadata::check(&r.meta)?;
    Ok(r)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn import(map: &str, text: &str) -> Result<Recording, BadInput> {
        let whole = in_parts(map, text, delimited::PIECE)?;
        for piece in [1, 100, 1000] {
            assert_eq!(
                in_parts(map, text, piece).map(|r| r.to_csv()).ok(),
                Some(whole.to_csv()),
                "in pieces of {piece}"
            );
        }
        Ok(whole)
    }

    fn in_parts(map: &str, text: &str, piece: usize) -> Result<Recording, BadInput> {
        let map = &Map::parse(map)?;
        let text = delimited::Text::new(std::io::Cursor::new(text.to_string().into_bytes()), map, piece)?;
        let mut parts = Parts::of(Source::Text(Box::new(text)), map, "test".into());
        let mut whole = parts.next_part()?.unwrap_or_default();
        while let Some(part) = parts.next_part()? {
            whole.append(part);
        }
        Ok(Recording { notes: parts.notes()?, ..whole })
    }

    const MAP: &str = "hrg-map = 1
[table]
drop_rows = 1
[meta]
unit = \"G-1\"
[time]
column = \"t\"
unit = \"ns\"
[temperature]
x = { column = \"T\", unit = \"K\" }
[rate]
x = { column = [\"gx\", \"wx\"], unit = \"rad/s\", factor = -1 }
[optional]
supply_v = { column = \"u\", unit = \"mV\" }
";

    #[test]
    fn units_signs_and_origins() {
        let text = "t;u;T;wx\n1;2;3;4\n1627342541000000000;5000;300,15;0,01\n1627342542500000000;;301.15;\n"
            .replace("301.15", "301,15");
        let r = import(MAP, &text).expect("fits");
        assert_eq!(r.time_s, [0.0, 1.5]);
        assert!((r.frequency_hz[0][0] - 27.0).abs() < 1e-9 && r.absent == [false, true, true]);
        assert!((r.rate_dph[0][0] + 2062.648).abs() < 1e-3 && r.rate_dph[0][1].is_nan());
        assert!(r.column("supply_v").is_some_and(|v| v[0] == 5.0 && v[1].is_nan()));
        assert_eq!((r.unit(), r.thermometer), ("G-1", Thermometer::Sensors));
        assert!(r.notes.iter().any(|n| n.contains("2 cells are empty")), "{:?}", r.notes);
    }

    #[test]
    fn white_space_numbers_for_names_and_rows_that_are_kept() {
        let map = "hrg-map = 1
[table]
separator = \"space\"
header = false
keep = { \"1\" = \"IMU\" }
[time]
column = \"2\"
unit = \"us\"
since_power_on = true
[temperature]
all = { column = \"4\" }
[rate]
y = { column = \"3\", unit = \"deg/s\" }
";
        let r = import(map, "IMU 1000000  0.5 20\nGPS 1 2 3 4\n  IMU 2000000  0.25\n").expect("fits");
        assert_eq!((r.time_s.as_slice(), r.rate_dph[1].as_slice()), (&[1.0, 2.0][..], &[1800.0, 900.0][..]));
        assert!(r.frequency_hz[1][1].is_nan() && r.meta("power_on_s") == Some("0"));
    }

    #[test]
    fn rows_that_are_glued_or_cut_off_are_left_out() {
        let text = "t;u;T;wx\n0;0;0;0\n1;2;300;4\n2;2;301;43;2;301;4\n4;2;301;4;;\n5;2;30";
        let r = import(MAP, text).expect("fits");
        assert_eq!(r.time_s.len(), 2);
        let notes = r.notes.join("; ");
        assert!(notes.contains("1 rows have more cells than the header, the first in line 4"), "{notes}");
        assert!(notes.contains("line 6, the last, is cut off"), "{notes}");
    }

    #[test]
    fn a_map_that_does_not_fit_says_what_is_missing_and_what_is_there() {
        let says = |map: &str, text: &str, words: &[&str]| {
            let e = import(map, text).expect_err("must be refused").0;
            assert!(words.iter().all(|w| e.contains(w)), "{e}");
        };
        says(MAP, "t,u,Temp,wx\n1,2,3,4\n", &["[temperature] x, \"T\"", "there are \"t\", \"u\", \"Temp\", \"wx\""]);
        says(MAP, "t,u,T,wy\n1,2,3,4\n", &["[rate] x, \"gx\" or \"wx\""]);
        says(MAP, "t,u,T,wx\n0,0,0,0\n1,2,hot,4\n", &["line 3, column \"T\": \"hot\" is not a number"]);
        says(&MAP.replace("rad/s", "rpm"), "", &["\"rpm\"", "deg/h, deg/s, rad/s"]);
        says(&MAP.replace("[rate]\nx", "[rate]\nw"), "", &["[rate] has \"w\""]);
        says(&MAP.replace("supply_v", "mass_kg"), "", &["mass_kg", "supply_v"]);
        says(&MAP.replace("hrg-map = 1", "hrg-map = 2"), "", &["version 2"]);
        says(&MAP.replace("unit = \"ns\"", "unit = \"week\""), "", &["\"week\" for a time", "min, h, unix, iso"]);
        says(&MAP.replace("drop_rows", "droprows"), "", &["line 3", "droprows"]);
        says(&MAP.replace("unit = \"G-1\"", "axes = \"x=north\""), "t,u,T,wx\n0,0,0,0\n1,2,3,4\n", &["axes"]);
        says(MAP, "", &["no header"]);
    }

    #[test]
    fn dates_in_two_columns_missing_texts_and_values_that_are_none() {
        let map = "hrg-map = 1
[table]
missing = [\"OVL\"]
[time]
column = \"day\"
second_column = \"clock\"
unit = \"%d/%m/%Y %H:%M:%S,%f\"
offset_s = -3600
[temperature]
all = { column = \"T\", valid = [-60, 100] }
[rate]
x = { column = \"w\" }
";
        let text =
            "day;clock;T;w\n21/11/2026;10:00:00,0;20;1\n21/11/2026;10:00:00,5;1e38;OVL\n21/11/2026;10:00:01,0;21;---\n";
        let r = import(map, text).expect("fits");
        assert_eq!(r.time_s, [0.0, 0.5, 1.0]);
        assert!(r.frequency_hz[0][1].is_nan() && r.rate_dph[0][1].is_nan() && r.rate_dph[0][2].is_nan());
        assert_eq!(r.meta("power_on_unix_s"), Some("1795251600.000"), "10:00 less an hour");
        for words in ["values outside -60 to 100", "2 cells hold a text"] {
            assert!(r.notes.iter().any(|n| n.contains(words)), "{:?}", r.notes);
        }
        let e = import(map, &text.replace("21/11/2026;10:00:01", "soon;10:00:01")).expect_err("no time").0;
        assert!(e.contains("line 4, column \"day\": \"soon 10:00:01,0\" is not a time of the form %d"), "{e}");
        let e = import(&map.replace("%d/%m/%Y", "day"), text).map(|_| ()).expect_err("no form").0;
        assert!(e.contains("is not a time"), "{e}");
    }

    #[test]
    fn the_built_in_maps_are_maps() {
        for (name, text) in map::BUILT_IN {
            let m = Map::parse(text).unwrap_or_else(|e| panic!("{name}: {e}"));
            assert!(m.rate.len() == 3, "{name}");
        }
    }

    #[test]
    fn ardupilot_tables_are_read() {
        let text = "timestamp,TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz\n\
            1.0,65645398,0,0.0009,0.00097,-0.0009,0,0,-9.8,0,0,41.5,1,1,1000,1000\n\
            1.0,65645398,1,9,9,9,0,0,-9.8,0,0,44,1,1,1000,1000\n\
            1.1,65685398,0,0.0008,0.00096,-0.0008,0,0,-9.8,0,0,41.6,1,1,1000,1000\n";
        let map = map::BUILT_IN.iter().find(|(n, _)| *n == "ardupilot").expect("there").1;
        let r = import(map, text).expect("fits");
        assert_eq!(
            (r.time_s.as_slice(), r.frequency_hz[2].as_slice()),
            (&[65.645398, 65.685398][..], &[41.5, 41.6][..])
        );
        assert!((r.rate_dph[0][0] - 0.0009 * 206_264.806_247).abs() < 1e-6);
    }
}
