"""Thermal calibration of hemispherical resonator gyros, by the code that the unit itself runs.

Every function is the library ``hrg-cal`` itself: a fit from here and one by the command ``hrg fit`` are the same image, and
:func:`correct` gives what a unit would send, to the last bit.

Rates are in deg/h, temperatures in degrees Celsius, frequencies in Hz, times in s. What cannot be used raises
:class:`HrgError` with one sentence.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as _np

from ._hrg import (
    Calibration,
    Corrected,
    HrgError,
    LinkDecoder,
    LogDecoder,
    Recording,
    Report,
    __version__,
    align,
    allan,
    correct,
    effects,
    fit,
    import_table,
    methods,
    points,
    simulate,
    trace as _trace,
)

__all__ = [
    "Calibration",
    "Corrected",
    "HrgError",
    "LinkDecoder",
    "LogDecoder",
    "Recording",
    "Report",
    "__version__",
    "align",
    "allan",
    "correct",
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


def trace(train, verify, **options):
    """Finds what the baseline model lacks: learns from ``train`` (one recording or several), judges on ``verify``.

    Options: ``in_use`` (the calibration that a new one must beat), ``different_units``, ``jobs`` (processors), ``progress`` (called
    with the number of models tried so far). Ctrl-C stops it.
    """
    return _trace([train] if isinstance(train, Recording) else list(train), verify, **options)


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
