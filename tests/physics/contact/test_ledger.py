"""The energy balance of a touch: closed paths over springs, friction, and a part that generates energy on purpose."""

import math
from typing import Any, NamedTuple

import msgspec
import numpy as np
import pytest
from formulas import bristle_path, series_path
from hypothesis import given
from hypothesis import strategies as st
from pytest import approx

from palpate.messages import Contact, Force, Friction, Pose, Surface
from palpate.messages.contact import OrganContact
from palpate.nodes.ledger import Energy
from palpate.physics.contact import ledger
from palpate.physics.contact.series import exponential, series_energy
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


class Balance:
    """The node, fed with a touch step by step, and its messages."""

    def __init__(self):
        self.node = Energy()
        self.node.start()

    def add(self, *now: Moment, others=(), between=()):
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
            [*others], [*between],
        )  # fmt: skip

    def gap(self):
        self.answer = self.node.step([Force(force=NONE, state="free", energy=0.0)], [None], [None], [None], None)

    def generated(self, part):
        return self.node.generated_energy(part)

    def __getattr__(self, name):
        return getattr(self.answer, name)


def spring(depths, stiffness=500.0, gain=0.0):
    """Energy balance of a hand that moves along these depths [m] in a spring without fingertip, whose force is larger
    by the fraction `gain` during unloading."""
    balance, last = Balance(), 0.0
    for s in depths:
        f = stiffness * s * (1.0 + gain * (s < last))
        held = 0.5 * stiffness * s * s
        balance.add(Moment((0.0, 0.0, -s), (0.0, 0.0, f), UP, f, 0.0, s, NONE, NONE, (0.0, held, 0.0)))
        last = s
    return balance


def there_and_back(count, depth=5e-3):
    return depth * np.sin(np.linspace(0.0, math.pi, count + 1))


def test_a_spring_closes_the_balance_and_its_sampling_generates_the_theoretical_energy():
    """A spring K with a force held over a step generates K|dx|^2, of which its implicit step dissipates half: Colgate's
    b = K T/2."""
    for count in (100, 200, 400):
        depths = there_and_back(count)
        balance, made = spring(depths), 500.0 * float(np.sum(np.diff(depths) ** 2))
        assert balance.unexplained == approx(0.0, abs=1e-15) and balance.controller == approx(0.0, abs=1e-15)
        assert balance.sampling == approx(-made, rel=1e-12)
        assert balance.tissue_dissipated == approx(0.5 * made, rel=1e-9)
        assert balance.hand == approx(-0.5 * made, rel=1e-9)
        assert balance.generated("tissue") == approx(0.0, abs=1e-15) and balance.generated("display") == approx(
            0.5 * made, rel=1e-6
        )


def test_a_body_that_generates_energy_is_named():
    balance = spring(there_and_back(10000), gain=0.05)
    work = 0.5 * 500.0 * 5e-3**2
    assert balance.generated_by in ("tissue", "display") and balance.generated("tissue") == approx(
        0.05 * work, rel=0.02
    )


def test_earlier_dissipation_does_not_hide_generated_energy():
    """Ten presses that each dissipate 10 %, then one that generates 20 %."""
    lossy = [s for _ in range(10) for s in there_and_back(100)]
    balance, last = Balance(), 0.0
    for k, s in enumerate([*lossy, *there_and_back(3000)]):
        gain = -0.1 if k < len(lossy) else 0.2
        f = 500.0 * s * (1.0 + gain * (s < last))
        balance.add(Moment((0, 0, -s), (0, 0, f), UP, f, 0.0, s, NONE, NONE, (0.0, 250.0 * s * s, 0.0)))
        last = s
    assert balance.tissue_dissipated > 0.0 and balance.generated("tissue") == approx(0.2 * 250.0 * 5e-3**2, rel=0.03)


def test_a_part_without_reported_energy_must_not_return_more_than_it_received():
    balance = Balance()
    for s in there_and_back(1000):
        f = 500.0 * s
        balance.add(Moment((0, 0, -s), (0, 0, f), UP, f, 0.0, s, NONE, NONE, (0.0, None, 0.0)))
    assert balance.tissue_stored == 0.0 and balance.tissue_dissipated > 0.0 and balance.generated("tissue") == 0.0


