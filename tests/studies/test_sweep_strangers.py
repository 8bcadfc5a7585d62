"""Other users of this computer and other hosts on the network cannot send anything to a study."""

import os
import signal
import subprocess
import sys
from pathlib import Path

from strangers import answer, listening

BALL = """
nodes:
  ball: {use: nodes_for_studies.Ball}
wanted: [ball]
run: {duration: 5 ms}
"""


def started(command: list[str]) -> subprocess.Popen:
    env = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    return subprocess.Popen([sys.executable, "-m", *command], env=env, stdin=subprocess.DEVNULL,
                            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)  # fmt: skip


def test_no_socket_of_a_study_answers_a_stranger(write, tmp_path):
    """While its workers compute."""
    write("ball.yaml", BALL)
    flags = [str(tmp_path / f"flag{number}") for number in (1, 2)]
    for flag in flags:
        os.mkfifo(flag)
    file = write("mine.yaml", f"graph: ball.yaml\nover: {{ball.flag: {flags}}}\nset: {{ball.pause: 60}}\n"
                              "keep: [peak ball.force]\n")  # fmt: skip
    study = started(["palpate.cli", "study", str(file), "-o", str(tmp_path / "out"), "--workers", "2"])
    try:
        assert all(Path(flag).read_text() for flag in flags)  # waits until both workers compute
        assert [one for one in listening(study.pid) if answer(one)] == []
    finally:
        study.send_signal(signal.SIGINT)
        assert study.wait(60) == 130
