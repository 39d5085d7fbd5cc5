//! The unit's log: the bytes that a debug probe reads over RTT, decoded with the format strings in the ELF.

use crate::error::BadInput;
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
    /// If the ELF has no defmt table of a known version.
    pub fn new(elf: &[u8]) -> Result<Self, BadInput> {
        let table = Table::parse(elf)
            .map_err(|e| BadInput::new(format!("the ELF holds no log table: {e}")))?
            .ok_or_else(|| BadInput::new("the ELF has no defmt section; give the firmware's ELF"))?;
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
