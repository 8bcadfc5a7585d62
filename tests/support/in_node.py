"""Runs ticks of WebAssembly in Node, of the wheel of playwright or of the system."""

import functools
import json
import shutil
import subprocess
from importlib.util import find_spec
from pathlib import Path

import pytest

STATIC = Path(__file__).parents[2] / "src" / "palpate" / "web" / "static"
PATIENCE = 300.0  # [s]


@functools.cache
def node():
    """The program; skips the test where it is missing."""
    spec = find_spec("playwright")
    wheel = Path(spec.origin).parent / "driver" / "node" if spec and spec.origin else None
    found = str(wheel) if wheel and wheel.exists() else shutil.which("node")
    if found is None:
        pytest.skip("no Node: pip install playwright, whose wheel has one")
    return found


def run_script(folder, script, *given):
    """What a script prints, as JSON: the name of a file next to this one, or a text. It runs in a folder."""
    file = Path(__file__).with_name(script) if script.endswith(".mjs") else None
    text = file.read_text(encoding="utf-8") if file else script
    (Path(folder) / "script.mjs").write_text(text, encoding="utf-8")
    done = subprocess.run(
        [node(), "script.mjs", *map(str, given)], cwd=folder, capture_output=True, text=True, timeout=PATIENCE
    )
    assert done.returncode == 0, done.stderr[-3000:]
    return json.loads(done.stdout)


def digests(folder, run, ticks):
    """Digests of the streams of a started run, from ticks in Node, and what is known of them."""
    from palpate.web.program import compile_program

    folder = Path(folder)
    program = compile_program([run.segment])
    program.save(folder, program.describe(run))
    (folder / "tick.mjs").write_text((STATIC / "tick.js").read_text(encoding="utf-8"), encoding="utf-8")
    return run_script(folder, "hash_ticks.mjs", ticks)
