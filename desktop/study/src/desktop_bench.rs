//! Measures the time of the desktop's work, and its growth with the length of a recording.
//!
//! Each measurement is a process of its own (this program, called again), so that its memory is its own too. Times are of this
//! machine and in no test; what counts is how they grow, and the ratios beside them.

use anyhow::{Context, Result};
use clap::Args;
use hrg_data::numeric::allan;
use hrg_data::numeric::draws::Draws;
use hrg_data::recording::Recording;
use hrg_identify::{fit, trace};
use hrg_papers::method::Method;
use hrg_papers::methods;
use hrg_papers::search;
use hrg_simulate::{EffectSpec, Plan, Profile};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

/// Times reading, writing, fit, trace and Allan deviation.
#[derive(Args)]
pub struct Arguments {
    /// Folder for the recordings that are made for it.
    #[arg(long, default_value = "target/bench")]
    folder: PathBuf,
    /// Runs of each; the median counts.
    #[arg(long, default_value_t = 3)]
    runs: usize,
    /// Page whose table is written anew.
    #[arg(long)]
    page: Option<PathBuf>,
    /// One measurement: what, and on which files.
    #[arg(long, num_args = 1.., hide = true)]
    child: Vec<String>,
}

/// Times reading, writing, fit, trace and Allan deviation on this machine.
///
/// # Errors
/// A file that cannot be made, or a page that cannot be written.
pub fn run(a: &Arguments) -> Result<()> {
    if a.child.is_empty() {
        table(a)
    } else {
        child(&a.child)
    }
}

/// A chamber run of some hours: ramps and soaks over and over.
fn profile(hours: usize) -> Result<Profile> {
    let mut text = String::from("20");
    // Two hours and a half each.
    let mut minutes = 0;
    while minutes < hours * 60 {
        text.push_str(",45@1.25,30m,-5@1.25,25m,20@1.25");
        minutes += 135;
    }
    Ok(Profile::parse(&text)?)
}

/// A recording of so many hours at so many rows a second.
fn make(path: &Path, hours: usize, hz: usize) -> Result<()> {
    let mut r = Plan::of(profile(hours)?, 1, 1).simulate().recording;
    let n = hours * 3600;
    let cut = |v: &mut Vec<f64>| {
        v.truncate(n);
        if hz > 1 {
            // Between the seconds a straight line, and a little noise that is the same for every run.
            let mut draws = Draws::new(1);
            let seconds = std::mem::take(v);
            v.reserve(seconds.len() * hz);
            for w in seconds.windows(2).chain([[seconds[n - 1], seconds[n - 1]].as_slice()]) {
                for k in 0..hz {
                    let noise = ((draws.bits() >> 40) as f64 / (1u64 << 24) as f64 - 0.5) * 1e-4;
                    v.push(w[0] + (w[1] - w[0]) * k as f64 / hz as f64 + noise);
                }
            }
        }
    };
    r.frequency_hz.iter_mut().chain(&mut r.rate_dph).for_each(cut);
    r.optional.clear();
    r.time_s = (0..n * hz).map(|k| (k as f64 / hz as f64 * 1e4).round() / 1e4).collect();
    hrg_data::output::write_file(path, r.to_csv().as_bytes())
}

/// Peak memory of this process, bytes.
fn peak() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:")).unwrap_or("0");
    line.trim().trim_end_matches(" kB").parse::<f64>().unwrap_or(0.0) * 1024.0
}

/// One measurement: prints its seconds and the process' peak memory.
fn child(arguments: &[String]) -> Result<()> {
    let path = |k: usize| arguments.get(k).map(PathBuf::from).context("a file");
    let what = arguments[0].as_str();
    let load = |k: usize| -> Result<Recording> { Recording::load(&path(k)?) };
    let seconds = match what {
        "read" => {
            let start = Instant::now();
            let r = load(1)?;
            let t = start.elapsed();
            std::hint::black_box(&r);
            t
        }
        "write" => {
            let r = load(1)?;
            let start = Instant::now();
            hrg_data::output::write_file(&path(2)?, r.to_csv().as_bytes())?;
            start.elapsed()
        }
        "fit" => {
            let r = load(1)?;
            let start = Instant::now();
            let prepared = fit::prepare(std::slice::from_ref(&r))?;
            std::hint::black_box(methods::identify(&prepared, Method::Lsq, 1)?);
            start.elapsed()
        }
        "allan" => {
            let r = load(1)?;
            let start = Instant::now();
            let (rates, step) = r.even_rates();
            for axis in &rates {
                std::hint::black_box(allan::overlapping(axis, step, &allan::octaves(axis.len())));
            }
            start.elapsed()
        }
        "trace" => {
            let (train, verify) = (load(1)?, load(2)?);
            let start = Instant::now();
            std::hint::black_box(trace::trace(std::slice::from_ref(&train), &verify)?);
            start.elapsed()
        }
        _ => return peer(what, &path(1)?),
    };
    println!("{} {}", seconds.as_secs_f64(), peak());
    Ok(())
}

