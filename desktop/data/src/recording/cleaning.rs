//! Takes out what cannot be true: rows out of order, stuck values, spikes. Each kind is found, counted and noted.

use super::columns::Column;
use super::steps::BRIDGE_S;
use super::thermometer::Thermometer;
use super::{columns, step_of, Recording};
use crate::error::BadInput;
use crate::numeric::side_by_side;
use crate::numeric::stats::median;
use hrg_core::AXES;
use std::sync::LazyLock;

/// Why a value was taken out of a recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Defect {
    /// The cell is empty or NaN.
    Missing,
    /// The row's time is missing, repeats, goes back or is far ahead: the whole row is left out.
    BadTime,
    /// The same value, to the last digit, for longer than this channel's resolution explains.
    Stuck,
    /// Far from its neighbours, by the scatter that the channel has at that time.
    Spike,
}

impl Defect {
    /// The name that stands in reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Missing => "missing",
            Self::BadTime => "bad-time",
            Self::Stuck => "stuck",
            Self::Spike => "spike",
        }
    }
}

/// Values of one column that were taken out for one reason.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Cleaned {
    /// Column, as the header names it.
    pub column: String,
    /// Why.
    pub defect: Defect,
    /// Number of values.
    pub count: usize,
}

impl Recording {
    /// Takes out rows whose time is missing, repeats, goes back or is far ahead, and notes it.
    ///
    /// # Errors
    /// If more than half of the rows would have to go, or fewer than two are left.
    pub fn order(&mut self) -> Result<(), BadInput> {
        let rows = self.time_s.len();
        if rows > 1 && self.in_order() {
            return Ok(());
        }
        // Rows whose time is missing, repeats or goes back.
        let mut keep = vec![true; rows];
        let mut last = f64::NEG_INFINITY;
        let (mut bad_times, mut first_bad) = (0usize, None);
        let mut ahead = 0usize;
        for k in 0..rows {
            let t = self.time_s[k];
            if t > last {
                // A single time far ahead of its neighbours would throw all later rows out.
                let jumps_ahead =
                    k + 1 < rows && self.time_s[k + 1] <= t && self.time_s[k + 1] > last && t - last > 10.0;
                if jumps_ahead {
                    ahead += 1;
                } else {
                    last = t;
                    continue;
                }
            }
            keep[k] = false;
            bad_times += 1;
            first_bad.get_or_insert(k + 1);
        }
        if let Some(first) = first_bad {
            self.cleaned.push(Cleaned {
                column: columns::TIME.name(0).into(),
                defect: Defect::BadTime,
                count: bad_times,
            });
            self.notes.push(format!(
                "{bad_times} rows have a time that is missing, repeats or goes back{}, the first is row {first} of the data: left out{}",
                if ahead > 0 { format!(", or is far ahead of the next ({ahead} of them)") } else { String::new() },
                if bad_times * 4 > rows {
                    "; where the clock is coarser than the rows, give the seconds between rows in its place (step_s in a map, time_step_s in the metadata)"
                } else {
                    ""
                }
            ));
        }
        if rows < 2 {
            return Err(BadInput("there is one row of data; a recording is many, one a second for instance".into()));
        }
        if bad_times * 2 > rows || rows - bad_times < 2 {
            return Err(BadInput(format!(
                "column time_s: {bad_times} of {rows} rows have a time that does not increase, the first is row {} of the data; one recording is one power-on, in order of time",
                first_bad.unwrap_or(1)
            )));
        }
        if bad_times > 0 {
            let mut k = 0;
            let flags = keep.clone();
            self.time_s.retain(|_| {
                k += 1;
                flags[k - 1]
            });
            for column in self.columns_mut() {
                let mut k = 0;
                column.retain(|_| {
                    k += 1;
                    keep[k - 1]
                });
            }
        }
        Ok(())
    }

    /// `true` if each row has a time after that of the row before.
    fn in_order(&self) -> bool {
        increase(&self.time_s) && self.time_s.first().is_some_and(|t| !t.is_nan())
    }

    /// Takes out what cannot be true, and notes it.
    ///
    /// # Errors
    /// As [`Recording::order`]; and if more than half of the values of a channel would have to go.
    pub fn clean(&mut self) -> Result<(), BadInput> {
        self.cleaned_values().map(drop)
    }

    /// The same; gives what it takes to have the recording as it was.
    ///
    /// # Errors
    /// As [`Recording::clean`].
    pub fn clean_keeping(&mut self) -> Result<Original, BadInput> {
        // Rows that go, and rates that change throughout, take a second recording to bring back.
        let same_rates = self.without_earth_rate() || self.attitude()?.is_none();
        if !(self.in_order() && same_rates) || self.turned() || self.reads_zero() {
            let before = self.copied();
            self.clean()?;
            return Ok(Original::Whole(Box::new(before)));
        }
        let (notes, cleaned) = (self.notes.clone(), self.cleaned.clone());
        let values = self.cleaned_values()?;
        Ok(Original::Changes { values, notes, cleaned })
    }

