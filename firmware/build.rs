//! Puts the workspace's memory.x where the linker finds it.

use std::{env, fs, path::PathBuf};

fn main() {
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    let root = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").expect("cargo sets it")).join("..");
    fs::copy(root.join("memory.x"), out.join("memory.x")).expect("memory.x lies at the workspace's top level");
    println!("cargo:rustc-link-search={}", out.display());
    println!("cargo:rerun-if-changed=../memory.x");
    // Bytes of stack, a tenth above what the virtual board has seen (`cargo xtask bench`); the test programs need less of it and more statics.
    for (program, stack) in [("firmware", 40 * 1024), ("bench", 24 * 1024), ("alternatives", 24 * 1024)] {
        println!("cargo:rustc-link-arg-bin={program}=--defsym=_stack_size={stack}");
    }
}
