//! Names of addresses in a unit's program, from its ELF.

use hrg_data::error::BadInput;
use std::path::Path;

/// Reads debugging information of one ELF.
pub struct Symbols(addr2line::Loader);

impl Symbols {
    /// Opens an ELF.
    ///
    /// # Errors
    /// If it cannot be read, or is no ELF.
    pub fn open(elf: &Path) -> Result<Self, BadInput> {
        let why = |e: &dyn std::fmt::Display| {
            BadInput::new(format!("{}: {e}; --elf wants the firmware that runs on the unit, as an ELF", elf.display()))
        };
        addr2line::Loader::new(elf).map(Self).map_err(|e| why(&e))
    }

    /// Function, file and line of an address; `None`: the program has nothing there.
    #[must_use]
    pub fn name(&self, address: u32) -> Option<String> {
        // (Of a Thumb address the lowest bit is no part.)
        let at = u64::from(address & !1);
        let function = self.0.find_symbol(at).map(|name| addr2line::demangle_auto(name.into(), None).into_owned());
        let place = self.0.find_location(at).ok().flatten();
        let place = place.and_then(|l| Some(format!("{}:{}", short(l.file?), l.line?)));
        match (function, place) {
            (Some(function), Some(place)) => Some(format!("{function}, {place}")),
            (one, other) => one.or(other),
        }
    }
}

/// The end of a path from the folder of a crate on.
fn short(path: &str) -> &str {
    let parts = ["firmware/", "hrg-core/", "hrg-align/"];
    let own = parts.iter().find_map(|p| path.rfind(p).map(|at| &path[at..]));
    own.or_else(|| path.rsplit_once(".crates.io-").and_then(|(_, rest)| rest.split_once('/').map(|(_, r)| r)))
        .unwrap_or(path)
}
