"""Friction of the fingertip on the tissue (docs/equations/friction.md): one node per law in physics/friction."""

import types
import typing
from typing import Annotated, Any, ClassVar

import msgspec

from palpate.compiler.kernel import CompiledKernel
from palpate.compiler.records import one, put, vector
from palpate.messages import Contact, Friction, Load, Proximity
from palpate.messages.sliding import Sliding
from palpate.nodes.base import Agrees, CompiledNode, Ideal, Node, Out, Part, Wants
from palpate.nodes.base.kernels import ieee_kernel, kernel
from palpate.nodes.base.samples import SLID, slid
from palpate.physics import friction
from palpate.physics.friction import bristle, components, coulomb, elastoplastic, lugre, unrest
from palpate.registry import classes

HELD = 1e-9  # [s] step without a new sample: the bristles stay, force and damping follow the load
MARKS = {
    "mu_static": (Agrees(Load, Friction),),  # with the margin of a grip
    "play": (Ideal("dead zone of half a count", jumps=False),),
}
SIGNS = {">": "gt", ">=": "ge", "<": "lt", "<=": "le"}


class _Sliding(CompiledNode):
    """State and output that all laws share.

    A step lasts from one sample of the finger's position to the next, as in the contact. While a network repeats a
    sample, the bristles stay and the force follows the normal force; the next sample moves them by the displacement of
    the finger.
    """

    effect = "friction"
    law: ClassVar[Any]
    spring: ClassVar[str] = "the stiffness of its bristles"  # setting that softens the stick
    energy = Part(
        "energy",
        "stored",
        about="Energy stored in the bristles, plus what a rising load may return; 0 for a law without `stored`.",
    )
    State = {"z": (3,), "normal": (3,), "load": (), "slack": (3,), "spare": (), "rest": unrest.UNREST, "motion": SLID}
    """Bristle deflection [m] with its normal [1] and normal force [N]; offset of the finger from the point that it
    drags [m]; energy that a falling load took from the bristles [J]; state of `physics.friction.unrest`; sample of the
    position."""

    def __init_subclass__(cls, law: type | None = None, **given: Any) -> None:
        """The fields of the law become settings of the node.

        law  a `NamedTuple` with `advance` (docs/equations/friction.md); None: a class that is derived from a node
        """
        if law is not None:
            settings = typing.get_type_hints(law, include_extras=True)
            cls.__annotations__ = {name: _setting(hint, *MARKS.get(name, ())) for name, hint in settings.items()}
            values = law._field_defaults | {"law": law, "compute": _compute(law)}  # type: ignore[attr-defined]
            values["spring"] = next(
                (name for name in ("stiffness", "bristle_stiffness") if name in settings), cls.spring
            )
            values["__doc__"] = cls.__doc__ or law.__doc__
            for name, value in values.items():
                setattr(cls, name, value)
        super().__init_subclass__(**given)

    def start(self) -> None:
        super().start()
        law = self.law(**{name: getattr(self, name) for name in self.law._fields})
        caution = law.caution() if hasattr(law, "caution") else ""
        self._notes = [caution] if caution else []
        self.own["normal"], self.own["motion"]["sampled"] = bristle.UP, -1

    def notes(self) -> list[str]:
        """Also a note, once, that the finger does not rest."""
        if self.known["rest"]["worst"] > 0.0:
            seconds = unrest.WINDOW * unrest.LONG
            self._note_once(
                f"{type(self).__name__}: the finger does not rest: its friction oscillates by more than "
                f"{1e3 * unrest.LIMIT:g} mN (RMS) for {seconds:g} s while the finger stays in place. The spring along "
                f"the surface is too stiff for the delay of this device and this hand. Lower {self.spring}, or raise "
                "the rate"
            )
        return super().notes()

    @kernel
    def idle(own, contact, proximity, out, dt):
        if contact.force > 0.0 or own.load > 0.0:
            return False
        slid(own.motion, proximity, dt)
        return True


