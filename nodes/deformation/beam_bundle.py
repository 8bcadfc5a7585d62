"""The deformable body as a foundation of viscoelastic beams below its surface."""

from typing import Annotated

import msgspec
import numpy as np

from palpate.compiler.exact import row_times
from palpate.compiler.fields import form
from palpate.compiler.records import floats, integers, lend_first, longs, nth, unpacking, vector
from palpate.messages import Load, Surface, Vector
from palpate.nodes.base import ARRAY, TABLE, Calibrated, Follows, Out, Part, SettingError, Switch
from palpate.nodes.base.contacts import NO_VERTEX, SEVERAL, MeshBody, make_room, send_laws, spread_laws, unknown_vertex
from palpate.nodes.base.felt import WIDTH, WithWidth, bearing
from palpate.nodes.base.kernels import ieee_kernel, kernel
from palpate.nodes.base.samples import oldest
from palpate.physics.bodies import beam_foundation as beams
from palpate.physics.bodies import spring_range
from palpate.physics.bodies.beam_foundation_step import held_force
from palpate.physics.bodies.between_bodies import NO_TANGENTS, BetweenBody, foundation_between
from palpate.physics.contact.organs.candidates import Shares
from palpate.physics.contact.spread import TABLES
from palpate.physics.materials.voigt import SKIN, TISSUE, ViscoelasticMaterial

OF_TISSUE = Calibrated("a human fingertip", "palpate fit body")


_bed_of = unpacking(beams.BeamFoundation)


