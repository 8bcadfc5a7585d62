"""The proxy: a tool is pushed back to the side from which it entered."""

import dataclasses
import itertools

import numpy as np
import pytest
from formulas import foot_row
from pytest import approx
from scipy.spatial.transform import Rotation

from palpate.physics.geometry.closest import ClosestPoint, track
from palpate.physics.geometry.kidney import kidney
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.mesh_closest import MeshClosestPoint, track_mesh
from palpate.physics.geometry.nurbs_fit import sphere
from palpate.physics.geometry.proxy import EASY, FADES, FASTEST, JUMP, TURNED, follow, follow_mesh, memory
from palpate.physics.geometry.tessellate import tessellate
from palpate.studies.organs.shapes import boxes
from palpate.studies.organs.zoo import USUAL, mesh_of


def box(width, thickness, cells=20):
    """A slab of small triangles with sharp edges and its top at z = 0."""
    x = np.linspace(-0.5, 0.5, cells + 1)
    a, b = (g.ravel() for g in np.meshgrid(x, x, indexing="ij"))
    h = np.full(a.shape, 0.5)
    faces = [np.stack(c, axis=1) for c in ((a, b, h), (b, a, -h), (h, a, b), (-h, b, a), (b, h, a), (a, -h, b))]
    i = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()
    quad = np.concatenate([np.stack([i, i + cells + 1, i + cells + 2], 1), np.stack([i, i + cells + 2, i + 1], 1)])
    points = np.concatenate(faces)
    triangles = np.concatenate([quad + k * len(a) for k in range(6)])
    _, first, same = np.unique(np.round(points, 9), axis=0, return_index=True, return_inverse=True)
    return Mesh(
        points[first] * (width, width, thickness) - (0, 0, thickness / 2), same.ravel()[triangles].astype(np.int32)
    )


def flat(radius, thickness):
    """A pebble: a flattened sphere with its top at z = 0."""
    ball = sphere(radius)
    points = ball.points * (1, 1, thickness / 2 / radius) - (0, 0, thickness / 2)
    return dataclasses.replace(ball, points=points)


def patch_run(surface, path):
    closest = ClosestPoint(surface)
    scratch, kept = closest.scratch(), memory()
    feet = []
    for p in path:
        follow(*closest.tables, tuple(map(float, p)), 1e-4, *scratch, kept, 1e-3)
        feet.append(foot_row(scratch[3]))
    return np.array(feet)


def mesh_run(mesh, path, thickness=0.0, dt=1e-3):
    closest = MeshClosestPoint(mesh)
    (*state, result), kept = closest.scratch(), memory(thickness=thickness)
    feet = []
    for p in path:
        follow_mesh(*closest.tables.arrays, tuple(map(float, p)), 1e-4, *state, result, kept, dt)
        feet.append(foot_row(result))
    return np.array(feet)


def line(*points, step=1e-4):
    points_of_way = [np.array(points[:1], float)]
    for a, b in itertools.pairwise(points):
        a, b = np.array(a, float), np.array(b, float)
        n = max(int(np.linalg.norm(b - a) / step), 1)
        points_of_way.append(a + np.arange(1, n + 1)[:, None] / n * (b - a))
    return np.concatenate(points_of_way)


def lipschitz(path, feet):
    return (np.abs(np.diff(feet[:, 8])) - np.linalg.norm(np.diff(path, axis=0), axis=1)).max()


SLABS = {
    f"{kind} {t} mm": (run, make(0.04 if kind == "box" else 0.03, t * 1e-3))
    for kind, run, make in (("box", mesh_run, box), ("pebble", patch_run, flat))
    for t in (12, 8, 4, 1)
} | {"pebble mesh": (mesh_run, tessellate(flat(0.03, 4e-3), 4000))}
every_slab = pytest.mark.parametrize("slab", SLABS)


@every_slab
@pytest.mark.parametrize("drift", [0.0, 2e-3])
def test_a_tool_driven_through_a_thin_body_is_pushed_back_completely(slab, drift):
    run, body = SLABS[slab]
    path = line((0.001, 0.002, 0.005), (0.001 + drift, 0.002, -0.019))
    feet = run(body, path)
    assert (feet[:, 5] > 0.9).all()
    assert feet[:, 8] == approx(path[:, 2], abs=2e-4 if drift == 0 else 6e-4)
    assert lipschitz(path, feet) <= 1e-12
    back = np.concatenate([path, path[::-1]])
    again = run(body, back)
    assert (again[:, 5] > 0.9).all() and again[-1, 8] == approx(0.005, abs=2e-4)


