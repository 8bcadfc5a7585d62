"""Left and right, spacing and names of each format, as written by other libraries."""

import numpy as np
import pytest
from label_files import (
    BALLS,
    CENTRE,
    away,
    labels,
    orientations,
    write_dicom,
    write_itk,
    write_nifti,
    write_nrrd,
)

from palpate.physics.segmentation.image import choose_label
from palpate.physics.segmentation.read import read_labels
from palpate.physics.segmentation.surface import label_surface

pytest.importorskip("nibabel")
pytest.importorskip("nrrd")
pytest.importorskip("pydicom")
TURNS = list(orientations())
WRITERS = {
    "nibabel.nii.gz": write_nifti, "nibabel.nii": write_nifti, "lps.nrrd": write_nrrd,
    "ras.nrrd": lambda *given: write_nrrd(*given, space="right-anterior-superior"),
    "las.nrrd": lambda *given: write_nrrd(*given, space="left-anterior-superior", encoding="raw"),
    "itk.nii.gz": write_itk, "itk.nrrd": write_itk, "itk.mha": write_itk,
    "plain.mha": lambda *given: write_itk(*given, packed=False), "seg.dcm": write_dicom,
}  # fmt: skip


def found_at(image, points):
    """Values at points [mm] (n,3) of the body."""
    index = np.rint(np.linalg.solve(image.affine[:, :3], 1e-3 * points.T - image.affine[:, 3:])).astype(int)
    return np.pad(image.layers[0], 30)[tuple(index + 30)]  # a DICOM segmentation has no empty frames


@pytest.mark.parametrize("name", WRITERS)
def test_each_of_the_48_orientations_has_the_balls_where_they_are(tmp_path, name):
    if name.startswith(("itk", "plain")):
        pytest.importorskip("SimpleITK")
    for turn in TURNS:
        voxels, affine = labels(turn)
        WRITERS[name](tmp_path / name, voxels, affine)
        image = read_labels(tmp_path / name)
        np.testing.assert_allclose(sorted(image.spacing), [1e-3, 1.5e-3, 2e-3], rtol=1e-6)
        centres = CENTRE + BALLS[:, :3]
        np.testing.assert_array_equal(found_at(image, centres), 2)
        mirrored = CENTRE - BALLS[1:, :3]
        np.testing.assert_array_equal(found_at(image, mirrored[away(mirrored) > 0]), 0)
        segment = choose_label(image, 2)
        assert image.count(segment) == np.count_nonzero(voxels == 2)
        assert [each.number for each in image.segments] == [2, 5]


@pytest.mark.parametrize("turn", [np.eye(3), np.diag([-1.0, 1, 1]), TURNS[13], TURNS[30]])
def test_the_surface_is_within_half_a_voxel_and_faces_outwards(tmp_path, turn):
    voxels, affine = labels(turn, spacing=(1.0, 1.0, 1.0))
    write_nifti(tmp_path / "a.nii.gz", voxels, affine)
    image = read_labels(tmp_path / "a.nii.gz")
    made = label_surface(image, choose_label(image, "2"))
    assert np.abs(away(1e3 * made.mesh.vertices)).max() < 0.5 * np.sqrt(3)  # half a diagonal, in the grooves
    assert np.sqrt((away(1e3 * made.mesh.vertices) ** 2).mean()) < 0.15
    assert made.mesh.closed and made.enclosed == pytest.approx(made.volume, rel=0.01)
    outwards = made.mesh.vertices + 1e-3 * made.mesh.normals
    assert (away(1e3 * outwards) > away(1e3 * made.mesh.vertices)).all()


def test_names_of_labels_are_read_and_choose_one(tmp_path):
    import nibabel
    import nrrd

    voxels, affine = labels(np.eye(3))
    table = '<CaretExtension><LabelTable><Label Key="2" Red="1"><![CDATA[liver]]></Label></LabelTable></CaretExtension>'
    image = nibabel.Nifti1Image(voxels, affine)
    image.header.extensions.append(nibabel.nifti1.Nifti1Extension(0, table.encode()))
    nibabel.save(image, tmp_path / "a.nii.gz")
    slicer = {"Segment0_Name": "liver", "Segment0_LabelValue": 2, "Segment0_Layer": 0}
    write_nrrd(tmp_path / "a.seg.nrrd", voxels, affine, **slicer)
    write_dicom(tmp_path / "a.dcm", voxels, affine, {2: "liver"})
    for name in ("a.nii.gz", "a.seg.nrrd", "a.dcm"):
        found = read_labels(tmp_path / name)
        assert choose_label(found, "Liver") == choose_label(found, 2), name
    # overlapping segments of 3D Slicer, in layers
    layers = np.stack([voxels // 2, np.full_like(voxels, 0)])
    layers[1, 5:15, 5:15, 5:15] = 1
    directions = np.vstack([np.full(3, np.nan), (np.array([-1, -1, 1])[:, None] * affine[:3, :3]).T])
    nrrd.write(str(tmp_path / "b.seg.nrrd"), layers, {
        "space": "left-posterior-superior", "space directions": directions, "kinds": ["list", *["domain"] * 3],
        "space origin": np.array([-1, -1, 1]) * affine[:3, 3], "encoding": "gzip", "Segment0_Name": "liver",
        "Segment0_LabelValue": "1", "Segment0_Layer": "0", "Segment1_Name": "box", "Segment1_LabelValue": "1",
        "Segment1_Layer": "1",
    })  # fmt: skip
    found = read_labels(tmp_path / "b.seg.nrrd")
    assert [str(each) for each in found.segments] == ["1 (liver)", "2 (box)"]
    assert found.count(choose_label(found, "box")) == 1000
    np.testing.assert_array_equal(found_at(found, CENTRE + BALLS[:, :3]), 1)


def test_segments_of_dicom_that_overlap_keep_all_of_their_voxels(tmp_path):
    import copy

    import pydicom

    voxels, affine = labels(np.eye(3))
    write_dicom(tmp_path / "a.dcm", voxels, affine)
    data = pydicom.dcmread(tmp_path / "a.dcm")
    first = data.SegmentSequence[0]
    again = pydicom.Dataset()
    again.SegmentNumber, again.SegmentLabel = 9, "copy"
    data.SegmentSequence = [first, again]
    half = len(data.PerFrameFunctionalGroupsSequence) // 2
    groups = [g for g in data.PerFrameFunctionalGroupsSequence
              if g.SegmentIdentificationSequence[0].ReferencedSegmentNumber == 2]  # fmt: skip
    frames = data.pixel_array[: len(groups)]
    more = [copy.deepcopy(group) for group in groups]
    for group in more:
        group.SegmentIdentificationSequence[0].ReferencedSegmentNumber = 9
    data.PerFrameFunctionalGroupsSequence, data.NumberOfFrames = groups + more, 2 * len(groups)
    content = pydicom.pixels.pack_bits(np.concatenate([frames, frames]))
    data.PixelData = content + bytes(len(content) % 2)
    data.save_as(tmp_path / "b.dcm")
    found = read_labels(tmp_path / "b.dcm")
    assert half > 1 and len(found.layers) == 2
    assert {found.count(each) for each in found.segments} == {np.count_nonzero(voxels == 2)}
