"""Imported by every Python with this folder on its path: adds a folder to each package of palpate.

Files in MORE_ROOMS/physics/friction, MORE_ROOMS/nodes/device, ... are found as parts of these packages.
"""

import importlib
import os
from pathlib import Path

folder = Path(os.environ["MORE_ROOMS"])
for path in sorted({file.parent for file in folder.glob("*/**/*.py")}):
    room = importlib.import_module(".".join(("palpate", *path.relative_to(folder).parts)))
    room.__path__.append(str(path))
