"""Touch points after a long approach, cycles, and what is left out of a fit: never the force without a note."""

import numpy as np
import pytest

from palpate.models.fit.sessions import SessionError
from palpate.models.fit.tissue.fit import fit_tissue
from palpate.models.fit.tissue.measured import MOST_ROWS, deepest_row, hertz_touch, prepare_press, thin_press
from palpate.models.fit.tissue.rigs import Rig

TRAVEL, YOUNG = 50e-6, 5000.0  # [m], [Pa]


def approach(contact, radius, length, rows=2000, rise=0.03, noise=1e-3, beyond=1.0):
    """A press of a colloid in its last `contact` [m], with a force that rises over `length` [m] before it."""
    rng = np.random.default_rng(1)
    depth = np.linspace(0.0, TRAVEL, rows)
    inside = depth - (TRAVEL - contact)
    force = 4.0 / 3.0 / 0.75 * np.sqrt(radius) * YOUNG * np.maximum(inside, 0.0) ** 1.5
    peak = force.max()
    force = force + peak * (rise * np.exp(np.minimum(inside, 0.0) / length) + noise * rng.standard_normal(rows))
    return prepare_press("press.csv", depth / TRAVEL, depth, force)


@pytest.mark.parametrize(("contact", "radius"), [(0.5e-6, 5e-6), (0.9e-6, 20e-6)])
@pytest.mark.parametrize("length", [5e-6, 20e-6])
def test_a_rise_before_a_shallow_contact_is_not_the_contact(contact, radius, length):
    """It gave 22 Pa (1 to 384) without a note."""
    fit = fit_tissue([approach(contact, radius, length)], Rig("ball", radius), "hertz")
    assert fit.young[0] == pytest.approx(YOUNG, rel=0.02) and not fit.estimate.withheld
    assert fit.young[1] < 1.005 * YOUNG and fit.young[2] > 0.995 * YOUNG
    assert fit.estimate.touches[0] == pytest.approx(TRAVEL - contact, abs=0.03 * contact)


def test_rows_in_contact_of_a_long_record_are_not_averaged_away():
    press = thin_press(approach(0.5e-6, 5e-6, 20e-6, rows=20000))
    assert len(press.depth) <= MOST_ROWS and (press.depth > TRAVEL - 0.5e-6).sum() >= 100


def cycles(count, deeper=0.0, held=0, seed=5):
    """Depth [m] of equal cycles, the last one deeper, with noise of the depth, and the force [N], which is 30 % less
    after the first peak."""
    rng = np.random.default_rng(seed)
    up = np.linspace(-2e-3, 0.7e-3, 600)
    parts = [each for _ in range(count) for each in (up, np.full(held, up[-1]), up[::-1])]
    path = np.concatenate(parts) + 1e-7 * rng.standard_normal(count * (1200 + held))
    path[-1200 - held :] += deeper * (path[-1200 - held :] > 0.0)
    force = 4.0 / 3.0 / 0.75 * np.sqrt(8e-3) * 1e4 * np.maximum(path, 0.0) ** 1.5
    force[600 + held :] *= 1.0 - 0.3 * np.minimum(np.arange(len(force) - 600 - held) / 60.0, 1.0)
    return path, force + 0.02 * force.max() * rng.standard_normal(len(path))


@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize("held", [0, 200])
def test_of_equal_cycles_the_first_loading_is_fitted_with_all_its_rows(count, held):
    """Noise of the depth chose the cycle; the first peak counted as the begin of a hold at a constant force; and rows
    were averaged over all cycles, so that few were left of the loading: 88 % of these presses were right."""
    path, force = cycles(count, held=held)
    press = prepare_press("press.csv", 0.01 * np.arange(len(path)), path, force)
    fit = fit_tissue([press], Rig("ball", 8e-3), "hertz")
    fitted = fit.presses[0]
    assert len(fitted.depth) <= MOST_ROWS and (fitted.depth > 0.0).sum() >= 140  # of 156
    assert np.isin(fitted.depth, path[: 601 + held]).all()  # no averages
    assert fit.young[1] < 1e4 < fit.young[2] and fit.young[0] == pytest.approx(1e4, rel=0.05)
    assert any("creeps" in note for note in fit.notes) == bool(held)
    assert not any("earlier cycles" in note for note in fit.notes)


