//! A second, independent plant: chamber runs of HRG units with physics that `hrg trace` was not written for, and the truth beside them.
//!
//! It shares nothing with the project's own simulator and effects: no code, no forms, no assumptions. It models:
//! - [`chamber`]: programs, and a controller that overshoots and ripples;
//! - [`thermal`]: board, base plate, holders, cases and resonators as a network that convection and radiation make nonlinear;
//! - [`sensors`]: quartic frequency curves, and case sensors with offset, gain error, lag, steps and noise;
//! - [`noise`]: white, 1/f^a by spectrum, random walk, lines, and the spectra of measured series with random phases ([`series`]);
//! - [`physics`]: the effects, by class;
//! - [`defects`]: what loggers and cables do to files.
//!
//! A [`Case`] is a unit with some effects (or none) and a plan of runs. [`Case::generate`] makes recordings and a [`truth::Truth`]: the
//! classes of a right answer, the size of each effect, and what perfect knowledge of its form leaves on the verify run.
//!
//! ```
//! let case = foreign_plant::cases().into_iter().find(|c| c.name == "shape-hinges").expect("the case is there");
//! let made = case.generate(1);
//! assert_eq!(made.train.len(), 1);
//! assert!(made.truth.verify().is_some_and(|run| run.axes["x"].oracle_floors < 1.4));
//! ```

mod acting;
pub mod case;
pub mod cases;
pub mod chamber;
pub mod clean;
pub mod defects;
pub mod draw;
mod drawing;
pub mod electrics;
pub mod fit;
pub mod generate;
pub mod grade;
mod judge;
mod losses;
mod making;
pub mod means;
pub mod noise;
pub mod operators;
mod output;
pub mod physics;
pub mod plan;
pub mod recording;
pub mod sensors;
pub mod series;
mod sizing;
pub mod thermal;
pub mod third;
pub mod truth;
pub mod unit;
pub mod world;

pub use case::Case;
pub use cases::cases;
pub use clean::clean;
pub use generate::Generated;
pub use noise::Noise;
pub use recording::Recording;
pub use truth::{Class, Truth};
