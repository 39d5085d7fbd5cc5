//! The pages as a browser shows them: wide and narrow, light and dark. Pictures of all of them stay in `target/pages`.

use host_tests::{hrg, ok, temporary};
use std::path::{Path, PathBuf};
use std::process::Command;

/// Measures a page once it is drawn: overflow, the least contrast of a text with its ground, the smallest text, the ground of the page.
/// The figures become the title of the page around it.
const MEASURE: &str = r"<script>
addEventListener('load', () => {
  const parts = c => { const m = c.match(/[\d.]+/g).map(Number); return m.length < 4 ? [...m, 1] : m; };
  const part = v => { v /= 255; return v <= 0.03928 ? v / 12.92 : Math.pow((v + 0.055) / 1.055, 2.4); };
  const luminance = c => 0.2126 * part(c[0]) + 0.7152 * part(c[1]) + 0.0722 * part(c[2]);
  const ground = e => {
    for (; e; e = e.parentElement) {
      const b = parts(getComputedStyle(e).backgroundColor);
      if (b[3] > 0) return b;
    }
    return [255, 255, 255, 1];
  };
  const before = document.querySelector('details') ? document.querySelector('details').getBoundingClientRect().top : 0;
  const first = document.querySelector('.panels').getBoundingClientRect().top;
  document.querySelectorAll('details').forEach(d => d.open = true);
  let least = 99, of = '', smallest = 99;
  const texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (texts.nextNode()) {
    const e = texts.currentNode.parentElement;
    if (!texts.currentNode.data.trim() || ['SCRIPT', 'STYLE', 'TITLE'].includes(e.tagName)) continue;
    const style = getComputedStyle(e), svg = e.closest('svg');
    const a = luminance(parts(svg ? style.fill : style.color)), b = luminance(ground(svg || e));
    const contrast = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
    if (contrast < least) { least = contrast; of = texts.currentNode.data.trim().slice(0, 40); }
    const drawn = svg ? svg.getBoundingClientRect().width / svg.viewBox.baseVal.width : 1;
    smallest = Math.min(smallest, drawn * parseFloat(style.fontSize));
  }
  const dark = luminance(ground(document.body)) < 0.2;
  parent.postMessage(JSON.stringify({ width: innerWidth, needs: document.documentElement.scrollWidth, least, of, smallest, dark, first }), '*');
});
</script>";

fn chromium(arguments: &[String]) -> String {
    let o = Command::new("chromium")
        .args(["--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars"])
        .args(arguments)
        .output()
        .expect("chromium, which cargo xtask test --rest installs");
    String::from_utf8_lossy(&o.stdout).into_owned()
}

/// Shows a page in a frame of a width; gives its figures, and leaves a picture.
fn shown(page: &Path, width: u32, dark: bool, picture: &Path) -> serde_json::Value {
    let html = std::fs::read_to_string(page).expect("a page") + MEASURE;
    let framed = html.replace('&', "&amp;").replace('"', "&quot;");
    let around = page.with_extension("around.html");
    let frame = format!("<body style=\"margin:0\"><iframe style=\"border:0;width:{width}px;height:1600px\" srcdoc=\"{framed}\"></iframe>");
    let hear = "<script>addEventListener('message',e=>document.title=e.data)</script>";
    std::fs::write(&around, format!("<!doctype html><title>-</title>{hear}{frame}")).expect("written");
    let scheme = format!("--blink-settings=preferredColorScheme={}", u8::from(!dark));
    let size = format!("--window-size={},1600", width.max(500));
    let url = format!("file://{}", around.display());
    let _ = chromium(&[scheme.clone(), size.clone(), format!("--screenshot={}", picture.display()), url.clone()]);
    assert!(std::fs::metadata(picture).is_ok_and(|m| m.len() > 10_000), "{}", picture.display());
    let dom = chromium(&[scheme, size, "--virtual-time-budget=5000".into(), "--dump-dom".into(), url]);
    let title = dom.split("<title>").nth(1).and_then(|t| t.split("</title>").next()).unwrap_or_default();
    serde_json::from_str(&title.replace("&amp;", "&").replace("&lt;", "<").replace("&gt;", ">"))
        .unwrap_or_else(|e| panic!("{}: {e}: {title}", page.display()))
}

fn judged(page: &Path, folder: &Path) {
    let size = std::fs::metadata(page).expect("a page").len();
    assert!(size < 300_000, "{}: {size} bytes", page.display());
    for width in [380, 1600] {
        for dark in [false, true] {
            let name = page.file_stem().expect("a name").to_string_lossy();
            let picture = folder.join(format!("{name}-{width}-{}.png", if dark { "dark" } else { "light" }));
            let v = shown(page, width, dark, &picture);
            assert_eq!((&v["width"], &v["dark"]), (&width.into(), &dark.into()), "{v}");
            assert!(v["needs"].as_u64() <= v["width"].as_u64(), "wider than the screen: {v}");
            assert!(v["least"].as_f64() >= Some(4.5), "contrast: {v}");
            assert!(v["smallest"].as_f64() >= Some(7.0), "texts too small: {v}");
            assert!(v["first"].as_f64() < Some(120.0), "the pictures come first: {v}");
        }
    }
}

#[test]
#[ignore = "cargo xtask test --rest"]
fn pages_can_be_read_wide_and_narrow_in_light_and_dark() {
    let d = temporary("browser");
    let pictures = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../target/pages"));
    std::fs::create_dir_all(&pictures).expect("a folder");
    ok(&d, "simulate --profile cycle --effect hysteresis --seed 1 --out a.csv");
    ok(&d, "simulate --profile verify --effect hysteresis --seed 2 --out b.csv");
    ok(&d, "trace a.csv --verify b.csv -o r.json --html trace.html --limit 1 --calibration c.toml");
    ok(&d, "report a.csv b.csv --html report.html");
    let (code, ..) = hrg(&d, "judge b.csv -c c.toml -l 0.3 --from -20 --to 50 --html judge.html");
    assert_eq!(code, Some(3));
    for page in ["trace.html", "report.html", "judge.html"] {
        judged(&d.join(page), &pictures);
    }
    let _ = std::fs::remove_dir_all(&d);
}
