"""Late messages do not raise contact force or friction: a stopped sender and a poor network in the graph `remote`, and
a `transport.Delay` on any edge of the shipped graphs.

`Delay` repeats the last pose and then jumps. A contact that took the jump for the motion of one tick had 13 times the
force; a body with a late load, whose law seemed to be of this tick, 7 times.
"""

import os
import random

import numpy as np
import pytest
from late_edges import Late, draw, edges, forces
from lossy_touch import OVER, SLIDE, TAP, TOUCH, feel, undisturbed
from msgspec import UNSET
from msgspec.structs import replace

from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.launch.testing import FakeBus
from palpate.messages import DeviceState, Pose, Proximity, Surface, pack, unpack
from palpate.nodes.contact import Series
from palpate.nodes.kinematics import Cartesian
from palpate.nodes.transport import Delay
from palpate.records.player import plan_of
from palpate.records.reader import Recording
from palpate.records.verify import verify

SHORT = ("scene.surface.vertices=600", "scene.hand.begin=[0, 0, 0.110]",
         "scene.hand.path=[{to: [0, 0, 0.0935], time: 0.2}, {hold: 0.2}]")  # fmt: skip
LATE = [
    (0, 0, 0.3), (0, 0, 0.95), (20, 5, 0.0), (20, 20, 0.3),
]  # fmt: skip
"""Delay, jitter [ms] and loss."""
SLOW = {"fingertip-slide": 4}  # [1] divisor of the number of networks: a run takes 10 s of processor time


@pytest.fixture(scope="module")
def pressed(tmp_path_factory):
    """Contact forces of a short press of the kidney with delays on edges."""
    folder = tmp_path_factory.mktemp("late")
    return lambda *late: forces("kidney", list(late), folder, SHORT, 450)["contact"]


@pytest.mark.parametrize(
    ("stream", "node", "port"),
    [
        ("finger", "collision", "pose"), ("collision", "contact", "proximity"), ("device", "finger", "state"),
        ("spread", "tissue", "load"), ("contact", "spread", "contact"),
    ],
)  # fmt: skip
def test_a_network_on_any_edge_does_not_raise_the_contact_force(pressed, stream, node, port):
    base = pressed().max()
    for seed, (delay, jitter, loss) in enumerate(LATE):
        force = pressed(Late(stream, node, port, delay, jitter, loss, seed))
        assert 0.8 * base < force.max() <= OVER * base, (delay, jitter, loss)


def test_a_steady_delay_only_shifts_the_force(pressed):
    base = pressed()
    assert np.array_equal(pressed(Late("finger", "collision", "pose", 20, 0, 0, 1))[20:], base[:-20])
    assert np.array_equal(pressed(Late("finger", "collision", "pose", 0, 0, 0, 1)), base)


@pytest.mark.parametrize("length", [15, 30, 60, pytest.param(150, marks=pytest.mark.long)])
def test_a_stopped_finger_on_the_far_side_of_a_network_causes_no_spike(chain, length):
    """On the real clock, in a press: this gave 6.0, 11.5, 22.8 and 42.9 N instead of 2.9 to 3.2 N."""
    run = chain(find("remote").but(overrides=TOUCH))
    for begin in (60, 120):
        run.halted = lambda node, tick: node == "finger" and begin <= tick < begin + length  # noqa: B023
        felt = feel(run, lambda *_: False)
        assert felt.contact <= OVER * undisturbed(run, felt.places), begin


def test_random_networks_on_an_edge_raise_neither_contact_force_nor_friction(tmp_path):
    """A fast part of the search below: a press and a stroke of the kidney."""
    sets = ("scene.surface.vertices=600", "scene.hand.begin=[-0.01, 0, 0.110]",
            "scene.hand.path=[{to: [-0.01, 0, 0.0955], time: 0.15}, {to: [0.01, 0, 0.0955], time: 0.2},"
            "{to: [0, 0, 0.0955], time: 0.08}]")  # fmt: skip
    check("kidney", 8, 11, tmp_path, sets, 440)


def check(graph: str, count: int, seed: int, folder, sets=(), ticks=0) -> None:  # type: ignore[no-untyped-def]
    launch, random_ = find(graph).but(overrides=sets), random.Random(seed)
    ticks, found = ticks or round(1000 * (launch.duration or 1.0)), edges(launch)
    base = forces(graph, [], folder, sets, ticks)
    for _ in range(count):
        late = draw(found, random_)
        for stream, force in forces(graph, late, folder, sets, ticks).items():
            assert force.max() <= OVER * base[stream].max(), late


