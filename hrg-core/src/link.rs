//! The RS-422 link: typed messages, a CRC-32, COBS framing with a zero after each frame.
//!
//! Frame: `COBS(type u8, fields little-endian, CRC-32)` `0x00`. A receiver that joins late or sees garbage is in
//! step again at the next zero. The unit sends [`Message::Rate`] at 200 Hz (divider settable) and
//! [`Message::Housekeeping`] each second, and answers [`Message::Identify`] with [`Message::Identity`].

use crate::alignment::session::{self, Command};
use crate::bytes::{crc32, Reader, Writer};
use crate::compensator::Output;
use crate::frequency::StepFrequencies;
use crate::maintenance;
use crate::rate_path::{RateFrame, Summary};
use crate::sectors::Sector;
use crate::status::{AxisStatus, UnitStatus};
use crate::timebase::Timebase;
use crate::unit_name::UnitName;
use crate::AXES;
use heapless::Vec;

/// Longest frame before framing: type, fields, checksum.
pub const MAX_PAYLOAD: usize = 224;
/// A rate frame before framing: type, three numbers, four status bytes, three rates, checksum.
const RATE_PAYLOAD: usize = 1 + 12 + 4 + 12 + 4;
/// Longest frame on the wire, with its zero.
pub const MAX_FRAME: usize = MAX_PAYLOAD + 4;

/// Once a second: what the unit measured and how it feels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Housekeeping {
    /// Number of the model step, from start.
    pub step: u32,
    /// Time since power-on at the end of the step, ms.
    pub time_ms: u32,
    /// Frequencies, Hz; NaN where lost.
    pub frequency_hz: [f64; AXES],
    /// Temperatures, C; NaN before the first.
    pub temperature_c: [f32; AXES],
    /// Their rates of change, C per minute.
    pub rate_c_per_min: [f32; AXES],
    /// Biases in use after this step, deg/h.
    pub bias_dph: [f32; AXES],
    /// Mean raw rates over the bias before, deg/h; NaN without samples.
    pub raw_dph: [f32; AXES],
    /// Mean corrected rates over the same samples, deg/h.
    pub corrected_dph: [f32; AXES],
    /// Samples in those means.
    pub samples: u16,
    /// Samples missing or refused meanwhile.
    pub converter_errors: u16,
    /// Status of each axis.
    pub axis_status: [AxisStatus; AXES],
    /// Status of the unit.
    pub unit_status: UnitStatus,
    /// Rejected edges of each axis in this step.
    pub rejected: [u16; AXES],
    /// Missing edges of each axis in this step.
    pub missing: [u16; AXES],
    /// Frames out dropped since start.
    pub dropped: u16,
    /// Bad frames in since start.
    pub link_errors: u16,
    /// Checksum of the calibration in use; 0 for the compiled-in default.
    pub calibration: u32,
    /// Its sequence number.
    pub sequence: u32,
    /// When it was made, seconds since 1970.
    pub created_unix_s: u32,
    /// What the unit is doing: [`mode`].
    pub mode: u8,
}

/// Modes of a unit.
pub mod mode {
    /// Sending corrected rates.
    pub const NAVIGATE: u8 = 0;
    /// The same, and aligning.
    pub const ALIGN: u8 = 1;
    /// The same, and a calibration may be written.
    pub const MAINTENANCE: u8 = 2;
    /// Name of each mode.
    pub const NAMES: [&str; 3] = ["navigate", "align", "maintenance"];
}

impl Housekeeping {
    /// One second: the step that ended it, what the model made of it, and the means over the bias before
    /// (`None`: the rate path said nothing). Counters of the unit are zero: the sender fills them in.
    #[must_use]
    pub fn new(step: &StepFrequencies, output: &Output, summary: Option<&Summary>, timebase: Timebase) -> Self {
        let samples = summary.map_or(0, |s| s.samples);
        let converter_errors = summary.map_or(0, |s| s.converter_errors);
        Self {
            step: step.step,
            time_ms: timebase.to_ms(step.end_ticks),
            frequency_hz: step.frequency_hz.map(|f| f.unwrap_or(f64::NAN)),
            temperature_c: output.temperature_c,
            rate_c_per_min: output.rate_c_per_min,
            bias_dph: output.bias_dph,
            raw_dph: summary.map_or([f32::NAN; AXES], |s| s.raw_dph),
            corrected_dph: summary.map_or([f32::NAN; AXES], |s| s.corrected_dph),
            samples,
            converter_errors,
            axis_status: output.status,
            unit_status: if samples == 0 || converter_errors > 0 {
                UnitStatus::CONVERTER_FAULT
            } else {
                UnitStatus::empty()
            },
            rejected: step.rejected.map(|n| n.min(0xFFFF) as u16),
            missing: step.missing.map(|n| n.min(0xFFFF) as u16),
            dropped: 0,
            link_errors: 0,
            calibration: 0,
            sequence: 0,
            created_unix_s: 0,
            mode: mode::NAVIGATE,
        }
    }
}

