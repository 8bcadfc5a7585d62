"""Force and friction under the encoder of 60 um, compared with exact positions at the same rate.

    python benchmarks/encoder.py [--bodies MassSpring ReducedFE BeamBundle] [--rates 500 1000 5000 10000] [--phases 3]

Prints the table of docs/equations/falcon.md, a row for each motion, over all bodies, rates and phases. A phase shifts
the motion by a random fraction of a count in each direction. Tick to tick: RMS change of the force from one tick to the
next, over that with exact positions. Held values are means of the last 0.2 s. Takes 6 minutes.
"""

import argparse
import tempfile
from collections.abc import Sequence
from itertools import product
from pathlib import Path

import numpy as np

from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.records.reader import Recording

COUNT = 60e-6  # [m]
AIR = 0.116  # [m] height at which each motion begins
TOP, LOW, LIGHT = (-0.02, 0.003, 0.0985), (-0.03, 0.004, 0.0975), (0.008, -0.004, 0.1015)
MOTIONS: dict[str, tuple[tuple[tuple[float, float, float], float, str], ...]] = {  # to [m], in [s], shape
    "press in 0.4 s": ((TOP, 0.4, "minimum-jerk"),),
    "press near the end of the kidney": ((LOW, 0.4, "minimum-jerk"),),
    "press in 0.12 s": ((TOP, 0.12, "minimum-jerk"),),
    "press in 1.5 s": ((LIGHT, 1.5, "minimum-jerk"),),
    "stroke that stops": ((LIGHT, 0.2, "minimum-jerk"), ((0.014, -0.007, 0.1015), 0.2, "linear")),
    "tap in 0.12 s": ((TOP, 0.06, "minimum-jerk"), ((*TOP[:2], AIR), 0.06, "minimum-jerk")),
}
REST = 0.6  # [s] at the end


def forces(motion: str, body: str, rate: int, shift: Sequence[float], exact: bool) -> list[np.ndarray]:
    """Force of the controller and of friction [N] (k,3)."""
    parts = MOTIONS[motion]

    def shifted(point: Sequence[float]) -> list[float]:
        return [round(x + d, 8) for x, d in zip(point, shift, strict=True)]

    path = [f"{{to: {shifted(to)}, time: {time}, shape: {shape}}}" for to, time, shape in parts]
    sets = [f"scene.hand.path=[{', '.join(path)}, {{hold: {REST}}}]", f"tissue.use=deformation.{body}"]
    sets += [f"rate={rate}", "scene.surface.vertices=1500", f"scene.hand.begin={shifted((*parts[0][0][:2], AIR))}"]
    if exact:
        sets += [f"{node}.resolution=0" for node in ("device", "finger", "controller")]
    with tempfile.TemporaryDirectory() as folder:
        launch = find("kidney").but(
            record=Path(folder) / "run.mcap", place="fused", duration=sum(part[1] for part in parts) + REST,
            wanted=("controller", "friction"), overrides=tuple(sets),
        )  # fmt: skip
        if not execute(launch).result.ok:
            raise SystemExit(f"{motion}, {body}, {rate} Hz failed")
        recording = Recording(Path(folder) / "run.mcap")
        return [np.array(recording.columns(node)["force"]) for node in ("controller", "friction")]


def errors(motion: str, body: str, rate: int, shift: Sequence[float]) -> tuple[float, ...]:
    """Errors of peak [%], held force [%], change from tick to tick [%], force [% of peak, RMS], and held friction [%],
    as a vector [mN]; nan: no contact at the end."""
    (force, rub), (exact, rubs) = (forces(motion, body, rate, shift, way) for way in (False, True))
    peak, last = np.linalg.norm(exact, axis=1).max(), round(0.2 * rate)
    held, wanted = (np.linalg.norm(each[-last:].mean(axis=0)) for each in (force, exact))
    noise, smooth = (np.sqrt(np.square(np.diff(each, axis=0)).sum(axis=1).mean()) for each in (force, exact))
    friction, right = rub[-last:].mean(axis=0), rubs[-last:].mean(axis=0)
    touches = wanted > 0.02
    size = np.linalg.norm(right) if touches else np.nan
    return (
        100 * (np.linalg.norm(force, axis=1).max() / peak - 1),
        100 * (held / wanted - 1) if touches else np.nan,
        100 * (noise / smooth - 1),
        100 * np.sqrt(np.square(force - exact).sum(axis=1).mean()) / peak,
        100 * (np.linalg.norm(friction) / size - 1),
        1e3 * np.linalg.norm(friction - right) if touches else np.nan,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bodies", nargs="+", default=["MassSpring", "ReducedFE", "BeamBundle"])
    parser.add_argument("--rates", nargs="+", type=int, default=[500, 1000, 5000, 10_000])
    parser.add_argument("--phases", type=int, default=3)
    given = parser.parse_args()
    shifts = (COUNT * np.random.default_rng(5).random((given.phases, 3))).tolist()
    print("| motion | peak force | held force | tick to tick | force, RMS | held friction | mean, RMS |")
    print("|---|---|---|---|---|---|---|", flush=True)
    for motion in MOTIONS:
        found = np.array([errors(motion, *case) for case in product(given.bodies, given.rates, shifts)]).T
        low, high = found.min(axis=1), found.max(axis=1)
        cells = [f"{low[k]:+.1f} to {high[k]:+.1f} %" for k in (0, 1, 2)] + [f"at most {high[3]:.1f} %"]
        cells += [f"{low[4]:+.0f} to {high[4]:+.0f} %, at most {high[5]:.0f} mN"]
        cells += [f"{found[4].mean():+.1f}, {np.sqrt(np.square(found[4]).mean()):.1f} %"]
        print("| " + " | ".join([motion, *(cell if "nan" not in cell else "" for cell in cells)]) + " |", flush=True)


if __name__ == "__main__":
    main()
