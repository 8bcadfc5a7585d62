"""Meshes that are taken and meshes that are refused: bent elements, crossing surfaces, numbers, files."""

import sys

import numpy as np
import pytest
from pytest import approx

from palpate.models.fe import MaterialError, MeshError, Settings, Solver, TetMesh, box, linear, neo_hooke
from palpate.models.fe.element.elements import gradients, shape
from palpate.models.fe.element.files import read_mesh, write_vtu
from palpate.models.fe.element.jacobian import find_inverted
from palpate.models.fe.element.mesh import EDGES, check_surface
from palpate.models.fe.meshing.organ import fill
from palpate.nodes.base.surface import surface_mesh
from palpate.physics.geometry.crossing import crossing
from palpate.physics.geometry.mesh import Mesh


def element(corners, **moved):
    """Points (10,3) of one element; `e0` ... `e5` move the nodes on its edges."""
    corners = np.array(corners, dtype=float)
    points = np.concatenate([corners, corners[EDGES].mean(axis=1)])
    for name, by in moved.items():
        points[4 + int(name[1])] += by
    return points


FLAT = ((0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0))
SADDLE = element(FLAT, e3=(0, 0, 0.2), e1=(0, 0, -0.2))
"""Its four corners lie in a plane; its determinant is 0.8 everywhere."""


def test_a_bent_element_with_flat_corners_and_a_positive_determinant_is_taken_and_solved():
    mesh = TetMesh(SADDLE, np.arange(10)[None])
    assert mesh.corner_volumes == approx(0.0)
    at = np.random.default_rng(1).dirichlet(np.ones(4), 50)[:, :3]
    assert gradients(mesh.points, mesh.elements, at)[1] == approx(0.8)
    strain = 1e-3 * np.array([[1.0, 0.2, 0.0], [0.2, -0.5, 0.1], [0.0, 0.1, 0.7]])
    fixed = np.ones((10, 3), dtype=bool)
    body = Solver(mesh, {0: linear(1e4, 0.3)}, fixed, lambda t: t * mesh.points @ strain, settings=Settings(step=1.0))
    body.advance(1.0)
    assert 0.5 * float((body.reaction * body.displacement).sum()) > 0


def least_determinant(points):
    """At many points of one element, its corners, edges and faces among them."""
    n = 24
    at = np.array([(i, j, k) for i in range(n + 1) for j in range(n + 1 - i) for k in range(n + 1 - i - j)]) / n
    natural = shape(at)[1]
    return float(np.linalg.det(np.einsum("ai,nak->nik", points, natural)).min())


def test_inverted_elements_are_found_by_the_sign_of_their_determinant_anywhere():
    rng, straight = np.random.default_rng(3), element(((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)))
    printed = {True: 0, False: 0}
    for size in np.linspace(0.02, 0.3, 120):
        points = straight + np.concatenate([np.zeros((4, 3)), size * rng.standard_normal((6, 3))])
        least = least_determinant(points)
        if abs(least) < 0.02:
            continue
        wrong = len(find_inverted(points, np.arange(10)[None], 0.0)) > 0
        assert wrong == (least < 0.0)
        printed[wrong] += 1
    assert min(printed.values()) > 20


def test_an_element_that_is_inside_out_between_its_corners_and_points_of_integration_is_refused():
    points = element(((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)), e0=(0.3, 0, 0))
    assert gradients(points, np.arange(10)[None])[1].min() > 0
    with pytest.raises(MeshError, match=r"element 0 at .*so curved that its Jacobian is negative"):
        TetMesh(points, np.arange(10)[None])
    with pytest.raises(MeshError, match="expected a positive one; swap two"):
        TetMesh(points * (1, 1, -1), np.arange(10)[None])


def test_numbers_of_nodes_that_are_not_whole_are_refused():
    mesh = box((1.0, 1.0, 1.0), (1, 1, 1))
    for wrong in (mesh.elements + 0.4, mesh.elements.astype(float)):
        with pytest.raises(MeshError, match=r"elements: found float64 numbers, expected integers"):
            TetMesh(mesh.points, wrong)
    with pytest.raises(MeshError, match=r"region: found float64"):
        TetMesh(mesh.points, mesh.elements, np.full(len(mesh.elements), 1.5))
    small = TetMesh(mesh.points, mesh.elements.astype(np.int32), np.ones(len(mesh.elements), dtype=np.uint8))
    assert small.elements.dtype == np.int64 and small.region.tolist() == [1] * 6


def held(size, young):
    mesh = box((size,) * 3, (1, 1, 1))
    return Solver(mesh, {0: neo_hooke(young, 0.4)}, np.repeat(mesh.points[:, 2:] < 1e-9 * size, 3, axis=1))


