"""What every node is: settings as fields, ports from the signature of `step`, state made in `start`."""

import inspect
import types
import typing
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, ClassVar, TypeVar, cast

import msgspec
import numpy as np

from palpate.messages import Health, Message
from palpate.nodes.base.block import Block
from palpate.physics.errors import MISUSE, PalpateError

F = TypeVar("F", bound=Callable)


class SettingError(PalpateError, ValueError):
    """A setting that the node does not have, or a value that the setting does not take."""

    exit_code = MISUSE


class InputError(PalpateError, ValueError):
    """An input that cannot be used, by the fault of the node that sent it: raised in `step`, told as that node's."""

    def __init__(self, message: Any, text: str) -> None:
        who = f" of {message.source!r} at tick {message.tick}" if message.source else ""
        super().__init__(f"{type(message).__name__}{who}: {text}")
        self.source = message.source


OUT = "output"
T = TypeVar("T")
Out = Annotated[T, OUT]
"""Mark of an argument of a compiled node that is its output: `out: Out[Contact]`."""


class Wants:
    """Mark of an input port that reads only some fields of its message, so that the sender may leave out the others:

    def step(self, proximity: Proximity, body: Annotated[Surface, Wants("stiffness", "exponent")]) -> Contact:
    """

    def __init__(self, *names: str) -> None:
        self.names = frozenset(names)


@dataclass(frozen=True)
class Setting:
    """One setting of a node: name, SI unit, Python type with its limits, default (`...` where there is none), and what
    else its annotation says."""

    name: str
    unit: str
    type: Any
    default: Any
    marks: tuple[Any, ...] = ()


@dataclass(frozen=True)
class Port:
    """One input of a node: name, message type, whether it may be None, the fields that it reads, and whether it takes
    any number of senders."""

    name: str
    type: type[Message]
    optional: bool
    wants: frozenset[str]
    many: bool = False

    @property
    def expects(self) -> str:
        """Its type as it is written in the class."""
        one = self.type.__name__ + " | None" * self.optional
        return f"list[{one}]" if self.many else one


@dataclass(frozen=True)
class Stream:
    """One stream that an observer hears: name, message type, sending node and its divisor of the base rate."""

    name: str
    type: type[Message]
    producer: str
    every: int


class Node:
    """One job of the graph.

    Settings are annotated class attributes, `Annotated[type, unit]` with a default or without; the constructor
    takes them by name. The signature of `step` is the wiring: its arguments are the inputs, its return annotation is
    the output (a tuple of types: several outputs). The first input drives: its arrival runs the step. An argument of
    type `list[Load]` takes any number of senders, in the order of the graph; with `list[Load | None]` a place is None
    while its sender is gone. `dt`, keyword-only, comes from the runner: the time [s] since the previous step of this
    node on the graph's clock, > 0.

    A step reads no clock, file, socket or random source without a seed in the settings: its answer depends on its
    inputs and its state alone, and the state is made in `start`, so that a run can be replayed exactly.
    """

    paced: ClassVar[bool] = False  # True for a source: the clock runs its step, and all its inputs are held
    sink: ClassVar[bool] = False
    """True where the node matters for itself (it drives hardware, writes a file, shows a picture)."""
    hardware: ClassVar[bool] = False
    """True for a node that talks to a device: its graph runs on the real clock unless told otherwise."""

    effect: ClassVar[str] = ""
    """The effect that this node computes as a whole, if there is a name for it (nodes/base/effect.py)."""

    wanted: frozenset[str] | None = None
    """Names of the output fields that somebody reads, set by the runner before `start`; None means all."""

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
        """Whether somebody reads this field of the output."""
        return self.wanted is None or field in self.wanted

    def start(self) -> None:
        """Make the state; also the reset. Slow work (load, build) belongs here. The runner steps the node on examples
        and starts it again before the run, so that what is compiled is compiled by then."""

    def replaces(self) -> None:
        """Called after `start` if the run began before: a node of this name died or started late, and its state and
        its last output are lost. On the real clock only."""

    def check(self) -> None:
        """SettingError where `start` would not find something that is stored outside the node; `palpate check` asks."""

    step: Any

    @classmethod
    def wiring(cls) -> Callable[..., Any]:
        """The function whose signature names inputs and outputs."""
        return cls.step

    def rests(self, *inputs: Any) -> bool:
        """Whether a step on these inputs, those of `step`, would leave the state as it is and answer what was answered
        last: then the node sleeps, and the runner sends that answer again. Never asked before the first step."""
        return False

    def stop(self) -> None:
        """Give back what `start` opened."""

    def condition(self) -> str:
        """What is out of order with it, in a few words; "" while all is well. `Health.state` tells it."""
        return ""

    def notes(self) -> list[str]:
        """Lines that the user should see, those of `_notes`; asked a few times a second, and each is given once."""
        notes, self._notes = self._notes, []
        return notes


class Observer(Node):
    """A node that listens to streams instead of taking part: a logger, a viewer. It gets each message as it travels."""

    sink = True

    def listen(self, streams: tuple[Stream, ...], about: dict[str, Any]) -> None:
        """Told once, before `start`: what there is to hear, and what is known of the run (plain data)."""
        self.streams, self.about = streams, about

    def begun(self, origin: int) -> None:
        """Told after `start`, before the first message: when tick 0 is, [ns] on this machine's monotonic clock. On the
        simulated clock, unless it is paced, only tick 0 has to do with that clock."""

    def period(self, stream: str) -> int:
        """Of a stream on the simulated clock it takes the messages of the ticks that this divides; 0: it takes none."""
        return 1

    def observe(self, stream: str, tick: int, payload: bytes) -> None:
        """Take one message in its wire form."""
        raise NotImplementedError

    def observe_block(self, block: Block) -> None:
        """Take the messages of a block, see `observe`; override it where that is faster together."""
        for message in block.messages():
            self.observe(*message)

    def health(self, message: Health) -> None:
        """Told a few times a second how each node is doing: before its first message, with `steps` 0, and last after
        its last message. A second start of a node shows as `steps` 0 again."""


def _once(read: F) -> F:
    """Read a class once: loading a graph asks for the same annotations a hundred times."""
    return cast(F, cache(read))


@_once
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


def convert(setting: Setting, value: Any) -> Any:
    if isinstance(value, np.ndarray | np.generic):  # from a notebook
        value = value.tolist()
    try:
        return msgspec.convert(value, setting.type)
    except msgspec.ValidationError as error:
        text = str(error).replace("`", "")
        if "unknown field" in text and isinstance(setting.type, type) and issubclass(setting.type, msgspec.Struct):
            text += f"; expected {', '.join(setting.type.__struct_fields__)}"
        raise SettingError(f"setting {setting.name!r} [{setting.unit}]: found {value!r}. {text}.") from None


@_once
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


@_once
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
