"""Results of a pooled fit and of a map: report.json, report.md, map.csv, and scene.yaml for `palpate run nodule`."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from palpate.models.fit.probes.fit import ProbeMap, grid, log_ratio
from palpate.models.fit.probes.pooled import PooledFit
from palpate.models.fit.probes.read import Probes
from palpate.models.fit.tissue.report import under_patch
from palpate.models.fit.tissue.rigs import Rig
from palpate.physics.contact.under_finger import round_settings

WRITTEN = ("report.json", "report.md", "scene.yaml")
MAP = ("map.csv", "map.png", "held_out.png")
TOP = 0.105  # [m] Height of the plane of the scene nodule


def pooled_data(probes: Probes, fit: PooledFit) -> dict[str, Any]:
    """Plain data of a pooled fit in SI units."""
    units = {p.name: p.unit for p in fit.law.parameters}
    return {
        "law": fit.law.name, "probes": len(fit.place), "rows": int(fit.rows.mask.sum()),
        "parameters": {name: {"value": value, "low": low, "high": high, "unit": units[name]}
                       for name, value in fit.values.items() for low, high in [fit.intervals[name]]},
        "withheld": fit.withheld,
        "between_places": {"of": fit.first, "factor": math.exp(fit.spread), "low": fit.between[0],
                           "high": fit.between[1]},
        "touch": {"mean": float(fit.touch[0]), "deviation": float(fit.touch[1]), "unit": "m"},
        "zero": {"mean": fit.zero[0], "deviation": fit.zero[1], "unit": "N"},
        "noise": {"deviation": fit.noise, "unit": "N"},
        "dropped": probes.dropped, "notes": fit.notes, "read": probes.read,
    }  # fmt: skip


def map_data(found: ProbeMap) -> dict[str, Any]:
    """Plain data of a map in SI units."""
    by_map, by_mean = found.errors()
    return pooled_data(found.probes, found.fit) | {
        "field": {"deviation": found.field.amplitude, "length": found.field.length,
                  "from_place_to_place": found.field.nugget},
        "held_out": {"map": by_map, "mean_curve": by_mean, "unit": "N"},
        "inclusions": [
            {"position": one.position.tolist(), "half_widths": one.across, "factor": one.factor,
             **{name: dict(zip(("value", "low", "high"), number, strict=True))
                for name, number in (("depth", one.depth), ("radius", one.radius))}}
            for one in found.inclusions
        ],
        "criterion": found.scores, "next_places": found.next_places.tolist(),
    }  # fmt: skip


def lines(probes: Probes, fit: PooledFit) -> list[str]:
    """What a person reads after the table of parameters."""
    low, high = fit.between
    away, wide = 1e3 * fit.touch[0], 1e3 * fit.touch[1]
    return [
        *probes.read,
        f"{len(fit.place)} probes, {int(fit.rows.mask.sum())} rows; {fit.first} of 95 % of the places: {low:.4g} to "
        f"{high:.4g} (a standard deviation is a factor of {math.exp(fit.spread):.3g})",
        f"touch points at {away:.2g} mm with a standard deviation of {wide:.2g} mm, zeros of the force at "
        f"{1e3 * fit.zero[0]:.2g} mN with a standard deviation of {1e3 * fit.zero[1]:.2g} mN, noise "
        f"{1e3 * fit.noise:.2g} mN",
        *probes.dropped, *fit.notes, *([f"interval withheld: {fit.withheld}"] if fit.withheld else []),
    ]  # fmt: skip


def map_lines(found: ProbeMap) -> list[str]:
    """What a person reads about a map."""
    by_map, by_mean = found.errors()
    out = [
        f"held-out probes: RMS {1e3 * by_map:.3g} mN by the map, {1e3 * by_mean:.3g} mN by the mean curve of the others"
    ]
    out.append("neighbouring places are not more similar than distant ones: the map is flat" if found.field.flat else
               f"places within {1e3 * found.field.length:.2g} mm are similar")  # fmt: skip
    for number, one in enumerate(found.inclusions, 1):
        x, y, z = 1e3 * one.position
        out.append(
            f"inclusion {number}: below ({x:.4g}, {y:.4g}, {z:.4g}) mm, ±{1e3 * max(one.across):.2g} mm; depth of its "
            f"centre {_range(one.depth)} mm, radius {_range(one.radius)} mm; {one.factor:.2g} times as stiff above it"
        )  # fmt: skip
    return out if found.inclusions else [*out, "no inclusion: a smooth map explains the probes as well"]


def _range(number: tuple[float, float, float]) -> str:
    value, low, high = (1e3 * one for one in number)
    return f"{value:.2g} ({low:.2g} to {high:.2g})"


def markdown(title: str, data: dict[str, Any], texts: list[str], pictures: list[Path]) -> str:
    """The report as Markdown."""
    ends = "withheld" if data["withheld"] else "{low:.4g} to {high:.4g}"
    rows = [
        f"| {name} [{p['unit']}] | {p['value']:.5g} | {ends.format(**p)} |" for name, p in data["parameters"].items()
    ]
    head = ["| parameter, median of the places | value | 95 % interval |", "|---|---|---|"]
    shown = [*(f"* {text}" for text in texts), "", *(f"![]({one.name})" for one in pictures)]
    return "\n".join([f"# {title}", "", *head, *rows, "", *shown, ""])


def pooled_scene(rig: Rig, fit: PooledFit, extends: str = "kidney", more: dict[str, Any] | None = None) -> str:
    """A scene with the tissue of the median place; `more`: entries of the tissue, and of other parts."""
    depth = float((fit.rows.depth * fit.rows.mask).max())
    tissue, why = under_patch(rig, rig.poisson, fit.values, depth)
    content: dict[str, Any] = {"extends": extends, "tissue": round_settings(tissue)}
    for part, values in (more or {}).items():
        content[part] = content.get(part, {}) | values
    return f"# Fitted to {len(fit.place)} probes: {fit.law.name}, {why}. SI units.\n" + yaml.safe_dump(
        content, sort_keys=False
    )


def map_scene(rig: Rig, found: ProbeMap, file: Path) -> str:
    """The scene nodule, a flat tissue, with the map instead of its nodule; its middle is that of the probes."""
    return pooled_scene(rig, found.fit, "nodule", {
        "tissue": {"measured_map": str(file)}, "nodule": {"nodule_radius": 0.0, "nodule_position": [0.0, 0.0, TOP]},
    })  # fmt: skip


def map_table(found: ProbeMap, count: int = 40) -> str:
    """The map as CSV: place in the plane of the scene, factor on the stiffness, place in the frame of the probes."""
    plane = grid(found.ground, count)
    places = np.array([found.ground.surface_point(uv) for uv in plane])
    value, error = log_ratio(found, places)
    rows = np.column_stack([plane, np.full(len(plane), TOP), np.exp(value), error, places])
    head = "x [m],y [m],z [m],factor,deviation of ln factor,probe x [m],probe y [m],probe z [m]"
    return "\n".join([head, *(",".join(f"{number:.6g}" for number in row) for row in rows), ""])
