"""How a run ends: when the workers are told to quit, until when they may take, and who is killed after that."""

import signal
import time
from collections.abc import Callable, Collection, Mapping

from palpate.launch.run.forkserver import ForkServer
from palpate.launch.run.member import WorkerHandle
from palpate.launch.run.reports import Close, Kill, Quit, Stop
from palpate.launch.run.wire.wires import ControlChannel

STOP_PATIENCE = 10.0  # [s] for the workers to end once they were told; a busy machine may keep them waiting for seconds
STALL = 0.3  # [s] between two looks: the machine stood still


class Ending:
    """The times of an end, and the orders that belong to them.

    real  whether the run is on the real clock: nodes go on as long as one that leads them does
    note  takes a line for the user
    """

    def __init__(
        self,
        members: Mapping[str, WorkerHandle],
        wires: ControlChannel,
        forkserver: ForkServer,
        real: bool,
        note: Callable[[str], None],
    ) -> None:
        self._members, self._control, self._forkserver, self._real, self._note = members, wires, forkserver, real, note
        self._quit_at: float | None = None
        self._deadline: float | None = None
        self._looked = 0.0
        self.closed = False  # whether all nodes have ended: only observers are left

    @property
    def near(self) -> bool:
        """Whether the workers have been told to end, or will be."""
        return self._deadline is not None

    @property
    def over(self) -> bool:
        """Whether nobody should begin any more."""
        return self.near or self.closed

    def stop(self) -> None:
        """Tell all workers to end in order."""
        self._control.tell("*", Stop())
        self._deadline = time.monotonic() + STOP_PATIENCE

    def quit_after(self, seconds: float) -> None:
        """Tell all workers to end at once, so many seconds from now."""
        if self._deadline is None:
            self._looked = time.monotonic()
            self._quit_at = self._looked + seconds
            self._deadline = self._quit_at + STOP_PATIENCE

    def follow(self) -> None:
        """A worker has ended. When the paced ones are gone the rest has nothing to follow; when all nodes have ended,
        the observers.

        A worker whose nodes have ended stays until the observers have what it holds for them.
        """
        left = [m for m in self._members.values() if not (m.state == "gone" or (m.state == "done" and m.clean_exit))]
        if self._real and not any(member.job.leads for member in left):
            self._control.tell("*", Stop())
        if not any(member.job.nodes for member in left):
            lost = [
                group for group, member in self._members.items() if not member.clean_exit and member.state == "gone"
            ]
            self.closed = True
            self._control.tell("*", Close(tuple(lost)))
            self._deadline = None if left else time.monotonic() + STOP_PATIENCE

    def check(self, begun: bool) -> None:
        """Look at the time. `begun`: tick 0 was; else workers that still build something are not waited for."""
        moment = time.monotonic()
        if self._quit_at is not None and moment - self._looked > STALL:  # nobody could heed what was told before
            self._quit_at += moment - self._looked
        self._looked = moment
        if self._quit_at is not None and moment >= self._quit_at:
            self._quit_at = None
            self._control.tell("*", Quit())
            if not begun:
                self._deadline = moment + 0.5
        if self._deadline is not None and moment >= self._deadline:
            self._kill_silent(begun)

    def _kill_silent(self, begun: bool) -> None:
        """Those that do not end although they were told, and who give no sign that they are about to, or still build
        what will not be needed. Nobody is left to hear those whose nodes have ended."""
        last = all(member.flushed or member.state == "gone" for member in self._members.values())
        left = {group: it for group, it in self._members.items() if not (it.flushed or it.state in ("killed", "gone"))}
        building = {group for group, it in left.items() if it.state == "starting" and not begun}
        silent = {group for group, it in left.items() if it.silence() > STOP_PATIENCE} - building
        for group in silent:
            if left[group].alive:
                self._note(f"{left[group].names} did not end within {STOP_PATIENCE:g} s and was killed")
        self.kill(None if last else silent | building)
        if silent:
            self._control.tell("*", Quit())  # the others would wait for their messages

    def kill(self, only: Collection[str] | None = None) -> None:
        """Kill these workers, or all."""
        for group, member in self._members.items():
            if member.state != "gone" and (only is None or group in only):
                self._forkserver.ask(Kill(group, int(signal.SIGKILL)))
                member.state = "killed" if member.state not in ("done", "failed") else member.state
                if member.pid is None:
                    member.state = "gone"
