"""The simulated device: the motion of a held grip, its path, faults, and the closed loop through all hand nodes."""

import msgspec
import numpy as np
import pytest
from falcon_arrays import forward, grip_step, inverse, torque
from pytest import approx
from scipy.integrate import solve_ivp

from palpate.launch.testing import FakeBus
from palpate.messages import Contact, Torque
from palpate.nodes.base import SettingError
from palpate.nodes.base.absence import FALL
from palpate.nodes.controller import Haptic
from palpate.nodes.device import Segment, Simulated
from palpate.nodes.kinematics import FalconKinematics, FalconStatics
from palpate.physics.device.falcon import FALCON, HOME
from palpate.physics.device.grip import LINEAR, MINIMUM_JERK, path_point

T = 1e-3
DOWN = [{"to": [0.0, 0.0, 0.10], "time": 0.2}]
FREE = {"hand_stiffness": 0.0, "hand_damping": 0.0, "damping": 0.0, "resolution": 0.0}
STIFF = {"hand_stiffness": 1e7, "hand_damping": 1e4, "resolution": 0.0}


def place(state) -> np.ndarray:
    """Position [m] (3) of the grip, by forward kinematics."""
    point, ok = forward(state.joints)
    assert ok
    return point


@pytest.mark.parametrize(
    ("drag", "stiffness", "damping"),
    [(0.2, 500, 10), (0, 500, 0), (0.2, 0, 0), (0, 0, 0), (0, 100, 8.944271909999159), (50, 3, 0)],
)
@pytest.mark.parametrize("dt", [1e-4, 1e-2, 1.0])
def test_a_step_is_the_exact_motion(drag, stiffness, damping, dt):
    mass, start, speed, push, target = 0.2, 0.01, -0.3, 0.7, 0.03

    def motion(_, state):
        return [state[1], (push - drag * state[1] + stiffness * (target - state[0]) - damping * state[1]) / mass]

    exact = solve_ivp(motion, (0.0, dt), [start, speed], method="DOP853", rtol=1e-12, atol=1e-14).y[:, -1]
    x, v = grip_step([start, 0, 0], [speed, 0, 0], [push, 0, 0], dt, mass, drag, stiffness, damping, [target, 0, 0])
    assert (x[0], v[0]) == approx(exact, rel=1e-8, abs=1e-10)


def test_long_and_stiff_steps_settle_without_overshoot():
    for dt in (10.0, 1e3, 1e6):
        x, v = grip_step([0, 0, 0], [5, 0, 0], [1, 0, 0], dt, 0.2, 0.2, 500.0, 10.0, [0.01, 0, 0])
        assert x[0] == approx(0.01 + 1 / 500, rel=1e-6) and v[0] == approx(0.0, abs=1e-9)


def test_minimum_jerk_starts_and_ends_at_rest():
    ends, points, shapes = np.array([0.5]), np.array([[0.0, 0, 0], [0.04, 0, 0]]), np.array([1])
    t = np.linspace(0.0, 0.5, 501)
    x = np.array([path_point(a, ends, points, shapes)[1] for a in t])
    v = np.gradient(x, t)
    assert abs(v[0]) < 1e-5 and abs(v[-1]) < 1e-5
    assert v.max() == approx(1.875 * 0.04 / 0.5, rel=1e-4)  # peak of the quintic, at half time
    assert np.all(np.diff(x) >= 0) and x[250] == approx(0.02)


def test_a_path_follows_all_three_axes_segment_by_segment():
    points, ends = np.random.default_rng(0).normal(size=(4, 3)), np.array([0.5, 0.8, 2.0])
    shapes = np.array([LINEAR, MINIMUM_JERK, LINEAR])
    for time, i, share in ((0.1, 0, 0.2), (0.65, 1, 0.5), (0.575, 1, 0.103515625), (1.7, 2, 0.75), (2.0, 2, 1.0)):
        expected = points[i] + share * (points[i + 1] - points[i])
        segment, *place_then = path_point(time, ends, points, shapes)
        assert segment == i and place_then == approx(expected, rel=1e-12)


def test_a_stiff_hand_follows_its_path_and_stays_at_the_end():
    path = [
        {"to": [0.01, 0.0, 0.11], "time": 0.1, "shape": "linear"},
        {"hold": 0.05, "buttons": 4},
        {"to": [0.01, 0.02, 0.12], "time": 0.1},
    ]
    states = FakeBus(Simulated(path=path, **STIFF)).run(400)
    assert place(states[49]) == approx((0.005, 0.0, 0.11), abs=5e-5)
    assert place(states[140]) == approx((0.01, 0.0, 0.11), abs=1e-5) and states[140].buttons == 4
    assert place(states[199]) == approx((0.01, 0.01, 0.115), abs=5e-4) and states[199].buttons == 0
    assert place(states[-1]) == approx((0.01, 0.02, 0.12), abs=1e-8)


