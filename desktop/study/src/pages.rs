//! Texts between the marks of a page.

use hrg_data::output::write_file;

/// Writes a text into a page, between the marks of a name.
///
/// # Errors
/// If the page has no such marks.
pub fn splice(page: &std::path::Path, name: &str, text: &str) -> anyhow::Result<()> {
    use anyhow::Context;
    let (begin, end) = (format!("<!-- {name}: begin -->"), format!("<!-- {name}: end -->"));
    let old = std::fs::read_to_string(page).with_context(|| format!("cannot read {}", page.display()))?;
    let (before, rest) = old.split_once(&begin).with_context(|| format!("{} has no {begin}", page.display()))?;
    let (_, after) = rest.split_once(&end).with_context(|| format!("{} has no {end}", page.display()))?;
    write_file(page, format!("{before}{begin}\n{text}{end}{after}").as_bytes())
}
