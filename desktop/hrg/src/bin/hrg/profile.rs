//! `hrg profile`: which chamber profile tells the effects apart.

use crate::wait::with_a_bar;
use anyhow::Result;
use clap::Args;
use hrg::profiles;
use hrg_core::effects::EffectId;
use hrg_data::cards::parted;
use hrg_data::error::BadInput;
use hrg_data::load::load_recording;
use hrg_identify::family::Family;
use hrg_identify::trace::separable;
use hrg_simulate::{Leg, Profile, PROFILES};
use std::path::{Path, PathBuf};

/// Arguments of `hrg profile`.
#[derive(Args)]
pub struct Arguments {
    /// Effects to be told apart, separated by commas; by default those that a unit can compensate.
    #[arg(long = "for", value_delimiter = ',')]
    wanted: Vec<String>,
    /// The scheme of a rate table for scale factors and misalignments; with --check, what a run on one tells apart.
    #[arg(long, conflicts_with_all = ["wanted", "profile"])]
    rates: bool,
    /// Judge this recording instead of the named profiles. Several are judged together.
    #[arg(long)]
    check: Vec<PathBuf>,
    /// Design the shortest run for the next unit of this family (hrg family).
    #[arg(long, value_name = "FAMILY", conflicts_with_all = ["wanted", "rates", "check", "profile"])]
    prior: Option<PathBuf>,
    /// With --prior: standard uncertainty of the bias that is enough, about its constant, deg/h.
    #[arg(long, requires = "prior", default_value_t = 0.1)]
    limit: f64,
    /// With --prior: coldest temperature of the chamber, C; by default that of the family.
    #[arg(long, requires = "prior", allow_negative_numbers = true)]
    from: Option<f64>,
    /// With --prior: hottest temperature of the chamber, C; by default that of the family.
    #[arg(long, requires = "prior", allow_negative_numbers = true)]
    to: Option<f64>,
    /// With --prior: the chamber's fastest ramp, C/min.
    #[arg(long, requires = "prior", default_value_t = 2.0)]
    ramp: f64,
    /// With --prior: temperature at power-on, C.
    #[arg(long, requires = "prior", default_value_t = 20.0, allow_negative_numbers = true)]
    start: f64,
    /// With --prior: longest run, h.
    #[arg(long, requires = "prior", default_value_t = 8.0)]
    hours: f64,
    /// Judge this profile, written out like 20,-40@1,2h,50@1,2h
    #[arg(long, allow_hyphen_values = true)]
    profile: Option<String>,
}

/// Runs the command.
///
/// # Errors
/// Bad input, or a file that cannot be written.
pub fn run(arguments: Arguments) -> Result<()> {
    if let Some(prior) = &arguments.prior {
        return designed(prior, &arguments);
    }
    let Arguments { wanted, rates, check, profile, .. } = arguments;
    if rates {
        return crate::rates::profile(&check);
    }
    let known = parted();
    let one = |w: &String| {
        EffectId::by_name(w).filter(|e| known.contains(e)).ok_or_else(|| {
            let names: Vec<&str> = known.iter().map(|e| e.name()).collect();
            BadInput::new(format!("effect \"{w}\" is not one that a profile parts; there are {}", names.join(", ")))
        })
    };
    let wanted: Vec<EffectId> =
        if wanted.is_empty() { known.clone() } else { wanted.iter().map(one).collect::<Result<_, _>>()? };
    if !check.is_empty() {
        let recordings = check.iter().map(|p| load_recording(p)).collect::<Result<Vec<_>>>()?;
        let verdicts = separable::judge(&recordings, &wanted)?;
        say(&verdicts);
        let rest = separable::not_separable(&verdicts);
        if rest.is_empty() {
            println!("this data tells all of them apart, from two noise floors up");
        } else {
            println!("not told apart here: {}; hrg profile shows which runs would", rest.join("; "));
        }
        return Ok(());
    }
    if let Some(text) = profile {
        let p = Profile::parse(&text)?;
        say(&profiles::judge(&p, &wanted)?);
        println!("{}", in_words(&p));
        return Ok(());
    }
    println!("{:<9} {:>6}   not told apart, from two noise floors up", "profile", "hours");
    let mut judged = Vec::new();
    for (name, text) in PROFILES {
        let one = profiles::Judged::new(name, Profile::parse(text)?, &wanted);
        let hours = one.hours;
        match &one.not_separable {
            Ok(rest) => {
                println!("{name:<9} {hours:>6.1}   {}", if rest.is_empty() { "-".into() } else { rest.join("; ") });
            }
            Err(e) => println!("{name:<9} {hours:>6.1}   cannot be used: {e}"),
        }
        judged.push(one);
    }
    if let Some(best) = profiles::best(&judged) {
        println!("\nbest of those that go both ways over 60 C and more: {}. {}", best.name, in_words(&best.profile));
    }
    Ok(())
}

