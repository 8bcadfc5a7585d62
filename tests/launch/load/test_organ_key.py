"""The key `organ:` from the shell, Python, launch files, studies and scenes; the basis that is built on demand."""

import json

import numpy as np
import pytest
from expected_notes import PLACED, REFINED, UNTAKEN
from typer.testing import CliRunner

import palpate
from palpate import bases
from palpate.cli.__main__ import app
from palpate.engine.faults import GraphError
from palpate.launch.load.launchfile import find
from palpate.launch.load.organ_file import OrganFile, organ_of
from palpate.nodes.base import SettingError
from palpate.nodes.deformation.basis_store import about, cache
from palpate.physics.errors import MeshError

trimesh = pytest.importorskip("trimesh")


COARSE = "scene.surface.refine=12 mm"
"""Refined to 1.6 mm, the ball would have 40 962 vertices, which each process divides and places again."""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with balls of 120 and 40 mm, in mm, and an empty cache of bases."""
    trimesh.creation.icosphere(2, 20.0).export(tmp_path / "small.stl")
    trimesh.creation.icosphere(2, 60.0).export(tmp_path / "ball.stl")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path


def surface(launch):
    graph = launch.load()
    return graph.scene["surface"], [note for note in graph.notes if ".stl" in note]


def test_launch_files_and_scenes_take_the_organ_of_a_file_next_to_them(folder, monkeypatch):
    expected, notes = surface(find("kidney").but(organ=OrganFile(folder / "small.stl", "mm")))
    assert len(notes) == 1 and "its top lies at" in notes[0] and expected["file_unit"] == "mm"
    (folder / "run.yaml").write_text("graph: kidney\norgan: {file: small.stl, unit: mm}\n")
    (folder / "scene.yaml").write_text("extends: kidney\norgan: {file: small.stl, unit: mm}\n")
    (folder / "elsewhere").mkdir()
    monkeypatch.chdir(folder / "elsewhere")
    for launch in (find(str(folder / "run.yaml")), find("kidney").but(scene=folder / "scene.yaml")):
        assert surface(launch) == surface(launch.settle_organ()) == (expected, notes)
    monkeypatch.chdir(folder)
    assert surface(find("kidney").but(overrides=("scene.organ={file: small.stl, unit: mm}",)))[0] == expected
    assert surface(find("kidney").but(overrides=("scene.organ=ball.stl", COARSE)))[0]["file_unit"] == "mm"


@pytest.mark.notes(PLACED, REFINED)
def test_python_gives_the_same_force_as_the_shell(folder):
    words = ["run", "kidney", "--organ", "ball.stl", "--duration", "0.6 s", "--fused", "--no-pictures", "--json"]
    shell = CliRunner().invoke(app, [*words, "--set", COARSE, "--out", "shell"])
    assert shell.exit_code == 0, shell.output
    expected = np.asarray(palpate.open("shell/ball.mcap").contact.force)
    assert expected.max() > 0.5
    given = {"organ": "ball.stl", "sets": (COARSE,), "duration": 0.6}
    np.testing.assert_array_equal(palpate.run("kidney", record="python.mcap", **given).contact.force, expected)
    lanes = palpate.Ensemble("kidney", 2, **given).run(quiet=True)["contact.force"]
    np.testing.assert_array_equal(np.asarray(lanes)[1], expected)
    *_, last = palpate.steps("kidney", **given)
    assert last.contact.force == expected[-1]
    study = palpate.Study("kidney", {"tissue.stiffness": [200.0, 300.0]}, **given)
    assert surface(study.launch)[0]["file_unit"] == "mm"


@pytest.mark.notes(PLACED, REFINED)
def test_an_environment_takes_an_organ(folder):
    gymnasium = pytest.importorskip("gymnasium")
    import palpate.gym  # noqa: F401, registers the environments

    env = gymnasium.make("palpate/Touch-v0", organ={"file": "small.stl", "unit": "mm"})
    env.reset(seed=1)
    collision = env.unwrapped.stepper.plan.graph.nodes["collision"]
    assert collision.settings["surface"].endswith("small.stl")
    env.close()


@pytest.mark.notes(PLACED, REFINED)
def test_a_nodule_is_sought_around_the_top_of_an_organ(folder):
    """The field was around the origin of the file, far from the organ."""
    gymnasium = pytest.importorskip("gymnasium")
    import palpate.gym  # noqa: F401, registers the environments

    trimesh.creation.icosphere(2, 60.0).apply_translation((300.0, -70.0, 500.0)).export(folder / "far.stl")
    nodes = {name: {"refine": 0.012} for name in ("tissue", "collision", "spread")}
    env = gymnasium.make("palpate/FindNodule-v0", organ={"file": "far.stl", "unit": "mm"}, nodes=nodes)
    task, mesh = env.unwrapped, env.unwrapped.stepper.node("tissue").mesh()
    top, places = mesh.vertices[mesh.vertices[:, 2].argmax()], []
    for seed in range(4):
        seen, _ = env.reset(seed=seed)
        np.testing.assert_allclose(seen["position"][:2], top[:2], atol=5e-3)
        assert 4e-3 < seen["position"][2] - top[2] < 15e-3
        places.append(task.setting("tissue", "nodule_position"))
    assert np.abs(np.array(places)[:, :2] - top[:2]).max() < 12e-3 + 5e-3
    assert np.ptp(places, axis=0)[:2].min() > 1e-3
    np.testing.assert_allclose(np.linalg.norm(np.array(places) - (top - (0.0, 0.0, 0.06)), axis=1), 0.06, atol=1.5e-3)
    env.close()


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"file": "ball.stl", "units": "mm"}, "the key 'units'"),
        (7, "expected a mesh file or a segmentation, or a mapping"),
        ({"file": "ball.stl", "piece": 0}, "found 0, expected all or a number from 1"),
        ({"file": "ball.stl", "piece": "some"}, "found 'some', expected all"),
    ],
)
def test_a_wrong_key_says_what_is_expected(folder, given, text):
    with pytest.raises(GraphError, match=text):
        organ_of(given)


def test_a_missing_file_and_a_wrong_unit_are_errors_without_traceback(folder):
    for words, text in (
        ("--organ no.stl", "no file no.stl"), ("--organ ball.stl --unit m", "in m it is"),
        ("--organ ball.stl --piece x", "expected all or"), ("--piece 1", "needs --organ"),
    ):  # fmt: skip
        result = CliRunner().invoke(app, ["run", "kidney", *words.split()], env={"COLUMNS": "300"})
        assert result.exit_code == 2 and text in result.output and "Traceback" not in result.output
    with pytest.raises(MeshError, match="in m it is"):
        palpate.run("kidney", organ={"file": "ball.stl", "unit": "m"})


@pytest.mark.notes(UNTAKEN, PLACED, REFINED)
def test_a_missing_basis_is_built_once_and_used(folder):
    trimesh.creation.icosphere(1, 60.0).export("ball.stl")
    given = {"organ": "ball.stl", "tissue": "deformation.ReducedFE", "sets": (COARSE,), "duration": 0.5}
    force = palpate.run("kidney", record="one.mcap", **given).contact.force
    (basis,) = cache().glob("ball-condensed-*.npz")
    assert force.max() > 0.5 and about(basis)["inputs"]["surface"] == "ball"
    written = basis.stat().st_mtime_ns
    np.testing.assert_array_equal(palpate.run("kidney", record="two.mcap", **given).contact.force, force)
    assert basis.stat().st_mtime_ns == written


@pytest.fixture
def loaded(monkeypatch):
    """The points whose graphs are loaded to look for missing bases, for a run with these overrides."""

    def points_of(points, *overrides):
        monkeypatch.setattr(bases, "build_missing", lambda *given: None)
        seen = []
        bases.build_for_each(
            lambda values: seen.append(values) or find("kidney").but(overrides=overrides), points, True
        )
        return seen

    return points_of


def test_points_that_differ_in_what_a_basis_depends_on(loaded):
    """One point of each basis is loaded: a new modulus needs no basis, a new Poisson's ratio or nodule does."""
    common = {"tissue.young": 1e3, "scene.tissue.poisson": 0.4, "scene.nodule.depth": 5e-3, "tissue.use": "a"}
    changes = [
        {},
        {"tissue.young": 2e3},
        {"scene.tissue.poisson": 0.3},
        {"scene.nodule.depth": 6e-3},
        {"tissue.use": "b"},
    ]
    points = [common | change for change in changes]
    assert loaded(points) == [points[0], *points[2:]]


