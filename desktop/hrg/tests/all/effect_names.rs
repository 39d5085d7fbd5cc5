//! Effects are known by their type: a name stands in the effect's own file, and nowhere else outside tests.

use hrg_core::effects::ALL;
use std::path::{Path, PathBuf};

fn sources(folder: &Path, out: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).expect("a folder of sources") {
        let path = entry.expect("readable").path();
        if path.is_dir() {
            sources(&path, out);
        } else if path.extension().is_some_and(|e| e == "rs") {
            out.push(path);
        }
    }
}

#[test]
fn no_effect_is_known_by_a_string() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let mut files = Vec::new();
    for folder in ["desktop", "virtual-board/hrg-board/src"] {
        sources(&root.join(folder), &mut files);
    }
    assert!(files.len() > 60, "{} files", files.len());
    for file in files {
        if file.components().any(|c| c.as_os_str() == "tests") {
            continue;
        }
        let text = std::fs::read_to_string(&file).expect("text");
        let code = text.split("#[cfg(test)]\nmod tests").next().unwrap_or("");
        for effect in ALL {
            // A class of effects bears the name of one.
            let class = file.ends_with("data/src/cards.rs") && effect.name == "hysteresis";
            let literal = format!("\"{}\"", effect.name);
            assert!(class || !code.contains(&literal), "{literal} in {}", file.display());
        }
    }
}
