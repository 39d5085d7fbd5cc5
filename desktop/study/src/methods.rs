//! Every identification method of the sources, on a simulated unit of each source's kind: identified, compared, counted
//! in the ELF, and the winner burnt and flown through a repeat of the chamber run (wu2023's closing step).

use anyhow::{Context, Result};
use hrg_board::cost;
use hrg_board::replay::{self, Options};
use hrg_data::image_file;
use hrg_data::recording::steps::Steps;
use hrg_data::recording::Recording;
use hrg_identify::fit::independence::Units;
use hrg_papers::compare;
use hrg_papers::compare::Contender;
use hrg_papers::method::{Method, Model, Objective, Search};
use hrg_simulate::{EffectSpec, Kind, Plan, Profile};
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
    /// Repeats of the training run that the methods are judged on.
    verify: u64,
    /// Another profile that they are judged on.
    other: &'static str,
    /// From here on the runs are judged, s: the paper's figures leave out what comes before.
    from_s: f64,
    /// The method whose image is flown.
    flown: &'static str,
    /// Figures that the source prints, as three sigma in deg/h: another unit's results.
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
        other: "verify",
        from_s: 0.0,
        flown: "trace",
        theirs: &[
            ("raw", "cooling 7.071, heating 9.512"),
            ("pso-two-sets", "cooling 3.812, heating 5.096"),
            ("two-sets-held", "cooling 3.753, heating 5.022"),
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
        other: "55,30m,-35@0.9,1h,50@0.8,1h",
        from_s: 0.0,
        flown: "fog-pso",
        theirs: &[
            ("raw", "0.0469"),
            ("fog-pso-literal", "train 0.0184, burnt 0.0208"),
            ("fog-pso-range-literal", "train 0.0219"),
        ],
    },
    Case {
        name: "zhao-like",
        about: "HRG: 5 h at 0 C, 5 C/min to 60 C, hold for 100 min; bias a bent curve of temperature; judged on three repeats, from the ramp's start on",
        kind: Kind::Zhao,
        profile: "zhao",
        effects: &[],
        unit: 4,
        verify: 3,
        other: "0,5h,50@2,90m,10@1,2h",
        from_s: 5.0 * 3600.0,
        flown: "ga-bp",
        theirs: &[("raw", "repeat 7.150"), ("polynomial", "repeat 0.370"), ("ga-bp", "repeat 0.232")],
    },
];

impl Case {
    fn run(&self, seed: u64) -> Result<Recording> {
        self.run_of(self.profile, seed)
    }

    fn run_of(&self, profile: &str, seed: u64) -> Result<Recording> {
        let effects = self.effects.iter().map(|e| EffectSpec::parse(e)).collect::<Result<Vec<_>, _>>()?;
        let kind = self.kind;
        let plan = Plan { kind, effects, noise: kind.noise(), ..Plan::of(Profile::parse(profile)?, self.unit, seed) };
        Ok(plan.simulate().recording)
    }
}

/// Result of the ELF on a repeat of the chamber run.
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

/// `true` if a method's notes compare a search with an exact solution.
fn has_a_search(method: Method) -> bool {
    let p = method.parts();
    p.objective == Objective::Range
        || matches!(p.search, Search::Swarm | Search::LiteralSwarm(_))
        || matches!(p.model, Model::FourParameters | Model::FourParametersLiteral)
}

/// The line of a method in the short table (docs/methods.md): a cell for each case.
type Summary = Vec<(String, Vec<String>)>;

/// Adds a case to the short table.
fn summarise(summary: &mut Summary, case: &Case, nth: usize, c: &compare::Comparison) {
    let theirs = |m: &str| case.theirs.iter().find(|(n, _)| *n == m).map_or("", |(_, text)| *text);
    let figure = |v: &Option<[f64; 3]>| {
        v.as_ref().map_or_else(String::new, |v| match compare::over_axes(v) {
            x if x < 0.1 => format!("{x:.4}"),
            x => format!("{x:.3}"),
        })
    };
    let rows = c.rows.iter().map(|r| (r.method.as_str(), &r.judged));
    for (method, judged) in [("raw", &c.raw)].into_iter().chain(rows) {
        let at = summary.iter().position(|(m, _)| m == method).unwrap_or_else(|| {
            summary.push((method.to_string(), vec![String::new(); 3 * CASES.len()]));
            summary.len() - 1
        });
        let cells = [figure(&judged.repeat_3sigma_dph), figure(&judged.other_3sigma_dph), theirs(method).to_string()];
        summary[at].1[3 * nth..3 * nth + 3].clone_from_slice(&cells);
    }
}

/// The short table.
fn summary_table(summary: &Summary) -> String {
    let mut out = String::from("| method |");
    for case in &CASES {
        let _ = write!(out, " {}: repeat | other profile | theirs |", case.name);
    }
    out.push_str("\n|---|");
    CASES.iter().for_each(|_| out.push_str("--:|--:|---|"));
    out.push('\n');
    for (method, cells) in summary {
        let name = if method == "raw" { method.clone() } else { format!("`{method}`") };
        let _ = writeln!(out, "| {name} | {} |", cells.join(" | "));
    }
    out
}

