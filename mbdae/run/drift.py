"""Drift of a run: energy gained or lost without a cause, and violation of joints where constraints are imposed on accelerations
only (index 1).

BDF of order above 2 adds energy to undamped motion: measured, a pendulum gains a fifth of its energy in 1e4 periods at rtol =
1e-6, and a damped oscillator can be made to grow. Neither constraints nor local errors show that; the energy balance does.
"""

from __future__ import annotations

import numpy as np

from mbdae.results.energy import Energy, has_power
from mbdae.results.result import Result
from mbdae.run.control import Controlled
from mbdae.system.motion.mechanics import row_sizes
from mbdae.system.prepare import Prepared
from mbdae.ties import largest

#: a warning is given where the energy error, relative to the energy exchanged, is above this times the accuracy, above SHARE and
#: above round-off
ALLOWED = 10.0
SHARE = 1e-3  #: energy error, relative to the energy exchanged, up to which there is no warning at any accuracy
POINTS = 1000  #: largest number of steps of a run at which energies are compared
#: round-off, relative: of energies to the largest or a typical energy of the run (`round_off`), of penetrations to the size of
#: the contact
ROUNDED = 100 * float(np.finfo(float).eps)
SAMPLES = 200  #: largest number of steps of a run at which constraint rows are evaluated


def energy_drift(result: Result, run: Controlled, asked: float | None) -> list[str]:
    """A warning where the energy balance drifts; none if the run met its accuracy and energy is dissipated or supplied.

    Constant steps, contacts and friction have a check of their own (`reliability`). Beams lose the energy of vibrations that long
    steps damp away (`lost_vibrations`), so that with beams only BDF is checked."""
    prepared, order = result.prepared, run.solver.bdf_order
    supplied = has_power(prepared.mechanics)
    met = asked is not None and run.estimate <= asked
    elsewhere = prepared.contacts or prepared.mechanics.reactive or (prepared.model.lines and order <= 2)
    if run.solver.fixed or elsewhere or (met and supplied):
        return []
    t = result.solution.t
    if len(t) < 3:
        return []
    e = result(t[:: len(t) // POINTS + 1]).energy
    exchanged = max(float(x) for x in (np.max(e.kinetic), np.ptp(e.potential), np.ptp(e.dissipated), np.ptp(e.work)))
    off = float(e.balance[np.argmax(np.abs(e.balance))])
    tolerance = asked if asked is not None else run.solver.rtol or 0.0
    if not abs(off) > max(max(SHARE, ALLOWED * tolerance) * exchanged, _at_rest(prepared, tolerance), round_off(prepared, e)):
        return []
    remedy = "BDF of order above 2 adds energy to undamped motion: use mb.RadauIIA(3), or" if order > 2 else "use"
    return [f"the energy balance drifts: {abs(off):.2g} J {'gained' if off > 0 else 'lost'} without a cause, while "
            f"{exchanged:.2g} J are exchanged; {remedy} a smaller rtol or step"]  # fmt: skip


def round_off(prepared: Prepared, e: Energy) -> float:
    """Energy (J) below which differences of the energies of a run are round-off: the fraction ROUNDED of the largest energy of
    the run, or of a typical one (weight of all bodies times the scene's length, plus their m v^2 at the typical speed v)."""
    scene = prepared.model.scene
    mass = sum(body.mass for body in scene.bodies)
    typical = mass * (float(np.linalg.norm(scene.gravity)) + prepared.length / prepared.time**2) * prepared.length
    parts = (e.kinetic, e.potential, e.dissipated, e.work)
    return ROUNDED * max(typical, *(float(np.max(np.abs(part), initial=0.0)) for part in parts))


def _at_rest(prepared: Prepared, tolerance: float) -> float:
    """Kinetic energy (J) of the lightest body at the speed that is as large as the tolerance of velocities, so that the body may
    as well be at rest."""
    masses = [b.mass for b in prepared.model.scene.bodies if b.mass > 0]
    return min(masses, default=0.0) * (tolerance * prepared.length / prepared.time) ** 2 / 2


def joint_drift(prepared: Prepared, run: Controlled, asked: float | None) -> list[str]:
    """A warning where the violation g of a constraint row, relative to its size, or its rate G u + g_t, relative to its size and
    the scene's speed, exceeds the accuracy asked; where none was asked, the accuracy expected of the tolerance."""
    m, solver = prepared.mechanics, run.solver
    if not m.m:
        return []
    if asked is None:
        asked = solver.at_best or 1e-6
    t = run.solution.t[:: len(run.solution.t) // SAMPLES + 1]
    q, u, _ = prepared.states(t, run.solution(t))
    speed = max(prepared.length / prepared.time, m.speed(u))
    sizes = row_sizes(m, prepared.start.t, prepared.start.q)
    off = [np.abs(m.position_residual(t, q)) / sizes, np.abs(m.velocity_residual(t, q, u)) / (sizes * speed / prepared.length)]
    for values, what, size in zip(off, ("position", "velocity"), ("length, or rad", "speed"), strict=True):
        worst = largest(np.max(values, axis=0))
        if np.max(values) > asked:
            return [f"joint row {m.rows[worst].name} is violated in {what}, by {np.max(values):.1e} of the scene's {size}: the "
                    "form satisfies constraints for accelerations only; raise its baumgarte, ask for a smaller accuracy, or use "
                    "mb.GGL()"]  # fmt: skip
    return []
