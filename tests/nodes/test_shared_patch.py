"""One finger on several organs: it touches the closing of their union, and each organ bears its part of the patch."""

import json

import numpy as np
import pytest
from pytest import approx

from palpate.launch.load.launchfile import find
from palpate.launch.run.lane_runner import LaneKeep, LaneRunner
from palpate.launch.run.lanes import columns_of, prepare
from palpate.launch.testing import FakeBus
from palpate.messages import Contact, Pose
from palpate.nodes.base import SettingError
from palpate.nodes.base.felt.organs import organs_text
from palpate.nodes.collision import Mesh
from palpate.nodes.spread import Kernel
from palpate.physics.contact.organs.shared_patch import close_bodies, near_bodies
from palpate.physics.device.falcon import HOME
from palpate.physics.geometry.mesh import write_ply
from palpate.studies.organs.gaps import HIGH, LONG, MM, WIDE
from palpate.studies.organs.shapes import boxes

TOP, COUNT = 0.5 * HIGH, 1200
KEEP = [("both.Contact", "force"), ("contact-kidney", "force"), ("contact-liver", "force"), ("controller", "force")]
ONE = [("contact", "force"), ("controller", "force")]


def half(low, high):
    return boxes((-0.5 * LONG, 0.5 * LONG), (low, high), (-TOP, TOP), np.ones((1, 1, 1), bool), COUNT)


def halves(gap):
    return half(-0.5 * WIDE, -0.5 * gap), half(0.5 * gap, 0.5 * WIDE)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("organs")

    def of(gap):
        paths = [folder / f"{gap / MM:g}-{side}.ply" for side in "ab"]
        for path, mesh in zip(paths, halves(gap), strict=True):
            if not path.exists():
                write_ply(path, mesh)
        return [str(path) for path in paths]

    whole = folder / "whole.ply"
    write_ply(whole, half(-0.5 * WIDE, 0.5 * WIDE))
    of.whole = str(whole)
    return of


def surface(file, position=(0.0, 0.0, 0.0), rotation=(0.0, 0.0, 0.0)):
    return {"surface": file, "vertices": 3000, "position": list(position), "rotation": list(rotation),
            "file_unit": "m", "piece": 0, "refine": 1.6e-3}  # fmt: skip


def node(kind, listed, own, **more):
    given = {name: value for name, value in listed[own].items() if name not in ("position", "rotation")}
    at = {name: tuple(listed[own][name]) for name in ("position", "rotation")}
    return kind(**given, **at, organs=organs_text(listed, own), **more)


def press(collision, x, y, z):
    path = [Pose(position=(x, y, h), velocity=(0.0, 0.0, 0.0), dt=1e-3) for h in np.linspace(TOP + 5e-3, z, 12)]
    return FakeBus(collision).publish(*path)[-1]


def test_parts_of_the_patch_add_up_and_change_continuously():
    felt = close_bodies(list(halves(0.2 * MM)), 8 * MM)
    assert felt.shares.sum(axis=1) == approx(1.0) and (felt.shares >= 0.0).all()
    top = np.abs(felt.mesh.vertices[:, 2] - TOP) < 0.1 * MM
    y, part = felt.mesh.vertices[top, 1], felt.shares[top, 1]
    inner = np.abs(felt.mesh.vertices[top, 0]) < 8 * MM
    assert part[inner & (y > 8.2 * MM)] == approx(1.0) and part[inner & (y < -8.2 * MM)] == approx(0.0)
    # of a biweight patch with its middle at y, the part beyond the line y = 0
    q = np.clip(y[inner] / (8 * MM), -1.0, 1.0)
    exact = 0.5 + 35 / 32 * (q - q**3 + 0.6 * q**5 - q**7 / 7)
    assert part[inner] == approx(exact, abs=0.04)


def test_only_organs_nearer_than_the_finger_are_felt_together():
    a, b = halves(15.9 * MM)
    assert near_bodies([a, b], 16 * MM) == [[0, 1]] and near_bodies(list(halves(16.1 * MM)), 16 * MM) == [[0], [1]]
    far = type(a)(a.vertices + (0.2, 0.0, 0.0), a.triangles)
    assert near_bodies([a, far, b], 16 * MM) == [[0, 2], [1]]


def test_both_collisions_send_one_foot_on_the_bridge(files):
    listed = [surface(file) for file in files(0.2 * MM)]
    for y in (0.0, 1 * MM, -3 * MM):
        one, two = (press(node(Mesh, listed, own), 0.0, y, TOP + 1 * MM) for own in (0, 1))
        assert (one.foot, one.normal, one.approach) == (two.foot, two.normal, two.approach)
        assert one.approach == approx(3 * MM, abs=15e-6) and one.normal[2] > 0.999
        assert (one.share[0] + two.share[0] == approx(1.0) and (one.share[0] > two.share[0]) == (y < -1e-9)) or y == 0.0
    swapped = press(node(Mesh, listed[::-1], 1), 0.0, -3 * MM, TOP + 1 * MM)
    assert swapped == press(node(Mesh, listed, 0), 0.0, -3 * MM, TOP + 1 * MM)  # exchanged organs


