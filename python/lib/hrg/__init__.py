"""Thermal calibration of hemispherical resonator gyros, by the code that the unit itself runs.

Every function is the desktop library itself: a fit from here and one by the command ``hrg fit`` are the same image, and
:func:`correct` gives what a unit would send, to the last bit.

Rates are in deg/h, temperatures in degrees Celsius, frequencies in Hz, times in s. What cannot be used raises
:class:`HrgError` with one sentence.
"""

from __future__ import annotations

import dataclasses
import datetime
import difflib
import gzip
import inspect
import io
import itertools
import os
import tempfile
import time
import warnings
from collections.abc import Mapping
from typing import Any

import numpy as _np

from ._hrg import (
    Calibration,
    Corrected,
    Figures,
    HrgError,
    LinkDecoder,
    LogDecoder,
    Recording,
    Report,
    __version__,
    align,
    allan as _allan,
    compare as _compare,
    correct as _correct,
    data_sheet as _data_sheet,
    effects,
    fit as _fit,
    identify_accelerometers as accelerometers,
    import_table,
    judge as _judge,
    methods,
    points,
    simulate,
    soaks as _soaks,
    trace as _trace,
)

__all__ = [
    "Calibration",
    "Corrected",
    "Figures",
    "HrgError",
    "LinkDecoder",
    "LogDecoder",
    "OwnEffect",
    "Recording",
    "Report",
    "States",
    "__version__",
    "accelerometers",
    "align",
    "allan",
    "compare",
    "correct",
    "data_sheet",
    "decode_link",
    "decode_log",
    "effects",
    "fit",
    "from_table",
    "import_table",
    "judge",
    "methods",
    "plot",
    "points",
    "read",
    "simulate",
    "soaks",
    "to_pandas",
    "trace",
]

_SAID = ("unit", "latitude_deg", "axes", "scale_factor_dph_per_code")


def _said(given: dict[str, Any]) -> dict[str, Any]:
    unknown = [name for name in given if name not in _SAID]
    if unknown:
        raise TypeError(f"{unknown[0]} is not known; there are {', '.join(_SAID)}")
    said = {name: given.get(name) for name in _SAID}
    for name, make in (("unit", str), ("latitude_deg", float), ("axes", str)):
        try:
            said[name] = None if said[name] is None else make(said[name])
        except (TypeError, ValueError):
            raise HrgError(f"{name}: {said[name]!r} is no {'number' if make is float else 'text'}") from None
    if said["scale_factor_dph_per_code"] is not None:
        said["scale_factor_dph_per_code"] = _three(said["scale_factor_dph_per_code"])
    return said


def _three(values):
    if isinstance(values, str):
        values = values.replace(",", " ").split()
    try:
        three = [float(v) for v in values]
    except (TypeError, ValueError):
        three = []
    if len(three) != 3:
        raise HrgError("scale_factor_dph_per_code: give three numbers, deg/h per code of x, y and z")
    return three


def read(source, **said):
    """Reads a recording: a path (CSV or Parquet, packed by gzip or not), or an open file, text or binary.

    ``unit``, ``latitude_deg`` with ``axes``, and ``scale_factor_dph_per_code`` (three numbers) say what the recording does not.
    Rows that cannot be used are taken out of what fits take; :attr:`Recording.notes` says which.
    """
    if _is_table(source) or isinstance(source, Recording):
        raise HrgError(f"hrg.read takes a path or an open file; a {type(source).__name__} goes to hrg.from_table, or is a recording already")
    if isinstance(source, (bytes, bytearray)) or isinstance(source, str) and "\n" in source:
        raise HrgError("hrg.read takes a path or an open file; for text give io.StringIO(text), for bytes io.BytesIO(bytes)")
    if not (isinstance(source, (str, os.PathLike)) or hasattr(source, "read")):
        raise HrgError(f"hrg.read takes a path or an open file, not {type(source).__name__}")
    if hasattr(source, "read"):
        content = source.read()
        if isinstance(content, bytes) and content.startswith(b"\x1f\x8b"):
            content = gzip.decompress(content)
        if not isinstance(content, (str, bytes)):
            raise HrgError(f"the open file gave {type(content).__name__} where text or bytes are needed")
        source = io.StringIO(content) if isinstance(content, str) else io.BytesIO(content)
    return Recording._read(source, _said(said))


