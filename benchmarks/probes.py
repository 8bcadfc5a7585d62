"""Coverage of the intervals for many sparse probes (`palpate fit tissue`), and how often `fit map` finds a ball.

python benchmarks/probes.py [organs] [first seed]     20 organs by default, of 100 probes with ten rows each
python benchmarks/probes.py balls [maps] [first seed]
python benchmarks/probes.py laws [organs] [first seed]

Organs: a ball of 8 mm pressed 0.8 mm; Young's modulus of 5 to 50 kPa at the median place, a factor of 1.1 to 1.8 as its
standard deviation between places, noise of 0.5 to 3 % of the peak, touch points within 0.1 mm, zeros of the force with
the standard deviation of the noise. "independent": places of independent modulus; "smooth": with the covariance of a
field whose length is 10 % of the organ. The smooth mean is that of the process, not of the probed region.
Laws: the power law and the exponential, 60 probes whose sensor was not tared, from 0.2 mm above the surface or from
0.2 mm after contact on; without regard to whether the fit withholds the interval.
Balls: the probes of a ball of 4 mm on 36 x 15 mm, one stiff ball of 2.5 to 4 mm radius, its top 0.5 to 2 mm deep.
"""

from __future__ import annotations

import math
import sys

import numpy as np
from scipy.spatial.distance import cdist

from palpate.models.fit.probes.field import matern
from palpate.models.fit.probes.fit import fit_probes
from palpate.models.fit.probes.inclusion import Ground, _Balls, find_inclusions
from palpate.models.fit.probes.pooled import Rows, fit_pooled
from palpate.models.fit.probes.read import Probes
from palpate.models.fit.tissue.rigs import Rig, closed_form

RADIUS, DEEPEST = 8e-3, 0.8e-3


def organ(seed: int, smooth: bool, count: int = 100) -> tuple[Probes, float, np.ndarray]:
    """Probes, the modulus of the median place [Pa], and the moduli of all places [Pa]."""
    random = np.random.default_rng(seed)
    median = 5e3 * 10.0 ** random.uniform(0.0, 1.0)
    spread = math.log(random.uniform(1.1, 1.8))
    places = np.column_stack([random.uniform(0.0, 0.1, (count, 2)), np.zeros(count)])
    away = random.standard_normal(count)
    if smooth:
        away = np.linalg.cholesky(matern(cdist(places, places), 1.0, 0.01) + 1e-9 * np.eye(count)) @ away
    young = median * np.exp(spread * away)
    size = 16.0 / 9.0 * math.sqrt(RADIUS)
    noise = random.uniform(0.005, 0.03) * size * median * DEEPEST**1.5
    depth = np.tile(np.linspace(0.06e-3, DEEPEST - 1e-6, 10), (count, 1))
    touch = 1e-4 * random.standard_normal((count, 1))
    force = size * young[:, None] * np.maximum(depth - touch, 0.0) ** 1.5
    force += noise * (random.standard_normal((count, 1)) + random.standard_normal(depth.shape))
    names = [str(k) for k in range(count)]
    return Probes(names, Rows(depth, force, np.ones(depth.shape, bool)), places, None, [], ["simulated"]), median, young


def organs(count: int = 20, first: int = 0) -> None:
    law = closed_form(Rig("ball", RADIUS), "hertz")
    for smooth in (False, True):
        mean = withheld = inside = 0
        for seed in range(first, first + count):
            probes, median, young = organ(seed, smooth)
            fit = fit_probes(probes, law)
            low, high = fit.intervals["young"]
            mean += low <= median <= high
            withheld += bool(fit.withheld)
            inside += int((np.abs(fit.shrunk - np.log(young)) <= 1.959964 * fit.shrunk_error).sum())
        name = "smooth" if smooth else "independent"
        print(f"{name:12s} median within its interval {mean}/{count}, withheld {withheld}; "
              f"modulus of a place {inside}/{100 * count}", flush=True)  # fmt: skip


