"""Closest point of a NURBS surface, tracked from tick to tick.

Newton's method from the last foot point finds a local minimum of the distance. To find the global one, each step also
checks samples of the surface. Every point of the surface is within `cover` of a sample, so a nearer minimum has a
sample nearer than the current distance plus `cover`. Descending over the samples from there ends at one that is nearer
than all its neighbours. Newton's method starts from each of these that does not belong to a known minimum. Bounding
spheres round 16 samples each limit the cost.

The foot point remains on its branch until another one is nearer by more than the hysteresis. The distance is always
that of the nearest branch, and therefore 1-Lipschitz along any path.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from palpate.compiler.fields import blank_record
from palpate.compiler.kernel import kernel
from palpate.compiler.records import put, vector
from palpate.physics.arrays import Array, Indices, Matrix, Record, Tensor, Vector3
from palpate.physics.geometry.newton import flattest, inside_border, newton
from palpate.physics.geometry.nurbs import NurbsPatch, evaluate, normal_of
from palpate.physics.geometry.search.foot import FOOT, find_feet
from palpate.physics.geometry.search.samples import samples_of

FAR = 1e9  # [m] Limit of coordinates, so that squares are finite
SAMPLES = 2500
SLACK = 0.1
"""[1] Tolerance of squared distances when samples are compared with their neighbours, over the squared cover; the
sagitta is added. Between two minima at nearly the same distance the distance of the samples may show no maximum."""
FLAT = 0.25  # [1] 1 - d kappa (distance times curvature) at a foot point below which its neighbourhood is also searched
ROUND = 9  # Number of directions in which the search leaves a collapsed border
STARTS = 8  # Maximum number of starts of Newton's method per step, in addition to the last foot point
START = {"sample": int, "square": (), "point": (3,), "least": ()}
"""A sample from which a search starts, and its squared distance [m²]; the minimum found from there [m], and its squared
distance [m²]."""
TRACKED = {"exists": bool, "place": (2,), "normal": (3,), "starts": (STARTS, START)}
"""From step to step: whether a last foot point exists, and its u and v. Of the last step: the normal at the
nearest point [1], and the starts of the search."""


@dataclass(frozen=True, eq=False)
class ClosestPoint:
    """Finds and tracks closest points of a surface: `find` for independent points, `track` for one moving point. The
    samples are computed at the first use."""

    surface: NurbsPatch

    @cached_property
    def tables(self) -> tuple[Any, ...]:
        """Arguments of the kernels: `NurbsPatch.packed` and `SurfaceSamples`."""
        return (*self.surface.packed, *samples_of(self.surface, SAMPLES))

    def scratch(self) -> tuple[Record, np.ndarray, np.ndarray, Record]:
        """State, workspace, derivatives and result of `track`."""
        work = np.empty(24 + 3 * (self.surface.degree_u + self.surface.degree_v + 2))
        return blank_record(TRACKED), work, np.empty((2, 6, 3)), blank_record(FOOT)

    def find(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Foot points [m] (...,3), outward normals [1] (...,3), parameters [1] (...,2) and signed distances [m] (...),
        positive outside, of points [m] (...,3)."""
        scratch = self.scratch()[:3]
        feet = find_feet(lambda each, found: _find(*self.tables, each, *scratch, found), points)
        return feet["point"], feet["normal"], feet["place"], feet["distance"]


