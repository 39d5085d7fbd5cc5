//! `hrg align`: azimuth, tilts and drifts of a platform at rest, from a recording or by a unit on a port.

use anyhow::Result;
use clap::Args;
use hrg::unit::align::{Operator, Outcome, Plan};
use hrg::unit::port::Unit;
use hrg_align::{LARGEST_DRIFT_DPH, LARGEST_TILT_ARCMIN};
use hrg_align_tools::accelerometers::Accelerometers;
use hrg_align_tools::drifts;
use hrg_align_tools::drifts::Entry;
use hrg_align_tools::FilterKind;
use hrg_core::align_mode::Report;
use hrg_data::error::BadInput;
use hrg_simulate::profile::duration_s;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{channel, Receiver, TryRecvError};

/// Arguments of `hrg align`.
#[derive(Args)]
pub struct Arguments {
    /// Recording: time_s,position,v1_mps,v2_mps
    #[arg(value_name = "RUN", conflicts_with = "port", required_unless_present_any = ["port", "recording"])]
    run: Option<PathBuf>,
    /// The same.
    #[arg(long, hide = true, conflicts_with_all = ["port", "run"])]
    recording: Option<PathBuf>,
    /// Filter.
    #[arg(long, default_value = "linear")]
    filter: FilterKind,
    /// First azimuth of the EKF, degrees.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    first_azimuth: f64,
    /// Expected drift of the gyros, one sigma, deg/h; 0.2 where neither this nor the recording says it.
    #[arg(long, value_parser = expected(LARGEST_DRIFT_DPH))]
    drift: Option<f64>,
    /// Expected tilts at the start, one sigma, arc minutes; 10 where neither this nor the recording says it.
    #[arg(long, value_parser = expected(LARGEST_TILT_ARCMIN))]
    tilt: Option<f64>,
    /// Expected change of the drift of each gyro from one position to the other, one sigma, deg/h: goes into the azimuth's uncertainty.
    #[arg(long, value_parser = expected(100.0))]
    heading_drift: Option<f64>,
    /// Expected error of the angle of the turn, one sigma, arc minutes: goes into the azimuth's uncertainty.
    #[arg(long, value_parser = expected(120.0))]
    turn_error: Option<f64>,
    /// File of hrg align accelerometers: their bias, scale and cross-axis are taken out of the velocities.
    #[arg(long)]
    accelerometers: Option<PathBuf>,
    /// Seed of the literal particle filter.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// File of the drifts of all alignments (CSV): this one is compared with those before, and added.
    #[arg(long)]
    drifts: Option<PathBuf>,
    #[command(flatten)]
    on_unit: OnUnit,
    /// File for the report (JSON).
    #[arg(short, long)]
    out: Option<PathBuf>,
}

/// An alignment in the unit's align mode.
#[derive(Args)]
struct OnUnit {
    /// Serial port of a unit: it aligns itself, in its align mode.
    #[arg(long, requires = "latitude", conflicts_with_all = ["filter", "accelerometers", "drifts"])]
    port: Option<String>,
    /// Latitude, degrees, north positive.
    #[arg(long, requires = "port", allow_negative_numbers = true)]
    latitude: Option<f64>,
    /// Gravity, m/s^2; by default that of the latitude.
    #[arg(long, requires = "port", default_value_t = 0.0)]
    gravity: f64,
    /// Noise of a velocity reading, m/s.
    #[arg(long, requires = "port", default_value_t = 0.001)]
    velocity_noise: f64,
    /// Time in each position, such as 85s or 3m.
    #[arg(long, requires = "port", default_value = "85s")]
    stay: String,
    /// Angle of the turn, clockwise from above, degrees.
    #[arg(long, requires = "port", default_value_t = 90.0, allow_negative_numbers = true)]
    turn: f64,
    /// The turn begins by itself after the first position and takes so long (a turntable), such as 30s; by default you are asked.
    #[arg(long, requires = "port")]
    turn_takes: Option<String>,
    /// Accept the result without a question: the drifts become a bias trim of the unit.
    #[arg(long, requires = "port")]
    accept: bool,
}

/// Parser of an expected drift or tilt: above zero, at most `most`.
fn expected(most: f64) -> impl Fn(&str) -> Result<f64, String> + Clone + Send + Sync {
    move |text| match text.parse() {
        Ok(v) if v > 0.0 && v <= most => Ok(v),
        _ => Err(format!("give a number above 0, at most {most}")),
    }
}

/// Runs the command.
///
/// # Errors
/// Bad input, or a file that cannot be written.
pub fn run(arguments: &Arguments) -> Result<()> {
    match (arguments.run.as_ref().or(arguments.recording.as_ref()), &arguments.on_unit.port) {
        (Some(recording), _) => of_recording(arguments, recording),
        (None, Some(port)) => on_unit(arguments, port),
        (None, None) => Err(BadInput::new("give a recording, or --port").into()),
    }
}

