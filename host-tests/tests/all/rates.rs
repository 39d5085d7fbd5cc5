//! Scale factor and misalignment over temperature through the ELF: bit for bit what the desktop computes, and as good.

use hrg_board::replay;
use hrg_core::status::{AxisStatus, UnitStatus};
use hrg_data::recording::steps::Steps;
use hrg_identify::fit::correct;
use hrg_identify::rates::{bins_of, dwells, Bin};
use hrg_study::rates::{fly, left, Scene, SHORT};

#[test]
#[ignore = "cargo xtask test --rest"]
fn a_table_rate_is_corrected_as_on_the_desktop_bit_for_bit_and_what_is_left_is_noise() {
    let elf = replay::read_elf(&replay::default_elf()).expect("cargo xtask test builds the firmware first");
    let Scene { before, after, unseen } = Scene::new(6, &SHORT).expect("calibrated");
    let [r] = &unseen[..] else { panic!("one run") };
    let o = fly(&elf, &after, r).expect("runs");
    let received = &o.received;
    assert!(received.rates.len() > 200_000 && received.bad_frames == 0, "{}", received.rates.len());
    assert_eq!(received.differing, 0, "{:?}", received.first_difference);
    let last = received.housekeeping.last().expect("there are");
    assert_eq!((last.axis_status, last.unit_status), ([AxisStatus::empty(); 3], UnitStatus::empty()));
    // The unit's housekeeping against hrg correct, given the unit's own frequencies and raw rates.
    let seconds: Vec<correct::Second> = o.seconds_of_frames().iter().map(|s| s.unit).collect();
    let mut steps = Steps::new(r).expect("long enough");
    for a in 0..3 {
        steps.frequency_hz[a] = seconds.iter().map(|s| s.frequency_hz[a]).collect();
        steps.rate_dph[a] = seconds.iter().map(|s| f64::from(s.raw_dph[a])).collect();
    }
    let ours = correct::correct(&after, &steps);
    let differ = (1..seconds.len())
        .filter(|k| ours[*k].corrected_dph.map(f32::to_bits) != seconds[*k].corrected_dph.map(f32::to_bits));
    assert_eq!(differ.count(), 0);
    // Under an image without rates the ELF is what the desktop is, too: tests/elf.rs. So the desktop stands for it here.
    let worst = |bins: &[Bin]| {
        assert_eq!(bins.len(), 3);
        let cross = bins.iter().flat_map(|b| b.cross_urad).fold(0.0f64, |m, c| m.max(c.abs()));
        [bins.iter().fold(0.0f64, |m, b| m.max(b.scale_ppm.abs())), cross]
    };
    let before = worst(&bins_of(&dwells(r, &before, 0).expect("dwells"), 1));
    let after = worst(&left(&[(o, r)], &after, 1).expect("dwells"));
    println!(
        "scale factor {:.1} -> {:.2} ppm, misalignment {:.1} -> {:.2} urad",
        before[0], after[0], before[1], after[1]
    );
    assert!(before[0] > 150.0 && before[1] > 150.0, "{before:?}");
    // One visit of each axis: noise is in it. `cargo xtask rates` runs three at each temperature, and is within 5 ppm and 5 urad.
    assert!(after[0] < 5.0 && after[1] < 5.0, "{after:?}");
}
