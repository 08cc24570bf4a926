"""Stage: motor torques of robots in space, the delta and the Gough-Stewart platform, of five loops each.

Along a crossing, legs without mass, against virtual work in mpmath (chart/virtual_work.py). The times of the
5R's stage cannot be carried over: here poses cost more, and all loops are closed in every one of them.
"""

from collections.abc import Callable
from functools import partial

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

    ours = partial(Method, panel=panel)
    others = partial(Method, given=law, unit=table, settings=TABLES, panel=panel)
    return (
        ours(f"{name}-nodes", "ours, Chebyshev nodes", prepare(Along.nodes), law, "nodes", NODES),
        ours(
            f"{name}-proved",
            "ours, located and proved",
            prepare(Along.proved),
            "path and law",
            "tolerance",
            singles(1e-6, 1e-10),
        ),
        others(f"{name}-stacks", "pointwise in stacks, our kinematics", prepare(Along.stacks), source=STACKS),
        others(
            f"{name}-pinocchio", "pointwise, Pinocchio and numpy alone", prepare(Along.pinocchio), source=BARE
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
