//! The sentences of a report. Each word comes from a number of the report.

use super::report::{three_digits, AxisModel, ByAxis, Found, Image, Report, VerdictKind};
use hrg_core::effects::EffectId;
use hrg_data::cards::Class;
use hrg_data::cards::{card, parting};
use hrg_data::error::list;
use std::fmt::Write as _;

/// An effect with its parameter and the axes that have it.
fn called(e: &Found, there: usize) -> String {
    let parameter = match e.parameters.iter().next().filter(|_| e.name != EffectId::TemperatureShape.name()) {
        Some((n, v)) => format!(" ({n} {})", three_digits(*v)),
        None => String::new(),
    };
    let axes: Vec<&String> = e.axes.keys().collect();
    let on = if axes.len() == there { String::new() } else { format!(" on {}", list(&axes)) };
    format!("{}{parameter}{on}", e.name)
}

fn figures(axes: &[&str], of: impl Fn(&str) -> f64) -> String {
    axes.iter().map(|n| format!("{:.3}", of(n))).collect::<Vec<_>>().join(", ")
}

/// Residual of each axis: noise only if the interval allows it and nothing else speaks against it.
fn rest(r: &Report) -> String {
    let one = |n: &str| {
        let ratio = r.floor_ratio[n];
        match (ratio.is_noise(), r.unexplained[n]) {
            (true, false) => format!("{n} {ratio}: noise"),
            (false, _) if ratio.low <= 1.0 => format!("{n} {ratio}: undecided, for the interval holds 1"),
            (false, _) => format!("{n} {ratio}: more than noise"),
            (true, true) => format!("{n} {ratio}, with structure"),
        }
    };
    format!("Left there: {}.", r.axes().into_iter().map(one).collect::<Vec<_>>().join("; "))
}

