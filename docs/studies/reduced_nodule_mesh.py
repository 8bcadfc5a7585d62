"""What a reduced basis is off by over a nodule because of its own mesh, whatever rule the load follows.

    python docs/studies/reduced_nodule_mesh.py [--radii 4 5 6.5 8 12]

The slab with a ball of 4 mm, 6 mm deep, 10 times as hard, is pressed lightly right over it. Reference: `fe.Solver` with
3 cells across the patch's radius, cells that the ball cuts having their mean modulus by volume. Against it stands the
full model that a basis is condensed from (600 vertices), given the pressure itself on its quadratic faces instead of
hats: what the nodule takes from its compliance, off that of the reference without a nodule. Its elements have the
modulus of their centre, as `fe.organ` gives them, or their mean modulus by volume. Some three minutes.
"""

from __future__ import annotations

import argparse
import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from palpate.models.fe.contact.bed import ElasticFoundation
from palpate.models.fe.element.mesh import quadratic
from palpate.models.fe.meshing.organ import SLAB, Organ
from palpate.models.fe.solve.body import ElasticBody
from palpate.nodes.base.surface import surface_mesh
from palpate.physics.materials.neo_hooke import neo_hooke
from palpate.studies.accuracy.continuum import BED, POISSON, SHARES, YOUNG, Block, Inclusion, _load, press

BALL = Inclusion()
LIGHT = 0.013
"""[1] Force over E R²."""
PARTS = 6
"""Along the edge of an element, of which each is in the ball or not."""


def inside(points: np.ndarray) -> np.ndarray:
    """Whether points [m] (...,3) are in the ball."""
    return np.linalg.norm(points + (0.0, 0.0, BALL.depth), axis=-1) < BALL.radius


def by_volume(corner: np.ndarray) -> np.ndarray:
    """Share of each tetrahedron (E,4,3) that is in the ball, in `SHARES` steps."""
    n = PARTS
    at = [(i, j, k, n - 1 - i - j - k) for i in range(n) for j in range(n - i) for k in range(n - i - j)]
    shares = (np.array(at) + 0.25) / n
    points = np.einsum("qc,tci->tqi", shares, corner)
    return np.round(SHARES * inside(points).mean(axis=1)) / SHARES


def softness(ratio: np.ndarray, radii: np.ndarray) -> np.ndarray:
    """Of the basis's mesh under the true pressure in its middle, for these moduli of its elements (E,) [1/m]."""
    mesh = Organ(surface_mesh("plane", 600)).mesh
    corners = mesh.elements[:, :4]
    ratios, region = np.unique(ratio, return_inverse=True)
    mesh = quadratic(mesh.points[: corners.max() + 1], corners, region.astype(np.int64))
    z = mesh.points[mesh.faces[:, :3], 2]
    bed = ElasticFoundation(mesh.faces[(z < 1e-9 - SLAB).all(axis=1)], BED)
    laws = {k: neo_hooke(float(r), POISSON) for k, r in enumerate(ratios)}
    rest = ElasticBody(mesh, laws, [bed]).rest(np.zeros(mesh.points.shape, dtype=bool))
    top = mesh.faces[(z > -1e-9).all(axis=1)]
    loads = np.stack([_load(mesh.points, top, 0.0, float(radius)).ravel() for radius in radii], axis=1)
    return np.sum(loads * rest.solve(loads), axis=0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--radii", type=float, nargs="+", default=[4.0, 5.0, 6.5, 8.0, 12.0], help="mm")
    radii = 1e-3 * np.array(parser.parse_args().radii)
    plain, over = (
        np.array([_pressed(Block(nodule=ball, cells=3, radius=float(radius))) for radius in radii])
        for ball in (None, BALL)
    )
    corners = Organ(surface_mesh("plane", 600)).mesh
    corner = corners.points[corners.elements[:, :4]]
    none = softness(np.ones(len(corner)), radii)
    print("R [mm]                  " + "".join(f"{1e3 * radius:8.1f}" for radius in radii))
    for name, share in (("by the element's centre", inside(corner.mean(axis=1))), ("by volume", by_volume(corner))):
        taken = none - softness(1.0 + (BALL.ratio - 1.0) * share, radii)
        print(f"{name:24s}" + "".join(f"{value:+8.1f}" for value in 100.0 * ((plain - taken) / over - 1.0)) + " %")


def _pressed(block: Block) -> float:
    """Compliance of a light press, for a modulus of 1 Pa [1/m]."""
    force = LIGHT * YOUNG * block.radius**2
    return YOUNG * float(press(block, np.array([force])).indentation[0]) / force


if __name__ == "__main__":
    main()
