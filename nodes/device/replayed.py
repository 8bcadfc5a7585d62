"""A device that repeats a recorded motion."""

from collections.abc import Iterator
from typing import Annotated

import msgspec
from mcap.records import Channel

from palpate.messages import DeviceState, Force, MessageError, Torque, unpack
from palpate.nodes.base import Node, SettingError
from palpate.nodes.device.motion import read_motion
from palpate.records.format.mcap_file import Broken, messages, read_declarations, read_records


class Replayed(Node):
    """A device with the states of a recording, one per tick, or of a table of a motion; then it stays at the last one.

    path    of the recording, or of a CSV with the columns `t` [s] and either `x`, `y`, `z` [m] or `joint1`, `joint2`,
            ... [rad], and optionally `buttons`; linear interpolation between rows. Other units are named in the
            header: `t [ms]`, `x [mm]`, `joint1 [deg]`
    stream  name of the stream of `DeviceState` in a recording
    repeat  start again at the end
    dialect  of the numbers of a CSV, decimal-comma or decimal-point, if the file leaves it open (1,234)

    The clock is that of the graph. `palpate replay` uses the time stamps of the recording.
    """

    paced = True
    sink = True

    path: Annotated[str, "1"]
    stream: Annotated[str, "1"] = "device"
    repeat: Annotated[bool, "1"] = False
    dialect: Annotated[str, "1"] = ""

    def start(self) -> None:
        self.motion = read_motion(self.path, self.dialect) if self.path.lower().endswith(".csv") else None
        self.clock = 0.0
        if self.motion is not None:
            return
        self.states = self._read()
        self.last = next(self.states, None)
        if self.last is None:
            raise SettingError(f"setting 'stream': {self.path} has no messages of a stream {self.stream!r}")
        self.first = True

    def _read(self) -> Iterator[DeviceState]:
        """The states of the recording. SettingError: the file is damaged, or the stream has another type.

        In the truncated file of a killed run the device stays at its last state.
        """
        # read chunk by chunk, because a recording of hours may exceed the memory
        channel = None
        try:
            for chunk in read_records(self.path):
                if not isinstance(chunk, bytes):
                    continue
                for each in read_declarations(chunk):
                    if isinstance(each, Channel) and each.topic == self.stream:
                        channel = each.id
                for which, _, _, payload in messages(chunk):
                    if which == channel:
                        yield unpack(payload, DeviceState)
        except Broken as broken:
            if not broken.cut:
                cure = "`palpate export --to mcap` saves the rest"
                raise SettingError(f"setting 'path': {self.path}: {broken}; {cure}") from None
        except MessageError as error:
            raise SettingError(f"setting 'stream': {self.path}, stream {self.stream!r}: {error}") from None

    def step(self, torque: Torque | None, force: Force | None, *, dt: float) -> DeviceState:
        if self.motion is not None:
            here, self.clock = self.motion.at(self.clock, self.repeat), self.clock + dt
            return here
        if not self.first:
            state = next(self.states, None)
            if state is None and self.repeat:
                self.states = self._read()
                state = next(self.states, None)
            self.last = state or self.last
        self.first = False
        assert self.last is not None
        return msgspec.structs.replace(self.last)
