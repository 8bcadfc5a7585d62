"""A worker has the names of its nodes in `ps`."""

import subprocess
import sys


def test_a_process_has_its_title():
    code = (
        "from pathlib import Path; from palpate.launch.run.descendants import set_title;"
        "set_title('palpate: tissue'); print(Path('/proc/self/comm').read_text())"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "palpate: tissue"
