"""`palpate build fe table`: contact area and isostrain volumes of a finger over force, for tactile.Flow."""

from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.terminal.options import Json, out_option
from palpate.cli.terminal.output import print_json, write

EXAMPLE = (
    "palpate build fe table runs/fingertip/steel-calibrated-6-0.2 runs/fingertip/silicone-calibrated-6-0.2 -o flow.npz"
)


def table(
    steel: Annotated[Path, typer.Argument(help="Folder of a run on steel, of `palpate build fe fingertip`.")],
    silicone: Annotated[Path, typer.Argument(help="Folder of a run on silicone with the same material.")],
    out: Annotated[Path, out_option("File to write.")] = Path("fingertip.npz"),
    as_json: Json = False,
) -> None:
    """Write the table that tactile.Flow reads.

    The table has area and isostrain volumes against force for both plates. A steel run with another divisor is scaled:
    on a rigid plate the force is proportional to the moduli.
    """
    import numpy as np

    from palpate.models.fe.study.press_record import LEVELS, PressRun, check_pair
    from palpate.physics.archive import replacing
    from palpate.physics.errors import ArgumentError

    runs = {"steel": PressRun(steel), "silicone": PressRun(silicone)}
    ratio = check_pair(runs, scaled=True)
    if out.suffix != ".npz":
        raise ArgumentError(f"--out {out}: expected a name that ends in .npz")
    records = {"steel": runs["steel"].record().soften(ratio), "silicone": runs["silicone"].record()}
    data = {"levels": LEVELS}
    for plate, record in records.items():
        keep = np.concatenate([[True], np.diff(record.force) > 0])
        data |= {f"{plate}.{n}": getattr(record, n)[keep] for n in ("force", "area", "volumes", "indentation")}
    with replacing(out) as part:
        np.savez_compressed(part, allow_pickle=False, **data)
    if as_json:
        print_json({"ok": True, "table": str(out), "force": {p: r.force[-1] for p, r in records.items()}})
    else:
        write(f"{out}: {', '.join(f'{p} to {r.force[-1]:.3g} N' for p, r in records.items())}")
