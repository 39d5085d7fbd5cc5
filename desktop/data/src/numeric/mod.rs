//! Numbers: least squares ([`lsq`]), means and quantiles ([`stats`]), Allan deviation ([`allan`]), repeatable draws
//! ([`draws`]).

pub mod allan;
pub mod draws;
pub mod lsq;
pub mod progress;
pub mod side_by_side;
pub mod stats;
