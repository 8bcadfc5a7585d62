"""Separate pieces of a mesh: orientation by containment, islands, the choice of one, dialects of STL files."""

import re
import struct

import numpy as np
import pytest

from palpate.nodes.base import SettingError
from palpate.nodes.base.mesh_file import flaws, read_mesh, read_triangles
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.pieces import pieces, winding
from palpate.physics.geometry.topology import outward

trimesh = pytest.importorskip("trimesh")


def ball(radius=40.0, level=2, at=(0.0, 0.0, 0.0), inwards=False):
    mesh = trimesh.creation.icosphere(level, radius)
    mesh.apply_translation(at)
    if inwards:
        mesh.invert()
    return mesh


def saved(folder, *meshes, name="organ.ply"):
    trimesh.util.concatenate(meshes).export(folder / name)
    return str(folder / name)


def volumes(mesh):
    label = pieces(mesh.triangles, len(mesh.vertices))
    corner = np.einsum("ij,ij->i", mesh.face_vectors, mesh.vertices[mesh.triangles[:, 0]]) / 6.0
    return np.bincount(label, corner)


def test_the_winding_number_is_1_inside_and_0_outside():
    mesh = ball()
    for at, expected in (((0, 0, 0), 1.0), ((0, 39, 0), 1.0), ((0, 0, 41), 0.0), ((500, 0, 0), 0.0)):
        assert winding(mesh.vertices, mesh.faces, np.array(at)) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("turned", range(4))
def test_pieces_that_no_other_encloses_are_solid(tmp_path, turned):
    file = saved(tmp_path, ball(40.0, 2, (0, 0, 0), bool(turned & 1)), ball(30.0, 2, (100, 0, 60), bool(turned & 2)))
    assert (volumes(read_mesh(file, 1e-3)) > 0).all()
    assert any("inside out" in line for line in flaws(file)) == bool(turned)


@pytest.mark.parametrize("all_turned", [False, True])
def test_a_cavity_and_a_ball_in_it_keep_their_relative_orientation(tmp_path, all_turned):
    """Random nests: each piece is inside the one before; the file's relative orientations are kept."""
    rng = np.random.default_rng(3)
    for _ in range(10):
        signs = rng.integers(0, 2, 4).astype(bool)
        signs[0] = False
        meshes = [ball(40.0 - 9 * k, 2, (0.3 * k, 0, 0), bool(s) != all_turned) for k, s in enumerate(signs)]
        order = rng.permutation(4)
        whole = trimesh.util.concatenate([meshes[k] for k in order])
        mesh = Mesh(whole.vertices, outward(whole.vertices, whole.faces))
        assert list(volumes(mesh) < 0) == [bool(signs[k]) for k in order]


def test_an_island_is_left_out_with_a_note_and_all_keeps_it(tmp_path):
    """The file of a segmentation has a speck of 1.6 mm 110 mm above the organ."""
    file = saved(tmp_path, ball(40.0, 3), ball(0.8, 1, (0, 0, 110)))
    assert np.ptp(read_triangles(file)[0], axis=0) == pytest.approx([80, 80, 80], rel=1e-4)
    (line,) = flaws(file)
    assert "2 separate pieces" in line and "1 with less than 1%" in line and "--piece all" in line
    assert np.ptp(read_triangles(file, -1)[0], axis=0)[2] == pytest.approx(150.8, rel=1e-4)
    assert np.ptp(read_triangles(file, 2)[0], axis=0)[2] == pytest.approx(1.6, rel=1e-4)
    with pytest.raises(SettingError, match=r"found 3, expected 1 to 2.*2 separate pieces"):
        read_triangles(file, 3)


def test_two_large_pieces_are_both_used_and_a_vessel_is_no_island(tmp_path):
    vessel = trimesh.creation.cylinder(3.0, 150.0)
    vessel.apply_translation((120, 0, 0))
    file = saved(tmp_path, ball(70.0, 3), vessel)
    assert len(volumes(read_mesh(file, 1e-3))) == 2 and "all are used" in flaws(file)[0]


