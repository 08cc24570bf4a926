"""One record says what is asked, whoever asks: a call, a scene or a command line."""

import shlex
from dataclasses import FrozenInstanceError, fields, replace
from doctest import DocTestParser, DocTestRunner
from inspect import getdoc, signature

import numpy as np
import pytest

import robots
from framework import (
    Arc,
    InvalidInput,
    Line,
    ParallelRobot,
    Polyline,
    Spline,
    load_plan,
    plan_crossing,
    plan_scene,
)
from framework.cli import arguments
from framework.cli.commands import OneLineParser
from framework.cli.parser import add_motion, add_options, add_path
from framework.model.description import Scene
from framework.planning.options import OPTIONS, TYPED
from framework.planning.request import Request, specification_of
from framework.planning.saved import plan_document, save_plan
from framework.planning.scenes import scene_request

ROBOT = "five_bar"
LINE = Line([0.1, 0.345], [-0.05, 0.195])
ASKED = {"duration": 1.5, "times": [1.0], "speeds": [1.5]}


def typed(robot, *words: str) -> Request:
    """The request of a command line."""
    parser = OneLineParser()
    add_path(parser)
    add_motion(parser)
    return arguments.request(parser.parse_args(words), robot)


def test_a_call_a_scene_and_a_command_line_ask_the_same(robot):
    request = Request.of(robot, LINE, **ASKED)
    assert scene_request(robot, "C") == request
    assert typed(robot, "--scene", "C") == request
    ends = ["--from", "0.1", "0.345", "--to", "-0.05", "0.195"]
    assert typed(robot, *ends, "--duration", "1.5", "--times", "1", "--speeds", "1.5") == request


@pytest.mark.parametrize(
    ("words", "options"),
    [
        ("--optimize time --torque-limit 0.3 0.4", {"optimize": "time", "torque_limit": [0.3, 0.4]}),
        ("--law optimal --margin 10%", {"law": "optimal", "margin": 0.1}),
        ("--longest 2 --optimize energy", {"longest": 2.0, "optimize": "energy"}),
        ("--duration 3 --times 2 --smoothness 3", {"duration": 3.0, "times": [2.0], "smoothness": 3}),
    ],
)
def test_what_is_typed_beside_a_scene_is_what_a_call_says_beside_it(robot, words, options):
    assert typed(robot, "--scene", "C", *words.split()) == scene_request(robot, "C", **options)


def test_corners_that_are_typed_make_a_polyline(robot):
    words = shlex.split(
        "--from 0.1 0.345 --via 0 0.3 --via -0.02 0.2 --to 0.08 0.2 --blend 0.01 --duration 2"
    )
    corners = Polyline([[0.1, 0.345], [0.0, 0.3], [-0.02, 0.2], [0.08, 0.2]], blend=0.01)
    assert typed(robot, *words) == Request.of(robot, corners, duration=2.0)
    no_blend, no_corner = words[:-4] + words[-2:], words[:3] + words[9:]
    for wrong in (no_blend, no_corner, ["--scene", "C", *words[3:6], "--blend", "0.01"]):
        with pytest.raises(InvalidInput, match=r"--blend|--scene"):
            typed(robot, *wrong)


def test_a_scene_without_duration_asks_for_the_least(robot):
    wanted = Scene("quick", "line", ((0.1, 0.345), (-0.05, 0.195)), None, optimize="time")
    description = replace(robot.description, scenes={"quick": wanted})
    quick = ParallelRobot.from_description(description)
    limited = {"torque_limit": 0.2}
    assert scene_request(quick, "quick", **limited) == Request.of(quick, LINE, optimize="time", **limited)
    for instead in ({"duration": 1.5}, {"duration": 1.5, "times": [1.0]}):
        assert scene_request(quick, "quick", **instead) == Request.of(quick, LINE, **instead)


def test_a_plan_keeps_its_request(robot):
    assert plan_crossing(robot, LINE, **ASKED).request == Request.of(robot, LINE, **ASKED)
    assert plan_scene(robot, "A").request == scene_request(robot, "A")


def test_what_the_robot_decides_is_filled_in():
    for flexibility, geometry, smoothness in (("rigid", "rigid", 2), ("flexible_joints", "deformed", 4)):
        request = Request.of(robots.load("five_bar", flexibility=flexibility), LINE, duration=1.5)
        assert (request.geometry, request.smoothness) == (geometry, smoothness)


