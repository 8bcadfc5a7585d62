"""The axes of the finger, for any orientation in the scanner.

y is the axis of the bone, from the tip to the hand; x runs across, where the cross-sections are broadest; z to the
nail, the side of the finger with the bone. The images are cut perpendicular to the axis first, so that their oblique
end does not bias the axes.
"""

from typing import NamedTuple

import numpy as np
from scipy.ndimage import map_coordinates

from palpate.models.scan.stack import ScanError
from palpate.physics.fingertip.surfaces import FingertipSurfaces

LEAST_OFFSET = 1e-4  # [m] Least offset of the bone from the middle of the finger, which indicates the nail
LEAST_BREADTH = 1.05  # [1] Least breadth over depth of the cross-sections, which indicates the roll
TURNS = 6  # Iterations of axis and cut; each reduces the error by a factor of 100


class FingerFrame(NamedTuple):
    """The finger's frame in that of the images."""

    origin: np.ndarray  # [m] (3) the tip of the skin, on the axis of the bone
    axes: np.ndarray  # [1] (3,3) x, y, z as rows

    @property
    def tilt(self) -> float:
        """Angle [rad] between the axis of the finger and the normal of the slices."""
        return float(np.arccos(np.clip(self.axes[1, 1], -1, 1)))

    @property
    def roll(self) -> float:
        """Angle [rad] about the axis of the finger from the upper side of the images to the nail."""
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
    """The finger's frame in that of its surfaces, whose y points approximately from the tip to the hand.

    nail  [1] (3)  approximate direction of the nail; None: from the offset of the bone

    ScanError: the nail is not given, and the finger is as deep as it is broad or the bone is in its middle.
    """
    # axis of the bone, iterated with the perpendicular cut
    bone, skin = (_inside(lying, name) for name in ("bone", "skin"))
    y = np.array([0.0, 1.0, 0.0])
    for _ in range(TURNS):
        _, axes = np.linalg.eigh(_cut(lying, bone, y).covariance())
        y = axes[:, 2] * np.sign(axes[1, 2])
    skin, bone = _cut(lying, skin, y), _cut(lying, bone, y)
    # direction of the nail
    middle = bone.middle()
    z, breadth = _upright(skin, y)
    if breadth < LEAST_BREADTH:
        if nail is None:
            raise ScanError("the finger is as thick as it is wide; give the side of the nail (--axes)")
        z = nail - (nail @ y) * y
    offset = float((middle - bone._replace(points=_sections(bone.points, skin, y)).middle()) @ z)
    if nail is not None:
        offset = float(nail @ z)
        if abs(offset) < 0.5:
            raise ScanError("the given side of the nail is a narrow side of the finger; expected a broad side")
    elif abs(offset) < LEAST_OFFSET:
        raise ScanError("the bone is midway between nail and pulp; give the side of the nail (--axes)")
    z = z / np.linalg.norm(z) * np.sign(offset)
    axes = np.stack([np.cross(y, z), y, z])
    return FingerFrame(middle + (_tip(lying, skin, y) - middle @ y) * y, axes)


def turn_surfaces(lying: FingertipSurfaces, frame: FingerFrame, margin: float) -> FingertipSurfaces:
    """The surfaces in the finger's frame, with a margin [m] of air. The last slice is extrapolated if it is oblique."""
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
    """Grid points inside a surface; cells at the border have their inner fraction as weight."""
    part = np.clip(0.5 - getattr(lying, name) / lying.spacing.min(), 0, 1)
    return Cloud(lying.origin + lying.spacing * np.argwhere(part > 0), part[part > 0])


def _tip(lying: FingertipSurfaces, skin: Cloud, y: np.ndarray) -> float:
    """First position [m] of the skin along y: from its foremost grid point, refined with the signed distance."""
    inside = skin.points[skin.weights > 0.5]
    foremost = inside[np.argmin(inside @ y)]
    steps = np.linspace(0.0, 2 * float(lying.spacing.max()), 81)
    level = lying.level("skin", foremost - steps[:, None] * y)
    return float(foremost @ y - np.interp(0.0, np.maximum.accumulate(level), steps))


def _cut(lying: FingertipSurfaces, cloud: Cloud, y: np.ndarray) -> Cloud:
    """The points in front of a plane perpendicular to y that does not cut the last slice."""
    points = cloud.points
    ends = points[points[:, 1] > lying.origin[1] + (lying.skin.shape[1] - 1.5) * lying.spacing[1]]
    before = points @ y < (ends @ y).min() if len(ends) else np.full(len(points), True)
    return Cloud(points[before], cloud.weights[before])


def _upright(skin: Cloud, y: np.ndarray) -> tuple[np.ndarray, float]:
    """The direction (3) of the smallest depth of the cross-sections, and their breadth over that depth [1]."""
    about = skin.points - _sections(skin.points, skin, y)
    values, axes = np.linalg.eigh(Cloud(about - np.outer(about @ y, y), skin.weights).covariance())
    return axes[:, 1], float(np.sqrt(values[2] / values[1]))


def _sections(points: np.ndarray, skin: Cloud, y: np.ndarray, step: float = 1e-3) -> np.ndarray:
    """The centre (n,3) of the skin's cross-section at each point, linear between stations a step [m] apart.

    Each point contributes to both neighbouring stations, so that rounding does not shift a layer of the grid."""
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
