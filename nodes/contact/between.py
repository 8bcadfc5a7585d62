"""Contact of two bodies with each other (docs/equations/between.md)."""

import json
from typing import Annotated, Any, NamedTuple

import msgspec
import numpy as np

from palpate.compiler.records import floats, form, integers, lend, lend_first, longs, nth, put, unpacking, vector
from palpate.messages import Load
from palpate.messages.contact import SIDES, OrganContact
from palpate.messages.record import ROOM, array_handle
from palpate.messages.tissue import Support
from palpate.nodes.base import ARRAY, TABLE, CompiledNode, InputError, Node, Out, SettingError
from palpate.nodes.base.contacts import NO_VERTEX
from palpate.nodes.base.kernels import ieee_kernel, kernel
from palpate.nodes.base.surface import OnThinnedSurface
from palpate.nodes.contact.carried import begins_to_ride, carry, end_ride, press_on, ride_on
from palpate.nodes.contact.followed import follow, jumped, renew_factor
from palpate.nodes.contact.withheld import joins_run, leaps, withhold
from palpate.physics.bodies.between_bodies import NO_TANGENTS, BetweenBody, measure_along, tangents_of
from palpate.physics.bodies.floating.turning import times_back
from palpate.physics.bodies.mass_spring import normal_force
from palpate.physics.contact.organs import between as contact
from palpate.physics.contact.organs import following
from palpate.physics.contact.organs.between_rows import SPRINGS, Law
from palpate.physics.contact.organs.borders import contact_area
from palpate.physics.contact.organs.candidates import Candidates, Shares, candidates
from palpate.physics.contact.organs.rigid_motion import RIDE
from palpate.physics.contact.organs.rubbing import Rubbing, rubbing, step_rubbing
from palpate.physics.contact.organs.rubbing_patch import open_by_friction
from palpate.physics.geometry.mesh import Mesh

CUBE = array_handle(3)
OVERLAP = 1e-5  # [m] Overlap of two surfaces at the start above which they are refused
GIVEN = 1e-3  # [J] Energy that a contact may generate without a note
COARSE = 2e-3  # [m] Spacing of the candidates above which a note is printed


class BodySide(NamedTuple):
    """One of the two bodies: its terminals, see `between_bodies.BetweenBody`, and the shares of the candidates.

    begins (m+1), ends (m)  first share of each candidate, and the one after its last
    vertices, shares (k)  see `candidates.Shares`
    place (m,3)   centre of each candidate [m];  centre (m,3)  that for which the compliances were computed
    normal (m,3)  direction for which they were computed
    gathered (t,3), touched (2,t)  workspace of `physics.contact.organs.between.open_by`
    slot (V)      place of a vertex in `nodes`, -1: none; -1 between steps
    nodes (k), forces [N] (k,3)  the load on the body
    """

    corners: Annotated[np.ndarray, "<i8", 2]
    weights: Annotated[np.ndarray, "<f8", 2]
    response: Annotated[np.ndarray, "<f8", 2]
    aside: Annotated[np.ndarray, "<f8", 2]
    begins: Annotated[np.ndarray, "<i8", 1]
    ends: Annotated[np.ndarray, "<i8", 1]
    vertices: Annotated[np.ndarray, "<i8", 1]
    shares: Annotated[np.ndarray, "<f8", 1]
    place: Annotated[np.ndarray, "<f8", 2]
    centre: Annotated[np.ndarray, "<f8", 2]
    normal: Annotated[np.ndarray, "<f8", 2]
    gathered: Annotated[np.ndarray, "<f8", 2]
    touched: Annotated[np.ndarray, "<i8", 2]
    slot: Annotated[np.ndarray, "<i8", 1]
    nodes: Annotated[np.ndarray, "<i4", 1]
    forces: Annotated[np.ndarray, "<f8", 2]


