"""Many units at once on a Dask scheduler: the table and the page of ``hrg fleet``, made by as many machines as there are.

Each unit is one task. The worker that takes it reads the unit's files, so the folder must be at the same place on all of them; the rows come back, and
are kept as they come: a run that was stopped goes on with the units that are left. A file that cannot be read is a row with its reason.

    >>> import hrg.fleet                                          # doctest: +SKIP
    >>> hrg.fleet.run("units", "out/fleet")                       # all cores of this machine        # doctest: +SKIP
    >>> hrg.fleet.run("units", "out/fleet", scheduler="tcp://10.0.0.5:8786")                         # doctest: +SKIP

It needs ``pip install "hrg[fleet]"``. Nothing leaves the machines of the scheduler.
"""

from __future__ import annotations

import json
import os
from typing import Any

from . import _hrg

__all__ = ["run"]


def _row(unit: str, family: str | None, limit: list[float] | None) -> str:
    return _hrg.fleet_row(unit, family, limit)


def run(
    folder: str | os.PathLike[str],
    out: str | os.PathLike[str],
    *,
    scheduler: str | Any | None = None,
    workers: int | None = None,
    family: str | os.PathLike[str] | None = None,
    limit: tuple[float, float, float] | None = None,
    title: str | None = None,
) -> list[dict[str, Any]]:
    """Table (``fleet.parquet``), page (``fleet.html``) and rows of the units of a folder.

    `scheduler`: the address of a Dask scheduler, or a ``distributed.Client``; else a cluster of processes on this machine, with `workers` of them (default:
    one for each core). `family`: a file of ``hrg family``. `limit`: largest error that passes (deg/h), lowest and highest temperature (C).
    """
    from distributed import Client, LocalCluster, as_completed

    folder, out = os.path.abspath(folder), os.path.abspath(out)
    family = None if family is None else os.path.abspath(family)
    wanted = None if limit is None else [float(v) for v in limit]
    units = _hrg.fleet_units(folder, out, family, wanted)
    rows = {unit: _hrg.fleet_kept(out, unit, family, wanted) for unit in units}
    left = [unit for unit, row in rows.items() if row is None]
    if left:
        cluster = client = None
        if scheduler is None:
            most = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
            cluster = LocalCluster(
                n_workers=min(workers or most, len(left)), threads_per_worker=1, processes=True, dashboard_address=None
            )
            client = Client(cluster)
        elif isinstance(scheduler, str):
            client = Client(scheduler)
        used = scheduler if client is None else client
        try:
            _spread(used, as_completed, left, family, wanted, out, rows)
        finally:
            if client is not None:
                client.close()
            if cluster is not None:
                cluster.close()
    _hrg.fleet_write(out, title or f"Fleet {os.path.basename(folder)}", [rows[unit] for unit in units])
    return [json.loads(rows[unit]) for unit in units]


def _spread(client, as_completed, left, family, wanted, out, rows) -> None:
    """Keeps twice as many units under way as there are workers: what waits is in no memory."""
    workers = max(1, len(client.scheduler_info()["workers"]))
    waiting = iter(left)

    def submit():
        unit = next(waiting, None)
        if unit is None:
            return None
        future = client.submit(_row, unit, family, wanted, pure=False, retries=2)
        of[future.key] = unit
        return future

    of: dict[str, str] = {}
    first = [f for f in (submit() for _ in range(2 * workers)) if f is not None]
    completed = as_completed(first)
    for future in completed:
        unit = of.pop(future.key)
        rows[unit] = future.result()
        _hrg.fleet_keep(out, unit, rows[unit], family, wanted)
        more = submit()
        if more is not None:
            completed.add(more)
