"""One look for all figures and pages: readable in print, in grey and by the colour-blind.

Colours that are drawn together differ by at least 12 (CIEDE2000), also for eyes that lack one kind of cone.
Lines of one plot also differ by their dashes. Text has a contrast of at least 4.5. Tests hold all this.
"""

from __future__ import annotations

import io
import logging
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backend_bases import get_registered_canvas_class
from matplotlib.figure import Figure, FigureBase
from matplotlib.layout_engine import LayoutEngine

from framework.numerics.arrays import Array
from framework.numerics.output import PROGRAM

Style = dict[str, Any]  # keyword arguments of an artist of matplotlib
COLORS = ("#004f9e", "#d55e00", "#00a67a", "#7a1f4b", "#6bb8ff", "#e0a800")  # of curves, dark and light
DASHES: tuple[Any, ...] = ("-", "--", "-.", ":", (0, (6, 1, 1, 1, 1, 1)), (0, (9, 3)))
CROSSING = "#444444"
# Each of the colours below has one meaning. Blue, orange and yellow are left to the robots.
LOCUS = "#6212a8"
TWIST, WRENCH = "#14181d", "#a81560"
PATH = "#00a572"
GIVEN = "#70baff"  # forces that the motors can give
BAND: Style = {"color": GIVEN, "alpha": 0.35, "linewidth": 0}
ALARM = "#c8141e"
GOOD = "#14504f"
LINE, AXIS = "#d8dde3", "#9aa4af"
UNREACHED, BEYOND, NOT_CARRIED = "#e4e7eb", "#bcc4ce", "#e8a48c"  # poses of a map without a value
PAGE_COLORS = {  # by their names in the CSS of the pages
    **{f"series-{k}": color for k, color in enumerate(COLORS)},
    "locus": LOCUS,
    "twist": TWIST,
    "wrench": WRENCH,
    "world": "#4a1c00",
    "trace": PATH,  # the part of the path that is passed
    "path": "#8a929b",  # the part that is ahead
    "given": GIVEN,
    "alarm": ALARM,
    "warning": "#8a5a00",
    "good": GOOD,
    "idle": "#d4d7db",  # a motor without torque
    "busy": "#00525e",  # a motor at its largest torque
    "unreal": "#b4bcc5",  # drawn for comparison only
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
DARK_COLORS = {  # of the names that differ where readers ask for dark pages
    "series-0": "#6cb2ff",
    "series-1": "#ff8a3d",
    "series-2": "#1fc79a",
    "series-3": "#e07aa8",
    "series-4": "#b5dcff",
    "locus": "#c79bff",
    "twist": "#eef2f7",
    "wrench": "#ff8ad0",
    "world": "#e3a878",
    "path": "#8a949f",
    "alarm": "#ff8f93",
    "warning": "#e8b765",
    "good": "#8ad9d6",
    "idle": "#4a525c",
    "busy": "#7fe0ee",
    "unreal": "#66707b",
    "ink": "#e6eaef",
    "soft": "#aab4bf",
    "line": "#3a434e",
    "grid": "#2e3640",
    "axis": "#6f7a86",
    "paper": "#1b2129",
    "ground": "#12171d",
    "good-ground": "#16302f",
    "alarm-ground": "#3a1d20",
    "warning-ground": "#332a18",
}
COLUMN_WIDTH = 3.5  # [in] width of a journal column
LAYOUT_PAD = 3.0  # [points] around axes with their labels
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
    "pdf.fonttype": 42,  # TrueType outlines: publishers refuse Type 3
    "ps.fonttype": 42,  # matplotlib 3.11 reads this one for the fonts of PDFs
    "svg.fonttype": "none",
    "figure.dpi": 100,
}
_METADATA: dict[str, dict[str, str | None]] = {  # without a date
    "png": {"Software": PROGRAM},
    "svg": {"Creator": PROGRAM, "Date": None},
    "pdf": {"Creator": PROGRAM, "CreationDate": None},
}


