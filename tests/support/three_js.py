"""three.js from npm, and a server of static files, for the example pages that use it."""

import functools
import http.server
import shutil
import subprocess
import threading
from contextlib import contextmanager

import pytest

THREE = "three@0.170.0"


def unpack_three(folder):
    """Put three.module.min.js into a folder; skips the test without npm and its registry."""
    npm = shutil.which("npm")
    if npm is None or subprocess.run([npm, "pack", "--silent", THREE], cwd=folder, capture_output=True).returncode:
        pytest.skip(f"no {THREE}: npm and its registry are needed")
    (archive,) = folder.glob("three-*.tgz")
    member = "package/build/three.module.min.js"
    subprocess.run(["tar", "xzf", archive.name, "--strip-components=2", member], cwd=folder, check=True)


@contextmanager
def served(folder):
    """The address of a folder."""

    class Quiet(http.server.SimpleHTTPRequestHandler):
        def log_message(self, *_):
            pass

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=folder)) as serving:
        threading.Thread(target=serving.serve_forever, daemon=True).start()
        yield f"http://localhost:{serving.server_port}"
        serving.shutdown()
