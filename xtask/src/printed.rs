//! The last line of each page that a command prints: which command, at which commit, and the short form of what the program computed then
//! (`hrg-study short-form`). A test compares the short form with today's program (host-tests/tests/all/docs.rs): a page whose figures are those
//! of another program fails it.

use crate::{output, root, Failure};
use std::process::Command;

/// Beginning of the line.
const BEGIN: &str = "<!-- printed by `";

/// Writes the line into pages. `of_traces`: their figures come from traces, which have a short form.
pub fn stamp(pages: &[&str], command: &str, of_traces: bool) -> Result<(), Failure> {
    let git = |arguments: &[&str]| output(Command::new("git").args(arguments).current_dir(root()));
    let commit = git(&["rev-parse", "--short=7", "HEAD"]).map_or("unknown".into(), |c| c.trim().to_string());
    let short = if of_traces {
        let study = root().join("target/release/hrg-study");
        let form = output(Command::new(&study).arg("short-form"))
            .ok_or_else(|| Failure(format!("{} short-form failed", study.display())))?;
        format!(", short form {}", form.trim())
    } else {
        String::new()
    };
    for page in pages {
        let path = root().join(page);
        let failed = |e: std::io::Error| Failure(format!("{}: {e}", path.display()));
        let text = std::fs::read_to_string(&path).map_err(failed)?;
        let kept: Vec<&str> = text.lines().filter(|l| !l.starts_with(BEGIN)).collect();
        let text = format!("{}\n\n{BEGIN}{command}` at commit {commit}{short} -->\n", kept.join("\n").trim_end());
        std::fs::write(&path, text).map_err(failed)?;
    }
    Ok(())
}
