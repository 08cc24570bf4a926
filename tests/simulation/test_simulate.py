"""`simulate` on plans, torques and controllers: back on the path, energy kept, errors that name the thing."""

import json
import sys
from dataclasses import replace

import numpy as np
import pytest

import robots
from framework import InvalidInput, NotConverged, ParallelRobot, plan_scene, simulate
from framework.kinematics import closures
from framework.simulation import Event
from framework.simulation.drive import Drive, _count_arguments
from robots.generators import n_four_bar
from tests.oracles.contact_dynamics import simulate_contacts
from tests.oracles.equations_of_motion import defects_of
from tests.oracles.forward_simulation import simulate_robot
from tests.robots.every_robot import crossing

ROBOT = "five_bar"
FLEXIBILITY = "flexible_links"


@pytest.fixture(scope="module")
def plan(robot):
    return plan_scene(robot, "C")


# ------------------------------------------------------------------ planned torques come back on the path


@pytest.mark.parametrize(("method", "apart"), [("reference", 1e-11), ("stiff", 1e-7), ("fast", 2e-5)])
def test_the_deformed_5R_comes_back_on_its_path_through_the_singularity(robot, plan, method, apart):
    result = simulate(robot, plan, method=method, step=4e-3 if method == "fast" else None)
    assert result.tracking_error < apart  # [m]
    assert result.closure_error < apart
    end = result.platform(plan.duration)[0]
    np.testing.assert_allclose(end, plan.platform(plan.duration), atol=apart)
    np.testing.assert_allclose(result.configuration(1.0), plan.dynamics.configuration(1.0), atol=10 * apart)
    if method == "reference":
        assert result.energy_error < 1e-10
        assert result.unresolved < 1e-11
        np.testing.assert_allclose(result.velocity(1.0), plan.dynamics.velocity(1.0), atol=1e-8)
        np.testing.assert_allclose(result.platform(1.0, order=1)[0], plan.platform(1.0, 1), atol=1e-9)


class OwnMotion:
    """A planned motion of one's own making, with a table of torques."""

    def __init__(self, motion):
        self.duration, self.torque, self.platform = motion.duration, motion.torque, motion.platform
        self.configuration, self.velocity = motion.configuration, motion.velocity
        self.torques = motion.torque(np.linspace(0.0, motion.duration, 5))


def test_a_motion_of_ones_own_drives_by_its_torque_whatever_else_it_has():
    plan = plan_scene(robots.load("five_bar"), "C")
    assert simulate(plan.robot, OwnMotion(plan.dynamics)).tracking_error < 1e-10


PATHS = [
    ("four_bar", "flexible_links", "dead_point", 1e-9),
    ("bricard", "flexible_links", "dead_point", 1e-10),
    pytest.param("spherical_rrr", "flexible_joints", "cross", 1e-9, marks=pytest.mark.slow),
    pytest.param("three_rpr", "rigid", "crossing", 1e-11, marks=pytest.mark.slow),
    ("gough_stewart", "rigid", "turn", 1e-9),
]


@pytest.mark.parametrize(("name", "flexibility", "scene", "apart"), PATHS)
def test_crossings_of_other_robots(name, flexibility, scene, apart):
    """Torques are planned to 1e-10 of their size, and some motions are unstable: that is what is left."""
    other = robots.load(name, flexibility=flexibility)
    plan = plan_scene(other, scene)
    assert plan.crossings
    result = simulate(other, plan)
    assert result.tracking_error < apart
    assert (result.turning_error is None) == (len(set(other.translations)) != 2)
    assert (result.frame_error is None) == (not other.description.platform.joints)
    assert result.turning_error is None or result.turning_error < apart


@pytest.mark.slow
@pytest.mark.parametrize("name", robots.CATALOGUE)
@pytest.mark.parametrize("flexibility", ["rigid", "flexible_links"])
def test_every_plan_of_the_catalogue_comes_back(name, flexibility):
    from framework import NoAnswer

    other = robots.load(name, flexibility=flexibility)
    done = 0
    for scene in other.description.scenes:
        try:
            plan = plan_scene(other, scene)
        except NoAnswer:
            continue
        result = simulate(other, plan)
        assert result.tracking_error < 1e-7
        assert result.energy_error < 1e-9
        done += 1
    assert done


