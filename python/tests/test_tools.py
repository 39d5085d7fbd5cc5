"""Allan deviation, effects, points, alignment, and what a unit sends."""

import json
import subprocess

import numpy as np
import pytest

import hrg


def test_allan_deviation_is_that_of_its_definition():
    rates = np.cumsum(np.random.default_rng(1).normal(size=5000)) * 0.01
    found = hrg.allan(rates, 0.5)["x"]
    angle = np.concatenate([[0.0], np.cumsum(rates - rates.mean())]) * 0.5
    for tau, deviation in zip(found["tau_s"], found["deviation_dph"]):
        n = round(tau / 0.5)
        second = angle[2 * n :] - 2 * angle[n:-n] + angle[: -2 * n]
        np.testing.assert_allclose(deviation, np.sqrt(np.mean(second**2) / 2) / tau, rtol=1e-9)
    recording, _ = hrg.simulate("20,2h", seed=1)
    assert set(hrg.allan(recording)) == {"x", "y", "z"}
    with pytest.raises(hrg.HrgError, match="step_s"):
        hrg.allan(rates)
    with pytest.raises(hrg.HrgError, match="a hundred at the least"):
        hrg.allan(rates[:50], 1.0)


def test_effects_have_names_and_numbers_of_their_own():
    effects = hrg.effects()
    assert any(e["name"] == "hysteresis" and e["equation"].startswith("`play(T, width) - T`") for e in effects)
    assert len({e["name"] for e in effects}) == len({e["id"] for e in effects}) == len(effects) > 30
    assert {e["reach"] for e in effects} == {"unit", "needs-input", "unpredictable"}


def test_points_of_a_table(root):
    report = hrg.points(root / "host-tests" / "recordings" / "dong2023-table1.csv")
    assert report["fits"]


def test_an_alignment_is_that_of_the_command(hrg_command, tmp_path):
    path = tmp_path / "a.csv"
    subprocess.run([hrg_command, "simulate-alignment", "--seed", "0", "--out", path], check=True, capture_output=True)
    found = hrg.align(path)
    assert abs(found["azimuth_deg"] - 100.0) * 60 < 5 * found["azimuth_std_arcmin"]
    with pytest.raises(hrg.HrgError, match="there is no filter"):
        hrg.align(path, "guess")


def test_a_units_log_is_read(hrg_board, tmp_path):
    recording, _ = hrg.simulate("20,5m", seed=1)
    recording.write(tmp_path / "run.csv")
    subprocess.run(
        [hrg_board, "run", "--recording", tmp_path / "run.csv", "--seconds", "20", "--out", tmp_path / "o.csv", "--log", tmp_path / "log"],
        check=True, capture_output=True,
    )
    seconds = list(hrg.decode_log((tmp_path / "log").read_text()))
    assert len(seconds) > 10 and all(abs(s["frequency_hz"][0] - 4900) < 50 for s in seconds[3:])
    assert list(hrg.decode_log(["no line of a unit"])) == []


def test_bytes_that_are_no_frames_are_counted():
    decoder = hrg.LinkDecoder()
    assert decoder.push(b"\x01\x02\x03\x00" * 5) == [] and decoder.errors == 5
    assert list(hrg.decode_link(b"\x00" * 100)) == []


def test_another_programs_file_is_imported(root):
    folder = root / "host-tests" / "recordings" / "measured"
    imu = hrg.import_table(folder / "imu_raw_data.csv.gz", str(folder / "imu_raw_data.toml"))
    assert len(imu) > 8000 and imu.axes == ["x", "y", "z"]
    with pytest.raises(hrg.HrgError, match="built in are px4"):
        hrg.import_table(folder / "imu_raw_data.csv.gz", "nowhere")


def test_soaks_are_those_of_the_command(hrg_command, tmp_path):
    recording, _ = hrg.simulate("soaks", seed=1)
    recording.write(tmp_path / "run.csv")
    subprocess.run([hrg_command, "soaks", tmp_path / "run.csv", "--out", tmp_path / "soaks.csv"], check=True, capture_output=True)
    found = hrg.soaks(recording)
    lines = [l for l in (tmp_path / "soaks.csv").read_text().splitlines() if not l.startswith("#")]
    assert list(found) == lines[0].split(",") and len(found["fx_hz"]) == len(lines) - 1 > 3
    assert [f"{v:g}" for v in found["fx_hz"]] == [f"{float(l.split(',')[list(found).index('fx_hz')]):g}" for l in lines[1:]]
    with pytest.raises(hrg.HrgError, match="above zero"):
        hrg.soaks(recording, hold_s=0)


def test_errors_of_accelerometers_are_taken_out(hrg_command, tmp_path):
    # A tilting table: g times tilt along an axis, with bias, scale and cross-axis.
    g, tilts = 9.80665, np.radians(np.array([[0, 0], [60, 0], [-60, 0], [0, 60], [0, -60], [40, 40]]) / 60)
    # Small ones: the alignment below was simulated without any, and must not be refused.
    bias, matrix = np.array([1e-6, -2e-6]), np.array([[1.0002, 3e-5], [-2e-5, 0.9998]])
    lines = ["a1_mps2,a2_mps2,tilt1_arcmin,tilt2_arcmin"]
    for t1, t2 in tilts:
        a = bias + matrix @ (g * np.array([np.sin(t2), -np.sin(t1)]))
        lines.append(f"{a[0]:.12f},{a[1]:.12f},{np.degrees(t1) * 60},{np.degrees(t2) * 60}")
    table = tmp_path / "table.csv"
    table.write_text("\n".join(lines) + "\n")
    command = [hrg_command, "accelerometers", table, "--latitude", "45", "--gravity", str(g), "--out", tmp_path / "a.json"]
    subprocess.run(command, check=True, capture_output=True)
    found = hrg.accelerometers(table, latitude_deg=45.0, gravity_mps2=g)
    assert found == json.loads((tmp_path / "a.json").read_text())
    path = tmp_path / "run.csv"
    subprocess.run([hrg_command, "simulate-alignment", "--seed", "0", "--out", path], check=True, capture_output=True)
    subprocess.run(
        [hrg_command, "align", "--recording", path, "--accelerometers", tmp_path / "a.json", "--out", tmp_path / "r.json"],
        check=True, capture_output=True,
    )
    theirs = json.loads((tmp_path / "r.json").read_text())
    assert hrg.align(path, accelerometers=found) == hrg.align(path, accelerometers=tmp_path / "a.json") == theirs
    assert theirs["azimuth_deg"] != hrg.align(path)["azimuth_deg"]
    with pytest.raises(hrg.HrgError, match="no file of hrg align accelerometers"):
        hrg.align(path, accelerometers={"bias": 1})
