"""The process that computes the items of tasks, with pinned arithmetic, independent of the imports of its parent. It
can be killed if an item takes too long, and its parent survives if an item crashes it.

It first sends `about()`. A request is a task, or None for the last one, and items. The answers are: None (see `Beat`),
the place and the result of an item, a text if this machine cannot compute the task, () at the end. Tasks, items and
results are pickled separately, so that the parent passes them on as bytes.
"""

import contextlib
import pickle
import signal
import sys
from typing import Any

from palpate.launch.load.classes import catalogue
from palpate.launch.run.descendants import die_with_parent
from palpate.launch.run.tasks.link import join_link
from palpate.launch.run.tasks.task import about
from palpate.physics.errors import PalpateError

IDLE = 600.0  # [s] The process ends after this time without a request


def main() -> None:
    """Serve requests on the connection to the parent (`link`), until it closes or is idle for `IDLE`."""
    die_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with join_link(sys.argv[1]) as link:
        with contextlib.suppress(Exception):
            catalogue()  # imports all shipped nodes while the study is still being loaded
        link.send(about())
        task: Any = None

        def beat() -> None:
            link.send(None)

        with contextlib.suppress(EOFError):
            while link.poll(IDLE):
                given, items = link.recv()
                try:
                    if given is not None:
                        task = pickle.loads(given)
                        task.check()
                    for place, result in task.compute([pickle.loads(item) for item in items], beat):
                        link.send((place, pickle.dumps(result)))
                except PalpateError as error:
                    task = None
                    link.send(str(error))
                else:
                    link.send(())
