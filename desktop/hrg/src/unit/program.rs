//! New programs for a unit: the file that holds one, and the way into the unit.
//!
//! # The file
//! A program runs where it lies, so the file holds it twice, linked for each of the two slots, each with its signature. `cargo xtask update` builds both and packs
//! them. All numbers are little-endian.
//!
//! | bytes | content |
//! |---|---|
//! | 8 | `HRGPROG1` |
//! | 4 | length of the program for slot A, from its head on |
//! | 64 | its signature; zeros: it is not signed |
//! | as many | the program, from its head on |
//! | the same for slot B | |

use super::port::Unit;
use anyhow::{Context, Result};
use ed25519_dalek::{Signer, SigningKey};
use hrg_core::bytes::Reader;
use hrg_core::link::Message;
use hrg_core::maintenance::{Answer, Command, Reply};
use hrg_core::signature::SIGNATURE;
use hrg_core::slots::{self, head, Slot, State, ADDRESSES, HEAD, MAGIC, ROOM};
use hrg_core::update::{self, Programs, TRIAL_S};
use hrg_data::error::BadInput;
use object::{Object, ObjectSegment};
use std::path::Path;
use std::time::{Duration, Instant};

/// First bytes of the file.
const FILE: &[u8; 8] = b"HRGPROG1";
/// The programs follow the identity within this.
const FOLLOWS: Duration = Duration::from_millis(500);
/// A unit checks a signature within this, and starts.
const STARTS: Duration = Duration::from_secs(20);

/// A program for one slot.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Linked {
    /// From its head on.
    body: Vec<u8>,
    signature: [u8; SIGNATURE],
}

impl Linked {
    /// The slot as it will be, but for the marks.
    fn slot(&self) -> Vec<u8> {
        [&[0xFF; HEAD][..], &self.body].concat()
    }
}

/// A program, linked for both slots.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ProgramFile([Linked; 2]);

/// A version as text.
#[must_use]
pub fn version_text(version: u32) -> String {
    format!("{}.{}.{}", version / 1_000_000, version / 1000 % 1000, version % 1000)
}

/// A text of a head.
fn text(bytes: &[u8; head::TEXT]) -> String {
    let end = bytes.iter().position(|b| *b == 0).unwrap_or(bytes.len());
    String::from_utf8_lossy(&bytes[..end]).into_owned()
}

/// The program of an ELF, from its head on, that is linked for a slot at this address; `None`: it is not.
#[must_use]
pub fn of_elf(elf: &[u8], slot: u32) -> Option<Vec<u8>> {
    let file = object::File::parse(elf).ok()?;
    let mut bytes = vec![0xFF; ROOM];
    for segment in file.segments() {
        let (offset, size) = segment.file_range();
        let data = elf.get(offset as usize..(offset + size) as usize)?;
        // (Initialised variables lie elsewhere than they run.)
        let physical = physical_address(&file, segment.address(), offset)?;
        let Some(at) = physical.checked_sub(u64::from(slot)).map(|at| at as usize) else { continue };
        if let Some(room) = bytes.get_mut(at..at + data.len()) {
            room.copy_from_slice(data);
        }
    }
    let slot_bytes = Slot(&bytes);
    let fits = slot_bytes.word(head::MAGIC) == MAGIC && slot_bytes.word(head::ADDRESS) == slot;
    slot_bytes.body().filter(|_| fits).map(<[u8]>::to_vec)
}

/// Physical address of the segment that has this address and place in the file.
fn physical_address(file: &object::File<'_>, address: u64, offset: u64) -> Option<u64> {
    let object::File::Elf32(elf) = file else { return None };
    let endian = elf.endian();
    elf.elf_program_headers()
        .iter()
        .find(|h| u64::from(h.p_vaddr.get(endian)) == address && u64::from(h.p_offset.get(endian)) == offset)
        .map(|h| u64::from(h.p_paddr.get(endian)))
}