def from_table(table, meta=None, *, name="", **said):
    """Makes a recording of columns in memory: a mapping of names to arrays, a pandas or a polars frame.

    Names are those of a recording's columns: ``time_s`` (s), ``rate_x_dph`` (deg/h), ``fx_hz`` (Hz) or ``temp_x_c`` (C), and
    so on; each is one-dimensional, all are of one length, NaN where a value is missing. ``time_s`` may be datetimes, and so may be the index
    of a pandas frame without that column: time then begins at 0, and ``power_on_unix_s`` says when that was. ``meta``: metadata; a pandas
    frame's ``attrs`` are taken as well. ``name``: of the recording in sentences and reports.
    """
    if not _is_table(table):
        raise HrgError(f"hrg.from_table takes a frame or a mapping of names to columns, not {type(table).__name__}")
    if hasattr(table, "collect"):
        table = table.collect()
    if not (meta is None or isinstance(meta, Mapping)):
        raise HrgError(f"meta is a mapping of keys to values, not {type(meta).__name__}")
    names = list(table.keys()) if isinstance(table, Mapping) else list(table.columns)
    entries = _entries({**getattr(table, "attrs", {}), **(meta or {})})
    values = {str(n): table[n] for n in names}
    index = getattr(table, "index", None)
    if "time_s" not in values and _is_datetime(index):
        values = {"time_s": index, **values}
    columns = []
    for n, column in values.items():
        if n == "time_s" and _is_datetime(column):
            column, since_1970 = _seconds(column)
            entries.setdefault("power_on_unix_s", f"{since_1970:.3f}")
        elif _is_duration(column):
            column = _np.asarray(column).astype("timedelta64[us]") / _np.timedelta64(1, "s")
        columns.append((n, _numbers(n, column)))
    return Recording._of_columns(columns, [(str(k), str(v)) for k, v in entries.items()], _said(said), str(name))


def _entries(given):
    """Metadata as texts, without what is None or NaN. Refuses a key that is nearly one with a meaning: a slip would otherwise change nothing,
    and say nothing."""
    known = Recording._keys()
    plain = {k.replace("-", "_"): k for k in known}
    entries = {}
    for key, value in given.items():
        if value is None or isinstance(value, float) and value != value:
            continue
        key = str(key)
        # (Keys may be written with capitals, blanks or hyphens, as in a file.)
        written = key.lower().replace(" ", "_").replace("-", "_")
        near = difflib.get_close_matches(written, list(plain), 1, 0.85)
        if written in plain:
            key = plain[written]
        elif near:
            raise HrgError(f'metadata "{key}" means nothing; is {plain[near[0]]} meant?')
        several = isinstance(value, (list, tuple, _np.ndarray))
        entries[key] = " ".join(str(v) for v in value) if several else str(value)
    return entries


def _is_datetime(column):
    if column is None or isinstance(column, str):
        return False
    kind = getattr(column, "dtype", None)
    if kind is None or kind == object:
        first = next((v for v in column if v is not None), None) if hasattr(column, "__iter__") and hasattr(column, "__len__") else None
        return isinstance(first, (datetime.datetime, _np.datetime64))
    return getattr(kind, "kind", "") == "M" or "datetime" in str(kind).lower()


def _is_duration(column):
    kind = getattr(column, "dtype", None)
    return kind is not None and (getattr(kind, "kind", "") == "m" or str(kind).lower().startswith(("timedelta", "duration")))


def _seconds(column):
    """Seconds from the first of some datetimes, and the seconds since 1970 at it."""
    if getattr(column, "dtype", object) == object:
        naive = [v.astimezone(datetime.timezone.utc).replace(tzinfo=None) if getattr(v, "tzinfo", None) else v for v in column]
        column = _np.array(naive, dtype="datetime64[us]")
    # (A pandas series has its time zone under dt, an index itself.)
    zoned = getattr(column, "dt", column)
    if getattr(zoned, "tz", None) is not None:
        column = zoned.tz_convert("UTC")
        column = getattr(column, "dt", column).tz_localize(None)
    # (Microseconds reach over all years; nanoseconds do not.)
    times = _np.asarray(column).astype("datetime64[us]")
    first = times[~_np.isnat(times)][0] if (~_np.isnat(times)).any() else _np.datetime64(0, "us")
    seconds = (times - first) / _np.timedelta64(1, "s")
    return seconds, (first - _np.datetime64(0, "us")) / _np.timedelta64(1, "s")


