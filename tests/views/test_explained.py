"""What the page says about a run: the plan, the hard cases, and the error and time of each body."""

import os
import queue
import time
from functools import partial

import numpy as np
import pytest

from palpate.launch.load.launchfile import find
from palpate.launch.load.plan import plan
from palpate.nodes.deformation import bodies
from palpate.studies.body_figures import measure_bodies
from palpate.views.page.explain import bodies_of, explain_plan, explain_run
from palpate.views.page.hard import STIFFNESS, hard_cases
from palpate.views.page.measuring import Measuring
from palpate.views.page.steered import steer_launch


def steered(folder, *sets, graph="kidney", scene=None):
    launch, _ = steer_launch(find(graph).but(overrides=sets), folder)
    return launch.but(scene=scene) if scene else launch


def test_the_page_lists_what_the_plan_lists(tmp_path):
    planned = steered(tmp_path, "scene.tissue.friction=false").plan()
    told = explain_plan(planned)
    assert [name for name, _ in told["runs"]] == [name for name in planned.order if not name.startswith("palpate")]
    assert dict(told["left_out"]) == planned.skipped and "friction" in planned.skipped
    effects = {name: (on, rule) for name, on, rule, _ in told["effects"]}
    assert effects["friction"] == (False, planned.skipped["friction"]) and effects["deformation"][0]
    assert "recording" not in effects


@pytest.mark.parametrize("body", ["MassSpring", "ReducedFE", "BeamBundle", "Rigid"])
def test_hard_cases_multiply_all_elastic_settings_of_a_body(tmp_path, body):
    launch = steered(tmp_path, f"tissue.use=deformation.{body}")
    planned = launch.plan()
    cases = {case.name: case for case in hard_cases(planned.graph, bodies_of(planned))}
    assert set(cases) == ({"stab"} if body == "Rigid" else {"stiff", "stab"})
    for case in cases.values():
        other = plan(launch.but(overrides=case.overrides).load()).graph.nodes
        assert explain_run(planned, case.name)["case"] == case.name
        usual = planned.graph.nodes["tissue"].cls(**planned.graph.nodes["tissue"].settings)
        changed = other["tissue"].cls(**other["tissue"].settings)
        for name in STIFFNESS:
            if hasattr(usual, name):
                scale = 1000.0 if case.name == "stiff" else 1.0
                assert np.allclose(getattr(changed, name), scale * np.asarray(getattr(usual, name)))
        assert (other["device"].settings.get("speed") == 2.0) == (case.name == "stab")


def test_every_organ_of_a_graph_is_stiffer(tmp_path):
    planned = steered(tmp_path, graph="organs").plan()
    (stiff, _) = hard_cases(planned.graph, bodies_of(planned))
    assert len(bodies_of(planned)) == 2 and all(
        any(each.startswith(f"{body}.") for each in stiff.overrides) for body in bodies_of(planned)
    )


def test_bodies_are_measured_against_the_most_exact_one():
    told = measure_bodies(find("kidney").but(duration=0.75), ["deformation.MassSpring", "deformation.ReducedFE"])
    found = told["bodies"]
    assert told["reference"] == next(iter(bodies())) == "deformation.ReducedFE"
    assert found["deformation.ReducedFE"]["error"] == told["known"] > 0.0
    assert told["known"] < found["deformation.MassSpring"]["error"] < 0.2
    assert all(0.0 < one["time"] < 0.1 for one in found.values())


def test_a_graph_with_a_real_device_is_not_measured_and_says_why():
    assert "drives a device" in measure_bodies(find("falcon"), ["deformation.MassSpring"])["why"]


def test_a_measurement_runs_in_another_process_and_can_be_ended():
    told = queue.Queue()
    Measuring(os.getpid, told.put)
    assert told.get(timeout=90.0) != os.getpid()
    ended = Measuring(partial(time.sleep, 600.0), told.put)
    ended.close()
    assert told.get(timeout=90.0) == {"why": "the measurement ended early"}
