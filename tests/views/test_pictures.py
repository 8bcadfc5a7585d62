"""Pictures of a recording: their data, and that they are drawn if the recording or the machine is incomplete."""

import importlib.util
import math
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from msgspec import structs
from shell_text import unwrapped
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.messages import Contact, DeviceState, Force, Friction, Pose, Proximity, Surface, pack
from palpate.messages.base import HEADER
from palpate.messages.contact import OrganContact
from palpate.nodes.base import Stream
from palpate.nodes.logger import Mcap
from palpate.physics.geometry.mesh import plane
from palpate.records import stored
from palpate.records.reader import Recording
from palpate.records.stored import RecordingError
from palpate.views.pictures import PictureError, compression, deformation, draw_pictures, force, pictures
from palpate.views.pictures.device import absorbed_energy
from palpate.views.pictures.friction import _stretches, regions
from palpate.views.pictures.style import COLUMNS, decimate, figure, mean
from palpate.views.pictures.touch import TouchStreams, millijoules, together, touches, work
from palpate.views.shown import Bodies
from palpate.views.surface import off_screen, render
from palpate.views.surface.moments import bodies_of, choose, displace_vertices, instants, mean_drag

UP = (0.0, 0.0, 1.0)
PLOTS = ["force.png", "compression.png", "friction.png", "device.png"]


def record(path, streams, plan=None):
    """A recording with these messages by stream, one message per tick of 1 ms."""
    log = Mcap(path=str(path))
    printed = tuple(Stream(name, type(messages[0]), name, 1) for name, messages in streams.items())
    log.listen(printed, {"plan": plan or {"nodes": []}})
    log.start()
    for name, messages in streams.items():
        for tick, message in enumerate(messages):
            header = {"tick": tick, "time": tick * 1_000_000, "source": name}
            log.observe(name, tick, pack(type(message)(**{f: getattr(message, f) for f in own_of(message)}, **header)))
    log.stop()
    return path


def own_of(message):
    return [name for name in message.__struct_fields__ if name not in HEADER]


def press(depth, force=None, foot=(0.0, 0.0, 0.105)):
    """A contact with this indentation [m]; its default force is that of a spring."""
    return Contact(
        foot=foot,
        normal=UP,
        force=300.0 * depth if force is None else force,
        compression=depth / 2,
        indentation=depth,
        compression_rate=0.0,
        indentation_rate=0.0,
    )


def near(depth, slip, foot=(0.0, 0.0, 0.105)):
    approach = 1.5 * depth
    return Proximity(
        foot=foot, normal=UP, coordinates=(0.0, 0.0), element=0, gap=4e-3 - approach, approach=approach, slip=slip
    )


def surface(nodes=(), displacement=()):
    return Surface(
        nodes=np.array(nodes, dtype=np.int32),
        displacement=np.reshape(displacement, (-1, 3)),
        stiffness=3e3,
        exponent=1.5,
        damping=5.0,
        rest_indentation=0.0,
        previous_indentation=0.0,
    )


@pytest.fixture
def without_3d(monkeypatch):
    """Simulate a machine without pyvista."""
    hide(monkeypatch, "pyvista")


def hide(monkeypatch, *names):
    there = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *more: None if name in names else there(name, *more))


def drawn(recording, folder):
    """Names of the pictures, and the warnings."""
    lines: list[str] = []
    made = draw_pictures(recording, folder, lines.append)
    for path in made:
        assert path.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    return [path.name for path in made], lines


@pytest.fixture(scope="module")
def touch_file(tmp_path_factory):
    """A short touch of the kidney, a press and a stroke."""
    file = tmp_path_factory.mktemp("touch") / "kidney.mcap"
    sets = (
        "scene.surface.vertices=1500",
        "scene.hand.begin=[-0.02, 0, 0.111]",
        "scene.hand.path=[{to: [-0.02, 0, 0.098], time: 0.15}, {to: [0.02, 0, 0.097], time: 0.3},"
        " {to: [0.02, 0, 0.115], time: 0.15}]",
    )
    outcome = execute(find("kidney").but(record=file, overrides=sets, place="fused", duration=0.65))
    assert outcome.result.ok
    return file


# Data of the pictures


