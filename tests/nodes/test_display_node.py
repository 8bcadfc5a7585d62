"""The display node on the test bus, and the simulated force sensor that drives it."""

import numpy as np
import pytest
from formulas import pad_pressure
from pytest import approx

from palpate.launch.testing import FakeBus
from palpate.messages import Contact, Pins, Surface, pack
from palpate.nodes.base import SettingError
from palpate.nodes.base.surface import surface_mesh
from palpate.nodes.display import PinArray, tangent_frame
from palpate.nodes.display.pin_array import next_frame
from palpate.nodes.sensor import ForceSensor
from palpate.physics.display.pins import pin_grid
from palpate.physics.display.shape_display import FINGERPADS, pad_contact, pad_displacement
from palpate.physics.materials.nodule import nodule_centre, stiffness_map

QUICK = {"rate": 1e3, "actuator_rate": 1e3, "stroke": 0.05}
FLAT = {"surface": "plane", "vertices": 10000, "position": (0.0, 0.0, 0.0)}
DISTANCE = np.hypot(*pin_grid(6, 6, 2e-3).reshape(-1, 2).T).reshape(6, 6)


def touch(force, compression=0.0, indentation=0.0, foot=(0, 0, 0), normal=(0, 0, 1)):
    return Contact(
        foot=foot, normal=normal, force=force, compression=compression, indentation=indentation,
        compression_rate=0.0, indentation_rate=0.0,
    )  # fmt: skip


def body(nodes, displacement, pressure=()):
    return Surface(
        nodes=nodes, displacement=displacement, stiffness=1.0, exponent=1.5, damping=0.0,
        rest_indentation=0.0, previous_indentation=0.0,
        pressure=pressure,
    )  # fmt: skip


def one(node, contact, surface=None):
    held = {} if surface is None else {"surface": surface}
    (answer,) = FakeBus(node, **held).publish(contact)
    return answer


def test_the_pins_show_the_fingerpad_and_the_actuator_the_approach():
    for force, valid in [(0.05, True), (1.0, False), (4.0, False)]:
        pins = one(PinArray(**QUICK), touch(force))
        state = pad_contact(force, 15e3)
        assert pins.heights == approx(pad_displacement(DISTANCE, state))
        assert pins.actuator == approx(float(state.approach))
        assert (pins.valid, pins.limited) == (valid, False)


def test_settings_choose_finger_tissue_and_grid():
    node = PinArray(
        pad="calibrated", pad_m=400.0, modulus=40e3, poisson=0.4, curvature=20.0, rows=2, columns=3, **QUICK
    )
    pins = one(node, touch(0.3))
    pad = FINGERPADS["calibrated"]._replace(m=400.0)
    state = pad_contact(0.3, 40e3, 0.4, 0.05, pad)
    r = np.hypot(*pin_grid(2, 3, 2e-3).reshape(-1, 2).T).reshape(2, 3)
    assert pins.heights == approx(pad_displacement(r, state)) and pins.heights.shape == (2, 3)


def test_zero_force_gives_flat_pins_and_a_negative_one_is_flagged():
    bus = FakeBus(PinArray(**QUICK))
    nothing, tiny, negative = bus.publish(touch(0.0), touch(1e-9), touch(-1.0))
    assert not nothing.heights.any() and nothing.actuator == 0 and nothing.valid
    assert 0 < tiny.heights.max() < 1e-6
    assert not negative.heights.any() and negative.actuator == 0 and not negative.valid


def test_a_short_stroke_moves_the_mean_into_the_actuator():
    free = one(PinArray(**QUICK), touch(1.0))
    short = one(PinArray(**QUICK | {"stroke": 0.5e-3}), touch(1.0))
    assert short.limited and short.heights.min() >= 0 and short.heights.max() <= 0.5e-3
    assert short.heights.mean() - short.actuator == approx(free.heights.mean() - free.actuator, abs=1e-12)


def test_pins_keep_their_speed_limit_with_any_step():
    bus = FakeBus(PinArray(rate=0.05, actuator_rate=0.2))
    bus.late(0.03)
    answers = bus.publish(*(touch(2.0) for _ in range(60)))
    times = np.array([a.time for a in answers]) * 1e-9
    heights = np.array([a.heights for a in answers])
    actuator = np.array([a.actuator for a in answers])
    steps = np.maximum(np.diff(times), 0.0)
    assert np.all(np.abs(np.diff(heights, axis=0)).max(axis=(1, 2)) <= 0.05 * steps + 1e-15)
    assert np.all(np.abs(np.diff(actuator)) <= 0.2 * steps + 1e-15)


