"""The compiled form of a node, on small nodes of this file and of files outside the package."""

import importlib
import sys
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numba
import numpy as np
import pytest

from palpate.compiler.kernel import kernel
from palpate.compiler.records import floats, nth, one, put
from palpate.engine.job import NodeJob
from palpate.engine.slot import NodeError, Slot
from palpate.launch.testing import FakeBus
from palpate.messages import Contact, Force, Friction, Message, MessageError, Pose, pack
from palpate.nodes.base import ARRAY, CompiledNode, InputError, Out, Part, SettingError, Wants, effects, inputs, outputs

FREE, CONTACT = 0, 1  # words of `Force.state`
TOO_DEEP = 1  # fault
FAST = 100.0  # [m/s]


class Pull(CompiledNode):
    """A force towards the start, proportional to the longest path so far; friction is the sum of the contact forces."""

    stiffness: Annotated[float, "N/m", msgspec.Meta(ge=0)] = 300.0
    kind: Annotated[Literal["soft", "hard"], "1"] = "soft"
    count: Annotated[int, "1"] = 2
    strict: Annotated[bool, "1"] = False
    axis: Annotated[tuple[float, float, float], "1"] = (1.0, 0.0, 0.0)
    label: Annotated[str, "1"] = "not in the record"

    energy = Part("energy", "stored", about="What the spring holds.")
    State = {
        "longest": (), "way": (3,), "steps": int, "began": bool, "spring": {"energy": (), "table": (2, 2)},
        "seen": (3, {"force": (), "times": int}), "memory": ARRAY,
    }  # fmt: skip

    def start(self) -> None:
        super().start()
        self.memory = np.linspace(0.0, 1.0, 5)
        self.hold("memory", self.memory)
        self.own["spring"]["table"] = [[1.0, 2.0], [3.0, 4.0]]

    @kernel
    def idle(own, pose, contact, other, out, rubbed, dt):
        return pose.velocity[0] == 0.0 and own.steps > 3

    @kernel
    def compute(
        own, pose: Annotated[Pose, Wants("position", "velocity")], contact: list[Contact | None], other: Force | None,
        out: Out[Force], rubbed: Out[Friction], dt,
    ):  # fmt: skip
        if pose.position[2] > 1.0:
            own.fault = TOO_DEEP
            return
        if pose.velocity[0] > FAST:
            raise ValueError("faster than any hand")
        own.steps += 1
        own.began = True
        memory, total = floats(own.memory), 0.0
        for i in range(3):
            own.way[i] += pose.velocity[i] * dt
        memory[0] += own.steps
        own.longest = max(own.longest, abs(own.way[0]))
        own.spring.energy = 0.5 * own.stiffness * own.longest**2 * own.spring.table[1, 1]
        for i in range(contact.count):
            given = nth(contact, i)
            if given.there:
                total += given.force
                own.seen[i].force, own.seen[i].times = given.force, own.seen[i].times + 1
        put(out.force, (-own.stiffness * own.longest * own.axis[0], 0.0, other.force[0] if other.there else 0.0))
        out.state = other.state if other.there else (CONTACT if own.kind == 1 else FREE)
        out.energy = memory[4]
        rubbed.force[0], rubbed.stick = total, own.strict
        if own.energy:
            one(rubbed.stored, own.spring.energy)

    def explain(self, fault: int, *messages: Any) -> Exception:
        return InputError(messages[0], f"found a depth of {messages[0].position[2]:g} m, expected at most 1")


def pose(speed: float = 0.0, depth: float = 0.0, **more: Any) -> Pose:
    return Pose(position=(0.0, 0.0, depth), velocity=(speed, 0.0, 0.0), dt=1e-3, **more)


def contact(force: float) -> Contact:
    lengths = {"compression": 0.0, "indentation": 0.0, "compression_rate": 0.0, "indentation_rate": 0.0}
    return Contact(foot=(0.0, 0.0, 0.0), normal=(0.0, 0.0, 1.0), force=force, **lengths)


def started(**settings: Any) -> Pull:
    node = Pull(**settings)
    node.start()
    return node


def test_the_kernel_defines_the_wiring():
    drives, several, optional = inputs(Pull)
    assert (drives.name, drives.type, drives.wants) == ("pose", Pose, {"position", "velocity"})
    assert (several.many, several.optional, optional.optional) == (True, True, True)
    assert outputs(Pull) == (Force, Friction)
    assert [(e.name, e.fields) for e in effects(Pull)] == [("energy", ("stored",))]


def test_the_record_has_numeric_settings_parts_and_state():
    own = started(kind="hard", axis=(0.0, 1.0, 0.0)).own
    assert set(own.dtype.names) == {
        "fault", "stiffness", "kind", "count", "strict", "axis", "energy", *Pull.State
    }  # fmt: skip
    assert (own["stiffness"], own["kind"], own["count"], own["strict"]) == (300.0, 1, 2, False)
    assert own["axis"].tolist() == [0.0, 1.0, 0.0] and own["energy"]
    assert own["longest"] == 0.0 and own["seen"].shape == (3,) and own["spring"]["table"].shape == (2, 2)
    with pytest.raises(SettingError, match="kind"):
        Pull(kind="medium")


