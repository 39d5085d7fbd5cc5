//! Tests of the program `hrg` and of what stands behind it.

mod align_port;
mod burn;
mod cli;
mod day;
mod effect_names;
mod forces;
mod import;
mod judge;
mod outputs;
mod rate_saturation;
mod rates;
