//! Runs what the pages tell a reader to type, in the page's own order, each page in an empty folder of its own; `$PROJECT` is a fresh clone.
//!
//! A command is a line of a block that is fenced with `sh`. Text behind two blanks and a `#` is a remark; where the remark begins with
//! "Ctrl-C", the command is interrupted after some seconds and must end well. A line that ends with `&` goes on beside the others until the page
//! ends; of `hrg-board serve` the runner waits for the link, and `PORT` is that link from then on. Commands not run are listed: blocks
//! fenced with `sh board` need hardware; those with `sh ci` call this, and the public CI runs them; those with `sh long` take minutes, and run with `--all`.

use crate::{root, Failure};
use std::fmt::Write as _;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// A command of a page.
#[derive(Debug, PartialEq)]
struct Typed {
    line: usize,
    text: String,
    /// The block's word behind `sh`: why it is not run.
    kept_back: Option<String>,
}

/// Results of the pages.
#[derive(Debug, Default)]
pub struct Outcome {
    /// Commands that ended well.
    pub passed: u64,
    /// Commands that did not, or never came to run.
    pub failed: u64,
}

/// Commands of a page, in its order; with `long`, those that take minutes are run like the others.
fn commands(page: &str, long: bool) -> Vec<Typed> {
    let mut found: Vec<Typed> = Vec::new();
    let mut block: Option<Option<String>> = None;
    let mut goes_on = false;
    for (n, line) in page.lines().enumerate() {
        let text = line.trim();
        if let Some(info) = text.strip_prefix("```") {
            let mut words = info.split_whitespace();
            block = (block.is_none() && words.next() == Some("sh"))
                .then(|| words.next().filter(|w| !(long && *w == "long")).map(String::from));
            continue;
        }
        let Some(kept_back) = &block else { continue };
        if text.is_empty() || text.starts_with('#') {
            continue;
        }
        let (text, more) = text.strip_suffix('\\').map_or((text, false), |t| (t.trim_end(), true));
        match found.last_mut() {
            Some(last) if goes_on => {
                let _ = write!(last.text, " {text}");
            }
            _ => found.push(Typed { line: n + 1, text: text.into(), kept_back: kept_back.clone() }),
        }
        goes_on = more;
    }
    found
}

/// Run time of a command that a reader ends, s.
const UNTIL_CTRL_C: u32 = 6;

/// A fresh clone of the project, for what the pages take from it; the project itself where it is no git repository. Uncommitted files are
/// not in it: neither has a reader them.
fn fresh_clone() -> Result<PathBuf, Failure> {
    let to = root().join("out/pages/clone");
    if to.exists() {
        std::fs::remove_dir_all(&to).map_err(|e| Failure(format!("{}: {e}", to.display())))?;
    }
    let cloned = crate::output(Command::new("git").args(["clone", "--quiet", "--shared"]).args([root(), to.clone()]));
    Ok(if cloned.is_some() { to } else { root() })
}

/// The commands as a script for bash, which prints `line seconds` behind each that has ended well.
fn script(commands: &[Typed], project: &Path) -> String {
    let programs = root().join("target/release");
    let mut s = format!(
        "set -eu\nexport PATH={0}:$PATH PROJECT={2}\ntrap 'kill $(jobs -p) 2>/dev/null || true' EXIT\ncargo() {{ (cd {1} && command cargo \"$@\"); }}\n",
        programs.display(),
        root().display(),
        project.display()
    );
    let mut port = "PORT".to_string();
    for c in commands.iter().filter(|c| c.kept_back.is_none()) {
        let (text, remark) = c.text.split_once("  #").map_or((c.text.as_str(), ""), |(t, r)| (t.trim(), r.trim()));
        let text = text.split(' ').map(|w| if w == "PORT" { port.as_str() } else { w }).collect::<Vec<_>>().join(" ");
        let _ = writeln!(s, "begun=$(date +%s%N); echo '$' {} >> log", quoted(&text));
        if let Some(beside) = text.strip_suffix('&') {
            let _ = writeln!(s, "{beside} >> log.{} 2>&1 &", c.line);
            if let Some(folder) = text.split_once("--folder ").and_then(|(_, f)| f.split(' ').next()) {
                port = format!("{folder}/link");
                let _ = writeln!(s, "for k in $(seq 600); do [ -e {port} ] && break; sleep 0.1; done; [ -e {port} ]");
            }
        } else if remark.starts_with("Ctrl-C") {
            let _ = writeln!(s, "timeout --preserve-status --signal=INT {UNTIL_CTRL_C} {text} >> log 2>&1");
        } else {
            let _ = writeln!(s, "{text} >> log 2>&1");
        }
        let _ = writeln!(s, "echo {} $(( ($(date +%s%N) - begun) / 1000000 ))", c.line);
    }
    s
}