    /// Cleans, and gives the values that were taken out of each of [`Self::columns_mut`].
    fn cleaned_values(&mut self) -> Result<Vec<Vec<(usize, f64)>>, BadInput> {
        self.order()?;
        let (mut found, step) = self.defects_taken_out();
        self.movement_taken_out(&mut found, step);
        self.note_gaps(&found, step);
        let rows = self.time_s.len();
        for Found { column, stuck, spikes, .. } in &found {
            if *stuck > 0 {
                self.notes
                    .push(format!("column {column}: {stuck} values stand still exactly (a stuck value): left out"));
                self.cleaned.push(Cleaned { column: column.clone(), defect: Defect::Stuck, count: *stuck });
            }
            if *spikes > 0 {
                self.notes
                    .push(format!("column {column}: {spikes} spike{} left out", if *spikes == 1 { "" } else { "s" }));
                self.cleaned.push(Cleaned { column: column.clone(), defect: Defect::Spike, count: *spikes });
            }
        }
        if let Some(bad) = found.iter().find(|f| f.needed && f.finite * 2 < rows) {
            return Err(BadInput(format!(
                "column {}: only {} of {rows} values can be used; check that channel",
                bad.column, bad.finite
            )));
        }
        let turned = self.turned();
        for f in found.iter().filter(|f| f.spikes > 0 && !turned && (AXES..2 * AXES).contains(&f.place)) {
            // (What was taken: stuck values, then spikes, then stretches of movement.)
            let spikes = f.taken[f.stuck..f.stuck + f.spikes].iter();
            self.rate_spikes.extend(spikes.map(|(row, v)| (f.place - AXES, self.time_s[*row], *v)));
        }
        self.remove_earth_rate()?;
        self.note_unlikely(step)?;
        let mut values = vec![Vec::new(); self.columns_mut().count()];
        found.into_iter().for_each(|f| values[f.place] = f.taken);
        Ok(values)
    }

    /// Notes gaps in time, and those of a thermometer that are not bridged.
    fn note_gaps(&mut self, found: &[Found], step_s: f64) {
        let behind = format!(
            "behind a gap of more than {BRIDGE_S:.0} s it is not known what a unit remembers: the rates of the first {BRIDGE_S:.0} s are left out of fits and judgements, and what decays from there on counts as unknown"
        );
        let gaps = self.time_s.windows(2).filter(|w| w[1] - w[0] > 1.5 * step_s + 1e-9).count();
        let longest = self.time_s.windows(2).map(|w| w[1] - w[0]).fold(0.0, f64::max);
        if gaps > 0 {
            let more = if longest > BRIDGE_S { format!("; {behind}") } else { String::new() };
            let digits = if longest < 1.0 { 3 } else { 1 };
            self.notes.push(format!("{gaps} gaps in time, the longest {longest:.digits$} s{more}"));
        }
        for Found { column, place, .. } in found.iter().filter(|f| f.place < AXES) {
            // (Rows that are there and hold no value: a gap in time is none of the column.)
            let values = &self.frequency_hz[*place];
            let finite = |v: &f64| v.is_finite();
            let (first, last) = (values.iter().position(finite), values.iter().rposition(finite));
            let (Some(first), Some(last)) = (first, last) else { continue };
            let alike = values[first..=last].chunk_by(|a, b| a.is_finite() == b.is_finite());
            let without = alike.filter(|c| !c[0].is_finite()).map(|c| c.len() as f64 * step_s).fold(0.0, f64::max);
            if without > BRIDGE_S {
                self.notes.push(format!("column {column} has no value for {without:.0} s; {behind}"));
            }
        }
    }

    /// Takes the rates of the rows in which the unit moved out, and notes it.
    fn movement_taken_out(&mut self, found: &mut [Found], step_s: f64) {
        let moving = self.moving_rows(step_s);
        let Some(first) = moving.first() else { return };
        let seconds: f64 = moving.iter().map(|rows| rows.len() as f64 * step_s).sum();
        self.notes.push(format!(
            "the unit moves in {seconds:.0} s of {:.0} s, the first at {:.0} s: the rates of these stretches are left out",
            self.time_s.len() as f64 * step_s,
            self.time_s[first.start]
        ));
        for f in found.iter_mut().filter(|f| (AXES..2 * AXES).contains(&f.place)) {
            let values = &mut self.rate_dph[f.place - AXES];
            for row in moving.iter().cloned().flatten() {
                if values[row].is_finite() {
                    f.taken.push((row, values[row]));
                    values[row] = f64::NAN;
                    f.finite -= 1;
                }
            }
        }
    }

