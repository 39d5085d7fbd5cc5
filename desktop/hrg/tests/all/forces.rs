//! Accelerometers over temperature on simulated units, whose physics is not the curve that is fitted.

use hrg_core::calibration::Calibration;
use hrg_core::AXES;
use hrg_data::image_file;
use hrg_data::recording::Recording;
use hrg_identify::fit::prepare;
use hrg_identify::forces::{all_dwells, identify, Found, CHAMBER, UG_OF_MPS2};
use hrg_identify::rates::bins;
use hrg_simulate::positions::Accelerometers;
use hrg_simulate::{Plan, Profile};

/// A calibration whose temperatures are those of the simulator.
fn given(unit: u64) -> Calibration {
    let mut c = Calibration::uncalibrated();
    c.set_unit_name(&format!("SIM-{unit}"));
    c
}

/// As a file with it is after reading.
fn positioned(unit: u64, seed: u64, profile: &str) -> Recording {
    let plan = Plan::of(Profile::parse(profile).expect("fine"), unit, seed);
    let r = Plan { positions: true, ..plan }.simulate().recording;
    let mut read = Recording::parse(r.to_csv().as_bytes()).expect("readable");
    read.clean().expect("usable");
    read
}

fn found(unit: u64) -> Found {
    identify(&[positioned(unit, 50 + unit, CHAMBER)], &given(unit)).expect("fits")
}

/// Largest of bias (ug), scale factor (ppm) and misalignment (urad) that are left of a run.
fn left(r: &Recording, recorded_by: &Calibration, c: &Calibration) -> [f64; 3] {
    let all = bins(&all_dwells(std::slice::from_ref(r), recorded_by, c).expect("usable"));
    assert!(all.len() >= 9, "{}", all.len());
    let largest =
        |values: &dyn Fn(&hrg_identify::rates::Bin) -> f64| all.iter().map(|b| values(b).abs()).fold(0.0, f64::max);
    [
        UG_OF_MPS2 * largest(&|b| b.middle),
        largest(&|b| b.scale_ppm),
        largest(&|b| b.cross_urad[0]).max(largest(&|b| b.cross_urad[1])),
    ]
}

#[test]
fn milli_g_become_micro_g_on_a_run_that_the_fit_never_saw() {
    for unit in [3, 8] {
        let after = found(unit).calibration;
        // Other temperatures, other ramps, other noise.
        let unseen = positioned(unit, 70 + unit, "25,52@0.7,3h,-5@0.5,3h,-33@0.6,3h,25@0.15");
        let (was, is) = (left(&unseen, &given(unit), &given(unit)), left(&unseen, &given(unit), &after));
        println!(
            "unit {unit}: bias {:.0} -> {:.1} ug, scale factor {:.0} -> {:.1} ppm, misalignment {:.0} -> {:.1} urad",
            was[0], is[0], was[1], is[1], was[2], is[2]
        );
        assert!(was[0] > 500.0 && was[1] > 3000.0 && was[2] > 300.0, "{was:?}");
        assert!(is.iter().all(|v| *v < 17.0), "{is:?}");
        // A unit with that image records corrected values: the fit and the figures are those of the raw values.
        let mut flown = unseen.clone();
        flown.meta.push(("calibration".into(), format!("{:08x}", after.checksum())));
        let steps = hrg_data::recording::steps::Steps::new(&flown).expect("long enough");
        let errors = hrg_identify::fit::correct::specific_forces(&after, &steps);
        let raw = unseen.forces_mps2().expect("there")[0].map(<[f64]>::to_vec);
        for (name, values) in &mut flown.optional {
            let Some(a) = (0..AXES).find(|a| hrg_data::recording::columns::FORCE.name(*a) == *name) else { continue };
            for (k, v) in values.iter_mut().enumerate() {
                let one = [0, 1, 2].map(|a: usize| raw[a][k] as f32);
                *v = errors[k].factors.corrected_dph(one, errors[k].bias_mps2)[a].into();
            }
        }
        let again = left(&flown, &after, &given(unit));
        assert!(again.iter().zip(was).all(|(a, w)| (a - w).abs() < 0.5), "{again:?} {was:?}");
        let refused = all_dwells(&[flown], &given(unit), &after).expect_err("another image").0;
        assert!(refused.contains("give that image"), "{refused}");
    }
}

