//! `hrg calibrate`: a day at the chamber in one command, which can be stopped and goes on where it was.

use crate::chamber::{burn, record_until, BurnArguments, RecordArguments};
use crate::colour::painted;
use crate::wait::with_a_bar;
use anyhow::{Context, Result};
use clap::Args;
use hrg::judge::{corrects, judge, Limit, Verdict};
use hrg::profiles;
use hrg::unit::port::{name_of, Unit};
use hrg::unit::self_test;
use hrg_core::AXES;
use hrg_data::axes::AXIS_NAMES;
use hrg_data::error::BadInput;
use hrg_data::image_file;
use hrg_data::output::write_file;
use hrg_data::page::{boxed, page, Tone};
use hrg_data::plot::escape;
use hrg_data::recording::steps::SHORTEST;
use hrg_data::recording::Recording;
use hrg_identify::family::design::Over;
use hrg_identify::family::Family;
use hrg_identify::fit;
use hrg_identify::fit::independence::Units;
use hrg_identify::trace;
use hrg_simulate::Profile;
use serde::{Deserialize, Serialize};
use std::fmt::Write as _;
use std::io::{IsTerminal, Write as _};
use std::path::{Path, PathBuf};

/// Arguments of `hrg calibrate`.
#[derive(Args)]
pub struct Arguments {
    /// Serial port of the link.
    #[arg(long)]
    port: String,
    /// Profile of the chamber for the run that is learnt from: a named one, or one written out like 20,-40@1,2h,50@1,2h
    #[arg(long, allow_hyphen_values = true)]
    profile: String,
    /// Profile of the run that judges: another one than that.
    #[arg(long, allow_hyphen_values = true, default_value = "verify")]
    verify_profile: String,
    /// Largest error of the corrected rates that passes, deg/h, the constant included.
    #[arg(short, long)]
    limit: f64,
    /// Lowest temperature of the range, C.
    #[arg(long, allow_negative_numbers = true)]
    from: f64,
    /// Highest temperature of the range, C.
    #[arg(long, allow_negative_numbers = true)]
    to: f64,
    /// A family that the unit is of (hrg family): the run that is learnt from ends as soon as three standard uncertainties are within the limit.
    #[arg(long, value_name = "FAMILY")]
    prior: Option<PathBuf>,
    /// Folder for the unit: recordings, calibration, report. What is there already is not done again.
    #[arg(long)]
    folder: PathBuf,
    /// Burn without asking, where the judge says PASS and the image leaves less than the raw rates.
    #[arg(long)]
    yes: bool,
    /// Private key (hrg unit keygen), for a unit that takes signed calibrations only.
    #[arg(long, value_name = "FILE")]
    key: Option<PathBuf>,
    #[command(flatten)]
    recording: RecordArguments,
}

/// Seconds between two looks at what is known.
const LOOK_S: u64 = 600;
/// Standard uncertainties within the limit: the largest error of a run is rarely beyond.
const DEVIATIONS: f64 = 3.0;

/// Seconds in which the unit on the port is looked at before the burn: less is no recording that can be used.
const LOOK_BEFORE_BURN_S: u64 = 200;

/// A day's own facts: what a folder was begun for.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct Begun {
    unit: Option<String>,
    profile: String,
    verify_profile: String,
}

/// The folder of a unit, and the port that it is on.
struct Day<'a> {
    arguments: &'a Arguments,
    limit: Limit,
    family: Option<(Family, Over)>,
}

/// Runs the command; `true` if the unit passes and is burnt.
///
/// # Errors
/// Bad input; a unit that fails its test or cannot be reached; files that cannot be written. What was done stays.
pub fn run(arguments: &Arguments) -> Result<bool> {
    let limit = Limit { limit_dph: arguments.limit, from_c: arguments.from, to_c: arguments.to, means_s: fit::MEAN_S };
    limit.check()?;
    let (train, verify) = (Profile::parse(&arguments.profile)?, Profile::parse(&arguments.verify_profile)?);
    if train == verify {
        return Err(BadInput::new(
            "--verify-profile is --profile: a run that repeats what was learnt from judges nothing; give another one",
        )
        .into());
    }
    std::fs::create_dir_all(&arguments.folder)
        .with_context(|| format!("cannot make {}", arguments.folder.display()))?;
    let family = arguments.prior.as_deref().map(hrg::fleet::read_family).transpose()?;
    let family = family
        .map(|f| {
            let over = profiles::use_over(&f, [arguments.from, arguments.to])?;
            Ok::<_, BadInput>((f, over))
        })
        .transpose()?;
    let day = Day { arguments, limit, family };
    day.is_the_one_that_was_begun()?;
    day.check()?;
    day.record("train", &train, true)?;
    day.record("verify", &verify, false)?;
    day.identify()?;
    let passed = day.judged()?;
    let burnt = day.burnt(passed)?;
    day.report()?;
    Ok(passed && burnt)
}

