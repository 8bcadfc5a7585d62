"""The reduced finite-element body (docs/equations/reduced-fe.md)."""

from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np

from palpate.messages import Load, Surface, Vector3
from palpate.nodes.base import CompiledNode, Out, Part, SettingError, Switch
from palpate.nodes.base.contacts import SEVERAL, make_room
from palpate.nodes.base.nodule import WithNodule
from palpate.nodes.base.surface import LEVEL, SURFACES, rotation_matrix, surface_mesh
from palpate.nodes.deformation import basis_store
from palpate.nodes.deformation.reduced_answer import PRESSURE, along_the_surface, caution_once, send
from palpate.physics.archive import ArchiveError
from palpate.physics.bodies import condensed_body as condensed
from palpate.physics.bodies import sampled_body as sampled
from palpate.physics.bodies.condensed_basis import Basis
from palpate.physics.bodies.condensed_body import CondensedBody, condensed_body, under
from palpate.physics.bodies.half_space_range import CAUSES, caution
from palpate.physics.bodies.large_displacement import nonlinearity
from palpate.physics.bodies.sampled_body import SampledBasis, SampledBody, sampled_body
from palpate.physics.contact.spread import TABLES
from palpate.physics.entry_point import NO_FLOATS
from palpate.physics.exact import product
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.kernel import kernel
from palpate.physics.records import floats, form, integers, nth, one, unpacking, vector

BUILT_FROM = (
    "model", "modes", "surface", "file_unit", "poisson", "bed", "coarse", "capsule_thickness", "capsule_ratio",
)  # fmt: skip
"""Settings that the basis depends on."""
NODULE = ("vertices", "position", "rotation", "nodule_position", "nodule_depth", "nodule_radius", "nodule_ratio")
"""Those that place a nodule, or make it."""
GRID = 1e-6
"""[m] To which a nodule's place is rounded, as the same place in the world is not bit-equal in the surface's frame."""


_condensed_of, _sampled_of = unpacking(CondensedBody), unpacking(SampledBody)


