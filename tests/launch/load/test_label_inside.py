"""A label inside of an organ as its nodule: place, size, modulus; tissues of labels; what is refused."""

import json
import re

import numpy as np
import pytest
from label_files import orientations, write_nifti, write_nrrd
from shell_text import unwrapped
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.engine.faults import GraphError
from palpate.launch.load.graph import load
from palpate.launch.load.labelled.table import _table, ratio_of, tissue_of
from palpate.launch.load.launchfile import find
from palpate.launch.load.organ_file import organ_of
from palpate.launch.load.plan import plan
from palpate.launch.load.tissues import tissues
from palpate.nodes.base.surface import surface_mesh
from palpate.physics.errors import MeshError
from palpate.physics.materials.nodule import stiffness_map
from palpate.physics.segmentation import stored

pytest.importorskip("nibabel")
pytest.importorskip("nrrd")
COARSE = "scene.surface.refine=12 mm"
SPACING = (1.5, 2.0, 2.5)  # [mm] along x, y, z of the body
HALF = np.array([26.0, 21.0, 16.0])  # [mm] half axes of the organ, an ellipsoid
MIDDLE = np.array([40.0, -70.0, 300.0])  # [mm] of it
AT, RADIUS = np.array([8.0, 4.0, 5.0]), 6.0  # [mm] of the tumour, from there: right, front, head
NAMES = {"Segment0_Name": "liver", "Segment0_LabelValue": 1, "Segment1_Name": "Liver tumour", "Segment1_LabelValue": 2,
         "Segment2_Name": "spleen", "Segment2_LabelValue": 3}  # fmt: skip
TURNS = list(orientations())


def voxels_of(turn=TURNS[0], at=AT, radius=RADIUS, wide=72.0):
    """Voxels (i,j,k): 1 the liver, 2 the tumour, 3 a spleen apart; and their affine [mm], for any order of the axes."""
    axes = turn * (np.abs(turn).T @ SPACING)
    half = np.abs(np.linalg.inv(axes) @ np.array([wide, 26.0, 21.0])).astype(int) + 1
    affine = np.eye(4)
    affine[:3, :3], affine[:3, 3] = axes, MIDDLE - axes @ half
    points = np.moveaxis(np.indices(2 * half + 1), 0, -1) @ axes.T + affine[:3, 3] - MIDDLE
    voxels = (np.linalg.norm(points / HALF, axis=-1) < 1.0).astype(np.uint8)
    voxels[np.linalg.norm(points - at, axis=-1) < radius] = 2
    voxels[np.linalg.norm(points - (-52.0, 0.0, 0.0), axis=-1) < 15.0] = 3
    return voxels, affine


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(stored, "user_cache", lambda: tmp_path / "cache")
    monkeypatch.setenv("COLUMNS", "300")
    return tmp_path


@pytest.fixture
def named(folder):
    write_nrrd(folder / "seg.seg.nrrd", *voxels_of(), **NAMES)
    return folder


def organ_mesh(file):
    """The surface of the liver as it is stored, in the coordinates of the file."""
    return surface_mesh(str(organ_of({"file": file, "label": "1+2"}).as_mesh()[0].file), 0, refine=12e-3)


def placed(file, label="1+2", *overrides, graph="kidney"):
    """The graph with this organ, and its body."""
    launch = find(graph).but(organ=organ_of({"file": file, "label": label}), overrides=(COARSE, *overrides))
    planned = plan(launch.load())
    return planned.graph, planned.make("tissue")


@pytest.mark.parametrize("turn", [1, 13, 30])
def test_the_nodule_is_where_the_tumour_is_for_any_axes_of_the_file(folder, turn):
    write_nifti(folder / "seg.nii.gz", *voxels_of(TURNS[turn], wide=28.0))
    graph, body = placed("seg.nii.gz")
    organ = 0.5 * (body.mesh().vertices.min(axis=0) + body.mesh().vertices.max(axis=0))
    np.testing.assert_allclose(body.centre() - organ, 1e-3 * AT, atol=4e-4)
    moved = np.array(graph.scene["surface"]["position"])
    np.testing.assert_allclose(body.centre(), 1e-3 * (MIDDLE + AT) + moved, atol=2e-4)
    assert body.nodule_radius == pytest.approx(1e-3 * RADIUS, rel=0.03)


