//! The fields of each message, in the order in which they lie in a frame.
//!
//! # Example
//! ```
//! use hrg_core::rate_path::RateFrame;
//! use hrg_core::schema::Layout;
//!
//! // Lists come with names, meanings and units: `docs/formats.md` is printed from them.
//! let rates = RateFrame::FIELDS.last().expect("some");
//! assert_eq!((rates.name, rates.meaning), ("rate_dph", "corrected rates, deg/h"));
//! ```

use super::{Housekeeping, Identity, InputsUsed};
use crate::align_mode;
use crate::filter::Filter;
use crate::gnss::{GnssTime, TimeMark};
use crate::increments::IncrementFrame;
use crate::inputs::{InputValues, IN_MESSAGE, QUANTITIES};
use crate::maintenance::CHUNK;
use crate::output::{Framing, OutputSettings};
use crate::rate_path::RateFrame;
use crate::reset::ResetCause;
use crate::schema::{layout, Field, Layout};
use crate::signature::SIGNATURE;
use crate::slots::head;
use crate::status::{AxisStatus, UnitStatus};
use crate::stopped::Stopped;
use crate::unit_name::UnitName;
use crate::update::Programs;
use crate::zero::Zero;
use crate::AXES;

layout! { RateFrame {
    sample: u32, "sample times from start to its last sample";
    tick: u32, "timer tick of the time that the rate is of: that sample's data-ready edge less the delay in identity";
    step: u32, "number of the model step whose bias was taken off";
    axis_status: [AxisStatus; AXES], "status of each axis, worst over the samples";
    unit_status: UnitStatus, "status of the unit";
    rate_dph: [f32; AXES], "corrected rates, deg/h";
} }

layout! { Housekeeping {
    step: u32, "number of the model step";
    time_ms: u32, "time since start at its end, ms";
    on_for_s: f32, "time since power-on at its end, over restarts, s";
    frequency_hz: [f64; AXES], "frequencies, Hz; NaN where lost";
    temperature_c: [f32; AXES], "temperatures, C; NaN before the first";
    ramp_c_per_min: [f32; AXES], "their rates of change, C per minute";
    bias_dph: [f32; AXES], "biases in use after this step, deg/h";
    raw_dph: [f32; AXES], "mean raw rates over the bias before, deg/h";
    corrected_dph: [f32; AXES], "mean corrected rates of the same samples, deg/h";
    samples: u16, "samples in those means";
    adc_errors: u16, "samples missing or refused meanwhile";
    axis_status: [AxisStatus; AXES], "status of each axis";
    unit_status: UnitStatus, "status of the unit";
    rejected: [u16; AXES], "rejected edges in this step";
    missing: [u16; AXES], "missing edges in this step";
    dropped: u16, "frames out dropped since start";
    link_errors: u16, "bad frames in and refused alignment commands since start";
    calibration: u32, "checksum of the image in use; 0: the compiled-in default";
    sequence: u32, "its sequence number";
    created_unix_s: u32, "when it was made, seconds since 1970";
    resets: u16, "resets since power-on";
    mode: u8, "0 navigate, 1 align, 2 maintenance";
    bias_std_dph: [f32; AXES], "standard uncertainties of the biases, deg/h; NaN where the image does not state them";
    pps_tick: u32, "timer tick of the last pulse per second";
    pps_age_ms: u32, "its age at the end of the model step, ms; 4294967295: there was none";
    clock_ppb: f32, "how much the unit's clock is fast, as corrected, parts per 1e9; 0 before the first measurement";
} }

layout! { Identity {
    unit: UnitName, "name in the image in use";
    calibration: u32, "checksum of the image in use; 0: the compiled-in default";
    created_unix_s: u32, "when it was made, seconds since 1970";
    sequence: u32, "its sequence number";
    reset_cause: ResetCause, "why the unit started: 0 power, 1 pin, 2 software, 3 watchdog";
    resets: u16, "resets since power-on";
    option_bytes: u32, "option bytes of the processor: FLASH_OPTCR";
    filter: Filter, "filter from samples to frames: 0 means, 1 linear phase";
    decimation: u16, "samples per rate frame";
    increments: u16, "samples per message of increments; 0: none are sent";
    framing: Framing, "framing of what goes out: 0 own, 1 MAVLink";
    delay_us: u32, "from the time that a rate frame is of to the data-ready edge of its last sample, us";
} }

