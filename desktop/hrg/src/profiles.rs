//! Chamber profiles that tell effects apart: the named ones judged on a simulated unit, and the best of them.

use hrg_core::effects::EffectId;
use hrg_data::error::BadInput;
use hrg_identify::trace::separable;
use hrg_identify::trace::separable::Verdict;
use hrg_simulate::{Plan, Profile};

/// A profile that was judged.
#[derive(Debug, Clone)]
pub struct Judged {
    /// Its name.
    pub name: &'static str,
    /// The profile.
    pub profile: Profile,
    /// Duration, h.
    pub hours: f64,
    /// Effects that it does not tell apart, or why it cannot be used.
    pub not_separable: Result<Vec<String>, BadInput>,
}

impl Judged {
    /// Judges a profile for some effects.
    #[must_use]
    pub fn new(name: &'static str, profile: Profile, wanted: &[EffectId]) -> Self {
        let not_separable = judge(&profile, wanted).map(|v| separable::not_separable(&v));
        Self { name, hours: profile.temperatures().len() as f64 / 3600.0, profile, not_separable }
    }

    /// `true` if it serves the baseline itself, which wants both directions over 60 C at the least.
    fn serves_the_baseline(&self) -> bool {
        let t = self.profile.temperatures();
        let (low, high) = t.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(*x), h.max(*x)));
        let both = t.windows(2).any(|w| w[1] < w[0]) && t.windows(2).any(|w| w[1] > w[0]);
        high - low >= 60.0 && both
    }
}

/// Separation of some effects by a run of a profile.
///
/// # Errors
/// A profile too short to be used.
pub fn judge(profile: &Profile, wanted: &[EffectId]) -> Result<Vec<Verdict>, BadInput> {
    let recording = Plan::of(profile.clone(), 1, 1).simulate().recording;
    separable::judge(&[recording], wanted)
}

/// The one that leaves fewest effects untold; of such the shortest.
#[must_use]
pub fn best(judged: &[Judged]) -> Option<&Judged> {
    let mut best: Option<(usize, f64, &Judged)> = None;
    for one in judged.iter().filter(|j| j.serves_the_baseline()) {
        let Ok(rest) = &one.not_separable else { continue };
        if best.as_ref().is_none_or(|b| (rest.len(), one.hours) < (b.0, b.1)) {
            best = Some((rest.len(), one.hours, one));
        }
    }
    best.map(|b| b.2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_best_goes_both_ways_and_leaves_least_untold() {
        let one = |name, text: &str, untold: Result<usize, BadInput>| {
            let profile = Profile::parse(text).expect("a profile");
            let hours = profile.temperatures().len() as f64 / 3600.0;
            Judged { name, profile, hours, not_separable: untold.map(|n| vec!["kink".into(); n]) }
        };
        let all = [
            one("one way", "-40,50@1,1h", Ok(0)),
            one("narrow", "20,40@1,20@1", Ok(0)),
            one("unusable", "20,-40@1,50@1", Err(BadInput::new("too short"))),
            one("long", "20,-40@1,5h,50@1,1h", Ok(1)),
            one("short", "20,-40@1,1h,50@1,1h", Ok(1)),
            one("poor", "20,-40@1,50@1", Ok(2)),
        ];
        assert_eq!(best(&all).map(|b| b.name), Some("short"));
        assert!(best(&all[..3]).is_none());
    }
}
