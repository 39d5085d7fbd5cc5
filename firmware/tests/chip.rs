//! Tests on the chip itself, with nothing wired to it: `cargo xtask hil` runs them on a board by probe-rs, and on the virtual one.
#![no_std]
#![no_main]
// The macro of embedded-test asks for `rust_analyzer`.
#![allow(unexpected_cfgs)]

mod same;
// The loader starts the tests, too.
#[path = "../src/slot.rs"]
mod slot;

use defmt_rtt as _;

#[embedded_test::tests]
mod tests {
    use super::same;
    use embassy_stm32::pac;
    use embassy_stm32::pac::iwdg::vals::{Key, Pr};

    /// The loader has started the watchdog, which no test feeds: it gets its longest time, 32 s.
    #[init]
    fn patience() {
        pac::IWDG.kr().write(|w| w.set_key(Key::ENABLE));
        pac::IWDG.pr().write(|w| w.set_pr(Pr::DIVIDE_BY256));
        pac::IWDG.rlr().write(|w| w.set_rl(0xFFF));
        while pac::IWDG.sr().read().0 != 0 {}
        pac::IWDG.kr().write(|w| w.set_key(Key::RESET));
    }

    /// The chip computes the models that were calibrated on a desktop.
    #[test]
    fn models_give_the_same_bits_as_on_a_desktop() {
        for (name, image, expected) in same::IMAGES {
            let found = same::model(image);
            defmt::info!("{=str}: {=u32:08x}, expected {=u32:08x}", name, found.unwrap_or(0), expected);
            assert!(found == Some(expected));
        }
    }

    #[test]
    fn functions_give_the_same_bits_as_on_a_desktop() {
        let found = same::functions();
        defmt::info!("{=u32:08x}, expected {=u32:08x}", found, same::FUNCTIONS);
        assert!(found == same::FUNCTIONS);
    }

    #[test]
    fn frequencies_have_the_same_bits_as_on_a_desktop() {
        let found = same::edges();
        defmt::info!("{=u32:08x}, expected {=u32:08x}", found, same::EDGES);
        assert!(found == same::EDGES);
    }

    /// The chip is the one that the program is built for: DBGMCU_IDCODE (RM0390 section 33.6.1; RM0090 section 38.6.1).
    #[test]
    fn the_chip_is_the_right_one() {
        let expected = if cfg!(feature = "stm32f446re") { 0x421 } else { 0x413 };
        let found = pac::DBGMCU.idcode().read().dev_id();
        defmt::info!("device {=u16:x}, expected {=u16:x}", found, expected);
        assert!(found == expected);
    }

    /// The CRC unit, which the program checks itself with, computes what the desktop writes as integrity word: CRC-32/MPEG-2 of words.
    #[test]
    fn the_crc_unit_knows_its_check_value() {
        pac::RCC.ahb1enr().modify(|w| w.set_crcen(true));
        let _ = pac::RCC.ahb1enr().read();
        pac::CRC.cr().write(|w| w.set_reset(true));
        // "12345678", whose sum is known from elsewhere.
        pac::CRC.dr().write_value(0x3132_3334);
        pac::CRC.dr().write_value(0x3536_3738);
        let found = pac::CRC.dr().read();
        defmt::info!("{=u32:08x}", found);
        assert!(found == same::crc_32_mpeg_2(b"12345678"));
    }

    /// Every task relies on it: a division by zero gives infinity, and numbers below the least normal one stay what they are.
    #[test]
    fn floating_point_follows_ieee_754() {
        let one = core::hint::black_box(1.0f32);
        let zero = core::hint::black_box(0.0f32);
        let least = core::hint::black_box(f32::MIN_POSITIVE);
        let infinite = one / zero;
        assert!(infinite == f32::INFINITY && (infinite * zero).is_nan());
        assert!(least / 4.0 * 4.0 == least && least / 4.0 > 0.0);
        // To the nearest even: 1 + 2^-24 is 1, 1 + 3 * 2^-24 is 1 + 2^-22.
        assert!(one + f32::EPSILON / 2.0 == 1.0 && one + 1.5 * f32::EPSILON == 1.0 + 2.0 * f32::EPSILON);
    }
}
