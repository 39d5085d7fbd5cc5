//! Values that cannot be what their column says: kelvin called C, deg/s called deg/h, an axis with the wrong sign, a unit that moves.
//!
//! A finding is a note, and says what the values look like. It is a refusal only where no figure of the recording could be right.

use super::metadata::{Attitude, EARTH_RATE_DPH};
use super::thermometer::Thermometer;
use super::{columns, Recording};
use crate::axes::AXIS_NAMES;
use crate::error::BadInput;
use crate::numeric::stats::{dot, mean, median, quantile};
use hrg_core::AXES;
use std::ops::Range;

/// Key of the metadata by which a user states that the unit was at rest, whatever its rates look like.
pub const AT_REST: &str = "at_rest";
/// Odds that a user has stated a wrong unit or attitude of one kind. Biases of a size that is not known have a density that falls with the
/// power of the number of axes: so much smaller must they be under the other attitude.
const WRONG: f64 = 0.01;
/// Angle random walk below which no gyro is known, deg/sqrt(h).
const LEAST_WALK: f64 = 1e-5;
/// Scatter of one-second means that no gyro at rest is known to exceed, deg/h: an angle random walk of 17 deg/sqrt(h).
const MOST_SCATTER_DPH: f64 = 1000.0;
/// Ratio of the scatter of one-second means to the one that the scatter from row to row explains: a gyro's own filters make it 5 or so.
const MOST_RATIO: f64 = 20.0;
/// Scatter below which nothing is a movement, deg/h: a hand or a ship turns faster, and warming gyros drift less in seconds.
const LEAST_MOVEMENT_DPH: f64 = 30.0;
/// Angle between gravity in a stretch and gravity in most of them, beyond which the unit is held another way, degrees: accelerometers of flight
/// controllers drift by up to 60 mg over temperature (data sheet of the MPU-6050), which is 3.4 degrees.
const MOST_TILT_DEG: f64 = 5.0;
/// Share by which the length of three constants may differ from the earth's rate and still look like it: constants change from day to day.
const LIKE_THE_EARTH: f64 = 0.05;
/// Rows that a finding needs.
const FEWEST: usize = 30;
/// Values that a finding rests on, of a long recording evenly chosen.
const ENOUGH: usize = 50_000;

/// Kelvin, in C: below the lowest temperature of a chamber nothing is recorded, and above the highest not all along.
const KELVIN: Range<f64> = 173.15..473.15;

/// Temperatures that a sensor on a gyro can have, C.
const SENSORS: Range<f64> = -273.15..500.0;
/// Length of a stretch that is looked at for movement, s.
const STRETCH_S: usize = 64;

impl Recording {
    /// Notes on values that look like something else; a thermometer of zeros is none from then on. `step_s`: usual time between rows.
    ///
    /// # Errors
    /// Temperatures in kelvin: nothing that is fitted to them would fly.
    pub(super) fn note_unlikely(&mut self, step_s: f64) -> Result<(), BadInput> {
        if self.thermometer.is_sensor() {
            let axes: Vec<usize> = self.present().collect();
            let all = || axes.iter().flat_map(|a| &self.frequency_hz[*a]).copied().filter(|v| v.is_finite());
            let (low, high) = all().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
            if !(SENSORS.contains(&low) && SENSORS.contains(&high)) && low <= high {
                return Err(BadInput(format!(
                    "column {}: temperatures from {low:.1} to {high:.1} C are those of no gyro; give the unit of the column (hrg import with unit = \"mC\" in the map, say)",
                    self.thermometer.column(axes[0])
                )));
            }
            if KELVIN.contains(&low) && KELVIN.contains(&high) {
                return Err(BadInput(format!(
                    "column {}: temperatures from {low:.1} to {high:.1} C look like kelvin; give them in C (hrg import with unit = \"K\" in the map converts them)",
                    self.thermometer.column(axes[0])
                )));
            }
            if self.reads_zero() {
                self.thermometer = Thermometer::None;
                self.frequency_hz.iter_mut().flatten().for_each(|v| *v = f64::NAN);
                self.notes.push(
                    "the thermometer reads 0.00 C in all rows: the recording is taken for one without a thermometer"
                        .into(),
                );
            }
        }
        if let Some(what) = self.stands_for() {
            self.notes.push(format!("the rates stand for {what}; names of columns and keys still say dph"));
            return Ok(());
        }
        if self.turned() || self.corrected() {
            return Ok(());
        }
        let constants: [Option<f64>; AXES] = std::array::from_fn(|a| median(&mut self.finite_rates(a)));
        let walks: Vec<(usize, f64)> =
            self.present().filter_map(|a| Some((a, self.largest_walk(a, step_s)?))).collect();
        let mut notes: Vec<String> = Vec::new();
        if let Some((a, walk)) = walks.iter().find(|(_, w)| *w > 0.0 && *w < LEAST_WALK) {
            notes.push(format!(
                "column {}: its noise is {walk:.1e} deg/sqrt(h), less than that of any gyro known: are the rates deg/s or rad/s, called deg/h?",
                columns::RATE.name(*a)
            ));
        }
        if let (Some(parts), Some(attitude)) = (self.earth_rate_dph, self.attitude()?) {
            notes.extend(another_attitude(&constants, &parts, &attitude));
        }
        self.notes.extend(notes);
        Ok(())
    }

