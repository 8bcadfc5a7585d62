"""A task: how to compute items, as plain data that any process with the same sources can use."""

import functools
import platform
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple, Protocol

from palpate.compiler import arithmetic, kernel_cache

ROOMS = ("palpate.physics", "palpate.models.fe", "palpate.messages", "palpate.nodes", "palpate.engine")
"""Packages whose code determines the results: an edit to one of them changes the keys of all points."""
FORM = ("palpate.launch", "palpate.studies", "palpate.records")
"""Packages whose code determines the form of tasks and results."""

Beat = Callable[[], None]
"""Called while kernels are compiled, and after each step of a computation: the time limit begins again."""


class Ended(NamedTuple):
    """Why an item has no result: its process took too long, or ended. `seconds` [s] after its start."""

    why: str
    seconds: float


class Task(Protocol):
    """The data that all items of a task share.

    limit  timeout of an item [s]; None: no timeout
    """

    limit: float | None

    def check(self) -> None:
        """RunError: this machine has other files than the one that made the task."""

    def compute(self, items: Sequence[Any], beat: Beat) -> Iterator[tuple[int, Any]]:
        """Compute items; the place and the result of each, in any order."""


@functools.cache
def sources() -> str:
    """A hash of the sources of palpate by which the nodes of a run compute and exchange messages."""
    return kernel_cache.key((*ROOMS, "palpate.launch"))


def fingerprint() -> dict[str, str]:
    """Versions and arithmetic: together with the graph they determine the bytes of the results."""
    sources = {"sources of palpate": kernel_cache.key(ROOMS), "python": platform.python_version()}
    return sources | arithmetic.in_force(here=False)


def about() -> dict[str, str]:
    """Return versions and hashes; they must be equal in the process that makes tasks and in those that compute them."""
    return fingerprint() | {"sources of its tasks": kernel_cache.key(FORM)}
