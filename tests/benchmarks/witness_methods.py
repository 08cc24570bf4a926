"""Forward runs of the 5R by MuJoCo and Exudyn, as methods of the work-precision chart.

`methods(name, flexibility)` maps names to callables: a step [s] gives the wall time of the integration [s]
and the largest distance of the payload from the planned path over the run [m], scene C throughout. The
torques are tabulated beforehand in both; setting the model up is not counted, calling back into Python for
the torque of each step or stage is. Infinite error: the simulator gave up at this step.

Simulators that are not installed are left out of the mapping.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec

import numpy as np

from tests.benchmarks.chart.peers.five_bar import FiveBar
from tests.witness.plans import DURATION, plan_of

Method = Callable[[float], tuple[float, float]]

# [kg/s^2]: stand-in mass of light elastic legs over step^2, found by trial at 1 ms: RK4 was unstable with a
# tenth of it, the others with two thirds
MASS_PER_STEP = {"RK4": 1e5, "implicitfast": 3e5, "Euler": 3e5}


def methods(name: str, flexibility: str) -> dict[str, Method]:
    """For a robot of the catalogue: five_bar or five_bar_heavy."""
    plan, robot = plan_of(name, flexibility), FiveBar.of(name, flexibility)

    def method(simulate: Callable, mass_per_step: float | None = None, **options) -> Method:
        def measured(step: float) -> tuple[float, float]:
            mass = {} if mass_per_step is None else {"least_mass": mass_per_step * step**2}
            place = plan.platform(0.0)
            try:
                run = simulate(robot, plan.torque, place, step=step, duration=DURATION, **options, **mass)
            except ArithmeticError:
                return np.nan, np.inf
            return run.seconds, float(run.error(plan).max())

        return measured

    found: dict[str, Method] = {}
    if find_spec("exudyn"):
        from tests.benchmarks.chart.peers.exudyn_five_bar import simulate

        found["Exudyn, generalised alpha"] = method(simulate)
        found["Exudyn, trapezoidal, index 2"] = method(simulate, solver="TrapezoidalIndex2")
    if find_spec("mujoco"):
        from tests.benchmarks.chart.peers import mujoco_forward

        light = robot.link_mass == 0 and robot.drive_stiffness is not None
        for integrator, ratio in MASS_PER_STEP.items():
            found[f"MuJoCo, {integrator}"] = method(
                mujoco_forward.simulate, mass_per_step=ratio if light else None, integrator=integrator
            )
    return found
