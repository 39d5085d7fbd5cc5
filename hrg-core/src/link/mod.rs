//! The RS-422 link: typed messages, a CRC-32, COBS framing with a zero after each frame.
//!
//! Frame: `COBS(type u8, fields little-endian, CRC-32)` `0x00`. A receiver that joins late or sees garbage is in
//! step again at the next zero. The unit sends [`Message::Rate`] at 200 Hz (decimation settable) and
//! [`Message::Housekeeping`] each second, and answers [`Message::Identify`] with [`Message::Identity`].
//!
//! # Example
//! ```
//! use hrg_core::link::{Deframer, Message};
//!
//! let wire = Message::SetDecimation(5).encode();
//! let mut deframer = Deframer::default();
//! let heard: Vec<_> = wire.iter().filter_map(|byte| deframer.push(*byte)).collect();
//! assert_eq!(heard, [Ok(Message::SetDecimation(5))]);
//! ```

mod codec;
mod deframe;
pub mod layouts;

pub use codec::{FAST_FRAME, RATE_FRAME};
pub use deframe::Deframer;

use crate::align_mode;
use crate::compensator::Output;
use crate::filter::Filter;
use crate::frequency::StepFrequencies;
use crate::gnss::{GnssTime, TimeMark};
use crate::increments::IncrementFrame;
use crate::inputs::{InputValues, QUANTITIES};
use crate::maintenance;
use crate::output::{Framing, OutputSettings};
use crate::rate_path::{RateFrame, Summary};
use crate::reset::ResetCause;
use crate::status::{AxisStatus, UnitStatus};
use crate::stopped::Stopped;
use crate::timebase::Timebase;
use crate::unit_name::UnitName;
use crate::update::Programs;
use crate::AXES;

/// Longest frame before framing: type, fields, checksum.
pub const MAX_PAYLOAD: usize = 224;
/// Longest frame on the wire, with its zero.
pub const MAX_FRAME: usize = MAX_PAYLOAD + 4;

/// Once a second: what the unit measured and how it feels.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Housekeeping {
    /// Number of the model step, from start.
    pub step: u32,
    /// Time since start at the end of the step, ms.
    pub time_ms: u32,
    /// Time since power-on at the end of the step, s: restarts do not end it.
    pub on_for_s: f32,
    /// Frequencies, Hz; NaN where lost.
    pub frequency_hz: [f64; AXES],
    /// Temperatures, C; NaN before the first.
    pub temperature_c: [f32; AXES],
    /// Their rates of change, C per minute.
    pub ramp_c_per_min: [f32; AXES],
    /// Biases in use after this step, deg/h.
    pub bias_dph: [f32; AXES],
    /// Their standard uncertainties, deg/h; NaN where the calibration does not state them.
    pub bias_std_dph: [f32; AXES],
    /// Mean raw rates over the bias before, deg/h; NaN without samples.
    pub raw_dph: [f32; AXES],
    /// Mean corrected rates over the same samples, deg/h.
    pub corrected_dph: [f32; AXES],
    /// Samples in those means.
    pub samples: u16,
    /// Samples missing or refused meanwhile.
    pub adc_errors: u16,
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
    /// Bad frames in, and alignment commands that were refused, since start.
    pub link_errors: u16,
    /// Checksum of the calibration in use; 0 for the compiled-in default.
    pub calibration: u32,
    /// Its sequence number.
    pub sequence: u32,
    /// Time at which it was made, seconds since 1970.
    pub created_unix_s: u32,
    /// Resets since power-on.
    pub resets: u16,
    /// Mode of the unit: [`mode`].
    pub mode: u8,
    /// Timer tick of the last pulse per second.
    pub pps_tick: u32,
    /// Its age at the end of the step, ms; `u32::MAX`: there was none since the start.
    pub pps_age_ms: u32,
    /// Relative error of the unit's clock (positive: fast), as it is corrected, parts per 1e9; 0 before the first measurement.
    pub clock_ppb: f32,
}

