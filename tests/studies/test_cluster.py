"""Studies on a Dask cluster with TLS: its processes run as they would on several machines."""

import contextlib
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest
from test_executors import stored
from typer.testing import CliRunner

import palpate
from palpate import ensemble as ensembles
from palpate.cli.__main__ import app
from palpate.launch.run.tasks import spread
from palpate.studies.sweeps.store import Store

distributed = pytest.importorskip("distributed")

BALL = """
nodes:
  ball: {use: nodes_for_studies.Ball}
wanted: [ball]
run: {duration: 5 ms}
"""
STUDY = """
graph: ball.yaml
over:
  ball.young: {linspace: [1e4, 2e4, 20]}
  ball.pause: [0 ms, 60 ms]
keep: [peak ball.force, curve ball.force]
"""


def certificates(folder):
    """The environment of Dask's processes: a new authority and a certificate that it signed."""
    made = distributed.Security.temporary()
    texts = {"ca": made.tls_ca_file, "cert": made.tls_client_cert, "key": made.tls_client_key}
    folder.mkdir()
    for name, text in texts.items():
        (folder / name).write_text(text)
    tls = "DASK_DISTRIBUTED__COMM__TLS__"
    found = {f"{tls}CA_FILE": str(folder / "ca")}
    for role in ("SCHEDULER", "WORKER", "CLIENT"):
        found |= {f"{tls}{role}__CERT": str(folder / "cert"), f"{tls}{role}__KEY": str(folder / "key")}
    return found


class Cluster:
    """A scheduler and workers, each a process."""

    def __init__(self, folder):
        self.folder, self.processes = folder, []
        self.tls = certificates(folder / "tls")
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self.address = f"tls://127.0.0.1:{self.port}"
        self.scheduler = self.start("scheduler", "--host", "127.0.0.1", "--port", str(self.port), "--protocol", "tls")

    def start(self, *words, **environment):
        path = os.pathsep.join(path for path in sys.path if path)
        env = {**os.environ, **self.tls, **environment, "PYTHONPATH": path, "DASK_LOGGING__DISTRIBUTED": "critical"}
        command = [sys.executable, "-m", "distributed.cli.dask_" + words[0], *words[1:], "--no-dashboard"]
        log = open(self.folder / f"{len(self.processes)}.log", "w")  # noqa: SIM115 - of the process
        self.processes.append(subprocess.Popen(command, env=env, stdout=log, stderr=log, stdin=subprocess.DEVNULL))
        return self.processes[-1]

    def worker(self, **environment):
        words = ("--protocol", "tls", "--no-nanny", "--nthreads", "1", "--local-directory", str(self.folder))
        return self.start("worker", self.address, *words, **environment)

    def close(self):
        for process in self.processes:
            process.kill()
            process.wait()


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    made = Cluster(tmp_path_factory.mktemp("cluster"))
    made.workers = [made.worker(), made.worker()]
    yield made
    made.close()


@pytest.fixture
def study(write, cluster):
    write("ball.yaml", BALL)
    return write("mine.yaml", STUDY)


def call(*words, **env):
    return CliRunner().invoke(app, ["study", *map(str, words)], env={"COLUMNS": "200", **env})


def while_it_runs(command, env, folder, points, act):
    """Start a study, and act when this number of points is stored; its exit code and output."""
    path = os.pathsep.join(path for path in sys.path if path)
    command = [sys.executable, "-m", "palpate.cli", "study", *map(str, command)]
    process = subprocess.Popen(command, env={**os.environ, **env, "PYTHONPATH": path}, text=True,
                               stdout=subprocess.PIPE, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL)  # fmt: skip
    log = folder / "log.jsonl"
    while process.poll() is None and not (log.exists() and log.read_text().count("\n") >= points):
        time.sleep(0.01)
    assert process.poll() is None, process.communicate()[0]
    act(process)
    return process.wait(), process.communicate()[0]


