//! The course of the bring-up: waits, measures, has the table printed.

use super::listener::{Counts, Listener};
use super::table::{Item, Reached};
use super::waves::{Waves, PERIODS};
use super::{adc_model, cycles, ERASE, ERASE_US, OWN, SAMPLES, SUM, WORST};
use crate::params;
use core::sync::atomic::Ordering::Relaxed;
use embassy_futures::yield_now;
use embassy_stm32::pac;
use embassy_time::{Duration, Instant, Ticker};
use hrg_core::calibration::Calibration;
use hrg_core::compensator::Compensator;
use hrg_core::frequency::StepFrequencies;
use hrg_core::AXES;
use static_cell::StaticCell;

/// The link is looked at, and the waves are dithered, this often.
const LOOK: Duration = Duration::from_millis(10);
/// A unit whose frames have not come after that sends none.
const FIRST_FRAME: u32 = 300;
/// Looks until frequencies and the clock's correction stand, and looks of the main part: seconds by 100.
const SETTLE: u32 = 700;
const MAIN: u32 = 400;
/// Looks in which the unit answers, and in which it resets the ADC and sets it up again.
const ANSWER: u32 = 20;
const RESET: u32 = 50;
/// Channel 4 of TIM5 takes LSI: TI4_RMP = 1 (RM0390 section 17.4, TIM5_OR).
const LSI_TO_CHANNEL_4: u32 = 1 << 6;
/// And of that each eighth rising edge.
const LSI_EDGES: u32 = 8;
/// Seconds of the main part.
const SECONDS: f32 = MAIN as f32 / 100.0;
/// Cycles of a microsecond.
const CYCLES_PER_US: u32 = params::TIMER_HZ / 500_000;

/// State of the course of measurements.
struct Bench {
    listener: Listener,
    waves: Waves,
    ticker: Ticker,
    reached: Reached,
}

/// See the module.
#[embassy_executor::task]
pub async fn task(listener: Listener, waves: Waves) {
    let mut bench = Bench { listener, waves, ticker: Ticker::every(LOOK), reached: Reached::nothing() };
    defmt::info!("bring-up begins: waves, data-ready and pulses are on");
    bench.first_frame().await;
    bench.looks(SETTLE).await;
    bench.main().await;
    bench.periods().await;
    bench.lsi().await;
    bench.update().await;
    bench.load().await;
    bench.question().await;
    bench.reset().await;
    bench.reached.print().await;
    // The unit goes on, with its waves.
    loop {
        bench.looks(1).await;
    }
}

impl Bench {
    /// Goes on for a while.
    async fn looks(&mut self, looks: u32) {
        for _ in 0..looks {
            self.ticker.next().await;
            self.look();
        }
    }

    fn look(&mut self) {
        self.waves.dither();
        self.listener.take();
    }

    async fn first_frame(&mut self) {
        let erase = ERASE.load(Relaxed);
        if erase > 0 {
            self.reached.set(Item::Erase, erase as f32 / (1000 * CYCLES_PER_US) as f32);
        }
        for _ in 0..FIRST_FRAME {
            self.looks(1).await;
            if self.listener.counts.rates > 0 {
                let us = Instant::now().as_micros() as u32 - ERASE_US.load(Relaxed);
                let ms = us as f32 / 1000.0;
                self.reached.set(Item::FirstFrame, ms);
                defmt::info!("first rate frame {=f32} ms after the start of the clocks", ms);
                return;
            }
        }
        defmt::error!("no rate frame: look at data-ready (PC9-PB2), the ADC's jumpers and the link out (PA9-PD2)");
    }

    /// Frequencies, samples, rates, frames, pulses, the way of a sample.
    async fn main(&mut self) {
        self.listener.counts = Counts::default();
        SUM.store(0, Relaxed);
        WORST.store(0, Relaxed);
        SAMPLES.store(0, Relaxed);
        self.looks(MAIN).await;
        let (samples, sum, worst) = (SAMPLES.load(Relaxed), SUM.load(Relaxed), WORST.load(Relaxed));
        let reached = &mut self.reached;
        if samples > 0 {
            reached.set(Item::Latency, sum as f32 / samples as f32);
            reached.set(Item::WorstLatency, worst as f32);
        }
        let counts = &self.listener.counts;
        reached.set(Item::RateFrames, counts.rates as f32 / SECONDS);
        reached.set(Item::BadFrames, counts.bad as f32);
        if counts.rates > 0 {
            for (item, sum) in [Item::RateX, Item::RateY, Item::RateZ].into_iter().zip(counts.sums) {
                reached.set(item, (sum / f64::from(counts.rates)) as f32);
            }
        }
        reached.set(Item::Pulses, counts.pulses as f32);
        let Some(last) = &counts.last else {
            defmt::error!("no housekeeping: look at the link out (PA9-PD2)");
            return;
        };
        reached.set(Item::Samples, counts.samples as f32 / counts.seconds as f32);
        reached.set(Item::AdcErrors, counts.adc_errors as f32);
        reached.set(Item::EdgesLost, counts.edges_lost as f32);
        for (item, f) in [Item::WaveX, Item::WaveY, Item::WaveZ].into_iter().zip(last.frequency_hz) {
            reached.set(item, f as f32);
        }
        reached.set(Item::Clock, last.clock_ppb);
        reached.set(Item::Status, f32::from(counts.flags));
    }

