//! `hrg unit update` and `hrg unit pack`.

use anyhow::{Context, Result};
use clap::Args;
use hrg::unit::keys;
use hrg::unit::port::Unit;
use hrg::unit::program::{describe, ProgramFile};
use hrg_data::error::BadInput;
use std::path::{Path, PathBuf};

/// Arguments of `hrg unit update`.
#[derive(Args)]
pub struct UpdateArguments {
    /// Program (cargo xtask update). Without it the unit is asked which programs it holds.
    file: Option<PathBuf>,
    /// Serial port of the link.
    #[arg(long)]
    port: String,
    /// Have the unit start the program that it ran before.
    #[arg(long, conflicts_with = "file")]
    rollback: bool,
}

/// Gives a unit a new program, or its old one.
pub fn update(arguments: &UpdateArguments) -> Result<()> {
    let UpdateArguments { file, port, rollback } = arguments;
    let file = file.as_deref().map(ProgramFile::load).transpose()?;
    let mut unit = Unit::open(port)?;
    let Some(file) = file else {
        let programs = if *rollback { unit.roll_back() } else { unit.programs() };
        println!("{}", describe(&programs.with_context(|| port.clone())?));
        return Ok(());
    };
    println!("{}", file.describe());
    let bar = indicatif::ProgressBar::new(1000);
    bar.set_style(indicatif::ProgressStyle::with_template("{msg:20} {bar:40} {percent} %")?);
    let done = unit.update(&file, |what, share| {
        bar.set_message(what.to_string());
        bar.set_position((share * 1000.0) as u64);
    });
    bar.finish_and_clear();
    let done = done.with_context(|| format!("{port}: give the same command again: it goes on where it was"))?;
    println!("{}", describe(&done));
    println!("to go back: hrg unit update --rollback --port {port}");
    Ok(())
}

/// Arguments of `hrg unit pack`.
#[derive(Args)]
pub struct PackArguments {
    /// The firmware linked for slot A, as an ELF.
    a: PathBuf,
    /// The same linked for slot B (HRG_SLOT=B).
    b: PathBuf,
    /// File for hrg unit update.
    #[arg(short, long)]
    out: PathBuf,
    /// Private key that signs it (hrg unit keygen).
    #[arg(long)]
    key: Option<PathBuf>,
}

/// Makes the file of a program.
pub fn pack(arguments: &PackArguments) -> Result<()> {
    let PackArguments { a, b, out, key } = arguments;
    let key = key.as_deref().map(keys::load).transpose()?;
    let read = |path: &Path| std::fs::read(path).map_err(|e| BadInput::new(format!("{}: {e}", path.display())));
    let (of_a, of_b) = (read(a)?, read(b)?);
    let file = ProgramFile::pack([(a, &of_a), (b, &of_b)], key.as_ref())?;
    hrg_data::output::write_file(out, &file.to_bytes())?;
    println!("{}: {}", out.display(), file.describe());
    Ok(())
}
