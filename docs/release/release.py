"""Make a release: version, notes, build, check, tag.

    python docs/release/release.py 0.2.0 --dry-run    # all steps except commit and tag in this repository
    python docs/release/release.py 0.2.0

The script works in a clone, so that it builds the committed files. At the end it pulls commit and tag from the clone
and copies the files to upload to dist/. Needs the package `build` and network access.
"""

from __future__ import annotations

import argparse
import datetime
import re
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
UNRELEASED = "## [Unreleased]\n"
HOLDS = (
    "palpate/graphs/kidney.yaml",
    "palpate/graphs/scenes/kidney.yaml",
    "palpate/graphs/tissues/abdomen.yaml",
    "palpate/views/page/static/index.html",
    "palpate/nodes/deformation/bases/kidney-condensed.npz",
    "palpate/py.typed",
)
"""Required files of the wheel."""
KERNELS = "palpate/compiler/compiled/kernels-"
PYTHONS = ("3.11", "3.12", "3.13", "3.14")
"""Versions of Python with wheels that contain compiled kernels."""
MACHINES = ("x86_64", "aarch64")
"""Machines for which these wheels are; this one compiles the kernels of all."""


def notes(changelog: str) -> str:
    """The changes of the next release. SystemExit: no entries."""
    _, found, rest = changelog.partition(UNRELEASED)
    text = re.split(r"^## \[", rest, maxsplit=1, flags=re.MULTILINE)[0].strip()
    if not found or not text:
        raise SystemExit("CHANGELOG.md: no entries below '## [Unreleased]'; add the changes for users")
    return text


def check_version(version: str, now: str, tags: list[str]) -> None:
    """SystemExit: not a semver.org version, below the current one, or already tagged."""
    if not re.fullmatch(r"\d+\.\d+\.\d+", version):
        raise SystemExit(f"version: found {version!r}, expected three numbers such as 0.2.0")
    if f"v{version}" in tags:
        raise SystemExit(f"tag v{version} exists already")
    if tuple(map(int, version.split("."))) < tuple(map(int, now.split("."))):
        raise SystemExit(f"version: found {version}, which is below the current one, {now}")


def write_version(folder: Path, version: str) -> None:
    """Write the version to all files that contain it, and give the notes their heading."""
    today = datetime.date.today().isoformat()
    for name, pattern, new in (
        ("pyproject.toml", r'^version = ".*"$', f'version = "{version}"'),
        ("CITATION.cff", r"^version: .*$", f"version: {version}\ndate-released: {today}"),
        ("docs/release/recipe.yaml", r'^  version: ".*"$', f'  version: "{version}"'),
        ("docs/install.md", r"palpate-\d+\.\d+\.\d+-py3", f"palpate-{version}-py3"),
        ("CHANGELOG.md", r"^## \[Unreleased\]$", f"## [Unreleased]\n\n## [{version}] - {today}"),
    ):
        file = folder / name
        text, count = re.subn(pattern, new, file.read_text(encoding="utf-8"), flags=re.MULTILINE)
        if not count:
            raise SystemExit(f"{name}: no line like {pattern}")
        file.write_text(text, encoding="utf-8")


def check_wheel(wheel: Path, version: str) -> None:
    """SystemExit: a file is missing, or the version differs."""
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
    missing = [name for name in HOLDS if name not in names]
    if "manylinux" in wheel.name and not any(name.startswith(KERNELS) for name in names):
        missing.append(KERNELS)
    if missing or f"-{version}-" not in wheel.name:
        raise SystemExit(f"{wheel.name}: " + (f"without {', '.join(missing)}" if missing else f"expected {version}"))


def run(*command: str, folder: Path) -> str:
    """The output of a command. SystemExit: it failed."""
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{' '.join(command)}:\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
    return done.stdout


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("version")
    parser.add_argument("--dry-run", action="store_true")
    parser.add_argument("--python", nargs="*", default=PYTHONS, help="versions whose wheels contain compiled kernels")
    given = parser.parse_args()
    if run("git", "status", "--porcelain", "--untracked-files=no", folder=ROOT):
        raise SystemExit("uncommitted changes; `git status` lists them")
    now = re.search(r'^version = "(.*)"$', (ROOT / "pyproject.toml").read_text(encoding="utf-8"), re.MULTILINE)
    assert now is not None
    check_version(given.version, now[1], run("git", "tag", folder=ROOT).split())
    text = notes((ROOT / "CHANGELOG.md").read_text(encoding="utf-8"))
    with tempfile.TemporaryDirectory() as temporary:
        clone = Path(temporary) / "palpate"
        run("git", "clone", "-q", str(ROOT), str(clone), folder=ROOT)
        write_version(clone, given.version)
        run(sys.executable, "-m", "build", "-C", "kernels=no", folder=clone)
        for python in given.python:
            uv = [sys.executable, "-m", "uv", "build", "-q", "--wheel", "--python", python, "--out-dir", "dist"]
            for machine in MACHINES:
                run(*uv, "-C", f"kernels={machine}", folder=clone)
        files = sorted((clone / "dist").glob("palpate*"))
        for file in files:
            if file.suffix == ".whl":
                check_wheel(file, given.version)
        run("git", "commit", "-qam", f"Release {given.version}", folder=clone)
        run("git", "tag", "-a", f"v{given.version}", "-m", text, folder=clone)
        if not given.dry_run:
            run("git", "pull", "-q", "--ff-only", "--tags", str(clone), "HEAD", folder=ROOT)
            (ROOT / "dist").mkdir(exist_ok=True)
            for file in files:
                (ROOT / "dist" / file.name).write_bytes(file.read_bytes())
        print("\n".join(f"{file.name}, {file.stat().st_size / 1e6:.1f} MB" for file in files))
        print(f"{'would tag' if given.dry_run else 'tagged'} v{given.version}\n\n{text}")


if __name__ == "__main__":
    main()