    /// Periods of wave x as TIM2 captures them: its capture register, looked at for a quarter of a second. (The DMA takes it as well.) What is longer
    /// than a period and a half are two, where an interrupt has kept this from looking; missing edges are the unit's to find.
    async fn periods(&mut self) {
        let capture = || pac::TIM2.ccr(0).read();
        let (mut shortest, mut longest) = (u32::MAX, 0);
        let mut before = capture();
        let mut whole = false;
        for _ in 0..50 {
            let begun = cycles();
            while cycles().wrapping_sub(begun) < 5000 * CYCLES_PER_US {
                let now = capture();
                if now != before {
                    let period = now.wrapping_sub(before);
                    if core::mem::replace(&mut whole, true) && period < u32::from(PERIODS[0]) * 3 / 2 {
                        shortest = shortest.min(period);
                        longest = longest.max(period);
                    }
                    before = now;
                }
            }
            self.looks(1).await;
            before = capture();
            whole = false;
        }
        if longest > 0 {
            self.reached.set(Item::ShortestPeriod, shortest as f32);
            self.reached.set(Item::LongestPeriod, longest as f32);
        }
    }

    /// LSI, which the watchdog runs on, by the timer of the time driver: its channel 4 is free, and nothing else of it is touched. It counts
    /// microseconds of the crystal, as 16 bits.
    async fn lsi(&mut self) {
        let timer = pac::TIM5;
        timer.or().write_value(LSI_TO_CHANNEL_4);
        timer.ccmr_input(1).modify(|w| {
            w.set_ccs(1, pac::timer::vals::CcmrInputCcs::TI4);
            w.set_icpsc(1, 3);
        });
        timer.ccer().modify(|w| w.set_cce(3, true));
        let capture = || timer.ccr(3).read() as u16;
        let (mut shortest, mut longest, mut sum, mut count) = (u16::MAX, 0, 0, 0u32);
        for _ in 0..50 {
            self.looks(1).await;
            let (mut before, mut whole) = (capture(), false);
            let begun = cycles();
            while cycles().wrapping_sub(begun) < 5000 * CYCLES_PER_US {
                let now = capture();
                if now == before {
                    continue;
                }
                let took = now.wrapping_sub(before);
                before = now;
                if core::mem::replace(&mut whole, true) {
                    shortest = shortest.min(took);
                    longest = longest.max(took);
                    sum += u32::from(took);
                    count += 1;
                }
            }
        }
        timer.ccer().modify(|w| w.set_cce(3, false));
        if count > 0 {
            self.reached.set(Item::Lsi, 1e6 * (count * LSI_EDGES) as f32 / sum as f32);
            self.reached.set(Item::LsiSpread, f32::from(longest - shortest));
        }
    }

    /// A model step of the three axes, on a model of its own, with interrupts off.
    async fn update(&mut self) {
        static MODEL: StaticCell<Compensator> = StaticCell::new();
        let model = crate::compensator(&MODEL, &Calibration::uncalibrated());
        let mut sum = 0;
        const STEPS: u32 = 8;
        for step in 0..STEPS {
            let f = [4900.0, 4892.0, 4703.7].map(|f| Some(f + 0.001 * f64::from(step)));
            let end_ticks = u64::from(step + 1) * u64::from(params::TIMER_HZ);
            let step = StepFrequencies { step, end_ticks, frequency_hz: f, rejected: [0; AXES], missing: [0; AXES] };
            sum += cortex_m::interrupt::free(|_| {
                let begun = cycles();
                core::hint::black_box(model.update(core::hint::black_box(&step)));
                cycles().wrapping_sub(begun)
            });
            self.looks(1).await;
        }
        self.reached.set(Item::Update, sum as f32 / STEPS as f32);
    }

    /// Measures the load of the unit in a second: this task does nothing but let the others run, and reads the cycles. A
    /// turn that is longer than the shortest by half as much again was not its own alone: the excess is the unit's.
    async fn load(&mut self) {
        let mut least = u32::MAX;
        let mut last = cycles();
        let mut turn = async || {
            yield_now().await;
            // (The time is part of a turn, so that each takes the same.)
            let time = Instant::now();
            let now = cycles();
            (time, now, now.wrapping_sub(core::mem::replace(&mut last, now)))
        };
        for _ in 0..1000 {
            least = least.min(turn().await.2);
        }
        let own_before = OWN.load(Relaxed);
        let (mut busy, mut look, mut looked) = (0u32, Instant::now() + LOOK, false);
        let end = look + Duration::from_secs(1);
        loop {
            let (time, _, took) = turn().await;
            if took > least + least / 2 && !core::mem::take(&mut looked) {
                busy += took - least;
            }
            if time >= look {
                look += LOOK;
                self.look();
                // The turn that this is in is left out.
                looked = true;
            }
            if time >= end {
                break;
            }
        }
        let own = OWN.load(Relaxed).wrapping_sub(own_before);
        let busy = busy.saturating_sub(own);
        self.reached.set(Item::Load, busy as f32 / (10_000 * CYCLES_PER_US) as f32);
        self.ticker.reset();
    }

    async fn question(&mut self) {
        self.listener.counts = Counts::default();
        self.listener.ask();
        self.looks(ANSWER).await;
        self.reached.set(Item::Answers, self.listener.counts.identities as f32);
    }

    /// Three bad frames in a row: the unit resets the ADC by its pin.
    async fn reset(&mut self) {
        let before = adc_model::resets();
        adc_model::invalidate(u32::from(hrg_core::adc::BAD_IN_A_ROW));
        self.looks(RESET).await;
        self.reached.set(Item::AdcReset, adc_model::resets().wrapping_sub(before) as f32);
    }
}
