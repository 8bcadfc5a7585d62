"""Importing and running palpate does not change the state of the user's process."""

import json
import os
import subprocess
import sys

import pytest

IMPORTS = """
palpate palpate.physics palpate.compiler.kernel palpate.gym palpate.nodes palpate.nodes.deformation.reduced_fe
palpate.models.fe palpate.engine palpate.launch palpate.records palpate.views palpate.studies palpate.messages
"""
SCRIPT = """
import gc, importlib, json, locale, logging, os, signal, sys, threading, warnings
import matplotlib, numba, numpy as np, scipy.linalg, scipy.sparse, scipy.special  # the last sets a filter of warnings
import gymnasium

mine = numba.njit(lambda x: x + 1.0)
mine(1.0)
np.ones(500) @ np.ones(500)

def openblas():
    from palpate.compiler.arithmetic import _openblas
    return _openblas()

def snapshot():
    return {
        "environ": dict(os.environ),
        "signals": {str(n): repr(signal.getsignal(n)) for n in sorted(signal.valid_signals()) if n not in (9, 19)},
        "timer": signal.getitimer(signal.ITIMER_REAL),
        "openblas": openblas(),
        "numpy": np.show_config(mode="dicts")["SIMD Extensions"]["found"],
        "errors": np.geterr(),
        "printing": repr(np.get_printoptions()),
        "random": repr(np.random.get_state()),
        "numba": {n: repr(getattr(numba.config, n)) for n in dir(numba.config) if n.isupper()},
        "threads of numba": numba.get_num_threads(),
        "target": numba.core.registry.cpu_target.target_context.codegen().magic_tuple(),
        "gc": [gc.isenabled(), gc.get_threshold(), gc.get_freeze_count(), len(gc.callbacks)],
        "warnings": [repr(one) for one in warnings.filters],
        "locale": locale.setlocale(locale.LC_ALL),
        "logging": [logging.root.level, repr(logging.root.handlers), logging.root.manager.disable],
        "hooks": [repr(one) for one in (sys.excepthook, sys.unraisablehook, threading.excepthook, sys.displayhook)],
        "limits": [sys.getrecursionlimit(), sys.getswitchinterval(), os.getpriority(os.PRIO_PROCESS, 0)],
        "cores": sorted(os.sched_getaffinity(0)),
        "slack": open("/proc/self/timerslack_ns").read() if os.access("/proc/self/timerslack_ns", os.R_OK) else "",
        "folder": os.getcwd(),
        "path": sys.path,
        "matplotlib": matplotlib.get_backend(),
    }

import palpate.compiler.arithmetic  # reads the state of OpenBLAS, and does not import it
before = snapshot()
for name in NAMES:
    importlib.import_module(name)
after = snapshot()
palpate = sys.modules["palpate"]
run = palpate.run("kidney", duration=0.05, record="run.mcap")
float(run.contact.force.max())
for tick in palpate.steps("kidney", duration=0.01):
    pass
ran = snapshot()
mine = numba.njit(cache=True)(palpate.compiler.arithmetic._newer)  # a function in a file
changed = {k: [before[k], now[k]] for now in (after, ran) for k in before if repr(before[k]) != repr(now[k])}
print(json.dumps([changed, mine.stats.cache_path]))
"""


def host(tmp_path, **settings):
    pins = ("OPENBLAS", "OMP_", "MKL_", "NUMBA_", "NPY_")
    clean = {name: value for name, value in os.environ.items() if not name.startswith(pins)} | settings
    code = SCRIPT.replace("NAMES", repr(IMPORTS.split()))
    done = subprocess.run([sys.executable, "-c", code], env=clean, capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.long
def test_importing_and_running_palpate_changes_nothing_in_the_process(tmp_path):
    changed, _ = host(tmp_path)
    assert changed == {}


def test_functions_of_the_user_are_compiled_and_cached_as_without_palpate(tmp_path):
    """With numba's cache folder, and for the processor of the user's setting."""
    changed, folder = host(tmp_path, NUMBA_CPU_NAME="generic", NUMBA_CPU_FEATURES="", OMP_NUM_THREADS="2")
    assert changed == {} and "kernels-" not in folder
