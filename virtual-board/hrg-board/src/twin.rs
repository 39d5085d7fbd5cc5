//! The unit's maths on the desktop, fed with the time stamps and codes that the unit was fed with.
//!
//! The same `hrg_core`, compiled for the desktop. Every frame that the ELF sends must equal, byte for byte, the one
//! that comes out here.

use hrg_cal::correct::{Model, Stepped};
use hrg_core::alignment::linear::Linear;
use hrg_core::alignment::particles::{Kernels, CHEN};
use hrg_core::alignment::session::{Command, Report, Session};
use hrg_core::alignment::Begin;
use hrg_core::calibration::Calibration;
use hrg_core::compensator::Output;
use hrg_core::frequency::{Bank, Config, StepFrequencies, GATES_PER_STEP, SETTLE_TICKS};
use hrg_core::link::{mode, Deframer, Housekeeping, Message};
use hrg_core::rate_path::{Event, RatePath, Summary, DIVIDER};
use hrg_core::status::unit;
use hrg_core::AXES;
use std::collections::VecDeque;
use virtual_board::CYCLES_PER_TICK;

/// The align mode, whatever filter it was built with.
trait Align {
    fn command(&mut self, command: Command) -> Option<[f32; AXES]>;
    fn second(&mut self, summary: &Summary) -> Option<Report>;
    fn running(&self) -> bool;
}

impl<F: Begin> Align for Session<F> {
    fn command(&mut self, command: Command) -> Option<[f32; AXES]> {
        Self::command(self, command)
    }
    fn second(&mut self, summary: &Summary) -> Option<Report> {
        Self::second(self, summary)
    }
    fn running(&self) -> bool {
        Self::running(self)
    }
}

/// The twin of one power-on.
pub struct Twin {
    bank: Bank,
    model: Model,
    path: RatePath,
    start_status: u8,
    checksum: u32,
    now: u64,
    steps: VecDeque<(StepFrequencies, Output)>,
    link: VecDeque<(u64, u8)>,
    deframer: Deframer,
    session: Box<dyn Align + Send>,
    identity: (u32, u32),
    /// Reports of an alignment that the unit owes.
    pub alignment: VecDeque<Message>,
    /// Rate frames that the unit owes.
    pub rates: VecDeque<Message>,
    /// Housekeeping that the unit owes.
    pub housekeeping: VecDeque<Message>,
}

impl Twin {
    /// `start_status`: status of the unit from start-up (default calibration, watchdog reset). `particles`: of a firmware
    /// built with the feature upf.
    #[must_use]
    pub fn new(calibration: Calibration, start_status: u8, particles: bool) -> Self {
        let session: Box<dyn Align + Send> = if particles {
            Box::new(Session::<Kernels<f32, CHEN>>::IDLE)
        } else {
            Box::new(Session::<Linear<f32>>::IDLE)
        };
        let scale = calibration.scale_factors_dph_per_code();
        // The default has none.
        let checksum = if start_status & unit::DEFAULT_CALIBRATION == 0 { calibration.checksum() } else { 0 };
        let identity = (calibration.sequence, calibration.created_unix_s);
        Self {
            bank: Bank::new(Config::REFERENCE, GATES_PER_STEP),
            model: Model::new(calibration, 0.0),
            path: RatePath::new(scale, DIVIDER),
            start_status,
            checksum,
            identity,
            link: VecDeque::new(),
            deframer: Deframer::default(),
            session,
            alignment: VecDeque::new(),
            now: 0,
            steps: VecDeque::new(),
            rates: VecDeque::new(),
            housekeeping: VecDeque::new(),
        }
    }

    /// Time goes on to a timer reading: closes gates that are over.
    fn advance(&mut self, stamp: u32) {
        let ahead = stamp.wrapping_sub(self.now as u32) as i32;
        if ahead > 0 {
            self.now += u64::from(ahead.unsigned_abs());
        }
        while self.now > self.bank.gate_end() + SETTLE_TICKS {
            let at = self.bank.gate_end() + SETTLE_TICKS;
            if let Some(step) = self.bank.poll(at as u32) {
                let Stepped { output, pending, .. } = self.model.step(&step);
                self.path.stage(pending);
                self.steps.push_back((step, output));
            }
        }
    }

    /// An edge was captured.
    pub fn captured(&mut self, channel: usize, stamp: u32) {
        self.advance(stamp);
        self.bank.push(channel, &[stamp]);
    }

    /// A byte arrives at the unit, at a time in cycles.
    pub fn link_in(&mut self, cycles: u64, byte: u8) {
        self.link.push_back((cycles, byte));
    }

    /// The commands of an alignment that have arrived by now.
    fn commands(&mut self) {
        while let Some(&(_, byte)) = self.link.front().filter(|(at, _)| at / CYCLES_PER_TICK <= self.now) {
            self.link.pop_front();
            if let Some(Ok(Message::Align(command))) = self.deframer.push(byte) {
                if let Some(trim) = self.session.command(command) {
                    self.model.set_trim(trim);
                }
            }
        }
    }

    /// A converter frame was fetched.
    pub fn fetched(&mut self, stamp: u32, codes: [i32; 8], good: bool) {
        self.advance(stamp);
        let event =
            if good { self.path.sample(stamp, std::array::from_fn(|k| codes[k])) } else { self.path.missing(stamp) };
        let Event { frame, summary, .. } = event;
        if let Some(mut frame) = frame {
            frame.unit_status |= self.start_status;
            self.rates.push_back(Message::Rate(frame.sealed()));
        }
        if let Some(summary) = summary {
            self.commands();
            if let Some(report) = self.session.second(&summary) {
                self.alignment.push_back(Message::Alignment(report));
            }
            if let Some((step, output)) = self.steps.pop_front() {
                let mut h = Housekeeping::new(&step, &output, Some(&summary), Config::REFERENCE.ticks_per_s);
                h.unit_status |= self.start_status;
                h.calibration = self.checksum;
                (h.sequence, h.created_unix_s) = self.identity;
                h.mode = if self.session.running() { mode::ALIGN } else { mode::NAVIGATE };
                self.housekeeping.push_back(Message::Housekeeping(h));
            }
        }
    }
}
