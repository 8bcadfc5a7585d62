"""palpate without its repository: the wheel in separate environments, with only its dependencies.

These tests install from the package index, and are skipped without one.
"""

import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import numpy as np
import phantom_finger
import polygon_files
import pytest
from trimesh import Trimesh

from palpate.nodes.base.surface import surface_mesh

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
EXTRAS = PROJECT["optional-dependencies"]
PAGE = (ROOT / "docs" / "install.md").read_text(encoding="utf-8")
TOOLS = Path(sys.executable).parent  # uv and pipx, of the extra `dev`
pytestmark = [pytest.mark.long, pytest.mark.timeout(1200)]
FRAME = "import palpate; print(palpate.open('touch.mcap').frame('contact').shape)"
GYM = """
import palpate.gym, gymnasium
env = gymnasium.make("palpate/FindNodule-v0")
env.reset()
env.step(env.action_space.sample())
"""
PURPOSE = {
    "devices": ["palpate run falcon --duration 0.1", "palpate run cartesian --duration 0.1"],
    "page": ["/usr/bin/timeout -s INT 8 palpate view touch.mcap --no-open"],
    "gym": [f"python -c {shlex.quote(GYM)}"],
    "learn": [f"python {shlex.quote(str(ROOT / 'docs' / 'examples' / 'find_nodule.py'))} --help"],
    "view": [
        "palpate picture touch.mcap contact.force",
        "palpate picture touch.mcap --at 0.35",
    ],
    "scan": ["palpate build fingertip images -o finger.npz"],
    "export": ["palpate export touch.mcap --to parquet"],
    "table": [f"python -c {shlex.quote(FRAME)}"],
    "film": ["palpate picture touch.mcap --film -o touch.gif", "palpate picture touch.mcap --film -o touch.mp4"],
    "mesh": ["palpate run kidney --organ notched.obj --unit mm --fused --no-pictures --duration 0.1"],
    "bench": [
        "palpate bench accuracy --quick --touch indent -o bench --method FElupe",
        "palpate bench accuracy --quick --touch indent -o bench --method MuJoCo",
    ],
    "feel": [
        "palpate run nodule --scene afferents --fused -q --no-pictures --duration 0.4 --record felt.mcap "
        "&& palpate export felt.mcap --to nwb",
    ],
    # The first run compiles, which may exceed the time limit of a point.
    "study": ["palpate run kidney --fused -q --no-record --duration 0.01 && palpate study kidney-stiffness"],
    "cluster": ["palpate study kidney-stiffness --scheduler tls://127.0.0.1:9"],
    "all": ["palpate doctor"],
}
"""Commands that need each extra. Without a device or a cluster the error shows that the package is installed."""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    subprocess.run(["git", "clone", "-q", str(ROOT), str(folder / "clone")], check=True)
    return build(folder, "-C", "kernels=no")


def build(folder, *words):
    """The wheel built from the clone in a folder."""
    command = [sys.executable, "-m", "build", "--wheel", *words, "--outdir", str(folder), str(folder / "clone")]
    built = subprocess.run(command, capture_output=True, text=True)
    if built.returncode:
        pytest.skip(f"cannot be built here: {built.stderr[-300:]}")
    return next(folder.glob("*.whl"))