def test_another_integrator_on_other_equations_agrees():
    """tests/oracles/forward_simulation.py: closures, springs, rotors written anew, a KKT system, DOP853."""
    heavy = robots.load("five_bar_heavy", flexibility="flexible_joints")
    plan = plan_scene(heavy, "C")
    start, times = plan.dynamics.configuration(0.0)[0], np.linspace(0, 0.1, 5)
    ours = simulate(heavy, plan, start=start, duration=0.1)
    q, v = simulate_robot(heavy, plan.torque, q0=start, times=times, rtol=1e-11, atol=1e-13)
    np.testing.assert_allclose(ours.configuration(times), q, atol=1e-9)
    np.testing.assert_allclose(ours.velocity(times), v, atol=1e-7)


@pytest.mark.parametrize(
    ("name", "scene"), [("five_bar_heavy", "C"), ("four_bar", "dead_point"), ("delta", "cross")]
)
def test_pinocchio_s_contact_dynamics_agrees(name, scene):
    """The oracle shares neither equations nor integrator with method reference."""
    other = robots.load(name)
    plan = plan_scene(other, scene)
    ours = simulate(other, plan)
    times = np.linspace(0.0, plan.duration, 21)
    q, v = simulate_contacts(
        other, lambda t, q, v: plan.torque(t), *(start[0] for start in states(plan, [0.0])), times
    )
    np.testing.assert_allclose(ours.configuration(times), q, atol=1e-9)
    np.testing.assert_allclose(ours.velocity(times), v, atol=1e-7)


def states(plan, t):
    return plan.dynamics.configuration(t), plan.dynamics.velocity(t)


def test_contact_dynamics_agrees_on_springs_damping_feedback_and_events():
    other = robots.load("biglide", flexibility="flexible_joints")
    rest = simulate(other, lambda t: [0.0, 0.0], duration=0.01).q[0]

    def towards(t, q, v):
        return np.array([-20.0 * (q[c] - rest[c] - 0.01) - 0.5 * v[c] for c in other.actuated])

    moved = Event(
        lambda t, q, v: q[other.actuated[0]] - rest[other.actuated[0]] - 1e-3, "moved", terminal=True
    )
    ours = simulate(other, towards, duration=0.2, damping=0.1, events=[moved])
    times = np.linspace(0.0, ours.duration, 5)
    q, v = simulate_contacts(other, towards, rest, np.zeros(other.nv), times, damping=0.1)
    np.testing.assert_allclose(ours.configuration(times), q, atol=1e-10)
    assert abs(moved.function(0.0, q[-1], v[-1])) < 1e-10


def test_method_explicit_is_deprecated():
    robot = robots.load("four_bar")
    with pytest.warns(DeprecationWarning, match="reference"):
        result = simulate(robot, lambda t: [0.0], duration=0.1, method="explicit")
    np.testing.assert_array_equal(result.q, simulate(robot, lambda t: [0.0], duration=0.1).q)


def test_a_plan_for_stiff_legs_drives_soft_ones_off_the_path():
    soft = robots.load("five_bar", flexibility="flexible_links")
    rigid = plan_scene(robots.load("five_bar"), "A", smoothness=4)
    result = simulate(soft, rigid)
    np.testing.assert_allclose(result.platform(0.0)[0], rigid.platform(0.0), atol=1e-12)
    assert 1e-7 < result.tracking_error < 1e-3
    with pytest.raises(InvalidInput, match="drives 2 motors, four_bar has 1"):
        simulate(robots.load("four_bar"), rigid)
    with pytest.raises(InvalidInput, match=r"the plan is for three_rrr .* of another build"):
        simulate(robots.load("delta"), plan_scene(robots.load("three_rrr"), "clear"))


def test_a_wrong_torque_leaves_the_path(robot, plan):
    result = simulate(robot, lambda t: 1.01 * plan.torque(t), duration=1.5)
    assert result.tracking_error is None
    assert np.abs(result.platform(1.5) - plan.platform(1.5)).max() > 1e-3


