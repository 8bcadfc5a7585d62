"""Bodies that a graph refuses are not offered by the page of `palpate build web`."""

from contextlib import ExitStack, contextmanager
from dataclasses import replace

import pytest

from palpate.engine.slot import NodeError
from palpate.launch.load.launchfile import find
from palpate.web import folder
from palpate.web.variants import Place, Variant

REFUSED = "deformation.MassSpring"


@pytest.fixture
def offered(monkeypatch):
    """Variants of two bodies, of which one does not start."""

    @contextmanager
    def started(launch):
        if REFUSED in launch.overrides:
            raise NodeError("between", "start", ValueError("exponent 1.5 is not linear"))
        yield launch

    monkeypatch.setattr(folder, "started", started)
    launch = find("neighbours")
    first = Variant(Place(launch), "deformation.ReducedFE", {}, None, launch, first=True)
    other = replace(first, body=REFUSED, launch=launch.but(overrides=(REFUSED,)), first=False)
    return [first, other, replace(other, case="stiff")]


def start(variants, wished=()):
    with ExitStack() as running:
        return folder._start(variants, wished, running, lambda share: None)


def test_the_others_are_offered_and_the_reason_is_returned(offered):
    runs, refused = start(offered)
    assert [variant.body for variant, _ in runs] == ["deformation.ReducedFE"]
    assert list(refused) == ["MassSpring"] and "exponent 1.5 is not linear" in refused["MassSpring"]


@pytest.mark.parametrize("wished", ["MassSpring", REFUSED])
def test_a_body_that_was_asked_for_is_an_error(offered, wished):
    with pytest.raises(NodeError, match="exponent"):
        start(offered, [wished])


def test_the_body_of_the_graph_is_an_error(offered):
    with pytest.raises(NodeError):
        start([replace(offered[1], first=True)])
