"""Stage: derivatives of the torques along place, rates and accelerations of the platform, of 20 instants.

The delta and the Gough-Stewart platform before their crossing, legs without mass, against differences of
virtual work in forty digits. Differences are taken as well as they can be: all points in one stack; torques
are affine in accelerations and quadratic in rates, so that wide steps are exact there; along the place of
order 2, 4 and 8, over steps about the one that loses the fewest digits.
"""

from collections.abc import Callable, Sequence
from functools import cache, partial

import numpy as np

from framework import ParallelRobot, dynamics_at, dynamics_derivatives
from framework.kinematics.inverse_kinematics import close_loops
from framework.numerics.arrays import Array
from tests.benchmarks.chart.along import crossing
from tests.benchmarks.chart.measure import Judged, Method, Row, Setting, Stage, singles
from tests.benchmarks.chart.reading import best, short
from tests.benchmarks.chart.spatial import PANELS
from tests.benchmarks.chart.virtual_work import machine

COUNT, CHECKED = 20, [0, -1]  # instants, and those that are judged
SHARES = np.linspace(0.05, 0.3, COUNT)  # of the duration: the crossing is at about half of it
WEIGHTS = {  # of central differences at steps 1, 2, .. by their order
    2: (1 / 2,),
    4: (2 / 3, -1 / 12),
    8: (4 / 5, -1 / 5, 4 / 105, -1 / 280),
}
STEPS = {2: (1e-4, 1e-5, 1e-6), 4: (1e-2, 3e-3, 1e-3, 3e-4, 1e-4), 8: (3e-2, 1e-2, 3e-3, 1e-3)}  # of the size
ORDERS = tuple((step, float(order)) for order, steps in STEPS.items() for step in steps)


@cache
def states(name: str) -> tuple[ParallelRobot, Array, Array]:
    """The robot, joints (T, nq) and x, x', x" (3, T, n)."""
    case = crossing(name)
    times = SHARES * case.law.duration
    state = np.array(case.platform(times))
    return case.robot, close_loops(case.robot, state[0], case.branch.guess(case.law(times))).q, state


@cache
def exact(name: str) -> Array:
    """Derivatives (T, n, 3 n) at the instants that are judged."""
    state = states(name)[2]
    return np.array([machine(name).torque_and_slopes(*state[:, k])[1] for k in CHECKED])


def ours(name: str, instants: float) -> Array:
    """Derivatives (T, n, 3 n), so many instants a call."""
    robot, q, (_, dx, ddx) = states(name)
    parts = [slice(k, k + round(instants)) for k in range(0, COUNT, round(instants))]
    found = [dynamics_derivatives(robot, q[part], dx=dx[part], ddx=ddx[part]) for part in parts]
    return np.concatenate([np.concatenate([f.torque_x, f.torque_dx, f.torque_ddx], axis=2) for f in found])


def differences(name: str, step: float, order: float) -> Array:
    """Derivatives (T, n, 3 n), all points in one stack; `step` over the size of the robot along the place."""
    robot, q, state = states(name)
    n, weights = robot.n, WEIGHTS[round(order)]
    small = step * robot.platform_scale
    wide = np.maximum(np.abs(state[1:]).max(axis=1), robot.platform_scale)  # (2, n)
    plan = [  # part of the state, axis, by how much, weight over the step
        (part, axis, side * k * h, side * weight / h)
        for part, steps, series in ((0, small, weights), (1, wide[0], (0.5,)), (2, wide[1], (0.5,)))
        for axis, h in enumerate(steps)
        for k, weight in enumerate(series, start=1)
        for side in (-1, 1)
    ]
    points = np.tile(state[:, None], (1, len(plan), 1, 1))  # (3, points, T, n)
    for k, (part, axis, by, _) in enumerate(plan):
        points[part, k, :, axis] += by
    moved = 2 * len(weights) * n  # the points of which the place is another
    closed = np.tile(q, (len(plan), 1, 1))
    bent = close_loops(robot, points[0, :moved].reshape(-1, n), np.tile(q, (moved, 1))).q
    closed[:moved] = bent.reshape(moved, *q.shape)
    _, dx, ddx = points.reshape(3, -1, n)
    torque = dynamics_at(robot, closed.reshape(-1, q.shape[1]), dx=dx, ddx=ddx).torque.reshape(-1, COUNT, n)
    slopes = np.zeros((COUNT, n, 3 * n))
    for (part, axis, _, weight), values in zip(plan, torque, strict=True):
        slopes[:, :, part * n + axis] += weight * values
    return slopes


def judge(method: Method, setting: Setting, result: Array) -> Judged:
    """The largest error over the largest entry, each entry times the size of what it is along."""
    name = method.name.rpartition("-")[0]
    scale = np.tile(states(name)[0].platform_scale, 3)
    expected = exact(name) * scale
    return Judged(float(np.abs(result[CHECKED] * scale - expected).max() / np.abs(expected).max()))


def _remark(rows: Sequence[Row]) -> str:
    words = []
    for name, panel in PANELS.items():
        ways = [best(rows, f"{name}-{way}") for way in ("stack", "calls", "differences")]
        known = [f"{short(row.error)} in {1e3 / COUNT * row.seconds:.2g} ms" for row in ways if row]
        if len(known) == len(ways):
            words.append(
                f"{panel}: ours {known[0]} an instant ({known[1]} call by call), differences {known[2]}."
            )
    return " ".join(words)


def _methods(name: str) -> tuple[Method, ...]:
    def prepare(way: Callable[..., Array]) -> Callable[[Setting], Callable[[], Array]]:
        return lambda setting: lambda: way(name, *setting)

    declared = partial(Method, given="joints; x', x\"", panel=PANELS[name])
    in_calls = "instants a call"
    return (
        declared(
            f"{name}-stack",
            "ours, exact, in one stack",
            prepare(ours),
            unit=in_calls,
            settings=singles(COUNT),
        ),
        declared(
            f"{name}-calls",
            "ours, exact, call by call",
            prepare(ours),
            unit=in_calls,
            settings=singles(1),
        ),
        declared(
            f"{name}-differences",
            "differences in one stack",
            prepare(differences),
            unit="step, order",
            settings=ORDERS,
            source="dynamics_at, all points in one stack",
        ),
    )


STAGE = Stage(
    name="derivatives",
    title="Derivatives of the torques, 20 instants",
    reference="differences of virtual work in forty digits (chart/virtual_work.py)",
    error="largest error over the largest entry",
    methods=(*_methods("delta"), *_methods("gough_stewart")),
    judge=judge,
    goals=(1e-6, 1e-10),
    remark=_remark,
)
