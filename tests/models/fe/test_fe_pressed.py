"""Random bodies, curved and layered, pressed in three load steps: how many iterations each step takes."""

from dataclasses import replace

import numpy as np
import pytest

from palpate.models.fe import RigidIndenter, Settings, Solver, TetMesh, box, capsule, hencky, neo_hooke, plane, sphere

MOST = 12


def layered(rng):
    """A block of one to three layers with a curved top: layers of 2 to 100 kPa, Poisson's ratios of 0.3 to 0.499, plain
    and mixed elements."""
    cells = (*rng.integers(3, 7, 2).tolist(), int(rng.integers(3, 6)))
    size = np.array([*rng.uniform(0.012, 0.03, 2), rng.uniform(0.006, 0.015)])
    block = box(tuple(size), cells)
    part = block.points / size
    middle, high = part[:, :2] - 0.5, part[:, 2]
    points = block.points.copy()
    sag = rng.uniform(0.0, 0.3, 2) * size[2]
    points[:, 2] *= 1.0 - rng.uniform(-0.3, 0.3) * middle[:, 0]
    points[:, 2] -= (4.0 * sag * middle**2).sum(axis=1) * high
    points[:, 0] += rng.uniform(-0.1, 0.1) * size[0] * np.sin(np.pi * high)
    layers = int(rng.integers(1, 4))
    bounds = np.sort(rng.integers(1, cells[2], layers - 1)) / cells[2]
    region = np.searchsorted(bounds, high[block.elements[:, :4]].mean(axis=1))
    materials = {}
    for k in range(layers):
        poisson = float(rng.choice([rng.uniform(0.3, 0.499), rng.uniform(0.47, 0.499), 0.495]))
        law = (neo_hooke, hencky)[int(rng.integers(2))](float(10 ** rng.uniform(3.3, 5)), poisson)
        materials[k] = replace(law, mixed=bool(rng.integers(2)))
    mesh = TetMesh(points, block.elements, region)
    top = mesh.faces[(high[mesh.faces] > 1.0 - 1e-9).all(axis=1)]
    return mesh, materials, top, np.repeat(high[:, None] < 1e-9, 3, axis=1), size, float((size / cells)[:2].max())


def indenter(rng, points, size, edge):
    """A tilted plate, a ball or a lying capsule, no sharper than the elements, that just touches these points from
    above: shape, numbers, place, how it is turned, and the direction in which it goes."""
    down, kind = np.array([0.0, 0.0, -1.0]), int(rng.integers(3))
    if kind == 0:
        normal = np.array([*rng.uniform(-0.15, 0.15, 2), -1.0])
        normal /= np.linalg.norm(normal)
        return plane, tuple(normal), normal * (points @ normal).min(), np.eye(3), normal
    radius, at = max(edge, rng.uniform(0.2, 0.6) * size[:2].min()), rng.uniform(0.3, 0.7, 2) * size[:2]
    aside, turn, half = points[:, :2] - at, np.eye(3), 0.0
    if kind == 2:
        half, angle = rng.uniform(0.2, 0.5) * size[:2].min(), rng.uniform(0.0, np.pi)
        axis = np.array([np.cos(angle), np.sin(angle), 0.0])
        aside = aside - np.outer(np.clip(aside @ axis[:2], -half, half), axis[:2])
        turn = np.stack([np.cross(-down, axis), -down, axis], axis=1)
    far = np.linalg.norm(aside, axis=1)
    near = far < radius
    height = (points[near, 2] + np.sqrt(radius**2 - far[near] ** 2)).max()
    shape, numbers = (sphere, (radius,)) if kind == 1 else (capsule, (radius, half))
    return shape, numbers, np.array([*at, height]), turn, down


def iterations(seed):
    """Of each load step of a random pressed body, those of steps that failed included."""
    rng = np.random.default_rng(seed)
    mesh, materials, top, fixed, size, edge = layered(rng)
    shape, numbers, start, turn, way = indenter(rng, mesh.points[np.unique(top)], size, edge)
    depth = rng.uniform(0.05, 0.2) * size[2]
    touch = RigidIndenter(top, shape, numbers, lambda load: (start + load * depth * way, turn))
    body = Solver(mesh, materials, fixed, contacts=[touch], settings=Settings(step=1 / 3, largest=1 / 3))
    counts = [0]
    body.advance(1.0, lambda load: counts.append(body.iterations))
    assert touch.force @ way > 0.0 and not touch.deep()
    return np.diff(counts).tolist()


@pytest.mark.parametrize("seed", (2, 18, 36, 40, 48))
def test_a_pressed_body_takes_few_iterations_in_each_load_step(seed):
    counts = iterations(seed)
    assert len(counts) == 3 and max(counts) <= MOST


@pytest.mark.long
def test_of_fifty_pressed_bodies_no_step_is_cut_and_one_takes_more_than_twelve_iterations():
    """Seed 39 takes 4, 5 and 13: a capsule goes 17 % deep into a stiff layer (91 kPa) on a soft one (4.9 kPa) whose
    plain elements have a Poisson's ratio of 0.489."""
    counts = {seed: iterations(seed) for seed in range(50)}
    assert all(len(count) == 3 for count in counts.values())
    assert {seed for seed, count in counts.items() if max(count) > MOST} <= {39}
    assert max(counts[39]) <= MOST + 3