@pytest.mark.parametrize(
    ("address", "expected"),
    [
        ("tcp://10.0.0.7:8786", "without TLS everybody on the network can run code .*; expected tls://10.0.0.7:8786"),
        ("cluster.lab:8786", "without TLS everybody on the network can run code .*; expected tls://cluster.lab:8786"),
        ("tcp://0.0.0.0:8786", "without TLS everybody on the network"),
        ("http://127.0.0.1:8786", r"expected tls://HOST:PORT, such as tls://cluster\.lab:8786"),
        ("tls://127.0.0.1", "expected tls://HOST:PORT"),
        ("tls://127.0.0.1:9", "Dask's configuration has no certificates for TLS: distributed.comm.tls.ca-file"),
    ],
)
def test_an_address_that_cannot_be_trusted_is_refused_with_the_reason(write, tmp_path, address, expected):
    write("ball.yaml", BALL)
    done = call(write("mine.yaml", STUDY), "-o", tmp_path / "out", "--scheduler", address)
    assert done.exit_code in (1, 2) and re.search(expected, done.stderr), done.output
    assert not (tmp_path / "out").exists() and len(done.stderr.splitlines()) == 1


def test_a_missing_package_is_named_with_its_extra(monkeypatch, write, tmp_path):
    write("ball.yaml", BALL)
    monkeypatch.setitem(sys.modules, "distributed", None)
    done = call(write("mine.yaml", STUDY), "-o", tmp_path / "out", "--scheduler", "tls://127.0.0.1:9")
    assert 'distributed is not installed; pip install "palpate[cluster]"' in done.stderr and done.exit_code == 2


def test_a_lost_worker_costs_nothing_and_the_bytes_are_those_of_this_machine(study, cluster, tmp_path):
    """One of two workers is killed while it computes."""
    assert call(study, "-o", tmp_path / "here").exit_code == 0
    lost = cluster.workers.pop()
    words = (study, "-o", tmp_path / "there", "--scheduler", cluster.address)
    code, printed = while_it_runs(words, cluster.tls, tmp_path / "there", 8, lambda _: lost.kill())
    assert code == 0 and "40 points, 0 stored, 40 to compute" in printed, printed
    assert stored(tmp_path / "there") == stored(tmp_path / "here") and "Traceback" not in printed


@pytest.mark.filterwarnings("ignore:Port .* is already in use")
@pytest.mark.parametrize("kind", ["study", "ensemble"])
def test_a_cluster_without_workers_is_reported_once_and_waited_for(write, tmp_path, monkeypatch, kind):
    """It said nothing, as when all jobs of a batch system wait in its queue or have reached their time limit."""
    monkeypatch.setattr(spread, "SILENT", 0.3)
    given = {"n_workers": 0, "threads_per_worker": 1, "processes": False, "dashboard_address": None}
    with distributed.LocalCluster(**given) as there, distributed.Client(there, set_as_default=False) as client:
        lines = []

        def report(text):
            lines.append(text)
            if "waits for one" in text:
                there.loop.call_later(0.7, there.scale, 1)  # the message must not come a second time

        if kind == "study":
            study = palpate.Study(write("ball.yaml", BALL), {"ball.young": [1e4, 2e4]}, ["peak ball.force"])
            study.run(tmp_path / "out", client, report=report)
            assert not any(row["error"] for row in study.rows())
        else:
            monkeypatch.setattr(ensembles.warnings, "warn", lambda text, *more: report(str(text)))
            touches = palpate.Ensemble("kidney", 2, keep=["contact.force"], duration=0.01)
            assert not any(touches.run(quiet=True, executor=client)["error"].values)
    assert sum("the cluster has no workers now; this waits for one" in line for line in lines) == 1


