//! Capture time stamps to frequency: regression over every edge of a gate (the "omega" counter).
//!
//! A reciprocal counter that uses only the first and the last edge of a gate has an error set by the jitter
//! of those two. The least-squares slope of time against edge number uses them all and is better by about
//! `sqrt(edges / 6)`: for jitter `s` on each of `n` edges of period `P` its frequency error is
//! `f * sqrt(12) * s / (P * n^1.5)` (Rubiola 2005, "On the measurement of frequency and of its sample variance
//! with high-resolution counters"). 20 ns on 4900 edges in a 1 s gate: 4.9 uHz.
//!
//! # Design
//! - Time stamps are those of a free-running 32-bit timer. Differences wrap safely; gates lie on a grid of
//!   64-bit ticks, so which edge belongs to which gate depends on its time stamp alone, never on when the
//!   software got round to it.
//! - All sums are integers, so nothing is lost and gates combine exactly ([`Sums::join`]): ten gates of 0.1 s
//!   are the regression over 1 s, not an average of ten.
//! - Edges are numbered by the grid they must lie on. One that comes too early is a glitch: rejected and
//!   counted. Where edges are missing, the number moves on by as many: counted, and the slope stays right.
//! - The counter locks after four consistent periods, and unlocks after eight consecutive rejects or a hole
//!   of [`HOLE_PERIODS`]. An edge is accepted within 1/64 period (3 us at 4.9 kHz) of its place.

use crate::timebase::Timebase;

/// Consecutive consistent periods before the counter locks.
const LOCK_PERIODS: u8 = 4;
/// Consecutive rejected edges after which the counter gives up its lock.
const MAX_REJECTS: u8 = 8;
/// Missing periods after which the counter gives up its lock (0.1 s at 4.9 kHz).
pub const HOLE_PERIODS: u32 = 490;
/// Sums whose first edges are further apart than this are not joined: a minute and a half of edges at 12 kHz, half a minute of ticks
/// at 240 MHz. Within these limits the sums stay within 64 bits.
const MAX_JOINED_EDGES: u64 = 1 << 20;
/// See [`MAX_JOINED_EDGES`].
const MAX_JOINED_TICKS: u64 = 1 << 33;
/// Edges are accepted within this fraction of a period: one part in 2^6.
const TOLERANCE_SHIFT: u32 = 6;

/// Length of a gate, ms.
pub const GATE_MS: u32 = 100;

/// Gates in one step of the bias model: ten make [`crate::MODEL_STEP_S`].
pub const GATES_PER_STEP: u32 = 10;

/// What a counter must know of its timer and of its signal.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Config {
    /// The timer.
    pub timebase: Timebase,
    /// Ticks of a gate of [`GATE_MS`]. Longer gates by [`Sums::join`].
    pub gate_ticks: u32,
    /// Lowest frequency that is a resonator, Hz.
    pub min_hz: u32,
    /// Highest frequency that is a resonator, Hz.
    pub max_hz: u32,
}

impl Config {
    /// The reference unit: TIM2 at 90 MHz, gates of 0.1 s, 3 to 12 kHz.
    pub const REFERENCE: Self = Self::at(Timebase::REFERENCE);

    /// A timer of another speed, the rest as in the reference unit.
    #[must_use]
    pub const fn at(timebase: Timebase) -> Self {
        Self { timebase, gate_ticks: timebase.ms(GATE_MS), min_hz: 3_000, max_hz: 12_000 }
    }
}

/// Exact regression sums of one gate or of several joined.
///
/// Edge numbers count from the first edge of the sums, ticks from `origin_ticks`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Sums {
    /// Which lock of the counter these edges belong to; sums of different locks cannot be joined.
    lock: u32,
    /// Running number of the first edge within the lock.
    first_index: u32,
    /// Ticks from which times are counted (the start of the first gate).
    origin_ticks: u64,
    edges: u32,
    sum_i: u64,
    sum_ii: u64,
    sum_t: u64,
    sum_it: u128,
    last_i: u32,
}

impl Sums {
    /// Edges in the sums.
    #[must_use]
    pub fn edges(&self) -> u32 {
        self.edges
    }

