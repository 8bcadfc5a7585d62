"""Bodies instead of the wall: their response to small motions, and the limit of the stable loop by two methods."""

import math

import pytest
from body_wall import PUSH, Wall, held, row, stiffened, stiffest
from pytest import approx
from regions import CYCLE, GROWS, NEAR, REST, fate, region

from palpate.nodes.collision import Mesh
from palpate.nodes.deformation import BeamBundle, MassSpring, ReducedFE
from palpate.physics.device.wall_loop import WallDevice
from palpate.physics.errors import ArgumentError

EXACT = WallDevice(resolution=0.0)


@pytest.mark.parametrize("factor", [0.25, 1.0, 16.0])
def test_the_wall_of_mass_spring_follows_from_its_law(factor):
    """f = K s^1.5 (1 + c s'): df/ds = 1.5 K^(2/3) f^(1/3), B = c f."""
    stiffness, damping = Wall(stiffened(MassSpring, factor), 1e-3).linear(PUSH)
    assert stiffness == approx(1.5 * (factor * 3e3) ** (2 / 3) * PUSH ** (1 / 3), rel=1e-3)
    assert damping == approx(5.0 * PUSH, rel=0.1)


@pytest.mark.parametrize("period", [5e-4, 1e-3])
def test_the_reduced_organ_is_kelvin_voigt(period):
    """B = tau K for any step."""
    stiffness, damping = Wall(stiffened(ReducedFE, 1.0), period).linear(PUSH)
    assert damping == approx(0.02 * stiffness, rel=0.05)


@pytest.mark.parametrize(
    ("body", "delay"), [(MassSpring, 1), (MassSpring, 5), pytest.param(ReducedFE, 1, marks=pytest.mark.long)]
)
def test_the_stability_limit_is_where_the_poles_leave_the_unit_circle(body, delay):
    """An exact encoder, no dry friction: within 1/8 of an octave. With the controller all are stable."""
    printed = row(EXACT, body, 1000.0, delay)
    assert printed["bare"] == approx(printed["stable"], rel=0.1)
    assert math.isinf(printed["controlled"]) and printed["given_out"] < 2e-3


def test_a_viscous_body_that_cannot_be_held_is_reported_as_unstable():
    """The skin of the beams has hundreds of N s/m, too much for a grip of 0.1 kg with a delay of five samples."""
    printed = row(WallDevice(), BeamBundle, 1000.0, 5)
    assert printed["stable"] == 0.0
    assert not held(WallDevice(), stiffened(BeamBundle, 64.0), controlled=False, period=1e-3, delay=5)[0]


def test_the_search_finds_the_limit_or_reports_that_it_is_missing():
    assert stiffest(lambda factor: factor < 3.0) == approx(3.0, rel=0.1)
    assert stiffest(lambda factor: True) == math.inf and stiffest(lambda factor: False) == 0.0


def test_a_node_that_is_not_a_body_is_an_error():
    with pytest.raises(ArgumentError, match="Mesh, expected a node that takes Load"):
        stiffened(Mesh, 1.0)


@pytest.mark.parametrize("mass", [0.05, 0.3])
def test_the_plane_has_its_regions(mass):
    """Passive where both ratios are above 1/2. Dry friction stops a slow approach; without both, an oscillation grows;
    between, drag without dry friction leaves an oscillation of a few encoder steps, or none."""
    stiffness, period, step = 4000.0 * mass, 1e-3, 60e-6

    def at(beta, sigma):
        return region(WallDevice(mass, beta * stiffness * period, sigma * stiffness * step, step), stiffness, period)

    assert at(0.7, 0.7) == at(2.0, 2.0) == at(3.0, 0.6) == REST
    assert at(0.1, 1.0) == at(0.2, 0.6) == NEAR
    assert at(0.05, 0.02) == GROWS
    assert at(0.56, 0.02) in (CYCLE, REST)


def test_a_sustained_oscillation_spans_a_few_steps_and_a_growing_one_is_unbounded():
    stiffness, period, step = 4000.0, 1e-3, 60e-6
    device = WallDevice(0.1, 0.55 * stiffness * period, 0.02 * stiffness * step, step)
    assert fate(device, stiffness, period, 20 * step) == CYCLE
    slow = device._replace(drag=0.05 * stiffness * period)
    assert fate(slow, stiffness, period, 20 * step) == GROWS
