"""Stage c: where the path is singular and which twist t_s is uncontrolled there, by measures of one matrix.

P (2, 2) are the passive columns of the loop equations, singular in Type 2. Ours see the framework's P(s), the
others the same by pinocchio and numpy alone (chart/bare.py); all search [0.6, 0.75]. The least singular value
has a kink and no sign: its minimum is found to half the digits. The determinant, the last entry of R and the
bordered g change sign.
"""

from collections.abc import Callable, Sequence
from decimal import Decimal
from functools import cache, partial
from typing import NamedTuple

import numpy as np
from scipy import linalg, optimize

from framework import locate_singularities
from framework.kinematics.linearised_loops import LinearisedLoops, passive_matrix, passive_motion
from framework.numerics.arrays import Array
from framework.singularity.bordered_system import Border, differentiate_g, root_of_g, solve_bordered, stencil
from tests.benchmarks.chart import closed_form
from tests.benchmarks.chart import robot as given
from tests.benchmarks.chart.measure import Judged, Method, Row, Setting, Stage, singles
from tests.benchmarks.chart.reading import best, short
from tests.benchmarks.chart.torque import bare

LOW, HIGH = 0.6, 0.75  # of the path
TOLERANCES = singles(1e-2, 1e-3, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-14)
STEPS = singles(1, 2, 3, 4, 5)


class Found(NamedTuple):
    """A singular point and its twist."""

    s: float
    twist: Callable[[], Array]  # (2,) of any length and sign


def _linearised(s: Array) -> LinearisedLoops:
    return given.branch().close(s).linearised


def matrices(s: Array) -> Array:
    """P (T, 2, 2) at path coordinates (T,)."""
    return passive_matrix(given.robot(), _linearised(np.asarray(s, dtype=float)))


@cache
def _middle() -> Array:
    """The joints in the middle of the interval."""
    return bare().joints([(x, None) for x in given.path()(np.linspace(0.0, 0.5 * (LOW + HIGH), 17))])[0][-1]


def _matrix(s: float) -> Array:
    """P (2, 2) by pinocchio and numpy alone."""
    return bare().passive(bare().close((given.path()(s), None), _middle())[1])


def _twist(s: float, null_vector: Callable[[Array], Array]) -> Array:
    """The platform's motion with the null vector of P."""
    robot, linearised = given.robot(), _linearised(np.array([s]))
    eta = null_vector(passive_matrix(robot, linearised)[0])
    return np.asarray(linearised.platform[0] @ passive_motion(robot, eta))


def by_svd(matrix: Array) -> Array:
    """The last right singular vector."""
    return np.asarray(np.linalg.svd(matrix)[2][-1])


def by_qr(matrix: Array) -> Array:
    """From R of QR with pivots, its last row taken for zero."""
    _, R, order = linalg.qr(matrix, pivoting=True)
    eta = np.zeros(len(matrix))
    eta[order[-1]] = 1.0
    eta[order[:-1]] = linalg.solve_triangular(R[:-1, :-1], -R[:-1, -1])
    return eta


def by_border(matrix: Array) -> Array:
    """From the bordered system."""
    return np.asarray(solve_bordered(matrix[None], Border.of(matrix)).eta[0, :, 0])


def by_inverse_iteration(matrix: Array) -> Array:
    """Two steps of inverse iteration with M' M, moved a little from singular, from a vector of ones."""
    size = np.linalg.norm(matrix)
    normal = matrix.T @ matrix + (1e-7 * size) ** 2 * np.eye(len(matrix))
    eta: Array = np.ones(len(matrix))
    for _ in range(2):
        eta = np.asarray(np.linalg.solve(normal, eta))
        eta = np.asarray(eta / np.linalg.norm(eta))
    return eta


def _last_of_r(s: float) -> float:
    """The last diagonal entry of R, with the sign that makes it smooth: without pivots."""
    Q, R = np.linalg.qr(_matrix(s))
    return float(R[-1, -1] * np.linalg.det(Q) * np.prod(np.sign(np.diag(R)[:-1])))


