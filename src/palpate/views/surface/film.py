"""The deformed surface at one instant, or through time: pictures and films of a recording."""

from __future__ import annotations

import importlib.util
import subprocess
from collections.abc import Callable, Iterator
from contextlib import closing
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.messages import Surface
from palpate.physics.archive import replacing
from palpate.physics.extras import missing
from palpate.physics.writable import check_file
from palpate.records.reader import Recording
from palpate.views.errors import PictureError
from palpate.views.pictures.style import deformation_bar, look, save
from palpate.views.pictures.style import figure as blank
from palpate.views.pictures.touch import TouchStreams
from palpate.views.surface.colour import COLOURS, Colour, check, paint_vertices, top
from palpate.views.surface.moments import Instant, bodies_of, instants_at
from palpate.views.surface.off_screen import Rendering

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.figure import Figure

BATCH = 25  # instants rendered in one subprocess: with software rendering, more would take a minute without progress
ENDINGS = (".mp4", ".gif")
DPI = 100
QUICKEST = 50.0  # [1/s] frame rate of a GIF; browsers slow down faster ones


def picture(file: Path, at: float, target: Path, of: Colour = COLOURS["displacement"]) -> float:
    """Draw the surface at the recorded instant nearest to a time [s]; returns the instant's time [s]. `of`: the colour.

    RecordingError, PictureError, ArgumentError: the picture cannot be drawn.
    """
    _check_libraries("view", "matplotlib", "pyvista")
    touch = TouchStreams(Recording(file), whole=True)
    ticks, times = _recorded_ticks(touch)
    if not times[0] - 1e-9 <= at <= times[-1] + 1e-3:  # the last instant represents 1 ms
        raise PictureError(f"{file}: --at {at:g} s, but it was recorded from {times[0]:.3f} s to {times[-1]:.3f} s")
    tick = int(ticks[np.abs(times - at).argmin()])
    shown = bodies_of(touch)
    (instant,) = instants_at(touch, shown, [tick])
    check(of, [instant.surface], f"{file} at {instant.time:.3f} s")
    for frame in _frames(shown.mesh, [instant], of):
        target.parent.mkdir(parents=True, exist_ok=True)
        save(frame, target)
    return instant.time


def film(
    file: Path,
    target: Path,
    rate: float = 25.0,
    speed: float = 1.0,
    of: Colour = COLOURS["displacement"],
    warn: Callable[[str], object] = lambda text: None,
    done: Callable[[float], object] = lambda share: None,
) -> int:
    """Write a film of a recording; returns the number of frames.

    rate   [1/s] frame rate
    speed  [1] playback speed: 0.5 is slow motion
    of     colour of the surface
    warn   receives a line about bodies that are not shown
    done   receives the fraction of drawn frames

    RecordingError, PictureError, ArgumentError: the film cannot be drawn. OSError: the file cannot be written.
    """
    if target.suffix.lower() not in ENDINGS:
        raise PictureError(f"{target}: found {target.suffix or 'no ending'!r}, expected {' or '.join(ENDINGS)}")
    check_file(target)
    _check_libraries("film", "matplotlib", "pyvista", "imageio_ffmpeg", "PIL")
    touch = TouchStreams(Recording(file), whole=True)
    ticks, times = _recorded_ticks(touch)
    count = 1 + int((times[-1] - times[0]) * rate / speed)
    moments = times[0] + np.arange(count) * speed / rate
    chosen = ticks[np.minimum(np.searchsorted(times, moments - 1e-9), len(ticks) - 1)]
    shown = bodies_of(touch)
    if shown.left_out:
        warn(shown.left_out)
    by_time = instants_at(touch, shown, np.unique(chosen).tolist())
    check(of, [one.surface for one in by_time], str(file))
    rows = np.searchsorted(np.unique(chosen), chosen)
    done(0.0)
    with replacing(target) as part:
        frames = _frames(shown.mesh, [by_time[row] for row in rows], of)
        _write(part, frames, rate, lambda drawn: done(drawn / count))
    return count


def _frames(mesh: Any, instants: Sequence[Instant], of: Colour) -> Iterator[Figure]:
    """Surface, colour bar, time and force at each instant; the same figure each time."""
    most = top(of, max(float(paint_vertices(of, mesh, one.surface).max()) for one in instants))
    image: Any = None
    for begin in range(0, len(instants), BATCH):
        batch = instants[begin : begin + BATCH]
        values = [paint_vertices(of, mesh, one.surface) for one in batch]
        with closing(Rendering(mesh, batch, values, [], most, all_of=instants)) as rendering:
            wide = rendering.pixels()["wide"]
        for pixels, instant in zip(wide, batch, strict=True):
            with look():
                if image is None:
                    figure, image = _figure(of, most, pixels)
                image.set_data(pixels)
                image.axes.set_title(instant.title(), fontsize=12)
            yield figure


def _figure(of: Colour, most: float, pixels: np.ndarray) -> tuple[Figure, Any]:
    """A figure with the pixels and the colour bar, and the image in it."""
    figure = blank(7.68, 4.32, "")
    axes = figure.subplots()
    axes.set_axis_off()
    deformation_bar(figure, most * of.scale, of.label, ax=axes, shrink=0.7)
    return figure, axes.imshow(pixels)


def _write(target: Path, frames: Iterator[Figure], rate: float, done: Callable[[int], object]) -> None:
    """Write frames that share one figure, with matplotlib's writer for this file type; `done` receives the count."""
    from matplotlib import rc_context
    from matplotlib.animation import AbstractMovieWriter, FFMpegWriter, PillowWriter

    look: Any = {}
    fps: Any = rate  # matplotlib's type hints allow only int
    writer: AbstractMovieWriter
    if target.suffix.lower() == ".gif":
        writer = PillowWriter(fps=min(fps, QUICKEST))
    else:
        import imageio_ffmpeg

        look = {"animation.ffmpeg_path": imageio_ffmpeg.get_ffmpeg_exe()}
        writer = FFMpegWriter(fps=fps)
    first = next(frames)
    try:
        with rc_context(look), writer.saving(first, str(target), DPI):
            for number, _ in enumerate(chain([first], frames), 1):
                writer.grab_frame()
                done(number)
    except subprocess.CalledProcessError as error:
        stop = error.__context__
        if stop is not None and not isinstance(stop, Exception):  # Ctrl-C also ends ffmpeg
            raise stop from None
        raise PictureError(f"{target}: the film was not written, since ffmpeg ended with {error.returncode}") from None


def _recorded_ticks(touch: TouchStreams) -> tuple[np.ndarray, np.ndarray]:
    """Ticks and times [s] with both contact and surface. PictureError: no tick has both."""
    path = touch.recording.path
    stream = touch.stream_of(Surface)
    if stream is None:
        raise PictureError(
            f"{path}: no stream of surfaces in it, so there is no shape to draw; `palpate picture` draws numbers"
        )
    if touch.contact is None:
        raise PictureError(f"{path}: no contact was recorded")
    present = touch.recording.ticks()[stream]
    there = np.isin(touch.contact["tick"], present)
    if not there.any():
        raise PictureError(f"{path}: no surface was recorded")
    return touch.contact["tick"][there], touch.contact["time"][there]


def _check_libraries(extra: str, *modules: str) -> None:
    for module in modules:
        if importlib.util.find_spec(module) is None:
            raise PictureError(missing("a film" if extra == "film" else "a picture", module, extra))
