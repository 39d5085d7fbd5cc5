//! The fuzz targets of fuzz/, built as cargo-fuzz builds them, but with the stable compiler and without its sanitizer: our code
//! has no unsafe parts on the host. (`cargo fuzz run TARGET` works in that folder too, with a nightly compiler.)

use crate::{cargo, root, run, Failure};
use std::path::PathBuf;
use std::process::Command;

const TARGETS: [&str; 5] = ["recording", "calibration", "link", "log", "unit"];

/// Coverage counters and traced comparisons, as cargo-fuzz asks LLVM for them.
const FLAGS: &str = "--cfg fuzzing -Cpasses=sancov-module -Cllvm-args=-sanitizer-coverage-level=4 \
                     -Cllvm-args=-sanitizer-coverage-inline-8bit-counters \
                     -Cllvm-args=-sanitizer-coverage-pc-table -Cllvm-args=-sanitizer-coverage-trace-compares";

fn host_triple() -> Result<String, Failure> {
    crate::output(Command::new("rustc").arg("-vV"))
        .and_then(|s| s.lines().find_map(|l| l.strip_prefix("host: ").map(String::from)))
        .ok_or_else(|| Failure("rustc does not say what machine this is".into()))
}

/// Builds the targets; gives their folder.
fn build() -> Result<PathBuf, Failure> {
    // With a target named, the flags are not for build scripts and macros.
    let triple = host_triple()?;
    run(cargo(&[
        "build",
        "--quiet",
        "--release",
        "--locked",
        "--manifest-path",
        "fuzz/Cargo.toml",
        "--target",
        &triple,
    ])
    .arg("--target-dir")
    .arg(root().join("target/fuzz"))
    .env("RUSTFLAGS", FLAGS))?;
    Ok(root().join("target/fuzz").join(triple).join("release"))
}

fn one(built: &std::path::Path, target: &str, limit: &str) -> Result<(), Failure> {
    // New inputs go to a folder that is not kept; what the corpus lacks is added by hand (docs/promises.md).
    let found = root().join("target/fuzz-found").join(target);
    std::fs::create_dir_all(&found).map_err(|e| Failure(e.to_string()))?;
    let artifacts = format!("-artifact_prefix={}/", root().join("target/fuzz-found").display());
    let o = Command::new(built.join(target))
        .args(["-seed=1", "-max_len=8192", "-timeout=20", "-rss_limit_mb=4096", limit, &artifacts])
        .arg(&found)
        .arg(root().join("fuzz/corpus").join(target))
        .output()
        .map_err(|e| Failure(e.to_string()))?;
    let printed = String::from_utf8_lossy(&o.stderr);
    let last = printed.lines().rev().find(|l| l.starts_with("Done")).unwrap_or("ended without a word");
    let coverage = printed.lines().rev().find_map(|l| l.split("cov: ").nth(1)?.split(' ').next()).unwrap_or("?");
    println!("  {target}: {last}, {coverage} edges covered");
    if o.status.success() {
        return Ok(());
    }
    Err(Failure(format!(
        "fuzz target {target} failed:\n{}",
        printed.lines().rev().take(40).collect::<Vec<_>>().join("\n")
    )))
}

/// Every target for some seconds.
pub fn campaign(arguments: &[String]) -> Result<(), Failure> {
    let seconds: u32 = match arguments.first().map(|a| a.parse()) {
        None => 60,
        Some(Ok(n)) => n,
        Some(Err(_)) => return Err(Failure("cargo xtask fuzz SECONDS: that is not a number".into())),
    };
    let built = build()?;
    TARGETS.iter().try_for_each(|t| one(&built, t, &format!("-max_total_time={seconds}")))
}
