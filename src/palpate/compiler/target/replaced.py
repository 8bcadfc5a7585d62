"""The functions of the C library that kernels of this package replace in all kernels."""

import importlib
from typing import Any

REPLACED = {
    **dict.fromkeys(("exp", "llvm.exp.f64"), ("exponentials", "exp")),
    **dict.fromkeys(("log", "llvm.log.f64"), ("exponentials", "log")),
    **dict.fromkeys(("pow", "llvm.pow.f64"), ("exponentials", "power")),
    **dict.fromkeys(("log2", "llvm.log2.f64"), ("exponentials", "log2")),
    "expm1": ("exponentials", "expm1"),
    "log1p": ("exponentials", "log1p"),
    **dict.fromkeys(("sin", "llvm.sin.f64"), ("angles", "sin")),
    **dict.fromkeys(("cos", "llvm.cos.f64"), ("angles", "cos")),
    "acos": ("angles", "acos"),
    "asin": ("angles", "asin"),
    "atan2": ("angles", "atan2"),
    **dict.fromkeys(("hypot", "_hypot"), ("angles", "hypot")),
}
"""Module and name of the kernel that replaces a function of the C library in all kernels, by the name in their code."""


def plain_name(name: str) -> str:
    """The name of a function of the C library, of a name in `REPLACED`."""
    return name.removeprefix("llvm.").removesuffix(".f64").removeprefix("_")


def replacement(name: str) -> Any:
    """The kernel that replaces a function of the C library (`REPLACED`); None: it is not replaced."""
    if name not in REPLACED:
        return None
    module, kernel_name = REPLACED[name]
    return getattr(importlib.import_module(f"palpate.compiler.{module}"), kernel_name)
