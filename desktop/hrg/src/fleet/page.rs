//! The page of a fleet.

use super::Row;
use hrg_data::axes::AXIS_NAMES;
use hrg_data::numeric::stats::{median, quantile};
use hrg_data::page::{boxed, folded, page, pictures, Tone};
use hrg_data::plot::{escape, Panel, Series};
use hrg_identify::trace::judge::DEVIATIONS;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;

/// Deviations from the median beyond which a figure is an outlier, the deviation by the median of all distances (Iglewicz and Hoaglin 1993: 3.5 of their
/// modified score).
const OUTLIER: f64 = 3.5;
/// Deviation of a normal distribution over the median of its distances.
const BY_MEDIAN: f64 = 1.4826;
/// Fewer values have no outliers.
const FEWEST: usize = 5;

/// A figure that is far from those of the other units.
#[derive(Debug, Clone, PartialEq)]
pub struct Outlier {
    /// Name of the unit.
    pub unit: String,
    /// Name of the figure.
    pub figure: String,
    /// Its value.
    pub value: f64,
    /// Median of all units.
    pub median: f64,
    /// Distance from it in deviations.
    pub deviations: f64,
}

/// The values of a figure by unit.
fn values<'r>(rows: &'r [Row], name: &str) -> Vec<(&'r Row, f64)> {
    rows.iter().filter_map(|r| Some((r, r.figure(name)?))).collect()
}

fn names(rows: &[Row]) -> BTreeSet<&String> {
    rows.iter().flat_map(|r| r.figures.keys()).collect()
}

/// Figures of units far from those of the others, the farthest first.
#[must_use]
pub fn outliers(rows: &[Row]) -> Vec<Outlier> {
    let mut out = Vec::new();
    for name in names(rows) {
        let all = values(rows, name);
        if all.len() < FEWEST {
            continue;
        }
        let middle = median(&mut all.iter().map(|v| v.1).collect::<Vec<_>>()).unwrap_or(f64::NAN);
        let mut off: Vec<f64> = all.iter().map(|v| (v.1 - middle).abs()).collect();
        let deviation = BY_MEDIAN * median(&mut off).unwrap_or(f64::NAN);
        for (row, value) in all {
            let deviations = (value - middle) / deviation;
            if deviation > 0.0 && deviations.abs() > OUTLIER {
                out.push(Outlier { unit: row.unit.clone(), figure: name.clone(), value, median: middle, deviations });
            }
        }
    }
    out.sort_by(|a, b| b.deviations.abs().total_cmp(&a.deviations.abs()));
    out
}

/// The shares of units at or below each value: a distribution without bins.
fn distribution(rows: &[Row], figure: &str) -> Option<Panel> {
    let series: Vec<Series> = AXIS_NAMES
        .iter()
        .enumerate()
        .filter_map(|(a, axis)| {
            let mut all: Vec<f64> = values(rows, &format!("{figure}_{axis}")).into_iter().map(|v| v.1).collect();
            all.sort_by(f64::total_cmp);
            let n = all.len() as f64;
            let steps = all.iter().enumerate().flat_map(|(k, v)| [(*v, k as f64 / n), (*v, (k as f64 + 1.0) / n)]);
            let points: Vec<(f64, f64)> = steps.collect();
            (all.len() > 1).then(|| Series { label: (*axis).to_string(), points, colour: a + 1, dots: false })
        })
        .collect();
    (!series.is_empty()).then(|| Panel {
        title: as_text(figure),
        x: unit_of(rows, figure),
        y: "share of the units at or below".into(),
        log: false,
        series,
    })
}

/// A figure's name without the letter of its axis.
fn stem(name: &str) -> Option<&str> {
    ["_x", "_y", "_z"].iter().find_map(|a| name.strip_suffix(a))
}

fn stems(rows: &[Row]) -> BTreeSet<String> {
    names(rows).into_iter().filter_map(|n| stem(n)).map(String::from).collect()
}

/// Begins of figures' names that need more words on a page.
const IN_WORDS: [(&str, &str); 3] = [
    ("image constant", "constant that the image leaves"),
    ("image", "left by the image"),
    ("baseline", "left by the baseline"),
];

/// A figure's name as text.
fn as_text(name: &str) -> String {
    let text = name.replace("_dph", "").replace('_', " ");
    let longer = IN_WORDS.iter().find_map(|(short, words)| Some(format!("{words}{}", text.strip_prefix(short)?)));
    longer.unwrap_or(text)
}

/// The unit of a figure.
fn unit_of(rows: &[Row], name: &str) -> String {
    let name = stem(name).unwrap_or(name);
    let own = rows.iter().find_map(|r| r.units.get(name)).map(String::as_str);
    own.unwrap_or(if name.ends_with("_dph") { "deg/h" } else { "" }).to_string()
}