# matplotlib subsets fonts by fontTools, which warns of the dates of those with mathematical symbols
logging.getLogger("fontTools").setLevel(logging.ERROR)


def use_style() -> AbstractContextManager[None]:
    """Return a context in which figures are drawn in this style."""
    return matplotlib.rc_context(_SETTINGS)


def page_colors() -> str:
    """Return the CSS variables of the pages' colours: --locus and so on; on screens that ask for it, dark."""
    light, dark = (
        ":root { " + " ".join(f"--{name}: {color};" for name, color in colors.items()) + " }"
        for colors in (PAGE_COLORS, DARK_COLORS)
    )
    scheme = ":root { color-scheme: light dark; }"
    return f"{light}\n{scheme}\n@media screen and (prefers-color-scheme: dark) {{ {dark} }}"


def page_figure(drawing: FigureBase) -> bytes:
    """Return a figure as an svg file that is dark where the page is.

    Colours become the variables of the pages. Shades of lit bodies have no name, and stay.
    """
    names = {color: name for name, color in PAGE_COLORS.items() if name in DARK_COLORS}
    names |= {"#000000": "ink", CROSSING: "soft"}
    text = figure_file(drawing, "svg").decode()
    for color, name in names.items():
        text = text.replace(f": {color}", f": var(--{name})")
    style = f"<style>{page_colors()} text {{ fill: var(--ink); }}</style>"
    return text.replace("<defs>", f"<defs>{style}", 1).encode()


def new_figure(rows: int = 1, *, height: float = 2.2, shared: bool = True) -> list[Axes]:
    """Return `rows` axes of a new figure one journal column wide, `height` [in] each.

    If `shared`, all axes have one abscissa.
    """
    drawing = Figure(figsize=(COLUMN_WIDTH, height * rows), layout=ColumnLayout())
    return list(drawing.subplots(rows, 1, sharex=shared, squeeze=False)[:, 0])


class ColumnLayout(LayoutEngine):
    """Fit a column of axes, equally high, with their labels between title and legend of a figure.

    All text is measured once, and again if its place changes the ticks. Constrained layout always measures it
    twice, which takes longer than drawing it.
    """

    _adjust_compatible = False
    _colorbar_gridspec = False

    def execute(self, fig: Figure) -> None:
        """Place the axes of a figure, once more if their new heights change the ticks."""
        for _ in range(2):
            ticks = [ax.get_yticks().tolist() for ax in fig.axes]
            self._place_axes(fig)
            if [ax.get_yticks().tolist() for ax in fig.axes] == ticks:
                break

    def _place_axes(self, fig: Figure) -> None:
        """Place the axes of a figure by the text around them; twins share a row."""
        renderer = fig._get_renderer()  # type: ignore[attr-defined]
        pad = LAYOUT_PAD * fig.dpi / 72  # [pixels], as all lengths below
        # of each row, from the top down, text around the frames of its axes: left, right, below, above
        margins: dict[int, Array] = {}
        specs = [(ax, ax.get_subplotspec()) for ax in fig.axes]
        rows = [(ax, spec.rowspan.start) for ax, spec in specs if spec is not None]
        for ax, row in rows:
            frame = ax.get_window_extent(renderer)
            x_0, y_0, x_1, y_1 = (ax.get_tightbbox(renderer, for_layout_only=True) or frame).extents
            sides = np.array([frame.x0 - x_0, x_1 - frame.x1, frame.y0 - y_0, y_1 - frame.y1])
            margins[row] = np.maximum(margins.get(row, pad), sides + pad)
        left, right, below, above = np.array([margins[row] for row in sorted(margins)]).T  # (rows,) each

        width, height = fig.bbox.size
        boxes = [artist.get_window_extent(renderer) for artist in (*fig.texts, *fig.legends)]
        top = min([height, *(box.y0 for box in boxes if box.y0 > 0.5 * height)])
        bottom = max([0.0, *(box.y1 for box in boxes if box.y1 < 0.5 * height)])
        frame_width = width - left.max() - right.max()
        frame_height = (top - bottom - below.sum() - above.sum()) / len(margins)
        for ax, row in rows:
            k = sorted(margins).index(row)
            base = top - above[: k + 1].sum() - below[:k].sum() - (k + 1) * frame_height
            ax.set_position((left.max() / width, base / height, frame_width / width, frame_height / height))


