# %% [markdown]
# # A day in the chamber
# The loop on a measured recording: a MEMS IMU with its own thermometer, -17 to 74 C, heating and cooling
# (its source and licence are in `host-tests/recordings/measured/SOURCES.md`). It learns from the rows up to 6500, and is judged on the last
# cooling, which nothing has seen.

# %%
import pathlib
import sys

import matplotlib

if "ipykernel" not in sys.modules:
    matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

import hrg

here = pathlib.Path(globals().get("__file__", "chamber_day.py")).resolve().parent
clone = next(p for p in [here, *here.parents] if (p / "host-tests").is_dir())
measured = clone / "host-tests" / "recordings" / "measured"

# %%
run = hrg.import_table(measured / "imu_raw_data.csv.gz", str(measured / "imu_raw_data.toml"))
print(run)
train, verify = run.split(6500.0)

# %% [markdown]
# The baseline (temperature and its rate of change), and what the residual shows beside it.

# %%
report = hrg.trace(train, verify)
print(report.verdict)
report


# %%
def means(values, seconds=100):
    """Means of 100 s; shape (means, 3)."""
    values = values[: len(values) // seconds * seconds]
    return np.nanmean(values.reshape(-1, seconds, values.shape[1]), axis=1)


whole = hrg.correct(run, report.calibration or report.baseline_calibration)
judged = whole.time_s >= 6500.0
raw, corrected = means(whole.raw_dph[judged].astype(float)), means(whole.corrected_dph[judged].astype(float))
for axis, before, after in zip("xyz", raw.std(axis=0), corrected.std(axis=0)):
    print(f"{axis}: standard deviation of 100 s means {before:7.1f} -> {after:7.1f} deg/h (measured, last cooling)")

# %%
figure, panels = plt.subplots(3, 1, sharex=True, figsize=(9, 7), layout="constrained")
time = np.arange(len(raw)) * 100.0 + 6500.0
for a, (axis, panel) in enumerate(zip("xyz", panels)):
    panel.plot(time, raw[:, a] - raw[:, a].mean(), color="0.6", label="raw, less its mean")
    panel.plot(time, corrected[:, a], color="tab:blue", label="corrected")
    panel.set_ylabel(f"{axis} [deg/h]")
panels[0].legend(loc="upper right")
panels[-1].set_xlabel("time [s], one row a second")
figure.suptitle("A measured IMU on a cooling that it was not calibrated on: 100 s means")
figure.savefig("chamber_day.png", dpi=110)
