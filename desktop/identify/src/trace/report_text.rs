//! The sentences of a report. Each word comes from a number of the report.
//!
//! The verdict has four lines: burn or not; why; what is left; the next step.

use super::beyond::OF_A_FORM;
use super::image::UNREADABLE;
use super::odds::THRESHOLD;
use super::report::{three_digits, AxisModel, ByAxis, Found, Image, Judged, OnVerify, Report, VerdictKind};
use hrg_core::effects::EffectId;
use hrg_data::cards::Class;
use hrg_data::cards::{card, parting};
use hrg_data::error::list;
use hrg_data::recording::metadata::in_unit;
use std::collections::BTreeSet;

/// Meaning of a parameter with its value, for those that a reader can use.
fn parameter(name: &str, value: f64) -> Option<String> {
    let v = three_digits(value);
    Some(match name {
        "tau_s" => format!("time constant {v} s"),
        "width_c" => format!("width {v} C"),
        "break_c" => format!("at {v} C"),
        "period_c" => format!("period {v} C"),
        "period_s" => format!("period {v} s"),
        "time_s" => format!("at {v} s"),
        "on_c" => format!("on at {v} C"),
        "off_c" => format!("off at {v} C"),
        "ramp_c_per_min" => format!("beyond {v} C per minute"),
        _ => return None,
    })
}

/// An effect by its name, with its meaning, its parameters, and the axes that have it.
fn described(e: &Found, there: usize) -> String {
    let meaning = EffectId::by_name(&e.name).map_or("an effect of your own", |id| card(id).meaning);
    let parameters = e.parameters.iter().filter_map(|(n, v)| parameter(n, *v));
    let details: Vec<String> = std::iter::once(meaning.to_string()).chain(parameters).collect();
    let axes: Vec<&String> = e.axes.keys().collect();
    let on = if axes.len() == there { String::new() } else { format!(" on {}", list(&axes)) };
    format!("{} ({}){on}", e.label(), details.join(", "))
}

fn figures(axes: &[&str], of: impl Fn(&str) -> f64) -> String {
    list(&axes.iter().map(|n| three_digits(of(n))).collect::<Vec<_>>())
}

/// Figures of the written image and of the baseline on the verify run.
fn left_by_both(r: &Report, block: &ByAxis<OnVerify>) -> String {
    let axes = r.axes();
    let means = r.baseline.values().map(|b| b.verify_means).min().unwrap_or(0);
    let mut s = format!(
        "it leaves {} deg/h on {} of the verify run{}; the baseline leaves {} (standard deviation of {means} means of {} s)",
        figures(&axes, |n| block[n].verify_rms_dph),
        list(&axes),
        if r.verify_left_out_s > 0 { format!(" without its first {} s", r.verify_left_out_s) } else { String::new() },
        figures(&axes, |n| r.baseline[n].verify_rms_dph),
        r.mean_s
    );
    let of = |model: AxisModel| -> Vec<&str> { axes.iter().copied().filter(|n| block[*n].model == model).collect() };
    let (plain, constant) = (of(AxisModel::Baseline), of(AxisModel::Constant));
    if !plain.is_empty() && r.image == Image::Extended {
        s += &format!("; on {} the image holds the baseline alone", list(&plain));
    }
    let differs = |n: &&str| {
        let (ours, theirs) = (block[*n].verify_rms_dph, r.baseline[*n].verify_rms_dph);
        block[*n].model == AxisModel::Baseline && (ours - theirs).abs() > 0.02 * theirs
    };
    let with_prior: Vec<&str> = axes.iter().copied().filter(differs).collect();
    if !with_prior.is_empty() {
        s += &format!(
            "; the image's baseline on {} is not the one by least squares: its ramp terms have a prior, as temperature and ramp went together in the train runs",
            list(&with_prior)
        );
    }
    if !constant.is_empty() {
        s += &format!("; on {} the image holds a constant alone", list(&constant));
    }
    s
}

