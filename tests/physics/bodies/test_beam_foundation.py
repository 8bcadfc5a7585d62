"""The beam foundation as a deformable body: its response, its terminal law, its memory."""

import numpy as np
import pytest
from pytest import approx

from palpate.launch.testing import FakeBus
from palpate.messages import Load
from palpate.nodes.base import SettingError
from palpate.nodes.base.surface import surface_mesh
from palpate.nodes.deformation import BeamBundle
from palpate.physics.materials.voigt import STRAIN_LIMIT

UP = (0.0, 0.0, 1.0)
COUNT = 2601
MESH = surface_mesh("plane", COUNT)
PLANE = dict(surface="plane", vertices=COUNT, position=(0.0, 0.0, 0.0))
ELASTIC = dict(**PLANE, layers=(1e-3, 9e-3), moduli=(1.36e5, 3.4e4), relaxations=(0.0, 0.0))
SOFT = PLANE
SIDES = np.concatenate([MESH.triangles[:, [0, 1]], MESH.triangles[:, [1, 2]], MESH.triangles[:, [2, 0]]])
EDGES = np.unique(np.sort(SIDES, axis=1), axis=0)
RADIUS = 8e-3
COMPLIANCE = 1e-3 / 1.36e5 + 9e-3 / 3.4e4


def load(force, foot=(0.0, 0.0, 0.0), tangent=(0.0, 0.0), radius=RADIUS):
    distance = np.linalg.norm(MESH.vertices - foot, axis=1)
    nodes = np.flatnonzero(distance < radius)
    weight = MESH.areas[nodes] * (1 - (distance[nodes] / radius) ** 2) ** 2
    weight /= weight.sum()
    return Load(nodes=nodes, forces=weight[:, None] * [*tangent, -force], foot=foot, normal=UP)


def weights():
    one = load(1.0)
    return one.nodes, -one.forces[:, 2]


def law(surface, s):
    depth = max(s - surface.rest_indentation, 0.0)
    return surface.stiffness * depth**surface.exponent


def test_elastic_beams_indent_like_their_layers_in_series():
    (surface,) = FakeBus(BeamBundle(**ELASTIC)).publish(load(0.5))
    nodes, w = weights()
    assert list(surface.nodes) == list(nodes)
    assert surface.displacement[:, 2] == approx(-0.5 * w / MESH.areas[nodes] * COMPLIANCE)
    s = 0.5 * (w**2 / MESH.areas[nodes]).sum() * COMPLIANCE
    assert surface.previous_indentation == approx(s)
    assert (surface.rest_indentation, surface.exponent, surface.damping) == (0.0, approx(1.0), 0.0)
    assert law(surface, s) == approx(0.5) and surface.limited == 0


def test_the_law_before_contact_is_that_of_a_patch_with_the_radius():
    bus = FakeBus(BeamBundle(**ELASTIC, radius=RADIUS))
    nothing, zero, pressed = bus.publish(
        Load(nodes=[], forces=np.zeros((0, 3)), foot=(0, 0, 0), normal=UP), load(0.0), load(0.5)
    )
    assert len(nothing.nodes) == len(zero.nodes) == 0
    assert nothing.stiffness == approx(pressed.stiffness, rel=0.02)
    assert zero.stiffness == approx(pressed.stiffness, rel=1e-6)
    assert 0 < pressed.stiffness < np.inf


def test_the_law_predicts_the_next_step():
    """The law at the indentation of the next step gives the force of that step."""
    bus = FakeBus(BeamBundle(**SOFT))
    before = None
    for force in (0.2, 0.2, 0.25, 0.4, 0.4, 0.1, 0.1, 0.05):
        (surface,) = bus.publish(load(force))
        if before is not None:
            assert law(before, surface.previous_indentation) == approx(force, rel=1e-9)
        before = surface


def test_the_body_creeps_to_the_static_indentation_and_recovers():
    bus = FakeBus(BeamBundle(**SOFT), rate=100.0)
    steps = bus.publish(*[load(0.3)] * 1500)
    s = np.array([m.previous_indentation for m in steps])
    nodes, w = weights()
    assert np.all(np.diff(s) >= 0)
    assert s[-1] == approx(0.3 * (w**2 / MESH.areas[nodes]).sum() * COMPLIANCE, rel=1e-3)
    after = bus.publish(*[load(0.0)] * 4000)
    left = np.array([m.rest_indentation for m in after])
    assert np.all(np.diff(left) <= 0) and np.all(left >= 0)
    assert len(after[100].nodes) > 0 and len(after[-1].nodes) == 0


