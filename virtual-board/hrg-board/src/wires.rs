//! What is on the wires of the board while a recording is played: resonator edges, converter codes, the link.

use crate::twin::Twin;
use hrg_cal::log::Decoder;
use hrg_cal::run::Steps;
use hrg_core::alignment::session::{Report, ACCELEROMETER_SCALE};
use hrg_core::link::{Deframer, Housekeeping, Message};
use hrg_core::rate_path::RateFrame;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::collections::VecDeque;
use std::ops::Range;
use virtual_board::{World, CPU_HZ};

/// Faults on the wires, by time in seconds.
#[derive(Debug, Clone, Default)]
pub struct WireFaults {
    /// Resonators that are silent for a while.
    pub silent_axis: Vec<(usize, Range<f64>)>,
    /// Extra edges: an axis, and how long after each 1000th edge they come, s.
    pub glitch: Option<(usize, f64)>,
    /// The converter is silent.
    pub silent_converter: Option<Range<f64>>,
    /// Every n-th converter frame is spoilt.
    pub spoil_every: Option<u32>,
    /// Bytes that the other end of the link sends, each with its time.
    pub link_in: Vec<(f64, u8)>,
}

/// What came back.
#[derive(Debug, Default)]
pub struct Received {
    /// Rate frames.
    pub rates: Vec<RateFrame>,
    /// Housekeeping.
    pub housekeeping: Vec<Housekeeping>,
    /// Each second of an alignment.
    pub alignment: Vec<Report>,
    /// Other messages.
    pub other: Vec<Message>,
    /// Frames that could not be read.
    pub bad_frames: usize,
    /// Frames that differ from the twin's in any bit.
    pub differing: usize,
    /// Largest difference of a corrected rate from the twin's, deg/h.
    pub largest_difference_dph: f32,
    /// The first difference, in words.
    pub first_difference: Option<String>,
    /// Log lines.
    pub log: Vec<String>,
    /// The log as the debug probe reads it.
    pub log_bytes: Vec<u8>,
}

/// See [`Wires::live`].
#[derive(Debug, Default)]
struct Live {
    coming: VecDeque<u8>,
    last: u64,
    out: Vec<u8>,
}

/// Cycles that a byte takes on the wire: ten bits at 921600 baud.
const BYTE_CYCLES: u64 = CPU_HZ * 10 / 921_600;

/// A recording on the wires.
pub struct Wires {
    steps: Steps,
    scale_dph: [f32; 3],
    jitter_s: f64,
    /// Jitter of each channel: what happens on one wire does not change another.
    rng: [ChaCha8Rng; 3],
    /// Next edge of each channel, s, without jitter.
    at: [f64; 3],
    edges: [u64; 3],
    extra: [Option<u64>; 3],
    carry: [f64; 3],
    held: [f64; 3],
    faults: WireFaults,
    /// Time (s) from which, and increments of velocity second by second.
    accelerations: Option<(f64, Vec<[f64; 2]>)>,
    acceleration_carry: [f64; 2],
    frames_out: u32,
    link_at: usize,
    /// A live link: bytes that wait to come in, and when the last one came; bytes that went out.
    live: Option<Live>,
    /// The time, cycles, as far as the wires have been told.
    now: u64,
    deframer: Deframer,
    decoder: Option<Decoder>,
    /// Compared with; `None` where faults make the unit's own timing matter.
    twin: Option<Twin>,
    /// What came back.
    pub received: Received,
}

impl std::fmt::Debug for Wires {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Wires")
    }
}

