//! The seeded campaign behind `docs/trace.md`: how often `hrg trace` names the right effect, invents one, or says
//! that something is left. Everything here is simulated; sizes are in noise floors.

use anyhow::Result;
use clap::Args;
use hrg_core::effects::EffectId;
use hrg_data::axes::AXIS_NAMES;
use hrg_data::cards;
use hrg_data::cards::Class;
use hrg_data::numeric::stats::{quantile, share_interval as interval};
use hrg_identify::trace::{trace, Trace, VerdictKind};
use hrg_simulate::{EffectSpec, Noise, Plan, Profile, Source, Unmodelled};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Runs the campaign and prints the table that the docs quote.
#[derive(Args)]
pub struct Arguments {
    /// Runs of each effect and size.
    #[arg(long, default_value_t = 10)]
    runs: usize,
    /// Clean units.
    #[arg(long, default_value_t = 200)]
    clean: usize,
    /// Seed of the campaign.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Also write every trial to this CSV.
    #[arg(long)]
    out: Option<PathBuf>,
    /// Write the table as Markdown to this file.
    #[arg(long)]
    table: Option<PathBuf>,
    /// Page whose table of figures, between its marks, is written anew.
    #[arg(long)]
    page: Option<PathBuf>,
    /// Only this kind: single, pair, clean, unmodelled, defective.
    #[arg(long)]
    only: Option<String>,
}

const PAIRS: [(EffectId, EffectId); 8] = [
    (EffectId::Kink, EffectId::WarmUp),
    (EffectId::Hysteresis, EffectId::Periodic),
    (EffectId::ThermalLag, EffectId::Step),
    (EffectId::Cubic, EffectId::Hysteresis),
    (EffectId::WarmUp, EffectId::Step),
    (EffectId::ThermalLag, EffectId::Kink),
    (EffectId::AxisGradient, EffectId::Cubic),
    (EffectId::DriveAmplitude, EffectId::Hysteresis),
];
/// Effects of the files with and without defects.
const IN_FILES: [EffectId; 5] =
    [EffectId::Hysteresis, EffectId::Kink, EffectId::ThermalLag, EffectId::WarmUp, EffectId::Cubic];
const SIZES: [f64; 6] = [0.25, 0.5, 1.0, 2.0, 3.0, 5.0];
const TRAINS: [&str; 3] = ["dong", "cycle", "stairs"];

/// One trial of the campaign.
#[derive(Clone)]
struct Trial {
    kind: &'static str,
    effects: Vec<EffectSpec>,
    profile: &'static str,
    unit: u64,
    noise: Noise,
    defective: bool,
}

struct Outcome {
    trial: Trial,
    found: Vec<String>,
    confounded: Vec<String>,
    named: usize,
    unexplained: bool,
    left: String,
    verdict: VerdictKind,
    burn: bool,
    classes: Vec<Class>,
    image_over_floor: f64,
    image_over_baseline: f64,
    ratio_holds: usize,
    after_over_floor: f64,
    floor_over_truth: f64,
    before_over_floor: f64,
    seconds: f64,
    after_dph: f64,
    coverage: Vec<Coverage>,
}

/// The error of a bias that an image gives on the verify run, by the uncertainty that it states: one axis.
#[derive(Clone, Copy)]
struct Coverage {
    /// Squared error over variance, mean over the run.
    normalised: f64,
    /// Shares of the run within one and within 1.96 standard uncertainties.
    within: [f64; 2],
}

/// The true bias is the simulated rate without its noise.
fn coverage(t: &Trace, noise_dph: &[Vec<f64>; 3]) -> Vec<Coverage> {
    let steps = &t.verify.steps;
    let seconds = hrg_identify::fit::correct::correct(&t.image, steps);
    // The simulator's rows begin at 1 s, one a second.
    let first = (steps.start_s - 1.0).round().max(0.0) as usize;
    (0..3)
        .filter_map(|a| {
            let squares: Vec<f64> = seconds
                .iter()
                .enumerate()
                .skip(steps.run_in)
                .filter_map(|(k, s)| {
                    let truth = steps.rate_dph[a][k] - noise_dph[a].get(first + k)?;
                    let z = (f64::from(s.bias_dph[a]) - truth) / f64::from(s.bias_std_dph[a]);
                    Some(z * z).filter(|z| z.is_finite())
                })
                .collect();
            let n = squares.len() as f64;
            let within = [1.0, 1.96f64].map(|k| squares.iter().filter(|z| **z <= k * k).count() as f64 / n);
            (!squares.is_empty()).then(|| Coverage { normalised: squares.iter().sum::<f64>() / n, within })
        })
        .collect()
}

