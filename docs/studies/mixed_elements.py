"""From which Poisson's ratio the mixed element beats the plain one: smooth fields with known answer, and a press.

    python docs/studies/mixed_elements.py [--json]

Small strain, unit cube. Smooth: a field whose volume changes as much at every ratio, and one that keeps its volume,
both with the body force that they need and held on all sides: error of the displacement in L2 on 4³ bricks of six
elements, and its order from 2³. Press: the cube between two rough plates; error of its force on 2³ bricks against 8³.
A minute on one core.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from dataclasses import replace

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import beside  # noqa: F401
import numpy as np
from tables import show

from palpate.models.fe import Settings, Solver, TetMesh, box, linear
from palpate.models.fe.element.elements import gradients, shape
from palpate.physics.materials.hyperelastic import Material, moduli

RATIOS = (0.3, 0.4, 0.45, 0.47, 0.48, 0.485, 0.49, 0.495, 0.499, 0.4999)
A, B = (5.0 - np.sqrt(5.0)) / 20.0, (5.0 + 3.0 * np.sqrt(5.0)) / 20.0
AT = np.array([[A, A, A], [B, A, A], [A, B, A], [A, A, B]])
STEPS = Settings(tolerance=1e-9, step=1.0, largest=1.0)


def swelling(x: np.ndarray, ratio: float) -> tuple[np.ndarray, np.ndarray]:
    """A field whose volume changes, and its body force."""
    mu, kappa = moduli(1e4, ratio)
    s, c = np.sin(2.0 * x), np.cos(2.0 * x)
    u = 1e-3 * np.stack([s[:, 0] * c[:, 1], s[:, 1] * c[:, 2], s[:, 2] * c[:, 0]], axis=1)
    # laplacian u = -8 u; div u = 2e-3 (cx cy + cy cz + cz cx)
    grad = -4e-3 * np.stack([s[:, i] * (c[:, (i + 1) % 3] + c[:, (i + 2) % 3]) for i in range(3)], axis=1)
    return u, 8.0 * mu * u - (kappa + mu / 3.0) * grad


def keeping(x: np.ndarray, ratio: float) -> tuple[np.ndarray, np.ndarray]:
    """A field that keeps its volume, and its body force."""
    mu, _ = moduli(1e4, ratio)
    u = 1e-3 * np.stack([np.sin(2.0 * x[:, (i + 1) % 3]) * np.cos(2.0 * x[:, (i + 2) % 3]) for i in range(3)], axis=1)
    return u, 8.0 * mu * u


def solved(mesh: TetMesh, law: Material, ratio: float, field) -> float:  # type: ignore[no-untyped-def]
    """L2 error of the displacement over its L2 norm."""
    value, _ = shape(AT)
    _, det = gradients(mesh.points, mesh.elements, AT)
    place = np.einsum("na,eai->eni", value, mesh.points[mesh.elements])
    force = field(place.reshape(-1, 3), ratio)[1].reshape(place.shape)
    load = np.zeros_like(mesh.points)
    np.add.at(load, mesh.elements, np.einsum("en,na,eni->eai", det / 24.0, value, force))
    goal = field(mesh.points, ratio)[0]
    fixed = np.zeros(mesh.points.shape, dtype=bool)
    fixed[np.unique(mesh.faces)] = True
    body = Solver(mesh, {0: law}, fixed, lambda t: t * goal, lambda t: t * load, settings=STEPS)
    body.advance(1.0)
    displacement = np.einsum("na,eai->eni", value, body.displacement[mesh.elements])
    exact = field(place.reshape(-1, 3), ratio)[0].reshape(place.shape)
    return float(np.sqrt(np.sum(det[..., None] * (displacement - exact) ** 2) / np.sum(det[..., None] * exact**2)))


def pressed(cells: int, law: Material) -> float:
    """Force [N] of a cube that is pressed by a thousandth between two rough plates."""
    mesh = box((1.0, 1.0, 1.0), (cells,) * 3)
    z = mesh.points[:, 2]
    top = z > 1.0 - 1e-9
    fixed = np.repeat((top | (z < 1e-9))[:, None], 3, axis=1)
    body = Solver(mesh, {0: law}, fixed, lambda t: np.outer(top, (0.0, 0.0, -1e-3 * t)), settings=STEPS)
    body.advance(1.0)
    return -float(body.reaction[top, 2].sum())


def row(ratio: float) -> dict[str, float]:
    """Both elements at one Poisson's ratio."""
    errors: dict[str, float] = {"ratio": ratio}
    coarse, fine = (box((1.0, 1.0, 1.0), (n,) * 3) for n in (2, 4))
    laws = {name: replace(linear(1e4, ratio), mixed=name == "mixed") for name in ("plain", "mixed")}
    for title, field in (("swelling", swelling), ("keeping", keeping)):
        for name, law in laws.items():
            rough, good = (solved(mesh, law, ratio, field) for mesh in (coarse, fine))
            errors |= {f"{title}, {name}": good, f"order, {title}, {name}": float(np.log2(rough / good))}
    right = pressed(8, laws["mixed"])
    errors |= {f"press, {name} %": 100.0 * (pressed(2, law) / right - 1.0) for name, law in laws.items()}
    errors["press 8³, plain %"] = 100.0 * (pressed(8, laws["plain"]) / right - 1.0)
    return errors


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    rows = [row(ratio) for ratio in RATIOS]
    if given.json:
        json.dump(rows, sys.stdout, indent=2)
    else:
        show("Plain and mixed elements by Poisson's ratio", rows, 3)


if __name__ == "__main__":
    main()
