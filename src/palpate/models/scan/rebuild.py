"""Surfaces from outlines: shape-based interpolation between slices, the frame of the fingertip, and its dimensions.

Between slices the signed distance to the outline is interpolated (shape-based interpolation, Raya & Udupa 1990), which
needs no correspondence of points. Beyond the last outline a surface closes as an ellipsoid: its inscribed radius falls
with the square root of the distance to the tip, extrapolated from the last two outlines.

The surfaces are computed in the frame of the images, then rotated to the axes of the finger (`align`).
"""

import math
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import PchipInterpolator

from palpate.models.scan.align import FingerFrame, find_frame, turn_surfaces
from palpate.models.scan.outline import Outlines, distance, enclosed_area
from palpate.models.scan.stack import ScanError, Stack
from palpate.physics.fingertip.surfaces import FingertipSurfaces, cast, fill

MARGIN = 1.5e-3  # [m] margin of air around the finger


class Rebuilt(NamedTuple):
    """A fingertip, and its frame in that of the images: column, slice from the tip on, upwards.

    The frame is right-handed: columns count from the other side if the tip is in the last slice.
    """

    tip: FingertipSurfaces
    frame: FingerFrame


def rebuild(outlines: Outlines, grid: float = 4e-4) -> FingertipSurfaces:
    """`reconstruct` without the frame."""
    return reconstruct(outlines, grid).tip


def reconstruct(outlines: Outlines, grid: float = 4e-4) -> Rebuilt:
    """The surfaces of a finger from its outlines, and its frame in the images.

    grid  [m] spacing of the distances

    The frame: y is the axis of the bone, from the tip of the skin; x the broad direction of the finger; z to the nail.
    ScanError: neither end of the stack is a tip, or the side of the nail is ambiguous.
    """
    # outlines in order from the tip, and the grid
    last = _tip_is_last(outlines)
    side = -1 if last else 1
    order = range(len(outlines.skin) - 1, -1, -1) if last else range(len(outlines.skin))
    curves = {
        name: [_place_curve(getattr(outlines, name)[k], side) for k in order] for name in ("skin", "tissue", "bone")
    }
    every = np.concatenate([c for c in curves["skin"] if c is not None])
    low, high = every.min(axis=0) - MARGIN, every.max(axis=0) + MARGIN
    x = np.arange(low[0], high[0] + grid, grid)
    z = np.arange(low[1], high[1] + grid, grid)
    first = next(k for k, c in enumerate(curves["skin"]) if c is not None)
    y = np.arange((first - 1) * outlines.spacing - MARGIN, (len(order) - 1) * outlines.spacing, grid)
    plane = np.stack(np.meshgrid(x, z, indexing="ij"), -1).reshape(-1, 2)
    # signed distances, then the finger's frame
    levels = [
        _between(curves[name], outlines.spacing, plane, y).reshape(len(y), len(x), len(z)).transpose(1, 0, 2)
        for name in ("skin", "tissue", "bone")
    ]
    levels[1] = np.maximum(levels[1], levels[0])
    levels[2] = np.maximum(levels[2], levels[0])
    lying = FingertipSurfaces(np.array([x[0], y[0], z[0]]), np.full(3, grid), *map(np.ascontiguousarray, levels))
    frame = find_frame(lying, _nail(outlines.axes, side))
    return Rebuilt(turn_surfaces(lying, frame, MARGIN), frame)


def _tip_is_last(outlines: Outlines) -> bool:
    areas = [enclosed_area(curve) for curve in outlines.skin if curve is not None]
    if min(areas[0], areas[-1]) > 0.8 * max(areas[0], areas[-1]):
        raise ScanError("neither end of the stack narrows to a fingertip; expected slices from the tip on")
    last = areas[0] > areas[-1]
    if outlines.axes and (outlines.axes[0] == "T") != last:
        raise ScanError("--axes: its letters put the tip at the end of the stack where the finger is broader")
    return last


def _nail(axes: str, side: int) -> np.ndarray | None:
    """Direction of the nail (3) in the frame of the images; None: not given."""
    if not axes:
        return None
    along, letter = next((k, a) for k, a in enumerate(axes[1:]) if a in "NP")
    sign = 1.0 if letter == "N" else -1.0
    # Rows count downwards, columns to the right.
    return np.array([0.0, 0.0, -sign]) if along == 0 else np.array([side * sign, 0.0, 0.0])


def _place_curve(curve: np.ndarray | None, side: int) -> np.ndarray | None:
    """(row, column) of an image as (across, up); seen from behind if the order of the slices is reversed."""
    return None if curve is None else np.stack([side * curve[:, 1], -curve[:, 0]], axis=1)


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
    signed_distance = PchipInterpolator(at, levels, axis=0)(np.clip(y, at[0], at[-1]))
    beyond = np.maximum(at[0] - y, 0) + np.maximum(y - at[-1], 0)
    return signed_distance + beyond[:, None]


def _cap(last: np.ndarray, before: np.ndarray, spacing: float) -> list[tuple[float, np.ndarray]]:
    """(distance beyond the last outline, signed distances there) of the ellipsoidal cap up to the tip."""
    r, inner = -last.min(), -before.min()
    rest = spacing * np.clip(r**2 / max(inner**2 - r**2, 1e-12), 0.1, 1.0)
    return [(rest * (1 - t), last + r * (1 - np.sqrt(t))) for t in (0.75, 0.5, 0.25, 0.06, 0.0)]


def measures(tip: FingertipSurfaces, depth: float = 2e-3, pitch: float = 1.2e-3) -> dict[str, float]:
    """Sizes [mm], volumes [mm³], and the number of beams in contact with a plate at a depth [m]."""
    inside = np.argwhere(tip.skin < 0)
    size = (np.ptp(inside, axis=0) + 1) * tip.spacing * 1e3
    x, y = np.meshgrid(*(tip.origin[k] + tip.spacing[k] * np.arange(tip.skin.shape[k]) for k in (0, 1)))
    rays = cast(tip, x, y)
    return {
        "breadth_mm": float(size[0]),
        "length_mm": float(size[1]),
        "depth_mm": float(size[2]),
        "skin_mm": float(np.nanmedian(rays.inner - rays.bottom) * 1e3),
        "soft_volume_mm3": (tip.volume("skin") - tip.volume("bone")) * 1e9,
        "bone_volume_mm3": tip.volume("bone") * 1e9,
        "beams": len(fill(tip, depth, pitch).heights),
    }


def of_images(stack: Stack, frame: FingerFrame) -> dict[str, Any]:
    """Number and spacing of the slices, orientation of the finger, and source of the handedness."""
    return {
        "slices": len(stack.volume),
        "spacing_mm": [s * 1e3 for s in stack.spacing],
        "tilt_deg": math.degrees(frame.tilt),
        "roll_deg": math.degrees(frame.roll),
        "left_and_right": {"header": "by the header", "stated": "as stated"}.get(
            stack.handed, "unknown: each slice is assumed to lie behind the previous one (--axes)"
        ),
    }
