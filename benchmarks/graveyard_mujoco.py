"""MuJoCo's soft bodies (`flex`) in the models of the reports, in the current syntax (a plugin at the time)."""

from __future__ import annotations

import numpy as np

from palpate.studies.peers.mujoco import library

BEAM = """<mujoco><option timestep="{step}"/><worldbody><geom type="plane" size="5 5 .1"/>
  <flexcomp name="beam" type="grid" count="24 4 4" spacing=".1 .1 .1" pos=".1 0 1.5" radius="0" dim="3" mass="7">
    <contact condim="3" solref="0.01 1" solimp=".95 .99 .0001" selfcollide="none"/><edge damping="1"/>
    <elasticity young="5e4" poisson="{poisson}"/>
  </flexcomp></worldbody></mujoco>"""
SHEET = """<mujoco><option timestep="0.001"/><worldbody><geom type="plane" size="5 5 .1"/>
  <flexcomp name="sheet" type="grid" count="20 20 1" spacing=".05 .05 .05" pos="0 0 .5" euler="{turn} 0 0" radius=".005"
    dim="2" mass="1"><contact condim="3" solref="0.01 1" selfcollide="none"/><edge damping="0.01"/>
    <elasticity young="{young}" poisson="0.2" thickness="0.01"/>
  </flexcomp></worldbody></mujoco>"""
SIZE, COUNT, BALL, TRAVEL = (0.06, 0.06, 0.02), (7, 7, 4), 8e-3, 2e-3
SLAB = """<mujoco><option timestep="0.001" gravity="0 0 0" integrator="{integrator}"/><worldbody>
  <body name="ball" mocap="true" pos="0 0 {start}"><geom type="sphere" size="{ball}"/></body>
  <flexcomp name="slab" type="grid" dim="3" count="{count}" spacing="{spacing}" mass="0.0756" radius="0.0005">
    <pin gridrange="0 0 0 {last} 0"/><elasticity young="{young}" poisson="0.45" damping="{damping}"/>
    <contact selfcollide="none" solref="{solref}"/>
  </flexcomp></worldbody></mujoco>"""
MODULI = (1e4, 1e5, 1e6)
"""[Pa] from fat to cartilage."""


def beam() -> str:
    """The beam of MuJoCo's documentation on a floor, at steps of 2 and 1 ms."""
    return "; ".join(f"{1e3 * step:g} ms: {_end(BEAM.format(step=step, poisson=0.2), 2.0)[0]}" for step in (2e-3, 1e-3))


def incompressible() -> str:
    """The same beam at 1 ms, for each Poisson's ratio."""
    texts = {nu: BEAM.format(step=1e-3, poisson=nu) for nu in (0.2, 0.45, 0.4999)}
    return "; ".join(f"{nu}: {_end(text, 1.0)[0]}" for nu, text in texts.items())


def turned() -> str:
    """A sheet that falls on a floor, level and rotated by 10 degrees."""
    return "; ".join(
        f"{young:.0e} Pa, {turn} degrees: {_end(SHEET.format(young=young, turn=turn), 1.0)[0]}"
        for young in (1e5, 1e6) for turn in (0, 10)
    )  # fmt: skip


def slab(integrator: str) -> str:
    """Force on a ball that moves 2 mm into a slab at 20 mm/s, and its penetration, for each modulus.

    The slab is fixed at its base. The contact is the stiffest that stays finite. Of two values of the damping, the one
    whose state stays finite for longer; the smaller one if both do.
    """
    outcomes = []
    for young in MODULI:
        ends = [_pressed(integrator, young, damping) for damping in (0.0, 1e-3)]
        outcomes.append(f"{young:.0e} Pa: {max(ends, key=lambda end: end[0])[1]}")
    return "; ".join(outcomes)


def _pressed(integrator: str, young: float, damping: float) -> tuple[float, str]:
    """Time until the end or until the state is not finite [s], and the outcome as text."""
    mujoco = library()
    start = SIZE[2] / 2 + 5e-4 + BALL
    spacing = " ".join(str(size / (count - 1)) for size, count in zip(SIZE, COUNT, strict=True))
    text = SLAB.format(
        integrator=integrator, young=young, damping=damping, start=start, ball=BALL, count=" ".join(map(str, COUNT)),
        spacing=spacing, last=f"{COUNT[0] - 1} {COUNT[1] - 1}", solref="0.002 1",
    )  # fmt: skip

    def press(data: object) -> None:
        data.mocap_pos[0, 2] = start - min(0.02 * data.time, TRAVEL)  # type: ignore[attr-defined]

    words, model, data = _end(text, 0.3, press)
    if not words.startswith("finite"):
        return data.time, words
    force, one = 0.0, np.zeros(6)
    for k in range(data.ncon):
        mujoco.mj_contactForce(model, data, k, one)
        force += one[0] * abs(data.contact[k].frame[2])
    into = -min((data.contact[k].dist for k in range(data.ncon)), default=0.0)
    return data.time, f"{force:.2f} N, {1e3 * into:.2f} of {1e3 * TRAVEL:.0f} mm penetration"


def _end(text: str, seconds: float, before=lambda data: None):
    """Outcome of a run as text, the model and its data."""
    mujoco = library()
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    bad = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)
    while data.time < seconds:
        time = data.time
        before(data)
        mujoco.mj_step(model, data)
        if any(data.warning[kind].number for kind in bad):
            data.time = time
            return f"not finite at {1e3 * time:.0f} ms", model, data
    return f"finite for {seconds:g} s", model, data