    /// `true` if its thermometer reads 0.00 C in all rows, as those do that are not there.
    pub(super) fn reads_zero(&self) -> bool {
        let all = || self.present().flat_map(|a| &self.frequency_hz[a]).filter(|v| v.is_finite());
        self.thermometer.is_sensor() && all().count() > FEWEST && all().all(|v| *v == 0.0)
    }

    fn finite_rates(&self, axis: usize) -> Vec<f64> {
        let every = 1 + self.time_s.len() / ENOUGH;
        self.rate_dph[axis].iter().step_by(every).copied().filter(|v| v.is_finite()).collect()
    }

    /// Angle random walk by the differences of neighbouring rows, or of means of 100 s where that is larger (rates may be filtered),
    /// deg/sqrt(h); `None` of too few rows.
    fn largest_walk(&self, axis: usize, step_s: f64) -> Option<f64> {
        let rows = ((100.0 / step_s).round() as usize).max(1);
        let means: Vec<f64> = self.rate_dph[axis].chunks_exact(rows).map(mean).collect();
        let of_means = scatter(&means).map_or(0.0, |s| s * (rows as f64).sqrt());
        Some(scatter(&self.rate_dph[axis])?.max(of_means) * step_s.sqrt() / 60.0)
    }

    /// `false` where its rates say nothing of a movement: on a rate table, of an oscillator, or where a user states that it was at rest.
    fn may_move(&self) -> bool {
        !self.turned() && self.meta(AT_REST) != Some("yes") && self.stands_for().is_none()
    }

    /// Tests that the unit was at rest while its rates were recorded, as every figure of a gyro's bias takes for granted.
    ///
    /// # Errors
    /// A sentence with the axis and its scatter, where the rates are those of a unit that moves.
    pub fn rests(&self) -> Result<(), BadInput> {
        if !self.may_move() {
            return Ok(());
        }
        let Some(per_second) = rows_per_second(self.step_s()) else { return Ok(()) };
        for a in self.present() {
            if let Some(how) = self.movement(a, per_second) {
                return Err(BadInput(format!(
                    "axis {}: the unit moves: {how}; a bias is seen at rest only (if it was at rest, are the rates deg/h? Else say \"# {AT_REST}: yes\" in the recording)",
                    AXIS_NAMES[a]
                )));
            }
        }
        Ok(())
    }

    /// Rows in which the unit moved while it was at rest for most of the time.
    pub(super) fn moving_rows(&self, step_s: f64) -> Vec<Range<usize>> {
        let Some(per_second) = rows_per_second(step_s).filter(|_| self.may_move()) else { return Vec::new() };
        let length = STRETCH_S * per_second;
        let mut moving = vec![false; self.time_s.len() / length];
        for a in self.present() {
            let scatters: Vec<Option<f64>> = self.rate_dph[a]
                .chunks_exact(length)
                .map(|stretch| scatter(&stretch.chunks_exact(per_second).map(mean).collect::<Vec<f64>>()))
                .collect();
            let Some(usual) = median(&mut scatters.iter().copied().flatten().collect::<Vec<f64>>()) else { continue };
            let most = LEAST_MOVEMENT_DPH.max(MOST_RATIO * usual);
            moving.iter_mut().zip(scatters).for_each(|(m, s)| *m |= s.is_some_and(|s| s > most));
        }
        moving.iter_mut().zip(self.tilted(length)).for_each(|(m, tilted)| *m |= tilted);
        if 2 * moving.iter().filter(|m| **m).count() > moving.len() {
            return Vec::new();
        }
        let ends = |k: usize| if k + 1 == moving.len() { self.time_s.len() } else { (k + 1) * length };
        (0..moving.len()).filter(|k| moving[*k]).map(|k| k * length..ends(k)).collect()
    }

