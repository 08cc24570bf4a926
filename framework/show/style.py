"""One look for all figures and pages: readable in print, in grey and by the colour-blind.

Colours drawn together differ by at least 12 (CIEDE2000), also for those who lack one kind of cone; lines of
one plot have dashes besides. Text has a contrast of at least 4.5. Tests hold both.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Iterable, Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.backend_bases import get_registered_canvas_class
from matplotlib.figure import Figure

from framework.numerics.arrays import Array

Style = dict[str, Any]  # of what matplotlib draws, by its keywords
COLORS = ("#004f9e", "#d55e00", "#00a67a", "#7a1f4b", "#6bb8ff", "#e0a800")  # of curves, dark and light
DASHES: tuple[Any, ...] = ("-", "--", "-.", ":", (0, (6, 1, 1, 1, 1, 1)), (0, (9, 3)))
CROSSING = "#444444"
# One meaning each. Blue, orange and yellow are left to the robots.
LOCUS, TWIST, WRENCH = "#6212a8", "#14181d", "#a81560"
PATH = "#00a572"
GIVEN = "#70baff"  # what the motors can give
BAND: Style = {"color": GIVEN, "alpha": 0.35, "linewidth": 0}
ALARM, GOOD = "#c8141e", "#14504f"
LINE, AXIS = "#d8dde3", "#9aa4af"
UNREACHED, BEYOND, NOT_CARRIED = "#e4e7eb", "#bcc4ce", "#e8a48c"  # poses of a map without a value
PAGE_COLORS = {  # as the pages call them
    **{f"series-{k}": color for k, color in enumerate(COLORS)},
    "locus": LOCUS,
    "twist": TWIST,
    "wrench": WRENCH,
    "world": "#4a1c00",
    "trace": PATH,  # the way gone
    "path": "#8a929b",  # the way to go
    "given": GIVEN,
    "alarm": ALARM,
    "warning": "#8a5a00",
    "good": GOOD,
    "idle": "#d4d7db",  # a motor without torque
    "busy": "#00525e",  # and at its largest
    "unreal": "#b4bcc5",  # what is drawn for comparison only
    "ink": "#1d2530",  # text
    "soft": "#5c6876",
    "line": LINE,
    "grid": "#e7eaee",
    "axis": AXIS,
    "paper": "#ffffff",
    "ground": "#f3f5f8",
    "good-ground": "#eef3f3",
    "alarm-ground": "#fcf1f2",
    "warning-ground": "#f5f0e8",
}
COLUMN_WIDTH = 3.5  # [in] width of a journal column
DPI = 200

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
    "grid.color": LINE,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
    "pdf.fonttype": 42,  # outlines that publishers take; Type 3 they refuse
    "ps.fonttype": 42,  # matplotlib 3.11 splits the fonts of PDFs by this one
    "svg.fonttype": "none",
    "figure.dpi": 100,
}
_UNDATED: dict[str, dict[str, None]] = {"png": {}, "svg": {"Date": None}, "pdf": {"CreationDate": None}}


def use_style() -> AbstractContextManager[None]:
    """Return a context in which figures are drawn and saved in this style."""
    return matplotlib.rc_context(_SETTINGS)


def page_colors() -> str:
    """Return the CSS that names the colours of pages: --locus and so on."""
    return ":root { " + " ".join(f"--{name}: {color};" for name, color in PAGE_COLORS.items()) + " }"


def new_figure(rows: int = 1, *, height: float = 2.2, shared: bool = True) -> list[Axes]:
    """Return `rows` axes of a new figure one journal column wide, `height` [in] each.

    `shared`: one abscissa.
    """
    drawing = Figure(figsize=(COLUMN_WIDTH, height * rows), layout="constrained")
    return list(drawing.subplots(rows, 1, sharex=shared, squeeze=False)[:, 0])


def ensure_axes(ax: Axes | None, height: float = 2.2) -> Axes:
    """Return the axes given, or new ones of a height [in] when None."""
    return new_figure(height=height)[0] if ax is None else ax


def draw_dashed(ax: Axes, place: float, color: str = CROSSING, linewidth: float = 0.6) -> None:
    """Draw an upright dashed line at an abscissa, of a crossing by default."""
    ax.axvline(place, color=color, linewidth=linewidth, linestyle=(0, (4, 3)))


def draw_dot(ax: Axes, x: float, y: float, size: float = 4) -> None:
    """Draw the dot of a crossing."""
    ax.plot([x], [y], "o", color=CROSSING, markersize=size, zorder=3)


def draw_curves(ax: Axes, curves: Iterable[Array], label: str, **style: Any) -> None:
    """Draw curves (m, 2) in one style, which the legend names once."""
    for k, curve in enumerate(curves):
        ax.plot(*curve.T, label=None if k else label, **style)


def legend_above(ax: Axes, columns: int = 1, **options: Any) -> None:
    """Put the legend above the axes, where no curve is hidden."""
    if ax.get_legend_handles_labels()[0]:
        ax.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2, ncols=columns, **options)


def line_style(k: int) -> Style:
    """Return colour and dash of the k-th curve."""
    return {"color": COLORS[k % len(COLORS)], "linestyle": DASHES[k % len(DASHES)]}


def save_pages(drawings: Mapping[str, Callable[[], Axes | Figure]], document: Path) -> list[Path]:
    """Write one PDF, a page a drawing, and a PNG of each; return all files.

    Fonts are embedded once in a PDF: with a PDF for each figure that takes longer than drawing them.
    """
    from matplotlib.backends.backend_pdf import FigureCanvasPdf, PdfPages  # takes time to import

    files = [document]
    with use_style(), PdfPages(document, metadata=_UNDATED["pdf"]) as pages:
        for name, draw in drawings.items():
            drawing = draw().figure
            assert isinstance(drawing, Figure)
            files.append(document.with_name(f"{name}.png"))
            files[-1].write_bytes(figure_file(drawing, "png"))
            drawing.set_layout_engine("none")  # the page looks like the PNG
            FigureCanvasPdf(drawing).print_pdf(pages)  # type: ignore[no-untyped-call]
    return files


def figure_file(drawing: Figure, kind: str, *, dpi: float = DPI) -> bytes:
    """Return a figure as a png, svg or pdf file without a date.

    It is drawn once, while savefig draws twice.
    """
    written = io.BytesIO()
    drawing.set_dpi(dpi)
    canvas = get_registered_canvas_class(kind)(drawing)
    getattr(canvas, f"print_{kind}")(written, metadata=_UNDATED[kind])
    return written.getvalue()
