"""Energy balance of a touch: the work of the hand, stored, dissipated and generated energy of each part.

A part (fingertip, tissue, friction) receives the work W and stores the energy V; the rest is dissipated,

    D = W - V,    dD >= 0

for every passive part: a decreasing D is generated energy. What a part stores at the first look, in a touch, or more
than before a gap, is work on it that was not seen. Over a step that ends at k the works are

    hand        -F_{k-1-d} . dx                       F [N] (3) on the hand, held over the step; d samples of delay
    controller  -(F - G)_{k-1-d} . dx                 G = f_n n + a - f_t, the force of contact and friction
    fingertip   f_n ds1       tissue  f_n ds2 - a . dx       friction  f_t . dx
    sampling    -(G_{k-1-d} - G_k) . dx               for d = 0 a spring K generates K |dx|^2 per step
    balance     hand - controller - sampling - parts; 0 except for the curvature of the surface over a step

with the forces f_n, a, f_t at the end of the step, as in the implicit step of the contact, so that dD >= 0 exactly for
a convex V. The display as a whole also counts as a part. Each finger has a fingertip and a friction; a coupled body
receives sum_i f_i ds2_i.

Organs that touch each other are one body, whose V is the sum of theirs. Their contacts are a part; the work on it,
W_c = -sum p.dw + F.dx, is dissipated or stored in the bristles (`physics.contact.organs`), and the organs receive the
rest of the work of the fingers.

An organ may move with its foundation by d (`physics.bodies.carried`). Positions are then those in its frame, x - d, in
which all works but that of the hand are the same; -F.d(x - d) is the work of hand and foundation together, of which the
foundation does F.dd. One that rotates by R about c (`physics.bodies.floating`) has the positions p = c + R'(x - d - c)
and forces in its frame, and does F.(R'dd + (R'(R + dR) - 1)(p - c)). Through contacts with other organs, the
foundations do the work W_d, which organs and contacts receive.

J. E. Colgate, G. G. Schenkel, J. Robotic Systems 14 (1997) 37-47: the work of a sampled wall. J. C. Willems, Arch.
Rational Mech. Anal. 45 (1972) 321-351: stored and supplied energy.
"""

import math

from palpate.compiler.dot import dot
from palpate.compiler.fields import element_type
from palpate.compiler.kernel import kernel
from palpate.physics.arrays import Array, Record, Vector3

FINGERS = 16  # at most
FINGERTIP, TISSUE, FRICTION, DISPLAY, MORE = range(5)
ORGANS = MORE + 2 * (FINGERS - 1)
"""Rows of the accounts: of the first finger, then fingertip and friction of each further one, last the contacts of
organs."""
ACCOUNT = {"work": (), "stored": (), "highest": (), "generated": ()}
"""Energies [J]: work on a part; stored energy, NaN if not reported; largest dissipation so far; generated energy."""
MOMENT = {
    "position": (3,), "force": (3,), "asked": (3,), "normal": (3,),  # [m]; [N] on the hand; G [N]; [1]
    "push": (), "compression": (), "indentation": (),  # f_n [N], s1 and s2 [m]
}  # fmt: skip
"""A finger at the end of a step."""
MOMENT_TYPE = element_type(MOMENT)
SUMS = {
    "hand": (), "asked": (), "rendered": (), "fingertip": (), "tissue": (), "friction": (), "stored": (), "unseen": (),
}  # fmt: skip
"""Sums over the fingers in a step [J]: works, see `_works`, the energy stored in all parts, and `look_at_finger`."""

LEDGER = {
    "accounts": (ORGANS + 1, ACCOUNT), "rows": int,  # rows in use, without `ORGANS`
    "fingers": int, "moments": int, "newest": int,  # fingers, moments in the ring `past`, index of the newest
    "sums": SUMS, "hand": (), "controller": (), "sampling": (), "balance": (), "work": (), "left": (),
    "between": (), "carried": (),  # work on the contacts of organs, and of foundations through them, since their start
}  # fmt: skip
"""State of an energy account [J]; `work` and `left` are the hand's work and the balance of the last step. The kernels
also take `past` (d + 2, FINGERS) of `MOMENT`, a ring buffer of the last moments."""


