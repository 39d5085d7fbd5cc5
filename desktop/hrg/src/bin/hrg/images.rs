//! `hrg compare-images`: what changed from one calibration to the next, and when to calibrate again.

use crate::now;
use anyhow::Result;
use clap::Args;
use hrg::images;
use hrg::images::{changes, Dated, Quantity, Trend, YEAR_S};
use hrg::unit::monitor::date;
use hrg_data::error::BadInput;
use hrg_data::image_file;
use std::path::{Path, PathBuf};

/// Arguments of `hrg compare-images`.
#[derive(Args)]
pub struct Arguments {
    /// The older calibration.
    old: PathBuf,
    /// The newer ones, of the same unit.
    #[arg(required = true)]
    new: Vec<PathBuf>,
    /// Dates of all of them in that order, such as 2025-03-01,2026-03-01: in place of what the images say.
    #[arg(long, value_delimiter = ',')]
    dates: Vec<String>,
    /// Largest change of a bias before the unit is calibrated again, deg/h; by default three standard deviations of the newest image's bias.
    #[arg(long)]
    limit: Option<f64>,
    /// File for the picture (SVG).
    #[arg(short, long)]
    out: Option<PathBuf>,
}

/// Seconds since 1970 of a date such as 2026-03-01 (civil to days, Howard Hinnant's algorithm).
fn seconds_of(text: &str) -> Result<f64, BadInput> {
    let parts: Vec<i64> = text.trim().split('-').map(|p| p.parse().unwrap_or(-1)).collect();
    let &[year @ 1970..=2105, month @ 1..=12, day @ 1..=31] = parts.as_slice() else {
        return Err(BadInput::new(format!(
            "--dates: \"{text}\" is no date; write them like 2026-03-01, separated by commas"
        )));
    };
    let y = if month <= 2 { year - 1 } else { year };
    let (era, month) = (y / 400, (month + 9) % 12);
    let yoe = y - era * 400;
    let doe = yoe * 365 + yoe / 4 - yoe / 100 + (153 * month + 2) / 5 + day - 1;
    Ok(((era * 146_097 + doe - 719_468) * 86_400) as f64)
}

/// The images with their dates.
fn load(arguments: &Arguments) -> Result<Vec<Dated>> {
    let paths: Vec<&PathBuf> = std::iter::once(&arguments.old).chain(&arguments.new).collect();
    let dates = arguments.dates.iter().map(|d| seconds_of(d)).collect::<Result<Vec<_>, _>>()?;
    if !dates.is_empty() && dates.len() != paths.len() {
        return Err(BadInput::new(format!(
            "--dates has {} dates for {} images; give one for each, in their order",
            dates.len(),
            paths.len()
        ))
        .into());
    }
    let one = |(k, path): (usize, &PathBuf)| {
        let calibration = image_file::load(path)?;
        let own = Some(f64::from(calibration.created_unix_s)).filter(|s| *s > 0.0);
        Ok(Dated { name: path.display().to_string(), calibration, unix_s: dates.get(k).copied().or(own) })
    };
    paths.into_iter().enumerate().map(|(k, p)| one((k, p))).collect()
}

