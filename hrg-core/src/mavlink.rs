//! HIGHRES_IMU and HEARTBEAT of MAVLink 2: what autopilots and their tools read without code of ours.
//!
//! Of the framings that navigators know, MAVLink is the one whose definition, parsers and simulators are free (VectorNav's and MIP's are a maker's own, and
//! their parsers belong to their units). HIGHRES_IMU (message 105) holds rates and specific force in singles and a time in us. Source: the common
//! message set, <https://mavlink.io/en/messages/common.html>, and the packet's layout, <https://mavlink.io/en/guide/serialization.html>.
//!
//! Each message of increments becomes one HIGHRES_IMU: their means over the interval, at the time of its middle. Where no increments are sent, each rate
//! frame becomes one without accelerations.
//!
//! # Example
//! ```
//! use hrg_core::mavlink::{Encoder, Imu};
//!
//! let mut encoder = Encoder::default();
//! let imu = Imu { time_us: 5_000, rate_rads: [1e-3, 0.0, 0.0], force_mps2: Some([0.0, 0.0, -9.8]), temperature_c: Some(21.5) };
//! let packet = encoder.imu(&imu);
//! assert_eq!((packet[0], packet[1], &packet[7..10]), (0xFD, 62, &[105, 0, 0][..]));
//! ```

use crate::gnss::TimeMark;
use crate::increments::IncrementFrame;
use crate::rate_path::RateFrame;
use crate::timebase::Timebase;
use crate::AXES;
use heapless::Vec;

/// First byte of a packet.
const START: u8 = 0xFD;
/// System and component: the first, and the first inertial unit of it.
const SYSTEM: u8 = 1;
const COMPONENT: u8 = 200;
/// Longest packet here.
pub const LONGEST: usize = 12 + 62;

/// CRC-16/MCRF4XX.
static CRC: crc::Crc<u16> = crc::Crc::<u16>::new(&crc::CRC_16_MCRF4XX);

/// A number and the checksum's seed of a message (of its definition).
const HEARTBEAT: (u32, u8) = (0, 50);
const HIGHRES_IMU: (u32, u8) = (105, 93);

/// Rates, specific force and temperature at a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Imu {
    /// Time, us: since 1970 where GNSS time is known, else since the start.
    pub time_us: u64,
    /// Corrected rates, rad/s.
    pub rate_rads: [f32; AXES],
    /// Specific force, m/s^2; `None`: not sent.
    pub force_mps2: Option<[f32; AXES]>,
    /// Temperature of the first gyro, C; `None`: not sent.
    pub temperature_c: Option<f32>,
}

/// Writes packets.
#[derive(Debug, Clone, Default)]
pub struct Encoder {
    sequence: u8,
    /// The time since the start, us, at a tick.
    us: u64,
    tick: Option<u32>,
}

impl Encoder {
    /// Time of a tick, us: by the mark where its UTC is known, else since the start. `correction`: relative error of the timer.
    pub fn time_us(&mut self, tick: u32, timebase: Timebase, mark: Option<&TimeMark>, correction: f64) -> u64 {
        let per_us = (timebase.ticks_per_s() / 1_000_000).max(1);
        let ahead = tick.wrapping_sub(self.tick.unwrap_or(tick));
        // (The remainder stays, so that nothing is lost over hours.)
        if (ahead as i32) > 0 || self.tick.is_none() {
            self.us += u64::from(ahead / per_us);
            self.tick = Some(tick.wrapping_sub(ahead % per_us));
        }
        match mark.and_then(|mark| Some((mark, mark.unix_us()?))) {
            Some((mark, at)) => at.saturating_add_signed((1e6 * mark.seconds_to(tick, timebase, correction)) as i64),
            None => self.us,
        }
    }

    fn packet(&mut self, (number, seed): (u32, u8), payload: &[u8]) -> Vec<u8, LONGEST> {
        // Zeros at the end of a payload are left out, but for its first byte.
        let length = payload.iter().rposition(|b| *b != 0).map_or(1, |last| last + 1);
        let [a, b, c, _] = number.to_le_bytes();
        let mut out = Vec::new();
        let _ = out.extend_from_slice(&[START, length as u8, 0, 0, self.sequence, SYSTEM, COMPONENT, a, b, c]);
        let _ = out.extend_from_slice(payload.get(..length).unwrap_or_default());
        let mut digest = CRC.digest();
        digest.update(out.get(1..).unwrap_or_default());
        digest.update(&[seed]);
        let _ = out.extend_from_slice(&digest.finalize().to_le_bytes());
        self.sequence = self.sequence.wrapping_add(1);
        out
    }

    /// A HEARTBEAT: once a second.
    pub fn heartbeat(&mut self, good: bool) -> Vec<u8, LONGEST> {
        // Type generic, no autopilot; active, or critical; version 3.
        self.packet(HEARTBEAT, &[0, 0, 0, 0, 0, 8, 0, if good { 4 } else { 5 }, 3])
    }

