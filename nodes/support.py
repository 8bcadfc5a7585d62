"""Organs that move, as prescribed or on a foundation of springs, and the finger in their frame
(docs/equations/moving-organs.md)."""

import json
from typing import Annotated, Any, Literal

import msgspec
import numpy as np

from palpate.compiler.dot import dot
from palpate.compiler.exact import length
from palpate.compiler.records import floats, integers, lend, lend_first, nth, put, vector
from palpate.messages import Contact, Force, Friction, Pose, Surface, Vector3
from palpate.messages.contact import OrganContact
from palpate.messages.record import ROOM
from palpate.messages.tissue import Support
from palpate.nodes.base import ARRAY, TABLE, CompiledNode, InputError, Out, SettingError, Wants
from palpate.nodes.base.absence import PACE, gap_of, keep_pace
from palpate.nodes.base.kernels import kernel
from palpate.nodes.base.surface import OnThinnedSurface
from palpate.nodes.contact.joint import law_for
from palpate.nodes.contact.series import LAW
from palpate.nodes.device.path import Segment, ends_of, points_of, shapes_of
from palpate.physics.bodies.carried import displacement
from palpate.physics.bodies.floating.added_inertia import added_inertia, contact_stiffness
from palpate.physics.bodies.floating.foundation import FIELDS, MOTION, Constants, plus, scaled
from palpate.physics.bodies.floating.foundation import step as move
from palpate.physics.bodies.floating.mobility import look_ahead
from palpate.physics.bodies.floating.solid import centre_of
from palpate.physics.bodies.floating.turning import cross, moment_on, spin, turned, turned_back
from palpate.physics.bodies.floating.twisting import twist

REST: Vector3 = (0.0, 0.0, 0.0)
GRAVITY = 9.80665  # [m/s^2] standard gravity
HEAVY = 0.1  # [1] Added mass over that of an organ above which a note is printed
NO_LAW = 1  # fault: more contacts than laws of fingers
RIGID = (0.0, 0.0, 0.0, 0.0, 0.0)  # terminal law of a body that has sent none


