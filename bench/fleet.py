"""A fleet of units on one core and on two, by `hrg fleet` and by `hrg.fleet` on Dask; what a unit costs part by part; and the plan for 10 000 units.

    cargo xtask build
    cargo xtask test            (makes target/python with the package and Dask)
    target/python/bin/python bench/fleet.py --page docs/family.md

Each run begins with nothing kept, on as many cores as it may use (taskset), and is alone on the machine if you leave it alone. The units are those of the
second plant. Table and page of 10 000 units are written from rows that were measured, repeated under other names.
"""
import argparse
import json
import os
import shutil
import statistics
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PROGRAMS = ROOT / "target/release"
AT = ROOT / "target/bench/fleet"
# Largest error, deg/h, and the range of temperatures, C.
LIMIT = (2.0, -40.0, 55.0)
MANY = 10_000

DASK = """
import sys, hrg.fleet
if __name__ == "__main__":
    hrg.fleet.run(sys.argv[1], sys.argv[2], workers=int(sys.argv[3]), limit=tuple(map(float, sys.argv[4:])))
"""


def units(count):
    folder = AT / f"units-{count}"
    if not folder.exists():
        make = [PROGRAMS / "foreign-plant", "make", "--case", "memory-rod", "--design", "1", "--spread", "0.3", "--seed", "1", "--units", str(count), "--out", folder]
        subprocess.run(make, check=True, stdout=subprocess.DEVNULL)
    return folder


def on_cores(count, command):
    """Seconds and largest memory of one of its processes, MB."""
    begin = time.perf_counter()
    child = subprocess.Popen(["taskset", "-c", ",".join(str(k) for k in range(count)), *map(str, command)], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    text = child.stderr.read().decode()
    _, status, used = os.wait4(child.pid, 0)
    if status != 0:
        sys.exit(f"{command}: {text}")
    return time.perf_counter() - begin, used.ru_maxrss / 1024


def fresh(name):
    out = AT / name
    shutil.rmtree(out, ignore_errors=True)
    return out


def rust(folder, cores):
    out = fresh("out-rust")
    return on_cores(cores, [PROGRAMS / "hrg", "fleet", folder, "--out", out, "--limit", LIMIT[0], "--from", LIMIT[1], "--to", LIMIT[2]])


def dask(folder, cores):
    script = AT / "cluster.py"
    script.write_text(DASK)
    return on_cores(cores, [sys.executable, script, folder, fresh("out-dask"), cores, *LIMIT])


def parts(folder):
    """Medians over the units of what one costs, s."""
    import hrg

    found = {}

    def timed(name, work):
        begin = time.perf_counter()
        result = work()
        found.setdefault(name, []).append(time.perf_counter() - begin)
        return result

    for train in sorted(folder.glob("*-train.csv"))[:8]:
        verify = train.with_name(train.name.replace("-train", "-verify"))
        runs = timed("read two recordings", lambda: [hrg.read(str(p)) for p in (train, verify)])
        timed("figures of the data sheet", lambda: hrg.data_sheet(runs))
        timed("trace", lambda: hrg.trace(runs[:1], runs[1]))
    return {name: statistics.median(all) for name, all in found.items()}


def written(folder):
    """Seconds that table and page of many units take, and their sizes, MB."""
    from hrg import _hrg

    rows = [json.loads(row) for row in (_hrg.fleet_kept(str(AT / "out-dask"), unit, None, list(LIMIT)) for unit in _hrg.fleet_units(str(folder), str(AT / "out-dask"), None, list(LIMIT))) if row]
    if not rows:
        sys.exit("no row of the run before was kept")
    many = [json.dumps({**rows[k % len(rows)], "unit": f"U{k:05d}"}) for k in range(MANY)]
    out = fresh("out-many")
    out.mkdir(parents=True)
    begin = time.perf_counter()
    _hrg.fleet_write(str(out), "Many", many)
    seconds = time.perf_counter() - begin
    return seconds, [(out / name).stat().st_size / 1e6 for name in ("fleet.parquet", "fleet.html")]


def table(count, rounds):
    folder = units(count)
    size = sum(p.stat().st_size for p in folder.glob("*.csv")) / count / 1e6
    lines = ["| run | cores | units | s a unit and core | over one core | largest process [MB] |", "|---|---:|---:|---:|---:|---:|"]
    each = {}
    for name, run in (("`hrg fleet`", rust), ("`hrg.fleet` on Dask", dask)):
        for cores in (1, 2):
            all = [run(folder, cores) for _ in range(rounds)]
            seconds, memory = statistics.median(s for s, _ in all), max(m for _, m in all)
            each[name, cores] = seconds
            faster = each[name, 1] / seconds
            lines.append(f"| {name} | {cores} | {count} | {seconds * cores / count:.2f} | {faster:.2f} | {memory:.0f} |")
    lines += ["", "| part of a unit, in Python on one core | s |", "|---|---:|"]
    lines += [f"| {name} | {seconds:.3f} |" for name, seconds in parts(folder).items()]
    seconds, sizes = written(folder)
    lines.append(f"| table and page of {MANY} units, once | {seconds:.1f} |")
    unit = each["`hrg fleet`", 2] * 2 / count
    lines += ["", f"| plan for {MANY} units of two recordings ({size:.1f} MB of text a unit) | |", "|---|---:|"]
    for cores in (2, 16, 64):
        lines.append(f"| hours on {cores} cores | {(unit * MANY / cores + seconds) / 3600:.2f} |")
    lines.append(f"| recordings [GB]; table, page [MB] | {size * MANY / 1000:.0f}; {sizes[0]:.1f}, {sizes[1]:.1f} |")
    lines.append(f"| MB a second that the folder must give for 64 cores | {size * 64 / unit:.0f} |")
    return "\n".join(lines) + "\n"


def splice(page, text):
    old = page.read_text()
    begin, end = "<!-- fleet: begin -->\n", "<!-- fleet: end -->"
    before, rest = old.split(begin)
    page.write_text(before + begin + text + end + rest.split(end)[1])


def main():
    wants = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    wants.add_argument("--units", type=int, default=16)
    wants.add_argument("--rounds", type=int, default=3)
    wants.add_argument("--page", type=Path)
    wanted = wants.parse_args()
    AT.mkdir(parents=True, exist_ok=True)
    text = table(wanted.units, wanted.rounds)
    print(text)
    if wanted.page:
        splice(wanted.page, text)


if __name__ == "__main__":
    main()
