"""Surfaces that are prepared once and stored for later runs, and reports of their progress."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager

Watch = Callable[[str], AbstractContextManager[object]]
_watching: list[Watch] = []


@contextmanager
def watched(watch: Watch) -> Iterator[None]:
    """Within this context, `watch` is called with what is prepared, and returns a context for the meantime."""
    _watching.append(watch)
    try:
        yield
    finally:
        _watching.remove(watch)


@contextmanager
def prepares(what: str) -> Iterator[None]:
    """The context in which a surface is prepared."""
    with ExitStack() as entered:
        for watch in _watching[-1:]:
            entered.enter_context(watch(what))
        yield
