"""Map of failure: the 5R with light and heavy payloads, and links ever lighter than the payload.

The mass of a link over that of the payload conditions the mass matrix, which forward methods invert.
"""

from __future__ import annotations

from collections.abc import Sequence

from tests.benchmarks.chart.failure import judge, methods
from tests.benchmarks.chart.measure import Row, Stage, pairs
from tests.benchmarks.chart.reading import counts
from tests.benchmarks.chart.variants import Variant

PAYLOADS = tuple(10.0**k for k in (-9, -6, -3, 0, 3, 6))  # [kg]
RATIOS = tuple(10.0**k for k in (-12, -9, -6, -3, 0))  # of a link's mass to the payload's


def _remark(rows: Sequence[Row]) -> str:
    return f"Payload and conditioning: {counts(STAGE, rows)}."


STAGE = Stage(
    name="masses",
    title="Payload and conditioning",
    reference="closed form of the 5R in fifty digits (chart/closed_form.py)",
    error="largest error over the largest torque, or over the path",
    methods=methods(
        pairs(PAYLOADS, RATIOS),
        "payload [kg], link over payload",
        lambda cell: Variant(payload=cell[0], link=cell[0] * cell[1]),
    ),
    judge=judge,
    remark=_remark,
    map_axes=("payload  [kg]", "mass of a link over the payload's"),
)
