"""Allan deviation, effects, points, alignment, and what a unit sends."""

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
