"""Nodes on the force path: settings, a state of fixed size, and one kernel on records.

    class Spring(CompiledNode):
        stiffness: Annotated[float, "N/m"] = 300.0
        State = {"longest": ()}              # (): a number; (3,): a vector; int, bool; {...}: a group; (16, {...})

        @kernel
        def compute(own, proximity: Proximity, out: Out[Force], dt):
            own.longest = max(own.longest, proximity.approach)
            for i in range(3):
                out.force[i] = own.stiffness * proximity.approach * proximity.normal[i]

The arguments of `compute` are the wiring, like those of `step` of a node in Python. `own` is the record of the node:
numeric settings, flags of the requested parts, and the state; a setting with a choice of words is the index of its
word. Messages are records (messages/record.py). For an input of type `X | None`, `x.there` is whether a message exists.
The kernel writes its answer to `out`, which initially has the previous answer. On an error it sets `own.fault` to a
number and returns; `explain` converts the number to an exception.
"""

import contextlib
import inspect
import math
import typing
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, ClassVar

import numpy as np

from palpate.compiler.fields import field_list
from palpate.messages import Message, MessageError
from palpate.messages.record import KINDS, ROOM, array_handle, blank, layout, reader, writer
from palpate.messages.wording import words_of
from palpate.nodes.base.effect import Part
from palpate.nodes.base.node import OUT, Node, Port, inputs, once_per_class, outputs, settings

ARRAY, TABLE = array_handle(1), array_handle(2)
"""Types of fields of a state: an array with one or two axes, set by `CompiledNode.hold`."""


class CompiledNode(Node):
    """A node whose step is a kernel on records.

    State    fields of the state and their shapes
    compute  the kernel: record of the node, inputs, outputs, dt [s]
    idle     a kernel with the same arguments, called before `compute`: whether a step on these inputs would change
             neither state nor answers. It may keep the sample that it saw (`samples.slid`)
    shared   arrays of the state, or groups of them ("body.model"), that no kernel writes; parallel runs share them
    conditions  words of `condition` for each field of the state that causes it while it is true or positive
    """

    State: ClassVar[dict[str, Any]] = {}
    shared: ClassVar[tuple[str, ...]] = ()
    conditions: ClassVar[dict[str, str]] = {}
    compute: ClassVar[Any]
    idle: ClassVar[Any] = None

    def __init_subclass__(cls, **given: Any) -> None:
        """Check the class without compiling. TypeError: the kernel's arguments or a field of the state are invalid."""
        super().__init_subclass__(**given)
        if hasattr(cls, "compute"):
            with contextlib.suppress(NameError):  # a type that is defined further down: checked at the first use
                _check(cls)

    @classmethod
    def wiring(cls) -> Callable[..., Any]:
        """The kernel, before it is compiled."""
        return getattr(cls.compute, "py_func", cls.compute)

    def start(self) -> None:
        """Make the record of the node: settings, requested parts, zero state. A subclass with more state calls this
        first."""
        self._notes, self._noted, self._grown = [], set[str](), dict[str, float]()
        if not hasattr(self, "own"):
            self._record = np.zeros(1, record(type(self)))
            self.own = self._record[0]  # never reallocated: its address is in use elsewhere
        self._record[:] = np.zeros(1, self._record.dtype)
        self._held: dict[str, np.ndarray] = {}
        for name in self.own.dtype.names or ():
            if name in settings(type(self)):
                words, value = words_of(settings(type(self))[name].type), getattr(self, name)
                self.own[name] = words.index(value) if words else value
            elif isinstance(part := getattr(type(self), name, None), Part):
                self.own[name] = part.is_wanted(self)
        self._records: Records | None = None

    @property
    def known(self) -> Any:
        """The record of the node, for notes and conditions. They are also asked before the start: then it is zero."""
        return self.own if hasattr(self, "own") else np.zeros((), record(type(self)))

    def condition(self) -> str:
        known = self.known
        return next((words for field, words in self.conditions.items() if known[field] > 0), "")

    def _note_once(self, text: str) -> None:
        """Add a line for the user, at most once after a start."""
        if text not in self._noted:
            self._noted.add(text)
            self._notes.append(text)

    def _note_growth(self, name: str, value: float, text: str) -> None:
        """Add a line about a value that grows, at most once for each doubling after a start."""
        if value >= 2.0 * self._grown.get(name, 0.0):
            self._grown[name] = value
            self._note_once(text)

    def hold(self, name: str, value: Any) -> None:
        """Set a field of the state to a contiguous array, or a group to the fields of a NamedTuple of its form
        (`compiler.records.form`)."""
        self._hold(self.own, name, value, name)

    def _hold(self, record: Any, name: str, value: Any, path: str) -> None:
        if hasattr(value, "_fields"):
            forms = _forms_of(value.__class__)
            for field, each in value._asdict().items():
                found = getattr(each, "dtype", None), getattr(each, "ndim", 0)
                assert found[0] is None or found == forms[field], (path, field, found)
                self._hold(record[name], field, each, f"{path}.{field}")
        elif isinstance(value, np.ndarray):
            assert value.flags.c_contiguous and record[name]["shape"].shape == (value.ndim,), (path, value.shape)
            self._held[path] = value
            record[name]["address"], record[name]["shape"] = value.ctypes.data, value.shape
        else:
            record[name] = value

    def resize(self, counts: list[int]) -> None:
        """Resize the state to the number of messages at each input; called before the first step and after changes."""

    def explain(self, fault: int, *messages: Any) -> Exception:
        """The exception for a fault of the kernel; `messages`: its inputs."""
        return MessageError(f"{type(self).__name__}: fault {fault} in its kernel")

    def records(self, messages: Sequence[Any]) -> "Records":
        """The node with a record for each of these messages."""
        counts = _counts(messages)
        if self._records is None or self._records.counts != counts:
            self.resize(counts)
            self._records = Records(self, counts)
        self._records.write(messages)
        return self._records

    def rests(self, *given: Any) -> bool:
        messages = self._inputs(given, {})
        if self.idle is None or (self._records is not None and self._records.counts != _counts(messages)):
            return False
        return self.records(messages).idle()

    def step(self, *given: Any, dt: float = math.inf, **named: Any) -> Any:
        """One step on messages, in the order of the inputs or by name; None: no message, and of an input that takes
        several none at all if it is left out.

        Returns the answer, or a tuple if there are several.
        """
        messages = self._inputs(given, named)
        records = self.records(messages)
        records.compute(messages, dt)
        answers = records.read()
        return answers[0] if len(answers) == 1 else answers

    def _inputs(self, given: Sequence[Any], named: dict[str, Any]) -> tuple[Any, ...]:
        """What each input gets: the messages in order, then those by name."""
        rest = inputs(type(self))[len(given) :]
        return (*given, *(named.get(port.name, [] if port.many else None) for port in rest))


