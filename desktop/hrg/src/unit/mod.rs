//! Everything that talks to a unit: its port ([`port`]), recordings from it ([`record`]), its log ([`mod@log`]), its screen
//! ([`monitor`]), keys that sign its calibrations ([`keys`]), its field log ([`events`]) with names from its program ([`symbols`]), its constants in the field
//! ([`zero`]), its built-in test ([`self_test`]), what it sends ([`output`]), and sensors beside it ([`sensors`]).

pub mod align;
pub mod events;
pub mod keys;
pub mod log;
pub mod monitor;
pub mod output;
pub mod port;
pub mod program;
pub mod record;
pub mod self_test;
pub mod sensors;
pub mod symbols;
pub mod zero;

/// Names of the bits that are set, bit 0 first.
pub(crate) fn named<'n>(bits: u16, names: &'n [&'n str]) -> impl Iterator<Item = &'n str> + 'n {
    names.iter().enumerate().filter(move |(k, _)| bits >> k & 1 != 0).map(|(_, n)| *n)
}
