//! Whatever numbers come in, what goes out is finite or flagged, and nothing panics: every function of the unit that takes a
//! number, over all bit patterns and the corners among them.

mod single;

use hrg_core::bias::four_parameter::FourParameter;
use hrg_core::bias::{Coefficients, Scaling, State, TERMS};
use hrg_core::calibration::{Calibration, EffectTerm};
use hrg_core::compensator::Compensator;
use hrg_core::effects::{shape, Inputs, Reach, Running, ALL, MAX_OUTPUTS};
use hrg_core::frequency::StepFrequencies;
use hrg_core::inputs::Quantities;
use hrg_core::link::{Housekeeping, Message};
use hrg_core::output::OutputSettings;
use hrg_core::rate_of_change::{Difference, SlopeWindow};
use hrg_core::rate_path::{PendingBias, RatePath};
use hrg_core::status::AxisStatus;
use hrg_core::thermal::{AxisThermal, Thermal};
use hrg_core::timebase::Timebase;
use proptest::prelude::*;
use single::{single, CORNERS};

/// The same for doubles; frequencies of resonators among them.
fn double() -> impl Strategy<Value = f64> {
    prop_oneof![single().prop_map(f64::from), any::<u64>().prop_map(f64::from_bits), 4600f64..5000.0]
}

fn frequency() -> impl Strategy<Value = Option<f64>> {
    proptest::option::weighted(0.8, double())
}

