"""docs/release/release.py: rejected input, and a dry run of a whole release."""

import json
import os
import re
import subprocess
import sys
import tomllib
import zipfile
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[2]
SPEC = spec_from_file_location("release", ROOT / "docs" / "release" / "release.py")
release = module_from_spec(SPEC)
SPEC.loader.exec_module(release)


def test_the_notes_are_the_section_unreleased():
    assert release.notes("# C\n\n## [Unreleased]\n\n- new\n\n## [0.1.0] - 2026-01-01\n\n- old\n") == "- new"
    for text in ("# C\n\n## [0.1.0]\n", "# C\n\n## [Unreleased]\n\n## [0.1.0]\n- old\n"):
        with pytest.raises(SystemExit, match="Unreleased"):
            release.notes(text)


@pytest.mark.parametrize(
    ("version", "words"), [("0.2", "expected three"), ("0.0.9", "below"), ("0.1.5", "exists already")]
)
def test_an_invalid_version_is_an_error(version, words):
    with pytest.raises(SystemExit, match=words):
        release.check_version(version, "0.1.0", ["v0.1.5"])


def test_the_version_is_written_to_all_its_places(tmp_path):
    (tmp_path / "docs" / "release").mkdir(parents=True)
    for name in ("pyproject.toml", "CITATION.cff", "CHANGELOG.md", "docs/release/recipe.yaml", "docs/install.md"):
        (tmp_path / name).write_text((ROOT / name).read_text())
    release.write_version(tmp_path, "7.8.9")
    assert 'version = "7.8.9"' in (tmp_path / "pyproject.toml").read_text()
    assert re.search(r"^version: 7\.8\.9\ndate-released: \d", (tmp_path / "CITATION.cff").read_text(), re.MULTILINE)
    assert set(re.findall(r"palpate-([\d.]+)-py3", (tmp_path / "docs/install.md").read_text())) == {"7.8.9"}
    assert re.search(r"## \[Unreleased\]\n\n## \[7\.8\.9\] - \d{4}", (tmp_path / "CHANGELOG.md").read_text())


def test_a_wheel_without_graphs_is_an_error(tmp_path):
    wheel = tmp_path / "palpate-0.1.0-py3-none-any.whl"
    with zipfile.ZipFile(wheel, "w") as archive:
        for name in release.HOLDS[1:]:
            archive.writestr(name, "")
    with pytest.raises(SystemExit, match=release.HOLDS[0]):
        release.check_wheel(wheel, "0.1.0")


def test_a_wheel_for_one_python_without_kernels_is_an_error(tmp_path):
    wheel = tmp_path / "palpate-0.1.0-cp311-none-manylinux_2_17_x86_64.whl"
    with zipfile.ZipFile(wheel, "w") as archive:
        for name in release.HOLDS:
            archive.writestr(name, "")
    with pytest.raises(SystemExit, match=release.KERNELS):
        release.check_wheel(wheel, "0.1.0")


def test_the_release_looks_for_kernels_where_the_backend_writes_them():
    backend = (ROOT / "docs" / "release" / "backend.py").read_text()
    [shipped] = re.findall('^SHIPPED = "(.*)"$', backend, re.MULTILINE)
    assert f"{shipped}/kernels-" == release.KERNELS


LOAD = """
import palpate, palpate.graphs, palpate.launch, palpate.nodes
from palpate.messages import Contact
print(palpate.__file__, palpate.nodes.__file__, sep="\\n")
"""


