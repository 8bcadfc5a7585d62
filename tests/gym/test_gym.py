"""A graph as an environment: the checks of Gymnasium, reproducibility by the seed, and the balance of forces."""

import copy
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
import warnings

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium", reason="gymnasium is not installed (extra gym)")

from gymnasium.utils.env_checker import check_env  # noqa: E402
from gymnasium.vector import AsyncVectorEnv, SyncVectorEnv  # noqa: E402

from palpate.gym import FindNodule, Press, Touch  # noqa: E402
from palpate.gym.find_nodule import HELD  # noqa: E402
from palpate.gym.hands import ROOM, SPEED  # noqa: E402
from palpate.gym.scripted import Approach, Search, score  # noqa: E402
from palpate.gym.vector import VectorTouch  # noqa: E402
from palpate.launch.run.notes import lines  # noqa: E402
from palpate.nodes.base import SettingError  # noqa: E402
from palpate.physics.errors import ArgumentError, PalpateError, PalpateWarning  # noqa: E402
from palpate.records.side_view import FINGER, FORCE  # noqa: E402

# Random and scripted actions leave the ranges of the laws; the tests of notes expect the warnings.
pytestmark = pytest.mark.filterwarnings("ignore::palpate.PalpateWarning")

TASKS = ("Touch", "FindNodule", "Press")
DOWN = np.array([0.0, 0.0, -0.03], np.float32)


def spell(seed, steps=40, **given):
    """Observations and rewards of an episode with random actions, as bytes."""
    env = Touch(**given) if given else Press()
    printed = played(env, seed, steps)
    env.close()
    return printed


def played(env, seed, steps):
    env.action_space.seed(seed)
    observation, _ = env.reset(seed=seed)
    printed = [observation]
    for _ in range(steps):
        action = env.action_space.sample()
        action[2] = -abs(action[2])
        observation, reward, *_ = env.step(action)
        printed += [observation, {"reward": np.array(reward)}]
    return b"".join(part.tobytes() for each in printed for part in each.values())


@pytest.mark.parametrize("task", TASKS)
def test_the_checks_of_gymnasium_pass(task):
    env = gymnasium.make(f"palpate/{task}-v0")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped)
    env.close()


@pytest.mark.parametrize("copied", [copy.deepcopy, copy.copy, pickle.dumps])
def test_a_copy_that_would_share_state_is_rejected(copied):
    """`copy.copy` copies attributes by reference, so the stepper must reject copies."""
    env = Press()
    with pytest.raises(ArgumentError, match="cannot be copied or pickled; make another one"):
        copied(env.stepper)
    if copied is not pickle.dumps:
        with pytest.raises(ArgumentError, match="cannot be copied; make another one"):
            copied(env)
    env.close()


@pytest.mark.parametrize("name", ["Touch", "Press", "FindNodule"])
def test_a_pickled_environment_is_rebuilt_and_behaves_the_same(name):
    env = {"Touch": Touch, "Press": Press, "FindNodule": FindNodule}[name](
        duration=0.7, ticks=7, render_mode="rgb_array"
    )
    env.reset(seed=9)
    env.step(env.action_space.sample())
    other = pickle.loads(pickle.dumps(env))
    assert (other.ticks, other.duration, other.render_mode, other.tick) == (7, 0.7, "rgb_array", None)
    assert played(env, 3, 10) == played(other, 3, 10)
    env.close()
    other.close()


def test_the_picture_shows_the_position_and_the_force_of_the_finger():
    env = Touch(render_mode="rgb_array")
    with pytest.raises(ArgumentError, match="call reset"):
        env.render()
    env.reset(seed=1)
    pictures = [env.render()]
    for _ in range(45):
        env.step(DOWN)
    pictures.append(env.render())
    red = [(picture == FORCE).all(axis=2).sum() for picture in pictures]
    rows = [np.argwhere((picture == FINGER).all(axis=2))[:, 0].mean() for picture in pictures]
    assert all(picture.shape == (240, 320, 3) and picture.dtype == np.uint8 for picture in pictures)
    assert red[0] == 0 < red[1] and rows[1] > rows[0] + 20  # down by more than 5 mm
    assert Touch().render() is None
    with pytest.raises(ArgumentError, match="render_mode: found 'human'"):
        Touch(render_mode="human")
    env.close()


