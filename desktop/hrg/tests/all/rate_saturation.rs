//! A bias that follows the ramp and levels off is found by its name, with the ramp at which it levels off.

use hrg_core::effects::EffectId;
use hrg_identify::trace::trace;
use hrg_simulate::{EffectSpec, Plan, Profile};

#[test]
fn a_saturating_rate_is_named() {
    let sizing = Profile::parse("ramps").expect("named");
    let run = |profile: &str, seed: u64| {
        let effects = vec![EffectSpec::parse("rate-saturation:ramp_c_per_min=0.3,size=5").expect("known")];
        let plan = Plan::of(Profile::parse(profile).expect("named"), 91, seed);
        Plan { effects, sizing: Some(sizing.clone()), ..plan }.simulate().recording
    };
    let t = trace(&[run("ramps", 92)], &run("verify", 93)).expect("traces");
    let name = EffectId::RateSaturation.name();
    let found = t.report.effects.iter().find(|e| e.name == name);
    let found = found.unwrap_or_else(|| panic!("{}", t.report.verdict));
    let ramp = found.parameters[EffectId::RateSaturation.facts().parameters[0]];
    assert!((0.2..0.45).contains(&ramp), "levels off at {ramp} C per minute");
}
