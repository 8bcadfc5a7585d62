"""A label of a segmentation as organ: from the shell, Python, launch files, scenes, studies; its store, its errors."""

import json

import numpy as np
import pytest
from expected_notes import PLACED, REFINED
from label_files import write_nifti, write_nrrd
from typer.testing import CliRunner

import palpate
from palpate.cli.__main__ import app
from palpate.launch.load.launchfile import find
from palpate.launch.load.organ_file import OrganFile, organ_of
from palpate.nodes.base import SettingError
from palpate.nodes.base.surface import surface_mesh
from palpate.physics.errors import MeshError
from palpate.physics.segmentation import stored
from palpate.physics.segmentation.read import read_labels

pytest.importorskip("nibabel")
pytest.importorskip("nrrd")
COARSE = "scene.surface.refine=12 mm"
NAMES = {"Segment0_Name": "liver", "Segment0_LabelValue": 1, "Segment1_Name": "tumour", "Segment1_LabelValue": 2}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A body of 38 x 30 x 22 mm with a tumour, whose right half is thicker, as NIfTI and as NRRD; an empty cache."""
    index = np.moveaxis(np.indices((41, 35, 31)), 0, -1) - (20, 17, 15)
    points = 1.25 * index
    thick = 1.0 + 0.2 * np.sign(points[..., :1])  # right of the middle
    body = np.linalg.norm(points / (19.0, 15.0, 10.0 * thick[..., 0].max()) / np.concatenate(
        [np.ones_like(thick), np.ones_like(thick), thick], axis=-1), axis=-1) < 1.0  # fmt: skip
    voxels = body.astype(np.uint8)
    voxels[np.linalg.norm(points, axis=-1) < 4] = 2
    affine = np.diag([1.25, 1.25, 1.25, 1.0])
    affine[:3, 3] = (-300.0, 20.0, 900.0)
    write_nifti(tmp_path / "seg.nii.gz", voxels, affine)
    write_nrrd(tmp_path / "seg.seg.nrrd", voxels, affine, **NAMES)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(stored, "user_cache", lambda: tmp_path / "cache")  # that of the kernels stays
    monkeypatch.setenv("COLUMNS", "300")
    return tmp_path


def call(*words):
    return CliRunner().invoke(app, [*words])


def surface(launch):
    graph = launch.load()
    return graph.scene["surface"], [note for note in graph.notes if "seg" in note]


def test_launch_files_scenes_python_and_studies_take_a_label(folder):
    organ = OrganFile(folder / "seg.seg.nrrd", label="liver")
    expected, notes = surface(find("kidney").but(organ=organ, overrides=(COARSE,)))
    assert expected["file_unit"] == "m" and expected["surface"].endswith(".ply") and "/organs/" in expected["surface"]
    assert any("its surface encloses" in note for note in notes) and any("label 2 (tumour)" in note for note in notes)
    (folder / "run.yaml").write_text("graph: kidney\norgan: {file: seg.seg.nrrd, label: liver}\n")
    (folder / "scene.yaml").write_text("extends: kidney\norgan: {file: seg.seg.nrrd, label: liver}\n")
    given = {"file": "seg.seg.nrrd", "label": "liver"}
    for launch in (
        find("run.yaml").but(overrides=(COARSE,)),
        find("kidney").but(scene=folder / "scene.yaml", overrides=(COARSE,)),
        find("kidney").but(overrides=("scene.organ={file: seg.seg.nrrd, label: liver}", COARSE)),
        palpate.Study("kidney", {"tissue.stiffness": [1.0]}, organ=given, sets=(COARSE,)).launch,
    ):
        assert surface(launch)[0] == expected
    by_number = organ_of({"file": "seg.nii.gz", "label": 1}).as_mesh()[0]
    one, other = (surface_mesh(name, 0) for name in (str(by_number.file), expected["surface"]))
    np.testing.assert_allclose(one.vertices, other.vertices, atol=1e-9)


def test_the_right_side_of_the_body_is_at_positive_x(folder):
    mesh = surface_mesh(str(organ_of({"file": "seg.nii.gz", "label": 1}).as_mesh()[0].file), 0)
    right = mesh.vertices[:, 0] > mesh.vertices[:, 0].mean()
    assert mesh.vertices[:, 0].mean() == pytest.approx(-0.275, abs=0.005)
    assert np.ptp(mesh.vertices[right, 2]) > 1.3 * np.ptp(mesh.vertices[~right & (mesh.vertices[:, 0] < -0.28), 2])


@pytest.mark.notes(PLACED, REFINED, "its surface encloses", "hole in the label", "are bridged")
def test_the_shell_runs_a_label_and_python_has_the_same_force(folder):
    words = ["--organ", "seg.nii.gz", "--label", "1", "--set", COARSE, "--duration", "0.5 s", "--fused", "--json"]
    found = call("run", "kidney", *words, "--no-pictures", "--out", "shell")
    assert found.exit_code == 0, found.output
    expected = np.asarray(palpate.open("shell/seg.mcap").contact.force)
    assert expected.max() > 0.3
    given = {"organ": {"file": "seg.nii.gz", "label": 1}, "sets": (COARSE,), "duration": 0.5}
    np.testing.assert_array_equal(palpate.run("kidney", record="python.mcap", **given).contact.force, expected)


def test_labels_are_listed_and_an_organ_is_drawn(folder, monkeypatch):
    monkeypatch.setattr("palpate.views.pictures.models.organ.REFINE", 12e-3)
    found = json.loads(call("list", "labels", "seg.seg.nrrd", "--json").stdout)
    assert [(each["label"], each["name"]) for each in found["labels"]] == [(1, "liver"), (2, "tumour")]
    assert found["labels"][1]["extent m"] == pytest.approx([0.00875] * 3)
    assert "tumour" in call("list", "labels", "seg.seg.nrrd").stdout
    drawn = json.loads(call("picture", "organ", "seg.seg.nrrd", "--label", "liver", "--json").stdout)
    assert drawn["pictures"] == ["seg-organ.png"] and (folder / "seg-organ.png").stat().st_size > 20_000
    numbers = drawn["organ"]
    assert numbers["volume m3"] == pytest.approx(sum(each["volume m3"] for each in found["labels"]), rel=0.01)
    assert 0.0 < numbers["smallest thickness m"] < 0.05


def test_a_surface_is_computed_once_for_each_content_and_label(folder, monkeypatch):
    organ = OrganFile(folder / "seg.nii.gz", label=1)
    first = organ.as_mesh()
    monkeypatch.setattr(stored, "read_labels", lambda *_: pytest.fail("it was computed again"))
    assert organ.as_mesh() == first
    monkeypatch.setattr(stored, "read_labels", read_labels)
    content = (folder / "seg.nii.gz").read_bytes()
    (folder / "seg.nii.gz").write_bytes(content + b"\0")
    assert organ.as_mesh()[0].file != first[0].file


@pytest.mark.parametrize("damage", ["cut mesh", "other mesh", "no JSON", "no hash", "a number"])
def test_a_damaged_surface_is_computed_again(folder, damage):
    found = stored.store_surface(folder / "seg.nii.gz", 1)
    about, right = found.path.with_suffix(".json"), found.path.read_bytes()
    match damage:
        case "cut mesh":
            found.path.write_bytes(right[:-100])
        case "other mesh":
            found.path.write_bytes(right[:-1] + bytes([right[-1] ^ 1]))
        case "no JSON":
            about.write_text("{")
        case "no hash":
            about.write_text(json.dumps({"name": "x", "notes": []}))
        case "a number":
            about.write_text("3")
    assert stored.store_surface(folder / "seg.nii.gz", 1) == found
    assert found.path.read_bytes() == right


@pytest.mark.parametrize(
    ("words", "text"),
    [
        ("--organ seg.nii.gz", "seg.nii.gz has 2 labels: 1, 2. Choose one with --label"),
        ("--organ seg.seg.nrrd --label Lever", "no label 'Lever'; it has 1 (liver), 2 (tumour)"),
        ("--organ none.nii.gz --label 1", "none.nii.gz: No such file"),
        ("--organ seg.nii.gz --label 1 --unit mm", "whose header has the unit"),
        ("--organ ball.stl --label 1", "ball.stl is no segmentation"),
        ("--label 1", "--label needs --organ FILE"),
        ("--organ seg.mhd", "or as --organ a segmentation: .nii, .nii.gz"),
    ],
)
def test_what_cannot_be_used_is_an_error_of_one_line(folder, words, text):
    found = call("plan", "kidney", *words.split())
    assert found.exit_code == 2 and text in found.output and "Traceback" not in found.output


def test_a_wrong_label_or_setting_is_an_error_in_python(folder):
    with pytest.raises(MeshError, match=r"label of .*: found \[1\], expected its number or its name"):
        OrganFile(folder / "seg.nii.gz", label=[1])
    with pytest.raises(
        SettingError, match=r"is a segmentation, .* Give it as an organ: --organ seg.nii.gz --label NAME"
    ):
        surface_mesh("seg.nii.gz", 0)
