"""Builds a basis in a separate process, which computes with pinned arithmetic and one thread, as `palpate build basis`
does, also if the calling program is not pinned. The meshing library changes the working directory of its process, which
must not be that of the caller.

The process `python -m palpate.models.build.on_demand` reads the settings of a ReducedFE as JSON from standard input and
writes one JSON list per line to standard output: ["begin", name, note, total], ["done", fraction], ["error", text],
["built"]. What the libraries print is discarded.
"""

import json
import os
import subprocess
import sys
from typing import Any

from palpate.compiler.arithmetic import environment
from palpate.models.build.basis import Begin
from palpate.nodes.base import SettingError
from palpate.nodes.deformation.basis_store import cache
from palpate.nodes.deformation.reduced_fe import BUILT_FROM, NODULE, ReducedFE


def build(node: ReducedFE, begin: Begin) -> None:
    """Build a basis and store it in the cache. SettingError: it cannot be built."""
    process = subprocess.Popen(
        [sys.executable, "-P", "-m", "palpate.models.build.on_demand"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env={**environment(), "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)},
        start_new_session=True,  # Ctrl-C reaches the caller, which ends the build
        creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),
    )
    with process:
        try:
            _relay(process, node, begin)
        finally:
            process.kill()


def _relay(process: subprocess.Popen[bytes], node: ReducedFE, begin: Begin) -> None:
    """Send the settings, and report the progress until the basis is built."""
    assert process.stdin is not None and process.stdout is not None and process.stderr is not None
    process.stdin.write(json.dumps({name: getattr(node, name) for name in (*BUILT_FROM, *NODULE)}).encode())
    process.stdin.close()
    report = None
    for line in process.stdout:
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


def _main() -> None:
    """The build process."""
    from palpate.models.build import basis as builder
    from palpate.physics.errors import PalpateError

    with os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding="utf-8") as out, open(os.devnull, "wb") as nothing:
        os.dup2(nothing.fileno(), sys.stdout.fileno())

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
    _main()
