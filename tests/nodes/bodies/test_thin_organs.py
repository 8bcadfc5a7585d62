"""Notes on files for which a body or the collision leaves its range: thin bodies, coarse triangles."""

import numpy as np
import pytest

from palpate.nodes.base.surface import thickness
from palpate.nodes.collision import Mesh
from palpate.nodes.deformation.mass_spring import MassSpring

trimesh = pytest.importorskip("trimesh")


def notes(node):
    node.start()
    return node.notes()


@pytest.mark.parametrize(
    ("make", "mean", "noted"),
    [
        (lambda: trimesh.creation.box((100, 100, 2)), 2e-3 / 1.04, True),
        (lambda: trimesh.creation.icosphere(3, 5), 10e-3 / 3, True),
        (lambda: trimesh.creation.icosphere(3, 21), 42e-3 / 3, False),
        (lambda: trimesh.creation.box((100, 100, 20)), 20e-3 / 1.4, False),
    ],
)
def test_mass_spring_notes_that_its_law_has_no_thickness(tmp_path, make, mean, noted):
    make().export(tmp_path / "thin.stl")
    given = {"surface": str(tmp_path / "thin.stl"), "file_unit": "mm"}
    assert thickness(given["surface"], "mm", 0) == pytest.approx(mean, rel=0.02)
    found = [line for line in notes(MassSpring(**given)) if "has no thickness" in line]
    assert len(found) == noted and all("mm thick" in line and str(tmp_path) in line for line in found)


def test_the_refinement_of_coarse_triangles_is_noted_and_can_be_switched_off(tmp_path):
    trimesh.creation.icosphere(3, 40).export(tmp_path / "ball.stl")
    given = {"surface": str(tmp_path / "ball.stl"), "file_unit": "mm"}
    (line,) = notes(Mesh(**given))
    middles = trimesh.creation.icosphere(3, 40).triangles_center
    sagitta = 40 - np.linalg.norm(middles, axis=1).min()
    moved = float(line.partition("up to ")[2].split()[0])
    assert "642 vertices become" in line and "refine=0" in line and moved == pytest.approx(sagitta, abs=0.03)
    assert notes(Mesh(**given, refine=0.0)) == []
