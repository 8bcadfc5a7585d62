"""A sampled body that takes as many modes as the error asks for that its user allows.

Each tick the level in use is stepped, and `FidelityBases.estimated_errors` says how far each level is off the body of
all modes. Where the estimate of the one in use is above `ALERT` times the error, the cheapest below that is taken, in
the same tick; a cheaper one is taken where its estimate was below `CALM` times the error for `WAIT` ticks. It first
comes to equilibrium, at most `WARM` ticks, then both answer for `BLEND` ticks by weights that go from one to the other
in even steps: a switch moves the indentation by no more than their difference over `BLEND` in a tick. No other begins
then.

The loads that a sampled body holds follow the load alone, and are the same for all levels. So one that is taken gets
them as they are, and is at the state of the other as near as its modes allow. What the new one stores otherwise than
the old is energy that a switch makes or takes: about the difference of their indentations times half the force.

A step that comes later than the deadline allows one level less than the one in use, whatever the estimate, which then
says so. A body reads no clock: a tick that was missed on the real clock makes the time between its steps longer, and a
recording has the same times, so that a replay takes the same levels. The choice depends on what the body was told and
on nothing else.
"""

import math
from collections.abc import Sequence

import numpy as np

from palpate.physics.bodies.fidelity_bases import FidelityBases
from palpate.physics.bodies.patch import ALONE, Law, Pressed, ReducedBody
from palpate.physics.bodies.sampled.contacts import coupling_of, laws_of
from palpate.physics.bodies.sampled.solve import TOLERANCE
from palpate.physics.bodies.sampled_body import SampledBody
from palpate.physics.contact.terminal import LEAST_DEPTH, LEAST_FORCE, fit_terminal
from palpate.physics.exact import product

ALERT = 0.9
"""[1] Share of the error that the estimate may reach before a finer level is taken: it grows while a switch lasts."""
CALM = 0.7
"""[1] Share of the error that the estimate of a cheaper level has to stay below."""
WAIT = 20
"""Ticks for which it has to."""
BLEND = 10
"""Ticks that a switch lasts."""
WARM = 10
"""Ticks for which one that was taken may seek its equilibrium before it begins to answer."""
LEFT = 2.0
"""[1] What is estimated of the residual, over the next iteration: the tangent that is kept is not exact."""

PROBATION = 1.0
"""[s] without a late step after which one level more is allowed."""


class Deadline:
    """The finest of several levels, 0 the cheapest, that may be used.

    count     of them
    deadline  [s] > 0, longest time between two steps that is not too late; inf: none is
    """

    def __init__(self, count: int, deadline: float = math.inf) -> None:
        self._last, self.deadline = count - 1, deadline
        self.finest = self._last
        self._kept = 0.0

    def step(self, dt: float, used: int, settled: bool) -> None:
        """The time [s] since the last step, and the level that was used for it. Where that was late, one less is
        allowed, once in each switch: `settled` tells that none is under way."""
        if dt > self.deadline:
            self._kept = 0.0
            if settled:
                self.finest = max(min(used, self.finest) - 1, 0)
            return
        self._kept += dt
        if self._kept >= PROBATION and self.finest < self._last:
            self.finest += 1
            self._kept = 0.0


