//! Operators on sampled signals: delays, plays, relays and their like. Each takes the whole signal and returns one of the same length.
//! Times are in seconds, `dt_s` is the step.

/// First-order lag of time constant `tau_s`, from the state `start`.
#[must_use]
pub fn lag(x: &[f64], dt_s: f64, tau_s: f64, start: f64) -> Vec<f64> {
    let share = 1.0 - (-dt_s / tau_s).exp();
    let mut state = start;
    x.iter()
        .map(|&x| {
            state += share * (x - state);
            state
        })
        .collect()
}

/// First-order lag whose time constant depends on the sample number and on the gap `x - state`.
#[must_use]
pub fn lag_by(x: &[f64], dt_s: f64, start: f64, tau_s: impl Fn(usize, f64) -> f64) -> Vec<f64> {
    let mut state = start;
    x.iter()
        .enumerate()
        .map(|(i, &x)| {
            let gap = x - state;
            state += (1.0 - (-dt_s / tau_s(i, gap)).exp()) * gap;
            state
        })
        .collect()
}

/// `a - b`, sample by sample.
#[must_use]
pub fn minus(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a - b).collect()
}

/// Sum of `weight * signal`.
#[must_use]
pub fn sum(parts: &[(f64, Vec<f64>)]) -> Vec<f64> {
    let n = parts.first().map_or(0, |(_, x)| x.len());
    let mut total = vec![0.0; n];
    for (weight, x) in parts {
        for (total, x) in total.iter_mut().zip(x) {
            *total += weight * x;
        }
    }
    total
}

/// Relaxation with a spectrum of time constants: `(weight, tau_s)`.
#[must_use]
pub fn relaxation(x: &[f64], dt_s: f64, start: f64, spectrum: &[(f64, f64)]) -> Vec<f64> {
    let parts: Vec<_> = spectrum.iter().map(|&(weight, tau_s)| (weight, lag(x, dt_s, tau_s, start))).collect();
    sum(&parts)
}

/// The play (backlash) operator of half width `half_width`, from the state `start`.
#[must_use]
pub fn play(x: &[f64], half_width: f64, start: f64) -> Vec<f64> {
    play_by(x, start, |_| half_width)
}

/// A play whose half width depends on the input.
#[must_use]
pub fn play_by(x: &[f64], start: f64, half_width: impl Fn(f64) -> f64) -> Vec<f64> {
    let mut state = start;
    x.iter()
        .map(|&x| {
            let w = half_width(x);
            state = state.clamp(x - w, x + w);
            state
        })
        .collect()
}

/// A relay that switches to 1 above `up` and to -1 below `down`; between them it keeps its state, at first that of `start`'s sign.
#[must_use]
pub fn relay(x: &[f64], down: f64, up: f64, start: f64) -> Vec<f64> {
    let mut state = if start >= 0.0 { 1.0 } else { -1.0 };
    x.iter()
        .map(|&x| {
            if x >= up {
                state = 1.0;
            } else if x <= down {
                state = -1.0;
            }
            state
        })
        .collect()
}

/// Bouc-Wen: `dz = dx - |dx| |z/limit|^(n-1) (z/limit) b - dx |z/limit|^n (1-b)`; z stays within `limit`.
#[must_use]
pub fn bouc_wen(x: &[f64], limit: f64, n: f64, b: f64, start: f64) -> Vec<f64> {
    let mut z = start;
    let mut last = x.first().copied().unwrap_or(0.0);
    x.iter()
        .map(|&x| {
            let dx = x - last;
            last = x;
            let u = (z / limit).clamp(-1.0, 1.0);
            z += dx - b * dx.abs() * u.abs().powf(n - 1.0) * u - (1.0 - b) * dx * u.abs().powf(n);
            z
        })
        .collect()
}

/// Duhem's form after Coleman and Hodgdon: `dy = |dx| (f(x) - y) / span + slope dx`.
#[must_use]
pub fn duhem(x: &[f64], span: f64, slope: f64, f: impl Fn(f64) -> f64, start: f64) -> Vec<f64> {
    let mut y = start;
    let mut last = x.first().copied().unwrap_or(0.0);
    x.iter()
        .map(|&x| {
            let dx = x - last;
            last = x;
            y += dx.abs() * (f(x) - y) / span + slope * dx;
            y
        })
        .collect()
}

/// Dahl friction: `dF = dx |1 - F sign(dx)|^2 sign(1 - F sign(dx)) / span`; F stays within -1 to 1.
#[must_use]
pub fn dahl(x: &[f64], span: f64, start: f64) -> Vec<f64> {
    let mut force = start;
    let mut last = x.first().copied().unwrap_or(0.0);
    x.iter()
        .map(|&x| {
            let dx = x - last;
            last = x;
            let room = 1.0 - force * dx.signum();
            force = (force + dx / span * room * room.abs()).clamp(-1.0, 1.0);
            force
        })
        .collect()
}

/// Temperature at the far end of a rod whose near end is held at `x`: one-dimensional diffusion of time `diffusion_s` (length squared over
/// diffusivity), insulated at the far end, uniform at `start` before.
#[must_use]
pub fn rod_end(x: &[f64], dt_s: f64, diffusion_s: f64, start: f64) -> Vec<f64> {
    const CELLS: usize = 20;
    let number = dt_s / diffusion_s * (CELLS * CELLS) as f64;
    let mut rod = [start; CELLS + 1];
    x.iter()
        .map(|&x| {
            let old = rod;
            rod[0] = x;
            for i in 1..CELLS {
                rod[i] = old[i] + number * (old[i - 1] - 2.0 * old[i] + old[i + 1]);
            }
            rod[CELLS] = old[CELLS] + 2.0 * number * (old[CELLS - 1] - old[CELLS]);
            rod[CELLS]
        })
        .collect()
}

/// `x` as it was `delay_s` before; `start` until then.
#[must_use]
pub fn delayed(x: &[f64], dt_s: f64, delay_s: f64, start: f64) -> Vec<f64> {
    let steps = (delay_s / dt_s).round() as usize;
    (0..x.len()).map(|i| if i < steps { start } else { x[i - steps] }).collect()
}

/// Slope of `x` per minute, over `span_s` centred on each sample.
#[must_use]
pub fn slope_per_min(x: &[f64], dt_s: f64, span_s: f64) -> Vec<f64> {
    let half = ((span_s / dt_s / 2.0).round() as usize).max(1);
    (0..x.len())
        .map(|i| {
            let (from, to) = (i.saturating_sub(half), (i + half).min(x.len() - 1));
            (x[to] - x[from]) / ((to - from).max(1) as f64 * dt_s) * 60.0
        })
        .collect()
}
