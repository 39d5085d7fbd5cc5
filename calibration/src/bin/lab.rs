//! Prototype: selection over families by evidence.
use hrg_cal::fit::{prepare_for, Prepared};
use hrg_cal::independence::Units;
use hrg_cal::recording::Recording;
use hrg_cal::run::{Run, Steps};
use hrg_cal::stats::{block_means, std_dev};
use hrg_cal::trace::data::{Candidate, Data};
use hrg_cal::trace::gls::COLOURS;
use hrg_cal::trace::search::Search;
use hrg_cal::trace::shrink::{Gram, Share};
use hrg_core::AXES;
use std::ops::Range;
use std::path::Path;

#[derive(Clone)]
struct Group { name: String, class: &'static str, c: Candidate, of: f64 }

fn class_of(n: &str) -> &'static str {
    match n {
        "thermal-lag" | "second-derivative" | "axis-gradient" | "case-gradient" => "memory",
        "hysteresis" => "hysteresis",
        "cubic" | "kink" | "temperature-shape" => "shape",
        "cooling-heating" => "rate",
        "warm-up" => "power-on",
        "timebase" => "thermometer",
        "step" | "aging" | "periodic" => "event",
        _ => "input",
    }
}

fn candidates(data: &Data<'_>, search: &Search<'_>) -> Vec<Group> {
    let (low, high) = data.temperature_range();
    let span = high - low;
    let longest = data.longest_s();
    let mut out = Vec::new();
    let mut put = |name: &str, class: &'static str, p: [f32; 2], of: usize| if let Some(c) = Candidate::new(name, p) { out.push(Group { name: format!("{name}{}", if c.facts.parameters.len() == 1 || name == "relay" || name == "arrhenius-ladder" { format!(":{:.4}", p[0]) } else { String::new() }), class, c, of: of as f64 }) };
    let tmax = (0.9 * longest).clamp(600.0, 21600.0);
    put("lag-ladder", "memory", [60.0, tmax], 1);
    put("lag-ladder-by-temperature", "memory", [60.0, tmax], 1);
    put("heating-lags", "memory", [120.0, tmax], 1);
    for b in [-0.04, -0.02, 0.02, 0.04] { put("arrhenius-ladder", "memory", [b, tmax], 4); }
    put("neighbour-lags", "memory", [0.0, 0.0], 1);
    put("play-ladder", "hysteresis", [(0.012 * span).max(0.3), 0.9 * span], 1);
    for s in [0.02, 0.04, 0.08, 0.15, 0.25] { put("play-curve", "hysteresis", [s * span, 0.0], 5); }
    put("extremes", "hysteresis", [0.0, 0.0], 1);
    put("temperature-spline", "shape", [low, high], 1);
    let fastest = data.runs.iter().flat_map(|r| (0..3).map(move |a| { let (x, y) = r.ramp_range(a); y.max(-x) })).fold(0.1f32, f32::max);
    put("rate-curve", "rate", [fastest, 0.0], 1);
    put("rate-curve-by-temperature", "rate", [fastest, 0.0], 1);
    put("ramp-by-shape", "rate", [0.0, 0.0], 1);
    put("heating-by-shape", "rate", [0.0, 0.0], 1);
    for k in 0..8 { put("rate-saturation", "rate", [fastest * 0.08 * 1.4f32.powi(k), 0.0], 8); }
    put("power-on-ladder", "power-on", [120.0, (0.8 * longest).max(2000.0)], 1);
    put("power-on-ladder-by-temperature", "power-on", [120.0, (0.8 * longest).max(2000.0)], 1);
    if data.runs.len() > 1 { put("power-on-ladder-by-start", "power-on", [120.0, (0.8 * longest).max(2000.0)], 1); }
    // Periods of a ripple: evenly in the number of ripples over the span.
    let most = (span / 3.0) as usize * 2;
    for k in 4..=most.max(4) { put("ripple", "shape", [span / (0.5 * k as f32), 0.0], most); }
    let th: Vec<f32> = (1..=12).map(|k| low + span * k as f32 / 13.0).collect();
    for i in 0..12 { for j in 0..i { put("relay", "hysteresis", [th[i], th[j]], 66); } }
    for c in data.library().into_iter().chain(search.proposals()) {
        let n = c.facts.name;
        if n == "temperature-shape" || n == "axis-gradient" { continue; }
        let of = match n { "kink" => 20, "thermal-lag" => 18, "hysteresis" => 14, "warm-up" => 12, "step" => 200, "periodic" => 200, _ => 1 };
        out.push(Group { name: format!("{n}:{:.1}", c.parameters[0]), class: class_of(n), c, of: f64::from(of) });
    }
    out
}

