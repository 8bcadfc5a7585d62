"""Kernels that compute the answer of the reduced bodies from the state of their node."""

from palpate.compiler.records import floats, integers, lend_first, nth, put, vector
from palpate.nodes.base import ARRAY
from palpate.nodes.base.contacts import send_laws
from palpate.nodes.base.kernels import ieee_kernel
from palpate.nodes.base.samples import oldest
from palpate.physics.bodies import condensed_body as condensed
from palpate.physics.bodies.condensed_step import excesses
from palpate.physics.bodies.patch import add_pressure

PRESSURE = {"areas": ARRAY, "push": ARRAY, "pressures": ARRAY}  # [m²] of each vertex; work array; [Pa]


@ieee_kernel
def caution_once(own, contacts):
    """Store each new cause of extrapolation for a note, as in `ReducedFE.State`."""
    for cause in range(len(own.cautions)):
        known, worst, contact = False, 0.0, 0
        for k in range(own.causes):
            known = known or own.cautions[k, 0] == cause
        for c in range(len(contacts)):
            excess = excesses(contacts[c])[cause]
            if excess > worst:
                worst, contact = excess, c
        if worst > 0.0 and not known:
            row = own.cautions[own.causes]
            row[0], row[1], row[2], row[3] = cause, worst, contacts[contact].radius, contacts[contact].wide
            own.causes += 1


@ieee_kernel
def along_the_surface(own, body, load, out):
    """Send the tangential energy gradient and the shape operator at each contact with a load."""
    slopes = floats(own.slopes)
    out.shape_operator.count = 0
    put(out.tangential_gradient, (0.0, 0.0, 0.0))
    for i in range(load.count):
        slopes[i, :] = 0.0
        if nth(load, i).nodes.shape[0] == 0:
            continue
        condensed.slope(body, i)
        for k in range(3):
            slopes[i, k] = body.gradient[k]
            for j in range(3):
                slopes[i, 3 + 3 * k + j] = body.shape[k, j]
        if i == 0:
            out.shape_operator.count = 9
            put(out.tangential_gradient, vector(body.gradient))
            for k in range(9):
                out.shape_operator.values[k] = slopes[0, 3 + k]


@ieee_kernel
def send(own, load, count, out, dt):
    """Send the laws, and displacement and pressure of the `count` displaced vertices."""
    send_laws(own, out)
    out.step, out.relaxation, out.extrapolation = dt, own.retardation, own.beyond
    out.delayed = oldest(load)
    lend_first(out.nodes, own.body.fine.nodes, count)
    lend_first(out.displacement, own.body.fine.moved, count)
    if own.pressure:
        pressures, nodes = floats(own.pressures), integers(own.body.fine.nodes)[:count]
        for k in range(count):
            pressures[k] = 0.0
        for i in range(load.count):
            each = nth(load, i)
            pull, patch, normal = floats(each.forces), integers(each.nodes), vector(each.normal)
            add_pressure(pull, patch, normal, floats(own.areas), nodes, floats(own.push), pressures)
        for k in range(count):
            pressures[k] = max(pressures[k], 0.0)
        lend_first(out.pressure, own.pressures, count)
