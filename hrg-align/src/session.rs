//! Alignment on the unit: commands of the link in, one report each second out, drifts handed to navigation.
//!
//! Commands are taken before the second in which they arrived is handed over ([`Session::command`], then
//! [`Session::second`]). Velocities are sums of accelerometer codes, exact integers; one filter step a second. A command takes effect with the
//! second in which it has arrived: the whole of that second counts as turn where a turn begins or ends in it.
//!
//! # Example
//! ```
//! use hrg_align::linear::Linear;
//! use hrg_align::session::Session;
//! use hrg_core::align_mode::Command;
//!
//! let mut session = Session::<Linear<f32>>::IDLE;
//! session.command(Command::Begin { latitude_deg: 45.0, gravity_mps2: 0.0, velocity_noise_mps: 0.002 });
//! assert!(session.running());
//! // Whoever leaves it before there is a result gets no trim.
//! assert_eq!(session.command(Command::Abandon), None);
//! ```

use crate::aligner::Aligner;
use crate::{normal_gravity, Begin, Config, Estimate, Refusal, ARCMIN, DEGREE, DPH};
use hrg_core::accelerometers::{Accelerometers, MPS2_PER_CODE};
use hrg_core::align_mode::{AlignMode, Command, Report, Stage};
use hrg_core::rate_path::Summary;
use hrg_core::AXES;

/// Time of one sample, s.
const SAMPLE_S: f64 = 1e-3;
/// Share of a second's samples that may be missing.
const MOST_MISSING: u16 = 100;

/// The align mode of a unit.
#[derive(Debug, Clone)]
pub struct Session<F> {
    aligner: Aligner<F>,
    stage: Stage,
    second: u32,
    turning_s: f64,
    ended: Option<f64>,
    refused: Option<Refusal>,
    /// Sums of codes since the position began, missing samples filled with their second's mean.
    codes: [f64; 2],
    /// Seconds that these sums hold.
    position_s: f64,
    accelerometers: Accelerometers,
    /// Drift (deg/h) and tilt (arc minutes) that the next alignment may expect; zeros: as usual.
    expected: [f64; 2],
    last_word: bool,
    /// The alignment was asked for within the second that is about to end; it begins with the next one.
    fresh: bool,
}

impl<F: Begin> AlignMode for Session<F> {
    fn command(&mut self, command: Command) -> Option<[f32; AXES]> {
        Self::command(self, command)
    }
    fn second(&mut self, summary: &Summary) -> Option<Report> {
        Self::second(self, summary)
    }
    fn running(&self) -> bool {
        Self::running(self)
    }
    fn set_accelerometers(&mut self, accelerometers: Accelerometers) {
        Self::set_accelerometers(self, accelerometers);
    }
}

impl<F: Begin> Session<F> {
    /// No alignment.
    pub const IDLE: Self = Self {
        aligner: Aligner::IDLE,
        stage: Stage::Over,
        second: 0,
        turning_s: 0.0,
        ended: None,
        refused: None,
        codes: [0.0; 2],
        position_s: 0.0,
        accelerometers: Accelerometers::IDEAL,
        expected: [0.0; 2],
        last_word: false,
        fresh: false,
    };

    /// Takes these errors of the accelerometers out of all velocities from now on.
    pub fn set_accelerometers(&mut self, accelerometers: Accelerometers) {
        self.accelerometers = accelerometers;
    }

    /// `true` while an alignment runs.
    #[must_use]
    pub fn running(&self) -> bool {
        self.stage != Stage::Over
    }

