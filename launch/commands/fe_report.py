"""What `palpate fe` prints of a run, and of two."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from palpate.launch.commands.common import console

if TYPE_CHECKING:
    from palpate.models.fe.study.press_record import Record


def numbers(plate: str, material: str, record: Record, paper: bool) -> dict[str, Any]:
    """The record as plain data, with the paper's points beside it."""
    from palpate.models.fe.meshing.fingertip import PAPER, divisor_and_bone

    divisor, bone = divisor_and_bone(material)
    return {
        "plate": plate,
        "material": material,
        "divisor": divisor,
        "bone": bone,
        "indentation": record.indentation.tolist(),
        "force": record.force.tolist(),
        "area": record.area.tolist(),
        "levels": record.levels.tolist(),
        "volumes": record.volumes.tolist(),
        "paper": [
            {"force": f, "indentation": d, "found": record.at(f)[0] if f <= record.force[-1] else None}
            for f, d in (PAPER[plate] if paper else ())
        ],
    }


def show(plate: str, material: str, record: Record, paper: bool) -> None:
    """Print the record, and where the paper has points, those."""
    from rich.table import Table

    from palpate.models.fe.meshing.fingertip import PAPER, divisor_and_bone

    divisor, bone = divisor_and_bone(material)
    out = console()
    table = Table(
        box=None,
        pad_edge=False,
        title=f"{plate}, moduli / {divisor:g}, bone {bone / divisor:.3g} Pa; V in mm³ by strain",
        title_justify="left",
    )
    for name in ("mm", "N", "mm²", *(f"V({x:g})" for x in record.levels)):
        table.add_column(name, justify="right", no_wrap=True)
    for k in range(0, len(record.force), max(1, len(record.force) // 15)):
        row = (1e3 * record.indentation[k], record.force[k], 1e6 * record.area[k], *(1e9 * record.volumes[k]))
        table.add_row(*(f"{x:.3g}" if x < 1000 else f"{x:.0f}" for x in row))
    out.print(table)
    for force, depth in PAPER[plate] if paper else ():
        if force > record.force[-1]:
            out.print(f"{force} N: not reached (paper: {1e3 * depth:.2f} mm)")
        else:
            out.print(f"{force} N: {1e3 * record.at(force)[0]:.2f} mm (paper: {1e3 * depth:.2f} mm)")


def show_statements(rows: list[dict[str, Any]]) -> None:
    """Print what the paper says and what was found."""
    from rich.table import Table

    table = Table(box=None, pad_edge=False)
    table.add_column("the paper's statement")
    for name in ("steel", "silicone", "holds"):
        table.add_column(name, justify="right", no_wrap=True)
    shown = {True: "yes", False: "no", None: "-"}
    for row in rows:
        figures = ("-" if row[p] is None else f"{row[p]:.3g}" for p in ("steel", "silicone"))
        table.add_row(row["statement"], *figures, shown[row["holds"]])
    console().print(table)
