"""The command line when a run fails: one clear line, the right exit code, a readable recording, no remaining
processes."""

import os
import resource
import signal
import subprocess
import time
from pathlib import Path

import nodes_that_misbehave
import pytest
from shell_text import unwrapped
from typer.testing import CliRunner
from warm_fork_server import palpate, started_in

from palpate.cli.__main__ import app
from palpate.launch.run.forkserver import ForkServer
from palpate.launch.run.reports import Prepare
from palpate.launch.run.work.watchdog import START_PATIENCE
from palpate.records.player import plan_of
from palpate.records.reader import Recording
from palpate.records.verify import verify

GRAPH = """
nodes:
  src: {use: nodes_that_misbehave.Source, in: {torque: end}}
  bad: {use: nodes_that_misbehave.Bad, in: {pose: src}}
  end: {use: nodes_that_misbehave.End, in: {force: bad}}
  log: {use: logger.Mcap, in: all}
"""
SHEET = GRAPH.replace("  end:", "  sheet: {use: nodes_that_misbehave.ToSheet, in: {pose: src}}\n  end:").replace(
    "{use: nodes_that_misbehave.Bad, in: {pose: src}}", "{use: nodes_that_misbehave.FromSheet, in: {sheet: sheet}}"
)
WAYS = {
    "fused": ["--fused"], "processes": [], "real": ["--clock", "real", "--place", "apart"],
    "real fused": ["--clock", "real", "--fused"],
}  # fmt: skip


def _long(*given: str):
    return pytest.param(*given, marks=pytest.mark.long)


class Run:
    """One `palpate run` as a process, marked so that remaining processes can be found."""

    def __init__(self, folder: Path, *options: str, text: str = GRAPH, before=None, quiet=True) -> None:
        self.record = folder / "run.mcap"
        (folder / "g.yaml").write_text(text)
        self.folder, self.mark = folder, f"{folder}-{time.monotonic_ns()}"
        path = os.pathsep.join([str(Path(__file__).parents[2] / "support"), os.environ.get("PYTHONPATH", "")])
        arguments = ["run", "g.yaml", "--no-pictures", *["-q"] * quiet, *options]
        if "--record" not in options:
            arguments += ["--record", str(self.record)]
        self.out, self.err = folder / "out", folder / "err"
        env = {**os.environ, "PYTHONPATH": path, "PALPATE_TEST": self.mark, "COLUMNS": "200"}
        with open(self.out, "w") as out, open(self.err, "w") as err:
            self.process = palpate(arguments, cwd=folder, stdout=out, stderr=err, env=env, preexec_fn=before)

    def wait(self, seconds: float = 120.0) -> int:
        try:
            return self.process.wait(seconds)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
            raise

    def ticks(self) -> int:
        return sum(stream == "src" for stream, _, _ in Recording(self.record).payloads())

    def running(self) -> bool:
        """Wait until the recording has data."""
        for _ in range(2400):
            if self.record.is_file() and self.record.stat().st_size > 12_000:
                return self.process.pid in started_in(self.folder, self.mark)
            time.sleep(0.05)
        return False

    def left(self) -> list[int]:
        """Remaining processes of this run, after at most 1 min for the kernel to end them."""
        for _ in range(1200):
            if not (processes := started_in(self.folder, self.mark)):
                break
            time.sleep(0.05)
        return processes


SAYS = {
    "raise": "RuntimeError: out of luck",
    "exit": "SystemExit: 0",
    "interrupt": "KeyboardInterrupt",
    "nan": "Force.force [N]: found nan at index 1, expected a finite number",
    "huge": "Force.force [N]: found 1e+300 at index 1, expected at most 10000",
    "shape": "Force.force: found 2 numbers, expected 3 [N]",
    "text": "Force.force: found 'abc', expected (3,) numbers [N]",
    "whole number as state": "Force.state: found 3, expected str [1]",
    "surrogate": "UnicodeEncodeError",
    "spin": "no sign of life for",
    "stop raise": "RuntimeError: out of luck",
    "stop exit": "SystemExit: 0",
    "stop hang": "no sign of life for",
    "start raise": "RuntimeError: out of luck",
    "start exit": "SystemExit: 0",
}
IN_ONE_PROCESS = ("exit", "interrupt", "spin", "stop hang", "start exit", "surrogate")
IN_PROCESSES = ("exit", "end", "crash", "whole number as state", "surrogate", "stop exit", "stop hang", "start exit")
ON_THE_CLOCK = ("whole number as state", "spin", "interrupt")
FIRST = {
    ("fused", "exit"),
    ("fused", "spin"),
    ("processes", "crash"),
    ("processes", "surrogate"),
    ("processes", "stop exit"),
    ("real", "interrupt"),
    ("real fused", "spin"),
    ("processes", "huge"),
}
CASES = [
    pytest.param(way, how, marks=() if (way, how) in FIRST else pytest.mark.long)
    for way, hows in (
        ("fused", IN_ONE_PROCESS),
        ("processes", (*IN_PROCESSES, "huge")),
        ("real", ON_THE_CLOCK),
        ("real fused", ("spin", "huge")),
    )
    for how in hows
]


