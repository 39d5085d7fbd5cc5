//! Every identification method of the sources, on the same data, each ending in a block that the unit runs.
//!
//! A method is a *form* (which model) and a *search* (how its coefficients are found). Forms that are linear in their
//! coefficients have an exact solution, which a swarm can approach and not beat; what each search reaches beside that
//! solution is stated in its notes.
//!
//! | name | form | search | source |
//! |---|---|---|---|
//! | `lsq` | eq 7 | least squares by QR | dong2023 |
//! | `two-sets` | eq 7, cooling and heating set, blended | least squares | dong2023 |
//! | `two-sets-held` | the same, the set of the last direction held: steps where the direction changes | least squares | dong2023 |
//! | `pso-two-sets` | the same | swarm of dong2023 on each stage | dong2023 |
//! | `huber` | eq 7 | least squares, outliers of less weight (Huber) | |
//! | `pso` | eq 7 | swarm of dong2023 in orthogonal coordinates | dong2023 |
//! | `pso-literal` | eq 7, a set for each stage, held | the same swarm on each stage in its literal box: -1..1 on unscaled regressors, in deg/s and C/s | dong2023, step 1 |
//! | `pso-literal-10ms` | the same | the same with C per 10 ms | dong2023, step 1 |
//! | `pso-range` | eq 7 | the same swarm, smallest range of 100 s means | dong2023, wu2023 |
//! | `lp-range` | eq 7 | smallest range, exactly | |
//! | `fog-lsq` | four parameters, breakpoint scanned | least standard deviation of 100 s means, exactly | |
//! | `fog-pso` | four parameters, breakpoint searched too | swarm of wu2023, least standard deviation | wu2023 |
//! | `fog-lp` | four parameters, breakpoint scanned | smallest range, exactly | |
//! | `fog-pso-range` | four parameters, breakpoint searched too | swarm of wu2023, smallest range | wu2023 |
//! | `fog-literal` | four parameters, temperature from 0 C: steps at the breakpoint | least standard deviation, exactly | wu2023 |
//! | `fog-pso-literal` | the same, breakpoint given | swarm of wu2023 in its box, least standard deviation | wu2023 |
//! | `fog-pso-range-literal` | the same | the same swarm, smallest range | wu2023 |
//! | `polynomial` | cubic of temperature (`--degree`: 1 to 10) | least squares | zhao2022 |
//! | `polynomial-auto` | polynomial of temperature, degree by held-out fifths | least squares | Wang 2012, Li 2023 |
//! | `table` | fourteen points of temperature, straight lines between | least squares | commercial units |
//! | `ga-bp` | 1-5-1 network | genetic start, Levenberg-Marquardt | zhao2022 |
//! | `ga-bp-literal` | 1-5-1 network | genetic start by the error of test samples, back-propagation | zhao2022 |
//! | `direct` | curve of frequency (cubic; `--degree`) and its rate | least squares | dong2023, outlook |
//! | `direct-auto` | the same, degree by held-out fifths | least squares | Wang 2012, Li 2023 |
//! | `inputs` | eq 7 beside drive and quadrature voltage: each, its square, times temperature, and behind lags of 300, 1500 and 6000 s | least squares | Zhou 2025 |
//! | `inputs-network` | eq 7 beside two hidden layers of six neurons, on temperature, ramp and the drive or the quadrature voltage | least squares; hidden weights drawn, the best of 64 layers by held-out fifths | Zhou 2025 |
//! | `damping` | a constant and the drive voltage: the force that keeps the amplitude goes with damping, and the bias with its anisotropy | least squares | dong2023 eq 3 |
//!
//! `hrg compare` adds the traced model ([`hrg_identify::trace`]) as `trace`.

use crate::form::{fit_directly, range, uniform_weights, Data, Form};
use crate::four_parameter::four_parameters;
use crate::held_out;
use crate::hidden;
use crate::history::History;
use crate::method::{Degree, Method, Model, Objective, Options, PerRamp, Search};
use crate::network;
use crate::notes::Records;
use crate::search::{
    huber, literal_swarm, orthogonal_swarm, printed_columns, range_swarm, smallest_range, LiteralUnits,
};
use crate::stages::Stage;
use hrg_core::bias::{self, four_parameter, Coefficients, Scaling};
use hrg_core::calibration::Calibration;
use hrg_core::inputs::{self, QuantitySet};
use hrg_data::axes::AXIS_NAMES;
use hrg_data::error::BadInput;
use hrg_data::numeric::stats::{block_means, quantile};
use hrg_data::recording::steps::{unit_inputs, Run};
use hrg_identify::fit::{Prepared, MEAN_S};
use std::time::Instant;