impl ProgramFile {
    /// Packs the ELFs of a program, linked for slot A and for slot B.
    ///
    /// # Errors
    /// If one of them is none, or they are not the same program.
    pub fn pack(elves: [(&Path, &[u8]); 2], key: Option<&SigningKey>) -> Result<Self, BadInput> {
        let mut linked = Vec::with_capacity(2);
        for (((path, elf), address), name) in elves.into_iter().zip(ADDRESSES).zip(["A", "B"]) {
            let body = of_elf(elf, address).ok_or_else(|| {
                BadInput::new(format!(
                    "{}: no firmware ELF that is linked for slot {name}; cargo xtask update builds both",
                    path.display()
                ))
            })?;
            let signature = key.map_or([0; SIGNATURE], |key| key.sign(&body).to_bytes());
            linked.push(Linked { body, signature });
        }
        let [a, b] = <[Linked; 2]>::try_from(linked).map_err(|_| BadInput::new("two ELFs are wanted"))?;
        let same = |at: usize, n: usize| a.body.get(at - HEAD..at - HEAD + n) == b.body.get(at - HEAD..at - HEAD + n);
        if !same(head::VERSION, 4) || !same(head::BOARD, 2 * head::TEXT) {
            return Err(BadInput::new(
                "the two ELFs have not the same version, board and name: build both from one source",
            ));
        }
        Ok(Self([a, b]))
    }

    /// As it is written to a file.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut out = FILE.to_vec();
        for Linked { body, signature } in &self.0 {
            out.extend_from_slice(&(body.len() as u32).to_le_bytes());
            out.extend_from_slice(signature);
            out.extend_from_slice(body);
        }
        out
    }

    /// Reads a file.
    ///
    /// # Errors
    /// If it is none, or not whole.
    pub fn load(path: &Path) -> Result<Self, BadInput> {
        let no = |why: &str| {
            BadInput::new(format!("{}: {why}; cargo xtask update makes a file for hrg unit update", path.display()))
        };
        let bytes = std::fs::read(path).map_err(|e| no(&e.to_string()))?;
        Self::of_bytes(&bytes).map_err(no)
    }

    /// The same of bytes.
    ///
    /// # Errors
    /// The reason for which they are none.
    pub fn of_bytes(bytes: &[u8]) -> Result<Self, &'static str> {
        let mut rest = bytes.strip_prefix(FILE).ok_or("no program for a unit")?;
        let mut next = |address: u32| -> Result<Linked, &'static str> {
            let cut = "the file is cut short";
            let length = Reader::new(rest).u32().ok_or(cut)? as usize;
            let signature = *rest.get(4..).and_then(|r| r.first_chunk()).ok_or(cut)?;
            let body = rest.get(4 + SIGNATURE..).and_then(|r| r.get(..length)).ok_or(cut)?.to_vec();
            rest = &rest[4 + SIGNATURE + length..];
            let linked = Linked { body, signature };
            let bytes = linked.slot();
            let slot = Slot(&bytes);
            let whole = slot.body().is_some_and(|b| b.len() == length) && slot.word(head::MAGIC) == MAGIC;
            if whole && slot.word(head::ADDRESS) == address {
                Ok(linked)
            } else {
                Err("a program in it is not whole")
            }
        };
        let programs = [next(ADDRESSES[0])?, next(ADDRESSES[1])?];
        if rest.is_empty() {
            Ok(Self(programs))
        } else {
            Err("bytes follow the programs")
        }
    }

    /// Version, board and sums of the two programs, in words.
    #[must_use]
    pub fn describe(&self) -> String {
        let slots = self.0.each_ref().map(Linked::slot);
        let first = Slot(&slots[0]);
        let signed = if self.0.iter().all(|l| l.signature != [0; SIGNATURE]) { "signed" } else { "not signed" };
        format!(
            "program {} for {}, {signed}, {} bytes (sum {:08x} for slot A, {:08x} for B)",
            version_text(first.version()),
            text(&first.text(head::BOARD)),
            self.0[0].body.len(),
            slots::sum(&self.0[0].body),
            slots::sum(&self.0[1].body),
        )
    }
}

/// Name of a slot.
const fn name(slot: u8) -> char {
    if slot == 0 {
        'A'
    } else {
        'B'
    }
}

