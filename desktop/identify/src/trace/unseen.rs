//! A run that chose nothing: its blocks, what happened in it that nobody can predict, and its noise.

use super::data::Data;
use super::events::{self, Happened};
use super::floor::Noise;
use super::means::Means;
use super::model::Fitted;
use hrg_core::AXES;
use hrg_data::axes::AXIS_NAMES;
use hrg_data::error::BadInput;
use hrg_data::recording::steps::Run;

/// A run that chose nothing.
pub(super) struct Unseen<'v> {
    /// The run.
    pub run: &'v Run,
    /// Its blocks.
    pub data: Data<'v>,
    /// Events of its day.
    pub happened: Happened,
    /// Noise by axis. (That of an absent axis is another one's: its figures are removed from the report.)
    pub noise: Vec<Noise>,
}

impl<'v> Unseen<'v> {
    /// A run of which a model leaves `left`; `train`: what it leaves of the train runs.
    ///
    /// # Errors
    /// Too few means of an axis.
    pub fn new(
        data: &Data<'v>,
        run: &'v Run,
        fitted: &Fitted,
        train: &[[Vec<f64>; AXES]],
        left: &[Vec<f64>; AXES],
    ) -> Result<Self, BadInput> {
        let happened = events::refit(fitted.terms(), run, &data.scaling, left);
        let there: Vec<usize> = run.steps.present().collect();
        let noise_of = |a: usize| {
            let a = if there.contains(&a) { a } else { there[0] };
            let others: Vec<Means> = train.iter().map(|r| Means::of(&r[a])).collect();
            Noise::new(&others, &Means::of(&happened.left[a])).ok_or_else(|| {
                BadInput::new(format!("axis {}: too few neighbouring means to tell its noise", AXIS_NAMES[a]))
            })
        };
        let noise = (0..AXES).map(noise_of).collect::<Result<_, _>>()?;
        Ok(Self { run, data: data.unseen(run).with_happened(&happened.effects), happened, noise })
    }
}
