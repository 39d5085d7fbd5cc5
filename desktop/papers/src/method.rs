//! The methods: which model, how its coefficients are found, and what makes one set of them the best.

use hrg_core::inputs;

/// A bias model, as far as methods differ in it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Model {
    /// Eq 7.
    OneSet,
    /// Eq 7 with a set for cooling and one for heating.
    CoolingHeating,
    /// The same, with the set of the last direction held.
    CoolingHeatingHeld,
    /// Four parameters, continuous at the breakpoint.
    FourParameters,
    /// Four parameters with the temperature from 0 C: the bias jumps at the breakpoint.
    FourParametersLiteral,
    /// A polynomial of temperature.
    Polynomial(Degree),
    /// A table of temperature, with straight lines between its points.
    Table,
    /// A 1-5-1 network.
    Network,
    /// A curve of frequency and its rate.
    Frequency(Degree),
    /// Eq 7 beside drive and quadrature voltage, as they are and late.
    Inputs,
    /// A constant and the drive voltage, which goes with damping.
    Damping,
    /// Eq 7 beside a hidden layer on the drive and one on the quadrature voltage.
    InputNetwork,
}

/// Degree of a polynomial.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Degree {
    /// This one, from 1 to [`MOST`](Self::MOST).
    Of(u8),
    /// The one that leaves the least of parts of the train runs that were held out.
    HeldOut,
}

impl Degree {
    /// The highest: that of the curves that an image can hold.
    pub const MOST: u8 = 10;
}

impl std::str::FromStr for Degree {
    type Err = String;

    fn from_str(s: &str) -> Result<Self, String> {
        if s == "auto" {
            return Ok(Self::HeldOut);
        }
        let degree = s.parse().ok().filter(|n| (1..=Self::MOST).contains(n));
        degree.map(Self::Of).ok_or_else(|| format!("a degree is a number from 1 to {}, or auto", Self::MOST))
    }
}

/// Time of a ramp in a box that is printed without units.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PerRamp {
    /// C per minute.
    Minute,
    /// C per second.
    Second,
    /// C per 10 ms.
    TenMilliseconds,
}

/// Search for the coefficients.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Search {
    /// The exact solution.
    Exact,
    /// Exact, with outliers counting less.
    Robust,
    /// A particle swarm.
    Swarm,
    /// A particle swarm in the box that the paper prints, with ramps per some time.
    LiteralSwarm(PerRamp),
    /// A genetic algorithm that Levenberg-Marquardt finishes.
    Genetic,
    /// A genetic algorithm and back-propagation, as its paper has them.
    LiteralGenetic,
}

/// Objective that is minimised.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Objective {
    /// The sum of squares.
    Squares,
    /// The range of 100 s means.
    Range,
}

/// Parts of a method.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Parts {
    /// The model.
    pub model: Model,
    /// Search for its coefficients.
    pub search: Search,
    /// Objective that is minimised.
    pub objective: Objective,
}

/// A method of identification; the table is in [`crate::methods`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// Eq 7 by least squares.
    Lsq,
    /// A cooling and a heating set by least squares.
    TwoSets,
    /// A cooling and a heating set by least squares, each held until the other direction begins.
    TwoSetsHeld,
    /// The same by a swarm for each stage, as dong2023 has it.
    PsoTwoSets,
    /// Eq 7 with outliers counting less.
    Huber,
    /// Eq 7 by a swarm.
    Pso,
    /// A cooling and a heating set, each by the swarm of dong2023 in its box, with ramps in C/s.
    PsoLiteral,
    /// The same, with ramps in C per 10 ms.
    PsoLiteral10Ms,
    /// Eq 7 by a swarm, for the smallest range.
    PsoRange,
    /// Eq 7 with the smallest range.
    LpRange,
    /// Four parameters, exactly.
    FogLsq,
    /// Four parameters by a swarm.
    FogPso,
    /// Four parameters with the smallest range.
    FogLp,
    /// Four parameters by a swarm, for the smallest range.
    FogPsoRange,
    /// Four parameters as their paper writes them.
    FogLiteral,
    /// The same, by the swarm of its paper in the box of its paper.
    FogPsoLiteral,
    /// The same, for the smallest range.
    FogPsoRangeLiteral,
    /// A cubic of temperature.
    Polynomial,
    /// A polynomial of temperature, its degree by held-out parts.
    PolynomialAuto,
    /// A table of temperature.
    Table,
    /// A network.
    GaBp,
    /// The same, searched as its paper has it.
    GaBpLiteral,
    /// A curve of frequency, cubic.
    Direct,
    /// A curve of frequency, its degree by held-out parts.
    DirectAuto,
    /// Eq 7 beside drive and quadrature voltage.
    Inputs,
    /// A constant and the drive voltage.
    Damping,
    /// Eq 7 beside a network on drive and quadrature voltage.
    InputNetwork,
}

