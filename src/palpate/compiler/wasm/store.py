"""Linked modules in the cache of kernels (`kernel_files`)."""

import contextlib
import json
import struct
from collections.abc import Callable

import numba

from palpate.compiler import kernel_cache, kernel_files
from palpate.compiler.trust import UntrustedError
from palpate.compiler.wasm.object_file import Linked

_LENGTH = struct.Struct("<Q")  # of the table of a module, before its code


def stored(name: str, make: Callable[[], Linked]) -> Linked:
    """The module of this name in the cache, made and stored if it is missing, after waiting for a process that makes
    the same one."""
    folder = kernel_cache.folder(numba.config.CACHE_DIR)  # type: ignore[attr-defined]
    with kernel_files.hold_lock(folder, f"{name}.lock"):
        with contextlib.suppress(UntrustedError):  # another user can have written it
            content = kernel_files.read(folder, name)
            if content is not None:
                return _unpacked(content)
        linked = make()
        with contextlib.suppress(OSError):  # no room: it is made again
            kernel_files.write(folder, name, _packed(linked))
    return linked


def _packed(linked: Linked) -> bytes:
    head = json.dumps([linked.table, linked.data, linked.imported]).encode()
    return _LENGTH.pack(len(head)) + head + linked.code


def _unpacked(content: bytes) -> Linked:
    (length,) = _LENGTH.unpack_from(content)
    begin = _LENGTH.size + length
    table, data, imported = json.loads(content[_LENGTH.size : begin])
    return Linked(content[begin:], table, data, tuple(imported))
