"""Shared by all nodes that communicate with a device: port, reconnection, and the thread of the exchange."""

from collections.abc import Callable
from typing import Annotated, ClassVar

from palpate.drivers.emulate.faults import EmulatedFaults
from palpate.drivers.exchange import Driver, Exchange
from palpate.drivers.guard import DeviceSample, Guard
from palpate.nodes.base.node import Node

EMULATOR = "emulator"  # the port of emulated devices
SLOW = 0.9  # [1] answers per step below which a note is printed


class Wired(Node):
    """A node that communicates with a device of this machine. Common settings:

    port       of the device, as `palpate devices` lists it; empty: the only device; `emulator`: an emulated one
    reconnect  whether to wait for a device that was disconnected
    faults     simulated faults of the emulator
    """

    sink: ClassVar[bool] = True
    hardware: ClassVar[bool] = True

    port: Annotated[str, "1"] = ""
    reconnect: Annotated[bool, "1"] = False
    faults: Annotated[EmulatedFaults, "1"] = EmulatedFaults()

    def driver(self) -> Driver:
        raise NotImplementedError

    def guard(self, driver: Driver) -> Guard:
        return Guard(driver.limits)

    def start(self) -> None:
        self.steps, self.seconds, self.reported = 0, 0.0, False
        self.go: Callable[[], None] | None = None
        driver = self.driver()
        self.exchange = Exchange(driver, self.guard(driver), reconnect=self.reconnect)
        self.exchange.start()

    def stop(self) -> None:
        """DeviceError: the device is still disconnected after waiting for it."""
        if hasattr(self, "exchange"):
            self.exchange.stop()
            if (lost := self.exchange.lost) is not None:
                self.exchange.lost = None
                raise lost

    def talk(self, command: tuple[float, ...], dt: float) -> DeviceSample | None:
        """Set the newest command and return the newest sample, without waiting for the device."""
        if not self.steps and self.go is not None:  # an emulated hand starts its path at the graph's first tick
            self.go()
        self.steps += 1
        self.seconds += dt
        self.exchange.command(command)
        return self.exchange.sample()

    def notes(self) -> list[str]:
        """New lines for the user, each once: the device is disconnected, reconnected or too slow."""
        if not hasattr(self, "exchange"):
            return []
        notes = self.exchange.notes()
        rate = self.exchange.rate
        if self.steps > 2000 and not self.reported and 0.0 < rate < SLOW * self.steps / self.seconds:
            self.reported = True
            notes.append(
                f"the device answers {rate:.0f} times a second, the graph asks {self.steps / self.seconds:.0f} times:"
                f" the rest is extrapolated from the last answers. `rate: {50 * max(1, int(rate / 50))}` fits;"
                " `palpate doctor` shows what slows this machine."
            )
        return notes
