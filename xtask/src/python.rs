//! The Python package: its wheel, and its tests in a virtual environment of their own.

use crate::{output, root, run, Failure};
use std::path::PathBuf;
use std::process::Command;

/// Packages that the tests need beside the wheel. (maturin builds it.)
const NEEDED: [&str; 15] = [
    "maturin>=1.9,<2",
    "numpy>=1.21",
    "pandas>=1.5",
    "polars",
    "pyarrow>=14",
    "distributed>=2023.1",
    "matplotlib>=3.5",
    "pytest>=7",
    "nbformat>=5",
    "nbclient>=0.8",
    "ipykernel>=6",
    "h5py>=3",
    "scipy",
    "pymavlink>=2.4",
    "mcap-ros2-support>=0.5",
];

fn environment() -> PathBuf {
    // (Programs in it name their own place.)
    root().canonicalize().unwrap_or_else(|_| root()).join("target/python")
}

fn python() -> Command {
    Command::new(environment().join("bin/python"))
}

/// Makes the virtual environment; gives in a line why there is none.
pub fn prepare() -> Result<(), String> {
    let done = environment().join("installed");
    if std::fs::read_to_string(&done).is_ok_and(|had| had == NEEDED.join("\n")) {
        return Ok(());
    }
    if output(Command::new("python3").args(["-c", "import venv, ensurepip"])).is_none() {
        return Err("skipped: the tests of the Python package, as there is no python3 with venv (Debian: apt install python3-venv)".into());
    }
    let _ = std::fs::remove_dir_all(environment());
    let made = run(Command::new("python3").args(["-m", "venv"]).arg(environment()));
    let made = made.and_then(|()| run(python().args(["-m", "pip", "install", "--quiet"]).args(NEEDED)));
    made.map_err(|e| {
        format!("skipped: the tests of the Python package, as pip could not install what they need: {}", e.0)
    })?;
    std::fs::write(&done, NEEDED.join("\n")).map_err(|e| format!("skipped: {e}"))
}

/// Builds the wheel into `target/wheels`, for every Python from 3.9 on; gives its path.
pub fn wheel() -> Result<PathBuf, Failure> {
    prepare().map_err(Failure)?;
    let to = root().join("target/wheels");
    let _ = std::fs::remove_dir_all(&to);
    run(python()
        .args([
            "-m",
            "maturin",
            "build",
            "--quiet",
            "--release",
            "--locked",
            "--manifest-path",
            "python/Cargo.toml",
            "--out",
        ])
        .arg(&to)
        .current_dir(root()))?;
    let files = std::fs::read_dir(&to).map_err(|e| Failure(format!("cannot read {}: {e}", to.display())))?;
    let wheel = files.flatten().map(|f| f.path()).find(|p| p.extension().is_some_and(|e| e == "whl"));
    wheel.ok_or_else(|| Failure(format!("maturin has left no wheel in {}", to.display())))
}

/// Builds the wheel and installs it.
pub fn install() -> Result<(), Failure> {
    let wheel = wheel()?;
    run(python().args(["-m", "pip", "install", "--quiet", "--no-deps", "--force-reinstall"]).arg(wheel))
}

/// Runs the tests of the wheel that is installed.
pub fn tests() -> Result<(), Failure> {
    // (Not in the sources' folder: what is tested is what is installed.)
    let answer = python()
        .args(["-m", "pytest", "-q", "-rs", "-p", "no:cacheprovider", "--rootdir"])
        .args([root().join("python"), root().join("python/tests")])
        .current_dir(environment())
        .output()
        .map_err(|e| Failure(format!("{} -m pytest: {e}; run cargo xtask test", environment().display())))?;
    let text = String::from_utf8_lossy(&answer.stdout);
    println!("{text}{}", String::from_utf8_lossy(&answer.stderr));
    let summary = text.lines().last().unwrap_or("");
    let count = |word: &str| -> u64 {
        summary
            .split(", ")
            .find_map(|p| p.split_once(' ').filter(|(_, w)| w.starts_with(word))?.0.parse().ok())
            .unwrap_or(0)
    };
    text.lines().filter(|l| l.starts_with("SKIPPED")).for_each(|l| println!("skipped: {l}"));
    let failed = count("failed") + count("error") + u64::from(!answer.status.success() && count("failed") == 0);
    println!("test result: Python. {} passed; {failed} failed", count("passed"));
    if failed == 0 {
        Ok(())
    } else {
        Err(Failure("tests of the Python package failed".into()))
    }
}
