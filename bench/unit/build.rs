//! Puts the workspace's memory.x where the linker finds it.

use std::{env, fs, path::PathBuf};

fn main() {
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    let root = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").expect("cargo sets it")).join("../..");
    fs::copy(root.join("memory.x"), out.join("memory.x")).expect("memory.x lies at the workspace's top level");
    println!("cargo:rustc-link-search={}", out.display());
    println!("cargo:rerun-if-changed=../../memory.x");
    println!("cargo:rustc-link-arg-bins=--defsym=_stack_size={}", 24 * 1024);
    // No loader: the vector table is at the start of the flash, where a slot's would be 512 bytes behind the slot's.
    println!("cargo:rustc-link-arg-bins=--defsym=_slot={:#x}", 0x0800_0000 - 512);
}
