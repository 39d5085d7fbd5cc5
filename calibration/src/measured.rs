//! The loop closed on measured data: the recordings of host-tests/recordings/measured, through every method and the trace.
//!
//! What is known of these files, and what the figures mean, is in docs/measured.md. Nothing here is tuned to them.

use crate::fit::method::Method;
use crate::fit::methods;
use crate::fit::{self, MEAN_S};
use crate::numeric::stats::{block_means, mean, std_dev};
use crate::recording::import::{self, map::Map};
use crate::recording::steps::Steps;
use crate::recording::Recording;
use crate::thermometer::points::{self, Points};
use crate::trace::{self, VerdictKind};
use crate::{BadInput, AXIS_NAMES, MOST_RECORDING};
use hrg_core::AXES;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

/// Rows of imu_raw_data that are learnt from, at one a second; the last cooling is kept back.
pub const IMU_TRAIN_S: f64 = 6500.0;

/// Rows of each half of gpsdo.short.
const GPSDO_HALF: usize = 10_000;

/// Modes of the quartz that are each other's thermometers: the other two hardly depend on temperature.
const MODES: [&str; AXES] = ["A100", "B100", "B300"];

/// Reads one of the measured recordings by the map beside it.
///
/// # Errors
/// Where the folder does not hold it.
pub fn load(folder: &Path, name: &str) -> anyhow::Result<Recording> {
    let path = folder.join(format!("{name}.toml"));
    let text = crate::read_file(&path, crate::MOST_CALIBRATION, true)?;
    let map = Map::parse(&String::from_utf8_lossy(&text)).map_err(|e| BadInput(format!("{}: {e}", path.display())))?;
    let mut r = import::read(&folder.join(format!("{name}.csv.gz")), &map)?;
    r.clean()?;
    r.source = name.into();
    Ok(r)
}

/// What a residual comes to on an axis: standard deviation and root mean square of its 100 s means.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Figure {
    /// About their own mean.
    pub deviation: f64,
    /// About zero.
    pub rms: f64,
}

impl Figure {
    /// Of a residual on every step, less a constant.
    #[must_use]
    pub fn of(residual: &[f64], constant: f64) -> Self {
        let means: Vec<f64> =
            block_means(residual, MEAN_S).into_iter().filter(|m| m.is_finite()).map(|m| m - constant).collect();
        let rms = (means.iter().map(|m| m * m).sum::<f64>() / means.len().max(1) as f64).sqrt();
        Self { deviation: std_dev(&means), rms }
    }
}

/// One row: a method and its figures by axis; `None` for axes that are not there.
#[derive(Debug, Clone)]
pub struct Row {
    /// Name.
    pub method: String,
    /// By axis.
    pub axes: [Option<Figure>; AXES],
}

/// Every method on a train and a verify run. Methods that cannot be used come back as sentences.
///
/// # Errors
/// Recordings that cannot be used.
pub fn rows(train: &Recording, verify: &Recording) -> Result<(Vec<Row>, Vec<String>, trace::Report), BadInput> {
    let prepared = fit::prepare(std::slice::from_ref(train))?;
    let steps = Steps::new(verify)?;
    let by_axis = |residual: &[Vec<f64>; AXES], constant: [f64; AXES]| {
        [0, 1, 2].map(|a: usize| (!steps.absent[a]).then(|| Figure::of(&residual[a], constant[a])))
    };
    // A constant bias is the least that anybody takes off.
    let constant = [0, 1, 2].map(|a: usize| mean(&prepared.runs[0].steps.rate_dph[a]));
    let mut rows = vec![Row { method: "raw".into(), axes: by_axis(&steps.rate_dph, constant) }];
    let mut left_out = Vec::new();
    for method in Method::ALL {
        match methods::identify(&prepared, method, 1) {
            Ok(found) => {
                let axes = by_axis(&fit::correct(&found.calibration, &steps), [0.0; AXES]);
                rows.push(Row { method: method.name().into(), axes });
            }
            Err(e) => left_out.push(format!("{method}: {e}")),
        }
    }
    let t = trace::trace(std::slice::from_ref(train), verify)?;
    rows.push(Row { method: "trace".into(), axes: by_axis(&fit::correct(&t.image, &steps), [0.0; AXES]) });
    Ok((rows, left_out, t.report))
}

fn table(rows: &[Row], unit: &str, present: &[usize], digits: usize) -> String {
    let mut s = format!("   {:<14}", format!("[{unit}]"));
    for a in present {
        let _ = write!(s, "{:>12}{:>12}", format!("{} sd", AXIS_NAMES[*a]), format!("{} rms", AXIS_NAMES[*a]));
    }
    s.push('\n');
    for r in rows {
        let _ = write!(s, "   {:<14}", r.method);
        for a in present {
            match r.axes[*a] {
                Some(f) => {
                    let _ = write!(s, "{:>12.digits$}{:>12.digits$}", f.deviation, f.rms);
                }
                None => s.push_str("           -           -"),
            }
        }
        s.push('\n');
    }
    s
}

/// What a trace names, in a line.
fn named(r: &trace::Report) -> String {
    let kind = match r.verdict_kind {
        VerdictKind::NothingLacks => "nothing-lacks",
        VerdictKind::Confirmed => "confirmed",
        VerdictKind::NotConfirmed => "not-confirmed",
        VerdictKind::Unexplained => "unexplained",
    };
    let names: Vec<&str> = r.effects.iter().map(|e| e.name.as_str()).collect();
    let left: Vec<String> = r.floor_ratio.iter().map(|(n, f)| format!("{n} {f}")).collect();
    format!("verdict {kind}; named: {}; left: {}", crate::list(&names), left.join("; "))
}

