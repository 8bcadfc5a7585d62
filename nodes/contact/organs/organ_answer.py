"""Kernels that fill the message of a contact of organs (`messages.contact.OrganContact`)."""

import numpy as np

from palpate.compiler.records import floats, lend, lend_first, longs, put, vector
from palpate.nodes.base.kernels import ieee_kernel, kernel
from palpate.physics.bodies.floating.turning import times_back
from palpate.physics.contact.organs.borders import contact_area


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
