"""The file that replaces the organ of a scene: `--organ`, the key `organ:` and `palpate.run(organ=...)`.

organ: liver.stl                                  # relative to the file with this line, or to the working directory
organ: {file: liver.stl, unit: mm, piece: 2}
organ: {file: seg.nii.gz, label: liver}           # a label of a segmentation: its number or its name
organ: {file: seg.nii.gz, label: liver+tumour}    # the second one is a nodule inside of the first
organ: {file: seg.nii.gz, label: liver/rib_left_9}   # the second one is rigid bone next to the first
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, NamedTuple

from palpate.engine.faults import NOWHERE, Fault, GraphError, Location, choices
from palpate.launch.load.labelled.bone import RigidBone, bones_nearby
from palpate.launch.load.labelled.nodule import Nodule
from palpate.physics.errors import MeshError
from palpate.physics.segmentation.endings import ending_of
from palpate.units.header import factor
from palpate.units.symbols import UnitError

ALL = "all"
SMALL = 100_000  # [bytes] of a file that is read twice, the first time to refuse it early


class Labelled(NamedTuple):
    """The label of an organ as the file writes it, "" without one; the nodule and the bone that it names."""

    name: str = ""
    nodule: Nodule | None = None
    bone: RigidBone | None = None

    @property
    def parts(self) -> list[Nodule | RigidBone]:
        """The nodule and the bone."""
        return [part for part in (self.nodule, self.bone) if part is not None]


@dataclass(frozen=True)
class OrganFile:
    """A mesh file, or a segmentation.

    unit   of a mesh: m, cm or mm; None: the only one in which its size is plausible
    piece  1: its largest separate piece, 2: the second largest ...; "all": every piece; None: all but small islands
    label  of a segmentation: number or name; liver+tumour: the second is a nodule inside of the first; liver/rib: the
           second is bone next to it; None: its only one
    """

    file: Path
    unit: str | None = None
    piece: int | str | None = None
    label: int | str | None = None

    def __post_init__(self) -> None:
        whole = isinstance(self.piece, int) and not isinstance(self.piece, bool) and self.piece >= 1
        if not (whole or self.piece in (None, ALL)):
            raise MeshError(f"piece of {self.file}: found {self.piece!r}, expected all or a number from 1")
        if isinstance(self.label, bool) or not isinstance(self.label, int | str | None):
            raise MeshError(f"label of {self.file}: found {self.label!r}, expected its number or its name")

    @property
    def stem(self) -> str:
        """The name of the file without its ending, of which a segmentation has up to two."""
        return self.file.stem.removesuffix(".nii").removesuffix(".seg")

    def as_mesh(self) -> tuple[OrganFile, tuple[str, ...]]:
        """The mesh file itself, or that of the surface of the label, and what was changed for it.

        MeshError: a segmentation that cannot be used, or a setting that the file does not have.
        """
        if not ending_of(self.file):
            if self.label is not None:
                raise MeshError(f"--label: {self.file} is no segmentation, which has labels. Leave it out")
            return self, ()
        from palpate.physics.segmentation.stored import store_surface  # scipy, which few graphs need

        if self.unit is not None:
            raise MeshError(f"--unit: {self.file} is a segmentation, whose header has the unit. Leave it out")
        stored = store_surface(self.file, self.label)
        more = bones_nearby(stored.near, str(self.file), self.label)
        return OrganFile(stored.path, "m", self.piece), (*stored.notes, *more)

    def labelled(self) -> Labelled:
        """What the label names. MeshError: as of `as_mesh`."""
        if not ending_of(self.file):
            return Labelled()
        from palpate.physics.segmentation.stored import store_surface

        stored = store_surface(self.file, self.label)
        nodule = stored.inside and Nodule(stored.inside, stored.organ, str(self.file))
        return Labelled(stored.organ, nodule, stored.bone and RigidBone(stored.bone, stored.organ, str(self.file)))

    @property
    def setting(self) -> int:
        """The piece as the setting `piece` of a node."""
        return -1 if self.piece == ALL else int(self.piece or 0)

    def check(self) -> None:
        """SettingError: the mesh file is missing, or is small and cannot be read. Neither numba nor scipy is imported,
        which would take longer than to read it."""
        if self.label is not None or ending_of(self.file):
            return  # `as_mesh` checks it
        from palpate.nodes.base.mesh_formats import read_file

        file = self.file.expanduser()
        if not file.is_file() or file.stat().st_size <= SMALL:
            read_file(str(self.file))

    def in_unit(self) -> str:
        """The given unit, or the only one in which the size is plausible.

        MeshError: unknown unit, implausible size, or several plausible units. SettingError: the file cannot be read.
        """
        from palpate.nodes.base.mesh_file import LARGEST, SMALLEST, UNITS, across, plausible_units

        size = across(str(self.file), self.setting)
        fits = plausible_units(size)
        try:
            scale = factor(self.unit or "m", "m")
        except UnitError as error:
            raise MeshError(f"unit of {self.file}: {error}") from None
        if self.unit is None and len(fits) == 1:
            return fits[0]
        if self.unit is not None and SMALLEST <= size * scale <= LARGEST:
            return self.unit
        expected = f"expected {1e3 * SMALLEST:g} to {1e3 * LARGEST:g} mm"
        sizes = " or ".join(f"--unit {u} ({1e3 * size * UNITS[u]:.3g} mm across)" for u in fits)
        if not fits:
            raise MeshError(
                f"--organ {self.file}: its coordinates span {size:.6g}, which is implausible in every unit; "
                f"{expected}. Export it again in millimetres"
            )
        if self.unit is None:
            raise MeshError(f"--organ {self.file}: the file has no unit, and several are plausible: {sizes}")
        raise MeshError(
            f"--organ {self.file}: in {self.unit} it is {1e3 * size * scale:.3g} mm across, {expected}. Use {sizes}"
        )


def organ_of(given: Any, place: Location = NOWHERE) -> OrganFile:
    """The organ that a key `organ:` or an argument `organ` names: a file, or a mapping with the fields of `OrganFile`.

    place  of the key; a relative file is sought in the folder of its file, then in the working directory

    GraphError: another value.
    """
    if isinstance(given, OrganFile):
        return given
    values = dict(given) if isinstance(given, Mapping) else {"file": given}
    known = [field.name for field in fields(OrganFile)]
    for key in values.keys() - set(known):
        raise GraphError([Fault(f"organ: found the key {key!r}", choices("Keys", str(key), known), place)])
    if not isinstance(values.get("file"), str | Path):
        text = (
            f"organ: found {given!r}, expected a mesh file or a segmentation, or a mapping such as {{file: liver.stl, "
            "unit: mm}"
        )
        raise GraphError([Fault(text, "", place)])
    file = Path(values["file"]).expanduser()
    near = Path(place.file).parent / file
    try:
        return OrganFile(**values | {"file": near if near.is_file() else file})
    except MeshError as error:
        raise GraphError([Fault(str(error), "", place)]) from None