def test_lanes_that_place_and_turn_an_organ_load_one_graph_for_its_basis(loaded):
    """Each lane's graph was loaded twice, 10 ms each. A nodule stays where it is while the organ turns."""
    points = [
        {"scene.surface.rotation": [0.0, 0.0, 0.1 * k], "scene.surface.position": [0.0, 0.0, 0.0]} for k in range(9)
    ]
    assert loaded(points) == points[:1]
    assert loaded(points, "tissue.use=deformation.ReducedFE") == points[:1]
    nodule = ("tissue.use=deformation.ReducedFE", "tissue.nodule_radius=4 mm", "tissue.nodule_depth=8 mm")
    assert loaded(points, *nodule) == points


@pytest.mark.long
@pytest.mark.timeout(900)
def test_the_bases_of_all_points_and_lanes_are_built(folder):
    trimesh.creation.icosphere(1, 60.0).export("ball.stl")
    one = {"organ": "ball.stl", "duration": 0.6}
    uses = ["deformation.MassSpring", "deformation.ReducedFE"]
    rows = palpate.Study("kidney", {"tissue.use": uses}, **one).run("study", workers=1).rows()
    assert [row["error"] for row in rows] == ["", ""]
    lanes = palpate.Ensemble("kidney", 2, {"tissue.poisson": [0.45, 0.4]}, tissue=uses[1], **one)
    found = lanes.run(quiet=True)["contact.force"].values[:, -1]
    assert found[0] == rows[1]["peak contact.force"] != found[1] > 0.0
    stored = {about(path)["inputs"]["poisson"] for path in cache().glob("ball-condensed-*.npz")}
    assert stored == {0.45, 0.4}


