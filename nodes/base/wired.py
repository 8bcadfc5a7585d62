"""Shared by all nodes that communicate with a device: its port, whether to wait for it, and the thread."""

from collections.abc import Callable
from typing import Annotated, ClassVar

from palpate.drivers.emulate.faults import EmulatedFaults
from palpate.drivers.exchange import Driver, Exchange
from palpate.drivers.guard import DeviceSample, Guard
from palpate.nodes.base.node import Node

EMULATOR = "emulator"  # the port at which there is no hardware
SLOW = 0.9  # [1] answers per step below which the user is told


class Wired(Node):
    """A node that talks to a device of this machine. Settings of all such nodes:

    port       which one: empty where there is only one, else as `palpate devices` shows it; `emulator`: none at all
    reconnect  whether a device that is gone is waited for
    faults     bad days of the emulator
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
        self.steps, self.seconds, self.told = 0, 0.0, False
        self.go: Callable[[], None] | None = None
        driver = self.driver()
        self.exchange = Exchange(driver, self.guard(driver), reconnect=self.reconnect)
        self.exchange.start()

    def stop(self) -> None:
        """DeviceError: the device was waited for and is still gone."""
        if hasattr(self, "exchange"):
            self.exchange.stop()
            if (lost := self.exchange.lost) is not None:
                self.exchange.lost = None
                raise lost

    def talk(self, command: tuple[float, ...], dt: float) -> DeviceSample | None:
        """Give the newest command, get the newest sample. Neither waits for the device."""
        if not self.steps and self.go is not None:  # an emulated hand goes its way from the graph's first tick
            self.go()
        self.steps += 1
        self.seconds += dt
        self.exchange.command(command)
        return self.exchange.sample()

    def notes(self) -> list[str]:
        """What the user should see: a device that is gone or back, or too slow; each line once."""
        if not hasattr(self, "exchange"):
            return []
        notes = self.exchange.notes()
        rate = self.exchange.rate
        if self.steps > 2000 and not self.told and 0.0 < rate < SLOW * self.steps / self.seconds:
            self.told = True
            notes.append(
                f"the device answers {rate:.0f} times a second, the graph asks {self.steps / self.seconds:.0f} times:"
                f" the rest is extrapolated from the last answers. `rate: {50 * max(1, int(rate / 50))}` fits;"
                " `palpate doctor` shows what slows this machine."
            )
        return notes