def _numbers(name, column):
    try:
        if isinstance(column, _np.ma.MaskedArray):
            column = _np.ma.filled(column.astype(_np.float64), _np.nan)
        if type(column).__module__.startswith("pandas") and str(getattr(column, "dtype", "")) in ("Int64", "Float64", "Int32", "Float32"):
            column = column.to_numpy(dtype=_np.float64, na_value=_np.nan)
        values = _np.asarray(column)
        if values.dtype.kind == "c":
            raise TypeError("complex numbers are no measured values")
        values = _np.ascontiguousarray(values, dtype=_np.float64)
    except (TypeError, ValueError) as e:
        dates = "; dates as text become times by pandas.to_datetime" if name == "time_s" and "convert string" in str(e) else ""
        raise HrgError(f"column {name}: {e}; give numbers, NaN where a value is missing{dates}") from None
    if values.ndim != 1:
        raise HrgError(f"column {name} has {values.ndim} dimensions; give one value a row")
    return values


def _is_table(source):
    return isinstance(source, Mapping) or (hasattr(source, "columns") and hasattr(source, "__getitem__"))


def _recording(source):
    """A recording of whatever is one: itself, a path, an open file, a frame, or a mapping of columns."""
    if isinstance(source, Recording):
        return source
    if isinstance(source, (Calibration, Report, Corrected, Figures)):
        raise HrgError(f"a recording is needed here, not a {type(source).__name__}; are two arguments exchanged?")
    if isinstance(source, (str, os.PathLike)) or hasattr(source, "read"):
        return read(source)
    if _is_table(source):
        return from_table(source)
    raise HrgError(f"a recording, a path, an open file or a frame is needed, not {type(source).__name__}")


def _several(sources):
    one = isinstance(sources, (Recording, str, os.PathLike)) or hasattr(sources, "read") or _is_table(sources)
    one = one or not hasattr(sources, "__iter__") or isinstance(sources, (Calibration, Report, Corrected, Figures))
    return [_recording(s) for s in ([sources] if one else sources)]


def _calibration(source):
    """A calibration of whatever is one: itself, a report, a path."""
    if isinstance(source, Calibration):
        return source
    if isinstance(source, Report):
        if source.calibration is None:
            raise HrgError("the trace wrote no calibration: no image beats the raw rates")
        return source.calibration
    if isinstance(source, (str, os.PathLike)):
        return Calibration.read(source)
    raise HrgError(f"a calibration, a report or the path of a calibration is needed, not {type(source).__name__}")


def _restored_recording(columns, meta, source, judged_from_s):
    return Recording._of_columns(columns, meta, _said({}), source, judged_from_s)


def _with_progress(options):
    """Options with a progress that the library calls: with what is done and of how much, or with one number, as functions of before take it."""
    tell = options.get("progress")
    if tell is None:
        return options
    try:
        inspect.signature(tell).bind(0, 1000)
        both = True
    except (TypeError, ValueError):
        both = False
    call = (lambda tried, share: tell(share, 1000)) if both else (lambda tried, share: tell(tried))
    return {**options, "progress": call}


def to_pandas(recording):
    """A recording, or what :func:`correct` gave, as a pandas frame: a column each, metadata in ``attrs``."""
    import pandas

    recording = recording if isinstance(recording, Corrected) else _recording(recording)
    frame = pandas.DataFrame(recording.to_dict())
    if isinstance(recording, Corrected):
        lines = itertools.takewhile(lambda line: line.startswith("#"), recording.to_csv().splitlines())
        frame.attrs = {k.strip("# "): v.strip() for k, _, v in (line.partition(":") for line in lines)}
    else:
        frame.attrs = dict(recording.meta)
    return frame


