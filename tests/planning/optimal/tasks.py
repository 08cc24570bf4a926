"""Tasks of optimal laws, and their programs, that several tests look into."""

from framework import ParallelRobot
from framework.laws.path import Path
from framework.planning.crossing_points import PathToCross
from framework.planning.optimal.least_cost import first_cells
from framework.planning.optimal.optimal_task import Task
from framework.planning.optimal.speed_program import SpeedProgram
from framework.planning.optimal.undeformed_law import problem_of
from framework.planning.request import Request, specification_of
from framework.singularity.points_on_path import search_path


def task_of(robot: ParallelRobot, path: Path, **options) -> Task:
    """The task of an optimal law along a path."""
    request = Request.of(robot, path, law="optimal", **options)
    searched = search_path(robot, path).under(request.external_wrenches)
    return Task(PathToCross(searched, searched.points), request, specification_of(robot, request))


def series_program(task: Task, degree: int) -> SpeedProgram:
    """Its program on the first cells, with z as one series."""
    problem = problem_of(task)._replace(degree=degree)
    return SpeedProgram.on_cells(problem, first_cells(problem))
