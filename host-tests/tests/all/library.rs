//! hrg-core as a library for others: its public interface is what `hrg-core/api.txt` says, each public module has an example that runs, and
//! the figures of its README are those of docs/bench.md.

use proc_macro2::{Delimiter, TokenStream, TokenTree};
use quote::ToTokens;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use syn::{Fields, ImplItem, Item, TraitItem, Visibility};

fn top() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn text(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// Tokens without attributes (and so without documentation), a blank between two.
fn words(tokens: TokenStream) -> String {
    let mut out = String::new();
    let mut tokens = tokens.into_iter().peekable();
    while let Some(t) = tokens.next() {
        let attribute = matches!(&t, TokenTree::Punct(p) if p.as_char() == '#')
            && matches!(tokens.peek(), Some(TokenTree::Group(g)) if g.delimiter() == Delimiter::Bracket);
        if attribute {
            tokens.next();
            continue;
        }
        let word = match &t {
            TokenTree::Group(g) => {
                let (open, close) = match g.delimiter() {
                    Delimiter::Parenthesis => ("(", ")"),
                    Delimiter::Brace => ("{", "}"),
                    Delimiter::Bracket => ("[", "]"),
                    Delimiter::None => ("", ""),
                };
                format!("{open}{}{close}", words(g.stream()))
            }
            other => other.to_string(),
        };
        out += &word;
        out.push(' ');
    }
    out.trim_end().to_string()
}

fn show(item: &impl ToTokens) -> String {
    words(item.to_token_stream())
}

fn public(v: &Visibility) -> bool {
    matches!(v, Visibility::Public(_))
}

fn of_test(attributes: &[syn::Attribute]) -> bool {
    attributes.iter().any(|a| a.path().is_ident("cfg") && show(&a.meta).contains("test"))
}

/// The lines of a module, and of those within it; `modules`: each public one with its documentation.
struct Listing {
    lines: Vec<String>,
    modules: BTreeMap<String, String>,
}

fn documentation(attributes: &[syn::Attribute]) -> String {
    attributes.iter().filter(|a| a.path().is_ident("doc")).map(|a| format!("{}\n", a.meta.to_token_stream())).collect()
}

impl Listing {
    fn say(&mut self, place: &str, what: &str) {
        self.lines.push(format!("{place}: {what}"));
    }

    /// The file of a module, and the folder of the modules in it.
    fn file(&mut self, place: &str, path: &Path, folder: &Path, shown: bool) {
        let file = syn::parse_file(&text(path)).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        if shown {
            self.modules.insert(place.to_string(), documentation(&file.attrs));
        }
        self.items(place, &file.items, folder, shown);
    }

    fn items(&mut self, place: &str, items: &[Item], folder: &Path, shown: bool) {
        for item in items {
            match item {
                Item::Mod(m) if !of_test(&m.attrs) => {
                    let (inner, below) = (format!("{place}::{}", m.ident), folder.join(m.ident.to_string()));
                    // A public item of a private module may be exported by the parent: it is listed at its own place.
                    if let Some((_, items)) = &m.content {
                        if public(&m.vis) {
                            self.modules.insert(inner.clone(), documentation(&m.attrs));
                        }
                        self.items(&inner, items, &below, public(&m.vis));
                    } else {
                        let own = folder.join(format!("{}.rs", m.ident));
                        let path = if own.is_file() { own } else { below.join("mod.rs") };
                        self.file(&inner, &path, &below, shown && public(&m.vis));
                    }
                }
                Item::Struct(s) if public(&s.vis) => {
                    let fields: Vec<String> = match &s.fields {
                        Fields::Named(f) => f.named.iter().filter(|f| public(&f.vis)).map(show).collect(),
                        other => other.iter().filter(|f| public(&f.vis)).map(show).collect(),
                    };
                    let more = if fields.len() < s.fields.len() { ", .." } else { "" };
                    self.say(
                        place,
                        &format!("struct {} {} {{ {}{more} }}", s.ident, show(&s.generics), fields.join(", ")),
                    );
                }
                Item::Impl(i) if i.trait_.is_none() => {
                    let of = show(&i.self_ty);
                    for item in &i.items {
                        match item {
                            ImplItem::Fn(f) if public(&f.vis) => self.say(place, &format!("{of} {}", show(&f.sig))),
                            ImplItem::Const(c) if public(&c.vis) => {
                                self.say(place, &format!("{of} const {} : {}", c.ident, show(&c.ty)));
                            }
                            _ => {}
                        }
                    }
                }
                Item::Impl(i) => {
                    if let Some((_, of, _)) = &i.trait_ {
                        self.say(place, &format!("impl {} {} for {}", show(&i.generics), show(of), show(&i.self_ty)));
                    }
                }
                Item::Trait(t) if public(&t.vis) => {
                    for item in &t.items {
                        let printed = match item {
                            TraitItem::Fn(f) => {
                                format!("{}{}", show(&f.sig), if f.default.is_some() { " given" } else { "" })
                            }
                            other => show(other),
                        };
                        self.say(place, &format!("trait {} {printed}", t.ident));
                    }
                }
                Item::Fn(f) if public(&f.vis) => self.say(place, &show(&f.sig)),
                Item::Const(c) if public(&c.vis) => self.say(place, &format!("const {} : {}", c.ident, show(&c.ty))),
                Item::Enum(e) if public(&e.vis) => self.say(place, &show(e)),
                Item::Type(t) if public(&t.vis) => self.say(place, &show(t)),
                Item::Use(u) if public(&u.vis) => self.say(place, &show(u)),
                // Interfaces that macros write: what they are told.
                Item::Macro(m) if m.ident.is_none() => self.say(place, &show(&m.mac)),
                _ => {}
            }
        }
    }
}

fn listing() -> Listing {
    let mut all = Listing { lines: Vec::new(), modules: BTreeMap::new() };
    let source = top().join("hrg-core/src");
    all.file("hrg_core", &source.join("lib.rs"), &source, true);
    all.lines.sort();
    all
}

#[test]
fn the_public_interface_is_the_one_that_is_written_down() {
    let now = listing().lines.join("\n") + "\n";
    let path = top().join("hrg-core/api.txt");
    if std::env::var_os("HRG_WRITE_API").is_some() {
        std::fs::write(&path, &now).expect("written");
    }
    let stated = text(&path);
    let (a, b): (Vec<&str>, Vec<&str>) = (stated.lines().collect(), now.lines().collect());
    let gone: Vec<&&str> = a.iter().filter(|l| !b.contains(l)).collect();
    let new: Vec<&&str> = b.iter().filter(|l| !a.contains(l)).collect();
    assert!(
        gone.is_empty() && new.is_empty(),
        "the interface of hrg-core has changed. If it should, write it down: HRG_WRITE_API=1 cargo test --release -p host-tests --test \
         all library, and a line in CHANGELOG.md.\ngone: {gone:#?}\nnew: {new:#?}"
    );
    assert!(a.len() > 400, "{} lines: the listing itself has failed", a.len());
}

#[test]
fn every_public_module_has_an_example_that_runs() {
    let modules = listing().modules;
    let lacking: Vec<&String> = modules
        .iter()
        // The crate's own page begins with its README, which has one.
        .filter(|(_, doc)| !doc.contains("# Example") && !doc.contains("README.md"))
        .map(|(m, _)| m)
        .collect();
    assert!(lacking.is_empty(), "without an example: {lacking:?}");
    for (module, doc) in &modules {
        let skipped = ["```ignore", "```no_run", "```text", "```compile_fail"].iter().any(|w| doc.contains(w));
        assert!(!skipped, "{module}: an example that does not run");
    }
    assert!(modules.len() > 30, "{}", modules.len());
}

/// Rows of the tables in a text: its cells.
fn rows(text: &str) -> Vec<Vec<&str>> {
    text.lines()
        .filter_map(|l| l.strip_prefix("| ")?.strip_suffix(" |"))
        .map(|l| l.split(" | ").map(str::trim).collect())
        .collect()
}

#[test]
fn the_readmes_figures_are_those_of_the_bench() {
    let (readme, bench) = (text(&top().join("hrg-core/README.md")), text(&top().join("docs/bench.md")));
    let bench = rows(&bench);
    let mut compared = 0;
    for row in rows(&readme) {
        let [_, figure, of] = row[..] else { continue };
        let Some(of) = of.strip_prefix('`').and_then(|o| o.strip_suffix('`')) else { continue };
        let theirs = bench.iter().find(|r| r[0] == of).unwrap_or_else(|| panic!("docs/bench.md has no row \"{of}\""));
        assert!(theirs[1..].contains(&figure), "{of}: the README says {figure}, docs/bench.md {theirs:?}");
        compared += 1;
    }
    assert_eq!(compared, 12);
}
