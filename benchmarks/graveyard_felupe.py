"""A nearly incompressible block compressed between clamps: FElupe's linear tetrahedra, and palpate's elements."""

from __future__ import annotations

import numpy as np
from fe_problems import block

from palpate.models.fe import Settings, Solver, box, neo_hooke
from palpate.studies.peers import felupe as peer

YOUNG, TRAVEL, CELLS = 1e4, 0.05, 6
RATIOS = (0.3, 0.49, 0.4999)


def locked() -> str:
    """Force with linear tetrahedra of four nodes over that with the mixed element, on the same corner nodes."""
    return "; ".join(f"{nu}: {_linear(nu) / _mixed(nu, CELLS):.2f} × the force" for nu in RATIOS)


def mixed() -> str:
    """Force with the mixed element over that on a mesh with elements of half the size."""
    return "; ".join(f"{nu}: {_mixed(nu, CELLS) / _mixed(nu, 2 * CELLS):.4f} × that of a finer mesh" for nu in RATIOS)


def _mixed(poisson: float, cells: int) -> float:
    squeezed = block(cells)
    down = np.outer(squeezed.driven, (0.0, 0.0, -TRAVEL))
    tissue = {0: neo_hooke(YOUNG, poisson)}
    body = Solver(squeezed.mesh, tissue, squeezed.fixed, lambda load: load * down, settings=Settings(step=0.5))
    body.advance(1.0)
    return float(body.reaction[squeezed.driven, 2].sum())


def _linear(poisson: float) -> float:
    fem = peer.library()
    mesh = box((1.0, 1.0, 1.0), (CELLS, CELLS, CELLS))
    corners, elements = np.unique(mesh.elements[:, :4], return_inverse=True)
    points = mesh.points[corners]
    field = peer.displacement_field(fem, fem.Mesh(points, elements.reshape(-1, 4), "tetra"))
    solid = peer.neo_hooke(fem, field, YOUNG, poisson)
    z = points[:, 2]
    top, foot = z > 1 - 1e-9, z < 1e-9
    bounds = {
        "foot": fem.Boundary(field[0], mask=foot),
        "top": fem.Boundary(field[0], mask=top, skip=(0, 0, 1)),
        "move": fem.Boundary(field[0], mask=top, skip=(1, 1, 0)),
    }
    for share in (0.5, 1.0):
        bounds["move"].update(-TRAVEL * share)
        peer.balance(fem, field, [solid], bounds)
    return float(solid.assemble.vector(field).toarray().reshape(-1, 3)[top, 2].sum())