/// Who is there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Identity {
    /// The unit's name in its calibration.
    pub unit: UnitName,
    /// Checksum of the calibration in use; 0 for the compiled-in default.
    pub calibration: u32,
    /// When that calibration was made, seconds since 1970.
    pub created_unix_s: u32,
    /// Its sequence number.
    pub sequence: u32,
}

impl Identity {
    /// The unit's name as text.
    #[must_use]
    pub fn unit_name(&self) -> &str {
        self.unit.as_str()
    }
}

/// Every message of the link.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Message {
    /// Unit to host: corrected rates.
    Rate(RateFrame),
    /// Unit to host: each second.
    Housekeeping(Housekeeping),
    /// Unit to host: answer to [`Message::Identify`].
    Identity(Identity),
    /// Unit to host: each second of an alignment.
    Alignment(session::Report),
    /// Host to unit: who are you?
    Identify,
    /// Host to unit: samples per rate frame, 1 to 1000.
    SetDivider(u16),
    /// Host to unit: of an alignment.
    Align(session::Command),
    /// Host to unit: of maintenance.
    Maintain(maintenance::Command),
    /// Unit to host: the reply to that.
    Maintained(maintenance::Reply),
}

/// Why bytes are not a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum LinkError {
    /// Longer than any frame.
    TooLong,
    /// Not COBS, or too short.
    Framing,
    /// The checksum does not match.
    Checksum,
    /// A type that is not known.
    UnknownType(u8),
    /// The fields are not as long as the type wants.
    Length(u8),
}

impl Message {
    /// The frame on the wire, with its zero.
    #[inline(never)]
    #[must_use]
    pub fn encode(&self) -> Vec<u8, MAX_FRAME> {
        // Rate frames are many and short: no more is cleared than they need.
        let longest = if matches!(self, Self::Rate(_)) { RATE_PAYLOAD } else { MAX_PAYLOAD };
        let mut plain: Vec<u8, MAX_PAYLOAD> = Vec::new();
        let _ = plain.resize(longest, 0);
        let mut w = Writer::new(&mut plain);
        self.write(&mut w);
        // The longest message fits: test `every_message_there_and_back`.
        let n = w.finish().unwrap_or(0);
        let crc = crc32(plain.get(..n).unwrap_or_default());
        plain.truncate(n);
        let _ = plain.extend_from_slice(&crc.to_le_bytes());
        let mut out = Vec::new();
        // COBS takes a byte more, the zero at the end another.
        let _ = out.resize(plain.len() + 2, 0);
        let room = out.len().saturating_sub(1);
        let used = out.get_mut(..room).map_or(0, |o| cobs::try_encode(&plain, o).unwrap_or(0));
        out.truncate(used + 1);
        if let Some(last) = out.last_mut() {
            *last = 0;
        }
        out
    }