def test_the_path_is_the_same_for_any_period():
    def end(period, steps):
        node = Simulated(path=[{"to": [0.02, 0.0, 0.10], "time": 0.2}], resolution=0.0)
        node.start()
        for _ in range(steps):
            state = node.step(None, dt=period)
        return place(state)

    fine = end(1e-4, 1500)
    assert end(1e-3, 150) == approx(fine, abs=2e-6)
    assert end(0.15, 1) == approx(fine, abs=2e-6)


def test_the_path_is_in_the_world_frame():
    origin = np.array([0.3, -0.1, 0.05])
    node = Simulated(
        begin=(origin + HOME).tolist(),
        path=[{"to": (origin + (0.01, 0, 0.12)).tolist(), "time": 0.1}],
        origin=origin.tolist(),
        **STIFF,
    )
    assert place(FakeBus(node).run(300)[-1]) == approx((0.01, 0.0, 0.12), abs=1e-8)


def test_a_hand_at_twice_the_speed_takes_half_the_time():
    slow, fast = (FakeBus(Simulated(path=DOWN, speed_factor=speed, **STIFF)).run(240) for speed in (1.0, 2.0))
    for k in (40, 80, 119):
        assert place(fast[k]) == approx(place(slow[2 * k + 1]), abs=2e-5)
    with pytest.raises(SettingError, match="speed_factor"):
        Simulated(speed_factor=0.0)


def test_angles_are_multiples_of_a_count():
    for state in FakeBus(Simulated(path=DOWN)).run(150):
        n = (np.array(state.joints) - FALCON.zero) / FALCON.count
        assert n == approx(np.rint(n), abs=1e-9) and state.homed
        assert len(state.position) == 0


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_torque_pushes_a_free_grip_with_its_force(axis):
    push = 0.3 * np.eye(3)[axis]
    node = Simulated(mass=0.2, **FREE)
    node.start()
    for _ in range(40):
        here = node.own["motion"]["position"].copy()
        state = node.step(Torque(torques=torque(push, here)[0]), dt=T)
    t = 40 * T
    assert place(state) - HOME == approx(push / 0.2 * t * t / 2, abs=1e-8)


def test_a_force_moves_the_hand_by_force_over_stiffness():
    node = Simulated(hand_stiffness=400.0, resolution=0.0)
    node.start()
    push = np.array([0.4, 0.0, 1.2])
    for _ in range(3000):
        state = node.step(Torque(torques=torque(push, node.own["motion"]["position"])[0]), dt=T)
    assert place(state) == approx(np.array(HOME) + push / 400.0, abs=1e-8)


def test_without_a_torque_the_grip_is_not_pushed():
    bus = FakeBus(Simulated())
    first = bus.run(5)[0]
    assert bus.run(50)[-1].joints == first.joints
    bus.hold("torque", Torque(torques=(0.1, 0.1, 0.1)))
    assert bus.run(50)[-1].joints != first.joints
    bus.kill("torque")
    assert bus.run(2000)[-1].joints == first.joints


@pytest.mark.parametrize("without", range(1, 8))
@pytest.mark.parametrize("after", [0.0, 0.1, -0.2])
def test_the_applied_torque_never_jumps_around_an_outage(without, after):
    """Also if the sender returns with another command while the last one is falling: each tick changes the torque by at
    most the fraction T / FALL of the two commands."""
    node = Simulated()
    node.start()
    applied = []
    for command in [0.2] * 3 + [None] * without + [after] * 8:
        node.step(None if command is None else Torque(torques=(command,) * 3), dt=T)
        applied.append(float(node.own["applied"][0]))
    assert applied[2] == 0.2 and applied[-1] == after
    assert max(abs(np.diff(applied[2:]))) <= (0.2 + abs(after) + abs(0.2 - after)) * T / FALL + 1e-12


def test_motors_saturate_as_a_whole():
    def way(size):
        bus = FakeBus(Simulated(resolution=0.0), torque=Torque(torques=(size, size, size)))
        return place(bus.run(5)[-1])

    assert way(1e6) == approx(way(FALCON.limit), abs=1e-12)


def test_the_end_of_the_workspace_is_a_stop():
    bus = FakeBus(Simulated(hand_stiffness=0.0), torque=Torque(torques=(0.4, 0.4, 0.4)))
    for state in bus.run(3000):
        assert np.all(np.isfinite(state.joints))
    assert inverse(bus.node.own["motion"]["position"])[1]


@pytest.mark.parametrize("dt", [0.0, -1.0, float("nan"), float("inf"), 1e-9, 10.0, 1e6, 1e300])
def test_any_period_is_accepted(dt):
    node = Simulated(path=DOWN)
    node.start()
    first = node.step(None, dt=T)
    for _ in range(3):
        state = node.step(Torque(torques=(0.01, 0.0, 0.0)), dt=dt)
        assert np.all(np.isfinite(state.joints))
    if not 0 < dt < float("inf"):
        assert state.joints == first.joints


