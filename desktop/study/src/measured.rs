//! The loop closed on measured data: the recordings of host-tests/recordings/measured, through every method and the trace.
//!
//! The origin of these files, and the meaning of the figures, are in docs/measured.md. Nothing here is tuned to them.

use hrg_core::calibration::Calibration;
use hrg_core::AXES;
use hrg_data::axes::AXIS_NAMES;
use hrg_data::error::BadInput;
use hrg_data::files::MOST_RECORDING;
use hrg_data::numeric::stats::{block_means, mean, quantile, std_dev};
use hrg_data::plot::{svg, Panel, Series};
use hrg_data::recording::import;
use hrg_data::recording::import::map::Map;
use hrg_data::recording::steps::Steps;
use hrg_data::recording::Recording;
use hrg_identify::fit;
use hrg_identify::fit::MEAN_S;
use hrg_identify::thermometer::points;
use hrg_identify::thermometer::points::Points;
use hrg_identify::trace;
use hrg_identify::trace::report::{AxisModel, OnVerify};
use hrg_identify::trace::VerdictKind;
use hrg_papers::method::Method;
use hrg_papers::methods;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

/// Rows of imu_raw_data that are learnt from in the picture, at one a second; the last cooling is kept back.
pub const IMU_TRAIN_S: f64 = 6500.0;

/// The same for the figures: no one cut of a log says what a method does, so each figure is a median with its range over these.
pub const IMU_SPLITS_S: [f64; 7] = [6200.0, 6300.0, 6400.0, 6500.0, 6600.0, 6700.0, 6800.0];

/// Ends of the parts of voltmeter-1v that are learnt from, s, of 38 h.
pub const VOLTMETER_SPLITS_S: [f64; 5] = [60_000.0, 64_000.0, 68_000.0, 72_000.0, 76_000.0];

/// Ends of the parts of gpsdo.short that are learnt from, s, of 61 h.
pub const GPSDO_SPLITS_S: [f64; 5] = [90_000.0, 100_000.0, 110_000.0, 120_000.0, 130_000.0];

/// Rows of each half of gpsdo.short, for the swap.
const GPSDO_HALF: usize = 10_000;

/// Modes of the quartz that are each other's thermometers: the other two hardly depend on temperature.
const MODES: [&str; AXES] = ["A100", "B100", "B300"];

/// Reads one of the measured recordings by the map beside it.
///
/// # Errors
/// If the folder does not hold it.
pub fn load(folder: &Path, name: &str) -> anyhow::Result<Recording> {
    let path = folder.join(format!("{name}.toml"));
    let text = hrg_data::files::read_file(&path, hrg_data::files::MOST_CALIBRATION, true)?;
    let map = Map::parse(&String::from_utf8_lossy(&text)).map_err(|e| BadInput(format!("{}: {e}", path.display())))?;
    let mut r = import::read(&folder.join(format!("{name}.csv.gz")), &map)?;
    r.clean()?;
    r.source = name.into();
    Ok(r)
}

/// Figures of a residual on an axis: standard deviation and root mean square of its 100 s means.
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

/// Results of methods and of the trace on a train and a verify run.
#[derive(Debug)]
pub struct Compared {
    /// Raw, each method, the trace.
    pub rows: Vec<Row>,
    /// The images behind the rows after the first.
    pub images: Vec<Calibration>,
    /// Mean rate of the train run by axis: what stands for a calibration where there is none, deg/h.
    pub constant_dph: [f64; AXES],
    /// Methods that cannot be used: a sentence each.
    pub left_out: Vec<String>,
    /// The trace.
    pub report: trace::Report,
}

