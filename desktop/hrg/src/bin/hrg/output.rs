//! `hrg unit output`.

use anyhow::{Context, Result};
use clap::Args;
use hrg::unit::output::{filter, framing, in_words, of};
use hrg::unit::port::Unit;
use hrg_core::filter::Filter;
use hrg_core::output::{Framing, OutputSettings, MOST_INCREMENTS};
use hrg_core::rate_path::MOST_SAMPLES;

/// Arguments of `hrg unit output`.
#[derive(Args)]
pub struct Arguments {
    /// Serial port of the link.
    #[arg(long)]
    port: String,
    /// Filter from samples to frames: linear-phase (flat to 60 Hz at 200 Hz, 28 ms late), or mean (3.5 ms).
    #[arg(long, value_parser = filter)]
    filter: Option<Filter>,
    /// Samples (of 1 ms) in a rate frame: 5 are 200 Hz.
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=i64::from(MOST_SAMPLES)))]
    samples: Option<u16>,
    /// Samples in a message of increments of angle and velocity: 5 are 200 Hz; 0: none are sent.
    #[arg(long, value_parser = clap::value_parser!(u16).range(0..=i64::from(MOST_INCREMENTS)))]
    increments: Option<u16>,
    /// Framing of what goes out: own or mavlink (HIGHRES_IMU).
    #[arg(long, value_parser = framing)]
    framing: Option<Framing>,
}

/// `hrg unit output`.
pub fn run(arguments: &Arguments) -> Result<()> {
    let Arguments { port, filter, samples, increments, framing } = arguments;
    let mut unit = Unit::open(port)?;
    let identity = unit.identity()?;
    let now = of(&identity);
    let wanted = OutputSettings {
        filter: filter.unwrap_or(now.filter),
        decimation: samples.unwrap_or(now.decimation),
        increments: increments.unwrap_or(now.increments),
        framing: framing.unwrap_or(now.framing),
    };
    if wanted == now {
        println!("{}: {}", identity.unit_name(), in_words(&now));
        return Ok(());
    }
    unit.set_output(&wanted).with_context(|| port.clone())?;
    println!("{}: {}, from now on and from each start on", identity.unit_name(), in_words(&wanted));
    Ok(())
}
