//! The thermal chamber: what its operator programs, and what its controller makes of it.
//!
//! The controller is a PI with feed-forward. The heater answers late (dead time and lag), so set points are overshot; a compressor stage
//! switches on and off near a cold set point, by thresholds and by a timer, so the air ripples there.

use crate::draw::Properties;
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use std::collections::VecDeque;

/// Kinds of programs. The numbers within are drawn for each run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Program {
    /// Full ramps both ways with soaks at the ends.
    Cycles,
    /// Steps of 16 to 24 C with short soaks, down, up and down again.
    Stairs,
    /// Slow in one direction and fast in the other, then exchanged, with a turn half way.
    TwoSpeed,
    /// Random set points, ramps of 0.3 to 2.4 C/min and soaks; both ends are visited.
    SetpointWalk,
    /// Loops around the middle that shrink from the full span to a quarter of it.
    ShrinkingLoops,
    /// A slow sweep that turns back every 15 C or so.
    SawSweep,
    /// From cold to hot only, at several ramps.
    HeatingOnly,
    /// From hot to cold only, at several ramps.
    CoolingOnly,
    /// Long soaks joined by ramps, both ways.
    Soaks,
    /// Full ramps, none faster than 0.8 C/min.
    Gentle,
    /// Full ramps between 1.8 and 2.4 C/min, with soaks.
    Brisk,
}

/// One leg of a program.
#[derive(Clone, Copy, Debug)]
pub struct Leg {
    /// Temperature at its end, C.
    pub to_c: f64,
    /// Ramp to it, C/min.
    pub c_per_min: f64,
    /// Soak there, min.
    pub hold_min: f64,
}

/// Temperatures a program stays within.
#[derive(Clone, Copy, Debug)]
pub struct Span {
    /// Coldest set point.
    pub low_c: f64,
    /// Hottest set point.
    pub high_c: f64,
    /// Chamber, and all of the unit, at power-on.
    pub start_c: f64,
}

fn leg(to_c: f64, c_per_min: f64, hold_min: f64) -> Leg {
    Leg { to_c, c_per_min, hold_min }
}

impl Program {
    fn legs(self, rng: &mut ChaCha8Rng, span: Span) -> Vec<Leg> {
        let down_first = rng.random_bool(0.5);
        let ends = if down_first { [span.low_c, span.high_c] } else { [span.high_c, span.low_c] };
        match self {
            Self::Cycles => full_ramps(rng, ends, (0.7, 1.7), (22.0, 32.0)),
            Self::Gentle => full_ramps(rng, ends, (0.55, 0.8), (10.0, 25.0)),
            Self::Brisk => full_ramps(rng, ends, (1.8, 2.4), (22.0, 45.0)),
            Self::Stairs => stairs(rng, span, ends),
            Self::TwoSpeed => two_speed(rng, span, ends),
            Self::SetpointWalk => setpoint_walk(rng, span, ends),
            Self::ShrinkingLoops => shrinking(rng, span, down_first),
            Self::SawSweep => saw(rng, span, ends),
            Self::HeatingOnly => one_way(rng, span.low_c, span.high_c),
            Self::CoolingOnly => one_way(rng, span.high_c, span.low_c),
            Self::Soaks => soaks(rng, span, ends),
        }
    }

    /// The set point at each step of `dt_s` over `seconds`, C.
    #[must_use]
    pub fn set_points(self, rng: &mut ChaCha8Rng, span: Span, dt_s: f64, seconds: f64) -> Vec<f64> {
        // The operator starts the program some minutes after power-on.
        let wait_s = rng.random_range(3.0..15.0) * 60.0;
        set_points(&self.legs(rng, span), wait_s, span.start_c, dt_s, seconds)
    }
}

/// The set point at each step of `dt_s` over `seconds`, C: at `start_c` for `wait_s`, then through the legs, and at the end of the last.
#[must_use]
pub fn set_points(legs: &[Leg], wait_s: f64, start_c: f64, dt_s: f64, seconds: f64) -> Vec<f64> {
    let n = (seconds / dt_s).round() as usize;
    let mut out = Vec::with_capacity(n);
    let mut at = start_c;
    out.resize((wait_s / dt_s) as usize, at);
    for leg in legs {
        let steps = ((leg.to_c - at).abs() / leg.c_per_min * 60.0 / dt_s).ceil().max(1.0) as usize;
        out.extend((1..=steps).map(|k| at + (leg.to_c - at) * k as f64 / steps as f64));
        at = leg.to_c;
        out.resize(out.len() + (leg.hold_min * 60.0 / dt_s) as usize, at);
        if out.len() >= n {
            break;
        }
    }
    out.resize(n, at);
    out
}

