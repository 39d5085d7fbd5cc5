//! dong2023's Table 1 (measured): what the printed columns say of our curves.

use hrg_core::calibration::Calibration;
use hrg_identify::thermometer::curve::{fit_forward, fit_inverse};
use hrg_identify::thermometer::points::{report, Points};

fn table() -> Points {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/recordings/dong2023-table1.csv");
    Points::parse(&std::fs::read_to_string(path).expect("the table is in the repository")).expect("it is a table")
}

/// The printed T3 of Gx: roots of the forward cubic.
const T3_X: [f64; 10] = [-34.367, -24.696, -15.005, -4.994, 6.330, 16.125, 25.754, 35.418, 45.279, 55.128];

#[test]
fn roots_of_the_forward_cubic_are_the_printed_ones() {
    let p = table();
    let forward = fit_forward(&p.case_c[0], &p.frequency_hz[0], 3).expect("fits");
    let inverse = fit_inverse(&p.frequency_hz[0], &p.case_c[0], None, 3).expect("fits");
    for (f, printed) in p.frequency_hz[0].iter().zip(T3_X) {
        let t = forward.root_c(*f, f64::from(inverse.temperature_c(*f))).expect("converges");
        assert!((t - printed).abs() < 0.003, "{t} is not the printed {printed}");
    }
}

#[test]
fn the_centred_inverse_has_no_common_offset() {
    let p = table();
    for a in 0..3 {
        let curve = fit_inverse(&p.frequency_hz[a], &p.case_c[a], None, 3).expect("fits");
        let errors: Vec<f64> =
            p.frequency_hz[a].iter().zip(&p.case_c[a]).map(|(f, t)| f64::from(curve.temperature_c(*f)) - t).collect();
        assert!(errors.iter().all(|e| e.abs() < 0.035), "axis {a}: {errors:?}");
        let mean = errors.iter().sum::<f64>() / 10.0;
        assert!(mean.abs() < 0.001, "axis {a}: a common offset of {mean} C (the printed T4 has -0.022)");
    }
}

#[test]
fn single_precision_is_enough_when_centred() {
    let p = table();
    for a in 0..3 {
        let curve = fit_inverse(&p.frequency_hz[a], &p.case_c[a], None, 3).expect("fits");
        let c = curve.temperature_coefficients_c.map(f64::from);
        let (low, high) = (p.frequency_hz[a][0], p.frequency_hz[a][9]);
        for k in 0..=10_000 {
            let f = low + (high - low) * f64::from(k) / 10_000.0;
            let u = (f - curve.frequency_centre_hz) / f64::from(curve.frequency_scale_hz);
            let exact = ((c[3] * u + c[2]) * u + c[1]) * u + c[0];
            let error = (f64::from(curve.temperature_c(f)) - exact).abs();
            assert!(error < 2e-5, "axis {a} at {f} Hz: {error} C");
        }
    }
}

#[test]
fn the_compiled_in_laws_are_these_fits() {
    let p = table();
    for (a, axis) in Calibration::uncalibrated().axes.iter().enumerate() {
        let curve = fit_inverse(&p.frequency_hz[a], &p.case_c[a], None, 3).expect("fits");
        for f in &p.frequency_hz[a] {
            let (ours, fitted) = (axis.curve.temperature_c(*f), curve.temperature_c(*f));
            assert!((ours - fitted).abs() < 2e-5, "axis {a} at {f}: {ours} and {fitted}");
        }
    }
}

#[test]
fn both_left_overs_are_found_with_their_figures() {
    let r = report(&table()).expect("fits");
    let step = r.effects.iter().find(|e| e.name == "step").expect("the chamber's step");
    assert_eq!(step.parameters["after_chamber_c"], -10.0);
    assert_eq!(step.parameters["before_chamber_c"], 0.0);
    assert!(step.p_value < 0.01);
    for b in step.axes.values() {
        assert!(b.rms_after_c < b.rms_before_c / 3.0 && b.leave_one_out_after_c < b.leave_one_out_before_c / 2.0);
    }
    let common = r.effects.iter().find(|e| e.name == "timebase").expect("the common shape");
    assert!(common.p_value < 0.01);
    for b in common.axes.values() {
        assert!((0.010..0.017).contains(&b.rms_before_c) && b.rms_after_c < b.rms_before_c);
    }
    assert!(!common.indistinguishable_from.is_empty());
}

#[test]
fn the_report_has_the_keys_that_programs_read() {
    let report = report(&table()).expect("fits");
    let json = serde_json::to_value(&report).expect("JSON");
    let cubic = &json["fits"]["shell"]["x"]["inverse"][2];
    let keys: Vec<&String> = cubic.as_object().expect("a fit").keys().collect();
    assert_eq!(keys, ["coefficients", "degree", "leave_one_out_rms_c", "max_c", "residuals_c", "rms_c"]);
}
