//! A recording that its owner can give away: without names, dates and place.

use super::metadata::{CALIBRATION, FORCES, STANDS_FOR, TABLE_RATE, TIME_STEP, UNIT_INPUTS};
use super::plausible::AT_REST;
use super::Recording;
use crate::error::BadInput;
use hrg_core::AXES;

/// Metadata that stay: what is needed to use the numbers, and tells nothing of whose they are.
const KEPT: [&str; 13] = [
    CALIBRATION,
    FORCES,
    "hrg-recording",
    "rate_unit",
    "rates",
    "power_on_s",
    "earth_rate",
    "thermometer",
    TIME_STEP,
    TABLE_RATE,
    STANDS_FOR,
    UNIT_INPUTS,
    AT_REST,
];

/// Longest time from power-on to the first row, s: what is longer is a date.
const LONGEST_ON_S: f64 = 30.0 * 86400.0;

/// Smallest step of rates that shows, deg/h: digits of a text are finer.
const LEAST_STEP_DPH: f64 = 0.01;

/// The step of values that are whole multiples of one, as an ADC gives them; `None` where they are not.
fn step_of_values(values: &[f64]) -> Option<f64> {
    let mut some: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).take(20_000).collect();
    let first = *some.first().filter(|_| some.len() >= 100)?;
    some.sort_by(f64::total_cmp);
    let step = some.windows(2).map(|w| w[1] - w[0]).filter(|d| *d > 1e-6).fold(f64::INFINITY, f64::min);
    let whole = |v: &&f64| {
        let n = (**v - first) / step;
        (n - n.round()).abs() < 0.02
    };
    let fits = some.iter().filter(whole).count();
    (step.is_finite() && step > LEAST_STEP_DPH && fits as f64 > 0.99 * some.len() as f64).then_some(step)
}

/// The changes to the rows of a recording that its first rows decide.
#[derive(Debug, Clone, Copy)]
pub struct OfRows {
    /// Steps of the rates, deg/h, where they have any.
    steps: [Option<f64>; AXES],
    /// Taken off the times, s.
    shift_s: f64,
}