/// Modes of a unit.
///
/// # Example
/// ```
/// use hrg_core::link::mode;
///
/// assert_eq!(mode::NAMES[usize::from(mode::ALIGN)], "align");
/// ```
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
    /// (`None`: the rate path reported nothing). Counters of the unit are zero: the sender fills them in.
    #[must_use]
    pub fn new(step: &StepFrequencies, output: &Output, summary: Option<&Summary>, timebase: Timebase) -> Self {
        let samples = summary.map_or(0, |s| s.samples);
        let adc_errors = summary.map_or(0, |s| s.adc_errors);
        Self {
            step: step.step,
            time_ms: timebase.to_ms(step.end_ticks),
            on_for_s: output.on_for_s,
            frequency_hz: step.frequency_hz.map(|f| f.unwrap_or(f64::NAN)),
            temperature_c: output.temperature_c,
            ramp_c_per_min: output.ramp_c_per_min,
            bias_dph: output.bias_dph,
            bias_std_dph: output.bias_std_dph,
            raw_dph: summary.map_or([f32::NAN; AXES], |s| s.raw_dph),
            corrected_dph: summary.map_or([f32::NAN; AXES], |s| s.corrected_dph),
            samples,
            adc_errors,
            axis_status: output.status,
            unit_status: if samples == 0 || adc_errors > 0 { UnitStatus::ADC_FAULT } else { UnitStatus::empty() },
            rejected: step.rejected.map(|n| n.min(0xFFFF) as u16),
            missing: step.missing.map(|n| n.min(0xFFFF) as u16),
            dropped: 0,
            link_errors: 0,
            calibration: 0,
            sequence: 0,
            created_unix_s: 0,
            resets: 0,
            mode: mode::NAVIGATE,
            pps_tick: 0,
            pps_age_ms: u32::MAX,
            clock_ppb: 0.0,
        }
    }
}

/// Identity of a unit.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Identity {
    /// The unit's name in its calibration.
    pub unit: UnitName,
    /// Checksum of the calibration in use; 0 for the compiled-in default.
    pub calibration: u32,
    /// Time at which that calibration was made, seconds since 1970.
    pub created_unix_s: u32,
    /// Its sequence number.
    pub sequence: u32,
    /// Why the unit started.
    pub reset_cause: ResetCause,
    /// Resets since power-on, as far as states were kept over them.
    pub resets: u16,
    /// Option bytes of the processor ([`crate::option_bytes`]).
    pub option_bytes: u32,
    /// Filter from samples to frames.
    pub filter: Filter,
    /// Samples per rate frame.
    pub decimation: u16,
    /// Samples per message of increments; 0: none are sent.
    pub increments: u16,
    /// Framing of what goes out.
    pub framing: Framing,
    /// From the time that a rate frame is of to the data-ready edge of its last sample, us.
    pub delay_us: u32,
}

impl Identity {
    /// The same of a unit that sends by these settings.
    #[must_use]
    pub fn with_output(self, settings: OutputSettings) -> Self {
        let OutputSettings { filter, decimation, increments, framing } = settings;
        Self { filter, decimation, increments, framing, delay_us: filter.delay_us(decimation), ..self }
    }

    /// The unit's name as text.
    #[must_use]
    pub fn unit_name(&self) -> &str {
        self.unit.as_str()
    }
}

/// Inputs that came in in time for a model step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InputsUsed {
    /// Number of the model step.
    pub step: u32,
    /// Values by number ([`crate::inputs::NAMES`]), each in its unit; NaN where there was none.
    pub values: [f32; QUANTITIES],
}

