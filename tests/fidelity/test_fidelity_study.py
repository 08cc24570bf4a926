"""Levels of fidelity: each is what it says, and judged by what its torques do in the highest model."""

import re
import time
from dataclasses import replace
from functools import cache, cached_property, partial
from types import SimpleNamespace

import numpy as np
import pytest

import robots
from framework import (
    FidelityStudy,
    InvalidInput,
    NoAnswer,
    ParallelRobot,
    UnboundedTorque,
    fidelity_study,
    plan_scene,
)
from framework.cli import main
from framework.cli.fidelity import fidelity_lines
from framework.dynamics.open_loop import MotorControl
from framework.fidelity.fidelity_study import _plan_motion
from framework.fidelity.model_comparison import Comparison, ReferenceMotion
from framework.fidelity.predicted_level import compute_level_motions, options_of_level, robot_at_level
from framework.model.description import LEVELS, LEVELS_BY_NAME, JointDynamics
from framework.model.robot_file_writer import write_robot_file
from framework.model.urdf_edits import with_bodies
from framework.planning.scenes import scene_request
from tests.oracles import five_bar as oracle
from tests.robots.every_robot import RIGID, SCENES, asks_nothing, in_stages

NAMES = [level.name for level in LEVELS]


@cache
def crossing_study() -> FidelityStudy:
    return fidelity_study(robots.load("five_bar"), "C", tolerance=1e-4)


def level(study: FidelityStudy, name: str):
    return study.levels[NAMES.index(name)]


def few(case) -> bool:
    return case[0] in ("five_bar", "two_arms", "four_bar")


def mass(robot: ParallelRobot) -> float:
    return sum(inertia.mass for inertia in robot.model.inertias)


@pytest.mark.parametrize("case", in_stages(((name,) for name in robots.CATALOGUE), at_once=few))
def test_bodies_lose_their_mass_and_nothing_else(case):
    (name,) = case
    whole = robots.load(name).description
    none, payload, everything = (with_bodies(whole, bodies) for bodies in ("none", "payload", "all"))
    assert everything is whole
    masses = [mass(ParallelRobot.from_description(one)) for one in (none, payload, whole)]
    assert masses[0] == 0.0 < masses[1] <= masses[2]
    assert replace(payload, urdf_text=whole.urdf_text) == whole
    assert none.actuators == whole.actuators


@pytest.mark.parametrize("name", ["five_bar", "five_bar_heavy"])
def test_the_payload_of_the_paper_is_ten_kilograms(name):
    assert mass(robot_at_level(robots.load(name).description, LEVELS_BY_NAME["payload"])) == 10.0


def test_without_bodies_the_motors_turn_their_rotors():
    plan = level(crossing_study(), "kinematics").motion
    t = np.linspace(0.0, 1.5, 31)
    torque = plan.torque(t)
    # a series differentiated twice loses half of the digits
    np.testing.assert_allclose(
        torque, 6.4e-6 * plan.motor_angle(t, 2), rtol=0, atol=1e-7 * np.abs(torque).max()
    )


def test_levels_cross_at_the_times_and_speeds_of_the_motion():
    begun = time.perf_counter()
    study = fidelity_study(robots.load("biglide"), "bow", tolerance=0.01)
    assert 0.0 < study.seconds <= time.perf_counter() - begun
    told = [(at.time, at.speed) for at in study.highest.crossings]
    for comparison in study.levels[1:]:
        law, times = comparison.motion.law, [at.time for at in comparison.motion.crossings]
        np.testing.assert_allclose([(t, float(law(t, 1))) for t in times], told, rtol=1e-12)


@pytest.mark.parametrize(
    ("name", "flexibility"),
    [("rigid", "rigid"), ("flexible_joints", "flexible_joints"), ("flexible_links", "flexible_links")],
)
def test_torques_differ_by_what_the_closed_forms_say(name, flexibility):
    study = crossing_study()
    times = study.times[::70]
    low = oracle.torques(oracle.solve("C", flexibility, "rigid", 4), times)
    high = oracle.torques(oracle.solve("C", "flexible_links", "deformed", 4), times)
    peak = np.abs(study.highest.torque(np.linspace(0.0, study.highest.duration, 40001))).max()
    expected = np.abs(low - high).max(axis=1) / peak
    found = level(study, name).torque_error[::70]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9)
    assert expected.max() > 1e-3


def test_where_legs_have_no_mass_levels_agree_and_the_levels_go_on():
    study = crossing_study()
    assert level(study, "rigid").same_as == "payload"
    assert level(study, "elastic_inertia").same_as == "deformed"
    assert study.enough.level.name == "deformed"
    assert replace(study, tolerance=0.01).enough.level.name == "payload"


