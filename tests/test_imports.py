"""Who may import whom, room by room, and what each may import of others' packages."""

import ast
import re
import subprocess
import sys
import tomllib
from collections import Counter
from pathlib import Path

import nodes_for_runs
import pytest
from graphs_for_runs import write_graph
from sources import nodes

import palpate.cli
import palpate.compiler
import palpate.drivers
import palpate.engine
import palpate.gradients
import palpate.gym
import palpate.launch
import palpate.messages
import palpate.models.build
import palpate.models.fe
import palpate.models.fit
import palpate.nodes
import palpate.physics
import palpate.physics.extras
import palpate.records
import palpate.studies
import palpate.units
import palpate.views
import palpate.web

PACKAGES = (
    palpate.units,
    palpate.compiler,
    palpate.physics,
    palpate.drivers,
    palpate.models.build,
    palpate.models.fe,
    palpate.models.fit,
    palpate.messages,
    palpate.nodes,
    palpate.engine,
    palpate.gradients,
    palpate.gym,
    palpate.cli,
    palpate.launch,
    palpate.records,
    palpate.views,
    palpate.studies,
    palpate.web,
)
FOLDERS = {package.__name__.removeprefix("palpate."): Path(next(iter(package.__path__))) for package in PACKAGES}
GOLDEN = Path(__file__).parent / "golden" / "plane.mcap"
LINKS = Path(__file__).parent.parent / "src" / "palpate"
FOLDERS["models.scan"] = FOLDERS["models.fe"].parent / "scan"  # imports libraries of its extra: not imported here
GROUND = ("registry", "units", "physics.errors")
LOW = (*GROUND, "messages", "compiler", "physics", "records.format", "drivers", "nodes")
MIDDLE = (*LOW, "engine", "launch.load")
FOLDERS["models.files"] = FOLDERS["models.fe"].parent / "files"  # the same
MODELS = ("models.build", "models.fe", "models.files", "models.fit", "models.scan")
HIGH = (*MIDDLE, "launch.run", "records", *MODELS, "views")
MAY = {
    "registry": (),
    "physics.errors": (),
    "units": ("physics.errors",),
    "messages": ("registry",),
    "compiler": ("registry",),
    "physics": (*GROUND, "compiler"),
    "drivers": (*GROUND, "messages", "compiler", "physics"),
    "records.format": (*GROUND, "messages", "compiler", "physics"),
    "nodes": LOW,
    "models.files": (*GROUND, "compiler", "physics"),
    "models.fe": (*GROUND, "compiler", "physics", "models.files"),
    "models.scan": (*GROUND, "compiler", "physics"),
    "models.fit": (*LOW, "models.fe", "models.files"),
    "models.build": (*LOW, "models.fe"),
    "engine": LOW,
    "launch.load": (*LOW, "engine", "graphs"),
    "cli.machine": (*MIDDLE, "launch.run"),
    "launch.run": MIDDLE,
    "records": MIDDLE,
    "views": HIGH,
    "web": (*MIDDLE, "launch.run", "records", "views"),
    "bases": HIGH,
    "studies": (*HIGH, "bases", "gradients", "ensemble"),
    "launch": MIDDLE,
    "calling": (*MIDDLE, "launch.run", "records", "views", "bases"),
    "stepping": (*MIDDLE, "launch.run", "records", "bases"),
    "gradients": (*MIDDLE, "launch.run", "bases"),
    "ensemble": (*MIDDLE, "launch.run", "records", "bases", "gradients"),
    "gym": (*MIDDLE, "launch.run", "records", "stepping", "gradients"),
    "cli": (*HIGH, "launch", "cli.machine", "studies", "bases", "web"),
    "__init__": (*HIGH, "studies", "calling", "ensemble", "stepping"),
}
"""The rooms that each room may import, imports inside functions included. A room contains its folders except those
that are separate rooms. Only the command line imports commands."""
CORE = (*MIDDLE, "launch", "launch.run", "records", "graphs")  # what a touch needs; all other rooms are built on it
THEIRS = {
    "units": set(),
    "compiler": {"numpy", "scipy", "numba", "llvmlite"},
    "physics": {"numpy", "scipy", "numba"},
    "drivers": {"numpy", "msgspec"},
    "models.fe": {"numpy", "scipy", "numba"},
    "messages": {"numpy", "msgspec"},
}
OF_AN_EXTRA = {
    "organ.py": {"pytetwild", "fast_simplification"}, "files.py": {"meshio"}, "table_books.py": {"openpyxl"},
    "bridge.py": {"manifold3d"}, "solid.py": {"manifold3d"}, "centres.py": {"skimage"}, "isosurface.py": {"skimage"},
    "nifti.py": {"nibabel"}, "nrrd.py": {"nrrd"}, "dicom.py": {"pydicom"},
}  # fmt: skip
"""What a file of models.fe or physics imports when it is called, and asks for where it is missing."""
ROOTS = FOLDERS | {"": LINKS}
FILES = [(name, file) for name, folder in ROOTS.items() for file in sorted(folder.glob("**/*.py" if name else "*.py"))]