/// The note where structure is left and not all forms were tried.
pub const NOT_OFFERED: &str = "the train runs pass no third of their temperatures twice the same way: forms that one heating and one cooling do not tell from what happened once were not tried (docs/trace.md, section 3); a profile that goes through the range twice offers them";

/// First line: whether to burn, and what the image does.
fn burn(r: &Report) -> String {
    let Some(block) = &r.block else {
        let why = if r.notes.iter().any(|n| n == UNREADABLE) {
            "a number of the model is beyond what an image holds"
        } else {
            "not even the baseline leaves less than the raw rates on the verify run"
        };
        return format!("Do not burn: no image was made, as {why}.");
    };
    let figures = left_by_both(r, block);
    if r.burn {
        return format!("Burn the image: {figures}.");
    }
    let axes = uncertain_elsewhere(r);
    let elsewhere = format!(
        "on {} it leaves too much of what the baseline leaves to be the better one on another profile, too (--judge RUN with a third one tells; --repeat-is-enough if the unit will never meet another)",
        list(&axes)
    );
    let worse: Vec<&String> = r.judge.iter().filter(|(_, j)| j.worse_than_a_constant).map(|(n, _)| n).collect();
    let worse_than = format!(
        "on {} its error, the day's constant included, is larger than that of a constant alone, of no correction or of the baseline",
        list(&worse)
    );
    let contradicted = contradicted(r);
    let contradiction = format!(
        "on {} a constant leaves less than what was learnt, and that is more than noise: the runs contradict each other there",
        list(&contradicted)
    );
    let why = match r.image {
        Image::Baseline if r.effects.is_empty() => return format!("Nothing beyond the baseline to burn: {figures}."),
        Image::Baseline => "no effect that a unit can compute was borne out, and the image is the baseline alone",
        _ if r.verify_repeats_train => "the verify run repeats the profile of a train run and shows nothing of other temperatures and ramps (--repeat-is-enough if the unit will never meet another)",
        _ if !contradicted.is_empty() => &contradiction,
        _ if !worse.is_empty() => &worse_than,
        _ if !judged_good(r) => "the run that judges does not bear it out",
        _ if !axes.is_empty() => &elsewhere,
        _ => "it does not beat the image in use by more than its uncertainty",
    };
    let figures = figures.replacen("it", "It", 1);
    format!("Do not burn: {why}. {figures}.")
}

/// Axes on which the runs contradict each other.
fn contradicted(r: &Report) -> Vec<&String> {
    r.judge.iter().filter(|(_, j)| j.contradicted).map(|(n, _)| n).collect()
}

/// Axes on which the image may be worse than the baseline on another profile.
fn uncertain_elsewhere(r: &Report) -> Vec<&String> {
    r.judge.iter().filter(|(_, j)| j.uncertain_elsewhere).map(|(n, _)| n).collect()
}

/// `true` if the judge bears the extended axes out.
fn judged_good(r: &Report) -> bool {
    let each: Vec<((), _)> = r.judge.values().map(|j| ((), j.agreement)).collect();
    !super::judge::borne_out(&each).is_empty() && !r.judge.values().any(|j| j.agreement.loses())
}