    /// Carries out a command; gives the bias trim (deg/h, to be subtracted) where an alignment was accepted. A platform's
    /// drift is the negative of the reading of its gyros at rest, as its loops null the reading.
    pub fn command(&mut self, command: Command) -> Option<[f32; AXES]> {
        match command {
            Command::Begin { latitude_deg, gravity_mps2, velocity_noise_mps } => {
                let latitude = f64::from(latitude_deg);
                let gravity = f64::from(gravity_mps2);
                let gravity = if gravity == 0.0 { normal_gravity(latitude) } else { gravity };
                self.refused = None;
                self.ended = None;
                self.second = 0;
                self.turning_s = 0.0;
                self.restart_velocities();
                let [drift, tilt] = core::mem::take(&mut self.expected);
                let config = Config::new(latitude, gravity, f64::from(velocity_noise_mps));
                match config.and_then(|c| c.with_prior(drift, tilt)) {
                    Ok(config) => {
                        self.aligner.begin(config);
                        self.stage = Stage::First;
                        self.fresh = true;
                    }
                    Err(refusal) => {
                        self.refused = Some(refusal);
                        self.stage = Stage::Over;
                        self.last_word = true;
                    }
                }
                None
            }
            Command::Expect { drift_dph, tilt_arcmin } => {
                self.expected = [f64::from(drift_dph), f64::from(tilt_arcmin)];
                None
            }
            Command::TurnBegins => {
                if self.stage == Stage::First {
                    self.stage = Stage::Turning;
                    self.turning_s = 0.0;
                }
                None
            }
            Command::TurnEnded { angle_deg } => {
                if self.stage == Stage::Turning {
                    self.ended = Some(f64::from(angle_deg) * DEGREE);
                }
                None
            }
            Command::Accept => {
                let outcome = self.outcome();
                if self.stage == Stage::Over || outcome.is_err() {
                    return None;
                }
                self.over();
                outcome.ok().map(|e| [-(e.drift[0] / DPH) as f32, -(e.drift[1] / DPH) as f32, 0.0])
            }
            Command::Abandon => {
                if self.stage != Stage::Over {
                    self.over();
                }
                None
            }
        }
    }

    /// Velocities begin at zero in each position.
    fn restart_velocities(&mut self) {
        (self.codes, self.position_s) = ([0.0; 2], 0.0);
    }

    fn over(&mut self) {
        self.stage = Stage::Over;
        self.last_word = true;
    }

    fn outcome(&self) -> Result<Estimate, Refusal> {
        match self.refused {
            Some(refusal) => Err(refusal),
            None => self.aligner.outcome(),
        }
    }

    /// A second has passed: its summary in, a report out while an alignment runs (and once when it ends).
    pub fn second(&mut self, summary: &Summary) -> Option<Report> {
        if self.stage == Stage::Over {
            if !self.last_word {
                return None;
            }
            self.last_word = false;
            return Some(self.report());
        }
        if core::mem::take(&mut self.fresh) {
            return None;
        }
        self.second += 1;
        let aligner = &mut self.aligner;
        if self.stage == Stage::Turning {
            self.turning_s += 1.0;
            if let Some(angle) = self.ended.take() {
                aligner.turn(angle, self.turning_s);
                self.stage = Stage::Second;
                self.restart_velocities();
            }
        } else if summary.samples == 0 || summary.adc_errors > MOST_MISSING {
            aligner.refuse(Refusal::DataMissing);
        } else {
            if summary.accelerometer_saturated {
                aligner.refuse(Refusal::Saturated);
            }
            let filled = 1.0 + f64::from(summary.adc_errors) / f64::from(summary.samples);
            let mut velocity = [0.0; 2];
            for k in 0..2 {
                self.codes[k] += summary.accelerometer_codes[k] as f64 * filled;
                velocity[k] = self.codes[k] * (MPS2_PER_CODE * SAMPLE_S);
            }
            self.position_s += 1.0;
            aligner.step(self.accelerometers.correct(velocity, self.position_s));
        }
        Some(self.report())
    }

    fn report(&self) -> Report {
        let outcome = self.outcome();
        let belief = if self.refused.is_some() { None } else { self.aligner.belief() };
        let number = |f: &dyn Fn(&Estimate) -> f64| belief.as_ref().map_or(f32::NAN, |e| f(e) as f32);
        Report {
            second: self.second,
            stage: self.stage as u8,
            refusal: outcome.err().map_or(0, |r| r as u8),
            azimuth_deg: outcome.map_or(f32::NAN, |e| (e.azimuth / DEGREE) as f32),
            azimuth_std_arcmin: number(&|e| e.azimuth_std / ARCMIN),
            tilt_arcmin: [number(&|e| e.tilt[0] / ARCMIN), number(&|e| e.tilt[1] / ARCMIN)],
            drift_dph: [number(&|e| e.drift[0] / DPH), number(&|e| e.drift[1] / DPH)],
            drift_std_dph: [number(&|e| e.drift_std[0] / DPH), number(&|e| e.drift_std[1] / DPH)],
            integrity: number(&|e| e.integrity.unwrap_or(f64::NAN)),
        }
    }
}
