"""Stage: motor torques of robots in space, the delta and the Gough-Stewart platform, of five loops each.

Along a crossing, legs without mass, against virtual work in mpmath (chart/virtual_work.py). The times of the
5R's stage cannot be carried over: here poses cost more, and all loops are closed in every one of them.
"""

from collections.abc import Callable

from tests.benchmarks.chart.along import Along, Torque, crossing
from tests.benchmarks.chart.measure import Judged, Method, Setting, Stage, pairs, singles

PANELS = {"delta": "delta", "gough_stewart": "Gough-Stewart"}
TABLES = pairs(tuple(2**k + 1 for k in range(4, 11)), (3, 5, 7, 9))
NODES = singles(16, 24, 32, 40, 48, 64, 80, 96, 128, 192)
STACKS = "poses closed in one stack by the framework, everything else numpy; table by spline"
BARE = "chart/bare.py: Newton from pose to pose, rnea, stacked solves; table by spline"


def judge(method: Method, setting: Setting, result: Torque) -> Judged:
    """The largest error over the largest torque."""
    return Judged(crossing(method.name.rpartition("-")[0]).error(result))


def _methods(name: str) -> tuple[Method, ...]:
    law, table, panel = "path followed; s, s', s\" exact", "samples, degree", PANELS[name]

    def prepare(way: Callable[..., Torque]) -> Callable[[Setting], Callable[[], Torque]]:
        return lambda setting: lambda: way(crossing(name), *setting)

    ways: tuple[Callable[..., Torque], ...] = (Along.nodes, Along.proved, Along.stacks, Along.pinocchio)
    (nodes, proved, stacks, bare), proof = map(prepare, ways), singles(1e-6, 1e-10)
    return (
        Method(
            f"{name}-nodes",
            "ours, Chebyshev nodes",
            nodes,
            given=law,
            unit="nodes",
            settings=NODES,
            kind="ours",
            panel=panel,
        ),
        Method(
            f"{name}-proved",
            "ours, located and proved",
            proved,
            given="path and law",
            unit="tolerance",
            settings=proof,
            kind="ours",
            panel=panel,
        ),
        Method(
            f"{name}-stacks",
            "pointwise in stacks, our kinematics",
            stacks,
            given=law,
            unit=table,
            settings=TABLES,
            source=STACKS,
            panel=panel,
        ),
        Method(
            f"{name}-pinocchio",
            "pointwise, Pinocchio and numpy alone",
            bare,
            given=law,
            unit=table,
            settings=TABLES,
            source=BARE,
            panel=panel,
        ),
    )


STAGE = Stage(
    name="spatial",
    title="Motor torques of robots in space",
    reference="virtual work in mpmath, legs without mass (chart/virtual_work.py)",
    error="largest error over the largest torque",
    methods=(*_methods("delta"), *_methods("gough_stewart")),
    judge=judge,
    goals=(1e-6, 1e-10),
)
