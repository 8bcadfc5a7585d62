"""Sampled basis of a body, and the touches for the reduction of the layered fingertip and of organs."""

from pathlib import Path

import numpy as np
from scipy.stats import qmc

from palpate.models.fe.progress import Report, unheard
from palpate.models.fe.reduce import snapshots
from palpate.models.fe.reduce.reducible import SUBCUTIS_MODULUS, Reducible
from palpate.models.fe.reduce.sampling import SAMPLING, at_rest, fit_gamma, modes, points_of, sample, select_points
from palpate.models.fe.reduce.snapshots import LoadPath, PressSolution, mirror
from palpate.physics.bodies.sampled.energy import Points, scratch
from palpate.physics.bodies.sampled.solve import offline_budget, settle
from palpate.physics.bodies.sampled_body import SampledBasis, SampledBody, answer, bear, sampled_body

CELLS = 3  # Resolution of the fingertip's mesh, see `fe.meshing.fingertip`
TOUCHES, SEED = 120, 1  # Touches of the full model; the fingertip adds their mirror images
PULLED, PULLED_SEED = 24, 9  # Touches with the largest tangential force, where the truncation error is largest
HELD, HELD_SEED = 18, 5  # Held-out touches, which set the stiffening but not the modes
ORGAN_TOUCHES, ORGAN_HELD = 40, 10  # TOUCHES and HELD of an organ
UNSEEN, UNSEEN_SEED = 8, 2  # Touches for the error of the basis only
RADII = (3e-3, 6e-3)  # [m] Of their patches
HARDEST = 4e4 * 36.4 / SUBCUTIS_MODULUS
"""[1] Largest force over modulus and squared radius: 1 N on 5 mm of a finger of E = 160 Pa, about 2 mm deep."""
ROUND, BEHIND = float(np.deg2rad(65.0)), 7e-3
"""[rad], [m] Range of the touches: angle around the pulp and over the tip, distance behind the start of the tip."""
ORGAN_RADIUS, SOFTEST = 8e-3, 0.82
"""[m], [1] Patch radius and largest load of an organ: 1 N on 8 mm at 19 kPa. With more, a surface that slides freely
loses its equilibrium (docs/equations/reduced-fe.md)."""
ASIDE = 0.5  # [1] Largest ratio of tangential to normal force
BEYOND = 4.0  # |q|² at which the barrier begins, over the largest of the snapshots


def finger_touches(body: Reducible, count: int, seed: int, pulled: bool = False) -> list[LoadPath]:
    """Touches of one side of the pulp within `ROUND` and `BEHIND`, by a Halton sequence; half of them with a tangential
    force, or all with the largest if `pulled`."""
    radius = float(body.surface.vertices[:, 2].max())
    touches = []
    for x in qmc.Halton(5, seed=seed).random(count):
        y, turn = x[0] * (BEHIND + radius * ROUND) - BEHIND, x[1] * ROUND
        tip = max(y, 0.0) / radius
        out = np.array([np.sin(turn) * np.cos(tip), np.sin(tip), np.cos(turn) * np.cos(tip)])
        foot = np.array([0.0, min(y, 0.0), 0.0]) + radius * out
        patch = RADII[0] + x[2] * (RADII[1] - RADII[0])
        share = 1.0 if pulled else max(2.0 * x[3] - 1.0, 0.0)
        pull = ASIDE * share * snapshots.aside(out, np.array([0.0, 1.0, 0.0]), x[4])
        touches.append(snapshots.touch(body.surface, foot, out, patch, HARDEST * patch**2 * snapshots.STIFFENING, pull))
    return touches


def organ_touches(body: Reducible, count: int, seed: int = SEED) -> list[LoadPath]:
    """Touches of an organ, except on the part that faces its foundation."""
    surface = body.surface
    region = surface.face_vectors[:, 2] > -0.5 * np.linalg.norm(surface.face_vectors, axis=1)
    return snapshots.scatter(surface, count, region, ORGAN_RADIUS, SOFTEST * ORGAN_RADIUS**2 * snapshots.MILD, seed)


def full_solutions(
    body: Reducible, finger: bool, report: Report, folder: Path
) -> tuple[list[PressSolution], list[PressSolution]]:
    """Full solutions of the touches of a body, for the fingertip also of their mirror images, and of held-out ones."""
    if finger:
        touches = finger_touches(body, TOUCHES, SEED) + finger_touches(body, PULLED, PULLED_SEED, pulled=True)
        count = len(touches)
        presses = snapshots.press_touches(body, touches + finger_touches(body, HELD, HELD_SEED), report, folder)
    else:
        touches, count = organ_touches(body, ORGAN_TOUCHES + ORGAN_HELD), ORGAN_TOUCHES
        presses = snapshots.press_from_rest(body, touches, report, folder)
    seen, held = ([p for p in part if len(p.solutions)] for part in (presses[:count], presses[count:]))
    if finger:
        seen += snapshots.mirror_solutions(seen, mirror(body.mesh.points), mirror(body.surface.vertices))
    return seen, held


