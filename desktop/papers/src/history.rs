//! Course of a search: its objective and the best coefficients after each iteration (wu2023's figures 5 to 9, zhao2022's figure 9).

use hrg_data::plot;
use hrg_data::plot::{Panel, Series};
use std::fmt::Write as _;

/// One search.
#[derive(Debug, Clone, PartialEq)]
pub struct History {
    /// Subject of the search: the axis, and the stage if each has its own.
    pub of: String,
    /// Objective that is minimised, with unit.
    pub objective_name: &'static str,
    /// The least so far after each iteration.
    pub objective: Vec<f64>,
    /// Names of the coefficients; none where the search has no coefficients to tell (a network).
    pub names: Vec<&'static str>,
    /// The best so far after each iteration.
    pub coefficients: Vec<Vec<f64>>,
}

impl History {
    /// The first iteration from which the objective stays within a thousandth of where it ends: whether a search has converged.
    #[must_use]
    pub fn settled_at(&self) -> usize {
        let Some(last) = self.objective.last() else { return 0 };
        self.objective.iter().rposition(|v| (v - last).abs() > 1e-3 * last.abs()).map_or(0, |k| k + 1)
    }
}

/// All searches as a table: `of,iteration,objective`, and a column for each coefficient.
#[must_use]
pub fn csv(all: &[History]) -> String {
    let names: &[&str] = all.first().map_or(&[], |h| &h.names);
    let mut out = String::from("of,iteration,objective");
    names.iter().for_each(|n| {
        let _ = write!(out, ",{n}");
    });
    out.push('\n');
    for h in all {
        for (k, value) in h.objective.iter().enumerate() {
            let _ = write!(out, "{},{},{value:e}", h.of, k + 1);
            for c in h.coefficients.get(k).into_iter().flatten() {
                let _ = write!(out, ",{c:e}");
            }
            out.push('\n');
        }
    }
    out
}

/// Points of a curve.
const DRAWN: usize = 100;

/// Iterations that are drawn: evenly, and the last.
fn drawn(iterations: usize) -> impl Iterator<Item = usize> {
    let step = iterations.div_ceil(DRAWN).max(1);
    (0..iterations).filter(move |k| k % step == 0 || k + 1 == iterations)
}

/// The searches of some methods drawn: one row a method, the objective first, then each coefficient.
///
/// # Errors
/// If the drawing library fails.
pub fn picture(methods: &[(String, Vec<History>)]) -> anyhow::Result<String> {
    let columns = 1 + methods.iter().flat_map(|(_, all)| all.iter().map(|h| h.names.len())).max().unwrap_or(0);
    let mut panels = Vec::new();
    for (method, all) in methods {
        let Some(first) = all.first() else { continue };
        // The legend stands in the first panel of a row, and is that of the whole row.
        let panel = |title: String, y: String, legend: bool, value: &dyn Fn(&History, usize) -> Option<f64>| Panel {
            title,
            x: "iteration".into(),
            y,
            log: false,
            series: all
                .iter()
                .enumerate()
                .map(|(n, h)| Series {
                    label: if legend { h.of.clone() } else { String::new() },
                    points: drawn(h.objective.len()).filter_map(|k| Some(((k + 1) as f64, value(h, k)?))).collect(),
                    colour: n + 1,
                    dots: false,
                })
                .collect(),
        };
        panels.push(panel(method.clone(), first.objective_name.into(), true, &|h, k| h.objective.get(k).copied()));
        for (j, name) in first.names.iter().enumerate() {
            let at = |h: &History, k: usize| h.coefficients.get(k)?.get(j).copied();
            panels.push(panel(format!("{method}: {name}"), "coefficient".into(), false, &at));
        }
        while panels.len() % columns != 0 {
            panels.push(Panel::default());
        }
    }
    plot::svg(&panels, columns, 300, 220)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_search_is_recorded_iteration_by_iteration() {
        let h = History {
            of: "x".into(),
            objective_name: "RMS [deg/h]",
            objective: vec![4.0, 2.0, 1.0, 1.0],
            names: vec!["1", "T"],
            coefficients: vec![vec![0.0, 1.0], vec![0.5, 1.0], vec![1.0, 2.0], vec![1.0, 2.0]],
        };
        assert_eq!(h.settled_at(), 2);
        let text = csv(std::slice::from_ref(&h));
        assert_eq!(text.lines().next(), Some("of,iteration,objective,1,T"));
        assert_eq!(text.lines().nth(3), Some("x,3,1e0,1e0,2e0"));
        let svg = picture(&[("pso".into(), vec![h])]).expect("drawn");
        assert!(svg.contains("pso: T"));
    }
}