const NOT_STATED: &str = "         drift that changes with the heading, and an error of the turn, are not in that: neither is stated (--heading-drift, --turn-error)";

fn of_recording(arguments: &Arguments, recording: &Path) -> Result<()> {
    let Arguments { filter, first_azimuth, drift, tilt, accelerometers, seed, drifts, out, .. } = arguments;
    let mut r = hrg_align_tools::Recording::load(recording)?;
    (r.drift_dph, r.tilt_arcmin) = (drift.or(r.drift_dph), tilt.or(r.tilt_arcmin));
    r.heading_drift_dph = arguments.heading_drift.or(r.heading_drift_dph);
    r.turn_error_arcmin = arguments.turn_error.or(r.turn_error_arcmin);
    if let Some(path) = accelerometers {
        Accelerometers::load(path)?.correct(&mut r);
    }
    let start =
        hrg_align_tools::Start { azimuth_deg: *first_azimuth, seed: *seed, ..hrg_align_tools::Start::default() };
    let report = hrg_align_tools::align(&r, *filter, start)
        .map_err(|e| BadInput::new(format!("{}: {e}", recording.display())))?;
    if let Some(out) = out {
        hrg_data::output::write_file(out, serde_json::to_string_pretty(&report)?.as_bytes())?;
    }
    println!("azimuth  {:>9.4} deg    +- {:.2}'", report.azimuth_deg, report.azimuth_std_arcmin);
    if let (None, None) = (r.heading_drift_dph, r.turn_error_arcmin) {
        println!("{NOT_STATED}");
    }
    let [t1, t2] = report.tilt_std_arcmin;
    println!("tilts    {:>9.3}' {:>9.3}'   +- {t1:.3}' {t2:.3}'", report.tilt1_arcmin, report.tilt2_arcmin);
    let [d1, d2] = report.drift_std_dph;
    println!("drifts   {:>9.4} {:>9.4} deg/h   +- {d1:.4} {d2:.4}", report.drift1_dph, report.drift2_dph);
    match report.level_at_s {
        Some(t) => println!("tilts known to 1' (two sigma) since {t:.0} s"),
        None => println!("tilts not known to 1' (two sigma)"),
    }
    match report.converged_at_s {
        Some(t) => println!("azimuth known to 15' (two sigma) since {t:.0} s"),
        None => println!("azimuth not known to 15' (two sigma)"),
    }
    if let Some(i) = report.integrity {
        println!("the two positions agree: chi-square {i:.2} (limit 10.8)");
    }
    if let Some(c) = &report.closed_form {
        println!(
            "in closed form, without a filter: {:.4} deg, {:+.2}' from it; length of the difference {:.5} of what it must be",
            c.azimuth_deg,
            c.apart_arcmin(report.azimuth_deg),
            c.length_ratio
        );
        let [[a, b], [c, d]] = c.drift_by_position_dph;
        println!(
            "drifts   position 1 {a:.4} {b:.4}, position 2 {c:.4} {d:.4} deg/h: changed by {:+.4} {:+.4}",
            c - a,
            d - b
        );
    }
    if let (Some(path), Some(c)) = (drifts, &report.closed_form) {
        let mut all = drifts::load(path)?;
        let (azimuth_deg, turn_deg) = (report.azimuth_deg, r.turn_deg);
        let now = Entry { unix_s: crate::now(), azimuth_deg, turn_deg, drift_by_position_dph: c.drift_by_position_dph };
        drifts::compare(&all, &now).iter().for_each(|line| println!("{line}"));
        all.push(now);
        drifts::save(path, &all)?;
        println!("{}: {} alignments", path.display(), all.len());
    }
    Ok(())
}

/// Somebody at a terminal, or a turntable that turns by the clock.
struct Person {
    /// Seconds of the turn, where it is made by the clock.
    turn_s: Option<f64>,
    turned_s: f64,
    accept: bool,
    lines: Option<Receiver<String>>,
    bar: indicatif::ProgressBar,
}

impl Person {
    /// Lines that are typed, as they come.
    fn lines(&mut self) -> &Receiver<String> {
        self.lines.get_or_insert_with(|| {
            let (send, receive) = channel();
            std::thread::spawn(move || {
                for line in std::io::stdin().lines().map_while(Result::ok) {
                    if send.send(line).is_err() {
                        return;
                    }
                }
            });
            receive
        })
    }

    /// Waits for a line.
    fn ask(&mut self, question: &str) -> Result<String> {
        self.bar.suspend(|| eprintln!("{question}"));
        self.lines()
            .recv()
            .map_err(|_| BadInput::new("nobody is there to answer; give --turn-takes and --accept").into())
    }
}

