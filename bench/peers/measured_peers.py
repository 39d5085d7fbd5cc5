"""What regressions leave of the measured recordings, over the splits of `cargo xtask measured` and over each third kept back in turn.

    python3 -m venv target/peers && target/peers/bin/pip install -r bench/peers/requirements.txt
    cargo build --release -p hrg
    target/peers/bin/python bench/peers/measured_peers.py --page docs/measured.md

A cubic of temperature, the same with its ramp, ridge with lags (`GroupRidge` of `trace_peers.py`), a Gaussian process and boosting: each learns from the rows
before the split (or from two thirds) and is judged on the rest, axis by axis, as a standard deviation and a root mean square of 100 s means. The constant is that of the rows
that were learnt from. Lags run on through the log. `hrg trace` is its written image; of the thirds it learns from two runs that each begin in an
unknown state.
"""
import argparse
import subprocess
import sys
import tempfile
import warnings
from pathlib import Path

import numpy as np
from trace_peers import AXES, HRG, MEAN_S, MEASURED, Flat, GroupRidge, features, imported, means, part, peers, read, spread

SPLITS = {
    "imu_raw_data": range(6200, 6801, 100),
    "voltmeter-1v": range(60000, 76001, 4000),
    "gpsdo.short": range(90000, 130001, 10000),
}
OF = {"imu_raw_data": "xyz", "voltmeter-1v": "xy", "gpsdo.short": "x"}
NAMES = ["trace", "cubic", "cubic and ramp", "ridge with lags", "Gaussian process", "boosting"]


class Polynomial:
    """Powers of temperature up to the third, and perhaps the ramp with its square and product."""

    def __init__(self, ramp):
        self.ramp = ramp

    def columns(self, kinds):
        z, r = (kinds["temperature"][0] - self.centre) / self.half, kinds["slope"][0]
        own = [np.ones_like(z), z, z**2, z**3]
        return np.array(own + [r, r**2, z * r] if self.ramp else own).T

    def fit(self, kinds, y):
        t = kinds["temperature"][0]
        self.centre, self.half = 0.5 * (t.max() + t.min()), max(0.5 * (t.max() - t.min()), 1e-9)
        self.w = np.linalg.lstsq(self.columns(kinds), y, rcond=None)[0]
        return self

    def predict(self, kinds):
        return self.columns(kinds) @ self.w


def models():
    known = peers()
    return {
        "cubic": lambda: Polynomial(False),
        "cubic and ramp": lambda: Polynomial(True),
        "ridge with lags": GroupRidge,
        "Gaussian process": known["Gaussian process"],
        "boosting": known["boosting"],
    }


def on_seconds(run):
    """The columns on a grid of a second, by straight lines."""
    time = run["time_s"]
    grid = np.arange(np.ceil(time[0]), time[-1])
    out = {n: np.interp(grid, time[np.isfinite(v)], v[np.isfinite(v)]) for n, v in run.items() if np.isfinite(v).any()}
    return {**out, "time_s": grid}


def figures(residual):
    good = residual[np.isfinite(residual)]
    return spread(good), float(np.sqrt(np.mean(good**2)))


def trace(folder, train, verify, split):
    """Means of the rates that the image of `hrg trace` leaves on the verify recording; without an image the raw rates less the mean."""
    report, image, corrected = (folder / n for n in ("r.json", "i.toml", "c.csv"))
    image.unlink(missing_ok=True)
    given = ["--split", str(split)] if split else ["--verify", verify]
    subprocess.run([HRG, "trace", *train, *given, "--out", report, "--calibration", image], capture_output=True, check=True)
    if not image.exists():
        return None
    subprocess.run([HRG, "correct", verify, "--calibration", image, "--out", corrected], capture_output=True, check=True)
    return on_seconds(read(corrected)[0])


def judged(run, on, masks, corrected):
    """By axis and name: standard deviation and root mean square on the rows kept back. `masks`: rows of means that are learnt from, and judged."""
    learn, keep = masks
    out = {}
    for a in (k for k in range(3) if f"rate_{AXES[k]}_dph" in run):
        x, y = features(run, on, a), means(run[f"rate_{AXES[a]}_dph"])
        good = learn & np.isfinite(y)
        row = {"raw": figures((y - y[good].mean())[keep])}
        left = corrected and means(corrected[f"rate_{AXES[a]}_dph"])
        if corrected is None:
            row["trace"] = row["raw"]
        else:
            n = int(keep.sum())
            row["trace"] = figures(left[keep[: len(left)]] if len(left) >= len(keep) - 1 else left[:n])
        for name, make in models().items():
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                model = make().fit({k: v[:, good] for k, v in x.items()}, y[good])
                row[name] = figures((y - model.predict(x))[keep])
        out[AXES[a]] = row
    return out


def band(values):
    digits = 0 if np.median(values) >= 50 else 2

    def short(v):
        return f"{v:.{digits}f}" if v < 1e5 else f"{v:.0e}"

    return f"{short(np.median(values))} [{short(min(values))}, {short(max(values))}]"


def table(title, draws, axes):
    lines = [title, "   " + f"{'':<18}" + "".join(f"{a + ' ' + f:>22}" for a in axes for f in ("sd", "rms"))]
    for name in ["raw", *NAMES]:
        cells = [band([d[a][name][k] for d in draws]) for a in axes for k in (0, 1)]
        lines.append(f"   {name:<18}" + "".join(f"{c:>22}" for c in cells))
    return "\n".join(lines)


def main():
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--page", type=Path, help="write the tables into this page")
    options = options.parse_args()
    if not HRG.exists():
        sys.exit("first: cargo build --release -p hrg")
    out = []
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        for name, splits in SPLITS.items():
            source = imported(name, folder)
            raw, on = read(source)
            run = on_seconds(raw)
            blocks = len(run["time_s"]) // MEAN_S
            middle = run["time_s"][0] + (np.arange(blocks) + 0.5) * MEAN_S
            draws = []
            for split in splits:
                learn = middle < split
                corrected = trace(folder, [source], source, split)
                draws.append(judged(run, on, (learn, ~learn), corrected))
            unit = "deg/h" if name.startswith("imu") else "ppb"
            out.append(table(f"{name} [{unit}]: over the splits {splits[0]} to {splits[-1]} s", draws, OF[name]))
            rows = len(raw["time_s"])
            ends = [k * rows // 3 for k in range(4)]
            thirds = [folder / f"{name}-{k}.csv" for k in range(3)]
            for k, third in enumerate(thirds):
                part(source, third, ends[k], ends[k + 1])
            draws = []
            for k in range(3):
                first, last = raw["time_s"][ends[k]], raw["time_s"][ends[k + 1] - 1]
                keep = (middle > first) & (middle < last)
                corrected = trace(folder, [t for n, t in enumerate(thirds) if n != k], thirds[k], None)
                draws.append(judged(run, on, (~keep, keep), corrected))
            out.append(table(f"{name} [{unit}]: each third kept back in turn", draws, OF[name]))
    text = "\n\n".join(out)
    print(text)
    if options.page:
        page = options.page.read_text()
        begin, end = "<!-- peers: begin -->\n", "<!-- peers: end -->"
        before, after = page.split(begin)[0], page.split(end)[1]
        options.page.write_text(f"{before}{begin}```\n{text}\n```\n{end}{after}")


if __name__ == "__main__":
    main()
