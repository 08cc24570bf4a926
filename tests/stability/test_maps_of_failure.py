"""Wrong answers apart from refusals, over four pairs of numbers that break methods.

What goes wrong: a table of samples crosses a pole and shows none, a balance without solution is solved all
the same, a tolerance with a unit stops an iteration at its start, a mass matrix of light links is inverted.
Each gives numbers that look like the others.
Why: a method that measures nothing cannot say no.
What we do: prove what is returned, by numbers without a unit, and refuse the rest. The maps are panels of
the stage `failure` of `make chart`: (distance to Type 2, step), (load over stiffness, misfit of the loaded
condition), (size, duration), (payload, mass of a link over it), for our methods and for
others. Here are some cells of ours.
"""

from functools import cache

import numpy as np
import pytest

from tests.benchmarks.chart import stages
from tests.benchmarks.chart.measure import Setting, tried
from tests.benchmarks.chart.reading import WRONG

CELLS: dict[str, dict[str, tuple[Setting, ...]]] = {
    "imposed": {"proved": ((1e-2, 1e-10), (1e-6, 1e-10), (1e-12, 1e-10))},
    "misfit": {"proved": ((1.0, 0.0), (1.0, 1e-8), (16.0, 1e-2))},
    "sizes": dict.fromkeys(("planned", "simulated"), ((1e-6, 1e-4), (1e4, 1e4), (1e-6, 1e4))),
    "masses": dict.fromkeys(("planned", "simulated"), ((1e-9, 1e-12), (1e6, 1.0))),
}


@cache
def error(panel: str, method: str, cell: Setting) -> float:
    """Relative error of a cell; infinite where it is refused."""
    stage = stages.stage("failure")
    return tried(stage, stage.method(f"{panel}-{method}"), cell).row.error


@pytest.mark.parametrize("panel", CELLS)
def test_what_we_do_not_refuse_is_right(panel):
    for method, cells in CELLS[panel].items():
        for cell in cells:
            found = error(panel, method, cell)
            assert not np.isfinite(found) or found < 1e-6, (method, cell)


def test_refusals_are_where_there_is_no_answer_and_nowhere_else():
    for panel in ("sizes", "masses"):
        for method, cells in CELLS[panel].items():
            assert all(np.isfinite(error(panel, method, cell)) for cell in cells), (panel, method)
    assert np.isinf(error("imposed", "proved", (1e-6, 1e-10)))
    assert np.isinf(error("misfit", "proved", (1.0, 1e-4)))


def test_methods_that_check_nothing_are_wrong_there():
    assert error("imposed", "table", (1e-4, 1.5 / 2**8)) > WRONG
    assert error("misfit", "repeated", (1.0, 1e-4)) > WRONG
