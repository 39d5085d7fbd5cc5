//! Stages of a run as dong2023 has them: a ramp and the soak after it are one stage, cooling or heating.

use hrg_core::bias::Scaling;
use hrg_core::effects::EffectId;
use hrg_data::recording::steps::Run;

/// Stage of a model step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// Cooling, and the soak after it.
    Cooling,
    /// Heating, and the soak after it.
    Heating,
}

impl Stage {
    /// Both, in the order of dong2023's tables.
    pub const ALL: [Self; 2] = [Self::Cooling, Self::Heating];

    /// The name in tables.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Cooling => "cooling",
            Self::Heating => "heating",
        }
    }
}

/// The stage of each step for an axis; what comes before the first direction belongs to the stage that follows, and a run without a
/// direction has no stage. By the unit's own code, so that a step belongs to the stage whose set of coefficients corrects it.
#[must_use]
pub fn of_run(run: &Run, scaling: &Scaling, a: usize) -> Vec<Option<Stage>> {
    // The first regressor is the weight itself, times one.
    let mut stages: Vec<Option<Stage>> = run
        .effect(EffectId::CoolingHeatingHeld.facts().id, &[0.0; 2], 0.0, scaling, a)
        .iter()
        .map(|x| match x[0] {
            w if w < 0.0 => Some(Stage::Cooling),
            w if w > 0.0 => Some(Stage::Heating),
            _ => None,
        })
        .collect();
    if let Some(first) = stages.iter().position(Option::is_some) {
        let stage = stages[first];
        stages[..first].fill(stage);
    }
    stages
}

/// Start state for an effect that holds the last direction ([`hrg_core::effects::Effect::start_on`]), so that a run which begins with this
/// stage has it from its first step on.
#[must_use]
pub const fn start_of(stage: Stage) -> f32 {
    match stage {
        Stage::Cooling => 1.0,
        Stage::Heating => -1.0,
    }
}

/// The values of one stage; NaN elsewhere.
#[must_use]
pub fn only(values: &[f64], stages: &[Option<Stage>], stage: Stage) -> Vec<f64> {
    values.iter().zip(stages).map(|(v, s)| if *s == Some(stage) { *v } else { f64::NAN }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use hrg_identify::fit::prepare;
    use hrg_simulate::{Plan, Profile};

    #[test]
    fn a_soak_belongs_to_the_ramp_before_it() {
        let profile = Profile::parse("20,30m,-10@1,1h,30@1,30m").expect("a profile");
        let p = prepare(&[Plan::of(profile, 1, 1).simulate().recording]).expect("prepares");
        let stages = of_run(&p.runs[0], &p.calibration.scaling, 1);
        assert_eq!(stages.len(), p.runs[0].steps.len());
        // The chamber stands again from 1 h 00 on; the resonators still follow, and then rest.
        assert!(stages[3600..7200].iter().all(|s| *s == Some(Stage::Cooling)), "the soak after cooling");
        assert_eq!((stages.first(), stages.last()), (Some(&Some(Stage::Cooling)), Some(&Some(Stage::Heating))));
        let changes = stages.windows(2).filter(|w| w[0] != w[1]).count();
        assert!(changes == 1, "{changes} changes: a soak's noise is no direction");
    }
}
