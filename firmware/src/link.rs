//! The RS-422 link on one USART: frames out by DMA, commands in by a DMA ring.

use crate::capture::Clock;
#[cfg(feature = "inputs")]
use crate::channels::INPUTS;
use crate::channels::{
    ALIGN, ALIGNMENT, ANSWER, DECIMATION, ECHOED, FRAMES, HOUSEKEEPING, INPUTS_USED, LINK_ALIVE, LINK_ERRORS, MAINTAIN,
    PROGRAMS, STOPPED,
};
use crate::maintain;
use crate::receive::Receiver;
use crate::stop::halt;
use core::sync::atomic::Ordering;
use embassy_futures::select::{select4, Either4};
use embassy_stm32::mode::Async;
use embassy_stm32::usart::UartTx;
use hrg_core::link::{Deframer, Identity, Message};
use hrg_core::maintenance::Command;
use hrg_core::reset::Halt;
use hrg_core::stopped::Stopped;

/// Sends: rates first, then answers, then housekeeping, then the alignment's report, the inputs that were used, word of a stop, and the programs.
#[embassy_executor::task]
pub async fn send(mut uart: UartTx<'static, Async>) {
    loop {
        let others = select4(ALIGNMENT.wait(), INPUTS_USED.wait(), STOPPED.wait(), PROGRAMS.wait());
        let message = match select4(FRAMES.receive(), ANSWER.wait(), HOUSEKEEPING.wait(), others).await {
            Either4::First(frame) if !frame.intact() => {
                defmt::error!("a frame has changed in memory");
                halt(Halt::Corruption)
            }
            Either4::First(frame) => {
                let _ = uart.write(&hrg_fast::encode(&frame)).await;
                LINK_ALIVE.give();
                continue;
            }
            Either4::Second(answer) => answer,
            Either4::Third(housekeeping) => Message::Housekeeping(housekeeping),
            Either4::Fourth(Either4::First(report)) => Message::Alignment(report),
            Either4::Fourth(Either4::Second(used)) => Message::InputsUsed(used),
            Either4::Fourth(Either4::Third(stopped)) => Message::Stopped(stopped),
            Either4::Fourth(Either4::Fourth(programs)) => Message::Programs(programs),
        };
        // A transmit error would be one of the DMA's set-up; there is nobody to tell but the next frame.
        let _ = uart.write(&message.encode()).await;
        LINK_ALIVE.give();
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
                    ANSWER.signal(Message::Identity(identity));
                    token = Clock.now() | 1;
                    PROGRAMS.signal(maintain::programs(token));
                    if stopped.says_something() {
                        STOPPED.signal(stopped);
                    }
                }
                Some(Ok(Message::SetDecimation(decimation))) => DECIMATION.signal(decimation),
                // A host that sends commands faster than one a quarter second loses some, and sees it in the reports.
                Some(Ok(Message::Align(command))) => drop(ALIGN.try_send(command)),
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