def _minimum(setting: Setting) -> Callable[[], Found]:
    def least(s: float) -> float:
        return float(np.linalg.svd(_matrix(s), compute_uv=False)[-1])

    def run() -> Found:
        found = optimize.minimize_scalar(
            least, bounds=(LOW, HIGH), method="bounded", options={"xatol": setting[0]}
        )
        return Found(float(found.x), lambda: _twist(float(found.x), by_svd))

    return run


def _sign_change(
    measure: Callable[[float], float], null_vector: Callable[[Array], Array]
) -> Callable[[Setting], Callable[[], Found]]:
    def prepare(setting: Setting) -> Callable[[], Found]:
        def run() -> Found:
            s = float(optimize.brentq(measure, LOW, HIGH, xtol=setting[0], rtol=4 * np.finfo(float).eps))
            return Found(s, lambda: _twist(s, null_vector))

        return run

    return prepare


def _bordered_steps(setting: Setting) -> Callable[[], Found]:
    def run() -> Found:
        s = 0.5 * (LOW + HIGH)
        for _ in range(round(setting[0])):
            at = stencil(s)
            here = differentiate_g(matrices(at), at)
            s -= here.g / here.slope
        return Found(s, lambda: _twist(s, by_border))

    return run


def _root(setting: Setting) -> Callable[[], Found]:
    def run() -> Found:
        s = root_of_g(matrices, 0.5 * (LOW + HIGH), longest=setting[0]).place
        return Found(s, lambda: _twist(s, by_border))

    return run


def _located(setting: Setting) -> Callable[[], Found]:
    def run() -> Found:
        (point,) = locate_singularities(given.robot(), given.path(), branch=given.branch())
        return Found(point.s, lambda: point.twist)

    return run


@cache
def _exact() -> tuple[Decimal, Array]:
    return closed_form.singular_s(), closed_form.singular_twist()


def judge(method: Method, setting: Setting, result: Found) -> Judged:
    """The error of s, and the angle by which t_s is off [rad]."""
    s_c, twist = _exact()
    found = result.twist()
    off = float(found[0] * twist[1] - found[1] * twist[0]) / float(np.linalg.norm(found))
    return Judged(float(abs(Decimal(result.s) - s_c)), (abs(off),))


def _remark(rows: Sequence[Row]) -> str:
    least, newton = best(rows, "svd_minimum"), best(rows, "bordered_steps")
    if least is None or newton is None:
        return ""
    return (
        f"The minimum of the least singular value is found to {short(least.error)}, the root of g to "
        f"{short(newton.error)}: a kink without sign against a smooth measure with one."
    )


_GIVEN = "P(s) on [0.6, 0.75]"
_BARE = "P by pinocchio and numpy alone (chart/bare.py)"
_declared = partial(Method, given=_GIVEN, unit="tolerance", settings=TOLERANCES)
STAGE = Stage(
    name="singular",
    title="The singular point of a path",
    reference="closed form of the 5R in fifty digits (chart/closed_form.py)",
    error="error of the path coordinate",
    methods=(
        _declared(
            "bordered_steps",
            "ours, Newton on bordered g",
            _bordered_steps,
            unit="steps",
            settings=STEPS,
        ),
        _declared(
            "bordered_root",
            "ours, root of g to rounding",
            _root,
            unit="longest step",
            settings=singles(0.2),
        ),
        _declared(
            "located",
            "ours, all points of the path",
            _located,
            given="path followed",
            unit="points",
            settings=singles(1),
        ),
        _declared(
            "svd_minimum",
            "least singular value, its minimum",
            _minimum,
            source=f"{_BARE}; scipy minimize_scalar, bounded, xatol",
        ),
        _declared(
            "determinant",
            "determinant, Brent",
            _sign_change(lambda s: float(np.linalg.det(_matrix(s))), by_inverse_iteration),
            source=f"{_BARE}; scipy brentq, xtol",
        ),
        _declared(
            "qr",
            "last entry of R, Brent",
            _sign_change(_last_of_r, by_qr),
            source=f"{_BARE}; scipy brentq, xtol",
        ),
    ),
    judge=judge,
    goals=(1e-6, 1e-12),
    remark=_remark,
    profile=(1.0,),
    profile_error="angle by which t_s is off  [rad]",
    profile_title="The twist there",
)
