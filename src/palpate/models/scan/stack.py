"""A stack of cross-sections of a finger: checks, handedness from a header or from the user, any axis of the slices.

Three letters give the directions of slices, rows and columns, in this order:

    T, H  to the tip, to the hand        N, P  to the nail, to the pulp
    R, L  to the right, to the left, as seen from the tip towards the hand with the nail up

HPR are slices from the tip on, with the nail up, seen from the tip. Missing directions are found from the images (tip,
nail, axes of the finger), except left and right: the mirror image of a finger is a finger of the other hand. Without a
header and without letters, each slice is assumed to be behind the previous one.
"""

import dataclasses
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_opening, label

from palpate.physics.errors import MISUSE, PalpateError

IN_PLANE = (0.02e-3, 1.0e-3)
BETWEEN = (0.05e-3, 5.0e-3)
LEAST_SLICES = 6
DIRECTIONS = {"R": (1, 0, 0), "L": (-1, 0, 0), "H": (0, 1, 0), "T": (0, -1, 0), "N": (0, 0, 1), "P": (0, 0, -1)}
"""Letter -> direction in the frame of the finger: x across, y from the tip to the hand, z from the pulp to the nail."""
OPPOSITE = dict(zip("RLHTNP", "LRTHPN", strict=True))


class ScanError(PalpateError, ValueError):
    """A scan that cannot be used."""

    exit_code = MISUSE


@dataclass(frozen=True)
class Stack:
    """Cross-sections of a finger.

    volume   [1]  (slices, rows, columns) float32 brightness; columns, rows and slices are a right-handed frame: each
                  slice is behind the previous one
    axes     directions of slices, rows and columns that the user gave, see the head of this file; "": none
    """

    volume: np.ndarray
    spacing: tuple[float, float, float]  # [m] between slices, rows, columns
    source: str = ""  # file or folder
    axes: str = ""
    handed: str = "assumed"  # source of the handedness: "header", "stated", or "assumed"


def check_stack(stack: Stack) -> Stack:
    """The stack itself. ScanError: too few or empty slices, or a spacing that is implausible for a finger."""
    volume, spacing, where = stack.volume, stack.spacing, stack.source
    if volume.ndim != 3 or volume.shape[0] < LEAST_SLICES or min(volume.shape[1:]) < 16:
        raise ScanError(f"{where}: found {volume.shape} (slices, rows, columns), expected {LEAST_SLICES} slices or "
                        f"more of 16 × 16 or more pixels")  # fmt: skip
    if not np.isfinite(volume).all():
        raise ScanError(f"{where}: brightness that is not a number")
    limits = (BETWEEN, IN_PLANE, IN_PLANE)
    for name, value, (low, high) in zip(("slice", "row", "column"), spacing, limits, strict=True):
        if not low <= value <= high:
            raise ScanError(f"{where}: {name} spacing {value * 1e3:g} mm, expected {low * 1e3:g} ... {high * 1e3:g} mm "
                            f"for a finger; correct it with --spacing")  # fmt: skip
    empty = np.flatnonzero(np.ptp(volume, axis=(1, 2)) == 0)
    if len(empty):
        some = ", ".join(map(str, empty[:5].tolist())) + (", ..." if len(empty) > 5 else "")
        raise ScanError(f"{where}: slices {some} are empty; a slice is missing from the scan")
    return stack


def orient_stack(stack: Stack, axes: str, mirrored: bool | None) -> Stack:
    """The stack, right-handed.

    axes      three letters, or "" if not given
    mirrored  whether columns, rows and slices are left-handed in the file; None: unknown

    ScanError: invalid letters.
    """
    handed = "assumed" if mirrored is None else "header"
    if axes:
        axes = axes.upper()
        if len(axes) != 3 or {frozenset((a, OPPOSITE.get(a))) for a in axes} != {
            frozenset(p) for p in ("RL", "TH", "NP")
        }:
            raise ScanError(f"--axes: found {axes!r}, expected a letter each of T or H, N or P, R or L, such as HPR")
        along, row, column = (np.array(DIRECTIONS[a]) for a in axes)
        mirrored, handed = bool(np.dot(np.cross(column, row), along) < 0), "stated"
    stack = dataclasses.replace(stack, axes=axes, handed=handed)
    return _reverse_stack(stack) if mirrored else stack


def _reverse_stack(stack: Stack) -> Stack:
    axes = OPPOSITE[stack.axes[0]] + stack.axes[1:] if stack.axes else ""
    return dataclasses.replace(stack, volume=stack.volume[::-1], axes=axes)


def cross_sections(stack: Stack) -> Stack:
    """The stack with slices across the finger, right-handed.

    The axis is the given one, else that of the side where the finger leaves the volume, else that of its longest
    extent.
    """
    along = next((k for k, a in enumerate(stack.axes) if a in "TH"), None)
    along = _along(stack) if along is None else along
    if along:
        order = (along, *(k for k in range(3) if k != along))
        first, second, third = (stack.spacing[k] for k in order)
        axes = "".join(stack.axes[k] for k in order) if stack.axes else ""
        stack = dataclasses.replace(
            stack, volume=stack.volume.transpose(order), spacing=(first, second, third), axes=axes
        )
        if along == 1:  # an odd permutation
            stack = _reverse_stack(stack)
    return dataclasses.replace(stack, volume=np.ascontiguousarray(stack.volume))


def largest_part(mask: np.ndarray) -> np.ndarray:
    """The largest connected part of a mask."""
    names, count = label(mask)
    return mask if count < 2 else names == np.argmax(np.bincount(names.ravel())[1:]) + 1


def _along(stack: Stack) -> int:
    """The axis of the array nearest to that of the finger; 0 if no finger is visible."""
    volume = stack.volume
    if volume.ndim != 3 or min(volume.shape) < 3 or not np.isfinite(volume).all() or not min(stack.spacing) > 0:
        return 0
    sides = [volume.take(end, axis=axis) for axis in range(3) for end in (0, -1)]
    air = float(np.median(np.concatenate([side.ravel() for side in sides])))
    bright = binary_opening(volume > air + 0.25 * (float(np.percentile(volume, 99.5)) - air))
    if not bright.any():
        return 0
    finger = largest_part(bright)
    step = np.array(stack.spacing)
    faces = [max(finger.take(end, axis=axis).sum() for end in (0, -1)) * step.prod() / step[axis] for axis in range(3)]
    if max(faces) > 1e-6:
        return int(np.argmax(faces))
    return int(np.argmax([np.ptp(np.flatnonzero(finger.any(axis=tuple({0, 1, 2} - {k})))) * step[k] for k in range(3)]))