    /// For each stretch of so many rows: is the unit held another way than in most of them, by gravity? Nothing without three accelerometers.
    fn tilted(&self, length: usize) -> Vec<bool> {
        let [x, y, z] = [0, 1, 2].map(|a| self.column(columns::FORCE.name(a)));
        let (Some(x), Some(y), Some(z), false) = (x, y, z, self.positioned()) else { return Vec::new() };
        let finite = |f: &[f64]| mean(&f.iter().copied().filter(|v| v.is_finite()).collect::<Vec<_>>());
        let each = [x, y, z].map(|f| f.chunks_exact(length).map(finite).collect::<Vec<f64>>());
        let usual =
            each.each_ref().map(|f| median(&mut f.iter().copied().filter(|v| v.is_finite()).collect::<Vec<_>>()));
        let [Some(x), Some(y), Some(z)] = usual else { return Vec::new() };
        let usual = [x, y, z];
        let least = MOST_TILT_DEG.to_radians().cos();
        let angle = |k: usize| {
            let now = each.each_ref().map(|f| f[k]);
            dot(&now, &usual) / (dot(&now, &now) * dot(&usual, &usual)).sqrt()
        };
        // (Not a number where a stretch has no force: nothing is known of it.)
        (0..each[0].len()).map(|k| angle(k) < least).collect()
    }

    /// Sign of a movement on an axis.
    fn movement(&self, axis: usize, per_second: usize) -> Option<String> {
        let means = |length: usize| -> Vec<f64> { self.rate_dph[axis].chunks_exact(length).map(mean).collect() };
        let (one, four) = (means(per_second), means(4 * per_second));
        let of_means = scatter(&one)?;
        let explained = scatter(&self.rate_dph[axis])? / (per_second as f64).sqrt();
        let later = scatter(&four);
        // (White noise, as of rows that were picked and not averaged, halves from 1 s to 4 s, and is as its samples explain.)
        let white = later.is_some_and(|l| l < 0.7 * of_means) && of_means < 3.0 * explained;
        if of_means > MOST_SCATTER_DPH && !white {
            return Some(format!("means of 1 s scatter by {of_means:.0} deg/h"));
        }
        if per_second > 1 && of_means > LEAST_MOVEMENT_DPH.max(MOST_RATIO * explained) {
            return Some(format!(
                "means of 1 s scatter by {of_means:.3} deg/h, {:.0} times what the noise of its samples explains",
                of_means / explained
            ));
        }
        // White noise halves from 1 s to 4 s, flicker stays, a random walk of the rate doubles.
        let later = later?;
        let pairs = four.windows(2).filter(|w| w[0].is_finite() && w[1].is_finite()).count() as f64;
        let most = of_means * 2f64.sqrt() * (1.0 + 3.0 / (2.0 * pairs).sqrt());
        (later > LEAST_MOVEMENT_DPH.max(most))
            .then(|| format!("its Allan deviation rises from {of_means:.3} deg/h at 1 s to {later:.3} at 4 s"))
    }
}

/// Rows in a second; `None` of rows that are too far apart to show a movement.
fn rows_per_second(step_s: f64) -> Option<usize> {
    (step_s > 0.0 && step_s < 1.5).then(|| (1.0 / step_s).round().max(1.0) as usize)
}

