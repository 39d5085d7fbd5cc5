//! The second of a unit: what model, rate path, link and maintenance say of it, merged into one housekeeping message; and the
//! alignment, which lives on the same seconds.
//!
//! The firmware's telemetry task and the digital twin drive this type alike.
//!
//! # Example
//! ```
//! use hrg_core::align_mode::NotBuiltIn;
//! use hrg_core::calibration::Calibration;
//! use hrg_core::compensator::Compensator;
//! use hrg_core::frequency::StepFrequencies;
//! use hrg_core::link::Identity;
//! use hrg_core::reset::ResetCause;
//! use hrg_core::status::UnitStatus;
//! use hrg_core::telemetry::Telemetry;
//! use hrg_core::timebase::Timebase;
//! use hrg_core::unit_name::UnitName;
//!
//! let identity = Identity {
//!     unit: UnitName::UNNAMED,
//!     calibration: 0,
//!     created_unix_s: 0,
//!     sequence: 0,
//!     reset_cause: ResetCause::Power,
//!     resets: 0,
//!     option_bytes: 0,
//!     ..Identity::default()
//! };
//! let mut session = NotBuiltIn::IDLE;
//! let mut telemetry = Telemetry::new(&mut session, Timebase::REFERENCE, identity, UnitStatus::DEFAULT_CALIBRATION);
//! let step = StepFrequencies {
//!     step: 0,
//!     end_ticks: 90_000_000,
//!     frequency_hz: [Some(4900.0), Some(4892.0), None],
//!     rejected: [0; 3],
//!     missing: [0; 3],
//! };
//! let output = Compensator::new(Calibration::uncalibrated(), 0.0).update(&step);
//! // A second in which the rate path has reported nothing: its means are missing, all else is there.
//! let (housekeeping, report) = telemetry.second(&step, &output, None);
//! assert_eq!((housekeeping.time_ms, housekeeping.samples, report), (1000, 0, None));
//! assert!(housekeeping.unit_status.contains(UnitStatus::DEFAULT_CALIBRATION));
//! ```

use crate::align_mode::{AlignMode, Command, Report};
use crate::compensator::Output;
use crate::frequency::StepFrequencies;
use crate::link::{mode, Housekeeping, Identity};
use crate::pps;
use crate::rate_output::RateSecond;
use crate::status::UnitStatus;
use crate::timebase::Timebase;
use crate::AXES;
use core::ops::DerefMut;

/// The rates of a step come this long after its frequencies at most, ms: the bias takes effect
/// [`crate::rate_path::BIAS_DELAY_MS`] after the step, and a silent ADC is noticed within 30 ms of that.
pub const RATES_WAIT_MS: u32 = 200;

/// See the module. `S` holds the alignment: a reference on the unit, where it takes most of the RAM.
#[derive(Debug)]
pub struct Telemetry<S> {
    session: S,
    timebase: Timebase,
    identity: Identity,
    start_status: UnitStatus,
    dropped: u16,
    link_errors: u16,
    /// Link errors are flagged in the second in which they were counted.
    flag_link_errors: bool,
    maintenance: bool,
    pps: pps::Report,
    standing: UnitStatus,
    trims_in_maintenance_only: bool,
    /// Commands refused since start.
    refused: u16,
}

impl<S: DerefMut<Target: AlignMode>> Telemetry<S> {
    /// `identity`: of the calibration in use; `start_status`: what start-up has found.
    pub const fn new(session: S, timebase: Timebase, identity: Identity, start_status: UnitStatus) -> Self {
        Self {
            session,
            timebase,
            identity,
            start_status,
            dropped: 0,
            link_errors: 0,
            flag_link_errors: false,
            maintenance: false,
            pps: pps::Report::NONE,
            standing: UnitStatus::empty(),
            trims_in_maintenance_only: false,
            refused: 0,
        }
    }

    /// The same; where `only` is true, commands that change rates are refused outside maintenance mode.
    #[must_use]
    pub fn with_trims_in_maintenance_only(self, only: bool) -> Self {
        Self { trims_in_maintenance_only: only, ..self }
    }

    /// Sets the report of the pulses per second for the second that ends.
    pub fn set_pps(&mut self, report: pps::Report) {
        self.pps = report;
    }

    /// Sets the flags that hold from now on, beside those of start-up.
    pub fn set_standing(&mut self, status: UnitStatus) {
        self.standing = status;
    }