# ------------------------------------------------------------------ feedback, damping, jumps, events


def test_feedback_and_damping_balance_the_energy():
    rigid = robots.load("five_bar")
    rest = simulate(rigid, lambda t: [0.0, 0.0], duration=0.01).q[0]

    def towards(t, q, v):
        return [-0.5 * (q[c] - rest[c] - 0.1) - 0.02 * v[c] for c in rigid.actuated]

    result = simulate(rigid, towards, duration=2.0, damping=0.05)
    assert result.energy_error < 1e-10
    wanted = rest[rigid.actuated] + 0.1
    np.testing.assert_allclose(result.q[-1, rigid.actuated], wanted, atol=5e-2)
    # the same with fixed steps, second order
    coarse, fine = (
        np.abs(simulate(rigid, towards, duration=0.5, damping=0.05, method="fast", step=h).q[-1]
               - result.configuration(0.5)[0]).max()
        for h in (2e-3, 1e-3)
    )  # fmt: skip
    assert fine < 0.6 * coarse < 1e-3  # a held feedback torque is of first order


@pytest.mark.parametrize(("method", "apart"), [("stiff", 1e-7), ("fast", 1e-6)])
def test_damping_of_joints_and_of_the_call_counts_once(tmp_path, method, apart):
    """A parallelogram without gravity runs down by J w' = -3 d w.

    Its three joints turn at w or -w with the damping d = 0.5 N m s/rad each, of which the file has 0.3. Both
    rods and the bar measure 1 m and weigh 1 kg. The rods turn about their ends, and the centre of the bar
    runs on a circle of radius 1 m: J = 2 / 3 + 1.
    """
    file = n_four_bar.write(tmp_path, 1)
    joints = "".join(f"  {name}: {{damping: 0.3}}\n" for name in ("pivot_0", "pivot_1", "hinge_1"))
    file.write_text(f"{file.read_text()}gravity: [0, 0, 0]\njoints:\n{joints}")
    robot = replace(ParallelRobot.from_file(file), rotor_inertia=np.zeros(1))
    is_rod = np.array([name.startswith("pivot") for name in robot.coordinates.names])
    result = simulate(
        robot,
        lambda t: [0.0],
        start_velocity=np.where(is_rod, 1.0, -1.0),
        duration=1.0,
        damping=0.2,
        method=method,
    )
    decay = 3 * 0.5 / (2 / 3 + 1)  # [1/s]
    turned = (1.0 - np.exp(-decay * result.times)) / decay
    for q, is_forward in zip((result.q - result.q[0]).T, is_rod, strict=True):
        np.testing.assert_allclose(q, turned if is_forward else -turned, atol=apart)
    lost = (1 - np.exp(-2 * decay)) * (2 / 3 + 1) / 2  # [J] kinetic energy
    assert result.energy_error < apart * lost


def test_a_massless_rod_that_may_spin_about_itself_stays_still(write_robot):
    """A joint that moves nothing has no equation of its own; it is held, as in the inverse dynamics."""
    joint = '<joint name="right_rod_tip" type="fixed">'
    spin = joint.replace("fixed", "continuous") + '<axis xyz="1 0 0"/>'
    robot = ParallelRobot.from_file(write_robot(urdf=((joint, spin),)))
    plan = plan_scene(robot, "C")
    for method in ("reference", "fast"):
        result = simulate(robot, plan, method=method, step=2e-3 if method == "fast" else None)
        assert result.tracking_error < (1e-11 if method == "reference" else 1e-4)
        column = [c for c in range(robot.model.nv) if robot.coordinates.name_of(c) == "right_rod_tip"]
        assert np.ptp(result.q[:, column]) < 1e-12


def test_a_jump_of_the_torque_is_passed_where_it_is_announced():
    rigid = robots.load("five_bar_heavy")

    def torque(t):
        return [0.1, 0.0] if t < 0.05 else [-0.1, 0.0]

    told = simulate(rigid, torque, duration=0.1, breaks=[0.05])
    first = simulate(rigid, lambda t: [0.1, 0.0], duration=0.05)
    second = simulate(
        rigid, lambda t: [-0.1, 0.0], start=first.q[-1], start_velocity=first.v[-1], duration=0.05
    )
    assert told.steps < 20
    np.testing.assert_allclose(told.q[-1], second.q[-1], atol=1e-11)


