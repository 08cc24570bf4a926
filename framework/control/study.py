"""Studies: many runs of one controlled crossing on robots that differ from their model.

Runs are computed in chunks by any `concurrent.futures.Executor`. Each run is drawn from its own seed and has
the same result in any chunk, so results depend neither on the executor nor on the chunks. Finished chunks can
be stored, so that an interrupted study can go on. The set-up of a study is stored in robustness.json; with
its seed it reproduces any run.
"""

from __future__ import annotations

import platform
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass, field, fields, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from framework.argument_errors import explain_errors
from framework.control.closed_loop import Outcomes, Run, run_closed_loop, run_closed_loops, torque_limit
from framework.control.controllers import ComputedTorque, Controller, FeedforwardPD, Tuning
from framework.control.prediction import LinearModels, LoopPrediction
from framework.control.reference import Reference, reference_of
from framework.control.regulators import Weights, tune_lqr
from framework.control.sensors import ControlLoop, sensors_of
from framework.control.variations import Spread, draw
from framework.errors import InvalidInput, check_choice
from framework.model.documents import prefix_errors
from framework.numerics.fields import (
    Reader,
    Table,
    dataclass_of,
    list_of,
    mapping,
    not_negative,
    number,
    optional,
    or_null,
    positive,
    read_table,
    required,
    text,
    whole,
)
from framework.numerics.kept import ArrayField, Arrays, KeptChunks, complete_chunks
from framework.numerics.output import Document, package_versions
from framework.planning.result import CrossingPlan
from framework.planning.saved import plan_document, plan_from_document, read_document
from framework.tolerances import MAX_TRIAL_FAILURES, TRIAL_RUNS

RUNS_PER_CHUNK = 250  # runs that are stacked, of all controllers; larger stacks do not make a run cheaper


