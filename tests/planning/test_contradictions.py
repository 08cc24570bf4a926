"""What laws and refusals of one robot say against each other: each law is a counterexample to a worse one.

The robots are those of `tests.dynamics.upright_robots`, rigid, in the slow tests of several kinds.
"""

from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import robots
from framework import NoLaw, ParallelRobot, plan_crossing
from framework.model.description import RobotDescription, Scene
from framework.planning.optimal.peak_bound import bound_plan
from framework.planning.scenes import path_of, scene_path
from tests.dynamics.upright_robots import Crossing, rigid_crossing
from tests.planning.optimal.law_contradictions import Answer, Asked, answer, contradictions, faults
from tests.robots.transformed import in_other_units, mirrored, permuted_joints, reversed_joints

CHEAPEST = 15  # a heavy five-bar on a line
LONGEST = (1.0, 20.0, 1000.0)  # times the duration
SAME = 0.01  # share of a value by which two laws of the same request may differ
NO_WORSE = 1.01  # what more freedom may cost all the same: shares for smoothness, and limits between points


def with_cheapest(robots: Iterable[int]) -> list:
    """Return numbers of random robots as parameters, all but the cheapest for the slow tests."""
    return [pytest.param(k, marks=() if k == CHEAPEST else pytest.mark.slow) for k in robots]


@cache
def answer_of(one: Crossing, asked: Asked) -> Answer:
    """The answer to a request, which several tests ask."""
    return answer(*one.plan_arguments(), asked)


def requests(duration: float, least: float, longest: tuple[float, ...] = LONGEST) -> list[Asked]:
    """Return all goals with each bound on the duration; `least` is the least peak [N m] within it."""
    bounds = [duration * ratio for ratio in longest]
    asked = [Asked(goal, duration=duration) for goal in ("peak_torque", "energy")]
    asked += [Asked(goal, longest=bound) for goal in ("peak_torque", "energy") for bound in bounds]
    asked += [Asked("time", longest=bound, torque_limit=1.25 * least) for bound in bounds]
    return [*asked, Asked("time", torque_limit=1.002 * least)]


def least_peak(one: Crossing) -> Answer:
    """The law of least peak within the duration."""
    law = answer_of(one, Asked("peak_torque", longest=one.duration))
    assert law.plan is not None, law.refusal or law.failure
    return law


def check_dominance(one: Crossing, longest: tuple[float, ...] = LONGEST) -> None:
    least = least_peak(one)
    answers = [answer_of(one, asked) for asked in requests(one.duration, least.peak, longest)]
    assert contradictions([least, *answers]) == []


def value(one: Crossing, asked: Asked) -> float:
    """What the goal counts of the law found."""
    law = answer_of(one, asked)
    assert law.plan is not None, f"{one.name}, {asked}: {law.refusal or law.failure}"
    assert faults(law) == [], one.name
    return law.value


@pytest.mark.slow
@pytest.mark.parametrize("k", with_cheapest([CHEAPEST, 2, 3, 4, 5, 6, 8, 22]))
def test_no_law_is_beaten_in_its_own_goal_and_none_is_refused_that_another_request_finds(k):
    check_dominance(rigid_crossing(k), LONGEST[2:] if k == CHEAPEST else LONGEST)


