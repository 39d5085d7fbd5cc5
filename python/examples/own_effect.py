# %% [markdown]
# # An effect of your own
# The library knows lags, hysteresis, shapes of temperature and some thirty more. Here is one that it does not know: the resonator's frequency
# falls with temperature until it meets a **resonance of its mount**. There energy leaks into the mount, and the bias has a peak: a Lorentz curve *of
# frequency*, at a place that a modal test of the mount tells, and of a width that nobody knows.
#
# The recordings are simulated; the peak is put in by hand, for the simulator does not know it either.

# %%
import sys

import matplotlib

if "ipykernel" not in sys.modules:
    matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

import hrg

MOUNT_HZ = {"x": 4906.0, "y": 4898.0, "z": 4709.6}  # from the modal test
TRUE_WIDTH_HZ, TRUE_PEAK_DPH = 1.5, 2.0


def lorentz(frequency_hz, axis, width_hz):
    return 1.0 / (1.0 + ((frequency_hz - MOUNT_HZ[axis]) / width_hz) ** 2)


def with_resonance(recording):
    """The recording with the peak in its rates."""
    table = dict(recording.to_dict())
    for axis, earth_dph in zip("xyz", recording.earth_rate_dph):
        peak = TRUE_PEAK_DPH * lorentz(table[f"f{axis}_hz"], axis, TRUE_WIDTH_HZ)
        table[f"rate_{axis}_dph"] = table[f"rate_{axis}_dph"] + earth_dph + peak
    return hrg.from_table(table, recording.meta)


train = with_resonance(hrg.simulate("cycle", unit=61, seed=121)[0])
verify = with_resonance(hrg.simulate("verify", unit=61, seed=122)[0])

# %% [markdown]
# ## What the library makes of it

# %%
library = hrg.trace(train, verify)
print(library.verdict)

# %% [markdown]
# ## The same with the effect
# A function from the states of the unit to a column. Its width is a parameter: three values are tried, and each is paid for. Beside it stands a
# second idea, the phase of a clock that has nothing to do with the gyro. It should be refused.

# %%
mount = hrg.OwnEffect(
    "mount-resonance",
    lambda s, width_hz: lorentz(s.frequency_hz, s.axis, width_hz),
    parameter=("width_hz", [0.5, 1.5, 4.5]),
)
clock = hrg.OwnEffect("clock-phase", lambda s: np.mod(s.time_s / 731.0, 1.0))
report = hrg.trace(train, verify, own_effects=[mount, clock])
print(report.verdict)
report

# %%
found = {e["name"]: e for e in report.effects}
assert list(found) == ["mount-resonance"], found
gains = {axis: g["gain"] for axis, g in found["mount-resonance"]["axes"].items()}
print(f"width {found['mount-resonance']['parameters']['width_hz']:.1f} Hz (true {TRUE_WIDTH_HZ})")
print("peak [deg/h]: " + ", ".join(f"{a} {g:.3f}" for a, g in gains.items()) + f" (true {TRUE_PEAK_DPH})")

# %% [markdown]
# ## Before and after
# On the verify run, which was only looked at to judge. The effect is in no image: a unit cannot compensate it until it is written in Rust
# (`docs/own-effects.md`).

# %%
figure, panels = plt.subplots(2, 1, figsize=(9, 7), layout="constrained")
names = ["baseline", "library alone", "with the own effect"]
for a, axis in enumerate("xyz"):
    values = [
        library.baseline[axis]["verify_rms_dph"],
        library.final_[axis]["verify_rms_dph"],
        report.final_[axis]["verify_rms_dph"],
    ]
    print(f"{axis}: " + ", ".join(f"{n} {v:.3f}" for n, v in zip(names, values)) + f"; noise {report.noise_floor_dph[axis]:.3f} deg/h")
    panels[0].bar(np.arange(3) + 0.27 * (a - 1), values, width=0.25, label=axis)
panels[0].set_xticks(range(3), names)
panels[0].set_ylabel("verify run [deg/h]")
panels[0].legend()
near = np.linspace(-10, 10, 400)
panels[1].plot(near, TRUE_PEAK_DPH * lorentz(MOUNT_HZ["x"] + near, "x", TRUE_WIDTH_HZ), color="0.6", lw=5, label="put in")
width = found["mount-resonance"]["parameters"]["width_hz"]
panels[1].plot(near, gains["x"] * lorentz(MOUNT_HZ["x"] + near, "x", width), "tab:blue", label="found, x")
panels[1].set_xlabel("frequency off the mount's resonance [Hz]")
panels[1].set_ylabel("bias [deg/h]")
panels[1].legend()
figure.suptitle("A peak of frequency, simulated: standard deviation of 100 s means, and the peak itself")
figure.savefig("own_effect.png", dpi=110)
