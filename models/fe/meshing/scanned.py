"""A layered finger with measured skin and bone: the surfaces that `palpate build fingertip` reads from an image stack.

Both are taken along rays from the bone's axis: square to it behind the bone's rounded tip, round the tip's centre
before it. Images show skin and bone, not the layers between. Assumed: epidermis and dermis have one thickness
everywhere, taken along the skin's normal; the rest down to the bone is subcutis; the nail lies on the upper quarter of
the skin. The inner border of the skin, which images may show, is not used.

World frame: z up from the plate, origin at the lowest node of the skin, the tip towards -y and lower by `tilt`.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from palpate.models.fe.element.mesh import MeshError
from palpate.models.fe.meshing.layers import CORE, Layers, directions
from palpate.physics.fingertip import surfaces as measured

LEAST = 0.3e-3  # [m] of subcutis that must be left everywhere
SHORT = 5e-3  # [m] of finger behind the centre of the bone's rounded tip without which no pressing makes sense
OBLIQUE = 0.5
"""Least cosine between a ray and the skin's normal with which the thickness of the layers is taken along the ray."""


@dataclass(frozen=True)
class Scanned(Layers):
    """A measured finger, meshed whole, as fingers are not symmetric.

    dermis, epidermis, nail  [m] thicknesses

    MeshError: a bone that is too near the skin, a surface that is cut by the images' rim or folds back as seen from the
    bone's axis, a bone too short to mesh.
    """

    tip: measured.FingertipSurfaces  # its surfaces; x across, y from the tip to the hand, z from the pulp to the nail
    dermis: float = 0.93e-3
    epidermis: float = 0.41e-3
    nail: float = 0.5e-3
    phalanx: float = 12e-3  # [m] length behind the centre of the bone's rounded tip, if the bone goes on that far
    tilt: float = np.deg2rad(15.0)  # [rad] between the y axis and the plate
    plate: tuple[float, float] = (20e-3, 20e-3)  # [m] half-widths of a deformable plate and its thickness
    cells: int = 6  # elements across an eighth of the circumference, 3 and more
    whole = True

    def __post_init__(self) -> None:
        self.check("scanned finger", self.dermis, self.epidermis, self.nail, self.phalanx, *self.plate)

    def describe(self) -> dict[str, Any]:
        """Its dimensions and fineness, and a digest of what was measured."""
        digest = hashlib.sha256()
        for name in measured.FIELDS:
            digest.update(np.ascontiguousarray(getattr(self.tip, name), dtype="<f8").tobytes())
        sizes = {n: getattr(self, n) for n in ("dermis", "epidermis", "nail", "phalanx", "tilt", "plate", "cells")}
        return {"measured": digest.hexdigest()[:16]} | sizes

    @cached_property
    def _axis(self) -> Axis:
        return bone_axis(self.tip, self.phalanx)

    @cached_property
    def _core(self) -> float:
        palmar = _palmar(9)
        left = palmar[:, [1, 0, 2]]
        every = [palmar, palmar * [1, -1, 1], left, left * [-1, 1, 1], _front(9)]
        return CORE * float(self._surfaces(np.concatenate(every))[0].min())

    @cached_property
    def radii(self) -> np.ndarray:
        """Outer radius of bone, subcutis, dermis and epidermis on the palmar side [m] (4,), medians."""
        bone, skin, _ = self._surfaces(0.5 * _palmar(9) + [0.0, -0.5, 0.0])
        outer = float(np.median(skin))
        inner = outer - self.epidermis - self.dermis
        return np.array([float(np.median(bone)), inner, inner + self.dermis, outer])

    def _rays(self, box: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Origins [m] and unit directions (N,3) in the finger's frame, for points of the box (N,3)."""
        y = self._axis.centre - self._axis.length * np.minimum(box[:, 2], 0.0)
        d = directions(box)
        return self._axis.at(y), np.column_stack([d[:, 0], -d[:, 2], d[:, 1]])

    def _surfaces(self, box: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Radius of bone and skin [m], and cosine between ray and skin (N,), for points of the box (N,3)."""
        origin, direction = self._rays(box)
        bone = crossing(self.tip, "bone", origin, direction)
        skin = crossing(self.tip, "skin", origin, direction)
        at = origin + skin[:, None] * direction
        steps = np.diag(self.tip.spacing)
        normal = np.stack([self.tip.level("skin", at + s) - self.tip.level("skin", at - s) for s in steps], axis=1)
        normal /= 2.0 * self.tip.spacing
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
        cosine = np.maximum(np.sum(normal * direction, axis=1), OBLIQUE)
        left = skin - (self.dermis + self.epidermis) / cosine - bone
        worst = int(np.argmin(left))
        if left[worst] < LEAST:
            raise MeshError(
                f"measured finger: {1e3 * (skin - bone)[worst]:.2f} mm between skin and bone {_where(at[worst])}; "
                f"epidermis and dermis take {1e3 * (self.dermis + self.epidermis) / cosine[worst]:.2f} of it, expected "
                f"{1e3 * LEAST:g} mm or more of subcutis below"
            )
        return bone, skin, cosine

    def place(self, points: np.ndarray) -> np.ndarray:
        """World coordinates [m] (N,3) of points of the lattice (N,4)."""
        return (self._local(points) - self._lowest) @ measured.plate_axes(self.tilt).T

    def _local(self, points: np.ndarray) -> np.ndarray:
        """The same in the frame of the measured surfaces."""
        box, spot = np.unique(np.round(points[:, :3], 12), axis=0, return_inverse=True)
        spot = spot.ravel()
        rim = (np.abs(box[:, :2]).max(axis=1) > 1.0 - 1e-9) | (box[:, 2] > 1.0 - 1e-9)
        bone, skin, cosine = np.zeros(len(box)), np.zeros(len(box)), np.ones(len(box))
        bone[rim], skin[rim], cosine[rim] = self._surfaces(box[rim])
        origin, direction = self._rays(box)
        shell = points[:, 3]
        skin, cosine = skin[spot], cosine[spot]
        levels = np.stack([
            bone[spot], skin - (self.dermis + self.epidermis) / cosine, skin - self.epidermis / cosine, skin,
            skin + self.nail / cosine,
        ])  # fmt: skip
        low = np.clip(shell.astype(np.int64), 1, 4) - 1
        every = np.arange(len(points))
        below, above = levels[low, every], levels[low + 1, every]
        radius = below + (np.maximum(shell, 1.0) - 1.0 - low) * (above - below)
        inside = np.minimum(shell, 1.0)[:, None]
        ray = np.column_stack([box[:, 0], -np.maximum(box[:, 2], 0.0), box[:, 1]])[spot]
        return origin[spot] + (1.0 - inside) * self._core * ray + inside * radius[:, None] * direction[spot]

    @cached_property
    def _lowest(self) -> np.ndarray:
        """Point of the skin that touches the plate first [m] (3)."""
        box = np.concatenate([_palmar(61), _front(61)])
        origin, direction = self._rays(box)
        skin = origin + crossing(self.tip, "skin", origin, direction)[:, None] * direction
        return skin[int(np.argmin(skin @ measured.plate_axes(self.tilt)[2]))]


@dataclass(frozen=True)
class Axis:
    """A straight line in a bone: its place at y = 0 and its slope (3); y of the rounded tip's centre, and how much of
    the finger lies behind that; metres."""

    start: np.ndarray
    slope: np.ndarray
    centre: float
    length: float

    def at(self, y: np.ndarray) -> np.ndarray:
        """Its points (N,3) at y (N,)."""
        return self.start + y[:, None] * self.slope


def bone_axis(tip: measured.FingertipSurfaces, phalanx: float) -> Axis:
    """The line through the centres of the bone's sections. The tip's centre lies as far behind the bone's end as the
    section there is wide, as in a half ball; `phalanx` [m] behind it is taken, or what there is up to the bone's other
    end or the last image. MeshError: no bone, or one that is too short."""
    h = tip.spacing
    x, y, z = (tip.origin[k] + h[k] * np.arange(tip.bone.shape[k]) for k in range(3))
    share = np.clip(0.5 - tip.bone / h.min(), 0.0, 1.0)
    area = share.sum(axis=(0, 2)) * h[0] * h[2]
    deepest = tip.bone.min(axis=(0, 2))
    if not (deepest < 0.0).any():
        raise MeshError("measured finger: no bone in it")
    first = int(np.argmax(deepest < 0.0))
    end = float(y[first])
    if first > 0:
        end -= float(h[1] * deepest[first] / (deepest[first] - deepest[first - 1]))
    ahead = y - end - np.sqrt(area / np.pi)
    ahead[:first] = -1.0
    wide = ahead >= 0.0
    k = int(np.argmax(wide))
    centre = float(y[k] - h[1] * ahead[k] / (ahead[k] - ahead[k - 1]))
    gone = np.flatnonzero(deepest[first:] >= 0.0)
    close = float(y[first + gone[0] - 1]) if len(gone) else float(y[-1])
    last = min(centre + phalanx, close)
    used = (y >= end) & (y <= last + 1e-9)
    if not wide.any() or last - centre < SHORT:
        raise MeshError(
            f"measured finger: bone from {1e3 * (end - y[0]):.1f} to {1e3 * (close - y[0]):.1f} mm of "
            f"{1e3 * (y[-1] - y[0]):.1f} mm along it; expected {1e3 * SHORT:g} mm or more of it behind its rounded tip"
        )
    middle = np.stack([(share.sum(axis=2) * x[:, None]).sum(axis=0), (share.sum(axis=0) * z).sum(axis=1)])
    middle = middle[:, used] * h[0] * h[2] / area[used]
    (ax, bx), (az, bz) = (np.polyfit(y[used], m, 1, w=np.sqrt(area[used])) for m in middle)
    return Axis(np.array([bx, 0.0, bz]), np.array([ax, 1.0, az]), centre, last - centre)


def crossing(tip: measured.FingertipSurfaces, name: str, origin: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Where rays [m] (N,3), (N,3) leave a surface: the way along them [m] (N,). MeshError: a ray that begins outside,
    does not leave, or comes back."""
    size = (np.array(tip.skin.shape) - 1) * tip.spacing
    step = 0.5 * float(tip.spacing.min())
    way = np.arange(0.0, float(np.hypot(size[0], size[2])), step)
    level = tip.level(name, origin[:, None, :] + way[:, None] * direction[:, None, :])
    inside = level < 0.0
    first = np.argmin(inside, axis=1)
    turns = np.count_nonzero(inside[:, 1:] != inside[:, :-1], axis=1)
    for wrong, text in (
        (~inside[:, 0], "the bone's axis lies outside it"),
        (inside.all(axis=1), "it does not end within the images"),
        (turns > 1, "it folds back as seen from the bone's axis"),
    ):
        if wrong.any():
            raise MeshError(f"measured finger, {name} {_where(origin[np.argmax(wrong)])}: {text}")
    rows = np.arange(len(origin))
    a, b = level[rows, first - 1], level[rows, first]
    return way[first - 1] + step * a / (a - b)


def _palmar(count: int) -> np.ndarray:
    across, along = np.meshgrid(np.linspace(-1, 1, count), np.linspace(-1, 1, count), indexing="ij")
    return np.column_stack([across.ravel(), np.full(count * count, -1.0), along.ravel()])


def _front(count: int) -> np.ndarray:
    return _palmar(count)[:, [0, 2, 1]] * [1.0, 1.0, -1.0]


def _where(at: np.ndarray) -> str:
    return f"at ({', '.join(f'{1e3 * x:.1f}' for x in at)}) mm (across, from the tip, up)"