/// A text as one word for bash.
fn quoted(text: &str) -> String {
    format!("'{}'", text.replace('\'', "'\\''"))
}

/// The option that runs what takes minutes.
const ALL: &str = "--all";

/// The option for when everything is built already.
pub const BUILT: &str = "--built";

/// Pages with commands: of the arguments, or all.
fn pages(arguments: &[String]) -> Result<Vec<PathBuf>, Failure> {
    let named: Vec<PathBuf> = arguments.iter().filter(|a| *a != ALL && *a != BUILT).map(PathBuf::from).collect();
    if !named.is_empty() {
        return Ok(named);
    }
    let docs = std::fs::read_dir(root().join("docs")).map_err(|e| Failure(format!("docs: {e}")))?;
    let mut all: Vec<PathBuf> = docs
        .filter_map(|e| e.ok().map(|e| PathBuf::from("docs").join(e.file_name())))
        .filter(|p| p.extension().is_some_and(|e| e == "md"))
        .collect();
    all.sort();
    all.splice(0..0, ["README.md", "python/README.md"].map(PathBuf::from));
    Ok(all)
}

/// Runs the pages' commands and prints each with its time.
pub fn run(arguments: &[String]) -> Result<Outcome, Failure> {
    let mut outcome = Outcome::default();
    let long = arguments.iter().any(|a| a == ALL);
    let project = fresh_clone()?;
    for page in pages(arguments)? {
        let text = std::fs::read_to_string(root().join(&page))
            .map_err(|e| Failure(format!("{}: {e}; name a page from the project's folder", page.display())))?;
        one_page(&page, &commands(&text, long), &project, &mut outcome)?;
    }
    Ok(outcome)
}

fn one_page(page: &Path, all: &[Typed], project: &Path, outcome: &mut Outcome) -> Result<(), Failure> {
    for c in all {
        if let Some(why) = &c.kept_back {
            println!("{}:{}: not run ({why}): {}", page.display(), c.line, c.text);
        }
    }
    let mut waiting = all.iter().filter(|c| c.kept_back.is_none()).peekable();
    if waiting.peek().is_none() {
        return Ok(());
    }
    let folder = root().join("out/pages").join(page.with_extension("")).components().collect::<PathBuf>();
    let failed = |e: std::io::Error| Failure(format!("{}: {e}", folder.display()));
    if folder.exists() {
        std::fs::remove_dir_all(&folder).map_err(failed)?;
    }
    std::fs::create_dir_all(&folder).map_err(failed)?;
    let mut child = Command::new("bash")
        .args(["-c", &script(all, project)])
        .current_dir(&folder)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .spawn()
        .map_err(|e| Failure(format!("bash could not be started: {e}")))?;
    if let Some(stdout) = child.stdout.take() {
        for line in BufReader::new(stdout).lines().map_while(Result::ok) {
            let ended =
                line.split_once(' ').and_then(|(n, ms)| Some((n.parse::<usize>().ok()?, ms.parse::<f64>().ok()?)));
            if let (Some((_, ms)), Some(c)) = (ended, waiting.next()) {
                outcome.passed += 1;
                println!("{}:{}: {:.1} s: {}", page.display(), c.line, ms / 1000.0, c.text);
            }
        }
    }
    child.wait().map_err(failed)?;
    if let Some(c) = waiting.next() {
        outcome.failed += 1 + waiting.count() as u64;
        println!("{}:{}: FAILED: {}", page.display(), c.line, c.text);
        for log in ["log".to_string(), format!("log.{}", c.line)] {
            let text = std::fs::read_to_string(folder.join(log)).unwrap_or_default();
            let lines: Vec<&str> = text.lines().collect();
            lines.iter().skip(lines.len().saturating_sub(20)).for_each(|l| println!("    {l}"));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_are_the_lines_of_fenced_blocks() {
        let page =
            "text\n```sh\na --b  # remark\n\nc \\\n  d\n```\n```\nno\n```\n```text\nno\n```\n```sh board\ne\n```\n";
        let found = commands(page, false);
        let texts: Vec<_> = found.iter().map(|c| (c.line, c.text.as_str(), c.kept_back.as_deref())).collect();
        assert_eq!(texts, [(3, "a --b  # remark", None), (5, "c d", None), (15, "e", Some("board"))]);
    }

    #[test]
    fn a_command_that_fails_ends_its_page_and_is_counted_with_those_behind_it() {
        let page = Path::new("docs/no-such-page-of-the-test.md");
        let mut outcome = Outcome::default();
        let all = commands("```sh\ntrue\nsleep 100 &\nfalse\ntrue\n```\n```sh ci\nfalse\n```\n", false);
        one_page(page, &all, &root(), &mut outcome).expect("bash");
        assert_eq!((outcome.passed, outcome.failed), (2, 2));
        let _ = std::fs::remove_dir_all(root().join("out/pages/docs/no-such-page-of-the-test"));
    }
}
