"""Pictures in Jupyter, with descriptions for readers who do not see them.

A robot is drawn at its reference, a plan with its path, its locus and the eye of its first crossing, a map by
its first quantity. Descriptions are the `alt` of the output's metadata: IPython writes them there, and
nbconvert's classic template reads them. Films are animated PNGs, which every renderer shows.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from matplotlib.figure import Figure

from framework.atlas.workspace_map import WorkspaceMap
from framework.kinematics.parallel_robot import ParallelRobot
from framework.planning.result import CrossingPlan
from framework.show.captions import describe_film, display_name
from framework.show.drawing import draw_robot
from framework.show.film import Film, film_plan
from framework.show.map import plot_map
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


def map_picture(workspace: WorkspaceMap) -> DescribedPicture:
    """Draw the first quantity of a map."""
    quantity = workspace.quantities[0]
    with use_style():
        ax = plot_map(workspace, quantity.key)
        alt = f"Map of {display_name(workspace.robot.name)}: {quantity.name}"
        return figure_file(ax.figure, "png", dpi=120), {"alt": alt}


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
    """Do nothing: robots, plans and maps show themselves; `%load_ext` of notebooks of 0.7 goes in 0.9."""
