"""Files that cannot be an organ: the error has what was found, what was expected and what would work, in one line."""

import gzip

import numpy as np
import pytest
from label_files import labels, write_dicom, write_itk, write_nifti, write_nrrd

from palpate.physics.errors import MeshError
from palpate.physics.segmentation.image import choose_label
from palpate.physics.segmentation.read import read_labels
from palpate.physics.segmentation.surface import label_surface

pytest.importorskip("nibabel")
pytest.importorskip("nrrd")
VOXELS, AFFINE = labels(np.eye(3))
GREY = np.random.default_rng(1).integers(0, 200, VOXELS.shape, np.uint8)


def nifti(path, voxels=VOXELS, affine=AFFINE):
    write_nifti(path, voxels, affine)


def changed(name, old, new):
    """A MetaImage or NRRD file with another text in its header."""

    def write(path):
        if name == "mha":
            write_itk(path, VOXELS, AFFINE)
        else:
            write_nrrd(path, VOXELS, AFFINE)
        content = path.read_bytes()
        assert old in content
        path.write_bytes(content.replace(old, new))

    return write


def cut(write, name):
    def short(path):
        write(path)
        content = path.read_bytes()
        path.write_bytes(content[: int(0.7 * len(content))])

    return short, name


def unspaced(path):
    import nibabel

    image = nibabel.Nifti1Image(VOXELS, None)
    image.header["pixdim"][1:4] = 0
    image.header["sform_code"] = image.header["qform_code"] = 0
    nibabel.save(image, path)
    content = bytearray(gzip.decompress(path.read_bytes()))
    content[80:92] = bytes(12)  # nibabel repairs it
    path.write_bytes(gzip.compress(bytes(content)))


def sheared(path):
    affine = AFFINE.copy()
    affine[0, 2] += 0.5
    nifti(path, affine=affine)


FILES = [
    ("grey.nii.gz", lambda p: nifti(p, GREY), r"200 values, and \d+% of its neighbouring voxels differ: grey values"),
    ("ct.nii.gz", lambda p: nifti(p, GREY.astype(np.int16) - 100), "voxels from -100 to .*grey values or a map"),
    ("map.nii.gz", lambda p: nifti(p, (VOXELS / 3).astype(np.float32)), r"a voxel of 1.66667: .*> 0.5"),
    ("nan.nii.gz", lambda p: nifti(p, np.where(VOXELS == 2, np.nan, 0)), "voxels from nan to nan"),
    ("large.nii.gz", lambda p: nifti(p, VOXELS.astype(np.int32) * 40000), "voxels from 0 to 200000"),
    ("four.nii.gz", lambda p: nifti(p, np.stack([VOXELS, VOXELS], -1)), "4 dimensions, expected one volume of three"),
    ("unspaced.nii.gz", unspaced, "no spacing of its voxels"),
    ("sheared.nii.gz", sheared, "not at right angles"),
    ("text.nii.gz", lambda p: p.write_bytes(b"hello"), "not a readable segmentation"),
    ("text.nii", lambda p: p.write_bytes(b"hello"), "does not begin with the size of a NIfTI header"),
    ("text.nrrd", lambda p: p.write_bytes(b"hello"), "does not begin with a line NRRD"),
    ("text.mha", lambda p: p.write_bytes(b"hello"), "cut off or no MetaImage"),
    ("text.dcm", lambda p: p.write_bytes(b"hello"), "not a readable segmentation"),
    ("none.mha", lambda p: None, "No such file"),
    ("folder.nrrd", lambda p: p.mkdir(), "a folder, expected a file"),
    ("spacing.mha", changed("mha", b"ElementSpacing", b"ElementSpicing"), "no spacing of its voxels. .*ElementSpacing"),
    ("other.mha", changed("mha", b"ElementDataFile = LOCAL", b"ElementDataFile = x.raw"), "in another file"),
    ("matrix.mha", changed("mha", b"TransformMatrix = ", b"TransformMatrix = x"), "TransformMatrix is 'x"),
    ("kind.mha", changed("mha", b"MET_UCHAR", b"MET_OTHER"), "ElementType is MET_OTHER"),
    ("spacing.nrrd", changed("nrrd", b"space directions", b"spaced direction"), "no spacing of its voxels"),
    ("encoding.nrrd", changed("nrrd", b"encoding: gzip", b"encoding: text"), "encoding is text, expected raw or gzip"),
    ("empty.nii.gz", lambda p: nifti(p, np.zeros_like(VOXELS)), "all voxels are 0"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "write", "text"), FILES, ids=[each[0] for each in FILES])
def test_a_file_that_is_no_segmentation_says_why(tmp_path, name, write, text):
    if name.endswith(".mha"):
        pytest.importorskip("SimpleITK")
    write(tmp_path / name)
    with pytest.raises(MeshError, match=text) as found:
        choose_label(read_labels(tmp_path / name), 2)
    assert "\n" not in str(found.value) and name in str(found.value) and len(str(found.value)) < 500


@pytest.mark.parametrize("name", ["a.nii.gz", "a.nii", "a.nrrd", "a.mha", "b.mha", "a.dcm"])
def test_a_file_cut_off_anywhere_is_refused(tmp_path, name):
    """160 lengths for each format."""
    path = tmp_path / name
    if name.endswith(".mha"):
        pytest.importorskip("SimpleITK")
        write_itk(path, VOXELS, AFFINE, packed=name == "a.mha")
    else:
        {"nii": nifti, "gz": nifti, "nrrd": lambda p: write_nrrd(p, VOXELS, AFFINE),
         "dcm": lambda p: write_dicom(p, VOXELS, AFFINE)}[name.split(".")[-1]](path)  # fmt: skip
    content = path.read_bytes()
    whole = read_labels(path).layers
    ends = np.linspace(0, len(content) - 1, 160).astype(int)
    for end in ends:
        path.write_bytes(content[:end])
        try:
            found = read_labels(path).layers
        except MeshError as error:
            assert "\n" not in str(error)
        else:  # all voxels are complete: only a checksum or padding is missing
            assert end > len(content) - 16 and np.array_equal(found, whole)


@pytest.mark.parametrize(
    ("label", "text"),
    [
        (None, r"has 2 labels: 2, 5. Choose one with --label"),
        (3, r"has no label '3'; it has 2, 5"),
        ("liver", r"has no label 'liver'; it has 2, 5"),
        (5, "the label 5 has 6 voxels, expected at least 27"),
    ],
)
def test_a_label_that_cannot_be_used_lists_those_that_exist(tmp_path, label, text):
    nifti(tmp_path / "a.nii.gz")
    with pytest.raises(MeshError, match=text):
        image = read_labels(tmp_path / "a.nii.gz")
        label_surface(image, choose_label(image, label))


def test_damaged_headers_never_end_in_another_exception(tmp_path):
    """400 files for each of three formats, with one to four random bytes in the first 400 replaced."""
    rng = np.random.default_rng(3)
    for name, write in (("a.nii", nifti), ("a.nrrd", lambda p: write_nrrd(p, VOXELS, AFFINE)), ("a.dcm", lambda p: (
        write_dicom(p, VOXELS, AFFINE)))):  # fmt: skip
        path = tmp_path / name
        write(path)
        content = path.read_bytes()
        for _ in range(400):
            damaged = bytearray(content)
            for at in rng.integers(0, 400, rng.integers(1, 5)):
                damaged[at] = rng.integers(256)
            path.write_bytes(bytes(damaged))
            try:
                read_labels(path)
            except MeshError as error:
                assert "\n" not in str(error)
