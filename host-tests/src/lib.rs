//! Nothing but tests: see `tests/`. The recordings are in `recordings/`.

use std::path::PathBuf;
use std::process::Command;
use std::sync::Mutex;

/// A program of this project, built by the profile of the test that asks for it and lying beside it.
///
/// # Panics
/// If it cannot be built.
#[must_use]
pub fn program(name: &str) -> PathBuf {
    let here = std::env::current_exe().expect("this test");
    let folder = here.ancestors().nth(2).expect("target/PROFILE/deps");
    static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());
    let _guard = ONE_AT_A_TIME.lock();
    let mut cargo = Command::new(env!("CARGO"));
    // (All of them at once, as xtask builds them: of one alone some dependencies would have other features, and be built anew.)
    cargo.args([
        "build",
        "--quiet",
        "--locked",
        "-p",
        "hrg",
        "-p",
        "hrg-board",
        "-p",
        "hrg-study",
        "-p",
        "foreign-plant",
    ]);
    if folder.ends_with("release") {
        cargo.arg("--release");
    }
    assert!(cargo.current_dir(env!("CARGO_MANIFEST_DIR")).status().expect("cargo runs").success());
    folder.join(name)
}
