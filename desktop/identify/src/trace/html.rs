//! The report as one self-contained page.

use super::data::Data;
use super::{shapes, Image, Report, Trace};
use crate::fit;
use hrg_data::axes::AXIS_NAMES;
use hrg_data::numeric::allan;
use hrg_data::numeric::stats::block_means;
use hrg_data::page;
use hrg_data::page::Tone;
use hrg_data::plot::{escape, Panel, Series};
use hrg_data::recording::metadata::in_unit;
use std::fmt::Write as _;

/// Means of a series, with their times in hours.
fn against_time(values: &[f64], mean_s: usize) -> Vec<(f64, f64)> {
    let hours = |k: usize| (k as f64 + 0.5) * mean_s as f64 / 3600.0;
    block_means(values, mean_s).iter().enumerate().map(|(k, v)| (hours(k), *v)).collect()
}

/// Amplitude spectral density of 100 s means by direct Fourier sums, at 60 frequencies.
fn spectrum(values: &[f64]) -> Vec<(f64, f64)> {
    let v: Vec<f64> = block_means(values, 50);
    let m = hrg_data::numeric::stats::mean(&v);
    let v: Vec<f64> = v.iter().map(|x| if x.is_finite() { x - m } else { 0.0 }).collect();
    let n = v.len();
    let (low, high) = (1.0 / n as f64, 0.5);
    (0..60)
        .map(|k| {
            // Averaged over four neighbouring frequencies, so that the line is steady.
            let f = low * (high / low).powf(f64::from(k) / 59.0);
            let mut power = 0.0;
            for j in 0..4 {
                let g = f * (1.0 + 0.02 * f64::from(j));
                let (mut re, mut im) = (0.0, 0.0);
                for (t, x) in v.iter().enumerate() {
                    let (s, c) = (std::f64::consts::TAU * g * t as f64).sin_cos();
                    re += c * x;
                    im += s * x;
                }
                power += re * re + im * im;
            }
            (f / 50.0 * 1000.0, (power / 4.0 * 2.0 * 50.0 / n as f64).sqrt())
        })
        .collect()
}

fn series(label: &str, points: Vec<(f64, f64)>, colour: usize, dots: bool) -> Series {
    Series { label: label.into(), points, colour, dots }
}

fn panel(title: String, x: &str, y: &str, log: bool, series: Vec<Series>) -> Panel {
    Panel { title, x: x.into(), y: y.into(), log, series }
}

/// Ramps that are slower are a soak, C per minute.
const SOAK_C_PER_MIN: f64 = 0.02;

/// Means of the temperature of an axis on the verify run, and of its ramp.
fn states(t: &Trace, a: usize) -> (Vec<f64>, Vec<f64>) {
    let (run, mean_s) = (&t.verify, t.verify.steps.mean_s);
    let each: Vec<(f64, f64)> = (0..run.steps.len())
        .map(|k| run.state(k, a).map_or((f64::NAN, f64::NAN), |s| (f64::from(s.0), f64::from(s.1))))
        .collect();
    let (temperature, ramp): (Vec<f64>, Vec<f64>) = each.into_iter().unzip();
    (block_means(&temperature, mean_s), block_means(&ramp, mean_s))
}

