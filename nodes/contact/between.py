"""Contact of two bodies with each other (docs/equations/between.md)."""

from typing import Annotated, Any

import msgspec
import numpy as np

from palpate.compiler.fields import form
from palpate.compiler.records import floats, lend, put
from palpate.messages import Load
from palpate.messages.contact import SIDES, OrganContact
from palpate.messages.record import ROOM, array_handle
from palpate.messages.tissue import Support
from palpate.nodes.base import ARRAY, TABLE, CompiledNode, InputError, Out, SettingError
from palpate.nodes.base.contacts import NO_VERTEX
from palpate.nodes.base.kernels import ieee_kernel
from palpate.nodes.contact.carried import begins_to_ride, carry, end_ride, press_on, ride_on
from palpate.nodes.contact.followed import follow, jumped, renew_factor
from palpate.nodes.contact.organs.body_side import (
    BodySide,
    body_side,
    pair_of,
    rub_of,
    side_of,
    spread_forces,
    take_loads,
)
from palpate.nodes.contact.organs.given_bodies import GivenBody, given_bodies
from palpate.nodes.contact.organs.organ_answer import answer, balance_late, send_loads, send_ride
from palpate.nodes.contact.organs.organ_notes import growing_notes, start_notes
from palpate.nodes.contact.organs.room_to_follow import keep_columns, make_follow
from palpate.nodes.contact.organs.withheld import joins_run, leaps, withhold
from palpate.physics.bodies.between_bodies import NO_TANGENTS, BetweenBody, tangents_of
from palpate.physics.contact.organs import between as contact
from palpate.physics.contact.organs import following
from palpate.physics.contact.organs.between_rows import Law
from palpate.physics.contact.organs.candidates import Candidates, candidates
from palpate.physics.contact.organs.rigid_motion import RIDE
from palpate.physics.contact.organs.rubbing import Rubbing, rubbing, step_rubbing
from palpate.physics.contact.organs.rubbing_patch import open_by_friction
from palpate.physics.geometry.mesh import Mesh

CUBE = array_handle(3)
OVERLAP = 1e-5  # [m] Overlap of two surfaces at the start above which they are refused


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
        # Whether forces move an organ; whether organs were still while the contact was missing; [J] lost in the last
        # step, and in all.
        "floats": bool, "waited": bool, "room": (), "losses": (),
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
        sides = given_bodies(self.bodies)
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
        self.hold("one", body_side(one, found.first, normal))
        self.hold("two", body_side(two, found.second, normal))
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
        self._notes += start_notes(sides, found, self.reach, rubs)

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
        for name, rows in (("turns", 3), ("levers", 6)):  # rows in a kernel's inner loops
            self.hold(name, np.zeros((rows, count)))
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
        keep_columns(self.own, self._held, "", counts[:2])
        one, two = max(counts[0] - self.first_organs, 0), max(counts[1] - self.second_organs, 0)
        size = len(self._held["rest"])
        self.hold("opened", np.zeros((2, one + 1, size)))
        self.hold("again", np.zeros((2, two + 1, size)))
        self.hold("along", np.zeros((2, max(one, two), size)))
        self.hold("yields", np.zeros((one, one)))
        self.hold("returns", np.zeros((two, two)))

    def make_follow(self) -> None:
        """Let the candidates follow when the organs slide on each other (`followed`)."""
        if not (self.of_one_body or not len(self._found.gap) or len(self._held.get("track.cell", ()))):
            make_follow(self, self._found, self._meshes, self._laws)

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
        for name, size, text in growing_notes(self.known):
            self._note_growth(name, size, text)
        return super().notes()
