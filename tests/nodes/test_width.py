"""The width of the finger in the nodes: collision bridges a cut, spread loads what can be touched."""

import numpy as np
import pytest
from pytest import approx

from palpate.engine.faults import GraphError
from palpate.launch.load.launchfile import find
from palpate.launch.testing import FakeBus
from palpate.messages import Contact, Pose
from palpate.nodes.base import SettingError
from palpate.nodes.collision import Mesh, Nurbs
from palpate.nodes.spread import Kernel
from palpate.physics.geometry.mesh import Mesh as Triangles
from palpate.physics.geometry.mesh import write_ply

SIDE, TOP, GAP = 24e-3, 8e-3, 0.2e-3  # [m]


def block(low, high, count=12):
    """A box as a mesh of squares cut in two."""
    from manifold3d import Manifold

    solid = Manifold.cube([float(b - a) for a, b in zip(low, high, strict=True)]).translate([float(a) for a in low])
    made = solid.refine(count).to_mesh64()
    return np.asarray(made.vert_properties)[:, :3].copy(), np.asarray(made.tri_verts).astype(np.int32)


@pytest.fixture(scope="module")
def cut(tmp_path_factory):
    """A file of a block in two pieces with a gap along x."""
    (a, s), (b, t) = (
        block((-SIDE / 2, y, -TOP), (SIDE / 2, y + SIDE / 2, TOP)) for y in (-SIDE / 2 - GAP / 2, GAP / 2)
    )
    path = tmp_path_factory.mktemp("organ") / "cut.ply"
    write_ply(path, Triangles(np.concatenate([a, b]), np.concatenate([s, t + len(a)])))
    return str(path)


@pytest.fixture(scope="module")
def grooved(tmp_path_factory):
    """A file of a block with a groove along x, 6 mm wide and 3 mm deep."""
    from manifold3d import Manifold

    whole = Manifold.cube([SIDE, SIDE, 2 * TOP]).translate([-SIDE / 2, -SIDE / 2, -TOP])
    made = (whole - Manifold.cube([2 * SIDE, 6e-3, TOP]).translate([-SIDE, -3e-3, TOP - 3e-3])).refine(12).to_mesh64()
    path = tmp_path_factory.mktemp("organ") / "grooved.ply"
    triangles = np.asarray(made.tri_verts).astype(np.int32)
    write_ply(path, Triangles(np.asarray(made.vert_properties)[:, :3].copy(), triangles))
    return str(path)


def node(kind, path, **more):
    return kind(surface=path, position=(0.0, 0.0, 0.0), **more)


def gaps(collision, places):
    """Approach [m] and normal of a finger that comes down at each place."""
    found = []
    for x, y, z in places:
        bus = FakeBus(collision)
        path = [Pose(position=(x, y, h), velocity=(0.0, 0.0, 0.0), dt=1e-3) for h in np.linspace(TOP + 5e-3, z, 12)]
        found.append(bus.publish(*path)[-1])
    return found


PLACES = [(0.0, y, TOP + 1e-3) for y in (0.0, 1e-3, -3e-3)]


def test_a_gap_narrower_than_the_finger_feels_like_the_uncut_body(cut):
    for found in gaps(node(Mesh, cut), PLACES):
        assert found.approach == approx(3e-3, abs=15e-6) and found.normal[2] > 0.999
    for found in gaps(node(Mesh, cut, width=0.0), [(0.0, 0.0, TOP - 1e-3)]):
        assert found.approach < 4.2e-3 and abs(found.normal[1]) > 0.5  # a needle: the wall of the gap


def test_a_note_says_what_is_bridged_and_how_to_turn_it_off(cut):
    collision = node(Mesh, cut)
    FakeBus(collision)
    notes = [note for note in collision.notes() if "bridged" in note]
    assert len(notes) == 1 and "narrower than the finger (16 mm)" in notes[0] and "scene.finger.width=0" in notes[0]


