//! A run that chose nothing: its blocks, what happened in it that nobody can predict, and its noise.

use super::data::Data;
use super::events::{self, Happened};
use super::floor::Noise;
use super::means::Means;
use super::model::Fitted;
use super::noise::Growth;
use crate::fit;
use hrg_core::calibration::Calibration;
use hrg_core::AXES;
use hrg_data::axes::AXIS_NAMES;
use hrg_data::error::BadInput;
use hrg_data::recording::steps::Run;
use std::cell::RefCell;
use std::rc::Rc;

/// Rates of each axis, by step, deg/h.
type Rates = [Vec<f64>; AXES];

/// A run that chose nothing.
pub(super) struct Unseen<'v> {
    /// The run.
    pub run: &'v Run,
    /// The run with the beginning that is left out of the judgement because of an unknown state: a unit sends those rates, too.
    pub whole: &'v Run,
    /// Its blocks.
    pub data: Data<'v>,
    /// Events of its day.
    pub happened: Happened,
    /// Noise by axis. (That of an absent axis is another one's: its figures are removed from the report.)
    pub noise: Vec<Noise>,
    /// Images that were asked for, with the rates of the whole run under each.
    corrections: RefCell<Vec<(Calibration, Rc<Rates>)>>,
}

impl<'v> Unseen<'v> {
    /// A run with its blocks, of which a model leaves `left`; `train`: the train runs, with what it leaves of them.
    ///
    /// # Errors
    /// Too few means of an axis.
    pub fn new(
        data: Data<'v>,
        run: &'v Run,
        fitted: &Fitted,
        train: (&[Run], &[[Vec<f64>; AXES]]),
        left: &[Vec<f64>; AXES],
    ) -> Result<Self, BadInput> {
        let happened = events::refit(fitted.terms(), run, &data.scaling, left);
        let there: Vec<usize> = run.steps.present().collect();
        let noise_of = |a: usize| {
            let a = if there.contains(&a) { a } else { there[0] };
            let means =
                |left: &[f64], run: &Run| Means::with_relative(left, &along(&data.growth[a], run, a), run.steps.mean_s);
            let others: Vec<Means> = train.0.iter().zip(train.1).map(|(run, left)| means(&left[a], run)).collect();
            Noise::new(&others, &means(&happened.left[a], run)).ok_or_else(|| {
                BadInput::new(format!("axis {}: too few neighbouring means to tell its noise", AXIS_NAMES[a]))
            })
        };
        let noise = (0..AXES).map(noise_of).collect::<Result<_, _>>()?;
        let data = data.with_happened(&happened.effects);
        Ok(Self { run, whole: run, data, happened, noise, corrections: RefCell::default() })
    }

    /// The same with the run whose beginning was left out.
    pub fn part_of(self, whole: &'v Run) -> Self {
        Self { whole, corrections: RefCell::default(), ..self }
    }

    /// Corrected rates of the whole run ([`fit::correct`]). The unit's code runs once for each image.
    pub fn whole_corrected(&self, image: &Calibration) -> Rc<Rates> {
        let mut known = self.corrections.borrow_mut();
        if let Some((_, rates)) = known.iter().find(|(i, _)| i == image) {
            return Rc::clone(rates);
        }
        let rates = Rc::new(fit::correct(image, &self.whole.steps));
        known.push((image.clone(), Rc::clone(&rates)));
        rates
    }

    /// The same on the steps that are judged; NaN on the others. (A bias does not depend on the rates.)
    pub fn corrected(&self, image: &Calibration) -> Rates {
        let whole = self.whole_corrected(image);
        [0, 1, 2].map(|a: usize| {
            let both = whole[a].iter().zip(&self.run.steps.rate_dph[a]);
            both.map(|(rate, raw)| if raw.is_nan() { f64::NAN } else { *rate }).collect()
        })
    }

    /// Means of a series on the steps of the run.
    pub fn means(&self, series: &[f64]) -> Means {
        Means::of(series, self.run.steps.mean_s)
    }
}

/// Relative deviation of the noise on every step of a run; NaN where the temperature is not known.
fn along(growth: &Growth, run: &Run, a: usize) -> Vec<f64> {
    let at = |k: usize| run.state(k, a).map_or(f64::NAN, |(temperature_c, _)| growth.at(f64::from(temperature_c)));
    (0..run.steps.len()).map(at).collect()
}
