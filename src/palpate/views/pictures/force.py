"""Normal force over approach and indentation: hysteresis of loading, hold and unloading, the steps of a
bundle of beams, and the force band of a subject."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from palpate.messages import Contact, ForceBand, Pose, Slip
from palpate.views.pictures.style import FAINT, FINGER, INK, NORMAL, REGION_A, TISSUE, figure, mean, noise, place_panels
from palpate.views.pictures.touch import Columns, TouchStreams, millijoules, together, touches, work

ORDER, OF_A_FINGER = 20, True

NOTHING = 1e-4  # [1] indentation over approach below which a tissue counts as rigid
SPAN = 0.012  # [s] running mean of noisy samples: short compared with a press, long compared with the noise
RATE_SPAN = 0.04  # [s] of the running mean for rates
QUIET = 2e-3  # [1] noise over range below which samples are not smoothed
STILL = 4e-3  # [m/s] largest rate of a hold, in a noisy approach
SLOW = 0.2  # [1] the same as a fraction of the fastest rate; in a quiet approach as a fraction of the mean rate
LEAST_HOLD = 0.02  # [s] shorter holds are not marked
LEAST_STEP = 0.01  # [1] of the largest force; smaller steps of a bundle of beams are not reported
FIXED = 3e-3  # [m] largest extent of the foot points of a press; beyond it, the loop's area is no dissipated energy


def draw_picture(touch: TouchStreams) -> Figure | None:
    """None without a contact, or without depth or pose."""
    contact = touch.contact
    if contact is None or not (slices := touches(contact["time"], contact["force"])):
        return None
    # The depths over which the force is drawn, and the touch with the shortest lateral path.
    measured = not (contact["compression"] + contact["indentation"]).any()
    if measured:
        if (pose := touch[Pose]) is None:
            return None
        contact = _depths(contact, pose, slices)
    depths = _shown(contact, measured)
    foot: np.ndarray = contact["foot"]
    ways = [float(np.linalg.norm(np.diff(foot[part], axis=0), axis=1).sum()) for part in slices]
    chosen = slices[ways.index(min(ways))]
    moved = float(np.linalg.norm(np.ptp(foot[chosen], axis=0)))
    at_one_place = moved <= FIXED
    slid = "" if at_one_place else f"  (the finger moved {1e3 * moved:.0f} mm along the surface)"
    # One panel per depth, with the loop of the chosen touch over the other touches.
    sent = touch[ForceBand]
    band = [] if sent is None else together(sent, contact)
    if band and not (band[0]["mean"] > 0.0).any():
        band = []
    count = len(depths) + bool(band)
    out = figure((8.0, 11.5, 13.2)[count - 1], 5.2, f"Normal force during loading and unloading{slid}", layout="none")
    every = out.subplots(1, count, sharey=True, squeeze=False)[0]
    place_panels(out, 1, count, across=0.4 if not band else 0.65)
    left = every[0]
    for axes, (whose, depth, label) in zip(every, depths, strict=False):
        for other in slices:
            if other is not chosen:
                smooth = smooth_force(contact["force"][other], contact["time"][other])
                axes.plot(depth[other] * 1e3, smooth, color=FAINT, linewidth=1.0, label="other touches")
        _loop(axes, depth[chosen], contact["force"][chosen], contact["time"][chosen])
        # The area of the loop is dissipated energy only where the stiffness stays the same.
        loop = millijoules(work(depth[chosen], contact["force"][chosen]))
        title = f"{whose}: {loop} dissipated" if at_one_place else whose
        axes.set(xlabel=label, title=title, xlim=(0.0, None), ylim=(0.0, None))
        axes.locator_params(axis="x", nbins=6)
    if not measured and depths[0][1] is contact["compression"]:
        _limit(left, touch, depths[0][1])
    left.set_ylabel("normal force [N]")
    handles, labels = left.get_legend_handles_labels()
    unique = dict(zip(labels, handles, strict=True))
    left.legend(unique.values(), unique.keys(), loc="upper left")
    if step := largest_step(touch, contact["force"].max()):
        text = f"steps of up to {1e3 * step:.0f} mN: a beam that comes into contact\nadds its viscous force at once"
        left.text(0.03, 0.66, text, transform=left.transAxes, fontsize=9)
    # Last panel: the force band of the measured subject.
    if band:
        _band(every[-1], band, touch.settings(touch.stream_of(ForceBand)).get("depth", "compression"))
    return out


def _shown(contact: Columns, measured: bool) -> list[tuple[str, np.ndarray, str]]:
    """The depths [m] (n,) over which the force is drawn: whose they are, values and label."""
    approach = contact["compression"] + contact["indentation"]
    if measured:
        return [("the sample", contact["indentation"], "depth of the probe from where it touched  [mm]")]
    if contact["indentation"].max() < NOTHING * approach.max():
        return [("the fingertip", contact["compression"], "compression of the fingertip  s1  [mm]")]
    return [
        ("finger and tissue in series", approach, "approach  e = s1 + s2  [mm]"),
        ("the tissue alone", contact["indentation"], "indentation of the tissue  s2  [mm]"),
    ]


def _depths(contact: Columns, pose: Columns, slices: list[slice]) -> Columns:
    """The contact of a force sensor with the depth of the probe: its motion against the normal since the start of each
    touch."""
    place = [np.interp(contact["time"], pose["time"], x) for x in pose["position"].T]
    way = -np.einsum("in,ni->n", place, contact["normal"])
    depth = np.zeros(len(way))
    for part in slices:
        depth[part] = np.maximum(way[part] - way[part.start], 0.0)
    return contact | {"indentation": depth}


def _band(axes: Axes, both: list[Columns], depth: str) -> None:
    """The force band of the measured subject, and the force of this run."""
    band, contact = both
    order = np.argsort(contact[depth], kind="stable")
    order = order[band["mean"][order] > 0.0]
    way = contact[depth][order] * 1e3
    levels, quantiles = band["levels"][0], band["quantiles"][order]
    if len(levels) > 1:
        low, high = int(np.argmin(levels)), int(np.argmax(levels))
        text = f"{100 * (levels[high] - levels[low]):.0f} % of its forces"
        axes.fill_between(way, quantiles[:, low], quantiles[:, high], color=REGION_A, linewidth=0, label=text)
    axes.plot(way, band["mean"][order], color=NORMAL, label="measured subject, mean")
    axes.plot(way, contact["force"][order], ".", color=TISSUE, markersize=3, label="this run")
    beyond = ~band["valid"][order]
    if beyond.any():
        axes.axvspan(way[beyond].min(), way.max(), color=FAINT, alpha=0.4, linewidth=0, label="deeper than measured")
    whose = "fingertip  s1" if depth == "compression" else "tissue  s2"
    axes.set(xlabel=f"{depth} of the {whose}  [mm]", title="with the band of a measured subject", xlim=(0.0, None))
    axes.tick_params(labelleft=True)
    axes.legend(loc="upper left")


def _limit(axes: Axes, touch: TouchStreams, compression: np.ndarray) -> None:
    """Shade the compressions beyond the thickness of the fingertip's soft tissue, where its law is not valid."""
    thickness = touch.settings(touch.stream_of(Contact)).get("thickness")
    if isinstance(thickness, float | int) and 0.0 < thickness < (most := float(compression.max())):
        axes.axvspan(1e3 * thickness, 1.05e3 * most, color=FAINT, alpha=0.45, linewidth=0, zorder=0,
                     label="beyond the fingertip's thickness: law not valid")  # fmt: skip
        axes.legend(loc="upper left")


