"""Stage: how time grows with the number of loops, and with the number of crossings of one path.

Loops: a row of N four-bars (robots/generators/n_four_bar.py, N from 2 to 100) swings from one side to the
other; its torque is written down in one line. Crossings: the 3-RPR of the catalogue, legs without mass, turns
about a corner of its platform through 1 to 6 singular points, against virtual work in mpmath. Each method has
the least number of nodes or samples of its ladder with which it is right to GOAL.
"""

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple
from unittest import mock

import numpy as np
import pinocchio as pin
from scipy.sparse import coo_array
from scipy.sparse.linalg import splu

from framework import Law, Line, ParallelRobot, track_path
from framework.numerics.arrays import Array
from framework.numerics.banded_lu import Band
from robots.generators import n_four_bar
from tests.benchmarks.chart.along import Along, Torque, crossing
from tests.benchmarks.chart.bare import UPRIGHT, BareRobot, Motion, Target
from tests.benchmarks.chart.measure import Judged, Method, Row, Setting, Stage, singles
from tests.benchmarks.chart.reading import Time, compared, finite
from tests.benchmarks.chart.spatial import BARE, STACKS

GOAL = 1e-10  # error over the largest torque
LOOPS, CROSSINGS = singles(2, 5, 10, 20, 50, 100), singles(1, 2, 3, 4, 5, 6)
NODES = (8, 10, 12, 14, 16, 20, 24, 32, 40, 48, 64, 80, 96, 128, 192, 256, 384, 512, 768)
SAMPLES = (11, 12, 13, 15, 17, 21, 25, 29, 33, 37, 41, 49, 65, 81, 97, 129, 193, 257, 385, 513, 769, 1025)
DEGREE, TOLERANCE = 9, 1e-10  # of splines, of proofs
SWING, DURATION, GRAVITY = 0.9, 1.5, 9.81  # [rad], [s], [m/s^2]
ROTOR, GEAR = 3.3e-5, 100.0  # of the generator's drive [kg m^2], -


def torque_of_row(loops: int, law: Law) -> Torque:
    """N + 1 rods of 1 kg and 1 m about their ends, N bars of 1 kg that only move along: one angle."""
    inertia, height = (loops + 1) / 3 + loops, (loops + 1) / 2 + loops  # [kg m^2], [kg m]

    def torque(times: Array) -> Array:
        x, ddx = SWING * (1 - 2 * law(times)), -2 * SWING * law(times, 2)
        return (ROTOR * GEAR * ddx + (inertia * ddx - GRAVITY * height * np.sin(x)) / GEAR)[:, None]

    return torque


@cache
def row(loops: int) -> Along:
    """The row of four-bars."""
    with tempfile.TemporaryDirectory() as folder:
        robot = ParallelRobot.from_file(n_four_bar.write(Path(folder), loops))
    branch, law = track_path(robot, Line([SWING], [-SWING])), Law.rest_to_rest(DURATION, 2)
    bare = BareRobot(robot, branch.guess(np.zeros(1))[0], UPRIGHT, (4,))
    return Along(branch, law, (), torque_of_row(loops, law), bare)


class DenseFactors:
    """Matrices of a band written out and solved by numpy, where the framework has its banded LU."""

    def __init__(self, band: Band, values: Array) -> None:
        column, place = np.divmod(band.index, band.height)
        row = place - band.lower - band.upper + column
        self.matrices = np.zeros((len(values), band.size, band.size))
        self.matrices[:, band.row_order[row], band.column_order[column]] = values

    def solve(self, right: Array) -> Array:
        """Right sides (.., T, k)."""
        return self._solve(self.matrices, right)

    def solve_transposed(self, right: Array) -> Array:
        """Right sides (.., T, k) of the transposed matrices."""
        return self._solve(self.matrices.swapaxes(1, 2), right)

    @staticmethod
    def _solve(matrices: Array, right: Array) -> Array:
        columns = right.reshape(-1, *right.shape[-2:]).transpose(1, 2, 0)
        return np.asarray(np.linalg.solve(matrices, columns).transpose(2, 0, 1).reshape(right.shape))