@pytest.mark.long
@pytest.mark.parametrize("system", ["local", "slurm"])
def test_the_script_for_batch_systems_gives_the_bytes_of_this_machine(study, tmp_path, system):
    """Jobs are processes of this machine, or of a SLURM that runs here."""
    pytest.importorskip("dask_jobqueue")
    if system == "slurm" and (shutil.which("sinfo") is None or subprocess.run(["sinfo"], check=False).returncode):
        pytest.skip("no SLURM runs on this machine")
    assert call(study, "-o", tmp_path / "here").exit_code == 0
    script = Path(__file__).parents[2] / "docs/examples/cluster.py"
    path = os.pathsep.join(path for path in sys.path if path)
    command = [sys.executable, str(script), str(study), "-o", str(tmp_path / "there"), "--jobs", "2"]
    done = subprocess.run([*command, "--system", system], env={**os.environ, "PYTHONPATH": path}, capture_output=True,
                          text=True, timeout=200, cwd=tmp_path)  # fmt: skip
    assert done.returncode == 0 and "39  20000.00000" in done.stdout and "Traceback" not in done.stderr, done.stderr
    assert stored(tmp_path / "there") == stored(tmp_path / "here")


@pytest.mark.long
def test_a_stranger_with_a_certificate_of_another_authority_is_refused(study, cluster, tmp_path):
    env = certificates(tmp_path / "other")
    path = os.pathsep.join(path for path in sys.path if path)
    command = [sys.executable, "-m", "palpate.cli", "study", str(study), "--scheduler", cluster.address]
    done = subprocess.run(command, env={**os.environ, **env, "PYTHONPATH": path}, capture_output=True, text=True,
                          cwd=tmp_path)  # fmt: skip
    assert done.returncode == 1 and "TLS certificate does not match" in done.stderr and "Traceback" not in done.stderr


@pytest.mark.long
def test_a_worker_with_another_version_computes_nothing(study, tmp_path):
    """Here with another setting of the C library, which changes `exp` and `pow`."""
    other = Cluster(tmp_path / "cluster") if (tmp_path / "cluster").mkdir() is None else None
    try:
        other.worker(GLIBC_TUNABLES="glibc.malloc.tcache_count=1")
        path = os.pathsep.join(path for path in sys.path if path)
        command = [sys.executable, "-m", "palpate.cli", "study", str(study), "-o", str(tmp_path / "out")]
        done = subprocess.run([*command, "--scheduler", other.address], capture_output=True, text=True,
                              env={**os.environ, **other.tls, "PYTHONPATH": path})  # fmt: skip
    finally:
        other.close()
    text = "would not give the same bytes: GLIBC_TUNABLES glibc.malloc.tcache_count=1 there, none here"
    assert done.returncode == 1 and text in done.stderr and "Traceback" not in done.stderr, done.stderr
    assert not Store(tmp_path / "out", write=False).rows


@pytest.mark.long
@pytest.mark.parametrize("who", ["scheduler", "client"])
def test_a_killed_scheduler_or_client_loses_no_finished_point(study, tmp_path, who):
    """The study is continued on this machine, and computes what is missing."""
    assert call(study, "-o", tmp_path / "here").exit_code == 0
    (tmp_path / "cluster").mkdir()
    made, out = Cluster(tmp_path / "cluster"), tmp_path / "out"
    try:
        made.worker()
        words = (study, "-o", out, "--scheduler", made.address)
        code, printed = while_it_runs(
            words, made.tls, out, 8, lambda process: (made.scheduler if who == "scheduler" else process).kill()
        )
    finally:
        made.close()
    if who == "scheduler":
        assert code == 1 and "the executor lost a block" in printed and "Traceback" not in printed
    else:
        assert code == -signal.SIGKILL
    kept = len(Store(out, write=False).rows)
    assert 8 <= kept == (out / "log.jsonl").read_text().count("\n") < 40
    again = call(study, "-o", out)
    assert f"40 points, {kept} stored, {40 - kept} to compute" in again.stderr and again.exit_code == 0
    assert stored(out) == stored(tmp_path / "here")
    with contextlib.suppress(FileNotFoundError):
        assert not (out / "unwritten.jsonl").read_text()
