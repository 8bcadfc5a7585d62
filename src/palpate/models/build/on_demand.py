"""Builds a basis in a separate process, which computes with pinned arithmetic and one thread, as `palpate build basis`
does, also if the calling program is not pinned. The meshing library changes the working directory of its process, which
must not be that of the caller.

The process `python -m palpate.models.build.on_demand FD` reads the settings of a ReducedFE as JSON from standard input
and writes one JSON list per line to FD: ["begin", name, note, total], ["done", fraction], ["error", text], ["built"].
"""

import json
import os
import subprocess
import sys
from collections.abc import Iterable
from typing import Any

from palpate.compiler.arithmetic import environment
from palpate.models.build.basis import Begin
from palpate.nodes.base import SettingError
from palpate.nodes.deformation.basis_store import cache
from palpate.nodes.deformation.reduced_fe import BUILT_FROM, NODULE, ReducedFE


def build(node: ReducedFE, begin: Begin) -> None:
    """Build a basis and store it in the cache. SettingError: it cannot be built."""
    if sys.platform == "win32":
        raise SettingError("found Windows, expected Linux or macOS: a missing basis is built in a process")
    reading, writing = os.pipe()
    path = os.pathsep.join(p for p in sys.path if p)
    try:
        process = subprocess.Popen(
            [sys.executable, "-P", "-m", "palpate.models.build.on_demand", str(writing)],
            stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, pass_fds=[writing],
            env={**environment(), "PYTHONPATH": path},
            start_new_session=True,  # Ctrl-C reaches the caller, which ends the build
        )  # fmt: skip
    finally:
        os.close(writing)
    with process, open(reading, encoding="utf-8") as lines:
        try:
            _relay(process, node, lines, begin)
        finally:
            process.kill()


def _relay(process: subprocess.Popen[bytes], node: ReducedFE, lines: Iterable[str], begin: Begin) -> None:
    """Send the settings, and report the progress until the basis is built."""
    assert process.stdin is not None and process.stderr is not None
    process.stdin.write(json.dumps({name: getattr(node, name) for name in (*BUILT_FROM, *NODULE)}).encode())
    process.stdin.close()
    report = None
    for line in lines:
        what, *values = json.loads(line)
        if what == "begin":
            report = begin(*values)
        elif what == "done" and report is not None:
            report(*values)
        elif what == "error":
            raise SettingError(*values)
        elif what == "built":
            return
    last = process.stderr.read().decode(errors="replace").strip().splitlines()[-1:]
    raise SettingError(
        f"surface {node.surface!r}: the build of its basis ended early: {''.join(last) or 'it was killed'}"
        f". To see more: {node.command()}"
    )


def _main(descriptor: int) -> None:
    """The build process."""
    from palpate.models.build import basis as builder
    from palpate.physics.errors import PalpateError

    with open(descriptor, "w", encoding="utf-8") as out:

        def send(*values: Any) -> None:
            out.write(json.dumps(values) + "\n")
            out.flush()

        def begin(name: str, note: str, total: float | None = 1.0) -> Any:
            send("begin", name, note, total)
            return lambda done: send("done", done)

        given = json.load(sys.stdin)
        node = ReducedFE(**{name: tuple(v) if isinstance(v, list) else v for name, v in given.items()})
        try:
            builder.make(node, builder.home(node, cache()), begin)
        except PalpateError as error:
            send("error", str(error))
        else:
            send("built")


if __name__ == "__main__":
    _main(int(sys.argv[1]))