@cache
def _forms_of(group: type) -> dict[str, Any]:
    """For each field of a NamedTuple the dtype and number of axes of its array; of another field None."""
    hints = typing.get_type_hints(group, include_extras=True)
    return {name: getattr(hint, "__metadata__", None) for name, hint in hints.items()}


def _check(kind: type[CompiledNode]) -> None:
    """Check the kernel and the records of a class; TypeError as in `CompiledNode.__init_subclass__`."""
    name = f"{kind.__name__}.compute"
    from palpate.compiler import interpreted
    from palpate.compiler.kernel import CompiledKernel

    if not (isinstance(kind.compute, CompiledKernel) or interpreted.ENABLED):
        raise TypeError(f"{name}: found {kind.compute!r}, expected a kernel: write @kernel above it")
    hints = typing.get_type_hints(kind.wiring(), include_extras=True)
    sent = [argument for argument, hint in hints.items() if OUT in getattr(hint, "__metadata__", ())]
    found = list(inspect.signature(kind.wiring()).parameters)
    if not sent or found[1:] != [*(port.name for port in inputs(kind)), *sent, "dt"]:
        raise TypeError(
            f"{name}: found the arguments {', '.join(found)}, expected own, the inputs, at least one output such as "
            "`out: Out[Force]`, and dt, in this order"
        )
    idle = getattr(kind.idle, "py_func", kind.idle)
    if idle is not None and len(inspect.signature(idle).parameters) != len(found):
        raise TypeError(f"{kind.__name__}.idle: expected the arguments of compute: {', '.join(found)}")
    record(kind)
    for message in (*(port.type for port in inputs(kind)), *outputs(kind)):
        layout(message)


def _counts(messages: Sequence[Any]) -> list[int]:
    return [len(m) if isinstance(m, list) else 1 for m in messages]


@once_per_class
def record(kind: type[CompiledNode]) -> np.dtype:
    """The record `own` of a node class: `fault`, numeric settings, parts, state. TypeError: invalid state."""
    own: list[tuple[Any, ...]] = [("fault", "<i8")]
    for name, setting in settings(kind).items():
        if (form := _setting(setting.type)) is not None:
            own.append((name, *form))
    own += [(name, "?") for name in dir(kind) if isinstance(getattr(kind, name), Part)]
    for name, *_ in own:
        if name in kind.State:
            raise TypeError(f"{kind.__name__}.State[{name!r}]: a setting, a part or `fault` has this name")
    return np.dtype(own + field_list(f"{kind.__name__}.State", kind.State), align=True)


