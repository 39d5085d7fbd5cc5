//! Every identification method of the sources, on a simulated unit of each source's kind: identified, compared, counted
//! in the ELF, and the winner burnt and flown through a repeat of the chamber run (wu2023's closing step).

use crate::cost;
use crate::replay::{self, Options};
use anyhow::{Context, Result};
use hrg_cal::compare::{self, Contender};
use hrg_cal::fit::independence::Units;
use hrg_cal::fit::method::{Method, Model, Objective, Search};
use hrg_cal::image_file;
use hrg_cal::recording::steps::Steps;
use hrg_cal::recording::Recording;
use hrg_cal::simulate::{EffectSpec, Kind, Plan, Profile};
use std::fmt::Write as _;
use std::path::Path;

/// A simulated unit of a source's kind.
struct Case {
    name: &'static str,
    about: &'static str,
    kind: Kind,
    profile: &'static str,
    effects: &'static [&'static str],
    unit: u64,
    /// Unseen runs that the methods are judged on.
    verify: u64,
    /// The method whose image is flown.
    flown: &'static str,
    /// What the source prints, as three sigma in deg/h: another unit's results.
    theirs: &'static [(&'static str, &'static str)],
}

const CASES: [Case; 3] = [
    Case {
        name: "dong-like",
        about: "HRG: cool to -40 C, soak 5 h, heat at 1 C/min to 50 C; eq 7 and a warm-up that eq 7 lacks",
        kind: Kind::Hrg,
        profile: "dong",
        effects: &["warm-up:tau_s=1500,size=3"],
        unit: 7,
        verify: 1,
        flown: "trace",
        theirs: &[
            ("raw", "7.07 cooling, 9.51 heating"),
            ("pso", "3.81 cooling, 5.10 heating"),
            ("two-sets", "3.75 cooling, 5.02 heating"),
        ],
    },
    Case {
        name: "wu-like",
        about: "FOG: -40 to 60 C and back at 1 C/min; four parameters and a breakpoint",
        kind: Kind::Fog,
        profile: "wu",
        effects: &[],
        unit: 5,
        verify: 1,
        flown: "fog-pso",
        theirs: &[("raw", "0.0469"), ("fog-pso", "0.0184; burnt and run again 0.0208"), ("fog-pso-range", "0.0219")],
    },
    Case {
        name: "zhao-like",
        about: "HRG: soak at 0 C, 5 C/min to 60 C, hold; bias a bent curve of temperature; judged on three other runs",
        kind: Kind::Zhao,
        profile: "zhao",
        effects: &[],
        unit: 4,
        verify: 3,
        flown: "ga-bp",
        theirs: &[("raw", "7.150"), ("polynomial", "0.370"), ("ga-bp", "0.232")],
    },
];

impl Case {
    fn run(&self, seed: u64) -> Result<Recording> {
        let effects = self.effects.iter().map(|e| EffectSpec::parse(e)).collect::<Result<Vec<_>, _>>()?;
        let kind = self.kind;
        let plan =
            Plan { kind, effects, noise: kind.noise(), ..Plan::of(Profile::parse(self.profile)?, self.unit, seed) };
        Ok(plan.simulate().recording)
    }
}

/// What the ELF made of a repeat of the chamber run.
struct Flight {
    raw: [f64; 3],
    corrected: [f64; 3],
    frames: usize,
    differing: usize,
    hours: f64,
}

fn fly(elf: &[u8], calibration: &Path, run: &Recording, seconds: Option<u64>) -> Result<Flight> {
    let c = image_file::load(calibration)?;
    let outcome = replay::run(elf, Some(&c), &Steps::new(run)?, &Options { seconds, ..Options::default() }, |_| {})?;
    let (raw, corrected) = replay::three_sigma(&outcome.seconds_of_frames());
    Ok(Flight {
        raw,
        corrected,
        frames: outcome.received.rates.len() + outcome.received.housekeeping.len(),
        differing: outcome.received.differing as usize,
        hours: outcome.seconds / 3600.0,
    })
}

/// Whether a method's notes tell what a search reached beside an exact solution.
fn has_a_search(method: Method) -> bool {
    let p = method.parts();
    p.objective == Objective::Range
        || matches!(p.search, Search::Swarm | Search::LiteralSwarm)
        || matches!(p.model, Model::FourParameters | Model::FourParametersLiteral)
}

