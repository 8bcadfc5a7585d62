"""Depth and modulus of a nodule by a few presses: places by information gain, against two fixed plans.

    python benchmarks/nodule_presses.py [--nodules 20] [--presses 9] [--picture FILE]

The environment is that of palpate/FindNodule-v0 with an ideal hand: flat tissue with a nodule of 4 mm radius at an
unknown place of a square of 24 mm, now also of unknown depth and modulus. A press moves the goal of the hand down by
16 mm in 0.08 s and holds it for 0.06 s; the normal force at its end is measured with white noise of 2 mN. All plans
make the same number of presses, and the same estimator follows: the best of random nodules by a table of forces over
distance, depth and modulus, then Gauss-Newton steps to the largest posterior with `info["gradient"]`. The plans:

information  after 5 presses, each next press is at the one of 5 places around the estimate that reduces the expected
             sum of the variances of log depth and log modulus most: A-optimal, from the Fisher matrix at the estimate
scripted     the scan of `palpate.gym.scripted.Search` as a grid of presses, then presses at the centre of the largest
             forces, as it does
trained      the same along the zigzag of the policy of docs/examples/trained: as far from each other as possible on it

Prints for each the errors, and how often the true value is inside the interval of 95 %. Takes minutes.
"""

import argparse
import json
import time
import warnings
from pathlib import Path

import numpy as np
from scipy.interpolate import RegularGridInterpolator

import palpate
from palpate.gym import Touch
from palpate.gym.find_nodule import FIELD
from palpate.gym.vector import VectorTouch

BY = ["tissue.nodule_position[0]", "tissue.nodule_position[1]", "tissue.nodule_depth", "tissue.nodule_ratio"]
SURFACE = 0.105  # [m] height of the tissue
BEGIN = 0.1135  # [m] of the hand, just above contact
DOWN, HOLD = 4, 3  # steps of 20 ticks
SPEED = 0.2  # [m/s]
NOISE = 0.002  # [N]
MEAN = np.array([0.0, 0.0, np.log(7e-3), np.log(6.0)])
SPREAD = np.array([7e-3, 7e-3, 0.15, 0.6])
"""Prior of x, y [m], log depth, log ratio of the moduli; those of the place are the deviation of the uniform square."""
AWAY = 1e-3 * np.array([0, 1, 2, 3, 4, 5, 6, 7, 8, 10, 12, 15, 20])  # [m] of the table
AROUND = 4e-3 * np.array([(0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)])
"""[m] Candidates for the next press, from the estimated place."""
TRAINED = Path(__file__).parents[1] / "docs" / "examples" / "trained" / "FindNodule.json"
GUESS = {"width": 0.006, "spacing": 0.004, "sharpness": 30.0}  # of docs/examples/train.py
PLACES = {"width": 2, "spacing": 3, "sharpness": 5}  # of these numbers in the trained policy
TOLERANCE = 0.05  # [1] of the derivatives: vertices at the rim of the nodule make small kinks
STEPS, LARGEST = 4, 1.0  # of Gauss-Newton: number, and largest change in standard deviations of the prior


class PressAt(Touch):
    """A press at `place` on tissue with the nodule `theta`."""

    place, theta = np.zeros(2), MEAN

    def draw_settings(self):
        x, y, depth, ratio = self.theta
        nodule = {"nodule_position": (float(x), float(y), SURFACE), "nodule_depth": float(np.exp(depth)),
                  "nodule_ratio": float(np.exp(ratio))}  # fmt: skip
        return {"device": {"begin": (*map(float, self.place), BEGIN)}, "tissue": nodule}


class Bench:
    """Forces [N] (n) of presses, and their derivatives by theta (n,4)."""

    def __init__(self, count: int, **given) -> None:
        self.envs = VectorTouch(
            PressAt, count, graph="nodule", ticks=20, ideal=True, tolerance=TOLERANCE, threads=1, **given
        )

    def __call__(self, places, theta):
        for number, task in enumerate(self.envs.tasks):
            task.place, task.theta = places[min(number, len(places) - 1)], theta
        self.envs.reset(seed=0)
        action = np.zeros((self.envs.num_envs, 3))
        for number in range(DOWN + HOLD):
            action[:, 2] = -SPEED * (number < DOWN)
            seen, *_, infos = self.envs.step(action)
        force = seen["force"][: len(places), 2].astype(float)
        if "gradient" not in infos:
            return force, None
        jacobian = infos["gradient"][: len(places), :, 2].copy()
        jacobian[:, 2:] *= np.exp(theta[2:])
        return force, jacobian


