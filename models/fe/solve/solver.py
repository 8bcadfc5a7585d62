"""Static equilibrium of a soft body in load steps: Newton with line search, steps cut back where they fail."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from palpate.models.fe.contact.protocol import ContactPair
from palpate.models.fe.element.mesh import MeshError, TetMesh, point_text
from palpate.models.fe.progress import Report, unheard
from palpate.models.fe.solve.assembly import Assembly, Balance, Inverted
from palpate.models.fe.solve.checkpoint import SolverState, read_state, write_state
from palpate.models.fe.solve.checks import check_held, check_locking, check_units, checked
from palpate.models.fe.solve.support import Support
from palpate.models.fe.sparse.tangent import UnheldError
from palpate.physics.errors import PalpateError
from palpate.physics.materials.hyperelastic import Material


class ConvergenceError(PalpateError, ArithmeticError):
    """A load step that fails however small; says where and what was reached. The solver keeps that state."""


class _Fault(ArithmeticError):
    """Why a load step fails."""


@dataclass(frozen=True)
class Settings:
    """How the load is stepped and when an iteration has converged."""

    tolerance: float = 1e-6  # [1] residual over the greatest of reaction, contact and inner forces
    iterations: int = 40  # Newton iterations of one load step before it is cut back
    step: float = 0.1  # load of the first step; it grows to `largest` where Newton converges fast
    largest: float = 0.25
    least: float = 1e-4  # load step below which the solver gives up

    def __post_init__(self) -> None:
        for name in ("tolerance", "iterations", "step", "largest", "least"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise ValueError(f"settings: {name} {getattr(self, name)}, expected a positive number")


DEFAULT = Settings()

LOOSE = 0.1
"""[1] Residual at which multipliers of contact are raised already where the penetration is above its bound. The step
after it answers the new multipliers and what was out of balance at once."""


class Solver:
    """A body with materials, supports and contacts; `advance` carries it to a load.

    mesh       quadratic tetrahedra
    materials  by region number
    fixed      (N,3) bool, displacement components that are prescribed
    held       load -> prescribed displacement [m] (N,3), read where fixed; zero by default
    loads      load -> outer nodal forces [N] (N,3); none by default
    contacts   see `fe.rigid`

    Load is a number that the functions give a meaning; it starts at 0.

    MeshError, MaterialError, ValueError: a region without material, an element that is inside out, units that are off,
    a piece that nothing holds, a mask of another shape.
    """

    def __init__(
        self,
        mesh: TetMesh,
        materials: Mapping[int, Material],
        fixed: np.ndarray,
        held: Callable[[float], np.ndarray] | None = None,
        loads: Callable[[float], np.ndarray] | None = None,
        contacts: Sequence[ContactPair] = (),
        settings: Settings = DEFAULT,
    ) -> None:
        missing = sorted(set(mesh.region.tolist()) - set(materials))
        if missing:
            raise MeshError(f"regions {missing} have no material; materials are given for {sorted(materials)}")
        if fixed.shape != mesh.points.shape or fixed.dtype != bool:
            raise ValueError(
                f"fixed: found shape {fixed.shape} of {fixed.dtype}, expected {mesh.points.shape} of bool: a flag for "
                "each displacement component of each node"
            )
        check_units(mesh, materials)
        check_locking(mesh, materials)
        check_held(mesh, fixed, [contact.nodes() for contact in contacts])
        self.mesh, self.materials, self.settings = mesh, dict(materials), settings
        self.contacts = list(contacts)
        self.held = held
        self.load = 0.0
        self.displacement = np.zeros_like(mesh.points)
        self.reaction = np.zeros_like(mesh.points)
        self.iterations = 0
        self._step = settings.step
        self._last: tuple[float, np.ndarray] | None = None
        loose = np.ones(len(mesh.points), dtype=bool)
        loose[mesh.elements] = False
        self.fixed = fixed | loose[:, None]
        self._body = Assembly(mesh, self.materials, self.fixed, loads, self.contacts)
        self._support = Support(mesh, self.fixed)

    def advance(self, load: float, report: Report = unheard) -> None:
        """Carry the body to this load in as many steps as it takes; `report` hears the load after each. The first step
        is as large as the one before would have gone on with. ConvergenceError: a step of the least size fails; the
        last converged state is kept. ValueError: a load that is not finite."""
        if not np.isfinite(load):
            raise ValueError(f"load {load}: expected a finite number")
        while abs(load - self.load) > 1e-12 * max(1.0, abs(load)):
            left = load - self.load
            target = load if abs(left) < 1.01 * self._step else self.load + np.copysign(self._step, left)
            fault, used = self._try(target)
            if not fault:
                if used <= 8:
                    self._step = min(1.5 * self._step, self.settings.largest)
                report(self.load)
                continue
            self._step = 0.5 * abs(target - self.load)
            if self._step < self.settings.least:
                self._step = self.settings.step
                raise ConvergenceError(
                    f"load step from {self.load:.6g} to {target:.6g}: {fault}{self._apart()}. The state at load "
                    f"{self.load:.6g} is kept. A finer mesh where it fails, a smaller load or stiffer material would "
                    "help"
                )

    def _apart(self) -> str:
        apart = [f"contact {k}" for k, contact in enumerate(self.contacts) if not contact.touches()]
        if not apart:
            return ""
        return f"; nothing touches {', '.join(apart)}: contact is lost or not yet made, so a support is missing"

    def _try(self, load: float) -> tuple[str, int]:
        """One load step: why it failed, empty where it did not; and the iterations used."""
        before = self.iterations
        for contact in self.contacts:
            contact.begin(self.displacement, self.load)
        self._body.recouple()
        self._body.tangent.forget()
        try:
            u = self._newton(load)
            for contact in self.contacts:
                fault = contact.leapt(self.displacement, self.load, u, load)
                if fault:
                    raise _Fault(fault)
        except (_Fault, Inverted, UnheldError) as error:
            self._last = None
            for contact in self.contacts:
                contact.back()
            return str(error), self.iterations - before
        self._last = load - self.load, u - self.displacement
        self.displacement, self.load = u, load
        return "", self.iterations - before

    def _newton(self, load: float) -> np.ndarray:
        """Displacement (N,3) in balance at a load. _Fault: says why there is none."""
        goal = np.zeros_like(self.displacement)
        if self.held is not None:
            goal = checked("held", self.held(load), load, self.fixed)
        guess = self._extrapolated(goal, load)
        u, now = self._linear(goal, load) if guess is None else guess
        settings, used, since = self.settings, 0, 0
        while True:
            rest = np.where(self.fixed, 0.0, now.force)
            error = float(np.linalg.norm(rest))
            scale = max(now.size, float(np.linalg.norm(now.force)), self._body.floor / settings.tolerance)
            if not np.isfinite(error):
                raise _Fault("a force is not finite")
            done = error <= settings.tolerance * scale
            deep = error <= max(LOOSE, settings.tolerance) * scale and any(c.deep() for c in self.contacts)
            if done:
                fault = self._support.adrift(u, load, self.contacts, self._body.tangent.pattern)
                if fault:
                    raise _Fault(fault)
            if done or deep:
                for contact in self.contacts:
                    contact.settle()
            if done and not deep:
                self.reaction = np.where(self.fixed, now.force, 0.0)
                return u
            if deep:
                if used >= settings.iterations:
                    raise _Fault(f"penetration stays above its bound after {used} iterations")
                now, since = self._body.balance(u, load), 0
            if since >= settings.iterations:
                worst = int(np.argmax(np.linalg.norm(rest, axis=1)))
                raise _Fault(
                    f"no convergence in {since} iterations, residual {error / scale:.2g} of the forces, greatest at "
                    f"node {worst}, {point_text(self.mesh.points[worst])}"
                )
            du = self._direction(now.data, now.force)
            used, since = used + 1, since + 1
            carried = 0.0 if guess is None else float(np.linalg.norm(np.where(self.fixed, 0.0, u - self.displacement)))
            guess = None
            if 0.0 < carried < float(np.linalg.norm(du)):
                for contact in self.contacts:
                    contact.back()
                    contact.begin(self.displacement, self.load)
                u, now = self._linear(goal, load)
            else:
                u, now = self._searched(u, du, now, load)

    def _extrapolated(self, goal: np.ndarray, load: float) -> tuple[np.ndarray, Balance] | None:
        """Where the iteration starts, held displacements at their goal: on from the last step as that went. It is given
        up where Newton's correction is larger than what was carried on."""
        if self._last is None:
            return None
        u = self.displacement
        guess = np.where(self.fixed, goal, u + (load - self.load) / self._last[0] * self._last[1])
        with suppress(Inverted):
            return guess, self._body.balance(guess, load)
        return None

    def _linear(self, goal: np.ndarray, load: float) -> tuple[np.ndarray, Balance]:
        """The same, one linear step from where the last one ended."""
        u = self.displacement
        now = self._body.balance(u, load)
        jump = np.where(self.fixed, goal - u, 0.0)
        if jump.any():
            pull = (self._body.tangent.pattern.matrix(now.data) @ jump.ravel()).reshape(-1, 3) + self._body.skew(jump)
            u = np.where(self.fixed, goal, u + self._direction(now.data, now.force + pull))
            now = self._body.balance(u, load)
        return u, now

    def _direction(self, data: np.ndarray, force: np.ndarray) -> np.ndarray:
        """Newton's change of the free displacements (N,3) that answers an unbalanced force (N,3), with the active set
        at its end where that leads downhill: about a tangent that is not convex it need not."""
        self.iterations += 1
        step = self._body.tangent.direction(data, np.where(self.fixed, 0.0, -force), self._body.skew)
        switched = self._body.switched(step)
        return switched if np.sum(switched * force) < 0.0 else step

    def _searched(self, u: np.ndarray, du: np.ndarray, now: Balance, load: float) -> tuple[np.ndarray, Balance]:
        """The point along a direction where the slope has fallen and no element is inside out."""
        slope, least, best, length = abs(float(np.sum(du * now.force))), np.inf, 0.0, 1.0
        for _ in range(12):
            try:
                balance = self._body.balance(u + length * du, load)
            except Inverted as error:
                fault = error
            else:
                slant = abs(float(np.sum(du * balance.force)))
                if slant < least:
                    least, best = slant, length
                if slant <= 0.9 * slope or length < 0.05:
                    break
            length *= 0.5
        if best == 0.0:
            raise fault
        u = u + best * du
        return u, balance if best == length else self._body.balance(u, load)

    def save(self, path: str | Path) -> None:
        """Write what `resume` needs: a run that is resumed takes the steps that it would have taken."""
        last = (0.0, np.zeros_like(self.displacement)) if self._last is None else self._last
        write_state(path, SolverState(self.load, self.displacement, self._step, *last), self.contacts)

    def resume(self, path: str | Path) -> None:
        """Go on from a saved state of the same model. ValueError: a file of another model, or none of `save`."""
        state = read_state(path, self.displacement, self.contacts)
        self.load, self.displacement, self._step = state.load, state.displacement, state.step
        self._last = (state.moved, state.change) if state.moved else None
