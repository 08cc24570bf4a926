"""Map of failure: the 5R with 1 kg links as small, as large, as quick and as slow as no unit suits."""

from __future__ import annotations

from collections.abc import Sequence

from tests.benchmarks.chart.failure import judge, methods
from tests.benchmarks.chart.measure import Row, Stage, pairs
from tests.benchmarks.chart.reading import counts
from tests.benchmarks.chart.variants import Variant

SIZES = tuple(10.0**k for k in (-6, -4, -2, 0, 2, 4))  # over the paper's
DURATIONS = tuple(10.0**k for k in (-4, -2, 0, 2, 4))  # over the paper's


def _remark(rows: Sequence[Row]) -> str:
    return f"The same motion in other units of length and time: {counts(STAGE, rows)}."


STAGE = Stage(
    name="sizes",
    title="Robot scale and duration",
    reference="closed form of the 5R in fifty digits, by similarity (chart/variants.py)",
    error="largest error over the largest torque, or over the path",
    methods=methods(
        pairs(SIZES, DURATIONS), "size, duration", lambda cell: Variant(size=cell[0], slower=cell[1])
    ),
    judge=judge,
    remark=_remark,
    map_axes=("size over the paper's", "duration over the paper's"),
)
