//! `hrg effects`: the effects of the library.

use anyhow::Result;
use clap::Args;
use hrg_core::effects::{EffectId, Facts, Reach, ALL};
use hrg_data::cards::card;
use hrg_data::error::BadInput;
use hrg_identify::trace::equations::equation;

/// Arguments of `hrg effects`.
#[derive(Args)]
pub struct Arguments {
    /// Names of effects; by default all.
    names: Vec<String>,
}

/// Runs the command.
///
/// # Errors
/// A name that no effect has.
pub fn run(arguments: &Arguments) -> Result<()> {
    let mut shown: Vec<&Facts> = Vec::new();
    for name in &arguments.names {
        let effect = EffectId::by_name(name).ok_or_else(|| {
            let all: Vec<&str> = ALL.iter().map(|f| f.name).collect();
            BadInput::new(format!("{name}: no effect of that name; there are {}", all.join(", ")))
        })?;
        shown.push(effect.facts());
    }
    if shown.is_empty() {
        shown.extend(ALL);
    }
    for (k, facts) in shown.into_iter().enumerate() {
        if k > 0 {
            println!();
        }
        let reach = match facts.reach {
            Reach::Unit => "the unit compensates it".into(),
            Reach::NeedsInput(what) => format!("the unit compensates it where {what} comes in as an input"),
            Reach::NeedsChamber(what) => format!("needs {what}; no unit compensates it"),
            Reach::Unpredictable => "no unit can predict it".into(),
        };
        println!("{} ({}; {reach})", facts.name, card(facts.effect).class.name());
        if !facts.parameters.is_empty() {
            println!("  parameters: {}", facts.parameters.join(", "));
        }
        for line in wrapped(&equation(facts.effect), 96) {
            println!("  {line}");
        }
    }
    Ok(())
}

/// A text in lines of `width` characters at most.
fn wrapped(text: &str, width: usize) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split(' ') {
        let line = lines.last_mut().filter(|l| l.is_empty() || l.chars().count() + 1 + word.chars().count() <= width);
        match line {
            Some(line) if line.is_empty() => line.push_str(word),
            Some(line) => {
                line.push(' ');
                line.push_str(word);
            }
            None => lines.push(word.to_string()),
        }
    }
    lines
}
