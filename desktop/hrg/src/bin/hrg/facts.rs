//! Options that say of a unit what its recordings may not tell.

use crate::wait::with_a_bar;
use anyhow::Result;
use clap::Args;
use hrg_core::AXES;
use hrg_data::error::BadInput;
use hrg_data::image_file;
use hrg_data::load::{print_notes, read_with};
use hrg_data::recording::facts::Facts;
use hrg_data::recording::metadata::{scale_factor, Attitude};
use hrg_data::recording::names;
use hrg_data::recording::Recording;
use std::path::PathBuf;

/// Place and attitude of the unit.
#[derive(Args, Clone, Debug, Default)]
pub struct Place {
    /// Latitude in degrees, north positive; with --axes the earth's rate is taken off.
    #[arg(long, value_name = "DEGREES", allow_hyphen_values = true)]
    pub latitude: Option<String>,
    /// Directions of the axes, like "x=north y=east z=down"
    #[arg(long)]
    pub axes: Option<String>,
}

impl Place {
    /// The attitude; `None` where none is given.
    pub fn attitude(&self) -> Result<Option<Attitude>, BadInput> {
        Ok(Attitude::of(self.latitude.as_deref(), self.axes.as_deref())?)
    }

    /// The attitude of a unit of three axes.
    ///
    /// # Errors
    /// As [`attitude`](Self::attitude), and where an axis is not named.
    pub fn attitude_of_three(&self) -> Result<Option<Attitude>, BadInput> {
        let attitude = self.attitude()?;
        attitude.map_or(Ok(()), |a| a.names(0..AXES))?;
        Ok(attitude)
    }
}

/// Name of a unit, its place and its attitude.
#[derive(Args, Clone, Debug, Default)]
pub struct Identity {
    /// Name of the unit, where the recordings name none.
    #[arg(long)]
    unit: Option<String>,
    #[command(flatten)]
    place: Place,
}

impl Identity {
    /// As facts of recordings.
    ///
    /// # Errors
    /// A name, a place or an attitude that is none.
    pub fn facts(&self) -> Result<Facts, BadInput> {
        let checked = |name: &String| names::check(name).map(String::from);
        Ok(Facts {
            unit: self.unit.as_ref().map(checked).transpose()?,
            attitude: self.place.attitude()?,
            ..Facts::default()
        })
    }
}

/// Facts that recordings may lack.
#[derive(Args, Clone, Debug, Default)]
pub struct FactsArguments {
    #[command(flatten)]
    identity: Identity,
    /// Scale factor of the rate channels, deg/h per code of the ADC. Rates made with another one are converted.
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    scale_factor: Option<String>,
    /// A calibration of this unit whose scale factor (and name) is kept.
    #[arg(long, value_name = "OLD.toml")]
    base: Option<PathBuf>,
}

impl FactsArguments {
    fn facts(&self) -> Result<Facts> {
        Ok(Facts {
            scale_factor: self.scale_factor.as_deref().map(scale_factor).transpose().map_err(BadInput::from)?,
            base: self.base.as_deref().map(image_file::load).transpose()?,
            ..self.identity.facts()?
        })
    }

    /// Adds what the arguments give to a recording.
    ///
    /// # Errors
    /// Facts that are none, or that the recording denies.
    pub fn apply(&self, r: &mut Recording) -> Result<()> {
        Ok(self.facts()?.apply(r)?)
    }

    /// Part of the earth's rate along the axes, deg/h, where latitude and axes are among the arguments.
    ///
    /// # Errors
    /// A place or an attitude that is none.
    pub fn earth_rate_dph(&self) -> Result<Option<[f64; AXES]>> {
        Ok(self.identity.place.attitude()?.map(|a| a.earth_rate_dph()))
    }

    /// Reads recordings and adds what the arguments give.
    pub fn load(&self, paths: &[PathBuf]) -> Result<Vec<Recording>> {
        let facts = self.facts()?;
        let load = |path: &PathBuf| {
            let r = with_a_bar(&format!("reading {}", path.display()), || read_with(path, &facts))?;
            print_notes(path, &r);
            Ok(r)
        };
        paths.iter().map(load).collect()
    }
}
