//! The main job from end to end, on a simulated unit: train, calibrate, fly, trace, extend, fly again.

use crate::measured;
use anyhow::{Context, Result};
use hrg_board::replay::{self, Options, Outcome, Second};
use hrg_core::calibration::Calibration;
use hrg_data::axes::AXIS_NAMES;
use hrg_data::image_file;
use hrg_data::numeric::stats::block_means;
use hrg_data::plot::{svg, Panel, Series};
use hrg_data::recording::steps::Steps;
use hrg_data::recording::Recording;
use hrg_identify::thermometer::points;
use hrg_identify::thermometer::points::Points;
use hrg_identify::trace::{trace, Report};
use hrg_simulate::{EffectSpec, Plan, Profile, Simulated};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

/// Prints a line, and keeps it.
macro_rules! say {
    ($page:expr, $($text:tt)*) => {{
        let line = format!($($text)*);
        println!("{line}");
        $page.push_str(&line);
        $page.push('\n');
    }};
}

/// Chamber profile of the train run, 7 h.
const TRAIN: &str = "cycle";
/// Chamber profile of the verify run: a good hour with fast ramps.
const VERIFY: &str = "22,62@5,14m,-18@5,17m,22@5,6m";

fn run_both(elf: &[u8], calibrations: [&Calibration; 2], steps: &Steps) -> Result<[Outcome; 2]> {
    let done = [AtomicU64::new(0), AtomicU64::new(0)];
    let bar = indicatif::ProgressBar::new(2000);
    bar.set_style(indicatif::ProgressStyle::with_template("   running the ELF twice {bar:40} {percent}% {eta} left")?);
    std::thread::scope(|scope| {
        let runs: Vec<_> = calibrations
            .into_iter()
            .zip(&done)
            .map(|(c, mine)| {
                let (bar, done) = (&bar, &done);
                scope.spawn(move || {
                    replay::run(elf, Some(c), steps, &Options::default(), |share| {
                        mine.store((share * 1000.0) as u64, Ordering::Relaxed);
                        bar.set_position(done.iter().map(|d| d.load(Ordering::Relaxed)).sum());
                    })
                })
            })
            .collect();
        let mut outcomes = Vec::new();
        for r in runs {
            outcomes.push(r.join().map_err(|_| anyhow::anyhow!("a run of the ELF panicked"))??);
        }
        bar.finish_and_clear();
        let after = outcomes.pop().context("two runs")?;
        Ok([outcomes.pop().context("two runs")?, after])
    })
}

fn plot(before: &[Second], after: &[Second]) -> Result<String> {
    let means = |rows: &[Second], pick: &dyn Fn(&Second) -> f64| -> Vec<(f64, f64)> {
        let v: Vec<f64> = rows.iter().skip(1).map(pick).collect();
        block_means(&v, 100).into_iter().enumerate().map(|(k, v)| ((k as f64 + 0.5) / 36.0, v)).collect()
    };
    let panels: Vec<Panel> = (0..3)
        .map(|a| Panel {
            title: format!("axis {}: rate, from the ELF's frames", AXIS_NAMES[a]),
            x: "time [h]".into(),
            y: "100 s mean [deg/h]".into(),
            log: false,
            series: vec![
                Series {
                    label: "raw".into(),
                    points: means(before, &|s| f64::from(s.unit.raw_dph[a])),
                    colour: 0,
                    dots: false,
                },
                Series {
                    label: "baseline image".into(),
                    points: means(before, &|s| s.frames_dph[a]),
                    colour: 2,
                    dots: false,
                },
                Series {
                    label: "extended image".into(),
                    points: means(after, &|s| s.frames_dph[a]),
                    colour: 1,
                    dots: false,
                },
            ],
        })
        .collect();
    svg(&panels, 3, 460, 320)
}

