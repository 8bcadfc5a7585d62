"""The same bits on every machine: which instructions numbers are computed with.

Kernels are compiled for x86-64-v3 (AVX2 and FMA; every server since 2015) in any process (`kernel`), and the shipped
nodes compute the force with kernels. numpy and OpenBLAS choose their inner loops by the processor, and so the order of
their sums, when they are loaded. Processes of palpate - the command line, workers, the processes of a study - are
pinned to the same instructions with `pin` or `environment`. In a process that imports palpate nothing is pinned: there,
a custom node that uses them may differ in its last bits, and so may a basis that is built. `in_force` says what a
process uses.

`PALPATE_NATIVE=1` in the environment leaves the choice to the processor: as fast as it can be, other last bits.
"""

import ctypes
import functools
import hashlib
import os
import platform
import re
import sys
from importlib.util import find_spec
from pathlib import Path

LEVEL = "x86-64-v3"
CORE = "Haswell"  # What OpenBLAS calls its kernels for these instructions

_FLAGS = {"avx", "avx2", "bmi1", "bmi2", "f16c", "fma", "abm", "movbe", "xsave"}
"""Of x86-64-v3, as the Linux kernel names them."""
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
_KERNELS = {"NUMBA_CPU_NAME": LEVEL, "NUMBA_CPU_FEATURES": "", "NUMBA_DISABLE_INTEL_SVML": "1"}
"""For functions of `numba.njit` in nodes of users."""


def environment() -> dict[str, str]:
    """The environment of a process that palpate starts: pinned, and one thread for linear algebra.

    The fronts of a sparse factor and the bodies of a touch are small, and more threads wait for one another (10 x
    slower was seen on a busy machine).
    """
    return {**os.environ, **dict.fromkeys(_THREADS, "1"), **_pinned()}


def pin() -> None:
    """Pin this process, a program of palpate, before numpy is imported. It uses one thread for linear algebra unless
    the environment says how many."""
    os.environ.update({**dict.fromkeys(_THREADS, "1"), **os.environ, **_pinned()})


def _pinned() -> dict[str, str]:
    if not pinnable():
        return {}
    return {"OPENBLAS_CORETYPE": CORE, "NPY_DISABLE_CPU_FEATURES": _newer(), **_KERNELS}


@functools.cache
def pinnable() -> bool:
    """Whether this machine has the instructions of x86-64-v3, and the user wants no others."""
    if os.environ.get("PALPATE_NATIVE") or platform.machine() != "x86_64":
        return False
    try:
        with open("/proc/cpuinfo", encoding="utf-8", errors="replace") as file:
            flags = next((line.partition(":")[2].split() for line in file if line.startswith("flags")), [])
    except OSError:
        return False
    return set(flags) >= _FLAGS


def in_force(*, here: bool = True) -> dict[str, str]:
    """What decides on the last bits of a result: instructions, versions of what computes, C library (its `exp`, `pow`).

    Where two processes agree in all of it, they give the same bytes; the force of shipped nodes is the same where they
    differ in numpy and OpenBLAS only. `here=False`: of a process that palpate starts, which is pinned where it can be.
    """
    import numpy
    import scipy

    built = [package.show_config(mode="dicts")["Build Dependencies"]["blas"] for package in (numpy, scipy)]
    blas = [f"{build['name']} {build['version']}" for build in built]
    return {
        "architecture": platform.machine(),
        "instructions": LEVEL if pinnable() and not here else _instructions(numpy),
        **{name: _version(name) for name in ("numpy", "scipy", "numba", "llvmlite")},
        "BLAS of numpy": blas[0],
        "BLAS of scipy": blas[1],
        "libc": " ".join(platform.libc_ver()),
        **{name: os.environ[name] for name in ("GLIBC_TUNABLES",) if name in os.environ},
    }


def _newer() -> str:
    """What numpy calls the instructions beyond x86-64-v3: other names before 2.4. It must not be imported for this."""
    spec = find_spec("numpy")
    text = Path(spec.origin).with_name("version.py").read_text(encoding="utf-8") if spec and spec.origin else ""
    version = re.search(r'^version = "(\d+)\.(\d+)', text, re.MULTILINE)
    if version is None or tuple(map(int, version.groups())) >= (2, 4):
        return "X86_V4 AVX512_ICL AVX512_SPR"
    return "AVX512F AVX512CD AVX512_SKX AVX512_CLX AVX512_CNL AVX512_ICL AVX512_SPR"


def _instructions(numpy) -> str:
    """`LEVEL` where everything that is loaded keeps to it, else what each of them uses."""
    features = numpy.show_config(mode="dicts")["SIMD Extensions"].get("found", [])
    cores = sorted({core for core, _ in _openblas()})
    threads = max((threads for _, threads in _openblas()), default=1)
    kernels = _kernels()
    newer = set(_newer().split()) & set(features)
    if pinnable() and not newer and set(cores) <= {CORE} and kernels == LEVEL and threads == 1:
        return LEVEL
    parts = {"numpy": features, "OpenBLAS": cores, "kernels": [kernels], "threads": [str(threads)]}
    return ", ".join(f"{name} {' '.join(names)}" for name, names in parts.items() if names)


def _openblas() -> list[tuple[str, int]]:
    """Core and number of threads of each OpenBLAS that is loaded."""
    try:
        with open("/proc/self/maps", encoding="utf-8", errors="replace") as file:
            paths = {line.split(maxsplit=5)[5].strip() for line in file if "openblas" in line}
    except OSError:
        return []
    cores = []
    for path in sorted(paths):
        library = ctypes.CDLL(path)
        for prefix, suffix in (("scipy_", "64_"), ("scipy_", ""), ("", "64_"), ("", "")):
            core = getattr(library, f"{prefix}openblas_get_corename{suffix}", None)
            if core is not None:
                core.restype = ctypes.c_char_p
                threads = getattr(library, f"{prefix}openblas_get_num_threads{suffix}")
                cores.append((core().decode(), threads()))
                break
    return cores


def _kernels() -> str:
    if pinnable():
        return f"{LEVEL} with SVML" if "numba" in sys.modules and sys.modules["numba"].config.USING_SVML else LEVEL
    from numba.core.registry import cpu_target  # kernels are then compiled as numba compiles its own

    _, name, features = cpu_target.target_context.codegen().magic_tuple()
    return f"{name}/{hashlib.sha256(features.encode()).hexdigest()[:8]}"


def _version(package: str) -> str:
    from importlib.metadata import PackageNotFoundError, version  # slow to import

    try:
        return version(package)
    except PackageNotFoundError:
        return "none"
