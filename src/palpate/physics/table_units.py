"""Where a table names the units of its columns: the header, a row below it, comments; and contradictions of these."""

import re
from collections.abc import Sequence

from palpate.physics.table_cells import cells_of, texts_of
from palpate.units.header import has_dimension, is_known, is_unit, plain_unit, same_unit, split_units

NO_UNIT = ("-", "a.u.", "#", "1")
STATED = re.compile(
    r"(?i)\s*(?:units?\s+of\s+)?(?:the\s+)?(?P<name>.*?)(?:\s+units?)?\s*(?:\bin\b|\bis\b|[:=])\s*(?P<unit>\S.*?)\s*"
)
UNITS = re.compile(r"(?i)\s*units?\s*[:=]\s*")
LVM = "Y_Unit_Label"  # LabVIEW: units of all columns after the first

Source = tuple[str, str]
"""(unit, where it is written)."""


class Units:
    """The units of the columns of a table, from every place that names them."""

    def __init__(self, line: int, cells: Sequence[str]) -> None:
        self.line, self.cells = line, list(cells)
        self.names: list[str] = []
        self.sources: list[list[Source]] = []
        for cell in cells:
            name, units = split_units(cell)
            self.names.append(name)
            self.sources.append([(unit, f"row {line}") for unit in units])

    def add_row(self, line: int, cells: Sequence[str], first: int = 0) -> None:
        """A row of units, one per column from `first` on. A unit of the header that is none is a remark."""
        for k, cell in enumerate(cells, first):
            unit = plain_unit(cell)
            if k < len(self.sources) and unit and unit.lower() not in NO_UNIT:
                known = [source for source in self.sources[k] if is_unit(source[0])]
                self.sources[k] = [*known, (unit, f"row {line}")]

    def add_text(self, line: int, text: str) -> None:
        """A line above the table: `Units: s mm N`, `Force in mN`, `Force [mN], depth [mm]`, `Y_Unit_Label`. A line with
        a number is a parameter."""
        cells = cells_of(text)[0]
        if len(texts_of(cells)) < len(cells):
            return
        if cells and cells[0].strip() == LVM:
            self.add_row(line, cells[1:], 1 if len(cells) <= len(self.cells) else 0)
            return
        if match := UNITS.match(text):
            listed = re.split(r"[,;\s]+", text[match.end() :].strip())
            if len(listed) == len(self.cells) and all(map(is_unit, listed)):
                self.add_row(line, listed)
            return
        names = {name.casefold(): k for k, name in reversed(list(enumerate(self.names))) if name}
        for piece in re.split(r"[,;\t]\s*", text):
            name, units = split_units(piece)
            if not units and (match := STATED.fullmatch(piece)) and is_unit(match["unit"]):
                name, units = match["name"], (plain_unit(match["unit"]),)
            k = names.get(name.strip().casefold())
            if k is not None:
                self.sources[k] += [(unit, f"row {line}") for unit in units if is_unit(unit)]

    def of(self, k: int) -> str:
        """The unit of column k, "" if it has none. ValueError: two places contradict each other."""
        sources = self.sources[k]
        first = sources[0] if sources else ("", "")
        for unit, where in sources[1:]:
            if not same_unit(unit, first[0]):
                raise ValueError(
                    f"column {self.cells[k].strip()!r}: the unit {first[0]!r} in {first[1]} contradicts {unit!r} in "
                    f"{where}. Delete the wrong one"
                )
        return first[0]

    def choose(self, places: Sequence[int], si: str) -> list[int]:
        """Of several columns with the same name, the only one whose unit may have a dimension; else all."""
        fitting = [
            k for k in places
            if all(has_dimension(unit, si) or not is_known(unit) for unit, _ in self.sources[k])
        ]  # fmt: skip
        return fitting if len(fitting) == 1 else list(places)
