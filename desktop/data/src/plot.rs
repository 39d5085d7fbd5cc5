//! Pictures: series over a common x, as SVG.

use plotters::prelude::*;
use plotters::style::full_palette::{BLUE_600, BROWN_500, GREY_500, LIGHTBLUE_300, ORANGE_700, PURPLE_700, TEAL_700};

/// A line or cloud of points.
#[derive(Debug, Clone)]
pub struct Series {
    /// For the legend.
    pub label: String,
    /// Points; those with a NaN break a line.
    pub points: Vec<(f64, f64)>,
    /// Index into the palette.
    pub colour: usize,
    /// Points instead of a line.
    pub dots: bool,
}

/// One diagram.
#[derive(Debug, Clone, Default)]
pub struct Panel {
    /// Above it.
    pub title: String,
    /// Below it, with unit.
    pub x: String,
    /// Beside it, with unit.
    pub y: String,
    /// Both axes logarithmic.
    pub log: bool,
    /// Curves that it shows.
    pub series: Vec<Series>,
}

/// Colours that stay apart for colour-blind eyes: before (grey), after (blue), warm (orange), cold (teal); the others where
/// more curves share a panel.
pub const PALETTE: [RGBColor; 7] = [GREY_500, BLUE_600, ORANGE_700, TEAL_700, PURPLE_700, LIGHTBLUE_300, BROWN_500];

/// Panels in a grid of `columns`, as an SVG of `width` by `height` per panel.
///
/// # Errors
/// If the drawing library fails.
pub fn svg(panels: &[Panel], columns: usize, width: u32, height: u32) -> anyhow::Result<String> {
    let columns = columns.max(1);
    let rows = panels.len().div_ceil(columns);
    let mut out = String::new();
    {
        let root =
            SVGBackend::with_string(&mut out, (width * columns as u32, height * rows as u32)).into_drawing_area();
        root.fill(&WHITE)?;
        for (area, panel) in root.split_evenly((rows, columns)).iter().zip(panels) {
            draw(area, panel)?;
        }
        root.present()?;
    }
    Ok(with_dots_together(&out))
}

/// The same picture with neighbouring circles of one kind as one path: a tenth of the length.
fn with_dots_together(svg: &str) -> String {
    let mut out = String::with_capacity(svg.len());
    // The dots that are gathered: what they have in common, and their places.
    let mut dots: Option<(&str, String)> = None;
    let end = |dots: &mut Option<(&str, String)>, out: &mut String| {
        let Some((kind, places)) = dots.take() else { return };
        let of = |name: &str| attribute(kind, name).unwrap_or_default();
        let width = 2.0 * of("r").parse().unwrap_or(2.0);
        let (opacity, colour) = (of("opacity"), of("fill"));
        *out += &format!(
            "<path d=\"{places}\" fill=\"none\" stroke=\"{colour}\" opacity=\"{opacity}\" stroke-width=\"{width}\" stroke-linecap=\"round\"/>\n"
        );
    };
    for line in svg.lines() {
        let place = line.strip_prefix("<circle ").and_then(|_| Some((attribute(line, "cx")?, attribute(line, "cy")?)));
        let kind = line.find(" r=").map(|at| &line[at..]);
        let (Some((x, y)), Some(kind)) = (place, kind) else {
            end(&mut dots, &mut out);
            out.push_str(line);
            out.push('\n');
            continue;
        };
        if dots.as_ref().is_some_and(|(k, _)| *k != kind) {
            end(&mut dots, &mut out);
        }
        let (_, places) = dots.get_or_insert_with(|| (kind, String::new()));
        let dot = format!("M{x} {y}h0");
        // (A dot on the one before adds nothing.)
        if !places.ends_with(&dot) {
            places.push_str(&dot);
        }
    }
    end(&mut dots, &mut out);
    out
}

/// Value of an attribute of an element in a line.
fn attribute<'t>(line: &'t str, name: &str) -> Option<&'t str> {
    let from = line.find(&format!(" {name}=\""))? + name.len() + 3;
    line[from..].split('"').next()
}

