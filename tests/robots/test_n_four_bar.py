"""The N-four-bar against a row of parallelograms: all rods at one angle, all bars level.

With x the angle of the rods from the vertical, T = (N + 1) x'^2 / 6 + N x'^2 / 2 (rods turn, bars travel) and
V = g cos(x) ((N + 1) / 2 + N).
"""

import numpy as np
import pytest

import robots
from framework import (
    Line,
    NoLaw,
    ParallelRobot,
    assemble,
    check_robot,
    locate_singularities,
    plan_crossing,
    plan_scene,
    velocity_matrices,
)
from framework.kinematics.frames import frames_at
from framework.kinematics.linearised_loops import (
    linearised_at,
    linearised_at_reference,
)
from framework.singularity.type2 import uncontrolled_space
from robots.generators import n_four_bar as generator

GRAVITY = 9.81


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Robot files by number of loops."""
    folder = tmp_path_factory.mktemp("n_four_bar")
    return {loops: generator.write(folder / str(loops), loops) for loops in (1, 2, 3, 5)}


def configuration(loops: int, x: float) -> dict[str, float]:
    return {f"pivot_{k}": x for k in range(loops + 1)} | {f"hinge_{k}": -x for k in range(1, loops + 1)}


def by_joint(robot: ParallelRobot, q) -> dict[str, float]:
    return {robot.coordinates.name_of(column): value for column, value in enumerate(q)}


def test_a_row_without_loops_is_refused(tmp_path):
    with pytest.raises(ValueError, match="at least 1, got 0"):
        generator.write(tmp_path, 0)


@pytest.mark.parametrize("loops", [1, 2, 5])
def test_three_rows_of_each_hinge_are_redundant_and_named(files, loops):
    found = check_robot(ParallelRobot.from_file(files[loops]))
    assert (found.mobility, found.loop_equations, found.rank) == (1, 5 * loops, 2 * loops)
    expected = {f"loop_{k}.{axis}" for k in range(1, loops + 1) for axis in ("y", "rx", "rz")}
    assert set(found.redundant_rows) == expected
    assert found.mass == pytest.approx(2 * loops + 1)


@pytest.mark.parametrize("loops", [1, 2, 5])
def test_all_rods_lean_alike(files, loops):
    robot = ParallelRobot.from_file(files[loops])
    for x in np.random.default_rng(1).uniform(-1.4, 1.4, 5):
        q = assemble(robot, [x]).q
        assert by_joint(robot, q) == pytest.approx(configuration(loops, x), abs=1e-12)
        A, B, _ = velocity_matrices(robot, q)
        np.testing.assert_allclose(A / B, 1.0, atol=1e-12)


@pytest.mark.parametrize("loops", [1, 2, 5])
def test_torque_is_that_of_one_pendulum(files, loops):
    robot = ParallelRobot.from_file(files[loops])
    plan = plan_scene(robot, "swing")
    assert plan.crossings == ()
    t = np.linspace(0.0, plan.duration, 201)
    x, ddx = plan.platform(t), plan.platform(t, 2)
    inertia, arm = (loops + 1) / 3 + loops, (loops + 1) / 2 + loops
    n, rotor = 100.0, 3.3e-5
    expected = (rotor * n + inertia / n) * ddx - GRAVITY * arm * np.sin(x) / n
    np.testing.assert_allclose(plan.torque(t), expected, atol=1e-12)
    np.testing.assert_allclose(plan.motor_angle(t), n * x, atol=1e-10)
    assert plan.certificate.tail < 1e-13


@pytest.mark.parametrize(
    ("loops", "flexibility"), [(1, "flexible_joints"), (2, "rigid"), (3, "flexible_links"), (5, "rigid")]
)
def test_at_the_horizontal_the_closures_lose_rank_and_that_is_not_type_2(files, loops, flexibility):
    robot = ParallelRobot.from_file(files[loops], flexibility=flexibility)
    for start, end in ((1.2, 2.0), (-1.4, -1.4 - 2 * (np.pi / 2 - 1.4))):
        (point,) = locate_singularities(robot, Line([start], [end]))
        horizontal = np.copysign(np.pi / 2, start)
        assert point.s == pytest.approx((horizontal - start) / (end - start), abs=1e-12)
        assert (point.kind, point.corank) == ("closure", loops)
        assert point.twist == pytest.approx([0.0])
        joints = by_joint(robot, point.q)
        for joint, value in configuration(loops, horizontal).items():
            assert joints[joint] == pytest.approx(value, abs=1e-11)


def test_at_the_horizontal_there_are_N_more_freedoms(files):
    """Each loop may fold: the benchmark counts 1 elsewhere, N + 1 there."""
    for loops, file in files.items():
        robot = ParallelRobot.from_file(file)
        assert uncontrolled_space(robot, linearised_at_reference(robot)).freedoms == 1
        (point,) = locate_singularities(robot, Line([1.2], [2.0]))
        flat = linearised_of(robot, point.q)
        assert uncontrolled_space(robot, flat).freedoms == loops + 1


def linearised_of(robot, q):
    return linearised_at(robot, q[None], robot.platform.coordinates(frames_at(robot, q[None])))


@pytest.mark.parametrize("times", [None, []])
def test_no_law_leads_through_the_horizontal(times):
    robot = robots.load("n_four_bar")
    with pytest.raises(NoLaw, match="singularity of the loop equations themselves"):
        plan_crossing(robot, Line([1.2], [2.0]), duration=1.0, times=times)
