"""Stage: the quickest law along scene C of the 5R under a torque limit of both motors, beside toppra.

H. Pham, Q.-C. Pham, "A New Approach to Time-Optimal Path Parameterization Based on Reachability Analysis",
IEEE Transactions on Robotics 34, 2018, DOI 10.1109/TRO.2018.2819195. toppra is given the torques as linear in
s" and s'^2 at its nodes, by the robot's own formula, computed at once: nothing calls back into Python. It
keeps the limit at its nodes and knows nothing of condition (8): between the two nodes about the singular
point the torque has a pole. Ours has vanishing derivatives at both ends and is proved between nodes too.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from framework import plan_crossing
from framework.numerics.arrays import Array
from tests.benchmarks.chart import robot as given
from tests.benchmarks.chart.formula import torques
from tests.benchmarks.chart.measure import Judged, Method, Row, Setting, Stage, singles
from tests.benchmarks.chart.reading import best, finite, short

LIMIT = 0.165  # [N m] of each motor
BETWEEN = 20  # instants that are looked at between two nodes
NODES = singles(50, 100, 200, 400, 800, 1600)
KEPT = 1e-12  # excess over the limit that counts as none


class Timed(NamedTuple):
    """A law's duration [s], and the largest torque over the limit that is found between its nodes."""

    duration: float
    largest: Callable[[], float]


def _ours(setting: Setting) -> Callable[[], Timed]:
    def run() -> Timed:
        plan = plan_crossing(given.robot(), given.path(), optimize="time", torque_limit=LIMIT)
        times = np.linspace(0.0, plan.duration, round(setting[0]) * BETWEEN)
        return Timed(plan.duration, lambda: float(np.abs(plan.torque(times)).max() / LIMIT))

    return run


def _between(s: Array, speed: Array) -> float:
    """The largest torque over the limit: between two nodes s'^2 is linear in s."""
    share = np.linspace(0.0, 1.0, BETWEEN + 1)
    square, acceleration = speed**2, 0.5 * np.diff(speed**2) / np.diff(s)
    places = s[:-1, None] + np.diff(s)[:, None] * share
    squares = square[:-1, None] + np.diff(square)[:, None] * share
    rates = np.sqrt(np.maximum(squares, 0.0)).ravel()
    there = torques(places.ravel(), rates, np.repeat(acceleration, len(share)))
    return float(np.abs(there).max() / LIMIT)


def _toppra(setting: Setting) -> Callable[[], Timed]:
    import logging

    import toppra
    from toppra import algorithm, constraint

    logging.getLogger("toppra").setLevel(logging.ERROR)

    class Torques(constraint.LinearConstraint):
        """F (a s" + b s'^2 + c) <= g."""

        def __init__(self) -> None:
            super().__init__()
            self.identical, self.dof = True, 1
            self.set_discretization_type(constraint.DiscretizationType.Collocation)

        def compute_constraint_params(self, path: Any, s: Array, *args: Any) -> tuple[Any, ...]:
            none, one = np.zeros_like(s), np.ones_like(s)
            still = torques(s, none, none)
            a, b = torques(s, none, one) - still, torques(s, one, none) - still
            return a, b, still, np.vstack([np.eye(2), -np.eye(2)]), np.full(4, LIMIT), None, None

    path, s = (
        toppra.SplineInterpolator([0.0, 1.0], [[0.0], [1.0]]),
        np.linspace(0.0, 1.0, round(setting[0]) + 1),
    )

    def run() -> Timed:
        instance = algorithm.TOPPRA([Torques()], path, gridpoints=s, solver_wrapper="seidel")
        speed = instance.compute_parameterization(0.0, 0.0)[1]
        if speed is None:
            raise ArithmeticError(f"toppra: {instance.problem_data.return_code}")
        duration = float((2 * np.diff(s) / (speed[1:] + speed[:-1])).sum())
        return Timed(duration, lambda: _between(s, speed))

    return run


def judge(method: Method, setting: Setting, result: Timed) -> Judged:
    """By how much the limit is exceeded, over the limit, and the duration."""
    return Judged(max(result.largest() - 1.0, KEPT), (result.duration,))


def _remark(rows: Sequence[Row]) -> str:
    ours, toppra = best(rows, "ours"), finite(rows, "toppra")
    if ours is None or not toppra:
        return ""
    finest = max(toppra, key=lambda row: row.setting[0])
    kept = "keeps the limit" if ours.error <= KEPT else f"exceeds the limit by {short(ours.error)} of it"
    return (
        f"Ours lasts {ours.profile[0]:.4f} s and {kept}; toppra's lasts {finest.profile[0]:.4f} s on "
        f"{finest.setting[0]:.0f} nodes, took {1e3 * finest.seconds:.3g} ms against {1e3 * ours.seconds:.3g} "
        f"and exceeds the limit {finest.error:.0f}-fold between nodes, at the singular point."
    )


STAGE = Stage(
    name="optimal",
    title="The quickest law under a torque limit",
    reference="the limit itself, by the robot's own formula between nodes (chart/formula.py)",
    error="excess over the torque limit",
    methods=(
        Method(
            "ours",
            "ours, optimal and proved",
            _ours,
            given="path, limit",
            unit="intervals looked at",
            settings=singles(500),
        ),
        Method(
            "toppra",
            "toppra",
            _toppra,
            given="path, limit, torques linear in s\", s'^2",
            unit="nodes",
            settings=NODES,
            source="seidel, collocation, equal intervals, coefficients in one call",
            package="toppra",
        ),
    ),
    judge=judge,
    goals=(1e-2,),
    remark=_remark,
    profile=(1.0,),
    profile_error="duration  [s]",
    profile_title="Duration",
)
