"""Scripted policies, as a baseline for learned ones, and the score of a policy."""

from collections.abc import Callable, Mapping
from typing import Any

import gymnasium
import numpy as np

from palpate.gym.find_nodule import FIELD
from palpate.gym.hands import SPEED

Observation = Mapping[str, np.ndarray]
Policy = Callable[[Observation], np.ndarray]

LINES = 9  # number of lines of the search, 3 mm apart
STROKE = 0.06  # [m/s] along a line
APPROACH = 0.05  # [m/s] downwards, until the force on the finger reaches `FELT`
NEAR, SETTLE = 0.3e-3, 0.1  # [m] distance at which it reports "here"; [s] time constant of the motion to that point
FELT = 1.5  # [N] upward force on the finger at which the approach ends
GAIN = 0.02  # [m/s/N] of the press: 10 /s with the hand's 500 N/m


class Search:
    """Find the nodule from the observation alone.

    The finger moves down until it touches tissue, scans the field line by line at this height, moves to the centre of
    the largest forces and reports "here".

    period  [s] of a step of the environment
    """

    def __init__(self, period: float) -> None:
        self.period = period
        ends = np.linspace(-FIELD, FIELD, LINES)
        sides = np.where(np.arange(LINES) % 2 == 0, FIELD, -FIELD)
        self.corners = [np.array([x, y]) for y, side in zip(ends, sides, strict=True) for x in (-side, side)]
        self.middle: np.ndarray | None = None
        self.goal: np.ndarray | None = None
        self.found: np.ndarray | None = None
        self.down = False
        self.felt: list[tuple[float, float, float]] = []

    def __call__(self, observation: Observation) -> np.ndarray:
        here, force = observation["position"].astype(float), observation["force"].astype(float)
        if self.middle is None:
            self.middle, self.goal = here[:2], here[:2]
        assert self.goal is not None
        if not self.down:
            self.down = bool(force[2] >= FELT)
            return _action(0.0, 0.0, -APPROACH, 0.0)
        if len(self.corners) < 2 * LINES:  # the force on the path to the first corner still depends on the approach
            self.felt.append((here[0], here[1], force[2]))
        if not self.corners:
            if self.found is None:
                self.found = self._mean_place()
            away = self.found - here[:2]  # not from the goal: the finger lags it by millimetres, because of friction
            near = float(np.hypot(*away)) < NEAR
            return _action(*np.clip(away / SETTLE, -STROKE, STROKE), 0.0, float(near))
        away = self.middle + self.corners[0] - self.goal
        far = float(np.hypot(*away))
        move = away * min(1.0, STROKE * self.period / max(far, 1e-9))
        self.goal = self.goal + move
        if far <= STROKE * self.period:
            self.corners.pop(0)
        return _action(*(move / self.period), 0.0, 0.0)

    def _mean_place(self) -> np.ndarray:
        """Mean of the places, weighted with the force above the 90th percentile."""
        table = np.array(self.felt)
        weights = np.maximum(table[:, 2] - np.quantile(table[:, 2], 0.9), 0.0)
        return table[:, :2].T @ weights / weights.sum() if weights.sum() > 0.0 else table[0, :2]


class Approach:
    """Press with the target force: the hand moves down at `GAIN` times the error of the force."""

    def __call__(self, observation: Observation) -> np.ndarray:
        error = float(observation["wanted"][0] - np.linalg.norm(observation["force"]))
        return np.array([0.0, 0.0, np.clip(-GAIN * error, -SPEED, SPEED)], np.float32)


def _action(*numbers: float) -> np.ndarray:
    return np.array(numbers, np.float32)


def score(env: gymnasium.Env, policy: Callable[[], Policy], seeds: range) -> list[dict[str, Any]]:
    """Run one episode per seed with a new policy; of each, `info` of its last step, with the `return`."""
    episodes = []
    for seed in seeds:
        act, total, over = policy(), 0.0, False
        observation, info = env.reset(seed=seed)
        while not over:
            observation, reward, terminated, truncated, info = env.step(act(observation))
            total += float(reward)
            over = terminated or truncated
        episodes.append({**info, "return": total})
    return episodes
