//! The RS-422 link on one USART: frames out by DMA, commands in by a DMA ring.

use crate::capture::Clock;
#[cfg(feature = "inputs")]
use crate::channels::INPUTS;
use crate::channels::{
    self, Fast, ALIGN, ALIGNMENT, ANSWER, DECIMATION, ECHOED, FRAMES, HOUSEKEEPING, INPUTS_USED, LINK_ALIVE,
    LINK_ERRORS, MAINTAIN, NEWS, PROGRAMS, STOPPED,
};
use crate::maintain;
use crate::params::LINK_BAUD;
#[cfg(feature = "mavlink")]
use crate::params::TIMEBASE;
use crate::receive::Receiver;
use crate::stop::halt;
use core::sync::atomic::Ordering;
use embassy_futures::select::{select, Either};
use embassy_stm32::mode::Async;
use embassy_stm32::usart::UartTx;
#[cfg(feature = "mavlink")]
use hrg_core::gnss::TimeMark;
use hrg_core::link::{Deframer, Identity, Message, FAST_FRAME, RATE_FRAME};
use hrg_core::maintenance::Command;
#[cfg(feature = "mavlink")]
use hrg_core::mavlink::{self, Encoder, Imu};
#[cfg(feature = "mavlink")]
use hrg_core::output::Framing;
use hrg_core::output::MOST_MESSAGES_PER_S;
use hrg_core::reset::Halt;
use hrg_core::stopped::Stopped;

// (Ten bits a byte; a third of the line stays for answers.)
const _: () =
    assert!(MOST_MESSAGES_PER_S as usize * 10 * (5 * FAST_FRAME + RATE_FRAME) / 6 <= LINK_BAUD as usize * 2 / 3);

/// The next of what is sent seldom: answers, housekeeping, the alignment's report, the inputs that were used, word of a stop, the programs, the time.
fn seldom() -> Option<Message> {
    #[cfg(feature = "pps")]
    let mark = || channels::TIME_MARK.take().map(Message::TimeMark);
    #[cfg(not(feature = "pps"))]
    let mark = || None;
    ANSWER
        .take()
        .or_else(|| HOUSEKEEPING.take().map(Message::Housekeeping))
        .or_else(|| ALIGNMENT.take().map(Message::Alignment))
        .or_else(|| INPUTS_USED.take().map(Message::InputsUsed))
        .or_else(|| STOPPED.take().map(Message::Stopped))
        .or_else(|| PROGRAMS.take().map(Message::Programs))
        .or_else(mark)
}

/// Stops the unit where what came out of the queue has changed in memory.
#[inline(never)]
fn must_be_intact(fast: &Fast) {
    if !fast.intact() {
        defmt::error!("a frame has changed in memory");
        halt(Halt::Corruption)
    }
}

/// The same where a message that is sent seldom is one of the rate path: those come by its queue alone, and are looked at there.
#[inline(never)]
fn must_be_seldom(message: &Message) {
    if matches!(message, Message::Rate(_) | Message::Increments(_)) {
        defmt::error!("a message has changed in memory");
        halt(Halt::Corruption)
    }
}

/// Appends a message of the rate path in the link's own framing.
fn append(fast: &Fast, bytes: &mut heapless::Vec<u8, { hrg_fast::FAST }>) {
    match fast {
        Fast::Rates(frame) => hrg_fast::encode(frame, bytes),
        Fast::Increments(increments) => hrg_fast::encode_increments(increments, bytes),
    }
}

/// Sends: rates and increments first, then what is sent [`seldom`].
#[embassy_executor::task]
pub async fn send(mut uart: UartTx<'static, Async>) {
    #[cfg(feature = "mavlink")]
    let mut mavlink = Mavlink::default();
    loop {
        let message = match select(FRAMES.receive(), NEWS.wait()).await {
            Either::First(fast) => {
                must_be_intact(&fast);
                #[cfg(feature = "mavlink")]
                if channels::sent().framing == Framing::Mavlink {
                    if let Some(packet) = mavlink.fast(&fast) {
                        let _ = uart.write(&packet).await;
                    }
                    LINK_ALIVE.give();
                    continue;
                }
                // (Increments that come with a rate frame go out with it: a transfer costs more than a frame.)
                let mut bytes = heapless::Vec::new();
                append(&fast, &mut bytes);
                if let Ok(next) = FRAMES.try_receive() {
                    must_be_intact(&next);
                    append(&next, &mut bytes);
                }
                let _ = uart.write(&bytes).await;
                LINK_ALIVE.give();
                continue;
            }
            Either::Second(()) => match seldom() {
                Some(message) => message,
                None => continue,
            },
        };
        must_be_seldom(&message);
        // (There may be more; rates go out before it.)
        NEWS.signal(());
        #[cfg(feature = "mavlink")]
        if channels::sent().framing == Framing::Mavlink {
            if mavlink.keep(&message) {
                continue;
            }
            if let Some(packet) = mavlink.seldom(&message) {
                let _ = uart.write(&packet).await;
                LINK_ALIVE.give();
                continue;
            }
            // (A zero before it: what stands in MAVLink's packets is none of its bytes.)
            let _ = uart.write(&[0]).await;
        }
        // A transmit error would be one of the DMA's set-up; there is nobody to tell but the next frame.
        let _ = uart.write(&message.encode()).await;
        LINK_ALIVE.give();
    }
}

