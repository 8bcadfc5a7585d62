"""The undeformed surface of a scene, at its position in the world, for every node that needs it.

Every built-in surface has a frame with +z up, out of the surface, and its origin at the centre.

    kidney  long axis along x, hilum towards -y, 42 mm thick along z; touched from above it is convex
    sphere  42 mm across
    plane   a square of 0.1 m, z = 0
    fingertip  pulp up, tip towards +y: a capsule of radius 9.84 mm with a straight part of 12 mm behind the origin

With the default position, `PLACE`, the top of the kidney and of the sphere is at z = 105 mm, below the centre of a
Falcon's workspace, (0, 0, 110 mm). A finger at the centre is free; with 4 mm of tissue in front of its bone it touches
1 mm further down.
"""

import math
from functools import lru_cache
from hashlib import file_digest
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np

from palpate.compiler.exact import cos, einsum, sin
from palpate.messages import Surface, Vector3
from palpate.nodes.base import Node, SettingError
from palpate.nodes.base.stored.surfaces import arrays_of_mesh, mesh_of_arrays, stored
from palpate.physics.geometry.graded import fill_field, spread_over
from palpate.physics.geometry.kidney import THICKNESS, kidney
from palpate.physics.geometry.mesh import Mesh, plane
from palpate.physics.geometry.mesh_closest import MeshClosestPoint
from palpate.physics.geometry.nurbs import NurbsPatch
from palpate.physics.geometry.nurbs_fit import capsule, plane_patch, sphere
from palpate.physics.geometry.refined.divided import refine_mesh
from palpate.physics.geometry.tessellate import tessellate
from palpate.physics.geometry.thinned import thin_mesh
from palpate.physics.nearest import nearest, tree_of
from palpate.units.header import factor
from palpate.units.symbols import UnitError

SURFACES = ("kidney", "sphere", "plane", "fingertip")
OPEN = ("plane",)  # the built-in surfaces that have a border
PLACE: Vector3 = (0.0, 0.0, 0.084)
LEVEL: Vector3 = (0.0, 0.0, 0.0)
PLANE_SIZE = 0.1
REFINE = 1.6e-3  # [m] 20 % of the radius of a fingertip's patch
MOST_REFINED = 200_000  # approximate largest number of vertices after refinement
FINGER_RADIUS, FINGER_LENGTH = 9.84e-3, 12e-3  # [m] skin of the layered fingertip, see `fe.meshing.fingertip`


class Placed(Node):
    """Settings of a node that uses the scene's surface; all these nodes of a graph need the same values."""

    surface: Annotated[str, "1"] = "kidney"  # A built-in surface, or the path of a mesh file (.stl, .ply, .obj)
    position: Annotated[Vector3, "m"] = PLACE  # Of the surface's origin in the world
    rotation: Annotated[Vector3, "rad"] = LEVEL  # Rotation vector about the surface's origin


class OnSurface(Placed):
    """Settings of a node that uses the mesh of the scene's surface."""

    vertices: Annotated[int, "1", msgspec.Meta(ge=12, le=2_000_000)] = 3000
    """Approximate number of vertices of a built-in surface; not for files."""
    file_unit: Annotated[str, "1"] = "m"  # Unit of the numbers in a mesh file: m, cm or mm
    piece: Annotated[int, "1", msgspec.Meta(ge=-1)] = 0
    """Separate piece of a mesh file: 0: all but small islands; -1: all; 1: the largest, 2: the second largest ..."""

    refine: Annotated[float, "m", msgspec.Meta(ge=0)] = REFINE
    """Longer edges of a mesh file are divided on a smooth surface through its vertices, or near them if they scatter.
    1/5 of the patch radius makes normals and foot points continuous; 0: the triangles of the file."""

    def mesh(self) -> Mesh:
        """The surface's mesh, the same object for all nodes of a process with these settings."""
        return surface_mesh(*self._surface)

    @property
    def _surface(self) -> tuple[str, int, Vector3, Vector3, str, int, float]:
        """The settings that define the mesh."""
        at = self.surface, self.vertices, self.position, self.rotation
        return (*at, self.file_unit, self.piece, self.refine)


class OnThinnedSurface(OnSurface):
    """Settings of a node that uses the vertices that carry loads and displacements.

    These are the vertices of the scene's surface or, on a very fine mesh, a subset of them, so that the time of a tick
    is independent of the mesh.
    """

    spacing: Annotated[float, "m", msgspec.Meta(ge=0)] = 1e-3
    """Least distance of these vertices. Applied only if a region has 3 times as many as this requires. 1/8 of the patch
    radius results in 150 to 200 vertices under the patch. 0: all vertices."""

    def mesh(self) -> Mesh:
        """The mesh of these vertices, the same object for all nodes of a process with these settings."""
        return _thinned_mesh(*self._surface, content_of(self.surface), self.spacing)

    def whole(self) -> Mesh:
        """The mesh of all vertices, whose thickness is exact."""
        return surface_mesh(*self._surface)

    def thicknesses(self) -> np.ndarray:
        """`Mesh.thicknesses` [m] (V) of the whole surface at the vertices of `mesh`."""
        mesh, whole = self.mesh(), self.whole()
        if mesh is whole:
            return whole.thicknesses
        return np.asarray(whole.thicknesses[nearest(tree_of(whole.vertices), mesh.vertices)[1][:, 0]])


