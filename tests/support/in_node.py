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
HASHES = """
import fs from "fs"; import crypto from "crypto"; import { Tick } from "./tick.mjs";
const about = JSON.parse(fs.readFileSync("about.json")), parts = new Map(about.parts.map(({ hash }) => [hash, new Uint8Array(fs.readFileSync(hash))]));
const tick = new Tick(about, new WebAssembly.Module(fs.readFileSync("tick.wasm")), parts), sums = new Map(), ticks = Number(process.argv[2]);
const take = () => {
  for (const { stream, bytes } of tick.messages()) {
    if (!sums.has(stream)) sums.set(stream, crypto.createHash("sha256"));
    sums.get(stream).update(bytes);
  }
  tick.clear();
};
tick.listen(() => 1);
for (let k = 0; k < ticks && !tick.failed; k += 100) { tick.step(Math.min(100, ticks - k), take); take(); }
const digests = Object.fromEntries([...sums].map(([name, sum]) => [name, sum.digest("hex").slice(0, 16)]));
console.log(JSON.stringify({ failed: tick.failed, heap: tick.code.heap_top() - about.size, digests }));
"""


@functools.cache
def node():
    """The program; skips the test where there is none."""
    spec = find_spec("playwright")
    wheel = Path(spec.origin).parent / "driver" / "node" if spec and spec.origin else None
    found = str(wheel) if wheel and wheel.exists() else shutil.which("node")
    if found is None:
        pytest.skip("no Node: pip install playwright, whose wheel has one")
    return found


def run_script(folder, text, *given):
    """What a script prints, as JSON. It runs in a folder."""
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
    about = program.describe(run)
    (folder / "about.json").write_text(json.dumps(about), encoding="utf-8")
    (folder / "tick.wasm").write_bytes(program.code.code)
    for name, data in program.parts.items():
        (folder / name).write_bytes(data)
    (folder / "tick.mjs").write_text((STATIC / "tick.js").read_text(encoding="utf-8"), encoding="utf-8")
    return run_script(folder, HASHES, ticks)