@dataclass(frozen=True, eq=False, kw_only=True)
class Study(Outcomes):
    """The outcomes of many runs, numbered from 0."""

    controller: str
    spread: Spread
    seed: int
    seconds: float  # computing time, in equal shares of controllers that were studied together

    @property
    def probability(self) -> float:
        """Share of the runs that passed."""
        return float(self.passed.mean())

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson's 95 % interval of the probability of passing.

        It contains the probabilities p from which the observed share differs by at most z standard deviations
        sqrt(p (1 - p) / runs), where a normal variable is within z deviations with a probability of 95 %.
        """
        z = 1.959963984540054
        runs, share = len(self.passed), self.probability
        middle = (share + z**2 / (2 * runs)) / (1 + z**2 / runs)
        half = z / (1 + z**2 / runs) * np.sqrt(share * (1 - share) / runs + z**2 / (4 * runs**2))
        return max(0.0, float(middle - half)), min(1.0, float(middle + half))

    @property
    def failures(self) -> list[tuple[int, int]]:
        """Seeds of the failed runs; `draw(robot, spread, seed)` reproduces the robot of each."""
        return [(self.seed, int(k)) for k in np.flatnonzero(~self.passed)]


def run_study(
    controller: Controller,
    loop: ControlLoop,
    spread: Spread,
    *,
    runs: int,
    name: str = "controller",
    seed: int = 0,
    executor: Executor | None = None,
    chunk: int | None = None,
    keeper: KeptChunks | None = None,
    progress: Callable[[int], None] = lambda done: None,
) -> Study:
    """Do `runs` closed-loop runs of a controller, see `run_studies`; `name` is that of the controller."""
    return run_studies(
        {name: controller},
        loop,
        spread,
        runs=runs,
        seed=seed,
        executor=executor,
        chunk=chunk,
        keeper=keeper,
        progress=progress,
    )[0]


def run_studies(
    controllers: Mapping[str, Controller],
    loop: ControlLoop,
    spread: Spread,
    *,
    runs: int,
    seed: int = 0,
    executor: Executor | None = None,
    chunk: int | None = None,
    keeper: KeptChunks | None = None,
    progress: Callable[[int], None] = lambda done: None,
) -> list[Study]:
    """Do `runs` closed-loop runs of each controller on the same robots, drawn from the spread.

    Args:
        controllers: by name, of one reference; they drive the robots along its planned motion.
        loop: torque limits, sensors and tolerances.
        spread: of the robots about the controllers' model.
        runs: number of robots.
        seed: of the random numbers.
        executor: computes chunks of runs; by default this process does. It must be able to pickle the
            controllers.
        chunk: number of robots that are computed together, at most and by default 250 over the number of
            controllers. Results do not depend on this number.
        keeper: stores finished chunks; stored chunks are not computed again.
        progress: called with the number of finished runs of all controllers. Without an executor a chunk in
            progress counts by the finished share of its motion.

    Raises:
        InvalidInput: fewer than one run, or a negative seed.
    """
    if runs < 1 or isinstance(runs, bool):
        raise InvalidInput(f"runs: needs at least 1, got {runs!r}")
    if seed < 0:
        raise InvalidInput(f"seed: needs a whole number of at least 0, got {seed!r}")

    started = time.perf_counter()
    count = len(controllers)
    largest = max(1, RUNS_PER_CHUNK // count)
    chunk_size = min(chunk or largest, largest)
    every = range(runs)
    parts = [every[first : first + chunk_size] for first in every[::chunk_size]]  # numbers of the robots
    chunks = {f"{part.start}-{part.stop}": part for part in parts}  # by the name of a stored chunk
    finished_runs = 0  # in finished chunks, for the progress within a chunk

    def report(names: Collection[str]) -> None:
        """Count the runs of finished chunks, and report their number."""
        nonlocal finished_runs
        finished_runs = count * sum(len(chunks[chunk_name]) for chunk_name in names)
        progress(finished_runs)

    # takes the numbers of the robots
    task = partial(run_chunk, list(controllers.values()), loop, spread, seed)

    def run_and_report(chunk_runs: range) -> Arrays:
        """Do the runs of a chunk in this process, and report progress within the chunk."""
        size = count * len(chunk_runs)
        return task(chunk_runs, lambda share: progress(finished_runs + int(share * size)))

    n_a = next(iter(controllers.values())).reference.robot.n_a

    def describe_arrays(chunk_runs: range) -> dict[str, ArrayField]:
        """Return types and shapes of the outcomes of a chunk, by field of `Outcomes`."""
        shape = (len(chunk_runs), count)
        # types by their numpy kinds: f for floats, b for booleans, U for text
        return {
            **dict.fromkeys(("tracking_error", "end_error", "payload"), ArrayField("f", shape)),
            "peak_torque": ArrayField("f", (*shape, n_a)),
            "passed": ArrayField("b", shape),
            "why": ArrayField("U", shape),
        }

    arrays = complete_chunks(
        run_and_report if executor is None else task,
        chunks,
        describe_arrays,
        executor=executor,
        keeper=keeper,
        progress=report,
    )
    seconds = (time.perf_counter() - started) / count
    studies: list[Study] = []
    for c, name in enumerate(controllers):
        outcomes: Document = {key: array[:, c] for key, array in arrays.items()}  # fields of `Outcomes`
        outcomes["why"] = tuple(outcomes["why"].tolist())
        studies.append(Study(controller=name, spread=spread, seed=seed, seconds=seconds, **outcomes))
    return studies


def run_chunk(
    controllers: Sequence[Controller],
    loop: ControlLoop,
    spread: Spread,
    seed: int,
    chunk: range,
    report_progress: Callable[[float], None] = lambda share: None,
) -> Arrays:
    """Do the runs of robots by number with C controllers; return outcomes (robots, C, ...) by field."""
    robot = controllers[0].reference.robot
    variations = [draw(robot, spread, (seed, number)) for number in chunk]
    runs = run_closed_loops(controllers, loop, spread, variations, report_progress)
    names = [field.name for field in fields(Outcomes)]
    return {name: np.stack([np.asarray(getattr(run, name)) for run in runs], axis=1) for name in names}


def run_store(out: Path, setup: Mapping[str, Any], controllers: Sequence[str]) -> KeptChunks:
    """Return the store in the folder `out` for the runs of controllers.

    Its name is a hash of the JSON document `setup`, in which the computing time of the plan does not count.
    """
    plan = {key: value for key, value in setup["plan"].items() if key != "seconds"}
    return KeptChunks.of(out, {**setup, "plan": plan, "controllers": list(controllers)})


# ------------------------------------------------------------------ controllers by name


GAINS = ("bandwidth", "integral", "torque_share")  # fields of Tuning that a label may have
CONTROLLERS = ("feedforward", "lqr", "lqg", "computed_torque", "naive_computed_torque")
GAINS_OF = {name: GAINS[2:] if name in ("lqr", "lqg") else GAINS[:2] for name in CONTROLLERS}


def split_label(label: str) -> tuple[str, dict[str, Any]]:
    """Return name and gains of a label such as `feedforward bandwidth=20`.

    Raises:
        InvalidInput: unknown name, a gain that this controller does not have, or no number.
    """
    name, *changes = label.split() or [""]
    check_choice("controller", name, CONTROLLERS)
    gains: dict[str, Any] = {}
    for change in changes:
        key, _, value = change.partition("=")
        check_choice(f"gain of {name}", key, GAINS_OF[name])
        gains[key] = number(f"{name}: {key}", value)
    return name, gains


def tuned_controller(
    name: str,
    reference: Reference,
    *,
    loop: ControlLoop | None = None,
    spread: Spread | None = None,
    tuning: Tuning | None = None,
    models: LinearModels | None = None,
) -> Controller:
    """Return the controller of a name, tuned for a loop and a spread of robots.

    Args:
        loop: sensors and known delay; by default encoders on the motors, without delay.
        spread: of robots about the model, by default none; lqg estimates what differs.
        tuning: what a designer chooses.
        models: linear models of these, if there are any.

    Raises:
        InvalidInput: unknown name, or a robot that the controller cannot drive.
    """
    check_choice("controller", name, CONTROLLERS)
    loop, spread, tuning = loop or ControlLoop(), spread or Spread(), tuning or Tuning()
    if name == "lqr":
        return tune_lqr(reference, loop=loop, weights=Weights(torque=tuning.torque_share))
    if name == "lqg":
        models = models or LinearModels.of(reference, spread, tuning)
        return models._replace(tuning=tuning).tune_lqg(loop)[0]
    if name == "feedforward":
        return FeedforwardPD.tune(reference, loop=loop, tuning=tuning)
    return ComputedTorque.tune(reference, aware=name == "computed_torque", loop=loop, tuning=tuning)


# ------------------------------------------------------------------ the set-up of a study, in robustness.json


FILE = "robustness.json"
FIRST_TRIAL = 2**32  # number of the first of them, beyond those of a study


class SensorTrial(NamedTuple):
    """Runs of lqg that passed with some sensors."""

    sensors: str
    passed: int
    runs: int

    @property
    def is_enough(self) -> bool:
        """Whether all of TRIAL_RUNS passed, or all but MAX_TRIAL_FAILURES of twice as many."""
        allowed = 0 if self.runs <= TRIAL_RUNS else MAX_TRIAL_FAILURES
        return self.passed >= self.runs - allowed


@dataclass(frozen=True, eq=False)
class StudySetup:
    """A plan with its sampling, its control loop and the spread of robots."""

    plan: CrossingPlan  # as read from its own document
    period: float  # [s]
    loop: ControlLoop  # with torque limits as numbers
    spread: Spread
    seed: int
    tuning: Tuning = field(default_factory=Tuning)

    @staticmethod
    @explain_errors
    def of(
        plan: CrossingPlan,
        *,
        period: float,
        loop: ControlLoop,
        spread: Spread,
        seed: int,
        tuning: Tuning | None = None,
    ) -> StudySetup:
        """Make the set-up of a new study.

        The plan is written to a document and read back, so that its torques equal those of a later rerun to
        the last bit.

        Raises:
            InvalidInput: a plan that cannot be written to a document; an invalid period, limit or sensor.
        """
        plan = plan_from_document(plan_document(plan), Path(FILE))
        limit = tuple(map(float, torque_limit(reference_of(plan, period=period), loop)))
        sensors_of(plan.robot, loop)
        return StudySetup(plan, period, replace(loop, limit=limit), spread, seed, tuning or Tuning())

    @cached_property
    def linear_models(self) -> LinearModels:
        """The linear models about the plan.

        Raises:
            InvalidInput: a motion of the platform moves no mass.
        """
        return LinearModels.of(self.reference, self.spread, self.tuning)

    @cached_property
    def reference(self) -> Reference:
        """The plan at the sampling instants of the controller."""
        return reference_of(self.plan, period=self.period)

    @explain_errors
    def controller(self, name: str) -> Controller:
        """Return the controller of a name, tuned for the loop and the spread.

        Gains may follow the name, such as `feedforward bandwidth=20`.

        Raises:
            InvalidInput: unknown name or gain, or a robot that the controller cannot drive.
        """
        kind, gains = split_label(name)
        tuning = replace(self.tuning, **gains)
        models = self.linear_models if kind == "lqg" else None
        return tuned_controller(
            kind, self.reference, loop=self.loop, spread=self.spread, tuning=tuning, models=models
        )

    @explain_errors
    def with_sensors(self, sensors: str) -> StudySetup:
        """Return the set-up with other sensors."""
        other = replace(self, loop=replace(self.loop, sensors=sensors))
        vars(other).update(
            {key: vars(self)[key] for key in ("reference", "linear_models") if key in vars(self)}
        )
        return other

    @explain_errors
    def try_sensors(self, predictions: Sequence[LoopPrediction]) -> list[SensorTrial]:
        """Try lqg with sensors in turn, until TRIAL_RUNS robots pass.

        The first are those of predictions within half of the tolerance, then of those within the tolerance.
        If all robots pass with none, the sensors with which most do are tried on as many more.

        The robots are not those of the study. Were a single set tried, its passing would show with a
        confidence of 95 % that more than 85 % of all robots pass; of several tried it shows less.

        Returns:
            The trials; the last one is enough, if any is.
        """
        trials: list[SensorTrial] = []

        def passes(sensors: str, first: int) -> int:
            """Count the robots from number `first` that pass."""
            numbers = range(FIRST_TRIAL + first, FIRST_TRIAL + first + TRIAL_RUNS)
            return int(self.with_sensors(sensors).run("lqg", *numbers).passed.sum())

        tolerance = self.loop.tolerance
        likely = [one for one in predictions if one.is_within(tolerance)]
        possible = [one for one in predictions if one.platform <= tolerance and one not in likely]
        for one in (*likely, *possible):
            trials.append(SensorTrial(one.sensors, passes(one.sensors, 0), TRIAL_RUNS))
            if trials[-1].is_enough:
                return trials
        best = max(trials, key=lambda trial: trial.passed, default=None)
        if best is not None and best.passed >= TRIAL_RUNS - MAX_TRIAL_FAILURES:
            passed = best.passed + passes(best.sensors, TRIAL_RUNS)
            trials.append(SensorTrial(best.sensors, passed, 2 * TRIAL_RUNS))
        return trials

    @explain_errors
    def run(self, controller: str, *numbers: int) -> Run:
        """Repeat runs of the study together.

        Args:
            controller: name of the controller.
            numbers: numbers of the runs, from 0.
        """
        variations = [draw(self.plan.robot, self.spread, (self.seed, number)) for number in numbers]
        return run_closed_loop(self.controller(controller), self.loop, self.spread, variations)

    def to_dict(self, folder: Path | None = None) -> Document:
        """Return the content of a robustness.json in `folder`, with the versions of libraries."""
        return {
            "seed": self.seed,
            "period": self.period,
            **asdict(self.loop),
            "spread": asdict(self.spread),
            "tuning": asdict(self.tuning),
            "plan": plan_document(self.plan, folder),
            "versions": library_versions(),
        }


_TUNING: dict[str, Reader[Any]] = {
    "bandwidth": or_null(positive),
    "integral": not_negative,
    "torque_share": positive,
    "estimates": or_null(list_of(text)),
}
_STUDY: Table = {
    "seed": required(whole),
    "period": required(positive),
    "tolerance": required(positive),
    "end": required(positive),
    "limit": required(list_of(positive)),
    "sensors": required(text),
    **{name: optional(not_negative, 0.0) for name in ("delay", "counts", "link_counts")},
    "tuning": optional(dataclass_of(Tuning, _TUNING), Tuning()),
    "spread": required(dataclass_of(Spread, dict.fromkeys(vars(Spread()), not_negative))),
    "plan": required(mapping),
}


def library_versions() -> dict[str, str]:
    """Return the versions on which the last bit of a run depends."""
    return {**package_versions(), "python": platform.python_version(), "machine": platform.machine()}


def load_study(folder: str | Path, *, robot_file: str | None = None) -> tuple[StudySetup, Document]:
    """Read the set-up of a study that `crossing robustness --out` wrote; return also its document.

    Args:
        robot_file: path of the robot's file, if it differs from the path in the document.

    Raises:
        InvalidInput: there is no robustness.json, the file is another document, or the robot has changed.
    """
    file = Path(folder) / FILE
    saved = read_document(file, "robustness")
    with prefix_errors(file, InvalidInput):  # the entries of the set-up, checked
        stated = read_table("", saved, _STUDY, others=None)
        loop = ControlLoop(**{field.name: stated[field.name] for field in fields(ControlLoop)})
    plan = plan_from_document(stated["plan"], file, robot_file=robot_file)
    with prefix_errors(file, InvalidInput):
        sensors_of(plan.robot, loop)
    setup = StudySetup(plan, stated["period"], loop, stated["spread"], stated["seed"], stated["tuning"])
    return setup, saved