@pytest.mark.parametrize("form", ["mesh", "patch"])
def test_the_gap_grows_steadily_through_the_middle_of_a_thin_body(form):
    """Within the hysteresis beyond the middle the gap was that of the other side: it shrank by 0.1 mm and grew back."""
    z = np.linspace(1e-3, -4e-3, 501)
    path = np.column_stack([np.full(501, 1.1e-3), np.full(501, 0.7e-3), z])
    feet = mesh_run(box(0.08, 5e-3), path) if form == "mesh" else patch_run(flat(0.04, 5e-3), path)
    assert feet[:, 8] == approx(z, abs=2e-6)
    back = mesh_run(box(0.08, 5e-3), path[[*range(400), *range(400, 0, -1)]])[:, 8]
    assert back[400:] == approx(z[400:0:-1], abs=2e-6)


@every_slab
def test_the_proxy_slides_with_a_tool_on_the_other_side(slab):
    run, body = SLABS[slab]
    path = line((0, 0, 0.003), (0, 0, -0.006), (0.005, 0, -0.006), (0, 0.003, -0.006))
    feet = run(body, path)
    assert (feet[:, 5] > 0.8).all()
    assert np.abs(feet[:, :2] - path[:, :2]).max() < 1.5e-3
    assert lipschitz(path, feet) <= 1e-12


@every_slab
def test_a_tool_that_leaves_sideways_is_free(slab):
    run, body = SLABS[slab]
    path = line((0.01, 0, 0.003), (0.01, 0, -0.014), (0.06, 0, -0.014), (0.06, 0, 0.02), (0.045, 0, 0.0))
    feet = run(body, path)
    fresh = run(body, path[-1:])
    assert feet[-1, :3] == approx(fresh[-1, :3], abs=1e-9) and feet[-1, 8] == approx(fresh[-1, 8], abs=1e-9)
    assert feet[-1, 8] > 0.01
    assert feet[path[:, 0] > 0.055, 8].max() > 0.02
    assert lipschitz(path, feet) <= 1e-12


def test_a_fingertip_that_was_pushed_through_a_plate_and_round_its_rim_is_free_above_it():
    """The gap to its first side grew to more than its tissue of 4 mm, so that contact ended 5.6 mm above the plate, but
    it shrank again on the way back, and the plate pulled the finger down."""
    mesh = box(0.04, 2e-3)
    path = line((-0.015, 0, -0.008), (-0.015, 0, 0.0016), (-0.0195, 0, 0.0017), (-0.0235, 0, 0.0045),
                (-0.0215, 0, 0.0045), (-0.022, 0, 0.0056), (0, 0, 0.0056))  # fmt: skip
    feet = mesh_run(mesh, path, thickness=4e-3)
    assert (feet[path[:, 2] < 1e-3, 5] < -0.9).all()  # pushed back through the plate
    after = int(np.flatnonzero(feet[:, 8] < 4e-3)[-1]) + 20  # the gap rises to the true one
    assert after < len(path) - 150
    assert feet[after:, 8] == approx(MeshClosestPoint(mesh).find(path[after:])[3], abs=1e-9)


def test_a_fingertip_that_leaves_a_plate_and_turns_round_is_free():
    """Below and next to the rim the gap rises by the motion of the tool. It fell again when the tool turned round, and
    the plate pushed a finger that was 17 mm away; its rate jumped by twice the speed of the tool."""
    aside, below = (6, -44, -12), (6, -38, -12.5)
    ends = np.array([(6, -23, 6), (6, -23, -14), aside, below, aside, below, aside, (6, -50, 0)]) * 1e-3
    path = np.concatenate([np.linspace(a, b, 400, endpoint=False) for a, b in itertools.pairwise(ends)])
    slab = box(80e-3, 5e-3)
    gap, true = mesh_run(slab, path, 4e-3)[:, 8], MeshClosestPoint(slab).find(path)[3]
    rises = np.diff(gap) > np.linalg.norm(np.diff(path, axis=0), axis=1) - 1e-9
    leaves = 800 - int(np.flatnonzero(~rises[800::-1])[0])  # the last step before `aside` that did not
    arrives = leaves + int(np.flatnonzero(np.abs(gap - true)[leaves:] < 1e-6)[0])
    assert gap[leaves] < -8e-3 and 1600 < arrives < 2400
    assert rises[leaves + 1 : arrives - 1].all() and gap[arrives:] == approx(true[arrives:], abs=1e-6)