/// The programs of a unit in words.
#[must_use]
pub fn describe(p: &Programs) -> String {
    let of = |state: u8, version: u32, sum: u32| {
        let state = State::from_number(state).map_or("?", State::name);
        let sum = if sum == u32::MAX { "flashed without its sum".into() } else { format!("sum {sum:08x}") };
        format!("program {} ({sum}), {state}", version_text(version))
    };
    let other = match State::from_number(p.other_state) {
        None | Some(State::Empty) => "no program".into(),
        // It was started, and another one runs.
        Some(State::Tried) => {
            format!("program {} (sum {:08x}), which did not confirm itself", version_text(p.other_version), p.other_sum)
        }
        Some(_) => of(p.other_state, p.other_version, p.other_sum),
    };
    format!(
        "slot {} runs {}; slot {} holds {other}",
        name(p.slot),
        of(p.state, p.version, p.sum),
        name(1 - p.slot.min(1))
    )
}

impl Unit {
    /// Programs of the unit.
    ///
    /// # Errors
    /// If it does not answer, or has firmware that knows no slots.
    pub fn programs(&mut self) -> Result<Programs> {
        self.reconnect(Duration::ZERO)?;
        self.told_programs()?.ok_or_else(|| {
            BadInput::new("its firmware is older than updates over the link: flash it by a probe (docs/update.md)")
                .into()
        })
    }

    /// The message that follows an identity.
    fn told_programs(&mut self) -> Result<Option<Programs>> {
        let until = Instant::now() + FOLLOWS;
        while let Some(left) = until.checked_duration_since(Instant::now()) {
            if let Some(Message::Programs(programs)) = self.next(left).context("the port is gone")? {
                return Ok(Some(programs));
            }
        }
        Ok(None)
    }

    /// Writes a program into the slot that does not run, has the unit start it, and waits until it has confirmed itself. `progress` is told what is done, and the share
    /// of it. An update that was broken off goes on where it was.
    ///
    /// # Errors
    /// If the unit refuses the program, or the program does not confirm itself and the one before comes back.
    pub fn update(&mut self, file: &ProgramFile, mut progress: impl FnMut(&str, f64)) -> Result<Programs> {
        let before = self.programs()?;
        let slot = 1 - usize::from(before.slot.min(1));
        let Linked { body, signature } = &file.0[slot];
        let sum = slots::sum(body);
        if before.sum == slots::sum(&file.0[1 - slot].body) {
            return Err(BadInput::new(format!("the unit runs this program already: {}", describe(&before))).into());
        }
        let identity = self.reconnect(Duration::ZERO)?;
        self.done(Command::Open(identity.unit), "maintenance mode")?;
        // (It may lie there, checked: nothing but the restart was missing.)
        let there = before.other_state == State::New as u8 && before.other_sum == sum;
        let sent = if there { Ok(()) } else { self.send_program(body, sum, signature, &mut progress) };
        if let Err(why) = sent {
            // (A port that is gone closes nothing; the mode ends by itself.)
            let _ = self.done(Command::Close, "maintenance mode");
            return Err(why.context(format!("the unit runs on as before: {}", describe(&before))));
        }
        progress("starting it", 0.0);
        self.restart()?;
        std::thread::sleep(Duration::from_millis(500));
        let begun = Instant::now();
        loop {
            self.reconnect(STARTS)?;
            let now = self.told_programs()?;
            let share = begun.elapsed().as_secs_f64() / f64::from(TRIAL_S);
            match now {
                Some(p) if usize::from(p.slot) == slot && p.state == State::Confirmed as u8 => return Ok(p),
                Some(p) if usize::from(p.slot) == slot => {
                    // Both directions work.
                    self.done(Command::Echo(p.token), "the token")?;
                    progress("its trial", share.min(1.0));
                }
                Some(p) if usize::from(p.slot) != slot => {
                    let why = format!("the new program did not confirm itself, and the one before came back: {}; hrg unit events says how it ended", describe(&p));
                    return Err(BadInput::new(why).into());
                }
                _ if share > 1.5 => {
                    return Err(BadInput::new(
                        "the new program neither confirms itself nor ends; switch the unit off and on",
                    )
                    .into())
                }
                _ => progress("its trial", share.min(1.0)),
            }
            std::thread::sleep(Duration::from_millis(500));
        }
    }

    /// Has the unit start anew. (Where the answer was lost the command comes again to a unit that has done so, and whose maintenance mode is closed.)
    fn restart(&mut self) -> Result<()> {
        match self.maintain(Command::Restart)? {
            Reply::Answer(Answer::Done | Answer::NotOpen, _) => Ok(()),
            other => Err(BadInput::new(format!("the restart: the unit says: {other:?}")).into()),
        }
    }

