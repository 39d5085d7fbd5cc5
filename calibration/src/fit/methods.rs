//! Every identification method of the sources, on the same data, each ending in a block that the unit runs.
//!
//! A method is a *form* (which model) and a *search* (how its coefficients are found). Forms that are linear in their
//! coefficients have an exact solution, which a swarm can approach and not beat; what each search reaches beside that
//! solution is said in its notes.
//!
//! | name | form | search | source |
//! |---|---|---|---|
//! | `lsq` | eq 7 | least squares by QR | dong2023 |
//! | `two-sets` | eq 7, cooling and heating set, blended | least squares | dong2023 |
//! | `huber` | eq 7 | least squares, outliers of less weight (Huber) | |
//! | `pso` | eq 7 | swarm of dong2023 in orthogonal coordinates | dong2023 |
//! | `pso-literal` | eq 7 | the same swarm in its literal box: -1..1 on unscaled regressors | dong2023 |
//! | `pso-range` | eq 7 | the same swarm, smallest range of 100 s means | dong2023, wu2023 |
//! | `lp-range` | eq 7 | smallest range, exactly | |
//! | `fog-lsq` | four parameters, breakpoint scanned | least standard deviation of 100 s means, exactly | |
//! | `fog-pso` | four parameters, breakpoint searched too | swarm of wu2023, least standard deviation | wu2023 |
//! | `fog-lp` | four parameters, breakpoint scanned | smallest range, exactly | |
//! | `fog-pso-range` | four parameters, breakpoint searched too | swarm of wu2023, smallest range | wu2023 |
//! | `fog-literal` | four parameters, temperature from 0 C: steps at the breakpoint | least standard deviation, exactly | wu2023 |
//! | `polynomial` | cubic of temperature | least squares | zhao2022 |
//! | `ga-bp` | 1-5-1 network | genetic start, Levenberg-Marquardt | zhao2022 |
//! | `direct` | curve of frequency and its rate | least squares | dong2023, outlook |
//!
//! `hrg compare` adds the traced model ([`crate::trace`]) as `trace`.

use super::form::{fit_directly, range, uniform_weights, Data, Form};
use super::four_parameter::four_parameters;
use super::method::{Method, Model, Objective, Search};
use super::network;
use super::search::{huber, literal_swarm, orthogonal_swarm, range_swarm, smallest_range};
use crate::fit::{Prepared, MEAN_S};
use crate::numeric::stats::block_means;
use crate::recording::steps::Run;
use crate::{BadInput, AXIS_NAMES};
use hrg_core::bias::{self, four_parameter, Coefficients, Scaling, TERMS};
use hrg_core::calibration::Calibration;
use std::time::Instant;

/// Why a method cannot be used on some data.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum MethodError {
    /// Its rows cannot have weights.
    #[error("{method} cannot give all temperatures the same weight; {able} can")]
    NotWeighable {
        /// The method.
        method: Method,
        /// Methods that can.
        able: String,
    },
    /// The data lack a direction for which it has coefficients.
    #[error("{method} has coefficients of its own for {which}, and there is no {which} ramp in the data; add a run that is {which} by at least 0.1 C per minute over the range of temperature")]
    MissingDirection {
        /// The method.
        method: Method,
        /// "cooling" or "heating".
        which: &'static str,
    },
    /// A model that is linear has no use for a genetic search.
    #[error("a genetic search is for networks only")]
    GeneticIsForNetworks,
    /// An axis whose data do not do.
    #[error("axis {axis}: {why}")]
    Axis {
        /// Its name.
        axis: &'static str,
        /// What is wrong.
        why: BadInput,
    },
}

/// What a method has identified.
#[derive(Debug, Clone)]
pub struct Identified {
    /// The calibration.
    pub calibration: Calibration,
    /// Numbers identified per axis, inner ones included.
    pub parameters: usize,
    /// How long it took here, s.
    pub seconds: f64,
    /// What the search reached beside the exact solution, and what the user should know.
    pub notes: Vec<String>,
}

/// Runs one method on prepared data. The same seed gives the same image.
///
/// # Errors
/// One sentence that says what the data lack, and what run would supply it.
pub fn identify(prepared: &Prepared, method: Method, seed: u64) -> Result<Identified, MethodError> {
    identify_weighted(prepared, method, seed, false)
}