def test_the_highest_level_follows_its_plan_in_its_own_simulation():
    highest = crossing_study().levels[-1]
    assert highest.torque < 1e-12
    assert highest.platform <= 0.1 * crossing_study().tolerance


@pytest.mark.parametrize(("error_of_a_step", "steps"), [(10.0, 1e-3), (1e3, 1e-5)])
def test_steps_are_shortened_until_the_plan_follows_itself(monkeypatch, error_of_a_step, steps):
    """Steps are off by 1e-3 of the tolerance or, if that carries the platform off, by 1e-5 of it."""
    study = crossing_study()
    reference = ReferenceMotion.of(study.highest, study.robot, study.tolerance)
    # shares of the path's length are shares of the robot's
    reference = replace(reference, length=reference.highest.length)
    tried = []

    def simulated(self, level, motion, step_error):
        tried.append(step_error)
        error = np.full(len(self.times), error_of_a_step * step_error)
        return Comparison(level, motion, 0.0 * error, error)

    monkeypatch.setattr(ReferenceMotion, "_simulate", simulated)
    assert list(reference.compare_levels([])) == []
    assert tried[-1] == pytest.approx(steps * study.tolerance)


def test_controllers_push_motors_back_to_their_planned_angles():
    """Off by d at a speed off by v a motor gets k_p d + k_d v more, on its side of the gear."""
    study, control = crossing_study(), MotorControl(np.array([3.0, 5.0]), np.array([0.2, 0.7]))
    reference = replace(ReferenceMotion.of(study.highest, study.robot, study.tolerance), control=control)
    motion, t = study.highest.dynamics, np.array([0.4])
    drive, plain = reference._make_drive(motion), replace(reference, control=None)._make_drive(motion)
    q, v = motion.configuration(t), motion.velocity(t)
    off, faster = np.array([1e-3, -2e-3]), np.array([0.1, 0.3])  # [rad, rad/s] of the motors
    moved_q, moved_v = q.copy(), v.copy()
    moved_q[:, study.robot.actuated] += off / study.robot.gear_ratio
    moved_v[:, study.robot.actuated] += faster / study.robot.gear_ratio
    np.testing.assert_allclose(drive.function(t, q, v), plain.function(t, q, v), atol=1e-10)
    added = drive.function(t, moved_q, moved_v) - plain.function(t, moved_q, moved_v)
    np.testing.assert_allclose(added[0], -control.k_p * off - control.k_d * faster, atol=1e-10)


def test_a_robot_without_springs_is_judged_by_the_rigid_one():
    description = replace(robots.load("five_bar_heavy").description, springs=())
    study = fidelity_study(ParallelRobot.from_description(description), "C", tolerance=1e-4)
    assert study.robot.n_e == 0
    assert [comparison.same_as for comparison in study.levels] == ["", "", "", *["rigid"] * 4]
    assert study.enough.level.name == "rigid"


def test_torques_without_masses_lose_the_platform():
    lowest = level(crossing_study(), "kinematics")
    assert lowest.torque > 0.9
    assert lowest.platform == np.inf
    assert lowest.reason.startswith("10 % off its path, and lost")


@pytest.mark.slow
def test_a_platform_that_is_lost_is_lost_at_some_instant():
    study = fidelity_study(robots.load("two_arms"), "lift", tolerance=0.01)
    lost = level(study, "rigid")
    assert lost.torque < 1e-3  # all but right, and yet: nothing feeds back, and weight pulls
    assert lost.platform == np.inf
    assert lost.reason.startswith("10 % off its path")
    assert np.nanmax(lost.platform_error) == pytest.approx(0.1, abs=0.01)
    assert study.enough.level.name in ("deformed", "elastic_inertia")


def test_where_even_the_highest_level_is_not_enough_there_is_a_reason():
    study = replace(crossing_study(), tolerance=1e-15)
    assert study.enough is None
    assert study.scene_entry is None
    assert isinstance(study.refusal, NoAnswer)
    assert crossing_study().refusal is None


def test_a_refusal_speaks_of_feedback_as_the_simulation_had_it():
    study = replace(crossing_study(), tolerance=1e-15)
    assert "without feedback" in str(study.refusal)
    caught = str(replace(study, has_control=True).refusal)
    assert "without feedback" not in caught
    assert "each motor has a controller" in caught


