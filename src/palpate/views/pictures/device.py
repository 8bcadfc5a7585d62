"""The force on the hand: the controller's force and state, and the energy that the display absorbed."""

import numpy as np
from matplotlib.figure import Figure

from palpate.messages import Force, Pose
from palpate.views.pictures.style import (
    ENERGY,
    FINGER,
    INK,
    NORMAL,
    REGION_A,
    SPEED,
    figure,
    legend_above,
    mean,
    place_panels,
)
from palpate.views.pictures.touch import Columns, TouchStreams

ORDER, OF_A_FINGER = 50, True


def draw_picture(touch: TouchStreams) -> Figure | None:
    """None without a recorded force."""
    force = touch[Force]
    if force is None:
        return None
    time, size = force["time"], np.linalg.norm(force["force"], axis=1)
    out = figure(11.5, 6.4, "Force on the hand, and energy absorbed by the display", layout="none")
    upper, lower = out.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    place_panels(out, 2, 1, left=0.8)
    contact = force["state"] == "contact" if "state" in force else np.zeros(len(time), dtype=bool)
    for axes in (upper, lower):
        axes.fill_between(
            time, 0.0, 1.0, where=contact, transform=axes.get_xaxis_transform(), color=REGION_A, alpha=0.6, linewidth=0,
            step="post",
        )  # fmt: skip
    for i, (name, colour) in enumerate(zip("xyz", (FINGER, SPEED, NORMAL), strict=True)):
        upper.plot(time, force["force"][:, i], color=colour, alpha=0.2, linewidth=0.5)
        upper.plot(time, mean(force["force"][:, i], time), color=colour, linewidth=1.4, label=f"F{name}")
    upper.plot(time, mean(size, time), color=INK, linewidth=1.2, linestyle=(0, (4, 2)), label="|F|")
    upper.set_ylabel("force on the hand [N]")
    limit = touch.settings(touch.stream_of(Force)).get("limit")
    limit_text = f", device limit {limit:g} N" if isinstance(limit, float | int) else ""
    upper.set_title(f"largest {size.max():.2f} N{limit_text}; shaded: in contact")
    legend_above(upper)
    lower.axhline(0.0, color="#77777f", linewidth=0.8)
    energy = absorbed_energy(force, touch[Pose])
    if energy is None:
        energy, how = force["energy"], "absorbed since the last change of state, by the passivity observer"
    else:
        how = "absorbed energy, −∫ F·dx over the whole run, with F constant within a tick"
    lower.plot(time, energy * 1e3, color=ENERGY)
    lower.set_title(f"{how}; smallest value {round(energy.min() * 1e3, 2) + 0.0:.2f} mJ")
    lower.set_ylabel("energy [mJ]")
    touch.over_time(lower, time)
    return out


def absorbed_energy(force: Columns, pose: Columns | None) -> np.ndarray | None:
    """Energy [J] (n) that the display has absorbed up to each force, E_k = E_{k-1} - F_{k-1}·(x_k - x_{k-1}), from the
    forces without the delay that the controller's observer may assume. None without a pose at each tick."""
    if pose is None or not np.isin(force["tick"], pose["tick"]).all():
        return None
    place = pose["position"][np.searchsorted(pose["tick"], force["tick"])]
    work = np.einsum("ij,ij->i", force["force"][:-1], np.diff(place, axis=0))
    return np.concatenate([[0.0], -np.cumsum(work)])