    /// Takes stuck values and spikes out of all columns, side by side; gives the step, too.
    fn defects_taken_out(&mut self) -> (Vec<Found>, f64) {
        let thermometer = self.thermometer;
        let axes: Vec<usize> = self.present().collect();
        // A step of a table is no spike of a gyro: spikes are sought in what is left without its rate.
        let turned = self.table_rate_dph().map(|table| (self.rate_dph.clone(), table));
        if let Some((_, table)) = &turned {
            let pairs = self.rate_dph.iter_mut().flatten().zip(table.iter().flatten());
            pairs.for_each(|(r, t)| *r -= t);
        }
        let largest = turned.iter().flat_map(|(_, table)| table.iter().flatten()).fold(0.0f64, |m, t| m.max(t.abs()));
        let least_dph = TABLE_SHARE * largest;
        // (Taken for now, as the columns are lent.)
        let time_s = std::mem::take(&mut self.time_s);
        let step = LazyLock::new(|| step_of(&time_s));
        let names: Vec<&str> = self.optional.iter().map(|(name, _)| *name).collect();
        let mut jobs: Vec<(Found, Cells, Option<&mut Vec<f64>>)> = Vec::new();
        for (place, values) in self.columns_mut().enumerate() {
            let (column, cells) = match place / AXES {
                0 if !axes.contains(&place) || thermometer == Thermometer::None => continue,
                0 if thermometer == Thermometer::Frequency => (thermometer.column(place), Cells::Frequency),
                // (One sensor for all axes is counted once.)
                0 if !thermometer.parts_axes() && place != axes[0] => ("", Cells::Sensor),
                0 => (thermometer.column(place), Cells::Sensor),
                1 if !axes.contains(&(place - AXES)) => continue,
                1 => (columns::RATE.name(place - AXES), Cells::Rate),
                _ if STEPPED.iter().any(|c| c.names.contains(&names[place - 2 * AXES])) => continue,
                _ => (names[place - 2 * AXES], Cells::Sensor),
            };
            let found = Found { column: column.into(), place, needed: place < 2 * AXES, ..Found::default() };
            jobs.push((found, cells, Some(values)));
        }
        // (By axis, as sentences go.)
        jobs.sort_by_key(|(found, _, _)| (!found.needed, if found.needed { found.place % AXES } else { found.place }));
        // The step takes as long as a column, and is rarely asked for.
        jobs.insert(0, (Found::default(), Cells::Sensor, None));
        let mut found = side_by_side::each(jobs, |(mut found, cells, values)| {
            let Some(values) = values else {
                LazyLock::force(&step);
                return found;
            };
            let (repeats, finite) = repeats_and_finite(values);
            let taken = &mut found.taken;
            (found.stuck, found.spikes) = match cells {
                Cells::Frequency => {
                    (remove_stuck(values, repeats, &step, taken), remove_spikes(values, 8.0, 5e-4, taken))
                }
                Cells::Rate => {
                    (remove_stuck(values, repeats, &step, taken), remove_spikes(values, 6.5, least_dph, taken))
                }
                // Coarse sensors stand still for long by nature: spikes, and zeros of a sensor that is gone.
                Cells::Sensor => {
                    let spikes = remove_spikes(values, 12.0, 0.01, taken);
                    (remove_zeros(values, *step, taken), spikes)
                }
            };
            found.finite = finite - found.taken.iter().filter(|(_, v)| v.is_finite()).count();
            found
        });
        found.remove(0);
        let step_s = *step;
        drop(step);
        self.time_s = time_s;
        if let Some((measured, _)) = turned {
            let pairs = self.rate_dph.iter_mut().flatten().zip(measured.into_iter().flatten());
            pairs.filter(|(left, _)| left.is_finite()).for_each(|(left, measured)| *left = measured);
        }
        found.iter_mut().filter(|f| f.column.is_empty()).for_each(|f| (f.stuck, f.spikes) = (0, 0));
        (found, step_s)
    }
}

/// Columns whose values step as a table does.
const STEPPED: [Column; 3] = [columns::TABLE_RATE, columns::TABLE_FORCE, columns::FORCE];

/// Defects found in a column.
#[derive(Default)]
struct Found {
    /// Its name; empty for a copy of another.
    column: String,
    /// Index in [`Recording::columns_mut`].
    place: usize,
    /// Set if a recording is useless without it.
    needed: bool,
    stuck: usize,
    spikes: usize,
    /// Values that are left.
    finite: usize,
    /// Values that were taken out, by their rows.
    taken: Vec<(usize, f64)>,
}

/// Data that restore a recording to its state before cleaning.
#[derive(Debug, Clone)]
pub enum Original {
    /// The recording.
    Whole(Box<Recording>),
    /// Changes that cleaning made.
    Changes {
        /// Values of each column, by their rows.
        values: Vec<Vec<(usize, f64)>>,
        /// Notes before.
        notes: Vec<String>,
        /// Values that were taken out before.
        cleaned: Vec<Cleaned>,
    },
}

impl Original {
    /// The recording as it was, from the one that became of it.
    #[must_use]
    pub fn of(&self, clean: &Recording) -> Recording {
        match self {
            Self::Whole(before) => before.copied(),
            Self::Changes { values, notes, cleaned } => {
                let mut before = clean.copied();
                (before.notes, before.cleaned) = (notes.clone(), cleaned.clone());
                before.rate_spikes.clear();
                for (column, values) in before.columns_mut().zip(values) {
                    // (The last first: a value that was taken out twice was NaN the second time.)
                    values.iter().rev().for_each(|(row, value)| column[*row] = *value);
                }
                before
            }
        }
    }
}