def check_import(folder, *files):
    """The folder of palpate, first on the path, is imported; these files of it are used."""
    environment = {**os.environ, "PYTHONPATH": str(folder)}
    done = subprocess.run([sys.executable, "-c", LOAD], cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == [str((folder / file).resolve()) for file in files]


def clone_without_links(folder):
    """A clone as git makes it on Windows by default: a link is a text file that contains the path of its target."""
    subprocess.run(["git", "clone", "-q", "-c", "core.symlinks=false", str(ROOT), str(folder)], check=True)
    assert (folder / "src" / "palpate" / "nodes").read_text() == "../../nodes"
    return folder


def test_a_checkout_without_links_can_be_imported(tmp_path):
    clone = clone_without_links(tmp_path / "clone")
    check_import(clone / "src", "palpate/__init__.py", "../nodes/__init__.py")


@pytest.mark.long
@pytest.mark.timeout(900)
def test_a_tree_without_links_builds_the_same_files(tmp_path):
    linked, plain = tmp_path / "linked", clone_without_links(tmp_path / "plain")
    subprocess.run(["git", "clone", "-q", str(ROOT), str(linked)], check=True)
    contents = []
    for clone, forms in ((linked, ([],)), (plain, (["--sdist"], ["--wheel"]))):  # by default the sdist makes the wheel
        for form in forms:
            command = [sys.executable, "-m", "build", "-C", "kernels=no", *form]
            done = subprocess.run(command, cwd=clone, capture_output=True, text=True)
            assert done.returncode == 0, done.stderr
        assert not subprocess.run(["git", "status", "--porcelain"], cwd=clone, capture_output=True).stdout
        (clone / "sources").mkdir()
        [wheel], [sdist] = (clone / "dist").glob("*.whl"), (clone / "dist").glob("*.tar.gz")
        zipfile.ZipFile(wheel).extractall(clone / "wheel")
        subprocess.run(["tar", "xzf", sdist, "-C", clone / "sources"], check=True)
        [sources] = (clone / "sources").iterdir()
        check_import(clone / "wheel", "palpate/__init__.py", "palpate/nodes/__init__.py")
        check_import(sources / "src", "palpate/__init__.py", "palpate/nodes/__init__.py")
        shipped = [sources / name for name in ("src/palpate", "docs")]
        files = {str(file.relative_to(sources)) for folder in shipped for file in folder.rglob("*") if file.is_file()}
        contents.append(
            (set(zipfile.ZipFile(wheel).namelist()), files - {file for file in files if "__pycache__" in file})
        )
    assert contents[0] == contents[1]
    release.check_wheel(wheel, tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"])


def test_the_recipe_has_the_requirements_of_the_project():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    recipe = yaml.safe_load((ROOT / "docs" / "release" / "recipe.yaml").read_text())
    wanted = {one.replace(">=", " >=").lower() for one in project["dependencies"]}
    assert set(recipe["requirements"]["run"]) == wanted | {"python >=${{ python_min }}", "__linux"}
    assert f">={recipe['context']['python_min']}" == project["requires-python"]
    assert recipe["context"]["version"] == project["version"]


BACKEND = """
import backend
backend.build_meta.get_requires_for_build_wheel = lambda settings: ["setuptools>=77"]
assert backend.get_requires_for_build_wheel({"kernels": "no"}) == ["setuptools>=77"]
if backend._machine(None):
    assert any(one.startswith("numba") for one in backend.get_requires_for_build_wheel())
backend.sys.platform = "linux"
backend.os.environ.pop("PALPATE_NATIVE", None)
for machine, wanted, found in (
    ("x86_64", "yes", "x86_64"), ("aarch64", "yes", "aarch64"), ("riscv64", "yes", ""), ("x86_64", "no", ""),
    ("x86_64", "aarch64", "aarch64"), ("aarch64", "x86_64", "x86_64"),
):
    backend.platform.machine = lambda: machine
    assert backend._machine({"kernels": wanted}) == found, (machine, wanted)
    assert (len(backend.get_requires_for_build_wheel({"kernels": wanted})) > 1) == bool(found)
for system, wanted, words in (("linux", "arm", "found 'arm', expected yes, no, x86_64 or aarch64"),
                              ("darwin", "aarch64", "needs Linux")):
    backend.sys.platform = system
    try:
        backend.get_requires_for_build_wheel({"kernels": wanted})
    except SystemExit as error:
        assert words in str(error) and len(str(error).splitlines()) == 1
    else:
        raise AssertionError(wanted)
assert backend.get_requires_for_build_editable is backend.build_meta.get_requires_for_build_editable
"""


def test_the_backend_builds_kernels_only_for_the_wheel_and_if_wanted():
    """An editable installation needs setuptools alone, a wheel with kernels all dependencies. A separate process, since
    setuptools refuses to be imported where the standard library's distutils is loaded."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "docs" / "release")}
    command = [sys.executable, "-c", BACKEND]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


RENDER = """
import json, pathlib, sys
from rattler_build import Stage0Recipe
[one] = Stage0Recipe.from_yaml(pathlib.Path(sys.argv[1]).read_text()).render()
print(json.dumps(one.recipe.to_dict()))
"""


@pytest.mark.long
@pytest.mark.timeout(600)
def test_the_recipe_can_be_rendered(tmp_path):
    (tmp_path / "render.py").write_text(RENDER)
    uv = [
        Path(sys.executable).with_name("uv"),
        "run",
        "-q",
        "--no-project",
        "--with",
        "py-rattler-build>=0.73",
        "python",
    ]
    done = subprocess.run(
        [*uv, tmp_path / "render.py", ROOT / "docs" / "release" / "recipe.yaml"], capture_output=True, text=True
    )
    if "Failed to fetch" in done.stderr:
        pytest.skip("no package index here")
    assert done.returncode == 0, done.stderr
    rendered = json.loads(done.stdout)
    assert rendered["package"]["name"] == "palpate" and rendered["build"]["noarch"] == "python"
    assert "python >=3.11" in rendered["requirements"]["run"] and "python 3.11.*" in rendered["requirements"]["host"]


@pytest.mark.long
@pytest.mark.timeout(900)
def test_a_dry_run_builds_and_checks_and_changes_nothing(tmp_path):
    clone = tmp_path / "palpate"
    subprocess.run(["git", "clone", "-q", str(ROOT), str(clone)], check=True)
    command = [sys.executable, "docs/release/release.py", "99.0.0", "--dry-run", "--python"]
    done = subprocess.run(command, cwd=clone, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "palpate-99.0.0-py3-none-any.whl" in done.stdout and "would tag v99.0.0" in done.stdout
    assert not subprocess.run(["git", "status", "--porcelain"], cwd=clone, capture_output=True).stdout
    assert not subprocess.run(["git", "tag", "-l", "v99*"], cwd=clone, capture_output=True).stdout
