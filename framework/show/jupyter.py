"""Pictures in Jupyter, with descriptions for readers who do not see them: `%load_ext framework.show.jupyter`.

The extension draws a robot at its reference, and a plan with its path, its locus and the eye of its first
crossing. It keeps pictures out of the packages that define robots and plans. Descriptions are the `alt` of
the output's metadata: IPython writes them there, and nbconvert's classic template reads them. Films are
animated PNGs, which every renderer shows.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from matplotlib.figure import Figure

from framework.kinematics.parallel_robot import ParallelRobot
from framework.planning.result import CrossingPlan
from framework.show.captions import describe_film, display_name
from framework.show.drawing import draw_robot
from framework.show.film import Film, film_plan
from framework.show.moving import film_picture
from framework.show.style import figure_file, use_style

DescribedPicture = tuple[bytes, dict[str, str]]  # a PNG, and its metadata


def robot_picture(robot: ParallelRobot) -> DescribedPicture:
    """Draw a robot at its reference."""
    name = display_name(robot.name)
    with use_style():
        ax = draw_robot(robot)
        ax.set_title(name, loc="left")
        return figure_file(ax.figure, "png", dpi=120), {"alt": f"The robot {name} at its reference"}


def plan_picture(plan: CrossingPlan) -> DescribedPicture:
    """Draw a plan: the robot beside its eye of the needle or its torques."""
    film = film_plan(plan)
    return film_picture([film], "png"), {"alt": describe_film(film)}


def show_figure(alt: str, drawing: Figure | None = None) -> None:
    """Show a figure with a description, pyplot's current one when None; close the figure."""
    import matplotlib.pyplot as plt
    from IPython.display import Image, display

    displayed = plt.gcf() if drawing is None else drawing
    display(Image(figure_file(displayed, "png", dpi=displayed.dpi), alt=alt))  # type: ignore[no-untyped-call]
    plt.close(displayed)


def show_film(films: Sequence[Film], alt: str) -> None:
    """Show films as one animated picture with a description."""
    from IPython.display import Image, display

    picture = film_picture(films, "apng")
    display(Image(picture, format="png", alt=alt))  # type: ignore[no-untyped-call]


def load_ipython_extension(ipython: Any) -> None:
    """Show robots and plans at the end of a cell as pictures; called by `%load_ext`."""
    formatter = ipython.display_formatter.formatters["image/png"]
    formatter.for_type(ParallelRobot, robot_picture)
    formatter.for_type(CrossingPlan, plan_picture)
