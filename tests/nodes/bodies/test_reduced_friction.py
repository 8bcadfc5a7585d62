"""ReducedFE and fingertip under friction that indents the patch: the force of a still finger is steady."""

import numpy as np
import pytest
from pytest import approx

from palpate.messages import Contact, Friction, Proximity
from palpate.nodes.base.contacts import press_body
from palpate.nodes.contact import Series
from palpate.nodes.deformation import ReducedFE
from palpate.nodes.spread import Kernel

BALL = {"surface": "sphere", "vertices": 10000, "position": (0.0, 0.0, 0.0), "rotation": (0.0, 0.0, 0.0)}
FOOT = (-8.63e-3, 11.67e-3, 13.4e-3)
NORMAL = np.array([-0.443, 0.603, 0.664]) / np.linalg.norm([0.443, 0.603, 0.664])
DRAG = np.array([0.149, -0.312, 0.382])  # [1] of the normal force
DRAG = DRAG - NORMAL * (NORMAL @ DRAG)
DEEP = 18.7e-3  # [m] of approach: 15 mm of the body


def parts(**given):
    nodes = Kernel(**BALL), ReducedFE(**BALL, young=19e3, retardation=20e-3, **given), Series()
    for node in nodes:
        node.start()
    return nodes


def rubbed(spread, force, share, dt):
    given = Contact(foot=FOOT, normal=tuple(NORMAL), force=force, compression=2e-3, indentation=1e-3,
                    compression_rate=0.0, indentation_rate=0.0)  # fmt: skip
    return spread.step(given, Friction(force=tuple(share * force * DRAG), bristle=(0.0,) * 3, stick=False), dt=dt)


def held(nodes, share, dt, press_time=0.2):
    """Forces [N] of a finger that presses and then stays for 100 ms, and the last message of the body."""
    spread, body, contact = nodes
    surface, forces = press_body(body, rubbed(spread, 0.0, share, dt), dt=dt), []
    for k in range(round((press_time + 0.1) / dt)):
        deep = DEEP * min(k * dt / press_time, 1.0)
        given = Proximity(foot=FOOT, normal=tuple(NORMAL), slip=(0.0, 0.0, 0.0), gap=4e-3 - deep, approach=deep,
                          separation=0.0, coordinates=(0.0, 0.0), element=0, time=round(k * dt * 1e9))  # fmt: skip
        forces.append(contact.step(given, surface, dt=dt).force)
        surface = press_body(body, rubbed(spread, forces[-1], share, dt), dt=dt)
    return np.array(forces), surface


@pytest.mark.parametrize("dt", [1e-3, 2e-4])
@pytest.mark.parametrize("share", [1.0, -1.0])
def test_a_still_finger_feels_a_steady_force(share, dt):
    """Without the friction in the law of the step the force alternated between 0.7 and 3.4 N at 1 kHz, 0 and 4 N at
    5 kHz. Friction in the other direction lifts the patch."""
    forces, _ = held(parts(), share, dt)
    assert forces[-1] > 1.0
    assert np.abs(np.diff(forces))[-round(50e-3 / dt) :].max() < 0.02


@pytest.mark.parametrize("share", [1.0, -1.0])
def test_the_law_is_that_of_forces_that_grow_with_their_friction(share):
    """From the force of a still finger to 1.05 times it, and as much more friction, the law of the step gives the
    indentation, or is softer where friction lifts."""
    nodes, dt = parts(), 1e-3
    forces, law = held(nodes, share, dt)
    one, two = (law.rest_indentation + (f / law.stiffness) ** (1.0 / law.exponent) for f in forces[-1] * np.r_[1, 1.05])
    reached = press_body(nodes[1], rubbed(nodes[0], 1.05 * forces[-1], share, dt), dt=dt).previous_indentation
    assert reached - one == approx(two - one, rel=0.01) if share > 0.0 else 0.0 < reached - one < two - one
