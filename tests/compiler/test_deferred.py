"""Kernels and intrinsics are handed to numba when they are first needed; commands that compute nothing do not import
it."""

import copy
import inspect
import os
import pickle
import subprocess
import sys
import threading

import numba
import numpy as np
import pytest
from numba.core.extending import _Intrinsic

from palpate.compiler.dot import cross, inner
from palpate.compiler.kernel import CompiledKernel, inlined, kernel
from palpate.compiler.memory import set_word
from palpate.compiler.target.deferred import DISPATCHER, Deferred, made, make_all
from palpate.compiler.target.dispatcher import KernelDispatcher

LIBRARIES = "{'numba', 'llvmlite'} & sys.modules.keys()"


def printed(*words, code="", **environment):
    """The output of Python in another process."""
    given = {name: value for name, value in os.environ.items() if name != "NUMBA_DISABLE_JIT"} | environment
    done = subprocess.run([sys.executable, "-c", code, *words], env=given, capture_output=True, text=True, timeout=300)
    assert not done.returncode, done.stderr
    return done.stdout.strip()


@pytest.mark.parametrize("words", ["check kidney", "check texture", "plan kidney", "--help", "list nodes"])
def test_a_command_that_computes_nothing_does_not_import_numba(words):
    code = (
        "import runpy, sys\n"
        "try:\n    runpy.run_module('palpate.cli', run_name='__main__')\n"
        f"except SystemExit as end:\n    print('ended', end.code, {LIBRARIES})"
    )
    assert printed(*words.split(), code=code).splitlines()[-1] in ("ended 0 set()", "ended None set()")


def test_questions_about_a_kernel_do_not_import_numba():
    code = (
        "import copy, inspect, sys, typing\nfrom palpate.compiler.dot import cross, inner\n"
        "assert not hasattr(cross, 'part') and not hasattr(cross, '__signature__') and callable(cross)\n"
        "repr(cross), repr(inner), cross.py_func, inspect.signature(cross), typing.get_type_hints(cross)\n"
        f"assert copy.deepcopy([cross])[0] is cross\nprint({LIBRARIES})"
    )
    assert printed(code=code) == "set()"


@pytest.mark.parametrize(("setting", "expected"), [("", "False"), ("0", "False"), ("1", "True"), ("00", "False")])
def test_without_numba_its_setting_is_read_as_numba_does(setting, expected, tmp_path):
    code = "from palpate.compiler import interpreted; print(interpreted.ENABLED)"
    own = "import numba; print(bool(numba.config.DISABLE_JIT))"
    assert printed(code=code, NUMBA_DISABLE_JIT=setting) == printed(code=own, NUMBA_DISABLE_JIT=setting) == expected


def test_a_file_of_numba_in_the_working_folder_disables_compilation(tmp_path):
    (tmp_path / ".numba_config.yaml").write_text("disable_jit: 1\n")
    code = (
        f"import os; os.chdir({str(tmp_path)!r})\nfrom palpate.compiler import interpreted; print(interpreted.ENABLED)"
    )
    assert printed(code=code) == "True"


def test_the_attributes_are_those_of_a_compiled_function():
    assert {name for name in dir(cross.made) if not name.startswith("_")} == DISPATCHER
    assert cross.targetoptions is cross.made.targetoptions and cross.py_func is cross.made.py_func
    with pytest.raises(AttributeError, match="CompiledKernel cross has no attribute 'colour'"):
        cross.colour  # noqa: B018


def test_the_second_call_goes_to_the_function_of_numba():
    @kernel
    def twice(x):
        return 2.0 * x

    assert twice.func == twice._first
    assert twice(3.0) == 6.0
    assert twice.func is twice.made and type(twice.made) is KernelDispatcher
    assert twice(4.0) == 8.0 and twice(x=5.0) == 10.0


def test_before_a_fork_all_functions_are_made():
    @kernel
    def twice(x):
        return 2.0 * x

    assert twice.func == twice._first
    make_all()
    assert twice.func is twice.made and cross.func is cross.made and type(set_word.func) is _Intrinsic


def test_all_threads_get_the_same_function():
    @kernel
    def twice(x):
        return 2.0 * x

    waiting, found = threading.Barrier(8), []

    def ask():
        waiting.wait()
        found.append(twice.made)

    threads = [threading.Thread(target=ask) for _ in range(8)]
    for each in threads:
        each.start()
    for each in threads:
        each.join()
    assert len(found) == 8 and all(each is twice.made is twice.func for each in found)


def test_a_kernel_is_pickled_by_its_name_and_copied_as_itself():
    assert pickle.loads(pickle.dumps(cross)) is cross
    assert copy.copy(cross) is copy.deepcopy({1: cross})[1] is cross
    code = f"import pickle; k = pickle.loads({pickle.dumps(cross)!r}); print(k((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)))"
    assert printed(code=code) == "(0.0, 0.0, 1.0)"

    @kernel
    def local(x):
        return x

    with pytest.raises((pickle.PicklingError, AttributeError), match="local"):
        pickle.dumps(local)


def test_a_kernel_describes_its_function():
    assert (cross.__name__, cross.__module__) == ("cross", "palpate.compiler.dot")
    assert cross.__doc__ == "p x q of two triples." and [*inspect.signature(cross).parameters] == ["p", "q"]
    assert repr(cross) == "CompiledKernel(palpate.compiler.dot.cross)"
    assert repr(set_word) == "Intrinsic(palpate.compiler.memory.set_word)"


def test_a_kernel_in_a_class_is_a_method():
    class Body:
        size = 3.0

        @kernel
        def scaled(x, y):
            return x * y

    assert isinstance(Body.scaled, CompiledKernel) and Body.scaled(2.0, 4.0) == 8.0
    assert Body().scaled.__self__.size == 3.0


def test_functions_of_njit_call_kernels_and_intrinsics():
    @numba.njit
    def of_user(a, b):
        return cross(a, b)[2] + inner(np.ones(20), np.ones(20))

    assert of_user((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)) == 21.0


def test_an_inlined_function_is_copied_into_its_callers():
    @inlined
    def square(x):
        return x * x

    @kernel
    def fourth(x):
        return square(x) * square(x)

    assert isinstance(square, Deferred) and fourth(3.0) == 81.0
    assert not made(square).signatures  # nothing was compiled for it


def test_a_kernel_is_an_argument_of_a_kernel():
    @kernel(pointer=True)
    def third(x):
        return x / 3.0

    @kernel
    def apply(function, x):
        return function(x)

    assert apply(third, 6.0) == 2.0
