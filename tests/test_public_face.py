"""The public face: few names, objects that nobody can change behind their proof, misuse answered in words."""

import ast
import copy
import dataclasses
import doctest
import importlib
import inspect
import json
import pickle
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from types import MappingProxyType, ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import framework
import robots
from framework import (
    Arc,
    InvalidInput,
    Law,
    Line,
    Spline,
    assemble,
    atlas,
    chain_plans,
    check_robot,
    control,
    dynamics_at,
    errors,
    fidelity,
    forward_kinematics,
    inverse_dynamics,
    load_robot,
    locate_singularities,
    plan_crossing,
    plan_scene,
    plan_study,
    simulate,
    trace_locus,
    track_path,
    velocity_matrices,
)
from framework.identification import Conversions, Identification, Recording
from framework.model import Material, Section, readers
from framework.model.beams import tip_spring
from framework.model.readers.recognise import parse_any
from framework.planning.plan import plan_request
from framework.planning.request import Request
from framework.planning.saved import plan_document
from framework.proofs.working_modes import working_modes
from framework.show import plots
from framework.simulation import Stepper
from framework.singularity.points_on_path import search_path
from tests.test_public_names import PACKAGES

ERRORS = {
    name for name, value in vars(errors).items() if isinstance(value, type) and issubclass(value, Exception)
}
PATH = Line([0.1, 0.345], [-0.05, 0.195])
ROBOT = robots.load("five_bar")
UNCHANGED = SimpleNamespace(link_values=np.ones(2), links=SimpleNamespace(values=np.ones(2)))


DESIGN = atlas.Designs((), np.zeros((1, 0)))  # of no parameter


def study_task(axes: tuple[str, ...], keys: tuple[str, ...]) -> atlas.StudyTask:
    return atlas.StudyTask(str(ROBOT.description.file), (), "rigid", axes, None, 5, keys)


def TORQUE(t: float) -> list[float]:
    return [0.0, 0.0]


def test_the_core_is_small_and_has_every_error() -> None:
    assert set(framework.__all__) >= ERRORS
    assert all(issubclass(getattr(framework, name), framework.FrameworkError) for name in ERRORS)
    assert 15 <= len(set(framework.__all__) - ERRORS) <= 45
    assert all(getattr(framework, name).__doc__ for name in framework.__all__)


def test_the_first_page_of_the_reference_names_all_that_is_public() -> None:
    named = set(re.findall(r"`([\w.]+)`", framework.__doc__ or ""))
    modules = {name for name in named if name.startswith("framework.")}
    assert named - modules == set(framework.__all__) - ERRORS | {"InvalidInput", "NoAnswer"} | {
        "FrameworkError"
    }
    assert modules == {*PACKAGES, "framework.catalogue", "framework.errors"} - {"framework"}


def test_the_example_of_load_robot_is_true() -> None:
    found = doctest.testmod(importlib.import_module("framework.catalogue"))
    assert (found.failed, found.attempted) == (0, 2)


def reached(value: Any, place: str, seen: set[int]) -> Iterator[tuple[str, np.ndarray]]:
    """All arrays that hang on an object's public and private fields, with where they are."""
    if id(value) in seen or isinstance(value, (str, bytes, type, ModuleType, pin.Model)):
        return
    seen.add(id(value))
    if isinstance(value, np.ndarray):
        yield place, value
    elif isinstance(value, (tuple, list)):
        for name, item in zip(getattr(value, "_fields", range(len(value))), value, strict=True):
            yield from reached(item, f"{place}.{name}", seen)
    elif isinstance(value, (dict, MappingProxyType)):
        for key, item in value.items():
            yield from reached(item, f"{place}[{key!r}]", seen)
    elif dataclasses.is_dataclass(value):
        for name, item in vars(value).items():
            yield from reached(item, f"{place}.{name}", seen)


def whole_plan() -> Any:
    return plan_scene(robots.load("five_bar", flexibility="flexible_links"), "C")


def an_optimal_plan() -> Any:
    return plan_crossing(ROBOT, Arc([0.1, 0.345], [0.03, 0.26], [-0.05, 0.195]), duration=1.5, law="optimal")


