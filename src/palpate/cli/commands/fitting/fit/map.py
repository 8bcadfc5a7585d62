"""`palpate fit map PROBES.csv`: a stiffness map over the surface of an organ, from many sparse probes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from palpate.cli.terminal.options import Dialect, Force, Json, check_new, out_option
from palpate.cli.terminal.output import draw_if_possible, print_json, say
from palpate.cli.terminal.pooled import show_pooled
from palpate.physics.archive import replace_text

if TYPE_CHECKING:
    from palpate.models.fit.probes.fit import ProbeMap
    from palpate.models.fit.tissue.rigs import Rig

EXAMPLE = "palpate fit map probes.csv --rig ball --radius '4 mm' -o map"


def map(
    file: Annotated[
        Path,
        typer.Argument(help="CSV with probe, x, y, z, force and depth (units in the header); nx, ny, nz if known."),
    ],
    rig: Annotated[str, typer.Option(help="What pressed: ball or punch.")],
    radius: Annotated[str, typer.Option(help="Radius of the ball or punch: '4 mm'.")],
    law: Annotated[
        str | None, typer.Option(help="As for `fit tissue`; default: power or exponential, whichever follows better.")
    ] = None,
    columns: Annotated[
        str, typer.Option(help="Names or numbers of columns: force=F,indentation=3; force=-F inverts the sign.")
    ] = "",
    unit: Annotated[list[str] | None, typer.Option(help="Unit of a column whose header has none: d=mm.")] = None,
    dialect: Dialect = "",
    height: Annotated[str | None, typer.Option(help="Height of the layer, for laws that need it.")] = None,
    poisson: Annotated[float, typer.Option(help="Poisson's ratio.", min=0, max=0.5)] = 0.5,
    depth_limit: Annotated[str | None, typer.Option(help="Leave out rows deeper than this: '2 mm'.")] = None,
    ball_ratio: Annotated[
        float, typer.Option(help="Modulus of inclusions over that of the tissue; probes do not determine it.", min=1.1)
    ] = 100.0,
    out: Annotated[Path, out_option("Folder for map, scene, report and pictures.")] = Path("map"),
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Fit a stiffness map to many sparse probes of one organ.

    Writes map.csv and scene.yaml, which is ready to run, report.md with pictures and report.json: the law of the
    organ, its spread between places, stiff balls below the surface, the error on held-out probes, where to probe next.
    """
    import math

    from palpate.launch.run.progress import steps
    from palpate.models.fit.probes import report
    from palpate.models.fit.probes.fit import fit_map
    from palpate.models.fit.sessions import SessionError
    from palpate.models.fit.tissue.fit import check_laws
    from palpate.models.fit.tissue.rigs import Rig
    from palpate.studies.presses import PressReader, length

    if rig not in ("ball", "punch"):
        raise SessionError(f"--rig: found {rig!r}, expected ball or punch")
    made = Rig(rig, length("--radius", radius), length("--height", height) if height else None, poisson=poisson)
    if law:
        check_laws(made, (law,), "none")
    check_new([out / name for name in (*report.WRITTEN, *report.MAP)], force)
    probes = PressReader(columns.split(","), unit or [], False, dialect).probes(file)
    if probes is None:
        raise SessionError(
            f"{file}: found no table of sparse probes, expected columns of depth and force and a column probe or "
            "press, with 8 probes and more of up to 40 rows each. One press: palpate fit tissue"
        )
    deepest = length("--depth-limit", depth_limit) if depth_limit else math.inf
    with steps(f"fit map: {len(probes.names)} probes", 1, silent=as_json, timed=False) as done:
        found = fit_map(probes, made, law, deepest=deepest, ratio=ball_ratio, report=done)
    data, texts = _write(found, made, f"Map of {file.name}", out)
    if as_json:
        print_json({"ok": True, "out": str(out)} | data)
        return
    show_pooled(data, texts)
    say(f"written {out}/report.md, report.json, map.csv, scene.yaml; next: palpate run nodule --scene {out}/scene.yaml")


def _write(found: ProbeMap, made: Rig, title: str, out: Path) -> tuple[dict[str, Any], list[str]]:
    """Write map, scene, reports and pictures; returns the content of report.json and the lines to print."""
    from palpate.models.fit.probes import report
    from palpate.views.pictures.models.fit_map import draw_map

    out.mkdir(parents=True, exist_ok=True)
    pictures = draw_if_possible(draw_map, found, out)
    data, texts = report.map_data(found), [*report.lines(found.probes, found.fit), *report.map_lines(found)]
    replace_text(out / "map.csv", report.map_table(found))
    replace_text(out / "scene.yaml", report.map_scene(made, found, (out / "map.csv").resolve()))
    replace_text(out / "report.json", json.dumps(data, indent=1) + "\n")
    replace_text(out / "report.md", report.markdown(title, data, texts, pictures))
    return data, texts
