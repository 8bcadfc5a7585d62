"""Arrows of the force on a drawn surface."""

import numpy as np
import pytest
from drawing import needs_drawing

from palpate.nodes.base.surface import surface_mesh
from palpate.views.pictures.style import deformation_table
from palpate.views.surface.render import ARROW, ARROW_SHARE, ball_centres, render

SHAFT = np.array([0x1F, 0x3B, 0x57])


FAR = np.array([[-0.045, 0.045, 0.0], [0.045, -0.045, 0.0]])


@pytest.mark.parametrize("count", [1, 2])
def test_no_arrow_is_cut_at_the_border_of_its_picture(count):
    """The largest force, on fingers at the ends of the surface, points beyond it; two fingers also have a close-up."""
    needs_drawing()
    mesh = surface_mesh("plane", 400)
    tips, normals = FAR[None, :count], np.tile([0.0, 0.0, 1.0], (1, count, 1))
    force = np.array([[-2.0, 2.0, 4.0], [2.0, -2.0, 4.0]])[None, :count]
    views = {
        "vertices": mesh.vertices, "triangles": mesh.triangles, "displacement": np.zeros((1, *mesh.vertices.shape)),
        "values": np.zeros((1, len(mesh.vertices))), "tips": tips, "normals": normals, "forces": force,
        "near": np.arange(count - 1), "most": np.array(1e-3), "balls": ball_centres(tips[0], normals[0]),
        "pulls": force[0], "colours": deformation_table(), "greatest": np.array(float(np.linalg.norm(force[0, 0]))),
    }  # fmt: skip
    drawn = render(views)
    for picture in [*drawn["wide"], *drawn["close"]]:
        dark = np.abs(picture.astype(int) - SHAFT).sum(axis=2) < 60
        rows, columns = np.nonzero(dark)
        assert len(rows) > 100 * count and min(ARROW, ARROW_SHARE * np.ptp(mesh.vertices, axis=0).max()) > 0.02
        assert rows.min() > 3 and rows.max() < picture.shape[0] - 4
        assert columns.min() > 3 and columns.max() < picture.shape[1] - 4
