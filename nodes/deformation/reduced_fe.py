"""The reduced finite-element body (docs/equations/reduced-fe.md)."""

from __future__ import annotations

import hashlib
import json
import os
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import numpy as np

from palpate.messages import Load, Surface, Vector3
from palpate.nodes.base import SettingError
from palpate.nodes.surface import SURFACES, OnSurface, surface_mesh
from palpate.physics.mesh import Mesh
from palpate.physics.reduced_fe import Basis, BasisError, CondensedBody
from palpate.physics.sampled import SampledBasis, SampledBody

SHIPPED = Path(__file__).parent / "bases"
FORM, SAMPLED_FORM, PRESSED = 2, 1, 2
"""Numbers of the forms of stored bases and of sampled ones, and of the way in which organs are pressed for dents; a new
one makes all old ones unknown."""
NO_NODES = np.zeros(0, dtype=np.int32)
NO_FORCES = np.zeros((0, 3))
BUILT_FROM = (
    "model", "modes", "surface", "file_unit", "poisson", "bed", "coarse", "nodule_centre", "nodule_radius",
    "nodule_ratio", "capsule_thickness", "capsule_ratio",
)  # fmt: skip
"""Settings that the basis depends on, or whether it needs dents."""
LEAST = 1e-9
"""[m/N] Compliance below which the body counts as rigid."""


