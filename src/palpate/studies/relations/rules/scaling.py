"""Similar scenes: all settings scaled by their dimensions give results scaled by theirs (E. Buckingham 1914)."""

from __future__ import annotations

from fractions import Fraction
from functools import partial
from typing import Any

import numpy as np

from palpate.engine.graph import Graph
from palpate.nodes.base import settings
from palpate.studies.relations.relation import Case, Claim, Relation, same_force
from palpate.units.quantity import parse

SHARE = 1e-6  # [1] of the peak
SCALED = "exponential"
KEPT = ("resolution", "file_unit", "vertices")
LEAST, MOST = 0.3, 3.0  # [1] factors on all stiffnesses


def _power(unit: str) -> float:
    """The power of mass in a unit: that of force, stiffness and modulus."""
    plain = unit.replace("m^n", "m")
    return float(parse(plain).dimension[1]) if plain not in ("1", "SI") else 0.0


def scaled(graph: Graph, by: float) -> dict[str, Any]:
    """The settings of all nodes whose dimension has a mass, times this factor to the power of the mass."""
    found: dict[str, Any] = {}
    for name, spec in graph.nodes.items():
        if spec.off or spec.observer:
            continue
        known = settings(spec.cls)
        for key, value in spec.settings.items():
            power = _power(known[key].unit) if key in known and not isinstance(value, str | bool) else 0.0
            if power and key not in KEPT:
                numbers = (np.array(value, dtype=float) * by ** Fraction(power)).tolist()
                found[f"{name}.{key}"] = numbers
    return found


def similar(case: Case, rng: np.random.Generator) -> Claim:
    """All masses, and with them all stiffnesses, dampings and forces, times a factor: the same motion."""
    law = f"scene.finger.finger_law={SCALED}"  # the forces of the other laws are part of their names
    exact = case.but(exact=True, more=(*case.touch.setting.more, law))
    by = float(np.exp(rng.uniform(np.log(LEAST), np.log(MOST))))
    other = exact.run.but(scaled(exact.run.launch().load(), by))
    return Claim((exact.run, other, exact.near), partial(same_force, share=SHARE, factor=by))


ABOUT = "all masses, stiffnesses and limits times m: forces times m"
RELATIONS = (Relation("similar", ABOUT, "1e-6 of the peak, or what 3 µm change", similar),)
