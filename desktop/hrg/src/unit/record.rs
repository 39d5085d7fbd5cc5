//! A recording from a unit as it runs: from housekeeping on the link, or from the log alone. Both give the same rows.

use crate::unit::sensors;
use crate::unit::sensors::Sensors;
use anyhow::{Context, Result};
use hrg_core::increments::IncrementFrame;
use hrg_core::inputs::{QuantitySet, QUANTITIES};
use hrg_core::link::{Housekeeping, InputsUsed};
use hrg_core::timebase::Timebase;
use hrg_core::AXES;
use hrg_data::error::BadInput;
use hrg_data::recording::columns;
use hrg_data::recording::columns::Written;
use hrg_data::recording::metadata::{scale_text, Attitude, FORCES, NO_INPUTS, SCALE_FACTOR, UNIT_INPUTS};
use hrg_data::recording::{names, names_of};
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// Values of one second of a recording.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Second {
    /// Time since power-on, ms.
    pub time_ms: u32,
    /// Frequencies, Hz.
    pub frequency_hz: [f64; 3],
    /// Mean raw rates, deg/h.
    pub raw_dph: [f32; 3],
    /// Temperatures, C.
    pub temperature_c: [f32; 3],
    /// Biases, deg/h.
    pub bias_dph: [f32; 3],
    /// Their standard uncertainties, deg/h; NaN where the unit does not state them (a log never does).
    pub bias_std_dph: [f32; 3],
    /// Status of the axes and the unit.
    pub status: [u16; 4],
    /// Time since power-on, over restarts, s.
    pub on_for_s: f32,
    /// Checksum of the calibration in use.
    pub calibration: u32,
    /// Inputs beside the frequencies that the second has used, by number; NaN where there was none (a log never tells).
    pub inputs: [f32; QUANTITIES],
}

impl From<&Housekeeping> for Second {
    fn from(h: &Housekeeping) -> Self {
        Self {
            time_ms: h.time_ms,
            frequency_hz: h.frequency_hz,
            raw_dph: h.raw_dph,
            temperature_c: h.temperature_c,
            bias_dph: h.bias_dph,
            bias_std_dph: h.bias_std_dph,
            status: [h.axis_status[0].bits(), h.axis_status[1].bits(), h.axis_status[2].bits(), h.unit_status.bits()],
            on_for_s: h.on_for_s,
            calibration: h.calibration,
            inputs: [f32::NAN; QUANTITIES],
        }
    }
}

impl Second {
    /// The inputs that it has used.
    fn inputs_there(&self) -> QuantitySet {
        let there = |n: &u8| self.inputs[usize::from(*n)].is_finite();
        QuantitySet::all().numbers().filter(there).map(QuantitySet::one).collect()
    }

    /// Reads a log line, whatever a terminal or `defmt-print` has put before it; `None` if it is not one of a second.
    #[must_use]
    pub fn from_log(line: &str) -> Option<Self> {
        let at = line.find("t=").filter(|at| *at == 0 || line[..*at].ends_with(' '))?;
        let mut out = Self {
            time_ms: 0,
            frequency_hz: [f64::NAN; 3],
            raw_dph: [f32::NAN; 3],
            temperature_c: [f32::NAN; 3],
            bias_dph: [f32::NAN; 3],
            bias_std_dph: [f32::NAN; 3],
            status: [0; 4],
            on_for_s: 0.0,
            calibration: 0,
            inputs: [f32::NAN; QUANTITIES],
        };
        fn three<T: std::str::FromStr>(text: &str) -> Option<[T; 3]> {
            let values: Vec<T> = text.split(',').map(str::parse).collect::<Result<_, _>>().ok()?;
            values.try_into().ok()
        }
        let mut seen = 0;
        for token in line[at..].split_whitespace() {
            let (key, value) = token.split_once('=')?;
            match key {
                "t" => out.time_ms = value.parse().ok()?,
                // (A log of an older program does not say it.)
                "on" => {
                    out.on_for_s = value.parse().ok()?;
                    continue;
                }
                "f" => out.frequency_hz = three(value)?,
                "T" => out.temperature_c = three(value)?,
                "b" => out.bias_dph = three(value)?,
                "raw" => out.raw_dph = three(value)?,
                "status" => {
                    for (to, text) in out.status.iter_mut().zip(value.split(',')) {
                        *to = u16::from_str_radix(text, 16).ok()?;
                    }
                }
                "cal" => out.calibration = u32::from_str_radix(value, 16).ok()?,
                _ => continue,
            }
            seen += 1;
        }
        (seen == 7).then_some(out)
    }
}