/// Rates that the unit would send on the verify run with the baseline, and with the image that is written: over temperature, heating and cooling
/// apart, about the constant of that day.
fn first_pictures(t: &Trace, limit_dph: Option<f64>) -> anyhow::Result<String> {
    let about_mean = |values: &[f64]| {
        let means = block_means(values, t.verify.steps.mean_s);
        let mean = hrg_data::numeric::stats::mean(&means);
        means.into_iter().map(|m| m - mean).collect::<Vec<f64>>()
    };
    let [before, after] = [&t.baseline, &t.image].map(|c| fit::correct(c, &t.verify.steps));
    let panels: Vec<Panel> = t
        .verify
        .steps
        .present()
        .map(|a| {
            let (temperature, ramp) = states(t, a);
            let (before, after) = (about_mean(&before[a]), about_mean(&after[a]));
            let of = |values: &[f64], keep: &dyn Fn(f64) -> bool| -> Vec<(f64, f64)> {
                let all = temperature.iter().zip(&ramp).zip(values);
                all.filter(|((_, r), _)| keep(**r)).map(|((t, _), v)| (*t, *v)).collect()
            };
            let heating = |r: f64| r > SOAK_C_PER_MIN;
            let cooling = |r: f64| r < -SOAK_C_PER_MIN;
            let mut all = vec![
                series("", of(&before, &|_| true), 0, true),
                series("", of(&after, &heating), 2, true),
                series("", of(&after, &cooling), 3, true),
                series("", of(&after, &|r| r.abs() <= SOAK_C_PER_MIN), 4, true),
            ];
            if t.report.image != Image::Extended {
                all[0].points.clear();
            }
            if let Some(limit) = limit_dph {
                let ends = temperature.iter().filter(|v| v.is_finite());
                let (low, high) = ends.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v)));
                all.push(series("", vec![(low, limit), (high, limit)], 1, false));
                all.push(series("", vec![(low, -limit), (high, -limit)], 1, false));
            }
            panel(
                format!("{}: residual of the verify run", AXIS_NAMES[a]),
                "temperature [C]",
                "mean [deg/h]",
                false,
                all,
            )
        })
        .collect();
    let of_image = match t.report.image {
        Image::Extended => ["image, heating", "image, cooling", "image, soak"],
        Image::Baseline | Image::None => ["baseline, heating", "baseline, cooling", "baseline, soak"],
    };
    let mut meanings = vec![(of_image[0], 2), (of_image[1], 3), (of_image[2], 4)];
    if t.report.image == Image::Extended {
        meanings.insert(0, ("baseline", 0));
    }
    if limit_dph.is_some() {
        meanings.push(("limit", 1));
    }
    Ok(page::pictures(&panels)?
        + &page::legend(&meanings)
        + "<p class=small>Corrected rates, means about the constant of that day.</p>")
}

fn pictures(t: &Trace, a: usize) -> anyhow::Result<String> {
    let (name, mean_s) = (AXIS_NAMES[a], t.verify.steps.mean_s);
    let [before, after] = &t.verify_residuals;
    let (mt, mr) = states(t, a);
    let pair = |x: &[f64], y: &[f64]| -> Vec<(f64, f64)> {
        x.iter().zip(block_means(y, mean_s)).map(|(x, y)| (*x, y)).collect()
    };
    let direction = |y: &[f64], keep: &dyn Fn(f64) -> bool| -> Vec<(f64, f64)> {
        mr.iter().zip(block_means(y, mean_s)).filter(|(r, _)| keep(**r)).map(|(r, y)| (*r, y)).collect()
    };
    let panels = [
        panel(
            format!("{name}: residual against temperature, verify run"),
            "temperature [C]",
            "mean [deg/h]",
            false,
            vec![series("before", pair(&mt, &before[a]), 0, true), series("after", pair(&mt, &after[a]), 1, true)],
        ),
        panel(
            format!("{name}: residual after, against dT/dt"),
            "dT/dt [C/min]",
            "mean [deg/h]",
            false,
            vec![
                series("heating", direction(&after[a], &|r| r > SOAK_C_PER_MIN), 2, true),
                series("cooling", direction(&after[a], &|r| r < -SOAK_C_PER_MIN), 3, true),
                series("soak", direction(&after[a], &|r| r.abs() <= SOAK_C_PER_MIN), 0, true),
            ],
        ),
        panel(
            format!("{name}: residual against time, verify run"),
            "time [h]",
            "mean [deg/h]",
            false,
            vec![
                series("before", against_time(&before[a], mean_s), 0, false),
                series("after", against_time(&after[a], mean_s), 1, false),
            ],
        ),
        panel(
            format!("{name}: spectrum"),
            "frequency [mHz]",
            "deg/h per root Hz",
            true,
            vec![series("before", spectrum(&before[a]), 0, false), series("after", spectrum(&after[a]), 1, false)],
        ),
        panel(
            format!("{name}: Allan deviation"),
            "averaging time [s]",
            "deg/h",
            true,
            vec![series("before", curve(&before[a]), 0, false), series("after", curve(&after[a]), 1, false)],
        ),
        panel(
            format!("{name}: residual against time, train run"),
            "time [h]",
            "mean [deg/h]",
            false,
            vec![
                series("before", against_time(&t.train_residuals[0][0][a], mean_s), 0, false),
                series("after", against_time(&t.train_residuals[1][0][a], mean_s), 1, false),
            ],
        ),
    ];
    page::pictures(&panels)
}