/// Soak at an end, min: long enough for the resonators to come near it.
fn end_soak(rng: &mut ChaCha8Rng) -> f64 {
    rng.random_range(22.0..30.0)
}

fn full_ramps(rng: &mut ChaCha8Rng, ends: [f64; 2], ramps: (f64, f64), holds_min: (f64, f64)) -> Vec<Leg> {
    (0..14)
        .map(|k| leg(ends[k % 2], rng.random_range(ramps.0..ramps.1), rng.random_range(holds_min.0..holds_min.1)))
        .collect()
}

fn stairs(rng: &mut ChaCha8Rng, span: Span, ends: [f64; 2]) -> Vec<Leg> {
    let mut at = span.start_c;
    let mut legs = Vec::new();
    for k in 0..5 {
        let end = ends[k % 2];
        while (end - at).abs() > 0.1 {
            let step = rng.random_range(16.0..24.0_f64).min((end - at).abs());
            at += step * (end - at).signum();
            legs.push(leg(at, rng.random_range(1.6..2.4), rng.random_range(12.0..18.0)));
        }
        if let Some(last) = legs.last_mut() {
            last.hold_min = end_soak(rng);
        }
    }
    legs
}

fn two_speed(rng: &mut ChaCha8Rng, span: Span, ends: [f64; 2]) -> Vec<Leg> {
    let middle = rng.random_range(0.35..0.65) * (span.high_c - span.low_c) + span.low_c;
    let (slow, fast) = (rng.random_range(0.6..0.9), rng.random_range(1.5..1.9));
    let plan = [(ends[0], fast), (ends[1], fast), (middle, fast), (ends[1], slow), (ends[0], slow), (ends[1], fast)];
    let again = plan.iter().map(|&(to, ramp)| (to, slow + fast - ramp));
    plan.iter()
        .copied()
        .chain(again)
        .map(|(to, ramp)| {
            let soak = if to == middle { rng.random_range(5.0..15.0) } else { end_soak(rng) };
            leg(to, ramp, soak)
        })
        .collect()
}

fn setpoint_walk(rng: &mut ChaCha8Rng, span: Span, ends: [f64; 2]) -> Vec<Leg> {
    let width = span.high_c - span.low_c;
    let mut at = span.start_c;
    let mut legs = Vec::new();
    for k in 0..40 {
        let end = k == 1 || k == 3;
        let to = match k {
            1 => ends[0],
            3 => ends[1],
            _ => loop {
                let to = rng.random_range(span.low_c..span.high_c);
                if (to - at).abs() > 0.15 * width {
                    break to;
                }
            },
        };
        // An end is reached at a good pace, so that both fit into a run.
        let ramp = 0.3 * 8.0_f64.powf(rng.random_range(0.25..1.0));
        let ramp = if end { ramp.max(1.5) } else { ramp };
        let soak = if end { end_soak(rng) } else { rng.random_range(3.0..22.0) };
        legs.push(leg(to, ramp, soak));
        at = to;
    }
    legs
}

fn shrinking(rng: &mut ChaCha8Rng, span: Span, down_first: bool) -> Vec<Leg> {
    let middle = (span.low_c + span.high_c) / 2.0;
    let half = (span.high_c - span.low_c) / 2.0;
    (0..16)
        .map(|k| {
            let side = if (k % 2 == 0) == down_first { -1.0 } else { 1.0 };
            // The first two legs reach the ends.
            let reach = half * (1.0 - 0.75 * f64::from((k - 1).max(0)) / 8.0).max(0.25);
            let soak = if k < 2 { end_soak(rng) } else { rng.random_range(4.0..12.0) };
            leg(middle + side * reach, rng.random_range(0.8..1.7), soak)
        })
        .collect()
}

fn saw(rng: &mut ChaCha8Rng, span: Span, ends: [f64; 2]) -> Vec<Leg> {
    let mut at = span.start_c;
    let mut legs = Vec::new();
    for k in 0..4 {
        let end = ends[k % 2];
        let way = (end - at).signum();
        while (end - at).abs() > 0.1 {
            let on = rng.random_range(26.0..40.0_f64).min((end - at).abs());
            at += way * on;
            legs.push(leg(at, rng.random_range(1.0..2.2), rng.random_range(2.0..8.0)));
            if (end - at).abs() > 0.1 {
                at -= way * rng.random_range(6.0..12.0_f64).min(on);
                legs.push(leg(at, rng.random_range(0.6..1.6), rng.random_range(2.0..8.0)));
            }
        }
        if let Some(last) = legs.last_mut() {
            last.hold_min = end_soak(rng);
        }
    }
    legs
}

