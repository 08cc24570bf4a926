"""Planned torques, integrated forward, bring robots along their paths: loops written by hand as points.

`test_every_robot_simulated.py` reads the closures from the words of the robot file. Here each robot's loops
are points of its URDF that coincide, along axes of the world, and where the robot is comes from its joints by
a formula of its own or from pinocchio. Nothing of the plan is taken but its torques, its path and its start.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
import pytest

import robots
from framework import CrossingPlan, ParallelRobot, plan_scene
from framework.kinematics.frames import frames_at
from tests.oracles.forward_simulation import forward_simulate, rotors
from tests.oracles.spherical import rodrigues
from tests.robots import test_biglide, test_four_bar, test_slider_crank

ORIGIN = (0.0, 0.0, 0.0)
PLANE, SPACE = (0, 1), (0, 1, 2)


@dataclass(frozen=True)
class Loops:
    """How a robot's loops are written, and how near to its path it has to come."""

    scene: str
    ends: tuple[tuple[str, str], ...]  # links with a point that coincides
    axes: tuple[tuple[int, ...], ...]  # of the world, along which it does
    error: Callable[[ParallelRobot, CrossingPlan, np.ndarray, np.ndarray], np.ndarray]
    bound: float  # [m, rad]
    samples: int
    rtol: float = 1e-13
    points: tuple[tuple[float, float, float], ...] = ()  # in both links, their origins if there are none


def columns(robot: ParallelRobot, q: np.ndarray, *names: str) -> list[np.ndarray]:
    """Angles and slides (T,) of joints."""
    joints = list(robot.model.names)[1:]
    return [q[:, joints.index(name)] for name in names]


def error_of_biglide(robot, plan, q, times):
    slide, hinge = q[:, 0], q[:, 1]  # left leg
    along, across = test_biglide.ROD * np.cos(hinge), test_biglide.ROD * np.sin(hinge)
    tip = np.column_stack([-test_biglide.HALF + along, slide + across])
    return np.linalg.norm(tip - plan.platform(times), axis=1)


def error_of_pin(length, start):
    """Of the crank's pin [m], of a crank that turns back by 1.8 rad."""
    return lambda robot, plan, q, times: length * (q[:, 0] - (start - 1.8 * plan.law(times)))


def error_of_three_rpr(robot, plan, q, times):
    pivot, length, wrist = columns(robot, q, "pivot_1", "motor_1", "wrist_1")
    pose = np.column_stack([length * np.cos(pivot), length * np.sin(pivot), pivot + wrist])
    return pose - plan.path(plan.law(times))


def error_of_three_rrr(robot, plan, q, times):
    crank, elbow, wrist = columns(robot, q, "motor_1", "elbow_1", "wrist_1")
    rod, turn = crank + elbow, crank + elbow + wrist
    corner_x, corner_y = -0.0928, -0.0535  # in the platform
    x = 0.6 * (np.cos(crank) + np.cos(rod)) - (np.cos(turn) * corner_x - np.sin(turn) * corner_y)
    y = 0.6 * (np.sin(crank) + np.sin(rod)) - (np.sin(turn) * corner_x + np.cos(turn) * corner_y)
    return np.column_stack([x, y, turn]) - plan.path(plan.law(times))


def pose_error(robot, q, positions, rotations):
    """Distance of the platform's origin [m] and largest entry of the change of its axes, (2 T,)."""
    at = frames_at(robot, q)
    away = np.linalg.norm(at.position[:, 0] - positions, axis=1)
    return np.concatenate([away, np.abs(at.rotation[:, 0] - rotations).max(axis=(1, 2))])


def error_of_delta(robot, plan, q, times):
    return pose_error(robot, q, plan.platform(times), np.eye(3))


def error_of_gough_stewart(robot, plan, q, times):
    x = plan.platform(times)
    return pose_error(robot, q, x[:, :3], np.array([rodrigues(turn).real for turn in x[:, 3:]]))


def error_of_coordinates(robot, plan, q, times):
    return robot.platform.coordinates(frames_at(robot, q)) - plan.platform(times)


