//! Writes a recording as text.

use super::columns::{self, Column, Format};
use super::{metadata, Recording};
use std::fmt::Write as _;

impl Recording {
    /// The recording as text, with the earth rate in it that was taken off when it was read.
    #[must_use]
    pub fn to_csv(&self) -> String {
        let mut s = String::with_capacity(self.time_s.len() * 120);
        // (The times of rows that had none are written.)
        for (k, v) in self.meta.iter().filter(|(k, _)| k != metadata::TIME_STEP) {
            let _ = writeln!(s, "# {k}: {v}");
        }
        let present: Vec<usize> = self.present().collect();
        let readings = self.thermometer.columns();
        let earth_rate = self.earth_rate_dph.unwrap_or_default();
        let mut columns: Vec<Written<'_>> = Vec::new();
        for a in readings.map_or(&present[..0], |c| c.of(&present)) {
            columns.extend(readings.map(|c| Written::new(c, *a, &self.frequency_hz[*a], None)));
        }
        columns
            .extend(present.iter().map(|a| Written::new(&columns::RATE, *a, &self.rate_dph[*a], Some(earth_rate[*a]))));
        for (name, values) in &self.optional {
            columns.extend(columns::find(name).map(|(c, a)| Written::new(c, a, values, None)));
        }
        s.push_str(columns::TIME.name(0));
        columns.iter().for_each(|c| s.extend([",", c.name]));
        s.push('\n');
        for k in 0..self.time_s.len() {
            let _ = write!(s, "{}", self.time_s[k]);
            columns.iter().for_each(|c| c.cell(&mut s, k));
            s.push('\n');
        }
        s
    }
}

/// A column as it is written.
struct Written<'r> {
    name: &'static str,
    values: &'r [f64],
    /// Added to each value.
    offset: Option<f64>,
    /// Digits after the point; `None`: as many as bring it back.
    digits: Option<usize>,
}

impl<'r> Written<'r> {
    fn new(column: &Column, a: usize, values: &'r [f64], offset: Option<f64>) -> Self {
        let digits = match column.format {
            Format::Digits(n) => Some(n),
            Format::Exact | Format::Bits => None,
        };
        Self { name: column.name(a), values, offset, digits }
    }

    fn cell(&self, s: &mut String, k: usize) {
        let v = self.offset.map_or(self.values[k], |o| self.values[k] + o);
        let _ = match self.digits {
            _ if !v.is_finite() => write!(s, ","),
            Some(digits) => write!(s, ",{v:.digits$}"),
            None => write!(s, ",{v}"),
        };
    }
}

#[cfg(test)]
mod tests {
    use super::super::samples::rows;
    use super::*;
    use crate::recording::thermometer::Thermometer;

    #[test]
    fn sensors_and_fewer_axes_are_read_and_written() {
        let mut text = "# thermometer: sensor\n# time_step_s: 2\ntemp_c,rate_z_dph\n".to_string();
        for k in 0..40 {
            let _ = writeln!(text, "{},{}", 20.0 + 0.1 * f64::from(k), 5.0 + f64::from(k * 7 % 11));
        }
        let mut r = Recording::parse(text.as_bytes()).expect("readable");
        r.clean().expect("usable");
        assert_eq!((r.thermometer, r.absent), (Thermometer::OneSensor, [true, true, false]));
        assert_eq!((r.time_s[39], r.frequency_hz[2][10], r.rate_dph[2][1]), (78.0, 21.0, 12.0));
        assert!(r.rate_dph[0].len() == 40 && r.frequency_hz[1].iter().all(|v| v.is_nan()));
        let again = Recording::parse(r.to_csv().as_bytes()).expect("readable");
        assert_eq!((&again.time_s, again.thermometer, again.absent), (&r.time_s, r.thermometer, r.absent));
        assert_eq!(again.frequency_hz[2], r.frequency_hz[2]);
        // A sensor for each axis; frequencies beside them are the thermometer, unless the file says otherwise.
        let both = "time_s,fx_hz,temp_x_c,rate_x_dph\n0,4900,20,1\n1,4900.1,20.1,2\n";
        let r = Recording::parse(both.as_bytes()).expect("readable");
        assert!(r.thermometer == Thermometer::Frequency && r.notes.iter().any(|n| n.contains("temp_x_c is not used")));
        let r = Recording::parse(format!("# thermometer: sensor\n{both}").as_bytes()).expect("readable");
        assert_eq!((r.thermometer, r.frequency_hz[0][1]), (Thermometer::Sensors, 20.1));
        let none = "# thermometer: none\ntime_s,rate_y_dph\n0,1\n1,2\n2,4\n";
        let mut r = Recording::parse(none.as_bytes()).expect("readable");
        r.clean().expect("usable");
        assert_eq!(Recording::parse(r.to_csv().as_bytes()).expect("readable").rate_dph[1], [1.0, 2.0, 4.0]);
        for (text, says) in [
            ("time_s,rate_y_dph\n0,1\n", "fy_hz is missing"),
            ("time_s,temp_c\n1,2\n", "rate_x_dph is missing"),
            ("time_s,temp_x_c,rate_y_dph\n1,2,3\n", "temp_y_c is missing"),
            ("temp_c,rate_x_dph\n1,2\n", "time_s is missing; rows that are evenly apart"),
            ("time_s,temp_c,RATE_X_dph\n1,2,3\n", "small letters"),
        ] {
            let e = Recording::parse(text.as_bytes()).expect_err(says).0;
            assert!(e.contains(says), "{text}: {e}");
        }
    }

    #[test]
    fn there_and_back() {
        let mut r = Recording::parse(rows(30).as_bytes()).expect("readable");
        r.clean().expect("usable");
        let again = Recording::parse(r.to_csv().as_bytes()).expect("readable");
        assert_eq!(again.frequency_hz, r.frequency_hz);
        assert_eq!(again.rate_dph, r.rate_dph);
    }
}
