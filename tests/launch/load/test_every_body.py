"""Every shipped body loads in every shipped graph and scene, with the files that it needs at its start."""

from dataclasses import replace

import pytest

from palpate.cli.terminal.options import choose_launch
from palpate.launch.load.launchfile import find
from palpate.launch.load.plan import check_stored
from palpate.launch.run.execute import execute
from palpate.nodes.base import SettingError
from palpate.nodes.deformation import MassSpring, ReducedFE, bodies
from palpate.physics.errors import PalpateError

BODIES = sorted({*bodies(), "deformation.MassSpring", "deformation.Rigid"})
PRESSED = {
    "kidney": ["tissue"], "cartesian": ["tissue"], "falcon": ["tissue"], "falcons": ["tissue"], "fingertip": ["tissue"],
    "nodule": ["tissue"], "organs": ["kidney", "liver"], "palpate-two": ["tissue"], "pinch": ["tissue"],
    "remote": ["tissue"], "texture": ["tissue"],
}  # fmt: skip
"""Graphs with bodies, and the names of these nodes."""


@pytest.mark.parametrize("body", BODIES)
@pytest.mark.parametrize("graph", PRESSED)
def test_a_body_loads_in_a_graph(graph, body):
    for node in PRESSED[graph]:
        check_stored(choose_launch(graph, [f"{node}.use={body}"], None, None, False).plan())


@pytest.mark.parametrize("body", BODIES)
@pytest.mark.parametrize("scene", ["kidney", "nodule", "frictionless", "organs", "remote"])
def test_a_body_loads_in_another_scene(scene, body):
    check_stored(choose_launch("kidney", [f"tissue.use={body}"], scene, None, False).plan())


def test_a_missing_basis_is_a_fault_with_the_command_to_build_it(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    sets = ["tissue.use=deformation.ReducedFE", "scene.nodule.nodule_depth=9 mm"]
    with pytest.raises(
        PalpateError, match=r"nodule.yaml:\d+: node 'tissue'.*palpate build basis.*--set nodule_depth=0.009"
    ):
        check_stored(choose_launch("nodule", sets, None, None, False).plan())


def test_a_nodule_has_the_position_of_the_scene_in_every_body():
    """The position is in the world frame, for any frame of the surface; all frames use the same basis."""
    place = {"surface": "plane", "vertices": 900, "nodule_radius": 4e-3, "nodule_depth": 6e-3}
    turned = {"position": (0.01, 0.02, 0.105), "rotation": (0.0, 0.0, 1.2)}
    usual = ReducedFE(**place, position=(0.0, 0.0, 0.0), nodule_position=(0.004, 0.0, 0.0))
    assert usual.nodule_centre() == (0.004, 0.0, -0.006)
    x, y = 0.004 * 0.3623577544766736, 0.004 * 0.9320390859672263  # rotated by 1.2 rad
    moved = {**place, **turned, "nodule_position": (0.01 + x, 0.02 + y, 0.105)}
    assert ReducedFE(**moved).key() == usual.key()
    assert ReducedFE(**moved).centre() == pytest.approx(MassSpring(**moved).centre())
    assert ReducedFE(**{**moved, "nodule_depth": 7e-3}).key() != usual.key()
    with pytest.raises(SettingError, match="nodule_centre"):
        ReducedFE(nodule_centre=(0.0, 0.0, 0.0))


@pytest.mark.long
@pytest.mark.parametrize("body", BODIES)
@pytest.mark.parametrize("graph", PRESSED)
def test_a_body_runs_in_a_graph(graph, body):
    for node in PRESSED[graph]:
        run = find(graph).but(duration=0.05, place="fused", overrides=[f"{node}.use={body}"])
        outcome = execute(replace(run, record=None))
        assert outcome.result.ok, outcome.result.deaths