def strokes(rng, noise=0.0):
    """Rest, then A: 50 mm/s at 0.5 to 2 N, then B: 1.5 N at 60 to 200 mm/s, then no contact; 1 s each."""
    time = np.arange(4000) * 1e-3
    normal = np.r_[np.full(1000, 1.0), np.linspace(0.5, 2.0, 1000), np.full(1000, 1.5), np.zeros(1000)]
    speed = np.r_[np.zeros(1000), np.full(1000, 0.05), np.linspace(0.06, 0.2, 1000), np.full(1000, 0.2)]
    return time, normal + noise * rng.normal(size=4000), speed * (1.0 + noise * rng.normal(size=4000))


@pytest.mark.parametrize("noise", [0.0, 0.03])
def test_regions_a_and_b_are_found(noise):
    a, b = regions(*strokes(np.random.default_rng(1), noise))
    assert abs(a.start - 1000) < 40 and abs(a.stop - 2000) < 60
    assert abs(b.start - 2000) < 40 and abs(b.stop - 3000) < 40


def test_without_a_suitable_stroke_no_region_is_found():
    time, normal, speed = strokes(np.random.default_rng(1))
    assert regions(time, np.full(4000, 1.0), np.full(4000, 0.05)) == (None, None)
    assert regions(time, np.zeros(4000), speed) == (None, None)
    assert regions(time, normal, np.zeros(4000)) == (None, None)
    assert regions(time[:0], normal[:0], speed[:0]) == (None, None)
    falling = regions(time, np.full(4000, 1.5), np.linspace(0.2, 0.06, 4000))
    assert falling[1] is None, "the speed falls"
    assert regions(time, normal, speed, beyond=0.3)[1] is None, "all speeds are within the dip"


def test_regions_do_not_depend_on_the_unit_of_time_steps():
    time, normal, speed = strokes(np.random.default_rng(1))
    a, b = regions(time[::4], normal[::4], speed[::4])
    assert abs(4 * a.start - 1000) < 40 and abs(4 * b.stop - 3000) < 40


def test_stretches_equal_a_brute_force_search():
    rng = np.random.default_rng(3)
    for _ in range(40):
        held, allowed = rng.uniform(1.0, 1.6, 40), rng.random(40) < 0.9
        fits = {
            (i, j)
            for i in range(40)
            for j in range(i + 1, 41)
            if allowed[i:j].all() and held[i:j].max() <= 1.25 * held[i:j].min()
        }
        longest = {(i, j) for i, j in fits if (i - 1, j) not in fits and (i, j + 1) not in fits}
        assert set(_stretches(held, allowed, 1.25)) == longest


def test_the_area_of_a_loop_is_the_dissipated_work():
    angle = np.linspace(0.0, 2 * np.pi, 20001)
    assert work(5e-3 - 5e-3 * np.cos(angle), 1.0 + np.sin(angle)) == pytest.approx(math.pi * 5e-3, rel=1e-6)
    time = np.linspace(0.0, 0.4, 40001)  # a body K s^1.5 (1 + c s') loses the integral of K s^1.5 c s'^2
    s, rate = 8e-3 * np.sin(np.pi * time / 0.4) ** 2, 8e-3 * np.pi / 0.4 * np.sin(2 * np.pi * time / 0.4)
    lost = np.trapezoid(3e3 * s**1.5 * 5.0 * rate**2, time)
    assert work(s, 3e3 * s**1.5 * (1.0 + 5.0 * rate)) == pytest.approx(lost, rel=1e-6)


def test_the_absorbed_energy_is_the_work_of_the_sent_forces():
    """Each force acts until the next pose. The controller's `energy` pairs it with an older position."""
    force = {"tick": np.array([1, 2, 4]), "force": np.array([[0, 0, 1.0], [0, 2.0, 0], [0, 0, 5.0]])}
    pose = {
        "tick": np.arange(5),
        "position": 1e-3 * np.array([[9, 9, 9], [0, 0, 0], [1, 0, -2], [7, 7, 7], [0, 3, 0.0]]),
    }
    assert absorbed_energy(force, pose) == pytest.approx([0.0, 2e-3, 2e-3 - 6e-3])
    assert absorbed_energy(force, {key: column[:4] for key, column in pose.items()}) is None


@pytest.mark.parametrize(
    ("energy", "text"),
    [(2.41e-3, "2.4 mJ"), (4.5e-5, "0.045 mJ"), (-7.2e-5, "-0.072 mJ"), (3e-11, "0 mJ"), (0.0, "0 mJ")],
)
def test_a_small_energy_is_not_printed_as_zero(energy, text):
    assert millijoules(energy) == text