def test_a_deeper_cycle_is_the_one_that_counts():
    path, _ = cycles(3, deeper=2e-5)
    assert deepest_row(path) > 2400
    assert deepest_row(np.zeros(5)) == 0 and deepest_row(np.arange(9.0)) == 8


def test_most_of_the_force_is_not_left_out_without_a_note():
    press = approach(0.9e-6, 5e-6, 20e-6)  # 18 % of the radius, of which the law is valid to 10
    fit = fit_tissue([press], Rig("ball", 5e-6), "hertz")
    kept = float(fit.presses[0].force.max()) / float(press.force.max())
    assert kept < 0.5 and any("most of the force is excluded" in note for note in fit.notes)
    assert fit.young[1] < YOUNG < fit.young[2]


def test_the_touch_point_by_hertz_lies_at_the_contact():
    depth = np.linspace(0.0, 1.0, 1000)
    for contact in (0.01, 0.1, 0.5):
        force = np.maximum(depth - 1.0 + contact, 0.0) ** 1.5 / contact**1.5 + 0.03 * np.exp(
            np.minimum(depth - 1.0 + contact, 0.0)
        )
        assert hertz_touch(depth, depth, force, 0.0) == pytest.approx(1.0 - contact, abs=0.15 * contact)


def test_only_the_last_cycle_is_fitted():
    """The unloading of the cycle before has less force at the same depth."""
    rng = np.random.default_rng(3)
    path = np.concatenate([np.linspace(-0.5e-3, 0.7e-3, 200), np.linspace(0.7e-3, -0.5e-3, 200),
                           np.linspace(-0.5e-3, 0.75e-3, 210)])  # fmt: skip
    force = 4.0 / 3.0 / 0.75 * np.sqrt(8e-3) * 1e4 * np.maximum(path, 0.0) ** 1.5
    force[200:400] *= 0.6
    force += 5e-3 * force.max() * rng.standard_normal(len(path))
    press = prepare_press("press.csv", 0.01 * np.arange(len(path)), path, force)
    fit = fit_tissue([press], Rig("ball", 8e-3), "hertz")
    assert any("400 rows of earlier cycles are excluded" in note or "earlier cycles" in note for note in fit.notes)
    assert fit.young[1] < 1e4 < fit.young[2] and fit.young[0] == pytest.approx(1e4, rel=0.03)


def test_a_press_that_is_no_contact_is_refused():
    rng = np.random.default_rng(1)
    with pytest.raises(SessionError, match="never touches"):
        prepare_press("p", None, np.linspace(0.0, 1e-3, 300), 1e-3 * rng.standard_normal(300))


@pytest.mark.parametrize(("factor", "text"), [(0.7, "dissipates 30 %"), (1.0, "dissipates less than"), (1.3, "larger")])
def test_an_unloading_above_the_loading_has_no_hysteresis(factor, text):
    """A zero that drifts: the note said that hysteresis dissipates -30 % of the work."""
    path = np.r_[np.linspace(-1e-3, 0.7e-3, 300), np.linspace(0.7e-3, -1e-3, 300)]
    force = 4.0 / 3.0 / 0.75 * np.sqrt(8e-3) * 1e4 * np.maximum(path, 0.0) ** 1.5
    force[300:] *= factor
    fit = fit_tissue([prepare_press("press.csv", 0.01 * np.arange(600), path, force)], Rig("ball", 8e-3), "hertz")
    (note,) = (note for note in fit.notes if "after the deepest" in note)
    assert text in note and "-" not in note.partition("excluded")[2].replace("--relaxation", "")
