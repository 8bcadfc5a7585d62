"""Energy account of a touch: what the hand puts in, what each part holds, and what none of them can have given.

A part (fingertip, tissue, friction) takes up work W and holds the energy V; the rest is dissipated,

    D = W - V,    dD >= 0

whatever the part does: a D that falls is energy made. Over a step that ends at k the works are

    hand        -F_{k-1-d} . dx                       F [N] (3) on the hand, held over the step; d samples of delay
    controller  -(F - G)_{k-1-d} . dx                 G = f_n n + a - f_t, what contact and friction ask for
    fingertip   f_n ds1       tissue  f_n ds2 - a . dx       friction  f_t . dx
    sampling    G_{k-1-d} where the parts take G_k; a spring K makes K |dx|^2 a step
    balance     hand - controller - sampling - parts; 0 but for the curvature of the surface over a step

with the forces f_n, a, f_t at the step's end, as the contact's own implicit step has them: a convex V then has dD >= 0
exactly. The display as a whole is judged as a part is. Each finger has a fingertip and a friction; a coupled body takes
up sum_i f_i ds2_i.

J. E. Colgate, G. G. Schenkel, J. Robotic Systems 14 (1997) 37-47: the work of a sampled wall. J. C. Willems, Arch.
Rational Mech. Anal. 45 (1972) 321-351: stored and supplied energy.
"""

from collections import deque
from collections.abc import Iterable
from functools import reduce
from operator import add
from typing import NamedTuple

Vector = tuple[float, float, float]


class Account:
    """What one part took up and holds [J], and the most that it has given beyond that since any earlier moment."""

    __slots__ = ("_highest", "stored", "work")

    def __init__(self) -> None:
        self.work = 0.0
        self.stored: float | None = 0.0
        self._highest = 0.0

    def book(self, work: float, stored: float | None) -> None:
        """Work [J] of a step, and what is held at its end."""
        self.work += work
        self.stored = stored
        if stored is not None:
            self._highest = max(self._highest, self.work - stored)

    @property
    def dissipated(self) -> float:
        """D [J]; without a told energy all the work counts."""
        return self.work - (self.stored or 0.0)

    @property
    def generated(self) -> float:
        """Energy [J] that the part has given out and cannot have had."""
        return max(self._highest - self.dissipated, 0.0) if self.stored is not None else max(-self.work, 0.0)


class Moment(NamedTuple):
    """A touch by one finger at the end of a step.

    compression, indentation [m] s1, s2   along [N] (3) a   friction [N] (3) f_t
    stored [J] of fingertip, tissue and friction; None where one does not tell. All fingers have the same tissue
    """

    place: Vector  # [m] (3) of the finger
    force: Vector  # [N] (3) on the hand
    normal: Vector  # [1] (3)
    push: float  # [N] f_n
    compression: float
    indentation: float
    along: Vector
    friction: Vector
    stored: tuple[float | None, float | None, float | None]

    @property
    def asked(self) -> Vector:
        """G [N] (3)."""
        (n, m, o), (a, b, c), (p, q, r) = self.normal, self.along, self.friction
        return self.push * n + a - p, self.push * m + b - q, self.push * o + c - r


NAMES = "fingertip", "tissue", "friction", "display"


class EnergyAccount:
    """The accounts of a run.

    delay  samples d between the place that a force was computed from and the way that it does its work on
    """

    def __init__(self, delay: int = 0) -> None:
        self._parts = {name: Account() for name in NAMES}
        self.fingertip, self.tissue, self.friction, self.display = self._parts.values()
        self.controller = self.sampling = self.balance = self.hand = 0.0
        self.step = (0.0, 0.0)  # [J] hand's work and balance of the last step
        self._past: deque[tuple[Moment, ...]] = deque(maxlen=delay + 1)

    def gap(self) -> None:
        """The touch was lost: the way to the next moment is nobody's."""
        self._past.clear()

    def book(self, *now: Moment) -> None:
        """Book the step of all fingers from the last moment to this one; the first one books what is held."""
        if not self._past or len(self._past[0]) != len(now):
            self._past.clear()
            self._past.append(now)
            return
        steps = []
        for i, finger in enumerate(zip(now, self._past[-1], self._past[0], strict=True)):
            steps.append(_works(*finger))
            for name, work, stored in zip(("fingertip", "friction"), steps[-1][3::2], now[i].stored[::2], strict=True):
                self._parts.setdefault(f"{name} {i + 1}" if i else name, Account()).book(work, stored)
        hand, asked, rendered, *parts = (reduce(add, works) for works in zip(*steps, strict=True))
        self.tissue.book(parts[1], now[0].stored[1])
        held = [*now[0].stored, *(stored for finger in now[1:] for stored in finger.stored[::2])]
        told = [stored for stored in held if stored is not None]
        self.display.book(hand, sum(told) if len(told) == len(held) else None)
        self.controller += hand - asked
        self.sampling += asked - rendered
        self.hand += hand
        self.step = hand, rendered - sum(parts)
        self.balance += self.step[1]
        self._past.append(now)

    def part(self, name: str) -> Account:
        """One of the accounts by its name: fingertip, tissue, friction, display; of more fingers `fingertip 2`."""
        return self._parts[name]

    def stored(self, kind: str) -> float:
        """What the parts of all fingers of one kind hold [J]; 0 for those that do not tell."""
        return reduce(add, [account.stored or 0.0 for account in self._all(kind)])

    def dissipated(self, kind: str) -> float:
        """What the parts of all fingers of one kind have dissipated [J]."""
        return reduce(add, [account.dissipated for account in self._all(kind)])

    def _all(self, kind: str) -> Iterable[Account]:
        return [account for name, account in self._parts.items() if name.partition(" ")[0] == kind]

    def worst(self) -> tuple[str, float]:
        """The part that has made most energy, and how much [J]."""
        made = {name: account.generated for name, account in self._parts.items()}
        name = max(made, key=lambda each: made[each])
        return name, made[name]


def _works(now: Moment, last: Moment, held: Moment) -> tuple[float, float, float, float, float, float]:
    """Of one finger in a step [J]: the hand's work, what was asked for and what was rendered of it, and the works on
    fingertip, tissue and friction. `held`: the moment that the force on the hand was computed from."""
    way = _less(now.place, last.place)
    deeper = now.compression - last.compression, now.indentation - last.indentation
    hand, asked = -_dot(held.force, way), -_dot(held.asked, way)
    tip, tissue, friction = (
        now.push * deeper[0], now.push * deeper[1] - _dot(now.along, way), _dot(now.friction, way),
    )  # fmt: skip
    # Midway between the normals; a finger that came through the air pressed less than it moved.
    between = -0.5 * (_dot(now.normal, way) + _dot(last.normal, way))
    pressed = between if last.push > 0.0 else sum(deeper)
    return hand, asked, now.push * pressed - _dot(now.along, way) + friction, tip, tissue, friction


def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _less(a: Vector, b: Vector) -> Vector:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]
