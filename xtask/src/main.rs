//! `cargo xtask demo`, `cargo xtask test` and the smaller steps that they are made of.

mod bring_up;
mod course;
mod elf;
mod fingerprint;
mod fuzz;
mod hil;
mod library;
mod pages;
mod printed;
mod python;
mod reference;
mod setup;
// (The package itself would have to be compiled first.)
#[path = "../../hrg-core/src/slots.rs"]
#[allow(dead_code, unused_extern_crates)]
mod slots;

use setup::Toolchain;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};

/// Why a step failed: a sentence.
#[derive(Debug)]
pub struct Failure(pub String);

const USAGE: &str = "cargo xtask COMMAND

  demo [--seed N]   the main job: simulate a unit, calibrate it, run the flashed program on the virtual board
  test              format, lints, documentation, host tests, firmware size, the ELF on the virtual board (--rest: what is slow and seldom
                    breaks: other chips, each part of the firmware left out, the wheel, the pages, campaigns in short form)
  build             the firmware, and the programs hrg and hrg-board (target/release)
  size [--signed | --minimal | --sensors | --aux | --mavlink | --stm32f405rg | --bring-up | --chip-tests | --slot-b | --nrf52840]   what the firmware takes of flash and RAM (--signed: the one
                    with signed calibrations and a battery; --minimal: the one without the parts that a unit can do without; --sensors: the one with platinum resistors in the place of resonators; --aux: the one with inputs at the ADC; --mavlink: the one with that framing; --stm32f405rg:
                    the one for that chip; --nrf52840: the example for users of hrg-core)
  fuzz [SECONDS]    the fuzz targets, each for so long (default 60), from the corpora kept in fuzz/corpus
  audit             licences, advisories, duplicates and sources of every dependency (cargo-deny)
  bring-up          the first hour with a bare NUCLEO-F446RE and jumpers (docs/bring-up.md): measures, and prints a table (--virtual: on the virtual
                    board; --expect: what it says there is what is expected; --without PB9-PA0: one jumper missing)
  hil               tests for the chip (embedded-test) and the bring-up, on a board and on the virtual one, and what differs (--virtual:
                    there only; --bare: no jumpers, the tests alone)
  update [--key FILE] [--out FILE]   the firmware linked for both slots, packed for hrg unit update (--key: built to want that key's signatures, and signed with it)
  flash             put the firmware on a board and show its log (probe-rs)
  align-demo [ARGS] self-alignment: campaigns over the filters, their cost, chen2015's case on the flashed program
  screens           draw what docs/chamber.md shows: the monitor's screen and an Allan deviation
  bench [ARGS]      what the unit costs in instructions and bytes, and the desktop in time (--page docs/bench.md: into that page)
  fingerprint       checksums of frames, images, files, traces of 20 units and a short study: compare them before and after a change
                    that should change nothing (about 30 min)
  mutate [ARGS]     make one write of the program's set-up wrong at a time; the virtual board must notice (--short: a tenth; --page: into a page)
  faults [ARGS]     attack what docs/promises.md promises: power, memory, sensors, link, load, time (about 100 min; --short: 1)
  methods [ARGS]    every identification method on simulated units of three kinds and of the second plant, costs counted, and flown (40 min; --units 5 --seeds 1 --fly none: 10)
  study [ARGS]      the seeded campaign behind docs/trace.md
  study --controls [N] the trace on N clean units (default 600), a third with the spectra of measured residuals, into docs/controls.md
  study --foreign [N [FIRST]]  the trace on the second plant, N seeds (default 1) from FIRST (default 1) on, graded into docs/foreign.md
  study --inputs [N]   units of the second plant whose bias follows drive and quadrature, seeds 1 to N (default 4): with their inputs and
                    without, on a run that judges, and through the ELF, into docs/inputs.md (9 min)
  study --family [N]   N new units of designs of the second plant (default 40), a short run under a family of 30 against a long one without, into
                    docs/family.md (25 min)
  measured          the loop on the measured recordings: every method and the trace, before and after, into docs/measured.md, its
                    picture and the README's caption
  wu2023 [ARGS]     wu2023's loop on a simulated gyro with temperature sensors and no resonator (--page docs/methods.md: into that page)
  rates [ARGS]      scale factor and misalignment over temperature on a simulated unit, before and after, through the ELF (12 min)
  output [ARGS]     rates and increments as a navigator gets them: filters swept, coning, time, link and processor (--page docs/navigator.md)
  formats           columns of recordings and tables of bytes, into docs/formats.md
  pages [PAGE...] [--all]   every command of the pages, in the page's order, each page in an empty folder (out/pages); --all: those that
                    take minutes, too
  reference         the status bits in docs/formats.md, and docs/reference.md with the help of every command (for the book; not kept)
  python            the tests of the Python package, as it was last installed by `test`
  wheel             the Python package as a wheel, into target/wheels
  setup             only install what is missing";

/// Bounds of the firmware, bytes.
const FLASH_BOUND: u64 = 180_500;
/// The same with the check of signatures: it leaves a tenth of its slot (memory.x).
const SIGNED_FLASH_BOUND: u64 = slots::ROOM as u64 * 9 / 10;
/// The smallest unit.
const MINIMAL_FLASH_BOUND: u64 = 134_000;
const RAM_BOUND: u64 = 64 * 1024;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let rest = arguments.get(1..).unwrap_or_default();
    let result = match arguments.first().map(String::as_str) {
        Some("demo") => study("demo", rest).and_then(|()| page_of(rest, "cargo xtask demo", true)),
        Some("screens") => screens(),
        Some("align-demo") => study("align-demo", rest).and_then(|()| page_of(rest, "cargo xtask align-demo", false)),
        Some("bench") => study("bench", rest)
            .and_then(|()| tool("hrg-study", &[vec!["bench-desktop".to_string()], rest.to_vec()].concat()))
            .and_then(|()| page_of(rest, "cargo xtask bench", false)),
        Some("fingerprint") => fingerprint::print(rest),
        Some("faults") => study("faults", rest).and_then(|()| page_of(rest, "cargo xtask faults", false)),
        Some("mutate") => study("mutate", rest),
        Some("methods") => methods(rest).and_then(|()| page_of(rest, "cargo xtask methods", false)),
        Some("test") => course::test(rest),
        Some("build") => setup::toolchain().and_then(|t| build(&t)).and_then(|()| programs()),
        Some("size") if rest.first().is_some_and(|a| a == "--signed") => setup::toolchain().and_then(|t| signed(&t)),
        Some("size") if rest.first().is_some_and(|a| a == "--stm32f405rg") => {
            setup::toolchain().and_then(|t| other_chip(&t))
        }
        Some("size") if rest.first().is_some_and(|a| a == "--sensors") => {
            setup::toolchain().and_then(|t| with_feature(&t, "sensors"))
        }
        Some("size") if rest.first().is_some_and(|a| a == "--aux") => {
            setup::toolchain().and_then(|t| with_feature(&t, "aux"))
        }
        Some("size") if rest.first().is_some_and(|a| a == "--mavlink") => {
            setup::toolchain().and_then(|t| with_feature(&t, "mavlink"))
        }
        Some("size") if rest.first().is_some_and(|a| a == "--minimal") => setup::toolchain().and_then(|t| minimal(&t)),
        Some("size") if rest.first().is_some_and(|a| a == "--bring-up") => bring_up::build(),
        Some("size") if rest.first().is_some_and(|a| a == "--chip-tests") => {
            setup::toolchain().and_then(|t| hil::chip_tests(&t)).map(drop)
        }
        Some("size") if rest.first().is_some_and(|a| a == "--nrf52840") => {
            setup::toolchain().and_then(|t| library::example(&t))
        }
        Some("size") if rest.first().is_some_and(|a| a == "--slot-b") => setup::toolchain().and_then(|t| slot_b(&t)),
        Some("size") => size(),
        Some("bring-up") => bring_up::bring_up(rest),
        Some("hil") => hil::hil(rest),
        Some("update") => update(rest),
        Some("flash") => flash(),
        Some("fuzz") => setup::host().and_then(|()| fuzz::campaign(rest)),
        Some("audit") => audit(),
        Some("study") if rest.first().is_some_and(|a| a == "--foreign") => foreign(&rest[1..]),
        Some("study") if rest.first().is_some_and(|a| a == "--controls") => controls(&rest[1..]),
        Some("study") if rest.first().is_some_and(|a| a == "--inputs") => inputs(&rest[1..]),
        Some("study") if rest.first().is_some_and(|a| a == "--family") => families(&rest[1..]),
        Some("study") => tool("hrg-study", &[vec!["trace".to_string()], rest.to_vec()].concat())
            .and_then(|()| page_of(rest, &["cargo xtask study", &rest.join(" ")].join(" "), true)),
        Some("measured") => measured(),
        Some("formats") => tool("hrg-study", &["formats", "--page", "docs/formats.md"].map(String::from)),
        Some("rates") => study("rates", rest),
        Some("output") => study("output", rest).and_then(|()| page_of(rest, "cargo xtask output", false)),
        Some("wu2023") => tool("hrg-study", &[vec!["wu2023".to_string()], rest.to_vec()].concat()),
        Some("python") => python::tests(),
        Some("wheel") => python::wheel().map(|w| println!("{}", w.display())),
        Some("pages") => pages(rest),
        Some("reference") => programs().and_then(|()| reference::write()),
        Some("setup") => setup::toolchain().and_then(|_| setup::host()),
        _ => {
            eprintln!("{USAGE}");
            return ExitCode::from(2);
        }
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(Failure(why)) => {
            eprintln!("xtask: {why}");
            ExitCode::FAILURE
        }
    }
}

