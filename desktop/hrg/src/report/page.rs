//! The report as text and as a page.

use super::{AxisReport, Bin, Quantity, Report};
use hrg_data::numeric::allan;
use hrg_data::page;
use hrg_data::plot::{escape, Panel, Series};
use hrg_data::recording::metadata::in_unit;
use std::fmt::Write as _;

/// A value with few digits.
fn short(v: f64) -> String {
    if v == 0.0 {
        return "0".into();
    }
    let digits = (3 - v.abs().max(1e-9).log10().ceil() as i32).clamp(0, 6) as usize;
    format!("{v:.digits$}")
}

fn cells(q: &Quantity) -> (String, String) {
    match (q.value, q.low, q.high) {
        (Some(v), Some(l), Some(h)) => (short(v), format!("{} to {}", short(l), short(h))),
        _ => ("-".into(), "-".into()),
    }
}

/// As text.
#[must_use]
pub fn text(r: &Report) -> String {
    in_unit(&text_in_dph(r), &r.rate_unit)
}

fn text_in_dph(r: &Report) -> String {
    let mut s = format!("{}: {}\n", r.unit, r.recordings.join(", "));
    for axis in &r.axes {
        let _ =
            writeln!(s, "\naxis {:<37}{:>12}  {:<22} {:<16} conditions", axis.axis, "value", "95 % interval", "unit");
        for q in &axis.quantities {
            let (value, interval) = cells(q);
            let _ = writeln!(s, "  {:<40}{value:>12}  {interval:<22} {:<16} {}", q.name, q.unit, q.conditions);
        }
    }
    for n in &r.notes {
        let _ = writeln!(s, "- {n}");
    }
    s
}

/// As a page.
///
/// # Errors
/// If a picture cannot be drawn.
pub fn html(r: &Report) -> anyhow::Result<String> {
    Ok(in_unit(&html_in_dph(r)?, &r.rate_unit))
}

fn html_in_dph(r: &Report) -> anyhow::Result<String> {
    let panels: Vec<Panel> = r.axes.iter().filter_map(over_temperature).collect();
    let mut s = format!("<h1>Figures of {}</h1>", escape(&r.unit));
    s += &page::pictures(&panels)?;
    s += &format!("<p>From {}. Intervals hold the true value with 95 %.</p>", escape(&r.recordings.join(", ")));
    for axis in &r.axes {
        let _ = write!(
            s,
            "<h2>Axis {}</h2><div class=wide><table><tr><th>quantity<th>value<th>95 % interval<th>unit<th class=left>conditions</tr>",
            axis.axis
        );
        for q in &axis.quantities {
            let (value, interval) = cells(q);
            let _ = write!(
                s,
                "<tr><td>{}<td>{value}<td>{interval}<td>{}<td class=\"left small\">{}</tr>",
                q.name,
                q.unit,
                escape(&q.conditions)
            );
        }
        s += "</table></div>";
    }
    if !r.notes.is_empty() {
        s += "<h2>Notes</h2>";
        s += &page::list(&r.notes);
    }
    let deviations: Vec<Panel> = r.axes.iter().map(deviation).collect();
    s += &page::folded("Allan deviation", &page::pictures(&deviations)?);
    Ok(page::page(&format!("hrg report: {}", escape(&r.unit)), &s))
}

fn line(label: &str, points: Vec<(f64, f64)>, colour: usize) -> Series {
    Series { label: label.into(), points, colour, dots: false }
}

/// Bias over temperature, heating and cooling apart; `None` of a recording at one temperature.
fn over_temperature(axis: &AxisReport) -> Option<Panel> {
    let bins = &axis.bias_over_temperature;
    let of = |f: &dyn Fn(&Bin) -> Option<f64>| {
        bins.iter().filter_map(|b| Some((b.temperature_c, f(b)?))).collect::<Vec<_>>()
    };
    (bins.len() > 1).then(|| Panel {
        title: format!("{}: bias over temperature", axis.axis),
        x: "temperature [C]".into(),
        y: "rate [deg/h]".into(),
        log: false,
        series: vec![
            line("mean", of(&|b| Some(b.mean_dph)), 0),
            line("heating", of(&|b| b.heating_dph), 2),
            line("cooling", of(&|b| b.cooling_dph), 3),
        ],
    })
}

fn deviation(axis: &AxisReport) -> Panel {
    let curve = |f: &dyn Fn(&allan::Point) -> f64| axis.allan.iter().map(|p| (p.tau_s, f(p))).collect::<Vec<_>>();
    let bars = axis.allan.iter().flat_map(|p| [(p.tau_s, p.low), (p.tau_s, p.high), (f64::NAN, f64::NAN)]);
    Panel {
        title: format!("{}: Allan deviation, bars of one sigma", axis.axis),
        x: "averaging time [s]".into(),
        y: "deg/h".into(),
        log: true,
        series: vec![line("deviation", curve(&|p| p.deviation), 1), line("", bars.collect(), 1)],
    }
}
