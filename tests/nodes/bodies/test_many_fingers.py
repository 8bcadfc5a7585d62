"""Several fingers on one body: contact.Joint, contact.Share and the bodies that take several loads."""

from functools import cache
from itertools import pairwise

import msgspec
import numpy as np
import pytest
from pressing import Spreader
from pytest import approx
from scipy.optimize import root

from palpate.launch.testing import FakeBus
from palpate.messages import Contact, Contacts, Load, MessageError, Pose, Surface, pack, unpack
from palpate.nodes import collision
from palpate.nodes.base import inputs
from palpate.nodes.base.surface import surface_mesh
from palpate.nodes.contact import Series
from palpate.nodes.contact.joint import Joint, Share
from palpate.nodes.deformation import BeamBundle, MassSpring, ReducedFE, Rigid
from palpate.nodes.spread import Kernel

BODIES = [MassSpring, BeamBundle, ReducedFE, Rigid]
COUPLED = [MassSpring, BeamBundle, ReducedFE]
TOP = 0.105
VERTICES = 3000


def made(kind, mesh, **more):
    """The body; beams without viscosity, since the comparisons are at rest, which viscous beams reach only in
    seconds."""
    elastic = {"relaxations": (0.0, 0.0)} if kind is BeamBundle else {}
    return kind(**({} if kind is Rigid else mesh), **elastic, **more)


class Hand:
    """Fingers on the kidney or a mesh, each with a separate collision and spread, on one body."""

    def __init__(self, kind, count, mesh=None, **more):
        finds = [collision.Nurbs() if mesh is None else collision.Mesh(**mesh) for _ in range(count)]
        mesh = mesh or {"vertices": VERTICES}
        self.body = FakeBus(made(kind, mesh, **more))
        self.joint, self.share = FakeBus(Joint()), [FakeBus(Share(finger=i)) for i in range(count)]
        self.collision = [FakeBus(find) for find in finds]
        self.spread = [FakeBus(Kernel(**mesh)) for _ in range(count)]
        self.surface = None

    def step(self, places):
        """One tick with the bones [m] (c,3) at these positions; returns the contacts."""
        near = [
            msgspec.structs.replace(find.publish(Pose(position=tuple(p), velocity=(0.0, 0.0, 0.0), dt=1e-3))[0],
                                    source=f"collision-{i}", tick=-1)
            for i, (find, p) in enumerate(zip(self.collision, np.asarray(places, float).tolist(), strict=True))
        ]  # fmt: skip
        self.joint.hold("body", self.surface)
        (solved,) = self.joint.publish(near)
        contacts = []
        for bus, one in zip(self.share, near, strict=True):
            bus.hold("proximity", one)
            contacts += bus.publish(msgspec.structs.replace(solved, tick=-1, time=-1))
        loads = [
            bus.publish(msgspec.structs.replace(c, tick=-1, time=-1))[0]
            for bus, c in zip(self.spread, contacts, strict=True)
        ]
        (self.surface,) = self.body.publish([msgspec.structs.replace(one, tick=-1, time=-1) for one in loads])
        return contacts

    def hold(self, places, ticks=200):
        """The final forces [N] (c,), at rest to 1e-8 except with viscous beams."""
        for _ in range(ticks):
            contacts = self.step(places)
        return np.array([c.force for c in contacts])


def bone(x, depth, y=0.0):
    """A bone edge over the middle of the kidney, `depth` of it beyond touching."""
    return [x, y, TOP + 4e-3 - depth]


@cache
def lone(kind, x, depth):
    """The force [N] of one finger that is held there."""
    return Hand(kind, 1).hold([bone(x, depth)])[0]


@pytest.mark.parametrize("kind", BODIES)
def test_one_finger_has_the_same_force_with_and_without_a_joint(kind):
    hand = Hand(kind, 1)
    alone, spread, other = Series(), Kernel(vertices=VERTICES), made(kind, {"vertices": VERTICES})
    for node in (alone, spread, other):
        node.start()
    find, surface = collision.Nurbs(), None
    find.start()
    for tick in range(120):
        place = bone(0.0, 6e-3 * min(tick / 60, 1.0))
        (joined,) = hand.step([place])
        near = find.step(Pose(position=tuple(place), velocity=(0.0, 0.0, 0.0), dt=1e-3))
        near = msgspec.structs.replace(near, tick=tick, time=tick * 1_000_000)
        contact = alone.step(near, surface, dt=1e-3)
        surface = other.step([spread.step(contact, None, dt=1e-3)], dt=1e-3)
        surface = msgspec.structs.replace(surface, tick=tick, time=tick * 1_000_000)
        assert joined.force == approx(contact.force, rel=1e-9, abs=1e-12)
    assert joined.force > 0.3
    assert b"laws" not in pack(hand.surface) and not len(hand.surface.laws)


