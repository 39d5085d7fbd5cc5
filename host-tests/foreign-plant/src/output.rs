//! Logger's output of a run.

use crate::case::AXES;
use crate::draw::stream;
use crate::making::Making;
use crate::noise;
use crate::physics::thermometer;
use crate::plan::Followed;
use crate::recording::{Column, Recording};
use crate::sensors::Sensor;
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// Rate of the earth's rotation, deg/h.
const EARTH_DPH: f64 = 15.041_07;
/// Latitude of the laboratory, deg.
const LATITUDE_DEG: f64 = 28.2;
/// Flicker of the frequency over its white noise, in 100 s means.
const FREQUENCY_FLICKER: f64 = 0.2;

/// The recording of run number `k`.
pub(crate) fn record(making: &Making<'_>, k: usize) -> Recording {
    let mut rng = stream(making.seed, &[&making.case.name, "logger", &k.to_string()]);
    let layout = &making.case.layout;
    let mut columns = Vec::new();
    let offset_s = if layout.shuffled { 86_400.0 } else { 0.0 };
    if !layout.untimed {
        columns.push(sampled(
            making,
            k,
            "time_s".into(),
            usize::from(layout.row_s < 1.0),
            &making.worlds[k].time_s,
            offset_s,
        ));
    }
    thermometers(making, k, &mut rng, &mut columns);
    rates(making, k, &mut columns);
    others(making, k, &mut rng, &mut columns);
    if layout.shuffled {
        columns.rotate_left(3);
        let rows = columns[0].values.len();
        columns.push(Column {
            name: "operator_note_7".into(),
            decimals: 0,
            values: (0..rows).map(|i| (i % 7) as f64).collect(),
        });
    }
    Recording { metadata: metadata(making, k, offset_s), columns, crlf: false, invalid: "" }
}

fn metadata(making: &Making<'_>, k: usize, offset_s: f64) -> Vec<(String, String)> {
    let layout = &making.case.layout;
    let mut out: Vec<(String, String)> = Vec::new();
    let mut put = |key: &str, value: String| out.push((key.to_owned(), value));
    put("hrg-recording", "1".into());
    put("unit", format!("HRG-{}", making.unit.serial));
    put("run", format!("chamber-{}", k + 1));
    put("rate_unit", "deg/h".into());
    let frequency = layout.followed == Followed::Resonator;
    put("thermometer", if frequency { "frequency" } else { "sensor" }.into());
    if layout.earth {
        put("latitude_deg", format!("{LATITUDE_DEG}"));
        put("axes", "x=north y=east z=down".into());
    }
    put("power_on_s", format!("{offset_s}"));
    if layout.untimed {
        put("time_step_s", format!("{}", layout.row_s));
    }
    out
}

/// The logged part of `x`, row by row, with `plus` added.
fn sampled(making: &Making<'_>, k: usize, name: String, decimals: usize, x: &[f64], plus: f64) -> Column {
    let w = &making.worlds[k];
    let each = (making.case.layout.row_s / w.dt_s).round().max(1.0) as usize;
    Column { name, decimals, values: x[w.first..].iter().step_by(each).map(|x| x + plus).collect() }
}

fn thermometers(making: &Making<'_>, k: usize, rng: &mut ChaCha8Rng, columns: &mut Vec<Column>) {
    let layout = &making.case.layout;
    let dt_s = making.worlds[k].dt_s;
    match layout.followed {
        Followed::Resonator => {
            for &a in &layout.axes {
                let hz = frequency(making, k, a, rng);
                columns.push(sampled(making, k, format!("f{}_hz", AXES[a]), 7, &hz, 0.0));
            }
        }
        Followed::Case => {
            for &a in &layout.axes {
                let read = making.unit.sensors[a].read(rng, &making.indicated[k][a], dt_s);
                columns.push(sampled(making, k, format!("temp_{}_c", AXES[a]), 4, &read, 0.0));
            }
        }
        Followed::Base => {
            let read = making.unit.sensors[0].read(rng, &making.indicated[k][0], dt_s);
            columns.push(sampled(making, k, "temp_c".into(), 4, &read, 0.0));
        }
    }
}

