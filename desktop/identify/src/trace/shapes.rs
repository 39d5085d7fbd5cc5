//! The curve or the loop that each effect found stands for, so that a person recognises it.

use super::data::Data;
use super::model::Fitted;
use super::user_effects::card_of;
use hrg_core::effects::parameters::{Parameters, Taus};
use hrg_core::effects::{rung, EffectId};
use hrg_core::AXES;
use hrg_data::axes::AXIS_NAMES;
use hrg_data::cards::Class;
use hrg_data::plot::{Panel, Series};

/// Pictures of each effect of a model on its train runs, in the order of the model.
pub fn of(data: &Data<'_>, fitted: &Fitted) -> Vec<Vec<Panel>> {
    let each_axis: Vec<Vec<Vec<f64>>> = (0..AXES)
        .map(|a| if data.axes[a].y.is_empty() { vec![] } else { fitted.model.columns(data, a).values })
        .collect();
    fitted
        .terms()
        .iter()
        .enumerate()
        .map(|(e, t)| {
            let class = card_of(t.lead().facts).class;
            let mut panel = Panel {
                title: format!("{}: what it adds to the bias, train runs", t.lead().facts.name),
                x: abscissa(class).into(),
                y: "deg/h".into(),
                log: false,
                series: vec![],
            };
            let mut gains = Panel {
                title: format!("{}: gain of each time constant", t.lead().facts.name),
                x: "time constant, power of ten of seconds".into(),
                y: "deg/h per C".into(),
                ..Panel::default()
            };
            for a in 0..AXES {
                let Some(range) = fitted.gains(e, a).filter(|_| !each_axis[a].is_empty()) else { continue };
                let own = &fitted.axes[a].coefficients[range.clone()];
                let sum = |k: usize| range.clone().zip(own).map(|(j, g)| g * each_axis[a][j][k]).sum::<f64>();
                let at = places(data, a, class);
                let points = at.iter().enumerate().map(|(k, x)| (*x, sum(k))).collect();
                panel.series.push(line(a, points, class != Class::Hysteresis && !in_time(class)));
                let c = t.lead();
                if c.facts.effect == EffectId::LagLadder {
                    let (n, taus) = (c.facts.outputs, Taus::of(&c.parameters));
                    let tau = |k: usize| f64::from(rung(taus.tau_min_s, taus.tau_max_s, k, n)).log10();
                    gains.series.push(line(a, (0..n).map(|k| (tau(k), own[k])).collect(), false));
                }
            }
            [panel, gains].into_iter().filter(|p| !p.series.is_empty()).collect()
        })
        .collect()
}

fn line(a: usize, points: Vec<(f64, f64)>, dots: bool) -> Series {
    Series { label: AXIS_NAMES[a].into(), points, colour: a, dots }
}

/// `true` if the time course identifies an effect of a class.
fn in_time(class: Class) -> bool {
    matches!(class, Class::Memory | Class::PowerOn | Class::Input | Class::Thermometer | Class::Event | Class::Own)
}

fn abscissa(class: Class) -> &'static str {
    match class {
        Class::Rate => "dT/dt [C/min]",
        Class::Shape | Class::Hysteresis => "resonator temperature [C]",
        _ => "time, one run after the other [h]",
    }
}

/// Abscissa for an effect of a class, on the blocks of an axis.
fn places(data: &Data<'_>, a: usize, class: Class) -> Vec<f64> {
    if in_time(class) {
        return data.axes[a].keep.iter().map(|k| (k * data.block_s) as f64 / 3600.0).collect();
    }
    let of = |s: (f64, f64)| if class == Class::Rate { s.1 } else { s.0 };
    data.states(a).into_iter().map(|s| s.map_or(f64::NAN, of)).collect()
}
