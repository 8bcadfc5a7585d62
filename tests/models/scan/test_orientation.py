"""A finger is the same however it lay in the scanner and however its images are stored."""

import dataclasses
import itertools
import json
from functools import cache

import numpy as np
import pytest
from pytest import approx

pytest.importorskip("skimage")
pytest.importorskip("pydicom")
pytest.importorskip("nibabel")

import nibabel
import phantom_finger as phantom
import typer
from scan_images import coarse, write_images
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from palpate.cli.commands.fitting.build.fingertip import fingertip
from palpate.models.scan import ScanError, read, rebuild, segment
from palpate.models.scan.rebuild import reconstruct
from palpate.physics.fingertip.anatomy import Anatomy
from palpate.physics.fingertip.beam_bundle import BundleState, step
from palpate.physics.fingertip.surfaces import fill

LARGEST = 1.2 / phantom.FULL
"""One step of the stored values."""


def long_but(short, cases):
    """The cases, marked long except those with the numbers `short`, which include each axis, direction and rotation."""
    return [pytest.param(*case, marks=() if k in short else pytest.mark.long) for k, case in enumerate(cases)]


SIZE = {"pixels": 64, "spacing": (1.2e-3, 0.4e-3, 0.4e-3)}
"""Of images that hold each pixel of the plain ones, in another order; turned by any angle, finer ones are needed."""


@cache
def imaged():
    return phantom.scan(**SIZE)


def forces(tip, angles=(0, 20, 45)):
    """Normal force [N] at rest, 2 mm deep, at some inclinations."""
    normal_forces = []
    for degrees in angles:
        body = fill(tip, 2e-3, pitch=0.6e-3, angle=np.radians(degrees))
        state = BundleState(body)
        for _ in range(30):
            force = step(body, state, 2e-3, (0, 0), 0.7, 1.0)
        normal_forces.append(force[2])
    return np.array(normal_forces)


def thumb_side(tip):
    """Way [m] from the bone to the middle of the skin along x; the phantom's bone lies on the side of +x."""
    inside = np.argwhere(tip.skin < 0)
    return float((tip.origin + tip.spacing * inside)[:, 0].mean())


@pytest.fixture(scope="module")
def plain():
    tip = rebuild(segment(imaged()))
    assert thumb_side(tip) < -0.4e-3
    return forces(tip)


@pytest.fixture(scope="module")
def finely():
    return forces(rebuild(segment(phantom.scan())))


def stored(order, flips, images=imaged):
    """The phantom as an array of other axes and directions, and the direction of each in space (columns, rows, slices).

    In space the phantom's columns, rows and slices run along x, y, z.
    """
    axes = np.eye(3)[::-1][list(order)] * np.array(flips)[:, None]
    whole = images()
    volume = whole.volume.transpose(order)[tuple(slice(None, None, f) for f in flips)]
    return dataclasses.replace(whole, volume=volume, spacing=tuple(whole.spacing[k] for k in order)), axes[::-1]


ALL = [(o, f) for o in itertools.permutations(range(3)) for f in itertools.product((1, -1), repeat=3)]


def same_up_to_a_turn(volume, whole):
    """Whether a volume is the phantom's seen from another side, but not its mirror image: which of the four turns that
    keep slices across the finger, with slices from either end, it is."""
    sides = [
        np.rot90(end, k, axes=(1, 2)) for end in (whole.volume, whole.volume[::-1, :, ::-1]) for k in range(4)
    ]  # fmt: skip
    wanted = [np.clip(side, 0, 1.2) for side in sides]
    return [w.shape == volume.shape and np.abs(w - volume * LARGEST).max() < LARGEST for w in wanted]


@pytest.mark.parametrize(("order", "flips"), long_but([0, 5, 10, 15, 20, 25, 30, 35, 40, 45], ALL))
def test_every_order_and_direction_of_the_axes_of_nifti_gives_the_same_finger(tmp_path, order, flips):
    """nibabel turns the array and its affine; what is read is the phantom, turned but never mirrored."""
    image = nibabel.load(phantom.write_nifti(coarse(), tmp_path / "v.nii"))
    turned = image.as_reoriented(np.column_stack([order, flips]))
    nibabel.save(turned, tmp_path / "turned.nii")
    stack = read(tmp_path / "turned.nii")
    assert sum(same_up_to_a_turn(stack.volume, coarse())) == 1
    assert stack.spacing == approx(coarse().spacing) and stack.handed == "header"


