"""Receptors of a fingertip: their places, and the interpolation of the stress at each."""

import csv
import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from palpate.compiler.kernel import ieee_kernel, kernel
from palpate.physics.afferents.published import FITS, TYPES
from palpate.physics.arrays import Array, Indices, Matrix
from palpate.physics.contact.subsurface import energy_stress
from palpate.physics.readable import MOST_TEXT, check_file

NO_GRID, OUTSIDE = 1, 2  # Results of `place`: the points are not a grid; a receptor is outside of it
MOST = 20_000  # Receptors


class Population(NamedTuple):
    """Receptors, sorted by type."""

    kind: np.ndarray  # (n) index in `TYPES`
    at: np.ndarray  # [m] (n,3) position relative to the centre of the patch, and depth
    fits: np.ndarray  # (n,12) parameters of a measured fibre
    keys: np.ndarray  # (n) of their noise


def scatter(
    densities: tuple[float, ...],
    reach: float,
    depths: tuple[float, ...],
    seed: int,
    trial: int = 0,
    fits: tuple[np.ndarray, ...] = FITS,
) -> Population:
    """Independent, uniformly distributed receptors with these densities [1/m²] of each type on a disc of radius `reach`
    [m]."""
    numbers = np.random.default_rng(seed)
    kind: list[int] = []
    places = []
    for which, density in enumerate(densities):
        count = round(density * math.pi * reach * reach)
        if count > MOST:
            raise ValueError(f"{TYPES[which]}: found {count} receptors, expected at most {MOST}")
        found = np.zeros((0, 2))
        while len(found) < count:
            more = 2.0 * numbers.random((2 * count, 2)) - 1.0
            found = np.concatenate([found, more[(more * more).sum(axis=1) <= 1.0]])
        places.append(np.column_stack([reach * found[:count], np.full(count, depths[which])]))
        kind += [which] * count
    return _population(np.array(kind, np.int32), np.concatenate(places), seed, trial, fits)


def read(
    path: Path, depths: tuple[float, ...], seed: int, trial: int = 0, fits: tuple[np.ndarray, ...] = FITS
) -> Population:
    """Receptors from a CSV file with columns type, x, y and optionally depth, in m. ValueError, OSError: invalid."""
    kind: list[int] = []
    at: list[list[float]] = []
    check_file(path, MOST_TEXT)
    with path.open(newline="", encoding="utf-8") as file:
        for number, line in enumerate(csv.DictReader(file), 2):
            try:
                which = TYPES.index((line.get("type") or "").strip())
                depth = line.get("depth")
                place = [float(line["x"]), float(line["y"]), float(depth) if depth else depths[which]]
            except (KeyError, TypeError, ValueError):
                raise ValueError(
                    f"{path}, line {number}: found {dict(line)}, expected a type of {', '.join(TYPES)}, and x, y and "
                    "depth (optional) in m"
                ) from None
            if not all(map(math.isfinite, place)) or len(kind) == MOST:
                raise ValueError(f"{path}, line {number}: expected finite numbers and at most {MOST} receptors")
            kind.append(which)
            at.append(place)
    if not kind:
        raise ValueError(f"{path}: no receptors, expected a header type, x, y, depth and lines with these values")
    order = np.argsort(kind, kind="stable")
    return _population(np.array(kind, np.int32)[order], np.array(at)[order], seed, trial, fits)


def _population(kind: np.ndarray, at: np.ndarray, seed: int, trial: int, fits: tuple[np.ndarray, ...]) -> Population:
    """Assign to each receptor a random one of the fibres of its type."""
    numbers = np.random.default_rng([seed, 1])
    drawn = np.zeros((len(kind), 12))
    for which, fibres in enumerate(fits):
        mine = kind == which
        drawn[mine] = fibres[numbers.integers(len(fibres), size=int(mine.sum()))]
    keys = np.random.default_rng([seed, trial, 2]).integers(1 << 62, size=len(kind))
    return Population(kind, np.ascontiguousarray(at), drawn, keys)


@kernel
def _equal(points: Matrix, at: Matrix):
    """Whether two lists of points (n,3) are equal."""
    if len(points) != len(at):
        return False
    for n in range(len(at)):
        for axis in range(3):
            if points[n, axis] != at[n, axis]:
                return False
    return True


