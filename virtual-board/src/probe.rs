//! Counts the instructions of a function's calls, in the ELF as it is.

/// How long after the ADC was ready a function came back.
#[derive(Debug, Clone, Copy, Default)]
pub struct Latency {
    /// Calls.
    pub calls: u64,
    /// Most instructions executed meanwhile, whatever ran.
    pub most_instructions: u64,
    /// All of them.
    pub instructions: u64,
    /// Most cycles: time on the wire and sleep included.
    pub most_cycles: u64,
}

/// The calls of one function.
#[derive(Debug, Clone, Default)]
pub struct Probe {
    /// Where the function begins.
    pub(crate) entry: u32,
    /// Return address and count at entry of the call that runs.
    running: Option<(u32, u64)>,
    /// Return address of the call that runs, interrupted or not.
    back: Option<u32>,
    /// Instructions of each call that no interrupt came into, callees included.
    pub calls: Vec<u32>,
    /// Of all calls, interrupted or not.
    pub latency: Latency,
}

impl Probe {
    pub(crate) fn new(entry: u32) -> Self {
        Self { entry, ..Self::default() }
    }

    /// A block of code at `address` begins at `now` (cycles, instructions); the ADC was `ready` at the other.
    pub(crate) fn block(&mut self, address: u32, now: (u64, u64), ready: (u64, u64), link: impl FnOnce() -> u32) {
        if address == self.entry {
            let back = link() & !1;
            self.running = Some((back, now.1));
            self.back = Some(back);
        } else if self.back == Some(address) {
            self.back = None;
            if let Some((_, start)) = self.running.take() {
                self.calls.push((now.1 - start) as u32);
            }
            let (cycles, instructions) = (now.0 - ready.0, now.1 - ready.1);
            let l = &mut self.latency;
            l.calls += 1;
            l.instructions += instructions;
            l.most_instructions = l.most_instructions.max(instructions);
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
        let n = self.calls.len();
        (n > 0).then(|| self.calls.iter().map(|c| f64::from(*c)).sum::<f64>() / n as f64)
    }
}
