"""Bristle laws of friction in tests: their kernel, step by step."""

from typing import Any, NamedTuple, get_args, get_type_hints

from palpate.physics.friction.bristle import NOTHING, UP, stepper

Vector = tuple[float, float, float]


class Bristles(NamedTuple):
    """Deflection [m], its normal [1] and normal force [N], the position of the finger relative to the dragged point
    [m], and the energy released by falling loads [J]."""

    z: Vector = NOTHING
    normal: Vector = UP
    load: float = 0.0
    slack: Vector = NOTHING
    spare: float = 0.0


def kernel_form(law: Any) -> Any:
    """The law with words replaced by their indices."""
    hints = get_type_hints(type(law))
    return law._replace(**{k: get_args(hints[k]).index(v) for k, v in law._asdict().items() if isinstance(v, str)})


def step(law: Any, before: Bristles, normal: Vector, slip: Vector, load: float, dt: float):
    """One step: (bristles, force [N] (3), whether it sticks). `law` from `kernel_form`."""
    *after, force, stick = stepper(type(law))(law, *before, normal, slip, float(load), float(dt))
    return Bristles(*after), force, stick
