"""Segmentation: closed smooth outlines of skin, inner border of the skin, and bone in every slice.

Brightness levels are measured: air outside, skin in the shell below the outer border, tissue in the bright inside,
bone in the dark inside. An outline is the contour of the mean brightness of its two sides; with the partial volume
effect this gives the border with subpixel resolution. The nail gives no signal: the outline follows the
tissue below it.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.ndimage import binary_dilation, binary_fill_holes, distance_transform_edt, gaussian_filter, label
from scipy.spatial import cKDTree
from skimage.filters import threshold_otsu
from skimage.measure import find_contours, points_in_poly

from palpate.models.scan.stack import ScanError, Stack, largest_part

SMOOTHING = 0.2e-3  # [m] Standard deviation of the filter against noise, in the plane of the slices
HARMONICS = 12  # Fourier harmonics of an outline; shorter waves are noise
POINTS = 256
LEAST_AREA = 3e-6  # [m²] Smaller outlines are ignored
FINGER = (6e-3, 40e-3)  # [m] Breadth of a finger
BELOW_SKIN = 0.4e-3  # [m] Distance from the inner border of the skin in which bone is not searched
LEAST_BONE = 20e-9  # [m³] A smaller dark core is not bone


@dataclass(frozen=True)
class Outlines:
    """Outlines by slice, (256, 2) [m] as (row, column) from the centre of the image; None: no outline."""

    spacing: float  # [m] between slices
    skin: list[np.ndarray | None]
    tissue: list[np.ndarray | None]
    bone: list[np.ndarray | None]
    axes: str = ""  # as in `Stack`


def segment(stack: Stack, skin: float | None = None) -> Outlines:
    """Outlines of a stack.

    skin  [m]  thickness of the skin, for images that do not show it

    ScanError: no finger, several fingers, an implausible breadth, no bone, no visible skin.
    """
    between, *plane = stack.spacing
    where = stack.source
    # foreground, and one object in it
    image = gaussian_filter(stack.volume.astype(np.float64), (0.0, SMOOTHING / plane[0], SMOOTHING / plane[1]))
    low = _foreground(image, where)
    inside = np.stack([binary_fill_holes(s) for s in image > low])
    inside = _one_finger(inside, between * plane[0] * plane[1], where)
    _plausible(inside, plane, where)
    # brightness levels
    deep = np.stack([distance_transform_edt(s, sampling=plane) for s in inside])
    air = _level(image[~inside], "air", where)
    bright = inside & (image > low)
    tissue = _level(image[bright & (image > threshold_otsu(image[bright]))], "tissue", where)
    shell = _level(image[(deep > 0.35e-3) & (deep < 0.75e-3)], "skin", where)
    visible = (shell - air) < 0.85 * (tissue - air)
    if not visible and skin is None:
        raise ScanError(f"{where}: skin is as bright as tissue; give its thickness (--skin, in mm)")
    outer = 0.5 * (air + (shell if visible else tissue))

    # outer and inner border of the skin
    reach = round(0.8e-3 / min(plane))
    wide = [binary_dilation(mask, iterations=reach) if mask.any() else mask for mask in inside]
    borders = [_largest(slice_image, outer, plane, mask) for slice_image, mask in zip(image, wide, strict=True)]
    if skin is None:
        both = zip(image, wide, borders, strict=True)
        inner = [
            None if b is None else _largest(slice_image, 0.5 * (shell + tissue), plane, mask)
            for slice_image, mask, b in both
        ]
    else:
        inner = [None if b is None else _inner(b, skin, image.shape[1:], plane) for b in borders]
    # bone: the largest dark core
    core = np.stack([
        np.zeros(slice_image.shape, bool) if curve is None
        else (slice_image < 0.5 * (air + tissue)) & (_level_of(curve, slice_image.shape, plane) < -BELOW_SKIN)
        for slice_image, curve in zip(image, inner, strict=True)
    ])  # fmt: skip
    core = largest_part(core)
    if core.sum() * between * plane[0] * plane[1] < LEAST_BONE:
        raise ScanError(f"{where}: no bone: no dark core in the finger. Expected images in which tissue is bright")
    bone = _level(image[core], "bone", where)
    cores: list[np.ndarray | None] = []
    for slice_image, mask in zip(image, core, strict=True):
        around = binary_dilation(mask, iterations=reach) if mask.any() else mask
        cores.append(_largest(np.where(around, -slice_image, -tissue), -0.5 * (bone + tissue), plane, around))
    outlines = Outlines(between, borders, inner, cores, stack.axes)
    _check(outlines, where)
    return outlines


def _foreground(image: np.ndarray, where: str) -> float:
    """Brightness threshold of the finger, from the noise at the rim of the images and the brightness above it."""
    wide = max(2, round(0.04 * min(image.shape[1:])))
    rim = np.concatenate([image[:, :wide].ravel(), image[:, -wide:].ravel(), image[:, :, :wide].ravel(),
                          image[:, :, -wide:].ravel()])  # fmt: skip
    air = float(np.median(rim))
    noise = 1.5 * float(np.median(np.abs(rim - air)))
    standing = image[image > air + 8 * noise]
    standing = standing[standing > air + 0.1 * (image.max() - air)]
    if not len(standing):
        raise ScanError(f"{where}: nothing is brighter than the border of the images, expected a bright finger in air")
    return air + max(0.25 * (float(np.median(standing)) - air), 6 * noise)


def _one_finger(inside: np.ndarray, voxel: float, where: str) -> np.ndarray:
    names, count = label(inside)
    if count == 0:
        raise ScanError(f"{where}: no bright object, expected a finger")
    sizes = np.bincount(names.ravel())[1:] * voxel
    order = np.argsort(-sizes)
    first, second = ((names == k + 1).any(axis=(1, 2)) for k in (order[0], order[min(1, count - 1)]))
    if count > 1 and sizes[order[1]] > 0.02 * sizes[order[0]] and not (first & second).any():
        gap = int(np.flatnonzero(first | second)[0] + np.argmin((first | second)[np.argmax(first | second) :]))
        raise ScanError(f"{where}: no finger in slice {gap + 1}, but before and after it: a slice is missing or dark")
    if count > 1 and sizes[order[1]] > 0.15 * sizes[order[0]]:
        mm3 = ", ".join(f"{sizes[k] * 1e9:.0f}" for k in order if sizes[k] > 0.15 * sizes[order[0]])
        raise ScanError(f"{where}: more than one finger (objects of {mm3} mm³), expected one; crop the images to it")
    return names == order[0] + 1


def _plausible(inside: np.ndarray, plane, where: str) -> None:
    across = max(
        float(np.ptp(np.flatnonzero(s.any(axis=axis)))) * step
        for s in inside
        if s.any()
        for axis, step in ((1, plane[0]), (0, plane[1]))
    )
    if not FINGER[0] <= across <= FINGER[1]:
        least, most = (f * 1e3 for f in FINGER)
        raise ScanError(f"{where}: {across * 1e3:.1f} mm across, expected {least:g} ... {most:g} mm for a finger: "
                        f"the spacing is wrong, or the object is not a finger")  # fmt: skip
    rim = np.concatenate([inside[:, 0], inside[:, -1], inside[:, :, 0], inside[:, :, -1]], axis=1)
    if rim.mean() > 0.3:
        raise ScanError(f"{where}: no air around the object; expected whole cross-sections of one finger")


def _level(values: np.ndarray, what: str, where: str) -> float:
    if not len(values):
        raise ScanError(f"{where}: no {what} visible; expected air, skin, bright tissue and dark bone")
    return float(np.median(values))


def _largest(image: np.ndarray, level: float, plane, mask: np.ndarray) -> np.ndarray | None:
    """The largest closed contour at a level within the mask, smoothed; None: no contour."""
    if not mask.any():
        return None
    best, size = None, LEAST_AREA
    for curve in find_contours(np.pad(image, 1, constant_values=image.min()), level):
        curve = curve - 1
        if not np.allclose(curve[0], curve[-1]):
            continue
        area = enclosed_area(curve * plane)
        row, column = np.round(curve[:-1]).astype(int).T
        touching = mask[np.clip(row, 0, mask.shape[0] - 1), np.clip(column, 0, mask.shape[1] - 1)]
        if area > size and touching.mean() > 0.3:
            best, size = curve, area
    if best is None:
        return None
    centre = (np.array(image.shape) - 1) / 2
    return smooth((best - centre) * plane)


def _inner(border: np.ndarray, skin: float, shape: tuple[int, ...], plane) -> np.ndarray | None:
    level = -_level_of(border, shape, plane)
    return _largest(level, skin, plane, level > 0)


def _level_of(curve: np.ndarray, shape: tuple[int, ...], plane) -> np.ndarray:
    """Signed distance [m] of the pixels of an image to an outline, negative inside."""
    pixels = (np.moveaxis(np.indices(shape), 0, -1).reshape(-1, 2) - (np.array(shape) - 1) / 2) * plane
    return distance(curve, pixels).reshape(shape)


def distance(curve: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Signed distance [m] (n) of points (n,2) to a closed curve (m,2), negative inside."""
    dense = np.concatenate([curve + t * (np.roll(curve, -1, axis=0) - curve) for t in (0, 0.25, 0.5, 0.75)])
    away, _ = cKDTree(dense).query(points)
    within = np.flatnonzero(((points >= curve.min(axis=0)) & (points <= curve.max(axis=0))).all(axis=1))
    within = within[points_in_poly(points[within], curve)]
    away[within] *= -1
    return away