@pytest.mark.parametrize("kind", [MassSpring, BeamBundle, pytest.param(ReducedFE, marks=pytest.mark.long), Rigid])
def test_two_fingers_60_mm_apart_have_the_forces_of_single_fingers(kind):
    places = [(-0.03, 7e-3), (0.03, 6e-3)]
    both = Hand(kind, 2).hold([bone(*place) for place in places])
    each = [lone(kind, *place) for place in places]
    assert min(both) > 0.1
    assert both == approx(each, rel=0.01)


@pytest.mark.parametrize("kind", COUPLED)
def test_the_force_of_each_finger_decreases_with_their_distance(kind):
    hand = Hand(kind, 2)
    forces = [hand.hold([bone(-d / 2, 6e-3), bone(d / 2, 6e-3)]).sum() for d in (0.0, 5e-3, 10e-3, 20e-3)]
    assert (np.diff(forces) > 0.0).all()


@pytest.mark.parametrize("kind", COUPLED)
def test_fingers_at_one_point_share_the_force(kind):
    """Two fingertips on one body have half the compliance of the fingertip and the full compliance of the body."""
    first, second = Hand(kind, 2).hold([bone(0.0, 6e-3), bone(0.0, 6e-3)])
    alone = lone(kind, 0.0, 6e-3)
    assert first == approx(second, rel=1e-9)
    assert alone < first + second < 1.5 * alone


@pytest.mark.parametrize("kind", COUPLED)
def test_a_hovering_finger_has_no_effect_and_one_above_an_indentation_touches_later(kind):
    alone = lone(kind, 0.0, 7e-3)
    hand = Hand(kind, 2)
    beside, hovering = hand.hold([bone(0.0, 7e-3), bone(4e-3, -1e-3)])
    assert beside == approx(alone, rel=1e-3) and hovering == 0.0
    _, light = hand.hold([bone(0.0, 7e-3), bone(4e-3, 0.3e-3)], 50)
    assert light == 0.0  # it would touch the undeformed surface


@pytest.mark.parametrize("kind", BODIES)
def test_one_lifts_while_the_other_presses(kind):
    hand = Hand(kind, 2)
    hand.hold([bone(-6e-3, 6e-3), bone(6e-3, 6e-3)], 100)
    for tick in range(300):
        contacts = hand.step([bone(-6e-3, 6e-3 - 10e-3 * min(tick / 100, 1.0)), bone(6e-3, 6e-3)])
        assert all(np.isfinite(c.force) and c.force >= 0.0 for c in contacts)
    alone = lone(kind, 6e-3, 6e-3)
    assert contacts[0].force == 0.0
    assert contacts[1].force == approx(alone, rel=2e-3)


@pytest.mark.parametrize("kind", BODIES)
def test_crossing_fingers_have_finite_forces_and_exchange_their_positions(kind):
    """Each moves along the kidney through the position of the other, at 0.2 m/s."""
    hand, forces = Hand(kind, 2), []
    hand.hold([bone(-20e-3, 6e-3), bone(20e-3, 6e-3)], 100)
    for tick in range(200):
        x = -20e-3 + 40e-3 * tick / 199
        forces.append([c.force for c in hand.step([bone(x, 6e-3), bone(-x, 6e-3)])])
    forces = np.array(forces)
    assert np.isfinite(forces).all() and (forces >= 0.0).all()
    # no jump in a tick during the motion, including the crossing
    assert np.abs(np.diff(forces[5:], axis=0)).max() < 0.04 * forces.max()
    ended = hand.hold([bone(20e-3, 6e-3), bone(-20e-3, 6e-3)])
    alone = [lone(kind, x, 6e-3) for x in (20e-3, -20e-3)]
    assert ended == approx(alone, rel=0.2 if kind is ReducedFE else 1e-6)


