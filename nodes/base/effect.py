"""Effects: optional computations outside the force loop, with names that scenes and graphs use.

An effect is declared where it is computed, in one of three ways, without conditions in the code:

    class LuGre(Node):
        effect = "friction"                                   # the whole node is the effect

    class BeamBundle(Node):
        relaxations: Annotated[Vector, "s", Switch("relaxation")] = (0.09, 4.4)   # a setting; 0 disables the effect

        @part("pressure", "pressure", otherwise=NO_PRESSURE)  # a method and the output fields that it fills
        def _pressure(self, load): ...

A part is computed only if one of its fields is read; otherwise the call returns `otherwise` without work.
"""

import functools
import typing
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, TypeVar

from palpate.messages import Message
from palpate.messages.docs import summary
from palpate.nodes.base.node import Node, settings

Method = TypeVar("Method", bound=Callable[..., Any])


@dataclass(frozen=True)
class Switch:
    """Mark of a setting that switches an effect: the value `off`, or a list of it, disables the effect."""

    effect: str
    off: float = 0.0

    def without(self, value: Any) -> Any:
        """The setting's value without the effect."""
        return [self.off] * len(value) if isinstance(value, list | tuple) else self.off

    def has(self, value: Any) -> bool:
        """Whether this value of the setting has the effect."""
        return any(number != self.off for number in (value if isinstance(value, list | tuple) else [value]))


@dataclass(frozen=True)
class Calibrated:
    """Mark of a setting that is calibrated for one tissue; a note names this tissue if a graph keeps the default."""

    default: str  # tissue of the default
    command: str  # command that fits the setting to another tissue


@dataclass(frozen=True)
class Ideal:
    """Mark of a setting that describes an imperfection of a sensor, such as the count of an encoder:

    resolution: Annotated[float, "rad", Ideal("counts of the encoder")] = FALCON.count

    about   the imperfection, in a few words
    value   of the setting without it
    jumps   whether results jump with it when another setting changes a little, so that they have no derivative
    hand    whether it is one of the hand, which `hand: {ideal: true}` in a scene removes (launch/load/checks/ideal.py)
    """

    about: str
    value: float = 0.0
    jumps: bool = True
    hand: bool = True


class Agrees:
    """Mark of a setting that describes one thing in several nodes, such as the patch under the finger in the node that
    spreads the load and in the body that carries it:

    radius: Annotated[float, "m", Agrees(Load)] = 8e-3

    messages  types of the messages along which it agrees with the setting of the same name in the sender, also through
              nodes without this setting, and in other readers of the same sender

    twice     name of another setting of the node of which it is twice, if that is set and it is set nowhere

    The loader gives all of them the value that is set for one of them, and refuses different ones.
    """

    def __init__(self, *messages: type[Message], twice: str = "") -> None:
        self.messages, self.twice = messages, twice


@dataclass(frozen=True)
class Follows:
    """Mark of a setting that describes what the senders of a message have, such as the width of the fingers on a body.

    width: Annotated[float, "m", Follows(Load)] = WIDTH

    message  type of the messages from these senders, also through nodes without this setting

    Where it is not set, the loader gives it the largest value of the senders, which may differ.
    """

    message: type[Message]


@dataclass(frozen=True)
class Effect:
    """How a node class computes an effect.

    how      "node": by the whole class; "part": by a method; "setting": by the value of a setting
    """

    name: str  # of the effect
    how: Literal["node", "part", "setting"]
    fields: tuple[str, ...] = ()  # output fields that contain it; (): the whole message
    setting: str = ""  # setting that switches it; "": none
    about: str = ""  # description, one sentence
    also: tuple[str, ...] = ()  # output fields of other effects that need it


class Part:
    """Part of a node that is computed only if one of `fields` is read. In a compiled node, `own.NAME` is its flag in
    the kernel; in a node in Python, see `part`.

    effect  name of its effect
    about   description, one sentence
    also    fields of other effects that need it
    """

    def __init__(self, effect: str, *fields: str, about: str, also: tuple[str, ...] = ()) -> None:
        self.part = Effect(effect, "part", fields, about=about, also=also)
        self._needed = frozenset((*fields, *also))

    def is_wanted(self, node: Node) -> bool:
        """Whether one of its fields is read."""
        return node.wanted is None or not node.wanted.isdisjoint(self._needed)


def part(effect: str, *fields: str, otherwise: Any, also: tuple[str, ...] = ()) -> Callable[[Method], Method]:
    """Mark of a method that computes an effect; it runs only if one of the output fields `fields` or `also` is read.

    fields     output fields that the method computes
    otherwise  result of the call if it does not run
    also       other output fields that need it
    """

    def mark(method: Method) -> Method:
        marked = Part(effect, *fields, about=summary(method), also=also)

        @functools.wraps(method)
        def where_wanted(self: Node, *given: Any) -> Any:
            return method(self, *given) if marked.is_wanted(self) else otherwise

        where_wanted.part = marked.part  # type: ignore[attr-defined]
        return typing.cast(Method, where_wanted)

    return mark


def effects(kind: type[Node]) -> tuple[Effect, ...]:
    """The effects that a node class can compute, that of the class first; a name may occur twice."""
    own = [Effect(kind.effect, "node", about=summary(kind))] if kind.effect else []
    for name in dir(kind):
        marked = getattr(getattr(kind, name, None), "part", None)
        if isinstance(marked, Effect):
            own.append(marked)
    for setting in settings(kind).values():
        own += [Effect(s.effect, "setting", (), setting.name) for s in setting.marks if isinstance(s, Switch)]
    return tuple(own)


def switch(kind: type[Node], effect: Effect) -> Switch:
    """The mark of the setting that switches an effect."""
    marks = settings(kind)[effect.setting].marks
    return next(m for m in marks if isinstance(m, Switch) and m.effect == effect.name)