    fn write(&self, w: &mut Writer<'_>) {
        match self {
            Self::Rate(r) => {
                w.u8(0x01);
                w.u32(r.sample);
                w.u32(r.tick);
                w.u32(r.step);
                w.bytes(&r.axis_status.map(|s| s.bits()));
                w.u8(r.unit_status.bits());
                w.f32s(&r.rate_dph);
            }
            Self::Housekeeping(h) => {
                w.u8(0x02);
                w.u32(h.step);
                w.u32(h.time_ms);
                for f in h.frequency_hz {
                    w.f64(f);
                }
                for v in [&h.temperature_c, &h.rate_c_per_min, &h.bias_dph, &h.raw_dph, &h.corrected_dph] {
                    w.f32s(v);
                }
                w.u16(h.samples);
                w.u16(h.converter_errors);
                w.bytes(&h.axis_status.map(|s| s.bits()));
                w.u8(h.unit_status.bits());
                for v in h.rejected.iter().chain(&h.missing) {
                    w.u16(*v);
                }
                w.u16(h.dropped);
                w.u16(h.link_errors);
                w.u32(h.calibration);
                w.u32(h.sequence);
                w.u32(h.created_unix_s);
                w.u8(h.mode);
            }
            Self::Identity(i) => {
                w.u8(0x03);
                w.bytes(i.unit.bytes());
                w.u32(i.calibration);
                w.u32(i.created_unix_s);
                w.u32(i.sequence);
            }
            Self::Alignment(a) => {
                w.u8(0x04);
                w.u32(a.second);
                w.u8(a.stage);
                w.u8(a.refusal);
                w.f32s(&[a.azimuth_deg, a.azimuth_std_arcmin]);
                for pair in [&a.tilt_arcmin, &a.drift_dph, &a.drift_std_dph] {
                    w.f32s(pair);
                }
                w.f32(a.integrity);
            }
            Self::Identify => w.u8(0x80),
            Self::SetDivider(d) => {
                w.u8(0x81);
                w.u16(*d);
            }
            Self::Align(command) => {
                w.u8(0x82);
                let (kind, a, b, c) = match *command {
                    Command::Begin { latitude_deg, gravity_mps2, velocity_noise_mps } => {
                        (0, latitude_deg, gravity_mps2, velocity_noise_mps)
                    }
                    Command::TurnBegins => (1, 0.0, 0.0, 0.0),
                    Command::TurnEnded { angle_deg } => (2, angle_deg, 0.0, 0.0),
                    Command::Accept => (3, 0.0, 0.0, 0.0),
                    Command::Abandon => (4, 0.0, 0.0, 0.0),
                };
                w.u8(kind);
                w.f32s(&[a, b, c]);
            }
            Self::Maintain(command) => {
                use maintenance::Command as C;
                w.u8(0x83);
                match command {
                    C::Open(name) => {
                        w.u8(0);
                        w.bytes(name.bytes());
                    }
                    C::Close => w.u8(1),
                    C::Begin(length) => {
                        w.u8(2);
                        w.u16(*length);
                    }
                    C::Chunk { offset, length, data } => {
                        w.u8(3);
                        w.u16(*offset);
                        w.u8(*length);
                        w.bytes(data);
                    }
                    C::End => w.u8(4),
                    C::Read { sector, offset } => {
                        w.u8(5);
                        w.u8(sector.number());
                        w.u16(*offset);
                    }
                    C::Restart => w.u8(6),
                }
            }
            Self::Maintained(reply) => {
                w.u8(0x05);
                match reply {
                    maintenance::Reply::Answer(answer, value) => {
                        w.u8(0);
                        w.u8(*answer as u8);
                        w.u32(*value);
                    }
                    maintenance::Reply::Data { sector, offset, data } => {
                        w.u8(1);
                        w.u8(sector.number());
                        w.u16(*offset);
                        w.bytes(data);
                    }
                }
            }
        }
    }

