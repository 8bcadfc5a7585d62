"""Pictures of a recording. Its message types determine which are drawn, independent of the graph.

draw_pictures(Path("runs/kidney.mcap"), Path("runs"))

A picture is a file of this folder with three names; no list names it:

draw_picture  (TouchStreams) -> Figure, or None if the recording lacks what the picture shows
ORDER         [1] position among the pictures
OF_A_FINGER   whether each finger has its picture; otherwise the first finger, or all together
"""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

from palpate.messages import Contact, Slip, Surface
from palpate.physics.extras import missing
from palpate.records.reader import Recording
from palpate.registry import modules
from palpate.views.errors import PictureError
from palpate.views.pictures.style import decimate, entitle, look, save

if TYPE_CHECKING:
    from palpate.views.pictures.deformation import Views  # PyVista is slow to import
    from palpate.views.pictures.touch import TouchStreams


def pictures() -> dict[str, ModuleType]:
    """The files of this folder that are pictures, by name, in their order. It imports matplotlib."""
    found = {name: file for name, file in modules(sys.modules[__name__]).items() if hasattr(file, "ORDER")}
    return dict(sorted(found.items(), key=lambda one: (one[1].ORDER, one[0])))


def _ignore(*_: object) -> None:
    pass


def draw_pictures(
    recording: Path, folder: Path, warn: Callable[[str], object] = _ignore, done: Callable[..., object] = _ignore
) -> list[Path]:
    """Draw the pictures of a recording into a folder; returns the files.

    warn  receives a line with a remedy for each picture that could not be drawn
    done  receives the fraction done, and the name of the picture that is drawn now

    RecordingError: not a recording. OSError: the folder cannot be written.
    """
    if importlib.util.find_spec("matplotlib") is None:
        warn(missing("no pictures", "matplotlib", "view"))
        return []
    with look():
        return _draw_all(Recording(recording), folder, warn, done)


def _draw_all(
    recording: Recording, folder: Path, warn: Callable[[str], object], done: Callable[..., object]
) -> list[Path]:
    from palpate.views.pictures.touch import TouchStreams

    touch = TouchStreams(recording)
    folder.mkdir(parents=True, exist_ok=True)
    made, known = [], pictures()
    done(0.0, "reading")
    views = _start_views(touch, warn)  # renders in parallel with the other pictures
    try:
        for number, (name, picture) in enumerate(known.items(), 1):
            done(number / (len(known) + 2), name)
            made += _draw_each(name, picture, touch, folder)
        done(1.0 - 1.0 / (len(known) + 2), "deformation")
        if views is not None:
            try:
                drawing = views.draw_views()
            except PictureError as error:
                warn(str(error))
            else:
                made.insert(0, folder / "deformation.png")
                save(drawing, made[0])
    finally:
        if views is not None:
            views.close()
    names = [f"{name}.png" for name in ("deformation", *known)]
    names += [f"{name}-*.png" for name, picture in known.items() if picture.OF_A_FINGER]
    if older := sorted({file.name for name in names for file in folder.glob(name)} - {file.name for file in made}):
        warn(f"older pictures in {folder}, not redrawn: {', '.join(older)}")
    return made


def _start_views(touch: TouchStreams, warn: Callable[[str], object]) -> Views | None:
    """The 3-D picture of the surface, which is being rendered; None, with a line to `warn` where that is a fault."""
    from palpate.views.pictures.deformation import Views

    if importlib.util.find_spec("pyvista") is None:
        warn(missing("no 3-D picture", "pyvista", "view"))
        return None
    try:
        views = Views(touch)
    except PictureError as error:
        if touch.stream_of(Surface) is not None and touch[Slip] is None:  # otherwise no surface, or a pad
            warn(f"no picture of the surface: {error}")
        return None
    if text := views.bodies.left_out:
        warn(text)
    return views


def _draw_each(name: str, picture: ModuleType, touch: TouchStreams, folder: Path) -> list[Path]:
    """Draw a picture, once per finger if it shows one; returns the files."""
    made, fingers = [], touch.fingers
    several = picture.OF_A_FINGER and len(fingers) > 1
    for finger in fingers if several else fingers[:1]:
        drawing = picture.draw_picture(finger)
        if drawing is None:
            continue
        contact = finger.stream_of(Contact)
        if several:
            entitle(drawing, f"{contact}: {drawing.get_suptitle()}")
        made.append(folder / f"{name}{f'-{contact}' if several else ''}.png")
        decimate(drawing)
        save(drawing, made[-1])
    return made