/// Some methods and the trace on a train and a verify run.
///
/// # Errors
/// Recordings that cannot be used.
pub fn compare(train: &Recording, verify: &Recording, of: &[Method]) -> Result<Compared, BadInput> {
    let prepared = fit::prepare(std::slice::from_ref(train))?;
    let steps = Steps::new(verify)?;
    let by_axis = |residual: &[Vec<f64>; AXES], constant: [f64; AXES]| {
        [0, 1, 2].map(|a: usize| (!steps.absent[a]).then(|| Figure::of(&residual[a], constant[a])))
    };
    // A constant bias is the least that anybody takes off.
    let constant_dph = [0, 1, 2].map(|a: usize| mean(&prepared.runs[0].steps.rate_dph[a]));
    let mut rows = vec![Row { method: "raw".into(), axes: by_axis(&steps.rate_dph, constant_dph) }];
    let (mut images, mut left_out) = (Vec::new(), Vec::new());
    for method in of {
        match methods::identify(&prepared, *method, 1) {
            Ok(found) => {
                let axes = by_axis(&fit::correct(&found.calibration, &steps), [0.0; AXES]);
                rows.push(Row { method: method.name().into(), axes });
                images.push(found.calibration);
            }
            Err(e) => left_out.push(format!("{method}: {e}")),
        }
    }
    let t = trace::trace(std::slice::from_ref(train), verify)?;
    rows.push(Row { method: "trace".into(), axes: by_axis(&fit::correct(&t.image, &steps), [0.0; AXES]) });
    images.push(t.image);
    Ok(Compared { rows, images, constant_dph, left_out, report: t.report })
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

/// A method's figures over several splits.
struct Band {
    method: String,
    /// By axis: standard deviations and root mean squares.
    axes: [[Vec<f64>; 2]; AXES],
}

impl Band {
    /// Figures of the same method in each of some comparisons.
    fn of(all: &[Compared]) -> Vec<Self> {
        let names = all.first().map_or(&[][..], |c| &c.rows[..]).iter().map(|r| r.method.clone());
        names
            .map(|method| {
                let rows = || all.iter().filter_map(|c| c.rows.iter().find(|r| r.method == method));
                let axes = [0, 1, 2].map(|a: usize| {
                    [
                        rows().filter_map(|r| Some(r.axes[a]?.deviation)).collect(),
                        rows().filter_map(|r| Some(r.axes[a]?.rms)).collect(),
                    ]
                });
                Self { method, axes }
            })
            .collect()
    }
}

/// Median and range of some figures.
fn band(values: &[f64], digits: usize) -> String {
    let (low, high) = values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v)));
    if values.is_empty() {
        return "-".into();
    }
    format!("{:.digits$} [{low:.digits$}, {high:.digits$}]", quantile(values, 0.5))
}

fn band_table(rows: &[Band], unit: &str, present: &[usize], digits: usize) -> String {
    let mut s = format!("   {:<22}", format!("[{unit}]"));
    for a in present {
        let _ = write!(s, "{:>20}{:>22}", format!("{} sd", AXIS_NAMES[*a]), format!("{} rms", AXIS_NAMES[*a]));
    }
    s.push('\n');
    for r in rows {
        let _ = write!(s, "   {:<22}", r.method);
        for a in present {
            let [deviation, rms] = r.axes[*a].each_ref().map(|v| band(v, digits));
            let _ = write!(s, "{deviation:>20}{rms:>22}");
        }
        s.push('\n');
    }
    s
}

/// Names that a trace gives, in a line.
fn named(r: &trace::Report) -> String {
    let kind = match r.verdict_kind {
        VerdictKind::NothingLacks => "nothing-lacks",
        VerdictKind::Confirmed => "confirmed",
        VerdictKind::NotConfirmed => "not-confirmed",
        VerdictKind::Unexplained => "unexplained",
    };
    let confirmed = |e: &trace::report::Found| if e.confirmed == Some(true) { " (confirmed)" } else { "" };
    let names: Vec<String> = r.effects.iter().map(|e| format!("{}{}", e.name, confirmed(e))).collect();
    let left: Vec<String> = r.floor_ratio.iter().map(|(n, f)| format!("{n} {f}")).collect();
    format!("verdict {kind}; named: {}; left: {}", hrg_data::error::list(&names), left.join("; "))
}

/// Advice and names of the trace at each split.
fn advice(at_s: &[f64], all: &[Compared]) -> String {
    let line = |(at_s, c): (&f64, &Compared)| {
        let burn = if c.report.burn { "burn" } else { "do not burn" };
        format!("   trace, split at {at_s:.0}: {burn}; {}\n", named(&c.report))
    };
    at_s.iter().zip(all).map(line).collect()
}