def test_a_finger_that_leaves_a_plate_and_rests_is_let_go():
    """Beyond the rim it kept its force until it moved. Now the gap rises at a constant, low speed, and reaches the true
    one."""
    ends = np.array([(6, -23, 6), (6, -23, -14), (6, -44, -12)]) * 1e-3
    path = np.concatenate([np.linspace(a, b, 400, endpoint=False) for a, b in itertools.pairwise(ends)])
    path = np.concatenate([path, np.repeat(path[-1:], 6000, axis=0)])
    slab = box(80e-3, 5e-3)
    gap, true = mesh_run(slab, path, 4e-3)[800:, 8], MeshClosestPoint(slab).find(path[-1:])[3]
    arrives = int(np.flatnonzero(gap > true - FADES * 1e-3)[0])
    assert gap[0] < -4e-3 and true > 4e-3 and 1000 < arrives < 5000
    assert np.diff(gap[: arrives - 1]) == approx(FADES * 1e-3, abs=1e-9) and np.ptp(gap[arrives:]) < 1e-9


@pytest.mark.parametrize("aside", [0.0, 1e-4, 1e-3])
@pytest.mark.parametrize("form", ["patch", "mesh"])
def test_the_force_does_not_flip_inside_a_ball(form, aside):
    ball = sphere(0.02)
    path = line((aside, 0, 0.025), (aside, 0, -0.03), (aside, 0, 0.025))
    feet = patch_run(ball, path) if form == "patch" else mesh_run(tessellate(ball, 3000), path)
    assert (feet[:, 5] > (0.8 if aside < 1e-3 else 0.5)).all()
    assert lipschitz(path, feet) <= 1e-12
    assert feet[-1, 8] == approx(0.005, abs=1e-4)


@pytest.mark.parametrize("form", ["patch", "mesh"])
def test_in_a_thick_body_the_proxy_is_the_nearest_point(form):
    """A finger strokes the kidney with the bone up to 6 mm inside. Over the edges of a mesh of 4000 vertices the
    nearest point leaps by up to 0.7 mm; the foot is smooth, and the gap that of the nearest point within 2 um."""
    organ = kidney()
    top = organ(0.25, 0.5)
    t = np.linspace(0, 4 * np.pi, 4000)
    depth = 4e-3 * np.cos(3 * t) - 2e-3
    across = np.stack([0.02 * np.sin(t), 0.006 * np.sin(2.3 * t)], axis=1)
    mesh = tessellate(organ, 4000)
    high = np.column_stack([top[0] + across[:, 0], top[1] + across[:, 1], np.full(len(t), top[2] + 2e-3)])
    foot, normal = ClosestPoint(organ).find(high)[:2]
    path = foot + depth[:, None] * normal
    feet = patch_run(organ, path) if form == "patch" else mesh_run(mesh, path)
    nearest = np.empty_like(feet)
    if form == "patch":
        closest = ClosestPoint(organ)
        scratch = closest.scratch()
        for k, p in enumerate(path):
            track(*closest.tables, *p, 1e-4, *scratch)
            nearest[k] = foot_row(scratch[3])
    else:
        closest = MeshClosestPoint(mesh)
        *state, result = closest.scratch()
        for k, p in enumerate(path):
            track_mesh(*closest.tables.arrays, *p, 1e-4, *state, result)
            nearest[k] = foot_row(result)
    if form == "patch":
        assert (feet == nearest).all() or feet == approx(nearest, abs=1e-12)
        return
    away = np.linalg.norm(feet[:, :3] - nearest[:, :3], axis=1)
    assert feet[:, 8] == approx(nearest[:, 8], abs=2e-6)
    assert 0.05e-3 < away.max() < 0.75e-3 and away.mean() < 0.05e-3


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("slab", ["box 4 mm", "pebble 4 mm", "pebble mesh"])
def test_the_gap_changes_no_faster_than_the_tool_on_any_path(slab, seed):
    run, body = SLABS[slab]
    rng = np.random.default_rng(seed)
    t = np.linspace(0, 1, 3000)[:, None]
    a, b = rng.normal(size=(2, 5, 3)) * (0.012, 0.012, 0.006)
    path = np.sin(2 * np.pi * t * np.arange(1, 6)) @ a + np.cos(2 * np.pi * t * np.arange(1, 6)) @ b
    feet = run(body, path)
    assert np.isfinite(feet).all() and lipschitz(path, feet) <= 1e-12
    away = run(body, np.concatenate([path, line(path[-1], (0, 0, 0.1), (0, 0, 0.005))]))
    assert away[-1, 8] == approx(0.005, abs=1e-6)