/// The workspace's top level.
fn root() -> PathBuf {
    let here = std::env::current_dir().unwrap_or_default();
    root_of(std::env::var_os("CARGO_MANIFEST_DIR").map(PathBuf::from), &here)
}

/// The top level by what cargo says when it runs this program: where it was compiled may be another folder, of which this one is a
/// copy. Without cargo it is the nearest folder above that has `xtask`.
fn root_of(package: Option<PathBuf>, here: &Path) -> PathBuf {
    let own = |top: &Path| top.join("xtask/Cargo.toml").is_file();
    let by_cargo = package.and_then(|p| Some(p.parent()?.to_path_buf())).filter(|top| own(top));
    by_cargo.or_else(|| here.ancestors().find(|top| own(top)).map(PathBuf::from)).unwrap_or_else(|| here.to_path_buf())
}

/// Runs a command at the top level; fails if it does.
fn run(command: &mut Command) -> Result<(), Failure> {
    let shown = format!("{command:?}");
    match command.current_dir(root()).status() {
        Ok(status) if status.success() => Ok(()),
        Ok(status) => Err(Failure(format!("{shown} ended with {status}"))),
        Err(e) => Err(Failure(format!("{shown} could not be started: {e}"))),
    }
}

/// Output of a command, if it succeeds.
fn output(command: &mut Command) -> Option<String> {
    let o = command.stderr(Stdio::null()).output().ok()?;
    o.status.success().then(|| String::from_utf8_lossy(&o.stdout).into_owned())
}

