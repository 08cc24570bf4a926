"""Films as files for slides and READMEs: one picture (PNG, SVG, PDF), or an animated GIF."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from framework.arrays import Array
from framework.errors import InvalidInput, choose_from
from framework.show.captions import said
from framework.show.film import Film
from framework.show.force_polygon import eye_twist, plot_eyes
from framework.show.plots import torque_axes
from framework.show.scene import stated_limit
from framework.show.still import locus_of, plot_still
from framework.show.style import ALARM, GOOD, line_style, styled

GIF_FRAMES = 60
FRAME_TIME, SINGULAR_FRAME_TIME = 100, 2000  # [ms] of a frame, and of one at a singular instant
FRAME_DPI = 100


PICTURE_KINDS = ("png", "svg", "pdf", "gif")


def film_picture(films: Sequence[Film], kind: str) -> bytes:
    """Draw the robot, and beside it the eye of the needle or, without a crossing, its torques.

    Args:
        films: of one robot; several go along one path, through a singularity.
        kind: one of PICTURE_KINDS; a gif moves, the others show the singular instant.

    Raises:
        InvalidInput: no such kind, or the films do not share a robot and a path.
    """
    if kind not in PICTURE_KINDS:
        raise InvalidInput(choose_from("kind of picture", kind, PICTURE_KINDS))
    return _gif(films) if kind == "gif" else _still(films, kind)


def _still(films: Sequence[Film], kind: str) -> bytes:
    with styled():
        drawing, left, _ = _axes(films)
        plot_still(_shown(films), left, limit=stated_limit(_shown(films), films))
        written = io.BytesIO()
        undated = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(kind, {})
        drawing.savefig(written, format=kind, dpi=FRAME_DPI, metadata=undated)
    return written.getvalue()


def _gif(films: Sequence[Film]) -> bytes:
    """Draw an animated GIF, which stands still for two seconds at the singular instants."""
    film = _shown(films)
    instants = [int(np.argmin(np.abs(film.time - instant.time))) for instant in film.instants]
    spread = np.linspace(0, len(film.time) - 1, GIF_FRAMES).astype(int)
    frames = [int(k) for k in np.unique(np.append(spread, instants))]
    pictures = []
    with styled():
        drawing, left, marks = _axes(films)
        canvas, locus, limit = FigureCanvasAgg(drawing), locus_of(film), stated_limit(film, films)
        for k in frames[:: max(1, len(frames) // 8)]:  # where the robot comes, so that nothing is cut off
            plot_still(film, left, frame=k, limit=limit, locus=locus, alone=True)
        edges = left.get_xlim(), left.get_ylim()
        drawing.draw_without_rendering()
        drawing.set_layout_engine("none")
        for k in frames:
            left.clear()
            plot_still(film, left, frame=k, limit=limit, locus=locus, alone=True)
            left.set(xlim=edges[0], ylim=edges[1])
            for mark in marks:
                mark(float(film.time[k]))
            canvas.draw()  # type: ignore[no-untyped-call]
            pixels = np.asarray(canvas.buffer_rgba())  # type: ignore[no-untyped-call]
            pictures.append(Image.fromarray(pixels).convert("RGB"))
    palette = pictures[0].quantize(256, method=Image.Quantize.FASTOCTREE)
    small = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    written = io.BytesIO()
    lasting = [SINGULAR_FRAME_TIME if k in instants or k == frames[-1] else FRAME_TIME for k in frames]
    small[0].save(written, "GIF", save_all=True, append_images=small[1:], duration=lasting, loop=0)
    return written.getvalue()


def _shown(films: Sequence[Film]) -> Film:
    """Return the film whose robot is drawn: the first that is proven."""
    return next((film for film in films if film.proved), films[0])


Mark = Callable[[float], None]  # moves what marks an instant [s] on a curve


def _axes(films: Sequence[Film]) -> tuple[Figure, Axes, list[Mark]]:
    """Make axes for the robot, and beside it for the eye, or for torques of a motion without crossing."""
    drawing = Figure(figsize=(8.4, 3.6), layout="constrained")
    left, right = drawing.subplots(1, 2, width_ratios=(1.0, 1.1))
    film = _shown(films)
    if film.instants:
        plot_eyes(films, stated_limit(film, films), right)
        return drawing, left, [_dot(other_film, eye_twist(films), right) for other_film in films]
    for k, (name, torque) in enumerate(zip(film.robot.actuator_names, film.torque.T, strict=True)):
        right.plot(film.time, torque, label=said(name), **line_style(k))
    torque_axes(right, film.robot)
    line = right.axvline(0.0, color="black", linewidth=0.8)
    return drawing, left, [lambda t: line.set_xdata([t, t])]


def _dot(film: Film, twist: Array, ax: Axes) -> Mark:
    """Draw a dot on a curve of the eye; it stays where an unproved motion ends."""
    s, demand = film.law(film.time), film.motors.along(twist)
    end = np.inf if film.proved else film.instants[0].time
    (dot,) = ax.plot(
        [], [], "o", color=GOOD if film.proved else ALARM, markersize=7, markeredgecolor="white", zorder=5
    )

    def move(t: float) -> None:
        instant = min(t, end)
        dot.set_data([np.interp(instant, film.time, s)], [np.interp(instant, film.time, demand)])

    return move
