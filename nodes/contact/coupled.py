"""Contacts of organs that share organs on foundations, solved together (docs/equations/moving-organs.md)."""

import json
from typing import Annotated, Any

import numpy as np

from palpate.compiler.fields import form
from palpate.compiler.records import floats, integers, longs, put
from palpate.messages import Load
from palpate.messages.contact import MOST_CONTACTS, SIDES, OrganContact
from palpate.messages.record import ROOM
from palpate.messages.tissue import Support
from palpate.nodes.base import ARRAY, TABLE, InputError, Out, SettingError
from palpate.nodes.base.compiled import record
from palpate.nodes.base.contacts import NO_VERTEX
from palpate.nodes.base.kernels import ieee_kernel
from palpate.nodes.contact.between import CUBE, Between
from palpate.nodes.contact.coupled_step import active_of, begin, finish, repeat_loads, solve
from palpate.nodes.contact.organs.body_side import pair_of, rub_of, side_of, take_loads
from palpate.nodes.contact.organs.organ_answer import answer, balance_late, send_loads, send_ride
from palpate.nodes.contact.organs.room_to_follow import keep_columns
from palpate.physics.contact.organs import between as contact
from palpate.physics.contact.organs import coupled
from palpate.physics.contact.organs.pivoting import ActiveSet, active_set