    /// What a unit says.
    fn read_report(kind: u8, r: &mut Reader<'_>) -> Option<Self> {
        Some(match kind {
            0x01 => Self::Rate(
                RateFrame {
                    sample: r.u32()?,
                    tick: r.u32()?,
                    step: r.u32()?,
                    axis_status: r.array::<AXES>()?.map(AxisStatus::from_bits_retain),
                    unit_status: UnitStatus::from_bits_retain(r.u8()?),
                    rate_dph: r.f32s()?,
                    integrity: 0,
                }
                .sealed(),
            ),
            0x02 => Self::Housekeeping(Housekeeping {
                step: r.u32()?,
                time_ms: r.u32()?,
                frequency_hz: [r.f64()?, r.f64()?, r.f64()?],
                temperature_c: r.f32s()?,
                rate_c_per_min: r.f32s()?,
                bias_dph: r.f32s()?,
                raw_dph: r.f32s()?,
                corrected_dph: r.f32s()?,
                samples: r.u16()?,
                converter_errors: r.u16()?,
                axis_status: r.array::<AXES>()?.map(AxisStatus::from_bits_retain),
                unit_status: UnitStatus::from_bits_retain(r.u8()?),
                rejected: [r.u16()?, r.u16()?, r.u16()?],
                missing: [r.u16()?, r.u16()?, r.u16()?],
                dropped: r.u16()?,
                link_errors: r.u16()?,
                calibration: r.u32()?,
                sequence: r.u32()?,
                created_unix_s: r.u32()?,
                mode: r.u8()?,
            }),
            0x03 => Self::Identity(Identity {
                unit: UnitName::from_bytes(r.array()?),
                calibration: r.u32()?,
                created_unix_s: r.u32()?,
                sequence: r.u32()?,
            }),
            0x04 => Self::Alignment(session::Report {
                second: r.u32()?,
                stage: r.u8()?,
                refusal: r.u8()?,
                azimuth_deg: r.f32()?,
                azimuth_std_arcmin: r.f32()?,
                tilt_arcmin: r.f32s()?,
                drift_dph: r.f32s()?,
                drift_std_dph: r.f32s()?,
                integrity: r.f32()?,
            }),
            0x05 => Self::Maintained(match r.u8()? {
                0 => maintenance::Reply::Answer(maintenance::Answer::from_number(r.u8()?)?, r.u32()?),
                1 => maintenance::Reply::Data {
                    sector: Sector::from_number(r.u8()?)?,
                    offset: r.u16()?,
                    data: r.array()?,
                },
                _ => return None,
            }),
            _ => return None,
        })
    }

    /// What a unit is told.
    fn read_command(kind: u8, r: &mut Reader<'_>) -> Option<Self> {
        Some(match kind {
            0x83 => {
                use maintenance::Command as C;
                Self::Maintain(match r.u8()? {
                    0 => C::Open(UnitName::from_bytes(r.array()?)),
                    1 => C::Close,
                    2 => C::Begin(r.u16()?),
                    3 => C::Chunk { offset: r.u16()?, length: r.u8()?, data: r.array()? },
                    4 => C::End,
                    5 => C::Read { sector: Sector::from_number(r.u8()?)?, offset: r.u16()? },
                    6 => C::Restart,
                    _ => return None,
                })
            }
            0x80 => Self::Identify,
            0x81 => Self::SetDivider(r.u16()?),
            0x82 => {
                let kind = r.u8()?;
                let [a, b, c] = r.f32s()?;
                Self::Align(match kind {
                    0 => Command::Begin { latitude_deg: a, gravity_mps2: b, velocity_noise_mps: c },
                    1 => Command::TurnBegins,
                    2 => Command::TurnEnded { angle_deg: a },
                    3 => Command::Accept,
                    4 => Command::Abandon,
                    _ => return None,
                })
            }
            _ => return None,
        })
    }

    /// Reads one frame, without its zero.
    ///
    /// # Errors
    /// [`LinkError`] says what is wrong; nothing of the frame is used.
    pub fn decode(frame: &[u8]) -> Result<Self, LinkError> {
        Self::decode_with(frame, |kind, r| match kind {
            0x01..=0x05 => Some(Self::read_report(kind, r)),
            0x80..=0x83 => Some(Self::read_command(kind, r)),
            _ => None,
        })
    }

