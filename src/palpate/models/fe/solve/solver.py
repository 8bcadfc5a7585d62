"""Static equilibrium of a soft body in load steps: Newton iteration with line search and adaptive load steps."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from palpate.models.fe.contact.protocol import ContactPair
from palpate.models.fe.element.mesh import MeshError, TetMesh, point_text
from palpate.models.fe.progress import Report, unheard
from palpate.models.fe.solve.assembly import Assembly, Balance, Inverted
from palpate.models.fe.solve.support import Support, check_materials, check_values
from palpate.models.fe.sparse.tangent import UnheldError
from palpate.physics.archive import ArchiveError, read_arrays, replacing
from palpate.physics.errors import PalpateError
from palpate.physics.materials.hyperelastic import Material


class ConvergenceError(PalpateError, ArithmeticError):
    """The smallest load step fails; the message has the load and the cause. The solver keeps its last state."""


class _NoEquilibrium(ArithmeticError):
    """A load step fails; the message is the cause."""


@dataclass(frozen=True)
class Settings:
    """Load steps and convergence."""

    tolerance: float = 1e-6  # [1] residual over the largest of reaction, contact and internal forces
    iterations: int = 40  # largest number of Newton iterations per load step; then the step is halved
    step: float = 0.1  # first load step; it grows to `largest` while Newton converges fast
    largest: float = 0.25
    least: float = 1e-4  # smallest load step

    def __post_init__(self) -> None:
        for name in ("tolerance", "iterations", "step", "largest", "least"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise ValueError(f"settings: {name} {getattr(self, name)}, expected a positive number")


DEFAULT = Settings()

LOOSE = 0.1
"""[1] Residual below which contact multipliers are updated while the penetration exceeds its bound; the next step then
corrects the residual and the new multipliers together."""


class Solver:
    """A body with materials, supports and contacts; `advance` solves for the equilibrium at a load.

    mesh       quadratic tetrahedra
    materials  by region number
    fixed      (N,3) bool, prescribed displacement components
    held       load -> prescribed displacement [m] (N,3) at the fixed components; zero by default
    loads      load -> external nodal forces [N] (N,3); none by default
    contacts   see `fe.contact.protocol`

    The load is a scalar parameter of the functions above; it starts at 0.

    MeshError, MaterialError, ValueError: a region without material, an inverted element, wrong units, an unsupported
    piece, a mask of the wrong shape.
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
        check_materials(mesh, materials)
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
        self._support = Support(mesh, self.fixed, [contact.nodes() for contact in contacts])
        self._body = Assembly(mesh, self.materials, self.fixed, loads, self.contacts)

    def advance(self, load: float, report: Report = unheard) -> None:
        """Solve up to a load in adaptive steps; `report` is called with the load after each step.

        The step size carries over from the previous call. ConvergenceError: the smallest step fails; the last converged
        state remains. ValueError: the load is not finite.
        """
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
        """One load step: (cause of failure or "", number of iterations)."""
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
                    raise _NoEquilibrium(fault)
        except (_NoEquilibrium, Inverted, UnheldError) as error:
            self._last = None
            for contact in self.contacts:
                contact.back()
            return str(error), self.iterations - before
        self._last = load - self.load, u - self.displacement
        self.displacement, self.load = u, load
        return "", self.iterations - before

    def _newton(self, load: float) -> np.ndarray:
        """Displacement (N,3) in equilibrium at a load: Newton iteration with augmented contact. _NoEquilibrium: no
        convergence."""
        # initial guess: extrapolation of the last step, else a linear step
        goal = np.zeros_like(self.displacement)
        if self.held is not None:
            goal = check_values("held", self.held(load), load, self.fixed)
        guess = self._extrapolate_step(goal, load)
        u, now = self._linear(goal, load) if guess is None else guess
        settings, used, since = self.settings, 0, 0
        while True:
            # convergence of the residual, and of the penetration
            rest = np.where(self.fixed, 0.0, now.force)
            error = float(np.linalg.norm(rest))
            scale = max(now.size, float(np.linalg.norm(now.force)), self._body.floor / settings.tolerance)
            if not np.isfinite(error):
                raise _NoEquilibrium("a force is not finite")
            done = error <= settings.tolerance * scale
            deep = error <= max(LOOSE, settings.tolerance) * scale and any(c.deep() for c in self.contacts)
            if done:
                fault = self._support.adrift(u, load, self.contacts, self._body.tangent.pattern)
                if fault:
                    raise _NoEquilibrium(fault)
            # augmentation: update the contact multipliers
            if done or deep:
                for contact in self.contacts:
                    contact.settle()
            if done and not deep:
                self.reaction = np.where(self.fixed, now.force, 0.0)
                return u
            if deep:
                if used >= settings.iterations:
                    raise _NoEquilibrium(f"penetration stays above its bound after {used} iterations")
                now, since = self._body.balance(u, load), 0
            # Newton step; a correction larger than the extrapolation discards the extrapolation
            if since >= settings.iterations:
                worst = int(np.argmax(np.linalg.norm(rest, axis=1)))
                raise _NoEquilibrium(
                    f"no convergence in {since} iterations, residual {error / scale:.2g} of the forces, largest at "
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
                u, now = self._search_line(u, du, now, load)

    def _extrapolate_step(self, goal: np.ndarray, load: float) -> tuple[np.ndarray, Balance] | None:
        """Initial guess by linear extrapolation of the last step, with prescribed displacements at their goal."""
        if self._last is None:
            return None
        u = self.displacement
        guess = np.where(self.fixed, goal, u + (load - self.load) / self._last[0] * self._last[1])
        with suppress(Inverted):
            return guess, self._body.balance(guess, load)
        return None

    def _linear(self, goal: np.ndarray, load: float) -> tuple[np.ndarray, Balance]:
        """Initial guess by one linear step from the last equilibrium."""
        u = self.displacement
        now = self._body.balance(u, load)
        jump = np.where(self.fixed, goal - u, 0.0)
        if jump.any():
            pull = (self._body.tangent.pattern.matrix(now.data) @ jump.ravel()).reshape(-1, 3) + self._body.skew(jump)
            u = np.where(self.fixed, goal, u + self._direction(now.data, now.force + pull))
            now = self._body.balance(u, load)
        return u, now

    def _direction(self, data: np.ndarray, force: np.ndarray) -> np.ndarray:
        """Newton's step of the free displacements (N,3) for an unbalanced force (N,3).

        The active set of contacts is that at the end of the step, if the step then is a descent direction; it need not
        be with an indefinite tangent.
        """
        self.iterations += 1
        step = self._body.tangent.direction(data, np.where(self.fixed, 0.0, -force), self._body.skew)
        switched = self._body.switch_step(step)
        return switched if np.sum(switched * force) < 0.0 else step

    def _search_line(self, u: np.ndarray, du: np.ndarray, now: Balance, load: float) -> tuple[np.ndarray, Balance]:
        """Line search along du for a smaller slope of the energy without inverted elements."""
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

    def _state(self) -> dict[str, np.ndarray]:
        u, (moved, change) = self.displacement, self._last or (0.0, np.zeros_like(self.displacement))
        run = {"load": self.load, "displacement": u, "step": self._step, "moved": moved, "change": change}
        contacts = {f"contact{k}.{n}": x for k, c in enumerate(self.contacts) for n, x in c.state().items()}
        return {name: np.asarray(value) for name, value in (run | contacts).items()}

    def save(self, path: str | Path) -> None:
        """Write a checkpoint atomically; a resumed run takes the same steps."""
        with replacing(Path(path)) as part, part.open("wb") as file:
            np.savez(file, allow_pickle=False, **self._state())

    def resume(self, path: str | Path) -> None:
        """Resume from a checkpoint. ValueError: a file of another model, or not written by `save`."""
        try:
            state = read_arrays(path)
        except ArchiveError as error:
            raise ValueError(f"{path}: not a saved state ({error}); remove it to start again") from None
        found, expected = ({name: value.shape for name, value in s.items()} for s in (state, self._state()))
        wrong = [name for name in found | expected if found.get(name) != expected.get(name)]
        if wrong:
            sizes = [s.get(wrong[0], "none") for s in (found, expected)]
            raise ValueError(f"{path}: a state of another model: {wrong[0]}: found {sizes[0]}, expected {sizes[1]}")
        self.load, self.displacement, self._step = float(state["load"]), state["displacement"], float(state["step"])
        self._last = (float(state["moved"]), state["change"]) if state["moved"] else None
        for k, contact in enumerate(self.contacts):
            head = f"contact{k}."
            contact.restore({name.removeprefix(head): x for name, x in state.items() if name.startswith(head)})