@pytest.mark.parametrize("slab", ["box 1 mm", "box 4 mm", "pebble 4 mm"])
@pytest.mark.parametrize(("step", "kept"), [(5.9e-3, True), (6.1e-3, False)])
def test_the_side_is_kept_up_to_a_step_of_6_mm_at_any_rate(slab, step, kept):
    """The limit is a length: 6 m/s at 1 kHz, 3 m/s at 500 Hz."""
    assert JUMP == 6e-3
    run, _ = SLABS[slab]
    z = np.arange(2e-3, -18e-3, -step)
    feet = run(SLABS[slab][1], np.column_stack([np.full(len(z), 1e-4), np.full(len(z), 2e-4), z]))
    assert (feet[:, 5] > 0.9).all() == kept


@pytest.mark.parametrize("aside", [0.3e-3, 0.7e-3, 1.5e-3])
@pytest.mark.parametrize("thickness", [4e-3, 8e-3, 12e-3])
def test_a_finger_near_a_sharp_rim_slides_off_and_meets_the_underside_only_from_below(thickness, aside):
    """A finger on a spring is pushed down near the rim at x = 20 mm. Where a normal points down, the finger is below
    the middle of the plate, and beyond its side or under it, except for rounding of interpolated normals."""
    mesh = box(0.04, thickness)
    closest = MeshClosestPoint(mesh)
    (*state, result), kept = closest.scratch(), memory()
    position, speed, seen = np.array([0.02 - aside, 1e-3, 6e-3]), np.zeros(3), []
    for k in range(1200):
        hand = np.array([0.02 - aside, 1e-3, 6e-3 - 18e-3 * min(k / 500, 1.0)])
        follow_mesh(*closest.tables.arrays, tuple(map(float, position)), 1e-4, *state, result, kept, 1e-3)
        push = 3000.0 * max(4e-3 - result.distance, 0.0) ** 1.5 * result.normal
        speed = speed + 1e-3 * (500.0 * (hand - position) - 20.0 * speed + push) / 0.2
        seen.append((position[2], result.normal[2], result.distance))
        position = position + 1e-3 * speed
    z, normal, gap = np.array(seen).T
    assert np.abs(np.diff(gap)).max() < 1e-3
    down = normal < TURNED
    assert (gap[down] > -1e-4).all() and (z[down] < -thickness / 2).all()
    if aside < 1e-3:  # it slides off, passes the plate, and ends under it
        assert z[-1] < -thickness and normal[-1] < -0.5


def test_the_rate_of_the_gap_changes_little_where_the_nearest_face_changes():
    """A finger at 0.1 m/s moves along the top of a box, 1.4 mm deep, and is nearer to the side by 0.1 mm before its
    foot leaves the top. The gap was that of the side meanwhile: its rate went from 0 to 100 mm/s and back, and the
    force of a viscous tissue by 0.29 N in a tick of any length. The gap now approaches that of the side."""
    dt, low = 1.25e-4, -1.4e-3
    path = line((0.012, 1e-3, 2e-3), (0.012, 1e-3, low), (0.0199, 1e-3, low), step=0.1 * dt)
    gap = mesh_run(box(0.04, 0.012), path, 4e-3, dt)[:, 8]
    slides = path[2:, 2] == path[:-2, 2]
    sudden = np.abs(np.diff(gap, 2) / dt)[slides]
    assert 1e-3 < sudden.max() < 0.01  # [m/s]; 0.1 mm in `ARRIVES`, at once, are 0.02
    assert -5e-4 < gap[-1] < -1e-4  # towards the 0.1 mm of the side at last, from 1.4 mm


