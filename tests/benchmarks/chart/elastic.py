"""Stage f: deflections of the 5R with elastic rods and drives that hold the forces that they cause.

Scene C on the deformed robot, against the stiffness. All methods but the planner are given the law that
crosses where the deformed robot is singular, which only the converged answer tells: springs move that point,
the farther the softer they are. Links have no mass here, so no derivative of a deflection enters a rod's
equation, and plain repetition has an easy task.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, partial
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from framework import Condition, Law, NotConverged, ParallelRobot, plan_crossing, track_path
from framework.dynamics.elastic_pass import Pass, evaluate_pass
from framework.dynamics.finite_differences import finite_difference_torques
from framework.kinematics.continuation.tracking import Branch
from framework.numerics.arrays import Array
from framework.numerics.chebyshev import TimeFunction, TimeGrid
from tests.benchmarks.chart import closed_form, elastic_form
from tests.benchmarks.chart import robot as given
from tests.benchmarks.chart.measure import Judged, Method, Row, Setting, Stage, relative_error, singles
from tests.benchmarks.chart.reading import finite, short

T, T_C, SPEED = given.DURATION, given.CROSSING_TIME, float(closed_form.CROSSING_SPEED)
SCALES = singles(0.03, 0.04, 0.06, 0.1, 0.2, 0.5, 1, 3, 10, 100)
CHECKED = np.delete(np.linspace(0.0, T, 61), 40)  # [s] not the very instant of the crossing
NODES, MOST = 96, 60  # of the grid, and passes
SAMPLES, FEW = 1501, 4  # of a table, and passes over it
SETTLED = 1e-13  # change over the largest deflection that ends the repetition


class Elongated(NamedTuple):
    """Elongations of the rods (T, 2) [m] at times (T,), and how often they were computed."""

    rods: Callable[[Array], Array]
    passes: int


@cache
def scaled(scale: float) -> ParallelRobot:
    """The robot with all its springs `scale` times as stiff."""
    robot = given.robot("five_bar", "flexible_links")
    return replace(robot, stiffness=scale * robot.stiffness)


@cache
def branch_of(scale: float) -> Branch:
    """The path as followed by that robot."""
    return track_path(scaled(scale), given.path())


def rod_columns(robot: ParallelRobot) -> list[int]:
    """Columns of the rods among the deflections, left before right."""
    return [k for k, name in enumerate(robot.elastic_names) if "rod" in name]


@cache
def law(scale: float | None) -> Law:
    """Through the singular point of the deformed robot, or of the rigid one (None)."""
    s_c = closed_form.singular_s() if scale is None else elastic_form.elastic_motion(scale).motion.s_c
    inner = [Condition(T_C, order, value) for order, value in enumerate((float(s_c), SPEED, 0.0))]
    return Law.rest_to_rest(T, elastic_form.SMOOTHNESS, inner)


def _planned(setting: Setting, *, geometry: str) -> Callable[[], Elongated]:
    robot = scaled(setting[0])

    def run() -> Elongated:
        plan = plan_crossing(robot, given.path(), duration=T, times=[T_C], speeds=[SPEED], geometry=geometry)
        columns = rod_columns(robot)
        deflections = plan.dynamics.deflections
        return Elongated(lambda t: deflections(t)[:, columns], plan.certificate.passes)

    return run


def repeated_on_nodes(branch: Branch, chosen: Law) -> Elongated:
    """Plain repetition on Chebyshev nodes: forces cause deflections, these move the robot, and so on.

    Raises:
        NotConverged: the deflections grow.
    """
    robot = branch.robot
    scale = robot.column_scale[robot.elastic]
    grid = TimeGrid.clear_of(np.array([T_C]), np.array([0.0, T]), NODES)
    function = TimeFunction(grid.edges, np.zeros((1, grid.size, robot.n_e)))
    before: Pass | None = None
    least, best = np.inf, function
    count = 0
    while count < MOST:
        count += 1
        before = evaluate_pass(branch, grid, chosen, function, before)
        change = float(np.abs(before.residual / scale).max() / np.abs(before.caused / scale).max())
        function = grid.fit_truncated(before.caused)
        if change < least:
            least, best = change, function
        if change < SETTLED or change > 1e3 * least:
            break
    if not least < 1.0:
        raise NotConverged("plain repetition: the deflections grow", residual=least)
    columns = rod_columns(robot)
    return Elongated(lambda t: best(t)[:, columns], count)


def _repeated(setting: Setting, *, moved: bool) -> Callable[[], Elongated]:
    """`moved`: with the law through the deformed robot's point."""
    branch, chosen = branch_of(setting[0]), law(setting[0] if moved else None)
    return lambda: repeated_on_nodes(branch, chosen)