def test_equal_seeds_yield_equal_bytes_after_any_episode():
    env = Press()
    first = played(env, 7, 40)
    other = played(env, 8, 25)
    assert played(env, 7, 40) == first == spell(7)
    assert other != first[: len(other)]
    env.close()


def test_a_reset_environment_equals_a_new_one_in_every_bit_of_each_stream():
    one, two = Touch(ticks=3), Touch(ticks=3)
    for env, before in ((one, 30), (two, 0)):
        env.reset(seed=1)
        for _ in range(before):
            env.step(DOWN)
        env.reset(seed=1)
        for _ in range(150):
            env.step(DOWN)
    assert one.tick.contact.force > 0.5
    for stream in one.tick.streams:
        assert repr(one.tick[stream]) == repr(two.tick[stream])
    one.close()
    two.close()


def test_the_observed_force_balances_the_hand():
    """k (goal - x) + F = 0 on a hand at rest: the spring of the arm measures the contact force."""
    env = Touch(nodes={"device": {"resolution": 0.0}})
    env.reset(seed=0)
    down = np.array([0.0, 0.0, -0.05], np.float32)
    for _ in range(40):  # 20 mm
        env.step(down)
    for _ in range(200):
        observation, *_ = env.step(0 * down)
    hand = env._steered[0]
    assert hand.own["goal"] == pytest.approx([*hand.begin[:2], hand.begin[2] - 0.02], abs=1e-8)
    arm = hand.hand_stiffness * (hand.own["goal"] - observation["position"].astype(float))
    assert observation["force"][2] > 1.0
    assert observation["force"] == pytest.approx(-arm, abs=0.01)
    assert observation["velocity"] == pytest.approx(0.0, abs=1e-4)
    env.close()


def test_the_goal_moves_with_the_commanded_velocity_within_its_box():
    env = Touch()
    env.reset(seed=0)
    hand = env._steered[0]
    start = hand.own["goal"].copy()
    env.step(np.array([0.1, 0.0, 0.0], np.float32))
    assert hand.own["goal"] - start == pytest.approx([0.1 * env.step_time, 0.0, 0.0], abs=1e-9)
    for _ in range(100):
        env.step(
            np.array([9.0, -9.0, 9.0], np.float32)
        )  # clipped at SPEED, since the exploration noise of learners exceeds it
    assert hand.own["goal"] - start == pytest.approx([ROOM[1][0], ROOM[0][1], ROOM[1][2]], abs=1e-9)
    assert env.action_space.high[0] == SPEED
    env.close()


def test_processes_in_parallel_equal_a_single_environment():
    def make():
        return Press(ticks=20)

    def rolled(env):
        printed = [env.reset(seed=[3, 4])[0]["force"]]
        for _ in range(40):
            observation, rewards, *_ = env.step(np.tile(DOWN, (2, 1)))
            printed += [observation["force"], rewards]
        env.close()
        return np.concatenate([part.ravel() for part in printed]).tobytes()

    alone = []
    for seed in (3, 4):
        env = make()
        env.reset(seed=seed)
        alone.append([env.step(DOWN)[1] for _ in range(40)])
        env.close()
    threads = rolled(SyncVectorEnv([make, make]))
    assert threads == rolled(AsyncVectorEnv([make, make]))
    rewards = np.frombuffer(threads[-16:])
    assert rewards.tolist() == [each[-1] for each in alone]


