"""From a body to its sampled basis, and the touches that the layered fingertip is reduced from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.stats import qmc

from palpate.fe.fingertip import CALIBRATED
from palpate.fe.reducible import SUBCUTIS_MODULUS, Reducible
from palpate.fe.sampling import SAMPLING, at_rest, bent, chosen, elements_of, inner, modes, sample
from palpate.fe.snapshots import (
    MILD,
    STIFFENING,
    Pressed,
    Touch,
    aside,
    mirror,
    mirrored,
    press,
    press_from_rest,
    scatter,
    touch,
)
from palpate.physics.sampled import SampledBasis
from palpate.physics.sampled_energy import Elements, scratch
from palpate.physics.sampled_solve import settle

CELLS = 3
"""Fineness of the fingertip's mesh, see `fe.fingertip`."""
TOUCHES = 44
"""Touches that are solved in full; of the fingertip, their mirror images come free."""
RADII = (3e-3, 6e-3)
"""[m] Of their patches."""
HARDEST = 4e4 * CALIBRATED / SUBCUTIS_MODULUS
"""[m²/m²] Greatest force over modulus and squared radius: 1 N on 5 mm of the calibrated finger, about 2 mm deep."""
ROUND, BEHIND = float(np.deg2rad(65.0)), 7e-3
"""[rad], [m] How far round the pulp and over the tip, and how far behind the tip's beginning, touches go."""
ORGAN_RADIUS, SOFTEST = 8e-3, 0.82
"""[m], [1] The same of an organ: 1 N on 8 mm at 19 kPa; beyond, organs give way (docs/equations/reduced-fe.md)."""
ASIDE = 0.5
"""[1] Greatest tangential force over the normal one."""
SEED = 1
BEYOND = 4.0
"""Squared size of q at which the barrier begins, over the greatest in the snapshots."""
UNBOUND = 1e300
UNSEEN = 8
"""Touches that a basis is not made from and is compared with the full model on."""
FOLDS = 4
"""Parts of the touches that are left out in turn to find gamma."""


def finger_touches(body: Reducible, count: int = TOUCHES, seed: int = SEED) -> list[Touch]:
    """Touches of one side of the pulp, up to `ROUND` round it and over the tip and `BEHIND` behind it, by Halton's
    sequence; half of them with a tangential force."""
    radius = float(body.surface.vertices[:, 2].max())
    found = []
    for x in qmc.Halton(5, seed=seed).random(count):
        y, turn = x[0] * (BEHIND + radius * ROUND) - BEHIND, x[1] * ROUND
        tip = max(y, 0.0) / radius
        out = np.array([np.sin(turn) * np.cos(tip), np.sin(tip), np.cos(turn) * np.cos(tip)])
        foot = np.array([0.0, min(y, 0.0), 0.0]) + radius * out
        patch = RADII[0] + x[2] * (RADII[1] - RADII[0])
        pull = ASIDE * max(2.0 * x[3] - 1.0, 0.0) * aside(out, np.array([0.0, 1.0, 0.0]), x[4])
        found.append(touch(body.surface, foot, out, patch, HARDEST * patch**2 * STIFFENING, pull))
    return found


def finger_pressed(body: Reducible, report: Callable[[float], None] | None = None) -> list[Pressed]:
    """Full solutions of the fingertip's touches and of their mirror images."""
    found = [p for p in press(body, finger_touches(body), report) if len(p.solutions)]
    return found + mirrored(found, mirror(body.mesh.points), mirror(body.surface.vertices))


def organ_touches(body: Reducible, count: int = TOUCHES, seed: int = SEED) -> list[Touch]:
    """Touches of the part of an organ that does not look down on its bed."""
    surface = body.surface
    region = surface.face_vectors[:, 2] > -0.5 * np.linalg.norm(surface.face_vectors, axis=1)
    return scatter(surface, count, region, ORGAN_RADIUS, SOFTEST * ORGAN_RADIUS**2 * MILD, seed)


def organ_pressed(body: Reducible, report: Callable[[float], None] | None = None) -> list[Pressed]:
    """Full solutions of an organ's touches."""
    return [p for p in press_from_rest(body, organ_touches(body), report) if len(p.solutions)]


@dataclass(frozen=True)
class InModes:
    """A body in its modes, all elements counted.

    surface_modes  [m]   (3V,r) of the vertices of the surface
    missed         [m/N] (3V,3V), what of the compliance at rest the modes miss
    whole          every element, with weight 1
    states         q (r,) at every level of every touch: what the elements are sampled at
    bend           [1]   (w0, m) of gamma, and w from which on gamma w is constant
    """

    surface_modes: np.ndarray
    missed: np.ndarray
    whole: Elements
    states: list[np.ndarray]
    bend: tuple[float, float, float]