class Coupled(Between):
    """A `contact.Between` of which an organ moves by forces, on a foundation, and so shares it with other contacts
    (docs/equations/moving-organs.md). The loader puts it in place of a `contact.Between` (scene key `foundations`).

    Each of the contacts that share organs on foundations solves the problem of all of them, and sends its part: none
    answers to another a step later, and in several processes none waits for another.

    loads, supports  fingers on all these organs, and the motions of all of them
    island  settings of all these contacts, with the places of their loads and supports in these inputs, and whether
            both organs wait for the contact, as JSON; `place` is that of this one; set by the loader
    """

    island: Annotated[str, "1"] = ""
    place: Annotated[int, "1"] = 0

    State = {
        "members": (MOST_CONTACTS, record(Between)),
        "organs": (ROOM, coupled.ORGAN), "sides": TABLE, "touched": TABLE, "picks": CUBE, "starts": ARRAY,
        "matrix": TABLE, "gap": ARRAY, "active": form(ActiveSet),
        "wrench": (6,), "ways": (MOST_CONTACTS, 2, 3), "pulls": (MOST_CONTACTS, 3), "bears": (MOST_CONTACTS,),
        "loaded": (MOST_CONTACTS, 2), "renewed": int,
    }  # fmt: skip
    """The contacts, each with the state of a `Between`, and the organs that they share; for each contact its supports
    and bodies, and the loads of fingers on them; first candidate of each. Their problem: matrix [m/N], gaps [m]. Motion
    [m] of each patch: late, and by all but its friction; friction [N] on its first organ, and its normal force [N];
    number of loaded nodes."""
    shared = tuple(f"members.{k}.{name}" for k in range(MOST_CONTACTS) for name in Between.shared)

    def start(self) -> None:
        super(Between, self).start()
        try:
            given = json.loads(self.island)
            self._members = [Between(**each["settings"]) for each in given]
        except (ValueError, TypeError, KeyError):
            raise SettingError(
                "setting 'island': found no settings of contacts as JSON; use contact.Between, in place of which the "
                "loader puts this node, with both settings"
            ) from None
        if not 0 <= self.place < len(given) <= MOST_CONTACTS:
            raise SettingError(f"setting 'place': found {self.place} of {len(given)} contacts, expected 0 to "
                               f"{MOST_CONTACTS - 1}")  # fmt: skip
        sizes = []
        for k, member in enumerate(self._members):
            member.start()
            member.resize([member.first_organs, member.second_organs])
            member.make_follow()
            keep_columns(member.own, member._held, "", _loads_on(given, k))
            member.own["rides"] = member.own["floats"] = True
            # the node of another contact may run while this one is restarted
            member.own["waited"] = k != self.place or given[k].get("waits", True)
            sizes.append(len(member._held["rest"]))
            self.own["members"][k] = member.own
            for path, array in member._held.items():
                self._hold_at(k, path, array)
            self._hold_at(k, "rub.mobile", np.zeros((3, 3)))
        size = sum(sizes)
        picks = [load for each in given for load in each["loads"]]
        table = np.full((len(given), 2, max(map(len, picks), default=0)), -1, np.int32)
        for n, load in enumerate(picks):
            table[n // 2, n % 2, : len(load)] = load
        self.hold("picks", table)
        for name, key in (("sides", "supports"), ("touched", "bodies")):
            self.hold(name, np.array([each[key] for each in given], np.int32))
        self.hold("starts", np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64))
        self.hold("matrix", np.zeros((size, size)))
        self.hold("gap", np.zeros(size))
        self.hold("active", active_set(size))
        self._notes += self._members[self.place].notes()

    def _hold_at(self, k: int, path: str, array: np.ndarray) -> None:
        """Hold an array of a contact."""
        *groups, name = path.split(".")
        at = self.own["members"][k]
        for group in groups:
            at = at[group]
        self._hold(at, name, array, f"members.{k}.{path}")

    def resize(self, counts: list[int]) -> None:
        """Room for the fingers on each body."""
        member, size = self._members[self.place], len(self._held["gap"])
        member.resize(counts[:2])
        state = self.own["members"][self.place]
        most = [max(n, state[f"{name}_law"]["loaded"]) for n, name in zip(counts[:2], SIDES, strict=True)]
        keep_columns(state, self._held, f"members.{self.place}.", most)
        for name in ("opened", "again", "yields", "returns"):
            self._hold_at(self.place, name, member._held[name])
        self._hold_at(self.place, "along", np.zeros((2, len(member._held["along"][0]), size)))

    @ieee_kernel
    def compute(
        own,
        first: list[Load | None],
        second: list[Load | None],
        loads: list[Load | None],
        supports: list[Support | None],
        out: Out[OrganContact],
        dt,
    ):
        count, presses, rests = len(integers(own.sides)), out.first_pressing, out.second_pressing
        for k in range(count):
            m = own.members[k]
            others, along = floats(m.others), rub_of(m.rub).others
            if k != own.place:
                unknown = repeat_loads(own, k, 0, loads, others[0], along[0])
                unknown = unknown or repeat_loads(own, k, 1, loads, others[1], along[1])
            else:
                opened, again, slid = floats(m.opened), floats(m.again), floats(m.slid)
                one, two = side_of(m.one), side_of(m.two)
                unknown = take_loads(first, opened.shape[1] - 1, one, others[0], opened, presses, along[0], slid)
                unknown = unknown or take_loads(
                    second, again.shape[1] - 1, two, others[1], again, rests, along[1], slid
                )
            if unknown:
                own.fault = NO_VERTEX
                return
        begin(own, loads, supports, dt)
        out.left = solve(own, dt)
        m, active, begins = own.members[own.place], active_of(own.active), longs(own.starts)[own.place]
        pair, room, opened, again = pair_of(m.pair), floats(m.along), floats(m.opened), floats(m.again)
        contact.responses(pair, active, begins, 0, opened[0], opened[1], presses.values, dt, room, floats(m.yields))
        contact.responses(pair, active, begins, 1, again[0], again[1], rests.values, dt, room, floats(m.returns))
        for k in range(count):
            n = own.members[k]
            whole = finish(own, k, dt)
            if k == own.place:
                answer(n, pair_of(n.pair), rub_of(n.rub), side_of(n.one), side_of(n.two), floats(n.normals), out)
                put(out.resultant, whole)
                balance_late(n, out)
        send_ride(m, out)
        send_loads(m, out, int(own.loaded[own.place, 0]), int(own.loaded[own.place, 1]))

    def explain(self, fault: int, *messages: Any) -> Exception:
        return InputError(
            next(each for given in messages[:3] for each in given if each is not None),
            "a load of `first`, `second` or `loads` is on a vertex that the surface of its contact.Side lacks: give "
            "the node that spreads it the same surface",
        )  # fmt: skip

    def notes(self) -> list[str]:
        if hasattr(self, "_members"):
            member = self._members[self.place]
            member._record.view(np.uint8)[:] = (
                np.ascontiguousarray(self.known["members"][self.place]).reshape(1).view(np.uint8)
            )
            member._notes, member._noted, member._grown = self._notes, self._noted, self._grown
            return member.notes()
        return super(Between, self).notes()


def _loads_on(given: list[dict[str, Any]], k: int) -> list[int]:
    """How many loads of fingers, other organs and other contacts of an island the two bodies of contact k may bear."""
    return [
        len(given[k]["loads"][side])
        + sum(given[k]["bodies"][side] in other["bodies"] for n, other in enumerate(given) if n != k)
        + given[k]["settings"].get(f"{name}_organs", 0)
        for side, name in enumerate(SIDES)
    ]
