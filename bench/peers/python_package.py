"""The package hrg beside pandas, allantools and the command hrg, in one run.

    cargo xtask build
    target/python/bin/pip install allantools
    target/python/bin/python bench/peers/python_package.py [hours]

Prints the ratio of the times; best of five, in turn.
"""

import pathlib
import subprocess
import sys
import tempfile
import time

import allantools
import numpy as np
import pandas

import hrg

hours = float(sys.argv[1]) if len(sys.argv) > 1 else 10.0
rows = int(hours * 3600 * 100)
rng = np.random.default_rng(1)
columns = {"time_s": np.arange(rows) * 0.01}
for k, axis in enumerate("xyz"):
    columns[f"f{axis}_hz"] = 4900 - 10 * k + np.cumsum(rng.normal(size=rows)) * 1e-5
    columns[f"rate_{axis}_dph"] = rng.normal(size=rows) * 30


def best(jobs, turns=5):
    """The shortest time of each job."""
    times = {name: [] for name in jobs}
    for _ in range(turns):
        for name, job in jobs.items():
            begun = time.perf_counter()
            job()
            times[name].append(time.perf_counter() - begun)
    return {name: min(t) for name, t in times.items()}


def report(what, times, ours, theirs):
    ratio = times[theirs] / times[ours]
    print(f"{what}: {ours} {times[ours]:.2f} s, {theirs} {times[theirs]:.2f} s: {ratio:.1f} times as fast")


with tempfile.TemporaryDirectory() as folder:
    path = pathlib.Path(folder) / "run.csv"
    hrg.from_table(columns, {"unit": "PEERS"}).write(path)
    print(f"{hours:g} h at 100 Hz: {rows} rows, {path.stat().st_size / 1e6:.0f} MB")
    read = best({"hrg": lambda: hrg.read(path).to_dict(), "pandas": lambda: pandas.read_csv(path, comment="#").to_numpy()})
    report("all columns into numpy (hrg cleans as well)", read, "hrg", "pandas")
rates = columns["rate_x_dph"]
found = hrg.allan(rates, 0.01)["x"]
theirs = allantools.oadev(rates, rate=100.0, data_type="freq", taus=found["tau_s"])
worst = np.max(np.abs(theirs[1] / np.interp(theirs[0], found["tau_s"], found["deviation_dph"]) - 1))
print(f"Allan deviation, {len(found['tau_s'])} times: largest difference {worst:.1e}")
allan = best(
    {
        "hrg": lambda: hrg.allan(rates, 0.01),
        "allantools": lambda: allantools.oadev(rates, rate=100.0, data_type="freq", taus=found["tau_s"]),
    }
)
report("Allan deviation", allan, "hrg", "allantools")

# The same work by the command and from here: what is read, computed and written is the same.
command = pathlib.Path(__file__).resolve().parents[2] / "target/release/hrg"
with tempfile.TemporaryDirectory() as folder:
    folder = pathlib.Path(folder)
    for name, profile, seed in [("train", "dong", 1), ("verify", "cycle", 2)]:
        hrg.simulate(profile, effects=["hysteresis"], unit=7, seed=seed)[0].write(folder / f"{name}.csv")
    train, verify, image = (str(folder / name) for name in ("train.csv", "verify.csv", "image.toml"))

    def by_command(*words):
        subprocess.run([command, *words], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    for what, ours, words in [
        ("fit", lambda: hrg.fit(hrg.read(train)).write(image), ["fit", train, "--out", image]),
        ("trace", lambda: hrg.trace(hrg.read(train), hrg.read(verify)), ["trace", "--train", train, "--verify", verify, "--out", str(folder / "report.json")]),
    ]:
        times = best({"the package": ours, "the command": lambda: by_command(*words)})
        report(what, times, "the package", "the command")
