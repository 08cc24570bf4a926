"""A run comes out the same to the last bit alone and among others: failures come back by their seeds."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

import robots
from framework import plan_scene
from framework.control import (
    CONTROLLERS,
    ControlLoop,
    Measurement,
    Spread,
    draw,
    reference_of,
    run_closed_loop,
    tuned_controller,
)
from framework.control.closed_loop import _VariedRobots, run_closed_loops
from framework.control.controllers import RobotState
from framework.control.variations import apply_variation
from framework.kinematics.frames import integrate
from framework.simulation import Stepper

LENGTHS = (1, 2, 3, 7, 100)
# planar, one turn, three turns of a platform and a nearly full band of equations, closures that lock turns
ROBOTS = {"five_bar": "C", "four_bar": "clear", "gough_stewart": "tilt", "spherical_rrr": "clear"}
STEPPERS = [
    ("five_bar", "rigid", "midpoint"),
    ("gough_stewart", "rigid", "midpoint"),
    ("spherical_rrr", "flexible_joints", "midpoint"),
    ("five_bar", "flexible_links", "extrapolated"),
]
SPREAD = Spread(
    payload=0.05, stiffness=0.1, places=1e-5, friction=0.02, delay=0.02, noise=1e-6, speed_noise=1e-4
)


@cache
def reference(name, period=None):
    plan = plan_scene(robots.load(name), ROBOTS[name], smoothness=4)
    return reference_of(plan, period=period or plan.duration / 10)


def some_of(*plain):
    """Return all controllers, of which those not named are for the slow suite."""
    return [pytest.param(name, marks=() if name in plain else pytest.mark.slow) for name in CONTROLLERS]


def stacks(count):
    """Some of so many runs, in stacks of each length, each time others and in another order."""
    random = np.random.default_rng(count)
    return [random.permutation(count)[:length] for length in LENGTHS]


@cache
def seen_by(name, k):
    """What the encoders of a hundred runs say beside the plan."""
    ref, random = reference(name), np.random.default_rng(3)

    def around(value, size):
        return value + size * random.standard_normal((max(LENGTHS), *value.shape))

    state = RobotState(
        integrate(ref.robot, ref.motion.q[k], around(np.zeros(ref.robot.model.nv), 1e-3)),
        around(ref.motion.v[k], 1e-2),
        around(ref.x[k], 1e-3),
        around(ref.dx[k], 1e-2),
    )
    return Measurement(
        around(ref.motor_angle[k], 1e-2),
        around(ref.motor_speed[k], 1e-1),
        state,
        around(np.zeros(ref.robot.n_a), 1e-3),  # of lqg, with encoders on the motors
    )


@pytest.mark.parametrize("sensors", ["motors", "joints"])
@pytest.mark.parametrize("controller", CONTROLLERS)
@pytest.mark.parametrize("name", ROBOTS)
def test_the_torque_of_a_run_does_not_depend_on_the_others(name, controller, sensors):
    law = tuned_controller(controller, reference(name))
    for k in (0, 4, 7):
        everyone = seen_by(name, k)
        if sensors == "motors":
            everyone = everyone._replace(state=None)
        together = law.torque(k, everyone)
        for runs in stacks(len(together)):
            state = everyone.state and RobotState(*(part[runs] for part in everyone.state))
            readings = everyone.readings[runs]
            some = Measurement(everyone.motor_angle[runs], everyone.motor_speed[runs], state, readings)
            np.testing.assert_array_equal(law.torque(k, some), together[runs])


@pytest.mark.parametrize(("name", "flexibility", "scheme"), STEPPERS)
def test_a_step_of_a_run_does_not_depend_on_the_others(name, flexibility, scheme):
    robot, random = robots.load(name, flexibility=flexibility), np.random.default_rng(4)
    others = [apply_variation(robot, draw(robot, SPREAD, (0, k))) for k in range(max(LENGTHS))]
    nv = robot.model.nv
    q = integrate(robot, robot.q_near, 1e-3 * random.standard_normal((len(others), nv)))
    v, torque = random.standard_normal((len(others), nv)), random.standard_normal((len(others), robot.n_a))
    torque[5] = np.nan  # a neighbour that is lost
    for one_robot in (False, True):
        together = None
        for runs in reversed(stacks(len(others))):
            stack = robot if one_robot else [others[run] for run in runs]
            stepper = Stepper.of(stack, scheme=scheme, damping=0.01, like=robot)
            state = stepper.step(q[runs], v[runs], torque[runs], 1e-3)
            x = stepper.platform(*state)
            if together is None:
                order, together = list(runs), (*state, *x)
            for part, whole in zip((*state, *x), together, strict=True):
                np.testing.assert_array_equal(part, whole[[order.index(run) for run in runs]])


@pytest.mark.parametrize("sensors", ["motors", pytest.param("joints", marks=pytest.mark.slow)])
@pytest.mark.parametrize("controller", some_of("feedforward", "lqg"))
def test_a_run_alone_is_the_run_among_others(controller, sensors):
    """From the start to the verdict, with everything that may differ."""
    ref = reference("five_bar", 2e-2)
    law, loop = tuned_controller(controller, ref), ControlLoop(sensors=sensors)
    variations = [draw(ref.robot, SPREAD, (1, k)) for k in range(7)]
    together = run_closed_loop(law, loop, SPREAD, variations)
    for some in ([4], [6, 1]):
        alone = run_closed_loop(law, loop, SPREAD, [variations[k] for k in some])
        for k, run in enumerate(some):
            assert alone.why[k] == together.why[run]
            assert alone.tracking_error[k] == together.tracking_error[run]
            np.testing.assert_array_equal(alone.peak_torque[k], np.abs(together.torque[:, run]).max(axis=0))
            np.testing.assert_array_equal(alone.x[:, k], together.x[: len(alone.x), run])
            np.testing.assert_array_equal(alone.torque[:, k], together.torque[: len(alone.torque), run])


def test_the_runs_of_a_controller_are_the_same_with_other_controllers_beside_it():
    """Also beside one that loses its runs, and one whose sensors read the platform."""
    ref = reference("five_bar", 2e-2)
    loop, variations = ControlLoop(sensors="motors elbows"), [draw(ref.robot, SPREAD, (1, k)) for k in (3, 8)]
    seeing = tuned_controller("lqg", ref, loop=replace(loop, sensors="motors platform imu"), spread=SPREAD)
    laws = [*(tuned_controller(name, ref) for name in CONTROLLERS), seeing]
    for law, among in zip(laws, run_closed_loops(laws, loop, SPREAD, variations), strict=True):
        alone = run_closed_loop(law, loop, SPREAD, variations)
        assert alone.why == among.why
        np.testing.assert_array_equal(alone.tracking_error, among.tracking_error)
        np.testing.assert_array_equal(alone.peak_torque, among.peak_torque)
        np.testing.assert_array_equal(alone.torque, among.torque[: len(alone.torque)])
        np.testing.assert_array_equal(alone.x, among.x[: len(alone.x)])


def test_a_run_whose_equations_are_singular_leaves_the_others_alone():
    robot = robots.CATALOGUE["five_bar"].load()
    weightless = replace(robot, stiffness=robot.stiffness)
    stepper = Stepper.of([robot, weightless, robot], like=robot)
    start = stepper.start(np.repeat(robot.q_near[None], 3, axis=0))
    stepper.rotors[1] = 0.0
    for inertia in stepper.equations[1].robot.model.inertias:
        inertia.setZero()
    state = stepper.step(*start, np.full((3, 2), 0.1), 1e-3)
    assert not np.any(np.isfinite(state.v[1]))
    np.testing.assert_array_equal(state.v[0], state.v[2])


# a run that is lost, or a platform that turns round, does not change what is said of a run


@pytest.mark.parametrize("sensors", ["motors", pytest.param("joints", marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", some_of("computed_torque", "lqg"))
def test_a_run_that_runs_away_leaves_its_neighbours_alone(name, sensors):
    plan = plan_scene(robots.load("five_bar"), "C", smoothness=4)
    controller = tuned_controller(name, reference_of(plan, period=1e-2))
    good = draw(plan.robot, Spread(), (0, 0))
    wild = replace(good, friction=np.full(plan.robot.n_a, 1e200))  # not a number after one step
    alone = run_closed_loop(controller, ControlLoop(sensors=sensors), Spread(), [good])
    among = run_closed_loop(controller, ControlLoop(sensors=sensors), Spread(), [good, wild, good])
    assert "lost" in among.why[1]
    np.testing.assert_array_equal(among.tracking_error[[0, 2]], alone.tracking_error[0])


@pytest.mark.parametrize(
    "name",
    ["lqr", *(pytest.param(name, marks=pytest.mark.slow) for name in ("feedforward", "computed_torque"))],
)
def test_a_platform_may_turn_by_more_than_half_a_turn(name):
    plan = plan_scene(robots.load("four_bar"), "full_turn")
    assert plan.platform([plan.duration])[0, 0] < -np.pi
    controller = tuned_controller(name, reference_of(plan, period=5e-3))
    run = run_closed_loop(controller, ControlLoop(), Spread(), [draw(plan.robot, Spread(), (0, 0))])
    assert run.passed[0], run.why[0]


def test_wrenches_of_each_period_are_those_of_its_middle():
    robot, times, asked = robots.load("five_bar"), np.linspace(0.0, 0.1, 6), []

    class World:
        acts = True

        def __call__(self, robot, t, q, v, models):
            asked.extend(t)

    stepper = SimpleNamespace(models=lambda count: None, step=lambda q, v, torque, h, world: (q, v))
    reference = SimpleNamespace(robot=robot, period=0.02, times=times, friction_speed=np.ones(2))
    driven = SimpleNamespace(reference=reference, world=World(), friction=np.zeros(2), stepper=stepper)
    for k in range(5):
        _VariedRobots.step(driven, k, robot.reference.q[None], np.zeros((1, robot.nv)), np.zeros((1, 2)))
    assert asked == pytest.approx([0.01, 0.03, 0.05, 0.07, 0.09])
