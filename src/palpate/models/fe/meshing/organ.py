"""An organ from its closed surface, homogeneous or with a capsule or a nodule."""

from contextlib import chdir
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import linprog

from palpate.models.fe.element.mesh import MeshError, TetMesh, check_surface, quadratic, turned_out
from palpate.models.fe.meshing.walls import NearWalls, bodies, facing, near_walls
from palpate.physics.extras import missing
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.materials.hyperelastic import Material
from palpate.physics.materials.neo_hooke import neo_hooke
from palpate.physics.scratch import ScratchFolder
from palpate.physics.segmentation.region import Region

SHELLS = (1.0, 0.9, 0.77, 0.6, 0.38)
"""Scales of the nested copies of the surface; the prisms between them are divided into tetrahedra."""
SLAB = 0.04  # [m] Thickness of the slab under a level surface
ENVELOPE = 0.1
"""[1] Largest distance of a reduced surface from the given one, over the length of its edges."""
FINER = 4.0
"""[1] Triangles to which a surface is decimated before it is meshed, over the triangles that are wanted: fTetWild takes
5 times as long for 80 000 triangles as for 8 000, and the surface moves by 0.04 mm."""
SLACK = 1.1  # [1] The distance of the boundary from the surface over the envelope, with what decimation moves it
FACES = 0.5  # [1] least cosine between the normal of a face and the direction to the bone that it faces
LEAST = 1e-3  # Volume of the tetrahedron from a point to a triangle, over the mean, above which the triangle is visible


@dataclass(frozen=True)
class Nodule:
    """A ball of harder tissue: centre [m] (3), radius [m], modulus over that of the organ; a region replaces it."""

    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)
    radius: float = 0.0
    ratio: float = 10.0
    region: Region | None = field(default=None, repr=False)


@dataclass(frozen=True)
class Capsule:
    """A surface layer of other tissue: thickness [m], 0: no layer; modulus over that of the organ."""

    thickness: float = 0.0
    ratio: float = 10.0


def fill(surface: Mesh, nodule: Nodule = Nodule(), capsule: Capsule = Capsule()) -> TetMesh:
    """Quadratic tetrahedra inside a closed star-shaped surface, all of whose triangles are visible from a point inside,
    or in the slab of thickness `SLAB` under a level surface (all z equal, normals towards +z).

    The first nodes are the vertices of the surface, in order. Region 2 is the capsule, a layer of uniform thickness; 1
    is the nodule, 0 the rest.

    MeshError: a surface that is open, inverted or not star-shaped, or a capsule too thick for it; states the place.
    """
    vertices, triangles = surface.vertices, surface.triangles.astype(np.int64)
    if level(surface):
        if not capsule.thickness < SLAB:
            raise MeshError(f"capsule: found {capsule.thickness} m, expected less than the slab's {SLAB} m")
        depths = [capsule.thickness + (SLAB - capsule.thickness) * (1.0 - s) for s in (*SHELLS, 0.0)]
        layers = [vertices - (0.0, 0.0, d) for d in ([0.0, *depths] if capsule.thickness > 0.0 else depths)]
        return _layer_prisms(triangles, layers, nodule, capsule)
    hub = seen_from(surface)
    if hub is None:
        raise MeshError("surface: not star-shaped (no point inside sees all of its triangles): shells cannot fill it")
    inner = vertices - capsule.thickness * surface.normals
    _fits(inner - hub, surface, capsule)
    layers = [hub + s * (inner - hub) for s in SHELLS]
    return _layer_prisms(triangles, [vertices, *layers] if capsule.thickness > 0.0 else layers, nodule, capsule, hub)


def level(surface: Mesh) -> bool:
    """Whether a surface is flat with normals upwards, the top of a slab."""
    height = np.ptp(surface.vertices[:, 2])
    return bool(height < 1e-9 * np.ptp(surface.vertices) and (surface.face_vectors[:, 2] > 0).all())


