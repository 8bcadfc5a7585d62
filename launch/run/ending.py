"""Shutdown of a run: orders to the workers, deadlines, and kills after them."""

from collections.abc import Callable, Collection, Mapping

from palpate.engine import clock
from palpate.launch.run.forkserver import ForkServer
from palpate.launch.run.member import WorkerHandle
from palpate.launch.run.reports import KILL, Close, Kill, Quit, Stop
from palpate.launch.run.wire.wires import ControlChannel
from palpate.launch.run.work.spawner import Spawner

STOP_PATIENCE = 10.0  # [s] for the workers to end after the order; a busy machine may delay them by seconds
LEFT = 1.0  # [s] from the death of a node during a shutdown, until workers that wait for its messages end
WAITS = 0.4  # [s] two intervals between heartbeats
STALL = 0.3  # [s] between two checks: a longer gap means that the machine stalled


class Ending:
    """The deadlines of a shutdown and its orders.

    real  whether the run is on the real clock: the run ends with its last paced worker
    note  takes a line for the user
    """

    def __init__(
        self,
        members: Mapping[str, WorkerHandle],
        wires: ControlChannel,
        forkserver: ForkServer | Spawner,
        real: bool,
        note: Callable[[str], None],
    ) -> None:
        self._members, self._control, self._forkserver, self._real, self._note = members, wires, forkserver, real, note
        self._quit_at: float | None = None
        self._deadline: float | None = None
        self._checked = 0.0
        self._quits = False  # whether an immediate shutdown was scheduled
        self.unreachable = False  # whether a worker on another machine hangs, for which the others may wait
        self.closed = False  # whether all nodes have ended and only observers are left

    @property
    def near(self) -> bool:
        """Whether a shutdown was ordered or scheduled."""
        return self._deadline is not None

    @property
    def over(self) -> bool:
        """Whether no worker should start any more."""
        return self.near or self.closed

    def stop(self) -> None:
        self._control.send_order("*", Stop())
        self._deadline = clock.seconds() + STOP_PATIENCE

    def quit_after(self, seconds: float) -> None:
        """Schedule an immediate shutdown in this time; after `stop` in at least `LEFT`, in which the others may end."""
        if not self._quits:
            self._quits = True
            seconds = max(seconds, LEFT) if self.near else seconds
            self._checked = clock.seconds()
            self._quit_at = self._checked + seconds
            self._deadline = self._deadline or self._quit_at + STOP_PATIENCE

    def follow(self) -> None:
        """A worker has ended: on the real clock stop all nodes if no paced one is left; without nodes close observers.

        The process of a worker whose nodes have ended continues until the observers have received its messages.
        """
        left = [m for m in self._members.values() if not (m.state == "gone" or (m.state == "done" and m.clean_exit))]
        stepping = [member for member in left if not member.observes]
        if self._real and not any(member.job.leads for member in stepping):
            self._control.send_order("*", Stop())
        if not any(member.job.nodes for member in stepping):
            lost = [
                group for group, member in self._members.items() if not member.clean_exit and member.state == "gone"
            ]
            self.closed = True
            self._control.send_order("*", Close(tuple(lost)))
            if any(member.state == "running" for member in left):  # observers, which may write for long
                self._deadline = None
            elif self._deadline is None or not left:
                self._deadline = clock.seconds() + STOP_PATIENCE

    def check(self, begun: bool) -> None:
        """Act on deadlines. `begun`: tick 0 has begun; before, workers that build nodes are killed 0.5 s after Quit."""
        moment = clock.seconds()
        if self._quit_at is not None and moment - self._checked > STALL:  # the workers could not run either
            self._quit_at += moment - self._checked
        self._checked = moment
        if self._quit_at is not None and moment >= self._quit_at:
            self._quit_at = None
            self._control.send_order("*", Quit())
            if not begun:
                self._deadline = moment + 0.5
        if self._deadline is not None:
            for member in self._members.values():  # counts the time since the last call
                member.silence()
            if self.unreachable and moment >= self._deadline + STOP_PATIENCE:
                self.kill()
            elif moment >= self._deadline:
                self._kill_silent(begun)

    def _kill_silent(self, begun: bool) -> None:
        """Kill workers that ignored the order and are silent, those that a signal has stopped after their last report,
        and workers that still build nodes before tick 0. If the nodes of all workers have ended, kill all: no observer
        is left to read their messages."""
        last = all(member.flushed or member.state == "gone" for member in self._members.values())
        left = {
            name: one for name, one in self._members.items() if not (one.flushed or one.state in ("killed", "gone"))
        }
        building = {group for group, member in left.items() if member.state == "starting" and not begun}
        silent = {group for group, member in left.items() if member.silent.total > STOP_PATIENCE} - building
        stopped = {
            group for group, one in self._members.items()
            if one.flushed and one.state not in ("killed", "gone") and one.silent.stopped > STOP_PATIENCE
        }  # fmt: skip
        if any(self.forsake(left[group]) for group in silent):
            return
        for group in silent:
            if left[group].alive:
                self._note(f"{left[group].names} did not end within {STOP_PATIENCE:g} s and was killed")
        self.kill(None if last else silent | stopped | building)
        if silent:
            self._control.send_order("*", Quit())  # otherwise the others wait for their messages
            self.unreachable = self.unreachable or any(left[group].joined for group in silent)

    def forsake(self, observer: WorkerHandle) -> bool:
        """If an observer waits in vain after the end of all nodes, have the observers end without the last messages of
        workers that have ended: one on another machine may have been killed before they arrived. Returns whether
        there are any."""
        if not self.closed or clock.seconds() - observer.waited > WAITS:
            return False
        absent = [m for m in self._members.values() if m.state == "gone" and m.clean_exit]
        for member in absent:
            member.clean_exit = False
        if absent:
            self._note(f"the last messages of {', '.join(member.names for member in absent)} may be missing")
            for member in self._members.values():
                member.reset_silence()
            self.follow()
        return bool(absent)

    def kill(self, only: Collection[str] | None = None) -> None:
        """Kill these workers, or all. One on another machine cannot be killed, and is awaited no longer."""
        for group, member in self._members.items():
            if member.state != "gone" and (only is None or group in only):
                self._forkserver.ask(Kill(group, KILL))
                member.state = "killed" if member.state not in ("done", "failed") else member.state
                member.clean_exit = False
                if member.pid is None:
                    member.state = "gone"
                    self.follow()
