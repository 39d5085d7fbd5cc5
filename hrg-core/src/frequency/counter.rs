//! The counter of one resonator: accepts edges, numbers them, fills gates.

use super::sums::Sums;
use super::Config;

/// Consecutive consistent periods before the counter locks.
const LOCK_PERIODS: u8 = 4;
/// Consecutive rejected edges after which the counter gives up its lock.
const MAX_REJECTS: u8 = 8;
/// Missing periods after which the counter gives up its lock (0.1 s at 4.9 kHz).
pub const GAP_PERIODS: u32 = 490;
/// Edges are accepted within this fraction of a period: one part in 2^6.
const TOLERANCE_SHIFT: u32 = 6;

/// Result of one gate.
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
    pub(super) gate_start: u64,
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
                if rounded >= u64::from(GAP_PERIODS + 1) * period_q8 {
                    let gate = self.gate_of(ticks);
                    gate.missing = gate.missing.saturating_add(1);
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
    #[inline]
    pub fn push_all(&mut self, stamps: impl IntoIterator<Item = u32>) {
        let mut rest = stamps.into_iter();
        while let Some(stamp) = self.run(&mut rest) {
            self.push(stamp);
        }
    }

    /// The common case, fast: edges that come one after the other on the grid, within the gate being filled. Gives the first stamp
    /// that is no such edge. Numbers that change from edge to edge stay in registers; sums over the edge numbers have a formula.
    #[inline]
    fn run(&mut self, stamps: &mut impl Iterator<Item = u32>) -> Option<u32> {
        if self.locked != LOCK_PERIODS || self.now.edges == 0 || self.now.lock != self.lock {
            return stamps.next();
        }
        // Ticks here are those to the gate's end: negative within it, so that one sign tells.
        let end = (self.gate_start as u32).wrapping_add(self.config.gate_ticks);
        let (mut last, mut period_q8) = (self.last.wrapping_sub(end), self.period_q8);
        let before = self.index.wrapping_sub(self.now.first_index);
        let mut i = before;
        let (mut sum_t, mut sum_it) = (0i64, 0i64);
        let other = loop {
            let Some(stamp) = stamps.next() else { break None };
            let ticks = stamp.wrapping_sub(end);
            let delta = ticks.wrapping_sub(last);
            // The next edge, within the gate? A sign is negative where it is too late or too early, or beyond: one branch for all three.
            let off = delta.wrapping_sub(period_q8 >> 8);
            let tolerance = period_q8 >> (8 + TOLERANCE_SHIFT);
            let signs = tolerance.wrapping_sub(off) | tolerance.wrapping_add(off) | !ticks;
            if (signs as i32) < 0 {
                break Some(ticks);
            }
            let error = (delta << 8).wrapping_sub(period_q8) as i32;
            period_q8 = period_q8.wrapping_add_signed(error >> 6);
            last = ticks;
            i = i.wrapping_add(1);
            sum_t += i64::from(ticks as i32);
            sum_it += i64::from(i as i32) * i64::from(ticks as i32);
        };
        let other = other.map(|ticks| ticks.wrapping_add(end));
        let taken = i.wrapping_sub(before);
        if taken == 0 {
            return other;
        }
        // Sums of j and of j^2 for j up to n.
        let sums = |n: u32| {
            let n = u64::from(n);
            let triangle = n * (n + 1) / 2;
            (triangle, triangle * (2 * n + 1) / 3)
        };
        let ((a1, a2), (b1, b2)) = (sums(before), sums(i));
        let gate = u64::from(self.config.gate_ticks);
        self.now.sum_i += b1 - a1;
        self.now.sum_ii += b2 - a2;
        // From the gate's begin again.
        self.now.sum_t = self.now.sum_t.wrapping_add_signed(sum_t).wrapping_add(u64::from(taken) * gate);
        self.now.sum_it = self.now.sum_it.wrapping_add_signed(sum_it).wrapping_add((b1 - a1) * gate);
        self.now.edges += taken;
        self.now.last_i = i;
        self.index = self.index.wrapping_add(taken);
        self.rejects = 0;
        self.last = last.wrapping_add(end);
        self.period_q8 = period_q8;
        other
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
        let longest_q8 = u64::from(GAP_PERIODS + 1) * u64::from(self.period_q8.max(1));
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn joined_gates_equal_one_regression() {
        let (hz, mut a, mut b) = (4871.747, Filling::default(), Filling::default());
        let mut all = Filling::default();
        for i in 0..900u32 {
            let t = (f64::from(i) * 90e6 / hz) as u32 + (i * 7919) % 13;
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
