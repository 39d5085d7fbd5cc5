//! Signals on the wires of the board while a recording is played: resonator edges, ADC codes, the link.

use crate::motion::{adc_filter, Motion};
use crate::twin::{ambient, Twin};
use hrg_core::accelerometers::MPS2_PER_CODE;
use hrg_core::align_mode::Report;
use hrg_core::gnss::TimeMark;
use hrg_core::increments::IncrementFrame;
use hrg_core::inputs::{Channel, InputValues, QuantitySet, IN_MESSAGE};
use hrg_core::link::{Deframer, Housekeeping, InputsUsed, Message};
use hrg_core::output::OutputSettings;
use hrg_core::rate_path::RateFrame;
use hrg_data::log::Decoder;
use hrg_data::recording::steps::Steps;
use hrg_data::recording::thermometer::Thermometer;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::collections::VecDeque;
use std::ops::Range;
use virtual_board::chip_adc::Ambient;
use virtual_board::{AdcMishap, LineFault, World, CPU_HZ, CYCLES_PER_TICK};

/// Fault of a resonator's signal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum AxisFault {
    /// No edges.
    Stop,
    /// Each edge comes a second time, so many seconds later.
    Double(f64),
    /// Jitter of so many seconds RMS on top.
    Jitter(f64),
    /// The frequency runs away, Hz per second.
    Drift(f64),
    /// The frequency is off by so many Hz.
    Jump(f64),
}

/// Fault of the ADC.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AdcFault {
    /// It finishes no conversion.
    Silent,
    /// It converts at half its rate: its settings are lost.
    HalfRate,
    /// It gives the same codes again and again.
    Stuck,
    /// Its frames are invalid on the way.
    Checksum,
    /// A channel is at the end of its scale.
    Saturated(usize),
}

/// Faults on the wires, by time in seconds.
#[derive(Debug, Clone, Default)]
pub struct WireFaults {
    /// Of resonators.
    pub axis: Vec<(usize, AxisFault, Range<f64>)>,
    /// Of the ADC.
    pub adc: Vec<(AdcFault, Range<f64>)>,
    /// Pulses per second: when the first comes, and how far they are apart, s by the unit's own clock.
    pub pulses: Option<(f64, f64)>,
    /// Mishaps of the ADC and its bus, in order of time.
    pub adc_mishaps: Vec<(f64, AdcMishap)>,
    /// Extra edges: an axis, and how long after each 1000th edge they come, s.
    pub glitch: Option<(usize, f64)>,
    /// Every n-th ADC frame is invalid.
    pub invalidate_every: Option<u32>,
    /// Bytes that the other end of the link sends, each with its time.
    pub link_in: Vec<(f64, u8)>,
}

impl WireFaults {
    fn of_axis(&self, axis: usize, t: f64) -> impl Iterator<Item = (AxisFault, f64)> + '_ {
        self.axis.iter().filter(move |(a, _, when)| *a == axis && when.contains(&t)).map(move |f| (f.1, t - f.2.start))
    }

    fn of_adc(&self, t: f64) -> impl Iterator<Item = AdcFault> + '_ {
        self.adc.iter().filter(move |(_, when)| when.contains(&t)).map(|f| f.0)
    }
}

/// Messages that came back.
#[derive(Debug, Default, Clone)]
pub struct Received {
    /// Rate frames.
    pub rates: Vec<RateFrame>,
    /// Time at which the last bit of each rate frame was on the link, cycles.
    pub rate_at: Vec<u64>,
    /// From the data-ready edge of its last sample to that, cycles.
    pub delay_cycles: Vec<u32>,
    /// Increments.
    pub increments: Vec<IncrementFrame>,
    /// Pulses in GNSS time, each with the time at which its message was on the link, cycles.
    pub marks: Vec<(TimeMark, u64)>,
    /// Time at which the last bit of each housekeeping frame was on the link, cycles.
    pub housekeeping_at: Vec<u64>,
    /// Housekeeping.
    pub housekeeping: Vec<Housekeeping>,
    /// Each second of an alignment.
    pub alignment: Vec<Report>,
    /// Inputs that each model step has used.
    pub inputs_used: Vec<InputsUsed>,
    /// Other messages.
    pub other: Vec<Message>,
    /// Frames that could not be read.
    pub bad_frames: usize,
    /// Frames that differ from the digital twin's in any bit.
    pub differing: usize,
    /// Largest difference of a corrected rate from the digital twin's, deg/h.
    pub largest_difference_dph: f32,
    /// The first difference, in words.
    pub first_difference: Option<String>,
    /// Log lines.
    pub log: Vec<String>,
    /// The log as the debug probe reads it.
    pub log_bytes: Vec<u8>,
}

