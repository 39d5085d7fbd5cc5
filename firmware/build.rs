//! Puts the workspace's memory.x where the linker finds it, compiles the loader, and puts the public key of a `signed` build where the program does.

use std::process::Command;
use std::{env, fs, path::Path, path::PathBuf};

/// Bytes of stack, a tenth above what the virtual board has seen (`cargo xtask bench`).
const STACK: u32 = 54 * 1024;
/// The test programs need more of it.
const STACK_OF_TESTS: u32 = 64 * 1024;

fn main() {
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    let root = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").expect("cargo sets it")).join("..");
    fs::copy(root.join("memory.x"), out.join("memory.x")).expect("memory.x lies at the workspace's top level");
    println!("cargo:rustc-link-search={}", out.display());
    println!("cargo:rerun-if-changed=../memory.x");
    fs::copy("slot.x", out.join("slot.x")).expect("slot.x lies beside this file");
    println!("cargo:rerun-if-changed=slot.x");
    println!("cargo:rustc-link-arg-bin=firmware=--defsym=_stack_size={STACK}");
    println!("cargo:rustc-link-arg-tests=--defsym=_stack_size={STACK_OF_TESTS}");
    println!("cargo:rerun-if-env-changed=HRG_SLOT");
    let slot = slot(&out);
    println!("cargo:rustc-link-arg=--defsym=_slot={slot:#x}");
    println!("cargo:rustc-link-arg=-Tslot.x");
    if let Err(why) = loader(&out, slot).and_then(|()| version(&out)) {
        println!("cargo::error={why}");
    }
    println!("cargo:rustc-link-arg-tests=-Tembedded-test.x");
    println!("cargo:rerun-if-env-changed=HRG_PUBLIC_KEY");
    if env::var_os("CARGO_FEATURE_SIGNED").is_some() {
        if let Err(why) = public_key(&out.join("public-key.rs")) {
            println!("cargo::error={why}");
        }
    }
}

/// Address of the slot that the program is linked for: A, or what HRG_SLOT says. Writes its number for the program.
fn slot(out: &Path) -> u32 {
    let number = usize::from(matches!(env::var("HRG_SLOT").as_deref(), Ok("b" | "B")));
    fs::write(out.join("slot.rs"), number.to_string()).expect("OUT_DIR can be written to");
    slots::ADDRESSES[number]
}

/// The version of the package as a number (`hrg_core::update::version_number`).
fn version(out: &Path) -> Result<(), String> {
    let part = |name: &str| env::var(format!("CARGO_PKG_VERSION_{name}")).unwrap_or_default();
    let text = format!("hrg_core::update::version_number({}, {}, {})", part("MAJOR"), part("MINOR"), part("PATCH"));
    fs::write(out.join("version.rs"), text).map_err(|e| e.to_string())
}

/// Compiles the loader to bare bytes, and puts its length and its sum into places 7 and 8 of its vector table.
fn loader(out: &Path, slot: u32) -> Result<(), String> {
    for file in ["loader/main.rs", "loader/loader.x", "../hrg-core/src/slots.rs"] {
        println!("cargo:rerun-if-changed={file}");
    }
    let to = out.join("loader.bin");
    let variable = |name: &str| env::var(name).map_err(|e| format!("{name}: {e}"));
    let mut rustc = Command::new(variable("RUSTC")?);
    rustc.args([
        "--edition",
        "2024",
        "--crate-type",
        "bin",
        "--crate-name",
        "loader",
        "-C",
        "opt-level=s",
        "-C",
        "panic=abort",
    ]);
    rustc.args(["--target", &variable("TARGET")?, "-C", "link-arg=--oformat=binary"]);
    let mut link = |arg: String| {
        rustc.arg("-C").arg(format!("link-arg={arg}"));
    };
    link("-Tloader/loader.x".into());
    link(format!("-L{}", out.display()));
    link(format!("--defsym=_stack_size={STACK}"));
    link(format!("--defsym=_slot={slot:#x}"));
    let done = rustc.arg("-o").arg(&to).arg("loader/main.rs").output().map_err(|e| format!("the loader: {e}"))?;
    if !done.status.success() {
        return Err(format!("the loader: {}", String::from_utf8_lossy(&done.stderr)));
    }
    let mut bytes = fs::read(&to).map_err(|e| e.to_string())?;
    bytes.resize(bytes.len().next_multiple_of(4), 0xFF);
    let length = bytes.len() as u32;
    let mut put = |at: usize, word: u32| -> Result<u32, String> {
        let room = bytes.get_mut(at..at + 4).ok_or("the loader has no vector table")?;
        room.copy_from_slice(&word.to_le_bytes());
        Ok(slots::sum(&bytes))
    };
    let sum = put(slots::LOADER_LENGTH, length)?;
    put(slots::LOADER_SUM, sum)?;
    fs::write(&to, bytes).map_err(|e| e.to_string())
}

#[path = "../hrg-core/src/slots.rs"]
#[allow(dead_code)] // Here it is the sum and the places.
mod slots;

/// Writes the key as an array of bytes.
fn public_key(to: &Path) -> Result<(), String> {
    let what = "the 64 hexadecimal digits that `hrg unit keygen` prints";
    let text = env::var("HRG_PUBLIC_KEY")
        .map_err(|_| format!("the feature signed needs the environment variable HRG_PUBLIC_KEY: {what}"))?;
    let text = text.trim();
    if text.len() != 64 || !text.bytes().all(|b| b.is_ascii_hexdigit()) {
        return Err(format!("HRG_PUBLIC_KEY is \"{text}\", and not {what}"));
    }
    let bytes: Vec<String> = (0..32).map(|k| format!("0x{}", &text[2 * k..2 * k + 2])).collect();
    fs::write(to, format!("[{}]", bytes.join(", "))).map_err(|e| format!("{}: {e}", to.display()))
}
