"""Foreign frames are dropped and counted; foreign peers are excluded where possible."""

import os
import random
import stat
import threading
import time
from pathlib import Path

import msgspec
import pytest
import zmq
from graphs_for_runs import GRAPH, write_graph
from test_start_barrier import free_port
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.launch.load.launchfile import LaunchFile
from palpate.launch.run.assign import jobs
from palpate.launch.run.execute import Network, execute
from palpate.launch.run.launcher import Launcher
from palpate.launch.run.reports import Addressed, NodesEnded, Note
from palpate.launch.run.result import Result
from palpate.launch.run.wire import addresses, keys
from palpate.launch.run.wire.wires import ControlChannel, ControlSockets


def run(folder: Path, during, foreign: int = 0) -> Result:
    """A run on the real clock. `during` is called once with the launcher, in a thread, when the run has begun. The run
    ends when `during` has ended and `foreign` frames were dropped, or after 1 min."""
    launch = LaunchFile(graph=write_graph(folder, f"rate: 200\n{GRAPH}".replace("logger.Mcap", "nodes_for_runs.Slow")))
    plan = launch.plan()
    threads: list[threading.Thread] = []

    def look(launcher: Launcher) -> None:
        if launcher.phase == "running" and not threads:
            threads.append(threading.Thread(target=during, args=(launcher,)))
            threads[0].start()
        if threads and not threads[0].is_alive() and launcher._control.foreign >= foreign:
            launcher.stop()

    work = jobs(plan, launch.placement(plan), clock="real", ticks=12_000)
    result = Launcher(work, show=look).run()
    threads[0].join()
    return result


def garbage(seed: int, count: int) -> list[bytes]:
    rng = random.Random(seed)
    known = msgspec.msgpack.encode(Addressed("source", Note("x")))
    frames = [rng.randbytes(rng.randint(0, 300)) for _ in range(count)]
    frames += [b"\x00", b"", known[:-1], known + b"x", msgspec.msgpack.encode(Addressed("nobody", NodesEnded(True)))]
    return frames


def test_frames_that_are_not_reports_are_dropped_and_counted(tmp_path):
    sent = garbage(1, 2_000)

    def send(launcher: Launcher) -> None:
        with zmq.Context() as context, context.socket(zmq.PUSH) as socket:
            socket.connect(addresses.endpoint(launcher.run_id, "reports"))
            for data in sent:
                socket.send(data)

    result = run(tmp_path, send, len(sent))
    assert result.ok, result.deaths
    assert any(f"{len(sent)} frames that do not belong to this run were dropped" in note for note in result.notes)


def test_invalid_subscriptions_and_orders_are_dropped(tmp_path):
    """Outlets for observers and the launcher's orders accept subscriptions from any peer that can reach them."""
    received: list[bytes] = []

    def send(launcher: Launcher) -> None:
        with zmq.Context() as context:
            for place in (("source", "observers"), ("control",)):
                with context.socket(zmq.XSUB) as socket:
                    socket.connect(addresses.endpoint(launcher.run_id, *place))
                    for data in [b"\x07" + os.urandom(20) for _ in range(50)]:
                        socket.send(data)
                    if place != ("control",):  # a later subscription is served, so they were read and dropped
                        socket.send(b"\1source\0")
                        assert socket.poll(60_000)
                        received.append(socket.recv())
                    else:
                        end = time.monotonic() + 60.0
                        while launcher._control.foreign < 50 and time.monotonic() < end:
                            time.sleep(0.01)

    result = run(tmp_path, send, 50)
    assert result.ok, result.deaths
    assert received[0].startswith(b"source\0")
    assert any("50 frames that do not belong to this run were dropped" in note for note in result.notes)


def test_invalid_reports_are_handled_in_limited_numbers():
    """Otherwise a flood would block the launcher: it handles a limited number per turn."""
    control = ControlChannel(ControlSockets(f"{os.getpid()}-flood", None, None), {})
    try:
        with zmq.Context() as context, context.socket(zmq.PUSH) as stranger:
            stranger.connect(control.sockets.reports)
            for _ in range(3):
                stranger.send(b"x")
            for count in (1, 2, 3):
                assert control.sockets.has_report(60_000) and control.report() is None
                assert control.foreign == count
            assert not control.sockets.has_report()
    finally:
        control.sockets.close(0)


def test_a_peer_with_too_long_a_subscription_is_disconnected():
    control = ControlChannel(ControlSockets(f"{os.getpid()}-large", None, None), {})
    try:
        with zmq.Context() as context, context.socket(zmq.XSUB) as stranger:
            monitor = stranger.get_monitor_socket(zmq.EVENT_DISCONNECTED)
            stranger.connect(control.sockets.control)
            stranger.send(b"\x07" + bytes(1000))
            stranger.send(b"\x07" + bytes(2000))
            assert monitor.poll(20_000), "it may send frames of any length"
            control.deliver()
            assert control.foreign == 1
            stranger.disable_monitor()
    finally:
        control.sockets.close(0)


