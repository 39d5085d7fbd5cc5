//! Flash whose power is cut, for tests.

/// Operations until the cut: a word programmed and a sector erased are one each. The last one is left half done, and nothing comes after it.
#[derive(Debug, Clone)]
pub struct Power {
    /// Operations that are left, the one that is cut among them.
    pub left: u32,
}

impl Power {
    /// No cut.
    pub const ON: Self = Self { left: u32::MAX };

    /// `true` if the next operation is done to its end.
    fn spend(&mut self) -> bool {
        self.left = self.left.saturating_sub(1);
        self.left > 0
    }

    /// Erases a sector; cut short, a part of it.
    pub fn erase(&mut self, sector: &mut [u8]) -> bool {
        let whole = self.spend();
        let n = if whole { sector.len() } else { sector.len() / 3 };
        sector[..n].fill(0xFF);
        whole
    }

    /// Programs words from the start of `to` on; of one that is cut short some of the bits that were to become zero have not.
    pub fn program(&mut self, to: &mut [u8], bytes: &[u8]) -> bool {
        assert!(bytes.len().is_multiple_of(4), "whole words");
        for (to, from) in to.chunks_mut(4).zip(bytes.chunks(4)) {
            if self.left == 0 {
                return false;
            }
            let torn = if self.spend() { 0 } else { 0x5A };
            to.iter_mut().zip(from).for_each(|(to, from)| *to &= from | torn);
            if torn != 0 {
                return false;
            }
        }
        true
    }
}