def an_instant() -> Any:
    found = dynamics_at(ROBOT, assemble(ROBOT).q, wrenches={"left_tip": [1.0, 0, 0, 0, 0, 0]})
    assert found.indeterminate  # looks at what is computed when it is asked for
    assert found.motor_inertia.shape == found.velocity_matrix_rates.B.shape
    return found


OBJECTS: dict[str, Callable[[], Any]] = {
    "plan": whole_plan,
    "optimal plan": an_optimal_plan,
    "robot": lambda: robots.load("delta", flexibility="flexible_links"),
    "configuration": lambda: assemble(ROBOT, [0.0, 0.3]),
    "pose": lambda: forward_kinematics(ROBOT, assemble(ROBOT).q[ROBOT.actuated] + 0.01),
    "instant": an_instant,
    "branch": lambda: track_path(ROBOT, PATH),
    "points": lambda: locate_singularities(ROBOT, PATH),
    "matrices": lambda: velocity_matrices(ROBOT, assemble(ROBOT).q),
    "spline": lambda: Spline([[0.1, 0.345], [0.0, 0.27], [-0.05, 0.195]]),
    "simulation": lambda: simulate(plan_scene(ROBOT, "C")),
    "quick simulation": lambda: simulate(plan_scene(ROBOT, "A"), method="fast"),
}


@pytest.mark.parametrize("name", OBJECTS)
def test_nothing_that_is_returned_can_be_written_to(name: str) -> None:
    arrays = list(reached(OBJECTS[name](), name, set()))
    assert arrays
    assert [place for place, array in arrays if array.flags.writeable] == []


def test_what_was_given_stays_the_givers_own() -> None:
    series = np.array([0.5, 0.5])
    law = Law(series, 1.0)
    series[0] = 7.0
    assert law(0.5) == 0.5


def own_law(t: Any, order: int = 0) -> Any:
    return np.asarray(t)  # has no duration


MISUSE: dict[str, tuple[Callable[[], object], str]] = {
    "times is a number": (lambda: plan_crossing(ROBOT, PATH, duration=1.5, times=1.0), "times: .*list"),  # type: ignore[arg-type]
    "speeds is a word": (lambda: plan_crossing(ROBOT, PATH, duration=1.5, speeds="fast"), "speeds: .*list"),  # type: ignore[arg-type]
    "a list for a path": (lambda: plan_crossing(ROBOT, [[0, 1], [1, 0]], duration=1.0), "path: .*Line"),  # type: ignore[arg-type]
    "a list to locate": (lambda: locate_singularities(ROBOT, [[0, 1], [1, 0]]), "path: .*Line"),  # type: ignore[arg-type]
    "a name for a robot": (lambda: plan_crossing("five_bar", PATH, duration=1.0), "robot: .*load_robot"),  # type: ignore[arg-type]
    "to locate": (lambda: locate_singularities("five_bar", PATH), "robot: .*load_robot"),  # type: ignore[arg-type]
    "to assemble": (lambda: assemble("five_bar"), "robot: .*load_robot"),  # type: ignore[arg-type]
    "to check": (lambda: check_robot("five_bar"), "mechanism: .*load_robot"),  # type: ignore[arg-type]
    "to pose": (lambda: forward_kinematics("five_bar", [0, 0]), "robot: .*load_robot"),  # type: ignore[arg-type]
    "to differentiate": (lambda: velocity_matrices("five_bar", [0] * 4), "robot: .*load_robot"),  # type: ignore[arg-type]
    "to invert": (lambda: inverse_dynamics("five_bar", PATH, Law.rest_to_rest(1.0, 2)), "robot: .*load_"),  # type: ignore[arg-type]
    "to simulate": (lambda: simulate("five_bar", lambda t: t), "robot: .*load_robot"),  # type: ignore[arg-type]
    "a duration that is true": (lambda: plan_crossing(ROBOT, PATH, duration=True), "duration: .*got True"),
    "limits that are kept a bit": (
        lambda: plan_crossing(ROBOT, PATH, duration=1.5, keep_limits="no"),  # type: ignore[arg-type]
        "keep_limits: .*got 'no'",
    ),
    "wrenches in a list": (
        lambda: dynamics_at(ROBOT, assemble(ROBOT).q, wrenches=[1, 2]),  # type: ignore[arg-type]
        "wrenches: needs a wrench by frame",
    ),
    "one step": (
        lambda: simulate(plan_scene(ROBOT, "C"), method="fast", step=1.5),
        "step: 1.5 s is too long for 1.5 s; take at least 2 steps",
    ),
    "nothing drives it": (lambda: simulate(ROBOT), "torque: needs a plan"),
    "a scene of nothing": (lambda: plan_scene("five_bar", "C"), "robot: .*load_robot"),  # type: ignore[arg-type]
    "a law without duration": (lambda: inverse_dynamics(ROBOT, PATH, own_law), "law: .*duration"),  # type: ignore[arg-type]
    "a word for a law": (lambda: inverse_dynamics(ROBOT, PATH, "optimal"), "law: .*Law"),  # type: ignore[arg-type]
    "order -1 of a path": (lambda: PATH(0.5, -1), "order: .*got -1"),
    "order -1 of a law": (lambda: Law.rest_to_rest(1.0, 2)(0.5, -1), "order: .*got -1"),
    "order 1.5": (lambda: PATH(0.5, 1.5), "order: .*got 1.5"),  # type: ignore[arg-type]
    "flexibility without its name": (lambda: robots.load("five_bar", "flexible"), "flexibility='flexible'"),
    "a robot that nobody knows": (lambda: robots.load("five_bars"), "did you mean 'five_bar'"),
    "a robot that is a list": (lambda: framework.load_robot(["five_bar"]), "unknown robot"),  # type: ignore[arg-type]
}


