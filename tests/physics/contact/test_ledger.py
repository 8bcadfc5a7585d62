"""The books of a touch: closed paths over springs, friction, and a part that gives out energy on purpose."""

import math
from typing import Any, NamedTuple

import numpy as np
import pytest
from formulas import bristle_path, series_path
from hypothesis import given
from hypothesis import strategies as st
from pytest import approx

from palpate.messages import Contact, Force, Friction, Pose, Surface
from palpate.nodes.ledger import Energy
from palpate.physics.contact.series import energy, exponential
from palpate.physics.friction.coulomb import Coulomb
from palpate.physics.friction.lugre import LuGre

UP = (0.0, 0.0, 1.0)
NONE = (0.0, 0.0, 0.0)


class Moment(NamedTuple):
    """A touch by one finger at the end of a step; stored [J] in fingertip, tissue and friction, None: not reported."""

    place: Any
    force: Any
    normal: Any
    push: float
    compression: float
    indentation: float
    along: Any
    friction: Any
    stored: tuple[float | None, float | None, float | None]


class Books:
    """The node, given a touch moment by moment, and what it answers."""

    def __init__(self):
        self.node = Energy()
        self.node.start()

    def book(self, *now: Moment):
        tip, tissue, bristles = zip(*[[() if e is None else (e,) for e in m.stored] for m in now], strict=True)
        self.answer = self.node.step(
            [Force(force=m.force, state="contact", energy=0.0) for m in now],
            [
                Contact(foot=NONE, normal=m.normal, force=m.push, compression=m.compression, indentation=m.indentation,
                        compression_rate=0.0, indentation_rate=0.0, lateral_force=m.along, stored=held)
                for m, held in zip(now, tip, strict=True)
            ],
            [Pose(position=m.place, velocity=NONE, dt=1e-3) for m in now],
            [Friction(force=m.friction, bristle=NONE, stick=True, stored=held)
             for m, held in zip(now, bristles, strict=True)],
            Surface(nodes=[], displacement=np.zeros((0, 3)), stiffness=1.0, exponent=1.0, damping=0.0,
                    rest_indentation=0.0, previous_indentation=0.0, stored=tissue[0]),
        )  # fmt: skip

    def gap(self):
        self.answer = self.node.step([Force(force=NONE, state="free", energy=0.0)], [None], [None], [None], None)

    def generated(self, part):
        return self.node.generated(part)

    def __getattr__(self, name):
        return getattr(self.answer, name)


def spring(depths, stiffness=500.0, gain=0.0):
    """Books of a hand that moves along these depths [m] in a plain spring that is the tissue alone, of `gain` more
    force on the way out."""
    books, last = Books(), 0.0
    for s in depths:
        f = stiffness * s * (1.0 + gain * (s < last))
        held = 0.5 * stiffness * s * s
        books.book(Moment((0.0, 0.0, -s), (0.0, 0.0, f), UP, f, 0.0, s, NONE, NONE, (0.0, held, 0.0)))
        last = s
    return books


def there_and_back(count, depth=5e-3):
    return depth * np.sin(np.linspace(0.0, math.pi, count + 1))


def test_a_conservative_spring_has_no_balance_and_the_sampled_one_makes_what_theory_says():
    """Held over a step, K makes K|dx|^2 of which its own implicit step takes half: Colgate's b = K T/2."""
    for count in (100, 200, 400):
        depths = there_and_back(count)
        books, made = spring(depths), 500.0 * float(np.sum(np.diff(depths) ** 2))
        assert books.unexplained == approx(0.0, abs=1e-15) and books.controller == approx(0.0, abs=1e-15)
        assert books.sampling == approx(-made, rel=1e-12)
        assert books.tissue_dissipated == approx(0.5 * made, rel=1e-9)
        assert books.hand == approx(-0.5 * made, rel=1e-9)
        assert books.generated("tissue") == approx(0.0, abs=1e-15) and books.generated("display") == approx(
            0.5 * made, rel=1e-6
        )


def test_a_body_that_gives_out_more_than_it_took_is_told_by_name():
    books = spring(there_and_back(10000), gain=0.05)
    work = 0.5 * 500.0 * 5e-3**2
    assert books.generated_by in ("tissue", "display") and books.generated("tissue") == approx(0.05 * work, rel=0.02)


def test_a_debt_is_not_hidden_by_what_was_dissipated_before():
    """Ten presses that lose a tenth each, then one that gives out a fifth."""
    lossy = [s for _ in range(10) for s in there_and_back(100)]
    books, last = Books(), 0.0
    for k, s in enumerate([*lossy, *there_and_back(3000)]):
        gain = -0.1 if k < len(lossy) else 0.2
        f = 500.0 * s * (1.0 + gain * (s < last))
        books.book(Moment((0, 0, -s), (0, 0, f), UP, f, 0.0, s, NONE, NONE, (0.0, 250.0 * s * s, 0.0)))
        last = s
    assert books.tissue_dissipated > 0.0 and books.generated("tissue") == approx(0.2 * 250.0 * 5e-3**2, rel=0.03)


def test_a_part_that_does_not_tell_is_held_to_what_it_was_given():
    books = Books()
    for s in there_and_back(1000):
        f = 500.0 * s
        books.book(Moment((0, 0, -s), (0, 0, f), UP, f, 0.0, s, NONE, NONE, (0.0, None, 0.0)))
    assert books.tissue_stored == 0.0 and books.tissue_dissipated > 0.0 and books.generated("tissue") == 0.0