def test_a_request_is_plain_and_cannot_be_changed(robot):
    times, limit = np.array([1.0]), np.array([0.3, 0.4])
    request = Request.of(robot, LINE, duration=np.float64(1.5), times=times)
    assert request.times == (1.0,)
    times[0] = 0.5
    assert request.times == (1.0,)
    with pytest.raises(FrozenInstanceError):
        request.margin = 0.2
    assert Request.of(robot, LINE, duration=1.5, torque_limit=limit).torque_limit == (0.3, 0.4)
    for field in fields(request):
        assert not isinstance(getattr(request, field.name), np.ndarray)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"duration": -1.0}, "duration"),
        ({"margin": 1.0}, "margin"),
        ({"law": "cubic"}, "cubic"),
        ({"optimize": "noise"}, "noise"),
        ({"optimize": "energy", "times": ()}, "belong to the polynomial"),
        ({"law": "optimal", "times": (1.6,)}, "inside the motion"),
        ({"speeds": (-1.0,)}, "speeds"),
        ({"tolerance": 0.5}, "tolerance"),
        ({"duration": None}, "duration"),
    ],
)
def test_a_request_that_is_changed_is_checked_again(robot, change, says):
    request = Request.of(robot, LINE, **ASKED)
    with pytest.raises(InvalidInput, match=says):
        replace(request, **change)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"times": 1.0}, "times: needs a list of numbers, got 1.0"),
        ({"times": "1.0"}, "times: needs a list"),
        ({"speeds": [None]}, "speeds: must be finite numbers, got None"),
        ({"at": [float("nan")]}, "at: must be finite"),
        ({"times": [], "duration": "long"}, "duration: must be a positive number"),
        ({"torque_limit": [1.0, 2.0, 3.0]}, r"one for each motor \(left_motor, right_motor\)"),
        ({"smoothness": 2.0}, "smoothness: needs a whole number"),
    ],
)
def test_misuse_is_told_with_what_was_expected(robot, options, says):
    with pytest.raises(InvalidInput, match=says):
        plan_crossing(robot, LINE, **{"duration": 1.5, **options})


def test_limits_are_those_asked_for_or_the_robot_file_s_less_the_margin(robot):
    asked = Request.of(robot, LINE, duration=1.5, torque_limit=0.4, margin=0.25)
    specification = specification_of(robot, asked)
    np.testing.assert_allclose(specification.torque_limit, [0.3, 0.3], rtol=1e-15)
    motors = robot.description.actuators
    in_file = [np.inf if motor.speed_limit is None else 0.75 * motor.speed_limit for motor in motors]
    np.testing.assert_allclose(specification.speed_limit, in_file, rtol=1e-15)
    asked = Request.of(robot, LINE, duration=1.5, speed_limit=[100.0, 40.0], margin=0.25)
    np.testing.assert_allclose(specification_of(robot, asked).speed_limit, [75.0, 30.0], rtol=1e-15)


@pytest.mark.parametrize("none", [[None], [None, np.inf], {"left_motor": None}])
def test_no_limit_is_no_reason_for_another_law(robot, none):
    as_it_is = scene_request(robot, "C")
    without = scene_request(robot, "C", torque_limit=none, speed_limit=[None])
    assert (without.kind, without.times, without.speeds) == ("polynomial", as_it_is.times, as_it_is.speeds)
    limited = Request.of(robot, LINE, duration=1.5, torque_limit=[0.2, None])
    assert (limited.kind, limited.bounded) == ("auto", True)
    with pytest.raises(InvalidInput, match="torque_limit or speed_limit is needed"):
        scene_request(robot, "C", torque_limit=none, optimize="time")


def test_paths_are_equal_where_their_kind_and_points_are():
    corners = [[0.0, 0.0], [1.0, 1.0], [2.0, 0.0]]
    paths = [Line(*corners[:2]), Line(*corners[1:]), Arc(*corners), Spline(corners)]
    again = [Line(*corners[:2]), Line(*corners[1:]), Arc(*corners), Spline(corners)]
    assert len({*paths, *again}) == len(paths)
    for k, one in enumerate(paths):
        assert [one == other for other in again] == [k == other for other in range(len(again))]