/// Standard deviation of values by the differences of neighbours, of which the largest tenth does not count; `None` of too few.
fn scatter(values: &[f64]) -> Option<f64> {
    let pairs = values.windows(2).step_by(1 + values.len() / ENOUGH);
    let all: Vec<f64> = pairs.map(|w| (w[1] - w[0]).powi(2)).filter(|d| d.is_finite()).collect();
    if all.len() < FEWEST {
        return None;
    }
    let most = quantile(&all, 0.9);
    let kept: Vec<f64> = all.into_iter().filter(|d| *d <= most).collect();
    // (Of a normal distribution the lower nine tenths have 0.5326 of the mean square.)
    Some((kept.iter().sum::<f64>() / kept.len() as f64 / (2.0 * 0.5326)).sqrt())
}

/// Ratio of the constants of so many axes under another attitude to those under the stated one, at which the other one is as likely.
fn near(axes: usize) -> f64 {
    WRONG.powf(1.0 / axes.max(1) as f64)
}

/// Length of the constants of the axes that are there, with something added to each.
fn length(constants_dph: &[Option<f64>; AXES], added_dph: &[f64; AXES]) -> f64 {
    let all = constants_dph.iter().zip(added_dph).filter_map(|(c, added)| Some((*c)? + added));
    all.map(|v| v * v).sum::<f64>().sqrt()
}

/// `true` if constants from which the earth's rate was taken off are minus that rate: it had not been in them.
fn without(constants_dph: &[Option<f64>; AXES], parts_dph: &[f64; AXES]) -> bool {
    let whole = length(&constants_dph.map(|c| c.map(|_| 0.0)), parts_dph);
    let seen = constants_dph.iter().flatten().count();
    whole > 1.0 && length(constants_dph, parts_dph) < near(seen) * whole
}

/// A note on rates that a calibration has corrected: it was fitted with the earth's rate in them and they are without it, or the other way.
/// `parts_dph`: the earth's rate that was taken off them; `None` where none was.
#[must_use]
pub fn earth_rate_otherwise(constants_dph: &[Option<f64>; AXES], parts_dph: Option<&[f64; AXES]>) -> Option<String> {
    let of_three = constants_dph.iter().all(Option::is_some).then(|| length(constants_dph, &[0.0; AXES]));
    match parts_dph {
        Some(parts) if without(constants_dph, parts) => Some(
            "the constants of the corrected rates are minus the earth's rate: the calibration holds it already, as it was fitted without latitude and axes; fit it anew with them, or leave them out here".into(),
        ),
        None if of_three.is_some_and(|l| (l / EARTH_RATE_DPH - 1.0).abs() < LIKE_THE_EARTH) => Some(format!(
            "the constants of the corrected rates have the length of the earth's rate, {EARTH_RATE_DPH:.2} deg/h: the calibration was fitted with latitude and axes, it seems; give --latitude and --axes here, too"
        )),
        _ => None,
    }
}