/// The gyros' electronics, which send what they know once a second.
#[derive(Debug, Clone, Default)]
struct Electronics {
    /// Quantities that they send.
    sent: QuantitySet,
    /// The next second to be sent.
    second: usize,
    /// Bytes on their way, each with its time in cycles.
    bytes: VecDeque<(u64, u8)>,
    /// Some of a second's bytes are out.
    in_frame: bool,
}

/// Cycles that a byte takes on the wire: ten bits at 921600 baud.
pub const BYTE_CYCLES: u64 = CPU_HZ * 10 / 921_600;

/// Observers of the wires. A copy of the wires has none: the events before it was made cannot be asked of them again.
#[derive(Default)]
struct Observers {
    /// Compared with; `None` where faults make the unit's own timing matter.
    twin: Option<Twin>,
    decoder: Option<Decoder>,
}

impl Clone for Observers {
    fn clone(&self) -> Self {
        Self::default()
    }
}

/// Code of an input whose wire is open: the current drives it to its end.
const OPEN_WIRE: i32 = 0x7F_FFFF;

/// The code next to a value. The rounding error goes into the next sample: the mean over a second is that of the recording.
fn rounded(wanted: f64, carry: &mut f64) -> i32 {
    let wanted = wanted + *carry;
    let code = wanted.round().clamp(-8_388_608.0, 8_388_607.0);
    *carry = (wanted - code).clamp(-1.0, 1.0);
    code as i32
}

/// The code of a platinum resistor of 1000 ohm at 0 C with 0.5 mA, at a full scale of 1.2 V and 23 bits: its resistance by IEC 60751.
fn platinum_code(t: f64) -> f64 {
    let cold = if t < 0.0 { -4.183e-12 * (t - 100.0) * t.powi(3) } else { 0.0 };
    let ohm = 1000.0 * (1.0 + 3.9083e-3 * t - 5.775e-7 * t * t + cold);
    ohm * 0.5e-3 / 1.2 * f64::from(1 << 23)
}

/// A recording on the wires.
#[derive(Clone)]
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
    accelerations: Option<(f64, Vec<[f64; 3]>)>,
    acceleration_carry: [f64; 3],
    /// A motion from a time on, s, in the place of the recording's rates and accelerations, with the ADC's filter.
    motion: Option<(Motion, f64, Vec<f64>)>,
    /// Settings of what the unit sends, for the delay of its frames.
    output: OutputSettings,
    /// Number of the last sample of the rate frame before.
    frame_before: Option<u32>,
    sensor_carry: [f64; 3],
    frames_out: u32,
    invalid: bool,
    link_at: usize,
    inputs: Electronics,
    /// Inputs at channels 5 to 7 of the ADC.
    aux: Option<[Channel; 3]>,
    mishaps: usize,
    pulses: u32,
    /// Bytes that wait to come in, and when the last one came.
    coming: VecDeque<u8>,
    last_byte: u64,
    /// Bytes that come in before the one whose fault the receiver notices, and that fault.
    line_fault: Option<(usize, LineFault)>,
    /// Bytes that went out, where somebody holds the other end.
    out: Option<Vec<u8>>,
    /// The last codes.
    codes: [i32; 8],
    /// The timer's zero, in ticks since power-on.
    zero_tick: u32,
    /// The time, cycles, as far as the wires have been told.
    now: u64,
    deframer: Deframer,
    observers: Observers,
    /// Messages that came back.
    pub received: Received,
}

impl std::fmt::Debug for Wires {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Wires")
    }
}

