"""Notes where a body or the collision leaves its range: thin bodies, coarse triangles."""

import numpy as np
import pytest

from palpate.messages import Load
from palpate.nodes.base.contacts import press_body
from palpate.nodes.collision import Mesh
from palpate.nodes.deformation.mass_spring import MassSpring

trimesh = pytest.importorskip("trimesh")


def notes(node):
    node.start()
    return node.notes()


def ball(radius):
    return trimesh.creation.icosphere(3, radius)


def apart(*meshes):
    """Separate pieces in one file."""
    return trimesh.util.concatenate(meshes)


@pytest.mark.parametrize(
    ("make", "at", "mean"),
    [
        (lambda: trimesh.creation.box((100, 100, 2)), 0.0, 2e-3 / 1.04),
        (lambda: ball(5), 0.0, 10e-3 / 3),
        (lambda: ball(21), 0.0, 42e-3 / 3),
        (lambda: trimesh.creation.torus(26, 6, 96, 48), 0.0, 6e-3),  # a box around it is 12 mm thick
        (lambda: apart(ball(5), ball(21).apply_translation([50, 0, 0])), 50e-3, 42e-3 / 3),
    ],
)  # fmt: skip
def test_mass_spring_notes_an_indentation_beyond_the_thickness(tmp_path, make, at, mean):
    """Once, and only then; the thickness is that of the piece under the finger."""
    make().export(tmp_path / "thin.stl")
    body = MassSpring(surface=str(tmp_path / "thin.stl"), file_unit="mm", refine=0.0, position=(0.0, 0.0, 0.0),
                      stiffness=250.0, exponent=1.0, damping=0.0)  # fmt: skip
    assert not notes(body)
    mesh = body.mesh()
    node = int(np.argmin(np.abs(mesh.vertices - (at, 0.0, 1.0)).sum(axis=1)))
    thick = float(mesh.thicknesses[node])
    assert thick == pytest.approx(mean, rel=0.02)
    for share, noted in ((0.9, False), (1.2, True)):
        force = np.array([[0.0, 0.0, -250.0 * share * mean]])
        load = Load(nodes=np.array([node], np.int32), forces=force, foot=(0.0, 0.0, 0.0), normal=(0.0, 0.0, 1.0))
        sent = press_body(body, load, dt=1e-3)
        found = [line for line in body.notes() if "more than its thickness" in line]
        assert len(found) == noted and all(f"{1e3 * thick:.3g} mm" in line for line in found)
        assert (
            sent.extrapolation == pytest.approx(max(share - 1.0, 0.0), abs=0.03)
            and body.condition() == "outside its range" * noted
        )


def test_an_open_surface_has_no_thickness(tmp_path):
    open_ = trimesh.creation.box((100, 100, 2))
    open_.update_faces(np.arange(len(open_.faces)) > 0)
    open_.export(tmp_path / "open.stl")
    body = MassSpring(surface=str(tmp_path / "open.stl"), file_unit="mm", refine=0.0)
    assert np.isinf(body.mesh().thicknesses).all()


def test_the_refinement_of_coarse_triangles_is_noted_and_can_be_switched_off(tmp_path):
    trimesh.creation.icosphere(3, 40).export(tmp_path / "ball.stl")
    given = {"surface": str(tmp_path / "ball.stl"), "file_unit": "mm"}
    (line,) = notes(Mesh(**given))
    middles = trimesh.creation.icosphere(3, 40).triangles_center
    sagitta = 40 - np.linalg.norm(middles, axis=1).min()
    moved = float(line.partition("up to ")[2].split()[0])
    assert "642 vertices become" in line and "refine=0" in line and moved == pytest.approx(sagitta, abs=0.03)
    assert notes(Mesh(**given, refine=0.0)) == []
