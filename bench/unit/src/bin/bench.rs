//! Cost of pieces of `hrg-core` on the target: each is called some times with inputs of a real run, and the virtual board
//! counts the instructions of the calls (`hrg-study align-demo`). Nothing here touches a peripheral.
#![no_std]
#![no_main]

use core::hint::black_box;
use defmt_rtt as _;
use embassy_stm32 as _;
use hrg_align::ekf::Ekf;
use hrg_align::linear::Linear;
use hrg_align::particles::{Kernels, Literal, CHEN};
use hrg_align::{Begin, Config, Estimate, Filter};
use static_cell::ConstStaticCell;

/// Calls of each.
const CALLS: u32 = 4;

#[inline(never)]
fn linear_step(f: &mut Linear<f32>, v: [f64; 2]) -> Option<[f64; 2]> {
    f.step(v)
}

#[inline(never)]
fn linear_estimate(f: &Linear<f32>) -> Option<Estimate> {
    f.estimate()
}

#[inline(never)]
fn ekf_step(f: &mut Ekf<f32>, v: [f64; 2]) -> Option<[f64; 2]> {
    f.step(v)
}

#[inline(never)]
fn kernels_step(f: &mut Kernels<f32, CHEN>, v: [f64; 2]) -> Option<[f64; 2]> {
    f.step(v)
}

#[inline(never)]
fn literal_step(f: &mut Literal<f32, CHEN>, v: [f64; 2]) -> Option<[f64; 2]> {
    f.step(v)
}

/// Velocities of a platform that tilts steadily.
fn velocity(second: u32) -> [f64; 2] {
    let t = f64::from(second);
    [9e-3 * t + 2e-4 * t * t, -8.5e-3 * t + 1e-4 * t * t]
}

#[cortex_m_rt::entry]
fn main() -> ! {
    if let Ok(config) = Config::new(45.0, 9.806, 3e-4) {
        let mut linear = Linear::<f32>::new(config);
        let mut ekf = Ekf::<f32>::new(config, 1.0, 1.0);
        for k in 1..=CALLS {
            let v = black_box(velocity(k));
            black_box(linear_step(&mut linear, v));
            black_box(linear_estimate(&linear));
            black_box(ekf_step(&mut ekf, v));
        }
        static KERNELS: ConstStaticCell<Kernels<f32, CHEN>> = ConstStaticCell::new(Kernels::IDLE);
        static LITERAL: ConstStaticCell<Literal<f32, CHEN>> = ConstStaticCell::new(Literal::IDLE);
        let (kernels, literal) = (KERNELS.take(), LITERAL.take());
        kernels.begin(config);
        literal.begin(config, 1);
        for k in 1..=CALLS {
            black_box(kernels_step(kernels, black_box(velocity(k))));
            black_box(literal_step(literal, black_box(velocity(k))));
        }
    }
    loop {
        cortex_m::asm::wfe();
    }
}

/// A panic here is a bug of the bench.
#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    cortex_m::asm::udf()
}
