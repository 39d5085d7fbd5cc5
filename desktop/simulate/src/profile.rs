//! Profiles of a chamber: where it starts, its ramps and soaks.

use super::plant::Plant;
use hrg_data::error::BadInput;
use std::fmt;

/// One leg of a chamber profile.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Leg {
    /// Drive to a temperature (C) at a rate (C per minute).
    Ramp(f64, f64),
    /// Hold for a time (s).
    Soak(f64),
    /// Let the chamber go to a temperature (C) by itself: its set point jumps.
    SetPoint(f64),
    /// Hold until every resonator has come to a temperature (C).
    UntilGyros(f64),
}

/// Time constant of the first-order lag of a simulated chamber behind its set point, s. (dong2023 prints no rate of its chamber.)
const CHAMBER_TAU_S: f64 = 900.0;
/// It is there when it is so near, C.
const THERE_C: f64 = 0.1;
/// Longest wait for the gyros, s.
const LONGEST_WAIT_S: usize = 86_400;

/// A chamber profile: where it starts (C), and its legs.
#[derive(Debug, Clone, PartialEq)]
pub struct Profile {
    /// Temperature at the start, in equilibrium, C.
    pub start_c: f64,
    /// Legs in order.
    pub legs: Vec<Leg>,
}

/// Temperatures that chambers for such tests reach, C.
pub const CHAMBERS_C: std::ops::RangeInclusive<f64> = -100.0..=200.0;

/// Profiles with a name.
pub const PROFILES: [(&str, &str); 12] = [
    ("dong", "25,-40@1,5h,50@1,1h"),
    ("dong2023", "25,-40@set,5h,50@1,until gyros=50"),
    ("cycle", "20,-40@1,110m,50@1,110m,20@1,20m"),
    ("verify", "20,50@0.8,100m,-35@1.2,2h,30@0.6,1h,-10@1,90m"),
    ("stairs", "20,-40@1,1h,-20@1,1h,0@1,1h,20@1,1h,40@1,1h,50@1,40m,0@1,40m"),
    ("ramps", "20,50@0.5,30m,-40@1.5,40m,50@3,40m,-40@3,40m,20@1,30m"),
    ("fast", "10,40@4,6m,-10@5,10m,45@5,10m,10@3"),
    ("zhao", "0,5h,60@5,100m"),
    ("wu", "20,-40@1,1h,60@1,1h,20@1,30m"),
    ("lag", "0,5h,10@5,5h"),
    ("up", "-40,2h,50@1,2h"),
    (
        "soaks",
        "25,-40@set,5h,-30@set,5h,-20@set,5h,-10@set,5h,0@set,5h,10@set,5h,20@set,5h,30@set,5h,40@set,5h,50@set,5h",
    ),
];

/// A time such as `5h`, `90m` or `600s`, in seconds.
#[must_use]
pub fn duration_s(text: &str) -> Option<f64> {
    let unit_s = match text.chars().last()? {
        'h' => 3600.0,
        'm' => 60.0,
        's' => 1.0,
        _ => return None,
    };
    text[..text.len() - 1].parse::<f64>().ok().map(|n| n * unit_s).filter(|s| *s >= 0.0)
}

/// Longest profile, h: six weeks.
const MOST_HOURS: f64 = 1000.0;