    /// The regression over both: `self` first, then `later`. `None` where the edge numbers are not related
    /// (the counter lost its lock between them) or the order is wrong.
    #[must_use]
    pub fn join(&self, later: &Self) -> Option<Self> {
        if later.edges == 0 {
            return Some(*self);
        }
        if self.edges == 0 {
            return Some(*later);
        }
        if self.lock != later.lock || later.origin_ticks < self.origin_ticks {
            return None;
        }
        let di = u64::from(later.first_index.wrapping_sub(self.first_index));
        let dt = later.origin_ticks - self.origin_ticks;
        let n = u64::from(later.edges);
        // Time stamps out of order (upset on their way) give such distances; within them the sums stay within 64 bits.
        if di > MAX_JOINED_EDGES || dt > MAX_JOINED_TICKS {
            return None;
        }
        Some(Self {
            edges: self.edges + later.edges,
            sum_i: self.sum_i + later.sum_i + n * di,
            sum_ii: self.sum_ii + later.sum_ii + 2 * di * later.sum_i + n * di * di,
            sum_t: self.sum_t + later.sum_t + n * dt,
            sum_it: self.sum_it
                + later.sum_it
                + u128::from(di) * u128::from(later.sum_t)
                + u128::from(dt) * u128::from(later.sum_i)
                + u128::from(n * di) * u128::from(dt),
            last_i: later.last_i + di as u32,
            ..*self
        })
    }

    /// Frequency in Hz by least squares over all edges; `None` with fewer than three.
    #[must_use]
    pub fn frequency_hz(&self, ticks_per_s: u32) -> Option<f64> {
        if self.edges < 3 {
            return None;
        }
        let n = i128::from(self.edges);
        let numerator = n * (self.sum_it as i128) - i128::from(self.sum_i) * i128::from(self.sum_t);
        let denominator = n * i128::from(self.sum_ii) - i128::from(self.sum_i) * i128::from(self.sum_i);
        if numerator <= 0 || denominator <= 0 {
            return None;
        }
        Some(f64::from(ticks_per_s) * denominator as f64 / numerator as f64)
    }
}

/// What one gate gave.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Gate {
    /// The sums, for the frequency and for joining.
    pub sums: Sums,
    /// Edges that came too early or off the grid, and were left out.
    pub rejected: u16,
    /// Edges that should have come and did not.
    pub missing: u16,
}

/// A gate being filled: u32 and u64 only, for the sake of the edge rate.
#[derive(Debug, Clone, Copy, Default)]
struct Filling {
    lock: u32,
    first_index: u32,
    edges: u32,
    last_i: u32,
    sum_i: u64,
    sum_ii: u64,
    sum_t: u64,
    sum_it: u64,
    rejected: u16,
    missing: u16,
}

impl Filling {
    #[inline]
    fn add(&mut self, lock: u32, index: u32, ticks: u32) {
        if self.edges == 0 || self.lock != lock {
            // After a new lock inside a gate only its newer part is kept.
            *self =
                Self { lock, first_index: index, rejected: self.rejected, missing: self.missing, ..Self::default() };
        }
        let i = index.wrapping_sub(self.first_index);
        self.edges += 1;
        self.last_i = i;
        self.sum_i += u64::from(i);
        self.sum_ii += u64::from(i) * u64::from(i);
        self.sum_t += u64::from(ticks);
        self.sum_it += u64::from(i) * u64::from(ticks);
    }

    fn finish(self, origin_ticks: u64) -> Gate {
        Gate {
            sums: Sums {
                lock: self.lock,
                first_index: self.first_index,
                origin_ticks,
                edges: self.edges,
                sum_i: self.sum_i,
                sum_ii: self.sum_ii,
                sum_t: self.sum_t,
                sum_it: u128::from(self.sum_it),
                last_i: self.last_i,
            },
            rejected: self.rejected,
            missing: self.missing,
        }
    }
}

/// The counter of one resonator.
#[derive(Debug, Clone)]
pub struct Counter {
    config: Config,
    /// Start of the gate being filled, ticks since the counter began; a multiple of the gate.
    gate_start: u64,
    /// Period in 1/256 tick; valid while locked or locking.
    period_q8: u32,
    /// Last accepted edge (or last seen, while not locked).
    last: u32,
    /// Number of the last accepted edge.
    index: u32,
    lock: u32,
    /// Consistent periods so far; [`LOCK_PERIODS`] means locked.
    locked: u8,
    rejects: u8,
    seen: bool,
    now: Filling,
    next: Filling,
}

