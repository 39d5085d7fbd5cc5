//! The debug probe's side of RTT (up channel 0), and the defmt decoder behind it.

use crate::board::RunError;
use defmt_decoder::{DecodeError, StreamDecoder, Table};

/// Turns the bytes of the log into lines.
pub struct Decoder {
    // Dropped before the table that it borrows.
    stream: Box<dyn StreamDecoder + Send + Sync>,
}

impl std::fmt::Debug for Decoder {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Decoder")
    }
}

impl Decoder {
    /// Reads the format strings out of the ELF.
    ///
    /// # Errors
    /// Where the ELF has no defmt table of a known version.
    pub fn new(elf: &[u8]) -> Result<Self, RunError> {
        let table = Table::parse(elf)
            .map_err(|e| RunError::Elf(e.to_string()))?
            .ok_or_else(|| RunError::Elf("it has no defmt section".into()))?;
        // One decoder a process or a run: the table lives as long.
        let table: &'static Table = Box::leak(Box::new(table));
        Ok(Self { stream: table.new_stream_decoder() })
    }

    /// Takes bytes; gives the lines that are complete, as `LEVEL message`.
    pub fn push(&mut self, bytes: &[u8]) -> Vec<String> {
        self.stream.received(bytes);
        let mut lines = Vec::new();
        loop {
            match self.stream.decode() {
                Ok(frame) => {
                    let level =
                        frame.level().map_or_else(String::new, |l| format!("{:<5} ", l.as_str().to_uppercase()));
                    lines.push(format!("{level}{}", frame.display_message()));
                }
                Err(DecodeError::UnexpectedEof) => return lines,
                Err(DecodeError::Malformed) => lines.push("(malformed log frame)".into()),
            }
        }
    }
}
