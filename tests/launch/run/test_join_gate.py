"""The gate of `palpate remote join`: a launcher elsewhere runs nodes of palpate here, and no other code."""

import os
import sys
import threading

import msgspec
import pytest
import zmq
from test_start_barrier import free_port

from palpate.engine import imports
from palpate.engine.job import Job, NodeJob, ObserverJob, StreamJob
from palpate.launch.run import reports
from palpate.launch.run.result import NodeFault
from palpate.launch.run.tasks.task import sources
from palpate.launch.run.wire.bus import frame
from palpate.launch.run.work import process
from palpate.launch.run.work.far_clock import FarClock
from palpate.launch.run.work.offered import refusal
from palpate.physics.errors import RunError
from palpate.physics.readable import hash_of_file
from palpate.records.format.mcap_file import MAGIC

EVIL = """
open({!r}, "w").close()
from palpate.nodes.base import Node, Observer
class Innocent(Node):
    def step(self): ...
class Listener(Observer): ...
"""
SERIES = "palpate.nodes.contact.series.Series"
CONTACT = "palpate.messages.contact.Contact"


def of_node(cls: str, **settings: object) -> Job:
    return Job("far", (NodeJob("a", cls, settings, 1, (), ("a",)),))


def of_observer(cls: str, type_: str = CONTACT, **settings: object) -> Job:
    return Job("far", (), (ObserverJob("a", cls, settings, {"contact": StreamJob(type_, "contact")}),))


