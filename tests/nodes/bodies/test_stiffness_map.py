"""The stiffness map of MassSpring: stiffness of the organ at each point, and an energy that depends only on it."""

from functools import lru_cache

import numpy as np
import pytest
from formulas import series
from pressing import Spreader
from pytest import approx

from palpate.messages import Load
from palpate.nodes.base import SettingError
from palpate.nodes.contact import Series
from palpate.nodes.deformation import MassSpring, ReducedFE
from palpate.physics.bodies.mass_spring import GROUND, factor_at
from palpate.physics.bodies.place_energy import on_hand, surface_gradient
from palpate.physics.contact.series import exponential
from palpate.physics.contact.terminal import Terminal
from palpate.physics.geometry.mesh import plane
from palpate.physics.geometry.mesh_closest import MeshClosestPoint
from palpate.studies.fit_body import power_law

STEP = 1e-3
LINEAR = {"stiffness": 250.0, "exponent": 1.0, "damping": 0.0, "position": (0.0, 0.0, 0.0)}


@lru_cache
def ground(surface):
    mesh = MassSpring(surface=surface, **LINEAR).mesh()
    return mesh, MeshClosestPoint(mesh), Spreader(mesh, 8e-3, "biweight")


class Hand:
    """A hand that moves a fingertip over springs with a map, and its positive and negative work [J]."""

    def __init__(self, surface, slopes=True, **law):
        self.mesh, self.closest, self.spread = ground(surface)
        self.body = MassSpring(surface=surface, stiffness_map="basis", **LINEAR | law)
        self.body.start()
        self.finger = exponential(Series().finger_stiffness, Series().finger_hardening)
        self.law, self.compression, self.slopes = Terminal(250.0, 1.0, 0.0, 0.0, 0.0), 0.0, slopes
        self.at, self.force, self.taken, self.given = None, np.zeros(3), 0.0, 0.0

    def to(self, foot, normal, approach):
        at, n = foot - approach * normal, tuple(normal.tolist())
        push, self.compression, _ = series(approach, STEP, self.compression, self.finger, 0.0, self.law)
        count = self.spread.spread(foot, normal, -max(push, 1e-9) * normal)
        nodes, forces = self.spread.nodes[:count].copy(), self.spread.forces[:count].copy()
        sent = self.body.step([Load(nodes=nodes, forces=forces, foot=tuple(foot.tolist()), normal=n)], dt=STEP)
        self.law = Terminal(
            sent.stiffness, sent.exponent, sent.damping, sent.rest_indentation, sent.previous_indentation
        )
        force = push * normal
        if self.slopes:
            force = force + on_hand(np.array(sent.tangential_gradient), np.array(sent.shape_operator), approach, n)
        if self.at is not None:
            part = -0.5 * (force + self.force) @ (at - self.at)
            self.taken, self.given = self.taken + max(part, 0.0), self.given - min(part, 0.0)
        self.at, self.force = at, force

    def gained(self, path, approach, steps=150):
        """Generated energy over the work put in: down at the first point, along the path, up at the last."""
        feet, normals, *_ = self.closest.find(path)
        ramp = np.linspace(0.0, approach, steps)
        for e in ramp:
            self.to(feet[0], normals[0], e)
        for foot, normal in zip(feet, normals, strict=True):
            self.to(foot, normal, approach)
        for e in ramp[::-1]:
            self.to(feet[-1], normals[-1], e)
        return (self.given - self.taken) / self.taken


def closed_path(seed, steps=600):
    """A random smooth closed path (T,3) over the plane, out to its border at 50 mm."""
    rng = np.random.default_rng(seed)
    phase = np.linspace(0.0, 2.0 * np.pi, steps)
    waves = sum(
        rng.normal(0.0, 12e-3 / k, (2, 1)) * np.cos(k * phase + rng.uniform(0.0, 6.3, (2, 1))) for k in (1, 2, 3)
    )
    x, y = np.clip(waves + np.array([[0.04], [rng.uniform(-0.04, 0.04)]]), -0.05, 0.05)
    return np.stack([x, y, np.zeros(steps)], axis=1)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("law", [{}, {"exponent": 1.5, "stiffness": 3e3}, {"retardation": 0.02}])
def test_a_closed_path_over_the_edge_at_constant_depth_gains_no_energy(seed, law):
    """Elastic springs lose 0.01 to 0.4 % of the work, proportional to the step."""
    gained = Hand("plane", **law).gained(closed_path(seed), 10e-3)
    assert gained <= 0.0
    assert gained > -5e-3 or "retardation" in law


