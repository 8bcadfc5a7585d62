"""Effects: what a node computes beyond the force loop itself, by a name that scenes and graphs use.

An author declares an effect where it is computed, in one of three ways, and writes no condition:

    class LuGre(Node):
        effect = "friction"                                   # the whole node is the effect

    class BeamBundle(Node):
        relaxations: Annotated[Vector, "s", Switch("relaxation")] = (0.09, 4.4)   # a setting; zero is without it

        @part("pressure", "pressure", otherwise=NO_PRESSURE)  # a method and the output fields that it fills
        def _pressure(self, load): ...

A part is computed only where somebody reads one of its fields; otherwise the call gives `otherwise` and does no work.
"""

import functools
import typing
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, TypeVar

from palpate.messages.docs import summary
from palpate.nodes.base.node import Node, settings

Method = TypeVar("Method", bound=Callable[..., Any])


@dataclass(frozen=True)
class Switch:
    """Mark of a setting that holds an effect: at `off` the node is without it. In a list, each number is."""

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
    """Mark of a setting that holds for one tissue: a graph that leaves it at its default is told what that stands
    for."""

    default: str  # what the default is calibrated to
    command: str  # that fits it to another tissue


@dataclass(frozen=True)
class Effect:
    """How one node class computes an effect.

    how      "node": the class is the effect; "part": a method of it; "setting": a value of it
    """

    name: str  # of the effect
    how: Literal["node", "part", "setting"]
    fields: tuple[str, ...] = ()  # output fields that show it, () where the whole message does
    setting: str = ""  # that holds it, "" for others
    about: str = ""  # what it is, in a sentence
    also: tuple[str, ...] = ()  # output fields of other effects that need it


def part(effect: str, *fields: str, otherwise: Any, also: tuple[str, ...] = ()) -> Callable[[Method], Method]:
    """Mark of a method that computes an effect: it runs only where somebody reads one of `fields` of the output, or of
    those that need it `also`; otherwise the call gives `otherwise`."""

    def mark(method: Method) -> Method:
        needed = frozenset((*fields, *also))

        @functools.wraps(method)
        def where_wanted(self: Node, *given: Any) -> Any:
            wanted = self.wanted
            return otherwise if wanted is not None and wanted.isdisjoint(needed) else method(self, *given)

        where_wanted.part = Effect(effect, "part", fields, about=summary(method), also=also)  # type: ignore[attr-defined]
        return typing.cast(Method, where_wanted)

    return mark


def effects(kind: type[Node]) -> tuple[Effect, ...]:
    """The effects that a node class can compute, the class itself first; a name may come twice."""
    own = [Effect(kind.effect, "node", about=summary(kind))] if kind.effect else []
    for name in dir(kind):
        marked = getattr(getattr(kind, name, None), "part", None)
        if isinstance(marked, Effect):
            own.append(marked)
    for setting in settings(kind).values():
        own += [Effect(s.effect, "setting", (), setting.name) for s in setting.marks if isinstance(s, Switch)]
    return tuple(own)


def switch(kind: type[Node], effect: Effect) -> Switch:
    """The mark of a setting that holds an effect."""
    marks = settings(kind)[effect.setting].marks
    return next(m for m in marks if isinstance(m, Switch) and m.effect == effect.name)
