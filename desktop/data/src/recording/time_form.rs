//! Forms of a time in other programs' files: numbers, dates, patterns.

use super::dialect::number;
use chrono::{DateTime, NaiveDate, NaiveDateTime, NaiveTime};

/// Form of a time.
#[derive(Debug, Clone, PartialEq)]
pub enum TimeForm {
    /// A number, each of so many seconds.
    Number(f64),
    /// Seconds since 1970.
    Unix,
    /// `2026-11-21T10:15:00`, with or without fraction and zone (without: UTC), or a blank for the T.
    Iso,
    /// A pattern like `%d.%m.%Y %H:%M:%S`; without a date, days are counted where the time goes back to the morning.
    Pattern(String),
}

/// The forms in a sentence.
pub const FORMS: &str = "s, ms, us, ns, min, h, unix, iso and patterns like %d.%m.%Y %H:%M:%S,%f";

/// Patterns of dates that programs write, the likeliest first.
const DATES: [&str; 10] = [
    "%Y-%m-%d", "%d.%m.%Y", "%d/%m/%Y", "%m/%d/%Y", "%Y/%m/%d", "%d-%m-%Y", "%d.%m.%y", "%Y%m%d", "%d-%b-%Y",
    "%d %b %Y",
];
/// Patterns of times of day.
const TIMES: [&str; 9] = [
    "%H:%M:%S",
    "%H:%M:%S.%f",
    "%H:%M:%S,%f",
    "%H:%M:%S:%f",
    "%I:%M:%S %p",
    "%I:%M:%S.%f %p",
    "%I:%M:%S,%f %p",
    "%H:%M",
    "%M:%S",
];
/// Between a date and a time of day.
const BETWEEN: [&str; 4] = [" ", "T", "-", ", "];

/// Seconds since 1970 of the times from 2000 to 2060: a number among them counts from 1970. (LabVIEW counts from 1904.)
const OF_OUR_DAYS: std::ops::Range<f64> = 9.4e8..2.9e9;

/// Seconds of a day.
pub const DAY_S: f64 = 86_400.0;

impl TimeForm {
    /// By name, or a pattern with %.
    #[must_use]
    pub fn parse(text: &str) -> Option<Self> {
        Some(match text {
            "s" => Self::Number(1.0),
            "ms" => Self::Number(1e-3),
            "us" => Self::Number(1e-6),
            "ns" => Self::Number(1e-9),
            "min" => Self::Number(60.0),
            "h" => Self::Number(3600.0),
            "unix" => Self::Unix,
            "iso" => Self::Iso,
            pattern if pattern.contains('%') => Self::Pattern(pattern.into()),
            _ => return None,
        })
    }

    /// Its name in a sentence.
    #[must_use]
    pub fn name(&self) -> String {
        match self {
            Self::Number(_) | Self::Unix => "of a number".into(),
            Self::Iso => "2026-11-21T10:15:00".into(),
            Self::Pattern(p) => p.clone(),
        }
    }

    /// Seconds on the clock of the file; `None` where the text is no time of this form.
    #[must_use]
    pub fn read(&self, text: &str) -> Option<f64> {
        let seconds = |t: NaiveDateTime| t.and_utc().timestamp_micros() as f64 * 1e-6;
        match self {
            Self::Number(_) | Self::Unix => number(text).map(|t| self.of_number(t)),
            Self::Iso => DateTime::parse_from_rfc3339(&text.replacen(' ', "T", 1))
                .map(|t| seconds(t.naive_utc()))
                .or_else(|_| {
                    NaiveDateTime::parse_from_str(&text.replacen(' ', "T", 1), "%Y-%m-%dT%H:%M:%S%.f").map(seconds)
                })
                .ok(),
            Self::Pattern(p) => {
                // (A fraction is %f after a point, as Python writes it, or after a comma or a colon.)
                let mark = [",%f", ":%f"].into_iter().find(|f| p.contains(f));
                let pattern = p.replace(",%f", "%.f").replace(":%f", "%.f").replace(".%f", "%.f");
                let text = match mark.and_then(|m| text.rfind(&m[..1])) {
                    Some(at) => format!("{}.{}", &text[..at], &text[at + 1..]),
                    None => text.to_string(),
                };
                if p.contains('z') {
                    return DateTime::parse_from_str(&text, &pattern).map(|t| seconds(t.naive_utc())).ok();
                }
                NaiveDateTime::parse_from_str(&text, &pattern)
                    .map(seconds)
                    .or_else(|_| {
                        NaiveTime::parse_from_str(&text, &pattern)
                            .map(|t| (t - NaiveTime::MIN).num_microseconds().map_or(f64::NAN, |us| us as f64 * 1e-6))
                    })
                    .ok()
                    .or_else(|| counted(p, &text))
            }
        }
        .filter(|t: &f64| t.abs() < 1e13)
    }

