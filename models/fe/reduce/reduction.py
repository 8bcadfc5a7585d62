"""From a body to its sampled basis, and the touches that the layered fingertip is reduced from."""

from pathlib import Path

import numpy as np
from scipy.stats import qmc

from palpate.models.fe.progress import Report, unheard
from palpate.models.fe.reduce import snapshots
from palpate.models.fe.reduce.reducible import SUBCUTIS_MODULUS, Reducible
from palpate.models.fe.reduce.sampling import SAMPLING, at_rest, bent, chosen, modes, points_of, sample
from palpate.models.fe.reduce.snapshots import LoadPath, PressSolution, mirror
from palpate.physics.bodies.sampled.energy import Points, scratch
from palpate.physics.bodies.sampled.solve import settle, unhurried
from palpate.physics.bodies.sampled_body import SampledBasis

CELLS = 3  # Fineness of the fingertip's mesh, see `fe.fingertip`
TOUCHES, SEED = 120, 1  # Touches that are solved in full; of the fingertip, their mirror images come free
PULLED, PULLED_SEED = 24, 9  # More of them, all with the greatest tangential force: what the modes miss most
HELD, HELD_SEED = 18, 5  # Touches that the modes are not made from
ORGAN_TOUCHES, ORGAN_HELD = 40, 10  # The same of an organ
UNSEEN, UNSEEN_SEED = 8, 2  # Touches that a basis is not made from in any way and is compared with the full model on
RADII = (3e-3, 6e-3)  # [m] Of their patches
HARDEST = 4e4 * 36.4 / SUBCUTIS_MODULUS
"""[m²/m²] Greatest force over modulus and squared radius: 1 N on 5 mm of a finger of E = 160 Pa, about 2 mm deep."""
ROUND, BEHIND = float(np.deg2rad(65.0)), 7e-3
"""[rad], [m] How far round the pulp and over the tip, and how far behind the tip's beginning, touches go."""
ORGAN_RADIUS, SOFTEST = 8e-3, 0.82
"""[m], [1] The same of an organ: 1 N on 8 mm at 19 kPa; beyond, a surface that is free to slide gives way
(docs/equations/reduced-fe.md)."""
ASIDE = 0.5  # [1] Greatest tangential force over the normal one
BEYOND = 4.0  # Squared size of q at which the barrier begins, over the greatest in the snapshots


def finger_touches(body: Reducible, count: int, seed: int, pulled: bool = False) -> list[LoadPath]:
    """Touches of one side of the pulp, up to `ROUND` round it and over the tip and `BEHIND` behind it, by Halton's
    sequence; half of them with a tangential force, or all with the greatest."""
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


def finger_pressed(
    body: Reducible, report: Report = unheard, folder: Path | None = None
) -> tuple[list[PressSolution], list[PressSolution]]:
    """Full solutions of the fingertip's touches and of their mirror images; and of those that are held out."""
    touches = finger_touches(body, TOUCHES, SEED) + finger_touches(body, PULLED, PULLED_SEED, pulled=True)
    presses = snapshots.press(body, touches + finger_touches(body, HELD, HELD_SEED), report, folder)
    seen, held = ([p for p in part if len(p.solutions)] for part in (presses[: len(touches)], presses[len(touches) :]))
    return seen + snapshots.mirrored(seen, mirror(body.mesh.points), mirror(body.surface.vertices)), held


def organ_touches(body: Reducible, count: int, seed: int = SEED) -> list[LoadPath]:
    """Touches of the part of an organ that does not look down on its bed."""
    surface = body.surface
    region = surface.face_vectors[:, 2] > -0.5 * np.linalg.norm(surface.face_vectors, axis=1)
    return snapshots.scatter(surface, count, region, ORGAN_RADIUS, SOFTEST * ORGAN_RADIUS**2 * snapshots.MILD, seed)


def organ_pressed(
    body: Reducible, report: Report = unheard, folder: Path | None = None
) -> tuple[list[PressSolution], list[PressSolution]]:
    """Full solutions of an organ's touches; and of those that are held out."""
    presses = snapshots.press_from_rest(body, organ_touches(body, ORGAN_TOUCHES + ORGAN_HELD, SEED), report, folder)
    seen, held = ([p for p in part if len(p.solutions)] for part in (presses[:ORGAN_TOUCHES], presses[ORGAN_TOUCHES:]))
    return seen, held


def build(
    body: Reducible,
    pressed: list[PressSolution],
    held: list[PressSolution],
    count: int,
    report: Report = unheard,
    tolerance: float = SAMPLING,
) -> SampledBasis:
    """The sampled basis of a body in `count` modes of its full solutions, its points sampled to a tolerance.

    held  touches that the modes were not made from: the error there tells how it stiffens. Of their own touches
          they miss next to nothing, which tells nothing
    """
    phi, states = modes(body, pressed, count)
    surface_modes = np.einsum("nv,nia->via", body.hats, phi, optimize=True).reshape(-1, phi.shape[2])
    residual_compliance = body.compliance() - surface_modes @ surface_modes.T
    limit = BEYOND * float(np.einsum("sa,sa->s", states, states).max())
    whole = points_of(body, phi, limit)
    points = at_rest(chosen(whole, *sample(whole, states, tolerance, report=report)))
    points = points._replace(modes=points.modes.astype(np.float32))
    w, pull, weight = answers(points, surface_modes, residual_compliance, body, held)
    bend = (*bent(w, pull, weight), np.sqrt(BEYOND) * float(w.max()))
    surface, missed = body.surface, residual_compliance.astype(np.float32)
    return SampledBasis(surface.vertices, surface.triangles, missed, surface_modes, points, bend)


def answers(
    points: Points,
    surface_modes: np.ndarray,
    residual_compliance: np.ndarray,
    body: Reducible,
    pressed: list[PressSolution],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What the modes alone miss of the touches, level by level: the size w of the load on it, how far it moves there in
    the full solutions, and what of the indentation that is for each unit."""
    r, work = surface_modes.shape[1], scratch(points)
    sizes, pulls, shares = [], [], []
    for own in pressed:
        unit = own.touch.load.ravel()
        across = float(np.sqrt(max(unit @ (residual_compliance @ unit), 0.0)))
        q, g, H = np.zeros(r), np.zeros(r), np.eye(r)
        K, L, vectors, energy = np.zeros((r, r)), np.zeros((r, r)), np.zeros((4, r)), 0.0
        for level, u in zip(own.touch.levels, own.solutions, strict=False):
            for _ in range(8):
                energy, _, done = settle(
                    points, work, level * (surface_modes.T @ unit), q, g, H, K, L, vectors, energy, unhurried()
                )
                if done:
                    break
            sizes.append(level * across)
            full = float(np.sum((body.hats @ own.touch.load) * u))
            pulls.append((full - unit @ (surface_modes @ q)) / across)
            shares.append(across / full)
    return np.array(sizes), np.array(pulls), np.array(shares)