@pytest.fixture
def mark(tmp_path, monkeypatch):
    """A file that exists as soon as code of a peer has run; a module `peer` in the working directory makes it too."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [entry for entry in sys.path if entry])
    monkeypatch.delitem(sys.modules, "peer", raising=False)
    (tmp_path / "peer.py").write_text(EVIL.format(str(tmp_path / "ran")))
    yield tmp_path / "ran"
    sys.modules.pop("peer", None)
    imports.trust_only(())


def programs(mark):
    """Jobs that would run a program, or import a module of this machine that its user did not name."""
    touch = {"args": ["touch", str(mark)]}
    yield of_node("subprocess.Popen", **touch)
    yield of_observer("subprocess.Popen", **touch)
    yield of_node("os.system", command=f"touch {mark}")
    yield of_node("builtins.exec", source=f"open({str(mark)!r}, 'w')")
    yield of_node("palpate.registry.importlib.import_module", name="peer")
    yield of_node("palpate.engine.imports.search_here")
    yield of_node("palpate.nodes.transport.Delay[peer.Innocent]")
    yield of_node("palpate.nodes.transport.Delay[subprocess.Popen]", **touch)
    yield of_node("subprocess.Popen[palpate.messages.contact.Contact]", **touch)
    yield of_node(f"palpate.nodes.contact.series.Series[{CONTACT}]")
    yield of_node("peer.Innocent")
    yield of_node("palpate.launch.run.launcher.Launcher", jobs=[])
    yield of_node(CONTACT)
    yield of_node("peer")
    yield of_node("..peer.Innocent")
    yield of_node("")
    yield of_observer("peer.Listener")
    yield of_observer("palpate.nodes.logger.Mcap", "peer.Innocent", path="x.mcap")
    yield of_observer("palpate.nodes.logger.Mcap", "subprocess.Popen", path="x.mcap")
    yield of_observer("palpate.nodes.logger.Mcap", SERIES, path="x.mcap")
    yield of_observer(SERIES)


def test_no_job_of_a_peer_runs_or_imports_other_code(mark):
    jobs = list(programs(mark))
    assert len(jobs) == 21
    for job in jobs:
        fault = refusal(job, sources())
        assert fault is not None and fault.text.startswith("refused: "), job
        assert not mark.exists() and "peer" not in sys.modules, job
    assert str(mark.parent) not in sys.path


def test_a_trusted_package_is_accepted(mark):
    assert refusal(of_node(SERIES), sources()) is None
    assert "--trust peer" in refusal(of_node("peer.Innocent"), sources()).text
    imports.trust("peer")
    assert refusal(of_node("peer.Innocent"), sources()) is None and mark.exists()
    assert refusal(of_observer("peer.Listener"), sources()) is None
    assert "is not an Observer" in refusal(of_observer("peer.Innocent"), sources()).text


def test_other_data_or_sources_than_those_of_the_launcher_are_refused_by_name(tmp_path):
    """The body there was another organ than the one that the finger touches here."""
    organ = tmp_path / "organ.stl"
    organ.write_text("solid")
    files = {str(organ): hash_of_file(organ), str(tmp_path / "of another group.stl"): "0"}
    job = msgspec.structs.replace(of_node(SERIES, surface=str(organ)), about={"files": files})
    assert refusal(job, sources()) is None
    organ.write_text("solid of another person")
    assert f"{organ}: the file there differs from that of the launcher; copy it" in refusal(job, sources()).text
    organ.unlink()
    assert f"{organ}: the file there is missing; copy it" in refusal(job, sources()).text
    fault = refusal(of_node(SERIES), "0123")
    assert fault.node == "a" and "other sources" in fault.text and "0123" in fault.text


def test_the_logger_of_a_peer_replaces_recordings_only(mark):
    folder = mark.parent
    logger = "palpate.nodes.logger.Mcap"
    (folder / "old.mcap").write_bytes(MAGIC + b"rest")
    (folder / "notes.mcap").write_bytes(b"mine")
    (folder / "folder.mcap").mkdir()
    (folder / "keys").write_bytes(b"mine")
    (folder / "link.mcap").symlink_to(folder / "keys")
    os.mkfifo(folder / "pipe.mcap")
    allowed = [str(folder / name) for name in ("new.mcap", "old.mcap", "below/new.mcap")]
    refused = [str(folder / name) for name in ("keys", "notes.mcap", "folder.mcap", "link.mcap", "pipe.mcap", "x.sh")]
    for path in allowed:
        assert refusal(of_observer(logger, path=path), sources()) is None, path
    for path in (*refused, 3, None):
        assert "refused: path: " in refusal(of_observer(logger, path=path), sources()).text, path


def offering(port: int, job: Job, received: list[reports.Report]) -> None:
    """A launcher that offers a job to the group `far`, until it gets a report other than `Hello`."""
    with zmq.Context() as context, context.socket(zmq.XPUB) as orders, context.socket(zmq.PULL) as reported:
        for socket in (orders, reported):
            socket.set(zmq.LINGER, 0)
        orders.bind(f"tcp://127.0.0.1:{port}")
        reported.bind(f"tcp://127.0.0.1:{port + 1}")
        while reported.poll(60_000):
            report = reports.REPORTS.decode(reported.recv()).report
            if not isinstance(report, reports.Hello):
                received.append(report)
                return
            orders.send(frame("~join-far", b"0 " + msgspec.json.encode(reports.Take(job, "run", sources()))))


def test_join_refuses_the_job_of_a_peer_and_reports_it(mark):
    port, received = free_port(), []
    job = of_node("subprocess.Popen", args=["touch", str(mark)])
    peer = threading.Thread(target=offering, args=(port, job, received))
    peer.start()
    with pytest.raises(RunError, match=r"node 'a', palpate remote join: refused: subprocess\.Popen is not a Node"):
        process.join(f"tcp://127.0.0.1:{port}", "far", 60.0)
    peer.join()
    assert isinstance(received[0], NodeFault) and received[0].node == "a"
    assert not mark.exists()


def test_a_launcher_elsewhere_names_no_local_socket():
    """It could let the worker connect to the sockets of other runs of this user."""
    sources = (reports.OutletAddress("other", "ipc:///tmp/other", ("contact",), True, False),)

    class Told:
        def order(self, wait):
            return reports.Connect(sources, {})

    with pytest.raises(RunError, match="names ipc:///tmp/other, expected an address tcp://"):
        process._link(Told(), FarClock())
