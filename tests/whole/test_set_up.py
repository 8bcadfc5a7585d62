"""`setup.sh` and `check.sh`: errors before anything is installed."""

import shutil
import subprocess
from pathlib import Path

ROOT = Path(__file__).parents[2]


def run(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    shutil.copy(ROOT / words[0], folder)
    return subprocess.run([f"./{words[0]}", *words[1:]], cwd=folder, capture_output=True, text=True)


def test_check_names_the_missing_step(tmp_path):
    for words in (["check.sh"], ["check.sh", "--fast"], ["check.sh", "docs"]):
        done = run(tmp_path, *words)
        assert (done.returncode, done.stdout) == (2, "")
        assert done.stderr.strip().endswith("run ./setup.sh dev first") and done.stderr.count("\n") == 1


def test_set_up_refuses_an_unknown_word(tmp_path):
    done = run(tmp_path, "setup.sh", "devel")
    assert (done.returncode, done.stderr) == (2, "setup: found 'devel', expected nothing or 'dev'\n")
    assert not (tmp_path / ".venv").exists()


def test_ci_runs_the_test_command_of_the_readme():
    command = "./setup.sh dev && ./check.sh"
    assert command in (ROOT / "README.md").read_text().splitlines()
    assert (ROOT / ".ci" / "run").read_text().splitlines()[-1] == command