def test_a_cube_of_metres_and_a_modulus_in_kilopascals_are_errors():
    with pytest.raises(MeshError, match=r"7\.794 m across.*points \* 1e-3"):
        held(4.5, 1e4)
    with pytest.raises(MaterialError, match=r"Young's modulus 19 Pa.*19 kPa is 1\.9e\+04 Pa"):
        held(0.045, 19.0)
    assert held(0.045, 19e3).load == 0.0


def test_plain_elements_that_lock_are_refused_before_they_are_solved():
    mesh = box((1e-2,) * 3, (1, 1, 1))
    fixed = np.repeat(mesh.points[:, 2:] < 1e-9, 3, axis=1)
    stiff = neo_hooke(1e4, 0.49999)
    assert stiff.mixed
    from dataclasses import replace

    with pytest.raises(MaterialError, match=r"plain elements at a Poisson's ratio of 0\.49999.*mixed=True"):
        Solver(mesh, {0: replace(stiff, mixed=False)}, fixed)
    Solver(mesh, {0: replace(neo_hooke(1e4, 0.498), mixed=False)}, fixed)


def ball(centre, radius=0.02, count=12):
    """A closed ball of triangles."""
    theta, phi = np.meshgrid(np.linspace(0, np.pi, count + 1)[1:-1], np.linspace(0, 2 * np.pi, 2 * count + 1)[:-1])
    rings = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)
    many, per = 2 * count, count - 1
    points = np.concatenate([rings.reshape(-1, 3), [[0, 0, 1.0], [0, 0, -1.0]]])
    triangles = []
    for i in range(many):
        j = (i + 1) % many
        triangles.append((many * per, i * per, j * per))
        triangles.append((many * per + 1, j * per + per - 1, i * per + per - 1))
        for k in range(per - 1):
            a, b, c, d = i * per + k, i * per + k + 1, j * per + k, j * per + k + 1
            triangles += [(a, b, d), (a, d, c)]
    return radius * points + centre, np.array(triangles, dtype=np.int32)


def test_two_balls_that_overlap_are_refused_and_two_apart_are_not():
    one, triangles = ball((0, 0, 0))
    for offset, crossed in ((0.025, True), (0.0401, False), (0.05, False)):
        other, _ = ball((offset, 0.003, 0.001))
        points, both = np.concatenate([one, other]), np.concatenate([triangles, triangles + len(one)])
        assert (crossing(points, both) is not None) == crossed
        if crossed:
            first, second, at = crossing(points, both)
            assert (first < len(triangles)) != (second < len(triangles))
            for centre in ((0, 0, 0), (offset, 0.003, 0.001)):
                assert np.linalg.norm(at - centre) == approx(0.02, rel=0.05)
            with pytest.raises(MeshError, match=r"triangles \d+ and \d+ cross at .*Join the parts"):
                fill(Mesh(points, both))


