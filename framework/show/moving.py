"""Films as files for slides and READMEs: a picture (PNG, SVG, PDF), or an animated GIF or PNG.

A film has F frames.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Iterable, Sequence
from textwrap import fill
from typing import NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from framework.errors import check_choice
from framework.numerics.arrays import Array
from framework.numerics.output import PROGRAM
from framework.show.captions import describe_film_briefly
from framework.show.drawing import plot_still
from framework.show.film import Film, film_limit
from framework.show.plots import MISSES, THREADS, draw_torques, plot_eyes, twist_at_singularity
from framework.show.style import ALARM, LOCUS, Style, figure_file, line_style, use_style

GIF_FRAMES = 60
FRAME_TIME, SINGULAR_FRAME_TIME = 100, 2000  # [ms] of a frame, and of a frame at a singular instant


MOVING_KINDS = ("gif", "apng")
PICTURE_KINDS = ("png", "svg", "pdf", *MOVING_KINDS)


def film_picture(films: Sequence[Film], kind: str) -> bytes:
    """Draw the robot beside the eye of the needle or, without a crossing, its torques.

    The kinds gif and apng are animated, and show several films side by side with the torques below each
    robot. Programs that do not animate PNGs show the singular instant of an apng.

    Args:
        films: of one robot. Several films that all cross need one path in a still picture.
        kind: one of PICTURE_KINDS; a still picture shows the singular instant.

    Raises:
        InvalidInput: no such kind, or the films do not share a robot and a path.
    """
    check_choice("kind of picture", kind, PICTURE_KINDS)
    if kind in MOVING_KINDS:
        return _moving_picture(films, kind)
    with use_style():
        if len(films) == 1 or all(each.instants for each in films):
            scene = _scene_beside_eye(films)
        else:  # some film has no eye
            scene = _scene_of_films(films)
            scene.share_limits([max((i.time for each in films for i in each.instants), default=0.0)])
        return figure_file(scene.drawing, kind, dpi=100)


def _moving_picture(films: Sequence[Film], kind: str) -> bytes:
    """Draw an animated picture, which pauses at the singular instants."""
    instants = [instant.time for film in films for instant in film.instants]
    end = max(film.time[-1] for film in films)
    times = np.unique([*np.linspace(0.0, end, GIF_FRAMES), *instants])
    with use_style():
        stage = _scene_beside_eye(films) if len(films) == 1 else _scene_of_films(films)
        stage.share_limits(times[:: -max(1, len(times) // 8)])  # some times suffice; ends at the first
        pictures = _render(stage, times)
    pauses = [*instants, end]
    durations = [SINGULAR_FRAME_TIME if t in pauses else FRAME_TIME for t in times]
    # as a gif or apng, each picture shown for a duration [ms]
    some = Image.fromarray(np.concatenate(list(map(np.asarray, pictures[::8]))))  # has all colours
    # 64: few shades of each colour are enough for smooth edges
    palette = some.quantize(64, method=Image.Quantize.FASTOCTREE)
    small = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    written = io.BytesIO()
    animated: Style = {"save_all": True, "duration": durations, "loop": 0}
    if kind == "gif":
        small[0].save(written, "GIF", append_images=small[1:], comment=PROGRAM, **animated)
    else:
        still = small[durations.index(SINGULAR_FRAME_TIME)]  # the first singular instant, or the end
        origin = PngInfo()
        origin.add_text("Software", PROGRAM)
        still.save(written, "PNG", default_image=True, append_images=small, pnginfo=origin, **animated)
    return written.getvalue()


def _render(stage: _Scene, times: Array) -> list[Image.Image]:
    """Render the figure at times (T,) [s]; render the parts that do not move once."""
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
    """A part of a picture that changes with time, up to the end of its film."""

    artist: Artist
    end: float  # [s]
    move: Callable[[float], object]  # takes the instant [s], at most `end`


class _Scene(NamedTuple):
    """A figure that shows films at changing instants; `marks` are its moving parts."""

    drawing: Figure
    robots: list[Axes]
    marks: list[_Mark]

    def move(self, t: float) -> None:
        """Move all marks to an instant t [s]."""
        for mark in self.marks:
            mark.move(min(t, mark.end))

    def share_limits(self, times: Iterable[float]) -> None:
        """Give the axes of all robots the same limits, wide enough at all times [s]; end at the last."""
        for t in times:
            self.move(t)
        low_x, high_x = np.transpose([ax.get_xlim() for ax in self.robots])
        low_y, high_y = np.transpose([ax.get_ylim() for ax in self.robots])
        for ax in self.robots:
            ax.set(xlim=(low_x.min(), high_x.max()), ylim=(low_y.min(), high_y.max()))


def _scene_beside_eye(films: Sequence[Film]) -> _Scene:
    """Place the first proved film's robot beside the eye of all films or, without a crossing, its torques."""
    drawing = Figure(figsize=(8.4, 3.6), layout="constrained")
    left, right = drawing.subplots(1, 2, width_ratios=(1.0, 1.1))
    film = next((film for film in films if film.proved), films[0])
    limit = film_limit(film, films)
    plot_still(film, left, limit=limit)
    marks = [_robot_mark(film, left, limit)]
    if film.instants:
        plot_eyes(films, limit, right)
        twist = twist_at_singularity(films)
        marks += [_dot_mark(each, twist, right) for each in films]
    else:
        draw_torques(right, film.robot, film.time, film.torque)
        marks.append(_time_mark(film, right))
    return _Scene(drawing, [left], marks)