layout! { Programs {
    slot: u8, "slot whose program runs: 0 A, 1 B";
    state: u8, "its state: 1 new, 2 on trial, 3 confirmed";
    version: u32, "its version: (major * 1000 + minor) * 1000 + patch";
    sum: u32, "its sum (CRC-32/MPEG-2 of its words), which tells one build from another; all ones: flashed without it";
    name: [u8; head::TEXT], "its name, zeros behind it";
    other_state: u8, "state of the program in the other slot: 0: there is none";
    other_version: u32, "its version; 0: there is none";
    other_sum: u32, "its sum; 0: there is none";
    other_name: [u8; head::TEXT], "its name, zeros behind it";
    token: u32, "to be sent back (maintain: echo), so that a program on trial knows that it is received";
} }

layout! { align_mode::Report {
    second: u32, "number of the second, from the start of the alignment";
    stage: u8, "stage";
    refusal: u8, "why there is no result; 0: the numbers are a result";
    azimuth_deg: f32, "azimuth, degrees";
    azimuth_std_arcmin: f32, "its standard deviation, arc minutes";
    tilt_arcmin: [f32; 2], "tilts, arc minutes";
    drift_dph: [f32; 2], "drifts, deg/h";
    drift_std_dph: [f32; 2], "their standard deviations, deg/h";
    integrity: f32, "check of the two positions, chi-square; NaN: none";
} }

layout! { InputsUsed {
    step: u32, "number of the model step";
    values: [f32; QUANTITIES], "values by number of the quantity, in its unit; NaN where there was none";
} }

layout! { IncrementFrame {
    sample: u32, "sample times from start to its last sample; the interval begins at that of the message before";
    tick: u32, "timer tick at which the interval ends";
    ticks: u32, "its length, ticks";
    axis_status: [AxisStatus; AXES], "status of each axis, worst over the samples";
    unit_status: UnitStatus, "status of the unit";
    angle_rad: [f32; AXES], "increments of angle, corrected for coning, rad";
    velocity_mps: [f32; AXES], "increments of velocity, corrected for rotation and sculling, m/s; NaN: no accelerometer there, or at its end of scale";
} }

layout! { TimeMark {
    tick: u32, "timer tick of the last pulse per second";
    week: u16, "GPS week of that pulse, counted on";
    second: u32, "second of the week";
    std_ns: u32, "standard deviation of that, ns";
    leap_s: u8, "leap seconds, GPS time less UTC; 255: not known";
    quality: u8, "1 coasting without pulses, 2 counted by pulses, 3 by pulses and messages";
} }

layout! { GnssTime {
    week: u16, "GPS week of the last pulse per second, counted on";
    second: u32, "second of the week";
    std_ns: u32, "standard deviation of the pulse, ns";
    leap_s: u8, "leap seconds, GPS time less UTC; 255: not known";
} }

layout! { OutputSettings {
    filter: Filter, "filter from samples to frames: 0 means, 1 linear phase";
    decimation: u16, "samples per rate frame, 1 to 1000";
    increments: u16, "samples per message of increments, 1 to 50; 0: none";
    framing: Framing, "framing of what goes out: 0 own, 1 MAVLink";
} }

layout! { InputValues {
    numbers: [u8; IN_MESSAGE], "numbers of the quantities; 255: none stands here";
    values: [f32; IN_MESSAGE], "their values, in their units";
} }

/// Fields of [`super::Message::SetDecimation`].
#[derive(Default)]
pub(super) struct Decimation {
    pub(super) decimation: u16,
}
layout! { Decimation { decimation: u16, "samples per rate frame, 1 to 1000"; } }

/// Fields of [`super::Message::Align`].
#[derive(Default)]
pub(super) struct Align {
    pub(super) kind: u8,
    pub(super) values: [f32; 3],
}
layout! { Align {
    kind: u8, "0 begin, 1 turn begins, 2 turn ended, 3 accept, 4 abandon, 5 expect (before begin)";
    values: [f32; 3], "0: latitude (deg), gravity (m/s^2), velocity noise (m/s); 2: angle (deg), 0, 0; 5: drift (deg/h), tilt (arc minutes) of one sigma, 0, where 0 stands for the usual; else zeros";
} }

