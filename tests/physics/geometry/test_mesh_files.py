"""Mesh files of users: formats, units, and unusable files."""

import os
import sys

import numpy as np
import pytest
import scipy

from palpate.launch.testing import FakeBus
from palpate.messages import Pose
from palpate.nodes.base import SettingError
from palpate.nodes.base import surface as surfaces
from palpate.nodes.base.mesh_file import flaws
from palpate.nodes.base.surface import surface_mesh
from palpate.nodes.collision import Mesh as MeshNode
from palpate.nodes.collision import Nurbs
from palpate.physics.geometry.kidney import kidney
from palpate.physics.geometry.mesh import Mesh, plane, write_ply
from palpate.physics.geometry.tessellate import tessellate
from palpate.physics.geometry.topology import edge_counts

trimesh = pytest.importorskip("trimesh")

KIDNEY = tessellate(kidney(), 600)


@pytest.fixture(autouse=True)
def fresh():
    """Clear the cache of meshes, because files change between tests."""
    surfaces.surface_mesh.cache_clear()


def save(path, mesh=KIDNEY, scale=1.0, **how):
    trimesh.Trimesh(mesh.vertices * scale, mesh.triangles, process=False).export(path, **how)
    return str(path)


def volume(mesh):
    a, b, c = (mesh.vertices[mesh.triangles[:, i]] for i in range(3))
    return np.einsum("ij,ij->", a, np.cross(b, c)) / 6


@pytest.mark.parametrize(
    ("name", "how"),
    [
        ("k.stl", {"file_type": "stl"}),
        ("k.STL", {"file_type": "stl_ascii"}),
        ("k.ply", {"encoding": "binary"}),
        ("k2.ply", {"encoding": "ascii"}),
        ("k.obj", {}),
    ],
)
@pytest.mark.parametrize(("unit", "scale"), [("mm", 1e3), ("m", 1.0), ("cm", 1e2)])
def test_every_format_and_unit_gives_the_same_closed_mesh(tmp_path, name, how, unit, scale):
    file = save(tmp_path / name, scale=scale, **how)
    mesh = surface_mesh(file, 0, file_unit=unit)
    assert mesh.vertices.shape == KIDNEY.vertices.shape
    assert mesh.triangles.shape == KIDNEY.triangles.shape
    assert volume(mesh) == pytest.approx(volume(KIDNEY), rel=1e-4)
    np.testing.assert_allclose(np.ptp(mesh.vertices, axis=0), np.ptp(KIDNEY.vertices, axis=0), atol=1e-6)


def test_ply_files_of_palpate_are_read_exactly(tmp_path):
    write_ply(tmp_path / "k.ply", KIDNEY)
    np.testing.assert_array_equal(surface_mesh(str(tmp_path / "k.ply"), 0).vertices, KIDNEY.vertices)


def test_a_mesh_that_is_inside_out_is_inverted(tmp_path):
    some = KIDNEY.triangles.copy()
    some[::3] = some[::3, ::-1]
    for triangles in (KIDNEY.triangles[:, ::-1], some):
        surfaces.surface_mesh.cache_clear()
        mesh = surface_mesh(save(tmp_path / "k.obj", Mesh(KIDNEY.vertices, triangles)), 0)
        assert volume(mesh) == pytest.approx(volume(KIDNEY), rel=1e-6)


def test_repeated_and_empty_triangles_and_unused_vertices_are_removed(tmp_path):
    v = np.concatenate([KIDNEY.vertices, [[0.0, 0, 0.3]]])
    t = np.concatenate([KIDNEY.triangles, KIDNEY.triangles[:5], [[1, 1, 2]]])
    mesh = surface_mesh(save(tmp_path / "k.obj", Mesh(v, t)), 0)
    assert mesh.vertices.shape == KIDNEY.vertices.shape and mesh.triangles.shape == KIDNEY.triangles.shape


def test_the_collision_node_reads_a_file_at_its_pose(tmp_path):
    file = save(tmp_path / "k.stl", scale=1e3)
    bus = FakeBus(MeshNode(surface=file, file_unit="mm", position=(0.01, 0, 0.05), rotation=(0, 0, np.pi / 2)))
    (proximity,) = bus.publish(Pose(position=(0.01, 0, 0.08), velocity=(0, 0, 0), dt=1e-3))
    assert proximity.gap == pytest.approx(0.009, abs=3e-4)
    assert proximity.normal[2] > 0.99