def unseen_solutions(body: Reducible, finger: bool, report: Report) -> list[PressSolution]:
    """Full solutions of touches for the error of the basis only."""
    if finger:
        return snapshots.press_touches(body, finger_touches(body, UNSEEN, UNSEEN_SEED), report)
    return snapshots.press_from_rest(body, organ_touches(body, UNSEEN, UNSEEN_SEED), report)


def build(
    body: Reducible,
    pressed: list[PressSolution],
    held_out: list[PressSolution],
    count: int,
    report: Report = unheard,
    tolerance: float = SAMPLING,
) -> SampledBasis:
    """The sampled basis of a body with `count` modes of its full solutions, and points sampled to a tolerance.

    held_out  touches for the stiffening of the residual compliance; the truncation error of the touches that the modes
              were built from is too small for it
    """
    phi, states = modes(body, pressed, count)
    surface_modes = np.einsum("nv,nia->via", body.hats, phi, optimize=True).reshape(-1, phi.shape[2])
    residual_compliance = body.compliance() - surface_modes @ surface_modes.T
    limit = BEYOND * float(np.einsum("sa,sa->s", states, states).max())
    whole = points_of(body, phi, limit)
    points = at_rest(select_points(whole, *sample(whole, states, tolerance, report=report)))
    points = points._replace(modes=points.modes.astype(np.float32))
    w, pull, weight = truncation_errors(points, surface_modes, residual_compliance, body, held_out)
    bend = (*fit_gamma(w, pull, weight), np.sqrt(BEYOND) * float(w.max()))
    surface, missed = body.surface, residual_compliance.astype(np.float32)
    return SampledBasis(surface.vertices, surface.triangles, missed, surface_modes, points, bend)


def truncation_errors(
    points: Points,
    surface_modes: np.ndarray,
    residual_compliance: np.ndarray,
    body: Reducible,
    pressed: list[PressSolution],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Truncation error of the modes at every level of the touches: the size w of the load on the residual compliance,
    its displacement in the full solutions, and the share of the indentation per unit of displacement."""
    r, work = surface_modes.shape[1], scratch(points)
    sizes, pulls, shares = [], [], []
    for press in pressed:
        unit = press.touch.load.ravel()
        across = float(np.sqrt(max(unit @ (residual_compliance @ unit), 0.0)))
        q, g, H = np.zeros(r), np.zeros(r), np.eye(r)
        K, L, vectors, energy = np.zeros((r, r)), np.zeros((r, r)), np.zeros((4, r)), 0.0
        for level, u in zip(press.touch.levels, press.solutions, strict=False):
            for _ in range(8):
                energy, _, done = settle(
                    points, work, level * (surface_modes.T @ unit), q, g, H, K, L, vectors, energy, offline_budget()
                )
                if done:
                    break
            sizes.append(level * across)
            full = float(np.sum((body.hats @ press.touch.load) * u))
            pulls.append((full - unit @ (surface_modes @ q)) / across)
            shares.append(across / full)
    return np.array(sizes), np.array(pulls), np.array(shares)


def equilibrium(body: SampledBody, press: PressSolution, nodes: np.ndarray, force: float) -> float:
    """Indentation [m] of an elastic body under a constant force [N]; nodes (k,): loaded by the touch."""
    push, foot, normal = press.touch.load[nodes], tuple(press.touch.foot), tuple(press.touch.normal)
    laws = np.zeros((1, 5))
    for _ in range(6):
        bear(body, 0, nodes, force * push, foot, normal)
        _, settled = answer(body, laws, np.eye(1), 1e6)
        if settled:
            break
    return float(laws[0, 4])


def errors(body: Reducible, basis: SampledBasis, pressed: list[PressSolution]) -> tuple[np.ndarray, np.ndarray]:
    """Relative errors (S,) of the indentation at every load of touches that the basis was not built from: of the
    sampled body, and of its linear compliance at rest."""
    young, radius = 1e4, 1e-2  # [Pa] and [m]; the errors do not depend on them
    sampled, linear = [], []
    for press in pressed:
        fast, touch = sampled_body(basis, body.surface, young, 0.0, radius, radius), press.touch
        nodes = np.flatnonzero(np.abs(touch.load).max(axis=1) > 0.0).astype(np.int32)
        along = touch.normal * (touch.load @ touch.normal)[:, None]
        measure, unit = along.ravel(), touch.load.ravel()
        compliance = measure @ (basis.residual_compliance @ unit) + (measure @ basis.modes) @ (basis.modes.T @ unit)
        for level, u in zip(touch.levels, press.solutions, strict=False):
            indentation = float(np.sum((body.hats @ along) * u))
            sampled.append(equilibrium(fast, press, nodes, float(level) * young) / indentation - 1.0)
            linear.append(float(level) * compliance / indentation - 1.0)
    return np.array(sampled), np.array(linear)