@ieee_kernel
def place(points: Matrix, at: Matrix, corners: Indices, weights: Matrix):
    """For each receptor, at [m] (n,3), fill `corners` and `weights` (n,8): grid points round it and their weights for
    trilinear interpolation of the stress. points [m] (p,3) of `tactile.Stress`: depth by depth, x by x; or those of the
    receptors, as `tactile.Relief` sends them. Returns (0, 0), or the fault and the receptor, such as (`OUTSIDE`, n)."""
    if _equal(points, at):
        for n in range(len(at)):
            corners[n], weights[n] = n, 0.0
            weights[n, 0] = 1.0
        return 0, 0
    # the grid: square layers of equal size, with one spacing in both directions
    total = len(points)
    layer = 0
    while layer < total and points[layer, 2] == points[0, 2]:
        layer += 1
    side = int(math.sqrt(layer) + 0.5)
    if side < 2 or side * side != layer or total % layer:
        return NO_GRID, 0
    step = points[1, 1] - points[0, 1]
    last = points[layer - 1]
    for axis in range(2):
        if not step > 0.0 or abs(last[axis] - points[0, axis] - (side - 1) * step) > 1e-6 * step:
            return NO_GRID, 0
    for n in range(len(at)):
        # cell of the receptor and fractions in it; the depths of the layers need not be equally spaced
        x, y = (at[n, 0] - points[0, 0]) / step, (at[n, 1] - points[0, 1]) / step
        i, j = min(max(int(x), 0), side - 2), min(max(int(y), 0), side - 2)
        x, y = x - i, y - j
        below = 0
        while below < total // layer - 1 and points[below * layer, 2] < at[n, 2] * (1.0 - 1e-9):
            below += 1
        above = max(below - 1, 0)
        top, bottom = points[above * layer, 2], points[below * layer, 2]
        z = (at[n, 2] - top) / (bottom - top) if bottom > top else 0.0
        slack = 1e-6
        if not (-slack <= x <= 1.0 + slack and -slack <= y <= 1.0 + slack and -slack <= z <= 1.0 + slack):
            return OUTSIDE, n
        if bottom == top and abs(at[n, 2] - top) > slack * top:
            return OUTSIDE, n
        # trilinear weights of the corners
        for c in range(8):
            dz, dx, dy = c >> 2, (c >> 1) & 1, c & 1
            corners[n, c] = (below if dz else above) * layer + (i + dx) * side + j + dy
            weights[n, c] = (z if dz else 1.0 - z) * (x if dx else 1.0 - x) * (y if dy else 1.0 - y)
    return 0, 0


@ieee_kernel
def traction(stress: Matrix, corners: Indices, weights: Array):
    """|sigma n| [Pa] on the plane parallel to the surface at a receptor, from the stress [Pa] (p,6) of all points:
    the vertical stress of the published model, and the shear stress. corners, weights (8) of `place`."""
    zz = yz = xz = 0.0
    for c in range(8):
        w = weights[c]
        if w != 0.0:
            s = stress[corners[c]]
            zz, yz, xz = zz + w * s[2], yz + w * s[3], xz + w * s[4]
    return math.sqrt(zz * zz + yz * yz + xz * xz)


@ieee_kernel
def deflection_stimulus(deflection: Matrix, corners: Indices, weights: Array):
    """|E* u| [N/m] of the surface above a receptor, from the deflection [N/m] (s,3) of a depth's points."""
    x = y = z = 0.0
    layer = len(deflection)
    for c in range(8):
        w = weights[c]
        if w != 0.0:
            u = deflection[corners[c] % layer]
            x, y, z = x + w * u[0], y + w * u[1], z + w * u[2]
    return math.sqrt(x * x + y * y + z * z)


@ieee_kernel
def equivalent(stress: Matrix, corners: Indices, weights: Array, poisson: float):
    """q = sqrt(2 E W) [Pa] at a receptor from the stress [Pa] (p,6) of all points; corners, weights (8) of `place`."""
    xx = yy = zz = yz = xz = xy = 0.0
    for c in range(8):
        w = weights[c]
        if w != 0.0:
            s = stress[corners[c]]
            xx, yy, zz = xx + w * s[0], yy + w * s[1], zz + w * s[2]
            yz, xz, xy = yz + w * s[3], xz + w * s[4], xy + w * s[5]
    return math.sqrt(max(energy_stress(xx, yy, zz, yz, xz, xy, poisson), 0.0))
