"""deformation.ReducedFE against full finite elements on random touches of a slab: patches and places that no list has.

    python benchmarks/random_touches.py --touches 40 --seed 1

A touch is a patch of 3 to 15 mm anywhere along the middle of the slab, 2 mm from its border at least, of one of the
Poisson's ratios given. It is pressed lightly, where all is linear, and to a quarter of its radius. The full model is
`fe.Solver` on quadratic tetrahedra that follow the patch, `--cells` across its radius (3 are 0.5 to 1 % too stiff);
the surface under the patch sticks. The body's bases of other Poisson's ratios are built once, without a table.
"""

from __future__ import annotations

import argparse

import numpy as np

from palpate.nodes.deformation import ReducedFE
from palpate.physics.bodies.condensed_body import CondensedBody, answer, bear, condensed_body
from palpate.physics.bodies.condensed_step import NOW
from palpate.physics.contact.spread import spread, spreader
from palpate.physics.geometry.mesh import Mesh
from palpate.studies.accuracy.bodies.reduced_fe import ready
from palpate.studies.peers.continuum import POISSON, SIDE, YOUNG, Block, press

UP = (0.0, 0.0, 1.0)
LIGHT, DEEP = 0.01, 0.25
"""[1] Indentation over the patch's radius, about."""
VERTICES = 10000


def indentation(body: CondensedBody, mesh: Mesh, place: float, radius: float, force: float) -> float:
    """[m] under a force at rest."""
    patch, foot = spreader(mesh, radius), (place, 0.0, 0.0)
    count = spread(patch, foot, UP, (0.0, 0.0, -force))
    bear(body, 0, patch.nodes[:count], patch.forces[:count], foot, UP, 1.0)
    answer(body, np.zeros((1, 5)), 1.0)
    return float(body.numbers[0, NOW])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--touches", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--cells", type=int, default=3)
    parser.add_argument("--poisson", type=float, nargs="+", default=[0.3, 0.4, POISSON, 0.49])
    given = parser.parse_args()
    rng = np.random.default_rng(given.seed)
    found = []
    for k in range(given.touches):
        poisson, radius = float(rng.choice(given.poisson)), float(rng.uniform(3e-3, 15e-3))
        place = float(rng.uniform(0.0, SIDE / 2 - radius - 2e-3))
        node = ReducedFE(surface="plane", position=(0.0, 0.0, 0.0), vertices=VERTICES, poisson=poisson)
        ready(node)
        mesh = node.mesh()
        law = (node.basis(), mesh, YOUNG, 0.0, radius, 0.02)
        corrected, widened = condensed_body(*law, poisson), condensed_body(*law)
        soft = indentation(corrected, mesh, place, radius, 1e-3) / 1e-3
        levels = np.array([LIGHT, DEEP]) * radius / soft
        curve = press(Block(place, given.cells, radius=radius, poisson=poisson), levels)
        errors = [
            indentation(body, mesh, place, radius, f) / s - 1.0
            for body in (corrected, widened)
            for f, s in zip(levels, curve.indentation, strict=True)
        ]
        found.append(errors)
        print(
            f"{k + 1:3d}  R {1e3 * radius:4.1f} mm  {1e3 * (SIDE / 2 - place - radius):4.1f} mm from the border  "
            f"nu {poisson:.2f}  f {levels[1]:.2f} N  off by {100 * errors[0]:+.2f}, {100 * errors[1]:+.2f} %"
            f"  (uncorrected {100 * errors[2]:+.1f}, {100 * errors[3]:+.1f} %)",
            flush=True,
        )
    off = 100.0 * np.abs(np.array(found))
    for name, column in (("light", 0), ("a quarter of R deep", 1), ("light, uncorrected", 2)):
        low, middle, high, most = np.percentile(off[:, column], (25, 50, 75, 100))
        print(f"{name}: quartiles {low:.2f}, {middle:.2f}, {high:.2f} %, worst {most:.2f} % of {len(off)}")


if __name__ == "__main__":
    main()
