"""The equalities of an export to MuJoCo lock what the closures lock, and no motion of the robot."""

import pytest

import robots
from framework.files.mjcf import OFF_ORIGIN, ROD, equality_axes


@pytest.mark.parametrize("name", ["five_bar", "orthoglide"])
def test_equalities_lock_the_axes_of_their_closures_by_kinds_that_mujoco_has(name):
    robot = robots.load(name)  # the rods of the orthoglide lock x and y, those of the 5R all positions
    axes = equality_axes(robot)
    closures = [closure for closure in robot.description.closures if closure.axes != ROD]
    assert set(axes) == {closure.name for closure in closures}
    for closure in closures:
        assert axes[closure.name] in OFF_ORIGIN
        assert set(closure.axes) <= set(axes[closure.name])