def seen_from(surface: Mesh) -> np.ndarray | None:
    """A point [m] (3) from which all triangles of a closed surface are visible: the origin of its frame if possible,
    else the point farthest from the planes of all triangles (a linear programme); None: the surface is not star-shaped.
    MeshError: a surface that is open, or whose normals point inwards."""
    vertices, triangles = surface.vertices, surface.triangles.astype(np.int64)
    check_surface(surface)
    volume = np.einsum("ij,ij->", surface.face_vectors, vertices[triangles[:, 0]]) / 6.0
    if not volume > 0.0:
        raise MeshError(
            f"surface: its triangles enclose {1e6 * volume:.4g} ml, expected a positive volume: normals point inwards. "
            "Reverse its triangles"
        )
    origin = np.zeros(3)
    if _visible_from(surface, origin):
        return origin
    large = np.linalg.norm(surface.face_vectors, axis=1) > 0.0
    unit = surface.face_vectors[large] / np.linalg.norm(surface.face_vectors[large], axis=1, keepdims=True)
    middle, size = vertices.mean(axis=0), float(np.ptp(vertices))
    reach = np.einsum("ij,ij->i", unit, vertices[triangles[large, 0]] - middle) / size
    optimum = linprog(
        (0.0, 0.0, 0.0, -1.0), A_ub=np.column_stack([unit, np.ones(len(unit))]), b_ub=reach,
        bounds=[(-1.0, 1.0)] * 3 + [(None, 1.0)],
    )  # fmt: skip
    if optimum.status != 0:
        return None
    hub: np.ndarray = middle + size * optimum.x[:3]
    return hub if _visible_from(surface, hub) else None


def _visible_from(surface: Mesh, point: np.ndarray) -> bool:
    corner = surface.vertices[surface.triangles[:, 0]] - point
    seen = np.einsum("ij,ij->i", surface.face_vectors, corner)
    return bool((seen > LEAST * np.abs(seen).mean()).all())


def _fits(inner: np.ndarray, surface: Mesh, capsule: Capsule) -> None:
    """MeshError: the inner side of the capsule (relative to the hub) folds, or is not visible from the hub."""
    face = Mesh(inner, surface.triangles).face_vectors
    seen = np.einsum("ij,ij->i", face, inner[surface.triangles[:, 0]])
    bad = (np.einsum("ij,ij->i", face, surface.face_vectors) <= 0.0) | (seen <= LEAST * np.abs(seen).mean())
    if bad.any():
        at = surface.vertices[surface.triangles[np.argmax(bad)]].mean(axis=0) * 1e3
        raise MeshError(
            f"capsule: {capsule.thickness} m does not fit under the surface at ({at[0]:.4g}, {at[1]:.4g}, "
            f"{at[2]:.4g}) mm; decrease its thickness"
        )


def _layer_prisms(
    triangles: np.ndarray, layers: list[np.ndarray], nodule: Nodule, capsule: Capsule, hub: np.ndarray | None = None
) -> TetMesh:
    """Prisms between layers, divided into tetrahedra, with the last layer joined to the `hub`, if given; regions of
    nodule and capsule, and nodes on edges."""
    n = len(layers[0])
    points = np.concatenate(layers if hub is None else [*layers, hub[None]])
    tets = [_prisms(triangles + (k + 1) * n, triangles + k * n) for k in range(len(layers) - 1)]
    if hub is not None:
        tets.append(np.column_stack([np.full(len(triangles), len(points) - 1), triangles + (len(layers) - 1) * n]))
    corners = turned_out(points, np.concatenate(tets))
    region = inside(nodule, points[corners]).astype(np.int64)
    if capsule.thickness > 0.0:
        region[: len(tets[0])] = 2
    return quadratic(points, corners, region)


def inside(nodule: Nodule, corners: np.ndarray) -> np.ndarray:
    """Whether the centre of each tetrahedron with these corners [m] (E,4,3) is in the nodule (E,)."""
    if nodule.region is not None:
        return nodule.region.contains(corners.mean(axis=1))
    return np.linalg.norm(corners.mean(axis=1) - nodule.centre, axis=1) < nodule.radius


