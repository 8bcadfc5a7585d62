"""Which tests a run of the whole suite leaves out (tests/support/slow_tests.py)."""

import subprocess
import sys
from pathlib import Path

from changed import FOLDERS, covering_tests
from covering import ROOT, sources
from slow_tests import choose, read

END = "end of the run"


def test_slow_tests_are_listed_and_the_cheapest_of_each_file_stays():
    costs = {
        "a.py::fast": 0.1, "a.py::slow": 1.5, "a.py::slower": 9.0,
        "b.py::cases[1]": 2.0, "b.py::cases[2]": 0.2, "b.py::cases[3]": 1.0,
        "c.py::all[1]": 20.0, "c.py::all[2]": 30.0,
    }  # fmt: skip
    assert sorted(choose(costs, {}, {})) == ["a.py::slower", "b.py::cases[1]", "c.py::all"]


def test_a_fixture_is_shared_by_the_tests_that_stay():
    costs = {"a.py::with[1]": 4.0, "a.py::with[2]": 3.0, "a.py::last": 0.1, "a.py::without": 0.1}
    uses = {test: ["made"] for test in ("a.py::with[1]", "a.py::with[2]", "a.py::last")}
    assert sorted(choose(costs, {"made": 1.2}, uses)) == ["a.py::with"]
    assert sorted(choose(costs, {"made": 2.4}, uses)) == ["a.py::last", "a.py::with"]


def test_every_listed_file_exists():
    assert all((ROOT / name.split("::")[0]).is_file() for name in read())


def test_a_folder_is_run_without_and_a_file_with_its_slow_tests():
    whole = [name for name in sorted(read()) if "[" not in name]
    name = min(whole, key=lambda name: len(list((ROOT / name).parent.glob("test_*.py"))))  # in the smallest folder
    file, test = name.split("::")
    folder = str(Path(file).parent)

    runs = [[file], [folder, "--all"], [folder], [folder, "tests/test_imports.py"], ["--quick", file]]
    assert [name in found for found in collected(test, runs)] == [True, True, False, False, False]


def test_fast_checks_run_the_tests_of_what_changed():
    def run(*names):
        return covering_tests(Path(name) for name in names)

    assert {"tests/nodes/test_joint_node.py", "tests/test_imports.py"} <= {*run("nodes/contact/joint.py")}
    assert run("tests/units/test_quantity.py", "tests/units/test_that_was_removed.py") == [
        "tests/test_imports.py",
        "tests/units/test_quantity.py",
    ]
    assert "tests/whole/test_set_up.py" in run("check.sh"), "that names it"
    assert "tests/physics/bodies/test_sampled_taps.py" in run("tests/support/pressing.py"), "that imports it"
    assert run("README.md", "src/palpate/units/__init__.py"), "no test imports it"
    many = [str(file) for file in sources() if file.parts[0] == "nodes"]
    assert run(*many) == [*FOLDERS, "tests/test_imports.py"]
    assert all((ROOT / name).exists() for name in run(*many[:3], "check.sh"))


def collected(test, runs):
    """What runs that collect a test find, one after another in one process, which imports pytest once."""
    script = f"import sys, pytest\nfor given in {runs}:\n    pytest.main(['--collect-only', '-k', {test!r}, *given])\n"
    script += f"    print({END!r}, flush=True)"
    done = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=True)
    return [{line.partition("[")[0] for line in part.splitlines()} for part in done.stdout.split(END)[: len(runs)]]