@pytest.mark.parametrize("dt", [1e-6, 1e-4, 1e-2, 0.1, 10.0])
def test_recovery_is_monotone_for_any_step(dt):
    bus = FakeBus(BeamBundle(**SOFT), rate=1 / dt)
    bus.publish(*[load(0.3)] * 5)
    left = [m.displacement[:, 2].min(initial=0.0) for m in bus.publish(*[load(0.0)] * 50)]
    assert np.all(np.diff(left) >= -1e-18) and max(left) <= 0


def test_the_work_of_the_contact_is_the_work_on_the_beams():
    bus = FakeBus(BeamBundle(**SOFT))
    nodes, w = weights()
    s, depth = 0.0, np.zeros(len(nodes))
    for force in np.concatenate([np.linspace(0.01, 0.5, 50), np.linspace(0.5, 0.01, 50)]):
        (surface,) = bus.publish(load(force))
        now = -surface.displacement[:, 2]
        assert force * (surface.previous_indentation - s) == approx((force * w * (now - depth)).sum(), abs=1e-12)
        s, depth = surface.previous_indentation, now


def test_on_a_round_body_the_work_of_the_contact_is_the_work_on_the_beams():
    ball = BeamBundle(surface="sphere", vertices=2000)
    bus = FakeBus(ball)
    mesh = ball.mesh()
    top = int(np.argmax(mesh.vertices[:, 2]))
    foot, normal = mesh.vertices[top], mesh.normals[top]
    distance = np.linalg.norm(mesh.vertices - foot, axis=1)
    nodes = np.flatnonzero(distance < RADIUS)
    w = mesh.areas[nodes] * (1 - (distance[nodes] / RADIUS) ** 2) ** 2
    w /= w.sum()
    s, before = 0.0, np.zeros((len(mesh.vertices), 3))
    for force in (0.1, 0.3, 0.5, 0.5, 0.2, 0.05):
        forces = -force * w[:, None] * normal
        (surface,) = bus.publish(Load(nodes=nodes, forces=forces, foot=foot, normal=normal))
        now = np.zeros_like(before)
        now[surface.nodes] = surface.displacement
        assert force * (surface.previous_indentation - s) == approx((forces * (now - before)[nodes]).sum(), abs=1e-12)
        assert np.all(now[nodes] @ normal <= 0)
        s, before = surface.previous_indentation, now


def test_beams_longer_than_the_body_are_an_error():
    with pytest.raises(SettingError, match="end beyond the other side"):
        BeamBundle(surface="kidney", layers=(1e-3, 60e-3)).start()


def test_a_closed_cycle_generates_no_energy():
    bus = FakeBus(BeamBundle(**SOFT))
    work, s = 0.0, 0.0
    for force in np.abs(np.sin(np.linspace(0, 6 * np.pi, 600))):
        (surface,) = bus.publish(load(force))
        work += force * (surface.previous_indentation - s)
        s = surface.previous_indentation
    assert work > 0


def test_a_tangential_force_shears_the_beams_elastically():
    (surface,) = FakeBus(BeamBundle(**ELASTIC)).publish(load(0.5, tangent=(0.2, 0.1)))
    nodes, w = weights()
    softness = 2 * 1.48 * COMPLIANCE
    assert surface.displacement[:, :2] == approx(np.outer(w / MESH.areas[nodes] * softness, [0.2, 0.1]))


def test_shear_creeps_with_the_mean_retardation_of_the_layers():
    """At once it would indent inclined beams under friction, while the fingertip is viscous."""
    bus = FakeBus(BeamBundle(**{**ELASTIC, "relaxations": (0.02, 0.2)}))
    times = 1e-3 * np.arange(1, 401)
    moved = np.array([s.displacement[:, 0].max() for s in bus.publish(*[load(0.5, tangent=(0.1, 0.0))] * len(times))])
    soft = np.array([1e-3 / 1.36e5, 9e-3 / 3.4e4])
    lag = soft @ [0.02, 0.2] / soft.sum()
    settled = 0.1 * (weights()[1] / MESH.areas[weights()[0]]).max() * 2 * (1 + 0.48) * soft.sum()
    assert moved == approx(settled * (1 - (1 + 1e-3 / lag) ** -(times / 1e-3)), rel=1e-6)


