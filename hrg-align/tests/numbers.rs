//! Any readings lead to a finite result or to a refusal, and nothing panics.

#[path = "../../hrg-core/tests/single/mod.rs"]
mod single;

use hrg_align::linear::Linear;
use hrg_align::session::Session;
use hrg_core::align_mode::Command;
use hrg_core::rate_path::Summary;
use proptest::prelude::*;
use single::single;

proptest! {
    #[test]
    fn an_alignment_of_any_readings_refuses_or_is_finite(
        begin in [single(), single(), single()],
        angle in single(),
        codes in proptest::collection::vec(any::<[i64; 2]>(), 1..40),
        samples in any::<u16>(),
    ) {
        let mut s: Session<Linear<f32>> = Session::IDLE;
        let [latitude_deg, gravity_mps2, velocity_noise_mps] = begin;
        let _ = s.command(Command::Expect { drift_dph: velocity_noise_mps, tilt_arcmin: gravity_mps2 });
        let _ = s.command(Command::Begin { latitude_deg, gravity_mps2, velocity_noise_mps });
        for (k, c) in codes.into_iter().enumerate() {
            match k {
                10 => drop(s.command(Command::TurnBegins)),
                14 => drop(s.command(Command::TurnEnded { angle_deg: angle })),
                30 => {
                    if let Some(trim) = s.command(Command::Accept) {
                        prop_assert!(trim.iter().all(|t| t.is_finite()));
                    }
                }
                _ => {}
            }
            let summary = Summary {
                step: k as u32,
                samples,
                raw_dph: [0.0; 3],
                corrected_dph: [0.0; 3],
                adc_errors: 0,
                accelerometer_codes: c.map(|c| c >> 20),
                accelerometer_saturated: false,
            };
            if let Some(r) = s.second(&summary) {
                let finite = r.azimuth_deg.is_finite() && r.azimuth_std_arcmin.is_finite();
                prop_assert!(r.refusal != 0 || finite, "{r:?}");
            }
        }
    }
}
