//! docs/reference.md: every status bit and every command's help, printed from what the programs and their sources say themselves.

use crate::{output, root, Failure, USAGE};
use std::fmt::Write as _;
use std::process::Command;

const PAGE: &str = "docs/reference.md";

/// Writes the page anew; with `--check`, compares it.
pub fn write(arguments: &[String]) -> Result<(), Failure> {
    let page = root().join(PAGE);
    let text = text()?;
    if arguments.iter().any(|a| a == "--check") {
        let held = std::fs::read_to_string(&page).unwrap_or_default();
        return if held == text {
            Ok(())
        } else {
            Err(Failure(format!("{PAGE} is not what the programs say: run\n\n    cargo xtask reference\n")))
        };
    }
    std::fs::write(&page, text).map_err(|e| Failure(format!("{}: {e}", page.display())))
}

fn text() -> Result<String, Failure> {
    let mut s = String::from(
        "# Reference\n\nPrinted by `cargo xtask reference` from the programs themselves; `cargo xtask test` compares it. Columns of recordings, bytes of images and of\nthe link are in [formats.md](formats.md), which is printed from the same layouts as the code; effects and their equations in [papers.md](papers.md)\nand `hrg effects`.\n",
    );
    let status = std::fs::read_to_string(root().join("hrg-core/src/status.rs")).map_err(|e| Failure(e.to_string()))?;
    for (kind, heading, means) in [
        (
            "AxisStatus",
            "Status of an axis",
            "In each rate frame for x, y and z, u16; in files by name. Zero: the unit stands behind the rate.",
        ),
        ("UnitStatus", "Status of the unit", "In each rate frame, u8."),
    ] {
        let bits = bits(&status, kind);
        if bits.is_empty() {
            return Err(Failure(format!("hrg-core/src/status.rs has no bits of {kind}")));
        }
        let _ = write!(s, "\n## {heading}\n{means}\n\n| bit | name | it means |\n|--:|---|---|\n");
        for (k, (name, meaning)) in bits.iter().enumerate() {
            let _ = writeln!(s, "| {k} | `{name}` | {meaning} |");
        }
    }
    for program in ["hrg", "hrg-board"] {
        let _ = write!(s, "\n## Commands of {program}\n");
        for command in subcommands(&help(program, &[])?) {
            let _ = write!(s, "\n### {program} {command}\n```text\n{}\n```\n", help(program, &[&command])?.trim_end());
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

/// Names under "Commands:".
fn subcommands(help: &str) -> Vec<String> {
    let listed = help.split("Commands:\n").nth(1).unwrap_or("");
    let names = listed.lines().take_while(|l| !l.is_empty()).filter(|l| l.starts_with("  ") && !l.starts_with("   "));
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
