"""0.35 s of the kidney graph in one process, with the hand close to the surface at the start."""

from pathlib import Path
from typing import Any

from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.records.reader import Recording

QUICK = ("scene.surface.vertices=600", "scene.hand.begin=[0, 0, 0.107]")


def short_touch(folder: Path, name: str, *sets: str, **more: Any) -> Recording:
    """The recording of the touch with these overrides, `name`.mcap in the folder."""
    file = folder / f"{name}.mcap"
    outcome = execute(find("kidney").but(record=file, place="fused", duration=0.35, overrides=(*QUICK, *sets), **more))
    assert outcome.result.ok
    return Recording(file)
