"""Kernels as plain Python functions (NUMBA_DISABLE_JIT=1), the way in for a debugger: the same bytes as compiled."""

import os
import subprocess
import sys

import numpy as np
import pytest
from mcap.reader import make_reader

from palpate.compiler import interpreted
from palpate.compiler.fields import record_type
from palpate.nodes.tactile.afferents import Afferents

SOFT = "scene.surface.surface=plane", "scene.surface.position=[0, 0, 0.105]", "scene.surface.vertices=400"
PRESSED = "scene.hand.begin=[0, 0, 0.1045]"


def messages(path, plain, graph, sets, duration=0.02):
    """Stream, time and bytes of each message of a fused run, with and without the compiler."""
    done = subprocess.run(
        [sys.executable, "-m", "palpate.cli", "run", graph, "--fused", f"--duration={duration}", "--record", path, "-q",
         "--no-pictures", *(f"--set={each}" for each in sets)],
        env=os.environ | {"NUMBA_DISABLE_JIT": "1" if plain else "0"}, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    with open(path, "rb") as file:
        return [(channel.topic, m.log_time, m.data) for _, channel, m in make_reader(file).iter_messages()]


def test_twenty_ticks_of_the_kidney_graph_in_plain_python_give_the_same_bytes(tmp_path):
    sets = (*SOFT, PRESSED)
    compiled, plain = (messages(tmp_path / f"{way}.mcap", way, "kidney", sets) for way in (False, True))
    assert len(compiled) == 9 * 20 and plain == compiled


@pytest.mark.long
@pytest.mark.parametrize("body", ["MassSpring", "BeamBundle", "ReducedFE", "Rigid"])
def test_each_body_in_plain_python_gives_the_same_bytes_on_the_kidney(tmp_path, body):
    sets = (f"tissue.use=deformation.{body}", "scene.hand.begin=[0, 0, 0.1075]")
    compiled, plain = (messages(tmp_path / f"{way}.mcap", way, "kidney", sets) for way in (False, True))
    assert plain == compiled


@pytest.mark.long
@pytest.mark.parametrize("graph", ["nodule", "pinch", "organs", "texture", "softness", "fingertip-slide", "fingertip"])
def test_each_graph_in_plain_python_gives_the_same_bytes(tmp_path, graph):
    compiled, plain = (messages(tmp_path / f"{way}.mcap", way, graph, ()) for way in (False, True))
    assert plain == compiled


def test_an_unknown_field_of_a_record_is_an_error_that_lists_its_fields():
    record = interpreted.Record(np.zeros((), [("force", "<f8", (3,)), ("group", [("size", "<i8")], (2,))]))
    record.group[1].size = 4
    record.force[2] += 1.5
    assert record.group[1].size == 4 and record.force.tolist() == [0.0, 0.0, 1.5] and len(record.group) == 2
    with pytest.raises(AttributeError, match=r"no field 'weight'.*'force', 'group'"):
        print(record.weight)


def test_a_field_that_records_of_numpy_hide_is_an_error_with_and_without_the_compiler():
    for name in ("mean", "size", "data", "item"):
        with pytest.raises(TypeError, match=rf"^State\['group'\]\['{name}'\]: .*such as '{name}_value'"):
            record_type("State", {"group": {name: ()}})
    with pytest.raises(TypeError, match=r"^Plain.State\['mean'\]"):
        type("Plain", (Afferents,), {"State": Afferents.State | {"mean": (3,)}})
    code = "from palpate.compiler.fields import record_type; record_type('State', {'mean': ()})"
    done = subprocess.run(
        [sys.executable, "-c", code], env=os.environ | {"NUMBA_DISABLE_JIT": "1"}, capture_output=True, text=True
    )
    assert "State['mean']: records of numpy have an attribute of this name" in done.stderr
