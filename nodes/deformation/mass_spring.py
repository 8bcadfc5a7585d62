"""The mass-spring body (docs/equations/mass-spring.md)."""

from collections.abc import Sequence
from typing import Annotated, Literal

import msgspec
import numpy as np

from palpate.compiler.exact import exp, log, row_times
from palpate.compiler.fields import blank_record, element_type, form
from palpate.compiler.records import array_of, floats, integers, lend_first, nth, one, put, unpacking, vector
from palpate.messages import Load, Surface, Vector3
from palpate.messages.fields import Vector
from palpate.nodes.base import ARRAY, TABLE, Agrees, Out, Part, SettingError, Switch
from palpate.nodes.base.contacts import NO_VERTEX, SEVERAL, MeshBody, make_room, send_laws, unknown_vertex
from palpate.nodes.base.kernels import ieee_kernel, kernel
from palpate.nodes.base.measured_map import measured_factor, read_map
from palpate.nodes.base.samples import oldest
from palpate.nodes.deformation.reduced_fe import ReducedFE
from palpate.physics.bodies import mass_spring as springs
from palpate.physics.bodies import spring_range
from palpate.physics.bodies.between_bodies import NO_TANGENTS, BetweenBody, foundation_between
from palpate.physics.bodies.large_displacement import DEEPEST
from palpate.physics.bodies.place_energy import surface_gradient
from palpate.physics.contact import end_rate
from palpate.physics.contact.organs.candidates import Shares
from palpate.physics.contact.terminal import indentation
from palpate.physics.nearest import nearest, tree_of

NotNegative = msgspec.Meta(ge=0)
MORE = 1.1  # [1] Distance of a vertex from a foot over the radius of its patch, within which it may be loaded

_body_of = unpacking(springs.NodalBody)
_courses_of, _ground_of = array_of(element_type(end_rate.COURSE)), array_of(springs.GROUND)


@ieee_kernel
def couple(own, load):
    """The normal force of each contact, and the coupling of contacts whose patches overlap."""
    coupling, forces = floats(own.coupling), floats(own.forces)
    for i in range(load.count):
        each = nth(load, i)
        forces[i] = springs.normal_force(floats(each.forces), vector(each.normal))
        for j in range(i + 1 if load.count > 1 else 0):
            other = nth(load, j)
            coupling[i, j] = springs.shared_load(each.foot, other.foot, each.normal, other.normal, own.radius)
            coupling[j, i] = coupling[i, j]


@ieee_kernel
def local_factor(own, each, last, slope):
    """Factor on K [1] under a load, and with a map the force [N] that its part along the surface adds; fills `slope`
    (12), a row of `slopes`. `last`: the factor of the last step, which stays where the load has no vertex."""
    nodes, forces, normal = integers(each.nodes), floats(each.forces), vector(each.normal)
    if own.ground.shape[0] > 0:
        foot, ground = vector(each.foot), _ground_of(own.ground)
        factor = springs.factor_at(nodes, foot, normal, ground, own.radius, slope)
        side = springs.side_force(nodes, forces, foot, normal, ground, own.radius)
        return factor if factor > 0.0 else last, side
    if own.hard.shape[0] > 0 and each.nodes.shape[0] > 0:
        return springs.mean_hardness(nodes, forces, normal, floats(own.hard)), 0.0
    return last, 0.0


@ieee_kernel
def note_limits(own, each, s, pressed, trail, dt):
    """Note a load that indents too deep or moves too fast, and an indentation s [m] beyond the thickness of the organ.
    trail [m] (3): the last foot of the contact (`spring_range.too_fast`)"""
    if pressed:
        if s > DEEPEST * own.radius:
            own.beyond |= spring_range.DEEP_NOTE
        if own.retardation > 0.0 and spring_range.too_fast(each.foot, trail, own.retardation, own.radius, dt):
            own.beyond |= spring_range.FAST_NOTE
    else:
        trail[:] = np.nan
    if s > own.thinnest and each.nodes.shape[0] > 0:
        thick = floats(own.thick)[integers(each.nodes)[0]]
        own.excess = max(own.excess, s / thick - 1.0)
        if own.excess > own.deepest[0]:
            own.deepest[0], own.deepest[1] = own.excess, thick


