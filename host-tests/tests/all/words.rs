//! One word for a thing, the field's own: words that the project has cleared away stay away from what people read (pages, comments, messages).
//!
//! Not looked at: code, what stands between back quotes, names with a hyphen or an underscore, and literals without a space, which are names
//! of files' columns and of effects: files keep their old names.

use std::path::{Path, PathBuf};

/// Words that are not used, and what is. A `*` stands for any ending.
const CLEARED: &[(&str, &str)] = &[
    ("believe*", "accept, take for granted"),
    ("colored", "correlated"),
    ("coloured", "correlated"),
    ("converter*", "ADC"),
    ("deaf", "does not receive"),
    ("dice", "random numbers"),
    ("dirty", "defective"),
    ("divider*", "decimation; in a timer: prescaler"),
    ("doubt*", "reject, uncertain"),
    ("heard", "received"),
    ("herd*", "units"),
    ("hole*", "gap, dropout"),
    ("lane*", "redundant channel"),
    ("luck*", "chance, p-value"),
    ("mend*", "correct, repair"),
    ("obey*", "execute, carry out"),
    ("outsider*", "unmodelled effect"),
    ("said", "flagged, reported, stated"),
    ("seal*", "integrity word"),
    ("sharpen*", "refine"),
    ("shell*", "case (of a sensor)"),
    ("silence", "what is missing, and for how long"),
    ("soil*", "inject defects"),
    ("spoil*", "make invalid"),
    ("staged", "pending"),
    ("twin*", "confounded effect; the model of the unit is the digital twin"),
    ("upset*", "corruption"),
    ("wander*", "Gauss-Markov process, drift"),
    ("weigh", "cost"),
    ("weighs", "counts"),
    ("worth", "of use; of a model: BIC gain"),
];

/// The cleared word that a text has, if any, and what to use.
fn cleared(text: &str) -> Option<(String, &'static str)> {
    let part_of_a_name = |c: char| c.is_alphanumeric() || c == '_' || c == '-';
    let joined = text.replace("::", "_");
    let words = joined.split(|c: char| !part_of_a_name(c)).filter(|w| !w.is_empty());
    let mut before = String::new();
    for word in words {
        let word = word.to_lowercase();
        let is = |cleared: &str| match cleared.strip_suffix('*') {
            Some(stem) => {
                word.strip_prefix(stem).is_some_and(|end| end.len() <= 3 && end.chars().all(char::is_alphabetic))
            }
            None => word == cleared,
        };
        if let Some((_, instead)) = CLEARED.iter().find(|(c, _)| is(c)) {
            if !(word == "twin" && before == "digital") {
                return Some((word, instead));
            }
        }
        before = word;
    }
    None
}

/// A line without what stands between back quotes, which may have opened in a line before.
fn unquoted(line: &str, open: &mut bool) -> String {
    let mut out = String::new();
    for (k, part) in line.split('`').enumerate() {
        *open ^= k > 0;
        out += if *open { " " } else { part };
    }
    out
}

/// Text of a line of code that people read: its comment and its literals that are sentences.
fn prose(line: &str, comment: &str) -> Vec<String> {
    let mut found = Vec::new();
    let mut rest = line;
    loop {
        let quote = rest.find('"');
        let begins = rest.find(comment);
        match (quote, begins) {
            (Some(q), b) if b.is_none_or(|b| q < b) => {
                let after = &rest[q + 1..];
                let mut escaped = false;
                let end = after.find(|c| {
                    let ends = c == '"' && !escaped;
                    escaped = c == '\\' && !escaped;
                    ends
                });
                let literal = &after[..end.unwrap_or(after.len())];
                if literal.contains(' ') {
                    // (Text between braces is a name.)
                    let words = literal.split('{').enumerate();
                    found.push(
                        words.map(|(k, w)| if k == 0 { w } else { w.split_once('}').map_or("", |w| w.1) }).collect(),
                    );
                }
                rest = end.map_or("", |end| &after[end + 1..]);
            }
            (_, Some(b)) => {
                found.push(unquoted(&rest[b..], &mut false));
                return found;
            }
            _ => return found,
        }
    }
}

/// Lines with cleared words, as sentences.
fn faults(name: &str, text: &str) -> Vec<String> {
    let page = name.ends_with(".md");
    let comment = if name.ends_with(".rs") { "//" } else { "#" };
    let (mut fenced, mut quoted) = (false, false);
    let mut out = Vec::new();
    for (n, line) in text.lines().enumerate() {
        let bare = line.trim_start().trim_start_matches("//!").trim_start_matches("///").trim_start();
        if (page || line.trim_start().starts_with("//")) && bare.starts_with("```") {
            fenced = !fenced;
            continue;
        }
        let texts = match (fenced, page) {
            (true, _) => Vec::new(),
            (false, true) => {
                // No quote reaches over the end of a paragraph.
                quoted &= !line.trim().is_empty();
                vec![unquoted(line, &mut quoted)]
            }
            (false, false) => prose(line, comment),
        };
        for (word, instead) in texts.iter().filter_map(|t| cleared(t)) {
            out.push(format!("{name}:{}: \"{word}\" is cleared away; use: {instead}", n + 1));
        }
    }
    out
}

