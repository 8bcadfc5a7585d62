"""Bitwise reproducible arithmetic: the instruction set that a process computes with.

Kernels are always compiled for x86-64-v3 (AVX2 and FMA; every server since 2015; see `kernel`), or on 64-bit ARM for
ARMv8-A without extensions, and the shipped nodes compute the force with kernels. numpy and OpenBLAS choose their inner
loops, and with them the order of their sums, by the processor when they are loaded. On x86-64, processes that palpate
starts (command line, workers, studies) are pinned to the same instructions with `pin` or `environment`. A process that
imports palpate is not pinned: custom nodes that use numpy, and a basis built there, may differ in the last bits.
`in_force` reports what a process uses.

`PALPATE_NATIVE=1` in the environment selects the fastest instructions of the processor; the last bits then differ.
"""

import functools
import os
import platform
import re
import sys
from importlib.util import find_spec
from pathlib import Path

LEVEL = "x86-64-v3"
ARM64 = "generic"  # LLVM's name of ARMv8-A without extensions, which all 64-bit ARM processors have
CORE = "Haswell"  # OpenBLAS's name of its kernels for these instructions

_FLAGS = {"avx", "avx2", "bmi1", "bmi2", "f16c", "fma", "abm", "movbe", "xsave"}
"""CPU flags of x86-64-v3, as the Linux kernel names them."""
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
_KERNELS = {"NUMBA_CPU_NAME": LEVEL, "NUMBA_CPU_FEATURES": "", "NUMBA_DISABLE_INTEL_SVML": "1"}
"""Settings for functions that user nodes compile with `numba.njit`."""


def environment() -> dict[str, str]:
    """The environment of a process that palpate starts: pinned, with one thread for linear algebra.

    The matrices are small; several threads mostly wait for each other (measured: 10 x slower on a loaded machine).
    """
    return {**os.environ, **dict.fromkeys(_THREADS, "1"), **_is_pinned()}


def pin() -> None:
    """Pin this process; call it before numpy is imported. Linear algebra uses one thread unless the environment sets
    another number."""
    os.environ.update({**dict.fromkeys(_THREADS, "1"), **os.environ, **_is_pinned()})


def _is_pinned() -> dict[str, str]:
    if not pinnable():
        return {}
    return {"OPENBLAS_CORETYPE": CORE, "NPY_DISABLE_CPU_FEATURES": _newer(), **_KERNELS}


@functools.cache
def pinnable() -> bool:
    """Whether this machine supports x86-64-v3 and `PALPATE_NATIVE` is not set."""
    if os.environ.get("PALPATE_NATIVE") or platform.machine() != "x86_64":
        return False
    try:
        with open("/proc/cpuinfo", encoding="utf-8", errors="replace") as file:
            flags = next((line.partition(":")[2].split() for line in file if line.startswith("flags")), [])
    except OSError:
        return False
    return set(flags) >= _FLAGS


def kernel_processor() -> str:
    """LLVM's name of the processor for which kernels are compiled; empty: that of this machine, with its extensions."""
    if pinnable():
        return LEVEL
    arm = platform.machine() in ("aarch64", "arm64")
    return ARM64 if arm and not os.environ.get("PALPATE_NATIVE") else ""


def in_force(*, here: bool = True) -> dict[str, str]:
    """Everything that determines the last bits of a result: instructions, library versions, C library (`exp`, `pow`).

    Two processes that agree in all entries compute the same bytes. If only numpy and OpenBLAS differ, the force of the
    shipped nodes is still the same. `here=False`: for a process that palpate starts, which is pinned where possible.
    """
    import numpy

    return {
        "architecture": platform.machine(),
        "instructions": LEVEL if pinnable() and not here else _instructions(numpy),
        **_libraries(),
        **{name: os.environ[name] for name in ("GLIBC_TUNABLES",) if name in os.environ},
    }


@functools.cache  # a process keeps the libraries that it has loaded; reading what they are takes 8 ms
def _libraries() -> dict[str, str]:
    """Versions of the libraries."""
    from importlib.metadata import version

    import numpy
    import scipy

    built = [package.show_config(mode="dicts")["Build Dependencies"]["blas"] for package in (numpy, scipy)]
    blas = [f"{build['name']} {build['version']}" for build in built]
    return {
        **{name: version(name) for name in ("numpy", "scipy", "numba", "llvmlite")},
        "BLAS of numpy": blas[0],
        "BLAS of scipy": blas[1],
        "libc": " ".join(platform.libc_ver()),
    }


def _newer() -> str:
    """numpy's names of the instructions beyond x86-64-v3, which changed in 2.4. Must not import numpy."""
    spec = find_spec("numpy")
    text = Path(spec.origin).with_name("version.py").read_text(encoding="utf-8") if spec and spec.origin else ""
    version = re.search(r'^version = "(\d+)\.(\d+)', text, re.MULTILINE)
    if version is None or tuple(map(int, version.groups())) >= (2, 4):
        return "X86_V4 AVX512_ICL AVX512_SPR"
    return "AVX512F AVX512CD AVX512_SKX AVX512_CLX AVX512_CNL AVX512_ICL AVX512_SPR"


def _instructions(numpy) -> str:
    """`LEVEL` if all loaded libraries are limited to it, else what each library uses."""
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
    """Core and number of threads of each loaded OpenBLAS."""
    try:
        with open("/proc/self/maps", "rb") as file:
            paths = {os.fsdecode(line.split(maxsplit=5)[5].strip()) for line in file if b"openblas" in line}
    except OSError:
        return []
    import ctypes  # here and below: a command that computes nothing does not need it

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
    if processor := kernel_processor():
        return processor
    import hashlib

    from numba.core.registry import cpu_target  # kernels are then compiled with numba's defaults

    _, name, features = cpu_target.target_context.codegen().magic_tuple()
    return f"{name}/{hashlib.sha256(features.encode()).hexdigest()[:8]}"
