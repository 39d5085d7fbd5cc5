//! Every identification method of the sources, on a simulated unit of each source's kind: identified, compared, counted
//! in the ELF, and the winner burnt and flown through a repeat of the chamber run (wu2023's closing step).

mod spread;
mod step;

use anyhow::Result;
use hrg_board::cost;
use hrg_board::replay::{self, Options};
use hrg_data::image_file;
use hrg_data::recording::steps::Steps;
use hrg_data::recording::Recording;
use hrg_papers::compare;
use hrg_papers::method::{Method, Model, Objective, Search};
use hrg_simulate::{EffectSpec, Kind, Plan, Profile};
use spread::Spread;
use std::fmt::Write as _;
use std::path::Path;

/// A simulated unit of a source's kind.
struct Case {
    name: &'static str,
    about: &'static str,
    kind: Kind,
    profile: &'static str,
    effects: &'static [&'static str],
    /// Another profile that they are judged on.
    other: &'static str,
    /// From here on the runs are judged, s: the paper's figures leave out what comes before.
    from_s: f64,
    /// The method whose image is flown.
    flown: &'static str,
    /// Figures that the source prints, as three sigma in deg/h: another unit's results.
    theirs: &'static [(&'static str, &'static str)],
}

/// Name of the second plant in tables.
const FOREIGN_NAME: &str = "second-plant";

const FOREIGN_ABOUT: &str = "Units of the second plant (`host-tests/foreign-plant`), which shares no code with this project's effects: five each that follow the far end \
of a rod, Bouc and Wen's hysteresis, two hinges over temperature, a saturating dT/dt, and a mixture. Three sigma on the run that chose nothing, where the noise alone has 1.";

/// Figures that dong2023 prints.
const DONG: &[(&str, &str)] = &[
    ("raw", "cooling 7.071, heating 9.512"),
    ("pso-literal-10ms", "cooling 3.812, heating 5.096"),
    ("two-sets-held", "cooling 3.753, heating 5.022"),
];

const CASES: [Case; 4] = [
    Case {
        name: "dong-like",
        about: "HRG: cool to -40 C, soak 5 h, heat at 1 C/min to 50 C; eq 7 and a warm-up that eq 7 lacks",
        kind: Kind::Hrg,
        profile: "dong",
        effects: &["warm-up:tau_s=1500,size=3"],
        other: "verify",
        from_s: 0.0,
        flown: "trace",
        theirs: &[],
    },
    Case {
        name: "dong2023",
        about: "the same units on the paper's own profile, whose two ramps differ",
        kind: Kind::Hrg,
        profile: "dong2023",
        effects: &["warm-up:tau_s=1500,size=3"],
        other: "verify",
        from_s: 0.0,
        flown: "trace",
        theirs: DONG,
    },
    Case {
        name: "wu-like",
        about: "FOG: -40 to 60 C and back at 1 C/min; four parameters and a breakpoint",
        kind: Kind::Fog,
        profile: "wu",
        effects: &[],
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
        about: "HRG: 5 h at 0 C, 5 C/min to 60 C, hold for 100 min; bias a bent curve of temperature; judged from the ramp's start on",
        kind: Kind::Zhao,
        profile: "zhao",
        effects: &[],
        other: "0,5h,50@2,90m,10@1,2h",
        from_s: 5.0 * 3600.0,
        flown: "ga-bp",
        theirs: &[("raw", "repeat 7.150"), ("polynomial", "repeat 0.370"), ("ga-bp", "repeat 0.232")],
    },
];

