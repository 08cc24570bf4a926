"""Joints that nothing holds: what they would have to give is measured; a motion that loads one is refused."""

from dataclasses import replace

import numpy as np
import pytest

import robots
from framework import (
    Law,
    Line,
    LoadedJoint,
    ParallelRobot,
    check_robot,
    inverse_dynamics,
    plan_crossing,
    plan_scene,
    simulate,
)
from framework.cli import main
from framework.dynamics import elasticity
from framework.dynamics import forces as module_of_forces
from framework.dynamics.forces import balanced_forces
from framework.model.robot_file_writer import write_robot_file
from framework.model.urdf_edits import lock_joints
from framework.planning.scenes import scene_path
from tests.urdf_edits import edited

MASS, ARM = 2.0, 0.1  # [kg], [m]
CLEAR = Line([0.1, 0.345], [-0.05, 0.295])


def with_hinge(mass: float, inertia: float, flexibility: str = "rigid") -> ParallelRobot:
    """The 5R with a body hinged to its tip by an axis z and no motor: `mass` at ARM from the hinge."""
    description = robots.load("five_bar").description
    body = f"""
      <joint name="hinge" type="revolute">
        <parent link="left_tip"/> <child link="pendulum"/>
        <axis xyz="0 0 1"/> <limit lower="-6" upper="6" effort="0" velocity="20"/>
      </joint>
      <link name="pendulum">
        <inertial>
          <origin xyz="{ARM} 0 0"/> <mass value="{mass}"/>
          <inertia ixx="{inertia}" ixy="0" ixz="0" iyy="{inertia}" iyz="0" izz="{inertia}"/>
        </inertial>
      </link>
    </robot>"""
    if not mass:
        body = body[: body.index("<inertial>")] + body[body.index("</inertial>") + len("</inertial>") :]
    text = description.urdf_text.replace("</robot>", body)
    return ParallelRobot.from_description(replace(description, urdf_text=text), flexibility=flexibility)


def held_load(t: np.ndarray, law: Law) -> np.ndarray:
    """What the hinge would have to hold (T,) [N m], in closed form: the pendulum lies along the left rod.

    The rod's direction is that of the tip from the elbow; its turning comes from differences of angles.
    """

    def tip(t):
        return CLEAR(law(t))

    def angle(t):
        x, y = (tip(t) - [-0.2, 0.0]).T  # of the tip from the left motor
        size = np.hypot(x, y)
        crank = np.arctan2(y, x) + np.arccos(size / 0.5)  # both links 0.25 m, elbow outward
        return np.arctan2(y - 0.25 * np.sin(crank), x - 0.25 * np.cos(crank))

    def twice(f, h=1e-4):
        return (f(t + h) - 2 * f(t) + f(t - h)) / h**2

    (x, y), turned = twice(tip).T, angle(t)
    return MASS * ARM * (np.cos(turned) * y - np.sin(turned) * x + ARM * twice(angle))


def test_a_pendulum_that_nobody_holds_is_named_with_its_torque_and_instant():
    robot, law = with_hinge(MASS, 0.0), Law.rest_to_rest(1.5, 2)
    assert check_robot(robot).loose_joints == ("hinge",)
    with pytest.raises(LoadedJoint) as caught:
        inverse_dynamics(robot, CLEAR, law)
    error = caught.value
    assert error.joint == "hinge"
    t = np.linspace(0.01, 1.49, 2000)
    expected = held_load(t, law)
    largest = t[np.argmax(np.abs(expected))]
    assert error.torque == pytest.approx(float(held_load(np.array([error.time]), law)[0]), abs=1e-6)
    assert abs(error.torque) == pytest.approx(np.abs(expected).max(), rel=0.01)
    assert error.time == pytest.approx(largest, abs=0.02)
    assert f"hinge, which this motion would load with {error.torque:.3g} N m at t = " in str(error)


@pytest.mark.parametrize(
    ("flexibility", "geometry"),
    [("rigid", "rigid"), ("flexible_links", "rigid"), ("flexible_links", "deformed")],
)
def test_a_crossing_with_a_loaded_hinge_is_refused_with_every_flexibility(flexibility, geometry):
    with pytest.raises(LoadedJoint, match="nothing holds hinge"):
        plan_scene(with_hinge(MASS, 0.0, flexibility), "C", geometry=geometry)


