"""How fingertip and tissue share the approach over time."""

from matplotlib.figure import Figure

from palpate.views.pictures.force import NOTHING
from palpate.views.pictures.style import ENERGY, FINGER, TISSUE, figure, legend_above, place_panels
from palpate.views.pictures.touch import TouchStreams, touches

ORDER, OF_A_FINGER = 30, True


def draw_picture(touch: TouchStreams) -> Figure | None:
    """None without a contact, or if only one of the two deforms."""
    contact = touch.contact
    if contact is None or not touches(contact["time"], contact["force"]):
        return None
    least = NOTHING * float((contact["compression"] + contact["indentation"]).max())
    if min(contact["compression"].max(), contact["indentation"].max()) <= least:
        return None
    time, s1, s2 = contact["time"], contact["compression"] * 1e3, contact["indentation"] * 1e3
    out = figure(11.5, 5.6, "How fingertip and tissue share the approach", layout="none")
    upper, lower = out.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    place_panels(out, 2, 1)
    upper.fill_between(time, s1 + s2, color=TISSUE, alpha=0.07, linewidth=0, label="s1 + s2, the approach")
    upper.plot(time, s2, color=TISSUE, label="s2, indentation of the tissue")
    upper.plot(time, s1, color=FINGER, label="s1, compression of the fingertip")
    legend_above(upper)
    upper.set_title(f"at most {(s1 + s2).max():.1f} mm: {s1.max():.1f} and {s2.max():.1f} mm")
    upper.set(ylabel="compression, indentation [mm]", ylim=(0.0, None))
    lower.axhline(0.0, color="#77777f", linewidth=0.8)
    lower.plot(time, s1 - s2, color=ENERGY)
    lower.set_ylabel("s1 − s2 [mm]")
    touch.over_time(lower, time)
    return out
