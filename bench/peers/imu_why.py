"""Why a model learnt from the first rows of imu_raw_data does not hold on its last cooling: loops at equal temperatures, and what
plain ridge regressions leave there, beside what their held-out errors within the train rows promise.

    python3 -m venv target/peers && target/peers/bin/pip install -r bench/peers/requirements.txt
    target/peers/bin/python bench/peers/imu_why.py --page docs/measured.md

Shares no code with `hrg`. Rows are split as `cargo xtask measured` splits them.
"""
import argparse
import gzip
from pathlib import Path

import numpy as np
from sklearn.linear_model import Ridge
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

ROOT = Path(__file__).resolve().parents[2]
FILE = ROOT / "host-tests/recordings/measured/imu_raw_data.csv.gz"
DROPPED, TRAIN, MEAN, PARTS = 5, 6500, 100, 6
AXES = "xyz"
LAGS = (60, 150, 300, 600, 1200, 2400, 4800, 7000)
WIDTHS = (3, 6, 12, 20, 30, 45, 60)
SHRINKAGES = (1e-6, 1e-3, 1e-2, 1e-1, 1.0, 10.0)


def load():
    with gzip.open(FILE, "rt") as lines:
        names = lines.readline().split()
        rows = np.array([[float(c) for c in line.split("\t")] for line in lines])[DROPPED:]
    of = lambda name: rows[:, names.index(name)]
    to_dph = np.degrees(1.0) * 3600.0
    return of("imu.temperature"), {a: of(f"imu.gyro.{a}") * to_dph for a in AXES}


def slope(t, window=60):
    """Least-squares slope over the last rows, C per minute where a row is a second."""
    k = np.arange(window) - (window - 1) / 2
    return 60 * np.convolve(np.pad(t, (window - 1, 0), mode="edge"), (k / np.sum(k * k))[::-1], "valid")


def lag(t, tau):
    out, at, share = np.empty_like(t), t[0], 1 - np.exp(-1 / tau)
    for k, value in enumerate(t):
        at += share * (value - at)
        out[k] = at
    return out


def play(t, width):
    out, at = np.empty_like(t), t[0]
    for k, value in enumerate(t):
        at = min(max(at, value - width / 2), value + width / 2)
        out[k] = at
    return out


def means(v):
    n = len(v) // MEAN
    return v[: n * MEAN].reshape(n, MEAN, -1).mean(1).squeeze()


def models(t):
    u, r = (t - 25) / 45, slope(t)
    eq7 = [u, u**2, r, r**2, u * r]
    lags = [(lag(t, tau) - t) / 10 for tau in LAGS]
    plays = [(play(t, w) - t) / 10 for w in WIDTHS]
    hinges = [u] + [np.maximum(t - knot, 0) / 10 for knot in range(-10, 75, 10)]
    cubic = [u, u**2, u**3]
    return {
        "T, dT/dt, T dT/dt": [u, r, u * r],
        "eq 7": eq7,
        "eq 7, T^3": eq7 + [u**3],
        "eq 7, lags": eq7 + lags,
        "eq 7, plays": eq7 + plays,
        "eq 7, T^3, plays": eq7 + [u**3] + plays,
        "eq 7, lags, plays": eq7 + lags + plays,
        "T, T^2, lags": cubic[:2] + lags,
        "cubic, lags": cubic + lags,
        "cubic, lags, T times lags": cubic + lags + [u * x for x in lags],
        "hinges, lags": hinges + lags,
        "hinges, lags, plays": hinges + lags + plays,
    }


