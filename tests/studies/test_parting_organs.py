"""A finger that releases an organ from its neighbour: the change of its force in a tick at two rates."""

import numpy as np
import pytest
from pytest import approx

from palpate.nodes.base.surface import surface_mesh
from palpate.studies.organ_pairs import Case, motion, run


@pytest.fixture(scope="module")
def pressed():
    """Two balls of 42 mm, 1 mm apart; a finger presses the upper one, which is attached at its side, by 8 mm."""
    bodies = []
    for at, turn in (((0.0, 0.0, 43e-3), (0.0, float(np.pi / 2), 0.0)), ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))):
        surface = {"surface": "sphere", "vertices": 2000, "position": at, "rotation": turn}
        given = {"young": 19e3, "model": "linear", "retardation": 1e-3}
        bodies.append({"use": "ReducedFE", "settings": given | surface, "surface": surface})
    ball = surface_mesh("sphere", 2000, (0.0, 0.0, 43e-3), (0.0, float(np.pi / 2), 0.0))
    top = int(np.argmax(ball.vertices[:, 2]))
    upper, lower = bodies
    return Case(0, upper, lower, 1e-3, 8e-3, 2.5e-3, 80e-3, ball.vertices[top], ball.normals[top])


def test_the_force_is_continuous_where_a_finger_parts_organs(pressed):
    """Its largest change in a tick is proportional to the tick, so that there is no jump."""
    rates = []
    for rate in (1000, 8000):
        course = run(pressed, dt=1.0 / rate)
        force, organs = (np.array([each.force for each in of]) for of in (course.contacts, course.between))
        out = int(np.argmax(motion(pressed, 1.0 / rate))) + 1
        assert organs[out] > 0.3 and organs[-1] == 0.0
        rates.append(np.abs(np.diff(force[out:])).max() * rate)
    assert rates[1] == approx(rates[0], rel=0.02) and rates[0] == approx(28.2, rel=0.03)  # [N/s]