@pytest.mark.parametrize(
    ("name", "content", "text"),
    [
        ("gone.stl", None, "no file"),
        ("k.step", b"ISO-10303-21;", r"format '.step'"),
        ("k.stl", b"", "stl"),
        ("k.stl", b"solid\nfacet nonsense\n" * 20, "stl"),
        ("k.stl", bytes(range(256)) * 3, "stl"),
        ("k.ply", b"ply\nformat ascii 1.0\nelement vertex 3\n", "ply"),
        ("k.ply", b"not a ply file", "ply"),
        ("k.obj", b"# empty\n", "obj"),
        ("k.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\n", "obj"),
        ("k.obj", b"v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nf 1 1 2\n", "point or a line"),
        ("k.obj", b"v 0 0 0\nv nan 0 0\nv 0 0.1 0\nf 1 2 3\n", "finite"),
        ("k.obj", b"v 0 0 0\nv 100 0 0\nv 0 60 0\nf 1 2 3\n", "file_unit: mm"),
        ("k.obj", b"v 0 0 0\nv 1e-5 0 0\nv 0 1e-5 0\nf 1 2 3\n", "file_unit"),
        (
            "k.obj",
            b"v 0 0 0\nv .1 0 0\nv 0 .1 0\nv 0 0 .1\nv 0 -.1 0\nf 1 2 3\nf 1 2 4\nf 1 2 5\n",
            "1 edge that more than two",
        ),
    ],
)
def test_an_unusable_file_is_an_error_of_one_line(tmp_path, name, content, text):
    file = tmp_path / name
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(SettingError, match=text) as caught:
        surface_mesh(str(file), 0)
    assert "\n" not in str(caught.value)
    assert name in str(caught.value)


@pytest.mark.parametrize(
    ("name", "given", "text"),
    [
        ("k.stl", "ply", "content is that of a .ply file. Rename it to k.ply"),
        ("k.ply", "stl", "content is that of a .stl file. Rename it to k.stl"),
        ("k.obj", "stl", "content is that of a .stl file. Rename it to k.stl"),
        ("k.stl", "glb", "content is that of a .glb file. Export it again, as a binary STL"),
        ("k.off", "off", "format '.off', expected one of .stl, .ply, .obj, or as --organ a segmentation"),
    ],
)
def test_a_file_with_another_format_than_its_name_says_is_refused_with_that_format(tmp_path, name, given, text):
    (tmp_path / name).write_bytes(save_as(given))
    with pytest.raises(SettingError, match=text) as caught:
        surface_mesh(str(tmp_path / name), 0)
    assert name in str(caught.value) and "\n" not in str(caught.value)


def save_as(ending):
    made = trimesh.Trimesh(KIDNEY.vertices, KIDNEY.triangles, process=False).export(file_type=ending)
    return made.encode() if isinstance(made, str) else made


def test_a_folder_is_not_reported_as_a_missing_file(tmp_path):
    (tmp_path / "k.stl").mkdir()
    with pytest.raises(SettingError, match=r"k\.stl is a folder, expected a mesh file"):
        surface_mesh(str(tmp_path / "k.stl"), 0)


@pytest.mark.parametrize("reverse", [1, -1])
def test_two_copies_of_a_surface_are_one_and_are_reported(tmp_path, reverse):
    t = np.concatenate([KIDNEY.triangles, KIDNEY.triangles[:, ::reverse] + len(KIDNEY.vertices)])
    file = save(tmp_path / "k.stl", Mesh(np.concatenate([KIDNEY.vertices] * 2), t))
    assert volume(surface_mesh(file, 0)) == pytest.approx(volume(KIDNEY), rel=1e-5)
    (line,) = flaws(file)
    assert f"{len(KIDNEY.triangles)} of its {2 * len(KIDNEY.triangles)} triangles repeat another one" in line


def test_coordinates_that_are_rounded_far_from_the_origin_are_reported(tmp_path):
    far = Mesh(KIDNEY.vertices * 1e3 + (1e6, 0, 0), KIDNEY.triangles)  # mm; a step of 1/16 mm
    (line,) = flaws(save(tmp_path / "k.stl", far))
    assert "rounded to steps of 0.062, in its unit" in line
    assert flaws(save(tmp_path / "near.stl", Mesh(far.vertices - (1e6 - 1e4, 0, 0), far.triangles))) == []