impl Profile {
    /// A named profile, or one written out: start temperature, then `TARGET@RATE` (C, C per minute), `TARGET@set` (the chamber goes
    /// there by itself), soaks (`90m`, `5h`, `600s`) and `until gyros=TEMPERATURE`, separated by commas.
    ///
    /// # Errors
    /// A sentence that names the leg.
    pub fn parse(text: &str) -> Result<Self, BadInput> {
        let text = PROFILES.iter().find(|(n, _)| *n == text).map_or(text, |(_, t)| t);
        let bad = |leg: &str| {
            BadInput::new(format!(
                "profile: \"{leg}\" is neither a start temperature, a ramp like -40@1 or -40@set, a soak like 90m, nor like until gyros=50; named ones are {}",
                PROFILES.map(|(n, _)| n).join(", ")
            ))
        };
        let mut parts = text.split(',').map(str::trim);
        let first = parts.next().unwrap_or("");
        let start_c: f64 = first.parse().map_err(|_| bad(first))?;
        let mut legs = Vec::new();
        for leg in parts {
            legs.push(if let Some(target) = leg.strip_prefix("until gyros=") {
                Leg::UntilGyros(target.parse().map_err(|_| bad(leg))?)
            } else if let Some(target) = leg.strip_suffix("@set") {
                Leg::SetPoint(target.parse().map_err(|_| bad(leg))?)
            } else if let Some((target, rate)) = leg.split_once('@') {
                let rate: f64 = rate.parse().map_err(|_| bad(leg))?;
                if !(rate > 0.0) {
                    return Err(bad(leg));
                }
                Leg::Ramp(target.parse().map_err(|_| bad(leg))?, rate)
            } else {
                Leg::Soak(duration_s(leg).ok_or_else(|| bad(leg))?)
            });
        }
        if legs.is_empty() {
            return Err(BadInput(format!(
                "profile: behind the start temperature {text} come soaks and ramps, like {text},2h or {text},50@1,2h"
            )));
        }
        let profile = Self { start_c, legs };
        let beyond = profile.targets_c().find(|t| !CHAMBERS_C.contains(t));
        if let Some(t) = beyond {
            let (least, most) = (CHAMBERS_C.start(), CHAMBERS_C.end());
            return Err(BadInput(format!(
                "profile: no chamber goes to {t} C; give temperatures from {least} to {most} C"
            )));
        }
        let (_, hours) = profile.legs.iter().fold((start_c, 0.0), |(now_c, hours), leg| match leg {
            Leg::Ramp(target_c, rate) => (*target_c, hours + (target_c - now_c).abs() / rate / 60.0),
            Leg::Soak(s) => (now_c, hours + s / 3600.0),
            Leg::SetPoint(target_c) | Leg::UntilGyros(target_c) => (*target_c, hours),
        });
        if !(hours <= MOST_HOURS) {
            return Err(BadInput::new(format!(
                "profile: it takes {hours:.0} h; a run takes {MOST_HOURS} h at the most"
            )));
        }
        match profile.walk().1 {
            Some(never) => Err(BadInput::new(format!(
                "profile: the gyros never come to {never} C there, a day long; let the chamber go further before \"until gyros={never}\""
            ))),
            None => Ok(profile),
        }
    }

    /// Temperatures that it names, C.
    fn targets_c(&self) -> impl Iterator<Item = f64> {
        let of = |leg: &Leg| match leg {
            Leg::Ramp(t, _) | Leg::SetPoint(t) | Leg::UntilGyros(t) => Some(*t),
            Leg::Soak(_) => None,
        };
        std::iter::once(self.start_c).chain(self.legs.iter().filter_map(of))
    }

    /// End of the profile if the gyros' readings decide it: the temperature, C.
    #[must_use]
    pub fn ends_by_gyros(&self) -> Option<f64> {
        match self.legs.last() {
            Some(Leg::UntilGyros(t)) => Some(*t),
            _ => None,
        }
    }

    /// Chamber temperature each second; how long the gyros take is that of the simulated unit.
    #[must_use]
    pub fn temperatures(&self) -> Vec<f64> {
        self.walk().0
    }

