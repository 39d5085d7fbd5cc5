//! Frequency to temperature as others would write it, beside ours: each is called with the same frequencies, the virtual board
//! counts the instructions of the calls and reads the results (`hrg-study bench`). Nothing here touches a peripheral.
//!
//! All are of one and the same curve: the default's for axis x, given as cubic `T(u)`, uncentred, as forward cubic `f(T)`, as table
//! and as network trained on it (the numbers are printed by `bench/alternatives.py`).
#![no_std]
#![no_main]

use core::hint::black_box;
use core::sync::atomic::{AtomicU32, Ordering};
use defmt_rtt as _;
use embassy_stm32 as _;
use hrg_core::temperature::TemperatureCurve;

/// Frequencies tried: evenly over the range of the curve and a little beyond.
const POINTS: usize = 200;
const LOWEST_HZ: f64 = 4878.0;
const STEP_HZ: f64 = 0.22;
const METHODS: usize = 8;

/// Results, as bits of f32, method by method.
static RESULTS: [[AtomicU32; POINTS]; METHODS] = [const { [const { AtomicU32::new(0) }; POINTS] }; METHODS];

const LAW: TemperatureCurve = TemperatureCurve {
    frequency_centre_hz: 4900.0,
    frequency_scale_hz: 21.152,
    temperature_coefficients_c: [9.218_105, 44.580_624, 1.161_163_1, 0.166_985_72],
    valid_from_c: -34.374,
    valid_to_c: 55.128,
};
/// The same in powers of f.
const UNCENTRED: [f64; 4] =
    [-2_023_937.277_596_904_7, 1_247.652_704_013_911, -0.256_788_188_553_208_45, 1.764_513_640_741_762_3e-5];
const UNCENTRED_SINGLE: [f32; 4] = [UNCENTRED[0] as f32, UNCENTRED[1] as f32, UNCENTRED[2] as f32, UNCENTRED[3] as f32];
/// The forward cubic.
const FORWARD: [f64; 4] =
    [4_895.602_740_431_214, 0.479_352_328_114_589_44, -0.000_257_673_834_871_828_66, -5.622_241_434_603_012e-7];
/// Hidden weights, hidden offsets, output weights, output offset of the network; it gives T / 45 of u.
const NETWORK: [f32; 16] = [
    0.421_714_8,
    0.308_247_4,
    -0.309_429_38,
    -0.263_655_28,
    -0.353_869_17,
    -1.751_614_7,
    -0.533_016_9,
    1.376_270_7,
    -0.332_355_17,
    -1.584_396_2,
    1.433_233,
    1.450_127_6,
    -0.664_610_9,
    -1.909_635_9,
    -1.518_989_4,
    0.837_912_6,
];

#[inline(never)]
fn uncentred_single(f: f32) -> f32 {
    let c = UNCENTRED_SINGLE;
    ((c[3] * f + c[2]) * f + c[1]) * f + c[0]
}

#[inline(never)]
fn uncentred_double(f: f64) -> f64 {
    let c = UNCENTRED;
    ((c[3] * f + c[2]) * f + c[1]) * f + c[0]
}

#[inline(never)]
fn newton(f: f64) -> f64 {
    let c = FORWARD;
    let mut t = (f - c[0]) / c[1];
    for _ in 0..20 {
        let step = (((c[3] * t + c[2]) * t + c[1]) * t + c[0] - f) / ((3.0 * c[3] * t + 2.0 * c[2]) * t + c[1]);
        t -= step;
        if libm::fabs(step) < 1e-9 {
            break;
        }
    }
    t
}

#[inline(never)]
fn cardano(f: f64) -> f64 {
    // Of the three real roots the middle one is the temperature.
    let (a, b, c) = (FORWARD[2] / FORWARD[3], FORWARD[1] / FORWARD[3], (FORWARD[0] - f) / FORWARD[3]);
    let p = b - a * a / 3.0;
    let q = 2.0 * a * a * a / 27.0 - a * b / 3.0 + c;
    let radius = 2.0 * libm::sqrt(-p / 3.0);
    let angle = libm::acos(3.0 * q / (p * radius)) / 3.0;
    radius * libm::cos(angle - 2.0 * core::f64::consts::PI / 3.0) - a / 3.0
}

const CELLS: usize = 64;
const FROM: f32 = -1.1;
const WIDTH: f32 = 2.2 / CELLS as f32;

#[inline(never)]
fn table(entries: &[f32; CELLS + 1], f: f64) -> f32 {
    let at = (LAW.normalised(f) - FROM) / WIDTH;
    let cell = (at as usize).min(CELLS - 1);
    entries[cell] + (entries[cell + 1] - entries[cell]) * (at - cell as f32)
}

#[inline(never)]
fn network(f: f64) -> f32 {
    let u = LAW.normalised(f);
    let mut sum = NETWORK[15];
    for i in 0..5 {
        sum += NETWORK[10 + i] * libm::tanhf(NETWORK[i] * u + NETWORK[5 + i]);
    }
    45.0 * sum
}

/// The same with micromath's approximation of the exponential.
#[inline(never)]
fn network_micromath(f: f64) -> f32 {
    let u = LAW.normalised(f);
    let mut sum = NETWORK[15];
    for i in 0..5 {
        let e = micromath::F32Ext::exp(2.0 * (NETWORK[i] * u + NETWORK[5 + i]));
        sum += NETWORK[10 + i] * (1.0 - 2.0 / (e + 1.0));
    }
    45.0 * sum
}

#[inline(never)]
fn ours(f: f64) -> f32 {
    LAW.temperature_c(f)
}

#[cortex_m_rt::entry]
fn main() -> ! {
    let mut entries = [0.0; CELLS + 1];
    for (k, e) in entries.iter_mut().enumerate() {
        *e = LAW.at_c(FROM + WIDTH * k as f32);
    }
    for k in 0..POINTS {
        let f = black_box(LOWEST_HZ + STEP_HZ * k as f64);
        let results = [
            uncentred_single(black_box(f as f32)),
            uncentred_double(f) as f32,
            newton(f) as f32,
            cardano(f) as f32,
            table(black_box(&entries), f),
            network(f),
            network_micromath(f),
            ours(f),
        ];
        for (method, result) in RESULTS.iter().zip(results) {
            method[k].store(result.to_bits(), Ordering::Relaxed);
        }
    }
    // The board reads them.
    black_box(&RESULTS);
    loop {
        cortex_m::asm::wfe();
    }
}

/// A panic here is a bug of the bench.
#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    cortex_m::asm::udf()
}