/// Takes names, dates and place out of a recording as it was read; tells what was removed. Its earth's rate goes with the place where latitude
/// and axes are known: else it stays in the rates, and a sentence says so. `before`: of a part that goes on, what its first part gave.
///
/// # Errors
/// Metadata that cannot be used.
pub fn anonymise(r: &mut Recording, before: Option<OfRows>) -> Result<(OfRows, Vec<String>), BadInput> {
    let mut removed = Vec::new();
    let steps = before.map_or_else(|| [0, 1, 2].map(|a: usize| step_of_values(&r.rate_dph[a])), |b| b.steps);
    r.remove_earth_rate()?;
    if let Some(parts) = r.earth_rate_dph.take() {
        // (Rates of coarse steps would show the earth's rate as what they are off their steps by: they stay on them.)
        let mut coarse = false;
        for ((column, part), step) in r.rate_dph.iter_mut().zip(parts).zip(steps) {
            if let Some(step) = step {
                let off = part - (part / step).round() * step;
                column.iter_mut().for_each(|v| *v += off);
                coarse = true;
            }
        }
        r.set_meta("earth_rate", "removed");
        let to = if coarse { ", to a step of the rates" } else { "" };
        removed.push(format!("the earth's rate, which tells the latitude, is taken off the rates{to}"));
    } else if !r.without_earth_rate() && r.stands_for().is_none() {
        removed.push(
            "PLACE: the rates still hold the earth's rate, and its direction against the vertical tells the latitude; give --latitude and --axes, and it is taken off"
                .to_string(),
        );
    }
    let kept = |key: &str| KEPT.contains(&key);
    let keys: Vec<String> = r.meta.iter().map(|(k, _)| k.clone()).filter(|k| !kept(k)).collect();
    if !keys.is_empty() {
        removed.push(format!("left out of the head: {}", crate::error::list(&keys)));
    }
    r.meta.retain(|(k, _)| kept(k));
    // (A clock that counts from 1970, or from a midnight, tells the date or the hour.)
    let first = r.time_s.first().copied().unwrap_or(0.0);
    let stated = r.meta("power_on_s").is_some() && (0.0..LONGEST_ON_S).contains(&(first - r.power_on_s()));
    let shift = before.map_or(if stated { r.power_on_s() } else { first }, |b| b.shift_s);
    if !stated {
        r.meta.retain(|(k, _)| k != "power_on_s");
    }
    if shift != 0.0 {
        r.time_s.iter_mut().for_each(|t| *t = (1e6 * (*t - shift)).round() / 1e6);
        if stated {
            r.set_meta("power_on_s", "0");
        }
        removed.push(format!("the times count from {}", if stated { "power-on" } else { "the first row" }));
    }
    Ok((OfRows { steps, shift_s: shift }, removed))
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
        let (_, removed) = anonymise(&mut r, None).expect("fine");
        let text = r.to_csv();
        for word in ["HRG-7", "Person", "48.1", "north", "17950", "0.01,"] {
            assert!(!text.contains(word), "{word}: {text}");
        }
        assert_eq!(r.time_s, [1.0, 2.5]);
        assert!((r.rate_dph[0][0]).abs() < 0.01 && (r.rate_dph[0][1] - r.rate_dph[0][0] - 1.0).abs() < 1e-9);
        assert!(removed.iter().any(|s| s.contains("unit, operator, latitude_deg, axes")), "{removed:?}");
        let again = Recording::parse(text.as_bytes()).expect("a recording");
        assert!(again.without_earth_rate() && again.time_s.len() == 2);
        // Rates of coarse steps stay on their steps, and dates are none of power-on.
        let mut text = String::from("# latitude_deg: 48.137\n# axes: x=north y=east z=down\n# power_on_s: 0\ntime_s,temp_c,rate_x_dph,rate_y_dph,rate_z_dph\n");
        for k in 0..500u32 {
            let n = f64::from(k * 7919 % 13) - 6.0;
            text += &format!("{},20,{},{},{}\n", 1_764_000_001 + k, 36.0 * n, 36.0 * (n + 1.0), 36.0 * (n - 2.0));
        }
        let mut r = Recording::parse(text.as_bytes()).expect("a recording");
        anonymise(&mut r, None).expect("fine");
        let off = |v: &f64| (v / 36.0 - (v / 36.0).round()).abs();
        assert!(r.rate_dph.iter().flatten().all(|v| off(v) < 1e-6) && r.time_s[1] == 1.0, "{:?}", &r.rate_dph[0][..3]);
        // A part that goes on is as the whole.
        let head = text.find("1764").expect("rows");
        let half = head + text[head..].len() / 2;
        let half = half + text[half..].find('\n').expect("a line") + 1;
        let mut parts = [text[..half].to_string(), text[..head].to_string() + &text[half..]]
            .map(|t| Recording::parse(t.as_bytes()).expect("a recording"));
        let (known, _) = anonymise(&mut parts[0], None).expect("fine");
        anonymise(&mut parts[1], Some(known)).expect("fine");
        let joined: Vec<f64> = parts.iter().flat_map(|p| p.time_s.clone()).collect();
        let rates: Vec<f64> = parts.iter().flat_map(|p| p.rate_dph[0].clone()).collect();
        assert!(joined == r.time_s && rates == r.rate_dph[0]);
        // Without an attitude the earth's rate stays, and a sentence says so.
        let mut r = Recording::parse(b"time_s,temp_c,rate_z_dph\n5,20,1\n6,20,2\n7,20,3\n").expect("a recording");
        let (_, removed) = anonymise(&mut r, None).expect("fine");
        assert!(removed[0].contains("still hold the earth's rate") && r.time_s == [0.0, 1.0, 2.0], "{removed:?}");
    }
}