struct AxisGram { grams: Vec<Gram>, groups: Vec<Range<usize>>, scale: Vec<f64>, present: Vec<bool>, limit: f64, noise0: f64 }

fn load(p: &Path) -> Recording { Recording::load(p).unwrap() }

fn main() {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let verbose = args.iter().any(|a| a == "-v");
    let kappa: f64 = std::env::var("KAPPA").ok().and_then(|v| v.parse().ok()).unwrap_or(3.0);
    let use_cv: f64 = std::env::var("CV").ok().and_then(|v| v.parse().ok()).unwrap_or(0.0);
    let dir = &args[0];
    let mut truths: Vec<_> = std::fs::read_dir(dir).unwrap().filter_map(|e| { let n = e.unwrap().file_name().into_string().unwrap(); n.strip_suffix("-truth.json").map(String::from) }).filter(|n| args[1..].iter().any(|p| n.starts_with(p.as_str()))).collect();
    truths.sort();
    let (mut all, mut kinds) = (Vec::new(), std::collections::BTreeMap::<String, usize>::new());
    for name in truths {
        let t: serde_json::Value = serde_json::from_slice(&std::fs::read(format!("{dir}/{name}-truth.json")).unwrap()).unwrap();
        let mut trains = Vec::new();
        if Path::new(&format!("{dir}/{name}-train.csv")).exists() { trains.push(format!("{dir}/{name}-train.csv")); }
        for k in 1..9 { let p = format!("{dir}/{name}-train-{k}.csv"); if Path::new(&p).exists() { trains.push(p); } }
        let Ok(train) = trains.iter().map(|p| Recording::load(Path::new(p))).collect::<Result<Vec<_>, _>>() else { println!("{name} not loaded"); continue };
        let verify = load(Path::new(&format!("{dir}/{name}-verify.csv")));
        let start = std::time::Instant::now();
        let Ok(Prepared { runs, calibration, lag_s, .. }) = prepare_for(&train, Units::Different) else { println!("{name} refused"); continue };
        let scaling = calibration.scaling;
        let data = Data::new(&runs, scaling, lag_s.iter().sum::<f64>() / 3.0);
        let vrun = Run::new(Steps::new(&verify).unwrap(), calibration.axes.each_ref().map(|a| a.law));
        let t_prep = start.elapsed().as_secs_f64();
        let search = Search::new(&data, 1);
        let groups = candidates(&data, &search);
        let axes: Vec<AxisGram> = (0..AXES).map(|a| {
            let (mut columns, mut ranges, mut scale, mut present) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
            for g in &groups {
                let from = columns.len();
                if let Some(cs) = data.columns(&g.c, a, false) {
                    for c in cs { let s = std_dev(&c).max(1e-9); scale.push(s); columns.push(c.iter().map(|v| v / s).collect::<Vec<f64>>()); }
                    present.push(true);
                } else { present.push(false); }
                ranges.push(from..columns.len());
            }
            let rows = &data.axes[a];
            // Residual of the baseline, unwhitened: its deviation bounds what a gain may do.
            let f = hrg_cal::lsq::fit(&rows.base, &rows.y, None, &[]).unwrap();
            let grams: Vec<Gram> = COLOURS.iter().map(|c| Gram::new(rows, &columns, *c)).collect();
            AxisGram { grams, groups: ranges, scale, present, limit: f.sigma * f.sigma, noise0: 0.0 }
        }).collect();
        let t_gram = start.elapsed().as_secs_f64();
        // Greedy, jointly.
        let mut model: Vec<Vec<Share>> = vec![Vec::new(); AXES];
        let mut ev: Vec<f64> = axes.iter().map(|x| x.grams.iter().map(Gram::nothing).fold(f64::NEG_INFINITY, f64::max)).collect();
        let mut used: Vec<usize> = Vec::new();
        let mut log = Vec::new();
        while used.len() < 6 {
            let mut cands = Vec::new();
            let bases: Vec<Vec<_>> = (0..AXES).map(|a| axes[a].grams.iter().map(|g| g.base(&model[a], &axes[a].groups)).collect()).collect();
            for (k, g) in groups.iter().enumerate() {
                if used.contains(&k) { continue; }
                let (mut gain, mut on) = (0.0, Vec::new());
                for a in 0..AXES {
                    let x = &axes[a];
                    if !x.present[k] { continue; }
                    let mut best = (f64::NEG_INFINITY, 0.0);
                    for (gram, base) in x.grams.iter().zip(&bases[a]) {
                        let most = kappa * kappa * x.limit / gram.noise(base);
                        let (d, v) = gram.extension(base, &x.groups[k], most);
                        if base.evidence + d > best.0 { best = (base.evidence + d, v); }
                    }
                    let d = best.0 - ev[a] - 1.0;
                    if d > 0.0 { gain += d; on.push((a, best.1)); }
                }
                let new_class = !used.iter().any(|u| groups[*u].class == g.class);
                let price = 3.0 + if new_class { 2.0 } else { 0.0 } + g.of.ln();
                cands.push((gain - price, k, on));
            }
            cands.sort_by(|x, y| y.0.total_cmp(&x.0));
            // The best few in full.
            let mut tried = Vec::new();
            for (g, k, on) in cands.iter().take(5).filter(|c| c.0 > 0.0) {
                let mut next = model.clone();
                let (mut total, mut cv) = (0.0, 0.0);
                let mut evs = ev.clone();
                for (a, v) in on {
                    next[*a].push(Share { group: *k, variance: *v });
                    let x = &axes[*a];
                    let mut best = f64::NEG_INFINITY; let mut bm = next[*a].clone(); let mut bc = 0;
                    for (ci, gram) in x.grams.iter().enumerate() {
                        let mut m = next[*a].clone();
                        let b = gram.base(&m, &x.groups);
                        let most = kappa * kappa * x.limit / gram.noise(&b);
                        if b.evidence < best - 8.0 { continue; }
                        let e = gram.optimise(&mut m, &x.groups, most, 12);
                        if e > best { best = e; bm = m; bc = ci; }
                    }
                    next[*a] = bm;
                    total += best - ev[*a] - 1.0;
                    cv += x.grams[bc].cross_validated(&next[*a], &x.groups) - x.grams[bc].cross_validated(&model[*a], &x.groups);
                    evs[*a] = best;
                }
                tried.push((total - groups[*k].of.ln() + use_cv * cv, *k, next, evs, total, cv, *g));
            }
            tried.sort_by(|x, y| y.0.total_cmp(&x.0));
            log.push(tried.iter().map(|t| format!("{} ev {:.1} cv {:.1} ({:.1})", groups[t.1].name, t.4, t.5, t.6)).collect::<Vec<_>>().join(" | "));
            let Some((score, k, next, evs, ..)) = tried.into_iter().next() else { break };
            if score < 5.0 { break; }
            model = next; ev = evs; used.push(k);
            // Backward.
            let mut j = 0;
            while j + 1 < used.len() {
                let h = used[j];
                let mut less = model.clone();
                let mut evs = ev.clone();
                let mut loss = 0.0;
                for a in 0..AXES {
                    if !model[a].iter().any(|s| s.group == h) { continue; }
                    less[a].retain(|s| s.group != h);
                    let x = &axes[a];
                    let mut best = f64::NEG_INFINITY; let mut bm = less[a].clone();
                    for gram in &x.grams {
                        let mut m = less[a].clone();
                        let b = gram.base(&m, &x.groups);
                        if b.evidence < best - 8.0 { continue; }
                        let most = kappa * kappa * x.limit / gram.noise(&b);
                        let e = if m.is_empty() { gram.nothing() } else { gram.optimise(&mut m, &x.groups, most, 12) };
                        if e > best { best = e; bm = m; }
                    }
                    less[a] = bm; evs[a] = best; loss += ev[a] - best - 1.0;
                }
                if loss < 4.0 { log.push(format!("drop {}", groups[h].name)); used.remove(j); model = less; ev = evs; } else { j += 1; }
            }
        }
        let t_sel = start.elapsed().as_secs_f64();
        // Evaluate on verify.
        let tv = t["runs"].as_array().unwrap().iter().find(|r| r["role"] == "verify").unwrap();
        let mut words = Vec::new();
        for a in 0..AXES {
            let x = &axes[a];
            let (ci, _) = x.grams.iter().enumerate().map(|(i, g)| (i, g.evidence(&model[a], &x.groups))).max_by(|p, q| p.1.total_cmp(&q.1)).unwrap();
            let solved = x.grams[ci].solve(&model[a], &x.groups);
            // Baseline from what the groups leave, whitened.
            let rows = &data.axes[a];
            let mut y = rows.y.clone();
            let mut pred = vec![0.0; vrun.steps.len()];
            if let Some(s) = &solved {
                let mut at = 0;
                for sh in &model[a] {
                    let g = &groups[sh.group];
                    let cs = data.columns(&g.c, a, false).unwrap();
                    let v = vrun.effect(g.c.facts.id, &g.c.parameters, &scaling, a);
                    for (j, c) in cs.iter().enumerate() {
                        let w = s.gains[at] / x.scale[s.columns[at]];
                        at += 1;
                        y.iter_mut().zip(c).for_each(|(y, c)| *y -= w * c);
                        pred.iter_mut().zip(&v).for_each(|(p, v)| *p += w * f64::from(v[j]));
                    }
                }
            }
            let mut base = rows.base.clone();
            base.iter_mut().for_each(|c| COLOURS[ci].whiten(c, &rows.starts));
            COLOURS[ci].whiten(&mut y, &rows.starts);
            let f = hrg_cal::lsq::fit(&base, &y, None, &[]).unwrap();
            let cols = hrg_cal::fit::baseline_columns(&vrun, &scaling, a);
            for (c, k) in cols.iter().zip(&f.coefficients) { pred.iter_mut().zip(c).for_each(|(p, c)| *p += k * c); }
            let e: Vec<f64> = vrun.steps.rate_dph[a].iter().zip(&pred).map(|(r, p)| r - p).collect();
            let axn = ["x", "y", "z"][a];
            let ta = &tv["axes"][axn];
            let left = std_dev(&block_means(&e, 100)) / ta["floor_dph"].as_f64().unwrap();
            words.push(format!("{axn} {} c{ci} {:.1}>{left:.2}({:.2})", model[a].iter().map(|s| groups[s.group].name.as_str()).collect::<Vec<_>>().join("+"), ta["eq7_floors"].as_f64().unwrap(), ta["oracle_floors"].as_f64().unwrap()));
            if t["compensable"] == true { all.push(left); }
        }
        let found: std::collections::BTreeSet<&str> = used.iter().map(|u| groups[*u].class).collect();
        let list = |v: &serde_json::Value| v.as_array().unwrap().iter().map(|c| c.as_str().unwrap().to_string()).collect::<Vec<_>>();
        let mut okset: Vec<String> = list(&t["classes"]); okset.extend(list(&t["beside"]));
        let mut hit = true;
        for e in t["effects"].as_array().unwrap() { let c = list(&e["classes"]); hit &= c.iter().any(|c| found.contains(c.as_str())); okset.extend(c); okset.extend(list(&e["beside"])); }
        let fals = found.iter().any(|f| !okset.iter().any(|o| o == f));
        let grade = if fals { "FALSE" } else if hit { "ok" } else if list(&t["classes"]).contains(&"none".to_string()) && found.is_empty() { "ok" } else { "miss" };
        *kinds.entry(grade.into()).or_default() += 1;
        println!("{:34} {grade:5} {:24} {:.2}/{:.2}/{:.2}s {}", name, list(&t["classes"]).join("+"), t_prep, t_gram - t_prep, t_sel - t_gram, words.join(" | "));
        if verbose { for l in &log { println!("      {l}"); } }
    }
    all.sort_by(f64::total_cmp);
    let q = |p: f64| all.get((p * (all.len().max(1) - 1) as f64) as usize).copied().unwrap_or(f64::NAN);
    println!("{kinds:?} compensable: median {:.3} p90 {:.2} p95 {:.2} max {:.2}", q(0.5), q(0.9), q(0.95), q(1.0));
}
