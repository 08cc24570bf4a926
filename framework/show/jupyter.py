"""Robots and plans that show themselves in Jupyter: `%load_ext framework.show.jupyter`.

The packages below know nothing of pictures, so these come as an extension of IPython: a robot is drawn at its
reference, a plan with its path, locus and the eye of its first crossing.
"""

from __future__ import annotations

from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from framework.crossing.result import CrossingPlan
from framework.kinematics.parallel_robot import ParallelRobot
from framework.show.drawing import draw_robot
from framework.show.film import film_plan
from framework.show.moving import film_picture
from framework.show.style import figure_file, styled


def robot_picture(robot: ParallelRobot) -> bytes:
    """Draw a robot at its reference, as PNG."""
    with styled():
        drawn: Axes = draw_robot(robot)
        drawn.set_title(robot.name.replace("_", " "), loc="left")
        drawing = drawn.figure
        assert isinstance(drawing, Figure)
        return figure_file(drawing, "png", dpi=120)


def plan_picture(plan: CrossingPlan) -> bytes:
    """Draw a plan as one picture, as PNG."""
    return film_picture([film_plan(plan)], "png")


def load_ipython_extension(ipython: Any) -> None:
    """Show robots and plans at the end of a cell as pictures; `%load_ext` calls this."""
    formatter = ipython.display_formatter.formatters["image/png"]
    formatter.for_type(ParallelRobot, robot_picture)
    formatter.for_type(CrossingPlan, plan_picture)