/// Longest run that is designed, h.
const MOST_HOURS: f64 = 48.0;
/// Fastest ramp of a chamber, C per minute.
const FASTEST_CHAMBER_C_PER_MIN: f64 = 30.0;

/// Tests what is wanted of a run for a family.
fn wanted_of(family: &Family, wanted: &profiles::Wanted) -> Result<(), BadInput> {
    let [low, high] = family.temperatures_c.map(f64::from);
    let [from, to] = wanted.temperatures_c;
    let known = low - 5.0..=high + 5.0;
    let at = |option: &str, wants: String| Err(BadInput(format!("{option}: {wants}")));
    if !(known.contains(&from) && known.contains(&to) && to - from >= 10.0) {
        let name = &family.name;
        return at(
            "--from, --to",
            format!("at least 10 C within {low:.0} to {high:.0} C, where the family {name} was learnt"),
        );
    }
    if !known.contains(&wanted.start_c) {
        return at("--start", format!("a temperature within {low:.0} to {high:.0} C, where the family was learnt"));
    }
    if !(wanted.limit_dph > 0.0 && wanted.limit_dph.is_finite()) {
        return at("--limit", "deg/h, above zero".into());
    }
    if !(0.5..=MOST_HOURS).contains(&wanted.most_hours) {
        return at("--hours", format!("0.5 to {MOST_HOURS} h"));
    }
    if !(wanted.fastest_c_per_min > 0.0 && wanted.fastest_c_per_min <= FASTEST_CHAMBER_C_PER_MIN) {
        return at("--ramp", format!("above zero, and {FASTEST_CHAMBER_C_PER_MIN} C per minute at the most"));
    }
    Ok(())
}

/// `hrg profile --prior`: the run for the next unit of a family.
fn designed(prior: &Path, arguments: &Arguments) -> Result<()> {
    let family = hrg::fleet::read_family(prior)?;
    let [low, high] = family.temperatures_c.map(f64::from);
    let wanted = profiles::Wanted {
        temperatures_c: [arguments.from.unwrap_or(low), arguments.to.unwrap_or(high)].map(f64::round),
        fastest_c_per_min: arguments.ramp,
        start_c: arguments.start,
        limit_dph: arguments.limit,
        most_hours: arguments.hours,
    };
    wanted_of(&family, &wanted)?;
    let found = with_a_bar("designing the run", || profiles::design(&family, &wanted))?;
    let each = |v: [f64; 3]| v.map(|v| format!("{v:>8.3}")).join("");
    println!("expected uncertainty of the bias about its constant, deg/h, of the best run of each duration");
    println!("{:>6}{:>8}{:>8}{:>8}   profile", "hours", "x", "y", "z");
    println!("{:>6.1}{}   (before any run)", 0.0, each(found.before_dph));
    for d in &found.each {
        println!("{:>6.1}{}   {}", d.hours, each(d.expected_dph), d.profile);
    }
    println!("the constant differs from day to day by{} deg/h, which no run makes less", each(family.days_dph()));
    let Some(last) = found.each.last() else {
        return Err(BadInput::new("--hours: half an hour at the least").into());
    };
    let (limit, reached) = (wanted.limit_dph, last.reached_dph());
    if reached <= limit {
        println!("the limit of {limit} deg/h is reached: --profile {}", last.profile);
    } else {
        println!(
            "the limit of {limit} deg/h is NOT reached within {} h, {reached:.3} is: --profile {}",
            wanted.most_hours, last.profile
        );
    }
    println!("{}", in_words(&last.profile));
    Ok(())
}

fn say(verdicts: &[separable::Verdict]) {
    println!("{:<20} {:>22}   taken for", "effect", "left by the baseline");
    for v in verdicts {
        let taken: Vec<String> = v.taken_for.iter().map(|(n, s)| format!("{n} ({:.1} %)", 100.0 * s)).collect();
        let note = match (v.left_by_baseline < separable::SEEN, taken.is_empty()) {
            (true, _) => "hidden in the baseline: not seen, and no harm".to_string(),
            (false, true) => "-".to_string(),
            (false, false) => taken.join(", "),
        };
        println!("{:<20} {:>20.1} %   {note}", v.name, 100.0 * v.left_by_baseline);
    }
}

/// A profile as a test engineer sets it.
fn in_words(p: &Profile) -> String {
    let mut t = p.start_c;
    let mut parts = vec![format!("Begin at {t} C, power on")];
    for leg in &p.legs {
        parts.push(match leg {
            Leg::Ramp(to, rate) => {
                let text = format!("ramp to {to} C at {rate} C/min ({:.0} min)", (to - t).abs() / rate);
                t = *to;
                text
            }
            Leg::Soak(s) => format!("soak {:.0} min", s / 60.0),
            Leg::SetPoint(to) => {
                t = *to;
                format!("set the chamber to {to} C and let it come there")
            }
            Leg::UntilGyros(wanted) => format!("hold until every gyro reads {wanted} C"),
        });
    }
    format!("{}; {:.1} h in all", parts.join(", "), p.temperatures().len() as f64 / 3600.0)
}
