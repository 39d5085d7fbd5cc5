//! The time of embassy's tasks, by TIM5 with all its 32 bits.
//!
//! # Design
//! embassy-stm32 drives any timer as one of 16 bits: at 1 MHz it turns in 65 ms, and while a sector of flash is erased turns are lost (0.5 s count as 110 ms).
//! Here the counter turns in 71 minutes ([`hrg_core::uptime`]); channel 1 interrupts half-way, and channel 2 is the alarm. It also costs 30 interrupts a second less.

use core::cell::RefCell;
use core::sync::atomic::{AtomicU32, Ordering};
use core::task::Waker;
use critical_section::{CriticalSection, Mutex};
use embassy_stm32::interrupt::{self, InterruptExt};
use embassy_stm32::pac;
use embassy_stm32::peripherals::TIM5;
use embassy_stm32::rcc;
use embassy_time_driver::Driver;
use embassy_time_queue_utils::Queue;
use hrg_core::uptime::{alarm, now_us, HALF_US};

/// Channels of the compare half-way and of the alarm.
const HALF_WAY: usize = 0;
const ALARM: usize = 1;

struct Time {
    /// Halves since the start.
    halves: AtomicU32,
    queue: Mutex<RefCell<Queue>>,
}

embassy_time_driver::time_driver_impl!(static TIME: Time = Time {
    halves: AtomicU32::new(0),
    queue: Mutex::new(RefCell::new(Queue::new())),
});

/// Starts the time: after the clocks are set up, and before the first task.
pub fn start() {
    rcc::enable_and_reset::<TIM5>();
    let timer = pac::TIM5;
    let prescaler = rcc::frequency::<TIM5>().0 / 1_000_000 - 1;
    timer.psc().write_value(prescaler as u16);
    timer.arr().write_value(u32::MAX);
    // The prescaler is taken over at an update, whose flag is not wanted.
    timer.egr().write(|w| w.set_ug(true));
    timer.sr().write_value(pac::timer::regs::SrGp16(0));
    timer.ccr(HALF_WAY).write_value(HALF_US as u32);
    timer.dier().write(|w| {
        w.set_uie(true);
        w.set_ccie(HALF_WAY, true);
    });
    timer.cr1().modify(|w| w.set_cen(true));
    interrupt::TIM5.unpend();
    // SAFETY: what the handler touches is set up.
    #[allow(unsafe_code)]
    unsafe {
        interrupt::TIM5.enable();
    }
}

/// A half has ended, or an alarm is due.
#[embassy_stm32::interrupt]
fn TIM5() {
    let timer = pac::TIM5;
    let flags = timer.sr().read();
    timer.sr().write_value(pac::timer::regs::SrGp16(!flags.0));
    critical_section::with(|cs| {
        let halves = u32::from(flags.uif()) + u32::from(flags.ccif(HALF_WAY));
        if halves > 0 {
            TIME.halves.store(TIME.halves.load(Ordering::Relaxed) + halves, Ordering::Relaxed);
        }
        TIME.wake_due(cs);
    });
}

impl Time {
    /// Wakes what is due, and sets the alarm of what comes next.
    fn wake_due(&self, cs: CriticalSection<'_>) {
        let mut next = self.queue.borrow_ref_mut(cs).next_expiration(self.now());
        while !self.set_alarm(next) {
            next = self.queue.borrow_ref_mut(cs).next_expiration(self.now());
        }
    }

    /// `false`: it is due already.
    fn set_alarm(&self, at: u64) -> bool {
        let due = alarm(at, self.now());
        let timer = pac::TIM5;
        if let Some(counter) = due {
            timer.ccr(ALARM).write_value(counter);
        }
        timer.dier().modify(|w| w.set_ccie(ALARM, due.is_some()));
        // (It may have passed while it was being set.)
        at > self.now()
    }
}

impl Driver for Time {
    fn now(&self) -> u64 {
        let halves = self.halves.load(Ordering::Relaxed);
        core::sync::atomic::compiler_fence(Ordering::Acquire);
        now_us(halves, pac::TIM5.cnt().read())
    }

    fn schedule_wake(&self, at: u64, waker: &Waker) {
        critical_section::with(|cs| {
            if self.queue.borrow_ref_mut(cs).schedule_wake(at, waker) {
                self.wake_due(cs);
            }
        });
    }
}
