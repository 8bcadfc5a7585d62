"""Errors of devices, reported in one line with the next step."""

import importlib
from typing import Any

from palpate.physics.errors import PalpateError
from palpate.physics.extras import missing


class DeviceError(PalpateError, RuntimeError):
    """A device is missing, not permitted, unsuitable, or lost. The text says what was found and what to do next.

    lost  whether the device was connected before, and may return
    """

    def __init__(self, text: str, *, lost: bool = False) -> None:
        super().__init__(text)
        self.lost = lost


def package(module: str) -> Any:
    """Import a module of an extra. DeviceError: it is not installed."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise DeviceError(missing("the driver", error.name or module, "devices")) from None
