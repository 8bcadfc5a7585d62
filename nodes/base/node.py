"""The base of all nodes: settings as fields, ports from the signature of `step`, state made in `start`."""

import inspect
import types
import typing
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, ClassVar, TypeVar, cast

import msgspec
import numpy as np

from palpate.messages import Health, Message
from palpate.messages.wording import reword, written
from palpate.nodes.base.block import Block
from palpate.physics.errors import MISUSE, PalpateError

F = TypeVar("F", bound=Callable)


class SettingError(PalpateError, ValueError):
    """An unknown setting, or an invalid value of a setting."""

    exit_code = MISUSE


class InputError(PalpateError, ValueError):
    """An unusable input; raised in `step`, and reported as an error of the node that sent the message."""

    def __init__(self, message: Any, text: str) -> None:
        who = f" of {message.source!r} at tick {message.tick}" if message.source else ""
        super().__init__(f"{type(message).__name__}{who}: {text}")
        self.source = message.source


OUT = "output"
T = TypeVar("T")
Out = Annotated[T, OUT]
"""Mark of an argument of a compiled node that is its output: `out: Out[Contact]`."""


class Wants:
    """Mark of an input port that reads only some fields of its message, so that the sender may omit the others:

    def step(self, proximity: Proximity, body: Annotated[Surface, Wants("stiffness", "exponent")]) -> Contact:
    """

    def __init__(self, *names: str) -> None:
        self.names = frozenset(names)


@dataclass(frozen=True)
class Setting:
    """One setting of a node: name, SI unit, Python type with limits, default (`...`: required), other marks of its
    annotation."""

    name: str
    unit: str
    type: Any
    default: Any
    marks: tuple[Any, ...] = ()


@dataclass(frozen=True)
class Port:
    """One input of a node: name, message type, whether it may be None, the fields that it reads, and whether it accepts
    several senders."""

    name: str
    type: type[Message]
    optional: bool
    wants: frozenset[str]
    many: bool = False

    @property
    def expects(self) -> str:
        """Its type as written in the class."""
        one = self.type.__name__ + " | None" * self.optional
        return f"list[{one}]" if self.many else one


@dataclass(frozen=True)
class Stream:
    """One stream that an observer receives: name, message type, sending node and its divisor of the base rate."""

    name: str
    type: type[Message]
    producer: str
    every: int


class Node:
    """One job of the graph.

    Settings are annotated class attributes, `Annotated[type, unit]`, with or without a default; the constructor takes
    them by name. The signature of `step` is the wiring: its arguments are the inputs, its return annotation is the
    output (a tuple of types: several outputs). The arrival of the first input triggers the step. An argument of type
    `list[Load]` accepts any number of senders, in the order of the graph; with `list[Load | None]` an entry is None
    while its sender is missing, and as the first input any of them triggers the step. The runner passes `dt`,
    keyword-only: the time [s] > 0 since the previous step of this node on the graph's clock.

    A step must not read a clock, a file, a socket or a random source without a seed in the settings: its answer depends
    only on its inputs and its state, and `start` makes the state, so that a run can be replayed exactly.
    """

    paced: ClassVar[bool] = False  # True for a source: the clock triggers its step with the latest inputs
    sink: ClassVar[bool] = False
    """True if the node has an effect outside the graph: it drives hardware, writes a file, shows a picture."""
    hardware: ClassVar[bool] = False
    """True for a node that communicates with a device: the default clock of its graph is the real one."""

    effect: ClassVar[str] = ""
    """Name of the effect that the whole node computes, if any (nodes/base/effect.py)."""

    wanted: frozenset[str] | None = None
    """Names of the output fields that are read, set by the runner before `start`; None: all."""

    def __init__(self, **given: Any) -> None:
        self._notes: list[str] = []
        known = settings(type(self))
        for name in given:
            if name not in known:
                raise SettingError(f"setting {name!r}: unknown. Settings: {', '.join(known) or 'none'}.")
        for name, setting in known.items():
            if name not in given and setting.default is ...:
                raise SettingError(f"setting {name!r} [{setting.unit}]: missing")
            setattr(self, name, convert(setting, given[name]) if name in given else setting.default)

    def wants(self, field: str) -> bool:
        """Whether this field of the output is read."""
        return self.wanted is None or field in self.wanted

    def start(self) -> None:
        """Make or reset the state; slow work (loading, building) belongs here.

        Before the run, the runner steps the node on examples to compile its kernels, and then starts it again.
        """

    @classmethod
    def instead(cls, values: Mapping[str, Any]) -> tuple[str, str] | None:
        """The name of a class that takes the place of this one with these settings, which has the same inputs, outputs
        and settings at least, and why; None: this one."""
        return None

    def replaces(self) -> None:
        """Called after `start` if the run has begun already: a node of this name died, or this one started late.

        The state and the last output of a dead node are lost. Only on the real clock.
        """

    def check(self) -> None:
        """SettingError if `start` would not find stored data, such as a basis; called by `palpate check`."""

    step: Any

    @classmethod
    def wiring(cls) -> Callable[..., Any]:
        """The function whose signature names inputs and outputs."""
        return cls.step

    def rests(self, *inputs: Any) -> bool:
        """Whether a step on these inputs of `step` would change neither the state nor the answer.

        If so, the node sleeps and the runner repeats its last answer. Never called before the first step.
        """
        return False

    def stop(self) -> None:
        """Release the resources that `start` opened."""

    def condition(self) -> str:
        """A problem of the node in a few words, for `Health.state`; "": no problem."""
        return ""

    def notes(self) -> list[str]:
        """New lines for the user, from `_notes`; each is returned once. Called several times per second."""
        notes, self._notes = self._notes, []
        return notes