/// Points of a line, of those that share one of so many columns the first, the lowest, the highest and the last.
fn thinned(points: &[(f64, f64)], (from, to): (f64, f64), columns: usize, log: bool) -> Vec<(f64, f64)> {
    if points.len() <= 4 * columns {
        return points.to_vec();
    }
    let at = |x: f64| if log { x.ln() } else { x };
    let column = |p: &(f64, f64)| ((at(p.0) - at(from)) / (at(to) - at(from)) * columns as f64).floor();
    let mut out = Vec::new();
    for part in points.chunk_by(|a, b| column(a) == column(b)) {
        let order = |k: &usize, l: &usize| part[*k].1.total_cmp(&part[*l].1);
        let all = || 0..part.len();
        let mut kept = [0, all().min_by(order).unwrap_or(0), all().max_by(order).unwrap_or(0), part.len() - 1];
        kept.sort_unstable();
        out.extend(kept.iter().enumerate().filter(|(n, k)| *n == 0 || kept[n - 1] != **k).map(|(_, k)| part[*k]));
    }
    out
}

/// A text as it stands in a page (HTML).
#[must_use]
pub fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

fn range(values: impl Iterator<Item = f64>, log: bool) -> (f64, f64) {
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for v in values.filter(|v| v.is_finite() && (!log || *v > 0.0)) {
        low = low.min(v);
        high = high.max(v);
    }
    if low > high {
        return (1.0, 2.0);
    }
    if log {
        return (low / 1.3, high * 1.3);
    }
    let margin = 0.05 * (high - low).max(1e-9 * high.abs()).max(1e-12);
    (low - margin, high + margin)
}

/// A number on an axis, without the digits that rounding leaves.
fn short(v: f64) -> String {
    let text = format!("{v:.4}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text.is_empty() || text == "-" || text == "-0" {
        "0".into()
    } else {
        text.into()
    }
}

fn draw(area: &DrawingArea<SVGBackend<'_>, plotters::coord::Shift>, panel: &Panel) -> anyhow::Result<()> {
    let (x0, x1) = range(panel.series.iter().flat_map(|s| s.points.iter().map(|p| p.0)), panel.log);
    let (y0, y1) = range(panel.series.iter().flat_map(|s| s.points.iter().map(|p| p.1)), panel.log);
    // Curves that rise leave room for the legend at the lower right; others get some above the data.
    let rise = |s: &Series| !s.dots && s.points.len() > 1 && s.points.windows(2).all(|w| w[1].1 >= w[0].1);
    let rising = !panel.log && panel.series.iter().all(rise);
    let labels = panel.series.iter().filter(|s| !s.label.is_empty()).count();
    let y1 = if labels > 1 && !panel.log && !rising { y1 + 0.14 * labels as f64 * (y1 - y0) } else { y1 };
    let corner = match (panel.log, rising) {
        (true, _) => SeriesLabelPosition::UpperRight,
        (_, true) => SeriesLabelPosition::LowerRight,
        _ => SeriesLabelPosition::UpperLeft,
    };
    let mut builder = ChartBuilder::on(area);
    builder.caption(&panel.title, ("sans-serif", 17)).margin(12).x_label_area_size(42).y_label_area_size(64);
    // The two kinds of axis are different types; what is drawn on them is the same.
    macro_rules! fill {
        ($chart:expr) => {{
            let mut chart = $chart;
            chart
                .configure_mesh()
                .x_desc(&panel.x)
                .y_desc(&panel.y)
                .label_style(("sans-serif", 13))
                .axis_desc_style(("sans-serif", 14))
                .x_label_formatter(&|v| short(*v))
                .y_label_formatter(&|v| short(*v))
                .max_light_lines(0)
                .bold_line_style(RGBColor(225, 225, 225))
                .draw()?;
            for s in &panel.series {
                let colour = PALETTE[s.colour % PALETTE.len()];
                if s.dots {
                    let dots = s.points.iter().filter(|p| p.0.is_finite() && p.1.is_finite());
                    chart
                        .draw_series(dots.map(|p| Circle::new(*p, 2, colour.mix(0.55).filled())))?
                        .label(&s.label)
                        .legend(move |(x, y)| Circle::new((x + 10, y), 3, colour.filled()));
                } else {
                    for (part, run) in
                        s.points.split(|p| !(p.0.is_finite() && p.1.is_finite())).filter(|r| !r.is_empty()).enumerate()
                    {
                        let run = thinned(run, (x0, x1), 600, panel.log);
                        let drawn = chart.draw_series(LineSeries::new(run, colour.stroke_width(2)))?;
                        if part == 0 && !s.label.is_empty() {
                            drawn
                                .label(&s.label)
                                .legend(move |(x, y)| PathElement::new([(x, y), (x + 20, y)], colour.stroke_width(2)));
                        }
                    }
                }
            }
            if labels > 1 {
                chart
                    .configure_series_labels()
                    .position(corner)
                    .background_style(WHITE.mix(0.85))
                    .border_style(RGBColor(200, 200, 200))
                    .label_font(("sans-serif", 13))
                    .draw()?;
            }
        }};
    }
    if panel.log {
        fill!(builder.build_cartesian_2d((x0..x1).log_scale(), (y0..y1).log_scale())?);
    } else {
        fill!(builder.build_cartesian_2d(x0..x1, y0..y1)?);
    }
    Ok(())
}

