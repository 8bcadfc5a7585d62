"""Arguments of the functions in palpate.physics have types, except in kernels, whose types numba infers."""

import ast
from pathlib import Path

import palpate.physics

ROOM = Path(palpate.physics.__file__).parent
LEAST = 0.95  # share of the arguments with a type


def kernel(function):
    return any("kernel" in ast.unparse(one) or "njit" in ast.unparse(one) for one in function.decorator_list)


def arguments(function):
    given = function.args
    found = (*given.posonlyargs, *given.args, *given.kwonlyargs)
    return [argument for argument in found if argument.arg not in ("self", "cls")]


def test_arguments_outside_kernels_have_types():
    typed, untyped = 0, []
    for file in sorted(ROOM.rglob("*.py")):
        for function in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if not isinstance(function, ast.FunctionDef) or kernel(function):
                continue
            for argument in arguments(function):
                if argument.annotation is None:
                    untyped.append(f"{file.relative_to(ROOM)}: {function.name}({argument.arg})")
                else:
                    typed += 1
    assert typed > 500
    assert typed / (typed + len(untyped)) >= LEAST, untyped