/// Runs the command.
///
/// # Errors
/// Bad input, or a file that cannot be written.
pub fn run(arguments: &Arguments) -> Result<()> {
    if let Some(out) = arguments.out.as_deref().filter(|o| o.extension().is_some_and(|e| e != "svg")) {
        return Err(BadInput::new(format!(
            "--out {}: the picture is SVG; give a name that ends in .svg",
            out.display()
        ))
        .into());
    }
    if arguments.limit.is_some_and(|l| !(l > 0.0 && l.is_finite())) {
        return Err(BadInput::new("--limit: give what a bias may change by, deg/h, above 0").into());
    }
    let all = load(arguments)?;
    let quantities = Quantity::of(&all);
    let values = images::values(&all, &quantities)?;
    for (k, d) in all.iter().enumerate() {
        let from = if arguments.dates.is_empty() { "by the image" } else { "by --dates" };
        let made = d.unix_s.map_or_else(
            || "of an unknown date: the image holds none, give --dates".to_string(),
            |s| {
                let age = (f64::from(now()) - s) / YEAR_S;
                format!("of {} ({from}), {age:.2} years old", date(s as u32))
            },
        );
        println!("{}: image {:08x} no. {}, {made}", d.name, d.calibration.checksum(), d.calibration.sequence);
        if k > 0 {
            say_changes(&changes(&quantities, &values[0], &values[k]), &all[0].name);
        }
    }
    println!(
        "a change is what the unit would send differently for the same readings on a soak, over {:.0} to {:.0} C;",
        values[0][0][0].temperature_c,
        values[0][0].last().map_or(f64::NAN, |v| v.temperature_c)
    );
    println!("sigmas: root mean square over temperature of the change over its standard deviation; about 1 where only noise changed");
    println!("{}", hrg_identify::fit::correct::TURN_ON);
    match images::trends(&all, &quantities, &values) {
        Ok(trends) => say_trends(&trends, arguments.limit),
        Err(e) if all.len() > 2 => println!("no trend: {e}"),
        Err(_) => {}
    }
    if let Some(out) = &arguments.out {
        hrg_data::output::write_file(out, images::picture(&all, &quantities, &values)?.as_bytes())?;
        println!("{}: the changes over temperature", Path::new(out).display());
    }
    Ok(())
}

fn say_changes(changes: &[images::Change], since: &str) {
    println!("  {:<34} {:>14} {:>14} {:>9} {:>9}", format!("since {since}"), "mean", "largest", "at [C]", "sigmas");
    for c in changes {
        let Some(most) = c.largest() else { continue };
        let unit = c.quantity.unit();
        println!(
            "  {:<34} {:>14} {:>14} {:>9.1} {:>9}",
            c.quantity.name(),
            format!("{:+.4} {unit}", c.mean()),
            format!("{:+.4} {unit}", most.value),
            most.temperature_c,
            c.sigmas().map_or_else(|| "not stated".into(), |s| format!("{s:.1}"))
        );
    }
}

fn say_trends(trends: &[Trend], limit: Option<f64>) {
    println!("\ntrend over {} images, of the mean over temperature:", trends.first().map_or(0, |t| t.means.len()));
    let mut earliest: Option<(f64, String)> = None;
    for t in trends {
        let (slope, std) = t.per_year;
        let unit = t.quantity.unit();
        let sure =
            if std.is_nan() { "(standard deviation not stated)".to_string() } else { format!("\u{b1} {std:.4}") };
        let mut line = format!("  {:<34} {slope:+.4} {sure} {unit} a year", t.quantity.name());
        let newest = t.means.last();
        let limit = limit.or_else(|| newest.map(|m| 3.0 * m.std)).filter(|l| l.is_finite() && *l > 0.0);
        if let (Quantity::Bias(_), Some(limit), Some(newest)) = (t.quantity, limit, newest) {
            let (expected, first) = t.years_to(limit);
            let first = if first.is_nan() { expected } else { first };
            let at = |years: f64| {
                let s = newest.temperature_c + years * YEAR_S;
                if s < f64::from(u32::MAX) {
                    date(s as u32)
                } else {
                    "later than 2106".to_string()
                }
            };
            line += &format!(
                "; {limit:.3} deg/h from the newest image on: {}, at the earliest {}",
                at(expected),
                at(first)
            );
            if earliest.as_ref().is_none_or(|(e, _)| first < *e) {
                earliest = Some((first, at(first)));
            }
        }
        println!("{line}");
    }
    match earliest {
        Some((_, at)) => println!("calibrate again by {at}: from then on a trend of the bias may be beyond the limit (two standard deviations)"),
        None => println!("when to calibrate again is open: the images state no standard deviation of a bias; give --limit"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_date_goes_there_and_back() {
        for text in ["1970-01-01", "2024-02-29", "2026-11-23", "2100-03-01"] {
            assert_eq!(date(seconds_of(text).expect("a date") as u32), text);
        }
        for bad in ["", "2026", "2026-13-01", "23.11.2026", "1969-12-31"] {
            assert!(seconds_of(bad).is_err(), "{bad}");
        }
    }
}
