//! The unit's own path: ADC frames, time stamps, frequencies and codes as they please.

use hrg_align::linear::Linear;
use hrg_align::session::Session;
use hrg_core::adc::{decode, Fault, WORDS};
use hrg_core::calibration::Calibration;
use hrg_core::compensator::Compensator;
use hrg_core::frequency::{Config, CounterBank, GATES_PER_STEP};
use hrg_core::link::{Identity, Message};
use hrg_core::rate_output::{Corruption, RateOutput, DROPS_IN_A_ROW};
use hrg_core::rate_path::{PendingBias, RateFrame, RatePath, CHANNELS};
use hrg_core::status::UnitStatus;
use hrg_core::telemetry::Telemetry;
use hrg_core::timebase::Timebase;
use hrg_core::unit_name::UnitName;

/// Takes an input; it panics where something promised does not hold.
pub fn run(data: &[u8]) {
    let mut bank = CounterBank::new(Config::REFERENCE, GATES_PER_STEP);
    let mut unit = Compensator::new(Calibration::uncalibrated(), 0.0);
    let timebase = Timebase::REFERENCE;
    let mut output = RateOutput::new(RatePath::new(timebase, [0.01; 3], 2), UnitStatus::empty());
    let identity = Identity { unit: UnitName::UNNAMED, ..Identity::default() };
    let mut telemetry = Telemetry::new(Box::new(Session::<Linear<f32>>::IDLE), timebase, identity, UnitStatus::empty());
    let mut last = None;
    let mut in_a_row = 0u16;
    let mut now = 0u32;
    for chunk in data.chunks_exact(6) {
        let word = u32::from_le_bytes([chunk[2], chunk[3], chunk[4], chunk[5]]);
        match chunk[0] % 4 {
            0 => {
                // A train of edges with a period of its own.
                let axis = usize::from(chunk[1] % 4);
                let stamps: Vec<u32> =
                    (0..u32::from(chunk[1])).map(|k| now.wrapping_add(k.wrapping_mul(word >> 8))).collect();
                bank.push(axis, stamps);
            }
            1 => {
                now = now.wrapping_add(word >> (chunk[1] % 32));
                if let Some(step) = bank.poll(now) {
                    let out = unit.update(&step);
                    assert!(out.bias_dph.iter().all(|b| b.is_finite()));
                    output.set_bias(PendingBias::new(timebase, &step, &out));
                    last = Some((step, out));
                }
            }
            kind => {
                // A sample, a refused frame, or a look at the time; the queue of frames may be full.
                let room = chunk[1] & 1 == 0;
                let mut frames = 0;
                let send = |f: RateFrame| {
                    assert!(f.intact() && f.rate_dph.iter().all(|r| r.is_finite()));
                    frames += 1;
                    room
                };
                let codes: [i32; CHANNELS] = std::array::from_fn(|k| (word.rotate_left(7 * k as u32) as i32) >> 8);
                let done = match (kind, chunk[1] & 6) {
                    (2, _) => output.sample(now, Ok(&codes), send),
                    (_, 0) => output.sample(now, Err(Fault::Crc), send),
                    (_, 2) => {
                        bank.disturb(usize::from(chunk[1] >> 6));
                        output.look(now, send)
                    }
                    _ => output.look(now, send),
                };
                in_a_row = if frames == 0 {
                    in_a_row
                } else if room {
                    0
                } else {
                    in_a_row + 1
                };
                match done {
                    // A queue that takes nothing is the only corruption there can be here; then the unit would start anew.
                    Err(corruption) => {
                        assert_eq!((corruption, in_a_row), (Corruption::Queue, DROPS_IN_A_ROW));
                        return;
                    }
                    Ok(Some(second)) => {
                        if let Some((step, out)) = last.take() {
                            telemetry.set_link_errors(u16::from(chunk[1]));
                            let (h, _) = telemetry.second(&step, &out, Some(&second));
                            assert_eq!(h.dropped, second.dropped);
                            let wire = Message::Housekeeping(h).encode();
                            assert!(Message::decode(&wire[..wire.len() - 1]).is_ok());
                        }
                    }
                    Ok(None) => {}
                }
            }
        }
    }
    if let Some(frame) = data.first_chunk::<{ 4 * WORDS }>() {
        let _ = decode(&std::array::from_fn(|k| u32::from_le_bytes([0, 1, 2, 3].map(|n| frame[4 * k + n]))));
    }
}