def test_a_one_sided_surface_is_refused(tmp_path):
    turn = np.linspace(0.0, 2 * np.pi, 60, endpoint=False)
    sides = [50 + s * np.cos(turn / 2) for s in (-10, 10)]
    rims = [np.stack([r * np.cos(turn), r * np.sin(turn), s * np.sin(turn / 2)], 1)
            for r, s in zip(sides, (-10, 10), strict=True)]  # fmt: skip
    i = np.arange(60)
    one, two = np.append(i[1:], 60), np.append(i[1:] + 60, 0)  # the strip is joined with half a turn
    triangles = np.concatenate([np.stack([i, one, two], 1), np.stack([i, two, i + 60], 1)])
    with pytest.raises(SettingError, match="is one-sided, like a Möbius strip"):
        surface_mesh(save(tmp_path / "k.stl", Mesh(np.concatenate(rims), triangles)), 0, file_unit="mm")


def test_unknown_units_and_surfaces_are_errors(tmp_path):
    with pytest.raises(SettingError, match=r"'furlong' is unknown; expected a length, such as mm"):
        surface_mesh(save(tmp_path / "k.stl"), 0, file_unit="furlong")
    with pytest.raises(SettingError, match="a force; expected a length"):
        surface_mesh(save(tmp_path / "k.stl"), 0, file_unit="N")
    with pytest.raises(SettingError, match=r"'liver'.*kidney, sphere, plane"):
        surface_mesh("liver", 100)
    with pytest.raises(SettingError, match=r"mesh file.*collision\.Mesh"):
        Nurbs(surface="k.stl").start()


def test_no_library_is_imported_to_read_a_mesh_or_to_refuse_another_file(tmp_path, monkeypatch):
    """Those of the extra `mesh` take 0.2 s to import; only a concave polygon needs one."""
    for name in ("trimesh", "meshio", "manifold3d"):
        monkeypatch.setitem(sys.modules, name, None)
    assert len(surface_mesh(save(tmp_path / "k.stl"), 0).triangles)
    for name in ("text.stl", "text.ply", "text.obj", "text.off"):
        (tmp_path / name).write_text("this is not an organ\n")
        with pytest.raises(SettingError, match=name):
            surface_mesh(str(tmp_path / name), 0)


def upper(part=0.4):
    """The kidney without its underside: closed except for a hole at this fraction of its height."""
    z = KIDNEY.vertices[KIDNEY.triangles].mean(axis=1)[:, 2]
    return KIDNEY.triangles[z > z.min() + part * np.ptp(z)]


@pytest.mark.parametrize("part", [0.1, 0.3, 0.5])
@pytest.mark.parametrize("turn", [(0, 0, 0), (2.0, -1.0, 0.7)])
def test_an_open_mesh_that_is_inside_out_is_inverted_and_reported(tmp_path, part, turn):
    """The position of the hole does not matter."""
    rotated = scipy.spatial.transform.Rotation.from_rotvec(turn).apply(KIDNEY.vertices) + (0.3, -0.2, 1.0)
    right = surface_mesh(save(tmp_path / "k.obj", Mesh(rotated, upper(part))), 0)
    assert not any("inside out" in line for line in flaws(str(tmp_path / "k.obj")))
    out = np.einsum("ij,ij->i", right.face_vectors, right.vertices[right.triangles].mean(axis=1) - rotated.mean(axis=0))
    assert (out > 0).mean() > 0.95
    half = upper(part).copy()
    half[::3] = half[::3, ::-1]
    for triangles, text in ((upper(part)[:, ::-1], "inside out: all"), (half[:, ::-1], "partly inside out")):
        mesh = surface_mesh(save(tmp_path / "k.obj", Mesh(rotated, triangles)), 0)
        np.testing.assert_allclose(mesh.face_vectors, right.face_vectors, atol=1e-12)
        assert any(text in line for line in flaws(str(tmp_path / "k.obj")))