/// As [`identify`]; with `uniform`, every degree of temperature counts alike instead of every second
/// (methods that are [weighable](Method::is_weighable) only).
///
/// # Errors
/// As [`identify`].
pub fn identify_weighted(
    prepared: &Prepared,
    method: Method,
    seed: u64,
    uniform: bool,
) -> Result<Identified, MethodError> {
    if uniform && !method.is_weighable() {
        let able: Vec<&str> = Method::ALL.into_iter().filter(|m| m.is_weighable()).map(Method::name).collect();
        return Err(MethodError::NotWeighable { method, able: able.join(", ") });
    }
    let start = Instant::now();
    let mut calibration = prepared.calibration.clone();
    let mut notes = Vec::new();
    let mut parameters = 0;
    needs(prepared, method)?;
    let present: Vec<usize> = prepared.runs.first().map_or_else(Vec::new, |r| r.steps.present().collect());
    for a in present {
        let here = |why: BadInput| MethodError::Axis { axis: AXIS_NAMES[a], why };
        let mut note = |text: String| notes.push(format!("{}: {text}", AXIS_NAMES[a]));
        let scaling = calibration.scaling;
        let task = Task { runs: &prepared.runs, scaling, method, seed: seed.wrapping_add(a as u64), uniform, a };
        parameters = match Form::of(method) {
            Some(form) => task.linear(form, &mut calibration, &mut note),
            None => task.not_linear(&mut calibration, &mut note),
        }
        .map_err(here)?;
    }
    Ok(Identified { calibration, parameters, seconds: start.elapsed().as_secs_f64(), notes })
}

/// What a method needs to see in the data.
fn needs(prepared: &Prepared, method: Method) -> Result<(), MethodError> {
    if !method.needs_both_directions() {
        return Ok(());
    }
    for (which, missing) in [("cooling", prepared.fastest[0] > -0.1), ("heating", prepared.fastest[1] < 0.1)] {
        if missing {
            return Err(MethodError::MissingDirection { method, which });
        }
    }
    Ok(())
}

/// One axis to identify.
struct Task<'a> {
    runs: &'a [Run],
    scaling: Scaling,
    method: Method,
    seed: u64,
    uniform: bool,
    a: usize,
}

impl Task<'_> {
    /// A model that is linear in its coefficients; gives their number.
    fn linear(&self, form: Form, c: &mut Calibration, note: &mut dyn FnMut(String)) -> Result<usize, BadInput> {
        let (a, seed) = (self.a, self.seed);
        let data = || Data::new(self.runs, &self.scaling, a, form);
        let parts = self.method.parts();
        let k = match (parts.search, parts.objective) {
            (Search::Exact, Objective::Squares) => {
                let weights = self.uniform.then(|| uniform_weights(self.runs, a));
                let fit = fit_directly(self.runs, &self.scaling, a, form, weights.as_deref())?;
                form.store(c, a, &fit.coefficients, &fit.std);
                note(format!("condition number {:.1}", fit.condition));
                return Ok(fit.coefficients.len());
            }
            (Search::Robust, _) => {
                let (fit, down) = huber(&data())?;
                form.store(c, a, &fit.coefficients, &fit.std);
                note(format!(
                    "{:.2} % of the rows with less weight, condition number {:.1}",
                    100.0 * down,
                    fit.condition
                ));
                return Ok(fit.coefficients.len());
            }
            (Search::Swarm, Objective::Squares) => {
                let (k, above) = orthogonal_swarm(&data(), seed)?;
                note(format!("sum of squares {:.1e} % above that of least squares", 100.0 * above));
                k
            }
            (Search::Genetic, _) => return Err(MethodError::GeneticIsForNetworks.into()),
            (Search::LiteralSwarm, _) => {
                let (k, above) = literal_swarm(self.runs, &self.scaling, &data(), a, seed)?;
                note(format!("sum of squares {:.2} times that of least squares", 1.0 + above));
                k
            }
            (Search::Exact, Objective::Range) => {
                let (k, smallest) = smallest_range(&data().means(MEAN_S))?;
                note(format!("range of 100 s means {smallest:.4} deg/h, the smallest there is"));
                k
            }
            (Search::Swarm, Objective::Range) => {
                let d = data().means(MEAN_S);
                let k = range_swarm(&d, seed)?;
                let (reached, smallest) = (range(&d.residuals(&k)), smallest_range(&d)?.1);
                note(format!(
                    "range of 100 s means {reached:.4} deg/h, {:.2} % above the smallest there is",
                    100.0 * (reached / smallest - 1.0).max(0.0)
                ));
                k
            }
        };
        form.store(c, a, &k, &[]);
        Ok(TERMS)
    }

    /// The four parameters with their breakpoint, or the network; gives the number of coefficients.
    fn not_linear(&self, c: &mut Calibration, note: &mut dyn FnMut(String)) -> Result<usize, BadInput> {
        let a = self.a;
        if self.method.parts().model == Model::Network {
            c.axes[a].coefficients = Coefficients::Network(self.train_network()?);
            return Ok(bias::network::WEIGHTS);
        }
        let m = four_parameters(self.runs, &self.scaling, a, self.method, self.seed, note)?;
        c.axes[a].coefficients = Coefficients::FourParameter(m);
        Ok(four_parameter::TERMS + 1)
    }

    /// The network sees what it will see on the unit, thinned to means of ten seconds.
    fn train_network(&self) -> Result<[f32; bias::network::WEIGHTS], BadInput> {
        let (mut u, mut y) = (Vec::new(), Vec::new());
        for run in self.runs {
            let input: Vec<f64> = (0..run.steps.len())
                .map(|k| {
                    run.bias_state(k, self.a)
                        .map_or(f64::NAN, |s| f64::from(bias::network::input(&self.scaling, s.temperature_c)))
                })
                .collect();
            for (u1, y1) in block_means(&input, 10).into_iter().zip(block_means(&run.steps.rate_dph[self.a], 10)) {
                if u1.is_finite() && y1.is_finite() {
                    u.push(u1);
                    y.push(y1);
                }
            }
        }
        network::train(&u, &y, self.seed)
    }
}