@pytest.mark.slow
@pytest.mark.parametrize("k", [CHEAPEST, 3])
def test_no_law_between_moving_ends_is_beaten(k):
    """Nor does a bound of the request with the same ends exceed a law."""
    one = rigid_crossing(k)
    unit = 1.0 / one.duration
    ends = ((0.6 * unit, 0.5 * unit**2), (0.3 * unit,))
    least = answer_of(one, Asked("peak_torque", longest=one.duration, ends=ends))
    assert least.plan is not None, least.refusal or least.failure
    asked = requests(one.duration, least.peak, () if k == CHEAPEST else LONGEST[:2])
    answers = [least, *(answer_of(one, replace(request, ends=ends)) for request in asked)]
    assert contradictions(answers) == []
    for law in answers:
        bound = None if law.plan is None else bound_plan(law.plan)
        if bound is not None and law.asked.torque_limit is None:
            assert bound.value <= law.peak * (1.0 + 1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("k", [0, 8])
def test_no_law_of_a_required_duration_is_beaten_nor_at_the_times_of_another(k):
    """The own times of a law cost nothing if they are required; a weight is held where that is cheap."""
    one = rigid_crossing(k)
    free = answer_of(one, Asked("peak_torque", duration=one.duration))
    assert free.plan is not None, free.refusal or free.failure
    times = tuple(crossing.time for crossing in free.plan.crossings)
    asked = [Asked(goal, duration=one.duration, times=times) for goal in ("peak_torque", "energy")]
    asked += [Asked("energy", duration=ratio * one.duration) for ratio in (1.0, 5.0)]
    asked.append(Asked("peak_torque", duration=5.0 * one.duration))
    assert contradictions([free, *(answer_of(one, each) for each in asked)]) == []


def of_catalogue(name: str, scene: str, flexibility: str) -> Crossing:
    """A robot of the catalogue with its springs, on the path of a scene."""
    robot = robots.load(name, flexibility=flexibility)
    chosen = robot.description.scenes[scene]
    return Crossing(f"{name} {flexibility}", robot, scene_path(chosen), chosen.duration)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "scene"), [("five_bar", "C"), ("three_rpr", "crossing")])
def test_no_law_into_motion_is_beaten_at_the_own_times_of_another(name, scene):
    """With an end in motion, and with limits and the duration open."""
    one = of_catalogue(name, scene, "rigid")
    ends = ((), (0.4 / one.duration,))
    free = Asked("peak_torque", duration=one.duration, ends=ends)
    limit = 1.3 * answer_of(one, free).peak
    answers = []
    for asked in (free, Asked("time", torque_limit=limit, ends=ends)):
        law = answer_of(one, asked)
        assert law.plan is not None, law.refusal or law.failure
        times = tuple(crossing.time for crossing in law.plan.crossings)
        answers += [law, answer_of(one, replace(asked, times=times))]
    answers.append(answer_of(one, Asked("peak_torque", longest=one.duration, ends=ends)))
    assert contradictions(answers) == []


@pytest.mark.slow
def test_no_law_of_an_elastic_robot_is_beaten():
    """Nor by that of other limits, nor by the quickest one's in its own duration."""
    one = of_catalogue("five_bar", "C", "flexible_joints")
    least = answer_of(one, Asked("peak_torque", duration=one.duration))
    quickest = answer_of(one, Asked("time", torque_limit=1.3 * least.peak))
    assert least.plan is not None
    assert quickest.plan is not None
    asked = [Asked("energy", duration=one.duration, torque_limit=ratio * least.peak) for ratio in (1.25, 1.6)]
    asked += [Asked("energy", duration=one.duration), Asked("peak_torque", duration=quickest.duration)]
    assert contradictions([least, quickest, *(answer_of(one, each) for each in asked)]) == []


@pytest.mark.slow
def test_stiff_links_that_carry_inertia_hardly_raise_the_least_peak():
    """The first law of such a robot is slow at its ends, and a better one replaces it."""
    peaks = [
        least_peak(of_catalogue("biglide", "across", flexibility)).peak
        for flexibility in ("rigid", "flexible_links")
    ]
    assert peaks[1] < 1.04 * peaks[0]


@pytest.mark.slow
def test_required_times_cost_as_much_backwards():
    one = rigid_crossing(CHEAPEST)
    times = tuple(0.9 * crossing.time for crossing in least_peak(one).plan.crossings)
    asked = Asked("peak_torque", duration=one.duration, times=times)
    back = replace(asked, times=tuple(one.duration - t for t in times[::-1]))
    assert value(reversed_path(one), back) == pytest.approx(value(one, asked), rel=SAME)


