//! Temperatures and ramps that the runs of the fit visited together: a coarse map of one axis.
//!
//! Both may lie in their calibrated ranges and still be a pair that no run has shown: a unit that was heated fast and never cooled knows
//! nothing of cooling at 20 C. The map has an eighth of the temperature range in each entry, with the slowest and the fastest of 16
//! levels of the ramp range that were visited there: 64 bits. A state is known if its ramp lies within those two, one level wider.
//!
//! Beyond the ranges nothing is known. A model continues there along its tangents, and the slope of the bias may be another: with each
//! eighth of the range it may go by as much as it may do in an unknown entry, and as its baseline bends from one eighth to the next.
//!
//! # Example
//! ```
//! use hrg_core::visited::{Ranges, Visited};
//!
//! let ranges = Ranges { from_c: -40.0, to_c: 40.0, from_c_per_min: -2.0, to_c_per_min: 2.0 };
//! let mut map = Visited::none();
//! map.visit(&ranges, 5.0, 1.5);
//! map.visit(&ranges, 5.0, 0.0);
//! assert!(map.knows(&ranges, 6.0, 0.7) && !map.knows(&ranges, 6.0, -1.0) && !map.knows(&ranges, -20.0, 0.7));
//!
//! // One eighth of the range beyond its end, and two.
//! map.unvisited_dph2 = 0.01;
//! map.visit(&ranges, 40.0, 0.0);
//! assert!(!map.knows(&ranges, 50.0, 0.0));
//! assert_eq!([40.0, 50.0, 60.0].map(|t| map.more_dph2(&ranges, t, 0.0, || 0.0)), [None, Some(0.01), Some(0.04)]);
//! ```

use crate::bias::clamp;
use crate::schema::layout;

/// Entries over the temperature range.
pub const TEMPERATURES: usize = 8;
/// Levels over the ramp range.
pub const LEVELS: usize = 16;

/// Ranges of the fit over which a map lies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ranges {
    /// Lowest temperature, C.
    pub from_c: f32,
    /// Highest temperature, C.
    pub to_c: f32,
    /// Fastest cooling, C per minute.
    pub from_c_per_min: f32,
    /// Fastest heating, C per minute.
    pub to_c_per_min: f32,
}

/// The map of one axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Visited {
    /// For each eighth of the temperature range, coldest first: the lowest level of ramp visited in the lower four bits, the highest in the
    /// upper four; lowest above highest: none.
    pub visited_levels: [u8; TEMPERATURES],
    /// Added to the variance of a bias in an unknown entry, (deg/h)^2: as much as the bias may do where nothing was seen.
    pub unvisited_dph2: f32,
}
layout! { Visited {
    visited_levels: [u8; TEMPERATURES], "for each eighth of the temperature range: lowest (bits 0 to 3) and highest (4 to 7) of 16 levels of the ramp range that the fit has seen there";
    unvisited_dph2: f32, "added to the variance of a bias beyond these, (deg/h)^2; beyond the ranges times the square of the distance in eighths of the range";
} }

impl Default for Visited {
    /// Everything is known: an image without a map.
    fn default() -> Self {
        Self { visited_levels: [0xF0; TEMPERATURES], unvisited_dph2: 0.0 }
    }
}

impl Visited {
    /// A map on which nothing was visited.
    #[must_use]
    pub const fn none() -> Self {
        Self { visited_levels: [0x0F; TEMPERATURES], unvisited_dph2: 0.0 }
    }

    /// Marks a state as visited.
    pub fn visit(&mut self, ranges: &Ranges, temperature_c: f32, ramp_c_per_min: f32) {
        let (entry, level) = ranges.place(temperature_c, ramp_c_per_min);
        let (entry, level) = nearest(entry, level);
        if let Some(levels) = self.visited_levels.get_mut(entry) {
            *levels = (*levels & 0xF).min(level) | (*levels >> 4).max(level) << 4;
        }
    }

    /// `true` if a state was visited, or lies within a level of ramps that were, at its temperature. Beyond the ranges nothing is known.
    #[must_use]
    pub fn knows(&self, ranges: &Ranges, temperature_c: f32, ramp_c_per_min: f32) -> bool {
        self.more_dph2(ranges, temperature_c, ramp_c_per_min, || 0.0).is_none()
    }

    /// Variance that comes on top of that of a bias in a state that is not known, (deg/h)^2; `None` for one that is. `bend_dph` gives by how
    /// much the baseline departs from a line from one eighth of the temperature range to the next, deg/h.
    #[inline]
    #[must_use]
    pub fn more_dph2(
        &self,
        ranges: &Ranges,
        temperature_c: f32,
        ramp_c_per_min: f32,
        bend_dph: impl FnOnce() -> f32,
    ) -> Option<f32> {
        let (entry, level) = ranges.place(temperature_c, ramp_c_per_min);
        let (number, own) = nearest(entry, level);
        let levels = self.visited_levels.get(number).copied().unwrap_or(0x0F);
        let (low, high) = (levels & 0xF, levels >> 4);
        let inside = low <= high && own + 1 >= low && own <= high + 1;
        let within = entry >= 0.0 && entry <= TEMPERATURES as f32 && level >= 0.0 && level <= LEVELS as f32;
        if inside && within {
            return None;
        }
        let [of_temperature, of_ramp] = eighths_beyond(entry, level).map(|n| n * n);
        let (unknown, bend_dph) = (if inside { 0.0 } else { 1.0 }, bend_dph());
        Some(self.unvisited_dph2 * (unknown + of_temperature + of_ramp) + bend_dph * bend_dph * of_temperature)
    }
}

