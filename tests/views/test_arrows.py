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


def test_a_view_is_the_same_alone_and_after_others_in_its_scene():
    """Other indentations and fingers, no finger at all, and a force too small for an arrow."""
    needs_drawing()
    mesh = surface_mesh("plane", 400)
    indented = -6e-3 * np.exp(-(((mesh.vertices[:, None, :2] - FAR[:, :2] / 3) / 8e-3) ** 2).sum(axis=2)).T
    displacement = np.zeros((4, *mesh.vertices.shape))
    displacement[:3, :, 2] = indented[0], indented[1], indented[0]
    tips, normals = np.tile(FAR / 3, (4, 1, 1)), np.tile([0.0, 0.0, 1.0], (4, 2, 1))
    tips[0, 1] = tips[1, 0] = tips[2] = np.nan
    forces = np.tile([0.5, -0.5, 2.0], (4, 2, 1))
    forces[3, 0] = 0.0
    each = {
        "displacement": displacement, "values": np.abs(displacement[..., 2]), "tips": tips, "normals": normals,
        "forces": forces,
    }  # fmt: skip
    shared = {
        "vertices": mesh.vertices, "triangles": mesh.triangles, "most": np.array(6e-3), "colours": deformation_table(),
        "balls": ball_centres(FAR / 3, normals[0]), "pulls": forces[0], "greatest": np.array(3.0),
    }  # fmt: skip
    together = render({**shared, **each, "near": np.array([0, 1])})
    for k in (1, 2, 3):
        alone = {name: values[k : k + 1] for name, values in each.items()}
        drawn = render({**shared, **alone, "near": np.arange(1 if k == 1 else 0)})
        assert np.array_equal(drawn["wide"][0], together["wide"][k])
        assert k != 1 or np.array_equal(drawn["close"][0], together["close"][1])
    assert len({picture.tobytes() for picture in together["wide"]}) == 4
