//! The unit's maths on the desktop, fed with the time stamps and codes that the unit was fed with.
//!
//! The same `hrg_core`, compiled for the desktop. Every frame that the ELF sends must equal, byte for byte, the one
//! that comes out here.

use hrg_core::calibration::Calibration;
use hrg_core::compensator::{Compensator, Output};
use hrg_core::frequency::{Bank, Config, StepFrequencies, GATES_PER_STEP, SETTLE_TICKS};
use hrg_core::link::{Housekeeping, Message};
use hrg_core::rate_path::{Event, RatePath, Staged, DIVIDER};
use std::collections::VecDeque;

/// The twin of one power-on.
#[derive(Debug)]
pub struct Twin {
    bank: Bank,
    compensator: Compensator,
    path: RatePath,
    start_status: u8,
    checksum: u32,
    now: u64,
    steps: VecDeque<(StepFrequencies, Output)>,
    /// Rate frames that the unit owes.
    pub rates: VecDeque<Message>,
    /// Housekeeping that the unit owes.
    pub housekeeping: VecDeque<Message>,
}

impl Twin {
    /// `start_status`: status of the unit from start-up (default calibration, watchdog reset).
    #[must_use]
    pub fn new(calibration: Calibration, start_status: u8) -> Self {
        let scale = [0, 1, 2].map(|a: usize| calibration.axes[a].rate_scale_dph);
        let checksum = calibration.checksum();
        Self {
            bank: Bank::new(Config::REFERENCE, GATES_PER_STEP),
            compensator: Compensator::new(calibration, 0.0),
            path: RatePath::new(scale, DIVIDER),
            start_status,
            checksum,
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
                let output = self.compensator.update(&step);
                self.path.stage(Staged::new(&step, &output));
                self.steps.push_back((step, output));
            }
        }
    }

    /// An edge was captured.
    pub fn captured(&mut self, channel: usize, stamp: u32) {
        self.advance(stamp);
        self.bank.push(channel, &[stamp]);
    }

    /// A converter frame was fetched.
    pub fn fetched(&mut self, stamp: u32, codes: [i32; 8], good: bool) {
        self.advance(stamp);
        let event =
            if good { self.path.sample(stamp, [codes[0], codes[1], codes[2]]) } else { self.path.missing(stamp) };
        let Event { frame, summary } = event;
        if let Some(mut frame) = frame {
            frame.unit_status |= self.start_status;
            self.rates.push_back(Message::Rate(frame));
        }
        if let Some(summary) = summary {
            if let Some((step, output)) = self.steps.pop_front() {
                let mut h = Housekeeping::new(&step, &output, Some(&summary), Config::REFERENCE.ticks_per_s);
                h.unit_status |= self.start_status;
                h.calibration = self.checksum;
                self.housekeeping.push_back(Message::Housekeeping(h));
            }
        }
    }
}
