"""Stage a: motor torques along a crossing of the rigid 5R (scene C, 10 kg, singular at 1 s).

All methods but the certified one have the path followed and the law given. Instant by instant the torque is a
quotient 0/0 at the crossing: what a method leaves of condition (8) by rounding, by differences or by damping
is divided by the distance to the singular instant. Between its instants a table is read by a cubic spline.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from framework.arrays import Array, ArrayLike
from framework.dynamics.elasticity import solve_deflections
from framework.dynamics.forces import motor_torque, tree_forces
from framework.dynamics.inverse_dynamics import inverse_dynamics
from framework.kinematics.inverse_kinematics import close_loops
from framework.kinematics.motion_rates import Motion, motion_at
from framework.motion.chebyshev import TimeGrid
from framework.motion.law import MotionLaw
from framework.motion.path import along
from tests.benchmarks.chart import robot as given
from tests.benchmarks.chart.formula import torques
from tests.benchmarks.chart.measure import Judged, Method, Row, Setting, Stage, singles
from tests.benchmarks.chart.reading import best_within, error_at_best, gain, quickest_to, short

T, T_C = given.DURATION, given.CROSSING_TIME
DISTANCES = tuple(10.0**-k for k in range(1, 10))  # [s] from the singular instant
ENDS = np.array([0.0, T])
# No table has a sample on the singular instant, 2/3 of the duration: 2^k intervals are no multiple of three.
SAMPLES = singles(*(2**k + 1 for k in range(4, 13)))
NODES = singles(16, 24, 32, 48, 64, 96, 128, 192, 256)
FORMULA = 1e-10  # [N m] the error for which the reader is told what the robot's own formula takes
TABLE = 1025  # samples where the setting is something else

Solve = Callable[[Array, Array], Array]  # P' (T, m, m) and r (T, m) -> lambda (T, m) with P' lambda = r


class Torques(NamedTuple):
    """Torques (T, n_a) [N m] at any times (T,) [s]: as a table gives them, and as asked at that instant."""

    table: Callable[[Array], Array]
    instant: Callable[[Array], Array]


@dataclass(frozen=True)
class DifferencedLaw:
    """A law of which only values are known: derivatives by central differences over `step` [s]."""

    law: MotionLaw
    step: float

    @property
    def duration(self) -> float:
        return self.law.duration

    def __call__(self, t: ArrayLike, order: int = 0) -> Array:
        times, h = np.asarray(t, dtype=float), self.step
        back, here, ahead = (self.law(np.clip(times + k * h, 0.0, T)) for k in (-1, 0, 1))
        return (here, (ahead - back) / (2 * h), (ahead - 2 * here + back) / h**2)[order]


def motion_of(law: MotionLaw, times: Array, name: str = "five_bar") -> Motion:
    """All joints along scene C."""
    branch = given.branch(name)
    s = [law(times, order) for order in range(3)]
    x, dx, ddx = along(branch.path, s)
    return motion_at(branch.robot, close_loops(branch.robot, x, branch.guess(s[0])), dx, ddx)


def pointwise(law: MotionLaw, times: Array, solve: Solve) -> Array:
    """Motor torques (T, n_a) [N m], at each instant for itself: tau = r_a - J_a' lambda, P' lambda = r_p."""
    robot = given.robot()
    motion = motion_of(law, times)
    r, rows = tree_forces(robot, motion), motion.linearised.closures
    multipliers = solve(rows[:, :, robot.following].transpose(0, 2, 1), r[:, robot.following])
    joint = r[:, robot.actuated] - np.einsum("tma,tm->ta", rows[:, :, robot.actuated], multipliers)
    return motor_torque(robot, motion, joint)


def direct(matrix: Array, right: Array) -> Array:
    """Gauss's elimination."""
    return np.asarray(np.linalg.solve(matrix, right[..., None])[..., 0])


def pseudo_inverse(cut: float) -> Solve:
    """Singular values below `cut` times the largest are left out."""
    return lambda matrix, right: np.einsum("tij,tj->ti", np.linalg.pinv(matrix, rcond=cut), right)


def damped(damping: float) -> Solve:
    """Least squares with a penalty on lambda: (M' M + mu^2) lambda = M' r, mu a share of the size of M."""

    def solve(matrix: Array, right: Array) -> Array:
        back = matrix.transpose(0, 2, 1)
        penalty = (damping * np.linalg.norm(matrix, axis=(1, 2))) ** 2
        return direct(
            back @ matrix + penalty[:, None, None] * np.eye(matrix.shape[-1]),
            (back @ right[..., None])[..., 0],
        )

    return solve


def tabulated(torque: Callable[[Array], Array], samples: float) -> Torques:
    """A table of so many samples at equal distances."""
    times = np.linspace(0.0, T, round(samples))
    return Torques(CubicSpline(times, torque(times)), torque)


def _pointwise(setting: Setting) -> Callable[[], Torques]:
    law = given.law()
    return lambda: tabulated(lambda t: pointwise(law, t, direct), setting[0])


def _formula(setting: Setting) -> Callable[[], Torques]:
    law = given.law()
    return lambda: tabulated(lambda t: torques(*(law(t, order) for order in range(3))), setting[0])


def _differences(setting: Setting) -> Callable[[], Torques]:
    law = DifferencedLaw(given.law(), T / (setting[0] - 1))
    return lambda: tabulated(lambda t: pointwise(law, t, direct), setting[0])


def _regularised(kind: Callable[[float], Solve]) -> Callable[[Setting], Callable[[], Torques]]:
    def prepare(setting: Setting) -> Callable[[], Torques]:
        law, solve = given.law(), kind(setting[0])
        return lambda: tabulated(lambda t: pointwise(law, t, solve), TABLE)

    return prepare