fn elf_path() -> PathBuf {
    root().join("target").join(setup::TARGET).join("firmware/firmware")
}

fn build(t: &Toolchain) -> Result<(), Failure> {
    println!("building the firmware");
    run(t.cargo("build").args(["--profile", "firmware", "-p", "firmware", "--locked"]))?;
    add_integrity_word(&elf_path())?;
    println!("the firmware is {}, an ELF with its checksum written in", elf_path().display());
    Ok(())
}

/// The programs that count instructions on the virtual board, beside the firmware.
fn bench_unit(t: &Toolchain) -> Result<(), Failure> {
    run(t.cargo("build").args(["--quiet", "--profile", "firmware", "-p", "bench-unit", "--locked"]))
}

/// Writes the sum of a finished program into its ELF: the program checks itself against it.
fn add_integrity_word(elf: &Path) -> Result<(), Failure> {
    write_integrity_word(elf, elf)
}

/// The same, into another file. One that is there already is left alone, so that whoever reads it now reads it whole.
fn write_integrity_word(from: &Path, to: &Path) -> Result<(), Failure> {
    let failed = |e: std::io::Error| Failure(format!("{}: {e}", to.display()));
    let mut bytes = std::fs::read(from).map_err(failed)?;
    elf::write_integrity_word(&mut bytes)
        .ok_or_else(|| Failure(format!("{} has no place for its integrity word", from.display())))?;
    if std::fs::read(to).is_ok_and(|there| there == bytes) {
        return Ok(());
    }
    std::fs::write(to, bytes).map_err(failed)
}

fn cargo(arguments: &[&str]) -> Command {
    let mut c = Command::new("cargo");
    c.args(arguments);
    c
}

/// The text that a message of cargo's (`--message-format json`) has under a key.
fn field<'m>(message: &'m str, key: &str) -> Option<&'m str> {
    let (_, rest) = message.split_once(&format!("\"{key}\":\""))?;
    rest.split_once('"').map(|(value, _)| value)
}

/// Builds the host programs in release: all of them at once, for other packages beside them would choose other features of their
/// dependencies, and compile these anew.
fn programs() -> Result<(), Failure> {
    setup::host()?;
    println!("building hrg, hrg-board, hrg-study and foreign-plant");
    run(&mut cargo(&[
        "build",
        "--release",
        "--locked",
        "-p",
        "hrg",
        "-p",
        "hrg-board",
        "-p",
        "hrg-study",
        "-p",
        "foreign-plant",
    ]))
}

