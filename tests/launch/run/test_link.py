"""The connection to a process that computes: an inherited pipe, or TCP with a secret where no pipe can be inherited."""

import os
import re
import socket
import subprocess
import sys
import threading

import pytest

from palpate.launch.run.tasks import link

DOUBLES = """
import sys
from palpate.launch.run.tasks.link import join_link
with join_link(sys.argv[1]) as link:
    while (given := link.recv()) is not None:
        link.send([2 * each for each in given])
"""


def start(code=DOUBLES, **given):
    env = os.environ | {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    return link.open_link([sys.executable, "-c", code], env=env, **given)


@pytest.mark.parametrize("inherits", [True, False])
def test_a_process_answers_over_its_connection(inherits, monkeypatch):
    if not inherits:
        monkeypatch.delattr(os, "fork", raising=False)
    process, ours = start()
    with ours:
        for given in ([1, 2.5, "ü"], [b"x" * 1_000_000]):
            ours.send(given)
            assert ours.poll(30) and ours.recv() == [2 * each for each in given]
        ours.send(None)
        with pytest.raises(EOFError):
            ours.recv()
    assert process.wait(30) == 0


@pytest.mark.parametrize("inherits", [True, False])
def test_a_process_that_ends_at_its_start_ends_the_connection(inherits, monkeypatch):
    if not inherits:
        monkeypatch.delattr(os, "fork", raising=False)
    process, ours = start("raise SystemExit(3)")
    with ours, pytest.raises(EOFError):
        ours.recv()
    assert process.wait(30) == 3


def test_strangers_on_loopback_are_not_connected(monkeypatch):
    """Neither who sends another secret, nor who sends none, nor the process that is too late."""
    monkeypatch.delattr(os, "fork", raising=False)
    monkeypatch.setattr(link, "HEARD", 0.2)
    answers, threads, popen = [], [], subprocess.Popen

    def visit(port):
        for sent in (b"", b"\0" * link.SECRET, b"GET / HTTP/1.1\r\n" * 9):
            with socket.create_connection((link.LOOPBACK, port), timeout=10) as stranger:
                stranger.sendall(sent)
                try:
                    answers.append(stranger.recv(1))
                except ConnectionResetError:
                    answers.append(b"")

    def popen_with_strangers(command, **given):
        (port,) = re.findall(r"127\.0\.0\.1:(\d+)", command[-1])
        threads.append(threading.Thread(target=visit, args=(int(port),)))
        threads[0].start()
        return popen(command, **given)

    monkeypatch.setattr(subprocess, "Popen", popen_with_strangers)
    process, ours = start("import time; time.sleep(1.0)" + DOUBLES)
    with ours:
        ours.send([4])
        assert ours.poll(30) and ours.recv() == [8]
        ours.send(None)
    threads[0].join()
    assert answers == [b""] * 3 and process.wait(30) == 0


def test_a_process_that_never_connects_is_killed(monkeypatch):
    monkeypatch.delattr(os, "fork", raising=False)
    monkeypatch.setattr(link, "STARTS", 0.3)
    process, ours = start("import time; time.sleep(60)")
    with ours, pytest.raises(EOFError):
        ours.recv()
    assert process.wait(30) != 0


@pytest.mark.parametrize("sent", [b"", b"\0" * link.SECRET])
def test_a_process_takes_no_work_from_who_listens_in_place_of_its_parent(sent):
    """Its parent has ended, and another user listens at the port."""
    with socket.create_server((link.LOOPBACK, 0)) as server:
        process = subprocess.Popen(
            [sys.executable, "-c", DOUBLES, f"{link.LOOPBACK}:{server.getsockname()[1]}"],
            env=os.environ | {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)},
            stdin=subprocess.PIPE, stderr=subprocess.PIPE,
        )  # fmt: skip
        secrets = bytes(range(2 * link.SECRET))
        process.stdin.write(secrets)
        process.stdin.close()
        with server.accept()[0] as stranger:
            assert stranger.recv(99) == secrets[: link.SECRET]
            stranger.sendall(sent)
        assert process.wait(30) != 0 and b"another process answered" in process.stderr.read()
        process.stderr.close()
