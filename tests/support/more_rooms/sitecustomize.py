"""Read by every Python that starts with this folder on its path: the rooms of palpate get one more folder each.

Files in MORE_ROOMS/physics/friction, MORE_ROOMS/nodes/device, ... are found as if they lay in these rooms.
"""

import importlib
import os
from pathlib import Path

folder = Path(os.environ["MORE_ROOMS"])
for path in sorted({file.parent for file in folder.glob("*/**/*.py")}):
    room = importlib.import_module(".".join(("palpate", *path.relative_to(folder).parts)))
    room.__path__.append(str(path))