/// Quantity in the cells of a column.
#[derive(Clone, Copy)]
enum Cells {
    Frequency,
    Rate,
    Sensor,
}

/// Counts the values that equal their successor, and the finite values.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2"))]
fn repeats_and_finite(values: &[f64]) -> (usize, usize) {
    let (mut repeats, mut finite) = (0u64, u64::from(values.last().is_some_and(|v| v.is_finite())));
    for (v, next) in values.iter().zip(values.get(1..).unwrap_or_default()) {
        repeats += u64::from(v == next);
        finite += u64::from(v.is_finite());
    }
    (repeats as usize, finite as usize)
}

/// `true` if each value is larger than the one before.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2"))]
fn increase(values: &[f64]) -> bool {
    let pairs = values.iter().zip(values.get(1..).unwrap_or_default());
    pairs.map(|(v, next)| u64::from(v < next)).sum::<u64>() + 1 >= values.len() as u64
}

/// Removes runs of exactly equal values: no measured frequency or rate repeats to the last digit for long. The length of a long run depends
/// on how often this channel repeats by its resolution alone.
fn remove_stuck(
    values: &mut [f64],
    repeats: usize,
    step_s: &LazyLock<f64, impl FnOnce() -> f64>,
    taken: &mut Vec<(usize, f64)>,
) -> usize {
    let pairs = values.len().saturating_sub(1).max(1);
    if is_coarse(values, repeats) {
        return 0;
    }
    // With a share p of natural repeats a run of n has odds p^n; ask for one in 1e9, and for 8 rows at least.
    let share = (repeats as f64 / pairs as f64).clamp(0.01, 0.999);
    let natural = (1e-9f64.ln() / share.ln()).ceil();
    let least = natural.max(8.0);
    if (repeats as f64) < least {
        // No run is as long.
        return 0;
    }
    let longest = least.max(10.0 / step_s.max(1e-3)).min(1e9) as usize;
    let (mut k, mut removed) = (0, 0);
    // A run that is too long has a pair of equal values at each so many rows.
    while k + 1 < values.len() {
        let value = values[k];
        if value != values[k + 1] {
            k += longest;
            continue;
        }
        let start = values[..k].iter().rposition(|v| *v != value).map_or(0, |at| at + 1);
        let end = values[k..].iter().position(|v| *v != value).map_or(values.len(), |n| k + n);
        if end - start > longest {
            taken.extend((start + 1..end).map(|row| (row, value)));
            values[start + 1..end].fill(f64::NAN);
            removed += end - start - 1;
        }
        k = end.next_multiple_of(longest);
    }
    removed
}

/// `true` for a channel whose steps are far above its noise: then it stands still by nature, as a coarse sensor does, also without the
/// longest of its runs of equal values (which may be a stuck one).
fn is_coarse(values: &[f64], repeats: usize) -> bool {
    const SHARE: f64 = 0.9;
    if repeats * 2 < values.len() {
        return false;
    }
    let longest = values.chunk_by(|a, b| a == b).map(<[f64]>::len).max().unwrap_or(0);
    let others = values.len() - longest;
    others * 4 > values.len() && (repeats + 1 - longest) as f64 > SHARE * others as f64
}

/// Shortest time that a sensor reads zero once it is gone, s.
const GONE_S: f64 = 60.0;
/// A sensor that falls to zero from so far away at once is gone (C, V).
const FALL: f64 = 2.0;

/// Removes long runs of exact zeros into which, or out of which, a sensor leaps: it was not there.
fn remove_zeros(values: &mut [f64], step_s: f64, taken: &mut Vec<(usize, f64)>) -> usize {
    let least = (GONE_S / step_s.max(1e-3)).ceil().max(3.0) as usize;
    let (mut k, mut removed) = (0, 0);
    while let Some(start) = values[k..].iter().position(|v| *v == 0.0).map(|n| k + n) {
        let end = values[start..].iter().position(|v| *v != 0.0).map_or(values.len(), |n| start + n);
        let far = |v: Option<&f64>| v.is_some_and(|v| v.abs() > FALL);
        let before = values[..start].iter().rfind(|v| v.is_finite());
        let after = values[end..].iter().find(|v| v.is_finite());
        if end - start >= least && (far(before) || far(after)) {
            taken.extend((start..end).map(|row| (row, 0.0)));
            values[start..end].fill(f64::NAN);
            removed += end - start;
        }
        k = end;
    }
    removed
}

/// On a rate table scale factor, misalignment and the earth's rate, which goes round, step by this share of its rate and less: only what is
/// further off is a spike.
const TABLE_SHARE: f64 = 0.005;

/// Half the neighbours of a value in [`remove_spikes`], without itself.
const HALF: usize = 5;

