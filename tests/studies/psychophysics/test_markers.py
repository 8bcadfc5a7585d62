"""Events of an experiment on LSL, as the library receives them on this machine."""

import os
import time
import uuid

import pytest


@pytest.fixture(scope="module")
def pylsl(tmp_path_factory):
    """The library, told to stay on this machine."""
    config = tmp_path_factory.mktemp("lsl") / "lsl_api.cfg"
    config.write_text("[multicast]\nResolveScope = machine\n[log]\nlevel = -2\n")
    os.environ["LSLAPICFG"] = str(config)
    yield pytest.importorskip("pylsl", reason="pylsl is not installed", exc_type=ImportError)
    del os.environ["LSLAPICFG"]


def test_events_come_with_their_times(pylsl):
    from palpate.studies.psychophysics.session import markers

    task = f"t{uuid.uuid4().hex[:8]}"
    mark = markers(task, "01")
    (found,) = pylsl.resolve_byprop("name", f"palpate.{task}", timeout=60)
    inlet = pylsl.StreamInlet(found, recover=False)
    inlet.open_stream(timeout=60)
    mark("trial 1 interval 1 begin level 4000.0", time.monotonic() - 2.0)
    mark("trial 1 response first", None)
    now = pylsl.local_clock()
    (first,), early = inlet.pull_sample(timeout=60)
    (second,), late = inlet.pull_sample(timeout=60)
    assert (first, second) == ("trial 1 interval 1 begin level 4000.0", "trial 1 response first")
    assert early == pytest.approx(now - 2.0, abs=0.5) and late == pytest.approx(now, abs=0.5)
    assert inlet.info(timeout=60).desc().child_value("participant") == "01"