@pytest.mark.parametrize(("order", "flips"), long_but([3], [ALL[k] for k in (5, 11, 18, 29, 36, 47)]))
def test_the_forces_are_those_of_the_finger_however_nifti_stores_it(tmp_path, plain, order, flips):
    image = nibabel.load(phantom.write_nifti(imaged(), tmp_path / "v.nii"))
    turn = np.eye(4)
    turn[:3, :3] = Rotation.from_euler("xyz", [0.3, -0.4, 0.9]).as_matrix()
    oblique = nibabel.Nifti1Image(np.asanyarray(image.dataobj), turn @ image.affine, image.header)
    nibabel.save(oblique.as_reoriented(np.column_stack([order, flips])), tmp_path / "turned.nii")
    tip = rebuild(segment(read(tmp_path / "turned.nii")))
    assert forces(tip) == approx(plain, rel=0.04) and thumb_side(tip) < -0.4e-3


@pytest.mark.parametrize(("order", "flips"), [ALL[k] for k in (0, 3, 7, 9, 14, 20, 26, 33, 41, 46)])
@pytest.mark.parametrize("oblique", [False, True])
def test_every_orientation_of_dicom_gives_the_same_finger(tmp_path, order, flips, oblique):
    stack, axes = stored(order, flips, coarse)
    turn = Rotation.from_euler("zyx", [0.5, 0.2, -0.7]).as_matrix() if oblique else np.eye(3)
    copy = read(phantom.write_dicom(stack, tmp_path / "d", axes @ turn.T))
    assert sum(same_up_to_a_turn(copy.volume, coarse())) == 1 and copy.handed == "header"


def test_a_finger_turned_half_round_its_vertical_is_not_mirrored(plain):
    """Slices from the other end: the tip is in the last slice, left and right change places."""
    turned = dataclasses.replace(imaged(), volume=imaged().volume[::-1, :, ::-1])
    tip = rebuild(segment(turned))
    assert forces(tip) == approx(plain, rel=0.04) and thumb_side(tip) < -0.4e-3
    assert thumb_side(rebuild(segment(dataclasses.replace(imaged(), volume=imaged().volume[:, ::-1, ::-1])))) < -0.4e-3


def test_a_mirror_image_is_the_finger_of_the_other_hand(plain):
    tip = rebuild(segment(dataclasses.replace(imaged(), volume=imaged().volume[:, :, ::-1])))
    assert thumb_side(tip) > 0.4e-3
    other = rebuild(segment(phantom.scan(Anatomy(bone_shift=-Anatomy().bone_shift), **SIZE)))
    assert forces(tip) == approx(forces(other), rel=0.05)


TURNS = [
    {"roll": 10}, {"roll": -20}, {"roll": 30}, {"roll": 90}, {"tilt": 8}, {"tilt": 15}, {"tilt": -12}, {"lean": 15},
    {"roll": 25, "tilt": 10, "lean": -8}, {"roll": 170, "tilt": -12},
]  # fmt: skip


@pytest.mark.parametrize("turn", long_but([3, 8], [(turn,) for turn in TURNS]), ids=str)
def test_a_finger_that_lay_rolled_or_tilted_has_the_same_forces(finely, turn):
    tip, frame = reconstruct(segment(phantom.scan(**{name: np.radians(angle) for name, angle in turn.items()})))
    assert forces(tip) == approx(finely, rel=0.05)
    tilt = np.degrees(np.arccos(np.prod([np.cos(np.radians(turn.get(k, 0))) for k in ("tilt", "lean")])))
    assert np.degrees(frame.tilt) == approx(tilt, abs=0.4)
    if set(turn) == {"roll"}:
        assert np.degrees(frame.roll) == approx(turn["roll"], abs=0.3)


# --- images without a header -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("axes", "order", "flips"),
    long_but([1, 4], [
        ("HPR", (0, 1, 2), (1, 1, 1)), ("TPR", (0, 1, 2), (-1, 1, 1)), ("HNR", (0, 1, 2), (1, -1, 1)),
        ("HRP", (0, 2, 1), (1, 1, 1)), ("HLN", (0, 2, 1), (1, -1, -1)),
    ]),
)  # fmt: skip
def test_letters_define_the_direction_of_images(tmp_path, plain, axes, order, flips):
    stack, _ = stored(order, flips)
    tip = rebuild(segment(read(write_images(stack, tmp_path / "i.nii"), axes=axes)))
    assert forces(tip) == approx(plain, rel=0.04) and thumb_side(tip) < -0.4e-3


