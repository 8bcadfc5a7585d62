"""Arguments of the functions in palpate.physics have types, kernels included."""

import ast
import re
from pathlib import Path

from sources import nodes

import palpate.physics
from palpate.physics import arrays

ROOM = Path(palpate.physics.__file__).parent
LEAST = 0.95  # share of the arguments with a type
ALIASES = {name for name in vars(arrays) if name[0].isupper() and not name.startswith(("Sequence", "ArrayLike", "Any"))}


def functions():
    """Each function, with its file and whether it is a kernel."""
    for file in sorted(ROOM.rglob("*.py")):
        for function in nodes(file):
            if isinstance(function, ast.FunctionDef):
                marks = " ".join(ast.unparse(one) for one in function.decorator_list)
                yield str(file.relative_to(ROOM)), function, re.search("kernel|njit", marks) is not None


def arguments(function):
    given = function.args
    found = (*given.posonlyargs, *given.args, *given.kwonlyargs)
    return [argument for argument in found if argument.arg not in ("self", "cls")]


def test_arguments_have_types():
    for compiled, many in ((True, 1500), (False, 500)):
        typed, untyped = 0, []
        for file, function in ((file, function) for file, function, kernel in functions() if kernel is compiled):
            for argument in arguments(function):
                if argument.annotation is None:
                    untyped.append(f"{file}: {function.name}({argument.arg})")
                else:
                    typed += 1
        assert typed > many
        assert typed / (typed + len(untyped)) >= LEAST, untyped


def test_arrays_of_kernels_have_the_types_of_one_file():
    """An array of a kernel has an alias of `arrays`, or is part of a NamedTuple."""
    names = {name for _, function, kernel in functions() if kernel for name in types(function)}
    assert names & ALIASES >= {"Array", "Indices", "Matrix", "Record", "Tensor", "Vector3"}
    assert "ndarray" not in names


def types(function):
    for argument in arguments(function):
        for node in ast.walk(argument.annotation) if argument.annotation is not None else ():
            if isinstance(node, ast.Name):
                yield node.id
            elif isinstance(node, ast.Attribute):
                yield node.attr
