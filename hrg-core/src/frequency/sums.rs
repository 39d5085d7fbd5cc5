//! Exact sums of a regression, and the frequency that they give.

/// Sums whose first edges are further apart than this are not joined: a minute and a half of edges at 12 kHz, half a minute of ticks
/// at 240 MHz. Within these limits the sums stay within 64 bits.
const MAX_JOINED_EDGES: u64 = 1 << 20;
/// See [`MAX_JOINED_EDGES`].
const MAX_JOINED_TICKS: u64 = 1 << 33;

/// Exact regression sums of one gate or of several joined.
///
/// Edge numbers count from the first edge of the sums, ticks from `origin_ticks`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Sums {
    /// Number of the counter's lock that these edges belong to; sums of different locks cannot be joined.
    pub(super) lock: u32,
    /// Running number of the first edge within the lock.
    pub(super) first_index: u32,
    /// Ticks from which times are counted (the start of the first gate).
    pub(super) origin_ticks: u64,
    pub(super) edges: u32,
    pub(super) sum_i: u64,
    pub(super) sum_ii: u64,
    pub(super) sum_t: u64,
    pub(super) sum_it: u128,
    pub(super) last_i: u32,
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
        // Time stamps out of order (corrupted on their way) give such distances; within them the sums stay within 64 bits.
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
