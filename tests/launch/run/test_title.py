"""A worker is named after its nodes in `ps`."""

import os
import subprocess
import sys


def test_a_process_has_its_title_and_not_more():
    code = (
        "import os, subprocess as sub; from palpate.launch.run.descendants import set_title;"
        "set_title('palpate: tissue');"
        "print(sub.run(['ps', '-o', 'comm=,args=', '-p', str(os.getpid())], capture_output=True, text=True).stdout)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=os.environ, check=True)
    assert done.stdout.split() == ["palpate:", "tissue", "palpate:", "tissue"]


def test_a_title_that_has_no_room_leaves_the_command_line():
    code = (
        "from pathlib import Path; from palpate.launch.run.descendants import set_title;"
        "set_title('palpate: ' + 'x' * 9000); print(Path('/proc/self/cmdline').read_bytes()[-9:-1].decode());"
        "print(Path('/proc/self/comm').read_text())"
    )
    done = subprocess.run([sys.executable, "-c", code, "last-arg"], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["last-arg", "palpate:", "xxxxxx"]