/// Runs a host program in release.
fn tool(name: &str, arguments: &[String]) -> Result<(), Failure> {
    programs()?;
    run(Command::new(root().join("target/release").join(name)).args(arguments))
}

/// The trace on clean units: whatever it names is invented. Each third has the noise spectrum of a measured residual: one half of them of
/// a measured gyro, one of a measured oscillator.
fn controls(arguments: &[String]) -> Result<(), Failure> {
    let all: usize = match arguments.first() {
        Some(n) => n.parse().map_err(|_| Failure(format!("{n} is no number of units")))?,
        None => 600,
    };
    let plant = foreign_plant()?;
    let measured = root().join("host-tests/recordings/measured");
    let folder = root().join("out/controls");
    let sources = [
        (
            "imu",
            "imu_raw_data.csv.gz",
            ["--skip", "5", "--columns", "imu.gyro.x,imu.gyro.y,imu.gyro.z", "--against", "imu.temperature"],
        ),
        ("gpsdo", "gpsdo.short.csv.gz", ["--skip", "0", "--columns", "2", "--against", "1"]),
    ];
    emptied(&folder)?;
    let mut first = 0;
    let mut text = String::from("# Clean units\n\nWhatever the trace names here is invented. Rows of single units: `out/controls`, after the command.\n");
    for (k, (name, file, select)) in sources.into_iter().enumerate() {
        let count = (all + k) / 2;
        run(Command::new(&plant)
            .args(["clean", "--first", &first.to_string(), "--count", &count.to_string(), "--out"])
            .arg(folder.join(name))
            .arg("--residuals")
            .arg(measured.join(file))
            .args(select))?;
        let heading = format!(
            "## Under the noise of {name}\nSimulated by `host-tests/foreign-plant`, seeds {first} to {}; each third unit has the spectrum of measured residuals\n({file}), the others white noise, flicker, random walks and lines. Printed by `cargo xtask study --controls {all}`.",
            first + count.saturating_sub(1)
        );
        first += count;
        let (page, rows) = (folder.join(format!("{name}.md")), folder.join(format!("{name}-units.md")));
        grade(&plant, &folder.join(name), &page, &heading, Some(&rows))?;
        text += &format!("\n{}", std::fs::read_to_string(&page).map_err(|e| Failure(e.to_string()))?);
    }
    std::fs::write(root().join("docs/controls.md"), text).map_err(|e| Failure(e.to_string()))?;
    printed::stamp(&["docs/controls.md"], &format!("cargo xtask study --controls {all}"), true)
}

/// The loop on the measured recordings, and the pages that show it.
fn measured() -> Result<(), Failure> {
    let words = "measured --page docs/measured.md --caption README.md --picture docs/measured-imu.svg";
    tool("hrg-study", &words.split(' ').map(String::from).collect::<Vec<_>>())?;
    printed::stamp(&["docs/measured.md"], "cargo xtask measured", true)
}

/// Stamps the pages that a command was told to write (`--page`, `--table`).
fn page_of(arguments: &[String], command: &str, of_traces: bool) -> Result<(), Failure> {
    let named = arguments.windows(2).filter(|w| w[0] == "--page" || w[0] == "--table").map(|w| w[1].as_str());
    let pages: Vec<&str> = named.filter(|p| p.starts_with("docs/")).collect();
    if pages.is_empty() {
        return Ok(());
    }
    printed::stamp(&pages, command.trim_end(), of_traces)
}

/// The trace on the units of the second plant, graded by their truths.
fn foreign(arguments: &[String]) -> Result<(), Failure> {
    let number = |k: usize| arguments.get(k).map_or(Ok(1), |n| n.parse::<u64>());
    let (Ok(seeds @ 1..), Ok(first)) = (number(0), number(1)) else {
        return Err(Failure("study --foreign: give the number of seeds (1 or more), and the first of them".into()));
    };
    let plant = foreign_plant()?;
    let folder = root().join("out/foreign");
    emptied(&folder)?;
    let (how_many, from) = (seeds.to_string(), first.to_string());
    run(Command::new(&plant).args(["all", "--seeds", &how_many, "--first", &from, "--out"]).arg(&folder))?;
    let last = first + seeds - 1;
    let words = format!("cargo xtask study --foreign {seeds} {first}");
    let heading = format!(
        "# The trace on foreign physics\n\nSimulated by `host-tests/foreign-plant`, which shares no code with the effects nor with `hrg simulate`; seeds {first} to {last}. Printed by\n`{words}`. Floors are those of the truth; what is left is the written image's on the verify run."
    );
    grade(&plant, &folder, Path::new("docs/foreign.md"), &heading, None)?;
    printed::stamp(&["docs/foreign.md"], &words, true)
}

