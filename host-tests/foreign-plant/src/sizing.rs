//! Sizes of the effects of a case: each is scaled until it leaves as much as the case states.

use crate::acting::Acting;
use crate::case::{Acts, Effect, Runs, Size, AXES};
use crate::draw::{Draw, Properties};
use crate::fit;
use crate::making::{kept, stack, Making};
use crate::means::rms;
use std::collections::BTreeMap;

/// Largest fault of a thermometer: 2 % of the frequency, or 50 C of a sensor for each unit of its form.
const LARGEST_PPM: f64 = 20_000.0;
const LARGEST_C: f64 = 50.0;

impl Making<'_> {
    /// Runs on which the size of `effect` is stated.
    pub(crate) fn sized_on(&self, effect: &Effect) -> Vec<usize> {
        let verify = self.verify();
        if effect.runs == Runs::Verify {
            vec![verify]
        } else {
            (0..verify).collect()
        }
    }

    fn acts_in(&self, effect: &Effect, k: usize) -> bool {
        match effect.runs {
            Runs::All => true,
            Runs::Train => k < self.verify(),
            Runs::Verify => k == self.verify(),
        }
    }

    /// Works out effect number `e` and its scale.
    pub(crate) fn act(&self, e: usize) -> Acting {
        let effect = &self.case.effects[e];
        let mut parameters = BTreeMap::new();
        let mut form = Vec::new();
        for (k, world) in self.worlds.iter().enumerate() {
            form.push([0, 1, 2].map(|a| {
                if !effect.on(a) || !self.acts_in(effect, k) {
                    return Vec::new();
                }
                let mut draw = Draw::new(self.seed, &self.case.name, e, a, k);
                let signal = (effect.form)(&mut draw, world, a);
                parameters.insert(AXES[a].to_owned(), draw.values);
                signal
            }));
        }
        let means = form
            .iter()
            .enumerate()
            .map(|(k, three)| {
                [0, 1, 2].map(|a| if three[a].is_empty() { Vec::new() } else { self.means(k, &three[a]) })
            })
            .collect();
        let mut acting = Acting { form, means, scale: [0.0; 3], floors: [0.0; 3], parameters };
        let axes: Vec<usize> = (0..3).filter(|&a| effect.on(a)).collect();
        match effect.acts {
            Acts::OnBias => axes.iter().for_each(|&a| self.scale_bias(e, a, &mut acting)),
            Acts::OnThermometer => axes.iter().for_each(|&a| acting.scale[a] = self.scale_fault(e, &acting, &[a])),
            Acts::OnAllThermometers => {
                let scale = self.scale_fault(e, &acting, &axes);
                axes.iter().for_each(|&a| acting.scale[a] = scale);
            }
        }
        if effect.acts != Acts::OnBias {
            axes.iter().for_each(|&a| acting.floors[a] = self.fault_floors(effect, &acting, a, acting.scale[a]));
        }
        acting
    }

    /// Draws the unit's own spread of a size, 10 % either way, and its sign.
    fn spread(&self, e: usize, axis: &str) -> (f64, f64) {
        let mut rng = Properties::new(self.seed, &[&self.case.name, "size", &e.to_string(), axis]);
        (rng.random_range(0.9..1.1), if rng.random_bool(0.5) { 1.0 } else { -1.0 })
    }

    /// Scales effect number `e` on axis `a` so that equation 7, fitted to it alone, leaves its size.
    fn scale_bias(&self, e: usize, a: usize, acting: &mut Acting) {
        let effect = &self.case.effects[e];
        let runs = self.sized_on(effect);
        let columns = stack(&runs, |k| self.columns[k][a].clone());
        let signal: Vec<f64> = runs.iter().flat_map(|&k| acting.means[k][a].clone()).collect();
        let left = rms(&fit::leftover(&columns, &fit::solve(&columns, &signal), &signal));
        let floor = self.floor(&runs, a);
        let (spread, sign) = self.spread(e, AXES[a]);
        acting.scale[a] = match effect.size {
            Size::Floors(floors) => sign * floors[a] * spread * floor / left.max(1e-300),
            Size::Natural(scales) => scales[a],
        };
        acting.floors[a] = acting.scale[a].abs() * left / floor;
    }

    /// Scale at which fault number `e` leaves its size, in the mean over `axes`: by bisection, on a logarithmic scale.
    fn scale_fault(&self, e: usize, acting: &Acting, axes: &[usize]) -> f64 {
        let effect = &self.case.effects[e];
        let axis = if axes.len() == 1 { AXES[axes[0]] } else { "all" };
        let wanted = match effect.size {
            Size::Floors(floors) => floors[axes[0]] * self.spread(e, axis).0,
            Size::Natural(scales) => return scales[axes[0]],
        };
        let size = |scale: f64| {
            let sum: f64 = axes.iter().map(|&a| self.fault_floors(effect, acting, a, scale)).sum();
            sum / axes.len() as f64
        };
        let mut high = if self.by_frequency() { LARGEST_PPM } else { LARGEST_C };
        let mut low = high * 1e-4;
        for _ in 0..16 {
            let middle = (low * high).sqrt();
            if size(middle) < wanted {
                low = middle;
            } else {
                high = middle;
            }
        }
        (low * high).sqrt()
    }

    /// Residual of the bias on axis `a` after equation 7 on the indicated temperature with a fault of the given scale, in noise floors.
    fn fault_floors(&self, effect: &Effect, acting: &Acting, a: usize, scale: f64) -> f64 {
        let runs = self.sized_on(effect);
        let indicated: Vec<Vec<f64>> = (0..self.worlds.len())
            .map(|k| {
                let mut t_c = self.worlds[k].t_c[a].clone();
                t_c.iter_mut().zip(self.error_c(acting, k, a, scale)).for_each(|(t, error)| *t += error);
                t_c
            })
            .collect();
        let taken = self.taken_for_t(a, indicated);
        let parts: BTreeMap<usize, _> = runs.iter().map(|&k| (k, self.indicated_columns(k, a, &taken[k]))).collect();
        let keep: Vec<bool> = runs.iter().flat_map(|k| parts[k].1.clone()).collect();
        let columns: Vec<Vec<f64>> = stack(&runs, |k| parts[&k].0.clone()).iter().map(|c| kept(c, &keep)).collect();
        let bias: Vec<f64> = runs.iter().flat_map(|&k| self.means(k, &self.base[k][a])).collect();
        let bias = kept(&bias, &keep);
        rms(&fit::leftover(&columns, &fit::solve(&columns, &bias), &bias)) / self.floor(&runs, a)
    }

    /// Error of the thermometer of axis `a` in run `k` by a fault of the given scale, C, to first order.
    fn error_c(&self, acting: &Acting, k: usize, a: usize, scale: f64) -> Vec<f64> {
        let curve = &self.unit.curves[a];
        let by_frequency = self.by_frequency();
        let per_unit = |t: f64| if by_frequency { 1e-6 * curve.hz(t) / curve.hz_per_c(t) } else { 1.0 };
        acting.form[k][a].iter().zip(&self.worlds[k].t_c[a]).map(|(x, &t)| scale * x * per_unit(t)).collect()
    }
}
