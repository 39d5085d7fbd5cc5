//! An alignment in the unit's align mode, over its link: begin, first position, turn, second position, accept or abandon (chen2015,
//! section 1.3).

use super::port::Unit;
use anyhow::{Context, Result};
use hrg_align::{normal_gravity, Config, Refusal, ARCMIN, DEGREE, DPH};
use hrg_core::align_mode::{Command, Report, Stage};
use hrg_core::link::Message;
use hrg_data::error::BadInput;
use std::time::{Duration, Instant};

/// Inputs of an alignment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plan {
    /// Latitude, degrees.
    pub latitude_deg: f64,
    /// Gravity, m/s^2; 0: the unit takes normal gravity.
    pub gravity_mps2: f64,
    /// Noise of a velocity reading, m/s.
    pub velocity_noise_mps: f64,
    /// Drifts to expect, one sigma, deg/h; 0: the usual.
    pub drift_dph: f64,
    /// Tilts to expect at the start, one sigma, arc minutes; 0: the usual.
    pub tilt_arcmin: f64,
    /// Seconds in the first and in the second position.
    pub seconds: [u32; 2],
    /// Angle of the turn, clockwise from above, degrees.
    pub turn_deg: f64,
}

impl Plan {
    /// Standard deviation that the turn adds to the azimuth, arc minutes, by squares: the unit does not know it. It holds for drifts that
    /// change by `heading_drift_dph` (one sigma, deg/h) from one position to the other, and a turn that differs by `turn_error_arcmin`.
    ///
    /// # Errors
    /// A latitude that is impossible or too near to a pole.
    pub fn turn_std_arcmin(&self, heading_drift_dph: f64, turn_error_arcmin: f64) -> Result<f64, Refusal> {
        let config = Config::new(self.latitude_deg, normal_gravity(self.latitude_deg), self.velocity_noise_mps)?;
        let (heading_drift, turn_error) = (heading_drift_dph * DPH, turn_error_arcmin * ARCMIN);
        let [azimuth, _] = Config { heading_drift, turn_error, ..config }.turn_variances(self.turn_deg * DEGREE);
        Ok(azimuth.sqrt() / ARCMIN)
    }
}

/// Operator of the platform: turns it, watches, and decides.
pub trait Operator {
    /// The platform may be turned now: returns once the turn begins.
    ///
    /// # Errors
    /// Any error ends the alignment.
    fn begin_turn(&mut self) -> Result<()>;
    /// `true` if the turn has ended; asked after each second of the unit.
    ///
    /// # Errors
    /// Any error ends the alignment.
    fn turn_has_ended(&mut self) -> Result<bool>;
    /// A second of the unit.
    fn second(&mut self, report: &Report);
    /// `true` if a result is accepted: the drifts then become a bias trim.
    ///
    /// # Errors
    /// Any error ends the alignment.
    fn accepts(&mut self, report: &Report) -> Result<bool>;
}

/// Outcome of an alignment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outcome {
    /// The last report with a result.
    pub report: Report,
    /// Set if the unit has accepted the drifts as a trim.
    pub accepted: bool,
}

/// A report comes within this; the unit sends one each second.
const REPORT: Duration = Duration::from_secs(5);

struct Run<'a> {
    unit: &'a mut Unit,
    operator: &'a mut dyn Operator,
}

impl Run<'_> {
    fn send(&mut self, command: Command) -> Result<()> {
        self.unit.send(&Message::Align(command)).context("the port is gone")
    }

    /// The next report.
    fn report(&mut self) -> Result<Report> {
        let until = Instant::now() + REPORT;
        while let Some(left) = until.checked_duration_since(Instant::now()) {
            match self.unit.next(left).context("the port is gone")? {
                Some(Message::Alignment(report)) => {
                    self.operator.second(&report);
                    return Ok(report);
                }
                Some(_) => {}
                None => break,
            }
        }
        Err(BadInput::new(format!(
            "the unit has sent no report of an alignment for {} s; check that its firmware has the align mode, and its link",
            REPORT.as_secs()
        ))
        .into())
    }

    /// Reports until there were so many seconds in a stage; the unit may end an alignment by itself.
    fn stay(&mut self, stage: Stage, seconds: u32) -> Result<Report> {
        let mut in_stage = 0;
        loop {
            let report = self.report()?;
            if report.stage == Stage::Over as u8 {
                return Err(refused(&report).into());
            }
            in_stage += u32::from(report.stage == stage as u8);
            if in_stage >= seconds {
                return Ok(report);
            }
        }
    }
}

fn refused(report: &Report) -> BadInput {
    BadInput::new(match Refusal::from_number(report.refusal) {
        Some(refusal) => format!("no azimuth: {refusal}"),
        None => "the unit has ended the alignment; somebody else on its link may have abandoned it".to_string(),
    })
}

/// Aligns. Whatever ends it before its time, the unit is told to abandon it.
///
/// # Errors
/// One sentence: the port, the unit's refusal, the operator.
pub fn align(unit: &mut Unit, plan: &Plan, operator: &mut dyn Operator) -> Result<Outcome> {
    let mut run = Run { unit, operator };
    let outcome = steps(&mut run, plan);
    if !matches!(outcome, Ok(Outcome { accepted: true, .. })) {
        // (The port may be gone: then there is nobody to tell.)
        let _ = run.send(Command::Abandon);
    }
    outcome
}

fn steps(run: &mut Run<'_>, plan: &Plan) -> Result<Outcome> {
    if plan.drift_dph != 0.0 || plan.tilt_arcmin != 0.0 {
        // (A unit whose firmware does not know it counts it as a bad frame, and expects the usual.)
        run.send(Command::Expect { drift_dph: plan.drift_dph as f32, tilt_arcmin: plan.tilt_arcmin as f32 })?;
    }
    run.send(Command::Begin {
        latitude_deg: plan.latitude_deg as f32,
        gravity_mps2: plan.gravity_mps2 as f32,
        velocity_noise_mps: plan.velocity_noise_mps as f32,
    })?;
    run.stay(Stage::First, plan.seconds[0])?;
    run.operator.begin_turn()?;
    run.send(Command::TurnBegins)?;
    loop {
        run.stay(Stage::Turning, 1)?;
        if run.operator.turn_has_ended()? {
            break;
        }
    }
    run.send(Command::TurnEnded { angle_deg: plan.turn_deg as f32 })?;
    let report = run.stay(Stage::Second, plan.seconds[1])?;
    if report.refusal != 0 {
        return Err(refused(&report).into());
    }
    if !run.operator.accepts(&report)? {
        return Ok(Outcome { report, accepted: false });
    }
    run.send(Command::Accept)?;
    // The last report says that it is over: only then the unit has accepted.
    for _ in 0..3 {
        if run.report()?.stage == Stage::Over as u8 {
            return Ok(Outcome { report, accepted: true });
        }
    }
    Err(BadInput::new("the unit has not accepted: its last seconds made the result invalid; align again").into())
}
