//! `board`: electronics: board temperature less resonator temperature (parameter `source` 0, C), or the supply
//! (`source` 1, V), each less its reference. Needs it as an input. Stateless.

use super::parameters::Source;
use super::{Effect, Inputs, Reach};
use crate::inputs::QuantitySet;

/// Board temperature less resonator temperature (C), or supply (V).
#[derive(Debug, Clone)]
pub struct Board {
    supply: bool,
}

impl Effect for Board {
    const NAME: &'static str = "board";
    const ID: u16 = 16;
    const REACH: Reach = Reach::NeedsInput("board_c or supply_v");

    type Parameters = Source;
    type Regressors = [f32; 1];

    fn new(parameters: Source, _: f32) -> Self {
        Self { supply: parameters.source > 0.5 }
    }

    fn reads(parameters: Source, _: usize) -> QuantitySet {
        if parameters.source > 0.5 {
            QuantitySet::SUPPLY
        } else {
            QuantitySet::BOARD
        }
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 1] {
        let own_c = inputs.own_c() - inputs.scaling.t_ref_c;
        [if self.supply { inputs.quantities.supply_v() } else { inputs.quantities.board_c() - own_c }]
    }
}