def in_modes(
    body: Reducible, pressed: list[Pressed], count: int, report: Callable[[float], None] | None = None
) -> InModes:
    """A body in `count` modes of its full solutions; `report` hears the share done.

    ValueError: they are all of one place, so that nothing tells what touches elsewhere do.
    """
    compliance, product = body.compliance(), inner(body, pressed)
    bend = left_out(body, pressed, count, compliance, product, report)
    phi, surface_modes, missed = _split(body, pressed, count, compliance, product)
    states, *_ = answers(elements_of(body, phi, UNBOUND), surface_modes, missed, body, pressed)
    whole = elements_of(body, phi, BEYOND * max(float(q @ q) for q in states))
    return InModes(surface_modes, missed, whole, states, bend)


def left_out(
    body: Reducible,
    pressed: list[Pressed],
    count: int,
    compliance: np.ndarray,
    product: csr_array,
    report: Callable[[float], None] | None = None,
) -> tuple[float, float, float]:
    """w0 and m of gamma, and w from which on gamma w is constant, from touches that made no mode; `report` hears the
    share done.

    Each part of the touches answers in the modes of the other parts. Modes fit the touches that they are made of: what
    they miss there is small and follows no law, and a gamma fitted to it drops what they miss elsewhere. Touches of one
    place and of its mirror image in x are left out together.
    """
    _, place = np.unique([np.abs(p.touch.foot) for p in pressed], axis=0, return_inverse=True)
    part, parts = place.ravel() % FOLDS, []
    for k in np.unique(part).tolist():
        others = [p for p, own in zip(pressed, part.tolist(), strict=True) if own != k]
        if not others:
            raise ValueError("all touches are of one place, expected two places or more")
        phi, surface_modes, missed = _split(body, others, count, compliance, product)
        mine = [p for p, own in zip(pressed, part.tolist(), strict=True) if own == k]
        parts.append(answers(elements_of(body, phi, UNBOUND), surface_modes, missed, body, mine)[1:])
        if report is not None:
            report((k + 1) / (part.max() + 1))
    w, pull, weight = (np.concatenate(found) for found in zip(*parts, strict=True))
    return (*bent(w, pull, weight), float(np.sqrt(BEYOND) * w.max()))


def _split(
    body: Reducible, pressed: list[Pressed], count: int, compliance: np.ndarray, product: csr_array
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Modes (N,3,r) of these solutions, the same of the surface (3V,r), and what of its compliance they miss."""
    phi = modes(body, pressed, count, product)
    surface_modes = np.einsum("nv,nia->via", body.hats, phi, optimize=True).reshape(-1, phi.shape[2])
    return phi, surface_modes, compliance - surface_modes @ surface_modes.T


def sampled(
    body: Reducible,
    full: InModes,
    tolerance: float = SAMPLING,
    report: Callable[[float], None] | None = None,
) -> SampledBasis:
    """The basis of a body whose elements are sampled to a tolerance; `report` hears the share done."""
    which, weights = sample(full.whole, full.states, tolerance, report=report)
    elements = at_rest(chosen(full.whole, which, weights))
    surface, missed = body.surface, full.missed.astype(np.float32)
    return SampledBasis(surface.vertices, surface.triangles, missed, full.surface_modes, elements, full.bend)


def build(
    body: Reducible,
    pressed: list[Pressed],
    count: int,
    report: Callable[[float], None] | None = None,
    tolerance: float = SAMPLING,
) -> SampledBasis:
    """The sampled basis of a body in `count` modes, its elements sampled to a tolerance; `report` hears the
    share done."""
    return sampled(body, in_modes(body, pressed, count), tolerance, report)


def answers(
    elements: Elements, surface_modes: np.ndarray, missed: np.ndarray, body: Reducible, pressed: list[Pressed]
) -> tuple[list[np.ndarray], np.ndarray, np.ndarray, np.ndarray]:
    """What the modes alone answer to the touches: q of each level, the size w of the load on what they miss, how far it
    moves there in the full solutions, and what of the indentation that is for each unit."""
    r, work = surface_modes.shape[1], scratch(elements)
    states, sizes, pulls, shares = [], [], [], []
    for own in pressed:
        unit = own.touch.load.ravel()
        across = float(np.sqrt(max(unit @ (missed @ unit), 0.0)))
        q, g, H = np.zeros(r), np.zeros(r), np.eye(r)
        K, L, vectors, energy = np.zeros((r, r)), np.zeros((r, r)), np.zeros((4, r)), 0.0
        for level, u in zip(own.touch.levels, own.solutions, strict=False):
            for _ in range(8):
                energy, _, done = settle(
                    elements, work, level * (surface_modes.T @ unit), q, g, H, K, L, vectors, energy
                )
                if done:
                    break
            states.append(q.copy())
            sizes.append(level * across)
            full = float(np.sum((body.hats @ own.touch.load) * u))
            pulls.append((full - unit @ (surface_modes @ q)) / across)
            shares.append(across / full)
    return states, np.array(sizes), np.array(pulls), np.array(shares)
