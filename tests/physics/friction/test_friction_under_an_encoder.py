"""Uncertainty of friction at rest under an encoder: presliding is a spring of sigma0 f_n along the surface, and the
position of the finger within a count q is unknown. Motions that differ within a count have the same readings, so no
estimate has the right friction for all of them: for one of them its error is at least half of their difference.
"""

import numpy as np
import pytest

from palpate.compiler.fields import blank_record
from palpate.physics.device.observer import AXIS, begin, follow
from palpate.physics.friction.bristle import UP, stepper
from palpate.physics.friction.lugre import LuGre

COUNT = 60e-6  # [m] q
LOAD = 1.76  # [N] f_n
LAW = LuGre(bristle_stiffness=500.0, play=0.5 * COUNT)  # of the kidney
ONE_COUNT = LOAD * LAW.bristle_stiffness * COUNT  # [N] f_n sigma0 q, 53 mN
STEP = stepper(LuGre)
DT = 1e-3


def friction(path):
    """Friction [N] (3) at the end of a path [m] (k,2) along the surface, and its length [m]."""
    z, normal, load, slack, spare, force = (0.0, 0.0, 0.0), UP, 0.0, (0.0, 0.0, 0.0), 0.0, (0.0, 0.0, 0.0)
    for dx, dy in np.diff(path, axis=0):
        slip = (dx / DT, dy / DT, 0.0)
        z, normal, load, slack, spare, force, _ = STEP(LAW, z, normal, load, slack, spare, UP, slip, LOAD, DT)
    return np.array(force), np.linalg.norm(np.diff(path, axis=0), axis=1).sum()


def read(path, phase=0.0):
    return COUNT * (np.round(path / COUNT + phase) - phase)


def observed(path, phase=0.0):
    """Path [m] (k,2) that the observer finds between the counts."""
    found = []
    for reading in read(path, phase).T:
        axis = blank_record(AXIS)
        begin(axis, reading[0])
        found.append([follow(axis, each, COUNT, DT) for each in reading])
    return np.array(found).T


def stroke(length, seconds=0.4):
    """A stroke [m] that rests for 0.4 s at its end, in two directions."""
    s = np.clip(np.arange(round((seconds + 0.4) / DT)) * DT / seconds, 0.0, 1.0)
    return np.outer(s**3 * (10 - 15 * s + 6 * s * s), length)


def test_motions_with_the_same_readings_have_a_different_friction():
    """The bound of the equations page: f_n sigma0 q/sqrt 2 for a finger that may be anywhere in a square of counts."""
    still = np.zeros((400, 2))
    drift = 0.999 * COUNT * np.minimum(np.arange(400) * DT / 0.2, 1.0)[:, None] * (1.0, 1.0) - 0.4995 * COUNT
    there, back = still - 0.4995 * COUNT, drift
    assert np.array_equal(read(there), read(back))
    apart = np.linalg.norm(friction(np.vstack([there, back]))[0] - friction(np.vstack([there, there]))[0])
    # the bristles of a path of sqrt 2 counts relax by up to sigma0/g of it, 3 %, and the play hides half a count of it
    assert 0.95 < apart / (np.sqrt(2.0) * ONE_COUNT) < 1.0
    assert 0.5 * apart == pytest.approx(37.3e-3, rel=0.05)


@pytest.mark.parametrize("length", [(1.5e-3, -1e-3), (0.4e-3, 0.3e-3)])
def test_the_phase_of_the_counts_spreads_friction_within_the_bound(length):
    """Phases shift the motion by fractions of a count; a shift by whole counts changes nothing."""
    exact, way = friction(stroke(length))
    off = []
    for phase in np.random.default_rng(1).random((24, 2)):
        path = observed(stroke(length), phase)
        force, longer = friction(path)
        off.append(np.linalg.norm(force - exact))
        # bristles relax by sigma0/g of a longer path
        worn = LAW.bristle_stiffness / LAW.mu_static * max(longer - way, 0.0) * np.linalg.norm(exact)
        assert off[-1] < ONE_COUNT / np.sqrt(2.0) + worn
        whole = friction(observed(stroke(length) + COUNT * np.array([3.0, -2.0]), phase))[0]
        assert np.abs(whole - force).max() < 1e-9
    assert np.ptp(off) > 0.1 * ONE_COUNT
