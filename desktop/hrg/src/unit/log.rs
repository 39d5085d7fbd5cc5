//! Lines of the unit's log as seconds of its link.

use crate::unit::record::Second;
use hrg_core::link::Housekeeping;
use hrg_core::status::{AxisStatus, UnitStatus};

/// The second that a log line tells, as the link would; what a log does not carry is zero, or not a number. `None` if the line
/// is not one of a second.
#[must_use]
pub fn housekeeping_of_line(line: &str) -> Option<Housekeeping> {
    let s = Second::from_log(line)?;
    let value =
        |key: &str| line.split_whitespace().filter_map(|t| t.split_once('=')).find(|(k, _)| *k == key).map(|t| t.1);
    let number = |key: &str| value(key).and_then(|v| v.parse::<u32>().ok()).unwrap_or(0);
    let mut ramp_c_per_min = [f32::NAN; 3];
    for (to, text) in ramp_c_per_min.iter_mut().zip(value("dT").unwrap_or("").split(',')) {
        *to = text.parse().unwrap_or(f32::NAN);
    }
    // (Firmware before the scale factors over temperature did not log it: there it is the difference.)
    let mut corrected_dph = [0, 1, 2].map(|a: usize| s.raw_dph[a] - s.bias_dph[a]);
    for (to, text) in corrected_dph.iter_mut().zip(value("c").unwrap_or("").split(',').filter(|t| !t.is_empty())) {
        *to = text.parse().unwrap_or(f32::NAN);
    }
    Some(Housekeeping {
        step: s.time_ms / 1000,
        time_ms: s.time_ms,
        on_for_s: s.on_for_s,
        frequency_hz: s.frequency_hz,
        temperature_c: s.temperature_c,
        ramp_c_per_min,
        bias_dph: s.bias_dph,
        bias_std_dph: s.bias_std_dph,
        raw_dph: s.raw_dph,
        corrected_dph,
        samples: 0,
        adc_errors: 0,
        axis_status: [0, 1, 2].map(|a: usize| AxisStatus::from_bits_retain(s.status[a])),
        unit_status: UnitStatus::from_bits_retain(s.status[3]),
        rejected: [0; 3],
        missing: [0; 3],
        resets: 0,
        dropped: 0,
        link_errors: 0,
        calibration: s.calibration,
        sequence: number("no"),
        created_unix_s: number("made"),
        mode: number("mode") as u8,
        pps_tick: 0,
        pps_age_ms: u32::MAX,
        clock_ppb: 0.0,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_of_the_log_is_a_second_of_the_link() {
        let line = "INFO  t=5000 on=5.0 f=4898.6,4890.7,4702.3 T=6.3,4.9,5.0 dT=0.01,-0.02,0.03 b=1.0,2.0,3.0 raw=4.5,5.5,6.5 status=00,04,00,01 cal=deadbeef no=4 made=1795219200 mode=1";
        let h = housekeeping_of_line(line).expect("a second");
        assert_eq!(
            (h.time_ms, h.calibration, h.sequence, h.created_unix_s, h.mode),
            (5000, 0xDEAD_BEEF, 4, 1_795_219_200, 1)
        );
        assert_eq!((h.ramp_c_per_min, h.corrected_dph), ([0.01, -0.02, 0.03], [3.5, 3.5, 3.5]));
        assert_eq!((h.axis_status[1].bits(), h.unit_status.bits()), (4, 1));
        let with = line.replace(" status=", " c=3.6,3.7,3.8 status=");
        assert_eq!(housekeeping_of_line(&with).expect("a second").corrected_dph, [3.6, 3.7, 3.8]);
        assert!(housekeeping_of_line("INFO  hrg firmware 0.1.0: unit HRG-1, calibration 0").is_none());
    }
}
