"""Our desktop work beside the libraries that one would use in Python, in one run: prints ratios of times (theirs / ours).

    python3 -m venv target/peers && target/peers/bin/pip install -r bench/peers/requirements.txt
    cargo build --release -p hrg-study
    target/peers/bin/python bench/peers/peers.py

Each job is the same on both sides, in memory, start-up not counted; each is timed alone, on one core, the best of some runs.
Results are compared, too: a ratio of times of different answers would be worth nothing.
"""
import json
import os
import subprocess
import sys
import time
from pathlib import Path

os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
OURS = ROOT / "target/release/hrg-study"
DATA = ROOT / "target/bench/10h-1hz.csv"


def ours(job, *arguments):
    out = subprocess.run(["taskset", "-c", "0", OURS, "bench-desktop", "--child", job, DATA, *map(str, arguments)], capture_output=True, text=True, check=True)
    return json.loads(out.stdout)


def best(work, runs=5):
    times = []
    for _ in range(runs):
        start = time.perf_counter()
        result = work()
        times.append(time.perf_counter() - start)
    return min(times), result


def report(name, theirs, mine, difference):
    print(f"{name:<58} {theirs * 1e3:10.2f} ms {mine * 1e3:10.3f} ms {theirs / mine:8.1f} x   {difference}")


def main():
    if not OURS.exists() or not DATA.exists():
        sys.exit("first: cargo xtask bench (it builds hrg-study and makes the data)")
    os.sched_setaffinity(0, {0})
    print(f"{'job':<58} {'theirs':>13} {'ours':>13} {'ratio':>10}   difference of the results")

    # Reading.
    mine = ours("peer-read")
    theirs, table = best(lambda: np.genfromtxt(DATA, delimiter=",", names=True, skip_header=skip()), 2)
    report("read 10 h at 1 Hz: numpy.genfromtxt", theirs, mine["seconds"], f"{len(table)} and {mine['rows']} rows")
    theirs, plain = best(lambda: np.loadtxt(DATA, delimiter=",", comments="#", skiprows=skip() + 1, usecols=range(7)), 3)
    report("the same: numpy.loadtxt (no missing values)", theirs, mine["seconds"], f"{len(plain)} rows")

    # Least squares: six regressors of eq 7, three axes.
    mine = ours("peer-lsq")
    x = np.fromfile(ROOT / "target/bench/columns.f64").reshape(6, -1).T
    y = np.fromfile(ROOT / "target/bench/rates.f64")
    import scipy.linalg

    theirs, w = best(lambda: np.linalg.lstsq(x, y, rcond=None)[0])
    report("least squares, 36000 x 6: numpy.linalg.lstsq", theirs, mine["seconds"], f"{np.abs(w - mine['coefficients']).max():.1e} deg/h")
    theirs, w = best(lambda: scipy.linalg.lstsq(x, y, lapack_driver="gelsy")[0])
    report("the same: scipy.linalg.lstsq (gelsy)", theirs, mine["seconds"], f"{np.abs(w - mine['coefficients']).max():.1e} deg/h")

    # Swarm. (pyswarms writes a report.log where it is imported.)
    os.chdir(DATA.parent)
    import pyswarms

    mine = ours("peer-pso")
    lstsq = np.linalg.lstsq(x, y, rcond=None)[0]
    scale = np.abs(lstsq).max() * 2

    def cost(swarm):
        return np.array([((x @ p - y) ** 2).sum() for p in swarm])

    def swarm():
        np.random.seed(1)
        optimiser = pyswarms.single.GlobalBestPSO(mine["particles"], 6, {"c1": 1.5, "c2": 1.5, "w": 0.7}, bounds=(-scale * np.ones(6), scale * np.ones(6)))
        return optimiser.optimize(cost, mine["iterations"], verbose=False)[0]

    theirs, found = best(swarm, 1)
    floor = ((x @ lstsq - y) ** 2).sum()
    report(f"swarm, {mine['particles']} x {mine['iterations']}: pyswarms", theirs, mine["seconds"], f"above least squares: {found / floor - 1:.1e} and {mine['above']:.1e}")

    # Allan deviation.
    import allantools

    mine = ours("peer-allan")
    rate = np.loadtxt(DATA, delimiter=",", comments="#", skiprows=skip() + 1, usecols=4)
    theirs, (taus, deviation, _, _) = best(lambda: allantools.oadev(rate, rate=1.0, data_type="freq", taus="octave"))
    common = [(d, mine["deviation"][mine["tau"].index(t)]) for t, d in zip(taus, deviation) if t in mine["tau"]]
    off = max(abs(a - b) / a for a, b in common)
    report("Allan deviation, octaves: allantools.oadev", theirs, mine["seconds"], f"{off:.1e}, {len(common)} times")

    # One step of an unscented filter on chen2015's ten states.
    from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

    mine = ours("peer-ukf")
    n = mine["states"]
    points = MerweScaledSigmaPoints(n, 1.0, 2.0, 3.0 - n)
    ukf = UnscentedKalmanFilter(n, 2, 1.0, hx=lambda s: s[:2], fx=lambda s, dt: step(s, dt), points=points)
    ukf.P *= 1e-4
    ukf.R *= 1e-6
    ukf.Q *= 1e-12

    def update():
        ukf.predict()
        ukf.update(np.array([1e-3, -1e-3]))

    theirs, _ = best(update, 200)
    report(f"one step of an unscented filter, {n} states: filterpy", theirs, mine["seconds"], "same model, other spread of the points")


def step(s, dt):
    """chen2015: velocities, tilts, azimuth, drifts; a platform at rest."""
    g, omega_n, omega_u = 9.8, 5.2e-5, 5.2e-5
    out = s.copy()
    out[0] += dt * (-g * s[3])
    out[1] += dt * (g * s[2])
    out[2] += dt * (omega_u * s[3] - omega_n * np.sin(s[4]) + s[5])
    out[3] += dt * (-omega_u * s[2] + omega_n * np.cos(s[4]) + s[6])
    return out


def skip():
    with open(DATA) as f:
        return next(k for k, line in enumerate(f) if not line.startswith("#"))


main()
