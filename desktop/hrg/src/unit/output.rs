//! Output of a unit: filter, samples a frame, increments, framing (`hrg unit output`).

use hrg_core::filter::Filter;
use hrg_core::link::Identity;
use hrg_core::output::{Framing, OutputSettings};

/// Settings of a unit, as its identity tells them.
#[must_use]
pub fn of(identity: &Identity) -> OutputSettings {
    let Identity { filter, decimation, increments, framing, .. } = *identity;
    OutputSettings { filter, decimation, increments, framing }
}

/// Settings in words: what comes, how often, how wide, how late.
///
/// # Example
/// ```
/// use hrg::unit::output::in_words;
/// use hrg_core::output::OutputSettings;
///
/// let text = in_words(&OutputSettings::default());
/// assert_eq!(text, "rates at 200 Hz, flat to 60 Hz, of 28.0 ms before their last sample; no increments; own framing");
/// ```
#[must_use]
pub fn in_words(settings: &OutputSettings) -> String {
    let OutputSettings { filter, decimation, increments, framing } = *settings;
    let per_s = |samples: u16| format!("{} Hz", 1000.0 / f64::from(samples.max(1)));
    let band = match filter.design(decimation) {
        Some(_) => "flat to 60 Hz".to_string(),
        None => format!("means of {decimation} samples"),
    };
    let delay_ms = f64::from(filter.delay_us(decimation)) / 1000.0;
    let increments = match increments {
        0 => "no increments".to_string(),
        n => format!("increments at {}", per_s(n)),
    };
    let framing = match framing {
        Framing::Own => "own framing",
        Framing::Mavlink => "MAVLink framing",
    };
    format!(
        "rates at {}, {band}, of {delay_ms:.1} ms before their last sample; {increments}; {framing}",
        per_s(decimation)
    )
}

/// The filter with a name.
///
/// # Errors
/// A name that is none.
pub fn filter(name: &str) -> Result<Filter, String> {
    named(Filter::from_number, Filter::name, name)
}

/// The framing with a name.
///
/// # Errors
/// A name that is none.
pub fn framing(name: &str) -> Result<Framing, String> {
    named(Framing::from_number, Framing::name, name)
}

/// That of the core's numbered things which has a name.
fn named<T: Copy>(numbered: fn(u8) -> Option<T>, name_of: fn(T) -> &'static str, name: &str) -> Result<T, String> {
    let all = || (0..).map_while(numbered);
    let names = || all().map(name_of).collect::<Vec<_>>().join(" or ");
    all().find(|one| name_of(*one) == name).ok_or_else(names)
}
