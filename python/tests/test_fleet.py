"""A fleet on Dask gives the table that the program gives."""

import pathlib
import subprocess

import pandas
import pytest

import hrg
import hrg.fleet

distributed = pytest.importorskip("distributed")


@pytest.fixture(scope="module")
def units(tmp_path_factory):
    """Four units of two batches, one with a file that is none, and one with a calibration in use."""
    folder = tmp_path_factory.mktemp("units")
    for unit in range(1, 5):
        batch = folder / ("a" if unit < 3 else "b")
        batch.mkdir(exist_ok=True)
        for seed in (1, 2):
            run, _ = hrg.simulate(["stairs", "cycle"][seed - 1], unit=unit, effects=["thermal-lag:tau_s=700,size=4"], seed=seed)
            (batch / f"unit{unit}-{seed}.csv").write_text(run.to_csv())
    (folder / "b" / "broken.csv").write_text("# hrg-recording: 1\n# unit: HRG-99\ntime_s,fx_hz\n1,nonsense\n")
    return folder


def test_the_table_is_that_of_the_program(units, hrg_command, tmp_path):
    subprocess.run([hrg_command, "fleet", str(units), "--out", str(tmp_path / "rust")], check=True, capture_output=True)
    rows = hrg.fleet.run(units, tmp_path / "dask", workers=2)
    ours, theirs = (tmp_path / where / "fleet.parquet" for where in ("rust", "dask"))
    assert ours.read_bytes() == theirs.read_bytes()
    table = pandas.read_parquet(ours)
    assert len(table) == len(rows) == 5
    broken = table[table["unit"] == "HRG-99"].iloc[0]
    assert "broken.csv" in broken["error"] and table["error"].notna().sum() == 1
    assert set(table["batch"]) == {"a", "b"} and table["image_dph_x"].notna().sum() == 4
    page = (tmp_path / "dask" / "fleet.html").read_text()
    assert "HRG-99" in page and "<svg" in page


def test_a_stopped_run_goes_on(units, tmp_path):
    from distributed import Client, LocalCluster

    with LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None) as cluster:
        with Client(cluster) as client:
            first = hrg.fleet.run(units, tmp_path, scheduler=client)
    kept = {path.name: path.stat().st_mtime_ns for path in pathlib.Path(tmp_path, "rows").iterdir()}
    assert len(kept) == 5
    gone = next(iter(kept))
    (tmp_path / "rows" / gone).unlink()
    again = hrg.fleet.run(units, tmp_path, workers=1)
    now = {path.name: path.stat().st_mtime_ns for path in pathlib.Path(tmp_path, "rows").iterdir()}
    assert again == first and [name for name in now if now[name] != kept[name]] == [gone]
