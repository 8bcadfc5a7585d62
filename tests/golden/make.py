"""Record the golden recordings again: small runs with which every change of the code is compared.

    python tests/golden/make.py [NAME...]

Run it after an intended change of the computed values, and describe this change in the CHANGELOG. Run it in the
repository's root, so that the files contain no path of this machine.

    plane    a plane, fused, simulated time          kidney   the kidney, fused, simulated time
    smooth   the plane without friction              live     the plane on the real clock, in three processes, with
                                                              the late, lost and held messages of this machine
"""

import os
import sys
from pathlib import Path

from palpate.compiler.arithmetic import pin

pin()  # as the command line is, before numpy is imported

from palpate.launch.load.launchfile import LaunchFile  # noqa: E402
from palpate.launch.run.execute import execute  # noqa: E402

HERE = Path(__file__).parent
DURATION = 0.12  # [s]
RUNS: dict[str, LaunchFile] = {
    "plane": LaunchFile(graph=HERE / "plane.yaml", place="fused"),
    "kidney": LaunchFile(graph=HERE / "kidney.yaml", place="fused"),
    "smooth": LaunchFile(graph=HERE / "plane.yaml", place="fused", overrides=("scene.tissue.friction=off",)),
    "live": LaunchFile(graph=HERE / "plane.yaml", clock="real", place=HERE / "place.yaml"),
}


def main(names: list[str]) -> None:
    os.chdir(HERE.parent.parent)
    for name in names or RUNS:
        path = HERE / f"{name}.mcap"
        outcome = execute(RUNS[name].but(duration=DURATION, record=path))
        if not outcome.result.ok:
            raise SystemExit("\n".join(map(str, outcome.result.deaths)))
        print(f"{path.relative_to(Path.cwd())}: {path.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main(sys.argv[1:])