/// The least of some times of a piece of work, s, and what it gave.
fn best<T>(runs: usize, mut work: impl FnMut() -> T) -> (f64, T) {
    let timed = |work: &mut dyn FnMut() -> T| {
        let start = Instant::now();
        let result = std::hint::black_box(work());
        (start.elapsed().as_secs_f64(), result)
    };
    let mut least = timed(&mut work);
    for _ in 1..runs {
        let next = timed(&mut work);
        if next.0 < least.0 {
            least = next;
        }
    }
    least
}

/// One job of bench/peers/peers.py, as JSON.
fn peer(what: &str, path: &Path) -> Result<()> {
    let r = Recording::load(path)?;
    // Six regressors like those of eq 7, of axis x: the other side reads the very numbers.
    let u: Vec<f64> = r.frequency_hz[0].iter().map(|f| (f - 4900.0) / 21.0).collect();
    let slope: Vec<f64> = (0..u.len()).map(|k| (u[k] - u[k.saturating_sub(20)]) * 100.0).collect();
    let columns: Vec<Vec<f64>> = [
        u.iter().map(|_| 1.0).collect(),
        u.clone(),
        u.iter().map(|u| u * u).collect(),
        slope.clone(),
        slope.iter().map(|r| r * r).collect(),
        u.iter().zip(&slope).map(|(u, r)| u * r).collect(),
    ]
    .into();
    let y = r.rate_dph[0].clone();
    let answer = match what {
        "peer-read" => {
            let (seconds, r) = best(5, || Recording::load(path).map(|r| r.time_s.len()));
            serde_json::json!({"seconds": seconds, "rows": r?})
        }
        "peer-lsq" => {
            let bytes = |v: &[f64]| v.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
            hrg_data::output::write_file(&path.with_file_name("columns.f64"), &bytes(&columns.concat()))?;
            hrg_data::output::write_file(&path.with_file_name("rates.f64"), &bytes(&y))?;
            let names = ["1", "u", "uu", "r", "rr", "ur"];
            let (seconds, fit) = best(9, || hrg_data::numeric::lsq::fit(&columns, &y, None, &names));
            serde_json::json!({"seconds": seconds, "coefficients": fit?.coefficients})
        }
        "peer-pso" => {
            let (seconds, found) = best(3, || search::swarm_on(columns.clone(), y.clone(), 1));
            let constants = hrg_papers::swarm::DONG;
            serde_json::json!({"seconds": seconds, "above": found?.1, "particles": constants.particles, "iterations": constants.iterations})
        }
        "peer-allan" => {
            let (seconds, points) = best(5, || allan::overlapping(&y, 1.0, &allan::octaves(y.len())));
            let tau: Vec<f64> = points.iter().map(|p| p.tau_s).collect();
            let deviation: Vec<f64> = points.iter().map(|p| p.deviation).collect();
            serde_json::json!({"seconds": seconds, "tau": tau, "deviation": deviation})
        }
        "peer-ukf" => {
            use hrg_align::particles::{Literal, CHEN};
            use hrg_align::{Config, Filter};
            let config = Config::new(45.0, 9.8, 3e-4).map_err(|e| anyhow::anyhow!("{e:?}"))?;
            let mut filter: Box<Literal<f64, CHEN>> = Box::new(Literal::IDLE);
            filter.begin(config, 1);
            let mut second = 0.0;
            let (seconds, _) = best(20, || {
                second += 1.0;
                filter.step([9e-3 * second, -8.5e-3 * second])
            });
            // A step is one of an unscented filter for each particle, and the particles' own work.
            serde_json::json!({"seconds": seconds / CHEN as f64, "states": hrg_align::ekf::STATES})
        }
        _ => anyhow::bail!("no such measurement: {what}"),
    };
    println!("{answer}");
    Ok(())
}

