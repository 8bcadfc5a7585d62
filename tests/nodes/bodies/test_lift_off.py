"""A body keeps its indentation after the load ends: a missing load is a load of zero, not a reset."""

import numpy as np
import pytest
from test_bodies import UP, Loop, every_body, make

from palpate.launch.testing import FakeBus
from palpate.messages import Contact, Load
from palpate.nodes.deformation import BeamBundle
from palpate.nodes.spread import Kernel

PLANE = {"surface": "plane", "vertices": 900, "position": (0.0, 0.0, 0.0)}


def lifted(kind, back, speed, hold=300):
    """Forces [N] and approaches [m]: 6 mm pressed and held, lifted by `back` [m] at `speed` [m/s], and held there."""
    loop = Loop(kind)
    down, up = np.linspace(0, 6e-3, 150)[1:], np.arange(6e-3, 6e-3 - back, -speed * 1e-3)
    path = np.concatenate([down, np.full(150, 6e-3), up, np.full(hold, 6e-3 - back)])
    return np.array([loop.press(float(e)).force for e in path]), path


@every_body
@pytest.mark.parametrize("back", [1e-3, 3e-3, 5e-3])
@pytest.mark.parametrize("speed", [0.02, 0.2])
def test_a_slightly_lifted_finger_is_not_hit_repeatedly(kind, back, speed):
    """The recovering surface may meet the finger once, without chatter."""
    forces, path = lifted(kind, back, speed)
    on = (forces > 0).astype(int)[150:]
    assert np.abs(np.diff(on)).sum() <= 2
    assert forces @ np.diff(path, prepend=0.0) > 0


def spread(force, foot):
    contact = Contact(
        foot=foot, normal=UP, force=force, compression=0, indentation=0, compression_rate=0, indentation_rate=0
    )
    (load,) = FakeBus(Kernel(**PLANE)).publish(contact)
    return Load(nodes=load.nodes, forces=load.forces, foot=foot, normal=UP)


def empty(foot):
    return Load(nodes=[], forces=np.zeros((0, 3)), foot=foot, normal=UP)


def test_only_the_recovering_indentation_is_sent():
    bus = FakeBus(make(BeamBundle))
    here = (0.0, 0.0, 0.0)
    held = bus.publish(*[spread(0.5, here)] * 100)[-1]
    gone = bus.publish(*[empty(here)] * 200)
    frees = np.array([held.rest_indentation, *(one.rest_indentation for one in gone)])
    assert held.rest_indentation > 1e-4
    assert (np.diff(frees) < 0).all() and frees[1] > 0.9 * frees[0] and frees[-1] > 0.1 * frees[0]
    assert all(one.previous_indentation >= one.rest_indentation for one in gone)
    (aside,) = bus.publish(empty((0.03, 0.0, 0.0)))
    assert aside.rest_indentation == 0.0 and aside.previous_indentation == 0.0
    (back,) = bus.publish(empty(here))
    assert back.rest_indentation == pytest.approx(gone[-1].rest_indentation, rel=0.02)


def test_the_law_changes_smoothly_from_the_last_patch_to_the_one_below_the_finger():
    bus = FakeBus(make(BeamBundle))
    bus.publish(*[spread(0.5, (0.0, 0.0, 0.0))] * 100)
    laws = bus.publish(*[empty((x, 0.0, 0.0)) for x in np.linspace(0, 0.02, 400)])
    frees = np.array([law.rest_indentation for law in laws])
    assert np.abs(np.diff(frees)).max() < 0.02 * frees[0]