impl Wires {
    /// `scale_dph`: deg/h per ADC code; `jitter_s`: RMS jitter of every edge.
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
            acceleration_carry: [0.0; 3],
            motion: None,
            output: OutputSettings::default(),
            frame_before: None,
            sensor_carry: [0.0; 3],
            frames_out: 0,
            invalid: false,
            link_at: 0,
            inputs: Electronics::default(),
            aux: None,
            mishaps: 0,
            pulses: 0,
            coming: VecDeque::new(),
            last_byte: 0,
            line_fault: None,
            out: None,
            codes: [0; 8],
            zero_tick: 0,
            now: 0,
            deframer: Deframer::default(),
            observers: Observers { twin, decoder },
            received: Received::default(),
        }
    }

    /// With somebody at the other end of the link: see [`printed`](Self::printed).
    #[must_use]
    pub fn live(mut self) -> Self {
        self.out = Some(Vec::new());
        self
    }

    /// Bytes come in from now on, as fast as the line carries them.
    pub fn hear(&mut self, bytes: &[u8]) {
        self.coming.extend(bytes);
    }

    /// The same, and of the n-th of them (from 0 on) the receiver notices that it is wrong.
    pub fn hear_badly(&mut self, bytes: &[u8], n: usize, fault: LineFault) {
        self.line_fault = Some((self.coming.len() + n, fault));
        self.hear(bytes);
    }

    /// Stops the sender: bytes that have not come in yet never will.
    pub fn missing_s(&mut self) {
        self.coming.clear();
    }

    /// Bytes that have not come in yet.
    #[must_use]
    pub fn waiting(&self) -> usize {
        self.coming.len()
    }

    /// Bytes that went out on a live link since last asked.
    pub fn printed(&mut self) -> Vec<u8> {
        self.out.as_mut().map(std::mem::take).unwrap_or_default()
    }

    /// All resonators at one frequency, Hz, for ever.
    pub fn set_frequency(&mut self, hz: f64) {
        for f in &mut self.steps.frequency_hz {
            f.fill(hz);
        }
    }

    /// From now on, these faults.
    pub fn set_faults(&mut self, faults: WireFaults) {
        self.faults = faults;
        self.link_at = 0;
        self.mishaps = 0;
        self.pulses = 0;
    }

    /// With faults.
    #[must_use]
    pub fn with_faults(mut self, faults: WireFaults) -> Self {
        self.faults = faults;
        self
    }

    /// With electronics that send the inputs of the recording, in the middle of each second.
    #[must_use]
    pub fn with_inputs(mut self, sent: QuantitySet) -> Self {
        self.inputs.sent = sent;
        self
    }

    /// With the drives of the recording at channels 5 to 7 of the ADC.
    #[must_use]
    pub fn with_aux(mut self, wired: bool) -> Self {
        self.aux = wired.then_some(Channel::DRIVES);
        self
    }

    /// The next byte that the electronics send, and when.
    fn next_input_byte(&mut self) -> Option<(u64, u8)> {
        // (One line: a host goes first, and no frame goes into another.)
        if !self.inputs.in_frame && !self.coming.is_empty() {
            return None;
        }
        while self.inputs.bytes.is_empty() {
            if self.inputs.sent.is_empty() || self.inputs.second >= self.steps.len() {
                return None;
            }
            let row = self.steps.given(self.inputs.second);
            let there: Vec<u8> = self.inputs.sent.numbers().filter(|n| row.get(*n).is_finite()).collect();
            let mut at = (2 * self.inputs.second as u64 + 1) * CPU_HZ / 2;
            for numbers in there.chunks(IN_MESSAGE) {
                let values = InputValues::of(numbers.iter().map(|n| (*n, row.get(*n))));
                for byte in Message::Inputs(values).encode() {
                    self.inputs.bytes.push_back((at, byte));
                    at += BYTE_CYCLES;
                }
            }
            self.inputs.second += 1;
        }
        let (at, byte) = *self.inputs.bytes.front()?;
        // A live board asks again: messages of a host come first.
        let due = self.out.is_none() || self.inputs.in_frame || at < self.now + CPU_HZ / 100;
        due.then(|| (at.max(self.last_byte + BYTE_CYCLES), byte))
    }

    /// With accelerometers: from a time (s) on, increments of velocity (m/s) second by second.
    #[must_use]
    pub fn with_accelerations(mut self, start_s: f64, increments: Vec<[f64; 3]>) -> Self {
        self.accelerations = Some((start_s, increments));
        self
    }

    /// From a time (s) on, the unit moves: rates and specific force are those of the motion.
    pub fn set_motion(&mut self, motion: Motion, from_s: f64) {
        self.motion = Some((motion, from_s, adc_filter()));
    }

    /// Settings of the unit's output: for the delay of its frames.
    pub fn set_output(&mut self, settings: OutputSettings) {
        self.output = settings;
        self.frame_before = None;
    }

    /// Time of a tick of the unit's timer, s since power-on, within 23 s of now.
    #[must_use]
    pub fn seconds_at(&self, tick: u32) -> f64 {
        let now = (self.now / CYCLES_PER_TICK) as u32;
        let ago = now.wrapping_sub(self.zero_tick).wrapping_sub(tick) as i32;
        self.now as f64 / CPU_HZ as f64 - f64::from(ago) * CYCLES_PER_TICK as f64 / CPU_HZ as f64
    }

    /// From the data-ready edge of a frame's last sample to `sent`, ticks: its tick is earlier by the delay of the filters.
    fn delay_ticks(&mut self, frame: &RateFrame, sent: u32) -> u32 {
        let since = self.frame_before.replace(frame.sample).map_or(0, |before| frame.sample.wrapping_sub(before));
        let decimation = if (1..=1000).contains(&since) { since as u16 } else { self.output.decimation };
        let halves = self.output.filter.delay_halves(decimation);
        sent.wrapping_sub(frame.tick).wrapping_sub(halves * ((CPU_HZ / CYCLES_PER_TICK / 2000) as u32))
    }

    fn compare(&mut self, message: &Message) {
        let Some(twin) = &mut self.observers.twin else { return };
        let queue = match message {
            Message::Rate(_) => &mut twin.rates,
            Message::Alignment(_) => &mut twin.alignment,
            Message::InputsUsed(_) => &mut twin.inputs_used,
            Message::Increments(_) => &mut twin.increments,
            Message::TimeMark(_) => &mut twin.marks,
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
        if self.steps.thermometer == Thermometer::Sensors {
            return None;
        }
        if let Some(extra) = self.extra[channel].take() {
            return Some(extra);
        }
        loop {
            let second = self.at[channel] as usize;
            let mut frequency = *self.steps.frequency_hz[channel].get(second)?;
            if !frequency.is_finite() {
                self.at[channel] = second as f64 + 1.0;
                continue;
            }
            let mut off = 0.0;
            for (fault, since) in self.faults.of_axis(channel, self.at[channel]) {
                match fault {
                    AxisFault::Drift(hz_per_s) => off += hz_per_s * since,
                    AxisFault::Jump(hz) => off += hz,
                    _ => {}
                }
            }
            // A resonator does not run backwards.
            frequency = (frequency + off).max(1.0);
            // A period may straddle two seconds of different frequency; the phase goes on smoothly.
            let mut t = self.at[channel] + 1.0 / frequency;
            if t as usize > second {
                if let Some(&next) = self.steps.frequency_hz[channel].get(second + 1).filter(|f| f.is_finite()) {
                    let boundary = (second + 1) as f64;
                    t = boundary + (t - boundary) * frequency / (next + off).max(1.0);
                }
            }
            self.at[channel] = t;
            self.edges[channel] += 1;
            let (mut stop, mut jitter_s, mut double) = (false, self.jitter_s, None);
            for (fault, _) in self.faults.of_axis(channel, t) {
                match fault {
                    AxisFault::Stop => stop = true,
                    AxisFault::Jitter(s) => jitter_s = jitter_s.hypot(s),
                    AxisFault::Double(after) => double = Some(after),
                    AxisFault::Drift(_) | AxisFault::Jump(_) => {}
                }
            }
            if stop {
                continue;
            }
            let jitter: f64 = if jitter_s > 0.0 { StandardNormal.sample(&mut self.rng[channel]) } else { 0.0 };
            let edge = ((t + jitter * jitter_s) * CPU_HZ as f64) as u64;
            if let Some(after) = double {
                self.extra[channel] = Some(edge + (after * CPU_HZ as f64) as u64);
            }
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
        let faults: Vec<AdcFault> = self.faults.of_adc(t).collect();
        let half = faults.contains(&AdcFault::HalfRate) && (cycles / (CPU_HZ / 1000)).is_multiple_of(2);
        if half || faults.contains(&AdcFault::Silent) {
            return None;
        }
        if faults.contains(&AdcFault::Stuck) {
            return Some(self.codes);
        }
        self.invalid = faults.contains(&AdcFault::Checksum);
        let second = (cycles / CPU_HZ) as usize;
        let mut codes = [0i32; 8];
        for k in 0..3 {
            if let Some(rate) = self.steps.rate_dph[k].get(second).filter(|r| r.is_finite()) {
                self.held[k] = *rate;
            }
        }
        let moved = self.motion.as_ref().filter(|(_, from, _)| t >= *from);
        let moved = moved.map(|(motion, _, weights)| motion.sampled(weights, t));
        // The seconds of the rate path end a little after those of the frequencies.
        let pushed = self.accelerations.as_ref().map(|(start, all)| {
            let second = (t - start).floor();
            let now = if second >= 0.0 { all.get(second as usize) } else { None };
            now.copied().unwrap_or_default()
        });
        let rates = moved.map_or(self.held, |(rates, _)| rates);
        for k in 0..3 {
            codes[k] = rounded(rates[k] / f64::from(self.scale_dph[k]), &mut self.carry[k]);
        }
        let forces: &[f64] = match (&moved, &pushed) {
            (Some((_, forces)), _) => forces,
            (None, Some(forces)) => forces,
            (None, None) => &[],
        };
        for (k, a) in forces.iter().enumerate() {
            codes[3 + k] = rounded(a / MPS2_PER_CODE, &mut self.acceleration_carry[k]);
        }
        if self.steps.thermometer == Thermometer::Sensors {
            for (k, code) in codes[5..].iter_mut().enumerate() {
                *code = match self.steps.frequency_hz[k].get(second).filter(|t| t.is_finite()) {
                    Some(t) => rounded(platinum_code(*t), &mut self.sensor_carry[k]),
                    None => OPEN_WIRE,
                };
            }
        }
        for (k, channel) in self.aux.iter().flatten().enumerate() {
            let volts = f64::from(self.steps.given(second).get(channel.quantity));
            let wanted = (volts - channel.at_zero) / channel.per_code;
            codes[5 + k] = if volts.is_finite() { rounded(wanted, &mut self.sensor_carry[k]) } else { OPEN_WIRE };
        }
        for fault in faults {
            if let AdcFault::Saturated(channel) = fault {
                codes[channel] = 0x7F_FFFF;
            }
        }
        self.codes = codes;
        Some(codes)
    }

    fn next_link_byte(&mut self) -> Option<(u64, u8)> {
        let planned = self.faults.link_in.get(self.link_at).map(|(t, byte)| ((t * CPU_HZ as f64) as u64, *byte));
        let input = self.next_input_byte();
        let (at, byte) = match (planned, input) {
            (None, None) => {
                let byte = self.coming.pop_front()?;
                self.last_byte = (self.last_byte + BYTE_CYCLES).max(self.now + BYTE_CYCLES);
                if let Some(twin) = &mut self.observers.twin {
                    twin.link_in(self.last_byte, byte);
                }
                return Some((self.last_byte, byte));
            }
            (Some(planned), input) if input.is_none_or(|input| planned.0 < input.0) => {
                self.link_at += 1;
                planned
            }
            (planned, input) => {
                self.inputs.bytes.pop_front();
                self.inputs.in_frame = !self.inputs.bytes.is_empty();
                self.last_byte = input.or(planned)?.0;
                input.or(planned)?
            }
        };
        if let Some(twin) = &mut self.observers.twin {
            twin.link_in(at, byte);
        }
        Some((at, byte))
    }

    fn line_fault(&mut self, _: u64) -> Option<LineFault> {
        let (before, fault) = self.line_fault.take()?;
        let Some(before) = before.checked_sub(1) else { return Some(fault) };
        self.line_fault = Some((before, fault));
        None
    }

    fn invalidate_adc_frame(&mut self) -> bool {
        self.frames_out += 1;
        self.invalid || self.faults.invalidate_every.is_some_and(|n| self.frames_out.is_multiple_of(n))
    }

    fn next_pulse(&mut self) -> Option<u64> {
        let (first_s, period_s) = self.faults.pulses?;
        let at = first_s + f64::from(self.pulses) * period_s;
        self.pulses += 1;
        Some((at * CPU_HZ as f64) as u64)
    }

    fn pulsed(&mut self, stamp: u32) {
        if let Some(twin) = &mut self.observers.twin {
            twin.pulsed(stamp);
        }
    }

    fn captured(&mut self, channel: usize, stamp: u32) {
        if let Some(twin) = &mut self.observers.twin {
            twin.captured(channel, stamp);
        }
    }

    fn ambient(&mut self, cycles: u64) -> Option<Ambient> {
        // (Only a recording that has them says so; else a test may.)
        let second = (cycles / CPU_HZ) as usize;
        let given = self.steps.given(second);
        let recorded = QuantitySet::CHIP.numbers().any(|number| given.get(number).is_finite());
        recorded.then(|| ambient(&self.steps, second))
    }

    fn adc_mishap(&mut self, cycles: u64) -> Option<AdcMishap> {
        let t = cycles as f64 / CPU_HZ as f64;
        let due = self.faults.adc_mishaps.get(self.mishaps).filter(|(at, _)| *at <= t)?;
        self.mishaps += 1;
        Some(due.1)
    }

    fn fetched(&mut self, stamp: u32, frame: &[u8]) {
        self.zero_tick = ((self.now / CYCLES_PER_TICK) as u32).wrapping_sub(stamp);
        if let Some(twin) = &mut self.observers.twin {
            twin.fetched(stamp, frame);
        }
    }

    fn link_out(&mut self, cycles: u64, bytes: &[u8]) {
        if let Some(out) = &mut self.out {
            out.extend_from_slice(bytes);
        }
        for &b in bytes {
            match self.deframer.push(b) {
                None => {}
                Some(Err(_)) => self.received.bad_frames += 1,
                Some(Ok(message)) => match message {
                    Message::Rate(r) => {
                        self.compare(&message);
                        let sent = ((cycles / CYCLES_PER_TICK) as u32).wrapping_sub(self.zero_tick);
                        let delay = self.delay_ticks(&r, sent);
                        self.received.delay_cycles.push(delay.saturating_mul(CYCLES_PER_TICK as u32));
                        self.received.rate_at.push(cycles);
                        self.received.rates.push(r);
                    }
                    Message::Housekeeping(h) => {
                        self.compare(&message);
                        self.received.housekeeping.push(h);
                        self.received.housekeeping_at.push(cycles);
                    }
                    Message::Alignment(report) => {
                        self.compare(&message);
                        self.received.alignment.push(report);
                    }
                    Message::InputsUsed(used) => {
                        self.compare(&message);
                        self.received.inputs_used.push(used);
                    }
                    Message::Increments(increments) => {
                        self.compare(&message);
                        self.received.increments.push(increments);
                    }
                    Message::TimeMark(mark) => {
                        self.compare(&message);
                        self.received.marks.push((mark, cycles));
                    }
                    other => self.received.other.push(other),
                },
            }
        }
    }

    fn log_out(&mut self, cycles: u64, bytes: &[u8]) {
        self.received.log_bytes.extend_from_slice(bytes);
        if let Some(decoder) = &mut self.observers.decoder {
            for line in decoder.push(bytes) {
                self.received.log.push(format!("{:12.6} {line}", cycles as f64 / CPU_HZ as f64));
            }
        }
    }
}