def test_duplicate_and_late_messages_move_nothing_backwards():
    bus = FakeBus(PinArray(rate=0.05))
    bus.twice()
    first, again = bus.publish(touch(1.0))
    assert pack(first) == pack(again)
    bus.swap()
    for answer in bus.publish(touch(1.0), touch(1.0)):
        assert np.all(answer.heights >= first.heights)


def test_shape_memory_pins_lag_and_cool_slowly():
    bus = FakeBus(PinArray(rate=1e3, rise_time=0.05, fall_time=0.2), rate=100.0)
    up = bus.publish(*(touch(0.5) for _ in range(5)))[-1]
    goal = pad_displacement(DISTANCE, pad_contact(0.5, 15e3))
    assert up.heights == approx(goal * (1 - np.exp(-1.0)))
    down = bus.publish(*(touch(0.0) for _ in range(20)))[-1]
    assert down.heights == approx(up.heights * np.exp(-1.0))


def test_heights_are_multiples_of_the_resolution():
    pins = one(PinArray(resolution=0.1e-3, **QUICK), touch(1.0))
    assert pins.heights / 0.1e-3 == approx(np.rint(pins.heights / 0.1e-3))
    assert pins.heights == approx(pad_displacement(DISTANCE, pad_contact(1.0, 15e3)), abs=0.051e-3)


def test_the_same_run_gives_the_same_bytes():
    contacts = [touch(f) for f in np.linspace(0, 3, 40)]
    runs = [FakeBus(PinArray(rise_time=0.02)).publish(*contacts) for _ in range(2)]
    assert [pack(a) for a in runs[0]] == [pack(a) for a in runs[1]]


# --- below the surface -----------------------------------------------------------------------------------------------


def springs(hard, force=0.3, reach=6.8e-3):
    """Surface of springs F = 3000 k u^1.5 that share a force by a biweight kernel, like a body."""
    mesh = surface_mesh("plane", 10000)
    weight = mesh.areas * np.maximum(1 - (np.linalg.norm(mesh.vertices, axis=1) / reach) ** 2, 0) ** 2
    inward = (force * weight / weight.max() / (3000.0 * hard)) ** (2 / 3)
    nodes = np.flatnonzero(inward > 0)
    return body(nodes, -inward[nodes, None] * mesh.normals[nodes]), float(inward.max())


def test_a_nodule_is_visible_on_the_pins_at_its_position():
    mesh = surface_mesh("plane", 10000)
    centre = nodule_centre(mesh.vertices, mesh.normals, [3e-3, 1e-3, 0.0], 6e-3)
    plain, sunk = springs(np.ones(len(mesh.vertices)))
    lumpy, _ = springs(stiffness_map(mesh.vertices, mesh.normals, centre, 3e-3, 10.0, 6e-3))
    node = {"shows": "surface", "rows": 8, "columns": 8} | QUICK | FLAT
    contact = touch(0.3, 1.8e-3, sunk)
    rise = one(PinArray(**node), contact, lumpy).heights - one(PinArray(**node), contact, plain).heights
    row, column = np.unravel_index(np.argmax(rise), rise.shape)
    assert pin_grid(8, 8, 2e-3)[row, column] == approx([2e-3, 1e-3], abs=1.01e-3)  # between it and the finger at 0
    assert rise.max() > 0.1e-3
    assert rise[0] == approx(np.zeros(8), abs=1e-6)


def test_the_actuator_shows_the_approach_of_a_simulated_body():
    plain, sunk = springs(np.ones(10000))
    pins = one(PinArray(shows="surface", **QUICK, **FLAT), touch(0.3, 1.8e-3, sunk), plain)
    assert pins.valid and pins.actuator == approx(1.8e-3 + sunk)
    assert pins.heights[2:4, 2:4] == approx(1.8e-3, rel=0.05)  # the fingerpad deforms by its compression


def test_a_hertz_pressure_on_the_mesh_gives_the_pins_of_the_force():
    mesh = surface_mesh("plane", 10000)
    state = pad_contact(1.0, 60e3)
    r = np.linalg.norm(mesh.vertices, axis=1)
    nodes = np.flatnonzero(r < state.radius)
    sent = body(nodes, np.zeros((len(nodes), 3)), pad_pressure(r[nodes], state))
    pins = one(PinArray(shows="pressure", **QUICK, **FLAT), touch(1.0, 2e-3, 1e-3), sent)
    assert pins.valid
    assert pins.heights[1:5, 1:5] == approx(pad_displacement(DISTANCE, state)[1:5, 1:5], rel=0.03)


@pytest.mark.parametrize("shows", ["surface", "pressure"])
def test_without_a_body_the_shape_comes_from_the_force_and_is_flagged(shows):
    bus = FakeBus(PinArray(shows=shows, **QUICK, **FLAT))
    (pins,) = bus.publish(touch(0.05, 1e-3, 2e-3))
    assert pins.heights == approx(pad_displacement(DISTANCE, pad_contact(0.05, 15e3))) and not pins.valid