@pytest.mark.parametrize("name", MISUSE)
def test_misuse_is_answered_by_what_was_expected(name: str) -> None:
    call, words = MISUSE[name]
    with pytest.raises(InvalidInput, match=words):
        call()


@pytest.mark.parametrize("what", ["torque", "motor_angle", "deflection", "platform"])
def test_an_order_that_no_derivative_has(what: str) -> None:
    function = getattr(plan_scene(ROBOT, "C"), what)
    for order in (-1, 0.5, "first"):
        with pytest.raises(InvalidInput, match="order"):
            function(0.5, order)


def test_copies_and_other_processes_cannot_write_either() -> None:
    law = Law.rest_to_rest(1.0, 2)
    for made in (pickle.loads(pickle.dumps(ROBOT)), copy.deepcopy(PATH), copy.deepcopy(law)):
        arrays = [value for value in vars(made).values() if isinstance(value, np.ndarray)]
        assert arrays
        assert not any(array.flags.writeable for array in arrays)


def test_a_view_of_what_may_change_is_copied() -> None:
    mine = np.array([0.5, 0.5])
    view = mine.view()
    view.flags.writeable = False
    law = Law(view, 1.0)
    mine[0] = 7.0
    assert law.coefficients[0] == 0.5


def test_numbers_of_numpy_are_kept_as_numbers(tmp_path: Path) -> None:
    plan = plan_crossing(ROBOT, PATH, duration=np.float32(1.5), times=[1.0], tolerance=np.float64(1e-10))  # type: ignore[arg-type]
    assert type(plan.request.duration) is float
    json.dumps(plan_document(plan, tmp_path))


def test_what_was_searched_belongs_to_what_is_planned() -> None:
    other = search_path(robots.load("five_bar_heavy"), PATH)
    with pytest.raises(InvalidInput, match="branch, searched: of ParallelRobot\\('five_bar_heavy'"):
        plan_request(ROBOT, Request.of(ROBOT, PATH, duration=1.5), searched=other)


EVERY_COMMAND_HAS = {"add", "run"}  # `framework.cli` calls them
STARTS = {"main"}  # of `crossing` and of `python -m framework`


