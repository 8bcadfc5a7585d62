"""Draw the hand on a kidney that breathes: python docs/pictures/moving_organ.py [folder]

moving-organ.png  place, force and energy: `palpate run kidney --scene breathing`
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.messages import Ledger, unpack
from palpate.records.reader import Recording


def main(folder: Path) -> Path:
    """Run, draw."""
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="palpate-") as scratch:
        file = Path(scratch) / "breathing.mcap"
        outcome = execute(find("kidney").but(scene="breathing", place="fused", record=file, duration=9.0))
        if not outcome.result.ok:
            raise SystemExit("\n".join(map(str, outcome.result.deaths)))
        names = ("breathing", "finger", "contact", "friction", "ledger")
        recording = Recording(file)
        tables = recording.tables(set(names))
        books = [unpack(payload, Ledger) for _, _, payload in recording.payloads("ledger")]
    motion, finger, contact, friction, ledger = (tables[name] for name in names)
    figure, axes = plt.subplots(3, 1, figsize=(9, 7), sharex=True, layout="constrained")
    for axis, label in ((0, "along"), (2, "up")):
        moved, place = motion["displacement"][:, axis], finger["position"][:, axis]
        axes[0].plot(motion["time"], 1e3 * moved, label=f"organ, {label}", color=f"C{axis}")
        axes[0].plot(finger["time"], 1e3 * (place - place[2000]), "--", label=f"finger, {label}", color=f"C{axis}")
    axes[0].set(ylabel="place [mm]", ylim=(-8, 14), title="place of organ and finger, against that after 2 s")
    axes[1].plot(contact["time"], contact["force"], label="normal force")
    axes[1].plot(friction["time"], np.linalg.norm(friction["force"], axis=1), label="friction")
    axes[1].set(ylabel="force [N]")
    carried = np.array([book.carried[0] for book in books])
    axes[2].plot(ledger["time"], 1e3 * ledger["hand"], label="work of the hand")
    axes[2].plot(ledger["time"], 1e3 * carried, label="work of the foundation")
    stored = ledger["fingertip_stored"] + ledger["tissue_stored"] + ledger["friction_stored"]
    axes[2].plot(ledger["time"], 1e3 * stored, label="stored")
    axes[2].set(ylabel="energy [mJ]", xlabel="time [s]")
    for each in axes:
        each.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), fontsize=9)
        each.grid(alpha=0.3)
    figure.savefig(folder / "moving-organ.png", dpi=110)
    return folder / "moving-organ.png"


if __name__ == "__main__":
    from target import folder

    print(main(folder(__doc__)))