/// A calibration with any numbers; about half of them are such as a unit accepts.
fn calibration() -> impl Strategy<Value = Calibration> {
    let number = prop_oneof![1 => single(), 100 => -1e7f32..1e7, 300 => -10f32..10.0];
    let effects = proptest::sample::subsequence((0..ALL.len()).collect::<Vec<_>>(), 0..4);
    (proptest::collection::vec(number, 64), effects, 0..5u8).prop_map(|(n, effects, kind)| {
        let mut c = Calibration::uncalibrated();
        c.calibrated = true;
        let six: [f32; TERMS] = std::array::from_fn(|k| n[k]);
        for a in &mut c.axes {
            a.coefficients = match kind {
                0 => Coefficients::One(six),
                1 => Coefficients::CoolingHeating(six, std::array::from_fn(|k| n[6 + k])),
                2 => Coefficients::FourParameter(FourParameter {
                    constant_cooling_heating_low_high: std::array::from_fn(|k| n[k]),
                    breakpoint_c: n[12],
                    origin_c: n[13],
                }),
                3 => Coefficients::Direct(std::array::from_fn(|k| n[k])),
                _ => Coefficients::Network(std::array::from_fn(|k| n[k % 64])),
            };
            a.curve.frequency_scale_hz = n[14].abs();
            a.curve.temperature_coefficients_c = std::array::from_fn(|k| n[15 + k]);
            a.scale_factor_dph_per_code = n[19];
            (a.valid_from_c_per_min, a.valid_to_c_per_min) = (-n[20].abs(), n[20].abs());
        }
        c.scaling.t_ref_c = n[21].clamp(-300.0, 300.0);
        c.scaling.t_scale_c = n[22].abs().clamp(0.1, 1000.0);
        (c.scaling.linear_below_c, c.scaling.linear_above_c) = (-n[23].abs(), n[24].abs());
        c.scaling.linear_beyond_c_per_min = n[25].abs();
        c.scaling.blend_band_c_per_min = n[26].abs();
        for e in effects.into_iter().filter(|e| ALL[*e].reach == Reach::Unit) {
            let gains = std::array::from_fn(|a| std::array::from_fn(|k| n[27 + (a * MAX_OUTPUTS + k) % 30]));
            // (Widths and time constants above zero: others are refused.)
            let positive = shape(ALL[e].id).expect("in the list").positive;
            let parameters =
                std::array::from_fn(|k| if positive[k] { n[57 + k].abs().max(f32::MIN_POSITIVE) } else { n[57 + k] });
            let _ = c.effects.push(EffectTerm { gains, gain_std: gains, ..EffectTerm::new(ALL[e].id, parameters) });
        }
        c
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, ..ProptestConfig::default() })]

    #[test]
    fn any_accepted_image_with_any_frequencies_gives_finite_biases(
        c in calibration(),
        steps in proptest::collection::vec([frequency(), frequency(), frequency()], 1..60),
    ) {
        prop_assume!(c.check().is_ok());
        let mut unit = Compensator::new(c, 0.0);
        for frequency_hz in steps {
            let step = StepFrequencies { step: 0, end_ticks: 0, frequency_hz, rejected: [0; 3], missing: [0; 3] };
            let out = unit.update(&step);
            for k in 0..3 {
                prop_assert!(out.bias_dph[k].is_finite(), "{out:?}");
                // Not known is not good.
                prop_assert!(out.temperature_c[k].is_finite() || !out.status[k].is_empty(), "{out:?}");
            }
            let h = Housekeeping::new(&step, &out, None, Timebase::REFERENCE);
            let wire = Message::Housekeeping(h).encode();
            prop_assert!(Message::decode(&wire[..wire.len() - 1]).is_ok());
        }
    }

    #[test]
    fn every_effect_with_any_inputs_does_not_panic(
        which in 0..ALL.len(),
        p in [single(), single()],
        step_s in single(),
        inputs in proptest::collection::vec(
            ([single(), single(), single()], single(), single(), single(), [single(), single(), single()]),
            1..20,
        ),
    ) {
        let scaling =
            Scaling { t_ref_c: 10.0, t_scale_c: 45.0, linear_below_c: -60.0, linear_above_c: 80.0, linear_beyond_c_per_min: 10.0, blend_band_c_per_min: 0.1 };
        let mut effect = Running::new(ALL[which].id, &p, step_s).expect("in the list");
        for (temperatures, ramp_c_per_min, frequency_u, time_s, o) in inputs {
            let axes = temperatures.map(|temperature_c| {
                let state = State {
                    temperature_c,
                    ramp_c_per_min,
                    difference_c_per_min: ramp_c_per_min,
                    frequency_u,
                    frequency_u_per_min: ramp_c_per_min,
                };
                AxisThermal { state, known: o[1] > 0.0, age: 0, settled: true }
            });
            let thermal = Thermal { axes, time_s };
            for axis in 0..3 {
                let quantities = &Quantities::new(core::array::from_fn(|k| o[k % 3]));
                let _ = effect.step(&Inputs { scaling: &scaling, thermal: &thermal, axis, quantities });
            }
        }
    }

    #[test]
    fn bias_models_and_laws_with_any_numbers_do_not_panic(c in calibration(), n in [single(), single(), single(), single(), single()]) {
        let state = State {
            temperature_c: n[0],
            ramp_c_per_min: n[1],
            difference_c_per_min: n[2],
            frequency_u: n[3],
            frequency_u_per_min: n[4],
        };
        for a in &c.axes {
            let _ = a.coefficients.bias_dph(&c.scaling, &state);
            let _ = (a.curve.value_and_slope(n[0]), a.curve.normalised(f64::from(n[1])), a.curve.frequency_hz(f64::from(n[2])));
        }
    }

    #[test]
    fn windows_with_any_values_do_not_panic(
        values in proptest::collection::vec(proptest::option::weighted(0.8, single()), 0..200),
    ) {
        let (mut w, mut d) = (SlopeWindow::default(), Difference::default());
        for v in values {
            prop_assert!(w.push(v).is_finite());
            let _ = d.push(v.unwrap_or(0.0));
        }
    }

    #[test]
    fn any_codes_with_any_bias_give_a_finite_or_flagged_rate(
        scale in prop_oneof![-1e7f32..1e7, -1f32..1.0],
        bias in [single(), single(), single()],
        codes in proptest::collection::vec(any::<[i32; 6]>(), 1..100),
        decimation in prop_oneof![0u16..8, any::<u16>()],
        increments in 0u16..8,
    ) {
        let decimation = decimation.clamp(1, 1000);
        let settings = OutputSettings { decimation, increments, ..OutputSettings::default() };
        let mut p = RatePath::new(Timebase::REFERENCE, [scale; 3], decimation).with_output(settings, 3);
        // The pending bias of the compensator is finite: see above.
        p.set_bias(PendingBias::at(0, 1, bias.map(|b| if b.is_finite() { b } else { 0.0 }), [AxisStatus::empty(); 3]));
        for (k, c) in codes.into_iter().enumerate() {
            // An ADC has 24 bits.
            let e = p.sample(90_000 * k as u32, c.map(|c| c >> 8));
            prop_assert!(!e.corrupted);
            if e.increments {
                let f = p.increments();
                let finite = f.angle_rad.iter().zip(f.axis_status).all(|(a, s)| a.is_finite() || !s.is_empty());
                prop_assert!(finite, "{f:?}");
            }
            if let Some(f) = e.frame {
                for a in 0..3 {
                    prop_assert!(f.rate_dph[a].is_finite() || !f.axis_status[a].is_empty(), "{f:?}");
                }
                let wire = Message::Rate(f).encode();
                prop_assert!(Message::decode(&wire[..wire.len() - 1]).is_ok());
            }
        }
    }
}

#[test]
fn the_corners_of_every_single_go_through_the_rate_path_and_the_law() {
    // Each pair of corners, and each exponent with the smallest and largest mantissa: not left to chance.
    let exponents = (0..256u32).flat_map(|e| [e << 23, e << 23 | 0x7F_FFFF, e << 23 | 1 << 31]);
    let all: Vec<f32> = CORNERS.into_iter().chain(exponents.map(f32::from_bits)).collect();
    let c = Calibration::uncalibrated();
    for &a in &all {
        for &b in &CORNERS {
            let mut unit = Compensator::new(c.clone(), 0.0);
            for f in [Some(f64::from(a)), Some(f64::from(b)), Some(4900.0), None, Some(f64::from(a))] {
                let out = unit.step(&[f, f, Some(4703.0)]);
                assert!(out.bias_dph.iter().all(|b| b.is_finite()), "{a} {b}");
            }
        }
    }
}