    /// Reads one frame with `read`, which gives `None` for types that it does not know, and `Some(None)` where there is not
    /// enough of one.
    #[inline]
    fn decode_with(
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

/// Cuts a stream of bytes into frames.
#[derive(Debug, Clone, Default)]
pub struct Deframer {
    buffer: Vec<u8, MAX_FRAME>,
    overflow: bool,
}

impl Deframer {
    /// Takes one byte; gives a message, or why there is none, at the end of each frame. Empty frames are
    /// silence, not errors.
    pub fn push(&mut self, byte: u8) -> Option<Result<Message, LinkError>> {
        self.push_with(byte, Message::decode)
    }

    /// The same for a unit, which knows nothing but commands: what units say is of an unknown type.
    pub fn push_command(&mut self, byte: u8) -> Option<Result<Message, LinkError>> {
        self.push_with(byte, |frame| {
            Message::decode_with(frame, |kind, r| matches!(kind, 0x80..=0x83).then(|| Message::read_command(kind, r)))
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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn housekeeping() -> Housekeeping {
        Housekeeping {
            step: 77,
            time_ms: 78_050,
            frequency_hz: [4898.626, 4890.667, 4702.343],
            temperature_c: [6.3, 4.9, 5.0],
            rate_c_per_min: [0.0, 1.0, -1.0],
            bias_dph: [1.0, 2.0, 3.0],
            raw_dph: [4.0; 3],
            corrected_dph: [3.0, 2.0, 1.0],
            samples: 1000,
            converter_errors: 1,
            axis_status: [0, 1, 2].map(AxisStatus::from_bits_retain),
            unit_status: UnitStatus::LINK_ERRORS,
            rejected: [0, 0, 3],
            missing: [1, 0, 0],
            dropped: 0,
            link_errors: 9,
            calibration: 0xDEAD_BEEF,
            sequence: 12,
            created_unix_s: 1_700_000_000,
            mode: mode::ALIGN,
        }
    }

    fn messages() -> [Message; 20] {
        [
            Message::Rate(
                RateFrame {
                    sample: 0,
                    tick: 90_000,
                    step: 3,
                    axis_status: [AxisStatus::empty(); 3],
                    unit_status: UnitStatus::empty(),
                    rate_dph: [0.0, -1.5, 1e5],
                    integrity: 0,
                }
                .sealed(),
            ),
            Message::Housekeeping(housekeeping()),
            Message::Identity(Identity {
                unit: UnitName::new("aaaaaaaaaaaaaaaa"),
                calibration: 1,
                created_unix_s: 2,
                sequence: 3,
            }),
            Message::Identify,
            Message::SetDivider(5),
            Message::Alignment(session::Report {
                second: 9,
                stage: 3,
                refusal: 0,
                azimuth_deg: 100.5,
                azimuth_std_arcmin: 2.0,
                tilt_arcmin: [1.0, -2.0],
                drift_dph: [0.1, 0.2],
                drift_std_dph: [0.01, 0.02],
                integrity: 0.5,
            }),
            Message::Align(Command::Begin { latitude_deg: 45.0, gravity_mps2: 0.0, velocity_noise_mps: 1e-3 }),
            Message::Align(Command::TurnBegins),
            Message::Align(Command::TurnEnded { angle_deg: 90.0 }),
            Message::Align(Command::Accept),
            Message::Align(Command::Abandon),
            Message::Maintain(maintenance::Command::Open(UnitName::new("HRG-101"))),
            Message::Maintain(maintenance::Command::Close),
            Message::Maintain(maintenance::Command::Begin(453)),
            Message::Maintain(maintenance::Command::Chunk { offset: 128, length: 12, data: [7; maintenance::CHUNK] }),
            Message::Maintain(maintenance::Command::End),
            Message::Maintain(maintenance::Command::Read { sector: Sector::B, offset: 256 }),
            Message::Maintain(maintenance::Command::Restart),
            Message::Maintained(maintenance::Reply::Answer(maintenance::Answer::NotNewer, 77)),
            Message::Maintained(maintenance::Reply::Data {
                sector: Sector::B,
                offset: 0,
                data: [9; maintenance::CHUNK],
            }),
        ]
    }

    #[test]
    fn every_message_there_and_back() {
        let mut d = Deframer::default();
        for m in messages() {
            let bytes = m.encode();
            assert_eq!(bytes.iter().filter(|&&b| b == 0).count(), 1, "one zero, at the end");
            let mut got = None;
            for b in bytes {
                got = got.or(d.push(b));
            }
            assert_eq!(got, Some(Ok(m)));
        }
    }

    #[test]
    fn a_flipped_bit_never_passes() {
        for m in messages() {
            let bytes = m.encode();
            for bit in 0..(bytes.len() - 1) * 8 {
                let mut b = bytes.clone();
                b[bit / 8] ^= 1 << (bit % 8);
                assert!(Message::decode(&b[..b.len() - 1]).is_err());
            }
        }
    }

    proptest! {
        #[test]
        fn in_step_again_after_garbage(garbage in proptest::collection::vec(any::<u8>(), 0..600)) {
            let mut d = Deframer::default();
            for b in garbage.into_iter().chain([0]) {
                let _ = d.push(b);
            }
            let mut got = None;
            for b in Message::Identify.encode() {
                got = got.or(d.push(b));
            }
            prop_assert_eq!(got, Some(Ok(Message::Identify)));
        }
    }
}