/// Fields of [`crate::maintenance::Command::Open`].
#[derive(Default)]
pub(super) struct Open {
    pub(super) unit: UnitName,
}
layout! { Open { unit: UnitName, "name of the unit that is meant"; } }

/// Fields of [`crate::maintenance::Command::Begin`].
#[derive(Default)]
pub(super) struct Begin {
    pub(super) length: u16,
}
layout! { Begin { length: u16, "bytes that follow: the image, and its signature where it has one"; } }

/// Fields of [`crate::maintenance::Command::Chunk`].
pub(super) struct Chunk {
    pub(super) offset: u16,
    pub(super) length: u8,
    pub(super) data: [u8; CHUNK],
}
layout! { Chunk {
    offset: u16, "offset in what comes";
    length: u8, "bytes of it that count";
    data: [u8; CHUNK], "the bytes";
} }
impl Default for Chunk {
    fn default() -> Self {
        Self { offset: 0, length: 0, data: [0; CHUNK] }
    }
}

/// Fields of [`crate::maintenance::Command::Read`].
#[derive(Default)]
pub(super) struct Read {
    pub(super) page: u8,
    pub(super) offset: u16,
}
layout! { Read {
    page: u8, "0 to 3: sector A in pages of 4096 bytes; 4 to 7: sector B; 248 to 251: the field log";
    offset: u16, "offset in the page";
} }

layout! { Zero {
    made_unix_s: u32, "time at which they were measured, seconds since 1970";
    constant_dph: [f32; AXES], "to be added to the biases, deg/h; zeros: back to the calibration's";
    std_dph: [f32; AXES], "their standard uncertainties, deg/h";
} }

/// Fields of [`crate::maintenance::Command::Tested`].
#[derive(Default)]
pub(super) struct Tested {
    pub(super) number: u8,
}
layout! { Tested { number: u8, "number of the item, from 0"; } }

/// Fields of [`crate::maintenance::Command::Program`].
#[derive(Default)]
pub(super) struct Program {
    pub(super) length: u32,
    pub(super) sum: u32,
}
layout! { Program {
    length: u32, "bytes that follow, from the head of the program to its end";
    sum: u32, "their sum: CRC-32/MPEG-2 of their words";
} }

/// Fields of [`crate::maintenance::Command::Echo`].
#[derive(Default)]
pub(super) struct Echo {
    pub(super) token: u32,
}
layout! { Echo { token: u32, "token of the last message programs"; } }

/// Fields of [`crate::maintenance::Command::Piece`].
pub(super) struct Piece {
    pub(super) offset: u32,
    pub(super) length: u8,
    pub(super) data: [u8; CHUNK],
}
layout! { Piece {
    offset: u32, "offset from the head of the program";
    length: u8, "bytes of it that count, a multiple of four";
    data: [u8; CHUNK], "the bytes";
} }
impl Default for Piece {
    fn default() -> Self {
        Self { offset: 0, length: 0, data: [0; CHUNK] }
    }
}

/// Fields of [`crate::maintenance::Command::Commit`].
pub(super) struct Commit {
    pub(super) signature: [u8; SIGNATURE],
}
layout! { Commit { signature: [u8; SIGNATURE], "Ed25519 signature of the program from its head on; of no meaning where the unit has no key"; } }
impl Default for Commit {
    fn default() -> Self {
        Self { signature: [0; SIGNATURE] }
    }
}

/// Fields of [`crate::maintenance::Reply::Tested`].
#[derive(Default)]
pub(super) struct Item {
    pub(super) number: u8,
    pub(super) check: u8,
    pub(super) index: u8,
    pub(super) value: f32,
    pub(super) low: f32,
    pub(super) high: f32,
}
layout! { Item {
    number: u8, "number of the item, as it was asked for";
    check: u8, "number of the check (see below)";
    index: u8, "channel or axis, from 0";
    value: f32, "figure; NaN: there is none";
    low: f32, "least that passes; NaN: not tested";
    high: f32, "most that passes; NaN: not tested";
} }

/// Fields of [`crate::maintenance::Reply::TestDone`].
#[derive(Default)]
pub(super) struct TestDone {
    pub(super) items: u8,
}
layout! { TestDone { items: u8, "items, to be asked for by their numbers"; } }

/// Fields of [`crate::maintenance::Reply::Answer`].
#[derive(Default)]
pub(super) struct Answer {
    pub(super) answer: u8,
    pub(super) value: u32,
}
layout! { Answer {
    answer: u8, "number of the answer";
    value: u32, "what it is about: a place (bytes from the start of sector A, B following it; all ones: none), an offset, a checksum";
} }