    /// The temperatures, and the first one that the gyros are waited for in vain.
    fn walk(&self) -> (Vec<f64>, Option<f64>) {
        let mut out = vec![self.start_c];
        let mut t = self.start_c;
        for leg in &self.legs {
            match *leg {
                Leg::Ramp(target, rate) => {
                    let steps = ((target - t).abs() / rate * 60.0).ceil();
                    let from = t;
                    for k in 1..=steps as usize {
                        out.push(from + (target - from) * k as f64 / steps);
                    }
                    t = target;
                }
                Leg::Soak(s) => out.extend(std::iter::repeat_n(t, s as usize)),
                Leg::SetPoint(target) => {
                    let (from, mut k) = (t, 0.0);
                    while (t - target).abs() > THERE_C {
                        k += 1.0;
                        t = target + (from - target) * f64::exp(-k / CHAMBER_TAU_S);
                        out.push(t);
                    }
                    t = target;
                }
                Leg::UntilGyros(wanted) => {
                    let from = out.len();
                    out.extend(std::iter::repeat_n(t, LONGEST_WAIT_S));
                    let gyros = Plant::new(&out).resonator_c;
                    let lowest = |k: usize| gyros.iter().map(|g| g[k]).fold(f64::INFINITY, f64::min);
                    let highest = |k: usize| gyros.iter().map(|g| g[k]).fold(f64::NEG_INFINITY, f64::max);
                    let rising = lowest(from - 1) < wanted;
                    let there = |k: usize| if rising { lowest(k) >= wanted } else { highest(k) <= wanted };
                    match (from - 1..out.len()).find(|k| there(*k)) {
                        Some(at) => out.truncate(at + 1),
                        None => return (out, Some(wanted)),
                    }
                }
            }
        }
        (out, None)
    }
}

impl fmt::Display for Profile {
    /// As [`Profile::parse`] reads it.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.start_c)?;
        for leg in &self.legs {
            match leg {
                Leg::Ramp(to, rate) => write!(f, ",{to}@{rate}")?,
                Leg::Soak(s) if s % 60.0 == 0.0 => write!(f, ",{}m", s / 60.0)?,
                Leg::Soak(s) => write!(f, ",{s}s")?,
                Leg::SetPoint(to) => write!(f, ",{to}@set")?,
                Leg::UntilGyros(wanted) => write!(f, ",until gyros={wanted}")?,
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn profiles_are_parsed_and_refused_with_the_leg() {
        for (name, _) in PROFILES {
            assert!(Profile::parse(name).expect("named").temperatures().len() > 600);
        }
        assert!(Profile::parse("20,50@x").expect_err("bad").0.contains("50@x"));
        assert!(Profile::parse("nothing").is_err());
        assert!(Profile::parse("20").expect_err("bad").0.contains("like 20,2h or"));
        for text in ["20,500@1,1h", "-300,1h", "20,nan@set,1h", "20,50@1,until gyros=inf"] {
            let error = Profile::parse(text).expect_err("bad").0;
            assert!(error.contains("no chamber goes to"), "{error}");
        }
        for (name, text) in PROFILES {
            let profile = Profile::parse(name).expect("named");
            assert_eq!(Profile::parse(&profile.to_string()).expect("as it is written"), profile, "{text}");
        }
        let p = Profile::parse("20,50@3,10m").expect("fine").temperatures();
        assert_eq!(p.len(), 1 + 600 + 600);
    }

    /// dong2023, section 4: cooled in set-point mode, five hours of soak, heated at 1 C/min until all gyros read 50 C.
    #[test]
    fn the_printed_profile_ends_by_the_gyros() {
        let profile = Profile::parse("dong2023").expect("named");
        assert_eq!(profile.ends_by_gyros(), Some(50.0));
        let chamber = profile.temperatures();
        let gyros = Plant::new(&chamber).resonator_c;
        let (end, before) = (chamber.len() - 1, chamber.len() - 2);
        assert!(gyros.iter().all(|g| g[end] >= 50.0) && gyros.iter().any(|g| g[before] < 50.0));
        let soaked = chamber.iter().filter(|t| **t == -40.0).count();
        assert!((18_000..18_060).contains(&soaked), "{soaked} s");
        // Cooling is no ramp: the chamber is fastest at its beginning.
        assert!(chamber[60] - chamber[120] > 2.0 * (chamber[1800] - chamber[1860]));
        assert!(Profile::parse("20,50@1,until gyros=90").expect_err("never").0.contains("never come to 90"));
        assert_eq!(Profile::parse("soaks").expect("named").legs.len(), 20);
    }
}
