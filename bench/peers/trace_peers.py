"""The trace beside general regressions, on unseen runs: what each leaves, as a standard deviation of 100 s means.

    python3 -m venv target/peers && target/peers/bin/pip install -r bench/peers/requirements.txt
    cargo build --release -p hrg -p foreign-plant
    target/peers/bin/python bench/peers/trace_peers.py --units 40 --page docs/trace-peers.md

Files: the measured recordings (imu_raw_data split at 6500 s, gpsdo.short both halves both ways) and units of the second plant, which
shares no code with `hrg`. Each peer learns from the train run and is judged on the verify run, axis by axis, on 100 s means of the
temperature (from the frequency: linear, scaled to the run), its slope, four lags, the time since power-on and whatever else is recorded.
`hrg trace` is judged by its written image alone: what `hrg correct` leaves; the raw rates where none was written.
"""
import argparse
import json
import subprocess
import sys
import tempfile
import warnings
from pathlib import Path

import networks
import numpy as np
from scipy.optimize import minimize
from scipy.signal import lfilter

ROOT = Path(__file__).resolve().parents[2]
HRG = ROOT / "target/release/hrg"
PLANT = ROOT / "target/release/foreign-plant"
MEASURED = ROOT / "host-tests/recordings/measured"
AXES = "xyz"
MEAN_S = 100
LAGS_S = (200.0, 800.0, 3000.0, 10000.0)
SEED = 1


def read(path):
    """Columns of a recording in the order of time, and when its unit was switched on, s."""
    power_on, step = 0.0, 1.0
    with open(path) as lines:
        for line in lines:
            if not line.startswith("#"):
                names = line.strip().split(",")
                break
            if line.startswith("# power_on_s:"):
                power_on = float(line.split(":")[1])
            if line.startswith("# time_step_s:"):
                step = float(line.split(":")[1])
        table = np.genfromtxt(lines, delimiter=",")
    run = {n: table[:, k] for k, n in enumerate(names)}
    run.setdefault("time_s", step * np.arange(1, len(table) + 1))
    order = np.argsort(run["time_s"], kind="stable")
    return {n: v[order] for n, v in run.items()}, power_on


def means(v):
    n = len(v) // MEAN_S * MEAN_S
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        return np.nanmean(v[:n].reshape(-1, MEAN_S), axis=1)


def whole(v):
    good = np.isfinite(v)
    return np.interp(np.arange(len(v)), np.flatnonzero(good), v[good]) if good.any() else np.zeros(len(v))


def lag(v, tau_s):
    share = 1.0 - np.exp(-1.0 / tau_s)
    return lfilter([share], [1.0, share - 1.0], v, zi=[(1.0 - share) * v[0]])[0]


def temperature(run, a):
    """What tells the temperature of an axis: its own sensor, one for all, or its frequency in parts per million."""
    for name in (f"temp_{AXES[a]}_c", "temp_c"):
        if name in run:
            return whole(run[name])
    f = whole(run[f"f{AXES[a]}_hz"])
    return 1e6 * (f / 4800.0 - 1.0) / 95.0


def features(run, power_on_s, a):
    """Features by kind, 100 s means."""
    t = temperature(run, a)
    slope = 60.0 * np.gradient(lag(t, 30.0))
    since_h = (run["time_s"] - power_on_s) / 3600.0
    kinds = {"temperature": [t], "slope": [slope], "lags": [lag(t, tau) - t for tau in LAGS_S], "time": [since_h]}
    known = {"time_s", "fx_hz", "fy_hz", "fz_hz", "temp_c"} | {f"{k}_{x}_{u}" for x in AXES for k, u in (("rate", "dph"), ("temp", "c"))}
    others = [n for n in run if n not in known and (n.split("_")[1] not in AXES or n.split("_")[1] == AXES[a])]
    kinds["recorded"] = [whole(run[n]) for n in others]
    return {k: np.array([means(v) for v in vs]) for k, vs in kinds.items() if vs}