def _differences(setting: Setting) -> Callable[[], Elongated]:
    branch, chosen = branch_of(setting[0]), law(setting[0])

    def run() -> Elongated:
        found = finite_difference_torques(
            branch.robot, branch.path, chosen, samples=SAMPLES, geometry="deformed", passes=FEW, branch=branch
        )
        off = ~np.isfinite(found.deflection).all(axis=1)
        table = found.deflection[~off][:, rod_columns(branch.robot)]
        return Elongated(CubicSpline(found.time[~off], table), FEW)

    return run


@cache
def _exact(scale: float) -> Array:
    return elastic_form.elastic_motion(scale).rods(CHECKED)


def judge(method: Method, setting: Setting, result: Elongated) -> Judged:
    """The largest error of the rods' elongations over the largest of them, and the passes."""
    return Judged(relative_error(result.rods(CHECKED), _exact(setting[0])), (float(result.passes),))


def _remark(rows: Sequence[Row]) -> str:
    lines = []
    ours, plain = finite(rows, "planned"), finite(rows, "repeated")
    if ours and plain:
        softest = min(row.setting[0] for row in ours)
        lines.append(
            f"Down to {softest:g} of the paper's stiffness the planner's deflections are right to "
            f"{short(max(row.error for row in ours))}, and it finds the singular point itself; plain "
            f"repetition, told where that is, is right to {short(max(row.error for row in plain))}."
        )
    refused = [row for row in rows if row.method == "planned" and not np.isfinite(row.error)]
    if refused:
        softest = max(row.setting[0] for row in refused)
        lines.append(f"From {softest:g} on downwards it refuses, and says why.")
    small, rigid = finite(rows, "small"), finite(rows, "rigid_point")
    at_one = [[row.error for row in found if row.setting == (1.0,)] for found in (small, rigid)]
    if at_one[0]:
        lines.append(f"At the paper's stiffness small displacements are {short(at_one[0][0])} off.")
    if at_one[1]:
        lines.append(f"With the law through the rigid robot's point: {short(at_one[1][0])}.")
    return " ".join(lines)


_GIVEN = "law through the deformed robot's point"
_PLAIN = f"{NODES} nodes, at most {MOST} passes, kept where a pass changes least"
_declared = partial(Method, given="path, duration, time, speed", unit="stiffness", settings=SCALES)
STAGE = Stage(
    name="elastic",
    title="Deflections of the deformed robot",
    reference="two equations in two unknowns at each instant, fifty digits (chart/elastic_form.py)",
    error="largest error of the rods over their largest",
    methods=(
        _declared("planned", "ours, planned and proved", partial(_planned, geometry="deformed")),
        _declared("small", "ours, small displacements", partial(_planned, geometry="rigid")),
        _declared(
            "repeated", "plain repetition", partial(_repeated, moved=True), given=_GIVEN, source=_PLAIN
        ),
        _declared(
            "rigid_point",
            "plain repetition, rigid point",
            partial(_repeated, moved=False),
            source=_PLAIN,
            given="law through the rigid point",
        ),
        _declared(
            "differences",
            f"finite differences, {FEW} passes",
            _differences,
            given=_GIVEN,
            source=f"{SAMPLES} samples, central differences, cubic spline",
        ),
    ),
    judge=judge,
    remark=_remark,
    abscissa="stiffness over the paper's",
    shown=("error", "profile"),
    profile=(1.0,),
    profile_error="passes",
    profile_title="How often forces are computed",
)