impl Counter {
    /// A counter that has seen nothing; its first gate begins at tick 0 of the timer.
    #[must_use]
    pub fn new(config: Config) -> Self {
        Self {
            config,
            gate_start: 0,
            period_q8: 0,
            last: 0,
            index: 0,
            lock: 0,
            locked: 0,
            rejects: 0,
            seen: false,
            now: Filling::default(),
            next: Filling::default(),
        }
    }

    /// Takes the time stamp of the next edge, in order.
    ///
    /// An edge beyond the gate being filled goes to the one after; so [`close`](Self::close) must be called
    /// less than one gate late.
    #[inline]
    pub fn push(&mut self, stamp: u32) {
        let ticks = stamp.wrapping_sub(self.gate_start as u32);
        let delta = stamp.wrapping_sub(self.last);
        if self.locked == LOCK_PERIODS {
            let period = self.period_q8 >> 8;
            let tolerance = period >> TOLERANCE_SHIFT;
            let mut skipped = 0;
            let off = delta.wrapping_sub(period) as i32;
            if off.unsigned_abs() > tolerance {
                // Not the next edge. A later one?
                let period_q8 = u64::from(self.period_q8.max(1));
                let rounded = (u64::from(delta) << 8) + (period_q8 >> 1);
                if rounded >= u64::from(HOLE_PERIODS + 1) * period_q8 {
                    self.unlock(stamp);
                    return;
                }
                let count = (rounded / period_q8) as u32;
                let place = ((u64::from(count) * period_q8) >> 8) as i64;
                if count < 2 || (i64::from(delta) - place).unsigned_abs() > u64::from(tolerance) {
                    let gate = self.gate_of(ticks);
                    gate.rejected = gate.rejected.saturating_add(1);
                    self.rejects += 1;
                    if self.rejects >= MAX_REJECTS {
                        self.unlock(stamp);
                    }
                    return;
                }
                skipped = count - 1;
                let gate = self.gate_of(ticks);
                gate.missing = gate.missing.saturating_add(skipped.min(0xFFFF) as u16);
            } else {
                let error = ((delta << 8).wrapping_sub(self.period_q8)) as i32;
                self.period_q8 = self.period_q8.wrapping_add_signed(error >> 6);
            }
            self.rejects = 0;
            self.last = stamp;
            self.index = self.index.wrapping_add(1 + skipped);
            let (lock, index) = (self.lock, self.index);
            if ticks < self.config.gate_ticks {
                self.now.add(lock, index, ticks);
            } else {
                self.next.add(lock, index, ticks - self.config.gate_ticks);
            }
        } else {
            self.acquire(stamp, delta);
        }
    }

    /// Takes time stamps in order: as [`push`](Self::push) of each, and to the same sums.
    pub fn push_all(&mut self, stamps: &[u32]) {
        let mut rest = stamps;
        while !rest.is_empty() {
            rest = &rest[self.run(rest).min(rest.len())..];
            if let Some((&stamp, others)) = rest.split_first() {
                self.push(stamp);
                rest = others;
            }
        }
    }

    /// The common case, fast: edges that come one after the other on the grid, within the gate being filled. Gives how many
    /// it took. What changes from edge to edge stays in registers; sums over the edge numbers have a formula.
    fn run(&mut self, stamps: &[u32]) -> usize {
        if self.locked != LOCK_PERIODS || self.now.edges == 0 || self.now.lock != self.lock {
            return 0;
        }
        let (start, gate) = (self.gate_start as u32, self.config.gate_ticks);
        let (mut last, mut period_q8) = (self.last, self.period_q8);
        let before = self.index.wrapping_sub(self.now.first_index);
        let mut i = before;
        let (mut sum_t, mut sum_it) = (self.now.sum_t, self.now.sum_it);
        let mut taken = 0;
        for &stamp in stamps {
            let delta = stamp.wrapping_sub(last);
            let period = period_q8 >> 8;
            let off = delta.wrapping_sub(period) as i32;
            let ticks = stamp.wrapping_sub(start);
            if off.unsigned_abs() > period >> TOLERANCE_SHIFT || ticks >= gate {
                break;
            }
            let error = (delta << 8).wrapping_sub(period_q8) as i32;
            period_q8 = period_q8.wrapping_add_signed(error >> 6);
            last = stamp;
            i = i.wrapping_add(1);
            sum_t += u64::from(ticks);
            sum_it += u64::from(i) * u64::from(ticks);
            taken += 1;
        }
        if taken == 0 {
            return 0;
        }
        // Sums of j and of j^2 for j up to n.
        let sums = |n: u32| {
            let n = u64::from(n);
            let triangle = n * (n + 1) / 2;
            (triangle, triangle * (2 * n + 1) / 3)
        };
        let ((a1, a2), (b1, b2)) = (sums(before), sums(i));
        self.now.sum_i += b1 - a1;
        self.now.sum_ii += b2 - a2;
        self.now.sum_t = sum_t;
        self.now.sum_it = sum_it;
        self.now.edges += taken;
        self.now.last_i = i;
        self.index = self.index.wrapping_add(taken);
        self.rejects = 0;
        self.last = last;
        self.period_q8 = period_q8;
        taken as usize
    }