/// Values that share one estimate of the scatter in [`remove_spikes`]: some minutes at 1 Hz.
const SCATTER_ROWS: usize = 512;

/// Median of the finite values among a value and its ten nearest neighbours; NaN where none is finite.
fn running_median(values: &[f64], k: usize) -> f64 {
    let from = k.saturating_sub(HALF).min(values.len() - 2 * HALF - 1);
    let mut w = [0.0; 2 * HALF + 1];
    let mut m = 0;
    for v in &values[from..=from + 2 * HALF] {
        if v.is_finite() {
            w[m] = *v;
            m += 1;
        }
    }
    // Eleven values: sorting by insertion beats selection.
    for i in 1..m {
        let v = w[i];
        let mut j = i;
        while j > 0 && w[j - 1] > v {
            w[j] = w[j - 1];
            j -= 1;
        }
        w[j] = v;
    }
    if m > 0 {
        w[m / 2]
    } else {
        f64::NAN
    }
}

/// Robust scatter of the values about their running median, at even places along the column: noise may grow with
/// temperature, so one scatter for the whole column would take true samples of its loud part for spikes.
struct Scatter {
    places: Vec<f64>,
    length: f64,
}

impl Scatter {
    /// `None` where the column has no scatter at all. Deviations below `harmless` count as that.
    fn of(values: &[f64], harmless: f64) -> Option<Self> {
        let n = values.len();
        let count = (n / SCATTER_ROWS).clamp(1, 64);
        let stride = (n / (count * 250)).max(1);
        let off: Vec<f64> = (0..n)
            .step_by(stride)
            .map(|k| (values[k] - running_median(values, k)).abs())
            .filter(|d| d.is_finite())
            .collect();
        if off.is_empty() {
            return None;
        }
        // Quantised columns may have no spread at all at their median: then one step of resolution counts.
        let resolution = off.iter().copied().filter(|d| *d > 0.0).fold(f64::INFINITY, f64::min);
        let least = if resolution.is_finite() { resolution.max(harmless) } else { harmless };
        if least <= 0.0 {
            return None;
        }
        let per_place = off.len().div_ceil(count).max(1);
        let own: Vec<f64> = off.chunks(per_place).map(|c| 1.4826 * median(&mut c.to_vec()).unwrap_or(0.0)).collect();
        // A place is as loud as the louder of its neighbours: the change from one to the next is not sharp.
        let places = (0..own.len())
            .map(|k| own[k.saturating_sub(1)..(k + 2).min(own.len())].iter().fold(least, |m, v| m.max(*v)))
            .collect();
        Some(Self { places, length: n as f64 })
    }

    fn place(&self, k: usize) -> usize {
        ((k as f64 / self.length * self.places.len() as f64) as usize).min(self.places.len() - 1)
    }

    /// The least scatter from one place to another.
    fn least(&self, from: usize, to: usize) -> f64 {
        self.places[self.place(from)..=self.place(to - 1)].iter().fold(f64::INFINITY, |m, s| m.min(*s))
    }

    /// The scatter at places from one on. (The places are steps: a scatter that is the same at both ends is so between.)
    fn along(&self, from: usize, out: &mut [f64]) {
        let place = |k: usize| self.place(k);
        let (first, last) = (place(from), place(from + out.len().max(1) - 1));
        if first == last {
            out.fill(self.places[first]);
        } else {
            out.iter_mut().enumerate().for_each(|(k, s)| *s = self.places[place(from + k)]);
        }
    }
}

/// Hampel filter: values further than `limit` times the scatter from the median of 11 neighbours. Deviations
/// below `harmless` count as that (a frequency of 0.5 mHz is 1 mK).
///
/// A spike is rare. If more than [`MOST_SPIKES`] of the values are that far off, the scatter is not the cause (a coarse resolution hides
/// it, or the channel moves fast): the limit is doubled until spikes are rare.
fn remove_spikes(values: &mut [f64], limit: f64, harmless: f64, taken: &mut Vec<(usize, f64)>) -> usize {
    if values.len() < 2 * HALF + 1 {
        return 0;
    }
    let Some(scatter) = Scatter::of(values, harmless) else { return 0 };
    let most = (MOST_SPIKES * values.len() as f64) as usize;
    let mut spikes = spikes(values, limit, &scatter);
    let mut wider = limit;
    while spikes.len() > most.max(8) {
        wider *= 2.0;
        spikes = self::spikes(values, wider, &scatter);
    }
    let removed = spikes.len();
    taken.extend(spikes.iter().map(|k| (*k, values[*k])));
    spikes.into_iter().for_each(|k| values[k] = f64::NAN);
    removed
}

/// Share of a column that may be spikes.
const MOST_SPIKES: f64 = 0.02;

/// Values whose neighbours are looked at together.
const TOGETHER: usize = 256;

