//! A case under way: worlds, noise, the bias of equation 7, and their sum.

use crate::acting::{Acting, Three};
use crate::case::{Acts, Case, AXES};
use crate::draw::{stream, Seed};
use crate::fit;
use crate::losses::resonate;
use crate::means::{deviation, means, peaks, rms};
use crate::noise;
use crate::operators::slope_per_min;
use crate::plan::Followed;
use crate::unit::Unit;
use crate::world::World;
use rand::Rng;
use rand_distr::{Distribution, StandardNormal};

/// A ramp that is wrong by more than this is a jump of the thermometer, C/min: such 100 s means are left out of the figures.
const JUMP_C_PER_MIN: f64 = 3.0;

/// All that is known of a case under way. Runs are numbered: train runs first, then the verify run, the run that judges, and those that nothing is sized by.
pub(crate) struct Making<'a> {
    pub(crate) case: &'a Case,
    pub(crate) seed: Seed,
    pub(crate) unit: Unit,
    pub(crate) worlds: Vec<World>,
    /// The bias of equation 7 without k0 and without the days' changes, deg/h.
    pub(crate) base: Vec<Three>,
    /// Means of 100 s of the columns of equation 7 on the true temperature.
    pub(crate) columns: Vec<[Vec<Vec<f64>>; 3]>,
    /// k1 to k5, deg/h.
    pub(crate) k: [[f64; 5]; 3],
    /// Added to k0 in each run, deg/h.
    pub(crate) constants: Vec<[f64; 3]>,
    /// Added to k1 in the verify run, deg/h/C.
    slopes: [f64; 3],
    /// Noise floors by run and axis, deg/h.
    pub(crate) floors: Vec<[f64; 3]>,
    /// Temperatures that the thermometers indicate, C.
    pub(crate) indicated: Vec<Three>,
    /// Rates, deg/h. Until they are added up: their noise.
    pub(crate) rates: Vec<Three>,
    /// The bias of the run that judges, deg/h: its rates without their noise.
    pub(crate) bias: Three,
}

impl<'a> Making<'a> {
    /// Draws the unit, runs the chamber, makes the noise and the bias of equation 7.
    pub(crate) fn start(case: &'a Case, seed: Seed) -> Self {
        let unit = Unit::draw(case, seed);
        let worlds = worlds(case, seed, &unit);
        let rates = noises(case, seed, &unit, &worlds);
        let columns: Vec<[Vec<Vec<f64>>; 3]> =
            worlds.iter().map(|w| [0, 1, 2].map(|a| eq7_means(w, &w.t_c[a], &w.ramp[a]))).collect();
        let floor = |w: &World, noise: &Three, a: usize| deviation(&means(&noise[a], w.dt_s, w.first));
        let floors = worlds.iter().zip(&rates).map(|(w, noise)| [0, 1, 2].map(|a| floor(w, noise, a))).collect();
        let mut making = Self {
            case,
            seed,
            unit,
            base: Vec::new(),
            columns,
            k: [[0.0; 5]; 3],
            constants: vec![[0.0; 3]; worlds.len()],
            slopes: [0.0; 3],
            floors,
            indicated: worlds.iter().map(|w| w.t_c.clone()).collect(),
            bias: rates[case.trains.len() + 1].clone(),
            worlds,
            rates,
        };
        making.scale_base();
        making.change_days();
        making
    }

    /// Number of the verify run.
    pub(crate) fn verify(&self) -> usize {
        self.case.trains.len()
    }

    /// Means of 100 s over the log of run `k`.
    pub(crate) fn means(&self, k: usize, x: &[f64]) -> Vec<f64> {
        means(x, self.worlds[k].dt_s, self.worlds[k].first)
    }

    /// Noise floor over several runs, deg/h.
    pub(crate) fn floor(&self, runs: &[usize], a: usize) -> f64 {
        rms(&runs.iter().map(|&k| self.floors[k][a]).collect::<Vec<_>>())
    }

    /// `true` if the thermometer is a frequency.
    pub(crate) fn by_frequency(&self) -> bool {
        self.case.layout.followed == Followed::Resonator
    }

