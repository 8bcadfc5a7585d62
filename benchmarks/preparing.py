"""Processor time to load an organ: reading, refinement, the surface that a finger can touch, and the search tree.

    python benchmarks/preparing.py [--triangles 1000 5000 20000 100000] [--shapes even rows poles cubes cad] [--gap]
                                   [--widths 16 12 6 3]

Shapes: an ellipsoid of 90 x 70 x 50 mm of even triangles, of rows of latitude with as many meridians as triangles need,
of thin triangles at its poles, and of marching cubes; and a cylinder as a CAD program exports it, of long triangles and
two fans. `--gap` cuts each body by a plane, 0.5 mm apart, so that the gap is bridged. `fissure`, which is not among
the default ones, is the even ellipsoid with a wedge like that between the lobes of a liver, 3 mm wide and 15 mm deep.
`--widths` are those of the finger [mm]: the bridges of a narrow one have smaller triangles.

Each case runs in a forked process that has loaded all kernels. The columns:

    width      [mm] of the finger
    triangles, vertices  of the file, and of the refined surface
    read, refine, touch, tree  [s] processor time of the parts
    start      [s] processor time of `collision.Mesh.start`, which does all of them and writes the store
    of goal    this time over 0.5 s + 10 us per vertex of the refined surface; at most 1 is the goal
    a triangle [us] this time over the triangles of the file
    stored     [s] the same in a later process, which reads the store
    memory     [MB] largest resident memory above that of the process before it began
    store      [MB] in the store
    moved      [mm] largest distance of a vertex of the refined surface from the triangles of the file
"""

from __future__ import annotations

import argparse
import ctypes
import itertools
import multiprocessing
import os
import shutil
import tempfile
import time
from pathlib import Path

import numpy as np
from skimage.measure import marching_cubes
from trimesh.creation import cylinder, icosphere

from palpate.nodes.base import felt, mesh_file, surface
from palpate.nodes.base.felt import WIDTH
from palpate.nodes.base.stored import surfaces
from palpate.nodes.collision import Mesh as Collision
from palpate.physics.geometry.felt.bridge import close_surface
from palpate.physics.geometry.mesh import Mesh, write_ply
from palpate.physics.geometry.mesh_closest import MeshClosestPoint
from palpate.physics.geometry.refined.divided import refine_mesh
from palpate.studies.organs.gaps import cut_mesh, makers

HALF = np.array([45e-3, 35e-3, 25e-3])  # [m] half axes
GAP = 0.5e-3  # [m]
COLUMNS = ("read", "refine", "touch", "tree", "start", "of goal", "a triangle", "stored", "memory", "store", "moved")


def even(count: int) -> Mesh:
    ball = icosphere(max(1, round(np.log(count / 20) / np.log(4))), 1.0)
    return Mesh(np.array(ball.vertices) * HALF, np.array(ball.faces, np.int32))


def _globe(rows: int, columns: int) -> Mesh:
    """An ellipsoid of rows of latitude, with a vertex at each pole."""
    down, round_ = np.linspace(0, np.pi, rows + 1)[1:-1], np.linspace(0, 2 * np.pi, columns, endpoint=False)
    ring = np.stack([np.cos(round_), np.sin(round_), np.zeros(columns)], axis=1)
    points = np.sin(down)[:, None, None] * ring + np.cos(down)[:, None, None] * np.array([0.0, 0.0, 1.0])
    at = np.arange((rows - 1) * columns).reshape(rows - 1, columns)
    here, there, low = at[:-1], np.roll(at[:-1], -1, axis=1), at[1:]
    beyond, first, last = np.roll(low, -1, axis=1), at[0], at[-1]
    top, bottom = np.full(columns, at.size), np.full(columns, at.size + 1)
    triangles = [
        np.stack(each, axis=-1).reshape(-1, 3)
        for each in ((here, low, there), (there, low, beyond), (first, np.roll(first, -1), top),
                     (np.roll(last, -1), last, bottom))
    ]  # fmt: skip
    ends = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    vertices = np.concatenate([points.reshape(-1, 3), ends])
    return Mesh(vertices * HALF, np.concatenate(triangles).astype(np.int32))


