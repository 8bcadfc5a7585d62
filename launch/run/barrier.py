"""The start barrier: a worker is ready, hears whom to read, waits until it has its readers, and then all of them go."""

from collections.abc import Mapping

from palpate.launch.run.member import WorkerHandle
from palpate.launch.run.reports import Connect, OutletAddress, Ready
from palpate.launch.run.wire.wires import ControlChannel, heard, listeners


class Barrier:
    """What the launcher tells workers between their first report and tick 0, or their return to a run.

    members  the groups of the run
    wires    to their workers
    """

    def __init__(self, members: Mapping[str, WorkerHandle], wires: ControlChannel) -> None:
        self._members, self._control = members, wires

    def ready(self, member: WorkerHandle, report: Ready) -> bool:
        """A worker has built its nodes and bound its outlets. False: its report has overtaken its subscription to
        orders, and is kept until that has come (`early`)."""
        if not self._control.hears(member.job.group):
            member.early = report
            return False
        member.endpoints, member.secured = report.endpoints, report.secured
        member.busy, member.state = "", "ready"
        return True

    def early(self) -> list[tuple[WorkerHandle, Ready]]:
        """The workers whose subscription has come now, with the report that had overtaken it."""
        waiting = []
        for group in self._control.new():
            member = self._members[group]
            if member.early is not None:
                report, member.early = member.early, None
                waiting.append((member, report))
        return waiting

    def all(self, state: str) -> bool:
        """Whether all workers have come to this state."""
        return all(member.state == state for member in self._members.values())

    def link(self, member: WorkerHandle) -> None:
        """Tell a worker whom to read, and for how many readers to wait."""
        others = {group: other.job for group, other in self._members.items() if other is not member}
        sources = []
        for group, outlet, streams in heard(member.job, others):
            other = self._members[group]
            if other.endpoints:
                # The local address where both are on one machine, else the one that the network reaches.
                address = other.endpoints[outlet][0 if member.joined == other.joined else -1]
                sources.append(OutletAddress(group, address, tuple(streams), outlet == "observers", other.secured))
        self._control.tell(member.job.group, Connect(tuple(sources), listeners(member.job, others)))
