//! No panic in what we wrote: every call of a panicking function in the release ELF is traced to the source line that it comes
//! from. Those of embassy and its kin (HAL start-up, DMA rings, executor) are counted by crate; all end in the firmware's panic
//! handler, which lets the watchdog reset the unit.

use addr2line::{gimli, Context};
use hrg_board::replay;
use object::{Object, ObjectSection, ObjectSymbol, SymbolKind};
use std::collections::BTreeMap;

/// `true` if a function of this name begins a panic.
fn panics(name: &str) -> bool {
    [
        "core::panicking::",
        "core::option::unwrap_failed",
        "core::option::expect_failed",
        "core::result::unwrap_failed",
        "core::slice::index::slice_",
        "core::slice::copy_from_slice_impl::len_mismatch_fail",
        "core::str::slice_error_fail",
        "core::cell::panic_",
        "_defmt_panic",
        "__defmt_default_panic",
    ]
    .iter()
    .any(|p| name.starts_with(p))
}

/// Target of a BL or B.W at `at`.
fn target(code: &[u8], at: usize, address: u32) -> Option<u32> {
    let half = |k: usize| code.get(at + k..at + k + 2).map(|b| u32::from(u16::from_le_bytes([b[0], b[1]])));
    let (a, b) = (half(0)?, half(2)?);
    if a & 0xF800 != 0xF000 || b & 0x9000 != 0x9000 {
        return None;
    }
    let s = a >> 10 & 1;
    let (i1, i2) = (!((b >> 13 & 1) ^ s) & 1, !((b >> 11 & 1) ^ s) & 1);
    let offset = s << 24 | i1 << 23 | i2 << 22 | (a & 0x3FF) << 12 | (b & 0x7FF) << 1;
    // Sign-extended from 25 bits.
    let offset = ((offset << 7) as i32) >> 7;
    Some((address + 4).wrapping_add_signed(offset))
}

/// The source file in the `core::panic::Location` that a panicking call is given: MOVW and MOVT of one register shortly before it. Of calls that the
/// compiler has merged, the debug information knows no line; this is where the message would send its reader.
fn location(memory: &[u8], base: u32, call: u32) -> Option<String> {
    let half = |a: u32| {
        memory.get((a - base) as usize..).and_then(|m| Some(u32::from(u16::from_le_bytes([m[0], *m.get(1)?]))))
    };
    let word = |a: u32| Some(half(a.checked_sub(base).map(|_| a)?)? | half(a + 2)? << 16);
    // Register and value of a MOVW (0xF240) or MOVT (0xF2C0).
    let moved = |a: u32, kind: u32| {
        let (i, j) = (half(a)?, half(a + 2)?);
        let value = (i & 0xF) << 12 | (i >> 10 & 1) << 11 | (j >> 12 & 7) << 8 | j & 0xFF;
        (i & 0xFBF0 == kind).then_some((j >> 8 & 0xF, value))
    };
    (call - 24..call).step_by(2).find_map(|low_at| {
        let (register, low) = moved(low_at, 0xF240)?;
        let high = (low_at..call).step_by(2).find_map(|a| moved(a, 0xF2C0).filter(|(r, _)| *r == register))?.1;
        let at = high << 16 | low;
        let (name, length) = (word(at)?, word(at + 4)? as usize);
        let bytes = memory.get(name.checked_sub(base)? as usize..)?.get(..length)?;
        std::str::from_utf8(bytes).ok().filter(|n| n.ends_with(".rs")).map(String::from)
    })
}

/// The crate or folder that a source file belongs to. (`cargo xtask build` maps the registry's folder and ours to the root.)
fn owner(file: &str) -> String {
    if file.starts_with("/rustc/") || file.contains("/library/") || file.starts_with("core/") {
        return "core".into();
    }
    file.trim_start_matches('/').split('/').next().unwrap_or("?").to_string()
}

/// First address of the flash.
const FLASH: u32 = 0x0800_0000;