/// Frames and temperature points side by side with the paper's printed ones.
fn table_1(path: &Path, page: &mut String) -> Result<()> {
    say!(page, "6. Measured data: Table 1 of dong2023, ten soaks of three real gyros");
    let text = std::fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
    let report = points::report(&Points::parse(&text)?)?;
    for e in &report.effects {
        say!(
            page,
            "   {} against the {}: {}",
            e.name,
            hrg_identify::thermometer::points::called(&e.reference),
            e.finding
        );
        for (axis, b) in &e.axes {
            say!(
                page,
                "     {axis}: RMS {:.4} -> {:.4} C, largest {:.4} -> {:.4} C, leave-one-out {:.4} -> {:.4} C",
                b.rms_before_c,
                b.rms_after_c,
                b.max_before_c,
                b.max_after_c,
                b.leave_one_out_before_c,
                b.leave_one_out_after_c
            );
        }
        let confounded = if e.indistinguishable_from.is_empty() {
            String::new()
        } else {
            format!("; this table cannot tell it from {}", e.indistinguishable_from.join(", "))
        };
        say!(page, "     p-value {:.1e}{confounded}", e.p_value);
    }
    Ok(())
}

/// The loop on a measured recording.
fn measured_loop(folder: &Path, out: &Path, page: &mut String) -> Result<()> {
    say!(
        page,
        "7. Measured data: the loop on a MEMS IMU (cargo xtask measured has every method, and two more recordings)"
    );
    let short = measured::imu_in_short(folder)?;
    short.caption.lines().for_each(|line| say!(page, "   {line}"));
    say!(page, "{}", short.table.trim_end());
    hrg_data::output::write_file(out, short.picture.as_bytes())?;
    let (table, caption) = measured::voltmeter_in_short(folder)?;
    say!(page, "8. Measured data: two voltmeters through the same");
    caption.lines().for_each(|line| say!(page, "   {line}"));
    say!(page, "{}", table.trim_end());
    Ok(())
}

/// Prints the figures of the frames, with both images.
fn figures(outcomes: [&Outcome; 2], rows: [&[Second]; 2], verify: &Simulated, page: &mut String) {
    say!(page, "4. Three sigma of 100 s means [deg/h], measured from the frames that the ELF sent");
    let (raw, corrected) = replay::three_sigma(rows[0]);
    let (_, extended) = replay::three_sigma(rows[1]);
    say!(
        page,
        "   {:<5} {:>9} {:>16} {:>16} {:>14}",
        "axis",
        "raw",
        "baseline image",
        "extended image",
        "noise put in"
    );
    for a in 0..3 {
        say!(
            page,
            "   {:<5} {:>9.3} {:>16.3} {:>16.3} {:>14.3}",
            AXIS_NAMES[a],
            raw[a],
            corrected[a],
            extended[a],
            3.0 * verify.truth.floor_dph[a]
        );
    }
    say!(page, "   dong2023 Table 4 (another unit, measured by its authors; for scale only):");
    say!(page, "   cooling 7.071 raw, 3.753 after its least squares; heating 9.512 raw, 5.022 after");
    for (name, o) in [("baseline", outcomes[0]), ("extended", outcomes[1])] {
        let r = &o.received;
        say!(
                page,
            "   {name}: {} frames, {} differ from hrg-core on the desktop, largest difference {} deg/h; {:.0} instructions a second ({:.2} %)",
            r.rates.len() + r.housekeeping.len(),
            r.differing,
            r.largest_difference_dph,
            o.instructions as f64 / o.seconds,
            o.instructions as f64 / o.seconds / 1.8e6
        );
    }
}

/// The simulator's truth beside what was found.
fn truth(train: &Simulated, report: &Report, page: &mut String) {
    say!(page, "5. Only now the simulator's truth");
    for e in &train.truth.effects {
        say!(
            page,
            "   put in:  {} (parameter {:.1}, {:.1} noise floors after the baseline fit)",
            e.source.name(),
            e.parameters[0],
            e.size
        );
    }
    for e in &report.effects {
        let parameters: Vec<String> = e.parameters.iter().map(|(n, v)| format!("{n} {v:.1}")).collect();
        let confounded = if e.indistinguishable_from.is_empty() {
            String::new()
        } else {
            format!(", not told from {}", e.indistinguishable_from.join(", "))
        };
        say!(page, "   found:   {} {}{confounded}", e.name, parameters.join(", "));
    }
    let left: Vec<&str> = AXIS_NAMES.into_iter().filter(|a| report.unexplained[*a]).collect();
    say!(
        page,
        "   left:    {}",
        if left.is_empty() { "noise".to_string() } else { format!("structure on {}", left.join(", ")) }
    );
}