def surface_mesh(
    surface: str,
    vertices: int,
    position: Vector3 = LEVEL,
    rotation: Vector3 = LEVEL,
    file_unit: str = "m",
    piece: int = 0,
    refine: float = 0.0,
) -> Mesh:
    """The triangle mesh of a surface, rotated and moved to its position in the world.

    Calls with equal arguments return the same object while the content of the file is unchanged.

    surface    name of a built-in surface, or path of a mesh file
    vertices   approximate number of vertices of a built-in surface
    position   [m]   (3) of its origin
    rotation   [rad] (3) rotation vector about its origin
    file_unit  unit of a file's numbers: m, cm or mm
    piece      of a file, see `OnSurface.piece`
    refine     [m] longest edge of a file, see `OnSurface.refine`

    SettingError: unknown surface, or a file that cannot be used.
    """
    return _placed_mesh(surface, vertices, position, rotation, file_unit, piece, refine, content_of(surface))


def content_of(surface: str) -> bytes:
    """Digest of the surface's file; b"" for a built-in surface, and for a file too large for `read_mesh`."""
    from palpate.nodes.base.mesh_formats import LARGEST_FILE  # imports this package

    file = Path(surface).expanduser()
    if surface in SURFACES or not file.is_file() or file.stat().st_size > LARGEST_FILE:
        return b""
    with file.open("rb") as stream:
        return file_digest(stream, "blake2b").digest()


@lru_cache(maxsize=4)
def _placed_mesh(
    surface: str,
    vertices: int,
    position: Vector3,
    rotation: Vector3,
    file_unit: str,
    piece: int,
    refine: float,
    content: bytes,
) -> Mesh:
    """`surface_mesh` of a file with this digest."""
    if surface in SURFACES:
        mesh = _built_in(surface, vertices)
    else:
        mesh = _file_mesh(surface, file_unit, piece, refine, content)[0]
    return place_mesh(mesh, position, rotation)


@lru_cache(maxsize=4)
def _built_in(surface: str, vertices: int) -> Mesh:
    """The mesh of a built-in surface where its numbers put it: once for all its positions."""
    return plane(PLANE_SIZE, vertices) if surface == "plane" else tessellate(_patch(surface), max(vertices, 12))


@lru_cache(maxsize=4)  # two files, each as it is and refined
def _file_mesh(surface: str, file_unit: str, piece: int, refine: float, content: bytes) -> tuple[Mesh, float, int]:
    """The mesh of a file where its numbers put it, and what `refinement` returns; stored, if it is refined."""
    _check_name(surface)
    try:
        scale = factor(file_unit, "m")
    except UnitError as error:
        raise SettingError(f"setting 'file_unit': {error}") from None

    if refine == 0.0 or not content:
        from palpate.nodes.base.mesh_file import read_mesh  # its package is an extra

        mesh = read_mesh(surface, scale, piece)
        return mesh, 0.0, len(mesh.vertices)

    def given() -> Mesh:
        return _file_mesh(surface, file_unit, piece, 0.0, content)[0]

    inputs = inputs_of(surface, content, scale, piece, refine)
    arrays = stored("refined", inputs, lambda: _refined(given(), refine), f"{Path(surface).name}, smooth surface")
    moved, before = arrays["change"].tolist()
    return mesh_of_arrays(arrays), moved, int(before)


def inputs_of(surface: str, content: bytes, scale: float, piece: int, refine: float) -> dict[str, Any]:
    """All that the refined mesh of a file depends on."""
    kind = Path(surface).suffix.lower()
    return {"file": content.hex(), "type": kind, "scale": scale, "piece": piece, "refine": refine, "most": MOST_REFINED}


def _refined(coarse: Mesh, refine: float) -> dict[str, np.ndarray]:
    """The refined mesh, and the largest distance [m] of its vertices from the given one and the number of vertices
    before, as arrays."""
    mesh, moved = refine_mesh(coarse, refine, MOST_REFINED), 0.0
    if not np.array_equal(mesh.vertices, coarse.vertices):
        moved = MeshClosestPoint(coarse).farthest(mesh.vertices)[0]
    return {**arrays_of_mesh(mesh), "change": np.array([moved, len(coarse.vertices)])}