/// Second line: the effects, and what the verify run says of them.
fn why(r: &Report) -> String {
    let there = r.baseline.len();
    if r.effects.is_empty() {
        return match r.verdict_kind {
            VerdictKind::NothingLacks => {
                "Why: the train runs warrant no effect beside the baseline, and what is left is noise.".into()
            }
            _ => "Why: structure is left that no effect of the library explains.".into(),
        };
    }
    let of = |wanted: Option<bool>| -> Vec<String> {
        merged(&r.effects).filter(|(e, _)| e.confirmed == wanted).map(|(e, n)| named(e, n, there)).collect()
    };
    let mut parts = Vec::new();
    let (yes, no, open) = (of(Some(true)), of(Some(false)), of(None));
    if !yes.is_empty() {
        let but = if r.image == Image::Baseline { ", and an image with it is not the better one" } else { "" };
        parts.push(format!("the verify run confirms {}{but}", list(&yes)));
    }
    if r.burn && yes.is_empty() && !no.is_empty() {
        let alone =
            if no.len() > 1 { "confirms none of its effects alone" } else { "does not confirm its effect alone" };
        parts.push(format!("the run that judges bears the image out; the verify run {alone}: {}", list(&no)));
    } else if !no.is_empty() {
        parts.push(format!("it does not confirm {}", list(&no)).replacen(
            "it does",
            if parts.is_empty() { "the verify run does" } else { "it does" },
            1,
        ));
    }
    if !open.is_empty() {
        parts.push(format!("another run can neither confirm nor deny {}", list(&open)));
    }
    let score = |n: &str, j: &Judged| {
        (r.block.as_ref()?[n].model == AxisModel::Extended).then(|| three_digits(j.agreement.log_score))
    };
    let scores: Vec<(String, String)> = r.judge.iter().filter_map(|(n, j)| Some((n.clone(), score(n, j)?))).collect();
    let mut s = format!("Why: {}", parts.join("; "));
    if !scores.is_empty() {
        let (axes, values): (Vec<String>, Vec<String>) = scores.into_iter().unzip();
        s += &format!(
            "; the evidence for the image is {} on {} (log score{}; the sum must be above {})",
            list(&values),
            list(&axes),
            if r.judged_by == "judge" { " of the run that judges" } else { "" },
            three_digits(THRESHOLD)
        );
    }
    s + "."
}

/// Effects, those events that happened more than once in a run joined: steps and shocks that repeat are a drift.
fn merged(effects: &[Found]) -> impl Iterator<Item = (&Found, usize)> {
    let jump = |e: &Found| e.class == Class::Event && e.parameters.contains_key("time_s");
    let jumps = effects.iter().filter(|e| jump(e)).count();
    let mut seen = false;
    effects.iter().filter_map(move |e| {
        let repeats = jump(e) && jumps > 1;
        let first = !repeats || !std::mem::replace(&mut seen, true);
        first.then_some((e, if repeats { jumps } else { 1 }))
    })
}

fn named(e: &Found, times: usize, there: usize) -> String {
    if times > 1 {
        format!("a drift ({times} jumps in the train runs: something moves again and again)")
    } else {
        described(e, there)
    }
}

/// Third line: what is left, in floors of the noise.
fn left(r: &Report) -> String {
    let lacking: Vec<&str> =
        r.effects.iter().filter(|e| e.reach.starts_with("needs ")).map(|e| e.name.as_str()).collect();
    // (The figure of the model is not what the unit will leave if the image does not hold its effects.)
    let without_effects = |n: &str| {
        let named = r.effects.iter().any(|e| e.axes.contains_key(n)) && lacking.is_empty();
        let axis = r.block.as_ref().map(|b| &b[n]).filter(|b| named && b.model != AxisModel::Extended)?;
        Some(format!(
            " (the model with the effects; the image does not hold them there and leaves {:.1} floors)",
            axis.verify_rms_dph / r.noise_floor_dph[n]
        ))
    };
    let one = |n: &str| {
        let ratio = r.floor_ratio[n];
        let word = match (ratio.is_noise(), r.unexplained[n]) {
            (true, false) => "may be noise",
            (true, true) => "the size of noise; what is not explained is listed below",
            (false, _) => "more than noise",
        };
        format!("{n} {ratio}: {word}{}", without_effects(n).unwrap_or_default())
    };
    let each = r.axes().into_iter().map(one).collect::<Vec<_>>().join("; ");
    let mut s = if lacking.is_empty() {
        format!("Residual on the verify run, in noise floors, with 95 % intervals: {each}.")
    } else {
        let floors = |n: &str| r.block.as_ref().map(|b| b[n].verify_rms_dph / r.noise_floor_dph[n]);
        let image: Vec<String> = r.axes().into_iter().filter_map(floors).map(|v| format!("{v:.1}")).collect();
        let image = if image.is_empty() {
            "no image is written".to_string()
        } else {
            format!("the image leaves {} floors", list(&image))
        };
        format!(
            "Residual on the verify run of the model with {}, which the image does not hold, in noise floors, with 95 % intervals: {each}; {image}.",
            list(&lacking)
        )
    };
    if r.outside_fit >= 0.005 {
        s += &format!(
            " {:.0} % of that run lies outside the temperatures and ramps of the train runs; nothing is promised there.",
            100.0 * r.outside_fit
        );
    }
    let apart = 1.0 - r.visited - r.outside_fit;
    if apart >= 0.005 {
        s += &format!(
            " {:.0} % of the verify run combines temperatures and ramps that never occurred together in the train runs; the unit flags those rows.",
            100.0 * apart
        );
    }
    s
}

