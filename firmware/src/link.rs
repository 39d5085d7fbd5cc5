//! The RS-422 link on one USART: frames out by DMA, commands in by a DMA ring.

use crate::channels::{Who, ANSWER, DIVIDER, FRAMES, HOUSEKEEPING, LINK_ERRORS};
use embassy_futures::select::{select3, Either3};
use embassy_stm32::mode::Async;
use embassy_stm32::usart::{RingBufferedUartRx, UartTx};
use hrg_core::link::{Deframer, Message};

/// Sends: rates first, then answers, then housekeeping.
#[embassy_executor::task]
pub async fn send(mut uart: UartTx<'static, Async>) {
    loop {
        let message = match select3(FRAMES.receive(), ANSWER.wait(), HOUSEKEEPING.wait()).await {
            Either3::First(frame) => Message::Rate(frame),
            Either3::Second(answer) => answer,
            Either3::Third(housekeeping) => Message::Housekeeping(housekeeping),
        };
        // A transmit error would be one of the DMA's set-up; there is nobody to tell but the next frame.
        let _ = uart.write(&message.encode()).await;
    }
}

/// Listens: garbage is counted and skipped.
#[embassy_executor::task]
pub async fn receive(mut uart: RingBufferedUartRx<'static>, who: Who) {
    let mut deframer = Deframer::default();
    let mut errors = 0u16;
    let mut buffer = [0u8; 64];
    loop {
        let received = match uart.read(&mut buffer).await {
            Ok(n) => &buffer[..n],
            Err(_) => {
                errors = errors.saturating_add(1);
                LINK_ERRORS.signal(errors);
                continue;
            }
        };
        for &byte in received {
            match deframer.push(byte) {
                None => {}
                Some(Ok(Message::Identify)) => ANSWER.signal(Message::Identity(who.identity)),
                Some(Ok(Message::SetDivider(divider))) => DIVIDER.signal(divider),
                // Our own kind of message coming in, or garbage.
                Some(_) => {
                    errors = errors.saturating_add(1);
                    LINK_ERRORS.signal(errors);
                }
            }
        }
    }
}
