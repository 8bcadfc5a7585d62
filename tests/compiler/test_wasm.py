"""What WebAssembly lacks is exact in the kernels that replace it, here and in Node; the object becomes a module."""

import struct

import numpy as np
import pytest
from in_node import run_script
from numba import types

from palpate.compiler.doubles import fused
from palpate.compiler.kernel import ieee_kernel, kernel
from palpate.compiler.memory import number, set_word, word
from palpate.compiler.wasm import runtime, store
from palpate.compiler.wasm.link import Kernel, LinkError, link
from palpate.compiler.wasm.object_file import Linked, finish

COUNT = 100_000
EXTREMES = [0.0, -0.0, np.inf, -np.inf, np.nan, 5e-324, -5e-324, 1.7976931348623157e308, 2.2250738585072014e-308, 1.0,
            -1.0, 2.0**900, 2.0**-900, 2.0**-1000]  # fmt: skip


@ieee_kernel
def fill(count, a, b, c, found, expected):
    for i in range(count):
        found[i], expected[i] = runtime.fma(a[i], b[i], c[i]), fused(a[i], b[i], c[i])


@ieee_kernel
def fill_fmod(count, a, b, found):
    for i in range(count):
        found[i] = runtime.fmod(a[i], b[i])


def factors(kind, rng):
    """Three arrays: any bits, sums that cancel, near the smallest number, few bits, extremes, near the largest."""
    signs = rng.choice([-1.0, 1.0], (3, COUNT))
    if kind == "bits":
        return [rng.integers(-(2**63), 2**63, COUNT, dtype=np.int64).view(float) for _ in range(3)]
    if kind == "cancel":
        a, b = (rng.normal(size=COUNT) * 2.0 ** rng.integers(-40, 40, COUNT) for _ in range(2))
        return [a, b, -a * b * (1 + rng.integers(-3, 4, COUNT) * 2.0**-52)]
    if kind == "small":
        a, b = (np.ldexp(1 + rng.random(COUNT), rng.integers(-560, -480, COUNT)) for _ in range(2))
        return [
            *(signs[:2] * [a, b]),
            rng.integers(-(2**53), 2**53, COUNT) * 5e-324 * 2.0 ** rng.integers(0, 30, COUNT),
        ]
    if kind == "few":
        return [s * (rng.integers(0, 2**53, COUNT) >> rng.integers(0, 52, COUNT)) * 2.0 ** rng.integers(-60, 60, COUNT)
                for s in signs]  # fmt: skip
    if kind == "extremes":
        return [rng.choice(EXTREMES, COUNT) for _ in range(3)]
    return [s * np.ldexp(1 + rng.random(COUNT), rng.integers(*reach, COUNT))
            for s, reach in zip(signs, ((500, 520), (490, 510), (990, 1023)), strict=True)]  # fmt: skip


def same(found, expected):
    return (found.view(np.int64) == expected.view(np.int64)) | (np.isnan(found) & np.isnan(expected))


@pytest.mark.parametrize("kind", ["bits", "cancel", "small", "few", "extremes", "large"])
def test_the_product_and_sum_are_rounded_once(kind):
    a, b, c = factors(kind, np.random.default_rng(5))
    found, expected = np.empty(COUNT), np.empty(COUNT)
    fill(COUNT, a, b, c, found, expected)
    assert same(found, expected).all()


@pytest.mark.parametrize("kind", ["bits", "small", "few", "extremes"])
def test_the_remainder_is_that_of_the_c_library(kind):
    a, b, _ = factors(kind, np.random.default_rng(6))
    found = np.empty(COUNT)
    fill_fmod(COUNT, a, b, found)
    with np.errstate(all="ignore"):
        assert same(found, np.fmod(a, b)).all()


def test_the_product_of_words_has_all_of_its_bits():
    rng = np.random.default_rng(7)
    for a, b in rng.integers(-(2**63), 2**63, (2000, 2), dtype=np.int64).tolist():
        a, b = a >> int(rng.integers(0, 63)), b >> int(rng.integers(0, 63))
        high, low = runtime.wide_product(a, b)
        assert (high % 2**64) << 64 | low % 2**64 == (a % 2**64) * (b % 2**64)


