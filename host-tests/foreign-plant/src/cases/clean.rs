//! Clean units under several kinds of noise.

use crate::case::Case;
use crate::noise::Noise;
use crate::truth::Class;

pub(super) fn cases() -> Vec<Case> {
    let clean = |name: &str, description: &str, noise: Noise| Case::new("clean", name, description).noise(noise);
    vec![
        clean("clean-usual", "Equation 7 and usual noise.", Noise::Usual),
        clean("clean-white", "Equation 7 and white noise.", Noise::White),
        clean("clean-flicker", "Equation 7 and 1/f noise.", Noise::Flicker(1.0)),
        clean("clean-steep-flicker", "Equation 7 and 1/f^1.4 noise.", Noise::Flicker(1.4)),
        clean("clean-walk", "Equation 7 and random walk.", Noise::Walk),
        clean("clean-lines", "Equation 7 and lines of 3 s to 900 s.", Noise::Lines).also(Class::Event),
        clean("clean-gauss-markov", "Equation 7 and a Gauss-Markov process.", Noise::GaussMarkov),
        clean("clean-grows", "Equation 7 and noise that grows fourfold from cold to hot.", Noise::GrowsWithTemperature),
        clean("clean-heavy-tails", "Equation 7 and noise with heavy tails.", Noise::HeavyTails),
        clean("clean-bursts", "Equation 7 and noise that trebles for minutes.", Noise::Bursts),
        clean("clean-quiet", "Equation 7 and very low noise: coefficients are sharp.", Noise::Usual).quiet(0.02, 0.04),
    ]
}
