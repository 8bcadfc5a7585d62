"""The start barrier: workers report ready, connect, wait for their readers, and start together."""

from collections.abc import Mapping

from palpate.launch.run.member import WorkerHandle
from palpate.launch.run.reports import Connect, OutletAddress, Ready
from palpate.launch.run.wire.wires import ControlChannel, heard, listeners


class Barrier:
    """Brings workers from their first report to tick 0, or back into a run after a restart.

    members  the groups of the run
    wires    control channel to their workers
    """

    def __init__(self, members: Mapping[str, WorkerHandle], wires: ControlChannel) -> None:
        self._members, self._control = members, wires

    def ready(self, member: WorkerHandle, report: Ready) -> bool:
        """A worker has built its nodes and bound its outlets. False: its report arrived before its subscription to
        orders; it is stored until the subscription arrives (`early`)."""
        if not self._control.hears(member.job.group):
            member.early = report
            return False
        member.endpoints, member.secured = report.endpoints, report.secured
        member.busy, member.state = "", "ready"
        return True

    def early(self) -> list[tuple[WorkerHandle, Ready]]:
        """The workers whose subscription has now arrived, with the stored report."""
        waiting = []
        for group in self._control.new():
            member = self._members[group]
            if member.early is not None:
                report, member.early = member.early, None
                waiting.append((member, report))
        return waiting

    def all(self, state: str) -> bool:
        return all(member.state == state for member in self._members.values())

    def link(self, member: WorkerHandle) -> None:
        """Send a worker the outlets to connect to and the number of readers to wait for."""
        others = {group: other.job for group, other in self._members.items() if other is not member}
        sources = []
        for group, outlet, streams in heard(member.job, others):
            other = self._members[group]
            if other.endpoints:
                # The local address if both are on one machine, else the TCP address.
                address = other.endpoints[outlet][0 if member.joined == other.joined else -1]
                sources.append(OutletAddress(group, address, tuple(streams), outlet == "observers", other.secured))
        self._control.tell(member.job.group, Connect(tuple(sources), listeners(member.job, others)))