/// The verdict.
#[must_use]
pub fn verdict(r: &Report) -> String {
    let before = figures(&r.axes(), |n| r.baseline[n].verify_rms_dph);
    let means = r.baseline.values().map(|b| b.verify_means).min().unwrap_or(0);
    let on = r.axes().join(", ");
    let mut s = String::new();
    let names: Vec<String> = r.effects.iter().map(|e| called(e, r.baseline.len())).collect();
    let _ = match r.verdict_kind {
        VerdictKind::NothingLacks => write!(
            s,
            "The baseline model is all that these data warrant: {before} deg/h on {on} of the verify run (standard deviation of {means} means of 100 s). "
        ),
        VerdictKind::Unexplained if r.effects.is_empty() => write!(
            s,
            "The baseline leaves structure that no effect of the library explains: {before} deg/h on {on} of the verify run (standard deviation of {means} means of 100 s). "
        ),
        VerdictKind::NotConfirmed if r.effects.iter().all(|e| e.confirmed.is_none()) => write!(
            s,
            "On the train run the model lacks {}, which another run can neither confirm nor deny. The baseline leaves {before} deg/h on {on} of the verify run (standard deviation of {means} means of 100 s). ",
            list(&names)
        ),
        VerdictKind::NotConfirmed => write!(
            s,
            "On the train run the model lacks {}, but the verify run does not confirm it: from {before} to {} deg/h on {on} (standard deviation of {means} means of 100 s); {}. ",
            list(&names),
            figures(&r.axes(), |n| r.r#final[n].verify_rms_dph),
            unconfirmed(r)
        ),
        VerdictKind::Confirmed | VerdictKind::Unexplained => write!(
            s,
            "The model lacks {}. The verify run agrees: from {before} to {} deg/h on {on} (standard deviation of {means} means of 100 s). ",
            list(&names),
            figures(&r.axes(), |n| r.r#final[n].verify_rms_dph)
        ),
    };
    let refitted: Vec<&str> = r.refitted_on_verify.iter().map(|e| e.name.as_str()).collect();
    if !refitted.is_empty() {
        let _ = write!(
            s,
            "With {} fitted again to the verify run, it is left with {} deg/h. ",
            list(&refitted),
            figures(&r.axes(), |n| r.judged_rms_dph[n])
        );
    }
    s += &rest(r);
    s += &outside(r);
    if r.verify_repeats_train {
        s += " The verify run repeats the profile of a train run: it shows nothing of other temperatures and ramps.";
    }
    s += &to_do(r);
    s
}

/// Why the verify run does not confirm.
fn unconfirmed(r: &Report) -> &'static str {
    if r.effects.iter().all(|e| e.confirmed != Some(true)) {
        "no effect by itself makes the error fall there by more than its uncertainty and by 1 % at the least, in the size that was predicted"
    } else {
        "together they do not make the error fall by more than its uncertainty, or it rises on an axis that has one"
    }
}

fn outside(r: &Report) -> String {
    if r.outside_fit < 0.005 {
        return String::new();
    }
    format!(
        " {:.0} % of the verify run lies outside the fitted temperatures and ramps; nothing is promised there.",
        100.0 * r.outside_fit
    )
}

/// Remark on the axes whose image is a constant.
fn constants(axes: &[&str]) -> String {
    if axes.is_empty() {
        return String::new();
    }
    format!(" (on {} it is a constant alone: no model beats the raw rates there beyond the uncertainty)", list(axes))
}

fn to_do(r: &Report) -> String {
    let mut s = String::new();
    let block = |f: &dyn Fn(AxisModel) -> bool| -> Vec<&str> {
        r.block.iter().flatten().filter(|(_, b)| f(b.model)).map(|(n, _)| n.as_str()).collect()
    };
    let to = |b: &ByAxis<super::report::OnVerify>| figures(&r.axes(), |n| b[n].verify_rms_dph);
    match (r.image, &r.block) {
        (Image::Extended, Some(b)) if r.burn => {
            let _ = write!(s, " To do: burn the extended image, which by itself reaches {} deg/h there", to(b));
            let plain = block(&|m| m == AxisModel::Baseline);
            if !plain.is_empty() {
                let _ = write!(s, " (on {} it holds no effect: there none is better than the baseline)", list(&plain));
            }
            s += &constants(&block(&|m| m == AxisModel::Constant));
            s.push('.');
        }
        (Image::Extended, Some(b)) if r.verdict_kind != VerdictKind::Confirmed => {
            let _ = write!(
                s,
                " The image is the extended one and by itself reaches {} deg/h there, but it is not confirmed: there is no reason to burn it before another run agrees.",
                to(b)
            );
        }
        (Image::Extended, Some(b)) if r.verify_repeats_train => {
            let _ = write!(
                s,
                " The image is the extended one and by itself reaches {} deg/h there, but a repeat of the train profile is no ground to burn it: judge it on a run of another profile (--repeat-is-enough if the unit will never meet another).",
                to(b)
            );
        }
        (Image::Extended, Some(_)) => {
            s += " The image is the extended one, but does not beat the image in use by more than its uncertainty: do not burn it.";
        }
        (Image::Baseline, Some(b)) => {
            let _ = write!(
                s,
                " The image is the baseline, with {} deg/h there{}{}.",
                to(b),
                constants(&block(&|m| m == AxisModel::Constant)),
                if r.effects.is_empty() { "" } else { "; there is no reason to burn an extended one" }
            );
        }
        _ => s += " There is no image: not even the baseline beats the raw rates on the verify run by more than its uncertainty.",
    }
    let own: Vec<&str> = r.effects.iter().filter(|e| e.class == Class::Own).map(|e| e.name.as_str()).collect();
    if !own.is_empty() {
        let (are, them) = if own.len() == 1 { ("is", "it") } else { ("are", "them") };
        let _ = write!(
            s,
            " {} {are} your own: the unit does not have {them} and no image holds {them}; the figures of the image are without {them}. docs/own-effects.md says how to write {them} into the unit.",
            list(&own)
        );
    }
    let at_cause = |e: &&Found| e.reach != "unit" && e.class != Class::Own;
    let repair: Vec<&str> = r.effects.iter().filter(at_cause).map(|e| e.name.as_str()).collect();
    if !repair.is_empty() && r.verdict_kind != VerdictKind::NotConfirmed {
        let _ = write!(s, " Repair {} at the cause: the unit cannot compensate it.", list(&repair));
    }
    s
}

/// Advice beside the verdict.
#[must_use]
pub fn advice(r: &Report) -> Vec<String> {
    let mut out = Vec::new();
    for e in &r.effects {
        for other in &e.indistinguishable_from {
            if let (Some(a), Some(b)) = (EffectId::by_name(&e.name), EffectId::by_name(other)) {
                out.push(format!("{} and {other} look alike on this profile: {}", e.name, parting(a, b)));
            }
        }
        let parameter = |name: &str| e.parameters.get(name).copied().unwrap_or(f64::NAN);
        out.extend(EffectId::by_name(&e.name).and_then(|id| card(id).repair).map(|repair| repair(&parameter)));
        if e.confirmed == Some(false) && r.verdict_kind != VerdictKind::NotConfirmed {
            out.push(format!(
                "{} is named on the train run, and the verify run does not bear it out beyond its uncertainty on every axis: take another run before you rely on it",
                e.name
            ));
        }
    }
    for (n, left) in r.left_over.iter().filter(|(_, l)| !l.is_empty()) {
        let undecided = left.len() == 1 && !r.floor_ratio[n].is_noise() && r.floor_ratio[n].low <= 1.0;
        out.push(format!(
            "axis {n}: structure {} left {}; a repeat of the same run tells whether it belongs to the unit or to that day",
            if undecided { "may be" } else { "is" },
            list(left)
        ));
    }
    for (n, b) in r.block.iter().flatten() {
        if b.mean_dph.abs() > 3.0 * b.mean_std_dph {
            let once: Vec<&str> = r
                .effects
                .iter()
                .filter(|e| e.reach == "unpredictable" && e.axes.contains_key(n))
                .map(|e| e.name.as_str())
                .collect();
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
    if let Some(x) = r.exchanged.as_ref().filter(|x| !x.same_classes) {
        let classes: Vec<&str> = x.classes.iter().map(|c| c.name()).collect();
        out.push(format!(
            "with train and verify exchanged the classes are {}: one of the two runs does not show what the other does; a third run decides",
            list(&classes)
        ));
    }
    if r.verdict_kind == VerdictKind::NotConfirmed {
        out.push("a longer verify run, or a second train run, makes the uncertainty smaller".into());
    }
    out
}