def test_a_step_reads_and_writes_words_vectors_groups_arrays_and_several_outputs():
    node = started(kind="hard")
    force, rubbed = node.step(pose(2.0), [contact(1.0), None, contact(3.0)], None, dt=0.5)
    assert isinstance(force, Force) and isinstance(rubbed, Friction)
    assert force.force == (-300.0, 0.0, 0.0) and force.state == "contact" and force.energy == 1.0
    assert rubbed.force == (4.0, 0.0, 0.0) and rubbed.stored == (0.5 * 300.0 * 4.0,) and not rubbed.stick
    force, _ = node.step(pose(-1.0), [None, None, contact(2.0)], None, dt=0.5)
    assert force.force[0] == -300.0 and node.own["way"].tolist() == [0.5, 0.0, 0.0]
    assert node.own["seen"]["force"].tolist() == [1.0, 0.0, 2.0]
    assert node.own["seen"]["times"].tolist() == [1, 0, 2] and node.memory[0] == 3.0
    given = Force(force=(7.0, 0.0, 0.0), state="free", energy=0.0)
    assert node.step(pose(), [], given, dt=0.5)[0] == Force(force=(-300.0, 0.0, 7.0), state="free", energy=1.0)
    node.start()
    assert node.own["steps"] == 0 and not node.own["seen"]["times"].any() and node.memory[0] == 0.0


def test_an_unread_part_is_not_computed():
    node = Pull()
    node.wanted = frozenset({"force"})
    node.start()
    assert not node.own["energy"] and node.step(pose(1.0), [], None, dt=0.5)[1].stored == ()


def test_results_over_the_wire_equal_direct_calls_and_a_resting_node_sleeps():
    bus, node = FakeBus(Pull(), contact=[contact(1.0)]), started()
    for speed in (1.0, 2.0, -1.0, 0.0, 0.0, 0.0, 0.0):
        (sent,) = bus.publish(pose(speed))
        if not node.rests(pose(speed), [contact(1.0)], None) or node.own["steps"] == 0:
            answers = node.step(pose(speed), [contact(1.0)], None, dt=1e-3)
        for received, made in zip(sent, answers, strict=True):
            header = {"tick": received.tick, "time": received.time, "source": received.source, "used": received.used}
            assert pack(received) == pack(msgspec.structs.replace(made, **header))
    assert bus.slot.health.asleep == 3 and node.own["steps"] == 4


def test_a_fault_is_explained_and_changes_nothing():
    node = started()
    node.step(pose(1.0), [], None, dt=0.5)
    before = node.own.tobytes()
    with pytest.raises(InputError, match=r"^Pose of 'finger' at tick 4: found a depth of 2 m, expected at most 1"):
        node.step(pose(1.0, depth=2.0, source="finger", tick=4), [], None, dt=0.5)
    assert node.own.tobytes() == before
    node.step(pose(1.0), [], None, dt=0.5)
    assert node.own["steps"] == 2


def test_an_exception_in_a_kernel_is_an_error_with_node_and_tick():
    slot = Slot(NodeJob("spring-7", "", {}, 1, (), ("spring-7.Force", "spring-7.Friction")), started(), ())
    slot.takes((-1, 0, -1))
    slot.step(3, 3_000_000, [pose(1.0, tick=3, time=3_000_000), None], 1e-3)
    with pytest.raises(NodeError, match="node 'spring-7', step at tick 4: faster than any hand") as reported:
        slot.step(4, 4_000_000, [pose(1e3, tick=4, time=4_000_000), None], 1e-3)
    assert isinstance(reported.value.cause, ValueError)


def test_an_input_too_long_for_a_record_is_an_error_with_its_name():
    node = started()
    long = msgspec.structs.replace(contact(1.0), stored=(0.0,) * 17)
    with pytest.raises(MessageError, match=r"Contact\.stored: found 17 numbers; a compiled node takes 16 at most"):
        node.step(pose(), [long], None, dt=0.5)
    with pytest.raises(MessageError, match="found the word 'stuck', expected one of 'free', 'contact'"):
        node.step(pose(), [], Force(force=(0.0, 0.0, 0.0), state="stuck", energy=0.0), dt=0.5)


class Named(Message):
    """name [1] ()"""

    name: Annotated[str, "1"] = ""


class Coarse(Message):
    """heights [m] (n)"""

    heights: Annotated[Annotated[np.ndarray, np.dtype("<f4")], "m", ("n",)] = np.zeros(0, "<f4")


class Unsure(Message):
    """force [N] ()"""

    force: Annotated[float | None, "N"] = None


class Mixed(Message):
    """pair [1] (2)"""

    pair: Annotated[tuple[float, str], "1"] = (0.0, "")


class Texts(Message):
    """texts [1] (n)"""

    texts: Annotated[tuple[str, ...], "1", ("n",)] = ()