@pytest.mark.parametrize("method", ["reference", "fast"])
def test_events_are_found_at_their_instants_and_may_end_the_simulation(robot, plan, method):
    singular = plan.crossings[0].platform

    def height(t, q, v):
        return float(plan.platform(t)[1] - singular[1])

    seen: list[float] = []
    events = [
        Event(height, "crossing", terminal=True),
        Event(lambda t, q, v: t - 0.25, "quarter", direction=1),
    ]
    step = 5e-3 if method == "fast" else None
    result = simulate(robot, plan, method=method, step=step, events=events, progress=seen.append)
    assert [one.name for one in result.occurrences] == ["quarter", "crossing"]
    assert result.occurrences[0].time == pytest.approx(0.25, abs=1e-9)
    assert result.occurrences[1].time == pytest.approx(1.0, abs=1e-9)
    assert result.duration == pytest.approx(1.0, abs=5e-3)
    assert seen == sorted(seen)
    assert 0 < seen[-1] <= 1
    none = simulate(robot, plan, events=[Event(height, direction=1)])  # it falls there
    assert none.occurrences == ()


# ------------------------------------------------------------------ what is refused


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "quick"}, "method 'quick'.*explicit, fast, reference, stiff"),
        ({"tolerance": 0.0}, "tolerance"),
        ({"tolerance": 1e-6, "method": "fast"}, "tolerance: method fast has none"),
        ({"stages": 2}, "stages: needs a whole number, 3 to 30"),
        ({"stages": 4, "method": "fast"}, "stages"),
        ({"step": -1.0}, "step"),
        ({"samples": 1}, "samples"),
        ({"duration": 2.0}, "ends at 1.5 s"),
        ({"duration": float("nan")}, "duration"),
        ({"start": [0.0]}, "start must be 8"),
        ({"start_velocity": [np.inf] * 8}, "start_velocity must be 8 finite"),
        ({"damping": -1.0}, "damping"),
    ],
)
def test_misuse_is_named(robot, plan, options, message):
    with pytest.raises(InvalidInput, match=message):
        simulate(robot, plan, **options)


@pytest.mark.parametrize(
    ("drive", "message"),
    [
        (3.0, "torque: needs a plan"),
        (lambda: [0.0, 0.0], "torque: takes"),
        (lambda t: [0.0], "torque: at t = 0 s must be 2 finite numbers"),
        (lambda t: [np.nan, 0.0], "torque: at t = 0 s must be 2 finite numbers"),
    ],
)
def test_drives_that_cannot_be_are_named(robot, drive, message):
    with pytest.raises(InvalidInput, match=message):
        simulate(robot, drive, duration=0.1)


@pytest.mark.parametrize("option", [{"breaks": [0.05]}, {"wrenches": {}}])
def test_a_drive_takes_no_breaks_or_wrenches_beside_its_own(robot, plan, option):
    with pytest.raises(InvalidInput, match="a Drive has its own breaks and wrenches"):
        simulate(robot, Drive.of(robot, plan), duration=0.1, **option)


def test_a_function_needs_a_duration(robot):
    with pytest.raises(InvalidInput, match="duration: required"):
        simulate(robot, lambda t: [0.0, 0.0])


@pytest.mark.slow
def test_a_torque_that_jumps_all_the_time_is_refused_with_advice():
    rigid = robots.load("five_bar_heavy")

    start = rigid.q_near[0]

    def switching(t, q, v):
        return [-0.5 * np.sign(q[0] + 0.1 * v[0] - start), 0.0]

    with pytest.raises(NotConverged, match="method fast"):
        simulate(rigid, switching, duration=1.0, method="stiff")


def test_the_result_speaks(robot, plan):
    result = simulate(robot, plan, method="stiff")
    assert "stiff" in repr(result)
    assert json.loads(json.dumps(result.to_dict()))["steps"] == result.steps
    with pytest.raises(InvalidInput, match="outside the simulation"):
        result.configuration(1.6)
    with pytest.raises(InvalidInput, match="order"):
        result.platform(0.5, order=2)


