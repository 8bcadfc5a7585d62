"""Presses from the files of atomic force microscopes: JPK, Igor, AFM workshop and HDF5, read by `afmformats`.

The depth is the displacement of the tip towards the sample: the height, less the deflection F/k of a cantilever of
stiffness k; the direction in which the force rises counts as inwards.
"""

import logging
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from palpate.models.files.hdf5 import check_hdf5
from palpate.models.fit.sessions import SessionError
from palpate.models.fit.tissue.measured import MeasuredPress, prepare_press
from palpate.physics.claims import check_zip
from palpate.physics.extras import require_extra
from palpate.physics.readable import check_file

LARGEST = 1 << 30  # [bytes] of a file: 100 times the largest map
SUFFIXES = (".jpk-force", ".jpk-force-map", ".jpk-qi-data", ".jpk-qi-series", ".ibw", ".h5", ".zip")
"""Files that `afmformats` reads and that are no tables of numbers."""


def read_afm(path: Path) -> list[MeasuredPress]:
    """The curves of a file, each a press. SessionError: it cannot be read, with the reason."""
    with require_extra(path.suffix, "afm", SessionError):
        import afmformats

    log = logging.getLogger("afmformats")
    before = log.level
    log.setLevel(logging.CRITICAL + 1)  # it logs the traceback of the error that follows
    try:
        check_sizes(path)
        curves = afmformats.load_data(path)
        if not curves:
            raise ValueError("it has no curve")
        return [_read_press(path, number, len(curves), curve) for number, curve in enumerate(curves, 1)]
    except (SessionError, KeyboardInterrupt, SystemExit):
        raise
    except BaseException as error:  # the errors of afmformats are no Exceptions
        reason = getattr(error, "strerror", None) or str(error) or type(error).__name__
        unzip = "; if it contains a table of numbers, unzip it and give the table" * (path.suffix == ".zip")
        raise SessionError(f"{path}: afmformats cannot read it: {reason}{unzip}") from None
    finally:
        log.setLevel(before)


def check_sizes(path: Path) -> None:
    """Compare the sizes that a file states with its length. ValueError, OSError: not a file, or too large."""
    size = check_file(path, LARGEST)
    with path.open("rb") as file:
        head = file.read(8)
    if head.startswith(b"PK"):
        check_zip(path)
    elif head == b"\x89HDF\r\n\x1a\n":
        check_hdf5(path)
    elif path.suffix == ".h5":
        raise ValueError(f"it is no HDF5 file; it has {size} bytes and begins with {head!r}")


def _read_press(path: Path, number: int, count: int, curve: Any) -> MeasuredPress:
    """One curve: approach, pause and retract as they follow each other."""
    name = path.name if count == 1 else f"{path.name}: curve {number}"
    if missing := [c for c in ("force", "height (measured)") if c not in curve]:
        raise SessionError(f"{name}: found no column {' and '.join(map(repr, missing))}")
    force, height = (np.array(curve[c], float) for c in ("force", "height (measured)"))
    stiffness = curve.metadata.get("spring constant")
    soft = stiffness is not None and np.isfinite(stiffness) and stiffness > 0.0
    top = int(np.argmax(force))
    sign = 1.0 if height[top] > height[0] else -1.0
    depth = sign * height - (force / stiffness if soft else 0.0)
    time = np.array(curve["time"], float) if "time" in curve else None
    if time is not None:
        keep = np.concatenate([[True], np.diff(time) > 0.0])
        time, depth, force = time[keep], depth[keep], force[keep]
    how = (
        f"the deflection of a cantilever of {stiffness:.4g} N/m is subtracted"
        if soft
        else "its stiffness is unknown, so the deflection of the cantilever counts as depth"
    )
    return replace(prepare_press(name, time, depth, force), remarks=(f"{name}: force and height (measured); {how}",))