class MassSpring(MeshBody):
    """Nodes on springs and dampers in the zone of influence of the contact.

    The total normal force determines one indentation s by the law K <s + tau s'>^n <1 + c s'>. In an implicit step this
    is a terminal law, so contact and body together solve the same equations as a single solver. The nodal law
    determines the surface. Use n = 1 and tau for a solid under a patch of fixed width, n = 1.5 for a ball on a solid.

    Contacts with overlapping patches are coupled: F_i + sum_j O_ij F_j determines s_i, where O falls from 1 at distance
    0 to 0 at twice the patch radius. The displacement of the surface is the deepest of all contacts.
    """

    effect = "deformation"
    rank = 1
    touching = {"exponent": 1.0, "damping": 0.0}
    """Settings for a contact with another organ, which is linear; the loader checks them."""

    stiffness: Annotated[float, "N/m^n", msgspec.Meta(gt=0)] = 3.0e3
    exponent: Annotated[float, "1", msgspec.Meta(ge=1, le=3)] = 1.5
    damping: Annotated[float, "s/m", NotNegative, Switch("relaxation")] = 5.0
    retardation: Annotated[float, "s", NotNegative, Switch("relaxation")] = 0.0
    """Kelvin-Voigt: viscosity over modulus."""
    second_order: Annotated[bool, "1", Agrees(Surface)] = False
    """Whether the retardation uses the rate at the end of a step, as fast taps need, instead of its mean rate. Then a
    whole motion dissipates energy, but a single step may return some nJ. Set it for the contact too."""
    tangential_stiffness: Annotated[float, "N/m", msgspec.Meta(gt=0)] = 300.0
    tangential_damping: Annotated[float, "N s/m", NotNegative] = 3.0
    stiffness_map: Annotated[Literal["uniform", "basis"], "1"] = "uniform"
    """With "basis" K varies over the surface like the stiffness of deformation.ReducedFE, from its stored basis
    without nodule, and a force along the surface indents too, as it does on a slanted or narrow part of an organ. K is
    then the stiffness on a half-space, and the finger is pushed towards softer places."""

    measured_map: Annotated[str, "1"] = ""
    """File of `palpate fit map`, whose factor multiplies K at the places that it covers."""
    map_factors: Annotated[Vector, "1"] = ()
    """Factors of the places of `measured_map`, in its order, instead of those of its file; so they can vary, be fitted,
    and have derivatives (docs/backwards.md)."""

    energy = Part(
        "energy", "stored",
        about="The energy of the law of the normal force, K s^(n+1)/(n+1), summed over the contacts.",
    )  # fmt: skip
    shape = Part(
        "shape", "nodes", "displacement",
        about="The displaced vertices of the surface and their displacement [m], under the forces of all contacts.",
    )  # fmt: skip
    State = SEVERAL | {
        "body": form(springs.NodalBody), "hard": ARRAY, "ground": ARRAY, "forces": ARRAY, "acting": ARRAY,
        "factors": ARRAY, "courses": ARRAY, "trails": TABLE, "beyond": int, "thick": ARRAY,
        "thinnest": (), "excess": (), "deepest": (2,),
    }  # fmt: skip
    """The nodal law; factor on K of each vertex, if there is a nodule or map; with a map its `GROUND`; of
    each contact: its normal force [N], the sum with the coupled forces of the others, the factor on K, the course of
    its indentation (`physics.contact.end_rate`), and the last feet. Flags of exceeded limits (`spring_range`);
    thickness of the organ at each vertex [m] (`Mesh.thicknesses`), and the least; excess of the indentation
    over it [1], now, and at most with the thickness there."""

    shared = "hard", "ground", "thick", "body.nodal", "body.edges"

    conditions = {"excess": "outside its range"}

    _count = 1  # of contacts; kept over a start, so that their arrays exist before the first step

    def start(self) -> None:
        super().start()
        if self.area != "fixed":
            self._notes.append("MassSpring: its force law K s^n stays; scene.surface.area changes only its surface")
        mapped = self.stiffness_map == "basis"
        self._hardness = (
            self.hardness()
            if self.nodule_radius > 0.0 or self.bone_shape or mapped or self.measured_map or self.map_factors
            else None
        )
        if self._hardness is not None:
            self.hold("hard", self._hardness)
        if self._hardness is not None and mapped:
            mesh = self.mesh()
            turning = surface_gradient(mesh, mesh.normals).reshape(-1, 9)
            sideways = self._field()[1]
            ground = np.zeros(len(turning), springs.GROUND)
            ground["position"], ground["factor"] = mesh.vertices, self._hardness
            ground["operator"], ground["leans"] = turning, sideways
            self.hold("ground", ground)
        thick = self.thicknesses()
        self.hold("thick", thick)
        self.own["thinnest"] = thick.min()
        self._make(self._count)

    def check(self) -> None:
        if self.stiffness_map == "basis":
            self._reference().basis()

    def hardness(self) -> np.ndarray:
        """Factor [1] (V) on K of each surface vertex, of nodule, bone and maps. SettingError: no basis is stored, or a
        file cannot be used."""
        factor = super().hardness()
        if self.measured_map:
            factor = factor * measured_factor(self.measured_map, self.mesh().vertices, self.map_factors)
        elif self.map_factors:
            raise SettingError("setting 'map_factors': found factors without places, expected a measured_map too")
        if self.stiffness_map == "basis":
            factor = factor * exp((2.0 * self.exponent - 1.0) * log(self._field()[0]))
        return factor

    def out_of_reach(self, setting: str, feet: np.ndarray) -> np.ndarray:
        """Which numbers of a list setting no load has at these feet [m] (n,3): bool, one for each number.

        A place of the map has an effect only through the vertices that it is nearest to. Those loaded lie within the
        radius of the patch; some more count as loaded, because a motion that changes a little reaches farther.
        """
        if setting != "map_factors":
            return np.zeros(len(getattr(self, setting)), bool)
        vertices, law = self.mesh().vertices, self.area_law()
        place = read_map(self.measured_map, vertices).place
        reach = MORE * (float(law.radii[-1]) if len(law.forces) else self.radius)
        loaded = nearest(tree_of(feet), vertices)[0][:, 0] < reach if len(feet) else np.zeros(len(vertices), bool)
        return ~np.isin(np.arange(len(self.map_factors)), place[loaded])

    def between(
        self,
        size: int,
        shares: Shares,
        normal: np.ndarray,
        area: np.ndarray,
        tangents: np.ndarray = NO_TANGENTS,
    ) -> BetweenBody:
        """The body for its contact with another, see `physics.bodies.between_bodies`: the nodal law for a patch of
        (1 - r²/R²)², in which the greatest pressure 3 f/(pi R²) indents by f/K. SettingError: the law is not linear."""
        if any(getattr(self, setting) != value for setting, value in self.touching.items()):
            raise SettingError(
                f"exponent {self.exponent:g}, damping {self.damping:g} s/m: the contact with another organ is linear, "
                "expected exponent 1 and damping 0 (`retardation` is its viscosity)"
            )
        softness = np.pi * self.radius**2 / (3.0 * self.stiffness * self.hardness())
        return foundation_between(softness, self.mesh().areas, shares, normal, area, self.retardation, tangents)

    def relative_stiffness(self, feet: Sequence[Vector3]) -> np.ndarray | float:
        """Stiffness [1] (p) of the stiffness map at the vertices nearest to these points [m] (p), over that of a
        half-space; 1 without a map. SettingError: no basis is stored."""
        if self.stiffness_map == "uniform":
            return 1.0
        closest = nearest(tree_of(self.mesh().vertices), np.asarray(feet, float))[1][:, 0]
        return self._field()[0][closest]

    def _field(self) -> tuple[np.ndarray, np.ndarray]:
        """The stiffness field of the reference, computed once."""
        if not hasattr(self, "_known"):
            self._known = self._reference().stiffness_field()
        return self._known

    def notes(self) -> list[str]:
        """A note for each limit that was exceeded."""
        beyond = int(self.known["beyond"])
        if beyond & spring_range.DEEP_NOTE:
            self._note_once(f"{type(self).__name__}: {spring_range.deep_note(self.radius)}")
        if beyond & spring_range.FAST_NOTE:
            self._note_once(f"{type(self).__name__}: {spring_range.fast_note(self.retardation, self.radius)}")
        if self.known["deepest"][0] > 0.0:
            self._note_once(
                f"MassSpring: the organ is indented by more than its thickness, {1e3 * self.own['deepest'][1]:.3g} mm "
                "on average (2 x volume / area). The law K s^n has no thickness, so the finger sinks deeper than the "
                "organ: the force is meaningless there. Take deformation.ReducedFE"
            )
        return super().notes()

    def bases(self) -> list[ReducedFE]:
        """The bodies whose bases this node reads."""
        return [] if self.stiffness_map == "uniform" else [self._reference()]

    def _reference(self) -> ReducedFE:
        names = "surface", "position", "rotation", "vertices", "file_unit", "piece", "refine", "spacing", "radius"
        return ReducedFE(**{name: getattr(self, name) for name in names})

    def resize(self, counts: list[int]) -> None:
        if counts[0] != self._count:
            self._make(counts[0])

    def _make(self, count: int) -> None:
        self._count = count
        make_room(self, count)
        self._held["laws"][:, :3] = self.stiffness, self.exponent, self.damping
        self.hold("factors", np.ones(count))
        self.hold("courses", np.full(count, blank_record(end_rate.COURSE, ahead=1.0)))
        self.hold("trails", np.full((count, 3), np.nan))
        self.hold("forces", np.zeros(count))
        self.hold("acting", np.zeros(count))
        if self.own["shape"]:
            law = (self.stiffness, self.exponent, self.damping, self.tangential_stiffness, self.tangential_damping)
            self.hold("body", springs.nodal_body(self.mesh(), *law, self._hardness, count, self.retardation))

    @kernel
    def idle(own, load, out, dt):
        laws, counts = floats(own.laws), integers(own.body.counts)
        for i in range(load.count):
            each = nth(load, i)
            loaded = each.nodes.shape[0] > 0 or (each.whole.shape[0] > 0 and floats(each.whole)[0] > 0.0)
            if loaded or laws[i, 4] != 0.0 or (own.shape and counts[i] > 0):
                return False
        return out.delayed == oldest(load)

    @ieee_kernel
    def compute(own, load: list[Load], out: Out[Surface], dt):
        if unknown_vertex(load, own.thick.shape[0]):
            own.fault = NO_VERTEX
            return
        couple(own, load)
        laws, coupling, forces, acting = floats(own.laws), floats(own.coupling), floats(own.forces), floats(own.acting)
        several = load.count > 1
        # indentation of each contact, and its terminal law for the next step
        body, count, courses = _body_of(own.body), 0, _courses_of(own.courses)
        stored, factors, slopes = 0.0, floats(own.factors), floats(own.slopes)
        mapped, reached = own.ground.shape[0] > 0, 0.0
        own.excess = 0.0
        for i in range(load.count):
            each = nth(load, i)
            acting[i] = row_times(coupling[i], forces) if several else forces[i]
            if each.whole.shape[0] > 0:  # the patch presses here as if all of it were on this organ
                acting[i] += floats(each.whole)[0] - forces[i]
            factors[i], side = local_factor(own, each, factors[i], slopes[i])
            stiffness, previous, course = own.stiffness * factors[i], laws[i, 4], courses[i]
            if mapped:  # the indentation that the contact computed, with the law at the previous position
                reached = indentation(acting[i], dt, laws[i, 0], own.exponent, own.damping, laws[i, 3], previous)
            moving, rest = springs.retard_law(stiffness, own.exponent, own.retardation, dt)
            free = rest * course.ahead * previous
            s = indentation(acting[i], dt, moving, own.exponent, own.damping, free, previous)
            shift = 0.0
            if mapped and acting[i] > 0.0:
                both = max(acting[i] + side, 0.0)
                shift = indentation(both, dt, moving, own.exponent, own.damping, free, previous) - s
                s += shift
            if not acting[i] > 0.0 and s < springs.AT_REST:
                s = 0.0
            note_limits(own, each, s, forces[i] > 0.0, floats(own.trails)[i], dt)
            share = forces[i] / acting[i] if acting[i] > 0.0 else 1.0
            if own.shape:  # displacement of the surface by the nodal law
                pull, normal = floats(each.forces), vector(each.normal)
                if 0.0 < share < 1.0:
                    pull = springs.add_shared(pull, normal, 1.0 / share - 1.0)
                count = springs.move(body, i, integers(each.nodes), pull, normal, dt, course.ahead)
            end_rate.arrive(course, each.tick if own.second_order else -1)
            end_rate.advance(course, s, dt)
            laws[i, 0], laws[i, 3], laws[i, 4] = moving, rest * course.ahead * s + shift, s
            if own.energy or mapped:
                grown = own.exponent + 1.0
                stored += share * (stiffness * max(s, 0.0) ** grown / grown)
                for k in range(3 if mapped else 0):
                    slopes[i, k] *= -share * (stiffness * max(reached, 0.0) ** grown / grown)
        if own.energy:
            one(out.stored, stored)
        send_laws(own, out)
        if mapped:
            out.shape_operator.count = 9
            put(out.tangential_gradient, vector(slopes[0, :3]))
            for k in range(9):
                out.shape_operator.values[k] = slopes[0, 3 + k]
        out.step, out.relaxation, out.extrapolation = dt, own.retardation, own.excess
        out.delayed = oldest(load)
        if own.shape and several:
            count = springs.deeper(body)
            lend_first(out.nodes, own.body.nodes, count)
            lend_first(out.displacement, own.body.deepest, count)
        elif own.shape:
            lend_first(out.nodes, own.body.active, count)
            lend_first(out.displacement, own.body.moved, count)