impl Default for InputsUsed {
    fn default() -> Self {
        Self { step: 0, values: [f32::NAN; QUANTITIES] }
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
    Alignment(align_mode::Report),
    /// Host to unit: who are you?
    Identify,
    /// Host to unit: samples per rate frame, 1 to 1000.
    SetDecimation(u16),
    /// Host to unit: of an alignment.
    Align(align_mode::Command),
    /// Host to unit: of maintenance.
    Maintain(maintenance::Command),
    /// Unit to host: the reply to that.
    Maintained(maintenance::Reply),
    /// Host to unit: inputs beside the frequencies, about once a second.
    Inputs(InputValues),
    /// Unit to host: the inputs that a model step has used, each second once any has come.
    InputsUsed(InputsUsed),
    /// Unit to host, after each [`Message::Identity`]: what the stop before the last start has left, if there was one.
    Stopped(Stopped),
    /// Unit to host: its programs (answer to [`Identify`](Self::Identify), behind [`Identity`](Self::Identity)).
    Programs(Programs),
    /// Unit to host: increments of angle and velocity, where they are asked for.
    Increments(IncrementFrame),
    /// Unit to host: each second, once GNSS time is known.
    TimeMark(TimeMark),
    /// Host to unit: GNSS time of the last pulse per second.
    GnssTime(GnssTime),
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::align_mode::Command;
    use crate::self_test::{Check, Item};
    use crate::zero::Zero;
    use proptest::prelude::*;

    fn housekeeping() -> Housekeeping {
        Housekeeping {
            step: 77,
            time_ms: 78_050,
            on_for_s: 3678.05,
            frequency_hz: [4898.626, 4890.667, 4702.343],
            temperature_c: [6.3, 4.9, 5.0],
            ramp_c_per_min: [0.0, 1.0, -1.0],
            bias_dph: [1.0, 2.0, 3.0],
            bias_std_dph: [0.125, 0.25, 0.5],
            raw_dph: [4.0; 3],
            corrected_dph: [3.0, 2.0, 1.0],
            samples: 1000,
            adc_errors: 1,
            axis_status: [0, 1, 2].map(AxisStatus::from_bits_retain),
            unit_status: UnitStatus::LINK_ERRORS,
            rejected: [0, 0, 3],
            missing: [1, 0, 0],
            dropped: 0,
            link_errors: 9,
            calibration: 0xDEAD_BEEF,
            sequence: 12,
            created_unix_s: 1_700_000_000,
            resets: 3,
            mode: mode::ALIGN,
            pps_tick: 4_000_000_000,
            pps_age_ms: 481,
            clock_ppb: -1234.5,
        }
    }

    fn messages() -> [Message; 30] {
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
                .with_integrity(),
            ),
            Message::Housekeeping(housekeeping()),
            Message::Identity(
                Identity {
                    unit: UnitName::new("aaaaaaaaaaaaaaaa"),
                    calibration: 1,
                    created_unix_s: 2,
                    sequence: 3,
                    reset_cause: ResetCause::Pin,
                    resets: 4,
                    option_bytes: 0x0FFF_AAED,
                    ..Identity::default()
                }
                .with_output(OutputSettings::default()),
            ),
            Message::Identify,
            Message::SetDecimation(5),
            Message::Alignment(align_mode::Report {
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
            Message::Align(Command::Expect { drift_dph: 1.5, tilt_arcmin: 30.0 }),
            Message::Maintain(maintenance::Command::Open(UnitName::new("HRG-101"))),
            Message::Maintain(maintenance::Command::Close),
            Message::Maintain(maintenance::Command::Begin(453)),
            Message::Maintain(maintenance::Command::Chunk { offset: 128, length: 12, data: [7; maintenance::CHUNK] }),
            Message::Maintain(maintenance::Command::End),
            Message::Maintain(maintenance::Command::Read { page: 32, offset: 256 }),
            Message::Maintain(maintenance::Command::Restart),
            Message::Maintain(maintenance::Command::Newest),
            Message::Maintain(maintenance::Command::Zero(Zero {
                made_unix_s: 5,
                constant_dph: [1.0; 3],
                std_dph: [0.5; 3],
            })),
            Message::Maintained(maintenance::Reply::Answer(maintenance::Answer::NotNewer, 77)),
            Message::Maintained(maintenance::Reply::Data { page: 32, offset: 0, data: [9; maintenance::CHUNK] }),
            Message::Maintain(maintenance::Command::Test),
            Message::Maintain(maintenance::Command::Tested(50)),
            Message::Maintained(maintenance::Reply::Tested {
                number: 33,
                item: Item { check: Check::Temperature, index: 2, value: 71.5, low: -40.0, high: 60.0 },
            }),
            Message::Maintained(maintenance::Reply::TestDone(53)),
            Message::Inputs(InputValues::of([(2, 2.25), (5, -0.5)])),
            Message::InputsUsed(InputsUsed { step: 7, values: [0.5; QUANTITIES] }),
            Message::Stopped(
                Stopped { line: 7, pc: 0x0801_2345, ..Stopped::default() }.in_file("firmware/src/rate.rs"),
            ),
        ]
    }

    /// Those of what is sent.
    fn of_outputs() -> [Message; 4] {
        let frame = IncrementFrame { sample: 9, ticks: 450_000, angle_rad: [1e-3; 3], ..IncrementFrame::default() };
        [
            Message::Increments(frame.with_integrity()),
            Message::TimeMark(TimeMark { tick: 1, week: 2394, second: 3, std_ns: 4, leap_s: 18, quality: 3 }),
            Message::GnssTime(GnssTime { week: 2394, second: 604_799, std_ns: 20, leap_s: 18 }),
            Message::Maintain(maintenance::Command::Output(OutputSettings {
                increments: 5,
                ..OutputSettings::default()
            })),
        ]
    }

    /// Those of an update.
    fn of_updates() -> [Message; 6] {
        [
            Message::Maintain(maintenance::Command::Program { length: 140_000, sum: 7 }),
            Message::Maintain(maintenance::Command::Piece {
                offset: 100_000,
                length: 12,
                data: [7; maintenance::CHUNK],
            }),
            Message::Maintain(maintenance::Command::Commit([9; 64])),
            Message::Maintain(maintenance::Command::RollBack),
            Message::Maintain(maintenance::Command::Echo(8)),
            Message::Programs(Programs {
                slot: 1,
                version: 2_003_004,
                sum: 9,
                name: *b"a program of some name..........",
                ..Programs::default()
            }),
        ]
    }

    #[test]
    fn every_message_there_and_back() {
        let mut d = Deframer::default();
        for m in messages().into_iter().chain(of_updates()).chain(of_outputs()) {
            let bytes = m.encode();
            assert_eq!(bytes.iter().filter(|&&b| b == 0).count(), 1, "one zero, at the end");
            let mut got = None;
            for b in bytes {
                got = got.or(d.push(b));
            }
            assert_eq!(got, Some(Ok(m)));
        }
    }

    proptest! {
        #[test]
        fn whatever_is_in_a_frame_comes_back_by_the_library_s_decoder(
            words in proptest::collection::vec(prop_oneof![Just(0u32), any::<u32>(), 0u32..256], 13),
        ) {
            let f = |k: usize| f32::from_bits(words[k]);
            let rate = RateFrame { sample: words[0], tick: words[1], step: words[2], rate_dph: [f(3), f(4), f(5)], ..RateFrame::default() };
            let more = IncrementFrame {
                sample: words[6],
                ticks: words[7],
                angle_rad: [f(8), f(9), f(10)],
                velocity_mps: [f(11), f(12), 0.0],
                ..IncrementFrame::default()
            };
            // One behind the other in one buffer, as a unit sends them.
            let mut wire: heapless::Vec<u8, { 2 * FAST_FRAME }> = heapless::Vec::new();
            Message::encode_rate(&rate, &mut wire);
            Message::encode_increments(&more, &mut wire);
            let mut d = Deframer::default();
            let got: heapless::Vec<Message, 2> = wire.iter().filter_map(|b| d.push(*b)).map(|m| m.expect("valid")).collect();
            let bits = |m: &Message| m.encode();
            prop_assert_eq!(got.iter().map(bits).collect::<heapless::Vec<_, 2>>(), [bits(&Message::Rate(rate)), bits(&Message::Increments(more))]);
        }
    }

    #[test]
    fn inputs_on_the_line_are_the_bytes_of_the_page() {
        // docs/inputs.md
        let wire = Message::Inputs(InputValues::of([(2, 1.2175), (5, 0.081)])).encode();
        let (head, tail) = (&wire[..18], &wire[41..]);
        assert_eq!(head, b"\x12\x84\x02\x05\xff\xff\xff\xff\xff\xff\x0a\xd7\x9b\x3f\x54\xe3\xa5\x3d");
        assert!(wire[18..41].iter().all(|b| *b == 1));
        assert_eq!(tail, b"\x05\x2f\xf4\x89\x81\x00");
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
