"""The examples run, and the notebook is the script."""

import json
import os
import pathlib
import subprocess
import sys

import pytest

EXAMPLES = pathlib.Path(__file__).resolve().parents[1] / "examples"


def cells(text):
    """Cells of a script in the percent format, as a notebook has them."""
    out = []
    for part in text.split("# %%")[1:]:
        head, _, body = part.partition("\n")
        body = body.strip("\n")
        if "[markdown]" in head:
            source = "\n".join(line.removeprefix("# ").removeprefix("#") for line in body.splitlines())
            out.append({"cell_type": "markdown", "metadata": {}, "source": source.splitlines(keepends=True)})
        else:
            out.append(
                {
                    "cell_type": "code",
                    "execution_count": None,
                    "metadata": {},
                    "outputs": [],
                    "source": body.splitlines(keepends=True),
                }
            )
    return out


def notebook(script):
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    return {"cells": cells(script.read_text()), "metadata": {"kernelspec": kernel}, "nbformat": 4, "nbformat_minor": 4}


@pytest.mark.parametrize("name", ["chamber_day"])
def test_the_notebook_is_the_script(name):
    ours = notebook(EXAMPLES / f"{name}.py")
    path = EXAMPLES / f"{name}.ipynb"
    if os.environ.get("HRG_WRITE_NOTEBOOKS"):
        path.write_text(json.dumps(ours, indent=1) + "\n")
    assert json.loads(path.read_text()) == ours, "HRG_WRITE_NOTEBOOKS=1 pytest writes it anew"


@pytest.mark.parametrize("name", ["chamber_day"])
def test_the_script_runs(name, tmp_path):
    pytest.importorskip("matplotlib")
    done = subprocess.run([sys.executable, EXAMPLES / f"{name}.py"], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / f"{name}.png").stat().st_size > 10_000
    assert "x: standard deviation of 100 s means" in done.stdout


def test_the_notebook_runs(tmp_path):
    nbformat = pytest.importorskip("nbformat")
    nbclient = pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    page = nbformat.read(EXAMPLES / "chamber_day.ipynb", as_version=4)
    nbclient.NotebookClient(page, timeout=600, resources={"metadata": {"path": str(EXAMPLES)}}).execute()
    shown = [o for c in page.cells for o in c.get("outputs", []) if "text/html" in o.get("data", {})]
    assert shown and "iframe" in shown[0]["data"]["text/html"]
    (EXAMPLES / "chamber_day.png").unlink(missing_ok=True)