class Table:
    """Forces [N] of presses over distance from the nodule, log depth and log ratio."""

    def __init__(self) -> None:
        bench, away = Bench(len(AWAY)), np.column_stack([AWAY, np.zeros(len(AWAY))])
        self.axes = [MEAN[k] + SPREAD[k] * np.linspace(-2.2, 2.2, 7) for k in (2, 3)]
        made = [[bench(away, np.array([0.0, 0.0, d, r]))[0] for r in self.axes[1]] for d in self.axes[0]]
        self.force = RegularGridInterpolator((*self.axes, AWAY), np.array(made))

    def guess(self, places, forces, rng) -> np.ndarray:
        """The nodule with the largest posterior among random ones; noise of 3 times covers the table."""
        best, spread = MEAN, SPREAD
        for _ in range(4):
            drawn = np.vstack([best, best + spread * rng.standard_normal((4000, 4))])
            depth, ratio = (np.clip(drawn[:, k], axis[0], axis[-1]) for k, axis in zip((2, 3), self.axes, strict=True))
            away = np.hypot(drawn[:, :1] - places[:, 0], drawn[:, 1:2] - places[:, 1])
            at = np.broadcast_arrays(depth[:, None], ratio[:, None], np.minimum(away, AWAY[-1]))
            unlike = (self.force(np.stack(at, axis=-1)) - forces) / (3.0 * NOISE)
            cost = np.sum(unlike**2, axis=1) + np.sum(((drawn - MEAN) / SPREAD) ** 2, axis=1)
            best, spread = drawn[int(np.argmin(cost))], 0.4 * spread
        return best


def make_benches(presses: int):
    """For measured forces, for derivatives at the presses and at the candidates, and the table."""
    return Bench(presses), Bench(presses, gradient=BY), Bench(len(AROUND), gradient=BY), Table()


class Presses:
    """Presses on one nodule, and what is known from them."""

    def __init__(self, benches, truth, rng) -> None:
        self.true, self.derived, self.candidates, self.table = benches
        self.truth, self.rng = truth, rng
        self.places, self.forces = np.zeros((0, 2)), np.zeros(0)
        self.theta, self.information = MEAN, np.diag(SPREAD**-2.0)

    def press(self, places) -> None:
        """Measure at places (n,2) [m]."""
        force = self.true(places, self.truth)[0]
        self.places = np.vstack([self.places, places])
        self.forces = np.concatenate([self.forces, force + NOISE * self.rng.standard_normal(len(places))])

    def centre(self, sharpness: float) -> np.ndarray:
        """Mean of the places with the weights force^sharpness."""
        weights = (self.forces / self.forces.max()) ** sharpness
        return weights @ self.places / weights.sum()

    def estimate(self, steps: int) -> None:
        """The best of random nodules, then Gauss-Newton steps to the largest posterior, halved where it falls."""
        theta, least, move = self.table.guess(self.places, self.forces, self.rng), np.inf, np.zeros(4)
        for _ in range(steps):
            force, jacobian = self.derived(self.places, theta)
            cost = np.sum(((self.forces - force) / NOISE) ** 2) + np.sum(((theta - MEAN) / SPREAD) ** 2)
            if cost < least:
                least, self.theta = cost, theta
                known = np.isfinite(jacobian).all(axis=1)
                j, r = jacobian[known] / NOISE, (self.forces - force)[known] / NOISE
                self.information = j.T @ j + np.diag(SPREAD**-2.0)
                move = np.linalg.solve(self.information, j.T @ r - (theta - MEAN) / SPREAD**2)
                move /= max(1.0, np.max(np.abs(move) / SPREAD) / LARGEST)
            else:
                move = 0.5 * move
            theta = self.theta + move

    def best_place(self) -> np.ndarray:
        """The candidate that leaves the smallest sum of the variances of log depth and log modulus."""
        near = np.clip(self.theta[:2] + AROUND, -1.3 * FIELD, 1.3 * FIELD)
        _, jacobian = self.candidates(near, self.theta)
        left = [
            np.trace(np.linalg.inv(self.information + np.outer(j, j) / NOISE**2)[2:, 2:])
            if np.isfinite(j).all() else np.inf
            for j in jacobian
        ]  # fmt: skip
        return near[int(np.argmin(left))]


def by_information(touch: Presses, count: int) -> None:
    half = 0.6 * FIELD
    touch.press(np.array([(0, 0), (-half, -half), (half, -half), (-half, half), (half, half)]))
    touch.estimate(1)
    while len(touch.forces) < count:
        touch.press(touch.best_place()[None])
        touch.estimate(1)


def scripted(touch: Presses, count: int) -> None:
    ends = np.linspace(-0.8 * FIELD, 0.8 * FIELD, 3)
    touch.press(np.array([(x, y) for x in ends for y in ends])[: count - 2])
    while len(touch.forces) < count:
        touch.press(touch.centre(30.0)[None])


def trained(touch: Presses, count: int) -> None:
    theta = json.loads(TRAINED.read_text())[0]["theta"]
    width, spacing, sharpness = (GUESS[name] * np.exp(theta[PLACES[name]]) for name in GUESS)
    path = np.linspace(0.0, 2.0 * width / spacing, 1000)  # in lines of the zigzag
    corner = (2.0 * np.abs(path % 2.0 - 1.0) - 1.0) * width
    scanned = np.column_stack([corner, path * spacing - width])
    chosen = [0]
    while len(chosen) < count - 2:  # places of the scan that are as far from each other as possible
        away = np.linalg.norm(scanned[:, None] - scanned[chosen], axis=2).min(axis=1)
        chosen.append(int(np.argmax(away)))
    touch.press(scanned[chosen])
    while len(touch.forces) < count:
        touch.press(touch.centre(sharpness)[None])


