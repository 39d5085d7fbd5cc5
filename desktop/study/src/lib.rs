//! Writers of this repository's pages, and its campaigns.
//!
//! | module | contents |
//! |---|---|
//! | [`demo`] | the main job from end to end |
//! | [`measured`] | the loop on measured data |
//! | [`threshold`] | false alarms of the trace's threshold |
//! | [`campaign`] | the seeded campaign behind docs/trace.md |
//! | [`methods`], [`rates`], [`align`] | methods, scale factors and self-alignment through the ELF |
//! | [`family`] | what a family spares the next unit, on the second plant |
//! | [`inputs`] | inputs beside the frequencies, on the second plant and through the ELF |
//! | [`output`] | what a navigator gets: filters, increments, time, measured through the ELF |
//! | [`faults`] | attacks the promises of docs/promises.md |
//! | [`mutate`] | proof by mutation: set-up code made wrong, which the board must notice |
//! | [`fingerprint`] | checksums of frames, images and files, to compare before and after a change |
//! | [`formats`] | the tables of bytes in docs/formats.md |
//! | [`unit_bench`], [`desktop_bench`] | cost of the unit in instructions and bytes, of the desktop in time |
//! | [`pages`] | texts between the marks of a page |
#![forbid(unsafe_code)]

pub mod align;
pub mod campaign;
pub mod demo;
pub mod desktop_bench;
pub mod family;
pub mod faults;
pub mod fingerprint;
pub mod forces;
pub mod formats;
pub mod inputs;
pub mod measured;
pub mod methods;
pub mod mutate;
pub mod output;
pub mod pages;
pub mod rates;
pub mod threshold;
pub mod unit_bench;