    /// Seconds of a number.
    #[must_use]
    pub fn of_number(&self, t: f64) -> f64 {
        match self {
            Self::Number(unit) if *unit < 1.0 => t / (1.0 / unit).round(),
            Self::Number(unit) => t * unit,
            _ => t,
        }
    }

    /// `true` if times of this form are numbers.
    #[must_use]
    pub fn is_number(&self) -> bool {
        matches!(self, Self::Number(_) | Self::Unix)
    }

    /// `true` if its seconds count from 1970.
    #[must_use]
    pub fn absolute(&self) -> bool {
        match self {
            Self::Number(_) => false,
            Self::Unix | Self::Iso => true,
            Self::Pattern(p) => ["%Y", "%y", "%F", "%D", "%x", "%c", "%s", "%+"].iter().any(|d| p.contains(d)),
        }
    }

    /// `true` if times of this form that begin with `first_s` count from 1970.
    #[must_use]
    pub fn counts_from_1970(&self, first_s: f64) -> bool {
        self.absolute() || matches!(self, Self::Number(_)) && OF_OUR_DAYS.contains(&first_s)
    }

    /// `true` if it is the time of a day without its date: it goes back at midnight.
    #[must_use]
    pub fn of_a_day(&self) -> bool {
        matches!(self, Self::Pattern(_)) && !self.absolute()
    }

    /// Seconds after which a clock without a date begins again.
    fn period_s(&self) -> f64 {
        match self {
            Self::Pattern(p) if p.starts_with("%M") => 3600.0,
            _ => DAY_S,
        }
    }

    /// The name of a form that fits all of some texts which are no numbers; `true` if day and month might be changed about.
    #[must_use]
    pub fn guess(texts: &[&str]) -> Option<(String, bool)> {
        let fits = |form: &Self| !texts.is_empty() && texts.iter().all(|t| form.read(t).is_some());
        if fits(&Self::Iso) {
            return Some(("iso".into(), false));
        }
        let both = DATES
            .iter()
            .flat_map(|d| BETWEEN.iter().flat_map(move |b| TIMES.iter().map(move |t| format!("{d}{b}{t}"))));
        let all: Vec<String> =
            both.chain(TIMES.map(String::from)).filter(|p| fits(&Self::Pattern(p.clone()))).collect();
        let first = all.first()?;
        let other = first.replace("%d/%m", "%m/%d");
        if other == *first || !all.contains(&other) {
            return Some((first.clone(), false));
        }
        // Day and month might be changed about: a run lasts hours or days, and no month.
        let span = |p: &String| {
            let form = Self::Pattern(p.clone());
            let times: Vec<f64> = texts.iter().filter_map(|t| form.read(t)).collect();
            let steps = times.windows(2).map(|w| (w[1] - w[0]).abs());
            steps.fold(0.0, f64::max)
        };
        let (own, others) = (span(first), span(&other));
        Some(if others < own { (other, false) } else { (first.clone(), own == others) })
    }

    /// The pattern of dates without a time of day that fits all of some texts.
    #[must_use]
    pub fn guess_date(texts: &[&str]) -> Option<&'static str> {
        let fits = |p: &&str| !texts.is_empty() && texts.iter().all(|t| NaiveDate::parse_from_str(t, p).is_ok());
        // (Of two orders of day and month the one in which the days follow each other.)
        let span = |p: &&str| {
            let days: Vec<NaiveDate> = texts.iter().filter_map(|t| NaiveDate::parse_from_str(t, p).ok()).collect();
            days.windows(2).map(|w| (w[1] - w[0]).num_days().abs()).max().unwrap_or(0)
        };
        DATES.into_iter().filter(fits).min_by_key(span)
    }
}

/// Hours, minutes and seconds that count on past a day, or minutes and seconds past an hour: no clock's, but elapsed.
fn counted(pattern: &str, text: &str) -> Option<f64> {
    let places = match pattern {
        "%H:%M:%S" | "%H:%M:%S.%f" | "%H:%M:%S,%f" => 3,
        "%M:%S" | "%M:%S.%f" => 2,
        _ => return None,
    };
    let parts: Vec<f64> = text.split(':').map(|p| p.parse().ok().filter(|v: &f64| *v >= 0.0)).collect::<Option<_>>()?;
    let in_range = parts.iter().skip(1).all(|p| *p < 60.0) && parts[0].fract() == 0.0;
    (parts.len() == places && in_range).then(|| parts.iter().fold(0.0, |s, p| 60.0 * s + p))
}

