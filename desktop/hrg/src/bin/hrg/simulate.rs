//! `hrg simulate`: a chamber run from the plant model.

use crate::facts::Place;
use anyhow::Result;
use clap::Args;
use hrg_data::error::BadInput;
use hrg_data::recording::parquet;
use hrg_data::recording::thermometer::Thermometer;
use hrg_simulate::turning::Scheme;
use hrg_simulate::{EffectSpec, Kind, Noise, Plan, Profile, ATTITUDE};
use std::path::PathBuf;

/// Arguments of `hrg simulate`.
#[derive(Args)]
pub struct Arguments {
    /// A named profile (dong, dong2023, cycle, verify, stairs, ramps, fast, zhao, up, wu, lag, soaks) or one like
    /// 20,-40@1,2h,50@1,2h; -40@set lets the chamber go there by itself, "until gyros=50" holds until all resonators are there
    #[arg(long, default_value = "dong", allow_hyphen_values = true)]
    profile: String,
    /// Effect to put in: NAME[:key=value,...], or secret:SEED. Several may be given.
    #[arg(long)]
    effect: Vec<String>,
    /// Seed of this run's noise: another seed is another run of the same unit.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Number of the unit: its bias coefficients and its gains of an effect.
    #[arg(long, default_value_t = 1)]
    unit: u64,
    /// Kind of unit: hrg (like dong2023's), fog (like wu2023's) or zhao (like zhao2022's)
    #[arg(long, default_value = "hrg")]
    kind: String,
    /// Source of the temperatures: frequency (a resonator in each gyro) or sensor (a platinum resistor in each gyro, and no resonator)
    #[arg(long, default_value = "frequency")]
    thermometer: String,
    /// White noise: standard deviation of 100 s means, deg/h; by default that of the kind
    #[arg(long)]
    noise: Option<f64>,
    /// Put spikes, gaps, missing, stuck values and repeated times in.
    #[arg(long)]
    defects: bool,
    /// Turn the unit on a rate table by the eight steps of hrg profile --rates, at these rates in deg/s, round by round
    #[arg(long, value_name = "RATES", num_args = 0..=1, default_missing_value = "18,9")]
    rates: Option<String>,
    /// Hold the unit in six positions, each axis up and down in turn, round by round, with its accelerometers in the recording (hrg fit --accelerometers)
    #[arg(long, conflicts_with = "rates")]
    positions: bool,
    /// Attitude of the unit; by default at 28.2 degrees north, x=north y=east z=down.
    #[command(flatten)]
    place: Place,
    /// Leave latitude and axes out of the file: a fit then finds the earth's rate in the constants.
    #[arg(long)]
    no_attitude: bool,
    /// File for the recording: text, or Parquet if it ends in .parquet
    #[arg(short, long)]
    out: PathBuf,
}

/// Runs the command.
///
/// # Errors
/// Bad input, or a file that cannot be written.
pub fn run(arguments: Arguments) -> Result<()> {
    let Arguments {
        profile,
        effect,
        seed,
        unit,
        kind,
        thermometer,
        noise,
        defects,
        rates,
        positions,
        place,
        no_attitude,
        out,
    } = arguments;
    let kind = Kind::parse(&kind)?;
    let usual = kind.noise();
    let thermometer = match thermometer.as_str() {
        "frequency" => Thermometer::Frequency,
        "sensor" => Thermometer::Sensors,
        other => {
            return Err(BadInput(format!("thermometer \"{other}\" is not known; there are frequency and sensor")).into())
        }
    };
    let effects = effect
        .iter()
        .map(|e| match e.strip_prefix("secret:") {
            Some(s) => s
                .parse()
                .map(EffectSpec::secret)
                .map_err(|_| BadInput::new(format!("\"{e}\": secret: takes a whole number as seed"))),
            None => EffectSpec::parse(e),
        })
        .collect::<Result<Vec<_>, _>>()?;
    let noise = Noise { white_100s_dph: noise.unwrap_or(usual.white_100s_dph), ..usual };
    let attitude = place.attitude_of_three()?.unwrap_or(ATTITUDE);
    let turning = rates.as_deref().map(Scheme::of_rates).transpose()?;
    let plan = Plan {
        kind,
        thermometer,
        effects,
        noise,
        attitude,
        turning,
        positions,
        ..Plan::of(Profile::parse(&profile)?, unit, seed)
    };
    plan.check()?;
    let mut simulated = plan.simulate();
    if defects {
        hrg_simulate::inject_defects(&mut simulated.recording, seed);
    }
    if no_attitude {
        simulated.recording.restore_earth_rate();
        simulated.recording.meta.retain(|(k, _)| k != "latitude_deg" && k != "axes");
    }
    parquet::write_text(&out, &simulated.recording.to_csv())?;
    println!(
        "{}: {} rows, simulated (unit SIM-{}, seed {seed})",
        out.display(),
        simulated.recording.time_s.len(),
        plan.unit_seed
    );
    Ok(())
}
