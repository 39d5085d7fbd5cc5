//! Counts the instructions of a function's calls, in the ELF as it is.

/// The calls of one function.
#[derive(Debug, Clone, Default)]
pub struct Probe {
    /// Where the function begins.
    pub(crate) entry: u32,
    /// Return address and count at entry of the call that runs.
    running: Option<(u32, u64)>,
    /// Instructions of each call that no interrupt came into, callees included.
    pub calls: Vec<u32>,
}

impl Probe {
    pub(crate) fn new(entry: u32) -> Self {
        Self { entry, ..Self::default() }
    }

    /// A block of code at `address` begins, `instructions` having been executed.
    pub(crate) fn block(&mut self, address: u32, instructions: u64, link: impl FnOnce() -> u32) {
        if address == self.entry {
            self.running = Some((link() & !1, instructions));
        } else if let Some((back, start)) = self.running {
            if address == back {
                self.calls.push((instructions - start) as u32);
                self.running = None;
            }
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