def reversed_path(one: Crossing) -> Crossing:
    """The way back: the same laws, run backwards."""
    path = path_of(one.path.kind, one.path.points[::-1])
    return one._replace(name=f"{one.name} reversed", path=path)


def with_description(one: Crossing, change: Callable[[RobotDescription], RobotDescription]) -> Crossing:
    """The robot with its description changed, and the path with it, as a scene of the robot."""
    own = Scene("own", one.path.kind, tuple(map(tuple, one.path.points.tolist())), one.duration)
    changed = change(replace(one.robot.description, scenes={"own": own}))
    scene = changed.scenes["own"]
    robot = ParallelRobot.from_description(changed)
    return Crossing(f"{one.name} changed", robot, scene_path(scene), scene.duration)


def check_same(one: Crossing, other: Crossing, *, time: float = 1.0, torque: float = 1.0) -> None:
    """Assert that two robots have the same best laws, in units `time` and `torque` of the second."""
    first, second = least_peak(one), least_peak(other)
    assert second.peak == pytest.approx(torque * first.peak, rel=SAME), other.name
    for asked, scale in (
        (Asked("time", torque_limit=1.25 * first.peak), time),
        (Asked("energy", longest=one.duration), torque**2 * time),
        (Asked("peak_torque", duration=one.duration), torque),
    ):
        same = replace(
            asked,
            duration=None if asked.duration is None else asked.duration * time,
            longest=None if asked.longest is None else asked.longest * time,
            torque_limit=None if asked.torque_limit is None else asked.torque_limit * torque,
        )
        assert value(other, same) == pytest.approx(scale * value(one, asked), rel=SAME), (
            f"{other.name}, {asked}"
        )


def permuted(robot: RobotDescription) -> RobotDescription:
    """The robot with its joints in another order and turning the other way."""
    return permuted_joints(reversed_joints(robot), np.random.default_rng(1))


def check_units(one: Crossing, original: Crossing) -> None:
    """Hold a robot in other units against the original of which it is another form."""
    length, mass, time = 10.0 ** np.random.default_rng(1).uniform(-1, 1, 3)
    if any(axis.startswith("r") for axis in one.robot.axis_names):
        length = 1.0  # on curves a radian counts as a metre: in other lengths they are others
    other = with_description(one, lambda robot: in_other_units(robot, length=length, mass=mass, time=time))
    check_same(original, other, time=time, torque=mass * length**2 / time**2)


@pytest.mark.slow
@pytest.mark.parametrize("k", with_cheapest([CHEAPEST, 2, 3, 4, 8]))
def test_units_direction_names_and_mirror_change_no_law(k):
    """All at once: what one of them did wrong, the others would not mend."""
    one = rigid_crossing(k)
    check_units(reversed_path(with_description(one, lambda robot: permuted(mirrored(robot, "x")))), one)


def check_refusal(one: Crossing) -> None:
    """Assert that a refusal names limits that would do, that these are planned, and that no law has less."""
    least = least_peak(one)
    assert least.plan is not None
    asked = Asked("peak_torque", longest=one.duration, torque_limit=0.9 * least.peak)
    with pytest.raises(NoLaw) as refused:
        plan_crossing(*one.plan_arguments(), **asked.options())
    evidence = refused.value.evidence
    assert refused.value.proof is not None or evidence is not None
    if evidence is not None and evidence.limits is not None:
        plan_crossing(*one.plan_arguments(), **{**asked.options(), **evidence.limits})
        assert np.all(evidence.limits["torque_limit"] <= NO_WORSE * least.peak)
    if evidence is not None and evidence.torque_peak is not None:
        bound = bound_plan(least.plan).value * least.plan.optimality.reference.max()
        assert 0.95 < bound / asked.torque_limit / evidence.torque_peak < 1.0


@pytest.mark.slow
@pytest.mark.parametrize("k", with_cheapest([CHEAPEST, 1, 4, 6, 22]))
def test_limits_below_the_least_peak_are_refused_with_those_that_would_do(k):
    check_refusal(rigid_crossing(k))