/// The MEMS IMU: learnt from the first part of its log, judged on the last cooling, with states carried through.
///
/// # Errors
/// Where the file is not there.
pub fn imu(folder: &Path) -> anyhow::Result<String> {
    let whole = load(folder, "imu_raw_data")?;
    let (train, verify) = whole.split(IMU_TRAIN_S)?;
    let (rows, left_out, report) = rows(&train, &verify)?;
    let present: Vec<usize> = verify.present().collect();
    let mut s = format!(
        "imu_raw_data: learnt from rows up to {IMU_TRAIN_S:.0}, judged on the last cooling ({} rows), states carried through\n   standard deviation and RMS of 100 s means; raw less the mean of the train rows\n",
        whole.time_s.len() - IMU_TRAIN_S as usize
    );
    s += &table(&rows, "deg/h", &present, 0);
    left_out.iter().for_each(|l| s += &format!("   not usable here: {l}\n"));
    s += &format!("   trace: {}\n", named(&report));
    Ok(s)
}

/// Halves of a recording as two of their own.
fn halves(r: &Recording, rows: usize) -> Result<[Recording; 2], BadInput> {
    let at = *r.time_s.get(rows).ok_or_else(|| BadInput::new("the recording is shorter than its halves"))?;
    let (first, second) = r.split(at)?;
    Ok([first, second.judged_part()].map(|mut h| {
        h.source = format!("{} from {:.0} s", r.source, h.time_s[0]);
        h
    }))
}

/// The quartz oscillator: each half learnt from, the other judged on.
///
/// # Errors
/// Where the file is not there.
pub fn gpsdo(folder: &Path) -> anyhow::Result<String> {
    let whole = load(folder, "gpsdo.short")?;
    let [first, second] = halves(&whole, GPSDO_HALF)?;
    let mut s = format!(
        "gpsdo.short: {} rows, each half judged by the other; ppb of frequency in the place of deg/h\n",
        whole.time_s.len()
    );
    let mut classes = Vec::new();
    for (train, verify, name) in [
        (&first, &second, "first half learnt from, second judged"),
        (&second, &first, "second half learnt from, first judged"),
    ] {
        let (rows, left_out, report) = rows(train, verify)?;
        s += &format!(" {name}\n");
        s += &table(&rows, "ppb", &[0], 3);
        left_out.iter().for_each(|l| s += &format!("   not usable here: {l}\n"));
        s += &format!("   trace: {}\n", named(&report));
        let mut named: Vec<&str> = report.effects.iter().map(|e| e.class.name()).collect();
        named.sort_unstable();
        named.dedup();
        classes.push(named.join(", "));
    }
    let same = if classes[0] == classes[1] { "the same classes" } else { "other classes" };
    s += &format!(" swap test: {same} both ways ([{}] and [{}])\n", classes[0], classes[1]);
    Ok(s)
}

/// Soaks of three modes of one quartz body, by orientation.
///
/// # Errors
/// Where the file is not there, or is another table.
pub fn modes(folder: &Path) -> anyhow::Result<BTreeMap<String, Points>> {
    let path = folder.join("uberclock-peaks.csv.gz");
    let bytes = crate::read_file(&path, MOST_RECORDING, true)?;
    let text = String::from_utf8_lossy(&bytes);
    let mut soaks: BTreeMap<String, BTreeMap<i64, [f64; AXES]>> = BTreeMap::new();
    for line in text.lines().skip(1) {
        let cells: Vec<&str> = line.split(',').collect();
        let [orientation, mode, chamber, _, peak, ..] = cells[..] else { continue };
        let Some(axis) = MODES.iter().position(|m| *m == mode) else { continue };
        let number =
            |t: &str| t.parse::<f64>().map_err(|_| BadInput(format!("{}: \"{t}\" is not a number", path.display())));
        let soak =
            soaks.entry(orientation.into()).or_default().entry(number(chamber)? as i64).or_insert([f64::NAN; AXES]);
        soak[axis] = number(peak)?;
    }
    soaks
        .into_iter()
        .map(|(orientation, soaks)| {
            let mut csv = "chamber_c,fx_hz,fy_hz,fz_hz\n".to_string();
            for (t, f) in soaks {
                let _ = writeln!(csv, "{t},{},{},{}", f[0], f[1], f[2]);
            }
            Ok((orientation, Points::parse(&csv)?))
        })
        .collect()
}

/// The quartz of five modes: three of them as each other's thermometers.
///
/// # Errors
/// As [`modes`].
pub fn uberclock(folder: &Path) -> anyhow::Result<String> {
    let mut s = format!(
        "uberclock: one quartz, modes {} as each other's thermometers (hrg points), 20 to 65 C\n   {:<12}{:<12}{:>24}{:>22}{:>12}{:>10}\n",
        crate::list(&MODES),
        "orientation",
        "modes",
        "against the chamber [C]",
        "by the other [C]",
        "correlation",
        "p-value"
    );
    for (orientation, p) in modes(folder)? {
        let report = points::report(&p)?;
        for pair in report.each_other {
            let mode = |n: &str| MODES[AXIS_NAMES.iter().position(|a| *a == n).unwrap_or(0)];
            let two = |v: [f64; 2]| format!("{:.3} / {:.3}", v[0], v[1]);
            let _ = writeln!(
                s,
                "   {orientation:<12}{:<12}{:>24}{:>22}{:>12.2}{:>10.1e}",
                format!("{} {}", mode(&pair.axes[0]), mode(&pair.axes[1])),
                two(pair.against_chamber_rms_c),
                two(pair.by_the_other_rms_c),
                pair.correlation,
                pair.p_value
            );
        }
        for e in report.effects {
            let _ = writeln!(
                s,
                "   {orientation:<12}found: {} against the {} (p-value {:.1e})",
                e.name, e.reference, e.p_value
            );
        }
    }
    Ok(s)
}