def enclosed_area(curve: np.ndarray) -> float:
    """Area inside a closed curve [m²]."""
    a, b = curve, np.roll(curve, -1, axis=0)
    return abs(float(0.5 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum()))


def smooth(curve: np.ndarray) -> np.ndarray:
    """A closed curve (n,2) as 256 points (256,2) with equal spacing, without harmonics above `HARMONICS`."""
    if np.allclose(curve[0], curve[-1]):
        curve = curve[:-1]
    closed = np.concatenate([curve, curve[:1]])
    length = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    at = np.linspace(0, length[-1], POINTS, endpoint=False)
    even = np.interp(at, length, closed[:, 0]) + 1j * np.interp(at, length, closed[:, 1])
    waves = np.fft.fft(even)
    waves[HARMONICS + 1 : -HARMONICS] = 0
    points = np.fft.ifft(waves)
    return np.stack([points.real, points.imag], axis=1)


def _next_area(area: float, step: float) -> float:
    """Area of the next slice of an ellipsoidal tip, 1 - (1 - y)² at y lengths of the tip from its end.

    Areas are relative to the largest; `step` is the spacing in lengths of the tip.
    """
    return 1.0 - max(np.sqrt(max(1.0 - area, 0.0)) - step, 0.0) ** 2


def _check(outlines: Outlines, where: str) -> None:
    seen = [k for k, curve in enumerate(outlines.skin) if curve is not None]
    if len(seen) < 4:
        raise ScanError(f"{where}: a finger in {len(seen)} slices only, expected 4 or more")
    holes = [k for k in range(seen[0], seen[-1]) if outlines.skin[k] is None]
    if holes:
        raise ScanError(
            f"{where}: no finger in slice {holes[0] + 1}, but before and after it: a slice is missing or dark"
        )
    breadth = max(float(np.ptp(curve, axis=0).max()) for curve in outlines.skin if curve is not None)
    centres = [curve.mean(axis=0) for curve in outlines.skin if curve is not None]
    areas = [enclosed_area(curve) for curve in outlines.skin if curve is not None]
    for k, (a, b) in enumerate(pairwise(areas)):
        jump = float(np.linalg.norm(centres[k + 1] - centres[k]))
        less, more = min(a, b) / max(areas), max(a, b) / max(areas)
        if jump > 0.2 * breadth or (less > 0.4 and more > 1.3 * _next_area(less, outlines.spacing / (0.4 * breadth))):
            raise ScanError(f"{where}: the outline jumps from slice {seen[k] + 1} to {seen[k] + 2}: slices are missing "
                            f"or out of order")  # fmt: skip
    boned = [k for k, curve in enumerate(outlines.bone) if curve is not None]
    if len(boned) < 3:
        raise ScanError(f"{where}: bone in {len(boned)} slices only, expected 3 or more")
    if boned[-1] - boned[0] + 1 != len(boned):
        gap = next(k for k in range(boned[0], boned[-1]) if outlines.bone[k] is None)
        raise ScanError(f"{where}: no bone in slice {gap + 1}, but before and after it; the image there is too noisy")