impl Method {
    /// All, in the order of the table.
    pub const ALL: [Self; 27] = [
        Self::Lsq,
        Self::TwoSets,
        Self::TwoSetsHeld,
        Self::PsoTwoSets,
        Self::Huber,
        Self::Pso,
        Self::PsoLiteral,
        Self::PsoLiteral10Ms,
        Self::PsoRange,
        Self::LpRange,
        Self::FogLsq,
        Self::FogPso,
        Self::FogLp,
        Self::FogPsoRange,
        Self::FogLiteral,
        Self::FogPsoLiteral,
        Self::FogPsoRangeLiteral,
        Self::Polynomial,
        Self::PolynomialAuto,
        Self::Table,
        Self::GaBp,
        Self::GaBpLiteral,
        Self::Direct,
        Self::DirectAuto,
        Self::Inputs,
        Self::Damping,
        Self::InputNetwork,
    ];

    /// The name in commands and reports.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Lsq => "lsq",
            Self::TwoSets => "two-sets",
            Self::TwoSetsHeld => "two-sets-held",
            Self::PsoTwoSets => "pso-two-sets",
            Self::Huber => "huber",
            Self::Pso => "pso",
            Self::PsoLiteral => "pso-literal",
            Self::PsoLiteral10Ms => "pso-literal-10ms",
            Self::PsoRange => "pso-range",
            Self::LpRange => "lp-range",
            Self::FogLsq => "fog-lsq",
            Self::FogPso => "fog-pso",
            Self::FogLp => "fog-lp",
            Self::FogPsoRange => "fog-pso-range",
            Self::FogLiteral => "fog-literal",
            Self::FogPsoLiteral => "fog-pso-literal",
            Self::FogPsoRangeLiteral => "fog-pso-range-literal",
            Self::Polynomial => "polynomial",
            Self::PolynomialAuto => "polynomial-auto",
            Self::Table => "table",
            Self::GaBp => "ga-bp",
            Self::GaBpLiteral => "ga-bp-literal",
            Self::Direct => "direct",
            Self::DirectAuto => "direct-auto",
            Self::Inputs => "inputs",
            Self::Damping => "damping",
            Self::InputNetwork => "inputs-network",
        }
    }

    /// Model, search and objective of the method.
    #[must_use]
    pub const fn parts(self) -> Parts {
        use Degree::{HeldOut, Of};
        use Model::{
            CoolingHeating, CoolingHeatingHeld, FourParameters, FourParametersLiteral, Frequency, Network, OneSet,
            Polynomial, Table,
        };
        use Objective::{Range, Squares};
        use Search::{Exact, Genetic, LiteralGenetic, LiteralSwarm, Robust, Swarm};
        let (model, search, objective) = match self {
            Self::Lsq => (OneSet, Exact, Squares),
            Self::TwoSets => (CoolingHeating, Exact, Squares),
            Self::TwoSetsHeld => (CoolingHeatingHeld, Exact, Squares),
            Self::PsoTwoSets => (CoolingHeatingHeld, Swarm, Squares),
            Self::Huber => (OneSet, Robust, Squares),
            Self::Pso => (OneSet, Swarm, Squares),
            Self::PsoLiteral => (CoolingHeatingHeld, LiteralSwarm(PerRamp::Second), Squares),
            Self::PsoLiteral10Ms => (CoolingHeatingHeld, LiteralSwarm(PerRamp::TenMilliseconds), Squares),
            Self::PsoRange => (OneSet, Swarm, Range),
            Self::LpRange => (OneSet, Exact, Range),
            Self::FogLsq => (FourParameters, Exact, Squares),
            Self::FogPso => (FourParameters, Swarm, Squares),
            Self::FogLp => (FourParameters, Exact, Range),
            Self::FogPsoRange => (FourParameters, Swarm, Range),
            Self::FogLiteral => (FourParametersLiteral, Exact, Squares),
            Self::FogPsoLiteral => (FourParametersLiteral, LiteralSwarm(PerRamp::Minute), Squares),
            Self::FogPsoRangeLiteral => (FourParametersLiteral, LiteralSwarm(PerRamp::Minute), Range),
            Self::Polynomial => (Polynomial(Of(3)), Exact, Squares),
            Self::PolynomialAuto => (Polynomial(HeldOut), Exact, Squares),
            Self::Table => (Table, Exact, Squares),
            Self::GaBp => (Network, Genetic, Squares),
            Self::GaBpLiteral => (Network, LiteralGenetic, Squares),
            Self::Direct => (Frequency(Of(3)), Exact, Squares),
            Self::DirectAuto => (Frequency(HeldOut), Exact, Squares),
            Self::Inputs => (Model::Inputs, Exact, Squares),
            Self::Damping => (Model::Damping, Exact, Squares),
            Self::InputNetwork => (Model::InputNetwork, Exact, Squares),
        };
        Parts { model, search, objective }
    }

    /// `true` if a row may have a weight: a model that is linear, with the exact least sum of squares.
    #[must_use]
    pub const fn is_weighable(self) -> bool {
        let p = self.parts();
        matches!(p.search, Search::Exact) && matches!(p.objective, Objective::Squares) && !self.has_a_breakpoint()
    }

    /// `true` if its degree may be chosen.
    #[must_use]
    pub const fn has_a_degree(self) -> bool {
        matches!(self.parts().model, Model::Polynomial(_) | Model::Frequency(_))
    }

    /// Inputs beside the frequencies that an axis needs for it.
    #[must_use]
    pub fn inputs(self, axis: usize) -> Vec<u8> {
        match self.parts().model {
            Model::Inputs | Model::InputNetwork => vec![inputs::drive(axis), inputs::quad(axis)],
            Model::Damping => vec![inputs::drive(axis)],
            _ => Vec::new(),
        }
    }

    /// `true` if it has coefficients of their own for cooling and heating.
    #[must_use]
    pub const fn needs_both_directions(self) -> bool {
        matches!(self.parts().model, Model::CoolingHeating | Model::CoolingHeatingHeld) || self.has_a_breakpoint()
    }

    /// `true` if its model has a breakpoint.
    #[must_use]
    pub const fn has_a_breakpoint(self) -> bool {
        matches!(self.parts().model, Model::FourParameters | Model::FourParametersLiteral)
    }

    /// The method with a name.
    #[must_use]
    pub fn by_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|m| m.name() == name)
    }
}

