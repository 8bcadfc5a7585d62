"""A finger driven through an organ and back: it is pushed back by a finite force, without generated energy."""

import numpy as np
import pytest
from test_bodies import BODIES, nothing

from palpate.messages import Pose
from palpate.nodes.base.contacts import press_body
from palpate.nodes.collision import Mesh, Nurbs
from palpate.nodes.contact import Series
from palpate.nodes.spread import Kernel


def driven(kind, collision, start, end, speed=0.1):
    """Forces [N] (k,3) on the finger and its path [m] (k,3), down, held and back."""
    nodes = collision(), Series(), Kernel(), kind()
    for node in nodes:
        node.start()
    find, series, spread, body = nodes
    surface = press_body(body, nothing(), dt=1e-3)
    count = int(np.linalg.norm(np.subtract(end, start)) / speed * 1e3)
    along = np.concatenate([np.linspace(0, 1, count), np.ones(100), np.linspace(1, 0, count)])[:, None]
    path = np.array(start) + along * np.subtract(end, start)
    forces = []
    for p in path:
        place = find.step(Pose(position=tuple(p.tolist()), velocity=(0.0, 0.0, 0.0), dt=1e-3))
        contact = series.step(place, surface, dt=1e-3)
        surface = press_body(body, spread.step(contact, None), dt=1e-3)
        forces.append(contact.force * np.array(contact.normal))
    return np.array(forces), path


@pytest.mark.parametrize("kind", BODIES, ids=lambda kind: kind.__name__)
@pytest.mark.parametrize("collision", [Nurbs, Mesh])
@pytest.mark.parametrize("place", [(0.003, 0.004), (-0.03, 0.0)])
def test_the_force_never_flips_and_no_energy_is_generated(kind, collision, place):
    forces, path = driven(kind, collision, (*place, 0.115), (place[0] + 2e-3, place[1], 0.055))
    assert np.isfinite(forces).all()
    assert (forces[:, 2] >= 0).all() and forces[:, 2].max() > 5.0
    given = np.cumsum(-np.einsum("ij,ij->i", forces[1:], np.diff(path, axis=0)))
    assert given.min() > -1e-6 and given[-1] > 0
    assert (forces[-1] == 0).all()
    if kind.__name__ == "ReducedFE":  # 225 N in a tick if the foot jumped to the other side
        inward = np.linalg.norm(forces, axis=1)[: np.argmax(-path[:, 2])]
        # 14 N of 45 N, 33 mm inside, where the hilum becomes nearer than the top and the foot moves towards it
        assert np.abs(np.diff(inward)).max() < 20.0
        # It stiffens beyond its deepest press: 60 mm is five times as deep.
        assert inward.max() < 120.0