/// Packets in MAVLink's framing ([`hrg_core::mavlink`]).
#[cfg(feature = "mavlink")]
#[derive(Default)]
struct Mavlink {
    encoder: Encoder,
    mark: Option<TimeMark>,
    correction: f64,
    temperature_c: Option<f32>,
}

#[cfg(feature = "mavlink")]
impl Mavlink {
    /// The packet of rates, where no increments are sent, or of increments.
    fn fast(&mut self, fast: &Fast) -> Option<heapless::Vec<u8, { mavlink::LONGEST }>> {
        let (tick, rate_rads, force_mps2) = match fast {
            Fast::Rates(_) if channels::sent().increments > 0 => return None,
            Fast::Rates(frame) => (frame.tick, mavlink::of_rates(frame), None),
            Fast::Increments(increments) => mavlink::of_increments(increments, TIMEBASE),
        };
        let time_us = self.encoder.time_us(tick, TIMEBASE, self.mark.as_ref(), self.correction);
        Some(self.encoder.imu(&Imu { time_us, rate_rads, force_mps2, temperature_c: self.temperature_c }))
    }

    /// Keeps the time that a message tells; `true`: nobody has asked for the message, and it goes out in no other way.
    fn keep(&mut self, message: &Message) -> bool {
        if let Message::TimeMark(mark) = message {
            self.mark = Some(*mark);
        }
        matches!(message, Message::TimeMark(_) | Message::InputsUsed(_))
    }

    /// A heartbeat in the place of housekeeping. `None`: the message goes out in the unit's own framing, as it was asked for.
    fn seldom(&mut self, message: &Message) -> Option<heapless::Vec<u8, { mavlink::LONGEST }>> {
        let Message::Housekeeping(h) = message else { return None };
        self.correction = 1e-9 * f64::from(h.clock_ppb);
        self.temperature_c = h.temperature_c.first().copied().filter(|t| t.is_finite());
        Some(self.encoder.heartbeat(h.unit_status.is_empty()))
    }
}

/// Listens: garbage is counted and skipped.
#[embassy_executor::task]
pub async fn receive(mut receiver: Receiver, identity: Identity, stopped: Stopped) {
    let mut deframer = Deframer::default();
    // Bad frames and bytes lost; what was told of them and of the line's faults.
    let (mut errors, mut reported) = (0u16, 0);
    let mut buffer = [0u8; 64];
    // The number that was sent last, to be sent back; 0 was never.
    let mut token = 0;
    loop {
        let received = receiver.read(&mut buffer).await;
        errors = errors.saturating_add(u16::from(received.is_none()));
        for &byte in buffer.get(..received.unwrap_or(0)).unwrap_or(&buffer) {
            match deframer.push_command(byte) {
                None => {}
                Some(Ok(Message::Identify)) => {
                    ANSWER.signal(Message::Identity(identity.with_output(channels::sent())));
                    token = Clock.now() | 1;
                    PROGRAMS.signal(maintain::programs(token));
                    if stopped.says_something() {
                        STOPPED.signal(stopped);
                    }
                }
                Some(Ok(Message::SetDecimation(decimation))) => DECIMATION.signal(decimation),
                // A host that sends commands faster than one a quarter second loses some, and sees it in the reports.
                Some(Ok(Message::Align(command))) => drop(ALIGN.try_send(command)),
                #[cfg(feature = "pps")]
                Some(Ok(Message::GnssTime(time))) => channels::GNSS_TIME.signal((time, Clock.now())),
                // The queue takes what the line can carry.
                #[cfg(feature = "inputs")]
                Some(Ok(Message::Inputs(values))) => {
                    errors = errors.saturating_add(INPUTS.try_send(values).is_err().into());
                }
                // The host waits for each answer, so there is room.
                Some(Ok(Message::Maintain(command))) => {
                    if token != 0 && command == Command::Echo(token) {
                        ECHOED.store(true, Ordering::Relaxed);
                    }
                    let _ = MAINTAIN.try_send(command);
                }
                // No command, or garbage.
                Some(_) => errors = errors.saturating_add(1),
            }
        }
        let all = errors.saturating_add(receiver.line_faults());
        if all != reported {
            reported = all;
            LINK_ERRORS.signal(all);
        }
    }
}
