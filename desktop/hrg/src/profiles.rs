//! Chamber profiles that tell effects apart: the named ones judged on a simulated unit, and the best of them.

use hrg_core::effects::EffectId;
use hrg_core::temperature::TemperatureCurve;
use hrg_core::AXES;
use hrg_data::error::BadInput;
use hrg_data::numeric::draws::Draws;
use hrg_data::numeric::side_by_side;
use hrg_data::recording::steps::{Run, Steps};
use hrg_identify::family::design::Over;
use hrg_identify::family::Family;
use hrg_identify::trace::separable;
use hrg_identify::trace::separable::Verdict;
use hrg_simulate::{Leg, Plan, Profile};

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

/// Limits of a chamber, and what its runs are for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wanted {
    /// Lowest and highest temperature of the chamber, C.
    pub temperatures_c: [f64; 2],
    /// Its fastest ramp, C per minute.
    pub fastest_c_per_min: f64,
    /// Temperature at power-on, C.
    pub start_c: f64,
    /// Standard uncertainty of the bias that is enough, about its constant, deg/h.
    pub limit_dph: f64,
    /// Longest run, h.
    pub most_hours: f64,
}

/// The best run of a duration that was found, with what is known behind it.
#[derive(Debug, Clone)]
pub struct Designed {
    /// The profile.
    pub profile: Profile,
    /// Its duration, h.
    pub hours: f64,
    /// Standard uncertainty of the bias behind it, by axis, deg/h.
    pub expected_dph: [f64; AXES],
}

impl Designed {
    /// The same of the axis that is known least, deg/h.
    #[must_use]
    pub fn reached_dph(&self) -> f64 {
        largest(self.expected_dph)
    }
}

/// Runs for the next unit of a family.
#[derive(Debug, Clone)]
pub struct Designs {
    /// Standard uncertainty of the bias before any run, by axis, deg/h.
    pub before_dph: [f64; AXES],
    /// The best run of each duration, each half an hour longer than the one before; the last reaches the limit, or is as long as a run may be.
    pub each: Vec<Designed>,
}

/// The largest of three axes; axes that are not there do not count. NaN where none is.
#[must_use]
pub fn largest(each: [f64; AXES]) -> f64 {
    each.into_iter().filter(|v| v.is_finite()).fold(f64::NAN, f64::max)
}

/// A simulated unit, whose resonators stand for those of a family: how they follow a chamber.
struct Simulated {
    curves: [TemperatureCurve; AXES],
}

impl Simulated {
    fn new() -> Result<Self, BadInput> {
        let both_ways = Profile { start_c: 20.0, legs: vec![Leg::Ramp(-40.0, 1.0), Leg::Ramp(50.0, 1.0)] };
        let recording = Plan::of(both_ways, 1, 1).simulate().recording;
        let prepared = hrg_identify::fit::prepare(&[recording])?;
        Ok(Self { curves: prepared.calibration.axes.each_ref().map(|a| a.curve) })
    }

    /// Its run by a profile.
    fn run(&self, profile: &Profile) -> Result<Run, BadInput> {
        let recording = Plan::of(profile.clone(), 1, 1).simulate().recording;
        Ok(Run::new(Steps::new(&recording)?, self.curves))
    }
}

/// Temperatures and ramps that legs are made of.
struct Choice {
    targets_c: Vec<f64>,
    rates: [f64; 3],
}

/// Soaks, min.
const SOAKS_MIN: [f64; 3] = [10.0, 20.0, 40.0];
/// Durations that are tried lie so far apart, h.
const HALF_AN_HOUR: f64 = 0.5;
/// Rounds of changes to the best run of a duration, and changes in each.
const ROUNDS: usize = 24;
const CHANGES: usize = 16;

impl Choice {
    fn new(wanted: &Wanted) -> Self {
        let [low, high] = wanted.temperatures_c;
        let targets_c = (0..=8).map(|k| (low + (high - low) * f64::from(k) / 8.0).round()).collect();
        Self {
            targets_c,
            rates: [1.0, 0.5, 0.25].map(|share| (share * wanted.fastest_c_per_min * 100.0).round() / 100.0),
        }
    }

    fn ramp(&self, draws: &mut Draws) -> Leg {
        // (The fastest as often as the others together: it visits most.)
        let rate = self.rates[[0, 0, 1, 2][draws.below(4)]];
        Leg::Ramp(self.targets_c[draws.below(self.targets_c.len())], rate)
    }

    /// A run with one thing changed.
    fn changed(&self, legs: &[Leg], draws: &mut Draws) -> Vec<Leg> {
        let mut out = legs.to_vec();
        let at = draws.below(out.len().max(1));
        match draws.below(5) {
            0 if !out.is_empty() => out[at] = self.ramp(draws),
            1 if out.len() > 1 => drop(out.remove(at)),
            2 if out.len() > 1 => out.swap(at, (at + 1) % legs.len()),
            3 => out.insert(at, Leg::Soak(60.0 * SOAKS_MIN[draws.below(SOAKS_MIN.len())])),
            _ => out.insert(at, self.ramp(draws)),
        }
        out
    }

