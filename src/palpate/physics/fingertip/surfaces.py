"""A fingertip as three nested surfaces (skin, inner border of the skin, bone), and its filling with beams.

Each surface is the zero level of a signed distance, negative inside, on a common regular grid. x runs across the
finger, y from the tip to the hand, z from the pulp to the nail. The nail, which is not visible in MR images, is the
dorsal part of the outer surface. It is rigid, and beams end there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy  # loads its submodules when they are used

from palpate.compiler.exact import cos, einsum, power, product, sin
from palpate.physics.archive import read_arrays, replacing
from palpate.physics.arrays import Numbers
from palpate.physics.errors import MISUSE, PalpateError
from palpate.physics.fingertip.beam_bundle import Bundle, bundle, check_count
from palpate.physics.materials.voigt import BONE, SKIN, TISSUE, ViscoelasticMaterial

MATERIALS = (SKIN, TISSUE, BONE, TISSUE)  # From the plate upwards: skin, pulp, bone, tissue between bone and nail


class FingertipError(PalpateError, ValueError):
    """A fingertip that cannot be read or filled; states what was found and what would work."""

    exit_code = MISUSE


@dataclass(frozen=True)
class FingertipSurfaces:
    """Signed distances [m] (nx, ny, nz) to the three surfaces, at origin + index * spacing [m] (3)."""

    origin: np.ndarray
    spacing: np.ndarray
    skin: np.ndarray
    tissue: np.ndarray
    bone: np.ndarray

    @property
    def corners(self) -> np.ndarray:
        """Corners of the grid [m] (8,3)."""
        size = (np.array(self.skin.shape) - 1) * self.spacing
        return self.origin + np.stack(np.meshgrid(*[(0, 1)] * 3, indexing="ij"), -1).reshape(-1, 3) * size

    def level(self, name: str, points: Numbers) -> np.ndarray:
        """Signed distance [m] (...) to the surface "skin", "tissue" or "bone" at points [m] (..., 3)."""
        place = np.moveaxis((np.asarray(points, float) - self.origin) / self.spacing, -1, 0)
        return scipy.ndimage.map_coordinates(getattr(self, name), place, order=1, mode="nearest")

    def volume(self, name: str) -> float:
        """Volume inside a surface [m³]; the signed distance gives the fraction of each cell that is inside."""
        h = float(power(np.prod(self.spacing), 1.0 / 3.0))
        return float(np.clip(0.5 - getattr(self, name) / h, 0, 1).sum() * np.prod(self.spacing))

    def save(self, path: str | Path) -> None:
        """Write an .npz file that `load` reads."""
        path = Path(path)
        with replacing(path if path.suffix == ".npz" else path.with_name(f"{path.name}.npz")) as part:
            np.savez_compressed(part, **{k: getattr(self, k) for k in FIELDS})

    @staticmethod
    def load(path: str | Path) -> FingertipSurfaces:
        """Read a file of `save`. FingertipError: a missing file, or not a fingertip."""
        try:
            archive = read_arrays(path)
            missing = [k for k in FIELDS if k not in archive]
            if missing:
                raise FingertipError(f"{path}: no {', '.join(missing)} in it; write it with `palpate build fingertip`")
            tip = FingertipSurfaces(*(np.asarray(archive[k], float) for k in FIELDS))
        except FingertipError:
            raise
        except (ValueError, TypeError) as error:
            raise FingertipError(f"{path}: cannot be read as a fingertip (.npz): {error}") from None
        shapes = {getattr(tip, k).shape for k in ("skin", "tissue", "bone")}
        if len(shapes) != 1 or tip.skin.ndim != 3 or tip.origin.shape != (3,) or tip.spacing.shape != (3,):
            raise FingertipError(f"{path}: grids of shape {shapes}, expected three of equal shape with three axes")
        if not all(np.isfinite(getattr(tip, k)).all() for k in FIELDS) or np.any(tip.spacing <= 0):
            raise FingertipError(f"{path}: expected finite distances and spacing > 0")
        return tip


FIELDS = ("origin", "spacing", "skin", "tissue", "bone")


@dataclass(frozen=True)
class Rays:
    """Intersections [m] (...) of lines along the plate's normal with the surfaces, in the plate's frame; nan if a line
    misses."""

    bottom: np.ndarray  # outer surface
    inner: np.ndarray  # lower inner border of the skin
    low: np.ndarray  # lower border of the bone
    high: np.ndarray  # upper border of the bone
    top: np.ndarray  # outer surface


def plate_axes(angle: float) -> np.ndarray:
    """Axes of the plate in the frame of the finger, as rows (3,3): x across, y along, z out of the plate.

    angle  [rad]  inclination; 0: the finger is flat on the plate, pi/2: perpendicular to it
    """
    c, s = float(cos(angle)), float(sin(angle))
    return np.array([[1.0, 0, 0], [0, c, -s], [0, s, c]])


def cast(tip: FingertipSurfaces, x: Numbers, y: Numbers, angle: float = 0.0) -> Rays:
    """Intersect the fingertip with lines along the plate's normal through (x, y) [m] (...) of the plate's frame.

    A line is sampled at half the grid's spacing; crossings are the zeros of the linearly interpolated distance. The
    lowest one is the lower border, the highest one the upper border.
    """
    axes = plate_axes(angle)
    heights = product(tip.corners, axes[2])
    z = np.arange(heights.min(), heights.max(), tip.spacing.min() / 2)
    x, y = np.broadcast_arrays(np.asarray(x, float), np.asarray(y, float))
    plane = x[..., None] * axes[0] + y[..., None] * axes[1]
    points = plane[..., None, :] + z[:, None] * axes[2]

    def borders(name: str) -> tuple[np.ndarray, np.ndarray]:
        level = tip.level(name, points)
        inside = level < 0
        first = np.argmax(inside, axis=-1)
        last = inside.shape[-1] - 1 - np.argmax(inside[..., ::-1], axis=-1)
        hit = inside.any(axis=-1)

        def crossing(k: np.ndarray, away: int) -> np.ndarray:
            k = np.clip(k, 0 if away > 0 else 1, len(z) - (2 if away > 0 else 1))
            a = np.take_along_axis(level, k[..., None], -1)[..., 0]
            b = np.take_along_axis(level, (k + away)[..., None], -1)[..., 0]
            part = np.where((a < 0) & (b > 0), a / np.where(a == b, 1, a - b), 0)
            return np.where(hit, z[k] + away * part * (z[1] - z[0]), np.nan)

        return crossing(first, -1), crossing(last, 1)

    bottom, top = borders("skin")
    inner, _ = borders("tissue")
    low, high = borders("bone")
    return Rays(bottom, inner, low, high, top)


def fill(
    tip: FingertipSurfaces,
    depth: float,
    pitch: float = 1.2e-3,
    angle: float = 0.0,
    materials: tuple[ViscoelasticMaterial, ...] = MATERIALS,
    lateral: str = "shear",
    skin: float = 1e-3,
    skin_material: ViscoelasticMaterial = SKIN,
) -> Bundle:
    """Fill a fingertip with beams between plate and nail, wherever it is in contact at the largest depth.

    A beam that meets the bone consists of skin and pulp up to the bone, bone, and tissue up to the nail; any other runs
    from skin to nail. Only the part below the bone is soft in shear. One beam is at the lowest point.

    depth  [m]    largest depth for which the bundle is used
    pitch  [m]    of the beams     angle [rad] inclination of the finger, 0 ... pi/2
    skin   [m]    thickness of the sheet that couples the beams' ends; 0: none
    other arguments as `bundle`

    FingertipError: no contact, a finger thinner than the depth. ValueError: more beams than a bundle may have.
    """
    if not (depth > 0 and pitch > 0 and math.isfinite(depth + pitch)):
        raise FingertipError(f"fill: found depth {depth} m and pitch {pitch} m, expected both > 0")
    # the grid of beams round the lowest point
    (low_x, low_y, middle), reach = lowest(tip, angle, depth)
    first, last = np.floor((reach[0] - (low_x, low_y)) / pitch), np.ceil((reach[1] - (low_x, low_y)) / pitch)
    check_count(float(np.prod(last - first + 1)))
    steps = (np.arange(a, b + 1, dtype=np.int64) for a, b in zip(first, last, strict=True))
    index = np.stack(np.meshgrid(*steps, indexing="ij"), -1).reshape(-1, 2)
    x, y = low_x + index[:, 0] * pitch, low_y + index[:, 1] * pitch
    # beams that are in contact at the depth
    rays = cast(tip, x, y, angle)
    height = rays.bottom - middle
    touches = np.isfinite(height) & (height < depth)
    index = index[touches]
    if len(index) == 0:
        raise FingertipError("fill: the surface has no inside; expected distances below 0 in the finger")
    # lengths of skin, pulp, bone, and tissue between bone and nail
    bottom, inner, low, high, top = (getattr(rays, k)[touches] for k in ("bottom", "inner", "low", "high", "top"))
    inner = np.where(np.isfinite(inner), np.clip(inner, bottom, top), top)
    boned = np.isfinite(low) & (low > inner)
    low, high = np.where(boned, low, top), np.where(boned, np.clip(high, low, top), top)
    lengths = np.stack([inner - bottom, low - inner, high - low, top - high], axis=1)
    if np.any(top - bottom <= depth):
        thin = int(np.argmin(top - bottom))
        raise FingertipError(
            f"fill: {float((top - bottom)[thin]) * 1e3:.2f} mm between skin and nail at {pitch * 1e3 * index[thin]}, "
            f"expected more than the depth of {depth * 1e3:.2f} mm. Decrease the depth or the angle."
        )
    return bundle(index, pitch, height[touches], lengths, materials, lateral, 2, skin, skin_material)


def lowest(tip: FingertipSurfaces, angle: float, depth: float) -> tuple[np.ndarray, np.ndarray]:
    """The lowest point [m] (3) of the skin over the plate, within 10 % of the grid's spacing, and a box [m] (2,2) in
    the plate's plane round all points less than `depth` above it, by successive grid refinement."""
    plane = einsum("ik,jk->ij", tip.corners, plate_axes(angle)[:2])
    low, high = plane.min(axis=0), plane.max(axis=0)
    step = float(tip.spacing.max())
    box = np.zeros((0, 2))
    best = np.zeros(3)
    for _ in range(3):
        x, y = np.meshgrid(*(np.arange(a, b + step / 2, step) for a, b in zip(low, high, strict=True)), indexing="ij")
        bottom = cast(tip, x, y, angle).bottom
        if not np.isfinite(bottom).any():
            raise FingertipError("fill: the surface has no inside; expected distances below 0 in the finger")
        k = np.unravel_index(np.nanargmin(bottom), bottom.shape)
        best = np.array([x[k], y[k], bottom[k]])
        if not len(box):
            near = bottom < best[2] + depth
            box = np.array([[x[near].min(), y[near].min()], [x[near].max(), y[near].max()]]) + [[-step], [step]]
        low, high, step = best[:2] - step, best[:2] + step, step / 4
    return best, box
