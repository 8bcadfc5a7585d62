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
    [("press,travel [mm],force", "'force': found the unit ''"), ("press,depth [mm],force [N]", "expected travel too"),
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
