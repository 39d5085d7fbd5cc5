//! The report as text and as a page.

use super::{AxisReport, Bin, Quantity, Report};
use hrg_data::numeric::allan;
use hrg_data::plot;
use hrg_data::plot::{escape, Panel, Series};
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
    let mut s = format!(
        "<!doctype html><html lang=en><meta charset=utf-8><title>hrg report: {0}</title><style>\
         body{{font:15px/1.45 system-ui,sans-serif;margin:24px auto;max-width:1180px;padding:0 16px;color:#222}}\
         h1{{font-size:22px}}h2{{font-size:18px;margin-top:28px}}table{{border-collapse:collapse;margin:6px 0}}\
         td,th{{border-bottom:1px solid #ddd;padding:3px 12px;text-align:right;vertical-align:top}}\
         td:first-child,th:first-child,td:last-child,th:last-child{{text-align:left}}\
         td,th{{white-space:nowrap}}td:last-child{{white-space:normal;color:#666;font-size:13px}}th{{font-weight:600;background:#f6f6f6}}svg{{max-width:100%;height:auto}}\
         </style><h1>Figures of {0}</h1><p>From {1}. Intervals hold the true value with 95 %.</p>",
        escape(&r.unit),
        escape(&r.recordings.join(", "))
    );
    for axis in &r.axes {
        let _ = write!(
            s,
            "<h2>Axis {}</h2><table><tr><th>quantity<th>value<th>95 % interval<th>unit<th>conditions</tr>",
            axis.axis
        );
        for q in &axis.quantities {
            let (value, interval) = cells(q);
            let _ = write!(
                s,
                "<tr><td>{}<td>{value}<td>{interval}<td>{}<td>{}</tr>",
                q.name,
                q.unit,
                escape(&q.conditions)
            );
        }
        s += "</table>";
        s += &pictures(axis)?;
    }
    if !r.notes.is_empty() {
        s += "<h2>Notes</h2><ul>";
        r.notes.iter().for_each(|n| s += &format!("<li>{}</li>", escape(n)));
        s += "</ul>";
    }
    Ok(s + "</html>\n")
}

fn pictures(axis: &AxisReport) -> anyhow::Result<String> {
    let line = |label: &str, points: Vec<(f64, f64)>, colour: usize| Series {
        label: label.into(),
        points,
        colour,
        dots: false,
    };
    let bins = &axis.bias_over_temperature;
    let of = |f: &dyn Fn(&Bin) -> Option<f64>| {
        bins.iter().filter_map(|b| Some((b.temperature_c, f(b)?))).collect::<Vec<_>>()
    };
    let mut panels = Vec::new();
    if bins.len() > 1 {
        panels.push(Panel {
            title: format!("{}: bias over temperature", axis.axis),
            x: "temperature [C]".into(),
            y: "rate [deg/h]".into(),
            log: false,
            series: vec![
                line("mean", of(&|b| Some(b.mean_dph)), 0),
                line("heating", of(&|b| b.heating_dph), 2),
                line("cooling", of(&|b| b.cooling_dph), 3),
            ],
        });
    }
    let curve = |f: &dyn Fn(&allan::Point) -> f64| axis.allan.iter().map(|p| (p.tau_s, f(p))).collect::<Vec<_>>();
    panels.push(Panel {
        title: format!("{}: Allan deviation, bars of one sigma", axis.axis),
        x: "averaging time [s]".into(),
        y: "deg/h".into(),
        log: true,
        series: vec![
            line("deviation", curve(&|p| p.deviation), 1),
            line(
                "",
                axis.allan.iter().flat_map(|p| [(p.tau_s, p.low), (p.tau_s, p.high), (f64::NAN, f64::NAN)]).collect(),
                1,
            ),
        ],
    });
    plot::svg(&panels, 2, 560, 340)
}
