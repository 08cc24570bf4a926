"""Torques are those of the mechanism, not of how it is written: for every robot and flexibility.

Generated: a robot added to the catalogue is tested here without a line written.
"""

from dataclasses import replace

import numpy as np
import pytest

import robots
from framework import ParallelRobot
from framework.kinematics.parallel_robot import Equations
from framework.tolerances import TORQUE_TAIL
from tests.robots.cut_elsewhere import cut_elsewhere, openings
from tests.robots.every_robot import FEWEST_AND_MOST, RIGID, assert_same_torques, crossing, in_stages, planned
from tests.robots.transformed import moved, scaled, swapped_frames, with_other_frames

# Closures, by robot, in whose loop nothing else can be opened, and why. None today.
ONLY_OPENING: dict[tuple[str, str], str] = {}
LOOPS = [
    (name, flexibility, closure.name)
    for name, flexibility in FEWEST_AND_MOST
    for closure in RIGID[name].description.closures
]
CHANGES = ("on other frames", "rotations x 1000", "rotations / 1000", "lengths x 1000", "lengths / 1000")
SCALED = [
    (name, flexibility, change)
    for name, flexibility in FEWEST_AND_MOST
    for change in CHANGES
    if RIGID[name].rows.rotation.any() or not change.startswith("rotations")
]


@pytest.fixture(params=in_stages(FEWEST_AND_MOST, at_once=lambda case: "five_bar" in case[0]), scope="module")
def original(request) -> ParallelRobot:
    name, flexibility = request.param
    return robots.load(name, flexibility=flexibility)


@pytest.mark.parametrize("change", ["duplicated", "reversed", "swapped frames"])
def test_torques_do_not_depend_on_how_the_closures_are_written(original, change):
    description = original.description
    closures = description.closures
    if change == "duplicated":
        closures += tuple(replace(closure, name=f"{closure.name} again") for closure in closures)
    elif change == "reversed":
        closures = tuple(replace(c, axes=c.axes[::-1]) for c in closures[::-1])
    else:
        closures = swapped_frames(description).closures
    other = ParallelRobot.from_description(
        replace(description, closures=closures), flexibility=original.flexibility
    )
    assert len(other.loops.names) == len(original.loops.names)
    one, two = planned(original), planned(other)
    t = np.linspace(0.0, one.duration, 201)
    ours, unsettled = one.torque(t), max(one.certificate.change, two.certificate.change)  # of the deflections
    peak = np.abs(ours).max()
    bound = 1e-12 + 10 * unsettled * peak + 1e-10 * np.abs(ours)  # (201, n_a)
    # at both ends second derivatives of deflections amplify rounding: there, what plans promise of the peak
    bound[[0, -1]] = np.maximum(bound[[0, -1]], TORQUE_TAIL * peak)
    assert (np.abs(two.torque(t) - ours) <= bound).all()


@pytest.mark.parametrize("case", in_stages(SCALED))
def test_torques_do_not_depend_on_the_scale_of_the_closure_rows(case):
    """Rows mixed with others, and rows of another size.

    A robot file gives a row no factor. On other frames each row becomes a combination of old ones, with a
    length between metres and radians. In the table of rows the factor of a rotation row is its `weight`; the
    robot's `length`, by which metres are weighed against radians wherever ranks and distances from
    singularity are judged, is the factor of all other rows.
    """
    name, flexibility, change = case
    original = robots.load(name, flexibility=flexibility)
    if change == "on other frames":
        description = with_other_frames(original.description)
        other = ParallelRobot.from_description(description, flexibility=flexibility)
    elif change.startswith("rotations"):
        factor = 1e3 if change.endswith("x 1000") else 1e-3
        weight = np.where(original.rows.rotation, factor, 1.0) * original.rows.weight
        rows = replace(original.rows, weight=weight)
        structure, weighted = original.structure, replace(original, rows=rows)
        spanning = rows.append(original.rounded).take(structure.spanning)
        span_sizes = structure.span_sizes * spanning.weight / original.spanning_loops.weight
        # combinations of rows have no size of their own
        row_sizes = structure.row_sizes if structure.varies else span_sizes
        structure = replace(structure, row_sizes=row_sizes, span_sizes=span_sizes)
        equations = Equations.of(weighted, weighted.platform, structure, weighted.moving, weighted.n_a)
        other = replace(weighted, structure=structure, equations=equations)
    else:
        other = replace(original, length=(1e3 if change.endswith("x 1000") else 1e-3) * original.length)
    assert len(other.loops.names) == len(original.loops.names)
    assert_same_torques(crossing(original), crossing(other))


@pytest.mark.parametrize("case", in_stages(LOOPS))
def test_torques_do_not_depend_on_where_a_loop_is_cut(case):
    """Each closure becomes joints, and another joint of its loop the closure; see `cut_elsewhere`.

    Springs stay what they are, walked back with their joints. The first loop of the rigid robot is cut at
    every joint.
    """
    name, flexibility, loop = case
    robot = robots.load(name, flexibility=flexibility)
    (closure,) = (closure for closure in robot.description.closures if closure.name == loop)
    found = openings(robot.description, closure)
    assert bool(found) != ((name, loop) in ONLY_OPENING)
    plan = crossing(robot)
    every_joint = flexibility == "rigid" and closure == robot.description.closures[0]
    for opening in found if every_joint else found[:1]:
        description = cut_elsewhere(robot.description, closure, opening)
        assert_same_torques(
            plan, crossing(ParallelRobot.from_description(description, flexibility=flexibility))
        )


def test_torques_do_not_depend_on_where_the_robot_stands(original):
    shifted = ParallelRobot.from_description(
        moved(original.description, (3.0, -2.0, 1.0)), flexibility=original.flexibility
    )
    assert_same_torques(planned(original), planned(shifted))  # metres off carry ten times the rounding


@pytest.mark.parametrize("size", [2.0**-10, 2.0**10])
def test_torques_of_a_robot_of_another_size_scale_with_its_square(original, size):
    """A robot as small as one drawn in millimetres, or as large: no tolerance may know metres."""
    other = ParallelRobot.from_description(
        scaled(original.description, size), flexibility=original.flexibility
    )
    one, two = planned(original), planned(other)
    assert_same_torques(one, two, ratio=size**2)
    nodes = sorted(plan.certificate.nodes for plan in (one, two))
    # rounding in stiff springs may decide whether deflections have settled or nodes are doubled once more
    assert nodes[1] <= (2 * nodes[0] if len(original.elastic) else nodes[0])
