"""A rigid box hits a compliant one, without gravity, in Drake: is the kinetic energy afterwards greater than before?"""

from __future__ import annotations

SIZE, MASS = 0.1, 0.5  # [m], [kg]
MODULI, SPEEDS, TILTS = (1e7, 1e9), (0.2, 2.0), (0.1, 0.3, 0.6)  # [Pa], [m/s], [rad]
STEPS = (5e-4, 1e-3, 1e-2)  # [s]


def thrown() -> str:
    """For each time step: number of throws that gain energy, and the largest gain."""
    outcomes = []
    for step in STEPS:
        gains = [
            _gain(step, modulus, speed, tilt) for modulus in MODULI for speed in SPEEDS for tilt in TILTS
        ]  # fmt: skip
        more = sum(gain > 1.001 for gain in gains)
        outcomes.append(f"{1e3 * step:g} ms: {more} of {len(gains)} gain energy, at most {max(gains):.3g} ×")
    return "; ".join(outcomes)


def _gain(step: float, modulus: float, speed: float, tilt: float) -> float:
    """Largest kinetic energy during 100 samples after the throw, over the initial one."""
    import pydrake.all as drake

    builder = drake.DiagramBuilder()
    plant, _ = drake.AddMultibodyPlant(
        drake.MultibodyPlantConfig(time_step=step, contact_model="hydroelastic_with_fallback"), builder
    )
    inertia = drake.SpatialInertia.SolidBoxWithMass(MASS, SIZE, SIZE, SIZE)
    bodies = [plant.AddRigidBody(name, inertia) for name in ("rigid", "compliant")]
    for body in bodies:
        properties = drake.ProximityProperties()
        drake.AddContactMaterial(0.0, None, drake.CoulombFriction(0.5, 0.5), properties)
        if body is bodies[0]:
            drake.AddRigidHydroelasticProperties(SIZE / 4, properties)
        else:
            drake.AddCompliantHydroelasticProperties(SIZE / 4, modulus, properties)
        box = drake.Box(SIZE, SIZE, SIZE)
        plant.RegisterCollisionGeometry(body, drake.RigidTransform(), box, body.name(), properties)
    plant.mutable_gravity_field().set_gravity_vector([0, 0, 0])
    plant.Finalize()
    simulator = drake.Simulator(builder.Build())
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    turn = drake.RollPitchYaw(tilt, tilt / 2, 0)
    plant.SetFreeBodyPose(context, bodies[0], drake.RigidTransform(turn, [-1.2 * SIZE, 0, 0.02]))
    plant.SetFreeBodySpatialVelocity(context, bodies[0], drake.SpatialVelocity([0, 0, 0], [speed, 0, 0]))
    before, most = plant.CalcKineticEnergy(context), 0.0
    for k in range(1, 101):  # long enough to rebound by the size of a box at the initial speed
        simulator.AdvanceTo(0.03 * SIZE / speed * k)
        most = max(most, plant.CalcKineticEnergy(context) / before)
    return most