@pytest.mark.parametrize("kind", BODIES)
def test_five_fingers_press_lift_and_come_to_rest(kind):
    hand, places = Hand(kind, 5), [(-0.03, 6e-3), (-0.015, 7e-3), (0.0, 7e-3), (0.015, 6e-3), (0.03, 5e-3)]
    forces = hand.hold([bone(*place) for place in places], 100)
    assert (forces > 0.1).all()
    hand.hold([bone(x, -5e-3) for x, _ in places], 450)
    assert hand.joint.slot.health.asleep > 0
    if kind is not Rigid:
        assert hand.body.slot.health.asleep > 0


@pytest.mark.parametrize("kind", BODIES)
def test_fingers_on_opposite_sides_grip_the_organ(kind):
    """With ReducedFE each pushes the organ against the other; the springs of the other bodies have only one side."""
    top, below = bone(0.0, 6e-3), [0.0, 0.0, TOP - 42e-3 - 4e-3 + 6e-3]
    hand, alone = Hand(kind, 2), lone(kind, 0.0, 6e-3)
    both = hand.hold([top, below])
    if kind is ReducedFE:
        assert 1.02 * alone < both[0] < 1.5 * alone and hand.surface.coupling[0, 1] < 0.0
    else:
        assert both == approx([alone, alone], rel=1e-6)


@pytest.mark.parametrize("kind", [MassSpring, Rigid])
def test_in_a_thin_organ_each_finger_stays_on_its_side(kind, tmp_path):
    """In a sheet of 2 mm each bone moves 6 mm beyond first touch, past the other, and neither passes through."""
    trimesh = pytest.importorskip("trimesh")
    sheet = trimesh.creation.box((0.06, 0.04, 0.002)).subdivide_to_size(5e-3)
    sheet.export(tmp_path / "sheet.stl")
    hand = Hand(kind, 2, {"surface": str(tmp_path / "sheet.stl"), "position": (0.0, 0.0, 0.0)})
    for depth in (6e-3, -1e-3, 6e-3):
        for tick in range(150):
            z = 5e-3 - depth * min(tick / 50, 1.0)
            over, under = hand.step([[0.0, 0.0, z], [1e-3, 0.0, -z]])
            assert over.normal[2] > 0.99 and under.normal[2] < -0.99
            assert np.isfinite([over.force, under.force]).all()
        assert over.force == approx(under.force, rel=1e-3) and (over.force > 0.3) == (depth > 0.0)


@pytest.mark.parametrize("kind", COUPLED)
def test_a_slow_cycle_of_two_fingers_generates_no_energy(kind):
    """Press with one finger, then the other, release in the same order; the work is that of both fingertips."""
    hand, work, before = Hand(kind, 2), 0.0, np.zeros(2)
    corners = np.array([[0, 0], [6, 0], [6, 6], [0, 6], [0, 0]]) * 1e-3 - 0.5e-3
    for start, end in pairwise(corners):
        for part in np.linspace(0.0, 1.0, 250):
            depth = start + part * (end - start)
            contacts = hand.step([bone(-5e-3, depth[0]), bone(5e-3, depth[1])])
            s = np.array([c.indentation for c in contacts])
            work += np.dot([c.force for c in contacts], s - before)
            before = s
    assert work > -2e-6  # [J] of about 2 mJ put in and returned


def test_the_message_for_several_contacts_survives_the_wire():
    hand = Hand(ReducedFE, 2)
    hand.hold([bone(-8e-3, 6e-3), bone(8e-3, 6e-3)], 20)
    came = unpack(pack(hand.surface), Surface)
    assert came.laws.shape == (2, 5) and came.slopes.shape == (2, 12) and came.coupling.shape == (2, 2)
    assert came.laws[0, 0] == came.stiffness and came.slopes[0, :3].tolist() == list(came.tangential_gradient)
    a = came.coupling / came.laws[:, :1]
    assert a[0, 1] == approx(a[1, 0], rel=1e-12)  # reciprocal compliances
    with pytest.raises(MessageError, match="coupling"):
        msgspec.structs.replace(came, coupling=np.ones((2, 3)))


