"""Effects that a user has written are judged as those of the library."""

import numpy as np
import pytest

import hrg

CENTRE_HZ = {"x": 4906.0, "y": 4898.0, "z": 4709.6}


def peak(frequency_hz, axis):
    """A resonance of the mount: a peak in frequency, which no effect of the library is."""
    return 1.0 / (1.0 + ((frequency_hz - CENTRE_HZ[axis]) / 1.5) ** 2)


def recording(profile, seed, size_dph):
    clean, _ = hrg.simulate(profile, unit=61, seed=seed)
    table = dict(clean.to_dict())
    for axis, earth_dph in zip("xyz", clean.earth_rate_dph):
        added = earth_dph + size_dph * peak(table[f"f{axis}_hz"], axis)
        table[f"rate_{axis}_dph"] = table[f"rate_{axis}_dph"] + added
    return hrg.from_table(table, clean.meta)


@pytest.fixture(scope="module")
def with_peak():
    return recording("cycle", 121, 2.0), recording("verify", 122, 2.0)


def mount(**options):
    return hrg.OwnEffect("mount-resonance", lambda s: peak(s.frequency_hz, s.axis), **options)


def useless():
    return hrg.OwnEffect("clock-phase", lambda s: np.mod(s.time_s / 731.0, 1.0))


def test_one_that_is_there_is_found_and_a_useless_one_is_refused(with_peak):
    train, verify = with_peak
    report = hrg.trace(train, verify, own_effects=[useless(), mount()])
    assert [e["name"] for e in report.effects] == ["mount-resonance"], report.verdict
    found = report.effects[0]
    assert found["class"] == "own" and found["confirmed"] and report.verdict_kind == "confirmed"
    for axis in "xyz":
        gain = found["axes"][axis]
        assert abs(gain["gain"] - 2.0) < 4 * max(gain["gain_std"], 0.02), axis
        assert report.final_[axis]["verify_rms_dph"] < 1.25 * report.noise_floor_dph[axis], axis
    # No image holds it, and the report says so. (What a unit has may do the same.)
    assert "mount-resonance is your own" in report.verdict
    assert report.calibration is None or all("mount-resonance" not in str(e) for e in report.calibration.effects)
    assert "mount-resonance" in report.to_html() and "own-effects.md" in report.to_html()


def test_on_a_unit_without_it_nothing_is_invented():
    train, verify = recording("cycle", 123, 0.0), recording("verify", 124, 0.0)
    report = hrg.trace(train, verify, own_effects=[mount(), useless()])
    assert report.effects == [] and report.verdict_kind == "nothing-lacks", report.verdict


def test_several_columns_are_one_effect(with_peak):
    train, verify = with_peak
    two = hrg.OwnEffect("peak-and-slope", lambda s: np.column_stack([peak(s.frequency_hz, s.axis), s.ramp_c_per_min**3]))
    report = hrg.trace(train, verify, own_effects=[two])
    found = next(e for e in report.effects if e["name"] == "peak-and-slope")
    assert len(found["axes"]["x"]["gains"]) == 2


def test_states_are_those_of_the_unit(with_peak):
    train, verify = with_peak
    seen = []

    def look(s):
        seen.append(s)
        return peak(s.frequency_hz, s.axis)

    report = hrg.trace(train, verify, own_effects=[hrg.OwnEffect("look", look)])
    corrected = hrg.correct(train, report.baseline_calibration)
    first = seen[0]
    assert first.axis == "x" and first.step_s == 1.0 and first.temperatures_c.shape == (len(first.time_s), 3)
    np.testing.assert_array_equal(first.temperature_c, first.temperatures_c[:, 0])
    np.testing.assert_array_equal(first.board_c, train["board_c"].astype(np.float32))
    # The curve of a fit goes into the image in single precision: so do temperatures.
    n = min(len(corrected), len(first.time_s))
    np.testing.assert_allclose(first.temperature_c[100 : n - 100], corrected.temperature_c[100 : n - 100, 0], atol=0.05)


def test_what_a_function_raises_is_one_sentence_with_its_name(with_peak):
    train, verify = with_peak

    def broken(s):
        return s.temperature_c / s.no_such_thing

    with pytest.raises(hrg.HrgError, match="own effect hopeful, axis x: its function raised AttributeError: .*no_such_thing.*correct the function") as e:
        hrg.trace(train, verify, own_effects=[hrg.OwnEffect("hopeful", broken)])
    assert isinstance(e.value.__cause__, AttributeError), "the traceback of the function is there"
    for function, wanted in [
        (lambda s: s.time_s[:-1], r"an array of shape \(\d+,\) where"),
        (lambda s: "text", "could not convert"),
        (lambda s: np.full_like(s.time_s, np.nan), "no finite value"),
        (lambda s: np.ones((len(s.time_s), 15)), "15 columns; give 1 to 14"),
    ]:
        with pytest.raises(hrg.HrgError, match=wanted):
            hrg.trace(train, verify, own_effects=[hrg.OwnEffect("wrong", function)])
    with pytest.raises(hrg.HrgError, match="the library has an effect of this name"):
        hrg.trace(train, verify, own_effects=[hrg.OwnEffect("kink", peak)])
    with pytest.raises(hrg.HrgError, match="0 values; give 1 to 64"):
        hrg.trace(train, verify, own_effects=[mount(parameter=("width_hz", []))])