def test_a_basis_that_cannot_be_built_is_an_error_with_the_reason(folder):
    trimesh.Trimesh(*(lambda m: (m.vertices, m.faces[:-1]))(trimesh.creation.icosphere(1, 20.0))).export("open.stl")
    given = {"organ": {"file": "open.stl", "unit": "mm"}, "sets": (COARSE,), "duration": 0.2}
    with pytest.raises(SettingError, match="not closed"):
        palpate.Ensemble("kidney", 2, {"tissue.young": [1e4, 2e4]}, tissue="deformation.ReducedFE", **given)
    lines = []
    study = palpate.Study("kidney", {"tissue.use": ["deformation.ReducedFE"]}, **given)
    (row,) = study.run("study", workers=1, report=lines.append).rows()
    assert "no reduced basis is stored" in row["error"]
    assert any("not closed" in line for line in lines)


@pytest.mark.long
def test_a_fine_file_is_reduced_and_the_notes_have_the_error(folder):
    """The stiffness of the reduced ball differs by less than the stated error from that of a finer basis."""
    pytest.importorskip("pytetwild")
    trimesh.creation.icosphere(5, 60.0).export("ball.stl")
    common = ["--organ", "ball.stl", "--set", "tissue.use=deformation.ReducedFE", "--duration", "0.6 s", "--fused"]
    peak = {}
    for coarse in (300, 900):
        words = [
            "run",
            "kidney",
            *common,
            "--set",
            f"tissue.coarse={coarse}",
            "--no-pictures",
            "--json",
            "-o",
            str(coarse),
        ]
        result = CliRunner().invoke(app, words)
        assert result.exit_code == 0, result.output
        (note,) = (note for note in json.loads(result.stdout)["notes"] if "the basis of ball" in note)
        peak[coarse] = np.asarray(palpate.open(f"{coarse}/ball.mcap").contact.force).max()
        error = next(
            about(path)["error"] for path in cache().glob("ball-*.npz") if about(path)["inputs"]["coarse"] == coarse
        )
        assert f"{error['mean']:.1%} on average" in note and error["mean"] < 0.05
    assert abs(peak[300] / peak[900] - 1.0) < 0.05