/// Constants of the train runs, where there are several.
fn turn_on(r: &Report) -> Option<String> {
    let runs = r.turn_on.values().map(|t| t.constants_dph.len()).max()?;
    let axes: Vec<&String> = r.turn_on.keys().collect();
    let each: Vec<String> = r.turn_on.values().map(|t| three_digits(t.std_dph)).collect();
    let parts: BTreeSet<&str> = r.turn_on.values().flat_map(|t| t.sizes.keys().copied()).collect();
    let of_part = |part: &&str| {
        let on: Vec<(&String, &f64)> =
            r.turn_on.iter().filter_map(|(axis, t)| Some((axis, t.sizes.get(part)?))).collect();
        let shares: Vec<String> = on.iter().map(|(_, share)| format!("{:.0}", 100.0 * **share)).collect();
        let axes: Vec<&String> = on.iter().map(|o| o.0).collect();
        format!(
            "; the size of {part} differs from day to day by {} % on {}, which the image's uncertainty holds",
            list(&shares),
            list(&axes)
        )
    };
    let sizes: String = parts.iter().map(of_part).collect();
    Some(format!(
        "the constants of the {runs} train runs scatter by {} deg/h on {} (standard deviation): the turn-on repeatability, as far as {runs} days tell{sizes}",
        list(&each),
        list(&axes)
    ))
}

/// Fourth line: the next step.
fn next(r: &Report) -> String {
    let step = if r.burn && r.unexplained.values().all(|u| !u) {
        let enough = "no further run is needed for the calibration; check the constants with a run of another day";
        about_starts(r).unwrap_or_else(|| enough.to_string())
    } else if !contradicted(r).is_empty() {
        "compare the columns of the runs (exchanged axes, a sign, a unit), and that all are of one unit".to_string()
    } else if !r.burn && judged_good(r) && !uncertain_elsewhere(r).is_empty() {
        "record a run with a third profile and judge by it (--judge RUN)".to_string()
    } else {
        r.advice.first().cloned().unwrap_or_else(|| match r.verdict_kind {
            VerdictKind::NothingLacks if r.outside_fit > 0.5 => {
                "learn from a run that passes the temperatures and ramps of the verify run".into()
            }
            VerdictKind::Unexplained if r.notes.iter().any(|n| n == NOT_OFFERED) => {
                "learn from a run that goes through its temperatures twice: not all forms were tried".into()
            }
            VerdictKind::NothingLacks => "nothing; the baseline is all that these data warrant".into(),
            _ => "record a second train run with another profile: it separates the properties of the unit from those of one day".into(),
        })
    };
    format!("Next: {step}.")
}

