//! Constants renewed in the field: what a unit at rest, at a known latitude, shows of its constants against those of the calibration.
//!
//! The constant of a gyro changes from one power-on to the next by more than a good model leaves. A host that knows the attitude measures it
//! in minutes (`hrg unit zero`) and sends it in maintenance mode. The unit adds it to its biases, with its uncertainty, and keeps it in the
//! field log, apart from the calibration: bounded ([`MOST_DPH`]), tied to the image that it was measured under, reversible (zeros), and with a
//! date. Four records of the log make a set; of one that a power cut has left incomplete nothing is used.
//!
//! # Example
//! ```
//! use hrg_core::zero::{newest, records, Zero};
//!
//! let zero = Zero { made_unix_s: 1_764_000_000, constant_dph: [0.5, -0.25, 0.125], std_dph: [0.03125; 3] };
//! let log = records(&zero, 0xDEAD_BEEF, 77);
//! assert_eq!(newest(log, 0xDEAD_BEEF), Some(zero));
//! // Under another image it means nothing, and incomplete it is none.
//! assert_eq!(newest(log, 0xDEAD_0000), None);
//! assert_eq!(newest(log[..3].iter().copied(), 0xDEAD_BEEF), None);
//! ```

use crate::events::{Event, Record};
use crate::half::Half;
use crate::AXES;

/// Largest constant, deg/h: more than any turn-on of a gyro that its calibration still fits.
pub const MOST_DPH: f32 = 10.0;

/// Records of a set.
pub const RECORDS: usize = 1 + AXES;

/// Constants beside those of the calibration.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Zero {
    /// Time at which they were measured, seconds since 1970; 0: there are none.
    pub made_unix_s: u32,
    /// To be added to the biases, deg/h.
    pub constant_dph: [f32; AXES],
    /// Their standard uncertainties, deg/h.
    pub std_dph: [f32; AXES],
}

impl Zero {
    /// `true` if each number is one that a unit takes.
    #[must_use]
    pub fn possible(&self) -> bool {
        let within = |v: &f32, low: f32| (low..=MOST_DPH).contains(v);
        self.constant_dph.iter().all(|v| within(v, -MOST_DPH)) && self.std_dph.iter().all(|v| within(v, 0.0))
    }
}

/// The records of a set, in the order in which they are written. `calibration`: checksum of the image in use.
#[must_use]
pub fn records(zero: &Zero, calibration: u32, on_for_s: u32) -> [Record; RECORDS] {
    let head = Event::ZeroOf { calibration: calibration as u16, made_unix_s: zero.made_unix_s };
    let of = |k: usize| Event::Zero {
        axis: k as u8,
        std: Half::of(zero.std_dph.get(k).copied().unwrap_or(0.0)).bits(),
        constant: zero.constant_dph.get(k).copied().unwrap_or(0.0).to_bits(),
    };
    [head, of(0), of(1), of(2)].map(|event| Record { on_for_s, event })
}

/// The last complete set of a log, record by record.
#[derive(Debug, Clone, Default)]
pub struct NewestSet {
    found: Option<[Record; RECORDS]>,
    coming: Option<[Record; RECORDS]>,
    filled: u8,
}

impl NewestSet {
    /// Takes a record; the log goes from the oldest to the newest.
    pub fn take(&mut self, record: Record) {
        match record.event {
            Event::ZeroOf { .. } => (self.coming, self.filled) = (Some([record; RECORDS]), 0),
            // (Other events may stand between.)
            Event::Zero { axis, .. } if axis == self.filled => {
                let Some(set) = self.coming.as_mut() else { return };
                if let Some(to) = set.get_mut(usize::from(axis) + 1) {
                    *to = record;
                }
                self.filled += 1;
                if usize::from(self.filled) == AXES {
                    self.found = self.coming.take();
                }
            }
            _ => {}
        }
    }

    /// The last complete set of those that were taken.
    #[must_use]
    pub fn found(self) -> Option<[Record; RECORDS]> {
        self.found
    }
}

/// The constants of the last complete set; `None` where there is none, or it was measured under another image.
pub fn newest(log: impl IntoIterator<Item = Record>, calibration: u32) -> Option<Zero> {
    let mut newest = NewestSet::default();
    log.into_iter().for_each(|record| newest.take(record));
    let set = newest.found()?;
    let Event::ZeroOf { calibration: under, made_unix_s } = set.first()?.event else { return None };
    if under != calibration as u16 {
        return None;
    }
    let mut zero = Zero { made_unix_s, ..Zero::default() };
    for record in &set {
        if let Event::Zero { axis, std, constant } = record.event {
            *zero.constant_dph.get_mut(usize::from(axis))? = f32::from_bits(constant);
            *zero.std_dph.get_mut(usize::from(axis))? = Half::from_bits(std).value();
        }
    }
    zero.possible().then_some(zero)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::Calibration;
    use crate::compensator::Compensator;

    const ZERO: Zero = Zero { made_unix_s: 9, constant_dph: [1.0, -2.0, 0.5], std_dph: [0.25, 0.0, 0.125] };

    #[test]
    fn a_torn_set_leaves_the_one_before() {
        let (first, second) = (records(&ZERO, 7, 1), records(&Zero { made_unix_s: 10, ..Zero::default() }, 7, 2));
        let start = Record { on_for_s: 0, event: Event::CutShort { place: 1 } };
        for written in 0..RECORDS {
            let log = first.iter().chain([&start]).chain(&second[..written]).copied();
            assert_eq!(newest(log, 7), Some(ZERO), "{written} records of the second");
        }
        let log = first.iter().chain(&second).copied();
        assert_eq!(newest(log, 7), Some(Zero { made_unix_s: 10, ..Zero::default() }));
        assert_eq!(newest([], 7), None);
    }

    #[test]
    fn it_is_added_with_its_uncertainty_and_bounded() {
        let mut image = Calibration::uncalibrated();
        image.axes.iter_mut().for_each(|a| a.uncertainty.rest_dph2 = 0.01);
        let (mut with, mut without) = (Compensator::new(image.clone(), 0.0), Compensator::new(image, 0.0));
        with.set_zero(ZERO);
        // Impossible ones change nothing.
        for bad in [f32::NAN, 10.5, -11.0] {
            with.set_zero(Zero { constant_dph: [0.0, bad, 0.0], ..ZERO });
        }
        with.set_zero(Zero { std_dph: [-1.0; AXES], ..ZERO });
        let f = [Some(4900.0), Some(4892.0), Some(4703.6)];
        let (a, b) = (with.step(&f), without.step(&f));
        for k in 0..AXES {
            assert_eq!(a.bias_dph[k] - b.bias_dph[k], ZERO.constant_dph[k]);
            let wanted = (0.01 + ZERO.std_dph[k] * ZERO.std_dph[k]).sqrt();
            assert!((a.bias_std_dph[k] - wanted).abs() < 1e-6);
        }
        with.set_zero(Zero::default());
        assert_eq!(with.step(&f).bias_dph, without.step(&f).bias_dph, "and back");
    }
}
