"""Place and size of a nodule from touch, on an organ that the training has not felt (docs/find_a_nodule.md).

    python benchmarks/find_nodule.py [--touches N] [--seeds S ...] [--store FOLDER] [--picture FILE] [--json]

Errors of the trees of docs/examples/find_nodule.py for each seed, which draws touches, livers and trees; next to a
constant guess, the rule of the gym's scripted policy `Search`, the place of the largest forces, on the same measured
maps, and `Search` itself, which steers the finger over the same tumours, once each, with the finger and tissue of the
graph `nodule` and without noise. Needs the extra `learn`.
"""

from __future__ import annotations

import sys
import tempfile
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from tables import parser, print_tables

import palpate
from palpate.gym.find_nodule import FindNodule
from palpate.gym.hands import Changes
from palpate.gym.scripted import Search, score

sys.path.insert(0, str(Path(__file__).parents[1] / "docs" / "examples"))
import find_nodule as example

LIVERS, LANES, ORGANS = 5, 8, 6


def touches(folder: Path, count: int, seed: int) -> tuple[example.Touches, example.Touches]:
    """Touches to train with and of livers, stored in the folder."""
    found = []
    for name in ("train", "liver"):
        file = folder / f"{name}-{seed}.npz"
        if not file.exists():
            made = (
                example.draw_training(folder, count, ORGANS, seed) if name == "train"
                else example.draw_livers(folder, LIVERS, LANES, seed)
            )  # fmt: skip
            np.savez(file, features=made.features, answers=made.answers)
        stored = np.load(file)
        found.append(example.Touches(stored["features"], stored["answers"]))
    return found[0], found[1]


class AtTumour(FindNodule):
    """`FindNodule` with the nodule where the label of the organ is."""

    def draw_settings(self) -> Changes:
        return {name: values for name, values in super().draw_settings().items() if name != self.body}


def steer(folder: Path, seed: int) -> dict[str, float]:
    """Errors of the scripted policy on the livers of a seed, whose files are in the folder."""
    away = []
    for number in range(LIVERS):
        env = AtTumour(organ={"file": str(folder / f"liver-{seed}-{number}.nii.gz"), "label": "1+2"})
        away.append(1e3 * score(env, lambda env=env: Search(env.step_time), range(1))[0]["distance"])
    return {"place, median": float(np.median(away)), "place, 90 %": float(np.quantile(away, 0.9))}


def compare(folder: Path, count: int, seed: int) -> tuple[list[dict[str, Any]], tuple[np.ndarray, np.ndarray]]:
    """Rows of a seed, and the found places (n,4) with the answers."""
    training, livers = touches(folder, count, seed)
    trees = example.train(training, seed)
    found = trees.predict(livers.features)
    constant = np.tile(training.answers.mean(axis=0), (len(livers.answers), 1))
    by = {
        "trees": example.errors(found, livers.answers),
        "constant guess": example.errors(constant, livers.answers),
        "rule of Search": example.errors(example.peak_rule(livers.features), livers.answers),
        "Search steers": steer(folder, seed),
    }
    return [{"seed": seed, "by": name, **row} for name, row in by.items()], (found, livers.answers)


def draw(file: Path, found: np.ndarray, answers: np.ndarray) -> None:
    """Found over true place, and radius."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 3, figsize=(11, 3.8), layout="constrained")
    for k, (panel, name) in enumerate(zip(axes, ("x on the surface", "y on the surface", "radius"), strict=True)):
        true = 1e3 * answers[:, k]
        low, high = true.min() - 1.0, true.max() + 1.0
        panel.plot([low, high], [low, high], color="0.6", lw=1)
        panel.plot(true, 1e3 * found[:, k], "o", ms=4, alpha=0.5)
        panel.set(xlabel=f"true {name} [mm]", ylabel=f"found {name} [mm]", aspect="equal")
    figure.savefig(file, dpi=110)


def main() -> None:
    made = parser(__doc__)
    made.add_argument("--touches", type=int, default=360, help="touches to train with")
    made.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2])
    made.add_argument("--store", type=Path, help="folder that keeps the touches")
    made.add_argument("--picture", type=Path)
    given = made.parse_args()
    warnings.simplefilter("ignore", palpate.PalpateWarning)
    rows, found = [], []
    with tempfile.TemporaryDirectory() as made_folder:
        folder = given.store or Path(made_folder)
        folder.mkdir(parents=True, exist_ok=True)
        for seed in given.seeds:
            more, pair = compare(folder, given.touches, seed)
            rows += more
            found.append(pair)
    if given.picture:
        draw(given.picture, *(np.concatenate(part) for part in zip(*found, strict=True)))
    print_tables({"errors on the held-out liver [mm]": rows}, given.json, digits=3)


if __name__ == "__main__":
    main()
