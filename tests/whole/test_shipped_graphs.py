"""All files in graphs/ load and can be planned, with every matching scene and placement."""

import functools
from pathlib import Path

import pytest
import yaml
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.engine.faults import GraphError
from palpate.launch.load.files import GRAPHS, PLACES, SCENES
from palpate.launch.load.launchfile import find, names, purpose
from palpate.launch.run.execute import execute
from palpate.records.reader import Recording

NAMES = sorted(p.stem for p in GRAPHS.glob("*.yaml"))
SCENE_NAMES = sorted(p.stem for p in SCENES.glob("*.yaml"))


@functools.cache
def read(folder, name):
    return yaml.safe_load((folder / f"{Path(name).stem}.yaml").read_text(encoding="utf-8"))


def below(folder, name):
    """A file and all files that it extends."""
    while name is not None:
        name = Path(name).stem
        yield name
        name = read(folder, name).get("extends")


def own_scene(graph):
    return next(Path(content["scene"]).stem for g in below(GRAPHS, graph) if "scene" in (content := read(GRAPHS, g)))


PAIRS = [(graph, scene) for graph in NAMES for scene in SCENE_NAMES if own_scene(graph) in below(SCENES, scene)]


def test_every_scene_belongs_to_a_graph():
    assert {scene for _, scene in PAIRS} == set(SCENE_NAMES)


@pytest.mark.parametrize(("graph", "scene"), PAIRS)
def test_every_graph_can_be_planned_with_every_scene_that_extends_its_scene(graph, scene):
    """A scene that moves an organ which the graph lacks is refused with its name."""
    moved = {name for each in read(SCENES, scene).get("foundations", {}).values() for name in each["moves"]}
    bodies = set(find(str(GRAPHS / f"{graph}.yaml")).load().nodes)
    if not moved <= bodies:
        with pytest.raises(GraphError, match=f"moves '{min(moved - bodies)}', which is no body of the graph"):
            find(str(GRAPHS / f"{graph}.yaml")).but(scene=SCENES / f"{scene}.yaml").load()
        return
    plan = find(str(GRAPHS / f"{graph}.yaml")).but(scene=SCENES / f"{scene}.yaml").plan()
    assert plan.order
    for name in plan.order:
        plan.make(name)


@pytest.mark.parametrize("name", NAMES)
def test_every_graph_has_a_launch_file_of_its_name(name):
    assert find(name) == find(str(GRAPHS / f"{name}.yaml")) and find(name).graph == GRAPHS / f"{name}.yaml"


@pytest.mark.parametrize("name", names())
def test_every_launch_file_can_be_planned_and_records(name):
    launch = find(name)
    assert launch.plan().order and launch.duration and launch.clock and purpose(launch)
    assert launch.record == Path(f"{name}.mcap")
    launch.placement(launch.plan())


@pytest.mark.parametrize("place", sorted(p.stem for p in PLACES.glob("*.yaml")))
def test_every_placement_fits_a_graph(place):
    named = {
        node
        for group in read(PLACES, place).values()
        for node in (group if isinstance(group, list) else group["nodes"])
    }
    fitting = [graph for graph in NAMES if named <= set(find(graph).load().nodes) | {"log"}]
    assert fitting
    for graph in fitting:
        assert find(graph).but(place=PLACES / f"{place}.yaml").plan().order


@pytest.mark.parametrize("body", ["MassSpring", "BeamBundle", "Rigid"])
@pytest.mark.parametrize("graph", ["kidney", "nodule"])
def test_every_body_fits_into_the_graphs_of_a_touch(graph, body):
    assert find(graph).but(overrides=(f"tissue.use=deformation.{body}",)).plan().make("tissue")


def test_the_band_runs_in_the_kidney_only_if_the_scene_requests_it():
    assert "band" in find("kidney").plan().skipped
    plan = find("kidney").but(overrides=("scene.finger.band=true",)).plan()
    assert "band" in plan.order and "band" in find("nodule").plan().order
    assert not any("band" in edges for node, edges in plan.edges.items() if node != "band")


def test_the_band_changes_no_byte_of_the_other_streams(tmp_path):
    runs = []
    for wanted in ("true", "false"):
        file = tmp_path / f"{wanted}.mcap"
        sets = (f"scene.finger.band={wanted}", "scene.surface.vertices=1500", "scene.hand.begin=[0, 0, 0.107]")
        assert execute(find("kidney").but(record=file, place="fused", duration=0.4, overrides=sets)).result.ok
        streams: dict[str, list[bytes]] = {}
        for name, _, payload in Recording(file).payloads():
            streams.setdefault(name, []).append(payload)
        runs.append(streams)
    assert len(runs[0].pop("band")) == 40
    assert runs[0] == runs[1] and len(runs[1]["contact"]) == 400


def test_an_invalid_setting_is_an_error_without_a_traceback():
    command = ["run", "fingertip-slide", "--fused", "-q", "--no-record", "--set", "scene.finger.shape=nowhere.npz"]
    result = CliRunner().invoke(app, command)
    assert result.exit_code == 1 and "nowhere.npz" in result.output and "Traceback" not in result.output