/// Pages and sources of the project.
fn files(folder: &Path, into: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).expect("a folder").map(|e| e.expect("an entry").path()) {
        let name = entry.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let kept = !matches!(name.as_str(), "target" | "out" | "node_modules" | "book")
            && (!name.starts_with('.') || name == ".github");
        if entry.is_dir() {
            if kept {
                files(&entry, into);
            }
        } else if [".md", ".rs", ".py", ".pyi", ".yml"].iter().any(|e| name.ends_with(e)) && name != "words.rs" {
            into.push(entry);
        }
    }
}

#[test]
fn cleared_words_stay_away() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut all = Vec::new();
    files(&root, &mut all);
    assert!(all.len() > 300, "{} files: too few were found", all.len());
    let found: Vec<String> = all
        .iter()
        .flat_map(|f| {
            let name = f.strip_prefix(&root).unwrap_or(f).to_string_lossy().into_owned();
            faults(&name, &std::fs::read_to_string(f).expect("UTF-8"))
        })
        .collect();
    assert!(found.is_empty(), "{} places:\n{}", found.len(), found.join("\n"));
}

#[test]
fn a_cleared_word_is_found_where_people_read_it_and_nowhere_else() {
    let found = |name: &str, text: &str| faults(name, text).len();
    assert_eq!(found("a.md", "A fault is said within 2 s.\n\nThe twin.\nThe digital twin.\n"), 2);
    assert_eq!(found("a.md", "`said`, thermometer-clock-wander, said_so\n```sh\necho said\n```\nOutsiders.\n"), 1);
    assert_eq!(found("a.md", "a `cargo\nsaid` said\n\nsaid `\n\nsaid\n"), 3);
    assert_eq!(found("a.rs", "/// What was said.\nlet said = 1; // it is said\n"), 2);
    assert_eq!(
        found(
            "a.rs",
            "//! ```\n//! let heard = 1;\n//! ```\nalias = \"dirty\"; f(\"a \\\" dirty file\"); g(\"{said} of it\");\n"
        ),
        1
    );
    assert_eq!(found("a.py", "x = 'x' # mended\nraise E(\"believed by none\")\n"), 2);
}

/// Identifiers that keep a cleared word: the digital twin, and names of other crates.
const KEPT_NAMES: [&str; 6] = ["Twin", "twin", "l_dirty", "believes", "staged", "Shell"];

/// The lower-case parts of an identifier: `clockDrift`, `clock_drift` and `CLOCK_DRIFT` have the same.
fn parts(name: &str) -> Vec<String> {
    let mut out = vec![String::new()];
    let mut before = '_';
    for c in name.chars() {
        if c == '_' || (c.is_uppercase() && before.is_lowercase()) {
            out.push(String::new());
        }
        if c != '_' {
            out.last_mut().expect("one").extend(c.to_lowercase());
        }
        before = c;
    }
    out
}

/// Identifiers of a source text, without literals and comments.
fn identifiers(text: &str) -> Vec<String> {
    let mut out = Vec::new();
    for line in text.lines() {
        let code = line.split("//").next().unwrap_or_default();
        for (k, piece) in code.split('"').enumerate() {
            if k % 2 == 0 {
                let words = piece.split(|c: char| !c.is_alphanumeric() && c != '_');
                out.extend(words.filter(|w| w.starts_with(|c: char| c.is_alphabetic() || c == '_')).map(String::from));
            }
        }
    }
    out
}

#[test]
fn cleared_words_are_no_names_in_code() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut all = Vec::new();
    files(&root, &mut all);
    let mut found = Vec::new();
    for file in all.iter().filter(|f| f.extension().is_some_and(|e| e == "rs")) {
        for name in identifiers(&std::fs::read_to_string(file).expect("UTF-8")) {
            let word = parts(&name).iter().find_map(|p| cleared(p));
            if let Some((_, instead)) = word.filter(|_| !KEPT_NAMES.contains(&name.as_str())) {
                found.push(format!("{}: {name}; use: {instead}", file.display()));
            }
        }
    }
    assert!(found.is_empty(), "{} places:\n{}", found.len(), found.join("\n"));
    assert_eq!(identifiers("let heardOf = \"said\"; // told").len(), 2);
    assert_eq!(parts("clockDrift_RATE"), ["clock", "drift", "rate"]);
}

/// A comment states a thing: its sentence begins with a noun or a verb, not with a question.
#[test]
fn no_comment_begins_with_a_question() {
    const QUESTIONS: [&str; 8] = ["What ", "Whether ", "Which ", "Whoever ", "Nobody ", "How ", "Where ", "Who "];
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut all = Vec::new();
    files(&root, &mut all);
    let mut checked = 0;
    for file in all.iter().filter(|f| f.extension().is_some_and(|e| e == "rs")) {
        let text = std::fs::read_to_string(file).expect("text");
        let mut block = false;
        for (n, line) in text.lines().enumerate() {
            let comment = line.trim_start().strip_prefix("//").map(|c| c.trim_start_matches(['/', '!']).trim_start());
            if let Some(comment) = comment {
                checked += 1;
                let begins = QUESTIONS.iter().find(|q| comment.starts_with(**q));
                // (Within a block of comments a line may go on with such a word.)
                assert!(block || begins.is_none(), "{}:{}: {comment}", file.display(), n + 1);
            }
            block = comment.is_some_and(|c| !c.is_empty() && !c.ends_with(['.', ':']));
        }
    }
    assert!(checked > 5000, "{checked}");
}
