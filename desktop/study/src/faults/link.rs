//! Noise, mutilated frames and floods on the link.

use super::{draws, good, run, Extent, Report, Scene};
use anyhow::Result;
use hrg_board::host::cycles;
use hrg_board::wires::{Received, Wires, BYTE_CYCLES};
use hrg_core::align_mode;
use hrg_core::link::{Deframer, Message};
use hrg_core::maintenance::{self, Answer, Command, Reply};
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use virtual_board::{Board, LineFault, CPU_HZ, FLASH_SIZE, FLASH_START};

/// No rate frame leaves later than this after its data-ready edge, ms: its own 0.4 ms on the wire, and the longest other
/// message, which may be under way.
pub const DELAY_MS: f64 = 4.0;

/// The commands of a burn, as frames.
fn burn(scene: &Scene) -> Vec<Vec<u8>> {
    let mut image = scene.calibration.clone();
    image.sequence += 1;
    let bytes = image.to_bytes().map_or_else(Vec::new, |b| b.to_vec());
    maintenance::burn(image.unit, &bytes)
        .chain([Command::Close])
        .map(|c| Message::Maintain(c).encode().to_vec())
        .collect()
}

/// Kind of the bytes that are sent.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Kind {
    Noise,
    NoiseWithZeros,
    Cut,
    Mutated,
    Glued,
    Replayed,
}

const KINDS: [(Kind, &str); 6] = [
    (Kind::Noise, "link: random bytes"),
    (Kind::NoiseWithZeros, "link: random bytes in short frames"),
    (Kind::Cut, "link: frames cut short"),
    (Kind::Mutated, "link: frames with one to eight bits flipped"),
    (Kind::Glued, "link: frames without the zero between them"),
    (Kind::Replayed, "link: frames of a burn replayed out of order"),
];

/// Bytes of a kind, about `n` of them; with the number of valid frames among them.
fn bytes(kind: Kind, frames: &[Vec<u8>], n: u64, draw: &mut ChaCha8Rng) -> (Vec<u8>, u64) {
    let mut out = Vec::with_capacity(n as usize + 300);
    let mut valid = 0;
    while (out.len() as u64) < n {
        let frame = &frames[draw.random_range(0..frames.len())];
        match kind {
            Kind::Noise => out.push(draw.random()),
            Kind::NoiseWithZeros => {
                let length = draw.random_range(1..40);
                out.extend((0..length).map(|_| draw.random_range(1..=255u8)));
                out.push(0);
            }
            Kind::Cut => {
                out.extend(&frame[..draw.random_range(0..frame.len() - 1)]);
                out.push(0);
            }
            Kind::Mutated => {
                let mut frame = frame.clone();
                let end = frame.len() - 1;
                let before = frame.clone();
                for _ in 0..draw.random_range(1..=8) {
                    frame[draw.random_range(0..end)] ^= 1 << draw.random_range(0..8);
                }
                // Bits flipped back, or a zero in the middle that leaves a valid frame behind it: neither is a mutation.
                if frame != before {
                    out.extend(frame);
                }
            }
            Kind::Glued => {
                let other = &frames[draw.random_range(0..frames.len())];
                out.extend(&frame[..frame.len() - 1]);
                out.extend(other);
            }
            Kind::Replayed => {
                // Without Open and Restart: nothing of this may be executed.
                let frame = &frames[draw.random_range(1..frames.len())];
                out.extend(frame);
                valid += 1;
            }
        }
    }
    (out, valid)
}

/// Sends bytes into the running unit at line rate; gives what it sent meanwhile.
fn flood(board: &mut Board<Wires>, bytes: &[u8]) -> Result<(Received, u32)> {
    let start = board.snapshot()?;
    board.world.hear(bytes);
    board.poll_link();
    let end = board.now() + bytes.len() as u64 * BYTE_CYCLES + cycles(0.1);
    let resets = run(board, end)?.n;
    let received = std::mem::take(&mut board.world.received);
    anyhow::ensure!(
        board.world.waiting() < 2,
        "the line is slower than it should be: {} bytes wait",
        board.world.waiting()
    );
    board.restore(&start)?;
    Ok((received, resets))
}

fn longest_ms(r: &Received) -> f64 {
    r.delay_cycles.iter().max().map_or(f64::INFINITY, |d| f64::from(*d) * 1e3 / CPU_HZ as f64)
}

/// Samples between neighbouring frames that are not the five they should be.
fn gaps(r: &Received) -> usize {
    r.rates.windows(2).filter(|w| w[1].sample.wrapping_sub(w[0].sample) != 5).count()
}

