"""Intrinsics: functions in kernels for which palpate generates the code."""

from collections.abc import Callable
from importlib import import_module
from typing import Any

from palpate.compiler import interpreted
from palpate.compiler.target.deferred import Deferred

COMPILER = f"{__name__.partition('.')[0]}.compiler"


class Intrinsic(Deferred):
    """A function that only kernels can call."""

    def __init__(self, plain: Callable[..., Any], place: str, given: tuple[Any, ...], options: dict[str, Any]) -> None:
        super().__init__(plain, lambda: _registered(place, given, options))
        module, _, name = place.partition(".")
        self.__module__, self.__name__, self.__qualname__ = f"{COMPILER}.{module}", name, name

    @property
    def _numba_type_(self) -> Any:
        from numba.core.typing.templates import builtin_registry

        return next(kind for value, kind in reversed(builtin_registry.globals) if value is self.made)


def intrinsic(plain: Callable[..., Any], place: str, *given: Any, **options: Any) -> Any:
    """An intrinsic for kernels.

    plain    the same in Python
    place    the function of `generators` that generates its code, as `module.function`; with `given` it returns that
             function for these values
    options  of `numba.extending.intrinsic`
    """
    return plain if interpreted.ENABLED else Intrinsic(plain, place, given, options)


def _registered(place: str, given: tuple[Any, ...], options: dict[str, Any]) -> Any:
    from numba import extending

    module, _, name = place.partition(".")
    generator = getattr(import_module(f"{COMPILER}.generators.{module}"), name)
    decorate = extending.intrinsic(**options) if options else extending.intrinsic
    return decorate(generator(*given) if given else generator)