@pytest.mark.parametrize(("planned", "driven"), [("five_bar", "biglide"), ("agile_eye", "three_rpr")])
def test_a_plan_of_another_mechanism_is_refused(planned, driven):
    """Both have as many coordinates; what would be compared are metres with metres of something else."""
    robot = robots.load(planned)
    scene = next(iter(robot.description.scenes))
    with pytest.raises(InvalidInput, match="of another build"):
        simulate(robots.load(driven), plan_scene(robot, scene).dynamics, method="stiff")


# a zero at the very instant where one step ends and the next begins is seen, and once


@pytest.mark.parametrize("method", ["reference", "stiff", "fast"])
def test_a_zero_between_two_steps_is_seen_once(method):
    robot = robots.load("five_bar")
    for instant in np.linspace(0.01, 0.09, 9):
        event = Event(lambda t, q, v, instant=instant: t - instant)
        result = simulate(
            robot, lambda t: [0, 0], method=method, duration=0.1, breaks=[instant], events=[event]
        )
        assert [one.time for one in result.occurrences] == pytest.approx([instant], abs=1e-14)


@pytest.mark.parametrize("method", ["reference", "stiff", "fast"])
def test_an_event_occurs_where_the_motion_that_is_returned_has_it(method):
    robot = robots.load("five_bar")
    angle = robot.reference.q[0] + 0.01
    turned = Event(lambda t, q, v: q[0] - angle)
    result = simulate(robot, lambda t: [0.1, 0.0], method=method, duration=0.05, events=[turned])
    (one,) = result.occurrences
    assert np.ravel(result.configuration(one.time))[0] == pytest.approx(angle, abs=1e-14)


@pytest.mark.parametrize("value", [np.nan, None, [1.0, 2.0], "a"])
def test_what_is_no_number_is_refused(value):
    event = Event(lambda t, q, v: value if t > 0.02 else 1.0, name="gauge")
    with pytest.raises(InvalidInput, match="gauge"):
        simulate(robots.load("five_bar"), lambda t: [0, 0], duration=0.05, events=[event])


# a fault in what planner and simulator share


SHIFT = 0.01  # [m]


SLOW = [pytest.param(name, marks=pytest.mark.slow) for name in ("three_rpr", "three_rrr")]


@pytest.mark.parametrize("name", ["five_bar", "biglide", "delta", "gough_stewart", *SLOW])
def test_loops_shifted_in_the_code_that_all_share_are_seen_by_the_witness_alone(name, monkeypatch):
    """Every loop closes 10 mm beside itself, along the x axis of its first frame."""
    original = closures.loop_wrenches

    def shifted(rows, at):
        loops = original(rows, at)
        along_x = rows.translation & (rows.first_axis == 0)
        return loops._replace(residual=loops.residual + SHIFT * along_x)

    for module in [module for key, module in sys.modules.items() if key.startswith("framework.")]:
        if getattr(module, "loop_wrenches", None) is original:
            monkeypatch.setattr(module, "loop_wrenches", shifted)
    robot = robots.CATALOGUE[name].load()
    plan = crossing(robot, times=None, speeds=None)
    assert plan.certificate.max_closure_error < 1e-12
    followed = simulate(robot, plan)
    assert followed.closure_error < 1e-11
    assert followed.tracking_error < 1e-7  # a wrong robot, and nobody who could tell
    assert defects_of(plan).open > 0.5 * SHIFT


@pytest.mark.parametrize(
    ("drive", "count"),
    [
        (lambda t: 0.0, 1),
        (lambda t, q, v, gain=2.0: 0.0, 3),
        (lambda t, *, gain=2.0: 0.0, 1),
        (lambda *rest: 0.0, 0),
    ],
)
def test_a_drive_is_called_with_the_arguments_that_it_needs(drive, count):
    assert _count_arguments(drive) == count


def test_a_plan_drives_its_own_robot_alone(plan):
    with pytest.raises(InvalidInput, match="robot"):
        simulate(plan, lambda t: [0.0, 0.0], duration=0.1)
    with pytest.raises(InvalidInput, match="torque"):
        simulate(plan.robot)