impl Wires {
    /// `scale_dph`: deg/h per converter code; `jitter_s`: RMS jitter of every edge.
    #[must_use]
    pub fn new(
        steps: Steps,
        scale_dph: [f32; 3],
        jitter_s: f64,
        seed: u64,
        twin: Option<Twin>,
        decoder: Option<Decoder>,
    ) -> Self {
        Self {
            steps,
            scale_dph,
            jitter_s,
            rng: [0, 1, 2].map(|channel| ChaCha8Rng::seed_from_u64(seed.wrapping_mul(3).wrapping_add(channel))),
            // Resonators do not start in step with the clock.
            at: [1e-4, 1.7e-4, 0.6e-4],
            edges: [0; 3],
            extra: [None; 3],
            carry: [0.0; 3],
            held: [0.0; 3],
            faults: WireFaults::default(),
            accelerations: None,
            acceleration_carry: [0.0; 2],
            frames_out: 0,
            link_at: 0,
            live: None,
            now: 0,
            deframer: Deframer::default(),
            decoder,
            twin,
            received: Received::default(),
        }
    }

    /// With a link that somebody holds the other end of: see [`hear`](Self::hear) and [`said`](Self::said).
    #[must_use]
    pub fn live(mut self) -> Self {
        self.live = Some(Live::default());
        self
    }

    /// Bytes come in on a live link from now on, as fast as the line carries them.
    pub fn hear(&mut self, bytes: &[u8]) {
        if let Some(live) = &mut self.live {
            live.coming.extend(bytes);
        }
    }

    /// Bytes that went out on a live link since last asked.
    pub fn said(&mut self) -> Vec<u8> {
        self.live.as_mut().map(|l| std::mem::take(&mut l.out)).unwrap_or_default()
    }

    /// With faults.
    #[must_use]
    pub fn with_faults(mut self, faults: WireFaults) -> Self {
        self.faults = faults;
        self
    }

    /// With accelerometers: from a time (s) on, increments of velocity (m/s) second by second.
    #[must_use]
    pub fn with_accelerations(mut self, start_s: f64, increments: Vec<[f64; 2]>) -> Self {
        self.accelerations = Some((start_s, increments));
        self
    }

    fn compare(&mut self, message: &Message) {
        let Some(twin) = &mut self.twin else { return };
        let queue = match message {
            Message::Rate(_) => &mut twin.rates,
            Message::Alignment(_) => &mut twin.alignment,
            _ => &mut twin.housekeeping,
        };
        let Some(expected) = queue.pop_front() else {
            self.received.differing += 1;
            self.received
                .first_difference
                .get_or_insert_with(|| format!("the unit sent {message:?}, which is not due"));
            return;
        };
        if expected.encode() == message.encode() {
            return;
        }
        self.received.differing += 1;
        self.received
            .first_difference
            .get_or_insert_with(|| format!("the unit sent {message:?}, the desktop has {expected:?}"));
        if let (Message::Rate(a), Message::Rate(b)) = (message, &expected) {
            for (x, y) in a.rate_dph.iter().zip(b.rate_dph) {
                self.received.largest_difference_dph = self.received.largest_difference_dph.max((x - y).abs());
            }
        }
    }
}

impl World for Wires {
    fn next_edge(&mut self, channel: usize) -> Option<u64> {
        if let Some(extra) = self.extra[channel].take() {
            return Some(extra);
        }
        loop {
            let second = self.at[channel] as usize;
            let frequency = *self.steps.frequency_hz[channel].get(second)?;
            if !frequency.is_finite() {
                self.at[channel] = second as f64 + 1.0;
                continue;
            }
            // A period may straddle two seconds of different frequency; the phase goes on smoothly.
            let mut t = self.at[channel] + 1.0 / frequency;
            if t as usize > second {
                if let Some(&next) = self.steps.frequency_hz[channel].get(second + 1).filter(|f| f.is_finite()) {
                    let boundary = (second + 1) as f64;
                    t = boundary + (t - boundary) * frequency / next;
                }
            }
            self.at[channel] = t;
            self.edges[channel] += 1;
            if self.faults.silent_axis.iter().any(|(a, when)| *a == channel && when.contains(&t)) {
                continue;
            }
            let jitter: f64 = if self.jitter_s > 0.0 { StandardNormal.sample(&mut self.rng[channel]) } else { 0.0 };
            let edge = ((t + jitter * self.jitter_s) * CPU_HZ as f64) as u64;
            if let Some((a, after)) = self.faults.glitch {
                if a == channel && self.edges[channel].is_multiple_of(1000) {
                    self.extra[channel] = Some(edge + (after * CPU_HZ as f64) as u64);
                }
            }
            return Some(edge);
        }
    }

