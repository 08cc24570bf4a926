"""What tests of several folders share."""

import gc
import json
import signal
from collections.abc import Callable
from copy import deepcopy
from functools import cache, wraps
from pathlib import Path
from typing import Any

import pytest
import yaml

import robots
from framework import ParallelRobot, load_robot
from framework.cli import main


@cache
def _loaded(*arguments: Any, **options: Any) -> tuple[ParallelRobot, Any]:
    robot = load_robot(*arguments, **options)
    return robot, robot.model.copy()


@wraps(load_robot)
def _load_shared(*arguments: Any, **options: Any) -> ParallelRobot:
    """Robots are frozen: all tests of a process share one of each.

    What changes a model in place loads its own: `robots.CATALOGUE[name].load()`.
    """
    robot, untouched = _loaded(*arguments, **options)
    assert robot.model == untouched, f"a test before has changed the model of {robot.name} in place"
    return robot


robots.load = _load_shared
# Each takes as long as dozens of others: begun last, it would keep one core at work alone.
LONG = (
    "test_a_file_in_robots_is_all_that_the_generated_tests_need",
    "test_every_example_does_what_it_says",
    "test_the_commands_of_the_guides_run_in_their_order",
)


def pytest_collection_modifyitems(items) -> None:
    items.sort(key=lambda item: not item.name.startswith(LONG))


def pytest_collection_finish() -> None:
    """Thousands of tests are there to the end: the garbage collector need not look at them again."""
    gc.collect()
    gc.freeze()


FIVE_BAR = robots.CATALOGUE["five_bar"].file
REMOVED = object()  # the value of a key that is to go


def put(content: Any, key: str, value: Any) -> None:
    """Set (or remove) what a robot file has below a key such as `actuators.0.joint`."""
    *above, last = (int(part) if part.isdigit() else part for part in key.split("."))
    for part in above:
        content = content[part]
    if value is REMOVED:
        del content[last]
    elif isinstance(content, list) and last == len(content):
        content.append(value)
    else:
        content[last] = value


@pytest.fixture(scope="module")
def robot(request) -> ParallelRobot:
    """The robot that a module of tests is about: its `ROBOT` of the catalogue, with its `FLEXIBILITY`."""
    return robots.load(request.module.ROBOT, flexibility=getattr(request.module, "FLEXIBILITY", "rigid"))


@pytest.fixture
def quick_figures(monkeypatch):
    """Figures take seconds: tests/show draws them once, here a note stands for them."""

    def note(plan, folder) -> None:
        (folder / "figures.txt").write_text(f"{plan.robot.name}, {plan.robot.flexibility}")

    monkeypatch.setattr("framework.show.plots.save_figures", note)


@pytest.fixture
def hearing():
    """Ctrl-C is heard, also by tests that run in the background of a shell, which ignores it there."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    signal.signal(signal.SIGINT, before)


@cache
def _five_bar() -> Any:
    return yaml.safe_load(FIVE_BAR.read_text(encoding="utf-8"))


@pytest.fixture
def write_robot(tmp_path) -> Callable[..., Path]:
    """Writes the 5R's robot file and URDF into a folder of the test, with changes.

    `changes` are pairs (key, value) for the robot file; `urdf` are pairs (old, new) of its text.
    """

    def write(*changes: tuple[str, Any], urdf: tuple[tuple[str, str], ...] = ()) -> Path:
        content = deepcopy(_five_bar())
        for key, value in changes:
            put(content, key, value)
        text = FIVE_BAR.with_suffix(".urdf").read_text(encoding="utf-8")
        for old, new in urdf:
            assert old in text, f"the URDF has no {old!r}"
            text = text.replace(old, new, 1)
        (tmp_path / "five_bar.urdf").write_text(text, encoding="utf-8")
        file = tmp_path / "my_robot.yaml"
        file.write_text(yaml.safe_dump(content), encoding="utf-8")
        return file

    return write


@pytest.fixture
def crossing(capfd):
    """Runs one command: exit code, stdout, stderr, down to what libraries in C++ print."""

    def run(*arguments) -> tuple[int, str, str]:
        code = main([str(argument) for argument in arguments])
        return code, *capfd.readouterr()

    return run


@pytest.fixture
def document(crossing):
    """Runs one command with --json: its one object, and nothing else anywhere."""

    def run(*arguments) -> dict:
        code, out, err = crossing(*arguments, "--json")
        assert (code, err) == (0, "")
        assert out.count("\n") == 1
        return json.loads(out)

    return run


@pytest.fixture
def refusal(crossing):
    """Runs one command that is refused with this code: its one line of complaint."""

    def run(expected, *arguments) -> str:
        code, out, err = crossing(*arguments)
        if "--json" in arguments:
            told = json.loads(out)["error"]
            assert f"crossing: {told['message']}\n" == err
        else:
            assert out == ""
        assert code == expected
        assert err.startswith("crossing: ")
        assert err.count("\n") == 1
        assert err.endswith("\n")
        assert "Traceback" not in err
        return err

    return run
