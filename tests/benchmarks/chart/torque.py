"""Stage a: motor torques along a crossing of the rigid 5R (scene C, 10 kg, singular at 1 s).

Three products in three panels. Motion given: positions, rates and accelerations of all joints are known at
the nodes, and the torques are wanted as a function of time. Path and law given: the path is followed already,
and the loops are closed at the nodes too, from the same guesses for all. Located and proved: path and law
alone are given; the singular point is to be found, condition (8) to be checked, and the error to be bounded
or estimated. On nodes each method has the same Chebyshev nodes and solves its systems in one stack. Instant
by instant the torque is a quotient 0/0 at the crossing: what a method leaves of condition (8) by rounding, by
differences or by damping is divided by the distance to the singular instant. Tables are read by splines of
degree 3, 5, 7 and 9.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike
from scipy import fft, optimize
from scipy.interpolate import make_interp_spline

from framework import plan_crossing
from framework.dynamics.forces import joint_forces, motor_torque
from framework.kinematics import Motion
from framework.kinematics.linearised_loops import linearised_at
from framework.laws import MotionLaw
from framework.numerics import Array
from tests.benchmarks.chart import closed_form
from tests.benchmarks.chart import robot as given
from tests.benchmarks.chart.bare import solve_each
from tests.benchmarks.chart.formula import torques
from tests.benchmarks.chart.measure import Judged, Method, Row, Setting, Stage, pairs, singles
from tests.benchmarks.chart.reading import best, short
from tests.benchmarks.chart.robot import SceneC, Solve, bare

T, T_C = given.DURATION, given.CROSSING_TIME
DISTANCES = tuple(10.0**-k for k in range(1, 10))  # [s] from the singular instant
DEGREES = (3, 5, 7, 9)  # of the splines
# No table has a sample on the singular instant, 2/3 of the duration: 2^k intervals are no multiple of three.
COUNTS = tuple(2**k + 1 for k in range(4, 13))
TABLES = pairs(COUNTS, DEGREES)
NODES = singles(16, 20, 24, 32, 40, 48, 56, 64, 80, 96, 128)
THRESHOLD = (257.0, 9.0)  # samples and degree of the table where the setting is a threshold
LEAST_COUNT, MOST_COUNT = 33, 4097  # samples of tables that are doubled
BALANCED = 1e-6  # condition (8) over the size of the forces, for a table to be trusted


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
        back, middle, ahead = (self.law(np.clip(times + k * h, 0.0, T)) for k in (-1, 0, 1))
        return (middle, (ahead - back) / (2 * h), (ahead - 2 * middle + back) / h**2)[order]


def pseudo_inverse(cut: float) -> Solve:
    """Singular values below `cut` times the largest are left out."""
    return lambda matrix, right: np.einsum("tij,tj->ti", np.linalg.pinv(matrix, rcond=cut), right)


def damped(damping: float) -> Solve:
    """Least squares with a penalty on lambda: (M' M + mu^2) lambda = M' r, mu a share of the size of M."""

    def solve(matrix: Array, right: Array) -> Array:
        back = matrix.transpose(0, 2, 1)
        penalty = (damping * np.linalg.norm(matrix, axis=(1, 2))) ** 2
        return solve_each(
            back @ matrix + penalty[:, None, None] * np.eye(matrix.shape[-1]),
            (back @ right[..., None])[..., 0],
        )

    return solve


def formula(law: MotionLaw, times: Array) -> Array:
    """Motor torques (T, 2) [N m] by the robot's own formula."""
    return torques(*(law(times, order) for order in range(3)))


def tabulated(torque: Callable[[Array], Array], setting: Setting) -> Torques:
    """A table of so many samples at equal distances, read by a spline of that degree."""
    samples, degree = map(round, setting[:2])
    times = np.linspace(0.0, T, samples)
    return Torques(make_interp_spline(times, torque(times), k=degree), torque)


def _tables(torque: Callable[[MotionLaw, Array], Array]) -> Callable[[Setting], Callable[[], Torques]]:
    def prepare(setting: Setting) -> Callable[[], Torques]:
        law = given.law()
        return lambda: tabulated(lambda t: torque(law, t), setting)

    return prepare


def _differences(setting: Setting) -> Callable[[], Torques]:
    law = DifferencedLaw(given.law(), setting[0])
    return lambda: tabulated(SceneC(law).pointwise, THRESHOLD)


def _regularised(kind: Callable[[float], Solve]) -> Callable[[Setting], Callable[[], Torques]]:
    def prepare(setting: Setting) -> Callable[[], Torques]:
        law, solve = given.law(), kind(setting[0])
        return lambda: tabulated(lambda t: SceneC(law).pointwise(t, solve), THRESHOLD)

    return prepare


def _chebyshev(setting: Setting) -> Callable[[], Torques]:
    case = SceneC(given.law())

    def run() -> Torques:
        series = case.nodes(setting[0])
        return Torques(series, series)

    return run


def _series(torque: Callable[[Array], Array], nodes: Array) -> Torques:
    """The Chebyshev series through a method's torques at the nodes."""
    series = fft.dct(torque(nodes), axis=0) / len(nodes)
    series[0] /= 2

    def values(t: Array) -> Array:
        return np.asarray(chebyshev.chebval(2 * np.asarray(t) / T - 1, series)).T

    return Torques(values, values)


def _nodes(setting: Setting) -> Array:
    """Chebyshev nodes [s], of which none is at the singular instant: cos(pi (k + 1/2) / N) is never 1/3."""
    size = round(setting[0])
    return np.asarray(0.5 * T * (1.0 + np.cos(np.pi * (np.arange(size) + 0.5) / size)))


def _formula_series(setting: Setting) -> Callable[[], Torques]:
    law, nodes = given.law(), _nodes(setting)
    return lambda: _series(lambda t: formula(law, t), nodes)


def _of_motion(torques: Callable[[], Callable[..., Array]]) -> Callable[[Setting], Callable[[], Torques]]:
    """Methods that are given q, v, a of all joints at the nodes; `torques` makes one ready."""

    def prepare(setting: Setting) -> Callable[[], Torques]:
        nodes, method = _nodes(setting), torques()
        motion = SceneC(given.law()).motion(nodes)
        return lambda: _series(lambda _: method(motion.q, motion.v, motion.a), nodes)

    return prepare


def _ours_of_motion() -> Callable[..., Array]:
    robot = given.robot()

    def torques_of(q: Array, v: Array, a: Array) -> Array:
        motion = Motion(q, v, a, linearised_at(robot, q))
        return motor_torque(robot, motion, joint_forces(robot, motion).joint_torque)

    return torques_of


def _constraint_dynamics() -> Callable[..., Array]:
    from tests.benchmarks.chart.peers.pinocchio_constraint import ConstraintDynamics

    return ConstraintDynamics(given.robot()).torques


def _pinocchio_nodes(setting: Setting) -> Callable[[], Torques]:
    case, nodes = SceneC(given.law()), _nodes(setting)
    return lambda: _series(lambda t: case.bare_torques(t, case.guess(t)), nodes)


def _mujoco_nodes(setting: Setting) -> Callable[[], Torques]:
    case, tree, nodes = SceneC(given.law()), _tree(), _nodes(setting)
    return lambda: _series(lambda t: tree.torques(*tree.motion(*case.platform(t), case.guess(t))), nodes)


def _certified(setting: Setting) -> Callable[[], Torques]:
    case = SceneC(given.law())

    def run() -> Torques:
        torque = case.proved(setting[0])
        return Torques(torque, torque)

    return run


def _planned(setting: Setting) -> Callable[[], Torques]:
    speed = float(closed_form.CROSSING_SPEED)

    def run() -> Torques:
        plan = plan_crossing(given.robot(), given.path(), duration=T, times=[T_C], speeds=[speed])
        return Torques(plan.torque, plan.torque)

    return run


def doubled(law: MotionLaw, agreement: float) -> Callable[[], Torques]:
    """Point located by Brent on the determinant, condition (8) checked, table doubled until it stays."""
    robot, case = bare(), SceneC(law)

    def measure(s: float) -> float:
        rows = robot.close(given.path()(s), near[np.searchsorted(places, s) - 1])[1]
        return float(np.linalg.det(robot.passive(rows)))

    places = np.linspace(0.0, 1.0, LEAST_COUNT)
    near = np.empty((0, 4))

    def torques(times: Array) -> Array:
        """All poses in one stack, from guesses between those of the path as followed."""
        return case.bare_torques(times, np.stack([np.interp(law(times), places, q) for q in near.T], axis=1))

    def run() -> Torques:
        nonlocal near
        near, rows = robot.joints(given.path()(places))
        signs = np.sign(np.linalg.det(robot.passive(rows)))
        size = np.abs(robot.forces(case.bare_motion(np.linspace(0.0, T, LEAST_COUNT)))).max()
        for k in np.flatnonzero(signs[:-1] != signs[1:]):
            s_c = optimize.brentq(measure, places[k], places[k + 1], xtol=1e-15)
            t_c = optimize.brentq(lambda t, s=s_c: float(law(t)) - s, 0.0, T, xtol=1e-15)
            there = case.bare_motion(np.array([t_c]), near[k])
            free = np.linalg.svd(robot.passive(there.rows[0]))[2][-1]
            if abs(free @ robot.forces(there)[0, robot.others]) > BALANCED * size:
                raise ArithmeticError(f"unbounded torque at t = {t_c:.6g} s")
        samples, before = LEAST_COUNT, None
        while samples <= MOST_COUNT:
            times = np.linspace(0.0, T, samples)
            values = torques(times)
            if before is not None and np.abs(before(times) - values).max() < agreement:
                return Torques(make_interp_spline(times, values, k=9), torques)
            samples, before = 2 * samples - 1, make_interp_spline(times, values, k=9)
        raise ArithmeticError(f"tables differ by more than {agreement:g} N m up to {MOST_COUNT} samples")

    return run


def _tree() -> Any:
    """The open tree in MuJoCo, with the joints in the order of the robot."""
    from tests.benchmarks.chart.peers.five_bar import FiveBar
    from tests.benchmarks.chart.peers.mujoco_inverse import Tree

    robot = given.robot()
    joints = [robot.coordinates.name_of(column) for column in range(robot.model.nv)]
    return Tree(FiveBar.of("five_bar", "rigid"), joints)


def _mujoco_table(setting: Setting) -> Callable[[], Torques]:
    case, tree = SceneC(given.law()), _tree()
    return lambda: tabulated(lambda t: tree.torques(*tree.motion(*case.platform(t), case.guess(t))), setting)


def reference(times: Array, *, offset: float = 0.0) -> Array:
    """Motor torques (T, 2) [N m] in closed form."""
    return given.exact(offset=offset).torque(times)


_NEAR = np.array([[T_C - d, T_C + d] for d in DISTANCES])
_CHECKED = np.sort(np.concatenate([np.linspace(0.0, T, 151), _NEAR.ravel()]))


@cache
def _exact() -> tuple[Array, Array]:
    """Torques at all instants that are checked, and near the singular one."""
    return reference(_CHECKED), reference(_NEAR.ravel())


def judge(method: Method, setting: Setting, result: Torques) -> Judged:
    """The largest error of the table, and of the method itself at each distance from the singular instant."""
    exact, exact_near = _exact()
    with np.errstate(all="ignore"):
        table = np.abs(result.table(_CHECKED) - exact).max()
        near = np.abs(result.instant(_NEAR.ravel()) - exact_near).max(axis=1).reshape(-1, 2).max(axis=1)
    return Judged(float(table), tuple(near))


def _profiles(rows: Sequence[Row], name: str) -> list[tuple[float, ...]]:
    """The profile of the best row of a method, if it has one."""
    row = best(rows, name)
    return [row.profile] if row is not None and row.profile else []


def _remark(rows: Sequence[Row]) -> str:
    names = {"pseudo_inverse": "pseudo-inverse with cut", "damped": "least squares with damping"}
    shown = [f"{words} {row.setting[0]:.0e}" for name, words in names.items() if (row := best(rows, name))]
    nearest = [p[-1] for name in ("pointwise", "chebyshev") for p in _profiles(rows, name)]
    if not shown or len(nearest) < 2:
        return ""
    return (
        f"Right, asked at one instant, each as it has the best table ({', '.join(shown)}): at 1 ns from the "
        f"singular one the pointwise solve is off by {short(nearest[0])} N m, ours by {short(nearest[1])}."
    )


MOTION, EVALUATED, PROVED = "motion of all joints given", "path and law given", "located and proved"
_JOINTS = "all joints' q, q', q\""
_GIVEN = "path followed; s, s', s\" exact"
_TABLE = "samples, degree"
_CUTS = singles(*(10.0**-k for k in range(1, 13)))
_moved = partial(Method, panel=MOTION, given=_JOINTS, unit="nodes", settings=NODES)
_ours = partial(Method, panel=EVALUATED)
_nodes_of = partial(Method, panel=EVALUATED, given=_GIVEN, unit="nodes", settings=NODES)
_table = partial(Method, given=_GIVEN, unit=_TABLE, settings=TABLES, panel=EVALUATED)
_cut = partial(Method, given=_GIVEN, settings=_CUTS, panel=EVALUATED)
_proved = partial(Method, panel=PROVED)
STAGE = Stage(
    name="torque",
    title="Motor torques along a crossing",
    reference="closed form of the 5R in fifty digits (chart/closed_form.py)",
    error="largest error of the torques  [N m]",
    methods=(
        _moved("forces", "ours, nodes", _of_motion(_ours_of_motion)),
        _moved(
            "pinocchio_forces",
            "Pinocchio and numpy, nodes",
            _of_motion(lambda: bare().torques_of),
            source="chart/bare.py: rnea and frame Jacobians at each node, one stacked solve",
        ),
        _moved(
            "mujoco_forces",
            "MuJoCo, nodes",
            _of_motion(lambda: _tree().torques),
            source="mj_inverse of the open tree and mj_jacSite at each node, one stacked solve",
            package="mujoco",
        ),
        _moved(
            "constraint",
            "Pinocchio's constraintDynamics, nodes",
            _of_motion(_constraint_dynamics),
            source="three calls at each node, turned round (peers/pinocchio_constraint.py)",
        ),
        _ours("chebyshev", "ours, nodes", _chebyshev, _GIVEN, "nodes", NODES),
        _nodes_of(
            "pinocchio_nodes",
            "Pinocchio and numpy, nodes",
            _pinocchio_nodes,
            source="chart/bare.py: Newton's method in stacks, rnea at each node, one stacked solve",
        ),
        _nodes_of(
            "mujoco_nodes",
            "MuJoCo, nodes",
            _mujoco_nodes,
            source="loops closed by MuJoCo's Jacobians and mj_jacDot in stacks, then as above",
            package="mujoco",
        ),
        _table(
            "pointwise",
            "tables, our kinematics",
            _tables(lambda law, t: SceneC(law).pointwise(t)),
            source="poses closed in one stack by the framework, everything else numpy; table by spline",
        ),
        _table(
            "pinocchio",
            "tables, Pinocchio and numpy",
            _tables(lambda law, t: SceneC(law).bare_torques(t, SceneC(law).guess(t))),
            source="as Pinocchio and numpy on nodes (chart/bare.py); table by spline",
        ),
        _table(
            "mujoco",
            "tables, MuJoCo",
            _mujoco_table,
            source="as MuJoCo on nodes (peers/mujoco_inverse.py); table by spline",
            package="mujoco",
        ),
        _table(
            "differences",
            "central differences",
            _differences,
            given="path followed; s alone",
            unit="step [s]",
            settings=singles(*(10.0 ** (-0.5 * k) for k in range(4, 15))),
            source="step as in the table, the pointwise solve in stacks; 257 samples, degree 9",
        ),
        _cut(
            "pseudo_inverse",
            "pseudo-inverse",
            _regularised(pseudo_inverse),
            unit="cut of singular values",
            source="numpy's pinv, relative cut as in the table; 257 samples, degree 9",
        ),
        _cut(
            "damped",
            "damped least squares",
            _regularised(damped),
            unit="damping over the size of P",
            source="normal equations with mu^2, damping as in the table; 257 samples, degree 9",
        ),
        _ours(
            "formula",
            "the robot's own formula, nodes",
            _formula_series,
            "s, s', s\" exact",
            "nodes",
            NODES,
            frontier=True,
        ),
        _proved(
            "certified",
            "ours, located and proved",
            _certified,
            "path and law",
            "tolerance",
            singles(1e-6, 1e-9, 1e-12),
        ),
        _proved(
            "planned", "ours, law found too", _planned, "path, duration, time, speed", "plans", singles(1)
        ),
        _proved(
            "doubled",
            "Pinocchio's tables, doubled",
            lambda setting: doubled(given.law(), setting[0]),
            "path and law",
            "agreement [N m]",
            singles(1e-3, 1e-5, 1e-7, 1e-9, 1e-11, 1e-12),
            source="determinant's sign on 33 poses, Brent, condition (8) there, splines of degree 9",
        ),
    ),
    judge=judge,
    goals=(1e-6, 1e-10),
    remark=_remark,
    profile=DISTANCES,
    profiled="distance to the instant  [s]",
    profile_title="Asked at that very instant",
    short={
        "formula": "formula written for this robot",
        "pinocchio_nodes": "Pinocchio, the same nodes",
        "chebyshev": "this framework",
        "mujoco_nodes": "MuJoCo, the same nodes",
        "pinocchio": "Pinocchio, tables",
    },
)
