"""The figures of a report, numbered, each with what it shows."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Callable
from html import escape

import numpy as np
from matplotlib.figure import Figure

from framework.crossing.result import CrossingPlan
from framework.show.captions import asked, parts
from framework.show.film import Film
from framework.show.plots import plan_drawings
from framework.show.style import figure_file, styled


def figures_with_captions(plan: CrossingPlan, film: Film, marked: Callable[[str], str]) -> str:
    """Return the figures as HTML; `marked` makes HTML of a plain text."""
    figures, drawings = [], plan_drawings(plan, film)
    for number, (name, caption) in enumerate(_captions(plan, film).items(), 1):
        with styled():
            drawing = drawings[name]().figure
            assert isinstance(drawing, Figure)
            data = b64encode(figure_file(drawing, "svg")).decode("ascii")
        figures.append(
            f'<figure><img alt="{escape(caption)}" src="data:image/svg+xml;base64,{data}">'
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


def _captions(plan: CrossingPlan, film: Film) -> dict[str, str]:
    """Return the captions of the figures, in their order."""
    where = "at the singular instant" if film.instants else "halfway"
    locus = ", singular locus (purple)" if plan.robot.platform.translations.all() else ""
    dashed = " Dashed: the singular instants." if plan.crossings else ""
    captions = {"robot": f"The robot {where}: path (green), t_s (black), W_p (magenta){locus}."}
    if plan.crossings:
        captions["eye"] = (
            "The eye of the needle: at the singular instant the motors give nothing along t_s. The motion "
            f"asks for nothing there.{_own(plan)}"
        )
    captions["torques"] = f"Motor torques, with {parts(film)}.{dashed}"
    captions["law"] = f"The law s(t) and its derivatives.{dashed}"
    if len(plan.robot.passive):
        vanishes = ": 0 at the singular instants, condition (8)" if plan.crossings else ""
        captions["singularity"] = "Measure of singularity along the path, 0 where singular."
        captions["wrench"] = f"The {asked(plan.robot)} t_s that the motion asks for{vanishes}."
    if plan.optimality is not None:
        captions["phase_plane"] = (
            "The phase plane: speed and acceleration along the path, and what the motors' limits allow."
        )
    return captions
