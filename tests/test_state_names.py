"""State has names: no table is addressed by constants that are numbered with `range`."""

import ast
from pathlib import Path

ROOT = Path(__file__).parents[1]
FOLDERS = ("messages", "nodes", "launch", "src/palpate")
ALLOWED = {
    "TISSUE": "index of a part, in the order of `messages.ledger.PARTS`; the accounts are listed in a loop",
    "FINGERTIP": "as TISSUE", "FRICTION": "as TISSUE", "DISPLAY": "as TISSUE",
    **dict.fromkeys(
        ("PU", "PV", "NV", "HEADER", "SPANS_U", "SPANS_V", "CLOSED_U", "CLOSED_V", "POLE_LOW", "POLE_HIGH", "AT_BV",
         "AT_MU", "AT_MV", "AT_H"),
        "constants of a patch, packed into one array of variable length for the kernels",
    ),
    **dict.fromkeys(("BONE", "EPIDERMIS", "NAIL"), "label of a tissue, a key of dictionaries"),
}  # fmt: skip
"""Constants that address a table, with the reason."""


def numbered(tree):
    """Constants that are assigned from `range`."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Assign) and getattr(getattr(node.value, "func", None), "id", "") == "range":
            for target in node.targets:
                yield from (each.id for each in getattr(target, "elts", ()) if each.id.isupper())


def indices(tree):
    """Names within subscripts, without those of annotations."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Subscript):
            for each in ast.walk(node.slice):
                if isinstance(each, ast.Name):
                    yield each.id
                elif isinstance(each, ast.Attribute):
                    yield each.attr


def test_no_table_is_addressed_by_numbered_constants():
    files = [file for folder in FOLDERS for file in (ROOT / folder).rglob("*.py")]
    trees = [ast.parse(file.read_text(encoding="utf-8")) for file in files]
    assert len(trees) > 400
    constants = {name for tree in trees for name in numbered(tree)}
    used = {name for tree in trees for name in indices(tree)}
    assert constants & used == set(ALLOWED)