fn figures(r: &Report) -> String {
    let judged = if r.judged_by == "judge" { "on the judging run" } else { "" };
    let mut s = format!(
        "<div class=wide><table><tr><th></th><th colspan=2>train runs</th><th colspan=2>verify run</th><th colspan=4>the image on the verify run</th><th></th><th></th><th></th></tr>\
         <tr><th>axis</th><th>baseline</th><th>with effects</th><th>baseline</th><th>with effects</th><th>model</th><th>deviation</th><th>constant of that day</th><th>RMS {judged}</th><th>noise</th><th>left, in noise floors</th><th>structure left</th></tr>"
    );
    for n in r.axes() {
        let (b, f, ratio) = (r.baseline[n], r.r#final[n], r.floor_ratio[n]);
        let left = if r.unexplained[n] { escape(&r.left_over[n].join("; ")) } else { "none found".into() };
        let image = r.block.as_ref().map_or("<td>none</td><td>-</td><td>-</td><td>-</td>".to_string(), |block| {
            let (i, model) = (block[n], serde_json::to_value(block[n].model).ok());
            format!(
                "<td>{}</td><td><b>{:.3}</b></td><td>{:+.3} &plusmn; {:.3}</td><td>{:.3}</td>",
                model.as_ref().and_then(serde_json::Value::as_str).unwrap_or_default(),
                i.verify_rms_dph,
                i.mean_dph,
                i.mean_std_dph,
                r.judge[n].rms_dph
            )
        });
        let _ = write!(
            s,
            "<tr><td>{n}</td><td>{:.3}</td><td>{:.3}</td><td>{:.3}</td><td>{:.3}</td>{image}<td>{:.3}</td><td>{:.2} [{:.2}, {:.2}]</td><td>{left}</td></tr>",
            b.train_rms_dph,
            f.train_rms_dph,
            b.verify_rms_dph,
            f.verify_rms_dph,
            r.noise_floor_dph[n],
            ratio.ratio,
            ratio.low,
            ratio.high
        );
    }
    let (train, verify) = r.baseline.values().next().map_or((0, 0), |b| (b.train_means, b.verify_means));
    s + &format!(
        "</table></div><p class=small>deg/h: standard deviation of means over {} s, {train} of the train runs and {verify} of the verify run; RMS: with the constant of that day. The noise comes from what neighbouring means differ by; the brackets hold 95 %.</p>",
        r.mean_s
    )
}

/// Table of the values taken out of the files.
fn cleaned(r: &Report) -> String {
    let mut rows = String::new();
    for (file, columns) in &r.cleaned {
        for (column, kinds) in columns {
            for (kind, count) in kinds {
                let _ = write!(
                    rows,
                    "<tr><td>{}</td><td>{}</td><td>{kind}</td><td>{count}</td></tr>",
                    escape(file),
                    escape(column)
                );
            }
        }
    }
    if rows.is_empty() {
        return "<p>Nothing was taken out of the files.</p>".into();
    }
    format!(
        "<div class=wide><table><tr><th>file</th><th>column</th><th>kind</th><th>values</th></tr>{rows}</table></div>"
    )
}

fn ranking(t: &Trace) -> anyhow::Result<String> {
    let r = &t.report;
    let mut s = String::new();
    let data = Data::new(&t.train, t.baseline.scaling, t.lag_s);
    for (e, shapes) in r.effects.iter().zip(shapes::of(&data, &t.fitted)) {
        let _ = write!(
            s,
            "<h3>{} <span class=small>{}{} &middot; {} &middot; {}</span></h3>",
            escape(&e.label()),
            e.class.name(),
            Some(e.parameters_text()).filter(|t| !t.is_empty()).map_or(String::new(), |t| format!(" &middot; {t}")),
            match e.confirmed {
                Some(true) => "confirmed by the verify run",
                Some(false) => "not confirmed by the verify run",
                None => "cannot be confirmed by another run",
            },
            if e.reach == "unit" { "compensated by the unit".to_string() } else { escape(&e.reach) }
        );
        s += &page::pictures(&shapes)?;
        s += "<div class=wide><table><tr><th>axis</th><th>size, train runs (deg/h)</th><th>gains</th><th>share of it on the verify run</th></tr>";
        for (n, g) in &e.axes {
            let share =
                e.on_verify.get(n).map_or("-".to_string(), |v| format!("{:.2} &plusmn; {:.2}", v.share, v.share_std));
            let at = e.break_text(g).map_or(String::new(), |v| format!("slope changes at {v}; "));
            let gains = format!("{at}{}", g.gains_text()).replace("+-", "&plusmn;");
            let _ = write!(s, "<tr><td>{n}</td><td>{:.3}</td><td>{gains}</td><td>{share}</td></tr>", g.size_dph);
        }
        s += "</table></div><div class=wide><table><tr><th>candidate for this place</th><th>log prior odds</th><th>log evidence</th><th>score</th><th>less cross-validated error</th></tr>";
        for k in &e.rank {
            let _ = write!(
                s,
                "<tr><td>{}</td><td>{:.1}</td><td>{:.1}</td><td>{:.1}</td><td>{:.1} %</td></tr>",
                escape(&k.name),
                k.score.log_prior,
                k.score.log_evidence,
                k.score.total(),
                100.0 * k.gain_in_cv
            );
        }
        s += "</table></div>";
        if !e.indistinguishable_from.is_empty() {
            let _ =
                write!(s, "<p>This profile cannot tell it from: {}.</p>", escape(&e.indistinguishable_from.join(", ")));
        }
    }
    if r.effects.is_empty() {
        s += "<p>The data warrant no effect.</p>";
    }
    Ok(s)
}

/// The page.
///
/// # Errors
/// If a picture cannot be drawn.
pub fn html(t: &Trace) -> anyhow::Result<String> {
    html_with(t, None)
}

/// The page, with a limit in its first pictures, deg/h.
///
/// # Errors
/// If a picture cannot be drawn.
pub fn html_with(t: &Trace, limit_dph: Option<f64>) -> anyhow::Result<String> {
    let r = &t.report;
    let tone = if r.burn { Tone::Good } else { Tone::Open };
    let verdict: Vec<String> = r
        .verdict
        .lines()
        .map(|line| match line.split_once(':') {
            Some((head, rest)) if head.len() < 80 => format!("<b>{}:</b>{}", escape(head), escape(rest)),
            _ => escape(line),
        })
        .collect();
    let mut s = format!("<h1>What the model of {} lacks</h1>", escape(&r.unit));
    s += &first_pictures(t, limit_dph)?;
    s += &page::boxed(&verdict.join("<br>"), tone);
    if !r.advice.is_empty() {
        s += &page::folded("Advice", &page::list(&r.advice));
    }
    s += &page::folded("Before and after, in figures", &figures(r));
    s += &page::folded("Effects: what they add, and what else was tried", &ranking(t)?);
    let each: anyhow::Result<Vec<String>> = t.verify.steps.present().map(|a| pictures(t, a)).collect();
    s += &page::folded("Residuals over ramp and time, spectrum, Allan deviation", &each?.concat());
    if !r.notes.is_empty() {
        s += &page::folded("Notes on the data", &page::list(&r.notes));
    }
    s += &page::folded("Taken out of the files", &cleaned(r));
    Ok(in_unit(&page::page(&format!("hrg trace: {}", escape(&r.unit)), &s), &r.rate_unit))
}

/// An Allan deviation as points of a picture.
fn curve(values: &[f64]) -> Vec<(f64, f64)> {
    let points = allan::overlapping(values, f64::from(hrg_core::MODEL_STEP_S), &allan::octaves(values.len()));
    points.into_iter().map(|p| (p.tau_s, p.deviation)).collect()
}