@pytest.mark.parametrize(
    "law", [Coulomb(stiffness=1500.0, damping=0.0), LuGre(stribeck=1.0, mu_static=0.5, viscous=0.0)]
)
def test_friction_dissipates_the_work_minus_the_energy_of_the_bristles(law):
    speed, dt, load = 0.05, 1e-3, 2.0
    force, z, _ = bristle_path(law, np.tile((speed, 0.0, 0.0), (400, 1)), load, dt)
    balance = Balance()
    for k, (f, bristle) in enumerate(zip(force, z, strict=True)):
        place, held = (speed * dt * k, 0.0, 0.0), law.stored(tuple(bristle), load)
        balance.add(Moment(place, tuple(-f), UP, load, 0, 0, NONE, tuple(f), (0.0, 0.0, held)))
    slid = speed * dt * (len(force) - 1)
    held = law.stored(tuple(z[-1]), load) - law.stored(tuple(z[0]), load)  # since the first look
    ends = float(np.sum(force[1:, 0])) * speed * dt
    assert balance.friction_dissipated == approx(ends - held, abs=1e-12)
    assert balance.friction_dissipated == approx(0.5 * load * slid, rel=0.05) and balance.generated("friction") < 1e-12


@given(st.lists(st.floats(0.0, 0.012), min_size=3, max_size=40), st.sampled_from([1e-4, 1e-3, 1e-2]))
def test_fingertip_and_tissue_never_generate_energy_on_any_path(approaches, dt):
    """Implicit steps: the dissipation of each grows, jumps of 12 mm included."""
    law = exponential(26.2641, 1681.06)
    f, s1, s2 = series_path([0.0, *approaches], dt, law, 8.0, 3e3, 1.5, 5.0)
    balance = Balance()
    for force, a, b in zip(f, s1, s2, strict=True):
        held = float(series_energy(a, *law)), 3e3 * max(b, 0.0) ** 2.5 / 2.5, 0.0
        balance.add(Moment((0, 0, -a - b), (0, 0, force), UP, force, a, b, NONE, NONE, held))
    scale = max(1e-9, float(f.max()) * 0.012)
    assert balance.generated("fingertip") <= 1e-9 * scale and balance.generated("tissue") <= 1e-9 * scale


def test_the_balance_does_not_depend_on_the_frame():
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    here, there = Balance(), Balance()
    rng = np.random.default_rng(4)
    for _ in range(50):
        x, f, a, t = rng.normal(size=(4, 3))
        n = rng.normal(size=3)
        n /= np.linalg.norm(n)
        rest = (1.0, *rng.random(2))
        here.add(Moment(tuple(x), tuple(f), tuple(n), *rest, tuple(a), tuple(t), (0.1, 0.2, 0.3)))
        x, f, n, a, t = (tuple(v @ turn.T) for v in (x, f, n, a, t))
        there.add(Moment(x, f, n, *rest, a, t, (0.1, 0.2, 0.3)))
    for name in ("hand", "controller", "sampling", "unexplained"):
        assert getattr(here, name) == approx(getattr(there, name), abs=1e-9)


def test_motion_in_a_gap_is_attributed_to_no_part():
    balance = spring(there_and_back(10)[:6])
    before = balance.hand
    balance.gap()
    balance.add(Moment((1.0, 0, 0), (9.0, 0, 0), UP, 0.0, 0, 0, NONE, NONE, (0.0, 0.0, 0.0)))
    assert balance.hand == before


@pytest.mark.parametrize("seen", [True, False])
def test_what_is_stored_at_the_first_look_or_was_stored_in_a_gap_is_not_generated(seen):
    """A ledger that began at 10 mm of a spring counted its 25 mJ as generated, above its bound. The spring returns it;
    a body that gives more is still named."""
    for gain in (0.0, 0.1):
        balance, last = Balance(), 0.01
        if not seen:
            balance.add(Moment((0, 0, 0), NONE, UP, 0.0, 0.0, 0.0, NONE, NONE, (0.0, 0.0, 0.0)))
            balance.gap()
        for s in np.linspace(0.01, 0.0, 101):
            f = 500.0 * s * (1.0 + gain * (s < last))
            balance.add(Moment((0, 0, -s), (0, 0, f), UP, f, 0.0, s, NONE, NONE, (0.0, 250.0 * s * s, 0.0)))
            if s == last:
                assert balance.tissue_stored == approx(0.025) and balance.tissue_dissipated == 0.0
                assert balance.unexplained == approx(-0.025)
        assert balance.tissue_dissipated == approx(-gain * 0.025 + 0.00025, rel=0.02)  # steps of 0.1 mm dissipate 1 %
        assert (balance.generated("tissue") > 1e-3) == (gain > 0.0)
        assert not balance.tripped and balance.hand < -0.024