fn one_way(rng: &mut ChaCha8Rng, from: f64, to: f64) -> Vec<Leg> {
    const LEGS: usize = 7;
    (1..=LEGS)
        .map(|k| {
            let at = from + (to - from) * k as f64 / LEGS as f64;
            leg(at, rng.random_range(0.35..1.4), rng.random_range(10.0..35.0))
        })
        .collect()
}

fn soaks(rng: &mut ChaCha8Rng, span: Span, ends: [f64; 2]) -> Vec<Leg> {
    let middle = (span.low_c + span.high_c) / 2.0;
    let levels = [ends[0], middle, ends[1], middle];
    (0..12)
        .map(|k| {
            let near = rng.random_range(-8.0..8.0);
            let to = (levels[k % 4] + near).clamp(span.low_c, span.high_c);
            leg(to, rng.random_range(1.0..1.8), rng.random_range(45.0..60.0))
        })
        .collect()
}

/// Numbers of one chamber; a laboratory has one, so they belong to the unit's case.
#[derive(Clone, Copy, Debug)]
pub struct Chamber {
    dead_time_s: f64,
    heater_lag_s: f64,
    gain_per_s: f64,
    reset_s: f64,
    band_c: f64,
    cycle_s: f64,
    stage_c_per_s: f64,
    room_c: f64,
}

impl Chamber {
    /// A chamber like those of laboratories.
    #[must_use]
    pub fn draw(rng: &mut Properties) -> Self {
        Self {
            dead_time_s: rng.random_range(20.0..45.0),
            heater_lag_s: rng.random_range(15.0..30.0),
            gain_per_s: rng.random_range(0.006..0.010),
            reset_s: rng.random_range(200.0..350.0),
            band_c: rng.random_range(0.10..0.30),
            cycle_s: rng.random_range(90.0..170.0),
            stage_c_per_s: rng.random_range(0.012..0.024),
            room_c: rng.random_range(20.0..24.0),
        }
    }

    /// Air temperature under the program `set_points`, C; air and walls start at its first value.
    #[must_use]
    pub fn air(&self, set_points: &[f64], dt_s: f64) -> Vec<f64> {
        let start = set_points.first().copied().unwrap_or(self.room_c);
        let (mut air, mut wall, mut integral, mut actuator) = (start, start, 0.0, 0.0);
        let delay = (self.dead_time_s / dt_s).round().max(1.0) as usize;
        let mut queue = VecDeque::from(vec![0.0; delay]);
        let (mut stage, mut since_s, mut last) = (false, 1e3, start);
        let mut out = Vec::with_capacity(set_points.len());
        for &set in set_points {
            let forward = (set - last) / dt_s;
            last = set;
            let error = set - air;
            // Near a cold set point the valve is left a little too warm, for the compressor stage to switch against.
            let holding = set < self.room_c + 8.0 && error.abs() < 1.5 && forward == 0.0;
            let bias = if holding { 0.5 * self.stage_c_per_s } else { 0.0 };
            let wanted = self.gain_per_s * error + integral + forward + bias;
            // Heater at most 8 C/min; the valve less, and less still in the cold.
            let possible = wanted.clamp(-0.11 * ((air + 95.0) / 120.0).max(0.1), 0.13);
            // The integral stops where the actuator is at its end.
            if possible == wanted {
                integral += self.gain_per_s / self.reset_s * error * dt_s;
            }
            queue.push_back(possible);
            let arriving = queue.pop_front().unwrap_or(0.0);
            actuator += (arriving - actuator) * dt_s / self.heater_lag_s;
            since_s += dt_s;
            let wish = set < self.room_c + 8.0 && if stage { error < self.band_c } else { error < -self.band_c };
            let timer = holding && since_s > self.cycle_s;
            if timer || (wish != stage && since_s > 60.0) {
                stage = !stage;
                since_s = 0.0;
            }
            let compressor = if stage { -self.stage_c_per_s } else { 0.0 };
            let leak = (self.room_c - wall) / 12_000.0;
            air += dt_s * (actuator + compressor - (air - wall) / 400.0);
            wall += dt_s * ((air - wall) / 700.0 + leak);
            out.push(air);
        }
        out
    }
}