@kernel
def begin(ledger: Record, past: Record, count: int):
    """Begin the next moment with `count` fingers. Returns whether it ends a step; False after a gap."""
    ledger.newest = (ledger.newest + 1) % len(past)
    if ledger.fingers != count:
        ledger.fingers, ledger.moments = count, 0
    ledger.rows = max(ledger.rows, MORE + 2 * (count - 1))
    sums = ledger.sums  # -0.0 is the neutral element of addition, also for -0.0
    sums.hand = sums.asked = sums.rendered = sums.fingertip = sums.tissue = sums.friction = -0.0
    sums.unseen = 0.0
    return ledger.moments > 0


@kernel
def take(
    ledger: Record,
    past: Record,
    finger: int,
    place: Array,
    force: Array,
    normal: Array,
    push: float,
    compression: float,
    indentation: float,
    along: Vector3,
    friction: Vector3,
):
    """Store the moment of a finger; along [N] (3) a, friction [N] (3) f_t."""
    now = past[ledger.newest, finger]
    for i in range(3):
        now.position[i], now.force[i], now.normal[i] = place[i], force[i], normal[i]
        now.asked[i] = push * normal[i] + along[i] - friction[i]
    now.push, now.compression, now.indentation = push, compression, indentation


@kernel
def add_finger(ledger: Record, past: Record, finger: int, along: Vector3, friction: Vector3, stored: Vector3):
    """Account for the step of a finger; stored [J] (3) in its fingertip, the tissue and its friction, or NaN."""
    size, sums = len(past), ledger.sums
    hand, asked, rendered, tip, tissue, rubbed = _works(
        past[ledger.newest, finger], past[(ledger.newest - 1) % size, finger],
        past[(ledger.newest - ledger.moments) % size, finger], along, friction,
    )  # fmt: skip
    further = MORE + 2 * (finger - 1)
    _add_step(ledger.accounts[further if finger else FINGERTIP], tip, stored[0])
    _add_step(ledger.accounts[further + 1 if finger else FRICTION], rubbed, stored[2])
    sums.hand += hand
    sums.asked += asked
    sums.rendered += rendered
    sums.fingertip += tip
    sums.tissue += tissue
    sums.friction += rubbed
    _add_stored(sums, finger, stored)


@kernel
def look_at_finger(ledger: Record, finger: int, stored: Vector3):
    """In place of `add_finger` in a moment that ends no step, at the start and after a gap: what fingertip and friction
    of a finger store more than before is work that was not seen."""
    further = MORE + 2 * (finger - 1)
    tip = ledger.accounts[further if finger else FINGERTIP]
    ledger.sums.unseen += _look(tip, stored[0])
    ledger.sums.unseen += _look(ledger.accounts[further + 1 if finger else FRICTION], stored[2])
    _add_stored(ledger.sums, finger, stored)


@kernel
def _add_stored(sums: Record, finger: int, stored: Vector3):
    sums.stored = sums.stored + stored[0] + stored[2] if finger else 0.0 + stored[0] + stored[1] + stored[2]


@kernel
def _look(account: Record, stored: float):
    """Take what a part stores [J] without a step. Returns what it stores more, as work on it."""
    more = 0.0
    if not math.isnan(stored):
        more = max(stored - _stored_energy(account), 0.0)
        account.work += more
        account.stored = stored
    return more


@kernel
def carry(ledger: Record, past: Record, finger: int, moved: Vector3):
    """Work [J] of a foundation that moved by `moved` [m] (3) at a finger in the step that ends, with the force that
    acted on the hand. Before `end`."""
    return dot(past[(ledger.newest - ledger.moments) % len(past), finger].force, moved)