/// Counts the neighbours of each value that are not further from it than `near`, itself among them. `around` begins [`HALF`] before the
/// first value and ends as many behind the last.
#[multiversion::multiversion(targets("x86_64+avx2", "x86_64+avx512f"))]
fn close_neighbours(around: &[f64], near: &[f64; TOGETHER], close: &mut [f64; TOGETHER]) {
    close.fill(0.0);
    let n = around.len().saturating_sub(2 * HALF).min(TOGETHER);
    for d in 0..=2 * HALF {
        let (own, other) = (&around[HALF..HALF + n], &around[d..d + n]);
        for (((c, v), w), near) in close.iter_mut().zip(own).zip(other).zip(near) {
            *c += if (w - v).abs() <= *near { 1.0 } else { 0.0 };
        }
    }
}

/// The least and the largest value; NaN does not count.
#[multiversion::multiversion(targets("x86_64+avx512f", "x86_64+avx2"))]
fn range(values: &[f64]) -> (f64, f64) {
    let mut ranges = [(f64::INFINITY, f64::NEG_INFINITY); 16];
    let (chunks, rest) = values.as_chunks::<16>();
    let widen = |(least, most): &mut (f64, f64), v: f64| {
        *least = if v < *least { v } else { *least };
        *most = if v > *most { v } else { *most };
    };
    chunks.iter().for_each(|chunk| ranges.iter_mut().zip(chunk).for_each(|(range, v)| widen(range, *v)));
    ranges.iter_mut().zip(rest).for_each(|(range, v)| widen(range, *v));
    ranges.iter().fold(ranges[0], |(least, most), (l, m)| (least.min(*l), most.max(*m)))
}

/// Places of the values further than `limit` times the scatter from the median of their neighbours.
fn spikes(values: &[f64], limit: f64, scatter: &Scatter) -> Vec<usize> {
    let n = values.len();
    let mut spikes = Vec::new();
    let (mut near, mut close) = ([0.0; TOGETHER], [0.0; TOGETHER]);
    for from in (0..n).step_by(TOGETHER) {
        let to = (from + TOGETHER).min(n);
        // No value is a spike if all values and their neighbours lie closer together than the limit: true nearly everywhere.
        let (least, most) = range(&values[from.saturating_sub(HALF)..(to + HALF).min(n)]);
        if from >= HALF && to + HALF <= n && most - least <= limit * scatter.least(from, to) {
            continue;
        }
        scatter.along(from, &mut near[..to - from]);
        near.iter_mut().for_each(|s| *s *= limit);
        // Values at the ends of the column have no such neighbours.
        let (first, last) = (from.max(HALF), to.min(n - HALF));
        close.fill(0.0);
        if first == from && first < last {
            close_neighbours(&values[first - HALF..last + HALF], &near, &mut close);
        }
        for k in from..to {
            // More than half of the neighbours (itself among them) are near: then so is their median, and it need not be found.
            if close[k - from] <= HALF as f64 && is_spike(values, k, near[k - from]) {
                spikes.push(k);
            }
        }
    }
    spikes
}

/// `true` if a value is further than `near` from the median of its neighbours.
fn is_spike(values: &[f64], k: usize, near: f64) -> bool {
    let n = values.len();
    // Values at the ends have neighbours on one side only: a ramp may lead away from their median.
    let ramp = if k < HALF {
        3.0 * (running_median(values, HALF) - running_median(values, (3 * HALF).min(n - 1))).abs()
    } else if k >= n - HALF {
        3.0 * (running_median(values, n - 1 - HALF) - running_median(values, (n - 1).saturating_sub(3 * HALF))).abs()
    } else {
        0.0
    };
    (values[k] - running_median(values, k)).abs() > near + ramp
}

#[cfg(test)]
mod tests {
    use super::super::samples::{rows, HEAD};
    use super::*;

    #[test]
    fn coarse_channels_stand_still_by_nature() {
        let of = |v: &[f64]| is_coarse(v, v.windows(2).filter(|w| w[0] == w[1]).count());
        let steps: Vec<f64> = (0..3000).map(|k| 220.0 * f64::from(k / 400)).collect();
        let stuck: Vec<f64> = (0..3000).map(|k| if k > 600 { 1.5 } else { f64::from(k % 7) }).collect();
        assert!(of(&steps) && !of(&stuck) && !of(&[1.0; 100]));
    }

    #[test]
    fn a_sensor_that_is_gone_reads_zeros() {
        let of = |low: f64, jump: f64| -> (usize, usize) {
            let mut v: Vec<f64> = (0..600).map(|k| if (100..300).contains(&k) { 0.0 } else { low + jump }).collect();
            let mut taken = Vec::new();
            (remove_zeros(&mut v, 1.0, &mut taken), v.iter().filter(|v| v.is_nan()).count())
        };
        assert_eq!((of(0.0, 21.5), of(0.0, 0.5), of(-20.0, 0.0)), ((200, 200), (0, 0), (200, 200)));
    }