def test_each_hand_has_a_row_of_the_observation():
    env = Touch("palpate-two")
    observation, _ = env.reset(seed=0)
    assert {part.shape for part in observation.values()} == {(2, 3)} == {env.action_space.shape}
    apart = observation["position"][0] - observation["position"][1]
    assert apart == pytest.approx([0.018, 0.0, 0.0], abs=1e-4)
    observation, *_ = env.step(np.array([[0.1, 0, 0], [0, 0, 0]], np.float32))
    moved = observation["position"][0] - observation["position"][1] - apart
    assert moved[0] > 1e-4
    env.close()


@pytest.mark.parametrize("graph", ["organs", "pinch", "nodule"])
def test_any_graph_with_a_simulated_hand_can_be_touched(graph):
    env = Touch(graph)
    env.reset(seed=0)
    observation, *_ = env.step(env.action_space.sample())
    assert env.observation_space.contains(observation)
    env.close()


def test_notes_on_validity_are_kept_and_each_kind_warns_once():
    """A rigid body under a moving hand has forces of meganewtons; they came without any sign."""
    env = Touch(nodes={"tissue": "deformation.Rigid"}, duration=0.6)
    deep = np.array([0.0, 0.0, -SPEED], np.float32)
    found = []
    for _ in range(2):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            env.reset(seed=0)
            while not env.step(deep)[3]:
                pass
        found.append([str(each.message) for each in caught if issubclass(each.category, PalpateWarning)])
    (deep_note,) = [note for note in env.notes if "the fingertip is compressed by" in note.text]
    assert deep_note.node == "contact" and 0.0 < deep_note.time < 0.61
    assert found == [lines(env.notes), []] and env.notes[0].startswith("tissue (Rigid) does not take")
    assert len({note.kind for note in env.notes}) == len(env.notes)
    env.close()


def test_parallel_environments_have_the_notes_of_single_ones():
    given = {"nodes": {"tissue": "deformation.Rigid"}, "duration": 0.4}
    deep = np.array([0.0, 0.0, -SPEED], np.float32)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        one = Touch(**given)
        one.reset(seed=0)
        while not one.step(deep)[3]:
            pass
        one.close()
    with pytest.warns(PalpateWarning, match="tissue \\(Rigid\\) does not take"):
        envs = VectorTouch(Touch, 3, **given)
    for episode in range(2):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            envs.reset(seed=0)
            while not envs.step(np.tile(deep, (3, 1)))[3].any():
                pass
            envs.reset(seed=0)
        found = [str(each.message) for each in caught if issubclass(each.category, PalpateWarning)]
        assert found == (lines(envs.notes, "environment")[1:] if episode == 0 else [])
    assert {note.kind for note in envs.notes} == {note.kind for note in one.notes}
    assert [note.lane for note in envs.notes] == [None] + [0] * (len(envs.notes) - 1)
    envs.close()


def test_settings_of_an_episode_do_not_affect_the_next():
    env = Touch()
    env.reset(options={"tissue": {"stiffness": 1234.0}})
    assert env.tick.settings("tissue")["stiffness"] == 1234.0
    with pytest.raises(SettingError, match="no setting 'stifness'"):
        env.reset(options={"tissue": {"stifness": 1.0}})
    env.reset()
    assert env.tick.settings("tissue")["stiffness"] == 257.0
    env.close()


def test_the_scripted_search_finds_the_nodule_from_the_force_alone():
    env = FindNodule()
    episodes = score(env, lambda: Search(env.step_time), range(3))
    places = {env.reset(seed=seed) and env.tick.settings("tissue")["nodule_position"] for seed in range(3)}
    assert len(places) == 3
    assert max(each["distance"] for each in episodes) < 1.5e-3
    assert min(each["return"] for each in episodes) > 0.5
    env.close()


