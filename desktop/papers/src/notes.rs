//! Notes and histories that a method leaves beside its coefficients.

use crate::history::History;
use crate::stages::Stage;
use hrg_data::axes::AXIS_NAMES;

/// Notes and histories of an identification beside its coefficients.
pub(crate) struct Records<'a> {
    pub(crate) axis: usize,
    pub(crate) notes: &'a mut Vec<String>,
    pub(crate) history: &'a mut Vec<History>,
}

impl Records<'_> {
    /// A sentence about the axis.
    pub(crate) fn note(&mut self, text: impl AsRef<str>) {
        self.notes.push(format!("{}: {}", AXIS_NAMES[self.axis], text.as_ref()));
    }

    /// Adds the course of a search, and a note on its convergence.
    pub(crate) fn searched(&mut self, stage: Option<Stage>, make: impl FnOnce(String) -> History) {
        let axis = AXIS_NAMES[self.axis];
        let history = make(stage.map_or_else(|| axis.to_string(), |s| format!("{axis} {}", s.name())));
        self.notes.push(format!(
            "{}: within a thousandth of its end from iteration {} of {} on",
            history.of,
            history.settled_at() + 1,
            history.objective.len()
        ));
        self.history.push(history);
    }
}
