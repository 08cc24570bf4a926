"""One look for all figures: readable in print, in grey and by the colour-blind."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure

# Okabe and Ito's palette without its yellow, dark and light alternating.
COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00")
DASHES = ("-", "--", "-.", ":")
CROSSING = "#444444"
# One meaning each, as on the page (page/page.css).
LOCUS, TWIST, WRENCH, PATH, GIVEN = "#7b3fa6", "#14181d", "#d6187a", "#009e73", "#2f9fe0"
ALARM, GOOD = "#b3261e", "#1b7f4d"
COLUMN_WIDTH = 3.5  # [in] width of a journal column

_SETTINGS: dict[Any, Any] = {
    "font.size": 8,
    "axes.labelsize": 8,
    "axes.titlesize": 8,
    "legend.fontsize": 7,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "axes.linewidth": 0.6,
    "lines.linewidth": 1.2,
    "axes.grid": True,
    "grid.linewidth": 0.3,
    "grid.color": "#cccccc",
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
    "pdf.fonttype": 42,
    "svg.fonttype": "none",
    "figure.dpi": 100,
    "savefig.dpi": 200,
}


@contextmanager
def styled() -> Iterator[None]:
    """Draw and save within this style, leaving matplotlib's settings as they were."""
    with matplotlib.rc_context(_SETTINGS):
        yield


def figure(rows: int = 1, *, height: float = 2.2, shared: bool = True) -> tuple[Figure, list[Axes]]:
    """Make a figure one journal column wide of `rows` axes, `height` [in] each; `shared`: one abscissa."""
    drawing = Figure(figsize=(COLUMN_WIDTH, height * rows), layout="constrained")
    axes = drawing.subplots(rows, 1, sharex=shared, squeeze=False)[:, 0]
    return drawing, list(axes)


def legend_above(ax: Axes, columns: int = 1, **options: Any) -> None:
    """Put the legend over the axes, where it hides no curve; none where nothing has a label."""
    if ax.get_legend_handles_labels()[0]:
        ax.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2, ncols=columns, **options)


def line_style(k: int) -> dict[str, Any]:
    """Return colour and dash of the k-th curve: either of them tells it from the others."""
    return {"color": COLORS[k % len(COLORS)], "linestyle": DASHES[k % len(DASHES)]}


def save_figure(drawing: Figure, stem: Path) -> list[Path]:
    """Write `stem`.pdf and `stem`.png, laid out once for both; within `styled`."""
    drawing.draw_without_rendering()
    drawing.set_layout_engine("none")
    paths = [stem.with_suffix(".pdf"), stem.with_suffix(".png")]
    drawing.savefig(paths[0], metadata={"CreationDate": None})
    drawing.savefig(paths[1])
    return paths
