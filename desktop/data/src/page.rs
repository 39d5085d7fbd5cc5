//! Pages: one file of HTML each, with its style and its pictures, readable on a telephone and on a wide screen, in light and in dark.

use crate::plot::{svg, Panel, PALETTE};

/// Colours of a page by name: in light, in dark.
const COLOURS: [(&str, &str, &str); 8] = [
    ("bg", "#ffffff", "#16181c"),
    ("fg", "#222222", "#e4e4e4"),
    ("small", "#595959", "#b0b0b0"),
    ("head", "#f3f3f3", "#24272d"),
    ("grid", "#dddddd", "#3a3e46"),
    ("good", "#1f6b25", "#7fd38a"),
    ("bad", "#b3261e", "#ff8a80"),
    ("open", "#8a4b00", "#ffb74d"),
];

/// Meaning of a box of text.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Tone {
    /// As wished.
    Good,
    /// Not as wished.
    Bad,
    /// Not known, or to be looked at.
    Open,
}

impl Tone {
    fn name(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Bad => "bad",
            Self::Open => "open",
        }
    }
}

/// Rules beside the colours. Pictures are drawn in black on white: the rules turn that about in dark.
const RULES: &str = "*{box-sizing:border-box}\
body{font:15px/1.45 system-ui,sans-serif;margin:0 auto;max-width:1420px;padding:16px;background:var(--bg);color:var(--fg)}\
h1{font-size:22px;margin:8px 0}h2{font-size:18px;margin-top:24px}h3{font-size:16px;margin-bottom:4px}\
.panels{display:grid;grid-template-columns:repeat(auto-fill,minmax(min(100%,400px),1fr));gap:8px}\
.panels>svg{width:100%;height:auto}\
.box{background:var(--head);border-left:6px solid var(--tone);padding:8px 16px;font-size:16px;margin:12px 0}\
.box b{color:var(--tone)}.good{--tone:var(--good)}.bad{--tone:var(--bad)}.open{--tone:var(--open)}\
.wide{overflow-x:auto}table{border-collapse:collapse;margin:6px 24px 6px 0}\
td,th{border-bottom:1px solid var(--grid);padding:3px 10px;text-align:right;vertical-align:top}\
td:first-child,th:first-child,.left{text-align:left}th{font-weight:600;background:var(--head)}\
.small{color:var(--small);font-size:13px;font-weight:400}pre{overflow-x:auto;font-size:13px}\
details{border-top:1px solid var(--grid);padding:6px 0}summary{cursor:pointer;font-size:17px;font-weight:600;padding:4px 0}\
svg text{fill:var(--fg)}svg [fill=\"#FFFFFF\"]{fill:var(--bg)}svg [stroke=\"#000000\"]{stroke:var(--fg)}\
svg [stroke=\"#E1E1E1\"],svg [stroke=\"#C8C8C8\"]{stroke:var(--grid)}";

/// Curves that are too dark on a dark ground.
const IN_DARK: &str = "svg path[opacity]{opacity:.9}\
svg [stroke=\"#7B1FA2\"]{stroke:#ce93d8}svg [fill=\"#7B1FA2\"]{fill:#ce93d8}\
svg [stroke=\"#00796B\"]{stroke:#4db6ac}svg [fill=\"#00796B\"]{fill:#4db6ac}";

/// A page.
#[must_use]
pub fn page(title: &str, body: &str) -> String {
    let colours =
        |pick: &dyn Fn(&(&str, &str, &'static str)) -> String| -> String { COLOURS.iter().map(pick).collect() };
    let light = colours(&|(name, light, _)| format!("--{name}:{light};"));
    let dark = colours(&|(name, _, dark)| format!("--{name}:{dark};"));
    format!(
        "<!doctype html><html lang=en><meta charset=utf-8><meta name=viewport content=\"width=device-width,initial-scale=1\">\
         <title>{title}</title><style>:root{{color-scheme:light dark;{light}}}\
         {RULES}@media(prefers-color-scheme:dark){{:root{{{dark}}}{IN_DARK}}}</style>{body}</html>\n"
    )
}

/// A box of text (HTML) in the colour of its meaning; what is bold in it has the colour, too.
#[must_use]
pub fn boxed(html: &str, tone: Tone) -> String {
    format!("<div class=\"box {}\">{html}</div>", tone.name())
}

/// A part of a page that is folded until it is asked for.
#[must_use]
pub fn folded(title: &str, html: &str) -> String {
    format!("<details><summary>{title}</summary>{html}</details>")
}

/// A list; empty without items.
#[must_use]
pub fn list<'t>(items: impl IntoIterator<Item = &'t String>) -> String {
    let items: String = items.into_iter().map(|i| format!("<li>{}</li>", crate::plot::escape(i))).collect();
    if items.is_empty() {
        items
    } else {
        format!("<ul>{items}</ul>")
    }
}

/// Meanings of the colours of pictures, in one line under all of them.
#[must_use]
pub fn legend(meanings: &[(&str, usize)]) -> String {
    let each = meanings.iter().map(|(label, colour)| {
        let c = PALETTE[colour % PALETTE.len()];
        let fill = format!("#{:02X}{:02X}{:02X}", c.0, c.1, c.2);
        format!("<svg width=12 height=12><circle cx=6 cy=6 r=5 fill=\"{fill}\"/></svg> {label}")
    });
    format!("<p>{}</p>", each.collect::<Vec<_>>().join(" &nbsp; "))
}

/// Pictures side by side, as many as the screen has room for.
///
/// # Errors
/// If the drawing library fails.
pub fn pictures(panels: &[Panel]) -> anyhow::Result<String> {
    let each: anyhow::Result<Vec<String>> = panels.iter().map(|p| svg(std::slice::from_ref(p), 1, 460, 320)).collect();
    Ok(format!("<div class=panels>{}</div>", each?.concat()))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Contrast of two colours by the rule of the Web Content Accessibility Guidelines 2.1.
    fn contrast(a: &str, b: &str) -> f64 {
        let luminance = |colour: &str| -> f64 {
            let part = |k: usize| {
                let v = f64::from(u8::from_str_radix(&colour[k..k + 2], 16).expect("a colour")) / 255.0;
                if v <= 0.03928 {
                    v / 12.92
                } else {
                    ((v + 0.055) / 1.055).powf(2.4)
                }
            };
            0.2126 * part(1) + 0.7152 * part(3) + 0.0722 * part(5)
        };
        let (a, b) = (luminance(a), luminance(b));
        (a.max(b) + 0.05) / (a.min(b) + 0.05)
    }

    #[test]
    fn texts_can_be_read_in_light_and_dark() {
        assert!((contrast("#000000", "#ffffff") - 21.0).abs() < 0.01);
        let of = |name: &str| COLOURS.iter().find(|c| c.0 == name).expect("there");
        for ground in ["bg", "head"] {
            for text in ["fg", "small", "good", "bad", "open"] {
                let (light, dark) = (contrast(of(text).1, of(ground).1), contrast(of(text).2, of(ground).2));
                assert!(light >= 4.5 && dark >= 4.5, "{text} on {ground}: {light:.2}, {dark:.2}");
            }
        }
    }

    #[test]
    fn a_page_is_one_file() {
        let html = page("t", &(boxed("<b>PASS</b>", Tone::Good) + &folded("more", &list(&["a < b".to_string()]))));
        assert!(!html.contains("http") && html.contains("a &lt; b") && html.contains("prefers-color-scheme:dark"));
    }
}