def _side(body: BetweenBody, shares: Shares, normal: np.ndarray) -> BodySide:
    size, terminals = len(body.corners), len(body.response) // 3
    used, begins = len(np.unique(shares.vertices)), np.searchsorted(shares.cells, np.arange(len(normal) + 1))
    place = np.ascontiguousarray(shares.place)
    return BodySide(
        np.ascontiguousarray(body.corners, np.int64), np.ascontiguousarray(body.weights, float), body.response,
        body.aside, begins.astype(np.int64), begins[1:].astype(np.int64), shares.vertices, shares.weights, place,
        place.copy(), normal.copy(), np.zeros((terminals, 3)), np.zeros((2, terminals), np.int64), np.full(size, -1),
        np.zeros(used, np.int32), np.zeros((used, 3)),
    )  # fmt: skip


side_of, pair_of, rub_of = unpacking(BodySide), unpacking(contact.Pair), unpacking(Rubbing)


@ieee_kernel
def take_loads(load, fingers, side, others, opened, pressing, aside, moved):
    """Fill `others` [m] (m), the opening of the candidates by all loads on a body at rest, `opened` [m] (2,f + 1,m),
    that by each of the first f = `fingers` loads and by its normal part, and their normal forces `pressing` [N]; if the
    bodies rub, `aside` [m] (2m), the displacement of the candidates along the surface by all loads. Returns whether a
    load is on an unknown vertex.

    moved (2m)  workspace
    """
    others[:] = 0.0
    aside[:] = 0.0
    pressing.count = fingers
    for i in range(load.count):
        each, row, part = nth(load, i), opened[0, min(i, fingers)], opened[1, min(i, fingers)]
        if i >= fingers:
            part = part[:0]
        else:
            pressing.values[i] = 0.0
        if not each.there or each.nodes.shape[0] == 0:
            continue
        nodes, forces = integers(each.nodes), floats(each.forces)
        for v in nodes:
            if not 0 <= v < len(side.corners):
                return True
        n = vector(each.normal)
        contact.open_by(
            nodes, forces, n, side.corners, side.weights, side.response, side.gathered, side.touched, row, part
        )
        for k in range(len(others)):
            others[k] += row[k]
        if len(aside) > 0:
            contact.open_by(
                nodes, forces, n, side.corners, side.weights, side.aside, side.gathered, side.touched, moved, part[:0]
            )
            for k in range(len(aside)):
                aside[k] += moved[k]
        if i < fingers:
            pressing.values[i] = normal_force(forces, n)
    return False


@ieee_kernel
def spread_forces(pair, side, rubs, sign):
    """Fill nodes and forces of a side's load with the forces of the candidates, `sign` p n and the friction `rubs` [N]
    (m,3); returns the number of nodes."""
    count, active, normal = 0, pair.active, side.normal
    for k in range(active.tally[0].active):
        i = active.order[k]
        force = sign * active.force[i]
        if force == 0.0:
            continue
        for at in range(side.begins[i], side.ends[i]):
            v = side.vertices[at]
            if side.slot[v] < 0:
                side.slot[v], side.nodes[count] = count, v
                side.forces[count, 0] = side.forces[count, 1] = side.forces[count, 2] = 0.0
                count += 1
            for x in range(3):
                given = force * normal[i, x]
                if len(rubs) > 0:
                    given += rubs[i, x]
                side.forces[side.slot[v], x] += side.shares[at] * given
    for k in range(count):
        side.slot[side.nodes[k]] = -1
    return count


@ieee_kernel
def summarise(own, pair, first, second, normal, out):
    """Fill force, patch and gap of the message."""
    active, force, out.gap = pair.active, 0.0, own.reach
    out.area = contact_area(pair, floats(own.areas), longs(own.borders)[: own.met], floats(own.strips)[: own.met])
    resultant, foot, across = own.sums[0], own.sums[1], own.sums[2]
    own.sums[:] = 0.0
    for k in range(active.tally[0].active):
        i = active.order[k]
        p = active.force[i]
        force += p
        for x in range(3):
            resultant[x] += p * normal[i, x]
            foot[x] += p * first.place[i, x]
            across[x] += p * second.place[i, x]
    for i in range(len(pair.opening)):
        out.gap = min(out.gap, pair.opening[i])
    out.force = force
    put(out.resultant, vector(resultant))
    if force > 0.0:
        size = np.sqrt(resultant[0] ** 2 + resultant[1] ** 2 + resultant[2] ** 2)
        for x in range(3):
            own.foot[x], own.across[x] = foot[x] / force, across[x] / force
            own.normal[x] = resultant[x] / size if size > 0.0 else own.normal[x]
    put(out.foot, vector(own.foot))
    put(out.across, vector(own.across))
    put(out.normal, vector(own.normal))