/// Times of day made to go on after midnight.
#[derive(Debug, Default)]
pub struct Days {
    days_s: f64,
    before_s: Option<f64>,
}

impl Days {
    /// The next time, of a clock that begins again each day, or each hour.
    pub fn next(&mut self, time_s: f64, form: &TimeForm) -> f64 {
        let period_s = form.period_s();
        if self.before_s.is_some_and(|b| time_s < b - 0.5 * period_s) {
            self.days_s += period_s;
        }
        self.before_s = Some(time_s);
        time_s + self.days_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn forms_that_programs_write_are_guessed_and_read() {
        for (texts, form) in [
            (["2026-11-20T07:30:00", "2026-11-20 07:30:00.5"], "iso"),
            (["20.11.2026 07:30:00,0", "20.11.2026 07:30:00,5"], "%d.%m.%Y %H:%M:%S,%f"),
            (["20/10/2024-01:18:45", "20/10/2024-01:19:00"], "%d/%m/%Y-%H:%M:%S"),
            (["07:30:00", "07:30:01"], "%H:%M:%S"),
            (["11/20/2026 7:30:00 AM", "11/20/2026 1:30:00 PM"], "%m/%d/%Y %I:%M:%S %p"),
        ] {
            assert_eq!(TimeForm::guess(&texts), Some((form.to_string(), false)), "{texts:?}");
            let form = TimeForm::parse(form).expect("a form");
            assert!(form.read(texts[1]) > form.read(texts[0]), "{texts:?}");
        }
        assert_eq!(TimeForm::guess(&["03/04/2026 07:30:00"]).map(|g| g.1), Some(true));
        assert_eq!((TimeForm::guess(&["12.5"]), TimeForm::guess(&[])), (None, None));
        assert_eq!(TimeForm::guess_date(&["20.11.2026"]), Some("%d.%m.%Y"));
        let form = TimeForm::Pattern("%d.%m.%Y %H:%M:%S,%f".into());
        assert_eq!(form.read("20.11.2026 07:30:00,25"), TimeForm::Iso.read("2026-11-20T07:30:00.25"));
        let ms = TimeForm::parse("ms").expect("a form");
        assert_eq!(ms.read("1732087800123"), Some(1_732_087_800.123));
        assert!(ms.counts_from_1970(1_732_087_800.0) && !ms.counts_from_1970(5000.0) && TimeForm::parse("x").is_none());
        let next = |form: &str, times: [&str; 3]| {
            let (form, mut days) = (TimeForm::parse(form).expect("a form"), Days::default());
            times.map(|t| days.next(form.read(t).expect("a time"), &form))
        };
        assert_eq!(next("%H:%M:%S", ["23:59:59", "00:00:01", "00:00:02"]), [86_399.0, 86_401.0, 86_402.0]);
        assert_eq!(next("%M:%S", ["59:59", "00:01", "00:02"]), [3599.0, 3601.0, 3602.0]);
        for (texts, form) in [
            (["03/04/2026 08:15:00.500 AM", "03/04/2026 08:15:01.000 AM"], "%d/%m/%Y %I:%M:%S.%f %p"),
            (["03/04/2026 23:59:59", "03/05/2026 00:00:00"], "%m/%d/%Y %H:%M:%S"),
            (["17-Mar-2026 10:20:01", "17-Mar-2026 10:20:02"], "%d-%b-%Y %H:%M:%S"),
            (["2026/03/17 10:20:01:000", "2026/03/17 10:20:01:500"], "%Y/%m/%d %H:%M:%S:%f"),
            (["59:59", "60:00"], "%M:%S"),
            (["23:59:59", "24:00:00"], "%H:%M:%S"),
        ] {
            assert_eq!(TimeForm::guess(&texts).map(|g| g.0), Some(form.to_string()), "{texts:?}");
            let read = |k: usize| TimeForm::parse(form).and_then(|f| f.read(texts[k])).expect("a time");
            assert!((0.4..1.1).contains(&(read(1) - read(0))), "{texts:?}");
        }
        assert_eq!(TimeForm::guess_date(&["03/04/2026", "03/05/2026"]), Some("%m/%d/%Y"));
        assert_eq!(TimeForm::guess(&["24:01", "59:59"]).map(|g| g.0), Some("%M:%S".to_string()));
    }
}
