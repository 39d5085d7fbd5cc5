//! Why a text is no calibration.

use super::VERSION;
use hrg_core::calibration::ImageError;

/// Why a text is no calibration.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum FileError {
    /// It is not TOML, or another TOML.
    #[error("this is not a calibration file: {0}")]
    NotOne(String),
    /// It is of another version.
    #[error("the calibration file is of version {0}, this program reads version {VERSION}")]
    Version(String),
    /// The directions of an uncertainty are too many, or not as long as the regressors.
    #[error("{place}: uncertainty_directions_dph must be at most {most} rows of {width} numbers")]
    Directions {
        /// Place in the file.
        place: String,
        /// Most rows.
        most: usize,
        /// Numbers of a row.
        width: usize,
    },
    /// Something is not there.
    #[error("{place} lacks {name}")]
    Missing {
        /// Place in the file.
        place: String,
        /// Name of the missing value.
        name: String,
    },
    /// A value of another kind, or of another number of values.
    #[error("{place}: {name} cannot be {given}")]
    Wrong {
        /// Place in the file.
        place: String,
        /// Name of the value.
        name: &'static str,
        /// As it stands there.
        given: String,
    },
    /// A row of another length.
    #[error("{place}: {name} must be {count} numbers")]
    Row {
        /// Place in the file.
        place: String,
        /// Name of the row.
        name: String,
        /// Number of values that it must have.
        count: usize,
    },
    /// A checksum that is none.
    #[error("{name} \"{text}\" is not a hexadecimal number")]
    NotHexadecimal {
        /// Name of the checksum.
        name: String,
        /// As it stands there.
        text: String,
    },
    /// No bias model, or several.
    #[error("{0} must have one bias model: bias_dph, or bias_cooling_dph with bias_heating_dph, or four_parameter_dph, bias_of_frequency_dph or network_dph")]
    OneModel(String),
    /// An effect that this program does not have.
    #[error("effect \"{0}\" is not known to this program")]
    UnknownEffect(String),
    /// An input that this program does not have.
    #[error("input \"{0}\" is not known to this program")]
    UnknownInput(String),
    /// An effect with another number of gains than it has regressors.
    #[error("effect {effect}: axis {axis} needs {count} gains")]
    Gains {
        /// The effect.
        effect: String,
        /// The axis.
        axis: &'static str,
        /// Number of values that it needs.
        count: usize,
    },
    /// More effects than an image has room for.
    #[error("the calibration file has more effects than an image can hold")]
    TooManyEffects,
    /// The content is impossible.
    #[error("the calibration file cannot be used: {0}")]
    Unusable(ImageError),
    /// Changed by hand, or damaged.
    #[error("the calibration file's checksum is {stated:08x}, its content gives {content:08x}: it was changed by hand or damaged; make it anew, or set block_crc32 if the change is meant")]
    Checksum {
        /// As it stands there.
        stated: u32,
        /// That of the content.
        content: u32,
    },
}

impl From<FileError> for crate::error::BadInput {
    fn from(e: FileError) -> Self {
        Self(e.to_string())
    }
}