/// The MEMS IMU: learnt from the first part of its log, judged on the last cooling, with states carried through, for several splits.
///
/// # Errors
/// If the file is not there.
pub fn imu(folder: &Path) -> anyhow::Result<String> {
    let whole = load(folder, "imu_raw_data")?;
    let all = splits(&whole, &IMU_SPLITS_S, &Method::ALL)?;
    let present: Vec<usize> = whole.present().collect();
    let [first, .., last] = IMU_SPLITS_S;
    let mut s = format!(
        "imu_raw_data: {} rows; learnt from the first {first:.0} to {last:.0} ({} splits), judged on the rest, the last cooling, states carried through\n   standard deviation and RMS of 100 s means: median [range] over the splits; raw less the mean of the train rows\n",
        whole.time_s.len(),
        IMU_SPLITS_S.len()
    );
    s += &band_table(&Band::of(&all), "deg/h", &present, 0);
    if let Some(c) = all.first() {
        c.left_out.iter().for_each(|l| s += &format!("   not usable here: {l}\n"));
    }
    for (at_s, c) in IMU_SPLITS_S.iter().zip(&all) {
        s += &format!("   trace, split at {at_s:.0}: {}\n", named(&c.report));
    }
    Ok(s)
}

/// Methods and the trace on each split of a log.
fn splits(whole: &Recording, at_s: &[f64], of: &[Method]) -> anyhow::Result<Vec<Compared>> {
    let one = |at_s: &f64| {
        let (train, verify) = whole.split(*at_s)?;
        Ok(compare(&train, &verify, of)?)
    };
    at_s.iter().map(one).collect()
}

/// The loop on the IMU in short: raw, eq 7 and the trace, as a table and as a picture of the whole log.
#[derive(Debug)]
pub struct InShort {
    /// The table, as plain text.
    pub table: String,
    /// Caption of the picture, in lines.
    pub caption: String,
    /// The picture (SVG).
    pub picture: String,
}

/// Figures of some methods in a sentence: standard deviations (0), or root mean squares (1).
fn in_words(rows: &[Band], present: &[usize], pick: usize) -> String {
    let by_row = rows.iter().map(|r| {
        let axes: Vec<String> = present.iter().map(|a| band(&r.axes[*a][pick], 0)).collect();
        format!("{} {}", r.method, axes.join(" / "))
    });
    by_row.collect::<Vec<_>>().join("; ")
}

/// The same of the two voltmeters, without a picture: table and caption.
///
/// # Errors
/// If the file is not there.
pub fn voltmeter_in_short(folder: &Path) -> anyhow::Result<(String, String)> {
    let whole = load(folder, "voltmeter-1v")?;
    let mut all = splits(&whole, &VOLTMETER_SPLITS_S, &[Method::Lsq])?;
    on_the_other(&whole, &mut all)?;
    let rows = Band::of(&all);
    let named = |method: &str, name: &str| {
        let row = rows.iter().find(|r| r.method == method);
        row.map(|r| Band { method: name.into(), axes: r.axes.clone() })
    };
    let own: Vec<Band> = [("raw", "raw"), ("lsq", "eq 7"), ("trace", "trace")]
        .into_iter()
        .filter_map(|(method, name)| named(method, name))
        .collect();
    let other: Vec<Band> = [("lsq, of the other", "eq 7"), ("trace, of the other", "trace")]
        .into_iter()
        .filter_map(|(m, n)| named(m, n))
        .collect();
    let burn = all.iter().filter(|c| c.report.burn).count();
    let [first, .., last] = VOLTMETER_SPLITS_S;
    let caption = format!(
        "Measured: two voltmeters in an air bath and a third outside it as control ({} rows, 38 h). The models are fitted to the first {first:.0} to {last:.0} s \
         ({} splits) and judged on the rest. Standard deviation of 100 s means there, the two instruments / the control, ppb, median [range] over the splits: {}. Root mean square, \
         the constant included: {}. The model of one instrument on the other, about the mean: {}. The trace recommends its image at {burn} of {} splits.",
        whole.time_s.len(),
        VOLTMETER_SPLITS_S.len(),
        in_words(&own, &[0, 1, 2], 0),
        in_words(&own, &[0, 1, 2], 1),
        in_words(&other, &[0, 1], 0),
        all.len()
    );
    Ok((band_table(&own, "ppb", &[0, 1, 2], 0), wrapped(&caption)))
}

