"""One step of a beam bundle: the chains, the sheet, stick and slip. Call it through `beam_bundle.step`."""

import math
from typing import NamedTuple

import numpy as np

from palpate.compiler.kernel import kernel
from palpate.physics.fingertip.skin import assemble
from palpate.physics.fingertip.stick_slip import Blocks, Workspace, stick_slip
from palpate.physics.materials.voigt import chain_compliance, chain_strain_step


class Nodes(NamedTuple):
    """State of the skin ends and results of the last step, see `beam_bundle.BundleState`."""

    strains: np.ndarray
    deflection: np.ndarray
    normal: np.ndarray
    tangent: np.ndarray
    slip: np.ndarray
    path: np.ndarray
    slipping: np.ndarray
    first: np.ndarray
    force: np.ndarray


class BundleWorkspace(NamedTuple):
    """Workspace of a step."""

    matrix: np.ndarray  # [N/m] (Z,2,2) stiffness of the sheet and the beams in the step
    trial: np.ndarray  # [N] (N,2) force on the plate if all nodes stick
    plate: np.ndarray  # [N] (N,2) force on the plate
    limit: np.ndarray  # [N] (N) upper limit of friction
    weight: np.ndarray  # [1] (N) in the sheet
    solver: Workspace


class BundleMotion(NamedTuple):
    """Input of a step: depth [m], shift along the plate [m], coefficient of friction [1], length dt [s] > 0, time at
    its end [s], and length of the previous step [s], 0 for the first."""

    depth: float
    x: float
    y: float
    friction: float
    dt: float
    time: float
    before: float


class StepSummary(NamedTuple):
    """Results of the last step: nodes in contact and sliding, beams at their strain limit, iterations and residual of
    the solver, length [s]. Prediction for a next step of the same length at the same depth: stiffness [N/m], depth of
    first touch [m] and force [N]."""

    contacts: int = 0
    slips: int = 0
    limited: int = 0
    next_stiffness: float = 0.0
    next_touch: float = 0.0
    iterations: int = 0
    residual: float = 0.0
    last_step: float = 0.0
    next_force: float = 0.0


@kernel
def bundle_step(beams, nodes, scratch, motion, tolerance, most):
    """Advance the nodes by one step; returns its summary.

    beams            a `beam_bundle.Bundle`;  nodes, scratch, motion  as above
    tolerance, most  as in `stick_slip`
    """
    contacts, limited = _press_beams(beams, nodes, scratch, motion)
    stiffness, touch, following = _next_law(beams, nodes, motion)
    slips, iterations, residual = _rub(beams, nodes, scratch, motion, tolerance, most)
    force = nodes.force
    force[:] = 0.0
    for i in range(beams.heights.shape[0]):
        force[0] += nodes.tangent[i, 0]
        force[1] += nodes.tangent[i, 1]
        force[2] += nodes.normal[i]
    return StepSummary(contacts, slips, limited, stiffness, touch, iterations, residual, motion.dt, following)


@kernel
def _press_beams(beams, nodes, scratch, motion):
    """Shorten the beams to the depth; compute normal forces, friction limits and weights in the sheet. Returns the
    numbers of nodes in contact and of beams at their reach."""
    contacts = limited = 0
    for i in range(beams.heights.shape[0]):
        wanted = motion.depth - beams.heights[i]
        if wanted > beams.reach[i]:
            wanted = beams.reach[i]
            limited += 1
        strain = wanted / beams.length[i]
        pressure = chain_strain_step(
            nodes.strains[i], beams.moduli, beams.viscosities, beams.shares[i], strain, motion.dt
        )
        nodes.normal[i] = pressure * beams.cell
        scratch.limit[i] = motion.friction * nodes.normal[i]
        share = min(pressure / beams.fade, 1.0)
        scratch.weight[i] = share * share * share
        if pressure > 0.0:
            contacts += 1
        else:
            nodes.path[i], nodes.first[i] = 0.0, -1.0
    return contacts, limited