class BeamBundle(MeshBody, WithWidth):
    """Beams of viscoelastic layers below each vertex of a surface (docs/equations/beam-bundle.md).

    Layers are listed from the surface inwards. The terminal law is that of the next implicit step. The pressure is the
    load of each node over its area. A nodule makes the beams above it stiffer. Contacts are coupled where their patches
    share beams.
    """

    effect = "deformation"
    rank = 2

    layers: Annotated[Vector, "m", OF_TISSUE] = (1e-3, 9e-3)  # Thickness of each layer
    moduli: Annotated[Vector, "Pa", OF_TISSUE] = (SKIN.modulus, TISSUE.modulus)
    relaxations: Annotated[Vector, "s", Switch("relaxation"), OF_TISSUE] = (SKIN.relaxation, TISSUE.relaxation)
    """Viscosity over modulus of each layer."""
    width: Annotated[float, "m", msgspec.Meta(ge=0.0, le=0.1), Follows(Load)] = WIDTH
    """Width of the widest finger on it: next to a gap only the side that this one touches bears load."""
    poisson: Annotated[float, "1", msgspec.Meta(gt=-1, le=0.5)] = TISSUE.poisson

    shape = Part(
        "shape", "nodes", "displacement", also=("pressure",), about="The vertices of the surface that are displaced."
    )
    pressure = Part("pressure", "pressure", about="The pressure on the displaced nodes; 0 while they recover.")
    State = SEVERAL | {
        "bed": form(beams.BeamFoundation), "feet": TABLE, "normals": TABLE,  # [m] and [1] (c,3) of the last step
        "facing": TABLE, "areas": ARRAY, "push": ARRAY, "pressures": ARRAY,  # normals [1], areas [m²]; work array; [Pa]
        "beyond": bool,  # whether an indentation exceeded the range
    }  # fmt: skip

    shared = "facing", "areas", "bed.beams", "bed.skin.edges", *(f"bed.spreader.{name}" for name in TABLES)

    def start(self) -> None:
        if not len(self.layers) == len(self.moduli) == len(self.relaxations) > 0:
            raise SettingError(
                f"layers, moduli, relaxations: found {len(self.layers)}, {len(self.moduli)}, {len(self.relaxations)} "
                f"numbers, expected one of each for every layer"
            )
        if min(self.layers) <= 0 or min(self.moduli) <= 0 or min(self.relaxations) < 0:
            raise SettingError(
                f"layers {self.layers} m, moduli {self.moduli} Pa, relaxations {self.relaxations} s: "
                f"expected thicknesses and moduli > 0, relaxations >= 0"
            )
        if self.area != "fixed":
            raise SettingError(f"setting 'area': found {self.area!r}, expected 'fixed': the beams find their contact")
        mesh, whole = self.mesh(), self.whole()
        thickness = float(np.ptp(whole.vertices, axis=0).min())
        if whole.closed and sum(self.layers) > thickness:
            raise SettingError(
                f"layers: found {sum(self.layers) * 1e3:g} mm in all, the body is {thickness * 1e3:.1f} mm thick: its "
                f"beams would end beyond the other side. Set thinner tissue.layers"
            )
        super().start()
        self._hold_bed(self.foundation())
        self.hold("facing", self._bed.beams.normals)
        self.hold("areas", self._sections())
        self.hold("push", np.zeros(len(mesh.areas)))
        self.hold("pressures", np.zeros(len(mesh.areas)))

    def resize(self, counts: list[int]) -> None:
        count = counts[0]
        if count != len(self._bed.contacts.forces):
            self._hold_bed(self._bed._replace(contacts=beams.foundation_contacts(count, len(self._bed.beams.areas))))

    def _hold_bed(self, bed: beams.BeamFoundation) -> None:
        self._bed = bed
        make_room(self, len(bed.contacts.forces))
        self.hold("laws", bed.contacts.laws)
        self.hold("coupling", bed.contacts.coupling)
        self.hold("bed", bed)
        for name in ("feet", "normals"):
            self.hold(name, np.full((len(bed.contacts.forces), 3), np.nan))

    def foundation(self, thicker: float = 1.0, slower: float = 1.0, contacts: int = 1) -> beams.BeamFoundation:
        """The beams at rest.

        thicker  factor on thicknesses and moduli, which keeps the compliance
        slower   factor on relaxation times
        """
        layers = tuple(thicker * layer for layer in self.layers)
        materials = tuple(
            ViscoelasticMaterial(thicker * modulus, slower * relaxation, self.poisson)
            for modulus, relaxation in zip(self.moduli, self.relaxations, strict=True)
        )
        part = bearing(self, self.width)
        return beams.beam_foundation(self.mesh(), self.hardness(), layers, materials, self.radius, contacts, part)

    def _sections(self) -> np.ndarray:
        """The area [m²] (V) of the surface that each beam bears."""
        mesh, part = self.mesh(), bearing(self, self.width)
        return np.ascontiguousarray(mesh.areas if part is None else part.sections(mesh))

    def between(
        self,
        size: int,
        shares: Shares,
        normal: np.ndarray,
        area: np.ndarray,
        tangents: np.ndarray = NO_TANGENTS,
    ) -> BetweenBody:
        """The body for its contact with another, see `physics.bodies.between_bodies`: beams along their axes, with the
        mean retardation of the layers, weighted with their compliances."""
        soft = np.asarray(self.layers) / np.asarray(self.moduli)
        beam = self.foundation().beams
        softness = beam.static * beam.length / self.hardness()
        mean = float((soft * np.asarray(self.relaxations)).sum() / soft.sum())
        return foundation_between(softness, self._sections(), shares, normal, area, mean, tangents)

    @kernel
    def idle(own, load, out, dt):
        if longs(own.bed.moving.sent)[0] > 0 or out.delayed != oldest(load):
            return False
        for i in range(load.count):
            each, foot, normal = nth(load, i), floats(own.feet)[i], floats(own.normals)[i]
            if each.nodes.shape[0] > 0 or each.whole.shape[0] > 0:
                return False
            for k in range(3):
                if foot[k] != each.foot[k] or normal[k] != each.normal[k]:
                    return False
        return True

    @ieee_kernel
    def compute(own, load: list[Load], out: Out[Surface], dt):
        bed, feet, normals = _bed_of(own.bed), floats(own.feet), floats(own.normals)
        if dt > 0.0:
            if unknown_vertex(load, len(bed.beams.areas)):
                own.fault = NO_VERTEX
                return
            for i in range(load.count):
                each = nth(load, i)
                beams.bear(bed, i, integers(each.nodes), floats(each.forces), vector(each.foot), vector(each.normal))
            beams.answer(bed, dt)
            spread_laws(own, load)
            for i in range(load.count):
                depth = bed.contacts.laws[i, 4]
                if depth > own.radius and not own.beyond:
                    each, total = nth(load, i), bed.contacts.forces[i]
                    given = integers(each.nodes), floats(each.forces), vector(each.normal), total
                    own.beyond = spring_range.too_deep(depth, bed.beams.vertices, *given)
        for i in range(load.count):
            each = nth(load, i)
            for k in range(3):
                feet[i, k], normals[i, k] = each.foot[k], each.normal[k]
        send_laws(own, out)
        out.delayed = oldest(load)
        out.step, out.relaxation, out.limited = dt, beams.relaxation(bed.beams, dt), bed.moving.sent[1]
        if not own.shape:
            return
        count = bed.moving.sent[0]
        lend_first(out.nodes, own.bed.moving.nodes, count)
        lend_first(out.displacement, own.bed.moving.moved, count)
        if own.pressure:
            push, pressures = floats(own.push), floats(own.pressures)
            facing, areas = floats(own.facing), floats(own.areas)
            for i in range(load.count):
                each = nth(load, i)
                nodes, forces = integers(each.nodes), floats(each.forces)
                for k in range(len(nodes)):
                    held = (held_force(forces[k, 0]), held_force(forces[k, 1]), held_force(forces[k, 2]))
                    push[nodes[k]] -= row_times(held, facing[nodes[k]])
            for k in range(count):
                j = bed.moving.nodes[k]
                pressures[k] = max(push[j], 0.0) / areas[j]
            for i in range(load.count):
                for j in integers(nth(load, i).nodes):
                    push[j] = 0.0
            lend_first(out.pressure, own.pressures, count)

    def notes(self) -> list[str]:
        """A note if the indentation exceeds the range of the foundation."""
        if self.known["beyond"]:
            self._note_once(f"{type(self).__name__}: {spring_range.deep_note()}")
        return super().notes()
