"""Each stream of a graph that runs as WebAssembly has the bytes of a run."""

import in_node
import pytest
from same_bytes import digests

import palpate
from palpate.launch.load.arguments import describe_run
from palpate.web.errors import WebError
from palpate.web.started import started

BODIES = ("MassSpring", "ReducedFE", "BeamBundle", "Rigid")
GRAPHS = [
    *(("kidney", {"tissue": f"deformation.{body}"}) for body in BODIES),
    *((name, {}) for name in ("nodule", "texture", "pinch", "palpate-two", "organs", "neighbours")),
]
LEFT_OUT = {"nodule": {"band", "display"}}
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


def test_a_law_that_is_called_by_its_address_is_refused(tmp_path):
    launch = describe_run("fingertip", scene=None, duration=None, sets=[], nodes={})
    with pytest.raises(WebError, match=r"'tissue' .ReducedFE. calls the law 'neo_hooke' by its address"), \
            started(launch) as run:  # fmt: skip
        in_node.digests(tmp_path, run, 1)