def test_the_page_on_pictures_lists_run_and_fingertip_separately():
    text = (Path(__file__).parents[2] / "docs" / "pictures.md").read_text(encoding="utf-8")
    run, fingertip = ([line.split("`")[1] for line in part.splitlines() if line.startswith("| `")]
                      for part in text.split("## Pictures of the finite-element fingertip"))  # fmt: skip
    assert len(set(run)) == len(run) and fingertip == ["force.png", "strain.png", "isostrain.png", "flow.png"]


def test_a_short_loss_of_contact_does_not_end_a_touch():
    time = np.arange(1000) * 1e-3
    force = np.zeros(1000)
    force[100:300] = force[320:400] = force[600:700] = 1.0
    assert touches(time, force) == [slice(99, 401), slice(599, 701)]
    assert touches(time, np.ones(1000)) == [slice(0, 1000)]
    assert touches(time, np.zeros(1000)) == [] == touches(time[:0], force[:0])


def test_streams_of_different_rates_are_joined_by_tick():
    fast = {"tick": np.arange(10), "x": np.arange(10.0)}
    slow = {"tick": np.arange(0, 12, 3), "y": np.arange(4.0)}
    a, b = together(fast, slow)
    assert a["x"].tolist() == [0.0, 3.0, 6.0, 9.0] and b["y"].tolist() == [0.0, 1.0, 2.0, 3.0]


def test_the_running_mean_of_a_straight_line_is_that_line():
    time = np.arange(200) * 1e-3
    np.testing.assert_allclose(mean(3.0 - 2.0 * time, time), 3.0 - 2.0 * time, rtol=1e-12)
    wave = np.sin(2 * np.pi * 100 * time)
    assert np.abs(mean(wave, time, 0.02)[20:-20]).max() < 0.06
    assert mean(time[:2], time[:2]).tolist() == time[:2].tolist()


def test_the_displacements_are_assigned_to_their_vertices(tmp_path):
    rng = np.random.default_rng(5)
    depths = np.r_[np.zeros(5), np.linspace(1e-3, 8e-3, 20), np.linspace(7e-3, 0.0, 20)]
    nodes = [np.sort(rng.choice(200, size=7, replace=False)) if depth else [] for depth in depths]
    moved = [rng.normal(scale=1e-3, size=(len(some), 3)) for some in nodes]
    settings = {"surface": "sphere", "vertices": 200, "position": [0.01, 0.0, 0.084]}
    kind = "palpate.nodes.deformation.mass_spring.MassSpring"
    file = record(
        tmp_path / "r.mcap",
        {
            "contact": [press(depth) for depth in depths],
            "near": [near(depth, (0.0, 0.0, 0.0)) for depth in depths],
            "body": [surface(some, field) for some, field in zip(nodes, moved, strict=True)],
        },
        {
            "nodes": [
                {"name": "body", "use": "deformation.MassSpring", "class": kind, "settings": settings},
                *({"name": name, "class": f"nowhere.{name}", "settings": {}} for name in ("contact", "near")),
            ]
        },
    )
    touch = TouchStreams(Recording(file))
    shown = bodies_of(touch)
    mesh = shown.mesh
    assert abs(len(mesh.vertices) - 200) < 40
    assert (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0))[0] / 2 == pytest.approx(0.01, abs=1e-3)
    chosen = instants(touch, shown, 6)
    assert len(chosen) == 6 and max(one.depth for one in chosen) == depths.max()
    for one in chosen:
        tick = round(one.time * 1e3)
        assert one.depth == depths[tick] and one.loads == pytest.approx([300.0 * depths[tick]])
        assert (one.displacement[nodes[tick]] == moved[tick]).all()
        others = np.delete(one.displacement, nodes[tick], axis=0)
        assert (others == 0.0).all()
        assert one.tips[0][2] == pytest.approx(0.105 - depths[tick], abs=1e-12)  # at the bottom of the indentation


