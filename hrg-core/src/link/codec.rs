//! Messages to bytes and back.

use super::{layouts, LinkError, Message, MAX_FRAME, MAX_PAYLOAD};
use crate::align_mode::Command;
use crate::bytes::{crc32, Reader, Writer};
use crate::increments::IncrementFrame;
use crate::maintenance::{self, Reply};
use crate::rate_path::RateFrame;
use crate::schema::{size, take, Layout};
use crate::self_test::{Check, Item};
use heapless::Vec;

/// A rate frame before framing: type, fields, checksum.
const RATE_PAYLOAD: usize = RATE.len() + size(RateFrame::FIELDS) + 4;
/// A message of increments before framing.
const INCREMENTS_PAYLOAD: usize = INCREMENTS.len() + size(IncrementFrame::FIELDS) + 4;
/// Length of a rate frame on the wire, with its zero, bytes. (COBS takes a byte more.)
pub const RATE_FRAME: usize = RATE_PAYLOAD + 2;
/// Length of the longer one of rate frame and increments.
pub const FAST_FRAME: usize = INCREMENTS_PAYLOAD + 2;
/// Type of increments.
const INCREMENTS: &[u8] = &[0x09];
/// Type of a rate frame.
const RATE: &[u8] = &[0x01];

/// Types of commands, the first and the last.
pub(super) const COMMANDS_FROM: u8 = 0x80;
pub(super) const COMMANDS_TO: u8 = 0x85;

impl Message {
    /// The frame on the wire, with its zero.
    #[inline(never)]
    #[must_use]
    pub fn encode(&self) -> Vec<u8, MAX_FRAME> {
        let mut out = Vec::new();
        match self {
            Self::Rate(frame) => Self::encode_rate(frame, &mut out),
            _ => Self::framed(&mut out, MAX_PAYLOAD, |w| self.write(w)),
        }
        out
    }

    /// [`encode`](Self::encode) of a rate frame, behind what `out` holds. (They are many and short: no more is cleared or copied than they need.)
    #[inline]
    pub fn encode_rate<const N: usize>(frame: &RateFrame, out: &mut Vec<u8, N>) {
        Self::framed(out, RATE_PAYLOAD, |w| put(w, RATE, frame));
    }

    /// The same of increments.
    #[inline]
    pub fn encode_increments<const N: usize>(increments: &IncrementFrame, out: &mut Vec<u8, N>) {
        Self::framed(out, INCREMENTS_PAYLOAD, |w| put(w, INCREMENTS, increments));
    }

