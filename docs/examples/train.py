"""Train a policy for palpate/Press-v0 or palpate/FindNodule-v0 with the cross-entropy method (docs/gym.md, Training).

python train.py Press                 # trains, prints the curve, writes Press.json
python train.py FindNodule --seeds 0 1 2
python train.py Press --score 20      # score of Press.json: 20 episodes, seeds 0 to 19, which training does not use

The cross-entropy method draws candidates from a Gaussian with separate variances, runs one episode per candidate and
seed, and moves mean and variance to those of the best candidates: R. Y. Rubinstein, Methodol. Comput. Appl. Probab. 1
(1999) 127-190; with added variance, I. Szita and A. Lorincz, Neural Comput. 18 (2006) 2936-2941.
"""

from __future__ import annotations

import argparse
import json
from functools import partial
from pathlib import Path
from time import process_time
from typing import Any

import gymnasium
import numpy as np

import palpate.gym  # noqa: F401  registers the environments
from palpate.gym.hands import SPEED
from palpate.gym.scripted import score

TRAINING_SEED = 1000  # seeds of training episodes begin here


class Press:
    """A linear policy: velocity = SPEED tanh(W [1, wanted, force, 10 velocity]), with 24 numbers W (3,8), first all 0.

    theta  (n,24), one row per environment
    """

    size = 24
    plan = {"candidates": 40, "episodes": 2, "generations": 16, "duration": 3.0}

    def __init__(self, theta: np.ndarray, period: float) -> None:
        self.matrices = theta.reshape(-1, 3, 8)

    def __call__(self, seen: dict[str, np.ndarray]) -> np.ndarray:
        ones = np.ones_like(seen["wanted"])
        features = np.concatenate([ones, seen["wanted"], seen["force"], 10.0 * seen["velocity"]], axis=1)
        return SPEED * np.tanh(np.einsum("nij,nj->ni", self.matrices, features))


class FindNodule:
    """Move down, scan the field in a zigzag, then go to the centre of the largest forces and report "here".

    Eight learned numbers: each is the product of its value in `GUESS` and exp(theta).

    theta   (n,8), one row per environment
    period  [s] of a step
    """

    GUESS = {
        "descent": 0.05,  # [m/s] until the upward force reaches `contact`
        "contact": 1.0,  # [N]
        "width": 0.006,  # [m] half of the scanned square's side
        "spacing": 0.004,  # [m] of the lines
        "speed": 0.05,  # [m/s] along a line
        "sharpness": 30.0,  # [1] b: places are averaged with the weight force^b
        "homing": 0.2,  # [s] time constant of the motion to the average
        "margin": 0.001,  # [m] distance from it within which the policy reports "here"
    }
    size = len(GUESS)
    plan = {"candidates": 20, "episodes": 6, "generations": 16, "duration": 8.0}

    def __init__(self, theta: np.ndarray, period: float) -> None:
        self.period, count = period, len(theta)
        self.set = dict(
            zip(self.GUESS, np.exp(np.clip(theta, -3, 3)).T * [[v] for v in self.GUESS.values()], strict=True)
        )
        self.start: np.ndarray | None = None
        self.goal, self.path = np.zeros((count, 2)), np.zeros(count)  # [m] of the hand from the start; along the zigzag
        self.down = np.zeros(count, bool)
        self.peak, self.weight, self.sum = np.full(count, 1e-9), np.zeros(count), np.zeros((count, 2))

    def __call__(self, seen: dict[str, np.ndarray]) -> np.ndarray:
        now, force = seen["position"].astype(float), seen["force"][:, 2].astype(float)
        if self.start is None:
            self.start = now[:, :2].copy()
        here, own = now[:, :2] - self.start, self.set
        lines = self.path / (2.0 * own["width"])
        scanned = lines * own["spacing"] > 2.0 * own["width"]
        corner = (2.0 * np.abs(lines % 2.0 - 1.0) - 1.0) * own["width"]  # a triangle wave
        point = np.stack([corner, lines * own["spacing"] - own["width"]], axis=1)
        reached = np.linalg.norm(point - self.goal, axis=1) < own["speed"] * self.period + 1e-6
        self.down |= force > own["contact"]
        self._remember(here, force, self.down & ~scanned & (reached | (self.path > 0.0)))
        self.path += np.where(self.down & ~scanned & reached, own["speed"] * self.period, 0.0)
        away = self.sum / np.maximum(self.weight, 1e-300)[:, None] - here
        move = np.where(scanned[:, None], away / own["homing"][:, None], (point - self.goal) / self.period)
        move *= self.down[:, None]
        move = np.clip(move, -SPEED, SPEED)
        self.goal += move * self.period
        answer = scanned & (np.linalg.norm(away, axis=1) < own["margin"])
        return np.column_stack([move, np.where(self.down, 0.0, -own["descent"]), answer])

    def _remember(self, here: np.ndarray, force: np.ndarray, counts: np.ndarray) -> None:
        """Add a place to the weighted mean; weights are relative to that of the largest force, to avoid overflow."""
        b, force = self.set["sharpness"], np.maximum(force, 1e-9)
        peak = np.where(counts, np.maximum(self.peak, force), self.peak)
        old, new = (self.peak / peak) ** b, np.where(counts, force / peak, 0.0) ** b
        self.weight, self.peak = self.weight * old + new, peak
        self.sum = self.sum * old[:, None] + new[:, None] * here