/// Seeds over which the spread of a swarm as printed is stated.
const LITERAL_SEEDS: u64 = 10;

/// Condition number beyond which a fit of eq 7 says that its regressors nearly go together.
const TOGETHER: f64 = 100.0;

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
    /// Its model has no breakpoint.
    #[error("{method} has no breakpoint to be given; {able} have one")]
    NoBreakpoint {
        /// The method.
        method: Method,
        /// Methods that have one.
        able: String,
    },
    /// Its model has no degree.
    #[error("{method} has no degree to be given; {able} have one")]
    NoDegree {
        /// The method.
        method: Method,
        /// Methods that have one.
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
    /// The recordings lack an input that it needs.
    #[error("{method} needs {needed} as inputs of the unit, and {lacking} is missing in the data or in # unit_inputs")]
    MissingInput {
        /// The method.
        method: Method,
        /// Columns, for any axis.
        needed: &'static str,
        /// Column.
        lacking: &'static str,
    },
    /// A model that is linear has no use for a genetic search.
    #[error("a genetic search is for networks only")]
    GeneticIsForNetworks,
    /// An axis whose data do not do.
    #[error("axis {axis}: {why}")]
    Axis {
        /// Its name.
        axis: &'static str,
        /// Reason.
        why: BadInput,
    },
}

impl From<MethodError> for hrg_data::error::BadInput {
    fn from(e: MethodError) -> Self {
        Self(e.to_string())
    }
}

/// Result of a method.
#[derive(Debug, Clone)]
pub struct Identified {
    /// The calibration.
    pub calibration: Calibration,
    /// Numbers identified per axis, inner ones included.
    pub parameters: usize,
    /// Duration of the identification here, s.
    pub seconds: f64,
    /// Objective that the search reached beside the exact solution, and remarks for the user.
    pub notes: Vec<String>,
    /// Course of each search; empty if the solution is exact.
    pub history: Vec<History>,
}

/// Runs one method on prepared data. The same seed gives the same image.
///
/// # Errors
/// One sentence that says what the data lack, and what run would supply it.
pub fn identify(prepared: &Prepared, method: Method, seed: u64) -> Result<Identified, MethodError> {
    identify_with(prepared, method, &Options { seed, ..Options::default() })
}

/// As [`identify`], with more to ask.
///
/// # Errors
/// As [`identify`], and where a method has no use for what is asked.
pub fn identify_with(prepared: &Prepared, method: Method, options: &Options) -> Result<Identified, MethodError> {
    let able = |wanted: fn(Method) -> bool| {
        let able: Vec<&str> = Method::ALL.into_iter().filter(|m| wanted(*m)).map(Method::name).collect();
        able.join(", ")
    };
    if options.uniform && !method.is_weighable() {
        return Err(MethodError::NotWeighable { method, able: able(Method::is_weighable) });
    }
    if options.breakpoint_c.is_some() && !method.has_a_breakpoint() {
        return Err(MethodError::NoBreakpoint { method, able: able(Method::has_a_breakpoint) });
    }
    if options.degree.is_some() && !method.has_a_degree() {
        return Err(MethodError::NoDegree { method, able: able(Method::has_a_degree) });
    }
    let start = Instant::now();
    let mut calibration = prepared.calibration.clone();
    let (mut notes, mut history) = (Vec::new(), Vec::new());
    let mut parameters = 0;
    needs(prepared, method)?;
    let present: Vec<usize> = prepared.runs.first().map_or_else(Vec::new, |r| r.steps.present().collect());
    for a in present {
        let here = |why: BadInput| MethodError::Axis { axis: AXIS_NAMES[a], why };
        let scaling = calibration.scaling;
        let options = Options { seed: options.seed.wrapping_add(a as u64), ..*options };
        let task = Task { runs: &prepared.runs, scaling, method, options, a };
        let mut records = Records { axis: a, notes: &mut notes, history: &mut history };
        let form = match method.parts().model {
            Model::InputNetwork => Some(hidden::choose(&prepared.runs, &scaling, a, options.seed).map_err(here)?),
            Model::Polynomial(own) | Model::Frequency(own) if options.degree.unwrap_or(own) == Degree::HeldOut => {
                Some(held_out::degree(method, &prepared.runs, &scaling, a).map_err(here)?)
            }
            _ => Form::of(method, options.degree),
        };
        if let Some(Form::Polynomial(n) | Form::Direct(n)) = form {
            records.note(format!("degree {n}"));
        }
        parameters = match form {
            Some(form) => task.linear(form, &mut calibration, &mut records).inspect(|_| {
                form.begin(&mut calibration, &prepared.runs, &scaling, a);
            }),
            None => task.not_linear(&mut calibration, &mut records),
        }
        .map_err(here)?;
    }
    if !method.inputs(0).is_empty() {
        notes.extend(hrg_identify::fit::take_inputs(&mut calibration, &prepared.inputs));
        hrg_identify::fit::state_inputs(&mut calibration, &prepared.runs);
    }
    Ok(Identified { calibration, parameters, seconds: start.elapsed().as_secs_f64(), notes, history })
}

