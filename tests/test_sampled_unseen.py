"""The body in modes where it was never pressed: what the modes miss there, against the full model and closed forms."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from pytest import approx

from palpate.fe import faces
from palpate.fe.organ import Organ
from palpate.fe.reducible import of_organ
from palpate.fe.reduction import answers, build, in_modes
from palpate.fe.sampling import elements_of, modes
from palpate.fe.snapshots import MILD, press_from_rest, scatter
from palpate.fe.unseen import errors
from palpate.nodes.surface import surface_mesh
from palpate.physics.sampled_energy import forces, scratch, tangent

RADIUS, UNBOUND = 12e-3, 1e300


@lru_cache
def slab():
    return of_organ(Organ(surface_mesh("plane", 80)))


@lru_cache
def pressed(count, seed):
    surface = slab().surface
    middle = surface.vertices[surface.triangles].mean(axis=1)
    inner = np.abs(middle).max(axis=1) < 0.026
    return press_from_rest(slab(), scatter(surface, count, inner, RADIUS, 1.5 * RADIUS**2 * MILD, seed))


def depth(own):
    """Indentation of the full model at the greatest load [m]."""
    return float(np.sum((slab().hats @ own.touch.load) * own.solutions[-1]))


def test_touches_elsewhere_are_met_by_modes_that_span_every_snapshot():
    """Ten touches at four loads and forty modes: what these miss of their own touches is rounding, and tells nothing of
    what they miss elsewhere. A gamma fitted to it was 17 % off in the mean, 41 % at worst."""
    basis, compliance = build(slab(), pressed(10, 3), 40, tolerance=3e-3), slab().compliance()
    assert basis.modes.shape[1] == 40
    unseen = pressed(5, 17)
    missed, linear = (np.abs(found).reshape(5, -1) for found in errors(slab(), basis, unseen))
    by_hand = [p.touch.levels[-1] * p.touch.load.ravel() @ compliance @ p.touch.load.ravel() for p in unseen]
    assert linear[:, -1] == approx([abs(s / depth(p) - 1.0) for s, p in zip(by_hand, unseen, strict=True)], rel=1e-3)
    assert missed.mean(axis=0)[-1] < linear.mean(axis=0)[-1]
    assert missed.max() < 0.1


def test_the_energy_in_modes_falls_with_their_number_and_stays_above_the_full_one():
    """Fewer modes are spanned by more, these by all displacements: W - p.q falls. All elements count; of the full model
    its own solution is the one mode."""
    seen, unseen = pressed(10, 3), pressed(5, 17)[:2]
    compliance = slab().compliance()
    found = []
    for count in (4, 12, 40):
        phi = modes(slab(), seen, count)
        on_surface = np.einsum("nv,nia->via", slab().hats, phi).reshape(-1, count)
        elements = elements_of(slab(), phi, UNBOUND)
        states, *_ = answers(elements, on_surface, compliance - on_surface @ on_surface.T, slab(), unseen)
        row = []
        for own, q in zip(unseen, states[len(MILD) - 1 :: len(MILD)], strict=True):
            p = own.touch.levels[-1] * (on_surface.T @ own.touch.load.ravel())
            row.append(forces(elements, q, scratch(elements), np.zeros(count)) - p @ q)
        found.append(row)
    whole = []
    for own in unseen:
        phi = own.solutions[-1][..., None]
        elements = elements_of(slab(), phi, UNBOUND)
        whole.append(forces(elements, np.ones(1), scratch(elements), np.zeros(1)) - own.touch.levels[-1] * depth(own))
    assert (np.diff([*found, whole], axis=0) < 0).all()


def test_a_body_that_moves_as_a_whole_is_held_by_its_bed_alone():
    organ = Organ(surface_mesh("sphere", 12), bed=70.0)
    small = of_organ(organ)
    phi = np.tile(np.eye(3), (len(small.mesh.points), 1, 1))
    elements = elements_of(small, phi, UNBOUND)
    held = 70.0 * float(faces.areas(small.mesh.points, organ.faces[organ.under()]).sum())
    q, g, hessian = np.array([1e-3, -2e-3, 3e-3]), np.zeros(3), np.zeros((3, 3))
    assert forces(elements, q, scratch(elements), g) == approx(0.5 * held * q @ q)
    assert g == approx(held * q)
    assert tangent(elements, q, scratch(elements), hessian)
    assert hessian == approx(held * np.eye(3), rel=1e-6, abs=1e-6 * held)


def test_touches_of_one_place_and_its_mirror_image_tell_nothing_of_others():
    (one,) = pressed(10, 3)[:1]
    other = replace(one, touch=replace(one.touch, foot=one.touch.foot * (-1.0, 1.0, 1.0)))
    with pytest.raises(ValueError, match="two places or more"):
        in_modes(slab(), [one, other], 4)