    fn convert(&mut self, cycles: u64) -> Option<[i32; 8]> {
        self.now = cycles;
        let t = cycles as f64 / CPU_HZ as f64;
        if self.faults.silent_converter.as_ref().is_some_and(|w| w.contains(&t)) {
            return None;
        }
        let second = (cycles / CPU_HZ) as usize;
        let mut codes = [0i32; 8];
        for (a, code) in codes.iter_mut().take(3).enumerate() {
            if let Some(rate) = self.steps.rate_dph[a].get(second).filter(|r| r.is_finite()) {
                self.held[a] = *rate;
            }
            // What rounding leaves goes into the next sample: the mean over a second is that of the recording.
            let wanted = self.held[a] / f64::from(self.scale_dph[a]) + self.carry[a];
            let rounded = wanted.round().clamp(-8_388_608.0, 8_388_607.0);
            self.carry[a] = (wanted - rounded).clamp(-1.0, 1.0);
            *code = rounded as i32;
        }
        if let Some((start, increments)) = &self.accelerations {
            // The seconds of the rate path end a little after those of the frequencies.
            let second = (t - start).floor();
            let now = if second >= 0.0 { increments.get(second as usize) } else { None };
            for (k, a) in now.copied().unwrap_or_default().iter().enumerate() {
                let wanted = a / ACCELEROMETER_SCALE + self.acceleration_carry[k];
                let rounded = wanted.round().clamp(-8_388_608.0, 8_388_607.0);
                self.acceleration_carry[k] = (wanted - rounded).clamp(-1.0, 1.0);
                codes[3 + k] = rounded as i32;
            }
        }
        Some(codes)
    }

    fn next_link_byte(&mut self) -> Option<(u64, u8)> {
        if let Some(live) = &mut self.live {
            let byte = live.coming.pop_front()?;
            live.last = (live.last + BYTE_CYCLES).max(self.now + BYTE_CYCLES);
            return Some((live.last, byte));
        }
        let (t, byte) = *self.faults.link_in.get(self.link_at)?;
        self.link_at += 1;
        let at = (t * CPU_HZ as f64) as u64;
        if let Some(twin) = &mut self.twin {
            twin.link_in(at, byte);
        }
        Some((at, byte))
    }

    fn spoil_converter_frame(&mut self) -> bool {
        self.frames_out += 1;
        self.faults.spoil_every.is_some_and(|n| self.frames_out.is_multiple_of(n))
    }

    fn captured(&mut self, channel: usize, stamp: u32) {
        if let Some(twin) = &mut self.twin {
            twin.captured(channel, stamp);
        }
    }

    fn fetched(&mut self, stamp: u32, codes: [i32; 8], good: bool) {
        if let Some(twin) = &mut self.twin {
            twin.fetched(stamp, codes, good);
        }
    }

    fn link_out(&mut self, _: u64, bytes: &[u8]) {
        if let Some(live) = &mut self.live {
            live.out.extend_from_slice(bytes);
            return;
        }
        for &b in bytes {
            match self.deframer.push(b) {
                None => {}
                Some(Err(_)) => self.received.bad_frames += 1,
                Some(Ok(message)) => match message {
                    Message::Rate(r) => {
                        self.compare(&message);
                        self.received.rates.push(r);
                    }
                    Message::Housekeeping(h) => {
                        self.compare(&message);
                        self.received.housekeeping.push(h);
                    }
                    Message::Alignment(report) => {
                        self.compare(&message);
                        self.received.alignment.push(report);
                    }
                    other => self.received.other.push(other),
                },
            }
        }
    }

    fn log_out(&mut self, cycles: u64, bytes: &[u8]) {
        self.received.log_bytes.extend_from_slice(bytes);
        if let Some(decoder) = &mut self.decoder {
            for line in decoder.push(bytes) {
                self.received.log.push(format!("{:12.6} {line}", cycles as f64 / CPU_HZ as f64));
            }
        }
    }
}
