//! Set-up of a bare machine: finds what is missing, and installs it.
//!
//! Two things: a standard library for the target, and what the virtual board needs to compile. Both are installed
//! where that is possible; where it is not, the exact commands are printed and the run stops.

use crate::{output, run, Failure};
use std::path::{Path, PathBuf};
use std::process::Command;

/// The target.
pub const TARGET: &str = "thumbv7em-none-eabihf";

/// Toolchain that compiles the firmware.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Toolchain {
    /// rustup's toolchain with the target's library.
    Rustup,
    /// Debian's rustc and its library source, for machines where rustup cannot download. The linker is rustup's.
    Debian {
        /// rust-lld.
        linker: PathBuf,
    },
}

impl Toolchain {
    /// A cargo command for the target: `cargo SUBCOMMAND ... --target ...`.
    pub fn cargo(&self, subcommand: &str) -> Command {
        // Panics name the files they come from: with their places on this machine that is a kilobyte of flash, and an ELF that
        // differs from home to home. The sources must be there first, for on a fresh machine nobody knows where they will be;
        // if they cannot be fetched, the command itself will say why.
        static FETCH: std::sync::Once = std::sync::Once::new();
        FETCH.call_once(|| drop(self.plain_cargo("fetch").arg("--locked").current_dir(crate::root()).status()));
        let mut c = self.plain_cargo(subcommand);
        let home = std::env::var_os("CARGO_HOME")
            .map(PathBuf::from)
            .or_else(|| Some(PathBuf::from(std::env::var_os("HOME")?).join(".cargo")));
        let sources = home.map(|h| h.join("registry/src")).and_then(|d| std::fs::read_dir(d).ok());
        let registries = sources.into_iter().flatten().flatten().map(|index| index.path());
        let flags: Vec<String> = registries
            .chain(crate::root().canonicalize())
            .map(|from| format!("\"--remap-path-prefix={}=\"", from.display()))
            .collect();
        c.args(["--config", &format!("target.{TARGET}.rustflags=[{}]", flags.join(","))]);
        c
    }

    fn plain_cargo(&self, subcommand: &str) -> Command {
        match self {
            Self::Rustup => {
                let mut c = Command::new("cargo");
                c.args([subcommand, "--target", TARGET]);
                c
            }
            Self::Debian { linker } => {
                let mut c = Command::new("/usr/bin/cargo");
                let path = std::env::var("PATH").unwrap_or_default();
                c.args([subcommand, "--target", TARGET, "-Zbuild-std=core"])
                    .env("PATH", format!("/usr/bin:{path}"))
                    .env("RUSTC_BOOTSTRAP", "1")
                    .env("CARGO_TARGET_THUMBV7EM_NONE_EABIHF_LINKER", linker);
                // Variables that rustup's own cargo hands down would send Debian's back to it.
                for name in ["RUSTC", "RUSTUP_TOOLCHAIN", "CARGO", "RUSTC_WRAPPER", "RUSTDOC", "LD_LIBRARY_PATH"] {
                    c.env_remove(name);
                }
                c
            }
        }
    }
}

const DEBIAN_RUST: [&str; 4] = ["rustc-web", "cargo-web", "rust-web-src", "rust-web-clippy"];
const BOARD_PACKAGES: [&str; 4] = ["cmake", "pkg-config", "libclang-dev", "g++"];

fn sysroot() -> Option<PathBuf> {
    output(Command::new("rustc").args(["--print", "sysroot"])).map(|s| PathBuf::from(s.trim()))
}

fn has_target() -> bool {
    sysroot().is_some_and(|s| s.join("lib/rustlib").join(TARGET).join("lib").is_dir())
}