@kernel
def _compute(own, pose: Pose, out: Out[Force], dt):
    pass


def _of(message: Any) -> Any:
    @kernel
    def compute(own, pose: Pose, given: message, out: Out[Force], dt):
        pass

    return compute


@kernel
def _turned(own, out: Out[Force], pose: Pose, dt):
    pass


@kernel
def _timeless(own, pose: Pose, out: Out[Force]):
    pass


@kernel
def _silent(own, pose: Pose, dt):
    pass


@kernel
def _blind(own, pose, out: Out[Force], dt):
    pass


CURE = "Numbers, flags, vectors of them, arrays that are Floats or Ints can be held"
REFUSED = {
    "a word in the state": ({"State": {"name": str}}, r"Odd\.State\['name'\]: found .*str.*, expected a shape such as"),
    "a list in a group": ({"State": {"group": {"n": [3]}}}, r"Odd\.State\['group'\]\['n'\]: found \[3\]"),
    "a name twice": ({"State": {"fault": ()}}, r"Odd\.State\['fault'\]: a setting, a part or `fault` has this name"),
    "a text in a message": ({"compute": _of(Named)}, rf"Named\.name: a compiled node cannot hold str\. {CURE}"),
    "single precision": ({"compute": _of(Coarse)}, rf"Coarse\.heights: .* cannot hold float32\. {CURE}"),
    "perhaps a number": ({"compute": _of(Unsure | None)}, r"Unsure\.force: .* cannot hold float \| None"),
    "two types in a vector": ({"compute": _of(list[Mixed])}, r"Mixed\.pair: .* cannot hold tuple"),
    "a vector of texts": ({"compute": _of(Texts)}, r"Texts\.texts: .* cannot hold tuple"),
    "no kernel": ({"compute": _compute.py_func}, r"Odd\.compute: .*write @kernel above it"),
    "the output first": ({"compute": _turned}, r"found the arguments own, out, pose, dt, expected own, the inputs"),
    "no time": ({"compute": _timeless}, "found the arguments own, pose, out, expected .* and dt, in this order"),
    "no output": ({"compute": _silent}, r"at least one output such as `out: Out\[Force\]`"),
    "an input without a type": ({"compute": _blind}, r"Odd\._blind: input 'pose' is not a message but None"),
    "other arguments": ({"idle": _timeless}, r"Odd\.idle: expected the arguments of compute: own, pose, out, dt"),
}


@pytest.mark.parametrize(("given", "reported"), REFUSED.values(), ids=REFUSED)
def test_unsupported_fields_of_a_record_are_errors_at_class_definition(given, reported):
    with pytest.raises(TypeError, match=reported):
        type("Odd", (CompiledNode,), {"compute": _compute, "__module__": __name__, **given})


SHARED = """\
from palpate.compiler.kernel import kernel
STATE = {state}
GAIN = {gain}
@kernel
def push(x):
    return {push}
"""
NODE = '''\
from mylab_shared import GAIN, STATE, push
from palpate.messages import Force, Pose
from palpate.nodes.base import CompiledNode, Out
from palpate.compiler.kernel import kernel
class Mine(CompiledNode):
    """A custom node."""
    State = STATE
    @kernel
    def compute(own, pose: Pose, out: Out[Force], dt):
        own.second += 1.0
        out.force[0] = push(GAIN * own.second)
'''
LAYOUT = {"state": '{"second": ()}', "gain": "2.0", "push": "x + 10.0"}


def answers(folder: Path, **shared: str) -> tuple[list[float], bool]:
    """Two results of the custom node in a new process, and whether its code came from the disk cache."""
    (folder / "mylab_shared.py").write_text(SHARED.format(**LAYOUT | shared))
    for name in ("mylab_shared", "mylab_node"):
        sys.modules.pop(name, None)
    importlib.invalidate_caches()
    kind = importlib.import_module("mylab_node").Mine
    node = kind()
    node.start()
    found = [node.step(pose(), dt=1e-3).force[0] for _ in range(2)]
    return found, bool(kind.compute.entry.stats.cache_hits)


def test_custom_code_is_cached_on_disk_by_layout_and_values(tmp_path, monkeypatch):
    """The file of the node is unchanged; only its import changes, which numba does not check."""
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    monkeypatch.setattr(sys, "dont_write_bytecode", True)  # Python does not distinguish two edits within a second
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "kernels"))
    (tmp_path / "mylab_node.py").write_text(NODE)
    assert answers(tmp_path) == ([12.0, 14.0], False)
    assert answers(tmp_path) == ([12.0, 14.0], True)
    moved = '{"first": (3,), "second": ()}'
    assert answers(tmp_path, state=moved) == ([12.0, 14.0], False)
    assert answers(tmp_path, gain="3.0") == ([13.0, 16.0], False)
    assert answers(tmp_path, push="x - 10.0") == ([-8.0, -6.0], False)
    assert answers(tmp_path) == ([12.0, 14.0], True)
    for name in ("mylab_shared", "mylab_node"):
        del sys.modules[name]
