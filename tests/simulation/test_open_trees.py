"""Robots without loops: the tree alone, against pinocchio's articulated bodies and recursive Newton-Euler."""

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp

from framework import Line, ParallelRobot, plan_crossing, simulate

LINK = """<link name="{0}"><inertial><origin xyz="{1} 0.03 0"/><mass value="{2}"/>
<inertia ixx="0.01" iyy="0.02" izz="0.03" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
URDF = f"""<robot name="arm"><link name="base"/>
{LINK.format("upper", 0.2, 1.3)}{LINK.format("lower", 0.15, 0.7)}
<link name="tip"/>
<joint name="shoulder" type="continuous"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/></joint>
<joint name="elbow" type="continuous"><parent link="upper"/><child link="lower"/><origin xyz="0.4 0 0"/>
<axis xyz="0 0 1"/></joint>
<joint name="hand" type="fixed"><parent link="lower"/><child link="tip"/><origin xyz="0.3 0 0"/></joint>
</robot>"""
FILE = """
version: 1
urdf: arm.urdf
platform: {{frame: tip, axes: {axes}}}
actuators: {motors}
closures: []
gravity: [0, -9.81, 0]
reference: {{shoulder: 0.3, elbow: 0.8}}
"""


def arm(folder, axes: str, motors: str) -> ParallelRobot:
    """An upright double pendulum as a robot file without closures."""
    (folder / "arm.urdf").write_text(URDF, encoding="utf-8")
    (folder / "arm.yaml").write_text(FILE.format(axes=axes, motors=motors), encoding="utf-8")
    return ParallelRobot.from_file(folder / "arm.yaml")


@pytest.mark.parametrize(
    ("axes", "motors"),
    [("[x, y]", "[{joint: shoulder}, {joint: elbow}]"), ("[x]", "[{joint: shoulder}]")],
)
def test_a_double_pendulum_falls_as_its_articulated_bodies_do(tmp_path, axes, motors):
    """With a motor in each joint, and with a free elbow."""
    robot = arm(tmp_path, axes, motors)

    def torques(t: float) -> np.ndarray:
        return np.array([3.0 * np.sin(5.0 * t), 0.5])[: robot.n_a]

    run = simulate(robot, torques, duration=1.0)
    model, data = robot.model, robot.model.createData()

    def rates(t: float, state: np.ndarray) -> np.ndarray:
        force = np.zeros(2)
        force[: robot.n_a] = torques(t)
        return np.concatenate([state[2:], pin.aba(model, data, state[:2], state[2:], force)])

    first = np.concatenate([robot.reference.q, np.zeros(2)])
    expected = solve_ivp(rates, (0.0, 1.0), first, method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    np.testing.assert_allclose(
        [*run.configuration(1.0)[0], *run.velocity(1.0)[0]], expected, rtol=1e-9, atol=1e-9
    )
    assert run.energy_error < 1e-10


def test_torques_of_a_serial_arm_are_those_of_recursive_newton_euler(tmp_path):
    robot = arm(tmp_path, "[x, y]", "[{joint: shoulder}, {joint: elbow}]")
    plan = plan_crossing(robot, Line((0.5, 0.3), (0.3, 0.4)), duration=1.0)
    assert not plan.crossings
    times = np.linspace(0.0, 1.0, 7)
    motion = plan.dynamics.motion(times)
    data = robot.model.createData()
    expected = [
        pin.rnea(robot.model, data, q, v, a) for q, v, a in zip(motion.q, motion.v, motion.a, strict=True)
    ]
    np.testing.assert_allclose(plan.dynamics.torques(times), expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(robot.platform.coordinates(motion.linearised.frames), plan.platform(times))
