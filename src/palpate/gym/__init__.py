"""Touch as an environment for learning, after Gymnasium's interface (docs/gym.md).

import gymnasium
import palpate.gym  # registers palpate/Touch-v0, palpate/FindNodule-v0 and palpate/Press-v0

env = gymnasium.make("palpate/FindNodule-v0")
observation, info = env.reset(seed=1)
observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
"""

from typing import TYPE_CHECKING, Any

from palpate.physics.errors import MISUSE, PalpateError
from palpate.physics.extras import missing

if TYPE_CHECKING:
    from palpate.gym.find_nodule import FindNodule
    from palpate.gym.press import Press
    from palpate.gym.touch import Touch


class GymError(PalpateError, ImportError):
    """The package `gymnasium` is missing; the message has the command that installs it."""

    exit_code = MISUSE


try:
    import gymnasium
except ImportError as error:
    raise GymError(missing("palpate.gym", error.name, "gym")) from None

_HOMES = {"Touch": "touch", "FindNodule": "find_nodule", "Press": "press"}
__all__ = ["FindNodule", "Press", "Touch"]

for _name, _file in _HOMES.items():
    if f"palpate/{_name}-v0" not in gymnasium.registry:
        gymnasium.register(
            f"palpate/{_name}-v0",
            entry_point=f"palpate.gym.{_file}:{_name}",
            vector_entry_point=f"palpate.gym.vector:make_{_file}",
        )


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        from importlib import import_module

        return getattr(import_module(f"palpate.gym.{_HOMES[name]}"), name)
    raise AttributeError(f"module 'palpate.gym' has no attribute {name!r}; it has {', '.join(__all__)}")
