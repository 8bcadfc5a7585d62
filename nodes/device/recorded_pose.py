"""The pose of a recorded finger, as the source of a graph whose contact is computed again (docs/backwards.md)."""

from typing import Annotated

import numpy as np
from mcap.records import Channel

from palpate.compiler.records import floats, put
from palpate.messages import MessageError, Pose, Vector3, unpack
from palpate.nodes.base import TABLE, CompiledNode, Out, SettingError
from palpate.nodes.base.kernels import kernel
from palpate.nodes.device.motion import read_motion
from palpate.records.format.mcap_file import Broken, messages, read_declarations, read_records

TIME, PLACE, VELOCITY, STEP, DELAYED = 0, 1, 4, 7, 8
"""Columns of a row: time [s], position [m] (3), velocity [m/s] (3), `dt` [s], `delayed` [ns] of a pose."""


class RecordedPose(CompiledNode):
    """The poses of a recording, one per tick, or of a table of a motion; then the last one, at rest.

    path    of the recording, or of a CSV with the columns `t` [s] and `x`, `y`, `z` [m] of the bone edge, world frame;
            linear interpolation between its rows. Other units are named in the header: `t [ms]`, `x [mm]`
    stream  name of the stream of `Pose` in a recording
    offset  added to all positions, such as the unknown zero of an indentation

    Unlike device.Replayed it is compiled, so that it runs in lanes.
    """

    paced = True

    path: Annotated[str, "1"]
    stream: Annotated[str, "1"] = "finger"
    offset: Annotated[Vector3, "m"] = (0.0, 0.0, 0.0)

    State = {"rows": TABLE, "table": bool, "count": int, "clock": (), "last": (3,)}
    """Recorded rows; whether they are those of a table; number of steps and their time [s]; the last position [m]."""
    shared = ("rows",)

    def start(self) -> None:
        super().start()
        table = self.path.lower().endswith(".csv")
        rows = self._of_table() if table else self._of_recording()
        self.hold("rows", rows)
        self.own["table"], self.own["last"] = table, rows[0, PLACE:VELOCITY]

    def _of_table(self) -> np.ndarray:
        motion = read_motion(self.path)
        if motion.joints:
            raise SettingError(f"setting 'path': {self.path}: found joint angles, expected x, y, z [m]")
        rows = np.zeros((len(motion.times), DELAYED + 1))
        rows[:, TIME], rows[:, PLACE:VELOCITY] = motion.times - motion.times[0], motion.values
        return rows

    def _of_recording(self) -> np.ndarray:
        """SettingError: the file is damaged, or has no such stream."""
        channel, rows = None, []
        try:
            for chunk in read_records(self.path):
                if not isinstance(chunk, bytes):
                    continue
                for each in read_declarations(chunk):
                    if isinstance(each, Channel) and each.topic == self.stream:
                        channel = each.id
                for which, _, _, payload in messages(chunk):
                    if which == channel:
                        pose = unpack(payload, Pose)
                        rows.append(
                            (pose.tick, (0.0, *pose.position, *pose.velocity, pose.dt, float(pose.delayed or 0)))
                        )
        except (Broken, MessageError, OSError) as error:
            raise SettingError(f"setting 'path': {self.path}, stream {self.stream!r}: {error}") from None
        if not rows:
            raise SettingError(f"setting 'stream': {self.path} has no messages of a stream {self.stream!r}")
        return np.array([row for _, row in sorted(rows)], dtype=float)

    @kernel
    def compute(own, out: Out[Pose], dt):
        rows, n = floats(own.rows), own.count
        last = len(rows) - 1
        own.count += 1
        if not own.table:
            i = min(n, last)
            row, moves = rows[i], n <= last
            put(out.position, (row[1] + own.offset[0], row[2] + own.offset[1], row[3] + own.offset[2]))
            put(out.velocity, (row[4], row[5], row[6]) if moves else (0.0, 0.0, 0.0))
            out.dt, out.delayed = row[7] if moves else dt, int(row[8]) if moves else 0
            return
        if n > 0:
            own.clock += dt
        i = 0
        low, high = 0, last
        while high - low > 1:
            i = (low + high) // 2
            if rows[i, 0] <= own.clock:
                low = i
            else:
                high = i
        span = rows[high, 0] - rows[low, 0]
        share = min(max((own.clock - rows[low, 0]) / span, 0.0), 1.0) if span > 0.0 else 0.0
        here = (
            rows[low, 1] + share * (rows[high, 1] - rows[low, 1]),
            rows[low, 2] + share * (rows[high, 2] - rows[low, 2]),
            rows[low, 3] + share * (rows[high, 3] - rows[low, 3]),
        )
        before = own.last
        put(out.velocity, ((here[0] - before[0]) / dt, (here[1] - before[1]) / dt, (here[2] - before[2]) / dt))
        put(own.last, here)
        put(out.position, (here[0] + own.offset[0], here[1] + own.offset[1], here[2] + own.offset[2]))
        out.dt = dt
