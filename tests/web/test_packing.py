"""Memory in a shorter form, which the page restores to the same bytes."""

import json
import zlib

import in_node
import numpy as np
import pytest

from palpate.web.packing import DIFFERENCES, FORMS, HEAD, PLAIN, SYMMETRIC, differences, packed, symmetric

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


def test_the_shortest_form_is_chosen(tmp_path):
    random = np.random.default_rng(3)
    grid = np.stack(np.meshgrid(*[np.linspace(0.0, 0.1, 22)] * 3), axis=-1).reshape(-1, 3)
    contents = {PLAIN: random.bytes(4096), DIFFERENCES: np.arange(9000, dtype="<i8").tobytes(),
             SYMMETRIC: matrix(400, random).tobytes()}  # fmt: skip
    forms = []
    for kind, data in contents.items():
        forms.append(zlib.decompress(packed(data), 31))
        assert forms[-1][0] == kind and len(packed(data)) <= len(zlib.compress(data, 9)) + 40
    forms.append(zlib.decompress(packed(grid.tobytes()), 31))
    assert restored(tmp_path, forms) == [*contents.values(), grid.tobytes()]