/// The unit's name in its first log line.
#[must_use]
pub fn unit_in_log(line: &str) -> Option<&str> {
    line.split_once("hrg firmware ")?.1.split_once("unit ")?.1.split(',').next()
}

/// Milliseconds that have gone back are a wrap of their 32 bits if so few have passed: an hour.
const WRAP_MS: u64 = 3_600_000;

/// A unit that is on for this much longer than it counts time, s, was restarted.
const RESTARTED_S: f64 = 1.5;

/// Seconds without a row that are called a gap.
const GAP_MS: u32 = 2500;

/// The columns of a unit's recording. Its rates are the raw ones.
const COLUMNS: [Written<Second>; 7] = [
    (columns::FREQUENCY, |s, a| s.frequency_hz[a].into()),
    (columns::RATE, |s, a| s.raw_dph[a].into()),
    (columns::TEMPERATURE, |s, a| s.temperature_c[a].into()),
    (columns::BIAS, |s, a| s.bias_dph[a].into()),
    (columns::BIAS_STD, |s, a| s.bias_std_dph[a].into()),
    (columns::STATUS, |s, a| s.status[a].into()),
    (columns::UNIT_STATUS, |s, _| s.status[AXES].into()),
];

/// Those of a unit with temperature sensors: what it sends in the place of frequencies are their readings, C.
const COLUMNS_OF_SENSORS: [Written<Second>; 6] =
    [(columns::SENSOR, |s, a| s.frequency_hz[a].into()), COLUMNS[1], COLUMNS[3], COLUMNS[4], COLUMNS[5], COLUMNS[6]];

/// A unit records all its axes.
const EACH_AXIS: [usize; AXES] = [0, 1, 2];

/// Metadata of the unit in a recording.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Head {
    /// Its name; empty where it has none.
    pub unit: String,
    /// Attitude.
    pub attitude: Option<Attitude>,
    /// The scale factor that makes its rates, deg/h per code.
    pub scale_factor: Option<[f32; 3]>,
    /// Specific forces are as the accelerometers give them, whatever image the unit has.
    pub raw_forces: bool,
    /// The rows come as the unit makes them: this machine's clock tells when it was powered on.
    pub live: bool,
}

impl Head {
    /// The metadata lines.
    fn text(&self, first: &Second) -> String {
        let mut s = String::new();
        let unit = if self.unit.is_empty() { names::NONE } else { &self.unit };
        let _ = writeln!(s, "# hrg-recording: 1\n# unit: {unit}\n# run: recorded from the unit");
        // Restarts do not end what began at power-on. (A step's end and its time stamp differ by up to a second.)
        let start_s = f64::from(first.time_ms) / 1000.0;
        let before_s = f64::from(first.on_for_s) - start_s;
        let power_on_s = if before_s > RESTARTED_S { -before_s } else { 0.0 };
        let _ = writeln!(s, "# rate_unit: deg/h\n# rates: raw\n# calibration: {:08x}", first.calibration);
        let _ = writeln!(s, "# power_on_s: {power_on_s:.0}");
        let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap_or_default();
        if self.live {
            let _ = writeln!(s, "# power_on_unix_s: {:.3}", now.as_secs_f64() - start_s + power_on_s);
        }
        if let Some(attitude) = &self.attitude {
            let _ = writeln!(s, "# latitude_deg: {}\n# axes: {}", attitude.latitude_deg, attitude.axes_text());
        }
        if let Some(scale) = &self.scale_factor {
            let _ = writeln!(s, "# {SCALE_FACTOR}: {}", scale_text(scale));
        }
        s
    }
}

