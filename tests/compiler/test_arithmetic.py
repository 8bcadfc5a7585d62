"""The instructions of palpate's programs are pinned in any environment, and in_force reports others."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from palpate.compiler.arithmetic import LEVEL, in_force, pinnable
from palpate.engine.provenance import rounding

FOREIGN = {"OPENBLAS_CORETYPE": "Prescott", "NPY_DISABLE_CPU_FEATURES": "X86_V3", "NUMBA_CPU_NAME": "nehalem"}
GOLDEN = Path(__file__).parents[1] / "golden"
NATIVE = {"PALPATE_NATIVE": "1"}
PINNED = ("OPENBLAS_CORETYPE", "NPY_DISABLE_CPU_FEATURES", "NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES")
FIRST = """
import json, os, sys

def report(event, arguments):
    if event == "import" and arguments[0].partition(".")[0] in ("numpy", "scipy", "numba", "llvmlite"):
        print(json.dumps([os.environ.get(name) for name in {}]), flush=True)
        os._exit(0)

sys.addaudithook(report)
{}
import numpy
"""
"""Prints the environment at the first import of a numerical library, and exits."""
ASK = "from palpate.compiler.arithmetic import in_force; import json, numpy, scipy.linalg; print(json.dumps({}))"

pytestmark = pytest.mark.skipif(not pinnable(), reason=f"this machine lacks instructions of {LEVEL}, or PALPATE_NATIVE")


def reported(code, **environment):
    """The output of a new interpreter as data; it starts without the pinned settings of this process."""
    clean = {name: value for name, value in os.environ.items() if name not in PINNED}
    done = subprocess.run([sys.executable, "-c", code], env=clean | environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_the_pin_takes_precedence_over_the_environment():
    code = "from palpate.compiler.arithmetic import pin; pin(); import numba; " + ASK.format("in_force()")
    assert reported(code, **FOREIGN)["instructions"] == LEVEL


def test_the_command_line_pins_before_it_loads_numerical_libraries():
    """The same pin is in force in this process, see `test_the_tests_are_pinned`."""
    command = "from palpate.cli.__main__ import main; sys.argv[1:] = ['check', 'kidney']; main()"
    assert reported(FIRST.format(PINNED, command), **FOREIGN) == [os.environ[name] for name in PINNED]


@pytest.mark.parametrize(
    "first", ["physics", "models.fe", "nodes", "engine", "records", "views", "launch.run.forkserver"]
)
def test_an_import_pins_nothing(first):
    assert reported(FIRST.format(PINNED, f"import palpate.{first}"), **FOREIGN) == [
        FOREIGN.get(name) for name in PINNED
    ]


def test_the_tests_are_pinned():
    assert in_force()["instructions"] == LEVEL


def test_a_process_that_imports_palpate_reports_its_arithmetic_and_not_the_workers():
    code = "import numpy; " + ASK.format("[in_force(), in_force(here=False)]")
    here, workers = reported(code, OPENBLAS_CORETYPE="Sandybridge")
    assert "OpenBLAS Sandybridge" in here["instructions"]
    assert workers["instructions"] == LEVEL
    assert rounding({"arithmetic": here}) == [f"instructions {here['instructions']}, here {LEVEL}"]


def test_kernels_are_pinned_for_any_numba_target_of_the_user(tmp_path):
    """The user's functions in the same process keep their target, and may call a kernel."""
    (tmp_path / "both.py").write_text("""
import json, numba
mine = numba.njit(lambda x: x + 1.0)
mine(1.0)
from palpate.compiler.arithmetic import in_force
from palpate.compiler.kernel import kernel
theirs = kernel(lambda x: x * 3.0 + 1.0)
theirs(1.0)
after = numba.njit(lambda x: theirs(x) - 1.0)
value = after(2.0)

def processor(function):
    return next(iter(function.overloads.values())).library.codegen.magic_tuple()[1]

print(json.dumps([value, in_force()["instructions"], *map(processor, (mine, theirs, after))]))
""")
    value, instructions, *processors = reported(
        f"import runpy; runpy.run_path({str(tmp_path / 'both.py')!r})", **FOREIGN
    )
    assert value == 6.0 and f"kernels {LEVEL}," in f"{instructions},"
    assert processors == ["nehalem", LEVEL, "nehalem"]


def test_the_user_may_leave_the_choice_to_the_processor():
    instructions = reported("import palpate.physics; " + ASK.format("in_force()"), **FOREIGN, **NATIVE)["instructions"]
    assert "numpy X86_V3" not in instructions and "kernels nehalem/" in instructions and instructions != LEVEL


def test_more_threads_of_linear_algebra_are_reported():
    instructions = reported("import palpate.physics; " + ASK.format("in_force()"), OPENBLAS_NUM_THREADS="2")[
        "instructions"
    ]
    assert instructions.endswith(f"threads {min(2, os.cpu_count())}") or os.cpu_count() == 1


def check(name, **environment):
    code = "import sys; from palpate.cli.__main__ import main; sys.argv[1:] = {!r}; main()"
    return reported(code.format(["replay", str(GOLDEN / f"{name}.mcap"), "--check", "--json"]), **environment)


@pytest.mark.parametrize("name", ["kidney", pytest.param("live", marks=pytest.mark.long)])
def test_a_golden_recording_is_reproduced_in_a_foreign_environment(name):
    """With pinned arithmetic the bytes are the same on every machine with the same versions."""
    report = check(name, **FOREIGN)
    assert report["ok"] and report["complete"]
    assert not any(each.startswith("instructions") for each in report["computed_otherwise"])
    assert report["tolerance"] == (1e-6 if report["computed_otherwise"] else 0.0)


@pytest.mark.parametrize("name", [pytest.param("kidney", marks=pytest.mark.long), "live"])
def test_other_instructions_stay_within_the_tolerance(name):
    """The kernels are those of x86-64-v3, which are already compiled; numpy and OpenBLAS use other instructions."""
    kernels = {"NUMBA_CPU_NAME": LEVEL, "NUMBA_CPU_FEATURES": ""}
    report = check(name, **FOREIGN | kernels | NATIVE)
    assert report["ok"] and report["complete"] and report["tolerance"] == 1e-6
    assert report["computed_otherwise"]
