"""The points of a `Study` as an xarray Dataset."""

from typing import Any

import numpy as np

from palpate.physics.errors import RunError
from palpate.physics.extras import require_extra
from palpate.studies.sweeps.store import Store


def dataset(study: Any) -> Any:
    """Numbers and curves over the axes of a study. RunError: xarray is missing."""
    with require_extra("xarray()", "study", RunError):
        import xarray
    space, rows = study.space, study.rows()
    dims = (*(one.paths[0] for one in space.crossed), *(("sample",) if space.sampled else ()))
    along = {path: one.paths[0] for one in space.crossed for path in one.paths}
    coords: dict[str, Any] = {
        path: (along.get(path, "sample"), values, {"units": study.units[path]} if path in study.units else {})
        for path, values in space.columns("labels").items()
    }
    data: dict[str, Any] = {
        kept.text: (dims, np.reshape([row.get(kept.text, np.nan) for row in rows], space.shape), {"units": kept.unit})
        for kept in study.numbers
    }
    data["error"] = (dims, np.reshape(np.array([row["error"] for row in rows], dtype=object), space.shape), {})
    slots = [row.get("slot") if not row["error"] else None for row in rows]
    store, clocks = Store(study.home(), write=False), list[np.ndarray]()
    for curve in study.curves:
        if all(slot is None for slot in slots):
            continue
        times, values = (store.curves(name, slots) for name in (f"{curve.text} time", curve.text))
        used = np.isfinite(times).any(axis=0)  # other studies in the folder may have longer curves
        times, values = times[:, used], values[:, used]
        time, clock = _clock(times, clocks)
        if time not in coords:
            coords[time] = (time if clock.ndim == 1 else (*dims, f"tick{time[4:]}"),
                            clock if clock.ndim == 1 else clock.reshape(*space.shape, -1), {"units": "s"})  # fmt: skip
        last = time if clock.ndim == 1 else f"tick{time[4:]}"
        data[curve.text] = ((*dims, last), values.reshape(*space.shape, -1), {"units": curve.unit})
    return xarray.Dataset(data, coords, {"graph": study.name})


def _clock(times: np.ndarray, clocks: list[np.ndarray]) -> tuple[str, np.ndarray]:
    """Name and values of the time coordinate of a curve. The first is `time`; curves with equal times share one."""
    whole = times[np.isfinite(times).all(axis=1)]
    same = len(whole) == np.isfinite(times).any(axis=1).sum() and (whole == whole[:1]).all()
    clock = whole[0] if same and len(whole) else times
    number = next((k for k, known in enumerate(clocks) if np.array_equal(known, clock, equal_nan=True)), len(clocks))
    if number == len(clocks):
        clocks.append(clock)
    return f"time{'' if number == 0 else f'_{number + 1}'}", clock