impl Day<'_> {
    fn file(&self, name: &str) -> PathBuf {
        self.arguments.folder.join(name)
    }

    /// Compares what the folder was begun for with this command, or writes it down.
    fn is_the_one_that_was_begun(&self) -> Result<()> {
        let Arguments { profile, verify_profile, recording, .. } = self.arguments;
        let now =
            Begun { unit: recording.unit.clone(), profile: profile.clone(), verify_profile: verify_profile.clone() };
        let path = self.file("day.json");
        let Ok(text) = std::fs::read(&path) else {
            return write_file(&path, serde_json::to_string_pretty(&now)?.as_bytes());
        };
        let before: Begun = serde_json::from_slice(&text)
            .map_err(|e| BadInput(format!("{}: {e}; remove it if the folder is of this unit", path.display())))?;
        let name = |unit: &Option<String>| unit.clone().unwrap_or("none".into());
        for (option, was, is) in [
            ("--unit", name(&before.unit), name(&now.unit)),
            ("--profile", before.profile.clone(), now.profile.clone()),
            ("--verify-profile", before.verify_profile.clone(), now.verify_profile.clone()),
        ] {
            if was != is {
                return Err(BadInput(format!(
                    "{} was begun with {option} {was}, and now it is {is}: give the same, or another folder",
                    self.arguments.folder.display()
                ))
                .into());
            }
        }
        Ok(())
    }

    /// Tests that the unit on the port has the name that the recordings have, as far as both have one.
    fn is_on_the_port(&self) -> Result<()> {
        let identity = Unit::open(&self.arguments.port)?.identity()?;
        let recorded = ["train", "verify"].into_iter().flat_map(|role| self.files(role)).find_map(|p| {
            let text = std::fs::read_to_string(p).ok()?;
            fact(&text, "# unit:").filter(|n| !hrg_data::recording::names::is_unnamed(n))
        });
        match (name_of(&identity), recorded) {
            (Some(there), Some(recorded)) if there != recorded => Err(BadInput(format!(
                "{}: the unit there is {there}, and the recordings in {} are of {recorded}: put that one on, or give another folder",
                self.arguments.port,
                self.arguments.folder.display()
            ))
            .into()),
            _ => Ok(()),
        }
    }

    /// `true` if a step has left what it has to leave.
    fn is_done(&self, done: &str) -> bool {
        let path = self.file(done);
        let json = |name: &str| -> Option<serde_json::Value> {
            serde_json::from_slice(&std::fs::read(self.file(name)).ok()?).ok()
        };
        match done {
            "test.json" => json(done).is_some_and(|test| test["verdict"] == "PASS"),
            "calibration.toml" => image_file::load(&path).is_ok() && json("trace.json").is_some(),
            _ => path.exists(),
        }
    }

    /// Begins a step; `false` where it was done before.
    fn begins(&self, number: u32, what: &str, done: &str) -> bool {
        let there = self.is_done(done);
        println!("{number}. {what}{}", if there { ": done before" } else { "" });
        !there
    }

    /// The built-in test.
    fn check(&self) -> Result<()> {
        if !self.begins(1, "built-in test", "test.json") {
            return Ok(());
        }
        let mut unit = Unit::open(&self.arguments.port)?;
        let report =
            self_test::Report::of(&mut unit, None, |_: &str| {}).with_context(|| self.arguments.port.clone())?;
        println!("{}", painted(&report.table(false)));
        if report.verdict != "PASS" {
            return Err(BadInput(format!(
                "{}: the unit does not pass its own test: see what says FAIL above, and repair that first (where it is the time of an answer alone, this computer may have been busy: give the command again)",
                self.arguments.port
            ))
            .into());
        }
        write_file(&self.file("test.json"), serde_json::to_string_pretty(&report)?.as_bytes())
    }

    /// The names that the recordings of a role get, one after the other.
    fn names<'a>(&'a self, role: &'a str) -> impl Iterator<Item = PathBuf> + 'a {
        (1..).map(move |k| self.file(&format!("{role}-{k}.csv")))
    }

    /// The recordings of a role, in the order in which they were made.
    fn files<'a>(&'a self, role: &'a str) -> impl Iterator<Item = PathBuf> + 'a {
        self.names(role).take_while(|p| p.exists())
    }

    /// The runs of a role as text. A recording that was stopped while the unit stayed on goes on in the next file: they are one run. A row that was
    /// torn off, and a file without rows, count as nothing.
    fn texts(&self, role: &str) -> Vec<(PathBuf, String)> {
        let mut runs: Vec<(PathBuf, String)> = Vec::new();
        for path in self.files(role) {
            let Some(text) = whole_rows(&path) else { continue };
            match runs.last_mut().filter(|(_, before)| goes_on(before, &text)) {
                Some((_, before)) => *before += &rows_of(&text),
                None => runs.push((path, text)),
            }
        }
        runs
    }

    /// The runs of a role that are long enough.
    fn runs(&self, role: &str) -> Result<Vec<Recording>> {
        let mut out = Vec::new();
        for (path, text) in self.texts(role) {
            let rows = rows_of(&text).lines().count();
            // (A cable that was pulled, a unit that was off again at once.)
            if rows < SHORTEST {
                println!("   {}: {rows} rows alone are no run, they are left out", path.display());
                continue;
            }
            let read = || -> Result<Recording, BadInput> {
                let mut r = Recording::parse(text.as_bytes())?;
                r.clean()?;
                Ok(r)
            };
            out.push(read().map_err(|e| BadInput(format!("{}: {e}", path.display())))?);
        }
        Ok(out)
    }

    /// Rows of a role that are there already.
    fn rows(&self, role: &str) -> u64 {
        self.texts(role).iter().map(|(_, text)| rows_of(text).lines().count() as u64).sum()
    }

    /// Records a run of the chamber. A recording that was stopped goes on in a further file.
    fn record(&self, role: &str, profile: &Profile, may_end: bool) -> Result<()> {
        let (number, done) = (if may_end { 2 } else { 3 }, format!("{role}.done"));
        if !self.begins(number, &format!("the {role} run"), &done) {
            return Ok(());
        }
        self.is_on_the_port()?;
        let wanted = profile.temperatures().len() as u64;
        let before = self.texts(role).pop().map(|(_, text)| text);
        let had = before.as_ref().map_or(0, |text| rows_of(text).lines().count() as u64);
        println!(
            "   chamber: {profile} ({:.1} h{})",
            wanted as f64 / 3600.0,
            if had > 0 { format!(", {:.1} h of it are recorded", had as f64 / 3600.0) } else { String::new() }
        );
        let out = self.names(role).find(|p| !p.exists()).context("no free name")?;
        // Rows of this run that lie in the files before; not known before the first row of this one.
        let mut known: Option<u64> = before.is_none().then_some(0);
        let mut looked = had;
        let finished = record_until(&self.arguments.port, &out, &self.arguments.recording, |rows| {
            if let (None, Some(before), Some(text)) = (known, &before, whole_rows(&out)) {
                let same = goes_on(before, &text);
                if !same {
                    println!("   the unit was off in between: the profile begins anew, and so does the run");
                }
                known = Some(if same { had } else { 0 });
            }
            let all = known.unwrap_or(had) + rows;
            if known.is_some() && all >= wanted {
                return Ok(true);
            }
            if !may_end || self.family.is_none() || all < looked + LOOK_S {
                return Ok(false);
            }
            looked = all;
            self.enough(role)
        })?;
        if !finished {
            return Err(BadInput(format!(
                "stopped in the {role} run; {} rows stay in {}, and the same command goes on there",
                self.rows(role),
                self.arguments.folder.display()
            ))
            .into());
        }
        write_file(&self.file(&done), format!("{} rows\n", self.rows(role)).as_bytes())
    }

    /// `true` if enough is known of the unit under its family.
    fn enough(&self, role: &str) -> Result<bool> {
        let Some((family, over)) = &self.family else { return Ok(false) };
        // (In its first minutes a run may hold too little for anything.)
        let Ok(prepared) = family.prepare(&self.runs(role)?, Units::Same) else { return Ok(false) };
        match family.member(&prepared, [None; AXES]) {
            Ok(member) if member.belongs() => {}
            Ok(member) => {
                println!("   {}", member.sentence(family));
                return Ok(false);
            }
            Err(_) => return Ok(false),
        }
        let longest = prepared.runs.iter().max_by_key(|r| r.steps.len());
        let expected = family.expected_dph(longest, over);
        let each: Vec<String> = AXIS_NAMES.iter().zip(expected).map(|(n, v)| format!("{n} {v:.3}")).collect();
        println!("   known to {} deg/h about the constant", each.join(", "));
        let largest = DEVIATIONS * profiles::largest(expected);
        let enough = largest.is_finite() && largest <= self.limit.limit_dph;
        if enough {
            println!("   three of it are within the limit: the run may end");
        }
        Ok(enough)
    }

    /// Fit and trace.
    fn identify(&self) -> Result<()> {
        if !self.begins(4, "fit and trace", "calibration.toml") {
            return Ok(());
        }
        let (train, verify) = (self.runs("train")?, self.runs("verify")?);
        let last = verify.last().context("no verify run")?;
        let options =
            trace::Options { family: self.family.as_ref().map(|(f, _)| f.clone()), ..trace::Options::default() };
        let traced = with_a_bar("tracing", || trace::trace_with(&train, last, &options))?;
        println!("   {}", traced.report.verdict);
        write_file(&self.file("trace.json"), trace::json(&traced.report).as_bytes())?;
        write_file(&self.file("trace.html"), trace::html(&traced)?.as_bytes())?;
        let mut image = traced.image;
        image.created_unix_s = crate::now();
        image_file::save(&self.file("calibration.toml"), &image)
    }

    /// The judge on the verify run.
    fn judged(&self) -> Result<bool> {
        println!("5. judge");
        let c = image_file::load(&self.file("calibration.toml"))?;
        let judgement = judge(&self.runs("verify")?, &c, &self.limit)?;
        println!("   {}", painted(&judgement.line()));
        print!("{}", painted(&judgement.table()));
        write_file(&self.file("judged.json"), serde_json::to_string_pretty(&judgement)?.as_bytes())?;
        write_file(&self.file("judged.html"), judgement.html()?.as_bytes())?;
        Ok(judgement.verdict == Verdict::Pass)
    }

    /// Burns the image after a yes, and reads it back.
    fn burnt(&self, passed: bool) -> Result<bool> {
        if !self.begins(6, "burn", "burnt.done") {
            return Ok(true);
        }
        if !passed {
            println!("   not burnt: it does not pass");
            return Ok(false);
        }
        let traced: serde_json::Value = serde_json::from_slice(&std::fs::read(self.file("trace.json"))?)?;
        if traced["image"] == "none" {
            println!("   not burnt: no image leaves less than the raw rates on the verify run");
            return Ok(false);
        }
        self.looked_at()?;
        if !self.arguments.yes {
            if !std::io::stdin().is_terminal() {
                println!("   not burnt: nobody is there to say yes; give --yes, or call the command in a terminal");
                return Ok(false);
            }
            print!("   burn calibration.toml into the unit? [y/N] ");
            // (The macro that stands for print! has no flush.)
            std::io::stdout().flush()?;
            let mut answer = String::new();
            std::io::stdin().read_line(&mut answer)?;
            if !matches!(answer.trim(), "y" | "Y" | "yes") {
                println!("   not burnt");
                return Ok(false);
            }
        }
        let Arguments { port, recording, key, .. } = self.arguments;
        burn(&BurnArguments::of(&self.file("calibration.toml"), port, recording, key.as_deref()))?;
        write_file(&self.file("burnt.done"), b"burnt, read back\n")?;
        Ok(true)
    }

    /// Looks at the unit on the port: the image must correct what it sends now.
    fn looked_at(&self) -> Result<()> {
        self.is_on_the_port()?;
        let path = self.file("before-burn.csv");
        let _ = std::fs::remove_file(&path);
        println!("   looking at the unit on the port for {LOOK_BEFORE_BURN_S} s");
        let looked =
            record_until(
                &self.arguments.port,
                &path,
                &self.arguments.recording,
                |rows| Ok(rows >= LOOK_BEFORE_BURN_S),
            )?;
        if !looked {
            return Err(BadInput::new("stopped before the burn; the same command goes on there").into());
        }
        let mut now = Recording::parse(whole_rows(&path).unwrap_or_default().as_bytes())?;
        now.clean()?;
        let here = |e: BadInput| BadInput(format!("{}: {e}", self.arguments.port));
        Ok(corrects(&now, &image_file::load(&self.file("calibration.toml"))?, &self.limit).map_err(here)?)
    }

    /// One page for the file of the unit.
    fn report(&self) -> Result<()> {
        let read = |name: &str| std::fs::read_to_string(self.file(name)).unwrap_or_default();
        let json = |name: &str| serde_json::from_str::<serde_json::Value>(&read(name)).unwrap_or_default();
        let (test, traced, judged) = (json("test.json"), json("trace.json"), json("judged.json"));
        let word = |v: &serde_json::Value| escape(v.as_str().unwrap_or("-"));
        let burnt = self.file("burnt.done").exists();
        let verdict = word(&judged["verdict"]);
        let tone = if verdict == "PASS" && burnt { Tone::Good } else { Tone::Bad };
        let mut s = format!("<h1>Calibration of {}</h1>", word(&judged["unit"]));
        let a = self.arguments;
        s += &boxed(
            &format!(
                "<b>{verdict}</b> within {} deg/h from {} to {} C; {}.",
                a.limit,
                a.from,
                a.to,
                if burnt { "burnt and read back" } else { "not burnt" }
            ),
            tone,
        );
        let _ = write!(s, "<table><tr><th>step<th class=left>result");
        let rows = |role: &str| format!("{:.1} h", self.rows(role) as f64 / 3600.0);
        let image = image_file::load(&self.file("calibration.toml"))?;
        for (step, result) in [
            ("built-in test", word(&test["verdict"])),
            ("train run", format!("{}, profile {}", rows("train"), escape(&a.profile))),
            ("verify run", format!("{}, profile {}", rows("verify"), escape(&a.verify_profile))),
            ("trace", word(&traced["verdict"])),
            ("judge", verdict),
            ("image", format!("number {}, checksum {:08x}", image.sequence, image.checksum())),
        ] {
            let _ = write!(s, "<tr><td>{step}<td class=left>{result}");
        }
        s += "</table><p>In the same folder: <a href=trace.html>trace</a>, <a href=judged.html>judgement</a>, calibration.toml, the recordings.</p>";
        let path = self.file("report.html");
        write_file(&path, page("Calibration", &s).as_bytes())?;
        println!("{}: the report", path.display());
        Ok(())
    }
}