    fn gate_of(&mut self, ticks: u32) -> &mut Filling {
        if ticks < self.config.gate_ticks {
            &mut self.now
        } else {
            &mut self.next
        }
    }

    fn unlock(&mut self, stamp: u32) {
        self.locked = 0;
        self.rejects = 0;
        self.last = stamp;
        self.seen = true;
    }

    fn acquire(&mut self, stamp: u32, delta: u32) {
        let shortest = self.config.timebase.ticks_per_s() / self.config.max_hz.max(1);
        let longest = self.config.timebase.ticks_per_s() / self.config.min_hz.max(1);
        let in_band = self.seen && (shortest..=longest).contains(&delta);
        let consistent = in_band
            && self.locked > 0
            && delta.abs_diff(self.period_q8 >> 8) <= (self.period_q8 >> 8) >> TOLERANCE_SHIFT;
        if consistent {
            self.locked += 1;
            self.period_q8 = (self.period_q8 >> 1) + (delta << 7);
        } else if in_band {
            self.locked = 1;
            self.period_q8 = delta << 8;
        } else {
            self.locked = 0;
        }
        self.last = stamp;
        self.seen = true;
        if self.locked == LOCK_PERIODS {
            self.lock = self.lock.wrapping_add(1);
            self.index = 0;
        }
    }

    /// Drops the lock: called when edges were lost between the timer and here (a ring overrun).
    pub fn disturb(&mut self) {
        self.locked = 0;
        self.seen = false;
        self.now.missing = self.now.missing.saturating_add(1);
    }

    /// End of the gate being filled, in ticks since the counter began.
    #[must_use]
    pub fn gate_end(&self) -> u64 {
        self.gate_start + u64::from(self.config.gate_ticks)
    }