    /// Scales the bias of equation 7 to its size on the run with the widest temperatures.
    fn scale_base(&mut self) {
        for a in 0..3 {
            let width = |k: usize| deviation(&self.columns[k][a][0]);
            let widest = (0..=self.verify()).max_by(|&i, &j| width(i).total_cmp(&width(j))).unwrap_or(0);
            let shape = self.unit.shape[a];
            let columns = &self.columns[widest][a];
            let bias = fit::leftover(columns, &shape, &vec![0.0; columns[0].len()]);
            let scale = self.unit.three_sigma_dph[a] / 3.0 / deviation(&bias);
            self.k[a] = shape.map(|k| k * scale);
        }
        let bias = |w: &World, a: usize| -> Vec<f64> {
            let k = self.k[a];
            let at = |(&t, &r): (&f64, &f64)| k[0] * t + k[1] * t * t + k[2] * r + k[3] * r * r + k[4] * t * r;
            w.t_c[a].iter().zip(&w.ramp[a]).map(at).collect()
        };
        self.base = self.worlds.iter().map(|w| [0, 1, 2].map(|a| bias(w, a))).collect();
    }

    /// Draws what changes from day to day.
    fn change_days(&mut self) {
        let days = self.case.days;
        let mut rng = stream(self.seed, &[&self.case.name, "days"]);
        let verify = self.verify();
        for a in 0..3 {
            for k in 1..=verify {
                let shift: f64 = StandardNormal.sample(&mut rng);
                self.constants[k][a] = days.constant_floors * self.unit.floors_dph[a] * shift;
            }
            let sign = if rng.random_bool(0.5) { 1.0 } else { -1.0 };
            let width = deviation(&self.columns[verify][a][0]);
            self.slopes[a] = sign * days.slope_floors * self.floors[verify][a] / width;
        }
        let mut rng = stream(self.seed, &[&self.case.name, "day of the judge"]);
        for a in 0..3 {
            let shift: f64 = StandardNormal.sample(&mut rng);
            self.constants[verify + 1][a] = days.constant_floors * self.unit.floors_dph[a] * shift;
        }
    }

    /// Means of the columns of equation 7 on an indicated temperature, and which of them hold no jump of it.
    pub(crate) fn indicated_columns(&self, k: usize, a: usize, indicated: &[f64]) -> (Vec<Vec<f64>>, Vec<bool>) {
        let w = &self.worlds[k];
        let ramp = slope_per_min(indicated, w.dt_s, 60.0);
        let wrong: Vec<f64> = ramp.iter().zip(&w.ramp[a]).map(|(x, r)| x - r).collect();
        let keep = peaks(&wrong, w.dt_s, w.first).into_iter().map(|peak| peak < JUMP_C_PER_MIN).collect();
        (eq7_means(w, indicated, &ramp), keep)
    }

    /// The user's temperature of axis `a`, by run, where the thermometers indicate `indicated`. A frequency is calibrated
    /// against case sensors on the train runs, so a cubic of what it indicates is fitted to the true temperature there: a fault that is a
    /// smooth function of temperature vanishes in the calibration. A sensor is taken as it is.
    pub(crate) fn taken_for_t(&self, a: usize, indicated: Vec<Vec<f64>>) -> Vec<Vec<f64>> {
        let right = self.worlds.iter().zip(&indicated).all(|(w, x)| w.t_c[a] == *x);
        if right || !self.by_frequency() {
            return indicated;
        }
        let powers = |x: &[f64]| -> Vec<Vec<f64>> {
            (0..4).map(|power| x.iter().map(|x| ((x - 10.0) / 50.0_f64).powi(power)).collect()).collect()
        };
        let of_trains = |x: &dyn Fn(usize) -> Vec<f64>| -> Vec<f64> { (0..self.verify()).flat_map(x).collect() };
        let from = of_trains(&|k| self.means(k, &indicated[k]));
        let to = of_trains(&|k| self.means(k, &self.worlds[k].t_c[a]));
        let cubic = fit::solve(&powers(&from), &to);
        let at = |x: f64| {
            let u = (x - 10.0) / 50.0;
            cubic[0] + u * (cubic[1] + u * (cubic[2] + u * cubic[3]))
        };
        indicated.iter().map(|run| run.iter().map(|&x| at(x)).collect()).collect()
    }

    /// Works out what the thermometers indicate.
    pub(crate) fn indicate(&mut self, effects: &[Acting]) {
        let by_frequency = self.by_frequency();
        for k in 0..self.worlds.len() {
            for a in 0..3 {
                let faults: Vec<&Acting> = effects
                    .iter()
                    .zip(&self.case.effects)
                    .filter(|(acting, effect)| effect.acts != Acts::OnBias && !acting.form[k][a].is_empty())
                    .map(|(acting, _)| acting)
                    .collect();
                if faults.is_empty() {
                    continue;
                }
                let curve = self.unit.curves[a];
                for (i, t) in self.indicated[k][a].iter_mut().enumerate() {
                    let error: f64 = faults.iter().map(|acting| acting.scale[a] * acting.form[k][a][i]).sum();
                    *t = if by_frequency { curve.t_c(curve.hz(*t) * (1.0 + 1e-6 * error), *t) } else { *t + error };
                }
            }
        }
    }

