"""Published tissues: records in `graphs/tissues/*.yaml`, and the settings that a scene takes, `tissue: liver-human`.

Each record has the law (conventions: see its file in `physics/materials`), state, test, range, source and the part of
the source that was read. `shear` is the shear modulus at rest, which must agree with the law and its parameters.
`scene` contains settings that do not follow from the law.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import palpate.graphs
from palpate.engine.faults import Fault, GraphError, Location, choices
from palpate.launch.load.values.source import YamlSource, read
from palpate.physics.contact.under_finger import round_settings, under_finger
from palpate.units.quantity import UnitError, convert

if TYPE_CHECKING:
    from palpate.physics.materials.hyperelastic import Material

TISSUES = Path(next(iter(palpate.graphs.__path__))).resolve() / "tissues"
NEEDED = (
    "tissue", "species", "state", "test", "strain", "rate", "law", "parameters", "shear", "grade", "read", "source",
)  # fmt: skip
MORE = ("n", "spread", "doi", "remark", "relaxation", "scene")
GRADES = {"P": "published", "S": "transcribed", "R": "computed from data", "assumed": "assumed"}
OF_LABELS = ("labels", "inside")  # keys of the table that `labels` reads
PLAIN = ("alpha", "b")  # parameters without a unit
RATIO = 0.499  # Poisson's ratio if the record has no bulk modulus


def material(record: Mapping[str, Any]) -> Material:
    """The law of a record.

    MaterialError, UnitError, KeyError: invalid parameters.
    """
    from palpate.physics.materials.hyperelastic import constructor, moduli, poisson_of

    p = {k: float(v) if k in PLAIN else convert(str(v), "Pa") for k, v in record["parameters"].items()}
    law = record["law"]
    shear = p.get("shear") or p.get("mu") or (2.0 * p["c10"] if "bulk" in p else p.get("young", 0.0) / 3.0)
    young, ratio = 2.0 * (1.0 + RATIO) * shear, RATIO
    if "bulk" in p:
        young, ratio = 9.0 * p["bulk"] * shear / (3.0 * p["bulk"] + shear), poisson_of(shear, p["bulk"])
    if law == "ogden":
        return constructor(law)(RATIO, shear, p["alpha"])
    if law == "yeoh":
        return constructor(law)(RATIO, p["c1"], p["c2"], p["c3"])
    if law == "demiray":
        return constructor(law)(young, RATIO, p["b"])
    if law == "mooney_rivlin":
        bulk = moduli(4.0 * (1.0 + RATIO) * (p["c10"] + p["c01"]), RATIO)[1]
        return constructor(law)(p["c10"], p["c01"], 0.0, 0.0, 0.0, 2.0 / bulk)
    return constructor(law)(young, ratio)


@lru_cache
def tissues() -> tuple[dict[str, dict[str, Any]], dict[str, str]]:
    """Records by name, and the tissues that were left out with the reason.

    GraphError: a record without a source, with an unknown key, a wrong unit, or a shear modulus that its law lacks.
    """
    places, left_out = _records(TISSUES)
    for name, (record, place) in places.items():
        if fault := _fault(record):
            raise GraphError([Fault(f"tissue {name!r}: {fault}", "", place)])
    return {name: record for name, (record, _) in places.items()}, left_out


@lru_cache
def _records(folder: Path) -> tuple[dict[str, tuple[dict[str, Any], Location]], dict[str, str]]:
    """Records by name with their places, and the tissues left out. The records are not checked, because the check
    compiles kernels.

    GraphError: two records have the same name.
    """
    found: dict[str, tuple[dict[str, Any], Location]] = {}
    left_out: dict[str, str] = {}
    for path in sorted(folder.glob("*.yaml")):
        source = read(path)
        left_out |= source.data.pop("left_out", {})
        for key in OF_LABELS:
            source.data.pop(key, None)
        for name, record in source.data.items():
            if name in found:
                raise GraphError([Fault(f"tissue {name!r}: twice", "", source.place(name))])
            found[name] = record, source.place(name)
    return found, left_out


def _fault(record: Mapping[str, Any]) -> str:
    """The fault of a record, or an empty text."""
    from palpate.physics.materials.hyperelastic import MaterialError, rest_moduli

    missing = [key for key in NEEDED if record.get(key) in (None, "")]
    unknown = [key for key in record if key not in (*NEEDED, *MORE)]
    if missing or unknown or record["grade"] not in GRADES:
        return f"missing {missing}, unknown {unknown}, grade {record.get('grade')!r} of {', '.join(GRADES)}"
    try:
        made, shear = rest_moduli(material(record))[0], convert(str(record["shear"]), "Pa")
        convert(str(record.get("spread", "0 Pa")), "Pa")
        for time in record.get("relaxation", {}).get("times", ()):
            convert(str(time), "s")
    except (MaterialError, UnitError, AttributeError, KeyError, ValueError) as error:
        return str(error)
    return "" if math.isclose(made, shear, rel_tol=2e-3) else f"shear {shear:g} Pa, its law has {made:g} Pa at rest"


def spread_of(record: Mapping[str, Any]) -> float:
    """Published spread of the modulus over its value [1]; 0 if none is given. It is that of the parameter `young`, or
    of a single `c10`, where the record has one, else of the shear modulus."""
    given = record["parameters"]
    single = "young" if "young" in given else "c10" if "c10" in given and "c01" not in given else ""
    value = given[single] if single else record["shear"]
    return convert(str(record.get("spread", "0 Pa")), "Pa") / convert(str(value), "Pa")


def deviation_of(record: Mapping[str, Any]) -> float:
    """Published standard deviation of the modulus over its value [1]; 0 if none is given, or if the spread is that
    between quartiles, which is 1.35 times as wide for a normal distribution."""
    return 0.0 if "quartile" in str(record.get("remark", "")) else spread_of(record)


def bodies(record: Mapping[str, Any]) -> dict[str, str]:
    """The part of a record that each kind of body uses."""
    rest = "modulus at rest" + ("" if record["law"] in ("linear", "neo_hooke") else ", stiffening left out")
    relaxes = ", relaxation left out" if "relaxation" in record else ""
    rest += relaxes
    spring = f"{rest}, under a finger's patch of 8 mm"
    full = f"{record['law']}{relaxes}"
    return {"MassSpring": spring, "BeamBundle": spring, "ReducedFE": rest, "full finite elements": full}


def settings(name: str, place: Location) -> dict[str, Any]:
    """Settings that replace the name in a scene's `tissue`: a power law for MassSpring, layers and moduli for
    BeamBundle, `young` for ReducedFE. Times of relaxation are those of the scene.

    GraphError: an unknown or excluded tissue; suggests names, or gives the reason.
    """
    from palpate.physics.materials.hyperelastic import poisson_of, rest_moduli

    names, reasons = _records(TISSUES)
    if name not in names:
        why = f", which was left out: {reasons[name]}" if name in reasons else ""
        raise GraphError([Fault(f"no tissue {name!r}{why}", choices("Tissues", name, list(names)), place)])
    found, _ = tissues()
    if "scene" in found[name]:
        return dict(found[name]["scene"])
    shear, bulk = rest_moduli(material(found[name]))
    plane = 2.0 * shear / (1.0 - poisson_of(shear, bulk))  # E/(1 - nu²)
    return round_settings(under_finger(plane))


def fill_in(source: YamlSource, *keys: str) -> None:
    """Replace the name of a tissue under these keys of a scene by its settings."""
    data = source.sub(*keys).data
    if isinstance(data, str) and not data.startswith("$"):
        place = source.place(*keys)
        source.put(keys, YamlSource(settings(data, place), {(): place}))