class GroupRidge:
    """Ridge of a dictionary whose groups have each a variance of highest evidence: powers, hinges, lags and decays."""

    def columns(self, kinds):
        z = (kinds["temperature"][0] - self.centre) / self.half
        knots = np.linspace(-1.0, 1.0, 10)
        slope = kinds["slope"][0]
        out = {
            "baseline": [z, z**2, slope, slope**2, z * slope],
            "curve": [np.maximum(z - k, 0.0) for k in knots],
            "lags": list(kinds["lags"]),
            "lags by temperature": [z * c for c in kinds["lags"]],
            "rate": [np.tanh(slope / r) for r in (0.2, 0.5, 1.0)] + [np.abs(slope)],
            "time": [np.exp(-kinds["time"][0] / h) for h in (0.1, 0.4, 1.5, 5.0)],
        }
        if "recorded" in kinds:
            out["recorded"] = list(kinds["recorded"]) + [c * z for c in kinds["recorded"]]
        return out

    def fit(self, kinds, y):
        t = kinds["temperature"][0]
        self.centre, self.half = 0.5 * (t.max() + t.min()), max(0.5 * (t.max() - t.min()), 1e-9)
        groups = self.columns(kinds)
        x = np.array([c for g in groups.values() for c in g]).T
        self.mean, self.scale = x.mean(0), x.std(0) + 1e-12
        z = (x - self.mean) / self.scale
        which = np.concatenate([[k] * len(g) for k, g in enumerate(groups.values())])
        self.offset = y.mean()
        y = y - self.offset

        def solve(logs):
            noise, prior = np.exp(logs[0]), np.exp(np.concatenate([[12.0], logs[1:]]))[which]
            m = z.T @ z / noise + np.diag(1.0 / prior)
            w = np.linalg.solve(m, z.T @ y / noise)
            fit = (y @ y - y @ (z @ w)) / noise
            return 0.5 * (fit + len(y) * logs[0] + np.log(prior).sum() + np.linalg.slogdet(m)[1]), w

        start = np.concatenate([[np.log(0.05 * y.var() + 1e-12)], np.full(len(groups) - 1, np.log(0.01 * y.var() + 1e-12))])
        best = minimize(lambda v: solve(v)[0], start, method="L-BFGS-B", bounds=[(v - 15.0, v + 8.0) for v in start])
        self.w = solve(best.x)[1]
        return self

    def predict(self, kinds):
        x = np.array([c for g in self.columns(kinds).values() for c in g]).T
        return (x - self.mean) / self.scale @ self.w + self.offset


class Flat:
    """A regression of scikit-learn's kind on all features side by side, each scaled to unit deviation."""

    def __init__(self, make):
        self.model = make()

    def fit(self, kinds, y):
        x = np.concatenate(list(kinds.values())).T
        self.mean, self.scale = x.mean(0), x.std(0) + 1e-12
        self.offset, self.size = y.mean(), y.std() + 1e-12
        self.model.fit((x - self.mean) / self.scale, (y - self.offset) / self.size)
        return self

    def predict(self, kinds):
        x = np.concatenate(list(kinds.values())).T
        return np.asarray(self.model.predict((x - self.mean) / self.scale)).ravel() * self.size + self.offset


class Sparse:
    """pysindy's sparse regression (STLSQ) on its polynomials up to the third degree."""

    def fit(self, x, y):
        import pysindy

        self.library = pysindy.PolynomialLibrary(degree=2)
        columns = np.asarray(self.library.fit_transform(x))
        self.optimizer = pysindy.STLSQ(threshold=0.05, alpha=1.0)
        self.optimizer.fit(columns, y.reshape(-1, 1))
        return self

    def predict(self, x):
        return np.asarray(self.library.transform(x)) @ self.optimizer.coef_.T


def peers():
    from sklearn.ensemble import HistGradientBoostingRegressor
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

    def process():
        return GaussianProcessRegressor(ConstantKernel(1.0) * RBF(3.0) + WhiteKernel(0.1), n_restarts_optimizer=0, random_state=SEED)

    def symbols():
        from pyoperon.sklearn import SymbolicRegressor

        return SymbolicRegressor(max_evaluations=50_000, max_length=40, population_size=500, n_threads=1, random_state=SEED, max_time=5)

    return {
        "Gaussian process": lambda: Flat(process),
        "boosting": lambda: Flat(lambda: HistGradientBoostingRegressor(max_iter=200, early_stopping=False, random_state=SEED)),
        "pysindy": lambda: Flat(Sparse),
        "pyoperon": lambda: Flat(symbols),
        "group ridge": GroupRidge,
    }


def learners():
    """Networks, which take a minute for each axis."""
    return {name: lambda make=make: Flat(make) for name, make in networks.peers(SEED).items()}


def spread(residual):
    good = residual[np.isfinite(residual)]
    return good.std(ddof=1) if len(good) > 2 else np.nan


def ours(folder, train, verify, split):
    """What the image of `hrg trace` leaves, by axis."""
    report, image, corrected = folder / "report.json", folder / "image.toml", folder / "corrected.csv"
    image.unlink(missing_ok=True)
    given = ["--split", str(split)] if split else ["--verify", str(verify)]
    subprocess.run([HRG, "trace", "--train", train, *given, "--out", report, "--calibration", image], capture_output=True, check=True)
    if not image.exists():
        return read(verify)[0]
    subprocess.run([HRG, "correct", verify, "--calibration", image, "--out", corrected], capture_output=True, check=True)
    return read(corrected)[0]


def judge(name, train, verify, split=None, with_networks=True):
    """A row: what the raw rates, the trace and each peer leave, by axis. With `split`, train and verify are one file."""
    (run, on), (other, later) = read(train), read(verify)
    with tempfile.TemporaryDirectory() as folder:
        corrected = ours(Path(folder), train, verify, split)
    rows = []
    for a in range(3):
        rate = f"rate_{AXES[a]}_dph"
        if rate not in run:
            continue
        x, y = features(run, on, a), means(run[rate])
        v, target = features(other, later, a), means(other[rate])
        first = 0
        if split:
            first = int(split) // MEAN_S
            x, y = {k: c[:, :first] for k, c in x.items()}, y[:first]
        good = np.isfinite(y)
        row = {"name": f"{name} {AXES[a]}", "raw": spread(target[first:]), "hrg trace": spread(means(corrected[rate])[first:])}
        shared = {k: min(len(x[k]), len(v[k])) for k in x if k in v}
        chosen = {**peers(), **learners()} if with_networks else {**peers(), **dict.fromkeys(learners())}
        for peer, make in chosen.items():
            if make is None:
                row[peer] = np.nan
                continue
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                model = make().fit({k: x[k][:n][:, good] for k, n in shared.items()}, y[good])
                row[peer] = spread((target - model.predict({k: v[k][:n] for k, n in shared.items()}))[first:])
        rows.append(row)
    return rows