/// Compares the methods on one case; gives the run that repeats the first one.
fn side_by_side(
    case: &Case,
    elf: &[u8],
    out: &Path,
    seed: u64,
    table: Option<&Path>,
    text: &mut String,
) -> Result<Recording> {
    let folder = out.join(case.name);
    std::fs::create_dir_all(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
    println!("{}: {} (simulated)", case.name, case.about);
    let train = case.run(seed * 10)?;
    let verify = (1..=case.verify).map(|k| case.run(seed * 10 + k)).collect::<Result<Vec<_>>>()?;
    let repeat = case.run(seed * 10 + 9)?;
    hrg_cal::write_file(&folder.join("train.csv"), train.to_csv().as_bytes())?;
    for (k, v) in verify.iter().enumerate() {
        hrg_cal::write_file(&folder.join(format!("verify-{}.csv", k + 1)), v.to_csv().as_bytes())?;
    }
    hrg_cal::write_file(&folder.join("repeat.csv"), repeat.to_csv().as_bytes())?;
    let mut c = compare::compare(&[train], &verify, &Contender::all(), seed, Units::Same, &folder, |_| {})?;
    let steps = Steps::new(&verify[0])?;
    let images: Vec<_> = c.rows.iter().map(|r| folder.join(format!("{}.toml", r.method))).collect();
    let costs = cost::costs(elf, &images, &steps, 120)?;
    c.rows.iter_mut().zip(costs).for_each(|(row, w)| row.cost = Some(w));
    hrg_cal::write_file(&folder.join("compare.json"), serde_json::to_string_pretty(&c)?.as_bytes())?;
    let picture = compare::picture(&c)?;
    hrg_cal::write_file(&folder.join("compare.svg"), picture.as_bytes())?;
    let residuals = compare::residuals(&c, &verify[0], &folder)?;
    hrg_cal::write_file(&folder.join("residuals.svg"), residuals.as_bytes())?;
    let theirs =
        |m: &str| case.theirs.iter().find(|(n, _)| *n == m).map_or_else(String::new, |(_, text)| (*text).to_string());
    println!("{}", compare::table(&c, false, Some(("theirs", &theirs))));
    let _ =
        write!(text, "\n## {}\n{}.\n\n{}", case.name, case.about, compare::table(&c, true, Some(("theirs", &theirs))));
    for l in &c.left_out {
        let _ = writeln!(text, "\nLeft out: {l}.");
    }
    let _ = writeln!(text, "\nWhat the searches reached:\n");
    for r in c.rows.iter().filter(|r| Method::by_name(&r.method).is_some_and(has_a_search)) {
        let _ = writeln!(text, "- `{}`: {}", r.method, r.notes.join("; "));
    }
    if let Some(table) = table {
        let name = format!("methods-{}.svg", case.name);
        hrg_cal::write_file(&table.with_file_name(&name), picture.as_bytes())?;
        let _ = writeln!(text, "\n![{}]({name})", case.name);
    }
    Ok(repeat)
}

/// Runs the comparison of all cases.
///
/// # Errors
/// Where a step fails.
pub fn methods(elf: &[u8], out: &Path, seed: u64, seconds: Option<u64>, table: Option<&Path>) -> Result<()> {
    let mut text = String::from(
        "# Identification methods side by side\n\nPrinted by `cargo xtask methods`; everything here is simulated, save the column \"theirs\": what the papers print for\n*their* units (as three sigma), which are other units than these.\n\nColumns: numbers identified per axis; three sigma of 100 s means (deg/h, RMS of the axes) on the training run and on\nruns that no method saw; bias instability (least Allan deviation / 0.664, deg/h); identification time on this machine (s);\ninstructions on the unit from one frequency to its bias, and of a whole update of three axes; bytes of the image; frames of\ntwo minutes of the ELF that are not those of the desktop.\n",
    );
    let mut flights = Vec::new();
    for case in &CASES {
        let repeat = side_by_side(case, elf, out, seed, table, &mut text)?;
        let folder = out.join(case.name);
        flights.push((case, folder.join(format!("{}.toml", case.flown)), repeat));
    }
    println!("Burnt and run again: a repeat of each chamber run, through the ELF.");
    // One flight per core at a time: they are the long part.
    let results: Vec<Result<Flight>> = std::thread::scope(|s| {
        let running: Vec<_> =
            flights.iter().map(|(_, path, repeat)| s.spawn(move || fly(elf, path, repeat, seconds))).collect();
        running.into_iter().map(|h| h.join().unwrap_or_else(|_| Err(anyhow::anyhow!("a flight panicked")))).collect()
    });
    let _ = write!(
        text,
        "\n## Burnt and run again\nThe image of one method of each unit in the flash of the virtual board, a repeat of the chamber run (other noise) played into\nthe ELF, three sigma of 100 s means of what it sends (deg/h, x y z).\n\n| unit | method | hours | raw | corrected | frames that differ from the desktop |\n|---|---|--:|---|---|--:|\n"
    );
    for ((case, _, _), flight) in flights.iter().zip(results) {
        let f = flight?;
        let three = |v: [f64; 3]| v.map(|x| format!("{x:.4}")).join(" ");
        let line = format!(
            "| {} | {} | {:.1} | {} | {} | {} of {} |",
            case.name,
            case.flown,
            f.hours,
            three(f.raw),
            three(f.corrected),
            f.differing,
            f.frames
        );
        println!("{line}");
        let _ = writeln!(text, "{line}");
    }
    hrg_cal::write_file(&out.join("methods.md"), text.as_bytes())?;
    if let Some(table) = table {
        hrg_cal::write_file(table, text.as_bytes())?;
    }
    Ok(())
}
