"""Failure map: motor torques of the flexible 5R on the deformed robot, over the stiffness and the step.

Drives and rods are elastic; a motor's torque has the second derivative of what its drive is twisted. All are
given the law through the deformed robot's singular point. Errors are relative to the largest torque.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache

import numpy as np
from scipy.interpolate import CubicSpline

from framework.arrays import Array
from framework.dynamics.elasticity import solve_deflections
from framework.dynamics.finite_differences import finite_difference_torques
from framework.dynamics.forces import motor_torque
from framework.motion.chebyshev import TimeGrid
from tests.benchmarks.chart import elastic_form
from tests.benchmarks.chart.elastic import CHECKED, FEW, T_C, T, branch_of, law
from tests.benchmarks.chart.measure import Judged, Method, Row, Setting, Stage, relative_error
from tests.benchmarks.chart.reading import finite, short

SCALES = (0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 100.0)  # of all stiffnesses
STEPS = tuple(T / 2**k for k in (5, 7, 9, 11, 13))  # [s]
MEAN_STEPS = tuple(T / size for size in (16, 32, 64, 96, 128))  # [s] of Chebyshev nodes

Torque = Callable[[Array], Array]


def _differences(setting: Setting) -> Callable[[], Torque]:
    branch, chosen = branch_of(setting[0]), law(setting[0])

    def run() -> Torque:
        found = finite_difference_torques(
            branch.robot,
            branch.path,
            chosen,
            samples=round(T / setting[1]) + 1,
            geometry="deformed",
            passes=FEW,
            branch=branch,
        )
        sound = np.isfinite(found.torque).all(axis=1)
        return CubicSpline(found.time[sound], found.torque[sound])

    return run


def _nodes(setting: Setting) -> Callable[[], Torque]:
    branch, chosen = branch_of(setting[0]), law(setting[0])

    def run() -> Torque:
        grid = TimeGrid.clear_of(np.array([T_C]), np.array([0.0, T]), round(T / setting[1]))
        state = solve_deflections(branch, grid, lambda *_: chosen, "deformed", None, chosen)
        return grid.fit(motor_torque(branch.robot, state.motion, state.forces.joint_torque))

    return run


@cache
def _exact(scale: float) -> Array:
    return elastic_form.elastic_motion(scale).torque(CHECKED)


def judge(method: Method, setting: Setting, result: Torque) -> Judged:
    """The largest error over the largest torque."""
    return Judged(relative_error(result(CHECKED), _exact(setting[0])))


def _remark(rows: Sequence[Row]) -> str:
    lines = ["Each cell has the power of ten of the error."]
    differences, nodes = finite(rows, "differences"), finite(rows, "nodes")
    if differences and nodes:
        best = {scale: min(r.error for r in differences if r.setting[0] == scale) for scale in SCALES}
        least = {scale: min(r.error for r in nodes if r.setting[0] == scale) for scale in SCALES}
        lines.append(
            f"The shortest steps of finite differences leave {short(min(best.values()))} with stiff springs, "
            f"{short(max(best.values()))} with soft ones, for which {FEW} passes do not suffice; the series "
            f"leaves {short(min(least.values()))} and {short(max(least.values()))}."
        )
    return " ".join(lines)


_GIVEN = "law through the deformed robot's point"
_UNIT = "stiffness, step [s]"
STAGE = Stage(
    name="soft",
    title="Torques of the deformed robot",
    reference="two equations in two unknowns at each instant, fifty digits (chart/elastic_form.py)",
    error="largest error over the largest torque",
    methods=(
        Method(
            "differences",
            f"finite differences, {FEW} passes",
            _GIVEN,
            _UNIT,
            tuple((scale, step) for step in STEPS for scale in SCALES),
            _differences,
        ),
        Method(
            "nodes",
            "ours, Chebyshev nodes",
            _GIVEN,
            _UNIT,
            tuple((scale, step) for step in MEAN_STEPS for scale in SCALES),
            _nodes,
            "ours",
        ),
    ),
    judge=judge,
    remark=_remark,
    map_axes=("stiffness over the paper's", "step  [ms]"),
)
