"""Labels of bone next to an organ: where they stiffen the touch, and what is refused."""

import numpy as np
import pytest
from label_files import orientations, write_nifti, write_nrrd
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.launch.load.graph import load
from palpate.launch.load.labelled.table import is_bone
from palpate.launch.load.launchfile import find
from palpate.launch.load.organ_file import organ_of
from palpate.launch.load.plan import plan
from palpate.physics.errors import MeshError
from palpate.physics.segmentation import stored

pytest.importorskip("nibabel")
pytest.importorskip("nrrd")
COARSE = "scene.surface.refine=12 mm"
HALF = np.array([26.0, 21.0, 12.0])  # [mm] half axes of the organ, an ellipsoid
AT = np.array([10.0, 0.0])  # [mm] right and front of the axis of the rib, along the front
NAMES = {"Segment0_Name": "muscle", "Segment0_LabelValue": 1, "Segment1_Name": "rib_left_9", "Segment1_LabelValue": 2,
         "Segment2_Name": "vessel", "Segment2_LabelValue": 3}  # fmt: skip
TURNS = list(orientations())
DEEP = -2.0  # [mm] top of the rib; the organ is above it


def voxels_of(turn=TURNS[0], far=0.0):
    """Voxels (i,j,k) of 1.5 mm: 1 the organ, 2 a rib of 16 mm below its right half, 3 a vessel in it; and their affine
    [mm]."""
    axes = 1.5 * turn
    half = np.abs(np.linalg.inv(axes) @ np.array([30.0, 30.0, 30.0 + far])).astype(int) + 1
    affine = np.eye(4)
    affine[:3, :3], affine[:3, 3] = axes, -axes @ half
    points = np.moveaxis(np.indices(2 * half + 1), 0, -1) @ axes.T + affine[:3, 3]
    voxels = (np.linalg.norm(points / HALF, axis=-1) < 1.0).astype(np.uint8)
    voxels[np.linalg.norm(points - (-5.0, 0.0, 0.0), axis=-1) < 4.0] = 3
    across = points[..., 0] - AT[0], points[..., 2] - (DEEP - far - 8.0)
    voxels[np.hypot(*across) < 8.0] = 2
    return voxels, affine


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(stored, "user_cache", lambda: tmp_path / "cache")
    monkeypatch.setenv("COLUMNS", "400")
    return tmp_path


@pytest.fixture
def named(folder):
    write_nrrd(folder / "seg.seg.nrrd", *voxels_of(), **NAMES)
    return folder


def placed(file, label, *overrides, graph="kidney"):
    launch = find(graph).but(organ=organ_of({"file": file, "label": label}), overrides=(COARSE, *overrides))
    planned = plan(launch.load())
    return planned.graph, planned.make("tissue")


@pytest.mark.parametrize("turn", [1, 13, 30])
def test_the_organ_is_stiffer_above_the_rib_for_any_axes_of_the_file(folder, turn):
    write_nifti(folder / "seg.nii.gz", *voxels_of(TURNS[turn]))
    _, body = placed("seg.nii.gz", "1/2", "scene.surface.rotation=[0, 0, 0.6]")
    assert body.bone_shape and body.nodule_radius == 0.0
    mesh, factor = body.mesh(), body.hardness()
    turned = np.array([np.cos(0.6), np.sin(0.6)])
    # the organ's middle is that of its box only before the rotation
    across = (mesh.vertices - np.array(body.position))[:, :2] @ turned
    top = mesh.normals[:, 2] > 0.7
    along = (mesh.vertices - np.array(body.position))[:, :2] @ np.array([-turned[1], turned[0]])
    above = factor[top & (abs(across - 10.0e-3) < 2e-3) & (abs(along) < 10e-3)]
    assert above.min() > 1.2 and above.max() < 1.45  # finite elements: 1.3
    assert factor[top & (across < -15e-3)].max() < 1.1 and factor.min() >= 1.0


def test_a_part_inside_and_bone_multiply(named):
    _, both = placed("seg.seg.nrrd", "muscle+vessel/rib_left_9")
    _, inside = placed("seg.seg.nrrd", "muscle+vessel")
    _, bone = placed("seg.seg.nrrd", "muscle/2")
    assert inside.hardness().min() < 0.95
    # the surface of the first two encloses the vessel, that of the third has it filled: the same vertices
    np.testing.assert_allclose(both.hardness(), inside.hardness() * bone.hardness(), rtol=1e-9)