class Moving(CompiledNode):
    """A motion of organs with their elastic foundations: d = amplitude w(t/period) + path, and the rotation vector
    r = rotation w(t/period) + turns about a pivot.

    moves      names of the bodies that move; the loader connects them (scene key `motions`)
    amplitude  displacement from exhalation to inhalation
    period     of a breath
    waveform   `sine`: sin²(pi t/period); `breathing`: its square, which stays longer near exhalation
    path       displacements, as the path of a hand: `{to: [0, 0.01, 0], time: 0.5}`, `{hold: 0.2}`; it begins at rest
               at zero, and ends at its last displacement
    rotation   amplitude of the rotation vector, axis times angle
    turns      rotation vectors, as the path: `{to: [0, 0.2, 0], time: 0.5}` [rad]
    pivot      point of the world at the start about which the organs rotate, then displaced by d

    During a pause of its process the motion also pauses, as that of a simulated hand.
    """

    paced = True

    moves: Annotated[tuple[str, ...], "1"] = ()
    amplitude: Annotated[Vector3, "m"] = REST
    period: Annotated[float, "s", msgspec.Meta(ge=0.05, le=1e6)] = 4.0
    waveform: Annotated[Literal["sine", "breathing"], "1"] = "sine"
    path: Annotated[tuple[Segment, ...], "1"] = ()
    rotation: Annotated[Vector3, "rad"] = REST
    turns: Annotated[tuple[Segment, ...], "1"] = ()
    pivot: Annotated[Vector3, "m"] = REST

    State = {
        "ends": ARRAY, "points": TABLE, "shapes": ARRAY, "pace": PACE, "begun": bool, "clock": (), "last": (3,),
        "turn_ends": ARRAY, "turn_points": TABLE, "turn_shapes": ARRAY, "turning": bool, "last_turn": (3,),
        "turned": ARRAY, "spins": ARRAY, "middle": ARRAY,
    }  # fmt: skip
    """The path; time [s] since the start, and the last displacement [m]; the same of the rotation [rad]; what is sent
    of it."""
    shared = ("ends", "points", "shapes", "turn_ends", "turn_points", "turn_shapes")

    def start(self) -> None:
        super().start()
        for name, path in (("", self.path), ("turn_", self.turns)):
            self.hold(f"{name}ends", ends_of(path))
            self.hold(f"{name}points", np.ascontiguousarray(points_of(REST, path)))
            self.hold(f"{name}shapes", shapes_of(path))
        self.own["turning"] = bool(self.turns) or tuple(self.rotation) != REST
        for name, value in (("turned", np.zeros(3)), ("spins", np.zeros(3)), ("middle", np.array(self.pivot, float))):
            self.hold(name, value)

    @kernel
    def compute(own, out: Out[Support], dt):
        if keep_pace(own.pace, dt):
            dt = own.pace.usual
        if own.begun:
            own.clock += dt
        own.begun = True
        d = displacement(
            own.clock, vector(own.amplitude), own.period, 1 + own.waveform, floats(own.ends), floats(own.points),
            integers(own.shapes),
        )  # fmt: skip
        last = vector(own.last)
        put(out.displacement, d)
        put(out.velocity, ((d[0] - last[0]) / dt, (d[1] - last[1]) / dt, (d[2] - last[2]) / dt))
        put(own.last, d)
        if own.turning:
            r = displacement(
                own.clock, vector(own.rotation), own.period, 1 + own.waveform, floats(own.turn_ends),
                floats(own.turn_points), integers(own.turn_shapes),
            )  # fmt: skip
            half, rate = plus(r, vector(own.last_turn)), plus(r, scaled(-1.0, vector(own.last_turn)))
            put(floats(own.turned), r)
            put(floats(own.spins), spin(scaled(0.5, half), scaled(1.0 / dt, rate)))
            put(own.last_turn, r)
            lend(out.rotation, own.turned)
            lend(out.spin, own.spins)
            lend(out.centre, own.middle)


class Relative(CompiledNode):
    """The finger in the frame of organs that move: its pose less the displacement of their foundation, turned back by
    the rotation of an organ on its foundation.

    Collision, contact, friction, controller and energy balance then work in this frame, in which the organs are at
    rest. The forces are the same in both, except for the rotation (support.Absolute).
    """

    State = {"at": (3,), "turn": (3,), "centre": (3,), "gap": ARRAY}
    """Of the last support, which stays while it is missing: displacement [m], rotation [rad] about this point [m];
    `gap` [m] from the pose to the device."""

    def start(self) -> None:
        super().start()
        self.hold("gap", np.zeros(3))

    @kernel
    def compute(own, pose: Pose, support: Support | None, out: Out[Pose], dt):
        out.delayed, out.dt = pose.delayed, pose.dt
        put(out.velocity, vector(pose.velocity))
        if support.there:
            put(own.at, vector(support.displacement))
        for i in range(3):
            out.position[i] = pose.position[i] - own.at[i]
            if support.there:
                out.velocity[i] -= support.velocity[i]
        if support.there and support.rotation.shape[0] > 0:
            put(own.turn, vector(floats(support.rotation)))
            put(own.centre, vector(floats(support.centre)))
        r, c = vector(own.turn), vector(own.centre)
        put(floats(own.gap), turned_back(r, gap_of(pose)))
        lend_first(out.behind, own.gap, pose.behind.shape[0])
        if r == REST:
            return
        arm = (out.position[0] - c[0], out.position[1] - c[1], out.position[2] - c[2])
        v = vector(out.velocity)
        if support.there and support.spin.shape[0] > 0:
            # the mean velocity of the step, at the place and in the axes of its middle
            w = vector(floats(support.spin))
            v = plus(v, scaled(-1.0, cross(w, plus(arm, scaled(-0.5 * dt, v)))))
            v = turned(scaled(0.5 * dt, w), v)
        x, y, z = turned_back(r, arm)
        put(out.position, (c[0] + x, c[1] + y, c[2] + z))
        put(out.velocity, turned_back(r, v))