def ensure_axes(ax: Axes | None, height: float = 2.2) -> Axes:
    """Return `ax`, or new axes of a height [in] when None."""
    return new_figure(height=height)[0] if ax is None else ax


def draw_dashed(ax: Axes, place: float, color: str = CROSSING, linewidth: float = 0.6) -> None:
    """Draw an upright dashed line at an abscissa, by default in the style of crossings."""
    ax.axvline(place, color=color, linewidth=linewidth, linestyle=(0, (4, 3)))


def draw_dot(ax: Axes, x: float, y: float, size: float = 4) -> None:
    """Draw the dot of a crossing."""
    ax.plot(x, y, "o", color=CROSSING, markersize=size, zorder=3)


def draw_curves(ax: Axes, curves: Iterable[Array], label: str, **style: Any) -> None:
    """Draw curves (m, 2) in one style, with one entry in the legend."""
    for k, curve in enumerate(curves):
        ax.plot(*curve.T, label=None if k else label, **style)


def legend_above(ax: Axes, columns: int = 1, **options: Any) -> None:
    """Put the legend above the axes, off the curves; none without labels."""
    if ax.get_legend_handles_labels()[0]:
        ax.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2, ncols=columns, **options)


def line_style(k: int) -> Style:
    """Return colour and dash of the k-th curve."""
    return {"color": COLORS[k % len(COLORS)], "linestyle": DASHES[k % len(DASHES)]}


def save_pages(drawings: Mapping[str, Callable[[], Axes | Figure]], document: Path) -> list[Path]:
    """Write one PDF with a page for each drawing, and a PNG of each; return all files.

    One PDF embeds its fonts once. A PDF for each drawing would spend more time on fonts than on drawing.
    """
    from matplotlib.backends.backend_pdf import FigureCanvasPdf, PdfPages  # takes time to import

    files = [document]
    with use_style(), _fonts_without_layout(), PdfPages(document, metadata=_METADATA["pdf"]) as pages:
        for name, draw in drawings.items():
            drawing = draw().figure
            assert isinstance(drawing, Figure)
            files.append(document.with_name(f"{name}.png"))
            files[-1].write_bytes(figure_file(drawing, "png"))
            drawing.set_layout_engine("none")  # keep the layout of the PNG
            FigureCanvasPdf(drawing).print_pdf(pages)  # type: ignore[no-untyped-call]
    return files


@contextmanager
def _fonts_without_layout() -> Iterator[None]:
    """Embed fonts without the tables that choose glyphs for scripts and ligatures.

    Matplotlib embeds glyphs by their numbers and needs no such tables, but leaves no choice of them.
    """
    from fontTools.subset import Options  # takes time to import

    default = getattr(Options, "_drop_tables_default", None)  # private; a release without it embeds all
    if default is None:
        yield
        return
    Options._drop_tables_default = [*default, "GDEF", "GPOS", "GSUB", "MATH", "kern"]
    try:
        yield
    finally:
        Options._drop_tables_default = default


def figure_file(drawing: FigureBase, kind: str, *, dpi: float = DPI) -> bytes:
    """Return a figure as a png, svg or pdf file without a date.

    This draws once; savefig draws twice.
    """
    assert isinstance(drawing, Figure)  # no part of another figure
    written = io.BytesIO()
    drawing.set_dpi(dpi)
    canvas = get_registered_canvas_class(kind)(drawing)
    getattr(canvas, f"print_{kind}")(written, metadata=_METADATA[kind])
    return written.getvalue()
