"""A round body pressed along its axis: closed forms, the tetrahedra of the full solver, a fold against the plate."""

import math

import numpy as np
from pytest import approx

from palpate.models.fe import Solver, TetMesh, box, ogden
from palpate.models.fe.axisymmetric import Indenter, RoundBody, _AxisymmetricPress, cylinder, layer, press_round
from palpate.models.fe.solve.solver import Settings
from palpate.physics.materials.hyperelastic import uniaxial
from palpate.physics.materials.neo_hooke import neo_hooke

RADIUS, HEIGHT = 25e-3, 30e-3
DEPTHS = np.array([0.3e-3, 3e-3, 6e-3, 12e-3])


def compressed(material, bonded, count=6, depths=DEPTHS):
    body = cylinder(RADIUS, HEIGHT, count)
    return press_round(body, material, Indenter(body.top, bonded, body.side), depths / 2.0)


def test_a_cylinder_between_frictionless_plates_is_in_uniaxial_stress():
    law = ogden(0.4999, 14.3e3, 4.716)
    expected = -uniaxial(law, 1.0 - DEPTHS / HEIGHT) * math.pi * RADIUS**2
    assert compressed(law, False, 3) == approx(expected, rel=2e-3)


def test_a_bonded_cylinder_has_the_stiffness_of_its_shape_factor():
    """1 + 2 S², S = D/4H, is good to some percent (A. N. Gent, P. B. Lindley, Proc. IMechE 173 (1959) 111-122)."""
    law = neo_hooke(3e4, 0.499)
    ratio = compressed(law, True, 10, DEPTHS[:1]) / compressed(law, False, 3, DEPTHS[:1])
    assert ratio == approx(1.0 + 2.0 * (RADIUS / 2.0 / HEIGHT) ** 2, rel=0.05)


def test_a_bonded_cylinder_agrees_with_the_tetrahedra():
    """A quarter of the upper half, its square mapped to a disc; both converge to the same force from above."""
    law = neo_hooke(3e4, 0.45)
    block = box((1.0, 1.0, 1.0), (3, 3, 3))
    x, y, z = block.points.T
    wide = np.maximum(x, y)
    scale = np.where(wide > 0.0, wide / np.maximum(np.hypot(x, y), 1e-12), 1.0)
    points = np.stack([RADIUS * x * scale, RADIUS * y * scale, 0.5 * HEIGHT * z], axis=1)
    mesh = TetMesh(points, block.elements, block.region)
    top, bottom = z > 1.0 - 1e-9, z < 1e-9
    fixed = np.stack([(x < 1e-9) | top, (y < 1e-9) | top, bottom | top], axis=1)

    def held(depth):
        return np.where(top[:, None], [0.0, 0.0, -depth], 0.0)

    body = Solver(mesh, {0: law}, fixed, held, settings=Settings(step=1e-3, largest=3e-3, least=1e-6))
    forces = []
    for depth in DEPTHS[:3] / 2.0:
        body.advance(depth)
        forces.append(-4.0 * body.reaction[top, 2].sum())
    assert compressed(law, True, 8, DEPTHS[:3]) == approx(np.array(forces), rel=0.04)


def test_the_side_folds_onto_the_plate_and_not_through_it():
    body, depth = cylinder(RADIUS, HEIGHT, 4), 7.5e-3
    above = []
    for line in (body.side, body.base):  # where the plate may be touched; the base never does
        state = _AxisymmetricPress(body, ogden(0.499, 14.3e3, 3.0), Indenter(body.top, True, line))
        assert math.isfinite(state.advance(0.5 * depth))
        assert math.isfinite(state.advance(depth))
        height = (body.points + state.u)[body.side, 1]
        above.append(height.max() - (0.5 * HEIGHT - depth))
    assert above[0] < 0.03 * RADIUS / 4 < above[1]  # 3 % of an edge: a penalty


def test_a_ball_on_a_deep_layer_is_hertz():
    radius, young = 8e-3, 1e4
    depths = np.array([0.2e-3, 0.4e-3])
    contact = 1.1 * math.sqrt(radius * depths[-1])
    body = layer(12 * contact, contact, 10)
    under = body.top[: 2 * int(np.searchsorted(body.across[::2], 2.0 * contact)) + 1]
    forces = press_round(body, neo_hooke(young, 0.49), Indenter(np.zeros(0, int), False, under, radius), depths)
    hertz = 4 / 3 * young / (1 - 0.49**2) * math.sqrt(radius) * depths**1.5
    # a layer of 12 contact radii is 10 % stiffer than a half-space (Dimitriadis et al. 2002)
    chi = np.sqrt(radius * depths) / (12 * contact)
    assert forces == approx(hertz * (1 + 1.133 * chi + 1.283 * chi**2), rel=0.05)


def test_a_press_without_equilibrium_ends_in_nan():
    body = RoundBody(np.linspace(0, RADIUS, 5), np.linspace(0, HEIGHT, 5))
    with np.errstate(all="ignore"):
        forces = press_round(body, neo_hooke(1e4, 0.4), Indenter(body.top, True, body.side), [1e-3, HEIGHT, 2 * HEIGHT])
    assert math.isfinite(forces[0])
    assert np.isnan(forces[1:]).all()