/// The text of a recording up to its last whole row; `None` without a row.
fn whole_rows(path: &Path) -> Option<String> {
    let mut text = std::fs::read_to_string(path).ok()?;
    text.truncate(text.rfind('\n')? + 1);
    (!rows_of(&text).is_empty()).then_some(text)
}

/// A fact in the head of a recording's text.
fn fact(text: &str, key: &str) -> Option<String> {
    text.lines().find_map(|l| l.strip_prefix(key).map(|v| v.trim().to_string()))
}

/// The rows of a recording's text.
fn rows_of(text: &str) -> String {
    let rows = text.lines().filter(|l| !l.starts_with('#')).skip(1);
    rows.map(|l| format!("{l}\n")).collect()
}

/// `true` if a recording goes on where another one ended: the same columns of the same unit, later rows, and no power-on in between. The clock of the
/// host need not go as fast as the unit's (a board that is sped up): a later power-on is later by all that the first recording holds.
fn goes_on(before: &str, next: &str) -> bool {
    let columns = |t: &str| t.lines().find(|l| !l.starts_with('#')).map(String::from);
    let time = |row: Option<&str>| row.and_then(|r| r.split(',').next()?.parse::<f64>().ok());
    let first = rows_of(next);
    let (Some(last), Some(then)) = (time(before.lines().last()), time(first.lines().next())) else { return false };
    let power_on = |t: &str| fact(t, "# power_on_unix_s:").and_then(|v| v.parse::<f64>().ok());
    let stayed_on = power_on(before).zip(power_on(next)).is_none_or(|(a, b)| b - a < 0.5 * last);
    let same = columns(before) == columns(next) && fact(before, "# unit:") == fact(next, "# unit:");
    same && stayed_on && last < then
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_recording_goes_on_unless_the_unit_was_off() {
        let part = |power_on: f64, unit: &str, times: [u32; 2]| {
            format!(
                "# unit: {unit}\n# power_on_unix_s: {power_on}\ntime_s,fx_hz\n{},4900\n{},4900\n",
                times[0], times[1]
            )
        };
        let before = part(1000.0, "HRG-1", [1, 700]);
        for (next, same) in [
            (part(1000.8, "HRG-1", [702, 900]), true),
            // A board that is thirty times as fast: the host counts fewer seconds than the unit.
            (part(400.0, "HRG-1", [702, 900]), true),
            // Off for a moment, and on for longer than before.
            (part(1720.0, "HRG-1", [750, 900]), false),
            (part(1720.0, "HRG-1", [1, 900]), false),
            (part(1000.8, "HRG-2", [702, 900]), false),
        ] {
            assert_eq!(goes_on(&before, &next), same, "{next}");
        }
    }
}