def cuboid(low, high):
    """A closed box of triangles."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = [t for a, b, c, d in faces for t in ((a, b, c), (a, c, d))]
    return np.array(low) + corners * (np.array(high) - low), np.array(triangles, dtype=np.int32)


def joined(*surfaces):
    starts = np.cumsum([0, *(len(points) for points, _ in surfaces)])
    points = np.concatenate([points for points, _ in surfaces])
    return points, np.concatenate([triangles + s for (_, triangles), s in zip(surfaces, starts, strict=False)])


@pytest.mark.parametrize("turn", [0.0, 0.4])
def test_a_mirror_image_crosses_also_where_its_edges_meet_those_of_the_original(turn):
    """In the plane of symmetry each edge meets its mirror image, so that no edge passes through an interior."""
    c, s = np.cos(turn), np.sin(turn)
    turned = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    for axis in range(3):
        points, triangles = ball(0.013 * np.eye(3)[axis])
        mirrored = points * (1.0 - 2.0 * np.eye(3)[axis]), triangles[:, ::-1]
        both, indices = joined((points, triangles), mirrored)
        _, _, at = crossing(both @ turned.T, indices)
        assert abs((turned.T @ at)[axis]) < 2e-3
        away = points + 0.0075 * np.eye(3)[axis]  # 0.5 mm apart
        both, indices = joined((away, triangles), (away * (1.0 - 2.0 * np.eye(3)[axis]), triangles[:, ::-1]))
        assert crossing(both @ turned.T, indices) is None
    for shift in (0.005, 0.01):  # along an axis of symmetry
        points, triangles = ball((0, 0, 0))
        assert crossing(*joined((points, triangles), (points + [0, 0, shift], triangles))) is not None


def test_boxes_that_touch_do_not_cross_and_boxes_that_overlap_do():
    one = cuboid((0, 0, 0), (0.04, 0.04, 0.04))
    touching = ((0.04, 0, 0), (0.04, 0.02, 0.01), (0.04, 0.04, 0), (0.04, 0.04, 0.04))
    for low in (*touching, (0.02, 0, 0), (0.02, 0.02, 0.02), (0, 0, 0)):
        other = cuboid(low, np.array(low) + 0.04)
        assert (crossing(*joined(one, other)) is None) == (low in touching), low


def test_specks_inside_a_ball_are_tested_near_them_only():
    """Each speck is in the box of the ball; all pairs of their triangles would take minutes."""
    points, triangles = ball((0, 0, 0), 0.04, 40)
    grid = np.stack(np.meshgrid(*[np.linspace(-0.02, 0.02, 7)] * 3), axis=-1).reshape(-1, 3)
    specks = [cuboid(at, at + 1e-3) for at in grid]
    assert crossing(*joined((points, triangles), *specks)) is None
    far = cuboid((0.0395, -5e-4, -5e-4), (0.0405, 5e-4, 5e-4))
    assert crossing(*joined((points, triangles), *specks, far)) is not None


def test_the_shipped_surfaces_do_not_cross_themselves():
    for vertices in (80, 600):
        kidney = surface_mesh("kidney", vertices)
        check_surface(kidney)


def layered():
    mesh = box((2e-2, 1e-2, 1e-2), (2, 1, 1))
    side = mesh.points[mesh.elements[:, :4]].mean(axis=1)[:, 0] > 1e-2
    return TetMesh(mesh.points, mesh.elements, np.where(side, 7, 3))


def same(copy, mesh):
    assert copy.points[copy.elements] == approx(mesh.points[mesh.elements], abs=1e-9)


def test_a_vtk_file_is_read_with_its_regions(tmp_path):
    pytest.importorskip("meshio")
    mesh = layered()
    write_vtu(tmp_path / "block.vtu", mesh)
    copy, names = read_mesh(tmp_path / "block.vtu")
    same(copy, mesh)
    assert (copy.region == mesh.region).all() and names == {}


@pytest.mark.parametrize("order", [1, 2])
def test_gmsh_and_abaqus_files_are_read_with_named_regions_in_their_unit(tmp_path, order):
    meshio = pytest.importorskip("meshio")
    mesh = layered()
    cells = mesh.elements if order == 2 else mesh.elements[:, :4]
    kind = "tetra10" if order == 2 else "tetra"
    skin = mesh.faces[:, :3]
    tags = [mesh.region, np.full(len(skin), 1)]
    data = {"gmsh:physical": tags, "gmsh:geometrical": tags}
    names = {"fat": np.array([3, 3]), "skin": np.array([7, 3]), "outside": np.array([1, 2])}
    gmsh = meshio.Mesh(1e3 * mesh.points, [(kind, cells), ("triangle", skin)], cell_data=data, field_data=names)
    gmsh.write(tmp_path / "block.msh", file_format="gmsh22", binary=False)
    copy, regions = read_mesh(tmp_path / "block.msh", unit=1e-3)
    assert regions == {"fat": 3, "skin": 7}
    assert (copy.region == mesh.region).all()
    same(copy, mesh)
    sets = {"fat": [np.flatnonzero(mesh.region == 3)], "skin": [np.flatnonzero(mesh.region == 7)]}
    meshio.Mesh(1e3 * mesh.points, [(kind, cells)], cell_sets=sets).write(tmp_path / "block.inp")
    copy, regions = read_mesh(tmp_path / "block.inp", unit=1e-3)
    assert [regions["fat"], regions["skin"]] == sorted(regions.values())
    assert (copy.region == np.where(mesh.region == 3, regions["fat"], regions["skin"])).all()
    same(copy, mesh)


def test_files_that_are_not_meshes_are_errors(tmp_path, monkeypatch):
    meshio = pytest.importorskip("meshio")
    with pytest.raises(MeshError, match=r"gone\.msh: the file does not exist"):
        read_mesh(tmp_path / "gone.msh")
    (tmp_path / "bad.msh").write_text("hello")
    with pytest.raises(MeshError, match=r"bad\.msh: cannot be read as a mesh"):
        read_mesh(tmp_path / "bad.msh")
    flat = meshio.Mesh(np.eye(3), [("triangle", np.array([[0, 1, 2]]))])
    flat.write(tmp_path / "flat.vtk")
    with pytest.raises(MeshError, match=r"found cells triangle; expected tetra or tetra10"):
        read_mesh(tmp_path / "flat.vtk")
    monkeypatch.setitem(sys.modules, "meshio", None)
    with pytest.raises(MeshError, match=r'meshio is not installed.*pip install "palpate\[mesh\]"'):
        read_mesh(tmp_path / "flat.vtk")