class Observer(Node):
    """A node that only listens to streams: a logger, a viewer. It receives the messages in their wire form."""

    sink = True

    def listen(self, streams: tuple[Stream, ...], about: dict[str, Any]) -> None:
        """Called once before `start`, with the available streams and the provenance of the run (plain data)."""
        self.streams, self.about = streams, about

    def take_origin(self, origin: int) -> None:
        """Called after `start`, before the first message, with the time of tick 0 [ns] on the monotonic clock.

        On the simulated clock later ticks are independent of the monotonic clock unless the run is paced.
        """

    def period(self, stream: str) -> int:
        """Ticks between the messages of a stream to receive on the simulated clock; 0: none."""
        return 1

    def observe(self, stream: str, tick: int, payload: bytes) -> None:
        """Take one message in its wire form."""
        raise NotImplementedError

    def observe_block(self, block: Block) -> None:
        """Take the messages of a block, see `observe`; override it where that is faster together."""
        for message in block.messages():
            self.observe(*message)

    def health(self, message: Health) -> None:
        """Called several times per second with the health of each node.

        The first call, with `steps` 0, precedes the node's first message; the last call follows its last message. When
        a node starts again, `steps` is 0 again.
        """


def once_per_class(read: F) -> F:
    """Cache the result per class: loading a graph reads the same annotations about 100 times."""
    return cast(F, cache(read))


@once_per_class
def settings(kind: type[Node]) -> dict[str, Setting]:
    """The settings of a node class by name, base class first. TypeError: a setting without a unit."""
    by_name = {}
    for base in reversed(kind.__mro__):
        if base in (Node, Observer, object):
            continue
        own = inspect.get_annotations(base)
        hints = typing.get_type_hints(base, include_extras=True) if own else {}
        for name in own:
            hint = hints[name]
            if typing.get_origin(hint) is ClassVar:
                continue
            marks = getattr(hint, "__metadata__", ())
            unit = next((m for m in marks if isinstance(m, str)), None)
            if unit is None:
                raise TypeError(f"{kind.__name__}.{name}: a setting needs a unit; write Annotated[type, unit]")
            limits = [m for m in marks if isinstance(m, msgspec.Meta)]
            plain = typing.get_args(hint)[0]
            bound = Annotated[plain, limits[0]] if limits else plain
            others = tuple(m for m in marks if not isinstance(m, str | msgspec.Meta))
            by_name[name] = Setting(name, unit, bound, getattr(kind, name, ...), others)
    return by_name


def plain(value: Any) -> Any:
    """A value from a notebook with its numbers and arrays of numpy, at any depth, as numbers and lists of Python."""
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist()) if value.dtype == object else value.tolist()
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    return [plain(item) for item in value] if isinstance(value, list | tuple) else value


def convert(setting: Setting, value: Any) -> Any:
    value = plain(value)
    try:
        return msgspec.convert(value, setting.type)
    except msgspec.ValidationError as error:
        found = f"found {written(value)}; {reword(error, setting.type)}"
        raise SettingError(f"setting {setting.name!r} [{setting.unit}]: {found}") from None


@once_per_class
def inputs(kind: type[Node]) -> tuple[Port, ...]:
    """The input ports of a node class, the driving one first. TypeError: an argument of `step` that is not a
    message."""
    wiring = kind.wiring()
    hints = typing.get_type_hints(wiring, include_extras=True)
    ports = []
    for name, parameter in list(inspect.signature(wiring).parameters.items())[1:]:
        hint = hints.get(name)
        if name == "dt" or parameter.kind is inspect.Parameter.KEYWORD_ONLY or OUT in getattr(hint, "__metadata__", ()):
            continue
        wants: frozenset[str] = frozenset()
        optional = False
        for mark in getattr(hint, "__metadata__", ()):
            if isinstance(mark, Wants):
                wants = mark.names
        if hasattr(hint, "__metadata__"):
            hint = typing.get_args(hint)[0]
        many = typing.get_origin(hint) is list
        if many:
            hint = typing.get_args(hint)[0]
        if typing.get_origin(hint) in (typing.Union, types.UnionType):
            rest = [a for a in typing.get_args(hint) if a is not type(None)]
            optional = len(rest) < len(typing.get_args(hint))
            hint = rest[0] if len(rest) == 1 else None
        if not (isinstance(hint, type) and issubclass(hint, Message)):
            raise TypeError(f"{kind.__name__}.{wiring.__name__}: input {name!r} is not a message but {hint!r}")
        ports.append(Port(name, hint, optional, wants or frozenset(hint.__struct_fields__), many))
    return tuple(ports)


@once_per_class
def outputs(kind: type[Node]) -> tuple[type[Message], ...]:
    """The message types that a node class sends, in order. TypeError: a return annotation that is not a message, a
    tuple of messages or None."""
    hints = typing.get_type_hints(kind.wiring(), include_extras=True)
    given = [typing.get_args(hint)[0] for hint in hints.values() if OUT in getattr(hint, "__metadata__", ())]
    hint = hints.get("return")
    kinds = typing.get_args(hint) if typing.get_origin(hint) is tuple else () if hint in (None, type(None)) else (hint,)
    kinds = tuple(given) or kinds
    for returned in kinds:
        if not (isinstance(returned, type) and issubclass(returned, Message)):
            raise TypeError(f"{kind.__name__}.step: returns {returned!r}, expected a message or a tuple of messages")
    return kinds
