//! Pictures: series over a common x, as SVG.

use plotters::prelude::*;
use plotters::style::full_palette::{BLUE_600, GREY_500, ORANGE_700, TEAL_700};

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
    /// What it shows.
    pub series: Vec<Series>,
}

/// Colours that stay apart for colour-blind eyes: before (grey), after (blue), warm (orange), cold (teal).
pub const PALETTE: [RGBColor; 4] = [GREY_500, BLUE_600, ORANGE_700, TEAL_700];

/// Panels in a grid of `columns`, as an SVG of `width` by `height` per panel.
///
/// # Errors
/// Where the drawing library fails.
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
    Ok(out)
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
    // Room above the data for the legend.
    let y1 = if panel.series.len() > 1 && !panel.log { y1 + 0.14 * panel.series.len() as f64 * (y1 - y0) } else { y1 };
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
                .light_line_style(RGBColor(245, 245, 245))
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
                        let drawn = chart.draw_series(LineSeries::new(run.iter().copied(), colour.stroke_width(2)))?;
                        if part == 0 {
                            drawn
                                .label(&s.label)
                                .legend(move |(x, y)| PathElement::new([(x, y), (x + 20, y)], colour.stroke_width(2)));
                        }
                    }
                }
            }
            if panel.series.len() > 1 {
                chart
                    .configure_series_labels()
                    .position(if panel.log { SeriesLabelPosition::UpperRight } else { SeriesLabelPosition::UpperLeft })
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
