"""A graph as an environment: actions set the velocity of a hand, observations have the contact force (docs/gym.md)."""

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar, NoReturn, Self

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict, Space

from palpate.gym.gradients import TOLERANCE, GradientLanes, parameters_of
from palpate.gym.hands import BOUNDS, ROOM, SPEED, Changes, Hand, hand_of, simulated_hands, within
from palpate.launch.load.arguments import Organ, describe_run
from palpate.launch.load.checks.ideal import OPTION
from palpate.launch.load.files import Override
from palpate.launch.load.values.source import YamlSource
from palpate.launch.run.notes import RunNote, first_of_each_kind, warn
from palpate.messages import Contact, Friction, Pose, Surface
from palpate.nodes.device.steered import Steered
from palpate.physics.errors import ArgumentError
from palpate.records.side_view import side_view
from palpate.stepping import Stepper, Tick


class Touch(gymnasium.Env[dict[str, np.ndarray], np.ndarray]):
    """A graph whose simulated hands follow the actions. The reward is 0; subclasses define tasks.

    graph     name of a shipped graph, or a path; it must contain device.Simulated
    ticks     ticks of the graph's clock in one step of the environment
    duration  [s] after which an episode is truncated
    scene     replaces the scene of the graph
    nodes     replaced node classes, as for `palpate.run`: {"tissue": "deformation.ReducedFE"}
    render_mode  "rgb_array": `render` returns a picture from the side; None: no pictures
    ideal     an ideal hand: no counts of an encoder and no jitter, as by `hand: {ideal: true}` in the scene
    gradient  settings of nodes, such as "tissue.stiffness": `info["gradient"]` has the derivatives of `force` by them
    tolerance  largest error of a derivative over its RMS; NaN replaces one with a larger error

    action       velocity of the hand's goal [m/s] (3), world frame
    observation  position [m] and velocity [m/s] (3) of the fingertip's bone edge, force [N] (3) of the tissue on the
                 finger, all in the world frame
    With several hands these are (h,3), one row per hand.

    A pickled environment is built again from its arguments, in the state before its first reset.

    PalpateError: the graph or an argument is invalid.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"]}
    units: ClassVar[dict[str, str]] = {"action": "m/s", "position": "m", "velocity": "m/s", "force": "N"}
    """Unit of the action and of each part of the observation."""
    wanted: ClassVar[tuple[str, ...]] = ()
    """Additional forces [N] of the observation, one number each."""

    _given: tuple[tuple[Any, ...], dict[str, Any]]
    """Arguments of the constructor, for pickling."""

    def __new__(cls, *args: Any, **given: Any) -> Self:
        env = super().__new__(cls)
        env._given = args, given
        return env

    def __init__(
        self,
        graph: str | Path = "kidney",
        ticks: int = 10,
        duration: float = 10.0,
        scene: str | None = None,
        nodes: Mapping[str, str | Mapping[str, Any]] | None = None,
        render_mode: str | None = None,
        organ: Organ = None,
        ideal: bool = False,
        gradient: Sequence[str] = (),
        tolerance: float = TOLERANCE,
    ) -> None:
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ArgumentError(f"render_mode: found {render_mode!r}, expected 'rgb_array' or None")
        self.render_mode = render_mode
        if isinstance(ticks, bool) or not isinstance(ticks, int) or not 1 <= ticks <= 1_000_000:
            raise ArgumentError(f"ticks: found {ticks!r}, expected a whole number from 1 to 1000000")
        if not 0.0 < duration < math.inf:
            raise ArgumentError(f"duration: found {duration!r}, expected a time [s] above 0")
        sets = [OPTION.removeprefix("--set ")] if ideal else []
        launch = describe_run(graph, scene=scene, duration=None, sets=sets, nodes=nodes or {}, organ=organ)
        devices = simulated_hands(launch.load())
        launch = replace(launch, overrides=tuple(map(_without_path, launch.overrides)))
        self.stepper = Stepper(launch.but(overrides=[f"{name}.use=device.Steered" for name in devices]))
        replaced = tuple(
            f"{name} ({Steered.__name__})" for name in devices
        )  # the path of the hand, which actions replace
        self.stepper.graph_notes = [note for note in self.stepper.graph_notes if not note.startswith(replaced)]
        self.hands = [hand_of(self.stepper.plan, name) for name in devices]
        self.ticks, self.duration = ticks, duration
        self.step_time = ticks / self.stepper.rate
        """[s] Duration of one step of the environment."""
        self.metadata = {**self.metadata, "render_fps": round(1.0 / self.step_time) or 1}
        self.tick: Tick | None = None
        """The graph after its last tick: `env.unwrapped.tick.tissue.displacement`."""
        self.shape = (3,) if len(devices) == 1 else (len(devices), 3)
        """Shape of the parts of the observation that each hand has."""
        self._steered = [node for node in map(self.stepper.node, devices) if isinstance(node, Steered)]
        self._begins = [node.begin for node in self._steered]
        self._started = False
        self.notes: list[RunNote] = []
        """What nodes report about the validity of their results, the first note of each kind; each is also a
        PalpateWarning. Collected at the end of an episode, at `reset` and at `close`."""
        self.gradient = tuple(each.path for each in parameters_of(self.stepper.plan, gradient))
        """The settings of `info["gradient"]`."""
        if not 0.0 < tolerance < 1.0:
            raise ArgumentError(f"tolerance: found {tolerance!r}, expected a number from 0 to 1")
        self.tolerance = tolerance
        self._lanes: GradientLanes | None = None
        parts: dict[str, Space[Any]] = {name: Box(-most, most, self.shape, np.float32) for name, most in BOUNDS.items()}
        parts |= {name: Box(0.0, BOUNDS["force"], (1,), np.float32) for name in self.wanted}
        self.observation_space: Space[Any] = Dict(parts)
        self.action_space: Space[Any] = Box(-SPEED, SPEED, self.shape, np.float32)

    def __reduce__(self) -> Any:
        args, given = self._given
        return functools.partial(type(self), **given), args

    def __copy__(self) -> NoReturn:
        """ArgumentError: a copy would share the state of the compiled nodes."""
        raise ArgumentError("a running environment cannot be copied; make another one with the same arguments")

    def __deepcopy__(self, memo: Any) -> NoReturn:
        """ArgumentError: see `__copy__`."""
        self.__copy__()

    # -- defined by tasks --------------------------------------------------------------------------------------------

    def draw_settings(self) -> Changes:
        """Settings of this episode by node, drawn from `self.np_random`."""
        return {}

    def judge(self, tick: Tick, action: np.ndarray) -> tuple[float, bool, dict[str, Any]]:
        """Reward of a step, whether the task is over, and the entries of `info`."""
        return 0.0, False, {}

    def targets(self) -> dict[str, float]:
        """The values of `wanted` in this episode."""
        return {}

    def setting(self, node: str, name: str) -> Any:
        """A setting of a node in this episode."""
        return getattr(self.stepper.node(node), name)

    def begin(self, seed: int | None, options: Mapping[str, Any] | None) -> Changes:
        """Draw an episode and return its settings."""
        super().reset(seed=seed)
        changes = self.draw_settings()
        for node, values in (options or {}).items():
            changes[node] = {**changes.get(node, {}), **values}
        return changes

    # -- Gymnasium's interface ---------------------------------------------------------------------------------------

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Begin an episode: draw its settings, restart every node, and run one tick.

        `options`: settings by node that override the drawn ones, {"tissue": {"stiffness": 200}}.
        """
        changes = self.begin(seed, options)
        if not self._started:
            self.stepper.start()
            self._started = True
        self._warn()
        self.stepper.restart(changes)
        for held in self._steered:
            low, high = (np.add(held.begin, corner).tolist() for corner in ROOM)
            held.keep_within(low, high)
        self.tick = self.stepper.tick()
        info: dict[str, Any] = {"time": self.tick.time}
        if self.gradient:
            self._lanes = self._lanes or GradientLanes(
                self.stepper, self.hands, self.shape, self.gradient, 1, self.tolerance
            )
            self._lanes.begin(0, changes)
            info |= self._lanes.info()
        return self._observe_tick(self.tick), info

    def step(self, action: np.ndarray) -> tuple[dict[str, np.ndarray], float, bool, bool, dict[str, Any]]:
        """Run `ticks` ticks with this action. ArgumentError: no reset before, a wrong shape, or a NaN."""
        if self.tick is None:
            raise ArgumentError("step: there is no episode; call reset() first")
        action = np.asarray(action, float)
        if action.shape != self.action_space.shape or not np.isfinite(action).all():
            raise ArgumentError(f"action: found {action.tolist()}, expected {self.action_space.shape} finite numbers")
        speeds = within(action.ravel().tolist(), SPEED)
        for number, node in enumerate(self._steered):
            node.steer(speeds[3 * number : 3 * number + 3])
        stepper = self.stepper
        for _ in range(self.ticks):
            self.tick = stepper.tick()
        tick = self.tick
        reward, over, info = self.judge(tick, action)
        info["time"] = tick.time
        if self._lanes is not None:
            self._lanes.step(speeds, self.ticks)
            self._lanes.collect([0])
            info |= self._lanes.info()
        late = not over and tick.time >= self.duration
        if over or late:
            self._warn()
        return self._observe_tick(tick), reward, over, late, info

    def render(self) -> np.ndarray | None:
        """Picture (240,320,3) of the scene from the side, see `records.side_view`; None without a `render_mode`.

        ArgumentError: no reset before.
        """
        if self.render_mode is None:
            return None
        if self.tick is None:
            raise ArgumentError("render: there is no episode; call reset() first")
        tick, fingers = self.tick, [self._finger_state(self.tick, hand) for hand in self.hands]
        shapes = []
        for name in self.stepper.plan.order:
            node = self.stepper.node(name)
            for stream in self.stepper.plan.graph.nodes[name].streams:
                surface = tick[stream]
                if isinstance(surface, Surface) and hasattr(node, "mesh"):
                    shapes.append(np.array(node.mesh().vertices))
                    shapes[-1][surface.nodes] += surface.displacement
        return side_view(shapes, [(position, force) for position, _, force in fingers], self._begins)

    def close(self) -> None:
        """Stop all nodes."""
        if self._started:
            self._warn()
            self._started, self.tick = False, None
            self.stepper.stop()
        if self._lanes is not None:
            self._lanes.close()
            self._lanes = None

    def _warn(self) -> None:
        """Keep the new notes whose kind is new, and warn about them."""
        known = {note.kind for note in self.notes}
        new = [note for note in first_of_each_kind(self.stepper.notes()) if note.kind not in known]
        self.notes += new
        warn(new, level=4)

    # -- observation -------------------------------------------------------------------------------------------------

    def contact_of(self, tick: Tick, hand: Hand) -> Contact:
        """The contact of a hand."""
        contact = tick[hand.contact]
        assert isinstance(contact, Contact)
        return contact

    def _observe_tick(self, tick: Tick) -> dict[str, np.ndarray]:
        felt = [self._finger_state(tick, hand) for hand in self.hands]
        parts = {
            name: np.array([within(values[place], most) for values in felt], np.float32).reshape(self.shape)
            for place, (name, most) in enumerate(BOUNDS.items())
        }
        return parts | {name: np.array([value], np.float32) for name, value in self.targets().items()}

    def _finger_state(self, tick: Tick, hand: Hand) -> tuple[Any, Any, Any]:
        """Position, velocity and force f_n n - f_t + a of a finger."""
        pose, contact = tick[hand.pose], self.contact_of(tick, hand)
        assert isinstance(pose, Pose)
        friction = tick[hand.friction] if hand.friction is not None else None
        p = friction.force if isinstance(friction, Friction) else (0.0, 0.0, 0.0)
        f, n, a = contact.force, contact.normal, contact.lateral_force
        force = (f * n[0] - p[0] + a[0], f * n[1] - p[1] + a[1], f * n[2] - p[2] + a[2])
        return pose.position, pose.velocity, force


def _without_path(override: str | Override) -> str | Override:
    """Leaves out the path of the hand along an organ, which no node reads: the actions replace it."""
    if isinstance(override, str) or override.keys != ("scene", "hand"):
        return override
    begin = {key: value for key, value in override.value.data.items() if key != "path"}
    return replace(override, value=YamlSource(begin, {(): override.place}))
