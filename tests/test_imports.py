"""Who may import whom: physics and messages nothing of ours, models.fe physics, nodes both first but never ZeroMQ."""

import ast
import subprocess
import sys
from importlib.metadata import requires
from pathlib import Path

import pytest

import palpate.bench
import palpate.drivers
import palpate.engine
import palpate.launch.load.extras
import palpate.messages
import palpate.models.fe
import palpate.models.fit
import palpate.nodes
import palpate.physics
import palpate.records
import palpate.views

PACKAGES = (
    palpate.physics,
    palpate.bench,
    palpate.drivers,
    palpate.models.fe,
    palpate.models.fit,
    palpate.messages,
    palpate.nodes,
    palpate.engine,
    palpate.launch,
    palpate.records,
    palpate.views,
)
FOLDERS = {package.__name__.removeprefix("palpate."): Path(next(iter(package.__path__))) for package in PACKAGES}
LINKS = Path(__file__).parent.parent / "typings" / "palpate"
FOLDERS["models.scan"] = FOLDERS["models.fe"].parent / "scan"  # imports libraries of its extra: not imported here
OURS = {
    "physics": {"physics"},
    "drivers": {"drivers", "messages", "physics"},
    "models.fe": {"models.fe", "physics"},
    "models.scan": {"models.scan", "physics"},
    "models.fit": {"models.fit", "nodes", "messages", "physics"},
    "messages": {"messages"},
    "nodes": {"nodes", "records", "drivers", "messages", "physics"},
    "bench": {"bench", "models.fe", "nodes", "messages", "physics"},
    "engine": {"engine", "launch", "nodes", "messages", "physics"},
    "launch": {
        "launch",
        "engine",
        "records",
        "views",
        "bench",
        "drivers",
        "nodes",
        "messages",
        "graphs",
        "models",
        "physics",
    },
    "records": {"records", "launch", "engine", "views", "nodes", "messages", "physics"},
    "views": {"views", "models", "launch", "records", "engine", "nodes", "messages", "physics"},
}
THEIRS = {
    "physics": {"numpy", "scipy", "numba"},
    "drivers": {"numpy", "msgspec"},
    "models.fe": {"numpy", "scipy", "numba"},
    "messages": {"numpy", "msgspec"},
}
OF_AN_EXTRA = {"tetwild.py": {"pytetwild"}, "read.py": {"meshio"}}
"""What a file of models.fe imports when it is called, and asks for where it is missing."""
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


@pytest.mark.parametrize(("name", "file"), FILES, ids=[f"{n}/{f.relative_to(FOLDERS[n])}" for n, f in FILES])
def test_imports_go_one_way(name, file):
    for module in imported(file):
        top, _, rest = module.partition(".")
        if top == "palpate":
            assert not rest or any(f"{rest}.".startswith(f"{room}.") for room in OURS[name]), f"{name} imports {module}"
        elif name in THEIRS and top not in sys.stdlib_module_names:
            assert top in THEIRS[name] | OF_AN_EXTRA.get(file.name, set()), f"{name} imports {module}"
        if name == "nodes":
            assert top != "zmq", "nodes import zmq"


def test_the_wheel_holds_every_folder():
    """setuptools takes the packages that it finds in this folder: each folder is linked there, and none has lost its
    `__init__.py`."""
    linked = {path.name for path in LINKS.iterdir()} - {"__pycache__"}
    assert linked == {*(name.partition(".")[0] for name in FOLDERS), "graphs", "__init__.py", "py.typed"}
    for name, folder in FOLDERS.items():
        assert LINKS.joinpath(*name.split(".")).resolve() == folder.resolve()
        for file in folder.rglob("*.py"):
            assert (file.parent / "__init__.py").is_file(), f"{file}: in no package"


def test_a_folder_of_the_same_name_does_not_hide_the_package(tmp_path):
    """As the clone itself does in the folder above it, where a notebook is likely to lie."""
    clone = tmp_path / "palpate"
    for name in ("physics", "nodes", "public"):
        (clone / name).mkdir(parents=True)
        (clone / name / "__init__.py").touch()
    (clone / "README.md").touch()
    code = "import palpate; from palpate.physics.errors import PalpateError; print(palpate.run.__name__)"
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True)
    assert done.stdout.strip() == "run", done.stderr


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
    for extra, packages in palpate.launch.load.extras.EXTRAS.items():
        assert set(packages) == declared[extra]
    assert set(declared) == {*palpate.launch.load.extras.EXTRAS, "all", "dev"}
