"""deformation.ReducedFE compared with full finite elements on random touches of a slab.

    python benchmarks/random_touches.py --touches 40 --seed 1

A touch is a patch of 3 to 15 mm at a random position on the centre line of the slab, at least 2 mm from its border,
with one of the given Poisson's ratios. Two loads: a light one in the linear range, and one that indents the slab by 25
% of the patch radius. The full model is `fe.Solver` on quadratic tetrahedra aligned with the patch, `--cells` across
its radius (with 3 it is 0.5 to 1 % too stiff); the surface under the patch sticks. The first call builds the bases for
the Poisson's ratios, without a nonlinear indentation table.
"""

from __future__ import annotations

import argparse

import numpy as np

from palpate.nodes.deformation import ReducedFE
from palpate.physics.bodies.condensed_body import CondensedBody, answer, bear, condensed_body
from palpate.physics.contact.spread import spread, spreader
from palpate.physics.geometry.mesh import Mesh
from palpate.studies.accuracy.bases import ready
from palpate.studies.peers.continuum import POISSON, SIDE, YOUNG, TissueBlock, press_block

UP = (0.0, 0.0, 1.0)
LIGHT, DEEP = 0.01, 0.25
"""[1] Approximate indentation over the patch radius."""
VERTICES = 10000


def indentation(body: CondensedBody, mesh: Mesh, place: float, radius: float, force: float) -> float:
    """Indentation [m] under a force at rest."""
    patch, foot = spreader(mesh, radius), (place, 0.0, 0.0)
    count = spread(patch, foot, UP, (0.0, 0.0, -force))
    bear(body, 0, patch.nodes[:count], patch.forces[:count], foot, UP, 1.0)
    answer(body, np.zeros((1, 5)), 1.0)
    return float(body.contacts[0]["now"])


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
        curve = press_block(TissueBlock(place, given.cells, radius=radius, poisson=poisson), levels)
        errors = [
            indentation(body, mesh, place, radius, f) / s - 1.0
            for body in (corrected, widened)
            for f, s in zip(levels, curve.indentation, strict=True)
        ]
        found.append(errors)
        print(
            f"{k + 1:3d}  R {1e3 * radius:4.1f} mm  {1e3 * (SIDE / 2 - place - radius):4.1f} mm from the border  "
            f"nu {poisson:.2f}  f {levels[1]:.2f} N  error {100 * errors[0]:+.2f}, {100 * errors[1]:+.2f} %"
            f"  (uncorrected {100 * errors[2]:+.1f}, {100 * errors[3]:+.1f} %)",
            flush=True,
        )
    off = 100.0 * np.abs(np.array(found))
    for name, column in (("light", 0), ("0.25 R deep", 1), ("light, uncorrected", 2)):
        low, middle, high, most = np.percentile(off[:, column], (25, 50, 75, 100))
        print(f"{name}: quartiles {low:.2f}, {middle:.2f}, {high:.2f} %, worst {most:.2f} % of {len(off)}")


if __name__ == "__main__":
    main()
