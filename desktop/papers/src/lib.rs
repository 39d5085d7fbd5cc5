//! The four papers side by side: their methods of identification, and comparisons on the same data.
//!
//! | module | contents |
//! |---|---|
//! | [`method`] | the list of methods: model, search and objective |
//! | [`methods`] | coefficients by each of them |
//! | [`compare`] | every method on the same data, the trace beside them |
//! | [`wu2023`] | wu2023's loop on a simulated gyro with temperature sensors only |
#![forbid(unsafe_code)]

pub mod compare;
mod form;
mod four_parameter;
mod held_out;
mod hidden;
pub mod history;
pub mod method;
pub mod methods;
pub mod minimax;
pub mod network;
mod notes;
pub mod search;
pub mod stages;
pub mod swarm;
pub mod wu2023;