def fit(recordings, method="lsq", **options):
    """Coefficients of a bias model from one recording or several, by a method of :func:`methods`.

    A recording may be a :class:`Recording`, a path, an open file or a frame. Options: ``seed`` (of methods that draw), ``uniform``,
    ``breakpoint_c``, ``curve`` (a calibration of temperatures), ``different_units``, ``progress`` (called with what is done and of how
    much). Gives a :class:`Calibration`.
    """
    if options.get("curve") is not None:
        options["curve"] = _calibration(options["curve"])
    return _fit(_several(recordings), method, **_with_progress(options))


def trace(train, verify, **options):
    """Finds what the baseline model lacks: learns from ``train`` (one recording or several), judges on ``verify``.

    A recording may be a :class:`Recording`, a path, an open file or a frame. Options: ``in_use`` (the calibration that a new one must beat),
    ``judge`` (a third recording, which chooses nothing and judges alone), ``exchange`` (search on ``verify``, too: advice),
    ``repeat_is_enough`` (recommend a burn also where ``verify`` only repeats the profile of ``train``), ``different_units``, ``limit_dph``
    (drawn into the first pictures), ``prior`` (the file of a family that the unit is of), ``jobs`` (accepted and not used: a trace takes one processor), ``progress`` (called with what is done
    and of how much), ``own_effects`` (effects that you have written, :class:`OwnEffect`). Ctrl-C stops it.
    """
    if options.get("judge") is not None:
        options["judge"] = _recording(options["judge"])
    if options.get("in_use") is not None:
        options["in_use"] = _calibration(options["in_use"])
    return _trace(_several(train), _recording(verify), **_with_progress(options))


def correct(recording, calibration, **options):
    """What a unit with this calibration would have sent for a recording (or a path, an open file, a frame), to the last bit: with the earth's
    rate, which a unit cannot know."""
    return _correct(_recording(recording), _calibration(calibration), **options)


def judge(runs, calibration, limit_dph, from_c, to_c, **options):
    """Does the unit pass? The largest error of the corrected rates over a range of temperatures, axis by axis, against a limit.

    ``runs``: recordings of raw rates that the calibration was not fitted to. ``limit_dph``: deg/h, the constant of the day included;
    ``from_c`` and ``to_c``: the range, C. Options: ``means_s`` (length of the means, 100), ``different_units``. The
    :class:`Figures` that it gives have ``verdict`` ("PASS", "FAIL" or "NOT COVERED") and ``axes``.
    """
    return _judge(_several(runs), _calibration(calibration), float(limit_dph), float(from_c), float(to_c), **options)


def allan(source, step_s=None):
    """Overlapping Allan deviation by axis, of a recording (or a path, a frame) or of rates in deg/h that are ``step_s`` apart."""
    recording = isinstance(source, (Recording, str, os.PathLike)) or hasattr(source, "read") or _is_table(source)
    if recording:
        return _allan(_recording(source))
    if step_s is None or not float(step_s) > 0.0:
        raise HrgError("give the time between the values with step_s, in seconds above zero")
    return _allan(_numbers("of rates", source), float(step_s))


@dataclasses.dataclass(frozen=True)
class States:
    """What an own effect may look at: one axis of one run, a value each second; NaN where it is not known.

    Temperatures and their rates of change are those that the unit's own code makes of the recording.
    """

    axis: str
    """ "x", "y" or "z"."""
    step_s: float
    """Time between two values, s."""
    time_s: _np.ndarray
    """Time since power-on, s. Shape (seconds,)."""
    temperature_c: _np.ndarray
    """Temperature of the axis, C. Shape (seconds,)."""
    ramp_c_per_min: _np.ndarray
    """Its rate of change, C per minute. Shape (seconds,)."""
    frequency_hz: _np.ndarray
    """Frequency of the axis, Hz (C where a sensor is the thermometer). Shape (seconds,)."""
    temperatures_c: _np.ndarray
    """Temperatures of x, y, z, C. Shape (seconds, 3)."""
    case_c: _np.ndarray
    """Sensor on the case of the axis, C. Shape (seconds,)."""
    board_c: _np.ndarray
    """Temperature of the board, C. Shape (seconds,)."""
    supply_v: _np.ndarray
    """Supply, V. Shape (seconds,)."""
    drive_v: _np.ndarray
    """Drive of the axis, V. Shape (seconds,)."""
    quad_v: _np.ndarray
    """Quadrature-nulling voltage of the axis, V. Shape (seconds,)."""


