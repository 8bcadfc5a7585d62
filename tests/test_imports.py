"""Who may import whom: physics and messages nothing of ours, fe physics, nodes both first but never ZeroMQ."""

import ast
import subprocess
import sys
import tomllib
from importlib.metadata import requires
from pathlib import Path

import pytest

import palpate.bench
import palpate.drivers
import palpate.fe
import palpate.fit
import palpate.launch.loading.extras
import palpate.messages
import palpate.nodes
import palpate.physics

PACKAGES = (
    palpate.physics,
    palpate.bench,
    palpate.drivers,
    palpate.fe,
    palpate.fit,
    palpate.messages,
    palpate.nodes,
    palpate.launch,
)
FOLDERS = {package.__name__.rpartition(".")[2]: Path(next(iter(package.__path__))) for package in PACKAGES}
FOLDERS["scan"] = FOLDERS["physics"].parent / "scan"  # imports libraries of its extra, so it is not imported here
OURS = {
    "physics": {"physics"},
    "drivers": {"drivers", "messages", "physics"},
    "fe": {"fe", "physics"},
    "messages": {"messages"},
    "nodes": {"nodes", "drivers", "messages", "physics"},
    "scan": {"scan", "physics"},
    "bench": {"bench", "fe", "nodes", "messages", "physics"},
    "fit": {"fit", "nodes", "messages", "physics"},
    "launch": {"launch", "bench", "drivers", "nodes", "messages", "graphs", "scan", "fe", "fit", "physics"},
}
THEIRS = {
    "physics": {"numpy", "scipy", "numba"},
    "drivers": {"numpy", "msgspec"},
    "fe": {"numpy", "scipy", "numba"},
    "messages": {"numpy", "msgspec"},
}
OF_AN_EXTRA = {"tetwild.py": {"pytetwild"}, "read.py": {"meshio"}}
"""What a file of fe imports when it is called, and asks for where it is missing."""
FILES = [(name, file) for name, folder in FOLDERS.items() for file in sorted(folder.rglob("*.py"))]


def imported(file):
    """Full names of all modules that a file imports, inside functions, too."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file}:{node.lineno}: relative import"
            yield node.module
            if node.module == "palpate":
                yield from (f"palpate.{alias.name}" for alias in node.names)


@pytest.mark.parametrize(("name", "file"), FILES, ids=[str(f.relative_to(FOLDERS[n].parent)) for n, f in FILES])
def test_imports_go_one_way(name, file):
    for module in imported(file):
        top, _, rest = module.partition(".")
        if top == "palpate":
            assert not rest or rest.partition(".")[0] in OURS[name], f"{name} imports {module}"
        elif name in THEIRS and top not in sys.stdlib_module_names:
            assert top in THEIRS[name] | OF_AN_EXTRA.get(file.name, set()), f"{name} imports {module}"
        if name == "nodes":
            assert top != "zmq", "nodes import zmq"


def test_the_wheel_holds_every_folder():
    """setuptools takes only the packages that are listed."""
    project = tomllib.loads((Path(__file__).parent.parent / "pyproject.toml").read_text(encoding="utf-8"))
    listed = set(project["tool"]["setuptools"]["packages"])
    there = {
        ".".join(["palpate", name, *file.parent.relative_to(folder).parts])
        for name, folder in FOLDERS.items()
        for file in folder.rglob("*.py")
    }
    assert there <= listed, f"not in pyproject.toml: {', '.join(sorted(there - listed))}"


@pytest.mark.parametrize("verb", ["--help", "messages", "check --help", "nodes --help", "new --help"])
def test_short_commands_do_not_import_what_is_slow(verb):
    code = (
        "import sys; from palpate.launch.__main__ import app\n"
        f"try: app({verb.split()!r})\n"
        "except SystemExit: pass\n"
        "print('SLOW', sorted({'numba', 'scipy', 'pyvista', 'zmq', 'matplotlib'} & set(sys.modules)))"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert out.splitlines()[-1] == "SLOW []"


def test_the_extras_are_those_of_the_installation():
    declared = {}
    for line in requires("palpate") or []:
        requirement, _, extra = line.partition("; extra == ")
        if extra:
            name = requirement.partition(">")[0].partition("[")[0]
            declared.setdefault(extra.strip("\"'"), set()).add(name)
    for extra, packages in palpate.launch.loading.extras.EXTRAS.items():
        assert set(packages) == declared[extra]
    assert set(declared) == {*palpate.launch.loading.extras.EXTRAS, "all", "dev"}