def dense(case: Along, count: float) -> Torque:
    """Ours on Chebyshev nodes, but for numpy's dense solves instead of the band."""
    with mock.patch.object(Band, "factor", lambda band, values: DenseFactors(band, values)):
        return case.nodes(count)


class SparseRobot(BareRobot):
    """The same with scipy's sparse LU of what is not zero by construction."""

    def __init__(self, robot: ParallelRobot, start: Array, axes: slice, platform: Sequence[int]) -> None:
        super().__init__(robot, start, axes, platform)
        model = self.model
        parents = [model.frames[frame].parentJoint for frame in self.frames]
        entries = [  # row, joint's column, axis, sign, frame
            (span.start + k, model.joints[joint].idx_v, axis, sign, frame)
            for span, *pair in self.loops
            for sign, frame in zip((1, -1), pair, strict=True)
            for joint in list(model.supports[parents[frame]])[1:]
            for k, axis in enumerate(range(*axes.indices(3)))
        ]
        entries += [
            (model.nv - self.size + k, model.joints[joint].idx_v, axis, 1, self.platform)
            for joint in list(model.supports[parents[self.platform]])[1:]
            for k, axis in enumerate(platform)
        ]
        row, column, self.axis, self.sign, self.frame = np.array(entries).T
        known = coo_array((np.arange(1.0, len(row) + 1), (row, column)), shape=(model.nv, model.nv)).tocsc()
        order = known.data.astype(int) - 1
        self.column, self.axis, self.sign, self.frame = (
            part[order] for part in (column, self.axis, self.sign, self.frame)
        )
        self.matrix = known

    def evaluate(self, q: Array, target: Target) -> tuple[Array, Any]:
        pin.computeJointJacobians(self.model, self.data, q)
        pin.updateFramePlacements(self.model, self.data)
        places = np.array([self.data.oMf[frame].translation for frame in self.frames])
        screws, arm, axis = self.data.J[:, self.column], places[self.frame].T, self.axis
        entry, after, last = np.arange(len(axis)), (axis + 1) % 3, (axis + 2) % 3
        turn = screws[3 + after, entry] * arm[last, entry] - screws[3 + last, entry] * arm[after, entry]
        self.matrix.data = self.sign * (screws[axis, entry] + np.where(axis < 3, turn, 0.0))
        lacking = np.empty(len(q))
        one, other = np.array([pair for _, *pair in self.loops]).T
        lacking[: -self.size] = (places[one] - places[other])[:, self.axes].ravel()
        here, (_, wanted) = self.data.oMf[self.frames[self.platform]].rotation, target
        lacking[-self.size :] = -pin.log3(wanted @ here.T)[self.angular]
        return lacking, splu(self.matrix)

    def step(self, rows: Any, lacking: Array) -> Array:
        return rows.solve(lacking)

    def solve(self, rows: Any, right: Array) -> Array:
        return np.array([one.solve(b) for one, b in zip(rows, right, strict=True)])

    def stacked(self, rows: list[Any]) -> Any:
        return rows

    def torques(self, motion: Motion) -> Array:
        """Of one motor: so that nobody holds the platform."""
        sides = np.zeros((len(motion.q), self.model.nv, 2))
        sides[..., 0], sides[:, self.motors[0], 1] = self.forces(motion), 1.0
        carried = np.array([one.solve(b, "T")[-1] for one, b in zip(motion.rows, sides, strict=True)])
        return self.with_rotors(motion, carried[:, :1] / carried[:, 1:])


@cache
def sparse(loops: int) -> Along:
    case = row(loops)
    return replace(case, bare=SparseRobot(case.robot, case.bare.start, UPRIGHT, (4,)))


class Answer(NamedTuple):
    """A torque, and with how many nodes or samples."""

    torque: Torque
    size: float


def _fewest(
    case_of: Callable[[int], Along], way: Callable[..., Torque], counts: Sequence[int], *more: float
) -> Callable[[Setting], Callable[[], Answer]]:
    def prepare(setting: Setting) -> Callable[[], Answer]:
        case = case_of(round(setting[0]))
        tried = ((count, case.error(way(case, count, *more))) for count in counts)
        count = next((count for count, error in tried if error < GOAL), counts[-1])
        return lambda: Answer(way(case, count, *more), count)

    return prepare