def test_two_fingers_on_coupled_springs_share_the_tissue_in_a_closed_balance():
    """Two coupled depths of a linear body, loaded and unloaded one after the other: the work is the stored energy to
    first order in the step, and the loss by sampling is that of one finger."""
    compliance = np.array([[3.7e-3, 0.9e-3], [0.9e-3, 3.7e-3]])
    for count in (200, 400):
        pushes = np.zeros((count + 1, 2))
        pushes[:, 0] = np.sin(np.linspace(0.0, math.pi, count + 1))
        pushes[:, 1] = 0.5 * np.sin(np.linspace(-0.5, math.pi, count + 1)).clip(0.0)
        balance = Balance()
        for push in pushes:
            depth, held = compliance @ push, 0.5 * push @ compliance @ push
            balance.add(
                *(Moment((0.0, 0.0, -s), (0.0, 0.0, f), UP, f, 0.0, s, NONE, NONE, (0.0, held, 0.0))
                  for s, f in zip(depth, push, strict=True))
            )  # fmt: skip
        assert balance.unexplained == approx(0.0, abs=1e-15)
        rise = np.diff(pushes, axis=0)
        assert balance.tissue_dissipated == approx(0.5 * np.einsum("ti,ij,tj->", rise, compliance, rise), rel=1e-9)
        assert balance.generated("tissue") < 1e-15 and balance.tissue_stored == approx(0.0, abs=1e-12)


def test_a_finger_that_generates_energy_is_named_even_if_another_dissipates_it():
    balance = Balance()
    for k in range(101):
        slid, rub = 1e-4 * k, (0.2, 0.0, 0.0)
        balance.add(
            Moment((slid, 0.0, 0.0), NONE, UP, 1.0, 0.0, 0.0, NONE, rub, (0.0, 0.0, 0.0)),
            Moment((-slid, 0.0, 0.0), NONE, UP, 1.0, 0.0, 0.0, NONE, rub, (0.0, 0.0, 0.0)),
        )
    assert balance.friction_dissipated == approx(0.0, abs=1e-15)
    assert balance.generated("friction 2") == approx(2e-3) and balance.generated("friction") == 0.0
    assert (balance.generated_by, balance.answer.generated) == ("friction 2", approx(2e-3))


def organ(stored):
    return Surface(nodes=[], displacement=np.zeros((0, 3)), stiffness=1.0, exponent=1.0, damping=0.0,
                   rest_indentation=0.0, previous_indentation=0.0, stored=(stored,))  # fmt: skip


def organs(dissipated, generated=0.0, **more):
    return msgspec.structs.replace(OrganContact.example(False), dissipated=dissipated, generated=generated, **more)


def pressed_into_a_neighbour(depths, gap=1e-3, known=True, lost=0.0):
    """A finger on a spring of 500 N/m, which meets one of 300 N/m behind it after `gap` [m]: it then yields as both.
    The contact of the springs dissipates `lost` [J] per step while they touch, which the finger pays.

    known  whether the balance gets the second spring and the contact
    """
    balance, paid, given = Balance(), 0.0, 0.0
    for s in depths:
        second = max(s - gap, 0.0)
        f = 500.0 * s + 300.0 * second
        paid += lost if second > 0.0 else 0.0
        more = {"others": [organ(150.0 * second**2)], "between": [organs(max(paid, 0.0), max(-paid, 0.0))]}
        moment = Moment((0.0, 0.0, -s), (0.0, 0.0, f), UP, f, 0.0, s, NONE, NONE, (0.0, 250.0 * s * s, 0.0))
        balance.add(moment, **more if known else {})
        given = max(given, balance.node.generated_energy("tissue"))
    return balance, given


def test_organs_that_touch_count_as_one_body():
    """Pressed in and back, the second spring takes 150 N/m (3 mm)² = 1.35 mJ and returns it. Without it in the balance
    this counts as dissipated, then as generated. With a step h the force at its end does 800 N/m h²/2 more than the
    energy that the springs store, and as much less on the way back."""
    steps, h = np.linspace(0.0, 4e-3, 4001), 1e-6
    path = np.concatenate([steps, steps[::-1]])
    balance, given = pressed_into_a_neighbour(path)
    excess = 4000 * 0.5 * 800.0 * h * h
    assert given <= 2 * excess and balance.tissue_stored == 0.0
    half, _ = pressed_into_a_neighbour(steps)
    assert half.tissue_stored == approx(250.0 * 4e-3**2 + 150.0 * 3e-3**2, rel=1e-12)
    assert half.hand == approx(half.tissue_stored, rel=1e-3)
    _, given = pressed_into_a_neighbour(path, known=False)
    assert given == approx(1.35e-3, rel=1e-2)