def loops(t, rates):
    """Mean rates at equal temperatures."""
    row = np.arange(len(t))
    parts = {"first cooling": row < 600, "heating": (row > 2800) & (row < 6300), "last cooling": row >= TRAIN}
    s = "   at     rate less that of the heating [deg/h]:   first cooling            last cooling (kept back)\n"
    s += f"   [C]{'x':>34}{'y':>8}{'z':>8}{'x':>12}{'y':>8}{'z':>8}\n"
    for at in (36, 40, 45, 50, 55, 60, 65, 70):
        mean = lambda part, a: rates[a][parts[part] & (np.abs(t - at) < 1)]
        line = f"   {at:<4}" + " " * 23
        for part in ("first cooling", "last cooling"):
            for a in AXES:
                here = mean(part, a)
                text = f"{here.mean() - mean('heating', a).mean():+.0f}" if len(here) else "-"
                line += f"{text:>{12 if a == 'x' else 8}}"
        s += line.rstrip() + "\n"
    return s


def floor(t, rates):
    """What a cubic of temperature leaves of the kept-back rows where it is fitted to them themselves."""
    here = means(t[TRAIN:])
    left = []
    for a in AXES:
        y = means(rates[a][TRAIN:])
        left.append(np.std(y - np.polyval(np.polyfit(here, y, 3), here), ddof=4))
    return left


def regressions(t, rates):
    s = f"   {'ridge on':<28}" + "".join(f"{a + ' held out':>12}{'sd':>6}{'rms':>6}" for a in AXES) + "\n"
    blocks = TRAIN // MEAN
    part = np.arange(blocks) * PARTS // blocks
    promised, reached = {a: [] for a in AXES}, {a: [] for a in AXES}
    for name, columns in models(t).items():
        x = np.array(columns).T
        seen, unseen = means(x[:TRAIN]), x[TRAIN:]
        line = f"   {name:<28}"
        for a in AXES:
            y = means(rates[a][:TRAIN])
            best = (np.inf, None)
            for shrinkage in SHRINKAGES:
                of = lambda: make_pipeline(StandardScaler(), Ridge(shrinkage))
                e = [y[part == k] - of().fit(seen[part != k], y[part != k]).predict(seen[part == k]) for k in range(PARTS)]
                best = min(best, (np.sqrt(np.mean(np.concatenate(e) ** 2)), shrinkage))
            model = make_pipeline(StandardScaler(), Ridge(best[1])).fit(seen, y)
            left = means(rates[a][TRAIN:] - model.predict(unseen))
            sd, rms = left.std(ddof=1), np.sqrt(np.mean(left**2))
            promised[a].append(best[0])
            reached[a].append((sd, rms, name))
            line += f"{best[0]:>12.0f}{sd:>6.0f}{rms:>6.0f}"
        s += line + "\n"
    for what, pick in (
        ("chosen by the held-out error", lambda a: reached[a][int(np.argmin(promised[a]))]),
        ("chosen with hindsight", lambda a: min(reached[a])),
    ):
        s += f"   {what}: " + "; ".join(f"{a} {pick(a)[0]:.0f} / {pick(a)[1]:.0f} ({pick(a)[2]})" for a in AXES) + "\n"
    return s


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--page", type=Path, help="page into which the text is written, between its marks")
    page = arguments.parse_args().page
    t, rates = load()
    low = floor(t, rates)
    text = (
        "Loops at equal temperatures (mean of the rows within 1 C)\n"
        + loops(t, rates)
        + f"\nA cubic of temperature fitted to the kept-back rows themselves leaves x {low[0]:.0f}, y {low[1]:.0f}, z {low[2]:.0f} deg/h.\n"
        + f"\nRidge on means of {MEAN} rows; held out: root mean square over {PARTS} contiguous parts of the train rows, for the best shrinkage;\n"
        + "sd and rms: of the kept-back rows [deg/h]\n"
        + regressions(t, rates)
    )
    print(text, end="")
    if page:
        begin, end = "<!-- imu-why: begin -->", "<!-- imu-why: end -->"
        before, rest = page.read_text().split(begin)
        after = rest.split(end)[1]
        page.write_text(f"{before}{begin}\n```\n{text}```\n{end}{after}")


if __name__ == "__main__":
    main()
