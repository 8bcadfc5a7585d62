"""The `Wants` of each node equal the fields that its code reads: a sender would omit a missing field, and compute an
extra field without need."""

import ast
import inspect
import textwrap

import pytest

from palpate.launch.load.classes import body, catalogue, find_class
from palpate.nodes.base import Observer, effects, inputs, outputs

NODES = [entry.use for entry in catalogue()[0] if not issubclass(entry.cls, Observer)]
HEADER = {"tick", "time", "source", "used", "delayed"}
PRICED = {
    (kind, field)
    for entry in catalogue()[0]
    for effect in effects(entry.cls)
    for field in effect.fields
    for kind in outputs(entry.cls)
}
"""Fields that a sender omits if no node reads them."""


def reads(cls, function, name, seen=()):
    """The fields that a function reads of its argument `name`, from its source and that of functions that receive the
    argument; None if the source of one is unknown."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(_plain(function))))
    names, found, inside = {name}, set(), set()
    for node in ast.walk(tree):  # another name of it: `b = body`, `b = body or NONE`, `for b in (body, x)`
        if isinstance(node, ast.Assign | ast.AnnAssign) and isinstance(_target(node), ast.Name):
            value = node.value
            if isinstance(value, ast.BinOp) and isinstance(value.left, ast.List):  # `seen = [body] * count`
                value = value.left.elts[0]
            if name in {_one(v) for v in [value, *getattr(value, "values", ())] if isinstance(v, ast.Name | ast.Call)}:
                names.add(_target(node).id)
        if isinstance(node, ast.For | ast.comprehension):
            names |= _each(node.target, node.iter, name)
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and _one(node.value) in names:
            found.add(node.attr)
        if not isinstance(node, ast.Call) or _is_nth(node):
            continue
        passed = [(i, a) for i, a in enumerate(node.args)] + [(k.arg, k.value) for k in node.keywords]
        for spot, argument in passed:
            if _one(argument) not in names:
                continue
            called = _called(cls, function, node.func)
            if called is None or isinstance(called, type):
                inside.add(ast.unparse(node.func))
                continue
            known = [p for p in inspect.signature(_plain(called)).parameters if p != "self"]
            port = known[spot] if isinstance(spot, int) else spot
            if (called, port) not in seen:
                found |= reads(cls, called, port, (*seen, (called, port)))
    assert not inside - HARMLESS, f"{cls.__name__}: not known what {inside} reads"
    return found - HEADER - {"there", "present"}


def _plain(function):
    """The original of a wrapped or compiled function."""
    return getattr(inspect.unwrap(function), "py_func", inspect.unwrap(function))


def _target(node):
    return node.target if isinstance(node, ast.AnnAssign) else node.targets[0]


def _is_nth(value):
    """Whether it is one of several messages: `nth(load, i)`."""
    return isinstance(value, ast.Call) and isinstance(value.func, ast.Name) and value.func.id == "nth"


def _one(value):
    """The name in `load`, in `load[0]` and in `nth(load, 0)`."""
    value = value.args[0] if _is_nth(value) else value
    value = value.value if isinstance(value, ast.Subscript) else value
    return value.id if isinstance(value, ast.Name) else None


def _each(target, source, name):
    """Loop variables of a list: `for each in load`, `for body, each in zip(bodies, load)`."""
    if isinstance(source, ast.Name):
        return {target.id} if source.id == name and isinstance(target, ast.Name) else set()
    if not (isinstance(source, ast.Call) and isinstance(source.func, ast.Name) and isinstance(target, ast.Tuple)):
        return set()
    lists = [None, *source.args] if source.func.id == "enumerate" else source.args
    return {n for part, own in zip(target.elts, lists, strict=False) if own is not None for n in _each(part, own, name)}


HARMLESS = {"InputError", "bool", "enumerate", "isinstance", "len", "list", "zip", "zip_longest"}


def _called(cls, function, called):
    """The function or method that a call names."""
    known = _plain(function).__globals__
    if isinstance(called, ast.Name):
        closed = inspect.getclosurevars(_plain(function)).nonlocals
        return closed.get(called.id, known.get(called.id))
    if not isinstance(called, ast.Attribute):
        return None
    if isinstance(called.value, ast.Name) and inspect.ismodule(known.get(called.value.id)):
        return getattr(known[called.value.id], called.attr)
    if isinstance(called.value, ast.Name):  # a method of this or of another object
        return getattr(cls, called.attr, None)
    if isinstance(called.value, ast.Call) and ast.unparse(called.value) == "super()":
        owner = next(c for c in cls.__mro__ if function.__qualname__.startswith(f"{c.__name__}."))
        return getattr(super(owner, cls), called.attr)
    return None


@pytest.mark.parametrize("use", NODES)
def test_the_wants_of_a_node_are_the_fields_that_its_step_reads(use):
    cls = find_class(use)
    for port in inputs(cls):
        read = reads(cls, cls.wiring(), port.name)
        resting = getattr(cls, "idle", None) or cls.rests
        if port.name in inspect.signature(_plain(resting)).parameters:
            read |= reads(cls, resting, port.name)
        read &= body(port.type)
        assert read <= port.wants, f"{use}: step reads {port.name}.{', '.join(sorted(read - port.wants))}"
        idle = {field for field in (port.wants & body(port.type)) - read if (port.type, field) in PRICED}
        assert not idle, f"{use}: no code reads {port.name}.{', '.join(sorted(idle))}"