def rows(count: int) -> Mesh:
    return _globe(int(np.sqrt(count)) // 2, int(np.sqrt(count)))


def poles(count: int) -> Mesh:
    columns = int(np.sqrt(4 * count))
    return _globe(max(count // (2 * columns), 3), columns)


def cubes(count: int) -> Mesh:
    voxel = float(np.sqrt(8 * np.pi * 0.035**2 / count))
    size = np.ceil(HALF / voxel).astype(int) + 3
    grid = np.meshgrid(*(voxel * np.arange(-n, n + 1) for n in size), indexing="ij")
    distance = 0.025 * (np.sqrt(sum((x / a) ** 2 for x, a in zip(grid, HALF, strict=True))) - 1.0)
    points, triangles, *_ = marching_cubes(distance, 0.0, gradient_direction="ascent", allow_degenerate=False)
    return Mesh(voxel * (points.astype(float) - size), triangles.astype(np.int32))


def cad(count: int) -> Mesh:
    made = cylinder(0.03, 0.05, sections=count // 4)
    return Mesh(np.array(made.vertices), np.array(made.faces, np.int32))


def fissure(count: int) -> Mesh:
    return makers()["fissure"][0](count // 2)


USUAL = (even, rows, poles, cubes, cad)
SHAPES = {made.__name__: made for made in (*USUAL, fissure)}


def _since(begun: float) -> float:
    return time.process_time() - begun


def _memory(which: str) -> float:
    """A size of this process [MB]."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(which)) / 1e3


def _forget() -> None:
    """Forget what this process has read and prepared, as a new one would know nothing."""
    surface.surface_mesh.cache_clear()
    felt._felt_surface.cache_clear()
    mesh_file._read_once.cache_clear()
    mesh_file._right.cache_clear()
    mesh_file._flaws.cache_clear()


def measure(file: Path, width: float) -> dict[str, float]:
    """The columns of a file and a width [m] of the finger, in this process."""
    node = Collision(surface=str(file), width=width)
    _forget()
    ctypes.CDLL(None).malloc_trim(0)  # give back what the parent had freed, which would be used again
    Path("/proc/self/clear_refs").write_text("5")  # the largest resident memory is that from now on
    resident, begun = _memory("VmRSS"), time.process_time()
    node.start()
    found = {"start": _since(begun), "memory": _memory("VmHWM") - resident}
    found["store"] = sum(each.stat().st_size for each in surfaces.folder().iterdir()) / 1e6
    moved, before = surface.refinement(str(file), "m", 0, node.refine)
    _forget()
    begun = time.process_time()
    Collision(surface=str(file), width=width).start()
    found["stored"] = _since(begun)
    _forget()
    # the parts
    begun = time.process_time()
    given = mesh_file.read_mesh(str(file), 1.0)
    mesh_file.flaws(str(file))
    found["read"], begun = _since(begun), time.process_time()
    fine = refine_mesh(given, node.refine, surface.MOST_REFINED)
    found["refine"], begun = _since(begun), time.process_time()
    close_surface(fine, 0.5 * node.width, given=given)
    found["touch"], begun = _since(begun), time.process_time()
    tables = MeshClosestPoint(fine).tables
    found["tree"] = _since(begun)
    assert len(tables.cells) and before == len(given.vertices)
    count = len(fine.vertices)
    goal = 0.5 + 10e-6 * count
    return found | {
        "triangles": len(given.triangles), "vertices": count, "of goal": found["start"] / goal, "moved": 1e3 * moved,
        "a triangle": 1e6 * found["start"] / len(given.triangles),
    }  # fmt: skip


def _case(name: str, count: int, gap: bool, width: float, out: multiprocessing.Queue[dict[str, float]]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_CACHE_HOME"] = f"{folder}/cache"
        mesh = SHAPES[name](count)
        file = Path(folder) / f"{name}.ply"
        write_ply(file, cut_mesh(mesh, GAP, 1) if gap else mesh)
        out.put(measure(file, width))


def main() -> None:
    given = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    given.add_argument("--triangles", type=int, nargs="+", default=[1000, 5000, 20_000, 100_000])
    given.add_argument("--shapes", nargs="+", choices=SHAPES, default=[made.__name__ for made in USUAL])
    given.add_argument("--gap", action="store_true")
    given.add_argument("--widths", type=float, nargs="+", default=[1e3 * WIDTH], metavar="MM")
    chosen = given.parse_args()
    # the kernels that all cases use, except those that only other kernels call
    fork = multiprocessing.get_context("fork")
    with tempfile.TemporaryDirectory() as folder:
        os.environ.setdefault("NUMBA_CACHE_DIR", str(surfaces.user_cache()))
        os.environ["XDG_CACHE_HOME"] = folder
        for name, mesh in (("whole", cubes(600)), ("cut", cut_mesh(even(600), GAP, 1))):
            file = Path(folder) / f"{name}.ply"
            write_ply(file, Mesh(0.5 * mesh.vertices, mesh.triangles))
            measure(file, WIDTH)
        shutil.rmtree(surfaces.folder())
    _forget()
    widths = [max(8, len(column)) for column in COLUMNS]
    print("shape   width triangles vertices " + " ".join(f"{c:>{w}}" for c, w in zip(COLUMNS, widths, strict=True)))
    for name, count, width in itertools.product(chosen.shapes, chosen.triangles, chosen.widths):
        out: multiprocessing.Queue[dict[str, float]] = fork.Queue()
        child = fork.Process(target=_case, args=(name, count, chosen.gap, 1e-3 * width, out))
        child.start()
        row = out.get()
        child.join()
        values = " ".join(f"{row[c]:{w}.2f}" for c, w in zip(COLUMNS, widths, strict=True))
        print(f"{name:7} {width:5g} {row['triangles']:9.0f} {row['vertices']:8.0f} {values}", flush=True)


if __name__ == "__main__":
    main()