@pytest.mark.long
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("graph", [
    "kidney", "remote", "pinch", "palpate-two", "organs", "nodule", "texture", "fingertip-slide",
    "softness",
])  # fmt: skip
def test_random_networks_in_shipped_graphs_raise_neither_contact_force_nor_friction(graph, tmp_path):
    check(graph, int(os.environ.get("PALPATE_LATE", 40)) // SLOW.get(graph, 1), 5, tmp_path)


@pytest.mark.long
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("body", ["MassSpring", "ReducedFE", "BeamBundle"])
@pytest.mark.parametrize(
    "touch", [pytest.param(TOUCH, id="press"), pytest.param(TAP, id="tap"), pytest.param(SLIDE, id="slide")]
)
def test_random_networks_do_not_raise_the_contact_force_of_a_body(touch, body, tmp_path):
    check("kidney", 40, 6, tmp_path, (*touch, f"tissue.use=deformation.{body}"))


def test_one_late_finger_of_two_causes_no_spike(tmp_path):
    """Its samples come every few ticks while the other finger steps at each tick."""
    sets = ("scene.surface.vertices=800",)
    late = [Late("collision-thumb", "joint", "proximity", 40, 0, 0.7, 5)]
    base, felt = (forces("pinch", given, tmp_path, sets, 1200) for given in ([], late))
    assert all(felt[s].max() <= OVER * base[s].max() for s in base)
    assert all(felt[s].max() > 0.8 * base[s].max() for s in base if s.startswith("contact"))


# -- the age of a message ---------------------------------------------------------------------------------------------


def pose(k: int) -> Pose:
    return Pose(position=(k * 1e-3, 0.0, 0.0), velocity=(1.0, 0.0, 0.0), dt=1e-3)


def test_a_forwarded_message_has_the_age_of_its_content():
    sent = FakeBus(Delay.of(Pose)(delay=3e-3, loss=0.4, seed=2)).publish(*map(pose, range(60)))
    ages = [(each.delayed or 0) * 1e-6 for each in sent]
    assert [round(t - age) for t, age in enumerate(ages)] == [round(1e3 * each.position[0]) for each in sent]
    assert max(ages) > 3.0
    again = FakeBus(Delay.of(Pose)(delay=2e-3)).publish(*sent)
    assert [round(t - (m.delayed or 0) * 1e-6) for t, m in enumerate(again)] == [
        round(1e3 * each.position[0]) for each in again
    ]


def test_a_message_in_time_has_no_age_on_the_wire():
    (sent,) = FakeBus(Delay.of(Pose)()).publish(pose(1))
    late = replace(sent, delayed=5)
    assert b"delayed" not in pack(sent) and b"delayed" in pack(late)
    assert unpack(pack(late), Pose) == late and unpack(pack(sent), Pose).delayed is UNSET


def test_a_rejected_sample_makes_the_pose_late_and_the_time_to_the_next_is_the_real_one():
    """An encoder glitch of two samples: the contact must not take the motion of three ticks for that of one."""
    bus = FakeBus(Cartesian(speed_limit=2.0))
    places = [1e-4 * k for k in range(10)]
    places[5] = places[6] = 0.5
    sent = bus.publish(*(DeviceState(position=(x, 0.0, 0.0)) for x in places))
    assert [(each.delayed or 0) // 1_000_000 for each in sent] == [0, 0, 0, 0, 0, 1, 2, 0, 0, 0]


def near(depth: float, tick: int, sample: int) -> Proximity:
    age = (tick - sample) * 1_000_000
    more = {"delayed": age} if age else {}
    return Proximity(
        foot=(0.0, 0.0, 0.0), normal=(0.0, 0.0, 1.0), coordinates=(0.0, 0.0), element=0, gap=4e-3 - depth,
        approach=depth, separation=0.0, slip=(0.0, 0.0, 0.0), tick=tick, time=tick * 1_000_000, **more,
    )  # fmt: skip


BODY = Surface(
    nodes=np.zeros(0, int), displacement=np.zeros((0, 3)), stiffness=1e6, exponent=1.0, damping=0.0,
    rest_indentation=0.0, previous_indentation=0.0,
)  # fmt: skip


def test_a_contact_keeps_its_force_without_a_newer_sample_and_then_steps_by_the_real_time():
    """Samples 0 to 10 arrive in time, 11 at ticks 14 and 15, then 9, out of order, and 17: as if only those that were
    newer had been sent."""
    bus = FakeBus(Series(), body=BODY)
    rows = [(tick, tick) for tick in range(11)] + [(14, 11), (15, 11), (16, 9), (17, 17), (18, 18)]
    felt = {t: bus.publish(near(0.1e-3 * s, t, s))[0].force for t, s in rows}
    other = FakeBus(Series(), body=BODY)
    for tick in (*range(12), 17, 18):
        (contact,) = other.publish(near(0.1e-3 * tick, tick, tick))
        assert felt[14 if tick == 11 else tick] == contact.force
    assert felt[14] == felt[15] == felt[16]


def test_without_a_body_the_force_falls_even_if_the_pose_is_repeated():
    bus = FakeBus(Series(), body=BODY)
    bus.publish(*(near(1e-4 * k, k, k) for k in range(20)))
    bus.kill("body")
    last = bus.publish(*(near(19e-4, k, 19) for k in range(20, 40)))[-1]
    assert last.force == 0.0


def test_a_run_with_a_network_is_replayed_bit_for_bit(tmp_path):
    sets = (*SHORT, "scene.network.delay=10 ms", "scene.network.jitter=8 ms", "scene.network.loss=0.4")
    file = tmp_path / "remote.mcap"
    assert execute(find("remote").but(record=file, duration=0.3, overrides=sets)).result.ok
    recording = Recording(file)
    assert verify(recording, plan_of(recording)).ok
    assert any(message.delayed for message in recording.messages("collision"))
