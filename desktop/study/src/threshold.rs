//! False alarms of the trace's threshold: the whole first step of the search (proposals of events and refined parameters included) on units
//! that hold nothing but noise.

use anyhow::Result;
use clap::Args;
use hrg_data::numeric::stats::{quantile, share_interval};
use hrg_data::recording::Recording;
use hrg_identify::trace;
use hrg_identify::trace::odds::THRESHOLD;
use hrg_simulate::{Noise, Plan, Profile};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::fmt::Write as _;
use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Scores of the search on noise alone.
#[derive(Args)]
pub struct Arguments {
    /// Train runs of units without an effect, one each, in the place of simulated ones.
    #[arg(value_name = "RUN")]
    runs: Vec<PathBuf>,
    /// Simulated units.
    #[arg(long, default_value_t = 600, conflicts_with = "runs")]
    units: usize,
    /// Seed of their noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Write the table as Markdown to this file.
    #[arg(long)]
    table: Option<PathBuf>,
}

const PROFILES: [&str; 3] = ["cycle", "dong", "stairs"];

fn simulated(k: usize, seed: u64) -> Result<Recording> {
    let unit = seed * 1_000_000 + k as u64;
    let mut rng = ChaCha8Rng::seed_from_u64(unit);
    let noise = Noise {
        white_100s_dph: rng.random_range(0.1..0.4),
        flicker_dph: rng.random_range(0.0..0.04),
        walk_per_root_h_dph: rng.random_range(0.0..0.03),
        ..Noise::default()
    };
    let plan = Plan { noise, ..Plan::of(Profile::parse(PROFILES[k % PROFILES.len()])?, unit, unit) };
    Ok(plan.simulate().recording)
}

/// Runs the command.
///
/// # Errors
/// A recording that cannot be used, or a table that cannot be written.
pub fn run(a: &Arguments) -> Result<()> {
    let count = if a.runs.is_empty() { a.units } else { a.runs.len() };
    let next = AtomicUsize::new(0);
    let one = |k: usize| -> Result<f64> {
        let recording = match a.runs.get(k) {
            Some(path) => Recording::load(path)?,
            None => simulated(k, a.seed)?,
        };
        Ok(trace::first_score(&[recording])?)
    };
    let mut scores = std::thread::scope(|scope| {
        let work = || {
            let mut mine = Vec::new();
            loop {
                let k = next.fetch_add(1, Ordering::Relaxed);
                if k >= count {
                    return Ok(mine);
                }
                mine.push((k, one(k)?));
            }
        };
        let workers: Vec<_> =
            (0..std::thread::available_parallelism().map_or(2, usize::from)).map(|_| scope.spawn(work)).collect();
        let each = workers.into_iter().map(|w| w.join().unwrap_or_else(|_| Err(anyhow::anyhow!("a worker panicked"))));
        each.collect::<Result<Vec<Vec<(usize, f64)>>>>().map(|v| v.concat())
    })?;
    scores.sort_by_key(|s| s.0);
    let table = table(&scores.iter().map(|s| s.1).collect::<Vec<_>>(), a);
    print!("{table}");
    a.table.as_ref().map_or(Ok(()), |path| hrg_data::output::write_file(path, table.as_bytes()))
}

fn table(scores: &[f64], a: &Arguments) -> String {
    let n = scores.len();
    let of =
        if a.runs.is_empty() { format!("{n} simulated units, seed {}", a.seed) } else { format!("{n} recordings") };
    let mut s = format!(
        "# The threshold of `hrg trace`\n\nThe highest score of the first step of the search on noise alone, proposals of events and refined parameters included: {of}.\n\n| scores | value |\n|---|---|\n"
    );
    for q in [0.5, 0.9, 0.95, 0.99] {
        let _ = writeln!(s, "| {:.0} % of the units are below | {:.2} |", 100.0 * q, quantile(scores, q));
    }
    let above = scores.iter().filter(|v| **v > THRESHOLD).count();
    let (low, high) = share_interval(above, n);
    let _ = writeln!(
        s,
        "| above the threshold of {THRESHOLD} | {above} of {n} ({:.2} %, 95 %: {:.2} to {:.2}) |",
        100.0 * above as f64 / n as f64,
        100.0 * low,
        100.0 * high
    );
    s
}
