"""Arrows of the force on a drawn surface."""

import numpy as np
from drawing import needs_drawing

from palpate.nodes.base.surface import surface_mesh
from palpate.views.surface.render import _longest, ball_centres, render

SHAFT = np.array([0x1F, 0x3B, 0x57])


def test_no_arrow_is_cut_at_the_border_of_its_picture():
    """The greatest force, on a finger at the far end of the surface, points past it."""
    needs_drawing()
    mesh = surface_mesh("plane", 400)
    tips, normals = np.array([[-0.045, 0.045, 0.0]]), np.array([[0.0, 0.0, 1.0]])
    force = np.array([[-2.0, 2.0, 4.0]])
    views = {
        "vertices": mesh.vertices, "triangles": mesh.triangles, "displacement": np.zeros((1, *mesh.vertices.shape)),
        "values": np.zeros((1, len(mesh.vertices))), "tips": tips, "normals": normals, "forces": force,
        "near": np.zeros(0, dtype=int), "most": np.array(1e-3), "balls": ball_centres(tips, normals), "pulls": force,
        "greatest": np.array(float(np.linalg.norm(force))),
    }  # fmt: skip
    (picture,) = render(views)["wide"]
    dark = np.abs(picture.astype(int) - SHAFT).sum(axis=2) < 60
    rows, columns = np.nonzero(dark)
    assert len(rows) > 100 and _longest(mesh.vertices) > 0.02
    assert rows.min() > 3 and rows.max() < picture.shape[0] - 4
    assert columns.min() > 3 and columns.max() < picture.shape[1] - 4
