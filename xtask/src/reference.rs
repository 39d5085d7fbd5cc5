//! docs/reference.md: the help of every command, printed for the book; and the status bits in docs/formats.md.

use crate::{output, root, Failure, USAGE};
use std::fmt::Write as _;
use std::process::Command;

const PAGE: &str = "docs/reference.md";

/// Page that holds the status bits.
const FORMATS: &str = "docs/formats.md";

/// Writes docs/reference.md (not kept: the book and the help hold the same) and the status bits of docs/formats.md.
pub fn write() -> Result<(), Failure> {
    let failed = |page: &str, e: std::io::Error| Failure(format!("{page}: {e}"));
    std::fs::write(root().join(PAGE), text()?).map_err(|e| failed(PAGE, e))?;
    let page = std::fs::read_to_string(root().join(FORMATS)).map_err(|e| failed(FORMATS, e))?;
    std::fs::write(root().join(FORMATS), with_status(&page)?).map_err(|e| failed(FORMATS, e))
}

/// Compares the status bits in docs/formats.md with the code.
pub fn check() -> Result<(), Failure> {
    let page = std::fs::read_to_string(root().join(FORMATS)).map_err(|e| Failure(format!("{FORMATS}: {e}")))?;
    if with_status(&page)? == page {
        return Ok(());
    }
    Err(Failure(format!("the status bits in {FORMATS} are not those of the code: run\n\n    cargo xtask reference\n")))
}

/// The page with today's status bits between its marks.
fn with_status(page: &str) -> Result<String, Failure> {
    let (begin, end) = ("<!-- status: begin -->\n", "<!-- status: end -->");
    let marks = page.split_once(begin).and_then(|(before, rest)| Some((before, rest.split_once(end)?.1)));
    let (before, after) = marks.ok_or_else(|| Failure(format!("{FORMATS} has no marks for the status bits")))?;
    Ok(format!("{before}{begin}{}{end}{after}", status()?))
}

/// The tables of the status bits.
fn status() -> Result<String, Failure> {
    let mut s = String::new();
    let source = std::fs::read_to_string(root().join("hrg-core/src/status.rs")).map_err(|e| Failure(e.to_string()))?;
    for (kind, heading, means) in [
        (
            "AxisStatus",
            "Status of an axis",
            "In each rate frame for x, y and z, u16; in files by name. Zero: the unit stands behind the rate.",
        ),
        ("UnitStatus", "Status of the unit", "In each rate frame, u8."),
    ] {
        let bits = bits(&source, kind);
        if bits.is_empty() {
            return Err(Failure(format!("hrg-core/src/status.rs has no bits of {kind}")));
        }
        let _ = write!(s, "\n### {heading}\n{means}\n\n| bit | name | meaning |\n|--:|---|---|\n");
        for (k, (name, meaning)) in bits.iter().enumerate() {
            let _ = writeln!(s, "| {k} | `{name}` | {meaning} |");
        }
    }
    Ok(s)
}

/// The help of every command.
fn text() -> Result<String, Failure> {
    let mut s = String::from(
        "# Commands\n\nPrinted by `cargo xtask reference` from the programs themselves; not kept in the repository. Columns of recordings, bytes of images and of\nthe link, and status bits are in [formats.md](formats.md); effects and their equations in [papers.md](papers.md) and `hrg effects`.\n",
    );
    for program in ["hrg", "hrg-board"] {
        let _ = write!(s, "\n## Commands of {program}\n");
        for command in subcommands(&help(program, &[])?) {
            let text = help(program, &[&command])?;
            let _ = write!(s, "\n### {program} {command}\n```text\n{}\n```\n", text.trim_end());
            for nested in text.contains("\nCommands:\n").then(|| subcommands(&text)).into_iter().flatten() {
                let help = help(program, &[&command, &nested])?;
                let _ = write!(s, "\n### {program} {command} {nested}\n```text\n{}\n```\n", help.trim_end());
            }
        }
    }
    let _ = write!(s, "\n## cargo xtask\n```text\n{USAGE}\n```\n");
    Ok(s)
}

/// Name and meaning of each bit, from the comments of the constants.
fn bits(source: &str, kind: &str) -> Vec<(String, String)> {
    let Some((_, body)) = source.split_once(&format!("pub struct {kind}:")) else { return Vec::new() };
    let body = body.split("\n    }\n").next().unwrap_or("");
    let (mut found, mut meaning) = (Vec::new(), String::new());
    for line in body.lines().map(str::trim) {
        if let Some(comment) = line.strip_prefix("///") {
            let _ = write!(meaning, "{comment}");
        } else if let Some((name, _)) = line.strip_prefix("const ").and_then(|c| c.split_once(" = 1 << ")) {
            let plain = meaning.trim().replace("[`", "`").replace("`]", "`").replace("crate::", "");
            found.push((name.to_lowercase().replace('_', "-"), plain));
            meaning.clear();
        }
    }
    found
}

/// Output of `--help`.
fn help(program: &str, command: &[&str]) -> Result<String, Failure> {
    let path = root().join("target/release").join(program);
    output(Command::new(&path).args(command).arg("--help"))
        .ok_or_else(|| Failure(format!("{} {command:?} --help failed: cargo xtask build", path.display())))
}

/// Names of the commands that a help lists, before its options.
fn subcommands(help: &str) -> Vec<String> {
    // (`hrg` lists its commands by purpose, under several headings.)
    let listed = help.lines().take_while(|l| *l != "Options:").skip_while(|l| !l.ends_with(':') || l.starts_with(' '));
    let names = listed.filter(|l| l.starts_with("  ") && !l.starts_with("   "));
    names.filter_map(|l| l.split_whitespace().next()).filter(|n| *n != "help").map(String::from).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_and_commands_are_found() {
        let source = "pub struct S: u8 {\n        /// One\n        /// [`crate::a::B`] more.\n        const FIRST_BIT = 1 << 0;\n    }\n";
        assert_eq!(bits(source, "S"), [("first-bit".to_string(), "One `a::B` more.".to_string())]);
        let help = "x\n\nCommands:\n  fit    Fits.\n         More.\n  help   Prints\n\nOptions:\n  -h\n";
        assert_eq!(subcommands(help), ["fit"]);
    }
}