def test_a_built_in_surface_with_hollows_becomes_a_mesh_for_a_wide_finger():
    """The hilum of the kidney; the sphere has none, and a needle enters all of them."""
    for changes, kind in (((), Nurbs), (("scene.finger.width=20 mm",), Mesh),
                          (("scene.finger.width=0",), Nurbs),
                          (("scene.finger.width=20 mm", "collision.surface=sphere"), Nurbs)):  # fmt: skip
        graph = find("kidney").but(overrides=changes).load()
        found = graph.nodes["collision"]
        assert found.cls is kind and found.use == f"collision.{kind.__name__}"
        assert sum("in place of collision.Nurbs" in note for note in graph.notes) == (kind is Mesh)


def test_the_element_is_a_triangle_of_the_file_that_can_be_touched(cut):
    collision = node(Mesh, cut, refine=0.0)
    mesh = collision.mesh()
    for found in gaps(collision, PLACES):
        corners = mesh.vertices[mesh.triangles[found.element]]
        assert corners[:, 2] == approx(TOP) and np.linalg.norm(corners.mean(axis=0) - found.foot) < 4e-3


def test_the_floor_below_a_bridge_bears_no_load(grooved):
    spread = node(Kernel, grooved)
    press = Contact(
        foot=(0.0, 0.0, TOP), normal=(0.0, 0.0, 1.0), force=1.0, compression=1e-3, indentation=1e-3,
        compression_rate=0.0, indentation_rate=0.0,
    )  # fmt: skip
    (load,) = FakeBus(spread).publish(press)
    points = spread.mesh().vertices[load.nodes]
    assert np.sum(load.forces, axis=0) == approx((0.0, 0.0, -1.0))
    assert points[:, 2] == approx(TOP) and (points[:, 1] > 0).any() and (points[:, 1] < 0).any()
    (deep,) = FakeBus(node(Kernel, grooved, width=0.0)).publish(press)
    assert spread.mesh().vertices[deep.nodes][:, 2].min() == approx(TOP - 3e-3)  # a needle loads the floor too


def test_a_width_larger_than_an_organ_with_a_gap_is_refused(cut):
    with pytest.raises(SettingError, match=r"'width': found 80 mm, .*24\.2 mm across"):
        FakeBus(node(Mesh, cut, width=0.08))


def test_a_nurbs_surface_says_that_it_is_not_bridged():
    collision = Nurbs(width=0.05)
    FakeBus(collision)
    assert any("collision.Mesh" in note for note in collision.notes())
    usual = Nurbs()
    FakeBus(usual)
    assert not usual.notes()


def test_the_finger_is_as_wide_as_the_patch_unless_it_is_set():
    def widths(*changes):
        nodes = find("kidney").but(overrides=changes).load().nodes
        return {name: (spec.use, spec.settings["width"]) for name, spec in nodes.items() if "width" in spec.settings}

    assert widths() == {"collision": ("collision.Nurbs", 16e-3), "spread": ("spread.Kernel", 16e-3)}
    assert widths("spread.radius=6 mm") == {"collision": ("collision.Nurbs", 12e-3), "spread": ("spread.Kernel", 12e-3)}
    assert widths("tissue.use=deformation.ReducedFE", "tissue.radius=10 mm")["collision"] == ("collision.Mesh", 20e-3)
    for wide in ("scene.finger.width=3 mm", "collision.width=3 mm", "spread.width=3 mm"):
        assert {width for _, width in widths(wide, "spread.radius=6 mm").values()} == {3e-3}
    with pytest.raises(GraphError, match=r"width.*spread"):
        widths("spread.radius=60 mm")


@pytest.mark.parametrize("graph", ["kidney", "palpate-two", "nodule", "texture", "organs", "pinch"])
def test_one_setting_of_the_finger_reaches_collision_and_spread(graph):
    nodes = find(graph).but(overrides=["scene.finger.width=3 mm"]).load().nodes
    widths = {name: spec.settings["width"] for name, spec in nodes.items() if "width" in spec.settings}
    assert set(widths.values()) == {3e-3} and any(name.startswith("collision") for name in widths)
