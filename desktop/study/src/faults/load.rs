//! Everything at once.

use super::{run, Extent, Row, Scene};
use anyhow::Result;
use hrg_board::symbol;
use hrg_board::wires::Received;
use hrg_core::link::Message;
use virtual_board::CPU_HZ;

/// Edges of each resonator, Hz: twice what any is built for.
const EDGES_HZ: f64 = 10_000.0;

/// From data-ready to the corrected sample, cycles at most, the time on the wire included: a twentieth of the time between samples.
pub const LATENCY: u64 = CPU_HZ / 1000 / 20;

/// Edges at 10 kHz, a rate frame a sample, commands at line rate, the log read.
///
/// # Errors
/// If the unit cannot be run at all.
pub fn attack(scene: &Scene, extent: &Extent) -> Result<Row> {
    let mut wires = scene.wires();
    wires.set_frequency(EDGES_HZ);
    let mut board = scene.off(wires, &scene.calibration)?;
    let probe = board.count_calls(symbol::SAMPLE)?;
    run(&mut board, CPU_HZ)?;
    board.world.hear(&Message::SetDecimation(1).encode());
    board.poll_link();
    run(&mut board, 3 * CPU_HZ)?;
    board.world.received = Received::default();
    board.forget_calls();
    let instructions = board.instructions();
    let identify = Message::Identify.encode();
    let (mut frames, mut missing, mut errors, mut dropped, mut resets, mut answers) =
        (0u64, 0u64, 0u64, 0u16, 0, 0usize);
    let mut last = None;
    for second in 1..=extent.load_s {
        // A command after the other: the line is never idle.
        while board.world.waiting() < 100_000 {
            board.world.hear(&identify);
        }
        board.poll_link();
        resets += run(&mut board, (3 + second) * CPU_HZ)?.n;
        let r = std::mem::take(&mut board.world.received);
        frames += r.rates.len() as u64;
        answers += r.other.len();
        for f in &r.rates {
            if let Some(before) = last.replace(f.sample) {
                missing += u64::from(f.sample.wrapping_sub(before).wrapping_sub(1));
            }
        }
        errors += r.housekeeping.iter().map(|h| u64::from(h.adc_errors)).sum::<u64>();
        dropped = r.housekeeping.last().map_or(dropped, |h| h.dropped);
    }
    let share = (board.instructions() - instructions) as f64 / (extent.load_s * CPU_HZ) as f64;
    let latency = board.probe(probe).map(|p| p.latency).unwrap_or_default();
    Ok(Row {
        what: "full load: 3 x 10 kHz edges, 1 kHz frames, link flood, log".into(),
        tried: extent.load_s,
        found: format!(
            "seconds; CPU {:.1} %; data-ready to corrected sample: mean {:.0} instructions, worst {:.0} us with the wire; {frames} frames of {} samples, {missing} missing, {errors} ADC errors, {dropped} frames dropped, {answers} answers, {resets} resets",
            100.0 * share,
            latency.instructions as f64 / latency.calls.max(1) as f64,
            latency.most_cycles as f64 * 1e6 / CPU_HZ as f64,
            latency.calls,
        ),
        kept: missing == 0
            && errors == 0
            && dropped == 0
            && resets == 0
            && latency.calls > 0
            && latency.most_cycles <= LATENCY,
    })
}