def test_the_command_line_says_no_in_one_line(tmp_path, capsys):
    file = str(write_robot_file(with_hinge(MASS, 0.0).description, tmp_path))
    assert main(["plan", file, "--scene", "C"]) == 1
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert "nothing holds hinge, which this motion would load with " in err


def test_a_balanced_wheel_is_a_load_too_if_it_is_held_still():
    """Free, it would keep its direction; held, it has to turn with the rod."""
    description = robots.load("five_bar").description
    robot = with_hinge(MASS, 0.3)
    centred = replace(description, urdf_text=robot.description.urdf_text.replace(f'"{ARM} 0 0"', '"0 0 0"'))
    with pytest.raises(LoadedJoint, match="nothing holds hinge"):
        plan_crossing(ParallelRobot.from_description(centred), CLEAR, duration=1.5)


def test_a_light_wheel_is_held_and_the_certificate_says_what_that_costs():
    """Free, the wheel keeps its direction: the truth is its mass alone, at the tip, and no inertia."""
    plans = []
    for inertia in (1e-5, 0.0):
        text = with_hinge(MASS, inertia).description.urdf_text.replace(f'"{ARM} 0 0"', '"0 0 0"')
        description = replace(robots.load("five_bar").description, urdf_text=text)
        plans.append(plan_crossing(ParallelRobot.from_description(description), CLEAR, duration=1.5))
    held, free = plans
    cost = held.certificate.max_held_torque
    robot, times = held.robot, np.linspace(0.0, 1.5, 301)
    peak = np.abs(held.torque(times) * robot.gear_ratio).max()
    off = np.abs((held.torque(times) - free.torque(times)) * robot.gear_ratio).max()
    assert free.certificate.max_held_torque < 1e-14
    assert 1e-9 * peak < cost <= 1e-4 * peak
    assert 0.05 * cost < off < 5 * cost
    assert held.certificate.max_residual_torque < 1e-11 * peak


@pytest.mark.parametrize("flexibility", ["rigid", "flexible_links"])
def test_what_carries_nothing_or_is_locked_is_planned(flexibility):
    plain = robots.load("five_bar", flexibility=flexibility)
    light, loaded = with_hinge(0.0, 0.0, flexibility), with_hinge(MASS, 0.0, flexibility).description
    text = edited(loaded.urdf_text, (lock_joints, {"hinge": 0.0}))
    locked = ParallelRobot.from_description(replace(loaded, urdf_text=text), flexibility=flexibility)
    path = scene_path(plain.description.scenes["C"])
    plans = [plan_crossing(robot, path, duration=1.5, times=[1.0], speeds=[1.5]) for robot in (plain, light)]
    t = np.linspace(0.0, 1.5, 101)
    np.testing.assert_allclose(plans[1].torque(t), plans[0].torque(t), rtol=0, atol=1e-12)
    assert plans[1].certificate.max_residual_torque < 1e-11
    assert simulate(light, plans[1]).tracking_error < 1e-9
    held = plan_crossing(locked, path, duration=1.5)
    assert simulate(locked, held).tracking_error < 1e-9


@pytest.mark.parametrize("motor", [0, 1])
@pytest.mark.parametrize("flexibility", ["rigid", "flexible_links"])
def test_the_certificate_sees_a_torque_that_does_not_belong_to_the_motion(flexibility, motor, monkeypatch):
    robot = robots.load("five_bar", flexibility=flexibility)
    plan = plan_crossing(robot, CLEAR, duration=1.5)
    assert plan.certificate.max_residual_torque < 1e-12

    def wrong(robot, linearised, r):
        forces = balanced_forces(robot, linearised, r)
        return forces._replace(joint_torque=forces.joint_torque * np.where(np.arange(2) == motor, 1.001, 1.0))

    for module in (elasticity, module_of_forces):  # of the pass at rest, and of those with deflections
        monkeypatch.setattr(module, "balanced_forces", wrong)
    error = inverse_dynamics(robot, CLEAR, plan.law).certificate.max_residual_torque
    t = np.linspace(0.0, 1.5, 501)
    rotors = robot.rotor_inertia * plan.motor_angle(t, 2)
    missing = 1e-3 * np.abs(robot.gear_ratio * (plan.torque(t) - rotors))[:, motor].max()  # joint side
    assert 0.1 * missing < error < 10 * missing
