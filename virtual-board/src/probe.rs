//! Counts the instructions of a function's calls, in the ELF as it is.

/// A moment, counted in three ways.
#[derive(Debug, Clone, Copy, Default)]
pub struct Moment {
    /// Cycles of the board's time: one for each instruction, and sleep.
    pub cycles: u64,
    /// Instructions executed.
    pub instructions: u64,
    /// Estimated cycles of the processor ([`crate::cycles`]), sleep left out; 0 where nobody estimates.
    pub estimate: u64,
}

/// Latency from the ADC's data-ready to the return of a function.
#[derive(Debug, Clone, Copy, Default)]
pub struct Latency {
    /// Calls.
    pub calls: u64,
    /// Instructions executed meanwhile, whatever ran, of all calls.
    pub instructions: u64,
    /// Estimated cycles in which the processor was awake meanwhile, of all calls.
    pub estimated: u64,
    /// Most cycles of a call: time on the wire and sleep included.
    pub most_cycles: u64,
}

/// Stretches in which the processor took no interrupt (PRIMASK).
#[derive(Debug, Clone, Copy, Default)]
pub struct Masked {
    /// Block and moment in which the present one began.
    since: Option<(u32, Moment)>,
    /// Instructions of the longest.
    pub instructions: u64,
    /// Its estimated cycles.
    pub estimate: u64,
    /// Address of the block of code in which it began.
    pub at: u32,
}

impl Masked {
    /// A block of code at `address` begins at `now`; `primask`: no interrupt is taken.
    pub(crate) fn block(&mut self, address: u32, now: Moment, primask: bool) {
        match (primask, self.since) {
            (true, None) => self.since = Some((address, now)),
            (false, Some((at, start))) => {
                self.since = None;
                let instructions = now.instructions - start.instructions;
                if instructions > self.instructions {
                    *self = Self { since: None, instructions, estimate: now.estimate - start.estimate, at };
                }
            }
            _ => {}
        }
    }
}

/// The calls of one function.
#[derive(Debug, Clone, Default)]
pub struct Probe {
    /// First address of the function.
    pub(crate) entry: u32,
    /// Return address and count at entry of the call that runs.
    running: Option<(u32, Moment)>,
    /// Return address of the call that runs, interrupted or not.
    back: Option<u32>,
    /// Instructions of each call that no interrupt came into, callees included.
    pub calls: Vec<u32>,
    /// Estimated cycles of each of them.
    pub estimates: Vec<u32>,
    /// Of all calls, interrupted or not.
    pub latency: Latency,
}

impl Probe {
    pub(crate) fn new(entry: u32) -> Self {
        Self { entry, ..Self::default() }
    }

    /// A block of code at `address` begins at `now`; the ADC was last `ready` at the other.
    pub(crate) fn block(&mut self, address: u32, now: Moment, ready: Moment, link: impl FnOnce() -> u32) {
        if address == self.entry {
            let back = link() & !1;
            self.running = Some((back, now));
            self.back = Some(back);
        } else if self.back == Some(address) {
            self.back = None;
            if let Some((_, start)) = self.running.take() {
                self.calls.push((now.instructions - start.instructions) as u32);
                self.estimates.push((now.estimate - start.estimate) as u32);
            }
            let (cycles, instructions) = (now.cycles - ready.cycles, now.instructions - ready.instructions);
            let estimated = now.estimate - ready.estimate;
            let l = &mut self.latency;
            l.calls += 1;
            l.instructions += instructions;
            l.estimated += estimated;
            l.most_cycles = l.most_cycles.max(cycles);
        }
    }

    /// An interrupt is taken: the call that runs is left out.
    pub(crate) fn interrupt(&mut self) {
        self.running = None;
    }

    /// Mean instructions of a call.
    #[must_use]
    pub fn mean(&self) -> Option<f64> {
        mean(&self.calls)
    }

    /// Mean estimated cycles of a call.
    #[must_use]
    pub fn mean_estimate(&self) -> Option<f64> {
        mean(&self.estimates)
    }
}

fn mean(of: &[u32]) -> Option<f64> {
    let n = of.len();
    (n > 0).then(|| of.iter().map(|c| f64::from(*c)).sum::<f64>() / n as f64)
}
