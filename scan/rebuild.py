"""From outlines to surfaces: interpolation of shapes between slices, and the frame of the fingertip.

Between slices the signed distance to the outline is interpolated, not the outline itself (shape-based interpolation,
Raya & Udupa 1990), so that no points need to be paired. Beyond the last outline a surface closes as an ellipsoid does:
its inscribed radius falls with the root of the way to the tip, which the last two outlines tell.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from scipy.interpolate import PchipInterpolator

from palpate.physics.fingertip import Fingertip
from palpate.scan.outline import Outlines, distance, enclosed
from palpate.scan.read import ScanError

MARGIN = 1.5e-3
"""[m] Of air round the finger."""


def rebuild(outlines: Outlines, grid: float = 4e-4, dorsal: Literal["auto", "up", "down"] = "auto") -> Fingertip:
    """The surfaces of a finger from its outlines.

    grid    [m] spacing of the distances
    dorsal  where the nail is in the images; "auto": on the side of the finger on which the bone lies

    The frame: x and z from the centre of the images, y from the first slice at the tip.
    ScanError: neither end of the stack is a tip, or the side of the nail cannot be told.
    """
    areas = [enclosed(curve) for curve in outlines.skin if curve is not None]
    areas = [areas[0], areas[-1]]
    order = range(len(outlines.skin)) if areas[0] <= areas[1] else range(len(outlines.skin) - 1, -1, -1)
    if min(areas) > 0.8 * max(areas):
        raise ScanError("neither end of the stack narrows to a fingertip; expected slices from the tip on")
    up = _dorsal_up(outlines, dorsal)
    curves = {name: [_turned(getattr(outlines, name)[k], up) for k in order] for name in ("skin", "tissue", "bone")}
    every = np.concatenate([c for c in curves["skin"] if c is not None])
    low, high = every.min(axis=0) - MARGIN, every.max(axis=0) + MARGIN
    x = np.arange(low[0], high[0] + grid, grid)
    z = np.arange(low[1], high[1] + grid, grid)
    first = next(k for k, c in enumerate(curves["skin"]) if c is not None)
    y = np.arange((first - 1) * outlines.spacing - MARGIN, (len(order) - 1) * outlines.spacing, grid)
    plane = np.stack(np.meshgrid(x, z, indexing="ij"), -1).reshape(-1, 2)
    levels = [
        _between(curves[name], outlines.spacing, plane, y).reshape(len(y), len(x), len(z)).transpose(1, 0, 2)
        for name in ("skin", "tissue", "bone")
    ]
    levels[1] = np.maximum(levels[1], levels[0])
    levels[2] = np.maximum(levels[2], levels[0])
    return Fingertip(np.array([x[0], y[0], z[0]]), np.full(3, grid), *map(np.ascontiguousarray, levels))


def _dorsal_up(outlines: Outlines, dorsal: str) -> bool:
    if dorsal != "auto":
        return dorsal == "up"
    both = [(s.mean(axis=0), b.mean(axis=0)) for s, b in zip(outlines.skin, outlines.bone, strict=True)
            if s is not None and b is not None]  # fmt: skip
    rows = float(np.mean([b[0] - s[0] for s, b in both]))
    if abs(rows) < 1e-4:
        raise ScanError("the bone lies midway between nail and pulp; say where the nail is (--dorsal up or down)")
    return rows < 0


def _turned(curve: np.ndarray | None, up: bool) -> np.ndarray | None:
    """(row, column) of an image as (x, z) of the finger; half a turn where the nail is below."""
    if curve is None:
        return None
    return np.stack([curve[:, 1], -curve[:, 0]], axis=1) * (1 if up else -1)


def _between(curves: list[np.ndarray | None], spacing: float, plane: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Signed distance (y, n) at heights y [m] from outlines at multiples of the spacing."""
    seen = [k for k, curve in enumerate(curves) if curve is not None]
    known = [distance(curve, plane) for curve in curves if curve is not None]
    places = [k * spacing for k in seen]
    head = _cap(known[0], known[1], spacing)
    knots = [(places[0] - s, level) for s, level in reversed(head)] + list(zip(places, known, strict=True))
    if seen[-1] < len(curves) - 1:
        tail = _cap(known[-1], known[-2], spacing)
        knots += [(places[-1] + s, level) for s, level in tail]
    at, levels = np.array([k[0] for k in knots]), np.stack([k[1] for k in knots])
    found = PchipInterpolator(at, levels, axis=0)(np.clip(y, at[0], at[-1]))
    beyond = np.maximum(at[0] - y, 0) + np.maximum(y - at[-1], 0)
    return found + beyond[:, None]


def _cap(last: np.ndarray, before: np.ndarray, spacing: float) -> list[tuple[float, np.ndarray]]:
    """Ways beyond the last outline and the signed distances there, up to the tip."""
    r, inner = -last.min(), -before.min()
    rest = spacing * np.clip(r**2 / max(inner**2 - r**2, 1e-12), 0.1, 1.0)
    return [(rest * (1 - t), last + r * (1 - np.sqrt(t))) for t in (0.75, 0.5, 0.25, 0.06, 0.0)]