    /// A HIGHRES_IMU.
    pub fn imu(&mut self, imu: &Imu) -> Vec<u8, LONGEST> {
        const ACCELERATIONS: u16 = 0b111;
        const RATES: u16 = 0b11_1000;
        const TEMPERATURE: u16 = 1 << 12;
        let mut fields = RATES;
        let mut payload: Vec<u8, 62> = Vec::new();
        let mut put = |bytes: &[u8]| drop(payload.extend_from_slice(bytes));
        put(&imu.time_us.to_le_bytes());
        for value in imu.force_mps2.unwrap_or([0.0; AXES]).into_iter().chain(imu.rate_rads).chain([0.0; 6]) {
            put(&value.to_le_bytes());
        }
        put(&imu.temperature_c.unwrap_or(0.0).to_le_bytes());
        fields |= if imu.force_mps2.is_some() { ACCELERATIONS } else { 0 };
        fields |= if imu.temperature_c.is_some() { TEMPERATURE } else { 0 };
        put(&fields.to_le_bytes());
        self.packet(HIGHRES_IMU, &payload)
    }
}

/// Rates of a frame, rad/s.
#[must_use]
pub fn of_rates(frame: &RateFrame) -> [f32; AXES] {
    const RAD_S: f32 = (core::f64::consts::PI / 180.0 / 3600.0) as f32;
    frame.rate_dph.map(|r| r * RAD_S)
}

/// Means over the interval of a message of increments, rates in rad/s and specific force in m/s^2 (`None` without three accelerometers), and the tick of its
/// middle.
#[must_use]
pub fn of_increments(frame: &IncrementFrame, timebase: Timebase) -> (u32, [f32; AXES], Option<[f32; AXES]>) {
    let per_s = timebase.ticks_per_s() as f32 / frame.ticks.max(1) as f32;
    let force = frame.velocity_mps.map(|v| v * per_s);
    let whole = force.iter().all(|f| f.is_finite());
    (frame.tick.wrapping_sub(frame.ticks / 2), frame.angle_rad.map(|a| a * per_s), whole.then_some(force))
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;

    #[test]
    fn packets_are_those_that_pymavlink_writes() {
        // pymavlink 2.4.50, dialect common, source 1 and 200: heartbeat(0, 8, 0, 0, 4, 3), then highres_imu of these values, fields 0x103F.
        const HEARTBEAT: &str = "fd0900000001c8000000000000000008000403c8cc";
        const IMU: &str = "fd3e00000101c869000088130000000000000000000000000000cdcc1cc16f12833a";
        let hex = |packet: &[u8]| packet.iter().map(|b| std::format!("{b:02x}")).collect::<std::string::String>();
        let mut encoder = Encoder::default();
        assert_eq!(hex(&encoder.heartbeat(true)), HEARTBEAT);
        let imu = Imu {
            time_us: 5000,
            rate_rads: [1e-3, 0.0, 0.0],
            force_mps2: Some([0.0, 0.0, -9.8]),
            temperature_c: Some(21.5),
        };
        let packet = hex(&encoder.imu(&imu));
        assert!(packet.starts_with(IMU) && packet.ends_with("0000ac413f1020c6"), "{packet}");
        assert_eq!(packet.len(), 2 * (12 + 62));
    }

    #[test]
    fn time_goes_on_over_the_wrap_and_is_that_of_the_mark_where_it_is_known() {
        let mut e = Encoder::default();
        let mut at = 4_294_000_000u32;
        for k in 0..2000u64 {
            assert_eq!(e.time_us(at, Timebase::REFERENCE, None, 0.0), 5000 * k);
            at = at.wrapping_add(450_000);
        }
        let mark = TimeMark { tick: at, week: 2394, second: 10, std_ns: 20, leap_s: 18, quality: 3 };
        let us = e.time_us(at.wrapping_sub(45), Timebase::REFERENCE, Some(&mark), 0.0);
        assert_eq!(Some(us), mark.unix_us());
        let us = e.time_us(at.wrapping_sub(90_000), Timebase::REFERENCE, Some(&mark), 0.0);
        assert_eq!(Some(us), mark.unix_us().map(|at| at - 1000));
    }

    #[test]
    fn means_of_increments_are_rates_and_forces() {
        let f = IncrementFrame {
            ticks: 450_000,
            tick: 100_000,
            angle_rad: [5e-3, 0.0, 0.0],
            velocity_mps: [0.0, 0.05, 0.0],
            ..IncrementFrame::default()
        };
        let (tick, rate, force) = of_increments(&f, Timebase::REFERENCE);
        assert_eq!(tick, 100_000u32.wrapping_sub(225_000));
        assert!((rate[0] - 1.0).abs() < 1e-6 && (force.expect("whole")[1] - 10.0).abs() < 1e-5);
        let two = IncrementFrame { velocity_mps: [0.0, 0.0, f32::NAN], ..f };
        assert_eq!(of_increments(&two, Timebase::REFERENCE).2, None);
    }
}