def _prisms(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Three tetrahedra per prism; the diagonals of its sides follow the order of the vertices, so that neighbours
    agree."""
    a, b = np.sort(low, axis=1), np.sort(high, axis=1)
    cuts = [[a[:, 0], a[:, 1], a[:, 2], b[:, 2]], [a[:, 0], a[:, 1], b[:, 1], b[:, 2]], [a[:, 0], *b.T]]
    return np.concatenate([np.column_stack(cut) for cut in cuts])


def envelope(surface: Mesh, edge: float | None = None) -> float:
    """Largest distance [m] of the boundary of `solid` from the surface."""
    return 1e-3 * diagonal(surface) if edge is None else ENVELOPE * edge


def diagonal(surface: Mesh) -> float:
    """Diagonal of the bounding box of a surface [m]."""
    return float(np.linalg.norm(np.ptp(surface.vertices, axis=0)))


def solid(surface: Mesh, edge: float | None = None, apart: bool = False) -> tuple[TetMesh, Mesh]:
    """Quadratic tetrahedra inside any closed surface, and their boundary, whose vertices are their first nodes.

    fTetWild remeshes the surface. Y. Hu et al., Fast tetrahedral meshing in the wild, ACM Trans. Graph. 39 (2020) 117.

    edge   [m] length of the edges to aim for; None: the mean length of the surface's edges
    apart  whether separate bodies are meshed one by one. Together, those that are nearer than the envelope are joined
           here and there, and a gap that is far narrower than the edges takes minutes

    MeshError: pytetwild is not installed, or finds no tetrahedra inside.
    """
    far = envelope(surface, edge)
    if edge is None:
        corner = surface.vertices[surface.triangles]
        edge = float(np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=2).mean())
    else:
        surface = decimate_mesh(surface, round(FINER * 2.0 * vertices_for(surface, edge)))
    parts = [_tetrahedra(body, edge, far) for body in (bodies(surface) if apart else [surface])]
    points, first = np.concatenate([part[0] for part in parts]), np.cumsum([0, *(len(part[0]) for part in parts)])
    tets = turned_out(points, np.concatenate([tets + k for (_, tets), k in zip(parts, first[:-1], strict=True)]))
    faces = quadratic(points, tets).faces[:, :3]
    outer = np.unique(faces)
    order = np.concatenate([outer, np.setdiff1d(np.unique(tets), outer)])
    number = np.full(len(points), -1)
    number[order] = np.arange(len(order))
    points = points[order]
    return quadratic(points, number[tets]), Mesh(points[: len(outer)].copy(), number[faces].astype(np.int32))


def _tetrahedra(surface: Mesh, edge: float, far: float) -> tuple[np.ndarray, np.ndarray]:
    """Points [m] (n,3) and tetrahedra (E,4) inside a surface, with edges of about `edge` [m], and a boundary at most
    `far` [m] from it."""
    try:
        from pytetwild import tetrahedralize
    except ModuleNotFoundError as error:
        what = "surface: not star-shaped (no point inside sees all of its triangles), or to be reduced, which requires "
        raise MeshError(missing(what + "another mesher", error.name, "mesh")) from None
    middle, size = surface.vertices.mean(axis=0), float(np.ptp(surface.vertices))
    scaled, triangles = (surface.vertices - middle) / size, np.array(surface.triangles, dtype=np.int32)
    with ScratchFolder("mesh") as folder, chdir(folder):  # it leaves a file in the current folder
        vertices, tets = tetrahedralize(
            scaled, triangles, edge_length_abs=edge / size, epsilon=far / diagonal(surface), num_threads=1
        )[:2]  # fmt: skip
    if len(tets) == 0:
        raise MeshError("surface: found no tetrahedra inside it; does it intersect itself?")
    return middle + size * np.asarray(vertices, dtype=np.float64), np.asarray(tets, dtype=np.int64)


def vertices_for(surface: Mesh, edge: float) -> float:
    """Number of vertices of a mesh of equilateral triangles with edges of this length [m] over the surface."""
    return float(surface.areas.sum()) / (0.5 * 3.0**0.5 * edge**2)


def edge_for(surface: Mesh, vertices: int) -> float:
    """Length of the edges [m] of a mesh of equilateral triangles with this number of vertices over the surface."""
    return float(np.sqrt(surface.areas.sum() / (0.5 * 3.0**0.5 * vertices)))


def decimate_mesh(surface: Mesh, triangles: int) -> Mesh:
    """The surface with this number of triangles, by quadric error metrics; unchanged if it has fewer.

    M. Garland, P. S. Heckbert, Surface simplification using quadric error metrics, SIGGRAPH 1997. MeshError:
    fast-simplification is not installed.
    """
    if len(surface.triangles) <= triangles:
        return surface
    try:
        from fast_simplification import simplify
    except ModuleNotFoundError as error:
        raise MeshError(missing("surface: has too many triangles and must be reduced", error.name, "mesh")) from None
    points, corners = simplify(surface.vertices, surface.triangles, target_count=triangles)
    return Mesh(np.asarray(points, dtype=np.float64), np.asarray(corners, dtype=np.int32))


@dataclass
class Organ:
    """An organ on an elastic foundation: mesh and materials.

    surface  closed triangle mesh in the organ's frame; remeshed if it is not star-shaped, see `solid`
    `edge`   [m] length of the edges to which the surface is reduced; 0: its vertices are kept where possible
    `bed`    [1/m] stiffness per area of the foundation under faces with normals towards -z, over the organ's modulus
    `walls`  [m] walls of the surface that are nearer to each other push on each other as if they touched; 0: none do
    `bone`   rigid voxels in the organ's frame, to which faces towards them are fixed by a layer of the organ's
             tissue as thick as their distance, if it is stiffer than the foundation
    """

    surface: Mesh
    poisson: float = 0.45  # [1] below 0.5
    bed: float = 50.0
    nodule: Nodule = Nodule()  # harder ball
    capsule: Capsule = Capsule()  # harder surface layer
    edge: float = 0.0
    walls: float = 0.0
    bone: Region | None = None

    def __post_init__(self) -> None:
        if not self.bed > 0:
            raise MeshError(f"`bed`: found {self.bed} 1/m, expected a positive number, which supports the organ")
        across = float(np.ptp(self.surface.vertices, axis=0).max())
        if not 1e-3 <= across <= 3.0:
            raise MeshError(f"surface: found {across:.4g} m across, expected 1 mm ... 3 m; is its unit right?")
        if self.edge > 0.0 and (self.surface.edges[1] != 2).any():
            check_surface(self.surface)  # raises; whether it intersects itself does not matter to fTetWild
        near, far = self._near_walls(), envelope(self.surface, self.edge or None)
        if self.edge > 0.0:
            self.mesh, self.surface = solid(self.surface, self.edge or None, near is not None)
        if self.edge > 0.0 and self.capsule.thickness == 0.0:
            self.mesh.region[inside(self.nodule, self.mesh.points[self.mesh.elements[:, :4]])] = 1
        elif level(self.surface) or seen_from(self.surface) is not None:
            self.mesh = fill(self.surface, nodule=self.nodule, capsule=self.capsule)
        else:
            if self.capsule.thickness > 0.0:
                raise MeshError("capsule: found a surface that is not star-shaped, expected one; remove the capsule")
            self.mesh, self.surface = solid(self.surface, None, near is not None)
            self.mesh.region[inside(self.nodule, self.mesh.points[self.mesh.elements[:, :4]])] = 1
        if self.nodule.radius > 0.0 and not (self.mesh.region == 1).any():
            where = f"within {self.nodule.radius} m of {tuple(self.nodule.centre)} m"
            if self.nodule.region is not None:
                where = "in the voxels of `nodule_shape`"
            raise MeshError(
                f"nodule: no element has its centre {where}, "
                "under the capsule, in the surface's frame; enlarge or move the nodule, or refine the surface"
            )
        self.faces = self.mesh.faces
        self.facing = None if near is None else facing(self.mesh, near, self.walls, SLACK * far)

    def _near_walls(self) -> NearWalls | None:
        """The near walls of the given surface."""
        if not (self.walls > 0.0 and self.surface.closed):
            return None
        return near_walls(self.surface, self.walls, 0.5 * self.edge or np.inf)

    def materials(self, young: float) -> dict[int, Material]:
        """Neo-Hookean materials of an organ with this modulus [Pa]."""
        ratios = {0: 1.0, 1: self.nodule.ratio, 2: self.capsule.ratio}
        return {region: neo_hooke(young * r, self.poisson) for region, r in ratios.items()}

    def under(self) -> np.ndarray:
        """Whether each face is on the foundation (F,)."""
        normal = Mesh(self.mesh.points, self.faces[:, :3]).face_vectors
        return normal[:, 2] < -0.5 * np.linalg.norm(normal, axis=1)

    def resting(self) -> tuple[np.ndarray, float | np.ndarray]:
        """Whether each face has springs (F,), and their stiffness per area over the modulus [1/m]: one, or that of each
        of these faces."""
        under = self.under()
        if self.bone is None:
            return under, self.bed
        corners = self.mesh.points[self.faces[:, :3]]
        away = self.bone.nearest_border(corners.mean(axis=1)) - corners.mean(axis=1)
        normal = Mesh(self.mesh.points, self.faces[:, :3]).face_vectors
        distance = np.linalg.norm(away, axis=1)
        least = 0.5 * float(np.linalg.norm(self.bone.affine[:, :3], axis=0).max())
        facing = np.einsum("fi,fi->f", away, normal) > FACES * distance * np.linalg.norm(normal, axis=1)
        stiff = 1.0 / np.maximum(distance, least)  # nearer than half a voxel is not known
        fixed = (facing | (distance < least)) & (stiff > self.bed)
        return under | fixed, np.where(fixed, stiff, self.bed)[under | fixed]
