"""The contacts of organs with each other over time: force, friction, patch and gap."""

import numpy as np
from matplotlib.figure import Figure

from palpate.engine.imports import full_name
from palpate.messages.contact import OrganContact
from palpate.views.pictures.style import FINGER, FRICTION, NORMAL, SPEED, TISSUE, figure, legend_above
from palpate.views.pictures.touch import TouchStreams

ORDER, OF_A_FINGER = 45, False

COLOURS = (NORMAL, TISSUE, FINGER, SPEED, FRICTION)


def draw_picture(touch: TouchStreams) -> Figure | None:
    """None unless organs touched in the recording."""
    streams = touch.recording.streams
    names = [name for name, s in streams.items() if str(s.schema["class"]) == full_name(OrganContact)]
    tables = touch.recording.tables(set(names), touch.read)
    found = [(name, tables[name]) for name in names if len(tables[name]["tick"]) and tables[name]["force"].any()]
    if not found:
        return None
    out = figure(11.5, 8.4, "How the organs touch each other: force, patch and gap")
    upper, middle, lower = out.subplots(3, 1, sharex=True, height_ratios=(3, 2, 2))
    for i, (name, table) in enumerate(found):
        time, colour = table["time"], COLOURS[i % len(COLOURS)]
        label = name.removeprefix("between-") if len(found) > 1 else "normal force"
        upper.plot(time, table["force"], color=colour, label=label)
        rubs = np.sqrt(np.sum(np.square(table["friction"]), axis=1))
        if rubs.any():
            dashed = {"color": colour, "linewidth": 1.0, "linestyle": (0, (4, 2))}
            upper.plot(time, rubs, label=f"{label}: friction" if len(found) > 1 else "friction", **dashed)
        middle.plot(time, table["area"] * 1e6, color=colour)
        lower.plot(time, table["gap"] * 1e3, color=colour)
    legend_above(upper)
    peak = max(float(table["force"].max()) for _, table in found)
    upper.set(title=f"at most {peak:.2f} N", ylabel="force [N]", ylim=(0.0, None))
    middle.set(ylabel="area of the patch [mm²]", ylim=(0.0, None))
    lower.axhline(0.0, color="#77777f", linewidth=0.8)
    lower.set_ylabel("smallest gap [mm]")
    touch.over_time(lower, found[0][1]["time"])
    return out
