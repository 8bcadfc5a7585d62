"""The reduced finite-element body (docs/equations/reduced-fe.md)."""

import shlex
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np

from palpate.compiler.entry_point import NO_FLOATS
from palpate.compiler.exact import einsum, exp
from palpate.compiler.fields import form
from palpate.compiler.records import floats, integers, nth, one, unpacking, vector
from palpate.messages import Load, Surface, Vector3
from palpate.nodes.base import Agrees, Out, Part, SettingError, Switch
from palpate.nodes.base.contacts import NO_VERTEX, SEVERAL, MeshBody, make_room, spread_laws, unknown_vertex
from palpate.nodes.base.felt import has_gaps
from palpate.nodes.base.kernels import ieee_kernel, kernel
from palpate.nodes.base.node import once_per_class
from palpate.nodes.base.samples import oldest
from palpate.nodes.base.surface import LEVEL, SURFACES, rotation_matrix, surface_mesh
from palpate.nodes.deformation import basis_store
from palpate.nodes.deformation.reduced_answer import PRESSURE, along_the_surface, caution_once, send
from palpate.physics.archive import ArchiveError
from palpate.physics.bodies import condensed_body as condensed
from palpate.physics.bodies import sampled_body as sampled
from palpate.physics.bodies.between_bodies import NO_TANGENTS, BetweenBody, condensed_between
from palpate.physics.bodies.condensed_basis import Basis, OrderedBasis
from palpate.physics.bodies.condensed_body import CondensedBody, Start, condensed_body, under
from palpate.physics.bodies.half_space_range import CAUSES, caution
from palpate.physics.bodies.large_displacement import nonlinearity
from palpate.physics.bodies.place_energy import softness
from palpate.physics.bodies.sampled_body import SampledBasis, SampledBody, sampled_body
from palpate.physics.bodies.true_patch import MEAN
from palpate.physics.contact.end_rate import arrive
from palpate.physics.contact.organs.candidates import Shares
from palpate.physics.contact.spread import TABLES
from palpate.physics.geometry.mesh import Mesh

BUILT_FROM = (
    "model", "modes", "surface", "file_unit", "piece", "poisson", "bed", "walls", "coarse", "capsule_thickness",
    "capsule_ratio", "bone_shape",
)  # fmt: skip
"""Settings that the basis depends on."""
LAYERED = ("poisson", "bed", "coarse", "capsule_thickness", "nodule_radius", "bone_shape")
"""Settings of a homogeneous organ, which the stored layers of the fingertip replace."""
NODULE = ("vertices", "position", "rotation", "nodule_position", "nodule_depth", "nodule_radius", "nodule_ratio",
          "nodule_shape")  # fmt: skip
"""Settings that define a nodule."""
GRID = 1e-6
"""[m] Rounding of a nodule's position, since equal positions in the world differ by rounding in the surface's frame."""


_condensed_of, _sampled_of = unpacking(CondensedBody), unpacking(SampledBody)