/// Fields of [`crate::maintenance::Reply::Data`].
pub(super) struct Data {
    pub(super) page: u8,
    pub(super) offset: u16,
    pub(super) data: [u8; CHUNK],
}
layout! { Data {
    page: u8, "number of the page";
    offset: u16, "offset in the page";
    data: [u8; CHUNK], "the bytes there";
} }
impl Default for Data {
    fn default() -> Self {
        Self { page: 0, offset: 0, data: [0; CHUNK] }
    }
}

/// A message as it lies in a frame, for tables and other programs.
#[derive(Debug, Clone, Copy)]
pub struct Table {
    /// Name of the message.
    pub name: &'static str,
    /// Its type, and the kind within the type where there are several: the bytes that stand before the fields.
    pub lead: &'static [u8],
    /// The fields.
    pub fields: &'static [Field],
}

/// Every message.
pub const MESSAGES: &[Table] = &[
    Table { name: "rate", lead: &[0x01], fields: RateFrame::FIELDS },
    Table { name: "housekeeping", lead: &[0x02], fields: Housekeeping::FIELDS },
    Table { name: "identity", lead: &[0x03], fields: Identity::FIELDS },
    Table { name: "alignment", lead: &[0x04], fields: align_mode::Report::FIELDS },
    Table { name: "maintained: answer", lead: &[0x05, 0], fields: Answer::FIELDS },
    Table { name: "maintained: data", lead: &[0x05, 1], fields: Data::FIELDS },
    Table { name: "maintained: item of the test", lead: &[0x05, 2], fields: Item::FIELDS },
    Table { name: "maintained: test done", lead: &[0x05, 3], fields: TestDone::FIELDS },
    Table { name: "inputs used", lead: &[0x06], fields: InputsUsed::FIELDS },
    Table { name: "stopped", lead: &[0x07], fields: Stopped::FIELDS },
    Table { name: "programs", lead: &[0x08], fields: Programs::FIELDS },
    Table { name: "increments", lead: &[0x09], fields: IncrementFrame::FIELDS },
    Table { name: "time mark", lead: &[0x0A], fields: TimeMark::FIELDS },
    Table { name: "identify", lead: &[0x80], fields: &[] },
    Table { name: "set decimation", lead: &[0x81], fields: Decimation::FIELDS },
    Table { name: "align", lead: &[0x82], fields: Align::FIELDS },
    Table { name: "maintain: open", lead: &[0x83, 0], fields: Open::FIELDS },
    Table { name: "maintain: close", lead: &[0x83, 1], fields: &[] },
    Table { name: "maintain: begin", lead: &[0x83, 2], fields: Begin::FIELDS },
    Table { name: "maintain: chunk", lead: &[0x83, 3], fields: Chunk::FIELDS },
    Table { name: "maintain: end", lead: &[0x83, 4], fields: &[] },
    Table { name: "maintain: read", lead: &[0x83, 5], fields: Read::FIELDS },
    Table { name: "maintain: restart", lead: &[0x83, 6], fields: &[] },
    Table { name: "maintain: newest", lead: &[0x83, 7], fields: &[] },
    Table { name: "maintain: zero", lead: &[0x83, 8], fields: Zero::FIELDS },
    Table { name: "maintain: test", lead: &[0x83, 9], fields: &[] },
    Table { name: "maintain: item of the test", lead: &[0x83, 10], fields: Tested::FIELDS },
    Table { name: "maintain: program", lead: &[0x83, 11], fields: Program::FIELDS },
    Table { name: "maintain: piece", lead: &[0x83, 12], fields: Piece::FIELDS },
    Table { name: "maintain: commit", lead: &[0x83, 13], fields: Commit::FIELDS },
    Table { name: "maintain: roll back", lead: &[0x83, 14], fields: &[] },
    Table { name: "maintain: echo", lead: &[0x83, 15], fields: Echo::FIELDS },
    Table { name: "maintain: output", lead: &[0x83, 16], fields: OutputSettings::FIELDS },
    Table { name: "inputs", lead: &[0x84], fields: InputValues::FIELDS },
    Table { name: "gnss time", lead: &[0x85], fields: GnssTime::FIELDS },
];