def imported(file):
    """Full names of all modules that a file imports, also inside functions."""
    for node in nodes(file):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file}:{node.lineno}: relative import"
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names if node.module.startswith("palpate"))


def module_of(name, file):
    """A file of a room as a module, named without the package."""
    return ".".join((*filter(None, [name]), *file.relative_to(ROOTS[name]).with_suffix("").parts))


def room(module):
    """The room that a module, named without the package, is part of."""
    while module not in MAY and "." in module:
        module = module.rpartition(".")[0]
    return module


@pytest.mark.parametrize("name", ROOTS)
def test_imports_go_one_way(name):
    wrong = []
    for file in (file for one, file in FILES if one == name):
        own = room(module_of(name, file))
        for module in imported(file):
            top, _, inner = module.partition(".")
            if top == "palpate":
                allowed = not inner or room(inner) in (own, *MAY[own])
            else:
                allowed = name not in THEIRS or top in {
                    *sys.stdlib_module_names, *THEIRS[name], *OF_AN_EXTRA.get(file.name, ()),
                }  # fmt: skip
                allowed &= top != "zmq" or own in ("cli.machine", "launch.run", "views")
                allowed &= name not in ("engine", "records") or top not in ("socket", "multiprocessing")
            if not allowed:
                wrong.append(f"{file}: {own} imports {module}")
    assert not wrong


def drawn():
    """The rooms and their imports as a graph, without arrows that a longer path implies."""
    arrows = {}
    for name, file in FILES:
        own = room(module_of(name, file))
        found = {room(module.partition(".")[2]) for module in imported(file) if module.startswith("palpate.")}
        arrows[own] = arrows.get(own, set()) | found & {*MAY, "graphs"} - {own}
    below = {}

    def reach(one):
        if one not in below:
            below[one] = arrows.get(one, set()) | {far for next in arrows.get(one, ()) for far in reach(next)}
        return below[one]

    lines = [
        f"    {one} --> {other}"
        for one in sorted(arrows)
        for other in sorted(arrows[one])
        if not any(other in reach(next) for next in arrows[one] - {other})
    ]
    names = {one: f'{one.replace(".", "_")}["{one}"]' for one in arrows if "." in one} | {"__init__": "palpate"}
    for one, name in names.items():
        lines = [re.sub(rf"(?<=[ ]){re.escape(one)}(?= |$)", name, line) for line in lines]
    return "\n".join(["graph TD", *lines])


def test_the_core_imports_nothing_that_is_built_on_it():
    for one in CORE:
        assert set(MAY.get(one, ())) <= set(CORE), one
    assert not [one for one, others in MAY.items() if "calling" in others and one != "__init__"]


def test_contributing_draws_the_imports():
    """Replace the drawing by what this test prints."""
    assert f"```mermaid\n{drawn()}\n```" in (LINKS.parents[1] / "CONTRIBUTING.md").read_text(encoding="utf-8"), drawn()


def needed(file, files):
    """Those of `files` that a file imports; of a package from which it takes a file, that file alone."""
    for node in nodes(file):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            names = [f"{node.module}.{alias.name}" for alias in node.names]
            names = [name if name in files else node.module for name in names]
        else:
            continue
        yield from (name for name in names if name in files)


def test_no_files_import_one_another_in_a_circle():
    """Imports inside functions, those for types, and `__init__.py` included."""
    files = {f"palpate.{module_of(name, file)}".removesuffix(".__init__"): file for name, file in FILES}
    needs = {module: set(needed(file, files)) for module, file in files.items()}
    while free := {module for module, others in needs.items() if not others}:
        needs = {module: others - free for module, others in needs.items() if module not in free}
    assert not needs, "in a circle, or above one"


def test_no_folder_has_more_than_twenty_files():
    files = Counter(file.parent for file in {file for _, file in FILES})
    assert {str(folder): count for folder, count in files.items() if count > 20} == {}