def test_a_device_with_delay_reports_earlier_states():
    now, late = FakeBus(Simulated(path=DOWN)).run(100), FakeBus(Simulated(path=DOWN, delay=5)).run(100)
    assert [s.joints for s in late[5:]] == [s.joints for s in now[:-5]]
    assert late[0].joints == late[4].joints


def test_faults_depend_only_on_the_seed():
    def day(**settings):
        return [s.joints for s in FakeBus(Simulated(path=DOWN, **settings)).run(200)]

    good = day()
    assert day(lost=0.1, seed=1) == day(lost=0.1, seed=1) != day(lost=0.1, seed=2)
    lost = [a != b for a, b in zip(day(lost=0.1, seed=1), good, strict=True)]
    assert 0 < sum(lost) < 60
    glitched = day(glitches=0.05, seed=1)
    off = [round((a[0] - b[0]) / FALCON.count) for a, b in zip(glitched, good, strict=True)]
    assert set(off) == {0, 1000} and 2 <= off.count(1000) <= 25


def test_start_is_a_reset():
    bus = FakeBus(Simulated(path=DOWN, lost=0.1, delay=2))
    first = [s.joints for s in bus.run(100)]
    bus.node.start()
    assert [s.joints for s in bus.run(100)] == first


@pytest.mark.parametrize(
    ("path", "text"),
    [
        ([{"hold": 0.1}, {"to": [0, 0, 0.1]}], r"'to' needs 'time' \[s\] - at \$\[1\]"),
        ([{"to": [0, 0, 0.1], "hold": 1.0}], r"either 'to' with 'time', or 'hold' - at \$\[0\]"),
        ([{}], r"either 'to' with 'time', or 'hold' - at \$\[0\]"),
        ([{"hold": 0.0}], "more than 0"),
        ([{"to": [0, 0, 0.1], "time": -1}], "more than 0"),
        ([{"to": [0, 0.1], "time": 1}], r"expected a list of 3 at \[0\].to"),
        ([{"hold": 1.0}, {"hold": 1.0, "shape": "linear"}], r"neither 'time' nor 'shape' - at \$\[1\]"),
        ([{"to": [0, 0, 0.1], "tiem": 1}], r"unknown key 'tiem' at \[0\]; expected to, time"),
        ([{"to": [0, 0, 0.1], "time": 1, "shape": "cubic"}], r"'cubic' - at \$\[0\].shape"),
        ([{"hold": 1.0}, {"to": [0, 0, 0.5], "time": 1}], r"'path\[1\].to' .*out of its reach"),
    ],
)
def test_a_wrong_path_is_an_error_with_its_segment(path, text):
    with pytest.raises(SettingError, match=text):
        Simulated(path=path)


def test_a_first_point_out_of_reach_is_an_error():
    with pytest.raises(SettingError, match=r"'begin' .*out of its reach.* 'origin' places the device"):
        Simulated(begin=(0, 0, 0))


def test_segments_may_be_given_as_objects():
    assert Simulated(path=(Segment(hold=0.1),)).path[0].duration == 0.1


class Loop:
    """Device, kinematics, a wall at z = 0.11, controller and statics, called in order."""

    def __init__(self, stiffness: float, device: Simulated, controller: Haptic, **finger) -> None:
        self.stiffness = stiffness
        self.nodes = (device, FalconKinematics(**finger), controller, FalconStatics())
        for node in self.nodes:
            node.start()
        self.torque: Torque | None = None
        self.tick = 0

    def step(self):
        """One tick: (true position [m] before, after, force sent, energy observed)."""
        device, finger, controller, statics = self.nodes
        before = device.own["motion"]["position"].copy()
        state = msgspec.structs.replace(device.step(self.torque, dt=T), time=self.tick * 1_000_000)
        pose = finger.step(state, dt=T)
        e = max(0.11 - pose.position[2], 0.0)
        contact = Contact(
            foot=(0, 0, 0.11),
            normal=(0, 0, 1),
            force=self.stiffness * e,
            compression=e,
            indentation=0.0,
            compression_rate=0.0,
            indentation_rate=0.0,
        )
        force = controller.step(contact, None, pose, None, None, dt=T)
        self.torque = statics.step(force, pose)
        self.tick += 1
        return before, device.own["motion"]["position"].copy(), np.array(force.force), force.energy


TOUCH = [{"to": [0, 0, 0.10], "time": 0.15}, {"hold": 0.15}, {"to": [0, 0, 0.115], "time": 0.15}, {"hold": 0.15}]