class ReducedFE(CompiledNode, WithNodule):
    """A finite-element organ condensed to its surface, with what large displacement adds, on a soft bed; optionally
    with a hard nodule and a stiffer capsule.

    `palpate build basis` builds its basis once for a surface, Poisson's ratio, bed, nodule and capsule; that of the
    default kidney ships. Modulus and retardation time may be changed without building it again. The fingertip is of
    layers: its `young` is that of the subcutis at rest, 160 Pa in the set cortical/36.4; poisson, bed, nodule and
    capsule are not read.
    """

    effect = "deformation"
    rank = 3

    model: Annotated[Literal["nonlinear", "linear", "sampled"], "1"] = "nonlinear"
    """How it follows large displacement: by the law of a half-space under the patch, not at all, or in modes of the
    whole body with its energy sampled; the last is meant for the fingertip."""
    modes: Annotated[int, "1", msgspec.Meta(ge=4, le=200)] = 80  # Of the sampled model
    young: Annotated[float, "Pa", msgspec.Meta(ge=10, le=1e9)] = 19e3
    poisson: Annotated[float, "1", msgspec.Meta(ge=0, lt=0.5)] = 0.45
    retardation: Annotated[float, "s", msgspec.Meta(ge=0), Switch("relaxation")] = 0.02
    """Kelvin-Voigt: viscosity over modulus."""
    bed: Annotated[float, "1/m", msgspec.Meta(gt=0)] = 50.0
    """Stiffness per area of what the underside lies on, over `young`."""
    capsule_thickness: Annotated[float, "m", msgspec.Meta(ge=0)] = 0.0
    """Of a skin of other modulus; 0 is a homogeneous organ."""
    capsule_ratio: Annotated[float, "1", msgspec.Meta(gt=0)] = 10.0  # Modulus of the skin over that of the organ
    sticks: Annotated[bool, "1"] = True
    """Whether the surface under the patch sticks to the finger, or is free to slide on it (under light loads: heavier
    ones are reported); not of the sampled model."""
    coarse: Annotated[int, "1", msgspec.Meta(ge=50, le=2000)] = 600  # About how many vertices the condensed surface has
    radius: Annotated[float, "m", msgspec.Meta(gt=0)] = 8e-3
    """Of the patch that the terminal law is taken over before the first load."""
    reach: Annotated[float, "m", msgspec.Meta(gt=0)] = 10e-3
    """From the foot point within which the displacement of every vertex is sent; farther off of fewer and fewer."""

    energy = Part("energy", "stored", about="The energy that the condensed organ holds; a sampled one does not tell.")
    shape = Part(
        "shape", "nodes", "displacement",
        about="Vertices of the surface, all within reach and fewer farther off, and how far they are displaced [m].",
    )  # fmt: skip
    pressure = Part(
        "pressure", "pressure",
        about="Of the loads on the vertices that are sent [Pa]: their part against the normal over the area of each.",
    )  # fmt: skip
    slope = Part(
        "slope", "tangential_gradient", "shape_operator",
        about="How the body's energy changes along its surface, which pushes the finger to where it is softer.",
    )  # fmt: skip
    State = (
        SEVERAL | PRESSURE | {"body": form(CondensedBody), "beyond": (), "cautions": (len(CAUSES), 4), "causes": int}
    )
    """How far the last step was outside of what the body can tell; of each cause that there was its number, how far,
    and the radius [m] of the load, its own and on the coarse surface; how many."""
    shared = (
        "areas", "body.model", "body.ground", "body.fine.reach", *(f"body.fine.spreader.{name}" for name in TABLES)
    )  # fmt: skip

    def __new__(cls, **given: Any) -> "ReducedFE":
        sampled = given.get("model", cls.model) == "sampled"
        return super().__new__(_sampled(cls) if sampled else cls)

    def start(self) -> None:
        super().start()
        self._noted = 0
        modulus = self.young / (1.0 - self.poisson**2)
        if self.area in ("ball", "fingertip") and not 0.98 < modulus / self.area_modulus < 1.02:
            found = f"area_modulus is {self.area_modulus:.4g} Pa, expected {modulus:.4g} Pa, E/(1 - nu²) of this body"
            self._notes.append(f"ReducedFE: {found}: the area law is that of another tissue")
        mesh = self.mesh()
        self.hold("areas", np.ascontiguousarray(mesh.areas))
        self.hold("push", np.zeros(len(mesh.vertices)))
        self.hold("pressures", np.zeros(len(mesh.vertices)))
        self._organ = self._made()
        self._make(self._count)

    def check(self) -> None:
        self.basis()

    def condition(self) -> str:
        return "outside its range" if hasattr(self, "own") and self.own["beyond"] > 0.0 else ""

    _count = 1  # of contacts; kept over a start, so that what they need is there before the first step

    def resize(self, counts: list[int]) -> None:
        if counts[0] != self._count:
            self._make(counts[0])

    def _make(self, count: int) -> None:
        self._count = count
        make_room(self, count)
        body = under(*self._organ[:3], count)
        self.hold("body", body)
        self.hold("coupling", body.coupling)

    def _made(self) -> Any:
        """What bodies under any number of contacts share."""
        basis, given = self._placed()
        large = self.model == "nonlinear" and self.sticks  # a surface that slides is known under light loads only
        rho = nonlinearity(self.poisson) if large else NO_FLOATS
        return condensed_body(basis, *given, self.poisson, self.sticks, self._apart(), rho, self.area_law())

    @kernel
    def idle(own, load, out, dt):
        body = _condensed_of(own.body)
        for i in range(load.count):
            each = nth(load, i)
            if each.nodes.shape[0] > 0:
                return False
            for k in range(3):
                if body.feet[i, k] != each.foot[k] or body.normals[i, k] != each.normal[k]:
                    return False
        return condensed.is_still(body)

    @kernel(error_model="numpy")
    def compute(own, load: list[Load], out: Out[Surface], dt):
        body = _condensed_of(own.body)
        for i in range(load.count):
            each = nth(load, i)
            nodes, forces = integers(each.nodes), floats(each.forces)
            condensed.bear(body, i, nodes, forces, vector(each.foot), vector(each.normal), dt)
        condensed.answer(body, floats(own.laws), dt)
        own.beyond = condensed.extrapolation(body)
        if own.beyond > 0.0:
            caution_once(own, body.numbers)
        if own.slope:
            along_the_surface(own, body, load, out)
        if own.energy:
            one(out.stored, condensed.stored(body))
        count = condensed.displaced(body) if own.shape else 0
        send(own, load, count, out, dt)

    def notes(self) -> list[str]:
        """A note for each cause that was not there before."""
        for cause, *found in self.own["cautions"][self._noted : self.own["causes"]] if hasattr(self, "own") else ():
            self._noted += 1
            self._notes.append(f"{type(self).__name__}: {caution(CAUSES[int(cause)], *map(float, found))}")
        return super().notes()

    def _apart(self) -> np.ndarray | None:
        """How far [m] (V,) each vertex of the basis is from another modulus; None where there is but one."""
        if self.surface == "fingertip" or not (self.nodule_radius > 0 or self.capsule_thickness > 0):
            return None
        vertices = self.coarse_mesh().vertices
        if self.capsule_thickness > 0:
            return np.zeros(len(vertices))
        away = np.linalg.norm(vertices - self.nodule_centre(), axis=1)
        return np.abs(away - self.nodule_radius)

    def nodule_centre(self) -> Vector3:
        """Of the nodule [m], in the surface's own frame, to `GRID`."""
        turn, origin = self._placing()
        x, y, z = (GRID * np.rint((self.centre() - origin) @ turn / GRID) + 0.0).tolist()  # no -0, which is another key
        return x, y, z

    def _placing(self) -> tuple[np.ndarray, np.ndarray]:
        return rotation_matrix(self.rotation), np.asarray(self.position, float)

    def _placed(self) -> tuple[Basis | SampledBasis, tuple[Mesh, float, float, float, float]]:
        """The basis at its place, and what else a body of it takes."""
        basis = self.basis()
        turn, origin = self._placing()
        vertices, count = product(basis.vertices, turn.T) + origin, len(basis.vertices)

        def turned(matrix: np.ndarray) -> np.ndarray:
            blocks = matrix.reshape(count, 3, count, 3)
            if self.rotation != LEVEL:
                blocks = np.einsum("aibk,lk->aibl", np.einsum("ij,ajbk->aibk", turn, blocks), turn)
            return np.ascontiguousarray(blocks.reshape(3 * count, -1), np.float32)

        given = (self.mesh(), self.young, self.retardation, self.radius, max(self.reach, 1.25 * self.radius))
        if isinstance(basis, SampledBasis):
            modes = np.einsum("ij,ajk->aik", turn, basis.modes.reshape(count, 3, -1)).reshape(3 * count, -1)
            residual = turned(basis.residual_compliance)
            return SampledBasis(vertices, basis.triangles, residual, modes, basis.points, basis.bend), given
        return Basis(vertices, basis.triangles, turned(basis.compliance)), given

    def coarse_mesh(self) -> Mesh:
        """The surface that the organ is condensed to, in its own frame."""
        return surface_mesh(self.surface, self.coarse, file_unit=self.file_unit)

    def inputs(self) -> dict[str, Any]:
        """All that the basis depends on."""
        inputs: dict[str, Any] = {"builder": basis_store.BUILDERS[self._kind()], "surface": _name(self.surface)}
        if self.model == "sampled":
            inputs["modes"] = self.modes
        if self.model != "sampled" or self.surface != "fingertip":
            inputs |= {"mesh": basis_store.digest(self.coarse_mesh()), "poisson": self.poisson, "bed": self.bed}
            if self.nodule_radius > 0:
                inputs |= {"nodule": [*self.nodule_centre(), self.nodule_radius, self.nodule_ratio]}
            if self.capsule_thickness > 0:
                inputs |= {"capsule": [self.capsule_thickness, self.capsule_ratio]}
        return inputs

    def key(self) -> str:
        """Hash under which the basis is stored."""
        return basis_store.key(self.inputs())

    def filename(self) -> str:
        """File name of the basis for these settings."""
        nodule = "-nodule" if self.nodule_radius > 0 else ""
        return f"{_name(self.surface)}{nodule}-{self._kind()}-{self.key()}.npz"

    def _kind(self) -> str:
        return "sampled" if self.model == "sampled" else "condensed"

    def command(self) -> str:
        """The command that builds it."""
        usual, read = ReducedFE(), BUILT_FROM + (NODULE if self.nodule_radius > 0 else ())
        given = [f"--set {n}={_text(getattr(self, n))}" for n in read if getattr(self, n) != getattr(usual, n)]
        return " ".join(["palpate build basis", *given])

    def basis(self) -> Basis | SampledBasis:
        """The stored basis. SettingError: none is stored for these settings, or it cannot be read, or is of another
        place or shape."""
        stored = self.stored(basis_store.SHIPPED, basis_store.cache())
        if stored is None:
            raise SettingError(
                "no reduced basis is stored for these settings of model, surface, poisson, bed, coarse, nodule, "
                f"capsule{self._nearest()}. Build it once: {self.command()}"
            )
        path, basis = stored
        away = basis_store.off(basis.vertices, self.coarse_mesh())
        if away > basis_store.NEAR:
            raise SettingError(
                f"{path}: its vertices lie up to {away:.2g} of the surface's extent off surface {self.surface!r}; "
                f"expected the same surface at the same place. Rebuild it: {self.command()} --force"
            )
        return basis

    def _nearest(self) -> str:
        """What the shipped basis of this surface and kind was made from that these settings are not."""
        wanted = self.inputs()
        for name, about in basis_store.shipped().items():
            made = about["inputs"]
            if made["surface"] == wanted["surface"] and ("modes" in made) == ("modes" in wanted):
                changes = basis_store.differences(made, wanted)
                more = f" and {len(changes) - 3} more" if len(changes) > 3 else ""
                return f"; of the shipped {name}, {'; '.join(changes[:3])}{more}"
        return ""

    def stored(self, *folders: Path) -> tuple[Path, Basis | SampledBasis] | None:
        """The basis for these settings in the first of the folders that holds one, and its path. SettingError: one that
        cannot be read."""
        for folder in folders:
            path = basis_store.find(folder, self.key())
            if path is not None:
                try:
                    if self.model == "sampled":
                        return path, SampledBasis.load(path)
                    return path, Basis.load(path)
                except ArchiveError as error:
                    raise SettingError(f"{error}, here: {self.command()} --force") from None
        return None


