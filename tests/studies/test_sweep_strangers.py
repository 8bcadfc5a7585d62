"""Other users of this machine, and strangers on the network, can send nothing to a study."""

import asyncio
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import cloudpickle
import distributed
import pytest
from strangers import answer, listening
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.studies.sweeps import cluster

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
    file = write("mine.yaml", f"graph: ball.yaml\nover: {{ball.flag: {flags}}}\nset: {{ball.pause: 60}}\n"
                              "keep: [peak ball.force]\n")  # fmt: skip
    study = started(["palpate.cli", "study", str(file), "-o", str(tmp_path / "out"), "--workers", "2"])
    try:
        while not all(Path(flag).exists() and Path(flag).read_text() for flag in flags):
            time.sleep(0.05)
            assert study.poll() is None
        assert [one for one in listening(study.pid) if answer(one)] == []
    finally:
        study.send_signal(signal.SIGINT)
        assert study.wait(60) == 130


def test_a_plain_scheduler_of_dask_answers():
    """So that the test above sees what it looks for."""
    plain = started(["dask", "scheduler", "--host", "127.0.0.1", "--port", "0", "--dashboard-address", "127.0.0.1:0"])
    try:
        while len(found := listening(plain.pid)) < 2:
            time.sleep(0.05)
            assert plain.poll() is None
        assert all(map(answer, found))
    finally:
        plain.kill()
        plain.wait()


async def uid(address: str, security: distributed.Security | None) -> object:
    """What a worker or scheduler says when it is sent a function to run."""
    arguments = {} if security is None else security.get_connection_args("client")
    async with distributed.rpc(address, timeout=5, connection_args=arguments) as server:
        sent = {"function": os.getuid, "args": (), "kwargs": {}}
        return await asyncio.wait_for(server.run(**{k: cloudpickle.dumps(v) for k, v in sent.items()}), 5)


@pytest.mark.long
@pytest.mark.timeout(120)
def test_jobs_of_slurm_run_nothing_without_the_key_of_the_study(tmp_path, monkeypatch):
    """Neither without TLS nor with a certificate that somebody else has made; HTTP serves nothing."""
    submit = f'cd {tmp_path}; cp "$1" job.sh; setsid bash job.sh >job.log 2>&1 & echo "Submitted batch job $!"'
    for name, text in (("sbatch", submit), ("scancel", 'kill -- -"$1"')):
        program = tmp_path / "bin" / name
        program.parent.mkdir(exist_ok=True)
        program.write_text(f"#!/bin/bash\n{text}\n")
        program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}:{os.environ['PATH']}")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(path for path in sys.path if path))
    with cluster.submitted({"cores": 1, "memory": "1 GB"}, tmp_path / "out") as client:
        client.wait_for_workers(1, timeout=60)
        (worker,) = client.scheduler_info()["workers"]
        for address in (client.scheduler.addr, worker):
            _, _, there = address.partition("://")
            for stranger, where in ((None, f"tcp://{there}"), (distributed.Security.temporary(), f"tls://{there}")):
                with pytest.raises((OSError, TimeoutError)):
                    print(asyncio.run(uid(where, stranger)))
        (key,) = (tmp_path / "out").glob(".keys-*/key.pem")
        cert = str(key.with_name("certificate.pem"))
        holder = distributed.Security(tls_ca_file=cert, tls_client_cert=cert, tls_client_key=str(key))
        assert asyncio.run(uid(worker, holder))["result"] == os.getuid(), "the holder of the key is let in"


def test_an_unencrypted_scheduler_is_a_warning(write):
    write("ball.yaml", BALL)
    file = write("mine.yaml", "graph: ball.yaml\nover: {ball.young: [1e4, 2e4]}\nkeep: [peak ball.force]\n")
    with distributed.LocalCluster(n_workers=1, threads_per_worker=1, processes=False, protocol="tcp://",
                                  dashboard_address="127.0.0.1:0", silence_logs=50) as plain:  # fmt: skip
        arguments = ["study", str(file), "-o", str(file.parent / "out"), "--scheduler", plain.scheduler_address]
        for more in ([], ["--json"]):
            ran = CliRunner().invoke(app, arguments + more, env={"COLUMNS": "500"})
            assert ran.exit_code == 0, ran.output
            assert f"{plain.scheduler_address} is not encrypted" in ran.stderr and "--tls-cert" in ran.stderr


def test_an_encrypted_scheduler_is_none():
    security = distributed.Security.temporary()
    with distributed.LocalCluster(n_workers=0, security=security, dashboard_address="127.0.0.1:0",
                                  silence_logs=50) as closed, distributed.Client(closed) as client:  # fmt: skip
        assert client.scheduler.addr.startswith("tls://") and cluster.exposed(client) == ""
