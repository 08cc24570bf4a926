"""Scenes as planned by the framework with one constant changed, each run in a process of its own.

The process is forked from one that holds the other packages but nothing of the framework, which it imports
itself, changed or watched.
"""

from __future__ import annotations

import os
import pickle
import signal
import sys
import time
from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from types import FrameType
from typing import Any, NamedTuple

from tqdm import tqdm

from tests.benchmarks.tolerance_audit.constants import (
    Change,
    Constant,
    change_on_import,
    watch_on_import,
)
from tests.benchmarks.tolerance_audit.watched import Key, felt

PRELOADED = (
    "numpy",
    "scipy",
    "scipy.sparse.csgraph",
    "scipy.optimize",
    "scipy.interpolate",
    "pinocchio",
    "yaml",
)
PATIENCE = 15.0  # [s] of processor time for a scene, which takes a tenth of one, at most four


class Scene(NamedTuple):
    """A robot of the catalogue or of a file, and its scene, or a path and options of `plan_crossing`."""

    name: str
    robot: str
    flexibility: str
    scene: str  # of the robot's file; none if there is a path
    kind: str  # of the path: line or arc
    points: tuple[tuple[float, ...], ...]
    options: dict[str, Any]


class Outcome(NamedTuple):
    """What came of a scene: a plan with its worst defect, or the name of a refusal."""

    refusal: str  # the class of the error; none if there is a plan
    defect: float  # of the plan, `Judgement.worst`
    seconds: float  # of processor time

    @property
    def verdict(self) -> str:
        return self.refusal or "answer"

    def like(self, other: Outcome) -> bool:
        """Whether two runs came to the same, to the last bit."""
        return (self.refusal, self.defect) == (other.refusal, other.defect)


class Watching(NamedTuple):
    """What comes of a scene with constants watched, and which of their changes may make a difference."""

    outcome: Outcome
    felt: frozenset[Key]


class Run(NamedTuple):
    """Outcomes by the name of their scene, and the seconds of processor time that they took."""

    outcomes: dict[str, Outcome]
    seconds: float


def preload() -> None:
    """Import what the framework imports from elsewhere."""
    for name in PRELOADED:
        import_module(name)


def in_a_process(work: Callable[..., Any], *arguments: Any) -> Any:
    """Return what work(*arguments) returns in a forked process.

    Raises:
        RuntimeError: it ended without an answer.
    """
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            os.close(reading)
            answer = pickle.dumps(work(*arguments))
            with os.fdopen(writing, "wb") as stream:
                stream.write(answer)
        except BaseException as error:  # noqa: BLE001 - told, and the parent raises
            print(f"{type(error).__name__}: {error}", file=sys.stderr, flush=True)
            os._exit(1)
        os._exit(0)
    os.close(writing)
    with os.fdopen(reading, "rb") as stream:
        answer = stream.read()
    if os.waitpid(child, 0)[1] != 0:
        raise RuntimeError("a process of the audit ended without an answer")
    return pickle.loads(answer)


def all_scenes(folder: Path) -> tuple[list[Scene], list[Scene]]:
    """Return rigid and elastic scenes; to be called in a process of its own."""
    from tests.benchmarks.tolerance_audit.scenes import elastic, rigid

    return rigid(folder), elastic()


def planned(scenes: Sequence[Scene], change: Change | None = None) -> Run:
    """Plan scenes and judge the plans; to be called in a process of its own."""
    began = time.process_time()
    if change is not None:
        change_on_import(change)
    loaded: dict[tuple[str, str], Any] = {}
    progress = tqdm(scenes, desc="unchanged", unit="scene", leave=False, disable=change is not None)
    outcomes = {scene.name: _outcome(scene, loaded) for scene in progress}
    return Run(outcomes, time.process_time() - began)


def watched(scenes: Sequence[Scene], constants: Sequence[Constant]) -> dict[str, Watching]:
    """Plan scenes with constants watched; to be called in a process of its own."""
    watch_on_import(constants)
    import framework  # noqa: F401 - for all scenes, each of which is planned in a further process

    progress = tqdm(scenes, desc="watched", unit="scene", leave=False)
    return {scene.name: in_a_process(_watching, scene) for scene in progress}


def _watching(scene: Scene) -> Watching:
    outcome = _outcome(scene, {})
    return Watching(outcome, frozenset(felt))


class _TooLong(BaseException):
    """A scene takes longer than its time."""


def _give_up(number: int, frame: FrameType | None) -> None:
    raise _TooLong


def _outcome(scene: Scene, loaded: dict[tuple[str, str], Any]) -> Outcome:
    """Plan a scene. `loaded` has the robots that were loaded before."""
    from framework import FrameworkError
    from tests.benchmarks.tolerance_audit.judge import judged

    began = time.process_time()
    signal.signal(signal.SIGVTALRM, _give_up)
    signal.setitimer(signal.ITIMER_VIRTUAL, PATIENCE)
    try:
        plan = _plan(scene, loaded)
    except FrameworkError as error:
        return Outcome(type(error).__name__, 0.0, time.process_time() - began)
    except _TooLong:
        return Outcome("takes too long", 0.0, time.process_time() - began)
    except Exception as error:  # noqa: BLE001 - a fault of the framework is an outcome of its own
        return Outcome(f"fault: {type(error).__name__}", 0.0, time.process_time() - began)
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
    return Outcome("", judged(plan).worst, time.process_time() - began)


def _plan(scene: Scene, loaded: dict[tuple[str, str], Any]) -> Any:
    import robots
    from framework import Arc, Line, ParallelRobot, plan_crossing, plan_scene

    key = scene.robot, scene.flexibility
    if key not in loaded:
        load = ParallelRobot.from_file if scene.robot.endswith(".yaml") else robots.load
        loaded[key] = load(scene.robot, flexibility=scene.flexibility)
    if scene.scene:
        return plan_scene(loaded[key], scene.scene)
    path = {"line": Line, "arc": Arc}[scene.kind](*scene.points)
    return plan_crossing(loaded[key], path, **scene.options)