def environment(folder, wheel, extra="", python=sys.executable, more=()):
    """An environment with the wheel, in `folder`."""
    pyenv = sorted(str(path) for path in Path.home().glob(".pyenv/versions/*/bin"))
    made = subprocess.run(
        [TOOLS / "uv", "venv", "-q", "--seed", "--python", python, folder], capture_output=True, text=True,
        env={**os.environ, "PATH": os.pathsep.join([os.environ["PATH"], *pyenv])},
    )  # fmt: skip
    if made.returncode:
        pytest.skip(f"no Python {python} here: {made.stderr.strip().splitlines()[-1]}")
    what = f"palpate{f'[{extra}]' if extra else ''} @ {wheel.as_uri()}"
    install = [TOOLS / "uv", "pip", "install", "-q", "--only-binary", ":all:", "--python", folder / "bin/python"]
    done = subprocess.run([*install, *more, what], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
    return folder


def call(env, folder, line):
    """Run a command with only the programs of its environment: no compiler, no git."""
    return subprocess.run(
        ["/bin/sh", "-c", line], cwd=folder, capture_output=True, text=True,
        env={"PATH": str(env / "bin"), "HOME": str(folder), "COLUMNS": "200"},
    )  # fmt: skip


def touches_a_kidney(env, folder):
    done = call(env, folder, "palpate run kidney --fused --duration 0.4 --record touch.mcap")
    assert done.returncode == 0, done.stdout + done.stderr
    checked = call(env, folder, "palpate replay touch.mcap --check")
    assert checked.returncode == 0, checked.stdout + checked.stderr
    return done.stdout + done.stderr


@pytest.fixture(scope="module")
def bare(wheel, tmp_path_factory):
    """An environment without extras, and a folder with a recording and a mesh [mm]."""
    folder = tmp_path_factory.mktemp("bare")
    env = environment(folder / "env", wheel)
    (folder / "empty").mkdir()
    printed = touches_a_kidney(env, folder / "empty")
    ball = surface_mesh("sphere", 600)
    Trimesh(1e3 * np.asarray(ball.vertices), ball.triangles).export(folder / "empty" / "ball.stl")
    notched = polygon_files.as_obj(*polygon_files.prism(polygon_files.L_SHAPE, 30.0))
    (folder / "empty" / "notched.obj").write_bytes(notched)
    return env, folder / "empty", printed


def test_a_run_in_an_empty_folder_works_and_explains_missing_pictures(bare):
    env, folder, printed = bare
    assert 'pip install "palpate[view]"' in printed
    assert call(env, folder, "palpate list tissues").returncode == 0


@pytest.mark.parametrize("extra", sorted(set(EXTRAS) - {"dev"}))
def test_each_extra_alone_suffices_for_its_commands(wheel, bare, tmp_path, extra):
    env = environment(tmp_path / "env", wheel, extra)
    folder = tmp_path / "empty"
    shutil.copytree(bare[1], folder, ignore=shutil.ignore_patterns(".*"))
    if extra == "scan":
        phantom_finger.write_dicom(phantom_finger.scan(), folder / "images")
    for line in PURPOSE[extra]:
        done = call(env, folder, line)
        printed = done.stdout + done.stderr
        assert "Traceback" not in printed, printed
        if extra == "all":
            short = re.findall(r"note +extra (\w+)", printed)
            assert set(short) <= {"bench"}, printed
        elif extra in ("devices", "cluster"):
            assert re.search("DeviceError|no certificates", printed) and "is not installed" not in printed, printed
        else:
            assert done.returncode in (0, 124) and "is not installed" not in printed, f"{line}\n{printed}"


@pytest.mark.parametrize("extra", sorted(set(EXTRAS) - {"dev", "all"}))
def test_a_missing_extra_is_an_error_of_one_line_with_a_remedy(bare, extra):
    env, folder, _ = bare
    for line in PURPOSE[extra]:
        done = call(env, folder, line)
        printed = done.stderr.strip().splitlines()
        lines = [text for text in printed if not text.startswith(("compiling", "start at once", "sub-"))]
        assert done.returncode, f"{line}\n{done.stdout}"
        if line.startswith("python"):  # a program prints a traceback; the line is its last
            lines = lines[-1:]
        assert len(lines) == 1, f"{line}\n{done.stderr}"
        assert re.search(rf'is not installed(, or too old)?; pip install "palpate\[{extra}\]"$', lines[0]), lines[0]
        named = re.search(r"([\w.-]+) is not installed", lines[0])[1].lower()
        assert named in {re.split(r"[ >=;\[]", one)[0].lower() for one in EXTRAS[extra]}, lines[0]


@pytest.mark.parametrize("python", ["3.12", "3.13", "3.14"])
def test_a_run_works_with_other_pythons(wheel, tmp_path, python):
    assert f"Programming Language :: Python :: {python}" in PROJECT["classifiers"]
    env = environment(tmp_path / "env", wheel, python=python)
    (tmp_path / "empty").mkdir()
    touches_a_kidney(env, tmp_path / "empty")


def test_the_oldest_permitted_versions_work(wheel, tmp_path):
    oldest = [re.sub(r">=(.*)", r"==\1.*", one) for one in PROJECT["dependencies"]]
    (tmp_path / "oldest.txt").write_text("\n".join(oldest))
    env = environment(tmp_path / "env", wheel, python="3.11", more=["-c", tmp_path / "oldest.txt"])
    (tmp_path / "empty").mkdir()
    touches_a_kidney(env, tmp_path / "empty")


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """An environment with the wheel that contains kernels, at another path and with other time stamps of its files."""
    folder = tmp_path_factory.mktemp("compiled")
    subprocess.run(["git", "clone", "-q", str(ROOT), str(folder / "clone")], check=True)
    wheel = build(folder)
    assert f"-cp{sys.version_info[0]}{sys.version_info[1]}-none-manylinux" in wheel.name
    env = environment(folder / "env", wheel)
    for file in (env / "lib").rglob("*"):
        os.utime(file, (1e9, 1e9), follow_symlinks=False)
    return env


EVERY = """
from pathlib import Path
from palpate.cli.machine.kernels import compile_all, shipped_launches
print(compile_all(lambda name, count: None, shipped_launches(), Path("."), nodes=True))
"""


def test_the_wheel_with_kernels_compiles_nothing(compiled, tmp_path):
    """For every shipped graph and body, in one process; and in processes, on both clocks."""
    count = call(compiled, tmp_path, f"NUMBA_CACHE_DIR={tmp_path}/cache python -c {shlex.quote(EVERY)}")
    assert count.returncode == 0, count.stderr
    assert count.stdout.splitlines()[-1] == "0"
    for words in (
        "",
        "--clock real",
        "--set tissue.use=deformation.ReducedFE",
        "--set tissue.use=deformation.BeamBundle",
    ):
        run = (
            f"NUMBA_CACHE_DIR={tmp_path}/cache palpate run kidney --no-pictures -q --no-record --duration 0.02 {words}"
        )
        done = call(compiled, tmp_path, run)
        assert done.returncode == 0, done.stderr
    assert not list((tmp_path / "cache").rglob("*.nbc"))


def test_the_wheel_for_arm_contains_the_same_kernels_for_that_processor(compiled, tmp_path):
    """`WHEEL=yes tests/arm64.sh` runs them under emulation."""
    subprocess.run(["git", "clone", "-q", str(ROOT), str(tmp_path / "clone")], check=True)
    wheel = build(tmp_path, "-C", "kernels=aarch64")
    python = f"cp{sys.version_info[0]}{sys.version_info[1]}"
    assert wheel.name.endswith(f"-{python}-none-manylinux_2_17_aarch64.whl")
    with zipfile.ZipFile(wheel) as archive:
        found = {name: archive.read(name) for name in archive.namelist() if name.endswith(".nbc")}
    here = {file.name: file.read_bytes() for file in compiled.rglob("*.nbc")}
    assert len(found) == len(here) > 80
    for files, number, other in ((found, b"\xb7", b"\x3e"), (here, b"\x3e", b"\xb7")):  # the machine in the head of ELF
        kinds = {content[at + 18 : at + 19] for content in files.values() for at in starts_of_objects(content)}
        assert number in kinds and other not in kinds
    kernels = [sorted(Path(name).name.partition("-")[0] for name in files) for files in (found, here)]
    assert kernels[0] == kernels[1] and not {Path(name).name for name in found} & here.keys()


def starts_of_objects(content):
    return [found.start() for found in re.finditer(rb"\x7fELF\x02\x01\x01", content)]


BLOCKS = re.findall(r"^```sh\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("block", [block for block in BLOCKS if "setup.sh" not in block])
def test_the_commands_of_the_page_on_installation_work(wheel, tmp_path, block):
    shutil.copy(wheel, tmp_path)
    (tmp_path / "tools").mkdir()
    for tool in ("uv", "uvx", "pipx"):
        (tmp_path / "tools" / tool).symlink_to(TOOLS / tool)
    cache = subprocess.run([TOOLS / "uv", "cache", "dir"], capture_output=True, text=True).stdout.strip()
    path = f"{tmp_path}/.local/bin:{tmp_path}/tools:/usr/bin:/bin"
    done = subprocess.run(
        ["sh", "-euc", block], cwd=tmp_path, capture_output=True, text=True,
        env={**os.environ, "PATH": path, "HOME": str(tmp_path), "UV_CACHE_DIR": cache, "COLUMNS": "200"},
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    assert list(tmp_path.rglob("force.png")), done.stdout + done.stderr


@pytest.mark.parametrize("extra", sorted(set(EXTRAS) - {"dev"}))
def test_the_page_describes_each_extra(extra):
    assert f"| `{extra}` |" in PAGE
