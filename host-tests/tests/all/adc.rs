//! The settings of the ADC against its data sheet, and against an ADC that carries them out.

use hrg_board::replay::{default_elf, read_elf};
use hrg_board::wires::Wires;
use hrg_core::adc::{ALL_CHANNELS, SETTINGS};
use hrg_data::recording::steps::Steps;
use hrg_study::faults::Scene;
use hrg_study::mutate::rebuilt;
use std::collections::BTreeMap;
use virtual_board::{Board, CPU_HZ};

/// Fields of the registers that a unit sets, as SBAS950 section 8.6 has them: register, name, highest bit, lowest bit, value, its meaning there. Typed from the sheet, not from our
/// constants.
const SHEET: [(u8, &str, u8, u8, u16, &str); 33] = [
    (0x02, "REGCRC_EN", 13, 13, 1, "a checksum of the register map"),
    (0x02, "RX_CRC_EN", 12, 12, 0, "commands without a checksum"),
    (0x02, "CRC_TYPE", 11, 11, 0, "16-bit CCITT"),
    (0x02, "RESET", 10, 10, 0, "the flag of a reset is cleared"),
    (0x02, "WLENGTH", 9, 8, 0b01, "24 bits"),
    (0x02, "TIMEOUT", 4, 4, 1, "SPI time-out on"),
    (0x02, "DRDY_SEL", 3, 2, 0b00, "most lagging enabled channel"),
    (0x02, "DRDY_HiZ", 1, 1, 0, "logic high when there are no data"),
    (0x02, "DRDY_FMT", 0, 0, 0, "logic low until data are read"),
    (0x03, "CH7_EN to CH0_EN", 15, 8, 0xFF, "all channels on"),
    (0x03, "XTAL_DIS", 7, 7, 0, "as after a reset"),
    (0x03, "EXTREF_EN", 6, 6, 0, "internal reference"),
    (0x03, "TBM", 5, 5, 0, "no turbo mode"),
    (0x03, "OSR", 4, 2, 0b011, "1024"),
    (0x03, "PWR", 1, 0, 0b10, "high resolution"),
    (0x04, "PGAGAIN3 to PGAGAIN0", 15, 0, 0, "1"),
    (0x05, "PGAGAIN7 to PGAGAIN4", 15, 0, 0, "1"),
    (0x06, "GC_DLY", 12, 9, 0b0011, "16 periods, as after a reset"),
    (0x06, "GC_EN", 8, 8, 0, "no global chop"),
    (0x06, "CD_ALLCH", 7, 7, 0, "as after a reset"),
    (0x06, "CD_NUM", 6, 4, 0, "as after a reset"),
    (0x06, "CD_LEN", 3, 1, 0, "as after a reset"),
    (0x06, "CD_EN", 0, 0, 0, "no current detection"),
    (0x07, "CD_TH_MSB", 15, 0, 0, "no threshold"),
    (0x08, "CD_TH_LSB", 15, 8, 0, "no threshold"),
    (0x08, "DCBLOCK", 3, 0, 0, "no filter"),
    // Of each channel, from 0x09 on.
    (0x09, "PHASE", 15, 6, 0, "no delay"),
    (0x09, "DCBLK_DIS", 2, 2, 1, "this channel has no filter either way"),
    (0x09, "MUX", 1, 0, 0b00, "the input pins"),
    (0x0A, "OCAL_MSB", 15, 0, 0, "no offset"),
    (0x0B, "OCAL_LSB", 15, 8, 0, "no offset"),
    (0x0C, "GCAL_MSB", 15, 0, 0x8000, "1"),
    (0x0D, "GCAL_LSB", 15, 8, 0, "1"),
];

#[test]
fn all_settings_are_those_of_the_data_sheet() {
    let mut expected = BTreeMap::<u8, u16>::new();
    for (register, _, high, low, value, _) in SHEET {
        assert!(value <= u16::MAX >> (15 - (high - low)));
        let channels = if register >= 0x09 { ALL_CHANNELS as u8 } else { 1 };
        for channel in 0..channels {
            *expected.entry(register + 5 * channel).or_default() |= value << low;
        }
    }
    let found: BTreeMap<u8, u16> = SETTINGS.into_iter().collect();
    assert_eq!(found.len(), 47);
    assert_eq!(found, expected);
}

#[test]
fn a_setting_with_which_no_adc_works_is_noticed() {
    let scene = Scene::new(&read_elf(&default_elf()).expect("built before"), 1).expect("a scene");
    // One setting is made wrong in the program itself: it reads back what it has written.
    let sent = |change: Option<(u8, u16)>| {
        let steps: Steps = scene.steps().clone();
        let wires = Wires::new(steps, scene.calibration.scale_factors_dph_per_code(), 20e-9, 1, None, None);
        let mut board = Board::new(scene.elf(), wires).expect("runs");
        board
            .write_flash(hrg_board::replay::CALIBRATION_A, &scene.calibration.to_bytes().expect("fits"))
            .expect("flash");
        if let Some((register, value)) = change {
            let at = rebuilt::setting(board.firmware(), register).expect("it is set");
            rebuilt::with(&mut board, at, &value.to_le_bytes()).expect("flash");
        }
        board.run_until(3 * CPU_HZ).map(|_| ()).map_err(|e| e.to_string()).map(|()| {
            let rates: Vec<_> = board
                .world
                .received
                .rates
                .iter()
                .map(|f| (f.sample, f.rate_dph.map(f32::to_bits), f.axis_status))
                .collect();
            rates
        })
    };
    let good = sent(None).expect("runs");
    assert!(good.len() > 500, "{}", good.len());
    // The control: a delay of the global chop, which is off.
    assert_eq!(sent(Some((0x06, 0x0800))).as_ref(), Ok(&good));
    // Another: the power mode, of which each is fast enough for a clock of 2.048 MHz (section 6.3).
    assert_eq!(sent(Some((0x03, 0xFF0C))).as_ref(), Ok(&good));
    for (register, value, what) in [
        (0x02, 0x2010, "16-bit words"),
        (0x02, 0x2210, "32-bit words"),
        (0x02, 0x2910, "the other checksum"),
        (0x02, 0x3110, "commands with a checksum"),
        (0x02, 0x2112, "DRDY let go"),
        (0x03, 0x000E, "all channels off"),
        (0x03, 0xFB0E, "one channel off"),
        (0x03, 0xFF4E, "an external reference"),
        (0x03, 0xFF12, "another oversampling"),
        (0x04, 0x0001, "another gain"),
        (0x09, 0x0006, "a test signal in the place of an input"),
        (0x0C, 0x9000, "another gain of calibration"),
        (0x0A, 0x0001, "an offset of calibration"),
    ] {
        let found = sent(Some((register, value)));
        assert_ne!(found.as_ref(), Ok(&good), "{what}: register {register:#04x} = {value:#06x} passes");
    }
}