def test_the_options_declared_once_are_those_of_every_place_that_has_them(robot):
    request = Request.of(robot, LINE, **ASKED)
    assert list(signature(plan_crossing).parameters) == ["robot", "path", *OPTIONS]
    for option in OPTIONS.values():
        assert f"\n    {option.name}: " in getdoc(plan_crossing)
        assert hasattr(request, option.name)
    assert set(plan_document(plan_crossing(robot, LINE, **ASKED))["request"]) == {"path", *OPTIONS}
    parser = OneLineParser()
    add_motion(parser)
    add_options(parser, "keep_limits")
    of_wrenches = {"wrench", "wrench_on"}  # one option of Python, typed in two ways
    assert set(vars(parser.parse_args([]))) == {*TYPED, *of_wrenches}
    assert all(
        option.summary.replace("\n", " ") in " ".join(parser.format_help().split())
        for option in TYPED.values()
    )


def test_an_option_that_is_not_declared_is_no_argument(robot):
    with pytest.raises(TypeError, match="'durations' is no option of a plan; did you mean 'duration'"):
        plan_crossing(robot, LINE, durations=1.5)


def test_the_example_of_the_help_is_as_it_says():
    example = DocTestParser().get_doctest(getdoc(plan_crossing), {}, "plan_crossing", None, None)
    assert len(example.examples) == 3
    assert DocTestRunner().run(example).failed == 0


@pytest.mark.parametrize(
    ("stated", "expected"),
    [
        (0.4, (0.4,)),
        ([0.4, 0.4], (0.4,)),
        ([0.4, None], (0.4, None)),
        ([np.inf, 0.3], (None, 0.3)),
        ({"right_motor": 0.3}, (None, 0.3)),
        ({"right_motor": 0.3, "left_motor": None}, (None, 0.3)),
    ],
)
def test_limits_are_one_for_all_one_for_each_or_by_joint(robot, stated, expected):
    asked = Request.of(robot, LINE, duration=1.5, torque_limit=stated)
    assert asked.torque_limit == expected
    limited = replace(
        robot.description,
        actuators=tuple(replace(motor, torque_limit=0.7) for motor in robot.description.actuators),
    )
    asked = Request.of(ParallelRobot.from_description(limited), LINE, duration=1.5, torque_limit=stated)
    left_to_the_file = isinstance(stated, dict) and "left_motor" not in stated
    assert asked.torque_limit == ((0.7, 0.3) if left_to_the_file else expected)


@pytest.mark.parametrize(
    ("stated", "says"),
    [
        ({"left_moto": 0.3}, "torque_limit: unknown motor 'left_moto'; did you mean 'left_motor'"),
        ({"left_motor": 0.0}, "torque_limit: needs one positive number"),
        ([0.3, float("nan")], "torque_limit: needs one positive number"),
        ("0.3 a lot", "torque_limit: needs one positive number"),
        (True, "torque_limit: needs one positive number"),
    ],
)
def test_limits_that_cannot_be_are_told(robot, stated, says):
    with pytest.raises(InvalidInput, match=says):
        Request.of(robot, LINE, duration=1.5, torque_limit=stated)


def test_a_plan_with_a_motor_without_limit_comes_back(robot, tmp_path):
    plan = plan_crossing(robot, LINE, duration=1.5, torque_limit={"left_motor": 0.2})
    assert np.abs(plan.torque(np.linspace(0.0, 1.5, 401))[:, 0]).max() <= 0.2
    save_plan(plan, tmp_path)
    assert load_plan(tmp_path).request == plan.request


def test_a_path_that_a_scene_cannot_have_is_refused_by_file_and_scene():
    description = robots.load("five_bar").description
    corners = ((0.1, 0.345), (0.0, 0.32), (0.0, 0.3))
    wide = Scene("wide", "polyline", corners, duration=1.0, blend=1.0)  # beyond the middle of its segments
    robot = ParallelRobot.from_description(replace(description, scenes={"wide": wide}))
    with pytest.raises(InvalidInput, match=r"five_bar\.yaml: scenes\.wide: "):
        scene_request(robot, "wide")