@kernel
def end(
    ledger: Record, past: Record, stepped: bool, tissue: float, others: float, between: float, held: float,
    carried: float,
):  # fmt: skip
    """End the moment, after `add_finger` or `look_at_finger` for each finger.

    tissue, others [J]  energy stored in the body, and in the organs that touch it; NaN if it is not reported
    between, held [J]   work on their contacts since the start, and energy stored in the bristles there
    carried [J]         work of moving foundations through these contacts since the start
    """
    given, ledger.between = between - ledger.between, between
    lent, ledger.carried = carried - ledger.carried, carried
    sums = ledger.sums
    if not stepped:
        ledger.moments = 1
        unseen = sums.unseen + _look(ledger.accounts[TISSUE], tissue + others)
        _look(ledger.accounts[ORGANS], held)
        _look(ledger.accounts[DISPLAY], sums.stored + others + held)
        if unseen > 0.0:
            ledger.left = -unseen
            ledger.balance += ledger.left
        return
    hand, asked, rendered = sums.hand, sums.asked, sums.rendered
    _add_step(ledger.accounts[TISSUE], sums.tissue - given + lent, tissue + others)
    _add_step(ledger.accounts[ORGANS], given, held)
    _add_step(ledger.accounts[DISPLAY], hand + lent, sums.stored + others + held)
    ledger.controller += hand - asked
    ledger.sampling += asked - rendered
    ledger.hand += hand
    ledger.work, ledger.left = hand, rendered - (0.0 + sums.fingertip + sums.tissue + sums.friction)
    ledger.balance += ledger.left
    ledger.moments = min(ledger.moments + 1, len(past) - 1)


@kernel
def _works(now: Record, last: Record, held: Record, along: Vector3, friction: Vector3):
    """Works [J] of one finger in a step: of the hand, of the delayed G, of the present G, and on fingertip, tissue and
    friction. `held` is the moment from which the force on the hand was computed."""
    here, there = now.position, last.position
    motion = (here[0] - there[0], here[1] - there[1], here[2] - there[2])
    tip, deeper = now.compression - last.compression, now.indentation - last.indentation
    rubbed = dot(friction, motion)
    # along the mean normal; the part of the motion before first touch does not press
    between = -0.5 * (dot(now.normal, motion) + dot(last.normal, motion))
    pressed = between if last.push > 0.0 else 0.0 + tip + deeper
    return (
        -dot(held.force, motion), -dot(held.asked, motion),
        now.push * pressed - dot(along, motion) + rubbed, now.push * tip,
        now.push * deeper - dot(along, motion), rubbed,
    )  # fmt: skip


@kernel
def _add_step(account: Record, work: float, stored: float):
    """Add the work [J] of a step on a part, and set the energy [J] stored at its end."""
    account.work += work
    account.stored = stored
    if not math.isnan(stored):
        account.highest = max(account.highest, account.work - stored)


@kernel
def _stored_energy(account: Record):
    """Stored energy [J] of a part; 0 if it does not report it."""
    return account.stored if abs(account.stored) > 0.0 else 0.0


@kernel
def totals(ledger: Record, row: int):
    """Stored and dissipated energy [J], summed over all fingers; `row` is that of the first finger's part."""
    account = ledger.accounts[row]
    stored, dissipated = _stored_energy(account), account.work - _stored_energy(account)
    if row != TISSUE:
        for more in range(MORE + (row == FRICTION), ledger.rows, 2):
            account = ledger.accounts[more]
            stored += _stored_energy(account)
            dissipated += account.work - _stored_energy(account)
    return stored, dissipated


@kernel
def worst(ledger: Record):
    """The row of the part that has generated the most energy, and that energy [J]. For a part that does not report its
    stored energy it is the negative work on it."""
    row, rows = 0, max(ledger.rows, MORE)
    for place in range(rows + 1):
        k = place if place < rows else ORGANS
        account = ledger.accounts[k]
        if math.isnan(account.stored):
            account.generated = max(-account.work, 0.0)
        else:
            account.generated = max(account.highest - (account.work - _stored_energy(account)), 0.0)
        if account.generated > ledger.accounts[row].generated:
            row = k
    return row, ledger.accounts[row].generated