def test_a_simulation_that_ends_by_rounding_before_the_last_instant_loses_nothing():
    highest = crossing_study().levels[-1]
    errors = highest.platform_error.copy()
    errors[-1] = np.nan
    assert replace(highest, platform_error=errors).platform == np.max(errors[:-1])


def test_a_motion_without_a_highest_plan_has_nothing_to_be_judged_by():
    with pytest.raises(UnboundedTorque):
        fidelity_study(robots.load("five_bar"), "B")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"tolerance": 0.0}, "tolerance"),
        ({"tolerance": 1.0}, "tolerance"),
        ({"tolerance": float("nan")}, "tolerance"),
        ({"geometry": "rigid"}, "geometry: each level"),
    ],
)
def test_misuse_is_told(options, words):
    with pytest.raises(InvalidInput, match=words):
        fidelity_study(robots.load("five_bar"), "C", **options)


@pytest.mark.slow
def test_a_level_that_is_enough_while_one_above_it_is_not_is_called_so():
    """At a tolerance between their errors, errors that add up in one level cancel in the one below."""
    study = fidelity_study(robots.load("n_four_bar"), "swing", tolerance=1e-3)
    errors = {one.level.name: max(one.torque, one.platform) for one in study.levels}
    assert errors["rigid"] < errors["flexible_links"]
    between = replace(study, tolerance=0.5 * (errors["rigid"] + errors["flexible_links"]))
    assert between.enough.level.name == "rigid"
    assert "flexible_links" in between.by_luck
    assert all(errors[name] > between.tolerance for name in between.by_luck)
    assert re.search(
        r"by luck +rigid leaves out errors that cancel: .*flexible_links", "\n".join(fidelity_lines(between))
    )
    above_both = 2.0 * max(errors["rigid"], errors["flexible_links"])
    assert replace(study, tolerance=above_both).by_luck == ()


def test_indicators_do_not_grow_upwards():
    errors = [crossing_study().indicators.error[name] for name in NAMES]
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] == 0.0


def test_the_scene_keeps_what_the_study_finds():
    kept = robots.load("five_bar").description.scenes["C"].fidelity
    study = replace(crossing_study(), tolerance=kept.tolerance)
    assert study.scene_entry == {"level": kept.level, "tolerance": kept.tolerance}


@pytest.mark.parametrize("name", NAMES)
def test_a_kept_level_plans_what_was_judged(name):
    description = robots.load("five_bar").description
    options = options_of_level(description, name)
    robot = ParallelRobot.from_description(description, flexibility=options.pop("flexibility"))
    plan, t = plan_scene(robot, "C", **options), np.linspace(0.0, 1.5, 31)
    # levels below rigid are planned with all bodies; those of the 5R's legs have no mass
    comparison = level(crossing_study(), "rigid" if name == "kinematics" else name)
    np.testing.assert_allclose(plan.torque(t), comparison.motion.torque(t), rtol=0, atol=1e-10)


def with_friction(size: float) -> ParallelRobot:
    """The 5R with dry friction [N m] at its left elbow, which has no motor."""
    joints = {"left_elbow": JointDynamics(friction=size)}
    description = replace(robots.load("five_bar").description, joints=joints, left_out=("a tendon: 3 N",))
    return ParallelRobot.from_description(description)


@pytest.mark.slow
def test_dry_friction_that_no_level_has_is_counted_by_its_work(capsys, tmp_path):
    """f times the angle that the elbow turns, over the motors' work, each part taken positive."""
    study = fidelity_study(with_friction(0.001), "A", tolerance=0.01)
    plan, t = study.highest, np.linspace(0.0, study.highest.duration, 20001)
    coordinates = plan.robot.coordinates
    turned = coordinates.positions(plan.dynamics.configuration(t))
    elbow = turned[:, coordinates.names.index("left_elbow")]
    work = np.abs(
        np.diff(plan.motor_angle(t), axis=0) * 0.5 * (plan.torque(t)[1:] + plan.torque(t)[:-1])
    ).sum()
    assert study.neglected_work == pytest.approx(0.001 * np.abs(np.diff(elbow)).sum() / work, rel=1e-3)
    assert study.neglected_work < 0.01
    assert study.enough is not None
    assert main(["fidelity", str(write_robot_file(study.robot.description, tmp_path)), "--scene", "A"]) == 0
    shown = capsys.readouterr().out
    assert "in no level       dry friction of left_elbow 0.001 N m" in shown
    assert "in no level       a tendon: 3 N" in shown


def test_where_friction_that_no_level_has_is_beyond_the_tolerance_none_is_enough():
    study = fidelity_study(with_friction(5.0), "A", tolerance=0.01)
    assert study.enough is None
    assert re.search(r"dry friction that none of them has \(left_elbow 5 N m\) takes", str(study.refusal))