def test_a_body_of_another_mesh_is_an_error_with_a_remedy():
    sent = body([20000], [[0.0, 0.0, -1e-3]])
    with pytest.raises(SettingError, match="has 10000 vertices, but the tissue sends vertex 20000"):
        one(PinArray(shows="surface", **FLAT), touch(0.3, 1e-3, 1e-3), sent)


@pytest.mark.parametrize("normal", [(0, 0, 1), (1, 0, 0), (0, -1, 0), (0.6, 0, 0.8), (-0.999, 0.0447101778, 0)])
def test_the_frame_of_the_pins_is_orthonormal_and_right_handed(normal):
    frame = tangent_frame(normal)
    assert frame @ frame.T == approx(np.eye(3), abs=1e-9) and np.linalg.det(frame) == approx(1.0)


def test_the_frame_of_the_pins_turns_continuously_with_the_normal():
    """A rule by the normal alone turned it by 90 degrees where the normal comes within 26 degrees of x."""
    frame, turns = None, []
    for angle in np.linspace(0.0, 1.5, 400):
        normal = (np.sin(angle) * np.cos(0.3), np.sin(angle) * np.sin(0.3), np.cos(angle))
        last, frame = frame, next_frame(frame, normal)
        assert frame @ frame.T == approx(np.eye(3), abs=1e-9) and frame[2] == approx(normal)
        turns.append(0.0 if last is None else np.abs(frame - last).max())
    assert max(turns) < 1.01 * 1.5 / 399
    # back on the same path: no turn about the normal is left
    for angle in np.linspace(1.5, 0.0, 400):
        frame = next_frame(frame, (np.sin(angle) * np.cos(0.3), np.sin(angle) * np.sin(0.3), np.cos(angle)))
    assert frame == approx(tangent_frame((0.0, 0.0, 1.0)), abs=1e-9)


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"shows": "nothing"}, "'shows'"),
        ({"rows": 0}, "'rows'"),
        ({"pitch": 0.0}, "'pitch' .m.: found 0.0"),
        ({"modulus": -1.0}, "'modulus' .Pa."),
        ({"curvature": -125.0}, "'curvature' .1/m.: found -125.0, expected more than -125"),
    ],
)
def test_wrong_settings_are_errors_with_their_names(given, text):
    with pytest.raises(SettingError, match=text):
        PinArray(**given)


# --- the sensor ------------------------------------------------------------------------------------------------------


def test_the_sensor_follows_its_points_and_then_holds():
    bus = FakeBus(ForceSensor(times=(0, 1, 2), forces=(0, 4, 1)), rate=10.0)
    forces = [m.force for m in bus.run(25)]
    assert forces == approx(np.interp(np.arange(25) / 10, [0, 1, 2], [0, 4, 1]))


def test_the_sensor_repeats_on_request():
    bus = FakeBus(ForceSensor(times=(0, 1), forces=(0, 2), repeat=True), rate=4.0)
    assert [m.force for m in bus.run(9)] == approx([0, 0.5, 1, 1.5, 2, 0.5, 1, 1.5, 2])


def test_a_press_of_4_newtons_drives_the_display():
    sensor = FakeBus(ForceSensor(), rate=100.0)
    display = FakeBus(PinArray(), rate=100.0)
    pins = [a for m in sensor.run(500) for a in display.publish(m)]
    assert all(isinstance(a, Pins) for a in pins)
    actuator = np.array([a.actuator for a in pins])
    assert actuator.argmax() <= 310 and actuator.max() == approx(16.21917e-3, abs=1e-7)
    assert pins[0].heights.max() == 0 and pins[0].valid and not pins[250].valid


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"times": (0, 1)}, "found 2 times and 4 forces"),
        ({"times": (0, 0), "forces": (1, 1)}, "expected finite increasing times"),
        ({"times": (0, 1), "forces": (0, -1)}, "expected finite forces >= 0"),
        ({"normal": (0, 0, 0)}, "expected a direction"),
    ],
)
def test_invalid_forces_of_the_sensor_are_errors(given, text):
    with pytest.raises(SettingError, match=text):
        ForceSensor(**given)


def test_a_force_beyond_hertz_theory_is_noted_once():
    bus = FakeBus(PinArray(**QUICK))
    notes = []
    for force in (0.05, 5.0, 5.0, 0.0, 6.0):
        (pins,) = bus.publish(touch(force))
        assert pins.valid == (force < 1.0)
        notes += bus.node.notes()
    assert len(notes) == 1 and "at 5 N the contact is wider" in notes[0]