class Absolute(CompiledNode):
    """The force on a hand that is computed in the frame of an organ which rotates, in that of the world."""

    State = {"turn": (3,)}  # [rad] rotation of the last support, which stays while it is missing

    @kernel
    def compute(own, force: Force, support: Annotated[Support | None, Wants("rotation")], out: Out[Force], dt):
        if support.there and support.rotation.shape[0] > 0:
            put(own.turn, vector(floats(support.rotation)))
        out.delayed, out.state, out.energy = force.delayed, force.state, force.energy
        put(out.force, turned(vector(own.turn), vector(force.force)))


class World(CompiledNode):
    """Contact and friction on an organ that rotates, which are computed in its frame, in that of the world: for a
    finger on several organs (`contact.Sum`)."""

    State = {"at": (3,), "turn": (3,), "centre": (3,), "whole": ARRAY, "generated": ARRAY}
    """Of the last support, which stays while it is missing."""

    def start(self) -> None:
        super().start()
        self.hold("whole", np.zeros(1))
        self.hold("generated", np.zeros(1))

    @kernel
    def compute(
        own,
        contact: Contact,
        friction: Friction | None,
        support: Annotated[Support | None, Wants("displacement", "rotation", "centre")],
        out: Out[Contact],
        rubbed: Out[Friction],
        dt,
    ):
        if support.there:
            put(own.at, vector(support.displacement))
            if support.rotation.shape[0] > 0:
                put(own.turn, vector(floats(support.rotation)))
                put(own.centre, vector(floats(support.centre)))
        r, c, d, foot = vector(own.turn), vector(own.centre), vector(own.at), contact.foot
        arm = turned(r, (foot[0] - c[0], foot[1] - c[1], foot[2] - c[2]))
        put(out.foot, (c[0] + d[0] + arm[0], c[1] + d[1] + arm[1], c[2] + d[2] + arm[2]))
        put(out.normal, turned(r, vector(contact.normal)))
        put(out.lateral_force, turned(r, vector(contact.lateral_force)))
        out.delayed = rubbed.delayed = contact.delayed
        out.force, out.compression, out.indentation = contact.force, contact.compression, contact.indentation
        out.compression_rate, out.indentation_rate = contact.compression_rate, contact.indentation_rate
        out.stored.count, out.stored.values[0] = contact.stored.count, contact.stored.values[0]
        if contact.whole.shape[0] > 0:
            floats(own.whole)[0] = floats(contact.whole)[0]
        lend_first(out.whole, own.whole, contact.whole.shape[0])
        if contact.generated.shape[0] > 0:
            floats(own.generated)[0] = floats(contact.generated)[0]
        lend_first(out.generated, own.generated, contact.generated.shape[0])
        put(rubbed.force, REST)
        put(rubbed.bristle, REST)
        rubbed.stick, rubbed.stored.count = True, 0
        if friction.there:
            put(rubbed.force, turned(r, vector(friction.force)))
            put(rubbed.bristle, turned(r, vector(friction.bristle)))
            rubbed.stick, rubbed.stored.count = friction.stick, friction.stored.count
            rubbed.stored.values[0] = friction.stored.values[0]


@kernel
def pushed(own, organs):
    """Force [N] (3) of all organs that touch an organ, and moment [N m] (3) about its centre, in the world."""
    force = moment = REST
    sides = integers(own.at_side)
    for i in range(min(organs.count, len(sides))):
        each = nth(organs, i)
        if not each.there or not each.force > 0.0:
            continue
        force = plus(force, scaled(1.0 if sides[i] == 0 else -1.0, vector(each.resultant)))
        if each.torques.shape[0] == 2:
            moment = plus(moment, vector(floats(each.torques)[sides[i]]))
    return force, moment