    /// Closes the gate: gives it and moves on to the next one on the grid.
    pub fn close(&mut self) -> Gate {
        let gate = self.now.finish(self.gate_start);
        self.gate_start += u64::from(self.config.gate_ticks);
        // An edge that is long overdue: the signal has stopped.
        let waited = (self.gate_start as u32).wrapping_sub(self.last);
        let longest_q8 = u64::from(HOLE_PERIODS + 1) * u64::from(self.period_q8.max(1));
        if self.locked == LOCK_PERIODS && (waited as i32) > 0 && u64::from(waited) << 8 >= longest_q8 {
            // As if the next edge had found it out: what an edge does after this is the same either way.
            self.locked = 0;
            self.rejects = 0;
            self.seen = false;
        }
        self.now = core::mem::take(&mut self.next);
        gate
    }
}

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
    pub fn push(&mut self, axis: usize, stamps: &[u32]) {
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

    /// When the gate being filled is closed, ticks since start: [`SETTLE_US`] after its end. [`poll`](Self::poll) gives nothing
    /// before it.
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

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;

    const TICKS: f64 = 90e6;

    /// Runs a bank over edges of `hz` on axis 0 for `seconds`; `edit` may drop (None) or add stamps.
    fn run(
        hz: f64,
        seconds: f64,
        start: u64,
        mut edit: impl FnMut(u64, u64) -> [Option<u64>; 2],
    ) -> heapless::Vec<StepFrequencies, 16> {
        let mut bank = CounterBank::new(Config::REFERENCE, 10);
        // Begin late in the life of the timer by running empty gates.
        while bank.close_tick() < start {
            let now = bank.close_tick();
            let _ = bank.poll(now as u32);
        }
        let mut out = heapless::Vec::new();
        let n = (hz * seconds) as u64;
        for k in 0..n {
            let t = start + (k as f64 * TICKS / hz) as u64;
            while t > bank.close_tick() {
                let now = bank.close_tick();
                if let Some(s) = bank.poll(now as u32) {
                    let _ = out.push(s);
                }
            }
            for e in edit(k, t).into_iter().flatten() {
                bank.push(0, &[e as u32]);
            }
        }
        out
    }

    #[test]
    fn clean_edges_across_the_wrap() {
        // 47 s in, the 32-bit timer wraps at 47.72 s.
        let steps = run(4898.626, 4.0, 47 * 90_000_000, |_, t| [Some(t), None]);
        let good: heapless::Vec<f64, 16> = steps.iter().filter_map(|s| s.frequency_hz[0]).collect();
        assert!(good.len() >= 3);
        for f in good {
            assert!((f - 4898.626).abs() < 3e-6, "{f}");
        }
        assert!(steps.iter().all(|s| s.frequency_hz[1].is_none()));
    }

    #[test]
    fn many_at_once_are_as_one_by_one() {
        // Edges with jitter, glitches, holes and a silence, cut into batches of any length.
        let mut x = 7u32;
        let mut draw = |n: u32| {
            x = x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (x >> 16) % n
        };
        let mut stamps = std::vec::Vec::new();
        let mut at = 5000u32;
        for k in 0..20_000u32 {
            at = at.wrapping_add(18_370 + draw(5));
            if k % 997 == 0 {
                stamps.push(at.wrapping_sub(9000));
            }
            if k % 1511 != 0 && !(8000..8100).contains(&k) {
                stamps.push(at);
            }
        }
        let (mut one, mut many) = (Counter::new(Config::REFERENCE), Counter::new(Config::REFERENCE));
        let mut rest = &stamps[..];
        while !rest.is_empty() {
            let n = (draw(70) as usize).clamp(1, rest.len());
            let (batch, others) = rest.split_at(n);
            batch.iter().for_each(|s| one.push(*s));
            many.push_all(batch);
            rest = others;
            let last = u64::from(batch[n - 1]);
            while last > one.gate_end() + u64::from(Timebase::REFERENCE.us(SETTLE_US)) {
                assert_eq!(one.close(), many.close());
            }
        }
    }

    #[test]
    fn glitches_and_holes_are_counted_and_harmless() {
        let steps = run(4800.0, 4.2, 9_000_000, |k, t| match k % 1000 {
            500 => [None, None],
            700 => [Some(t), Some(t + 5000)],
            _ => [Some(t), None],
        });
        let mid = steps[2];
        assert_eq!((mid.rejected[0], mid.missing[0]), (5, 5));
        let f = mid.frequency_hz[0].expect("locked");
        assert!((f - 4800.0).abs() < 3e-6, "{f}");
    }

    #[test]
    fn stops_and_comes_back() {
        let steps = run(4800.0, 8.0, 9_000_000, |k, t| [(!(9600..19200).contains(&k)).then_some(t), None]);
        assert!(steps[3].frequency_hz[0].is_none());
        assert!(steps[6].frequency_hz[0].is_some_and(|f| (f - 4800.0).abs() < 3e-6));
    }

    #[test]
    fn noise_alone_is_no_frequency() {
        let mut state = 1u32;
        let steps = run(4800.0, 3.0, 0, |_, t| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            [Some(t + u64::from(state >> 18)), None]
        });
        assert!(steps.iter().all(|s| s.frequency_hz[0].is_none()));
    }

    #[test]
    fn stamps_out_of_order_overflow_nothing() {
        // Found by the fuzz target `unit`: an edge of the gate after this one, and then edges of this one again.
        let later = Sums { lock: 1, first_index: 0, edges: 5000, sum_i: 12_497_500, sum_t: 1 << 40, ..Sums::default() };
        let first = Sums { lock: 1, first_index: 7, edges: 5, sum_i: 10, ..Sums::default() };
        assert_eq!(first.join(&later), None);
        let far = Sums { origin_ticks: 1 << 50, first_index: 8, ..later };
        assert_eq!(first.join(&far), None);
    }

    #[test]
    fn joined_gates_equal_one_regression() {
        let (hz, mut a, mut b) = (4871.747, Filling::default(), Filling::default());
        let mut all = Filling::default();
        for i in 0..900u32 {
            let t = (f64::from(i) * TICKS / hz) as u32 + (i * 7919) % 13;
            all.add(1, i, t);
            if t < 9_000_000 {
                a.add(1, i, t);
            } else {
                b.add(1, i, t - 9_000_000);
            }
        }
        let joined = a.finish(0).sums.join(&b.finish(9_000_000).sums).expect("one lock");
        assert_eq!(joined, all.finish(0).sums);
    }
}
