"""The Python blocks of the docs: each parses, what it imports exists, and the blocks of a page run in order."""

import ast
import importlib
from textwrap import dedent

import matplotlib
import pytest
from test_docs import ROOT, blocks, folder  # noqa: F401 - the folder with the files that the pages mention

import palpate

PYTHON = [(where, dedent(text)) for where, language, text in blocks() if language == "python"]
PARTS = {
    "docs/add_a_node.md": "excerpts of a file; tests/whole/test_docs.py compares its two complete nodes",
    "docs/your_organ.md": "the reader's mesh",
    "docs/effects.md": "an excerpt of a class",
}
"""Pages whose blocks do not run one after the other, and why."""
SMALLER = {"1_000_000": "20", "390, 200]": "390, 3]", "Executor(32)": "Executor(2)", "num_envs=256": "num_envs=4",
           "lanes=256": "lanes=4", "390, 256)": "390, 4)", "(256, 3)": "(4, 3)"}  # fmt: skip
"""Numbers of touches, environments and processes in the pages, and those of the test."""
IDS = [where for where, _ in PYTHON]


@pytest.mark.parametrize(("where", "text"), PYTHON, ids=IDS)
def test_a_block_parses_and_what_it_imports_exists(where, text):
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] == "palpate":
            module = importlib.import_module(node.module)
            for name in node.names:
                assert hasattr(module, name.name) or importlib.import_module(f"{node.module}.{name.name}"), name.name
        elif isinstance(node, ast.Import):
            for name in node.names:
                if name.name.partition(".")[0] == "palpate":
                    importlib.import_module(name.name)


@pytest.mark.parametrize(("where", "text"), PYTHON, ids=IDS)
def test_the_functions_of_palpate_that_a_block_calls_exist(where, text):
    """`palpate.run`, `palpate.Ensemble`: names of the public API."""
    used = {n.attr for n in ast.walk(ast.parse(text))
            if isinstance(n, ast.Attribute) and isinstance(n.value, ast.Name) and n.value.id == "palpate"}  # fmt: skip
    assert not [name for name in used if not hasattr(palpate, name)]


def runnable():
    """The pages whose blocks run in order, with their text."""
    pages: dict[str, list[str]] = {}
    for where, text in PYTHON:
        page = where.partition(":")[0]
        if page not in PARTS:
            pages.setdefault(page, []).append(text)
    return sorted(pages.items())


def smaller(text: str) -> str:
    for number, fewer in SMALLER.items():
        text = text.replace(number, fewer)
    return text


def test_every_reason_is_still_needed():
    assert all(any(number in text for _, text in PYTHON) for number in SMALLER)
    assert set(PARTS) <= {where.partition(":")[0] for where, _ in PYTHON}


@pytest.mark.long
@pytest.mark.timeout(1800)
@pytest.mark.parametrize(("page", "texts"), runnable(), ids=[page for page, _ in runnable()])
def test_the_blocks_of_a_page_run_in_order(folder, page, texts):  # noqa: F811
    """In one namespace, as a reader would type them, with fewer touches."""
    matplotlib.use("Agg")
    for name in ("touch.mcap", "run.mcap"):
        palpate.run("kidney", duration=0.05, record=name)
    names: dict[str, object] = {"__name__": "page"}
    for text in texts:
        exec(compile(smaller(text), str(ROOT / page), "exec"), names)


def test_the_first_example_of_ensembles_has_a_law_that_generates_no_energy():
    """A passive law needs viscous >= bristle_damping (mu_static - mu_slide)/mu_slide; the node notes it otherwise."""
    from palpate.launch.load.launchfile import find

    (text, *_) = [text for where, text in PYTHON if where.startswith("docs/ensembles.md")]
    calls = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Call)]
    (over,) = (keyword.value for call in calls for keyword in call.keywords if keyword.arg == "over")
    given = {key.value: value for key, value in zip(over.keys, over.values, strict=True)}
    slide = {key: value.value for key, value in given.items() if key.startswith("friction.")}
    launch = find("kidney").but(overrides=[f"{key}={value}" for key, value in slide.items()])
    node = launch.plan().make("friction")
    node.start()
    assert node.notes() == []
