"""Pictures in Jupyter, with descriptions for those who do not see them; `%load_ext framework.show.jupyter`.

An extension of IPython, since the packages below know nothing of pictures: a robot is drawn at its reference,
a plan with its path, locus and the eye of its first crossing. Descriptions are in the metadata of the output,
`alt`, where IPython puts them and nbconvert's classic template reads them. Films are animated PNGs, which
every renderer takes.
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

Described = tuple[bytes, dict[str, str]]  # a PNG, and its metadata


def robot_picture(robot: ParallelRobot) -> Described:
    """Draw a robot at its reference."""
    with use_style():
        name, ax = display_name(robot.name), draw_robot(robot)
        ax.set_title(name, loc="left")
        drawing = ax.figure
        assert isinstance(drawing, Figure)
        return figure_file(drawing, "png", dpi=120), {"alt": f"The robot {name} at its reference"}


def plan_picture(plan: CrossingPlan) -> Described:
    """Draw a plan as one picture."""
    film = film_plan(plan)
    return film_picture([film], "png"), {"alt": describe_film(film)}


def show_figure(alt: str, drawing: Figure | None = None) -> None:
    """Show and close a figure, pyplot's current one when None, with a description."""
    import matplotlib.pyplot as plt
    from IPython.display import Image, display

    displayed = plt.gcf() if drawing is None else drawing
    display(Image(figure_file(displayed, "png", dpi=displayed.dpi), alt=alt))  # type: ignore[no-untyped-call]
    plt.close(displayed)


def show_film(films: Sequence[Film], alt: str) -> None:
    """Show films as one moving picture with a description."""
    from IPython.display import Image, display

    picture = Image(film_picture(films, "apng"), format="png", alt=alt)  # type: ignore[no-untyped-call]
    display(picture)  # type: ignore[no-untyped-call]


def load_ipython_extension(ipython: Any) -> None:
    """Show robots and plans at the end of a cell as pictures; `%load_ext` calls this."""
    formatter = ipython.display_formatter.formatters["image/png"]
    formatter.for_type(ParallelRobot, robot_picture)
    formatter.for_type(CrossingPlan, plan_picture)
