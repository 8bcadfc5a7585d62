"""Every node of the kidney graph with extreme inputs: steps of zero or negative length, huge and denormal numbers,
points a million kilometres away, missing senders. No exception, no NaN, and reproducible bytes."""

import functools
import math
import os

import msgspec
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from palpate.launch.load.launchfile import find
from palpate.launch.testing import FakeBus
from palpate.messages import (
    Contact,
    DeviceState,
    Force,
    Friction,
    Ledger,
    Load,
    Pose,
    Proximity,
    Surface,
    Torque,
    fields,
    pack,
)
from palpate.messages.contact import OrganContact
from palpate.messages.tissue import Support
from palpate.nodes.base import inputs

MANY = int(os.environ.get("PALPATE_EXAMPLES", 200))
EXAMPLES = pytest.mark.parametrize("examples", [10, pytest.param(MANY, marks=pytest.mark.long)])
STEPS = st.sampled_from([0, 1, -1, 1_000_000, 1_000_000, 1_300_000, -5_000_000, 10**9, 10**11, 10**15])  # [ns]


def number(most: float, least: float | None = None):
    """A number, often near the ends of its range or near zero."""
    least = -most if least is None else least
    special = [x for x in (0.0, 5e-324, -5e-324, 1e-300, 1e-12, -1e-12, 1e-3, most, least) if least <= x <= most]
    return st.sampled_from(special) | st.floats(least, most, allow_nan=False)


def vector(most: float):
    return st.tuples(number(most), number(most), number(most)) | st.tuples(number(0.2), number(0.2), number(0.2))


@st.composite
def normals(draw) -> tuple[float, float, float]:
    x = np.array(draw(st.tuples(*[st.floats(-1.0, 1.0)] * 3)))
    size = float(np.linalg.norm(x))
    a, b, c = (x / size).tolist() if size > 1e-3 else (0.0, 0.0, 1.0)
    return a, b, c


@st.composite
def loads(draw) -> Load:
    count = draw(st.integers(0, 4))
    nodes = np.array(draw(st.lists(st.integers(0, 500), min_size=count, max_size=count, unique=True)), dtype=np.int32)
    size = draw(number(1e6, 0.0))
    normal = np.array(draw(normals()))
    sideways = np.array(draw(vector(1e3)))
    forces = np.tile(-size * normal + sideways, (count, 1))
    return Load(nodes=nodes, forces=forces, foot=draw(vector(1e9)), normal=tuple(normal.tolist()))


BOOKS = [field.name for field in fields(Ledger) if field.type is float]
HELD = st.just(()) | st.tuples(number(1e9))
MESSAGES = {
    DeviceState: st.builds(DeviceState, joints=vector(1e9), homed=st.booleans()),
    Pose: st.builds(Pose, position=vector(1e9), velocity=vector(1e9), dt=number(1e6)),
    Proximity: st.builds(
        Proximity,
        foot=vector(1e9),
        normal=normals(),
        coordinates=st.just((0.0, 0.0)),
        element=st.just(0),
        gap=number(1e9),
        approach=number(1e9, 0.0),
        slip=vector(1e9),
    ),
    Contact: st.builds(
        Contact,
        foot=vector(1e9),
        normal=normals(),
        force=number(1e9, 0.0),
        compression=number(1e3, 0.0),
        indentation=number(1e3),
        compression_rate=number(1e9),
        indentation_rate=number(1e9),
        stored=HELD,
    ),
    Friction: st.builds(Friction, force=vector(1e9), bristle=vector(1.0), stick=st.booleans(), stored=HELD),
    Surface: st.builds(
        Surface,
        nodes=st.just(np.zeros(0, np.int32)),
        displacement=st.just(np.zeros((0, 3))),
        stiffness=number(1e12, 1e-9),
        exponent=st.floats(1.0, 3.0),
        damping=number(1e6, 0.0),
        rest_indentation=number(0.1),
        previous_indentation=number(1.0),
        stored=HELD,
    ),
    Load: loads(),
    OrganContact: st.builds(
        functools.partial(msgspec.structs.replace, OrganContact.example(False)),
        dissipated=number(1e9),
        generated=number(1e9),
    ),
    Force: st.builds(Force, force=vector(1e12), state=st.just("contact"), energy=number(1e9)),
    Torque: st.builds(Torque, torques=vector(1e9)),
    Support: st.builds(Support, displacement=vector(0.1), velocity=vector(1e9)),
    Ledger: st.builds(
        Ledger, **dict.fromkeys(BOOKS, number(1e9)), generated_by=st.just("tissue"), tripped=st.booleans()
    ),
}
VARIANTS = {
    "undamped tissue": ("tissue", {"damping": 0.0, "exponent": 1.0, "tangential_damping": 0.0}),
    "coulomb": ("friction", "friction.Coulomb"),
    "mesh": ("collision", "collision.Mesh"),
    "held free": ("controller", {"stiffness": 500.0, "damping": 5.0, "contact_damping": 2.0, "delay": 3}),
    "bad reports": ("device", {"delay": 2, "lost": 0.3, "glitches": 0.3}),
}
NAMES = (
    "device",
    "finger",
    "collision",
    "contact",
    "friction",
    "spread",
    "tissue",
    "controller",
    "statics",
    "ledger",
    *VARIANTS,
)


@functools.cache
def bus(name: str) -> FakeBus:
    """The node of the shipped graph, or a variant of it."""
    node, change = VARIANTS.get(name, (name, {}))
    launch = find("kidney")
    if isinstance(change, str):
        launch = launch.but(overrides=(f"{node}.use={change}",))
    spec = launch.load().nodes[node]
    return FakeBus(spec.cls(**{**spec.settings, **(change if isinstance(change, dict) else {})}))


@st.composite
def bad_days(draw, name: str) -> list[tuple[int, dict]]:
    ports = inputs(type(bus(name).node))
    days = []
    for _ in range(draw(st.integers(1, 6))):
        held = {p.name: draw(st.none() | MESSAGES[p.type]) if p.optional else draw(MESSAGES[p.type]) for p in ports}
        days.append((draw(STEPS), held))
    return days


def live(name: str, days: list[tuple[int, dict]]) -> list[bytes]:
    """Run the node through these steps; FakeBus rejects values that are not finite."""
    it = bus(name)
    it.node.start()
    it.slot.time, it.tick, time = None, 0, 0
    printed = []
    for tick, (step, held) in enumerate(days):
        time = max(time + step, 0)
        driver = it.driver
        for port, message in held.items():
            if port != driver:
                it.hold(port, message)
        if driver is None:
            it.tick = time // 1_000_000
            (answer,) = it.run(1)
        else:
            driving = held[driver]
            if driving is None:
                it.hold(driver, None)
                answer = it._step(None)
            else:
                (answer,) = it.publish(msgspec.structs.replace(driving, tick=tick, time=time))
        printed.append(pack(answer))
    return printed


@EXAMPLES
@pytest.mark.parametrize("name", NAMES)
def test_outputs_are_finite_and_reproducible(name, examples):
    @settings(max_examples=examples, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
    @given(bad_days(name))
    def check(days):
        first = live(name, days)
        assert live(name, days) == first

    check()


@EXAMPLES
def test_the_force_on_the_hand_never_exceeds_the_limit(examples):
    @settings(max_examples=examples, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
    @given(bad_days("held free"))
    def check(days):
        for data in live("held free", days):
            assert math.hypot(*msgspec.msgpack.decode(data)["force"]) <= 9.0 * (1 + 1e-12)

    check()
