//! Bad input, and how a program ends.

/// An input that cannot be used: one sentence that says what, where and what to do. Exit status 2.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct BadInput(pub String);

impl BadInput {
    /// From a sentence.
    pub fn new(sentence: impl Into<String>) -> Self {
        Self(sentence.into())
    }
}

/// "a, b and c".
#[must_use]
pub fn list<S: AsRef<str>>(names: &[S]) -> String {
    match names {
        [] => "nothing".into(),
        [one] => one.as_ref().into(),
        [rest @ .., last] => {
            let rest: Vec<&str> = rest.iter().map(AsRef::as_ref).collect();
            format!("{} and {}", rest.join(", "), last.as_ref())
        }
    }
}

/// Exit code of a program: 0 done, 2 bad input, 1 internal; the error is one line on standard error. `bad_input`: `true` for the error
/// types of other crates that are bad input, too.
#[must_use]
pub fn exit(
    program: &str,
    result: anyhow::Result<()>,
    bad_input: fn(&anyhow::Error) -> bool,
) -> std::process::ExitCode {
    match result {
        Ok(()) => std::process::ExitCode::SUCCESS,
        Err(e) => {
            eprintln!("{program}: {e:#}");
            std::process::ExitCode::from(if e.is::<BadInput>() || bad_input(&e) { 2 } else { 1 })
        }
    }
}