def test_the_wheel_holds_every_folder():
    """setuptools takes the packages that it finds in this folder: four folders of the top level are linked there, the
    others lie there, and none has lost its `__init__.py`."""
    linked = {path.name for path in LINKS.iterdir()} - {"__pycache__"}
    own = {file.name for file in LINKS.glob("*.py")} | {"py.typed"}
    assert linked == {*(name.partition(".")[0] for name in FOLDERS), "graphs"} | own
    assert {path.name for path in LINKS.iterdir() if path.is_symlink()} == {"messages", "nodes", "graphs", "launch"}
    for name, folder in FOLDERS.items():
        assert LINKS.joinpath(*name.split(".")).resolve() == folder.resolve()
        for file in folder.rglob("*.py"):
            assert (file.parent / "__init__.py").is_file(), f"{file}: in no package"


def test_a_folder_of_the_same_name_does_not_hide_the_package(tmp_path):
    """As the clone itself does in the folder above it, where a notebook is likely to lie."""
    clone = tmp_path / "palpate"
    for name in ("physics", "nodes", "src"):
        (clone / name).mkdir(parents=True)
        (clone / name / "__init__.py").touch()
    (clone / "README.md").touch()
    code = "import palpate; from palpate.physics.errors import PalpateError; print(palpate.run.__name__)"
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True)
    assert done.stdout.strip() == "run", done.stderr


SLOW = {"numba", "scipy", "pyvista", "zmq", "matplotlib"}
SLOWER = {"numpy", "msgspec", "mcap", "rich.markdown", "palpate.nodes", "palpate.engine", "palpate.records"}


@pytest.mark.parametrize("verb", ["--help", "list messages", "check --help", "list nodes --help", "new --help"])
def test_short_commands_do_not_import_what_is_slow(verb):
    code = (
        "import sys; from palpate.cli.__main__ import app\n"
        f"try: app({verb.split()!r})\n"
        "except SystemExit: pass\n"
        f"slow = {SLOW | SLOWER if verb == '--help' else SLOW}\n"
        "print('SLOW', sorted(slow & set(sys.modules)))"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert out.splitlines()[-1] == "SLOW []"


def test_a_check_of_a_recording_imports_no_socket_of_ours_and_no_process(tmp_path):
    """What a run, a replay and a test share is `engine`; the wire, the processes and the pictures are no part of it."""
    code = (
        "import sys; from palpate.records.player import plan_of; from palpate.records.reader import Recording\n"
        "from palpate.records.verify import verify\n"
        f"recording = Recording({str(GOLDEN)!r}); report = verify(recording, plan_of(recording)); assert report.ok\n"
        "print(*sys.modules)"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    loaded = out.splitlines()[-1].split()
    assert not {"zmq", "multiprocessing", "websockets", "matplotlib"}.intersection(loaded)
    ours = [module for module in loaded if module.startswith("palpate.")]
    assert not [module for module in ours if module.startswith(("palpate.launch.", "palpate.views"))]
    shared = [module for module in ours if module.startswith(("palpate.engine", "palpate.records"))]
    assert len(shared) <= 30, shared


def test_a_run_of_nodes_that_compile_nothing_imports_no_compiler(tmp_path):
    command = ["run", str(write_graph(tmp_path)), "--fused", "--no-record", "--duration", "0.01", "-q"]
    code = (
        f"import sys; sys.path.append({str(Path(nodes_for_runs.__file__).parent)!r})\n"
        f"from palpate.cli.__main__ import app\ntry: app({command})\nexcept SystemExit as end: print(end)\n"
        "print('SLOW', sorted({'numba', 'scipy.sparse', 'scipy.spatial', 'pyvista', 'matplotlib'} & set(sys.modules)))"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert "10 ticks" in out and out.splitlines()[-2:] == ["0", "SLOW []"], out


def test_reading_the_kidney_graph_neither_starts_the_compiler_nor_imports_what_is_slow_of_scipy():
    code = (
        "import sys; from palpate.launch.load.launchfile import find; find('kidney').plan(); print(*sys.modules)\n"
        "from palpate.compiler.kernel_cache import versions; print(versions.cache_info().misses)"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    slow = {f"scipy.{part}" for part in ("linalg", "ndimage", "optimize", "sparse", "spatial", "special")}
    started = "numba.np.linalg"  # numba imports its support of numpy when the first kernel is compiled or loaded
    *loaded, found = out.split()
    assert not {*slow, started}.intersection(loaded)
    assert found == "0"  # choosing the folder of the kernels reads the descriptions of three packages


def test_the_extras_are_those_of_the_installation():
    project = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    declared = {
        extra: {line.partition(">")[0].partition("[")[0] for line in lines if ";" not in line}
        for extra, lines in project["optional-dependencies"].items()
    }
    for extra, packages in palpate.physics.extras.EXTRAS.items():
        assert set(packages) == declared[extra]
    assert set(declared) == {*palpate.physics.extras.EXTRAS, "all", "dev"}
