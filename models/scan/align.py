"""The finger's own axes, for any orientation in the scanner.

y is the axis of the bone, from the tip to the hand; x runs across, where the cross-sections are broadest; z to the
nail, the side of the finger on which the bone lies. All three are taken from what lies before a cut square to the axis,
so that a slanting end of the images does not bend them.
"""

from typing import NamedTuple

import numpy as np
from scipy.ndimage import map_coordinates

from palpate.models.scan.stack import ScanError
from palpate.physics.fingertip.surfaces import FingertipSurfaces

LEAST_OFFSET = 1e-4  # [m] Of the bone from the middle of the finger, from which it tells the side of the nail
LEAST_BREADTH = 1.05  # [1] Breadth over depth of the cross-sections, from which they tell how the finger is rolled
TURNS = 6  # Repetitions of the axis and the cut square to it; each leaves a hundredth of the error


class FingerFrame(NamedTuple):
    """The finger's frame in another."""

    origin: np.ndarray  # [m] (3) the tip of the skin, on the axis of the bone
    axes: np.ndarray  # [1] (3,3) x, y, z as rows

    @property
    def tilt(self) -> float:
        """Angle [rad] between the axis of the finger and the way across the slices."""
        return float(np.arccos(np.clip(self.axes[1, 1], -1, 1)))

    @property
    def roll(self) -> float:
        """Angle [rad] by which the nail is turned from the upper side of the images, about the axis of the finger."""
        return float(np.arctan2(self.axes[2, 0], self.axes[2, 2]))


class Cloud(NamedTuple):
    """Points [m] (n,3) with weights [1] (n)."""

    points: np.ndarray
    weights: np.ndarray

    def middle(self) -> np.ndarray:
        return self.weights @ self.points / self.weights.sum()

    def covariance(self) -> np.ndarray:
        """About the middle (3,3) [m²]."""
        return np.cov(self.points.T, aweights=self.weights)


def find_frame(lying: FingertipSurfaces, nail: np.ndarray | None) -> FingerFrame:
    """The finger's frame in that of its surfaces, whose y runs about from the tip to the hand.

    nail  [1] (3)  about where the nail is; None: where the bone tells

    ScanError: a finger that is as deep as it is broad, or whose bone lies in its middle, where nobody says where the
    nail is.
    """
    bone, skin = (_inside(lying, name) for name in ("bone", "skin"))
    y = np.array([0.0, 1.0, 0.0])
    for _ in range(TURNS):
        _, axes = np.linalg.eigh(_cut(lying, bone, y).covariance())
        y = axes[:, 2] * np.sign(axes[1, 2])
    skin, bone = _cut(lying, skin, y), _cut(lying, bone, y)
    middle = bone.middle()
    z, breadth = _upright(skin, y)
    if breadth < LEAST_BREADTH:
        if nail is None:
            raise ScanError("the finger is as thick as it is wide; say where the nail is (--dorsal or --axes)")
        z = nail - (nail @ y) * y
    offset = float((middle - bone._replace(points=_sections(bone.points, skin, y)).middle()) @ z)
    if nail is not None:
        offset = float(nail @ z)
        if abs(offset) < 0.5:
            raise ScanError("the nail is said to be on a narrow side of the finger; expected one of its broad sides")
    elif abs(offset) < LEAST_OFFSET:
        raise ScanError("the bone is midway between nail and pulp; say where the nail is (--dorsal or --axes)")
    z = z / np.linalg.norm(z) * np.sign(offset)
    axes = np.stack([np.cross(y, z), y, z])
    return FingerFrame(middle + (_tip(lying, skin, y) - middle @ y) * y, axes)


def turned(lying: FingertipSurfaces, frame: FingerFrame, margin: float) -> FingertipSurfaces:
    """The surfaces in the finger's frame, with a margin [m] of air. The last slice is taken on where it slants."""
    step = lying.spacing
    inside = (_inside(lying, "skin").points - frame.origin) @ frame.axes.T
    low, high = inside.min(axis=0) - margin, inside.max(axis=0) + margin
    end = lying.origin[1] + (lying.skin.shape[1] - 1) * step[1]
    high[1] = (end - frame.origin[1]) / frame.axes[1, 1]  # where the axis leaves the last slice
    count = np.floor((high - low) / step).astype(int) + 1
    grid = low + step * np.moveaxis(np.indices(count), 0, -1)
    place = np.moveaxis((grid @ frame.axes + frame.origin - lying.origin) / step, -1, 0)
    levels = (map_coordinates(getattr(lying, k), place, order=3, mode="nearest") for k in ("skin", "tissue", "bone"))
    return FingertipSurfaces(low, step, *levels)


def _inside(lying: FingertipSurfaces, name: str) -> Cloud:
    """What is inside a surface, the cells at the border by the part of them that is."""
    part = np.clip(0.5 - getattr(lying, name) / lying.spacing.min(), 0, 1)
    return Cloud(lying.origin + lying.spacing * np.argwhere(part > 0), part[part > 0])


def _tip(lying: FingertipSurfaces, skin: Cloud, y: np.ndarray) -> float:
    """Where the skin begins along y [m]: at its foremost grid point, then by the distance on the way out of it."""
    inside = skin.points[skin.weights > 0.5]
    foremost = inside[np.argmin(inside @ y)]
    way = np.linspace(0.0, 2 * float(lying.spacing.max()), 81)
    level = lying.level("skin", foremost - way[:, None] * y)
    return float(foremost @ y - np.interp(0.0, np.maximum.accumulate(level), way))


def _cut(lying: FingertipSurfaces, cloud: Cloud, y: np.ndarray) -> Cloud:
    """What lies before a plane square to y, all before the last slice."""
    points = cloud.points
    ends = points[points[:, 1] > lying.origin[1] + (lying.skin.shape[1] - 1.5) * lying.spacing[1]]
    before = points @ y < (ends @ y).min() if len(ends) else np.full(len(points), True)
    return Cloud(points[before], cloud.weights[before])


def _upright(skin: Cloud, y: np.ndarray) -> tuple[np.ndarray, float]:
    """The direction (3) in which cross-sections are least deep, and their breadth over that depth [1]."""
    about = skin.points - _sections(skin.points, skin, y)
    values, axes = np.linalg.eigh(Cloud(about - np.outer(about @ y, y), skin.weights).covariance())
    return axes[:, 1], float(np.sqrt(values[2] / values[1]))


def _sections(points: np.ndarray, skin: Cloud, y: np.ndarray, step: float = 1e-3) -> np.ndarray:
    """The middle (n,3) of the skin's cross-section at each point, linear between places a step [m] apart.

    A point counts for the two places round it, so that no layer of the grid falls to one side by rounding."""
    start = (skin.points @ y).min()
    at = (skin.points @ y - start) / step
    low = at.astype(int)
    count = int(at.max()) + 2
    sums = np.zeros((4, count))
    for place, share in ((low, 1 - (at - low)), (low + 1, at - low)):
        for k, values in enumerate((*skin.points.T, 1.0)):
            sums[k] += np.bincount(place, weights=skin.weights * share * values, minlength=count)
    known = sums[3] > 0
    along = np.arange(count)[known]
    return np.stack(
        [np.interp((points @ y - start) / step, along, m[known] / sums[3][known]) for m in sums[:3]], axis=1
    )