/// Keeps the axes that are there, writes verdict and advice, and names the unit of the figures in all texts.
pub fn write(r: &mut Report, there: &[&str]) {
    r.keep_axes(|n| there.contains(&n));
    let named = |text: String| in_unit(&text, &r.rate_unit);
    let advice = advice(r).into_iter().map(named).collect();
    let notes = about_inputs(r).iter().chain(&r.notes).map(|n| in_unit(n, &r.rate_unit)).collect();
    (r.advice, r.notes) = (advice, notes);
    r.verdict = in_unit(&verdict(r), &r.rate_unit);
}

/// The verdict.
#[must_use]
pub fn verdict(r: &Report) -> String {
    let mut lines = vec![burn(r), why(r), left(r), next(r)];
    if let Some(prior) = r.prior.as_ref().filter(|p| p.used) {
        lines.push(format!(
            "The image is that of the unit under the family {}. The effects above are those that the trace finds in its runs alone.",
            prior.family
        ));
    }
    let own: Vec<&str> = r.effects.iter().filter(|e| e.class == Class::Own).map(|e| e.name.as_str()).collect();
    if !own.is_empty() {
        let (are, them) = if own.len() == 1 { ("is", "it") } else { ("are", "them") };
        lines.push(format!(
            "{} {are} your own: the unit does not have {them} and no image holds {them}; the figures of the image are without {them}. docs/own-effects.md says how to write {them} into the unit.",
            list(&own)
        ));
    }
    lines.join("\n")
}

