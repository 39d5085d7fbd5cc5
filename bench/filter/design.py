"""Coefficients of hrg-core/src/filter.rs: a linear-phase low-pass filter from 1 kSPS to 200 frames a second.

Of all filters of that length whose stop band is at least STOP_DB down, the one whose pass band, behind the ADC's sinc3, is flattest: a
linear program. Run it with numpy and scipy (`cargo xtask peers` makes target/peers): target/peers/bin/python bench/filter/design.py
"""

import numpy as np
from scipy.optimize import linprog

RATE_HZ = 1000.0
BITS = 22  # The coefficients' sum is 2^22.
STOP_DB = 82.0
# Taps, end of the pass band, start of the stop band (Hz).
DESIGNS = {"HZ60": (54, 60.0, 130.0)}


def sinc3(f):
    """Response of the ADC's filter over one sample time (SBAS950)."""
    return np.sinc(f / RATE_HZ) ** 3


def design(taps, passes, stops):
    f = np.concatenate([np.linspace(0, passes, 200), np.linspace(stops, RATE_HZ / 2, 800)])
    response = 2 * np.cos(np.outer(2 * np.pi * f / RATE_HZ, np.arange(taps // 2) + 0.5))
    in_pass = f <= passes
    a = response[in_pass] * sinc3(f[in_pass])[:, None]
    b = response[~in_pass]
    one, none = np.ones((len(a), 1)), np.zeros((len(b), 1))
    rows = np.vstack([np.hstack([a, -one]), np.hstack([-a, -one]), np.hstack([b, none]), np.hstack([-b, none])])
    limits = np.concatenate([one[:, 0], -one[:, 0], np.full(2 * len(b), 10 ** (-STOP_DB / 20))])
    cost = np.zeros(taps // 2 + 1)
    cost[-1] = 1
    sums = np.append(np.full(taps // 2, 2.0), 0.0)[None]
    found = linprog(cost, rows, limits, sums, [1.0], [(None, None)] * len(cost), method="highs").x[:-1]
    whole = np.round(found * 2**BITS)
    whole[0] += 2 ** (BITS - 1) - whole.sum()
    return whole.astype(int)


def as_of_4096(f):
    """Response of the ADC with an oversampling of 4096: a sinc3 of a quarter of the sample time, and the mean of four behind it."""
    return np.sinc(f / RATE_HZ / 4) ** 3 * np.sinc(f / RATE_HZ) / np.sinc(f / RATE_HZ / 4)


def db(gain):
    return 20 * np.log10(np.abs(gain))


for f in (940.0, 1060.0):
    print(f"// {f:.0f} Hz, which appears at 60 Hz: {db(sinc3(f)):.1f} dB by the sinc3, {db(as_of_4096(f)):.1f} dB with an oversampling of 4096")
for name, (taps, passes, stops) in DESIGNS.items():
    half = design(taps, passes, stops)
    full = np.concatenate([half[::-1], half]) / 2**BITS
    f = np.linspace(0, RATE_HZ / 2, 20001)
    gain = np.abs(np.exp(-2j * np.pi * np.outer(f, np.arange(taps)) / RATE_HZ) @ full)
    both = 20 * np.log10(np.maximum(gain * sinc3(f), 1e-12))
    print(f"// {name}: {taps} taps; to {passes:.0f} Hz {both[f <= passes].min():+.3f} to {both[f <= passes].max():+.3f} dB,")
    print(f"// from {stops:.0f} Hz on {20 * np.log10(gain[f >= stops].max()):.1f} dB; -3 dB at {f[np.argmax(both < -3)]:.1f} Hz")
    print(", ".join(str(c) for c in half))
