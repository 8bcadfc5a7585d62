"""Friction of the fingertip on the tissue (docs/equations/friction.md): a node for each law in physics/friction."""

import typing
from typing import Annotated, Any, ClassVar

import msgspec

from palpate.messages import Contact, Friction, Proximity, Vector
from palpate.nodes.base import Node, Wants, part
from palpate.physics import friction
from palpate.physics.friction import bristle
from palpate.registry import classes

SIGNS = {">": "gt", ">=": "ge", "<": "lt", "<=": "le"}


class _Sliding(Node):
    """Shared by all laws: the state and the form of the output."""

    effect = "friction"
    law: ClassVar[Any]

    def start(self) -> None:
        law = self.law(**{name: getattr(self, name) for name in self.law._fields})
        self._kernel, self._bristles = bristle.kernel_form(law), bristle.Bristles()
        caution = law.caution() if hasattr(law, "caution") else ""
        self._notes = [caution] if caution else []

    def rests(self, contact: Contact, proximity: Proximity) -> bool:
        return not contact.force > 0.0 and not self._bristles.load > 0.0

    def step(
        self,
        contact: Annotated[Contact, Wants("normal", "force")],
        proximity: Annotated[Proximity, Wants("slip")],
        *,
        dt: float,
    ) -> Friction:
        self._bristles, force, stick = bristle.step(
            self._kernel, self._bristles, contact.normal, proximity.slip, contact.force, dt
        )
        return Friction(force=force, bristle=self._bristles.z, stick=stick, stored=self._stored())

    @part("energy", "stored", otherwise=())
    def _stored(self) -> Vector:
        """The energy that the bristles hold and that a rising load may give back; () for a law without `stored`."""
        stored, now = self._kernel.stored, self._bristles
        return (stored(now.z, now.load) + now.spare,) if stored is not None else ()


def node_of(law: type, name: str = "", module: str = __name__) -> type[Node]:
    """The node class of a bristle law: its settings are the law's fields. Palpate's own laws have theirs by themselves;
    a module of another package with the law `Dahl` says `Sliding = node_of(Dahl, "Sliding", __name__)`."""
    settings = {name: _setting(hint) for name, hint in typing.get_type_hints(law, include_extras=True).items()}
    own = {"__doc__": law.__doc__, "__module__": module, "__annotations__": settings, "law": law}
    return type(name or law.__name__, (_Sliding,), own | law._field_defaults)  # type: ignore[attr-defined]


def _setting(hint: Any) -> Any:
    """`Annotated[float, unit, "> 0"]` with the limit in the form that settings take."""
    kind, unit, *limits = typing.get_args(hint)
    bounds: dict[str, Any] = {SIGNS[sign]: float(bound) for sign, bound in (limit.split() for limit in limits)}
    return Annotated[kind, unit, msgspec.Meta(**bounds)] if bounds else hint


_NODES = {name: node_of(law) for name, law in classes(friction, tuple).items() if hasattr(law, "advance")}


def __getattr__(name: str) -> type[Node]:
    if name not in _NODES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return _NODES[name]


def __dir__() -> list[str]:
    return [*globals(), *_NODES]