def test_only_the_user_can_reach_the_sockets_which_are_removed_at_the_end(tmp_path):
    modes: dict[str, int] = {}

    def look(launcher: Launcher) -> None:
        for path in (addresses.folder(), *(addresses.folder() / launcher.run_id).parent.glob(launcher.run_id)):
            modes[str(path)] = stat.S_IMODE(path.stat().st_mode)
        text = Path("/proc/net/unix").read_text()
        assert "@palpate" not in text and launcher.run_id in text

    assert run(tmp_path, look).ok
    assert len(modes) == 2 and set(modes.values()) == {0o700}
    assert not any(Path(path).exists() for path in list(modes)[1:])


def test_a_folder_that_other_users_can_enter_is_an_error(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", f"/tmp/palpate-t{os.getpid()}")
    base = Path(os.environ["XDG_RUNTIME_DIR"])
    (base / "palpate").mkdir(parents=True, mode=0o777)
    (base / "palpate").chmod(0o777)
    try:
        with pytest.raises(PermissionError, match="nobody else can"):
            addresses.folder()
    finally:
        (base / "palpate").rmdir()
        base.rmdir()


def test_the_folder_of_a_killed_launcher_is_removed(tmp_path):
    left = addresses.folder() / "1-dead"
    left.mkdir(mode=0o700)
    (left / "lock").touch()
    assert "1-dead" not in dict(addresses.runs())
    assert run(tmp_path, lambda _: None).ok
    assert not left.exists()


def test_over_tcp_only_peers_with_the_key_receive_messages(tmp_path):
    key, received = keys.Key.make(), {}
    port = free_port()
    place = tmp_path / "place.yaml"
    place.write_text(f"a: {{nodes: [source, sum], host: '127.0.0.1:{port}'}}\n")
    launch = LaunchFile(graph=write_graph(tmp_path, f"rate: 100\n{GRAPH}"), place=place)
    plan = launch.plan()
    work = jobs(plan, launch.placement(plan), clock="real", ticks=300)  # 3 s

    def listen(launcher: Launcher) -> None:
        other = keys.Key.make()
        half = keys.Key(other.public, other.secret)
        with zmq.Context() as context:
            sockets = {}
            for name in ("with", "none", "other", "half"):
                sockets[name] = socket = context.socket(zmq.SUB)
                socket.set(zmq.LINGER, 0)
                if name == "with":
                    key.secure(socket, server=False)
                elif name == "other":
                    other.secure(socket, server=False)
                elif name == "half":  # has the public key, but another key pair
                    half.secure(socket, server=False)
                    socket.set(zmq.CURVE_SERVERKEY, key.public.encode())
                socket.subscribe(b"source\0")
                socket.connect(f"tcp://127.0.0.1:{port}")
            received["with"] = sockets.pop("with").poll(3000)
            received.update({name: socket.poll(100) for name, socket in sockets.items()})

    threads: list[threading.Thread] = []

    def look(launcher: Launcher) -> None:
        if launcher.phase == "running" and not threads:
            threads.append(threading.Thread(target=listen, args=(launcher,)))
            threads[0].start()

    assert Launcher(work, show=look, key=key).run().ok
    threads[0].join()
    assert received == {"with": 1, "none": 0, "other": 0, "half": 0}


def test_a_run_with_other_machines_requires_a_key_or_the_option(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    place = tmp_path / "far.yaml"
    place.write_text("far: {nodes: [spring, drag, spread], join: true}\n")
    launch = LaunchFile(graph=write_graph(tmp_path), place=place, duration=0.1)
    with pytest.raises(keys.RunError, match="palpate remote keys --make"):
        execute(launch, network=Network("tcp://127.0.0.1:5999"))


def say(*args: str):
    result = CliRunner().invoke(app, list(args), env={"COLUMNS": "200", "NO_COLOR": "1"})
    return result.exit_code, result.stdout + result.stderr


def test_keys_are_made_and_listed_and_belong_to_their_user(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    assert "no keys" in say("remote", "keys")[1]
    code, out = say("remote", "join", "tcp://127.0.0.1:9", "far")
    assert code == 1 and "there is no key 'rig'" in out and "--unencrypted" in out
    code, out = say("remote", "keys", "--make")
    path = tmp_path / "palpate" / "keys" / "rig.json"
    assert code == 0 and str(path) in out
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert len(keys.load().public) == 40
    assert say("remote", "keys", "--make")[0] == 1
    assert say("remote", "keys", "lab", "--make")[0] == 0 and "lab" in say("remote", "keys")[1]
    path.chmod(0o644)
    with pytest.raises(keys.RunError, match="others can read"):
        keys.load()
    path.chmod(0o600)
    path.write_text("{}")
    with pytest.raises(keys.RunError, match="damaged"):
        keys.load()


def test_a_stray_file_among_the_runs_is_ignored():
    stray = addresses.folder() / "stray"
    stray.write_text("x")
    try:
        folder = addresses.RunFolder("2-mine")
        assert "stray" not in dict(addresses.runs()) and "2-mine" in dict(addresses.runs())
        folder.close()
    finally:
        stray.unlink(missing_ok=True)