/// Contents of the first page, which the demo prints, too.
///
/// # Errors
/// If the file is not there.
pub fn imu_in_short(folder: &Path) -> anyhow::Result<InShort> {
    let whole = load(folder, "imu_raw_data")?;
    let all = splits(&whole, &IMU_SPLITS_S, &[Method::Lsq])?;
    let present: Vec<usize> = whole.present().collect();
    let names = ["raw", "eq 7", "trace"];
    let rows: Vec<Band> = Band::of(&all).into_iter().zip(names).map(|(r, n)| Band { method: n.into(), ..r }).collect();
    let own = IMU_SPLITS_S.iter().position(|s| *s == IMU_TRAIN_S).and_then(|k| all.get(k));
    let c = own.ok_or_else(|| BadInput::new("the split of the picture is none of those of the figures"))?;
    let plain = |(n, b): (&String, &OnVerify)| (b.model == AxisModel::Baseline).then(|| n.clone());
    let plain: Vec<String> = c.report.block.iter().flatten().filter_map(plain).collect();
    let plain = if plain.is_empty() {
        String::new()
    } else {
        format!(
            " On {} the remaining rows confirm no effect, so the calibration image of that axis is eq 7.",
            hrg_data::error::list(&plain)
        )
    };
    let [first, .., last] = IMU_SPLITS_S;
    let caption = format!(
        "Measured: a MEMS IMU through a temperature cycle ({} rows; its source states neither origin nor time scale). The models are fitted to the first \
         {first:.0} to {last:.0} rows ({} splits) and judged on the remaining rows, the last cooling. Standard deviation of 100-row means there, x / y / z, \
         deg/h, median [range] over the splits: {}. Root mean square, the constant included: {}. The picture, and the trace at \
         {IMU_TRAIN_S:.0}: {}.{plain}",
        whole.time_s.len(),
        IMU_SPLITS_S.len(),
        in_words(&rows, &present, 0),
        in_words(&rows, &present, 1),
        named(&c.report)
    );
    Ok(InShort {
        table: band_table(&rows, "deg/h", &present, 0),
        caption: wrapped(&caption),
        picture: picture(&whole, c, names)?,
    })
}

/// Lines of at most this many characters in pages.
const LINE: usize = 140;

/// A text in lines.
fn wrapped(text: &str) -> String {
    let (mut out, mut width) = (String::new(), 0);
    for word in text.split(' ') {
        let long = word.chars().count();
        if width > 0 {
            let wraps = width + 1 + long > LINE;
            out.push(if wraps { '\n' } else { ' ' });
            width = if wraps { 0 } else { width + 1 };
        }
        out += word;
        width += long;
    }
    out
}

/// The rates of the whole log before and after, learnt and kept back, an axis in each panel.
fn picture(whole: &Recording, c: &Compared, names: [&str; 3]) -> anyhow::Result<String> {
    let steps = Steps::new(whole)?;
    let corrected: Vec<[Vec<f64>; AXES]> = c.images.iter().map(|image| fit::correct(image, &steps)).collect();
    let line = |rate: &[f64], constant: f64| -> Vec<(f64, f64)> {
        let means = block_means(rate, MEAN_S).into_iter().enumerate();
        means.map(|(k, m)| ((k as f64 + 0.5) * MEAN_S as f64, m - constant)).collect()
    };
    let panels: Vec<Panel> = whole
        .present()
        .map(|a| {
            let raw = line(&steps.rate_dph[a], c.constant_dph[a]);
            let (low, high) = raw
                .iter()
                .filter(|p| p.1.is_finite())
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), p| (l.min(p.1), h.max(p.1)));
            let mut series = vec![
                Series { label: names[0].into(), points: raw, colour: 0, dots: false },
                Series {
                    label: String::new(),
                    points: vec![(IMU_TRAIN_S, low), (IMU_TRAIN_S, high)],
                    colour: 3,
                    dots: false,
                },
            ];
            for ((rates, name), colour) in corrected.iter().zip(&names[1..]).zip([2, 1]) {
                series.push(Series { label: (*name).into(), points: line(&rates[a], 0.0), colour, dots: false });
            }
            Panel {
                title: format!("axis {}: learnt up to row {IMU_TRAIN_S:.0}, then kept back", AXIS_NAMES[a]),
                x: "row (measured)".into(),
                y: "mean of 100 rows [deg/h]".into(),
                log: false,
                series,
            }
        })
        .collect();
    svg(&panels, 3, 460, 360)
}

