//! Definition of each effect in words and symbols: the head of its file in `hrg-core`, next to its code.

use hrg_core::effects::EffectId;

/// Equation, state and source of an effect, in one line of text.
#[must_use]
pub fn equation(effect: EffectId) -> String {
    let text = effect.source();
    let head = text.lines().map_while(|l| l.strip_prefix("//!")).take_while(|l| !l.is_empty()).map(str::trim);
    let line = head.collect::<Vec<_>>().join(" ").replace("[`crate::", "`hrg_core::").replace("`]", "`");
    // The name stands before it already.
    line.strip_prefix(&format!("`{}`: ", effect.name())).map_or(line.clone(), String::from)
}

#[cfg(test)]
mod tests {
    use super::*;
    use hrg_core::effects::ALL;

    #[test]
    fn every_effect_has_its_own_text() {
        for facts in ALL {
            let text = equation(facts.effect);
            assert!(text.len() > 20 && !text.contains("crate::"), "{}: {text}", facts.name);
            // A file with several effects names each of them.
            let shared = ALL.iter().filter(|f| equation(f.effect) == text).count();
            assert!(shared == 1 || text.contains('`'), "{}: {text}", facts.name);
        }
        assert!(equation(EffectId::Hysteresis).starts_with("`play(T, width) - T`: "));
    }
}
