"""Random graphs, scenes and wanted streams: the wanted streams are bit-equal to the whole graph, with no more steps."""

import dataclasses

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.records.reader import Recording

STREAMS = ("contact", "friction", "spread", "tissue", "controller", "statics", "band", "display")
DOWN = "scene.hand={hand_stiffness: 500, hand_damping: 10, begin: [0, 0, %s], path: [{to: [%s, 0, %s], time: 0.12}]}"


@st.composite
def graphs(draw) -> tuple[str, ...]:
    """Overrides of the nodule graph: other bodies, laws, surfaces, rates and positions."""
    body = draw(st.sampled_from(["MassSpring", "BeamBundle", "Rigid"]))
    surface = draw(st.sampled_from(["kidney", "sphere", "plane"]))
    top = {"kidney": 0.105, "sphere": 0.105, "plane": 0.084}[surface]
    side, deep = draw(st.floats(-0.004, 0.004)), draw(st.floats(0.002, 0.006))
    sets = [
        f"tissue.use=deformation.{body}",
        f"friction.use=friction.{draw(st.sampled_from(['LuGre', 'Coulomb', 'ElastoPlastic']))}",
        f"scene.surface={{surface: {surface}, vertices: {draw(st.sampled_from([300, 600]))}}}",
        f"collision.use=collision.{draw(st.sampled_from(['Mesh', 'Nurbs']))}",
        f"display.every={draw(st.sampled_from([1, 7, 10]))}",
        DOWN % (top + 0.0045, side, top + 0.004 - deep),
    ]
    return tuple(sets)


def run(folder, name, overrides, wanted=None):
    """The recording of a run, and the number of steps of each node except the logger, which steps in bursts."""
    launch = find("nodule").but(place="fused", duration=0.14, overrides=overrides, wanted=wanted)
    outcome = execute(dataclasses.replace(launch, clock="simulated", record=folder / f"{name}.mcap"))
    assert outcome.result.ok, outcome.result.deaths
    health = outcome.result.health.items()
    return Recording(folder / f"{name}.mcap"), {n: h["steps"] - h["asleep"] for n, h in health if n != "log"}


@pytest.mark.parametrize("examples", [25, pytest.param(1000, marks=[pytest.mark.long, pytest.mark.timeout(1800)])])
def test_wanted_streams_of_random_graphs_equal_those_of_the_whole_graph(tmp_path_factory, examples):
    folder = tmp_path_factory.mktemp("pruned")
    touched = []

    @settings(max_examples=examples, deadline=None, suppress_health_check=list(HealthCheck))
    @given(graphs(), st.sets(st.sampled_from(STREAMS), min_size=1, max_size=3))
    def check(sets, wanted):
        whole, steps = run(folder, "whole", (*sets, "effects.band=on", "log.fields=all"))
        less, fewer = run(folder, "less", (*sets, "effects.band=on"), tuple(sorted(wanted)))
        touched.append(whole.columns("contact")["force"].max() > 0.01)
        for stream in wanted:
            mine, all_of_it = ([p for _, _, p in file.payloads(stream)] for file in (less, whole))
            assert mine and mine == all_of_it, (stream, sets)
        assert all(fewer[name] <= steps[name] for name in fewer)

    check()
    assert sum(touched) > len(touched) / 2, "most runs must touch"