/// Writes a recording row by row: the file is valid at any moment.
#[derive(Debug)]
pub struct Recorder {
    base: PathBuf,
    /// Head of the next file.
    pub head: Head,
    /// Sensors beside the unit.
    pub sensors: Option<Sensors>,
    /// The unit has temperature sensors in the place of resonators.
    pub of_sensors: bool,
    file: Option<(std::fs::File, PathBuf)>,
    /// Bytes in it.
    length: u64,
    /// Inputs of the step that is coming, and those that have a column.
    used: InputsUsed,
    inputs: QuantitySet,
    /// The unit sends increments: the next file has columns for their mean specific force.
    pub with_force: bool,
    /// The file has them.
    force_columns: bool,
    /// Increments since the last second.
    increments: Force,
    last: Option<Second>,
    /// Milliseconds by which the unit's 32-bit counter has wrapped.
    wrapped_ms: u64,
    power_ons: u32,
    /// Each file written, the last one still.
    files: Vec<RecordedFile>,
}

/// Mean specific force of the increments of a second.
#[derive(Debug, Clone, Copy, Default)]
struct Force {
    velocity_mps: [f64; AXES],
    ticks: u64,
}

impl Force {
    fn add(&mut self, frame: &IncrementFrame) {
        self.velocity_mps.iter_mut().zip(frame.velocity_mps).for_each(|(sum, v)| *sum += f64::from(v));
        self.ticks += u64::from(frame.ticks);
    }

    /// m/s^2; NaN of an accelerometer that the unit does not have, or that was at its end, and of a second without increments.
    fn mean_mps2(&self) -> [f64; AXES] {
        let seconds = self.ticks as f64 / f64::from(Timebase::REFERENCE.ticks_per_s());
        self.velocity_mps.map(|v| if self.ticks == 0 { f64::NAN } else { v / seconds })
    }
}

/// A file, with its rows and the gaps that are marked in it.
#[derive(Debug)]
struct RecordedFile {
    path: PathBuf,
    rows: u64,
    gaps: u64,
}

impl Recorder {
    /// Will write to `path`; a unit that is powered on again goes on in `NAME-2.csv` and so on, because a recording is one
    /// power-on.
    #[must_use]
    pub fn new(path: &Path, unit: &str) -> Self {
        Self {
            base: path.to_path_buf(),
            head: Head { unit: unit.into(), ..Head::default() },
            sensors: None,
            of_sensors: false,
            file: None,
            length: 0,
            used: InputsUsed::default(),
            inputs: QuantitySet::empty(),
            increments: Force::default(),
            with_force: false,
            force_columns: false,
            last: None,
            wrapped_ms: 0,
            power_ons: 0,
            files: Vec::new(),
        }
    }