@pytest.mark.parametrize("normal", [(0.0, 0.0, 1.0), (0.0, 0.6, 0.8), (-1.0, 0.0, 0.0)])
def test_the_fingertip_is_drawn_in_the_indentation_moved_by_friction(normal):
    x, y = np.meshgrid(np.linspace(-0.04, 0.04, 81), np.linspace(-0.04, 0.04, 81))
    frame = np.linalg.svd(np.array([normal]))[2]  # its rows: the normal and two directions along the surface
    vertices = x.ravel()[:, None] * frame[1] + y.ravel()[:, None] * frame[2]
    feet = np.array([0.010 * frame[1], -0.015 * frame[2]])
    away = np.linalg.norm(vertices[:, None] - feet, axis=2)
    pulled = np.array([7e-3 * frame[1] - 3e-3 * frame[2], 2e-3 * frame[2]])
    moved = np.exp(-((away / 0.008) ** 2)) @ (pulled - 9e-3 * np.array(normal))
    found = mean_drag(vertices, moved, feet, np.array([normal, normal]))
    assert found @ normal == pytest.approx(0.0, abs=1e-12)
    # (1 - exp(-x))/x with x = (4/8)²: the mean of the Gaussian over a disc with a radius of 4 mm
    share = (1.0 - np.exp(-0.25)) / 0.25
    assert found == pytest.approx(share * pulled, abs=3e-4)
    far = mean_drag(vertices, 0.0 * moved, np.array([[np.nan] * 3, feet[0]]), np.array([normal, normal]))
    assert not far.any()


def test_a_surface_without_displacement_is_not_drawn(tmp_path):
    streams = {"contact": [press(1e-3)] * 5, "body": [surface()] * 5}
    with pytest.raises(PictureError, match="no displacement was recorded"):
        instants(TouchStreams(Recording(record(tmp_path / "r.mcap", streams))), Bodies(["body"], [plane(0.1, 100)], {}))


def test_a_vertex_outside_the_mesh_is_an_error():
    with pytest.raises(PictureError, match="vertex 12 is displaced, but the mesh has only 12"):
        displace_vertices(surface([12], np.ones((1, 3))), 12)


def test_all_instants_are_in_contact_and_include_the_deepest():
    depth = np.r_[np.zeros(50), 5e-3 * np.sin(np.linspace(0, np.pi, 200)), np.zeros(100), np.full(100, 2.5e-3)]
    contact = {
        "tick": np.arange(450) + 7,
        "time": np.arange(450) * 1e-3,
        "force": 300.0 * depth,
        "indentation": depth,
        "foot": np.zeros((450, 3)),
    }
    ticks = choose(contact, 6)
    assert ticks == sorted(set(ticks)) and len(ticks) == 6
    assert all(depth[tick - 7] > 0.3 * depth.max() for tick in ticks)
    assert any(depth[tick - 7] == depth.max() for tick in ticks) and any(tick - 7 >= 350 for tick in ticks)
    assert choose({name: values[:20] for name, values in contact.items()}, 6) == []


@pytest.mark.parametrize(
    ("length", "scale"), [(9.04e-3, 10e-3), (8e-3, 8e-3), (0.0, 1e-3), (3e-9, 5e-9), (0.13, 0.2), (1e-3, 1e-3)]
)
def test_the_colour_scale_ends_at_a_round_number(length, scale):
    assert deformation.round_up(length) == pytest.approx(scale, rel=1e-12)


def test_the_finger_on_a_small_surface_is_inside_the_picture():
    """In the wide view, every point of the ball is within the picture, along the axes of the camera."""
    rng = np.random.default_rng(7)
    around = rng.normal(size=(500, 3))
    around /= np.linalg.norm(around, axis=1)[:, None]
    tip = np.array([0.0, 0.0, 8e-3])
    centre = tip + render.FINGER_RADIUS * np.array(UP)
    shot = (None, None, tip[None], np.array([UP]), np.zeros((1, 3)))
    camera = render.place_camera(render.SIZE, 8e-3 * around, centre[None], np.zeros((0, 3)), shot, near=False)
    ahead = camera.focus - camera.position
    right = np.cross(ahead, UP)
    up = np.cross(right, ahead)
    seen = np.concatenate([8e-3 * around, centre + render.FINGER_RADIUS * around]) - camera.focus
    height, width = (np.abs(seen @ axis / np.linalg.norm(axis)).max() for axis in (up, right))
    assert 0.8 * camera.reach < height < camera.reach
    assert width < camera.reach * render.SIZE[0] / render.SIZE[1]


# Drawing