class _Sampled:
    """What is different where the body is a sampled one. It never rests quite: its modes fade for ever."""

    State = (
        SEVERAL
        | PRESSURE
        | {
            "body": form(SampledBody),
            "beyond": (),
            "cautions": (1, 4),
            "causes": int,
            "evaluations": int,
            "settled": bool,
        }
    )
    idle = None

    def _made(self: Any) -> Any:
        if self.area != "fixed":
            raise SettingError(f"setting 'area': found {self.area!r}, expected 'fixed' with model: sampled")
        return self._placed()

    def _make(self: Any, count: int) -> None:
        self._count = count
        make_room(self, count)
        basis, given = self._organ
        self.hold("body", sampled_body(basis, *given, contacts=count))

    @kernel(error_model="numpy")
    def compute(own, load: list[Load], out: Out[Surface], dt):
        body = _sampled_of(own.body)
        for i in range(load.count):
            each = nth(load, i)
            nodes, forces = integers(each.nodes), floats(each.forces)
            sampled.bear(body, i, nodes, forces, vector(each.foot), vector(each.normal))
        own.evaluations, own.settled = sampled.answer(body, floats(own.laws), floats(own.coupling), dt)
        own.beyond = sampled.extrapolation(body)
        count = sampled.displaced(body) if own.shape else 0
        send(own, load, count, out, dt)


@cache
def _sampled(kind: type[ReducedFE]) -> type[ReducedFE]:
    """A node class of the sampled model."""
    return (
        kind if issubclass(kind, _Sampled) else type(kind.__name__, (_Sampled, kind), {"__module__": kind.__module__})
    )


def _text(value: object) -> str:
    return "'[" + ", ".join(map(str, value)) + "]'" if isinstance(value, tuple) else str(value)


def _name(surface: str) -> str:
    """Of a built-in surface, or of a file without its folder and ending; what the file holds is in the mesh's hash."""
    return surface if surface in SURFACES else Path(surface).stem
