"""Four pictures by matplotlib: a run, what a calibration leaves, a bias over temperature, an Allan deviation.

Each gives a matplotlib figure; in a notebook it shows itself, and ``figure.savefig(path)`` writes it.
"""

from __future__ import annotations

import warnings

import numpy as np

from . import Calibration, HrgError, Recording, _calibration, _recording, allan as _allan, correct

__all__ = ["allan", "bias", "residual", "run"]

# Colours that stay apart for colour-blind eyes.
_GREY, _BLUE, _ORANGE, _TEAL, _PURPLE = "#9e9e9e", "#1e88e5", "#f57c00", "#00796b", "#7b1fa2"
_SOAK_C_PER_MIN = 0.02


def _figure(columns, rows=1, height=3.4):
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(rows, columns, figsize=(4.6 * columns, height * rows), squeeze=False, layout="constrained")
    for a in axes.flat:
        a.grid(True, color="#dddddd", linewidth=0.6)
        a.set_axisbelow(True)
    plt.close(figure)  # A notebook shows what is returned, and not twice.
    return figure, axes


def _means(values, length):
    count = len(values) // length
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # A mean of nothing is NaN.
        each = np.asarray(values, float)[: count * length].reshape(count, length)
        means = np.nanmean(each, axis=1)
    # (A mean of a few values beside others is none.)
    means[np.isfinite(each).mean(axis=1) < 0.5] = np.nan
    return means


def run(recording):
    """Rates and temperatures of a recording over time, 100 s means."""
    recording = _recording(recording)
    figure, axes = _figure(1, 2, 2.6)
    length = max(1, round(100 / np.median(np.diff(recording["time_s"]))))
    hours = _means(recording["time_s"], length) / 3600
    for name, colour in zip(recording.axes, (_BLUE, _ORANGE, _TEAL)):
        axes[0, 0].plot(hours, _means(recording[f"rate_{name}_dph"], length), color=colour, label=name)
        for column, unit in ((f"temp_{name}_c", "C"), ("temp_c", "C"), (f"f{name}_hz", "Hz")):
            if column in recording.columns:
                axes[1, 0].plot(hours, _means(recording[column], length), color=colour)
                axes[1, 0].set_ylabel(f"{'frequency' if unit == 'Hz' else 'temperature'} [{unit}]")
                break
    axes[0, 0].set_ylabel("rate [deg/h]")
    axes[0, 0].legend()
    axes[1, 0].set_xlabel("time [h]")
    figure.suptitle(f"{recording.unit}: 100 s means")
    return figure


def residual(recording, calibration, before=None, limit_dph=None, means_s=100):
    """Corrected rates of a recording over temperature, heating and cooling apart, the constant of the day included and the earth's rate taken
    off where the attitude is known: means of ``means_s`` seconds. ``before``: another calibration, drawn in grey; ``limit_dph``: drawn as lines."""
    recording, calibration = _recording(recording), _calibration(calibration)
    if int(means_s) < 1 or len(recording) < means_s:
        raise HrgError(f"means of {means_s} s: give a duration from 1 s to that of the recording")
    after = correct(recording, calibration)
    earth = np.asarray(recording.earth_rate_dph or (0.0, 0.0, 0.0))
    temperatures = after.temperature_c.astype(float)
    figure, axes = _figure(len(recording.axes))
    for axis, name in zip(axes[0], recording.axes):
        a = "xyz".index(name)
        celsius = _means(temperatures[:, a], means_s)
        ramp = np.gradient(celsius) * 60.0 / means_s if len(celsius) > 1 else np.zeros(len(celsius))
        if before is not None:
            grey = _means(np.r_[np.nan, correct(recording, before).corrected_dph[1:, a]] - earth[a], means_s)
            axis.plot(celsius[: len(grey)], grey, ".", color=_GREY, markersize=4, label="before")
        means = _means(np.r_[np.nan, after.corrected_dph[1:, a] - earth[a]], means_s)
        for label, colour, those in (
            ("heating", _ORANGE, ramp > _SOAK_C_PER_MIN),
            ("cooling", _TEAL, ramp < -_SOAK_C_PER_MIN),
            ("soak", _PURPLE, np.abs(ramp) <= _SOAK_C_PER_MIN),
        ):
            axis.plot(celsius[those], means[those], ".", color=colour, markersize=4, label=label)
        if limit_dph is not None:
            for sign in (-1, 1):
                axis.axhline(sign * limit_dph, color=_BLUE, linewidth=1.2, label="limit" if sign > 0 else None)
        axis.set_title(name)
        axis.set_xlabel("temperature [C]")
    axes[0, 0].set_ylabel(f"corrected rate, {means_s} s means [deg/h]")
    axes[0, 0].legend(markerscale=2)
    figure.suptitle(recording.unit)
    return figure


def bias(calibrations, temperatures_c=None, ramp_c_per_min=1.0):
    """Bias over temperature of a calibration, or of several by name (a mapping): on soaks, and on ramps up and down after a soak (see
    :meth:`Calibration.bias`); by default over the temperatures that all of them were fitted on."""
    if isinstance(calibrations, (list, tuple)):
        calibrations = {f"{c.unit} {c.checksum:08x}": c for c in map(_calibration, calibrations)}
    named = dict(calibrations) if hasattr(calibrations, "keys") else {"": calibrations}
    named = {label: _calibration(c) for label, c in named.items()}
    if not named:
        raise HrgError("no calibration was given")
    low, high = max(c.temperature_range_c[0] for c in named.values()), min(c.temperature_range_c[1] for c in named.values())
    t = np.linspace(low, high, 41) if temperatures_c is None else np.asarray(temperatures_c, float)
    figure, axes = _figure(3)
    styles = ("-", "--", ":", "-.")
    for k, (label, c) in enumerate(named.items()):
        style = styles[k % len(styles)]
        for ramp, colour, word in (
            (0.0, _PURPLE, "soak"),
            (ramp_c_per_min, _ORANGE, f"+{ramp_c_per_min:g} C/min"),
            (-ramp_c_per_min, _TEAL, f"-{ramp_c_per_min:g} C/min"),
        ):
            values = c.bias(t, ramp)
            for a in range(3):
                axes[0, a].plot(t, values[:, a], style, color=colour, label=f"{label} {word}".strip())
    for a, name in enumerate("xyz"):
        axes[0, a].set_title(name)
        axes[0, a].set_xlabel("temperature [C]")
    axes[0, 0].set_ylabel("bias [deg/h]")
    axes[0, 0].legend()
    return figure


def allan(source, step_s=None):
    """Allan deviation with bars of one standard deviation, of a recording or of rates in deg/h that are ``step_s`` apart."""
    figure, axes = _figure(1)
    for (name, curve), colour in zip(_allan(source, step_s).items(), (_BLUE, _ORANGE, _TEAL)):
        low, high = curve["deviation_dph"] - curve["low_dph"], curve["high_dph"] - curve["deviation_dph"]
        bars = np.abs(np.array([low, high]))
        axes[0, 0].errorbar(curve["tau_s"], curve["deviation_dph"], bars, color=colour, label=name, capsize=2)
    axes[0, 0].set_xscale("log")
    axes[0, 0].set_yscale("log")
    axes[0, 0].set_xlabel("averaging time [s]")
    axes[0, 0].set_ylabel("Allan deviation [deg/h]")
    if not isinstance(source, Recording) and step_s is not None:
        return figure
    axes[0, 0].legend()
    return figure