def _loop(axes: Axes, way: np.ndarray, force: np.ndarray, time: np.ndarray) -> None:
    """One touch: loading, hold and unloading in their colours, with arrows."""
    axes.plot(way * 1e3, force, ".", color=NORMAL, alpha=0.12, markersize=2.5)
    smooth = smooth_force(force, time)
    moves = movement(way, time)
    mark = _hold(axes, way, smooth, time, moves)
    for label, colour, which in (("loading", TISSUE, 1), ("hold", FINGER, 0), ("unloading", NORMAL, -1)):
        part = moves == which
        # A line ends where the next begins.
        x = np.where(part | np.append(part[1:], False), way, np.nan) * 1e3
        axes.plot(x, smooth, color=colour, linewidth=2.4, label=mark if label == "hold" and mark else label)
        if label != "hold":
            _arrow(axes, way * 1e3, smooth, np.flatnonzero(part))
    if len(smooth):
        axes.fill(way * 1e3, smooth, color=INK, alpha=0.05, linewidth=0)


def _hold(axes: Axes, way: np.ndarray, force: np.ndarray, time: np.ndarray, moves: np.ndarray) -> str:
    """Mark begin (ring) and end (dot) of the longest hold. The text for the legend: its duration and the change of the
    force; empty without a hold."""
    if (at := longest(moves == 0)) is None:
        return ""
    begin, end = max(at[0] - 1, 0), at[1]
    if time[end] - time[begin] < LEAST_HOLD or force[begin] < 0.1 * force.max():
        return ""
    axes.plot(way[begin] * 1e3, force[begin], "o", color=FINGER, markerfacecolor="white", markersize=10, zorder=5)
    axes.plot(way[end] * 1e3, force[end], "o", color=FINGER, markersize=5, zorder=6)
    change = float(force[end] - force[begin])
    size = f"{1e3 * change:+.1f} mN" if abs(change) < 0.1 else f"{change:+.2f} N"
    return f"hold, {time[end] - time[begin]:.2f} s (ring to dot): {size.replace('-', '−')}"