def _chebyshev(setting: Setting) -> Callable[[], Torques]:
    branch, law = given.branch(), given.law()

    def run() -> Torques:
        grid = TimeGrid.clear_of(np.array([T_C]), ENDS, round(setting[0]))
        state = solve_deflections(branch, grid, lambda *_: law, "rigid", None, law)
        series = grid.fit(motor_torque(branch.robot, state.motion, state.forces.joint_torque))
        return Torques(series, series)

    return run


def _certified(setting: Setting) -> Callable[[], Torques]:
    law = given.law()

    def run() -> Torques:
        found = inverse_dynamics(given.robot(), given.path(), law, tolerance=setting[0])
        return Torques(found.torque, found.torque)

    return run


def _mujoco(setting: Setting) -> Callable[[], Torques]:
    from tests.benchmarks.chart.peers.five_bar import FiveBar
    from tests.benchmarks.chart.peers.mujoco_inverse import Tree

    robot, law = given.robot(), given.law()
    tree = Tree(
        FiveBar.of("five_bar", "rigid"), [robot.coordinates.name_of(c) for c in range(robot.model.nv)]
    )
    times = np.linspace(0.0, T, round(setting[0]))
    known = motion_of(law, times)

    def instant(t: Array) -> Array:
        motion = known if t is times else motion_of(law, t)
        return tree.inverse(motion.q, motion.v, motion.a).torque

    return lambda: Torques(CubicSpline(times, instant(times)), instant)


def reference(times: Array, *, offset: float = 0.0) -> Array:
    """Motor torques (T, 2) [N m] in closed form."""
    return given.exact(offset=offset).torque(times)


_NEAR = np.array([[T_C - d, T_C + d] for d in DISTANCES])
_CHECKED = np.sort(np.concatenate([np.linspace(0.0, T, 151), _NEAR.ravel()]))
_EXACT: dict[str, Array] = {}


def judge(method: Method, setting: Setting, result: Torques) -> Judged:
    """The largest error of the table, and of the method itself at each distance from the singular instant."""
    if not _EXACT:
        _EXACT.update(checked=reference(_CHECKED), near=reference(_NEAR.ravel()))
    with np.errstate(all="ignore"):
        table = np.abs(result.table(_CHECKED) - _EXACT["checked"]).max()
        near = np.abs(result.instant(_NEAR.ravel()) - _EXACT["near"]).max(axis=1).reshape(-1, 2).max(axis=1)
    return Judged(float(table), tuple(near))


def _sentence(rows: Sequence[Row]) -> str:
    lines = []
    for other, words in (("pointwise", "the best pointwise solve"), ("differences", "finite differences")):
        found = gain(rows, "chebyshev", other)
        if found is not None:
            lines.append(
                f"Against {words}: {found.time:.2g} times less time at its least error "
                f"({short(found.error)} N m in {1e3 * found.seconds:.3g} ms), and "
                f"{short(found.accuracy)} times less error in {1e3 * found.within:.2g} ms."
            )
    nearest = error_at_best(rows, "pointwise", -1), error_at_best(rows, "chebyshev", -1)
    if None not in nearest:
        lines.append(
            f"At 1 ns from the singular instant a solve for that instant is off by {short(nearest[0])} N m, "
            f"the series by {short(nearest[1])}."
        )
    known = quickest_to(rows, "formula", FORMULA)
    if known is not None:
        lines.append(
            f"A formula written for this robot alone has a table to {short(known.error)} N m in "
            f"{1e3 * known.seconds:.2g} ms; no other method here knows its formulas."
        )
    whole = best_within(rows, "certified")
    if whole is not None:
        lines.append(f"Path followed, point located and result proved: {1e3 * whole.seconds:.3g} ms.")
    return " ".join(lines)


_GIVEN = "path followed; s, s', s\" exact"
STAGE = Stage(
    name="torque",
    title="Motor torques along a crossing",
    reference="closed form of the 5R in fifty digits (chart/closed_form.py)",
    error="largest error of the torques  [N m]",
    methods=(
        Method("chebyshev", "ours, Chebyshev nodes", _GIVEN, "nodes", NODES, _chebyshev, ours=True),
        Method(
            "certified",
            "ours, located and proved",
            "path and law alone",
            "tolerance",
            singles(1e-10),
            _certified,
            ours=True,
        ),
        Method("pointwise", "best pointwise solve", _GIVEN, "samples", SAMPLES, _pointwise),
        Method("formula", "this robot's own formula", "s, s', s\" exact", "samples", SAMPLES, _formula),
        Method(
            "differences", "finite differences", "path followed; s alone", "samples", SAMPLES, _differences
        ),
        Method(
            "pseudo_inverse",
            "pseudo-inverse",
            _GIVEN,
            "cut of singular values",
            singles(*(10.0**-k for k in range(1, 10))),
            _regularised(pseudo_inverse),
            shown=(1e-5,),
        ),
        Method(
            "damped",
            "damped least squares",
            _GIVEN,
            "damping",
            singles(*(10.0**-k for k in range(1, 10))),
            _regularised(damped),
            shown=(1e-5,),
        ),
        Method(
            "mujoco",
            "MuJoCo, inverse",
            "all joints' q, q', q\" exact",
            "samples",
            SAMPLES[:7],
            _mujoco,
            peer="mujoco",
        ),
    ),
    judge=judge,
    sentence=_sentence,
    profile=DISTANCES,
    profiled="distance to the singular instant  [s]",
    profile_title="Asked at that very instant",
)
