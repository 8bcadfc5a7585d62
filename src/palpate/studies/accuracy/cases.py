"""The standard test cases as data: approach and position of a finger on a body over time."""

from dataclasses import dataclass

import numpy as np

from palpate.physics.errors import ArgumentError
from palpate.studies.peers.continuum import RADIUS

RETARDATION = 0.02  # [s] Of the viscous test cases: that of deformation.ReducedFE


@dataclass(frozen=True)
class BenchCase:
    """One test case.

    body         "half-space", "plate", "slab" or "kidney"; "organs": two bodies that touch, without a finger, whose
                 foundations approach each other
    finger       "ball": rigid, of radius `RADIUS`; "soft": the exponential fingertip of contact.Series
    knots        (time [s], approach [m], place [m]) ..., joined by half cosines, so the speed is continuous; the place
                 is x, or on the kidney the distance along its top, see `kidney.along`
    place        name of the stored reference or of a path of references (`accuracy.sites`); "": no stored curve
    meeting      name of the meeting of two organs (`meeting.solids`); "" without; without both: a closed form
    retardation  [s] Kelvin-Voigt retardation time of the slab
    friction     whether the finger slides with friction
    nodule       whether the slab has the nodule of `continuum` below (0, 0)
    sticks       whether the surface under the patch cannot slide
    """

    name: str
    title: str
    body: str
    finger: str
    knots: tuple[tuple[float, float, float], ...]
    place: str = ""
    retardation: float = 0.0
    friction: bool = False
    nodule: bool = False
    sticks: bool = True
    meeting: str = ""

    @property
    def duration(self) -> float:
        """Duration [s]."""
        return self.knots[-1][0]

    def at(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Approach [m], its rate [m/s], place [m] and its rate [m/s] at these times [s] (T,)."""
        knots = np.array(self.knots)
        k = np.clip(np.searchsorted(knots[:, 0], times, side="right") - 1, 0, len(knots) - 2)
        length = knots[k + 1, 0] - knots[k, 0]
        q = np.clip((times - knots[k, 0]) / length, 0.0, 1.0)
        share, speed = 0.5 - 0.5 * np.cos(np.pi * q), 0.5 * np.pi * np.sin(np.pi * q) / length
        change = knots[k + 1, 1:] - knots[k, 1:]
        place = knots[k, 1:] + change * share[:, None]
        rate = change * speed[:, None]
        return place[:, 0], rate[:, 0], place[:, 1], rate[:, 1]


TISSUE = ("slab", "kidney")
"""Bodies of the test cases on tissue: the patch of a fingertip on a soft body."""
APART = -1e-4
_PRESS = ((0.0, APART, 0.0), (0.3, 5.5e-3, 0.0))


def _place_knots(knots: tuple[tuple[float, float, float], ...], place: float) -> tuple[tuple[float, float, float], ...]:
    return tuple((t, e, x + place) for t, e, x in knots)


_PRESSED = (*_PRESS, (0.4, 5.5e-3, 0.0), (0.7, APART, 0.0))

TOUCHES: dict[str, BenchCase] = {
    touch.name: touch
    for touch in (
        BenchCase(
            "ball", f"a rigid ball of {1e3 * RADIUS:g} mm on a half-space", "half-space", "ball",
            ((0.0, APART, 0.0), (0.25, 5e-4, 0.0), (0.35, 5e-4, 0.0), (0.6, APART, 0.0)),
        ),
        BenchCase(
            "plate", "a fingertip on a rigid plate", "plate", "soft",
            ((0.0, APART, 0.0), (0.3, 2.4e-3, 0.0), (0.4, 2.4e-3, 0.0), (0.6, APART, 0.0)),
        ),
        BenchCase("indent", "a fingertip pressed into a slab", "slab", "soft", (*_PRESS, (0.4, 5.5e-3, 0.0)), "middle"),
        BenchCase(
            "hold", "pressed, held and released, viscous", "slab", "soft",
            ((0.0, APART, 0.0), (0.1, 5.5e-3, 0.0), (0.4, 5.5e-3, 0.0), (0.5, APART, 0.0), (0.6, APART, 0.0)),
            "middle", RETARDATION,
        ),
        BenchCase(
            "tap", "a tap of 30 ms, viscous", "slab", "soft",
            ((0.0, APART, 0.0), (0.015, 4e-3, 0.0), (0.03, APART, 0.0), (0.1, APART, 0.0)), "middle", RETARDATION,
        ),
        BenchCase(
            "two-step", "a path of two steps, viscous", "slab", "soft",
            ((0.0, APART, 0.0), (0.08, 3e-3, 0.0), (0.25, 3e-3, 0.0), (0.33, 5.5e-3, 0.0), (0.5, 5.5e-3, 0.0)),
            "middle", RETARDATION,
        ),
        BenchCase(
            "slip", "pressed lightly, free to slide under the patch", "slab", "soft",
            ((0.0, APART, 0.0), (0.3, 2e-3, 0.0), (0.4, 2e-3, 0.0), (0.7, APART, 0.0)), "slip", sticks=False,
        ),
        BenchCase(
            "slide", "pressed, then slid 10 mm with friction", "slab", "soft",
            ((0.0, APART, -5e-3), (0.2, 5e-3, -5e-3), (0.3, 5e-3, -5e-3), (0.6, 5e-3, 5e-3), (0.7, 5e-3, 5e-3)),
            "middle", friction=True,
        ),
        BenchCase("nodule-centre", "pressed over a nodule", "slab", "soft", _PRESSED, "nodule-00", nodule=True),
        BenchCase(
            "nodule-offset", "pressed 10 mm from a nodule", "slab", "soft", _place_knots(_PRESSED, 10e-3), "nodule-10",
            nodule=True,
        ),
        BenchCase(
            "stroke", "a stroke of 24 mm along the top of a kidney", "kidney", "soft",
            ((0.0, APART, -12e-3), (0.2, 5e-3, -12e-3), (0.3, 5e-3, -12e-3), (0.8, 5e-3, 12e-3), (0.9, 5e-3, 12e-3)),
            "kidney", friction=True,
        ),
        BenchCase(
            "organs", "two balls of tissue pressed together", "organs", "none",
            ((0.0, APART, 0.0), (0.3, 5.25e-3, 0.0), (0.4, 5.25e-3, 0.0), (0.7, APART, 0.0)), meeting="balls",
        ),
        BenchCase(
            "edge", "pressed 10 mm from the border of the slab", "slab", "soft", _place_knots(_PRESSED, 40e-3), "edge"),
    )
}  # fmt: skip


def choose_cases(names: list[str] | None) -> list[BenchCase]:
    """The test cases of these names, by default all. ArgumentError: an unknown name."""
    for name in names or ():
        if name not in TOUCHES:
            raise ArgumentError(f"touch: found {name!r}, expected one of {', '.join(TOUCHES)}")
    return [TOUCHES[name] for name in names] if names else list(TOUCHES.values())
