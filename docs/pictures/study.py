"""Run the shipped studies, and draw their results: python docs/pictures/study.py [folder]

study-curves.png       force over time at each stiffness: `palpate study kidney-stiffness`
study-sensitivity.png  sensitivity of the force to the parameters: `palpate study kidney-sensitivity`
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from palpate.studies.sweeps.file import find, load

PICTURES = {
    "study-curves.png": ("kidney-stiffness", "curve contact.force"),
    "study-sensitivity.png": ("kidney-sensitivity", "peak contact.force"),
}


def main(folder: Path) -> list[Path]:
    """Run, draw."""
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as results:
        for target, (name, quantity) in PICTURES.items():
            study = load(find(name))
            study.run(Path(results, name)).plot(quantity).savefig(folder / target)
    return [folder / target for target in PICTURES]


if __name__ == "__main__":
    from target import folder

    print(*main(folder(__doc__)), sep="\n")
