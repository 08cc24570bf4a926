"""`crossing robustness`: control a crossing on many robots that differ from their model."""

from __future__ import annotations

import csv
from argparse import Namespace
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import asdict
from pathlib import Path

import numpy as np

from framework.cli import arguments
from framework.cli.commands import OneLineParser
from framework.cli.parser import (
    Report,
    add_executor,
    add_number,
    add_out,
    add_path_and_motion,
    add_robot_or_plan,
    integer_between,
)
from framework.control.closed_loop import Run
from framework.control.controllers import Tuning
from framework.control.linear_model import DISTURBANCES
from framework.control.prediction import LoopPrediction, predict_by_sensors, suggest_sensors
from framework.control.sensors import SENSORS, ControlLoop
from framework.control.study import (
    CONTROLLERS,
    FILE,
    GAINS,
    RUNS_PER_CHUNK,
    SensorTrial,
    Study,
    StudySetup,
    library_versions,
    load_study,
    run_store,
    run_studies,
    split_label,
)
from framework.control.variations import Spread
from framework.errors import FrameworkError, InvalidInput, NoAnswer
from framework.model.documents import prefix_errors
from framework.numerics.arrays import Array
from framework.numerics.fields import Table, list_of, mapping, mapping_of, read_table, required, text, whole
from framework.numerics.kept import KeptChunks
from framework.numerics.output import Document, json_text, select_fields

DEFAULT_CONTROLLER = "feedforward"
FILES = ("runs.csv", "robustness.pdf", "robustness.png")
QUANTILES = {"median": 0.5, "68 %": 0.6827, "95 %": 0.95, "largest": 1.0}  # 68.27 %: one normal deviation
COLUMNS = (
    "controller",
    "study_seed",
    "run",
    "passed",
    "tracking_error",
    "end_error",
    "peak_torque",
    "payload",
    "why",
)
DIFFERENCES = (  # of the robots from their model: option, default value, meaning
    ("payload", 0.05, "share of the payload, such as 10%% or 0.1, uniform in +-"),
    ("stiffness", 0.0, "share of each spring's stiffness, uniform in +-"),
    ("places", 0.0, "[m] standard deviation of each joint's place"),
    ("friction", 0.0, "share of each motor's peak torque, its Coulomb friction, uniform from 0"),
    ("delay", 0.0, "[s] from measurement to torque, uniform from 0"),
    ("noise", 0.0, "[rad, robot lengths] standard deviation of the encoders, joint side"),
    ("speed_noise", 0.0, "[rad/s, robot lengths/s] the same of measured speeds"),
)
FAILED = "  failed            {controller}, seed {seed}: {why}"
MORE_FAILED = "                    and {} more; --out or --json keeps all seeds"
PREDICTED = "  predicted         standard deviation of the platform under lqg, in robot lengths or rad: {}"
LEAST = "  least sensors     {}; chosen are {}"
AT_LIMITS = (
    "  at the limits     {} of {} failed runs of {} met the torque limits, of which the plan takes {:.3g} %{}"
)
LEAVE_MORE = "; `crossing plan --robust` looks for the margin that lqg needs"
TRIED = "  tried             lqg on robots beside those of the study: {}"
NO_SENSORS = (
    "no sensors keep the predicted standard deviation of the platform within the tolerance {:.4g}: {}"
)
NO_TRIAL = "no sensors pass in trial runs: {}"
SWEPT = 6  # values of a sweep
STORED_RUNS = 25  # runs in a stored chunk, at most: an interrupted study loses no more of them
MAX_RUNS = 1_000_000


