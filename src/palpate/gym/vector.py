"""Parallel environments as lanes of an ensemble (launch/run/lanes.py), stepped in blocks of ticks.

envs = gymnasium.make_vec("palpate/Press-v0", num_envs=256, vectorization_mode="vector_entry_point")
"""

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from palpate.compiler.cores import usable_cores
from palpate.engine.lanes import Lanes
from palpate.gym.find_nodule import FindNodule
from palpate.gym.gradients import GradientLanes
from palpate.gym.hands import BOUNDS, SPEED
from palpate.gym.lanes import TaskLanes
from palpate.gym.press import Press
from palpate.gym.touch import Touch
from palpate.launch.run.lane_threads import FIRST, LaneThreads, Work, adapt_block
from palpate.launch.run.notes import first_of_each_kind, warn
from palpate.physics.errors import ArgumentError
from palpate.stepping import Tick

CHUNKS = 4  # groups of lanes per thread


class VectorTouch(VectorEnv):
    """Environments of one task, one lane with separate settings each; results equal those of single environments bit
    for bit. After Ctrl-C in a step no thread runs, and the next call is `reset`. A forked process starts new threads.

    task      class of the environments, a subclass of `Touch`
    num_envs  number of environments
    threads   None: one per core
    max_episode_steps  number of steps after which an episode is truncated, as by `gymnasium.make`; None: its duration
    given     arguments of the task, except `render_mode`

    After the end of an episode the next `step` resets the environment and ignores its action (`NEXT_STEP`).

    PalpateError: the graph or an argument is invalid, or a node is not compiled.
    """

    metadata: dict[str, Any] = {"autoreset_mode": AutoresetMode.NEXT_STEP}

    def __init__(
        self,
        task: type[Touch],
        num_envs: int = 1,
        threads: int | None = None,
        max_episode_steps: int | None = None,
        **given: Any,
    ) -> None:
        for name, number in (("num_envs", num_envs), ("max_episode_steps", max_episode_steps)):
            missing = number is None and name == "max_episode_steps"
            if not missing and (isinstance(number, bool) or not isinstance(number, int) or number < 1):
                raise ArgumentError(f"{name}: found {number!r}, expected a whole number from 1")
        self._most, self._steps = max_episode_steps, np.zeros(num_envs, np.int64)
        self.num_envs, first = num_envs, task(**given)
        self.tasks = [first, *(_alike(first) for _ in range(num_envs - 1))]
        """The environments, whose nodes do not run."""
        self._all = TaskLanes(first.stepper, first.hands, first.shape, num_envs)
        self._lanes, self._ticks, self._gradient = self._all.lanes, first.ticks, None
        if first.gradient:
            given_to = first.stepper, first.hands, first.shape, first.gradient
            self._gradient = GradientLanes(*given_to, num_envs, first.tolerance)
        self._views: list[Any] = [None] * num_envs
        self._over: np.ndarray | None = None
        count = min(num_envs, CHUNKS * (threads or len(usable_cores())))
        self._chunks = np.array_split(np.arange(num_envs), count)
        self._threads = LaneThreads(threads or len(usable_cores()))
        self._block = FIRST  # ticks of one call of compiled code
        self.single_observation_space, self.single_action_space = first.observation_space, first.action_space
        self.observation_space = batch_space(first.observation_space, num_envs)
        self.action_space = batch_space(first.action_space, num_envs)
        self.units = first.units
        self.notes = list(first.stepper.graph_notes)
        """As of `Touch.notes`, those of a node with `lane`, the number of the environment."""
        warn(self.notes)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Begin an episode in each environment, as `Touch.reset`; environment i gets `seed[i]`, or `seed` + i.

        `options`: settings by node for all environments; `reset_mask`, an array of `num_envs` flags: only these begin,
        the others continue.
        """
        self._open("reset")
        settings, mask = dict(options or {}), np.ones(self.num_envs, bool)
        if "reset_mask" in settings:
            mask = self._mask(settings.pop("reset_mask"))
        seeds: Sequence[int | None] = seed if isinstance(seed, Sequence) else [seed] * self.num_envs
        if isinstance(seed, int):
            seeds = range(seed, seed + self.num_envs)
        if len(seeds) != self.num_envs:
            raise ArgumentError(f"seed: found {len(seeds)} numbers, expected {self.num_envs}")
        over, self._over = self._over, None
        for lane in np.flatnonzero(mask).tolist():
            self._begin(lane, seeds[lane], settings)
        self._over = np.zeros(self.num_envs, bool) if over is None else over & ~mask
        infos = {"time": self._times(), "_time": mask}
        return self._observe_all(), infos | (self._gradient.infos(mask) if self._gradient else {})

    def _open(self, call: str) -> None:
        """ArgumentError: the environments are closed."""
        if self.closed:
            raise ArgumentError(f"{call}: the environments are closed; make new ones")

    def _mask(self, given: Any) -> np.ndarray:
        """The environments to reset. ArgumentError: not one flag for each, or one without an episode is left out."""
        mask = np.asarray(given)
        if mask.dtype != bool or mask.shape != (self.num_envs,) or not mask.any():
            raise ArgumentError(
                f"options: reset_mask: found {mask.dtype} of the shape {mask.shape}, {np.count_nonzero(mask)} set; "
                f"expected {self.num_envs} flags, at least one of them set"
            )
        if self._over is None and not mask.all():
            raise ArgumentError("options: reset_mask: there is no episode to continue; call reset() without it first")
        return mask

    def step(self, actions: Any) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Run `ticks` ticks in all environments. ArgumentError: no reset before, a wrong shape, or a NaN."""
        self._open("step")
        if self._over is None:
            raise ArgumentError("step: there is no episode; call reset() first")
        actions = np.asarray(actions, float)
        if actions.shape != self.action_space.shape:
            raise ArgumentError(f"actions: found {actions.shape}, expected {self.action_space.shape} finite numbers")
        wrong = np.flatnonzero(~np.isfinite(actions.reshape(self.num_envs, -1)).all(axis=1))
        if len(wrong):
            more = f" and {len(wrong) - 1} more" if len(wrong) > 1 else ""
            raise ArgumentError(
                f"actions: environment {wrong[0]}{more}: found {actions[wrong[0]].tolist()}, expected finite numbers"
            )
        speeds = np.clip(actions.reshape(self.num_envs, -1), -SPEED, SPEED)
        restarted = self._over
        for number, speed in enumerate(speeds):
            self._all.steer(number, speed)
        before = self._lanes.ticks.copy()
        self._over = None  # until all lanes have run
        if restarted.any():
            for lane in np.flatnonzero(restarted):
                self._begin(int(lane), None, None)
            parts = [(int(lane), 1) for lane in np.flatnonzero(~restarted)]
        else:
            parts = [(int(chunk[0]), len(chunk)) for chunk in self._chunks]
        works = [self._work(self._lanes, *part) for part in parts]
        if self._gradient:
            spans = self._gradient.steer({int(lane): speeds[lane] for lane in np.flatnonzero(~restarted)})
            works += [self._work(self._gradient.lanes, *span) for span in spans]
        self._threads.run(works)
        self._all.check(np.flatnonzero(~restarted & (self._lanes.ticks != before + self._ticks)))
        return self._judge_step(actions, restarted)

    def _work(self, lanes: Lanes, first: int, count: int) -> Work:
        """A step of `count` lanes from `first` on, in calls of about `lane_threads.BLOCK` at most."""

        def work(stopped: Callable[[], bool]) -> None:
            now, block = 0, self._block
            while now < self._ticks and not stopped():
                ticks, begun = min(block, self._ticks - now), time.perf_counter()
                lanes.run(first, count, ticks)
                now, block = now + ticks, adapt_block(block, time.perf_counter() - begun)
            self._block = min(block, self._ticks)

        return work

    def close_extras(self, **kwargs: Any) -> None:
        """Stop all nodes."""
        for lane in range(self.num_envs):
            self._note(lane)
        self._threads.close()
        self._all.close()
        if self._gradient:
            self._gradient.close()

    # -- lanes -------------------------------------------------------------------------------------------------------

    def _begin(self, lane: int, seed: int | None, options: Mapping[str, Any] | None) -> None:
        """Begin an episode in an environment, with one tick."""
        self._note(lane)
        self._steps[lane] = 0
        task = self.tasks[lane]
        changes = task.begin(seed, options)
        unknown = set(changes) - {slot.name for slot in self._all.slots}
        if unknown:
            task.stepper.node(min(unknown))  # raises an error that lists the nodes
        there = self._all.begin(lane, changes)
        nodes: dict[str, Any] = {slot.name: slot.node for slot in self._all.slots}
        task.setting = lambda node, name: there[node].get(name, getattr(nodes[node], name))  # type: ignore[method-assign]
        self._views[lane] = self._all.view(lane)
        if self._gradient:
            self._gradient.begin(lane, changes)

    def _note(self, lane: int) -> None:
        """Keep the new notes of an environment whose kind is new, and warn about them."""
        if self._views[lane] is None:  # before its first episode
            return
        known = {note.kind for note in self.notes}
        time = float(self._times()[lane])
        found = self._all.notes(lane, time)
        new = [note for note in first_of_each_kind(found) if note.kind not in known]
        self.notes += new
        warn(new, level=5, what="environment")

    # -- observation -------------------------------------------------------------------------------------------------

    def _times(self) -> np.ndarray:
        rate = self.tasks[0].stepper.rate
        return np.rint((self._lanes.ticks - 1) * 1e9 / rate) * 1e-9

    def _judge_step(self, actions: np.ndarray, restarted: np.ndarray) -> Any:
        """Observations, rewards, ends and infos after a step, which has reset the environments `restarted`."""
        count, times = self.num_envs, self._times()
        rewards, over = np.zeros(count), np.zeros(count, bool)
        infos: dict[str, Any] = {"time": times, "_time": np.ones(count, bool)}
        for lane, task in enumerate(self.tasks):
            if restarted[lane]:
                continue
            tick = Tick(self._views[lane], int(self._lanes.ticks[lane]) - 1)
            rewards[lane], over[lane], info = task.judge(tick, actions[lane])
            for key, value in info.items():
                if key not in infos:
                    infos[key] = np.zeros(count, type(value) if isinstance(value, bool | int | float) else object)
                    infos[f"_{key}"] = np.zeros(count, bool)
                infos[key][lane], infos[f"_{key}"][lane] = value, True
        if self._gradient:
            self._gradient.collect(np.flatnonzero(~restarted).tolist())
            infos |= self._gradient.infos(~restarted)
        self._steps += ~restarted
        late = ~over & ~restarted & (times >= self.tasks[0].duration)
        if self._most is not None:  # as gymnasium's TimeLimit, also at the end of an episode
            late |= ~restarted & (self._steps >= self._most)
        self._over = over | late
        return self._observe_all(), rewards, over, late, infos

    def _observe_all(self) -> dict[str, np.ndarray]:
        parts = {
            name: np.clip(rows, -BOUNDS[name], BOUNDS[name]).astype(np.float32)
            for name, rows in self._all.observe().items()
        }
        wanted = [task.targets() for task in self.tasks] if self.tasks[0].wanted else []
        return parts | {name: np.array([[one[name]] for one in wanted], np.float32) for name in self.tasks[0].wanted}


def _alike(task: Touch) -> Touch:
    """An environment for another lane: it shares the parts of the first one except the random numbers."""
    other = object.__new__(type(task))
    other.__dict__.update(task.__dict__)
    return other


def make_find_nodule(num_envs: int = 1, **given: Any) -> gymnasium.vector.VectorEnv:
    """Parallel environments of `palpate/FindNodule-v0`."""
    return VectorTouch(FindNodule, num_envs, **given)


def make_press(num_envs: int = 1, **given: Any) -> gymnasium.vector.VectorEnv:
    """Parallel environments of `palpate/Press-v0`."""
    return VectorTouch(Press, num_envs, **given)


def make_touch(num_envs: int = 1, **given: Any) -> gymnasium.vector.VectorEnv:
    """Parallel environments of `palpate/Touch-v0`."""
    return VectorTouch(Touch, num_envs, **given)