class FidelityLevels(ReducedBody):
    """Bodies of one basis, the cheapest first, that stand in for one another.

    bodies  of the levels, and of the whole basis
    levels   what they are
    error   [1] > 0, relative error of the indentation that is allowed
    most    modes of the finest that is taken; those above are left out whatever the error
    late    [s] time between two steps beyond which a finer one is left out as well; inf: none
    """

    def __init__(
        self, bodies: list[SampledBody], levels: FidelityBases, error: float, most: int, late: float = math.inf
    ) -> None:
        sizes = [body.basis.modes.shape[1] for body in bodies]
        self.bodies = [body for body, size in zip(bodies, sizes, strict=True) if size <= most] or bodies[:1]
        self.levels, self.error = levels, error
        self.deadline = Deadline(len(self.bodies), late)
        self._modes = bodies[-1].basis.modes.reshape(-1, 3, sizes[-1])
        self._held = np.zeros_like(bodies[-1].held)
        """Loads that were held before the last step, from which a level that is taken makes that step as well."""
        self._at = self._before = 0
        self._told = BLEND
        """Ticks for which the one in use has answered, up to `BLEND`; less than 0 while it seeks its equilibrium."""
        self._calm = 0
        self.estimated_error = 0.0
        """Estimated relative error of the indentation in the last step."""
        self.evaluations = np.zeros(len(self.bodies), dtype=np.int64)
        """Evaluations of the energy by each in the last step."""
        self._coupling = ALONE
        self.estimates = np.zeros(len(bodies))
        """Estimated relative error of each level in the last step."""

    @property
    def fidelity(self) -> int:
        """Modes of the level in use."""
        return int(self.bodies[self._at].basis.modes.shape[1])

    @property
    def body(self) -> SampledBody:
        """The one in use."""
        return self.bodies[self._at]

    @property
    def weight(self) -> float:
        """Share of the one in use in the answer."""
        return max(self._told, 0) / BLEND

    @property
    def settled(self) -> bool:
        """Whether the one in use reached equilibrium."""
        return self.body.settled

    @property
    def coupling(self) -> np.ndarray:
        """As of `SampledBody`."""
        return self._coupling

    @property
    def extrapolation(self) -> float:
        """As of `SampledBody`."""
        return self.body.extrapolation

    def step(self, nodes: np.ndarray, forces: np.ndarray, foot: tuple, normal: tuple, dt: float) -> Law:
        """As of `SampledBody`."""
        return self.step_all([(nodes, forces, foot, normal)], dt)[0]

    def step_all(self, loads: Sequence[Pressed], dt: float) -> list[Law]:
        """As of `SampledBody`; each estimate is the largest of those at the contacts that press."""
        self.deadline.step(dt, self._at, self._told >= BLEND)
        self.evaluations[:] = 0
        np.copyto(self._held, self.body.held)
        laws = self._stepped(self._at, loads, dt)
        p, measures = self._seen()
        pressed = [i for i, law in enumerate(laws) if len(loads[i][0]) > 0 and law[3] > 0.0]
        self.estimates[:] = 0.0
        linears = self.body.linears
        for i in pressed:
            found = self.levels.estimated_errors(p, linears[i], laws[i][3])
            np.maximum(self.estimates, found, out=self.estimates)
        if self._told >= BLEND:
            to = self._wanted()
            before = laws
            if to != self._at:
                self.bodies[to].take_over(self.body, self._held, p)
                self._before, self._at, self._told = self._at, to, -WARM
                laws = self._stepped(to, loads, dt)
        else:
            before = self._stepped(self._before, loads, dt)
        if self._told < 0 and self.settled:
            self._told = 0
        self._told = min(self._told + 1, BLEND)
        w = self.weight
        self.estimated_error = w * self._estimate(self._at, laws, measures, pressed)
        self._coupling = self.body.coupling
        if w == 1.0:
            return laws
        self.estimated_error += (1.0 - w) * self._estimate(self._before, before, measures, pressed)
        if len(loads) == 1:
            nodes, forces, _, normal = loads[0]
            force = max(-float(np.sum(forces.sum(axis=0) * normal)), LEAST_FORCE) if len(nodes) else LEAST_FORCE
            return [blended(before[0], laws[0], w, force)]
        a, b = self.bodies[self._before].contacts, self.body.contacts
        assert a is not None and b is not None  # both were stepped under several contacts
        compliance = (1.0 - w) * a.compliance + w * b.compliance
        self._coupling = coupling_of(compliance)
        return laws_of(compliance, (1.0 - w) * a.depths + w * b.depths)

    def displaced(self, *feet: tuple) -> tuple[np.ndarray, np.ndarray]:
        """As of `SampledBody`."""
        nodes, moved = self.body.displaced(*feet)
        if self.weight == 1.0:
            return nodes, moved
        _, before = self.bodies[self._before].displaced(*feet)
        return nodes, self.weight * moved + (1.0 - self.weight) * before

    def _stepped(self, level: int, loads: Sequence[Pressed], dt: float) -> list[Law]:
        laws = self.bodies[level].step_all(loads, dt)
        self.evaluations[level] = self.bodies[level].evaluations
        return laws

    def _seen(self) -> tuple[np.ndarray, list[np.ndarray]]:
        """Load, Phi'h/E [m] (r,), and each contact's shares of the normal force, Phi'm [m] (r,), in all modes."""
        body = self.body
        measures = body.measures
        rows = np.flatnonzero(body.held.any(axis=1) | measures.any(axis=(0, 2)))
        modes = self._modes[rows].reshape(-1, self._modes.shape[2])
        return product(modes.T, body.held[rows].ravel()) / body.young, [
            product(modes.T, m[rows].ravel()) for m in measures
        ]

    def _estimate(self, level: int, laws: list[Law], measures: list[np.ndarray], pressed: list[int]) -> float:
        """Of a level that was stepped, with what its step left over: the residual that it may end at, and twice the
        next iteration."""
        if not pressed:
            return 0.0
        body = self.bodies[level]
        count = body.basis.modes.shape[1]
        left = [abs(body.left_over(measures[i][:count])) / max(abs(laws[i][3]), LEAST_DEPTH) for i in pressed]
        return float(self.estimates[level]) + TOLERANCE + LEFT * max(left)

    def _wanted(self) -> int:
        """The level that should be in use."""
        last = self.deadline.finest
        estimates = self.estimates[: last + 1]
        if self._at > last:
            self._calm = 0
            return last
        if estimates[self._at] > ALERT * self.error:
            self._calm = 0
            return int(np.flatnonzero(np.append(estimates[:last] <= ALERT * self.error, True))[0])
        lower = np.flatnonzero(estimates[: self._at] <= CALM * self.error)
        self._calm = self._calm + 1 if len(lower) else 0
        if self._calm < WAIT:
            return self._at
        self._calm = 0
        return int(lower[0])


def blended(a: Law, b: Law, weight: float, force: float) -> Law:
    """The law whose indentation and compliance at a force [N] are those of two laws, `weight` of b and the rest of a:
    of each K, n, s_free and the indentation now."""
    free = ahead = slack = now = 0.0
    for (stiffness, exponent, own_free, own_now), w in ((a, 1.0 - weight), (b, weight)):
        depth = max(math.pow(force / stiffness, 1.0 / exponent), LEAST_DEPTH)
        free += w * own_free
        ahead += w * (own_free + depth)
        slack += w * depth / (exponent * force)
        now += w * own_now
    stiffness, exponent = fit_terminal(free, ahead, 1.0 / slack, force)
    return stiffness, exponent, free, now