    /// Appends the frame of what `write` writes, at most so many bytes with the checksum.
    #[inline]
    fn framed<const N: usize>(out: &mut Vec<u8, N>, longest: usize, write: impl FnOnce(&mut Writer<'_>)) {
        let start = out.len();
        // COBS takes a byte before it, the zero at the end another.
        let _ = out.resize(start + longest + 2, 0);
        let content = out.get_mut(start + 1..).unwrap_or_default();
        let mut w = Writer::new(content);
        write(&mut w);
        // The longest message fits: test `every_message_there_and_back`.
        let n = w.finish().unwrap_or(0);
        let crc = crc32(content.get(..n).unwrap_or_default());
        if let Some(end) = content.get_mut(n..n + 4) {
            end.copy_from_slice(&crc.to_le_bytes());
        }
        let frame = out.get_mut(start..start + n + 5).unwrap_or_default();
        stuff(frame);
        out.truncate(start + n + 6);
        if let Some(last) = out.last_mut() {
            *last = 0;
        }
    }

    fn write(&self, w: &mut Writer<'_>) {
        match self {
            Self::Rate(r) => put(w, RATE, r),
            Self::Housekeeping(h) => put(w, &[0x02], h),
            Self::Identity(i) => put(w, &[0x03], i),
            Self::Alignment(a) => put(w, &[0x04], a),
            Self::Identify => w.u8(0x80),
            Self::SetDecimation(decimation) => put(w, &[0x81], &layouts::Decimation { decimation: *decimation }),
            Self::Align(command) => put(w, &[0x82], &layouts::Align::of(*command)),
            Self::Maintain(command) => write_command(command, w),
            Self::Maintained(reply) => write_reply(reply, w),
            Self::Inputs(values) => put(w, &[0x84], values),
            Self::InputsUsed(used) => put(w, &[0x06], used),
            Self::Stopped(stopped) => put(w, &[0x07], stopped),
            Self::Programs(programs) => put(w, &[0x08], programs),
            Self::Increments(increments) => put(w, INCREMENTS, increments),
            Self::TimeMark(mark) => put(w, &[0x0A], mark),
            Self::GnssTime(time) => put(w, &[0x85], time),
        }
    }

    /// Reads a message of a unit.
    fn read_report(kind: u8, r: &mut Reader<'_>) -> Option<Self> {
        Some(match kind {
            0x01 => Self::Rate(take::<RateFrame>(r)?.with_integrity()),
            0x02 => Self::Housekeeping(take(r)?),
            0x03 => Self::Identity(take(r)?),
            0x04 => Self::Alignment(take(r)?),
            0x05 => Self::Maintained(match r.u8()? {
                0 => {
                    let a: layouts::Answer = take(r)?;
                    Reply::Answer(maintenance::Answer::from_number(a.answer)?, a.value)
                }
                1 => {
                    let layouts::Data { page, offset, data } = take(r)?;
                    Reply::Data { page, offset, data }
                }
                2 => {
                    let layouts::Item { number, check, index, value, low, high } = take(r)?;
                    let item = Item { check: Check::from_number(check)?, index, value, low, high };
                    Reply::Tested { number, item }
                }
                3 => Reply::TestDone(take::<layouts::TestDone>(r)?.items),
                _ => return None,
            }),
            0x06 => Self::InputsUsed(take(r)?),
            0x07 => Self::Stopped(take(r)?),
            0x08 => Self::Programs(take(r)?),
            0x09 => Self::Increments(take::<IncrementFrame>(r)?.with_integrity()),
            0x0A => Self::TimeMark(take(r)?),
            _ => return None,
        })
    }

    /// Reads a command to a unit.
    pub(super) fn read_command(kind: u8, r: &mut Reader<'_>) -> Option<Self> {
        use maintenance::Command as C;
        Some(match kind {
            0x80 => Self::Identify,
            0x81 => Self::SetDecimation(take::<layouts::Decimation>(r)?.decimation),
            0x82 => Self::Align(take::<layouts::Align>(r)?.command()?),
            0x83 => Self::Maintain(match r.u8()? {
                0 => C::Open(take::<layouts::Open>(r)?.unit),
                1 => C::Close,
                2 => C::Begin(take::<layouts::Begin>(r)?.length),
                3 => {
                    let layouts::Chunk { offset, length, data } = take(r)?;
                    C::Chunk { offset, length, data }
                }
                4 => C::End,
                5 => {
                    let layouts::Read { page, offset } = take(r)?;
                    C::Read { page, offset }
                }
                6 => C::Restart,
                7 => C::Newest,
                8 => C::Zero(take(r)?),
                9 => C::Test,
                10 => C::Tested(take::<layouts::Tested>(r)?.number),
                11 => {
                    let layouts::Program { length, sum } = take(r)?;
                    C::Program { length, sum }
                }
                12 => {
                    let layouts::Piece { offset, length, data } = take(r)?;
                    C::Piece { offset, length, data }
                }
                13 => C::Commit(take::<layouts::Commit>(r)?.signature),
                14 => C::RollBack,
                15 => C::Echo(take::<layouts::Echo>(r)?.token),
                16 => C::Output(take(r)?),
                _ => return None,
            }),
            0x84 => Self::Inputs(take(r)?),
            0x85 => Self::GnssTime(take(r)?),
            _ => return None,
        })
    }

    /// Reads one frame, without its zero.
    ///
    /// # Errors
    /// [`LinkError`] says what is wrong; nothing of the frame is used.
    pub fn decode(frame: &[u8]) -> Result<Self, LinkError> {
        Self::decode_with(frame, |kind, r| match kind {
            0x01..=0x0A => Some(Self::read_report(kind, r)),
            COMMANDS_FROM..=COMMANDS_TO => Some(Self::read_command(kind, r)),
            _ => None,
        })
    }

    /// Reads one frame with `read`, which gives `None` for types that it does not know, and `Some(None)` where there is not
    /// enough of one.
    #[inline]
    pub(super) fn decode_with(
        frame: &[u8],
        read: impl Fn(u8, &mut Reader<'_>) -> Option<Option<Self>>,
    ) -> Result<Self, LinkError> {
        if frame.len() >= MAX_FRAME {
            return Err(LinkError::TooLong);
        }
        let mut plain = [0u8; MAX_FRAME];
        let n = cobs::decode(frame, &mut plain).map_err(|_| LinkError::Framing)?.frame_size();
        if !(5..=MAX_PAYLOAD).contains(&n) {
            return Err(LinkError::Framing);
        }
        let (content, crc) = plain[..n].split_at(n - 4);
        if crc != crc32(content).to_le_bytes() {
            return Err(LinkError::Checksum);
        }
        let kind = content[0];
        let mut r = Reader::new(&content[1..]);
        match read(kind, &mut r) {
            None => Err(LinkError::UnknownType(kind)),
            Some(Some(m)) if r.remaining() == 0 => Ok(m),
            Some(_) => Err(LinkError::Length(kind)),
        }
    }
}

/// COBS where the bytes lie: the first is free, and each zero among the others (fewer than 254) becomes the way to the next one. (Two frames of
/// rates and increments each 5 ms: a library's encoder, which goes from one buffer to another byte by byte, took 0.2 % of the processor. Decoding is the library's, and the test holds
/// the two against each other.)
#[inline]
fn stuff(frame: &mut [u8]) {
    let mut way = 0u8;
    // From the end, so that each zero knows its way.
    for byte in frame.iter_mut().rev() {
        way = way.wrapping_add(1);
        if *byte == 0 {
            *byte = way;
            way = 0;
        }
    }
}

/// Appends a type (and kind) and the fields behind it.
#[inline]
fn put(w: &mut Writer<'_>, lead: &[u8], fields: &impl Layout) {
    w.bytes(lead);
    fields.put_fields(w);
}

fn write_command(command: &maintenance::Command, w: &mut Writer<'_>) {
    use maintenance::Command as C;
    match *command {
        C::Open(unit) => put(w, &[0x83, 0], &layouts::Open { unit }),
        C::Close => w.bytes(&[0x83, 1]),
        C::Begin(length) => put(w, &[0x83, 2], &layouts::Begin { length }),
        C::Chunk { offset, length, data } => put(w, &[0x83, 3], &layouts::Chunk { offset, length, data }),
        C::End => w.bytes(&[0x83, 4]),
        C::Read { page, offset } => put(w, &[0x83, 5], &layouts::Read { page, offset }),
        C::Restart => w.bytes(&[0x83, 6]),
        C::Newest => w.bytes(&[0x83, 7]),
        C::Zero(zero) => put(w, &[0x83, 8], &zero),
        C::Test => w.bytes(&[0x83, 9]),
        C::Tested(number) => put(w, &[0x83, 10], &layouts::Tested { number }),
        C::Program { length, sum } => put(w, &[0x83, 11], &layouts::Program { length, sum }),
        C::Piece { offset, length, data } => put(w, &[0x83, 12], &layouts::Piece { offset, length, data }),
        C::Commit(signature) => put(w, &[0x83, 13], &layouts::Commit { signature }),
        C::RollBack => w.bytes(&[0x83, 14]),
        C::Echo(token) => put(w, &[0x83, 15], &layouts::Echo { token }),
        C::Output(settings) => put(w, &[0x83, 16], &settings),
    }
}

fn write_reply(reply: &Reply, w: &mut Writer<'_>) {
    match *reply {
        Reply::Answer(answer, value) => put(w, &[0x05, 0], &layouts::Answer { answer: answer as u8, value }),
        Reply::Tested { number, item: Item { check, index, value, low, high } } => {
            put(w, &[0x05, 2], &layouts::Item { number, check: check as u8, index, value, low, high });
        }
        Reply::TestDone(items) => put(w, &[0x05, 3], &layouts::TestDone { items }),
        Reply::Data { page, offset, data } => put(w, &[0x05, 1], &layouts::Data { page, offset, data }),
    }
}

impl layouts::Align {
    fn of(command: Command) -> Self {
        let (kind, values) = match command {
            Command::Begin { latitude_deg, gravity_mps2, velocity_noise_mps } => {
                (0, [latitude_deg, gravity_mps2, velocity_noise_mps])
            }
            Command::TurnBegins => (1, [0.0; 3]),
            Command::TurnEnded { angle_deg } => (2, [angle_deg, 0.0, 0.0]),
            Command::Accept => (3, [0.0; 3]),
            Command::Abandon => (4, [0.0; 3]),
            Command::Expect { drift_dph, tilt_arcmin } => (5, [drift_dph, tilt_arcmin, 0.0]),
        };
        Self { kind, values }
    }

    fn command(&self) -> Option<Command> {
        let [a, b, c] = self.values;
        Some(match self.kind {
            0 => Command::Begin { latitude_deg: a, gravity_mps2: b, velocity_noise_mps: c },
            1 => Command::TurnBegins,
            2 => Command::TurnEnded { angle_deg: a },
            3 => Command::Accept,
            4 => Command::Abandon,
            5 => Command::Expect { drift_dph: a, tilt_arcmin: b },
            _ => return None,
        })
    }
}
