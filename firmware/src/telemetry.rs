//! Housekeeping each second, to the link and to the log; and the align mode, which lives on the same seconds.

use crate::channels::{
    Who, ALIGN, ALIGNMENT, HOUSEKEEPING, LINK_ERRORS, LOG, MAINTENANCE_OPEN, STEP, SUMMARY, TELEMETRY_ALIVE, TRIM,
};
use crate::params::{SUMMARY_WAIT, TIMER_HZ};
use embassy_time::with_timeout;
use hrg_core::alignment::session::Session;
use hrg_core::link::{mode, Housekeeping};
use hrg_core::status::unit;

/// The filter that is flown. The kernel form of the unscented particle filter is a build feature: it takes another 90 KiB of
/// RAM and 200 times the instructions, for the same azimuth (docs/alignment.md).
#[cfg(not(feature = "upf"))]
pub type Flown = hrg_core::alignment::linear::Linear<f32>;
/// See above.
#[cfg(feature = "upf")]
pub type Flown = hrg_core::alignment::particles::Kernels<f32, { hrg_core::alignment::particles::CHEN }>;

/// Merges what the model and the rate path say of one second.
#[embassy_executor::task]
pub async fn task(who: Who, session: &'static mut Session<Flown>) {
    let mut dropped = 0;
    let mut link_errors = 0;
    let mut maintenance = false;
    loop {
        let (step, output) = STEP.receive().await;
        TELEMETRY_ALIVE.signal(());
        let summary = match with_timeout(SUMMARY_WAIT, SUMMARY.receive()).await {
            Ok((summary, d)) => {
                dropped = d;
                Some(summary)
            }
            Err(_) => None,
        };
        while let Ok(command) = ALIGN.try_receive() {
            if let Some(trim) = session.command(command) {
                TRIM.signal(trim);
            }
        }
        if let Some(report) = summary.as_ref().and_then(|s| session.second(s)) {
            ALIGNMENT.signal(report);
        }
        let mut housekeeping = Housekeeping::new(&step, &output, summary.as_ref(), TIMER_HZ);
        housekeeping.unit_status |= who.unit_status;
        if let Some(errors) = LINK_ERRORS.try_take() {
            if errors != link_errors {
                housekeeping.unit_status |= unit::LINK_ERRORS;
            }
            link_errors = errors;
        }
        housekeeping.dropped = dropped;
        housekeeping.link_errors = link_errors;
        housekeeping.calibration = who.identity.calibration;
        housekeeping.sequence = who.identity.sequence;
        housekeeping.created_unix_s = who.identity.created_unix_s;
        if let Some(open) = MAINTENANCE_OPEN.try_take() {
            maintenance = open;
        }
        housekeeping.mode = match (maintenance, session.running()) {
            (true, _) => mode::MAINTENANCE,
            (false, true) => mode::ALIGN,
            (false, false) => mode::NAVIGATE,
        };
        HOUSEKEEPING.signal(housekeeping);
        LOG.signal(housekeeping);
    }
}

/// One line a second over RTT: enough to make a recording of.
#[embassy_executor::task]
pub async fn log() {
    loop {
        let h = LOG.wait().await;
        let (f, t, r, b, w) = (h.frequency_hz, h.temperature_c, h.rate_c_per_min, h.bias_dph, h.raw_dph);
        defmt::info!(
            "t={=u32} f={=f64},{=f64},{=f64} T={=f32},{=f32},{=f32} dT={=f32},{=f32},{=f32} b={=f32},{=f32},{=f32} raw={=f32},{=f32},{=f32} status={=u8:02x},{=u8:02x},{=u8:02x},{=u8:02x} cal={=u32:08x} no={=u32} made={=u32} mode={=u8}",
            h.time_ms, f[0], f[1], f[2], t[0], t[1], t[2], r[0], r[1], r[2], b[0], b[1], b[2], w[0], w[1], w[2],
            h.axis_status[0], h.axis_status[1], h.axis_status[2], h.unit_status, h.calibration, h.sequence, h.created_unix_s, h.mode
        );
    }
}