def test_without_the_body_all_forces_are_zero_within_8_ms():
    hand = Hand(MassSpring, 2)
    near = [bone(-8e-3, 6e-3), bone(8e-3, 6e-3)]
    assert (hand.hold(near, 200) > 0.3).all()
    for _ in range(9):
        hand.surface = None
        contacts = hand.step(near)
    assert [c.force for c in contacts] == [0.0, 0.0]
    back = [c.force for c in hand.step(near)]
    assert max(back) < 0.05 and (hand.hold(near, 300) > 0.3).all()


def test_multiple_inputs_are_found_by_the_signature():
    (port,) = inputs(MassSpring)
    assert (port.name, port.type, port.many, port.optional, port.expects) == ("load", Load, True, False, "list[Load]")
    assert [p.many for p in inputs(Joint)] == [True, False, True]
    assert inputs(Share)[0].type is Contacts and inputs(Kernel)[0].type is Contact


FINGERTIP = {"surface": "fingertip", "vertices": 2000, "position": (0.0, 0.0, 0.0)}


def over_pulp(x, depth):
    """A bone edge over the pulp of the layered fingertip, `depth` of it beyond touching."""
    away = 9.84e-3 + 4e-3 - depth
    angle = x / 9.84e-3
    return [away * np.sin(angle), -2e-3, away * np.cos(angle)]


def test_two_fingers_on_a_body_in_modes_are_coupled():
    more = {"model": "sampled", "young": 160.0}
    hand = Hand(ReducedFE, 2, FINGERTIP, **more)
    (alone,) = Hand(ReducedFE, 1, FINGERTIP, **more).hold([over_pulp(-3e-3, 4e-3)])
    hovering = hand.hold([over_pulp(-3e-3, 4e-3), over_pulp(3e-3, -1e-3)])
    assert hovering == approx([alone, 0.0], rel=5e-3) and alone > 0.05
    both = hand.hold([over_pulp(-3e-3, 4e-3), over_pulp(3e-3, 4e-3)])
    assert (both > 0.3 * alone).all() and (both < 0.95 * alone).all()
    a = hand.surface.coupling / hand.surface.laws[:, :1]
    assert a[0, 1] == approx(a[1, 0], rel=1e-12) and 0.0 < hand.surface.coupling[0, 1] < 1.0
    hand.hold([over_pulp(-3e-3, -2e-3), over_pulp(3e-3, -2e-3)], 250)
    again = hand.hold([over_pulp(-3e-3, 4e-3), over_pulp(3e-3, -2e-3)])
    assert again == approx([alone, 0.0], rel=5e-3)


def test_fingers_on_elastic_beams_have_the_force_of_springs_in_series():
    """Compared with a general solver for all beams and both fingertips, with the weights of the loads."""
    mesh = {"surface": "plane", "vertices": 2500, "position": (0.0, 0.0, 0.0)}
    layers, moduli = (1e-3, 9e-3), (1.36e5, 3.4e4)
    hand = Hand(BeamBundle, 2, mesh, layers=layers, moduli=moduli)
    depths, feet = np.array([5e-3, 4e-3]), [(-3e-3, 1e-3, 0.0), (4e-3, 0.0, 0.0)]
    found = hand.hold([[x, y, 4e-3 - d] for (x, y, _), d in zip(feet, depths, strict=True)], 500)
    spreader = Spreader(surface_mesh("plane", 2500), 8e-3)
    w = np.zeros((2, len(surface_mesh("plane", 2500).vertices)))
    for row, foot in zip(w, feet, strict=True):
        count = spreader.spread(foot, (0.0, 0.0, 1.0), (0.0, 0.0, -1.0))
        row[spreader.nodes[:count]] = spreader.weights[:count]
    each = sum(t / e for t, e in zip(layers, moduli, strict=True)) / surface_mesh("plane", 2500).areas  # [m/N]
    finger = Series()

    def left(s1):
        force = finger.finger_stiffness / finger.finger_hardening * np.expm1(finger.finger_hardening * s1)
        return s1 + w @ (each * (force @ w)) - depths

    s1 = root(left, depths / 2, tol=1e-14).x
    force = finger.finger_stiffness / finger.finger_hardening * np.expm1(finger.finger_hardening * s1)
    assert found == approx(force, rel=1e-6) and (found > 0.1).all()
    assert hand.surface.coupling[0, 1] == approx((w[0] * each) @ w[1] / ((w[0] * each) @ w[0]), rel=1e-9)