def test_the_nodule_turns_and_moves_with_the_organ(named):
    quarter = "scene.surface.rotation=[1.5707963267948966, 0, 0]"  # front up: (x, y, z) to (x, -z, y)
    graph, body = placed("seg.seg.nrrd", "liver+liver tumour", quarter)
    x, y, z = 1e-3 * (MIDDLE + AT)
    np.testing.assert_allclose(body.centre(), np.array([x, -z, y]) + graph.scene["surface"]["position"], atol=2e-4)
    _, body = placed("seg.seg.nrrd", "liver+liver tumour", "scene.surface.position=[0, 10 mm, -200 mm]")
    np.testing.assert_allclose(body.centre(), np.array([x, y, z]) + (0.0, 0.01, -0.2), atol=2e-4)


def test_the_surface_contains_the_tumour_and_is_stiffer_above_it(folder):
    """A tumour that breaks through the surface belongs to the organ; without it a hollow remains."""
    at = np.array([0.0, 0.0, 12.0])
    write_nifti(folder / "seg.nii.gz", *voxels_of(at=at, wide=28.0))
    _, body = placed("seg.nii.gz", "1+2", "tissue.nodule_ratio=8")
    _, without = placed("seg.nii.gz", 1)
    height = np.ptp(body.mesh().vertices[:, 2])
    assert height == pytest.approx(2e-3 * (HALF[2] + 1.0), abs=1.5e-3) and without.nodule_radius == 0.0
    assert height > np.ptp(without.mesh().vertices[:, 2]) + 1e-3
    factor, away = body.hardness(), np.linalg.norm(body.mesh().vertices[:, :2] - body.centre()[:2], axis=1)
    top = body.mesh().vertices[:, 2] > body.centre()[2]
    deep = body.mesh().vertices[:, 2].max() - body.centre()[2]
    flat = stiffness_map([[0.0, 0.0, 0.0]], [[0.0, 0.0, 1.0]], (0.0, 0.0, -deep), 1e-3 * RADIUS, 8.0, 6e-3)[0]
    assert flat > 2.0
    np.testing.assert_allclose(factor[top & (away < 2e-3)], flat, rtol=0.06)
    assert factor[away > 20e-3].max() < 1.1 and away[factor.argmax()] < 4e-3


def test_the_modulus_is_that_of_the_table_and_one_key_changes_it(named):
    graph, body = placed("seg.seg.nrrd", "liver+Liver tumour")
    assert body.nodule_ratio == 4.5
    text = " ".join(graph.notes)
    assert re.search(
        r"label 2 \(Liver tumour\) in 1 \(liver\) is a nodule of radius [56]\.\d+ mm, .* deep, 4\.5 times", text
    )
    assert "assumed: as in the breast, Samani" in text and "--set scene.tissue=liver-human" in text
    _, body = placed("seg.seg.nrrd", "1+2", "tissue.nodule_ratio=2")
    assert body.nodule_ratio == 2.0
    graph, body = placed("seg.seg.nrrd", "1+2", graph="nodule")
    assert graph.scene["nodule"]["nodule_radius"] == pytest.approx(6e-3, rel=0.03) and body.nodule_ratio == 4.5
    _, body = placed("seg.seg.nrrd", "1+2", "scene.tissue=liver-human", "tissue.use=deformation.ReducedFE")
    assert body.young == pytest.approx(6270, rel=0.1) and body.nodule_radius == pytest.approx(6e-3, rel=0.03)


def test_a_list_of_organs_takes_nodules_and_tissues_of_labels(named):
    tissue = {"friction": False, "young": 19e3}
    scene = {"tissue": tissue, "finger": {}, "sliding": {}, "between": {}, "hand": {"begin": [0, 0, 0.12], "path": []}}
    part = {"file": "seg.seg.nrrd", "refine": 0.012}
    mine = {"label": 2, "name": "mine", "tissue": {"young": 3e3}, "position": [0, 0, 1]}
    organs = [{**part, "label": "liver+2", "position": [0, 0, 0]}, {**part, "label": "spleen"}, {**part, **mine}]
    shift = "scene.liver.surface.position=[0, 0, 5 mm]"
    overrides = ["liver.use=deformation.MassSpring", shift]
    graph = load("stack", scene={**scene, "organs": organs}, overrides=overrides)
    body = plan(graph).make("liver")
    np.testing.assert_allclose(body.centre(), 1e-3 * (MIDDLE + AT) + (0, 0, 0.005), atol=2e-4)
    spleen = graph.nodes["spleen"]
    assert spleen.settings["young"] == pytest.approx(3 * 7067, rel=0.07)
    assert graph.nodes["mine"].settings["young"] == 3e3
    assert any(
        "spleen-human-shear-wave, for its label 3 (spleen); `tissue:` changes it" in note for note in graph.notes
    )