POLICIES = {"Press": Press, "FindNodule": FindNodule}


def returns(envs: Any, policy: Any, seeds: list[int]) -> np.ndarray:
    """(n) Return of one episode per environment."""
    seen, _ = envs.reset(seed=seeds)
    total, over = np.zeros(len(seeds)), np.zeros(len(seeds), bool)
    while not over.all():
        actions = np.where(over[:, None], 0.0, policy(seen))
        seen, reward, ended, late, _ = envs.step(actions)
        total += np.where(over, 0.0, reward)
        over |= ended | late
    return total


def train(task: str, seed: int = 0, show: Any = print, **changes: Any) -> dict[str, Any]:
    """The mean of the last generation, and the returns of all; `changes` replace entries of the policy's `plan`."""
    kind, random, begun = POLICIES[task], np.random.default_rng(seed), process_time()
    count, episodes, generations, duration = (kind.plan | changes).values()
    envs = gymnasium.make_vec(
        f"palpate/{task}-v0", count * episodes, vectorization_mode="vector_entry_point", duration=duration
    )
    mean, spread, best, curve = np.zeros(kind.size), np.ones(kind.size), max(2, count // 5), []
    for generation in range(generations):
        theta = mean + spread * random.standard_normal((count, kind.size))
        theta[0] = mean
        seeds = [TRAINING_SEED + 10_000 * seed + episodes * generation + number for number in range(episodes)]
        policy = kind(np.repeat(theta, episodes, axis=0), envs.tasks[0].step_time)
        reached = returns(envs, policy, seeds * count).reshape(count, episodes).mean(axis=1)
        elite = theta[np.argsort(-reached, kind="stable")[:best]]
        added = 0.3 * max(0.0, 1.0 - generation / (0.7 * generations))  # variance that prevents early convergence
        mean, spread = elite.mean(axis=0), np.sqrt(elite.var(axis=0) + added**2)
        row = {"mean": reached[0], "best": reached.max(), "middle": np.median(reached), "time": process_time() - begun}
        curve.append({name: round(float(value), 4) for name, value in row.items()})
        show(f"{generation:3d}  " + "  ".join(f"{name} {value:7.3f}" for name, value in curve[-1].items()), flush=True)
    envs.close()
    return {"task": task, "seed": seed, "duration": duration, "theta": mean.tolist(), "curve": curve}


def policy(trained: dict[str, Any], period: float) -> Any:
    """A trained policy for a single environment."""
    act = POLICIES[trained["task"]](np.array([trained["theta"]]), period)
    return lambda seen: act({name: part[None] for name, part in seen.items()})[0]


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("task", choices=POLICIES)
    options.add_argument("--seeds", type=int, nargs="+", default=[0], help="one policy each")
    options.add_argument("--score", type=int, metavar="EPISODES")
    options.add_argument("-f", "--file", type=Path, help="of the policies (TASK.json)")
    given = options.parse_args()
    file = given.file or Path(f"{given.task}.json")
    if not given.score:
        file.write_text(json.dumps([train(given.task, seed) for seed in given.seeds]) + "\n")
        return
    env = gymnasium.make(f"palpate/{given.task}-v0")
    for trained in json.loads(file.read_text()):
        played = score(env, partial(policy, trained, env.unwrapped.step_time), range(given.score))
        print(f"policy of seed {trained['seed']}")
        for name in played[0]:
            values = [each[name] for each in played]
            print(f"  {name}: mean {np.mean(values):.4g}, median {np.median(values):.4g}, "
                  f"{min(values):.4g} to {max(values):.4g}")  # fmt: skip


if __name__ == "__main__":
    main()