impl std::fmt::Display for Method {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(self.name())
    }
}

impl clap::ValueEnum for Method {
    fn value_variants<'a>() -> &'a [Self] {
        &Self::ALL
    }

    fn to_possible_value(&self) -> Option<clap::builder::PossibleValue> {
        Some(self.name().into())
    }
}

/// Options of an identification.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Options {
    /// Seed of swarms and genetic searches.
    pub seed: u64,
    /// Every degree of temperature counts alike instead of every second (methods that are [weighable](Method::is_weighable) only).
    pub uniform: bool,
    /// The breakpoint, C, where it is not to be searched (methods that [have one](Method::has_a_breakpoint) only).
    pub breakpoint_c: Option<f64>,
    /// The degree, where it is not the method's own (methods that [have one](Method::has_a_degree) only).
    pub degree: Option<Degree>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_lead_back_and_parts_differ() {
        for (k, a) in Method::ALL.into_iter().enumerate() {
            assert_eq!(Method::by_name(a.name()), Some(a));
            assert!(Method::ALL[..k].iter().all(|b| b.parts() != a.parts() && b.name() != a.name()), "{a}");
        }
        let weighable: Vec<&str> = Method::ALL.into_iter().filter(|m| m.is_weighable()).map(Method::name).collect();
        let names = [
            "lsq",
            "two-sets",
            "two-sets-held",
            "polynomial",
            "polynomial-auto",
            "table",
            "direct",
            "direct-auto",
            "inputs",
            "damping",
            "inputs-network",
        ];
        assert_eq!(weighable, names);
        assert_eq!(["7", "auto"].map(str::parse), [Ok(Degree::Of(7)), Ok(Degree::HeldOut)]);
        assert!(["0", "11", "x"].iter().all(|s| s.parse::<Degree>().is_err()));
    }
}