/// Two voltmeters in an air bath, and a third outside it as control: the log parted at several times, states carried through; then what was
/// learnt on one of the two, tried on the other.
///
/// # Errors
/// If the file is not there.
pub fn voltmeter(folder: &Path) -> anyhow::Result<String> {
    let whole = load(folder, "voltmeter-1v")?;
    let mut all = splits(&whole, &VOLTMETER_SPLITS_S, &Method::ALL)?;
    on_the_other(&whole, &mut all)?;
    let [first, .., last] = VOLTMETER_SPLITS_S;
    let mut s = format!(
        "voltmeter-1v: {} rows; learnt from the first {first:.0} to {last:.0} s ({} splits), judged on the rest, states carried through; ppb of one volt in the place of deg/h\n   x and y: in the air bath; z: the control outside; median [range] over the splits; raw less the mean of the train rows; of the other: the image of the other instrument, about its own mean\n",
        whole.time_s.len(),
        VOLTMETER_SPLITS_S.len()
    );
    s += &band_table(&Band::of(&all), "ppb", &[0, 1, 2], 0);
    Ok(s + &advice(&VOLTMETER_SPLITS_S, &all))
}

/// Adds rows: the images of one instrument, tried on the other.
fn on_the_other(whole: &Recording, all: &mut [Compared]) -> Result<(), BadInput> {
    for (c, at_s) in all.iter_mut().zip(VOLTMETER_SPLITS_S) {
        let (_, verify) = whole.split(at_s)?;
        let steps = Steps::new(&verify)?;
        // (The first image is that of the first method, the last that of the trace.)
        let tried = [("lsq, of the other", c.images.first()), ("trace, of the other", c.images.last())];
        for (name, image) in tried.map(|(n, i)| (n, i.cloned())) {
            let Some(image) = image else { continue };
            let residual = fit::correct(&of_the_other(image), &steps);
            // Each instrument has an offset of its own: about the mean of what is left.
            let figure = |a: usize| (a < 2).then(|| Figure::of(&residual[a], mean(&block_means(&residual[a], MEAN_S))));
            c.rows.push(Row { method: name.into(), axes: [0, 1, 2].map(figure) });
        }
    }
    Ok(())
}

/// An image with what it knows of x and y changed about.
fn of_the_other(mut image: Calibration) -> Calibration {
    image.axes.swap(0, 1);
    for term in &mut image.effects {
        term.gains.swap(0, 1);
        term.gain_std.swap(0, 1);
    }
    image
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

/// The quartz oscillator: the log parted at several times, states carried through; then each half learnt from and the other judged on, as
/// two runs of their own.
///
/// # Errors
/// If the file is not there.
pub fn gpsdo(folder: &Path) -> anyhow::Result<String> {
    let whole = load(folder, "gpsdo.short")?;
    let all = splits(&whole, &GPSDO_SPLITS_S, &Method::ALL)?;
    let [first, .., last] = GPSDO_SPLITS_S;
    let mut s = format!(
        "gpsdo.short: {} rows; learnt from the first {first:.0} to {last:.0} s ({} splits), judged on the rest, states carried through; ppb of frequency in the place of deg/h\n",
        whole.time_s.len(),
        GPSDO_SPLITS_S.len()
    );
    s += &band_table(&Band::of(&all), "ppb", &[0], 2);
    if let Some(c) = all.first() {
        c.left_out.iter().for_each(|l| s += &format!("   not usable here: {l}\n"));
    }
    s += &advice(&GPSDO_SPLITS_S, &all);
    let [first, second] = halves(&whole, GPSDO_HALF)?;
    let mut classes = Vec::new();
    for (train, verify, name) in [
        (&first, &second, "the halves as two runs, the first learnt from"),
        (&second, &first, "the same, the second learnt from"),
    ] {
        let c = compare(train, verify, &[Method::Lsq])?;
        s += &format!(" {name}\n{}   trace: {}\n", table(&c.rows, "ppb", &[0], 3), named(&c.report));
        let mut named: Vec<&str> = c.report.effects.iter().map(|e| e.class.name()).collect();
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
/// If the file is not there, or is another table.
pub fn modes(folder: &Path) -> anyhow::Result<BTreeMap<String, Points>> {
    let path = folder.join("uberclock-peaks.csv.gz");
    let bytes = hrg_data::files::read_file(&path, MOST_RECORDING, true)?;
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
        "uberclock: one quartz, modes {} as each other's thermometers (hrg fit points), 20 to 65 C\n   {:<12}{:<12}{:>24}{:>22}{:>12}{:>10}\n",
        hrg_data::error::list(&MODES),
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
