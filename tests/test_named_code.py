"""Names of code that arrive from outside (job, recording, archive, YAML, command line) pass one gate each.

The table lists every place in the sources that imports, evaluates or unpickles something that is not written there,
with the reason why no name from outside chooses it. A new place fails until it has a reason.
"""

import ast
import subprocess
from pathlib import Path

import pytest
from sources import tree_of

from palpate.engine.faults import GraphError
from palpate.engine.imports import load_class, recorded_class
from palpate.engine.job import NodeJob, ObserverJob
from palpate.engine.plan import Plan
from palpate.engine.slot import NodeError, make
from palpate.launch.load.classes import ClassError, find_class
from palpate.messages import Message
from palpate.nodes.base import Node, Observer
from palpate.physics.materials.hyperelastic import MaterialError, law

ROOT = Path(__file__).parents[1]
FOLDERS = ("src/palpate", "messages", "nodes", "launch")
CALLS = {
    "import_module", "__import__", "locate", "run_path", "run_module", "spec_from_file_location", "exec_module",
    "exec", "eval", "compile_command", "loads", "load", "Unpickler", "CDLL", "PyDLL", "load_source", "resolve_name",
}  # fmt: skip
"""Functions that turn a name or data into code. Of `loads` and `load` only those of pickle and its relatives."""
PICKLES = {"pickle", "cloudpickle", "dill", "marshal", "shelve", "joblib"}

GATES = {
    "src/palpate/engine/imports.py": "the gate: `load_class` returns subclasses of a given class only",
    "launch/load/classes.py": "the gate of `use:`: a subclass of Node; files of the catalogue and entry points",
    "src/palpate/physics/materials/hyperelastic.py": "the gate of laws: compiled functions of loaded modules",
}
FIXED = {
    "src/palpate/__init__.py": "public names, from the table in this file",
    "src/palpate/__main__.py": "the command line, as a module",
    "src/palpate/gym/__init__.py": "public names, from the table in this file",
    "src/palpate/physics/__init__.py": "public names, from the table in this file",
    "src/palpate/registry.py": "files of a package of this installation, and entry points",
    "src/palpate/records/export/__init__.py": "a format of the table in this file",
    "src/palpate/drivers/errors.py": "packages of an extra, named by the drivers",
    "src/palpate/compiler/code_cache.py": "pickles that `trust` accepts",
    "src/palpate/compiler/target/intrinsic.py": "generators of this package, by names in its sources",
    "src/palpate/compiler/target/replaced.py": "replacements of the table in this file",
    "src/palpate/cli/machine/bytecode.py": "the modules of this installation",
    "src/palpate/cli/terminal/group.py": "commands, by their files",
    "src/palpate/cli/terminal/formatter.py": "typer, and two modules of rich from the table in this file",
    "src/palpate/models/files/apart.py": "a function of this package, named by the calling process",
    "src/palpate/cli/machine/kernels.py": "the modules of this installation",
    "src/palpate/cli/machine/diagnostics.py": "the C library of this process",
    "src/palpate/compiler/arithmetic.py": "the libraries that this process has loaded",
    "src/palpate/engine/clock.py": "the C library of this process",
    "launch/run/descendants.py": "the C library of this process",
    "launch/run/forkserver.py": "modules of the launcher that has started this process, through an unnamed socket",
    "launch/run/tasks/child.py": "tasks of the process that has started this one, through its unnamed pipes",
    "launch/run/tasks/spread.py": "results of an executor that the user has given",
    "messages/record.py": "functions made of the field names of a class",
    "messages/checks.py": "functions made of the field names of a class",
    "src/palpate/engine/slot.py": "a call made of numbers",
}


def sources():
    for folder in FOLDERS:
        for path in sorted((ROOT / folder).rglob("*.py")):
            name = path.relative_to(ROOT).as_posix()
            if not name.startswith(tuple(f"src/palpate/{link}/" for link in ("nodes", "messages", "launch", "graphs"))):
                yield name, tree_of(path)