@kernel
def calculate(at, count, to):
    """Write fma, remainder and the sum of an allocated array, of `count` triples of numbers at an address."""
    for i in range(count):
        a, b, c = number(at + 24 * i), number(at + 24 * i + 8), number(at + 24 * i + 16)
        several = np.zeros(3 + i % 5)
        several[0], several[2] = fused(a, b, c), float(i)
        set_word(to + 24 * i, runtime.bits(several[0]))
        set_word(to + 24 * i + 8, runtime.bits(np.fmod(a, b)))
        set_word(to + 24 * i + 16, word(at) + len(several))


def test_a_module_computes_the_same_bits_in_node_and_gives_memory_back(tmp_path):
    """With the calls that LLVM makes: of `fma`, of `fmod`, of `__multi3` for the size of an array."""
    linked, indices = link(
        [Kernel(calculate, (types.int64,) * 3)], {"calculate": Kernel(calculate, (types.int64,) * 3)}
    )
    assert indices == [linked.table[next(iter(linked.table))]] and linked.imported == ()
    rng = np.random.default_rng(8)
    given = np.array([factors(kind, rng) for kind in ("bits", "cancel", "small", "few")]).transpose(0, 2, 1)[:, :2000]
    given = given.reshape(-1, 3).copy()
    (tmp_path / "code.wasm").write_bytes(linked.code)
    (tmp_path / "given").write_bytes(given.tobytes())
    used = run_script(tmp_path, "calculate_in_node.mjs")
    found = np.frombuffer((tmp_path / "found").read_bytes(), np.int64).reshape(-1, 3)
    expected = np.zeros_like(found)
    with np.errstate(all="ignore"):
        calculate(given.ctypes.data, len(given), expected.ctypes.data)
        assert same(found[:, 0].copy().view(float), expected[:, 0].copy().view(float)).all()
        assert same(found[:, 1].copy().view(float), np.fmod(given[:, 0], given[:, 1])).all()
    assert (found[:, 2] == expected[:, 2]).all()
    assert 0 < used < 1024  # a few blocks, used again 8000 times


@kernel
def digits(at):
    return len(str(at))


def test_a_function_that_is_missing_is_named():
    with pytest.raises(LinkError, match=r"kernels call .*log10.*, which WebAssembly lacks"):
        link([Kernel(digits, (types.int64,))], {})


@kernel
def pair(x):
    return x, 1


def test_a_kernel_with_another_result_than_its_callers_expect_is_named():
    """As for a call from a kernel it is compiled with an integer as second result."""
    pair.bare.compile((types.float64,))
    with pytest.raises(LinkError, match=r"pair.* returns .*int.*, expected UniTuple"):
        link([Kernel(pair, (types.float64,), types.UniTuple(types.float64, 2))], {})


def test_an_object_without_data_has_none():
    data = b"\0asm\1\0\0\0" + section(2, b"\0") + section(10, b"\0") + section(0, b"\x07linking\x02\x08\x01\0")
    assert finish(data, {}).data == 0


def section(kind, content):
    return struct.pack("<BB", kind, len(content)) + content


@pytest.mark.parametrize("damage", [None, "cut", "untrusted"])
def test_a_stored_module_is_used_unless_it_is_damaged_or_of_another_user(damage, tmp_path, monkeypatch):
    monkeypatch.setattr(store.kernel_cache, "folder", lambda _: tmp_path)
    made = []

    def make():
        made.append(1)
        return Linked(b"code", {"one": 1}, 16, ("lacking",))

    first = store.stored("palpate.wasm-1.bin", make)
    file = tmp_path / "palpate.wasm-1.bin"
    if damage == "cut":
        file.write_bytes(file.read_bytes()[:-1])
    elif damage == "untrusted":
        file.chmod(0o666)
    again = store.stored("palpate.wasm-1.bin", make)
    assert first == again == Linked(b"code", {"one": 1}, 16, ("lacking",))
    assert len(made) == (1 if damage is None else 2)
