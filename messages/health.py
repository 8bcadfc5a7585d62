"""Message about a node's own state, for observers."""

from typing import Annotated

from palpate.messages.base import Message


class Health(Message):
    """The health of a node. `source` names it; `tick` is that of its last step. Sent by the worker, not by the node.

    since    [1]  ()  first tick that it could step at since it was started last
    steps    [1]  ()  steps since then
    late     [1]  ()  ticks that the clock had to leave out
    lost     [1]  ()  driving messages that were skipped or did not come in time
    held     [1]  ()  inputs older than their tick asks for
    state    [1]  ()  what it is doing
    median   [s]  ()  duration of a step
    p99      [s]  ()  duration of a step that 99 of 100 stay below
    longest  [s]  ()  duration of the longest step
    age      [s]  ()  median of the time from the tick to the answer
    asleep   [1]  ()  steps at which it was at rest, and its last answer was sent again
    """

    since: Annotated[int, "1"]
    steps: Annotated[int, "1"]
    late: Annotated[int, "1"]
    lost: Annotated[int, "1"]
    held: Annotated[int, "1"]
    state: Annotated[str, "1"]
    median: Annotated[float, "s"]
    p99: Annotated[float, "s"]
    longest: Annotated[float, "s"]
    age: Annotated[float, "s"]
    asleep: Annotated[int, "1"] = 0
