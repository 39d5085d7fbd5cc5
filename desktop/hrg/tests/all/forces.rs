//! Accelerometers over temperature on simulated units, whose physics is not the curve that is fitted.

use hrg_core::calibration::Calibration;
use hrg_core::AXES;
use hrg_data::image_file;
use hrg_data::recording::Recording;
use hrg_identify::fit::prepare;
use hrg_identify::forces::{all_dwells, identify, recognise_positions, Found, CHAMBER, UG_OF_MPS2};
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
        assert!(refused.contains("give the image that the unit had"), "{refused}");
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
    assert!(worst[0] < 15.0 && worst[1] < 13.0, "{worst:?}");
    assert!(squares.iter().all(|s| (0.4..1.6).contains(&mean(s))));
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
    // Positions that the recording does not tell are seen in the specific forces.
    let mut untold = run.clone();
    untold.optional.retain(|(n, _)| !n.starts_with("table_force"));
    assert!(of(untold.clone()).contains("or give --gravity"));
    recognise_positions(&mut untold, 9.806_65).expect("seen");
    assert_eq!(untold.forces_mps2().expect("there")[1], run.forces_mps2().expect("there")[1]);
    assert!(recognise_positions(&mut untold, 1.0).expect_err("no gravity").0.contains("no place"));
    // A soak tells no slope over temperature.
    let f = identify(std::slice::from_ref(&run), &given(5)).expect("constants");
    assert!(f.notes.join("; ").contains("bias of x with T^3"), "{:?}", f.notes);
    // A fit of the gyros' bias does not take it.
    let e = prepare(&[run]).expect_err("refused").0;
    assert!(e.contains("hrg fit --accelerometers"), "{e}");
}
