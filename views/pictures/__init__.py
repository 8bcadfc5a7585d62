"""Pictures of a recording. Its message types determine which are drawn, independent of the graph.

draw(Path("runs/kidney.mcap"), Path("runs"))
"""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from palpate.messages import Contact, Surface
from palpate.physics.extras import missing
from palpate.records.reader import Recording
from palpate.views.errors import PictureError

if TYPE_CHECKING:
    from collections.abc import Callable

    from rich.console import Console


OF_A_FINGER = ("force", "compression", "friction", "device")  # one picture per finger
PICTURES = ("grip", *OF_A_FINGER, "texture", "energy", "slip", "pad", "pins", "softness", "afferents")


def draw(recording: Path, folder: Path, console: Console | None = None) -> list[Path]:
    """Draw the pictures of a recording into a folder; returns the files.

    console  shows progress, and one line with a remedy for each picture that could not be drawn

    RecordingError: not a recording. OSError: the folder cannot be written.
    """
    if importlib.util.find_spec("matplotlib") is None:
        _print(console, missing("no pictures", "matplotlib", "view"))
        return []
    from matplotlib import rc_context

    from palpate.views.pictures.style import LOOK

    with rc_context(LOOK), _progress(console) as step:
        return _draw(Recording(recording), folder, console, step)


def _draw(recording: Recording, folder: Path, console: Console | None, step: Callable[[str], None]) -> list[Path]:
    from palpate.views.pictures.deformation import Views
    from palpate.views.pictures.style import decimate, entitle
    from palpate.views.pictures.touch import TouchStreams

    touch = TouchStreams(recording)
    fingers = touch.fingers
    folder.mkdir(parents=True, exist_ok=True)
    made = []
    views = None
    step("reading")
    try:
        if importlib.util.find_spec("pyvista") is None:
            _print(console, missing("no 3-D picture", "pyvista", "view"))
        else:
            views = Views(touch)  # renders in parallel with the other pictures
            if text := views.bodies.left_out:
                _print(console, text)
    except PictureError as error:
        if touch.stream_of(Surface) is not None and touch.slip is None:  # otherwise no surface, or a pad
            _print(console, f"no picture of the surface: {error}")
    try:
        for name in PICTURES:
            step(name)
            picture = import_module(f"{__name__}.{name}")
            several = name in OF_A_FINGER and len(fingers) > 1
            for finger in fingers if several else fingers[:1]:
                drawing = picture.draw(finger)
                if drawing is None:
                    continue
                contact = finger.stream_of(Contact)
                if several:
                    entitle(drawing, f"{contact}: {drawing.get_suptitle()}")
                made.append(folder / f"{name}{f'-{contact}' if several else ''}.png")
                decimate(drawing)
                drawing.savefig(made[-1])
        step("deformation")
        if views is not None:
            try:
                drawing = views.draw()
            except PictureError as error:
                _print(console, str(error))
            else:
                made.insert(0, folder / "deformation.png")
                drawing.savefig(made[0])
    finally:
        if views is not None:
            views.close()
    names = [*(f"{name}.png" for name in ("deformation", *PICTURES)), *(f"{name}-*.png" for name in OF_A_FINGER)]
    if older := sorted({file.name for name in names for file in folder.glob(name)} - {file.name for file in made}):
        _print(console, f"older pictures in {folder}, not redrawn: {', '.join(older)}")
    return made


@contextmanager
def _progress(console: Console | None) -> Iterator[Callable[[str], None]]:
    """A progress bar that each call advances by one step."""
    if console is None or not console.is_terminal:
        yield lambda _: None
        return
    from rich.progress import BarColumn, Progress, TextColumn

    with Progress(
        TextColumn("pictures"), BarColumn(), TextColumn("{task.description}"), console=console, transient=True
    ) as bar:
        task = bar.add_task("", total=len(PICTURES) + 2, completed=-1)
        yield lambda name: bar.update(task, advance=1, description=name)


def _print(console: Console | None, text: str) -> None:
    if console is not None:
        from rich.text import Text

        console.print(Text(text, style="yellow"))