    /// A command of the host to the alignment: gives the bias trim, deg/h, where it was accepted. Commands are taken before the
    /// second in which they arrived. One that is refused is counted and flagged as a bad frame; the alignment goes on.
    pub fn align(&mut self, command: Command) -> Option<[f32; AXES]> {
        if self.trims_in_maintenance_only && !self.maintenance && command == Command::Accept {
            self.refused = self.refused.saturating_add(1);
            self.flag_link_errors = true;
            return None;
        }
        self.session.command(command)
    }

    /// Bad frames on the link since start.
    pub fn set_link_errors(&mut self, errors: u16) {
        self.flag_link_errors |= errors != self.link_errors;
        self.link_errors = errors;
    }

    /// Resets since power-on.
    pub fn set_resets(&mut self, resets: u32) {
        self.identity.resets = resets.min(0xFFFF) as u16;
    }

    /// Sets or clears the flag of maintenance mode, in which a calibration may be written.
    pub fn set_maintenance(&mut self, open: bool) {
        self.maintenance = open;
    }

    /// A second is over: the step that ended it, what the model made of it, and what the rate path has reported of the time before its
    /// bias (`None`: nothing, for [`RATES_WAIT_MS`]).
    pub fn second(
        &mut self,
        step: &StepFrequencies,
        output: &Output,
        rates: Option<&RateSecond>,
    ) -> (Housekeeping, Option<Report>) {
        let summary = rates.map(|r| &r.summary);
        let report = summary.and_then(|s| self.session.second(s));
        if let Some(rates) = rates {
            self.dropped = rates.dropped;
        }
        let mut h = Housekeeping::new(step, output, summary, self.timebase);
        h.unit_status |= self.start_status | self.standing;
        (h.pps_tick, h.pps_age_ms, h.clock_ppb) = (self.pps.tick, self.pps.age_ms, self.pps.correction_ppb);
        if self.pps.out_of_bounds {
            h.unit_status |= UnitStatus::TIMEBASE;
        }
        if core::mem::take(&mut self.flag_link_errors) {
            h.unit_status |= UnitStatus::LINK_ERRORS;
        }
        h.dropped = self.dropped;
        h.link_errors = self.link_errors.saturating_add(self.refused);
        h.calibration = self.identity.calibration;
        h.sequence = self.identity.sequence;
        h.created_unix_s = self.identity.created_unix_s;
        h.resets = self.identity.resets;
        h.mode = match (self.maintenance, self.session.running()) {
            (true, _) => mode::MAINTENANCE,
            (false, true) => mode::ALIGN,
            (false, false) => mode::NAVIGATE,
        };
        (h, report)
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use crate::rate_path::Summary;
    use crate::reset::ResetCause;
    use crate::status::AxisStatus;
    use crate::unit_name::UnitName;
    use std::boxed::Box;

    /// Runs from the command that begins it until it is accepted in maintenance mode.
    #[derive(Default)]
    struct Mode {
        runs: bool,
        fresh: bool,
    }

    impl AlignMode for Mode {
        fn command(&mut self, command: Command) -> Option<[f32; AXES]> {
            self.runs = matches!(command, Command::Begin { .. });
            self.fresh = self.runs;
            None
        }
        fn second(&mut self, _: &Summary) -> Option<Report> {
            (!core::mem::take(&mut self.fresh) && self.runs).then(Report::default)
        }
        fn running(&self) -> bool {
            self.runs
        }
        fn set_accelerometers(&mut self, _: crate::accelerometers::Accelerometers) {}
    }

    fn telemetry() -> Telemetry<Box<Mode>> {
        let identity = Identity {
            unit: UnitName::UNNAMED,
            calibration: 7,
            created_unix_s: 8,
            sequence: 9,
            reset_cause: ResetCause::Watchdog,
            resets: 2,
            ..Identity::default()
        };
        Telemetry::new(Box::default(), Timebase::REFERENCE, identity, UnitStatus::IMAGE_REFUSED)
    }

    const STEP: StepFrequencies = StepFrequencies {
        step: 3,
        end_ticks: 4 * 90_000_000,
        frequency_hz: [Some(4900.0), None, Some(4703.6)],
        rejected: [0, 70_000, 0],
        missing: [0; 3],
    };
    const OUTPUT: Output = Output {
        temperature_c: [20.0; 3],
        ramp_c_per_min: [0.0; 3],
        bias_dph: [1.0; 3],
        bias_std_dph: [0.1; 3],
        factors: crate::rate_factors::Factors::UNIT,
        specific_force: crate::specific_force::SpecificForce::NONE,
        status: [AxisStatus::empty(); 3],
        on_for_s: 77.0,
    };

    fn rates(samples: u16, dropped: u16) -> RateSecond {
        let summary = Summary {
            step: 2,
            samples,
            raw_dph: [5.0; 3],
            corrected_dph: [4.0; 3],
            adc_errors: 0,
            accelerometer_codes: [0; 2],
            accelerometer_saturated: false,
        };
        RateSecond { summary, dropped }
    }

    #[test]
    fn a_second_holds_what_all_say() {
        let mut t = telemetry();
        let (h, report) = t.second(&STEP, &OUTPUT, Some(&rates(1000, 4)));
        assert_eq!((h.unit_status, report), (UnitStatus::IMAGE_REFUSED, None));
        assert_eq!((h.time_ms, h.samples, h.dropped, h.rejected[1]), (4000, 1000, 4, 0xFFFF));
        assert_eq!((h.calibration, h.created_unix_s, h.sequence, h.mode), (7, 8, 9, mode::NAVIGATE));
        assert_eq!((h.resets, h.on_for_s), (2, 77.0));
        assert!(h.frequency_hz[1].is_nan());
        // A rate path that says nothing is an ADC fault, and what was dropped stays counted.
        let (h, _) = t.second(&STEP, &OUTPUT, None);
        assert_eq!(h.unit_status, UnitStatus::IMAGE_REFUSED | UnitStatus::ADC_FAULT);
        assert_eq!((h.samples, h.dropped), (0, 4));
    }

    #[test]
    fn link_errors_are_flagged_in_their_second_and_stay_counted() {
        let mut t = telemetry();
        t.set_link_errors(0);
        assert_eq!(t.second(&STEP, &OUTPUT, Some(&rates(1000, 0))).0.unit_status, UnitStatus::IMAGE_REFUSED);
        t.set_link_errors(2);
        let h = t.second(&STEP, &OUTPUT, Some(&rates(1000, 0))).0;
        assert_eq!((h.unit_status, h.link_errors), (UnitStatus::IMAGE_REFUSED | UnitStatus::LINK_ERRORS, 2));
        t.set_link_errors(2);
        let h = t.second(&STEP, &OUTPUT, Some(&rates(1000, 0))).0;
        assert_eq!((h.unit_status, h.link_errors), (UnitStatus::IMAGE_REFUSED, 2));
    }

    #[test]
    fn a_trim_may_need_maintenance_mode() {
        let mut t = telemetry().with_trims_in_maintenance_only(true);
        let begin = Command::Begin { latitude_deg: 45.0, gravity_mps2: 0.0, velocity_noise_mps: 1e-3 };
        assert_eq!(t.align(begin), None);
        let _ = t.second(&STEP, &OUTPUT, Some(&rates(1000, 0)));
        assert_eq!(t.align(Command::Accept), None);
        let (h, report) = t.second(&STEP, &OUTPUT, Some(&rates(1000, 0)));
        assert_eq!((h.unit_status, h.link_errors), (UnitStatus::IMAGE_REFUSED | UnitStatus::LINK_ERRORS, 1));
        assert!(h.mode == mode::ALIGN && report.is_some(), "the alignment goes on");
        t.set_maintenance(true);
        let _ = t.align(Command::Accept);
        let (h, _) = t.second(&STEP, &OUTPUT, Some(&rates(1000, 0)));
        assert_eq!((h.unit_status, h.link_errors), (UnitStatus::IMAGE_REFUSED, 1));
    }

    #[test]
    fn the_mode_is_what_the_unit_does() {
        let mut t = telemetry();
        let begin = Command::Begin { latitude_deg: 45.0, gravity_mps2: 0.0, velocity_noise_mps: 1e-3 };
        assert_eq!(t.align(begin), None);
        assert_eq!(t.second(&STEP, &OUTPUT, Some(&rates(1000, 0))).0.mode, mode::ALIGN);
        let (h, report) = t.second(&STEP, &OUTPUT, Some(&rates(1000, 0)));
        assert!(h.mode == mode::ALIGN && report.is_some());
        t.set_maintenance(true);
        assert_eq!(t.second(&STEP, &OUTPUT, Some(&rates(1000, 0))).0.mode, mode::MAINTENANCE);
    }
}
