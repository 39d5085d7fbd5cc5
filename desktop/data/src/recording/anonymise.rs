//! A recording that its owner can give away: without names, dates and place.

use super::metadata::{self, TABLE_RATE, TIME_STEP};
use super::plausible::AT_REST;
use super::Recording;
use crate::error::BadInput;

/// Metadata that stay: what is needed to use the numbers, and tells nothing of whose they are.
const KEPT: [&str; 9] = [
    "hrg-recording",
    "rate_unit",
    "rates",
    "power_on_s",
    "earth_rate",
    "thermometer",
    TIME_STEP,
    TABLE_RATE,
    metadata::STANDS_FOR,
];

/// Takes names, dates and place out of a recording as it was read; tells what was removed. Its earth's rate goes with the place where latitude
/// and axes are known: else it stays in the rates, and a sentence says so.
///
/// # Errors
/// Metadata that cannot be used.
pub fn anonymise(r: &mut Recording) -> Result<Vec<String>, BadInput> {
    let mut removed = Vec::new();
    r.remove_earth_rate()?;
    let removed_rate = r.earth_rate_dph.take().is_some();
    if removed_rate {
        r.set_meta("earth_rate", "removed");
        removed.push("the earth's rate, which tells the latitude, is taken off the rates".to_string());
    } else if !r.without_earth_rate() && r.stands_for().is_none() {
        removed.push(
            "the rates still hold the earth's rate, whose length on three axes tells the latitude: give --latitude and --axes, and it is taken off"
                .to_string(),
        );
    }
    let kept = |key: &str| KEPT.contains(&key) || key == AT_REST;
    let keys: Vec<String> = r.meta.iter().map(|(k, _)| k.clone()).filter(|k| !kept(k)).collect();
    if !keys.is_empty() {
        removed.push(format!("left out of the head: {}", crate::error::list(&keys)));
    }
    r.meta.retain(|(k, _)| kept(k));
    // (A clock that counts from 1970, or from a midnight, tells the date or the hour.)
    let (first, power_on) = (r.time_s.first().copied().unwrap_or(0.0), r.power_on_s());
    let stated = r.meta("power_on_s").is_some();
    let shift = if stated { power_on } else { first };
    if shift != 0.0 {
        r.time_s.iter_mut().for_each(|t| *t = (1e6 * (*t - shift)).round() / 1e6);
        if stated {
            r.set_meta("power_on_s", "0");
        }
        removed.push("the times count from power-on, or from the first row".to_string());
    }
    Ok(removed)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_dates_and_place_are_gone_and_the_numbers_stay() {
        let text = "# hrg-recording: 2\n# unit: HRG-7\n# operator: A. Person\n# latitude_deg: 48.1\n# axes: x=north y=east z=down\n\
            # power_on_s: 1795000000\n# power_on_unix_s: 1795000000\n# scale_factor_dph_per_code: 0.01,0.01,0.01\n\
            time_s,fx_hz,fy_hz,fz_hz,rate_x_dph,rate_y_dph,rate_z_dph\n1795000001,4900,4892,4703,10.045,1,-12\n1795000002.5,4900,4892,4703,11.045,1,-12\n";
        let mut r = Recording::parse(text.as_bytes()).expect("a recording");
        let removed = anonymise(&mut r).expect("fine");
        let text = r.to_csv();
        for word in ["HRG-7", "Person", "48.1", "north", "17950", "0.01,"] {
            assert!(!text.contains(word), "{word}: {text}");
        }
        assert_eq!(r.time_s, [1.0, 2.5]);
        assert!((r.rate_dph[0][0]).abs() < 0.01 && (r.rate_dph[0][1] - r.rate_dph[0][0] - 1.0).abs() < 1e-9);
        assert!(removed.iter().any(|s| s.contains("unit, operator, latitude_deg, axes")), "{removed:?}");
        let again = Recording::parse(text.as_bytes()).expect("a recording");
        assert!(again.without_earth_rate() && again.time_s.len() == 2);
        // Without an attitude the earth's rate stays, and a sentence says so.
        let mut r = Recording::parse(b"time_s,temp_c,rate_z_dph\n5,20,1\n6,20,2\n7,20,3\n").expect("a recording");
        let removed = anonymise(&mut r).expect("fine");
        assert!(removed[0].contains("still hold the earth's rate") && r.time_s == [0.0, 1.0, 2.0], "{removed:?}");
    }
}
