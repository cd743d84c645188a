"""The machine driven through time: a controller, MuJoCo's steps, closed loops, sticking friction.

MuJoCo integrates; the loops are equality constraints and dry friction a constraint force, both as
stiff as MuJoCo makes them. The controller knows the dynamics, compensates most of the dry
friction, and corrects the rest by the struts' lengths and speeds: the machine follows its design
with an error of its own, with kinks where a strut turns round.
"""

import math
from dataclasses import dataclass

import mujoco
import numpy as np

from tests.multibody.inverse import SLIDERS, ExactMachine
from tests.multibody.machine import mjcf

STEP = 0.35e-3
"""Of integration and controller, at most [s]."""

COMPENSATED = 0.9
"""Share of the dry friction that the controller feeds forward."""

SETTLED = 0.738
"""When the logger is started, as a share of the first period. What was is forgotten by then."""

STIFFNESS, DAMPING = 1.4e5, 1.05e3
"""Of the controller [N/m, N s/m]: some 30 Hz, damped by 0.7, for a mass of 4 kg in each strut."""

_IMPEDANCE = 0.9999
"""MuJoCo's largest: how much of a constraint's acceleration its force makes up for."""


@dataclass(frozen=True)
class Driven:
    """What happened at N samples, without noise: (N, 6) each."""

    step: float
    """Between samples [s]."""
    lengths: np.ndarray
    """[m]."""
    forces: np.ndarray
    """[N]."""
    tracking: np.ndarray
    """Lengths minus those of the design [m]."""
    gap: float
    """Largest coordinate of a gap in a loop [m]."""


def motion(design, times):
    """Return pose, rate and acceleration of a design, (N, 6) each.

    Parameters
    ----------
    design
        `omega`, `lambda0`, `mu` and `nu` of a design.json.
    times
        (N,) [s].
    """
    mu, nu = (np.array(design[name]).T for name in ("mu", "nu"))
    orders = design["omega"] * np.arange(1, len(mu) + 1)
    turned = np.multiply.outer(np.asarray(times), orders)
    sine, cosine = np.sin(turned), np.cos(turned)
    return (
        np.array(design["lambda0"]) + (sine / orders) @ mu - (cosine / orders) @ nu,
        cosine @ mu + sine @ nu,
        -(sine * orders) @ mu + (cosine * orders) @ nu,
    )


def drive(geometry, bodies, design, samples, *, compensated=COMPENSATED, periods=1, longest=STEP):
    """Return what the machine does in some periods of a design, from the middle of one on.

    Lengths and forces of a sample belong together: MuJoCo's semi-implicit steps are central
    differences of the positions. What depends on speeds lags behind by half a step.

    Parameters
    ----------
    geometry, bodies
        The machine.
    design
        See :func:`motion`.
    samples
        Of one period.
    compensated
        Share of the dry friction that the controller feeds forward.
    periods
        How many; they are alike to rounding.
    longest
        Step of integration and controller, at most [s].
    """
    period = 2 * np.pi / design["omega"]
    substeps = math.ceil(period / samples / longest)
    steps = samples * substeps
    exact = ExactMachine(geometry, bodies)
    times = period / steps * np.arange(steps)
    wanted = exact.simulate(*motion(design, times), dry_friction=compensated)
    lengths, rates = wanted.lengths, wanted.length_rates
    model = _stepping(geometry, bodies, period / steps)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = wanted.joints[0], wanted.rates[0]
    begin = round(SETTLED * samples) * substeps
    done, given = (np.empty((begin + steps * periods, len(SLIDERS))) for _ in range(2))
    gap = 0.0
    for k in range(len(done)):
        now = k % steps
        done[k] = data.qpos[SLIDERS]
        given[k] = (
            wanted.forces[now]
            + STIFFNESS * (lengths[now] - done[k])
            + DAMPING * (rates[now] - data.qvel[SLIDERS])
        )
        data.qfrc_applied[SLIDERS] = given[k]
        mujoco.mj_step(model, data)
        gap = max(gap, float(np.abs(data.efc_pos[: data.ne]).max()))
    kept = np.arange(begin, len(done), substeps)
    return Driven(
        period / samples, done[kept], given[kept], done[kept] - lengths[kept % steps], gap
    )


def _stepping(geometry, bodies, step):
    model = mujoco.MjModel.from_xml_string(mjcf(geometry, bodies))
    model.opt.timestep = step
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
    model.opt.tolerance = 1e-14
    for parts in ("eq", "dof"):
        # The stiffest that is stable: a time constant of two steps, critically damped.
        getattr(model, f"{parts}_solref")[:] = (2 * step, 1)
        getattr(model, f"{parts}_solimp")[:, :2] = _IMPEDANCE
    return model