#[test]
fn curves_are_as_near_the_truth_as_stated() {
    let (mut worst, mut squares) = ([0.0f64; 2], [Vec::new(), Vec::new()]);
    let simulated = Calibration::uncalibrated();
    for unit in 20..32 {
        let f = found(unit);
        let truth = Accelerometers::of(unit);
        for a in 0..AXES {
            for t in [-38.0, -27.0, -3.0, 22.0, 47.0, 58.0] {
                let reading = simulated.axes[a].curve.frequency_hz(t).expect("in range");
                let t_unit = f64::from(f.calibration.axes[a].curve.temperature_c(reading));
                let (bias, std) = f.bias_at(a, t_unit);
                // (The square of one g is in the bias.)
                let error = UG_OF_MPS2 * (bias - truth.bias_in_positions_mps2(a, t));
                worst[0] = worst[0].max(error.abs());
                squares[0].push((error / (UG_OF_MPS2 * std)).powi(2));
                let (ppm, std) = f.factors[a].scale_at(&f.calibration.scaling, t_unit, 0.0);
                let error = ppm - 1e6 * (1.0 / truth.scale_factor(a, t) - 1.0);
                worst[1] = worst[1].max(error.abs());
                squares[1].push((error / std).powi(2));
            }
        }
        // As text and back.
        let text = image_file::to_text(&f.calibration);
        assert_eq!(image_file::from_text(&text).expect("readable").to_bytes(), f.calibration.to_bytes());
    }
    let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
    println!(
        "within {:.1} ug and {:.1} ppm of the truth, -38 to 58 C; z^2 {:.2} and {:.2}",
        worst[0],
        worst[1],
        mean(&squares[0]),
        mean(&squares[1])
    );
    assert!(worst[0] < 15.0 && worst[1] < 14.0, "{worst:?}");
    assert!(squares.iter().all(|s| (0.4..2.2).contains(&mean(s))));
}

#[test]
fn runs_that_say_too_little_are_refused_in_a_sentence() {
    let of = |r: Recording| identify(&[r], &given(5)).expect_err("refused").0;
    let run = positioned(5, 6, "20,2h");
    let mut no_forces = run.clone();
    no_forces.optional.retain(|(n, _)| !n.starts_with("force"));
    assert!(of(no_forces).contains("lacks force_?_mps2"));
    // Never down.
    let mut up = run.clone();
    for (name, values) in &mut up.optional {
        if *name == "table_force_z_mps2" {
            values.iter_mut().filter(|v| **v < 0.0).for_each(|v| *v = f64::NAN);
        }
    }
    assert!(of(up).contains("axis z was not held both up and down"));
    // A soak tells no slope over temperature.
    let f = identify(std::slice::from_ref(&run), &given(5)).expect("constants");
    assert!(f.notes.join("; ").contains("bias of x with T^3"), "{:?}", f.notes);
    // A fit of the gyros' bias does not take it.
    let e = prepare(&[run]).expect_err("refused").0;
    assert!(e.contains("hrg fit --accelerometers"), "{e}");
}

/// Rows of a position of the simulated round.
const BLOCK: usize = 82;

/// A column.
fn column<'a>(r: &'a mut Recording, name: &str) -> &'a mut Vec<f64> {
    &mut r.optional.iter_mut().find(|(n, _)| *n == name).expect("there").1
}

/// Names of specific forces and positions, axis by axis.
const NAMES: [[&str; 3]; 2] = [
    ["force_x_mps2", "force_y_mps2", "force_z_mps2"],
    ["table_force_x_mps2", "table_force_y_mps2", "table_force_z_mps2"],
];