class OwnEffect:
    """An effect of your own, for :func:`trace`.

    ``function`` takes :class:`States` and gives one column, shape (seconds,), or up to fourteen, shape (seconds, columns): what the bias
    may be a multiple of, in any unit; the trace finds the gains. A missing value is NaN. ``parameter``: a name with unit and the values
    to try, ``("tau_s", [300, 600, 1200])``; the function gets the value as a keyword of that name.

    It is judged as an effect of the library is: by its evidence on the train run less its price, by the price of each value that is tried,
    by surrogates without any effect, and by the verify run. What no program sees is how many effects you have tried before: give all
    your ideas in one call. A unit cannot compensate it, and no image holds it, until it is written in Rust (docs/own-effects.md).
    """

    def __init__(self, name, function, *, parameter=None):
        self.name = str(name)
        self.function = function
        self.parameter = None if parameter is None else (str(parameter[0]), [float(v) for v in parameter[1]])

    def __repr__(self):
        return f"<hrg.OwnEffect {self.name}>"

    def _columns(self, given, value):
        """Columns one below the other, shape (columns, seconds)."""
        keywords = {} if value is None else {self.parameter[0]: value}
        columns = _np.asarray(self.function(States(**given), **keywords), dtype=_np.float64)
        seconds = len(given["time_s"])
        if columns.ndim not in (1, 2) or columns.shape[0] != seconds:
            raise ValueError(f"it gave an array of shape {columns.shape} where ({seconds},) or ({seconds}, columns) is asked")
        return _np.ascontiguousarray(columns.reshape(seconds, -1).T)


def compare(train, verify, *, out=None, own=None, **options):
    """Every method on the same data: learns from ``train``, judges on ``verify`` (one recording or several each).

    Options: ``methods`` (names of :func:`methods`, and ``trace``; all by default), ``seed``, ``from_s`` (judged from this time of each run
    on, s), ``different_units``, ``progress``. ``out``: a folder for the calibrations, one a method. Ctrl-C stops it.
    ``own``: methods of your own, ``{"mine": function}``. The function is called as ``function(train, run)`` with the list of train
    recordings and one recording to correct, and gives the bias in deg/h for each row of that run, shape (rows, axes); it gets the train
    runs as well as the verify runs, one by one, and must learn from ``train`` alone.
    Gives :class:`Figures` whose ``rows`` hold a method each, and whose ``calibrations`` are what was fitted.
    """
    train, verify = _several(train), _several(verify)
    if isinstance(options.get("methods"), str):
        options["methods"] = [options["methods"]]
    if not (own is None or isinstance(own, Mapping) and all(callable(f) for f in own.values())):
        raise HrgError('own is a mapping of names to functions: own={"mine": function}')
    if not (train and verify):
        raise HrgError("a comparison needs a train run and a verify run at the least")
    methods_of_own = []
    for name, function in (own or {}).items():
        begun = time.perf_counter()
        first = _bias_of(name, function, train, train[0])
        seconds = time.perf_counter() - begun
        on_train = [first] + [_bias_of(name, function, train, r) for r in train[1:]]
        on_verify = [_bias_of(name, function, train, r) for r in verify]
        methods_of_own.append((str(name), seconds, on_train, on_verify))
    options = _with_progress(options)
    if out is not None:
        return _compare(train, verify, out, own=methods_of_own, **options)
    with tempfile.TemporaryDirectory(prefix="hrg-compare-") as folder:
        return _compare(train, verify, folder, own=methods_of_own, **options)


def _bias_of(name, function, train, run):
    bias = _np.asarray(function(list(train), run), dtype=_np.float64)
    if bias.ndim == 1:
        bias = bias[:, None]
    if bias.shape != (len(run), len(run.axes)):
        raise HrgError(
            f"{name}: it gave an array of shape {bias.shape} where ({len(run)}, {len(run.axes)}) is asked: a bias for each row and axis, deg/h"
        )
    rates = _np.stack([run[f"rate_{a}_dph"] for a in run.axes], axis=1)
    lacking = _np.isfinite(rates) & ~_np.isfinite(bias)
    if lacking.mean() > 0.1:
        raise HrgError(f"{name}: no bias in {100 * lacking.mean():.0f} % of the rows that have a rate; a method must answer in nine of ten")
    return _np.ascontiguousarray(bias)


