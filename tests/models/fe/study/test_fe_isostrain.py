"""Strain in a mesh, surfaces and lines of one value, sections, and their flow, against closed forms; the statements."""

import numpy as np
import pytest
from fingertip_claims import statements
from fingertip_sections import cross, flow, parts, section, smooth
from pytest import approx

from palpate.models.fe.element.elements import gradients
from palpate.models.fe.element.mesh import TetMesh, box
from palpate.models.fe.meshing.fingertip import NAIL, SUBCUTIS, FingertipDimensions
from palpate.models.fe.study.isostrain import strain, subdivide_element, volumes_above
from palpate.models.fe.study.press_record import LEVELS, Record, differing
from palpate.physics.contact.tactile import equivalent_strain


def block(cells=(4, 4, 4)):
    mesh = box((1.0, 1.0, 1.0), cells)
    return TetMesh(mesh.points, mesh.elements, np.full(len(mesh.elements), SUBCUTIS))


def size(triangles):
    """Total area of triangles (M,3,2 or 3)."""
    a, b = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    square = (a * a).sum(1) * (b * b).sum(1) - (a * b).sum(1) ** 2
    return 0.5 * np.sqrt(np.maximum(square, 0.0)).sum()


def test_a_plane_through_a_cube_cuts_out_its_section():
    mesh = block()
    corner = mesh.points[mesh.elements[:, :4]]
    normal = np.array([1.0, 2.0, 3.0]) / np.sqrt(14.0)
    level = corner @ normal - 3.0 / np.sqrt(14.0)  # through the middle: crosses the four edges along z
    place, carried = cross(level, corner, corner @ [5.0, -1.0, 2.0])
    assert np.abs(place @ normal - 3.0 / np.sqrt(14.0)).max() < 1e-12
    assert carried == approx(place @ [5.0, -1.0, 2.0])
    assert size(place) == approx(1.0 / normal[2])


def test_the_surface_of_a_ball_and_a_circle_in_it():
    mesh = block((14, 14, 14))
    corner = mesh.points[mesh.elements[:, :4]] - 0.5
    (sphere,) = cross(0.4 - np.linalg.norm(corner, axis=2), corner)
    assert size(sphere) == approx(4 * np.pi * 0.16, rel=0.02)
    flat, radius = cross(corner[:, :, 2] - 0.013, corner[:, :, :2], np.linalg.norm(corner, axis=2))
    assert size(flat) == approx(1.0)
    (circle,) = cross(0.3 - radius, flat)
    assert np.linalg.norm(circle[:, 1] - circle[:, 0], axis=1).sum() == approx(
        2 * np.pi * np.sqrt(0.09 - 0.013**2), rel=0.02
    )


def test_the_eight_parts_of_an_element_fill_it():
    mesh = block((2, 1, 1))
    values = mesh.points[mesh.elements[:, :4]] @ [1.0, 2.0, -3.0]
    corner, carried = parts(mesh.points, mesh.elements, values)
    volumes = np.linalg.det(corner[:, 1:] - corner[:, :1]) / 6
    assert (volumes > 0).all() and volumes.sum() == approx(1.0)
    assert carried == approx(corner @ [1.0, 2.0, -3.0])


def test_uniform_stretch_has_its_strain_and_volume():
    mesh = block()
    lengths = np.array([1.2, 0.9, 1.0])
    u = mesh.points * (lengths - 1.0)
    e = np.log(lengths)
    right = np.sqrt(0.5 * ((e[0] - e[1]) ** 2 + (e[1] - e[2]) ** 2 + (e[2] - e[0]) ** 2)) / 1.5
    assert strain(mesh, u) == approx(right)
    assert volumes_above(mesh, u, right * np.array([0.99, 1.01])) == approx([lengths.prod(), 0.0])


@pytest.mark.parametrize("cuts", [1, 2, 3, 5])
def test_a_cut_tetrahedron_is_filled_by_its_pieces(cuts):
    at, pieces = subdivide_element(cuts)
    corner = at[pieces]
    volume = np.abs(np.linalg.det(corner[:, 1:] - corner[:, :1])) / 6.0
    assert len(pieces) == cuts**3
    assert volume == approx(1.0 / (6 * cuts**3))
    assert (at >= 0).all() and (at.sum(axis=1) <= 1 + 1e-12).all()


def test_volumes_of_a_strain_that_varies_in_the_elements_converge_to_second_order():
    """u = a x²/2 along x stretches by 1 + a x: strain ln(1 + a x)/1.5, known volumes."""
    mesh, a = block((2, 2, 2)), 1.5
    u = np.outer(0.5 * a * mesh.points[:, 0] ** 2, (1.0, 0.0, 0.0))
    levels = np.array([0.07, 0.21, 0.33, 0.47])
    x = (np.exp(1.5 * levels) - 1.0) / a
    exact = 1.0 + a / 2 - (x + a / 2 * x * x)
    errors = [np.abs(volumes_above(mesh, u, levels, cuts) - exact).max() for cuts in (1, 2, 4, 8)]
    assert np.log2(errors[0] / errors[2]) / 2 == approx(2.0, abs=0.5)
    assert np.log2(errors[1] / errors[3]) / 2 == approx(2.0, abs=0.5)