/// Median and range of each figure, batch by batch.
fn batches(rows: &[Row]) -> String {
    let mut by_batch: BTreeMap<&str, Vec<&Row>> = BTreeMap::new();
    rows.iter().for_each(|r| by_batch.entry(&r.batch).or_default().push(r));
    if by_batch.len() < 2 {
        return String::new();
    }
    let mut s = String::from("<h2>Batches</h2><p class=small>Median of the units of a batch, with the range that holds it at 95 % (of order statistics); a batch is a folder.</p><div class=wide><table><tr><th>figure");
    by_batch.keys().for_each(|b| {
        let _ = write!(s, "<th>{}", escape(if b.is_empty() { "." } else { b }));
    });
    for name in names(rows) {
        let unit = unit_of(rows, name);
        let unit = if unit.is_empty() { unit } else { format!(" [{unit}]") };
        let _ = write!(s, "<tr><td>{}{}", escape(&as_text(name)), escape(&unit));
        for of in by_batch.values() {
            let all: Vec<f64> = of.iter().filter_map(|r| r.figure(name)).collect();
            if all.is_empty() {
                s.push_str("<td>");
                continue;
            }
            let half = 0.98 / (all.len() as f64).sqrt();
            let at = |p: f64| quantile(&all, p.clamp(0.0, 1.0));
            let _ =
                write!(s, "<td>{:.3} <span class=small>{:.3} to {:.3}</span>", at(0.5), at(0.5 - half), at(0.5 + half));
        }
    }
    s + "</table></div>"
}

/// The page: verdicts, distributions, outliers, batches, and a row for each unit.
///
/// # Errors
/// If the drawing library fails.
pub(super) fn html(title: &str, rows: &[Row]) -> anyhow::Result<String> {
    let bad: Vec<&Row> = rows.iter().filter(|r| !r.error.is_empty()).collect();
    let count = |of: &dyn Fn(&Row) -> &str| {
        let mut each: BTreeMap<String, usize> = BTreeMap::new();
        rows.iter().for_each(|r| *each.entry(of(r).to_string()).or_default() += 1);
        let words = each.into_iter().filter(|(w, _)| !w.is_empty()).map(|(w, n)| format!("{} {n}", escape(&w)));
        words.collect::<Vec<_>>().join(", ")
    };
    let mut s = format!("<h1>{}</h1>", escape(title));
    let (verdicts, passes) = (count(&|r| &r.verdict), count(&|r| &r.passes));
    let burn = rows.iter().filter(|r| r.burn).count();
    let passes = if passes.is_empty() { String::new() } else { format!("; limit: {passes}") };
    let text = format!(
        "<b>{} units</b>, {} with something that could not be used. Traces: {verdicts}; recommended {burn}{passes}.",
        rows.len(),
        bad.len()
    );
    s += &boxed(&text, if bad.is_empty() { Tone::Good } else { Tone::Open });
    let aged: Vec<&Row> = rows.iter().filter(|r| has_aged(r)).collect();
    if !aged.is_empty() {
        let units: Vec<String> = aged.iter().map(|r| escape(&r.unit)).collect();
        s += &boxed(&format!("<b>Calibrations that have aged</b>: what is left of the last run is more than {DEVIATIONS} times what is stated, on {}. One unit of twenty may come out so by chance.", units.join(", ")), Tone::Bad);
    }
    let outliers = outliers(rows);
    s += "<h2>Outliers</h2>";
    if outliers.is_empty() {
        s += "<p>None.</p>";
    } else {
        s += "<div class=wide><table><tr><th>unit<th class=left>figure<th>value<th>median of all<th class=left>unit<th>deviations from it";
        for o in outliers.iter().take(100) {
            let _ = write!(
                s,
                "<tr><td>{}<td class=left>{}<td>{:.4}<td>{:.4}<td class=left>{}<td>{:+.1}",
                escape(&o.unit),
                escape(&as_text(&o.figure)),
                o.value,
                o.median,
                escape(&unit_of(rows, &o.figure)),
                o.deviations
            );
        }
        s += "</table></div>";
        if outliers.len() > 100 {
            let _ = write!(s, "<p class=small>{} more are in the table.</p>", outliers.len() - 100);
        }
    }
    let panels: Vec<Panel> = stems(rows).iter().filter_map(|f| distribution(rows, f)).collect();
    s += "<h2>Distributions</h2>";
    s += &pictures(&panels)?;
    s += &batches(rows);
    if !bad.is_empty() {
        s += "<h2>Not used</h2><div class=wide><table><tr><th>unit<th class=left>why";
        bad.iter().for_each(|r| {
            let _ = write!(s, "<tr><td>{}<td class=left>{}", escape(&r.unit), escape(&r.error));
        });
        s += "</table></div>";
    }
    s += &folded("Every unit", &units(rows));
    Ok(page(title, &s))
}

/// `true` where the calibration in use leaves more than it states, on an axis, beyond what chance does on any of three.
fn has_aged(r: &Row) -> bool {
    AXIS_NAMES.iter().any(|a| r.figure(&format!("in_use_over_stated_{a}")).is_some_and(|v| v > DEVIATIONS))
}

fn units(rows: &[Row]) -> String {
    let mut s = String::from("<div class=wide><table><tr><th>unit<th class=left>batch<th>runs<th class=left>verdict<th>burn<th class=left>effects<th>image x y z [deg/h]<th>floor x y z [deg/h]<th>limit");
    let three = |r: &Row, name: &str| {
        let each = AXIS_NAMES.map(|a| r.figure(&format!("{name}_{a}")).map_or("-".to_string(), |v| format!("{v:.3}")));
        each.join(" ")
    };
    for r in rows {
        let _ = write!(
            s,
            "<tr><td>{}<td class=left>{}<td>{}<td class=left>{}<td>{}<td class=left>{}<td>{}<td>{}<td>{}",
            escape(&r.unit),
            escape(&r.batch),
            r.runs,
            escape(&r.verdict),
            if r.burn { "yes" } else { "" },
            escape(&r.effects),
            three(r, "image_dph"),
            three(r, "noise_floor_dph"),
            escape(&r.passes)
        );
    }
    s + "</table></div>"
}