def data_sheet(recordings):
    """Figures of a data sheet from recordings alone (of one unit, each one power-on), with intervals; see docs of ``hrg report``."""
    return _data_sheet(_several(recordings))


def soaks(recordings, *, settled_c_per_min=0.01, hold_s=600.0):
    """The soaks of recordings of one unit as a table of static points, a dictionary of arrays: what :func:`points` takes as a file.

    A soak: each resonator changes by less than ``settled_c_per_min``, for ``hold_s`` seconds at the least.
    """
    text = _soaks(_several(recordings), settled_c_per_min=settled_c_per_min, hold_s=hold_s)
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    names = lines[0].split(",")
    rows = [[float(v) if v else float("nan") for v in line.split(",")] for line in lines[1:]]
    return {name: _np.array([row[k] for row in rows]) for k, name in enumerate(names)}


def decode_link(chunks):
    """Messages of a unit's link, as dictionaries, from an iterable of bytes (or one piece of bytes)."""
    decoder = LinkDecoder()
    for chunk in [chunks] if isinstance(chunks, (bytes, bytearray)) else chunks:
        yield from decoder.push(bytes(chunk))


def decode_log(lines, elf=None):
    """The seconds of a unit's log, as dictionaries: from lines of text, or from the raw stream (bytes) with the firmware that made it."""
    if elf is None:
        decoded = lines.splitlines() if isinstance(lines, str) else lines
    else:
        decoder = LogDecoder(elf)
        pieces = [lines] if isinstance(lines, (bytes, bytearray)) else lines
        decoded = (line for piece in pieces for line in decoder.lines(bytes(piece)))
    for line in decoded:
        second = LogDecoder.second(line)
        if second is not None:
            yield second


def _bias(self, temp_c, ramp_c_per_min=0.0, *, std=False):
    """The bias that the unit would subtract at temperatures (C), deg/h, shape (temperatures, 3): on a soak, or where a ramp of
    ``ramp_c_per_min`` has led to them after a soak (an hour of it, or less where it would begin far outside the calibrated range). NaN
    beyond a fifth of half that range outside it. With ``std=True`` its
    standard uncertainty comes beside it, NaN where the calibration does not state it."""
    temperatures, ramps = _np.broadcast_arrays(_np.atleast_1d(temp_c), _np.atleast_1d(ramp_c_per_min))
    if temperatures.ndim != 1:
        raise HrgError("temperatures are one number or one row of them")
    bias, uncertainty = self._bias([(float(t), float(r)) for t, r in zip(temperatures, ramps)])
    bias, uncertainty = bias.reshape(-1, 3), uncertainty.reshape(-1, 3)
    return (bias, uncertainty) if std else bias


def _predict(self, recording):
    """The bias that the unit would have subtracted in each second of a recording (or a path, a frame), deg/h, shape (seconds, 3)."""
    return correct(recording, self).bias_dph


def _score(self, recording):
    """Share of the variance of the raw rates' 100 s means that this calibration removes from a recording, mean of its axes: 1 leaves
    nothing, 0 is no better than no calibration."""
    recording = _recording(recording)
    corrected = correct(recording, self)
    means = len(corrected) // 100
    if means < 2:
        raise HrgError("a score needs two means of 100 s at the least")

    there = ["xyz".index(a) for a in recording.axes]

    def variance(rates):
        each = rates[: 100 * means, there].astype(float).reshape(means, 100, len(there))
        return _np.nanvar(_np.nanmean(each, axis=1), axis=0)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # A mean of nothing is NaN.
        left = variance(corrected.corrected_dph) / variance(corrected.raw_dph)
    return float(1.0 - _np.mean(left))


# Nothing in them ever changes: a copy is the thing itself.
for _kind in (Recording, Calibration, Report, Figures):
    _kind.__copy__ = lambda self: self
    _kind.__deepcopy__ = lambda self, memo: self

Calibration.bias = _bias
Calibration.predict = _predict
Calibration.score = _score


def __dir__():
    return sorted(__all__)


def __getattr__(name):
    # (matplotlib is loaded where it is used.)
    if name == "plot":
        import importlib

        return importlib.import_module(".plot", __name__)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
