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

import numpy as np

from palpate.compiler.kernel import kernel
from palpate.physics.geometry.newton import flattest, inside_border, newton
from palpate.physics.geometry.nurbs import NurbsPatch, evaluate, normal_of
from palpate.physics.kept import keep_results

FAR = 1e9  # [m] Limit of coordinates, so that squares are finite
SAMPLES = 2500
SLACK = 0.1
"""[1] Tolerance of squared distances when samples are compared with their neighbours, over the squared cover; the
sagitta is added. Between two minima at nearly the same distance the distance of the samples may show no maximum."""
FLAT = 0.25  # [1] 1 - d kappa (distance times curvature) at a foot point below which its neighbourhood is also searched
ROUND = 9  # Number of directions in which the search leaves a collapsed border
STARTS = 8  # Maximum number of starts of Newton's method per step, in addition to the last foot point
FOUND = 9  # Length of a result: foot (3), normal (3), u, v, signed distance


@dataclass(frozen=True, eq=False)
class ClosestPoint:
    """Finds and tracks closest points of a surface: `find` for independent points, `track` for one moving point. The
    samples are computed at the first use."""

    surface: NurbsPatch

    @cached_property
    def tables(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Arguments of the kernels: floats and integers of the surface, floats and integers of the samples."""
        return (*self.surface.packed, *samples(self.surface, SAMPLES))

    def scratch(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """State (u, v, 1 while tracking), workspace, derivatives and result of `track`."""
        work = np.empty(24 + 3 * (self.surface.degree_u + self.surface.degree_v + 2) + 6 * STARTS)
        return np.zeros(3), work, np.empty((2, 6, 3)), np.zeros(FOUND)

    def find(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Foot points [m] (...,3), outward normals [1] (...,3), parameters [1] (...,2) and signed distances [m] (...),
        positive outside, of points [m] (...,3)."""
        points = np.asarray(points, dtype=float)
        flat = np.ascontiguousarray(points.reshape(-1, 3))
        feet = np.empty((len(flat), FOUND))
        _find(*self.tables, flat, *self.scratch(), feet)
        feet = feet.reshape(*points.shape[:-1], FOUND)
        return feet[..., :3], feet[..., 3:6], feet[..., 6:8], feet[..., 8]


@kernel
def track(data, layout, seeds, index, p0, p1, p2, hysteresis, state, work, d, foot):
    """The foot point of p = (p0, p1, p2) [m] into `foot`: point, normal, u, v, signed distance.

    state  (3)  u and v of the last foot point, and 1; 0 in the last place if there is no last foot point
    work   afterwards begins with the normal [1] (3) at the nearest point
    """
    p0, p1, p2 = min(max(p0, -FAR), FAR), min(max(p1, -FAR), FAR), min(max(p2, -FAR), FAR)
    here, there = d[0], d[1]
    if state[2] == 0.0:
        k = _nearest(seeds, index, p0, p1, p2)
        state[0], state[1] = seeds[5 * k + 3], seeds[5 * k + 4]
        hysteresis = 0.0
    # 1. the minimum to which the last foot point leads
    u, v, f = newton(data, layout, p0, p1, p2, state[0], state[1], work, here)
    n0, n1, n2 = normal_of(data, layout, u, v, here)
    distance = np.sqrt(f)
    signed = (p0 - here[0, 0]) * n0 + (p1 - here[0, 1]) * n1 + (p2 - here[0, 2]) * n2
    best, best_u, best_v = distance, u, v
    cover = seeds[len(seeds) - 1]
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
        x, y, f = newton(data, layout, p0, p1, p2, x, y, work, there)
        if f < best * best:
            best, best_u, best_v = np.sqrt(f), x, y
            n0, n1, n2 = normal_of(data, layout, x, y, there)
            signed = (p0 - there[0, 0]) * n0 + (p1 - there[0, 1]) * n1 + (p2 - there[0, 2]) * n2
    # 3. minima elsewhere: from each sample that may lead to a nearer one, unless it belongs to a known minimum
    at = len(work) - 6 * STARTS
    count = _starts(seeds, index, p0, p1, p2, distance, here, work, at)
    for c in range(count):
        k = int(work[at + 2 * c + 1])
        known = False
        for e in range(c):
            b = at + 2 * STARTS + 4 * e
            known = known or _belongs(seeds, k, work[at + 2 * c], work[b], work[b + 1], work[b + 2], work[b + 3])
        b = at + 2 * STARTS + 4 * c
        if known:
            work[b + 3] = np.inf
            continue
        x, y, f = newton(data, layout, p0, p1, p2, seeds[5 * k + 3], seeds[5 * k + 4], work, there)
        work[b], work[b + 1], work[b + 2], work[b + 3] = there[0, 0], there[0, 1], there[0, 2], f
        other = np.sqrt(f)
        if other < best:
            best, best_u, best_v = other, x, y
            n0, n1, n2 = normal_of(data, layout, x, y, there)
            signed = (p0 - there[0, 0]) * n0 + (p1 - there[0, 1]) * n1 + (p2 - there[0, 2]) * n2
    # 4. change to another minimum only if it is nearer by the hysteresis
    if best < distance - hysteresis:
        u, v = best_u, best_v
        evaluate(data, layout, u, v, work, here)
    work[0], work[1], work[2] = n0, n1, n2
    n0, n1, n2 = normal_of(data, layout, u, v, here)
    state[0], state[1], state[2] = u, v, 1.0
    foot[0], foot[1], foot[2] = here[0, 0], here[0, 1], here[0, 2]
    foot[3], foot[4], foot[5] = n0, n1, n2
    foot[6], foot[7], foot[8] = u, v, signed


@kernel
def _find(data, layout, seeds, index, points, state, work, d, foot, results):
    for k in range(len(points)):
        state[2] = 0.0
        track(data, layout, seeds, index, points[k, 0], points[k, 1], points[k, 2], 0.0, state, work, d, foot)
        results[k] = foot


@kernel
def _square(seeds, k, p0, p1, p2):
    a, b, c = seeds[5 * k] - p0, seeds[5 * k + 1] - p1, seeds[5 * k + 2] - p2
    return a * a + b * b + c * c


@kernel
def _nearest(seeds, index, p0, p1, p2):
    best, nearest = np.inf, 0
    for k in range(index[0]):
        f = _square(seeds, k, p0, p1, p2)
        if f < best:
            best, nearest = f, k
    return nearest


@kernel
def _belongs(seeds, k, f, x0, x1, x2, least):
    """Whether sample k, at the squared distance f, belongs to the minimum x at the squared distance `least`."""
    cover = seeds[len(seeds) - 1]
    return f >= least * (1.0 - 1e-9) and _square(seeds, k, x0, x1, x2) < cover * cover


@kernel
def _starts(seeds, index, p0, p1, p2, distance, here, work, at):
    """Samples that may lead to a nearer minimum, nearest first, as pairs (squared distance, sample) into work[at:];
    returns their number."""
    samples, clusters = index[0], index[1]
    cover = seeds[len(seeds) - 1]
    reach = distance + cover
    limit = reach * reach
    slack = SLACK * cover * cover + 2.0 * distance * seeds[len(seeds) - 2]
    links = 3 + clusters
    count = 0
    for c in range(clusters):
        b = 5 * samples + 4 * c
        # skip a cluster whose bounding sphere is out of reach
        x, y, z = seeds[b] - p0, seeds[b + 1] - p1, seeds[b + 2] - p2
        far = reach + seeds[b + 3]
        if x * x + y * y + z * z >= far * far:
            continue
        for k in range(index[2 + c], index[3 + c]):
            f = _square(seeds, k, p0, p1, p2)
            if f >= limit or (count == STARTS and f >= work[at + 2 * count - 2]):
                continue
            # keep a sample that is nearer than its neighbours and belongs to no known minimum
            lowest = True
            for j in range(index[links + k], index[links + k + 1]):
                if _square(seeds, index[links + samples + 1 + j], p0, p1, p2) < f - slack:
                    lowest = False
                    break
            if not lowest or _belongs(seeds, k, f, here[0, 0], here[0, 1], here[0, 2], distance * distance):
                continue
            # insert it into the sorted list
            count = min(count + 1, STARTS)
            place = count - 1
            while place > 0 and work[at + 2 * place - 2] > f:
                work[at + 2 * place] = work[at + 2 * place - 2]
                work[at + 2 * place + 1] = work[at + 2 * place - 1]
                place -= 1
            work[at + 2 * place], work[at + 2 * place + 1] = f, k
    return count


@keep_results
def samples(surface: NurbsPatch, count: int) -> tuple[np.ndarray, np.ndarray]:
    """About `count` samples of the surface with their neighbours, in clusters, as arrays for the kernels:

    floats    (5 s) x, y, z, u, v of each sample; (4 c) centre and radius of each cluster; sagitta; cover
    integers  s, c; (c+1) first sample of each cluster; (s+1) first link of each sample; the links
    """
    u, v = _grid(surface, count)
    n, m = len(u), len(v)
    points = surface(u[:, None], v)
    number = np.arange(n * m).reshape(n, m)
    low, high = surface.packed[1][8:10]
    if low:
        number[:, 0] = number[0, 0]
    if high:
        number[:, -1] = number[0, -1]
    pairs = _links(number, surface.closed_u, surface.closed_v)
    flat = points.reshape(-1, 3)
    cover = 0.75 * np.linalg.norm(flat[pairs[:, 0]] - flat[pairs[:, 1]], axis=1).max()
    sagitta = _sagitta(surface, u, v)
    groups = _clusters(flat, np.unique(number))
    order = np.concatenate(groups)
    rank = np.full(n * m, -1)
    rank[order] = np.arange(len(order))
    pairs = np.unique(rank[pairs], axis=0)
    first = np.searchsorted(pairs[:, 0], np.arange(len(order) + 1))
    table = np.column_stack([flat, np.repeat(u, m), np.tile(v, n)])[order]
    spheres = []
    for group in groups:
        centre = (flat[group].min(axis=0) + flat[group].max(axis=0)) / 2
        spheres.append([*centre, np.linalg.norm(flat[group] - centre, axis=1).max()])
    starts = np.cumsum([0] + [len(g) for g in groups])
    index = np.concatenate([[len(order), len(groups)], starts, first, pairs[:, 1]]).astype(np.int64)
    return np.concatenate([table.ravel(), np.ravel(spheres), [sagitta, cover]]), index


def _grid(surface: NurbsPatch, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Parameters of a grid with nearly square cells, without the end of a closed direction."""
    u0, u1, v0, v1 = surface.domain
    rough = surface(np.linspace(u0, u1, 40)[:, None], np.linspace(v0, v1, 40))
    around = np.linalg.norm(np.diff(rough, axis=0), axis=-1).sum(axis=0).max()
    along = np.linalg.norm(np.diff(rough, axis=1), axis=-1).sum(axis=1).max()
    n = int(np.clip(round(np.sqrt(count * around / max(along, 1e-300))), 8, count // 8))
    m = max(8, round(count / n))
    u = np.linspace(u0, u1, n, endpoint=not surface.closed_u)
    return u, np.linspace(v0, v1, m, endpoint=not surface.closed_v)


def _sagitta(surface: NurbsPatch, u: np.ndarray, v: np.ndarray) -> float:
    """Largest distance [m] of the surface from the chords between samples."""
    corners = surface(u[:, None], v)
    chord = (corners[1:, 1:] + corners[:-1, :-1] + corners[1:, :-1] + corners[:-1, 1:]) / 4
    middle = surface((u[1:, None] + u[:-1, None]) / 2, (v[1:] + v[:-1]) / 2)
    return float(np.linalg.norm(middle - chord, axis=-1).max())


def _links(number: np.ndarray, closed_u: bool, closed_v: bool) -> np.ndarray:
    links = []
    for du, dv in ((1, 0), (0, 1), (1, 1), (1, -1)):
        other = np.roll(number, (-du, -dv), axis=(0, 1))
        rows = slice(None) if closed_u or not du else slice(None, -1)
        columns = slice(None) if closed_v or not dv else slice(None, -1) if dv > 0 else slice(1, None)
        links.append(np.stack([number[rows, columns].ravel(), other[rows, columns].ravel()], axis=1))
    pairs = np.concatenate(links)
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    return np.unique(np.concatenate([pairs, pairs[:, ::-1]]), axis=0)


def _clusters(points: np.ndarray, chosen: np.ndarray, size: int = 16) -> list[np.ndarray]:
    """The chosen points in groups of at most `size`, by bisection along the longest side."""
    if len(chosen) <= size:
        return [chosen]
    axis = np.ptp(points[chosen], axis=0).argmax()
    order = chosen[np.argsort(points[chosen, axis], kind="stable")]
    half = len(order) // 2
    return _clusters(points, order[:half], size) + _clusters(points, order[half:], size)
