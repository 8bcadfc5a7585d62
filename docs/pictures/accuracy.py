"""Draw accuracy.png from stored results: python docs/pictures/accuracy.py [FILE]

Left: `palpate bench accuracy`, `src/palpate/studies/accuracy/references/results.json`. Right: `every_place.json`
of `benchmarks/every_place.py`. Both files ship, so this takes seconds.

--store FILE  first store the cells of `palpate bench accuracy --json > FILE`
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from palpate.studies.accuracy.cells import Cell
from palpate.studies.accuracy.output import stored
from palpate.studies.accuracy.output.pareto import of_bodies, summaries
from palpate.studies.accuracy.output.pictures import overview

FOLDER = Path(__file__).parent
PLACES = FOLDER / "every_place.json"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("target", nargs="?", type=Path, default=FOLDER / "accuracy.png")
    parser.add_argument("--store", type=Path, help="JSON of `palpate bench accuracy --json`, to store first")
    given = parser.parse_args()
    if given.store:
        data = json.loads(given.store.read_text(encoding="utf-8"))
        stored.save([Cell(**cell) for cell in data["cells"]], data["about"])
    cells, _ = stored.load()
    overview(summaries(of_bodies(cells)), cells, given.target, json.loads(PLACES.read_text(encoding="utf-8")))
    print(given.target)


if __name__ == "__main__":
    main()
