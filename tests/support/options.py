"""Runs graphs with options by `palpate.run`, in a process whose arithmetic is not pinned.

    python options.py RUNS FOLDER

Prints the outcome of each run. RUNS is a file with a JSON list of runs: graph, scene, duration [s] and texts as after
`--set`.
"""

import json
import sys
import warnings
from pathlib import Path

import numpy as np
from same_bytes import digests


def outcome(graph, scene, duration, sets, file):
    """The digests and notes of a run, or why it is refused."""
    import palpate

    try:
        run = palpate.run(graph, scene=scene, duration=duration, sets=sets, record=file)
    except palpate.PalpateError as error:
        return {"refused": " ".join(str(error).split())}
    return {"streams": digests(file), "notes": [note.text for note in run.notes]}


def main(runs, folder):
    warnings.simplefilter("ignore")
    assert np.ones(3).sum() == 3.0  # numpy chooses its instructions before palpate is imported
    for number, given in enumerate(json.loads(Path(runs).read_text())):
        file = Path(folder) / f"{number}.mcap"
        print(json.dumps(outcome(*given, file)), flush=True)
        file.unlink(missing_ok=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
