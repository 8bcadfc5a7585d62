"""One step of a beam bundle, compiled: the chains, the sheet, stick and slip. `beam_bundle.step` is its door and says
what the arguments are."""

from __future__ import annotations

import math

import numba
import numpy as np

from palpate.physics.skin import assemble
from palpate.physics.stick_slip import stick_slip
from palpate.physics.voigt import chain_compliance, chain_strain_step

SUMMARY = (
    "contacts", "slips", "clamped", "next_stiffness", "next_touch", "rounds", "residual", "last_step", "next_force",
)  # fmt: skip
"""What `State.summary` holds, in order; the names below are its indices."""
CONTACTS, SLIPS, CLAMPED, NEXT_STIFFNESS, NEXT_TOUCH, ROUNDS, RESIDUAL, LAST_STEP, NEXT_FORCE = range(9)
SHORTEST_STEP = 1e-5
"""[s] A shorter step is computed as this long: the force of a damper over no time has no bound."""


@numba.njit(cache=True)
def bundle_step(
    heights, length, shares, reach, moduli, viscosities, lateral, cell, fade,
    rows, columns, diagonal, band, triangles, blocks, slots, retardation,
    strains, deflection, normal, tangent, slip, path, slipping, first, summary,
    matrix, trial, plate, limit, weight, place, nodes, upper, newton,
    depth, shift_x, shift_y, friction, dt, time, tolerance, most, force,
):  # fmt: skip
    count = heights.shape[0]
    if dt > 0.0:
        dt = max(dt, SHORTEST_STEP)
        time += dt
        ratio = dt / summary[LAST_STEP] if summary[LAST_STEP] > 0.0 else 0.0
        summary[:] = 0.0
        summary[LAST_STEP] = dt
        summary[NEXT_TOUCH], lowest = np.inf, 0.0
        for i in range(count):
            wanted = depth - heights[i]
            if wanted > reach[i]:
                wanted = reach[i]
                summary[CLAMPED] += 1.0
            pressure = chain_strain_step(strains[i], moduli, viscosities, shares[i], wanted / length[i], dt)
            normal[i] = pressure * cell
            limit[i] = friction * normal[i]
            weight[i] = min(pressure / fade, 1.0) ** 3
            if pressure > 0.0:
                summary[CONTACTS] += 1.0
            else:
                path[i], first[i] = 0.0, -1.0
            stiffness = cell / (length[i] * chain_compliance(moduli, viscosities, shares[i], dt))
            touch = heights[i]
            for j in range(moduli.shape[0]):
                damping = viscosities[j] / dt
                touch += length[i] * shares[i, j] * damping * strains[i, j] / (moduli[j] + damping)
            if touch < summary[NEXT_TOUCH]:
                summary[NEXT_TOUCH], lowest = touch, stiffness
            if touch < depth:
                summary[NEXT_STIFFNESS] += stiffness
                summary[NEXT_FORCE] += stiffness * (min(depth, heights[i] + reach[i]) - touch)
        if summary[NEXT_STIFFNESS] == 0.0:
            summary[NEXT_STIFFNESS] = lowest
        _friction_step(
            lateral, rows, columns, diagonal, band, triangles, blocks, slots, retardation,
            deflection, normal, tangent, slip, path, slipping, first, summary,
            matrix, trial, plate, limit, weight, place, nodes, upper, newton,
            shift_x, shift_y, dt, time, ratio, tolerance, most,
        )  # fmt: skip
    force[:] = 0.0
    for i in range(count):
        force[0] += tangent[i, 0]
        force[1] += tangent[i, 1]
        force[2] += normal[i]
    return time


@numba.njit(cache=True)
def _friction_step(
    lateral, rows, columns, diagonal, band, triangles, blocks, slots, retardation,
    deflection, normal, tangent, slip, path, slipping, first, summary,
    matrix, trial, plate, limit, weight, place, nodes, upper, newton,
    shift_x, shift_y, dt, time, ratio, tolerance, most,
):  # fmt: skip
    # With all nodes stuck the deflection would be u_s = u - shift. Elastic and viscous forces of the sheet in the step
    # are K u_new + (tau/dt) K (u_new - u); a common shift strains nothing, so r = -k u_s - K u.
    count = lateral.shape[0]
    viscous = 1.0 + retardation / dt
    assemble(matrix, triangles, blocks, slots, weight, viscous)
    for i in range(count):
        x, y = -lateral[i] * (deflection[i, 0] - shift_x), -lateral[i] * (deflection[i, 1] - shift_y)
        for s in range(rows[i], rows[i + 1]):
            j = columns[s]
            x -= (matrix[s, 0, 0] * deflection[j, 0] + matrix[s, 0, 1] * deflection[j, 1]) / viscous
            y -= (matrix[s, 1, 0] * deflection[j, 0] + matrix[s, 1, 1] * deflection[j, 1]) / viscous
        trial[i, 0], trial[i, 1] = x, y
        slip[i, 0] *= ratio
        slip[i, 1] *= ratio
    for i in range(count):
        matrix[diagonal[i], 0, 0] += lateral[i]
        matrix[diagonal[i], 1, 1] += lateral[i]
    rounds, residual = stick_slip(
        rows, columns, diagonal, matrix, trial, limit, slip, plate, band, place, nodes, upper, newton, tolerance, most
    )
    for i in range(count):
        deflection[i, 0] += slip[i, 0] - shift_x
        deflection[i, 1] += slip[i, 1] - shift_y
        # An answer that stopped early may pass the limit by its residual; the force that is sent never does.
        size = math.hypot(plate[i, 0], plate[i, 1])
        part = -limit[i] / size if size > limit[i] else -1.0
        tangent[i, 0], tangent[i, 1] = part * plate[i, 0], part * plate[i, 1]
        way = math.hypot(slip[i, 0], slip[i, 1])
        slipping[i] = normal[i] > 0.0 and way > 0.0
        if slipping[i]:
            path[i] += way
            summary[SLIPS] += 1.0
            if first[i] < 0.0:
                first[i] = time
    summary[ROUNDS], summary[RESIDUAL] = rounds, residual