def add_robustness_options(parser: OneLineParser) -> None:
    """Add the arguments of `crossing robustness`."""
    add_robot_or_plan(parser)
    add_path_and_motion(parser, without="friction")  # --friction is one of the differences of the robots
    group = parser.topic("the study")
    group.add_argument(
        "--controller",
        nargs="+",
        metavar="NAME",
        help=f"one or several of {', '.join(CONTROLLERS)} (default: feedforward); lqg estimates state and "
        "differences from its sensors and is for every robot, lqr needs --sensors joints for springs",
    )
    group.add_argument(
        "--runs",
        type=integer_between(0, MAX_RUNS),
        default=200,
        metavar="N",
        help="runs a controller (default: 200); 0 for what is predicted by sensors, without a run",
    )
    group.add_argument("--seed", type=int, default=0, metavar="K", help="of the random numbers (default: 0)")
    add_executor(parser)
    add_out(
        parser,
        "write robustness.json, runs.csv and a figure there; a study that is stopped keeps its finished "
        "runs there, and the same command goes on from them",
    )
    group.add_argument(
        "--replay",
        type=integer_between(0, MAX_RUNS),
        metavar="K",
        help="run number K of the study in the folder ROBOT once more, alone",
    )
    parser.set_defaults(parser=parser)
    gains = parser.topic("the controller")
    add_number(
        gains,
        "--bandwidth",
        "W",
        "natural frequency of feedforward and computed torque [rad/s] (default: 40 and 20, or less as the "
        "delay and springs demand)",
    )
    add_number(
        gains,
        "--integral",
        "R",
        "rate of their integral of the error [1/s] (default: 0, without)",
        default=0.0,
    )
    add_number(
        gains,
        "--torque-share",
        "X",
        "of lqr and lqg: torque correction, share of the peak, that costs as much as 1e-3 robot lengths; "
        "more is faster (default: 0.3)",
        default=Tuning.torque_share,
    )
    gains.add_argument(
        "--estimate",
        nargs="+",
        choices=DISTURBANCES,
        metavar="NAME",
        help=f"of lqg: what is estimated, of {', '.join(DISTURBANCES)} (default: what differs below)",
    )
    gains.add_argument(
        "--sweep",
        metavar="NAME=A..B",
        help="studies of each controller for several values of bandwidth, integral or torque_share, such as "
        "bandwidth=5..60",
    )
    spread = parser.topic("how the robots differ")
    for name, default, meaning in DIFFERENCES:
        add_number(
            spread,
            f"--{name.replace('_', '-')}",
            "X",
            f"{meaning} (default: {default:g})",
            dest=f"spread_{name}",
            default=default,
            type=str if meaning.startswith("share") else float,
        )
    loop = parser.topic("the control loop")
    add_number(loop, "--period", "T", "sampling period [s] (default: 1e-3)", default=1e-3)
    loop.add_argument(
        "--sensors",
        nargs="+",
        default=["motors"],
        metavar="NAME",
        help=f"of {', '.join(SENSORS)} and elbows:JOINT; joints are all, with the platform; or suggest, for "
        "the least that lqg is predicted to pass with, and passes with in trial runs (default: motors)",
    )
    add_number(loop, "--known-delay", "T", "from measurement to torque [s], of all (default: 0)", default=0.0)
    add_number(
        loop, "--counts", "N", "of motor encoders [1/turn], motor side (default: without steps)", default=0.0
    )
    add_number(
        loop,
        "--link-counts",
        "N",
        "of encoders of links and elbows [1/turn] (default: without steps)",
        default=0.0,
    )
    add_number(
        loop,
        "--limit",
        "TAU",
        "largest motor torques [N m] (default: those of the plan, or ten times its peaks)",
        nargs="+",
    )
    loop.add_argument(
        "--tolerance",
        metavar="E",
        default=str(ControlLoop.tolerance),
        help="runs that stay this near the plan pass [robot lengths, rad], or in millimetres, such as 0.5mm "
        "(default: %(default)s)",
    )


def run_robustness(options: Namespace) -> Report:
    """Study each controller on the same robots, repeat a single run, or predict without runs."""
    if options.replay is not None:
        return replay_run(options)
    if not options.runs:
        arguments.refuse_options(
            options, ("out", "controller", "sweep"), "--runs 0 does no runs; leave it out"
        )
        setup, predictions, trials = _choose_setup(options)
        robot = setup.plan.robot.name
        head = f"{robot}: without runs, {setup.loop.tolerance:.4g} robot lengths or rad passes"
        document = {"robot": robot, **setup.to_dict()} | _describe_sensors(predictions, trials)
        return document, [head, *_format_sensors(setup, predictions, trials)]
    _controller_names(options)  # unknown ones are refused before anything is planned
    with arguments.start_workers(options, "framework.control.study") as executor:
        return _study_controllers(options, executor)


