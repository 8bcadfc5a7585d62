"""The stored references of meetings: curves of `full` on two meshes (`python benchmarks/meeting.py --store`)."""

import json
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import PchipInterpolator

from palpate.physics.archive import replace_text
from palpate.physics.errors import ArgumentError
from palpate.studies.meeting.full import FullCurve
from palpate.studies.peers import MissingError

PATH = Path(__file__).parent / "references.json"
QUANTITIES = {"force": 1.5, "area": 1.0}  # with the power of the closing to which they are proportional at first


@lru_cache(maxsize=1)
def references() -> dict[str, dict[str, Any]]:
    """By meeting: closings [m], forces [N], areas [m²] (L,), bands of both, unknowns, seconds. ArgumentError: the file
    is damaged."""
    try:
        return dict(json.loads(PATH.read_text(encoding="utf-8")))
    except (OSError, ValueError) as error:
        raise ArgumentError(
            f"{PATH}: damaged ({error}). Build it again: python benchmarks/meeting.py --store"
        ) from None


def reference(name: str) -> dict[str, Any]:
    """The stored curve of a meeting. MissingError: it is not stored."""
    found = references()
    if name not in found:
        raise MissingError(
            f"{PATH}: {name} is missing. Build it: python benchmarks/meeting.py {name} --store. Stored: "
            f"{', '.join(found) or 'none'}"
        )
    return found[name]


def store(curves: dict[str, tuple[FullCurve, FullCurve]]) -> None:
    """Store the curves of meetings on a coarse and on a fine mesh: the fine one, and as band their difference."""
    made = references() if PATH.is_file() else {}
    for name, (coarse, fine) in curves.items():
        made[name] = joined(coarse, fine)
    replace_text(PATH, json.dumps(made, indent=1) + "\n")
    references.cache_clear()


def joined(coarse: FullCurve, fine: FullCurve) -> dict[str, Any]:
    """The curve on the fine mesh, and as band its difference to that on the coarse one, for JSON."""
    count = min(len(coarse.force), len(fine.force))
    return {
        "closing": fine.closing[:count].tolist(), "force": fine.force[:count].tolist(),
        "area": fine.area[:count].tolist(),
        "force band": np.abs(fine.force[:count] - coarse.force[:count]).tolist(),
        "area band": np.abs(fine.area[:count] - coarse.area[:count]).tolist(),
        "unknowns": [coarse.unknowns, fine.unknowns], "seconds": [coarse.seconds, fine.seconds],
    }  # fmt: skip


def meeting_values(name: str, closing: np.ndarray) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Forces [N] and areas [m²], and their bands, at closings >= 0 [m] (T,) up to the largest one of a meeting.

    Force over closing^1.5 and area over closing are interpolated; before the first level they are constant, as in
    Hertz's contact. MissingError: the meeting is not stored.
    """
    curve = reference(name)
    values, bands = dict[str, np.ndarray](), dict[str, np.ndarray]()
    levels = np.array(curve["closing"])
    within = np.clip(closing, levels[0], levels[-1])
    for what, power in QUANTITIES.items():
        for key, into in ((what, values), (f"{what} band", bands)):
            scaled = np.array(curve[key]) / levels**power
            into[what] = PchipInterpolator(levels, scaled)(within) * np.maximum(closing, 0.0) ** power
    return values, bands
