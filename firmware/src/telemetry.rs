//! Housekeeping each second, to the link and to the log; and the align mode, which lives on the same seconds. The merging is
//! in [`hrg_core::telemetry`].

use crate::channels::{
    self, ALIGN, ALIGNMENT, HOUSEKEEPING, LINK_ERRORS, LOG, MAINTENANCE_OPEN, ON_FOR_S, SECONDS, STEP, TELEMETRY_ALIVE,
    TRIM,
};
use crate::retained;
use core::sync::atomic::Ordering;
use embassy_time::{with_timeout, Duration};
#[cfg(feature = "field-log")]
use hrg_core::status::UnitStatus;
use hrg_core::still::Still;
use hrg_core::telemetry::{Telemetry, RATES_WAIT_MS};

/// The align mode.
#[cfg(feature = "align")]
pub type Alignment = hrg_align::session::Session<hrg_align::linear::Linear<f32>>;
/// The align mode: it refuses.
#[cfg(not(feature = "align"))]
pub type Alignment = hrg_core::align_mode::NotBuiltIn;

/// Merges what the model and the rate path say of one second.
#[embassy_executor::task]
pub async fn task(mut telemetry: Telemetry<&'static mut Alignment>) {
    #[cfg(feature = "field-log")]
    let mut watch = hrg_core::events::Watch::default();
    let mut still = if channels::MOVING.load(Ordering::Relaxed) { Still::after_motion() } else { Still::default() };
    loop {
        let (step, output, report) = STEP.receive().await;
        TELEMETRY_ALIVE.give();
        let wait = Duration::from_millis(u64::from(RATES_WAIT_MS));
        let rates = with_timeout(wait, SECONDS.receive()).await.ok();
        if let Some(open) = MAINTENANCE_OPEN.try_take() {
            telemetry.set_maintenance(open);
        }
        while let Ok(command) = ALIGN.try_receive() {
            if let Some(trim) = telemetry.align(command) {
                TRIM.signal(trim);
            }
        }
        if let Some(errors) = LINK_ERRORS.try_take() {
            telemetry.set_link_errors(errors);
        }
        telemetry.set_pps(report);
        telemetry.set_standing(channels::standing());
        let (housekeeping, alignment) = telemetry.second(&step, &output, rates.as_ref());
        #[cfg(feature = "self-test")]
        channels::ALIGNING.store(alignment.is_some(), Ordering::Relaxed);
        if let Some(alignment) = alignment {
            ALIGNMENT.signal(alignment);
        }
        let h = &housekeeping;
        ON_FOR_S.store(h.on_for_s as u32, Ordering::Relaxed);
        channels::RATES.store(h.samples > 0, Ordering::Relaxed);
        let moving = still.second(h.raw_dph);
        channels::MOVING.store(moving, Ordering::Relaxed);
        retained::note_moving(moving);
        #[cfg(feature = "field-log")]
        watch.second(h.axis_status, noteworthy(h.unit_status), h.temperature_c, |event| {
            // A full queue loses it: the flag rises again, or stands in every frame.
            let _ = crate::channels::EVENTS.try_send((h.on_for_s as u32, event));
        });
        HOUSEKEEPING.signal(housekeeping);
        #[cfg(feature = "self-test")]
        channels::HOUSEKEPT.signal(housekeeping);
        LOG.signal(housekeeping);
    }
}

/// Flags of the unit that the field log is to have.
#[cfg(feature = "field-log")]
fn noteworthy(flags: UnitStatus) -> UnitStatus {
    #[cfg(feature = "self-test")]
    if channels::TESTING.load(Ordering::Relaxed) {
        return flags.difference(UnitStatus::ADC_FAULT);
    }
    flags
}

/// One line a second over RTT: enough to make a recording of.
#[embassy_executor::task]
pub async fn log() {
    loop {
        let h = LOG.wait().await;
        let (f, t, r, b, w) = (h.frequency_hz, h.temperature_c, h.ramp_c_per_min, h.bias_dph, h.raw_dph);
        let c = h.corrected_dph;
        let status = h.axis_status;
        defmt::info!(
            "t={=u32} on={=f32} f={=f64},{=f64},{=f64} T={=f32},{=f32},{=f32} dT={=f32},{=f32},{=f32} b={=f32},{=f32},{=f32} raw={=f32},{=f32},{=f32} c={=f32},{=f32},{=f32} status={=u16:02x},{=u16:02x},{=u16:02x},{=u16:02x} cal={=u32:08x} no={=u32} made={=u32} mode={=u8}",
            h.time_ms, h.on_for_s, f[0], f[1], f[2], t[0], t[1], t[2], r[0], r[1], r[2], b[0], b[1], b[2], w[0], w[1], w[2], c[0], c[1], c[2],
            status[0].bits(), status[1].bits(), status[2].bits(), h.unit_status.bits(), h.calibration, h.sequence, h.created_unix_s, h.mode
        );
    }
}