def test_all_pictures_of_a_touch_are_made_without_a_display(touch_file, tmp_path, monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    made, printed = drawn(touch_file, tmp_path / "new" / "folder")
    assert made[-4:] == PLOTS
    if made[0] == "deformation.png":
        assert printed == []
    else:
        assert len(printed) == 1 and "libosmesa6" in printed[0]


def test_without_pyvista_the_plots_are_drawn_with_one_hint(touch_file, tmp_path, without_3d):
    made, printed = drawn(touch_file, tmp_path)
    assert made == ["path.png", *PLOTS]
    assert len(printed) == 1 and 'pip install "palpate[view]"' in printed[0]


def test_older_pictures_in_the_folder_are_reported(touch_file, tmp_path, without_3d):
    for name in ("deformation.png", "force.png", "force-contact-2.png", "mine.png"):
        (tmp_path / name).write_bytes(b"")
    made, printed = drawn(touch_file, tmp_path)
    assert made == ["path.png", *PLOTS]
    assert f"older pictures in {tmp_path}, not redrawn: deformation.png, force-contact-2.png" in printed


@pytest.mark.parametrize("indentation, panels", [(1e-8, 1), (1e-4, 2)])
def test_a_nearly_rigid_tissue_has_no_panel(tmp_path, indentation, panels):
    shape = np.sin(np.linspace(0, np.pi, 200))
    contacts = [structs.replace(press(indentation * x, 2.0 * x), compression=3e-3 * x) for x in (0.0, *shape, 0.0)]
    touch = TouchStreams(Recording(record(tmp_path / "r.mcap", {"contact": contacts})))
    assert len(force.draw_picture(touch).axes) == panels


def test_the_rendering_timeout_grows_per_picture_and_its_error_has_a_remedy(monkeypatch):
    given = []

    def communicate(timeout=None):
        given.append(timeout)
        raise subprocess.TimeoutExpired("vtk", timeout)

    monkeypatch.setattr(off_screen.Rendering, "_begin", lambda self, window: SimpleNamespace(communicate=communicate))
    at = {"tips": np.zeros((1, 3)), "normals": np.zeros((1, 3)), "forces": np.zeros((1, 3))}
    instants = [SimpleNamespace(displacement=np.zeros((4, 3)), **at)] * 10
    body = SimpleNamespace(vertices=np.zeros((4, 3)), triangles=np.zeros((0, 3), int))
    with pytest.raises(PictureError, match="busy, draw it later with `palpate picture FILE`"):
        off_screen.Rendering(body, instants, [np.zeros(4)] * 10, [0, 1], 1e-3).pixels()
    assert given == [60.0 + 2.0 * 12]


def test_without_matplotlib_there_is_one_hint(touch_file, tmp_path, monkeypatch):
    hide(monkeypatch, "matplotlib")
    made, printed = drawn(touch_file, tmp_path)
    assert made == [] and len(printed) == 1 and 'pip install "palpate[view]"' in printed[0]


@pytest.mark.parametrize("end", ["import os; os.abort()", "raise SystemExit('no context')"])
def test_the_plots_survive_a_crash_of_the_graphics_driver(touch_file, tmp_path, monkeypatch, end):
    import subprocess

    def crash(self, window):
        return subprocess.Popen([sys.executable, "-c", end], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)

    monkeypatch.setattr(off_screen.Rendering, "_begin", crash)
    made, printed = drawn(touch_file, tmp_path)
    assert made == ["path.png", *PLOTS]
    assert len(printed) == 1 and "libosmesa6" in printed[0] and ("signal 6" in printed[0] or "no context" in printed[0])


def test_a_truncated_recording_is_drawn_up_to_its_end(touch_file, tmp_path, without_3d):
    data = touch_file.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(data[: int(0.7 * len(data))])
    made, _ = drawn(cut, tmp_path)
    assert "force.png" in made
    assert not Recording(cut).complete


def test_pictures_show_only_the_touch_of_a_long_recording(tmp_path):
    depths = [*[0.0] * 3000, *[1e-3] * 500, *[0.0] * 3000]
    touch = TouchStreams(Recording(record(tmp_path / "r.mcap", {"a": [press(depth) for depth in depths]})))
    begin, end = touch.shown
    assert 2.85 < begin < 3.0 and 3.5 < end < 3.65
    drawn = compression.draw_picture(touch)
    assert drawn.axes[1].get_xlim() == (begin, end) and "0 to 6 s" in drawn.axes[1].get_xlabel()
    part = record(tmp_path / "s.mcap", {"a": [press(depth) for depth in depths[2800:3700]]})
    assert TouchStreams(Recording(part)).shown is None


def test_only_the_contacts_of_a_long_recording_are_read(tmp_path):
    depths = [*[-1e-3] * 2000, *[1e-3] * 300, *[-1e-3] * 2000]
    poses = [Pose(position=(0.0, 0.0, 1e-3 * k), velocity=UP, dt=1e-3) for k in range(len(depths))]
    file = record(tmp_path / "r.mcap", {"a": [press(max(depth, 0.0)) for depth in depths], "b": poses})
    touch = TouchStreams(Recording(file))
    begin, end = touch.shown
    for columns in (touch.contact, touch[Pose]):
        assert columns["time"][0] == pytest.approx(begin) and columns["time"][-1] == pytest.approx(end)
        assert 500 <= len(columns["tick"]) <= 510
    assert touch[Pose]["position"][0, 2] == pytest.approx(begin)
    assert len(TouchStreams(Recording(file), whole=True)[Pose]["tick"]) == len(depths)


def test_a_decimated_line_keeps_the_extremes_of_each_column():
    x = np.arange(500_000) * 1e-3
    y = np.sin(0.01 * x)
    y[[77_777, 400_001]] = 5.0, -7.0
    y[200_000:300_000] = np.nan
    drawing = figure(4.0, 3.0, "long")
    axes = drawing.subplots()
    axes.plot(x, y)
    axes.plot(np.cos(x), np.sin(x))  # not over time: unchanged
    decimate(drawing)
    few, loop = (line.get_data() for line in axes.lines)
    assert len(few[0]) <= 2 * COLUMNS + len(x) // COLUMNS + 1 and len(loop[0]) == len(x)
    assert (np.nanmax(few[1]), np.nanmin(few[1])) == (5.0, -7.0) and (np.diff(few[0]) > 0.0).all()
    assert np.isnan(few[1][(few[0] > 201.0) & (few[0] < 299.0)]).all()
    near = np.interp(few[0], x, np.sin(0.01 * x))
    spikes = np.isin(few[1], (5.0, -7.0)) | np.isnan(few[1])
    assert np.abs(few[1] - near)[~spikes].max() < 1e-9


def test_columns_read_in_blocks_are_the_same(tmp_path, monkeypatch):
    file = record(tmp_path / "r.mcap", {"a": [press(1e-3 * k) for k in range(25)]})
    whole = Recording(file).columns("a")
    monkeypatch.setattr(stored, "BLOCK", 10)
    blocks = Recording(file).columns("a")
    assert list(whole) == list(blocks)
    for name, values in whole.items():
        assert values.dtype == blocks[name].dtype and np.array_equal(values, blocks[name])


def test_instants_are_chosen_of_an_impact_whose_greatest_depth_and_force_are_apart():
    """On a rigid body the indentation is rounding, and largest where the force is small."""
    contact = {
        "time": np.arange(6) * 1e-3, "tick": np.arange(6), "force": np.array([0.0, 9.0, 1e-3, 1e-3, 0.0, 0.0]),
        "indentation": np.array([0.0, 1e-12, 1e-9, 5e-9, 0.0, 0.0]), "foot": np.zeros((6, 3)),
    }  # fmt: skip
    assert choose(contact, 6) == [0, 1, 2, 3, 4]


@pytest.mark.parametrize(("path", "said"), [(0.0, True), (2e-3, True), (10e-3, False), (48e-3, False)])
def test_a_loop_is_dissipated_energy_only_where_the_finger_stays(tmp_path, path, said):
    """A finger that slides to a stiffer place without any loss: the area of its loop is -0.3 mJ."""
    depth = 3e-3 * np.sin(np.linspace(0.0, np.pi, 400))
    along = np.linspace(0.0, path, 400)
    touch = [
        press(d, (300.0 + 100.0 * (k > 200)) * d, (x, 0.0, 0.105))
        for k, (d, x) in enumerate(zip(depth, along, strict=True))
    ]
    record(tmp_path / "r.mcap", {"contact": touch})
    titles = [axes.get_title() for axes in force.draw_picture(TouchStreams(Recording(tmp_path / "r.mcap"))).axes]
    assert [("dissipated" in title) for title in titles] == [said] * len(titles) != []


def test_a_sensor_and_a_probe_without_a_model_have_a_picture_of_force_over_depth(tmp_path):
    depths = [0.0] * 5 + [1e-4 * k for k in range(20)]
    felt = [press(0.0, 300.0 * depth) for depth in depths]
    poses = [Pose(position=(0.0, 0.0, 0.1 - depth), velocity=(0.0, 0.0, 0.0), dt=1e-3) for depth in depths]
    made, _ = drawn(record(tmp_path / "r.mcap", {"sensor": felt, "finger": poses}), tmp_path)
    assert made == ["force.png"]
    figure = force.draw_picture(TouchStreams(Recording(tmp_path / "r.mcap")))
    way, size = figure.axes[0].lines[0].get_data()
    assert way == pytest.approx(1e3 * size / 300.0, abs=1e-9) and way.max() == pytest.approx(1.9)
    assert "depth of the probe" in figure.axes[0].get_xlabel()


@pytest.mark.parametrize(
    ("streams", "expected"),
    [
        ({"a": [DeviceState()] * 3}, []),
        ({"a": [Force(force=UP, state="free", energy=0.0)]}, ["device.png"]),
        ({"a": [press(0.0)] * 3}, []),
        ({"a": [press(1e-3)]}, ["force.png", "compression.png"]),
        ({"a": [press(1e-3)] * 2, "b": [Friction(force=UP, bristle=UP, stick=True)] * 2}, PLOTS[:2]),
        ({"a": [surface()] * 5, "b": [press(1e-3)] * 5}, PLOTS[:2]),
    ],
    ids=["no touch", "one force", "nothing touched", "one contact", "no slip", "unknown body"],
)
@pytest.mark.parametrize("seen", [True, False])
def test_missing_streams_only_remove_their_pictures(tmp_path, streams, expected, seen, monkeypatch):
    if not seen:
        hide(monkeypatch, "pyvista")
    made, printed = drawn(record(tmp_path / "r.mcap", streams), tmp_path)
    assert made == expected and len(printed) <= 1


def organs(force, friction=0.0):
    rest = OrganContact.example(False)
    return structs.replace(rest, force=force, friction=(friction, 0.0, 0.0), area=1e-6, gap=0.0)


def test_organs_that_touch_have_a_picture_with_the_force_of_each_contact(tmp_path):
    found = []
    for contacts in ({"a": [organs(0.0)] * 3}, {"a": [organs(1.0), organs(2.0, 0.5)], "b": [organs(0.0)] * 2}):
        touch = TouchStreams(Recording(record(tmp_path / f"{len(found)}.mcap", contacts)))
        found.append(pictures()["organs"].draw_picture(touch))
    assert found[0] is None
    force, friction = found[1].axes[0].lines
    assert force.get_ydata().tolist() == [1.0, 2.0] and friction.get_ydata().tolist() == [0.0, 0.5]
    assert found[1].axes[1].lines[0].get_ydata().tolist() == [1.0, 1.0]  # mm²


def test_the_command_draws_a_recording(touch_file, tmp_path, without_3d):
    result = CliRunner().invoke(app, ["picture", str(touch_file), "-o", str(tmp_path), "--json"])
    assert result.exit_code == 0 and "friction.png" in result.stdout
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(["path.png", *PLOTS])


def test_the_command_rejects_files_that_are_not_recordings(tmp_path):
    file = tmp_path / "x.mcap"
    file.write_bytes(b"nothing")
    with pytest.raises(RecordingError, match="not an MCAP file"):
        draw_pictures(file, tmp_path)
    result = CliRunner().invoke(app, ["picture", str(file)])
    assert result.exit_code == 2 and "Traceback" not in result.stderr
    empty = record(tmp_path / "e.mcap", {"a": [DeviceState()]})
    result = CliRunner().invoke(app, ["picture", str(empty)])
    assert result.exit_code == 1 and "found a (DeviceState), expected Contact, Force" in result.stderr
    untouched = record(tmp_path / "u.mcap", {"a": [press(0.0)] * 3})
    result = CliRunner().invoke(app, ["picture", str(untouched), "--json"])
    assert result.exit_code == 1 and "the finger touched nothing" in result.output


def test_a_run_without_pictures_prints_the_reason(tmp_path):
    ports = ["--set", "device.port=emulator", "--set", "sensor.port=emulator"]
    given = ["run", "indentation", *ports, "--fused", "--duration", "0.05", "-o", str(tmp_path)]
    result = CliRunner().invoke(app, given)
    assert result.exit_code == 0 and not list(tmp_path.glob("*.png"))
    output_text = unwrapped(result.output)
    assert "no pictures: " in output_text and "nothing to draw: the finger touched nothing" in output_text