/// Takes a folder of units away, where it is: those of an earlier run would be graded with the new ones.
fn emptied(folder: &Path) -> Result<(), Failure> {
    if folder.exists() {
        std::fs::remove_dir_all(folder).map_err(|e| Failure(format!("{} cannot be emptied: {e}", folder.display())))?;
    }
    Ok(())
}

/// Cases of the second plant whose voltages are made of losses and stiffness.
const LOSSES: [&str; 3] = ["input-loss-anisotropy", "input-quadrature-leak", "input-loss-and-quadrature"];

/// Inputs beside the frequencies: traced with and without, judged, and flown.
fn inputs(arguments: &[String]) -> Result<(), Failure> {
    let seeds = arguments.first().map_or("4", String::as_str);
    let count: u64 = seeds.parse().map_err(|_| Failure(format!("study --inputs: {seeds} is not a number")))?;
    let folder = root().join("out/inputs");
    units_of_the_second_plant(&LOSSES, count, &folder)?;
    build(&setup::toolchain()?)?;
    let folder = folder.display().to_string();
    tool("hrg-study", &["inputs", "--folder", &folder, "--page", "docs/inputs.md"].map(String::from))?;
    printed::stamp(&["docs/inputs.md"], &format!("cargo xtask study --inputs {seeds}"), true)
}

/// Designs of the second plant that families are learnt from: case, seed, spread of the properties, and hours of the run of the next unit.
const DESIGNS: [(&str, u64, &str, &str); 5] = [
    ("memory-rod", 1, "0.3", "2"),
    ("memory-rod", 1, "0.3", "3"),
    ("memory-rod", 2, "0.1", "2"),
    ("mix-rod-plays-stretched", 1, "0.1", "2"),
    ("hysteresis-bouc-wen", 1, "0.1", "2"),
];
/// Units that a family is learnt from.
const LEARNT_FROM: &str = "30";

/// Hours that a family spares the next unit: families, the runs that they ask for, and new units on them.
fn families(arguments: &[String]) -> Result<(), Failure> {
    let count = arguments.first().map_or("40", String::as_str);
    let plant = foreign_plant()?;
    let hrg = root().join("target/release/hrg");
    let folder = root().join("out/family");
    let mut cases = Vec::new();
    for (case, design, spread, hours) in DESIGNS {
        let at = folder.join(format!("{case}-{design}-spread-{spread}-{hours}h"));
        let make = |what: &str, design: u64, first: &str, units: &str, more: &[&str]| {
            let (design, out) = (design.to_string(), at.join(what));
            let fixed =
                ["make", "--case", case, "--design", &design, "--spread", spread, "--seed", first, "--units", units];
            run(Command::new(&plant).args(fixed).arg("--out").arg(out).args(more))
        };
        let _ = std::fs::remove_dir_all(&at);
        make("learn", design, "1", LEARNT_FROM, &[])?;
        let read = std::fs::read_dir(at.join("learn")).map_err(|e| Failure(e.to_string()))?;
        let runs = read.flatten().map(|f| f.path()).filter(|p| {
            let name = p.to_string_lossy();
            name.ends_with("-train.csv") || name.ends_with("-verify.csv")
        });
        let mut runs: Vec<PathBuf> = runs.collect();
        runs.sort();
        let file = at.join(format!("{case}-{design}-spread-{spread}.json"));
        run(Command::new(&hrg).arg("family").args(runs).arg("--out").arg(&file))?;
        // (As much as these hours tell: the limit is out of reach.)
        let wanted = ["--from", "-42", "--to", "55", "--start", "22", "--limit", "0.001", "--hours", hours];
        let designed = output(Command::new(&hrg).args(["profile", "--prior"]).arg(&file).args(wanted))
            .ok_or_else(|| Failure("hrg profile --prior has failed".into()))?;
        let profile = designed.lines().find_map(|l| l.split_once("--profile ")).map(|(_, p)| p.trim().to_string());
        let profile = profile.ok_or_else(|| Failure("hrg profile --prior names no profile".into()))?;
        make("new", design, "101", count, &["--more", &profile])?;
        // Another design of the same kind: its effects, with other sizes and time constants.
        make("foreign", design + 50, "201", "20", &["--more", &profile])?;
        cases.push(format!("{}:{}:{}", file.display(), at.join("new").display(), at.join("foreign").display()));
    }
    let page = ["--page", "docs/family.md"].map(String::from);
    tool("hrg-study", &[vec!["family".to_string()], cases, page.to_vec()].concat())?;
    printed::stamp(&["docs/family.md"], &format!("cargo xtask study --family {count}"), true)
}

