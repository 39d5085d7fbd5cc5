//! Files of other programs: any bytes are read by the map that fits how they begin, or by a guess, or refused with a sentence.

use hrg_data::recording::import;
use hrg_data::recording::import::guess::{guess, text_of};
use hrg_data::recording::import::map::Map;

/// Takes an input; it panics where something promised does not hold.
pub fn run(data: &[u8]) {
    let path = std::env::temp_dir().join(format!("hrg-fuzz-import-{}", std::process::id()));
    std::fs::write(&path, data).expect("written");
    let map = match import::built_in(&path) {
        Some(name) => Map::built_in(name),
        None => text_of(&path)
            .ok()
            .and_then(|(text, _)| guess(&text).ok())
            .map(|g| g.map())
            .and_then(|m| Map::parse(&m).ok()),
    };
    if let Some(mut r) = map.and_then(|map| import::read(&path, &map).ok()) {
        let rows = r.time_s.len();
        assert!(r.rate_dph.iter().chain(&r.frequency_hz).all(|v| v.len() == rows));
        if r.clean().is_ok() {
            assert!(r.time_s.windows(2).all(|w| w[0] < w[1]));
        }
    }
    if let Ok(text) = std::str::from_utf8(data) {
        let _ = Map::parse(text);
    }
}
