"""Reads a mesh file with meshio in a separate process, whose memory and time are limited by the length of the file.

The readers of meshio reserve memory for the sizes that a file states, fill tables up to the largest number of a node,
and open files that a file names, such as by INCLUDE of Abaqus. In the process, only regular files in the folder of the
mesh can be opened: `.xdmf` has its numbers in an .h5 file, Tetgen in two files. What meshio prints is discarded.

The process `python -m palpate.models.files.apart` reads the path as JSON from standard input and writes a line of
JSON to standard output, {"error": text} or {"kind", "names", "arrays": [[name, dtype, shape], ...]}, then the arrays.
"""

import contextlib
import io
import json
import math
import os
import signal
import subprocess
import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import IO, Any

import numpy as np

from palpate.compiler.arithmetic import environment
from palpate.models.files.hdf5 import check_hdf5
from palpate.physics.errors import MeshError
from palpate.physics.extras import missing
from palpate.physics.readable import check_file

LARGEST = 1 << 30  # [bytes] of a file
MEMORY, MEMORY_PER_BYTE = 512 << 20, 200
"""[bytes], [1] Memory for a file, and for each of its bytes: meshio takes up to 100 bytes for one of a text."""
SECONDS, SECONDS_PER_BYTE = 60, 2e-5
"""[s] Processor time for a file, and for each of its bytes."""
CODE = (".py", ".pyc", ".so", ".pyd", ".dylib")