/// The residual on the verify run of a model with an effect that the unit lacks, against the image.
fn would_leave(r: &Report, e: &Found) -> String {
    let Some(block) = &r.block else { return String::new() };
    let gained = |n: &&String| r.r#final[*n].verify_rms_dph < block[*n].verify_rms_dph;
    let on: Vec<&String> = e.axes.keys().filter(gained).collect();
    if on.is_empty() {
        return String::new();
    }
    let figures = |of: &dyn Fn(&String) -> f64| list(&on.iter().map(|n| three_digits(of(n))).collect::<Vec<_>>());
    let lacking = r.effects.iter().filter(|e| e.reach.starts_with("needs ")).count();
    format!(
        "; with {}, {} instead of {} deg/h would be left on {} of the verify run",
        if lacking > 1 { "all that the unit lacks" } else { "it" },
        figures(&|n| r.r#final[n].verify_rms_dph),
        figures(&|n| block[n].verify_rms_dph),
        list(&on)
    )
}

/// A sentence on the inputs that the image needs.
fn about_inputs(r: &Report) -> Option<String> {
    let names: Vec<&str> = r.inputs.iter().map(|i| i.name).collect();
    let without = |n: &String| r.inputs.iter().filter_map(|i| i.without_dph.get(n)).map(|s| s * s).sum::<f64>().sqrt();
    let axes: Vec<String> = r.axes().into_iter().map(str::to_string).filter(|n| without(n) > 0.0).collect();
    let each: Vec<String> = axes.iter().map(|n| three_digits(without(n))).collect();
    (!names.is_empty()).then(|| {
        format!(
            "the image needs the inputs {}: the unit takes them once a second from the link's message Inputs (docs/inputs.md). Where they are missing it flags the axis, and its uncertainty grows by {} deg/h on {}",
            list(&names),
            list(&each),
            list(&axes)
        )
    })
}

/// Sentences about what is left unexplained; one for all axes of which it is the same.
fn about_structure(r: &Report) -> Vec<String> {
    let mut groups: Vec<(&[String], Vec<&str>)> = Vec::new();
    for (n, left) in r.left_over.iter().filter(|(_, l)| !l.is_empty()) {
        match groups.iter_mut().find(|g| g.0 == left.as_slice()) {
            Some(group) => group.1.push(n),
            None => groups.push((left, vec![n])),
        }
    }
    let one = |(left, axes): (&[String], Vec<&str>)| {
        let axes = if axes.len() == 1 { format!("axis {}", axes[0]) } else { format!("axes {}", list(&axes)) };
        // (A repeat shows a form beyond the library again.)
        let repeat = if left.iter().all(|l| l.contains(OF_A_FORM)) {
            ""
        } else {
            ". A repeat of the same run shows if it belongs to the unit or to that day"
        };
        format!("{axes}: structure is left {}{repeat}", left.join("; "))
    };
    groups.into_iter().map(one).collect()
}

/// A sentence on what power-on does at other temperatures, if an image has an effect of it and no run shows any.
fn about_starts(r: &Report) -> Option<String> {
    let [low, high] = r.alike_starts_c?;
    let mut names: Vec<&str> = r
        .effects
        .iter()
        .filter(|e| e.class == Class::PowerOn && e.reach == "unit" && r.image == Image::Extended)
        .map(|e| e.name.as_str())
        .collect();
    names.dedup();
    (!names.is_empty()).then(|| {
        format!(
            "record a run that begins in the cold, or in the heat: all of these begin between {:.0} and {:.0} C, and none shows {} after a power-on at another temperature, which the stated uncertainty does not hold",
            low.floor(),
            high.ceil(),
            list(&names)
        )
    })
}

/// Advice beside the verdict, the most useful first.
#[must_use]
pub fn advice(r: &Report) -> Vec<String> {
    let mut out = Vec::new();
    for (e, times) in merged(&r.effects) {
        if times > 1 {
            out.push("the rates drift: repeat the run, and check the mounting and the electronics".to_string());
            continue;
        }
        if let Some(what) = e.reach.strip_prefix("needs ") {
            out.push(format!(
                "{} needs {what}, which the unit does not have: the desktop sees it, and the image does not hold it{}",
                e.name,
                would_leave(r, e)
            ));
        }
        let parameter = |name: &str| e.parameters.get(name).copied().unwrap_or(f64::NAN);
        let repair = EffectId::by_name(&e.name).and_then(|id| card(id).repair).filter(|_| e.reach != "unit");
        out.extend(repair.map(|repair| repair(&parameter)));
    }
    out.extend(about_structure(r));
    out.extend(about_starts(r));
    for (n, b) in r.block.iter().flatten() {
        if b.mean_dph.abs() > 3.0 * b.mean_std_dph {
            let here = |e: &&Found| e.reach == "unpredictable" && e.axes.contains_key(n);
            let once: Vec<&str> = r.effects.iter().filter(here).map(|e| e.name.as_str()).collect();
            let cause = if once.is_empty() {
                "measure the turn-on repeatability".to_string()
            } else {
                format!("{} on this axis may be the cause", list(&once))
            };
            out.push(format!(
                "axis {n}: the constant differs between train and verify run by {:.3} deg/h, {:.1} standard deviations: the deviations above do not show it; {cause}",
                b.mean_dph,
                b.mean_dph.abs() / b.mean_std_dph
            ));
        }
    }
    for (e, _) in merged(&r.effects) {
        let alike: Vec<(&String, &str)> = e
            .indistinguishable_from
            .iter()
            .filter_map(|other| Some((other, parting(EffectId::by_name(&e.name)?, EffectId::by_name(other)?))))
            .collect();
        let mut ways: Vec<&str> = alike.iter().map(|(_, way)| *way).collect();
        ways.dedup();
        for way in ways {
            let names: Vec<&String> = alike.iter().filter(|(_, w)| *w == way).map(|(n, _)| *n).collect();
            out.push(format!("{} looks like {} on this profile: {way}", e.name, list(&names)));
        }
    }
    if let Some(x) = r.exchanged.as_ref().filter(|x| !x.same_classes) {
        let classes: Vec<&str> = x.classes.iter().map(|c| c.name()).collect();
        out.push(format!(
            "with train and verify exchanged the classes are {}: one of the two runs does not show what the other does",
            list(&classes)
        ));
    }
    out.extend(turn_on(r));
    if r.verdict_kind == VerdictKind::NotConfirmed {
        out.push("a longer verify run, or a second train run, reduces the uncertainty".into());
    }
    out
}
