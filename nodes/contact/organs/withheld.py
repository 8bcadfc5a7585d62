"""How two organs close a gap that no motion closed: where their contact joins a run, and after a leap of an organ.

A contact that is restarted, or begins late, finds organs that overlap: its bodies are not deformed yet. An organ leaps
if its support is restarted, or if messages of it are lost. The overlap, in one step, would be a rate of closing at
which viscous bodies push with many times the force at rest. So it is withheld from all gaps, and returns as the
approach of a finger does after an outage (`finger`): the contact begins without force, as at the start of a run, or
continues with the force before the leap.

Organs that forces move, and no finger, wait for their contact, and so stay where it held them. Without its force they
would sink, and be lifted again by energy that no one gives. So it begins with the force under which its bodies are at
rest there (`_bear`): it gives no energy. So do the copies of other contacts in a `contact.Coupled`, which may have run
meanwhile: they have the forces of the others, or soon. Organs that moved meanwhile would be thrown apart.
"""

import numpy as np

from palpate.compiler.records import floats, nth, vector
from palpate.nodes.base.kernels import ieee_kernel, kernel
from palpate.nodes.contact.finger import regained
from palpate.nodes.contact.placed import track_of
from palpate.physics.bodies.floating.turning import spin
from palpate.physics.contact.organs.pivoting import add_rows, complement

LEAST, TURNED = 1e-5, 2e-4  # [m], [rad] of a leap
FASTER = 2.0  # [1] motion between two messages over that at the velocity of the second one from which it is a leap


@kernel
def joins_run(steps, messages):
    """Whether a contact that made `steps` steps begins in the middle of a run, by the messages of an input."""
    for i in range(messages.count):
        if nth(messages, i).there and nth(messages, i).tick > 0:
            return steps == 0
    return False


@kernel
def leaps(own, side, messages, i):
    """Before the place of an organ is taken from message i of an input, -1: it has none: whether the organ was moved
    there otherwise than with its velocity. A message that a node outside a graph sends has no time, and no leap."""
    if i < 0 or i >= messages.count or not nth(messages, i).there or nth(messages, i).time < 0:
        return False
    given, ride, way, rate = nth(messages, i), own.ride[side], 0.0, 0.0
    time, last = 1e-9 * given.time, own.heard[side]
    own.heard[side] = time
    if not time > last:
        return False
    usual = own.usual[side] if own.usual[side] > 0.0 else time - last
    own.usual[side] = usual = min(usual, time - last)
    for x in range(3):
        way += (given.displacement[x] - (ride.at[x] if own.rides else own.supports[side, x])) ** 2
        rate += given.velocity[x] ** 2
    if np.sqrt(way) > FASTER * usual * np.sqrt(rate) + LEAST:
        return True
    if given.rotation.shape[0] == 0:
        return False
    turn, now, spins = vector(ride.turn), floats(given.rotation), floats(given.spin)
    about = spin(turn, (now[0] - turn[0], now[1] - turn[1], now[2] - turn[2]))
    way, rate = about[0] ** 2 + about[1] ** 2 + about[2] ** 2, spins[0] ** 2 + spins[1] ** 2 + spins[2] ** 2
    return np.sqrt(way) > FASTER * usual * np.sqrt(rate) + TURNED


@ieee_kernel
def withhold(own, pair, rub, joins, leapt, dt):
    """Before a step of organs that may move, at their places: let the bodies of a contact that `joins` a run be at rest
    under all other loads, withhold what overlaps then or after a leap, and return the next part of it. If the organs
    waited for the contact, they are also at rest under it, and nothing is withheld."""
    track = track_of(own.track)
    if len(track.cell) == 0:
        return
    if joins:
        _rest(pair, rub, floats(own.others))
    if joins and own.waited:
        _bear(pair, rub)
    elif joins or leapt:
        least = 0.0
        for i in range(len(pair.gap)):
            least = min(least, pair.gap[i] + (pair.moved[0, i] + pair.moved[1, i]))
        _open(own, track, pair, -least)
    elif own.withheld > 0.0:
        _open(own, track, pair, regained(own.withheld, dt) - own.withheld)
    if joins:
        for i in range(len(pair.gap)):
            pair.opening[i] = pair.gap[i] + (pair.moved[0, i] + pair.moved[1, i])


@kernel
def _rest(pair, rub, others):
    """Let both bodies be at rest without the contact."""
    for body in range(2):
        for i in range(len(pair.gap)):
            pair.moved[body, i] = others[body, i]
        for i in range(len(rub.moved[body])):
            rub.moved[body, i] = rub.others[body, i]


@ieee_kernel
def _bear(pair, rub):
    """Let both bodies, at rest without the contact, also be at rest under it: fills its forces."""
    matrix, free, moved = pair.matrix, pair.free, pair.moved
    for i in range(len(free)):
        free[i] = pair.gap[i] + (moved[0, i] + moved[1, i])
        for j in range(len(free)):
            matrix[i, j] = pair.first[i, j] + pair.second[i, j]
    complement(matrix, free, pair.active, 2 * len(free))
    add_rows(pair.first, pair.active, 1.0, moved[0])
    add_rows(pair.second, pair.active, 1.0, moved[1])
    if len(rub.touched) > 0:
        add_rows(rub.first, pair.active, 1.0, rub.moved[0])
        add_rows(rub.second, pair.active, 1.0, rub.moved[1])


@kernel
def _open(own, track, pair, by):
    """Withhold more [m]: a change of the gaps without a motion."""
    rest, seen = floats(own.rest), floats(own.seen)
    own.withheld += by
    for i in range(len(rest)):
        rest[i] += by
        pair.gap[i] += by
        track.jumps[i] += by
        if own.rides:
            seen[i] += by
