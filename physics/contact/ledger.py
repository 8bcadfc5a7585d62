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

import math

from palpate.physics.device.falcon import dot
from palpate.physics.kernel import kernel

FINGERS = 16  # at most
FINGERTIP, TISSUE, FRICTION, DISPLAY, MORE = range(5)
"""Rows of the accounts: of the first finger, then fingertip and friction of each further one."""
WORK, STORED, HIGHEST, GENERATED = range(4)
"""Columns [J]: what a part took up and stores, NaN where it does not report it; the most that it has dissipated; what
it has given out and cannot have had."""
PLACE, FORCE, ASKED, NORMAL, PUSH, COMPRESSION, INDENTATION, MOMENT = 0, 3, 6, 9, 12, 13, 14, 15
"""A finger at the end of a step: place [m] (3), force on the hand and G [N] (3 each), normal [1] (3), f_n [N], s1 and
s2 [m]; their number."""
RENDERED = 2  # of the sums, see `_works`; the last one is what all parts store

BOOKS = {
    "accounts": (MORE + 2 * (FINGERS - 1), 4), "rows": int,  # rows in use
    "fingers": int, "moments": int, "newest": int,  # how many moments the past holds, of how many fingers
    "sums": (7,), "hand": (), "controller": (), "sampling": (), "balance": (), "work": (), "left": (),
}  # fmt: skip
"""State of an energy account [J]; `work` and `left` are the hand's work and the balance of the last step. With it goes
`past`, (d + 2, FINGERS, MOMENT): the last moments, in a ring."""


@kernel
def begin(books, past, count):
    """Begin the next moment of so many fingers; whether it ends a step, which it does not after a gap."""
    books.newest = (books.newest + 1) % len(past)
    if books.fingers != count:
        books.fingers, books.moments = count, 0
    books.rows = max(books.rows, MORE + 2 * (count - 1))
    for i in range(6):
        books.sums[i] = -0.0  # to which any number adds up exactly, -0.0 too
    return books.moments > 0


@kernel
def take(books, past, finger, place, force, normal, push, compression, indentation, along, friction):
    """Store the moment of a finger; along [N] (3) a, friction [N] (3) f_t."""
    now = past[books.newest, finger]
    for i in range(3):
        now[PLACE + i], now[FORCE + i], now[NORMAL + i] = place[i], force[i], normal[i]
        now[ASKED + i] = push * normal[i] + along[i] - friction[i]
    now[PUSH], now[COMPRESSION], now[INDENTATION] = push, compression, indentation


@kernel
def book_finger(books, past, finger, along, friction, stored):
    """Book the step of a finger; stored [J] (3) in its fingertip, the tissue and its friction, NaN where unknown."""
    size, sums = len(past), books.sums
    works = _works(
        past[books.newest, finger], past[(books.newest - 1) % size, finger],
        past[(books.newest - books.moments) % size, finger], along, friction,
    )  # fmt: skip
    further = MORE + 2 * (finger - 1)
    _book(books.accounts[further if finger else FINGERTIP], works[3], stored[0])
    _book(books.accounts[further + 1 if finger else FRICTION], works[5], stored[2])
    for i in range(6):
        sums[i] += works[i]
    sums[6] = sums[6] + stored[0] + stored[2] if finger else 0.0 + stored[0] + stored[1] + stored[2]


@kernel
def end(books, past, stepped, tissue):
    """End the moment, after `book_finger` for each finger where it ends a step; tissue [J]: what that stores."""
    if not stepped:
        books.moments = 1
        return
    sums = books.sums
    hand, asked, rendered = sums[0], sums[1], sums[RENDERED]
    _book(books.accounts[TISSUE], sums[4], tissue)
    _book(books.accounts[DISPLAY], hand, sums[6])
    books.controller += hand - asked
    books.sampling += asked - rendered
    books.hand += hand
    books.work, books.left = hand, rendered - (0.0 + sums[3] + sums[4] + sums[5])
    books.balance += books.left
    books.moments = min(books.moments + 1, len(past) - 1)


@kernel
def _works(now, last, held, along, friction):
    """Of one finger in a step [J]: the hand's work, what was asked for and what was rendered of it, and the works on
    fingertip, tissue and friction. `held`: the moment that the force on the hand was computed from."""
    way = (now[PLACE] - last[PLACE], now[PLACE + 1] - last[PLACE + 1], now[PLACE + 2] - last[PLACE + 2])
    tip, deeper = now[COMPRESSION] - last[COMPRESSION], now[INDENTATION] - last[INDENTATION]
    rubbed = dot(friction, way)
    # Midway between the normals; a finger that came through the air pressed less than it moved.
    between = -0.5 * (dot(now[NORMAL:PUSH], way) + dot(last[NORMAL:PUSH], way))
    pressed = between if last[PUSH] > 0.0 else 0.0 + tip + deeper
    return (
        -dot(held[FORCE:ASKED], way), -dot(held[ASKED:NORMAL], way),
        now[PUSH] * pressed - dot(along, way) + rubbed, now[PUSH] * tip, now[PUSH] * deeper - dot(along, way), rubbed,
    )  # fmt: skip


@kernel
def _book(account, work, stored):
    """Book the work [J] of a step on a part, and what it stores at its end."""
    account[WORK] += work
    account[STORED] = stored
    if not math.isnan(stored):
        account[HIGHEST] = max(account[HIGHEST], account[WORK] - stored)


@kernel
def _stored(account):
    """What a part stores [J]; 0 where it does not report it."""
    return account[STORED] if abs(account[STORED]) > 0.0 else 0.0


@kernel
def totals(books, row):
    """Stored and dissipated energy [J] of the parts of all fingers: row of the first one's."""
    account = books.accounts[row]
    stored, dissipated = _stored(account), account[WORK] - _stored(account)
    if row != TISSUE:
        for more in range(MORE + (row == FRICTION), books.rows, 2):
            account = books.accounts[more]
            stored += _stored(account)
            dissipated += account[WORK] - _stored(account)
    return stored, dissipated


@kernel
def worst(books):
    """The row of the part that has generated most energy, and how much [J]; without a reported energy a part has
    generated what its work lacks."""
    row = 0
    for k in range(max(books.rows, MORE)):
        account = books.accounts[k]
        if math.isnan(account[STORED]):
            account[GENERATED] = max(-account[WORK], 0.0)
        else:
            account[GENERATED] = max(account[HIGHEST] - (account[WORK] - _stored(account)), 0.0)
        if account[GENERATED] > books.accounts[row, GENERATED]:
            row = k
    return row, books.accounts[row, GENERATED]