@ieee_kernel
def answer(own, pair, rub, one, two, normal, out):
    """Fill the message, except for the loads, and for what moves with foundations."""
    lend(out.first_yields, own.yields)
    lend(out.second_yields, own.returns)
    summarise(own, pair, one, two, normal, out)
    balance = rub.balance[0]
    out.stored, out.dissipated = balance.stored, pair.past[0].dissipated + balance.dissipated
    out.generated = pair.past[0].generated
    own.steps += 1
    out.steps = own.steps
    put(out.friction, times_back(rub.axes[0], rub.pull))
    put(out.slip, times_back(rub.axes[0], rub.speed))
    for x in range(3):
        out.resultant[x] += out.friction[x]
    own.penetrates[0] = max(own.penetrates[0], -out.gap)


@kernel
def send_loads(own, out, first, second):
    """Lend the loads on both bodies, on the first nodes of each."""
    lend_first(out.first_nodes, own.one.nodes, first)
    lend_first(out.first_forces, own.one.forces, first)
    lend_first(out.second_nodes, own.two.nodes, second)
    lend_first(out.second_forces, own.two.forces, second)


@kernel
def send_ride(own, out):
    """Lend what only organs that rotate with their foundations have, after `end_ride`."""
    lend(out.torques, own.torques)
    lend(out.carried, own.carried)
    lend(out.across_normal, own.across_normal)


@kernel
def balance_late(own, out):
    """Count as generated what the contact has given more than it had taken before, with the work after its steps."""
    lost = out.dissipated - out.generated - own.late
    own.highest = max(own.highest, lost)
    own.lost = max(own.lost, own.highest - lost)
    out.generated, out.dissipated = own.lost, lost + own.lost


class GivenBody(NamedTuple):
    """A body, and its surface."""

    body: Any
    mesh: Mesh


def _body(name: str) -> Any:
    """The class of a shipped body. SettingError: it is none; the name comes from a graph, a job or a recording."""
    from palpate.nodes import deformation

    found = getattr(deformation, name, None)
    if not (isinstance(found, type) and issubclass(found, Node) and hasattr(found, "between")):
        raise SettingError(f"setting 'bodies': found the class {name!r}, expected a body of palpate.nodes.deformation")
    return found