@pytest.mark.parametrize(("way", "how"), CASES)
def test_a_failing_node_gives_one_clear_line_and_a_readable_recording(tmp_path, way, how):
    timeout = "1" if "hang" in how or how == "spin" else "5"  # after a crash the process ends slowly on a busy machine
    run = Run(tmp_path, "--duration", "0.3", "--timeout", timeout, "--set", f"bad.how={how}", *WAYS[way])
    # a test of the stop runs at the start, which may take long
    assert run.wait(START_PATIENCE + 120.0 if how == "stop hang" else 120.0) == 1
    output_text = run.err.read_text()
    line = next(line for line in output_text.splitlines() if line.startswith("node 'bad'"))
    assert SAYS.get(how, "its process ended") in line
    assert "node 'end'" not in output_text and "node 'src'" not in output_text
    # A test of the stop also runs at the start; a killed process has not written its last second.
    if not how.startswith(("start", "stop")) and way != "real fused":
        assert run.ticks() >= 49
    assert not run.left()


@pytest.mark.parametrize("how", ["none", "fork", *map(_long, ["print", "no line end", "numpy", "program"])])
def test_an_unusual_node_completes_and_leaves_no_processes(tmp_path, how):
    run = Run(tmp_path, "--duration", "0.1", "--set", f"bad.how={how}")
    assert run.wait() == 0, run.err.read_text()
    assert run.ticks() == 100
    assert not run.left()


def test_a_node_with_a_long_stop_is_not_killed(tmp_path):
    """Like the write of a long recording to a slow disk, which no signal interrupts."""
    run = Run(tmp_path, "--duration", "0.1", "--timeout", "0.2", "--set", "bad.how=stop long", *WAYS["fused"])
    assert run.wait() == 0, run.err.read_text()


def test_a_slow_node_does_not_count_as_hung(tmp_path):
    run = Run(tmp_path, "--duration", "0.024", "--timeout", "1.6", "--set", "bad.how=slow")
    assert run.wait() == 0, run.err.read_text()
    assert run.ticks() == 24


@pytest.mark.parametrize("way", ["fused", "processes"])
def test_a_custom_message_is_sent_with_its_arrays(tmp_path, way):
    run = Run(tmp_path, "--duration", "0.05", *WAYS[way], text=SHEET)
    assert run.wait() == 0, run.err.read_text()
    assert nodes_that_misbehave.Sheet  # already imported by this program, so the recording may use it
    recording = Recording(run.record)
    sheets, forces = list(recording.messages("sheet")), list(recording.messages("bad"))
    assert sheets[-1].cells.shape == (3, 4) and sheets[-1].count == 7
    assert forces[-1].force == tuple(sheets[-1].cells[1, :3]) and forces[-1].energy == 7.0


@pytest.mark.parametrize(
    ("way", "name", "code"),
    [("fused", "SIGINT", 130), ("processes", "SIGINT", 130), ("real", "SIGTERM", 143), _long("fused", "SIGTERM", 143)],
)
def test_a_signal_ends_a_run_gracefully_with_its_exit_code(tmp_path, way, name, code):
    run = Run(tmp_path, *WAYS[way])
    assert run.running()
    run.process.send_signal(signal.Signals[name])
    assert run.wait() == code, run.out.read_text() + run.err.read_text()
    assert "interrupted after" in run.out.read_text()
    assert Recording(run.record).complete
    assert not run.left()


@pytest.mark.parametrize("way", ["processes", _long("fused"), _long("real")])
def test_killing_the_launcher_leaves_no_processes_and_a_readable_recording(tmp_path, way):
    run = Run(tmp_path, *WAYS[way], *([] if way == "fused" else ["--set", "bad.how=program"]))
    assert run.running()
    for _ in range(1200):
        if run.ticks() > 50:
            break
        time.sleep(0.05)
    run.process.kill()
    run.wait()
    assert not run.left()
    assert run.ticks() > 50


