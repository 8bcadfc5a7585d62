"""Steps per second of the environments for learning, and the scores of the scripted policies.

    python benchmarks/environment.py [--turns N] [--episodes N] [--json]

One process on one core; steps over processor time, best of N turns. Touch: the kidney with MassSpring, the finger
pressed in by 2 N. "graph": ticks per second of the same graph without an environment. The random policy draws each
action from the action space.
"""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter, process_time

import gymnasium
import numpy as np
from tables import parser, print_tables

import palpate.gym  # noqa: F401  registers the environments
from palpate.gym.scripted import Approach, Policy, Search, score
from palpate.gym.touch import Touch

STEPS = 4000


def rate(step: Callable[[], object], steps: int, turns: int) -> float:
    """Steps per second of processor time."""
    times = []
    for _ in range(turns):
        begun = process_time()
        for _ in range(steps):
            step()
        times.append(process_time() - begun)
    return steps / min(times)


def speed(turns: int) -> list[dict[str, object]]:
    """One row for each number of ticks per step."""
    rows: list[dict[str, object]] = []
    for ticks in (1, 10):
        env = Touch(ticks=ticks, duration=1e9)
        env.reset(seed=0)
        down, still = np.array([0.0, 0.0, -0.05], np.float32), np.zeros(3, np.float32)
        for _ in range(450 // ticks):
            env.step(down)
        steps = STEPS // ticks
        speed = rate(lambda env=env, still=still: env.step(still), steps, turns)  # type: ignore[misc]
        graph = rate(env.stepper.tick, steps * ticks, turns)
        reset = rate(env.reset, 20, turns)
        row = {"ticks a step": ticks, "steps a second": speed, "ticks a second": speed * ticks, "graph": graph}
        rows.append(row | {"reset [ms]": 1e3 / reset})
        env.close()
    return rows


def parallel(turns: int, count: int = 256, ticks: int = 10) -> list[dict[str, object]]:
    """Steps per second of `count` environments in parallel with the finger pressed in, by wall and processor time."""
    rows: list[dict[str, object]] = []
    for name in ("Touch", "Press", "FindNodule"):
        begun = perf_counter()
        envs = gymnasium.make_vec(
            f"palpate/{name}-v0", num_envs=count, vectorization_mode="vector_entry_point", ticks=ticks, duration=1e9
        )
        envs.reset(seed=0)
        built = perf_counter() - begun
        action = np.zeros(envs.action_space.shape, np.float32)
        action[:, 2] = -0.05
        for _ in range(45):
            envs.step(action)
        action[:, 2] = 0.0
        times = []
        for _ in range(turns):
            begun, used = perf_counter(), process_time()
            for _ in range(10):
                envs.step(action)
            times.append((perf_counter() - begun, process_time() - used))
        wall, processor = (10 * count / least for least in np.min(times, axis=0))
        rows.append({"task": name, "environments": count, "ticks a step": ticks, "steps a second": wall,
                     "of one core's time": processor, "made and reset [s]": built})  # fmt: skip
        envs.close()
    return rows


def scores(episodes: int) -> list[dict[str, object]]:
    """One row for each task and policy."""
    rows: list[dict[str, object]] = []
    for task, score_name in (("FindNodule", "distance"), ("Press", "error")):
        env = gymnasium.make(f"palpate/{task}-v0")
        period = env.unwrapped.step_time  # type: ignore[attr-defined]
        policies: dict[str, Callable[[], Policy]] = {
            "scripted": (lambda period=period: Search(period)) if task == "FindNodule" else Approach,
            "random": lambda env=env: lambda _: env.action_space.sample(),
        }
        for name, policy in policies.items():
            env.action_space.seed(0)
            played = score(env, policy, range(episodes))
            returns, last = [each["return"] for each in played], [each.get(score_name, np.nan) for each in played]
            row: dict[str, object] = {"task": task, "policy": name, "return, mean": float(np.mean(returns))}
            row |= {
                "worst": min(returns),
                "best": max(returns),
                "time [s]": float(np.mean([e["time"] for e in played])),
            }
            unit, scale = ("mm", 1e3) if score_name == "distance" else ("N", 1.0)
            rows.append(row | {f"{score_name} [{unit}], median": float(np.median(last)) * scale})
        env.close()
    return rows


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--turns", type=int, default=5)
    options.add_argument("--episodes", type=int, default=20)
    given = options.parse_args()
    tables = {"Steps a second": speed(given.turns), "In parallel": parallel(given.turns)}
    print_tables(tables | {"Scores": scores(given.episodes)}, given.json, digits=3)


if __name__ == "__main__":
    main()
