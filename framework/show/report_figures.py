"""The figures of a report, numbered, each with what it shows."""

from __future__ import annotations

import base64
import html
from collections.abc import Callable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from framework.crossing.result import CrossingPlan
from framework.show import plots
from framework.show.captions import asked, parts
from framework.show.film import Film
from framework.show.force_polygon import plot_eye
from framework.show.still import plot_still
from framework.show.style import figure_file, styled

Drawing = tuple[str, Callable[[], Axes]]  # its caption, and who draws it


def figures_with_captions(plan: CrossingPlan, film: Film, marked: Callable[[str], str]) -> str:
    """Return the figures as HTML; `marked` makes HTML of a plain text."""
    figures = []
    for number, (caption, draw) in enumerate(_drawings(plan, film), 1):
        with styled():
            drawing = draw().figure
            assert isinstance(drawing, Figure)
            data = base64.b64encode(figure_file(drawing, "svg")).decode("ascii")
        figures.append(
            f'<figure><img alt="{html.escape(caption)}" src="data:image/svg+xml;base64,{data}">'
            f"<figcaption><b>Figure {number}.</b> {marked(caption)}</figcaption></figure>"
        )
    return f'<div class="figures">{"".join(figures)}</div>'


def _own(plan: CrossingPlan) -> str:
    """Explain why the curve of the eye differs from that of t_s . W_p, where it does."""
    if not np.any(plan.robot.rotor_inertia):
        return ""
    return (
        " It is drawn with the rotors of the motors, along the t_s of that instant; the figure of t_s · W_p "
        "has the bodies alone, and the t_s of each instant."
    )


def _drawings(plan: CrossingPlan, film: Film) -> list[Drawing]:
    where = "at the singular instant" if film.instants else "halfway"
    locus = ", singular locus (purple)" if plan.robot.platform.translations.all() else ""
    dashed = " Dashed: the singular instants." if plan.crossings else ""
    drawn: list[Drawing] = [
        (
            f"The robot {where}: path (green), t_s (black), W_p (magenta){locus}.",
            lambda: plot_still(film),
        )
    ]
    if plan.crossings:
        sentence = "The eye of the needle: at the singular instant the motors give nothing along t_s."
        drawn.append((f"{sentence} The motion asks for nothing there.{_own(plan)}", lambda: plot_eye(plan)))
    drawn += [
        (f"Motor torques, with {parts(film)}.{dashed}", lambda: plots.plot_torques(plan)),
        (f"The law s(t) and its derivatives.{dashed}", lambda: plots.plot_law(plan)[0]),
    ]
    if len(plan.robot.passive):
        vanishes = ": 0 at the singular instants, condition (8)" if plan.crossings else ""
        drawn += [
            (
                "Measure of singularity along the path, 0 where singular.",
                lambda: plots.plot_singularity(plan),
            ),
            (
                f"The {asked(plan.robot)} t_s that the motion asks for{vanishes}.",
                lambda: plots.plot_wrench(plan),
            ),
        ]
    if plan.optimality is not None:
        sentence = (
            "The phase plane: speed and acceleration along the path, and what the motors' limits allow."
        )
        drawn.append((sentence, lambda: plots.plot_phase_plane(plan)[0]))
    return drawn