/// Cases of the second plant on which the methods of the papers are tried, and units of each.
const METHODS_ON: [&str; 5] =
    ["memory-rod", "hysteresis-bouc-wen", "shape-hinges", "rate-saturating", "mix-rod-plays-stretched"];
const UNITS_OF_EACH: u64 = 5;

/// Methods of the papers, on units of their kinds and of the second plant.
fn methods(arguments: &[String]) -> Result<(), Failure> {
    let folder = root().join("out/methods/second-plant");
    units_of_the_second_plant(&METHODS_ON, UNITS_OF_EACH, &folder)?;
    let more = ["--foreign".to_string(), folder.display().to_string()];
    study("methods", &[arguments, &more].concat())
}

/// Recordings of some cases of the second plant, so many units of each.
fn units_of_the_second_plant(cases: &[&str], count: u64, folder: &Path) -> Result<(), Failure> {
    let plant = foreign_plant()?;
    for case in cases {
        for seed in 1..=count {
            run(Command::new(&plant).args(["make", "--case", case, "--seed", &seed.to_string(), "--out"]).arg(folder))?;
        }
    }
    Ok(())
}

/// Builds the second plant, and `hrg`, which it grades.
fn foreign_plant() -> Result<PathBuf, Failure> {
    programs()?;
    Ok(root().join("target/release/foreign-plant"))
}

/// Traces every unit of a folder and writes how it went into a page.
fn grade(plant: &Path, folder: &Path, page: &Path, heading: &str, units: Option<&Path>) -> Result<(), Failure> {
    let mut command = Command::new(plant);
    command.args(["grade", "--hrg", "target/release/hrg", "--heading", heading, "--page"]).arg(page);
    command.arg("--folder").arg(folder);
    if let Some(units) = units {
        command.arg("--units").arg(units);
    }
    run(&mut command)
}

/// A command of `hrg-study`, with the firmware built before.
fn study(command: &str, arguments: &[String]) -> Result<(), Failure> {
    let t = setup::toolchain()?;
    setup::host()?;
    build(&t)?;
    bench_unit(&t)?;
    let mut all = vec![command.to_string()];
    all.extend_from_slice(arguments);
    tool("hrg-study", &all)
}

fn size() -> Result<(), Failure> {
    let t = setup::toolchain()?;
    build(&t)?;
    bounds(&elf_path(), "", FLASH_BOUND)
}

/// Prints what an ELF takes, and fails where that is too much.
fn bounds(elf: &Path, name: &str, flash_bound: u64) -> Result<(), Failure> {
    let bytes = std::fs::read(elf).map_err(|e| Failure(e.to_string()))?;
    let (flash, ram) = elf::flash_and_ram(&bytes).ok_or_else(|| Failure("the firmware is not an ELF".into()))?;
    println!("{name}flash {flash} of {flash_bound} bytes, static RAM {ram} of {RAM_BOUND} bytes");
    if flash > flash_bound || ram > RAM_BOUND {
        return Err(Failure("the firmware is over its bounds".into()));
    }
    Ok(())
}

/// Prints the examples of docs/chamber.md: a simulated unit on the virtual board, its screen, its Allan deviation.
fn screens() -> Result<(), Failure> {
    let t = setup::toolchain()?;
    build(&t)?;
    let words = |s: &str| s.split(' ').map(String::from).collect::<Vec<_>>();
    for arguments in [
        "simulate --profile cycle --unit 2 --seed 5 --out target/screens-run.csv",
        "fit target/screens-run.csv --out target/screens-cal.toml",
        "simulate --profile 25,8h --unit 2 --seed 6 --out target/screens-rest.csv",
        "allan target/screens-rest.csv --out docs/allan.svg",
    ] {
        tool("hrg", &words(arguments))?;
    }
    let folder = root().join("target/screens");
    let _ = std::fs::remove_dir_all(&folder);
    let mut board = Command::new(root().join("target/release/hrg-board"))
        .args(words("serve --speed 12 --seconds 3000 --recording target/screens-run.csv --calibration target/screens-cal.toml --folder target/screens"))
        .current_dir(root())
        .stdout(Stdio::null())
        .spawn()
        .map_err(|e| Failure(e.to_string()))?;
    let link = folder.join("link");
    while !link.exists() {
        std::thread::sleep(std::time::Duration::from_millis(50));
    }
    let screen = output(
        Command::new(root().join("target/release/hrg"))
            .args(["monitor", "--profile", "cycle", "--snapshot", "300", "--port"])
            .arg(&link),
    );
    let _ = board.kill();
    let _ = board.wait();
    let screen = screen.ok_or_else(|| Failure("hrg monitor gave no screen".into()))?;
    print!("{screen}");
    let page = root().join("docs/chamber.md");
    let text = std::fs::read_to_string(&page).map_err(|e| Failure(e.to_string()))?;
    let (before, rest) = text.split_once("```text\n").ok_or_else(|| Failure("docs/chamber.md has no screen".into()))?;
    let (_, after) = rest.split_once("```\n").ok_or_else(|| Failure("docs/chamber.md's screen has no end".into()))?;
    std::fs::write(&page, format!("{before}```text\n{screen}```\n{after}")).map_err(|e| Failure(e.to_string()))
}