def code_from_data(tree: ast.AST) -> set[str]:
    """The calls of `CALLS` in a file."""
    found = set()
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call):
            continue
        of = node.func.value if isinstance(node.func, ast.Attribute) else None
        name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
        module = getattr(of, "id", getattr(of, "attr", ""))
        if name in {"load", "loads"} and module not in PICKLES:
            name = (
                ""
                if not any(k.arg == "allow_pickle" and ast.unparse(k.value) != "False" for k in node.keywords)
                else name
            )
        if name == "exec_module" or name in CALLS:
            found.add(name)
    return found


def test_every_place_that_makes_code_of_data_is_listed_with_its_reason():
    found = {name: calls for name, tree in sources() if (calls := code_from_data(tree))}
    listed = {**GATES, **FIXED}
    assert not {name: calls for name, calls in found.items() if name not in listed}
    assert not listed.keys() - found.keys(), "no longer needed"


@pytest.mark.parametrize(
    "text",
    [
        "importlib.import_module(name)", "import_module(name)", "__import__(name)", "pydoc.locate(name)", "eval(name)",
        "exec(name)", "pickle.loads(data)", "pickle.load(file)", "np.load(file, allow_pickle=True)",
        "runpy.run_path(name)", "ctypes.CDLL(name)", "pkgutil.resolve_name(name)", "pickle.Unpickler(file)",
    ],
)  # fmt: skip
def test_the_check_sees_each_way(text):
    assert code_from_data(ast.parse(text))


def test_each_call_of_a_gate_states_the_class_that_it_expects():
    """`load_class(name)` alone would accept any object."""
    for name, tree in sources():
        for node in ast.walk(tree):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") in {"load_class", "recorded_class"}:
                assert len(node.args) == 2, f"{name}:{node.lineno}"


NAMES = [
    "subprocess.Popen", "subprocess.call", "os.system", "builtins.exec", "builtins.eval", "builtins.open",
    "palpate.registry.importlib", "palpate.registry.classes", "palpate.engine.slot.make",
    "palpate.nodes.base.Observer.of",
    "palpate.nodes.transport.Delay[subprocess.Popen]", "subprocess.Popen[palpate.messages.contact.Contact]",
    "Popen", "", ".", "..", "subprocess.", ".Popen", "a b.c", "palpate.nodes.base", "palpate.messages.Nothing",
]  # fmt: skip

GATE_CALLS = {
    "load_class, Node": lambda name: load_class(name, Node),
    "load_class, Observer": lambda name: load_class(name, Observer),
    "load_class, Message": lambda name: load_class(name, Message),
    "recorded_class": lambda name: recorded_class(name, Node),
    "use": find_class,
    "law": law,
    "job of a node": lambda name: make(NodeJob("a", name, {"args": ["touch", "ran"]}, 1, (), ())),
    "job of an observer": lambda name: make(ObserverJob("a", name, {"args": ["touch", "ran"]}, {})),
    "plan": lambda name: Plan.from_spec(_plan(name)),
}


def _plan(name: str) -> dict:
    node = {"name": "a", "use": name, "class": name, "settings": {}, "every": 1, "restart": False, "when": None,
            "off": None, "edges": [], "listen": None, "place": ["g", 1, 1]}  # fmt: skip
    return {"path": "g", "rate": 1.0, "scene": {}, "streams": None, "nodes": [node], "order": [], "skipped": {},
            "edges": {}, "wanted": {}, "observers": {}}  # fmt: skip


@pytest.mark.parametrize("gate", GATE_CALLS)
def test_no_gate_returns_or_calls_anything_else(gate, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    started: list[object] = []
    monkeypatch.setattr(subprocess.Popen, "__init__", lambda *given, **more: started.append(given))
    for name in NAMES:
        with pytest.raises((ImportError, AttributeError, NodeError, ClassError, MaterialError, GraphError)):
            GATE_CALLS[gate](name)
    assert not started and not list(tmp_path.iterdir())
