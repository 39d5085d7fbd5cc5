"""Programs that the tests compare with: those of the clone, where they are built."""

import os
import pathlib

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]


def program(name):
    path = pathlib.Path(os.environ.get("HRG_PROGRAMS", ROOT / "target" / "release")) / name
    if not path.exists():
        pytest.skip(f"{path} is not built; cargo xtask build makes it")
    return str(path)


@pytest.fixture(scope="session")
def root():
    return ROOT


@pytest.fixture(scope="session")
def hrg_command():
    return program("hrg")


@pytest.fixture(scope="session")
def hrg_board():
    return program("hrg-board")


@pytest.fixture(scope="session")
def trained():
    """A unit's calibration with effects that remember: from one chamber run."""
    import hrg

    train, _ = hrg.simulate("cycle", effects=["thermal-lag:tau_s=600"], seed=1)
    verify, _ = hrg.simulate("cycle", effects=["thermal-lag:tau_s=600"], seed=2)
    report = hrg.trace(train, verify)
    return train, verify, report