def imported(name, folder):
    """A measured recording, by the map beside it."""
    out = folder / f"{name}.csv"
    subprocess.run([HRG, "import", MEASURED / f"{name}.csv.gz", "--map", MEASURED / f"{name}.toml", "--out", out], capture_output=True, check=True)
    return out


def part(source, into, begin, end):
    """Rows of a recording, as one of its own."""
    lines = source.read_text().splitlines()
    first = next(k for k, line in enumerate(lines) if not line.startswith("#"))
    into.write_text("\n".join(lines[: first + 1] + lines[first + 1 + begin : first + 1 + end]) + "\n")


def measured(folder):
    imu = imported("imu_raw_data", folder)
    yield judge("imu_raw_data", imu, imu, 6500)
    gpsdo = imported("gpsdo.short", folder)
    rows = sum(1 for line in gpsdo.open() if not line.startswith("#")) - 1
    halves = [folder / "gpsdo-1.csv", folder / "gpsdo-2.csv"]
    for k, half in enumerate(halves):
        part(gpsdo, half, k * rows // 2, (k + 1) * rows // 2)
    yield judge("gpsdo.short 1 to 2", halves[0], halves[1])
    yield judge("gpsdo.short 2 to 1", halves[1], halves[0])


def foreign(folder, count, networks_on):
    subprocess.run([PLANT, "all", "--seeds", "1", "--out", folder], capture_output=True, check=True)
    truths = [json.loads(p.read_text()) for p in sorted(folder.glob("*-truth.json"))]
    usable = [f"{t['case']}-{t['seed']}" for t in truths if t["compensable"] and "none" not in t["classes"]]
    usable = [base for base in usable if len(list(folder.glob(f"{base}-train*.csv"))) == 1]
    for k in range(min(count, len(usable))):
        base = usable[k * len(usable) // count]
        print(base, file=sys.stderr)
        taught = k * networks_on // count < (k + 1) * networks_on // count
        yield judge(base, *folder.glob(f"{base}-train*.csv"), folder / f"{base}-verify.csv", with_networks=taught)


def page(rows, files):
    names = [n for n in rows[0] if n not in ("name", "raw")]
    out = ["| axis of a file | raw | " + " | ".join(names) + " |", "|---|---|" + "---|" * len(names)]
    for r in rows:
        best = min(r[n] for n in names if np.isfinite(r[n]))
        cell = [f"**{r[n]:.3g}**" if r[n] <= 1.05 * best else f"{r[n]:.3g}" if np.isfinite(r[n]) else "" for n in names]
        out.append(f"| {r['name']} | {r['raw']:.3g} | " + " | ".join(cell) + " |")
    ratio = {n: [r[n] / r["hrg trace"] for r in rows if np.isfinite(r[n])] for n in names[1:]}
    first = sum(r["hrg trace"] <= 1.05 * min(r[n] for n in names if np.isfinite(r[n])) for r in rows)
    out += ["", f"Best or within 5 % of the best: {first} of {len(rows)} axes of {files} files. Theirs over ours, median: "
            + ", ".join(f"{n} {np.median(v):.2f}" for n, v in ratio.items()) + " (each over the axes that it was given)."]
    best_peer = [min(r[n] for n in names[1:] if np.isfinite(r[n])) / r["hrg trace"] for r in rows]
    out.append(f"The best of the peers on each axis, chosen afterwards, over ours, median: {np.median(best_peer):.2f}.")
    return "\n".join(out)


def main():
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--units", type=int, default=40, help="units of the second plant")
    options.add_argument("--networks", type=int, default=10, help="so many of them are given to the networks, too (a minute for each axis)")
    options.add_argument("--page", type=Path, help="write the table into this page")
    options = options.parse_args()
    if not HRG.exists() or not PLANT.exists():
        sys.exit("first: cargo build --release -p hrg -p foreign-plant")
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        files = list(measured(folder)) + list(foreign(folder / "foreign", options.units, options.networks))
    text = page([row for rows in files for row in rows], len(files))
    print(text)
    if options.page:
        title = "# The trace beside general regressions\n\n"
        said = "Standard deviation of 100 s means that each leaves on the verify run [deg/h; gpsdo.short: ppb]; bold: best, or within 5 % of\nit. Printed by `bench/peers/trace_peers.py`, which says what each is given. The units with names like `memory-rod-1` are\nsimulated by `host-tests/foreign-plant`; the others are measured.\n\n"
        options.page.write_text(title + said + text + "\n")


if __name__ == "__main__":
    main()