@kernel
def track(
    data: Array,
    layout: Record,
    first: Indices,
    samples: Record,
    clusters: Record,
    links: Indices,
    spacing: Record,
    p0: float,
    p1: float,
    p2: float,
    hysteresis: float,
    tracked: Record,
    work: Array,
    d: Tensor,
    foot: Record,
):
    """The foot of p = (p0, p1, p2) [m], on the branch of the last one (`TRACKED`)."""
    p0, p1, p2 = min(max(p0, -FAR), FAR), min(max(p1, -FAR), FAR), min(max(p2, -FAR), FAR)
    here, there = d[0], d[1]
    if not tracked.exists:
        first_guess = samples[_nearest(samples, p0, p1, p2)]
        tracked.place[0], tracked.place[1] = first_guess.place[0], first_guess.place[1]
        hysteresis = 0.0
    # 1. the minimum to which the last foot point leads
    u, v, f = newton(data, layout, first, p0, p1, p2, tracked.place[0], tracked.place[1], work, here)
    n0, n1, n2 = normal_of(data, layout, u, v, here)
    distance = np.sqrt(f)
    signed = (p0 - here[0, 0]) * n0 + (p1 - here[0, 1]) * n1 + (p2 - here[0, 2]) * n2
    best, best_u, best_v = distance, u, v
    cover = spacing.cover
    # 2. if p is near the centre of curvature there: minima on both sides of the foot point
    curvature, du, dv, collapsed = flattest(data, layout, p0, p1, p2, v, here)
    starts = 0
    if collapsed:
        starts = ROUND
    elif curvature < FLAT:
        starts = 2
    for k in range(starts):
        if collapsed:
            # a border collapsed to a point that is not a pole: start in all directions
            x, y = inside_border(data, layout, u, v, here, k / (ROUND - 1))
        else:
            # near the end of the medial axis a second minimum may lie between the samples
            x, y = u + (1.4 * k - 0.7) * cover * du, v + (1.4 * k - 0.7) * cover * dv
        x, y, f = newton(data, layout, first, p0, p1, p2, x, y, work, there)
        if f < best * best:
            best, best_u, best_v = np.sqrt(f), x, y
            n0, n1, n2 = normal_of(data, layout, x, y, there)
            signed = (p0 - there[0, 0]) * n0 + (p1 - there[0, 1]) * n1 + (p2 - there[0, 2]) * n2
    # 3. minima elsewhere: from each sample that may lead to a nearer one, unless it belongs to a known minimum
    count = _starts(samples, clusters, links, spacing, p0, p1, p2, distance, here, tracked.starts)
    for c in range(count):
        start = tracked.starts[c]
        sample, known = samples[start.sample], False
        for e in range(c):
            other = tracked.starts[e]
            known = known or _belongs(sample, start.square, vector(other.point), other.least, cover)
        if known:
            start.least = np.inf
            continue
        x, y, f = newton(data, layout, first, p0, p1, p2, sample.place[0], sample.place[1], work, there)
        start.point[0], start.point[1], start.point[2], start.least = there[0, 0], there[0, 1], there[0, 2], f
        if np.sqrt(f) < best:
            best, best_u, best_v = np.sqrt(f), x, y
            n0, n1, n2 = normal_of(data, layout, x, y, there)
            signed = (p0 - there[0, 0]) * n0 + (p1 - there[0, 1]) * n1 + (p2 - there[0, 2]) * n2
    # 4. change to another minimum only if it is nearer by the hysteresis
    if best < distance - hysteresis:
        u, v = best_u, best_v
        evaluate(data, layout, first, u, v, work, here)
    tracked.normal[0], tracked.normal[1], tracked.normal[2] = n0, n1, n2
    tracked.place[0], tracked.place[1], tracked.exists = u, v, True
    put(foot.point, vector(here[0]))
    put(foot.normal, normal_of(data, layout, u, v, here))
    foot.place[0], foot.place[1], foot.distance = u, v, signed


@kernel
def _find(
    data: Array,
    layout: Record,
    first: Indices,
    samples: Record,
    clusters: Record,
    links: Indices,
    spacing: Record,
    points: Matrix,
    tracked: Record,
    work: Array,
    d: Tensor,
    feet: Record,
):
    for k in range(len(points)):
        tracked.exists, p = False, points[k]
        track(
            data, layout, first, samples, clusters, links, spacing, p[0], p[1], p[2], 0.0, tracked, work, d, feet[k]
        )  # fmt: skip


@kernel
def _square(sample: Record, p0: float, p1: float, p2: float):
    a, b, c = sample.point[0] - p0, sample.point[1] - p1, sample.point[2] - p2
    return a * a + b * b + c * c


@kernel
def _nearest(samples: Record, p0: float, p1: float, p2: float):
    best, nearest = np.inf, 0
    for k in range(len(samples)):
        f = _square(samples[k], p0, p1, p2)
        if f < best:
            best, nearest = f, k
    return nearest


@kernel
def _belongs(sample: Record, f: float, x: Vector3, least: float, cover: float):
    """Whether a sample at the squared distance f belongs to the minimum x at the squared distance `least`."""
    return f >= least * (1.0 - 1e-9) and _square(sample, x[0], x[1], x[2]) < cover * cover


@kernel
def _starts(
    samples: Record,
    clusters: Record,
    links: Indices,
    spacing: Record,
    p0: float,
    p1: float,
    p2: float,
    distance: float,
    here: Matrix,
    starts: Record,
):
    """Samples that may lead to a nearer minimum, nearest first, into `starts`; returns their number."""
    cover = spacing.cover
    reach = distance + cover
    limit = reach * reach
    slack = SLACK * cover * cover + 2.0 * distance * spacing.sagitta
    count = 0
    for c in range(len(clusters)):
        # skip a cluster whose bounding sphere is out of reach
        cluster = clusters[c]
        x, y, z = cluster.centre[0] - p0, cluster.centre[1] - p1, cluster.centre[2] - p2
        far = reach + cluster.radius
        if x * x + y * y + z * z >= far * far:
            continue
        for k in range(cluster.begin, cluster.end):
            sample = samples[k]
            f = _square(sample, p0, p1, p2)
            if f >= limit or (count == STARTS and f >= starts[count - 1].square):
                continue
            # keep a sample that is nearer than its neighbours and belongs to no known minimum
            lowest = True
            for j in range(sample.begin, sample.end):
                if _square(samples[links[j]], p0, p1, p2) < f - slack:
                    lowest = False
                    break
            if not lowest or _belongs(sample, f, vector(here[0]), distance * distance, cover):
                continue
            # insert it into the sorted list
            count = min(count + 1, STARTS)
            place = count - 1
            while place > 0 and starts[place - 1].square > f:
                starts[place].square, starts[place].sample = starts[place - 1].square, starts[place - 1].sample
                place -= 1
            starts[place].square, starts[place].sample = f, k
    return count
