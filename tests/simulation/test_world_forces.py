"""Wrenches of the world in simulation: planned torques bring the robot along its path under them."""

from functools import cache

import numpy as np
import pinocchio as pin
import pytest

import robots
from framework import InvalidInput, plan_crossing, simulate
from framework.control import ControlLoop, Spread, draw, reference_of, run_closed_loop, tuned_controller
from framework.kinematics.external_wrenches import ExternalWrenches
from framework.kinematics.frames import frames_at, integrate
from framework.planning.scenes import scene_path
from framework.simulation.drive import WorldForces
from tests.oracles.contact_dynamics import simulate_contacts

TABLE = [[0.0, 0, 0, 0, 0, 0, 0], [0.3, 3, -1, 0, 0, 0, 0], [0.8, 4, 2, 0, 0, 0, 0], [1.0, 0, 0, 0, 0, 0, 0]]
PUSH = {"left_tip": [3.0, -4.0, 0, 0, 0, 0.2]}
CUT = {"left_tip": {"wrench": TABLE, "axes": "tool"}}


@cache
def loaded_plan(flexibility="rigid", *, cut=True):
    robot = robots.load("five_bar", flexibility=flexibility)
    path = scene_path(robot.description.scenes["C"])
    return plan_crossing(robot, path, duration=1.5, smoothness=4, wrenches=CUT if cut else PUSH)


@pytest.mark.parametrize("axes", ["base", "tool"])
@pytest.mark.parametrize("name", ["five_bar", "gough_stewart", "delta"])
def test_the_derivative_of_a_wrenchs_forces_is_that_of_differences(name, axes):
    rng, robot = np.random.default_rng(7), robots.load(name)
    frame = robot.description.platform.frame
    world = WorldForces.of(
        robot, ExternalWrenches.of({frame: {"wrench": rng.normal(size=6), "axes": axes}}), None
    )
    nv, t, h = robot.model.nv, np.zeros(1), 1e-6
    q = integrate(robot, robot.reference.q[None], 0.3 * rng.normal(size=(1, nv)))
    slope = world.slope(robot, t, frames_at(robot, q))[0]
    for column, unit in enumerate(np.eye(nv)):
        steps = [integrate(robot, q, sign * h * unit[None]) for sign in (1.0, -1.0)]
        ends = [world(robot, t, step, np.zeros((1, nv)))[0] for step in steps]
        np.testing.assert_allclose(slope[:, column], (ends[0] - ends[1]) / (2 * h), rtol=0, atol=1e-8)


@pytest.mark.parametrize("cut", [True, False])
@pytest.mark.parametrize("flexibility", ["rigid", "flexible_links"])
def test_planned_torques_bring_the_loaded_robot_along_its_path(flexibility, cut):
    plan = loaded_plan(flexibility, cut=cut)
    run = simulate(plan)
    assert run.tracking_error < 1e-10
    assert run.energy_error < 1e-11


def test_steps_of_one_length_have_the_wrench_of_their_middle():
    assert simulate(loaded_plan(), method="fast").tracking_error < 1e-5


def test_pinocchios_contact_dynamics_agrees():
    robot = robots.load("delta")
    scene = robot.description.scenes["cross"]
    wrench = np.array([5.0, 3, -15, 0.1, 0, 0.2])
    wrenches = {"platform": {"wrench": wrench, "axes": "tool"}}
    plan = plan_crossing(robot, scene_path(scene), duration=scene.duration, wrenches=wrenches)
    data = robot.model.createData()
    frame = robot.model.getFrameId("platform")

    def forces(model, q):
        return pin.computeFrameJacobian(model, data, q, frame, pin.LOCAL).T @ wrench

    motion = plan.dynamics
    times = np.linspace(0.0, plan.duration, 11)
    q, _ = simulate_contacts(
        robot,
        lambda t, q, v: plan.torque(t),
        motion.configuration(0.0)[0],
        motion.velocity(0.0)[0],
        times,
        world=forces,
    )
    np.testing.assert_allclose(simulate(plan).configuration(times), q, atol=1e-8)


def test_other_wrenches_than_the_plans_lead_astray_and_none_at_all_too():
    plan = loaded_plan()
    for wrenches in ({}, PUSH):
        assert simulate(plan, wrenches=wrenches, method="stiff").tracking_error > 1e-3


def test_a_table_needs_a_motion_that_tells_s():
    robot = robots.load("five_bar")
    with pytest.raises(InvalidInput, match="left_tip: a table over the path needs a planned motion"):
        simulate(robot, lambda t: np.zeros(2), duration=0.1, wrenches=CUT)
    with pytest.raises(InvalidInput, match="unknown frame 'tip'"):
        simulate(robot, lambda t: np.zeros(2), duration=0.1, wrenches={"tip": [0] * 6})


@pytest.mark.slow
@pytest.mark.parametrize(
    ("flexibility", "controllers"),
    [("rigid", ["feedforward", "lqr", "computed_torque"]), ("flexible_links", ["feedforward"])],
)
def test_controllers_know_the_wrenches_of_their_plan(flexibility, controllers):
    """Without anything else that is not as planned, the loaded robot stays on its path."""
    reference = reference_of(loaded_plan(flexibility), period=4e-3)
    for name in controllers:
        run = run_closed_loop(
            tuned_controller(name, reference),
            ControlLoop(),
            Spread(),
            [draw(reference.robot, Spread(), (0, k)) for k in range(2)],
        )
        assert run.tracking_error.max() < 1e-3, name