/// Pairs of figures by name, as horizontal bars.
#[derive(Debug, Clone)]
pub struct Bars {
    /// Above it.
    pub title: String,
    /// Of the figures.
    pub unit: String,
    /// Names of the first and the second figure of a row.
    pub labels: [String; 2],
    /// Name and figures; NaN: none. The longest bars are cut where they would dwarf the rest, and say so.
    pub rows: Vec<(String, [f64; 2])>,
}

/// Height of one row of [`bars`], pixels.
const ROW: u32 = 30;

/// Bars as an SVG.
///
/// # Errors
/// If the drawing library fails.
pub fn bars(b: &Bars, width: u32) -> anyhow::Result<String> {
    let mut figures: Vec<f64> = b.rows.iter().flat_map(|r| r.1).filter(|v| v.is_finite()).collect();
    figures.sort_by(f64::total_cmp);
    // Room for twice the upper quartile: an outlier is cut, and its figure stands beside it.
    let most = figures.last().copied().unwrap_or(1.0);
    let quartile = figures.get(figures.len() * 3 / 4).copied().unwrap_or(most);
    let end = most.min(2.0 * quartile).max(1e-12);
    // Room for the longest name.
    let longest = b.rows.iter().map(|r| r.0.chars().count()).max().unwrap_or(0) as i32;
    let (left, right, top) = ((24 + 13 * longest / 2).max(120), 90i32, 64i32);
    let height = top as u32 + ROW * b.rows.len() as u32 + 14;
    let mut out = String::new();
    {
        let root = SVGBackend::with_string(&mut out, (width, height)).into_drawing_area();
        root.fill(&WHITE)?;
        let text = |size: i32| ("sans-serif", size).into_font().color(&BLACK);
        root.draw(&Text::new(format!("{}, {}", b.title, b.unit), (12, 12), text(17)))?;
        let colours = [PALETTE[0], PALETTE[1]];
        for (k, label) in b.labels.iter().enumerate() {
            let x = left + 190 * k as i32;
            root.draw(&Rectangle::new([(x, 40), (x + 14, 52)], colours[k].filled()))?;
            root.draw(&Text::new(label.clone(), (x + 20, 39), text(14)))?;
        }
        let scale = f64::from(width as i32 - left - right) / end;
        for (n, (name, pair)) in b.rows.iter().enumerate() {
            let y = top + (ROW * n as u32) as i32;
            root.draw(&Text::new(name.clone(), (12, y + 6), text(14)))?;
            for (k, v) in pair.iter().enumerate().filter(|(_, v)| v.is_finite()) {
                let (y, x) = (y + 2 + 12 * k as i32, left + (v.min(end) * scale) as i32);
                root.draw(&Rectangle::new([(left, y), (x, y + 10)], colours[k].filled()))?;
                let cut = if *v > end { " (cut)" } else { "" };
                root.draw(&Text::new(format!("{}{cut}", short(*v)), (x + 5, y - 2), text(12)))?;
            }
        }
        root.present()?;
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dots_are_one_path_and_long_lines_are_short() {
        let dots: Vec<(f64, f64)> = (0..500).map(|k| (f64::from(k), f64::from(k % 7))).collect();
        let line: Vec<(f64, f64)> = (0..100_000).map(|k| (f64::from(k) / 200.0, f64::from(k % 7))).collect();
        let of =
            |points: &[(f64, f64)], dots: bool| Series { points: points.to_vec(), dots, label: "l".into(), colour: 1 };
        let panel = Panel { series: vec![of(&dots, true), of(&line, false)], ..Panel::default() };
        let picture = svg(&[panel], 1, 400, 300).expect("drawn");
        assert!(!picture.contains("<circle") && picture.matches("h0M").count() > 400, "{}", picture.len());
        assert!(picture.len() < 60_000, "{}", picture.len());
        let thin = thinned(&line, (0.0, 500.0), 600, false);
        assert!(thin.len() <= 4 * 600 && thin[0] == line[0] && thin.last() == line.last());
        assert_eq!(thin.iter().map(|p| p.1).fold(0.0, f64::max), 6.0);
    }
}
