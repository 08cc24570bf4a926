"""What methods of the map of failure return, and how they are declared."""

from collections.abc import Callable
from typing import Any, NamedTuple

from framework.numerics.arrays import Array
from tests.benchmarks.chart.measure import Method, Setting


class Outcome(NamedTuple):
    """What a method returned, what is exact, and the size of that."""

    computed: Array
    exact: Array
    size: float


Prepare = Callable[[Setting], Callable[[], Any]]


class Declared(NamedTuple):
    """A method of one panel of the map."""

    name: str
    label: str
    prepare: Prepare
    given: str
    cells: tuple[Setting, ...]
    source: str = ""  # of others' settings; none of ours
    package: str | None = None

    def method(self, panel: str, unit: str) -> Method:
        """The method, its name preceded by that of the panel."""
        return Method(
            f"{panel}-{self.name}",
            self.label,
            self.prepare,
            self.given,
            unit,
            self.cells,
            "peer" if self.source else "ours",
            self.source,
            self.package,
            panel,
        )
