"""A function does one thing: its body has at most 50 lines, or it is one of those that stay, with the reason."""

import ast
from pathlib import Path

from sources import nodes

import palpate

ROOT = Path(palpate.__file__).parent
MOST = 50
KERNEL = "one loop of compiled code over points, whose numbers would all be passed on to a part of it"
TICK = "the step of a node, in the order of its docstring, compiled; its numbers stay in registers"
STAYS = {
    "models/fe/contact/rigid.py _touch": KERNEL,
    "models/fe/contact/pair.py _touch": KERNEL,
    "models/fe/sparse/cholesky.py _factor": "one loop over columns of blocks, compiled",
    "models/fit/tissue/rigs.py closed_form": "a list of laws, each by its equation",
    "launch/run/launcher.py _take": "one match, with a case for each report",
    "nodes/contact/joint.py compute": TICK,
    "nodes/deformation/mass_spring.py compute": TICK,
    "nodes/tactile/afferents.py compute": TICK,
    "nodes/tactile/relief.py compute": TICK,
    "physics/bodies/beam_foundation_step.py _response": KERNEL,
    "physics/bodies/condensed_contacts.py _pair": KERNEL,
    "physics/bodies/sampled/solve.py settle": "one Newton iteration with its line search, compiled",
    "physics/device/controller.py haptic": TICK,
    "physics/fingertip/stick_slip.py _newton": "one Newton iteration with its line search, compiled",
    "physics/geometry/closest.py track": "one search along a surface, compiled",
    "physics/geometry/newton.py newton": "one Newton iteration with its line search, compiled",
    "studies/organs/bounds/side.py side": "one pass over the ticks of a touch, which keeps what was before",
}


def lines(function: ast.FunctionDef) -> int:
    """Lines of the body, without the signature and the docstring."""
    body = function.body[1:] if ast.get_docstring(function, clean=False) else function.body
    return function.end_lineno - body[0].lineno + 1 if body else 0


def test_functions_are_short_or_say_why_not():
    folders = [("", ROOT), *((f"{link.name}/", link.resolve()) for link in ROOT.iterdir() if link.is_symlink())]
    long = {
        f"{name}{file.relative_to(folder)} {node.name}"
        for name, folder in folders
        for file in folder.rglob("*.py")
        for node in nodes(file)
        if isinstance(node, ast.FunctionDef) and lines(node) > MOST
    }
    assert long == set(STAYS), "divide the new ones into functions that name their steps, or say why they stay"