PLANS = {"information": by_information, "scripted": scripted, "trained": trained}


def draw(file: Path, shown: dict[str, Presses], rows: dict[str, np.ndarray]) -> None:
    """Picture: presses of one nodule by each plan; estimated over true depth and modulus of all."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, panels = plt.subplots(1, 5, figsize=(15, 3.2), constrained_layout=True)
    for panel, (name, touch) in zip(panels, shown.items(), strict=False):
        panel.add_patch(plt.Circle(1e3 * touch.truth[:2], 4.0, color="0.8"))
        dots = panel.scatter(*(1e3 * touch.places.T), c=touch.forces, s=25, cmap="viridis")
        for number, place in enumerate(touch.places, 1):
            panel.annotate(str(number), 1e3 * place, fontsize=6, xytext=(3, 2), textcoords="offset points")
        panel.plot(*(1e3 * touch.theta[:2]), "rx")
        panel.set(title=f"{name}: presses", xlabel="x [mm]", ylabel="y [mm]", xlim=(-16, 16), ylim=(-16, 16))
        panel.set_aspect("equal")
        figure.colorbar(dots, ax=panel, label="force [N]")
    for panel, place, what, factor in ((panels[3], 2, "depth [mm]", 1e3), (panels[4], 3, "ratio of moduli", 1.0)):
        for name, mark in zip(rows, "o^s", strict=True):
            true, found = (factor * np.exp(rows[name][:, part, place]) for part in (0, 1))
            panel.plot(true, found, mark, markersize=4, label=name, alpha=0.8)
        ends = factor * np.exp(MEAN[place] + 2.2 * SPREAD[place] * np.array([-1, 1]))
        panel.plot(ends, ends, "k-", linewidth=0.8)
        panel.set(title=f"{what}", xlabel="true", ylabel="estimated")
        panel.legend(fontsize=7)
    figure.savefig(file, dpi=110)


def play(number: int, benches, presses: int) -> dict[str, Presses]:
    """One nodule, by each plan."""
    rng = np.random.default_rng(number)
    truth = np.array([*rng.uniform(-FIELD, FIELD, 2), *(MEAN[2:] + SPREAD[2:] * rng.uniform(-1.7, 1.7, 2))])
    played = {}
    for name, plan in PLANS.items():
        touch = played[name] = Presses(benches, truth, np.random.default_rng(1000 + number))
        plan(touch, presses)
        touch.estimate(STEPS)
    return played


def tabulate(played: list[dict[str, Presses]]) -> dict[str, np.ndarray]:
    """By plan, (nodules, 3, 4): true values, estimates, standard deviation."""
    return {
        name: np.array(
            [
                (one[name].truth, one[name].theta, np.sqrt(np.diag(np.linalg.inv(one[name].information))))
                for one in played
            ]
        )
        for name in PLANS
    }


def report(tables: dict[str, np.ndarray]) -> None:
    for name, table in tables.items():
        off = table[:, 1] - table[:, 0]
        place = 1e3 * np.hypot(off[:, 0], off[:, 1])
        inside = np.mean(np.abs(off[:, 2:]) < 1.96 * table[:, 2, 2:], axis=0)
        width = np.exp(1.96 * np.median(table[:, 2, 2:], axis=0)) - 1.0
        print(
            f"{name}: place {np.median(place):.2f} mm (median), {np.quantile(place, 0.9):.2f} mm (90 %); "
            f"|log depth| {np.median(np.abs(off[:, 2])):.3f}, RMS {np.sqrt(np.mean(off[:, 2] ** 2)):.3f}; "
            f"|log ratio| {np.median(np.abs(off[:, 3])):.3f}, RMS {np.sqrt(np.mean(off[:, 3] ** 2)):.3f}; "
            f"half-width of the interval {100 * width[0]:.0f} and {100 * width[1]:.0f} %; "
            f"true value inside {100 * inside[0]:.0f} and {100 * inside[1]:.0f} %"
        )


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--nodules", type=int, default=20)
    options.add_argument("--presses", type=int, default=9)
    options.add_argument("--picture", type=Path)
    given = options.parse_args()
    warnings.simplefilter("ignore", palpate.PalpateWarning)
    benches = make_benches(given.presses)
    begun, played = time.process_time(), []
    for number in range(given.nodules):
        played.append(play(number, benches, given.presses))
        if number % 5 == 4:
            print(f"{number + 1} nodules, {time.process_time() - begun:.0f} s of processor time", flush=True)
    tables = tabulate(played)
    report(tables)
    if given.picture:
        draw(given.picture, played[0], tables)


if __name__ == "__main__":
    main()
