//! Messages to bytes and back.

use super::{Housekeeping, Identity, LinkError, Message, MAX_FRAME, MAX_PAYLOAD};
use crate::alignment::session::{self, Command};
use crate::bytes::{crc32, Reader, Writer};
use crate::maintenance;
use crate::rate_path::RateFrame;
use crate::sectors::Sector;
use crate::status::{AxisStatus, UnitStatus};
use crate::unit_name::UnitName;
use crate::AXES;
use heapless::Vec;

/// A rate frame before framing: type, three numbers, four status bytes, three rates, checksum.
const RATE_PAYLOAD: usize = 1 + 12 + 4 + 12 + 4;

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
                w.f32s(&h.bias_std_dph);
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
                // A unit of an older firmware does not send it.
                bias_std_dph: if r.remaining() == 0 { [f32::NAN; AXES] } else { r.f32s()? },
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
    pub(super) fn read_command(kind: u8, r: &mut Reader<'_>) -> Option<Self> {
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