@pytest.mark.parametrize("there", [1, -1])
def test_pressing_sliding_and_lifting_elsewhere_gains_energy_only_without_the_lateral_force(there):
    path = np.linspace((0.0, 0.0, 0.0), (0.05, 0.02, 0.0), 500)[::there]
    assert -1e-3 < Hand("plane").gained(path, 10e-3) <= 0.0
    assert abs(Hand("plane", slopes=False).gained(path, 10e-3)) > 0.3


@pytest.mark.parametrize("there", [1, -1])
def test_the_energy_gain_on_a_curved_surface_comes_from_its_triangles(there):
    """The gain is 0.62 % with 3000 vertices, and 2.9 % with the normal force alone."""
    path = np.linspace((-0.0432, -0.0027, 0.0145), (0.0275, -0.0076, 0.0195), 500)[::there]
    assert abs(Hand("kidney").gained(path, 10e-3)) < 0.01 < 0.025 < abs(Hand("kidney", False).gained(path, 10e-3))


def test_the_factor_depends_only_on_the_position_and_its_gradient_is_right():
    hand, at, step = Hand("plane"), np.array([0.041, 0.013, 0.0]), 1e-5
    up, out, factors = np.array([0.0, 0.0, 1.0]), np.zeros(12), hand.body.hardness()
    table = np.zeros(len(factors), GROUND)
    table["position"], table["factor"] = hand.mesh.vertices, factors

    def factor(foot):
        count = hand.spread.spread(foot, up, -up)
        return factor_at(hand.spread.nodes[:count], foot, up, table, 8e-3, out)

    ways = np.eye(3)[:2] * step
    change = [(factor(at + way) - factor(at - way)) / (2.0 * step) for way in ways]
    mean = factor(at)
    assert out[:2] * mean == approx(change, rel=1e-5) and out[2] == 0.0
    assert change[0] < -3.0 and 0.7 < mean < 1.0


def test_the_gradient_of_a_linear_field_is_exact():
    mesh = plane(0.02, 100)
    field = np.stack([3.0 * mesh.vertices[:, 0] - mesh.vertices[:, 1], mesh.vertices[:, 1]], axis=1)
    assert surface_gradient(mesh, field) == approx(np.tile([[3.0, -1.0, 0.0], [0.0, 1.0, 0.0]], (100, 1, 1)), abs=1e-9)


def test_a_surface_without_a_basis_is_an_error_with_the_command_to_build_it(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    for call in (MassSpring.check, MassSpring.start):
        with pytest.raises(SettingError, match="palpate build basis --set surface=fingertip"):
            call(MassSpring(surface="fingertip", stiffness_map="basis"))


def test_the_fit_finds_the_stiffness_on_a_half_space():
    depth = np.linspace(1e-4, 4e-3, 200)
    relative = np.linspace(0.8, 1.2, 200)
    found = power_law(depth, np.zeros(200), 300.0 * relative**2 * depth**1.5, relative)
    assert found["exponent"] == approx(1.5, abs=2e-3) and found["stiffness"] == approx(300.0, rel=0.01)


def test_friction_indents_a_slanted_place_as_it_does_in_the_reference():
    """At rest, at random places of the kidney, against the whole compliance matrix of ReducedFE."""
    mesh, _, spread = ground("kidney")
    kinds = (
        ReducedFE(surface="kidney", position=LINEAR["position"], model="linear", retardation=0.0),
        MassSpring(surface="kidney", stiffness_map="basis", **LINEAR),
    )
    rng, changes = np.random.default_rng(5), []
    places = rng.choice(len(mesh.vertices), 12, replace=False)
    for at in (np.argmax(mesh.vertices[:, 0]), np.argmin(mesh.vertices[:, 0]), *places):
        foot, n = mesh.vertices[at], mesh.normals[at]
        along = np.cross(n, rng.normal(size=3))
        along *= 0.5 / np.linalg.norm(along)
        depths = []
        for kind in kinds:
            for force in (-n, along - n):
                kind.start()
                count = spread.spread(foot, n, force)
                load = Load(nodes=spread.nodes[:count].copy(), forces=spread.forces[:count].copy(),
                            foot=tuple(foot.tolist()), normal=tuple(n.tolist()))  # fmt: skip
                depths.append(kind.step([load], dt=STEP).previous_indentation)
        changes.append((depths[1] / depths[0] - 1.0, depths[3] / depths[2] - 1.0))
    expected, found = np.array(changes).T
    assert np.abs(expected).max() > 0.13
    assert found == approx(expected, abs=0.03)  # both the map and the reference average over a patch
    assert np.sqrt(np.mean((found - expected) ** 2)) < 0.2 * np.sqrt(np.mean(expected**2))
