"""Message about the state of a node, for observers."""

from typing import Annotated

from palpate.messages.base import Message


class Health(Message):
    """Health of a node, sent by its worker. `source` is the node's name, `tick` that of its last step.

    since    [1]  ()  first tick at which it could step since its last start
    steps    [1]  ()  steps since then
    late     [1]  ()  ticks that the clock skipped
    lost     [1]  ()  driving messages that were skipped or did not arrive in time
    held     [1]  ()  inputs that were older than their tick requires
    state    [1]  ()  state of its life cycle
    median   [s]  ()  median duration of a step
    p99      [s]  ()  99th percentile of the duration of a step
    longest  [s]  ()  duration of the longest step
    age      [s]  ()  median time from the tick to the answer
    asleep   [1]  ()  steps at rest, in which its last answer was repeated
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