/// Runs the demo for the unit with a seed; results go to `out`. Gives what it has printed.
///
/// # Errors
/// If a step fails.
pub fn demo(seed: u64, out: &Path, elf: &Path, table: &Path) -> Result<String> {
    let mut all = String::new();
    let page = &mut all;
    let start = std::time::Instant::now();
    std::fs::create_dir_all(out).with_context(|| format!("cannot make {}", out.display()))?;
    let to = |name: &str| -> PathBuf { out.join(name) };
    let elf = replay::read_elf(elf)?;
    let plan = |profile: &str, seed: u64, unit: u64| -> Result<Simulated> {
        let plan = Plan { effects: vec![EffectSpec::secret(unit)], ..Plan::of(Profile::parse(profile)?, unit, seed) };
        Ok(plan.simulate())
    };
    say!(page, "Everything up to step 5 is simulated; the program that runs is the one that is flashed.\n");
    say!(
        page,
        "1. A unit with an undeclared effect (seed {seed}): a train run ({TRAIN}, 7 h) and a verify run ({VERIFY})"
    );
    let train = plan(TRAIN, seed * 2 + 1, seed)?;
    let verify = plan(VERIFY, seed * 2 + 2, seed)?;
    hrg_data::output::write_file(&to("train.csv"), train.recording.to_csv().as_bytes())?;
    hrg_data::output::write_file(&to("verify.csv"), verify.recording.to_csv().as_bytes())?;
    // From here on the files are all there is.
    let (train_file, mut verify_file) = (Recording::load(&to("train.csv"))?, Recording::load(&to("verify.csv"))?);

    say!(page, "2. hrg trace: baseline fit, residual, what the model lacks");
    let t = trace(&[train_file], &verify_file)?;
    hrg_data::output::write_file(&to("report.json"), hrg_identify::trace::json(&t.report).as_bytes())?;
    hrg_data::output::write_file(&to("report.html"), hrg_identify::trace::html(&t)?.as_bytes())?;
    image_file::save(&to("baseline.toml"), &t.baseline)?;
    image_file::save(&to("extended.toml"), &t.image)?;
    say!(page, "   {}", t.report.verdict);

    say!(page, "3. Both images burnt into virtual boards, the verify run through the ELF with each");
    // A unit measures the earth's rate, too.
    verify_file.restore_earth_rate();
    let steps = Steps::new(&verify_file)?;
    let [before, after] = run_both(&elf, [&t.baseline, &t.image], &steps)?;
    let (rows_before, rows_after) = (before.seconds_of_frames(), after.seconds_of_frames());
    for (name, o, rows, c) in [("before", &before, &rows_before, &t.baseline), ("after", &after, &rows_after, &t.image)]
    {
        hrg_data::output::write_file(
            &to(&format!("{name}.csv")),
            replay::to_csv(&verify_file, Some(c), rows).as_bytes(),
        )?;
        hrg_data::output::write_file(&to(&format!("{name}.log")), (o.received.log.join("\n") + "\n").as_bytes())?;
    }
    hrg_data::output::write_file(&to("rates.svg"), plot(&rows_before, &rows_after)?.as_bytes())?;

    figures([&before, &after], [&rows_before, &rows_after], &verify, page);
    truth(&train, &t.report, page);
    table_1(table, page)?;
    let measured = table.with_file_name("measured");
    measured_loop(&measured, &to("measured-imu.svg"), page)?;
    say!(
        page,
        "\nreport {}, plot {}, logs {} and {}",
        to("report.html").display(),
        to("rates.svg").display(),
        to("before.log").display(),
        to("after.log").display()
    );
    say!(page, "{:.0} s in all", start.elapsed().as_secs_f64());
    Ok(all)
}
