"""`info["gradient"]`: derivatives of the observed force by settings, against differences of separate environments."""

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium", reason="gymnasium is not installed (extra gym)")

from palpate.gym import FindNodule, Press, Touch  # noqa: E402
from palpate.gym.vector import VectorTouch  # noqa: E402
from palpate.physics.errors import ArgumentError, PalpateError  # noqa: E402

pytestmark = pytest.mark.filterwarnings("ignore::palpate.PalpateWarning")

BY = ["tissue.nodule_depth", "tissue.nodule_position[0]", "contact.finger_stiffness"]


def moves(count=70):
    """Actions of FindNodule: down, then along x with changing speed."""
    for number in range(count):
        yield np.array([0.02 * np.sin(0.3 * number) * (number > 35), 0.0, -0.05 * (number < 35), 0.0], np.float32)


NEAR = {"tissue": {"nodule_position": (0.003, 0.001, 0.105)}}


def played(env, seed, options=None):
    """Forces [N] of the steps of an episode, before they are rounded to float32, and infos."""
    env.reset(seed=seed, options=options or NEAR)
    forces, infos = [], []
    for action in moves():
        infos.append(env.step(action)[4])
        forces.append(env._finger_state(env.tick, env.hands[0])[2])
    return np.array(forces), infos


@pytest.fixture(scope="module")
def episode():
    env = FindNodule(ideal=True, gradient=BY)
    forces, infos = played(env, 3)
    env.close()
    return forces, infos


@pytest.mark.parametrize("place", range(len(BY)))
def test_the_derivative_is_that_of_separate_episodes(episode, place):
    node, name = BY[place].split("[")[0].split(".")
    env = FindNodule(ideal=True)
    usual, scale = env.setting(node, name), 0.01
    if node == "tissue" and name == "nodule_position":
        usual = NEAR[node][name]
    else:
        scale = usual
    at = []
    for step in (3e-3, 1.5e-3):
        sides = []
        for sign in (step, -step):
            moved = usual + sign * scale if isinstance(usual, float) else (usual[0] + sign * scale, *usual[1:])
            changes = {"tissue": dict(NEAR["tissue"])}
            changes.setdefault(node, {})[name] = moved
            sides.append(played(env, 3, changes)[0])
        at.append((sides[0] - sides[1]) / (2.0 * step * scale))
    env.close()
    limit = (4.0 * at[1] - at[0]) / 3.0
    found = np.array([info["gradient"][place] for info in episode[1]])
    settled, rms = np.isfinite(found), np.sqrt(np.mean(limit**2))
    assert settled.mean() > 0.9 and rms > 0.0
    assert np.abs(found - limit)[settled].max() < 1e-4 * rms + 2e-9 / scale


def test_the_derivatives_change_nothing_else(episode):
    env = FindNodule(ideal=True)
    forces, infos = played(env, 3)
    env.close()
    assert forces.tobytes() == episode[0].tobytes()
    assert all("gradient" not in info for info in infos)


def test_before_contact_the_derivatives_are_0_and_a_reset_begins_again(episode):
    _, infos = episode
    assert not infos[0]["gradient"].any() and infos[-1]["gradient"].any()
    assert infos[0]["gradient"].shape == infos[0]["gradient_error"].shape == (3, 3)
    env = FindNodule(ideal=True, gradient=BY)
    played(env, 8)
    assert not env.reset(seed=3, options=NEAR)[1]["gradient"].any()
    again = [env.step(action)[4]["gradient"] for action in moves()]
    env.close()
    assert np.array(again).tobytes() == np.array([info["gradient"] for info in infos]).tobytes()


def test_parallel_environments_have_the_derivatives_of_single_ones(episode):
    envs = VectorTouch(FindNodule, 2, ideal=True, gradient=BY)
    _, first = envs.reset(seed=[8, 3], options=NEAR)
    infos = [envs.step(np.tile(action, (2, 1)))[4] for action in moves()]
    envs.close()
    assert first["gradient"].shape == (2, 3, 3) and first["_gradient"].all()
    mine = np.array([info["gradient"][1] for info in infos])
    assert mine.tobytes() == np.array([info["gradient"] for info in episode[1]]).tobytes()


def test_each_hand_has_its_derivatives():
    env = Touch("palpate-two", ideal=True, gradient=["tissue.stiffness"])
    assert env.reset(seed=0)[1]["gradient"].shape == (1, 2, 3)
    env.close()


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"gradient": ["tissue.stiffness"]}, "results jump with device.resolution .*; pass ideal=True"),
        ({"gradient": ["tissue.stifness"], "ideal": True}, "stiffness"),
        ({"gradient": ["scene.finger.thickness"], "ideal": True}, "expected a setting of a node"),
        ({"gradient": "tissue.stiffness", "ideal": True}, "expected different settings"),
        ({"gradient": ["tissue.use"], "ideal": True}, "a choice"),
    ],
)
def test_settings_without_derivatives_are_refused_by_name(given, text):
    with pytest.raises(PalpateError, match=text):
        Press(**given)


def test_at_a_limit_of_a_setting_the_derivative_is_one_sided():
    env = Press(ideal=True, gradient=["tissue.retardation"])
    env.reset(seed=1, options={"tissue": {"retardation": 0.0}})
    assert len(env._lanes._work[0].rows) == 4
    env.close()
    with pytest.raises(ArgumentError, match="call reset"):
        env.step(np.zeros(3, np.float32))