def test_a_label_that_is_no_sphere_keeps_its_voxels(folder):
    """Two balls, then a long one: the body is stiffer above all of their voxels, and hardly far from them."""
    voxels, affine = voxels_of()
    points = np.moveaxis(np.indices(voxels.shape), 0, -1) @ affine[:3, :3].T + affine[:3, 3] - MIDDLE
    tumour = np.argwhere(voxels == 2)
    far = tumour - [12, 0, 0]
    voxels[tuple(far[: len(far) // 2].T)] = 2
    write_nifti(folder / "seg.nii.gz", voxels, affine)
    nodule = organ_of({"file": "seg.nii.gz", "label": "1+2"}).labelled().nodule
    assert nodule.sphere.notes[0].startswith("2 separate parts, the largest 67%: each keeps its voxels")
    mesh = organ_mesh("seg.nii.gz")
    found, (text, *_) = nodule.settings(mesh, np.eye(3), np.zeros(3))
    assert "its modulus is not known; set nodule_ratio of the body" in text and "nodule_ratio" not in found
    voxels[voxels == 2] = 1
    voxels[np.linalg.norm((points - AT) / (12.0, 6.0, 6.0), axis=-1) < 1.0] = 2
    write_nifti(folder / "long.nii.gz", voxels, affine)
    nodule = organ_of({"file": "long.nii.gz", "label": "1+2"}).labelled().nodule
    found = re.search(r"about ([\d.]+) x ([\d.]+) x ([\d.]+) mm, no sphere", " ".join(nodule.sphere.notes))
    assert found and np.allclose([float(side) for side in found.groups()], [24, 12, 12], atol=1.2)
    graph, body = placed("long.nii.gz")
    assert any("is a region of" in note for note in graph.notes)
    middle = 0.5 * (body.mesh().vertices.min(axis=0) + body.mesh().vertices.max(axis=0))
    away = 1e3 * (body.mesh().vertices - middle) - AT
    over = (np.abs(away[:, 0]) < 8.0) & (np.abs(away[:, 1]) < 2.0) & (away[:, 2] > 0.0)
    factor = body.hardness()
    assert over.sum() > 3 and factor[over].min() > 1.2
    assert factor[np.linalg.norm(away, axis=1) > 25.0].max() < 1.1
    _, in_scene = placed("long.nii.gz", graph="nodule")  # whose nodule is a part of the scene
    assert in_scene.nodule_shape == body.nodule_shape
    _, round_one = placed("long.nii.gz", "1+2", "tissue.nodule_shape=''")
    assert round_one.hardness()[over].min() < factor[over].min()


def test_bone_is_stiff_and_a_vessel_is_a_soft_cavity(folder):
    voxels, affine = voxels_of(radius=0.0)
    points = np.moveaxis(np.indices(voxels.shape), 0, -1) @ affine[:3, :3].T + affine[:3, 3] - MIDDLE
    voxels[(np.hypot(points[..., 1], points[..., 2] - 6.0) < 5.0) & (np.abs(points[..., 0]) < 16.0)] = 2
    made = {}
    for name in ("femur", "portal vein"):
        write_nrrd(folder / "seg.seg.nrrd", voxels, affine, **NAMES | {"Segment1_Name": name})
        graph, made[name] = placed("seg.seg.nrrd", f"liver+{name}")
        assert any(f"2 ({name}) in 1 (liver) is a region of" in note for note in graph.notes)
    top = made["femur"].mesh().vertices[:, 2].argmax()
    assert made["femur"].nodule_ratio == 1000 and made["portal vein"].nodule_ratio == 0.1
    assert made["femur"].hardness()[top] > 1.3 and made["portal vein"].hardness()[top] < 0.8
    below = made["femur"].mesh().vertices[:, 2].argmin()  # 21 mm from its middle
    assert 1.0 < made["femur"].hardness()[below] < 1.1 and 0.95 < made["portal vein"].hardness()[below] < 1.0


def test_a_nodule_outside_of_the_surface_is_refused(named):
    nodule = organ_of({"file": "seg.seg.nrrd", "label": "1+2"}).labelled().nodule
    with pytest.raises(MeshError, match="mm outside of the organ's surface, expected inside"):
        nodule.settings(organ_mesh("seg.seg.nrrd"), np.eye(3), np.array([0.0, 0.0, 0.05]))


@pytest.mark.parametrize(("label", "words"), [
    ("1+2+3", "expected an organ and one label inside"), ("1+", "expected an organ and one label inside"),
    ("1+liver", "names 1 (liver) twice"), ("liver+stone", "has no label 'stone'; it has 1 (liver)"),
    ("liver+spleen", "does not touch 1 (liver), expected a label inside of it"),
])  # fmt: skip
def test_labels_that_are_no_nodule_are_one_line(named, label, words):
    words_of_call = ["run", "kidney", "--organ", "seg.seg.nrrd", "--label", label, "--no-record", "--no-pictures"]
    found = CliRunner().invoke(app, [*words_of_call, "--set", COARSE])
    assert found.exit_code == 2 and words in unwrapped(found.output), found.output
    scene = {"extends": "stack", "organs": [{"file": "seg.seg.nrrd", "label": label, "refine": 0.012}]}
    with pytest.raises(GraphError, match=re.escape(words)):
        load("stack", scene=scene)


def test_a_single_voxel_is_no_nodule_and_a_repaired_mesh_has_none(folder):
    write_nifti(folder / "seg.nii.gz", *voxels_of(radius=1.2))
    with pytest.raises(MeshError, match="connected voxels, expected at least 8 of a nodule"):
        organ_of({"file": "seg.nii.gz", "label": "1+2"}).as_mesh()
    write_nifti(folder / "seg.nii.gz", *voxels_of())
    found = CliRunner().invoke(app, ["check", "kidney", "--organ", "seg.nii.gz", "--label", "1+2", "--repair"])
    assert found.exit_code == 2 and ("no nodule" in found.output or "No such option" in found.output)


def test_a_label_whose_name_has_a_plus_is_itself(folder):
    names = NAMES | {"Segment0_Name": "liver+2"}
    write_nrrd(folder / "seg.seg.nrrd", *voxels_of(), **names)
    assert stored.store_surface(folder / "seg.seg.nrrd", "liver+2").inside is None


def test_the_picture_of_the_organ_has_the_nodule(named, monkeypatch):
    monkeypatch.setattr("palpate.views.pictures.models.organ.REFINE", 12e-3)
    words = ["picture", "organ", "seg.seg.nrrd", "--label", "1+2", "--json"]
    numbers = json.loads(CliRunner().invoke(app, words).stdout)["organ"]
    np.testing.assert_allclose(numbers["nodule at m"], 1e-3 * (MIDDLE + AT), atol=2e-4)
    whole = 4.0 / 3.0 * np.pi * 1e-9 * HALF.prod()
    assert numbers["nodule radius m"] == pytest.approx(1e-3 * RADIUS, rel=0.03)
    assert numbers["volume m3"] == pytest.approx(whole, rel=0.02) == numbers["volume of the voxels m3"]


def test_labels_are_listed_with_their_tissues(named):
    found = json.loads(CliRunner().invoke(app, ["list", "labels", "seg.seg.nrrd", "--json"]).stdout)
    assert [each["tissue"] for each in found["labels"]] == ["liver-human", None, "spleen-human-shear-wave"]
    assert [each["ratio inside"] for each in found["labels"]] == [None, 4.5, None]
    shown = CliRunner().invoke(app, ["list", "labels", "seg.seg.nrrd"]).stdout
    assert "spleen-human-shear-wave" in shown and "inside: 4.5 x" in shown


def test_the_table_names_published_tissues_with_sources():
    known, _ = tissues()
    assert set(_table()["labels"].values()) <= set(known)
    for line in _table()["inside"]:
        assert line["source"] and 0.0 < line["ratio"] <= 1e6
    assert tissue_of("kidney_left") == tissue_of("Right Kidney (2)") == "kidney-human-45Hz"
    assert (
        tissue_of("gluteus_maximus_left") == "muscle-human-50Hz" and tissue_of("subcutaneous_fat") == "fat-human-50Hz"
    )
    assert (
        tissue_of("liver_vessels")
        is tissue_of("kidney_cyst_left")
        is tissue_of("vertebrae_L1")
        is tissue_of("")
        is None
    )
    cancer = known["prostate-human-cancer"], known["prostate-human"]
    shares = [float(each["parameters"]["young"].removesuffix(" kPa")) for each in cancer]
    assert ratio_of("cancer", "prostate").value == pytest.approx(shares[0] / shares[1], rel=0.02)
    assert ratio_of("tumor", "breast_left").source.startswith("published")
    assert ratio_of("kidney stone", "kidney_left").value == 1000 and ratio_of("portal vein", "liver").value < 1.0
    assert ratio_of("rib_left_4", "liver").value == 1000 and ratio_of("lesion", "liver") is None
