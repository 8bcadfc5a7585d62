"""How far the refined surface of a body that a boolean has made is from the intended one.

    python benchmarks/booleans.py [--bodies 30] [--first 0] [--json]

Random blocks of 60 x 64 x 24 mm, turned, from which boxes are cut, or to which they are joined; and ellipsoids of 90 x
70 x 40 mm, of 5000 triangles, with random boxes, tubes, holes and balls. These files have long strips, thin and obtuse
triangles, and rims at any angle. The distances [mm]: largest of a vertex of the refined surface, and of the file's
vertices and middles of triangles, from the intended body. That is the file itself for blocks; tubes and ellipsoids are
made again, with four times as many vertices along each edge. Needs the extra `mesh`.
"""

import argparse
import json
from collections.abc import Callable

import numpy as np
import trimesh
from manifold3d import Manifold
from manifold3d import Mesh as Given

from palpate.nodes.base.surface import MOST_REFINED
from palpate.nodes.collision import Mesh as Collision
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.mesh_closest import MeshClosestPoint
from palpate.physics.geometry.refined.divided import refine_mesh

HALF = (45.0, 35.0, 20.0)  # [mm] half axes
FINER = 4  # [1] edges of a round part of the intended body, for each of the file


def block(seed: int, _: int) -> Manifold:
    rng = np.random.default_rng(seed)
    body = Manifold.cube([60, 64, 24], True).refine_to_length(float(rng.choice([2.5, 4, 6, 9, 100])))
    for _ in range(rng.integers(1, 4)):
        size = np.exp(rng.uniform(np.log(0.3), np.log(50), 3)).tolist()
        turn = rng.uniform(0, 360, 3) if rng.random() < 0.5 else np.zeros(3)
        place = rng.uniform(-1, 1, 3) * [30, 32, 12]
        tool = Manifold.cube(size, True).rotate(turn.tolist()).translate(place.tolist())
        body = body - tool if rng.random() < 0.7 else body + tool
    return body.rotate(rng.uniform(0, 360, 3).tolist())


TOOLS: dict[str, Callable[[np.random.Generator, int], Manifold]] = {
    "box": lambda rng, _: Manifold.cube(np.exp(rng.uniform(0, 3.5, 3)).tolist(), True),
    "hole": lambda rng, fine: Manifold.cylinder(120, rng.uniform(1, 6), -1, 24 * fine, True),
    "tube": lambda rng, fine: Manifold.cylinder(60, rng.uniform(2, 6), -1, 24 * fine, True),
    "bite": lambda rng, fine: Manifold.sphere(rng.uniform(5, 25), 48 * fine),
    "bump": lambda rng, fine: Manifold.sphere(rng.uniform(3, 12), 48 * fine),
}
JOINED = ("tube", "bump")


def organ(seed: int, fine: int) -> Manifold:
    rng = np.random.default_rng(seed)
    round_ = trimesh.creation.icosphere(4 if fine == 1 else 6, 1.0)
    body = Manifold(Given(np.asarray(round_.vertices * HALF, np.float32), np.asarray(round_.faces, np.uint32)))
    for _ in range(rng.integers(1, 4)):
        name = rng.choice(list(TOOLS))
        way = rng.normal(size=3)
        place = way / np.linalg.norm(way) * HALF * rng.uniform(0.6, 1.05)
        tool = TOOLS[name](rng, fine).rotate(rng.uniform(0, 360, 3).tolist()).translate(place.tolist())
        body = body + tool if name in JOINED else body - tool
    return body


def mesh_of(body: Manifold) -> Mesh:
    """The body [m] as a file in single precision has it."""
    found = body.to_mesh64()
    points = np.asarray(found.vert_properties)[:, :3].astype(np.float32) * 1e-3
    return Mesh(np.ascontiguousarray(points, float), np.ascontiguousarray(found.tri_verts, np.int32))


def distances(make: Callable[[int, int], Manifold], seed: int) -> dict[str, float]:
    """Triangles of the file, and the two distances [mm]."""
    file = mesh_of(make(seed, 1))
    meant = MeshClosestPoint(mesh_of(make(seed, FINER)))
    fine = refine_mesh(file, Collision().refine, MOST_REFINED)
    given = np.concatenate([file.vertices, file.vertices[file.triangles].mean(axis=1)])
    refined, before = (1e3 * float(np.abs(meant.find_sorted(at)[3]).max()) for at in (fine.vertices, given))
    return {"triangles": len(file.triangles), "refined": refined, "file": before}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bodies", type=int, default=30, help="of each kind")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    seeds = range(given.first, given.first + given.bodies)
    found = {make.__name__: {seed: distances(make, seed) for seed in seeds} for make in (block, organ)}
    if given.json:
        print(json.dumps(found))
        return
    for name, rows in found.items():
        order = sorted(rows, key=lambda seed, rows=rows: -rows[seed]["refined"])
        off = np.array([row["refined"] for row in rows.values()])
        print(f"{name}s: {len(rows)}, error of the refined surface {np.median(off):.3f} mm in the median; the worst:")
        for seed in order[:5]:
            row = rows[seed]
            print(f"  seed {seed}: {row['refined']:.3f} mm (file {row['file']:.3f}), {row['triangles']:.0f} triangles")


if __name__ == "__main__":
    main()
