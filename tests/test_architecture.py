"""The page of the architecture names files that exist, and functions and classes that they define."""

import ast
import re
from pathlib import Path

import pytest
from sources import tree_of

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
PATHS = ("tick", "message", "setting", "mesh")


def rows(text):
    """Files and names of each row of a table, with its first cell in bold; and the paths without a table."""
    for line in text.splitlines():
        cells = [cell.strip() for cell in re.split(r"(?<!\\)\|", line.strip("|"))] if line.startswith("| `") else []
        if cells:
            assert len(cells) == 3, line
            files, names = (re.findall(r"`([^`]+)`", cell) for cell in cells[:2])
            assert files and len(files) in (1, len(names)), line
            yield files, names


def defined(file):
    tree = tree_of(ROOT / file)
    return {node.name for node in tree.body if isinstance(node, ast.FunctionDef | ast.ClassDef)}


def faults(text):
    """What a page names and the sources lack."""
    found = []
    for files, names in rows(text):
        missing = [file for file in files if not (ROOT / file).is_file()]
        found += missing
        if not missing:
            of = [defined(file) for file in files]
            found += [f"{files}: {name}" for k, name in enumerate(names) if name not in of[min(k, len(of) - 1)]]
    return found


def test_each_row_names_a_file_and_what_it_defines():
    assert len(list(rows(PAGE))) >= 30
    assert not faults(PAGE)


def test_each_file_in_the_text_exists():
    files = [name for name in re.findall(r"`([\w./-]+\.py)`", PAGE) if "/" in name]
    assert len(files) > 30
    assert not [file for file in files if not (ROOT / file).is_file()]


def test_each_path_has_a_table_and_the_page_is_short():
    assert re.findall(r"\*\*(tick|message|setting|mesh)\*\*", PAGE) == list(PATHS)
    assert len(PAGE.splitlines()) <= 64


@pytest.mark.parametrize(
    "line",
    [
        "| `launch/run/execute.py` | `execute_all` | . |",
        "| `launch/run/executed.py` | `execute` | . |",
        "| `nodes/spread.py`, `nodes/collision.py` | `Kernel`, `Kernel` | . |",
    ],
)
def test_a_wrong_row_is_found(line):
    assert faults(line)


def test_the_rules_in_two_forms_name_what_exists():
    page = (ROOT / "docs" / "decisions" / "0021-two-forms.md").read_text(encoding="utf-8")
    files = {ROOT / name for name in re.findall(r"`([\w./-]+\.py)`", page)}
    assert len(files) >= 12 and all(file.is_file() for file in files), [f for f in files if not f.is_file()]
    text = "".join(file.read_text(encoding="utf-8") for file in files)
    names = {name.rpartition(".")[2] for name in re.findall(r"`([A-Za-z_][\w.]*)`", page) if not name.endswith(".py")}
    assert len(names) >= 20
    assert not [name for name in names if not re.search(rf"\b(def|class) {name}\b|^{name}\b", text, re.MULTILINE)]
