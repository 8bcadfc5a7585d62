"""The chart of error over cost: lines of settings, the best setting in a budget, and the results that ship with it."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from palpate.studies.accuracy.cases import TOUCHES
from palpate.studies.accuracy.cells import Cell, one
from palpate.studies.accuracy.methods import standard
from palpate.studies.accuracy.output import pictures, stored
from palpate.studies.accuracy.output.pareto import ParetoPoint, best_within, of_bodies, summaries


def point(fidelity, error=0.01, p99=1e-5, rate=1000.0, worst=None, computed=3):
    worst = error if worst is None else worst
    return ParetoPoint("m", "M", fidelity, error, worst, "tap", p99 / 2, p99, computed, 0, rate)


def test_settings_that_differ_in_one_number_are_one_line():
    names = ["1000 Hz", "250 Hz", "4000 Hz", "second order", "300 vertices", "40 vertices", "1 cell a radius",
             "2 cells a radius", "10 cells a radius", "kernel of 6 mm"]  # fmt: skip
    lines = [[p.fidelity for p in line] for line in pictures.lines_of([point(name) for name in names])]
    assert sorted(lines) == sorted([
        ["250 Hz", "1000 Hz", "4000 Hz"], ["1 cell a radius", "2 cells a radius", "10 cells a radius"],
        ["40 vertices", "300 vertices"], ["second order"], ["kernel of 6 mm"],
    ])  # fmt: skip
    assert [len(line) for line in lines] == [3, 3, 2, 1, 1]


def test_the_best_setting_in_a_budget_has_the_smallest_worst_error():
    slow = point("slow", error=1e-4, p99=5e-3)
    risky = point("risky", error=1e-3, worst=0.2, p99=1e-5)
    safe = point("safe", error=5e-3, worst=0.01, p99=1e-5, rate=4000.0)
    few = point("few", error=1e-6, p99=1e-6, computed=2)
    every = [slow, risky, safe, few]
    assert pictures.cost(safe) == pytest.approx(0.04)
    assert best_within(every, 10.0) == slow and best_within(every, 1.0) == safe
    assert best_within(every, 0.02) == risky and best_within(every, 0.001) is None
    assert best_within([], 1.0) is None


def test_results_are_stored_and_read(tmp_path):
    cell = Cell("tap", "m", "M", "1000 Hz", 1000.0, errors={"force": {"rms": 0.0123456, "worst": 0.2, "band": 0.01}})
    stored.save([cell], {"processor": "x"}, tmp_path / "r.json")
    (read,), about = stored.load(tmp_path / "r.json")
    assert about == {"processor": "x"}
    assert read == replace(cell, errors={"force": {"rms": 0.01235, "worst": 0.2, "band": 0.01}})


def test_the_shipped_results_draw_every_method_over_several_settings(tmp_path):
    cells, about = stored.load()
    summary = summaries(of_bodies(cells))
    longest = {}
    for method in {s.method for s in summary}:
        longest[method] = max(len(line) for line in pictures.lines_of([s for s in summary if s.method == method]))
    assert longest.pop("full-FE") >= 4 and set(longest.values()) == {5}  # rates from 250 Hz to 4 kHz
    assert len({s.computed for s in summary}) == 1 and about["processor"]
    places = Path(__file__).parents[2] / "docs" / "pictures" / "every_place.json"
    pictures.overview(summary, cells, tmp_path / "a.png", json.loads(places.read_text(encoding="utf-8")))
    assert (tmp_path / "a.png").stat().st_size > 50_000


@pytest.mark.parametrize("touch", ["indent", "tap"])
def test_the_shipped_results_are_those_of_this_code(touch):
    """Recomputed for a body without a stored basis; a change of the force needs `docs/pictures/accuracy.py --store`."""
    method = next(m for m in standard() if m.name == "MassSpring")
    kept = next(c for c in stored.load()[0] if (c.touch, c.method, c.fidelity) == (touch, "MassSpring", "1000 Hz"))
    again = one(TOUCHES[touch], method, next(f for f in method.fidelities if f.name == "1000 Hz"))
    assert again.errors["force"]["rms"] == pytest.approx(kept.errors["force"]["rms"], rel=1e-3)