@pytest.mark.parametrize("law", [Coulomb(), LuGre(stribeck=1.0, mu_static=0.5, viscous=0.0)])
def test_friction_takes_the_force_times_the_way_less_what_its_bristles_hold(law):
    speed, dt, load = 0.05, 1e-3, 2.0
    force, z, _ = bristle_path(law, np.tile((speed, 0.0, 0.0), (400, 1)), load, dt)
    books = Books()
    for k, (f, bristle) in enumerate(zip(force, z, strict=True)):
        place, held = (speed * dt * k, 0.0, 0.0), law.stored(tuple(bristle), load)
        books.book(Moment(place, tuple(-f), UP, load, 0, 0, NONE, tuple(f), (0.0, 0.0, held)))
    slid = speed * dt * (len(force) - 1)
    held = law.stored(tuple(z[-1]), load)
    ends = float(np.sum(force[1:, 0])) * speed * dt
    assert books.friction_dissipated == approx(ends - held, abs=1e-12)
    assert books.friction_dissipated == approx(0.5 * load * slid, rel=0.05) and books.generated("friction") < 1e-12


@given(st.lists(st.floats(0.0, 0.012), min_size=3, max_size=40), st.sampled_from([1e-4, 1e-3, 1e-2]))
def test_fingertip_and_tissue_never_make_energy_whatever_the_path(approaches, dt):
    """Implicit steps: the dissipation of each grows, jumps of 12 mm included."""
    law = exponential(26.2641, 1681.06)
    f, s1, s2 = series_path([0.0, *approaches], dt, law, 8.0, 3e3, 1.5, 5.0)
    books = Books()
    for force, a, b in zip(f, s1, s2, strict=True):
        held = float(energy(a, *law)), 3e3 * max(b, 0.0) ** 2.5 / 2.5, 0.0
        books.book(Moment((0, 0, -a - b), (0, 0, force), UP, force, a, b, NONE, NONE, held))
    scale = max(1e-9, float(f.max()) * 0.012)
    assert books.generated("fingertip") <= 1e-9 * scale and books.generated("tissue") <= 1e-9 * scale


def test_books_do_not_depend_on_the_frame():
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    here, there = Books(), Books()
    rng = np.random.default_rng(4)
    for _ in range(50):
        x, f, a, t = rng.normal(size=(4, 3))
        n = rng.normal(size=3)
        n /= np.linalg.norm(n)
        rest = (1.0, *rng.random(2))
        here.book(Moment(tuple(x), tuple(f), tuple(n), *rest, tuple(a), tuple(t), (0.1, 0.2, 0.3)))
        x, f, n, a, t = (tuple(v @ turn.T) for v in (x, f, n, a, t))
        there.book(Moment(x, f, n, *rest, a, t, (0.1, 0.2, 0.3)))
    for name in ("hand", "controller", "sampling", "unexplained"):
        assert getattr(here, name) == approx(getattr(there, name), abs=1e-9)


def test_the_way_of_a_gap_is_nobodys():
    books = spring(there_and_back(10)[:6])
    before = books.hand
    books.gap()
    books.book(Moment((1.0, 0, 0), (9.0, 0, 0), UP, 0.0, 0, 0, NONE, NONE, (0.0, 0.0, 0.0)))
    assert books.hand == before


def test_two_fingers_on_coupled_springs_have_one_tissue_and_a_balance():
    """Two depths of a linear body with a compliance between them, pressed and let go one after the other: its work is
    the stored energy to first order in the step, and what is sampled is charged as for one."""
    compliance = np.array([[3.7e-3, 0.9e-3], [0.9e-3, 3.7e-3]])
    for count in (200, 400):
        pushes = np.zeros((count + 1, 2))
        pushes[:, 0] = np.sin(np.linspace(0.0, math.pi, count + 1))
        pushes[:, 1] = 0.5 * np.sin(np.linspace(-0.5, math.pi, count + 1)).clip(0.0)
        books = Books()
        for push in pushes:
            depth, held = compliance @ push, 0.5 * push @ compliance @ push
            books.book(
                *(Moment((0.0, 0.0, -s), (0.0, 0.0, f), UP, f, 0.0, s, NONE, NONE, (0.0, held, 0.0))
                  for s, f in zip(depth, push, strict=True))
            )  # fmt: skip
        assert books.unexplained == approx(0.0, abs=1e-15)
        rise = np.diff(pushes, axis=0)
        assert books.tissue_dissipated == approx(0.5 * np.einsum("ti,ij,tj->", rise, compliance, rise), rel=1e-9)
        assert books.generated("tissue") < 1e-15 and books.tissue_stored == approx(0.0, abs=1e-12)


def test_a_finger_that_generates_energy_is_named_though_another_dissipates_as_much():
    books = Books()
    for k in range(101):
        slid, rub = 1e-4 * k, (0.2, 0.0, 0.0)
        books.book(
            Moment((slid, 0.0, 0.0), NONE, UP, 1.0, 0.0, 0.0, NONE, rub, (0.0, 0.0, 0.0)),
            Moment((-slid, 0.0, 0.0), NONE, UP, 1.0, 0.0, 0.0, NONE, rub, (0.0, 0.0, 0.0)),
        )
    assert books.friction_dissipated == approx(0.0, abs=1e-15)
    assert books.generated("friction 2") == approx(2e-3) and books.generated("friction") == 0.0
    assert (books.generated_by, books.answer.generated) == ("friction 2", approx(2e-3))
