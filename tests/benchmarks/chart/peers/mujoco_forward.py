"""A forward run of the 5R in MuJoCo under motor torques.

MuJoCo holds its controls over a step, which alone costs an error of the order of step^2; here its control
callback gives each stage of the Runge-Kutta method the torque of its own instant, out of a table, and the
loop over the steps is MuJoCo's own (`rollout`). What is left is the soft loop (its gap goes as step^2), and
`least_mass` where the robot has none. An unstable run raises: MuJoCo by itself writes a log file, starts
again from the initial state and goes on.
"""

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import mujoco
import numpy as np
from mujoco import rollout

from framework.numerics import Array
from tests.benchmarks.chart.peers.five_bar import SIDES, FiveBar, Run, start_angles
from tests.benchmarks.chart.peers.mujoco_five_bar import model_of


def prepared(
    robot: FiveBar,
    torque: Callable[[Array], Array],
    start: Array,
    *,
    step: float,
    duration: float,
    joints: Mapping[str, tuple[float, float]] | None = None,
    **options: Any,
) -> Callable[[], Run]:
    """A run with model and table of torques made ready; `options` are those of `model_of`.

    `joints` overrides where the joints start [rad, m] and how fast [rad/s, m/s]. The payload is in the
    middle between the tips; `gap` of the result is the largest distance between them.
    The run raises ArithmeticError when MuJoCo warns that it is unstable.
    """
    steps = round(duration / step)
    step = duration / steps
    model = model_of(robot, step=step, **options)
    data = mujoco.MjData(model)
    for side, (crank, rod) in zip(SIDES, start_angles(np.asarray(start) / robot.size), strict=True):
        data.joint(f"{side}_motor").qpos = crank
        data.joint(f"{side}_elbow").qpos = rod - crank
    for name, (place, speed) in (joints or {}).items():
        data.joint(name).qpos, data.joint(name).qvel = place, speed
    whole = mujoco.mjtState.mjSTATE_FULLPHYSICS.value
    state = np.empty(mujoco.mj_stateSize(model, whole))
    mujoco.mj_getState(model, data, state, whole)
    # (2 steps + 1, 2): stages fall on half steps
    control = torque(np.linspace(0.0, duration, 2 * steps + 1)).tolist()
    last, halves = 2 * steps, 2 / step
    times = np.linspace(0.0, duration, steps + 1)

    def drive(_model: Any, now: Any) -> None:
        now.ctrl = control[min(round(now.time * halves), last)]

    def run() -> Run:
        with _hooked(drive) as warnings:
            began = time.perf_counter()
            # sensors are read at the start of each step: one step more gives the end of the last
            tips = rollout.rollout(model, data, state, nstep=steps + 1)[1][0].reshape(-1, 2, 3)[:, :, :2]
            seconds = time.perf_counter() - began
            if warnings or not np.all(np.isfinite(tips)):
                raise ArithmeticError(f"MuJoCo, step {step} s: {(warnings or ['not finite'])[0]}")
        gap = np.linalg.norm(tips[:, 0] - tips[:, 1], axis=1).max()
        return Run(times, tips.mean(axis=1), seconds, float(gap))

    return run


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