def test_a_public_name_has_one_home() -> None:
    homes: dict[str, list[Path]] = {}
    for file in sorted(Path(framework.__file__).parent.rglob("*.py")):
        for name in re.findall(r"^(?:def|class) ([^\W_]\w*)", file.read_text(encoding="utf-8"), re.MULTILINE):
            homes.setdefault(name, []).append(file)
    several = {name for name, files in homes.items() if len(files) > 1}
    assert len(homes) > 1000
    assert several <= EVERY_COMMAND_HAS | STARTS


def test_readers_of_files_say_when_they_refuse_one() -> None:
    """Functions with a `raise` or a check of names in their body, of which the caller sees the error."""
    silent = []
    for file in sorted(Path(readers.__path__[0]).glob("*.py")):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.FunctionDef) or (node.name[0] == "_" and node.name != "__init__"):
                continue
            body = ast.unparse(node.body[1:])
            if re.search(r"\braise\b|\bcheck_\w+\(", body) and "Raises:" not in str(ast.get_docstring(node)):
                silent.append(f"{file.name}: {node.name}")
    assert not silent


@pytest.mark.parametrize(
    "option",
    [
        {"breaks": False},
        {"breaks": "soon"},
        {"breaks": [1j]},
        {"breaks": [10**400]},
        {"events": -1},
        {"events": [3]},
        {"method": [1.0]},
        {"start": 10**400},
        {"start_velocity": np.zeros(4, complex)},
        {"tolerance": 10**400},
        {"damping": np.zeros(4, complex)},
    ],
    ids=str,
)
def test_what_is_no_option_of_a_simulation_is_refused_by_its_name(option: dict[str, Any]) -> None:
    motion = inverse_dynamics(ROBOT, PATH, Law([0.5, 0.5], 1.0))
    with pytest.raises(InvalidInput, match=next(iter(option))):
        simulate(ROBOT, motion, **option)


@pytest.mark.parametrize(
    "call",
    [
        lambda: dynamics_at(ROBOT, ROBOT.reference.q + 0j),
        lambda: dynamics_at(ROBOT, [10**400] * 4),
        lambda: Line([10**400, 0.0], [0.0, 1.0]),
        lambda: PATH(0.5j),
        lambda: Law([0.5, 0.5], 1.0)(10**400),
        lambda: plan_crossing(ROBOT, PATH, duration=1.5, torque_limit=10**400),
    ],
)
def test_numbers_that_are_not_real_or_too_large_are_refused(call: Callable[[], Any]) -> None:
    with pytest.raises(InvalidInput, match="number"):
        call()


@pytest.mark.parametrize(
    ("name", "call"),
    [
        ("torque_limit", lambda: plan_crossing(ROBOT, PATH, duration=1.5, torque_limit=[[1.0, 2.0], [3.0]])),
        ("times", lambda: plan_crossing(ROBOT, PATH, duration=1.5, times=[[1.0, 2.0], [3.0]])),
        ("reference", lambda: load_robot("five_bar", reference=[0.5])),
        ("parameters", lambda: load_robot("five_bar", parameters="l1")),
        ("parameters", lambda: plan_study("five_bar", PATH, [1.0], quantities={})),
        ("plans", lambda: chain_plans(1.0)),
        ("free", lambda: trace_locus(ROBOT, ROBOT.reference.q, free="x")),
        ("starts", lambda: trace_locus(ROBOT, ROBOT.reference.q, starts=-1)),
        ("reach", lambda: trace_locus(ROBOT, ROBOT.reference.q, reach=[1.0, 2.0, 3.0])),
        ("smoothness", lambda: Law.rest_to_rest(1.0, 10**400)),
        ("tolerance", lambda: fidelity.predict_level(ROBOT.description, PATH, tolerance=-0.1, duration=1.5)),
        ("units", lambda: Conversions(units="deg")),  # type: ignore[arg-type]
        ("window: lower", lambda: atlas.Window((0,), np.array([np.nan]), np.ones(1), (5, 1), np.zeros(2))),
        ("axes", lambda: atlas.design_study(study_task((), ("g",)), DESIGN)),
        (
            "quantity",
            lambda: atlas.design_study(study_task(("x",), ("h",)), DESIGN),
        ),
        ("seed", lambda: control.draw(ROBOT, control.Spread(), (1, "x"))),  # type: ignore[arg-type]
        ("torque", lambda: Stepper.of(ROBOT).start(ROBOT.reference.q, torque=[1.0, 2.0, 3.0])),
        ("tolerance", lambda: plan_crossing(ROBOT, PATH, duration=1.5, tolerance=1e-19)),
        ("smoothness", lambda: Law.rest_to_rest(1.0, 2).least_speed_ratio(1.5)),  # type: ignore[arg-type]
        ("count", lambda: Law.rest_to_rest(1.0, 2).derivatives(0.5, 1.5)),  # type: ignore[arg-type]
        ("values", lambda: Recording("log", ("time", "torque_a"), np.ones(2))),
        ("endings", lambda: Recording("log", ("time",), np.ones((2, 1))).columns("a", 5)),  # type: ignore[arg-type]
        ("index", lambda: Recording("log", ("time",), np.ones((2, 1))).rows(np.array([1j]))),
        ("t: needs", lambda: simulate(ROBOT, lambda t: np.zeros(2), duration=0.01).platform(np.ones((2, 2)))),
    ],
)
def test_what_is_of_another_kind_is_refused_by_its_name(name: str, call: Callable[[], Any]) -> None:
    with pytest.raises(InvalidInput, match=name):
        call()


