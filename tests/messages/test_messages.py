"""Requirements for every shipped message type: docstrings agree with annotations, the wire form is plain msgpack."""

import math
import re
from copy import copy

import msgpack
import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import UNSET
from pytest import approx

from palpate.drivers.limits import LIMITS
from palpate.messages import Friction, Load, Message, MessageError, check_finite, fields, pack, unpack
from palpate.messages.checks import check_plausible, plausible_check
from palpate.messages.docs import documented_fields, message_types
from palpate.messages.fields import MOST

KINDS = list(message_types().values())
ids = [kind.__name__ for kind in KINDS]


ODD_TYPES = ["<f8", ",", "(", "<i4", "O", "(2,)f8", "f8,f8", "M8", "V0", "U0"]


def value_of(field, lengths, draw):
    """A valid value of a field; arrays with the same length symbol have the same length."""
    shape = tuple(lengths[n] if isinstance(n, str) else n for n in field.shape)
    number = st.floats(allow_nan=False, allow_infinity=False)
    count = math.prod(shape)
    if field.dtype is not None:
        one = st.integers(-(2**31), 2**31 - 1) if field.dtype.kind == "i" else number
        return np.array(draw(st.lists(one, min_size=count, max_size=count)), dtype=field.dtype).reshape(shape)
    if shape:
        whole = "int" in str(field.type)
        one = st.integers(-(2**63), 2**63 - 1) if whole else number
        return tuple(draw(st.lists(one, min_size=count, max_size=count)))
    kinds = {bool: st.booleans(), int: st.integers(-(2**63), 2**63 - 1), str: st.text(max_size=8), float: number}
    return draw(kinds[field.type])


@st.composite
def messages(draw, kind):
    letters = {n for field in fields(kind) for n in field.shape if isinstance(n, str)}
    lengths = {n: draw(st.integers(0, 5)) for n in sorted(letters)}
    values = {field.name: value_of(field, lengths, draw) for field in fields(kind)}
    header = {
        "tick": draw(st.integers(-1, 2**60)),
        "time": draw(st.integers(-1, 2**62)),
        "source": draw(st.text(max_size=10)),
        "used": tuple(draw(st.lists(st.integers(-1, 2**60), max_size=4))),
        "delayed": draw(st.just(UNSET) | st.integers(1, 2**60)),
    }
    return kind(**values, **header)


def same(a, b):
    for name in a.__struct_fields__:
        one, two = getattr(a, name), getattr(b, name)
        if isinstance(one, np.ndarray):
            assert one.dtype == two.dtype and one.shape == two.shape and one.tobytes() == two.tobytes(), name
        else:
            assert one == two and type(one) is type(two), name


def test_messages_exist():
    assert {"Contact", "Surface", "Force"} <= set(ids)


@pytest.mark.parametrize("kind", KINDS, ids=ids)
def test_docstrings_agree_with_annotations(kind):
    declared = [(f.name, f.unit, f.shape) for f in fields(kind)]
    described = {d.name: (d.name, d.unit, d.shape) for d in documented_fields(kind)}
    for field in declared:
        assert described.pop(field[0], None) == field
    assert not described, "the docstring describes a field that there is not"
    assert (kind.__doc__ or "").strip()[0].isupper()


@pytest.mark.parametrize("name", ["Contcat", "contcat"])
def test_an_unknown_message_is_an_error_and_another_one_is_found_in_its_file(name):
    from palpate import messages

    assert messages.TaxelForces in KINDS
    with pytest.raises(AttributeError, match=f"module 'palpate.messages' has no attribute '{name}'"):
        getattr(messages, name)


def test_the_header_is_described():
    assert [d.name for d in documented_fields(Message)] == ["tick", "time", "source", "used", "delayed"]


@pytest.mark.parametrize("kind", KINDS, ids=ids)
@settings(max_examples=10, deadline=None)
@given(data=st.data())
def test_a_message_survives_a_round_trip(kind, data):
    message = data.draw(messages(kind))
    wire = pack(message)
    same(unpack(wire, kind), message)
    assert pack(unpack(wire, kind)) == wire
    check_finite(message)


@pytest.mark.parametrize("kind", KINDS, ids=ids)
@settings(max_examples=5, deadline=None)
@given(data=st.data())
def test_any_msgpack_reader_can_read_it(kind, data):
    message = data.draw(messages(kind))
    plain = msgpack.unpackb(pack(message))
    assert (plain["tick"], plain["source"], tuple(plain["used"])) == (message.tick, message.source, message.used)
    for field in fields(kind):
        sent, read = getattr(message, field.name), plain[field.name]
        if field.dtype is not None:
            array = np.frombuffer(read["data"], dtype=read["dtype"]).reshape(read["shape"])
            assert array.tobytes() == sent.tobytes() and array.shape == sent.shape
        else:
            assert (tuple(read) if isinstance(read, list) else read) == sent


