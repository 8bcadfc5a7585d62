"""Each stream of a graph that runs as WebAssembly has the bytes of a run."""

from contextlib import contextmanager

import in_node
import numba
import pytest
from same_bytes import digests

import palpate
from palpate.compiler.kernel import kernel
from palpate.launch.load.arguments import describe_run
from palpate.physics.materials.hyperelastic import Material, place_of
from palpate.physics.materials.mooney_rivlin import strain_energy as mooney_rivlin
from palpate.web.errors import WebError
from palpate.web.started import started

BODIES = ("MassSpring", "ReducedFE", "BeamBundle", "Rigid")
GRAPHS = [
    *(("kidney", {"tissue": f"deformation.{body}"}) for body in BODIES),
    *((name, {}) for name in ("nodule", "texture", "pinch", "palpate-two", "organs", "neighbours", "fingertip")),
]
LEFT_OUT = {"nodule": {"band", "display"}}
SKIN = 1  # place of mooney_rivlin in the laws of the fingertip
WHOLE = 6.3  # [s] of the shipped runs


def compare(folder, graph, nodes, seconds):
    """The streams that both have, after the check that their bytes are equal, and what is known of the ticks."""
    launch = describe_run(graph, scene=None, duration=seconds, sets=[], nodes=nodes)
    with started(launch) as run:
        found = in_node.digests(folder, run, round(seconds * 1000))
        left = set(run.left_out)
    palpate.run(graph, record=folder / "native.mcap", duration=seconds, **nodes)
    native = digests(folder / "native.mcap")
    assert {name for name in native if name.partition(".")[0] not in left} == set(found["digests"])
    assert found["digests"] == {name: native[name] for name in found["digests"]} and found["failed"] is None
    return found


def test_a_short_touch_has_the_same_bytes(tmp_path):
    found = compare(tmp_path, "kidney", {}, 0.3)
    assert len(found["digests"]) == 9


@pytest.mark.long
@pytest.mark.parametrize(("graph", "nodes"), GRAPHS)
def test_a_whole_run_has_the_same_bytes(graph, nodes, tmp_path):
    assert compare(tmp_path, graph, nodes, WHOLE)["heap"] < 1 << 20


@pytest.mark.parametrize(
    ("graph", "why"),
    [("softness", "'sensor' .ForceSensor. runs in Python and is part of the loop"),
     ("fingertip-slide", "'hand' .Slide. runs in Python"),
     ("falcon", "'device' .Falcon. drives a device")],
)  # fmt: skip
def test_a_graph_with_a_node_that_is_not_compiled_is_refused_with_its_name(graph, why):
    launch = describe_run(graph, scene=None, duration=None, sets=[], nodes={})
    with pytest.raises(WebError, match=why), started(launch):
        pass


def fingertip(seconds):
    return describe_run("fingertip", scene=None, duration=seconds, sets=[], nodes={})


@contextmanager
def with_law(place, law):
    """A started run of the fingertip in which one of its laws is replaced. Runs of a process share the array."""
    with started(fingertip(0.7)) as run:
        tissue = next(slot.node for slot in run.segment.slots if slot.name == "tissue")
        laws = tissue._held["body.model.points.laws"]
        usual = laws.copy()
        laws[place] = place_of(law, Material(law, ()).name)
        try:
            yield run
        finally:
            laws[:] = usual


def test_laws_that_are_called_by_their_addresses_are_in_the_module(tmp_path):
    """The finger meets the fingertip after 0.48 s."""
    assert len(compare(tmp_path, "fingertip", {}, 0.7)["digests"]) == 9


@kernel(pointer=True)
def custom_law(F, J, p, P, A):
    return mooney_rivlin(F, J, p, P, A)


@kernel(pointer=True)
def softer_law(F, J, p, P, A):
    W, U, dU, ddU = mooney_rivlin(F, J, p, P, A)
    P *= 0.5
    A *= 0.5
    return 0.5 * W, 0.5 * U, 0.5 * dU, 0.5 * ddU


def test_custom_laws_are_in_the_module_and_called(tmp_path):
    found = []
    for law in (mooney_rivlin, custom_law, softer_law):
        with with_law(SKIN, law) as run:
            found.append(in_node.digests(tmp_path, run, 700)["digests"]["contact"])
    usual, custom, softer = found
    assert custom == usual and softer != usual


@numba.njit
def law_of_numba(F, J, p, P, A):
    return 0.0, 0.0, 0.0, 0.0


def test_a_law_that_is_no_kernel_is_refused_with_its_name(tmp_path):
    with (
        with_law(SKIN, law_of_numba) as run,
        pytest.raises(WebError, match=r"'tissue' .ReducedFE. calls the law '.*\.law_of_numba', which numba"),
    ):
        in_node.digests(tmp_path, run, 1)