    /// Adds constants, bias and effects to the noise.
    pub(crate) fn add_up(&mut self, effects: &[Acting]) {
        let verify = self.verify();
        for (k, three) in self.rates.iter_mut().enumerate() {
            for (a, rate) in three.iter_mut().enumerate() {
                let constant = self.unit.k0_dph[a] + self.constants[k][a];
                let slope = if k == verify { self.slopes[a] } else { 0.0 };
                for (i, rate) in rate.iter_mut().enumerate() {
                    *rate += constant + self.base[k][a][i] + slope * self.worlds[k].t_c[a][i];
                }
                for (acting, effect) in effects.iter().zip(&self.case.effects) {
                    if effect.acts == Acts::OnBias {
                        rate.iter_mut().zip(&acting.form[k][a]).for_each(|(rate, x)| *rate += acting.scale[a] * x);
                    }
                }
            }
        }
        // (Until here the bias of the run that judges holds its noise.)
        for (bias, rate) in self.bias.iter_mut().zip(&self.rates[verify + 1]) {
            bias.iter_mut().zip(rate).for_each(|(bias, rate)| *bias = rate - *bias);
        }
    }

    /// Name of the file of run `k`.
    pub(crate) fn file(&self, k: usize) -> String {
        let stem = format!("{}-{}", self.case.name, self.seed.unit);
        if k > self.verify() + 1 {
            format!("{stem}-more-{}.csv", k - self.verify() - 1)
        } else if k > self.verify() {
            format!("{stem}-judge.csv")
        } else if k == self.verify() {
            format!("{stem}-verify.csv")
        } else if self.verify() == 1 {
            format!("{stem}-train.csv")
        } else {
            format!("{stem}-train-{}.csv", k + 1)
        }
    }
}

fn worlds(case: &Case, seed: Seed, unit: &Unit) -> Vec<World> {
    let dt_s = case.layout.row_s.min(1.0);
    case.runs()
        .enumerate()
        .map(|(k, spec)| {
            let mut rng = stream(seed, &[&case.name, "run", &k.to_string()]);
            let mut world = World::run(&mut rng, unit, spec.plan, case.layout.followed, dt_s);
            if case.layout.losses {
                resonate(&mut world, seed, &case.name, k);
            }
            world
        })
        .collect()
}

fn noises(case: &Case, seed: Seed, unit: &Unit, worlds: &[World]) -> Vec<Three> {
    let noise = |k: usize, w: &World, a: usize| -> Vec<f64> {
        let mut rng = stream(seed, &[&case.name, "noise", &k.to_string(), AXES[a]]);
        let mut x = noise::sample(&mut rng, &case.noise, unit.mixtures[a], &w.t_c[a], w.dt_s);
        x.iter_mut().for_each(|x| *x *= unit.floors_dph[a]);
        x
    };
    worlds.iter().enumerate().map(|(k, w)| [0, 1, 2].map(|a| noise(k, w, a))).collect()
}

/// Means of 100 s of the columns of equation 7.
fn eq7_means(w: &World, t_c: &[f64], ramp: &[f64]) -> Vec<Vec<f64>> {
    fit::eq7(t_c, ramp).iter().map(|column| means(column, w.dt_s, w.first)).collect()
}

/// Columns of several runs, one after the other, behind a constant for each run.
pub(crate) fn stack(runs: &[usize], columns: impl Fn(usize) -> Vec<Vec<f64>>) -> Vec<Vec<f64>> {
    let all: Vec<Vec<Vec<f64>>> = runs.iter().map(|&k| columns(k)).collect();
    let lengths: Vec<usize> = all.iter().map(|c| c[0].len()).collect();
    let constant = |of: usize| -> Vec<f64> {
        lengths.iter().enumerate().flat_map(|(k, &n)| vec![if k == of { 1.0 } else { 0.0 }; n]).collect()
    };
    let constants = (0..runs.len()).map(constant);
    let others = (0..all[0].len()).map(|c| all.iter().flat_map(|columns| columns[c].clone()).collect());
    constants.chain(others).collect()
}

/// The entries of `x` that are to be kept.
pub(crate) fn kept(x: &[f64], keep: &[bool]) -> Vec<f64> {
    x.iter().zip(keep).filter(|(_, keep)| **keep).map(|(x, _)| *x).collect()
}
