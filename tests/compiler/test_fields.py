"""Records for calls of kernels from Python: their fields are also attributes."""

import numpy as np
import pytest

from palpate.compiler.fields import blank_record, element_type, record_type

FIELDS = {"place": (3,), "energy": (), "steps": int, "wall": {"gap": (), "normal": (3,)}, "cells": (2, {"load": ()})}


def test_a_field_is_an_attribute_that_reads_and_writes_the_memory_of_the_record():
    record = blank_record(FIELDS, energy=2.0)
    record.steps, record.place[1], record.wall.gap, record.cells[1].load = 3, 4.0, 5.0, 6.0
    record.wall.normal[:] = (0.0, 0.0, 1.0)
    assert record.tolist()[1:3] == (2.0, 3) and record["place"].tolist() == [0.0, 4.0, 0.0]
    assert record["wall"].tolist()[0] == 5.0 and record["cells"]["load"].tolist() == [0.0, 6.0]
    assert (record.energy, record.steps, record.wall.gap, record.cells[1].load) == (2.0, 3, 5.0, 6.0)
    assert record.wall.normal.tolist() == [0.0, 0.0, 1.0]


def test_an_element_of_an_array_is_a_part_of_it():
    array = np.zeros(2, element_type(FIELDS))
    array[1].energy = 7.0
    assert array["energy"].tolist() == [0.0, 7.0]
    assert array.dtype.fields == record_type("fields", FIELDS).fields and array.itemsize == array.dtype.itemsize


@pytest.mark.parametrize("part", [lambda record: record, lambda record: record.wall], ids=["record", "group"])
def test_another_name_is_an_error(part):
    record = part(blank_record(FIELDS))
    with pytest.raises(AttributeError, match="speed"):
        _ = record.speed
    with pytest.raises(AttributeError, match="speed"):
        record.speed = 1.0
