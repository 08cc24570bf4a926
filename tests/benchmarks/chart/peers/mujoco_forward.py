"""A forward run of the 5R in MuJoCo under motor torques.

MuJoCo holds its controls over a step, which alone costs an error of the order of step^2; here its control
callback gives each stage of the Runge-Kutta method the torque of its own instant. What is left is the soft
loop (its gap goes as step^2), and `least_mass` where the robot has none. An unstable run raises: MuJoCo by
itself writes a log file, starts again from the initial state and goes on.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import mujoco
import numpy as np

from framework.arrays import Array
from tests.benchmarks.chart.peers.five_bar import SIDES, FiveBar, Run, start_angles
from tests.benchmarks.chart.peers.mujoco_five_bar import NEGLIGIBLE, model_of


def simulate(
    robot: FiveBar,
    torque: Callable[[Array], Array],
    start: Array,
    *,
    step: float,
    duration: float,
    least_mass: float = NEGLIGIBLE,
    integrator: str = "RK4",
    hard: bool = True,
    joints: Mapping[str, tuple[float, float]] | None = None,
) -> Run:
    """Drive the robot by motor torques from rest at `start` (2,) [m]; as Exudyn's `simulate`.

    `joints` overrides where the joints start [rad, m] and how fast [rad/s, m/s]. The payload is in the
    middle between the tips; `gap` of the result is the largest distance between them.
    Raises ArithmeticError when MuJoCo warns that the run is unstable.
    """
    steps = round(duration / step)
    step = duration / steps
    model = model_of(robot, least_mass=least_mass, step=step, integrator=integrator, hard=hard)
    data = mujoco.MjData(model)
    for side, (crank, rod) in zip(SIDES, start_angles(start), strict=True):
        data.joint(f"{side}_motor").qpos = crank
        data.joint(f"{side}_elbow").qpos = rod - crank
    for name, (place_0, speed_0) in (joints or {}).items():
        data.joint(name).qpos, data.joint(name).qvel = place_0, speed_0
    control = torque(np.linspace(0.0, duration, 2 * steps + 1))  # (2 steps + 1, 2): stages fall on half steps
    tips = [model.site(f"{side}_tip").id for side in SIDES]
    place = np.empty((steps + 1, 2, 2))  # instant, tip, axis

    def drive(_model: Any, now: Any) -> None:
        now.ctrl[:] = control[min(round(2 * now.time / step), 2 * steps)]

    with _hooked(drive) as warnings:
        mujoco.mj_forward(model, data)
        place[0] = data.site_xpos[tips, :2]
        begun = time.perf_counter()
        for k in range(steps):
            mujoco.mj_step(model, data)
            mujoco.mj_kinematics(model, data)  # positions at the end of the step
            place[k + 1] = data.site_xpos[tips, :2]
            if warnings:
                raise ArithmeticError(f"MuJoCo, step {step} s: {warnings[0]}")
        seconds = time.perf_counter() - begun
    gap = np.linalg.norm(place[:, 0] - place[:, 1], axis=1).max()
    return Run(np.linspace(0.0, duration, steps + 1), place.mean(axis=1), seconds, float(gap))


@contextmanager
def _hooked(drive: Callable[[Any, Any], None]) -> Iterator[list[str]]:
    """MuJoCo's callbacks, which belong to the process: set here, and gone afterwards."""
    warnings: list[str] = []
    mujoco.set_mjcb_control(drive)
    mujoco.set_mju_user_warning(warnings.append)
    try:
        yield warnings
    finally:
        mujoco.set_mjcb_control(None)
        mujoco.set_mju_user_warning(None)
