"""Forward sensitivity of bodies: derivatives of their terminal laws, carried along with their state.

A body is given each step's load, and the derivatives of the load's forces; it returns those of the five numbers of its
next law, (5,P) for P parameters.
"""

from typing import Protocol

import numpy as np

from palpate.physics.bodies.condensed_body import CondensedBody
from palpate.physics.bodies.condensed_step import LEAST_FORCE, NARROWED, RADIUS
from palpate.physics.bodies.large_displacement import large_depth, linear_depth
from palpate.physics.bodies.true_patch import gathered, patch_compliance
from palpate.physics.contact.terminal import Terminal
from palpate.physics.sensitivity.series import pressed, recovered


class Push(Protocol):
    """A load as messages hold it: nodes (k), their forces [N] (k,3), foot point [m] and outward normal."""

    @property
    def nodes(self) -> np.ndarray: ...
    @property
    def forces(self) -> np.ndarray: ...
    @property
    def foot(self) -> tuple[float, float, float]: ...
    @property
    def normal(self) -> tuple[float, float, float]: ...


class MassSpringTangent:
    """Of K s^n <1 + c s'>, which the normal force moves: its indentation is that of the law before.

    stiffness  [N/m^n] of the body's settings; where a nodule is near, the law has more, in proportion
    dlaw       (3,P)  derivatives of K, n and c by each parameter
    """

    def __init__(self, stiffness: float, exponent: float, damping: float, dlaw: np.ndarray) -> None:
        self.stiffness, self.given = stiffness, dlaw
        self.law = Terminal(stiffness, exponent, damping)
        self.dprevious = np.zeros(dlaw.shape[1])

    def step(self, law: Terminal, force: float, dforce: np.ndarray, dt: float) -> np.ndarray:
        """(5,P) of the law [`law`] after a step of dt [s] under a normal force [N] with the derivatives (P,)."""
        zero = np.zeros_like(self.dprevious)
        harder = law.stiffness / self.stiffness * self.given[0]
        before = Terminal(law.stiffness, law.exponent, law.damping, 0.0, self.law.previous_indentation)
        dbefore = np.array([harder, self.given[1], self.given[2], zero, self.dprevious])
        if force > 0.0:
            self.dprevious = pressed(law.previous_indentation, dt, before, dbefore, dforce)
        else:
            self.dprevious = recovered(dt, before, dbefore)
        self.law = law
        return np.array([harder, self.given[1], self.given[2], zero, self.dprevious])


class CondensedTangent:
    """Of a condensed finite-element body. Its loads' history h is linear in them, and so is the derivative,

        dh/dp <- keep dh/dp + take dm(t - f n)/dp + (dkeep/dp) h + (dtake/dp) m(t - f n),

    keep = tau/(T + tau), take = T/(T + tau), m the patch's shares. What follows from h is differentiated as it stands
    in `bodies.condensed_body`: indentation, compliance, and large displacement.

    body  at rest; it is stepped with each call
    dyoung, dretardation  (P,) derivatives of E and tau by each parameter
    """

    def __init__(self, body: CondensedBody, dyoung: np.ndarray, dretardation: np.ndarray) -> None:
        self.body, self.dyoung, self.dretardation = body, dyoung, dretardation
        self.dheld = np.zeros((*body.held.shape, len(dyoung)))

    def step(self, load: Push, dforce: np.ndarray, dforces: np.ndarray, dt: float) -> np.ndarray:
        """(5,P) after a step of dt [s] under a load whose normal force has the derivatives `dforce` (P,), and whose
        force as a whole `dforces` (3,P)."""
        body, model, dE = self.body, self.body._model, self.dyoung
        E, tau, normal = model.young, model.retardation, np.asarray(load.normal)
        held = body.held.copy()
        compliance, *_ = body.step(load.nodes, load.forces, load.foot, load.normal, dt)
        fields, numbers, touched = body._fields, body._numbers, body._touched
        marked = body._marks[2]
        order = marked[:touched]
        share = fields[2, order, 0]
        # history of the load
        keep, take = tau / (dt + tau), dt / (dt + tau)
        dkeep = dt / (dt + tau) ** 2 * self.dretardation
        total = load.forces.sum(axis=0)
        force = max(float(-total @ normal), 0.0)
        self.dheld *= keep
        self.dheld += held[..., None] * dkeep
        if len(load.nodes):
            self.dheld[order] += share[:, None, None] * (take * dforces - np.multiply.outer(total, dkeep))
        if body.still:
            self.dheld[:] = 0.0
        # indentation of the linear body: w.h of the history, w.m f of the load
        rows = (3 * order[:, None] + np.arange(3)).ravel()
        sides = -np.multiply.outer(share, normal).ravel()
        w = linear = (sides @ model.compliance[rows]).reshape(-1, 3)
        block, side = np.zeros((3, 3)), np.zeros(9)
        hats = gathered(model.compliance, model.true.table, marked, touched, fields[2], 0, block)
        own, more = patch_compliance(
            model.compliance, model.true, marked, touched, fields[2], numbers[NARROWED] > 0.0, load.normal,
            numbers[RADIUS], block, hats, side,
        )  # fmt: skip
        if own > 0.0:
            w = linear + more / own * np.multiply.outer(linear @ normal, normal)
        now = float(np.sum(w * body.held)) / E
        dnow = np.einsum("vi,vip->p", w, self.dheld) / E - now / E * dE
        tangential, dtangential = 0.0, np.zeros_like(dE)
        if len(load.nodes) and force > 0.0:
            mean = share @ linear[order]
            tangential = (float(mean @ total) - own * force) / E
            dtangential = (mean @ dforces - own * dforce) / E - tangential / E * dE
        free = keep * now + take * tangential
        dfree = keep * dnow + dkeep * now + take * dtangential - dkeep * tangential
        c = take * (own + more) / E
        dc = -dkeep * (own + more) / E - c / E * dE
        if len(model.rho) and own + more > 0.0:
            dc, dfree, dnow = self._bent(now, free, c, max(force, LEAST_FORCE), dnow, dfree, dc, dforce)
        zero = np.zeros_like(dE)
        return np.array([-dc / compliance**2, zero, zero, dfree, dnow])

    def _bent(
        self, now: float, free: float, c: float, force: float, dnow: np.ndarray, dfree: np.ndarray, dc: np.ndarray,
        dforce: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
        """The derivatives (P,) with large displacement: of compliance, free indentation and indentation."""
        radius, rho = float(self.body._numbers[RADIUS]), self.body._model.rho
        dpress = dforce if force > LEAST_FORCE else np.zeros_like(dforce)
        dnow = large_depth(now / radius, rho)[1] * dnow
        start, rise = large_depth(free / radius, rho)
        at = (free + c * force) / radius
        dat = (dfree + dc * force + c * dpress) / radius
        then, slope = large_depth(at, rho)
        dfree = rise * dfree
        if slope * c <= radius * (then - start) / force:  # the chord
            return (radius * slope * dat - dfree - radius * (then - start) / force * dpress) / force, dfree, dnow
        bend = -linear_depth(then, rho)[2] * slope**3  # second derivative of s/R by x
        dtangent = bend * c * dat + slope * dc
        return dtangent, radius * slope * dat - dtangent * force - slope * c * dpress, dnow