@pytest.mark.parametrize("package", PACKAGES)
def test_every_public_function_names_an_argument_of_another_kind(package: str) -> None:
    module = importlib.import_module(package)
    functions = {name: getattr(module, name) for name in module.__all__ if name != "show_figure"}  # takes all
    for function in filter(inspect.isfunction, functions.values()):
        parameters = inspect.signature(function).parameters.values()
        needed = [each for each in parameters if each.default is each.empty]
        places = [each.name for each in needed if each.kind is each.POSITIONAL_OR_KEYWORD]
        options = {each.name: Strange() for each in needed if each.kind is each.KEYWORD_ONLY}
        if not places:
            continue
        with pytest.raises(InvalidInput, match="|".join(["controller", "robot", *places, *options])):
            list(function(*[Strange() for _ in places], **options))  # of a generator: where it begins
        if "smoothness" not in inspect.signature(function).parameters and all(  # plans read the robot first
            each.kind is not each.VAR_KEYWORD for each in needed
        ):
            with pytest.raises(TypeError, match="'strange' is no option"):
                function(*[Strange() for _ in places], **options, strange=1)


class Strange:
    """What no function takes."""


def test_an_error_of_a_callers_own_stays_as_it_is() -> None:
    def torque(t: float) -> list[float]:
        raise LookupError("mine")

    with pytest.raises(LookupError, match="mine"):
        simulate(ROBOT, torque, duration=1e-3)


def test_a_public_function_is_one_object_that_is_pickled_by_its_package() -> None:
    assert fidelity.largest_load is framework.largest_load
    assert pickle.loads(pickle.dumps(framework.plan_crossing)) is framework.plan_crossing


@pytest.mark.parametrize(
    ("successor", "use"),
    [
        ("are_all", lambda: working_modes(ROBOT, [0.1, 0.345]).truncated),
        ("NotIdentified", lambda: bool(Identification.keeps_file.fget(UNCHANGED))),
        ("beam_spring", lambda: not tip_spring("a", "b", Section.tube(0.01), Material(1.0, 1.0), 1.0)),
        ("see tree", lambda: parse_any(ROBOT.description.file).urdf.tag != "robot"),
        ("save_figure", lambda: plots.save is not plots.save_figure),
        ("reference", lambda: simulate(ROBOT, TORQUE, duration=1e-3, method="explicit").duration != 1e-3),
    ],
)
def test_what_goes_with_a_later_version_warns_where_it_is_used(successor: str, use: Callable) -> None:
    with pytest.warns(DeprecationWarning, match=successor) as warned:
        assert use() is (successor == "NotIdentified")
    lines = [(warning.filename, warning.lineno) for warning in warned]
    assert lines == [(__file__, use.__code__.co_firstlineno)]
