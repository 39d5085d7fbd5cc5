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

/// The result of a library, or its panic, of which nothing is printed: for readers of other people's formats that fail on defective files.
///
/// # Errors
/// The panic.
pub fn caught<T>(job: impl FnOnce() -> T) -> std::thread::Result<T> {
    let printed = std::panic::take_hook();
    std::panic::set_hook(Box::new(|_| {}));
    let result = std::panic::catch_unwind(std::panic::AssertUnwindSafe(job));
    std::panic::set_hook(printed);
    result
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