/// Checks that the data have the directions (cooling, heating) and the inputs that a method needs.
fn needs(prepared: &Prepared, method: Method) -> Result<(), MethodError> {
    let present: Vec<usize> = prepared.runs.first().map_or_else(Vec::new, |r| r.steps.present().collect());
    let unit = unit_inputs(&prepared.runs);
    let there = |n: &u8| unit.contains(QuantitySet::one(*n)) && prepared.inputs.iter().any(|i| i.quantity == *n);
    if let Some(lacking) = present.iter().flat_map(|a| method.inputs(*a)).find(|n| !there(n)) {
        let needed = if method == Method::Damping { "drive_?_v" } else { "drive_?_v and quad_?_v" };
        return Err(MethodError::MissingInput { method, needed, lacking: inputs::NAMES[usize::from(lacking)] });
    }
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
    options: Options,
    a: usize,
}

impl Task<'_> {
    /// A model that is linear in its coefficients; gives their number.
    fn linear(&self, form: Form, c: &mut Calibration, records: &mut Records<'_>) -> Result<usize, BadInput> {
        let a = self.a;
        let data = || Data::new(self.runs, &self.scaling, a, form);
        let parts = self.method.parts();
        let k = match (parts.search, parts.objective) {
            (Search::Exact, Objective::Squares) => {
                let weights = self.options.uniform.then(|| uniform_weights(self.runs, a));
                let fit = fit_directly(self.runs, &self.scaling, a, form, weights.as_deref())?;
                form.store(c, a, &fit.coefficients, &fit.std);
                let together = match form {
                    Form::InputNetwork(_) => "",
                    _ if fit.condition <= TOGETHER => "",
                    Form::Inputs => ": an input nearly goes with its past or with the temperature in these runs, and the fit parts them by chance; a run of another profile tells them apart",
                    _ => ": temperature and ramp nearly go together in these runs, and the fit parts them by chance; a run with other ramps tells them apart",
                };
                records.note(format!("condition number {:.1}{together}", fit.condition));
                return Ok(fit.coefficients.len());
            }
            (Search::Robust, _) => {
                let (fit, down) = huber(&data())?;
                form.store(c, a, &fit.coefficients, &fit.std);
                records.note(format!(
                    "{:.2} % of the rows with less weight, condition number {:.1}",
                    100.0 * down,
                    fit.condition
                ));
                return Ok(fit.coefficients.len());
            }
            (Search::Swarm, Objective::Squares) if form == Form::TwoSetsHeld => {
                let both = data();
                let mut k = Vec::new();
                for stage in Stage::ALL {
                    k.extend(self.swarm_of_squares(&both.of_set(stage), Some(stage), records)?);
                }
                k
            }
            (Search::Swarm, Objective::Squares) => self.swarm_of_squares(&data(), None, records)?,
            (Search::Genetic | Search::LiteralGenetic, _) => return Err(MethodError::GeneticIsForNetworks.into()),
            (Search::LiteralSwarm(_), _) => self.literal(&data(), records)?,
            (Search::Exact, Objective::Range) => {
                let (k, smallest) = smallest_range(&data().means(MEAN_S))?;
                records.note(format!("range of 100 s means {smallest:.4} deg/h, the smallest there is"));
                k
            }
            (Search::Swarm, Objective::Range) => {
                let d = data().means(MEAN_S);
                let found = range_swarm(&d, self.options.seed)?;
                records.note(format!(
                    "range of 100 s means {:.4} deg/h, {:.2} % above the smallest there is",
                    range(&d.residuals(&found.k)),
                    100.0 * found.above
                ));
                records.searched(None, |of| found.history(of, "range [deg/h]", &d.names));
                found.k
            }
        };
        form.store(c, a, &k, &[]);
        Ok(k.len())
    }

    fn swarm_of_squares(
        &self,
        d: &Data,
        stage: Option<Stage>,
        records: &mut Records<'_>,
    ) -> Result<Vec<f64>, BadInput> {
        let found = orthogonal_swarm(d, self.options.seed)?;
        let which = stage.map_or_else(String::new, |s| format!("{}: ", s.name()));
        records.note(format!("{which}sum of squares {:.1e} % above that of least squares", 100.0 * found.above));
        records.searched(stage, |of| found.history(of, "RMS [deg/h]", &d.names));
        Ok(found.k)
    }

    /// The swarm and the box of dong2023 on each stage, in one of the units that the paper may mean; the note has the spread over ten seeds.
    fn literal(&self, d: &Data, records: &mut Records<'_>) -> Result<Vec<f64>, BadInput> {
        let (units, name) = match self.method.parts().search {
            Search::LiteralSwarm(PerRamp::TenMilliseconds) => (LiteralUnits::SAMPLES, "deg/s and C per 10 ms"),
            _ => (LiteralUnits::SECONDS, "deg/s and C/s"),
        };
        let mut k = Vec::new();
        for stage in Stage::ALL {
            let own = d.of_set(stage);
            let columns = printed_columns(self.runs, &self.scaling, self.a, stage, units);
            let swarm = |seed| literal_swarm(&columns, &self.scaling, &own, seed, units);
            let found = swarm(self.options.seed)?;
            let of_seeds = (0..LITERAL_SEEDS).map(|n| Ok((1.0 + swarm(n)?.found.above).sqrt()));
            let spread = of_seeds.collect::<Result<Vec<f64>, BadInput>>()?;
            records.note(format!(
                "{}: in {name} the largest coefficient of least squares is {:.2}, the condition number {:.1e}: RMS {:.2} times the least; over {LITERAL_SEEDS} seeds {:.2} [{:.2}, {:.2}]",
                stage.name(),
                found.largest,
                found.condition,
                (1.0 + found.found.above).sqrt(),
                quantile(&spread, 0.5),
                quantile(&spread, 0.0),
                quantile(&spread, 1.0)
            ));
            records.searched(Some(stage), |of| found.found.history(of, "RMS [deg/h]", &own.names));
            k.extend(found.found.k);
        }
        Ok(k)
    }

    /// The four parameters with their breakpoint, or the network; gives the number of coefficients.
    fn not_linear(&self, c: &mut Calibration, records: &mut Records<'_>) -> Result<usize, BadInput> {
        let a = self.a;
        if self.method.parts().model == Model::Network {
            let trained = self.train_network()?;
            records.searched(None, |of| History {
                of,
                objective_name: "RMS [deg/h]",
                objective: trained.generations_rms_dph,
                names: vec![],
                coefficients: vec![],
            });
            c.axes[a].coefficients = Coefficients::Network(trained.weights);
            return Ok(bias::network::WEIGHTS);
        }
        let m = four_parameters(self.runs, &self.scaling, a, self.method, &self.options, records)?;
        c.axes[a].coefficients = Coefficients::FourParameter(m);
        Ok(four_parameter::TERMS + 1)
    }

    /// The network sees what it will see on the unit, thinned to means of ten seconds.
    fn train_network(&self) -> Result<network::Trained, BadInput> {
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
        match self.method.parts().search {
            Search::LiteralGenetic => network::train_as_printed(&u, &y, self.options.seed),
            _ => network::train(&u, &y, self.options.seed),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::search::{Folded, Searched};
    use hrg_core::AXES;
    use hrg_data::numeric::stats::std_dev;
    use hrg_data::recording::steps::Steps;
    use hrg_identify::fit;
    use hrg_identify::fit::prepare;
    use hrg_simulate::{Kind, Noise, Plan, Profile};

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
        // The fit's data of range alone constrain another run less: allowed twice the floor.
        for (method, most) in [
            (Method::Lsq, 1.1),
            (Method::TwoSets, 1.15),
            (Method::TwoSetsHeld, 1.15),
            (Method::PsoTwoSets, 1.15),
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
                    let Searched { k, above, path, .. } = orthogonal_swarm(&d, seed).expect("swarms");
                    assert_eq!(path.last(), Some(&k));
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
            let above = orthogonal_swarm(&d, 1).expect("swarms").above;
            assert!((0.0..1e-5).contains(&above), "{above:e}");
        }
    }

    /// dong2023's step 1 as printed: a swarm on each stage, in the two units that its box may be meant in.
    #[test]
    fn the_printed_swarm_of_eq_7_misses_the_solution_in_either_unit() {
        let p = prepare(&[plan(Kind::Hrg, "dong2023", 1).simulate().recording]).expect("prepares");
        for a in 0..AXES {
            let both = Data::new(&p.runs, &p.calibration.scaling, a, Form::TwoSetsHeld);
            for stage in Stage::ALL {
                let d = both.of_set(stage);
                let literal = |units| {
                    let columns = printed_columns(&p.runs, &p.calibration.scaling, a, stage, units);
                    literal_swarm(&columns, &p.calibration.scaling, &d, 1, units).expect("swarms")
                };
                let (seconds, samples) = (literal(LiteralUnits::SECONDS), literal(LiteralUnits::SAMPLES));
                // With C/s the solution is of the box's size, and the swarm misses it all the same: the regressors are too unequal. With C per 10 ms the box
                // is far too small for the square of the ramp.
                assert!(seconds.largest < 2.0 && samples.largest > 100.0, "{} {}", seconds.largest, samples.largest);
                assert!(seconds.condition > 1e6, "{:e}", seconds.condition);
                assert!(seconds.found.above > 0.01, "{}", seconds.found.above);
                // The stated excess of its sum of squares is true.
                let squares =
                    |k: &[f64]| -> f64 { d.residuals(k).iter().filter(|e| e.is_finite()).map(|e| e * e).sum() };
                for found in [seconds.found, samples.found] {
                    let ratio = squares(&found.k) / d.fit(None).expect("fits").squares;
                    assert!((ratio / (1.0 + found.above) - 1.0).abs() < 1e-3, "{ratio} {}", found.above);
                }
            }
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

    /// wu2023 as printed (Table 1, eq 3 to 8): four coefficients in boxes of 800 and 100, a breakpoint that is given.
    #[test]
    fn the_printed_swarm_of_four_coefficients_is_as_good_as_exact() {
        let p = prepare(&[plan(Kind::Fog, "wu", 1).simulate().recording]).expect("prepares");
        for (method, most) in [(Method::FogPsoLiteral, 1e-6), (Method::FogPsoRangeLiteral, 0.2)] {
            for seed in [1, 20, 300] {
                let options = Options { seed, breakpoint_c: Some(22.0), ..Options::default() };
                let found = identify_with(&p, method, &options).expect("identifies");
                let above: Vec<f64> = found
                    .notes
                    .iter()
                    .filter_map(|n| n.split("deg/h, ").nth(1)?.split(" %").next()?.parse().ok())
                    .collect();
                assert!(above.len() == AXES && above.iter().all(|x| (0.0..most).contains(x)), "{:?}", found.notes);
                assert_eq!((found.history.len(), found.history[0].coefficients.len()), (AXES, 1000));
                for a in &found.calibration.axes {
                    let Coefficients::FourParameter(m) = a.coefficients else { panic!("not four parameters") };
                    assert_eq!((m.breakpoint_c, m.origin_c), (22.0, 0.0));
                }
            }
        }
        let e = identify_with(&p, Method::Lsq, &Options { breakpoint_c: Some(22.0), ..Options::default() });
        assert!(e.expect_err("refused").to_string().contains("no breakpoint"));
        let e = identify_with(&p, Method::FogLsq, &Options { breakpoint_c: Some(300.0), ..Options::default() });
        assert!(e.expect_err("refused").to_string().contains("lies outside"));
    }

    /// dong2023's two stages: what a held set leaves is what two fits by hand leave, and the image says the same.
    #[test]
    fn two_sets_that_are_held_are_two_fits() {
        let p = prepare(&[plan(Kind::Hrg, "dong", 1).simulate().recording]).expect("prepares");
        let id = identify(&p, Method::TwoSetsHeld, 1).expect("identifies");
        let (run, scaling) = (&p.runs[0], &p.calibration.scaling);
        let corrected = fit::correct(&id.calibration, &run.steps);
        for a in 0..AXES {
            let stages = crate::stages::of_run(run, scaling, a);
            let columns = fit::baseline_columns(run, scaling, a);
            for stage in Stage::ALL {
                let y = crate::stages::only(&run.steps.rate_dph[a], &stages, stage);
                let by_hand = hrg_data::numeric::lsq::fit(&columns, &y, None, &fit::NAMES).expect("fits");
                let left = crate::stages::only(&corrected[a], &stages, stage);
                let squares: f64 = left.iter().filter(|v| v.is_finite()).map(|v| v * v).sum();
                assert!((squares / by_hand.squares - 1.0).abs() < 2e-3, "{squares} {}", by_hand.squares);
            }
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

    /// The bias follows losses and stiffness; the methods see what the loops show of them.
    #[test]
    fn methods_of_inputs_learn_what_losses_and_stiffness_do() {
        let effects = ["drive-amplitude:size=4", "quadrature:size=3"];
        let of = |profile: &str, seed| Plan {
            effects: effects.iter().map(|e| hrg_simulate::EffectSpec::parse(e).expect("known")).collect(),
            ..plan(Kind::Hrg, profile, seed)
        };
        let p = prepare(&[of("cycle", 1).simulate().recording]).expect("prepares");
        let error = |method, plan: &Plan| {
            let id = identify(&p, method, 3).expect("identifies");
            id.calibration.check().expect("a block");
            assert_eq!(
                id.calibration,
                identify(&p, method, 3).expect("identifies").calibration,
                "{method} repeats itself"
            );
            let (e, floor) = errors(&id.calibration, plan);
            (0..AXES).map(|a| e[a] / floor[a]).fold(0.0, f64::max)
        };
        // Shares of what eq 7 leaves, on the worst axis.
        for (profile, inputs, network) in [("cycle", 0.3, 0.3), ("verify", 0.3, 0.6)] {
            let plan = of(profile, 2);
            let without = error(Method::Lsq, &plan);
            for (method, most) in [(Method::Inputs, inputs), (Method::InputNetwork, network)] {
                let left = error(method, &plan);
                assert!(left < most * without, "{method} on {profile}: {left} of {without} floors");
            }
        }
    }

    #[test]
    fn outliers_hardly_move_the_robust_fit() {
        let clean = plan(Kind::Hrg, "cycle", 1).simulate().recording;
        let mut defective = clean.clone();
        // A disturbance too long to be a spike and too small to be taken out: ten minutes of three deg/h in each hour.
        for v in &mut defective.rate_dph {
            for (k, x) in v.iter_mut().enumerate() {
                if k % 3600 < 600 {
                    *x += 30.0;
                }
            }
        }
        let verify = plan(Kind::Hrg, "verify", 2);
        let p = prepare(&[defective]).expect("prepares");
        let error = |method| {
            let (e, _) = errors(&identify(&p, method, 1).expect("identifies").calibration, &verify);
            e.iter().sum::<f64>()
        };
        assert!(error(Method::Huber) < 0.7 * error(Method::Lsq), "{} {}", error(Method::Huber), error(Method::Lsq));
    }

    #[test]
    fn missing_inputs_are_reported() {
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