MANY = GRAPH.replace(
    "  log:",
    "".join(f"  n{i}: {{use: nodes_that_misbehave.Bad, how: start doze, in: {{pose: src}}}}\n" for i in range(12))
    + "  log:",
)


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (["--fused", "--set", "bad.how=start hang"], GRAPH),
        (["--fused", "--set", "bad.how=start deaf"], GRAPH),
        (["--fused", "--clock", "real"], MANY),
        _long(["--set", "bad.how=start hang"], GRAPH),
    ],
    ids=["hangs", "catches it", "takes long", "hangs in a process"],
)
def test_ctrl_c_ends_a_start_with_a_message(tmp_path, options, text):
    run = Run(tmp_path, *options, text=text, quiet=False)
    until = time.monotonic() + 60.0
    while "start " not in run.out.read_text() and time.monotonic() < until:
        time.sleep(0.05)
    run.process.send_signal(signal.SIGINT)
    assert run.wait() == 130
    output_text = run.out.read_text()
    assert output_text.index("stopping; Ctrl-C again ends the run at once") < output_text.index(
        "interrupted after 0.000 s"
    )
    assert not run.left()


@pytest.mark.parametrize("way", ["fused", "processes"])
def test_a_failed_start_stops_the_nodes_that_have_started(tmp_path, way):
    first = "  first: {use: nodes_that_misbehave.Bad, how: stop tell, in: {pose: src}}\n  bad:"
    run = Run(tmp_path, "--set", "bad.how=start raise", *WAYS[way], text=GRAPH.replace("  bad:", first), quiet=False)
    assert run.wait() == 1
    assert "stopped in order" in run.out.read_text()


def test_a_fork_server_is_ended_at_once_during_its_imports(tmp_path, monkeypatch):
    """A kill after 10 s would leave the processes that it had started."""
    (tmp_path / "slow_to_import.py").write_text("print('importing', flush=True)\nimport time\ntime.sleep(1000)\n")
    monkeypatch.syspath_prepend(tmp_path)
    server = ForkServer()
    server.ask(Prepare(["slow_to_import"]))
    until, output_text = time.monotonic() + 60.0, ""
    while "importing" not in output_text and time.monotonic() < until:
        time.sleep(0.05)
        output_text += server.read_printout()
    assert "importing" in output_text
    server.close()
    assert server.process.returncode == 0


@pytest.mark.parametrize("way", ["fused", "processes"])
def test_a_full_disk_ends_the_recording_and_the_run_continues_and_fails(tmp_path, way):
    def little_space() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, 50_000))

    # Small chunks, so that the backlog after a stall of the machine does not fill most of the space.
    text = GRAPH.replace("logger.Mcap,", "logger.Mcap, within: 0.02,")
    run = Run(tmp_path, "--duration", "2", "--pace", "2", *WAYS[way], before=little_space, text=text)
    code = run.wait()
    output_text = run.err.read_text() + run.out.read_text()
    assert code == 1, output_text
    assert "2000 ticks" in output_text, output_text
    assert 100 < run.ticks() < 2000
    reported = " ".join(output_text.split())
    assert reported.count("ends here: the disk is full") == 1 and "can be read" in reported
    recording = Recording(run.record)
    assert not recording.complete and verify(recording, plan_of(recording)).ok


WRONG = {
    "--duration 0": "expected a time from 1e-9",
    "--duration inf": "expected a number, or a number with its unit",
    "--duration nan": "expected a number, or a number with its unit",
    "--duration 2mm": "a length; expected a time",
    "--pace 0": "Input should be",
    "--pace 1e-300": "Input should be",
    "--set rate=0": "expected a number above 0",
    "--set bad.every=0": "expected a whole number from 1",
    "--set bad.hwo=x": "Did you mean 'how'",
    "--set nope.how=x": "expected a node",
    "--scene nope": "not found",
    "--fused --place two": "use one of them",
    "--clock moon": "expected simulated or real",
    "--record /proc/palpate/run.mcap": "recording /proc/palpate/run.mcap: No such file or directory",
    "--record .": "recording .: this is a folder",
    "--record g.yaml/run.mcap": "choose another file with --record",
}


@pytest.mark.parametrize("options", WRONG)
def test_a_wrong_option_is_an_error_without_a_traceback(tmp_path, monkeypatch, options):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "g.yaml").write_text(GRAPH)
    given = ["--duration", "0.1"] * ("duration" not in options) + ["--fused"] * ("place" not in options)
    ran = CliRunner().invoke(app, ["run", "g.yaml", "-q", *given, *options.split()], env={"COLUMNS": "200"})
    assert ran.exit_code == 2 and isinstance(ran.exception, SystemExit)
    assert "raceback" not in ran.output and "Error: " not in ran.output
    assert WRONG[options] in unwrapped(ran.output), ran.output
