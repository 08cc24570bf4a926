"""The loaded singular point, against the whole system of loads, springs and loops written anew."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import robots
from framework import ParallelRobot, plan_scene
from framework.dynamics.loaded_measure import loaded_point
from tests.oracles.closure_rows import closure_errors, closure_rows, frame_of, independent
from tests.oracles.forward_simulation import kinematics, mass_matrix, motors, rotors, springs

STEP = 1e-6  # [rad, m], for differences


def determinant_of_all(plan, t: float) -> tuple[float, float]:
    """Sign and log of det of d(forces, loops, platform) / d(q, closure forces, torques), x and rates held.

    Of a plane robot on x and y: forces M a + h - springs - J' lambda - motors, with v and a those of the
    platform and of the springs at each q.
    """
    robot, description = plan.robot, plan.robot.description
    model, data = robot.model, robot.model.createData()
    platform = frame_of(model, description.platform.frame)
    q0 = plan.configuration(t)
    dx, ddx = plan.platform(t, 1), plan.platform(t, 2)
    dl, ddl = plan.deflection(t, 1), plan.deflection(t, 2)
    elastic = np.eye(model.nv)[robot.elastic]
    kinematics(model, data, q0, np.zeros(model.nv))
    rows = independent(closure_rows(model, data, description.closures)[0])

    def jacobians(q, v):
        kinematics(model, data, q, v)
        J, drift = closure_rows(model, data, description.closures)
        pin.forwardKinematics(model, data, q, v, np.zeros(model.nv))
        axes = pin.LOCAL_WORLD_ALIGNED
        P = pin.computeFrameJacobian(model, data, q, platform, axes)[:2]
        bend = pin.getFrameClassicalAcceleration(model, data, platform, axes).linear[:2]
        return J[rows], drift[rows], P, bend

    def state(q):
        J, _, P, _ = jacobians(q, np.zeros(model.nv))
        everything = np.vstack([J, P, elastic])
        v = np.linalg.solve(everything, np.concatenate([np.zeros(len(J)), dx, dl]))
        _, drift, _, bend = jacobians(q, v)
        a = np.linalg.solve(everything, np.concatenate([-drift, ddx - bend, ddl]))
        force = (mass_matrix(model, data, q) + np.diag(rotors(robot))) @ a
        force += pin.nonLinearEffects(model, data, q, v) - springs(robot, q)
        return force, J

    S = np.array([motors(robot, torque) for torque in np.eye(robot.n_a)]).T
    force, J = state(q0)
    held = np.linalg.lstsq(np.hstack([J.T, S]), force, rcond=None)[0]

    def left(delta):
        q = pin.integrate(model, q0, delta)
        force, J = state(q)
        kinematics(model, data, q, np.zeros(model.nv))
        loops = closure_errors(model, data, description.closures)[rows]
        place = data.oMf[platform].translation[:2]
        return np.concatenate([force - J.T @ held[: len(J)] - S @ held[len(J) :], loops, place])

    slopes = np.array([(left(STEP * unit) - left(-STEP * unit)) / (2 * STEP) for unit in np.eye(model.nv)]).T
    zero = np.zeros((len(J) + 2, len(J) + robot.n_a))
    matrix = np.hstack([slopes, np.vstack([-np.hstack([J.T, S]), zero])])
    matrix /= np.abs(matrix).max(axis=1, keepdims=True)
    return np.linalg.slogdet(matrix / np.abs(matrix).max(axis=0))


@pytest.mark.parametrize("name", ["five_bar", "five_bar_heavy"])
def test_the_loaded_point_is_where_the_whole_system_is_singular(name):
    plan = plan_scene(robots.load(name, flexibility="flexible_links"), "C")
    (crossing,) = plan.crossings
    point = loaded_point(plan.dynamics, crossing.time)
    apart = point.time - crossing.time
    assert abs(apart) > 1e-6 * plan.duration
    before, after = (determinant_of_all(plan, point.time + share * apart) for share in (-1e-3, 1e-3))
    assert before[0] * after[0] < 0
    # and nowhere else near: not where the geometry is singular
    shares = np.array([-2.0, -1.0, -0.5])
    assert {determinant_of_all(plan, point.time + share * apart)[0] for share in shares} == {before[0]}


def test_the_loaded_point_approaches_the_geometric_one_as_springs_stiffen():
    """Its distance is of the order of load over stiffness."""
    distances = []
    for stiffer in (1.0, 10.0):
        soft = robots.load("five_bar", flexibility="flexible_links").description
        springs = tuple(
            replace(spring, stiffness=tuple(stiffer * k for k in spring.stiffness)) for spring in soft.springs
        )
        robot = ParallelRobot.from_description(replace(soft, springs=springs), flexibility="flexible_links")
        (point,) = plan_scene(robot, "C").loaded_points
        distances.append(point.distance)
    assert distances[0] / distances[1] == pytest.approx(10.0, rel=0.02)


def test_rigid_robots_and_rigid_geometry_have_none():
    rigid = plan_scene(robots.load("five_bar"), "C")
    undeformed = plan_scene(robots.load("five_bar", flexibility="flexible_links"), "C", geometry="rigid")
    for plan in (rigid, undeformed):
        assert plan.loaded_points == (None,)


def test_a_point_nearer_to_another_crossing_is_not_this_one_s():
    """With a second crossing put beside the loaded point, or far from it."""
    plan = plan_scene(robots.load("five_bar", flexibility="flexible_links"), "C")
    (crossing,), point = plan.dynamics.crossings, plan.loaded_points[0]
    apart = point.time - crossing.time

    def with_another(time):
        other = replace(crossing, time=time)
        return loaded_point(replace(plan.dynamics, crossings=(crossing, other)), crossing.time)

    for share in (0.9, 1.1, 1.5):
        assert with_another(crossing.time + share * apart) is None
    assert with_another(crossing.time + 100.0 * apart).time == pytest.approx(point.time, rel=1e-12)
