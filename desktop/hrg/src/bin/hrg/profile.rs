//! `hrg profile`: which chamber profile tells the effects apart.

use anyhow::Result;
use clap::Args;
use hrg::profiles;
use hrg_core::effects::EffectId;
use hrg_data::cards::parted;
use hrg_data::error::BadInput;
use hrg_data::load::load_recording;
use hrg_identify::trace::separable;
use hrg_simulate::{Leg, Profile, PROFILES};
use std::path::PathBuf;

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
    /// Judge this profile, written out like 20,-40@1,2h,50@1,2h
    #[arg(long, allow_hyphen_values = true)]
    profile: Option<String>,
}

/// Runs the command.
///
/// # Errors
/// Bad input, or a file that cannot be written.
pub fn run(arguments: Arguments) -> Result<()> {
    let Arguments { wanted, rates, check, profile } = arguments;
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
