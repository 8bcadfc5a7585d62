"""Bristle laws of friction in tests: their kernel, one step after the other."""

from typing import Any, NamedTuple, get_args, get_type_hints

from palpate.physics.friction.bristle import NOTHING, UP, stepper

Vector = tuple[float, float, float]


class Bristles(NamedTuple):
    """Deflection [m], normal [1] and normal force [N] that it was found under, the finger's place from the point that
    it drags [m]."""

    z: Vector = NOTHING
    normal: Vector = UP
    load: float = 0.0
    slack: Vector = NOTHING


def kernel_form(law: Any) -> Any:
    """The law with each choice of words as its place among them."""
    hints = get_type_hints(type(law))
    return law._replace(**{k: get_args(hints[k]).index(v) for k, v in law._asdict().items() if isinstance(v, str)})


def step(law: Any, before: Bristles, normal: Vector, slip: Vector, load: float, dt: float):
    """One step: (bristles, force [N] (3), whether it sticks). `law` from `kernel_form`."""
    *after, force, stick = stepper(type(law))(law, *before, normal, slip, float(load), float(dt))
    return Bristles(*after), force, stick
