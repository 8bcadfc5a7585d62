"""A load on a vertex that the surface does not have is an error: its index would read and write other memory."""

import numpy as np
import pytest

from palpate.launch.load.launchfile import find
from palpate.messages import Load
from palpate.nodes.base import SettingError
from palpate.nodes.deformation import BeamBundle, MassSpring, ReducedFE

BODIES = {"MassSpring": MassSpring, "BeamBundle": BeamBundle, "ReducedFE": ReducedFE}


@pytest.fixture(scope="module", params=[*BODIES, "sampled"])
def body(request):
    made = ReducedFE(surface="fingertip", model="sampled") if request.param == "sampled" else BODIES[request.param]()
    made.start()
    return made


@pytest.mark.parametrize("place", ["below", "behind", "far"])
def test_a_load_on_an_unknown_vertex_is_an_error(body, place):
    count = len(body.mesh().vertices)
    node = {"below": -1, "behind": count, "far": 2**31 - 1}[place]
    force = np.array([[0.0, 0.0, -0.1], [0.0, 0.0, -0.1]])
    load = Load(nodes=[count - 1, node], forces=force, foot=(0, 0, 0), normal=(0, 0, 1))
    with pytest.raises(SettingError, match=rf"Load\.nodes: found nodes .*, the surface has {count} vertices"):
        body.step([load], dt=1e-3)


@pytest.mark.parametrize("setting", ["vertices=3001", "spacing=2 mm", "position=[0, 0, 0.09]"])
def test_a_body_with_another_mesh_than_its_load_has_a_note(setting):
    name = setting.partition("=")[0]
    (note,) = [n for n in find("kidney").but(overrides=[f"tissue.{setting}"]).load().notes if "surfaces" in n]
    assert note.startswith(f"spread and tissue have different surfaces ({name} ") and "the loads act on other" in note
    assert not [n for n in find("kidney").load().notes if "surfaces" in n]