    /// Runs to begin with: full sweeps from either end, with soaks at the ends and without.
    fn sweeps(&self) -> Vec<Vec<Leg>> {
        let (low, high) = (self.targets_c[0], self.targets_c[self.targets_c.len() - 1]);
        let of = |ends: [f64; 2], soak_min: f64, rate: f64| -> Vec<Leg> {
            let leg = |to: f64| [Leg::Ramp(to, rate), Leg::Soak(60.0 * soak_min)];
            (0..12).flat_map(|k| leg(ends[k % 2])).filter(|l| *l != Leg::Soak(0.0)).collect()
        };
        let ends = [[low, high], [high, low]];
        ends.into_iter()
            .flat_map(|e| {
                [0.0, 10.0, 20.0, 40.0].into_iter().flat_map(move |s| self.rates[..2].iter().map(move |r| (e, s, *r)))
            })
            .map(|(e, s, r)| of(e, s, r))
            .collect()
    }
}

/// Legs up to a duration, h: the last one is cut. (Ramps to where the chamber is already, and soaks behind soaks, become one.)
fn up_to(start_c: f64, legs: &[Leg], hours: f64) -> Vec<Leg> {
    let (mut at_c, mut left_min, mut out) = (start_c, 60.0 * hours, Vec::<Leg>::new());
    for leg in legs {
        match *leg {
            Leg::Ramp(to, rate) if (to - at_c).abs() >= 1.0 => {
                let minutes = ((to - at_c).abs() / rate).min(left_min);
                let to = (at_c + (to - at_c).signum() * minutes * rate).round();
                if (to - at_c).abs() >= 1.0 {
                    out.push(Leg::Ramp(to, rate));
                }
                at_c = to;
                left_min -= minutes;
            }
            Leg::Soak(s) => {
                let minutes = (s / 60.0).min(left_min).floor();
                match out.last_mut() {
                    Some(Leg::Soak(before)) => *before += 60.0 * minutes,
                    _ if minutes >= 1.0 => out.push(Leg::Soak(60.0 * minutes)),
                    _ => {}
                }
                left_min -= minutes;
            }
            _ => {}
        }
        if left_min < 1.0 {
            break;
        }
    }
    out
}

/// The use that a bias is known for: both ends, slow and fast, both ways.
fn used(
    family: &Family,
    unit: &Simulated,
    [low, high]: [f64; 2],
    fastest: f64,
    start_c: f64,
) -> Result<Over, BadInput> {
    let middle = 0.5 * (low + high);
    let legs = [
        (low, 0.4, 40.0),
        (high, 0.7, 40.0),
        (middle, 1.0, 20.0),
        (low, 1.0, 10.0),
        (high, 0.3, 10.0),
        (low, 0.5, 10.0),
    ];
    let legs = legs.into_iter().flat_map(|(to, share, min)| [Leg::Ramp(to, share * fastest), Leg::Soak(60.0 * min)]);
    Ok(family.over(&unit.run(&Profile { start_c, legs: legs.collect() })?))
}

/// The same over a range of temperatures, for a unit whose run is under way.
///
/// # Errors
/// A chamber that cannot be simulated.
pub fn use_over(family: &Family, temperatures_c: [f64; 2]) -> Result<Over, BadInput> {
    used(family, &Simulated::new()?, temperatures_c, FASTEST_C_PER_MIN, 0.5 * (temperatures_c[0] + temperatures_c[1]))
}

/// Fastest ramp of a chamber, C per minute, where nobody says otherwise.
pub const FASTEST_C_PER_MIN: f64 = 2.0;

/// Designs runs for the next unit of a family, half an hour longer each, until what is expected to be known is within the limit on each axis, or the run is as
/// long as it may be: the best of full sweeps and of the shorter run, changed leg by leg as long as that is expected to tell more.
///
/// # Errors
/// A chamber that cannot be simulated.
pub fn design(family: &Family, wanted: &Wanted) -> Result<Designs, BadInput> {
    let unit = Simulated::new()?;
    let over = used(family, &unit, wanted.temperatures_c, wanted.fastest_c_per_min, wanted.start_c)?;
    let (choice, mut draws) = (Choice::new(wanted), Draws::new(1));
    let judged = |legs: Vec<Leg>| {
        let profile = Profile { start_c: wanted.start_c, legs };
        let run = unit.run(&profile).ok()?;
        let hours = profile.temperatures().len() as f64 / 3600.0;
        Some(Designed { expected_dph: family.expected_dph(Some(&run), &over), profile, hours })
    };
    let best_of = |all: Vec<Vec<Leg>>, hours: f64| {
        let cut = all.into_iter().map(|legs| up_to(wanted.start_c, &legs, hours)).collect();
        side_by_side::each(cut, judged).into_iter().flatten().min_by(|x, y| x.reached_dph().total_cmp(&y.reached_dph()))
    };
    let mut out = Designs { before_dph: family.expected_dph(None, &over), each: Vec::new() };
    let mut hours = HALF_AN_HOUR;
    while hours <= wanted.most_hours + 1e-9 && out.each.last().is_none_or(|d| d.reached_dph() > wanted.limit_dph) {
        let mut begin = choice.sweeps();
        if let Some(shorter) = out.each.last() {
            let more = [Leg::Soak(1800.0), choice.ramp(&mut draws), choice.ramp(&mut draws)];
            begin.extend(more.map(|leg| [&shorter.profile.legs[..], &[leg, leg]].concat()));
        }
        let Some(mut best) = best_of(begin, hours) else { break };
        for _ in 0..ROUNDS {
            let changed = (0..CHANGES).map(|_| choice.changed(&best.profile.legs, &mut draws)).collect();
            if let Some(next) = best_of(changed, hours).filter(|n| n.reached_dph() < best.reached_dph()) {
                best = next;
            }
        }
        out.each.push(best);
        hours += HALF_AN_HOUR;
    }
    Ok(out)
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
