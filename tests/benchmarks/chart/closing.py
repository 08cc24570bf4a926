"""Stage b: closing the loops of the rigid 5R, with the platform given, and with the motors given.

All methods solve the same equations, the framework's, from the same start, the pose 1/20 of the path before.
With the platform given a Type 2 singularity is no event. With the motors given two solutions meet there: what
is found is off by the square root of what the equations are solved to.
"""

from collections.abc import Callable, Sequence
from functools import cache, partial
from typing import NamedTuple

import numpy as np
from scipy import optimize

from framework import FrameworkError, assemble, forward_kinematics
from framework.kinematics.frames import frames_at
from framework.kinematics.inverse_kinematics import close_each, close_loops
from framework.numerics.arrays import Array, IntArray
from tests.benchmarks.chart import closed_form
from tests.benchmarks.chart import robot as given
from tests.benchmarks.chart.measure import Judged, Method, Row, Setting, Stage, singles
from tests.benchmarks.chart.peers.five_bar import BASES, LENGTH
from tests.benchmarks.chart.reading import finite
from tests.benchmarks.chart.torque import bare

POSES = np.linspace(0.05, 1.0, 96)  # path coordinates
BEHIND = 0.05  # of the path, where each search starts
S_C = float(closed_form.singular_s())
DISTANCES = tuple(10.0**-k for k in range(1, 9))  # of the path, before the singular point
ITERATIONS = singles(1, 2, 3, 4, 5, 6)
TOLERANCES = singles(1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-14)
RIGHT = 1e-2  # of the distance: the wrong solution is about as far as the singular point, the right one near
MANY = (50.0,)  # iterations where they should not be what is missing

Equations = Callable[[Array], tuple[Array, Array]]  # q (4,) -> residual (k,) and derivatives (k, k)
Solver = Callable[[Equations, Array, IntArray, Setting], Array]  # ..., start (4,), free columns -> q (4,)


class Closed(NamedTuple):
    """Joints at all poses, and the way in which they are found."""

    q: Array  # (T, 4)
    with_motors: Callable[[float], Array]  # path coordinate -> platform (2,) [m] with the motors given there


def _with_platform(x: Array) -> tuple[Equations, IntArray]:
    """The platform at x (2,), by pinocchio alone."""
    return lambda q: bare().evaluate(q, (x, None)), np.arange(4)


def _with_motors() -> tuple[Equations, IntArray]:
    """The loop closed, motors fixed, by pinocchio alone."""
    robot = bare()

    def equations(q: Array) -> tuple[Array, Array]:
        lacking, rows = robot.evaluate(q, (np.zeros(2), None))
        return lacking[:2], robot.passive(rows)

    return equations, robot.others


def newton(equations: Equations, start: Array, free: IntArray, setting: Setting) -> Array:
    """Newton's method."""
    q = start.copy()
    for _ in range(round(setting[0])):
        residual, derivatives = equations(q)
        q[free] -= np.linalg.solve(derivatives, residual)
    return q


def _unknowns(equations: Equations, start: Array, free: IntArray) -> Callable[[Array], tuple[Array, Array]]:
    def at(unknown: Array) -> tuple[Array, Array]:
        q = start.copy()
        q[free] = unknown
        return equations(q)

    return at


def scipy_root(equations: Equations, start: Array, free: IntArray, setting: Setting, *, method: str) -> Array:
    """scipy.optimize.root with exact derivatives."""
    q, at = start.copy(), _unknowns(equations, start, free)
    q[free] = optimize.root(at, start[free], jac=True, method=method, tol=setting[0]).x
    return q


def scipy_least_squares(equations: Equations, start: Array, free: IntArray, setting: Setting) -> Array:
    """scipy.optimize.least_squares, trust region, with exact derivatives."""
    q, at = start.copy(), _unknowns(equations, start, free)
    tolerance = max(setting[0], 3e-16)  # no less is allowed
    q[free] = optimize.least_squares(
        lambda u: at(u)[0],
        start[free],
        jac=lambda u: at(u)[1],
        xtol=tolerance,
        ftol=tolerance,
        gtol=tolerance,
    ).x
    return q


@cache
def _starts() -> Array:
    """Joints (T, 4) at the poses before."""
    robot, s = given.robot(), POSES - BEHIND
    return close_loops(robot, given.path()(s), given.branch().guess(s)).q


def _one_by_one(solver: Solver) -> Callable[[Setting], Callable[[], Closed]]:
    def prepare(setting: Setting) -> Callable[[], Closed]:
        places, starts = given.path()(POSES), _starts()
        most = MANY if setting in ITERATIONS else TOLERANCES[-1]

        def with_motors(s: float) -> Array:
            start = _joints_before(s)
            equations, free = _with_motors()
            return _platform(solver(equations, start, free, most))

        def run() -> Closed:
            found = []
            for x, start in zip(places, starts, strict=True):
                equations, free = _with_platform(x)
                found.append(solver(equations, start, free, setting))
            return Closed(np.array(found), with_motors)

        return run

    return prepare


