"""Pin heights from a force, from a surface and from a pressure: three ways to one Hertz contact."""

import numpy as np
import pytest
from formulas import pad_pressure, tissue_displacement
from pytest import approx

from palpate.physics.display.pin_heights import (
    heights_from_force,
    heights_from_pressure,
    heights_from_surface,
    local_plane,
)
from palpate.physics.display.pins import pin_grid
from palpate.physics.display.shape_display import FINGERPADS, pad_contact, pad_displacement

PAD = FINGERPADS["canonical"]
GRID = pin_grid(6, 5, 2e-3).reshape(-1, 2)
R = np.hypot(*GRID.T)


def near(points, count=9):
    """The nearest `count` of the points to each pin."""
    order = np.argsort(np.linalg.norm(points[None, :, :2] - GRID[:, None], axis=-1), axis=1)[:, :count]
    return points[order]


@pytest.mark.parametrize(("force", "modulus", "radius"), [(1.0, 15e3, np.inf), (0.05, 60e3, 0.03), (0.0, 15e3, np.inf)])
def test_the_kernel_equals_the_plain_functions(force, modulus, radius):
    out = np.empty(len(GRID))
    approach, a = heights_from_force(R, force, PAD.b, PAD.m, 1 / PAD.radius, 0.75 / modulus, 1 / radius, out)
    state = pad_contact(force, modulus, radius=radius)
    assert out == approx(pad_displacement(R, state), rel=1e-14)
    assert (approach, a) == (state.approach, state.radius)


@pytest.mark.parametrize(("force", "modulus"), [(0.09, 15e3), (1.0, 60e3)])
def test_the_surface_of_a_hertz_contact_gives_its_fingerpad_deformation(force, modulus):
    state = pad_contact(force, modulus)
    side = np.arange(-12e-3, 12e-3, 0.2e-3)
    x, y = (v.ravel() for v in np.meshgrid(side, side))
    tissue = np.stack([x, y, -tissue_displacement(np.hypot(x, y), state)], axis=1)
    heights = heights_from_surface(GRID, near(tissue), float(state.approach), PAD.radius, 0.2e-3)
    inside = 0.95 * state.radius > R
    assert inside.sum() >= 8
    # The local plane smooths the dimple's curvature over its weights: about (0.2 mm)²/(2 R).
    assert heights[inside] == approx(pad_displacement(R[inside], state), abs=4e-6)
    assert np.all(heights >= 0)


@pytest.mark.parametrize("spacing", [1e-3, 0.5e-3])
@pytest.mark.parametrize(("force", "modulus"), [(1.0, 15e3), (3.0, 60e3)])
def test_the_pressure_of_a_hertz_contact_gives_its_fingerpad_deformation(force, modulus, spacing):
    state = pad_contact(force, modulus)
    side = np.arange(-15e-3, 15e-3, spacing) + 0.3 * spacing
    places = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    forces = pad_pressure(np.hypot(*places.T), state) * spacing**2
    out = np.empty(len(GRID))
    radii = np.full(len(places), 1.2 * spacing)
    deflection = heights_from_pressure(GRID, places, forces, radii, PAD.b, PAD.m, out)
    assert deflection == approx(float(state.deflection), rel=0.01)
    inside = 0.8 * state.radius > R
    assert out[inside] == approx(pad_displacement(R, state)[inside], rel=0.01)


def test_zero_pressure_gives_zero_heights():
    out = np.ones(len(GRID))
    assert heights_from_pressure(GRID, np.zeros((3, 2)), np.zeros(3), np.ones(3), PAD.b, PAD.m, out) == 0.0
    assert np.all(out == 0)


def test_a_tilted_plane_is_followed_exactly():
    random = np.random.default_rng(4)
    places = random.uniform(-1, 1, (20, 9, 2))
    points = random.uniform(-1, 1, (20, 2))
    values = 0.3 + places @ [2.0, -1.5]
    assert local_plane(points, places, values, 0.5) == approx(0.3 + points @ [2.0, -1.5], abs=1e-9)


def test_collinear_points_and_a_single_point_give_a_value():
    line = np.stack([np.linspace(0, 1, 9), np.zeros(9)], axis=-1)[None]
    assert local_plane(np.array([[0.5, 0.7]]), line, line[..., 0], 0.3) == approx([0.5], abs=1e-6)
    assert local_plane(np.array([[0.5, 0.7]]), line[:, :1], np.array([[4.0]]), 0.3) == approx([4.0])


def test_tissue_that_deforms_less_raises_the_pins_above_it():
    side = np.arange(-9e-3, 9e-3, 0.5e-3)
    x, y = (v.ravel() for v in np.meshgrid(side, side))
    sunk = np.full(len(x), -2e-3)
    lump = sunk + 1e-3 * np.exp(-((x - 3e-3) ** 2 + y**2) / (2e-3) ** 2)
    flat, raised = (
        heights_from_surface(GRID, near(np.stack([x, y, z], axis=1)), 4e-3, PAD.radius, 0.5e-3) for z in (sunk, lump)
    )
    top = int(np.argmax(raised - flat))
    assert abs(GRID[top, 0] - 3e-3) <= 1e-3 and abs(GRID[top, 1]) <= 1e-3
    assert 0.5e-3 < raised[top] - flat[top] < 1e-3
