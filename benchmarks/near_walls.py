"""Stiffness near a cut through a block, from presses of a whole graph with ReducedFE: python benchmarks/near_walls.py

A block of 60 x 64 x 24 mm on stiff ground is cut in two, the pieces are moved apart, and a finger presses 9.5 mm near
the cut, with `tissue.walls` of 1 mm and 0, and with walls that touch (`folds`). The ratio is that of the stiffness
(contact force over indentation) to the uncut block at the same place, next to that of linear elements (32 000 unknowns,
trilinear bricks with mean dilatation, 60 x 60 x 24 mm, patch of 8 mm) whose walls are free, or tied along their normal.
"""

import tempfile
from pathlib import Path

import numpy as np

import palpate
from palpate.models.build import basis
from palpate.nodes.deformation import ReducedFE, basis_store
from palpate.physics.geometry.mesh import Mesh, write_ply

SIZE, TOP = (0.060, 0.064, 0.024), 0.105  # [m]
PLACES = (0.0, 1e-3, 3e-3, 8e-3, 15e-3)  # [m] from the middle of the cut
CASES = (
    (0.0, 1e-3, 0.0), (2e-4, 1e-3, 0.0), (5e-4, 1e-3, 0.0), (9e-4, 1e-3, 0.0), (2e-3, 0.0, 0.0), (1e-3, 0.0, 4e-3),
    (2e-3, 0.0, 4e-3), (3e-3, 0.0, 4e-3),
)  # fmt: skip
"""[m] Gap, `walls`, and `reach` of the contact of the walls with each other, 0: none (scene key `folds`)."""
TIED, FREE = (1.000, 0.971, 0.836, 0.876, 0.987), (0.712, 0.705, 0.673, 0.817, 0.971)  # those elements


def block(low: float, high: float, edge: float = 4e-3) -> Mesh:
    """The part of the block between two values of y, with edges of about `edge` [m]."""
    ends = np.array([[-SIZE[0] / 2, low, TOP - SIZE[2]], [SIZE[0] / 2, high, TOP]])
    points, triangles = [], []
    for axis in range(3):
        a, b = (axis + 1) % 3, (axis + 2) % 3
        lines = [np.linspace(*ends[:, k], 1 + max(1, round(float(np.ptp(ends[:, k])) / edge))) for k in (a, b)]
        for side in (0, 1):
            grid = np.zeros((len(lines[0]), len(lines[1]), 3))
            grid[..., axis], grid[..., a], grid[..., b] = ends[side, axis], lines[0][:, None], lines[1][None]
            n = np.arange(grid[..., 0].size).reshape(grid.shape[:2]) + sum(map(len, points))
            p, q, r, s = (part.ravel() for part in (n[:-1, :-1], n[1:, :-1], n[1:, 1:], n[:-1, 1:]))
            quads = np.concatenate([np.column_stack([p, q, r]), np.column_stack([p, r, s])])
            points.append(grid.reshape(-1, 3))
            triangles.append(quads if side else quads[:, ::-1])
    found, place = np.unique(np.round(np.concatenate(points), 9), axis=0, return_inverse=True)
    return Mesh(found, place.ravel()[np.concatenate(triangles)].astype(np.int32))


def cut(gap: float) -> Mesh:
    if gap == 0.0:
        return block(-SIZE[1] / 2, SIZE[1] / 2)
    one, other = block(-SIZE[1] / 2, -gap / 2), block(gap / 2, SIZE[1] / 2)
    triangles = np.concatenate([one.triangles, other.triangles + len(one.vertices)])
    return Mesh(np.concatenate([one.vertices, other.vertices]), triangles)


def stiffness(file: Path, walls: float, reach: float) -> np.ndarray:
    """Force over indentation [N/m] (n) at the end of a press at each of `PLACES`."""
    body = ReducedFE(surface=str(file), bed=1e4, walls=walls, position=(0.0, 0.0, 0.0))
    if body.find_stored(basis_store.cache()) is None:
        basis.make(body, basis.home(body, basis_store.cache()))
    begin = [[0.0, y, TOP + 8e-3] for y in PLACES]
    press = [
        [{"to": [0.0, y, TOP + 4.5e-3], "time": 0.12}, {"to": [0.0, y, TOP - 9.5e-3], "time": 0.4}, {"hold": 0.15}]
        for y in PLACES
    ]
    found = palpate.Ensemble(
        "kidney", lanes=len(PLACES), over={"scene.hand.begin": begin, "scene.hand.path": press},
        keep=["contact.force", "tissue.previous_indentation"], duration=0.67,
        sets=[
            "collision.use=collision.Mesh", "tissue.use=deformation.ReducedFE", "tissue.bed=1e4",
            f"tissue.walls={walls}", f"scene.surface.surface={file}", "scene.surface.position=[0, 0, 0]",
            *([f"scene.folds={{tissue: {{reach: {reach}}}}}"] if reach else []),
        ],
    ).run(quiet=True)  # fmt: skip
    return np.asarray(found["contact.force"])[:, -1] / np.asarray(found["tissue.previous_indentation"])[:, -1]


def main() -> None:
    print("mm from the cut    " + "".join(f"{1e3 * y:7.0f}" for y in PLACES))
    whole = np.ones(len(PLACES))
    with tempfile.TemporaryDirectory() as folder:
        for gap, walls, reach in CASES:
            write_ply(Path(folder) / f"cut{1e3 * gap:g}.ply", cut(gap))
            found = stiffness(Path(folder) / f"cut{1e3 * gap:g}.ply", walls, reach)
            whole = found if gap == 0.0 else whole
            how = f"folds {1e3 * reach:g}" if reach else f"walls {1e3 * walls:g}"
            name = "uncut" if gap == 0.0 else f"gap {1e3 * gap:g}, {how} mm"
            print(f"{name:19}" + "".join(f"{ratio:7.3f}" for ratio in found / whole), flush=True)
    for name, ratios in (("elements, tied", TIED), ("elements, free", FREE)):
        print(f"{name:19}" + "".join(f"{ratio:7.3f}" for ratio in ratios))


if __name__ == "__main__":
    main()