/// A command of which one byte is wrong, and the receiver notices; then a whole one, which must be answered.
fn line_faults(
    board: &mut Board<Wires>,
    name: &'static str,
    fault: LineFault,
    seed: u64,
    extent: &Extent,
    report: &mut Report,
) -> Result<()> {
    // As `hrg` sends it: a zero first, for whatever may have come in before.
    let frame = [&[0], &Message::Identify.encode()[..]].concat();
    let start = board.snapshot()?;
    let n = extent.bytes / 2000;
    let (mut answered, mut counted, mut resets, mut gap) = (0, 0, 0, 0);
    for k in 0..n {
        board.restore(&start)?;
        let mut draw = draws(seed, 4, k);
        let mut bad = frame.clone();
        let at = draw.random_range(0..bad.len());
        // If the stop bit is missing, the bits before it are uncertain; noise that is noticed need not have changed one.
        if fault == LineFault::Framing || draw.random() {
            bad[at] ^= 1 << draw.random_range(0..8);
        }
        board.world.hear_badly(&bad, at, fault);
        board.poll_link();
        resets += run(board, board.now() + cycles(0.02))?.n;
        let before = board.world.received.other.len();
        board.world.hear(&frame);
        board.poll_link();
        resets += run(board, board.now() + cycles(1.2))?.n;
        let received = std::mem::take(&mut board.world.received);
        let answers = received.other.iter().skip(before).filter(|m| matches!(m, Message::Identity(_))).count();
        answered += u64::from(answers == 1);
        counted += u64::from(received.housekeeping.last().is_some_and(|h| h.link_errors > 0));
        gap += gaps(&received);
    }
    board.restore(&start)?;
    report.row(
        name,
        n,
        format!(
            "the next command is answered {answered}, the error is counted {counted}; {gap} gaps in the rates, {resets} resets"
        ),
        answered == n && counted == n && gap == 0 && resets == 0,
    );
    Ok(())
}

/// Everything on the link.
///
/// # Errors
/// If the unit cannot be run at all.
pub fn attack(scene: &Scene, seed: u64, extent: &Extent, report: &mut Report) -> Result<()> {
    let frames = burn(scene);
    let mut board = scene.settled()?;
    let mut flash = vec![0; FLASH_SIZE as usize];
    board.read_memory(FLASH_START, &mut flash)?;
    let quiet = scene.undisturbed(&mut board, 3.0)?;
    for (k, (kind, name)) in KINDS.iter().enumerate() {
        let mut draw = draws(seed, 3, k as u64);
        let (bytes, valid) = bytes(*kind, &frames, extent.bytes / KINDS.len() as u64, &mut draw);
        // Commands that the receiver's own code accepts, on the desktop.
        let mut deframer = Deframer::default();
        let accepted = bytes.iter().filter(|b| matches!(deframer.push(**b), Some(Ok(_)))).count() as u64;
        let before = board.flash_operations();
        let (r, resets) = flood(&mut board, &bytes)?;
        let answers = r.other.len();
        let executed = board.flash_operations() - before;
        let delay = longest_ms(&r);
        let refused =
            r.other.iter().filter(|m| !matches!(m, Message::Maintained(Reply::Answer(Answer::NotOpen, _)))).count();
        report.row(
            *name,
            bytes.len() as u64,
            format!(
                "bytes at line rate; accepted as valid {accepted} (valid frames sent: {valid}), commands executed {executed}, replies {answers} (other than \"not open\": {refused}); longest delay of a rate {delay:.2} ms, {} gaps, {resets} resets, {} rates not flagged good",
                gaps(&r),
                r.rates.iter().filter(|f| !good(f)).count()
            ),
            // Glued frames decode as garbage; a mutated one passes a CRC of 32 bits once in four thousand million.
            accepted == valid && executed == 0 && refused == 0 && resets == 0 && gaps(&r) == 0 && delay <= DELAY_MS && r.rates.iter().all(good),
        );
    }
    // Valid commands as fast as they come.
    let begin = align_mode::Command::Begin { latitude_deg: 45.0, gravity_mps2: 9.8, velocity_noise_mps: 0.01 };
    for (name, frame) in [
        ("link: flood of Identify", Message::Identify.encode()),
        ("link: flood of alignment commands", Message::Align(begin).encode()),
        ("link: flood of maintenance commands", Message::Maintain(Command::Read { page: 0, offset: 0 }).encode()),
    ] {
        let n = extent.bytes / 20 / frame.len() as u64;
        let bytes: Vec<u8> = std::iter::repeat_n(&frame[..], n as usize).flatten().copied().collect();
        let (r, resets) = flood(&mut board, &bytes)?;
        let (delay, gaps) = (longest_ms(&r), gaps(&r));
        // A frame cut by an overrun of the receiver's ring is a bad frame, and counted.
        let bad = r.housekeeping.last().map_or(u16::MAX, |h| h.link_errors);
        report.row(
            name,
            bytes.len() as u64,
            format!("bytes at line rate, {n} commands, {} answers, {bad} overruns or bad frames; longest delay of a rate {delay:.2} ms (undisturbed {:.2} ms), {gaps} gaps, {resets} resets", r.other.len(), longest_ms(&quiet)),
            resets == 0 && gaps == 0 && bad == 0 && delay <= DELAY_MS,
        );
    }
    for (name, fault) in [
        ("link: a byte without its stop bit (FE)", LineFault::Framing),
        ("link: noise within a byte (NF)", LineFault::Noise),
    ] {
        line_faults(&mut board, name, fault, seed, extent, report)?;
    }
    let mut after = vec![0; FLASH_SIZE as usize];
    board.read_memory(FLASH_START, &mut after)?;
    report.row("flash after all that", 1, if after == flash { "as it was" } else { "changed" }, after == flash);
    Ok(())
}