def _compute(law: type) -> CompiledKernel:
    """The kernel of a law's node."""
    step, stored = bristle.stepper(law), getattr(law, "stored", _stores_nothing)
    stores = hasattr(law, "stored")

    @ieee_kernel
    def compute(
        own,
        contact: Annotated[Contact, Wants("normal", "force")],
        proximity: Annotated[Proximity, Wants("slip", "foot", "normal", "gap")],
        out: Out[Friction],
        dt,
    ):
        moved, v = slid(own.motion, proximity, dt)
        z, normal, own.load, slack, own.spare, force, stick = step(
            own, vector(own.z), vector(own.normal), own.load, vector(own.slack), own.spare, vector(contact.normal),
            v, contact.force, moved if moved > 0.0 else HELD,
        )  # fmt: skip
        if contact.force > 0.0:
            rate = moved / dt
            unrest.watch(own.rest, force, (rate * v[0], rate * v[1], rate * v[2]), dt)
        put(own.z, z)
        put(own.normal, normal)
        put(own.slack, slack)
        put(out.force, force)
        put(out.bristle, z)
        out.stick = stick
        if stores and own.energy:
            one(out.stored, stored(own, z, own.load) + own.spare)

    return compute


@kernel
def _stores_nothing(law, z, load):
    return 0.0


def _setting(hint: Any, *marks: Any) -> Any:
    """Turn `Annotated[float, unit, "> 0"]` into a setting, whose limit is a `msgspec.Meta`, with these marks."""
    kind, unit, *limits = typing.get_args(hint)
    bounds: dict[str, Any] = {SIGNS[sign]: float(bound) for sign, bound in (limit.split() for limit in limits)}
    return Annotated[kind, unit, *([msgspec.Meta(**bounds)] if bounds else limits), *marks]


class Coulomb(_Sliding, law=coulomb.Coulomb):
    __doc__ = coulomb.Coulomb.__doc__


class LuGre(_Sliding, law=lugre.LuGre):
    __doc__ = lugre.LuGre.__doc__


class ElastoPlastic(_Sliding, law=elastoplastic.ElastoPlastic):
    __doc__ = elastoplastic.ElastoPlastic.__doc__


class Components(CompiledNode):
    """Contact force along and across the sliding direction: f_n, f_f and f_b (docs/equations/friction.md).

    No shipped graph contains it, since it only measures. At and below the speed `slow` the direction is that of the
    last faster motion, because counts of an encoder have no direction.
    """

    slow: Annotated[float, "m/s", msgspec.Meta(ge=0)] = components.SLOW

    State = {"way": (3,), "normal": (3,)}
    """Sliding direction [1] and the normal [1] of its plane."""

    @kernel
    def compute(
        own,
        friction: Annotated[Friction, Wants("force")],
        contact: Annotated[Contact, Wants("normal", "force")],
        proximity: Annotated[Proximity, Wants("slip")],
        out: Out[Sliding],
        dt,
    ):
        way, normal = vector(own.way), vector(contact.normal)
        if not contact.force > 0.0:
            way = (0.0, 0.0, 0.0)
        along, across, speed, way = components.split(
            way, vector(own.normal), vector(friction.force), normal, vector(proximity.slip), own.slow
        )
        if not contact.force > 0.0:
            along, across, way = 0.0, 0.0, (0.0, 0.0, 0.0)
        put(own.way, way)
        put(own.normal, normal)
        put(out.direction, way)
        out.normal, out.along, out.across, out.speed = contact.force, along, across, speed


def node_of(law: type, name: str = "", module: str = __name__) -> type[Node]:
    """Make the node class of a bristle law; its settings are the fields of the law.

    Shipped laws already have node classes. A module of another package with the law `Dahl` defines
    `Sliding = node_of(Dahl, "Sliding", __name__)`.
    """
    given = {"__doc__": law.__doc__, "__module__": module}
    return types.new_class(name or law.__name__, (_Sliding,), {"law": law}, lambda space: space.update(given))


# A law that is added to physics/friction is a node without another line here.
for _name, _law in classes(friction, tuple).items():
    if hasattr(_law, "advance") and _name not in globals():
        globals()[_name] = node_of(_law)