@kernel
def _next_law(beams, nodes, motion):
    """Stiffness [N/m], depth of first touch [m] and force [N] of a next step of the same length at the same depth.
    Without contact, the stiffness is that of the beam that will touch first."""
    depth, dt = motion.depth, motion.dt
    stiffness = lowest = force = 0.0
    first_touch = np.inf
    for i in range(beams.heights.shape[0]):
        beam = beams.cell / (beams.length[i] * chain_compliance(beams.moduli, beams.viscosities, beams.shares[i], dt))
        touch = beams.heights[i]
        for j in range(beams.moduli.shape[0]):
            damping = beams.viscosities[j] / dt
            touch += beams.length[i] * beams.shares[i, j] * damping * nodes.strains[i, j] / (beams.moduli[j] + damping)
        if touch < first_touch:
            first_touch, lowest = touch, beam
        if touch < depth:
            stiffness += beam
            force += beam * (min(depth, beams.heights[i] + beams.reach[i]) - touch)
    return lowest if stiffness == 0.0 else stiffness, first_touch, force


@kernel
def _rub(beams, nodes, scratch, motion, tolerance, most):
    """Solve stick and slip under the shift; returns the number of sliding nodes, iterations and residual."""
    if motion.friction == 0.0 and not np.any(nodes.deflection):  # without friction all nodes slide
        nodes.slip[:, 0], nodes.slip[:, 1] = motion.x, motion.y
        scratch.plate[:] = 0.0
        return _slid(nodes, scratch, motion), 0, 0.0
    # With all nodes stuck the deflection would be u_s = u - shift. Elastic and viscous forces of the sheet in the step
    # are K u_new + (tau/dt) K (u_new - u); a common shift strains nothing, so r = -k u_s - K u.
    sheet, deflection, slip = beams.sheet, nodes.deflection, nodes.slip
    lateral, matrix = beams.lateral, scratch.matrix
    count = lateral.shape[0]
    viscous = 1.0 + beams.retardation / motion.dt
    ratio = motion.dt / motion.before if motion.before > 0.0 else 0.0
    assemble(matrix, sheet, scratch.weight, viscous)
    for i in range(count):
        x, y = -lateral[i] * (deflection[i, 0] - motion.x), -lateral[i] * (deflection[i, 1] - motion.y)
        for s in range(sheet.rows[i], sheet.rows[i + 1]):
            j = sheet.columns[s]
            x -= (matrix[s, 0, 0] * deflection[j, 0] + matrix[s, 0, 1] * deflection[j, 1]) / viscous
            y -= (matrix[s, 1, 0] * deflection[j, 0] + matrix[s, 1, 1] * deflection[j, 1]) / viscous
        scratch.trial[i, 0], scratch.trial[i, 1] = x, y
        slip[i, 0] *= ratio
        slip[i, 1] *= ratio
    for i in range(count):
        matrix[sheet.diagonal[i], 0, 0] += lateral[i]
        matrix[sheet.diagonal[i], 1, 1] += lateral[i]
    whole = Blocks(sheet.rows, sheet.columns, sheet.diagonal, matrix, sheet.band)
    iterations, residual = stick_slip(
        whole, scratch.trial, scratch.limit, slip, scratch.plate, scratch.solver, tolerance, most
    )
    return _slid(nodes, scratch, motion), iterations, residual


@kernel
def _slid(nodes, scratch, motion):
    """Update the nodes with the solution; returns the number of sliding nodes."""
    slips = 0
    for i in range(nodes.normal.shape[0]):
        x, y = nodes.slip[i, 0], nodes.slip[i, 1]
        nodes.deflection[i, 0] += x - motion.x
        nodes.deflection[i, 1] += y - motion.y
        # an unconverged solution may exceed the friction limit by its residual
        limit, plate = scratch.limit[i], scratch.plate[i]
        size = math.hypot(plate[0], plate[1])
        part = -limit / size if size > limit else -1.0
        nodes.tangent[i, 0], nodes.tangent[i, 1] = part * plate[0], part * plate[1]
        distance = math.hypot(x, y)
        nodes.slipping[i] = nodes.normal[i] > 0.0 and distance > 0.0
        if nodes.slipping[i]:
            nodes.path[i] += distance
            slips += 1
            if nodes.first[i] < 0.0:
                nodes.first[i] = motion.time
    return slips