def longest(which: np.ndarray) -> tuple[int, int] | None:
    """First and last row of the longest run of true values (n); None if no value is true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], which, [False]]).astype(int)))
    if not len(edges):
        return None
    run = int(np.argmax(edges[1::2] - edges[::2]))
    return int(edges[2 * run]), int(edges[2 * run + 1]) - 1


def largest_step(touch: TouchStreams, most: float) -> float:
    """The largest rise of the force [N] in a tick in which a beam of the fingertip comes into contact; 0 if it is small
    compared with the largest force `most` [N], or the fingertip is no bundle of beams.

    The force of a beam begins with that of its damper, c times the rate, so these steps belong to the model. They
    shrink with the rate and with the distance between the beams.
    """
    slip, contact = touch[Slip], touch.contact
    if slip is None or contact is None or "contacts" not in slip:
        return 0.0
    slip, contact = together(slip, contact)
    more = np.diff(slip["contacts"].astype(int)) > 0
    step = float(np.diff(contact["force"])[more].max(initial=0.0))
    return step if step > LEAST_STEP * most else 0.0


def smooth_force(force: np.ndarray, time: np.ndarray) -> np.ndarray:
    """The running mean of noisy forces; quiet forces unchanged, with their peaks."""
    return force if noise(force) < QUIET * float(np.ptp(force)) else mean(force, time, SPAN)


def movement(way: np.ndarray, time: np.ndarray) -> np.ndarray:
    """1 where the depth (n) grows, -1 where it falls, 0 at rest."""
    if len(way) < 3 or not (size := float(np.ptp(way))) > 0:
        return np.zeros(len(way), dtype=int)
    if noise(way) < QUIET * size:
        rate = np.append(0.0, np.diff(way) / np.diff(time))
        rate[0] = rate[1]
        still = SLOW * size / float(time[-1] - time[0])
    else:
        rate = np.gradient(mean(way, time, RATE_SPAN), time)
        still = min(STILL, SLOW * float(np.abs(rate).max()))
    return np.where(np.abs(rate) > still, np.sign(rate), 0).astype(int)


def _arrow(axes: Axes, x: np.ndarray, y: np.ndarray, at: np.ndarray) -> None:
    """Draw an arrow halfway up the part of the curve with these samples."""
    if len(at) < 8:
        return
    middle = int(at[np.abs(y[at] - 0.55 * y.max()).argmin()])
    back, on = max(middle - 4, int(at[0])), min(middle + 4, int(at[-1]))
    axes.annotate(
        "",
        (x[on], y[on]),
        (x[back], y[back]),
        arrowprops={"arrowstyle": "-|>,head_width=0.45,head_length=0.9", "color": INK, "shrinkA": 0, "shrinkB": 0},
    )