def test_the_force_on_an_open_mesh_does_not_depend_on_its_orientation(tmp_path):
    gaps = []
    for k, triangles in enumerate((upper(), upper()[:, ::-1])):
        node = MeshNode(surface=save(tmp_path / f"{k}.ply", Mesh(KIDNEY.vertices, triangles)), position=(0, 0, 0))
        path = [Pose(position=(0, 0, z), velocity=(0, 0, 0), dt=1e-3) for z in np.linspace(0.03, 0.015, 50)]
        gaps.append([(answer.gap, answer.normal) for answer in FakeBus(node).publish(*path)])
    assert gaps[0] == gaps[1] and gaps[0][-1][0] == pytest.approx(-6e-3, abs=3e-4)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_vertices_that_differ_by_rounding_are_merged_and_reported(tmp_path, scale):
    """Each triangle at the pole of an ellipsoid has a separate pole vertex, different by 1e-14 of the size."""
    ball = trimesh.creation.uv_sphere(radius=1.0, count=[16, 16])
    v, t = np.array(ball.vertices) * (0.06, 0.04, 0.02), np.array(ball.faces)
    pole = int(v[:, 2].argmax())
    at = np.argwhere(t == pole)
    more = v[pole] + 1e-14 * np.random.default_rng(0).normal(size=(len(at), 3))
    t[tuple(at.T)] = len(v) + np.arange(len(at))
    mesh = Mesh(np.concatenate([v, more]) * scale, t)
    file = save(tmp_path / "e.obj", mesh, digits=17)
    unit = {1e-3: "m", 1.0: "m", 1e3: "mm"}[scale]
    if scale == 1e-3:
        with pytest.raises(SettingError, match="file_unit"):  # 0.1 mm across
            surface_mesh(file, 0, file_unit=unit)
        return
    found = surface_mesh(file, 0, file_unit=unit)
    assert edge_counts(found.triangles, len(found.vertices)) == (0, 0)
    assert len(found.vertices) == len(v)
    (line,) = flaws(file)
    assert f"{len(at) - 1} vertices at open edges are merged with one within 1e-06 of its longest side" in line


def test_a_slit_wider_than_the_tolerance_is_kept(tmp_path):
    sheet = plane(0.1, 100)
    left = sheet.triangles[sheet.vertices[sheet.triangles].mean(axis=1)[:, 0] < 0]
    right = sheet.triangles[sheet.vertices[sheet.triangles].mean(axis=1)[:, 0] > 0] + len(sheet.vertices)
    for slit in (5e-8, 5e-7):  # of 0.1 m
        both = np.concatenate([sheet.vertices, sheet.vertices + (slit, 0, 0)])
        save(tmp_path / "s.obj", Mesh(both, np.concatenate([left, right])), digits=12)
        mesh = surface_mesh(str(tmp_path / "s.obj"), 0)
        assert (edge_counts(mesh.triangles, len(mesh.vertices))[0] == 36) == (slit < 1e-7)


def test_a_rewritten_file_is_read_again(tmp_path):
    """Also with the same size, name and time stamp; unchanged files are not read again."""
    file = save(tmp_path / "k.stl")
    stamp = (tmp_path / "k.stl").stat()
    first = surface_mesh(file, 0)
    save(tmp_path / "k.stl", scale=2.0)
    os.utime(file, ns=(stamp.st_atime_ns, stamp.st_mtime_ns))
    assert (tmp_path / "k.stl").stat().st_size == stamp.st_size
    second = surface_mesh(file, 0)
    assert np.ptp(second.vertices, axis=0) == pytest.approx(2.0 * np.ptp(first.vertices, axis=0), rel=1e-6)
    assert surface_mesh(file, 0) is second
    save(tmp_path / "k.stl")
    assert surface_mesh(file, 0) is first


def test_a_file_that_is_too_large_is_rejected_without_reading(tmp_path, monkeypatch):
    """The test uses a sparse file; a digest would take 10 s per GB."""

    def read(*_):
        raise AssertionError("the file is read")

    path = tmp_path / "hole.stl"
    path.touch()
    os.truncate(path, 3 << 30)
    monkeypatch.setattr(surfaces, "file_digest", read)
    with pytest.raises(SettingError, match="has 3221 MB, expected at most 268 MB"):
        surface_mesh(str(path), 100)


def test_the_pieces_with_edges_of_three_triangles_are_counted(tmp_path):
    """Two boxes, each with a fin, and a sheet between them, which is open and has no such edge."""
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    a, b = box.faces[0, :2]
    fin = trimesh.Trimesh(
        [*box.vertices, box.vertices[a] + [0.0, 0.0, 0.3]], [*box.faces, [a, b, len(box.vertices)]], process=False
    )
    pieces = [fin, trimesh.Trimesh([[2.0, 0, 0], [2.1, 0, 0], [2.0, 0.1, 0]], [[0, 1, 2]]), fin.copy()]
    pieces[2].apply_translation([4.0, 0.0, 0.0])
    trimesh.util.concatenate(pieces).export(tmp_path / "fins.ply")
    with pytest.raises(SettingError, match=r"has 2 edges that more than two .* \(in 2 of its 3 pieces; --piece K"):
        surface_mesh(str(tmp_path / "fins.ply"), 0, file_unit="cm", piece=-1)