def test_a_gap_wider_than_the_finger_changes_nothing(files):
    listed = [surface(file) for file in files(16.5 * MM)]
    one = press(node(Mesh, listed, 0), 0.0, -9 * MM, TOP + 1 * MM)
    given = {k: v for k, v in listed[0].items() if k not in ("position", "rotation")}
    alone = press(Mesh(**given, position=(0.0, 0.0, 0.0)), 0.0, -9 * MM, TOP + 1 * MM)
    assert one == alone and len(one.share) == 0


def test_a_load_is_on_the_vertices_that_carry_the_bridge(files):
    listed = [surface(file) for file in files(0.2 * MM)]
    for own, sense in ((0, -1.0), (1, 1.0)):
        spread = node(Kernel, listed, own)
        contact = Contact(
            foot=(0.0, 0.0, TOP), normal=(0.0, 0.0, 1.0), force=0.5, compression=1e-3, indentation=1e-3,
            compression_rate=0.0, indentation_rate=0.0, whole=np.array([1.0]),
        )  # fmt: skip
        (load,) = FakeBus(spread).publish(contact)
        points = spread.mesh().vertices[load.nodes]
        assert load.forces.sum(axis=0) == approx((0.0, 0.0, -0.5)) and load.whole[0] == 1.0
        assert points[:, 2] == approx(TOP) and (sense * points[:, 1] > 0.0).all()
        assert np.linalg.norm(points - contact.foot, axis=1).max() <= 8 * MM  # not widened: the rest is on the other


def test_a_setting_that_no_loader_made_is_refused(files):
    with pytest.raises(SettingError, match=r"'organs'.*leave it out"):
        FakeBus(Mesh(surface=files(0.0)[0], position=(0.0, 0.0, 0.0), organs="[1]"))


def run(graph, sets, keep, duration):
    described = find(graph).but(overrides=sets, duration=duration)
    first = prepare(described, keep, described.load())
    ticks = round(1000 * duration)
    arrays, lanes = columns_of(first, keep, 1, ticks), LaneRunner(LaneKeep(keep, ticks), 1)
    try:
        assert not lanes.run([first].__getitem__, arrays).failures
    finally:
        lanes.close()
    return dict(zip(keep, (array[0] for array in arrays), strict=True))


def hand(begin, path):
    points = np.array([begin, *(s["to"] for s in path if "to" in s)])
    origin = (0.5 * (points.min(axis=0) + points.max(axis=0)) - HOME).round(4).tolist()
    texts = [f"scene.hand.begin={list(begin)}", f"scene.hand.path={json.dumps(path)}", "scene.tissue.friction=false"]
    return texts + [f"{name}.origin={origin}" for name in ("device", "finger", "statics")]


def at(name, file):
    return [f"scene.{name}.surface={file}", f"scene.{name}.position=[0, 0, 0]"]


def halved(files, gap, hands, duration, swap=False):
    one, two = files(gap)[:: -1 if swap else 1]
    tissue = find("kidney").load().nodes["tissue"].settings
    same = [f"liver.{name}={tissue[name]}" for name in ("stiffness", "exponent", "damping", "retardation")]
    return run("organs", at("surface", one) + at("liver-surface", two) + same + hands, KEEP, duration)


@pytest.fixture(scope="module")
def pressed(files):
    """Force on the whole block and, by gap, on its halves as two organs, in a press 1 mm from the gap and a slide
    across it and back."""
    low = TOP - 4 * MM
    path = [
        {"to": [0, 1 * MM, low], "time": 0.2, "shape": "minimum-jerk"}, {"hold": 0.2},
        {"to": [0, 9 * MM, low], "time": 0.08, "shape": "linear"}, {"hold": 0.1},
        {"to": [0, -9 * MM, low], "time": 0.18, "shape": "linear"}, {"hold": 0.1},
    ]  # fmt: skip
    hands = hand((0.0, 1 * MM, TOP + 8 * MM), path)
    whole = run("kidney", [*at("surface", files.whole), "collision.use=collision.Mesh", *hands], ONE, 0.86)
    return whole, {gap: halved(files, gap * MM, hands, 0.86) for gap in (0.0, 0.2)}, hands


@pytest.mark.parametrize("gap", [0.0, 0.2])
def test_two_halves_feel_like_the_whole_block(pressed, gap):
    whole, cut = pressed[0], pressed[1][gap]
    f, g = whole["contact", "force"], cut["both.Contact", "force"]
    assert f.max() > 0.7
    assert np.abs(f - g).max() < 0.01 * f.max() + 0.02  # at each tick, also in the slide
    assert cut["contact-kidney", "force"] + cut["contact-liver", "force"] == approx(g)
    assert cut["contact-kidney", "force"][390] > 0.2 and cut["contact-liver", "force"][390] > 0.2

    def change(traces):
        return np.linalg.norm(np.diff(traces["controller", "force"], axis=0), axis=1).max()

    assert change(cut) <= 1.5 * change(whole)


def test_exchanged_organs_give_the_same(files, pressed):
    swapped = halved(files, 0.2 * MM, pressed[2], 0.86, swap=True)
    assert swapped["both.Contact", "force"] == approx(pressed[1][0.2]["both.Contact", "force"], abs=1e-12)