@pytest.mark.parametrize("counts", [True, False])
def test_the_closed_loop_presses_holds_and_releases_with_a_balanced_account(counts):
    stiffness, hand = 400.0, 500.0
    exact = {} if counts else {"resolution": 0.0}
    loop = Loop(stiffness, Simulated(begin=(0, 0, 0.115), path=TOUCH, hand_stiffness=hand, **exact), Haptic(), **exact)
    previous, place, records = np.zeros(3), np.array((0.0, 0.0, 0.115)), []
    for _ in range(600):
        before, after, force, energy = loop.step()
        place, last = loop.nodes[1].own["last"].copy(), place
        # The force sent one tick ago acted during this one, along the true path and along the reported one.
        records.append((after[2], force[2], -previous @ (after - before), -previous @ (place - last), energy, place[2]))
        previous = force
    z, push, true, received, seen, printed = np.array(records).T
    true, received = np.cumsum(true), np.cumsum(received)
    share = hand / (hand + stiffness) * 0.01
    assert push[290] == approx(stiffness * share, abs=stiffness * 60e-6)
    assert z[290] == approx(0.11 - share, abs=60e-6)
    assert (
        push.min() > -0.2 and push[-1] == 0.0
    )  # the energy generated by a lossless spring is dissipated as the finger leaves
    held = slice(60, 290)
    assert np.abs((received - received[40]) - (seen - seen[40]))[held].max() < 2 * 44e-6 * push.max()
    # Not visible to the encoder: at the wall the reported position has errors up to 4 counts for some milliseconds.
    off = np.abs(printed - z)[held].max()
    assert off < (4 * 44e-6 if counts else 1e-9)
    assert true.min() > -0.1e-3 - off * push.max() and seen.min() > -0.1e-3


def test_a_wall_of_3_newtons_per_millimetre_needs_the_controller():
    def swing(passivity, **exact):
        device = Simulated(
            begin=(0, 0, 0.111),
            path=[{"to": [0, 0, 0.1095], "time": 0.1}],
            mass=0.1,
            hand_damping=0.0,
            hand_stiffness=300.0,
            damping=0.2,
            delay=1,
            **exact,
        )
        loop = Loop(3000.0, device, Haptic(passivity=passivity, delay=1), **exact)
        z = np.array([loop.step()[1][2] for _ in range(2000)])
        return np.ptp(z[:500]), np.ptp(z[1000:1500]), np.ptp(z[1500:])

    on, off, still = swing(True), swing(False), swing(True, resolution=0.0)
    # With an encoder a hand without damping continues to oscillate.
    assert on[2] <= 1.1 * on[1] + 1e-5 and on[2] < 1e-3
    assert off[2] > 5 * on[2]
    assert still[2] < 0.1 * 60e-6, "exact positions come to rest"


def test_the_closed_loop_is_stable_with_faults_of_the_device():
    device = Simulated(begin=(0, 0, 0.115), path=TOUCH, delay=5, lost=0.01, glitches=0.01, seed=4)
    loop = Loop(440.0, device, Haptic(delay=5))
    forces = np.array([loop.step()[2] for _ in range(900)])
    assert np.all(np.isfinite(forces)) and np.linalg.norm(forces, axis=1).max() < 6.0
    assert np.abs(np.diff(forces[:, 2])).max() < 2.0  # no spike
    assert np.all(forces[-100:] == 0.0)


def test_a_grip_dragged_at_constant_speed_solves_its_equation_of_motion():
    """m x'' = -b x' + k (p - x) + c (p' - x') with p at constant speed, by a general ODE solver."""
    mass, drag, k, c = 0.2, 3.0, 400.0, 2.0
    begin, end, time = np.array(HOME) - (0, 0, 0.02), np.array(HOME) - (0.02, -0.01, 0.03), 0.2
    way = ({"to": tuple(end.tolist()), "time": time, "shape": "linear"},)
    hand = {"mass": mass, "damping": drag, "hand_stiffness": k, "hand_damping": c, "resolution": 0.0}
    node = Simulated(begin=tuple(begin.tolist()), path=way, **hand)
    bus = FakeBus(node)
    bus.run(151)
    speed = (end - begin) / time

    def motion(t: float, y: np.ndarray) -> np.ndarray:
        x, v = y[:3], y[3:]
        return np.concatenate([v, (-drag * v + k * (begin + speed * t - x) + c * (speed - v)) / mass])

    ran = node.own["motion"]["time"]
    reference = solve_ivp(motion, (0.0, ran), np.concatenate([begin, np.zeros(3)]), rtol=1e-10, atol=1e-13).y[:, -1]
    assert ran == pytest.approx(0.151, abs=1e-9)
    assert np.abs(node.own["motion"]["position"] - reference[:3]).max() < 1e-9
    assert np.abs(node.own["motion"]["velocity"] - reference[3:]).max() < 1e-7