    #[test]
    fn defects_are_counted_and_taken_out() {
        let mut lines: Vec<String> = rows(300).lines().map(String::from).collect();
        lines[50] = lines[49].clone(); // repeated time
        lines[100] = "98,4900.01,4890.01,4700,900,2,3".into(); // spike
        lines[120] = "118,,4890.01,4700,1,2,3".into(); // missing
        for (k, line) in lines.iter_mut().enumerate().take(250).skip(200) {
            *line = format!("{},4900.05,4890.05,4699.9,1.5,1.9,3.1", k - 2); // stuck
        }
        let mut r = Recording::parse(lines.join("\r\n").as_bytes()).expect("readable");
        r.clean().expect("usable");
        let notes = r.notes.join("\n");
        for word in ["1 values are missing, the first at line 121, column 2 (fx_hz)", "repeats", "spikes", "stuck"] {
            assert!(notes.contains(word), "{word} not in {notes}");
        }
        assert_eq!(r.time_s.len(), 299);
    }

    #[test]
    fn spikes_are_those_of_the_definition() {
        let mut draws = crate::numeric::draws::Draws::new(7);
        for n in [11, 12, 20, 255, 256, 257, 266, 1000, 5000] {
            let mut values: Vec<f64> = (0..n).map(|_| (draws.bits() % 1000) as f64).collect();
            for k in (3..n).step_by(37) {
                values[k] = if k % 2 == 0 { f64::NAN } else { 1e5 * (k % 3) as f64 };
            }
            let Some(scatter) = Scatter::of(&values, 0.0) else { panic!("{n}: it scatters") };
            for limit in [0.5, 2.0, 6.5] {
                let near = |k: usize| {
                    let mut s = [0.0];
                    scatter.along(k, &mut s);
                    limit * s[0]
                };
                let wanted: Vec<usize> = (0..n).filter(|&k| is_spike(&values, k, near(k))).collect();
                assert_eq!(spikes(&values, limit, &scatter), wanted, "{n} values, limit {limit}");
                assert!(limit > 1.0 || !wanted.is_empty());
            }
        }
    }

    #[test]
    fn what_was_cleaned_comes_back_to_the_bit() {
        let mut lines: Vec<String> = rows(300).lines().map(String::from).collect();
        lines[100] = "98,4900.01,4890.01,4700,900,2,3".into();
        lines[120] = "118,,4890.01,4700,1,2,3".into();
        for (k, line) in lines.iter_mut().enumerate().take(250).skip(200) {
            *line = format!("{},4900.05,4890.05,4699.9,1.5,1.9,3.1", k - 2);
        }
        let plain = lines.join("\n");
        let at_an_attitude = plain.replace("# unit: A", "# unit: A\n# latitude_deg: 30\n# axes: x=north y=east z=down");
        let mut disordered = lines.clone();
        disordered.swap(30, 31);
        for (text, whole) in [(plain, false), (at_an_attitude, true), (disordered.join("\n"), true)] {
            let before = Recording::parse(text.as_bytes()).expect("readable");
            let (mut clean, mut alone) = (before.clone(), before.clone());
            let original = clean.clean_keeping().expect("usable");
            alone.clean().expect("usable");
            assert_eq!(matches!(original, Original::Whole(_)), whole);
            // (NaN is not equal to itself.)
            assert_eq!(format!("{clean:?}"), format!("{alone:?}"));
            assert!(clean.notes.len() > before.notes.len());
            assert_eq!(format!("{:?}", original.of(&clean)), format!("{before:?}"));
        }
    }

    #[test]
    fn stuck_values_are_those_of_runs_that_are_too_long() {
        let mut draws = crate::numeric::draws::Draws::new(5);
        let mut stuck = 0;
        for n in [1, 2, 9, 50, 1000, 3000] {
            for _ in 0..50 {
                let mut values: Vec<f64> = Vec::new();
                while values.len() < n {
                    let run = if draws.bits().is_multiple_of(60) { draws.bits() % 200 } else { 1 };
                    let value = if draws.bits().is_multiple_of(30) { f64::NAN } else { (draws.bits() % 100) as f64 };
                    values.extend((0..run).map(|_| value));
                }
                values.truncate(n);
                let (repeats, finite) = repeats_and_finite(&values);
                assert_eq!(repeats, values.windows(2).filter(|w| w[0] == w[1]).count());
                assert_eq!(finite, values.iter().filter(|v| v.is_finite()).count());
                let share = (repeats as f64 / (n - 1).max(1) as f64).clamp(0.01, 0.999);
                let longest = (1e-9f64.ln() / share.ln()).ceil().max(10.0) as usize;
                // Run by run.
                let mut wanted = values.clone();
                let mut start = 0;
                for k in 1..=n {
                    if k < n && values[k] == values[start] {
                        continue;
                    }
                    if k - start > longest {
                        wanted[start + 1..k].fill(f64::NAN);
                    }
                    start = k;
                }
                let (mut found, mut taken) = (values.clone(), Vec::new());
                let removed = remove_stuck(&mut found, repeats, &LazyLock::new(|| 1.0), &mut taken);
                assert_eq!(format!("{found:?}"), format!("{wanted:?}"));
                assert_eq!(removed, taken.len());
                taken.iter().for_each(|(row, value)| assert_eq!(*value, values[*row]));
                stuck += removed;
            }
        }
        assert!(stuck > 1000, "{stuck}");
    }

