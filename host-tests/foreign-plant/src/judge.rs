//! The truth of a case that has been made.

use crate::acting::Acting;
use crate::case::{Acts, Runs, Size, AXES};
use crate::fit;
use crate::making::{kept, stack, Making};
use crate::means::{deviation, rms};
use crate::truth::{AxisFigures, Class, EffectTruth, RunTruth, Truth};
use std::cmp::Ordering;
use std::collections::BTreeMap;

/// Residuals on one axis of one run, deg/h.
#[derive(Clone, Copy)]
struct Leftover {
    eq7_dph: f64,
    oracle_dph: f64,
}

impl Making<'_> {
    /// The truth beside the recordings; `defects` by run.
    pub(crate) fn truth(&self, effects: &[Acting], defects: Vec<BTreeMap<String, usize>>) -> Truth {
        let case = self.case;
        let axes = || case.layout.axes.iter().copied();
        let left: BTreeMap<usize, Vec<Leftover>> = axes().map(|a| (a, self.leftovers(effects, a))).collect();
        let runs = case
            .runs()
            .zip(defects)
            .enumerate()
            .map(|(k, (spec, defects))| RunTruth {
                role: match k.cmp(&self.verify()) {
                    Ordering::Less => "train",
                    Ordering::Equal => "verify",
                    Ordering::Greater if k == self.verify() + 1 => "judge",
                    Ordering::Greater => "more",
                }
                .into(),
                file: self.file(k),
                program: format!("{:?}", spec.plan.program),
                axes: axes().map(|a| (AXES[a].into(), self.figures(k, a, left[&a][k]))).collect(),
                bias_dph: if k == self.verify() + 1 {
                    axes().map(|a| (AXES[a].into(), self.means(k, &self.bias[a]))).collect()
                } else {
                    BTreeMap::new()
                },
                defects,
            })
            .collect();
        let coefficients = |a: usize| {
            let [k1, k2, k3, k4, k5] = self.k[a];
            [self.unit.k0_dph[a], k1, k2, k3, k4, k5]
        };
        let why_not = case.why_not_compensable();
        Truth {
            version: 1,
            case: case.name.clone(),
            seed: self.seed.unit,
            description: case.description.clone(),
            group: case.group.into(),
            classes: case.classes(),
            beside: case.beside(),
            effects: effects.iter().enumerate().map(|(e, acting)| self.effect_truth(e, acting)).collect(),
            compensable: why_not.is_none(),
            why_not: why_not.unwrap_or_default().into(),
            noise: case.noise.name(),
            eq7_coefficients: axes().map(|a| (AXES[a].into(), coefficients(a))).collect(),
            eq7_three_sigma_dph: axes().map(|a| (AXES[a].into(), self.unit.three_sigma_dph[a])).collect(),
            runs,
        }
    }

    /// Leftovers of axis `a` by run. Coefficients and gains come from the train runs only.
    fn leftovers(&self, effects: &[Acting], a: usize) -> Vec<Leftover> {
        let runs = 0..self.worlds.len();
        let trains: Vec<usize> = (0..self.verify()).collect();
        let rates: Vec<Vec<f64>> = runs.clone().map(|k| self.means(k, &self.rates[k][a])).collect();
        let y: Vec<f64> = trains.iter().flat_map(|&k| rates[k].clone()).collect();

        let taken = self.taken_for_t(a, runs.clone().map(|k| self.indicated[k][a].clone()).collect());
        let indicated: Vec<(Vec<Vec<f64>>, Vec<bool>)> =
            runs.clone().map(|k| self.indicated_columns(k, a, &taken[k])).collect();
        let keep: Vec<bool> = trains.iter().flat_map(|&k| indicated[k].1.clone()).collect();
        let columns: Vec<Vec<f64>> =
            stack(&trains, |k| indicated[k].0.clone()).iter().map(|c| kept(c, &keep)).collect();
        let eq7 = fit::solve(&columns, &kept(&y, &keep));
        let oracle = fit::solve(&stack(&trains, |k| self.exact(effects, k, a, false)), &y);

        // The constants of the train runs come first; a deviation does not see a constant.
        let left =
            |columns: &[Vec<f64>], all: &[f64], k: usize| fit::leftover(columns, &all[trains.len()..], &rates[k]);
        runs.map(|k| Leftover {
            eq7_dph: deviation(&kept(&left(&indicated[k].0, &eq7, k), &indicated[k].1)),
            oracle_dph: deviation(&left(&self.exact(effects, k, a, k >= self.verify()), &oracle, k)),
        })
        .collect()
    }

    /// Columns of equation 7 on the true temperature, and of each effect on the bias of axis `a`. In a forecast, events are left out: nobody
    /// can know them.
    fn exact(&self, effects: &[Acting], k: usize, a: usize, forecast: bool) -> Vec<Vec<f64>> {
        let mut columns = self.columns[k][a].clone();
        let rows = columns[0].len();
        for (acting, effect) in effects.iter().zip(&self.case.effects) {
            if effect.acts == Acts::OnBias && effect.on(a) {
                let silent = acting.means[k][a].is_empty() || (forecast && effect.classes[0] == Class::Event);
                columns.push(if silent { vec![0.0; rows] } else { acting.means[k][a].clone() });
            }
        }
        columns
    }

    fn figures(&self, k: usize, a: usize, left: Leftover) -> AxisFigures {
        let floor_dph = self.floors[k][a];
        AxisFigures {
            floor_dph,
            raw_dph: deviation(&self.means(k, &self.rates[k][a])),
            eq7_dph: left.eq7_dph,
            oracle_dph: left.oracle_dph,
            eq7_floors: left.eq7_dph / floor_dph,
            oracle_floors: left.oracle_dph / floor_dph,
            constant_dph: self.constants[k][a],
        }
    }

    fn effect_truth(&self, e: usize, acting: &Acting) -> EffectTruth {
        let effect = &self.case.effects[e];
        let axes: Vec<usize> = self.case.layout.axes.iter().copied().filter(|&a| effect.on(a)).collect();
        let of = |f: &dyn Fn(usize) -> f64| axes.iter().map(|&a| (AXES[a].to_owned(), f(a))).collect();
        let on_bias = effect.acts == Acts::OnBias;
        let deviation_dph = |a: usize| {
            let runs = self.sized_on(effect);
            let each: Vec<f64> = runs.iter().map(|&k| deviation(&acting.means[k][a]) * acting.scale[a]).collect();
            rms(&each)
        };
        let stated = |a: usize| match effect.size {
            Size::Floors(floors) => Some(floors[a]),
            Size::Natural(_) => None,
        };
        let runs = match effect.runs {
            Runs::All => "all",
            Runs::Train => "train",
            Runs::Verify => "verify",
        };
        EffectTruth {
            name: effect.name.into(),
            classes: effect.classes.clone(),
            beside: effect.beside.clone(),
            axes: axes.iter().map(|&a| AXES[a].to_owned()).collect(),
            runs: runs.into(),
            size_floors: of(&|a| acting.floors[a]),
            stated_floors: axes.iter().map(|&a| (AXES[a].to_owned(), stated(a))).collect(),
            deviation_dph: if on_bias { of(&deviation_dph) } else { BTreeMap::new() },
            fault_scale: if on_bias { BTreeMap::new() } else { of(&|a| acting.scale[a]) },
            compensable: effect.why_not.is_none(),
            why_not: effect.why_not.unwrap_or_default().into(),
            parameters: axes
                .iter()
                .filter_map(|&a| acting.parameters.get(AXES[a]).map(|values| (AXES[a].to_owned(), values.clone())))
                .collect(),
        }
    }
}