@pytest.mark.slow
def test_levels_of_an_upright_robot_make_one_motion_and_its_motors_have_controllers():
    """The condition (8) of each level moves the optimal law by no more than its crossing needs."""
    whole = robots.load("five_bar_heavy").description
    upright = replace(whole, gravity=(0.0, -9.81, 0.0), springs=())
    study = fidelity_study(ParallelRobot.from_description(upright), "C", optimize="peak_torque", duration=1.5)
    assert study.highest.optimality is not None
    assert all(study.law_difference(one) < 5e-3 for one in study.levels)
    assert study.has_control
    assert study.enough.level.name == "rigid"
    assert study.levels[-1].platform < 1e-3 * study.tolerance
    assert level(study, "payload").torque > study.tolerance
    assert level(study, "payload").reason.startswith("10 % off its path, and lost")
    assert f"e-fold every {1.5 / study.fall:.2g} s" in "\n".join(fidelity_lines(study))
    assert "so the motors have controllers" in "\n".join(fidelity_lines(study))


@pytest.mark.slow
def test_where_springs_are_too_soft_the_motion_is_that_of_the_rigid_plan():
    whole = robots.load("five_bar").description
    springs = tuple(replace(one, stiffness=tuple(1e-5 * k for k in one.stiffness)) for one in whole.springs)
    highest = ParallelRobot.from_description(replace(whole, springs=springs), flexibility="flexible_links")
    level, plan = _plan_motion(highest, scene_request(highest, "A", smoothness=4))
    rigid = plan_scene(robots.load("five_bar"), "A", smoothness=4)
    assert level.name == "rigid"
    np.testing.assert_allclose(plan.torque(0.5), rigid.torque(0.5), rtol=1e-9)
    with pytest.raises(UnboundedTorque):
        _plan_motion(highest, scene_request(highest, "B"))


# what each scene of the catalogue keeps as its level: enough by simulation, and no lower level is


PLANNED = [(name, scene) for name, scene in SCENES if not asks_nothing(RIGID[name].description.scenes[scene])]


def quick(case) -> bool:
    return case in [("five_bar", "A"), ("humanoid_ankle", "swing")]


def test_every_scene_that_has_a_plan_keeps_a_level_at_one_per_cent():
    kept = {case: RIGID[case[0]].description.scenes[case[1]].fidelity for case in SCENES}
    assert {case for case, level in kept.items() if level is not None} == set(PLANNED)
    assert {level.tolerance for level in kept.values() if level is not None} == {0.01}


@pytest.mark.parametrize("case", in_stages(PLANNED, at_once=quick))
def test_the_kept_level_is_enough_and_the_one_below_it_is_not(case):
    name, scene = case
    kept = robots.load(name).description.scenes[scene].fidelity
    top = robot_at_level(robots.load(name).description, LEVELS[-1])
    plan = plan_scene(top, scene)
    place = LEVELS.index(LEVELS_BY_NAME[kept.level])
    motions = compute_level_motions(top.description, plan, LEVELS[-1])
    names = [level.name for level in LEVELS[max(place - 1, 0) : place + 1]]
    reference = ReferenceMotion.of(plan, top, kept.tolerance)
    *below, enough = reference.compare_levels([(name, motions[name]) for name in names])

    def error(comparison: Comparison) -> float:
        return max(comparison.torque, comparison.platform)

    assert error(enough) <= kept.tolerance
    assert all(error(one) > kept.tolerance for one in below)


def test_springs_are_compared_as_shares_of_the_robot_s_length():
    """8 mm of a robot of half a metre are more than a hundredth of a radian."""
    robot = SimpleNamespace(
        n_e=2,
        elastic=np.array([1, 2]),
        elastic_names=("drive", "rod"),
        column_scale=np.array([1.0, 1.0, 0.5]),
    )
    motion = SimpleNamespace(
        robot=robot, duration=1.0, deflection=lambda t: np.outer(np.sin(np.pi * t), [0.01, -0.008])
    )
    name, size = Comparison(LEVELS[0], motion, np.zeros(1), np.zeros(1)).deflection
    assert (name, size) == ("rod", pytest.approx(0.008, rel=1e-3))


