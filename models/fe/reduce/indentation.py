"""Pressing the nonlinear organ at many places at once, the indentation prescribed.

At a place the unit load g, which keeps its shape and direction, presses to the indentation g.u = s. The surface under
it sticks to the finger: further means of displacement, along the surface, are held where the linear organ has them,

    B'u = b s,    b = B'K0⁻¹g/(g.K0⁻¹g),    B (3N,1+M) of columns g, h1 ... hM

The displacement u makes the energy W(s) least under that condition, with multipliers l, and the force is what does the
work,

    r(u) = B l,    f = dW/ds = b.l,    r inner forces of the organ and its bed

so that a curve goes on where a force has no further equilibrium (a limit load), and does not end where a surface that
is free to slide gives way sideways (docs/equations/reduced-fe.md). Newton's method; its linear systems are solved by
conjugate gradients among the displacements that leave all means alone,

    z = (1 - U (B'U)⁻¹ B') K0⁻¹ r,    U = K0⁻¹ B

with the factor at rest K0, which all places share: what they want of it is solved together, many right sides at once.
Only the preconditioner, U and the tangent's products are in single precision.

N. I. M. Gould, M. E. Hribar, J. Nocedal, SIAM J. Sci. Comput. 23 (2001) 1376-1395.
"""

from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import csr_array, vstack

from palpate.models.fe.reduce.reducible import Reducible

TOLERANCE = 1e-3
"""Unbalanced force over that of the load, both as the displacements that they would cause at rest (energy norm)."""
NEWTON = 8
"""Iterations of a step before it is cut in half."""
HALVES = 2
"""Times that a step may be cut in half."""
INNER = 40
"""Iterations of conjugate gradients."""
FORCING = 0.1
"""What they leave of the residual (energy norm)."""
STALE = 0.25
"""Reduction of the residual by one Newton iteration above which the tangent is made again."""
TOGETHER = 40
"""Places that are pressed at the same time; each holds a tangent."""


@dataclass(frozen=True)
class PressCurve:
    """What a place does while it is pressed; NaN from where no equilibrium was found.

    stiffness    [N/m]      of the linear organ
    force        [N] (L,)    that does the work of bringing it to each indentation
    energy       [J] (L,)    that the organ and its bed then hold
    multipliers  [N] (L,1+M) forces of the load and of each mean that is held
    """

    stiffness: float
    force: np.ndarray
    energy: np.ndarray
    multipliers: np.ndarray


Asking = Generator[np.ndarray, np.ndarray, Any]
"""Yields right sides (3N,), is sent K0⁻¹ of them."""


class OrganPress:
    """The nonlinear organ of modulus 1 Pa, and its factor at rest."""

    def __init__(self, model: Reducible) -> None:
        self.body = model.elastic
        self._blocks = np.zeros((len(self.body.pattern.indices), 3, 3))
        self._factor = model.cholesky.alike(single=True)
        self._factor.factor(self.body.tangent(np.zeros_like(model.mesh.points)))

    def tangent(self, u: np.ndarray) -> Any:
        """Tangent there, single precision."""
        self._blocks[:] = 0.0
        self.body.balance(u, self._blocks)
        return self.body.pattern.matrix(self._blocks.astype(np.float32))

    def run(self, works: list[Asking]) -> list[Any]:
        """What each returns in the end."""
        answers: list[Any] = [None] * len(works)
        todo = list(range(len(works)))[::-1]
        wanted: dict[int, np.ndarray] = {}
        while todo or wanted:
            while todo and len(wanted) < TOGETHER:
                k = todo.pop()
                wanted[k] = next(works[k])
            own = list(wanted)
            solved = self._factor.solve(np.stack([wanted[k] for k in own], axis=1))
            for column, k in enumerate(own):
                try:
                    wanted[k] = works[k].send(np.ascontiguousarray(solved[:, column]))
                except StopIteration as end:
                    answers[k] = end.value
                    del wanted[k]
        return answers

    def curve(
        self,
        load: np.ndarray,
        depths: np.ndarray,
        held: csr_array | None = None,
        count: Callable[[int], None] = lambda done: None,
    ) -> Asking:
        """Work that presses a place to growing indentations [m] (L,) and returns its `PressCurve`.

        load   (N,3) unit load
        held   (M,3N) means of displacement that are held; none by default, the surface is free to slide then
        count  hears how many indentations are done
        """
        place = _Place(self, load, held)
        yield from place.begin()
        force, energy = np.full((2, len(depths)), np.nan)
        multipliers = np.full((len(depths), len(place.shares)), np.nan)
        for k, depth in enumerate(depths):
            converged = yield from place.carry(float(depth))
            if not converged:
                count(len(depths) - k)
                break
            force[k], energy[k], multipliers[k] = place.force, place.energy, place.multipliers
            count(1)
        return PressCurve(1.0 / place.compliance, force, energy, multipliers)


