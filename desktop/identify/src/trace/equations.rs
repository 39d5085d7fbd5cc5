//! Definition of each effect in words and symbols: the head of its file in `hrg-core`, next to its code.

use hrg_core::effects::EffectId;

/// Arms of a match from effects to the text of the file that has them.
macro_rules! files {
    ($effect:expr; $($file:ident: $($name:ident)|+),+ $(,)?) => {
        match $effect {
            $($(EffectId::$name)|+ => include_str!(concat!("../../../../hrg-core/src/effects/", stringify!($file), ".rs")),)+
        }
    };
}

/// Equation, state and source of an effect, in one line of text.
#[must_use]
pub fn equation(effect: EffectId) -> String {
    let text = files!(effect;
        cubic: Cubic,
        kink: Kink,
        temperature_shape: TemperatureShape,
        thermal_lag: ThermalLag,
        second_derivative: SecondDerivative,
        hysteresis: Hysteresis,
        axis_gradient: AxisGradient,
        case_gradient: CaseGradient,
        warm_up: WarmUp,
        aging: Aging,
        step: Step,
        shock: Shock,
        periodic: Periodic,
        timebase: Timebase,
        drive_amplitude: DriveAmplitude,
        quadrature: Quadrature,
        board: Board,
        frequency_direct: FrequencyDirect,
        cooling_heating: CoolingHeating,
        cooling_heating_held: CoolingHeatingHeld,
        lag_ladder: LagLadder,
        lag_ladder_by_temperature: LagLadderByTemperature,
        heating_lags: HeatingLags,
        arrhenius_ladder: ArrheniusLadder,
        neighbour_lags: NeighbourLags,
        play_ladder: PlayLadder,
        play_curve: PlayCurve,
        relay: Relay,
        temperature_spline: TemperatureSpline,
        ripple: Ripple,
        rate_curve: RateCurve | RateCurveByTemperature,
        rate_saturation: RateSaturation,
        ramp_by_shape: RampByShape | HeatingByShape,
        power_on_ladder: PowerOnLadder | PowerOnLadderByTemperature | PowerOnLadderByStart,
        extremes: Extremes,
        recorded_quantity: RecordedQuantity,
        thermometer_error: ThermometerError,
    );
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
