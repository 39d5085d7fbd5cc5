//! `hrg fleet`: many units at once.

use anyhow::Result;
use clap::Args;
use hrg::fleet::{self, Kept, Row, Wanted};
use std::path::PathBuf;

/// Arguments of `hrg fleet`.
#[derive(Args)]
pub struct Arguments {
    /// Folder with the recordings of the units, and in it a folder for each batch. Calibrations in use (.toml) may lie beside them.
    folder: PathBuf,
    /// Folder for the table (fleet.parquet), the page (fleet.html) and the rows that are there already.
    #[arg(short, long)]
    out: PathBuf,
    /// A family to which the units should belong (hrg family).
    #[arg(long, value_name = "FAMILY")]
    prior: Option<PathBuf>,
    /// Judge each unit: largest error that passes, deg/h.
    #[arg(short, long, requires = "from", requires = "to")]
    limit: Option<f64>,
    /// With --limit: lowest temperature, C.
    #[arg(long, requires = "limit", allow_negative_numbers = true)]
    from: Option<f64>,
    /// With --limit: highest temperature, C.
    #[arg(long, requires = "limit", allow_negative_numbers = true)]
    to: Option<f64>,
}

/// Runs the command.
///
/// # Errors
/// A folder without recordings, or files that cannot be written.
pub fn run(arguments: &Arguments) -> Result<()> {
    let Arguments { folder, out, prior, limit, from, to } = arguments;
    let limit = limit.zip(from.zip(*to)).map(|(limit, (from, to))| [limit, from, to]);
    let wanted = Wanted { family: prior.clone(), limit };
    let units = fleet::units(folder, out, &wanted)?;
    let kept = Kept::new(out)?;
    let bar = indicatif::ProgressBar::new(units.len() as u64);
    bar.set_style(indicatif::ProgressStyle::with_template("{bar:40} {pos} of {len} units, {eta} left")?);
    let again = std::sync::atomic::AtomicUsize::new(0);
    let rows = fleet::run(&units, &wanted, &kept, |_, was_kept| {
        bar.inc(1);
        again.fetch_add(usize::from(was_kept), std::sync::atomic::Ordering::Relaxed);
    })?;
    bar.finish_and_clear();
    let title = format!("Fleet {}", folder.canonicalize()?.file_name().unwrap_or_default().to_string_lossy());
    fleet::write(out, &title, &rows)?;
    say(&rows, again.into_inner());
    println!("{}: table; {}: page", out.join("fleet.parquet").display(), out.join("fleet.html").display());
    Ok(())
}

fn say(rows: &[Row], again: usize) {
    let of = |what: &dyn Fn(&Row) -> bool| rows.iter().filter(|r| what(r)).count();
    println!("{} units, {again} of them as they were kept", rows.len());
    println!(
        "recommended images {}, units with something that could not be used {}",
        of(&|r| r.burn),
        of(&|r| !r.error.is_empty())
    );
    for word in ["PASS", "NOT COVERED", "FAIL"] {
        let n = of(&|r| r.passes == word);
        if n > 0 {
            println!("{word} {n}");
        }
    }
    for o in fleet::outliers(rows).iter().take(5) {
        println!(
            "outlier: {} {} {:.4}, median {:.4}, {:+.1} deviations",
            o.unit, o.figure, o.value, o.median, o.deviations
        );
    }
    for r in rows.iter().filter(|r| !r.error.is_empty()).take(5) {
        println!("note: {}: {}", r.unit, r.error);
    }
}
