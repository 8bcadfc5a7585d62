"""How far the places of the shipped reduced organs were pressed, read from their dents.

    python docs/studies/reduced_places.py [--json]

A place's dents are means of the table; where it was not reached x = s/R (1 + dent) goes on as a parabola, whose third
differences are zero. A row: places, how many reach the last level, and indentation and force of the least end, of the
least that reaches the last level and of the greatest. Seconds.
"""

from __future__ import annotations

import argparse
import json
import sys

import beside  # noqa: F401
import numpy as np
from tables import show

from palpate.models.fe.reduce.dents import PLACES, RADIUS, patch, pressed_places
from palpate.nodes.deformation import ReducedFE
from palpate.physics.bodies.condensed_body import Basis
from palpate.physics.bodies.dents import SPACING, hat_moments, patch_radius
from palpate.physics.geometry.mesh import Mesh

ROUNDED = 3e-6
"""[1] Third difference of x that single precision may leave of none."""


def places(surface: str) -> dict[str, object]:
    """One row."""
    node = ReducedFE(surface=surface)
    basis = node.basis()
    assert isinstance(basis, Basis)
    mesh = Mesh(basis.vertices, basis.triangles)
    feet, normals = pressed_places(mesh, PLACES, RADIUS)
    loads = np.stack([patch(mesh, foot, n, RADIUS) for foot, n in zip(feet, normals, strict=True)])
    shares = -np.einsum("pvi,pi->pv", loads, normals)
    moments, every = hat_moments(mesh), np.arange(len(mesh.vertices))
    across = np.array([patch_radius(mesh.vertices, moments, every, len(every), m[:, None]) for m in shares])
    flat = loads.reshape(len(loads), -1)
    stiffness = node.young / np.sum(flat * (flat @ basis.compliance.astype(float)), axis=1)
    levels = SPACING * np.arange(1, basis.dents.shape[1] + 1)
    x = levels * (1.0 + shares @ basis.dents)
    before = np.tile([-2.0 * SPACING, -SPACING, 0.0], (len(x), 1))
    kinks = np.abs(np.diff(np.concatenate([before, x], axis=1), 3, axis=1)) > ROUNDED
    last = len(levels) - 1 - np.argmax(kinks[:, ::-1], axis=1)
    own = np.arange(len(x))
    depth, force = across * levels[last], across * stiffness * x[own, last]
    whole = last == len(levels) - 1
    return {
        "surface": surface,
        "places": len(x),
        "to the last level": int(whole.sum()),
        "least end mm": 1e3 * float(depth.min()),
        "least end N": float(force.min()),
        "last level mm": 1e3 * float(depth[whole].min()),
        "greatest mm": 1e3 * float(depth.max()),
        "greatest N": float(force.max()),
        "least dent": float((shares @ basis.dents).min()),
        "greatest dent": float((shares @ basis.dents).max()),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    rows = [places("kidney"), places("plane")]
    if given.json:
        json.dump(rows, sys.stdout, indent=2)
    else:
        show("places of the shipped bases", rows, digits=3)


if __name__ == "__main__":
    main()