class ReducedFE(OnSurface):
    """A finite-element organ condensed to its surface, with what large displacement adds, on a soft bed; optionally
    with a hard nodule and a stiffer capsule.

    `palpate reduce` builds its basis once for a surface, Poisson's ratio, bed, nodule and capsule; that of the default
    kidney ships. Modulus and retardation time may be changed without building it again. The fingertip is of layers: its
    `young` is that of the subcutis at rest, 160 Pa as calibrated, and poisson, bed, nodule and capsule are not read.
    """

    model: Annotated[Literal["nonlinear", "linear", "sampled"], "1"] = "nonlinear"
    """How it follows large displacement: by dents under the patch, not at all, or in modes of the whole body with its
    energy sampled; the last is meant for the fingertip."""
    modes: Annotated[int, "1", msgspec.Meta(ge=4, le=200)] = 80
    """Of the sampled model."""
    young: Annotated[float, "Pa", msgspec.Meta(ge=10, le=1e9)] = 19e3
    poisson: Annotated[float, "1", msgspec.Meta(gt=-1, lt=0.5)] = 0.45
    retardation: Annotated[float, "s", msgspec.Meta(ge=0)] = 0.02
    """Kelvin-Voigt: viscosity over modulus."""
    bed: Annotated[float, "1/m", msgspec.Meta(gt=0)] = 50.0
    """Stiffness per area of what the underside lies on, over `young`."""
    nodule_centre: Annotated[Vector3, "m"] = (0.0, 0.0, 0.0)
    """In the surface's own frame."""
    nodule_radius: Annotated[float, "m", msgspec.Meta(ge=0)] = 0.0
    nodule_ratio: Annotated[float, "1", msgspec.Meta(gt=0)] = 10.0
    """Modulus of the nodule over that of the organ."""
    capsule_thickness: Annotated[float, "m", msgspec.Meta(ge=0)] = 0.0
    """Of a skin of other modulus; 0 is a homogeneous organ."""
    capsule_ratio: Annotated[float, "1", msgspec.Meta(gt=0)] = 10.0
    """Modulus of the skin over that of the organ."""
    coarse: Annotated[int, "1", msgspec.Meta(ge=50, le=2000)] = 600
    """About how many vertices the condensed surface has."""
    radius: Annotated[float, "m", msgspec.Meta(gt=0)] = 8e-3
    """Of the patch that the terminal law is taken over before the first load."""
    reach: Annotated[float, "m", msgspec.Meta(gt=0)] = 20e-3
    """From the foot point within which displacements are sent."""

    def start(self) -> None:
        self._body = self._made()
        mesh = self._body.mesh
        foot, normal = tuple(mesh.vertices[0].tolist()), tuple(mesh.normals[0].tolist())
        push = -1e-3 * mesh.normals[:1]
        for nodes, forces in ((NO_NODES, NO_FORCES), (np.zeros(1, dtype=np.int32), push)):  # compiles both ways
            nodes, forces = nodes.view(), forces.view()
            nodes.setflags(write=False)  # as messages carry them
            forces.setflags(write=False)
            self._answer(nodes, forces, foot, normal, 1e-3)
            self._body.displaced(foot)
        self._body = self._made()
        self.last = self._surface(NO_NODES, NO_FORCES, *self._answer(NO_NODES, NO_FORCES, foot, normal, 1e-3))

    def _made(self) -> CondensedBody | SampledBody:
        """The body at its place, at rest."""
        basis = self.basis()
        own = surface_mesh(self.surface, self.vertices, file_unit=self.file_unit)
        placed = self.mesh()
        turn = _rotation(own, placed)
        origin = placed.vertices[0] - turn @ own.vertices[0]
        vertices, count = basis.vertices @ turn.T + origin, len(basis.vertices)
        same = np.allclose(turn, np.eye(3), atol=1e-12)

        def turned(matrix: np.ndarray) -> np.ndarray:
            blocks = matrix.reshape(count, 3, count, 3)
            if not same:
                blocks = np.einsum("ij,ajbk,lk->aibl", turn, blocks, turn, optimize=True)
            return np.ascontiguousarray(blocks.reshape(3 * count, -1), np.float32)

        given = (placed, self.young, self.retardation, self.radius, self.reach)
        if isinstance(basis, SampledBasis):
            modes = np.einsum("ij,ajk->aik", turn, basis.modes.reshape(count, 3, -1)).reshape(3 * count, -1)
            missed = turned(basis.missed)
            own_basis = SampledBasis(vertices, basis.triangles, missed, modes, basis.points, basis.bend)
            return SampledBody(own_basis, *given)
        dents = basis.dents if self.model == "nonlinear" else np.zeros((count, 0))
        return CondensedBody(Basis(vertices, basis.triangles, turned(basis.compliance), dents), *given)

    def _answer(
        self, nodes: np.ndarray, forces: np.ndarray, foot: tuple, normal: tuple, dt: float
    ) -> tuple[float, float, float, float]:
        """K, n and s_free of the next step's terminal law, and the indentation now [m]."""
        if isinstance(self._body, SampledBody):
            return self._body.step(nodes, forces, foot, normal, dt)
        compliance, free, now = self._body.step(nodes, forces, foot, normal, dt)
        return 1.0 / max(compliance, LEAST), 1.0, free, now

    def step(self, load: Load, *, dt: float) -> Surface:
        if dt > 0.0:
            law = self._answer(load.nodes, load.forces, load.foot, load.normal, dt)
            nodes, moved = self._body.displaced(load.foot) if self.wants("displacement") else (NO_NODES, NO_FORCES)
            self.last = self._surface(nodes, moved, *law)
        return self.last

    def _surface(
        self, nodes: np.ndarray, moved: np.ndarray, stiffness: float, exponent: float, free: float, now: float
    ) -> Surface:
        return Surface(
            nodes=nodes,
            displacement=moved,
            stiffness=stiffness,
            exponent=exponent,
            damping=0.0,
            free=free,
            previous=now,
        )

    def coarse_mesh(self) -> Mesh:
        """The surface that the organ is condensed to, in its own frame."""
        return surface_mesh(self.surface, self.coarse, file_unit=self.file_unit)

    def key(self) -> str:
        """What the basis depends on, as a hash."""
        if self.surface == "fingertip" and self.model == "sampled":
            return hashlib.sha256(json.dumps([FORM, SAMPLED_FORM, self.surface, self.modes]).encode()).hexdigest()[:16]
        surface: object = [self.surface, self.coarse]
        if self.surface not in SURFACES:
            try:
                surface = [hashlib.sha256(Path(self.surface).read_bytes()).hexdigest(), self.file_unit]
            except OSError as error:
                raise SettingError(f"setting 'surface': {self.surface!r}: {error.strerror}") from None
        nodule = [self.nodule_centre, self.nodule_radius, self.nodule_ratio] if self.nodule_radius > 0 else []
        capsule = [self.capsule_thickness, self.capsule_ratio] if self.capsule_thickness > 0 else []
        given = [FORM, surface, self.poisson, self.bed, nodule, capsule]
        given += [SAMPLED_FORM, self.modes] if self.model == "sampled" else [PRESSED]
        return hashlib.sha256(json.dumps(given).encode()).hexdigest()[:16]

    def basis(self) -> Basis | SampledBasis:
        """The stored basis.

        SettingError: none is stored for these settings, or it cannot be read.
        """
        found = self.stored(SHIPPED, cache())
        if found is not None:
            return found[1]
        usual = type(self)()
        given = [f"--set {n}={_text(getattr(self, n))}" for n in BUILT_FROM if getattr(self, n) != getattr(usual, n)]
        raise SettingError(
            "no reduced basis is stored for these settings of model, surface, poisson, bed, coarse, nodule, capsule. "
            f"Build it once: palpate reduce {' '.join(given)}"
        )

    def stored(self, *folders: Path) -> tuple[Path, Basis | SampledBasis] | None:
        """The basis for these settings in the first of the folders that holds one, and its path; a basis without dents
        serves the linear model only.

        SettingError: one that cannot be read.
        """
        for folder in folders:
            path = folder / f"{self.key()}.npz"
            if path.exists():
                try:
                    if self.model == "sampled":
                        return path, SampledBasis.load(path)
                    found = Basis.load(path)
                except BasisError as error:
                    raise SettingError(str(error)) from None
                if found.dents.size or self.model == "linear":
                    return path, found
        return None


def _text(value: object) -> str:
    """A setting's value as a command takes it."""
    return "'[" + ", ".join(map(str, value)) + "]'" if isinstance(value, tuple) else str(value)


def cache() -> Path:
    """Folder of the bases built on this machine."""
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "palpate" / "bases"


def touches() -> Path:
    """Folder of the full solutions that `palpate reduce` keeps while it builds."""
    return cache().with_name("touches")


def _rotation(own: Mesh, placed: Mesh) -> np.ndarray:
    """The rotation that took the vertices of one mesh to those of the other (Kabsch)."""
    a = own.vertices - own.vertices.mean(axis=0)
    b = placed.vertices - placed.vertices.mean(axis=0)
    left, _, right = np.linalg.svd(b.T @ a)
    return left @ np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))]) @ right