impl Case {
    fn run_of(&self, profile: &str, unit: u64, seed: u64) -> Result<Recording> {
        let effects = self.effects.iter().map(|e| EffectSpec::parse(e)).collect::<Result<Vec<_>, _>>()?;
        let kind = self.kind;
        let plan = Plan { kind, effects, noise: kind.noise(), ..Plan::of(Profile::parse(profile)?, unit, seed) };
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

/// Compares the methods on one case and writes its part of the page.
fn side_by_side(case: &Case, elf: &[u8], work: &Work<'_>, text: &mut String) -> Result<Spread> {
    println!("{}: {} (simulated)", case.name, case.about);
    let mut s = spread::spread(case, work)?;
    let folder = spread::folder(work.out, case.name, 1, 1);
    let images: Vec<_> = s.first.rows.iter().map(|r| folder.join(format!("{}.toml", r.method))).collect();
    let steps = Steps::new(&case.run_of(case.profile, 1, spread::case_noise(work, 1, 1) + 1)?)?;
    let counted = cost::costs(elf, &images, &steps, 120)?;
    s.first.rows.iter_mut().zip(counted).for_each(|(row, w)| row.cost = Some(w));
    let about = format!("{}. The other profile: `{}`.", case.about, case.other);
    page_of(case.name, &about, case.theirs, "deg/h", &s, work, text)?;
    let searches = compare::searches(&s.first)?;
    let _ = writeln!(text, "\nWhat the searches reached on the first unit and draw:\n");
    for r in s.first.rows.iter().filter(|r| Method::by_name(&r.method).is_some_and(has_a_search)) {
        let _ = writeln!(text, "- `{}`: {}", r.method, r.notes.join("; "));
    }
    picture_beside(work, &format!("searches-{}.svg", case.name), &searches, text)?;
    Ok(s)
}

/// A case's part of the page: heading, table, picture.
fn page_of(
    name: &str,
    about: &str,
    theirs: &[(&str, &str)],
    unit: &str,
    s: &Spread,
    work: &Work<'_>,
    text: &mut String,
) -> Result<()> {
    let table = s.table(theirs);
    println!("{table}");
    let _ = write!(text, "\n## {name}\n{about}\n\n{table}");
    let draws = s.rows.first().map_or(0, |(_, all)| all.len());
    let title = format!("{name}: three sigma of 100 s means, median of {draws} draws");
    picture_beside(work, &format!("methods-{name}.svg"), &s.picture(&title, unit)?, text)
}

/// Writes a picture beside the page, where there is one, and into the folder.
fn picture_beside(work: &Work<'_>, name: &str, picture: &str, text: &mut String) -> Result<()> {
    hrg_data::output::write_file(&work.out.join(name), picture.as_bytes())?;
    if let Some(table) = work.table {
        hrg_data::output::write_file(&table.with_file_name(name), picture.as_bytes())?;
        let _ = writeln!(text, "\n![{name}]({name})");
    }
    Ok(())
}

/// Text of the page before its tables.
const HEAD: &str = "# Identification methods side by side

Printed by `cargo xtask methods`; everything here is simulated, save the column \"theirs\": what the papers print for
*their* units (as three sigma), which are other units than these.

Each figure is the median over all draws, with the least and the most of them in brackets; how many units and draws of noise, is below. Two medians
whose ranges overlap rank nothing. Columns: numbers identified per axis; three sigma of 100 s means (deg/h, RMS of the axes) on a *repeat* of the training run, on its
cooling and its heating stage (a soak with the ramp before it, as in dong2023's Table 4), and on a run of *another profile*; the *mean* of that run, which three sigma
about its own mean leaves out. No method has seen any of these runs; the trace has decided on a third one, another repeat, whether it holds. Then, of the first
unit and draw: instructions on the unit from one frequency to its bias, and of a whole update of three axes; bytes of the image; frames of two minutes of the ELF that
are not those of the desktop.
";

/// Runs of the comparison, and the places of its results.
#[derive(Debug)]
pub struct Work<'a> {
    /// Folder of the files.
    pub out: &'a Path,
    /// Seed of noise and searches.
    pub seed: u64,
    /// Units of each case.
    pub units: u64,
    /// Draws of noise for each unit.
    pub seeds: u64,
    /// Folder with recordings of the second plant, where it takes part.
    pub foreign: Option<&'a Path>,
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
    let &Work { out, seconds, fly: only, page, .. } = work;
    let mut text = String::from(HEAD);
    let _ = writeln!(text, "\nUnits of each kind: {}; draws of noise for each: {} (`--units`, `--seeds`); of the second plant: as many units of each of five kinds, one draw.", work.units, work.seeds);
    let mut flights = Vec::new();
    let mut all = Vec::new();
    for case in &CASES {
        all.push((case.name, side_by_side(case, elf, work, &mut text)?));
        if only.is_none_or(|name| name == case.name) {
            let image = spread::folder(out, case.name, 1, 1).join(format!("{}.toml", case.flown));
            flights.push((case, image, case.run_of(case.profile, 1, spread::case_noise(work, 1, 1) + 9)?));
        }
    }
    if let Some(folder) = work.foreign {
        let s = spread::foreign(folder, work)?;
        page_of(FOREIGN_NAME, FOREIGN_ABOUT, &[], "of the noise", &s, work, &mut text)?;
        all.push((FOREIGN_NAME, s));
    }
    let short = spread::summary(&all.iter().map(|(name, s)| (*name, s)).collect::<Vec<_>>());
    hrg_data::output::write_file(&out.join("short.md"), short.as_bytes())?;
    let steps = step::table(work)?;
    println!("{steps}");
    if let Some(page) = page {
        crate::pages::splice(page, "methods", &short)?;
        crate::pages::splice(page, "lag", &steps)?;
    }
    if flights.is_empty() {
        return finish(&text, work);
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
    finish(&text, work)
}

/// Writes the page.
fn finish(text: &str, work: &Work<'_>) -> Result<()> {
    hrg_data::output::write_file(&work.out.join("methods.md"), text.as_bytes())?;
    work.table.map_or(Ok(()), |table| hrg_data::output::write_file(table, text.as_bytes()))
}
