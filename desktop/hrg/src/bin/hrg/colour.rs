//! Colours by meaning, where standard output is a terminal and the user has not switched them off (`NO_COLOR`, `CLICOLOR=0`, `TERM=dumb`).

use anstream::{AutoStream, ColorChoice};
use anstyle::{AnsiColor, Style};

/// Meaning of a word.
#[derive(Clone, Copy)]
pub enum Meaning {
    /// As wished: green.
    Good,
    /// Not as wished: red.
    Bad,
    /// Not known, or to be looked at: yellow.
    Open,
}

impl Meaning {
    fn style(self) -> Style {
        let of = |colour: AnsiColor| colour.on_default().bold();
        match self {
            Self::Good => of(AnsiColor::Green),
            Self::Bad => of(AnsiColor::Red),
            Self::Open => of(AnsiColor::Yellow),
        }
    }
}

/// A word in the colour of its meaning; as it is where colours are off.
pub fn paint(word: &str, meaning: Meaning) -> String {
    if AutoStream::choice(&std::io::stdout()) == ColorChoice::Never {
        return word.to_string();
    }
    let style = meaning.style();
    format!("{style}{word}{style:#}")
}

/// A text with the words that have a meaning painted: PASS and FAIL of a judgement, the first words of a trace.
pub fn painted(text: &str) -> String {
    let mut out = text.to_string();
    for (word, meaning) in [
        ("NOT COVERED", Meaning::Open),
        ("PASS", Meaning::Good),
        ("FAIL", Meaning::Bad),
        ("Do not burn", Meaning::Open),
        ("Burn ", Meaning::Good),
    ] {
        out = out.replace(word, &paint(word, meaning));
    }
    out
}