/// A note on rates whose constants would be far smaller under another attitude than the stated one, or without the earth's rate at all.
fn another_attitude(constants_dph: &[Option<f64>; AXES], parts_dph: &[f64; AXES], stated: &Attitude) -> Option<String> {
    let flipped = |a: usize| {
        let parts = [0, 1, 2].map(|k| if k == a { -parts_dph[k] } else { parts_dph[k] });
        (parts, format!("axis {0} points the other way than axes says: its constant is minus twice its part of the earth's rate", AXIS_NAMES[a]))
    };
    let exchanged = |a: usize, b: usize| {
        let mut parts = *parts_dph;
        parts.swap(a, b);
        (parts, format!("axes {} and {} are exchanged in axes", AXIS_NAMES[a], AXIS_NAMES[b]))
    };
    let south = Attitude { latitude_deg: -stated.latitude_deg, ..*stated };
    let others = [
        ([0.0; AXES], "the rates held none of the earth's rate that was taken off: they are deg/s called deg/h, or free of it already (then say earth_rate: removed, and leave latitude and axes out)".to_string()),
        flipped(0),
        flipped(1),
        flipped(2),
        exchanged(0, 1),
        exchanged(0, 2),
        exchanged(1, 2),
        (south.earth_rate_dph(), "the latitude has the wrong sign".to_string()),
    ];
    let left_under = |parts: &[f64; AXES]| length(constants_dph, &[0, 1, 2].map(|a: usize| parts_dph[a] - parts[a]));
    let seen = constants_dph.iter().flatten().count();
    let (left, cause) =
        others.into_iter().map(|(parts, cause)| (left_under(&parts), cause)).min_by(|x, y| x.0.total_cmp(&y.0))?;
    (left < near(seen) * left_under(parts_dph)).then(|| format!("it looks as if {cause}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ten rows a second for ten minutes; noise of 20 deg/h by a generator that is no generator, and what is given on top.
    fn recording(meta: &[(&str, &str)], temperature_c: f64, rate: impl Fn(usize, f64) -> f64) -> Recording {
        let mut r = Recording { thermometer: Thermometer::OneSensor, ..Recording::default() };
        r.time_s = (0..6000).map(|k| 0.1 * f64::from(k)).collect();
        let noise = |k: usize, a: usize| 20.0 * ((k * 7919 + a * 104_729) % 1009) as f64 / 1009.0 - 10.0;
        for a in 0..AXES {
            r.frequency_hz[a] = r.time_s.iter().map(|t| temperature_c * (1.0 + 1e-5 * t)).collect();
            r.rate_dph[a] = r.time_s.iter().enumerate().map(|(k, t)| noise(k, a) + rate(a, *t)).collect();
        }
        meta.iter().for_each(|(k, v)| r.set_meta(k, v));
        r
    }

    const PLACE: [(&str, &str); 2] = [("latitude_deg", "45"), ("axes", "x=north y=east z=down")];
    const EARTH: [f64; AXES] = [10.636, 0.0, -10.636];

    fn notes(mut r: Recording) -> String {
        r.clean().expect("fine");
        r.notes.join("; ")
    }

    #[test]
    fn temperatures_that_are_none() {
        let e = recording(&[], 293.0, |_, _| 0.0).clean().expect_err("kelvin").0;
        assert!(e.contains("look like kelvin") && e.contains("unit = \"K\""), "{e}");
        let e = recording(&[], 20_000.0, |_, _| 0.0).clean().expect_err("thousandths").0;
        assert!(e.contains("are those of no gyro") && e.contains("mC"), "{e}");
        let mut r = recording(&[], 0.0, |_, _| 0.0);
        r.clean().expect("fine");
        assert_eq!(r.thermometer, Thermometer::None);
        assert!(notes(recording(&[], 60.0, |_, _| 0.0)).is_empty());
    }

    #[test]
    fn units_and_signs_that_are_wrong() {
        let right = |a: usize, _: f64| EARTH[a] + [0.3, -0.2, 0.4][a];
        assert_eq!(notes(recording(&PLACE, 20.0, right)), "");
        let mut r = recording(&PLACE, 20.0, right);
        r.rate_dph.iter_mut().flatten().for_each(|v| *v /= 3600.0);
        assert!(notes(r).contains("the rates held none"));
        assert!(notes(recording(&PLACE, 20.0, |_, _| 0.1)).contains("earth_rate: removed"));
        let as_if = |of: &dyn Fn([f64; AXES]) -> [f64; AXES]| {
            let parts = of(EARTH);
            notes(recording(&PLACE, 20.0, |a, _| parts[a] + [0.9, -1.2, 1.4][a]))
        };
        assert!(as_if(&|e| [e[0], e[1], -e[2]]).contains("axis z points the other way"));
        assert!(as_if(&|e| [e[1], e[0], e[2]]).contains("axes x and y are exchanged"));
        let other = as_if(&|e| [-e[0], e[1], e[2]]);
        assert!(other.contains("axis x points the other way"), "{other}");
        assert_eq!(as_if(&|e| e), "");
        let mut quiet = recording(&[], 20.0, |_, _| 0.0);
        quiet.rate_dph.iter_mut().flatten().for_each(|v| *v *= 1e-5);
        assert!(notes(quiet).contains("less than that of any gyro known"));
        // Gyros of large biases show nothing of the earth.
        assert_eq!(notes(recording(&PLACE, 20.0, |a, _| [300.0, -150.0, 90.0][a])), "");
    }

    #[test]
    fn calibrations_that_hold_the_earths_rate_or_not() {
        let says =
            |c: [f64; AXES], parts: Option<&[f64; AXES]>| earth_rate_otherwise(&c.map(Some), parts).unwrap_or_default();
        assert!(says([-10.5, 0.1, 10.6], Some(&EARTH)).contains("holds it already"));
        assert!(says([10.5, 0.1, -10.6], None).contains("give --latitude"));
        assert_eq!(
            (says([0.3, 0.1, -0.6], None), says([0.3, 0.1, -0.6], Some(&EARTH))),
            (String::new(), String::new())
        );
        assert_eq!(earth_rate_otherwise(&[Some(15.0), None, Some(0.0)], None), None);
    }

    #[test]
    fn a_unit_that_moves() {
        assert_eq!(recording(&[], 20.0, |_, t| 0.02 * t).rests(), Ok(()));
        let mut loud = recording(&[], 20.0, |_, _| 0.0);
        loud.rate_dph.iter_mut().flatten().for_each(|v| *v *= 1000.0);
        assert_eq!(loud.rests(), Ok(()), "white noise");
        for (by, moving) in [
            ("scatter by", recording(&[], 20.0, |_, t| 9000.0 * (2.1 * t).sin())),
            ("Allan deviation rises", recording(&[], 20.0, |_, t| 80.0 * (0.25 * t).sin())),
            ("samples explains", recording(&[], 20.0, |_, t| 600.0 * (1.9 * t).sin())),
        ] {
            let e = moving.rests().expect_err("moves").0;
            assert!(e.contains("the unit moves") && e.contains(by), "{e}");
            let mut stated = moving.copied();
            stated.set_meta(AT_REST, "yes");
            assert_eq!(stated.rests(), Ok(()));
        }
    }

    #[test]
    fn spikes_go_with_the_rates_that_they_were_taken_from() {
        let mut r = recording(&PLACE, 20.0, |a, t| EARTH[a] + if t == 50.0 && a == 0 { 900.0 } else { 0.0 });
        let before = r.rate_dph[0][500];
        r.clean().expect("fine");
        assert!(r.rate_dph[0][500].is_nan() && (r.with_spikes().rate_dph[0][500] - (before - EARTH[0])).abs() < 0.01);
        r.restore_earth_rate();
        assert!((r.with_spikes().rate_dph[0][500] - before).abs() < 1e-9);
    }

    #[test]
    fn stretches_in_which_gravity_lies_another_way_are_left_out() {
        let tilted = |angle: fn(f64) -> f64| {
            let mut r = recording(&[], 20.0, |_, _| 0.0);
            let forces = |f: &dyn Fn(f64) -> f64| r.time_s.iter().map(|t| f(*t)).collect::<Vec<f64>>();
            let columns = [forces(&|t| 9.81 * angle(t).sin()), forces(&|_| 0.05), forces(&|t| 9.81 * angle(t).cos())];
            r.optional.extend(columns::FORCE.names.iter().copied().zip(columns));
            r
        };
        let mut r = tilted(|t| if (256.0..384.0).contains(&t) { 12f64.to_radians() } else { 0.0 });
        r.clean().expect("fine");
        assert!(
            r.notes.iter().any(|n| n.contains("the unit moves in 128 s of 600 s, the first at 256 s")),
            "{:?}",
            r.notes
        );
        // An accelerometer's own drift is none.
        let mut r = tilted(|t| 3f64.to_radians() * t / 600.0);
        r.clean().expect("fine");
        assert!(r.notes.is_empty(), "{:?}", r.notes);
    }

    #[test]
    fn stretches_in_which_the_unit_moves_are_left_out() {
        let moved = |t: f64| (200.0..300.0).contains(&t);
        let mut r = recording(&[], 20.0, |_, t| if moved(t) { 5000.0 * (0.8 * t).sin() } else { 0.0 });
        let before = r.clone();
        let original = r.clean_keeping().expect("fine");
        assert!(
            r.notes.iter().any(|n| n.contains("the unit moves in 128 s of 600 s, the first at 192 s")),
            "{:?}",
            r.notes
        );
        let gone = |t: f64| (192.0..320.0).contains(&t);
        assert!(r.time_s.iter().zip(&r.rate_dph[1]).all(|(t, v)| v.is_nan() == gone(*t)));
        assert!(original.of(&r).rate_dph == before.rate_dph && r.rests().is_ok());
        // Bias steps and noise that grows are no movement.
        let mut r = recording(&[], 20.0, |_, t| if moved(t) { 300.0 } else { 0.0 });
        r.clean().expect("fine");
        assert!(r.notes.is_empty(), "{:?}", r.notes);
    }
}