/// A run as a laboratory makes it: another order of positions, turns that take time, knocks, rows that are lost.
#[test]
fn order_turns_knocks_and_lost_rows_change_little() {
    let soak = positioned(5, 6, "20,6h");
    let clean = identify(std::slice::from_ref(&soak), &given(5)).expect("fits");
    let mut real = soak.clone();
    let rows = real.time_s.len() / (6 * BLOCK) * 6 * BLOCK;
    for name in NAMES.as_flattened() {
        let values = column(&mut real, name);
        let old = values.clone();
        for round in (0..rows).step_by(6 * BLOCK) {
            // Each axis up, then each axis down.
            for (to, from) in [0, 2, 4, 1, 3, 5].into_iter().enumerate() {
                let (to, from) = (round + to * BLOCK, round + from * BLOCK);
                values[to..to + BLOCK].copy_from_slice(&old[from..from + BLOCK]);
            }
        }
        // Four seconds of turning between two positions.
        for start in (BLOCK..rows).step_by(BLOCK) {
            let (before, after) = (values[start - 1], values[start + 4]);
            for k in 0..4 {
                values[start + k] = before + (after - before) * (k as f64 + 0.5) / 4.0;
            }
        }
    }
    for k in (40..rows).step_by(5 * BLOCK) {
        column(&mut real, "force_x_mps2")[k] *= 2.0;
        column(&mut real, "force_z_mps2")[k + 3] += 1.0;
    }
    let kept: Vec<usize> = (0..real.time_s.len()).filter(|k| k % 61 != 7).collect();
    let keep = |v: &mut Vec<f64>| *v = kept.iter().filter_map(|k| v.get(*k).copied()).collect();
    keep(&mut real.time_s);
    real.frequency_hz.iter_mut().chain(&mut real.rate_dph).for_each(keep);
    real.optional.iter_mut().for_each(|(_, v)| keep(v));
    let found = identify(&[real], &given(5)).expect("fits");
    for a in 0..AXES {
        let t = clean.dwells[clean.dwells.len() - 1].temperature_c[a];
        let (bias, scale) = (UG_OF_MPS2 * (found.bias_at(a, t).0 - clean.bias_at(a, t).0), |f: &Found| {
            f.factors[a].scale_at(&f.calibration.scaling, t, 0.0).0
        });
        let (ppm, urad) =
            (scale(&found) - scale(&clean), |f: &Found| f.factors[a].misalignment_at(&f.calibration.scaling, 0, t).0);
        println!("{a}: {bias:.2} ug, {ppm:.2} ppm, {:.2} urad", urad(&found) - urad(&clean));
        assert!(bias.abs() < 2.0 && ppm.abs() < 4.0 && (urad(&found) - urad(&clean)).abs() < 3.0);
    }
}

#[test]
fn two_runs_are_no_worse_than_one() {
    let unseen = positioned(3, 73, "25,52@0.7,3h,-5@0.5,3h,-33@0.6,3h,25@0.15");
    let runs = [53, 54].map(|seed| positioned(3, seed, CHAMBER));
    let of = |runs: &[Recording]| left(&unseen, &given(3), &identify(runs, &given(3)).expect("fits").calibration);
    let (one, two) = (of(&runs[..1]), of(&runs));
    println!("one run {one:.1?}, two runs {two:.1?}");
    assert!(two.iter().zip(one).all(|(two, one)| *two < 1.1 * one + 1.0), "{two:?} {one:?}");
}

#[test]
fn a_wrong_sign_order_or_unit_is_told_by_its_axis() {
    let run = positioned(5, 6, "20,2h");
    let of = |change: &dyn Fn(&mut Recording)| {
        let mut r = run.clone();
        change(&mut r);
        identify(&[r], &given(5)).expect_err("refused").0
    };
    let scaled =
        |name: &'static str, by: f64| move |r: &mut Recording| column(r, name).iter_mut().for_each(|v| *v *= by);
    let sign = of(&scaled("force_y_mps2", -1.0));
    assert!(sign.contains("accelerometer y gives -1.0") && sign.contains("look at the sign"), "{sign}");
    let unit = of(&|r| NAMES[0].iter().for_each(|name| scaled(name, 1.0 / 9.806_65)(r)));
    assert!(unit.contains("accelerometer x gives 0.10"), "{unit}");
    let order = of(&|r| {
        let x = column(r, "force_x_mps2").clone();
        let y = std::mem::replace(column(r, "force_y_mps2"), x);
        *column(r, "force_x_mps2") = y;
    });
    assert!(order.contains("accelerometer x gives 0.00") || order.contains("accelerometer x gives -0.00"), "{order}");
}