@pytest.mark.parametrize(("axes", "order", "flips"), [("RPH", (2, 1, 0), (1, 1, 1)), ("PTL", (1, 0, 2), (1, -1, -1))])
def test_images_along_the_finger_become_cross_sections(tmp_path, axes, order, flips):
    stack, _ = stored(order, flips, coarse)
    for given in (axes, ""):
        copy = read(write_images(stack, tmp_path / f"i{given}.nii"), axes=given)
        assert copy.spacing[0] == coarse().spacing[0] and (
            given == "" or sum(same_up_to_a_turn(copy.volume, coarse())) == 1
        )


@pytest.mark.parametrize("axes", ["HP", "HPX", "HHP", "HTP", "NPR", "HPRL"])
def test_letters_that_name_no_axes_are_errors(tmp_path, axes):
    file = write_images(coarse(), tmp_path / "i.nii")
    with pytest.raises(ScanError, match="expected a letter each of T or H, N or P, R or L"):
        read(file, axes=axes)


def test_letters_against_the_images_are_refused(tmp_path):
    file = write_images(imaged(), tmp_path / "i.nii")
    with pytest.raises(ScanError, match="put the tip at the end of the stack where the finger is broader"):
        rebuild(segment(read(file, axes="TPR")))
    with pytest.raises(ScanError, match="narrow side"):
        rebuild(segment(read(file, axes="HRP")))


# --- what a header may get wrong --------------------------------------------------------------------------------------


def test_slices_that_are_not_square_to_their_order_are_refused(tmp_path):
    axes = np.eye(3)
    axes[2] = (0.0, np.sin(0.2), np.cos(0.2))
    with pytest.raises(ScanError, match="not perpendicular"):
        read(phantom.write_dicom(coarse(), tmp_path / "d", axes))
    image = nibabel.load(phantom.write_nifti(coarse(), tmp_path / "v.nii"))
    sheared = image.affine.copy()
    sheared[0, 2] += 0.3
    nibabel.save(nibabel.Nifti1Image(np.asanyarray(image.dataobj), sheared), tmp_path / "s.nii")
    with pytest.raises(ScanError, match="not orthogonal"):
        read(tmp_path / "s.nii")


def rewritten(folder, **fields):
    import pydicom

    for file in folder.iterdir():
        one = pydicom.dcmread(file)
        if fields.get("PhotometricInterpretation") == "MONOCHROME1":
            one.PixelData = (phantom.FULL - one.pixel_array).astype(np.uint16).tobytes()
        for name, value in fields.items():
            setattr(one, name, value)
        one.save_as(file)
    return folder


def test_dicom_whose_small_values_are_bright_is_the_same_finger(tmp_path):
    usual = read(phantom.write_dicom(imaged(), tmp_path / "a"))
    other = read(rewritten(phantom.write_dicom(imaged(), tmp_path / "b"), PhotometricInterpretation="MONOCHROME1"))
    moved = other.volume - usual.volume
    assert np.ptp(moved) == 0 and len(fill(rebuild(segment(other)), 2e-3).heights) > 60


def test_dicom_in_colours_is_an_error(tmp_path):
    folder = rewritten(phantom.write_dicom(coarse(), tmp_path / "a"), PhotometricInterpretation="PALETTE COLOR")
    with pytest.raises(ScanError, match="PALETTE COLOR, expected grey ones"):
        read(folder)


def test_nifti_without_spatial_metadata_is_read_as_a_plain_stack(tmp_path):
    assert read(write_images(coarse(), tmp_path / "n.nii")).handed == "assumed"


def test_the_command_reports_the_orientation_and_whether_left_and_right_are_known(tmp_path):
    app = typer.Typer()
    app.command()(fingertip)
    file = write_images(phantom.scan(**SIZE, tilt=np.radians(10)), tmp_path / "i.nii")
    printed = {}
    for axes in ("", "hpr"):
        options = ["-o", str(tmp_path / "f.npz"), "--json", "--axes", axes]
        result = CliRunner().invoke(app, [str(file), *options])
        assert result.exit_code == 0, result.output
        printed[axes] = json.loads(result.output)
        assert printed[axes]["tilt_deg"] == approx(10, abs=1)
    assert printed[""]["left_and_right"].startswith("unknown") and printed["hpr"]["left_and_right"] == "as stated"
