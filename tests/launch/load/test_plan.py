"""Plans: running nodes, their order, and the reasons of the others; placements and launch files."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from palpate.engine.faults import GraphError
from palpate.engine.plan import Plan, force_path
from palpate.launch.load.files import GRAPHS
from palpate.launch.load.graph import load
from palpate.launch.load.launchfile import LAUNCH, LaunchFile, find, names
from palpate.launch.load.placement import ProcessGroup, apart, auto, fuse_nodes, load_place
from palpate.launch.load.plan import plan

TWO_DISPLAYS = """
nodes:
  device: {use: graph_nodes.Hand}
  finger: {use: graph_nodes.Finger, in: {state: device}}
  near:   {use: graph_nodes.Near, in: {pose: finger}}
  contact: {use: graph_nodes.Press, in: {proximity: near, body: tissue}}
  spread: {use: graph_nodes.Spread, in: {contact: contact}}
  tissue: {use: graph_nodes.Spring, in: {load: spread}}
  friction: {use: graph_nodes.Rub, in: {contact: contact}}
  control: {use: graph_nodes.Control, in: {contact: contact, friction: friction}}
"""


def planned(path, *sets, **given):
    return plan(load(path, overrides=sets, **given))


def test_each_node_comes_after_the_senders_of_its_direct_edges(whole):
    run = planned(whole)
    place = {name: i for i, name in enumerate(run.order)}
    direct = [(e.producer, name) for name, edges in run.edges.items() for e in edges if not e.loop]
    assert direct and all(place[a] < place[b] for a, b in direct)
    assert sorted(run.order) == sorted(set(run.graph.nodes) - {"log"})
    assert run.observers == {"log": tuple(run.order)}
    assert run.skipped == {}


def test_an_observer_of_all_streams_needs_all_nodes(write):
    assert planned(write("g.yaml", TWO_DISPLAYS + "  log: {use: graph_nodes.Tape, in: all}\n")).skipped == {}


def test_without_observer_and_wanted_only_sources_and_sinks_need_nodes(write):
    run = planned(write("g.yaml", TWO_DISPLAYS))
    assert run.order == ["device"]
    assert run.skipped["control"] == "output unused: control"
    assert run.skipped["friction"] == "output unused: friction; read only by control, which does not run"
    lamp = TWO_DISPLAYS + "  lamp: {use: graph_nodes.Lamp, in: {friction: friction}}\n"
    run = planned(write("g.yaml", lamp))
    assert set(run.skipped) == {"control"}


def test_an_observer_of_all_streams_needs_no_more_than_the_wanted_streams(write):
    path = write("g.yaml", "wanted: [contact]\n" + TWO_DISPLAYS + "  log: {use: graph_nodes.Tape, in: all}\n")
    run = planned(path)
    assert set(run.skipped) == {"friction", "control"}
    assert run.observers == {"log": ("device", "finger", "near", "contact", "spread", "tissue")}
    assert set(planned(path, "wanted=[control]").skipped) == set()
    assert planned(path, wanted=["device"]).order == ["device"]
    assert planned(path, scene={"wanted": "device"}).order == ["device"]
    assert planned(path, wanted=["contact"], scene={"wanted": "contact"}).order != ["device"]
    assert planned(path, "wanted=device", wanted=["contact"], scene={"wanted": "contact"}).order == ["device"]
    assert planned(path, "wanted=all", scene={"wanted": "device"}).skipped == {}


def test_an_observer_of_some_streams_needs_these(write):
    run = planned(write("g.yaml", TWO_DISPLAYS + "  log: {use: graph_nodes.Tape, in: [friction]}\n"))
    assert set(run.skipped) == {"control"}
    assert run.observers == {"log": ("friction",)}


def test_an_effect_disabled_by_the_scene_is_skipped_with_the_reason(whole):
    run = planned(whole, "scene.tissue.friction=off")
    assert run.skipped == {"friction": "tissue.friction is false (--set scene.tissue.friction=off)"}
    assert [e.port for e in run.edges["spread"]] == ["contact"]
    assert [e.port for e in run.edges["control"]] == ["contact"]
    compared = planned(whole, "friction.when=tissue.cells > 20")
    reason = compared.skipped["friction"]  # the path of the file is relative to the working directory
    assert reason.startswith("tissue.cells > 20 is false: tissue.cells is 12 (") and reason.endswith("whole.yaml:3)")


def test_pruning_does_not_change_the_held_edges(whole):
    """Held edges are chosen on the whole graph, so the running part computes the same values."""
    before, after = planned(whole), planned(whole, "scene.tissue.friction=off")
    for name in after.order:
        kept = tuple(e for e in before.edges[name] if e.producer in after.order)
        assert after.edges[name] == kept


def test_only_fields_with_a_reader_are_wanted(whole):
    run = planned(whole, "wanted=[control]")
    assert run.wanted["tissue"] == {"stiffness", "rest_indentation"}
    assert run.wanted["control"] == {"force", "state", "energy"}
    node = run.make("tissue")
    assert node.wants("rest_indentation") and not node.wants("displacement")
    everything = planned(whole)
    assert "displacement" in everything.wanted["tissue"]
    received = planned(whole, "wanted=[control]", "log.in=[tissue]")
    assert "displacement" in received.wanted["tissue"]


def test_a_plan_survives_a_round_trip_through_json(whole, monkeypatch):
    monkeypatch.chdir("/usr/lib")  # no relative path from here is shorter than the absolute path
    for sets in ((), ("scene.tissue.friction=off", "wanted=[control]", "near.offset=[1 mm, 0, 0]")):
        run = planned(whole, *sets)
        spec = json.loads(json.dumps(run.to_spec()))
        again = Plan.from_spec(spec)
        assert again == run
        assert again.make("finger").radius == 0.006


def test_a_plan_with_a_removed_class_is_an_error(whole):
    spec = planned(whole).to_spec()
    spec["nodes"][0]["class"] = "graph_nodes.Gone"
    with pytest.raises(GraphError, match=r"node 'device': class 'graph_nodes.Gone' cannot be imported"):
        Plan.from_spec(spec)


@pytest.mark.parametrize(
    ("key", "value"), [("every", "2"), ("settings", 3), ("edges", [{"port": 1}]), ("place", "here")]
)
def test_a_plan_with_a_value_of_another_type_is_an_error(whole, key, value):
    spec = json.loads(json.dumps(planned(whole).to_spec()))
    spec["nodes"][1][key] = value
    with pytest.raises(ValueError, match=rf"at `\$\[1\]\.{key}"):
        Plan.from_spec(spec)


def test_plans_do_not_depend_on_the_hash_seed(whole):
    code = (
        "import json; from palpate.launch.load.graph import load; from palpate.launch.load.plan import plan;"
        f"print(json.dumps(plan(load({str(whole)!r}, overrides=['wanted=[control, tissue]'])).to_spec()))"
    )
    path = ":".join(sys.path)
    outs = {
        subprocess.run(
            [sys.executable, "-c", code],
            env={"PYTHONHASHSEED": seed, "PYTHONPATH": path},
            capture_output=True,
            check=True,
        ).stdout
        for seed in ("1", "2", "3")
    }
    assert len(outs) == 1


def test_by_default_each_node_has_a_separate_process(whole):
    run = planned(whole)
    assert [g.nodes for g in apart(run).groups] == [[n] for n in (*run.order, "log")]
    assert [g.nodes for g in fuse_nodes(run).groups] == [[*run.order, "log"]]
    assert load_place(None, run).groups == apart(run).groups
    assert load_place("fused", run).groups == fuse_nodes(run).groups


def test_a_placement_groups_nodes(whole, write):
    place = write(
        "place.yaml",
        """
        loop: {nodes: [contact, friction, near], core: 1, priority: 80}
        far: {nodes: [tissue], core: [0, 1], host: tcp://10.0.0.2}
        rest: [log, spread]
    """,
    )
    run = planned(whole, "scene.tissue.friction=off")
    groups = load_place(place, run).groups
    assert groups[:3] == [
        ProcessGroup("loop", ["near", "contact"], (1,), 80),
        ProcessGroup("far", ["tissue"], (0, 1), None, "10.0.0.2"),
        ProcessGroup("rest", ["spread", "log"]),
    ]
    assert {g.name for g in groups[3:]} == {"device", "finger", "control", "motor"}
    assert load_place(place, run).group_of("log").name == "rest"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a: {nodes: [nera]}", ["group 'a'", "no node 'nera'", "Did you mean 'near'"]),
        ("a: {nodes: [near]}\nb: {nodes: [near]}", ["'near' is in group 'a' already"]),
        ("a: {nodes: [near], cores: 1}", ["'cores'", "Did you mean 'core'"]),
        ("a: {nodes: [near], core: -1}", ["core: found -1"]),
        ("a: {nodes: [near], core: true}", ["core: found true"]),
        ("a: {nodes: [near], core: []}", ["core: found []"]),
        ("a: {nodes: [near], priority: 100}", ["priority: found 100", "1 to 99"]),
        ("a: {nodes: [near], host: 'a b'}", ["host: found 'a b'", "tcp://"]),
        ("a: {nodes: near}", ["nodes: found 'near'", "list"]),
        ("a: 3", ["group 'a': found 3"]),
        ("tissue: {nodes: [near]}", ["group 'tissue' has the name of a node", "Rename"]),
        ("3", ["expected a mapping"]),
    ],
)  # fmt: skip
def test_a_bad_placement_is_an_error(whole, write, text, words):
    with pytest.raises(GraphError) as error:
        load_place(write("place.yaml", text), planned(whole))
    for word in ["place.yaml", *words]:
        assert word in str(error.value)


def test_a_launch_file_is_one_run(whole, write):
    write("two.yaml", "loop: [near, contact]\n")
    scene = write("scene.yaml", "tissue: {friction: true, stiffness: 1}\nfinger: {}\n")
    run = find(
        str(
            write(
                "run.yaml",
                """
        graph: whole.yaml
        scene: scene.yaml
        place: two.yaml
        clock: real
        duration: 1500 ms
        record: out.mcap
        pace: 2
        wanted: [control]
        set: {tissue.stiffness: 5 N/m, rate: 500, finger: {radius: 1 mm}, scene: {tissue: {friction: off}}}
    """,
            )
        )
    )
    assert (run.graph, run.scene, run.clock, run.duration, run.pace) == (whole, scene, "real", 1.5, 2.0)
    assert str(run.record) == "out.mcap"
    what_runs = run.plan()
    assert what_runs.graph.rate == 500.0 and set(what_runs.skipped) == {"friction"}
    assert what_runs.graph.nodes["tissue"].settings["stiffness"] == 5.0
    assert what_runs.graph.nodes["finger"].settings["radius"] == 0.001
    assert run.placement(what_runs).groups[0] == ProcessGroup("loop", ["near", "contact"])
    assert run.but(overrides=["tissue.stiffness=6"]).load().nodes["tissue"].settings["stiffness"] == 6.0
    assert run.but(clock="simulated", duration=None).clock == "simulated" and run.but(duration=None).duration == 1.5


def test_a_graph_alone_is_a_run_with_defaults(whole):
    assert find(str(whole)) == LaunchFile(graph=whole)


def test_a_graph_inherits_duration_and_recording_from_its_base(write):
    mine = write("mine.yaml", "extends: kidney\n")
    softer = write("softer.yaml", "extends: mine.yaml\nnodes: {tissue: {stiffness: 2e3}}\n")
    for file in (mine, softer):
        run = find(str(file))
        assert run == LaunchFile(graph=file, duration=find("kidney").duration, record=Path(f"{file.stem}.mcap"))
    round_ = write("round.yaml", "extends: round.yaml\n")
    assert find(str(round_)) == LaunchFile(graph=round_)
    assert find(str(write("lost.yaml", "extends: nowhere\n"))).record is None


def test_the_run_of_a_graph_is_not_inherited_or_recorded(write):
    text = "extends: kidney\nrun: {clock: real, duration: 700 ms, record: sources, pace: 2}\n"
    file = write("mine.yaml", text)
    run = find(str(file))
    assert run == LaunchFile(graph=file, clock="real", duration=0.7, record=Path("mine.mcap"), only="sources", pace=2.0)
    longer = find(str(write("longer.yaml", "extends: mine.yaml\n")))
    assert (longer.duration, longer.record, longer.only) == (0.7, Path("longer.mcap"), "sources")
    assert "run" not in run.load().source


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("run: {duraton: 3 s}", ["'duraton'", "Did you mean 'duration'"]),
        ("run: {graph: kidney}", ["unknown key 'graph'"]),
        ("run: {scene: [kidney]}", ["scene: found ['kidney']", "expected the name of a file"]),
        ("run: 3", ["run: found 3", "expected a mapping"]),
        ("run: {clock: [real]}", ["clock: found ['real']"]),
    ],
)
def test_a_bad_run_of_a_graph_is_an_error(write, text, words):
    with pytest.raises(GraphError) as error:
        find(str(write("mine.yaml", f"extends: kidney\n{text}\n")))
    for word in ["mine.yaml:2", *words]:
        assert word in str(error.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("clok: real", ["'clok'", "Did you mean 'clock'"]),
        ("clock: reel", ["clock: found 'reel'", "Did you mean 'real'"]),
        ("duration: 3 mm", ["duration [s]", "a length", "a time"]),
        ("duration: -1", ["duration [s]", "above 0"]),
        ("duration: true", ["duration [s]"]),
        ("pace: fast", ["pace [1]", "'fast'"]),
        ("scene: nowhere", ["scene 'nowhere' not found"]),
        ("place: nowhere", ["place 'nowhere' not found", "two"]),
        ("place: 3", ["place: found 3", "expected the name of a file"]),
        ("place: ''", ["place '' not found", "two"]),
        ("pace: .nan", ["pace [1]: found nan", "from 0.001 to 1e+06"]),
        ("duration: 99999999999999999999999", ["duration [s]", "to 1e+09"]),
        ("record: 3", ["record: found 3"]),
        ("set: 3", ["set: found 3"]),
        ("wanted: 3", ["wanted: found 3"]),
    ],
)  # fmt: skip
def test_a_bad_launch_file_is_an_error(whole, write, text, words):
    with pytest.raises(GraphError) as error:
        find(str(write("run.yaml", f"graph: whole.yaml\n{text}\n")))
    for word in ["run.yaml:2", *words]:
        assert word in str(error.value)


def test_a_wrong_override_in_a_launch_file_is_an_error_with_its_line(whole, write):
    run = find(str(write("run.yaml", "graph: whole.yaml\nset:\n  tissue.stifness: 3\n")))
    with pytest.raises(GraphError, match=r"run.yaml:3: node 'tissue', setting 'stifness'"):
        run.load()


def test_shipped_files_are_found_by_name():
    assert "kidney" in names()
    run = find("kidney")
    assert run.path == LAUNCH / "kidney.yaml" and run.graph == GRAPHS / "kidney.yaml"
    assert run.duration == 6.3 and run.clock == "simulated"
    with pytest.raises(GraphError, match="Did you mean 'kidney'"):
        find("kidny")


def test_auto_groups_the_force_path_and_gives_the_reason(whole):
    run = planned(whole)
    loop, rest = auto(run, cores=(0, 1)).groups
    assert set(loop.nodes) == force_path(run) and rest.nodes == ["log"]
    assert loop.why == "force path; no step times yet" and rest.why == "off the force path"
    quick = dict.fromkeys(run.order, 10e-6)
    assert [g.nodes for g in auto(run, quick, cores=(0, 1)).groups] == [loop.nodes, rest.nodes]
    assert auto(run, quick, cores=(0, 1)).groups[0].why == f"force path, {10 * len(loop.nodes)} of 1000 µs a tick"


def test_auto_separates_a_slow_body_if_a_core_is_free(whole):
    run = planned(whole)
    slow = dict.fromkeys(run.order, 10e-6) | {"tissue": 600e-6}
    loop, body, rest = auto(run, slow, cores=(0, 1)).groups
    assert loop.core is None and body.core == (0,)
    assert body.nodes == ["tissue"] and body.why == "600 of 1000 µs a tick, used in the next one"
    assert "tissue" not in loop.nodes and rest.nodes == ["log"]
    assert "tissue" in auto(run, slow, cores=(0,)).groups[0].nodes
    fast = dict.fromkeys(run.order, 90e-6)  # too slow together, but a wake-up costs as much as each node
    assert "tissue" in auto(run, fast, cores=(0, 1)).groups[0].nodes
    late = dict.fromkeys(run.order, 10e-6) | {
        "contact": 600e-6
    }  # used in the same tick, so a separate process gains nothing
    assert "contact" in auto(run, late, cores=(0, 1)).groups[0].nodes