def _setting(hint: Any) -> tuple[Any, ...] | None:
    """The type of a setting in a record; None: the record does not contain it."""
    if hasattr(hint, "__metadata__"):
        hint = typing.get_args(hint)[0]
    if hint in KINDS:
        return (KINDS[hint],)
    given = typing.get_args(hint)
    if typing.get_origin(hint) is typing.Literal:
        return (KINDS[int],)
    if typing.get_origin(hint) is tuple and Ellipsis not in given and set(given) <= set(KINDS):
        return KINDS[given[0]], (len(given),)
    return None


def several(kind: type[Message]) -> np.dtype:
    """The record of an input with several senders: the number of messages and their addresses (`records.nth`)."""
    return np.dtype([("count", "<i8"), ("at", "<i8", (ROOM,)), ("like", layout(kind))], align=True)


def arguments(kind: type[CompiledNode]) -> list[np.dtype]:
    """The records that the kernels of a node class take, before dt."""
    ports = [several(port.type) if port.many else layout(port.type) for port in inputs(kind)]
    return [record(kind), *ports, *map(layout, outputs(kind))]


@once_per_class
def code(kind: type[CompiledNode], name: str) -> int:
    """Address of the machine code of a kernel of a node class: `compute` or `idle`."""
    from palpate.compiler.records import address  # the compiler is slow to import

    return address(getattr(kind, name), *arguments(kind))


class Records:
    """A node with a record for each of its messages, for steps that are called from Python.

    counts  number of messages of each port
    """

    def __init__(self, node: CompiledNode, counts: list[int]) -> None:
        from palpate.compiler.entry_point import entry_point  # the compiler is slow to import
        from palpate.compiler.records import call

        self.node, self.counts = node, counts
        kind = type(node)
        ports = inputs(kind)
        self._fill = [[_inlet(port) for _ in range(count)] for port, count in zip(ports, counts, strict=True)]
        self._ports = [_port_argument(port, fill) for port, fill in zip(ports, self._fill, strict=True)]
        self._out = [blank(output) for output in outputs(kind)]
        for out in self._out:
            out["tick"] = out["time"] = -1
        self._read = [(reader(k), out.view(np.uint8).data) for k, out in zip(outputs(kind), self._out, strict=True)]
        self._table = np.array(
            [node._record.ctypes.data, *(r.ctypes.data for r in (*self._ports, *self._out))], np.int64
        )
        self._call = entry_point(call, 0, 0, 0, 0.0)
        self._where = self._table.ctypes.data, len(self._table)
        self._compute = code(kind, "compute")
        self._idle = code(kind, "idle") if kind.idle is not None else 0

    def write(self, messages: Sequence[Any]) -> None:
        """Write the inputs to their records."""
        for fill, given in zip(self._fill, messages, strict=True):
            for (write, memory, there), message in zip(
                fill, given if isinstance(given, list) else (given,), strict=True
            ):
                if message is None:
                    there[0] = False
                else:
                    write(message, memory)

    def idle(self) -> bool:
        """Whether the node rests on these inputs."""
        return self._call(self._idle, *self._where, 0.0)[1]

    def compute(self, messages: Sequence[Any], dt: float) -> None:
        """Run the kernel; raises its exception, or that of its fault."""
        raised, _ = self._call(self._compute, *self._where, dt)
        own = self.node.own
        if raised or own["fault"]:
            fault, own["fault"] = int(own["fault"]), 0
            if raised:
                # run again in Python for the exception with its traceback
                type(self.node).compute(own, *(r[0] for r in (*self._ports, *self._out)), dt)
                raise RuntimeError("the kernel raised, but not when it ran again on the state that it had left")
            raise self.node.explain(fault, *messages)

    def read(self) -> tuple[Message, ...]:
        """The answers."""
        return tuple([read(memory) for read, memory in self._read])


def _inlet(port: Port) -> tuple[Any, Any, np.ndarray]:
    """Writer, memory and flag of a record for messages of a port."""
    one = blank(port.type)
    return writer(port.type, port.wants), one.view(np.uint8).data, one["there"]


def _port_argument(port: Port, fill: list[Any]) -> np.ndarray:
    """The kernel's argument for a port."""
    records = [there.base for _, _, there in fill]
    if not port.many:
        return records[0]
    table = np.zeros(1, several(port.type))
    table["count"] = len(records)
    table["at"][0, : len(records)] = [r.ctypes.data for r in records]
    return table