/// Frequency of axis `a` as counted, Hz.
fn frequency(making: &Making<'_>, k: usize, a: usize, rng: &mut ChaCha8Rng) -> Vec<f64> {
    let unit = &making.unit;
    let dt_s = making.worlds[k].dt_s;
    let white = unit.frequency_noise_hz[a] / dt_s.sqrt();
    let t_c = &making.indicated[k][a];
    let flicker = noise::correlated(rng, t_c.len(), dt_s, |f| 1.0 / f);
    let step = making.case.layout.frequency_step_hz;
    t_c.iter()
        .zip(flicker)
        .map(|(&t, flicker)| {
            let noise: f64 = StandardNormal.sample(rng);
            let hz = unit.curves[a].hz(t) + white * (noise + FREQUENCY_FLICKER * flicker);
            if step > 0.0 {
                (hz / step).round() * step
            } else {
                hz
            }
        })
        .collect()
}

/// Rates: a row holds the mean since the row before.
fn rates(making: &Making<'_>, k: usize, columns: &mut Vec<Column>) {
    let layout = &making.case.layout;
    let w = &making.worlds[k];
    let each = (layout.row_s / w.dt_s).round().max(1.0) as usize;
    let (sin, cos) = LATITUDE_DEG.to_radians().sin_cos();
    let earth = if layout.earth { [EARTH_DPH * cos, 0.0, -EARTH_DPH * sin] } else { [0.0; 3] };
    for &a in &layout.axes {
        let values = making.rates[k][a][w.first..]
            .chunks(each)
            .map(|c| c.iter().sum::<f64>() / c.len() as f64 + earth[a])
            .collect();
        columns.push(Column { name: format!("rate_{}_dph", AXES[a]), decimals: 5, values });
    }
}

/// Case sensors, chamber, board, and electrical quantities.
fn others(making: &Making<'_>, k: usize, rng: &mut ChaCha8Rng, columns: &mut Vec<Column>) {
    let layout = &making.case.layout;
    let w = &making.worlds[k];
    if layout.cases && layout.followed == Followed::Resonator {
        for &a in &layout.axes {
            let mut body = w.case_c[a].clone();
            if layout.loose_case_x && a == 0 && k == 0 {
                let mut draw = crate::draw::Draw::new(making.seed, &making.case.name, 0, a, k);
                let error = thermometer::loose_sensor(&mut draw, w, a);
                body.iter_mut().zip(error).for_each(|(t, e)| *t += 0.5 * e);
            }
            let read = making.unit.sensors[a].read(rng, &body, w.dt_s);
            let name = if layout.old_names { "shell" } else { "case" };
            columns.push(sampled(making, k, format!("{name}_{}_c", AXES[a]), 4, &read, 0.0));
        }
    }
    let probe = |step_c: f64, noise_c: f64| Sensor { offset_c: 0.0, gain_error: 0.0, lag_s: 10.0, step_c, noise_c };
    if layout.chamber {
        let read = probe(0.01, 0.02).read(rng, &w.air_c, w.dt_s);
        columns.push(sampled(making, k, "chamber_c".into(), 2, &read, 0.0));
    }
    if layout.board {
        let read = probe(0.05, 0.05).read(rng, &w.board_c, w.dt_s);
        columns.push(sampled(making, k, "board_c".into(), 2, &read, 0.0));
    }
    if layout.electrics {
        let mut noisy = |x: &[f64], volts: f64| -> Vec<f64> {
            x.iter().map(|x| x + volts * (rng.random::<f64>() + rng.random::<f64>() - 1.0)).collect()
        };
        let supply = noisy(&w.supply_v, 0.002);
        columns.push(sampled(making, k, "supply_v".into(), 4, &supply, 0.0));
        for &a in &layout.axes {
            let (drive, quad) = (noisy(&w.drive_v[a], 0.0008), noisy(&w.quad_v[a], 0.0008));
            columns.push(sampled(making, k, format!("drive_{}_v", AXES[a]), 4, &drive, 0.0));
            columns.push(sampled(making, k, format!("quad_{}_v", AXES[a]), 4, &quad, 0.0));
        }
    }
}