RODS, FEET = ("1b", "2a", "2b", "3a", "3b"), ("FL", "FR", "HL", "HR")
ROBOTS = {
    "biglide": Loops("across", (("left_tip", "right_tip"),), (PLANE,), error_of_biglide, 1e-12, 41),
    "biglide bow": Loops("bow", (("left_tip", "right_tip"),), (PLANE,), error_of_biglide, 1e-12, 41),
    "four_bar": Loops(
        "dead_point",
        (("coupler_tip", "rocker_tip"),),
        (PLANE,),
        error_of_pin(test_four_bar.CRANK, 1.4),
        1e-12,
        41,
    ),
    "slider_crank": Loops(
        "dead_centre",
        (("rod_tip", "slider"),),
        (PLANE,),
        error_of_pin(test_slider_crank.CRANK, 1.0),
        1e-12,
        41,
    ),
    "three_rpr": Loops(
        "crossing",
        tuple((f"corner_{i}", f"tip_{i}") for i in (2, 3)),
        (PLANE, PLANE),
        error_of_three_rpr,
        1e-8,
        151,
    ),
    "three_rrr": Loops(
        "crossing",
        tuple((f"corner_{i}", f"tip_{i}") for i in (2, 3)),
        (PLANE, PLANE),
        error_of_three_rrr,
        1e-8,
        151,
    ),
    "delta": Loops(
        "cross",
        tuple((f"tip_{rod}", f"platform_{rod}") for rod in RODS),
        (SPACE,) * 5,
        error_of_delta,
        1e-8,
        11,
        1e-12,
    ),
    "gough_stewart": Loops(
        "turn",
        tuple((f"leg_{i}_tip", f"platform_{i}") for i in range(2, 7)),
        (SPACE,) * 5,
        error_of_gough_stewart,
        1e-8,
        11,
        1e-11,
    ),
    "standing_quadruped": Loops(
        "lower",
        tuple((f"{leg}_stand", f"{leg}_FOOT") for leg in FEET),
        (SPACE,) * 4,
        error_of_coordinates,
        1e-8,
        9,
        1e-11,
    ),
    # the weld as six translations: three of the centre, two of a point beside it, one of a third
    "two_arms": Loops(
        "turn",
        (("box", "right_hold"),) * 3,
        (SPACE, (1, 2), (2,)),
        error_of_coordinates,
        1e-8,
        9,
        1e-11,
        (ORIGIN, (0.2, 0.0, 0.0), (0.0, 0.2, 0.0)),
    ),
}


def point_frame(model: pin.Model, link: str, point: tuple[float, float, float], k: int) -> int:
    """Number of a new frame of `model` at a point of a link."""
    body = model.frames[model.getFrameId(link, pin.FrameType.BODY)]
    place = body.placement * pin.SE3(np.eye(3), np.array(point))
    return model.addFrame(pin.Frame(f"{link} point {k}", body.parentJoint, place, pin.FrameType.OP_FRAME))


@pytest.mark.parametrize("case", ROBOTS)
def test_planned_torques_bring_the_robot_along_the_path(case):
    loops, robot = ROBOTS[case], robots.load(case.split()[0])
    plan, model = plan_scene(robot, loops.scene), robot.model.copy()
    points = loops.points or (ORIGIN,) * len(loops.ends)
    frames = [
        tuple(point_frame(model, link, point, k) for link in ends)
        for k, (ends, point) in enumerate(zip(loops.ends, points, strict=True))
    ]
    times = np.linspace(0.0, plan.duration, loops.samples)
    q, _ = forward_simulate(
        model,
        closure_frames=frames,
        closure_rows=loops.axes,
        actuated=robot.actuated,
        armature=rotors(robot),
        torque=lambda t: robot.gear_ratio * plan.torque(t),
        q0=plan.dynamics.configuration(np.zeros(1))[0],
        v0=np.zeros(model.nv),
        times=times,
        rtol=loops.rtol,
        atol=0.01 * loops.rtol,
        damping=robot.joint_damping,
    )
    off = np.abs(loops.error(robot, plan, q, times)).max()
    print(f"{case}: back on the path within {off:.1e} m, rad")
    assert off < loops.bound
