"""Whole touches of a body of beams: the dragged surface does not fold, and no touch chatters at its end."""

import numpy as np
import pytest

from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.nodes.base.surface import surface_mesh
from palpate.records.reader import Recording


@pytest.fixture(scope="module", params=["nodule", "kidney"])
def run(request, tmp_path_factory):
    file = tmp_path_factory.mktemp(request.param) / "run.mcap"
    sets = ("tissue.use=deformation.BeamBundle", "scene.surface.vertices=6000")
    assert execute(find(request.param).but(record=file, place="fused", overrides=sets)).result.ok
    return Recording(file)


def test_no_triangle_is_inverted_and_neighbours_stay_together(run):
    settings = next(n for n in run.about["plan"]["nodes"] if n["name"] == "tissue")["settings"]
    mesh = surface_mesh(settings["surface"], settings["vertices"], tuple(settings["position"]))
    t = mesh.triangles
    i, j = np.concatenate([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]]).T
    spans = np.linalg.norm(mesh.vertices[i] - mesh.vertices[j], axis=1)
    friction = np.linalg.norm(run.columns("friction")["force"], axis=1)
    looked, held = 0, 0
    for tick, surface in list(enumerate(run.messages("tissue")))[::60]:
        moved = np.zeros_like(mesh.vertices)
        moved[surface.nodes] = surface.displacement
        corners = mesh.vertices + moved
        a, b, c = (corners[t[:, k]] for k in range(3))
        assert (np.einsum("ij,ij->i", np.cross(b - a, c - a), mesh.face_vectors) > 0).all()
        assert (np.linalg.norm(moved[i] - moved[j], axis=1) / spans).max() <= 0.8 * (1 + 1e-6)
        looked += friction[tick] > 0.2
        held += surface.limited > 0
    assert looked > 7 and held > 0


def test_a_touch_ends_once(run):
    """Touches shorter than 20 ms are chatter of a body that loses its indentation."""
    on = run.columns("contact")["force"] > 0
    turns = np.flatnonzero(np.diff(on.astype(int)))
    assert 2 <= len(turns) <= 8
    assert np.diff(turns).min() > 20