/// Numbers of the entry and the level of places; beyond the ranges the first or last.
#[inline]
fn nearest(entry: f32, level: f32) -> (usize, u8) {
    // (A conversion of a float saturates, and NaN gives 0.)
    ((entry as usize).min(TEMPERATURES - 1), (level as u8).min(LEVELS as u8 - 1))
}

/// Distances beyond the ranges in eighths of them, from the places in entries and levels; 0 inside.
#[inline]
fn eighths_beyond(entry: f32, level: f32) -> [f32; 2] {
    let (entries, levels) = (TEMPERATURES as f32, LEVELS as f32);
    [(entry - clamp(entry, 0.0, entries)).abs(), (level - clamp(level, 0.0, levels)).abs() * (entries / levels)]
}

impl Ranges {
    /// The state in the middle of an entry and a level: temperature, C, and ramp, C per minute.
    #[must_use]
    pub fn middle(&self, entry: usize, level: usize) -> (f32, f32) {
        let at = |from: f32, to: f32, k: usize, of: f32| from + (to - from) * (k as f32 + 0.5) / of;
        (
            at(self.from_c, self.to_c, entry, TEMPERATURES as f32),
            at(self.from_c_per_min, self.to_c_per_min, level, LEVELS as f32),
        )
    }

    /// An eighth of the temperature range, C.
    #[inline]
    #[must_use]
    pub fn eighth_c(&self) -> f32 {
        (self.to_c - self.from_c) / TEMPERATURES as f32
    }

    /// Distances of a temperature and a ramp beyond their ranges, in eighths of the range; 0 inside.
    #[must_use]
    pub fn beyond(&self, temperature_c: f32, ramp_c_per_min: f32) -> [f32; 2] {
        let (entry, level) = self.place(temperature_c, ramp_c_per_min);
        eighths_beyond(entry, level)
    }

    /// Place of a temperature in entries and of a ramp in levels, from the lower end of each range on.
    #[inline]
    fn place(&self, temperature_c: f32, ramp_c_per_min: f32) -> (f32, f32) {
        (
            (temperature_c - self.from_c) / (self.to_c - self.from_c) * TEMPERATURES as f32,
            (ramp_c_per_min - self.from_c_per_min) / (self.to_c_per_min - self.from_c_per_min) * LEVELS as f32,
        )
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;

    const RANGES: Ranges = Ranges { from_c: -40.0, to_c: 60.0, from_c_per_min: -1.0, to_c_per_min: 3.0 };

    #[test]
    fn what_was_visited_is_known() {
        let mut map = Visited::none();
        let states: std::vec::Vec<(f32, f32)> =
            (0..200).map(|k| (k as f32 * 0.5 - 40.0, (k as f32 * 0.11).sin() * 2.0 + 1.0)).collect();
        for (t, r) in &states {
            assert!(Visited::default().knows(&RANGES, *t, *r));
            map.visit(&RANGES, *t, *r);
        }
        assert!(states.iter().all(|(t, r)| map.knows(&RANGES, *t, *r)));
    }

    #[test]
    fn nothing_is_known_of_what_was_not() {
        for k in 0..100 {
            assert!(!Visited::none().knows(&RANGES, k as f32 - 40.0, 0.0));
        }
        let mut map = Visited::none();
        map.visit(&RANGES, 10.0, 2.5);
        assert!(map.knows(&RANGES, 11.0, 2.6) && !map.knows(&RANGES, 11.0, 1.5) && !map.knows(&RANGES, 30.0, 2.5));
        // Beyond the ranges, and for no number, nothing is known.
        for (t, r) in
            [(1e9, 0.0), (-1e9, 1e9), (f32::NAN, f32::NAN), (60.01, 1.0), (-40.01, 1.0), (0.0, 3.01), (0.0, -1.01)]
        {
            assert!(!Visited::default().knows(&RANGES, t, r), "{t} {r}");
        }
    }

    #[test]
    fn the_uncertainty_grows_with_the_distance() {
        let map = Visited { unvisited_dph2: 0.04, ..Visited::default() };
        let more = |t, r| map.more_dph2(&RANGES, t, r, || 0.1);
        // Ends of the ranges; one eighth beyond and two (12.5 C, 0.5 C per minute), warm, cold and fast.
        assert_eq!([more(60.0, 1.0), more(-40.0, 1.0), more(0.0, 3.0)], [None; 3]);
        let near = |a: Option<f32>, b: f32| a.is_some_and(|a| (a - b).abs() < 1e-6);
        assert!(near(more(72.5, 1.0), 0.05) && near(more(-65.0, 1.0), 0.2) && near(more(0.0, 3.5), 0.04));
        let empty = Visited { unvisited_dph2: 0.04, ..Visited::none() };
        assert!(near(empty.more_dph2(&RANGES, 0.0, 0.0, || 0.1), 0.04));
    }
}