impl Operator for Person {
    fn begin_turn(&mut self) -> Result<()> {
        if self.turn_s.is_none() {
            self.ask("first position done: press Enter as the turn begins, and again when the platform stands")?;
        }
        Ok(())
    }

    fn turn_has_ended(&mut self) -> Result<bool> {
        self.turned_s += 1.0;
        match self.turn_s {
            Some(wanted) => Ok(self.turned_s >= wanted),
            None => match self.lines().try_recv() {
                Ok(_) => Ok(true),
                Err(TryRecvError::Empty) => Ok(false),
                Err(TryRecvError::Disconnected) => {
                    Err(BadInput::new("nobody is there to say when the turn has ended").into())
                }
            },
        }
    }

    fn second(&mut self, r: &Report) {
        let stage = ["", "first position", "turn", "second position", "over"][usize::from(r.stage.min(4))];
        self.bar.set_message(format!(
            "{stage}, {} s: azimuth {:.3} deg +- {:.1}'; tilts {:.2}' {:.2}'; drifts {:.3} {:.3} deg/h",
            r.second,
            r.azimuth_deg,
            r.azimuth_std_arcmin,
            r.tilt_arcmin[0],
            r.tilt_arcmin[1],
            r.drift_dph[0],
            r.drift_dph[1]
        ));
        self.bar.tick();
    }

    fn accepts(&mut self, r: &Report) -> Result<bool> {
        let [d1, d2] = r.drift_dph;
        Ok(self.accept
            || self
                .ask(&format!(
                    "accept? Drifts of {d1:.4} and {d2:.4} deg/h become a bias trim until power-off (y or n)"
                ))?
                .trim()
                == "y")
    }
}

fn on_unit(all: &Arguments, port: &str) -> Result<()> {
    let (arguments, out) = (&all.on_unit, all.out.as_deref());
    let time = |option: &str, text: &str| {
        duration_s(text)
            .ok_or_else(|| BadInput(format!("--{option} {text}: not a time; give seconds or minutes, such as 85s")))
    };
    let stay = time("stay", &arguments.stay)? as u32;
    let plan = Plan {
        latitude_deg: arguments.latitude.ok_or_else(|| BadInput::new("give the latitude with --latitude"))?,
        gravity_mps2: arguments.gravity,
        velocity_noise_mps: arguments.velocity_noise,
        drift_dph: all.drift.unwrap_or(0.0),
        tilt_arcmin: all.tilt.unwrap_or(0.0),
        seconds: [stay; 2],
        turn_deg: arguments.turn,
    };
    let mut person = Person {
        turn_s: arguments.turn_takes.as_deref().map(|t| time("turn-takes", t)).transpose()?,
        turned_s: 0.0,
        accept: arguments.accept,
        lines: None,
        bar: indicatif::ProgressBar::new_spinner(),
    };
    let mut unit = Unit::open(port)?;
    unit.identity()?;
    let outcome = hrg::unit::align::align(&mut unit, &plan, &mut person);
    person.bar.finish_and_clear();
    let Outcome { report: r, accepted } = outcome?;
    let turn = plan
        .turn_std_arcmin(all.heading_drift.unwrap_or(0.0), all.turn_error.unwrap_or(0.0))
        .map_err(|e| BadInput::new(e.to_string()))?;
    let azimuth_std_arcmin = f64::from(r.azimuth_std_arcmin).hypot(turn);
    println!("azimuth  {:>9.4} deg    +- {azimuth_std_arcmin:.2}'", r.azimuth_deg);
    if turn == 0.0 {
        println!("{NOT_STATED}");
    }
    println!("tilts    {:>9.3}' {:>9.3}'", r.tilt_arcmin[0], r.tilt_arcmin[1]);
    let ([d1, d2], [s1, s2]) = (r.drift_dph, r.drift_std_dph);
    println!("drifts   {d1:>9.4} {d2:>9.4} deg/h   +- {s1:.4} {s2:.4}");
    if r.integrity.is_finite() {
        println!("the two positions agree: chi-square {:.2} (limit 10.8)", r.integrity);
    }
    println!(
        "{}",
        if accepted { "accepted: the drifts are a bias trim of the unit until power-off" } else { "not accepted" }
    );
    let report = serde_json::json!({
        "filter": "unit", "azimuth_deg": r.azimuth_deg, "azimuth_std_arcmin": azimuth_std_arcmin,
        "tilt1_arcmin": r.tilt_arcmin[0], "tilt2_arcmin": r.tilt_arcmin[1],
        "drift1_dph": r.drift_dph[0], "drift2_dph": r.drift_dph[1], "accepted": accepted, "seconds": r.second,
    });
    out.map_or(Ok(()), |out| hrg_data::output::write_file(out, serde_json::to_string_pretty(&report)?.as_bytes()))
}