def test_the_reward_for_a_wrong_place_a_large_force_and_time_is_as_documented():
    env = FindNodule(duration=0.5)
    env.reset(seed=2)
    x, y, _ = env.tick.settings("tissue")["nodule_position"]
    quality = np.exp(-((np.hypot(x, y) / 4e-3) ** 2))
    for here, steps, cost in ((0.5, 50, 0.0), (1.0, HELD, 1.0 - HELD / 50)):
        env.reset(seed=2)
        rewards, over = [], False
        while not over:
            _, reward, over, late, info = env.step(np.array([0, 0, 0, here], np.float32))
            rewards.append(reward)
        assert len(rewards) == steps and not late
        assert info["distance"] == pytest.approx(np.hypot(x, y), abs=1e-4)
        assert rewards[:-1] == pytest.approx([-0.01 / 0.5] * (steps - 1))
        assert rewards[-1] == pytest.approx(-0.02 + quality - (1.0 - quality) * cost, abs=1e-3)
        assert sum(rewards) == pytest.approx(quality * (2.0 - steps / 50) - 1.0, abs=1e-3)
    env.close()
    pressed = FindNodule(duration=10.0)
    pressed.reset(seed=2)
    for _ in range(30):
        _, reward, *_ = pressed.step(np.array([0, 0, -SPEED, 0], np.float32))
    force = pressed.tick.contact.force
    assert force > 2.5
    assert reward == pytest.approx(-0.001 * (force / 2.0))
    pressed.close()


@pytest.mark.parametrize(("mean", "spread"), [(0.0, 1.0), (0.5, 0.5)])
def test_an_untrained_gaussian_policy_survives(mean, spread):
    """Median: all 200 steps of an episode of 2 s, where it was 2 steps when the first "here" ended the episode."""
    envs, random = VectorTouch(FindNodule, 8, duration=2.0), np.random.default_rng(0)
    envs.reset(seed=0)
    steps, over = np.zeros(8, int), np.zeros(8, bool)
    here = 0
    while not over.all():
        actions = spread * random.standard_normal((8, 4)) + mean * np.array([0, 0, 0, 1])
        here += np.count_nonzero(actions[:, 3] > 0.5)
        _, _, ended, late, _ = envs.step(actions)
        steps, over = steps + ~over, over | ended | late
    assert np.median(steps) == 200 == steps.min()
    assert here > 400
    envs.close()


def test_an_interrupted_answer_does_not_end_the_episode():
    env = FindNodule(duration=2.0)
    for _ in range(2):  # the second episode begins without the steps of the first
        env.reset(seed=2)
        for here in (*[1] * (HELD - 1), 0, *[1] * (HELD - 1)):
            _, _, over, _, info = env.step(np.array([0, 0, 0, here], np.float32))
            assert not over and "distance" not in info
    assert env.step(np.array([0, 0, 0, 1], np.float32))[2]
    env.close()


def test_the_scripted_press_reaches_the_target_force_for_every_stiffness():
    env = Press()
    stiffness, wanted = set(), set()
    for seed in range(3):
        (episode,) = score(env, Approach, range(seed, seed + 1))
        assert episode["error"] < 0.1
        assert 0.4 < episode["return"] <= 1.0
        stiffness.add(env.tick.settings("tissue")["stiffness"])
        wanted.add(env.target)
    assert len(stiffness) == len(wanted) == 3
    env.close()


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: Touch("fingertip-slide"), "no simulated hand to steer; sources: found hand"),
        (lambda: Touch("falcon"), "expected device.Simulated"),
        (lambda: Touch("kidny"), "kidny"),
        (lambda: Touch(ticks=0), "ticks: found 0, expected a whole number"),
        (lambda: Touch(duration=float("nan")), "duration: found nan"),
        (lambda: FindNodule("kidney"), "nodule_radius of 'tissue': found 0 m"),
        (lambda: FindNodule("palpate-two"), "found 2 hands"),
        (lambda: Press(nodes={"tissue": "deformation.Rigid"}), "0 bodies with a stiffness"),
        (lambda: Touch().step(DOWN), r"call reset\(\) first"),
    ],
)
def test_invalid_arguments_are_reported(make, text):
    with pytest.raises(PalpateError, match=text):
        make()