def test_what_the_contact_of_organs_dissipates_is_no_gain_and_what_it_generates_is_found():
    path = np.concatenate([np.linspace(0.0, 4e-3, 401), np.linspace(4e-3, 0.0, 401)])
    steps = int((path > 1e-3).sum())
    passive, _ = pressed_into_a_neighbour(path, lost=1e-7)
    assert passive.generated("contact of organs") == 0.0
    still, _ = pressed_into_a_neighbour(path)
    assert passive.tissue_dissipated == approx(still.tissue_dissipated, abs=1e-15)
    active, _ = pressed_into_a_neighbour(path, lost=-1e-5)
    assert active.generated("contact of organs") == approx(steps * 1e-5, rel=1e-9)
    assert active.generated_by == "contact of organs"


def contact_of(steps, first=1):
    """A contact that dissipates 1 mJ and takes 3 mJ from a foundation per step, and then stores 0.5 mJ."""
    return [organs(1e-3 * k, stored=5e-4, carried=np.array([3e-3 * k]), steps=k) for k in range(first, first + steps)]


@pytest.mark.parametrize("course, lost, carried", [
    (contact_of(12), 12, 12),
    (contact_of(6) + [None] * 3 + contact_of(6), 12, 12),  # killed, and restarted
    (contact_of(6) + contact_of(6), 12, 12),  # restarted between two steps of the ledger
    (contact_of(6) + [None] * 3 + contact_of(6, 10), 15, 15),  # late
    (contact_of(6) + [None] * 6, 6, 6),  # dead
    ([None] * 3 + contact_of(6, 40), 5, 5),  # before it is seen, it may have done anything
])  # fmt: skip
def test_a_contact_of_organs_that_dies_or_is_restarted_keeps_what_it_dissipated(course, lost, carried):
    """By the sums of the messages: as much is dissipated as the contact has; bristles that it loses add what they had
    stored, 0.5 mJ each."""
    balance, touch = Balance(), Moment(NONE, NONE, UP, 1.0, 0.0, 0.0, NONE, NONE, (0.0, 0.0, 0.0))
    balance.add(touch, others=[organ(0.0)], between=[None])
    for each in course:
        balance.add(touch, others=[organ(0.0)], between=[each])
    account = balance.node.own["account"]["accounts"][ledger.ORGANS]
    restarts = sum(each is not None and each.steps == 1 for each in course) - 1
    ends = course[-1] is None
    assert account["work"] - account["stored"] == approx(1e-3 * lost + 5e-4 * (max(restarts, 0) + ends), rel=1e-9)
    assert balance.answer.carried[0] == approx(3e-3 * carried, rel=1e-9)
    assert balance.generated("contact of organs") == 0.0


@pytest.mark.parametrize("rigidity", [0.0, 200.0])
def test_the_energies_of_organs_that_rub_sum_to_the_work_of_the_hand(rigidity):
    """A finger presses a spring of 500 N/m, and bristles of this stiffness [N/m] between it and a neighbour stretch
    with it: the sum of all energies in the message is the work, also on the way back, where the bristles return it."""
    balance, path = Balance(), np.linspace(0.0, 4e-3, 401)
    for s in [*path, *path[::-1]]:
        held = 0.5 * rigidity * s * s
        f = (500.0 + rigidity) * s
        moment = Moment((0.0, 0.0, -s), (0.0, 0.0, f), UP, f, 0.0, s, NONE, NONE, (0.0, 250.0 * s * s, 0.0))
        balance.add(moment, others=[organ(0.0)], between=[organs(0.0, stored=held)])
        stored = balance.fingertip_stored + balance.tissue_stored + balance.friction_stored
        lost = balance.fingertip_dissipated + balance.tissue_dissipated + balance.friction_dissipated
        taken = balance.hand - balance.controller - balance.sampling - balance.unexplained
        assert stored == approx(250.0 * s * s + held, rel=1e-12)
        assert stored + lost == approx(taken, rel=1e-12, abs=1e-15)
