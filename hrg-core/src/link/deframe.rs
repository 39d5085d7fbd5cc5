//! A stream of bytes to frames.

use super::codec::{COMMANDS_FROM, COMMANDS_TO};
use super::{LinkError, Message, MAX_FRAME};
use heapless::Vec;

/// Cuts a stream of bytes into frames.
#[derive(Debug, Clone, Default)]
pub struct Deframer {
    buffer: Vec<u8, MAX_FRAME>,
    overflow: bool,
}

impl Deframer {
    /// Takes one byte; gives a message, or why there is none, at the end of each frame. Empty frames are
    /// no errors: nothing was sent.
    pub fn push(&mut self, byte: u8) -> Option<Result<Message, LinkError>> {
        self.push_with(byte, Message::decode)
    }

    /// The same for a unit, which knows nothing but commands: what units say is of an unknown type.
    pub fn push_command(&mut self, byte: u8) -> Option<Result<Message, LinkError>> {
        self.push_with(byte, |frame| {
            Message::decode_with(frame, |kind, r| {
                (COMMANDS_FROM..=COMMANDS_TO).contains(&kind).then(|| Message::read_command(kind, r))
            })
        })
    }

    #[inline]
    fn push_with(
        &mut self,
        byte: u8,
        decode: impl Fn(&[u8]) -> Result<Message, LinkError>,
    ) -> Option<Result<Message, LinkError>> {
        if byte != 0 {
            self.overflow |= self.buffer.push(byte).is_err();
            return None;
        }
        let result = if self.overflow {
            Some(Err(LinkError::TooLong))
        } else if self.buffer.is_empty() {
            None
        } else {
            Some(decode(&self.buffer))
        };
        self.buffer.clear();
        self.overflow = false;
        result
    }
}
