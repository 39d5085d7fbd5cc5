//! hrg-core for firmware of others: the example on another chip, and the crate as it would be published.

use crate::{bounds, cargo, root, run, setup, Failure};
use setup::Toolchain;

/// Bound of the example's program, bytes: a tenth above what it takes.
const EXAMPLE_FLASH_BOUND: u64 = 88_500;

/// Builds the example for the nRF52840, in a folder of its own, and prints what it takes.
pub fn example(t: &Toolchain) -> Result<(), Failure> {
    let folder = root().join("target/nrf52840");
    let manifest = root().join("hrg-core/examples/nrf52840/Cargo.toml");
    run(t
        .cargo("build")
        .args(["--quiet", "--release", "--locked", "--manifest-path"])
        .arg(manifest)
        .arg("--target-dir")
        .arg(&folder))?;
    bounds(&folder.join(setup::TARGET).join("release/hrg-core-nrf52840"), "nRF52840: ", EXAMPLE_FLASH_BOUND)
}

/// Packs hrg-core and builds what was packed, without a network. (`cargo publish --dry-run` does the same, and asks the registry: the public
/// workflow runs it.)
pub fn package() -> Result<(), Failure> {
    run(&mut cargo(&[
        "package",
        "--quiet",
        "--package",
        "hrg-core",
        "--locked",
        "--offline",
        "--allow-dirty",
        "--target-dir",
        "target/package-hrg-core",
    ]))
}