def judge(method: Method, setting: Setting, result: Answer) -> Judged:
    """The largest error over the largest torque, and the nodes or samples."""
    case = row if method.panel == ROWS else turning
    return Judged(case(round(setting[0])).error(result.torque), (result.size,))


def turning(count: int) -> Along:
    """The 3-RPR through so many singular points."""
    return crossing("three_rpr", count)


def _remark(rows: Sequence[Row]) -> str:
    return " ".join(_growth(rows, panel) for panel in STAGE.panels)


def _growth(rows: Sequence[Row], panel: str) -> str:
    """Powers with which times grow, and who is quicker at the end."""
    powers, refused, ends = [], list[str](), dict[str, list[Time]]()
    for method in STAGE.methods:
        known = finite(rows, method.name)
        if method.panel == panel and len(known) > 1:
            counts, times = np.log([[row.setting[0], row.seconds] for row in known]).T
            powers.append(f"{method.label} {np.polyfit(counts, times, 1)[0]:.1f}")
            if known[-1].setting == method.settings[-1]:
                ends.setdefault(method.kind, []).append(Time(method, known[-1].seconds, known[-1].upper))
            lost = [
                row.setting[0] for row in rows if row.method == method.name and not np.isfinite(row.error)
            ]
            refused += [f" Refused from {min(lost):.0f} on: {method.label}."] if lost else []
    quickest = [min(times, key=lambda time: time.least) for times in ends.values()]
    if not quickest:
        return ""
    return (
        f"{panel}: time to {GOAL:.0e} grows with a power of their number: {'; '.join(powers)}. "
        f"At the most of them: {compared(quickest)}.{''.join(refused)}"
    )


ROWS, TURNS = "Loops, row of four-bars", "Crossings, 3-RPR"
_LAW = "path followed, law exact"
_STACKED, _BARE = "pointwise in stacks, our kinematics", "pointwise, Pinocchio, numpy"
_DENSE = "numpy.linalg.solve for our banded LU"


def _method(name: str, label: str, prepare: Any, *, given: str = _LAW, source: str = "") -> Method:
    unit, settings, panel = (
        ("loops", LOOPS, ROWS) if name.startswith("loops") else ("crossings", CROSSINGS, TURNS)
    )
    return Method(name, label, prepare, given, unit, settings, source, panel=panel)


STAGE = Stage(
    name="growth",
    title="Growth with loops and with crossings",
    reference="one line of virtual work (chart/growth.py); virtual work in mpmath (chart/virtual_work.py)",
    error="largest error over the largest torque",
    methods=(
        _method("loops-nodes", "ours, Chebyshev nodes", _fewest(row, Along.nodes, NODES)),
        _method("loops-dense", "our nodes, dense solves", _fewest(row, dense, NODES), source=_DENSE),
        _method("loops-stacks", _STACKED, _fewest(row, Along.stacks, SAMPLES, DEGREE), source=STACKS),
        _method("loops-pinocchio", _BARE, _fewest(row, Along.pinocchio, SAMPLES, DEGREE), source=BARE),
        _method(
            "loops-sparse",
            "pointwise, Pinocchio, sparse LU",
            _fewest(sparse, Along.pinocchio, SAMPLES, DEGREE),
            source=f"{BARE}; scipy's splu in place of dense solves",
        ),
        _method("crossings-nodes", "ours, Chebyshev nodes", _fewest(turning, Along.nodes, NODES)),
        _method(
            "crossings-proved",
            "ours, located and proved",
            _fewest(turning, lambda case, _: case.proved(TOLERANCE), (1,)),
            given="path and law",
        ),
        _method("crossings-stacks", _STACKED, _fewest(turning, Along.stacks, SAMPLES, DEGREE), source=STACKS),
        _method(
            "crossings-pinocchio", _BARE, _fewest(turning, Along.pinocchio, SAMPLES, DEGREE), source=BARE
        ),
    ),
    judge=judge,
    remark=_remark,
    shown=("time", "error"),
    profile=(1.0,),
    profile_error="nodes or samples",
)