#[cfg(test)]
mod tests {
    use super::super::search::Folded;
    use super::*;
    use crate::fit::{self, prepare};
    use crate::numeric::stats::std_dev;
    use crate::recording::steps::Steps;
    use crate::simulate::{Kind, Noise, Plan, Profile};
    use hrg_core::AXES;

    fn plan(kind: Kind, profile: &str, seed: u64) -> Plan {
        Plan { kind, noise: kind.noise(), ..Plan::of(Profile::parse(profile).expect("named"), 5, seed) }
    }

    fn errors(c: &Calibration, plan: &Plan) -> ([f64; AXES], [f64; AXES]) {
        let s = plan.simulate();
        let corrected = fit::correct(c, &Steps::new(&s.recording).expect("long enough"));
        ([0, 1, 2].map(|a: usize| std_dev(&block_means(&corrected[a], MEAN_S))), s.truth.floor_dph)
    }

    #[test]
    fn every_method_of_an_hrg_reaches_the_noise_on_an_unseen_run() {
        let p = prepare(&[plan(Kind::Hrg, "cycle", 1).simulate().recording]).expect("prepares");
        let verify = plan(Kind::Hrg, "verify", 2);
        // What the data of the fit hold of range alone says less of another run: allowed twice the floor.
        for (method, most) in [
            (Method::Lsq, 1.1),
            (Method::TwoSets, 1.15),
            (Method::Huber, 1.1),
            (Method::Pso, 1.1),
            (Method::LpRange, 2.0),
            (Method::PsoRange, 2.0),
            (Method::Direct, 1.1),
        ] {
            let id = identify(&p, method, 3).expect("identifies");
            id.calibration.check().expect("a block");
            let (e, floor) = errors(&id.calibration, &verify);
            for a in 0..AXES {
                assert!(e[a] < most * floor[a], "{method} axis {a}: {} over {}", e[a], floor[a]);
            }
        }
    }

    #[test]
    fn a_swarm_approaches_least_squares_and_the_literal_box_does_not() {
        // A constant far above what varies, and a rate that the model explains almost wholly, are no harder.
        for (kind, profile) in [(Kind::Fog, "wu"), (Kind::Zhao, "zhao"), (Kind::Hrg, "cycle")] {
            let p = prepare(&[plan(kind, profile, 1).simulate().recording]).expect("prepares");
            for a in 0..AXES {
                let d = Data::new(&p.runs, &p.calibration.scaling, a, Form::Baseline);
                for seed in 0..5 {
                    let (k, above) = orthogonal_swarm(&d, seed).expect("swarms");
                    let squares =
                        |k: &[f64]| -> f64 { d.residuals(k).iter().filter(|e| e.is_finite()).map(|e| e * e).sum() };
                    let least = squares(&d.fit(None).expect("fits").coefficients);
                    assert!((0.0..1e-5).contains(&above), "{kind:?} axis {a}: {above:e}");
                    assert!((squares(&k) / least - 1.0).abs() < 2e-5, "{kind:?} axis {a}: what it says is so");
                }
            }
        }
        let p = prepare(&[plan(Kind::Hrg, "dong", 1).simulate().recording]).expect("prepares");
        for a in 0..AXES {
            let d = Data::new(&p.runs, &p.calibration.scaling, a, Form::Baseline);
            let (_, above) = orthogonal_swarm(&d, 1).expect("swarms");
            assert!((0.0..1e-5).contains(&above), "{above:e}");
            let (_, literal) = literal_swarm(&p.runs, &p.calibration.scaling, &d, a, 1).expect("swarms");
            assert!(
                literal > 0.01 && literal > 1e4 * above,
                "{literal}: the box cannot hold the constants of this unit"
            );
        }
    }