def _scene_of_films(films: Sequence[Film]) -> _Scene:
    """Place the robots of several films side by side, each above its torques.

    An unproved film ends at its singular instant.
    """
    drawing = Figure(figsize=(2.8 * len(films), 4.2), layout="constrained")  # [in]
    robots, below = drawing.subplots(2, len(films), height_ratios=(2.4, 1.0))
    largest = 1.1 * max(film_limit(film, films).max() for film in films)
    marks: list[_Mark] = []
    for film, above, ax in zip(films, robots, below, strict=True):
        marks.append(_robot_mark(film, above, limit=None))
        torques = np.clip(film.torque, -9 * largest, 9 * largest)  # far off the scale, but finite
        torques[film.time > _end_time(film)] = np.nan
        for k, torque in enumerate(torques.T):
            ax.plot(film.time, torque, label=film.robot.actuator_names[k].replace("_", " "), **line_style(k))
        for instant in film.instants:
            ax.axvline(instant.time, color=LOCUS if film.proved else ALARM, linewidth=0.8, linestyle=":")
        ax.set(xlim=(0.0, film.time[-1]), ylim=(-largest, largest), xlabel="time  [s]")
        marks.append(_time_mark(film, ax))
    below[0].set_ylabel(f"motor torque  [{films[0].robot.torque_units[0]}]")
    if films[0].robot.n_a <= 3:
        below[0].legend(loc="lower left", fontsize=6)
    return _Scene(drawing, list(robots), marks)


def _robot_mark(film: Film, ax: Axes, limit: Array | None) -> _Mark:
    """Return the mark that draws the robot at an instant, with the forces of motors within `limit` (n_a,)."""
    end = _end_time(film)

    def draw(t: float) -> None:
        """Draw the robot at instant t [s], in place of the one drawn before."""
        for artist in [*ax.collections, *ax.lines, *ax.patches, *ax.texts]:
            artist.remove()
        plot_still(film, ax, frame=film.frame_at(t), limit=limit)
        if limit is None:  # several films have titles in place of legends
            if ax.legend_ is not None:
                ax.legend_.remove()
            ends = t >= end
            words = "no torque is large enough" if ends else describe_film_briefly(film)
            title = fill(f"{film.name}: {words}", 44)  # so many letters fit into 2.8 inches
            ax.set_title(title, color=ALARM if ends else "black", fontsize=8, y=1.0)
            ax.set_axis_off()

    return _Mark(ax, end, draw)


def _end_time(film: Film) -> float:
    """Return the singular instant [s] that ends an unproved motion, else infinity."""
    return np.inf if film.proved else film.instants[0].time


def _time_mark(film: Film, ax: Axes) -> _Mark:
    """Return the mark of an upright line at the instant."""
    line = ax.axvline(0.0, color="black", linewidth=0.8)
    return _Mark(line, _end_time(film), lambda t: line.set_xdata([t, t]))


def _dot_mark(film: Film, twist: Array, ax: Axes) -> _Mark:
    """Return the mark of a dot on a film's curve in the eye: its force along `twist` (n,) over s."""
    s = film.law(film.time)  # (F,)
    demand = film.motors.force_along(twist)  # (F,)
    color, _dash, mark, _verdict = THREADS if film.proved else MISSES
    (dot,) = ax.plot([], [], mark, color=color, markersize=7, markeredgecolor="white", zorder=5)
    curve = np.column_stack([s, demand])[:, None]  # (F, 1, 2)
    return _Mark(dot, _end_time(film), lambda t: dot.set_data(curve[film.frame_at(t)].T))