@pytest.mark.parametrize("count", [2, 8, 11])
def test_pieces_are_listed_by_size_and_those_beyond_eight_counted(tmp_path, count):
    file = saved(tmp_path, *(ball(40.0 - 2 * k, 1, (100 * k, 0, 0)) for k in range(count)))
    (line,) = flaws(file)
    assert f"{count} separate pieces (1: " in line and "; 2: " in line and ("8: " in line) == (count >= 8)
    assert re.findall(r"and (\d+) more", line) == (["3"] if count == 11 else [])


@pytest.mark.parametrize("size", [0.05, 50.0])
def test_equal_pieces_near_each_other_are_two_and_nearly_coinciding_ones_are_not(tmp_path, size):
    """One 1000th of the size apart is the limit, in any unit of the file."""
    apart = saved(tmp_path, ball(size, 2), ball(size, 2, (0.01 * size, 0, 0)))
    assert len(read_triangles(apart)[1]) == 2 * len(ball(size, 2).faces)
    with pytest.raises(SettingError, match="lie at the same place"):
        read_triangles(saved(tmp_path, ball(size, 2), ball(size, 2, (1e-3 * size, 0, 0))))


def test_two_surfaces_at_the_same_place_are_refused_with_a_remedy(tmp_path):
    """The same ball with two triangulations."""
    other = ball()
    other.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, (0, 0, 1)))
    file = saved(tmp_path, ball(), other)
    with pytest.raises(SettingError, match=r"pieces 1 and 2 of .* lie at the same place.*--piece 2"):
        read_mesh(file, 1e-3)
    assert (volumes(read_mesh(file, 1e-3, 2)) > 0).all()


BINARY = ball().export(file_type="stl")
TEXT = ball().export(file_type="stl_ascii").encode()


@pytest.mark.parametrize(
    ("content", "note"),
    [
        (BINARY[:80] + struct.pack("<I", 0) + BINARY[84:], "announces 0 triangles; all 320"),
        (BINARY + bytes(7), "7 bytes after the 320 triangles"),
        (BINARY + bytes(120), "120 bytes after the 320 triangles"),
        (TEXT[: TEXT.rindex(b"endsolid")] + b"end solid\n", "its last line is 'end solid'"),
        (TEXT[: TEXT.rindex(b"endsolid")], "its last line is 'endfacet'"),
        (TEXT.upper(), None),
        (TEXT.replace(b"\n", b"\r\n"), None),
        (b"solid by a program".ljust(80) + BINARY[80:], None),
    ],
)
def test_dialects_of_stl_are_read(tmp_path, content, note):
    file = tmp_path / "ball.stl"
    file.write_bytes(content)
    assert read_mesh(str(file), 1e-3).areas.sum() == pytest.approx(1e-6 * ball().area, rel=1e-5)
    assert [note in line for line in flaws(str(file))] == ([True] if note else [])


@pytest.mark.parametrize(
    ("content", "text"),
    [
        (BINARY[:-777], "announces 320 triangles, its .* bytes have room for 304: it is cut off"),
        (TEXT[: len(TEXT) // 2], "cut off or damaged|expected `vertex` and three numbers"),
        (TEXT.replace(b".", b","), "not three numbers with a decimal point"),
        (BINARY[:100], "the shortest STL file"),
        (TEXT.replace(b"\n", b"\r")[:-4000], "cut off"),
        (b"", "contains no triangles: it has 0 bytes. Export it again"),
        (BINARY[:96] + struct.pack("<f", float("nan")) + BINARY[100:], "not a finite number: vertex 1 is"),
    ],
)
def test_what_is_wrong_with_an_stl_file_is_said(tmp_path, content, text):
    file = tmp_path / "ball.stl"
    file.write_bytes(content)
    with pytest.raises(SettingError, match=text) as caught:
        read_mesh(str(file), 1e-3)
    assert "\n" not in str(caught.value) and str(file) in str(caught.value)