@pytest.mark.parametrize("kind", KINDS, ids=ids)
@settings(max_examples=6, deadline=None)
@given(data=st.data())
def test_random_bytes_are_rejected_or_decoded_without_a_crash(kind, data):
    rubbish(kind, data)


@pytest.mark.parametrize("kind", KINDS, ids=ids)
@settings(max_examples=6, deadline=None)
@given(data=st.data())
def test_a_damaged_message_is_rejected_or_decoded_without_a_crash(kind, data):
    damaged(kind, data)


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS, ids=ids)
@settings(max_examples=300, deadline=None)
@given(data=st.data())
def test_random_and_damaged_bytes_never_crash(kind, data):
    rubbish(kind, data)
    damaged(kind, data)


def rubbish(kind, data):
    wire = data.draw(st.one_of(st.binary(max_size=80), st.builds(msgpack.packb, nested())))
    try:
        unpack(wire, kind)
    except MessageError as error:
        assert kind.__name__ in str(error)


def damaged(kind, data):
    """A valid message with one field replaced, truncated, or with a flipped byte."""
    message = data.draw(messages(kind))
    plain = msgpack.unpackb(pack(message))
    name = data.draw(st.sampled_from(sorted(plain)))
    odd = st.fixed_dictionaries(
        {"dtype": st.one_of(st.text(max_size=6), st.sampled_from(ODD_TYPES)),
         "shape": st.lists(st.integers(-3, 2**40), max_size=3), "data": st.binary(max_size=24)}
    )  # fmt: skip
    plain[name] = data.draw(st.one_of(nested(), odd))
    whole = bytearray(msgpack.packb(plain))
    cut = data.draw(st.integers(0, len(whole)))
    flipped = bytearray(pack(message))
    flipped[data.draw(st.integers(0, len(flipped) - 1))] ^= data.draw(st.integers(1, 255))
    for wire in (whole, whole[:cut], flipped):
        try:
            unpack(bytes(wire), kind)
        except MessageError as error:
            assert kind.__name__ in str(error)


def nested():
    leaf = st.one_of(st.none(), st.booleans(), st.integers(-(2**63), 2**64 - 1), st.floats(), st.text(max_size=5),
                     st.binary(max_size=9))  # fmt: skip
    return st.recursive(leaf, lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=6), inner))


@pytest.mark.parametrize("kind", KINDS, ids=ids)
@settings(max_examples=6, deadline=None)
@given(data=st.data(), bad=st.sampled_from([math.nan, math.inf, -math.inf]))
def test_a_number_that_is_not_finite_is_reported_with_its_field(kind, data, bad):
    message = data.draw(messages(kind))
    for field in fields(kind):
        value = getattr(message, field.name)
        if field.type is float:
            wrong = bad
        elif isinstance(value, tuple) and value and isinstance(value[0], float):
            wrong = (*value[:-1], bad)
        elif field.dtype is not None and field.dtype.kind == "f" and value.size:
            wrong = value.copy()
            wrong.flat[-1] = bad
        else:
            continue
        with pytest.raises(MessageError, match=rf"{kind.__name__}\.{field.name} "):
            check_finite(msgspec.structs.replace(message, **{field.name: wrong}))


@pytest.mark.parametrize("kind", KINDS, ids=ids)
def test_the_largest_numbers_are_finite(kind):
    """Although their sum overflows, the check must neither reject them nor warn."""
    most = np.finfo(float).max

    def value(field):
        shape = tuple(3 if isinstance(n, str) else n for n in field.shape)
        if field.dtype is not None:
            return np.full(shape, most if field.dtype.kind == "f" else 0, dtype=field.dtype)
        one = {bool: False, int: 0, str: ""}.get(field.type, most)
        return (0 if "int" in str(field.type) else most,) * shape[0] if shape else one

    check_finite(kind(**{field.name: value(field) for field in fields(kind)}))


def test_a_message_shares_read_only_arrays_and_copies_others():
    nodes, forces = np.arange(3, dtype="<i4"), np.arange(9.0).reshape(3, 3)
    nodes.setflags(write=False)
    load = Load(nodes=nodes, forces=forces, foot=(0.0, 0.0, 0.0), normal=(0.0, 0.0, 1.0))
    forces[:] = -1.0
    assert load.nodes is nodes and load.forces[2, 2] == 8.0 and not load.forces.flags.writeable
    turned = np.arange(9.0).reshape(3, 3).T
    turned.setflags(write=False)
    load = Load(nodes=[0, 1, 2], forces=turned, foot=[0, 0, 0], normal=np.array([0.0, 0.0, 1.0]))
    assert load.forces.flags.c_contiguous and (load.forces == turned).all() and load.nodes.dtype == "<i4"
    assert load.foot == (0.0, 0.0, 0.0) and type(load.foot[0]) is float and type(load.normal) is tuple


