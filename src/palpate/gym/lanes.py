"""The graph of an environment as lanes (engine/lanes.py), each with the settings of an episode and a goal to steer."""

from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import Any

import msgspec
import numpy as np

from palpate.engine.segment import record_of
from palpate.gym.hands import ROOM, Changes, Hand
from palpate.launch.run.lanes import LaneRun, Prepared, check_compiled, columns_of
from palpate.launch.run.notes import RunNote
from palpate.messages.record import reader
from palpate.nodes.device.steered import Steered
from palpate.physics.errors import RunError
from palpate.stepping import Stepper, convert_settings


class TaskLanes:
    """Lanes of the graph of an environment.

    stepper  of the environment, whose nodes do not run
    hands    its hands
    shape    of the parts of its observation
    count    number of lanes

    ArgumentError: a node of the graph is not compiled.
    """

    def __init__(self, stepper: Stepper, hands: Sequence[Hand], shape: tuple[int, ...], count: int) -> None:
        plan, job = stepper.plan, stepper.job
        check_compiled(plan)
        self.hands, self._job, self._shape = hands, job, shape
        keep = [(hand.pose, name) for hand in self.hands for name in ("position", "velocity")]
        for hand in self.hands:
            keep += [(hand.contact, name) for name in ("force", "normal", "lateral_force")]
            keep += [(hand.friction, "force")] if hand.friction is not None else []
        columns = columns_of(prepared := Prepared(plan.graph, job), keep, count, 1)
        self._runs = LaneRun(prepared, keep, columns, count=count)
        self.lanes = self._runs.lanes
        self._columns = dict(zip(keep, (column[:, 0] for column in columns), strict=True))
        self.slots = self._runs.segment.slots
        self._base = [self._runs.image(place, node) for place, node in enumerate(job.nodes)]
        self._devices = [place for place, slot in enumerate(self.slots) if isinstance(slot.node, Steered)]
        self._goals: list[list[np.ndarray]] = [[]] * count

    def settings_with(self, changes: Mapping[str, Mapping[str, Any]]) -> Changes:
        """The settings of all nodes with these changes. SettingError: unknown setting or invalid value."""
        found: Changes = {}
        for slot, job in zip(self.slots, self._job.nodes, strict=True):
            found[slot.name] = job.settings
            if slot.name in changes:
                found[slot.name] = job.settings | convert_settings(slot, changes[slot.name])
        return found

    def begin(self, lane: int, changes: Mapping[str, Mapping[str, Any]]) -> Changes:
        """Reset a lane to the start of an episode with these changes of settings, and run one tick; returns the
        settings of all nodes. SettingError: a change is invalid. RunError: a node failed."""
        there, images = self.settings_with(changes), list(self._base)
        for place, (slot, job) in enumerate(zip(self.slots, self._job.nodes, strict=True)):
            if slot.name in changes:
                images[place] = self._runs.image(place, msgspec.structs.replace(job, settings=there[slot.name]))
        self.lanes.place(lane, images)
        goals = []
        for place in self._devices:
            node, record = self.slots[place].node, self.lanes.own(lane, place)[0]
            begin, origin = (
                there[self.slots[place].name].get(name, getattr(node, name)) for name in ("begin", "origin")
            )
            record["low"], record["high"] = (np.subtract(np.add(begin, corner).tolist(), origin) for corner in ROOM)
            goals.append(record["velocity"])
        self._goals[lane] = goals
        self.lanes.run(lane, 1, 1)
        self.check([lane] if self.lanes.ticks[lane] != 1 else [])
        return there

    def steer(self, lane: int, speeds: Sequence[float] | np.ndarray) -> None:
        """Set the velocities [m/s] (3 per hand) of the goals of a lane."""
        for number, velocity in enumerate(self._goals[lane]):
            velocity[:] = speeds[3 * number : 3 * number + 3]

    def view(self, lane: int) -> Any:
        """The attributes of a worker that a `Tick` of a lane reads."""
        outputs = {}
        for slot in self.slots:
            for output in slot.outputs:
                memory = self.lanes.record(lane, record_of(output)).view(np.uint8).data
                outputs[output.stream] = _Last(reader(output.kind), memory)
        return SimpleNamespace(job=self._job, outputs=outputs, slots=[])

    def notes(self, lane: int, time: float) -> list[RunNote]:
        """The notes of the nodes of a lane."""
        return [RunNote(text, node, time, lane) for node, text in self.lanes.notes(lane)]

    def check(self, lanes: Sequence[int] | np.ndarray) -> None:
        """Raise RunError with the failure of the first of these lanes."""
        for lane in lanes:
            error = self.lanes.failure(int(lane))
            raise RunError(f"environment {lane}: {error}") from error

    def observe(self) -> dict[str, np.ndarray]:
        """Position, velocity and force f_n n - f_t + a of the fingers of all lanes (lanes, *shape)."""
        found: dict[str, list[np.ndarray]] = {"position": [], "velocity": [], "force": []}
        for hand in self.hands:
            found["position"].append(self._columns[hand.pose, "position"])
            found["velocity"].append(self._columns[hand.pose, "velocity"])
            f, n, a = (self._columns[hand.contact, name] for name in ("force", "normal", "lateral_force"))
            friction = 0.0 if hand.friction is None else self._columns[hand.friction, "force"]
            found["force"].append(f[:, None] * n - friction + a)
        return {
            name: np.stack(rows, axis=1).reshape(len(self.lanes.ticks), *self._shape) for name, rows in found.items()
        }

    def close(self) -> None:
        """Stop all nodes."""
        self._runs.close()


class _Last:
    """The last message of a stream in a lane."""

    __slots__ = ("_memory", "_read")

    def __init__(self, read: Any, memory: memoryview) -> None:
        self._read, self._memory = read, memory

    @property
    def last(self) -> Any:
        """The message; None before the first one."""
        return self._read(self._memory) if self._memory[0] else None
