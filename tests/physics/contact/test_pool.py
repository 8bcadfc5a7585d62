"""What a body generates under several fingers, and which of them gets it (physics.contact.pool)."""

import numpy as np
import pytest
from pytest import approx

from palpate.compiler.fields import blank_record
from palpate.physics.contact.pool import END, SLACK, assign_generated, energy_given

NONE = np.zeros(2)
LARGE = 1e3  # [J] a stored energy that bounds nothing


class Body:
    """Two fingers on springs: forces K d at the depths d [m]."""

    def __init__(self, stiffness):
        self.stiffness, self.ends = np.array(stiffness), [blank_record(END) for _ in range(2)]
        self.held, self.generated, self.put = 0.0, np.zeros(2), np.zeros(2)

    def to(self, depths, most=LARGE):
        forces = np.maximum(self.stiffness @ depths, 0.0)
        still = (0.0, 0.0, 0.0)
        steps = zip(self.ends, forces, depths, strict=True)
        given = np.array([energy_given(end, f, -d, still, still, 0.0, 1e-3)[0] for end, f, d in steps])
        self.put += given
        self.held = assign_generated(self.held, given, NONE, most, self.generated)


def paths(seed):
    """Depths [m] (k,2) of a closed random motion in contact."""
    rng, t = np.random.default_rng(seed), np.linspace(0.0, 2.0 * np.pi, 2000)
    waves = sum(rng.normal(size=(2, 1)) * (1.0 - np.cos(k * t)) + rng.normal(size=(2, 1)) * np.sin(k * t)
                for k in (1, 2, 3))  # fmt: skip
    return 4e-3 + 1e-3 * (waves - waves.min()).T / np.ptp(waves)


@pytest.mark.parametrize("seed", range(5))
def test_a_body_of_one_energy_generates_nothing_whichever_finger_it_pushes_out(seed):
    body = Body([[800.0, 300.0], [300.0, 500.0]])
    body.to(np.zeros(2))
    for depths in paths(seed):
        body.to(depths)
    assert body.held == approx(body.put.sum(), rel=1e-9) and body.put.min() < body.put.max()
    body.to(np.zeros(2))
    assert body.generated.sum() == approx(0.0, abs=1e-12) and body.put.sum() == approx(0.0, abs=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_what_a_body_without_reciprocity_generates_is_assigned_once(seed):
    """Whichever way round it turns, all that the fingers got beyond what they put in, and not less than they got from
    the start."""
    body = Body([[800.0, 500.0], [-200.0, 500.0]])
    body.to(np.zeros(2))
    for _ in range(20):
        for depths in paths(seed):
            body.to(depths)
    body.to(np.zeros(2))
    assert body.generated.sum() == approx(body.held - body.put.sum(), rel=1e-9)
    assert body.generated.sum() >= max(-body.put.sum(), 0.0) - 1e-12 and body.generated.min() >= 0.0


def test_the_finger_that_gets_more_than_there_is_gets_the_share():
    generated = np.zeros(2)
    assert assign_generated(1e-3, np.array([-3e-3, 0.5e-3]), NONE, LARGE, generated) == 0.0
    assert generated.tolist() == [approx(1.5e-3), 0.0]
    assert assign_generated(0.0, np.array([-1e-3, -3e-3]), NONE, LARGE, generated) == 0.0
    assert generated.tolist() == [approx(2.5e-3), approx(3e-3)]


def test_losses_do_not_cover_what_is_generated_later():
    """A finger taps tissue that returns nothing a hundred times; then the tissue pushes out another one, from rest."""
    generated, held = np.zeros(2), 0.0
    for _ in range(100):
        held = assign_generated(held, np.array([1e-3, 0.0]), NONE, 2e-3, generated)
        held = assign_generated(held, NONE, NONE, 0.0, generated)
    assert held == 0.0
    held = assign_generated(held, np.array([0.0, -1e-3]), NONE, 2e-3, generated)
    assert generated.tolist() == [0.0, approx(1e-3)]
    assert assign_generated(9e-3, NONE, NONE, 2e-3, generated) == SLACK * 2e-3


def test_a_finger_that_was_away_has_put_in_nothing_until_it_moves():
    end, still = blank_record(END), (0.0, 0.0, 0.0)
    assert energy_given(end, 2.0, -5e-3, still, still, 0.0, 1e-3) == (0.0, 0.0)
    assert energy_given(end, 4.0, -6e-3, still, still, 0.0, 1e-3) == (approx(3e-3), 0.0)
    end.known = False
    assert energy_given(end, 4.0, -9e-3, still, still, 0.0, 1e-3) == (0.0, 0.0)


def test_a_depth_that_returns_after_an_outage_is_work_that_no_finger_has_done():
    """The hand went in by 8 mm without a force. The tissue that is pressed then has 32 mJ, which the hand may not have
    although the other finger has put in 40."""
    end, still, generated, held = blank_record(END), (0.0, 0.0, 0.0), np.zeros(2), 40e-3
    steps = [*((-8e-3, w) for w in np.linspace(8e-3, 0.0, 101)), *((-d, 0.0) for d in np.linspace(8e-3, 0.0, 101))]
    for k, (gap, withheld) in enumerate(steps):
        given, returned = energy_given(end, 1e3 * (-gap - withheld), gap, still, still, withheld, 1e-3)
        held = assign_generated(held, np.array([given, 0.0]), np.array([returned, 0.0]), LARGE, generated)
        assert k != 100 or (held == approx(72e-3) and generated[0] == approx(32e-3))
    assert held == approx(40e-3) and generated.tolist() == [approx(32e-3), 0.0]


def test_a_depth_that_is_withheld_takes_energy_away():
    generated = np.zeros(2)
    assert assign_generated(2e-3, NONE, np.array([-0.5e-3, 0.0]), LARGE, generated) == approx(1.5e-3)
    assert assign_generated(0.1e-3, NONE, np.array([-0.5e-3, 0.0]), LARGE, generated) == 0.0
    assert assign_generated(0.1e-3, np.array([0.0, -1e-12]), np.array([-0.5e-3, 0.0]), LARGE, generated) == 0.0
    assert generated.tolist() == [0.0, approx(1e-12)]


@pytest.mark.parametrize("seed", range(3))
def test_no_finger_is_assigned_more_than_it_got(seed):
    rng = np.random.default_rng(seed)
    for _ in range(2000):
        given, returned, generated = rng.normal(size=3), rng.normal(size=3) * rng.integers(2), np.zeros(3)
        assign_generated(abs(rng.normal()), given, returned, LARGE, generated)
        assert (generated <= np.maximum(-given, 0.0) + np.maximum(returned, 0.0) + 1e-12).all()


def test_the_force_along_the_surface_does_work_with_the_motion_there():
    end, still = blank_record(END), (0.0, 0.0, 0.0)
    energy_given(end, 0.0, 0.0, (0.2, 0.0, 0.0), still, 0.0, 1e-3)
    work, _ = energy_given(end, 0.0, 0.0, (0.4, 0.0, 0.0), (0.1, 5.0, 0.0), 0.0, 1e-3)
    assert work == approx(-0.3 * 0.1 * 1e-3)
