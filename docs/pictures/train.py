"""Draw the learning curves of the trained policies: python docs/pictures/train.py [folder]

train.png  docs/examples/trained/*.json, which docs/examples/train.py wrote, and the scripted and random policies
"""

from __future__ import annotations

import json
from pathlib import Path

import gymnasium
import matplotlib
import numpy as np

import palpate.gym  # noqa: F401  registers the environments
from palpate.gym.scripted import Approach, Search, score

TRAINED = Path(__file__).parents[1] / "examples" / "trained"
EPISODES = 4


def baselines(task: str, duration: float) -> dict[str, float]:
    """Mean return of the scripted and of the random policy, in episodes of the training's duration."""
    env = gymnasium.make(f"palpate/{task}-v0", duration=duration)
    period = env.unwrapped.step_time  # type: ignore[attr-defined]
    env.action_space.seed(0)
    scripted = Approach if task == "Press" else lambda: Search(period)
    policies = {"scripted": scripted, "random": lambda: lambda _: env.action_space.sample()}
    found = {
        name: float(np.mean([each["return"] for each in score(env, policy, range(EPISODES))]))
        for name, policy in policies.items()
    }
    env.close()
    return found


def main(folder: Path) -> list[Path]:
    """Read, play, draw."""
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, panels = plt.subplots(1, 2, figsize=(8, 3.2), constrained_layout=True)
    for panel, task in zip(panels, ("Press", "FindNodule"), strict=True):
        policies = json.loads((TRAINED / f"{task}.json").read_text())
        duration = policies[0]["duration"]
        for trained in policies:
            rows = trained["curve"]
            time = [row["time"] for row in rows]
            (line,) = panel.plot(time, [row["middle"] for row in rows], label=f"seed {trained['seed']}")
            panel.fill_between(
                time, [row["middle"] for row in rows], [row["best"] for row in rows], color=line.get_color(), alpha=0.15
            )
        for (name, value), style in zip(baselines(task, duration).items(), ("--", ":"), strict=True):
            panel.axhline(value, color="black", linestyle=style, linewidth=1, label=name)
        panel.set(
            title=f"{task}-v0, episodes of {duration:g} s",
            xlabel="processor time of the training [s]",
            ylabel="return: median and best candidate",
        )
        panel.legend(loc="lower right", fontsize=8)
    folder.mkdir(parents=True, exist_ok=True)
    target = folder / "train.png"
    figure.savefig(target, dpi=130)
    return [target]


if __name__ == "__main__":
    from target import folder

    print(*main(folder(__doc__)), sep="\n")