class _Place:
    """State of one place while its indentation grows."""

    def __init__(self, press: OrganPress, load: np.ndarray, held: csr_array | None) -> None:
        self._press = press
        own = csr_array(load.reshape(1, -1))
        self._means = own if held is None else vstack([own, held], format="csr")
        self._past: list[tuple[float, np.ndarray]] = [(0.0, np.zeros(load.size))]
        self._matrix: Any = None
        self.force = self.energy = self.compliance = 0.0
        self.shares = self.multipliers = np.zeros(self._means.shape[0])

    def begin(self) -> Asking:
        """What the linear organ does under the load and under a unit force on each mean."""
        count, size = self._means.shape
        self._units = np.empty((count, size), np.float32)
        for k in range(count):
            displacement = yield self._means[[k]].toarray().ravel()
            if k == 0:
                self.unit = displacement
            self._units[k] = displacement
        moved = self._means @ self.unit
        self.compliance = float(moved[0])
        self.shares = moved / self.compliance
        self._inverse = np.linalg.inv(self._means @ self._units.T.astype(np.float64))

    def _left(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """K0⁻¹ of forces less what moves the means, and the multipliers that take it out."""
        multipliers = self._inverse @ (self._means @ u)
        return u - multipliers.astype(np.float32) @ self._units, multipliers

    def carry(self, depth: float) -> Asking:
        """Go on to this indentation; whether it was reached."""
        step, halves = depth - self._past[-1][0], 0
        while self._past[-1][0] < depth:
            goal = min(self._past[-1][0] + step, depth)
            if depth - goal < 1e-9 * depth:
                goal = depth
            held = yield from self._newton(goal)
            if not held:
                halves += 1
                if halves > HALVES:
                    return False
                step *= 0.5
        return True

    def _guess(self, depth: float) -> np.ndarray:
        """The parabola through the last three states (or what there is), on which B'u = b s."""
        past = self._past
        if len(past) == 1:
            return depth / self.compliance * self.unit
        guess = np.zeros_like(self.unit)
        for i, (a, u) in enumerate(past):
            share = 1.0
            for j, (b, _) in enumerate(past):
                if i != j:
                    share *= (depth - b) / (a - b)
            guess += share * u
        return guess

    def _inner(self, u: np.ndarray) -> tuple[float, np.ndarray] | None:
        balance = self._press.body.balance(u.reshape(-1, 3))
        return None if balance is None else (balance[0], balance[1].ravel())

    def _newton(self, depth: float) -> Asking:
        """Equilibrium at an indentation, from those before; whether it was found."""
        u = self._guess(depth)
        now = self._inner(u)
        if now is None:  # turns over: from the last state, pushed on as the linear organ
            start, before = self._past[-1]
            u = before + (depth - start) / self.compliance * self.unit
            now = self._inner(u)
            if now is None:
                return False
        self._matrix, last = None, np.inf
        for _ in range(NEWTON):
            energy, inner = now
            solved = yield inner
            step, self.multipliers = self._left(solved)
            self.force = float(self.shares @ self.multipliers)
            rest = inner - self.multipliers @ self._means
            size = max(float(step @ rest), 0.0) ** 0.5
            if size < TOLERANCE * abs(self.force) * self.compliance**0.5:
                self.energy = energy
                self._past = [*self._past[-2:], (depth, u)]
                return True
            if self._matrix is None or size > STALE * last:
                self._matrix = self._press.tangent(u.reshape(-1, 3))
            last = size
            way = yield from self._direction(rest, step)
            if way is None:
                return False
            slope = float(way @ rest)
            for cut in (1.0, 0.5, 0.25, 0.1, 0.03):
                then = self._inner(u + cut * way)
                if then is not None and then[0] <= energy + 1e-4 * cut * slope + 1e-9 * abs(energy):
                    break
            else:
                return False
            u, now = u + cut * way, then
        return False

    def _direction(self, rest: np.ndarray, step: np.ndarray) -> Asking:
        """Newton direction (3N,) that leaves the means alone, from the residual and K0⁻¹ of it; None where the
        energy is no minimum among such displacements."""
        direction = np.zeros_like(rest)
        left, move = -rest, -step
        way, size = move.copy(), float(step @ rest)
        goal = FORCING * FORCING * size
        for _ in range(INNER):
            pulled = (self._matrix @ way.astype(np.float32)).astype(np.float64)
            curvature = float(way @ pulled)
            if curvature <= 0.0:
                return None
            share = size / curvature
            direction += share * way
            left = left - share * pulled
            solved = yield left
            move, _ = self._left(solved)
            before, size = size, float(move @ left)
            if size <= goal:
                break
            way = move + size / before * way
        return self._left(direction)[0]