def test_a_continuous_motion_of_the_load_moves_the_surface_continuously():
    feet = [(x, 0.2e-3, 0.0) for x in np.linspace(0, 5e-3, 400)]
    steps = FakeBus(BeamBundle(**ELASTIC)).publish(*[load(0.3, foot) for foot in feet])
    s = np.array([m.previous_indentation for m in steps])
    assert np.abs(np.diff(s)).max() < 1e-2 * s.max()


def test_a_symmetric_load_gives_a_symmetric_surface():
    (surface,) = FakeBus(BeamBundle(**SOFT)).publish(load(0.5))
    full = np.zeros((51, 51))
    full.ravel()[surface.nodes] = surface.displacement[:, 2]
    assert full == approx(full[::-1], abs=1e-15) and full == approx(full.T, abs=1e-15)


def test_layers_stop_at_the_strain_limit_with_a_note():
    bus = FakeBus(BeamBundle(**SOFT), rate=1.0)
    for surface in bus.publish(*[load(1e3)] * 30):
        assert np.all(np.isfinite(surface.displacement)) and np.isfinite(surface.stiffness)
        assert -surface.displacement[:, 2].min() <= STRAIN_LIMIT * 10e-3 * (1 + 1e-12)
        assert surface.limited > 0 and 1 <= surface.exponent <= 3


def test_a_surface_dragged_beyond_its_neighbours_is_limited_with_a_note():
    light, heavy = FakeBus(BeamBundle(**ELASTIC)).publish(
        load(0.1, tangent=(0.05, 0.0)), load(0.1, tangent=(30.0, 0.0))
    )
    full = np.zeros(MESH.vertices.shape)
    full[heavy.nodes] = heavy.displacement
    i, j = EDGES.T
    apart = np.linalg.norm(full[i] - full[j], axis=1) / np.linalg.norm(MESH.vertices[i] - MESH.vertices[j], axis=1)
    assert light.limited == 0 and heavy.limited > 0
    assert 0.49 < apart.max() <= 0.8 and np.all(heavy.displacement[:, 0] >= 0)
    assert 0.4 * RADIUS < heavy.displacement[:, 0].max() < 0.55 * RADIUS


@pytest.mark.parametrize("size", [1e-300, 1e-12, 1e6, 1e300])
def test_any_finite_load_gives_a_finite_answer(size):
    bus = FakeBus(BeamBundle(**SOFT))
    for surface in bus.publish(load(size), load(0.0), load(size, tangent=(size, -size)), load(-size), load(0.3)):
        assert 0 < surface.stiffness < np.inf and 1 <= surface.exponent <= 3


def test_duplicate_and_reordered_messages_are_ignored():
    bus = FakeBus(BeamBundle(**SOFT))
    first = bus.publish(*[load(0.3)] * 3)[-1]
    bus.twice()
    one, two = bus.publish(load(0.3))
    assert (
        one.previous_indentation > first.previous_indentation and two.previous_indentation == one.previous_indentation
    )
    bus.swap()
    answers = bus.publish(load(0.3), load(0.4))
    assert all(np.isfinite(m.previous_indentation) for m in answers)


def test_the_same_inputs_give_the_same_bytes():
    runs = []
    for _ in range(2):
        bus = FakeBus(BeamBundle(**SOFT))
        feet = [(x, 0.0, 0.0) for x in np.linspace(-0.01, 0.01, 60)]
        runs.append([(m.nodes.tobytes(), m.displacement.tobytes(), m.stiffness) for m in
                     bus.publish(*[load(0.3, f) for f in feet])])  # fmt: skip
    assert runs[0] == runs[1]


@pytest.mark.parametrize(
    ("given", "text"),
    [
        (dict(layers=(1e-3,)), "one of each for every layer"),
        (dict(layers=(1e-3, 0.0)), "> 0"),
        (dict(moduli=(0.0, 1e4)), "> 0"),
        (dict(relaxations=(-1.0, 0.0)), ">= 0"),
        (dict(surface="cube"), "cube"),
    ],
)
def test_wrong_settings_are_errors_at_the_start(given, text):
    with pytest.raises(SettingError, match=text):
        BeamBundle(**given).start()


def test_a_load_of_another_mesh_is_an_error_with_a_remedy():
    with pytest.raises(SettingError, match="the same surface"):
        FakeBus(BeamBundle(surface="plane", vertices=16)).publish(load(0.1))