def test_volumes_agree_with_counting_many_points_in_each_element():
    """A bent and bulged block: shares of 2925 points per element, weighted with the volume of each element."""
    mesh = block((2, 2, 2))
    x, y, z = mesh.points.T
    u = np.stack([0.4 * x * z, 0.2 * y * x, -0.3 * x * x + 0.3 * z * y], axis=1)
    levels = np.array([0.1, 0.2, 0.3])
    n = 25
    cells = np.array([(i, j, k) for i in range(n) for j in range(n - i) for k in range(n - i - j)])
    at = (cells + 0.25) / n
    at = at[at.sum(axis=1) < 1.0]
    slope, det = gradients(mesh.points, mesh.elements, at)
    F = np.eye(3) + np.einsum("eai,enaj->enij", u[mesh.elements], slope)
    e = equivalent_strain(F)
    weight = det * np.linalg.det(F)
    share = [(weight * (e >= level)).sum() / len(at) / 6.0 for level in levels]
    assert volumes_above(mesh, u, levels) == approx(np.array(share), rel=0.02)


def test_smoothing_keeps_to_the_layers():
    mesh = block()
    upper = mesh.points[mesh.elements[:, :4]].mean(axis=1)[:, 2] > 0.5
    layered = TetMesh(mesh.points, mesh.elements, np.where(upper, SUBCUTIS + 1, SUBCUTIS))
    values = np.repeat(np.where(upper, 2.0, 1.0)[:, None], 4, axis=1)
    assert smooth(layered, values) == approx(values)
    ramp = mesh.points[mesh.elements[:, :4]][:, :, 0]
    assert smooth(layered, ramp) == approx(ramp)


def test_a_front_of_strain_that_moves_is_followed():
    """u_z = a P z²/2 strains by a P z: the height of a value falls as 1/P, dz/dP = -z/P."""
    mesh = block()
    up = np.outer(0.5e-4 * mesh.points[:, 2] ** 2, [0.0, 0.0, 1.0])
    mean, motion = flow(mesh, 0.95 * up, 1.05 * up, 0.95, 1.05)
    height = mesh.points[mesh.elements[:, :4]].mean(axis=1)[:, 2]
    inner = (height > 0.3) & (height < 0.7)
    speed = motion[inner].mean(axis=1)[:, 2]
    assert np.mean(speed / -height[inner]) == approx(1.0, abs=0.02)
    assert speed == approx(-height[inner], rel=0.25)  # smoothing takes the mean over neighbours that lie to one side
    assert np.abs(motion[inner][:, :, :2]).max() < 1e-2
    assert mean.mean(axis=1) == approx(height * 1e-4 / 1.5, rel=1e-2)


def test_the_section_of_the_finger_has_its_area():
    tip = FingertipDimensions(cells=5)
    zero = np.zeros_like(tip.mesh.points)
    cut = section(tip.mesh, zero, np.zeros((len(tip.mesh.elements), 4)))
    r, length = tip.radii[-1], tip.phalanx
    nail = size(section_of(tip.mesh, NAIL).triangles)
    assert size(cut.triangles) - nail == approx(2 * r * length + 0.5 * np.pi * r**2, rel=5e-3)
    assert len(cut.plate) == 0 and len(cut.borders) > 100


def section_of(mesh, region):
    own = mesh.region == region
    part = TetMesh(mesh.points, mesh.elements[own], mesh.region[own])
    return section(part, np.zeros_like(mesh.points), np.zeros((own.sum(), 4)))


def made(stiffness, spread, depth=2e-3):
    """A record in closed form: force as depth squared, areas and volumes as the force."""
    indentation = np.linspace(0.0, depth, 101)
    force = stiffness * indentation**2
    volumes = np.outer(force, spread * 1e-6 * np.array([1.0, 0.5, 0.2, 0.1, 0.0, 0.0]))
    return Record(indentation, force, 1e-4 * spread * force, LEVELS, volumes)


def test_statements_agree_with_the_records():
    hard, soft = made(3e5, 1.0), made(1.5e5, 1.3)
    rows = {row["statement"]: row for row in statements(hard, soft)}
    assert all(row["holds"] for row in rows.values() if row["holds"] is not None)
    area = next(row for name, row in rows.items() if name.startswith("area"))
    assert (area["steel"], area["silicone"]) == approx((100.0, 130.0), rel=1e-3)
    undecided = [name for name, row in rows.items() if row["holds"] is None]
    assert len(undecided) == 2 and all("0.3" in name or "0.4" in name for name in undecided)
    swapped = statements(soft, hard)
    assert not any(row["holds"] for row in swapped)
    shallow = statements(made(3e5, 1.0, 1e-3), soft)
    assert all("ΔV/ΔP" not in row["statement"] for row in shallow)


def test_two_different_runs_are_reported_with_their_first_difference():
    first = {"plate": "steel", "finger": {"cells": 3, "bone": 6e-3}}
    assert differing(first, first) is None
    assert differing(first, {"plate": "steel", "finger": {"cells": 4, "bone": 6e-3}}) == ("finger.cells", 3, 4)
    assert differing(first, {"plate": "steel"}) == ("finger", first["finger"], None)