@pytest.mark.parametrize("name", ["plate-2", "plate-5", "box", "torus-6", "l-shape"])
def test_the_rate_of_the_gap_changes_little_on_any_way_through_a_body(name):
    """At 10 kHz, of a finger that goes in and wanders through, past rims and out of its other sides: by at most 0.17 of
    its motion in a tick. It was up to 0.76 where the target of a foot that trailed leapt, or became that of another
    face, since the rate that the gap had was forgotten."""
    mesh, dt = mesh_of(name, USUAL), 1e-4
    middle, half = mesh.vertices.mean(axis=0), 0.5 * np.ptp(mesh.vertices, axis=0)
    worst = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        speed = float(np.exp(rng.uniform(*np.log([0.03, 0.2]))))
        aim, axis = middle + half * rng.uniform(-0.95, 0.95, 3), rng.integers(3)
        begin = aim.copy()
        begin[axis] = middle[axis] + rng.choice([-1, 1]) * (half[axis] + 6e-3)
        points = [begin, aim]
        for _ in range(3):
            far = middle + (half + 3e-3) * rng.uniform(-1, 1, 3)
            points.append(far if rng.uniform() < 0.5 else points[-1] + 5e-3 * rng.normal(size=3))
        path = line(*(tuple(each) for each in points), step=speed * dt)
        feet = mesh_run(mesh, path, 4e-3, dt)
        moved, gap = np.linalg.norm(np.diff(path, axis=0), axis=1), feet[:, 8]
        rate, straight = np.diff(gap) / moved, np.linalg.norm(np.diff(path, 2, axis=0), axis=1) < 1e-3 * moved[1:]
        inside = (gap[:-2] < 0.0) & (gap[1:-1] < 0.0) & (gap[2:] < 0.0)
        worst.append(np.abs(np.diff(rate))[straight & inside].max(initial=0.0))
    assert 0.01 < max(worst) < 0.2


@pytest.mark.parametrize("drop", [0.0, 0.2, 0.5])
@pytest.mark.parametrize("depth", [1.2e-3, 1.6e-3])
@pytest.mark.parametrize("speed", [0.03, 0.1])
def test_the_rate_of_the_gap_changes_little_where_a_finger_leaves_a_plate_past_its_rim(speed, depth, drop):
    """In a plate of 2 mm it is nearer to the rim than to the top, from which it entered. Where the rim becomes the
    target, and where the finger is outside, its gap rose by up to 67 % of the motion more than in the tick before, of
    0.1 ms: the force on a rigid plate fell by 0.9 N and rose by 1.9 N."""
    mesh, dt = mesh_of("plate-2", USUAL), 1e-4
    rim, top = mesh.vertices[:, 0].min(), mesh.vertices[:, 2].max()
    turn = np.array([rim + 2e-3, 0.0263, top - depth])
    begin, out = turn + (0.0, 0.0, 5e-3 + depth), turn + 10e-3 * np.array([-1.0, 0.0, -drop]) / np.hypot(1.0, drop)
    path = line(tuple(begin), tuple(turn), tuple(out), step=speed * dt)
    gap = mesh_run(mesh, path, 4e-3, dt)[:, 8]
    slides = np.arange(len(path) - round(9.9e-3 / (speed * dt)), len(path))
    sudden = np.abs(np.diff(gap, 2))[slides - 2] / (speed * dt)
    sudden = sudden[gap[slides] < 4e-3]
    assert len(sudden) > 100 and 1e-3 < sudden.max() < 0.05
    assert 4.0e-3 < gap[-1] < MeshClosestPoint(mesh).find(path[-1])[3] + 1e-9, "and it is let go"


def test_a_foot_that_trails_a_leap_catches_up_slowly():
    """In a groove of 8 mm the nearest point leaps to the other wall. The foot followed a finger of 0.3 m/s at twice its
    speed; apart from the motion of the nearest point it now catches up with at most 0.1 m/s."""
    full = np.array([[[True, True]], [[True, False]], [[True, True]]])
    mesh = boxes((-0.03, -0.004, 0.004, 0.03), (-0.03, 0.03), (-0.025, -0.005, 0.01), full, 4000)
    path = line((0.02, 0.0, 0.014), (0.008, 0.0, 0.003), (-0.008, 0.012, 0.003), step=3e-4)
    feet, moved = mesh_run(mesh, path), np.linalg.norm(np.diff(path, axis=0), axis=1)
    nearest = MeshClosestPoint(mesh).find(path)[0]
    behind = np.linalg.norm(feet[:, :3] - nearest, axis=1)
    target, foot = (np.linalg.norm(np.diff(p, axis=0), axis=1) for p in (nearest, feet[:, :3]))
    inside = feet[:, 8] < -1e-4
    trails = (behind[1:-1] > 5e-4) & (behind[:-2] > 5e-4) & inside[:-2] & inside[1:-1] & inside[2:]
    steady = trails & (target[1:] < 3e-4) & (target[:-1] < 3e-4)
    assert steady.sum() > 5 and behind.max() > 2e-3
    assert (foot[1:][steady] <= target[1:][steady] + FASTEST * 1e-3 + 1e-6).all()
    assert moved.max() > 2.9e-4 and behind[-1] < 2e-3


