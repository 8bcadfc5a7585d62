"""The search for broken relations: what holds is found to hold, and what is wrong is found to be wrong."""

import json
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.physics.errors import ArgumentError
from palpate.studies.organs.touches import Setting
from palpate.studies.relations.draw import choose_bodies, draw_case
from palpate.studies.relations.relation import LIGHT, at_least, same_bytes, same_force
from palpate.studies.relations.rules import choose_relations, relations
from palpate.studies.relations.runs import Runner, Trace
from palpate.studies.relations.search import search

ONE = Setting("sphere-nurbs", 0, "MassSpring", "LuGre", width=0.016)


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    return draw_case(ONE, np.random.default_rng(5), tmp_path_factory.mktemp("meshes"), 5)


@pytest.fixture(scope="module")
def runner():
    with Runner(1) as one:
        yield one


def _trace(force):
    return Trace({"contact.force": np.array(force, dtype=float)})


def test_one_unlike_bit_is_found():
    one, two = _trace([0.0, 1.0, 2.0]), _trace([0.0, np.nextafter(1.0, 2.0), 2.0])
    assert same_bytes(one, two).broken and same_bytes(one, two).time == 1e-3
    assert not same_bytes(one, one).broken


def test_a_difference_beyond_the_effect_of_a_micrometre_is_found():
    one, near = _trace([0.0, 1.0, 1.0]), _trace([0.0, 1.0, 1.001])
    assert not same_force(one, _trace([0.0, 1.0, 1.0009]), near, 1e-6).broken
    assert same_force(one, _trace([0.0, 1.0, 1.0011]), near, 1e-6).broken
    assert same_force(one, _trace([0.0, 1.0009, 1.0]), near, 1e-6).broken  # before a micrometre has an effect


def test_a_light_touch_is_not_compared_with_its_rounding():
    assert same_force(_trace([1e-9]), _trace([2e-9]), _trace([1e-9]), 1e-6).bound == pytest.approx(1e-6 * LIGHT)


def test_a_lost_force_is_found():
    assert at_least(0.5, 1.0, 0.1, 0.0).broken
    assert not at_least(0.95, 1.0, 0.1, 0.0).broken
    assert not at_least(2.0, 1.0, 0.1, 0.0).broken


@pytest.mark.parametrize("name", ["every", "far-finger", "causal", "turned", "shifted", "waited", "similar"])
def test_a_relation_holds_and_a_change_of_one_percent_breaks_it(name, case, runner):
    rng = np.random.default_rng(1)
    claim = relations()[name].claim(case, rng)
    run, path = claim.runs[1], f"device{claim.runs[1].tag}.hand_stiffness"
    wrong = run.but({path: 1.01 * float(run.sets[path])})
    traces = runner.run([*claim.runs, wrong])
    assert not any(trace.error for trace in traces), [trace.error for trace in traces]
    assert traces[0].peak > 0.1
    assert not claim.judge(*traces[:-1]).broken
    assert claim.judge(traces[0], traces[-1], *traces[2:-1]).broken


@pytest.mark.parametrize("name", ["deeper", "nearer", "stiffer", "held"])
def test_more_is_not_less_and_the_reverse_is_found(name, case, runner):
    claim = relations()[name].claim(case, np.random.default_rng(2))
    one, two = runner.run(claim.runs)
    assert not claim.judge(one, two).broken
    assert claim.judge(two, one).broken


def test_a_press_of_half_the_force_is_found(case, runner):
    claim = relations()["felt"].claim(case, np.random.default_rng(2))
    (one,) = runner.run(claim.runs)
    assert not claim.judge(one).broken
    half = replace(one, values={**one.values, "contact.force": 0.5 * one.force})
    assert claim.judge(half).broken


def test_the_command_prints_a_table_for_programs(tmp_path):
    given = ["bench", "relations", "--comparisons", "4", "--relation", "every", "--relation", "waited"]
    result = CliRunner().invoke(app, [*given, "--body", "MassSpring", "--out", str(tmp_path / "out"), "--json"])
    assert result.exit_code == 0, result.output
    found = json.loads(result.stdout)
    assert found["ok"] and found["comparisons"] == 4
    assert {row["relation"] for row in found["rows"]} == {"every", "waited"}
    assert (tmp_path / "out" / "relations.txt").is_file()


@pytest.mark.parametrize("wrong", [{"relation": "turnd"}, {"body": "Massspring"}])
def test_unknown_names_are_refused_with_those_that_exist(wrong):
    with pytest.raises(ArgumentError, match="expected some of"):
        choose_relations([wrong["relation"]]) if "relation" in wrong else choose_bodies([wrong["body"]])


def test_a_relation_that_says_nothing_about_a_body_ends_with_the_reason(tmp_path):
    with pytest.raises(ArgumentError, match="capsule with Rigid"):
        search(choose_relations(["capsule"]), 5, 1, tmp_path, bodies={"Rigid": 1.0})


@pytest.mark.long
def test_no_relation_of_a_thousand_is_broken(tmp_path):
    results = search(choose_relations(None), 1000, 7, tmp_path)
    assert not results.broken.total(), {name: listed[0] for name, listed in results.worst.items()}
