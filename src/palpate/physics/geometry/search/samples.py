"""Samples of a NURBS surface, from which the search for its closest point starts.

Every point of the surface is within `cover` of a sample. Each sample is linked to its neighbours; clusters of samples
have bounding spheres.
"""

from typing import NamedTuple

import numpy as np

from palpate.compiler.fields import blank_record, element_type
from palpate.physics.arrays import Record
from palpate.physics.geometry.nurbs import NurbsPatch
from palpate.physics.kept import keep_results

SAMPLE = {"point": (3,), "place": (2,), "begin": int, "end": int}
"""A sample of the surface: its place [m], u and v; which of the links lead to its neighbours."""
CLUSTER = {"centre": (3,), "radius": (), "begin": int, "end": int}
"""The bounding sphere [m] of consecutive samples, from `begin` to `end`."""
SPACING = {"sagitta": (), "cover": ()}
"""Largest distance [m] of the surface from the chords between samples, and of its points from a sample."""


class SurfaceSamples(NamedTuple):
    """Samples of a surface with their neighbours, in clusters."""

    samples: np.ndarray  # (s) `SAMPLE`
    clusters: np.ndarray  # (c) `CLUSTER`
    links: np.ndarray  # (l) neighbours of each sample
    spacing: Record  # `SPACING`


@keep_results
def samples_of(surface: NurbsPatch, count: int) -> SurfaceSamples:
    """About `count` samples of the surface."""
    u, v = _grid(surface, count)
    n, m = len(u), len(v)
    points = surface(u[:, None], v)
    number = np.arange(n * m).reshape(n, m)
    layout = surface.packed[1]
    if layout.pole_low:
        number[:, 0] = number[0, 0]
    if layout.pole_high:
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
    samples = np.zeros(len(order), element_type(SAMPLE))
    samples["point"], samples["place"] = flat[order], np.column_stack([np.repeat(u, m), np.tile(v, n)])[order]
    samples["begin"], samples["end"] = first[:-1], first[1:]
    clusters = np.zeros(len(groups), element_type(CLUSTER))
    for cluster, group in zip(clusters, groups, strict=True):
        cluster["centre"] = (flat[group].min(axis=0) + flat[group].max(axis=0)) / 2
        cluster["radius"] = np.linalg.norm(flat[group] - cluster["centre"], axis=1).max()
    clusters["end"] = np.cumsum([len(group) for group in groups])
    clusters["begin"][1:] = clusters["end"][:-1]
    links = np.ascontiguousarray(pairs[:, 1], dtype=np.int64)
    return SurfaceSamples(samples, clusters, links, blank_record(SPACING, sagitta=sagitta, cover=cover))


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