def _ours(setting: Setting) -> Callable[[], Closed]:
    robot, places, starts = given.robot(), given.path()(POSES), _starts()

    def with_motors(s: float) -> Array:
        near = assemble(robot, given.path()(s - BEHIND))
        return np.asarray(forward_kinematics(robot, closed_form.crank_angles([s])[0], near=near.q).x)

    return lambda: Closed(close_each(robot, places, starts, iterations=round(setting[0])).q, with_motors)


def _formula(setting: Setting) -> Callable[[], Closed]:
    """The cranks from the triangle of each leg, all poses at once; the rods are not wanted."""
    places = given.path()(POSES)

    def run() -> Closed:
        q = np.full((len(places), 4), np.nan)
        for column, base, elbow in zip(given.robot().actuated, BASES, closed_form.ELBOWS, strict=True):
            reach = places[:, 0] - base + 1j * places[:, 1]
            q[:, column] = np.angle(reach) + elbow * np.arccos(np.abs(reach) / (2 * LENGTH))
        return Closed(q, lambda s: np.full(2, np.nan))

    return run


def _joints_before(s: float) -> Array:
    """The joints of the pose before, with the motors turned to where they belong."""
    robot = given.robot()
    before = np.array([s - BEHIND])
    q = close_loops(robot, given.path()(before), given.branch().guess(before)).q[0].copy()
    q[robot.actuated] = closed_form.crank_angles([s])[0]
    return q


def _platform(q: Array) -> Array:
    robot = given.robot()
    return np.asarray(robot.platform.coordinates(frames_at(robot, q[None]))[0])


@cache
def _exact() -> Array:
    return closed_form.crank_angles(POSES)


def judge(method: Method, setting: Setting, result: Closed) -> Judged:
    """The largest error of the cranks [rad]; with the motors given, that of the platform [m]."""
    cranks = result.q[:, given.robot().actuated] - _exact()
    error = np.abs(np.angle(np.exp(1j * cranks))).max()
    if method.name not in _PROFILES:
        _PROFILES[method.name] = tuple(_off(result, distance) for distance in DISTANCES)
    return Judged(float(error) if np.isfinite(error) else np.inf, _PROFILES[method.name])


_PROFILES: dict[str, tuple[float, ...]] = {}  # they do not depend on the setting


def _off(result: Closed, distance: float) -> float:
    """Error of the platform [m] at a distance before the singular point, motors given."""
    s = S_C - distance
    try:
        return float(np.linalg.norm(result.with_motors(s) - given.path()(s)))
    except (FrameworkError, ArithmeticError, np.linalg.LinAlgError):
        return np.nan


def _remark(rows: Sequence[Row]) -> str:
    astray = [_reach(finite(rows, name)) for name in ("newton", "stacked_newton")]
    if None in astray:
        return ""
    return (
        "With the motors given two solutions meet at the singular point: nearer to it than "
        f"{astray[0]:.0e} of the path Newton's method lands on the wrong one and says nothing; ours "
        f"follows its own as far as {astray[1]:.0e} and refuses what is nearer."
    )


def _reach(rows: Sequence[Row]) -> float | None:
    """The least distance up to which all platforms found are the right ones."""
    errors = rows[0].profile if rows else ()
    right = [error < RIGHT * distance for error, distance in zip(errors, DISTANCES, strict=False)]
    count = right.index(False) if False in right else len(right)
    return DISTANCES[count - 1] if count else None


_GIVEN = "exact derivatives"
_BARE = "equations by pinocchio and numpy alone (chart/bare.py), pose by pose"
_declared = partial(Method, given=_GIVEN, unit="iterations", settings=ITERATIONS)
STAGE = Stage(
    name="closing",
    title="Closing the loops, platform given",
    reference="closed form of the 5R in fifty digits (chart/closed_form.py)",
    error="largest error of the cranks  [rad]",
    methods=(
        _declared("stacked_newton", "ours, Newton on all poses at once", _ours),
        _declared("newton", "Newton, Pinocchio pose by pose", _one_by_one(newton), source=_BARE),
        *(
            _declared(
                f"scipy_{name}",
                f"scipy {words}",
                _one_by_one(solver),
                unit="tolerance",
                settings=TOLERANCES,
                source=_BARE,
            )
            for name, words, solver in (
                ("hybr", "root, Powell's hybrid", partial(scipy_root, method="hybr")),
                ("lm", "root, Levenberg-Marquardt", partial(scipy_root, method="lm")),
                ("trf", "least squares, trust region", scipy_least_squares),
            )
        ),
        _declared(
            "formula",
            "the robot's own formula",
            _formula,
            given="nothing",
            unit="evaluations",
            settings=singles(1),
            frontier=True,
        ),
    ),
    judge=judge,
    goals=(1e-6, 1e-12),
    remark=_remark,
    profile=DISTANCES,
    profiled="path coordinate before the singular point",
    profile_title="Motors given",
    profile_error="error of the platform, motors given  [m]",
)