@pytest.mark.parametrize("dt", [1e-3, 1.25e-4])
def test_a_foot_whose_target_leaps_back_stops_before_it_returns(dt):
    """A finger at 20 mm/s, 5 mm deep in a box, is nearer to a side of it and soon nearer to the top again. Its foot
    turned round at 70 mm/s on the way between them, and the force of viscous beams fell by 0.7 N in a tick. Its speed
    now changes as where it starts, by `FASTEST` within `LANDING` or `ARRIVES`, apart from the speed of its target."""
    slow, low = 0.02, -5e-3
    path = line((0.01, 1e-3, 2e-3), (0.01, 1e-3, low), (0.0152, 1e-3, low), (0.0147, 1e-3, low), step=slow * dt)
    foot = mesh_run(box(0.04, 0.012), path, 4e-3, dt)[:, :3]
    speed = np.diff(foot, axis=0)[int(path[:, 0].argmax()) - 1 :] / dt
    first = int(speed[:, 2].argmin())
    back = first + int((speed[first:, 2] > 0.3 * FASTEST).argmax())
    assert speed[first, 2] < -0.3 * FASTEST and speed[back, 2] > 0.3 * FASTEST
    change = np.linalg.norm(np.diff(speed[first : back + 1], axis=0), axis=1)
    assert change.max() < 1.2 * FASTEST * dt / 5e-3 + slow


def test_the_normal_turns_no_faster_at_a_depth_than_a_patch_may_slide():
    """Under the floor of a groove: over its inner edges the normal turned 1.9 times as fast, with the foot at rest."""
    full = np.array([[[True, True]], [[True, False]], [[True, True]]])
    mesh = boxes((-0.03, -0.004, 0.004, 0.03), (-0.03, 0.03), (-0.025, -0.005, 0.01), full, 4000)
    corners = ((0.014, 0.0, 0.014), (0.014, 0.0, 0.0), (0.012, 0.0, -0.012), (-0.002, 0.0, -0.017),
               (-0.014, 0.0, -0.012), (-0.02, 0.0, 0.0))  # fmt: skip
    path = line(*corners, step=3e-4)
    feet, moved = mesh_run(mesh, path), np.linalg.norm(np.diff(path, axis=0), axis=1)
    rolls = np.maximum(-feet[:-1, 8], 0.0) * np.linalg.norm(np.diff(feet[:, 3:6], axis=0), axis=1)
    share = rolls / np.maximum(EASY * moved, FASTEST * 1e-3)
    assert 0.9 < share.max() <= 1.0


def notched(turn):
    """A sheet with a notch 0.1 mm deep along y, one wall of which is steep and the other flat; turned."""
    profile = np.array([(-20, 0), (-0.06, 0), (0, -0.1), (0.5, 0), (20, 0)]) * 1e-3
    ways = np.linspace(-20e-3, 20e-3, 41)
    points = np.array([(x, y, z) for y in ways for x, z in profile])
    i = (np.arange(40)[:, None] * 5 + np.arange(4)).ravel()
    triangles = np.concatenate([np.stack([i, i + 1, i + 6], 1), np.stack([i, i + 6, i + 5], 1)])
    return Mesh(points @ turn.T, triangles.astype(np.int32))


@pytest.mark.parametrize("seed", range(6))
def test_the_gap_below_a_notch_does_not_leap_between_its_walls(seed):
    """The bottom of the notch is nearest, and belongs to both walls: of the flat one, on the face of the foot, and of
    the steep one, on another face. The gap of a finger that slides 3 mm below was that of the bottom for one and that
    of the foot for the other, 0.1 mm deeper, in turns: 0.6 N of a viscous fingertip at 10 kHz. The distance from the
    bottom changes by up to 0.26 of the finger's motion."""
    turn = Rotation.random(random_state=seed).as_matrix()
    path = line((-5e-3, -1e-3, 5e-3), (-3e-3, -1e-3, -3e-3), (3e-3, 1e-3, -3e-3), step=27e-6)
    below = np.flatnonzero(path[:, 2] <= -3e-3 + 1e-9)[1:]
    feet = mesh_run(notched(turn), path @ turn.T, thickness=4e-3, dt=1e-4)
    moved = np.linalg.norm(np.diff(path[below], axis=0), axis=1)
    changes = np.abs(np.diff(feet[below, 8])) / moved
    assert 0.2 < changes.max() < 0.3
    assert feet[below, 8].max() > -2.9e-3 and feet[below[[0, -1]], 8] == approx(-3e-3, abs=3e-5)