@kernel
def pressed(own, contact, friction, pose, body, alone, dt):
    """Force [N] (3) of all fingers on an organ, and moment [N m] (3) about its centre, in the world; stiffness of their
    contacts in all [N/m] and against rotation [N m/rad], of the fingertips if the organ is not `alone`: others that
    touch it may make it as stiff. Fingers do not rotate."""
    force = moment = REST
    stiffness = turning = 0.0
    r, laws = vector(own.motion.turn), len(floats(body.laws))
    rates = turned_back(r, spin(r, vector(own.motion.rate)))
    tips, sticks, twists = floats(own.tip_laws), floats(own.stick_laws), floats(own.twist_laws)
    for i in range(contact.count):
        each, place, c = nth(contact, i), nth(pose, i).position, own.centre
        n, a, f = vector(each.normal), vector(each.lateral_force), each.force
        on = (-f * n[0] - a[0], -f * n[1] - a[1], -f * n[2] - a[2])
        if i < friction.count and nth(friction, i).there:
            on = plus(on, vector(nth(friction, i).force))
        arm = (place[0] - c[0], place[1] - c[1], place[2] - c[2])
        limit, wide = twists[i, 0] * f, twists[i, 1]
        spring, damper = wide * (sticks[i, 0] + f * sticks[i, 2]), wide * (sticks[i, 1] + f * sticks[i, 3])
        wring = 0.0
        if limit > 0.0:
            about = rates[0] * n[0] + rates[1] * n[1] + rates[2] * n[2]
            wring, own.twisted[i] = twist(own.twisted[i], about, spring, damper, limit, dt)
            turning += spring + damper / dt
        else:
            own.twisted[i] = 0.0
        force, moment = plus(force, on), plus(plus(moment, cross(arm, on)), scaled(-wring, n))
        law = law_for(body, i < laws, i) if body.there and alone else RIGID
        stiff = contact_stiffness(f, each.compression, each.indentation, tips[i], sticks[i], law, dt)
        stiffness += stiff
        turning += stiff * (arm[0] * arm[0] + arm[1] * arm[1] + arm[2] * arm[2])
    return turned(r, force), turned(r, moment), stiffness, turning


@kernel
def settle(own, force, moment, stiffness, turning, out, dt):
    """Move an organ by a step under a force and a moment in the world; `stiffness` and `turning` of the fingers'
    contacts."""
    before = own.added[0], own.added[1]
    own.added[0], own.added[1] = added_inertia(before[0], stiffness, dt), added_inertia(before[1], turning, dt)
    own.heaviest = max(own.heaviest, own.added[0])
    motion = own.motion
    about = moment_on(vector(motion.turn), moment)
    move(own.constants, vector(own.axis), motion, force, about, before, (own.added[0], own.added[1]), dt)
    put(out.displacement, vector(motion.at))
    put(out.velocity, vector(motion.speed))
    put(floats(own.turned), vector(motion.turn))
    put(floats(own.spins), spin(vector(motion.turn), vector(motion.rate)))
    lend(out.rotation, own.turned)
    lend(out.spin, own.spins)
    lend(out.centre, own.middle)


@kernel
def foresee(own, force, moment, push, out, dt):
    """Fill what other organs that touch it need: its motion in the next step, if force and moment stay in the world,
    and its mobility. `push` [N] (3): their force."""
    about = moment_on(vector(own.motion.turn), moment)
    look_ahead(
        own.constants, vector(own.axis), own.motion, own.ahead, force, about, (own.added[0], own.added[1]),
        dot(push, vector(own.axis)) < 0.0, dt, floats(own.expected)[0], floats(own.mobility),
    )  # fmt: skip
    lend(out.expected, own.expected)
    lend(out.mobility, own.mobility)