def balls(count: int = 20, first: int = 0) -> None:
    across, along = np.meshgrid(np.linspace(0.0, 0.015, 8), np.linspace(0.0, 0.036, 13))
    places = np.column_stack([along.ravel(), across.ravel(), np.zeros(along.size)])
    found = extra = false = 0
    hits = np.zeros(3)
    for seed in range(first, first + count):
        random = np.random.default_rng(seed)
        at = places + 2e-4 * np.column_stack([random.standard_normal((len(places), 2)), np.zeros(len(places))])
        ground = Ground.of(at, np.tile([0.0, 0.0, 1.0], (len(at), 1)), 3.5e-3)
        maker = _Balls(ground, 100.0)
        radius, top = random.uniform(2.5e-3, 4e-3), random.uniform(0.5e-3, 2e-3)
        uv = random.uniform(ground.plane.min(axis=0) + 3e-3, ground.plane.max(axis=0) - 3e-3)
        cov = matern(cdist(at, at), 0.08, 7e-3) + 1e-8 * np.eye(len(at))
        rest = np.linalg.cholesky(cov) @ random.standard_normal(len(at))
        noise, errors = 0.03 * random.standard_normal(len(at)), np.full(len(at), 0.02)
        false += len(find_inclusions(ground, rest + noise, errors, 100.0)[0])
        ball = np.array([*uv, math.log(top), math.log(radius)])
        seen = find_inclusions(ground, maker(ball) + rest + noise, errors, 100.0)[0]
        apart = [float(np.linalg.norm((one.position - ground.middle) @ ground.axes.T - uv)) for one in seen]
        if not seen or min(apart) > radius:
            continue
        one = seen[int(np.argmin(apart))]
        off = np.abs((one.position - ground.middle) @ ground.axes.T - uv)
        found, extra = found + 1, extra + len(seen) - 1
        hits += [(off <= one.across).all(), one.depth[1] <= top + radius <= one.depth[2],
                 one.radius[1] <= radius <= one.radius[2]]  # fmt: skip
    print(f"found {found}/{count}, others {extra}; without a ball {false} found; within the interval: position "
          f"{hits[0]:g}, depth {hits[1]:g}, radius {hits[2]:g} of {found}")  # fmt: skip


def laws(count: int = 20, first: int = 0) -> None:
    truth = {"power": {"stiffness": 3e4, "exponent": 1.5}, "exponential": {"stiffness": 50.0, "hardening": 1200.0}}
    depth = np.linspace(0.05e-3, 0.78e-3, 10)
    for name, values in truth.items():
        law = closed_form(Rig("ball", RADIUS), name)
        for away in (2e-4, 1e-4, -1e-4, -2e-4):
            inside, withheld = dict.fromkeys(values, 0), 0
            for seed in range(first, first + count):
                random = np.random.default_rng(seed)
                scale, touch = np.exp(0.3 * random.standard_normal(60)), away + 1e-4 * random.standard_normal(60)
                force = np.array(
                    [k * law.force(values, np.maximum(depth - t, 0.0)) for k, t in zip(scale, touch, strict=True)]
                )
                peak = float(np.median(force[:, -1]))
                force += peak * (0.3 + 0.02 * random.standard_normal((60, 1)) + 0.01 * random.standard_normal((60, 10)))
                fit = fit_pooled(Rows.of([depth] * 60, list(force)), law)
                withheld += bool(fit.withheld)
                for key, value in values.items():
                    inside[key] += fit.intervals[key][0] <= value <= fit.intervals[key][1]
            shown = ", ".join(f"{key} {n}/{count}" for key, n in inside.items())
            print(
                f"{name:12s} contact at {1e3 * away:+.1f} mm: within its interval {shown}; withheld {withheld}",
                flush=True,
            )


if __name__ == "__main__":
    words = sys.argv[1:]
    run = {"balls": balls, "laws": laws}.get(words[0] if words else "", organs)
    run(*(int(word) for word in words if word.isdigit()))