    #[test]
    fn a_range_is_that_of_the_values() {
        let mut draws = crate::numeric::draws::Draws::new(3);
        for n in 1..200 {
            let values: Vec<f64> =
                (0..n).map(|k| if k % 7 == 3 { f64::NAN } else { draws.bits() as f64 - 1e19 }).collect();
            let least = values.iter().copied().fold(f64::INFINITY, f64::min);
            let most = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            assert_eq!(range(&values), (least, most));
        }
    }

    #[test]
    fn a_column_without_a_value_has_no_spikes() {
        assert_eq!(remove_spikes(&mut [f64::NAN; 50], 8.0, 5e-4, &mut Vec::new()), 0);
        let mut r = Recording::parse(rows(50).replace(",4900", ",nan,4900").as_bytes());
        assert!(r.is_err(), "the cells no longer fit the header");
        r = Recording::parse((HEAD.to_string() + &"1,,2,3,4,5,6\n".repeat(50)).as_bytes());
        assert!(r.expect("readable").clean().is_err());
    }

    #[test]
    fn noise_that_grows_is_not_taken_for_spikes() {
        use rand::SeedableRng;
        use rand_distr::{Distribution, StandardNormal};
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(4);
        let n = 20_000;
        // Twenty times as loud at one end as at the other.
        let mut v: Vec<f64> = (0..n)
            .map(|k| {
                let x: f64 = StandardNormal.sample(&mut rng);
                x * (1.0 + 19.0 * k as f64 / n as f64)
            })
            .collect();
        for k in (50..n).step_by(500) {
            v[k] = 400.0;
        }
        let removed = remove_spikes(&mut v, 6.5, 0.0, &mut Vec::new());
        assert!((50..n).step_by(500).all(|k| v[k].is_nan()), "the spikes are found");
        assert!(removed <= 40 + n / 1000, "{removed} removed");
    }

    #[test]
    fn a_coarse_channel_that_moves_is_not_taken_for_spikes() {
        // It stands still for most of the time, so that its scatter is that of its resolution, and moves in one row of five.
        let mut level = 0;
        let mut v: Vec<f64> = (0..5000u64)
            .map(|k| {
                let x = k.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 40;
                level += if x % 5 == 0 { [-6, 6, -4, 4][(x / 5 % 4) as usize] } else { 0 };
                f64::from(level) * 0.1
            })
            .collect();
        v[1000] += 60.0;
        v[3000] -= 60.0;
        let removed = remove_spikes(&mut v, 6.5, 0.0, &mut Vec::new());
        assert!(v[1000].is_nan() && v[3000].is_nan());
        assert!(removed <= 100, "{removed} removed");
    }

    #[test]
    fn gaps_that_are_not_bridged_are_noted() {
        let notes = |text: String| {
            let mut r = Recording::parse(text.as_bytes()).expect("readable");
            r.clean().expect("usable");
            r.notes.join("\n")
        };
        let all = rows(3000);
        assert!(!notes(all.clone()).contains("gap"));
        let outside = |k: &usize| !(1000..2500).contains(k);
        let gap: Vec<&str> = all.lines().enumerate().filter(|(k, _)| outside(k)).map(|(_, l)| l).collect();
        let text = notes(gap.join("\n"));
        assert!(
            text.contains("1 gaps in time") && text.matches("behind a gap of more than 900 s").count() == 1,
            "{text}"
        );
        let cut = |(k, l): (usize, &str)| {
            let cells: Vec<&str> = l.split(',').collect();
            let kept = |(n, c): (usize, &&str)| if n == 2 && !outside(&k) { String::new() } else { (*c).to_string() };
            cells.iter().enumerate().map(kept).collect::<Vec<_>>().join(",")
        };
        let lost: Vec<String> = all.lines().enumerate().map(cut).collect();
        let text = notes(lost.join("\n"));
        assert!(text.contains("column fy_hz has no value for 1500 s; behind a gap"), "{text}");
    }

    #[test]
    fn what_was_taken_out_is_counted_by_column_and_kind() {
        let mut lines: Vec<String> = rows(300).lines().map(String::from).collect();
        lines[100] = "98,4900.01,4890.01,4700,900,2,3".into();
        lines[120] = "118,,4890.01,4700,1,2,3".into();
        let mut r = Recording::parse(lines.join("\n").as_bytes()).expect("readable");
        r.clean().expect("usable");
        let of = |column: &str, defect: Defect| {
            r.cleaned.iter().find(|c| c.column == column && c.defect == defect).map_or(0, |c| c.count)
        };
        assert_eq!((of("fx_hz", Defect::Missing), of("rate_x_dph", Defect::Spike)), (1, 1), "{:?}", r.cleaned);
        assert_eq!(r.cleaned.len(), 2, "{:?}", r.cleaned);
    }
}