def test_an_action_with_a_wrong_shape_or_a_nan_is_rejected():
    env = Touch()
    env.reset()
    for action in (np.zeros(4), np.array([0.0, np.nan, 0.0]), 1.0):
        with pytest.raises(ArgumentError, match=r"expected \(3,\) finite numbers"):
            env.step(action)
    env.close()


def test_the_extra_is_named_if_gymnasium_is_missing():
    code = "import sys; sys.modules['gymnasium'] = None; import palpate.gym"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1].endswith('pip install "palpate[gym]"')


@pytest.mark.parametrize("name", ["Press", "FindNodule"])
def test_lanes_equal_single_environments_over_several_episodes(name):
    """Bit for bit, beyond the end of an episode, because the reset equals that of a single environment."""
    given, count, steps = {"duration": 0.25, "ticks": 10}, 3, 60
    envs = gymnasium.make_vec(
        f"palpate/{name}-v0", num_envs=count, vectorization_mode="vector_entry_point", threads=2, **given
    )
    drawn = np.random.default_rng(5).uniform(-0.1, 0.1, (steps, *envs.action_space.shape)).astype(np.float32)
    drawn[..., 2] -= 0.08
    singles = [gymnasium.make(f"palpate/{name}-v0", **given).unwrapped for _ in range(count)]
    together, _ = envs.reset(seed=11)
    alone = [env.reset(seed=11 + lane)[0] for lane, env in enumerate(singles)]
    over, felt = [False] * count, 0.0
    for number, actions in enumerate(drawn):
        for part, values in together.items():
            assert values.tobytes() == np.stack([one[part] for one in alone]).tobytes(), (number, part)
        felt = max(felt, float(np.abs(together["force"]).max()))
        together, rewards, ended, late, infos = envs.step(actions)
        for lane, env in enumerate(singles):
            if over[lane]:
                alone[lane], _ = env.reset()
                reward, over[lane], cut, info = 0.0, False, False, {}
            else:
                alone[lane], reward, over[lane], cut, info = env.step(actions[lane])
            assert (rewards[lane], ended[lane], late[lane]) == (reward, over[lane], cut)
            over[lane] = over[lane] or cut
            for key, value in info.items():
                assert infos[key][lane] == value and infos[f"_{key}"][lane]
    assert felt > 0.3
    for env in (envs, *singles):
        env.close()


def test_invalid_arguments_of_a_vector_environment_are_reported():
    with pytest.raises(ArgumentError, match="num_envs: found 0"):
        VectorTouch(Touch, 0)
    envs = VectorTouch(Touch, 2)
    with pytest.raises(ArgumentError, match="call reset"):
        envs.step(np.zeros((2, 3)))
    envs.reset(seed=[1, 2], options={"tissue": {"stiffness": 1234.0}})
    with pytest.raises(ArgumentError, match="environment 0 and 1 more: found"):
        envs.step(np.full((2, 3), np.nan))
    with pytest.raises(ArgumentError, match="seed: found 1"):
        envs.reset(seed=[1])
    with pytest.raises(ArgumentError, match="no running node"):
        envs.reset(options={"tisue": {}})
    envs.close()


@pytest.fixture
def presses():
    """Six environments, whose steps take the given number of ticks; closed after the test."""
    made = []

    def make(ticks=10):
        made.append(VectorTouch(Press, 6, ticks=ticks))
        made[-1].reset(seed=1)
        return made[-1]

    yield make
    for envs in made:
        envs.close()


STILL = np.zeros((6, 3), np.float32)


