"""Memory in a shorter form, which the page restores to the same bytes."""

import json
import zlib

import in_node
import numpy as np
import pytest

from palpate.nodes.deformation import basis_store
from palpate.physics.bodies.sampled_body import SampledBasis
from palpate.web.packing import (
    DIFFERENCES,
    FORMS,
    HALVES,
    HEAD,
    PLAIN,
    SYMMETRIC,
    differences,
    halves,
    shortest,
    squeezed,
    symmetric,
)

RESTORE = """
import fs from "fs";
import { restored } from "./unpack.mjs";
const read = (name) => new Uint8Array(fs.readFileSync(name));
for (const name of JSON.parse(process.argv[2])) fs.writeFileSync(`${name}.out`, restored(read(name)));
console.log("true");
"""


def restored(folder, forms):
    """What the page makes of each form."""
    (folder / "unpack.mjs").write_text((in_node.STATIC / "unpack.js").read_text(encoding="utf-8"), encoding="utf-8")
    names = [str(number) for number in range(len(forms))]
    for name, form in zip(names, forms, strict=True):
        (folder / name).write_bytes(form)
    in_node.run_script(folder, RESTORE, json.dumps(names))
    return [(folder / f"{name}.out").read_bytes() for name in names]


def matrix(size, random):
    """A smooth symmetric matrix of multiples of a step, and its bytes."""
    half = np.cumsum(random.integers(-9, 10, (size, size)), axis=0)
    whole = (half + half.T).astype(np.int64)
    whole[0, 0] = -32767
    step = np.float32(0.0217)
    return (np.clip(whole, -32767, 32767).astype("<i2") * step).astype("<f4")


def test_every_form_is_restored_to_the_same_bytes(tmp_path):
    random = np.random.default_rng(1)
    contents = [random.bytes(n) for n in (0, 1, 7, 8, 63, 4096, 4099)] + [np.cumsum(random.normal(size=999)).tobytes()]
    forms = [differences(data, *form) for data in contents for form in FORMS]
    expected = [data for data in contents for _ in FORMS]
    assert restored(tmp_path, forms) == expected


@pytest.mark.parametrize("size", [4, 5, 6, 301])
def test_a_symmetric_matrix_of_steps_is_restored_to_the_same_bytes(tmp_path, size):
    data = matrix(size, np.random.default_rng(size)).tobytes()
    form = symmetric(data)
    assert form is not None and form[0] == SYMMETRIC and len(form) == HEAD + size * (size + 1)
    assert restored(tmp_path, [form]) == [data]


def test_another_matrix_keeps_its_numbers():
    whole = matrix(40, np.random.default_rng(2))
    for i, j, value in ((3, 4, 7.0), (5, 5, np.nan), (6, 6, np.float32(whole[6, 6]) * np.float32(1.0000001))):
        other = whole.copy()
        other[i, j] = value
        assert symmetric(other.tobytes()) is None
    assert symmetric(np.zeros((9, 9), "<f4").tobytes()) is None and symmetric(b"12345") is None


def every_half():
    """All finite numbers of half precision up to 3e4, of both signs, times a step."""
    words = np.arange(1 << 16, dtype="<u2").view("<f2")
    return words[np.abs(words) <= 3e4] * np.float32(0.0217)


@pytest.mark.parametrize("width", [4, 8])
def test_numbers_of_half_precision_times_a_step_are_restored_to_the_same_bytes(tmp_path, width):
    line = every_half().astype(f"<f{width}")
    size = 77
    square = np.random.default_rng(4).choice(line, (size, size))
    square[0, 0], square[1, 1] = line.max(), -0.0
    both = np.tril(square) + np.tril(square, -1).T
    contents = [line.tobytes(), square.tobytes(), both.tobytes()]
    forms = [halves(data) for data in contents]
    assert [form[:2] for form in forms] == [bytes([HALVES, width])] * 3
    assert [len(form) - HEAD for form in forms] == [2 * len(line), 2 * size * size, size * (size + 1)]
    assert restored(tmp_path, forms) == contents


def test_other_numbers_are_no_halves():
    line = every_half()
    for value in (np.inf, np.nan, np.float32(1.00049) * line[3000], 1e9):
        other = line.copy()
        other[3000] = value
        assert halves(other.tobytes()) is None
    double = line.astype(float)
    double[3000] *= 1.0 + 1e-12
    assert halves(double.tobytes()) is None and halves(line.tobytes() + b"1") is None
    assert halves(b"") is None and halves(bytes(64)) is None


def test_the_arrays_of_a_stored_basis_are_halves():
    basis = SampledBasis.load(next(basis_store.SHIPPED.glob("fingertip*.npz")))
    for array, most in ((basis.points.modes, 0.66), (basis.residual_compliance, 0.33), (basis.modes, 0.55)):
        data = array.tobytes()
        form = shortest(data)
        assert form[0] == HALVES
        assert len(squeezed(form)) < most * len(zlib.compress(data, 9))


def test_the_shortest_form_is_chosen(tmp_path):
    random = np.random.default_rng(3)
    grid = np.stack(np.meshgrid(*[np.linspace(0.0, 0.1, 22)] * 3), axis=-1).reshape(-1, 3)
    contents = {PLAIN: random.bytes(4096), DIFFERENCES: np.arange(9000, dtype="<i8").tobytes(),
             SYMMETRIC: matrix(400, random).tobytes()}  # fmt: skip
    forms = []
    for kind, data in contents.items():
        forms.append(shortest(data))
        assert forms[-1][0] == kind and len(squeezed(forms[-1])) <= len(zlib.compress(data, 9)) + 40
    forms.append(shortest(grid.tobytes()))
    assert restored(tmp_path, forms) == [*contents.values(), grid.tobytes()]
