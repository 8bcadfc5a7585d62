"""Statements of the tactile-flow paper about hard and soft plates, and the results of the model."""

from typing import Any

import numpy as np

from palpate.models.fe.study.press_record import Record
from palpate.physics.contact.tactile import growth

LOW, HIGH = 0.11, 0.50  # [N] The two forces of the paper's Table III

WEAK = 0.1  # [1] Strain level of the volumes that are compared at the same indentation
LEAST = 1e-3  # [mm³, mm³/N] Isostrain volume, or its growth, below which a level counts as not reached


def at_depth(record: Record, indentation: float) -> float:
    """Force [N] at an indentation [m] that the record reaches, interpolated."""
    return float(np.interp(indentation, record.indentation, record.force))


def statements(steel: Record, silicone: Record) -> list[dict[str, Any]]:
    """Each statement of the paper on both plates with the figures of the records, between its two forces, and whether
    it is true; None: not reached. Statements at forces beyond the end of a record are omitted."""
    rows: list[dict[str, Any]] = []

    def add(statement: str, first: float | None, second: float | None, less: bool = False) -> None:
        valid = None if first is None or second is None else bool(second < first if less else second > first)
        rows.append({"statement": statement, "steel": first, "silicone": second, "holds": valid})

    for force in (LOW, HIGH):
        if steel.force[-1] < force:
            continue
        depth = steel.at(force)[0]
        other = at_depth(silicone, depth) if depth <= silicone.indentation[-1] else None
        add(f"force at {1e3 * depth:.2f} mm, N: lower on silicone", force, other, less=True)
    depth = float(min(steel.indentation[-1], silicone.indentation[-1]))
    k = int(np.argmin(np.abs(steel.levels - WEAK)))
    hard, soft = (1e9 * float(np.interp(depth, r.indentation, r.volumes[:, k])) for r in (steel, silicone))
    first, second = _seen(hard, soft)
    add(f"V at strain {steel.levels[k]:g} and {1e3 * depth:.2f} mm, mm³: less on silicone", first, second, less=True)
    if min(steel.force[-1], silicone.force[-1]) < HIGH:
        return rows
    ends = [(r.at(LOW), r.at(HIGH)) for r in (steel, silicone)]
    hard, soft = (1e6 * float(growth(np.array(a[1]), np.array(b[1]), LOW, HIGH)) for a, b in ends)
    add("area growth, mm²/N: faster on silicone", hard, soft)
    rates = (1e9 * growth(a[2], b[2], LOW, HIGH) for a, b in ends)
    for level, x, y in zip(steel.levels, *rates, strict=True):
        first, second = _seen(float(x), float(y))
        add(f"ΔV/ΔP at strain {level:g}, mm³/N: larger on silicone", first, second)
    return rows


def _seen(hard: float, soft: float) -> tuple[float, float] | tuple[None, None]:
    return (hard, soft) if max(hard, soft) > LEAST else (None, None)
