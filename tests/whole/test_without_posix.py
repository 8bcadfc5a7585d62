"""palpate as a library needs no module or function that exists only on POSIX."""

import os
import subprocess
import sys
from pathlib import Path

from palpate.cli.machine import diagnostics

TESTS = Path(__file__).parents[1]


def test_one_process_on_simulated_time_runs_without_posix(tmp_path):
    command = [sys.executable, TESTS / "support" / "without_posix.py", TESTS / "golden" / "kidney.yaml"]
    done = subprocess.run(command, env=dict(os.environ), capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert float(done.stdout) > 0.05


def test_doctor_names_the_tested_system(monkeypatch):
    def found():
        return {one.what: one for one in diagnostics.examine(pictures=False, seconds=0.0)}

    assert found()["system"].state == "ok"
    monkeypatch.setattr(diagnostics.sys, "platform", "darwin")
    elsewhere = found()
    assert elsewhere["system"].state == "note" and "untested" in elsewhere["system"].found
    assert "SCHED_RR" not in elsewhere