struct Measured {
    seconds: f64,
    peak: f64,
}

/// The median of some processes, on one core.
fn measure(runs: usize, arguments: &[&str]) -> Result<Measured> {
    let program = std::env::current_exe()?;
    let mut all = Vec::new();
    for _ in 0..runs {
        let o = Command::new("taskset")
            .args(["-c", "0"])
            .arg(&program)
            .args(["bench-desktop", "--child"])
            .args(arguments)
            .output()?;
        anyhow::ensure!(o.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&o.stderr));
        let text = String::from_utf8_lossy(&o.stdout);
        let mut numbers = text.split_whitespace().map(|w| w.parse::<f64>().unwrap_or(f64::NAN));
        all.push((numbers.next().unwrap_or(f64::NAN), numbers.next().unwrap_or(f64::NAN)));
    }
    all.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (seconds, peak) = all[all.len() / 2];
    Ok(Measured { seconds, peak })
}

fn table(a: &Arguments) -> Result<()> {
    std::fs::create_dir_all(&a.folder)?;
    let mut table = String::from("| work | rows | time [s] | ns a row | beside 10 h at 1 Hz, a row | peak memory / file |\n|---|---:|---:|---:|---:|---:|\n");
    let scratch = a.folder.join("written.csv");
    let lengths = [(1usize, 1usize), (10, 1), (100, 1), (10, 100)];
    let mut files = Vec::new();
    for (hours, hz) in lengths {
        let path = a.folder.join(format!("{hours}h-{hz}hz.csv"));
        if !path.exists() {
            make(&path, hours, hz)?;
        }
        files.push((hours, hz, path));
    }
    for work in ["read", "write", "fit", "allan"] {
        let mut lines = Vec::new();
        for (hours, hz, path) in &files {
            let (path, to) = (path.display().to_string(), scratch.display().to_string());
            let m = measure(a.runs, &[work, &path, &to])?;
            let size = std::fs::metadata(&path)?.len() as f64;
            lines.push((*hours, *hz, (hours * 3600 * hz) as f64, m, size));
        }
        let base = lines[1].3.seconds / lines[1].2;
        for (hours, hz, rows, m, size) in lines {
            let each = m.seconds / rows;
            writeln!(
                table,
                "| {work}, {hours} h at {hz} Hz | {rows} | {:.3} | {:.0} | {:.2} | {:.1} |",
                m.seconds,
                each * 1e9,
                each / base,
                m.peak / size
            )?;
        }
    }
    for (name, effects) in [
        ("a clean unit", vec![]),
        ("one effect", vec!["thermal-lag:size=3"]),
        ("four effects", vec!["thermal-lag:size=4", "hysteresis:size=4", "warm-up:size=4", "cubic:size=4"]),
    ] {
        let effects = effects.iter().map(|e| EffectSpec::parse(e)).collect::<Result<Vec<_>, _>>()?;
        let plan = Plan { effects, ..Plan::of(Profile::parse("cycle")?, 3, 1) };
        let (train, verify) = (a.folder.join("train.csv"), a.folder.join("verify.csv"));
        hrg_data::output::write_file(&train, plan.simulate().recording.to_csv().as_bytes())?;
        let ten = "22,50@0.5,90m,-30@0.5,90m,22@0.5,2h";
        let second = Plan { profile: Profile::parse(ten)?, seed: 2, ..plan };
        let recording = second.simulate().recording;
        let rows = recording.time_s.len();
        hrg_data::output::write_file(&verify, recording.to_csv().as_bytes())?;
        let m = measure(a.runs, &["trace", &train.display().to_string(), &verify.display().to_string()])?;
        writeln!(
            table,
            "| trace, {name}: 7 h and {:.1} h at 1 Hz | {} | {:.3} | | | |",
            rows as f64 / 3600.0,
            25_201 + rows,
            m.seconds
        )?;
    }
    print!("{table}");
    match &a.page {
        Some(page) => crate::pages::splice(page, "desktop", &table),
        None => Ok(()),
    }
}
