"""A stack of cross-sections of a finger, and its checks."""

from dataclasses import dataclass

import numpy as np

from palpate.physics.errors import MISUSE, PalpateError

IN_PLANE = (0.02e-3, 1.0e-3)
BETWEEN = (0.05e-3, 5.0e-3)
LEAST_SLICES = 6


class ScanError(PalpateError, ValueError):
    """A scan that cannot be used."""

    exit_code = MISUSE


@dataclass(frozen=True)
class Stack:
    """Cross-sections of a finger.

    volume   [1]  (slices, rows, columns) float32 brightness; columns, rows and slices are a right-handed frame: each
                  slice is behind the previous one
    axes     directions of slices, rows and columns that the user gave, see `scan.orientation`; "": none
    """

    volume: np.ndarray
    spacing: tuple[float, float, float]  # [m] between slices, rows, columns
    source: str = ""  # file or folder
    axes: str = ""
    handed: str = "assumed"  # source of the handedness: "header", "stated", or "assumed"


def checked(stack: Stack) -> Stack:
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
        raise ScanError(f"{where}: slices {_some(empty)} are empty; a slice is missing from the scan")
    return stack


def _some(numbers) -> str:
    text = ", ".join(str(int(n)) for n in numbers[:5])
    return text + (", ..." if len(numbers) > 5 else "")
