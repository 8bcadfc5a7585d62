"""The tests of what changed, for `./check.sh --fast`: python tests/changed.py

Prints the test files that cover the files which differ from the last commit, or which that commit changed if none does.
Those of a module are the ones that `tests/mutation.py` runs against its faults, at most 12; of another file those that
name it. If they are more than `MOST`, or without git, it prints the folders of formulas, messages, nodes and loading.
"""

import re
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

sys.path.append(str(Path(__file__).parent / "support"))
from covering import MOST as MOST_OF_A_FILE
from covering import ROOT, sources, tests_of

MOST = 40  # test files
ALWAYS = "tests/test_imports.py"
FOLDERS = ["tests/physics", "tests/messages", "tests/nodes", "tests/launch/load"]


def git(*words: str) -> list[str]:
    """Lines of the answer of a command of git."""
    done = subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=True)
    return done.stdout.splitlines()


def changed_files() -> list[Path]:
    """Files that differ from the last commit, or that this one changed."""
    found = git("diff", "--name-only", "HEAD") + git("ls-files", "--others", "--exclude-standard")
    return [Path(name) for name in found or git("diff", "--name-only", "HEAD~1", "HEAD")]


def that_name(file: Path) -> list[str]:
    """Test files that name a file, or import a module which is not in the package; the shortest first."""
    stem, name = re.escape(file.stem), re.escape(file.name)
    word = re.compile(rf"\b{name}\b" + (rf"|\b(from|import) {stem}\b" if file.suffix == ".py" else ""))
    found = [path for path in ROOT.glob("tests/**/test_*.py") if word.search(path.read_text(encoding="utf-8"))]
    found.sort(key=lambda path: path.stat().st_size)
    return [str(path.relative_to(ROOT)) for path in found[:MOST_OF_A_FILE]]


def covering_tests(files: Iterable[Path]) -> list[str]:
    """What to run after a change of these files, from the repository's root."""
    chosen = dict.fromkeys([ALWAYS])
    for file in files:
        if file.name.startswith("test_") and file.suffix == ".py":
            chosen |= dict.fromkeys([str(file)] if (ROOT / file).exists() else [])
        elif file in sources():
            chosen |= dict.fromkeys(tests_of(file))
        elif file.name != "__init__.py":
            chosen |= dict.fromkeys(that_name(file))
    return [*chosen] if len(chosen) <= MOST else [*FOLDERS, ALWAYS]


if __name__ == "__main__":
    try:
        print("\n".join(covering_tests(changed_files())))
    except (OSError, subprocess.CalledProcessError):  # not a clone, or one with a single commit
        print("\n".join([*FOLDERS, ALWAYS]))