def place_mesh(mesh: Mesh, position: Vector3, rotation: Vector3) -> Mesh:
    """A mesh in the frame of a surface, rotated and moved to its position in the world."""
    turn = rotation_matrix(rotation)
    _finite("position", position)
    facing = None if mesh.facing is None else einsum("ik,jk->ij", mesh.facing, turn)
    points = np.ascontiguousarray(einsum("ik,jk->ij", mesh.vertices, turn) + np.asarray(position))
    return Mesh(points, mesh.triangles, facing)


def _forget_meshes() -> None:
    _placed_mesh.cache_clear()
    _file_mesh.cache_clear()


surface_mesh.cache_clear = _forget_meshes  # type: ignore[attr-defined]


@lru_cache(maxsize=4)
def _thinned_mesh(
    surface: str,
    vertices: int,
    position: Vector3,
    rotation: Vector3,
    file_unit: str,
    piece: int,
    refine: float,
    content: bytes,
    spacing: float,
) -> Mesh:
    """`OnThinnedSurface.mesh` of a file with this digest."""
    return thin_mesh(_placed_mesh(surface, vertices, position, rotation, file_unit, piece, refine, content), spacing)


def refinement(surface: str, file_unit: str, piece: int, refine: float) -> tuple[float, int]:
    """Largest distance [m] of the vertices of the refined surface from the triangles of the file, and the number of
    vertices of the file."""
    _, moved, before = _file_mesh(surface, file_unit, piece, refine, content_of(surface))
    return moved, before


def complete(surface: Surface, points: np.ndarray) -> Surface:
    """The message with all vertices [m] (V,3) of its mesh. If the sent ones are a sample of the whole surface
    (`spread_over`), the displacement of the others is interpolated, and their pressure and slip are 0. Otherwise it is
    returned unchanged: the others are at rest, or the points are those of another mesh."""
    nodes = surface.nodes
    if not len(nodes) or not 0 <= nodes.min() <= nodes.max() < len(points) or not spread_over(points, nodes):
        return surface

    def spread(values: np.ndarray) -> np.ndarray:
        every = np.zeros(len(points), values.dtype)
        every[nodes] = values
        return every

    more = {n: spread(v) for n in ("pressure", "slipped") if len(v := getattr(surface, n)) == len(nodes)}
    return msgspec.structs.replace(
        surface, nodes=np.arange(len(points), dtype=np.int32),
        displacement=fill_field(points, nodes, surface.displacement), **more,
    )  # fmt: skip


def surface_patch(surface: str, position: Vector3 = LEVEL, rotation: Vector3 = LEVEL) -> NurbsPatch:
    """The NURBS patch of a built-in surface at its position. SettingError: unknown surface, or a mesh."""
    if surface not in SURFACES:
        _check_name(surface)
        raise SettingError(
            f"setting 'surface': {surface!r} is a mesh file, expected one of {', '.join(SURFACES)}. "
            "Use collision.Mesh for a mesh file."
        )
    _finite("position", position)
    return _patch(surface).move(rotation_matrix(rotation), np.asarray(position))


def _patch(surface: str) -> NurbsPatch:
    if surface == "kidney":
        return kidney()
    if surface == "fingertip":
        forward = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
        return capsule(FINGER_RADIUS, FINGER_LENGTH).move(forward, np.array([0.0, -FINGER_LENGTH, 0.0]))
    return sphere(THICKNESS / 2) if surface == "sphere" else plane_patch(PLANE_SIZE)


def _check_name(surface: str) -> None:
    """SettingError where a name is neither a built-in surface nor looks like a path."""
    if not Path(surface).suffix:
        raise SettingError(
            f"setting 'surface': found {surface!r}, expected one of {', '.join(SURFACES)}, or a mesh file"
        )


def _finite(name: str, vector: Vector3) -> None:
    if not np.isfinite(vector).all():
        raise SettingError(f"setting {name!r}: found {vector}, expected three finite numbers")


def rotation_matrix(rotation: Vector3) -> np.ndarray:
    """(3,3), of a rotation vector [rad]. SettingError: one that is not finite."""
    _finite("rotation", rotation)
    if tuple(rotation) == LEVEL:
        return np.eye(3)
    # by a unit quaternion: (x, y, z) = a sin(|a|/2)/|a|, w = cos(|a|/2)
    square = sum(each * each for each in rotation)
    angle = math.sqrt(square)
    scale = 0.5 - square / 48.0 + square * square / 3840.0 if angle <= 1e-3 else float(sin(0.5 * angle)) / angle
    (x, y, z), w = (each * scale for each in rotation), float(cos(0.5 * angle))
    return np.array(
        [
            [x * x - y * y - z * z + w * w, 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
            [2.0 * (x * y + z * w), y * y - x * x - z * z + w * w, 2.0 * (y * z - x * w)],
            [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), z * z - x * x - y * y + w * w],
        ]
    )