/// A firmware of other features, at `target/NAME`. All of them share one folder of builds: most of what they are made of is the same.
fn variant(t: &Toolchain, name: &str, change: impl FnOnce(&mut Command) -> &mut Command) -> Result<PathBuf, Failure> {
    variant_by(t, "firmware", name, change)
}

/// The same with another profile of cargo's.
fn variant_by(
    t: &Toolchain,
    profile: &str,
    name: &str,
    change: impl FnOnce(&mut Command) -> &mut Command,
) -> Result<PathBuf, Failure> {
    let folder = root().join("target/variants");
    let mut command = t.cargo("build");
    command.args(["--quiet", "--profile", profile, "-p", "firmware", "--bin", "firmware", "--locked", "--target-dir"]);
    run(change(command.arg(&folder)))?;
    let place = Path::new(setup::TARGET).join(profile).join("firmware");
    let elf = root().join("target").join(name).join(setup::TARGET).join("firmware/firmware");
    let failed = |e: std::io::Error| Failure(format!("{}: {e}", elf.display()));
    elf.parent().map_or(Ok(()), std::fs::create_dir_all).map_err(failed)?;
    write_integrity_word(&folder.join(&place), &elf)?;
    Ok(elf)
}

/// The firmware for the STM32F405RG, without maintenance mode: both build, within their bounds.
fn other_chip(t: &Toolchain) -> Result<(), Failure> {
    let features = ["--no-default-features", "--features", "stm32f405rg,locked,align,pps,field-log,lockstep,past"];
    bounds(&variant(t, "stm32f405rg", |c| c.args(features))?, "STM32F405RG: ", FLASH_BOUND)
}

/// The firmware for slot B, whose ELF the tests of updates need.
fn slot_b(t: &Toolchain) -> Result<(), Failure> {
    variant(t, "slot-b", |c| c.env("HRG_SLOT", "B")).map(drop)
}

/// Builds the firmware for both slots and packs the two.
fn update(rest: &[String]) -> Result<(), Failure> {
    let value = |name: &str| rest.iter().position(|a| a == name).and_then(|at| rest.get(at + 1)).map(PathBuf::from);
    let (key, out) = (value("--key"), value("--out"));
    let t = setup::toolchain()?;
    let public = match &key {
        Some(key) => {
            let file = PathBuf::from(format!("{}.pub", key.display()));
            let text = std::fs::read_to_string(&file).map_err(|e| Failure(format!("{}: {e}", file.display())))?;
            Some(text.trim().to_string())
        }
        None => None,
    };
    let of = |slot: &str| {
        variant(&t, &format!("update-{}", slot.to_lowercase()), |c| {
            if let Some(public) = &public {
                c.args(["--features", "signed"]).env("HRG_PUBLIC_KEY", public);
            }
            c.env("HRG_SLOT", slot)
        })
    };
    let elves = [of("A")?, of("B")?];
    programs()?;
    let out = out.unwrap_or_else(|| root().join(format!("target/hrg-{}.prog", env!("CARGO_PKG_VERSION"))));
    let mut pack = Command::new(root().join("target/release/hrg"));
    pack.args(["unit", "pack"]).args(&elves).arg("--out").arg(&out);
    if let Some(key) = &key {
        pack.arg("--key").arg(key);
    }
    run(&mut pack)
}

/// The firmware without the parts that a unit can do without, compiled for size.
fn minimal(t: &Toolchain) -> Result<(), Failure> {
    let features = ["--no-default-features", "--features", "stm32f446re"];
    bounds(&variant_by(t, "minimal", "minimal", |c| c.args(features))?, "minimal: ", MINIMAL_FLASH_BOUND)
}

/// Parts that a unit can do without: features of the firmware.
const PARTS: [&str; 7] = ["align", "pps", "field-log", "lockstep", "past", "inputs", "self-test"];

