"""What 0.7 had and 0.8 keeps for one version: against closed forms, and what was written before."""

import numpy as np
import pytest
import yaml

import robots
from framework import RobotFileError, assemble, plan_scene
from framework.dropped_functions import equilibrium, free_motor_frequency, read_joint_trajectory
from framework.files import joint_trajectory
from framework.model import Material, Section
from framework.model.beams import tip_spring
from tests.oracles.planar import cross, legs

PAYLOAD, ROTOR, DRIVE, ROD = 10.0, 6.4e-6 * 50**2, 25000.0, 350000.0  # of the paper


def test_the_paper_s_robot_vibrates_with_free_motors():
    robot = robots.load("five_bar", flexibility="flexible_links")
    x = (0.05, 0.3)
    stiffness = np.zeros((4, 4))  # of x, y and the two motors
    for motor, (crank, rod) in enumerate(legs(*x)):
        rod = np.array(rod) / np.hypot(*rod)
        lever = cross(crank, rod)  # how fast the rod's near end moves along it, for a turn of the crank
        gap = np.array([*rod, 0.0, 0.0])
        gap[2 + motor] = -lever
        stiffness += np.outer(gap, gap) / (lever**2 / DRIVE + 1.0 / ROD)
    inertia = np.diag([PAYLOAD, PAYLOAD, ROTOR, ROTOR])
    squares = np.sort(np.linalg.eigvals(np.linalg.solve(inertia, stiffness)).real)
    found = free_motor_frequency(robot, assemble(robot, x).q[None])
    assert found[0] == pytest.approx(np.sqrt(squares[2]) / (2 * np.pi), rel=1e-6)
    rigid = robots.load("five_bar")
    assert np.isinf(free_motor_frequency(rigid, rigid.reference.q[None]))


def test_a_beam_s_tip_deflects_as_a_cantilever():
    section, material, length = Section.tube(0.01), Material(70e9, 26e9), 0.4
    with pytest.warns(DeprecationWarning, match="beam_spring"):
        spring = tip_spring("rod", "rod_tip", section, material, length, ("y",))
    bending = length**3 / (3 * material.E * section.Iz)
    assert spring.stiffness[0] == pytest.approx(1 / bending, rel=5e-3)  # shear is the rest


def test_a_trajectory_is_read_as_it_was_written(tmp_path):
    robot = robots.load("five_bar", flexibility="flexible_joints")
    plan = plan_scene(robot, "A")
    file = tmp_path / "trajectory.yaml"
    file.write_text(yaml.safe_dump(joint_trajectory(plan, samples=5, side="motor")))
    read = read_joint_trajectory(file)
    assert (read.side, read.before_springs, read.joint_names) == ("motor", True, robot.actuator_names)
    np.testing.assert_allclose(read.effort, plan.torque(read.times), rtol=0, atol=1e-9)
    file.write_text("header: {frame_id: elsewhere}")
    with pytest.raises(RobotFileError, match="no trajectory"):
        read_joint_trajectory(file)


def test_springs_carry_the_load_at_equilibrium():
    robot = robots.load("five_bar", flexibility="flexible_links")
    q = assemble(robot, (0.05, 0.3)).q
    assert 0.0 < np.abs(equilibrium(robot, q) - q).max() < 1e-2
