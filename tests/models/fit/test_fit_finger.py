"""`palpate fit finger` on presses of known fingertips, whose touch points it does not know."""

import json

import numpy as np
import pytest
from pytest import approx
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.models.fit.finger import FingerPress, fit_fingers, read_presses
from palpate.models.fit.sessions import SessionError
from palpate.nodes.contact import Series
from palpate.physics.contact.people import PEOPLE

B, M = 30.0, 1300.0


def press(b=B, touch=0.4e-3, noise=0.0, seed=0, rows=100):
    travel = np.linspace(0.0, 2.2e-3, rows)
    force = b / M * np.expm1(M * np.clip(travel - touch, 0.0, None))
    return FingerPress(travel, force + noise * np.random.default_rng(seed).normal(size=rows))


def table(path, presses, head="press,travel [mm],force [N]"):
    rows = [(k + 1, 1e3 * s, f) for k, each in enumerate(presses) for s, f in zip(*each, strict=True)]
    path.write_text(head + "\n" + "".join(f"{k},{s:.5f},{f:.6f}\n" for k, s, f in rows))
    return path


def fit(*given):
    return CliRunner().invoke(app, ["fit", "finger", *map(str, given)])


def test_the_law_is_found_for_any_zero_of_the_travel_and_offset_of_the_force(tmp_path):
    presses = [press(touch=0.2e-3), press(touch=0.5e-3), press(touch=0.3e-3)]
    presses = [each._replace(force=each.force + 0.02) for each in presses]
    found = json.loads(fit(table(tmp_path / "p.csv", presses), "--json").output)
    assert found["finger_stiffness"] == approx(B, rel=0.02) and found["finger_hardening"] == approx(M, rel=0.01)
    assert found["touch"] == approx([0.2e-3, 0.5e-3, 0.3e-3], abs=0.02e-3)


def test_people_share_the_hardening_and_differ_in_the_stiffness():
    people = [
        [press(b, touch, 2e-3, seed) for seed, touch in enumerate((0.2e-3, 0.4e-3, 0.5e-3))] for b in (20.0, 45.0)
    ]
    found = fit_fingers(people)
    assert found.stiffness == approx([20.0, 45.0], rel=0.1) and found.hardening == approx(M, rel=0.05)
    for value, (low, high) in zip((20.0, 45.0, M), found.intervals, strict=True):
        assert 0.5 * value < low < high < 2.0 * value
    assert all(
        low < each < high
        for each, (low, high) in zip((*found.stiffness, found.hardening), found.intervals, strict=True)
    )


def test_the_answer_names_intervals_and_the_command(tmp_path):
    result = fit(table(tmp_path / "p.csv", [press(noise=1e-3, seed=k) for k in range(3)]))
    assert result.exit_code == 0 and "95 %" in result.output and "--set scene.finger.finger_stiffness=" in result.output
    result = fit(table(tmp_path / "one.csv", [press()]))
    assert result.exit_code == 0 and "three presses" in result.output and "95 %" not in result.output


@pytest.mark.parametrize(
    ("head", "says"),
    [("press,travel [mm],force", "'force': found no unit"), ("press,depth [mm],force [N]", "expected travel too"),
     ("press,travel [m],force [N]", "is its unit right")],
)  # fmt: skip
def test_a_table_that_cannot_be_used_is_an_error(tmp_path, head, says):
    path = table(tmp_path / "p.csv", [press()], head)
    with pytest.raises(SessionError, match=says):
        read_presses(path)
    assert fit(path).exit_code == 2
    flat = table(tmp_path / "flat.csv", [FingerPress(np.linspace(0, 1e-3, 50), np.zeros(50))])
    assert fit(flat).exit_code == 2 and fit(tmp_path / "none.csv").exit_code == 2


def test_the_named_fingers_are_ordered_and_shipped():
    force = {law: Series(finger_law=law)._elastic() for law in PEOPLE}
    assert PEOPLE["soft"][0] < PEOPLE["median"][0] < PEOPLE["stiff"][0]
    assert len(force) == 3 and len(set(force.values())) == 3


def covered(fingers, presses, scatter, seed=1):
    """Number of simulated fingers whose intervals contain b, and m: presses with other touch points and laws (relative
    standard deviation `scatter` of b, 0.3 times that of m), noise of 2 mN."""
    random, hits = np.random.default_rng(seed), np.zeros(2, int)
    for _ in range(fingers):
        truth, made = (random.uniform(15.0, 40.0), random.uniform(900.0, 1800.0)), []
        for _ in range(presses):
            b, m = truth * np.exp(scatter * np.array([1.0, 0.3]) * random.standard_normal(2))
            travel = np.linspace(0.0, random.uniform(1.6e-3, 2.2e-3), 200)
            force = b / m * np.expm1(m * np.maximum(travel - random.uniform(0.1e-3, 0.6e-3), 0.0))
            force += 2e-3 * random.standard_normal(200)
            made.append(FingerPress(travel, force - np.median(force[:5])))
        found = fit_fingers([made]).intervals
        hits += [low <= value <= high for value, (low, high) in zip(truth, found, strict=True)]
    return hits.tolist()


@pytest.mark.parametrize("scatter", [0.0, 0.2])
def test_intervals_contain_the_law_of_the_finger(scatter):
    """Of 20 fingers of three presses; at a coverage of 95 %, fewer than 16 have a probability of 1 in 400."""
    assert min(covered(20, 3, scatter)) >= 16


@pytest.mark.long
@pytest.mark.parametrize("presses", [3, 5, 10])
@pytest.mark.parametrize("scatter", [0.0, 0.2])
def test_intervals_contain_the_law_in_about_95_of_100_fingers(presses, scatter):
    """Of 200 fingers; the jackknife of presses that differ is too narrow by some per cent."""
    assert min(covered(200, presses, scatter)) >= 174