class ReducedFE(MeshBody):
    """A finite-element organ on an elastic foundation, condensed to its surface, corrected for large displacement.

    Optionally with a hard nodule and a stiffer capsule. `palpate build basis` builds its basis once for a surface,
    Poisson's ratio, foundation (`bed`), nodule and capsule; the basis of the default kidney is shipped. Changes of
    modulus and retardation time need no new basis. The fingertip has layers: its `young` is that of the subcutis at
    rest, 160 Pa in the set cortical/36.4; it refuses poisson, `bed`, nodule and capsule.
    """

    effect = "deformation"
    rank = 3

    model: Annotated[Literal["nonlinear", "linear", "sampled"], "1"] = "nonlinear"
    """Large displacement: "nonlinear" uses the law of a half-space under the patch, "linear" neglects it, "sampled"
    uses modes of the whole body with sampled energy, for the fingertip."""
    modes: Annotated[int, "1", msgspec.Meta(ge=4, le=200)] = 80  # Of the sampled model
    young: Annotated[float, "Pa", msgspec.Meta(ge=10, le=1e9)] = 19e3
    poisson: Annotated[float, "1", msgspec.Meta(ge=0, lt=0.5)] = 0.45
    retardation: Annotated[float, "s", msgspec.Meta(ge=0), Switch("relaxation")] = 0.02
    """Kelvin-Voigt: viscosity over modulus."""
    second_order: Annotated[bool, "1", Agrees(Surface)] = False
    """Whether the viscosity uses the rate at the end of a step, as fast taps need, instead of its mean rate. Then a
    whole motion dissipates energy, but a single step may return some nJ. Set it for the contact too.
    The sampled model ignores it."""
    bed: Annotated[float, "1/m", msgspec.Meta(gt=0)] = 50.0
    """Stiffness per area of the elastic foundation below the organ, over `young`."""
    walls: Annotated[float, "m", msgspec.Meta(ge=0, le=5e-3)] = 1e-3
    """Walls of the surface of a file that are nearer to each other, as those of a cut, push on each other as if they
    touched, without friction; 0: they are free."""
    capsule_thickness: Annotated[float, "m", msgspec.Meta(ge=0)] = 0.0
    """Of a capsule of another modulus; 0: a homogeneous organ."""
    capsule_ratio: Annotated[float, "1", msgspec.Meta(gt=0)] = 10.0  # Modulus of the capsule over that of the organ
    sticks: Annotated[bool, "1"] = True
    """Whether the surface under the patch sticks to the finger. If not, it slides freely, which is valid for light
    loads (heavier ones are reported). The sampled model ignores it."""
    coarse: Annotated[int, "1", msgspec.Meta(ge=50, le=2000)] = 600
    """Approximate number of vertices of the condensed surface. At the default, a file gets more, up to 1500, if its
    edges would exceed 8 mm. A file with at most 1.25 times as many keeps its vertices."""
    reach: Annotated[float, "m", msgspec.Meta(gt=0)] = 10e-3
    """Distance from the foot point within which the displacement of every vertex is sent; of fewer vertices beyond."""

    organ_loads: Annotated[int, "1", msgspec.Meta(ge=0, le=16)] = 0
    """Number of loads of other organs, the last ones, which act on the linear organ; determined when the graph is
    loaded."""

    energy = Part("energy", "stored", about="The energy stored in the condensed organ; not for the sampled model.")
    shape = Part(
        "shape", "nodes", "displacement",
        about="Vertices of the surface, all within reach and fewer beyond, and their displacement [m].",
    )  # fmt: skip
    pressure = Part(
        "pressure", "pressure",
        about="Pressure of the loads on the sent vertices [Pa]: normal component over the area of the vertex.",
    )  # fmt: skip
    slope = Part(
        "slope", "tangential_gradient", "shape_operator",
        about="The change of the body's energy along its surface, whose force points towards softer tissue.",
    )  # fmt: skip
    State = (
        SEVERAL | PRESSURE | {"body": form(CondensedBody), "beyond": (), "cautions": (len(CAUSES), 4), "causes": int}
    )
    """Extrapolation of the last step beyond the range of the model; for each cause so far its index, the extrapolation,
    and the radius [m] of the load, nominal and on the coarse surface; number of causes."""
    shared = (
        "areas", "body.model", "body.ground", "body.fine.reach", *(f"body.fine.spreader.{name}" for name in TABLES)
    )  # fmt: skip

    conditions = {"beyond": "outside its range"}

    def __new__(cls, **given: Any) -> "ReducedFE":
        sampled = given.get("model", cls.model) == "sampled"
        return super().__new__(_sampled_class(cls) if sampled else cls)

    def start(self) -> None:
        super().start()
        modulus = self.young / (1.0 - self.poisson**2)
        if self.area in ("ball", "fingertip") and not 0.98 < modulus / self.area_modulus < 1.02:
            found = f"area_modulus is {self.area_modulus:.4g} Pa, expected {modulus:.4g} Pa, E/(1 - nu²) of this body"
            self._notes.append(f"ReducedFE: {found}: the area law is that of another tissue")
        mesh = self.mesh()
        self.hold("areas", np.ascontiguousarray(mesh.areas))
        self.hold("push", np.zeros(len(mesh.vertices)))
        self.hold("pressures", np.zeros(len(mesh.vertices)))
        self._organ = self._make_shared()
        self._remark()
        self._make(self._count)

    def check(self) -> None:
        self.basis()

    def bases(self) -> list["ReducedFE"]:
        """The bodies whose bases this node reads."""
        return [self]

    _count = 1  # of contacts; kept over a start, so that their arrays exist before the first step

    def resize(self, counts: list[int]) -> None:
        if counts[0] != self._count:
            self._make(counts[0])

    def _make(self, count: int) -> None:
        self._count = count
        make_room(self, count)
        model, ground, fine = self._organ[:3]
        body = under(model, ground, fine, count)
        self.hold("body", body)
        self.hold("coupling", body.coupling)

    def _make_shared(self, basis: Basis | None = None) -> Any:
        """The part of the body that is independent of the number of contacts."""
        placed, given = self._place_basis(basis)
        assert isinstance(placed, Basis)  # `_sampled_class` has its `_make_shared`
        large = self.model == "nonlinear" and self.sticks  # a sliding surface is only valid under light loads
        rho = nonlinearity(self.poisson) if large else NO_FLOATS
        law = (self.poisson, self.sticks, self._apart((basis or self.basis()).vertices), rho, self.area_law())
        gaps = has_gaps(self, 2.0 * self.radius)
        return condensed_body(placed, *given, *law, start=self._start(placed, given), remembers=gaps)

    def between(
        self,
        size: int,
        shares: Shares,
        normal: np.ndarray,
        area: np.ndarray,
        tangents: np.ndarray = NO_TANGENTS,
    ) -> BetweenBody:
        """The body for its contact with another, see `physics.bodies.between_bodies`; large displacement is left out.
        SettingError: model: sampled, or an area law."""
        if self.model == "sampled" or self.area != "fixed":
            raise SettingError(
                f"model {self.model}, area {self.area}: the contact with another organ takes model nonlinear or "
                "linear, and area fixed"
            )
        return condensed_between(self._make_shared()[0], shares, normal, area, tangents)

    def start_key(self, basis: Basis, given: tuple[Mesh, float, float, float, float]) -> str:
        """Key of the results of a start. They depend neither on the modulus nor on the retardation time."""
        mesh, _, _, radius, _ = given
        surfaces = (basis.vertices, basis.triangles, basis.compliance, mesh.vertices, mesh.triangles)
        return basis_store.start_key(*surfaces, radius, self.poisson, self.sticks, self._apart(self.basis().vertices))

    def _start(self, basis: Basis, given: tuple[Mesh, float, float, float, float]) -> Start | None:
        """The stored results for a shipped basis at its place in the scene."""
        path = basis_store.find(basis_store.SHIPPED, self.key())
        return basis_store.start(path, self.start_key(basis, given)) if path is not None else None

    @kernel
    def idle(own, load, out, dt):
        body = _condensed_of(own.body)
        for i in range(load.count):
            each = nth(load, i)
            if each.nodes.shape[0] > 0 or each.whole.shape[0] > 0:
                return False
            for k in range(3):
                if body.feet[i, k] != each.foot[k] or body.normals[i, k] != each.normal[k]:
                    return False
        return out.delayed == oldest(load) and condensed.is_still(body)

    @ieee_kernel
    def compute(own, load: list[Load], out: Out[Surface], dt):
        body = _condensed_of(own.body)
        if unknown_vertex(load, len(body.fine.nodes)):
            own.fault = NO_VERTEX
            return
        for i in range(load.count):
            each = nth(load, i)
            nodes, forces = integers(each.nodes), floats(each.forces)
            arrive(body.contacts[i].course, each.tick if own.second_order else -1)
            body.contacts[i].organ = i >= load.count - own.organ_loads
            condensed.bear(body, i, nodes, forces, vector(each.foot), vector(each.normal), dt)
        condensed.answer(body, floats(own.laws), dt)
        spread_laws(own, load)
        own.beyond = condensed.extrapolation(body)
        if own.beyond > 0.0:
            caution_once(own, body.contacts)
        if own.slope:
            along_the_surface(own, body, load, out)
        if own.energy:
            one(out.stored, condensed.patch_energy(body))
        count = condensed.displace_fine(body) if own.shape else 0
        send(own, load, count, out, dt)

    def notes(self) -> list[str]:
        """A note for each new cause of extrapolation."""
        for cause, *found in self.known["cautions"][: self.known["causes"]]:
            self._note_once(f"{type(self).__name__}: {caution(CAUSES[int(cause)], *map(float, found))}")
        return super().notes()

    def _apart(self, vertices: np.ndarray) -> np.ndarray | None:
        """Distance [m] (V,) of each of the basis's vertices [m] (V,3) to the nearest change of modulus; None:
        homogeneous."""
        if self.surface == "fingertip" or not (self.nodule_radius > 0 or self.capsule_thickness > 0):
            return None
        if self.capsule_thickness > 0:
            return np.zeros(len(vertices))
        if self.nodule_shape:
            return self.region().border_distance(vertices)
        away = np.linalg.norm(vertices - self.nodule_centre(), axis=1)
        return np.abs(away - self.nodule_radius)

    def nodule_centre(self) -> Vector3:
        """Centre of the nodule [m], in the frame of the surface, rounded to `GRID`."""
        return self.in_its_frame(self.centre())

    def in_its_frame(self, place: np.ndarray) -> Vector3:
        """A place in the world [m] (3) in the frame of the surface, rounded to `GRID`."""
        turn, origin = self._placing()
        x, y, z = (GRID * np.rint(einsum("k,kj->j", place - origin, turn) / GRID) + 0.0).tolist()  # no -0, another key
        return x, y, z

    def _placing(self) -> tuple[np.ndarray, np.ndarray]:
        return rotation_matrix(self.rotation), np.asarray(self.position, float)

    def _place_basis(
        self, basis: Basis | SampledBasis | None = None
    ) -> tuple[Basis | SampledBasis, tuple[Mesh, float, float, float, float]]:
        """The stored basis, or the given one, at its position in the world, and the other arguments of its body."""
        basis = basis or self.basis()
        turn, origin = self._placing()
        vertices, count = einsum("ik,jk->ij", basis.vertices, turn) + origin, len(basis.vertices)

        def turn_matrix(matrix: np.ndarray) -> np.ndarray:
            blocks = matrix.reshape(count, 3, count, 3)
            if self.rotation != LEVEL:
                blocks = einsum("aibk,lk->aibl", einsum("ij,ajbk->aibk", turn, blocks), turn)
            return np.ascontiguousarray(blocks.reshape(3 * count, -1), np.float32)

        given = (self.mesh(), self.young, self.retardation, self.radius, max(self.reach, 1.25 * self.radius))
        if isinstance(basis, SampledBasis):
            modes = einsum("ij,ajk->aik", turn, basis.modes.reshape(count, 3, -1)).reshape(3 * count, -1)
            residual = turn_matrix(basis.residual_compliance)
            return SampledBasis(vertices, basis.triangles, residual, modes, basis.points, basis.bend), given
        return Basis(vertices, basis.triangles, turn_matrix(basis.compliance)), given

    def stiffness_field(self, basis: Basis | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Stiffness [1] (V) under a patch of `radius` round each vertex of the surface, over that of a half-space; and
        the indentation by a force along the surface, over that by an equal normal force [1] (V,3).
        `basis`: instead of the stored one. SettingError: that is missing."""
        body, triangles = self._make_shared(basis), self._place_basis(basis)[0].triangles
        model, true = body.model, body.model.true
        soft, sideways, _ = softness(Mesh(model.vertices, triangles), model, body.fine.spreader)
        compliance = exp((model.weights * soft[model.corners]).sum(axis=1))
        stiff = (1.0 - true.held) * true.normal * MEAN / self.radius / compliance
        return stiff, einsum("wa,wai->wi", model.weights, sideways[model.corners])

    def coarse_mesh(self) -> Mesh:
        """The surface to which the organ is condensed, in its frame; of a file before `reduced_count` applies."""
        return surface_mesh(self.surface, self.coarse, file_unit=self.file_unit, piece=self.piece, refine=0.0)

    def reduced_count(self) -> int | None:
        """Number of vertices to which the surface of a file is reduced; None: the basis has those of the surface."""
        if self.surface in SURFACES:
            return None
        mesh, wanted = self.coarse_mesh(), self.coarse
        if wanted == ReducedFE.coarse:  # not set
            even = float(mesh.areas.sum()) / (0.5 * np.sqrt(3.0) * basis_store.EDGE**2)
            wanted = int(np.clip(10 * round(even / 10), wanted, basis_store.MOST_REDUCED))
        return wanted if len(mesh.vertices) > basis_store.KEPT * wanted else None

    def near_walls(self) -> float:
        """The setting `walls` [m]; 0 for a built-in surface, which has none that are near."""
        return 0.0 if self.surface in SURFACES else self.walls

    def inputs(self) -> dict[str, Any]:
        """All inputs of the basis."""
        inputs: dict[str, Any] = {"builder": basis_store.BUILDERS[self._kind()], "surface": _name(self.surface)}
        if self.model == "sampled":
            inputs["modes"] = self.modes
        if self.model != "sampled" or self.surface != "fingertip":
            inputs |= {"mesh": basis_store.digest(self.coarse_mesh()), "poisson": self.poisson, "bed": self.bed}
            if (reduced := self.reduced_count()) is not None:
                inputs["coarse"] = reduced
            if self.surface not in SURFACES:
                inputs["walls"] = self.near_walls()
            if self.nodule_radius > 0 and self.nodule_shape:
                inputs |= {"nodule": [basis_store.start_key(*self.region()), self.nodule_ratio]}
            elif self.nodule_radius > 0:
                inputs |= {"nodule": [*self.nodule_centre(), self.nodule_radius, self.nodule_ratio]}
            if self.bone_shape:
                inputs |= {"bone": basis_store.start_key(*self.bone())}
            if self.capsule_thickness > 0:
                inputs |= {"capsule": [self.capsule_thickness, self.capsule_ratio]}
        return inputs

    def key(self) -> str:
        """Key of the basis."""
        return basis_store.key(self.inputs())

    def filename(self) -> str:
        """File name of the basis for these settings."""
        nodule = "-nodule" if self.nodule_radius > 0 else ""
        return f"{_name(self.surface)}{nodule}-{self._kind()}-{self.key()}.npz"

    def _kind(self) -> str:
        return "sampled" if self.model == "sampled" else "condensed"

    def command(self) -> str:
        """The command that builds the basis."""
        usual, read = ReducedFE(), BUILT_FROM + (NODULE if self.nodule_radius > 0 else ())
        given = [
            f"--set {shlex.quote(f'{n}={_text(value)}')}"
            for n in read
            if (value := getattr(self, n)) != getattr(usual, n)
        ]
        return " ".join(["palpate build basis", *given])

    def basis(self) -> Basis | SampledBasis:
        """The stored basis. SettingError: it is missing or unreadable, or has another position or shape."""
        stored = self.find_stored(basis_store.SHIPPED, basis_store.cache())
        if stored is None:
            raise SettingError(
                "no reduced basis is stored for these settings of model, surface, poisson, bed, coarse, nodule, "
                f"capsule{self._nearest()}. Build it once: {self.command()}"
            )
        path, basis = stored
        self._path = path
        listed = basis.listed if isinstance(basis, OrderedBasis) else basis.vertices
        away = basis_store.off(listed, self.coarse_mesh(), self.reduced_count() is not None)
        if away > basis_store.NEAR:
            raise SettingError(
                f"{path}: its vertices are up to {away:.2g} of the surface's extent off surface {self.surface!r}; "
                f"expected the same surface at the same position. Rebuild it: {self.command()} --force"
            )
        return basis

    def _remark(self) -> None:
        """Note the error of the basis of a file."""
        error = (basis_store.about(self._path) or {}).get("error") or {}
        if self.model != "sampled" and {"mean", "worst", "vertices"} <= error.keys():
            at = [f"{1e3 * error[x]:.4g}" for x in "xyz" if x in error]  # older bases do not have it
            where = f", near ({', '.join(at)}) mm in the file" if at else ""
            self._note_once(
                f"ReducedFE: the basis of {_name(self.surface)} has {error['vertices']:.0f} vertices. Estimated error "
                f"of the stiffness under a patch of {1e3 * self.radius:.3g} mm, from a basis of half as many: "
                f"{error['mean']:.1%} on average, {error['worst']:.1%} at the worst place{where}"
            )

    def _nearest(self) -> str:
        """The differences of these settings from the inputs of the shipped basis of this surface and kind."""
        wanted = self.inputs()
        for name, about in basis_store.shipped_bases().items():
            made = about["inputs"]
            if made["surface"] == wanted["surface"] and ("modes" in made) == ("modes" in wanted):
                changes = basis_store.differences(made, wanted)
                more = f" and {len(changes) - 3} more" if len(changes) > 3 else ""
                return f"; of the shipped {name}, {'; '.join(changes[:3])}{more}"
        return ""

    def find_stored(self, *folders: Path) -> tuple[Path, Basis | SampledBasis] | None:
        """Path and basis for these settings in the first folder that contains one. SettingError: it is unreadable."""
        for folder in folders:
            path = basis_store.find(folder, self.key())
            if path is not None:
                try:
                    if self.model == "sampled":
                        return path, basis_store.load(SampledBasis, path)
                    built_in = self.surface in SURFACES  # its meshes are in an order in which neighbours are near
                    return path, basis_store.load(Basis if built_in else OrderedBasis, path)
                except ArchiveError as error:
                    raise SettingError(f"{error}, here: {self.command()} --force") from None
        return None


class _Sampled:
    """Overrides for the sampled model. It has no `idle`: its modes decay exponentially and never reach rest."""

    State = ReducedFE.State | {"body": form(SampledBody), "cautions": (1, 4), "evaluations": int, "settled": bool}
    idle = None

    def _make_shared(self: Any, basis: Any = None) -> Any:
        if self.area != "fixed":
            raise SettingError(f"setting 'area': found {self.area!r}, expected 'fixed' with model: sampled")
        if self.surface == "fingertip":
            for name in LAYERED:
                if (given := getattr(self, name)) != (usual := getattr(ReducedFE, name)):
                    raise SettingError(
                        f"setting {name!r}: found {given!r}, expected {usual!r}, the default: model: sampled takes the "
                        "layers of the surface fingertip from its basis"
                    )
        return self._place_basis(basis)

    def _make(self: Any, count: int) -> None:
        self._count = count
        make_room(self, count)
        basis, (mesh, young, retardation, radius, reach) = self._organ
        self.hold("body", sampled_body(basis, mesh, young, retardation, radius, reach, count))

    @ieee_kernel
    def compute(own, load: list[Load], out: Out[Surface], dt):
        body = _sampled_of(own.body)
        if unknown_vertex(load, len(body.fine.nodes)):
            own.fault = NO_VERTEX
            return
        for i in range(load.count):
            each = nth(load, i)
            nodes, forces = integers(each.nodes), floats(each.forces)
            sampled.bear(body, i, nodes, forces, vector(each.foot), vector(each.normal))
        own.evaluations, own.settled = sampled.answer(body, floats(own.laws), floats(own.coupling), dt)
        own.beyond = sampled.extrapolation(body)
        count = sampled.displace_fine(body) if own.shape else 0
        send(own, load, count, out, dt)


@once_per_class
def _sampled_class(kind: type[ReducedFE]) -> type[ReducedFE]:
    """The node class of the sampled model."""
    return (
        kind if issubclass(kind, _Sampled) else type(kind.__name__, (_Sampled, kind), {"__module__": kind.__module__})
    )


def _text(value: object) -> str:
    return "[" + ", ".join(map(str, value)) + "]" if isinstance(value, tuple) else str(value)


def _name(surface: str) -> str:
    """Name of a built-in surface, or of a file without folder and extension; its content enters through the mesh."""
    return surface if surface in SURFACES else Path(surface).stem