def _study_controllers(options: Namespace, executor: Executor | None) -> Report:
    """Study each controller on the same robots."""
    store: KeptChunks | None = None

    def describe_kept() -> str:
        """Count the finished runs; empty if none is finished."""
        kept = [] if store is None else store.read().values()
        count = sum(arrays["passed"].size for arrays in kept)
        return f"{count} of {options.runs * len(controllers)} runs" if count else ""

    with arguments.written_stepwise(options, FILE, FILES, describe_kept) as folder:
        setup, predictions, trials = _choose_setup(options)
        controllers = {name: setup.controller(name) for name in _controller_names(options)}
        out = None if options.out is None else Path(options.out)
        store = None if out is None else run_store(out, setup.to_dict(), list(controllers))
        # chunks of about as many robots, a multiple of the processes; a robot has a run with each controller
        robots = max(1, (RUNS_PER_CHUNK if out is None else STORED_RUNS) // len(controllers))
        chunks = options.workers * -(-options.runs // (options.workers * robots))
        studies = run_studies(
            controllers,
            setup.loop,
            setup.spread,
            runs=options.runs,
            seed=setup.seed,
            executor=executor,
            chunk=-(-options.runs // chunks),
            keeper=store,
            progress=options.progress.start("simulating", options.runs * len(controllers), "runs"),
        )
        document = _make_document(setup, studies, out) | _describe_sensors(predictions, trials)
        if predictions:  # there are linear models
            for study, (name, controller) in zip(document["studies"], controllers.items(), strict=True):
                expected = setup.linear_models.predict(name, controller, setup.loop)
                if expected is not None:
                    study["predicted"] = expected.platform
                    warning = expected.warning(setup.loop.tolerance)
                    options.warnings += [warning] if warning else []
        if folder is not None:
            options.progress.start("drawing the figure")
            _write_studies(setup, studies, document, folder)
    return document, [*_format_studies(document), *_format_sensors(setup, predictions, trials)]


def _choose_setup(options: Namespace) -> tuple[StudySetup, list[LoopPrediction], list[SensorTrial]]:
    """Return the setup of a study, the predictions by sensors, and the trials of --sensors suggest."""
    setup = _make_setup(options)
    options.progress.start("predicting")
    suggests = options.sensors == ["suggest"]
    try:
        predictions = predict_by_sensors(
            setup.reference, setup.loop, setup.spread, models=setup.linear_models
        )
    except FrameworkError:  # the linear model does not exist
        if suggests or not options.runs:
            raise
        predictions = []
    if not suggests:
        return setup, predictions, []
    options.controller = options.controller or ["lqg"]
    options.progress.start("trying sensors")
    trials = setup.try_sensors(predictions)
    if not trials:
        raise NoAnswer(NO_SENSORS.format(setup.loop.tolerance, _list_predictions(predictions)))
    if not trials[-1].is_enough:
        raise NoAnswer(NO_TRIAL.format(_list_trials(trials)))
    return setup.with_sensors(trials[-1].sensors), predictions, trials


def _make_setup(options: Namespace) -> StudySetup:
    """Return the setup of a study: the plan and the settings."""
    stated = {name: getattr(options, f"spread_{name}") for name, *_ in DIFFERENCES}
    texts = {name: value for name, value in stated.items() if isinstance(value, str)}  # shares but defaults
    spread = Spread(**stated | {name: arguments.share(f"--{name}", text) for name, text in texts.items()})
    limit = None if options.limit is None else tuple(options.limit)
    plan = arguments.load_or_plan(options)
    try:
        tolerance = float(options.tolerance.removesuffix("mm"))
    except ValueError:
        raise InvalidInput(
            f"--tolerance: needs a number such as 0.0025, or 0.5mm, got {options.tolerance!r}"
        ) from None
    if options.tolerance.endswith("mm"):
        tolerance /= 1e3 * plan.robot.length
    loop = ControlLoop(
        tolerance=tolerance,
        end=tolerance,
        limit=limit,
        sensors="motors" if options.sensors == ["suggest"] else " ".join(options.sensors),
        delay=options.known_delay,
        counts=options.counts,
        link_counts=options.link_counts,
    )
    estimates = None if options.estimate is None else tuple(options.estimate)
    tuning = Tuning(options.bandwidth, options.integral, options.torque_share, estimates)
    return StudySetup.of(
        plan, period=options.period, loop=loop, spread=spread, seed=options.seed, tuning=tuning
    )


def _describe_sensors(predictions: list[LoopPrediction], trials: list[SensorTrial]) -> Document:
    """Return predictions and trials by sensors as a document."""
    return {
        "predicted": [asdict(one) for one in predictions],
        "tried": [one._asdict() for one in trials],
    }


def _format_sensors(
    setup: StudySetup, predictions: list[LoopPrediction], trials: list[SensorTrial]
) -> list[str]:
    """Format predictions and trials by sensors as lines of text."""
    lines: list[str] = []
    if predictions:
        chosen = suggest_sensors(predictions, setup.loop.tolerance)
        least = "none of these" if chosen is None else chosen.sensors
        lines += [PREDICTED.format(_list_predictions(predictions)), LEAST.format(least, setup.loop.sensors)]
    return [*lines, TRIED.format(_list_trials(trials))] if trials else lines


def _list_predictions(predictions: list[LoopPrediction]) -> str:
    """Return the predictions in words, by sensors."""
    return ", ".join(f"{one.sensors} {one.platform:.1e}" for one in predictions)


def _list_trials(trials: Sequence[SensorTrial]) -> str:
    """Return the trials in words, by sensors."""
    return ", ".join(f"{one.sensors} {one.passed} of {one.runs} passed" for one in trials)


def _controller_names(options: Namespace) -> list[str]:
    """Return the names of the controllers, each once, with the values of --sweep."""
    labels = list(dict.fromkeys(options.controller or [DEFAULT_CONTROLLER]))
    if options.sweep is not None:
        key, _, ends = options.sweep.partition("=")
        try:
            low, high = map(float, ends.split(".."))
        except ValueError:
            low = high = 0.0
        if key not in GAINS or not 0 < low < high < np.inf:
            raise InvalidInput(
                f"--sweep: needs {', '.join(GAINS[:-1])} or {GAINS[-1]} with two positive ends, such as "
                f"bandwidth=5..60, got {options.sweep!r}"
            )
        values = np.geomspace(low, high, SWEPT)
        labels = [f"{name} {key}={value:.4g}" for name in labels for value in values]
    for label in labels:
        split_label(label)  # refuses controllers, and gains that one does not have
    return labels


def _make_document(setup: StudySetup, studies: list[Study], folder: Path | None) -> Document:
    """Return all studies as a document."""
    robot = setup.plan.robot
    peaks = setup.plan.peak_torque
    limits = dict(zip(peaks, setup.loop.limit or (), strict=True))  # of a setup they are numbers
    exceeded = {joint: (peaks[joint], limit) for joint, limit in limits.items() if peaks[joint] > limit}
    return {
        "robot": robot.name,
        "exceeded": exceeded,
        "share_of_limits": max(peaks[joint] / limit for joint, limit in limits.items()),
        "has_limits": bool(np.isfinite(setup.reference.torque_limit).any()),
        "length": robot.length,
        "runs": len(studies[0].passed),
        **setup.to_dict(folder),
        "studies": [_describe_study(study, np.array(setup.loop.limit)) for study in studies],
    }


def _describe_study(study: Study, limit: Array) -> Document:  # limit (n_a,) [N m, N]
    """Return a study as a document: probability, quantiles of errors, failed runs, also at the limits."""
    return {
        **select_fields(study, "controller", "probability", "interval"),
        "predicted": None,  # standard deviation of the platform, of linear controllers
        "tracking_error": _compute_quantiles(study.tracking_error),
        "end_error": _compute_quantiles(study.end_error),
        "peak_torque": study.peak_torque.max(),
        "failed_at_limits": int((~study.passed & (study.peak_torque >= limit).any(axis=1)).sum()),
        "failures": [_describe_failure(study, number, (seed, number)) for seed, number in study.failures],
        "seconds": study.seconds,
    }


def _compute_quantiles(values: np.ndarray) -> dict[str, float]:
    """Compute median, 68 % and 95 % quantile and maximum of values (runs,), by name."""
    return {name: float(np.quantile(values, share)) for name, share in QUANTILES.items()}


HEAD = """\
{robot}: {runs} runs a controller, seed {seed}; errors in robot lengths ({length:.4g} m) or rad, \
up to {tolerance:.4g} ({tolerance_mm:.3g} mm) pass; torques in N m{binding}
  controller\tpassed\tof 95 %\tmedian\tpredicted\t68 %\t95 %\tlargest\tpeak torque"""
ROW = (
    "  {controller}\t{probability:.1%}\t{interval[0]:.1%} .. {interval[1]:.1%}\t"
    "{tracking_error[median]:.2e}\t{deviation}\t{tracking_error[68 %]:.2e}\t{tracking_error[95 %]:.2e}\t"
    "{tracking_error[largest]:.2e}\t{peak_torque:.3g}"
)


def _format_studies(document: Document) -> list[str]:
    """Return the table of studies in text, with the first failures of each."""
    exceeded = [f"{joint} {peak:.4g} of {limit:.4g}" for joint, (peak, limit) in document["exceeded"].items()]
    binding = f"; the plan itself exceeds the limits: {', '.join(exceeded)}" if exceeded else ""
    millimetres = 1e3 * document["length"] * document["tolerance"]
    head = HEAD.format_map(document | {"binding": binding, "tolerance_mm": millimetres})
    lines = [head]
    for study in document["studies"]:
        deviation = "-" if study["predicted"] is None else f"{study['predicted']:.2e}"
        lines.append(ROW.format_map(study | {"deviation": deviation}))
    for study in document["studies"]:
        failures = study["failures"]
        lines += [FAILED.format_map(study | failure) for failure in failures[:3]]
        if len(failures) > 3:
            lines.append(MORE_FAILED.format(len(failures) - 3))
        if met := study["failed_at_limits"]:
            taken = 100 * document["share_of_limits"]
            remedy = LEAVE_MORE if document["has_limits"] else ""
            lines.append(AT_LIMITS.format(met, len(failures), study["controller"], taken, remedy))
    return lines


def _write_studies(setup: StudySetup, studies: list[Study], document: Document, folder: Path) -> None:
    """Write studies into a folder: document, table of runs, and figure."""
    from framework.show.plots import save_figure
    from framework.show.study_figures import plot_robustness

    (folder / FILE).write_text(json_text(document))
    with open(folder / "runs.csv", "w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        for study in studies:
            peaks = study.peak_torque.max(axis=1)
            numbers = np.column_stack([study.tracking_error, study.end_error, peaks, study.payload])
            writer.writerows(
                [study.controller, study.seed, k, int(passed), *numbers[k].tolist(), study.why[k]]
                for k, passed in enumerate(study.passed)
            )
    save_figure(
        lambda: plot_robustness(studies, loop=setup.loop, length=document["length"]), folder / "robustness"
    )


# keys of robustness.json that --replay reads
_STUDY: Table = {"controller": required(text), "failures": required(list_of(mapping))}
_RUNS: Table = {
    "runs": required(whole),
    "versions": required(mapping_of(text)),
    "studies": required(list_of(lambda where, study: read_table(where, study, _STUDY, others=None))),
}
OF_A_REPLAY = ("robot_file", "replay", "controller", "json")  # options beside --replay


REPORT = """\
{robot}: run {run}, {controller}: {verdict}; {agreement}
  tracking error    {tracking_error:.3g} robot lengths or rad, at the end {end_error:.3g}
  peak torque       {peak_torque:.6g} N m
  payload           {payload:.6g} of the model's"""


def replay_run(options: Namespace) -> Report:
    """Repeat run number --replay of the study in the folder ROBOT.

    Raises:
        InvalidInput: an option that the study determines; no such study, controller or run.
    """
    defaults = vars(options.parser.parse_args([options.robot]))
    changed = [key for key, default in defaults.items() if getattr(options, key) != default]
    changed = [key for key in changed if key not in OF_A_REPLAY]
    arguments.refuse_options(options, changed, f"the study in {options.robot} has its own; leave it out")
    setup, saved = load_study(options.robot, robot_file=options.robot_file)
    with prefix_errors(Path(options.robot) / FILE, InvalidInput):
        stated = read_table("", saved, _RUNS, others=None)
    failures_of = {study["controller"]: study["failures"] for study in stated["studies"]}
    name = " ".join(options.controller or failures_of)  # of one alone
    if name not in failures_of:
        given = " ".join(options.controller or ()) or "none"
        raise InvalidInput(f"--controller: give one of this study: {', '.join(failures_of)}; got {given}")
    number = options.replay
    if number >= stated["runs"]:
        raise InvalidInput(f"--replay: the study has the runs 0 to {stated['runs'] - 1}, got {number}")
    run = setup.run(name, number)
    seed = [setup.seed, number]  # of this run, as in the document
    written = [failure for failure in failures_of[name] if failure.get("seed") == seed]
    # all results have one entry, that of the repeated run
    repeated = [] if run.passed[0] else [_describe_failure(run, 0, seed)]
    document = {
        "robot": setup.plan.robot.name,
        "controller": name,
        "run": number,
        **{key: getattr(run, key)[0] for key in ("passed", "why", "tracking_error", "end_error")},
        "peak_torque": run.peak_torque.max(),
        "payload": run.payload[0],
        "as_written": written == repeated,
        "versions": {"then": stated["versions"], "now": library_versions()},
    }
    agreement = "as in the study"
    if written != repeated:
        then, now = document["versions"].values()
        others = [f"{key} {then.get(key)} then, {now[key]} now" for key in now if then.get(key) != now[key]]
        agreement = f"otherwise than in the study, with {', '.join(others) or 'the same versions'}"
    return document, [
        REPORT.format_map(document | {"verdict": document["why"] or "passed", "agreement": agreement})
    ]


def _describe_failure(runs: Study | Run, number: int, seed: Sequence[int]) -> Document:
    """Return the entry of run `number` among the failures in robustness.json; `seed` is of study and run."""
    return {"seed": seed, "why": runs.why[number], "tracking_error": runs.tracking_error[number]}
