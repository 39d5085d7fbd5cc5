//! Accelerometers over temperature through the ELF: bit for bit what the desktop computes, and as good.

use hrg_board::replay;
use hrg_identify::forces::{all_dwells, UG_OF_MPS2};
use hrg_identify::rates::{bins_of, Bin};
use hrg_study::forces::{fly, left, Scene, SHORT};

#[test]
#[ignore = "cargo xtask test --rest"]
fn specific_forces_are_corrected_as_on_the_desktop_bit_for_bit_and_what_is_left_is_small() {
    let elf = replay::read_elf(&replay::default_elf()).expect("cargo xtask test builds the firmware first");
    let Scene { before, after, unseen } = Scene::new(6, SHORT).expect("calibrated");
    let o = fly(&elf, &after, &unseen).expect("runs");
    let received = &o.received;
    assert!(received.increments.len() > 11_500 && received.bad_frames == 0, "{}", received.increments.len());
    assert_eq!(received.differing, 0, "{:?}", received.first_difference);
    let worst = |bins: &[Bin]| {
        assert_eq!(bins.len(), 3);
        let of = |value: &dyn Fn(&Bin) -> f64| bins.iter().fold(0.0f64, |m, b| m.max(value(b).abs()));
        let cross = of(&|b| b.cross_urad[0]).max(of(&|b| b.cross_urad[1]));
        [UG_OF_MPS2 * of(&|b| b.middle), of(&|b| b.scale_ppm), cross]
    };
    let by = |c| worst(&bins_of(&all_dwells(std::slice::from_ref(&unseen), &before, c).expect("dwells"), 1));
    let (raw, by_desktop) = (by(&before), by(&after));
    let by_unit = worst(&left(&o, &unseen, &after, 1).expect("dwells"));
    println!(
        "bias {:.0} -> {:.1} ug, scale factor {:.0} -> {:.1} ppm, misalignment {:.0} -> {:.1} urad",
        raw[0], by_unit[0], raw[1], by_unit[1], raw[2], by_unit[2]
    );
    assert!(raw[0] > 500.0 && raw[1] > 2000.0 && raw[2] > 300.0, "{raw:?}");
    // One visit of each axis: noise is in it.
    assert!(by_unit.iter().all(|v| *v < 17.0), "{by_unit:?}");
    // The unit's increments are of its samples, the desktop's of the seconds: beside each other by less than the noise.
    assert!(by_unit.iter().zip(by_desktop).all(|(u, d)| (u - d).abs() < 2.0), "{by_unit:?} {by_desktop:?}");
}
