//! Numbers: least squares ([`lsq`]), means and quantiles ([`stats`]), Allan deviation ([`allan`]).

pub mod allan;
pub mod lsq;
pub mod stats;
