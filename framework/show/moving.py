"""Films as files for slides and READMEs: one picture (PNG, SVG, PDF), or an animated GIF or PNG."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from textwrap import fill
from typing import NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from framework.errors import check_choice
from framework.numerics.arrays import Array
from framework.show.captions import subtitle
from framework.show.film import Film
from framework.show.force_polygon import MISSES, THREADS, eye_twist, plot_eyes
from framework.show.plots import draw_torques
from framework.show.scene import stated_limit
from framework.show.sight import film_sight
from framework.show.still import locus_of, plot_still
from framework.show.style import ALARM, LOCUS, Style, figure_file, line_style, use_style

GIF_FRAMES = 60
FRAME_TIME, SINGULAR_FRAME_TIME = 100, 2000  # [ms] of a frame, and of one at a singular instant


MOVING_KINDS = ("gif", "apng")
PICTURE_KINDS = ("png", "svg", "pdf", *MOVING_KINDS)


def film_picture(films: Sequence[Film], kind: str) -> bytes:
    """Draw the robot beside the eye of the needle or, without a crossing, beside its torques.

    A gif and an apng move, and have several films side by side, the torques of each below its robot. An
    apng is a PNG of the singular instant to all programs that cannot move it.

    Args:
        films: of one robot; several go along one path, through a singularity, unless they move.
        kind: one of PICTURE_KINDS; those that stand still show the singular instant.

    Raises:
        InvalidInput: no such kind, or the films do not share a robot and a path.
    """
    check_choice("kind of picture", kind, PICTURE_KINDS)
    return _moving(films, kind) if kind in MOVING_KINDS else _still(films, kind)


def _still(films: Sequence[Film], kind: str) -> bytes:
    """Return the picture of one frame of the first film, as a file of this kind."""
    with use_style():
        film, (drawing, left, _) = _drawn_film(films), _axes(films)
        plot_still(film, left, limit=stated_limit(film, films))
        return figure_file(drawing, kind, dpi=100)


def _moving(films: Sequence[Film], kind: str) -> bytes:
    """Draw an animated picture, which stands still for two seconds at the singular instants."""
    instants = [instant.time for film in films for instant in film.instants]
    end = max(film.time[-1] for film in films)
    times = np.unique([*np.linspace(0.0, end, GIF_FRAMES), *instants])
    with use_style():
        stage = _stage(films) if len(films) == 1 else _stages(films)
        _fix_limits(stage, times)
        pictures = _render(stage, times)
    durations = [SINGULAR_FRAME_TIME if t in instants or t == end else FRAME_TIME for t in times]
    return _animate(pictures, durations, kind)


def _animate(pictures: Sequence[Image.Image], durations: list[int], kind: str) -> bytes:
    """Encode pictures, each shown for a duration [ms], as a gif or apng of one palette."""
    some = Image.fromarray(np.concatenate([np.asarray(picture) for picture in pictures[::8]]))  # all colours
    # few shades of each colour are enough for edges
    palette = some.quantize(64, method=Image.Quantize.FASTOCTREE)
    small = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    written = io.BytesIO()
    animated: Style = {"save_all": True, "duration": durations, "loop": 0}
    if kind == "gif":
        small[0].save(written, "GIF", append_images=small[1:], **animated)
    else:
        still = small[durations.index(SINGULAR_FRAME_TIME)]  # of a singular instant, or of the end
        still.save(written, "PNG", default_image=True, append_images=small, **animated)
    return written.getvalue()


def _fix_limits(stage: _Stage, times: Array) -> None:
    """Give all robots the same limits of axes, wide enough at all times (T,) [s]."""
    for t in times[:: -max(1, len(times) // 8)]:
        stage.move(t)
    limits = np.array([[ax.get_xlim(), ax.get_ylim()] for ax in stage.robots])  # (N, 2, 2)
    xlim, ylim = np.stack([limits[..., 0].min(axis=0), limits[..., 1].max(axis=0)], axis=1)
    for ax in stage.robots:
        ax.set(xlim=xlim, ylim=ylim)


def _render(stage: _Stage, times: Array) -> list[Image.Image]:
    """Render the figure at times (T,) [s]; parts without a mark are rendered once."""
    canvas = FigureCanvasAgg(stage.drawing)
    stage.drawing.draw_without_rendering()
    stage.drawing.set_layout_engine("none")
    for mark in stage.marks:
        mark.artist.set_animated(True)
    canvas.draw()  # type: ignore[no-untyped-call]
    background = canvas.copy_from_bbox(stage.drawing.bbox)  # type: ignore[no-untyped-call]
    pictures = []
    for t in times:
        stage.move(t)
        canvas.restore_region(background)  # type: ignore[no-untyped-call]
        for mark in stage.marks:
            mark.artist.draw(canvas.get_renderer())  # type: ignore[no-untyped-call]
        pixels = np.asarray(canvas.buffer_rgba())  # type: ignore[no-untyped-call]
        pictures.append(Image.fromarray(pixels).convert("RGB"))
    return pictures


class _Mark(NamedTuple):
    """A part of a picture that changes with time."""

    artist: Artist
    move: Callable[[float], object]  # to an instant [s]


class _Stage(NamedTuple):
    """A figure that shows films at one instant after the other."""

    drawing: Figure
    robots: list[Axes]
    marks: list[_Mark]

    def move(self, t: float) -> None:
        for mark in self.marks:
            mark.move(t)


def _stage(films: Sequence[Film]) -> _Stage:
    """Return the robot of one film beside the eye of the needle or its torques."""
    drawing, left, marks = _axes(films)
    film, limit = films[0], stated_limit(films[0], films)
    return _Stage(drawing, [left], [_robot(film, left, limit), *marks])


def _stages(films: Sequence[Film]) -> _Stage:
    """Return the robots of several films side by side, the torques of each below; an unproved one ends."""
    drawing = Figure(figsize=(2.8 * len(films), 4.2), layout="constrained")  # [in]
    robots, below = drawing.subplots(2, len(films), height_ratios=(2.4, 1.0))
    largest = 1.1 * max(stated_limit(film, films).max() for film in films)
    marks: list[_Mark] = []
    for film, above, ax in zip(films, robots, below, strict=True):
        marks.append(_robot(film, above, None))
        for k, torque in enumerate(film.torque.T):
            shown = np.where(film.time <= _end(film), np.clip(torque, -9 * largest, 9 * largest), np.nan)
            ax.plot(film.time, shown, **line_style(k))
        for instant in film.instants:
            ax.axvline(instant.time, color=LOCUS if film.proved else ALARM, linewidth=0.8, linestyle=":")
        ax.set(xlim=(0.0, film.time[-1]), ylim=(-largest, largest), xlabel="time  [s]")
        marks.append(_time_line(film, ax))
    below[0].set_ylabel(f"motor torque  [{films[0].robot.torque_units[0]}]")
    return _Stage(drawing, list(robots), marks)


def _robot(film: Film, ax: Axes, limit: Array | None) -> _Mark:
    """Draw the robot at the frame of an instant, of an unproved motion no later than its end."""
    locus, sight, end = locus_of(film), film_sight(film), _end(film)

    def draw(t: float) -> None:
        """Draw the robot at the frame of instant t [s], in place of the one drawn before."""
        for artist in [*ax.collections, *ax.lines, *ax.patches, *ax.texts]:
            artist.remove()
        plot_still(
            film, ax, frame=film.frame_at(min(t, end)), limit=limit, locus=locus, sight=sight, alone=True
        )
        if limit is None:  # several films: their titles instead of a legend each
            if ax.legend_ is not None:
                ax.legend_.remove()
            ends = t >= end
            words = "no torque is large enough" if ends else subtitle(film)
            title = fill(f"{film.name}: {words}", 44)  # letters in 2.8 inches
            ax.set_title(title, color=ALARM if ends else "black", fontsize=8, y=1.0)
            ax.set_axis_off()

    return _Mark(ax, draw)


def _end(film: Film) -> float:
    """Return the singular instant that ends an unproved motion; infinite for proved ones."""
    return np.inf if film.proved else film.instants[0].time


def _time_line(film: Film, ax: Axes) -> _Mark:
    line, end = ax.axvline(0.0, color="black", linewidth=0.8), _end(film)
    return _Mark(line, lambda t: line.set_xdata([min(t, end)] * 2))


def _drawn_film(films: Sequence[Film]) -> Film:
    """Return the film whose robot is drawn: the first that is proven."""
    return next((film for film in films if film.proved), films[0])


def _axes(films: Sequence[Film]) -> tuple[Figure, Axes, list[_Mark]]:
    """Make axes for the robot and, on the right, for the eye or, without crossing, the torques."""
    drawing = Figure(figsize=(8.4, 3.6), layout="constrained")
    left, right = drawing.subplots(1, 2, width_ratios=(1.0, 1.1))
    film = _drawn_film(films)
    if film.instants:
        plot_eyes(films, stated_limit(film, films), right)
        return drawing, left, [_dot(other_film, eye_twist(films), right) for other_film in films]
    draw_torques(right, film.robot, film.time, film.torque)
    return drawing, left, [_time_line(film, right)]


def _dot(film: Film, twist: Array, ax: Axes) -> _Mark:
    """Draw a dot on a curve of the eye, which stops at the end of an unproved motion."""
    s, demand = film.law(film.time), film.motors.force_along(twist)
    end = _end(film)
    color, _, mark, _ = THREADS if film.proved else MISSES
    (dot,) = ax.plot([], [], mark, color=color, markersize=7, markeredgecolor="white", zorder=5)

    def move(t: float) -> None:
        instant = min(t, end)
        dot.set_data([np.interp(instant, film.time, s)], [np.interp(instant, film.time, demand)])

    return _Mark(dot, move)
