//! Three counters on one grid of gates, and the gates joined to model steps.

use super::counter::{Counter, Gate};
use super::sums::Sums;
use super::Config;

/// Gates joined to one model step: the newest unbroken run of them.
#[derive(Debug, Clone, Copy, Default)]
pub struct Joined {
    sums: Sums,
    /// Rejected edges in all gates of the step.
    pub rejected: u32,
    /// Missing edges in all gates of the step.
    pub missing: u32,
}

impl Joined {
    /// Adds the next gate.
    pub fn add(&mut self, gate: &Gate) {
        self.rejected += u32::from(gate.rejected);
        self.missing += u32::from(gate.missing);
        if gate.sums.edges > 0 {
            self.sums = self.sums.join(&gate.sums).unwrap_or(gate.sums);
        }
    }

    /// Edges in the regression.
    #[must_use]
    pub fn edges(&self) -> u32 {
        self.sums.edges
    }

    /// Frequency in Hz, or `None` where the unbroken run covers less than half of `span_ticks`.
    #[must_use]
    pub fn frequency_hz(&self, config: &Config, span_ticks: u64) -> Option<f64> {
        let f = self.sums.frequency_hz(config.timebase.ticks_per_s())?;
        let covered = f64::from(self.sums.last_i) / f * f64::from(config.timebase.ticks_per_s());
        let dense = self.sums.edges >= self.sums.last_i / 2;
        (dense && covered * 2.0 >= span_ticks as f64 && f >= f64::from(config.min_hz) && f <= f64::from(config.max_hz))
            .then_some(f)
    }
}

/// The counters of the three axes on one grid of gates, and their model step.
///
/// Feed every time stamp with [`push`](Self::push), then ask [`poll`](Self::poll) with a timer reading taken
/// *before* the time stamps were fetched.
#[derive(Debug, Clone)]
pub struct CounterBank {
    config: Config,
    counters: [Counter; crate::AXES],
    joined: [Joined; crate::AXES],
    now: u64,
    gates: u32,
    gates_per_step: u32,
}

/// The frequencies of one model step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepFrequencies {
    /// Number of the step, counted from start.
    pub step: u32,
    /// End of the step, timer ticks since start.
    pub end_ticks: u64,
    /// Frequency of each axis, Hz; `None` where lost.
    pub frequency_hz: [Option<f64>; crate::AXES],
    /// Rejected edges of each axis in the step.
    pub rejected: [u32; crate::AXES],
    /// Missing edges of each axis in the step.
    pub missing: [u32; crate::AXES],
}

/// A gate is closed this long after its end, us: time for the DMA to deliver the last edge.
pub const SETTLE_US: u32 = 100;

impl CounterBank {
    /// Three counters; `gates_per_step` gates make a model step.
    #[must_use]
    pub fn new(config: Config, gates_per_step: u32) -> Self {
        Self {
            config,
            counters: core::array::from_fn(|_| Counter::new(config)),
            joined: [Joined::default(); crate::AXES],
            now: 0,
            gates: 0,
            gates_per_step: gates_per_step.max(1),
        }
    }

    /// Takes time stamps of one axis, in order. An axis number above 2 is ignored.
    // A function of its own: hot, and compiled for speed where its callers are compiled for size.
    #[inline(never)]
    pub fn push(&mut self, axis: usize, stamps: impl IntoIterator<Item = u32>) {
        if let Some(counter) = self.counters.get_mut(axis) {
            counter.push_all(stamps);
        }
    }

    /// Says that edges of an axis were lost on the way here.
    pub fn disturb(&mut self, axis: usize) {
        if let Some(counter) = self.counters.get_mut(axis) {
            counter.disturb();
        }
    }

    /// End of the gate being filled, ticks since start.
    #[must_use]
    pub fn gate_end(&self) -> u64 {
        self.counters[0].gate_end()
    }

    /// Time at which the gate being filled is closed, ticks since start: [`SETTLE_US`] after its end.
    /// [`poll`](Self::poll) gives nothing before it.
    #[must_use]
    pub fn close_tick(&self) -> u64 {
        self.gate_end() + u64::from(self.config.timebase.us(SETTLE_US))
    }

    /// Tells the time (a reading of the timer); gives a step when one is complete.
    pub fn poll(&mut self, now: u32) -> Option<StepFrequencies> {
        self.now += u64::from(now.wrapping_sub(self.now as u32));
        if self.now < self.close_tick() {
            return None;
        }
        for (counter, joined) in self.counters.iter_mut().zip(&mut self.joined) {
            joined.add(&counter.close());
        }
        self.gates += 1;
        if !self.gates.is_multiple_of(self.gates_per_step) {
            return None;
        }
        let span = u64::from(self.config.gate_ticks) * u64::from(self.gates_per_step);
        let joined = core::mem::take(&mut self.joined);
        Some(StepFrequencies {
            step: (self.gates / self.gates_per_step.max(1)).wrapping_sub(1),
            end_ticks: self.counters[0].gate_start,
            frequency_hz: joined.map(|j| j.frequency_hz(&self.config, span)),
            rejected: joined.map(|j| j.rejected),
            missing: joined.map(|j| j.missing),
        })
    }
}
