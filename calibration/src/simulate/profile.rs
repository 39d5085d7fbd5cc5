//! Profiles of a chamber: where it starts, its ramps and soaks.

use crate::BadInput;

/// One leg of a chamber profile.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Leg {
    /// Drive to a temperature (C) at a rate (C per minute).
    Ramp(f64, f64),
    /// Hold for a time (s).
    Soak(f64),
}

/// A chamber profile: where it starts (C), and its legs.
#[derive(Debug, Clone, PartialEq)]
pub struct Profile {
    /// Temperature at the start, in equilibrium, C.
    pub start_c: f64,
    /// Legs in order.
    pub legs: Vec<Leg>,
}

/// Profiles with a name.
pub const PROFILES: [(&str, &str); 10] = [
    ("dong", "25,-40@1,5h,50@1,1h"),
    ("cycle", "20,-40@1,110m,50@1,110m,20@1,20m"),
    ("verify", "20,50@0.8,100m,-35@1.2,2h,30@0.6,1h,-10@1,90m"),
    ("stairs", "20,-40@1,1h,-20@1,1h,0@1,1h,20@1,1h,40@1,1h,50@1,40m,0@1,40m"),
    ("ramps", "20,50@0.5,30m,-40@1.5,40m,50@3,40m,-40@3,40m,20@1,30m"),
    ("fast", "10,40@4,6m,-10@5,10m,45@5,10m,10@3"),
    ("zhao", "0,5h,60@5,100m"),
    ("wu", "20,-40@1,1h,60@1,1h,20@1,30m"),
    ("lag", "0,5h,10@5,5h"),
    ("up", "-40,2h,50@1,2h"),
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

impl Profile {
    /// A named profile, or one written out: start temperature, then `TARGET@RATE` (C, C per minute) and soaks
    /// (`90m`, `5h`, `600s`), separated by commas.
    ///
    /// # Errors
    /// A sentence that names the leg.
    pub fn parse(text: &str) -> Result<Self, BadInput> {
        let text = PROFILES.iter().find(|(n, _)| *n == text).map_or(text, |(_, t)| t);
        let bad = |leg: &str| {
            BadInput::new(format!(
                "profile: \"{leg}\" is neither a start temperature, a ramp like -40@1, nor a soak like 90m; named ones are {}",
                PROFILES.map(|(n, _)| n).join(", ")
            ))
        };
        let mut parts = text.split(',').map(str::trim);
        let first = parts.next().unwrap_or("");
        let start_c: f64 = first.parse().map_err(|_| bad(first))?;
        let mut legs = Vec::new();
        for leg in parts {
            legs.push(if let Some((target, rate)) = leg.split_once('@') {
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
            return Err(bad(text));
        }
        Ok(Self { start_c, legs })
    }

    /// Chamber temperature each second.
    #[must_use]
    pub fn temperatures(&self) -> Vec<f64> {
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
            }
        }
        out
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
        let p = Profile::parse("20,50@3,10m").expect("fine").temperatures();
        assert_eq!(p.len(), 1 + 600 + 600);
    }
}
