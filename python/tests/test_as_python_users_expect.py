"""Habits of Python users: paths and frames wherever a recording is, copies, dates, Tab, pictures, methods of their own."""

import copy
import pickle

import numpy as np
import pytest

import hrg


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Two runs as files, and as recordings."""
    folder = tmp_path_factory.mktemp("runs")
    paths = []
    for seed, profile in ((1, "cycle"), (2, "verify")):
        recording, _ = hrg.simulate(profile, effects=["hysteresis"], seed=seed)
        paths.append(folder / f"{seed}.csv")
        recording.write(paths[-1])
    return paths, [hrg.read(p) for p in paths]


@pytest.fixture(scope="module")
def traced(runs):
    return hrg.trace(*runs[0], limit_dph=1.0)


def frame_of(recording):
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame({k: np.array(v) for k, v in recording.to_dict().items()})
    frame.attrs = dict(recording.meta)
    return frame


def test_a_frame_of_a_recording_is_that_recording(runs):
    pytest.importorskip("pandas")
    recording = runs[1][1]
    for again in (hrg.from_table(hrg.to_pandas(recording)), hrg.from_table(recording.to_dict(), recording.meta)):
        for name in recording.columns:
            np.testing.assert_array_equal(again[name], recording[name], err_msg=name)
        assert again.meta == recording.meta


def test_paths_and_frames_are_taken_wherever_a_recording_is(runs, traced):
    paths, recordings = runs
    assert traced.calibration.effects == hrg.trace(*recordings).calibration.effects
    fitted = hrg.fit(str(paths[0]))
    assert fitted.to_toml().split("created")[0] == hrg.fit([recordings[0]]).to_toml().split("created")[0]
    frame = frame_of(recordings[0])
    assert len(hrg.correct(frame, fitted)) == len(hrg.correct(paths[0], fitted))
    assert hrg.data_sheet(frame).axes and "x" in hrg.allan(frame)
    assert hrg.allan(list(range(400)), 1.0)["x"]["missing"] == 0
    pandas = pytest.importorskip("pandas")
    assert hrg.allan(pandas.Series(np.arange(400)), 1)["x"]["missing"] == 0
    with pytest.raises(hrg.HrgError, match="a recording, a path, an open file or a frame is needed, not int"):
        hrg.fit(7)


def test_copies_are_the_same(runs, traced):
    recording = runs[1][0]
    again = pickle.loads(pickle.dumps(recording))
    assert again.columns == recording.columns and again.meta == recording.meta
    for name in recording.columns:
        np.testing.assert_array_equal(again[name], recording[name], err_msg=name)
    assert copy.deepcopy(recording) is recording and copy.copy(recording) is recording
    before, after = recording.split(20000.0)
    for part in (before, after):
        same = pickle.loads(pickle.dumps(part))
        assert len(same) == len(part) and same.to_csv() == part.to_csv()
    calibration = traced.calibration
    again = pickle.loads(pickle.dumps(calibration))
    assert again == calibration and again.notes == calibration.notes and copy.deepcopy(calibration) == calibration
    report = pickle.loads(pickle.dumps(traced))
    assert report.to_dict() == traced.to_dict() and report.calibration == calibration
    assert report.baseline_calibration == traced.baseline_calibration and report.to_html() == traced.to_html()


def test_tab_lists_the_keys(traced, runs):
    assert {"plot", "judge"} <= set(dir(hrg)) and "os" not in dir(hrg)
    assert len(dir(traced)) == len(set(dir(traced)))
    assert {"verdict", "burn", "effects", "verdict_kind", "notes", "final_", "to_html"} <= set(dir(traced))
    assert {"axes", "to_dict"} <= set(dir(hrg.data_sheet(runs[0])))


def test_times_may_be_dates(runs):
    pandas = pytest.importorskip("pandas")
    recording = runs[1][0]
    frame = frame_of(recording)
    dates = pandas.Timestamp("2026-11-20 07:30:00") + pandas.to_timedelta(frame["time_s"] - frame["time_s"].iloc[0], unit="s")
    dated = hrg.from_table(frame.assign(time_s=dates))
    indexed = hrg.from_table(frame.drop(columns="time_s").set_index(pandas.DatetimeIndex(dates)))
    zoned = hrg.from_table(frame.assign(time_s=dates.dt.tz_localize("Europe/Berlin")))
    for r, hours in ((dated, 0), (indexed, 0), (zoned, 1)):
        np.testing.assert_allclose(r["time_s"], recording["time_s"] - recording["time_s"][0], atol=1e-6)
        assert float(r.meta["power_on_unix_s"]) == 1795159800 - 3600 * hours


def test_slips_are_named(runs):
    columns = runs[1][0].to_dict()
    with pytest.raises(hrg.HrgError, match='"thermometr" means nothing; is thermometer meant'):
        hrg.from_table(columns, {"thermometr": "sensor"})
    with pytest.raises(hrg.HrgError, match="column rate_x_dph: could not convert"):
        hrg.from_table({**columns, "rate_x_dph": ["1,5"] * len(columns["time_s"])})
    moving = {"time_s": np.arange(600) * 0.1, "rate_x_dph": 9000 * np.sin(np.arange(600) * 0.2)}
    with pytest.raises(hrg.HrgError, match="sway: axis x: the unit moves"):
        hrg.data_sheet(hrg.from_table(moving, {"thermometer": "none"}, name="sway"))


def test_it_is_judged_against_a_limit(runs, traced):
    judged = hrg.judge(runs[0][1], traced.calibration, 1.0, -20, 50)
    assert judged.verdict == "PASS" and judged.axes["x"]["largest_dph"] < 1.0
    assert str(judged).startswith("PASS") and "limit" in judged.to_html()
    assert hrg.judge(runs[0][1], traced.calibration, 0.1, -20, 50).verdict == "FAIL"
    assert hrg.judge(runs[0][1], traced.calibration, 1.0, -20, 90).verdict == "NOT COVERED"


def test_a_calibration_tells_its_bias(runs, traced):
    calibration = traced.baseline_calibration
    bias, std = calibration.bias([0.0, 25.0], std=True)
    assert bias.shape == std.shape == (2, 3) and np.isfinite(bias).all()
    assert calibration.bias(25.0).shape == (1, 3)
    # By eq 7 of the baseline, as the file has it.
    coefficients = _toml(calibration)
    u = (25.0 - coefficients["scaling"]["t_ref_c"]) / coefficients["scaling"]["t_scale_c"]
    k = coefficients["axis"]["x"]["bias_dph"]
    np.testing.assert_allclose(bias[1, 0], k[0] + k[1] * u + k[2] * u * u, atol=2e-3)
    up, down = traced.calibration.bias(10.0, 1.0), traced.calibration.bias(10.0, -1.0)
    assert abs(up[0, 0] - down[0, 0]) > 0.5, "hysteresis of two half widths"
    corrected = hrg.correct(runs[1][1], traced.calibration)
    np.testing.assert_array_equal(traced.calibration.predict(runs[0][1]), corrected.bias_dph)
    assert traced.calibration.score(runs[0][1]) > calibration.score(runs[0][1]) > 0.0


def _toml(calibration):
    tomllib = pytest.importorskip("tomllib")
    return tomllib.loads(calibration.to_toml())


def test_what_was_corrected_is_a_frame(runs, traced):
    pytest.importorskip("pandas")
    corrected = hrg.correct(runs[1][1], traced.calibration)
    frame = hrg.to_pandas(corrected)
    assert len(frame) == len(corrected) and {"rate_x_dph", "bias_std_z_dph", "status_unit"} <= set(frame.columns)
    assert "seconds" in repr(corrected)


def test_a_method_of_ones_own_stands_in_the_same_table(runs):
    def line(train, run):
        """A straight line of the frequency, by least squares."""
        columns = []
        for axis in run.axes:
            f = np.concatenate([r[f"f{axis}_hz"] for r in train])
            y = np.concatenate([r[f"rate_{axis}_dph"] for r in train])
            good = np.isfinite(f) & np.isfinite(y)
            columns.append(np.polyval(np.polyfit(f[good] - 4900, y[good], 1), run[f"f{axis}_hz"] - 4900))
        return np.stack(columns, axis=1)

    compared = hrg.compare(*runs[1], methods=["lsq"], own={"line": line})
    lsq, own = compared.rows
    assert own["method"] == "line" and "line" in str(compared) and set(compared.calibrations) == {"lsq"}
    for figure in ("train_3sigma_dph", "verify_3sigma_dph"):
        raw = compared.raw[figure]
        assert all(lsq[figure][a] < own[figure][a] < raw[a] for a in range(3)), (figure, lsq[figure], own[figure], raw)
    with pytest.raises(hrg.HrgError, match=r"flat: it gave an array of shape \(5, 1\) where"):
        hrg.compare(*runs[1], methods=["lsq"], own={"flat": lambda train, run: np.zeros(5)})


def test_progress_says_what_is_done_and_of_how_much(runs):
    told = []
    hrg.trace(*runs[1], progress=lambda done, of: told.append((done, of)))
    assert told == sorted(told) and told[-1][0] > 300 and {of for _, of in told} == {1000}


def test_four_pictures(runs, traced, tmp_path):
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    figures = {
        "run": hrg.plot.run(runs[0][0]),
        "residual": hrg.plot.residual(runs[0][1], traced.calibration, traced.baseline_calibration, limit_dph=1.0),
        "bias": hrg.plot.bias({"baseline": traced.baseline_calibration, "traced": traced.calibration}),
        "allan": hrg.plot.allan(runs[0][1]),
    }
    for name, figure in figures.items():
        figure.savefig(tmp_path / f"{name}.png", dpi=60)
        assert (tmp_path / f"{name}.png").stat().st_size > 5000
        assert figure.axes[0].lines and figure.axes[0].get_ylabel()


def test_durations_lists_of_dates_and_masks(runs):
    pandas = pytest.importorskip("pandas")
    recording = runs[1][0]
    frame = frame_of(recording)
    seconds = frame["time_s"] - frame["time_s"].iloc[0]
    start = pandas.Timestamp("2026-11-20 07:30:00")
    dates = [t.to_pydatetime() for t in start + pandas.to_timedelta(seconds, unit="s")]
    for times in (pandas.to_timedelta(seconds, unit="s"), dates, pandas.Series(dates, dtype=object)):
        columns = {**recording.to_dict(), "time_s": times}
        np.testing.assert_allclose(hrg.from_table(columns, recording.meta)["time_s"], seconds, atol=1e-6)
    masked = np.ma.masked_array(recording["rate_x_dph"].copy(), mask=np.arange(len(recording)) % 50 == 0)
    rates = hrg.from_table({**recording.to_dict(), "rate_x_dph": masked}, recording.meta)["rate_x_dph"]
    assert np.isnan(rates[::50]).all() and np.isfinite(rates[1:50]).all()
    nullable = frame.assign(rate_x_dph=frame["rate_x_dph"].astype("Float64"))
    np.testing.assert_array_equal(hrg.from_table(nullable)["rate_x_dph"], recording["rate_x_dph"])


def test_calibrations_may_be_reports_and_paths(runs, traced, tmp_path):
    traced.calibration.write(tmp_path / "cal.toml")
    for calibration in (traced, tmp_path / "cal.toml", str(tmp_path / "cal.toml")):
        assert hrg.judge(runs[0][1], calibration, 1.0, -20, 50).verdict == "PASS"
    with pytest.raises(hrg.HrgError, match="a recording is needed here, not a Calibration; are two arguments exchanged"):
        hrg.judge(traced.calibration, runs[0][1], 1.0, -20, 50)
    with pytest.raises(hrg.HrgError, match="holds corrected rates"):
        hrg.fit(hrg.to_pandas(hrg.correct(runs[0][0], traced)))


def test_wrong_things_are_one_sentence(runs, traced):
    for wrong, words in (
        (lambda: hrg.from_table(None), "takes a frame or a mapping"),
        (lambda: hrg.from_table([1, 2]), "takes a frame or a mapping"),
        (lambda: hrg.read(frame_of(runs[1][0])), "hrg.from_table"),
        (lambda: hrg.read("time_s,rate_x_dph\n1,2\n"), "io.StringIO"),
        (lambda: hrg.read(runs[0][0], latitude_deg="north", axes="x=north"), "is no number"),
        (lambda: hrg.read(runs[0][0], scale_factor_dph_per_code=[1, 2]), "three numbers"),
        (lambda: hrg.allan([1.0] * 400, -1), "above zero"),
        (lambda: hrg.points(runs[0][0]), "hrg.soaks"),
        (lambda: hrg.compare(*runs[0], own=[len]), "a mapping of names to functions"),
        (lambda: hrg.compare(*runs[0], methods=["lsq"], own={"dare": lambda t, r: np.full((len(r), 3), np.nan)}), "nine of ten"),
        (lambda: hrg.plot.bias([]), "no calibration"),
    ):
        with pytest.raises(hrg.HrgError, match=words):
            wrong()


def test_bias_at_the_ends_and_beyond(traced):
    lsq = traced.baseline_calibration
    low, high = lsq.temperature_range_c
    inside, edge = lsq.bias([low + 3.0, high - 3.0], [1.0, -1.0]), lsq.bias([low, high], [1.0, -1.0])
    assert np.abs(inside - edge).max() < 0.5, "no cliff"
    assert np.isnan(lsq.bias([np.nan, high + 100.0])).all() and np.isnan(lsq.bias(20.0, np.inf)).all()


def test_a_part_of_a_run_is_corrected_the_same_after_a_copy(runs, traced):
    _, part = runs[1][0].split(20000.0)
    again = pickle.loads(pickle.dumps(part))
    ours, theirs = hrg.correct(part, traced), hrg.correct(again, traced)
    np.testing.assert_allclose(ours.corrected_dph, theirs.corrected_dph, atol=1e-4)


def test_hdf5_and_matlab_as_the_page_says(tmp_path):
    import h5py
    import scipy.io

    t = np.arange(600.0)
    gyro = np.radians(np.stack([1.0 + 0.01 * t, 0.0 * t, 0.0 * t], axis=1)) / 3600.0
    with h5py.File(tmp_path / "run.h5", "w") as f:
        f["t"], f["imu/temperature"], f["imu/gyro"] = t, 20.0 + 0.01 * t, gyro
    with h5py.File(tmp_path / "run.h5") as f:
        run = hrg.from_table({"time_s": f["t"][:], "temp_c": f["imu/temperature"][:], "rate_x_dph": np.degrees(f["imu/gyro"][:, 0]) * 3600})
    np.testing.assert_allclose(np.asarray(run["rate_x_dph"]), 1.0 + 0.01 * t, atol=1e-9)
    scipy.io.savemat(tmp_path / "run.mat", {"t": t, "T": 20.0 + 0.01 * t, "wz": np.full(600, 0.001) + 1e-5 * np.sin(t)})
    m = scipy.io.loadmat(tmp_path / "run.mat", squeeze_me=True)
    run = hrg.from_table({"time_s": m["t"], "temp_c": m["T"], "rate_z_dph": m["wz"] * 3600})
    assert abs(np.asarray(run["rate_z_dph"]).mean() - 3.6) < 0.01
