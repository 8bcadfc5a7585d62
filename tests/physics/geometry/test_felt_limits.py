"""A closing that would need too much memory is refused, with the width from which it is computed."""

import re

import numpy as np
import pytest

from palpate.physics.errors import MeshError
from palpate.physics.geometry.felt import limits
from palpate.physics.geometry.felt.bridge import close_surface
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.refined.divided import refine_mesh


@pytest.fixture(scope="module")
def cut():
    """A block in two pieces, 0.5 mm apart."""
    from manifold3d import Manifold

    half = Manifold.cube([20e-3, 10e-3, 12e-3])
    made = (half + half.translate([0.0, 10.5e-3, 0.0])).to_mesh64()
    points, triangles = np.asarray(made.vert_properties)[:, :3].copy(), np.asarray(made.tri_verts)
    return refine_mesh(Mesh(points, np.ascontiguousarray(triangles, np.int32)), 2e-3, 50_000)


def width_named(mesh, radius):
    """[m] The width that the refusal names."""
    with pytest.raises(MeshError, match="needs too many") as found:
        close_surface(mesh, radius)
    return 1e-3 * float(re.search(r"from about (\S+) mm", str(found.value))[1])


@pytest.mark.parametrize("radius", [0.05e-3, 1e-9])
def test_a_ball_too_small_for_the_body_is_refused_at_once(cut, radius):
    area = 4 * 1e-6 * (20 * 10 + 20 * 12 + 10 * 12)
    # equilateral triangles of a third of the radius: area 9 x 4/√3 over radius² is 2^21
    right = 2.0 * np.sqrt(9.0 * 4.0 / np.sqrt(3.0) * area / 2**21)
    assert 0.95 * right < width_named(cut, radius) < 1.05 * right


@pytest.mark.parametrize("name, most", [("MOST_TRIANGLES", 4000), ("MOST_POINTS", 1_000_000)])
def test_the_width_that_a_refusal_names_is_the_least(cut, monkeypatch, name, most):
    monkeypatch.setattr(limits, name, most)
    least = width_named(cut, 1e-3)
    assert 2e-3 < least < 16e-3
    assert 0.9 * least < width_named(cut, 0.9 * least / 2) < 1.1 * least
    felt = close_surface(cut, 1.1 * least / 2)
    assert felt is not None and felt.depth > 2e-3
