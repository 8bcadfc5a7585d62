"""A fine surface mesh: loads and displacements on some vertices compared with all of them, for every body."""

from functools import cache

import msgspec
import numpy as np
import pytest
import scipy.spatial
from pytest import approx

from palpate.messages import Contact, Friction
from palpate.nodes.collision import Mesh as NearestOnMesh
from palpate.nodes.deformation import BeamBundle, MassSpring, ReducedFE
from palpate.nodes.spread import Kernel

BEAMS = {"layers": (3e-3, 27e-3), "moduli": (257.6e3, 64.4e3), "relaxations": (0.63e-3, 12.6e-3)}
FEET = ((0.002, 0.001, 0.105), (-0.031, 0.004, 0.1), (0.012, -0.014, 0.102))
FORCE = 0.3  # [N] light enough that no displacement that is shown is limited (`stretch`)


def pressed(foot, normal, force=FORCE):
    contact = Contact.example(loaded=True)
    place = {"foot": tuple(foot), "normal": tuple(normal)}
    return msgspec.structs.replace(contact, force=force, compression=1e-3, indentation=1e-3, **place)


def touched(kind, foot, steps=40, **given):
    """Load and surface after a steady push with friction, and the mesh that their nodes are of."""
    at = Kernel(vertices=10_000).mesh()
    normal = at.normals[scipy.spatial.cKDTree(at.vertices).query(foot)[1]]
    spread, body = Kernel(**given), kind(**given, **(BEAMS if kind is BeamBundle else {}))
    spread.start()
    body.start()
    along = 0.1 * FORCE * np.cross(normal, (0.0, 1.0, 0.0))
    friction = Friction(force=tuple(along), bristle=(0.0, 0.0, 0.0), stick=False)
    for _ in range(steps):
        load = spread.step(pressed(foot, normal), friction, dt=1e-3)
        surface = body.step([load], dt=1e-3)
    kept = {"nodes": surface.nodes.copy(), "displacement": surface.displacement.copy()}
    return load.nodes.copy(), msgspec.structs.replace(surface, **kept), spread.mesh()


def tangent(surface):
    """Stiffness [N/m] of the next step at the force that presses."""
    return surface.exponent * FORCE / (surface.previous_indentation - surface.rest_indentation)


@cache
def whole(kind, foot, vertices):
    return touched(kind, foot, vertices=vertices, spacing=0.0)


@pytest.mark.long
@pytest.mark.parametrize("kind", [MassSpring, BeamBundle, ReducedFE])
@pytest.mark.parametrize("vertices", [70_000, 150_000])
def test_a_body_gives_the_same_result_for_some_vertices_as_for_all(kind, vertices):
    for foot in FEET:
        (loaded, surface, mesh), (some, answer, thin) = (
            whole(kind, foot, vertices),
            touched(kind, foot, vertices=vertices),
        )
        assert len(loaded) > vertices / 100 and 100 < len(some) < 300
        assert answer.previous_indentation == approx(surface.previous_indentation, rel=4e-3)
        assert tangent(answer) == approx(tangent(surface), rel=1e-2)
        field = np.zeros((len(mesh.vertices), 3))
        field[surface.nodes] = surface.displacement
        same = scipy.spatial.cKDTree(mesh.vertices).query(thin.vertices[answer.nodes])[1]
        listed = np.isin(same, surface.nodes)
        apart = np.linalg.norm(answer.displacement - field[same], axis=1)[listed]
        assert apart.max() < 0.03 * np.linalg.norm(field, axis=1).max()


def test_the_force_of_the_default_body_does_not_depend_on_the_vertices():
    for foot in FEET:
        _, surface, _ = whole(MassSpring, foot, 70_000)
        _, answer, _ = touched(MassSpring, foot, vertices=70_000)
        for field in ("stiffness", "exponent", "damping", "rest_indentation", "previous_indentation"):
            assert getattr(answer, field) == approx(getattr(surface, field), rel=1e-12)


def test_loads_and_messages_do_not_grow_with_the_mesh_and_the_foot_is_exact():
    sizes = [len(touched(MassSpring, FEET[0], 2, vertices=count)[0]) for count in (70_000, 150_000)]
    assert max(sizes) < 1.2 * min(sizes)
    assert len(NearestOnMesh(vertices=70_000).mesh().vertices) == approx(70_000, rel=0.01)


def test_a_narrow_patch_on_a_thinned_surface_is_reported():
    for given, reported in (({"radius": 3e-3}, True), ({"radius": 3e-3, "spacing": 0.4e-3}, False), ({}, False)):
        node = Kernel(vertices=70_000, **given)
        node.start()
        notes = node.notes()
        assert bool(notes) is reported and all("set scene.surface.spacing to 0.38 mm" in note for note in notes)
    coarse = Kernel(vertices=3000, radius=3e-3)
    coarse.start()
    [note] = coarse.notes()
    assert "the vertices are 2.3 mm apart" in note and "spacing" not in note


def test_the_thickness_is_that_of_the_organ_and_the_vertices_that_carry_loads_leave_no_holes(tmp_path):
    """The sample of a bumpy ellipsoid had 30 edges of one triangle, so that it had no thickness, and no note."""
    from palpate.physics.geometry.mesh import write_ply
    from palpate.studies.organs.zoo import ZOO

    write_ply(tmp_path / "bumpy.ply", ZOO["bumpy"].make(600))
    body = MassSpring(surface=str(tmp_path / "bumpy.ply"))
    assert body.mesh().closed and body.whole().closed
    assert body.thicknesses() == approx(body.whole().thicknesses[0], rel=1e-12)
    assert len(body.thicknesses()) == len(body.mesh().vertices) < len(body.whole().vertices)


def test_a_fine_mesh_that_scatters_is_smoothed_with_a_note_and_a_smooth_one_stays(tmp_path):
    """Edges of 0.4 mm, so that none is divided."""
    from palpate.physics.geometry.mesh import Mesh, write_ply
    from palpate.studies.organs.shapes import star

    ball = star(lambda way: np.full(len(way), 0.02), 40_000)
    scatter = np.random.default_rng(1).normal(scale=4e-6, size=len(ball.vertices))
    for name, moves, notes in (("smooth", 0.0 * scatter, 0), ("rough", scatter, 1)):
        file = tmp_path / f"{name}.ply"
        write_ply(file, Mesh(ball.vertices + moves[:, None] * ball.normals, ball.triangles))
        node = NearestOnMesh(surface=str(file))
        node.start()
        found = [line for line in node.notes() if "scatter" in line]
        assert len(found) == notes
        off = np.linalg.norm(node.mesh().vertices - np.array(node.position), axis=1) - 0.02
        assert off.std() < (1e-9 if not notes else 2.5e-6)