    fn columns(&self) -> &'static [Written<Second>] {
        if self.of_sensors {
            &COLUMNS_OF_SENSORS
        } else {
            &COLUMNS
        }
    }

    /// A line for each file: its rows, and the gaps that are marked in it.
    #[must_use]
    pub fn summary(&self) -> String {
        let each = self.files.iter().map(|RecordedFile { path, rows, gaps }| {
            let plural = |n: u64| if n == 1 { "" } else { "s" };
            format!("{}: {rows} row{}, {gaps} gap{} marked", path.display(), plural(*rows), plural(*gaps))
        });
        let mut lines: Vec<String> = each.collect();
        if lines.len() > 1 {
            lines.push("the unit started again: each power-on has a file of its own".into());
        }
        lines.join("\n")
    }

    /// Rows written since the start.
    #[must_use]
    pub fn rows(&self) -> u64 {
        self.files.iter().map(|f| f.rows).sum()
    }

    /// Gaps marked since the start.
    #[must_use]
    pub fn gaps(&self) -> u64 {
        self.files.iter().map(|f| f.gaps).sum()
    }

    /// The file being written.
    #[must_use]
    pub fn path(&self) -> Option<&Path> {
        self.file.as_ref().map(|(_, p)| p.as_path())
    }

    fn open(&mut self, second: &Second) -> Result<()> {
        self.power_ons += 1;
        let path = if self.power_ons == 1 {
            self.base.clone()
        } else {
            let stem = self.base.file_stem().unwrap_or_default().to_string_lossy();
            self.base.with_file_name(format!("{stem}-{}.csv", self.power_ons))
        };
        let file = hrg_data::output::create_new(&path).map_err(|e| {
            BadInput::new(match e.kind() {
                std::io::ErrorKind::AlreadyExists => {
                    format!(
                        "{} is there already; move it, or give another name: nothing is overwritten",
                        path.display()
                    )
                }
                _ => format!("cannot write {}: {e}", path.display()),
            })
        })?;
        // (A sensor beside the unit has the column of its name.)
        let beside = if self.sensors.is_some() { QuantitySet::CASES } else { QuantitySet::empty() };
        self.inputs = second.inputs_there().difference(beside);
        let names = names_of(self.inputs);
        let mut head = self.head.text(second);
        self.force_columns = self.with_force || self.increments.ticks > 0;
        if self.force_columns && self.head.raw_forces {
            let _ = writeln!(head, "# {FORCES}: raw");
        }
        // (The log does not tell of inputs.)
        if self.head.live || !names.is_empty() {
            let listed = if names.is_empty() { NO_INPUTS.to_string() } else { names.join(", ") };
            let _ = writeln!(head, "# {UNIT_INPUTS}: {listed}");
        }
        head.push_str(&columns::header(self.columns(), &EACH_AXIS));
        names.iter().for_each(|name| head.extend([",", name]));
        if self.sensors.is_some() {
            sensors::COLUMNS.iter().flat_map(|c| c.names).for_each(|name| head.extend([",", name]));
        }
        if self.force_columns {
            columns::FORCE.names.iter().for_each(|name| head.extend([",", name]));
        }
        head.push('\n');
        self.files.push(RecordedFile { path: path.clone(), rows: 0, gaps: 0 });
        self.file = Some((file, path));
        self.length = 0;
        self.append(&head)
    }

    /// Adds all of a text to the file, or nothing: what a full disk has cut short is taken off again.
    fn append(&mut self, text: &str) -> Result<()> {
        let rows = self.rows();
        let Some((file, path)) = &mut self.file else { return Ok(()) };
        if let Err(e) = file.write_all(text.as_bytes()) {
            let _ = file.set_len(self.length);
            return Err(e).with_context(|| {
                format!("cannot write {}; its {} rows so far stay; make room and record on", path.display(), rows)
            });
        }
        self.length += text.len() as u64;
        Ok(())
    }

    /// Takes the inputs of a model step; its housekeeping comes after it.
    pub fn take_inputs(&mut self, used: InputsUsed) {
        self.used = used;
    }

    /// Takes increments; the housekeeping of their second comes after them. (It ends some 30 ms before the last of them.)
    pub fn take_increments(&mut self, frame: &IncrementFrame) {
        self.increments.add(frame);
    }

    /// `true` if the inputs of that second have come.
    #[must_use]
    pub fn has_inputs_of(&self, h: &Housekeeping) -> bool {
        self.used.step == h.step
    }

    /// A second of a unit, with the inputs of its step; and the inputs that have come since the file was opened, and have no column in it.
    pub fn second(&self, h: &Housekeeping) -> (Second, Vec<&'static str>) {
        let mut second = Second::from(h);
        if self.has_inputs_of(h) {
            second.inputs = self.used.values;
        }
        let with_column = if self.file.is_some() { self.inputs } else { QuantitySet::all() };
        let late = names_of(second.inputs_there().difference(with_column));
        (second, late)
    }

    /// Takes a second. Rates are the raw ones, whatever image the unit runs.
    ///
    /// # Errors
    /// If the file cannot be written (a full disk): its contents stay.
    pub fn push(&mut self, second: &Second) -> Result<()> {
        let before = self.last;
        if let Some(last) = before {
            if second.time_ms == last.time_ms {
                return Ok(());
            }
            if second.time_ms < last.time_ms {
                // After 49.7 days the milliseconds begin again; before that, it is another power-on.
                if u64::from(second.time_ms) + (1 << 32) - u64::from(last.time_ms) <= WRAP_MS {
                    self.wrapped_ms += 1 << 32;
                } else {
                    self.wrapped_ms = 0;
                    self.file = None;
                }
            }
        }
        if self.file.is_none() {
            self.open(second)?;
        }
        let mut row = String::new();
        let now_s = (self.wrapped_ms + u64::from(second.time_ms)) as f64 / 1000.0;
        if let Some(last) = before.filter(|l| second.time_ms > l.time_ms && second.time_ms - l.time_ms > GAP_MS) {
            let last_s = (self.wrapped_ms + u64::from(last.time_ms)) as f64 / 1000.0;
            let _ = writeln!(row, "# gap: no data from {last_s} to {now_s} s");
        }
        let _ = write!(row, "{now_s}");
        columns::cells(&mut row, self.columns(), &EACH_AXIS, second);
        for v in self.inputs.numbers().map(|n| second.inputs[usize::from(n)]) {
            let _ = if v.is_finite() { write!(row, ",{v}") } else { write!(row, ",") };
        }
        for v in self.sensors.as_mut().map(|s| s.at(now_s)).iter().flatten() {
            let _ = if v.is_finite() { write!(row, ",{v}") } else { write!(row, ",") };
        }
        let force = std::mem::take(&mut self.increments);
        for v in force.mean_mps2().iter().filter(|_| self.force_columns) {
            let _ = if v.is_finite() { write!(row, ",{v:.7}") } else { write!(row, ",") };
        }
        row.push('\n');
        self.append(&row)?;
        if let Some(file) = self.files.last_mut() {
            file.rows += 1;
            file.gaps += u64::from(row.starts_with("# gap"));
        }
        self.last = Some(*second);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn second(time_ms: u32) -> Second {
        Second {
            time_ms,
            frequency_hz: [4898.626, f64::NAN, 4702.343],
            raw_dph: [1.5, -2.25, f32::NAN],
            temperature_c: [6.3, 4.9, 5.0],
            bias_dph: [0.125, 0.0, -1.0],
            bias_std_dph: [f32::NAN; 3],
            status: [0, 8, 0, 1],
            on_for_s: 78.0,
            inputs: [f32::NAN; QUANTITIES],
            calibration: 0xDEAD_BEEF,
        }
    }

    #[test]
    fn a_log_line_is_the_second_that_it_says() {
        let text = "0.98 INFO  t=78000 on=78 f=4898.626,NaN,4702.343 T=6.3,4.9,5 dT=0,1,-1 b=0.125,0,-1 raw=1.5,-2.25,NaN status=00,08,00,01 cal=deadbeef no=3 made=0 mode=0";
        let s = Second::from_log(text).expect("a second");
        assert_eq!(format!("{s:?}"), format!("{:?}", second(78_000)));
        for broken in ["", "boot", &text[..80], "t=abc f=1,2,3", &text.replace("f=", "g=")] {
            assert!(Second::from_log(broken).is_none(), "{broken}");
        }
        let boot = "INFO  hrg firmware 0.1.0: unit HRG-7, calibration deadbeef no. 3, status 00";
        assert_eq!(unit_in_log(boot), Some("HRG-7"));
    }

    #[test]
    fn increments_become_the_mean_specific_force_of_a_second() {
        let path = std::env::temp_dir().join(format!("hrg-record-force-{}.csv", std::process::id()));
        let _ = std::fs::remove_file(&path);
        let mut r = Recorder::new(&path, "HRG-7");
        let mut tenth = IncrementFrame::default();
        (tenth.ticks, tenth.velocity_mps) = (9_000_000, [0.981, 0.0, f32::NAN]);
        for k in 1..200u32 {
            // (A second without any is a gap in the column.)
            (0..10).filter(|_| k != 8).for_each(|_| r.take_increments(&tenth));
            // (The unit has been told to send none, as its identity says: the file keeps its columns.)
            r.with_force = k < 150;
            r.push(&second(k * 1000)).expect("written");
        }
        let text = std::fs::read_to_string(&path).expect("there");
        let again = hrg_data::recording::Recording::parse(text.as_bytes()).expect("a recording");
        let x = again.column("force_x_mps2").expect("there");
        assert!((x[3] - 9.81).abs() < 1e-6 && x[7].is_nan() && again.column("force_y_mps2").expect("there")[3] == 0.0);
        assert!(again.column("force_z_mps2").is_none_or(|z| z[3].is_nan()));
    }

    #[test]
    fn fifty_days_are_one_recording() {
        let folder = std::env::temp_dir().join(format!("hrg-record-wrap-{}", std::process::id()));
        let _ = std::fs::remove_dir_all(&folder);
        std::fs::create_dir_all(&folder).expect("a folder");
        let mut r = Recorder::new(&folder.join("run.csv"), "HRG-7");
        for k in 0..10u32 {
            r.push(&second((u32::MAX - 4_500).wrapping_add(k * 1000))).expect("written");
        }
        assert!(!folder.join("run-2.csv").exists());
        let text = std::fs::read_to_string(folder.join("run.csv")).expect("there");
        let again = hrg_data::recording::Recording::parse(text.as_bytes()).expect("a recording");
        assert_eq!(again.time_s.len(), 10);
        assert!(again.time_s.windows(2).all(|w| (w[1] - w[0] - 1.0).abs() < 1e-6), "{:?}", again.time_s);
    }

    #[test]
    fn a_unit_with_sensors_gives_a_recording_with_sensors() {
        let path = std::env::temp_dir().join(format!("hrg-record-sensors-{}.csv", std::process::id()));
        let _ = std::fs::remove_file(&path);
        let mut r = Recorder::new(&path, "FOG-7");
        r.of_sensors = true;
        for k in 1..200 {
            let y = if k == 8 { f64::NAN } else { 21.5 };
            r.push(&Second { frequency_hz: [20.25, y, -3.5], raw_dph: [1.5; 3], ..second(k * 1000) }).expect("written");
        }
        let again = hrg_data::recording::Recording::load(&path).expect("a recording");
        assert_eq!(again.thermometer, hrg_data::recording::thermometer::Thermometer::Sensors);
        assert_eq!((again.frequency_hz[0][7], again.frequency_hz[2][7]), (20.25, -3.5));
        assert!(again.frequency_hz[1][7].is_nan());
    }

    #[test]
    fn gaps_are_marked_power_ons_parted_and_nothing_overwritten() {
        let folder = std::env::temp_dir().join(format!("hrg-record-{}", std::process::id()));
        let _ = std::fs::remove_dir_all(&folder);
        std::fs::create_dir_all(&folder).expect("a folder");
        let path = folder.join("run.csv");
        let mut r = Recorder::new(&path, "HRG-7");
        for k in (1..200).chain(260..400) {
            r.push(&second(k * 1000)).expect("written");
        }
        r.push(&second(399_000)).expect("a repeated second is one");
        for k in 1..200 {
            r.push(&second(k * 1000)).expect("written");
        }
        assert_eq!((r.rows(), r.gaps()), (199 + 140 + 199, 1));
        let summary = r.summary();
        assert!(
            summary.contains("run.csv: 339 rows, 1 gap marked")
                && summary.contains("run-2.csv: 199 rows, 0 gaps marked"),
            "{summary}"
        );
        let text = std::fs::read_to_string(&path).expect("there");
        assert!(text.contains("# gap: no data from 199 to 260 s"));
        let again = hrg_data::recording::Recording::parse(text.as_bytes()).expect("a recording");
        assert_eq!((again.time_s.len(), again.unit()), (339, "HRG-7"));
        assert!(again.notes.iter().all(|n| n.contains("missing")), "{:?}", again.notes);
        assert!(folder.join("run-2.csv").exists());
        let e = Recorder::new(&path, "HRG-7").push(&second(1000)).expect_err("refused");
        assert!(e.to_string().contains("is there already"), "{e}");
    }
}