def read_apart(path: str | Path) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """The result of `tetrahedra` for a file. MeshError: the file cannot be read, with the reason."""
    file = Path(path).absolute()
    try:
        check_file(file, LARGEST)
    except FileNotFoundError:
        raise MeshError(f"{path}: the file does not exist") from None
    except OSError as error:
        raise MeshError(f"{path}: {error.strerror}") from None
    if find_spec("meshio") is None:
        raise MeshError(missing(str(path), "meshio", "mesh"))
    process = subprocess.Popen(
        [sys.executable, "-P", "-m", "palpate.models.files.apart"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env={**environment(), "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)},
        start_new_session=True,  # Ctrl-C reaches the caller, which ends the reader
        creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),
    )
    with process:
        try:
            assert process.stdin is not None and process.stdout is not None
            process.stdin.write(json.dumps([str(path), str(file)]).encode())
            process.stdin.close()
            line = process.stdout.readline()
            about: dict[str, Any] = json.loads(line) if line.endswith(b"\n") else {"error": ""}
            if not line:  # the process has ended; keep its exit code
                process.wait()
            if "error" not in about:
                return {name: _array(process.stdout, *form) for name, *form in about.pop("arrays")}, about
        except (EOFError, BrokenPipeError):
            about = {"error": ""}
        finally:
            process.kill()
    raise MeshError(about["error"] or f"{path}: {_ending(process.returncode)}")


def _array(stream: IO[bytes], dtype: str, shape: list[int]) -> np.ndarray:
    """EOFError: the process ended before it had written the array."""
    content = stream.read(math.prod(shape) * np.dtype(dtype).itemsize)
    if len(content) < math.prod(shape) * np.dtype(dtype).itemsize:
        raise EOFError
    return np.frombuffer(content, dtype).reshape(shape)


def _ending(code: int) -> str:
    if code == -getattr(signal, "SIGXCPU", 0):
        return f"cannot be read as a mesh within {SECONDS} s and {1e6 * SECONDS_PER_BYTE:g} s per MB; {_ADVICE}"
    return f"cannot be read as a mesh: its reader ended early (exit code {code}); {_ADVICE}"


_ADVICE = "it is damaged, or claims more than it has. Write it again, as .msh or .vtu"


# -- in the process ----------------------------------------------------------------------------------------------------


class _Limits:
    """Memory and processor time of this process, and the files that it may open."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder.resolve()
        self.code = tuple(str(Path(p).resolve()) + os.sep for p in [*sys.path, sys.prefix, sys.base_prefix] if p)
        self.allowed: set[Path] = set()

    def begin(self) -> None:
        """Limit this process, as far as the system can."""
        try:
            import resource
        except ImportError:  # Windows
            return
        used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize() if os.path.exists(
            "/proc/self/statm") else 0  # fmt: skip
        self._raise(resource.RLIMIT_AS, used + MEMORY)
        self._raise(resource.RLIMIT_CPU, SECONDS)
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))

    def _raise(self, kind: int, value: int) -> None:
        import resource

        _, most = resource.getrlimit(kind)
        resource.setrlimit(kind, (value if most == resource.RLIM_INFINITY else min(value, most), most))

    def allow(self, name: Any) -> None:
        """Check a file before it is opened, and grant memory and time for it. ValueError: it may not be opened."""
        file = Path(os.fsdecode(name)).resolve()
        if file in self.allowed:
            return
        if file.parent != self.folder and self.folder not in file.parents:
            raise ValueError(f"it names {os.fsdecode(name)}, which is outside of its folder and is not opened; "
                             "copy it there, or write the mesh as one file")  # fmt: skip
        size = check_file(file, LARGEST)
        try:
            import resource
        except ImportError:
            return
        for kind, more in (
            (resource.RLIMIT_AS, MEMORY_PER_BYTE * size),
            (resource.RLIMIT_CPU, SECONDS_PER_BYTE * size),
        ):
            self._raise(kind, resource.getrlimit(kind)[0] + int(more))
        self.allowed.add(file)

    def audit(self, event: str, given: tuple[Any, ...]) -> None:
        """The hook that Python calls before a file is opened."""
        if event != "open" or isinstance(given[0], int):
            return
        name = os.fsdecode(given[0])
        if name.endswith(CODE) and str(Path(name).resolve()).startswith(self.code):
            return
        if name != "/proc/self/statm":
            self.allow(name)


def _read(path: str, file: str) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """MeshError: with the reason."""
    try:
        import meshio
    except ImportError as error:
        raise MeshError(missing(path, error.name, "mesh")) from None
    from palpate.models.files.tetrahedra import tetrahedra

    limits, printed = _Limits(Path(file).parent), io.StringIO()
    _check_libraries(limits)
    limits.begin()
    sys.addaudithook(limits.audit)
    try:
        limits.allow(file)
        with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(io.StringIO()):
            mesh = meshio.read(file)
        return tetrahedra(path, mesh)
    except MeshError:
        raise
    except MemoryError:
        raise MeshError(f"{path}: it takes more than {MEMORY >> 20} MB and {MEMORY_PER_BYTE} times its size; {_ADVICE}"
                        ) from None  # fmt: skip
    except (Exception, SystemExit) as error:  # meshio calls sys.exit for some damaged files
        said = printed.getvalue() if isinstance(error, SystemExit) else str(error)
        text = next((line.strip() for line in said.splitlines() if line.strip()), type(error).__name__)
        text = f"the number {text} is missing" if isinstance(error, KeyError) else text
        raise MeshError(f"{path}: cannot be read as a mesh: {text}") from None


class _Numbers(np.ndarray):
    """A table by the number of a node, which none below 0 may address from its end."""

    def __getitem__(self, key: Any) -> Any:
        if isinstance(key, np.ndarray) and key.dtype.kind == "i" and key.size and key.min() < 0:
            raise ValueError("an element refers to a node before the first; nodes are numbered from 1")
        return super().__getitem__(key).view(np.ndarray)


class _GmshNumpy:
    """numpy for meshio's readers of Gmsh, whose tables by the number of a node are made by `ones` and `full`."""

    def __getattr__(self, name: str) -> Any:
        found = getattr(np, name)
        return (lambda *a, **how: found(*a, **how).view(_Numbers)) if name in ("ones", "full") else found


def _check_libraries(limits: _Limits) -> None:
    """Make meshio's readers refuse negative numbers of nodes. HDF5 opens files without Python's knowledge: check each
    before."""
    for name in ("_gmsh22", "_gmsh40", "_gmsh41"):
        import_module(f"meshio.gmsh.{name}").np = _GmshNumpy()  # type: ignore[attr-defined]
    try:
        import h5py
    except ImportError:
        return
    original = h5py.File

    def checked(name: Any, *more: Any, **how: Any) -> Any:
        limits.allow(name)
        h5py.File = original
        try:
            check_hdf5(Path(name))
        finally:
            h5py.File = checked
        return original(name, *more, **how)

    h5py.File = checked


def _main() -> None:
    with os.fdopen(os.dup(sys.stdout.fileno()), "wb") as out, open(os.devnull, "wb") as nothing:
        os.dup2(nothing.fileno(), sys.stdout.fileno())
        try:
            arrays, about = _read(*json.load(sys.stdin))
        except MeshError as error:
            out.write(json.dumps({"error": str(error)}).encode() + b"\n")
            return
        forms = [[name, array.dtype.str, array.shape] for name, array in arrays.items()]
        out.write(json.dumps({**about, "arrays": forms}).encode() + b"\n")
        for array in arrays.values():
            out.write(np.ascontiguousarray(array).tobytes())


if __name__ == "__main__":
    _main()
