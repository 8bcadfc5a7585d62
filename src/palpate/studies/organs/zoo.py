"""A zoo of surfaces: bodies of all kinds that a finger may touch, as meshes of any resolution and as NURBS patches."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path

import numpy as np

from palpate.nodes.base.surface import surface_mesh
from palpate.physics.errors import ArgumentError
from palpate.physics.geometry.mesh import Mesh, write_ply
from palpate.studies.organs.gaps import cut_mesh, makers, read_cut
from palpate.studies.organs.shapes import arc, boxes, revolve_outline, star, together, torus

COARSE, USUAL, FINE = 600, 5000, 300_000  # vertices of a mesh
FAR = np.array([0.3125, -0.140625, 0.875])  # [m] of each mesh in its file, as a scanner's frame has it
MM = 1e-3


@dataclass(frozen=True)
class Specimen:
    """A surface of the zoo.

    make     its mesh [m] near the origin, with about this number of vertices
    smooth   whether it has no edge, so that all meshes of it approach one smooth surface
    patch    it ships as a NURBS patch of this name
    turned   whether triangles of its mesh are reversed; `true` has them outwards
    """

    name: str
    make: Callable[[int], Mesh]
    about: str
    smooth: bool = False
    patch: str = ""
    turned: bool = False

    def true(self, count: int) -> Mesh:
        """The mesh with all triangles outwards."""
        return _two(count, -1) if self.turned else self.make(count)


def _ball(radius: float, count: int) -> Mesh:
    return star(lambda unit: np.full(len(unit), radius), count)


def _move_mesh(mesh: Mesh, *by: float) -> Mesh:
    return Mesh(mesh.vertices + np.array(by), mesh.triangles)


def _ellipsoid(a: float, b: float, c: float, count: int) -> Mesh:
    unit = star(lambda u: np.ones(len(u)), count)
    return Mesh(unit.vertices * (a, b, c), unit.triangles)


def _bumpy(count: int) -> Mesh:
    def radius(u: np.ndarray) -> np.ndarray:
        wave = np.sin(9 * u[:, 0]) * np.sin(8 * u[:, 1] + 0.5) * np.sin(7 * u[:, 2] + 1.0)
        return 1.0 + 0.09 * wave

    body = star(radius, count)
    return Mesh(body.vertices * (45 * MM, 35 * MM, 28 * MM), body.triangles)


def _lobes(count: int) -> Mesh:
    """Two lobes with a waist: the radius is that of a Cassini oval about x."""
    far, wide = 28 * MM, 29.5 * MM

    def radius(u: np.ndarray) -> np.ndarray:
        double = 2 * u[:, 0] ** 2 - 1
        return np.sqrt(far**2 * (double + np.sqrt(np.maximum(double**2 - 1 + (wide / far) ** 4, 0.0))))

    return star(radius, count)


def _plate(thick: float, count: int) -> Mesh:
    half = 0.5 * thick
    return boxes((-40 * MM, 40 * MM), (-40 * MM, 40 * MM), (-half, half), np.ones((1, 1, 1), bool), count)


def _box(count: int) -> Mesh:
    return boxes((-25 * MM, 25 * MM), (-20 * MM, 20 * MM), (-15 * MM, 15 * MM), np.ones((1, 1, 1), bool), count)


def _corner(count: int) -> Mesh:
    full = np.array([[[True, True]], [[True, False]]])
    return boxes((-30 * MM, 0, 30 * MM), (-25 * MM, 25 * MM), (-25 * MM, 0, 25 * MM), full, count)


def _groove(width: float, count: int) -> Mesh:
    full = np.array([[[True, True]], [[True, False]], [[True, True]]])
    half = 0.5 * width
    return boxes((-30 * MM, -half, half, 30 * MM), (-30 * MM, 30 * MM), (-25 * MM, -5 * MM, 10 * MM), full, count)


def _wedge(count: int) -> Mesh:
    """Like a liver: 45 mm thick on one side, a rim of 5 mm on the other, with bent faces."""
    body = boxes((-40 * MM, 40 * MM), (-40 * MM, 40 * MM), (-12 * MM, 12 * MM), np.ones((1, 1, 1), bool), count)
    x, y, z = (body.vertices / (40 * MM, 40 * MM, 12 * MM)).T
    half = 2.5 * MM + 20 * MM * (0.5 - 0.5 * x) ** 1.5 * (1.0 - 0.35 * y * y)
    return Mesh(np.column_stack([55 * MM * x, 40 * MM * y * (1 - 0.2 * x), half * z + 6 * MM * x * x]), body.triangles)


def _bowl(hollow: float, count: int) -> Mesh:
    """A round block with a hemispherical hollow of this radius in its top."""
    wide, deep = hollow + 15 * MM, hollow + 12 * MM
    line = np.concatenate([arc((0, 0), hollow, -np.pi / 2, 0), [(wide, 0), (wide, -deep), (0, -deep)]])
    line[0, 0] = 0.0
    return revolve_outline(line, count)


def _dome(count: int) -> Mesh:
    """A hemisphere on a plate."""
    line = np.concatenate([arc((0, 0), 15 * MM, np.pi / 2, 0), [(40 * MM, 0), (40 * MM, -16 * MM), (0, -16 * MM)]])
    line[0, 0] = 0.0
    return revolve_outline(line, count)


def _vessel(count: int) -> Mesh:
    """A vessel, 6 mm across, 2 mm from an ellipsoid."""
    r, half = 3 * MM, 30 * MM
    line = np.concatenate([arc((0, half), r, np.pi / 2, 0), arc((0, -half), r, 0, -np.pi / 2)])
    line[0, 0] = line[-1, 0] = 0.0
    tube = revolve_outline(line, count // 5)
    lying = Mesh(tube.vertices[:, [2, 0, 1]], tube.triangles)
    return together(_ellipsoid(45 * MM, 30 * MM, 22 * MM, count - count // 5), _move_mesh(lying, 0, 35 * MM, 0))


def _two(count: int, sense: int = 1) -> Mesh:
    """Two balls, the higher one with reversed triangles; with `sense` -1 it also has them outwards."""
    low, high = _ball(20 * MM, count // 2), _move_mesh(_ball(20 * MM, count // 2), 45 * MM, 0, 15 * MM)
    return together(low, Mesh(high.vertices, high.triangles[:, ::-sense]))


def _island(count: int) -> Mesh:
    """A ball, and a speck of 1.6 mm 40 mm above it, as a segmentation leaves them."""
    return together(_ball(25 * MM, count), _move_mesh(_ball(0.8 * MM, 42), 0, 0, 66 * MM))


def _doubled_corners(count: int) -> Mesh:
    """An ellipsoid whose triangles have separate corners."""
    body = _ellipsoid(40 * MM, 30 * MM, 25 * MM, count)
    every = np.arange(3 * len(body.triangles), dtype=np.int32).reshape(-1, 3)
    return Mesh(body.vertices[body.triangles.ravel()], every)


def _slivers(count: int) -> Mesh:
    """An ellipsoid with a vertex 1 µm from an end of every 40th edge, and thin triangles around it."""
    body = _ellipsoid(40 * MM, 30 * MM, 25 * MM, count)
    points, triangles = list(body.vertices), body.triangles.tolist()
    across = {(a, b): n for n, t in enumerate(triangles) for a, b in zip(t, t[1:] + t[:1], strict=True)}
    touched: set[int] = set()
    for number, ((a, b), n) in enumerate(list(across.items())):
        other = across.get((b, a))
        if number % 40 or other is None or {n, other} & touched:
            continue
        touched |= {n, other}
        c = next(v for v in triangles[n] if v not in (a, b))
        d = next(v for v in triangles[other] if v not in (a, b))
        along = body.vertices[b] - body.vertices[a]
        points.append(body.vertices[a] + along * (1e-6 / np.linalg.norm(along)))
        m = len(points) - 1
        triangles[n], triangles[other] = [a, m, c], [b, m, d]
        triangles += [[m, b, c], [m, a, d]]
    return Mesh(np.array(points), np.array(triangles, np.int32))


def _shipped_mesh(name: str, count: int) -> Mesh:
    return surface_mesh(name, count)


def _all() -> dict[str, Specimen]:
    listed = [
        Specimen("sphere", partial(_ball, 20 * MM), "a ball, 40 mm across", True),
        Specimen("ball-5", partial(_ball, 5 * MM), "a ball smaller than the patch, 10 mm across", True),
        Specimen("ellipsoid", partial(_ellipsoid, 45 * MM, 30 * MM, 20 * MM), "half axes 45, 30, 20 mm", True),
        *(
            Specimen(f"torus-{t}", partial(torus, max(26, t + 12) * MM, t * MM), f"tube radius {t} mm", True)
            for t in (6, 8, 10, 14, 20)
        ),
        *(
            Specimen(f"plate-{t}", partial(_plate, t * MM), f"80 x 80 x {t} mm")
            for t in (2, 5, 20)
        ),
        Specimen("box", _box, "50 x 40 x 30 mm"),
        Specimen("l-shape", _corner, "a concave edge"),
        Specimen("bowl", partial(_bowl, 25 * MM), "a hollow of 25 mm radius"),
        Specimen("dimple", partial(_bowl, 6 * MM), "a hollow narrower than the finger, 12 mm across"),
        Specimen("groove", partial(_groove, 8 * MM), "a groove narrower than the finger, 8 mm wide, 15 mm deep"),
        Specimen("lobes", _lobes, "two lobes with a waist", True),
        Specimen("wedge", _wedge, "like a liver, with a rim of 5 mm"),
        Specimen("dome", _dome, "a hemisphere on a plate"),
        Specimen("bumpy", _bumpy, "an ellipsoid with bumps", True),
        Specimen("vessel", _vessel, "a vessel, 6 mm across, next to an ellipsoid", True),
        Specimen("two-balls", _two, "two balls, one with reversed triangles", True, turned=True),
        Specimen("island", _island, "a ball and a speck", True),
        Specimen("doubled", _doubled_corners, "an ellipsoid with separate corners", True),
        Specimen("slivers", _slivers, "an ellipsoid with thin triangles", True),
        Specimen("kidney-mesh", partial(_shipped_mesh, "kidney"), "the shipped kidney as a mesh", True),
        *(
            Specimen(name, partial(_shipped_mesh, patch), "shipped, a NURBS patch", True, patch)
            for name, patch in (("kidney", "kidney"), ("sphere-nurbs", "sphere"), ("plane", "plane"))
        ),
    ]  # fmt: skip
    return {one.name: one for one in listed}


ZOO = _all()
"""All surfaces by name."""


GAPPED = {name: Specimen(name, make, about) for name, (make, about) in makers().items()}
"""Bodies with gaps, which only a finger with a width is to touch, and the whole block."""


def specimen_of(name: str) -> Specimen:
    """The surface of a name: of the zoo, with gaps, or cut by a plane (`gaps`)."""
    if (cut := read_cut(name)) is None:
        return (ZOO | GAPPED)[name]
    body, gap, number = cut
    whole = specimen_of(body)
    return Specimen(
        name, lambda count: cut_mesh(whole.true(count), gap * MM, number), f"{whole.about}, cut, {gap:g} mm apart"
    )


def choose_specimens(names: list[str] | None) -> list[Specimen]:
    """These surfaces, or all. ArgumentError: an unknown name."""
    if unknown := [name for name in names or () if name not in ZOO]:
        raise ArgumentError(f"--surface: found {', '.join(unknown)}, expected some of {', '.join(ZOO)}")
    return [ZOO[name] for name in names or ZOO]


@lru_cache(maxsize=16)
def mesh_of(name: str, count: int) -> Mesh:
    """The mesh of a surface, near the origin, with about this number of vertices and all triangles outwards."""
    return specimen_of(name).true(count)


def write_mesh(name: str, count: int, folder: Path) -> Path:
    """The file of a mesh, in mm, `FAR` from the origin; it is written once."""
    file = folder / f"{name}-{count}.ply"
    if not file.is_file():
        folder.mkdir(parents=True, exist_ok=True)
        mesh = specimen_of(name).make(count)
        write_ply(file, Mesh((mesh.vertices + FAR) / MM, mesh.triangles))
    return file