def test_errors_are_looked_at_as_near_to_a_crossing_on_either_side():
    robot = robots.load("five_bar")
    plan = plan_scene(robot, "C")
    beside = ReferenceMotion.of(plan, robot, 0.01).times - plan.crossings[0].time
    before, after = np.sort(-beside[beside < 0])[:10], np.sort(beside[beside > 0])[:10]
    assert after[0] < 1e-5 * plan.duration
    np.testing.assert_allclose(before, after, rtol=1e-6)


def test_laws_differ_by_the_largest_distance_between_them():
    times = np.linspace(0.0, 1.5, 301)
    study = SimpleNamespace(times=times, highest=SimpleNamespace(law=lambda t: t / 1.5))
    other = SimpleNamespace(motion=SimpleNamespace(law=lambda t: t / 1.5 - 0.02 * np.sin(np.pi * t / 1.5)))
    assert FidelityStudy.law_difference(study, other) == pytest.approx(0.02, rel=1e-12)
    assert FidelityStudy.law_difference(study, SimpleNamespace(motion=None)) == np.inf


def of_study(member: str, **values):
    """A member of a study that has these values alone."""
    attribute = vars(FidelityStudy)[member]
    study = SimpleNamespace(**values)
    if isinstance(attribute, property | cached_property):
        return attribute.__get__(study)
    return partial(attribute, study)


def test_levels_above_the_one_that_is_enough_and_are_not_show_luck():
    levels = [SimpleNamespace(level=SimpleNamespace(name=name)) for name in "abcd"]
    is_enough = dict(zip("abcd", (False, True, False, True), strict=True))
    told = {"levels": levels, "is_enough": lambda one: is_enough[one.level.name]}
    assert of_study("by_luck", enough=levels[1], **told) == ("c",)
    assert of_study("by_luck", enough=None, **told) == ()


def test_the_place_of_an_error_is_where_it_is_largest_if_it_is_more_than_rounding():
    times = np.linspace(0.0, 2.0, 5)
    place = of_study("place", times=times, highest=SimpleNamespace(law=lambda t: t / 2.0))
    assert place(np.array([0.0, 1e-3, 0.2, 1e-2, np.nan])) == 0.5
    assert place(np.full(5, 1e-14)) is None
    assert place(np.full(5, np.nan)) is None


def test_a_level_s_largest_deflection_is_told_with_its_spring():
    comparison = SimpleNamespace(
        deflection=("left_rod", 2e-5),
        same_as="",
        reason="",
        motion=None,
        torque=0.1,
        torque_error=None,
        platform=0.2,
        platform_error=None,
        level=SimpleNamespace(name="links", summary="all"),
    )
    none = {name: lambda *_: None for name in ("is_enough", "place", "law_difference")}
    indicators = SimpleNamespace(error={"links": 0.0}, words={"links": ""})
    told = of_study("_entry", indicators=indicators, **none)(comparison)
    assert told["deflection"] == {"spring": "left_rod", "largest": 2e-5}


def test_work_of_neglected_friction_is_a_share_of_that_of_the_motors(monkeypatch):
    """Joints at sin t and 2 against 0.1 and 0.3 N m for pi seconds; a motor gives 5 sin t at cos t."""
    names = vars(FidelityStudy)["neglected_work"].func.__globals__
    monkeypatch.setitem(names, "neglected_friction", lambda dynamics: np.array([0.1, 0.3]))
    plan = SimpleNamespace(
        dynamics=None,
        duration=np.pi,
        velocity=lambda t: np.column_stack([np.sin(t), 0.0 * t - 2.0]),
        torque=lambda t: 5.0 * np.sin(t)[:, None],
        motor_angle=lambda t, order: np.cos(t)[:, None],
    )
    lost, given = 0.1 * 2.0 + 0.3 * 2.0 * np.pi, 5.0
    assert of_study("neglected_work", highest=plan) == pytest.approx(lost / given, rel=1e-4)
    plan.torque = lambda t: 0.0 * t[:, None]
    assert of_study("neglected_work", highest=plan) == np.inf


@pytest.mark.parametrize("reason", ["", "run away at t = 0.3 s"])
def test_no_level_is_enough_for_the_reason_of_the_most_detailed_one_or_its_deviation(reason):
    most = SimpleNamespace(motion=1, reason=reason, platform=0.25, level=SimpleNamespace(name="most"))
    study = SimpleNamespace(
        robot=robots.load("five_bar"),
        enough=None,
        tolerance=0.01,
        neglected_work=0.0,
        has_control=False,
        levels=[SimpleNamespace(motion=1, reason="another"), most, SimpleNamespace(motion=None)],
    )
    said = str(FidelityStudy.refusal.fget(study))
    assert f"most, {reason or 'leave the path by 25 % of its length'}; without feedback" in said