/// Compares the methods on one case; gives the run that repeats the first one.
fn side_by_side(
    case: &Case,
    elf: &[u8],
    out: &Path,
    seed: u64,
    table: Option<&Path>,
    text: &mut String,
    summarise: &mut dyn FnMut(&compare::Comparison),
) -> Result<Recording> {
    let folder = out.join(case.name);
    std::fs::create_dir_all(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
    println!("{}: {} (simulated)", case.name, case.about);
    let train = case.run(seed * 10)?;
    let mut verify = (1..=case.verify).map(|k| case.run(seed * 10 + k)).collect::<Result<Vec<_>>>()?;
    verify.push(case.run_of(case.other, seed * 10 + 8)?);
    let repeat = case.run(seed * 10 + 9)?;
    hrg_data::output::write_file(&folder.join("train.csv"), train.to_csv().as_bytes())?;
    for (k, v) in verify.iter().enumerate() {
        hrg_data::output::write_file(&folder.join(format!("verify-{}.csv", k + 1)), v.to_csv().as_bytes())?;
    }
    hrg_data::output::write_file(&folder.join("repeat.csv"), repeat.to_csv().as_bytes())?;
    let options = compare::Options { seed, units: Units::Same, from_s: case.from_s };
    let mut c = compare::compare(&[train], &verify, (&Contender::all(), &[]), &options, &folder, |_| {})?;
    summarise(&c);
    let steps = Steps::new(&verify[0])?;
    let images: Vec<_> = c.rows.iter().map(|r| folder.join(format!("{}.toml", r.method))).collect();
    let costs = cost::costs(elf, &images, &steps, 120)?;
    c.rows.iter_mut().zip(costs).for_each(|(row, w)| row.cost = Some(w));
    hrg_data::output::write_file(&folder.join("compare.json"), serde_json::to_string_pretty(&c)?.as_bytes())?;
    let (picture, searches) = (compare::picture(&c)?, compare::searches(&c)?);
    hrg_data::output::write_file(&folder.join("searches.svg"), searches.as_bytes())?;
    hrg_data::output::write_file(&folder.join("compare.svg"), picture.as_bytes())?;
    let residuals = compare::residuals(&c, &verify[0], &folder)?;
    hrg_data::output::write_file(&folder.join("residuals.svg"), residuals.as_bytes())?;
    let theirs =
        |m: &str| case.theirs.iter().find(|(n, _)| *n == m).map_or_else(String::new, |(_, text)| (*text).to_string());
    println!("{}", compare::table(&c, false, Some(("theirs", &theirs))));
    let _ = write!(
        text,
        "\n## {}\n{}. The other profile: `{}`.\n\n{}",
        case.name,
        case.about,
        case.other,
        compare::table(&c, true, Some(("theirs", &theirs)))
    );
    for l in &c.left_out {
        let _ = writeln!(text, "\nLeft out: {l}.");
    }
    let _ = writeln!(text, "\nWhat the searches reached:\n");
    for r in c.rows.iter().filter(|r| Method::by_name(&r.method).is_some_and(has_a_search)) {
        let _ = writeln!(text, "- `{}`: {}", r.method, r.notes.join("; "));
    }
    if let Some(table) = table {
        for (name, picture) in
            [(format!("methods-{}.svg", case.name), &picture), (format!("searches-{}.svg", case.name), &searches)]
        {
            hrg_data::output::write_file(&table.with_file_name(&name), picture.as_bytes())?;
            let _ = writeln!(text, "\n![{name}]({name})");
        }
    }
    Ok(repeat)
}

/// Text of the page before its tables.
const HEAD: &str = "# Identification methods side by side

Printed by `cargo xtask methods`; everything here is simulated, save the column \"theirs\": what the papers print for
*their* units (as three sigma), which are other units than these.

Columns: numbers identified per axis; three sigma of 100 s means (deg/h, RMS of the axes) on the training run, on its cooling and its
heating stage (a soak with the ramp before it, as in dong2023's Table 4), on runs of the same profile that no method saw, and on
a run of another profile (the trace decides on the first repeat whether it holds; no method sees the other profile); bias instability of
the unseen runs (least Allan deviation / 0.664, deg/h); identification time on this machine (s); instructions on the unit from one
frequency to its bias, and of a whole update of three axes; bytes of the image; frames of two minutes of the ELF that are not those of
the desktop.
";

/// Runs of the comparison, and the places of its results.
#[derive(Debug)]
pub struct Work<'a> {
    /// Folder of the files.
    pub out: &'a Path,
    /// Seed of noise and searches.
    pub seed: u64,
    /// Fly only so many seconds of the repeat runs.
    pub seconds: Option<u64>,
    /// Fly only the image of this case.
    pub fly: Option<&'a str>,
    /// Page of all tables, and the pictures beside it.
    pub table: Option<&'a Path>,
    /// Page into which the short table is written, between its marks.
    pub page: Option<&'a Path>,
}

/// Runs the comparison of all cases.
///
/// # Errors
/// If a step fails.
pub fn methods(elf: &[u8], work: &Work<'_>) -> Result<()> {
    let &Work { out, seed, seconds, fly: only, table, page } = work;
    let mut text = String::from(HEAD);
    let mut flights = Vec::new();
    let mut summary = Summary::new();
    for (nth, case) in CASES.iter().enumerate() {
        let mut add = |c: &compare::Comparison| summarise(&mut summary, case, nth, c);
        let repeat = side_by_side(case, elf, out, seed, table, &mut text, &mut add)?;
        if only.is_none_or(|name| name == case.name) {
            flights.push((case, out.join(case.name).join(format!("{}.toml", case.flown)), repeat));
        }
    }
    let short = summary_table(&summary);
    hrg_data::output::write_file(&out.join("short.md"), short.as_bytes())?;
    page.map_or(Ok(()), |page| crate::pages::splice(page, "methods", &short))?;
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
    hrg_data::output::write_file(&out.join("methods.md"), text.as_bytes())?;
    if let Some(table) = table {
        hrg_data::output::write_file(table, text.as_bytes())?;
    }
    Ok(())
}