fn debian() -> Option<Toolchain> {
    let installed = DEBIAN_RUST.iter().all(|p| {
        output(Command::new("dpkg-query").args(["-W", "-f", "${Status}", p]))
            .is_some_and(|s| s.ends_with("ok installed"))
    });
    if !installed {
        return None;
    }
    let linker = sysroot()?.join("lib/rustlib/x86_64-unknown-linux-gnu/bin/rust-lld");
    linker.is_file().then_some(Toolchain::Debian { linker })
}

fn is_root() -> bool {
    output(Command::new("id").arg("-u")).is_some_and(|s| s.trim() == "0")
}

fn apt(packages: &[&str], why: &str) -> Result<(), Failure> {
    let commands = format!("apt-get update && apt-get install -y --no-install-recommends {}", packages.join(" "));
    if output(Command::new("apt-get").arg("--version")).is_none() {
        return Err(Failure(format!(
            "{why} needs what Debian calls {}; install them with this system's package manager and run this again",
            packages.join(", ")
        )));
    }
    if !is_root() {
        return Err(Failure(format!("{why} needs packages that only root may install. Run\n\n    sudo sh -c '{commands}'\n\nand then this again")));
    }
    println!("set-up: {why}: installing {}", packages.join(", "));
    run(Command::new("sh")
        .args(["-c", &format!("({commands}) > /tmp/hrg-setup.log 2>&1 || {{ tail -20 /tmp/hrg-setup.log; exit 1; }}")]))
}

/// The toolchain for the target, installed if need be.
pub fn toolchain() -> Result<Toolchain, Failure> {
    if has_target() {
        return Ok(Toolchain::Rustup);
    }
    if let Some(t) = debian() {
        return Ok(t);
    }
    println!("set-up: adding the target {TARGET} to rustup's toolchain");
    let added = Command::new("rustup").args(["target", "add", TARGET]).output().is_ok_and(|o| o.status.success());
    if added && has_target() {
        return Ok(Toolchain::Rustup);
    }
    println!("set-up: rustup cannot download here; taking Debian's rustc, which brings its library source");
    apt(&DEBIAN_RUST, "compiling for the target")?;
    debian()
        .ok_or_else(|| Failure("Debian's rustc is installed but not usable: rustup's rust-lld was not found".into()))
}

fn has_libclang() -> bool {
    if std::env::var_os("LIBCLANG_PATH").is_some() {
        return true;
    }
    let has = |folder: &Path| {
        std::fs::read_dir(folder).is_ok_and(|d| {
            d.flatten().any(|e| {
                let name = e.file_name().to_string_lossy().into_owned();
                name.starts_with("libclang.so") || name.starts_with("libclang-") && name.contains(".so")
            })
        })
    };
    let llvm = std::fs::read_dir("/usr/lib").into_iter().flatten().flatten().map(|e| e.path().join("lib"));
    llvm.chain(["/usr/lib/x86_64-linux-gnu", "/usr/lib64", "/usr/local/lib", "/usr/lib"].map(PathBuf::from))
        .filter(|p| p.is_dir())
        .any(|p| has(&p))
}

/// Installs the browser that looks at the pages.
pub fn browser() -> Result<(), Failure> {
    if output(Command::new("chromium").arg("--version")).is_none() {
        apt(&["chromium"], "looking at the pages in a browser")?;
    }
    Ok(())
}

/// Installs the packages that the virtual board needs to compile, and rustup's own components.
pub fn host() -> Result<(), Failure> {
    let works = |program: &str| output(Command::new(program).arg("--version")).is_some();
    if !(works("cmake") && works("pkg-config") && works("c++") && has_libclang()) {
        apt(&BOARD_PACKAGES, "compiling the virtual board (the CPU emulator Unicorn) and the fuzzer")?;
    }
    for (tool, component) in [("fmt", "rustfmt"), ("clippy", "clippy")] {
        if output(Command::new("cargo").args([tool, "--version"])).is_none() {
            println!("set-up: adding {component} to rustup's toolchain");
            run(Command::new("rustup").args(["component", "add", component]))?;
        }
    }
    Ok(())
}
