"""Thermal calibration of hemispherical resonator gyros, by the code that the unit itself runs.

Every function is the desktop library itself: a fit from here and one by the command ``hrg fit`` are the same image, and
:func:`correct` gives what a unit would send, to the last bit.

Rates are in deg/h, temperatures in degrees Celsius, frequencies in Hz, times in s. What cannot be used raises
:class:`HrgError` with one sentence.
"""

from __future__ import annotations

import dataclasses
import tempfile
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
    allan,
    compare as _compare,
    correct,
    data_sheet as _data_sheet,
    effects,
    fit as _fit,
    identify_accelerometers as accelerometers,
    import_table,
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
    "methods",
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
    return {name: given.get(name) for name in _SAID}


def read(source, **said):
    """Reads a recording: a path (CSV or Parquet, packed by gzip or not), or an open file, text or binary.

    ``unit``, ``latitude_deg`` with ``axes``, and ``scale_factor_dph_per_code`` (three numbers) say what the recording does not.
    Rows that cannot be used are taken out of what fits take; :attr:`Recording.notes` says which.
    """
    return Recording._read(source, _said(said))


def from_table(table, meta=None, **said):
    """Makes a recording of columns in memory: a mapping of names to arrays, a pandas or a polars frame.

    Names are those of a recording's columns: ``time_s`` (s), ``rate_x_dph`` (deg/h), ``fx_hz`` (Hz) or ``temp_x_c`` (C), and
    so on; each is one-dimensional, all are of one length, NaN where a value is missing. ``meta``: metadata; a pandas frame's
    ``attrs`` are taken as well.
    """
    names = list(table.keys()) if isinstance(table, Mapping) else list(table.columns)
    columns = [(str(n), _np.ascontiguousarray(_np.asarray(table[n]), dtype=_np.float64)) for n in names]
    entries = {**getattr(table, "attrs", {}), **(meta or {})}
    return Recording._of_columns(columns, [(str(k), str(v)) for k, v in entries.items()], _said(said))


def to_pandas(recording):
    """The recording as a pandas frame: a column each, metadata in ``attrs``."""
    import pandas

    frame = pandas.DataFrame(recording.to_dict())
    frame.attrs = dict(recording.meta)
    return frame


def fit(recordings, method="lsq", **options):
    """Coefficients of a bias model from one recording or several, by a method of :func:`methods`.

    Options: ``seed`` (of methods that draw), ``uniform``, ``breakpoint_c``, ``curve`` (a calibration of temperatures), ``different_units``,
    ``progress``. Gives a :class:`Calibration`.
    """
    return _fit(_several(recordings), method, **options)


def trace(train, verify, **options):
    """Finds what the baseline model lacks: learns from ``train`` (one recording or several), judges on ``verify``.

    Options: ``in_use`` (the calibration that a new one must beat), ``judge`` (a third recording, which chooses nothing and judges alone),
    ``exchange`` (search on ``verify``, too: advice), ``repeat_is_enough`` (recommend a burn also where ``verify`` only repeats the profile of
    ``train``), ``different_units``, ``jobs`` (accepted and not used: a trace takes one processor), ``progress`` (called
    with the number of models tried so far), ``own_effects`` (effects that you have written, :class:`OwnEffect`). Ctrl-C stops it.
    """
    return _trace(_several(train), verify, **options)


def _several(recordings):
    return [recordings] if isinstance(recordings, Recording) else list(recordings)


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


def compare(train, verify, *, out=None, **options):
    """Every method on the same data: learns from ``train``, judges on ``verify`` (one recording or several each).

    Options: ``methods`` (names of :func:`methods`, and ``trace``; all by default), ``seed``, ``from_s`` (judged from this time of each run
    on, s), ``different_units``, ``progress``. ``out``: a folder for the calibrations, one a method. Ctrl-C stops it.
    Gives :class:`Figures` whose ``rows`` hold a method each, and whose ``calibrations`` are what was fitted.
    """
    if out is not None:
        return _compare(_several(train), _several(verify), out, **options)
    with tempfile.TemporaryDirectory(prefix="hrg-compare-") as folder:
        return _compare(_several(train), _several(verify), folder, **options)


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