@pytest.mark.parametrize(
    "arrange", [np.asfortranarray, lambda a: np.repeat(a, 2, axis=1)[:, ::2], lambda a: a[::-1, ::-1]]
)
def test_an_array_in_another_order_in_memory_is_sent_in_the_order_of_its_indices(arrange):
    """Every other field is of its type already, so that only the order in memory is wrong. The bytes on the wire are
    read with the package msgpack."""
    nodes, forces = np.arange(3, dtype="<i4"), arrange(np.arange(9.0).reshape(3, 3))
    for array in (nodes, forces):
        array.setflags(write=False)
    assert not forces.flags.c_contiguous and forces.dtype == "<f8"
    load = Load(nodes=nodes, forces=forces, foot=(0.0, 0.0, 0.0), normal=(0.0, 0.0, 1.0))
    assert load.forces.flags.c_contiguous
    sent = msgpack.unpackb(pack(load))["forces"]
    data = next(value for value in (sent.values() if isinstance(sent, dict) else sent) if isinstance(value, bytes))
    assert np.frombuffer(data, "<f8").reshape(3, 3).tolist() == forces.tolist()
    assert unpack(pack(load), Load).forces.tolist() == forces.tolist()


def test_arrays_with_the_same_length_symbol_have_equal_lengths():
    with pytest.raises(MessageError, match=r"Load.forces: found shape \(2, 3\), expected \(3, 3\)"):
        Load(nodes=np.zeros(3, "<i4"), forces=np.zeros((2, 3)), foot=(0.0, 0.0, 0.0), normal=(0.0, 0.0, 1.0))


def test_forces_and_torques_are_bounded_by_1000_times_the_limits_of_a_device():
    """1e300 N from a node in Python was finite, and the hand lost its force without a sign."""
    limits = LIMITS.values()
    most = {
        "N": max(each.command for each in limits if not each.each),
        "N m": max(each.command for each in limits if each.each),
    }  # fmt: skip
    assert {unit: MOST[unit][0] for unit in most} == approx({unit: 1000 * value for unit, value in most.items()}, 0.01)


NUMBERS = [
    pytest.param(kind, field, id=f"{kind.__name__}.{field.name}")
    for kind in KINDS for field in fields(kind)
    if field.element is float or field.type is float or (field.dtype is not None and field.dtype.kind == "f")
]  # fmt: skip


@pytest.mark.parametrize(("kind", "field"), NUMBERS)
def test_every_number_of_every_message_has_a_bound_with_a_reason(kind, field):
    assert field.most < np.inf and field.why
    value = np.asarray(getattr(kind.example(True), field.name), float)
    if not value.size:  # of open length, and empty in the example
        value = np.zeros(tuple(length if isinstance(length, int) else 3 for length in field.shape))
    value = np.zeros_like(value)
    for most, good in ((field.most, True), (1.0001 * field.most, False), (-1e300, False)):
        value.flat[-1] = most
        given = value.item() if not field.shape else tuple(value.tolist()) if field.dtype is None else value.copy()
        message = copy(kind.example(True))
        msgspec.structs.force_setattr(message, field.name, given)
        assert plausible_check(kind)(message) or not good
        if good:
            check_plausible(message)
        else:
            with pytest.raises(MessageError, match=rf"{kind.__name__}.{field.name} .*found .*{re.escape(field.why)}"):
                check_plausible(message)


@pytest.mark.parametrize("value", [10001.0, -10001.0, 1e300])
def test_an_implausible_number_is_named(value):
    friction = Friction(force=(0.0, value, 0.0), bristle=(0.0, 0.0, 0.0), stick=False)
    with pytest.raises(MessageError, match=r"Friction.force \[N\]: found .* at index 1, expected at most 10000"):
        check_plausible(friction)
    load = Load.example(True)
    wrong = msgspec.structs.replace(load, forces=np.array([[0.0, 0.0, value]]))
    with pytest.raises(MessageError, match=r"Load.forces \[N\]: found .* at index \(0, 2\)"):
        check_plausible(wrong)
    check_finite(friction)


def test_plausible_numbers_pass():
    for kind in KINDS:
        check_plausible(kind.example(True))
    check_plausible(Friction(force=(0.0, 9999.0, -9999.0), bristle=(0.0, 0.0, 0.0), stick=False))
    count = 5000  # of forces whose sum of squares is beyond the bound, although none is
    load = msgspec.structs.replace(Load.example(True), nodes=np.zeros(count, int), forces=np.full((count, 3), 9e3))
    check_plausible(load)


def test_a_name_that_no_file_declares_is_an_error():
    import palpate.messages

    for name in ("Contacct", "contacct"):
        with pytest.raises(AttributeError, match=f"has no attribute '{name}'"):
            getattr(palpate.messages, name)
    with pytest.raises(ImportError, match="cannot import name 'Contacct'"):
        from palpate.messages import Contacct  # noqa: F401
