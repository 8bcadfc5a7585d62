"""A recording as the public door opens it: one that can show itself."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from palpate.records import compare, samples

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from palpate.views.page.server import PageServer


class Comparison(compare.Comparison):
    __doc__ = compare.Comparison.__doc__

    def plot(self) -> Figure:
        """Force and indentation of every variant over time, and their differences from the first."""
        from palpate.views.pictures.compare import drawn

        return drawn(self.variants)


class Run(samples.Run):
    __doc__ = samples.Run.__doc__

    def compare(self, *variants: Any, reference: Any = None) -> Comparison:
        return Comparison(super().compare(*variants, reference=reference).variants)

    compare.__doc__ = samples.Run.compare.__doc__

    def plot(self, *names: str, over: str | None = None) -> Figure:
        """Fields over time, or over another field: `plot("contact.force", over="contact.indentation")`. One axis each,
        in the look of all pictures. PictureError: what cannot be drawn, and why."""
        from palpate.views.pictures.plot import plot

        return plot(self, names, over)

    def view(self, *others: str | Path, port: int = 0, show: bool = True) -> PageServer:
        """The recording in the browser, at any time of it, beside another one if one is named; `palpate view` does the
        same from the shell. The page is there until it is closed, or the program ends.

        RecordingError: nothing to show in it. PalpateError: the page's package is missing, or its port taken.
        """
        from palpate.views.page import serve
        from palpate.views.page.reel import Reels

        page = serve(Reels([self.path, *map(Path, others)]), port)
        if show:
            import webbrowser

            webbrowser.open(page.address)
        return page
