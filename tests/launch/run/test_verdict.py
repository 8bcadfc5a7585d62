"""The verdict on the rate of a run on the real clock: counts, one line, and the exit code with --strict."""

import json

import pytest
from graphs_for_runs import GRAPH, write_graph
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.launch.load.launchfile import LaunchFile, find
from palpate.launch.load.plan import plan
from palpate.launch.run.assign import spared_nodes
from palpate.launch.run.execute import execute
from palpate.launch.run.launcher import Launcher
from palpate.launch.run.result import Result, verdict


def counted(steps: int, answers: int, overdue: int, ticks: int | None = 1000, signal: int = 0):
    health = {"device": {"steps": steps, "overdue": 0}, "statics": {"steps": answers, "overdue": overdue}}
    return verdict(Result(health=health, ticks=1000, signal=signal), plan(find("kidney").load()), ticks)


@pytest.mark.parametrize(
    ("given", "kept", "words"),
    [
        ((1000, 1000, 0), True, "kept 1000 Hz: 100.00 % of 1000 ticks in time"),
        ((999, 999, 9), True, "kept 1000 Hz: 99 % of 1000 ticks in time"),
        ((998, 998, 0), False, "0.20 % of 1000 ticks left out, 0 % answered after the next had begun"),
        ((870, 870, 590), False, "13 % of 1000 ticks left out, 59 % answered after the next had begun"),
        ((1000, 900, 100), False, "0 % of 1000 ticks left out, 20 % answered after the next had begun"),
        ((0, 0, 0), False, "100.00 % of 1000 ticks left out, 0 % answered after the next had begun"),
        ((950, 950, 0, None, 2), False, "5 % of 1000 ticks left out, 0 % answered after the next had begun"),
    ],
)  # fmt: skip
def test_omitted_ticks_and_late_or_missing_outputs_are_distinguished(given, kept, words):
    found = counted(*given)
    assert found is not None and found.kept is kept and str(found).removeprefix("not real time: ") == words


def test_a_run_without_ticks_did_not_keep_its_rate():
    found = verdict(Result(), plan(find("kidney").load()), None)
    assert found is not None and not found.kept and str(found) == "not real time: no tick of 1000 Hz was run"


def test_a_slow_node_changes_the_verdict_and_with_strict_the_exit_code(tmp_path):
    text = GRAPH.replace("nodes_for_runs.Spring,", "nodes_for_runs.Work, seconds: 0.3, at: 50,")
    graph = str(write_graph(tmp_path, text))
    arguments = ["run", graph, "--clock", "real", "--duration", "0.5", "--json", "--no-record"]
    loose, strict = (CliRunner().invoke(app, [*arguments, *more]) for more in ([], ["--strict"]))
    assert (loose.exit_code, strict.exit_code) == (0, 1)
    for answer in (loose, strict):
        printed = json.loads(answer.stdout)
        assert printed["ok"] and not printed["verdict"]["kept"] and printed["verdict"]["due"] == 500
        assert printed["verdict"]["late"] + printed["verdict"]["overdue"] > 100
    printed = CliRunner().invoke(app, [*arguments[:-2], "--no-record", "-q"]).stdout
    assert (
        "not real time: " in printed
        and "held: steps that reused the previous value" in printed
        and "--place auto" in printed
    )


def test_the_simulated_clock_has_no_verdict(tmp_path):
    graph = write_graph(tmp_path)
    assert execute(LaunchFile(graph=graph, duration=0.05, place="fused")).verdict is None


def test_only_optional_nodes_with_a_condition_are_spared():
    assert spared_nodes(plan(find("kidney").load())) == {"friction"}
    with_ledger = find("kidney").but(overrides=("scene.energy.ledger=true", "scene.finger.band=true"))
    assert spared_nodes(plan(with_ledger.load())) == {"friction", "band"}


def test_a_run_continues_without_a_dead_effect_and_reports_it(tmp_path):
    text = GRAPH.replace("nodes_for_runs.Drag, in", "nodes_for_runs.FaultyDrag, at: 100, when: drag, in")
    launch = LaunchFile(graph=write_graph(tmp_path, "scene: {drag: true}" + text), duration=60.0, clock="real")
    counted: list[int] = []  # steps of the source known after the death

    def watch(running: Launcher) -> None:
        if running.result.deaths:
            counted.append(running.result.health["source"]["steps"])
            if counted[-1] > counted[0] + 300:
                running.stop()

    outcome = execute(launch, watch=watch)
    (death,) = outcome.result.deaths
    assert death.node == "drag" and not outcome.ok
    assert "drag failed; the run continued without" in outcome.result.notes
    assert outcome.result.interrupted and counted[-1] > counted[0] + 300, counted