class Between(CompiledNode):
    """Contact of two bodies, without penalty, with friction (docs/equations/between.md).

    `first` and `second` are the loads of the fingers on each body, then of other organs, in the order of the body's
    loads. The fingers feel the other body through `contact.Backed` or `contact.Joint`. A `contact.Side` sends the load
    on each body. `first_support` and `second_support` are the motions of their foundations (support.Moving). The bodies
    are linear here: their large displacement is left out. The candidates follow where the organs slide (`followed`).

    reach   distance of the undeformed surfaces up to which they have candidates
    cells   most candidates; where the meshes have more vertices, neighbours are joined
    friction  coefficient mu of Coulomb friction; 0: the bodies slide freely, as with a film of fluid between them
    bristle_stiffness  of the stick
    viscous   of a film of fluid: friction of this multiple of normal force and slip velocity
    bodies  the two bodies with their settings, as JSON: determined when the graph is loaded
    first_organs, second_organs  numbers of loads of other organs, the last ones, also determined there
    """

    reach: Annotated[float, "m", msgspec.Meta(gt=0, le=0.05)] = 6e-3
    cells: Annotated[int, "1", msgspec.Meta(ge=1, le=512)] = 160
    friction: Annotated[float, "1", msgspec.Meta(ge=0, le=10)] = 0.0
    bristle_stiffness: Annotated[float, "N/m", msgspec.Meta(gt=0, le=1e9)] = 1e4
    viscous: Annotated[float, "s/m", msgspec.Meta(ge=0, le=1e6)] = 0.0
    bodies: Annotated[str, "1"] = ""
    first_organs: Annotated[int, "1", msgspec.Meta(ge=0, le=ROOM)] = 0
    second_organs: Annotated[int, "1", msgspec.Meta(ge=0, le=ROOM)] = 0

    of_one_body = False

    State = {
        "pair": form(contact.Pair), "one": form(BodySide), "two": form(BodySide), "rub": form(Rubbing),
        "normals": TABLE, "areas": ARRAY, "borders": TABLE, "strips": ARRAY, "met": int,
        "others": TABLE, "opened": CUBE, "again": CUBE, "along": CUBE,
        "yields": TABLE, "returns": TABLE, "slid": ARRAY,
        "rest": ARRAY, "supports": (2, 3), "apart": (3,), "carried": ARRAY,
        "sums": (3, 3), "foot": (3,), "across": (3,), "normal": (3,), "fault_side": int,
        "strays": (2,), "allowed": (2,),  # greatest slide and approach by the foundations [m], and those of the cells
        # Candidates that follow (`followed`): normals on the second organ, n.(x_1 - x_2) [m]; the next one; the largest
        # force [N] at the end of the region with candidates; of those that move to other cells (`reassigned`) the last
        # one, -1: none, the next one whose neighbours are examined, and how many were; place
        # of one organ on the other.
        "track": form(following.Track), "first_law": form(Law), "second_law": form(Law), "opposite": TABLE,
        "before": ARRAY, "turn": int, "still": (2, 3), "still_turn": (2, 3), "tangents": TABLE, "ended": (),
        "fresh": int, "outer": int, "looked": int, "relative": (3, 3), "offset": (3,),
        "floats": bool, "room": (), "losses": (),  # whether forces move an organ; [J] lost in the last step, and in all
        "penetrates": (2,),  # greatest overlap left [m]; the most [m] for which nothing is reported
        # Of organs that rotate with their foundations (`carried`): their places; motions [m, rad] in a step; h, levers;
        # gaps [m] that the last step expected; vertices [m]; forces of the candidates [N, N m], and all that were sent
        # in the last step: on the first, moments on both; its friction [N] on the first, and the motion [m] that it
        # counted; centre of the patch; last normal on the second.
        "rides": bool, "ride": (2, RIDE), "by": (2, 6),
        "turns": TABLE, "levers": TABLE, "seen": ARRAY,
        "first_points": TABLE, "second_points": TABLE, "wrench": (9,), "sent": (9,), "load": (6,),
        "torques": TABLE,
        "held": (3,), "counted": (3,), "given": (3,), "point": (3,), "middle": (3,), "across_normal": ARRAY,
        "late": (), "highest": (), "lost": (),  # [J] work of the contact after its step; its balance, and what it gave
        "steps": int,  # since the start
        # [m] Gap that is withheld (`withheld`); of both supports the time of the last message and the usual step [s]
        "withheld": (), "heard": (2,), "usual": (2,),
    }  # fmt: skip
    """The bodies, their contact and their friction; normals [1] and areas [m²] of the candidates, and their
    borders, see `borders.Borders`, and the number of these; openings by all loads
    on each body, and by each finger on the first and on the second; workspace; responses [m/N] of both; gaps [m] of the
    bodies at their places at the start, displacements [m] of both foundations and their difference, work [J] of the
    foundations; last feet and normal."""
    shared = (
        "first_points", "second_points", "pair.retardation",
        *(f"track.{name}" for name in (
            "begins", "vertices", "weights", "place", "area", "parent", "child", "near_at", "near", "strips", "beyond",
            "facing", "points", "cells", "discs", "star_at", "star",
        )),
        *(f"{law}_law.{name}" for law in ("first", "second") for name in ("compliance", "table", "softness", "areas")),
    )  # fmt: skip

    def start(self) -> None:
        super().start()
        sides = self._sides()
        found = self._candidates(sides)
        count = len(found.gap)
        normal, area = np.ascontiguousarray(found.normal), np.ascontiguousarray(found.area)
        tangents = tangents_of(normal) if self.friction > 0.0 or self.viscous > 0.0 else NO_TANGENTS
        one, two = self._answers(sides, found, normal, area, tangents)
        self.hold("rub", rubbing(
            tangents, one.drags, two.drags, self.friction, self.bristle_stiffness, self.viscous
        ))  # fmt: skip
        self.hold("slid", np.zeros(2 * tangents.shape[1]))
        self.hold("pair", contact.pair(found.gap, one.matrix, two.matrix, (one.retardation, two.retardation)))
        self.hold("one", _side(one, found.first, normal))
        self.hold("two", _side(two, found.second, normal))
        self._hold_cells(found, normal, area)
        self._found, self._meshes, self._laws = found, (sides[0].mesh, sides[-1].mesh), (one.law, two.law)
        self.hold("carried", np.zeros(1))
        self.hold("others", np.zeros((2, count)))
        self.resize([self.first_organs, self.second_organs])
        self._hold_ride(count, [sides[0].mesh, sides[-1].mesh])
        self.own["normal"] = (0.0, 0.0, 1.0)
        self.own["allowed"] = found.spacing, self.reach
        if count:
            nearest = int(np.argmin(found.gap))
            self.own["foot"], self.own["across"] = found.first.place[nearest], found.second.place[nearest]
            self.own["normal"] = normal[nearest]
            self.own["point"] = 0.5 * (found.first.place[nearest] + found.second.place[nearest])
            self.own["penetrates"][1] = 1e-4
        self.hold("across_normal", np.array(self.own["normal"]))
        self._remark(sides, found, bool(tangents.size))

    def _candidates(self, sides: list[GivenBody]) -> Candidates:
        """SettingError: the bodies overlap."""
        found = candidates(sides[0].mesh, sides[1].mesh, self.reach, self.cells)
        if found.deepest < -OVERLAP:
            raise SettingError(
                f"the bodies overlap by {-1e3 * found.deepest:.3g} mm at the start, expected a gap: move one of them "
                "(`position`)"
            )
        return found

    def _answers(
        self, sides: list[GivenBody], found: Candidates, normal: np.ndarray, area: np.ndarray, tangents: np.ndarray
    ) -> tuple[BetweenBody, BetweenBody]:
        """Compliances of both bodies for the opening of the candidates."""
        one, two = (
            side.body.between(len(side.mesh.vertices), shares, normal, area, tangents)
            for side, shares in zip(sides, (found.first, found.second), strict=True)
        )
        # forces on the second body are along -n, and its displacement along n closes
        signs = np.repeat((-1.0, 1.0, 1.0), tangents.shape[1])[:, None] if tangents.size else 1.0
        return one, two._replace(response=-two.response, drags=signs * two.drags)

    def _remark(self, sides: list[GivenBody], found: Candidates, rubs: bool) -> None:
        if not len(found.gap):
            self._notes.append(
                f"Between: the bodies are farther apart than {1e3 * self.reach:.3g} mm (`reach`), so they do not touch"
            )
        self._remark_spacing(found)
        how = "" if rubs else "slide on each other without friction, and "
        self._notes.append(
            f"Between: the organs {how}are linear where they touch: large displacement acts under fingers only"
        )
        if local := sorted({type(side.body).__name__ for side in sides if not hasattr(side.body, "basis")}):
            self._notes.append(
                f"Between: {' and '.join(local)}: a finger moves only the surface under its patch, so that it does not "
                "press the organ into its neighbour from the other side, as with deformation.ReducedFE"
            )

    def _remark_spacing(self, found: Candidates) -> None:
        if found.spacing > COARSE:
            self._notes.append(
                f"{type(self).__name__}: the candidates are {1e3 * found.spacing:.2g} mm apart, so that patches "
                f"narrower than {4e3 * found.spacing:.2g} mm are too stiff: more `cells`, or a shorter `reach`"
            )

    def _hold_cells(self, found: Candidates, normal: np.ndarray, area: np.ndarray) -> None:
        apart = found.first.place - found.second.place
        x, y, z = (normal[:, i] * apart[:, i] for i in range(3))
        self.hold("before", np.asarray(x + y + z))
        self.hold("rest", found.gap.copy())
        self.hold("opposite", normal.copy())
        self.hold("normals", normal)
        self.hold("areas", area)
        self.hold("borders", np.ascontiguousarray(found.borders.cells))
        self.hold("strips", found.borders.area)
        self.own["met"], self.own["fresh"] = len(found.borders.area), -1

    def _hold_ride(self, count: int, meshes: list[Mesh]) -> None:
        """State of organs that rotate with their foundations, without room for their answers (`begins_to_ride`)."""
        for name, columns in (("turns", 3), ("levers", 6)):
            self.hold(name, np.zeros((count, columns)))
        self.hold("seen", self._held["rest"].copy())
        self.hold("torques", np.zeros((2, 3)))
        for name, mesh in zip(("first_points", "second_points"), meshes, strict=True):
            self.hold(name, np.ascontiguousarray(mesh.vertices, float))
        for ride in self.own["ride"]:
            ride["matrix"] = np.eye(3)

    def resize(self, counts: list[int]) -> None:
        """Room for the fingers on each body, and, with organs that move, for candidates that follow."""
        if sum(counts[2:]) > 0:
            self.make_follow()
        one, two = max(counts[0] - self.first_organs, 0), max(counts[1] - self.second_organs, 0)
        size = len(self._held["rest"])
        self.hold("opened", np.zeros((2, one + 1, size)))
        self.hold("again", np.zeros((2, two + 1, size)))
        self.hold("along", np.zeros((2, max(one, two), size)))
        self.hold("yields", np.zeros((one, one)))
        self.hold("returns", np.zeros((two, two)))

    def make_follow(self) -> None:
        """Let the candidates follow when the organs slide on each other (`followed`)."""
        found, count = self._found, len(self._found.gap)
        if self.of_one_body or not count or len(self._held.get("track.cell", ())):
            return
        self.hold("track", track := following.track(found, *self._meshes))
        self.hold("tangents", np.zeros((2, 3)))
        self._free_borders(track)
        for side, name, law, slides in zip(
            ("one", "two"), ("first", "second"), self._laws, (found.swapped, not found.swapped), strict=True
        ):  # fmt: skip
            self.hold(f"{name}_law", law)
            if law.kind == SPRINGS:
                self._free_springs(side)
            if not slides:
                self._free_cells(side, track)
            else:
                self._free_shares(side, track)
                one, two = found.first.place, found.second.place
                places = (two, one) if found.swapped else (one, two)
                matrix, drags, tangents = (self._held[key] for key in (f"pair.{name}", f"rub.{name}", "rub.tangents"))
                measure_along(law, matrix, drags, places, found.normal, tangents[0], found.area)

    def _free_springs(self, side: str) -> None:
        """Terminals at all vertices of a body of springs."""
        used, size = self._held[f"{side}.weights"][:, 0] > 0.0, len(self._held[f"{side}.corners"])
        for name in ("response", "aside"):
            kept = self._held[f"{side}.{name}"]
            if kept.size:
                every = np.zeros((size, 3, kept.shape[1]))
                every[used] = kept.reshape(-1, 3, kept.shape[1])
                self._hold(self.own[side], name, every.reshape(3 * size, -1), f"{side}.{name}")
        corners = np.zeros((size, 3), np.int64)
        corners[:, 0] = np.arange(size)
        for name, value in (
            ("corners", corners), ("gathered", np.zeros((size, 3))), ("touched", np.zeros((2, size), np.int64)),
        ):  # fmt: skip
            self._hold(self.own[side], name, value, f"{side}.{name}")

    def _free_borders(self, track: following.Track) -> None:
        """Room for the borders of candidates in any cells."""
        most = np.sort(np.diff(track.near_at))[-len(track.cell) :].sum() // 2
        for name, value in (("borders", np.zeros((most, 2), np.int64)), ("strips", np.zeros(most))):
            kept = self._held[name]
            value[: len(kept)] = kept
            self.hold(name, value)

    def _free_cells(self, side: str, track: following.Track) -> None:
        """The shares of all cells of the surface on which the candidates stay, and room for the load of any."""
        count, most = len(track.cell), int(np.diff(track.begins).max())
        used = min(len(track.vertices), count * most)
        for name, value in (
            ("begins", track.begins[:count].copy()), ("ends", track.begins[1 : count + 1].copy()),
            ("vertices", track.vertices.copy()), ("shares", track.weights.copy()),
            ("nodes", np.zeros(used, np.int32)), ("forces", np.zeros((used, 3))),
        ):  # fmt: skip
            self._hold(self.own[side], name, value, f"{side}.{name}")

    def _free_shares(self, side: str, track: following.Track) -> None:
        """Room for the shares of candidates on the body over which they slide: three for each vertex of any cell."""
        count, size = len(track.cell), len(self._held[f"{side}.corners"])
        begins = 3 * int(np.diff(track.begins).max()) * np.arange(count + 1)
        ends = begins[:-1] + np.diff(self._held[f"{side}.begins"])
        vertices, shares = np.zeros(begins[-1], np.int64), np.zeros(begins[-1])
        at = np.concatenate([np.arange(*each) for each in zip(begins, ends, strict=False)])
        vertices[at], shares[at] = self._held[f"{side}.vertices"], self._held[f"{side}.shares"]
        used = min(size, len(vertices))
        for name, value in (
            ("begins", begins), ("ends", ends), ("vertices", vertices), ("shares", shares),
            ("nodes", np.zeros(used, np.int32)), ("forces", np.zeros((used, 3))),
        ):  # fmt: skip
            self._hold(self.own[side], name, value, f"{side}.{name}")

    def _sides(self) -> list[GivenBody]:
        """The bodies of `bodies`. SettingError: a body or surface cannot be used."""
        if not self.bodies:
            raise SettingError("setting 'bodies': empty; a graph that is loaded finds them by its contact.Side")
        try:
            given, found = json.loads(self.bodies), []
        except ValueError:
            raise SettingError(
                "setting 'bodies': found no JSON; leave it out, it is set when the graph is loaded"
            ) from None
        surfaces = [OnThinnedSurface(**each["surface"]) for each in given]
        for each, surface in zip(given, surfaces, strict=True):
            if len(surface.mesh().vertices) != len(surface.whole().vertices):
                raise SettingError(
                    f"surface {surface.surface!r}: thinned to {1e3 * surface.spacing:.3g} mm, expected all vertices "
                    "where organs touch: scene.surface.spacing: 0, or a coarser mesh"
                )
            found.append(GivenBody(_body(each["use"])(**each["settings"]), surface.mesh()))
        return found

    @ieee_kernel
    def compute(
        own,
        first: list[Load | None],
        second: list[Load | None],
        first_support: list[Support | None],
        second_support: list[Support | None],
        out: Out[OrganContact],
        dt,
    ):
        carries, moved = first_support.count + second_support.count > 0, (0.0, 0.0, 0.0)
        rides = carries and begins_to_ride(own, first_support, second_support)
        pair, one, two = pair_of(own.pair), side_of(own.one), side_of(own.two)
        others, opened, again = floats(own.others), floats(own.opened), floats(own.again)
        normal, along = floats(own.normals), floats(own.along)
        presses, rests = out.first_pressing, out.second_pressing
        rub, slid = rub_of(own.rub), floats(own.slid)
        unknown = take_loads(first, opened.shape[1] - 1, one, others[0], opened, presses, rub.others[0], slid)
        if unknown or take_loads(second, again.shape[1] - 1, two, others[1], again, rests, rub.others[1], slid):
            own.fault, own.fault_side = NO_VERTEX, 0 if unknown else 1
            return
        joins = joins_run(own.steps, first_support) or joins_run(own.steps, second_support)
        leapt = leaps(own, 0, first_support, first_support.count - 1)
        leapt = leaps(own, 1, second_support, second_support.count - 1) or leapt
        if rides:
            ride_on(own, pair, rub, first_support, first_support.count - 1, second_support, second_support.count - 1)
        elif carries:
            moved = carry(own, pair, rub, normal, first_support, second_support)
        if carries:
            withhold(own, pair, rub, joins, leapt, dt)
            renew_factor(pair, follow(own, pair, rub, one, two, dt))
        rubs = len(rub.touched) > 0
        if rubs:
            open_by_friction(rub, others)
        out.left = contact.step_pair(pair, others, dt, contact.MOST)
        if rides:
            press_on(own, pair)
            for x in range(3):
                rub.carried[x] += own.counted[x]
        if rubs:
            step_rubbing(pair, rub, dt)
        contact.responses(pair, pair.active, 0, 0, opened[0], opened[1], presses.values, dt, along, floats(own.yields))
        contact.responses(pair, pair.active, 0, 1, again[0], again[1], rests.values, dt, along, floats(own.returns))
        answer(own, pair, rub, one, two, normal, out)
        if carries:  # the motion is prescribed, and bears this as well
            floats(own.carried)[0] -= jumped(own, pair)
        if rides:
            put(out.resultant, end_ride(own, pair, rub))
            balance_late(own, out)
            send_ride(own, out)
        elif carries:
            work = floats(own.carried)
            for x in range(3):
                work[0] -= out.resultant[x] * moved[x]
            lend(out.carried, own.carried)
        send_loads(own, out, spread_forces(pair, one, rub.force[0], 1.0), spread_forces(pair, two, rub.force[1], -1.0))

    def explain(self, fault: int, *messages: Any) -> Exception:
        side = int(self.own["fault_side"])
        return InputError(
            messages[side][0], f"a load of `{SIDES[side]}` is on a vertex that the surface of its contact.Side lacks: "
            "give the node that spreads it the same surface"
        )  # fmt: skip

    def notes(self) -> list[str]:
        deepest, least = self.known["penetrates"]
        if deepest > least > 0.0:
            self._note_growth(
                "overlap", deepest,
                f"Between: the bodies overlapped by up to {1e3 * deepest:.2g} mm for some steps, because they met "
                f"faster than {contact.MOST} candidates in a step",
            )  # fmt: skip
        lost = self.known["lost"]
        if lost > GIVEN:
            self._note_growth(
                "energy", lost,
                f"Between: the contact generated up to {1e3 * lost:.2g} mJ, because an organ left its "
                "foundation, landed on it, or moved far over the other, within a step: a higher rate generates less",
            )  # fmt: skip
        (aside, nearer), (cell, reach) = self.known["strays"], self.known["allowed"]
        follows = self.known["track"]["cell"]["shape"][0] > 0
        if aside > cell > 0.0 and not follows:
            self._note_growth(
                "slide", aside,
                f"Between: the foundations slid by up to {1e3 * aside:.3g} mm against each other, more than the "
                f"{1e3 * cell:.2g} mm between the candidates, which stay where they were at the start: places and "
                "directions of the forces, and the gaps of curved organs, are approximate",
            )  # fmt: skip
        if (ended := self.known["ended"]) > 0.0:
            self._note_growth(
                "ended", ended,
                "Between: the contact reached the end of the region with candidates, where it lacks force: set "
                "scene.between.reach to more",
            )  # fmt: skip
        if nearer > reach > 0.0 and not follows:  # else `ended` says where candidates are missing
            self._note_growth(
                "approach", nearer,
                f"Between: the foundations came nearer by up to {1e3 * nearer:.3g} mm, more than the candidates reach: "
                "set scene.between.reach to more than that",
            )  # fmt: skip
        return super().notes()