#[test]
fn no_panic_comes_from_our_own_code() {
    let elf = replay::read_elf(&replay::default_elf()).expect("cargo xtask test builds the firmware first");
    let file = object::File::parse(&elf[..]).expect("an ELF");
    let section = |id: gimli::SectionId| -> Result<_, gimli::Error> {
        let data = file.section_by_name(id.name()).and_then(|s| s.data().ok()).unwrap_or(&[]);
        Ok(gimli::EndianSlice::new(data, gimli::LittleEndian))
    };
    let context =
        Context::from_dwarf(gimli::Dwarf::load(section).expect("debug information")).expect("of a known kind");
    let text = file.section_by_name(".text").expect("code");
    let (code, base) = (text.data().expect("bytes"), text.address() as u32);
    let mut flash = Vec::new();
    for s in file.sections().filter(|s| (FLASH..FLASH + 0x8_0000).contains(&(s.address() as u32)) && s.size() > 0) {
        let at = (s.address() as u32 - FLASH) as usize;
        let bytes = s.data().expect("bytes");
        flash.resize(flash.len().max(at + bytes.len()), 0xFF);
        flash[at..at + bytes.len()].copy_from_slice(bytes);
    }
    let name = |s: &object::Symbol<'_, '_>| format!("{:#}", rustc_demangle::demangle(s.name().unwrap_or("")));
    let functions: BTreeMap<u32, (u32, String)> = file
        .symbols()
        .filter(|s| s.kind() == SymbolKind::Text && s.size() > 0)
        .map(|s| (s.address() as u32 & !1, (s.size() as u32, name(&s))))
        .collect();
    // Literal pools lie between the code; mapping symbols say where.
    let mut marks: BTreeMap<u32, bool> = BTreeMap::new();
    for s in file.symbols() {
        match s.name().unwrap_or("") {
            n if n.starts_with("$t") => drop(marks.insert(s.address() as u32, true)),
            n if n.starts_with("$d") => drop(marks.insert(s.address() as u32, false)),
            _ => {}
        }
    }
    let is_code = |a: u32| marks.range(..=a).next_back().is_none_or(|(_, t)| *t);
    let (mut theirs, mut ours, mut calls) = (BTreeMap::<String, u32>::new(), Vec::new(), 0);
    for (&start, (size, function)) in functions.iter().filter(|(_, (_, f))| !panics(f)) {
        let mut at = start;
        while at + 2 <= start + size {
            let k = (at - base) as usize;
            let long = code.get(k + 1).is_some_and(|b| *b >= 0xE8);
            let to = if long && is_code(at) { target(code, k, at) } else { None };
            if let Some((_, callee)) = to.and_then(|t| functions.get(&t)).filter(|(_, c)| panics(c)) {
                calls += 1;
                let mut frames = context.find_frames(u64::from(at)).skip_all_loads().expect("frames");
                let mut from = None;
                while let Ok(Some(frame)) = frames.next() {
                    let Some(at) = frame.location else { continue };
                    let source = at.file.unwrap_or("?");
                    // A line 0 is the compiler's own: an async function polled after its end. Some have the line of the last wait.
                    let line = at.line.unwrap_or(0);
                    if owner(source) != "core" {
                        from = Some((owner(source), format!("{source}:{line}"), line));
                        break;
                    }
                }
                // The start of the main task, which embassy's macro writes.
                if function.starts_with("embassy_executor::") && !function.contains("TaskStorage") {
                    from = Some(("embassy-executor".into(), String::new(), 0));
                }
                // Cell in which a channel of embassy keeps its state; we have none of our own.
                if function.starts_with("core::cell::RefCell") {
                    from = Some(("embassy-sync".into(), String::new(), 0));
                }
                if from.as_ref().is_none_or(|f| f.2 == 0) {
                    if let Some(source) = location(&flash, FLASH, at).filter(|s| owner(s) != "core") {
                        from = Some((owner(&source), source, 0));
                    }
                }
                let (who, place, line) = from.unwrap_or_else(|| ("?".into(), function.clone(), 1));
                let after_end = line == 0 || callee.contains("async_fn_resumed");
                let of_async = function.contains("TaskStorage") || function.ends_with("{{closure}}");
                let resumed = who == "firmware" && after_end && of_async;
                if ["hrg-core", "firmware", "?"].contains(&who.as_str()) && !resumed {
                    ours.push(format!("{place}: {callee} (in {function})"));
                }
                *theirs.entry(who).or_default() += 1;
            }
            at += if long { 4 } else { 2 };
        }
    }
    println!("{calls} calls of panicking functions: {theirs:?}");
    assert!(calls > 20, "the search itself is broken: embassy has some");
    assert!(ours.is_empty(), "panics from our own code:\n{}", ours.join("\n"));
}
