"""The training of docs/examples/train.py: it improves a policy, and the shipped policies have the documented scores."""

import json
import runpy
from pathlib import Path

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium", reason="gymnasium is not installed (extra gym)")

from palpate.gym.scripted import score  # noqa: E402

pytestmark = pytest.mark.filterwarnings("ignore::palpate.PalpateWarning")  # untrained policies leave the laws' ranges
EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"
DOCUMENTED = {"Press": 0.5, "FindNodule": 0.5}
"""Lower bounds of the mean return of the shipped policies in the first three episodes of docs/gym.md."""


@pytest.fixture(scope="module")
def module():
    return runpy.run_path(str(EXAMPLES / "train.py"))


def test_a_few_generations_improve_a_policy_on_other_seeds(module):
    shown = []
    trained = module["train"](
        "Press", show=lambda *each, **_: shown.append(each), candidates=20, episodes=1, generations=5
    )
    env = gymnasium.make("palpate/Press-v0")
    period = env.unwrapped.step_time

    def mean(theta):
        act = lambda: module["policy"](trained | {"theta": theta}, period)  # noqa: E731
        return np.mean([each["return"] for each in score(env, act, range(4))])

    first, last = mean([0.0] * 24), mean(trained["theta"])
    assert first == 0.0  # the hand does not move
    assert last > 0.1
    assert len(shown) == len(trained["curve"]) == 5
    env.close()


def test_the_same_seed_trains_the_same_policy(module):
    small = {"candidates": 4, "episodes": 1, "generations": 2, "show": lambda *each, **_: None}
    one, two, other = (module["train"]("Press", seed, **small) for seed in (3, 3, 4))
    assert one["theta"] == two["theta"] != other["theta"]


@pytest.mark.parametrize("task", ["Press", "FindNodule"])
def test_the_shipped_policy_has_its_score(module, task):
    file = EXAMPLES / "trained" / f"{task}.json"
    env = gymnasium.make(f"palpate/{task}-v0")
    trained = json.loads(file.read_text())[0]
    played = score(env, lambda: module["policy"](trained, env.unwrapped.step_time), range(3))
    env.close()
    assert np.mean([each["return"] for each in played]) > DOCUMENTED[task]