    #[test]
    fn folded_and_long_sums_are_the_same() {
        let p = prepare(&[plan(Kind::Hrg, "fast", 1).simulate().recording]).expect("prepares");
        let d = Data::new(&p.runs, &p.calibration.scaling, 0, Form::Baseline);
        let k = [1.0, -0.5, 0.25, 2.0, 0.1, -0.3];
        let long: f64 = d.residuals(&k).iter().filter(|e| e.is_finite()).map(|e| e * e).sum();
        assert!((Folded::new(&d.columns, &d.y).sum_of_squares(&k) / long - 1.0).abs() < 1e-9);
    }

    #[test]
    fn four_parameters_come_back_with_their_breakpoint() {
        let p = prepare(&[plan(Kind::Fog, "wu", 1).simulate().recording]).expect("prepares");
        let verify = plan(Kind::Fog, "wu", 2);
        for (method, most) in
            [(Method::FogLsq, 1.15), (Method::FogPso, 1.15), (Method::FogLp, 1.5), (Method::FogPsoRange, 1.5)]
        {
            let id = identify(&p, method, 3).expect("identifies");
            let (e, floor) = errors(&id.calibration, &verify);
            for a in 0..AXES {
                assert!(e[a] < most * floor[a], "{method} axis {a}: {} over {}", e[a], floor[a]);
            }
        }
    }

    #[test]
    fn exact_solutions_are_not_beaten_by_swarms() {
        let p = prepare(&[plan(Kind::Fog, "wu", 4).simulate().recording]).expect("prepares");
        for method in [Method::FogPso, Method::FogPsoRange] {
            let notes = identify(&p, method, 3).expect("identifies").notes;
            let above: Vec<f64> =
                notes.iter().filter_map(|n| n.split("deg/h, ").nth(1)?.split(' ').next()?.parse().ok()).collect();
            assert_eq!(above.len(), 3, "{notes:?}");
            assert!(above.iter().all(|x| (0.0..10.0).contains(x)), "{method}: {notes:?}");
        }
    }

    #[test]
    fn a_network_learns_a_gyro_and_repeats_itself() {
        let p = prepare(&[plan(Kind::Zhao, "zhao", 1).simulate().recording]).expect("prepares");
        let id = identify(&p, Method::GaBp, 3).expect("identifies");
        assert_eq!(id.calibration, identify(&p, Method::GaBp, 3).expect("identifies").calibration);
        let polynomial = identify(&p, Method::Polynomial, 3).expect("identifies");
        let verify = plan(Kind::Zhao, "zhao", 2);
        let ((network, floor), (cubic, _)) =
            (errors(&id.calibration, &verify), errors(&polynomial.calibration, &verify));
        for a in 0..AXES {
            assert!(network[a] < 1.3 * floor[a], "axis {a}: {} over {}", network[a], floor[a]);
            assert!(network[a] < cubic[a], "axis {a}");
        }
    }

    #[test]
    fn outliers_hardly_move_the_robust_fit() {
        let clean = plan(Kind::Hrg, "cycle", 1).simulate().recording;
        let mut dirty = clean.clone();
        // A disturbance too long to be a spike and too small to be taken out: ten minutes of three deg/h in each hour.
        for v in &mut dirty.rate_dph {
            for (k, x) in v.iter_mut().enumerate() {
                if k % 3600 < 600 {
                    *x += 30.0;
                }
            }
        }
        let verify = plan(Kind::Hrg, "verify", 2);
        let p = prepare(&[dirty]).expect("prepares");
        let error = |method| {
            let (e, _) = errors(&identify(&p, method, 1).expect("identifies").calibration, &verify);
            e.iter().sum::<f64>()
        };
        assert!(error(Method::Huber) < 0.7 * error(Method::Lsq), "{} {}", error(Method::Huber), error(Method::Lsq));
    }

    #[test]
    fn what_the_data_lack_is_said() {
        let p = prepare(&[plan(Kind::Hrg, "up", 1).simulate().recording]).expect("prepares");
        for method in [Method::TwoSets, Method::FogLsq] {
            let e = identify(&p, method, 1).expect_err("refused").to_string();
            assert!(e.contains("cooling") && e.contains("add a run"), "{e}");
        }
        let quiet = Plan { noise: Noise::default(), ..plan(Kind::Hrg, "20,3h", 1) };
        let p = prepare(&[quiet.simulate().recording]).expect("with a warning");
        assert!(p.notes.iter().any(|n| n.contains("hard to tell apart")), "{:?}", p.notes);
    }
}