def test_bone_next_to_an_organ_is_named_with_the_label_that_makes_it_rigid(named):
    graph, body = placed("seg.seg.nrrd", "muscle")
    text = next(note for note in graph.notes if "without effect" in note)
    assert "2 (rib_left_9) (0 mm); it is rigid with --label muscle/2" in text and "vessel" not in text
    assert body.bone_shape == ""
    graph, body = placed("seg.seg.nrrd", "muscle/2")
    assert any("2 (rib_left_9), 0 mm from 1 (muscle), is rigid" in note for note in graph.notes)
    assert not any("without effect" in note for note in graph.notes)
    again, _ = placed("seg.seg.nrrd", "muscle/2")  # from the store
    assert again.notes == graph.notes and is_bone("rib_left_9") and not is_bone("liver")


def test_reduced_elements_are_fixed_to_the_bone(named):
    from palpate.models.build.basis import build_basis, silent

    overrides = ("tissue.use=deformation.ReducedFE", "tissue.coarse=150", "tissue.walls=0")
    _, body = placed("seg.seg.nrrd", "muscle/2", *overrides)
    _, without = placed("seg.seg.nrrd", "muscle", *overrides)
    assert "bone" in body.inputs() and body.key() != without.key() and "bone_shape" in body.command()
    fixed, free = (build_basis(each, silent, check=False)[0] for each in (body, without))
    ratio = body.stiffness_field(fixed)[0] / without.stiffness_field(free)[0]
    mesh = body.mesh()
    across = mesh.vertices[:, 0] - np.array(body.position)[0]
    top = mesh.normals[:, 2] > 0.7
    assert ratio.min() > 0.95  # of two meshes that are made at random: 0.969 to 1.027 in nine builds
    local = placed("seg.seg.nrrd", "muscle/2")[1].hardness()  # the same law by the energy of a half-space
    middle = top & (abs(across) < 18e-3) & (abs(mesh.vertices[:, 1] - np.array(body.position)[1]) < 3e-3)
    np.testing.assert_allclose(local[middle], ratio[middle], atol=0.06)
    assert np.ptp(ratio[middle]) > 0.2


def test_a_list_of_organs_takes_bone(named):
    tissue = {"friction": False, "young": 19e3}
    scene = {"tissue": tissue, "finger": {}, "sliding": {}, "between": {}, "hand": {"begin": [0, 0, 0.12], "path": []}}
    organs = [{"file": "seg.seg.nrrd", "refine": 0.012, "label": "muscle/rib_left_9"}]
    graph = load("stack", scene={**scene, "organs": organs}, overrides=["muscle.use=deformation.MassSpring"])
    assert plan(graph).make("muscle").hardness().max() > 1.25


@pytest.mark.parametrize(
    ("label", "found"),
    [
        ("muscle/", "expected an organ and one label inside of it, as liver+tumour, or bone next to it"),
        ("muscle/2/3", "or bone next to it"),
        ("/2", "or bone next to it"),
        ("muscle/muscle", "found 1 (muscle) as organ and as its bone, expected different labels"),
        ("muscle/femur", "has no label 'femur'; it has 1 (muscle), 2 (rib_left_9), 3 (vessel)"),
    ],
)
def test_labels_that_are_refused(named, label, found):
    with pytest.raises(MeshError) as error:
        placed("seg.seg.nrrd", label)
    assert found in str(error.value)


def test_bone_that_is_too_far_and_a_file_that_is_none_are_refused(folder):
    write_nrrd(folder / "far.seg.nrrd", *voxels_of(far=80.0), **NAMES)
    done = CliRunner().invoke(app, ["run", "kidney", "--organ", "far.seg.nrrd", "--label", "1/2", "--no-pictures"])
    assert done.exit_code and "2 (rib_left_9) is farther than 64 mm from 1 (muscle)" in done.output
    graph = plan(load("kidney", overrides=["tissue.bone_shape=none.npz"]))
    with pytest.raises(Exception, match=r"setting 'bone_shape': none\.npz: No such file"):
        graph.make("tissue").start()
