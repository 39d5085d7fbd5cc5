//! Puts the workspace's memory.x where the linker finds it, and the public key of a `signed` build where the program does.

use std::{env, fs, path::Path, path::PathBuf};

fn main() {
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    let root = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").expect("cargo sets it")).join("..");
    fs::copy(root.join("memory.x"), out.join("memory.x")).expect("memory.x lies at the workspace's top level");
    println!("cargo:rustc-link-search={}", out.display());
    println!("cargo:rerun-if-changed=../memory.x");
    // Bytes of stack, a tenth above what the virtual board has seen (`cargo xtask bench`). The test programs need more of it.
    println!("cargo:rustc-link-arg-bin=firmware=--defsym=_stack_size={}", 52 * 1024);
    println!("cargo:rustc-link-arg-tests=--defsym=_stack_size={}", 64 * 1024);
    println!("cargo:rustc-link-arg-tests=-Tembedded-test.x");
    println!("cargo:rerun-if-env-changed=HRG_PUBLIC_KEY");
    if env::var_os("CARGO_FEATURE_SIGNED").is_some() {
        if let Err(why) = public_key(&out.join("public-key.rs")) {
            println!("cargo::error={why}");
        }
    }
}

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
