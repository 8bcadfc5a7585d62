"""The pose of a recorded finger, as the source of a graph whose contact is computed again (docs/backwards.md)."""

from typing import Annotated

import numpy as np

from palpate.compiler.records import floats, put, vector
from palpate.messages import Pose, Vector3
from palpate.nodes.base import ARRAY, TABLE, CompiledNode, Out, SettingError
from palpate.nodes.base.kernels import kernel
from palpate.nodes.device.motion import read_motion
from palpate.nodes.device.recorded import recorded


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

    State = {
        "times": ARRAY, "places": TABLE, "speeds": TABLE, "steps": ARRAY, "delays": ARRAY,
        "table": bool, "count": int, "clock": (), "last": (3,),
    }  # fmt: skip
    """Recorded times [s], positions [m], velocities [m/s], `dt` [s] and `delayed` [ns]; whether they are those of a
    table; number of steps and their time [s]; the last position [m]."""
    shared = ("times", "places", "speeds", "steps", "delays")

    def start(self) -> None:
        super().start()
        table = self.path.lower().endswith(".csv")
        times, places, speeds, steps, delays = self._of_table() if table else self._of_recording()
        for name, array in zip(self.shared, (times, places, speeds, steps, delays), strict=True):
            self.hold(name, np.ascontiguousarray(array, float))
        self.own["table"], self.own["last"] = table, places[0]

    def _of_table(self) -> tuple[np.ndarray, ...]:
        motion = read_motion(self.path)
        if motion.joints:
            raise SettingError(f"setting 'path': {self.path}: found joint angles, expected x, y, z [m]")
        nothing = np.zeros(len(motion.times))
        return motion.times - motion.times[0], motion.values, np.zeros((len(nothing), 3)), nothing, nothing.copy()

    def _of_recording(self) -> tuple[np.ndarray, ...]:
        """SettingError: the file is damaged, or has no such stream."""
        poses = list(recorded(self.path, self.stream, Pose))
        poses.sort(key=lambda pose: pose.tick)
        return (
            np.zeros(len(poses)), np.array([pose.position for pose in poses]),
            np.array([pose.velocity for pose in poses]), np.array([pose.dt for pose in poses]),
            np.array([float(pose.delayed or 0) for pose in poses]),
        )  # fmt: skip

    @kernel
    def compute(own, out: Out[Pose], dt):
        times, places, n = floats(own.times), floats(own.places), own.count
        last, offset = len(times) - 1, own.offset
        own.count += 1
        if not own.table:
            i, moves = min(n, last), n <= last
            x, y, z = vector(places[i])
            put(out.position, (x + offset[0], y + offset[1], z + offset[2]))
            put(out.velocity, vector(floats(own.speeds)[i]) if moves else (0.0, 0.0, 0.0))
            out.dt = floats(own.steps)[i] if moves else dt
            out.delayed = int(floats(own.delays)[i]) if moves else 0
            return
        if n > 0:
            own.clock += dt
        low, high = 0, last
        while high - low > 1:
            i = (low + high) // 2
            if times[i] <= own.clock:
                low = i
            else:
                high = i
        span = times[high] - times[low]
        share = min(max((own.clock - times[low]) / span, 0.0), 1.0) if span > 0.0 else 0.0
        x, y, z = vector(places[low])
        u, v, w = vector(places[high])
        x, y, z = x + share * (u - x), y + share * (v - y), z + share * (w - z)
        a, b, c = vector(own.last)
        put(out.velocity, ((x - a) / dt, (y - b) / dt, (z - c) / dt))
        put(own.last, (x, y, z))
        put(out.position, (x + offset[0], y + offset[1], z + offset[2]))
        out.dt = dt