fn mean3(f: impl Fn(usize) -> f64) -> f64 {
    (f(0) + f(1) + f(2)) / 3.0
}

fn one(trial: &Trial) -> Result<Outcome> {
    let plan = |profile: &str, seed: u64| Plan {
        effects: trial.effects.clone(),
        noise: trial.noise,
        sizing: Profile::parse(trial.profile).ok(),
        ..Plan::of(Profile::parse(profile).expect("named"), trial.unit, seed)
    };
    let mut train = plan(trial.profile, trial.unit * 2 + 1).simulate();
    let verify = plan("verify", trial.unit * 2 + 2).simulate();
    if trial.defective {
        hrg_simulate::inject_defects(&mut train.recording, trial.unit);
        train.recording.clean()?;
    }
    let start = std::time::Instant::now();
    let traced = trace(&[train.recording], &verify.recording)?;
    let seconds = start.elapsed().as_secs_f64();
    let coverage = coverage(&traced, &verify.noise_dph);
    let report = traced.report;
    let found: Vec<String> = report.effects.iter().map(|e| e.name.clone()).collect();
    let confounded: Vec<String> = report.effects.iter().flat_map(|e| e.indistinguishable_from.clone()).collect();
    let named = trial
        .effects
        .iter()
        .filter(|e| [&found, &confounded].iter().any(|names| names.iter().any(|n| n == e.source.name())))
        .count();
    let after = mean3(|a| report.r#final[AXIS_NAMES[a]].verify_rms_dph);
    let image = |a: usize| {
        let name = AXIS_NAMES[a];
        report.block.as_ref().map_or(verify.truth.raw_dph[a], |b| b[name].verify_rms_dph)
    };
    // The interval is to hold what is left over the noise that was put in.
    let holds = |a: usize| {
        let r = report.floor_ratio[AXIS_NAMES[a]];
        let truth = report.judged_rms_dph[AXIS_NAMES[a]] / verify.truth.floor_dph[a];
        (r.low..=r.high).contains(&truth)
    };
    Ok(Outcome {
        verdict: report.verdict_kind,
        burn: report.burn,
        classes: report.effects.iter().map(|e| e.class).collect(),
        image_over_floor: mean3(|a| image(a) / verify.truth.floor_dph[a]),
        image_over_baseline: (0..3)
            .map(|a| image(a) / report.baseline[AXIS_NAMES[a]].verify_rms_dph)
            .fold(0.0, f64::max),
        ratio_holds: (0..3).filter(|a| holds(*a)).count(),
        named,
        unexplained: report.unexplained.values().any(|u| *u),
        left: AXIS_NAMES.iter().map(|a| report.left_over[*a].join("+")).collect::<Vec<_>>().join("|"),
        after_over_floor: mean3(|a| report.r#final[AXIS_NAMES[a]].verify_rms_dph / verify.truth.floor_dph[a]),
        floor_over_truth: mean3(|a| report.noise_floor_dph[AXIS_NAMES[a]] / verify.truth.floor_dph[a]),
        before_over_floor: mean3(|a| report.baseline[AXIS_NAMES[a]].verify_rms_dph / verify.truth.floor_dph[a]),
        trial: trial.clone(),
        found,
        confounded,
        seconds,
        after_dph: after,
        coverage,
    })
}

fn campaign(a: &Arguments) -> Vec<Trial> {
    let mut rng = ChaCha8Rng::seed_from_u64(a.seed);
    let mut unit = a.seed * 100_000;
    let mut out = Vec::new();
    let mut add = |kind: &'static str, effects: Vec<EffectSpec>, defective: bool, rng: &mut ChaCha8Rng| {
        unit += 1;
        let noise = Noise {
            white_100s_dph: rng.random_range(0.1..0.4),
            flicker_dph: rng.random_range(0.0..0.04),
            walk_per_root_h_dph: rng.random_range(0.0..0.03),
            ..Noise::default()
        };
        out.push(Trial { kind, effects, profile: TRAINS[unit as usize % TRAINS.len()], unit, noise, defective });
    };
    for _ in 0..a.clean {
        add("clean", vec![], false, &mut rng);
    }
    for effect in cards::all().filter(|(_, c)| c.generator.study).map(|(f, _)| f.effect) {
        for size in SIZES {
            for _ in 0..a.runs {
                let e = EffectSpec::drawn(Source::Library(effect), size, &mut rng);
                add("single", vec![e], false, &mut rng);
            }
        }
    }
    for (x, y) in PAIRS {
        for _ in 0..a.runs {
            let sizes = [rng.random_range(2.0..4.0), rng.random_range(2.0..4.0)];
            let e = vec![
                EffectSpec::drawn(Source::Library(x), sizes[0], &mut rng),
                EffectSpec::drawn(Source::Library(y), sizes[1], &mut rng),
            ];
            add("pair", e, false, &mut rng);
        }
    }
    for effect in Unmodelled::ALL {
        for _ in 0..2 * a.runs {
            let size = rng.random_range(2.0..5.0);
            let e = EffectSpec::drawn(Source::Unmodelled(effect), size, &mut rng);
            add("unmodelled", vec![e], false, &mut rng);
        }
    }
    for effect in IN_FILES {
        for _ in 0..a.runs {
            let e = EffectSpec::drawn(Source::Library(effect), 3.0, &mut rng);
            add("clean file", vec![e.clone()], false, &mut rng);
            // The same unit and noise, with dirt.
            add("defective file", vec![e], true, &mut rng);
        }
    }
    out
}

/// Runs the campaign.
///
/// # Errors
/// A page or table that cannot be written.
pub fn run(a: &Arguments) -> Result<()> {
    let mut trials = campaign(a);
    // A defective file is compared with its clean file: same unit, same noise.
    for k in 1..trials.len() {
        if trials[k].kind == "defective file" {
            trials[k].unit = trials[k - 1].unit;
            trials[k].noise = trials[k - 1].noise;
            trials[k].profile = trials[k - 1].profile;
        }
    }
    if let Some(only) = &a.only {
        trials.retain(|t| t.kind.contains(only.as_str()) || (only == "defective" && t.kind == "clean file"));
    }
    let bar = indicatif::ProgressBar::new(trials.len() as u64);
    bar.set_style(indicatif::ProgressStyle::with_template("{wide_bar} {pos} of {len}, {eta} left")?);
    let next = AtomicUsize::new(0);
    let mut outcomes: Vec<(usize, Outcome)> = std::thread::scope(|scope| {
        let workers: Vec<_> = (0..std::thread::available_parallelism().map_or(2, usize::from))
            .map(|_| {
                scope.spawn(|| {
                    let mut mine = Vec::new();
                    loop {
                        let k = next.fetch_add(1, Ordering::Relaxed);
                        let Some(trial) = trials.get(k) else {
                            return mine;
                        };
                        match one(trial) {
                            Ok(o) => mine.push((k, o)),
                            Err(e) => eprintln!("{} {:?}: {e}", trial.kind, trial.effects),
                        }
                        bar.inc(1);
                    }
                })
            })
            .collect();
        workers.into_iter().flat_map(|w| w.join().unwrap_or_default()).collect()
    });
    bar.finish_and_clear();
    outcomes.sort_by_key(|o| o.0);
    let outcomes: Vec<Outcome> = outcomes.into_iter().map(|o| o.1).collect();
    if let Some(path) = &a.out {
        hrg_data::output::write_file(path, every_trial(&outcomes).as_bytes())?;
    }
    let table = summary(&outcomes, a.seed);
    print!("{table}");
    if let Some(path) = &a.table {
        hrg_data::output::write_file(path, table.as_bytes())?;
    }
    if let Some(page) = &a.page {
        let figures = table.find("| figure").map_or(&table[..], |at| &table[at..]);
        let rows: String = figures.lines().take_while(|l| l.starts_with('|')).map(|l| format!("{l}\n")).collect();
        crate::pages::splice(page, "study", &rows)?;
    }
    Ok(())
}

/// One checksum over the findings of three traces: names, verdicts, and figures to three digits behind the point. Pages with figures of
/// traces carry it, and a test compares it.
///
/// # Errors
/// A plan that cannot be made.
pub fn short_form() -> Result<String> {
    let mut text = String::new();
    for (unit, effects) in
        [(3, &["thermal-lag:size=3"][..]), (4, &["hysteresis:size=3", "kink:size=3"]), (5, &["step:size=4"])]
    {
        let plan = |profile: &str, seed: u64| -> Result<Plan> {
            let effects = effects.iter().map(|e| EffectSpec::parse(e)).collect::<Result<_, _>>()?;
            Ok(Plan { effects, ..Plan::of(Profile::parse(profile)?, unit, seed) })
        };
        let t = trace(
            &[plan("cycle", 2 * unit)?.simulate().recording],
            &plan("verify", 2 * unit + 1)?.simulate().recording,
        )?;
        let r = &t.report;
        let _ = write!(text, "{:?} {:?} {} ", r.verdict_kind, r.image, r.burn);
        for e in &r.effects {
            let _ = write!(text, "{} {:?} ", e.name, e.confirmed);
        }
        for (a, n) in AXIS_NAMES.iter().enumerate() {
            let (block, stated) = (r.block.as_ref().map(|b| b[*n]), t.image.axes[a].uncertainty.rest_dph2);
            let block = block.map_or((0.0, 0.0), |b| (b.verify_rms_dph, b.mean_dph));
            let left = r.floor_ratio[*n].ratio;
            let _ = write!(text, "{:.3} {:.3} {:.3} {:.3} ", block.0, block.1, left, stated.sqrt());
        }
    }
    Ok(format!("{:08x}", hrg_core::bytes::crc32(text.as_bytes())))
}

/// Every trial as a row of CSV.
fn every_trial(outcomes: &[Outcome]) -> String {
    let mut s = String::from(
        "kind,profile,unit,truth,size,parameter,found,classes,verdict,burn,twins,unexplained,left,before,after,image,image_over_baseline,floor,normalised_error,seconds\n",
    );
    for o in outcomes {
        let join = |f: &dyn Fn(&EffectSpec) -> String| o.trial.effects.iter().map(f).collect::<Vec<_>>().join("+");
        let _ = writeln!(
            s,
            "{},{},{},{},{},{},{},{},{:?},{},{},{},{},{:.3},{:.3},{:.3},{:.3},{:.3},{},{:.3}",
            o.trial.kind,
            o.trial.profile,
            o.trial.unit,
            join(&|e| e.source.name().to_string()),
            join(&|e| format!("{:.2}", e.size)),
            join(&|e| format!("{:.1}", e.parameters[0])),
            o.found.join("+"),
            o.classes.iter().map(|c| c.name()).collect::<Vec<_>>().join("+"),
            o.verdict,
            o.burn,
            o.confounded.join("+"),
            o.unexplained,
            o.left,
            o.before_over_floor,
            o.after_over_floor,
            o.image_over_floor,
            o.image_over_baseline,
            o.floor_over_truth,
            o.coverage.iter().map(|c| format!("{:.2}", c.normalised)).collect::<Vec<_>>().join("|"),
            o.seconds
        );
    }
    s
}

fn share(part: usize, of: usize) -> String {
    if of == 0 {
        "-".into()
    } else {
        let (low, high) = interval(part, of);
        format!(
            "{part}/{of} ({:.0} %, 95 %: {:.1} to {:.1})",
            100.0 * part as f64 / of as f64,
            100.0 * low,
            100.0 * high
        )
    }
}

/// Share of trials in which the class is right, by class and size, with intervals.
fn by_class(s: &mut String, all: &[Outcome]) {
    let sizes: Vec<String> = SIZES.iter().map(f64::to_string).collect();
    let _ = writeln!(s, "| class | size {} |\n|---|{}", sizes.join(" | "), "---|".repeat(SIZES.len()));
    let mut classes: BTreeMap<&str, Vec<(f64, bool)>> = BTreeMap::new();
    for o in all.iter().filter(|o| o.trial.kind == "single") {
        let e = &o.trial.effects[0];
        let Source::Library(effect) = e.source else { continue };
        let class = cards::card(effect).class;
        classes.entry(class.name()).or_default().push((e.size, o.classes.contains(&class)));
    }
    for (class, found) in &classes {
        let cells = SIZES.iter().map(|size| {
            let these: Vec<bool> = found.iter().filter(|f| f.0 == *size).map(|f| f.1).collect();
            let hits = these.iter().filter(|h| **h).count();
            let (low, high) = interval(hits, these.len());
            format!("{hits}/{} [{:.0}, {:.0}] %", these.len(), 100.0 * low, 100.0 * high)
        });
        let _ = writeln!(s, "| {class} | {} |", cells.collect::<Vec<_>>().join(" | "));
    }
    s.push('\n');
}

/// Share of trials in which each effect of each size is named.
fn by_effect(s: &mut String, all: &[Outcome]) {
    let sizes: Vec<String> = SIZES.iter().map(f64::to_string).collect();
    let _ = writeln!(s, "| effect | size {} |\n|---|{}", sizes.join(" | "), "---|".repeat(SIZES.len()));
    let mut by_name: BTreeMap<&str, Vec<&Outcome>> = BTreeMap::new();
    for o in all.iter().filter(|o| o.trial.kind == "single") {
        by_name.entry(o.trial.effects[0].source.name()).or_default().push(o);
    }
    for (name, outcomes) in &by_name {
        let cells: Vec<String> = SIZES
            .iter()
            .map(|size| {
                let these: Vec<_> = outcomes.iter().filter(|o| o.trial.effects[0].size == *size).collect();
                format!("{}/{}", these.iter().filter(|o| o.named == 1).count(), these.len())
            })
            .collect();
        let _ = writeln!(s, "| {name} | {} |", cells.join(" | "));
    }
}

/// Changes by the defects in a file.
fn with_defects(s: &mut String, all: &[Outcome]) {
    let (mut same_name, mut same_error, mut files) = (0, 0, 0);
    for w in all.windows(2).filter(|w| w[0].trial.kind == "clean file" && w[1].trial.kind == "defective file") {
        files += 1;
        same_name += usize::from(w[0].found == w[1].found);
        same_error += usize::from((w[1].after_dph / w[0].after_dph - 1.0).abs() <= 0.05);
    }
    let _ = writeln!(s, "| defective files: same names as the clean file | all | {} |", share(same_name, files));
    let _ = writeln!(s, "| defective files: error within 5 % of the clean file | all | {} |", share(same_error, files));
}

/// Coverage of the uncertainty that the image states.
fn with_uncertainty(s: &mut String, all: &[Outcome]) {
    let stated: Vec<Coverage> = all
        .iter()
        .filter(|o| matches!(o.trial.kind, "clean" | "single" | "pair") && !o.unexplained)
        .filter(|o| o.trial.effects.iter().all(|e| e.source.on_unit()))
        .flat_map(|o| o.coverage.iter().copied())
        .collect();
    let mean = |f: &dyn Fn(&Coverage) -> f64| stated.iter().map(f).sum::<f64>() / stated.len() as f64;
    let normalised: Vec<f64> = stated.iter().map(|c| c.normalised).collect();
    let _ = writeln!(
        s,
        "| bias on the verify run: squared error over the variance stated, mean (median) of {} axes | 0.8 to 1.25 | {:.2} ({:.2}) |",
        stated.len(),
        mean(&|c| c.normalised),
        quantile(&normalised, 0.5)
    );
    let _ = writeln!(
        s,
        "| the same: share within 1 and within 1.96 standard uncertainties | 68 %, 95 % | {:.1} %, {:.1} % |",
        100.0 * mean(&|c| c.within[0]),
        100.0 * mean(&|c| c.within[1])
    );
}

fn summary(all: &[Outcome], seed: u64) -> String {
    let mut s = format!("Simulated, seed {seed}; {} traces. Sizes in noise floors.\n\n", all.len());
    by_class(&mut s, all);
    by_effect(&mut s, all);
    let of = |kind: &str| all.iter().filter(|o| o.trial.kind == kind).collect::<Vec<_>>();
    let (clean, pairs, unmodelled) = (of("clean"), of("pair"), of("unmodelled"));
    let large: Vec<&Outcome> =
        all.iter().filter(|o| o.trial.kind == "single" && o.trial.effects[0].size >= 2.0).collect();
    let named = large.iter().filter(|o| o.named == 1).count();
    let exact = large.iter().filter(|o| o.found.len() == 1 && o.found[0] == o.trial.effects[0].source.name()).count();
    let extra = large.iter().filter(|o| o.found.len() > 1).count();
    let invented = clean.iter().filter(|o| !o.found.is_empty()).count();
    let cried = clean.iter().filter(|o| o.unexplained).count();
    let both = pairs.iter().filter(|o| o.named == 2).count();
    let caught = |o: &&&Outcome| o.unexplained || o.found.iter().any(|f| f == EffectId::TemperatureShape.name());
    let ratios: Vec<f64> = all
        .iter()
        .filter(|o| o.trial.kind != "unmodelled" && o.trial.effects.iter().all(|e| e.size >= 2.0 && e.source.on_unit()))
        .map(|o| o.after_over_floor)
        .collect();
    let floors: Vec<f64> =
        all.iter().filter(|o| o.trial.kind != "unmodelled").map(|o| (o.floor_over_truth - 1.0).abs()).collect();
    let within = floors.iter().filter(|f| **f <= 0.15).count();
    let seconds: Vec<f64> = all.iter().map(|o| o.seconds).collect();
    let _ = writeln!(s, "\n| figure | wanted | reached |\n|---|---|---|");
    let _ =
        writeln!(s, "| size 2 and up: right name (or listed as confounded) | 95 % | {} |", share(named, large.len()));
    let _ = writeln!(s, "| the same, that name first and alone | - | {} |", share(exact, large.len()));
    let _ = writeln!(s, "| the same, with something besides | - | {} |", share(extra, large.len()));
    let _ = writeln!(s, "| pairs: both | 80 % | {} |", share(both, pairs.len()));
    let _ = writeln!(s, "| clean units: something invented | at most 2 % | {} |", share(invented, clean.len()));
    let _ = writeln!(s, "| clean units: called unexplained | at most 5 % | {} |", share(cried, clean.len()));
    let burnable = clean.iter().filter(|o| o.burn).count();
    let _ =
        writeln!(s, "| clean units: an extended image recommended | at most 1 % | {} |", share(burnable, clean.len()));
    let compensable = |o: &&&Outcome| o.trial.effects.iter().all(|e| e.size >= 2.0 && e.source.on_unit());
    let named_large: Vec<&&Outcome> = large.iter().chain(&pairs).filter(compensable).collect();
    let confirmed = named_large.iter().filter(|o| o.verdict == VerdictKind::Confirmed && o.burn).count();
    let _ = writeln!(
        s,
        "| size 2 and up, compensable: confirmed, and the image recommended | - | {} |",
        share(confirmed, named_large.len())
    );
    let worse = all.iter().filter(|o| o.image_over_baseline > 1.02).count();
    let _ = writeln!(
        s,
        "| images more than 2 % worse than the baseline on an axis of the verify run | 0 | {} |",
        share(worse, all.len())
    );
    let held: usize = all.iter().map(|o| o.ratio_holds).sum();
    let _ = writeln!(
        s,
        "| axes whose ratio to the true floor lies in the interval stated | 95 % | {} |",
        share(held, 3 * all.len())
    );
    with_uncertainty(&mut s, all);
    let _ = writeln!(
        s,
        "| unmodelled effects: unexplained or temperature-shape | 90 % | {} |",
        share(unmodelled.iter().filter(caught).count(), unmodelled.len())
    );
    let _ = writeln!(
        s,
        "| after / floor on the verify run, compensable: median, 95th percentile | 1.05, 1.2 | {:.3}, {:.3} |",
        quantile(&ratios, 0.5),
        quantile(&ratios, 0.95)
    );
    let _ = writeln!(s, "| estimate of the floor within 15 % | - | {} |", share(within, floors.len()));
    with_defects(&mut s, all);
    let _ = writeln!(s, "| time of a trace, this machine, median (s) | 0.5 | {:.2} |", quantile(&seconds, 0.5));
    s
}