def test_after_ctrl_c_in_a_step_no_thread_runs_in_a_lane(presses):
    """Former threads continued in lanes that the next reset had just replaced."""
    envs = presses(1_000_000)
    timer = threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        envs.step(STILL)
    timer.join()
    stopped = envs._lanes.ticks.copy()
    time.sleep(0.05)
    assert np.array_equal(envs._lanes.ticks, stopped) and stopped.max() > 1
    with pytest.raises(ArgumentError, match="call reset"):
        envs.step(STILL)
    again, fresh = envs.reset(seed=1)[0], presses(1_000_000).reset(seed=1)[0]
    assert all(again[part].tobytes() == fresh[part].tobytes() for part in again)


def test_a_step_in_a_forked_process_starts_new_threads(presses):
    """The child waited for threads of its parent."""
    envs = presses()
    envs.step(STILL)
    child = os.fork()
    if not child:
        signal.alarm(30)
        os._exit(0 if envs.step(STILL)[4]["time"].tolist() == [0.02] * 6 else 1)
    assert os.waitpid(child, 0)[1] == 0
    assert envs.step(STILL)[4]["time"].tolist() == [0.02] * 6


def test_a_reset_mask_begins_only_its_environments(presses):
    """In addition to settings; the others continue bit for bit."""
    envs, other = presses(), presses()
    one, two = envs.step(STILL + DOWN)[0], other.step(STILL + DOWN)[0]
    mask = np.array([True, False, False, True, False, False])
    seen, infos = envs.reset(seed=[7] * 6, options={"reset_mask": mask, "tissue": {"stiffness": 900.0}})
    assert infos["time"].tolist() == [0.0, 0.01, 0.01, 0.0, 0.01, 0.01] and infos["_time"].tolist() == mask.tolist()
    assert all(seen[part][~mask].tobytes() == two[part][~mask].tobytes() for part in one)
    one, two = envs.step(STILL + DOWN), other.step(STILL + DOWN)
    assert all(one[0][part][~mask].tobytes() == two[0][part][~mask].tobytes() for part in one[0])
    for wrong in (np.ones(5, bool), np.zeros(6, bool), np.ones(6)):
        with pytest.raises(ArgumentError, match="reset_mask: found"):
            envs.reset(options={"reset_mask": wrong})


def test_a_closed_vector_environment_is_reported(presses):
    envs = presses()
    envs.close()
    for call in (envs.reset, lambda: envs.step(STILL)):
        with pytest.raises(ArgumentError, match="the environments are closed"):
            call()


def test_max_episode_steps_truncate_parallel_environments_as_single_ones():
    given = {"max_episode_steps": 4, "duration": 0.2}
    still = np.zeros((2, 3), np.float32)
    one = gymnasium.make("palpate/Touch-v0", **given)
    many = gymnasium.make_vec("palpate/Touch-v0", num_envs=2, vectorization_mode="vector_entry_point", **given)
    one.reset(seed=1)
    many.reset(seed=1)
    for episode in range(2):
        for step in range(1, 5):
            single, parallel = one.step(still[0]), many.step(still)
            assert single[3] == parallel[3][0] == parallel[3][1] == (step == 4), (episode, step)
        one.reset()
        assert not many.step(still)[3].any()
    one.close()
    many.close()
    for wrong in (0, 2.5, True, "9"):
        with pytest.raises(ArgumentError, match=r"max_episode_steps: found .*expected a whole number from 1"):
            VectorTouch(Touch, 2, max_episode_steps=wrong)


def test_an_action_that_is_not_finite_names_its_environment():
    envs = VectorTouch(Touch, 4, duration=0.1)
    envs.reset(seed=0)
    actions = np.zeros((4, 3), np.float32)
    actions[2, 1] = np.nan
    with pytest.raises(ArgumentError, match=r"actions: environment 2: found \[0.0, nan, 0.0\], expected finite"):
        envs.step(actions)
    actions[3, 0] = np.inf
    with pytest.raises(ArgumentError, match="environment 2 and 1 more"):
        envs.step(actions)
    envs.step(np.zeros((4, 3)))
    envs.close()
