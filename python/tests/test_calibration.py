"""Fits, traces and corrections are those of the command and of the unit."""

import json
import os
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

import hrg


def run(*command):
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_trace_names_the_effect_and_halves_the_error(trained):
    train, verify, report = trained
    assert [e["name"] for e in report.effects] == ["thermal-lag"] and report.verdict_kind == "confirmed"
    assert report.to_dict()["effects"] == report.effects and report.verdict in repr(report)
    html = report._repr_html_()
    assert html.startswith("<iframe srcdoc=") and html.count('"') == 8, "quotes of the page are escaped"
    assert report.calibration.effects[0]["name"] == "thermal-lag"
    before, after = (block_std(hrg.correct(verify, c)) for c in (report.baseline_calibration, report.calibration))
    assert after < 0.6 * before
    with pytest.raises(AttributeError, match="no \"guess\""):
        report.guess


def block_std(corrected):
    rates = corrected.corrected_dph[3600:, 0].astype(float)
    rates = rates[: len(rates) // 100 * 100]
    return np.nanstd(rates.reshape(-1, 100).mean(axis=1))


def test_a_fit_is_that_of_the_command(trained, hrg_command, tmp_path):
    train, _, _ = trained
    train.write(tmp_path / "train.csv")
    for method in ("lsq", "two-sets", "fog-pso"):
        run(hrg_command, "fit", tmp_path / "train.csv", "--method", method, "--out", tmp_path / "c.toml")
        theirs = hrg.Calibration.read(tmp_path / "c.toml")
        ours = hrg.fit([train], method)
        assert hrg.fit(train, method).unit == ours.unit
        # The date of the making stands in the image.
        strip = lambda c: [l for l in c.to_toml().splitlines() if not l.startswith(("created_unix_s", "block_crc32"))]
        assert strip(ours) == strip(theirs), method
    assert "lsq" in hrg.methods()
    with pytest.raises(hrg.HrgError, match="there is no method \"guess\""):
        hrg.fit([train], "guess")


def test_calibrations_go_there_and_back(trained, tmp_path):
    c = trained[2].calibration
    assert hrg.Calibration.from_toml(c.to_toml()) == c
    assert hrg.Calibration.from_bytes(c.to_bytes()) == c
    for name in ("c.toml", "c.bin"):
        c.write(tmp_path / name)
        assert hrg.Calibration.read(tmp_path / name) == c
    broken = bytearray(c.to_bytes())
    broken[40] ^= 1
    with pytest.raises(hrg.HrgError, match="checksum"):
        hrg.Calibration.from_bytes(bytes(broken))


def test_twenty_recordings_are_corrected_as_by_the_command_and_by_the_unit(trained, hrg_command, hrg_board, tmp_path):
    calibration = trained[2].calibration
    calibration.write(tmp_path / "c.toml")
    for seed in range(20):
        recording, _ = hrg.simulate(f"{15 + seed},{20 + seed}@1,2h", seed=100 + seed, defects=seed % 2 == 0)
        path, ours, theirs = (tmp_path / f"{n}.csv" for n in ("run", "ours", "theirs"))
        recording.write(path)
        hrg.correct(hrg.read(path), calibration).write(ours)
        run(hrg_command, "correct", path, "--calibration", tmp_path / "c.toml", "--out", theirs)
        assert ours.read_text() == theirs.read_text(), seed
        # What the flashed program sends, and what comes of the frequencies and raw rates that it has measured.
        unit = tmp_path / "unit.csv"
        clean, _ = hrg.simulate(f"{15 + seed},{20 + seed}@5,4m", seed=100 + seed)
        clean.write(path)
        run(hrg_board, "run", "--recording", path, "--calibration", tmp_path / "c.toml", "--seconds", 25, "--out", unit)
        lines = unit.read_text().splitlines()
        names = next(line for line in lines if not line.startswith("#")).split(",")
        rows = [line.split(",") for line in lines if not line.startswith("#")][1:]
        sent = {n: np.array([float(r[k]) if r[k] else np.nan for r in rows]) for k, n in enumerate(names)}
        seen = {n: sent[n] for n in ("time_s", "fx_hz", "fy_hz", "fz_hz")}
        seen.update({f"rate_{a}_dph": sent[f"raw_{a}_dph"] for a in "xyz"})
        c = hrg.correct(hrg.from_table(seen, {"unit": calibration.unit}), calibration)
        for a, axis in enumerate("xyz"):
            for column, values in (("rate", c.corrected_dph), ("bias", c.bias_dph)):
                expected = sent[f"{column}_{axis}_dph"].astype(np.float32)
                np.testing.assert_array_equal(values[:, a], expected, err_msg=f"{column} of {axis}, seed {seed}")
        assert len(c) >= 20


def test_others_run_while_it_works_and_progress_is_told(trained):
    train, verify, _ = trained
    told, ticks, done = [], [0], threading.Event()

    def count():
        while not done.is_set():
            ticks[0] += 1
            time.sleep(0.001)

    other = threading.Thread(target=count)
    other.start()
    begun = time.monotonic()
    hrg.trace(train, verify, progress=told.append)
    took = time.monotonic() - begun
    done.set()
    other.join()
    assert ticks[0] > 100 * took, "the interpreter is free meanwhile"
    assert told and told == sorted(told) and told[-1] > 100

    class Enough(Exception):
        pass

    def stop(tried):
        raise Enough

    with pytest.raises(Enough):
        hrg.trace(train, verify, progress=stop)


@pytest.mark.skipif(os.name != "posix", reason="sends the signal of Ctrl-C")
def test_ctrl_c_stops_it(trained, tmp_path):
    train, verify, _ = trained
    train.write(tmp_path / "train.csv")
    program = (
        "import hrg, sys\n"
        f"r = hrg.read({str(tmp_path / 'train.csv')!r})\n"
        "v, _ = hrg.simulate('cycle', effects=['thermal-lag:tau_s=600'], seed=2)\n"
        "def tell(n):\n    print(n, flush=True)\n"
        "while True:\n    hrg.trace(r, v, progress=tell)\n"
    )
    # What bash runs in the background ignores Ctrl-C, and so does what that starts.
    child = subprocess.Popen(
        [sys.executable, "-c", program],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    assert int(child.stdout.readline()) >= 0, "it works"
    child.send_signal(signal.SIGINT)
    _, said = child.communicate(timeout=60)
    assert child.returncode != 0 and "KeyboardInterrupt" in said, said


def test_a_comparison_is_that_of_the_command(trained, hrg_command, tmp_path):
    train, verify, _ = trained
    train.write(tmp_path / "train.csv")
    verify.write(tmp_path / "verify.csv")
    methods = ["lsq", "two-sets"]
    ours = hrg.compare(train, verify, methods=methods)
    run(hrg_command, "compare", tmp_path / "train.csv", "--verify", tmp_path / "verify.csv", "--methods", ",".join(methods), "--out", tmp_path)
    theirs = json.loads((tmp_path / "compare.json").read_text())
    for a, b in zip(ours.rows, theirs["rows"]):
        timeless = lambda row: {k: v for k, v in row.items() if k not in ("identification_s", "weight")}
        assert timeless(a) == timeless(b)
    assert ours.raw == theirs["raw"] and set(ours.calibrations) == set(methods)
    assert "two-sets" in str(ours) and "<svg" in ours.to_html() and ours._repr_html_().startswith("<iframe")
    with pytest.raises(hrg.HrgError, match="guess"):
        hrg.compare(train, verify, methods=["guess"])
    with pytest.raises(AttributeError, match="a comparison has no"):
        ours.guess


def test_a_data_sheet_is_that_of_the_command(hrg_command, tmp_path):
    paths = []
    for seed in (1, 2):
        recording, _ = hrg.simulate("20,1h", seed=seed)
        paths.append(tmp_path / f"{seed}.csv")
        recording.write(paths[-1])
    said = run(hrg_command, "report", *paths, "--json", tmp_path / "report.json")
    sheet = hrg.data_sheet([hrg.read(p) for p in paths])
    assert sheet.to_dict() == json.loads((tmp_path / "report.json").read_text())
    assert str(sheet) == said and "<html" in sheet.to_html().lower()
    with pytest.raises(hrg.HrgError):
        hrg.data_sheet([])


def test_writing_replaces_nothing_but_a_regular_file(trained, tmp_path):
    train, _, report = trained
    (tmp_path / "target").write_text("old")
    (tmp_path / "link").symlink_to("target")
    os.mkfifo(tmp_path / "pipe")
    for thing in (train, report.calibration, hrg.correct(train, report.calibration)):
        thing.write(tmp_path / "plain")
        thing.write(tmp_path / "link")
        assert (tmp_path / "link").is_symlink() and (tmp_path / "target").read_bytes() == (tmp_path / "plain").read_bytes()
        read = []
        reader = threading.Thread(target=lambda: read.append((tmp_path / "pipe").read_bytes()))
        reader.start()
        thing.write(tmp_path / "pipe")
        reader.join()
        assert (tmp_path / "pipe").is_fifo() and read == [(tmp_path / "plain").read_bytes()]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["link", "pipe", "plain", "target"]