class Foundation(CompiledNode):
    """An organ as a rigid mass with six freedoms on a foundation of springs and dampers, moved by fingers and by other
    organs that touch it (docs/equations/moving-organs.md).

    moves      name of its body; the loader connects it with the contacts of the body (scene key `foundations`)
    mass       of the organ, homogeneous in its surface
    stiffness, damping  of the foundation along `up`
    shear      stiffness and damping across `up` over those along it; 2/3: an incompressible half-space (Mindlin 1949)
    footprint  radius of the disc on which the organ lies, which resists tilt and twist
    up         direction out of the foundation, against gravity
    attached   true: the foundation pulls too; false: the organ lies on it by its weight, can be lifted off and dropped
    friction   of a loose organ on its foundation
    shape      surface of the organ, as JSON; set by the loader
    tips, sticks, twists  of the fingers in the order of the contacts, set by the loader: laws of the fingertips (5) and
               of their friction (4), from which the stable step follows (`physics.bodies.floating.added_inertia`);
               greatest moment per newton [m] and mean square radius [m²] of the patches, which resist twist
               (`floating.twisting`)
    sides      of the contacts with other organs, in their order: 0, it is the first body; 1, the second; set by the
               loader

    The contact of a finger answers to the motion of a step in the next one. While fingers press, the step therefore
    adds mass to the organ, T² times the stiffness of the contacts; a note reports more than 10 % of its mass. A contact
    with another organ answers in the same step (`physics.contact.organs.rigid_motion`), and needs no mass.
    """

    moves: Annotated[tuple[str, ...], "1"] = ()
    mass: Annotated[float, "kg", msgspec.Meta(ge=1e-6, le=1e3)]
    stiffness: Annotated[float, "N/m", msgspec.Meta(gt=0, le=1e9)]
    damping: Annotated[float, "N s/m", msgspec.Meta(ge=0, le=1e9)] = 0.0
    shear: Annotated[float, "1", msgspec.Meta(gt=0, le=1e3)] = 2.0 / 3.0
    footprint: Annotated[float, "m", msgspec.Meta(gt=0, le=10)] = 0.03
    up: Annotated[Vector3, "1"] = (0.0, 0.0, 1.0)
    attached: Annotated[bool, "1"] = True
    friction: Annotated[float, "1", msgspec.Meta(ge=0, le=10)] = 0.3
    shape: Annotated[str, "1"] = ""
    tips: Annotated[tuple[tuple[float, ...], ...], "1"] = ()
    sticks: Annotated[tuple[tuple[float, ...], ...], "1"] = ()
    twists: Annotated[tuple[tuple[float, ...], ...], "1"] = ()
    sides: Annotated[tuple[int, ...], "1"] = ()

    State = {
        "constants": FIELDS, "axis": (3,), "centre": (3,), "motion": MOTION, "added": (2,), "heaviest": (),
        "tip_laws": TABLE, "stick_laws": TABLE, "twist_laws": TABLE, "twisted": (ROOM,), "pace": PACE,
        "turned": ARRAY, "spins": ARRAY, "middle": ARRAY,  # of the message that is sent
        "at_side": ARRAY, "ahead": MOTION, "expected": TABLE, "mobility": TABLE,
    }  # fmt: skip
    """The constants; u; centre of mass at the start [m]; inertia that the step adds [kg], [kg m²], and its largest
    mass; `tips`, `sticks` and `twists`; twist of each patch [rad]; `sides`; the motion in the next step, and what is
    sent of it."""

    def __init__(self, **given: Any) -> None:
        super().__init__(**given)
        if not 0.0 < length(np.array(self.up)) < np.inf:
            raise SettingError(
                f"setting 'up': found {list(self.up)}, expected the direction out of the foundation, such as [0, 0, 1]"
            )

    def start(self) -> None:
        super().start()
        centre, gyration = self._solid()
        base = Constants(
            self.mass, self.mass * gyration**2, 0.0 if self.attached else GRAVITY * self.mass, self.stiffness,
            self.damping, self.shear * self.stiffness, self.shear * self.damping, self.footprint, self.friction,
            self.attached,
        )  # fmt: skip
        for name, value in base._asdict().items():
            self.own["constants"][name] = value
        self.own["axis"], self.own["centre"] = np.divide(self.up, length(np.array(self.up))), centre
        for name, value in (("turned", np.zeros(3)), ("spins", np.zeros(3)), ("middle", centre)):
            self.hold(name, value)
        self.hold("tip_laws", np.array(self.tips, float).reshape(-1, 5))
        self.hold("stick_laws", np.array(self.sticks, float).reshape(-1, 4))
        self.hold("twist_laws", np.array(self.twists, float).reshape(-1, 2))
        self.hold("at_side", np.array(self.sides, np.int32))
        self.hold("expected", np.zeros((1, 6)))
        self.hold("mobility", np.zeros((6, 3)))

    def _solid(self) -> tuple[np.ndarray, float]:
        """Centre [m] (3) and radius of gyration [m] of the organ. SettingError: `shape` is no surface."""
        if not self.shape:
            raise SettingError("setting 'shape': empty; leave it out, it is set when the graph is loaded")
        try:
            given = json.loads(self.shape)
        except ValueError:
            raise SettingError(
                "setting 'shape': found no JSON; leave it out, it is set when the graph is loaded"
            ) from None
        return centre_of(OnThinnedSurface(**given).whole())

    @kernel
    def compute(
        own,
        contact: Annotated[list[Contact], Wants("normal", "force", "compression", "indentation", "lateral_force")],
        friction: Annotated[list[Friction | None], Wants("force")],
        pose: Annotated[list[Pose], Wants("position")],
        body: Annotated[Surface | None, Wants(*LAW, "laws")],
        organs: Annotated[list[OrganContact | None], Wants("force", "resultant", "torques")],
        out: Out[Support],
        dt,
    ):
        if contact.count > own.tip_laws.shape[0]:
            own.fault = NO_LAW
            return
        if keep_pace(own.pace, dt):
            dt = own.pace.usual
        force, moment, stiffness, turning = pressed(own, contact, friction, pose, body, organs.count == 0, dt)
        push = turn = REST
        if organs.count > 0:
            push, turn = pushed(own, organs)
            force, moment = plus(force, push), plus(moment, turn)
        settle(own, force, moment, stiffness, turning, out, dt)
        if organs.count > 0:
            foresee(own, force, moment, push, out, dt)

    def explain(self, fault: int, *messages: Any) -> Exception:
        return InputError(
            messages[0][0],
            f"found {len(messages[0])} contacts, expected at most {len(self.tips)}, the laws in the setting `tips`; a "
            "graph that is loaded sets it",
        )

    def notes(self) -> list[str]:
        if self.known["heaviest"] > HEAVY * self.mass:
            self._note_once(
                f"Foundation: while fingers press, the step adds more than {100 * HEAVY:g} % to the mass of the organ, "
                f"{1e3 * self.mass:.3g} g, so that it is accelerated more slowly; a higher rate adds less"
            )
        return super().notes()


class OrganFoundation(Foundation):
    """The `Foundation` of an organ that other organs touch, and no finger."""

    @kernel
    def compute(
        own,
        organs: Annotated[list[OrganContact], Wants("force", "resultant", "torques")],
        body: Annotated[Surface | None, Wants("stiffness")],
        out: Out[Support],
        dt,
    ):
        if keep_pace(own.pace, dt):
            dt = own.pace.usual
        force, moment = pushed(own, organs)
        settle(own, force, moment, 0.0, 0.0, out, dt)
        foresee(own, force, moment, force, out, dt)
