//! Nothing but tests: see `tests/`. The recordings are in `recordings/`.

use std::path::{Path, PathBuf};
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

/// Folder of the measured recordings; `MEASURED` in the arguments of [`hrg`].
pub const MEASURED: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/recordings/measured");
/// Folder of the files that pandas wrote; `PANDAS` in the arguments of [`hrg`].
pub const PANDAS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/recordings/pandas");

/// A folder for the files of a test.
///
/// # Panics
/// If it cannot be made.
#[must_use]
pub fn temporary(name: &str) -> PathBuf {
    let d = std::env::temp_dir().join(format!("hrg-{}-{name}", std::process::id()));
    std::fs::create_dir_all(&d).expect("a temporary folder");
    d
}

/// Runs a program of this project in a folder; gives its exit status, its output and its messages.
///
/// # Panics
/// If it cannot be started.
pub fn run(name: &str, folder: &Path, arguments: &str) -> (Option<i32>, String, String) {
    let o = Command::new(program(name))
        .current_dir(folder)
        .args(arguments.split(' ').map(|a| a.replace("MEASURED", MEASURED).replace("PANDAS", PANDAS)))
        .output()
        .expect("runs");
    let text = |b: &[u8]| String::from_utf8_lossy(b).into_owned();
    (o.status.code(), text(&o.stdout), text(&o.stderr))
}

/// Runs `hrg` in a folder; gives its exit status, its output and its messages.
pub fn hrg(folder: &Path, arguments: &str) -> (Option<i32>, String, String) {
    run("hrg", folder, arguments)
}

/// Output of a run of `hrg` that succeeds.
///
/// # Panics
/// If it does not.
pub fn ok(folder: &Path, arguments: &str) -> String {
    let (code, out, error) = hrg(folder, arguments);
    assert_eq!(code, Some(0), "{arguments}: {error}");
    out
}