    /// The program into its slot, until the unit has taken it.
    fn send_program(
        &mut self,
        body: &[u8],
        sum: u32,
        signature: &[u8; SIGNATURE],
        progress: &mut impl FnMut(&str, f64),
    ) -> Result<()> {
        let begin = Command::Program { length: body.len() as u32, sum };
        let mut next = None;
        for sector in 0..=update::SECTORS {
            progress("emptying the slot", sector as f64 / update::SECTORS as f64);
            match self.maintain(begin)? {
                Reply::Answer(Answer::Done, there) => {
                    next = Some(there as usize);
                    break;
                }
                Reply::Answer(Answer::More, _) => {}
                Reply::Answer(answer, _) => return Err(BadInput::new(format!("the unit says: {answer}")).into()),
                other => anyhow::bail!("the unit answered with {other:?}"),
            }
        }
        let mut next =
            next.ok_or_else(|| BadInput::new("the slot does not become empty: its flash may be worn out"))?;
        while let Some(command) = update::piece(body, next as u32) {
            let there = self.done(command, "a piece of the program")? as usize;
            if there <= next {
                anyhow::bail!("the unit counts {there} bytes after {next}");
            }
            next = there;
            progress("sending it", next as f64 / body.len() as f64);
        }
        progress("the unit checks it", 0.0);
        // (Asked once: a second answer would be that of an update that has ended.)
        let answer = self.ask_once(&Message::Maintain(Command::Commit(*signature)), STARTS, |m| match m {
            Message::Maintained(Reply::Answer(answer, _)) => Some(*answer),
            _ => None,
        })?;
        match answer {
            Some(Answer::Done) => Ok(()),
            Some(answer) => Err(BadInput::new(format!("the program is refused; the unit says: {answer}")).into()),
            None => Err(BadInput::new(
                "the unit does not say if it takes the program; ask again what it holds: hrg unit update --port PORT",
            )
            .into()),
        }
    }

    /// Has the unit start the program in its other slot again.
    ///
    /// # Errors
    /// If there is none that has run well.
    pub fn roll_back(&mut self) -> Result<Programs> {
        let identity = self.reconnect(Duration::ZERO)?;
        self.done(Command::Open(identity.unit), "maintenance mode")?;
        let done = self.done(Command::RollBack, "going back");
        if done.is_err() {
            self.done(Command::Close, "maintenance mode")?;
        }
        done?;
        self.restart()?;
        std::thread::sleep(Duration::from_millis(500));
        self.reconnect(STARTS)?;
        self.told_programs()?.ok_or_else(|| BadInput::new("the unit does not say which program it runs").into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn linked(slot: usize) -> Linked {
        let mut body = vec![7; 1000];
        let mut put = |at: usize, word: u32| body[at - HEAD..at - HEAD + 4].copy_from_slice(&word.to_le_bytes());
        put(head::MAGIC, MAGIC);
        put(head::LENGTH, 1000);
        put(head::ADDRESS, ADDRESSES[slot]);
        put(head::VERSION, 1_002_003);
        Linked { body, signature: [slot as u8; SIGNATURE] }
    }

    #[test]
    fn a_file_comes_back_and_one_that_is_not_whole_is_refused() {
        let file = ProgramFile([linked(0), linked(1)]);
        let bytes = file.to_bytes();
        assert_eq!(ProgramFile::of_bytes(&bytes), Ok(file.clone()));
        assert!(file.describe().contains("program 1.2.3"), "{}", file.describe());
        for n in [0, 7, 8, 20, 500, bytes.len() - 1] {
            assert!(ProgramFile::of_bytes(&bytes[..n]).is_err(), "{n} bytes");
        }
        assert!(ProgramFile::of_bytes(&[bytes.clone(), vec![0]].concat()).is_err());
        assert!(ProgramFile::of_bytes(&ProgramFile([linked(1), linked(0)]).to_bytes()).is_err(), "swapped");
        assert!(ProgramFile::pack([(Path::new("a"), b"no"), (Path::new("b"), b"no")], None).is_err());
    }
}
