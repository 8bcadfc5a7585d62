"""A fingertip that is pressed, held, slid and lifted: forces over time, and the progress of slip."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from palpate.messages import Friction, Slip
from palpate.views.pictures.style import ENERGY, FINGER, FRICTION, INK, NORMAL, REGION_A, REGION_B, figure
from palpate.views.pictures.touch import Columns, TouchStreams, together

ORDER, OF_A_FINGER = 80, False

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

GROSS = "#f1c7c0"


class Phases(NamedTuple):
    """Rows of a slide: begin of friction, warning of incipient slip, gross slip, end of contact; None: absent."""

    begin: int | None
    warned: int | None
    gross: int | None
    end: int


def phases(normal: np.ndarray, friction: np.ndarray, incipient: np.ndarray, gross: np.ndarray) -> Phases:
    """The phases of the first slide; all arguments (n), forces in N."""
    touching = np.flatnonzero(normal > 0.0)
    end = int(touching[-1]) if len(touching) else len(normal) - 1
    rubbing = np.flatnonzero(friction > 1e-9)
    begin = int(rubbing[0]) if len(rubbing) else None

    def first(flag: np.ndarray) -> int | None:
        if begin is None:
            return None
        at = np.flatnonzero(flag[begin : end + 1])
        return begin + int(at[0]) if len(at) else None

    return Phases(begin, first(incipient), first(gross), end)


def slides(touch: TouchStreams) -> tuple[Columns, Columns, Columns, Phases] | None:
    """Contact, friction and slip at common ticks, and the phases; None if one is missing or nothing was touched."""
    every = touch.contact, touch[Friction], touch[Slip]
    if any(columns is None for columns in every):
        return None
    contact, friction, slip = together(*(columns for columns in every if columns is not None))
    if not (contact["force"] > 0.0).any():
        return None
    size = np.linalg.norm(friction["force"], axis=1)
    return contact, friction, slip, phases(contact["force"], size, slip["incipient"], slip["gross"])


def draw_picture(touch: TouchStreams) -> Figure | None:
    """None without a recorded Slip."""
    slide = slides(touch)
    if slide is None:
        return None
    contact, friction, slip, at = slide
    time, normal = contact["time"], contact["force"]
    size = np.linalg.norm(friction["force"], axis=1)
    slid = at.begin is not None
    out = figure(11.5, 8.6 if slid else 4.0, title(normal, contact["compression"], at))
    panels = out.subplots(3 if slid else 1, 1, sharex=True, squeeze=False, height_ratios=(3, 3, 2) if slid else None)
    upper, *others = panels[:, 0]
    upper.plot(time, normal, color=NORMAL)
    upper.set(ylabel="normal force [N]", title=_relaxation(normal, contact["compression"], at) + _flags(slip))
    deep = upper.twinx()
    deep.plot(time, np.maximum(contact["compression"], 0.0) * 1e3, color=FINGER, linestyle=(0, (4, 2)), linewidth=1.2)
    deep.set_ylabel("depth [mm]  (dashed)")
    deep.grid(visible=False)
    touch.over_time(panels[-1, 0], time)
    if not slid:
        return out
    middle, lower = others
    for axes in (upper, middle, lower):
        _shade(axes, time, at, named=axes is middle)
    mu = touch.settings(touch.stream_of(Slip)).get("friction")
    if isinstance(mu, float | int):
        middle.plot(time, mu * normal, color=NORMAL, linewidth=1.2, linestyle=":", label=f"{mu:g} × normal force")
    middle.plot(time, size, color=FRICTION, label="friction")
    middle.set_ylabel("friction force [N]")
    middle.set_title(_lead(time, size, at))
    middle.set_ylim(0.0, max(float(size.max()), 1e-6) * 1.35)
    middle.legend(loc="center right")
    lower.plot(time, slip["fraction"] * 100, color=ENERGY)
    front = lower.twinx()
    front.plot(time, slip["front"] * 1e3, color=INK, linestyle=(0, (4, 2)), linewidth=1.2)
    front.set_ylabel("stick radius [mm]\n(dashed)")
    front.grid(visible=False)
    lower.set(ylabel="sliding part of\nthe contact [%]", ylim=(-4, 104))
    return out


def title(normal: np.ndarray, depth: np.ndarray, at: Phases) -> str:
    """Title with the stages of the recording, from forces [N] (n) and depths [m] (n)."""
    stages = ["Press", "hold"] + (["slide"] if at.begin is not None else [])
    if not normal[-1] > 0.0:
        stages.append("lift")
    elif depth[-1] < 0.999 * depth.max():
        stages.append("unload")
    course = f"{', '.join(stages[:-1])} and {stages[-1]}"
    if normal[-1] > 0.0:
        return f"{course}: the recording ends in contact"
    return f"{course}: release of the contact" if at.begin is not None else course


def _shade(axes: Axes, time: np.ndarray, at: Phases, named: bool) -> None:
    ends = [at.begin, at.warned, at.gross, at.end]
    for i, (text, colour) in enumerate((("sticks", REGION_A), ("incipient", REGION_B), ("slides", GROSS))):
        begin = ends[i]
        end = next((e for e in ends[i + 1 :] if e is not None), at.end)
        if begin is not None and end > begin:
            axes.axvspan(time[begin], time[end], color=colour, linewidth=0)
            if not named:
                continue
            place = axes.get_xaxis_transform()
            axes.text((time[begin] + time[end]) / 2, 0.97, text, transform=place, ha="center", va="top", fontsize=10)


def _relaxation(normal: np.ndarray, depth: np.ndarray, at: Phases) -> str:
    """The force after the press, and after relaxation at the begin of the slide or the unloading."""
    pressed = int(np.argmax(depth >= depth.max() * (1 - 1e-9)))
    deep = np.flatnonzero(depth >= depth.max() * (1 - 1e-9))
    later = at.begin - 1 if at.begin is not None else int(deep[-1])
    if later <= pressed:
        return f"{normal.max():.2f} N at most"
    return f"{normal[pressed]:.2f} N when pressed {depth[pressed] * 1e3:.1f} mm deep, relaxed to {normal[later]:.2f} N"


def _flags(slip: Columns) -> str:
    """Warnings of the model about its limits."""
    warnings = ""
    if slip["deeper"].any():
        warnings += "; deeper than the meshed pad: force too small"
    if slip["limited"].any():
        warnings += f"; up to {slip['limited'].max()} beams at their strain limit"
    return warnings


def _lead(time: np.ndarray, size: np.ndarray, at: Phases) -> str:
    if at.begin is None or at.warned is None or at.gross is None:
        return f"at most {size.max():.2f} N"
    return (
        f"incipient slip {time[at.warned] - time[at.begin]:.2f} s after sliding begins, at {size[at.warned]:.2f} N; "
        f"gross slip {time[at.gross] - time[at.warned]:.2f} s later, at {size[at.gross]:.2f} N"
    )
