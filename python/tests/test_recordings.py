"""Recordings in and out: the same numbers, however they come."""

import gc
import gzip
import io

import numpy as np
import pytest

import hrg


@pytest.fixture(scope="module")
def run():
    recording, _ = hrg.simulate("20,30@1,10m", seed=3)
    return recording


def same(a, b):
    assert a.columns == b.columns
    for name in a.columns:
        np.testing.assert_array_equal(a[name], b[name], err_msg=name)


def test_a_path_a_packed_path_and_open_files_are_the_same(run, tmp_path):
    text = run.to_csv()
    path = tmp_path / "run.csv"
    path.write_text(text)
    packed = tmp_path / "run.csv.gz"
    packed.write_bytes(gzip.compress(text.encode()))
    parquet = tmp_path / "run.parquet"
    run.write(parquet)
    for source in (path, str(path), packed, parquet, io.StringIO(text), io.BytesIO(text.encode())):
        again = hrg.read(source)
        same(again, run)
        assert again.meta == run.meta
    with open(parquet, "rb") as file:
        same(hrg.read(file), run)


def test_frames_of_pandas_and_polars_and_dictionaries(run):
    pandas = pytest.importorskip("pandas")
    frame = hrg.to_pandas(run)
    assert isinstance(frame, pandas.DataFrame) and len(frame) == len(run)
    # The rates of the frame are free of the earth's rate, and the metadata say how the unit stood.
    meta = {**run.meta, "earth_rate": "removed"}
    same(hrg.from_table(frame, meta), run)
    same(hrg.from_table(run.to_dict(), meta), run)
    polars = pytest.importorskip("polars")
    same(hrg.from_table(polars.from_dict({k: np.array(v) for k, v in run.to_dict().items()}), meta), run)


def test_columns_look_into_the_recording_and_cannot_be_written(run):
    recording, _ = hrg.simulate("20,5m", seed=4)
    rates = recording["rate_x_dph"]
    before = rates.copy()
    assert rates.base is recording and not rates.flags.owndata
    with pytest.raises(ValueError):
        rates[0] = 1.0
    del recording
    gc.collect()
    np.testing.assert_array_equal(rates, before)


def test_what_is_said_of_a_unit_holds(run):
    text = "time_s,fx_hz,rate_x_dph\n" + "".join(f"{k},{4900 + 0.01 * k},{k % 7}\n" for k in range(300))
    bare = hrg.read(io.StringIO(text))
    assert (bare.unit, bare.axes) == ("unnamed", ["x"])
    told = hrg.read(io.StringIO(text), unit="HRG-7", latitude_deg=45.0, axes="x=north y=east z=down")
    assert told.unit == "HRG-7"
    north = 15.041 * np.cos(np.radians(45.0))
    np.testing.assert_allclose(bare["rate_x_dph"] - told["rate_x_dph"], north, atol=1e-3)
    with pytest.raises(TypeError, match="latitude is not known"):
        hrg.read(io.StringIO(text), latitude=45.0)


def test_what_cannot_be_used_is_one_sentence(tmp_path):
    cases = [
        ("time_s,fx_hz,rate_x_dph\n0,4900,1\n1,abc,2\n", "line 3"),
        ("time_s,fx_hz\n0,4900\n", "rate_x_dph is missing"),
        ("", "the file is empty"),
    ]
    for text, says in cases:
        path = tmp_path / "broken.csv"
        path.write_text(text)
        with pytest.raises(hrg.HrgError, match=says) as e:
            hrg.read(path)
        assert str(path) in str(e.value) and "\n" not in str(e.value)
    with pytest.raises(hrg.HrgError, match="cannot read"):
        hrg.read(tmp_path / "nowhere.csv")
    with pytest.raises(hrg.HrgError, match="rate_y_dph has 3 values, time_s has 2"):
        hrg.from_table({"time_s": [0.0, 1.0], "rate_y_dph": [1.0, 2.0, 3.0]})
    with pytest.raises(hrg.HrgError, match="the column fx_hz is missing"):
        hrg.from_table({"time_s": [0.0, 1.0], "rate_x_dph": [1.0, 2.0]})
    assert issubclass(hrg.HrgError, ValueError)


def test_missing_values_and_gaps_are_noted(run):
    columns = {k: np.array(v) for k, v in run.to_dict().items()}
    columns["rate_y_dph"][100] = np.nan
    columns["rate_z_dph"][200] = 1e6
    noted = hrg.from_table(columns, {**run.meta, "earth_rate": "removed"})
    assert any("rate_y_dph: 1 values are missing" in n for n in noted.notes), noted.notes
    assert np.isnan(noted["rate_z_dph"][200]), "a spike is taken out"


def test_a_split_learns_before_and_judges_after(run):
    before, after = run.split(400.0)
    assert len(before) == np.searchsorted(run["time_s"], 400.0)
    assert np.isnan(after["rate_x_dph"][after["time_s"] < 400.0]).all()
    with pytest.raises(hrg.HrgError, match="a split at"):
        run.split(1e9)


def test_numbers_are_those_of_another_parser(tmp_path):
    """All ways to write a number, against Python's own parser."""
    draw = np.random.default_rng(7)
    forms = ("{!r}", "{:.7f}", "{:.3f}", "{:e}", "{:.17g}", "{:.0f}", "{:+.4f}", " {:.5f} ")
    names = ["fx_hz", "fy_hz", "fz_hz", "rate_x_dph", "rate_y_dph", "rate_z_dph"]
    # The last is read in pieces, while it is loaded.
    for rows, end, mark, missing in ((3000, "\n", "", 0.0), (3000, "\r\n", "\ufeff", 0.05), (160_000, "\n", "", 0.02)):
        values = draw.normal([4900, 4890, 4880, 0, 0, 0], [1e-2] * 3 + [30] * 3, (rows, 6))
        form = draw.integers(0, len(forms), values.shape)
        left_out = draw.random(values.shape) < missing
        cells = [
            ["" if out else forms[f].format(float(v)) for v, f, out in zip(*row)]
            for row in zip(values, form, left_out)
        ]
        lines = [",".join([str(k), *row]) for k, row in enumerate(cells)]
        path = tmp_path / "run.csv"
        path.write_bytes((mark + end.join(["# unit: P", ",".join(["time_s", *names]), *lines, ""])).encode())
        ours = hrg.read(path)
        for k, name in enumerate(names):
            a, b = ours[name], np.array([float(row[k] or "nan") for row in cells])
            there = ~np.isnan(a)
            np.testing.assert_array_equal(a[there].view("u8"), b[there].view("u8"), err_msg=name)
            # (What is missing, and now and then a spike that was taken out.)
            assert np.mean(~there & ~np.isnan(b)) < 1e-3, name