/// The firmware without each part alone.
fn without(t: &Toolchain) -> Result<(), Failure> {
    PARTS.iter().try_for_each(|part| {
        let others: Vec<&str> = PARTS.iter().filter(|other| *other != part).copied().collect();
        let features = format!("stm32f446re,{}", others.join(","));
        let name = format!("without-{part}");
        let elf = variant(t, &name, |c| c.args(["--no-default-features", "--features", &features]))?;
        bounds(&elf, &format!("without {part}: "), FLASH_BOUND)
    })
}

/// The firmware with one more feature: `sensors` reads platinum resistors in the place of resonators, `aux` inputs at channels 5 to 7 of the ADC, `mavlink` can
/// send in that framing.
fn with_feature(t: &Toolchain, feature: &str) -> Result<(), Failure> {
    bounds(&variant(t, feature, |c| c.args(["--features", feature]))?, &format!("{feature}: "), FLASH_BOUND)
}

/// The firmware that wants signed calibrations and keeps its states over power cuts by a battery. Its key is that of the tests, which
/// protects nothing.
fn signed(t: &Toolchain) -> Result<(), Failure> {
    let key = root().join("host-tests/keys/test.key.pub");
    let key = std::fs::read_to_string(&key).map_err(|e| Failure(format!("{}: {e}", key.display())))?;
    let elf = variant(t, "signed", |c| c.args(["--features", "signed,battery"]).env("HRG_PUBLIC_KEY", key.trim()))?;
    bounds(&elf, "signed: ", SIGNED_FLASH_BOUND)
}

fn flash() -> Result<(), Failure> {
    let t = setup::toolchain()?;
    if output(Command::new("probe-rs").arg("--version")).is_none() {
        return Err(Failure(
            "probe-rs is not installed. Run\n\n    cargo install probe-rs-tools --locked\n\nand then this again".into(),
        ));
    }
    build(&t)?;
    run(Command::new("probe-rs").args(["run", "--chip", "STM32F446RETx"]).arg(elf_path()))
}

/// Runs the checks of deny.toml.
fn audit() -> Result<(), Failure> {
    if output(Command::new("cargo").args(["deny", "--version"])).is_none() {
        println!("set-up: installing cargo-deny (some minutes)");
        run(&mut cargo(&["install", "cargo-deny", "--locked"]))?;
    }
    run(&mut cargo(&["deny", "--all-features", "check", "licenses", "bans", "sources"]))?;
    // The advisories come from GitHub, which not every machine reaches.
    let advisories = cargo(&["deny", "--all-features", "check", "advisories"]).current_dir(root()).output();
    match advisories {
        Ok(o) if o.status.success() => println!("advisories: none that applies"),
        Ok(o) => {
            let answer = String::from_utf8_lossy(&o.stderr);
            if answer.contains("failed to fetch advisory database") {
                println!("advisories: the database cannot be fetched here; not checked");
            } else {
                return Err(Failure(format!("advisories:\n{answer}")));
            }
        }
        Err(e) => return Err(Failure(e.to_string())),
    }
    Ok(())
}

/// The commands of the pages, with everything built that they use.
fn pages(arguments: &[String]) -> Result<(), Failure> {
    if !arguments.iter().any(|a| a == pages::BUILT) {
        let t = setup::toolchain()?;
        build(&t)?;
        programs()?;
    }
    let outcome = pages::run(arguments)?;
    println!("test result: commands of the pages. {} passed; {} failed", outcome.passed, outcome.failed);
    if outcome.failed == 0 {
        Ok(())
    } else {
        Err(Failure("a page tells its reader to type what does not work".into()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_top_level_is_that_of_the_run_and_not_of_the_build() {
        let d = std::env::temp_dir().join(format!("hrg-xtask-{}", std::process::id()));
        let copy = d.join("copy");
        std::fs::create_dir_all(copy.join("xtask/src")).expect("made");
        std::fs::write(copy.join("xtask/Cargo.toml"), "").expect("written");
        let nowhere = Path::new("/");
        assert_eq!(root_of(Some(copy.join("xtask")), nowhere), copy);
        assert_eq!(root_of(None, &copy.join("xtask/src")), copy);
        assert_eq!(root_of(Some(d.join("other")), &copy), copy);
        std::fs::remove_dir_all(d).expect("removed");
        // Nothing of this program takes the folder of its build.
        for entry in std::fs::read_dir(root().join("xtask/src")).expect("sources") {
            let path = entry.expect("an entry").path();
            let text = std::fs::read_to_string(&path).expect("text");
            let compiled_in = concat!("env!(\"CARGO_", "MANIFEST_DIR\")");
            assert!(!text.contains(compiled_in), "{}", path.display());
        }
    }
}
